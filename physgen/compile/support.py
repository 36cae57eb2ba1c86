"""Warnings about objects without support."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physgen.compile.compile import Compiled, warning
from physgen.compile.world import Body, Wall
from physgen.geometry.convex import overlap_depth
from physgen.geometry.polygon import Disc, Outline, bounds, translated_outline
from physgen.problems import Problem
from physgen.scene.scene import Load, Motion, Scene, View

Array = NDArray[np.float64]

REACH = 4.0
"""px below an object in which its support must lie; outlines and floors of photos are off by as much."""
PARTS = (1.0, 0.75, 0.5, 0.25, 0.125)
"""Of that way, at which it is tried; 0.5 px is less than any object's height."""


def unsupported(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Objects of a photo that fall at once, and objects of any scene with something to land on that miss it all."""
    if scene.world.view is View.TOP or not compiled.world.gravity.any():
        return
    groups = _joined(scene)
    lines = WallSegments(compiled.world.walls)
    hanging = set(_hanging(scene, compiled, groups, lines)) if scene.image is not None else set()
    for i in sorted(hanging):
        item = scene.objects[i]
        expected = "is supported by nothing and falls at once"
        fix = "put a boundary under it, hold it with a joint, or write motion: static"
        yield warning(scene, f"objects.{item.name}", item.name, expected, fix)
    for i in _never_landing(scene, compiled, groups, lines):
        item = scene.objects[i]
        if i not in hanging:
            expected = "falls for ever: nothing lies below its path"
            fix = "put a boundary under it, hold it with a joint, or write motion: static"
            yield warning(scene, f"objects.{item.name}", item.name, expected, fix)


def _joined(scene: Scene) -> list[set[int]]:
    """The dynamic objects that joints hold together; those that are held to what does not fall are left out."""
    index = {item.name: k for k, item in enumerate(scene.objects)}
    root = list(range(len(scene.objects) + 1))
    fixed = len(scene.objects)  # the world, and all that stands in it

    def find(k: int) -> int:
        while root[k] != k:
            root[k] = k = root[root[k]]
        return k

    for k, item in enumerate(scene.objects):
        if item.motion is not Motion.DYNAMIC:
            root[k] = fixed
    for joint in scene.joints:
        ends = [index[name] for name in joint.objects]
        root[find(ends[0])] = find(ends[1] if len(ends) == 2 else fixed)
    groups: dict[int, set[int]] = {}
    for k in range(len(scene.objects)):
        if find(k) != find(fixed):
            groups.setdefault(find(k), set()).add(k)
    return list(groups.values())


def _hanging(scene: Scene, compiled: Compiled, groups: list[set[int]], lines: WallSegments) -> Iterator[int]:
    """Objects at rest with nothing under them or under what they are joined to."""
    gravity = compiled.world.gravity
    step = gravity / float(np.hypot(*gravity)) * REACH
    boxes = np.array([bounds(outline) for outline in compiled.outlines]).reshape(-1, 4)

    def rests(i: int) -> bool:
        lowered = translated_outline(compiled.outlines[i], step)
        x0, y0, x1, y1 = bounds(lowered)
        near = np.flatnonzero(
            (boxes[:, 0] < x1) & (boxes[:, 2] > x0) & (boxes[:, 1] < y1) & (boxes[:, 3] > y0)
        )
        if any(j != i and overlap_depth(lowered, compiled.outlines[j]) > 0 for j in near.tolist()):
            return True
        # what is thinner than the step would be past the line under it
        return any(lines.across(compiled.world.bodies[i], step * part) for part in PARTS)

    for group in groups:
        if not any(map(rests, group)):
            yield from (i for i in group if not any(scene.objects[i].velocity))


@dataclass(frozen=True)
class _Below:
    """What could be landed on, as boxes in the frame of gravity: across it and along it, px; larger is lower."""

    low: Array
    """(M, 2): least across and along."""
    high: Array
    """(M, 2): greatest."""
    middle: Array
    """(M,): along. Of what falls itself only the lower is landed on: else two side by side would hold each other.
    Infinite for walls and all that does not fall."""
    group: NDArray[np.intp]
    """(M,): what joints hold together has one number; -1 for walls and all that does not fall."""


def _never_landing(
    scene: Scene, compiled: Compiled, groups: list[set[int]], lines: WallSegments
) -> Iterator[int]:
    """Objects whose ballistic path, over the clip, meets nothing and ends where nothing is below."""
    world = compiled.world
    if not len(lines.start) and not any(item.motion is Motion.STATIC for item in scene.objects):
        return  # a lesson in the open: objects fall on purpose
    strength = float(np.hypot(*world.gravity))
    down = world.gravity / strength
    frame = np.array([[-down[1], down[0]], down])  # rows: across gravity, along it
    boxes = np.array([_box(outline, frame) for outline in compiled.outlines]).reshape(-1, 2, 2)
    below = _below(compiled, groups, lines, frame, boxes)
    spans = Intervals(below.low[:, 0], below.high[:, 0])
    steered, speeds = _steered(scene), _start_velocities(compiled) @ frame.T
    for number, group in enumerate(groups):
        if steered & group:
            continue
        for i in sorted(group):
            way = speeds[i, 0] * world.duration
            near = spans.meeting(boxes[i, 0, 0] + min(way, 0.0), boxes[i, 1, 0] + max(way, 0.0))
            counted = (below.group[near] != number) & (below.middle[near] > boxes[i, :, 1].mean())
            near = near[counted]
            if _lands(boxes[i], speeds[i], strength, world.duration, below.low[near], below.high[near]):
                break
        else:
            yield from group


def _below(
    compiled: Compiled, groups: list[set[int]], lines: WallSegments, frame: Array, boxes: Array
) -> _Below:
    """Walls and objects, scripted ones wherever they go."""
    boxes = boxes.copy()
    group = np.full(len(boxes), -1, np.intp)
    for number, members in enumerate(groups):
        group[sorted(members)] = number
    middle = np.full(len(boxes), np.inf)
    for k, body in enumerate(compiled.world.bodies):
        if body.motion is Motion.DYNAMIC:
            middle[k] = boxes[k, :, 1].mean()
        swept = (body.path[:, 1:3] - body.center) @ frame.T
        if len(swept):
            boxes[k] = np.stack([boxes[k, 0] + swept.min(axis=0), boxes[k, 1] + swept.max(axis=0)])
    start, end = lines.start @ frame.T, lines.end @ frame.T
    return _Below(
        low=np.concatenate([np.minimum(start, end), boxes[:, 0]]),
        high=np.concatenate([np.maximum(start, end), boxes[:, 1]]),
        middle=np.concatenate([np.full(len(start), np.inf), middle]),
        group=np.concatenate([np.full(len(start), -1, np.intp), group]),
    )


def _lands(box: Array, speed: Array, strength: float, duration: float, low: Array, high: Array) -> bool:
    """Whether a box (2, 2) in free fall meets one of those from `low` to `high`, or ends the clip above one."""
    begin, end = np.zeros(len(low)), np.full(len(low), duration)
    if speed[0] == 0:
        end[(low[:, 0] > box[1, 0]) | (high[:, 0] < box[0, 0])] = -1.0
    else:
        times = np.stack([low[:, 0] - box[1, 0], high[:, 0] - box[0, 0]]) / speed[0]
        begin, end = np.maximum(begin, times.min(axis=0)), np.minimum(end, times.max(axis=0))

    def fallen(time: Array) -> Array:
        return np.asarray(speed[1] * time + strength * time**2 / 2)

    top = box[0, 1] + fallen(np.clip(-speed[1] / strength, begin, np.maximum(begin, end)))
    bottom = box[1, 1] + np.maximum(fallen(begin), fallen(end))
    above = (begin <= end) & (top <= high[:, 1])
    return bool((above & ((bottom >= low[:, 1]) | (end >= duration))).any())


def _box(outline: Outline, frame: Array) -> Array:
    """(2, 2): least and greatest across and along gravity."""
    if isinstance(outline, Disc):
        center = frame @ outline.center
        return np.stack([center - outline.radius, center + outline.radius])
    points = np.concatenate([ring.outer for ring in outline.rings]) @ frame.T
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _steered(scene: Scene) -> set[int]:
    """Objects whose path is not ballistic: something pushes or draws them on the way."""
    index = {item.name: k for k, item in enumerate(scene.objects)}
    pushed = {
        index[force.object]
        for force in scene.forces
        if force.load is Load.FORCE or (force.load is Load.IMPULSE and force.start > 0)
    }
    for field in scene.fields:
        pushed |= {index[name] for name in field.objects} if field.objects else set(index.values())
    return pushed


def _start_velocities(compiled: Compiled) -> Array:
    """(N, 2) px/s after the impulses at t = 0."""
    bodies = compiled.world.bodies
    velocity = np.array([body.velocity for body in bodies]).reshape(-1, 2)
    for push in compiled.world.pushes:
        if push.load is Load.IMPULSE and push.start == 0:
            velocity[push.body] += push.vector / bodies[push.body].mass
    return velocity


class Intervals:
    """Intervals of a line, found by where they lie."""

    def __init__(self, low: Array, high: Array) -> None:
        self._order = np.argsort(low, kind="stable")
        self._low = low[self._order]
        self._reach = np.maximum.accumulate(high[self._order])  # of all up to here

    def meeting(self, low: float, high: float) -> NDArray[np.intp]:
        """Indices of those that meet the interval from `low` to `high`, and of some that do not."""
        first = np.searchsorted(self._reach, low, "left")
        return self._order[first : np.searchsorted(self._low, high, "right")]


class WallSegments:
    """The segments of all walls, found by where they lie."""

    def __init__(self, walls: Sequence[Wall]) -> None:
        chains = [(k, chain) for k, wall in enumerate(walls) for chain in wall.chains]
        none = np.zeros((0, 2))
        self.start = np.concatenate([none, *(chain[:-1] for _, chain in chains)])
        self.end = np.concatenate([none, *(chain[1:] for _, chain in chains)])
        self.wall = np.repeat([k for k, _ in chains], [len(chain) - 1 for _, chain in chains]).astype(np.intp)
        self._low, self._high = np.minimum(self.start, self.end), np.maximum(self.start, self.end)
        self._spans = Intervals(self._low[:, 0], self._high[:, 0])

    def across(self, body: Body, by: Array | None = None) -> dict[int, float]:
        """Index of every wall that a body, moved by `by` (2,) px, reaches across, and how far, px."""
        points = _extremes(body) + body.center + (0.0 if by is None else by)
        (left, top), (right, bottom) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        near = self._spans.meeting(left, right)
        near = near[(self._low[near, 1] <= bottom) & (self._high[near, 1] >= top)]
        deepest: dict[int, float] = {}
        for k in sorted(near.tolist()):
            depth = _sunk(body, self.start[k], self.end[k], by)
            wall = int(self.wall[k])
            if depth > deepest.get(wall, 0.0):
                deepest[wall] = depth
        return deepest


def _extremes(body: Body) -> Array:
    if body.radius is not None:
        return np.array([[-body.radius, -body.radius], [body.radius, body.radius]])
    return np.concatenate(body.pieces)


def _sunk(body: Body, a: Array, b: Array, by: Array | None) -> float:
    """How far a body reaches across the segment from a to b, px; 0 when it does not touch."""
    center = body.center if by is None else body.center + by
    along = b - a
    length = float(np.hypot(*along))
    if length == 0:
        return 0.0
    along = along / length
    if body.radius is not None:
        at = float(np.clip((center - a) @ along, 0, length))
        return max(0.0, body.radius - float(np.hypot(*(center - a - at * along))))
    across = np.array([-along[1], along[0]])
    places = (piece + center - a for piece in body.pieces)
    return max(_across(points @ along, points @ across, length) for points in places)


def _across(x: Array, y: Array, length: float) -> float:
    """How far a convex piece lies on both sides of the segment y = 0, 0 <= x <= length, within that length, px."""
    ends = [(x, y), (np.roll(x, -1), np.roll(y, -1))]
    heights = [y[(x >= 0) & (x <= length)]]
    for at in (0.0, length):  # where edges cross the segment's ends
        (x0, y0), (x1, y1) = ends
        cut = (x0 < at) != (x1 < at)
        heights.append(y0[cut] + (at - x0[cut]) / (x1[cut] - x0[cut]) * (y1[cut] - y0[cut]))
    inside = np.concatenate(heights)
    if not len(inside):
        return 0.0
    return max(0.0, float(min(inside.max(), -inside.min())))
