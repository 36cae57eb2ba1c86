"""Masks and written shapes of a scene: label map, fitted outlines, walls.

Shapes do not depend on masses, coefficients, velocities or forces, so that scenes with
other values share one result. Fitted outlines are moved onto their boundary: the two
are often a pixel apart, and a pile would settle at t = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from zlib import crc32

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Passage, Wall, passages, surface_of
from physgen.geometry.convex import convex_pieces
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
    scene: Scene, labels: U16 | None, written_outlines: list[Outline | None]
) -> U16:
    """Return the ids by object, (H, W): from masks.png, from an outline or, without
    both, from the written shape.

    `written_outlines` holds the outline of every explicit shape, None for a fitted one. Nearer
    layers win shared pixels.
    """
    # A mask has precedence over a shape, as it is the visible part of the object.
    width, height = scene.size
    out = np.zeros((height, width), np.uint16)
    problems = []
    # Nearer layers overwrite farther ones.
    for k in sorted(range(len(scene.objects)), key=lambda k: scene.objects[k].layer):
        item = scene.objects[k]
        outline = written_outlines[k]
        mask = mask_pixels(item.mask, scene.size, labels)
        if mask is None and outline is not None:
            box, (x0, y0) = coverage_box(outline, (0, 0, width, height))
            out[y0 : y0 + box.shape[0], x0 : x0 + box.shape[1]][box >= 0.5] = k + 1
        elif mask is not None and mask.any():
            out[mask] = k + 1
        else:
            path = f"objects.{item.name}.mask"
            problems.append(_mask_problem(scene, path, item, mask))
    if not problems:
        problems = _problems_of_hidden_masks(scene, out, written_outlines)
    if problems:
        raise InputError(problems)
    return out


def _problems_of_hidden_masks(
    scene: Scene, labels: U16, written_outlines: list[Outline | None]
) -> list[Problem]:
    """Return the problems of fitted objects without a visible pixel."""
    pixel_counts = np.bincount(labels.ravel(), minlength=len(scene.objects) + 1)
    problems = []
    for k, outline in enumerate(written_outlines):
        if outline is None and not pixel_counts[k + 1]:
            problems.append(_report_hidden_mask(scene, scene.objects[k]))
    return problems


def mask_pixels(
    mask: Mask | None, size: tuple[int, int], labels: U16 | None
) -> NDArray[np.bool_] | None:
    """Return the pixels of a mask, (H, W); None without a mask, or for an id without a
    label map.
    """
    match mask:
        case MaskId(id=identity):
            if labels is None:
                return None
            return np.asarray(labels == identity)
        case MaskPolygon(points=points):
            return fill_polygon(points, size)
        case _:
            return None


def fill_polygon(points: Points, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return the pixels with their centre inside a polygon, (H, W), by the even-odd
    rule.
    """
    canvas = np.zeros((size[1], size[0]), np.uint8)
    # OpenCV takes fixed-point coordinates: 4 bits are 1/16 px.
    corners = np.rint(np.asarray(points) * 16).astype(np.int32)
    cv2.fillPoly(canvas, [corners], 1, lineType=cv2.LINE_8, shift=4)
    return canvas > 0


def _mask_problem(
    scene: Scene, path: str, item: Object | Boundary, mask: PixelMask | None
) -> Problem:
    """Return the problem of an empty mask; `mask` is None for an id in a scene without
    a photo.
    """
    mask_text = "it"
    if isinstance(item.mask, MaskId):
        mask_text = str(item.mask.id)
    if mask is None:
        message = Message.ID_WITHOUT_PHOTO
    else:
        message = Message.MASK_OF_NO_PIXEL
    return message.problem(scene.place(path), path, mask_text)


def _report_hidden_mask(scene: Scene, item: Object) -> Problem:
    path = f"objects.{item.name}.mask"
    return Message.HIDDEN_BY_MASKS.problem(scene.place(path), path, item.name)


@dataclass(frozen=True)
class FittedOutlines:
    """Outlines of the masks of objects and boundaries, fitted together so that
    neighbours touch.
    """

    # By id in the objects' label map, only objects with a fitted shape.
    objects: dict[int, Outline]
    # By index in `Scene.boundaries`, only boundaries with a mask.
    walls: dict[int, Region]
    # Pixels (H, W) of a boundary without an object in front of it.
    scenery: PixelMask


def fit_masks(
    scene: Scene, labels: U16 | None, of_objects: U16, fitted_ids: list[int]
) -> FittedOutlines:
    """Return the outlines of the objects `fitted_ids` and of every boundary with a mask.
    Raise InputError.

    A boundary shares its lines with the masks at its border. A boundary across another
    mask is fitted alone, without a hole for the object in front of it: such a hole
    would trap the object.
    """
    # Objects and boundaries share one label map, so that the fit gives neighbours one
    # common line without gaps or overlaps.
    joint_labels = of_objects.astype(np.int32)
    shared_ids: dict[int, int] = {}
    lone_regions: dict[int, Region] = {}
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
        # A boundary behind an object is fitted alone, since a hole in it would trap the
        # object.
        if joint_labels[mask].any():
            lone_regions[k] = fit_regions(without_specks(mask).astype(np.int64))[1]
        else:
            shared_ids[k] = len(scene.objects) + 1 + k
            joint_labels[mask] = shared_ids[k]
    if problems:
        raise InputError(problems)
    ids = [*fitted_ids, *shared_ids.values()]
    if ids:
        fits = fit_outlines(joint_labels, ids, never_discs=set(shared_ids.values()))
    else:
        fits = {}
    walls = {
        k: fit for k, i in shared_ids.items() if isinstance(fit := fits[i], Region)
    } | lone_regions
    return FittedOutlines(
        {i: fits[i] for i in fitted_ids}, walls, scenery & (of_objects == 0)
    )


def circle_corners(radius: float) -> Array:
    """Return the corners (K, 2) px of a circle for drawing. The chords deviate by less
    than 0.05 px.
    """
    count = np.ceil(np.pi / np.arccos(max(0.0, 1 - 0.05 / max(radius, 0.1))))
    angle = np.arange(int(np.clip(count, 12, 360))) * (2 * np.pi)
    angle /= len(angle)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def outline_rings(outline: Outline) -> list[Array]:
    """Return the rings (K, 2) px of an outline."""
    if isinstance(outline, Disc):
        return [np.asarray(outline.center) + circle_corners(outline.radius)]
    return [ring for ring, _ in outline.borders]


def solid_of(item: Boundary) -> tuple[tuple[Array, ...], tuple[Array, float] | None]:
    """Return the convex pieces, and centre and radius, of a boundary with a solid
    shape.
    """
    if item.shape is None:
        outline = None
    else:
        outline = shape_outline(item.shape)
    if isinstance(outline, Disc):
        return (), (np.asarray(outline.center, np.float64), outline.radius)
    return (() if outline is None else convex_pieces(outline)), None


def walls_of(scene: Scene, regions: dict[int, Region]) -> tuple[Wall, ...]:
    """Return the boundaries as chains. `regions` are the fitted masks, by index."""
    # A boundary has a written shape, a fitted mask or written points, in this order.
    passing = passages(scene)

    def chains(k: int, item: Boundary) -> tuple[Array, ...]:
        if item.shape is not None:
            outline = shape_outline(item.shape)
            assert outline is not None
            rings = outline_rings(outline)
            # Repeat the first point, so that the chain is closed.
            return tuple(np.concatenate([ring, ring[:1]]) for ring in rings)
        if k not in regions:
            return (np.array(item.points, np.float64),)
        return tuple(
            np.concatenate([points, points[:1]]) for points, _ in regions[k].borders
        )

    return tuple(
        Wall(
            item.name,
            chains(k, item),
            surface_of(item, scene.world.combine),
            passing.get(f"boundaries.{item.name}", Passage()),
            *solid_of(item),
            item.is_smooth,
        )
        for k, item in enumerate(scene.boundaries)
    )


@dataclass(frozen=True, eq=False)
class Shapes:
    """Shapes of the N objects of a scene, and of its boundaries with masks."""

    written_outlines: tuple[Outline | None, ...]
    """Outlines from the file or the assets; None for a fitted outline."""
    # (H, W): id k + 1 is object k; 0 = background.
    labels: U16
    fits: FittedOutlines
    wholes: tuple[Outline | None, ...] = ()
    """Outlines with hidden parts, from the assets; None if unknown."""

    @property
    def drawn(self) -> tuple[Outline, ...]:
        """Return the outlines with their hidden parts for drawing, photo frame."""
        wholes = self.wholes or (None,) * len(self.written_outlines)
        return tuple(
            outline if whole_outline is None else whole_outline
            for outline, whole_outline in zip(self.outlines, wholes, strict=True)
        )

    @property
    def outlines(self) -> tuple[Outline, ...]:
        """Return the written or fitted outlines, photo frame."""
        return tuple(
            self.fits.objects[k + 1] if it is None else it
            for k, it in enumerate(self.written_outlines)
        )


def shapes_of(scene: Scene, labels: U16 | None) -> Shapes:
    """Return the shapes. `labels` (H, W) is the photo's label map, None without one.
    Raise InputError.
    """
    written_outlines = [_written_outline(item, labels) for item in scene.objects]
    of_objects = object_labels(scene, labels, written_outlines)
    fits = fit_masks(
        scene,
        labels,
        of_objects,
        [k + 1 for k, it in enumerate(written_outlines) if it is None],
    )
    wholes = [_stored_whole_outline(item, labels) for item in scene.objects]
    if not any(whole_outline is not None for whole_outline in wholes):
        wholes = []
    return Shapes(tuple(written_outlines), of_objects, fits, tuple(wholes))


def mask_crc(labels: U16, id_: int) -> int:
    """Return the CRC-32 of an id's pixels. A stored outline is valid for the mask with
    the same CRC.
    """
    return crc32(np.packbits(labels == id_).tobytes())


def _written_outline(item: Object, labels: U16 | None) -> Outline | None:
    """Return the outline of an explicit shape, or the outline stored for the mask.

    Return None if the outline must be fitted: no shape is given, or the mask was
    edited.
    """
    shape: Shape | None = item.shape
    if isinstance(shape, Auto):
        shape = _stored_shape(shape, item.mask, labels)
    if shape is None:
        return None
    return shape_outline(shape)


def _stored_whole_outline(item: Object, labels: U16 | None) -> Outline | None:
    """Return the stored whole outline of an object if its mask is unchanged."""
    shape = item.shape
    if not isinstance(shape, Auto) or shape.whole is None:
        return None
    if _stored_shape(shape, item.mask, labels) is None:
        return None
    return shape_outline(shape.whole)


def _stored_shape(shape: Auto, mask: Mask | None, labels: U16 | None) -> Shape | None:
    """Return the stored shape of a mask if the mask is unchanged."""
    if not isinstance(mask, MaskId) or labels is None or shape.stored is None:
        return None
    is_unchanged = mask_crc(labels, mask.id) == shape.crc
    if is_unchanged:
        return shape.stored
    return None


BAND = 2.0
"""Maximum distance between the lowest points of a mask and its boundary, px."""
LEVEL = 0.7
"""Minimum cosine of the angle between a boundary's upward normal and the direction
against gravity.
"""


def snapped_to_boundaries(
    scene: Scene, outlines: tuple[Outline, ...], fit_flags: list[bool]
) -> tuple[Outline, ...]:
    """Return the outlines; move fitted ones onto boundaries within reach of their
    lowest points.
    """
    if any(fit_flags):
        lines = carrying_lines(scene)
    else:
        lines = []
    if not lines:
        return outlines
    return tuple(
        stand_on_lines(outline, lines) if fit else outline
        for outline, fit in zip(outlines, fit_flags, strict=True)
    )


def carrying_lines(scene: Scene) -> list[Line]:
    """Return the segments of boundaries that can carry objects, or none in a view from
    above.
    """
    gravity = np.array(scene.world.gravity, np.float64)
    strength = float(np.hypot(*gravity))
    if scene.world.view is View.TOP or strength == 0:
        return []
    return [
        line
        for boundary in scene.boundaries
        for a, b in pairwise(np.array(boundary.points, np.float64).reshape(-1, 2))
        if (line := Line.between(a, b, gravity / strength)) is not None
    ]


class Line:
    """A carrying segment: its start, the unit vector along it, its length, and its
    upward normal.
    """

    def __init__(
        self, start: Array, direction: Array, length: float, normal: Array
    ) -> None:
        self.start, self.direction, self.length, self.normal = (
            start,
            direction,
            length,
            normal,
        )

    @staticmethod
    def between(a: Array, b: Array, down: Array) -> Line | None:
        """Return the line from `a` to `b` px, or None if it is too steep to carry."""
        length = float(np.hypot(*(b - a)))
        if length == 0:
            return None
        direction = (b - a) / length
        normal = np.array([-direction[1], direction[0]])
        if normal @ down > 0:
            normal = -normal
        if -(normal @ down) >= LEVEL:
            return Line(a, direction, length, normal)
        return None

    def measure_points(self, points: Array) -> tuple[NDArray[np.bool_], Array]:
        """Return which points lie along the segment, and the heights of all points over
        its line, px.
        """
        offsets = points - self.start
        distances = offsets @ self.direction
        return (distances >= -BAND) & (
            distances <= self.length + BAND
        ), offsets @ self.normal


def stand_on_lines(outline: Outline, lines: list[Line]) -> Outline:
    """Return the outline on the lines within reach of its lowest points."""
    for line in lines:
        if isinstance(outline, Disc):
            # A disc touches the line with its lowest point: its centre lies one radius
            # above.
            is_along, height = line.measure_points(outline.center[None])
            gap = float(height[0]) - outline.radius
            if is_along[0] and abs(gap) <= BAND:
                outline = Disc(outline.center - gap * line.normal, outline.radius)
            continue
        points = np.concatenate([ring.outer for ring in outline.rings])
        is_along, height = line.measure_points(points)
        # Only points beside the line can stand on it; farther away the line does not
        # exist.
        depths = height[is_along]
        # An object beside a ledge, with its centre below, does not stand on it.
        is_above = (mass_properties(outline).center - line.start) @ line.normal > BAND
        if is_above and len(depths) and -BAND <= depths.min() <= BAND:
            outline = Region(
                tuple(
                    Ring(_flatten(ring.outer, line), ring.holes)
                    for ring in outline.rings
                )
            )
    return outline


def _flatten(points: Array, line: Line) -> Array:
    """Return the points; move those within the band onto the line."""
    is_along, height = line.measure_points(points)
    is_touching = is_along & (np.abs(height) <= BAND)
    new_points = points.copy()
    new_points[is_touching] -= height[is_touching, None] * line.normal
    return new_points
