"""Write depth and normals of each frame as 16-bit PNG, from the maps of the photo."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.correspondence import is_ball, photo_view, similarity, spans
from physgen.export.labels import Clip, Moment, View, Writer, write_json, write_png
from physgen.geometry.polygon import Array
from physgen.maps import F32, U16
from physgen.perceive.inpaint.poisson import dilate, harmonic_fill
from physgen.render.stage import Slices

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class LayerLimits:
    """Limits of the parts of a map and their fill."""

    rim: int = 3
    """Width of the mixed pixels around an object, px. The background is also filled
    there.
    """
    pad: int = 4
    """Margin around an object's mask for its extended border values, px."""
    fill_error: float = 2e-4
    """Maximum error of the smooth fill over the map's range."""


LIMITS = LayerLimits()

WARP = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


@dataclass(frozen=True)
class Part:
    """A map on one object."""

    corner: tuple[int, int]
    """Photo column and row of its first pixel."""
    values: F32
    """(h, w[, C]), extended beyond the object's mask."""

    def warp(self, box: Slices, m: complex, n: complex) -> F32:
        """Return the values (h, w[, C]) on a box of a view; `m` and `n` map its px to
        the photo's.
        """
        rows, columns = box
        # The box and the part have corners of their own.
        n += m * complex(columns.start, rows.start) - complex(*self.corner)
        x_row = [m.real, -m.imag, n.real]
        y_row = [m.imag, m.real, n.imag]
        matrix = np.array([x_row, y_row])
        size = (columns.stop - columns.start, rows.stop - rows.start)
        warped = cv2.warpAffine(
            self.values, matrix, size, flags=WARP, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(warped, np.float32)


Sample = Callable[[int, Part, View, Slices], F32]
"""Body, its part, view and box -> values of the body on the box, (h, w[, C])."""


class Layers:
    """A map in layers; `encode` converts its values to the integers of files."""

    def __init__(
        self,
        clip: Clip,
        ground: F32,
        parts: Mapping[int, Part],
        encode: Callable[[F32], U16],
    ) -> None:
        """Take the `ground` (H, W[, C]) of the photo without objects, and `parts` by
        body.
        """
        self._world = clip.world
        self._size = clip.size
        self._photo = photo_view(clip.trajectory, clip.world)
        self._ground, self._parts, self._encode = ground, parts, encode
        self._background: tuple[Array, U16] | None = None
        self._frame = np.zeros((0, 0), np.uint16)

    def compose(self, view: View, sample: Sample) -> U16:
        """Return the codes (h, w[, C]) of a view.

        The next view overwrites them, because new memory costs more than a copy.
        """
        ground = self._ground_codes(view.lens)
        if self._frame.shape != ground.shape:
            self._frame = np.empty_like(ground)
        np.copyto(self._frame, ground)
        for body, box in view.boxes.items():
            if body in self._parts:
                own_mask = view.ids[box] == body + 1
                values = sample(body, self._parts[body], view, box)
                codes = self._encode(values)
                # OpenCV copies channels faster than NumPy.
                cv2.copyTo(codes, own_mask.view(np.uint8), self._frame[box])
        return self._frame

    def turn(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """Return a part that turns with its body in the picture."""
        return part.warp(box, *similarity(body, view, self._photo))

    def shift(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """Return a part that moves with its body but does not turn."""
        # The camera's magnification applies, and the body's turn does not.
        m, _ = similarity(-1, view, self._photo)
        x, y = view.lens @ [*view.poses[body, :2], 1.0]
        photo_x, photo_y = self._photo.poses[body, :2]
        # The centre of the body must reach its centre in the photo.
        shift = complex(photo_x, photo_y) - m * complex(x, y)
        return part.warp(box, m, shift)

    def _ground_codes(self, lens: Array) -> U16:
        """Return the codes of the background. Compute them again only after a motion of
        the camera.
        """
        if self._background is None or not np.array_equal(self._background[0], lens):
            values = self._ground
            height, width = values.shape[:2]
            if self._size != (width, height) or not np.array_equal(lens, np.eye(2, 3)):
                # This kind of warp takes the map from the target to its source.
                matrix = cv2.invertAffineTransform(lens)
                warped = cv2.warpAffine(
                    values,
                    matrix,
                    self._size,
                    flags=WARP,
                    borderMode=cv2.BORDER_REPLICATE,
                )
                values = np.asarray(warped, np.float32)
            self._background = lens, self._encode(values)
        return self._background[1]


def unknown_ground(clip: Clip) -> Mask:
    """Return the pixels (H, W) of the photo on objects or beside them, without known
    background.
    """
    return dilate(clip.photo_ids > 0, LIMITS.rim)


def fill_map(values: F32, hole: Mask) -> F32:
    """Return values (H, W[, C]) with a harmonic fill of a hole (H, W)."""
    if values.ndim == 3:
        channels = values
    else:
        channels = values[..., None]
    # A constant map has no range.
    error = max(float(np.ptp(channels)), 1e-6) * LIMITS.fill_error
    return harmonic_fill(channels, hole, error).reshape(values.shape)


def parts_of(values: F32, clip: Clip) -> dict[int, Part]:
    """Return each body's part of a map (H, W[, C]) of the photo, without bodies outside
    the photo.
    """
    parts = {}
    for body in range(len(clip.world.bodies)):
        mask = clip.photo_ids == body + 1
        x, y, w, h = cv2.boundingRect(mask.view(np.uint8))
        if not w:
            continue
        left = max(x - LIMITS.pad, 0)
        top = max(y - LIMITS.pad, 0)
        right = x + w + LIMITS.pad
        bottom = y + h + LIMITS.pad
        box = np.s_[top:bottom, left:right]
        # Interpolation at the border must not mix in other objects.
        part_values = _extend(values[box], mask[box])
        parts[body] = Part((left, top), part_values)
    return parts


def _extend(values: F32, mask: Mask) -> F32:
    """Return values (h, w[, C]) with the nearest value of the mask everywhere."""
    outside = (~mask).view(np.uint8)
    # Each pixel outside has the label of the nearest pixel of the mask.
    _, labels = cv2.distanceTransformWithLabels(
        outside, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    count = int(labels.max()) + 1
    table = np.zeros((count, *values.shape[2:]), np.float32)
    table[labels[mask]] = values[mask]
    return np.ascontiguousarray(table[labels])


@dataclass(frozen=True)
class MapCodes:
    """Codes and limits of the maps."""

    max_code: int = 65535
    zero: int = 32768
    """Code of 0 in a normal's component."""
    unit: int = 32767
    """Difference of the codes of 1 and 0 in a normal's component."""
    ball_margin: float = 2.0
    """Width of the rim in a ball's mask, px. Mask pixels farther out belong to a thread
    or a handle.
    """


CODES = MapCodes()


class Depth(Writer):
    """Writes `00000.png` ... in the photo's unit, larger is farther; `scale.json` has
    the depths of 0 and 65535.

    Objects move across the view and not in depth, so that each keeps its own depth. It
    turns with the object in the picture, except for balls.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        assert clip.maps is not None
        assert clip.maps.depth is not None
        # The codes 0 and 65535 mean the same depths as in the photo's own map.
        low, high = clip.scene.maps.get("depth", (0.0, 1.0))
        self._folder, self._world = folder, clip.world
        codes_per_unit = np.float32(CODES.max_code / (high - low))

        def encode(depth: F32) -> U16:
            codes = (depth - np.float32(low)) * codes_per_unit
            # The conversion cuts the fraction off: half a code makes it round.
            return np.asarray(codes + np.float32(0.5), np.uint16)

        depth = clip.maps.depth
        ground = np.clip(fill_map(depth, unknown_ground(clip)), low, high)
        self._layers = Layers(clip, ground, parts_of(depth, clip), encode)
        write_json(
            folder / "scale.json", {"at_0": low, "at_65535": high, "larger": "farther"}
        )

    def add(self, moment: Moment) -> None:
        """Write one file per frame."""
        codes = self._layers.compose(moment.view, self._sample)
        write_png(self._folder / f"{moment.view.index:05d}.png", codes)

    def _sample(self, body: int, part: Part, view: View, box: Slices) -> F32:
        if is_ball(self._world.bodies[body]):
            return self._layers.shift(body, part, view, box)
        return self._layers.turn(body, part, view, box)


class Normals(Writer):
    """Writes `00000.png` ...: 32768 + 32767 n of unit normals, +x right, +y down, +z to
    the viewer.

    Normals turn with objects in the picture. Balls have the exact normals of a sphere.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        assert clip.maps is not None
        assert clip.maps.normals is not None
        self._folder, self._world = folder, clip.world
        self._start = photo_view(clip.trajectory, clip.world).poses
        write_json(
            folder / "scale.json",
            {
                "zero": CODES.zero,
                "one": CODES.zero + CODES.unit,
                "axes": "+x right, +y down, +z to the viewer",
            },
        )
        normals = clip.maps.normals
        ground = fill_map(normals, unknown_ground(clip))
        self._layers = Layers(clip, ground, parts_of(normals, clip), normal_codes)

    def add(self, moment: Moment) -> None:
        """Write one file per frame."""
        codes = self._layers.compose(moment.view, self._sample)
        write_png(self._folder / f"{moment.view.index:05d}.png", codes)

    def _sample(self, body: int, part: Part, view: View, box: Slices) -> F32:
        ball = self._world.bodies[body]
        if not is_ball(ball):
            return self._turn(body, part, view, box)
        assert ball.radius is not None
        x, y = spans(box)
        radius = ball.radius * float(view.lens[0, 0])
        center_x, center_y = view.lens @ [*view.poses[body, :2], 1.0]
        u = (x - center_x) / radius
        v = (y - center_y) / radius
        square = u * u + v * v
        # Pixels just beyond the rim get the normals of the rim.
        limit = 1 / np.sqrt(np.maximum(square, 1))
        depth = np.sqrt(np.maximum(1 - square, 0))
        components = [u * limit, v * limit, depth]
        normals = np.stack(components, axis=-1).astype(np.float32)
        # A thread or a handle has no sphere's normals.
        is_outside = square > (1 + CODES.ball_margin / radius) ** 2
        if (is_outside & (view.ids[box] == body + 1)).any():
            other_normals = self._turn(body, part, view, box)
            np.copyto(normals, other_normals, where=is_outside[..., None])
        return normals

    def _turn(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """Return the photo's map, turned in the picture."""
        angle = float(view.poses[body, 2] - self._start[body, 2])
        c = np.cos(angle)
        s = np.sin(angle)
        # Normals turn with the object about the viewing axis.
        x_row = [c, -s, 0]
        y_row = [s, c, 0]
        rotation = np.array([x_row, y_row, [0, 0, 1]])
        normals = self._layers.turn(body, part, view, box)
        return np.asarray(cv2.transform(normals, rotation), np.float32)


def normal_codes(normals: F32) -> U16:
    """Return the codes of vectors (h, w, 3) as unit normals. Zero vectors point to the
    viewer.
    """
    x, y, z = cv2.split(normals)
    length = cv2.sqrt(x * x + y * y + z * z)
    has_no_length = length < 1e-6
    if has_no_length.any():
        viewer = np.array([0, 0, 1], np.float32)
        normals = np.where(has_no_length[..., None], viewer, normals)
        length = np.where(has_no_length, np.float32(1), length)
    scale = np.float32(CODES.unit) / length
    codes = normals * cv2.merge((scale, scale, scale))
    # The conversion to integers cuts the fraction off, so that half a code makes it
    # round to the nearest code.
    codes += np.float32(CODES.zero + 0.5)
    return np.asarray(codes, np.uint16)
