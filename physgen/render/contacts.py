"""Contact points of two bodies at a pose, and the impacts of a clip."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.geometry.polygon import Array, rotation
from physgen.scene.scene import Motion
from physgen.simulate.trajectory import Trajectory


@dataclass(frozen=True)
class ImpactTuning:
    """Thresholds that tell impacts from lasting contacts."""

    slack: float = 0.15
    flat: float = 0.75
    """px by which points of one contact may be farther apart than its nearest: of circles, and of faces, whose corners
    may be a little rounded or tilted."""
    apart: float = 3.0
    """px between two points of a contact; nearer ones are one."""
    faint: float = 0.7
    loud: float = 3.0
    """Times what gravity gives the lighter partner meanwhile: rise of a push in an impact that changes the motion of
    either, and in one that they pass on."""
    uneven: float = 1.5
    """Times what has pressed before or goes on pressing: an impact is more, as a solver shares pushes out unevenly."""
    after: int = 3
    """Spans of time that it must go on."""
    steps: int = 4
    """Of the engine, at least, in which pushes are taken together."""


IMPACT = ImpactTuning()


@dataclass(frozen=True)
class Impact:
    """A sudden push between two objects."""

    time: float
    """s."""
    at: Array
    """(2,) px of the photo."""
    impulse: float
    """g·px/s."""
    way: Array
    """(2,) unit: where the second of the pair pushes the first."""
    pair: tuple[int, int]
    """The two surfaces, counted as in `World.surfaces`."""


def sample_times(trajectory: Trajectory, finer: int, most: int) -> Array:
    """(K,) s: the trajectory's times, `finer` times as many if that is at most `most`, and when touches begin."""
    times = np.unique(trajectory.times)
    parts = max(1, min(finer, most // len(times)))
    between = times[:-1, None] + np.diff(times)[:, None] * (np.arange(parts) / parts)
    begins = trajectory.contacts.touch_times[:most, 0]
    return np.unique(
        np.concatenate([times, between.ravel(), begins[begins <= times[-1]]])
    )


def find_impacts(world: World, seen: Trajectory, span: float) -> list[Impact]:
    """All impacts, by time; pushes are taken together over about `span` s. `seen` has samples when touches begin.

    What goes on pressing, before or after, is no impact.
    """
    contacts, span = seen.contacts, max(span, IMPACT.steps / world.steps_per_second)
    rows, S = contacts.impulse_rows.astype(np.int64), len(contacts.surfaces)
    if not len(rows):
        return []
    place = np.maximum(
        np.ceil(seen.times[rows[:, 0]] / span - 1e-9).astype(np.int64) - 1, 0
    )
    B = int(place.max()) + IMPACT.after + 2
    keys, group = np.unique(
        (rows[:, 1] * S + rows[:, 2]) * B + place, return_inverse=True
    )
    pushes = np.stack(
        [np.bincount(group, part, len(keys)) for part in contacts.impulses.T], axis=1
    )
    given = np.hypot(*pushes.T)
    lasting = np.maximum(
        _given(keys, given, -1),
        np.min([_given(keys, given, k + 1) for k in range(IMPACT.after)], axis=0),
    )
    pairs = np.stack([keys // B // S, keys // B % S], axis=1)
    dynamic = [body.motion is Motion.DYNAMIC for body in world.bodies]
    mass = np.full(S, np.inf)
    mass[: len(dynamic)] = np.where(
        dynamic, [body.mass for body in world.bodies], np.inf
    )
    light = mass[pairs].min(axis=1)
    weight = light * max(float(np.hypot(*world.gravity)), world.press) * span
    rise = given - IMPACT.uneven * lasting
    stirs = light * _stir(world, seen, pairs, keys % B * span, span) > given / 2
    sudden = np.isfinite(light) & (
        rise > np.where(stirs, IMPACT.faint, IMPACT.loud) * weight + 1e-9 * light
    )
    found: list[Impact] = []
    size = np.hypot(*contacts.impulses.T)
    last = -2
    for k in np.flatnonzero(sudden).tolist():
        push = float(given[k] - lasting[k])
        if keys[k] == last + 1:  # one impact, on the border of two spans
            found[-1] = replace(found[-1], impulse=found[-1].impulse + push)
        else:
            mine = np.flatnonzero(group == k)
            sample, first, second = rows[mine[np.argmax(size[mine])]].tolist()
            points, gap = contact_points_between(
                world, seen.poses[sample], first, second
            )
            before = max(
                sample - 1, 0
            )  # what meets and parts again has met at the sample before
            points_before, gap_before = contact_points_between(
                world, seen.poses[before], first, second
            )
            if gap_before < gap - IMPACT.slack:
                sample, points = before, points_before
            way = pushes[k] / given[k]
            found.append(
                Impact(
                    float(seen.times[sample]),
                    points.mean(axis=0),
                    push,
                    way,
                    (first, second),
                )
            )
        last = int(keys[k])
    return sorted(found, key=lambda impact: impact.time)


def _stir(
    world: World, seen: Trajectory, pairs: NDArray[np.int64], begins: Array, span: float
) -> Array:
    """(K,) px/s: by how much the velocity of either of two surfaces (K, 2) changes, its rim's as it turns included."""
    N, T = len(world.bodies), len(seen.times)
    before = np.maximum(np.searchsorted(seen.times, begins + 1e-9) - 1, 0)
    after = np.minimum(np.searchsorted(seen.times, begins + span - 1e-9), T - 1)
    reach = np.array([body.reach for body in world.bodies])
    change = np.zeros(pairs.shape)
    for side in (0, 1):
        bodies = np.minimum(pairs[:, side], N - 1)
        x, y, spin = (
            seen.velocities[after, bodies] - seen.velocities[before, bodies]
        ).T
        change[:, side] = np.where(
            pairs[:, side] < N, np.hypot(x, y) + np.abs(spin) * reach[bodies], 0.0
        )
    return np.asarray(change.max(axis=1))


def _given(keys: NDArray[np.int64], given: Array, later: int) -> Array:
    """(K,) g·px/s: what the same two gave each other so many spans later; `keys` rise, and end each pair with gaps."""
    at = np.searchsorted(keys, keys + later)
    there = keys[np.minimum(at, len(keys) - 1)] == keys + later
    return np.where(there, given[np.minimum(at, len(keys) - 1)], 0.0)


def contact_points_between(
    world: World, poses: Array, first: int, second: int
) -> tuple[Array, float]:
    """Where two surfaces are nearest at poses (N, 3): one or two points (K, 2) px, and how far apart, px.

    Surfaces are counted as in `World.surfaces`. Two points are the ends of faces that lie on each other.
    """
    one, other = _round(world, poses, first), _round(world, poses, second)
    if one is not None and other is not None:
        way = other[0] - one[0]
        far = float(np.hypot(*way))
        gap = far - one[1] - other[1]
        return (one[0] + way / max(far, 1e-9) * (one[1] + gap / 2))[None], gap
    if one is not None:
        return _disc(*one, _edges(world, poses, second))
    if other is not None:
        return _disc(*other, _edges(world, poses, first))
    edges, others = _edges(world, poses, first), _edges(world, poses, second)
    ways = [
        _nearest(edges[:, 0], others),
        _nearest(edges[:, 1], others),
        _nearest(others[:, 0], edges),
    ]
    ways.append(_nearest(others[:, 1], edges))
    points, gaps = (np.concatenate(part) for part in zip(*ways, strict=True))
    return _ends(points, gaps, IMPACT.flat)


def _disc(center: Array, radius: float, edges: Array) -> tuple[Array, float]:
    near, away = _nearest(center[None], edges)
    return _ends(near, away - radius, IMPACT.slack)


def _round(world: World, poses: Array, surface: int) -> tuple[Array, float] | None:
    """Centre (2,) px and radius px of a circle."""
    radius = world.bodies[surface].radius if surface < len(world.bodies) else None
    return None if radius is None else (poses[surface, :2], radius)


def _edges(world: World, poses: Array, surface: int) -> Array:
    """(E, 2, 2) px: the two ends of each edge."""
    N = len(world.bodies)
    if surface >= N:
        chains = world.walls[surface - N].chains
    else:
        x, y, angle = poses[surface]
        turn = rotation(float(angle))
        rings = world.bodies[surface].rings
        chains = tuple(
            np.concatenate([ring, ring[:1]]) @ turn.T + (x, y) for ring in rings
        )
    return np.concatenate(
        [np.stack([chain[:-1], chain[1:]], axis=1) for chain in chains]
    )


def _nearest(points: Array, edges: Array) -> tuple[Array, Array]:
    """For each point and edge, the edge's nearest place (P E, 2) px and its distance (P E,) px."""
    begin, way = edges[:, 0], edges[:, 1] - edges[:, 0]
    away = points[:, None] - begin
    along = (away * way).sum(axis=-1) / np.maximum((way**2).sum(axis=-1), 1e-12)
    near = begin + np.clip(along, 0.0, 1.0)[..., None] * way
    return near.reshape(-1, 2), np.hypot(
        *np.moveaxis(points[:, None] - near, -1, 0)
    ).ravel()


def _ends(points: Array, gaps: Array, slack: float) -> tuple[Array, float]:
    """Of candidates (C, 2) px with their gaps (C,) px, those at the ends of the contact, and the least gap."""
    least = float(gaps.min())
    points = points[gaps <= least + slack]
    middle = points.mean(axis=0)
    end = points[np.argmax(((points - middle) ** 2).sum(axis=1))]
    other = points[np.argmax(((points - end) ** 2).sum(axis=1))]
    if np.hypot(*(other - end)) < IMPACT.apart:
        return middle[None], least
    return np.stack([end, other]), least
