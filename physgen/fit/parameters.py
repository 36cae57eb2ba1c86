"""The parameters that a fit may free: their scales, limits and places in a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import atan2, cos, degrees, exp, hypot, log, sin
from typing import Any

import numpy as np

from physgen.arrays import F64
from physgen.fit.tracks import Tracks
from physgen.scene.scene import Motion, Object, Scene, View


class Kind(Enum):
    """What a parameter is, as `--free` names it."""

    VELOCITY = "velocity"
    SPIN = "spin"
    FRICTION = "friction"
    ELASTICITY = "elasticity"
    ROLLING = "rolling"
    MASS = "mass"
    TABLE = "table"
    DIRECTION = "direction"
    GRAVITY = "gravity"


DEFAULT_KINDS = tuple(kind for kind in Kind if kind is not Kind.GRAVITY)
"""What is free unless it is named; the size of gravity is known on Earth."""


class Scale(Enum):
    """How a value is transformed, so that a step means the same everywhere."""

    LINEAR = "linear"
    LOGARITHM = "logarithm"
    ODDS = "odds"
    """The logarithm of e / (1 - e)."""


@dataclass(frozen=True)
class ParameterTuning:
    """Starting values, steps and prior widths, on the transformed scale."""

    least_friction: float = 0.01
    """Start of a coefficient that the scene has as 0."""
    least_rolling: float = 0.003
    largest: float = 3.0
    """Of a coefficient of friction or rolling, at most."""
    odds: tuple[float, float] = (0.01, 0.99)
    """Elasticities within which odds are formed."""
    friction: float = 1.0
    """Standard deviation of what is known before about the logarithm of a friction."""
    rolling: float = 1.5
    elasticity: float = 1.5
    mass: float = 1.0
    direction: float = 0.5
    """rad."""
    gravity: float = 1.0
    """Share of ordinary gravity."""
    speed: float = 1.0
    """Longer sides of the picture per second."""
    spin: float = 20.0
    """rad/s."""
    step: float = 0.006
    """Step of a difference quotient, of a prior's width."""
    contact_step: float = 0.05
    """The same of values that act in contacts, whose times are multiples of a step."""


TUNING = ParameterTuning()


@dataclass(frozen=True)
class Parameter:
    """One free number of a scene."""

    path: str
    """Dotted key in the scene file; a number behind it is the index in a list."""
    kind: Kind
    index: int
    """Of the object; -1 for the world's."""
    component: int
    """Of a vector; 0 otherwise."""
    scale: Scale
    start: float
    """On the transformed scale, as all below."""
    spread: float
    """Standard deviation of what is known before."""
    low: float = -np.inf
    high: float = np.inf

    @property
    def step(self) -> float:
        """Return the step of a difference quotient."""
        is_linear = self.scale is Scale.LINEAR
        return self.spread * (TUNING.step if is_linear else TUNING.contact_step)

    def value(self, number: float) -> float:
        """Return the value in the scene's units (rad for angles) for a transformed number."""
        if self.scale is Scale.LOGARITHM:
            return exp(number)
        if self.scale is Scale.ODDS:
            return 1.0 / (1.0 + exp(-number))
        return number


def odds(value: float) -> float:
    """Return the logarithm of e / (1 - e), for e within the tuning's limits."""
    low, high = TUNING.odds
    share = min(max(value, low), high)
    return log(share / (1.0 - share))


def free_parameters(
    scene: Scene, tracks: Tracks, kinds: Sequence[Kind], starts: Starts
) -> tuple[Parameter, ...]:
    """Return the parameters of these kinds that the scene has."""
    parameters: list[Parameter] = []
    for k, item in enumerate(scene.objects):
        if item.motion is Motion.DYNAMIC and np.isfinite(tracks.poses[:, k, 0]).any():
            parameters += _of_object(scene, k, item, starts)
    parameters += _of_world(scene)
    chosen = [one for one in parameters if one.kind in kinds]
    if Kind.GRAVITY in kinds:
        chosen = [one for one in chosen if one.kind is not Kind.DIRECTION]
    masses = [one for one in chosen if one.kind is Kind.MASS]
    # motion tells ratios of masses alone, so that the first one stays
    return tuple(one for one in chosen if one not in masses[:1])


@dataclass(frozen=True)
class Starts:
    """Velocities at t = 0, as the first frames show them."""

    velocities: F64
    """(N, 3): px/s, px/s, rad/s."""
    moves: tuple[bool, ...]
    """Whether each object moves at t = 0."""
    spins: tuple[bool, ...]
    """Whether each object's angle is observed, and may change at t = 0."""
    is_round: tuple[bool, ...]
    """Whether each object rolls."""
    held: tuple[tuple[bool, bool], ...]
    """Whether a support holds x and y of each object's velocity at 0."""
    sets: tuple[tuple[bool, bool], ...]
    """Whether velocity and spin of each object come from the tracks; others are the scene's."""


def _of_object(
    scene: Scene, k: int, item: Object, starts: Starts
) -> Iterator[Parameter]:
    path = f"objects.{item.name}"
    speed = TUNING.speed * max(scene.size)
    linear = Scale.LINEAR
    if starts.moves[k]:
        free = [axis for axis in (0, 1) if not starts.held[k][axis]]
        for axis in free:
            start = float(starts.velocities[k, axis])
            key = f"{path}.velocity.{axis}"
            yield Parameter(key, Kind.VELOCITY, k, axis, linear, start, speed)
        if starts.spins[k]:
            start = float(starts.velocities[k, 2])
            yield Parameter(f"{path}.spin", Kind.SPIN, k, 0, linear, start, TUNING.spin)
    high = log(TUNING.largest)
    start = log(max(item.friction, TUNING.least_friction))
    yield Parameter(
        f"{path}.friction", Kind.FRICTION, k, 0, Scale.LOGARITHM, start,
        TUNING.friction, log(TUNING.least_friction) - 1.0, high,
    )  # fmt: skip
    low_odds, high_odds = map(odds, (0.0, 1.0))
    yield Parameter(
        f"{path}.elasticity", Kind.ELASTICITY, k, 0, Scale.ODDS,
        odds(item.elasticity), TUNING.elasticity, low_odds - 1e-3, high_odds + 1e-3,
    )  # fmt: skip
    if starts.is_round[k]:
        start = log(max(item.rolling, TUNING.least_rolling))
        yield Parameter(
            f"{path}.rolling", Kind.ROLLING, k, 0, Scale.LOGARITHM, start,
            TUNING.rolling, log(TUNING.least_rolling) - 3.0, high,
        )  # fmt: skip
    # the factor of the scene's mass
    yield Parameter(
        f"{path}.mass", Kind.MASS, k, 0, Scale.LOGARITHM, 0.0, TUNING.mass, -5.0, 5.0
    )


def _of_world(scene: Scene) -> Iterator[Parameter]:
    world = scene.world
    if world.view is View.TOP:
        start = log(max(world.table_friction, TUNING.least_friction))
        yield Parameter(
            "world.table.friction", Kind.TABLE, -1, 0, Scale.LOGARITHM, start,
            TUNING.friction, log(TUNING.least_friction) - 1.0, log(TUNING.largest),
        )  # fmt: skip
        return
    x, y = world.gravity
    if not hypot(x, y):
        return
    angle = atan2(y, x)
    yield Parameter(
        "world.gravity.angle", Kind.DIRECTION, -1, 0, Scale.LINEAR, angle,
        TUNING.direction,
    )  # fmt: skip
    spread = TUNING.gravity * hypot(x, y)
    for axis, part in enumerate((x, y)):
        path = f"world.gravity.{axis}"
        linear = Scale.LINEAR
        yield Parameter(path, Kind.GRAVITY, -1, axis, linear, part, spread)


def with_values(
    scene: Scene, parameters: Sequence[Parameter], numbers: F64, starts: Starts
) -> Scene:
    """Return the scene with these transformed numbers, and at rest what rests at t = 0.

    Velocities of a film are those of its first frame: no ramp leads to them.
    """
    objects = list(scene.objects)
    for k, item in enumerate(objects):
        if item.motion is Motion.DYNAMIC:
            objects[k] = _with_start(item, starts.velocities[k], starts.sets[k])
    world = scene.world
    if any(any(pair) for pair in starts.sets):
        world = replace(world, ramp=0.0)
    for parameter, number in zip(parameters, numbers.tolist(), strict=True):
        value = parameter.value(number)
        if parameter.index >= 0:
            change = _OBJECT_CHANGES[parameter.kind]
            objects[parameter.index] = change(
                objects[parameter.index], parameter, value
            )
        else:
            world = _world_change(world, parameter, value)
    return replace(scene, objects=tuple(objects), world=world)


def _with_start(item: Object, start: F64, sets: tuple[bool, bool]) -> Object:
    x, y, spin = start.tolist()
    velocity = (x, y) if sets[0] else item.velocity
    return replace(
        item, velocity=velocity, spin=degrees(spin) if sets[1] else item.spin
    )


def _velocity(item: Object, parameter: Parameter, value: float) -> Object:
    pair = list(item.velocity)
    pair[parameter.component] = value
    return replace(item, velocity=(pair[0], pair[1]))


def _coefficient(item: Object, parameter: Parameter, value: float) -> Object:
    changes: dict[str, Any] = {parameter.kind.value: value}
    return replace(item, **changes)


def _friction(item: Object, parameter: Parameter, value: float) -> Object:
    # one coefficient, for sliding and for rest
    return replace(item, friction=value, static_friction=None)


def _mass(item: Object, parameter: Parameter, value: float) -> Object:
    if item.mass is not None:
        return replace(item, mass=item.mass * value)
    density = 1.0 if item.density is None else item.density
    return replace(item, density=density * value)


_OBJECT_CHANGES: dict[Kind, Callable[[Object, Parameter, float], Object]] = {
    Kind.VELOCITY: _velocity,
    Kind.SPIN: lambda item, parameter, value: replace(item, spin=degrees(value)),
    Kind.FRICTION: _friction,
    Kind.ELASTICITY: _coefficient,
    Kind.ROLLING: _coefficient,
    Kind.MASS: _mass,
}


def _world_change(world: Any, parameter: Parameter, value: float) -> Any:
    """Return a scene's world with another table friction or gravity."""
    if parameter.kind is Kind.TABLE:
        return replace(world, table_friction=value)
    x, y = world.gravity
    if parameter.kind is Kind.DIRECTION:
        size = hypot(x, y)
        return replace(world, gravity=(size * cos(value), size * sin(value)))
    pair = [x, y]
    pair[parameter.component] = value
    return replace(world, gravity=(pair[0], pair[1]))
