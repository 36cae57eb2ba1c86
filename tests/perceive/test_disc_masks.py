"""Masks of round objects become their discs, unless something else belongs to them."""

from __future__ import annotations

import numpy as np

from physgen.arrays import Mask
from physgen.geometry import raster
from physgen.geometry.polygon import Disc
from physgen.perceive.photo_objects import replace_by_discs
from physgen.perceive.roles import Labels, PhotoObject

RADIUS = 20.0
PLACES = [(40.0 + 60 * k, 50.0) for k in range(5)]
ROWS, COLUMNS = np.mgrid[:100, :320]


def disc_area(place: tuple[float, float], radius: float = RADIUS) -> Mask:
    """Return the pixels (100, 320) of a disc."""
    size = (ROWS.shape[1], ROWS.shape[0])
    return raster.coverage(Disc(np.array(place), radius), size) >= 0.5


def five_balls() -> tuple[Labels, list[PhotoObject]]:
    """Return the masks of five discs of one size, and their objects."""
    labels = np.zeros(ROWS.shape, np.uint16)
    objects = []
    for number, place in enumerate(PLACES, 1):
        labels[disc_area(place)] = number
        outline = Disc(np.array(place), RADIUS)
        objects.append(PhotoObject(number, outline, cut=False))
    return labels, objects


def test_ball_with_dark_rim_among_equals_gets_its_disc() -> None:
    """A rack's shadow hid a sixth of its mask; alone, such an object keeps its mask."""
    labels, objects = five_balls()
    bitten = labels.copy()
    bitten[(labels == 3) & (PLACES[2][0] + 13 < COLUMNS)] = 0
    assert np.array_equal(replace_by_discs(bitten, objects), labels)
    alone = np.where(bitten == 3, bitten, 0).astype(np.uint16)
    assert np.array_equal(replace_by_discs(alone, [objects[2]]), alone)


def test_sliver_beside_an_equal_disc_becomes_background() -> None:
    labels, objects = five_balls()
    swollen = labels.copy()
    swollen[disc_area(PLACES[1], RADIUS + 2) & (ROWS > 50)] = 2
    assert np.array_equal(replace_by_discs(swollen, objects), labels)


def test_handle_of_one_among_equal_cups_stays() -> None:
    labels, objects = five_balls()
    handle = (abs(ROWS - 50) < 3) & (PLACES[3][0] < COLUMNS) & (COLUMNS < 250)
    labels[handle & (labels == 0)] = 4
    assert np.array_equal(replace_by_discs(labels, objects), labels)
