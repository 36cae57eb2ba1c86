"""Depth and normals of each frame, made from the maps of the photo, as 16-bit PNG."""

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
    """How a map is split and filled."""

    rim: int = 3
    """px around an object in which pixels mix it and the background: the background is filled in there, too."""
    pad: int = (
        4  # px around an object's mask to which its outermost values are extended
    )
    fill_error: float = 2e-4  # of a map's range: the largest error of the smooth fill


LIMITS = LayerLimits()

WARP = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


@dataclass(frozen=True)
class Part:
    """A map on one object."""

    corner: tuple[int, int]  # photo column and row of its first pixel
    values: F32  # (h, w[, C]), extended beyond the object's mask

    def warped(self, box: Slices, m: complex, n: complex) -> F32:
        """(h, w[, C]) on a box of a view; `m` and `n` lead from its px to those of the photo."""
        rows, columns = box
        n += m * complex(columns.start, rows.start) - complex(*self.corner)
        matrix = np.array([[m.real, -m.imag, n.real], [m.imag, m.real, n.imag]])
        size = (columns.stop - columns.start, rows.stop - rows.start)
        warped = cv2.warpAffine(
            self.values, matrix, size, flags=WARP, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(warped, np.float32)


Sample = Callable[[int, Part, View, Slices], F32]
"""Body, its part, view and box -> what the box shows of the body, (h, w[, C])."""


class Layers:
    """A map in layers; `encode` turns its values into the integers of files."""

    def __init__(
        self,
        clip: Clip,
        ground: F32,
        parts: Mapping[int, Part],
        encode: Callable[[F32], U16],
    ) -> None:
        """`ground` (H, W[, C]) of the photo without objects; `parts` by body."""
        self._world, self._size = clip.world, clip.size
        self._photo = photo_view(clip.trajectory, clip.world)
        self._ground, self._parts, self._encode = ground, parts, encode
        self._background: tuple[Array, U16] | None = None
        self._frame = np.zeros((0, 0), np.uint16)

    def composed(self, view: View, sample: Sample) -> U16:
        """(h, w[, C]) of a view; the next view overwrites it, since new memory costs more than a copy."""
        ground = self._ground_seen(view.lens)
        if self._frame.shape != ground.shape:
            self._frame = np.empty_like(ground)
        np.copyto(self._frame, ground)
        for body, box in view.boxes.items():
            if body in self._parts:
                mine = view.ids[box] == body + 1
                values = self._encode(sample(body, self._parts[body], view, box))
                cv2.copyTo(
                    values, mine.view(np.uint8), self._frame[box]
                )  # faster than NumPy with channels
        return self._frame

    def turned(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """A part that turns with its body in the picture."""
        return part.warped(box, *similarity(body, view, self._photo))

    def moved(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """A part that moves with its body and never turns."""
        m, _ = similarity(-1, view, self._photo)
        (x, y), (to_x, to_y) = (
            view.lens @ [*view.poses[body, :2], 1.0],
            self._photo.poses[body, :2],
        )
        return part.warped(box, m, complex(to_x, to_y) - m * complex(x, y))

    def _ground_seen(self, lens: Array) -> U16:
        """The background through the camera; computed again only when the camera has moved."""
        if self._background is None or not np.array_equal(self._background[0], lens):
            values = self._ground
            height, width = values.shape[:2]
            if self._size != (width, height) or not np.array_equal(lens, np.eye(2, 3)):
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
    """(H, W) of the photo: pixels on objects or beside them, where the background is not known."""
    return dilate(clip.stood > 0, LIMITS.rim)


def filled(values: F32, where: Mask) -> F32:
    """(H, W[, C]) with a harmonic fill of `where` (H, W)."""
    deep = values if values.ndim == 3 else values[..., None]
    error = max(float(np.ptp(deep)), 1e-6) * LIMITS.fill_error
    return harmonic_fill(deep, where, error).reshape(values.shape)


def parts_of(values: F32, clip: Clip) -> dict[int, Part]:
    """Each body's part of a map (H, W[, C]) of the photo; bodies that the photo does not show have none."""
    found = {}
    for body in range(len(clip.world.bodies)):
        own = clip.stood == body + 1
        x, y, w, h = cv2.boundingRect(own.view(np.uint8))
        if w:
            box = np.s_[
                max(y - LIMITS.pad, 0) : y + h + LIMITS.pad,
                max(x - LIMITS.pad, 0) : x + w + LIMITS.pad,
            ]
            found[body] = Part(
                (box[1].start, box[0].start), _nearest(values[box], own[box])
            )
    return found


def _nearest(values: F32, known: Mask) -> F32:
    """(h, w[, C]) with the nearest known value everywhere."""
    _, nearest = cv2.distanceTransformWithLabels(
        (~known).view(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    table = np.zeros((int(nearest.max()) + 1, *values.shape[2:]), np.float32)
    table[nearest[known]] = values[known]
    return np.ascontiguousarray(table[nearest])


@dataclass(frozen=True)
class MapCodes:
    """Codes and limits of the maps."""

    full: int = 65535
    zero: int = 32768
    unit: int = 32767  # codes of a normal's component: 0, and by how much 1 is larger
    ball_margin: float = 2.0
    """px beyond a ball's rim up to which its mask holds the rim; farther out it is a thread or a handle."""


CODES = MapCodes()


class Depth(Writer):
    """`00000.png` ...: in the photo's unit, larger is farther; `scale.json` has the depths of 0 and 65535.

    Objects move across the view and not in depth, so each keeps its own. It turns with them in the picture, except
    that of a ball.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        assert clip.maps is not None
        assert clip.maps.depth is not None
        low, high = clip.scene.maps.get(
            "depth", (0.0, 1.0)
        )  # depths of 0 and 65535, as in the photo's own map
        self._folder, self._world, steps = (
            folder,
            clip.world,
            np.float32(CODES.full / (high - low)),
        )

        def encode(depth: F32) -> U16:
            return np.asarray(
                (depth - np.float32(low)) * steps + np.float32(0.5), np.uint16
            )

        depth = clip.maps.depth
        ground = np.clip(filled(depth, unknown_ground(clip)), low, high)
        self._layers = Layers(clip, ground, parts_of(depth, clip), encode)
        write_json(
            folder / "scale.json", {"at_0": low, "at_65535": high, "larger": "farther"}
        )

    def add(self, moment: Moment) -> None:
        """One file a frame."""
        codes = self._layers.composed(moment.view, self._sampled)
        write_png(self._folder / f"{moment.view.index:05d}.png", codes)

    def _sampled(self, body: int, part: Part, view: View, box: Slices) -> F32:
        moved = (
            self._layers.moved
            if is_ball(self._world.bodies[body])
            else self._layers.turned
        )
        return moved(body, part, view, box)


class Normals(Writer):
    """`00000.png` ...: 32768 + 32767 n of unit normals, +x right, +y down, +z to the viewer.

    They turn with objects in the picture; those of balls are exactly those of a sphere.
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
        ground = filled(normals, unknown_ground(clip))
        self._layers = Layers(clip, ground, parts_of(normals, clip), normal_codes)

    def add(self, moment: Moment) -> None:
        """One file a frame."""
        codes = self._layers.composed(moment.view, self._sampled)
        write_png(self._folder / f"{moment.view.index:05d}.png", codes)

    def _sampled(self, body: int, part: Part, view: View, box: Slices) -> F32:
        ball = self._world.bodies[body]
        if not is_ball(ball):
            return self._turned(body, part, view, box)
        assert ball.radius is not None
        x, y = spans(box)
        radius = ball.radius * float(view.lens[0, 0])
        at_x, at_y = view.lens @ [*view.poses[body, :2], 1.0]
        u, v = (x - at_x) / radius, (y - at_y) / radius
        squared = u * u + v * v
        inward = 1 / np.sqrt(np.maximum(squared, 1))
        towards = np.sqrt(np.maximum(1 - squared, 0))
        sphere = np.stack([u * inward, v * inward, towards], axis=-1).astype(np.float32)
        outside = squared > (1 + CODES.ball_margin / radius) ** 2
        if (outside & (view.ids[box] == body + 1)).any():
            np.copyto(
                sphere, self._turned(body, part, view, box), where=outside[..., None]
            )
        return sphere

    def _turned(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """The photo's map, turned in the picture."""
        turn = float(view.poses[body, 2] - self._start[body, 2])
        c, s = np.cos(turn), np.sin(turn)
        there = self._layers.turned(body, part, view, box)
        return np.asarray(
            cv2.transform(there, np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])),
            np.float32,
        )


def normal_codes(normals: F32) -> U16:
    """(h, w, 3) of any length -> codes of unit normals; those of length 0 point to the viewer."""
    x, y, z = cv2.split(normals)
    length = cv2.sqrt(x * x + y * y + z * z)
    missing = length < 1e-6
    if missing.any():
        normals = np.where(missing[..., None], np.array([0, 0, 1], np.float32), normals)
        length = np.where(missing, np.float32(1), length)
    scale = np.float32(CODES.unit) / length
    codes = normals * cv2.merge((scale, scale, scale))
    codes += np.float32(CODES.zero + 0.5)
    return np.asarray(codes, np.uint16)
