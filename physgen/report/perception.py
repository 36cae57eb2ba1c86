"""Pictures of what was perceived in a photo: masks, shapes, surface maps, light, shadows and background."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.appearance import body_in_photo
from physgen.compile.compile import Compiled
from physgen.maps import Keep, Percepts, ignore_kept_file, write_png
from physgen.perceive.roles import PerceivedScene
from physgen.photometry import DistantLight, encode_u8, sphere_normals
from physgen.problems import InputError
from physgen.render.drawing import Colour, Layer, circle, straight_arrow, text_width
from physgen.report.html import webp
from physgen.scene.scene import Light, MaskId, Scene, View

# ----------------------------------------------------------------------
# A scene's light -> words and a picture: a white ball in it, and an arrow from where it comes.

U8 = NDArray[np.uint8]

SUN: Colour = (255, 205, 64)


def light_description(light: Light) -> str:
    """Where it comes from, as one says it.

    >>> light_words(Light((-0.6, -0.64, 0.48), 1.0, 0.25, 2.0))
    'From the upper left, in front of the scene; 20 % of it from all around.'
    """
    x, y, z = light.direction
    across = "" if abs(x) < 0.2 else "right" if x > 0 else "left"
    up = "" if abs(y) < 0.2 else "above" if y < 0 else "below"
    corner = {"above": "upper", "below": "lower"}.get(up, "")
    where = f"the {corner} {across}" if across and up else f"the {across}" if across else up
    deep = "" if abs(z) < 0.2 else "in front of the scene" if z > 0 else "behind the scene"
    share = light.ambient / max(light.ambient + light.intensity, 1e-6)
    whence = ", ".join(part for part in (where, deep) if part)
    return f"From {whence}; {share:.0%} of it from all around.".replace("%", " %", 1)


def light_picture(light: Light, size: tuple[int, int]) -> U8:
    """(h, w, 3) of `size` (w, h): a white ball in the light, an arrow from where that comes."""
    width, height = size
    radius, middle = 0.26 * min(size), np.array([(width - 1) / 2, (height - 1) / 2])
    card = _ball(light, size, radius)
    way = np.array(light.direction[:2])
    flat, toward = float(hypot(*way)), light.direction[2]
    layer, pen = Layer(size, 1.0), max(2.0, min(size) / 90)
    if flat > 0.12:
        tail, tip = middle + 1.75 * radius * way, middle + 1.12 * radius * way
        if toward < 0:  # it ends behind the ball's rim
            tip = middle + way / flat * max(1.12 * flat, 1.04) * radius
            tail = tip + way / flat * max(0.63 * flat, 0.3) * radius
        straight_arrow(layer, tail, tip, pen)
    else:  # straight at us, or from us
        spot = middle + radius * way
        layer.line(circle(spot, 4.2 * pen), pen, closed=True)
        if toward > 0:
            layer.area(circle(spot, 1.3 * pen))
    layer.onto(card, SUN)
    return card


def _ball(light: Light, size: tuple[int, int], radius: float, fine: int = 3) -> U8:
    """The ball is drawn `fine` times as large and averaged, in linear light, so that its rim is smooth."""
    width, height = size
    across = (np.arange(width, dtype=np.float32) / width - 0.5)[None]
    down = (np.arange(height, dtype=np.float32) / height - 0.5)[:, None]
    linear = 0.06 - 0.05 * np.hypot(across, down)
    # a box around it that begins and ends with whole pixels
    x0, y0 = (int((side - 1) / 2 - radius) - 1 for side in size)
    wide, tall = width - 2 * x0, height - 2 * y0
    normals, inside = sphere_normals(
        fine * tall, fine * wide, ((fine * wide - 1) / 2, (fine * tall - 1) / 2), radius * fine
    )
    lamp = DistantLight(light.direction, light.intensity, light.ambient)
    shades = 0.86 * lamp.shade(normals) / max(light.ambient + light.intensity, 1e-6)
    box = linear[y0 : y0 + tall, x0 : x0 + wide]
    around = box.repeat(fine, axis=0).repeat(fine, axis=1)
    drawn = np.where(inside, np.maximum(shades, 0.012), around).astype(np.float32)
    box[:] = cv2.resize(drawn, (wide, tall), interpolation=cv2.INTER_AREA)
    return np.repeat(encode_u8(linear)[..., None], 3, 2)


# ----------------------------------------------------------------------
# What was perceived -> one picture: the photo, shapes and supports, surfaces, light, shadows, background.

F32 = NDArray[np.float32]

COLUMNS = 4
WIDTH = 480
"""px of one panel, at most and at least about."""
GAP, CAPTION = 10, 30
"""px between panels, and of the line of words above each."""
PAPER: Colour = (246, 245, 242)
WORDS: Colour = (32, 34, 40)
SUPPORT: Colour = (255, 196, 0)


def sheet(perceived: PerceivedScene) -> U8:
    """(H, W, 3) sRGB: eight panels with captions, four in a row."""
    panels = list(_panels(perceived))
    height, width = panels[0][1].shape[:2]
    rows = -(-len(panels) // COLUMNS)
    page = np.empty((rows * (height + CAPTION + GAP) + GAP, COLUMNS * (width + GAP) + GAP, 3), np.uint8)
    page[:] = PAPER
    words = Layer((page.shape[1], page.shape[0]), 0.0)
    for k, (caption, picture) in enumerate(panels):
        y, x = GAP + k // COLUMNS * (height + CAPTION + GAP), GAP + k % COLUMNS * (width + GAP)
        page[y + CAPTION : y + CAPTION + height, x : x + width] = picture
        words.words(caption, (x + width / 2, y + CAPTION / 2), 15)
    words.onto(page, WORDS, 0.0)
    return page


def check_sheet(path: Path | None, photo: Path) -> None:
    """Raises InputError where a sheet cannot go, before anything is done."""
    if path is None:
        return
    if path.suffix.lower() != ".png":
        raise InputError.of("--sheet", f'"{path}"', "is no PNG", "let its name end in .png")
    if path.exists() and (path.is_dir() or (photo.exists() and path.samefile(photo))):
        what = "is a folder" if path.is_dir() else "is the photo itself"
        raise InputError.of("--sheet", f'"{path}"', what, "name another file")
    above = next(part for part in (path.parent, *path.parent.parents) if part.exists())
    if not above.is_dir():
        raise InputError.of(
            "--sheet", f'"{path}"', f'lies below "{above}", which is no folder', "name another file"
        )


def write_sheet(path: Path, perceived: PerceivedScene, keep: Keep = ignore_kept_file) -> None:
    """The sheet as a PNG; folders are created, a file in the way that differs is kept as `NAME~`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_png(path, sheet(perceived), keep)


def _panels(perceived: PerceivedScene) -> Sequence[tuple[str, U8]]:
    maps, document = perceived.percepts, perceived.document
    height, width = maps.labels.shape
    scale = WIDTH / width
    size = WIDTH, max(1, round(height * scale))

    def shown(picture: U8) -> U8:
        how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        return np.asarray(cv2.resize(picture, size, interpolation=how), np.uint8)

    world, objects = document["world"], document["objects"]
    panels = [
        (f"photo, {width} x {height} px", shown(maps.rgb)),
        (
            f"{len(objects)} shapes, seen from the {world['view']}, and what holds them",
            _shapes(document, shown(maps.rgb), scale),
        ),
    ]
    if maps.normals is not None:
        panels.append(("normals", shown(_u8(127.5 + 127.5 * maps.normals))))
    if maps.albedo is not None:
        panels.append(("albedo", shown(encode_u8(maps.albedo))))
    if maps.shading is not None:
        most = max(float(np.percentile(maps.shading, 99.5)), 1e-6)
        grey = encode_u8(np.clip(maps.shading / most, 0, 1))
        panels.append(("shading", shown(np.repeat(grey[..., None], 3, 2))))
    if "light" in document:
        panels.append(_lit(document["light"], size))
    if maps.shadows is not None:
        panels.append(("whose shadow lies where", shown(shadow_owners_picture(maps.rgb, maps.shadows))))
    clean = maps.background if maps.clean is None else maps.clean
    if clean is not None:
        what = "without the objects" if maps.clean is None else "without the objects and their shadows"
        panels.append((what, shown(clean)))
    return panels


def _u8(values: NDArray[Any]) -> U8:
    return np.clip(values + 0.5, 0, 255).astype(np.uint8)


def colour(number: int) -> Colour:
    """A colour for an id, far from those of its neighbours."""
    r, g, b = colorsys.hsv_to_rgb(number * 0.381966 % 1.0, 0.75, 1.0)
    return round(255 * r), round(255 * g), round(255 * b)


def _shapes(document: Mapping[str, Any], picture: U8, scale: float) -> U8:
    """Outlines in each object's colour, names where there is room, supports in yellow."""
    size = picture.shape[1], picture.shape[0]
    dim = _u8(0.75 * picture)
    letter, names = 11.0, Layer(size, 0.8)
    for one in document["boundaries"].values():
        points = np.array(one.get("segment") or one["polyline"], float)
        layer = Layer(size, 0.8)
        layer.line((points + 0.5) * scale - 0.5, 2.2)
        layer.onto(dim, SUPPORT)
    for name, one in document["objects"].items():
        layer = Layer(size, 0.6)
        corners = [(part + 0.5) * scale - 0.5 for part in _rings(one["shape"])]
        for part in corners:
            layer.line(part, 1.4, closed=True)
        low, high = np.min([part.min(0) for part in corners], 0), np.max([part.max(0) for part in corners], 0)
        if min(high - low) > 14:
            x, y = ((low + high) / 2).tolist()
            names.words(name if high[0] - low[0] > 7 * len(name) else str(one["mask"]), (x, y), letter)
        layer.onto(dim, colour(one["mask"]) if isinstance(one["mask"], int) else WORDS)
    names.onto(dim, (255, 255, 255))
    return dim


def _rings(shape: Mapping[str, Any]) -> list[NDArray[np.float64]]:
    """(K, 2) px each: the closed borders of a scene's `shape`."""
    if "circle" in shape:
        turn = np.linspace(0, 2 * np.pi, 72, endpoint=False)
        ring = np.stack([np.cos(turn), np.sin(turn)], 1)
        return [np.asarray(shape["circle"]["center"] + shape["circle"]["radius"] * ring)]
    if "box" in shape:
        box = shape["box"]
        angle = np.radians(box.get("angle", 0.0))
        x, y = np.array(box["size"]) / 2
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        return [np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) @ turn + box["center"]]
    if "polygon" in shape:
        return [np.array(shape["polygon"], float)]
    rings = []
    for piece in shape["polygons"]:
        rings += [np.array(ring, float) for ring in (piece["outline"], *piece.get("holes", ()))]
    return rings


def _lit(said: Mapping[str, Any], size: tuple[int, int]) -> tuple[str, U8]:
    """A white ball in the light, on a grey card."""
    x, y, z = said["direction"]
    light = DistantLight((x, y, z), said["intensity"], said["ambient"])
    width, height = size
    radius = 0.36 * min(size)
    normals, inside = sphere_normals(height, width, ((width - 1) / 2, (height - 1) / 2), radius)
    most = light.ambient + light.intensity
    shades = np.where(inside, 0.9 * light.shade(normals) / max(most, 1e-6), 0.18).astype(np.float32)
    card = np.repeat(encode_u8(shades)[..., None], 3, 2)
    share = light.ambient / max(most, 1e-6)
    return f"light from ({x:g}, {y:g}, {z:g}), {share:.0%} of it from all around", card


def shadow_owners_picture(rgb: U8, owners: NDArray[np.uint16]) -> U8:
    """The photo in grey, shadows in the colours of the objects that throw them."""
    grey = cv2.cvtColor(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB).astype(np.float32)
    result = 0.8 * grey
    for i in np.unique(owners[owners > 0]).tolist():
        own = owners == i
        result[own] = 0.45 * grey[own] + 0.55 * np.array(colour(i), np.float32)
    return _u8(result)


# ----------------------------------------------------------------------
# Scene and its maps -> the report's strip of what was perceived: small pictures with words, pairs to slide
# between.
#
# Each map that is there gives a picture; what is missing is not mentioned. All together stay small enough to
# mail.

Array = NDArray[np.float64]
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
    panels = _perception_panels(scene, compiled, maps)
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


def _perception_panels(scene: Scene, compiled: Compiled, maps: Percepts) -> list[Panel]:
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
            _perception_shapes(compiled, photo, scale),
        ),
    ]
    if maps.depth is not None:
        panels.append(_toned("depth", "Depth", "Bright is near, dark is far.", _depth(maps.depth)))
    if maps.normals is not None:
        said = "Which way surfaces face: red to the right, green downwards, blue towards you."
        panels.append(_toned("normals", "Normals", said, _perception_u8(127.5 + 127.5 * maps.normals)))
    if maps.albedo is not None:
        panels.append(
            _toned("albedo", "Albedo", "Colours without the light on them.", encode_u8(maps.albedo))
        )
    if maps.shading is not None:
        most = max(float(np.percentile(maps.shading, 99.5)), 1e-6)
        grey = np.repeat(encode_u8(np.clip(maps.shading / most, 0, 1))[..., None], 3, 2)
        panels.append(_toned("shading", "Shading", "The light without the colours.", grey))
    if scene.light is not None:
        said = light_description(scene.light)
        card = light_picture(scene.light, (photo.shape[1], photo.shape[0]))
        panels.append(Panel("light", "Light", said, f"A shaded sphere with an arrow. {said}", card))
    if maps.shadows is not None:
        said = "Each in the colour of the object that throws it."
        panels.append(
            _toned(
                "shadows", "Whose shadow", said, shadow_owners_picture(maps.rgb, _owners(scene, maps.shadows))
            )
        )
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


def _perception_u8(values: NDArray[np.floating]) -> U8:
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
    return _perception_u8(result)


def _perception_shapes(compiled: Compiled, picture: U8, scale: float) -> U8:
    """Outlines in the colours of the masks, names where there is room, boundaries in yellow."""
    size = picture.shape[1], picture.shape[0]
    dim, names = _perception_u8(0.62 * picture.astype(np.float32)), Layer(size, 0.8)
    walls = Layer(size, 0.8)
    for wall in compiled.world.walls:
        for chain in wall.chains:
            walls.line((chain + 0.5) * scale - 0.5, 2.2)
    walls.onto(dim, SUPPORT)
    for k, body in enumerate(map(body_in_photo, compiled.world.bodies)):
        layer = Layer(size, 0.6)
        rings = [(ring + body.center + 0.5) * scale - 0.5 for ring in body.rings]
        for ring in rings:
            layer.line(ring, 1.6, closed=True)
        layer.onto(dim, colour(k + 1))
        spots = np.concatenate(rings)
        low, high = spots.min(axis=0), spots.max(axis=0)
        if high[0] - low[0] > text_width(body.name, LETTER) + 4 and high[1] - low[1] > LETTER + 3:
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
    near = _perception_u8(255 * (1 - np.clip((depth - low) / max(high - low, 1e-6), 0, 1)))
    return np.asarray(cv2.applyColorMap(near, cv2.COLORMAP_CIVIDIS)[..., ::-1], np.uint8)
