"""A second source: balls under gravity or on a slippery table in closed form, without physgen's engine.

Each ball flies on a parabola (numpy alone); the next time at which two balls, or a ball and a wall, touch is a root
of a quadratic; what a blow does follows from masses and elasticity. No friction, no spin. What goes wrong is made
wrong here, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physgen.evaluate.plausibility.tracks import Array, Tracks, disc
from physgen.scene.scene import View

Rng = np.random.Generator
ROOM = 512.0
FREE = 0.32
"""s without a blow before and after what goes wrong."""
KINDS = (
    "gravity changes",
    "energy is gained",
    "a jump",
    "momentum is lost",
    "one through another",
)


@dataclass
class Balls:
    """State of N balls at a time."""

    time: float
    places: Array
    """(N, 2) px."""
    velocities: Array
    """(N, 2) px/s."""
    radii: Array
    masses: Array
    bounce: float
    """Elasticity of all."""
    pull: float
    """px/s² downwards; 0 on a table."""
    ghosts: frozenset[frozenset[int]] = frozenset()
    """Pairs that take no notice of each other."""

    def at(self, time: float) -> Array:
        """(N, 2) px, where nothing is met before."""
        s = time - self.time
        return np.asarray(
            self.places + s * self.velocities + np.array([0.0, self.pull * s * s / 2])
        )

    def go(self, time: float) -> None:
        """To a later moment, before the next blow."""
        places = self.at(time)
        self.velocities = self.velocities + np.array(
            [0.0, self.pull * (time - self.time)]
        )
        self.places, self.time = places, time


@dataclass(frozen=True)
class Meet:
    """Two balls, or one and a wall."""

    time: float
    one: int
    other: int
    """Another ball; -1 left, -2 right, -3 floor, -4 the far side of a table."""


def made(
    rng: Rng, fault: str | None, fps: float, seconds: float = 1.6
) -> Tracks | None:
    """A clip, right or with one fault; None where it would not show."""
    top = bool(rng.random() < 0.4)
    if fault == "gravity changes" and top:
        return None
    balls = _drawn(rng, top)
    times = np.arange(int(seconds * fps + 1e-9) + 1) / fps
    calm = _run(_copy(balls), times, None, 0.0, rng)
    if calm is None:
        return None
    if fault is None:
        places = calm[0]
    else:
        found = _wronged(balls, times, fault, calm[1], rng)
        if found is None:
            return None
        places = found
    n = len(balls.radii)
    return Tracks(
        "balls", times, tuple(f"ball {k + 1}" for k in range(n)), places, None,
        tuple(disc(float(r)) for r in balls.radii), View.TOP if top else View.SIDE, 0.02,
        "balls in closed form", balls.masses,
    )  # fmt: skip


def _drawn(rng: Rng, top: bool) -> Balls:
    count = int(rng.integers(2, 6))
    radii = rng.uniform(9, 24, count)
    places = np.empty((count, 2))
    for k in range(count):
        while True:
            places[k] = rng.uniform((50, 50), (462, 460 if top else 330))
            if all(
                np.hypot(*(places[k] - places[m])) > radii[k] + radii[m] + 12
                for m in range(k)
            ):
                break
    velocities = rng.uniform(-330, 330, (count, 2)) * ((1, 1) if top else (1, 0.5))
    if top and rng.random() < 0.5:
        velocities[rng.random(count) < 0.4] = 0.0
        velocities[0] = 0.0
    return Balls(
        0.0, places, velocities, radii, rng.uniform(0.3, 3.0, count) * radii**2, float(rng.uniform(0.75, 1.0)),
        0.0 if top else float(rng.uniform(400, 1400)),
    )  # fmt: skip


def _copy(balls: Balls) -> Balls:
    return Balls(
        balls.time, balls.places.copy(), balls.velocities.copy(), balls.radii, balls.masses, balls.bounce, balls.pull,
        balls.ghosts,
    )  # fmt: skip


def _next(balls: Balls) -> Meet | None:
    found: list[Meet] = []
    for k, radius in enumerate(balls.radii.tolist()):
        (x, y), (vx, vy) = balls.places[k].tolist(), balls.velocities[k].tolist()
        if vx < 0:
            found.append(Meet((radius - x) / vx, k, -1))
        if vx > 0:
            found.append(Meet((ROOM - radius - x) / vx, k, -2))
        floor = _root(balls.pull / 2, vy, y - (ROOM - radius))
        if floor is not None:
            found.append(Meet(floor, k, -3))
        if balls.pull == 0 and vy < 0:
            found.append(Meet((radius - y) / vy, k, -4))
        for m in range(k):
            if frozenset((k, m)) in balls.ghosts:
                continue
            apart, way = (
                balls.places[k] - balls.places[m],
                balls.velocities[k] - balls.velocities[m],
            )
            a, b = float(way @ way), float(apart @ way)
            c = float(apart @ apart) - (radius + balls.radii[m]) ** 2
            if b < 0 and b * b > a * c:
                found.append(Meet((-b - np.sqrt(b * b - a * c)) / a, k, m))
    ahead = [meet for meet in found if meet.time > -1e-9]
    return min(ahead, key=lambda meet: meet.time, default=None)


def _root(a: float, b: float, c: float) -> float | None:
    """When a t² + b t + c rises through 0."""
    if a == 0:
        return -c / b if b > 0 else None
    inside = b * b - 4 * a * c
    return None if inside < 0 else float((-b + np.sqrt(inside)) / (2 * a))


def _blow(balls: Balls, meet: Meet) -> None:
    v, e = balls.velocities, balls.bounce
    if meet.other < 0:
        axis = 0 if meet.other in (-1, -2) else 1
        v[meet.one, axis] *= -e
        return
    k, m = meet.one, meet.other
    normal = balls.places[k] - balls.places[m]
    normal = normal / np.hypot(*normal)
    closing = float((v[k] - v[m]) @ normal)
    push = -(1 + e) * closing / (1 / balls.masses[k] + 1 / balls.masses[m])
    v[k] += push / balls.masses[k] * normal
    v[m] -= push / balls.masses[m] * normal


def _run(
    balls: Balls, times: Array, change: object, moment: float, rng: Rng
) -> tuple[Array, list[tuple[float, int, int]]] | None:
    """Places at `times`, and all blows; `change(balls)` is called at a moment. None for an endless row of blows."""
    places = np.empty((len(times), *balls.places.shape))
    blows: list[tuple[float, int, int]] = []
    k = 0
    changed = change is None
    while k < len(times):
        meet = _next(balls)
        due = balls.time + max(meet.time, 0.0) if meet is not None else np.inf
        if not changed and moment <= min(due, times[k]):
            balls.go(moment)
            change(balls)  # type: ignore[operator]
            changed = True
            continue
        if due > times[k]:
            places[k] = balls.at(float(times[k]))
            k += 1
            continue
        assert meet is not None
        balls.go(due)
        _blow(balls, meet)
        blows.append((due, meet.one, meet.other))
        if len(blows) > 40 * len(balls.radii):
            return None  # it comes to lie on the floor: an endless row of ever smaller bounces
    return places, blows


def _calm(
    blows: list[tuple[float, int, int]], ball: int, start: float, end: float
) -> bool:
    return not any(
        start < time < end for time, one, other in blows if ball in (one, other)
    )


def _wronged(
    balls: Balls,
    times: Array,
    fault: str,
    blows: list[tuple[float, int, int]],
    rng: Rng,
) -> Array | None:
    end = float(times[-1])
    count = len(balls.radii)
    order = rng.permutation(count).tolist()
    moment = float(rng.uniform(0.3, 0.65)) * end

    def run(change: object, when: float) -> Array | None:
        found = _run(_copy(balls), times, change, when, rng)
        return None if found is None else found[0]

    if fault == "gravity changes":
        factor = float(rng.choice([rng.uniform(0.1, 0.6), rng.uniform(1.6, 2.5)]))
        seen = any(_calm(blows, k, moment - FREE, moment) for k in order)
        seen &= any(_calm(blows, k, moment - 0.05, moment + FREE) for k in order)
        return (
            run(lambda b: setattr(b, "pull", b.pull * factor), moment) if seen else None
        )
    if fault == "a jump":
        for k in order:
            if _calm(blows, k, moment - FREE, moment + FREE):
                angle, far = (
                    rng.uniform(0, 2 * np.pi),
                    max(30.0, float(rng.uniform(1.5, 4)) * balls.radii[k]),
                )
                there = _state(balls, moment).places[k] + far * np.array(
                    [np.cos(angle), np.sin(angle)]
                )
                if (there < balls.radii[k] + 2).any() or (
                    there > ROOM - balls.radii[k] - 2
                ).any():
                    continue
                return run(
                    lambda b, k=k, a=angle, f=far: _shift(
                        b, k, f * np.array([np.cos(a), np.sin(a)])
                    ),
                    moment,
                )
        return None
    if fault == "one through another":
        for time, one, other in blows:
            if other >= 0 and time < end - 0.15:
                ghosts = frozenset([frozenset((one, other))])
                places = run(lambda b, g=ghosts: setattr(b, "ghosts", g), 0.0)
                if places is not None and _deep(places, balls.radii, one, other):
                    return places
        return None
    wanted = "ball" if fault == "momentum is lost" else "wall"
    for time, one, other in blows:
        if (other >= 0) != (wanted == "ball") or time < FREE or time > end - FREE:
            continue
        both = [one, other] if other >= 0 else [one]
        if not all(
            _calm(blows, k, time - FREE, time) and _calm(blows, k, time, time + FREE)
            for k in both
        ):
            continue
        before = _state(balls, time - 1e-6)
        if other < 0:
            came = float(np.hypot(*before.velocities[one]))
            if came > 80:
                more = float(rng.uniform(1.35, 2.0)) * came
                return run(lambda b, k=one, m=more: _faster(b, k, m), time + 1e-6)
        else:
            after = _state(balls, time + 1e-6)
            change = after.velocities[one] - before.velocities[one]
            apart = after.places[one] - after.places[other]
            ratio = balls.masses[one] / balls.masses[other]
            old = before.velocities[other]
            ways = [
                old,
                old + 0.5 * ratio * change,
                old + ratio * change[::-1] * (1, -1),
            ]
            for k in rng.permutation(3).tolist():
                parts = (after.velocities[one] - ways[k]) @ apart > 20 * np.hypot(
                    *apart
                )
                if np.hypot(*change) > 60 and parts:
                    return run(
                        lambda b, m=other, v=ways[k]: b.velocities.__setitem__(m, v),
                        time + 1e-6,
                    )
    return None


def _state(balls: Balls, time: float) -> Balls:
    state = _copy(balls)
    while (meet := _next(state)) is not None and state.time + max(
        meet.time, 0.0
    ) < time:
        state.go(state.time + max(meet.time, 0.0))
        _blow(state, meet)
    state.go(time)
    return state


def _shift(balls: Balls, k: int, way: Array) -> None:
    balls.places[k] = balls.places[k] + way


def _faster(balls: Balls, k: int, speed: float) -> None:
    balls.velocities[k] *= speed / np.hypot(*balls.velocities[k])


def _deep(places: Array, radii: Array, one: int, other: int) -> bool:
    away = places[:, one] - places[:, other]
    ticks = np.linspace(0, len(away) - 1, 8 * len(away))
    fine = np.hypot(
        *(np.interp(ticks, np.arange(len(away)), away[:, k]) for k in (0, 1))
    )
    return bool(
        fine.min() < radii[one] + radii[other] - 0.8 * min(radii[one], radii[other])
    )
