"""Circle fitting: one mask, or several circles together so that neighbours touch.

A single circle maximises the intersection over union with its mask; beyond the photo it is neither right nor wrong.
Circles of touching objects are then fitted together by damped Gauss-Newton least squares over all centres and radii:
each to its mask's border, contacts as stiff springs, hidden borders with little weight. Touching circles of about one
size share one radius, so a rack of billiard balls is a true lattice; radii are reduced by what overlap is left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Array, Disc, Region, cross

_GRID = 160
"""Larger masks are searched on a grid of about this many samples a side; the score is always taken at full size."""


def fit_circle(mask: NDArray[np.bool_], border: Array) -> tuple[Disc, float]:
    """The disc of highest IoU with a mask `(H, W)`, and that IoU; `border` `(n, 2)` px is the mask's contour.

    Starts from the circle of the mask's own area, and from a robust least-squares circle that a neighbour hiding a part
    of the mask does not pull; the better is refined by a pattern search.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    low = np.array([columns[0], rows[0]], dtype=np.float64)
    box = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    stride = max(1, max(box.shape) // _GRID)
    score = _Score(mask, stride)

    area = float(box.sum())
    j, i = np.nonzero(box)
    center = low + np.array([i.mean(), j.mean()])
    starts = [np.array([*center, sqrt(area / pi)]), robust_circle(border)]
    best = max(starts, key=score.iou)
    value = score.iou(best)
    if value > 0.7:
        step = max(0.04 * best[2], 0.5)
        while step > 0.02 * stride:
            trials = [best + step * move for move in _MOVES]
            values = [score.iou(trial) for trial in trials]
            k = int(np.argmax(values))
            if values[k] > value + 1e-9:
                best, value = trials[k], values[k]
            else:
                step /= 2
    if stride > 1:
        # the grid knows the circle to a share of its spacing only; a start may be better at full size
        full = _Score(mask, 1)
        best = max((best, *starts), key=full.iou)
        value = full.iou(best)
    return Disc(best[:2].copy(), float(best[2])), value


def robust_circle(points: Array) -> Array:
    """`(3,)` px: x, y, radius of the circle through most of the points: least squares (Kasa 1976), Tukey weights."""
    weight: Array = np.ones(len(points))
    circle = np.array([*points.mean(axis=0), 1.0])
    middle = points.mean(axis=0)
    p = points - middle
    for _ in range(12):
        design = np.column_stack([2 * p, np.ones(len(p))]) * weight[:, None]
        (x, y, c), *_rest = np.linalg.lstsq(
            design, (p * p).sum(axis=1) * weight, rcond=None
        )
        radius = sqrt(max(c + x * x + y * y, 1e-6))
        circle = np.array([x + middle[0], y + middle[1], radius])
        off = np.hypot(p[:, 0] - x, p[:, 1] - y) - radius
        scale = max(1.4826 * float(np.median(np.abs(off))), 0.25)
        weight = np.sqrt(np.clip(1 - (off / (4.7 * scale)) ** 2, 0, None)) + 1e-6
    return circle


_MOVES = np.array(
    [(x, y, 0) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y]
    + [(0, 0, 1), (0, 0, -1)],
    np.float64,
)
"""Pattern search: the neighbours of x, y on a grid, and a larger and a smaller radius."""


class _Score:
    """IoU of circles with one mask, on every `stride`-th pixel of the mask's surroundings within the photo."""

    def __init__(self, mask: NDArray[np.bool_], stride: int) -> None:
        height, width = mask.shape
        rows, columns = (
            np.flatnonzero(mask.any(axis=1)),
            np.flatnonzero(mask.any(axis=0)),
        )
        margin = max(rows[-1] - rows[0], columns[-1] - columns[0]) // 2 + 2
        top, bottom = max(rows[0] - margin, 0), min(rows[-1] + margin + 1, height)
        left, right = max(columns[0] - margin, 0), min(columns[-1] + margin + 1, width)
        part = np.asarray(mask[top:bottom, left:right], dtype=np.float32)
        if stride > 1:
            half = cv2.resize(
                part, None, fx=1 / stride, fy=1 / stride, interpolation=cv2.INTER_AREA
            )
            part = np.asarray(half, dtype=np.float32)
        self._mask = part
        self._area = float(part.sum())
        # centre of the first sample, and the samples' true spacing after rounding to whole samples
        self._dx, self._dy = (
            (right - left) / part.shape[1],
            (bottom - top) / part.shape[0],
        )
        self._x = (
            left - 0.5 + (np.arange(part.shape[1], dtype=np.float32) + 0.5) * self._dx
        )
        self._y = (
            top - 0.5 + (np.arange(part.shape[0], dtype=np.float32) + 0.5) * self._dy
        )

    def iou(self, circle: Array) -> float:
        x, y, radius = circle
        if radius <= 0:
            return 0.0
        off = np.sqrt((self._x[None, :] - x) ** 2 + (self._y[:, None] - y) ** 2)
        inside = np.clip((radius - off) / max(self._dx, self._dy) + 0.5, 0.0, 1.0)
        shared = float(np.minimum(inside, self._mask).sum())
        return shared / max(self._area + float(inside.sum()) - shared, 1e-9)


EQUAL = 0.06
"""Touching circles whose radii are within this share of their median are taken for one size."""

_SLACK = 1e-9
"""px that circles stay apart, for rounding."""


@dataclass(frozen=True, eq=False)
class RoughDisc:
    """A circle fitted alone, its mask's border `(n, 2)` px, and a weight `(n,)`: 1 free, less where hidden."""

    disc: Disc
    border: Array
    weight: Array


def fit_discs(
    rough: Sequence[RoughDisc],
    contacts: Sequence[tuple[int, int]],
    obstacles: Mapping[int, Sequence[tuple[Region, bool]]],
) -> list[Disc]:
    """Discs without overlap, close to the rough ones.

    `contacts`: pairs of discs that touch. `obstacles`: for a disc, the regions near it, and whether it touches them.
    """
    if not rough:
        return []
    problem = _Problem(rough, contacts, obstacles)
    state = problem.start()
    for stiffness in (1.0, 10.0, 100.0, 1e3, 1e4):
        state = problem.solve(state, stiffness)
    return problem.apart(state)


class _Problem:
    """State: x and y of all centres, then the radius of each group."""

    def __init__(
        self,
        rough: Sequence[RoughDisc],
        contacts: Sequence[tuple[int, int]],
        obstacles: Mapping[int, Sequence[tuple[Region, bool]]],
    ) -> None:
        self.rough = rough
        self.count = len(rough)
        self.group = _groups([float(r.disc.radius) for r in rough], contacts)
        touching = {(min(pair), max(pair)) for pair in contacts}
        self.pairs = _near([r.disc for r in rough])
        self.touching = np.array(
            [(int(i), int(j)) in touching for i, j in self.pairs], dtype=bool
        )
        self.obstacles = [
            (i, _edges(region), touches)
            for i, near in obstacles.items()
            for region, touches in near
        ]

    def start(self) -> Array:
        radii = np.array([r.disc.radius for r in self.rough])
        shared = [
            radii[self.group == g].mean() for g in range(int(self.group.max()) + 1)
        ]
        return np.concatenate(
            [np.array([r.disc.center for r in self.rough]).ravel(), shared]
        )

    def split(self, state: Array) -> tuple[Array, Array]:
        centers = state[: 2 * self.count].reshape(-1, 2)
        radii: Array = state[2 * self.count :][self.group]
        return centers, radii

    def solve(self, state: Array, stiffness: float) -> Array:
        for _ in range(30):
            normal, gradient = self.equations(state, stiffness)
            step = np.linalg.solve(normal + 1e-6 * np.eye(len(state)), -gradient)
            step *= min(1.0, 2.0 / max(float(np.abs(step).max()), 1e-12))
            state = state + step
            if float(np.abs(step).max()) < 1e-7:
                break
        return state

    def equations(self, state: Array, stiffness: float) -> tuple[Array, Array]:
        """Normal matrix and gradient of half the sum of squares."""
        size, first_radius = len(state), 2 * self.count
        normal, gradient = np.zeros((size, size)), np.zeros(size)
        centers, radii = self.split(state)

        def add(
            columns: list[int], jacobian: Array, residual: Array, weight: Array
        ) -> None:
            weighted = jacobian * weight[:, None]
            normal[np.ix_(columns, columns)] += weighted.T @ jacobian
            gradient[columns] += weighted.T @ residual

        for i, rough in enumerate(self.rough):
            away = rough.border - centers[i]
            length = np.maximum(np.hypot(*away.T), 1e-9)
            residual = length - radii[i]
            jacobian = np.column_stack([-away / length[:, None], -np.ones(len(away))])
            robust = 1.0 / np.maximum(np.abs(residual), 1.0)  # Huber, 1 px
            weight = rough.weight * robust / max(float(rough.weight.sum()), 1e-9)
            add(
                [2 * i, 2 * i + 1, first_radius + int(self.group[i])],
                jacobian,
                residual,
                weight,
            )
        for (i, j), touches in zip(self.pairs.tolist(), self.touching, strict=True):
            away = centers[j] - centers[i]
            length = max(float(np.hypot(*away)), 1e-9)
            gap = length - radii[i] - radii[j]
            if touches or gap < 0:
                u = away / length
                row = np.zeros(size)
                row[[2 * i, 2 * i + 1, 2 * j, 2 * j + 1]] = [-u[0], -u[1], u[0], u[1]]
                row[first_radius + int(self.group[i])] -= 1
                row[first_radius + int(self.group[j])] -= 1
                columns = np.flatnonzero(row).tolist()
                add(columns, row[None, columns], np.array([gap]), np.array([stiffness]))
        for i, edges, touches in self.obstacles:
            distance, u = _clearance(edges, centers[i])
            gap = distance - radii[i]
            if touches or gap < 0:
                columns = [2 * i, 2 * i + 1, first_radius + int(self.group[i])]
                add(
                    columns,
                    np.array([[u[0], u[1], -1.0]]),
                    np.array([gap]),
                    np.array([stiffness]),
                )
        return normal, gradient

    def apart(self, state: Array) -> list[Disc]:
        """Take back the radii until nothing overlaps."""
        centers, radii = self.split(state)
        radii = radii.copy()
        for i, edges, _ in self.obstacles:
            radii[i] = min(radii[i], _clearance(edges, centers[i])[0])
        if len(self.pairs):
            i, j = self.pairs.T
            length = np.hypot(*(centers[j] - centers[i]).T)
            for _ in range(200):
                excess = radii[i] + radii[j] - length
                worst = np.zeros(self.count)
                np.maximum.at(worst, i, excess / 2)
                np.maximum.at(worst, j, excess / 2)
                if float(worst.max()) <= _SLACK / 10:
                    break
                radii -= np.maximum(worst, 0)
        for group in range(int(self.group.max()) + 1):
            members = self.group == group
            if float(np.ptp(radii[members])) < 0.25:
                radii[members] = radii[members].min()
        radii = np.maximum(radii - _SLACK, 1e-3)
        return [
            Disc(center.copy(), float(radius))
            for center, radius in zip(centers, radii, strict=True)
        ]


def _groups(
    radii: list[float], contacts: Sequence[tuple[int, int]]
) -> NDArray[np.intp]:
    """The group of each disc: those that touch, directly or through others, and are of about one size."""
    root = list(range(len(radii)))

    def find(i: int) -> int:
        while root[i] != i:
            i = root[i]
        return i

    for i, j in contacts:
        root[find(j)] = find(i)
    group = np.arange(len(radii))
    for top in {find(i) for i in range(len(radii))}:
        members = [i for i in range(len(radii)) if find(i) == top]
        median = float(np.median([radii[i] for i in members]))
        alike = [i for i in members if abs(radii[i] - median) <= EQUAL * median]
        group[alike] = alike[0] if alike else group[alike]
    return np.unique(group, return_inverse=True)[1].astype(np.intp)


def _near(discs: Sequence[Disc]) -> NDArray[np.intp]:
    """Pairs `(m, 2)` of discs that could come to overlap while they are moved by a few px."""
    centers, radii = (
        np.array([d.center for d in discs]),
        np.array([d.radius for d in discs]),
    )
    length = np.hypot(*(centers[:, None] - centers[None]).transpose(2, 0, 1))
    near = length < 1.3 * (radii[:, None] + radii[None]) + 8
    i, j = np.nonzero(np.triu(near, 1))
    return np.column_stack([i, j]).astype(np.intp)


def _edges(region: Region) -> tuple[Array, Array]:
    rings = [points for points, _ in region.borders]
    return np.concatenate(rings), np.concatenate(
        [np.roll(points, -1, axis=0) for points in rings]
    )


def _clearance(edges: tuple[Array, Array], point: Array) -> tuple[float, Array]:
    """Distance px from a region to a point (negative inside) and its gradient `(2,)`."""
    start, end = edges
    along = end - start
    share = np.clip(
        ((point - start) * along).sum(1) / np.maximum((along * along).sum(1), 1e-300),
        0,
        1,
    )
    away = point - start - share[:, None] * along
    length = np.hypot(*away.T)
    k = int(np.argmin(length))
    below = (start[:, 1] <= point[1]) != (end[:, 1] <= point[1])
    side = cross(along, point - start) * np.where(end[:, 1] > start[:, 1], 1.0, -1.0)
    inside = int((below & (side > 0)).sum()) % 2 == 1
    sign = -1.0 if inside else 1.0
    return sign * float(length[k]), sign * away[k] / max(float(length[k]), 1e-12)
