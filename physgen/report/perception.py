"""Pictures of what was perceived in a photo: masks, shapes, surface maps, light, shadows and background.

The report page shows them as a strip of small WebP pictures, with pairs to slide between; `perceive --sheet` writes
them as one PNG. Each map that exists gives a picture; all together stay small enough for mail.
"""

from __future__ import annotations

import colorsys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
from physgen.render.frames import render_frames
from physgen.render.stage import Stage
from physgen.report.html import fitted, webp
from physgen.scene.scene import Light, MaskId, Scene, View
from physgen.simulate.trajectory import Trajectory, rotation_matrices

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]

SIDE, PAIR_SIDE = 480, 800
"""px: longer side of a picture, and of those that slide over each other, at most."""
EFFORTS = ((82, 1.0), (74, 1.0), (64, 1.0), (52, 1.0), (40, 1.0), (40, 0.7), (28, 0.5))
"""WebP's quality, and a part of the sides."""
BUDGET = 360_000
"""Characters of all pictures together: the first effort that fits is used."""
PAIR_QUALITY = 78
LETTER = 20
"""px, of names: pages show pictures at less than half their size."""
SUPPORT: Colour = (255, 196, 0)
SUN: Colour = (255, 205, 64)
PAPER: Colour = (246, 245, 242)
WORDS: Colour = (32, 34, 40)
WHITE: Colour = (255, 255, 255)
SHEET_COLUMNS, WIDTH, GAP, CAPTION = 4, 480, 10, 30
"""Of the sheet: panels in a row; px of a panel's width, between panels, and of the line of words above each."""
TURNED = 0.03
"""1 - cos of the turn, 14 degrees, below which relighting makes no visible difference."""
VISIBLE = 6.0
"""Grey levels of 255, averaged over 5 x 5 px: a smaller largest difference is not shown."""


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


Outlines = Sequence[tuple[str, int, Sequence[Array]]]
"""Name, number of the colour, and closed rings (K, 2) px of each object."""


def perception(scene: Scene, compiled: Compiled, maps: Percepts | None) -> Perception | None:
    """None for a scene without a photo."""
    if maps is None:
        return None
    world = compiled.world
    objects = [
        (body.name, k, [ring + body.center for ring in body.rings])
        for k, body in enumerate(map(body_in_photo, world.bodies), 1)
    ]
    walls = [chain for wall in world.walls for chain in wall.chains]
    shadows = None if maps.shadows is None else _by_object(scene, maps.shadows)
    seen = "from above" if world.view is View.TOP else "from the side"
    panels = _panels(
        replace(maps, labels=compiled.labels, shadows=shadows), objects, walls, scene.light, seen, SIDE
    )
    pair: list[Panel] = []
    if maps.background is not None and maps.clean is not None:
        panels = [panel for panel in panels if panel.name != "background"]
        for name, words, rgb in (
            ("shadowed", "with their old shadows", maps.background),
            ("clean", "without them", maps.clean),
        ):
            alt = f"The place without the objects, {words}"
            pair.append(Panel(name, words, "", alt, fitted(rgb, PAIR_SIDE)))
    for quality, part in EFFORTS:
        pictures = tuple(_encoded(panel, quality, part) for panel in panels)
        both = [_encoded(panel, quality, part) for panel in pair]
        if sum(len(picture.uri) for picture in (*pictures, *both)) <= BUDGET:
            break
    if not both:
        return Perception(pictures, ())
    caption = "The area behind the objects, filled in; slide to remove their shadows."
    return Perception(pictures, (Comparison("background", "Background", caption, *both),))


def compared(
    name: str, title: str, caption: str, before: tuple[str, U8], after: tuple[str, U8]
) -> Comparison:
    """Two frames (H, W, 3) sRGB of one size, each with a description: `("refined", frame)`."""
    if before[1].shape != after[1].shape:
        raise ValueError(f"pictures of shapes {before[1].shape} and {after[1].shape} cannot be compared")
    one, other = (
        _encoded(
            Panel(f"{name}-{side}", words, "", f"{title}, {words}", fitted(rgb, PAIR_SIDE)), PAIR_QUALITY
        )
        for side, (words, rgb) in (("before", before), ("after", after))
    )
    return Comparison(name, title, caption, one, other)


def _panels(
    maps: Percepts, objects: Outlines, walls: Sequence[Array], light: Light | None, seen: str, side: int
) -> list[Panel]:
    """`maps.labels` and `maps.shadows` are numbered as `objects` are."""
    height, width = maps.labels.shape
    photo = fitted(maps.rgb, side)
    count = f"{len(objects)} object{'s' * (len(objects) != 1)}"
    bounds = f"{len(walls)} boundar{'ies' if len(walls) != 1 else 'y'}"

    def toned(name: str, title: str, caption: str, rgb: U8) -> Panel:
        return Panel(name, title, caption, f"{title} of the photo. {caption}", fitted(rgb, side))

    panels = [
        Panel("photo", "Photo", f"{width} × {height} px.", f"The photo, {width} by {height} pixels", photo),
        Panel(
            "masks",
            "Masks",
            f"{count}, each in its own colour.",
            f"The photo in grey with masks of {count} in colours",
            fitted(_masked(maps.rgb, maps.labels, max(height, width) / side), side),
        ),
        Panel(
            "shapes",
            "Shapes and supports",
            f"{bounds[0].upper()}{bounds[1:]}, in yellow; seen {seen}.",
            f"The photo, darker, with the outlines of {count} and {bounds}",
            _outlined(photo, photo.shape[1] / width, objects, walls),
        ),
    ]
    if maps.depth is not None:
        panels.append(toned("depth", "Depth", "Bright is near, dark is far.", _depth(maps.depth)))
    if maps.normals is not None:
        text = "Orientation of surfaces: red to the right, green downwards, blue towards you."
        panels.append(toned("normals", "Normals", text, _u8(127.5 + 127.5 * maps.normals)))
    if maps.albedo is not None:
        panels.append(toned("albedo", "Albedo", "Colours without the light on them.", encode_u8(maps.albedo)))
    if maps.shading is not None:
        most = max(float(np.percentile(maps.shading, 99.5)), 1e-6)
        grey = np.repeat(encode_u8(np.clip(maps.shading / most, 0, 1))[..., None], 3, 2)
        panels.append(toned("shading", "Shading", "The light without the colours.", grey))
    if light is not None:
        text = light_description(light)
        card = light_picture(light, (photo.shape[1], photo.shape[0]))
        panels.append(Panel("light", "Light", text, f"A shaded sphere with an arrow. {text}", card))
    if maps.shadows is not None:
        text = "Each in the colour of the object that casts it."
        panels.append(toned("shadows", "Shadows by object", text, _shadows(maps.rgb, maps.shadows)))
    clean = maps.background if maps.clean is None else maps.clean
    if clean is not None:
        without = "the objects" if maps.clean is None else "the objects and their shadows"
        panels.append(toned("background", "Background", f"The place without {without}.", clean))
    return panels


def _encoded(panel: Panel, quality: int, part: float = 1.0) -> Picture:
    rgb = panel.rgb if part == 1.0 else fitted(panel.rgb, round(part * max(panel.rgb.shape[:2])))
    height, width = rgb.shape[:2]
    return Picture(panel.name, panel.title, panel.caption, panel.alt, webp(rgb, quality), width, height)


def _u8(values: NDArray[np.floating[Any]]) -> U8:
    return np.asarray(np.clip(values + 0.5, 0, 255), np.uint8)


def colour(number: int) -> Colour:
    """A colour for an id, different from those of neighbouring numbers."""
    r, g, b = colorsys.hsv_to_rgb(number * 0.381966 % 1.0, 0.75, 1.0)
    return round(255 * r), round(255 * g), round(255 * b)


def _grey(rgb: U8) -> NDArray[np.float32]:
    """(H, W, 3)."""
    grey = cv2.cvtColor(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    return np.asarray(grey, np.float32)


def _colours(labels: U16) -> NDArray[np.float32]:
    """(H, W, 3): each label's colour; black for 0."""
    table = np.array([(0, 0, 0), *map(colour, range(1, int(labels.max(initial=0)) + 1))], np.float32)
    return np.asarray(table[labels])


def _masked(rgb: U8, labels: U16, scale: float) -> U8:
    """The photo in pale grey, objects in colours, white along borders."""
    grey = _grey(rgb)
    result = np.where((labels > 0)[..., None], 0.4 * grey + 0.6 * _colours(labels), 0.55 * grey)
    kernel = np.ones((2 * max(1, round(scale)) + 1,) * 2, np.uint8)
    ids = labels.astype(np.float32)  # a type that OpenCV can erode
    result[(labels > 0) & (cv2.dilate(ids, kernel) != cv2.erode(ids, kernel))] = 255
    return _u8(result)


def _shadows(rgb: U8, objects: U16) -> U8:
    """The photo in grey, shadows in the colours of the objects that cast them."""
    grey = _grey(rgb)
    there = (objects > 0)[..., None]
    return _u8(np.where(there, 0.45 * grey + 0.55 * _colours(objects), 0.8 * grey))


def _outlined(picture: U8, scale: float, objects: Outlines, walls: Sequence[Array]) -> U8:
    """Outlines in the colours of the masks, names where there is room, boundaries in yellow."""
    size = picture.shape[1], picture.shape[0]
    dim, names, lines = _u8(0.62 * picture.astype(np.float32)), Layer(size, 0.8), Layer(size, 0.8)
    for chain in walls:
        lines.line((chain + 0.5) * scale - 0.5, 2.2)
    lines.onto(dim, SUPPORT)
    for name, number, rings in objects:
        layer = Layer(size, 0.6)
        placed = [(ring + 0.5) * scale - 0.5 for ring in rings]
        for ring in placed:
            layer.line(ring, 1.6, closed=True)
        layer.onto(dim, colour(number))
        points = np.concatenate(placed)
        low, high = points.min(axis=0), points.max(axis=0)
        if high[0] - low[0] > text_width(name, LETTER) + 4 and high[1] - low[1] > LETTER + 3:
            x, y = ((low + high) / 2).tolist()
            names.words(name, (x, y), LETTER)
    names.onto(dim, WHITE)
    return dim


def _by_object(scene: Scene, shadows: U16) -> U16:
    """(H, W): shadows by the objects' order in the scene; 0 for objects that are no longer there."""
    found = np.zeros_like(shadows)
    for k, item in enumerate(scene.objects, 1):
        if isinstance(item.mask, MaskId):
            found[shadows == item.mask.id] = k
    return found


def _depth(depth: NDArray[np.float32]) -> U8:
    low, high = np.percentile(depth, (0.5, 99.5)).tolist()
    near = _u8(255 * (1 - np.clip((depth - low) / max(high - low, 1e-6), 0, 1)))
    return np.asarray(cv2.applyColorMap(near, cv2.COLORMAP_CIVIDIS)[..., ::-1], np.uint8)


def light_description(light: Light) -> str:
    """The direction of the light in words.

    >>> light_description(Light((-0.6, -0.64, 0.48), 1.0, 0.25, 2.0))
    'From the upper left, in front of the scene; 20 % of it from all around.'
    """
    x, y, z = light.direction
    across = "" if abs(x) < 0.2 else "right" if x > 0 else "left"
    up = "" if abs(y) < 0.2 else "above" if y < 0 else "below"
    corner = {"above": "upper", "below": "lower"}.get(up, "")
    where = f"the {corner} {across}" if across and up else f"the {across}" if across else up
    deep = "" if abs(z) < 0.2 else "in front of the scene" if z > 0 else "behind the scene"
    share = light.ambient / max(light.ambient + light.intensity, 1e-6)
    return f"From {', '.join(filter(None, (where, deep)))}; {100 * share:.0f} % of it from all around."


def light_picture(light: Light, size: tuple[int, int]) -> U8:
    """(h, w, 3) of `size` (w, h): a white ball in the light, and an arrow from the light's direction."""
    width, height = size
    radius, center = 0.26 * min(size), np.array([(width - 1) / 2, (height - 1) / 2])
    normals, inside = sphere_normals(height, width, (float(center[0]), float(center[1])), radius)
    lamp = DistantLight(light.direction, light.intensity, light.ambient)
    shades = 0.86 * lamp.shade(normals) / max(light.ambient + light.intensity, 1e-6)
    linear = np.where(inside, np.maximum(shades, 0.012), 0.04).astype(np.float32)
    card = np.repeat(encode_u8(linear)[..., None], 3, 2)
    way, toward = np.array(light.direction[:2]), light.direction[2]
    flat = float(hypot(*way))
    layer, pen = Layer(size, 1.0), max(2.0, min(size) / 90)
    if flat > 0.12:
        tail, tip = center + 1.75 * radius * way, center + 1.12 * radius * way
        if toward < 0:  # it ends behind the ball's rim
            tip = center + way / flat * max(1.12 * flat, 1.04) * radius
            tail = tip + way / flat * max(0.63 * flat, 0.3) * radius
        straight_arrow(layer, tail, tip, pen)
    else:  # straight towards the viewer, or away
        layer.line(circle(center + radius * way, 4.2 * pen), pen, closed=True)
        if toward > 0:
            layer.area(circle(center + radius * way, 1.3 * pen))
    layer.onto(card, SUN)
    return card


def check_sheet(path: Path | None, photo: Path) -> None:
    """Raises InputError where a sheet cannot be written, before anything is computed."""
    if path is None:
        return
    if path.suffix.lower() != ".png":
        raise InputError.of("--sheet", f'"{path}"', "is no PNG", "let its name end in .png")
    if path.exists() and (path.is_dir() or (photo.exists() and path.samefile(photo))):
        what = "is a folder" if path.is_dir() else "is the photo itself"
        raise InputError.of("--sheet", f'"{path}"', what, "name another file")
    above = next(part for part in (path.parent, *path.parent.parents) if part.exists())
    if not above.is_dir():
        what = f'lies below "{above}", which is no folder'
        raise InputError.of("--sheet", f'"{path}"', what, "name another file")


def write_sheet(path: Path, perceived: PerceivedScene, keep: Keep = ignore_kept_file) -> None:
    """All panels as one PNG, four in a row; a different file at `path` is kept as `NAME~`."""
    maps, document = perceived.percepts, perceived.document
    objects = [
        (name, one["mask"] if isinstance(one["mask"], int) else 0, _rings(one["shape"]))
        for name, one in document["objects"].items()
    ]
    walls = [
        np.array(one.get("segment") or one["polyline"], float) for one in document["boundaries"].values()
    ]
    light = None
    if (entry := document.get("light")) is not None:
        x, y, z = entry["direction"]
        light = Light((x, y, z), entry["intensity"], entry["ambient"], 0.0)
    seen = f"from the {document['world']['view']}"
    height, width = maps.labels.shape
    size = WIDTH, max(1, round(height * WIDTH / width))
    panels = _panels(maps, objects, walls, light, seen, max(size))
    rows = -(-len(panels) // SHEET_COLUMNS)
    page = np.empty(
        (rows * (size[1] + CAPTION + GAP) + GAP, SHEET_COLUMNS * (WIDTH + GAP) + GAP, 3), np.uint8
    )
    page[:] = PAPER
    words = Layer((page.shape[1], page.shape[0]), 0.0)
    for k, panel in enumerate(panels):
        y = GAP + k // SHEET_COLUMNS * (size[1] + CAPTION + GAP) + CAPTION
        x = GAP + k % SHEET_COLUMNS * (WIDTH + GAP)
        page[y : y + size[1], x : x + WIDTH] = cv2.resize(panel.rgb, size, interpolation=cv2.INTER_AREA)
        text = panel.caption if panel.name in ("photo", "light") else panel.title
        words.words(text, (x + WIDTH / 2, y - CAPTION / 2), 15)
    words.onto(page, WORDS, 0.0)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_png(path, page, keep)


def _rings(shape: Mapping[str, Any]) -> list[Array]:
    """(K, 2) px each: the closed borders of a scene's `shape`."""
    if "circle" in shape:
        turn = np.linspace(0, 2 * np.pi, 72, endpoint=False)
        ring = np.stack([np.cos(turn), np.sin(turn)], 1)
        return [np.asarray(shape["circle"]["center"] + shape["circle"]["radius"] * ring)]
    if "box" in shape:
        angle = np.radians(shape["box"].get("angle", 0.0))
        x, y = np.array(shape["box"]["size"]) / 2
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        return [np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) @ turn + shape["box"]["center"]]
    if "polygon" in shape:
        return [np.array(shape["polygon"], float)]
    return [
        np.array(ring, float)
        for piece in shape["polygons"]
        for ring in (piece["outline"], *piece.get("holes", ()))
    ]


def relighting_comparison(stage: Stage, trajectory: Trajectory) -> Comparison | None:
    """The frame in which relighting matters most, with and without it; None where it changes nothing visible.

    Without relighting, shading turns with its object, as on a cut-out.
    """
    able = [sprite.ball is not None or sprite.relief is not None for sprite in stage.sprites]
    if not any(able) or len(trajectory.times) < 2:
        return None
    sample = _most_turned(stage, trajectory, able)
    if sample is None:
        return None
    bare = replace(stage, sprites=[replace(sprite, ball=None, relief=None) for sprite in stage.sprites])
    before, after = (next(render_frames(drawn, trajectory, (sample,))).rgb for drawn in (bare, stage))
    difference = np.asarray(cv2.absdiff(before, after), np.uint8).max(axis=2).astype(np.float32)
    if float(cv2.blur(difference, (5, 5)).max()) < VISIBLE:
        return None
    text = (
        f"The frame at {trajectory.times[sample]:.2f} s. As cut-outs, objects keep their light and shade as they "
        "turn; relit, the light stays where it is."
    )
    return compared("relit", "Relighting", text, ("cut out", before), ("relit", after))


def _most_turned(stage: Stage, trajectory: Trajectory, able: list[bool]) -> int | None:
    """The sample with the largest sum of pixels times 1 - cos of their turn; None where no object turns."""
    wrong = np.zeros(len(trajectory.times))
    axes = rotation_matrices(trajectory.turns) if trajectory.turns.size else None
    height, width = stage.background.shape[:2]
    for sprite, can in zip(stage.sprites, able, strict=True):
        if not can:
            continue
        pose = trajectory.poses[:, sprite.body]
        turn = 1 - np.cos(pose[:, 2] - pose[0, 2])
        if sprite.ball is not None and axes is not None:
            turn = np.maximum(turn, 1 - axes[:, sprite.body, 2, 2])
        x, y = (pose[:, :2].T + 0.5) * stage.scale - 0.5
        inside = (x > 0) & (x < width) & (y > 0) & (y < height)
        wrong += np.where(turn > TURNED, turn, 0) * inside * float(sprite.coverage.sum())
    return int(wrong.argmax()) if wrong.any() else None
