"""Lower rims of masks against the true masks of the studio's photos."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen.maps import read_labels
from physgen.perceive.lower_rims import refine_lower_rims
from physgen.photos import read_photo

SCENES = Path(__file__).resolve().parents[2] / "scenes"


def photo_and_truth(scene):
    """Return a photo of the studio and its true label map."""
    photo = read_photo(SCENES / scene / "photo.png").rgb
    return photo, read_labels(SCENES / scene / "photo.assets" / "masks.png")


def largest(labels):
    """Return the id of the largest object."""
    return int(np.bincount(labels[labels > 0]).argmax())


def nothing(labels):
    return np.zeros(labels.shape, bool)


def with_strip(labels, number, height):
    """Return the labels with a ragged strip of the ground below an object."""
    result = labels.copy()
    random = np.random.default_rng(0)
    for column in np.flatnonzero((labels == number).any(axis=0)):
        last = np.flatnonzero(labels[:, column] == number)[-1]
        strip = result[last + 1 : last + 1 + height - random.integers(3), column]
        strip[strip == 0] = number
    return result


def misplaced(labels, truth, number):
    return np.count_nonzero((labels == number) != (truth == number))


@pytest.mark.parametrize("scene", ["cans", "cups", "marbles", "pyramid"])
def test_a_strip_of_ground_leaves_the_mask(scene) -> None:
    photo, truth = photo_and_truth(scene)
    number = largest(truth)
    size = np.sqrt(np.count_nonzero(truth == number))
    labels = with_strip(truth, number, max(4, round(0.04 * size)))
    refined = refine_lower_rims(photo, labels, nothing(labels))
    before = misplaced(labels, truth, number)
    assert misplaced(refined, truth, number) < 0.5 * before


@pytest.mark.parametrize("scene", ["cans", "cups", "marbles", "seesaw", "toy-car"])
def test_true_masks_stay(scene) -> None:
    photo, truth = photo_and_truth(scene)
    refined = refine_lower_rims(photo, truth, nothing(truth))
    for number in np.unique(truth[truth > 0]):
        common = np.count_nonzero((refined == number) & (truth == number))
        union = np.count_nonzero((refined == number) | (truth == number))
        assert common > 0.98 * union


def test_upper_rims_stay() -> None:
    photo, truth = photo_and_truth("cups")
    number = largest(truth)
    rows = np.flatnonzero((truth == number).any(axis=1))
    middle = (rows[0] + rows[-1]) // 2
    dilated = cv2.dilate((truth == number).astype(np.uint8), np.ones((7, 7)))
    labels = np.where((dilated > 0) & (truth == 0), number, truth).astype(np.uint16)
    refined = refine_lower_rims(photo, labels, nothing(labels))
    assert np.array_equal(refined[: middle - 8], labels[: middle - 8])


def test_known_pixels_stay() -> None:
    photo, truth = photo_and_truth("cups")
    number = largest(truth)
    labels = with_strip(truth, number, 6)
    strip = labels != truth
    known = refine_lower_rims(photo, labels, strip)
    unknown = refine_lower_rims(photo, labels, nothing(labels))
    assert (known[strip] > 0).sum() > (unknown[strip] > 0).sum()


def test_mirroring_mirrors_the_rims() -> None:
    photo, truth = photo_and_truth("cups")
    number = largest(truth)
    labels = with_strip(truth, number, 6)
    refined = refine_lower_rims(photo, labels, nothing(labels))
    mirrored = refine_lower_rims(
        np.ascontiguousarray(photo[:, ::-1]),
        np.ascontiguousarray(labels[:, ::-1]),
        nothing(labels),
    )
    differences = np.count_nonzero(mirrored[:, ::-1] != refined)
    assert differences < 0.005 * np.count_nonzero(labels == number)


def test_no_objects_give_no_rims() -> None:
    photo = np.full((80, 100, 3), 90, np.uint8)
    labels = np.zeros((80, 100), np.uint16)
    assert np.array_equal(refine_lower_rims(photo, labels, labels > 0), labels)


def cloth_on_white(level):
    """Return a photo of grey cloth before a white ground, and its label map."""
    random = np.random.default_rng(0)
    photo = np.full((480, 640, 3), 250, np.uint8)
    cloth = level + random.normal(0, 3, (300, 440, 1))
    photo[100:400, 100:540] = np.clip(cloth, 0, 255).astype(np.uint8)
    labels = np.zeros((480, 640), np.uint16)
    labels[100:400, 100:540] = 1
    return photo, labels


def test_a_label_near_the_base_leaves_no_notch() -> None:
    """The lower edge of a label on pale cloth is clearer than the base of the cloth."""
    photo, labels = cloth_on_white(208)
    photo[330:380, 380:424] = 20
    refined = refine_lower_rims(photo, labels, nothing(labels))
    assert (refined[110:396, 110:530] == 1).all()
    assert not refined[403:].any()


def test_a_gap_between_feet_leaves_the_mask() -> None:
    """A notch with the colours of the lit ground is not filled."""
    photo, labels = cloth_on_white(120)
    photo[384:400, 370:410] = 250
    refined = refine_lower_rims(photo, labels, nothing(labels))
    assert not refined[390:398, 380:400].any()
