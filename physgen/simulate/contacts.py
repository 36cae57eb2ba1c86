"""Contacts of shapes: as the engine reports them, and as single points with their levers at the time of closing."""

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
"""px in a step by which no contact creeps."""
TURN = 0.02
"""Change of a normal in a step by which no contact rolls on."""
WORDS, NUMBERS = 3, 14
"""Integers and floats of one contact."""
CONTACT = Struct(f"{NUMBERS}d")
"""Numbers of a contact."""
CONTACT_BYTES = 8 * NUMBERS
"""Of the floats."""
_POINTS = np.isin(np.arange(NUMBERS), np.arange(4, 13)).astype(np.float64)
impulses_and_normals = Struct(f"=4d{8 * (NUMBERS - 4)}x").iter_unpack
_ON_FIRST, _ON_SECOND, _DISTANCE = ([4, 5, 9, 10], [6, 7, 11, 12], [8, 13])


_PLACE = [4, 5, 9, 10, 0, 1, 2, 3]
"""Numbers of a contact by which those of one pair are sorted: points on both bodies, impulse, normal."""

Pair = tuple[int, int]
"""Two bodies; -1 for the world."""


@dataclass(frozen=True)
class Brakes:
    """What brakes in a step, by its contacts."""

    pairs: list[Pair]
    array: NDArray[np.int64]  # (B, 2): the same
    by: list[
        tuple[float, list[int]]
    ]  # px and contacts, as listed, of each: the lever of the normal forces


@dataclass(frozen=True)
class Meetings:
    """Who touches whom in a step."""

    listed: list[list[int]]
    """Both partners and the count of points of each contact, as listed."""
    rows: dict[Pair, list[int]]
    """Partners, the lesser first -> their contacts, as listed."""
    partners: dict[int, set[int]]
    """Of each body or wall."""


class Order:
    """The order, by our numbers of bodies and counts of points, of contacts that pymunk lists in one way."""

    def __init__(self, listed: Index) -> None:
        """listed (K, 3): both partners and the count of points of each contact."""
        key = (listed[:, 0] << 32 | listed[:, 1]) << 2 | listed[:, 2]
        self._rows = np.argsort(key, kind="stable")
        ranked = key.take(self._rows)
        self.listed, self.raw = listed, listed.tobytes()
        self.words = listed.take(self._rows, axis=0).tobytes()
        # several pieces or segments, of which some touch at one and the same corner
        self._alike = np.flatnonzero(ranked[1:] == ranked[:-1]) + 1
        self._runs: list[tuple[int, int]] = []
        for k in self._alike.tolist():
            start = (
                self._runs.pop()[0] if self._runs and self._runs[-1][1] == k else k - 1
            )
            self._runs.append((start, k + 1))
        self.places = np.tile(_POINTS, len(listed))
        """(14 K,): 1 for numbers of points, else 0."""
        self.brakes: Brakes | None = None
        """Once `Resistance` has looked."""
        self._meetings: Meetings | None = None
        self.rows_held: list[int] | None = None
        """Once `Assemblies` has looked."""
        self._mixed = bool((self._rows[1:] < self._rows[:-1]).any())

    @property
    def meetings(self) -> Meetings:
        """Who touches whom."""
        if self._meetings is None:
            rows: dict[Pair, list[int]] = {}
            partners: dict[int, set[int]] = {}
            owners = self.listed.tolist()
            for row, (first, second, _) in enumerate(owners):
                pair = (first, second) if first < second else (second, first)
                rows.setdefault(pair, []).append(row)
                partners.setdefault(first, set()).add(second)
                partners.setdefault(second, set()).add(first)
            self._meetings = Meetings(owners, rows, partners)
        return self._meetings

    def pairs_turned(self, numbers: bytes, before: bytes) -> frozenset[Pair]:
        """Return partners, the lesser first, whose normals differ from those before; all as listed."""
        now, then = np.frombuffer(numbers), np.frombuffer(before)
        change = (now - then).reshape(-1, NUMBERS)[:, 2:4]
        turned = np.abs(change).max(axis=1, initial=0.0) > TURN
        partners = self.listed[turned, :2].tolist()
        return frozenset((min(pair), max(pair)) for pair in partners)

    def fastest_closing(
        self, rows: Sequence[int], numbers: bytes, moving: Index, state: Array
    ) -> float:
        """Return the px/s at which the fastest point of some contacts closes, as they are listed.

        state (M, 6) of the bodies `moving` (M,).
        """
        rows_of = {body: row for row, body in enumerate(moving.tolist())}
        states, listed = state.tolist(), self.meetings.listed
        fastest = 0.0
        for row in rows:
            first, second, count = listed[row]
            contact = CONTACT.unpack_from(numbers, CONTACT.size * row)
            for k in range(count):
                px, py = contact[4 + 5 * k], contact[5 + 5 * k]
                closing = 0.0
                for owner, sign in ((first, 1.0), (second, -1.0)):
                    if owner in rows_of:
                        x, y, _, vx, vy, spin = states[rows_of[owner]]
                        along = (vx - spin * (py - y)) * contact[2]
                        across = (vy + spin * (px - x)) * contact[3]
                        closing += sign * (along + across)
                fastest = max(fastest, closing)
        return fastest

    def sort(self, numbers: bytes) -> bytes:
        """The numbers of one or more steps, in order; contacts of the same pairs by their places."""
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
            alike = steps[:, start:end]
            x = alike[:, :, _PLACE[0]]
            if (x[:, :-1] < x[:, 1:]).all():
                continue
            by = np.lexsort([alike[..., at] for at in reversed(_PLACE)], axis=-1)
            # np.take_along_axis takes several times as long for one step
            step = np.arange(len(steps))[:, None]
            steps[:, start:end] = alike[step, by]
            # the next steps' order most likely
            self._rows[start:end] = self._rows[start:end][by[-1]]
        return steps.tobytes()


NO_CONTACTS = Order(np.zeros((0, WORDS), np.int64))


@dataclass(frozen=True)
class Touching:
    """K pairs of shapes that touch; objects count the bodies first, then the walls."""

    first: Index  # (K,)
    second: Index
    count: Index  # (K,): 1 or 2 points
    impulse: Array  # (K, 2) g·px/s that the second gave the first in the last step
    normal: Array  # (K, 2): from the first to the second
    on_first: Array  # (K, 2, 2) px: the points, on the first's surface; those beyond `count` are zeros
    on_second: Array
    depth: Array  # (K, 2) px of overlap


def touching(words: bytes, numbers: bytes) -> Touching:
    """Contacts of one or more steps, in their order."""
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
    """Rows of contacts whose partners, in whichever order, and count of points are not among those before."""
    now, then = _pairs(words), np.sort(_pairs(before))
    at = then.searchsorted(now)
    at[at == len(then)] = 0
    found: list[int] = (
        np.flatnonzero(then.take(at) != now).tolist()
        if len(then)
        else list(range(len(now)))
    )
    return found


@lru_cache(maxsize=512)
def pairs_with_more_contacts(words: bytes, before: bytes) -> frozenset[Pair]:
    """Return partners, the lesser first, of contacts that are not among those before, each counted once."""
    known = Counter(_pairs(before).tolist())
    counts = Counter(_pairs(words).tolist())
    more = [key >> 2 for key, count in counts.items() if count > known[key]]
    return frozenset((key >> 32, key & 0xFFFFFFFF) for key in more)


@lru_cache(maxsize=256)
def _pairs(words: bytes) -> Index:
    first, second, count = np.frombuffer(words, np.int64).reshape(-1, WORDS).T
    return np.asarray(
        (np.minimum(first, second) << 32 | np.maximum(first, second)) << 2 | count
    )


def contacts_jumped(now: bytes, before: bytes, places: Array) -> bool:
    """Whether contacts of the same pairs, in the same order, are elsewhere at once: another corner has come down.

    now, before: their numbers (14 K,); places (14 K,): 1 for those of points, else 0.
    """
    off = np.frombuffer(now) - np.frombuffer(before)
    # what moved less all together needs no closer look
    return bool(
        (off * off).dot(places) > LEAP * LEAP and (np.abs(off) * places).max() > LEAP
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
    closing: Array  # (P,) px/s at which they close, by velocities before contacts

    def sorted(self) -> Points:
        """By objects, pairs of shapes and place: the first two sorted already."""
        x, y = self.on_first.T
        # contacts come sorted but for the two points of one
        second = np.flatnonzero(self.row[1:] == self.row[:-1]) + 1
        ahead = (x[second] < x[second - 1]) | (
            (x[second] == x[second - 1]) & (y[second] < y[second - 1])
        )
        if not ahead.any():
            return self
        order = np.arange(len(x))
        order[second[ahead]] -= 1
        order[second[ahead] - 1] += 1
        return Points(*(getattr(self, field.name)[order] for field in fields(self)))

    def earlier(self, own: Flags, touched: Flags, h: float) -> Array:
        """(P,) s before the step's end at which each closed; `own` (P,) do, `touched` (K,) pairs did a step ago.

        What touched before closes when an impact makes it.
        """
        row = self.row
        depth = np.maximum(self.depth, 0.0)
        earlier = np.where(
            own & ~touched[row],
            np.minimum(depth / np.maximum(self.closing, 1e-300), h),
            0.0,
        )
        # two points of one pair close together: what lands flat stays flat
        pair = np.flatnonzero((row[:-1] == row[1:]) & own[:-1] & own[1:])
        pair = pair[np.abs(earlier[pair] - earlier[pair + 1]) < 0.5 * h]
        earlier[pair] = earlier[pair + 1] = (earlier[pair] + earlier[pair + 1]) / 2
        return earlier


@dataclass(frozen=True)
class ContactProperties:
    """What the N bodies and walls bring to an impact; the mass and moment of whatever is not dynamic is infinite."""

    lightness: list[float]  # 1/g
    ease: list[float]  # 1/(g·px²)
    friction: list[float]  # factors; a pair's coefficient is their product
    elasticity: list[float]
    radius: list[float]  # px; NaN where it is not a circle
    conveyor: list[float]  # px/s at which surfaces run around them


@dataclass(slots=True)
class Point:
    """One contact point, when it closed."""

    a: int
    b: int
    nx: float
    ny: float  # from a to b; (-ny, nx) is along the surface
    earlier: float
    own: bool  # whether it closed by the motion before all impacts
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
        """px/s at which b leaves a, by their velocities; negative: it closes."""
        return (
            self.nx * (vb[0] - va[0])
            + self.ny * (vb[1] - va[1])
            + self.nb * vb[2]
            - self.na * va[2]
        )

    def motion(self, va: list[float], vb: list[float]) -> tuple[float, float]:
        """px/s at which b leaves a, and slides along it."""
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
    """One row a point of a step's contacts; pose and velocity (N, 3) of all objects."""
    a, b, count = np.frombuffer(words, np.int64).reshape(-1, WORDS).T
    flat, row = np.frombuffer(numbers), np.repeat(np.arange(len(a)), count)
    place = NUMBERS * row + _ON_FIRST[0]
    place[1:][row[1:] == row[:-1]] += _ON_FIRST[2] - _ON_FIRST[0]
    first, second, normal = (
        a.take(row),
        b.take(row),
        flat.reshape(-1, NUMBERS)[:, 2:4].take(row, axis=0),
    )
    on1, on2 = (flat.take(np.add.outer(place, [part, part + 1])) for part in (0, 2))
    x1, y1 = _at(velocity, first, on1, pose)
    x2, y2 = _at(velocity, second, on2, pose)
    closing = (x1 - x2) * normal[:, 0] + (y1 - y2) * normal[:, 1]
    return Points(row, first, second, normal, on1, on2, -flat.take(place + 4), closing)


def _at(
    velocity: Array, objects: Index, points: Array, pose: Array
) -> tuple[Array, Array]:
    """(P,) and (P,) px/s of points (P, 2) on bodies."""
    vx, vy, spin = velocity.take(objects, axis=0).T
    x, y, _ = pose.take(objects, axis=0).T
    return vx - spin * (points[:, 1] - y), vy + spin * (points[:, 0] - x)


def point_at_closing(
    objects: ContactProperties,
    found: Points,
    k: int,
    pose: Array,
    velocity: Array,
    earlier: Array,
    own: Flags,
) -> Point:
    """Point `k` as it was `earlier` s (P,) before the poses (N, 3); velocity (N, 3) on the way; own (P,).

    Levers go from both centres to one common point: angular momentum is kept to the last digit.
    """
    back = float(earlier[k])
    a, b = int(found.first[k]), int(found.second[k])
    nx, ny = found.normal[k].tolist()
    places, centers = [], []
    for body, on in ((a, found.on_first), (b, found.on_second)):
        x, y, _ = pose[body].tolist()
        vx, vy, spin = velocity[body].tolist()
        px, py = on[k].tolist()
        centers.append((x - back * vx, y - back * vy))
        places.append(
            (px - back * (vx - spin * (py - y)), py - back * (vy + spin * (px - x)))
        )
    (ax, ay), (bx, by) = centers
    px, py = (places[0][0] + places[1][0]) / 2, (places[0][1] + places[1][1]) / 2
    # a circle touches where its normal leaves it, however it turns
    ra, rb = objects.radius[a], objects.radius[b]
    if not (isnan(ra) or isnan(rb)):
        distance = max(hypot(bx - ax, by - ay), 1e-12)
        nx, ny = (bx - ax) / distance, (by - ay) / distance
        px, py = ax + (bx - ax) * ra / (ra + rb), ay + (by - ay) * ra / (ra + rb)
    elif not isnan(ra):
        px, py = ax + ra * nx, ay + ra * ny
    elif not isnan(rb):
        px, py = bx - rb * nx, by - rb * ny
    ma, mb, ea, eb = (
        objects.lightness[a],
        objects.lightness[b],
        objects.ease[a],
        objects.ease[b],
    )
    na, nb = (px - ax) * ny - (py - ay) * nx, (px - bx) * ny - (py - by) * nx
    ta, tb = (px - ax) * nx + (py - ay) * ny, (px - bx) * nx + (py - by) * ny
    return Point(
        a, b, nx, ny, back, bool(own[k]), ma, mb, ea, eb, na, nb, ta, tb,
        ma + mb + ea * na * na + eb * nb * nb,
        ea * na * ta + eb * nb * tb,
        ma + mb + ea * ta * ta + eb * tb * tb,
        objects.elasticity[a] * objects.elasticity[b],
        objects.friction[a] * objects.friction[b],
        objects.conveyor[a] + objects.conveyor[b],
    )  # fmt: skip
