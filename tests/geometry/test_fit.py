from __future__ import annotations

import cv2
import numpy as np
import pytest
from drawings import blob_labels, box_mask, disc_mask, iou

from physgen.geometry.fitting import CIRCLE_IOU, fit_outlines, without_specks
from physgen.geometry.polygon import Disc, Region, mass_properties, rotation
from physgen.geometry.raster import coverage


def fit_outline(mask):
    return fit_outlines(mask.astype(np.int64), [1])[1]


@pytest.mark.parametrize("radius", [6.0, 20.3, 44.8, 150.2, 600.4])
def test_a_drawn_disc_to_sub_pixel(radius):
    size = int(2 * radius + 20)
    center = np.array([size / 2 + 0.37, size / 2 - 0.21])
    found = fit_outline(disc_mask(size, center, radius))
    assert isinstance(found, Disc)
    assert found.center == pytest.approx(center, abs=0.2)
    assert found.radius == pytest.approx(radius, abs=0.15)


@pytest.mark.parametrize("angle", [0.0, 0.1, 0.3, 0.5, 0.78, 1.2])
def test_a_drawn_box_to_sub_pixel(angle):
    center, half = np.array([45.3, 44.6]), np.array([30.0, 17.2])
    found = fit_outline(box_mask(90, center, half, angle))
    assert isinstance(found, Region)
    (ring,) = found.rings
    assert len(ring.outer) <= 10
    m = mass_properties(found)
    # the mask itself is off by what sampling a box at pixel centres costs
    assert m.center == pytest.approx(center, abs=0.4)
    assert m.area == pytest.approx(4 * half.prod(), rel=0.015)
    local = (ring.outer - center) @ rotation(angle)
    assert np.abs(np.abs(local) - half).min(axis=1).max() < 0.8


def ellipse(ratio):
    rows, columns = np.mgrid[:120, :120] - 60.0
    return (columns / 50) ** 2 + (rows / (50 * ratio)) ** 2 < 1


def test_the_edge_of_the_papers_rule():
    # the circle of best IoU with an ellipse has the ellipse's area: IoU falls with the ratio of its axes
    assert isinstance(fit_outline(ellipse(0.86)), Disc)
    assert isinstance(fit_outline(ellipse(0.66)), Region)
    assert CIRCLE_IOU == 0.85


@pytest.mark.parametrize("rounded", [0, 6, 12])
def test_a_toy_block_is_no_wheel(rounded):
    inner = 30 - rounded
    rows, columns = np.abs(np.mgrid[:80, :80] - 40.0)
    mask = (
        np.hypot(np.maximum(columns - inner, 0), np.maximum(rows - inner, 0)) <= rounded
    )
    assert isinstance(fit_outline(mask), Region)


@pytest.mark.parametrize(
    ("foot", "height", "below"), [(42, 70, 16), (42, 60, 22), (36, 62, 20)]
)
def test_a_mug_does_not_roll(foot: int, height: int, below: int):
    """Seen from the side and a little from above, 100 px wide: its circle covers 0.86 to 0.89 of it."""
    mask = np.zeros((200, 240), np.uint8)
    sides = [[70, 40], [170, 40], [120 + foot, 40 + height], [120 - foot, 40 + height]]
    cv2.fillPoly(mask, [np.array(sides)], 1)
    cv2.ellipse(mask, (120, 40), (50, 16), 0, 0, 360, 1, -1)
    cv2.ellipse(mask, (120, 40 + height), (foot, below), 0, 0, 360, 1, -1)
    assert isinstance(fit_outline(mask > 0), Region)


def test_a_ball_behind_a_box_is_a_disc():
    """The box hides a tenth of it."""
    rows, columns = np.mgrid[:200, :240]
    labels = (np.hypot(rows - 100, columns - 100) < 52).astype(np.uint16)
    labels[60:160, 136:190] = 2
    assert isinstance(fit_outlines(labels, [1, 2])[1], Disc)


def test_a_small_ball_with_a_ragged_border_is_a_disc():
    rows, columns = np.mgrid[:40, :40] - 20.0
    ragged = np.random.default_rng(1).normal(0, 0.6, (40, 40))
    assert isinstance(fit_outline(np.hypot(rows, columns) + ragged < 10), Disc)


def test_a_disc_cut_by_the_photo_reaches_beyond_it():
    found = fit_outline(disc_mask(100, (10.0, 50.0), 25.0))
    assert isinstance(found, Disc)
    assert found.center == pytest.approx([10.0, 50.0], abs=0.5)
    assert found.radius == pytest.approx(25.0, abs=0.5)


def test_holes_and_pieces_stay_and_specks_go():
    mask = np.zeros((90, 140), dtype=bool)
    mask[10:80, 10:70] = True
    mask[30:50, 30:50] = False
    mask[20:70, 90:100] = True
    mask[5, 5] = mask[2, 120] = True
    mask[60, 20] = False
    found = fit_outline(mask)
    assert isinstance(found, Region)
    assert [len(ring.holes) for ring in found.rings] == [1, 0]
    m = mass_properties(found)
    assert m.area == pytest.approx(70 * 60 - 20 * 20 + 50 * 10, rel=1e-6)


@pytest.mark.parametrize("seed", range(15))
def test_regions_match_their_masks(seed):
    mask = blob_labels(seed, size=96, smooth=5.0) == 1
    found = fit_outline(mask)
    kept = without_specks(mask)
    assert iou(coverage(found, (96, 96)), kept) > 0.93
    m = mass_properties(found)
    rows, columns = np.nonzero(kept)
    assert m.area == pytest.approx(kept.sum(), rel=0.02)
    assert m.center == pytest.approx([columns.mean(), rows.mean()], abs=0.3)


def test_empty_mask_is_an_error():
    with pytest.raises(ValueError, match="no pixel"):
        fit_outline(np.zeros((5, 5), dtype=bool))


def test_mirrored_mask_gives_a_mirrored_outline():
    mask = blob_labels(4, size=64, smooth=6.0) == 1
    one, other = (
        mass_properties(fit_outline(mask)),
        mass_properties(fit_outline(mask[:, ::-1])),
    )
    assert other.center[0] == pytest.approx(63 - one.center[0], abs=0.1)
    assert other.area == pytest.approx(one.area, rel=0.01)


def test_jags_of_a_large_photo_are_no_corners():
    # A box of 1,200 px whose borders jump by up to 2 px at random.
    rng = np.random.default_rng(0)
    mask = np.zeros((1920, 1920), dtype=bool)
    mask[200:1400, 200:1400] = True
    for k, jag in enumerate(rng.integers(0, 3, (4, 1200)).T, 200):
        top, bottom, left, right = jag.tolist()
        mask[200 : 200 + top, k] = False
        mask[1400 - bottom : 1400, k] = False
        mask[k, 200 : 200 + left] = False
        mask[k, 1400 - right : 1400] = False
    outline = fit_outline(mask)
    assert len(outline.rings[0].outer) <= 12
    assert iou(coverage(outline, mask.shape), mask) > 0.995
