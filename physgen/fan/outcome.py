"""World + Trajectory -> what became of each body: whether it stays, moves, falls or leaves, and how."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import radians

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.geometry import polygon_moments
from physgen.scene.model import Motion, View
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int32]

TIPPED = radians(45)
"""From how it stood: beyond, a thing stands on another side."""
PART = 0.5
"""Of its size: what goes no farther stays, and what comes down by no more does not fall."""
STILL = 0.5
"""px within which a thing that has come to rest stays to the end."""
LAST = 0.1
"""Of the clip's time that it has to be at rest, at least."""
NEAR = 1.0
"""px by which two have moved at most when they touch, to have touched from the start."""


class Fate(IntEnum):
    """What becomes of a thing; where several hold, the largest."""

    STAYS = 0
    """It never goes farther from its place than half its size."""
    MOVES = 1
    LEAVES = 2
    """At the end, nothing of it is in the photo."""
    FALLS = 3
    """It tips over or drops."""


@dataclass(frozen=True)
class Outcome:
    """Of one run; B bodies."""

    fates: Index
    """(B,) numbers of `Fate`."""
    tips: Flags
    """(B,): turns by more than 45 degrees from how it stood; not of circles, nor of what a joint holds."""
    drops: Flags
    """(B,): gets lower than it was by more than half its size, and comes down as far in one go: through the air, or
    more steeply than at 45 degrees. What slides or rolls down a slope does not."""
    final: Array
    """(B, 3): px, px, rad at the end."""
    turned: Array
    """(B,) rad from how it stood, at most."""
    rests: Array
    """(B,) s since when it is at rest to the end; infinite where it is not."""
    first: Index
    """(B,): whom it touches first that it did not touch at t = 0, an index into `World.surfaces`; -1: nobody."""


def size(body: Body) -> float:
    """px: the diameter of a disc of its area, as `its size` is meant here."""
    if body.radius is not None:
        return 2 * body.radius
    area = sum(abs(polygon_moments(piece).area) for piece in body.pieces)
    return float(2 * np.sqrt(area / np.pi))


def outcome(world: World, run: Trajectory) -> Outcome:
    """What a run, sampled often, ends in."""
    start, final = run.poses[0], run.poses[-1]
    sizes = np.array([size(body) for body in world.bodies])
    away = np.hypot(*np.moveaxis(run.poses[:, :, :2] - start[:, :2], 2, 0)).max(axis=0)
    turned = np.abs(run.poses[:, :, 2] - start[:, 2]).max(axis=0)
    can = _can_fall(world)
    tips = can & (turned > TIPPED) & np.array([body.radius is None for body in world.bodies], bool)
    drops = can & _drops(world, run, PART * sizes)
    fates = np.where(away > PART * sizes, Fate.MOVES, Fate.STAYS)
    fates = np.where(_outside(world, final), Fate.LEAVES, fates)
    fates = np.where(tips | drops, Fate.FALLS, fates)
    return Outcome(fates.astype(np.int32), tips, drops, final, turned, _rests(run), _first(world, run))


def _can_fall(world: World) -> Flags:
    """Bodies that are free to fall: dynamic ones of a scene with gravity that no joint holds in the world."""
    free = np.array([body.motion is Motion.DYNAMIC for body in world.bodies], bool)
    if world.view is View.TOP or not world.gravity.any():
        return np.zeros(len(free), bool)
    held, more = ~free, True
    while more:  # what is joined to what is held is held
        more = False
        for joint in world.joints:
            ends = [joint.first] if joint.second is None else [joint.first, joint.second]
            if (joint.second is None or held[ends].any()) and not held[ends].all():
                held[ends] = more = True
    return np.asarray(free & ~held)


def _drops(world: World, run: Trajectory, least: Array) -> Flags:
    if not world.gravity.any() or len(run.times) < 2:
        return np.zeros(len(world.bodies), bool)
    down = world.gravity / np.hypot(*world.gravity)
    depth = (run.poses[:, :, :2] - run.poses[0, :, :2]) @ down
    across = (run.poses[:, :, :2] - run.poses[0, :, :2]) @ np.array([-down[1], down[0]])
    steep = np.diff(depth, axis=0) > np.abs(np.diff(across, axis=0))
    falling = steep | ~_touched(run)
    fallen = np.zeros(len(least), bool)
    top = depth[0]
    for k in range(1, len(depth)):
        top = np.where(falling[k - 1], np.minimum(top, depth[k]), depth[k])
        fallen |= (depth[k] - top > least) & (depth[k] > least)
    return fallen


def _touched(run: Trajectory) -> Flags:
    """(T - 1, B): whether a body touches anything between two samples."""
    count = len(run.names)
    found = np.zeros((len(run.times) - 1, count), bool)
    begins = np.searchsorted(run.times, run.contacts.touch_times[:, 0], side="right") - 1
    ends = np.searchsorted(run.times, run.contacts.touch_times[:, 1], side="left")
    for pair, begin, end in zip(
        run.contacts.touch_pairs.tolist(), begins.tolist(), ends.tolist(), strict=True
    ):
        for body in pair:
            if body < count:
                found[max(begin, 0) : end, body] = True
    return found


def _outside(world: World, poses: Array) -> Flags:
    """(B,): bodies of which nothing is on the canvas."""
    width, height = world.size
    reach = np.array([body.reach for body in world.bodies])
    x, y = poses[:, 0], poses[:, 1]
    out = (x + reach < -0.5) | (x - reach > width - 0.5) | (y + reach < -0.5) | (y - reach > height - 0.5)
    return np.asarray(out)


def _rests(run: Trajectory) -> Array:
    off = np.hypot(*np.moveaxis(run.poses[:, :, :2] - run.poses[-1, :, :2], 2, 0)) > STILL
    later = len(off) - np.argmax(off[::-1], axis=0)  # the sample after the last one that is off
    since = run.times[np.where(off.any(axis=0), np.minimum(later, len(off) - 1), 0)]
    return np.asarray(np.where(since <= (1 - LAST) * run.times[-1], since, np.inf))


def _first(world: World, run: Trajectory) -> Index:
    first = np.full(len(run.names), -1, np.int32)
    reach = np.array([body.reach for body in world.bodies])
    known: set[tuple[int, ...]] = set()
    begins = run.contacts.touch_times[:, 0]
    samples = np.maximum(np.searchsorted(run.times, begins, side="right") - 1, 0)
    for pair, sample in zip(
        run.contacts.touch_pairs.tolist(), samples.tolist(), strict=True
    ):  # by their begins
        if tuple(pair) in known:
            continue
        bodies = [one for one in pair if one < len(first)]
        off = run.poses[sample, bodies] - run.poses[0, bodies]
        if float((np.hypot(off[:, 0], off[:, 1]) + reach[bodies] * np.abs(off[:, 2])).sum()) < NEAR:
            known.add(tuple(pair))
            continue
        for one, other in (pair, pair[::-1]):
            if one < len(first) and first[one] < 0:
                first[one] = other
    return first
