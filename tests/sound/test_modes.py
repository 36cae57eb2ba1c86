"""Natural frequencies against closed forms and an independent method."""

from __future__ import annotations

import numpy as np
import pytest

from physgen.sound.modes import (
    Elasticity,
    bar_frequencies,
    block_frequencies,
    disc_frequencies,
    disc_roots,
    plate_frequencies,
    ring_frequencies,
    sphere_frequencies,
    sphere_roots,
)

STEEL = Elasticity(205e9, 0.29, 7850)
GLASS = Elasticity(70e9, 0.22, 2500)


def bar_by_finite_differences(
    length: float, thickness: float, cells: int
) -> np.ndarray:
    """Return the modes (Hz) of a free bar of steel as a chain of rigid links with bending springs."""
    step = length / cells
    bending = np.zeros((cells - 1, cells + 1))
    for row in range(cells - 1):
        bending[row, row : row + 3] = 1, -2, 1
    stiffness = STEEL.young * thickness**3 / 12 / step**3 * bending.T @ bending
    mass = np.full(cells + 1, STEEL.density * thickness * step)
    mass[[0, -1]] /= 2
    root = 1 / np.sqrt(mass)
    squares = np.linalg.eigvalsh(root[:, None] * stiffness * root)
    return np.sqrt(squares[2:6]) / (2 * np.pi)


def test_free_bar_has_ratios_of_euler() -> None:
    modes = bar_frequencies(STEEL, 0.3, 0.01, 3)
    assert modes / modes[0] == pytest.approx([1, 2.756, 5.404], rel=0.01)


def test_free_bar_equals_chain_of_links() -> None:
    modes = bar_frequencies(STEEL, 0.3, 0.01, 4)
    assert modes == pytest.approx(bar_by_finite_differences(0.3, 0.01, 200), rel=0.01)


def test_sphere_meets_table_of_lamb() -> None:
    # Lamb 1882, page 208: k a / pi = 0.840 and 1.546 for n = 2, h a / pi = 0.8160 for n = 0
    roots = sphere_roots(0.25)
    ratio = np.sqrt((1 - 2 * 0.25) / (2 - 2 * 0.25))
    assert roots[0] / np.pi == pytest.approx(0.840, rel=0.002)
    assert min(abs(np.array(roots) / np.pi * ratio - 0.8160)) < 0.001
    assert min(abs(np.array(roots) / np.pi - 1.546)) < 0.004


def test_lowest_mode_of_steel_ball() -> None:
    # 0S2 of a steel sphere of 10 mm: 0.842 pi c / (2 pi a) with c = 3,180 m/s
    modes = sphere_frequencies(STEEL, 0.005, 3)
    assert modes[0] == pytest.approx(0.842 * 3180 / (2 * 0.005), rel=0.02)


def test_disc_meets_table_of_leissa() -> None:
    # NASA SP-160, table 2.5, Poisson's ratio 0.33
    assert disc_roots(0.33)[:5] == pytest.approx(
        [5.253, 9.084, 12.23, 20.52, 21.6], rel=0.01
    )
    stiffness = np.sqrt(70e9 * 0.004**2 / 12 / (1 - 0.22**2) / 2500)
    modes = disc_frequencies(GLASS, 0.1, 0.004, 1)
    assert modes[0] == pytest.approx(5.45 * stiffness / (2 * np.pi * 0.01), rel=0.03)


def test_long_plate_bends_like_a_bar() -> None:
    plate = Elasticity(205e9, 0.0, 7850)
    modes = plate_frequencies(plate, (1.0, 0.02), 0.005, 3)
    assert modes == pytest.approx(bar_frequencies(plate, 1.0, 0.005, 3), rel=0.02)


def test_square_plate_meets_table_of_leissa() -> None:
    # lowest mode of a free square plate, 13.49, by Rayleigh's method at most 7 % too high
    stiffness = STEEL.bending_stiffness(0.002)
    lowest = plate_frequencies(STEEL, (0.2, 0.2), 0.002, 1)[0]
    assert lowest * 2 * np.pi * 0.04 / stiffness == pytest.approx(13.49, rel=0.07)


def test_ring_ratios_are_rayleighs() -> None:
    modes = ring_frequencies(GLASS, 0.035, 0.002, 3)
    # n (n² - 1) / sqrt(n² + 1), of n = 2 to 4
    assert modes / modes[0] == pytest.approx([1, 2.828, 5.423], rel=0.001)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_block_frequencies_fall_with_size(factor: float) -> None:
    modes = block_frequencies(STEEL, (0.05, 0.04, 0.04), 6)
    sides = (0.05 * factor, 0.04 * factor, 0.04 * factor)
    assert block_frequencies(STEEL, sides, 6) == pytest.approx(modes / factor)
