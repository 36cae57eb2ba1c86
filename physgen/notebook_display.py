"""HTML representation of objects in notebook cells."""

from __future__ import annotations

import importlib


def html(thing: object) -> str:
    """As HTML; nothing is imported before somebody looks."""
    shown: str = importlib.import_module("physgen.pipeline.notebook").html(thing)
    return shown
