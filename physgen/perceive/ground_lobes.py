"""Pieces of the support in the mask of an object: the end of a tray beside a pot.

The mask of a network may include ground beside the foot of its object. Such a piece
sticks out of the object, is in its lower part, and has the colours of the ground at
the same height rather than those of the object. It stays in the background, because it
would slide away with the object and leave a torn tray.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, Rgb
from physgen.perceive.segment.network import follow_edges


@dataclass(frozen=True)
class LobeLimits:
    """Limits of pieces of the ground, chosen on 20 labelled photos.

    The size of an object is the root of its area.
    """

    side: float = 160.0
    """px: size of an object in the search."""
    smallest: int = 2000
    """px: least area of a searched object."""
    context: float = 0.8
    """Width of the compared surroundings over the object's size."""
    width: float = 0.13
    """Half the width of a piece over the object's size, at most."""
    part: tuple[float, float] = (0.008, 0.25)
    """Least and largest area of a piece over the object's."""
    low: float = 0.4
    """Lowest share of the object's height, with the middle of a piece."""
    margin: int = 2
    """px at reduced size without colours on either side of the outline."""
    sample: int = 100
    """Least number of compared pixels of the ground and of the object."""
    bins: int = 12
    """Bins of each colour channel."""
    floor: float = 1e-3
    """Share of all colours that neither the ground nor the object shows."""
    likelier: float = 1.0
    """Least mean of log(likelihood of the ground / likelihood of the object)."""
    share: float = 0.85
    """Least share of pixels for which the ground is likelier."""
    edge: int = 4
    """px at reduced size: radius of the filter that moves borders to edges."""


LOBES = LobeLimits()


def detach_ground(photo: Rgb, labels: Labels) -> Labels:
    """Return the label map (H, W) without pieces of the ground beside the feet."""
    result = labels.copy()
    areas = np.bincount(labels.ravel())
    for number in np.flatnonzero(areas >= LOBES.smallest).tolist():
        if number:
            result[_ground_pieces(photo, labels, number)] = 0
    return result


def _ground_pieces(photo: Rgb, labels: Labels, number: int) -> Mask:
    """Return the pixels (H, W) of an object that are ground."""
    object_mask = labels == number
    size = float(np.sqrt(np.count_nonzero(object_mask)))
    margin = round(LOBES.context * size)
    x, y, width, height = cv2.boundingRect(object_mask.view(np.uint8))
    rows = slice(max(y - margin, 0), y + height + margin)
    columns = slice(max(x - margin, 0), x + width + margin)
    window = rows, columns
    surroundings = _Surroundings.create(photo[window], labels[window], number, size)
    ground = surroundings.ground_pieces()
    result: Mask = np.zeros_like(object_mask)
    if ground.any():
        own_window = object_mask[window]
        result[window] = own_window & _sharpen(photo[window], surroundings, ground)
    return np.asarray(result)


@dataclass(frozen=True)
class _Surroundings:
    """An object and its surroundings at reduced size, (h, w)."""

    photo: Rgb
    object_mask: Mask
    all_objects: Mask
    """Pixels of all objects."""

    @property
    def size(self) -> float:
        """Return the root of the object's area, px."""
        return float(np.sqrt(np.count_nonzero(self.object_mask)))

    @staticmethod
    def create(photo: Rgb, labels: Labels, number: int, size: float) -> _Surroundings:
        """Return the surroundings in a window of a photo; `size` of the object, px."""
        scale = min(1.0, LOBES.side / size)
        height, width = labels.shape
        small_size = max(1, round(width * scale)), max(1, round(height * scale))
        small_labels = cv2.resize(labels, small_size, interpolation=cv2.INTER_NEAREST)
        small_photo = cv2.resize(photo, small_size, interpolation=cv2.INTER_AREA)
        return _Surroundings(
            np.asarray(small_photo, np.uint8),
            np.asarray(small_labels == number),
            np.asarray(small_labels > 0),
        )

    def ground_pieces(self) -> Mask:
        """Return the pieces (h, w) of the object that are ground."""
        result = np.zeros_like(self.object_mask)
        core = self._core()
        for piece in self._pieces(core):
            evidence = self._evidence(piece, core)
            if evidence is None:
                continue
            is_likelier = evidence[piece] > 0
            is_ground = evidence[piece].mean() >= LOBES.likelier
            if is_ground and is_likelier.mean() >= LOBES.share:
                result |= self._grow_piece(piece, evidence)
        return result

    def _grow_piece(self, piece: Mask, evidence: F32) -> Mask:
        """Return a piece (h, w) of the ground with its continuation in the core.

        A piece begins at its narrow part, some way outside the object.
        """
        distance = cv2.distanceTransform((~piece).view(np.uint8), cv2.DIST_L2, 3)
        neighbourhood = distance <= LOBES.width * self.size
        smooth_evidence = cv2.blur(evidence, (3, 3))
        ground = piece | (self.object_mask & neighbourhood & (smooth_evidence > 0))
        _, names = cv2.connectedComponents(ground.view(np.uint8), connectivity=4)
        return np.asarray(np.isin(names, np.unique(names[piece])))

    def _core(self) -> Mask:
        """Return the object (h, w) without narrow pieces."""
        radius = max(1, round(LOBES.width * self.size))
        side = 2 * radius + 1
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        padded_mask = np.pad(self.object_mask.view(np.uint8), side)
        opening = cv2.morphologyEx(padded_mask, cv2.MORPH_OPEN, kernel)
        return np.asarray(opening[side:-side, side:-side] > 0)

    def _pieces(self, core: Mask) -> Iterator[Mask]:
        """Yield the pieces (h, w) that stick out of the lower part of the core."""
        rest = (self.object_mask & ~core).view(np.uint8)
        square = np.ones((3, 3), np.uint8)
        opened_rest = cv2.morphologyEx(rest, cv2.MORPH_OPEN, square)
        count, names = cv2.connectedComponents(opened_rest, connectivity=4)
        own_rows = np.flatnonzero(self.object_mask.any(axis=1))
        highest = own_rows[-1] - LOBES.low * (np.ptp(own_rows) + 1)
        least_share, largest_share = LOBES.part
        area = np.count_nonzero(self.object_mask)
        for k in range(1, count):
            piece = names == k
            share = np.count_nonzero(piece) / area
            if (
                least_share <= share <= largest_share
                and np.nonzero(piece)[0].mean() >= highest
            ):
                yield piece

    def _evidence(self, piece: Mask, core: Mask) -> F32 | None:
        """Return log(likelihood of the ground / likelihood of the object), (h, w).

        The ground is that at the height of a piece (h, w). None without enough ground.
        """
        outside = cv2.distanceTransform(
            (~self.object_mask).view(np.uint8), cv2.DIST_L2, 3
        )
        inside = cv2.distanceTransform(self.object_mask.view(np.uint8), cv2.DIST_L2, 3)
        rows = np.flatnonzero(piece.any(axis=1))
        ground = (outside > LOBES.margin) & ~self.all_objects
        ground[: rows[0]] = False
        ground[rows[-1] + 1 :] = False
        body = core & (inside > LOBES.margin)
        if min(np.count_nonzero(ground), np.count_nonzero(body)) < LOBES.sample:
            return None
        cells = self.photo.astype(np.intp) * LOBES.bins // 256
        likelihoods = []
        for mask in (ground, body):
            frequencies = _colour_frequencies(self.photo[mask])
            likelihoods.append(frequencies[tuple(np.moveaxis(cells, -1, 0))])
        return np.asarray(np.log(likelihoods[0] / likelihoods[1]), np.float32)


def _colour_frequencies(colours: Rgb) -> F32:
    """Return the frequencies of `colours` (n, 3) in cells of the colour space, with a
    blur of one cell.
    """
    cells = colours.astype(np.intp) * LOBES.bins // 256
    counts: F32 = np.zeros((LOBES.bins,) * 3, np.float32)
    np.add.at(counts, tuple(cells.T), 1)
    for axis in range(3):
        before = np.roll(counts, 1, axis)
        after = np.roll(counts, -1, axis)
        # The circle of bins would join black and white.
        np.moveaxis(before, axis, 0)[0] = 0
        np.moveaxis(after, axis, 0)[-1] = 0
        counts = np.asarray(counts / 2 + (before + after) / 4, np.float32)
    counts += LOBES.floor * len(colours) / counts.size
    return np.asarray(counts / counts.sum(), np.float32)


def _sharpen(photo: Rgb, surroundings: _Surroundings, ground: Mask) -> Mask:
    """Return pieces of the ground (h, w) at the size of a photo (H, W, 3), with borders
    along its edges.
    """
    rest = (surroundings.object_mask & ~ground).astype(np.float32)
    weights = follow_edges(surroundings.photo, rest, LOBES.edge)
    size = photo.shape[1::-1]
    weights = np.asarray(cv2.resize(weights, size), np.float32)
    coverage = (weights[..., :3] * photo).sum(axis=-1) + weights[..., 3]
    square = np.ones((2 * LOBES.margin + 1,) * 2, np.uint8)
    zone = cv2.dilate(ground.view(np.uint8), square)
    large_zone = cv2.resize(zone, size, interpolation=cv2.INTER_NEAREST) > 0
    inner = cv2.erode(ground.view(np.uint8), square)
    large_inner = cv2.resize(inner, size, interpolation=cv2.INTER_NEAREST) > 0
    return np.asarray(large_zone & (large_inner | (coverage < 0.5)))
