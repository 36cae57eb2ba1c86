"""Masks as models give them, overlapping and in pieces, made into things of which no two share a pixel."""

from __future__ import annotations

import numpy as np
import pytest

from physgen.perceive.segment.masks import (
    Cut,
    distinct,
    distinct_boxes,
    parts,
    resolve_overlaps,
    segments,
    smooth_outline,
    split,
)

SIZE = 90, 120


def block(*corners: tuple[int, int, int, int]) -> np.ndarray:
    """Left, top, right, bottom of rectangles."""
    mask = np.zeros(SIZE, bool)
    for x0, y0, x1, y1 in corners:
        mask[y0:y1, x0:x1] = True
    return mask


def cut(mask, noun="block", movable=True, score=0.8, fit=1.0):
    return Cut.from_mask(mask, noun, movable, score, fit)


def found(*cuts, **more):
    return segments(cuts, SIZE, **more)


def test_boxes_of_one_thing_are_one_whatever_they_are_called():
    boxes = np.array(
        [[10, 10, 50, 50], [11, 10, 51, 50], [10, 10, 50, 30], [60, 10, 60, 50]], float
    )
    assert distinct_boxes(boxes, np.array([0.5, 0.9, 0.7, 0.9])) == [1, 2]
    assert distinct_boxes(np.empty((0, 4)), np.empty(0)) == []


def test_pinholes_close_and_specks_go_and_rings_stay():
    ring = block((20, 20, 60, 60))
    ring[30:50, 30:50] = False
    dirty = ring.copy()
    dirty[25, 25] = False
    dirty[80, 100] = True
    assert np.array_equal(smooth_outline(dirty), ring)
    edge = block((0, 0, 10, 90))
    edge[40:50, 0] = False  # a notch at the border is no hole
    assert np.array_equal(smooth_outline(edge), edge)
    assert not smooth_outline(np.zeros(SIZE, bool)).any()


def test_pieces_are_those_with_a_gap_between():
    assert len(parts(block((10, 10, 30, 30), (32, 10, 50, 30)))) == 1  # 2 px
    first, second = parts(block((10, 10, 30, 30), (40, 10, 70, 30)))
    assert np.array_equal(first, block((40, 10, 70, 30)))
    assert np.array_equal(second, block((10, 10, 30, 30)))
    assert (
        len(parts(block((10, 10, 60, 60), (80, 10, 84, 14)))) == 1
    )  # too small to be one


def test_a_mask_in_pieces_is_several_objects():
    mask = block((10, 10, 30, 30), (40, 10, 70, 30))
    assert [one.box for one in split([cut(mask)])] == [
        (40, 10, 70, 30),
        (10, 10, 30, 30),
    ]
    table = cut(mask, "table", movable=False)
    assert split([table]) == [table]  # objects lie on it


def test_the_surer_of_two_masks_of_one_thing_stays():
    sure = cut(block((10, 10, 50, 50)), "box", score=0.9)
    weak = cut(block((10, 10, 50, 52)), "book", score=0.5)
    assert distinct([weak, sure]) == [sure]


def test_a_heap_gives_way_to_what_it_is_of():
    heap = cut(block((10, 10, 80, 40)), score=0.95)
    first, second = (
        cut(block((10, 10, 40, 40))),
        cut(block((45, 10, 80, 40)), score=0.7),
    )
    assert set(distinct([heap, first, second])) == {first, second}
    assert distinct([heap, second]) == [heap]  # a piece of it
    bowl = cut(block((10, 10, 80, 40)), "bowl", score=0.95)
    assert set(distinct([bowl, second])) == {bowl, second}  # in it


def test_small_things_lie_before_large_ones_that_are_not_much_surer():
    bowl, apple = (
        cut(block((10, 10, 80, 60)), "bowl"),
        cut(block((20, 20, 40, 40)), "apple", score=0.6),
    )
    outer, inner = resolve_overlaps([bowl, apple])
    assert inner.area == 20 * 20
    assert outer.area == 70 * 50 - 20 * 20
    assert not outer.mask[15, 15]
    doubtful = cut(block((20, 20, 40, 40)), "sticker", score=0.3)
    assert [one.noun for one in resolve_overlaps([bowl, doubtful])] == ["bowl"]
    box = cut(block((10, 10, 50, 60)), "box"), cut(block((48, 10, 85, 60)), "book")
    assert [one.noun for one in resolve_overlaps([bowl, *box])] == [
        "box",
        "book",
    ]  # they leave nothing of the bowl


def test_ids_run_left_to_right_and_scenery_lies_behind():
    result = found(
        cut(block((90, 40, 110, 60)), "cup", score=0.9, fit=0.9),
        cut(block((10, 40, 40, 60)), "ball", score=0.5),
        cut(block((0, 50, 120, 90)), "table", movable=False),
        cut(block((60, 10, 80, 30)), "toy", score=0.5, fit=0.4),
        cut(block((0, 0, 5, 5)), "speck"),
    )
    assert result.labels.dtype == np.uint16
    assert {i: name.label for i, name in result.names.items()} == {1: "ball", 2: "cup"}
    assert result.confidence == pytest.approx([0.5, 0.81])
    assert [doubt.confidence for doubt in result.doubtful] == [0.2]
    assert sorted(result.doubtful[0].polygon) == [
        (60, 10),
        (60, 29),
        (79, 10),
        (79, 29),
    ]
    assert result.scenery.nouns == {1: "table"}
    assert not (result.scenery.labels[result.labels > 0]).any()
    assert np.count_nonzero(result.scenery.labels) == 40 * 120 - 10 * 20 - 10 * 30
