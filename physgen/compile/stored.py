"""Maps that were stored for a photo, and a scene's masks -> whether the maps are still those of both."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.assemble import Compiled
from physgen.compile.warning import warning
from physgen.percepts.maps import Percepts
from physgen.problems import Problem
from physgen.scene.model import Scene

U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
Mask = NDArray[np.bool_]

REACH = 5
"""px beyond a mask's border that its soft coverage may reach."""
NEAR = 5
"""px around what is covered in which `background.png` need not be the photo: soft borders fade there."""
OVER = 5
"""px a side of the squares over which differences are averaged: what compression leaves of a photo is gone then."""
LEVELS = 8
"""Grey levels of such a mean from which on a pixel is not the photo's."""
LEAST = 64
"""Such pixels in one piece from which on somebody has painted: 8 x 8 px."""


def knows(maps: Percepts, labels: U16, scenery: Mask) -> bool:
    """Whether what was stored of coverage and background was made for masks like the scene's.

    `labels` (H, W) are the scene's objects, 0 = none; `scenery` (H, W) are pixels that show a boundary.
    """
    if ((labels > 0) & (maps.labels == 0)).any():
        return False
    if maps.coverage is None or not scenery.any():
        return True
    near = _grown(labels > 0, REACH)
    return not (maps.coverage[scenery & ~near] > 0.5).any()


def unlike_photo(scene: Scene, compiled: Compiled, maps: Percepts | None) -> Iterator[Problem]:
    """A photo that was edited since its maps were made: where nothing covers it, the clip shows `background.png`.

    Where `clean.png` is more like the photo than like the background, that one was painted, and is meant to differ.
    """
    if maps is None or maps.coverage is None or maps.background is None or scene.image is None:
        return
    if not knows(maps, compiled.labels, compiled.scenery):  # it is made anew, of the photo
        return
    open_ = ~_grown((maps.coverage > 0) | (maps.labels > 0) | (compiled.labels > 0), NEAR)
    alike = cv2.inRange(cv2.absdiff(maps.rgb, maps.background), (0, 0, 0), (LEVELS, LEVELS, LEVELS))
    if not (open_ & (alike == 0)).any():  # as ever: nothing more to be worked out
        return
    off = _off(maps.rgb, maps.background, open_)
    differs = (np.abs(off) > LEVELS).any(axis=2) & open_
    if maps.clean is not None and differs.any():
        told = _off(maps.clean, maps.background, open_)
        differs &= np.abs(told - off).sum(axis=2) >= np.abs(told).sum(axis=2)
    differs = _large(differs)
    count = int(differs.sum())
    if not count:
        return
    rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    where = f"x {columns[0]} to {columns[-1]}, y {rows[0]} to {rows[-1]}"
    expected = (
        f"differs from background.png in {count:,} px beside the objects ({where}): the clip shows that one"
    )
    fix = "if the photo was edited, physgen perceive --refresh makes the maps anew; if the map was painted, all is well"
    yield warning(scene, "image", scene.image.name, expected, fix)


def _off(one: U8, other: U8, within: Mask) -> NDArray[np.int16]:
    """(H, W, 3) grey levels from the other to the one, means over squares of what is `within`."""
    off = cv2.subtract(one, other, dtype=cv2.CV_16S)
    off[~within] = 0
    return np.asarray(cv2.blur(off, (OVER, OVER)), np.int16)


def _large(mask: Mask) -> Mask:
    """(H, W): its connected pieces of `LEAST` px or more; compression leaves specks."""
    _, ids, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    large = stats[:, cv2.CC_STAT_AREA] >= LEAST
    large[0] = False
    return np.asarray(large[ids])


def _grown(mask: Mask, by: int) -> Mask:
    """(H, W): the mask and all within `by` px of it, to the sides and aslant."""
    reach = np.ones((2 * by + 1, 2 * by + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), reach) > 0)
