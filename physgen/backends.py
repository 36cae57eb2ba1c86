"""A role and a name -> the backend that fills it; the one table, importing nothing until asked.

A newcomer adds a backend with one file under a `backends/` folder and one row here; `tests/contract` then
runs on it.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from physgen.problems import InputError


@dataclass(frozen=True)
class Backend:
    """One row of the table."""

    role: str
    """What it does: `segment`, `inpaint` ... ; the Protocol of the same name says what it takes and gives."""
    name: str
    target: str
    """`module:factory`; the factory takes no arguments and gives a callable of the role's Protocol."""
    about: str
    """One sentence for `physgen backends`."""
    extra: str | None = None
    """The extra that brings what it imports; None: it is in the core."""
    needs: tuple[str, ...] = ()
    """Modules that it imports beyond the core."""

    def missing(self) -> tuple[str, ...]:
        """Modules that it needs and that are not installed (looked for, not imported)."""
        return tuple(name for name in self.needs if importlib.util.find_spec(name) is None)


_HERE = "physgen.perceive.backends"

BACKENDS: tuple[Backend, ...] = (
    Backend("segment", "learned", f"{_HERE}.segment_learned:learned",
            "A small network and edges propose, the network judges; trained on drawn and rendered homes."),
    Backend("segment", "classical", f"{_HERE}.segment_classical:classical",
            "Finds objects by edges, circles and colour; no model."),
    Backend("label", "shape", f"{_HERE}.label_shape:shape",
            "Calls round things ball, rectangles block and the rest object."),
    Backend("physics", "table", f"{_HERE}.physics_table:table",
            "Looks the label up in the material table and weighs the outline."),
    Backend("normals", "blended", f"{_HERE}.normals_blended:blended",
            "Balls, turned things, cushions and flat faces, as outline, shading and the network say; tables, walls."),
    Backend("intrinsic", "retinex", f"{_HERE}.intrinsic_retinex:retinex",
            "Takes changes of colour as albedo, most others as shading; normals tell the rest."),
    Backend("light", "shading", f"{_HERE}.light_shading:shading",
            "Compares lights all over the sky with the shading of all things, and with highlights."),
    Backend("matte", "edge", f"{_HERE}.matte_edge:edge",
            "A soft border of about two pixels that follows the photo's own edge."),
    Backend("inpaint", "fill", f"{_HERE}.inpaint_fill:fill",
            "Continues the surroundings' colour smoothly and borrows their grain."),
    Backend("shadow", "geometry", f"{_HERE}.shadow_geometry:geometry",
            "Looks for the light whose shadows lie where the photo is dark, and lifts them."),
    Backend("boundary", "support", f"{_HERE}.boundary_support:support",
            "Tells side from top views and lays floors under the lowest points of objects."),
)  # fmt: skip
"""In each role, the first row is the default."""


def roles() -> tuple[str, ...]:
    """Every role, in the table's order."""
    return tuple(dict.fromkeys(row.role for row in BACKENDS))


def names(role: str) -> tuple[str, ...]:
    """Names of one role's backends, the default first."""
    return tuple(row.name for row in BACKENDS if row.role == role)


def find(role: str, name: str | None = None) -> Backend:
    """The row of `role` called `name` (None: the role's default).

    Raises InputError for a role or a name that is not in the table.

    >>> find("inpaint").name
    'fill'
    """
    if role not in roles():
        raise InputError.of("--backend", f'"{role}"', "is not a role", _choose(role, roles()))
    for row in BACKENDS:
        if row.role == role and name in (None, row.name):
            return row
    known = names(role)
    raise InputError.of("--backend", f'{role}="{name}"', "is not a backend", _choose(str(name), known))


def make(role: str, name: str | None = None) -> Any:
    """The backend itself, imported now: a callable of the role's Protocol.

    Raises InputError for an unknown role or name, or when a library that it needs is not installed.
    """
    row = find(role, name)
    if missing := row.missing():
        raise InputError.of(
            "--backend", f'{role}="{row.name}"', f"needs {', '.join(missing)}, which is not installed",
            f'pip install "physgen[{row.extra}]"' if row.extra else "install physgen again",
        )  # fmt: skip
    module, _, factory = row.target.partition(":")
    return getattr(importlib.import_module(module), factory)()


def chosen(settings: Iterable[str]) -> dict[str, str]:
    """`["segment=classical", ...]` as given to `--backend` -> role -> name.

    Raises InputError with every wrong one.

    >>> chosen(["inpaint=fill"])
    {'inpaint': 'fill'}
    """
    result: dict[str, str] = {}
    problems = []
    for setting in settings:
        role, sign, name = setting.partition("=")
        try:
            if not sign:
                fix = "write e.g. inpaint=fill"
                raise InputError.of("--backend", f'"{setting}"', "is not ROLE=NAME", fix)
            result[role] = find(role, name).name
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return result


def listing() -> list[Mapping[str, Any]]:
    """One mapping a row for `physgen backends`: role, name, default, installed, missing, install, about."""
    return [
        {
            "role": row.role,
            "name": row.name,
            "default": row.name == names(row.role)[0],
            "installed": not row.missing(),
            "missing": list(row.missing()),
            "install": f'pip install "physgen[{row.extra}]"' if row.extra else None,
            "about": row.about,
        }
        for row in BACKENDS
    ]


def _choose(found: str, known: tuple[str, ...]) -> str:
    near = difflib.get_close_matches(found, known, 1)
    return (f"did you mean {near[0]}? " if near else "") + f"choose from {', '.join(known)}"
