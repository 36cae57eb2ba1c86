"""Additional supports that keep objects at rest: ledges, walls to lean on and wedges.

An object that is at rest in the photo must be at rest in the scene. If the balance of
forces says that it would fall, an invisible support holds it. If no support fits
without entering other objects, the object itself is held. A round object that would
roll away gets a wedge: unlike holding, a wedge still lets a push through, and a user
can delete it.
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
"""Source of these walls, for `from`."""


@dataclass(frozen=True)
class _Limits:
    """Sizes of supports; px unless stated."""

    # Distance between the points at which a chain is tested against the objects.
    step: float = 0.5
    # Depth of a chain inside an outline that rounding explains.
    skin: float = 0.05
    # Shortest supporting piece of a chain.
    shortest: float = 1.5
    # Friction assumed for stability; less than most objects have, so that stable
    # objects are certain.
    wall_friction: float = 0.4
    # The same between objects.
    object_friction: float = 0.25
    # Least ratio of height to width of a leaning object.
    slender: float = 0.75
    # Objects above which all unstable ones get their ledges at once.
    many: int = 40
    # Rounds of that, after which the remaining ones are held.
    rounds: int = 5
    # Sine of the angle by which a surface under an object faces up.
    from_below: float = 0.3
    # Part of its height, from the top, at which an object leans against a neighbour.
    lean: float = 0.35
    # Directions of wedges, degrees; upright wedges come first, because they carry no
    # weight.
    wedge_sides: tuple[float, ...] = (0.0, 180.0, 30.0, 150.0, 60.0, 120.0)
    # Half the length of a wedge, as a share of the object's radius.
    wedge_length: float = 0.4
    # Least length of a wedge on either side of the contact, as a share of the radius.
    wedge_rest: float = 0.15


LIMITS = _Limits()


def add_supports(
    objects: Sequence[PhotoObject],
    walls: Sequence[Wall],
    grip: dict[int, float],
    friction: float,
    elasticity: float,
) -> tuple[list[Wall], frozenset[int]]:
    """Return the walls with the supports that unstable objects need, and the ids of
    objects to hold.

    Invisible walls without a function are removed. Objects are held if no wall can
    support them.
    """
    all_walls = list(walls)
    held_ids: set[int] = set()
    outlines = [item.outline for item in objects]
    boxes = np.array([bounds(outline) for outline in outlines]).reshape(-1, 4)
    fixed_indices = {k for k, item in enumerate(objects) if item.cut}
    object_contacts = contacts(outlines, [])
    on = [
        wall_contacts(outlines, boxes, np.array(w.points)) if w.name != "bottom" else []
        for w in walls
    ]
    cache: dict[tuple[object, ...], list[int]] = {}
    tries: dict[int, int] = {}
    crowd = len(objects) > LIMITS.many

    def stands(found: Sequence[Contact], lost: int, chain: Array) -> bool:
        all_contacts = [*found, *wall_contacts(outlines, boxes, chain)]
        return (
            len(
                unstable_objects(
                    outlines,
                    all_contacts,
                    _friction(objects, all_contacts, grip),
                    fixed_indices,
                )
            )
            < lost
        )

    def wall_of(kind: str, chain: Chain, confidence: float, reason: str) -> Wall:
        name = f"{kind}-{1 + sum(wall.name.startswith(kind) for wall in all_walls)}"
        return Wall(
            name, tuple(chain), friction, elasticity, confidence, SOURCE, reason
        )

    def falls(on: Sequence[Sequence[Contact]]) -> tuple[list[Contact], list[int]]:
        found = object_contacts + [contact for wall in on for contact in wall]
        return found, unstable_objects(
            outlines, found, _friction(objects, found, grip), fixed_indices, known=cache
        )

    # Each round finds the unstable objects and adds one support per object.
    for times in range(LIMITS.rounds if crowd else 4 * len(objects) + 1):
        found, lost = falls(on)
        if not lost:
            break
        # In a crowded photo all unstable objects get supports at once: an object on
        # another's ledge then has a ledge of its own.
        for k in lost if crowd else lost[:1]:
            item = objects[k]
            tries[k] = tries.get(k, 0) + 1
            others = [outline for i, outline in enumerate(outlines) if i != k]
            wall = None
            if tries[k] == 1 and (chain := _wall_to_lean_on(item, found, k, others)):
                wall = wall_of("wall", chain, 0.4, "holds what leans")
            # An object that rolls off a visible support needs a wedge, not a ledge.
            if (
                wall is None
                and not crowd
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
            # No support fits: hold the object itself.
            if wall is None or (crowd and times == LIMITS.rounds - 1):
                held_ids.add(item.id)
                fixed_indices.add(k)
            else:
                all_walls.append(wall)
                on.append(wall_contacts(outlines, boxes, np.array(wall.points)))
    # Remove supports that later supports made unnecessary.
    for k in reversed(range(len(all_walls))):
        if all_walls[k].source == SOURCE and all_walls[k].name != "floor":
            found, lost = falls(on[:k] + on[k + 1 :])
            if not lost and all(_lies_on(found, contact.body) for contact in on[k]):
                del all_walls[k], on[k]
    return all_walls, frozenset(held_ids)


def _lies_on(found: Sequence[Contact], k: int) -> bool:
    """Return whether a contact supports an object from below."""
    return any(
        c.normal[1] * (1 if c.body == k else -1) < -LIMITS.from_below
        for c in found
        if k in (c.body, c.other)
    )


def _friction(
    objects: Sequence[PhotoObject], found: Sequence[Contact], grip: dict[int, float]
) -> dict[tuple[int, int], float]:
    """Return the friction by pair of objects."""
    result = {}
    for c in found:
        assumption = LIMITS.wall_friction if c.other < 0 else LIMITS.object_friction
        grips = [grip.get(objects[k].id, 0.0) for k in (c.body, c.other) if k >= 0]
        result[c.body, c.other] = max(assumption, min(grips))
    return result


def _nest(item: PhotoObject, others: Sequence[Outline]) -> Chain | None:
    """Return a short ledge along the underside of an object, between the others, or
    None.
    """
    center = mass_properties(item.outline).center
    chain = cradle(item, center, lower_hull(item.outline))
    parts = [p for p in free_parts(chain, others) if p[0][0] <= center[0] <= p[-1][0]]
    return parts[0] if parts else None


def _wall_to_lean_on(
    item: PhotoObject, found: Sequence[Contact], k: int, others: Sequence[Outline]
) -> Chain | None:
    """Return a short upright wall beside the top of an object, or None.

    The object stands on a wall and would tip over its edge.
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
    rows = points[np.abs(points[:, 0] - x) < 0.5][:, 1]
    if side == 0 or rows.min() > y0 + LIMITS.lean * (y1 - y0):
        return None
    column = round(float(np.ceil(x * 100) if side > 0 else np.floor(x * 100)) / 100, 2)
    chain = [
        (column, round(y0 - 2.0, 2)),
        (column, round(y0 + LIMITS.lean * (y1 - y0), 2)),
    ]
    parts = [p for p in free_parts(chain, others) if p[0][1] <= rows.min() <= p[-1][1]]
    return parts[0] if parts else None


def make_wedge(
    item: PhotoObject,
    free: Callable[[Chain], list[Chain]],
    stands: Callable[[Array], bool],
) -> Chain | None:
    """Return the first wedge beside a round object that fits and stabilises it, or
    None.

    `free` removes the parts of a chain inside other objects; `stands(wall)` returns
    whether a wall helps.
    """
    outline = item.outline
    if not isinstance(outline, Disc):
        return None
    for side in np.radians(LIMITS.wedge_sides):
        way = np.array([np.cos(side), np.sin(side)])
        tangent = np.array([-way[1], way[0]])
        # Rounding must leave a gap rather than an overlap.
        contact = outline.center + (outline.radius + 0.01) * way
        reach = LIMITS.wedge_length * outline.radius * tangent
        for part in free(
            [
                (round(float(x), 2), round(float(y), 2))
                for x, y in (contact - reach, contact + reach)
            ]
        ):
            first, last = (
                (np.array(end) - contact) @ tangent for end in (part[0], part[-1])
            )
            if min(-first, last) >= LIMITS.wedge_rest * outline.radius and stands(
                np.array(part)
            ):
                return part
    return None


def free_parts(chain: Chain, others: Sequence[Outline]) -> list[Chain]:
    """Return the pieces of a chain of points outside outlines, in order."""
    points = np.array(chain, np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    neighbours = []
    for other in others:
        x0, y0, x1, y1 = bounds(other)
        if x0 < high[0] and x1 > low[0] and y0 < high[1] + 0.01 and y1 > low[1] - 0.01:
            neighbours.append(other)
    if not neighbours:
        return [list(chain)]
    runs = np.hypot(*np.diff(points, axis=0).T)
    # Sample the chain at small steps and at all of its corners.
    lengths = np.concatenate([[0.0], np.cumsum(runs)])
    samples = np.unique(
        np.concatenate([lengths, np.arange(0, lengths[-1], LIMITS.step)])
    )
    test_points = np.stack(
        [np.interp(samples, lengths, points[:, axis]) for axis in (0, 1)], axis=1
    )
    free = np.ones(len(samples), bool)
    for other in neighbours:
        free &= depth_inside(other, test_points) <= LIMITS.skin
    parts: list[Chain] = []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]])))
    for start, stop in edges.reshape(-1, 2):
        first, last = samples[start], samples[stop - 1]
        if last - first >= LIMITS.shortest:
            inner_points = [
                p for p, a in zip(chain, lengths, strict=True) if first < a < last
            ]
            parts.append(
                [
                    _point_along(chain, lengths, first),
                    *inner_points,
                    _point_along(chain, lengths, last),
                ]
            )
    return parts


def _point_along(chain: Chain, along: Array, way: float) -> tuple[float, float]:
    """Return the point of a chain at a length along it."""
    if way in (0, along[-1]):
        return chain[0 if way == 0 else -1]
    return rounded_down(
        *(float(np.interp(way, along, [p[axis] for p in chain])) for axis in (0, 1))
    )


def depth_inside(outline: Outline, points: Array) -> Array:
    """Return the depth `(N,)` of points `(N, 2)` inside an outline without its holes,
    px.

    The depth is 0 outside.
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
        # Crossing number test: a ray to the left crosses the border an odd number of
        # times.
        inside = (
            spans & (x < (b[:, 0] - a[:, 0]) * (y - a[:, 1]) / rise + a[:, 0])
        ).sum(1) % 2 > 0
        if inside.any():
            way = b - a
            offsets = points[inside, None] - a[None]
            share = np.clip(
                (offsets * way).sum(-1) / np.maximum((way**2).sum(-1), 1e-12), 0, 1
            )
            gap = np.hypot(
                *np.moveaxis(offsets - share[..., None] * way[None], -1, 0)
            ).min(axis=1)
            depth[inside] = np.maximum(depth[inside], gap)
    return depth
