"""Contacts of shapes: as the engine reports them, and as single points at
closing time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from math import hypot, isnan
from struct import Struct

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

LEAP = 2.0
"""Largest displacement of one contact in a step, px."""
TURN = 0.02
"""Change of a normal in a step beyond which the contact has not just rolled on."""
WORDS = 3
"""Number of integers of one contact."""
NUMBERS = 14
"""Number of floats of one contact."""
CONTACT = Struct(f"{NUMBERS}d")
"""Format of the floats of one contact."""
CONTACT_BYTES = 8 * NUMBERS
"""Bytes of the floats of one contact."""
_POINTS = np.isin(np.arange(NUMBERS), np.arange(4, 13)).astype(np.float64)
impulses_and_normals = Struct(f"=4d{8 * (NUMBERS - 4)}x").iter_unpack
_ON_FIRST = [4, 5, 9, 10]
_ON_SECOND = [6, 7, 11, 12]
_DISTANCE = [8, 13]


_PLACE = [4, 5, 9, 10, 0, 1, 2, 3]
"""Sort keys of the contacts of one pair: points on both bodies, impulse, normal."""

Pair = tuple[int, int]
"""Two bodies; -1 for the world."""


@dataclass(frozen=True)
class Brakes:
    """The brakes of a step by its contacts."""

    pairs: list[Pair]
    array: NDArray[np.int64]  # (B, 2): the pairs as an array
    levers: list[tuple[float, list[int]]]
    """Lever of the normal forces, px, and rows of contacts, of each brake."""


@dataclass(frozen=True)
class Meetings:
    """Who touches whom in a step."""

    contacts: list[list[int]]
    """Both partners and the count of points of each contact, as listed."""
    rows: dict[Pair, list[int]]
    """Partners, the lesser first -> their contacts, as listed."""
    partners: dict[int, set[int]]
    """Of each body or wall."""


class Order:
    """The permutation from pymunk's list of contacts to ours, by bodies and counts of
    points.
    """

    def __init__(self, contacts: Index) -> None:
        """Sort contacts; `contacts` (K, 3): both partners and the count of points of
        each.
        """
        # One integer holds both partners and the count of points, so that a single sort
        # replaces a comparison of rows.
        key = (contacts[:, 0] << 32 | contacts[:, 1]) << 2 | contacts[:, 2]
        self._rows = np.argsort(key, kind="stable")
        sorted_keys = key.take(self._rows)
        self.contacts = contacts
        self.raw = contacts.tobytes()
        self.words = contacts.take(self._rows, axis=0).tobytes()
        # Several pieces or segments of one pair have equal keys: they are sorted by the
        # places of their points in each step, see `sort`.
        self._alike = np.flatnonzero(sorted_keys[1:] == sorted_keys[:-1]) + 1
        self._runs: list[tuple[int, int]] = []
        for k in self._alike.tolist():
            if self._runs and self._runs[-1][1] == k:
                start = self._runs.pop()[0]
            else:
                start = k - 1
            self._runs.append((start, k + 1))
        self.places = np.tile(_POINTS, len(contacts))
        """1 for the numbers of points, else 0, (14 K,)."""
        self.brakes: Brakes | None = None
        """Set by `Resistance`."""
        self._meetings: Meetings | None = None
        self.jointed_rows: list[int] | None = None
        """Set by `Assemblies`."""
        self._mixed = bool((self._rows[1:] < self._rows[:-1]).any())

    @property
    def meetings(self) -> Meetings:
        """Who touches whom."""
        if self._meetings is None:
            rows: dict[Pair, list[int]] = {}
            partners: dict[int, set[int]] = {}
            owners = self.contacts.tolist()
            for row, (first, second, _) in enumerate(owners):
                if first < second:
                    pair = (first, second)
                else:
                    pair = (second, first)
                rows.setdefault(pair, []).append(row)
                partners.setdefault(first, set()).add(second)
                partners.setdefault(second, set()).add(first)
            self._meetings = Meetings(owners, rows, partners)
        return self._meetings

    def pairs_turned(self, numbers: bytes, before: bytes) -> frozenset[Pair]:
        """Return the partners, the lesser first, whose normals have turned since the
        step before.
        """
        present = np.frombuffer(numbers)
        previous = np.frombuffer(before)
        change = (present - previous).reshape(-1, NUMBERS)[:, 2:4]
        has_turned = np.abs(change).max(axis=1, initial=0.0) > TURN
        partners = self.contacts[has_turned, :2].tolist()
        return frozenset((min(pair), max(pair)) for pair in partners)

    def fastest_closing(
        self, rows: Sequence[int], numbers: bytes, moving: Index, state: Array
    ) -> float:
        """Return the fastest closing speed of the points of some contacts, px/s.

        `rows` are those of pymunk's list; `state` (M, 6) of the bodies `moving` (M,).
        """
        # A contact has one normal and up to two points, each with its own speed if a
        # body spins. Bodies without a state do not move.
        states = dict(zip(moving.tolist(), state.tolist(), strict=True))
        contacts = self.meetings.contacts
        fastest_speed = 0.0
        for row in rows:
            first, second, count = contacts[row]
            contact = CONTACT.unpack_from(numbers, CONTACT.size * row)
            normal = contact[2:4]
            for k in range(count):
                point = contact[4 + 5 * k : 6 + 5 * k]
                closing = 0.0
                if first in states:
                    closing += _speed_along(states[first], point, normal)
                if second in states:
                    closing -= _speed_along(states[second], point, normal)
                fastest_speed = max(fastest_speed, closing)
        return fastest_speed

    def sort(self, numbers: bytes) -> bytes:
        """Sort the numbers of one or more steps; contacts of one pair by their
        places.
        """
        # Most lists are sorted already: return them without a copy.
        if not (self._mixed or self._runs):
            return numbers
        steps = (
            np.frombuffer(numbers)
            .reshape(-1, len(self._rows), NUMBERS)
            .take(self._rows, axis=1)
        )
        x = steps[:, :, _PLACE[0]]
        if (
            not self._runs
            or (x.take(self._alike - 1, axis=1) < x.take(self._alike, axis=1)).all()
        ):
            return steps.tobytes()
        for start, end in self._runs:
            same_pair = steps[:, start:end]
            x = same_pair[:, :, _PLACE[0]]
            if (x[:, :-1] < x[:, 1:]).all():
                continue
            permutation = np.lexsort(
                [same_pair[..., column] for column in reversed(_PLACE)], axis=-1
            )
            # For one step, np.take_along_axis takes several times as long.
            step_indices = np.arange(len(steps))[:, None]
            steps[:, start:end] = same_pair[step_indices, permutation]
            # The next steps most likely have the same order.
            self._rows[start:end] = self._rows[start:end][permutation[-1]]
        return steps.tobytes()


NO_CONTACTS = Order(np.zeros((0, WORDS), np.int64))


@dataclass(frozen=True)
class Touching:
    """K pairs of touching shapes; objects count the bodies first, then the walls."""

    first: Index  # (K,)
    second: Index
    count: Index  # (K,): 1 or 2 points
    impulse: Array  # (K, 2) g·px/s on the first in the last step
    normal: Array  # (K, 2): from the first to the second
    on_first: Array
    """Points on the first's surface, (K, 2, 2) px; zeros beyond `count`."""
    on_second: Array
    depth: Array  # (K, 2) px of overlap


def touching(words: bytes, numbers: bytes) -> Touching:
    """Decode the contacts of one or more steps, in their order."""
    ints = np.frombuffer(words, np.int64).reshape(-1, WORDS)
    rows = np.frombuffer(numbers).reshape(-1, NUMBERS)
    return Touching(
        first=ints[:, 0],
        second=ints[:, 1],
        count=ints[:, 2],
        impulse=rows[:, :2],
        normal=rows[:, 2:4],
        on_first=rows[:, _ON_FIRST].reshape(-1, 2, 2),
        on_second=rows[:, _ON_SECOND].reshape(-1, 2, 2),
        depth=-rows[:, _DISTANCE],
    )


@lru_cache(maxsize=512)
def new_contacts(words: bytes, before: bytes) -> Sequence[int]:
    """Return the rows of contacts with partners and a count of points that were not
    there before.
    """
    present = _pairs(words)
    previous = np.sort(_pairs(before))
    positions = previous.searchsorted(present)
    positions[positions == len(previous)] = 0
    new_rows: list[int]
    if len(previous):
        new_rows = np.flatnonzero(previous.take(positions) != present).tolist()
    else:
        new_rows = list(range(len(present)))
    return new_rows


@lru_cache(maxsize=512)
def pairs_with_more_contacts(words: bytes, before: bytes) -> frozenset[Pair]:
    """Return the partners, the lesser first, with more contacts than before."""
    known = Counter(_pairs(before).tolist())
    counts = Counter(_pairs(words).tolist())
    more = [key >> 2 for key, count in counts.items() if count > known[key]]
    return frozenset((key >> 32, key & 0xFFFFFFFF) for key in more)


@lru_cache(maxsize=256)
def _pairs(words: bytes) -> Index:
    """Encode partners and counts of points as sortable integers, (K,)."""
    first, second, count = np.frombuffer(words, np.int64).reshape(-1, WORDS).T
    return np.asarray(
        (np.minimum(first, second) << 32 | np.maximum(first, second)) << 2 | count
    )


def contacts_jumped(numbers: bytes, before: bytes, places: Array) -> bool:
    """Check whether a contact is at another corner than in the step before.

    Both steps have contacts of the same pairs in the same order. `numbers`, `before`:
    their numbers (14 K,); `places` (14 K,): 1 for those of points, else 0.
    """
    displacements = np.frombuffer(numbers) - np.frombuffer(before)
    # The sum of squares is quick, and excludes most steps.
    return bool(
        (displacements * displacements).dot(places) > LEAP * LEAP
        and (np.abs(displacements) * places).max() > LEAP
    )


@dataclass(frozen=True)
class Points:
    """P contact points of the K pairs of shapes that touch at a step's end."""

    row: Index  # (P,): its pair
    first: Index
    second: Index
    normal: Array  # (P, 2): from the first to the second
    on_first: Array  # (P, 2) px
    on_second: Array
    depth: Array
    closing: Array  # (P,) px/s: closing speeds by velocities before contacts

    def sort(self) -> Points:
        """Sort the points by objects, pairs of shapes and place; objects and pairs are
        sorted already.
        """
        x, y = self.on_first.T
        # Only the two points of one contact may be in the wrong order.
        second_rows = np.flatnonzero(self.row[1:] == self.row[:-1]) + 1
        is_swapped = (x[second_rows] < x[second_rows - 1]) | (
            (x[second_rows] == x[second_rows - 1])
            & (y[second_rows] < y[second_rows - 1])
        )
        if not is_swapped.any():
            return self
        order = np.arange(len(x))
        order[second_rows[is_swapped]] -= 1
        order[second_rows[is_swapped] - 1] += 1
        return Points(*(getattr(self, field.name)[order] for field in fields(self)))

    def times_since_closing(
        self, is_own: Flags, touched_pairs: Flags, h: float
    ) -> Array:
        """Return the time (P,) s before the step's end at which each point closed.

        `is_own` (P,): points that close by the motion before all impacts;
        `touched_pairs` (K,): pairs that touched a step ago, which close again only by
        an impact.
        """
        row = self.row
        depth = np.maximum(self.depth, 0.0)
        earlier = np.where(
            is_own & ~touched_pairs[row],
            np.minimum(depth / np.maximum(self.closing, 1e-300), h),
            0.0,
        )
        # Two points of one pair with almost equal times close together, so that a body
        # that lands flat does not start to turn.
        first_rows = np.flatnonzero((row[:-1] == row[1:]) & is_own[:-1] & is_own[1:])
        first_rows = first_rows[
            np.abs(earlier[first_rows] - earlier[first_rows + 1]) < 0.5 * h
        ]
        earlier[first_rows] = earlier[first_rows + 1] = (
            earlier[first_rows] + earlier[first_rows + 1]
        ) / 2
        return earlier


@dataclass(frozen=True)
class ContactProperties:
    """Properties of the N bodies and walls in an impact; all but dynamic bodies have
    infinite mass and moment.
    """

    lightness: list[float]  # 1/g
    ease: list[float]  # 1/(g·px²)
    friction: list[float]  # factors; a pair's coefficient is their product
    elasticity: list[float]
    radius: list[float]  # px; NaN except for circles
    conveyor: list[float]  # px/s of a surface running around the body


@dataclass(slots=True)
class Point:
    """One contact point at its closing time."""

    a: int
    b: int
    nx: float
    ny: float  # from a to b; (-ny, nx) is along the surface
    earlier: float
    is_first: bool  # whether it closed by the motion before all impacts
    ma: float
    mb: float
    ea: float
    eb: float
    na: float
    nb: float  # levers of the normal and of the tangent about both centres
    ta: float
    tb: float
    nn: float
    nt: float
    tt: float  # change of closing and sliding speed by a unit of impulse
    elasticity: float
    friction: float
    belt: float  # px/s at which a's surface runs along b's

    def leaving(self, va: list[float], vb: list[float]) -> float:
        """Return the speed at which b leaves a, px/s, by their velocities; negative if
        it closes.
        """
        return (
            self.nx * (vb[0] - va[0])
            + self.ny * (vb[1] - va[1])
            + self.nb * vb[2]
            - self.na * va[2]
        )

    def motion(self, va: list[float], vb: list[float]) -> tuple[float, float]:
        """Return the speeds at which b leaves a and slides along it, px/s."""
        slides = (
            self.nx * (vb[1] - va[1])
            - self.ny * (vb[0] - va[0])
            + self.tb * vb[2]
            - self.ta * va[2]
            - self.belt
        )
        return self.leaving(va, vb), slides


def contact_points(
    words: bytes, numbers: bytes, pose: Array, velocity: Array
) -> Points:
    """Return the points of a step's contacts; pose and velocity (N, 3) of all
    objects.
    """
    a, b, count = np.frombuffer(words, np.int64).reshape(-1, WORDS).T
    flat_numbers = np.frombuffer(numbers)
    row = np.repeat(np.arange(len(a)), count)
    # A contact has one or two points, which the engine stores in one record. The second
    # point of a record is the row that repeats the contact before it.
    columns = NUMBERS * row + _ON_FIRST[0]
    columns[1:][row[1:] == row[:-1]] += _ON_FIRST[2] - _ON_FIRST[0]
    first = a.take(row)
    second = b.take(row)
    normal = flat_numbers.reshape(-1, NUMBERS)[:, 2:4].take(row, axis=0)
    points_on_first, points_on_second = (
        flat_numbers.take(np.add.outer(columns, [part, part + 1])) for part in (0, 2)
    )
    x1, y1 = _point_velocities(velocity, first, points_on_first, pose)
    x2, y2 = _point_velocities(velocity, second, points_on_second, pose)
    # Closing speed: relative velocity of both surfaces along the normal, px/s.
    closing = (x1 - x2) * normal[:, 0] + (y1 - y2) * normal[:, 1]
    return Points(
        row,
        first,
        second,
        normal,
        points_on_first,
        points_on_second,
        -flat_numbers.take(columns + 4),
        closing,
    )


def _speed_along(
    state: Sequence[float], point: Sequence[float], normal: Sequence[float]
) -> float:
    """Return the speed of a body's point along a normal, px/s."""
    x, y, _, vx, vy, spin = state
    # The velocity of a body's point is v + spin * (-dy, dx).
    along_x = (vx - spin * (point[1] - y)) * normal[0]
    along_y = (vy + spin * (point[0] - x)) * normal[1]
    return along_x + along_y


def _point_velocities(
    velocity: Array, objects: Index, points: Array, pose: Array
) -> tuple[Array, Array]:
    """Return the velocities (P,), (P,) px/s of points (P, 2) on bodies."""
    vx, vy, spin = velocity.take(objects, axis=0).T
    x, y, _ = pose.take(objects, axis=0).T
    return vx - spin * (points[:, 1] - y), vy + spin * (points[:, 0] - x)


def _move_back(
    pose: Array, velocity: Array, point: Array, seconds: float
) -> tuple[float, float, float, float]:
    """Return the centre of a body, and the place of a point fixed to it, some seconds
    earlier: x, y, x, y px.
    """
    x, y, _ = pose.tolist()
    vx, vy, spin = velocity.tolist()
    px, py = point.tolist()
    return (
        x - seconds * vx,
        y - seconds * vy,
        px - seconds * (vx - spin * (py - y)),
        py - seconds * (vy + spin * (px - x)),
    )


def _normal_and_point(
    first_center: tuple[float, float],
    second_center: tuple[float, float],
    radii: tuple[float, float],
    normal: tuple[float, float],
    point: tuple[float, float],
) -> tuple[float, float, float, float]:
    """Return the normal and the place of a contact: x, y, x, y px.

    A circle turns without moving its contact point: the point follows from the centre
    and the normal. A radius is NaN if a body is not a circle.
    """
    ax, ay = first_center
    bx, by = second_center
    ra, rb = radii
    nx, ny = normal
    # Only circles determine the point: a polygon keeps the engine's normal.
    if isnan(ra):
        if isnan(rb):
            return nx, ny, *point
        return nx, ny, bx - rb * nx, by - rb * ny
    if isnan(rb):
        return nx, ny, ax + ra * nx, ay + ra * ny
    # Two circles touch on the line of their centres, at the share of their radii.
    distance = max(hypot(bx - ax, by - ay), 1e-12)
    return (
        (bx - ax) / distance,
        (by - ay) / distance,
        ax + (bx - ax) * ra / (ra + rb),
        ay + (by - ay) * ra / (ra + rb),
    )


def _levers(x: float, y: float, nx: float, ny: float) -> tuple[float, float]:
    """Return the levers of the normal and of the tangential impulse at (x, y), px,
    about the centre of a body.
    """
    return x * ny - y * nx, x * nx + y * ny


def point_at_closing(
    objects: ContactProperties,
    points: Points,
    k: int,
    pose: Array,
    velocity: Array,
    earlier: Array,
    is_own: Flags,
) -> Point:
    """Return point `k` as it was `earlier` s (P,) before the poses (N, 3).

    `velocity` (N, 3) within the step; `is_own` (P,) as in
    `Points.times_since_closing`. The levers of both bodies lead to one common point, so
    that angular momentum is conserved to the last digit.
    """
    # Move both bodies back to the instant at which they met: at the end of the step
    # they overlap, and normal and levers would be those of the overlap.
    seconds_back = float(earlier[k])
    a = int(points.first[k])
    b = int(points.second[k])
    ax, ay, first_x, first_y = _move_back(
        pose[a], velocity[a], points.on_first[k], seconds_back
    )
    bx, by, second_x, second_y = _move_back(
        pose[b], velocity[b], points.on_second[k], seconds_back
    )
    nx, ny, px, py = _normal_and_point(
        (ax, ay),
        (bx, by),
        (objects.radius[a], objects.radius[b]),
        points.normal[k].tolist(),
        ((first_x + second_x) / 2, (first_y + second_y) / 2),
    )
    ma = objects.lightness[a]
    ea = objects.ease[a]
    mb = objects.lightness[b]
    eb = objects.ease[b]
    # The levers and the inverse inertias give the change of both speeds by an impulse:
    # normal on normal, normal on tangent, and tangent on tangent.
    na, ta = _levers(px - ax, py - ay, nx, ny)
    nb, tb = _levers(px - bx, py - by, nx, ny)
    return Point(
        a, b, nx, ny, seconds_back, bool(is_own[k]), ma, mb, ea, eb, na, nb, ta, tb,
        ma + mb + ea * na * na + eb * nb * nb,
        ea * na * ta + eb * nb * tb,
        ma + mb + ea * ta * ta + eb * tb * tb,
        objects.elasticity[a] * objects.elasticity[b],
        objects.friction[a] * objects.friction[b],
        objects.conveyor[a] + objects.conveyor[b],
    )  # fmt: skip
