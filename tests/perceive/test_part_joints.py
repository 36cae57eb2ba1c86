"""No line of background stays between a mask and a part added to it."""

from __future__ import annotations

import numpy as np

from physgen.perceive.part_joints import close_part_joints


def figure() -> tuple[np.ndarray, np.ndarray]:
    """Return the labels of a body, and with a tail beside it after a crack of 2 px."""
    before = np.zeros((120, 200), np.uint16)
    before[20:100, 20:100] = 3
    after = before.copy()
    after[40:60, 102:140] = 3
    return before, after


def test_crack_belongs_to_its_object():
    before, after = figure()
    closed = close_part_joints(before, after)
    assert (closed[42:58, 98:104] == 3).all()
    assert np.count_nonzero(closed != after) <= 2 * 22


def test_labels_without_added_parts_stay():
    _, labels = figure()
    assert np.array_equal(close_part_joints(labels, labels), labels)


def test_another_object_in_the_crack_stays():
    before, after = figure()
    before[30:70, 100:102] = after[30:70, 100:102] = 5
    closed = close_part_joints(before, after)
    assert np.array_equal(closed, after)


def test_mirrored_labels_are_closed_alike():
    before, after = figure()
    closed = close_part_joints(before, after)
    mirrored = close_part_joints(before[:, ::-1], after[:, ::-1])
    assert np.array_equal(mirrored[:, ::-1], closed)
