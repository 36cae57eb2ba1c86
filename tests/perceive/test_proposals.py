"""The parts of the proposal room, each against what is known by construction."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen.perceive.segment.edges import search_edges
from physgen.perceive.segment.gradient import colour_gradient
from physgen.perceive.segment.proposals import (
    Proposal,
    contour_normals,
    cut_out,
    score_proposals,
)
from physgen.perceive.segment.regions import colour_tree, discs
from physgen.perceive.segment.selection import best_set, exclusions


def rectangle(x: int, y: int, width: int, height: int) -> Proposal:
    return Proposal(x, y, np.ones((height, width), np.bool_), width * height)


def disc_image(cx: float, cy: float, radius: float, size: int = 120) -> np.ndarray:
    y, x = np.mgrid[:size, :size]
    image = np.full((size, size, 3), (40, 0, 0), np.float32)
    image[np.hypot(x - cx, y - cy) <= radius] = (80, 0, 0)
    return cv2.GaussianBlur(image, (0, 0), 0.7)


def test_the_gradient_of_a_step_lies_on_it_and_faces_across() -> None:
    colour = np.zeros((40, 60, 3), np.float32)
    colour[:, 30:] = 50
    gradient = colour_gradient(colour)
    assert set(gradient.strength[20].argsort()[-2:]) == {29, 30}
    assert np.cos(gradient.angle[20, 29]) ** 2 == pytest.approx(1)
    at = np.array([29.5]), np.array([20.0])
    assert gradient.measure_across(*at, np.array([0.0])) > 5
    assert gradient.measure_across(*at, np.array([np.pi / 2])) == pytest.approx(
        0, abs=1e-3
    )


def test_the_merge_tree_joins_the_most_alike_first() -> None:
    labels = np.repeat(np.arange(3, dtype=np.int32), 4)[None].repeat(6, 0)
    grey = np.array([0, 1, 9], np.float32)[labels]
    tree = colour_tree(
        labels, np.stack([grey] * 3, -1), np.zeros(labels.shape, np.float32)
    )
    assert tree.parent.tolist() == [3, 3, 4, 4, -1]
    assert tree.height[3] < tree.height[4]
    first, last = tree.span[3]
    assert sorted(tree.rank[:2].tolist()) == list(range(first, last))


def test_circles_are_fitted_to_a_fraction_of_a_pixel() -> None:
    found = discs(colour_gradient(disc_image(61.3, 54.6, 25.2)), 300, 5000)
    y, x = np.nonzero(found[0].on((120, 120)))
    assert (x.mean(), y.mean()) == pytest.approx((61.3, 54.6), abs=0.3)
    assert np.sqrt(found[0].area / np.pi) == pytest.approx(25.2, abs=0.5)


def test_cutting_out_keeps_the_largest_part_and_fills_it() -> None:
    mask = np.zeros((20, 20), np.bool_)
    mask[2:12, 3:13] = True
    mask[6:8, 6:8] = False
    mask[16:18, 16:18] = True
    part = cut_out(mask, 100, 200, smallest=10)
    assert part is not None
    assert part.box == (103, 202, 113, 212)
    assert part.area == 100
    assert cut_out(mask, 0, 0, smallest=101) is None


def test_normals_point_out_of_a_contour_however_it_runs() -> None:
    circle = np.rint(
        50 + 30 * np.stack([np.cos(t := np.linspace(0, 2 * np.pi, 190)), np.sin(t)], 1)
    )
    for contour in (circle, circle[::-1]):
        outward = (contour - 50) / np.linalg.norm(contour - 50, axis=1, keepdims=True)
        assert (contour_normals(contour.astype(np.int32)) * outward).sum(1).min() > 0.9


def test_the_best_set_prefers_two_to_the_one_that_excludes_both() -> None:
    forms = [
        rectangle(0, 0, 60, 20),
        rectangle(0, 0, 30, 20),
        rectangle(30, 0, 30, 20),
        rectangle(90, 0, 9, 9),
    ]
    excludes = exclusions(forms)
    assert excludes.tolist()[0] == [False, True, True, False]
    gain = np.array([3.0, 2.0, 2.0, -1.0])
    assert best_set(gain, excludes).tolist() == [False, True, True, False]
    gain[0] = 5
    assert best_set(gain, excludes).tolist() == [True, False, False, False]


def test_scores_out_of_reach_are_zero() -> None:
    colour = disc_image(61.3, 54.6, 25.2)
    gradient = colour_gradient(colour)
    forms = [*discs(gradient, 300, 5000), rectangle(30, 20, 60, 5)]
    every = score_proposals(forms, colour, gradient).score
    least = float(np.median(every))
    some = score_proposals(forms, colour, gradient, least).score
    assert every.min() < least < every.max()
    assert np.array_equal(some[every > least], every[every > least])
    assert set(some[every <= least]) <= {0.0, least}


@pytest.mark.parametrize(("roughness", "is_searched"), [(0.5, True), (25.0, False)])
def test_rough_photos_have_no_edge_search(roughness: float, is_searched: bool) -> None:
    rng = np.random.default_rng(0)
    photo = np.full((200, 300, 3), (60, 80, 100), np.float64)
    cv2.circle(photo, (100, 100), 40, (220, 190, 60), -1)
    cv2.rectangle(photo, (190, 60), (260, 140), (200, 60, 60), -1)
    photo += rng.normal(0, roughness, photo.shape)
    found = search_edges(np.clip(photo, 0, 255).astype(np.uint8))
    assert len(found.proposals) == len(found.scores) == (2 if is_searched else 0)
