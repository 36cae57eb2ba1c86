"""Free parameters of a fit: scales, limits and places in a scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import atan2, cos, degrees, exp, hypot, log, sin

import numpy as np

from physgen.arrays import F64
from physgen.fit.tracks import Tracks
from physgen.scene.scene import Motion, Object, Scene, Settings, View


class Kind(Enum):
    """The meaning of a parameter, with the words of `--free`."""

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
"""Free kinds by default; the size of gravity is known on Earth."""


class Scale(Enum):
    """Transformation of a value, so that equal steps have equal effects."""

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
    """Coefficient of friction or rolling, at most."""
    odds: tuple[float, float] = (0.01, 0.99)
    """Limits of elasticities, since the odds of 0 and 1 are infinite."""
    friction: float = 1.0
    """Standard deviation of the prior of the logarithm of a friction."""
    rolling: float = 1.5
    elasticity: float = 1.5
    mass: float = 1.0
    direction: float = 0.5
    """rad."""
    gravity: float = 1.0
    """Standard deviation, as a share of the scene's gravity."""
    speed: float = 1.0
    """Standard deviation of a velocity, in longer sides of the picture per second."""
    spin: float = 20.0
    """rad/s."""
    step: float = 0.006
    """Step of a difference quotient, as a share of the prior's width."""
    contact_step: float = 0.05
    """The same for values in contacts; the times of contacts are multiples of a step."""


TUNING = ParameterTuning()


@dataclass(frozen=True)
class Parameter:
    """One free number of a scene."""

    path: str
    """Dotted key in the scene file; the number at the end is an index in a list."""
    kind: Kind
    index: int
    """Index of the object; -1 for a value of the world."""
    component: int
    """Component of a vector; 0 otherwise."""
    scale: Scale
    start: float
    """Start of the fit; this and all numbers below are on the transformed scale."""
    spread: float
    """Standard deviation of the prior around the start."""
    low: float = -np.inf
    high: float = np.inf

    @property
    def step(self) -> float:
        """Return the step of a difference quotient."""
        # Values on a linear scale act at the start, others in contacts.
        if self.scale is Scale.LINEAR:
            return self.spread * TUNING.step
        return self.spread * TUNING.contact_step

    def value(self, number: float) -> float:
        """Return the value of a transformed number in the scene's units, angles in rad."""
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


@dataclass(frozen=True)
class Starts:
    """Motion at t = 0, from the first frames."""

    velocities: F64
    """(N, 3): px/s, px/s, rad/s."""
    moves: tuple[bool, ...]
    """Whether each object moves at t = 0."""
    spins: tuple[bool, ...]
    """Whether the tracks contain each object's angle."""
    rolls: tuple[bool, ...]
    """Whether each object is round."""
    supported_axes: tuple[tuple[bool, bool], ...]
    """Whether a support stops the motion of each object in x and in y at t = 0."""
    observations: tuple[tuple[bool, bool], ...]
    """Whether velocity and spin of each object come from the tracks, not from the scene."""


def free_parameters(
    scene: Scene, tracks: Tracks, kinds: Sequence[Kind], starts: Starts
) -> tuple[Parameter, ...]:
    """Return the parameters of these kinds in a scene."""
    candidates: list[Parameter] = []
    for k, item in enumerate(scene.objects):
        has_tracks = bool(np.isfinite(tracks.poses[:, k, 0]).any())
        if item.motion is Motion.DYNAMIC and has_tracks:
            candidates += _start_parameters(scene, k, item, starts)
            candidates += _contact_parameters(k, item, starts)
    candidates += _world_parameters(scene)
    parameters = []
    masses = 0
    for parameter in candidates:
        if parameter.kind not in kinds:
            continue
        # The components of gravity contain its direction.
        if parameter.kind is Kind.DIRECTION and Kind.GRAVITY in kinds:
            continue
        # A motion depends on ratios of masses alone, so that the first mass is fixed.
        if parameter.kind is Kind.MASS:
            masses += 1
            if masses == 1:
                continue
        parameters.append(parameter)
    return tuple(parameters)


def _start_parameters(
    scene: Scene, k: int, item: Object, starts: Starts
) -> Iterator[Parameter]:
    """Yield the velocity and the spin of an object in motion."""
    if not starts.moves[k]:
        return
    path = f"objects.{item.name}"
    speed = TUNING.speed * max(scene.size)
    linear = Scale.LINEAR
    for axis in (0, 1):
        if not starts.supported_axes[k][axis]:
            start = float(starts.velocities[k, axis])
            key = f"{path}.velocity.{axis}"
            yield Parameter(key, Kind.VELOCITY, k, axis, linear, start, speed)
    if starts.spins[k]:
        start = float(starts.velocities[k, 2])
        yield Parameter(f"{path}.spin", Kind.SPIN, k, 0, linear, start, TUNING.spin)


def _contact_parameters(k: int, item: Object, starts: Starts) -> Iterator[Parameter]:
    """Yield the values of an object in contacts: friction, elasticity, rolling, mass."""
    path = f"objects.{item.name}"
    high = log(TUNING.largest)
    start = log(max(item.friction, TUNING.least_friction))
    yield Parameter(
        f"{path}.friction", Kind.FRICTION, k, 0, Scale.LOGARITHM, start,
        TUNING.friction, log(TUNING.least_friction) - 1.0, high,
    )  # fmt: skip
    low_odds, high_odds = odds(0.0), odds(1.0)
    yield Parameter(
        f"{path}.elasticity", Kind.ELASTICITY, k, 0, Scale.ODDS,
        odds(item.elasticity), TUNING.elasticity, low_odds - 1e-3, high_odds + 1e-3,
    )  # fmt: skip
    if starts.rolls[k]:
        start = log(max(item.rolling, TUNING.least_rolling))
        yield Parameter(
            f"{path}.rolling", Kind.ROLLING, k, 0, Scale.LOGARITHM, start,
            TUNING.rolling, log(TUNING.least_rolling) - 3.0, high,
        )  # fmt: skip
    # The parameter is the factor of the scene's mass.
    yield Parameter(
        f"{path}.mass", Kind.MASS, k, 0, Scale.LOGARITHM, 0.0, TUNING.mass, -5.0, 5.0
    )


def _world_parameters(scene: Scene) -> Iterator[Parameter]:
    """Yield the friction of a table, or else the gravity."""
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
    """Return the scene with the observed start and these transformed numbers.

    Velocities in a film belong to its first frame, so that the scene gets no ramp.
    """
    objects = list(scene.objects)
    for k, item in enumerate(objects):
        if item.motion is Motion.DYNAMIC:
            objects[k] = _with_start(item, starts.velocities[k], starts.observations[k])
    world = scene.world
    if any(map(any, starts.observations)):
        world = replace(world, ramp=0.0)
    for parameter, number in zip(parameters, numbers.tolist(), strict=True):
        value = parameter.value(number)
        if parameter.index >= 0:
            item = objects[parameter.index]
            objects[parameter.index] = _object_with(item, parameter, value)
        else:
            world = _world_with(world, parameter, value)
    return replace(scene, objects=tuple(objects), world=world)


def _with_start(item: Object, start: F64, observations: tuple[bool, bool]) -> Object:
    """Return an object with the observed part of its start (x, y, spin), rad/s."""
    has_velocity, has_spin = observations
    x, y, spin = start.tolist()
    if has_velocity:
        item = replace(item, velocity=(x, y))
    if has_spin:
        item = replace(item, spin=degrees(spin))
    return item


def _object_with(item: Object, parameter: Parameter, value: float) -> Object:
    """Return an object with another value of one parameter."""
    match parameter.kind:
        case Kind.VELOCITY:
            velocity = list(item.velocity)
            velocity[parameter.component] = value
            return replace(item, velocity=(velocity[0], velocity[1]))
        case Kind.SPIN:
            return replace(item, spin=degrees(value))
        case Kind.FRICTION:
            # One coefficient holds for sliding and for rest.
            return replace(item, friction=value, static_friction=None)
        case Kind.ELASTICITY:
            return replace(item, elasticity=value)
        case Kind.ROLLING:
            return replace(item, rolling=value)
    return _with_mass_factor(item, value)


def _with_mass_factor(item: Object, value: float) -> Object:
    """Return an object with a multiple of its mass or its density."""
    if item.mass is not None:
        return replace(item, mass=item.mass * value)
    if item.density is None:
        density = 1.0
    else:
        density = item.density
    return replace(item, density=density * value)


def _world_with(world: Settings, parameter: Parameter, value: float) -> Settings:
    """Return a scene's world with another table friction or gravity."""
    if parameter.kind is Kind.TABLE:
        return replace(world, table_friction=value)
    x, y = world.gravity
    if parameter.kind is Kind.DIRECTION:
        size = hypot(x, y)
        return replace(world, gravity=(size * cos(value), size * sin(value)))
    gravity = [x, y]
    gravity[parameter.component] = value
    return replace(world, gravity=(gravity[0], gravity[1]))
