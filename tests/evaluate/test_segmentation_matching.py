"""Masks against truth: pycocotools says the same, and a case worked out by hand."""

from __future__ import annotations

import contextlib
import io
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from physgen.evaluate.ground_truth import Patch, patches
from physgen.evaluate.segmentation import (
    RECALLS,
    THRESHOLDS,
    Curve,
    Judged,
    average_precision,
    counts,
    curve,
    judge,
    overlaps,
    reliability,
)

Masks = list[NDArray[np.bool_]]
SIZE = 48


def precisions(line: Curve) -> NDArray[np.float64]:
    """At COCO's recalls, as COCO reports them."""
    return np.append(line.falling, 0.0)[np.searchsorted(line.recall, RECALLS, side="left")]


def random_photo(rng: np.random.Generator) -> tuple[Masks, Masks, NDArray[np.float64]]:
    """True masks, said masks that may overlap, confidences with many ties."""

    def rectangles(count: int) -> Masks:
        masks = []
        for _ in range(count):
            x, y, w, h = rng.integers(0, 36), rng.integers(0, 36), rng.integers(4, 14), rng.integers(4, 14)
            mask = np.zeros((SIZE, SIZE), bool)
            mask[y : y + h, x : x + w] = True
            masks.append(mask)
        return masks

    true = rectangles(int(rng.integers(0, 8)))
    said = rectangles(int(rng.integers(0, 4)))
    for mask in true:  # near misses: the same moved by a few px, or twice
        for _ in range(int(rng.integers(0, 3))):
            said.append(np.roll(mask, rng.integers(-3, 4, 2), (0, 1)))
    confidence = np.round(rng.random(len(said)), 1)
    return true, said, confidence


def by_pycocotools(photos: list) -> Any:
    from pycocotools import mask as rle
    from pycocotools.coco import COCO
    from pycocotools.cocoeval import COCOeval

    def encode(mask: NDArray[np.bool_]) -> dict:
        return rle.encode(np.asfortranarray(mask.astype(np.uint8)))

    annotations, results = [], []
    for k, (true, said, confidence) in enumerate(photos):
        for mask in true:
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": k,
                    "category_id": 1,
                    "iscrowd": 0,
                    "area": float(mask.sum()),
                    "segmentation": encode(mask),
                }
            )
        for mask, sure in zip(said, confidence, strict=True):
            results.append(
                {"image_id": k, "category_id": 1, "score": float(sure), "segmentation": encode(mask)}
            )
    with contextlib.redirect_stdout(io.StringIO()):
        truth = COCO()
        truth.dataset = {
            "info": {},
            "images": [{"id": k, "width": SIZE, "height": SIZE} for k in range(len(photos))],
            "annotations": annotations,
            "categories": [{"id": 1, "name": "thing"}],
        }
        truth.createIndex()
        found = COCOeval(truth, truth.loadRes(results), "segm")
        found.params.maxDets = [1, 10, 10_000]
        found.evaluate()
        found.accumulate()
    return found


@pytest.mark.parametrize("seed", range(12))
def test_pycocotools_says_the_same(seed: int) -> None:
    rng = np.random.default_rng(seed)
    photos = [random_photo(rng) for _ in range(8)]
    theirs = by_pycocotools(photos).eval
    assert theirs is not None
    judged = []
    for true, said, confidence in photos:
        overlap = overlaps([Patch.of(m) for m in said], [Patch.of(m) for m in true])
        judged.append([judge(overlap, confidence, t) for t in THRESHOLDS])
    for t in range(len(THRESHOLDS)):
        at = [one[t] for one in judged]
        expected = theirs["precision"][t, :, 0, 0, -1]
        assert np.abs(precisions(curve(at)) - expected).max() < 1e-9
        assert average_precision(at) == pytest.approx(float(expected.mean()), abs=1e-9)
        assert counts(at)["recall"] == pytest.approx(float(theirs["recall"][t, 0, 0, -1]), abs=1e-9)


def square(x: int, y: int, side: int = 10) -> Patch:
    return Patch(x, y, np.ones((side, side), np.bool_))


def test_a_case_worked_out_by_hand() -> None:
    # one square is said twice, one a row off, one is missed, one said where nothing is
    true = [square(0, 0), square(20, 0), square(40, 0)]
    said = [square(0, 0), square(0, 1), square(20, 2), square(100, 0)]
    confidence = np.array([0.6, 0.9, 0.7, 0.8])
    overlap = overlaps(said, true)
    assert overlap[1, 0] == pytest.approx(90 / 110)
    assert overlap[2, 1] == pytest.approx(80 / 120)
    judged = judge(overlap, confidence)
    assert judged.match.tolist() == [
        -1,
        0,
        1,
        -1,
    ]  # the surer of the two has the square, though it fits worse
    assert judged.missed == [2]
    found = counts([judged])
    assert (found["said"], found["true"], found["hit"]) == (4, 3, 2)
    assert found["precision"] == 0.5
    assert found["recall"] == pytest.approx(2 / 3)
    assert found["f"] == pytest.approx(4 / 7)
    assert found["iou"] == pytest.approx((90 / 110 + 80 / 120) / 2)
    # by falling confidence: right, false, right, false; precision 1, 1/2, 2/3, 1/2 at recall 1/3, 1/3, 2/3, 2/3
    line = curve([judged])
    assert line.recall.tolist() == pytest.approx([1 / 3, 1 / 3, 2 / 3, 2 / 3])
    assert line.precision.tolist() == pytest.approx([1, 1 / 2, 2 / 3, 1 / 2])
    # of the recalls 0, 0.01 .. 1, 34 lie up to 1/3, 33 more up to 2/3
    assert average_precision([judged]) == pytest.approx((34 + 33 * 2 / 3) / 101)
    strict = judge(overlap, confidence, 0.75)
    assert counts([strict])["hit"] == 1


def test_where_nothing_is_true_shares_have_no_value() -> None:
    nothing = judge(np.zeros((0, 0)), np.zeros(0))
    assert average_precision([nothing]) is None
    assert counts([nothing]) == dict.fromkeys(("said", "true", "hit"), 0) | dict.fromkeys(
        ("precision", "recall", "f", "iou")
    )


def test_patches_hold_every_pixel() -> None:
    labels = np.random.default_rng(1).integers(0, 5, (30, 40)).astype(np.uint16)
    whole = np.zeros_like(labels)
    for i, patch in patches(labels).items():
        left, top, right, bottom = patch.box
        whole[top:bottom, left:right][patch.mask] = i
    assert np.array_equal(whole, labels)
    found = list(patches(labels).values())
    assert found[0].shared(found[0]) == found[0].area == int((labels == 1).sum())
    assert found[0].shared(found[1]) == 0


def said_and_right(confidence: NDArray[np.float64], right: NDArray[np.bool_]) -> Judged:
    match = np.where(right, np.arange(len(right)), -1)
    return Judged(confidence, match, right.astype(np.float64), len(right))


def test_perfect_candour_has_no_error() -> None:
    levels = np.repeat([0.25, 0.5, 0.75, 1.0], 40)  # of each forty, as many are right as is said
    right = np.concatenate([np.arange(40) < 10, np.arange(40) < 20, np.arange(40) < 30, np.ones(40, bool)])
    bins = reliability([said_and_right(levels, right)])
    assert bins.error == pytest.approx(0, abs=1e-12)
    assert bins.count.tolist() == [0, 0, 40, 0, 40, 0, 0, 40, 0, 40]
    over = reliability([said_and_right(np.minimum(levels + 0.2, 1), right)])
    assert over.error == pytest.approx((3 * 0.2) / 4)


def test_drawn_candour_has_as_little_error_as_chance_leaves() -> None:
    rng = np.random.default_rng(0)
    confidence = rng.random(200_000)
    bins = reliability([said_and_right(confidence, rng.random(200_000) < confidence)])
    assert bins.error is not None
    assert bins.error < 4 * 0.5 / np.sqrt(20_000)
    assert np.all(np.diff(bins.right) > 0)
    assert reliability([]).error is None
