"""Depth, normals, albedo and shading of each frame, made from the maps of the photo, as 16-bit PNG."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.correspondence import PhotoPose, is_ball, spans
from physgen.export.files import png, png_of_bgr, write_png, write_scale
from physgen.export.labels import Clip, Moment, View
from physgen.export.layers import Layers, Part, filled, hole, parted
from physgen.maps import Percepts
from physgen.photometry import decode
from physgen.render.stage import Slices

# ----------------------------------------------------------------------
# Clip -> the albedo of its views: it turns with things, and with balls on a table in space.
#
# Behind things it is the filled background (`clean.png`, or `background.png`), times what the albedo beside
# is to the
# background there, spread as a soap film: its pattern goes on.

F32 = NDArray[np.float32]
U16 = NDArray[np.uint16]
Mask = NDArray[np.bool_]
FULL = 65535
DARK = 2e-3
"""Linear light below which nobody tells what it is a share of."""
MOST_ALBEDO = 8.0
"""Times the background's light that albedo may be: shadows are about as deep."""


class AlbedoViews:
    """Of a clip whose photo has an albedo; what was asked last is at hand."""

    def __init__(self, clip: Clip) -> None:
        assert clip.maps is not None
        assert clip.maps.albedo is not None
        albedo = clip.maps.albedo
        ground, parts = _ground(clip.maps, albedo, hole(clip)), parted(albedo[..., ::-1], clip)
        self._layers = Layers(clip, np.ascontiguousarray(ground[..., ::-1]), parts, albedo_codes)
        self._last: tuple[View, U16] | None = None

    def seen(self, view: View) -> U16:
        """(h, w, 3), 65535 = 1, in OpenCV's order, B, G, R: what files are made of."""
        if self._last is None or self._last[0] is not view:
            self._last = view, self._layers.seen(view, self._layers.rolled)
        return self._last[1]


def _ground(maps: Percepts, albedo: F32, where: Mask) -> F32:
    """(H, W, 3) with what is behind things."""
    behind = maps.background if maps.clean is None else maps.clean
    if behind is None:
        return np.clip(filled(albedo, where), 0, 1)
    light = decode(behind) + np.float32(DARK)
    share = np.minimum((albedo + np.float32(DARK)) / light, np.float32(MOST_ALBEDO))
    there = filled(share, where) * light - np.float32(DARK)
    return np.clip(np.where(where[..., None], there, albedo), 0, 1)


def albedo_codes(albedo: F32) -> U16:
    """0..1 -> 16 bits."""
    return np.asarray(albedo * np.float32(FULL) + np.float32(0.5), np.uint16)


# ----------------------------------------------------------------------
# Views -> albedo/00000.png ...: what surfaces send back of white light, linear, 16 bits a channel, 65535 = 1.


class Albedo:
    """Borders are hard: a pixel has the albedo of the one thing that its id names."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._paint = folder, clip.shared(AlbedoViews)
        write_scale(folder, {"at_0": 0.0, "at_65535": 1.0, "light": "linear"})

    def add(self, moment: Moment) -> None:
        """One file a view."""
        (self._folder / f"{moment.view.index:05d}.png").write_bytes(png_of_bgr(self._paint.seen(moment.view)))

    def close(self) -> None:
        """Nothing is left to be said."""


# ----------------------------------------------------------------------
# Views -> depth/00000.png ...: 16 bits, larger is farther; scale.json says what 0 and 65535 stand for.
#
# Things move across the view and not in depth, so each keeps its own. It turns with them in the picture, but
# that of a
# ball (`solid: sphere`), which is as round from all sides.


class Depth:
    """In the unit of the photo's own map."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._depths = folder, clip.shared(DepthViews)
        low, high = self._depths.range
        write_scale(folder, {"at_0": low, "at_65535": high, "larger": "farther"})

    def add(self, moment: Moment) -> None:
        """One file a view."""
        (self._folder / f"{moment.view.index:05d}.png").write_bytes(self._depths.png(moment.view))

    def close(self) -> None:
        """Nothing is left to be said."""


class DepthViews:
    """The depth of views, of a clip whose photo has a depth; the picture that was asked for last is at hand."""

    def __init__(self, clip: Clip) -> None:
        assert clip.maps is not None
        assert clip.maps.depth is not None
        self.range = low, high = clip.scene.maps.get("depth", (0.0, 1.0))
        """What 0 and 65535 stand for, as in the photo's own map."""
        self._world, steps = clip.world, np.float32(FULL / (high - low))

        def finish(depth: F32) -> U16:
            return np.asarray((depth - np.float32(low)) * steps + np.float32(0.5), np.uint16)

        depth = clip.maps.depth
        ground = np.clip(filled(depth, hole(clip)), low, high)
        self._layers = Layers(clip, ground, parted(depth, clip), finish)
        self._last: tuple[View, bytes | memoryview] | None = None

    def png(self, view: View) -> bytes | memoryview:
        """(h, w) codes, as a file: two formats hold it."""
        if self._last is None or self._last[0] is not view:
            self._last = view, png(self._layers.seen(view, self._sampled))
        return self._last[1]

    def _sampled(self, body: int, part: Part, view: View, box: Slices) -> F32:
        moved = self._layers.carried if is_ball(self._world.bodies[body]) else self._layers.turned
        return moved(body, part, view, box)


# ----------------------------------------------------------------------
# Views -> normals/00000.png ...: 16 bits a channel, 32768 + 32767 n, +x right, +y down, +z to the viewer.
#
# They turn with things in the picture. Those of balls (`solid: sphere`) are a sphere's, exactly, wherever it
# is.

MIDDLE, UNIT = 32768, 32767
BEYOND = 2.0
"""px beyond a ball's rim up to which what its mask holds is the rim; farther out it is a thread or a handle."""


class Normals:
    """Unit vectors, to 16 bits."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        assert clip.maps is not None
        assert clip.maps.normals is not None
        self._folder, self._world, self._start = (
            folder,
            clip.world,
            PhotoPose.of(clip.trajectory, clip.world).poses,
        )
        write_scale(
            folder, {"zero": MIDDLE, "one": MIDDLE + UNIT, "axes": "+x right, +y down, +z to the viewer"}
        )
        normals = clip.maps.normals
        self._layers = Layers(clip, filled(normals, hole(clip)), parted(normals, clip), normal_codes)

    def add(self, moment: Moment) -> None:
        """One file a view."""
        write_png(
            self._folder / f"{moment.view.index:05d}.png", self._layers.seen(moment.view, self._sampled)
        )

    def close(self) -> None:
        """Nothing is left to be said."""

    def _sampled(self, body: int, part: Part, view: View, box: Slices) -> F32:
        thing = self._world.bodies[body]
        if not is_ball(thing):
            return self._turned(body, part, view, box)
        assert thing.radius is not None
        x, y = spans(box)
        radius = thing.radius * float(view.lens[0, 0])
        at_x, at_y = view.lens @ [*view.poses[body, :2], 1.0]
        u, v = (x - at_x) / radius, (y - at_y) / radius
        far = u * u + v * v
        squeeze = 1 / np.sqrt(np.maximum(far, 1))
        towards = np.sqrt(np.maximum(1 - far, 0))
        round_ = np.stack([u * squeeze, v * squeeze, towards], axis=-1).astype(np.float32)
        outside = far > (1 + BEYOND / radius) ** 2
        if (outside & (view.ids[box] == body + 1)).any():
            np.copyto(round_, self._turned(body, part, view, box), where=outside[..., None])
        return round_

    def _turned(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """As the photo's map has them, turned in the picture."""
        turn = float(view.poses[body, 2] - self._start[body, 2])
        c, s = np.cos(turn), np.sin(turn)
        there = self._layers.turned(body, part, view, box)
        return np.asarray(cv2.transform(there, np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])), np.float32)


def normal_codes(normals: F32) -> NDArray[np.uint16]:
    """(h, w, 3) of any length -> codes of unit ones; what has none looks at the viewer."""
    x, y, z = cv2.split(normals)
    long = cv2.sqrt(x * x + y * y + z * z)
    lost = long < 1e-6
    if lost.any():
        normals = np.where(lost[..., None], np.array([0, 0, 1], np.float32), normals)
        long = np.where(lost, np.float32(1), long)
    scale = np.float32(UNIT) / long
    codes = normals * cv2.merge((scale, scale, scale))
    codes += np.float32(MIDDLE + 0.5)
    return np.asarray(codes, np.uint16)


# ----------------------------------------------------------------------
# Views -> shading/00000.png ...: the light that falls on what each pixel shows, linear, 16 bits a channel.
#
# It is the frame's own light over the albedo that `albedo` writes, channel by channel, so that albedo times
# shading is
# the frame again: highlights and soft borders, which no albedo tells, are in it. Where albedo is 0 it is 0.

LIGHT = decode(np.arange(256, dtype=np.uint8))
"""Linear light of the codes of sRGB."""
MOST_SHADING = 16.0
"""Of full light, which 65535 stands for: dark paint beside a highlight. Half a step is 0.4 grey levels at most."""


class Shading:
    """Of the frame as it is drawn, with its shadows."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._paint = folder, clip.shared(AlbedoViews)
        self._light: F32 | None = None
        self._found = np.zeros((0, 0, 3), np.uint16)
        write_scale(
            folder, {"at_0": 0.0, "at_65535": MOST_SHADING, "light": "linear", "frame": "albedo x shading"}
        )

    def add(self, moment: Moment) -> None:
        """One file a view."""
        view = moment.view
        albedo = self._paint.seen(view)
        if self._light is None or self._light.shape != albedo.shape:
            self._light, self._found = np.empty(albedo.shape, np.float32), np.empty_like(albedo)
        bgr = np.asarray(cv2.cvtColor(view.rgb, cv2.COLOR_RGB2BGR), np.uint8)
        cv2.LUT(bgr, LIGHT, self._light)
        scale = FULL * FULL / MOST_SHADING
        cv2.divide(self._light, albedo, self._found, scale, cv2.CV_16U)
        (self._folder / f"{view.index:05d}.png").write_bytes(png_of_bgr(self._found))

    def close(self) -> None:
        """Nothing is left to be said."""
