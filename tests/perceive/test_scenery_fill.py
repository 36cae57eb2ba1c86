"""Objects that do not move are seen while the place of others is filled."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from physgen.perceive.perception_run import PerceptionRun, nearest_labels
from physgen.perceive.roles import Shadows
from physgen.perceive.shadow.backgrounds import (
    fill_backgrounds,
    fill_before_scenery,
    find_scenery,
    find_surroundings,
)
from physgen.photometry import DistantLight

NO_SHADOWS = Shadows(
    None, None, DistantLight((0.0, 0.0, 1.0), 1.0, 0.2), 4.0, 6.0, None, 0.0
)


def _row_mean(photo, hole):
    """Fill a hole by the mean of what is known in each row."""
    known = (~hole)[..., None]
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    mean = (photo * known).sum(axis=1, keepdims=True) / count
    return np.where(hole[..., None], mean, photo).astype(np.uint8)


def _cup_on_bench():
    """Return a wall, a bench below it that the border cuts, and a cup before the bench."""
    photo = np.full((120, 160, 3), 200, np.uint8)
    photo[70:] = 60
    labels = np.zeros((120, 160), np.uint16)
    labels[70:, :] = 2
    labels[50:90, 60:100] = 1
    photo[50:90, 60:100] = 130
    return photo, labels


def test_place_of_a_cup_is_filled_with_its_bench():
    photo, labels = _cup_on_bench()
    coverage = (labels > 0).astype(np.float32)
    scenery = nearest_labels(labels, [2]) & (coverage > 0)
    around = find_surroundings(photo, coverage)
    filled = fill_before_scenery(around, scenery, NO_SHADOWS, _row_mean)
    together = fill_backgrounds(around, NO_SHADOWS, _row_mean)
    place = np.s_[78:86, 66:94]
    assert np.abs(filled.shaded_picture[place].astype(int) - 60).max() < 8
    assert np.abs(together.shaded_picture[place].astype(int) - 60).min() > 8
    wall = np.s_[54:62, 66:94]
    assert np.abs(filled.shaded_picture[wall].astype(int) - 200).max() < 8


def test_place_of_a_cup_that_throws_a_shadow_shows_its_bench():
    """Both backgrounds show the bench where the cup was, and the wall beyond the bench."""
    photo, labels = _cup_on_bench()
    labels[70:, 150:] = 0
    photo[70:, 150:] = 200
    lit = photo.copy()
    photo[80:90, 100:130] = 40  # on a bench of 60
    coverage = (labels > 0).astype(np.float32)
    scenery = nearest_labels(labels, [2]) & (coverage > 0)
    around = find_surroundings(photo, coverage)
    clean = np.where(coverage[..., None] > 0, around.guess, lit)
    shadows = replace(NO_SHADOWS, clean_background=clean)
    filled = fill_before_scenery(around, scenery, shadows, _row_mean)
    place = np.s_[72:78, 66:94]
    assert filled.clean_picture is not None
    assert filled.shaded_picture[place].max() < 100
    assert filled.clean_picture[100:, :150].min() > 190
    is_open = np.s_[:40]
    assert (filled.shaded_picture[is_open] == photo[is_open]).all()


def test_scenery_far_from_all_objects_is_not_what_they_stand_on():
    _, labels = _cup_on_bench()
    labels[5:20, 150:] = 3
    assert find_scenery(labels, [2, 3]) == [2]
    assert find_scenery(np.where(labels == 1, 0, labels), [2, 3]) == [2, 3]


def test_nearest_labels_of_two_objects_do_not_overlap():
    _, labels = _cup_on_bench()
    bench = nearest_labels(labels, [2])
    assert not (bench & nearest_labels(labels, [1])).any()
    assert bench[labels == 2].all()
    assert not bench[labels == 1].any()
    assert not nearest_labels(labels, [3]).any()


def test_reflections_of_scenery_stay_in_the_background():
    """A box that the border cuts stays in the picture, with its reflection in the floor."""
    rng = np.random.default_rng(0)
    photo = 150 + rng.normal(0, 1, (300, 400, 1)).repeat(3, axis=2)
    labels = np.zeros((300, 400), np.uint16)
    labels[60:150, 0:90] = 2
    photo[60:150, 0:90] = (60, 40, 150)
    photo[150:240, 0:90] = photo[150:240, 0:90] * 0.8 + np.array((60, 40, 150)) * 0.2
    labels[110:150, 220:260] = 1
    photo[110:150, 220:260] = (200, 60, 60)
    rgb = np.clip(photo, 0, 255).astype(np.uint8)
    coverage = (labels > 0).astype(np.float32)
    around = find_surroundings(rgb, coverage)
    shadows = replace(NO_SHADOWS, clean_background=around.guess)
    crew = _Crew()
    run = SimpleNamespace(rgb=rgb, crew=crew, _make_inpaint=crew.make_inpaint)
    backgrounds = PerceptionRun.fill(run, around, shadows, labels, labels == 2)
    kept = backgrounds.clean_picture[155:235, 5:85].astype(int)
    assert np.abs(kept - rgb[155:235, 5:85]).max() <= 3


class _Crew:
    """Fills holes by the mean of each row."""

    def call(self, role, photo, hole):
        return _row_mean(photo, hole)

    def make_inpaint(self, surroundings):
        return _row_mean
