"""Labelling of the pixels of a hole with offsets, by belief propagation on their grid.

The cost of two offsets at neighbouring pixels is the difference of what both would copy to both pixels (Kwatra et al.
2003, Graphcut textures). Messages are passed line by line, down, up, right and left (Tappen and Freeman 2003). The last
label is the guide, a fill by other means, for pixels that no offset can fill.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.copy_offsets import Offsets, offset_cost
from physgen.perceive.roles import Mask

Line = tuple[slice, int] | tuple[int, slice]


@dataclass(frozen=True)
class _Costs:
    """Squared levels of three channels a pixel; tune half of `benchmarks/fills.py`."""

    guide: float = 0.04  # of the squared difference from the guide's colour
    guide_most: float = 240.0  # levels squared times 0.04: a guide can be wrong
    guide_blur: float = 2.0  # px: finer differences from the guide do not count
    contrast: float = 300.0  # of the squared logarithm of contrast beside the expected
    contrast_most: float = 6.0  # squared logarithm: different is different
    far: float = 30.0  # for an offset as long as the picture
    keep: float = 5e5  # for the guide, which shows only if no offset is usable
    rim: float = 2.0  # of the squared difference from known neighbours
    rim_second: float = 0.35  # the same for those that do not touch
    unusable: float = 1e7  # where nothing is known
    rounds: int = 3  # of messages in all four directions


COSTS = _Costs()
# px, standard deviations, and weights of the blurs that expect a contrast
EXPECTATION = ((1.5, 1.0), (4.0, 0.05), (12.0, 2e-3), (40.0, 1e-4))


@dataclass(frozen=True)
class ReducedPhoto:
    """A part of a photo at reduced size; (h, w) and (h, w, 3)."""

    picture: F32  # the guide in what is blocked
    guide: F32  # equals the picture outside the hole
    hole: Mask
    blocked: Mask  # the hole, and what else is not to be copied
    contrast: F32  # logarithm of mean squared fine detail; arbitrary in what is blocked


class OffsetLabels:
    """The hole's pixels in their bounding box, with costs of each label."""

    def __init__(self, photo: ReducedPhoto, offsets: Offsets) -> None:
        left, top, width, height = cv2.boundingRect(photo.hole.astype(np.uint8))
        self.box = np.s_[top : top + height, left : left + width]
        self.photo, self.offsets = photo, offsets
        self.inside = photo.hole[self.box]
        rows, columns = np.mgrid[self.box]
        self.rows, self.columns = rows[..., None], columns[..., None]
        self.colours = self._label_colours()
        self.square = (self.colours**2).sum(axis=-1)
        self.own = self._own_costs()

    def solve(self) -> NDArray[np.int64]:
        """(h, w) label of each pixel of the hole; len(offsets) = guide, -1 = known."""
        beliefs = self.own + sum(self._messages())
        labels = np.full(self.photo.hole.shape, -1, np.int64)
        labels[self.box] = np.where(self.inside, beliefs.argmin(axis=2), -1)
        return labels

    def _sources(self, down: int = 0, right: int = 0) -> tuple[NDArray[np.int64], ...]:
        """Rows, columns (h, w, K) that offsets copy to a neighbour, within the photo."""
        height, width = self.photo.hole.shape
        rows = self.rows + down + self.offsets[:, 0]
        columns = self.columns + right + self.offsets[:, 1]
        return np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)

    def _label_colours(self) -> F32:
        """(h, w, K + 1, 5): colour and slopes of each label, in whole numbers."""
        sources = self._sources()
        copies = _colour_and_slopes(self.photo.picture)[sources]
        guide = _colour_and_slopes(self.photo.guide)[self.box][:, :, None]
        return np.concatenate([copies, guide], axis=2)

    def _own_costs(self) -> F32:
        """(h, w, K + 1): costs that do not depend on the neighbours' labels."""
        photo, sources = self.photo, self._sources()
        costs = self._guide_costs(sources) + COSTS.rim * self._rim_costs()
        costs += COSTS.far * offset_cost(self.offsets, photo.hole.shape)
        costs[~self._usable(sources)] = COSTS.unusable
        costs += self._contrast_costs(sources)
        guide = np.full_like(costs[..., :1], COSTS.keep)
        costs = np.concatenate([costs, guide], axis=2)
        costs[~self.inside] = 0
        return np.asarray(costs, np.float32)

    def _usable(self, sources: tuple[NDArray[np.int64], ...]) -> Mask:
        """(h, w, K): whether an offset stays in the photo and copies known pixels."""
        height, width = self.photo.hole.shape
        # slopes next to a hole are not known either
        near = cv2.dilate(self.photo.blocked.astype(np.uint8), np.ones((3, 3))) > 0
        near[[0, -1]] = near[:, [0, -1]] = True
        rows, columns = (
            self.rows + self.offsets[:, 0],
            self.columns + self.offsets[:, 1],
        )
        legal = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        return np.asarray(legal & ~near[sources])

    def _guide_costs(self, sources: tuple[NDArray[np.int64], ...]) -> F32:
        soft = _known_blur(self.photo.picture, self.photo.blocked, COSTS.guide_blur)
        aim = cv2.GaussianBlur(self.photo.guide, (0, 0), COSTS.guide_blur)[self.box]
        gap = ((soft[sources] - aim[:, :, None]) ** 2).sum(axis=-1)
        return np.asarray(np.minimum(COSTS.guide * gap, COSTS.guide_most), np.float32)

    def _contrast_costs(self, sources: tuple[NDArray[np.int64], ...]) -> F32:
        """(h, w, K): a blur costs as much as too strong a texture."""
        photo = self.photo
        known = (~photo.blocked).astype(np.float32)
        total, weights = np.zeros_like(known), np.zeros_like(known)
        for sigma, gain in EXPECTATION:
            total += gain * cv2.GaussianBlur(photo.contrast * known, (0, 0), sigma)
            weights += gain * cv2.GaussianBlur(known, (0, 0), sigma)
        expected = (total / np.maximum(weights, 1e-9))[self.box][..., None]
        copies = _known_blur(photo.contrast, photo.blocked, 1.0)[sources]
        gap = np.minimum((copies - expected) ** 2, COSTS.contrast_most)
        return np.asarray(COSTS.contrast * gap, np.float32)

    def _rim_costs(self) -> F32:
        """(h, w, K): differences of known neighbours and what is beside the copies."""
        photo = self.photo
        height, width = photo.hole.shape
        costs = np.zeros((*self.inside.shape, len(self.offsets)), np.float32)
        for down, right, weight in _neighbours():
            rows, columns = self.rows[..., 0] + down, self.columns[..., 0] + right
            known = self.inside & (rows >= 0) & (rows < height)
            known &= (columns >= 0) & (columns < width)
            known[known] = ~photo.blocked[rows[known], columns[known]]
            if not known.any():
                continue
            sources = tuple(place[known] for place in self._sources(down, right))
            aim = photo.picture[rows[known], columns[known]][:, None]
            gap = ((photo.picture[sources] - aim) ** 2).sum(axis=-1)
            costs[known] += np.float32(weight) * gap
        return costs

    def _messages(self) -> list[F32]:
        """Messages (h, w, K + 1) from above, below, left and right."""
        height, width = self.inside.shape
        messages = [np.zeros_like(self.own) for _ in range(4)]
        rows: list[Line] = [(k, slice(None)) for k in range(height)]
        columns: list[Line] = [(slice(None), k) for k in range(width)]
        sweeps = (
            (0, rows, 1),
            (1, rows[::-1], 0),
            (2, columns, 3),
            (3, columns[::-1], 2),
        )
        for _ in range(COSTS.rounds):
            for index, lines, back in sweeps:
                self._sweep(messages, index, lines, back)
        return messages

    def _sweep(
        self, messages: list[F32], index: int, lines: Iterable[Line], back: int
    ) -> None:
        """Pass messages from line to line, into `messages[index]`."""
        last: Line | None = None
        gap = np.zeros(0, np.float32)
        for line in lines:
            here = self._differences(line)
            if last is not None:
                belief = self.own[last].copy()
                for other, message in enumerate(messages):
                    if other != back:
                        belief += message[last]
                gap += here
                gap += belief[:, :, None]
                passed = gap.min(axis=1)
                passed -= passed.min(axis=1, keepdims=True)
                both = self.inside[line] & self.inside[last]
                messages[index][line] = np.where(both[:, None], passed, 0)
            last, gap = line, here.copy()

    def _differences(self, line: Line) -> F32:
        """(n, K + 1, K + 1): squared differences of two labels at one pixel."""
        colours, square = self.colours[line], self.square[line]
        both = colours @ np.swapaxes(colours, 1, 2)
        return np.asarray(square[:, :, None] + square[:, None, :] - 2 * both)


def _neighbours() -> Iterable[tuple[int, int, float]]:
    """Neighbours of a pixel, px down and right, and their weights."""
    reach = range(-2, 3)
    for down in reach:
        for right in reach:
            far = abs(down) + abs(right)
            if 0 < far <= 3:
                yield down, right, 1.0 if far == 1 else COSTS.rim_second


def _colour_and_slopes(picture: F32) -> F32:
    """(h, w, 5) whole numbers: sums of their products are exact in single precision."""
    grey = picture.mean(axis=2)
    slopes = [cv2.Sobel(grey, cv2.CV_32F, *axes) / 4 for axes in ((1, 0), (0, 1))]
    return np.round(np.dstack([picture, *slopes])).astype(np.float32)


def _known_blur(picture: F32, blocked: Mask, sigma: float) -> F32:
    """A blur of `picture` (h, w[, c]) from what is not `blocked` (h, w)."""
    known = (~blocked).astype(np.float32)
    weight = np.maximum(cv2.GaussianBlur(known, (0, 0), sigma), 1e-3)
    if picture.ndim == 3:
        known, weight = known[..., None], weight[..., None]
    return np.asarray(cv2.GaussianBlur(picture * known, (0, 0), sigma) / weight)
