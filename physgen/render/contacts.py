"""Contact points of two bodies at a pose, and the impacts of a clip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physgen.arrays import Indices
from physgen.compile.world import World
from physgen.geometry.polygon import Array, rotation
from physgen.scene.scene import Motion
from physgen.simulate.trajectory import Trajectory


@dataclass(frozen=True)
class ImpactTuning:
    """Thresholds between impacts and lasting contacts."""

    slack: float = 0.15
    gap_tolerance: float = 0.75
    """Tolerance of the gap at other points of a contact than the nearest, px: of
    circles, and of faces, whose corners may be slightly rounded or tilted."""
    point_distance: float = 3.0
    """Distance below which two points of a contact are one, px."""
    least_share: float = 0.7
    loud: float = 3.0
    """Thresholds for the rise of a push, in units of the momentum that gravity gives
    the lighter partner: for an impact that changes the motion of a partner, and for one
    that is passed on."""
    push_ratio: float = 1.5
    """Threshold in units of the lasting push: a solver distributes pushes unevenly."""
    after: int = 3
    """Number of later spans in which a lasting push must continue."""
    steps: int = 4
    """Minimum number of engine steps in a span of summed pushes."""


IMPACT = ImpactTuning()


@dataclass(frozen=True)
class Impact:
    """A sudden push between two objects."""

    time: float
    """Time, s."""
    place: Array
    """Place, (2,) px of the photo."""
    impulse: float
    """Size of the impulse, g·px/s."""
    way: Array
    """Unit vector (2,) of the push by the second of the pair on the first."""
    pair: tuple[int, int]
    """Indices of the two surfaces in `World.surfaces`."""


def sample_times(trajectory: Trajectory, finer: int, limit: int) -> Array:
    """Return times (K,) s: those of the trajectory, finer ones, and the starts of
    touches.

    They are `finer` times as dense, if that gives at most `limit` samples.
    """
    times = np.unique(trajectory.times)
    parts = max(1, min(finer, limit // len(times)))
    shares = np.arange(parts) / parts
    finer_times = times[:-1, None] + np.diff(times)[:, None] * shares
    starts = trajectory.contacts.touch_times[:limit, 0]
    starts = starts[starts <= times[-1]]
    return np.unique(np.concatenate([times, finer_times.ravel(), starts]))


@dataclass(frozen=True)
class _Pushes:
    """Impulses of a clip, summed for each pair of surfaces and each span of time."""

    keys: NDArray[np.int64]
    """Rising keys, (K,); keys of one pair in consecutive spans are consecutive."""
    group: Indices
    """Index in `keys` of each impulse, (I,)."""
    pairs: NDArray[np.int64]
    """Surfaces, (K, 2)."""
    spans: NDArray[np.int64]
    """Number of the span, (K,)."""
    impulses: Array
    """Sums of impulses, (K, 2) g·px/s."""

    impulse_sizes: Array
    """Size of each single impulse, (I,) g·px/s."""

    @cached_property
    def sizes(self) -> Array:
        """Return (K,) the sizes of the impulses, g·px/s."""
        return np.asarray(np.hypot(*self.impulses.T))

    def sizes_later(self, count: int) -> Array:
        """Return the sizes (K,) of the same pairs' sums `count` spans later, g·px/s.

        0 for pairs without contact.
        """
        places = np.searchsorted(self.keys, self.keys + count)
        places = np.minimum(places, len(self.keys) - 1)
        is_same_pair = self.keys[places] == self.keys + count
        return np.where(is_same_pair, self.sizes[places], 0.0)


def find_impacts(world: World, motion: Trajectory, span: float) -> list[Impact]:
    """Find all impacts, sorted by time; pushes are summed over about `span` s.

    `motion` has samples at the starts of touches. A push that lasts, before or after,
    is no impact.
    """
    if not len(motion.contacts.impulse_rows):
        return []
    span = max(span, IMPACT.steps / world.steps_per_second)
    pushes = _sum_pushes(motion, span)
    later_sizes = [pushes.sizes_later(k + 1) for k in range(IMPACT.after)]
    lasting_sizes = np.maximum(pushes.sizes_later(-1), np.min(later_sizes, axis=0))
    impacts: list[Impact] = []
    last_key = -2
    for k in _sudden_pushes(world, motion, pushes, lasting_sizes, span):
        size = float(pushes.sizes[k] - lasting_sizes[k])
        key = int(pushes.keys[k])
        if key == last_key + 1:
            # A single impact on the border of two spans.
            total = impacts[-1].impulse + size
            impacts[-1] = replace(impacts[-1], impulse=total)
        else:
            impacts.append(_impact(world, motion, pushes, k, size))
        last_key = key
    return sorted(impacts, key=lambda impact: impact.time)


def _sum_pushes(motion: Trajectory, span: float) -> _Pushes:
    """Sum the impulses of a clip by pairs of surfaces and spans of time."""
    contacts = motion.contacts
    rows = contacts.impulse_rows.astype(np.int64)
    surfaces = len(contacts.surfaces)
    ends = np.ceil(motion.times[rows[:, 0]] / span - 1e-9).astype(np.int64)
    spans = np.maximum(ends - 1, 0)
    # Leave unused numbers after the last span, so that keys of two pairs are never
    # consecutive.
    count = int(spans.max()) + IMPACT.after + 2
    codes = (rows[:, 1] * surfaces + rows[:, 2]) * count + spans
    keys, group = np.unique(codes, return_inverse=True)
    sums = [np.bincount(group, part, len(keys)) for part in contacts.impulses.T]
    pairs = np.stack([keys // count // surfaces, keys // count % surfaces], axis=1)
    sizes = np.asarray(np.hypot(*contacts.impulses.T))
    impulses = np.asarray(np.stack(sums, axis=1), np.float64)
    return _Pushes(keys, group, pairs, keys % count, impulses, sizes)


def _sudden_pushes(
    world: World, motion: Trajectory, pushes: _Pushes, lasting: Array, span: float
) -> list[int]:
    """Return the indices of pushes that rise far above the `lasting` ones (K,)
    g·px/s.
    """
    mass = np.full(len(motion.contacts.surfaces), np.inf)
    for k, body in enumerate(world.bodies):
        if body.motion is Motion.DYNAMIC:
            mass[k] = body.mass
    lighter_masses = mass[pushes.pairs].min(axis=1)
    acceleration = max(float(np.hypot(*world.gravity)), world.press)
    weight = lighter_masses * acceleration * span
    sizes = pushes.sizes
    starts = np.asarray(pushes.spans * span, np.float64)
    speed_changes = _stir(world, motion, pushes.pairs, starts, span)
    # A body in a heap passes impacts on without much motion of its own: these count
    # only if they are louder.
    changes_motion = lighter_masses * speed_changes > sizes / 2
    threshold = np.where(changes_motion, IMPACT.least_share, IMPACT.loud) * weight
    rise = sizes - IMPACT.push_ratio * lasting
    is_sudden = np.isfinite(lighter_masses) & (rise > threshold + 1e-9 * lighter_masses)
    indices: list[int] = np.flatnonzero(is_sudden).tolist()
    return indices


def _impact(
    world: World, motion: Trajectory, pushes: _Pushes, k: int, size: float
) -> Impact:
    """Build the impact of a sudden push of `size` g·px/s, at the sample of its largest
    impulse.
    """
    contacts = motion.contacts
    members = np.flatnonzero(pushes.group == k)
    largest = members[np.argmax(pushes.impulse_sizes[members])]
    sample, first, second = contacts.impulse_rows[largest].tolist()
    points, gap = contact_points_between(world, motion.poses[sample], first, second)
    # Surfaces with a gap by now were in contact at the sample before.
    previous_sample = max(sample - 1, 0)
    points_before, gap_before = contact_points_between(
        world, motion.poses[previous_sample], first, second
    )
    if gap_before < gap - IMPACT.slack:
        sample, points = previous_sample, points_before
    direction = pushes.impulses[k] / pushes.sizes[k]
    time = float(motion.times[sample])
    place = points.mean(axis=0)
    return Impact(time, place, size, direction, (first, second))


def _stir(
    world: World,
    motion: Trajectory,
    pairs: NDArray[np.int64],
    starts: Array,
    span: float,
) -> Array:
    """Return the change of velocity of the faster of two surfaces (K, 2), (K,) px/s.

    It includes the speed of the rim by rotation.
    """
    bodies = len(world.bodies)
    samples = len(motion.times)
    # Compare the samples just before and just after the span of the contact.
    samples_before = np.searchsorted(motion.times, starts + 1e-9) - 1
    samples_before = np.maximum(samples_before, 0)
    samples_after = np.searchsorted(motion.times, starts + span - 1e-9)
    samples_after = np.minimum(samples_after, samples - 1)
    reach = np.array([body.reach for body in world.bodies])
    speed_changes = np.zeros(pairs.shape)
    for side in (0, 1):
        body = np.minimum(pairs[:, side], bodies - 1)
        difference = (
            motion.velocities[samples_after, body]
            - motion.velocities[samples_before, body]
        )
        x, y, spin = difference.T
        speed = np.hypot(x, y) + np.abs(spin) * reach[body]
        speed_changes[:, side] = np.where(pairs[:, side] < bodies, speed, 0.0)
    return np.asarray(speed_changes.max(axis=1))


def contact_points_between(
    world: World, poses: Array, first: int, second: int
) -> tuple[Array, float]:
    """Return the nearest points of two surfaces at poses (N, 3), and their distance,
    px.

    One or two points (K, 2) px; two are the ends of faces in contact. Surfaces are
    counted as in `World.surfaces`.
    """
    circle = _circle(world, poses, first)
    other_circle = _circle(world, poses, second)
    if circle is not None and other_circle is not None:
        return _between_circles(*circle, *other_circle)
    if circle is not None:
        return _below_circle(*circle, _edges(world, poses, second))
    if other_circle is not None:
        return _below_circle(*other_circle, _edges(world, poses, first))
    edges = _edges(world, poses, first)
    other_edges = _edges(world, poses, second)
    # The nearest points of two polygons include at least one corner.
    candidates = [
        _nearest(edges[:, 0], other_edges),
        _nearest(edges[:, 1], other_edges),
        _nearest(other_edges[:, 0], edges),
        _nearest(other_edges[:, 1], edges),
    ]
    points = np.concatenate([places for places, _ in candidates])
    gaps = np.concatenate([distances for _, distances in candidates])
    return _ends(points, gaps, IMPACT.gap_tolerance)


def _between_circles(
    center: Array, radius: float, other_center: Array, other_radius: float
) -> tuple[Array, float]:
    """Return the middle of the gap between two circles, (1, 2) px, and the gap, px."""
    offset = other_center - center
    distance = float(np.hypot(*offset))
    gap = distance - radius - other_radius
    direction = offset / max(distance, 1e-9)
    return (center + direction * (radius + gap / 2))[None], gap


def _below_circle(center: Array, radius: float, edges: Array) -> tuple[Array, float]:
    """Return the points of edges below a circle, and the least gap, px."""
    places, distances = _nearest(center[None], edges)
    return _ends(places, distances - radius, IMPACT.slack)


def _circle(world: World, poses: Array, surface: int) -> tuple[Array, float] | None:
    """Return centre (2,) px and radius px of a circle; None for other surfaces."""
    if surface >= len(world.bodies):
        return None
    radius = world.bodies[surface].radius
    return None if radius is None else (poses[surface, :2], radius)


def _edges(world: World, poses: Array, surface: int) -> Array:
    """Return (E, 2, 2) px: the two ends of each edge."""
    count = len(world.bodies)
    chains: Sequence[Array]
    if surface >= count:
        chains = world.walls[surface - count].chains
    else:
        x, y, angle = poses[surface]
        turn = rotation(float(angle))
        chains = []
        for ring in world.bodies[surface].rings:
            closed_ring = np.concatenate([ring, ring[:1]])
            chains.append(closed_ring @ turn.T + (x, y))
    edges = [np.stack([chain[:-1], chain[1:]], axis=1) for chain in chains]
    return np.concatenate(edges)


def _nearest(points: Array, edges: Array) -> tuple[Array, Array]:
    """Return the nearest places (P E, 2) px on edges to points, and the distances (P
    E,).
    """
    start = edges[:, 0]
    edge_vectors = edges[:, 1] - edges[:, 0]
    offset = points[:, None] - start
    length_squared = np.maximum((edge_vectors**2).sum(axis=-1), 1e-12)
    share = np.clip((offset * edge_vectors).sum(axis=-1) / length_squared, 0.0, 1.0)
    places = start + share[..., None] * edge_vectors
    x, y = np.moveaxis(points[:, None] - places, -1, 0)
    return places.reshape(-1, 2), np.hypot(x, y).ravel()


def _ends(points: Array, gaps: Array, slack: float) -> tuple[Array, float]:
    """Return the candidates (C, 2) px at the ends of a contact, and the least gap.

    `gaps` (C,) px.
    """
    smallest_gap = float(gaps.min())
    points = points[gaps <= smallest_gap + slack]
    middle = points.mean(axis=0)
    end = points[np.argmax(((points - middle) ** 2).sum(axis=1))]
    other_end = points[np.argmax(((points - end) ** 2).sum(axis=1))]
    if np.hypot(*(other_end - end)) < IMPACT.point_distance:
        return middle[None], smallest_gap
    return np.stack([end, other_end]), smallest_gap
