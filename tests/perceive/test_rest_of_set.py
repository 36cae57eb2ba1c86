"""One more ball of a set, where a doubtful region has room for just that."""

from __future__ import annotations

import numpy as np

from physgen.perceive.backends.segment_learned import with_rest_of_set
from physgen.perceive.roles import Doubt, Segments

R = 20.0
CENTER = np.array([100.0, 90.0])


def rack(radii: list[float]) -> Segments:
    """Six discs that touch one in their middle, which is found as a speck alone."""
    rows, columns = np.mgrid[:180, :200]
    labels = np.zeros(rows.shape, np.uint16)
    for k, radius in enumerate(radii):
        x, y = CENTER + 2 * R * np.array([np.cos(k * np.pi / 3), np.sin(k * np.pi / 3)])
        labels[np.hypot(columns - x, rows - y) < radius] = k + 1
    x, y = CENTER
    speck = Doubt([(x - 4, y - 4), (x + 4, y - 4), (x + 4, y + 4), (x - 4, y + 4)], 0.2)
    apart = Doubt([(2.0, 2.0), (12.0, 2.0), (12.0, 12.0), (2.0, 12.0)], 0.2)
    return Segments(labels, np.ones(len(radii)), [speck, apart])


def test_the_ball_between_six_others_is_found() -> None:
    found = with_rest_of_set(rack([R - 0.5] * 6))
    assert len(found.confidence) == 7
    assert len(found.doubtful) == 1
    new = found.labels == 1 + int(np.flatnonzero(found.confidence < 1)[0])
    rows, columns = np.nonzero(new)
    assert np.abs([columns.mean() - CENTER[0], rows.mean() - CENTER[1]]).max() < 1
    assert abs(np.sqrt(new.sum() / np.pi) - R) < 1.5


def test_part_of_a_ball_between_six_others_becomes_the_ball() -> None:
    six = rack([R - 0.5] * 6)
    labels = six.labels.copy()
    x, y = CENTER.astype(int)
    labels[y - 14 : y + 2, x - 12 : x + 6] = 7
    labels[160:, 2:62] = 8  # a block as thick as a ball, at the border, stays
    found = with_rest_of_set(
        Segments(labels, np.array([1, 1, 1, 1, 1, 1, 0.5, 0.6]), [])
    )
    ball = found.labels == 1 + int(np.flatnonzero(found.confidence == 0.5)[0])
    assert abs(np.sqrt(ball.sum() / np.pi) - R) < 1.5
    assert (
        found.labels == 1 + int(np.flatnonzero(found.confidence == 0.6)[0])
    ).sum() == 1200


def test_the_band_of_a_ball_in_the_open_becomes_the_ball() -> None:
    rows, columns = np.mgrid[:180, :320]
    discs = [np.hypot(columns - 30 - 2.5 * R * k, rows - 90) < R for k in range(6)]
    labels = (np.array(discs) * np.arange(1, 7)[:, None, None]).max(0).astype(np.uint16)
    labels[discs[3] & (np.abs(rows - 90) > 11)] = 0
    labels[140:146, 150:160] = 7  # a small block stays
    found = with_rest_of_set(Segments(labels, np.array([1, 1, 1, 0.5, 1, 1, 0.6]), []))
    ball = found.labels == 1 + int(np.flatnonzero(found.confidence == 0.5)[0])
    assert (ball & discs[3]).sum() > 0.95 * (ball | discs[3]).sum()
    assert (
        found.labels == 1 + int(np.flatnonzero(found.confidence == 0.6)[0])
    ).sum() == 60


def test_discs_of_many_sizes_are_no_set() -> None:
    various = rack([8, 10, 13, 16, 18, 19.5])
    assert with_rest_of_set(various) is various
