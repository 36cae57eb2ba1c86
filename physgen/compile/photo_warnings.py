"""Warnings about the photo of a scene: edits after perception, masks and doubtful regions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from physgen.compile.compile import CompiledScene
from physgen.compile.shapes import U16
from physgen.compile.warning_limits import LIMITS, warning
from physgen.geometry.convex import outline_shape
from physgen.geometry.polygon import Outline
from physgen.geometry.raster import coverage_box
from physgen.maps import U8, Percepts
from physgen.messages import Message
from physgen.problems import Problem
from physgen.scene.scene import Auto, Object, Scene
from physgen.text import percent

Mask = NDArray[np.bool_]


def maps_cover_masks(maps: Percepts, labels: U16, scenery: Mask) -> bool:
    """Return whether the stored coverage and background belong to masks like the
    scene's.

    `labels` (H, W) are the scene's objects, 0 = none; `scenery` (H, W) are boundary
    pixels.
    """
    if ((labels > 0) & (maps.cut_out == 0)).any():
        return False
    if maps.coverage is None or not scenery.any():
        return True
    reachable = _grow(labels > 0, LIMITS.reach)
    return not (maps.coverage[scenery & ~reachable] > 0.5).any()


def photo_differs(
    scene: Scene, compilation: CompiledScene, maps: Percepts | None
) -> Iterator[Problem]:
    """Yield a warning about a photo with edits after its maps were made: the clip shows
    `background.png`.

    No warning comes if `clean.png` is more like the photo than like the background: then
    somebody painted the background on purpose.
    """
    if (
        maps is None
        or maps.coverage is None
        or maps.background is None
        or scene.image is None
    ):
        return
    # The pipeline then makes a new background from the photo.
    if not maps_cover_masks(maps, compilation.labels, compilation.scenery):
        return
    background_mask = ~_grow(
        (maps.coverage > 0) | (maps.cut_out > 0) | (compilation.labels > 0),
        round(LIMITS.filled_margin * max(scene.size)),
    )
    # Equal maps are the common case, and quick to test.
    if (
        cv2.norm(
            maps.rgb, maps.background, cv2.NORM_INF, background_mask.astype(np.uint8)
        )
        == 0
    ):
        return
    photo_difference = _mean_difference(maps.rgb, maps.background, background_mask)
    differs = (np.abs(photo_difference) > LIMITS.levels).any(axis=2) & background_mask
    if maps.clean is not None:
        clean_difference = _mean_difference(
            maps.clean, maps.background, background_mask
        )
        differs &= np.abs(clean_difference - photo_difference).sum(axis=2) >= np.abs(
            clean_difference
        ).sum(axis=2)
    _, ids, stats, _ = cv2.connectedComponentsWithStats(differs.astype(np.uint8))
    # Compression leaves specks.
    large = stats[:, cv2.CC_STAT_AREA] >= LIMITS.min_pixels
    large[0] = False
    rows, columns = np.nonzero(large[ids])
    if len(rows):
        range_text = (
            f"x {columns.min()} to {columns.max()}, y {rows.min()} to {rows.max()}"
        )
        message, count = Message.PHOTO_EDITED, len(rows)
        name = scene.image.name
        yield warning(scene, "image", name, message, count=count, place=range_text)


def doubtful_ids(scene: Scene, maps: Percepts | None) -> Iterator[Problem]:
    """Yield warnings about ids of doubtful regions without pixels, or with an
    object.
    """
    object_ids = _mask_ids(scene.document["objects"])
    owners = {mask: name for name, mask in object_ids.items()}
    doubtful_regions = _mask_ids(scene.document.get("doubtful", {}))
    # Without maps, all ids count as present.
    present_ids = set(doubtful_regions.values())
    if doubtful_regions and maps is not None:
        present_ids = set(np.unique(maps.labels).tolist())
    for name, mask in doubtful_regions.items():
        path = f"doubtful.{name}.mask"
        if mask in owners:
            message = Message.DOUBTFUL_IS_OBJECT
            yield warning(scene, path, str(mask), message, name=owners[mask])
        elif mask not in present_ids:
            yield warning(scene, path, str(mask), Message.DOUBTFUL_ID_MISSING)


def _mask_ids(entries: Mapping[str, Any]) -> dict[str, int]:
    """Return the numeric mask ids of entries, by name."""
    ids = {}
    for name, entry in entries.items():
        if isinstance(entry.get("mask"), int):
            ids[name] = entry["mask"]
    return ids


def _mean_difference(picture: U8, reference: U8, region: Mask) -> NDArray[np.int16]:
    """Return the difference of two pictures, (H, W, 3) grey levels, as means over
    squares of the pixels `region`.
    """
    difference = cv2.subtract(picture, reference, dtype=cv2.CV_16S)
    difference[~region] = 0
    return np.asarray(
        cv2.blur(difference, (LIMITS.mean_side, LIMITS.mean_side)), np.int16
    )


def _grow(mask: Mask, margin: int) -> Mask:
    """Return the mask with all pixels within `margin` px along rows, columns and diagonals,
    (H, W).
    """
    return np.asarray(
        cv2.dilate(
            mask.astype(np.uint8), np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)
        )
        > 0
    )


def missed_masks(scene: Scene, compilation: CompiledScene) -> Iterator[Problem]:
    """Yield warnings about written shapes that differ from the object's mask."""
    shapes = zip(scene.objects, compilation.shapes.written_outlines, strict=True)
    for k, (item, outline) in enumerate(shapes):
        mask = compilation.labels == k + 1
        area = np.count_nonzero(mask)
        if outline is None or item.mask is None or not area:
            continue
        fix = "correct the outline or the mask"
        if scene.document["objects"][item.name].get("shape") != "outline":
            fix = f"write shape: outline, or {fix}"
        # The shape may miss a part of the mask, or reach beyond the mask.
        differences = _shape_differences(item, outline, mask, compilation)
        messages = (Message.SHAPE_MISSES_MASK, Message.SHAPE_BEYOND_MASK)
        for part, message in zip(differences, messages, strict=True):
            # Thin strips along the outline are unavoidable errors of a fit: opening the
            # difference removes them.
            share = _opened_area(part) / area
            if share > LIMITS.max_missed_share:
                path = f"objects.{item.name}.shape"
                values = {"share": percent(share), "fix": fix}
                yield warning(scene, path, "the shape", message, **values)


def _shape_differences(
    item: Object, outline: Outline, mask: Mask, compilation: CompiledScene
) -> tuple[Mask, Mask]:
    """Return the part of a mask outside its shape, and the part of the shape over other
    things in the photo.

    `mask` is (H, W) bool. The results are cropped to the surroundings of mask and
    shape.
    """
    # The convex hull of the shape permits dents of the mask; a margin by the size of
    # the mask permits fits that are slightly off.
    reach = LIMITS.mask_reach * np.count_nonzero(mask) ** 0.5
    hull = outline_shape(outline).convex_hull.buffer(reach)
    corners = np.rint(shapely.get_coordinates(hull)).astype(np.int32)
    cover, (x, y) = coverage_box(outline, (0, 0, *mask.shape[::-1]))
    # A spike without area belongs to the coverage's box but not to the hull.
    opposite_corner = [x + cover.shape[1], y + cover.shape[0]]
    extent = [*corners.tolist(), [x, y], opposite_corner, *_box_corners(mask)]
    window = _window_around(extent)
    left = window[1].start
    top = window[0].start
    mask = mask[window]
    inside_hull = np.zeros(mask.shape, np.uint8)
    cv2.fillPoly(inside_hull, [corners - np.array([left, top], np.int32)], 1)
    # Pixels of other objects and of scenery hide the shape there, and holes of the mask
    # may be gaps of the segmentation.
    occupied = compilation.labels[window] > 0
    occupied |= compilation.scenery[window] | _fill_holes(mask)
    if isinstance(item.shape, Auto):
        # Perception adds a flat base below objects seen from above.
        occupied |= np.logical_or.accumulate(mask, axis=0)
    box = _window_at(x - left, y - top, cover.shape)
    return mask & (inside_hull == 0), (cover >= 0.5) & ~occupied[box]


def _window_around(points: list[list[int]]) -> tuple[slice, slice]:
    """Return the slices of an image around points x, y, with a margin."""
    extent = np.array(points)
    left, top = np.maximum(extent.min(axis=0) - LIMITS.thread_width, 0).tolist()
    right, bottom = (extent.max(axis=0) + LIMITS.thread_width).tolist()
    return np.s_[top:bottom, left:right]


def _box_corners(mask: Mask) -> list[list[int]]:
    """Return two opposite corners x, y of the box of a mask."""
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return [[x, y], [x + width, y + height]]


def _window_at(x: int, y: int, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return the slices of a part (H, W) of an image with its top-left pixel at x, y."""
    return np.s_[y : y + shape[0], x : x + shape[1]]


def _opened_area(mask: Mask) -> float:
    """Return the area of a mask without thin parts, px²; 0 for a shape outside the
    picture.
    """
    if not mask.size:
        return 0.0
    kernel = np.ones((LIMITS.thread_width, LIMITS.thread_width), np.uint8)
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    return float(opened.sum())


def _fill_holes(mask: Mask) -> Mask:
    """Return the mask without holes, such as the hole of a handle, (H, W)."""
    # A border of background connects all outside regions for one flood fill.
    outside = np.pad((~mask).astype(np.uint8), 1, constant_values=1)
    cv2.floodFill(outside, None, (0, 0), 2)
    return np.asarray(outside[1:-1, 1:-1] != 2)
