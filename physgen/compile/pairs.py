"""Coefficients of single surfaces -> factors whose product is the pair's coefficient; and the table of pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

from physgen.compile.world import Surface, World
from physgen.scene.model import Combine


def surface(friction: float, elasticity: float, combine: Combine) -> Surface:
    """The engine multiplies the two factors of a pair, so the geometric mean is the product of square roots.

    >>> a, b = surface(0.4, 0.9, Combine.GEOMETRIC), surface(0.1, 0.4, Combine.GEOMETRIC)
    >>> round(a.friction * b.friction, 12), round(a.elasticity * b.elasticity, 12)
    (0.2, 0.6)
    """
    if combine is Combine.GEOMETRIC:
        return Surface(sqrt(friction), sqrt(elasticity))
    return Surface(friction, elasticity)


TABLE = "the table"
"""How the table pairs are called; two words, so that nothing in a scene has that name."""


@dataclass(frozen=True)
class Pair:
    """What holds between two groups of things with equal surfaces."""

    first: str
    second: str
    friction: float
    elasticity: float


@dataclass(frozen=True)
class Pairing:
    """The same, with everybody's name."""

    first: tuple[str, ...]
    second: tuple[str, ...]
    friction: float
    elasticity: float


def pair_table(world: World) -> list[Pair]:
    """The pair coefficients in use, as they are shown; see `pairings`."""
    return [Pair(_names(p.first), _names(p.second), p.friction, p.elasticity) for p in pairings(world)]


def pairings(world: World) -> list[Pairing]:
    """The pair coefficients in use; things with equal surfaces share one. Seen from above, so does the table."""
    groups: dict[Surface, list[str]] = {}
    movable = len(world.bodies)
    pairs = []
    for name, its in world.surfaces[:movable]:
        groups.setdefault(its, []).append(name)
    walls: dict[Surface, list[str]] = {}
    for name, its in world.surfaces[movable:]:
        walls.setdefault(its, []).append(name)
    if world.press > 0 and world.table.friction > 0:
        walls.setdefault(world.table, []).append(TABLE)
    rows = list(groups.items())
    for i, (a, first) in enumerate(rows):
        for b, second in rows[i:]:
            if a is b and len(first) == 1:
                continue
            pairs.append(_pairing(first, second, a, b))
        for b, second in walls.items():
            pairs.append(_pairing(first, second, a, b))
    return pairs


def _pairing(first: Sequence[str], second: Sequence[str], a: Surface, b: Surface) -> Pairing:
    return Pairing(tuple(first), tuple(second), a.friction * b.friction, a.elasticity * b.elasticity)


def _names(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 3 else f"{names[0]}, {names[1]} and {len(names) - 2} more"


def pair_header(world: World) -> str:
    """The table as lines of text; "" where nothing can touch."""
    rows = [
        f"{p.first} x {p.second}: friction {p.friction:.4g}, elasticity {p.elasticity:.4g}"
        for p in pair_table(world)
    ]
    return "\n".join(["pair coefficients in use:", *rows]) if rows else ""
