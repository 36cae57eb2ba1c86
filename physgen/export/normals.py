"""Views -> normals/00000.png ...: 16 bits a channel, 32768 + 32767 n, +x right, +y down, +z to the viewer.

They turn with things in the picture. Those of balls (`solid: sphere`) are a sphere's, exactly, wherever it is.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.layers import Layers, Part, filled, hole, parted
from physgen.export.motion import Moment
from physgen.export.pictures import save, told
from physgen.export.places import Still, is_ball, spans
from physgen.export.truth import Clip, View
from physgen.render.placing import Slices

F32 = NDArray[np.float32]
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
            Still.of(clip.trajectory, clip.world).poses,
        )
        told(folder, {"zero": MIDDLE, "one": MIDDLE + UNIT, "axes": "+x right, +y down, +z to the viewer"})
        normals = clip.maps.normals
        self._layers = Layers(clip, filled(normals, hole(clip)), parted(normals, clip), coded)

    def add(self, moment: Moment) -> None:
        """One file a view."""
        save(self._folder / f"{moment.view.index:05d}.png", self._layers.seen(moment.view, self._sampled))

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


def coded(normals: F32) -> NDArray[np.uint16]:
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
