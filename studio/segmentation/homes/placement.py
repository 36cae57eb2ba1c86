"""Things onto supports: a support and a generator in, placed things out that stand, lean or lie without overlap.

Footprints are convex polygons seen from above; two are apart when a line parts them (separating axis theorem). What
stacks, leans or stands in a vessel is placed by its own rule and takes the footprint of the whole group.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studio.segmentation.homes import roster
from studio.segmentation.homes.parts import Part, Thing, extent, rectangle
from studio.segmentation.homes.prints import Rng
from studio.segmentation.homes.solids import turn

GAP = 0.0015  # m that neighbours keep
FRONTAL = {"clock", "robot", "bear", "carton", "gadget"}
LIES = {"bottle", "can", "jar", "candle", "totem"}


@dataclass(frozen=True)
class Support:
    """A horizontal rectangle that things may stand on."""

    at: tuple[float, float, float]
    """m: its middle."""
    size: tuple[float, float]
    """m along x and y."""
    clear: float = 2.0
    """m of free height above it."""
    wall: bool = False
    """A wall or a back stands along its far edge."""


@dataclass(frozen=True)
class Placed:
    """One object where it stands."""

    kind: str
    parts: list[Part]
    """In world axes."""
    foot: np.ndarray
    """(K, 2) m, world; convex."""
    base: float
    """m: height of what it stands on."""
    height: float
    held: bool = False
    """It leans on, lies on or stands in another one: its footprint is the other's affair."""


def apart(a: np.ndarray, b: np.ndarray, gap: float = GAP) -> bool:
    """Whether two convex polygons (K, 2), (L, 2) keep at least `gap` m along some edge's normal."""
    for polygon in (a, b):
        edges = np.roll(polygon, -1, 0) - polygon
        normals = (
            np.stack([edges[:, 1], -edges[:, 0]], 1)
            / np.maximum(np.hypot(*edges.T), 1e-12)[:, None]
        )
        ranges = (
            [(p @ normals.T).min(0) for p in (a, b)],
            [(p @ normals.T).max(0) for p in (a, b)],
        )
        if np.any(ranges[0][1] - ranges[1][0] >= gap) or np.any(
            ranges[0][0] - ranges[1][1] >= gap
        ):
            return True
    return False


class Arrangement:
    """What stands on one support so far."""

    def __init__(self, support: Support, rng: Rng) -> None:
        self.support, self.rng = support, rng
        self.makers = roster.makers()
        self.placed: list[Placed] = []
        self.taken: list[np.ndarray] = []

    def make(self, kinds: list[str]) -> Thing:
        return self.makers[str(self.rng.choice(kinds))](self.rng)

    def fits(self, foot: np.ndarray, height: float, overhang: float = 0.0) -> bool:
        """Inside the support and apart from all others."""
        inside = (
            np.abs(foot - self.support.at[:2])
            <= np.array(self.support.size) / 2 + overhang
        )
        return (
            bool(inside.all())
            and height < self.support.clear
            and all(apart(foot, t) for t in self.taken)
        )

    def spot(
        self, foot: np.ndarray, height: float, close: float = 0.6
    ) -> np.ndarray | None:
        """(2,) m, world, where a footprint is free; with the chance `close` it slides up to a neighbour."""
        size, middle = np.array(self.support.size), np.array(self.support.at[:2])
        for _ in range(14):
            at = middle + self.rng.uniform(-0.5, 0.5, 2) * size
            if not self.fits(foot + at, height):
                continue
            if self.taken and self.rng.random() < close:
                goal = self.taken[self.rng.integers(len(self.taken))].mean(0)
                for share in np.linspace(
                    0.95, 0.1, 12
                ):  # as near as it fits on the way there
                    near = goal + (at - goal) * (1 - share)
                    if self.fits(foot + near, height):
                        return near
            return at
        return None

    def put(
        self,
        thing: Thing,
        at: np.ndarray,
        spin: float,
        base: float | None = None,
        held: bool = False,
    ) -> Placed:
        z = self.support.at[2] if base is None else base
        matrix = turn("z", spin)
        placed = Placed(
            thing.kind,
            thing.moved([*at, z], matrix),
            thing.foot @ matrix[:2, :2].T + at,
            z,
            thing.height,
            held,
        )
        self.placed.append(placed)
        return placed

    def stand(self, kinds: list[str]) -> bool:
        """One thing upright (or, of what rolls, lying); maybe others on or in it."""
        thing = self.make(kinds)
        if thing.kind in LIES and self.rng.random() < 0.12:
            thing = laid(thing)
        spin = (
            self.rng.uniform(-35, 35)
            if thing.faces or thing.kind in FRONTAL
            else self.rng.uniform(0, 360)
        )
        foot = thing.foot @ turn("z", spin)[:2, :2].T
        at = self.spot(foot, thing.height)
        if at is None:
            return False
        below = self.put(thing, at, spin)
        self.taken.append(below.foot)
        if thing.well is not None and self.rng.random() < 0.35:
            self.fill(thing, at, below)
        elif thing.top is not None and self.rng.random() < 0.35:
            self.pile(thing, at, below, kinds)
        return True

    def pile(
        self, thing: Thing, at: np.ndarray, below: Placed, kinds: list[str]
    ) -> None:
        """Smaller things upon its flat top, the first in the middle."""
        level, top = below.base + thing.height, np.asarray(thing.top)
        if thing.kind == "plate":
            level = below.base + 0.0042
        for _ in range(int(self.rng.integers(1, 4))):
            upper = self.make(kinds)
            reach = np.abs(upper.foot).max(0)
            if (
                np.hypot(*reach) > 0.72 * top.min()
                or level + upper.height > self.support.at[2] + self.support.clear
            ):
                continue
            if upper.rod is not None or upper.kind in ("plate", "bowl"):
                continue
            self.put(
                upper,
                at + self.rng.normal(0, 0.04, 2) * top,
                self.rng.uniform(-40, 40),
                level,
                True,
            )
            if upper.top is None:
                return
            level, top = level + upper.height, np.asarray(upper.top)

    def fill(self, vessel: Thing, at: np.ndarray, below: Placed) -> None:
        """Long things that lean from the bottom of a vessel over its rim, each along its own chord."""
        kinds = [
            k for k in ("cutlery", "pencil", "brush", "driver") if k in self.makers
        ]
        radius, depth = vessel.well  # type: ignore[misc]
        kind, start = str(self.rng.choice(kinds)), self.rng.uniform(0, 360)
        for k in range(int(self.rng.integers(1, 5))):
            rod = self.makers[kind](self.rng)
            thick = 0.009
            run = 2 * (radius - thick) * self.rng.uniform(0.5, 0.95)
            if rod.rod is None or rod.rod < 1.25 * np.hypot(run, depth) or run <= 0.005:
                continue
            lean = np.degrees(np.arctan2(depth, run))
            way = turn("z", start + 95 * k) @ turn("y", -lean)
            low = turn("z", start + 95 * k) @ np.array(
                [-run / 2, 0.3 * (radius - thick) * (-1) ** k, 0]
            )
            middle = np.array([*at, below.base + vessel.height - depth + 0.003]) + low
            parts = rod.moved([rod.rod / 2, 0, -rod.height / 2])
            self.placed.append(
                Placed(
                    rod.kind,
                    [p.moved(middle, way) for p in parts],
                    below.foot,
                    below.base,
                    rod.rod,
                    True,
                )
            )

    def row(self, count: int) -> None:
        """Books side by side, backs to the viewer, the last ones perhaps leaning."""
        rng, at, size = self.rng, self.support.at, self.support.size
        x = at[0] + rng.uniform(-0.5, 0.2) * size[0]
        setback = rng.uniform(0, 0.02)
        tall = 0.0
        for k in range(count):
            thing = self.make(["book"])
            low, high = extent(thing.parts)
            thick, deep, height = high - low
            y = at[1] + size[1] / 2 - deep / 2 - setback - rng.uniform(0, 0.012)
            angle = rng.uniform(4, 22) if k > 1 and rng.random() < 0.15 else 0.0
            lean = turn("y", -angle)
            reach = min(height * np.cos(np.radians(angle)), tall) * np.tan(
                np.radians(angle)
            )
            wide = reach + thick * np.cos(np.radians(angle))
            foot = rectangle(wide, deep) + [x + wide / 2, y]
            if not self.fits(foot, height):
                return
            parts = [
                p.moved([thick / 2, 0, 0]).moved([x + reach, y, at[2]], lean)
                for p in thing.parts
            ]
            self.placed.append(
                Placed("book", parts, foot, at[2], float(height), angle > 0)
            )
            self.taken.append(foot)
            x, tall = x + wide + GAP + 0.0002, height
            if angle:
                return
            if rng.random() < 0.08:
                x += rng.uniform(0.005, 0.04)

    def stack(self, count: int) -> None:
        """Books lying upon each other, the largest below."""
        books = [self.make(["book"]) for _ in range(count)]
        flat = [laid(b, "y") for b in books]
        flat.sort(key=lambda t: -float(np.prod(np.ptp(t.foot, axis=0))))
        spin = self.rng.uniform(-30, 30) + self.rng.choice([0, 180, 90])
        foot = flat[0].foot @ turn("z", spin)[:2, :2].T * 1.06
        total = sum(t.height for t in flat)
        at = self.spot(foot, total)
        if at is None:
            return
        self.taken.append(foot + at)
        z = self.support.at[2]
        for k, book in enumerate(flat):
            self.put(
                book,
                at + (k > 0) * self.rng.normal(0, 0.004, 2),
                spin + (k > 0) * self.rng.normal(0, 7),
                z,
                k > 0,
            )
            z += book.height
        if self.rng.random() < 0.4:
            upper = self.make(
                [
                    k
                    for k in (
                        "mug",
                        "apple",
                        "candle",
                        "key",
                        "phone",
                        "ball",
                        "dice",
                        "clock",
                        "citrus",
                    )
                    if k in self.makers
                ]
            )
            if np.abs(upper.foot).max() < 0.06:
                self.put(upper, at, self.rng.uniform(0, 360), z, True)

    def against_wall(self) -> None:
        """A book or a flat box that leans on the wall, its face to the viewer."""
        thing = self.make(["book", "carton"])
        if not thing.leans:
            return
        spin = -90.0 if thing.kind == "book" else 0.0
        parts = thing.moved(turn=turn("z", spin))
        low, high = extent(parts)
        thick, height = (high - low)[1], (high - low)[2]
        angle = np.radians(self.rng.uniform(6, 18))
        deep = height * np.sin(angle) + thick * np.cos(angle)
        wide = (high - low)[0]
        x = self.support.at[0] + self.rng.uniform(-0.5, 0.5) * (
            self.support.size[0] - wide
        )
        back = self.support.at[1] + self.support.size[1] / 2 - 0.001
        foot = rectangle(wide, deep) + [x, back - deep / 2]
        if not self.fits(foot, height):
            return
        lean = turn("x", -np.degrees(angle))
        pivot = [
            p.moved([0, -high[1], 0]) for p in parts
        ]  # its back lower edge on the origin
        placed = [
            p.moved([x, back - height * np.sin(angle), self.support.at[2]], lean)
            for p in pivot
        ]
        self.placed.append(
            Placed(thing.kind, placed, foot, self.support.at[2], float(height), True)
        )
        self.taken.append(foot)


def laid(thing: Thing, axis: str = "x") -> Thing:
    """The same thing on its side: turned by 90 degrees about x or y, standing on z = 0 again."""
    parts = thing.moved(turn=turn(axis, 90))
    low, high = extent(parts)
    shift = np.array([*(-(low + high)[:2] / 2), -low[2]])
    size = high - low
    top = (float(size[0]), float(size[1])) if thing.kind == "book" else None
    return Thing(
        thing.kind,
        [p.moved(shift) for p in parts],
        rectangle(*size[:2]),
        float(size[2]),
        top=top,
    )


def arrange(support: Support, count: int, kinds: list[str], rng: Rng) -> list[Placed]:
    """About `count` things of `kinds` (names of the roster) on one support."""
    layout = Arrangement(support, rng)
    for _ in range(4 * count):
        if len(layout.placed) >= count:
            break
        pick = rng.random()
        if "book" in kinds and pick < 0.10 and (support.wall or support.clear < 1):
            layout.row(int(rng.integers(2, 11)))
        elif "book" in kinds and pick < 0.18:
            layout.stack(int(rng.integers(2, 5)))
        elif support.wall and pick < 0.25 and "carton" in kinds:
            layout.against_wall()
        else:
            layout.stand(kinds)
    return layout.placed[:count] if count else []
