"""Random homes: meshes closed, placements apart, stored validation photos that agree with themselves. No Mitsuba."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT))
from studio.segmentation.homes import roster  # noqa: E402
from studio.segmentation.homes.composition import shot  # noqa: E402
from studio.segmentation.homes.parts import FINISHES  # noqa: E402
from studio.segmentation.homes.placement import apart  # noqa: E402
from studio.segmentation.homes.solids import (  # noqa: E402
    ball,
    box,
    corner_normals,
    open_edges,
    volume,
)

VALIDATION = ROOT / "studio/segmentation/validation"


def test_volumes_are_those_of_geometry():
    assert volume(ball(0.1, 80, 41)) == pytest.approx(4 / 3 * np.pi * 0.1**3, rel=0.01)
    assert volume(box([0.1, 0.2, 0.3], 0.0005)) == pytest.approx(0.006, rel=0.01)


def test_a_balls_normals_point_away_from_its_middle():
    solid = ball(1.0)
    normals = corner_normals(solid, np.zeros(len(solid.faces), int))
    assert np.einsum("fci,fci->fc", normals, solid.vertices[solid.faces]).min() > 0.95


@pytest.mark.parametrize("kind", roster.KINDS)
def test_things_are_closed_and_stand_on_the_ground(kind: str):
    thing = roster.KINDS[kind](np.random.default_rng(1))
    points = np.concatenate([part.solid.vertices for part in thing.parts])
    assert np.isfinite(points).all()
    assert points[:, 2].min() == pytest.approx(0, abs=1e-9)
    assert points[:, 2].max() == pytest.approx(thing.height, abs=1e-9)
    for part in thing.parts:
        assert part.finish in FINISHES
        assert volume(part.solid) > 0
        assert open_edges(part.solid) == 0
        assert part.print.min() >= 0
        assert part.print.max() <= 1.001


@pytest.mark.parametrize("seed", range(8))
def test_what_stands_by_itself_overlaps_nothing(seed: int):
    alone = [p for p in shot(seed, 64).placed if not p.held]
    for k, one in enumerate(alone):
        for other in alone[k + 1 :]:
            assert one.base != other.base or apart(one.foot, other.foot, 0)


def test_the_same_seed_is_the_same_shot():
    one, other = shot(5, 64), shot(5, 64)
    assert [p.kind for p in one.placed] == [p.kind for p in other.placed]
    assert np.array_equal(one.camera.eye, other.camera.eye)


def test_stored_photos_agree_with_their_labels():
    told = json.loads((VALIDATION / "homes.json").read_text())
    assert len(told) == 24
    for stem, facts in told.items():
        labels = np.asarray(Image.open(VALIDATION / f"{stem}.labels.png"))
        with Image.open(VALIDATION / f"{stem}.jpg") as photo:
            assert photo.size == labels.shape[::-1]
            assert max(photo.size) == 384
        ids = sorted(set(np.unique(labels).tolist()) - {0, 65535})
        assert ids == list(range(1, len(facts["kinds"]) + 1))
        assert set(facts["truncated"]) <= set(ids)
        assert len(ids) >= 3
    size = sum(path.stat().st_size for path in VALIDATION.iterdir())
    assert size < 1.3e6
