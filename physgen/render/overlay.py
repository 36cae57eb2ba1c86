"""Frames + World + Trajectory -> the same frames with outlines, arrows, trails, contacts and names drawn over them.

Drawn last, at the size of the output: `lens` says where a frame shows the photo's pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.geometry import rotation
from physgen.render.ink import Layer
from physgen.render.key import emptiest_corner, write_key
from physgen.render.labels import staggered, write_name
from physgen.render.marks import arc, circle, curved_arrow, ring, straight_arrow
from physgen.render.scales import COLOURS, Entry, Scales, key, scales
from physgen.render.sheet import Sheet
from physgen.render.stage import Frame
from physgen.render.touches import Blow, between, blows, moments
from physgen.scene.model import Load, Motion, Overlay, Solid, View
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]
Lens = Callable[[Frame], Array]
"""Frame -> (2, 3): photo px (x, y, 1) -> px of the frame."""

FINER = 8
"""Times a frame that trails and blows are looked at."""
MOST = 2_000_000
"""Samples times objects of such a closer look."""
FLASH = 8
"""Frames for which a blow, or a push of no duration, is shown; at most a sixth of the clip."""
FADE = 0.5
"""Of the clip: how long a trail takes to fade to its least."""
FAINT = 0.4
STILL = 2.0
"""px: shorter arrows, and trails of what moves no farther, are not drawn."""


@dataclass(frozen=True)
class Clip:
    """What all frames of a clip share."""

    world: World
    seen: Trajectory
    """With samples enough for what is drawn."""
    blows: list[Blow]
    scales: Scales
    key: list[Entry]
    corner: tuple[int, int]
    """Where the key stands: 1 right, 1 bottom."""
    flash: float
    """s."""
    lines: tuple[int, ...]
    """By how many lines each name stands below its centre."""


def photo(frame: Frame) -> Array:
    """The lens of frames that show the photo as it is."""
    return np.eye(2, 3)


def annotated(
    frames: Iterator[Frame],
    world: World,
    trajectory: Trajectory,
    kinds: Collection[Overlay],
    lens: Lens = photo,
) -> Iterator[Frame]:
    """Frames with overlays of `kinds`. A frame's own time says what is drawn: they may come in any order.

    `trajectory` has samples at those times. Trails and blows need more: the world is then run again, to the same
    motion.
    """
    if not kinds:
        yield from frames
        return
    clip = filmed(world, trajectory, kinds)
    for frame in frames:
        rgb = frame.rgb.copy()
        sheet = sheet_of(clip, frame, lens(frame))
        for kind in (kind for kind in DRAW if kind in kinds):
            layer = sheet.layer()
            DRAW[kind](clip, sheet, layer)
            layer.onto(rgb, COLOURS[kind])
        if clip.key:
            write_key(rgb, sheet, clip.key, clip.corner)
        yield replace(frame, rgb=rgb)


def filmed(world: World, trajectory: Trajectory, kinds: Collection[Overlay]) -> Clip:
    """A clip's blows, scales and key."""
    seen, found = trajectory, list[Blow]()
    if world.bodies and len(trajectory.times) > 1 and {Overlay.TRAILS, Overlay.CONTACTS} & set(kinds):
        seen = simulate(world, moments(trajectory, FINER, MOST // len(world.bodies)))
    if Overlay.CONTACTS in kinds:
        found = blows(world, seen, world.duration / max(len(world.times), 1) / FINER)
    scale = scales(world, trajectory, kinds, [blow.impulse for blow in found])
    flash = min(FLASH * world.duration / max(len(world.times), 1), world.duration / 6)
    entries, whole = key(world, scale, kinds), Sheet(world.size, 1.0, np.eye(2, 3), 0.0, 0)
    corner = emptiest_corner(world, trajectory, whole, entries) if entries else (0, 0)
    return Clip(world, seen, found, scale, entries, corner, flash, staggered(world, whole))


def sheet_of(clip: Clip, frame: Frame, lens: Array) -> Sheet:
    """A frame's paper."""
    times, size = clip.seen.times, (frame.rgb.shape[1], frame.rgb.shape[0])
    sample = int(np.abs(times - frame.time).argmin()) if len(times) else 0
    return Sheet(size, max(size) / max(clip.world.size), np.asarray(lens, np.float64), frame.time, sample)


def _poses(clip: Clip, sheet: Sheet) -> Array:
    """(N, 3) px, px, rad, now."""
    return np.asarray(clip.seen.poses[sheet.sample])


def _boundaries(clip: Clip, sheet: Sheet, layer: Layer) -> None:
    for wall in clip.world.walls:
        for chain in wall.chains:
            layer.line(sheet.at(chain), 1.2 * sheet.pen)


def _trails(clip: Clip, sheet: Sheet, layer: Layer) -> None:
    """Where centres have been by now."""
    times = clip.seen.times[: sheet.sample + 1]
    if len(times) < 2:
        return
    age = (sheet.time - times[1:]) / max(FADE * clip.world.duration, 1e-9)
    strengths = np.clip(1 - (1 - FAINT) * age, FAINT, 1)
    for path in np.moveaxis(clip.seen.poses[: sheet.sample + 1, :, :2], 1, 0):
        if np.ptp(path, axis=0).max() > STILL:
            kept = _apart(path)
            points = sheet.at(path[kept])
            layer.segments(points[:-1], points[1:], sheet.pen, strengths[kept[1:] - 1])


def _apart(path: Array) -> NDArray[np.int64]:
    """Which points of a path (K, 2) px to draw: no two within a pixel, corners and the last among them."""
    steps = np.diff(path, axis=0)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
    crosses = np.diff(np.floor(way), prepend=-1.0) > 0
    turns = np.zeros(len(path), bool)
    dot = (steps[1:] * steps[:-1]).sum(axis=1)
    turns[1:-1] = dot < 0.9 * np.hypot(*steps[1:].T) * np.hypot(*steps[:-1].T)
    crosses |= turns
    crosses[-1] = True
    return np.flatnonzero(crosses)


def _outlines(clip: Clip, sheet: Sheet, layer: Layer) -> None:
    """Shapes where they are now; a circle has a tick that shows how far it has turned."""
    for body, (x, y, angle) in zip(clip.world.bodies, _poses(clip, sheet).tolist(), strict=True):
        turn = rotation(angle)
        rings = list(body.rings)
        if body.radius is not None:
            rings = [circle((0.0, 0.0), body.radius * sheet.zoom) / sheet.zoom]
            if not (clip.world.view is View.TOP and body.solid is Solid.SPHERE):
                tick = np.array([[0.72, 0.0], [1.0, 0.0]]) * body.radius
                layer.line(sheet.at(tick @ turn.T + (x, y)), sheet.pen)
        for points in rings:
            layer.line(sheet.at(points @ turn.T + (x, y)), sheet.pen, closed=True)


def _velocities(clip: Clip, sheet: Sheet, layer: Layer) -> None:
    ways = clip.scales.velocity * clip.seen.velocities[sheet.sample, :, :2]
    for pose, way in zip(_poses(clip, sheet), ways, strict=True):
        _arrow(sheet, layer, pose[:2], way)


def _weights(clip: Clip, sheet: Sheet, layer: Layer) -> None:
    for body, pose in zip(clip.world.bodies, _poses(clip, sheet), strict=True):
        if body.motion is Motion.DYNAMIC:
            _arrow(sheet, layer, pose[:2], clip.scales.force * body.mass * clip.world.gravity)


def _forces(clip: Clip, sheet: Sheet, layer: Layer) -> None:
    """The scene's pushes while they act; an impulse from when it is given, for a moment."""
    for push in clip.world.pushes:
        body, (x, y, angle) = clip.world.bodies[push.body], _poses(clip, sheet)[push.body].tolist()
        end = push.start + clip.flash if push.load is Load.IMPULSE else push.end
        if body.motion is not Motion.DYNAMIC or not push.start - 1e-9 <= sheet.time < end - 1e-9:
            continue
        at = np.array([x, y]) + rotation(angle) @ push.at
        if push.load is Load.TORQUE:
            radius = min(1.25 * body.reach, 0.2 * max(clip.world.size))
            sweep = clip.scales.torque * push.torque
            if abs(sweep) * radius * sheet.zoom >= STILL:
                curved_arrow(layer, sheet.at(arc(np.array([x, y]), radius, sweep)), sheet.pen)
        elif push.load is Load.IMPULSE:
            left = _left(clip, sheet, push.start)
            _arrow(sheet, layer, at, clip.scales.impulse * push.vector, left, struck=True)
        else:
            _arrow(sheet, layer, at, clip.scales.force * push.vector)


def _arrow(
    sheet: Sheet, layer: Layer, at: Array, way: Array, strength: float = 1.0, *, struck: bool = False
) -> None:
    """From a point (2,) of the photo, as long as `way` (2,) px of the photo."""
    tail, along = sheet.at(at), sheet.way(way)
    if np.hypot(*along) >= STILL:
        straight_arrow(layer, tail, tail + along, sheet.pen, strength, struck=struck)


def _left(clip: Clip, sheet: Sheet, since: float) -> float:
    """Strength 1..0 of what is shown for a moment: full at first, then less."""
    return float(np.clip(1.6 * (1 - (sheet.time - since) / clip.flash), 0.0, 1.0))


def _contacts(clip: Clip, sheet: Sheet, layer: Layer) -> None:
    """A dot wherever things touch now, a ring where a blow fell a moment ago; its area tells the impulse."""
    contacts, now = clip.seen.contacts, sheet.time + 1e-9
    lasting = (contacts.touch_times[:, 0] <= now) & (contacts.touch_times[:, 1] >= sheet.time)
    for first, second in contacts.touch_pairs[lasting].tolist():
        points, gap = between(clip.world, _poses(clip, sheet), first, second)
        if gap < STILL:
            for point in sheet.at(points):
                layer.area(circle(point, 1.5 * sheet.pen))
    shown = [blow for blow in clip.blows if blow.time <= now < blow.time + clip.flash]
    for blow in shown:
        radius = _radius(clip, blow)
        if radius * sheet.unit > STILL and not any(_swallows(clip, other, blow) for other in shown):
            left = _left(clip, sheet, blow.time)
            ring(layer, sheet.at(blow.at), radius * sheet.unit, sheet.pen, left)


def _radius(clip: Clip, blow: Blow) -> float:
    """px of a blow's ring."""
    return float(np.sqrt(clip.scales.ring * blow.impulse))


def _swallows(clip: Clip, strong: Blow, weak: Blow) -> bool:
    """Whether a blow is but an echo of another, of the same two things at the same place."""
    same = strong is not weak and strong.pair == weak.pair and strong.impulse > weak.impulse
    return same and float(np.hypot(*(strong.at - weak.at))) < _radius(clip, strong)


def _names(clip: Clip, sheet: Sheet, layer: Layer) -> None:
    for body, pose, line in zip(clip.world.bodies, _poses(clip, sheet), clip.lines, strict=True):
        middle = sheet.at(pose[:2])
        if sheet.sees(middle):
            write_name(layer, sheet, body, (float(middle[0]), float(middle[1])), line)


DRAW: Mapping[Overlay, Callable[[Clip, Sheet, Layer], None]] = {
    Overlay.BOUNDARIES: _boundaries,
    Overlay.TRAILS: _trails,
    Overlay.OUTLINES: _outlines,
    Overlay.WEIGHT: _weights,
    Overlay.FORCES: _forces,
    Overlay.VELOCITY: _velocities,
    Overlay.CONTACTS: _contacts,
    Overlay.NAMES: _names,
}
"""In the order in which they are drawn: the last lies on top."""
