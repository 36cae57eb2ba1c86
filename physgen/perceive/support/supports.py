"""Extra supports so that every object at rest stays at rest: ledges, walls to lean on and wedges."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from physgen.geometry.polygon import Array, Disc, Outline, bounds, mass_properties
from physgen.perceive.roles import PhotoObject, Wall
from physgen.perceive.support.equilibrium import Contact, contacts, unstable_objects, wall_contacts
from physgen.perceive.support.ground_contact import cradle, lower_hull

# ----------------------------------------------------------------------
# A round thing that would roll away -> a stop beside it, so that it rests where it is and still can be
# pushed.
#
# A thing that is held itself can never move, and what lies against it, of the same kind, can. A stop is a
# boundary of its
# own: it leaves all of them alike, lets a push away from it through, and lets go of them when it is deleted.

SIDES = (0.0, 180.0, 30.0, 150.0, 60.0, 120.0)
"""degrees from +x towards +y at which a stop may touch: upright ones first, which carry nothing."""
LONG = 0.4
"""Of a thing's radius: half the length of a stop."""
LEAST = 0.15
"""Of its radius: what must be left of a stop on either side of where it touches."""


def make_wedge(
    thing: PhotoObject,
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


# ----------------------------------------------------------------------
# Things and the walls found -> more walls, so that all stands: nests, walls to lean on, stops; what is left
# is held.
#
# What a photo shows at rest is at rest. Where the balance of forces says that a thing would fall, something
# that nobody
# sees holds it; where no support fits in without entering other things, the thing itself is held.

EVERY = 0.5
"""px between the points at which a chain is tried against the things."""
SKIN = 0.05
"""px that a chain may lie within an outline: rounding."""
UPHELD_LEAST = 1.5
"""px: a piece of a chain shorter than this carries nothing."""
AGAINST_WALL, BETWEEN = 0.4, 0.25
"""Coefficients of friction counted on; less than most things have, so that what stands so stands for sure."""
SLENDER = 0.75
"""Height over width from which a thing may be leaning, not lying askew."""
MANY = 40
"""Things in a photo, beyond which all that would fall get their ledges at once."""
TIMES = 5
"""Times that this is done, after which what would still fall is held."""
FROM_BELOW = 0.3
"""Sine of the angle by which a surface under a thing faces up."""
LEAN = 0.35
"""Of its height, from the top, within which a thing leans against what is beside it."""


def add_supports(
    things: Sequence[PhotoObject],
    walls: Sequence[Wall],
    grip: dict[int, float],
    friction: float,
    elasticity: float,
) -> tuple[list[Wall], frozenset[int]]:
    """Walls to add, and the ids of things that no wall can hold."""
    added: list[Wall] = []
    held: set[int] = set()
    outlines = [thing.outline for thing in things]
    boxes = np.array([bounds(outline) for outline in outlines]).reshape(-1, 4)
    fixed = {k for k, thing in enumerate(things) if thing.cut}
    between = contacts(outlines, [])
    chains = [np.array(wall.points) for wall in walls if wall.name != "frame"]
    on = [contact for chain in chains for contact in wall_contacts(outlines, boxes, chain)]
    known: dict[tuple[object, ...], list[int]] = {}
    tried: dict[int, int] = {}
    many = len(things) > MANY

    def stands(found: Sequence[Contact], lost: int, chain: Array) -> bool:
        more = [*found, *wall_contacts(outlines, boxes, chain)]
        return len(unstable_objects(outlines, more, _friction(things, more, grip), fixed)) < lost

    for times in range(TIMES if many else 4 * len(things) + 1):
        found = between + sorted(on, key=lambda contact: contact.thing)
        lost = unstable_objects(outlines, found, _friction(things, found, grip), fixed, known=known)
        if not lost:
            break
        # of many, all at once: whatever stands by another's ledge has one of its own then
        for k in lost if many else lost[:1]:
            thing = things[k]
            tried[k] = tried.get(k, 0) + 1
            others = [outline for i, outline in enumerate(outlines) if i != k]
            wall = None
            if tried[k] == 1:
                wall = _to_lean_on(thing, found, k, others, _next("wall", added), friction, elasticity)
            # what rolls off something seen needs no ledge under it
            if wall is None and not many and (tried[k] == 3 or (tried[k] == 1 and _lies_on(found, k))):
                wall = make_wedge(
                    thing,
                    partial(free_parts, others=others),
                    partial(stands, found, len(lost)),
                    _next("stop", added),
                    friction,
                    elasticity,
                )
            if wall is None and tried[k] <= 2:
                tried[k] = 2
                wall = _nest(thing, others, _next("nest", added), friction, elasticity)
            if wall is None or (many and times == TIMES - 1):
                held.add(thing.id)
                fixed.add(k)
            else:
                added.append(wall)
                on += wall_contacts(outlines, boxes, np.array(wall.points))
    return added, frozenset(held)


def _next(kind: str, added: Sequence[Wall]) -> str:
    """`kind-1`, `kind-2`, ..."""
    return f"{kind}-{1 + sum(wall.name.startswith(kind) for wall in added)}"


def _lies_on(found: Sequence[Contact], k: int) -> bool:
    """Whether something is under a thing."""
    return any(
        c.normal[1] * (1 if c.thing == k else -1) < -FROM_BELOW for c in found if k in (c.thing, c.other)
    )


def _friction(
    things: Sequence[PhotoObject], found: Sequence[Contact], grip: dict[int, float]
) -> dict[tuple[int, int], float]:
    result = {}
    for c in found:
        least = AGAINST_WALL if c.other < 0 else BETWEEN
        grips = [grip.get(things[k].id, 0.0) for k in (c.thing, c.other) if k >= 0]
        result[c.thing, c.other] = max(least, min(grips))
    return result


def _nest(
    thing: PhotoObject, others: Sequence[Outline], name: str, friction: float, elasticity: float
) -> Wall | None:
    """A short ledge under a thing, bent to its underside, between the others."""
    center = mass_properties(thing.outline).center
    chain = cradle(thing, center, lower_hull(thing.outline))
    parts = [p for p in free_parts(chain, others) if p[0][0] <= center[0] <= p[-1][0]]
    if not parts:
        return None
    reason = "nothing seen holds what lies here, so a short ledge does; without it, it falls"
    return Wall(name, tuple(parts[0]), friction, elasticity, 0.3, "what is at rest", reason)


def _to_lean_on(
    thing: PhotoObject,
    found: Sequence[Contact],
    k: int,
    others: Sequence[Outline],
    name: str,
    friction: float,
    elasticity: float,
) -> Wall | None:
    """An upright wall beside the top of a thing that stands on a wall and would tip over its edge."""
    if isinstance(thing.outline, Disc):
        return None
    feet = [float(c.point[0]) for c in found if c.thing == k and c.other < 0 and c.normal[1] < -0.7]
    center = mass_properties(thing.outline).center
    x0, y0, x1, y1 = bounds(thing.outline)
    if not feet or y1 - y0 < SLENDER * (x1 - x0):
        return None
    side = 1 if center[0] > max(feet) else -1 if center[0] < min(feet) else 0
    points = np.concatenate([ring.outer for ring in thing.outline.rings])
    x = x1 if side > 0 else x0
    at = points[np.abs(points[:, 0] - x) < 0.5][:, 1]
    if side == 0 or at.min() > y0 + LEAN * (y1 - y0):
        return None
    away = round(float(np.ceil(x * 100) if side > 0 else np.floor(x * 100)) / 100, 2)
    chain = [(away, round(y0 - 2.0, 2)), (away, round(float(y1), 2))]
    parts = [p for p in free_parts(chain, others) if p[0][1] <= at.min() <= p[-1][1]]
    if not parts:
        return None
    reason = "a thing leans to this side and would fall over: something upright is beside it"
    return Wall(name, tuple(parts[0]), friction, elasticity, 0.4, "what is at rest", reason)


def free_parts(
    chain: Sequence[tuple[float, float]], others: Sequence[Outline]
) -> list[list[tuple[float, float]]]:
    """A chain of points without the parts of it that lie within outlines; the pieces that are left, in order."""
    points = np.array(chain, np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    near = []
    for other in others:
        x0, y0, x1, y1 = bounds(other)
        if x0 < high[0] and x1 > low[0] and y0 < high[1] + 0.01 and y1 > low[1] - 0.01:
            near.append(other)
    if not near:
        return [list(chain)]
    runs = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(runs)])
    at = np.unique(np.concatenate([along, np.arange(0, along[-1], EVERY)]))
    tried = np.stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)], axis=1)
    free = np.ones(len(at), bool)
    for other in near:
        free &= depth_inside(other, tried) <= SKIN
    parts = []
    start = None
    for i in range(len(at) + 1):
        if i < len(at) and free[i]:
            start = i if start is None else start
        elif start is not None:
            first, last = at[start], at[i - 1]
            start = None
            if last - first < UPHELD_LEAST:
                continue
            kept = [p for p, a in zip(chain, along, strict=True) if first < a < last]
            parts.append([_at(chain, along, first), *kept, _at(chain, along, last)])
    return parts


def _at(chain: Sequence[tuple[float, float]], along: Array, way: float) -> tuple[float, float]:
    """The point of a chain that lies so far along it, y rounded down the photo."""
    if way in (0, along[-1]):
        return chain[0 if way == 0 else -1]
    x, y = (float(np.interp(way, along, [p[axis] for p in chain])) for axis in (0, 1))
    return round(x, 2), float(np.ceil(y * 100 - 1e-6) / 100)


def depth_inside(outline: Outline, points: Array) -> Array:
    """`(N,)` px by which points `(N, 2)` lie within an outline, holes not counted; 0 outside."""
    if isinstance(outline, Disc):
        return np.asarray(np.maximum(outline.radius - np.hypot(*(points - outline.center).T), 0.0))
    depth: Array = np.zeros(len(points))
    x, y = points[:, 0, None], points[:, 1, None]
    for ring in outline.rings:
        a, b = ring.outer, np.roll(ring.outer, -1, axis=0)
        spans = (a[:, 1] > y) != (b[:, 1] > y)
        rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
        inside = (spans & (x < (b[:, 0] - a[:, 0]) * (y - a[:, 1]) / rise + a[:, 0])).sum(1) % 2 > 0
        if inside.any():
            way = b - a
            off = points[inside, None] - a[None]
            share = np.clip((off * way).sum(-1) / np.maximum((way**2).sum(-1), 1e-12), 0, 1)
            gap = np.hypot(*np.moveaxis(off - share[..., None] * way[None], -1, 0)).min(axis=1)
            depth[inside] = np.maximum(depth[inside], gap)
    return depth
