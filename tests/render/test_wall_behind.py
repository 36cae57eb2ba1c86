"""Floors that the photo's own shadows pass by take none: they end on the wall behind."""

from __future__ import annotations

import numpy as np

from physgen.render.floors import shadows_pass_below


def test_a_line_in_the_air_lets_shadows_by_and_a_floor_does_not():
    labels = np.zeros((100, 160), np.uint16)
    labels[20:41, 30:50], labels[20:41, 70:90] = 1, 2
    line, ground = (
        np.array([0.0, 41.0, 159.0, 41.0]),
        np.array([0.0, 90.0, 159.0, 90.0]),
    )
    behind, on_it = np.zeros_like(labels), np.zeros_like(labels)
    behind[60:75, 50:70], behind[60:75, 90:110] = 1, 2
    on_it[36:42, 50:70], on_it[36:42, 90:110] = 1, 2
    assert shadows_pass_below(line, labels, behind)
    assert not shadows_pass_below(line, labels, on_it)  # it caught them
    assert not shadows_pass_below(ground, labels, behind)  # nothing stands on it
    assert not shadows_pass_below(line, np.zeros_like(labels), behind)
    behind[60:75, 50:70] = 0  # one thing's shadow is not seen: the other's tells
    assert shadows_pass_below(line, labels, behind)
