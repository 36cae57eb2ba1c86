"""Masks and written shapes of a scene: label map, fitted outlines, walls.

Depends on no mass, coefficient, velocity or force: scenes that differ in these alone share one result. Fitted outlines
are moved onto the boundary that they stand on: the two are often a pixel apart, and a pile would settle at t = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from zlib import crc32

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Wall, surface
from physgen.geometry.fitting import fit_outlines, without_specks
from physgen.geometry.polygon import Array, Disc, Outline, Region, Ring, mass_properties
from physgen.geometry.raster import coverage_box
from physgen.geometry.regions import fit_regions
from physgen.messages import Message
from physgen.problems import InputError, Problem
from physgen.scene.scene import (
    Auto,
    Boundary,
    Mask,
    MaskId,
    MaskPolygon,
    Object,
    Points,
    Scene,
    Shape,
    View,
    shape_outline,
)

U16 = NDArray[np.uint16]
PixelMask = NDArray[np.bool_]


def object_labels(
    scene: Scene, labels: U16 | None, written: list[Outline | None]
) -> U16:
    """(H, W) ids by object: from masks.png, an outline or, with none of these, the written shape.

    `written` holds the outline of every explicit shape, None where it is fitted. Nearer layers win shared pixels.
    """
    width, height = scene.size
    out = np.zeros((height, width), np.uint16)
    problems = []
    for k in sorted(range(len(scene.objects)), key=lambda k: scene.objects[k].layer):
        item, outline = scene.objects[k], written[k]
        mask = mask_pixels(item.mask, scene.size, labels)
        if mask is not None:
            out[mask] = k + 1
        if (mask is None and outline is None) or (mask is not None and not mask.any()):
            problems.append(
                _mask_problem(scene, f"objects.{item.name}.mask", item, mask)
            )
        elif mask is None and outline is not None:
            box, (x0, y0) = coverage_box(outline, (0, 0, width, height))
            out[y0 : y0 + box.shape[0], x0 : x0 + box.shape[1]][box >= 0.5] = k + 1
    shown = np.bincount(out.ravel(), minlength=len(scene.objects) + 1)
    if not problems:
        hidden = (
            k
            for k, outline in enumerate(written)
            if outline is None and not shown[k + 1]
        )
        problems = [_hidden(scene, scene.objects[k]) for k in hidden]
    if problems:
        raise InputError(problems)
    return out


def mask_pixels(
    mask: Mask | None, size: tuple[int, int], labels: U16 | None
) -> NDArray[np.bool_] | None:
    """(H, W): what a mask covers; None where there is none, or an id without a map to be found in."""
    match mask:
        case MaskId(id=identity):
            return None if labels is None else np.asarray(labels == identity)
        case MaskPolygon(points=points):
            return fill_polygon(points, size)
        case _:
            return None


def fill_polygon(points: Points, size: tuple[int, int]) -> NDArray[np.bool_]:
    """(H, W): pixels whose centre lies inside, by the even-odd rule."""
    canvas = np.zeros((size[1], size[0]), np.uint8)
    fixed = np.rint(np.asarray(points) * 16).astype(np.int32)
    cv2.fillPoly(canvas, [fixed], 1, lineType=cv2.LINE_8, shift=4)
    return canvas > 0


def _mask_problem(
    scene: Scene, path: str, item: Object | Boundary, mask: PixelMask | None
) -> Problem:
    """The mask at `path` has no pixel; None: it is an id, and the scene has no photo."""
    found = str(item.mask.id) if isinstance(item.mask, MaskId) else "it"
    message = Message.ID_WITHOUT_PHOTO if mask is None else Message.MASK_OF_NO_PIXEL
    return message.problem(scene.place(path), path, found)


def _hidden(scene: Scene, item: Object) -> Problem:
    path = f"objects.{item.name}.mask"
    return Message.HIDDEN_BY_MASKS.problem(scene.place(path), path, item.name)


@dataclass(frozen=True)
class Fitted:
    """What the masks of objects and boundaries became, fitted together so that neighbours touch."""

    objects: dict[
        int, Outline
    ]  # by id in the objects' label map, those alone whose shape is fitted
    walls: dict[
        int, Region
    ]  # by index in `Scene.boundaries`, those alone that are masks
    scenery: PixelMask  # (H, W): pixels that show a boundary and no object


def fit_masks(
    scene: Scene, labels: U16 | None, of_objects: U16, fitted: list[int]
) -> Fitted:
    """Outlines of the objects `fitted` and of every boundary that is a mask. Raises InputError.

    A boundary shares its lines with what its mask touches. One whose mask lies across another's is fitted alone, as if
    nothing stood before it: a hole in the shape of the object in front would be a trap around it.
    """
    together = of_objects.astype(np.int32)
    shared: dict[int, int] = {}
    alone: dict[int, Region] = {}
    scenery = np.zeros(of_objects.shape, bool)
    problems: list[Problem] = []
    for k, item in enumerate(scene.boundaries):
        if item.mask is None:
            continue
        mask = mask_pixels(item.mask, scene.size, labels)
        if mask is None or not mask.any():
            problems.append(
                _mask_problem(scene, f"boundaries.{item.name}.mask", item, mask)
            )
            continue
        scenery |= mask
        if together[mask].any():
            alone[k] = fit_regions(without_specks(mask).astype(np.int64))[1]
        else:
            shared[k] = len(scene.objects) + 1 + k
            together[mask] = shared[k]
    if problems:
        raise InputError(problems)
    ids = [*fitted, *shared.values()]
    fits = fit_outlines(together, ids, never_discs=set(shared.values())) if ids else {}
    walls = {
        k: fit for k, i in shared.items() if isinstance(fit := fits[i], Region)
    } | alone
    return Fitted({i: fits[i] for i in fitted}, walls, scenery & (of_objects == 0))


def walls_of(scene: Scene, regions: dict[int, Region]) -> tuple[Wall, ...]:
    """The boundaries as chains; `regions` are those of masks, by index."""

    def chains(k: int, item: Boundary) -> tuple[Array, ...]:
        if k not in regions:
            return (np.array(item.points, np.float64),)
        return tuple(
            np.concatenate([points, points[:1]]) for points, _ in regions[k].borders
        )

    return tuple(
        Wall(
            item.name,
            chains(k, item),
            surface(item.friction, item.elasticity, scene.world.combine),
        )
        for k, item in enumerate(scene.boundaries)
    )


@dataclass(frozen=True, eq=False)
class Shapes:
    """Of a scene's N objects, and of those of its boundaries that are masks."""

    written: tuple[Outline | None, ...]
    """Outlines as the file or the assets have them; None where one is fitted."""
    labels: U16  # (H, W): id k + 1 is the k-th object; 0 = background
    fits: Fitted
    wholes: tuple[Outline | None, ...] = ()
    """With the parts that other objects hide, as the assets have them; None if none is known."""

    @property
    def drawn(self) -> tuple[Outline, ...]:
        """Outlines with their hidden parts, photo frame, for drawing."""
        wholes = self.wholes or (None,) * len(self.written)
        return tuple(
            outline if whole is None else whole
            for outline, whole in zip(self.outlines, wholes, strict=True)
        )

    @property
    def outlines(self) -> tuple[Outline, ...]:
        """Written or fitted, photo frame."""
        return tuple(
            self.fits.objects[k + 1] if it is None else it
            for k, it in enumerate(self.written)
        )


def shapes_of(scene: Scene, labels: U16 | None) -> Shapes:
    """`labels` (H, W) is the photo's label map, None for a scene without one. Raises InputError."""
    written = [_written(item, labels) for item in scene.objects]
    of_objects = object_labels(scene, labels, written)
    fits = fit_masks(
        scene, labels, of_objects, [k + 1 for k, it in enumerate(written) if it is None]
    )
    wholes = [_stored_whole(item, labels) for item in scene.objects]
    if not any(whole is not None for whole in wholes):
        wholes = []
    return Shapes(tuple(written), of_objects, fits, tuple(wholes))


def mask_crc(labels: U16, id_: int) -> int:
    """CRC-32 of the pixels of an id, by which a stored outline knows its mask."""
    return crc32(np.packbits(labels == id_).tobytes())


def _written(item: Object, labels: U16 | None) -> Outline | None:
    """Return the outline of an explicit shape, or the one stored for its mask.

    None if the outline must be fitted: no shape is given, or the mask was edited.
    """
    shape: Shape | None = item.shape
    if isinstance(shape, Auto):
        shape = _stored_shape(shape, item.mask, labels)
    return None if shape is None else shape_outline(shape)


def _stored_whole(item: Object, labels: U16 | None) -> Outline | None:
    """Return the whole outline that was stored for an object's mask if it is unchanged."""
    shape = item.shape
    if not isinstance(shape, Auto) or shape.whole is None:
        return None
    if _stored_shape(shape, item.mask, labels) is None:
        return None
    return shape_outline(shape.whole)


def _stored_shape(shape: Auto, mask: Mask | None, labels: U16 | None) -> Shape | None:
    """Return the shape that was stored for a mask if the mask is unchanged."""
    if not isinstance(mask, MaskId) or labels is None or shape.stored is None:
        return None
    is_unchanged = mask_crc(labels, mask.id) == shape.crc
    return shape.stored if is_unchanged else None


BAND = 2.0
"""px between a mask's lowest points and the line that it stands on."""
LEVEL = 0.7
"""Cosine of the angle between gravity and the normal of a line up to which objects stand on it."""


def snapped_to_boundaries(
    scene: Scene, outlines: tuple[Outline, ...], fitted: list[bool]
) -> tuple[Outline, ...]:
    """The outlines, those that were fitted brought onto the lines within reach of their lowest points."""
    lines = carrying_lines(scene) if any(fitted) else []
    if not lines:
        return outlines
    return tuple(
        stand_on_lines(outline, lines) if fit else outline
        for outline, fit in zip(outlines, fitted, strict=True)
    )


def carrying_lines(scene: Scene) -> list[Line]:
    """Return the boundaries' segments that carry objects; none seen from above."""
    gravity = np.array(scene.world.gravity, np.float64)
    strength = float(np.hypot(*gravity))
    if scene.world.view is View.TOP or strength == 0:
        return []
    return [
        line
        for boundary in scene.boundaries
        for a, b in pairwise(np.array(boundary.points, np.float64).reshape(-1, 2))
        if (line := Line.of(a, b, gravity / strength)) is not None
    ]


class Line:
    """A segment that carries: its start, the unit vector along it, its length, and its normal upwards."""

    def __init__(self, start: Array, along: Array, length: float, up: Array) -> None:
        self.start, self.along, self.length, self.up = start, along, length, up

    @staticmethod
    def of(a: Array, b: Array, down: Array) -> Line | None:
        """Return the line from `a` to `b` px; None if it is too steep to carry."""
        length = float(np.hypot(*(b - a)))
        if length == 0:
            return None
        along = (b - a) / length
        up = np.array([-along[1], along[0]])
        up = -up if up @ down > 0 else up
        return Line(a, along, length, up) if -(up @ down) >= LEVEL else None

    def near(self, points: Array) -> tuple[NDArray[np.bool_], Array]:
        """Which points lie along the segment, and the heights of all over its line."""
        off = points - self.start
        along = off @ self.along
        return (along >= -BAND) & (along <= self.length + BAND), off @ self.up


def stand_on_lines(outline: Outline, lines: list[Line]) -> Outline:
    """Return the outline brought onto the lines within reach of its lowest points."""
    for line in lines:
        if isinstance(outline, Disc):
            along, height = line.near(outline.center[None])
            gap = float(height[0]) - outline.radius
            if along[0] and abs(gap) <= BAND:
                outline = Disc(outline.center - gap * line.up, outline.radius)
            continue
        points = np.concatenate([ring.outer for ring in outline.rings])
        along, height = line.near(points)
        below = height[along]
        above = (mass_properties(outline).center - line.start) @ line.up > BAND
        if above and len(below) and -BAND <= below.min() <= BAND:
            outline = Region(
                tuple(
                    Ring(_flat(ring.outer, line), ring.holes) for ring in outline.rings
                )
            )
    return outline


def _flat(points: Array, line: Line) -> Array:
    """Points within the band brought onto the line."""
    along, height = line.near(points)
    at = along & (np.abs(height) <= BAND)
    moved = points.copy()
    moved[at] -= height[at, None] * line.up
    return moved
