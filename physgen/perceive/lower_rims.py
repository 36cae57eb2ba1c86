"""Lower rims of masks: the border between an object and the ground below it.

The mask of a network may include a strip of the ground, or end before the base of its
object. The strip would move with the object, and the base would stay behind. A ribbon
along the lower half of an outline is searched for a better border, as in snakes (Kass
et al. 1988) and intelligent scissors (Mortensen and Barrett 1995): the shortest path
along the ribbon separates pixels of the object from pixels of the ground and follows
edges. Colours of both are learnt beside the ribbon, and dimmed colours of the ground
are its shadow.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, Rgb
from physgen.perceive.segment.network import box_of, object_chances

F64 = NDArray[np.float64]
Ints = NDArray[np.intp]


@dataclass(frozen=True)
class RimConstants:
    """Constants of the search; the size of an object is the root of its area.

    The weights and costs were chosen among 65 combinations by the misplaced pixels of 394
    labelled objects, and by eye on six photos without labels; notches by eye.
    """

    side: float = 400.0
    """px: size of an object in the search."""
    least_area: float = 0.01
    """Least area of an object over the photo's."""
    objects: int = 5
    """Number of searched objects, the largest ones."""
    surroundings: float = 0.3
    """Width of an object's surroundings over its size."""
    smoothing: float = 0.012
    """Blur of the outline over the object's size."""
    band: float = 0.05
    """Half the width of the searched ribbon over the object's size."""
    compared_width: float = 0.06
    """Width of the compared pixels on either side of the ribbon, over the size."""
    lower_share: float = 0.5
    """Share of the object's height, from below, with a searched outline."""
    stretch: float = 0.3
    """Half the length of a stretch with common colours, over the object's size."""
    sample: int = 50
    """Least number of compared pixels of the ground and of the object."""
    bins: int = 16
    """Bins of each colour channel."""
    floor: float = 1e-4
    """Frequency of a colour that neither the ground nor the object shows."""
    inner_weight: float = 0.5
    """Weight of the outermost compared pixels inside the ribbon."""
    shades: tuple[tuple[float, float], ...] = (
        (1.0, 0.6), (0.85, 0.15), (0.7, 0.1), (0.5, 0.08), (0.35, 0.07),
    )  # fmt: skip
    """Brightness of shaded ground over that of lit ground, and its frequency."""
    lit_limit: float = 2.0
    """Largest logarithm of a ratio of likelihoods of colours."""
    shade_limit: float = 0.6
    """The same for ground that may be shaded: the base of an object is dark, too."""
    chance: float = 0.02
    """Least chance of the object and of the ground in the network's map."""
    colour: float = 0.4
    """Weight of colours, and least evidence for the object in known pixels."""
    network: float = 0.5
    """Weight of the network's chances."""
    edge: float = 6.0
    """Gain of a border along a clear edge."""
    texture: float = 2.0
    """Difference of colours at half a clear edge over that within the ground."""
    noise: float = 20.0
    """8-bit levels: the same over plain ground."""
    shift_cost: float = 0.5
    """Cost of a distance from the mask's border, by px."""
    bend_cost: float = 1.0
    """Cost of a change of the distance from the outline, by px."""
    slope: int = 3
    """px: largest such change between neighbours."""
    shift: float = 1.5
    """px: a border that moves by less stays as it is."""
    notch: float = 0.15
    """Largest width of a notch over the size: a new deep notch is mostly an edge within
    the object, such as that of a label."""
    notch_depth: float = 0.02
    """Least depth of a filled notch over the size: shallow ones are mostly right."""
    margin: float = 0.015
    """Length of outline over the size: beside a moved border it follows the path, beside
    another object it stays."""


RIMS = RimConstants()


def refine_lower_rims(photo: Rgb, labels: Labels, known: Mask) -> Labels:
    """Return the label map (H, W) with better lower rims of large objects.

    Pixels `known` (H, W) to be objects by more than their colours are not ground.
    """
    result = labels.copy()
    for number in _large_objects(labels):
        view = _View.create(photo, labels, number)
        ribbon = _Ribbon.create(view)
        if ribbon is None or not ribbon.rim_points.any():
            continue
        chances, box = object_chances(photo, box_of(labels == number))
        evidence = ribbon.evidence(_sample_chances(chances, box, ribbon, view))
        if known.any():
            known_pixels = _sample_mask(known, ribbon, view)
            own_evidence = np.minimum(evidence, -RIMS.colour)
            evidence = np.where(known_pixels, own_evidence, evidence)
        offsets = ribbon.best_offsets(evidence)
        _move_rim(result, number, ribbon, view, offsets)
    return result


def _large_objects(labels: Labels) -> Iterator[int]:
    """Yield the ids of the objects that are large enough, the largest first."""
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    least_area = RIMS.least_area * labels.size
    for number in np.argsort(-areas, kind="stable")[: RIMS.objects].tolist():
        if areas[number] >= least_area:
            yield number


def _resize(
    image: NDArray[np.uint8] | Labels, size: tuple[int, int], interpolation: int
) -> NDArray[Any]:
    """Return an image with a `size` (width, height) px."""
    return np.asarray(cv2.resize(image, size, interpolation=interpolation))


@dataclass(frozen=True)
class _View:
    """An object and its surroundings at reduced size, (h, w)."""

    photo: Rgb
    labels: Labels
    number: int
    left: int
    """px of the photo."""
    top: int
    """px of the photo."""
    scale: float
    """Size of a pixel of the photo, px."""

    @property
    def size(self) -> float:
        """Return the root of the object's area, px."""
        return float(np.sqrt(np.count_nonzero(self.labels == self.number)))

    @staticmethod
    def create(photo: Rgb, labels: Labels, number: int) -> _View:
        """Return the view of an object of a photo (H, W, 3)."""
        size = float(np.sqrt(np.count_nonzero(labels == number)))
        scale = min(1.0, RIMS.side / size)
        margin = round(RIMS.surroundings * size)
        left, top, right, bottom = box_of(labels == number)
        rows = slice(max(0, top - margin), bottom + margin)
        columns = slice(max(0, left - margin), right + margin)
        labels = labels[rows, columns]
        height, width = labels.shape
        new_size = max(1, round(width * scale)), max(1, round(height * scale))
        return _View(
            _resize(photo[rows, columns], new_size, cv2.INTER_AREA).astype(np.uint8),
            _resize(labels, new_size, cv2.INTER_NEAREST).astype(np.uint16),
            number,
            columns.start,
            rows.start,
            scale,
        )

    def to_photo(self, points: F64) -> F64:
        """Return points (..., 2) x, y of the view in px of the photo."""
        corner = np.array([self.left, self.top], np.float64)
        return np.asarray((points + 0.5) / self.scale - 0.5 + corner)


@dataclass(frozen=True)
class _Ribbon:
    """Pixels beside an outline of n points, along their normals.

    Offsets of the first axis go along the outline, those of the second axis outwards.
    """

    outline: F64
    """(n, 2) x, y px of the view."""
    normals: F64
    """(n, 2) unit, outwards."""
    size: float
    """Root of the object's area, px."""
    half_width: int
    """px: half the width of the searched part."""
    colours: Rgb
    """(n, k, 3) of the searched part and the compared pixels beside it."""
    own_mask: Mask
    """(n, k) pixels of the object."""
    ground_mask: Mask
    """(n, k) pixels outside all objects."""
    rim_points: Mask
    """(n,) points of the lower rim."""

    @staticmethod
    def create(view: _View) -> _Ribbon | None:
        """Return the ribbon of a view; None without an outline."""
        mask = view.labels == view.number
        size = view.size
        outline = _smooth_outline(mask, max(1.0, RIMS.smoothing * size))
        if outline is None:
            return None
        normals = _outer_normals(outline, max(2.0, 2 * RIMS.smoothing * size))
        half_width = max(3, round(RIMS.band * size))
        reach = half_width + max(3, round(RIMS.compared_width * size))
        places = _places(outline, normals, np.arange(-reach, reach + 1))
        colours = _sample(view.photo, places, cv2.INTER_LINEAR)
        labels = _sample(view.labels.astype(np.float32), places, cv2.INTER_NEAREST)
        own_mask = labels == view.number
        ground_mask = labels == 0
        columns = slice(reach - half_width, reach + half_width + 1)
        is_other = ~(own_mask | ground_mask)[:, columns]
        is_contact = _near(is_other.any(axis=1), max(3, round(RIMS.margin * size)))
        return _Ribbon(
            outline=outline,
            normals=normals,
            size=size,
            half_width=half_width,
            colours=np.asarray(colours, np.uint8),
            own_mask=np.asarray(own_mask),
            ground_mask=np.asarray(ground_mask),
            rim_points=np.asarray(_faces_down(outline, normals) & ~is_contact),
        )

    @property
    def searched(self) -> slice:
        """Return the columns of the searched part."""
        middle = self.colours.shape[1] // 2
        return slice(middle - self.half_width, middle + self.half_width + 1)

    @property
    def offsets(self) -> Ints:
        """Return the offsets (m,) of the searched part, px."""
        return np.arange(-self.half_width, self.half_width + 1)

    @property
    def mask_offsets(self) -> F64:
        """Return the offsets (n,) of the mask's border, px."""
        count = np.count_nonzero(self.own_mask[:, self.searched], axis=1)
        return np.asarray(count - self.half_width - 0.5, np.float64)

    def evidence(self, network: F64) -> F64:
        """Return the evidence (n, m) for ground.

        `network` (n, m) is the logarithm of the odds of the object.
        """
        lit_evidence, shade_evidence = self._colour_evidence
        lit_evidence = np.clip(lit_evidence, -RIMS.lit_limit, RIMS.lit_limit)
        shade_evidence = np.clip(shade_evidence, -RIMS.lit_limit, RIMS.shade_limit)
        colour = np.maximum(lit_evidence, shade_evidence)
        return np.asarray(RIMS.colour * colour - RIMS.network * network)

    @cached_property
    def _colour_evidence(self) -> tuple[F64, F64]:
        """Return log(likelihood of lit ground / likelihood of the object), (n, m), and
        the same of shaded or lit ground.
        """
        count = len(self.outline)
        half_length = RIMS.stretch * self.size
        cells = self._cells()
        sums = np.zeros((2, *cells.shape))
        total = np.full((count, 1), np.finfo(np.float64).tiny)
        middles = np.arange(0, count, max(1, half_length / 2))
        for middle in middles.tolist():
            distance = np.abs(np.arange(count) - middle)
            distance = np.minimum(distance, count - distance)
            rows = np.flatnonzero(distance < half_length)
            ratios = None
            if self.rim_points[rows].any():
                ratios = self._ratios(rows)
            if ratios is None:
                continue
            weight = 1 - distance[rows, None] / half_length
            for kind in (0, 1):
                sums[kind, rows] += weight * ratios[kind][cells[rows]]
            total[rows] += weight
        return sums[0] / total, sums[1] / total

    def _cells(self) -> Ints:
        """Return the cell of the colour space (n, m) of each searched pixel."""
        return _colour_cells(self.colours[:, self.searched])

    def _ratios(self, rows: Ints) -> tuple[F64, F64] | None:
        """Return log(likelihood of the ground / likelihood of the object) by cell, of
        lit and of lit or shaded ground in some rows.

        None without enough pixels.
        """
        columns = np.arange(self.colours.shape[1])
        middle = len(columns) // 2
        distance = np.abs(columns - middle)
        weights = np.clip((distance - 1) / self.half_width, 0, 1) * RIMS.inner_weight
        weights[distance > self.half_width] = 1
        own_pixels = self.own_mask[rows] & (columns < middle - 1)
        ground_pixels = self.ground_mask[rows] & (columns > middle + 1)
        if (
            min(np.count_nonzero(own_pixels), np.count_nonzero(ground_pixels))
            < RIMS.sample
        ):
            return None
        weights = np.broadcast_to(weights, own_pixels.shape)
        colours = self.colours[rows]
        own_likelihood = _likelihoods(
            colours[own_pixels], weights[own_pixels], ((1.0, 1.0),)
        )
        ratios = []
        for shades in (((1.0, 1.0),), RIMS.shades):
            likelihood = _likelihoods(
                colours[ground_pixels], weights[ground_pixels], shades
            )
            ratios.append(
                np.log((likelihood + RIMS.floor) / (own_likelihood + RIMS.floor))
            )
        return ratios[0], ratios[1]

    def edges(self) -> F64:
        """Return the clearness (n, m), 0..1, of edges along the outline."""
        smooth_colours = cv2.GaussianBlur(
            self.colours.astype(np.float32), (5, 9), sigmaX=0.8, sigmaY=1.5
        )
        slope = np.abs(smooth_colours[:, 2:] - smooth_colours[:, :-2]).max(axis=2)
        slope = np.pad(slope, ((0, 0), (1, 1)))
        far_ground = self.ground_mask.copy()
        far_ground[:, : self.searched.stop] = False
        reach = round(RIMS.stretch * self.size)
        total = _ring_sums(np.where(far_ground, slope, 0).sum(axis=1), reach)
        count = _ring_sums(far_ground.sum(axis=1).astype(np.float64), reach)
        texture = total / np.maximum(count, 1)
        clearness = slope[:, self.searched] / (
            RIMS.texture * texture[:, None] + RIMS.noise
        )
        return np.asarray(np.minimum(clearness / 2, 1), np.float64)

    def best_offsets(self, evidence: F64) -> F64:
        """Return the offsets (n,) of the shortest path along the ribbon, px.

        `evidence` (n, m) is the evidence for ground.
        """
        costs = evidence * (RIMS.side * RIMS.band / self.half_width)
        costs = np.cumsum(costs, axis=1) - costs / 2
        costs -= RIMS.edge * self.edges()
        distance = np.abs(self.offsets - self.mask_offsets[:, None])
        costs += RIMS.shift_cost * (RIMS.side * RIMS.band / self.half_width) * distance
        # Elsewhere the path is the outline itself.
        other_costs = np.where(self.offsets == 0, 0.0, np.inf)
        costs = np.where(self.rim_points[:, None], costs, other_costs)
        start = int(np.argmin(self.rim_points))
        path = _shortest_path(np.roll(costs, -start, axis=0))
        offsets = np.roll(path, start).astype(np.float64) - self.half_width
        return self._fill_notches(offsets)

    def _fill_notches(self, offsets: F64) -> F64:
        """Return the offsets (n,) of a border, px, without notches that the mask lacks
        and that have the colours of the object.
        """
        reach = max(1, round(RIMS.notch * self.size / 2))
        filled_offsets = _close_ring(offsets, reach)
        # A notch of the mask itself stays: the border moves back to the mask at most.
        filled_offsets = np.minimum(
            filled_offsets, np.maximum(offsets, self.mask_offsets)
        )
        depths = np.where(self.rim_points, filled_offsets - offsets, 0)
        in_notch = self.offsets > offsets[:, None]
        in_notch &= self.offsets <= filled_offsets[:, None]
        # A notch with the colours of the lit ground is a gap between feet. Flanks of a
        # notch are shallow, so that a notch is judged and filled as a whole.
        lit_evidence, _ = self._colour_evidence
        evidence = np.where(in_notch, lit_evidence, 0).sum(axis=1)
        notches = _label_runs(depths > RIMS.shift)
        count = notches.max(initial=0) + 1
        largest_depths = np.zeros(count)
        np.maximum.at(largest_depths, notches, depths)
        is_filled = largest_depths > RIMS.notch_depth * self.size
        is_filled &= np.bincount(notches, evidence, count) < 0
        is_filled[0] = False
        return np.where(is_filled[notches], filled_offsets, offsets)

    def clearer_points(self, offsets: F64) -> Mask:
        """Return the points (n,) with a moved border whose edges became clearer.

        `offsets` (n,) px are those of the border. Stretches move or stay as a whole.
        """
        moved_points = np.abs(offsets - self.mask_offsets) > RIMS.shift
        moved_points &= self.rim_points
        edges = self.edges()
        points = np.arange(len(offsets))
        largest = edges.shape[1] - 1
        new_columns = np.clip(np.rint(offsets + self.half_width), 0, largest)
        old_columns = np.clip(np.rint(self.mask_offsets + self.half_width), 0, largest)
        gains = (
            edges[points, new_columns.astype(np.intp)]
            - edges[points, old_columns.astype(np.intp)]
        )
        is_start = moved_points & ~np.concatenate([[False], moved_points[:-1]])
        stretches = np.cumsum(is_start) * moved_points
        totals = np.bincount(stretches, gains)
        is_clearer = totals >= 0
        is_clearer[0] = False
        return np.asarray(is_clearer[stretches])


def _smooth_outline(mask: Mask, sigma: float) -> F64 | None:
    """Return points (n, 2) at distances of 1 px along the largest outline of a mask."""
    blurred_mask = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), sigma)
    contours, _ = cv2.findContours(
        (blurred_mask >= 0.5).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    if not contours:
        return None
    points = max(contours, key=cv2.contourArea)[:, 0].astype(np.float64)
    ring = np.concatenate([points, points[:1]])
    steps = np.hypot(*np.diff(ring, axis=0).T)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    count = int(length[-1])
    if count < RIMS.sample:
        return None
    positions = np.arange(count) * length[-1] / count
    x = np.interp(positions, length, ring[:, 0])
    y = np.interp(positions, length, ring[:, 1])
    return _blur_ring(np.stack([x, y], axis=1), sigma)


def _outer_normals(outline: F64, sigma: float) -> F64:
    """Return the outward unit normals (n, 2) of a closed outline (n, 2)."""
    tangents = np.roll(outline, -2, axis=0) - np.roll(outline, 2, axis=0)
    tangents = _blur_ring(tangents, sigma)
    normals = np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
    x, y = outline.T
    area = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    return np.asarray(normals if area > 0 else -normals)


def _faces_down(outline: F64, normals: F64) -> Mask:
    """Return the points (n,) of the lower part of an outline that face the ground."""
    y = outline[:, 1]
    highest = y.max() - RIMS.lower_share * np.ptp(y)
    return np.asarray((normals[:, 1] > 0) & (y > highest))


def _places(outline: F64, normals: F64, offsets: Ints) -> F64:
    """Return the points (n, k, 2) at `offsets` (k,) px along the normals."""
    return np.asarray(outline[:, None] + offsets[:, None] * normals[:, None])


def _sample(image: Rgb | F32, places: F64, interpolation: int) -> F32:
    """Return an image at points (n, k, 2) x, y px; places outside are -1 or black."""
    x, y = np.moveaxis(places.astype(np.float32), -1, 0)
    values = cv2.remap(
        image,
        x,
        y,
        interpolation,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(-1.0,),
    )
    return np.asarray(values, np.float32)


def _sample_chances(
    chances: F32, box: tuple[int, int, int, int], ribbon: _Ribbon, view: _View
) -> F64:
    """Return the logarithm of the odds (n, m) of the object in a ribbon.

    `box` (left, top, right, bottom px of the photo) is that of the map `chances`.
    """
    places = view.to_photo(_places(ribbon.outline, ribbon.normals, ribbon.offsets))
    left, top, right, bottom = box
    extent = np.array([right - left, bottom - top])
    cells = (places + 0.5 - np.array([left, top])) / extent
    cells = cells * np.array(chances.shape[::-1]) - 0.5
    x, y = np.moveaxis(cells.astype(np.float32), -1, 0)
    object_odds = cv2.remap(chances, x, y, cv2.INTER_LINEAR)
    object_odds = np.clip(object_odds, RIMS.chance, 1 - RIMS.chance).astype(np.float64)
    return np.asarray(np.log(object_odds / (1 - object_odds)))


def _sample_mask(mask: Mask, ribbon: _Ribbon, view: _View) -> Mask:
    """Return a mask (H, W) of the photo in the searched part (n, m) of a ribbon."""
    places = view.to_photo(_places(ribbon.outline, ribbon.normals, ribbon.offsets))
    values = _sample(mask.astype(np.float32), places, cv2.INTER_NEAREST)
    return np.asarray(values > 0.5)


def _colour_cells(colours: Rgb) -> Ints:
    """Return the cells of the colour space (...) of colours (..., 3)."""
    levels = colours.astype(np.intp) * RIMS.bins // 256
    return np.asarray(
        (levels[..., 0] * RIMS.bins + levels[..., 1]) * RIMS.bins + levels[..., 2]
    )


def _likelihoods(
    colours: Rgb, weights: F64, shades: tuple[tuple[float, float], ...]
) -> F64:
    """Return the frequency of each cell of the colour space, with a blur of one cell.

    The colours (n, 3) appear in several shades, each with its brightness and frequency.
    """
    counts = np.zeros(RIMS.bins**3)
    for brightness, frequency in shades:
        cells = _colour_cells(np.asarray(colours * brightness, np.uint8))
        counts += frequency * np.bincount(cells, weights, len(counts))
    cube = counts.reshape((RIMS.bins,) * 3)
    for axis in range(3):
        padded_values = np.pad(np.moveaxis(cube, axis, 0), ((1, 1), (0, 0), (0, 0)))
        mean = padded_values[1:-1] / 2 + (padded_values[:-2] + padded_values[2:]) / 4
        cube = np.moveaxis(mean, 0, axis)
    return np.asarray(cube.ravel() / cube.sum())


def _blur_ring(values: F64, sigma: float) -> F64:
    """Return values (n, k) along a closed outline with a Gaussian blur."""
    reach = min(round(3 * sigma) + 1, len(values))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    weights /= weights.sum()
    padded_values = np.concatenate([values[-reach:], values, values[:reach]])
    columns = []
    for column in padded_values.T:
        columns.append(np.convolve(column, weights, "valid"))
    return np.stack(columns, axis=1)


def _ring_sums(values: F64, reach: int) -> F64:
    """Return the sums (n,) of values along a closed outline within `reach` points."""
    reach = min(reach, len(values) // 2)
    padded_values = np.concatenate([values[-reach:], values, values[:reach]])
    return np.convolve(padded_values, np.ones(2 * reach + 1), "valid")


def _close_ring(values: F64, reach: int) -> F64:
    """Return the closing of values (n,) along a closed outline: minima of at most
    `2 * reach` points are filled.
    """
    reach = min(reach, len(values) // 4)
    margin = 2 * reach
    padded_values = np.concatenate([values[-margin:], values, values[:margin]])
    kernel = np.ones((1, 2 * reach + 1), np.uint8)
    row = padded_values[None].astype(np.float32)
    closed_row = cv2.morphologyEx(row, cv2.MORPH_CLOSE, kernel)[0]
    return np.asarray(closed_row[margin : margin + len(values)], np.float64)


def _label_runs(flags: Mask) -> Ints:
    """Return ids (n,) of the runs of flags along a closed outline; 0 elsewhere."""
    ids = np.cumsum(flags & ~np.roll(flags, 1))
    # The run through the first point may have begun before the last one.
    ids[ids == 0] = max(int(ids[-1]), 1)
    return np.asarray(ids * flags)


def _near(flags: Mask, reach: int) -> Mask:
    """Return the points (n,) of a closed outline within `reach` points of a flag."""
    return np.asarray(_ring_sums(flags.astype(np.float64), reach) > 0.5)


def _shortest_path(costs: F64) -> Ints:
    """Return the column (n,) of each row of the cheapest path through `costs` (n, m)."""
    rows, columns = costs.shape
    reach = RIMS.slope
    steps = np.arange(-reach, reach + 1)
    bend_costs = RIMS.bend_cost * np.abs(steps)[:, None]
    neighbours = np.arange(columns) + np.arange(len(steps))[:, None]
    step_choice = np.zeros((rows, columns), np.intp)
    total = costs[0]
    for row in range(1, rows):
        padded_values = np.pad(total, reach, constant_values=np.inf)
        candidates = padded_values[neighbours] + bend_costs
        choice = candidates.argmin(axis=0)
        step_choice[row] = steps[choice]
        total = candidates[choice, np.arange(columns)] + costs[row]
    path = np.zeros(rows, np.intp)
    path[-1] = total.argmin()
    for row in range(rows - 1, 0, -1):
        path[row - 1] = path[row] + step_choice[row, path[row]]
    return path


def _move_rim(
    labels: Labels, number: int, ribbon: _Ribbon, view: _View, offsets: F64
) -> None:
    """Move the border of an object in `labels` (H, W) to `offsets` (n,) px."""
    margin = max(2, round(RIMS.margin * ribbon.size))
    moved_points = _near(ribbon.clearer_points(offsets), margin) & ribbon.rim_points
    starts = np.flatnonzero(moved_points & np.roll(moved_points, -1))
    if not len(starts):
        return
    smooth_offsets = _blur_ring(offsets[:, None], RIMS.shift)
    border = view.to_photo(ribbon.outline + smooth_offsets * ribbon.normals)
    inside_mask = _fill(labels.shape, [border])
    reach = ribbon.half_width + 2
    inner_points = view.to_photo(ribbon.outline - reach * ribbon.normals)
    outer_points = view.to_photo(ribbon.outline + reach * ribbon.normals)
    ends = (starts + 1) % len(offsets)
    cells = np.stack(
        [
            inner_points[starts],
            inner_points[ends],
            outer_points[ends],
            outer_points[starts],
        ],
        axis=1,
    )
    zone = _fill(labels.shape, list(cells))
    labels[zone & ~inside_mask & (labels == number)] = 0
    labels[zone & inside_mask & (labels == 0)] = number


FRACTION_BITS = 4
"""Binary digits of a pixel in coordinates of polygons."""


def _fill(shape: tuple[int, ...], polygons: list[F64]) -> Mask:
    """Return the pixels (H, W) inside polygons of points (n, 2) x, y px."""
    result = np.zeros(shape, np.uint8)
    for points in polygons:
        corners = np.rint(points * 2**FRACTION_BITS).astype(np.int32)
        cv2.fillPoly(result, [corners], (1,), shift=FRACTION_BITS)
    return np.asarray(result > 0)
