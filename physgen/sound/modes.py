"""Natural frequencies of bars, plates, shells, spheres and blocks, in Hz.

Sizes are in m, Young's modulus is in Pa and densities are in kg/m³.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product
from math import pi, sqrt

import numpy as np

from physgen.arrays import F64

BAR_ROOTS = (4.730041, 7.853205, 10.995608, 14.137165)
"""Roots of cosh(x) cos(x) = 1. Later roots equal (k + 1/2) pi to seven digits."""
SQUARE_TORSION = 0.92
"""Speed of torsional waves in a square bar over the speed of shear waves."""
PLATE_TERMS = 6
"""Number of powers of the radius in the Rayleigh-Ritz method: four digits of
each mode.
"""
PLATE_DIAMETERS = 6
"""Number of nodal diameters of a circular plate, from 0."""
SPHERE_ORDERS = (0, 2, 3, 4, 5, 6)
"""Orders of spheroidal modes. Order 1 moves the whole sphere at low frequencies."""
SPHERE_OVERTONES = 3
"""Number of modes of each order."""
ROOT_STEP = 0.02
"""Step of the search for roots of Lamb's equation. The distance of neighbours is
larger.
"""
ROOT_LIMIT = 12.0
"""Largest dimensionless frequency of the search."""
REFINEMENTS = 3
"""Number of refinements of a root's interval."""
GRID_POINTS = 33
"""Number of points of each refinement; three of them give ten digits."""
BESSEL_TERMS = 40
"""Number of terms of the power series. More terms change no digit up to x = 12."""
BEAM_ORDERS = 5
"""Number of orders of a rectangular plate's modes along each side."""
RING_ORDERS = range(2, 9)
"""Numbers of waves around a shell. With one wave, the shell moves as a whole."""
BLOCK_OVERTONES = 4
"""Number of modes of a block along each side."""


@dataclass(frozen=True)
class Elasticity:
    """Elastic constants of a solid."""

    young: float
    """Pa."""
    poisson: float
    density: float
    """kg/m³."""

    @property
    def bar_speed(self) -> float:
        """Return the speed of longitudinal waves in a thin bar, m/s."""
        return sqrt(self.young / self.density)

    @property
    def shear_speed(self) -> float:
        """Return the speed of shear waves, m/s."""
        return self.bar_speed / sqrt(2 * (1 + self.poisson))

    @property
    def plate_speed(self) -> float:
        """Return the speed of longitudinal waves in a thin plate, m/s."""
        return self.bar_speed / sqrt(1 - self.poisson**2)

    def bending_stiffness(self, thickness: float) -> float:
        """Return sqrt(D / (density thickness)) of a plate, m²/s."""
        return self.plate_speed * thickness / sqrt(12)


def bar_frequencies(
    solid: Elasticity, length: float, thickness: float, count: int
) -> F64:
    """Return the bending modes of a bar with free ends (Euler and Bernoulli).

    The ratios are 1 : 2.757 : 5.404 (Fletcher and Rossing, Physics of Musical
    Instruments, section 2.15).
    """
    roots = list(BAR_ROOTS[:count])
    for k in range(len(roots), count):
        roots.append((k + 1.5) * pi)
    # The frequency of bending waves grows with the squared wave number.
    wave_numbers = np.array(roots) / length
    stiffness = solid.bar_speed * thickness / sqrt(12)
    return np.asarray(wave_numbers**2 * stiffness / (2 * pi))


def long_bar_frequencies(solid: Elasticity, length: float, count: int) -> F64:
    """Return the longitudinal and torsional modes of a free bar: half waves along it.

    Fletcher and Rossing, sections 2.18 and 2.20. Torsional waves of a square section
    have 0.92 of the speed of shear waves.
    """
    halves = np.arange(1, count + 1) / (2 * length)
    torsion = SQUARE_TORSION * solid.shear_speed * halves
    return np.sort(np.concatenate([solid.bar_speed * halves, torsion]))


def disc_frequencies(
    solid: Elasticity, radius: float, thickness: float, count: int
) -> F64:
    """Return the lowest modes of a circular plate with a free rim."""
    roots = np.array(disc_roots(solid.poisson)[:count])
    stiffness = solid.bending_stiffness(thickness)
    return np.asarray(roots * stiffness / (2 * pi * radius**2))


@cache
def disc_roots(poisson: float) -> tuple[float, ...]:
    """Return omega radius² sqrt(density thickness / D) of a free disc, rising.

    The Rayleigh-Ritz method with powers of the radius. Leissa (Vibration of Plates,
    NASA SP-160, section 2.1.3) gives 5.253, 9.084, 12.23 for a Poisson's ratio of .33.
    """
    roots: list[float] = []
    for diameters in range(PLATE_DIAMETERS):
        roots += _disc_roots_of(diameters, poisson)
    return tuple(sorted(roots))


def _disc_roots_of(diameters: int, poisson: float) -> list[float]:
    """Return the roots of the modes with this number of nodal diameters, without rigid
    motions.
    """
    powers = diameters + 2.0 * np.arange(PLATE_TERMS)
    p = powers[:, None]
    q = powers[None, :]
    n = float(diameters)
    # Strain energy of the terms r^p and r^q with n nodal diameters, integrated over the
    # disc.
    laplacian = (p**2 - n**2) * (q**2 - n**2)
    bending = p * (p - 1) * (q - n**2) + q * (q - 1) * (p - n**2)
    twisting = 2 * n**2 * (p - 1) * (q - 1)
    energy = laplacian - (1 - poisson) * (bending - twisting)
    degree = p + q - 2
    # Rigid motions have no strain: their terms would divide by zero.
    strain = np.where(degree > 0, energy / np.maximum(degree, 1), 0.0)
    inertia = 1 / (p + q + 2)
    # Squared frequencies are the ratios of strain energy to kinetic energy.
    squares = np.linalg.eigvals(np.linalg.solve(inertia, strain)).real
    # Only the lower half of the Ritz values has converged.
    roots = np.sqrt(np.sort(squares[squares > 1.0]))
    converged: list[float] = roots[: PLATE_TERMS // 2].tolist()
    return converged


def plate_frequencies(
    solid: Elasticity, sides: tuple[float, float], thickness: float, count: int
) -> F64:
    """Return the lowest modes of a rectangular plate with free edges.

    Products of the modes of bars (Warburton, Proc. Inst. Mech. Eng. 168, 371, 1954).
    """
    length, width = sides
    ratio = length / width
    squares = []
    for m, n in product(range(BEAM_ORDERS), repeat=2):
        # Orders below 2 are rigid motions.
        if m + n < 2:
            continue
        (g, h, j), (other_g, other_h, other_j) = _beam_factors(m), _beam_factors(n)
        # Bending along one side couples to the other side by Poisson's ratio, and by
        # twisting.
        coupling = solid.poisson * h * other_h + (1 - solid.poisson) * j * other_j
        squares.append(g**4 + (other_g * ratio) ** 4 + 2 * ratio**2 * coupling)
    roots = np.sqrt(np.sort(squares))[:count]
    stiffness = solid.bending_stiffness(thickness)
    return np.asarray(roots * pi * stiffness / (2 * length**2))


def _beam_factors(order: int) -> tuple[float, float, float]:
    """Return Warburton's G, H and J of a free beam with this number of nodes."""
    if order == 0:
        return 0.0, 0.0, 0.0
    if order == 1:
        return 0.0, 0.0, 12 / pi**2
    if order == 2:
        return 1.506, 1.248, 5.017
    half = order - 0.5
    h = half**2 * (1 - 2 / (half * pi))
    j = half**2 * (1 + 6 / (half * pi))
    return half, h, j


def ring_frequencies(
    solid: Elasticity, radius: float, thickness: float, count: int
) -> F64:
    """Return the modes of the wall of a cup or cylinder with constant length.

    Rayleigh, Theory of Sound, section 233: waves around the wall.
    """
    n = np.array(RING_ORDERS[:count], np.float64)
    stiffness = solid.bending_stiffness(thickness) / radius**2
    return np.asarray(stiffness * n * (n**2 - 1) / np.sqrt(n**2 + 1) / (2 * pi))


def block_frequencies(
    solid: Elasticity, sides: tuple[float, float, float], count: int
) -> F64:
    """Return the shear and longitudinal modes of a block.

    Lamé's modes of a cube (Auld, Acoustic Fields and Waves, section 10.D) and the modes
    of a bar, along each side.
    """
    modes = []
    for side, k in product(sides, range(1, BLOCK_OVERTONES + 1)):
        # Lamé's modes, and then the longitudinal ones with half waves along the side.
        modes.append(k * solid.shear_speed / (sqrt(2) * side))
        modes.append(k * solid.bar_speed / (2 * side))
    return np.sort(np.array(modes))[:count]


def sphere_frequencies(solid: Elasticity, radius: float, count: int) -> F64:
    """Return the lowest spheroidal modes of a solid sphere (Lamb 1882)."""
    roots = np.array(sphere_roots(round(solid.poisson, 3))[:count])
    return np.asarray(roots * solid.shear_speed / (2 * pi * radius))


@cache
def sphere_roots(poisson: float) -> tuple[float, ...]:
    """Return omega radius / shear speed of the spheroidal modes of a free sphere,
    rising.

    Lamb, Proc. London Math. Soc. 13, 189, 1882; in the form of Eringen and Suhubi,
    Elastodynamics II, section 8.14.
    """
    roots: list[float] = []
    grid = np.arange(ROOT_STEP, ROOT_LIMIT, ROOT_STEP)
    for order in SPHERE_ORDERS:
        values = _lamb_determinant(grid, order, poisson)
        # Modes do not exist far below the order, and rounding gives changes of sign
        # there.
        is_change = (values[1:] * values[:-1] < 0) & (grid[1:] > order / 2)
        for index in np.flatnonzero(is_change)[:SPHERE_OVERTONES].tolist():
            low = float(grid[index])
            high = float(grid[index + 1])
            roots.append(_refine_root(low, high, order, poisson))
    return tuple(sorted(roots))


def _refine_root(low: float, high: float, order: int, poisson: float) -> float:
    """Return the root between two frequencies, from finer and finer grids and a linear
    interpolation.
    """
    for _ in range(REFINEMENTS):
        grid = np.linspace(low, high, GRID_POINTS)
        values = _lamb_determinant(grid, order, poisson)
        index = int(np.flatnonzero(values[1:] * values[:-1] <= 0)[0])
        low = float(grid[index])
        high = float(grid[index + 1])
    first = values[index]
    last = values[index + 1]
    return float(low + (high - low) * first / (first - last))


def _lamb_determinant(shear: F64, order: int, poisson: float) -> F64:
    """Return the determinant with zeros at the modes, for frequencies omega radius /
    shear speed.
    """
    n = float(order)
    ratio = sqrt((1 - 2 * poisson) / (2 - 2 * poisson))
    pressure = shear * ratio
    half = shear**2 / 2
    j_p = _bessel(order, pressure)
    next_p = _bessel(order + 1, pressure)
    j_s = _bessel(order, shear)
    next_s = _bessel(order + 1, shear)
    # A free surface has no radial and no tangential stress, of pressure and shear waves
    # together.
    radial_p = (n**2 - n - half) * j_p + 2 * pressure * next_p
    # Breathing modes (order 0) have no tangential motion.
    if order == 0:
        return np.asarray(radial_p)
    radial_s = n * (n + 1) * ((n - 1) * j_s - shear * next_s)
    tangential_p = (n - 1) * j_p - pressure * next_p
    tangential_s = (n**2 - 1 - half) * j_s + shear * next_s
    return np.asarray(radial_p * tangential_s - radial_s * tangential_p)


def _bessel(order: int, x: F64) -> F64:
    """Return the spherical Bessel function of the first kind from its power series.

    The series (Abramowitz and Stegun 10.1.2) keeps ten digits up to x = 12.
    """
    # The first term is x^n / (1 3 5 ... (2 n + 1)).
    factor = np.ones_like(x)
    for k in range(1, order + 1):
        factor = factor * x / (2 * k + 1)
    term = np.ones_like(x)
    total = np.ones_like(x)
    for k in range(1, BESSEL_TERMS):
        term = term * (-(x**2) / 2) / (k * (2 * order + 2 * k + 1))
        total = total + term
    return np.asarray(factor * total)
