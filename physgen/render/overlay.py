"""Outlines, arrows, trails, contacts, names and a key, drawn over frames of output
size.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Push, World
from physgen.geometry.polygon import Array, rotation
from physgen.maps import U8
from physgen.render.contacts import (
    Impact,
    contact_points_between,
    find_impacts,
    sample_times,
)
from physgen.render.drawing import (
    CASING,
    Layer,
    arc,
    circle,
    curved_arrow,
    ring,
    straight_arrow,
    text_width,
)
from physgen.render.machines import field_lines, joint_lines
from physgen.render.scales import COLOURS, Entry, Scales, key_entries, scales
from physgen.render.stage import Frame
from physgen.scene.scene import Load, Motion, Overlay, Solid, View
from physgen.simulate.trajectory import Trajectory

PEN = 1 / 380
"""Width of a line, as a share of the picture's longer side."""
LETTER = 1 / 42
"""Size of a letter, as a share of the picture's longer side."""


@dataclass(frozen=True)
class Sheet:
    """One frame and its view of the photo."""

    size: tuple[int, int]
    """W, H px."""
    unit: float
    """Unit of arrows and rings: px of the frame per px of the whole photo."""
    lens: Array
    """Matrix (2, 3) from photo px (x, y, 1) to px of the frame."""
    time: float
    """Time, s."""
    sample: int
    """Index of the trajectory's sample."""

    @property
    def pen(self) -> float:
        """Return the width of a line, px."""
        return max(1.3, PEN * max(self.size))

    @property
    def letter(self) -> float:
        """Return the size of a letter, px."""
        return max(10.0, LETTER * max(self.size))

    @property
    def zoom(self) -> float:
        """Return the present px of the frame per px of the photo."""
        return float(np.sqrt(abs(np.linalg.det(self.lens[:, :2]))))

    def to_frame(self, points: Array) -> Array:
        """Convert points (..., 2) of the photo to px of the frame."""
        return np.asarray(points @ self.lens[:, :2].T + self.lens[:, 2])

    def way(self, vectors: Array) -> Array:
        """Convert vectors (..., 2) in px of the photo to px of the frame.

        Vectors are turned with the view but not zoomed, so that the key stays valid
        while a camera moves in.
        """
        return np.asarray(
            vectors @ self.lens[:, :2].T * (self.unit / max(self.zoom, 1e-9))
        )

    def layer(self) -> Layer:
        """Return an empty layer of ink."""
        return Layer(self.size, 0.75 * self.pen)


@dataclass(frozen=True)
class OverlayStyle:
    """Sizes and limits of overlays."""

    opacity: float = 0.74
    row: float = 1.6
    """Distance of lines, letters."""
    pad: float = 0.4
    side: float = 0.9
    """Margins above and below, and at the sides, letters."""
    largest: float = 0.85
    """Share of a picture's side above which the key is left out."""
    arc: float = 1.1
    """Radius of a torque's sample, letters."""
    letter_count: float = 0.65
    """Smallest size of a name on a small object, letters."""
    finer: int = 8
    """Samples per frame for trails and impacts."""
    sample_limit: int = 2_000_000
    """Maximum of samples times objects for these."""
    flash: int = 8
    """Frames for which an impact or an instantaneous push is shown; at most a sixth of
    the clip.
    """
    fade: float = 0.5
    """Share of the clip in which a trail fades to its least."""
    opacity_of_trails: float = 0.4
    least_length: float = 2.0
    """Smallest length of arrows and trails, px; shorter ones are not drawn."""


STYLE = OverlayStyle()

WORDS = (255, 255, 255)


def write_key(rgb: U8, sheet: Sheet, entries: list[Entry]) -> None:
    """Draw the key into the upper left corner of a picture (H, W, 3) sRGB.

    Small pictures get no key.
    """
    letter = sheet.letter
    side = STYLE.side * sheet.letter
    row = STYLE.row * letter
    column = max(_sample_width(entry, sheet) for entry in entries)
    text = max(text_width(entry.text, letter) for entry in entries)
    corner = np.array([side, side])
    size = np.array(
        [3 * side + column + text, 2 * STYLE.pad * letter + len(entries) * row]
    )
    if (size > STYLE.largest * np.array(sheet.size)).any():
        return  # on a small picture the key would hide the motion
    # To save time, draw only on the part of the picture under the key.
    part = rgb[: ceil(corner[1] + size[1]) + 1, : ceil(corner[0] + size[0]) + 1]
    canvas = part.shape[1], part.shape[0]
    # A dark plate makes the words readable on any photo.
    plate = Layer(canvas, 0.0)
    plate.area(corner + size * [[0, 0], [1, 0], [1, 1], [0, 1]], STYLE.opacity)
    plate.blend(part, CASING)
    # Samples have their own colours, each on a layer; all words share the last layer.
    words = Layer(canvas, 0.0)
    for k, entry in enumerate(entries):
        y = float(corner[1]) + STYLE.pad * letter + (k + 0.5) * row
        layer = Layer(canvas, 0.0)
        _sample(
            layer,
            sheet,
            entry,
            np.array([2 * side + (column - _sample_width(entry, sheet)) / 2, y]),
        )
        layer.blend(part, COLOURS[entry.kind])
        words.words(
            entry.text,
            (3 * side + column + text_width(entry.text, letter) / 2, y),
            letter,
        )
    words.blend(part, WORDS)


def _sample_width(entry: Entry, sheet: Sheet) -> float:
    """Return the width of a sample, px."""
    if entry.load is Load.TORQUE:
        return 2 * STYLE.arc * sheet.letter
    return entry.size * sheet.unit * (2 if entry.kind is Overlay.CONTACTS else 1)


def _sample(layer: Layer, sheet: Sheet, entry: Entry, corner: Array) -> None:
    """Draw a sample with its left end and its middle height `corner` x, y px."""
    # Each kind of mark is drawn as on the objects, so that the legend shows the same
    # shapes.
    vector = np.array([_sample_width(entry, sheet), 0.0])
    if entry.kind is Overlay.CONTACTS:
        ring(layer, corner + vector / 2, entry.size * sheet.unit, sheet.pen)
    elif entry.load is Load.TORQUE:
        curved_arrow(
            layer,
            arc(corner + vector / 2, STYLE.arc * sheet.letter, entry.size),
            sheet.pen,
        )
    else:
        straight_arrow(
            layer,
            corner,
            corner + vector,
            sheet.pen,
            has_impact=entry.load is Load.IMPULSE,
        )


Lens = Callable[[Frame], Array]
"""Function from a frame to its matrix (2, 3): photo px (x, y, 1) -> px of the frame."""


@dataclass(frozen=True)
class OverlayClip:
    """The common data of all frames of a clip."""

    world: World
    motion: Trajectory
    """The motion with enough samples for trails and impacts."""
    impacts: list[Impact]
    scales: Scales
    key: list[Entry]
    flash: float
    """Duration of a flash, s."""


def annotate_frames(
    frames: Iterator[Frame],
    world: World,
    trajectory: Trajectory,
    kinds: Collection[Overlay],
    lens: Lens = lambda frame: np.eye(2, 3),
) -> Iterator[Frame]:
    """Draw overlays of `kinds` on frames, by each frame's own time, in any order.

    `trajectory` has samples at those times. Trails and impacts need more samples: the
    world is then simulated again, with the same motion.
    """
    if not kinds:
        yield from frames
        return
    clip = describe_clip(world, trajectory, kinds)
    for frame in frames:
        rgb = frame.rgb.copy()
        times = clip.motion.times
        size = (rgb.shape[1], rgb.shape[0])
        # Frames may come in any order: find each frame's sample by its time.
        sample = int(np.abs(times - frame.time).argmin()) if len(times) else 0
        pen = max(size) / max(world.size)
        matrix = np.asarray(lens(frame), np.float64)
        sheet = Sheet(size, pen, matrix, frame.time, sample)
        for kind in (kind for kind in DRAW if kind in kinds):
            layer = sheet.layer()
            DRAW[kind](clip, sheet, layer)
            layer.blend(rgb, COLOURS[kind])
        if clip.key:
            write_key(rgb, sheet, clip.key)
        yield replace(frame, rgb=rgb)


def describe_clip(
    world: World, trajectory: Trajectory, kinds: Collection[Overlay]
) -> OverlayClip:
    """Return a clip's impacts, scales and key."""
    motion = trajectory
    needs_samples = {Overlay.TRAILS, Overlay.CONTACTS} & set(kinds)
    if world.bodies and len(trajectory.times) > 1 and needs_samples:
        # More samples make trails smooth, and separate impacts in time.
        sample_limit = STYLE.sample_limit // len(world.bodies)
        motion = trajectory.resample(
            sample_times(trajectory, STYLE.finer, sample_limit)
        )
    frame = world.duration / max(len(world.times), 1)
    # Impacts within a fraction of a frame count as one: a rattling contact would fill
    # the picture with rings.
    impacts: list[Impact] = []
    if Overlay.CONTACTS in kinds:
        impacts = find_impacts(world, motion, frame / STYLE.finer)
    impulses = [impact.impulse for impact in impacts]
    scale = scales(world, trajectory, kinds, impulses)
    flash_duration = min(
        STYLE.flash * world.duration / max(len(world.times), 1), world.duration / 6
    )
    key = key_entries(world, scale, kinds)
    return OverlayClip(world, motion, impacts, scale, key, flash_duration)


def _poses(clip: OverlayClip, sheet: Sheet) -> Array:
    """Return the present poses, (N, 3) px, px, rad."""
    return np.asarray(clip.motion.poses[sheet.sample])


def _boundaries(clip: OverlayClip, sheet: Sheet, layer: Layer) -> None:
    """Draw the boundaries."""
    for wall in clip.world.walls:
        for chain in wall.chains:
            layer.line(sheet.to_frame(chain), 1.2 * sheet.pen)


def _trails(clip: OverlayClip, sheet: Sheet, layer: Layer) -> None:
    """Draw the path of each centre up to now."""
    times = clip.motion.times[: sheet.sample + 1]
    if len(times) < 2:
        return
    # Older parts of a trail are fainter, down to a limit at which the whole path stays
    # visible.
    age = (sheet.time - times[1:]) / max(STYLE.fade * clip.world.duration, 1e-9)
    strengths = np.clip(
        1 - (1 - STYLE.opacity_of_trails) * age, STYLE.opacity_of_trails, 1
    )
    for path in np.moveaxis(clip.motion.poses[: sheet.sample + 1, :, :2], 1, 0):
        if np.ptp(path, axis=0).max() > STYLE.least_length:
            drawn_rows = _distinct_indices(path)
            points = sheet.to_frame(path[drawn_rows])
            layer.segments(
                points[:-1], points[1:], sheet.pen, strengths[drawn_rows[1:] - 1]
            )


def _distinct_indices(path: Array) -> NDArray[np.int64]:
    """Return the indices of a path's points (K, 2) px to draw, at least a pixel apart.

    Corners and the last point are always among them.
    """
    steps = np.diff(path, axis=0)
    # A new whole pixel of the arc length is a new point: a body at rest has thousands
    # of equal samples.
    arc_lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
    is_drawn = np.diff(np.floor(arc_lengths), prepend=-1.0) > 0
    is_corner = np.zeros(len(path), bool)
    dot = (steps[1:] * steps[:-1]).sum(axis=1)
    is_corner[1:-1] = dot < 0.9 * np.hypot(*steps[1:].T) * np.hypot(*steps[:-1].T)
    is_drawn |= is_corner
    is_drawn[-1] = True
    return np.flatnonzero(is_drawn)


def _outlines(clip: OverlayClip, sheet: Sheet, layer: Layer) -> None:
    """Draw the present shapes; a tick on a circle shows its rotation."""
    for body, (x, y, angle) in zip(
        clip.world.bodies, _poses(clip, sheet).tolist(), strict=True
    ):
        turn = rotation(angle)
        rings = list(body.rings)
        if body.radius is not None:
            rings = [circle((0.0, 0.0), body.radius * sheet.zoom) / sheet.zoom]
            # Seen from above, a rolling sphere has no angle in the picture.
            if not (clip.world.view is View.TOP and body.solid is Solid.SPHERE):
                tick = np.array([[0.72, 0.0], [1.0, 0.0]]) * body.radius
                layer.line(sheet.to_frame(tick @ turn.T + (x, y)), sheet.pen)
        for points in rings:
            layer.line(
                sheet.to_frame(points @ turn.T + (x, y)), sheet.pen, is_polygon=True
            )


def _velocities(clip: OverlayClip, sheet: Sheet, layer: Layer) -> None:
    """Draw an arrow for each velocity."""
    vectors = clip.scales.velocity * clip.motion.velocities[sheet.sample, :, :2]
    for pose, vector in zip(_poses(clip, sheet), vectors, strict=True):
        _arrow(sheet, layer, pose[:2], vector)


def _weights(clip: OverlayClip, sheet: Sheet, layer: Layer) -> None:
    """Draw an arrow for each weight."""
    for body, pose in zip(clip.world.bodies, _poses(clip, sheet), strict=True):
        if body.motion is Motion.DYNAMIC:
            weight = clip.scales.force * body.mass * clip.world.gravity
            _arrow(sheet, layer, pose[:2], weight)


def _forces(clip: OverlayClip, sheet: Sheet, layer: Layer) -> None:
    """Draw the active pushes, and impulses for a moment."""
    for push in clip.world.pushes:
        body = clip.world.bodies[push.body]
        end = push.start + clip.flash if push.load is Load.IMPULSE else push.end
        is_active = push.start - 1e-9 <= sheet.time < end - 1e-9
        if body.motion is Motion.DYNAMIC and is_active:
            _push(clip, sheet, layer, push)


def _push(clip: OverlayClip, sheet: Sheet, layer: Layer, push: Push) -> None:
    """Draw one push."""
    x, y, angle = _poses(clip, sheet)[push.body].tolist()
    center = np.array([x, y])
    place = center + rotation(angle) @ push.point
    if push.load is Load.TORQUE:
        reach = clip.world.bodies[push.body].reach
        radius = min(1.25 * reach, 0.2 * max(clip.world.size))
        # The length of the arc is proportional to the torque.
        sweep = clip.scales.torque * push.torque
        # An arc shorter than its own line would be only a dot.
        if abs(sweep) * radius * sheet.zoom >= STYLE.least_length:
            path = sheet.to_frame(arc(center, radius, sweep))
            curved_arrow(layer, path, sheet.pen)
    elif push.load is Load.IMPULSE:
        strength = _left(clip, sheet, push.start)
        vector = clip.scales.impulse * push.vector
        _arrow(sheet, layer, place, vector, strength, has_impact=True)
    else:
        _arrow(sheet, layer, place, clip.scales.force * push.vector)


def _arrow(
    sheet: Sheet,
    layer: Layer,
    start: Array,
    way: Array,
    strength: float = 1.0,
    *,
    has_impact: bool = False,
) -> None:
    """Draw an arrow from a point (2,) of the photo; `way` (2,) is its vector, px of the
    photo.
    """
    tail = sheet.to_frame(start)
    frame_vector = sheet.way(way)
    if np.hypot(*frame_vector) >= STYLE.least_length:
        straight_arrow(
            layer, tail, tail + frame_vector, sheet.pen, strength, has_impact=has_impact
        )


def _left(clip: OverlayClip, sheet: Sheet, since: float) -> float:
    """Return the strength 1..0 of a mark that is shown for a moment; it fades at the
    end.
    """
    return float(np.clip(1.6 * (1 - (sheet.time - since) / clip.flash), 0.0, 1.0))


def _contacts(clip: OverlayClip, sheet: Sheet, layer: Layer) -> None:
    """Draw a dot at each present contact, and a ring at each recent impact.

    The area of a ring is proportional to the impulse.
    """
    contacts = clip.motion.contacts
    present = sheet.time + 1e-9
    starts = contacts.touch_times[:, 0]
    ends = contacts.touch_times[:, 1]
    is_touching = (starts <= present) & (ends >= sheet.time)
    poses = _poses(clip, sheet)
    for first, second in contacts.touch_pairs[is_touching].tolist():
        points, gap = contact_points_between(clip.world, poses, first, second)
        # The contact list covers whole steps; check that the surfaces touch right now.
        if gap < STYLE.least_length:
            for point in sheet.to_frame(points):
                layer.area(circle(point, 1.5 * sheet.pen))
    for impact in clip.impacts:
        if not impact.time <= present < impact.time + clip.flash:
            continue
        radius = float(np.sqrt(clip.scales.ring * impact.impulse)) * sheet.unit
        if radius > STYLE.least_length:
            strength = _left(clip, sheet, impact.time)
            ring(layer, sheet.to_frame(impact.place), radius, sheet.pen, strength)


def _names(clip: OverlayClip, sheet: Sheet, layer: Layer) -> None:
    """Write each name at its object's centre, in letters that fit the object."""
    for body, pose in zip(clip.world.bodies, _poses(clip, sheet), strict=True):
        x, y = sheet.to_frame(pose[:2]).tolist()
        scale = 2 * body.reach * sheet.zoom / text_width(body.name, sheet.letter)
        layer.words(
            body.name, (x, y), sheet.letter * min(max(scale, STYLE.letter_count), 1.0)
        )


def _joints(clip: OverlayClip, sheet: Sheet, layer: Layer) -> None:
    """Draw the joints."""
    for chain in joint_lines(clip.world, _poses(clip, sheet), sheet.time):
        layer.line(sheet.to_frame(chain), sheet.pen)


def _fields(clip: OverlayClip, sheet: Sheet, layer: Layer) -> None:
    """Draw the fields."""
    for chain in field_lines(clip.world, _poses(clip, sheet), sheet.time):
        layer.line(sheet.to_frame(chain), sheet.pen)


DRAW: Mapping[Overlay, Callable[[OverlayClip, Sheet, Layer], None]] = {
    Overlay.BOUNDARIES: _boundaries,
    Overlay.FIELDS: _fields,
    Overlay.JOINTS: _joints,
    Overlay.TRAILS: _trails,
    Overlay.OUTLINES: _outlines,
    Overlay.WEIGHT: _weights,
    Overlay.FORCES: _forces,
    Overlay.VELOCITY: _velocities,
    Overlay.CONTACTS: _contacts,
    Overlay.NAMES: _names,
}
"""Drawing functions in their order: the last is on top."""
