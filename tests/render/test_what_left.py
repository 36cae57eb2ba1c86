"""What objects leave behind, beside the path tracer's picture of the empty place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.simulate.engine import simulate


@pytest.mark.parametrize("name", ["wall-ball", "rubber-balls"])
def test_objects_take_their_shadows_and_rims_with_them(bundled: Path, name: str) -> None:
    scene = pipeline.load(bundled / name / "scene.yaml")
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    track = simulate(compiled.world, np.array([0.0, 0.1]))
    away = replace(track, poses=track.poses + np.array([[[0.0, 0, 0]], [[1e5, 1e5, 0]]]))
    first, empty = (
        frame.rgb.astype(int) for frame in pipeline.render(pipeline.stage(scene, compiled, maps), away)
    )
    assert np.abs(first - maps.rgb).max() <= 1
    old = np.abs(maps.rgb.astype(int) - maps.clean).max(axis=2) > 20
    assert np.count_nonzero(old) > 3000
    off = np.abs(empty - maps.clean).max(axis=2)
    assert np.percentile(off[old], 99) <= 3
    assert off[old].max() <= 16


def test_shadows_of_many_leave_light_and_end_at_their_shelf(bundled: Path) -> None:
    """Three books lean together at the end: their shadows stay out of the shelf below, and nothing is black."""
    scene = pipeline.load(bundled / "shelf" / "scene.yaml")
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    track = simulate(compiled.world, np.array([0.0, 1.5]))
    _, last = (
        frame.rgb.astype(int) for frame in pipeline.render(pipeline.stage(scene, compiled, maps), track)
    )
    assert np.count_nonzero(last.max(axis=2) < 4) < 20
    assert np.abs(last - maps.rgb)[470:, 20:490].max() <= 8
