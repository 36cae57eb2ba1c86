from __future__ import annotations

import cv2
import numpy as np
import pytest
from drawings import blob_labels, box_mask, disc_mask, iou

from physgen.geometry.convex import overlap_depth
from physgen.geometry.fitting import fit_outlines, touching_masks
from physgen.geometry.polygon import Disc, Region, bounds, mass_properties
from physgen.geometry.raster import coverage
from physgen.geometry.regions import close_gaps, fit_regions, trace_borders
from physgen.geometry.simplify import crossings


def gap(a, b):
    return float(np.hypot(*(a.center - b.center))) - a.radius - b.radius


def deepest(outlines):
    ids = list(outlines)
    return max(
        (
            overlap_depth(outlines[a], outlines[b])
            for k, a in enumerate(ids)
            for b in ids[k + 1 :]
        ),
        default=0.0,
    )


def rack(rows, radius, spread=0.0, seed=0):
    """A triangle of balls, later ones hiding parts of earlier ones where `spread` makes them overlap."""
    rng = np.random.default_rng(seed)
    size = int(2 * radius * (rows + 1.5))
    labels = np.zeros((size, size), dtype=np.int64)
    centers = []
    for row in range(rows):
        for k in range(row + 1):
            center = np.array(
                [
                    size / 2 + (2 * k - row) * radius,
                    2 * radius + row * radius * np.sqrt(3),
                ]
            )
            centers.append(center)
            labels[
                disc_mask(
                    size,
                    center + rng.uniform(-spread, spread, 2),
                    radius + rng.uniform(0, spread),
                )
            ] = len(centers)
    return labels, np.array(centers)


@pytest.mark.parametrize(("spread", "seed"), [(0.0, 0), (1.0, 1), (1.5, 2)])
def test_a_rack_is_a_lattice_without_overlap(spread, seed):
    labels, centers = rack(4, 20.0, spread, seed)
    found = fit_outlines(labels, range(1, 11))
    assert all(isinstance(disc, Disc) for disc in found.values())
    assert len({disc.radius for disc in found.values()}) == 1
    pairs = [(a, b) for a in found for b in found if a < b]
    assert min(gap(found[a], found[b]) for a, b in pairs) >= 0
    assert (
        max(gap(found[a], found[b]) for a, b in touching_masks(labels, list(found)))
        <= 0.5
    )
    for i, disc in found.items():
        assert disc.center == pytest.approx(centers[i - 1], abs=0.4 + spread)
        assert iou(coverage(disc, labels.shape), labels == i) >= 0.95 - 0.06 * spread


def test_small_balls_stay_round_where_one_mask_took_of_its_neighbours():
    labels, centers = rack(5, 10.5)
    labels[disc_mask(len(labels), centers[8], 12.5)] = 9
    found = fit_outlines(labels, range(1, 16))
    assert all(isinstance(disc, Disc) for disc in found.values())
    assert all(
        np.hypot(*(disc.center - centers[i - 1])) < 2 for i, disc in found.items()
    )


def test_removing_a_ball_leaves_the_far_ones():
    labels = np.zeros((60, 260), dtype=np.int64)
    for k, x in enumerate((30.0, 60.0, 180.0, 210.0), start=1):
        labels[disc_mask(260, (x, 30.0), 15.0)[:60]] = k
    whole, less = (
        fit_outlines(labels, [1, 2, 3, 4]),
        fit_outlines(np.where(labels == 1, 0, labels), [2, 3, 4]),
    )
    assert less[4].center == pytest.approx(whole[4].center, abs=1e-6)


def stack(angle, gap_px=0):
    size = 140
    lower = box_mask(size, (70.0, 95.0), (40.0, 20.0), angle)
    axis = np.array([-np.sin(angle), np.cos(angle)])
    upper = box_mask(
        size,
        np.array([70.0, 95.0]) - axis * (20.0 + 15.0 + gap_px),
        (18.0, 15.0),
        angle,
    )
    labels = np.zeros((size, size), dtype=np.int64)
    labels[lower], labels[upper] = 1, 2
    return labels


@pytest.mark.parametrize("angle", [0.0, 0.05, 0.2, 0.5])
@pytest.mark.parametrize("gap_px", [0, 1.5])
def test_stacked_blocks_meet_in_a_flat_face(angle, gap_px):
    labels = stack(angle, gap_px)
    found = fit_outlines(labels, [1, 2])
    assert deepest(found) <= 1e-6
    lower, upper = (found[i].rings[0].outer for i in (1, 2))
    shared = [p for p in lower if np.abs(upper - p).max(axis=1).min() < 1e-9]
    assert len(shared) >= 2
    ends = np.array(shared)
    face = ends.max(axis=0) - ends.min(axis=0)
    assert np.hypot(*face) > 30
    straight = np.linalg.svd(ends - ends.mean(axis=0), compute_uv=False)
    assert (straight[1] if len(straight) > 1 else 0.0) < 0.75
    for i in (1, 2):
        assert iou(coverage(found[i], labels.shape), labels == i) > 0.94


def test_a_ball_before_a_block_overlaps_nothing():
    labels = np.zeros((100, 120), dtype=np.int64)
    labels[40:90, 10:110] = 1
    labels[disc_mask(120, (60.0, 40.0), 20.0)[:100]] = 2
    found = fit_outlines(labels, [1, 2])
    assert isinstance(found[2], Disc)
    assert deepest(found) <= 1e-6
    assert iou(coverage(found[2], (120, 100)), labels == 2) > 0.9


@pytest.mark.parametrize("seed", range(12))
def test_random_maps_share_borders_without_overlap(seed):
    labels = close_gaps(blob_labels(seed, size=64, count=4, smooth=3.5))
    found = fit_regions(labels)
    total = sum(coverage(region, (64, 64)).astype(float) for region in found.values())
    assert total.max() <= 1 + 1e-6
    rings = [
        points
        for region in found.values()
        for r in region.rings
        for points in (r.outer, *r.holes)
    ]
    assert len(crossings(rings)) == 0
    for label, region in found.items():
        assert mass_properties(region).area == pytest.approx(
            (labels == label).sum(), rel=0.05, abs=6
        )
    # where two labels meet inside the map, their shapes leave no gap
    borders = trace_borders(labels).borders
    inner = np.concatenate(
        [b.corners for b in borders if b.left and b.right and len(b.corners) > 4]
    )
    for x, y in inner[2::7]:
        i, j = int(np.floor(x)), int(np.floor(y))
        around = labels[max(j - 1, 0) : j + 3, max(i - 1, 0) : i + 3]
        if (around != 0).all() and 1 <= i < 62 and 1 <= j < 62:
            assert total[j, i] == pytest.approx(1.0, abs=1e-6)


def test_gaps_close_up_to_two_pixels():
    for width, closed in ((1, True), (2, True), (3, False)):
        labels = np.zeros((10, 20), dtype=np.int64)
        labels[:, :8], labels[:, 8 + width :] = 1, 2
        grown = close_gaps(labels)
        assert (grown != 0).all() == closed
        assert ((grown == labels) | (labels == 0)).all()


def test_a_thing_within_a_thing():
    labels = np.zeros((80, 80), dtype=np.int64)
    labels[10:70, 10:70] = 1
    labels[30:50, 25:55] = 2
    found = fit_outlines(labels, [1, 2])
    assert [mass_properties(found[i]).area for i in (1, 2)] == pytest.approx(
        [3000, 600]
    )
    assert deepest(found) <= 1e-6


def test_ids_that_are_not_asked_for_are_background():
    labels = stack(0.0)
    assert list(fit_outlines(labels, [2])) == [2]
    with pytest.raises(ValueError, match="id 9"):
        fit_outlines(labels, [1, 9])


@pytest.mark.peer_scenes
def test_the_pool_rack_lies_at_rest(peer_scenes):
    labels = cv2.imread(str(peer_scenes / "pool" / "mask.png"), cv2.IMREAD_UNCHANGED)
    found = fit_outlines(labels, range(1, 17))
    assert all(isinstance(disc, Disc) for disc in found.values())
    balls = [disc for i, disc in found.items() if i != 1]
    assert len({ball.radius for ball in balls}) == 1
    gaps = [gap(a, b) for k, a in enumerate(balls) for b in balls[k + 1 :]]
    assert min(gaps) >= 0
    assert sum(g <= 0.01 for g in gaps) == 30
    for i, disc in found.items():
        assert iou(coverage(disc, (512, 512)), labels == i) >= 0.9


@pytest.mark.peer_scenes
def test_the_pyramid_meets_without_overlap(peer_scenes):
    labels = cv2.imread(str(peer_scenes / "boxes" / "mask.png"), cv2.IMREAD_UNCHANGED)
    found = fit_outlines(labels, range(1, 22))
    assert all(isinstance(region, Region) for region in found.values())
    assert deepest(found) <= 1e-6
    assert len(found[13].rings[0].holes) == 1
    for i, region in found.items():
        assert iou(coverage(region, (512, 512)), labels == i) >= 0.97
    for a, b in touching_masks(labels, list(found)):
        one, other = (np.concatenate([r.outer for r in found[i].rings]) for i in (a, b))
        assert np.hypot(*(one[:, None] - other[None]).transpose(2, 0, 1)).min() <= 0.5


@pytest.mark.peer_scenes
@pytest.mark.parametrize("scene", ["pool", "domino", "pig_ball", "boxes"])
def test_every_object_keeps_its_centre(peer_scenes, scene):
    labels = cv2.imread(str(peer_scenes / scene / "mask.png"), cv2.IMREAD_UNCHANGED)
    for i in range(1, int(labels.max()) + 1):
        rows, columns = np.nonzero(labels == i)
        m = mass_properties(fit_outlines(np.asarray(labels == i, int), [1])[1])
        assert m.area == pytest.approx(len(rows), rel=0.02)
        assert m.center == pytest.approx([columns.mean(), rows.mean()], abs=0.75)


def test_a_pixel_between_two_objects_stays():
    labels = np.ones((20, 20), dtype=np.int64)
    labels[:, 10:] = 2
    labels[10, 9] = 3
    found = fit_outlines(labels, [1, 2, 3])
    assert mass_properties(found[3]).area > 0
    assert deepest(found) <= 1e-6


def bowl(cut: float, size: int = 140) -> np.ndarray:
    """A disc of radius 50 without its lowest `cut` px."""
    mask = disc_mask(size, (70.0, 66.0), 50.0)
    mask[int(66 + 50 - cut) + 1 :] = False
    return mask.astype(int)


def test_what_stands_on_a_flat_foot_is_no_disc():
    outline = fit_outlines(bowl(7.0), [1])[1]
    assert isinstance(outline, Region)
    assert bounds(outline)[3] == pytest.approx(109.5, abs=0.6)


def test_a_ball_whose_foot_something_hides_stays_a_disc():
    labels = bowl(7.0)
    labels[110:130, 20:120] = 2
    assert isinstance(fit_outlines(labels, [1, 2])[1], Disc)


def test_a_ball_of_a_ragged_mask_stays_a_disc():
    assert isinstance(fit_outlines(bowl(1.5), [1])[1], Disc)
