"""The top of a standing book: a page block between two covers.

A leaning book is drawn as its front and the sides behind it. A side of one colour would
be a lid on the book; the photo's own band above the front, sheared along the front's
upper edge, keeps pages and covers in their places.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import cv2
import numpy as np

from physgen.arrays import F32, F64, Mask
from physgen.photometry import DistantLight


@dataclass(frozen=True)
class TopTuning:
    """Thresholds of the search for pages above a front."""

    inner: tuple[float, float] = (0.25, 0.75)
    """Columns of the page block, shares of the width."""
    cover: float = 0.12
    """Width of each cover's end, share of the width."""
    brighter: float = 1.8
    """Least ratio of the pages' light to that of the covers and of the spine."""
    peak: float = 0.7
    """Share of the brightest row's light from which a row shows pages."""
    spine: tuple[int, int] = (1, 5)
    """Rows below the first row of the front; the darkest is the spine's, px."""
    mixed_share: float = 0.15
    """Share of the pages' light beyond the spine's in the last row that is no front."""
    seam: int = 2
    """Rows of the front below the edge, so that no gap opens between both, px."""
    dimmest: float = 0.7
    """Least light of a turned top relative to that in the photo."""


TOPS = TopTuning()


@dataclass(frozen=True)
class BlockTop:
    """The band of a photo above a front."""

    picture: F32
    """Linear light times coverage, and coverage, (h, w, 4), from the sprite's row 0."""
    edge: float
    """Row of the sprite at which the front begins."""
    light: DistantLight | None

    def warp(self, matrix: F64, shape: tuple[int, int], turn: float) -> tuple[F32, F32]:
        """Return colour (h, w, 3) and coverage (h, w) on a box of this `shape`.

        `matrix` (2, 3) leads from the box to the sprite. Points of the front's edge
        move with it; points above the edge stay right above their point of the edge,
        since depth is upwards in the photo at any rotation.
        """
        to_box = cv2.invertAffineTransform(matrix)
        direction, depth, shift = to_box.T
        # Replace the second axis by the vertical of the photo: depth stays upright
        # while the edge turns.
        to_box = np.stack(
            [direction, [0.0, 1.0], depth * self.edge + shift - [0.0, self.edge]],
            axis=1,
        )
        size = (shape[1], shape[0])
        band_picture = cv2.warpAffine(
            self.picture, to_box, size, flags=cv2.INTER_LINEAR
        )
        coverage = np.asarray(band_picture[..., 3], np.float32)
        # The interpolated colours are premultiplied by the coverage.
        colour = band_picture[..., :3] / np.maximum(coverage, 1e-3)[..., None]
        colour *= np.float32(self._gain(turn))
        return np.asarray(colour, np.float32), coverage

    def white_copy(self) -> BlockTop:
        """Return a white top of the same coverage, for mattes."""
        coverage = self.picture[..., 3]
        white = np.dstack([coverage, coverage, coverage, coverage])
        return BlockTop(np.asarray(white, np.float32), self.edge, None)

    def is_visible(self, turn: float) -> bool:
        """Check whether the edge is still on the upper side after a `turn`, rad."""
        return cos(turn) > 0

    def _gain(self, turn: float) -> float:
        """Return the light on the turned top relative to that in the photo."""
        if self.light is None:
            return 1.0
        x, y, _ = self.light.direction
        start = self.light.ambient + self.light.intensity * max(-y, 0.0)
        facing = max(x * sin(turn) - y * cos(turn), 0.0)
        new_light = self.light.ambient + self.light.intensity * facing
        return max(new_light / max(start, 1e-3), TOPS.dimmest)


def top_of_book(
    light: F32,
    coverage: F32,
    front: float,
    columns: tuple[int, int],
    lamp: DistantLight | None,
) -> BlockTop | None:
    """Return the band above a book's front; None if it shows no pages.

    `light` (h, w, 3) and `coverage` (h, w) of its sprite; `front`: the first row of its
    front; `columns`: its first and last column.
    """
    first = int((coverage >= 0.5).any(axis=1).argmax())
    rows = (first, int(front) + 1)
    pages = np.flatnonzero(page_rows(light.mean(axis=2), rows, columns))
    if not len(pages):
        return None
    # All rows with a share of the pages are above the front.
    edge = max(int(pages[-1]) + 1, round(front))
    end = edge + TOPS.seam
    picture = np.dstack([light[:end], coverage[:end]])
    return BlockTop(np.asarray(picture, np.float32), edge - 0.5, lamp)


def page_rows(brightness: F32, rows: tuple[int, int], edges: tuple[int, int]) -> Mask:
    """Return the rows (h,) that show pages between two covers; all False without any.

    `brightness` (h, w) of a sprite; `rows`: the first row of its band, and the first
    row of its front; `edges`: its first and last column.
    """
    is_page = np.zeros(len(brightness), np.bool_)
    (first, front), (left, right) = rows, edges
    start, end = (round(left + share * (right - left)) for share in TOPS.inner)
    upper, lower = TOPS.spine
    # A median across each row ignores letters and damage.
    inner = np.median(brightness[first : front + lower, start:end], axis=1)
    if len(inner) < front - first + lower:
        return is_page
    spine = float(inner[front - first + upper :].min())
    inner = inner[: front - first + upper + 1]
    pages, covers = _page_and_cover_light(
        brightness[first : first + len(inner), left : right + 1], inner
    )
    if pages < TOPS.brighter * max(spine, covers):
        return is_page
    # Pages are brighter than both covers.
    is_bright = inner > spine + TOPS.mixed_share * (pages - spine)
    is_page[first : first + len(inner)] = is_bright
    return is_page


def _page_and_cover_light(strip: F32, inner: F32) -> tuple[float, float]:
    """Return the light of pages and covers in the rows (h, w) above a book's front.

    `inner` (h,) is the light of each row between the covers.
    """
    is_bright = inner >= TOPS.peak * inner.max()
    return float(np.median(inner[is_bright])), _cover_light(strip[is_bright])


def _cover_light(strip: F32) -> float:
    """Return the light of the brighter one of the covers at both ends of a strip."""
    width = max(round(TOPS.cover * strip.shape[1]), 1)
    ends = (strip[:, :width], strip[:, -width:])
    return max(float(np.median(end)) for end in ends)
