"""Points that close together -> impulses: Newton's elasticity, Coulomb's friction, no pull, no gain of energy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SWEEPS, FEW = 300, 30
"""Passes over points that close together, at most; few in a heap of hundreds."""


def single(
    nn: float, nt: float, tt: float, elasticity: float, mu: float, vn: float, vt: float
) -> tuple[float, float]:
    """Impulse of a lone point in closed form: sticking where friction can hold, else sliding; no gain of energy.

    nn, nt, tt: changes of closing and sliding speed by a unit of impulse, normal and along the surface; vn (negative:
    closing), vt: the speeds.
    """
    target = -(1 + elasticity) * vn
    if mu == 0:
        return target / nn, 0.0
    det = nn * tt - nt * nt
    jn, jt = (target * tt + nt * vt) / det, (-nt * target - nn * vt) / det
    if jn <= 0 or abs(jt) > mu * jn:
        side = (1.0 if jt > 0 else -1.0) if jt else (-1.0 if vt > 0 else 1.0)
        grip = nn + side * mu * nt
        if grip < 1e-9 * nn:  # it would wedge
            return target / nn, 0.0
        jn = target / grip
        jt = side * mu * jn
    gain = jn * (2 * vn + nn * jn + nt * jt) + jt * (2 * vt + tt * jt + nt * jn)
    if gain > 1e-12 * abs(jn * vn):
        return target / nn, 0.0
    return jn, jt


def cone(matrix: Array, before: Array, elasticity: list[float], friction: list[float], exact: float) -> Array:
    """Impulses (2P,), normal and along the surface in turn, of points that close together.

    matrix (2P, 2P) gives the changes of their speeds; before (2P,) the speeds; exact: the relative change of an impulse
    at which they count as found. Newton's rule with friction can make energy (Kane and Levinson 1985): then as much of
    the bounce as makes none.
    """
    full = _swept(matrix, before, elasticity, friction, exact)
    if not any(elasticity) or _gain(matrix, before, full) <= 0:
        return full
    dead = _swept(matrix, before, [0.0] * len(elasticity), friction, exact)
    part, step = 0.0, 0.5
    for _ in range(30):
        if _gain(matrix, before, dead + (part + step) * (full - dead)) <= 0:
            part += step
        step /= 2
    return dead + part * (full - dead)


def _gain(matrix: Array, before: Array, impulse: Array) -> float:
    """Kinetic energy that impulses add, g·px²/s²; 0 within rounding."""
    change = impulse * (before + matrix @ impulse / 2)
    gain = float(change.sum())
    return gain if gain > 1e-9 * float(np.abs(change).sum()) else 0.0


def _swept(
    matrix: Array, before: Array, elasticity: list[float], friction: list[float], exact: float
) -> Array:
    """Projected Gauss-Seidel to the last digits: no pull, the wanted rebound, friction within its cone."""
    speed, impulse = before.copy(), [0.0] * len(before)
    columns = np.ascontiguousarray(matrix.T)
    give = [1.0 / max(float(d), 1e-300) for d in np.diag(matrix)]
    goals = [-e * min(float(v), 0.0) for e, v in zip(elasticity, before[::2], strict=True)]
    for _ in range(SWEEPS if exact < 1e-6 else FEW):
        change = size = 0.0
        for i, (goal, mu) in enumerate(zip(goals, friction, strict=True)):
            n, t = 2 * i, 2 * i + 1
            new = max(0.0, impulse[n] + (goal - float(speed[n])) * give[n])
            step = new - impulse[n]
            if step:
                speed += step * columns[n]
                impulse[n] = new
            change, size = max(change, abs(step)), max(size, new)
            if mu > 0:
                edge = mu * new
                new = min(edge, max(-edge, impulse[t] - float(speed[t]) * give[t]))
                step = new - impulse[t]
                if step:
                    speed += step * columns[t]
                    impulse[t] = new
                change = max(change, abs(step))
        if change <= exact * size:
            break
    return np.array(impulse)
