"""Pictures of perception: masks, shapes, surface maps, light, shadows and background.

The report page shows them as a strip of small WebP pictures, with a pair to slide
between. Each existing map gives a picture.
"""

from __future__ import annotations

import colorsys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.compile import CompiledScene
from physgen.compile.world import body_in_photo
from physgen.geometry.polygon import Array
from physgen.maps import U8, U16, Percepts
from physgen.photometry import DistantLight, encode_u8, sphere_normals
from physgen.render.drawing import Colour, Layer, dashes
from physgen.report.html import fit_to_side, webp
from physgen.scene.files import read_recorded
from physgen.scene.scene import Light, MaskId, Scene, View
from physgen.text import listed

SIDE, PAIR_SIDE = 480, 800
"""Maximum longer side of a picture, and of the pictures of a slider, px."""
QUALITY, PAIR_QUALITY = 74, 78
"""Qualities of WebP."""
SUPPORT: Colour = (255, 196, 0)
DOUBTFUL: Colour = (255, 255, 255)


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture of the strip."""

    name: str
    """Short name for ids: `masks`."""
    title: str
    caption: str
    alt: str
    rgb: U8
    """(h, w, 3) sRGB."""
    uri: str
    """`data:image/webp;base64,...`."""

    @property
    def width(self) -> int:
        """Return the width, px."""
        return int(self.rgb.shape[1])

    @property
    def height(self) -> int:
        """Return the height, px."""
        return int(self.rgb.shape[0])


@dataclass(frozen=True)
class Comparison:
    """Two pictures of equal size with a slider between them."""

    name: str
    title: str
    caption: str
    before: Picture
    after: Picture

    @cached_property
    def start(self) -> int:
        """Return the start of the slider, % from the left: the middle of the
        changes.
        """
        change = np.abs(self.before.rgb.astype(np.float64) - self.after.rgb).sum(
            axis=(0, 2)
        )
        if not change.any():
            return 50
        # The column with half of all changes at its left.
        return round(
            100
            * float(np.searchsorted(change.cumsum(), change.sum() / 2))
            / len(change)
        )


@dataclass(frozen=True)
class Perception:
    """The strip of pictures in display order."""

    pictures: tuple[Picture, ...]
    comparisons: tuple[Comparison, ...]


PLAIN = 2
"""Maximum range of a constant map after rounding, levels."""
Outlines = Sequence[tuple[int, Sequence[Array]]]
"""Number of the colour, and closed rings (K, 2) px of each object."""


def doubt_text(name: str, confidence: float | None) -> str:
    """Return a name with its confidence, if any."""
    if confidence is None:
        return name
    return f"{name} ({confidence:.0%})"


def mask_rings(mask: NDArray[np.bool_]) -> list[Array]:
    """Return the outlines (K, 2) px of a mask (H, W), through its outermost pixels."""
    own = mask.astype(np.uint8)
    # This mode finds outer borders and those of holes.
    rings, _ = cv2.findContours(own, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    return [ring[:, 0, :].astype(np.float64) for ring in rings]


@dataclass(frozen=True, eq=False)
class DoubtfulRegion:
    """A region that may be an object."""

    name: str
    confidence: float | None
    rings: Sequence[Array]
    """Outlines (K, 2), px of the photo."""


def doubtful_regions(
    labels: U16, document: Mapping[str, Any]
) -> Iterator[DoubtfulRegion]:
    """Yield the doubtful regions of a scene in its label map (H, W)."""
    for name, entry in document.get("doubtful", {}).items():
        rings = mask_rings(labels == entry["mask"])
        if rings:
            yield DoubtfulRegion(name, entry.get("confidence"), rings)


def perception(
    scene: Scene, compiled: CompiledScene, maps: Percepts | None
) -> Perception | None:
    """Return the section on perception, or None for a scene without a photo."""
    if maps is None:
        return None
    pictures = list(_photo_pictures_of(scene, compiled, maps))
    for picture in _map_pictures(maps, scene.light):
        if has_content(picture.rgb):
            pictures.append(picture)
    if maps.shadows is not None and maps.shadows.any():
        text = "Each in the colour of the object that casts it."
        coloured_shadows = _shadows(maps.rgb, _by_object(scene, maps.shadows))
        pictures.append(
            _picture("shadows", "Shadows by object", text, coloured_shadows)
        )
    # A comparison needs both backgrounds; a single one is a plain picture.
    if maps.background is None or maps.clean is None:
        pictures += _single_background(maps)
        return Perception(tuple(pictures), ())
    caption = "The area behind the objects, filled in; slide to remove their shadows."
    before = "with their old shadows", maps.background
    after = "without them", maps.clean
    comparison = compare_frames("background", "Background", caption, before, after)
    return Perception(tuple(pictures), (comparison,))


def _photo_pictures_of(
    scene: Scene, compiled: CompiledScene, maps: Percepts
) -> list[Picture]:
    """Return the pictures of the photo with its objects, walls and doubtful regions."""
    world = compiled.world
    objects = []
    for k, body in enumerate(map(body_in_photo, world.bodies), 1):
        objects.append((k, [ring + body.center for ring in body.rings]))
    walls: list[Array] = []
    for wall in world.walls:
        walls += wall.chains
    view = "from the side"
    if world.view is View.TOP:
        view = "from above"
    suitability = written_suitability(scene.assets)
    if suitability:
        view += f". Suitability: {suitability}"
    doubtful = list(doubtful_regions(maps.labels, scene.document))
    return _photo_pictures(maps, compiled.labels, objects, walls, view, doubtful)


def _single_background(maps: Percepts) -> list[Picture]:
    """Return the picture of the only background, if there is one."""
    background, content = maps.clean, "the objects and their shadows"
    if background is None:
        background, content = maps.background, "the objects"
    if background is None:
        return []
    text = f"The place without {content}."
    return [_picture("background", "Background", text, background)]


def written_suitability(assets: Path | None) -> str:
    """Return the suitability of the photo, from the record in the assets.

    Return "" without a record.
    """
    record = read_recorded(assets, "suitability")
    reasons = record.get("reasons")
    parts = (
        str(record.get("verdict", "")),
        "; ".join(map(str, reasons if isinstance(reasons, list) else ())),
    )
    return ": ".join(filter(None, parts))


def compare_frames(
    name: str, title: str, caption: str, before: tuple[str, U8], after: tuple[str, U8]
) -> Comparison:
    """Return the comparison of two frames (H, W, 3) sRGB of equal size, each with a
    description: `("refined", frame)`.
    """
    if before[1].shape != after[1].shape:
        raise ValueError(
            f"pictures of shapes {before[1].shape} and {after[1].shape} cannot be compared"
        )
    pair = []
    for side, (words, rgb) in (("before", before), ("after", after)):
        alt, small = f"{title}, {words}", fit_to_side(rgb, PAIR_SIDE)
        pair.append(
            Picture(f"{name}-{side}", words, "", alt, small, webp(small, PAIR_QUALITY))
        )
    return Comparison(name, title, caption, *pair)


def _picture(name: str, title: str, caption: str, rgb: U8, alt: str = "") -> Picture:
    alt = alt or f"{title} of the photo. {caption}"
    small = fit_to_side(rgb, SIDE)
    return Picture(name, title, caption, alt, small, webp(small, QUALITY))


def _photo_pictures(
    maps: Percepts,
    labels: U16,
    objects: Outlines,
    walls: Sequence[Array],
    view_text: str,
    doubtful: Sequence[DoubtfulRegion],
) -> list[Picture]:
    """Return pictures of the photo, masks and shapes. `labels` have the numbers of
    `objects`.
    """
    height, width = labels.shape
    photo = fit_to_side(maps.rgb, SIDE)
    count = f"{len(objects)} object{'s' * (len(objects) != 1)}"
    bounds = f"{len(walls)} boundar{'ies' if len(walls) != 1 else 'y'}"
    mask_picture = _draw_masks(maps.rgb, labels, max(height, width) / SIDE)
    outline_picture = _draw_outlines(photo, photo.shape[1] / width, objects, walls)
    _draw_doubtful(outline_picture, photo.shape[1] / width, doubtful)
    if doubtful:
        names = [doubt_text(one.name, one.confidence) for one in doubtful]
        view_text += f". Perhaps objects, too, dashed: {listed(names, 'and')}"
    return [
        _picture("photo", "Photo", f"{width} × {height} px.", photo),
        _picture("masks", "Masks", f"{count}, each in its own colour.", mask_picture),
        _picture(
            "shapes",
            "Shapes and supports",
            f"{count}; {bounds}, in yellow; seen {view_text}.",
            outline_picture,
        ),
    ]


def has_content(rgb: U8) -> bool:
    """Return whether a picture (H, W, 3) has a content: its codes differ within a
    channel.
    """
    return bool(np.ptp(rgb, axis=(0, 1)).max(initial=0) > PLAIN)


def _map_pictures(maps: Percepts, light: Light | None) -> list[Picture]:
    """Return pictures of depth, normals, albedo, shading and light, if they exist."""
    pictures = []
    if maps.depth is not None:
        pictures.append(
            _picture(
                "depth", "Depth", "Bright is near, dark is far.", _depth(maps.depth)
            )
        )
    if maps.normals is not None:
        text = "Orientation of surfaces: red to the right, green downwards, blue towards you."
        pictures.append(
            _picture("normals", "Normals", text, _u8(127.5 + 127.5 * maps.normals))
        )
    if maps.albedo is not None:
        text = "Colours without the light on them."
        pictures.append(_picture("albedo", "Albedo", text, encode_u8(maps.albedo)))
    if maps.shading is not None:
        # A few bright pixels must not darken the picture.
        max_value = max(float(np.percentile(maps.shading, 99.5)), 1e-6)
        grey = np.repeat(
            encode_u8(np.clip(maps.shading / max_value, 0, 1))[..., None], 3, 2
        )
        pictures.append(
            _picture("shading", "Shading", "The light without the colours.", grey)
        )
    if light is not None:
        height, width = fit_to_side(maps.rgb, SIDE).shape[:2]
        text = light_description(light)
        alt = f"A shaded sphere. {text}"
        pictures.append(
            _picture("light", "Light", text, light_picture(light, (width, height)), alt)
        )
    return pictures


def _u8(values: NDArray[np.floating[Any]]) -> U8:
    return np.asarray(np.clip(values + 0.5, 0, 255), np.uint8)


def colour(number: int) -> Colour:
    """Return the colour of an id. Neighbouring numbers have different colours."""
    # The golden ratio spreads the hues of any count of ids.
    r, g, b = colorsys.hsv_to_rgb(number * 0.381966 % 1.0, 0.75, 1.0)
    return round(255 * r), round(255 * g), round(255 * b)


def _grey(rgb: U8) -> NDArray[np.float32]:
    """Return (H, W, 3) grey."""
    grey = cv2.cvtColor(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    return np.asarray(grey, np.float32)


def _colours(labels: U16) -> NDArray[np.float32]:
    """Return (H, W, 3): the colour of each label; black for 0."""
    table = np.array(
        [(0, 0, 0), *map(colour, range(1, int(labels.max(initial=0)) + 1))], np.float32
    )
    return np.asarray(table.take(labels, axis=0))


def _draw_masks(rgb: U8, labels: U16, scale: float) -> U8:
    """Draw the photo in pale grey, objects in colours, and white borders."""
    grey = _grey(rgb)
    result = np.where(
        (labels > 0)[..., None], 0.4 * grey + 0.6 * _colours(labels), 0.55 * grey
    )
    # A border pixel has several ids in its neighbourhood: the largest and the smallest
    # then differ.
    kernel = np.ones((2 * max(1, round(scale)) + 1,) * 2, np.uint8)
    # OpenCV erodes float32, but not int32.
    ids = labels.astype(np.float32)
    result[(labels > 0) & (cv2.dilate(ids, kernel) != cv2.erode(ids, kernel))] = 255
    return _u8(result)


def _shadows(rgb: U8, objects: U16) -> U8:
    """Draw the photo in grey, and shadows in the colours of their objects."""
    grey = _grey(rgb)
    region = (objects > 0)[..., None]
    return _u8(np.where(region, 0.45 * grey + 0.55 * _colours(objects), 0.8 * grey))


def _draw_outlines(
    picture: U8, scale: float, objects: Outlines, walls: Sequence[Array]
) -> U8:
    """Draw outlines in the colours of the masks, and boundaries in yellow."""
    size = picture.shape[1], picture.shape[0]
    pale_photo, lines = _u8(0.62 * picture.astype(np.float32)), Layer(size, 0.8)
    for chain in walls:
        # Scale about the picture's corner, half a pixel before the first centre.
        lines.line((chain + 0.5) * scale - 0.5, 2.2)
    lines.blend(pale_photo, SUPPORT)
    for number, rings in objects:
        layer = Layer(size, 0.6)
        for ring in rings:
            layer.line((ring + 0.5) * scale - 0.5, 1.6, is_polygon=True)
        layer.blend(pale_photo, colour(number))
    return pale_photo


def _draw_doubtful(
    picture: U8, scale: float, regions: Sequence[DoubtfulRegion]
) -> None:
    """Draw dashed outlines of doubtful regions."""
    layer = Layer((picture.shape[1], picture.shape[0]), 0.6)
    for region in regions:
        for ring in region.rings:
            for dash in dashes((ring + 0.5) * scale - 0.5, 6, 4):
                layer.line(dash, 1.4)
    layer.blend(picture, DOUBTFUL)


def _by_object(scene: Scene, shadows: U16) -> U16:
    """Return (H, W): shadows by the objects' order in the scene.

    0 for objects that are no longer in the scene.
    """
    # Ids in the map are not in the order of the scene's objects.
    numbers = np.zeros_like(shadows)
    for k, item in enumerate(scene.objects, 1):
        if isinstance(item.mask, MaskId):
            numbers[shadows == item.mask.id] = k
    return numbers


def _depth(depth: NDArray[np.float32]) -> U8:
    low, high = np.percentile(depth, (0.5, 99.5)).tolist()
    brightness = _u8(255 * (1 - np.clip((depth - low) / max(high - low, 1e-6), 0, 1)))
    return np.asarray(
        cv2.applyColorMap(brightness, cv2.COLORMAP_CIVIDIS)[..., ::-1], np.uint8
    )


def light_description(light: Light) -> str:
    """Describe the direction of the light in words.

    >>> light_description(Light((-0.6, -0.64, 0.48), 1.0, 0.25, 2.0))
    'From the upper left, in front of the scene; 20 % of it from all around.'
    """
    x, y, z = light.direction
    # A component below 0.2 is less than 12 degrees, and hardly visible.
    if abs(x) < 0.2:
        horizontal = ""
    else:
        horizontal = "left"
        if x > 0:
            horizontal = "right"
    if abs(y) < 0.2:
        vertical = ""
    else:
        vertical = "below"
        if y < 0:
            vertical = "above"
    corner = {"above": "upper", "below": "lower"}.get(vertical, "")
    if horizontal and vertical:
        where = f"the {corner} {horizontal}"
    else:
        if horizontal:
            where = f"the {horizontal}"
        else:
            where = vertical
    # A light almost in the plane of the picture is neither in front nor behind.
    if abs(z) < 0.2:
        depth = ""
    else:
        depth = "behind the scene"
        if z > 0:
            depth = "in front of the scene"
    share = light.ambient / max(light.ambient + light.intensity, 1e-6)
    return f"From {', '.join(filter(None, (where, depth)))}; {100 * share:.0f} % of it from all around."


def light_picture(light: Light, size: tuple[int, int]) -> U8:
    """Draw a white ball in the light, (h, w, 3) for `size` (w, h)."""
    width, height = size
    radius, center = 0.26 * min(size), np.array([(width - 1) / 2, (height - 1) / 2])
    normals, inside = sphere_normals(
        height, width, (float(center[0]), float(center[1])), radius
    )
    lamp = DistantLight(light.direction, light.intensity, light.ambient)
    # The brightest point of the ball is slightly below white, so that its shading
    # remains visible.
    shades = 0.86 * lamp.shade(normals) / max(light.ambient + light.intensity, 1e-6)
    linear = np.where(inside, np.maximum(shades, 0.012), 0.04).astype(np.float32)
    return np.repeat(encode_u8(linear)[..., None], 3, 2)
