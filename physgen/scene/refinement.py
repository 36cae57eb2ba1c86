"""`refine:` of a tree -> Problems: a backend that nobody knows, and a strength that leaves no step to run."""

from __future__ import annotations

from math import ceil

from physgen import backends
from physgen.scene.node import Node, children
from physgen.scene.report import Report
from physgen.scene.schema import at
from physgen.scene.words import listed, nearest, number, shown

PATH = ("refine",)


def check_refine(root: Node, report: Report) -> None:
    """Adds what is wrong in `refine`; nothing is imported to look a backend up."""
    node = children(root).get("refine")
    parts = {key: part for key, part in children(node).items() if part not in report.bad}
    backend = parts.get("backend")
    if backend is None or backend.value == "none":
        return
    known = backends.names("refine")
    if backend.value not in known:
        close = nearest(str(backend.value), known)
        fix = (f"did you mean {close}? " if close else "") + f"choose {listed(known)}"
        report.value(backend, (*PATH, "backend"), "is no backend that refines", fix)
    values = {
        key: parts[key].value if key in parts else at(f"refine.{key}")["default"]
        for key in ("steps", "strength")
    }
    steps, strength = values["steps"], values["strength"]
    if isinstance(steps, int) and isinstance(strength, int | float) and steps * strength < 0.5:
        least = ceil(50 / steps) / 100
        guilty = "strength" if "strength" in parts else "steps"
        place = parts[guilty].place if guilty in parts else backend.place
        what = f"leaves none of {shown(steps)} steps to run"
        fix = f"write at least {number(least)}, or backend: none"
        report.add(place, (*PATH, "strength"), shown(strength), what, fix)
