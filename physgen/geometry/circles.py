"""Circle fitting: one mask, or several circles together such that neighbours touch.

A single circle maximises the intersection over union with its mask; pixels beyond the
photo do not count. Circles of touching objects are then fitted together by damped
Gauss-Newton least squares over all centres and radii: to the borders of their masks,
with contacts as stiff springs, and with little weight of hidden borders. Touching
circles of about one size share one radius, so that a rack of billiard balls is an exact
lattice; radii are reduced by the remaining overlap.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import Mask
from physgen.geometry.polygon import Array, Disc, Region, cross

_GRID = 160
"""Larger masks are searched on a grid of about this many samples a side; the score is
always taken at full size.
"""


def fit_circle(mask: Mask, border: Array) -> tuple[Disc, float]:
    """Fit the disc of highest IoU to a mask `(H, W)`; return it and the IoU.

    `border` `(n, 2)` px is the mask's contour. The search starts from the circle of the
    mask's area, and from a robust least-squares circle that is insensitive to a hidden
    part of the mask; the better one is refined by a pattern search.
    """
    rows = np.flatnonzero(mask.any(axis=1))
    columns = np.flatnonzero(mask.any(axis=0))
    low = np.array([columns[0], rows[0]], dtype=np.float64)
    row_span = slice(rows[0], rows[-1] + 1)
    column_span = slice(columns[0], columns[-1] + 1)
    box = mask[row_span, column_span]
    stride = max(1, max(box.shape) // _GRID)
    score = _Score(mask, stride)
    j, i = np.nonzero(box)
    center = low + np.array([i.mean(), j.mean()])
    radius = sqrt(float(box.sum()) / pi)
    starts = [np.array([*center, radius]), robust_circle(border)]
    best = _pattern_search(score, max(starts, key=score.iou), stride)
    if stride > 1:
        # The grid limits the accuracy to a share of its spacing: a start may be better
        # at full size.
        score = _Score(mask, 1)
        best = max((best, *starts), key=score.iou)
    return Disc(best[:2].copy(), float(best[2])), score.iou(best)


HOPELESS = 0.7
"""IoU below which a circle is not refined, since the mask is not a circle."""


def _pattern_search(score: _Score, circle: Array, stride: int) -> Array:
    """Refine a circle by steps along x, y and the radius that become smaller."""
    value = score.iou(circle)
    if value <= HOPELESS:
        return circle
    step = max(0.04 * circle[2], 0.5)
    while step > 0.02 * stride:
        trials = [circle + step * move for move in _MOVES]
        # Step to the best neighbour; without a better one, halve the step.
        values = list(map(score.iou, trials))
        best = int(np.argmax(values))
        if values[best] > value + 1e-9:
            circle = trials[best]
            value = values[best]
        else:
            step /= 2
    return circle


def robust_circle(points: Array) -> Array:
    """Fit the circle x, y, radius `(3,)` px through most of the points.

    Least squares (Kasa 1976) with Tukey weights.
    """
    weight: Array = np.ones(len(points))
    middle = points.mean(axis=0)
    circle = np.array([*middle, 1.0])
    # Coordinates about the mean keep the normal equations well conditioned.
    local = points - middle
    squares = (local * local).sum(axis=1)
    for _ in range(12):
        # Kasa's equation 2 x cx + 2 y cy + c = x² + y² is linear in the unknowns.
        design = np.column_stack([2 * local, np.ones(len(local))])
        design *= weight[:, None]
        solution, *_ = np.linalg.lstsq(design, squares * weight, rcond=None)
        x, y, c = solution
        radius = sqrt(max(c + x * x + y * y, 1e-6))
        circle = np.array([x + middle[0], y + middle[1], radius])
        error = np.hypot(local[:, 0] - x, local[:, 1] - y) - radius
        # Robust standard deviation of the errors from their median, at least a quarter
        # pixel.
        scale = max(1.4826 * float(np.median(np.abs(error))), 0.25)
        # Tukey's weights exclude points beyond 4.7 deviations, as of a stem
        # or a hand.
        share = 1 - (error / (4.7 * scale)) ** 2
        weight = np.sqrt(np.clip(share, 0, None)) + 1e-6
    return circle


_MOVES = np.array(
    [(x, y, 0) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y]
    + [(0, 0, 1), (0, 0, -1)],
    np.float64,
)
"""Pattern search: the neighbours of x, y on a grid, and a larger and a smaller
radius.
"""


class _Score:
    """IoU of circles with one mask, on every `stride`-th pixel of the mask's
    surroundings.
    """

    def __init__(self, mask: Mask, stride: int) -> None:
        height, width = mask.shape
        rows = np.flatnonzero(mask.any(axis=1))
        columns = np.flatnonzero(mask.any(axis=0))
        # A circle may extend beyond its mask by half the mask's size.
        margin = max(rows[-1] - rows[0], columns[-1] - columns[0]) // 2 + 2
        top = max(rows[0] - margin, 0)
        bottom = min(rows[-1] + margin + 1, height)
        left = max(columns[0] - margin, 0)
        right = min(columns[-1] + margin + 1, width)
        part = np.asarray(mask[top:bottom, left:right], dtype=np.float32)
        if stride > 1:
            reduced = cv2.resize(
                part, None, fx=1 / stride, fy=1 / stride, interpolation=cv2.INTER_AREA
            )
            part = np.asarray(reduced, dtype=np.float32)
        # The type of the circles' coverage: no conversion for each of many circles.
        self._mask = part.astype(np.float64)
        self._area = float(part.sum())
        # After rounding to whole samples, the spacing differs slightly from the stride.
        row_count, column_count = part.shape
        self._dx = (right - left) / column_count
        self._dy = (bottom - top) / row_count
        column_middles = np.arange(column_count, dtype=np.float32) + 0.5
        row_middles = np.arange(row_count, dtype=np.float32) + 0.5
        self._x = left - 0.5 + column_middles * self._dx
        self._y = top - 0.5 + row_middles * self._dy

    def iou(self, circle: Array) -> float:
        x, y, radius = circle
        if radius <= 0:
            return 0.0
        # In place, since large masks are compared with thousands of circles.
        dx = self._x[None, :] - x
        dy = self._y[:, None] - y
        inside = dx**2 + dy**2
        # The coverage of a pixel follows from the distance of its centre to
        # the circle.
        np.sqrt(inside, out=inside)
        np.subtract(radius, inside, out=inside)
        inside /= max(self._dx, self._dy)
        inside += 0.5
        np.clip(inside, 0.0, 1.0, out=inside)
        area = float(inside.sum())
        np.minimum(inside, self._mask, out=inside)
        shared_area = float(inside.sum())
        union = self._area + area - shared_area
        return shared_area / max(union, 1e-9)


EQUAL = 0.06
"""Relative difference of radii from their median within which touching circles have one
size.
"""

_SLACK = 1e-9
"""Distance between circles, for rounding, px."""


@dataclass(frozen=True, eq=False)
class RoughDisc:
    """A circle fitted alone, the border `(n, 2)` px of its mask, and weights `(n,)`.

    The weights are 1 for free parts of the border, and less for hidden ones.
    """

    disc: Disc
    border: Array
    weight: Array


def fit_discs(
    rough_discs: Sequence[RoughDisc],
    contacts: Sequence[tuple[int, int]],
    obstacles: Mapping[int, Sequence[tuple[Region, bool]]],
) -> list[Disc]:
    """Fit discs without overlap, close to the rough ones.

    `contacts`: pairs of touching discs. `obstacles`: for a disc, the regions near it,
    and whether it touches them.
    """
    if not rough_discs:
        return []
    problem = _Problem(rough_discs, contacts, obstacles)
    state = problem.start()
    # Stiffer and stiffer springs: with stiff ones from the start, the iteration would
    # not leave its start.
    for stiffness in (1.0, 10.0, 100.0, 1e3, 1e4):
        state = problem.solve(state, stiffness)
    return problem.apart(state)


class _Problem:
    """The least-squares problem; its state is x and y of all centres, then a radius per
    group.
    """

    def __init__(
        self,
        discs: Sequence[RoughDisc],
        contacts: Sequence[tuple[int, int]],
        obstacles: Mapping[int, Sequence[tuple[Region, bool]]],
    ) -> None:
        self.rough = discs
        self.count = len(discs)
        self.group = _groups([float(r.disc.radius) for r in discs], contacts)
        touching = {(min(pair), max(pair)) for pair in contacts}
        self.pairs = _neighbours_of([r.disc for r in discs])
        is_touching = [(int(i), int(j)) in touching for i, j in self.pairs]
        self.touching = np.array(is_touching, dtype=bool)
        self.obstacles = [
            (i, _edges(region), touches)
            for i, near in obstacles.items()
            for region, touches in near
        ]

    def start(self) -> Array:
        radii = np.array([r.disc.radius for r in self.rough])
        centers = np.array([r.disc.center for r in self.rough])
        shared_radii = []
        for g in range(int(self.group.max()) + 1):
            shared_radii.append(radii[self.group == g].mean())
        return np.concatenate([centers.ravel(), shared_radii])

    def split(self, state: Array) -> tuple[Array, Array]:
        centers = state[: 2 * self.count].reshape(-1, 2)
        radii: Array = state[2 * self.count :][self.group]
        return centers, radii

    def solve(self, state: Array, stiffness: float) -> Array:
        for _ in range(30):
            normal, gradient = self.equations(state, stiffness)
            # A small multiple of the identity keeps undetermined discs in place.
            damped_normal = normal + 1e-6 * np.eye(len(state))
            step = np.linalg.solve(damped_normal, -gradient)
            # Long steps would leave the region in which the equations are valid.
            largest_step = max(float(np.abs(step).max()), 1e-12)
            step *= min(1.0, 2.0 / largest_step)
            state = state + step
            if float(np.abs(step).max()) < 1e-7:
                break
        return state

    def equations(self, state: Array, stiffness: float) -> tuple[Array, Array]:
        """Return normal matrix and gradient of half the sum of squares."""
        size = len(state)
        system = _NormalEquations(np.zeros((size, size)), np.zeros(size))
        centers, radii = self.split(state)
        for i, rough in enumerate(self.rough):
            self._add_border(system, i, rough, centers[i], float(radii[i]))
        self._add_contacts(system, centers, radii, stiffness)
        self._add_obstacles(system, centers, radii, stiffness)
        return system.matrix, system.gradient

    def _add_contacts(
        self, system: _NormalEquations, centers: Array, radii: Array, stiffness: float
    ) -> None:
        """Add the gaps of pairs: both directions for discs that touch, and only overlap
        for others.
        """
        size = len(system.gradient)
        for (i, j), touches in zip(self.pairs.tolist(), self.touching, strict=True):
            offset = centers[j] - centers[i]
            length = max(float(np.hypot(*offset)), 1e-9)
            gap = length - radii[i] - radii[j]
            if touches or gap < 0:
                row = self._contact_row(size, i, j, offset / length)
                columns = np.flatnonzero(row).tolist()
                residual = np.array([gap])
                system.add(columns, row[None, columns], residual, np.array([stiffness]))

    def _add_obstacles(
        self, system: _NormalEquations, centers: Array, radii: Array, stiffness: float
    ) -> None:
        """Add the gaps between discs and fixed edges."""
        for i, edges, touches in self.obstacles:
            distance, direction = _clearance(edges, centers[i])
            gap = distance - radii[i]
            if touches or gap < 0:
                jacobian = np.array([[direction[0], direction[1], -1.0]])
                residual = np.array([gap])
                system.add(self._columns(i), jacobian, residual, np.array([stiffness]))

    def _columns(self, i: int) -> list[int]:
        """Return the columns of a disc's x, y and radius in the state."""
        return [2 * i, 2 * i + 1, 2 * self.count + int(self.group[i])]

    def _add_border(
        self,
        system: _NormalEquations,
        i: int,
        rough_disc: RoughDisc,
        center: Array,
        radius: float,
    ) -> None:
        """Add the distances of a mask's border from its circle."""
        offset = rough_disc.border - center
        length = np.maximum(np.hypot(*offset.T), 1e-9)
        residual = length - radius
        by_center = -offset / length[:, None]
        by_radius = -np.ones(len(offset))
        jacobian = np.column_stack([by_center, by_radius])
        # Huber's weights: residuals of over 1 px count only linearly.
        huber = 1.0 / np.maximum(np.abs(residual), 1.0)
        total_weight = max(float(rough_disc.weight.sum()), 1e-9)
        weight = rough_disc.weight * huber / total_weight
        system.add(self._columns(i), jacobian, residual, weight)

    def _contact_row(self, size: int, i: int, j: int, direction: Array) -> Array:
        """Return the derivatives of the gap between two discs."""
        x, y = direction
        row = np.zeros(size)
        row[[2 * i, 2 * i + 1]] = [-x, -y]
        row[[2 * j, 2 * j + 1]] = [x, y]
        for disc in (i, j):
            row[2 * self.count + int(self.group[disc])] -= 1
        return row

    def apart(self, state: Array) -> list[Disc]:
        """Reduce the radii until no discs overlap."""
        centers, radii = self.split(state)
        radii = radii.copy()
        for i, edges, _ in self.obstacles:
            radii[i] = min(radii[i], _clearance(edges, centers[i])[0])
        if len(self.pairs):
            self._separate_pairs(centers, radii)
        for group in range(int(self.group.max()) + 1):
            members = self.group == group
            if float(np.ptp(radii[members])) < 0.25:
                radii[members] = radii[members].min()
        radii = np.maximum(radii - _SLACK, 1e-3)
        pairs = zip(centers, radii, strict=True)
        return [Disc(center.copy(), float(radius)) for center, radius in pairs]

    def _separate_pairs(self, centers: Array, radii: Array) -> None:
        """Reduce `radii` (n,) in place until no two discs overlap."""
        i, j = self.pairs.T
        length = np.hypot(*(centers[j] - centers[i]).T)
        # Each round shares the overlap of a pair between both discs.
        for _ in range(200):
            excess = radii[i] + radii[j] - length
            largest = np.zeros(self.count)
            np.maximum.at(largest, i, excess / 2)
            np.maximum.at(largest, j, excess / 2)
            if float(largest.max()) <= _SLACK / 10:
                break
            radii -= np.maximum(largest, 0)


@dataclass(frozen=True)
class _NormalEquations:
    """Normal matrix (n, n) and gradient (n,), as sums over residuals."""

    matrix: Array
    gradient: Array

    def add(
        self, columns: list[int], jacobian: Array, residual: Array, weight: Array
    ) -> None:
        """Add residuals (k,) with their derivatives (k, columns) and weights (k,)."""
        weighted_jacobian = jacobian * weight[:, None]
        self.matrix[np.ix_(columns, columns)] += weighted_jacobian.T @ jacobian
        self.gradient[columns] += weighted_jacobian.T @ residual


def _groups(
    radii: list[float], contacts: Sequence[tuple[int, int]]
) -> NDArray[np.intp]:
    """Return the group of each disc: connected discs of about one size."""
    root = list(range(len(radii)))

    def find(i: int) -> int:
        while root[i] != i:
            i = root[i]
        return i

    # Join the groups of touching discs.
    for i, j in contacts:
        root[find(j)] = find(i)
    group = np.arange(len(radii))
    # Real balls of a set have one size; connected discs near their median share a
    # radius.
    tops = list(map(find, range(len(radii))))
    for top in set(tops):
        members = [i for i, own_top in enumerate(tops) if own_top == top]
        median = float(np.median([radii[i] for i in members]))
        equal = [i for i in members if abs(radii[i] - median) <= EQUAL * median]
        if equal:
            group[equal] = equal[0]
    return np.unique(group, return_inverse=True)[1].astype(np.intp)


def _neighbours_of(discs: Sequence[Disc]) -> NDArray[np.intp]:
    """Return pairs `(m, 2)` of discs that might overlap after moves by a few px."""
    # The pairs are found once, so that their list includes those that may meet
    # later.
    centers = np.array([disc.center for disc in discs])
    radii = np.array([disc.radius for disc in discs])
    x, y = (centers[:, None] - centers[None]).transpose(2, 0, 1)
    radius_sums = radii[:, None] + radii[None]
    is_neighbour = np.hypot(x, y) < 1.3 * radius_sums + 8
    i, j = np.nonzero(np.triu(is_neighbour, 1))
    return np.column_stack([i, j]).astype(np.intp)


def _edges(region: Region) -> tuple[Array, Array]:
    """Return the starts and the ends of a region's edges, (n, 2) px each."""
    rings = [points for points, _ in region.borders]
    ends = [np.roll(points, -1, axis=0) for points in rings]
    return np.concatenate(rings), np.concatenate(ends)


def _clearance(edges: tuple[Array, Array], point: Array) -> tuple[float, Array]:
    """Return the distance from a region to a point, px (negative inside), and its
    gradient.
    """
    start, end = edges
    edge = end - start
    length_squared = np.maximum((edge * edge).sum(1), 1e-300)
    projection = ((point - start) * edge).sum(1)
    share = np.clip(projection / length_squared, 0, 1)
    offset = point - start - share[:, None] * edge
    length = np.hypot(*offset.T)
    nearest = int(np.argmin(length))
    distance = float(length[nearest])
    direction = offset[nearest] / max(distance, 1e-12)
    if _is_inside(edges, point):
        return -distance, -direction
    return distance, direction


def _is_inside(edges: tuple[Array, Array], point: Array) -> bool:
    """Return whether a point is inside a region."""
    start, end = edges
    # A point is inside if its row crosses an odd number of edges on one side.
    start_rows = start[:, 1]
    end_rows = end[:, 1]
    crosses_row = (start_rows <= point[1]) != (end_rows <= point[1])
    downwards = np.where(end_rows > start_rows, 1.0, -1.0)
    side = cross(end - start, point - start) * downwards
    crossings = crosses_row & (side > 0)
    return int(crossings.sum()) % 2 == 1
