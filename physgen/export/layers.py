"""Layers for compositing: objects with alpha, a clean plate, and passes for shadows,
borders and ids.

    plate x shadow, then each object over it, the farthest first, then x multiply + add = the frame

All values are linear light. The last two passes hold the remainder outside the layers:
pixels of the photo that mix an object with its background, reflections in a floor, and
rounding. `layers.json` names every file, and `blender.py` builds the clip from them in
Blender.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from physgen.export.cryptomatte import write_cryptomatte
from physgen.export.labels import Clip, Moment, View, Writer, write_json, write_png
from physgen.export.video import open_alpha_clip
from physgen.files import resource
from physgen.maps import F32, U8, U16
from physgen.photometry import decode, encode, encode_u8
from physgen.render.stage import Layers

LIGHTEST = 65535
"""Code of 1 in a file of 16 bits."""
UNSAFE = re.compile(r"[^\w.-]+")
SPREADS = (3, 9, 33)
"""Sizes of the means that continue an object's colours beyond its border, px, for
codecs without premultiplication.
"""


@dataclass(frozen=True)
class Encoding:
    """Encoding of pictures."""

    name: str
    """Name in `layers.json`."""
    suffix: str
    """Suffix of a clip; empty for a folder of PNG."""

    @property
    def pattern(self) -> str:
        """Return the end of a pass's path: a file per frame, or one clip."""
        return self.suffix or "/%05d.png"


PNG = Encoding("linear, premultiplied, 16 bits", "")
PRORES = Encoding("sRGB, premultiplied", ".mov")
"""Codes are multiplied by alpha, as Blender and film editors expect for 10 bits."""
VP9 = Encoding("sRGB, straight alpha", ".webm")
"""Encoding for browsers."""
Put = Callable[[F32], None]
"""A function for one linear picture (h, w, 3), or (h, w, 4) premultiplied."""


def quantize(light: F32) -> U16:
    """Return linear light 0..1 as 16 bits."""
    codes = np.rint(np.clip(light, 0, 1) * LIGHTEST)
    return codes.astype(np.uint16)


def round_light(light: F32) -> F32:
    """Return light after rounding in a file of 16 bits."""
    return np.asarray(quantize(light) / np.float32(LIGHTEST), np.float32)


class LayerFiles(Writer):
    """Writes the layers of each frame; `encoding` is PNG, or an encoding of clips with
    alpha.
    """

    encoding = PNG

    def __init__(self, folder: Path, clip: Clip) -> None:
        super().__init__(folder, clip)
        self._stack = ExitStack()
        self._puts: dict[str, Put] = {}
        self._frames: list[dict[str, Any]] = []
        self._order: tuple[int, ...] = ()
        self._plate: F32 | None = None
        self._paths = {"shadow": "shadow", "multiply": "multiply", "add": "add"}
        self._has_cryptomatte = find_spec("OpenEXR") is not None
        script = resource("templates", "blender_layers.py").read_bytes()
        (folder / "blender.py").write_bytes(script)

    def add(self, moment: Moment) -> None:
        """Write all layers of a frame."""
        view = moment.view
        assert view.find_layers is not None
        layers = view.find_layers()
        self._order = tuple(layers.order)
        plate = round_light(layers.plate)
        self._put_plate(plate)
        shadow = round_light(shadow_pass(layers))
        objects = layers.pictures()
        composite = plate * shadow
        self._put("shadow", shadow)
        for body in self._order:
            picture = round_light(objects[body])
            # Porter and Duff's "over", with premultiplied light, from the back to the
            # front.
            composite = composite * (1 - picture[..., 3:]) + picture[..., :3]
            self._put(self._object_path(body), picture)
        # The composite of the rounded files must give the frame, so that the
        # corrections come last.
        multiply, add = corrections(composite, view.rgb)
        self._put("multiply", multiply)
        self._put("add", add)
        self._write_ids(view, objects)
        self._frames.append(self._transforms(view))

    def close(self) -> None:
        """Finish the clips, and describe all files."""
        self._stack.close()
        write_json(self._folder / "layers.json", self._description())

    def _object_path(self, body: int) -> str:
        name = UNSAFE.sub("_", self._clip.names[body])
        return f"objects/{body + 1:03d}-{name}"

    def _put_plate(self, plate: F32) -> None:
        """Write the background once, or for each frame if the camera moves."""
        if self._clip.shot.moves:
            self._put("plate", plate)
        elif self._plate is None:
            write_png(self._folder / "plate.png", quantize(plate))
        self._plate = plate

    def _put(self, path: str, picture: F32) -> None:
        """Write the next picture of a pass."""
        if path not in self._puts:
            self._puts[path] = self._open(path, picture)
        self._puts[path](picture)

    def _open(self, path: str, picture: F32) -> Put:
        """Return a function that writes a pass."""
        folder = self._folder / path
        if not self.encoding.suffix:
            folder.mkdir(parents=True)
            return _PngFolder(folder).put
        folder.parent.mkdir(parents=True, exist_ok=True)
        file = folder.with_name(folder.name + self.encoding.suffix)
        write = self._stack.enter_context(
            open_alpha_clip(file, self._clip.size, self._clip.fps, picture.shape[2])
        )

        encoding = self.encoding

        def put(light: F32) -> None:
            colour = straight_srgb(light)
            # Editors expect premultiplied codes in ProRes, and browsers straight ones
            # in VP9.
            if encoding is PRORES and light.shape[2] == 4:
                colour[..., :3] *= colour[..., 3:]
            write(quantize(colour))

        return put

    def _write_ids(self, view: View, objects: Mapping[int, F32]) -> None:
        """Write the ids, and their shares of each pixel."""
        (self._folder / "ids").mkdir(exist_ok=True)
        write_png(self._folder / "ids" / f"{view.index:05d}.png", view.ids)
        if not self._has_cryptomatte:
            return
        shares = visible_shares(objects, self._order)
        shares_by_name = {
            self._clip.names[body]: share for body, share in shares.items()
        }
        (self._folder / "cryptomatte").mkdir(exist_ok=True)
        file = self._folder / "cryptomatte" / f"{view.index:05d}.exr"
        write_cryptomatte(file, shares_by_name, self._clip.names)

    def _transforms(self, view: View) -> dict[str, Any]:
        """Return the places of the camera and of each object."""
        scale = float(view.lens[0, 0])
        places = {}
        for body, name in enumerate(self._clip.names):
            x, y, angle = view.poses[body].tolist()
            u, v = (view.lens @ [x, y, 1.0]).tolist()
            places[name] = {"x": u, "y": v, "angle_rad": angle, "scale": scale}
        return {
            "frame": view.index,
            "time": view.time,
            "lens": view.lens.tolist(),
            "objects": places,
        }

    def _description(self) -> dict[str, Any]:
        pattern = self.encoding.pattern
        plate = "plate.png"
        if self._clip.shot.moves:
            plate = "plate" + pattern
        objects = []
        for body in self._order:
            path = self._object_path(body) + pattern
            label = self._clip.labels[body]
            entry = {"id": body + 1, "name": self._clip.names[body], "label": label}
            objects.append({**entry, "path": path})
        if self._has_cryptomatte:
            cryptomatte = "cryptomatte/%05d.exr"
        else:
            cryptomatte = None
        return {
            "layers": 1,
            "size": list(self._clip.size),
            "fps": self._clip.fps,
            "encoding": self.encoding.name,
            "plate": plate,
            "shadow": "shadow" + pattern,
            "objects": objects,
            "multiply": "multiply" + pattern,
            "add": "add" + pattern,
            "ids": "ids/%05d.png",
            "cryptomatte": cryptomatte,
            "frames": self._frames,
        }


class ProResLayers(LayerFiles):
    """Layers as clips of ProRes 4444."""

    encoding = PRORES


class Vp9Layers(LayerFiles):
    """Layers as clips of VP9."""

    encoding = VP9


class _PngFolder:
    """A folder of numbered PNG."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._count = folder, 0

    def put(self, light: F32) -> None:
        picture = quantize(light)
        file = self._folder / f"{self._count:05d}.png"
        if picture.shape[2] == 4:
            bgra = cv2.cvtColor(picture, cv2.COLOR_RGBA2BGRA)
            file.write_bytes(cv2.imencode(".png", bgra)[1].tobytes())
        else:
            write_png(file, picture)
        self._count += 1


def shadow_pass(layers: Layers) -> F32:
    """Return the share of the plate's light after shadows, (H, W, 3), at most 1."""
    # No division by zero in black parts of the plate.
    plate = np.maximum(layers.plate, np.float32(1 / LIGHTEST))
    return np.asarray(np.clip(layers.shaded_plate / plate, 0, 1), np.float32)


def visible_shares(
    objects: Mapping[int, F32], order: tuple[int, ...]
) -> dict[int, F32]:
    """Return the share (H, W) of each pixel with a visible object, by body. Nearer
    objects hide farther ones.
    """
    shares = {}
    free: F32 | None = None
    # From the nearest to the farthest: each hides a share of those behind it.
    for body in reversed(order):
        coverage = np.clip(objects[body][..., 3], 0, 1)
        if free is None:
            shares[body] = coverage
        else:
            shares[body] = coverage * free
        if free is None:
            free = 1 - coverage
        else:
            free = free * (1 - coverage)
    return shares


def corrections(composite: F32, frame: U8) -> tuple[F32, F32]:
    """Return factors and additions (H, W, 3) that make the layers equal to the frame; 1
    and 0 at equal pixels.
    """
    # The comparison is in the codes of the frame: rounding must not make corrections.
    difference = encode_u8(composite).astype(np.int16) - frame
    target = decode(frame)
    multiply = np.ones_like(composite)
    is_darker = difference > 0
    # Too bright pixels are multiplied and too dark ones added to: no value is negative.
    multiply[is_darker] = target[is_darker] / composite[is_darker]
    add = np.zeros_like(composite)
    is_brighter = difference < 0
    add[is_brighter] = target[is_brighter] - composite[is_brighter]
    return multiply, add


def straight_srgb(light: F32) -> F32:
    """Return linear light as sRGB.

    Colours of premultiplied light (h, w, 4) are divided by alpha and continued beyond
    borders.
    """
    if light.shape[2] == 3:
        return encode(light)
    # Formats with straight alpha store the colour of the object alone, and an encoder
    # may mix it with the colour of invisible neighbours.
    alpha = light[..., 3]
    colour = np.zeros_like(light[..., :3])
    is_known = alpha > 0
    colour[is_known] = light[is_known][:, :3] / alpha[is_known][:, None]
    # Encoders blend neighbours: without colours outside, borders would turn dark.
    for side in SPREADS:
        total = cv2.blur(light[..., :3], (side, side))
        share = cv2.blur(alpha, (side, side))
        is_new = (share > 1 / LIGHTEST) & ~is_known
        colour[is_new] = total[is_new] / share[is_new][:, None]
        is_known |= is_new
    return np.dstack([encode(np.clip(colour, 0, 1)), alpha])
