"""Forces that only push between many things -> what they leave unbalanced.

A primal-dual interior point method with Mehrotra's predictor and corrector (Wright 1997, Primal-dual interior-point
methods). Things are taken in layers, each of which touches only the next, so that every system is block tridiagonal.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Array

Indices = NDArray[np.int64]

PASSES = 60
ENOUGH = 1e-7
"""Of complementarity, and of the gradient: far below what counts as unbalanced."""
LOST = 1e3
"""Times the least error so far: rounding has taken over."""
SHORT = 0.99
"""Of the way to the border of what is allowed."""


def unbalanced(pairs: Indices, parts: Array, wanted: Array) -> Array:
    """(N, 3): `wanted` (N, 3) minus matrix x, for the x >= 0 that makes it least.

    Each column of the matrix holds `parts` (M, 2, 3) at two of the N things, `pairs` (M, 2); -1 is none of them.
    """
    count = len(wanted)
    if not len(pairs):
        return wanted
    spread = 3 * np.where(pairs < 0, count, pairs)[:, :, None] + np.arange(3)
    system = _System(count, pairs, parts)

    def times(x: Array) -> Array:
        weighed = (parts * x[:, None, None]).ravel()
        return np.asarray(np.bincount(spread.ravel(), weighed, 3 * count + 3)[:-3], np.float64)

    def turned(y: Array) -> Array:
        return np.asarray((parts * np.append(y, np.zeros(3))[spread]).sum((1, 2)))

    def towards(right: Array) -> Array:
        way = scale * (right - turned(system.solve(times(scale * right))))
        # what large weights round off
        off = right - turned(times(way)) - way / scale
        return way + scale * (off - turned(system.solve(times(scale * off))))

    x, s = np.ones(len(pairs)), np.ones(len(pairs))
    best = left = wanted.ravel() - times(x)
    least = np.inf
    for _ in range(PASSES):
        slope, gap = -turned(left) - s, float((x * s).mean())
        error = max(gap, float(np.abs(slope).max()))
        if error < least:
            best, least = left, error
        if least < ENOUGH or error > LOST * least:
            break
        scale = x / s
        system.weigh(scale)
        dx = towards(-slope - s)
        ds = -s - dx / scale
        a, b = _far(x, dx), _far(s, ds)
        middle = gap * (float(((x + a * dx) * (s + b * ds)).mean()) / gap) ** 3
        right = middle - x * s - a * b * dx * ds
        dx = towards(-slope + right / x)
        ds = (right - s * dx) / x
        # one step for both: the gradient depends on x as well
        step = min(1.0, SHORT * min(_far(x, dx), _far(s, ds)))
        x, s = x + step * dx, s + step * ds
        left = wanted.ravel() - times(x)
    return best.reshape(-1, 3)


def _far(x: Array, way: Array) -> float:
    """How much of a way can be gone before some of x turns negative; 1 at most."""
    down = way < 0
    return min(1.0, float((-x[down] / way[down]).min())) if down.any() else 1.0


class _System:
    """I + matrix diag(weights) matrix^T, factored layer by layer."""

    def __init__(self, count: int, pairs: Indices, parts: Array) -> None:
        self.count = count
        layers = _layers(count, pairs)
        self.ends = np.cumsum([0, *map(len, layers)]) * 3
        order = np.concatenate(layers)
        place = np.empty(count + 1, np.int64)
        place[order], place[count] = np.arange(count), count
        rows = (3 * place[np.where(pairs < 0, count, pairs)][:, :, None] + np.arange(3)).reshape(-1, 6)
        self.rows = (3 * order[:, None] + np.arange(3)).ravel()
        flat = parts.reshape(-1, 6)
        size = 3 * count + 3
        one, other = np.broadcast_arrays(rows[:, :, None], rows[:, None, :])
        self.at, self.entry = np.unique((one * size + other).ravel(), return_inverse=True)
        self.products = (flat[:, :, None] * flat[:, None, :]).reshape(-1, 36)

    def weigh(self, weights: Array) -> None:
        values = np.bincount(self.entry.ravel(), (self.products * weights[:, None]).ravel(), len(self.at))
        size = 3 * self.count + 3
        whole = np.zeros(size * size)
        whole[self.at] = values
        matrix = whole.reshape(size, size)[:-3, :-3]
        matrix[np.diag_indices(3 * self.count)] += 1
        self.steps: list[tuple[Array, Array]] = []
        """Of each layer the inverse of what is left of its block, and its block beside the next layer."""
        ends = self.ends.tolist()
        left = matrix[: ends[1], : ends[1]]
        for k in range(len(ends) - 1):
            inverse = np.asarray(np.linalg.inv(left), np.float64)
            if k == len(ends) - 2:
                self.steps.append((inverse, np.zeros((len(inverse), 0))))
                break
            here, after = slice(ends[k], ends[k + 1]), slice(ends[k + 1], ends[k + 2])
            beside = matrix[here, after]
            self.steps.append((inverse, beside))
            left = matrix[after, after] - beside.T @ inverse @ beside

    def solve(self, right: Array) -> Array:
        parts = np.split(right[self.rows], self.ends[1:-1].tolist())
        for k, (inverse, beside) in enumerate(self.steps[:-1]):
            parts[k + 1] = parts[k + 1] - beside.T @ (inverse @ parts[k])
        parts[-1] = self.steps[-1][0] @ parts[-1]
        for k in range(len(parts) - 2, -1, -1):
            inverse, beside = self.steps[k]
            parts[k] = inverse @ (parts[k] - beside @ parts[k + 1])
        result = np.empty(len(right))
        result[self.rows] = np.concatenate(parts)
        return result


def _layers(count: int, pairs: Indices) -> list[Indices]:
    """Things by how many others lie between them and an end of their group: each touches the next layer only."""
    beside: list[set[int]] = [set() for _ in range(count)]
    for a, b in np.unique(pairs, axis=0).tolist():
        if a >= 0 and b >= 0:
            beside[a].add(b)
            beside[b].add(a)
    layers: list[Indices] = []
    left = set(range(count))
    while left:
        start = min(left)
        for _ in range(2):  # the last one found is at an end
            found = _outwards(start, beside)
            start = found[-1][0]
        layers += [np.array(layer, np.int64) for layer in found]
        left.difference_update(*found)
    return layers


def _outwards(start: int, beside: Sequence[set[int]]) -> list[list[int]]:
    seen = {start}
    layers = [[start]]
    while after := sorted({j for i in layers[-1] for j in beside[i]} - seen):
        seen.update(after)
        layers.append(after)
    return layers
