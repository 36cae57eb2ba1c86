"""Scene and its maps -> the report's strip of what was perceived: small pictures with words, pairs to slide between.

Each map that is there gives a picture; what is missing is not mentioned. All together stay small enough to mail.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.assemble import Compiled
from physgen.compile.placed import pictured
from physgen.percepts.maps import Percepts
from physgen.photometry import encode_u8
from physgen.render.ink import Layer, breadth
from physgen.report.encoded import webp
from physgen.report.lamp import light_picture, light_words
from physgen.report.perceived import SUPPORT, colour, owned
from physgen.scene.model import MaskId, Scene, View

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]

SIDE, PAIR = 480, 800
"""px: the longer side of a picture, and of those that slide over each other, at most."""
EFFORTS = ((82, 1.0), (74, 1.0), (64, 1.0), (52, 1.0), (40, 1.0), (40, 0.7), (28, 0.5))
"""WebP's quality, and a part of the sides."""
BUDGET = 360_000
"""Characters of all pictures together: the first effort that fits is taken."""
LETTER = 20
"""px, of names: pictures are shown at less than half their size."""


@dataclass(frozen=True)
class Picture:
    """One of the strip."""

    name: str
    """Short, for ids: `masks`."""
    title: str
    caption: str
    alt: str
    uri: str
    """`data:image/webp;base64,...`."""
    width: int
    height: int


@dataclass(frozen=True)
class Comparison:
    """Two pictures of one size, to slide between."""

    name: str
    title: str
    caption: str
    before: Picture
    after: Picture


@dataclass(frozen=True)
class Perception:
    """The strip, in the order in which it is shown."""

    pictures: tuple[Picture, ...]
    comparisons: tuple[Comparison, ...]


@dataclass(frozen=True)
class Panel:
    """A picture not yet encoded."""

    name: str
    title: str
    caption: str
    alt: str
    rgb: U8


def perception(scene: Scene, compiled: Compiled, maps: Percepts | None) -> Perception | None:
    """None for a scene without a photo."""
    if maps is None:
        return None
    panels = _panels(scene, compiled, maps)
    pair = None
    if maps.background is not None and maps.clean is not None:
        shown = [_fitted(picture, PAIR) for picture in (maps.background, maps.clean)]
        words = ("with their old shadows", "without them")
        pair = tuple(
            Panel(name, said, "", f"The place without the objects, {said}", rgb)
            for name, said, rgb in zip(("shadowed", "clean"), words, shown, strict=True)
        )
    for quality, part in EFFORTS:
        pictures = tuple(_encoded(panel, quality, part) for panel in panels)
        both = tuple(_encoded(panel, quality, part) for panel in pair or ())
        if sum(len(picture.uri) for picture in (*pictures, *both)) <= BUDGET:
            break
    if not both:
        return Perception(pictures, ())
    caption = "What was behind the objects, filled in; slide to take their shadows away."
    return Perception(pictures, (Comparison("background", "Background", caption, *both),))


def compared(
    name: str, title: str, caption: str, before: tuple[str, U8], after: tuple[str, U8], quality: int = 78
) -> Comparison:
    """Two frames (H, W, 3) sRGB of one size, each with what it is: `("as perceived", frame)`.

    For a frame relit and not, refined and not, and the like.
    """
    if before[1].shape != after[1].shape:
        raise ValueError(f"pictures of shapes {before[1].shape} and {after[1].shape} cannot be compared")
    one, other = (
        _encoded(Panel(f"{name}-{side}", said, "", f"{title}, {said}", _fitted(rgb, PAIR)), quality)
        for side, (said, rgb) in (("before", before), ("after", after))
    )
    return Comparison(name, title, caption, one, other)


def _panels(scene: Scene, compiled: Compiled, maps: Percepts) -> list[Panel]:
    height, width = maps.labels.shape
    count, world = len(scene.objects), compiled.world
    objects = f"{count} object{'s' * (count != 1)}"
    photo = _fitted(maps.rgb, SIDE)
    scale = photo.shape[1] / width
    held = f"{len(world.walls)} boundar{'ies' if len(world.walls) != 1 else 'y'}"
    seen = "from above" if world.view is View.TOP else "from the side"
    panels = [
        Panel("photo", "Photo", f"{width} × {height} px.", f"The photo, {width} by {height} pixels", photo),
        Panel(
            "masks",
            "Masks",
            f"{objects}, each in a colour of its own.",
            f"The photo in grey with masks of {objects} in colours",
            _fitted(_masked(maps.rgb, compiled.labels), SIDE),
        ),
        Panel(
            "shapes",
            "Shapes and supports",
            f"{held[0].upper()}{held[1:]}, in yellow; seen {seen}.",
            f"The photo, darker, with the outlines of {objects} and {held}",
            _shapes(compiled, photo, scale),
        ),
    ]
    if maps.depth is not None:
        panels.append(_toned("depth", "Depth", "Bright is near, dark is far.", _depth(maps.depth)))
    if maps.normals is not None:
        said = "Which way surfaces face: red to the right, green downwards, blue towards you."
        panels.append(_toned("normals", "Normals", said, _u8(127.5 + 127.5 * maps.normals)))
    if maps.albedo is not None:
        panels.append(
            _toned("albedo", "Albedo", "Colours without the light on them.", encode_u8(maps.albedo))
        )
    if maps.shading is not None:
        most = max(float(np.percentile(maps.shading, 99.5)), 1e-6)
        grey = np.repeat(encode_u8(np.clip(maps.shading / most, 0, 1))[..., None], 3, 2)
        panels.append(_toned("shading", "Shading", "The light without the colours.", grey))
    if scene.light is not None:
        said = light_words(scene.light)
        card = light_picture(scene.light, (photo.shape[1], photo.shape[0]))
        panels.append(Panel("light", "Light", said, f"A shaded sphere with an arrow. {said}", card))
    if maps.shadows is not None:
        said = "Each in the colour of the object that throws it."
        panels.append(_toned("shadows", "Whose shadow", said, owned(maps.rgb, _owners(scene, maps.shadows))))
    clean = maps.background if maps.clean is None else maps.clean
    if clean is not None and (maps.background is None or maps.clean is None):
        without = "the objects" if maps.clean is None else "the objects and their shadows"
        panels.append(_toned("background", "Background", f"The place without {without}.", clean))
    return panels


def _toned(name: str, title: str, caption: str, rgb: U8) -> Panel:
    return Panel(name, title, caption, f"{title} of the photo. {caption}", _fitted(rgb, SIDE))


def _encoded(panel: Panel, quality: int, part: float = 1.0) -> Picture:
    rgb = panel.rgb if part == 1.0 else _fitted(panel.rgb, round(part * max(panel.rgb.shape[:2])))
    uri, (height, width) = webp(rgb, quality), rgb.shape[:2]
    return Picture(panel.name, panel.title, panel.caption, panel.alt, uri, width, height)


def _fitted(rgb: U8, side: int) -> U8:
    """Made smaller, never larger."""
    height, width = rgb.shape[:2]
    scale = min(1.0, side / max(height, width))
    if scale == 1.0:
        return rgb
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def _u8(values: NDArray[np.floating]) -> U8:
    return np.asarray(np.clip(values + 0.5, 0, 255), np.uint8)


def _masked(rgb: U8, labels: U16) -> U8:
    """The photo in pale grey, objects in colours, white where two meet or one ends."""
    grey = cv2.cvtColor(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB).astype(np.float32)
    colours = np.zeros((int(labels.max(initial=0)) + 1, 3), np.float32)
    for i in range(1, len(colours)):
        colours[i] = colour(i)
    there = (labels > 0)[..., None]
    result = np.where(there, 0.4 * grey + 0.6 * colours[labels], 0.55 * grey)
    thick = max(1, round(max(labels.shape) / SIDE))
    kernel = np.ones((2 * thick + 1,) * 2, np.uint8)
    ids = labels.astype(np.float32)  # what OpenCV can erode
    border = there[..., 0] & (cv2.dilate(ids, kernel) != cv2.erode(ids, kernel))
    result[border] = 255
    return _u8(result)


def _shapes(compiled: Compiled, picture: U8, scale: float) -> U8:
    """Outlines in the colours of the masks, names where there is room, boundaries in yellow."""
    size = picture.shape[1], picture.shape[0]
    dim, names = _u8(0.62 * picture.astype(np.float32)), Layer(size, 0.8)
    walls = Layer(size, 0.8)
    for wall in compiled.world.walls:
        for chain in wall.chains:
            walls.line((chain + 0.5) * scale - 0.5, 2.2)
    walls.onto(dim, SUPPORT)
    for k, body in enumerate(map(pictured, compiled.world.bodies)):
        layer = Layer(size, 0.6)
        rings = [(ring + body.center + 0.5) * scale - 0.5 for ring in body.rings]
        for ring in rings:
            layer.line(ring, 1.6, closed=True)
        layer.onto(dim, colour(k + 1))
        spots = np.concatenate(rings)
        low, high = spots.min(axis=0), spots.max(axis=0)
        if high[0] - low[0] > breadth(body.name, LETTER) + 4 and high[1] - low[1] > LETTER + 3:
            x, y = ((low + high) / 2).tolist()
            names.words(body.name, (x, y), LETTER)
    names.onto(dim, (255, 255, 255))
    return dim


def _owners(scene: Scene, shadows: U16) -> U16:
    """(H, W): the objects that throw them, numbered as compiled labels are; 0 for those that are no longer there."""
    owners = np.zeros_like(shadows)
    for k, item in enumerate(scene.objects):
        if isinstance(item.mask, MaskId):
            owners[shadows == item.mask.id] = k + 1
    return owners


def _depth(depth: NDArray[np.float32]) -> U8:
    low, high = np.percentile(depth, (0.5, 99.5)).tolist()
    near = _u8(255 * (1 - np.clip((depth - low) / max(high - low, 1e-6), 0, 1)))
    return np.asarray(cv2.applyColorMap(near, cv2.COLORMAP_CIVIDIS)[..., ::-1], np.uint8)
