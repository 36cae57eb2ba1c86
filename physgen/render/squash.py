"""Soft objects that are flat for two frames after an impact, by Hertz' law; drawing alone.

A sphere of mass m and radius R that meets a wall at a speed v is shortened by (15 m v² / 16 E R^½)^(2/5), where E is
Young's modulus over 1 - Poisson's ratio squared (K. L. Johnson, Contact Mechanics, 11.1). It grows sideways by half of
that share, so that its volume stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, hypot

import cv2
import numpy as np

from physgen.arrays import F32, F64, Indices
from physgen.compile.world import Body, World
from physgen.geometry.polygon import rotation
from physgen.materials import kind
from physgen.scene.scene import Motion
from physgen.simulate.trajectory import Trajectory

Slices = tuple[slice, slice]
"""Rows and columns of a canvas."""


@dataclass(frozen=True)
class SquashTuning:
    """Limits of the flattening."""

    least_share: float = 0.01
    """Share of the size that is invisible; hard materials stay below it."""
    largest_share: float = 0.08
    """Share of the size from which rubber looks like dough."""
    frames: tuple[float, ...] = (1.0, 0.5)
    """Share that the first frames after an impact show."""
    hertz: float = 15 / 16
    """Factor of Hertz' law."""


SQUASH = SquashTuning()
GRAMS = 1e3
"""Per kilogram."""
PASCALS = 1e9
"""Per gigapascal."""


@dataclass(frozen=True)
class Squash:
    """A body that is flat in one frame."""

    normal: tuple[float, float]
    """Unit vector from the contact into the body."""
    offset: tuple[float, float]
    """px from the centre to the side that touches."""
    share: float
    """Of the size along the normal, that is missing."""

    def scale_to(self, scale: float) -> Squash:
        """Return the same on a canvas with `scale` pixels a photo pixel."""
        if scale == 1.0:
            return self
        return replace(self, offset=(scale * self.offset[0], scale * self.offset[1]))


class Squashes:
    """All flat bodies of a clip by frame."""

    def __init__(self, times: F64, frames: Mapping[int, Mapping[int, Squash]]) -> None:
        """`times` (T,) s of the frames."""
        self._times, self._frames = times, frames

    def find(self, time: float) -> Mapping[int, Squash]:
        """Return the flat bodies of the frame that is exposed at a time, s."""
        frame = int(np.searchsorted(self._times, time - 1e-9))
        return self._frames.get(frame, {})


def find_squashes(
    world: World, labels: Sequence[str], trajectory: Trajectory
) -> Squashes:
    """Return the flat bodies of a clip; `trajectory` has one sample a frame."""
    softness = list(map(_softness, labels))
    frames: dict[int, dict[int, Squash]] = {}
    contacts = trajectory.contacts
    starts = _touch_starts(trajectory)
    rows = zip(contacts.impulse_rows.tolist(), contacts.impulses, strict=True)
    for (sample, *pair), impulse in rows:
        if (sample, *pair) not in starts:
            continue
        for k, sign in zip(pair, (1.0, -1.0), strict=True):
            if k >= len(world.bodies) or world.bodies[k].motion is not Motion.DYNAMIC:
                continue
            share = _impact_share(world, trajectory, k, sample, impulse, softness[k])
            if share < SQUASH.least_share:
                continue
            normal = sign * impulse / hypot(*impulse)
            squashes = dict(_of_frames(world, trajectory, k, sample, normal, share))
            _keep_largest(frames, k, squashes)
    return Squashes(trajectory.times, frames)


def _keep_largest(
    frames: dict[int, dict[int, Squash]], k: int, squashes: Mapping[int, Squash]
) -> None:
    """Add the shapes of body k by frame, unless another one there is flatter."""
    for frame, squash in squashes.items():
        known = frames.setdefault(frame, {}).get(k)
        if known is None or known.share < squash.share:
            frames[frame][k] = squash


def _impact_share(
    world: World,
    trajectory: Trajectory,
    k: int,
    sample: int,
    impulse: F64,
    softness: float,
) -> float:
    """Return the missing share of body k's size after an impulse (2,) in a frame."""
    times = trajectory.times
    gravity = hypot(*world.gravity) * float(times[sample] - times[sample - 1])
    change = hypot(*impulse) / world.bodies[k].mass - gravity
    return _share(world, world.bodies[k], change, softness)


def _touch_starts(trajectory: Trajectory) -> set[tuple[int, int, int]]:
    """Return the frames, and pairs of surfaces, in which touches begin after t = 0."""
    contacts, times = trajectory.contacts, trajectory.times
    begins = contacts.touch_times[:, 0]
    is_new = begins > 0
    frames: Indices = np.searchsorted(times, begins[is_new] - 1e-9)
    rows = np.column_stack([frames, contacts.touch_pairs[is_new]])
    return {(row[0], row[1], row[2]) for row in rows.tolist()}


def _softness(label: str) -> float:
    """Return 1 / Pa: how far a pressure shortens what a label names."""
    material = kind(label).material
    return (1 - material.poisson**2) / (material.young * PASCALS)


def _share(world: World, body: Body, change: float, softness: float) -> float:
    """Return the missing share of a body's size, at most 1, by the change of its speed, px/s."""
    if change <= 0:
        return 0.0
    # An elastic bounce turns the speed round.
    speed = change / 2 / world.pixels_per_meter
    radius = _radius(body) / world.pixels_per_meter
    pressed = SQUASH.hertz * body.mass / GRAMS * speed**2 * softness
    share = float((pressed / radius**3) ** 0.4) / 2
    return min(share, SQUASH.largest_share)


def _radius(body: Body) -> float:
    """Return the radius of a body, or of the disc with its area, px.

    Its size is that of its thinnest limb, which may be a tip of the outline.
    """
    if body.radius is not None:
        return body.radius
    pieces = [piece.astype(np.float32) for piece in body.pieces]
    return float(np.sqrt(sum(map(cv2.contourArea, pieces)) / np.pi))


def _of_frames(
    world: World,
    trajectory: Trajectory,
    k: int,
    sample: int,
    normal: F64,
    share: float,
) -> Iterator[tuple[int, Squash]]:
    """Yield the frames in which an impact shows, and how."""
    rings = np.concatenate(world.bodies[k].rings)
    for number, part in enumerate(SQUASH.frames):
        frame = sample + number
        if frame >= len(trajectory.times):
            return
        turned = rings @ rotation(float(trajectory.poses[frame, k, 2])).T
        offset = float((turned @ normal).min()) * normal
        yield (
            frame,
            Squash((normal[0], normal[1]), (offset[0], offset[1]), part * share),
        )


def squash_picture(
    squash: Squash,
    center: tuple[float, float],
    box: Slices,
    light: F32,
    coverage: F32,
    size: tuple[int, int],
) -> tuple[Slices, F32, F32] | None:
    """Return box, light (h, w, 3) and coverage (h, w) of a flat picture on a canvas of `size` (W, H).

    `center` px of the body on the canvas. None for a picture that the canvas cuts off: its other part is not known.
    """
    rows, columns = box
    room = ceil(squash.share * max(coverage.shape)) + 1
    wide = (
        slice(rows.start - room, rows.stop + room),
        slice(columns.start - room, columns.stop + room),
    )
    is_inside = wide[0].start >= 0 and wide[1].start >= 0
    if not is_inside or wide[0].stop > size[1] or wide[1].stop > size[0]:
        return None
    normal = np.array(squash.normal)
    along = np.outer(normal, normal)
    matrix = (1 + squash.share / 2) * (np.eye(2) - along) + (1 - squash.share) * along
    anchor = np.array(center) + squash.offset
    old = anchor - (columns.start, rows.start)
    new = anchor - (wide[1].start, wide[0].start)
    warp = np.column_stack([matrix, new - matrix @ old])
    shape = (wide[1].stop - wide[1].start, wide[0].stop - wide[0].start)
    return (
        wide,
        np.asarray(cv2.warpAffine(light, warp, shape), np.float32),
        np.asarray(cv2.warpAffine(coverage, warp, shape), np.float32),
    )
