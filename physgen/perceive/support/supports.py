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
from physgen.perceive.support.floor_chains import Chain, cradle, rounded_down
from physgen.perceive.support.ground_contact import lower_hull

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
    slenderness: float = 0.75
    # Objects above which all unstable ones get their ledges at once.
    many_objects: int = 40
    # Rounds of that, after which the remaining ones are held.
    rounds: int = 5
    # Sine of the angle by which a surface under an object faces up.
    least_rise: float = 0.3
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
    search = _SupportSearch(objects, walls, grip, (friction, elasticity))
    search.add_needed_supports()
    search.remove_idle_supports()
    return search.walls, frozenset(search.held_ids)


class _SupportSearch:
    """Walls and held objects while supports are added one after the other."""

    def __init__(
        self,
        objects: Sequence[PhotoObject],
        walls: Sequence[Wall],
        grip: dict[int, float],
        surface: tuple[float, float],
    ) -> None:
        """Find the contacts of the objects; `surface`: friction and elasticity of new
        walls.
        """
        self._objects = objects
        self._grip = grip
        self._surface = surface
        self._outlines = [item.outline for item in objects]
        boxes = list(map(bounds, self._outlines))
        self._boxes = np.array(boxes).reshape(-1, 4)
        self._fixed_indices = {k for k, item in enumerate(objects) if item.cut}
        self._object_contacts = contacts(self._outlines, [])
        self.walls: list[Wall] = []
        self._wall_contacts: list[list[Contact]] = []
        """Contacts of each wall."""
        for wall in walls:
            self._add_wall(wall)
        self.held_ids: set[int] = set()
        self._known_groups: dict[tuple[object, ...], list[int]] = {}
        """Unstable objects of groups with the same contacts."""
        self._attempts: dict[int, int] = {}
        """Number of supports that were tried, by index of the object."""
        self._is_crowd = len(objects) > LIMITS.many_objects

    def add_needed_supports(self) -> None:
        """Add one support per unstable object and round, until all objects are at
        rest.
        """
        round_count = 4 * len(self._objects) + 1
        if self._is_crowd:
            round_count = LIMITS.rounds
        for round_number in range(round_count):
            touches, unstable = self._find_unstable(self._wall_contacts)
            if not unstable:
                break
            is_last = self._is_crowd and round_number == LIMITS.rounds - 1
            # In a crowded photo all unstable objects get supports at once: an object on
            # another's ledge then has a ledge of its own.
            if self._is_crowd:
                supported = unstable
            else:
                supported = unstable[:1]
            for k in supported:
                wall = self._find_support(k, touches, len(unstable))
                if wall is None or is_last:
                    # No support fits: hold the object itself.
                    self.held_ids.add(self._objects[k].id)
                    self._fixed_indices.add(k)
                else:
                    self._add_wall(wall)

    def remove_idle_supports(self) -> None:
        """Remove supports that later supports made unnecessary."""
        for k in reversed(range(len(self.walls))):
            wall = self.walls[k]
            if wall.source != SOURCE or wall.name == "floor":
                continue
            other_contacts = self._wall_contacts[:k] + self._wall_contacts[k + 1 :]
            touches, unstable = self._find_unstable(other_contacts)
            bodies = [contact.body for contact in self._wall_contacts[k]]
            if not unstable and all(_lies_on(touches, body) for body in bodies):
                del self.walls[k], self._wall_contacts[k]

    def _add_wall(self, wall: Wall) -> None:
        """Add a wall with its contacts."""
        touches: list[Contact] = []
        # The photo's bottom supports no object of the photo.
        if wall.name != "bottom":
            points = np.array(wall.points)
            touches = wall_contacts(self._outlines, self._boxes, points)
        self.walls.append(wall)
        self._wall_contacts.append(touches)

    def _find_unstable(
        self, contacts_of_walls: Sequence[Sequence[Contact]]
    ) -> tuple[list[Contact], list[int]]:
        """Return all contacts, and the indices of the unstable objects."""
        touches = list(self._object_contacts)
        for wall_touches in contacts_of_walls:
            touches += wall_touches
        friction = _friction(self._objects, touches, self._grip)
        unstable = unstable_objects(
            self._outlines,
            touches,
            friction,
            self._fixed_indices,
            cache=self._known_groups,
        )
        return touches, unstable

    def _stabilises(
        self, touches: Sequence[Contact], unstable_count: int, chain: Array
    ) -> bool:
        """Check whether a chain leaves fewer than `unstable_count` unstable objects."""
        all_touches = list(touches)
        all_touches += wall_contacts(self._outlines, self._boxes, chain)
        friction = _friction(self._objects, all_touches, self._grip)
        unstable = unstable_objects(
            self._outlines, all_touches, friction, self._fixed_indices
        )
        return len(unstable) < unstable_count

    def _find_support(
        self, k: int, touches: Sequence[Contact], unstable_count: int
    ) -> Wall | None:
        """Return the next support of an unstable object: a wall to lean on, a wedge or a
        ledge.
        """
        item = self._objects[k]
        attempt = self._attempts.get(k, 0) + 1
        self._attempts[k] = attempt
        others = []
        for i, outline in enumerate(self._outlines):
            if i != k:
                others.append(outline)
        if attempt == 1:
            upright = _wall_to_lean_on(item, touches, k, others)
            if upright:
                return self._wall("wall", upright, 0.4, "holds what leans")
        # An object that rolls off a visible support needs a wedge, not a ledge.
        is_rolling = attempt == 3 or (attempt == 1 and _lies_on(touches, k))
        if is_rolling and not self._is_crowd:
            wedge = make_wedge(
                item,
                partial(free_parts, others=others),
                partial(self._stabilises, touches, unstable_count),
            )
            if wedge:
                return self._wall("stop", wedge, 0.3, "else it rolls away")
        if attempt > 2:
            return None
        self._attempts[k] = 2
        ledge = _nest(item, others)
        if not ledge:
            return None
        return self._wall("nest", ledge, 0.3, "else it falls")

    def _wall(self, kind: str, chain: Chain, confidence: float, reason: str) -> Wall:
        """Return an invisible wall with the next free number of its kind."""
        number = 1 + sum(wall.name.startswith(kind) for wall in self.walls)
        points = tuple(chain)
        name = f"{kind}-{number}"
        return Wall(name, points, *self._surface, confidence, SOURCE, reason)


def _lies_on(touches: Sequence[Contact], k: int) -> bool:
    """Return whether a contact supports an object from below."""
    return any(
        c.normal[1] * (1 if c.body == k else -1) < -LIMITS.least_rise
        for c in touches
        if k in (c.body, c.other)
    )


def _friction(
    objects: Sequence[PhotoObject], touches: Sequence[Contact], grip: dict[int, float]
) -> dict[tuple[int, int], float]:
    """Return the friction by pair of objects."""
    result = {}
    for c in touches:
        if c.other < 0:
            assumption = LIMITS.wall_friction
        else:
            assumption = LIMITS.object_friction
        grips = []
        for k in (c.body, c.other):
            if k >= 0:
                grips.append(grip.get(objects[k].id, 0.0))
        result[c.body, c.other] = max(assumption, min(grips))
    return result


def _nest(item: PhotoObject, others: Sequence[Outline]) -> Chain | None:
    """Return a short ledge along the underside of an object, between the others, or
    None.
    """
    center = mass_properties(item.outline).center
    chain = cradle(item, center, lower_hull(item.outline))
    parts = []
    for p in free_parts(chain, others):
        if p[0][0] <= center[0] <= p[-1][0]:
            parts.append(p)
    if parts:
        return parts[0]
    return None


def _wall_to_lean_on(
    item: PhotoObject, touches: Sequence[Contact], k: int, others: Sequence[Outline]
) -> Chain | None:
    """Return a short upright wall beside the top of an object, or None.

    The object stands on a wall and would tip over its edge.
    """
    if isinstance(item.outline, Disc):
        return None
    side = _find_tipping_side(item, touches, k)
    x0, y0, x1, y1 = bounds(item.outline)
    if side == 0 or y1 - y0 < LIMITS.slenderness * (x1 - x0):
        return None
    points = np.concatenate([ring.outer for ring in item.outline.rings])
    if side > 0:
        x = x1
    else:
        x = x0
    rows = points[np.abs(points[:, 0] - x) < 0.5][:, 1]
    if rows.min() > y0 + LIMITS.lean * (y1 - y0):
        return None
    # The wall is rounded away from the object.
    if side > 0:
        hundredths = np.ceil(x * 100)
    else:
        hundredths = np.floor(x * 100)
    column = round(float(hundredths) / 100, 2)
    chain = [
        (column, round(y0 - 2.0, 2)),
        (column, round(y0 + LIMITS.lean * (y1 - y0), 2)),
    ]
    parts = []
    for p in free_parts(chain, others):
        if p[0][1] <= rows.min() <= p[-1][1]:
            parts.append(p)
    if parts:
        return parts[0]
    return None


def _find_tipping_side(item: PhotoObject, touches: Sequence[Contact], k: int) -> int:
    """Return the side, -1 or 1, to which an object on a wall tips, or 0."""
    feet = []
    for c in touches:
        if c.body == k and c.other < 0 and c.normal[1] < -0.7:
            feet.append(float(c.point[0]))
    if not feet:
        return 0
    center = mass_properties(item.outline).center
    if center[0] > max(feet):
        return 1
    if center[0] < min(feet):
        return -1
    return 0


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
            first = (np.array(part[0]) - contact) @ tangent
            last = (np.array(part[-1]) - contact) @ tangent
            if min(-first, last) >= LIMITS.wedge_rest * outline.radius and stands(
                np.array(part)
            ):
                return part
    return None


def free_parts(chain: Chain, others: Sequence[Outline]) -> list[Chain]:
    """Return the pieces of a chain of points outside outlines, in order."""
    points = np.array(chain, np.float64)
    neighbours = _find_neighbours(points, others)
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
        first = samples[start]
        last = samples[stop - 1]
        if last - first >= LIMITS.shortest:
            parts.append(_cut_chain(chain, lengths, first, last))
    return parts


def _find_neighbours(points: Array, outlines: Sequence[Outline]) -> list[Outline]:
    """Return the outlines whose boxes overlap that of points (N, 2)."""
    low = points.min(axis=0)
    high = points.max(axis=0)
    neighbours = []
    for outline in outlines:
        x0, y0, x1, y1 = bounds(outline)
        if x0 < high[0] and x1 > low[0] and y0 < high[1] + 0.01 and y1 > low[1] - 0.01:
            neighbours.append(outline)
    return neighbours


def _cut_chain(chain: Chain, lengths: Array, first: float, last: float) -> Chain:
    """Return the piece of a chain between two lengths along it.

    `lengths` (K,) are those of its points.
    """
    inner_points = []
    for p, a in zip(chain, lengths, strict=True):
        if first < a < last:
            inner_points.append(p)
    return [
        _point_along(chain, lengths, first),
        *inner_points,
        _point_along(chain, lengths, last),
    ]


def _point_along(chain: Chain, lengths: Array, way: float) -> tuple[float, float]:
    """Return the point of a chain at a length along it."""
    if way in (0, lengths[-1]):
        return chain[0 if way == 0 else -1]
    return rounded_down(
        *(float(np.interp(way, lengths, [p[axis] for p in chain])) for axis in (0, 1))
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
    x = points[:, 0, None]
    y = points[:, 1, None]
    for ring in outline.rings:
        a = ring.outer
        b = np.roll(ring.outer, -1, axis=0)
        ax, ay = a.T
        bx, by = b.T
        spans = (ay > y) != (by > y)
        rise = np.where(by == ay, 1.0, by - ay)
        crossing_x = (bx - ax) * (y - ay) / rise + ax
        # Crossing number test: a ray to the left crosses the border an odd number of
        # times.
        inside = (spans & (x < crossing_x)).sum(1) % 2 > 0
        if inside.any():
            gap = _border_distances(points[inside], a, b)
            depth[inside] = np.maximum(depth[inside], gap)
    return depth


def _border_distances(points: Array, starts: Array, ends: Array) -> Array:
    """Return the distance (n,) px of points from the nearest edge of a ring."""
    edges = ends - starts
    offsets = points[:, None] - starts[None]
    squared_lengths = np.maximum((edges**2).sum(-1), 1e-12)
    share = np.clip((offsets * edges).sum(-1) / squared_lengths, 0, 1)
    gaps = offsets - share[..., None] * edges[None]
    distances = np.hypot(*np.moveaxis(gaps, -1, 0))
    return np.asarray(distances.min(axis=1))
