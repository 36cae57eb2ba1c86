"""Labels of the pixels of a hole with offsets, by belief propagation on the grid.

The cost of two offsets at neighbouring pixels is the difference of their copies at both
pixels (Kwatra et al. 2003, Graphcut textures). Messages are passed line by line, down,
up, right and left (Tappen and Freeman 2003). The last label is the guide, another fill,
for pixels without a valid offset.
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
    """Costs in squared levels of three channels; tuned on a half of
    `benchmarks/fills.py`.
    """

    # Factor of the squared difference from the guide's colour.
    guide: float = 0.04
    # Limit of that cost, since the guide can be wrong.
    guide_most: float = 240.0
    # px: finer differences from the guide do not count.
    guide_blur: float = 2.0
    # Levels per unit of the logarithms of texture, in comparisons of neighbours.
    texture: float = 20.0
    # Factor of the squared logarithm of contrast over the expected contrast.
    contrast: float = 300.0
    # Limit of that squared logarithm.
    contrast_most: float = 6.0
    # Cost of an offset as long as the picture.
    distance: float = 30.0
    # Factor of the difference between a source and the patch most similar to it ...
    rarity: float = 0.25
    # ... up to this difference.
    rarest: float = 2000.0
    # Cost of the guide, used only without a usable offset.
    keep: float = 5e5
    # Factor of the squared difference from known neighbours.
    rim: float = 2.0
    # The same for neighbours without contact.
    rim_second: float = 0.35
    # Cost of unknown sources.
    unusable: float = 1e7
    # Rounds of messages in all four directions.
    rounds: int = 3


COSTS = _Costs()
# Standard deviations, px, and weights of the blurs that give the expected contrast.
EXPECTATION = ((1.5, 1.0), (4.0, 0.05), (12.0, 2e-3), (40.0, 1e-4))


@dataclass(frozen=True)
class ReducedPhoto:
    """A part of a photo at reduced size; (h, w) and (h, w, 3)."""

    # The guide in blocked pixels.
    picture: F32
    # Equals the picture outside the hole.
    guide: F32
    hole: Mask
    # The hole, and other pixels that must not be copied.
    blocked_mask: Mask
    # Logarithm of mean squared fine detail; that of the guide in blocked pixels.
    contrast: F32
    # Squared difference of a patch from the most similar other one.
    rarity: F32
    # (h, w, c): logarithms of mean squared differences in several directions.
    texture: F32


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
        """Return the label (h, w) of each pixel: len(offsets) = guide, -1 = known."""
        beliefs = self.own + sum(self._messages())
        labels = np.full(self.photo.hole.shape, -1, np.int64)
        labels[self.box] = np.where(self.inside, beliefs.argmin(axis=2), -1)
        return labels

    def _sources(self, down: int = 0, right: int = 0) -> tuple[NDArray[np.int64], ...]:
        """Return rows and columns (h, w, K) copied by offsets to a neighbour, inside
        the photo.
        """
        height, width = self.photo.hole.shape
        rows = self.rows + down + self.offsets[:, 0]
        columns = self.columns + right + self.offsets[:, 1]
        return np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)

    def _label_colours(self) -> F32:
        """Return colour, slopes and texture (h, w, K + 1, n) of each label as whole
        numbers.
        """
        sources = self._sources()
        texture = np.round(COSTS.texture * self.photo.texture).astype(np.float32)
        copies, guide = (
            np.dstack([_colour_and_slopes(picture), texture])
            for picture in (self.photo.picture, self.photo.guide)
        )
        return np.concatenate([copies[sources], guide[self.box][:, :, None]], axis=2)

    def _own_costs(self) -> F32:
        """Return the costs (h, w, K + 1) that do not depend on the neighbours'
        labels.
        """
        photo, sources = self.photo, self._sources()
        costs = self._guide_costs(sources) + COSTS.rim * self._rim_costs()
        costs += COSTS.distance * offset_cost(self.offsets, photo.hole.shape)
        costs += COSTS.rarity * np.minimum(photo.rarity, COSTS.rarest)[sources]
        costs[~self._usable(sources)] = COSTS.unusable
        guide = np.full_like(costs[..., :1], COSTS.keep)
        costs = np.concatenate([costs, guide], axis=2)
        costs += self._contrast_costs(sources)
        costs[~self.inside] = 0
        return np.asarray(costs, np.float32)

    def _usable(self, sources: tuple[NDArray[np.int64], ...]) -> Mask:
        """Return (h, w, K) whether an offset stays in the photo and copies known
        pixels.
        """
        height, width = self.photo.hole.shape
        # Slopes next to a hole are unknown, too.
        blocked_slopes = (
            cv2.dilate(self.photo.blocked_mask.astype(np.uint8), np.ones((3, 3))) > 0
        )
        blocked_slopes[[0, -1]] = blocked_slopes[:, [0, -1]] = True
        rows, columns = (
            self.rows + self.offsets[:, 0],
            self.columns + self.offsets[:, 1],
        )
        legal = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        return np.asarray(legal & ~blocked_slopes[sources])

    def _guide_costs(self, sources: tuple[NDArray[np.int64], ...]) -> F32:
        """Return the costs (h, w, K) of differences from the guide's blurred
        colours.
        """
        blurred_sources = _known_blur(
            self.photo.picture, self.photo.blocked_mask, COSTS.guide_blur
        )
        aim = cv2.GaussianBlur(self.photo.guide, (0, 0), COSTS.guide_blur)[self.box]
        gap = ((blurred_sources[sources] - aim[:, :, None]) ** 2).sum(axis=-1)
        return np.asarray(np.minimum(COSTS.guide * gap, COSTS.guide_most), np.float32)

    def _contrast_costs(self, sources: tuple[NDArray[np.int64], ...]) -> F32:
        """Return costs (h, w, K + 1) of contrast: a blur costs as much as too strong a
        texture.
        """
        photo = self.photo
        known_weights = (~photo.blocked_mask).astype(np.float32)
        total, weights = np.zeros_like(known_weights), np.zeros_like(known_weights)
        # Wide blurs have small weights and count only if no contrast is known nearby.
        for sigma, gain in EXPECTATION:
            total += gain * cv2.GaussianBlur(
                photo.contrast * known_weights, (0, 0), sigma
            )
            weights += gain * cv2.GaussianBlur(known_weights, (0, 0), sigma)
        expected_contrast = (total / np.maximum(weights, 1e-9))[self.box][..., None]
        copies = _known_blur(photo.contrast, photo.blocked_mask, 1.0)[sources]
        guide = cv2.GaussianBlur(photo.contrast, (0, 0), 1.0)[self.box][..., None]
        contrasts = np.concatenate([copies, guide], axis=2)
        gap = np.minimum((contrasts - expected_contrast) ** 2, COSTS.contrast_most)
        return np.asarray(COSTS.contrast * gap, np.float32)

    def _rim_costs(self) -> F32:
        """Return differences (h, w, K) of known neighbours and the neighbours of the
        copies.
        """
        photo = self.photo
        height, width = photo.hole.shape
        features = np.dstack([photo.picture, COSTS.texture * photo.texture])
        costs = np.zeros((*self.inside.shape, len(self.offsets)), np.float32)
        for down, right, weight in _neighbours():
            rows, columns = self.rows[..., 0] + down, self.columns[..., 0] + right
            known_mask = self.inside & (rows >= 0) & (rows < height)
            known_mask &= (columns >= 0) & (columns < width)
            known_mask[known_mask] = ~photo.blocked_mask[
                rows[known_mask], columns[known_mask]
            ]
            if not known_mask.any():
                continue
            sources = tuple(place[known_mask] for place in self._sources(down, right))
            aim = features[rows[known_mask], columns[known_mask]][:, None]
            gap = ((features[sources] - aim) ** 2).sum(axis=-1)
            costs[known_mask] += np.float32(weight) * gap
        return costs

    def _messages(self) -> list[F32]:
        """Return messages (h, w, K + 1) from above, below, left and right."""
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
            differences = self._differences(line)
            if last is not None:
                belief = self.own[last].copy()
                for other, message in enumerate(messages):
                    # The message back to the receiver is excluded, as in belief
                    # propagation.
                    if other != back:
                        belief += message[last]
                gap += differences
                gap += belief[:, :, None]
                message_values = gap.min(axis=1)
                # Only differences between labels matter; a minimum of 0 avoids large
                # numbers.
                message_values -= message_values.min(axis=1, keepdims=True)
                is_link = self.inside[line] & self.inside[last]
                messages[index][line] = np.where(is_link[:, None], message_values, 0)
            last, gap = line, differences.copy()

    def _differences(self, line: Line) -> F32:
        """Return squared differences (n, K + 1, K + 1) of two labels at one pixel."""
        colours, square = self.colours[line], self.square[line]
        products = colours @ np.swapaxes(colours, 1, 2)
        return np.asarray(square[:, :, None] + square[:, None, :] - 2 * products)


def _neighbours() -> Iterable[tuple[int, int, float]]:
    """Yield neighbours of a pixel, px down and right, and their weights."""
    reach = range(-2, 3)
    for down in reach:
        for right in reach:
            distance = abs(down) + abs(right)
            if 0 < distance <= 3:
                yield down, right, 1.0 if distance == 1 else COSTS.rim_second


def _colour_and_slopes(picture: F32) -> F32:
    """Return colours and slopes (h, w, 5) as whole numbers.

    Sums of their products are exact in single precision.
    """
    grey = picture.mean(axis=2)
    slopes = [cv2.Sobel(grey, cv2.CV_32F, *axes) / 4 for axes in ((1, 0), (0, 1))]
    return np.round(np.dstack([picture, *slopes])).astype(np.float32)


def _known_blur(picture: F32, blocked: Mask, sigma: float) -> F32:
    """Return a blur of `picture` (h, w[, c]) from pixels outside `blocked` (h, w)."""
    weights = (~blocked).astype(np.float32)
    weight = np.maximum(cv2.GaussianBlur(weights, (0, 0), sigma), 1e-3)
    if picture.ndim == 3:
        weights, weight = weights[..., None], weight[..., None]
    return np.asarray(cv2.GaussianBlur(picture * weights, (0, 0), sigma) / weight)
