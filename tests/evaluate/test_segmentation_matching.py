"""Masks against truth: a case worked out by hand, and calibration."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from physgen.evaluate.segmentation import (
    Photo,
    PhotoMatches,
    Runs,
    calibration_error,
    counts,
    encode_mask,
    match,
)


def square(x: int, y: int, side: int = 10) -> Runs:
    mask = np.zeros((120, 120), np.bool_)
    mask[y : y + side, x : x + side] = True
    return encode_mask(mask)


def test_a_case_worked_out_by_hand() -> None:
    # one square is said twice, one a row off, one is missed, one said where nothing is
    true = [square(0, 0), square(20, 0), square(40, 0)]
    said = [square(0, 0), square(0, 1), square(20, 2), square(100, 0)]
    matched = match(
        [Photo("x", (120, 120), true, (), said, np.array([0.6, 0.9, 0.7, 0.8]))]
    )
    (judged,) = matched.photos
    assert judged.confidence.tolist() == [0.9, 0.8, 0.7, 0.6]
    # the surer of the two has the square, though it fits worse
    assert judged.overlap == pytest.approx([90 / 110, 0, 80 / 120, 0])
    found = counts([judged])
    assert (found["said"], found["true"], found["hit"]) == (4, 3, 2)
    assert found["precision"] == 0.5
    assert found["recall"] == pytest.approx(2 / 3)
    assert found["f"] == pytest.approx(4 / 7)
    assert found["iou"] == pytest.approx((90 / 110 + 80 / 120) / 2)
    # by falling confidence: right, false, right, false; precision 1, 1/2, 2/3, 1/2 at recall 1/3, 1/3, 2/3, 2/3
    # of the recalls 0, 0.01 .. 1, 34 lie up to 1/3, 33 more up to 2/3
    average = matched.average_precision
    assert average[0] == pytest.approx((34 + 33 * 2 / 3) / 101)
    assert average[5] == pytest.approx(
        34 / 101
    )  # at an IoU of 0.75, one square is right


def test_where_nothing_is_true_shares_have_no_value() -> None:
    matched = match([Photo("x", (120, 120), (), (), (), np.zeros(0))])
    assert matched.average_precision[0] is None
    assert counts(matched.photos) == dict.fromkeys(
        ("said", "true", "hit"), 0
    ) | dict.fromkeys(("precision", "recall", "f", "iou"))


def test_where_nobody_judges_nothing_counts() -> None:
    unjudged = np.zeros((120, 120), np.bool_)
    unjudged[:, 50:] = True
    # right; within; mostly within; mostly without
    said = [square(10, 10), square(70, 10), square(46, 40), square(43, 70)]
    confidence = np.array([0.9, 0.8, 0.7, 0.6])
    photo = Photo(
        "x", (120, 120), [square(10, 10)], [encode_mask(unjudged)], said, confidence
    )
    found = counts(match([photo]).photos)
    assert (found["true"], found["said"], found["hit"]) == (1, 2, 1)


def said_and_right(
    confidence: NDArray[np.float64], right: NDArray[np.bool_]
) -> PhotoMatches:
    return PhotoMatches(confidence, right.astype(np.float64), len(right))


def test_perfect_candour_has_no_error() -> None:
    levels = np.repeat(
        [0.25, 0.5, 0.75, 1.0], 40
    )  # of each forty, as many are right as is said
    right = np.concatenate(
        [np.arange(40) < 10, np.arange(40) < 20, np.arange(40) < 30, np.ones(40, bool)]
    )
    assert calibration_error([said_and_right(levels, right)]) == pytest.approx(
        0, abs=1e-12
    )
    over = calibration_error([said_and_right(np.minimum(levels + 0.2, 1), right)])
    assert over == pytest.approx((3 * 0.2) / 4)
    assert calibration_error([]) is None
