"""Extra supports so that every object at rest stays at rest: ledges, walls to lean on
and wedges.

What a photo shows at rest is at rest. Where the balance of forces says that an object
would fall, something unseen holds it; where no support fits in without entering other
objects, the object itself is held. A round object that would roll away gets a wedge
beside it: unlike a held object it still lets a push through, and it can be deleted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from physgen.geometry.polygon import Array, Disc, Outline, bounds, mass_properties
from physgen.perceive.roles import PhotoObject, Wall
from physgen.perceive.support.equilibrium import (
    Contact,
    contacts,
    unstable_objects,
    wall_contacts,
)
from physgen.perceive.support.ground_contact import cradle, lower_hull, rounded_down

Chain = Sequence[tuple[float, float]]
SOURCE = "what is at rest"
"""Of these walls, for `from`."""


@dataclass(frozen=True)
class _Limits:
    """Sizes of supports; px unless stated."""

    # between the points at which a chain is tested against the objects
    step: float = 0.5
    skin: float = 0.05  # that a chain may lie within an outline: rounding
    shortest: float = 1.5  # a shorter piece of a chain carries nothing
    # counted on; less than most objects have, so that what stands so stands for sure
    wall_friction: float = 0.4
    object_friction: float = 0.25  # the same between objects
    # height over width from which an object may be leaning, not lying askew
    slender: float = 0.75
    many: int = 40  # objects, beyond which all that would fall get their ledges at once
    rounds: int = 5  # of that, after which what would still fall is held
    # sine of the angle by which a surface under an object faces up
    from_below: float = 0.3
    # share of its height, from the top, in which an object leans against a neighbour
    lean: float = 0.35
    # degrees; upright first: they carry nothing
    wedge_sides: tuple[float, ...] = (0.0, 180.0, 30.0, 150.0, 60.0, 120.0)
    wedge_length: float = 0.4  # of the object's radius: half the length of a wedge
    # of its radius: the least length of a wedge on either side of the contact
    wedge_rest: float = 0.15


LIMITS = _Limits()


def add_supports(
    objects: Sequence[PhotoObject],
    walls: Sequence[Wall],
    grip: dict[int, float],
    friction: float,
    elasticity: float,
) -> tuple[list[Wall], frozenset[int]]:
    """Return the walls with those that what would fall needs, without unseen ones that
    nothing needs; and the ids of objects that no wall can hold.
    """
    every = list(walls)
    held: set[int] = set()
    outlines = [item.outline for item in objects]
    boxes = np.array([bounds(outline) for outline in outlines]).reshape(-1, 4)
    fixed = {k for k, item in enumerate(objects) if item.cut}
    between = contacts(outlines, [])
    on = [
        wall_contacts(outlines, boxes, np.array(w.points)) if w.name != "bottom" else []
        for w in walls
    ]
    known: dict[tuple[object, ...], list[int]] = {}
    tries: dict[int, int] = {}
    many = len(objects) > LIMITS.many

    def stands(found: Sequence[Contact], lost: int, chain: Array) -> bool:
        more = [*found, *wall_contacts(outlines, boxes, chain)]
        return (
            len(unstable_objects(outlines, more, _friction(objects, more, grip), fixed))
            < lost
        )

    def wall_of(kind: str, chain: Chain, confidence: float, reason: str) -> Wall:
        name = f"{kind}-{1 + sum(wall.name.startswith(kind) for wall in every)}"
        return Wall(
            name, tuple(chain), friction, elasticity, confidence, SOURCE, reason
        )

    def falls(on: Sequence[Sequence[Contact]]) -> tuple[list[Contact], list[int]]:
        found = between + [one for wall in on for one in wall]
        return found, unstable_objects(
            outlines, found, _friction(objects, found, grip), fixed, known=known
        )

    for times in range(LIMITS.rounds if many else 4 * len(objects) + 1):
        found, lost = falls(on)
        if not lost:
            break
        # of many, all at once: what another's ledge would have held has one of its own then
        for k in lost if many else lost[:1]:
            item = objects[k]
            tries[k] = tries.get(k, 0) + 1
            others = [outline for i, outline in enumerate(outlines) if i != k]
            wall = None
            if tries[k] == 1 and (chain := _wall_to_lean_on(item, found, k, others)):
                wall = wall_of("wall", chain, 0.4, "holds what leans")
            # an object that rolls off something seen needs no ledge under it
            if (
                wall is None
                and not many
                and (tries[k] == 3 or (tries[k] == 1 and _lies_on(found, k)))
            ):
                chain = make_wedge(
                    item,
                    partial(free_parts, others=others),
                    partial(stands, found, len(lost)),
                )
                if chain:
                    wall = wall_of("stop", chain, 0.3, "else it rolls away")
            if wall is None and tries[k] <= 2:
                tries[k] = 2
                if chain := _nest(item, others):
                    wall = wall_of("nest", chain, 0.3, "else it falls")
            if wall is None or (many and times == LIMITS.rounds - 1):
                held.add(item.id)
                fixed.add(k)
            else:
                every.append(wall)
                on.append(wall_contacts(outlines, boxes, np.array(wall.points)))
    for k in reversed(range(len(every))):
        if every[k].source == SOURCE and every[k].name != "floor":
            found, lost = falls(on[:k] + on[k + 1 :])
            if not lost and all(_lies_on(found, one.body) for one in on[k]):
                del every[k], on[k]
    return every, frozenset(held)


def _lies_on(found: Sequence[Contact], k: int) -> bool:
    """Return whether something is under an object."""
    return any(
        c.normal[1] * (1 if c.body == k else -1) < -LIMITS.from_below
        for c in found
        if k in (c.body, c.other)
    )


def _friction(
    objects: Sequence[PhotoObject], found: Sequence[Contact], grip: dict[int, float]
) -> dict[tuple[int, int], float]:
    result = {}
    for c in found:
        least = LIMITS.wall_friction if c.other < 0 else LIMITS.object_friction
        grips = [grip.get(objects[k].id, 0.0) for k in (c.body, c.other) if k >= 0]
        result[c.body, c.other] = max(least, min(grips))
    return result


def _nest(item: PhotoObject, others: Sequence[Outline]) -> Chain | None:
    """Return a short ledge under an object, bent to its underside, between the others."""
    center = mass_properties(item.outline).center
    chain = cradle(item, center, lower_hull(item.outline))
    parts = [p for p in free_parts(chain, others) if p[0][0] <= center[0] <= p[-1][0]]
    return parts[0] if parts else None


def _wall_to_lean_on(
    item: PhotoObject, found: Sequence[Contact], k: int, others: Sequence[Outline]
) -> Chain | None:
    """Return a short upright wall beside the top of an object that stands on a wall and
    would tip over its edge.
    """
    if isinstance(item.outline, Disc):
        return None
    feet = [
        float(c.point[0])
        for c in found
        if c.body == k and c.other < 0 and c.normal[1] < -0.7
    ]
    center = mass_properties(item.outline).center
    x0, y0, x1, y1 = bounds(item.outline)
    if not feet or y1 - y0 < LIMITS.slender * (x1 - x0):
        return None
    side = 1 if center[0] > max(feet) else -1 if center[0] < min(feet) else 0
    points = np.concatenate([ring.outer for ring in item.outline.rings])
    x = x1 if side > 0 else x0
    at = points[np.abs(points[:, 0] - x) < 0.5][:, 1]
    if side == 0 or at.min() > y0 + LIMITS.lean * (y1 - y0):
        return None
    away = round(float(np.ceil(x * 100) if side > 0 else np.floor(x * 100)) / 100, 2)
    chain = [(away, round(y0 - 2.0, 2)), (away, round(y0 + LIMITS.lean * (y1 - y0), 2))]
    parts = [p for p in free_parts(chain, others) if p[0][1] <= at.min() <= p[-1][1]]
    return parts[0] if parts else None


def make_wedge(
    item: PhotoObject,
    free: Callable[[Chain], list[Chain]],
    stands: Callable[[Array], bool],
) -> Chain | None:
    """Return the first wedge beside a round object that fits in and with which it
    stands.

    `free` cuts off the parts of a chain that lie in other objects; `stands(wall)`:
    whether that wall helps.
    """
    outline = item.outline
    if not isinstance(outline, Disc):
        return None
    for side in np.radians(LIMITS.wedge_sides):
        way = np.array([np.cos(side), np.sin(side)])
        along = np.array([-way[1], way[0]])
        # rounding leaves a gap, not an overlap
        at = outline.center + (outline.radius + 0.01) * way
        reach = LIMITS.wedge_length * outline.radius * along
        for part in free(
            [
                (round(float(x), 2), round(float(y), 2))
                for x, y in (at - reach, at + reach)
            ]
        ):
            first, last = ((np.array(end) - at) @ along for end in (part[0], part[-1]))
            if min(-first, last) >= LIMITS.wedge_rest * outline.radius and stands(
                np.array(part)
            ):
                return part
    return None


def free_parts(chain: Chain, others: Sequence[Outline]) -> list[Chain]:
    """Return a chain of points without the parts of it that lie within outlines; the
    remaining pieces, in order.
    """
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
    at = np.unique(np.concatenate([along, np.arange(0, along[-1], LIMITS.step)]))
    tried = np.stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)], axis=1)
    free = np.ones(len(at), bool)
    for other in near:
        free &= depth_inside(other, tried) <= LIMITS.skin
    parts: list[Chain] = []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]])))
    for start, stop in edges.reshape(-1, 2):
        first, last = at[start], at[stop - 1]
        if last - first >= LIMITS.shortest:
            kept = [p for p, a in zip(chain, along, strict=True) if first < a < last]
            parts.append(
                [
                    _point_along(chain, along, first),
                    *kept,
                    _point_along(chain, along, last),
                ]
            )
    return parts


def _point_along(chain: Chain, along: Array, way: float) -> tuple[float, float]:
    """Return the point of a chain at this length along it."""
    if way in (0, along[-1]):
        return chain[0 if way == 0 else -1]
    return rounded_down(
        *(float(np.interp(way, along, [p[axis] for p in chain])) for axis in (0, 1))
    )


def depth_inside(outline: Outline, points: Array) -> Array:
    """`(N,)` px by which points `(N, 2)` lie within an outline, holes not counted; 0
    outside.
    """
    if isinstance(outline, Disc):
        return np.asarray(
            np.maximum(outline.radius - np.hypot(*(points - outline.center).T), 0.0)
        )
    depth: Array = np.zeros(len(points))
    x, y = points[:, 0, None], points[:, 1, None]
    for ring in outline.rings:
        a, b = ring.outer, np.roll(ring.outer, -1, axis=0)
        spans = (a[:, 1] > y) != (b[:, 1] > y)
        rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
        inside = (
            spans & (x < (b[:, 0] - a[:, 0]) * (y - a[:, 1]) / rise + a[:, 0])
        ).sum(1) % 2 > 0
        if inside.any():
            way = b - a
            off = points[inside, None] - a[None]
            share = np.clip(
                (off * way).sum(-1) / np.maximum((way**2).sum(-1), 1e-12), 0, 1
            )
            gap = np.hypot(*np.moveaxis(off - share[..., None] * way[None], -1, 0)).min(
                axis=1
            )
            depth[inside] = np.maximum(depth[inside], gap)
    return depth
