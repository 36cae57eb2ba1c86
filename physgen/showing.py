"""A scene, world or trajectory -> what a notebook shows in its cell.

The classes live far below what draws them, so their `_repr_html_` asks here, and the drawing is imported then.
"""

from __future__ import annotations

import importlib


def html(thing: object) -> str:
    """As HTML; nothing is imported before somebody looks."""
    shown: str = importlib.import_module("physgen.notebook").html(thing)
    return shown
