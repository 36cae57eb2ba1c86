"""Name of a shipped file -> its path, in an editable install and in the wheel alike."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_ROOTS = (_PACKAGE / "_data", _PACKAGE.parent)


def resource(*parts: str) -> Path:
    """Path of a file below `schemas/` or `templates/`.

    >>> resource("schemas", "scene-1.schema.json").name
    'scene-1.schema.json'
    """
    for root in _ROOTS:
        path = root.joinpath(*parts)
        if path.exists():
            return path
    raise FileNotFoundError(f"physgen was installed without {'/'.join(parts)}; install it again")
