"""Measures of a trial motion: whether it leaves, climbs, overhangs or tumbles."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import atan2, cos, degrees, hypot, radians, sqrt
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import cross
from physgen.perceive.wheels import may_drive
from physgen.pipeline.push_outcomes import (
    TRIAL,
    Array,
    TrialScene,
)
from physgen.scene.scene import Motion, View

if TYPE_CHECKING:
    from physgen.compile.world import Body, World
    from physgen.simulate.trajectory import Trajectory


def is_tall_body(body: Body) -> bool:
    """Check whether a body may fall over."""
    width, height = measure_extent(body)
    return body.radius is None and height >= TRIAL.fall_ratio * width


def measure_extent(body: Body) -> tuple[float, float]:
    """Return width and height of a body, px."""
    corners = np.concatenate(body.rings)
    width, height = np.ptp(corners, axis=0).tolist()
    return float(width), float(height)


@dataclass(frozen=True)
class PictureBorder:
    """The picture's border, widened by the parts of objects outside at the start."""

    points: Sequence[Array]
    """Corners of the bodies in their own frames, (P, 2) px."""
    low: Array
    """Lower limits of each body, (N, 2) px."""
    high: Array
    """Upper limits of each body, (N, 2) px."""
    watch_mask: NDArray[np.bool_]
    """Mask (N,) of movable bodies."""

    @staticmethod
    def from_trials(trials: TrialScene, world: World) -> PictureBorder:
        """Return the border for a world at its start."""
        points = list(map(_corners, world.bodies))
        centers = [body.center for body in world.bodies]
        lower_corners = np.array(
            [
                corners.min(axis=0) + center
                for corners, center in zip(points, centers, strict=True)
            ]
        )
        upper_corners = np.array(
            [
                corners.max(axis=0) + center
                for corners, center in zip(points, centers, strict=True)
            ]
        )
        # An object that begins beyond the border may stay there, so that the border is
        # wider.
        slack = TRIAL.border_margin * trials.side
        movable = [body.motion is Motion.DYNAMIC for body in world.bodies]
        return PictureBorder(
            points,
            np.minimum(lower_corners.reshape(-1, 2), -0.5 - slack),
            np.maximum(
                upper_corners.reshape(-1, 2), np.array(world.size) - 0.5 + slack
            ),
            np.array(movable, bool),
        )

    def leaving(self, poses: Array) -> NDArray[np.bool_]:
        """Return the mask of bodies that are outside in one of the poses (S, N, 3)."""
        result = np.zeros(len(self.points), bool)
        for k in np.flatnonzero(self.watch_mask).tolist():
            places = _transform_points(self.points[k], poses[:, k])
            is_low = (places < self.low[k] - 1e-6).any()
            result[k] = is_low or (places > self.high[k] + 1e-6).any()
        return result


def _corners(body: Body) -> Array:
    """Return the corners of a body's convex hull in its own frame, (P, 2) px."""
    points = np.concatenate(body.rings).astype(np.float32)
    hull = cv2.convexHull(points).reshape(-1, 2)
    return np.asarray(hull, np.float64)


def _transform_points(points: Array, poses: Array) -> Array:
    """Return points (P, 2) of a body at its poses (S, 3): (S, P, 2) px."""
    cosine = np.cos(poses[:, 2])
    sine = np.sin(poses[:, 2])
    x = points[:, 0] * cosine[:, None] - points[:, 1] * sine[:, None]
    y = points[:, 0] * sine[:, None] + points[:, 1] * cosine[:, None]
    return np.stack([x, y], axis=-1) + poses[:, None, :2]


def _shift(body: Body, poses: Array) -> Array:
    """Return the distance of the outline from its first pose, (S,) px.

    A disc that turns in place does not move; for a polygon the farthest corner counts.
    """
    if body.radius is not None:
        return np.asarray(np.hypot(*(poses[:, :2] - poses[0, :2]).T))
    places = _transform_points(_corners(body), poses)
    return np.asarray(np.hypot(*np.moveaxis(places - places[0], -1, 0)).max(axis=1))


def measure_travel(world: World, motion: Trajectory) -> Array:
    """Return the farthest displacement of each body, (N,) px."""
    return measure_sweep(world, motion.poses)


def measure_sweep(world: World, poses: Array) -> Array:
    """Return the farthest displacement of each body from its first pose, (N,) px."""
    distances = [_shift(body, poses[:, k]).max() for k, body in enumerate(world.bodies)]
    return np.array(distances, np.float64)


def measure_moving_time(
    world: World, motion: Trajectory, least_distance: float
) -> float:
    """Return the time after which no body is `least_distance` px from its last pose, s."""
    last_sample = 0
    for k, body in enumerate(world.bodies):
        # Backwards from the last pose: a body moves until it stays near its end.
        distances = _shift(body, motion.poses[::-1, k])[::-1]
        moving_samples = np.flatnonzero(distances > least_distance)
        last_sample = max(last_sample, int(moving_samples.max(initial=0)))
    return float(motion.times[last_sample])


def find_fallen_objects(world: World, motion: Trajectory) -> list[str]:
    """Return the names of fallen tall objects."""
    names = []
    for k, body in enumerate(world.bodies):
        turn = abs(float(motion.poses[-1, k, 2] - motion.poses[0, k, 2]))
        if is_tall_body(body) and turn >= radians(TRIAL.fall_angle):
            names.append(body.name)
    return names


def tumbles(world: World, motion: Trajectory, name: str) -> bool:
    """Check whether a low object turns over: bowls, cars and bags slide instead."""
    index = motion.names.index(name)
    body = world.bodies[index]
    if body.radius is not None or is_tall_body(body):
        return False
    turns = motion.poses[:, index, 2] - motion.poses[0, index, 2]
    return bool(np.abs(turns).max() > radians(TRIAL.tumble))


def overturns(trials: TrialScene, motion: Trajectory) -> bool:
    """Check whether a vehicle turns over: in a photo of a street, that is no story."""
    names = []
    for item in trials.scene.objects:
        if may_drive(item.label, None) and item.motion is Motion.DYNAMIC:
            names.append(item.name)
    return measure_turn(motion, names) > TRIAL.overturned


def measure_turn(motion: Trajectory, names: Collection[str]) -> float:
    """Return the largest rotation of the objects of these names, degrees."""
    columns = [motion.names.index(name) for name in names]
    turns = motion.poses[:, columns, 2] - motion.poses[0, columns, 2]
    return degrees(float(np.abs(turns).max(initial=0.0)))


def measure_foot(body: Body) -> tuple[float, float, float]:
    """Return the lower end of a body and both ends of its foot, px from its centre."""
    points = np.concatenate(body.rings)
    low = float(points[:, 1].min())
    high = float(points[:, 1].max())
    # The foot has all corners near the lower end.
    foot = points[points[:, 1] > high - TRIAL.foot * (high - low), 0]
    return high, float(foot.min()), float(foot.max())


def rocks(world: World, motion: Trajectory) -> bool:
    """Check whether an object tips visibly and settles as it stood."""
    turns = motion.poses[..., 2] - motion.poses[0, :, 2]
    is_upright = np.array([body.radius is None for body in world.bodies], bool)
    limit = radians(TRIAL.rocks_visible)
    is_visible = np.abs(turns).max(axis=0) >= limit
    is_back = np.abs(turns[-1]) < limit / 2
    return bool((is_upright & is_visible & is_back).any())


def tipping_motion(
    body: Body, side: float, angle: float, gravity: float, ramp: float
) -> tuple[tuple[float, float], float]:
    """Return the velocity, px/s, and the spin, degrees/s, that tip a body.

    The body turns by at most `angle`, degrees, about its lower corner on the `side` of
    the push, 1 right or -1 left: kinetic energy about the corner becomes height. The
    body reaches its velocity within `ramp`, s, and has risen by then.
    """
    high, left, right = measure_foot(body)
    half_width = max(side * left, side * right, 1.0)
    falling_angle = atan2(half_width, high)
    # The body must swing back, and not fall over.
    turn = min(radians(angle), TRIAL.rocks_most * falling_angle)
    reach = hypot(half_width, high)
    # The centre turns about the corner, and is highest above it.
    rise = reach * cos(falling_angle - turn) - high
    inertia = body.moment / body.mass + reach**2
    # The ramp lifts the body by `rate * ramp / 2`: a quadratic equation for the rate.
    lift = gravity * half_width * ramp / 2
    energy = 2 * inertia * gravity * max(rise, 0.0)
    rate = (sqrt(lift**2 + energy) - lift) / inertia
    # The centre moves across the line to the corner.
    velocity = (side * rate * high, -rate * half_width)
    return velocity, degrees(side * rate)


def full_travel(world: World, fallen_names: Collection[str]) -> Array:
    """Return the displacement (N,) of the full score for each body, as a share."""
    is_free = []
    for body in world.bodies:
        is_free.append(body.radius is not None or body.name in fallen_names)
    return np.where(np.array(is_free, bool), TRIAL.full_travel, TRIAL.slide)


def climbs(trials: TrialScene, world: World, motion: Trajectory) -> bool:
    """Check whether a moving body rises by much: objects stay on their supports."""
    if trials.scene.world.view is not View.SIDE:
        return False
    for k, body in enumerate(world.bodies):
        # Rows count downwards: the largest one is the lowest point of a body.
        lowest_rows = _transform_points(_corners(body), motion.poses[:, k])[..., 1].max(
            axis=1
        )
        _, height = measure_extent(body)
        if lowest_rows[0] - lowest_rows.min() > TRIAL.rise * height:
            return True
    return False


def overhangs(trials: TrialScene, world: World, motion: Trajectory) -> bool:
    """Check whether a moved body ends beyond the end of its support."""
    tolerance = TRIAL.edge * trials.side
    ends = []
    for wall in world.walls:
        for chain in wall.chains:
            for k in (0, -1):
                ends.append(chain[k])
    for k, body in enumerate(world.bodies):
        if np.hypot(*(motion.poses[-1, k, :2] - motion.poses[0, k, :2])) < tolerance:
            continue
        places = _transform_points(_corners(body), motion.poses[-1:, k])[0]
        foot = places[:, 1].max()
        left = places[:, 0].min()
        right = places[:, 0].max()
        # An end of a wall below the body, away from both of its sides, is an edge under
        # it.
        for x, y in ends:
            if abs(y - foot) < tolerance and left + tolerance < x < right - tolerance:
                return True
    return False


def crowds_border(trials: TrialScene, world: World, motion: Trajectory) -> bool:
    """Check whether a body ends at the border, and closer to it than at the start."""
    smallest_gap = TRIAL.border * trials.side
    size = np.array(world.size, np.float64)
    for k, body in enumerate(world.bodies):
        if body.motion is not Motion.DYNAMIC:
            continue
        places = _transform_points(_corners(body), motion.poses[[0, -1], k])
        gaps = np.minimum(places, size - places).min(axis=(1, 2))
        # A body that begins at the border may stay there.
        if gaps[1] < min(smallest_gap, gaps[0] - 1):
            return True
    return False


def explodes(trials: TrialScene, motion: Trajectory, speed: float) -> bool:
    """Check whether a body is faster than a push and a fall over the photo explain."""
    if len(motion.times) < 2:
        return False
    steps = np.diff(motion.poses[..., :2], axis=0)
    lengths = np.hypot(*np.moveaxis(steps, -1, 0))
    # Samples are even and begin at 0: the second time is their step.
    fastest = float(lengths.max(initial=0.0)) / float(motion.times[1])
    # The speed after a fall over the photo's longer side.
    fall = sqrt(2 * hypot(*trials.world.gravity) * trials.side)
    return fastest > TRIAL.wild * (speed + fall)


def returns(motion: Trajectory, name: str, velocity: Sequence[float]) -> bool:
    """Check whether an object goes back farther than it went forward."""
    index = motion.names.index(name)
    displacements = motion.poses[:, index, :2] - motion.poses[0, index, :2]
    # The path along the push, in any unit: only its two ends are compared.
    distances = displacements @ np.array(velocity, np.float64)
    return bool(-distances.min() > distances.max())


def throws(
    trials: TrialScene, motion: Trajectory, name: str, velocity: Sequence[float]
) -> bool:
    """Check whether an object rebounds from an invisible wall."""
    if not any(velocity):
        return False
    index = motion.names.index(name)
    direction = np.array(velocity, np.float64)
    stopped_mass = _stopped_mass(motion, index, direction, trials.unseen)
    return stopped_mass > TRIAL.momentum_share * trials.world.bodies[index].mass


def _stopped_mass(
    motion: Trajectory, index: int, velocity: Array, unseen: Collection[str]
) -> float:
    """Return the mass, g, with the momentum that `unseen` walls take; friction takes
    none.
    """
    _, first, second = motion.contacts.impulse_rows.T
    is_wall = np.isin(motion.contacts.surfaces, list(unseen))
    # An object may have the name of a wall.
    is_wall[: len(motion.names)] = False
    impulses = motion.contacts.impulses[(first == index) & is_wall[second]]
    # Impulses more across than against the velocity come from a slide along the wall.
    backward_parts = -impulses @ velocity
    side_parts = np.abs(cross(velocity, impulses))
    return float(
        (backward_parts * (backward_parts > side_parts)).sum() / (velocity @ velocity)
    )
