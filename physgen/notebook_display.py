"""HTML representation of objects in notebook cells.

The classes lie far below the code that draws them. `physgen.pipeline` registers that code here when it is imported.
"""

from __future__ import annotations

from collections.abc import Callable

_render: Callable[[object], str] | None = None


def register(render: Callable[[object], str]) -> None:
    """From now on `render` makes the HTML of scenes, worlds and trajectories."""
    global _render
    _render = render


def html(value: object) -> str:
    """The HTML of an object. Raises NotImplementedError, and the notebook shows text, before `physgen.pipeline`."""
    if _render is None:
        raise NotImplementedError("import physgen.pipeline to show this in a notebook")
    return _render(value)
