"""A round thing that would roll away -> a stop beside it, so that it rests where it is and still can be pushed.

A thing that is held itself can never move, and what lies against it, of the same kind, can. A stop is a boundary of its
own: it leaves all of them alike, lets a push away from it through, and lets go of them when it is deleted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from physgen.geometry import Array
from physgen.outline.outline import Disc, Outline
from physgen.perceive.roles import Thing, Wall

SIDES = (0.0, 180.0, 30.0, 150.0, 60.0, 120.0)
"""degrees from +x towards +y at which a stop may touch: upright ones first, which carry nothing."""
LONG = 0.4
"""Of a thing's radius: half the length of a stop."""
LEAST = 0.15
"""Of its radius: what must be left of a stop on either side of where it touches."""


def stop(
    thing: Thing,
    free: Callable[[Sequence[tuple[float, float]]], list[list[tuple[float, float]]]],
    stands: Callable[[Array], bool],
    name: str,
    friction: float,
    elasticity: float,
) -> Wall | None:
    """The first stop that fits in and with which it stands; `free` cuts what lies in other things off a chain."""
    outline: Outline = thing.outline
    if not isinstance(outline, Disc):
        return None
    for side in np.radians(SIDES):
        way = np.array([np.cos(side), np.sin(side)])
        along = np.array([-way[1], way[0]])
        # rounding leaves a gap, not an overlap
        at = outline.center + (outline.radius + 0.01) * way
        chain = [at - LONG * outline.radius * along, at + LONG * outline.radius * along]
        for part in free([(round(float(x), 2), round(float(y), 2)) for x, y in chain]):
            first, last = ((np.array(end) - at) @ along for end in (part[0], part[-1]))
            if min(-first, last) >= LEAST * outline.radius and stands(np.array(part)):
                reason = "nothing seen keeps what lies here from rolling away, so a stop does; without it, it rolls"
                return Wall(name, tuple(part), friction, elasticity, 0.3, "what is at rest", reason)
    return None
