"""The view by a photo's looks: chances, tilt, and what perception makes of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physgen.perceive.backends import boundary_support
from physgen.perceive.perceive import perceive
from physgen.perceive.segment.network import BANDS, pool, run_network
from physgen.perceive.segment.prompts import from_masks
from physgen.perceive.support import viewpoint
from physgen.perceive.support.view_classifier import ViewChances, view_chances
from physgen.perceive.support.viewpoint import guess_view
from physgen.photos import read_photo
from physgen.scene.scene import View

SCENES = Path(__file__).parents[2] / "scenes"
SEEN_FROM_ABOVE = ("billiards", "curling")
SIDE = ViewChances(0.9, 0.08, 0.02, 0.1)
OBLIQUE = ViewChances(0.05, 0.9, 0.05, 0.1)
TOP = ViewChances(0.02, 0.08, 0.9, 0.1)


def plain() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A photo that has hardly a cue, its label map and the network's normals."""
    rgb = np.full((160, 240, 3), 150, np.uint8)
    labels = np.zeros((160, 240), np.uint16)
    rgb[80:120, 100:140], labels[80:120, 100:140] = (60, 80, 160), 1
    # the grain of a photo: a drawing has no looks
    rgb += np.random.default_rng(0).integers(0, 9, rgb.shape, np.uint8)
    normals = np.zeros((80, 120, 3), np.float32)
    normals[..., 2] = 1
    return rgb, labels, normals


@pytest.mark.parametrize("name", ["billiards", "curling", "cups", "kitchen", "marbles"])
def test_bundled_photos_keep_their_views(name: str) -> None:
    rgb = read_photo(SCENES / name / "photo.png").rgb
    chances = view_chances(run_network(rgb).features)
    assert (chances.top > 0.5) == (name in SEEN_FROM_ABOVE)
    assert chances.side + chances.oblique + chances.top == pytest.approx(1)
    assert chances.tilt is None


def test_mirrored_photo_has_the_same_chances() -> None:
    rgb = read_photo(SCENES / "toy-car" / "photo.png").rgb[::2, ::2]
    one = view_chances(run_network(np.ascontiguousarray(rgb)).features)
    other = view_chances(run_network(np.ascontiguousarray(rgb[:, ::-1])).features)
    assert one.top == pytest.approx(other.top, abs=0.02)
    assert one.side == pytest.approx(other.side, abs=0.02)


def test_pooling_weighs_rows_by_their_share() -> None:
    column = np.arange(4, dtype=np.float32)[None, :, None]
    pooled = pool([(np.repeat(column, 5, axis=2),)])
    third = 4 / BANDS  # rows of a band
    first = (0 * 1 + 1 * (third - 1)) / third
    assert pooled[0] == pytest.approx(first)
    assert pooled[1] == pytest.approx(1.5)
    assert pooled[2] == pytest.approx(3 - first)
    assert pooled[3] == pytest.approx(np.std(column))


def test_tilt_grows_with_the_chance_of_top() -> None:
    assert SIDE.tilt is None
    tilts = [ViewChances(0.9 - t - 0.5, 0.6, t, 0).tilt for t in (0.0, 0.2, 0.38)]
    assert tilts == sorted(tilts)
    assert all(30 <= tilt <= 60 and tilt % 5 == 0 for tilt in tilts)


def test_looks_decide_if_cues_are_weak() -> None:
    photo = plain()
    for chances, view in ((SIDE, View.SIDE), (OBLIQUE, View.SIDE), (TOP, View.TOP)):
        found, sure, reason = guess_view(*photo, 0, 0, chances)
        assert found is view
        assert sure > 0.75
        assert reason


def test_looks_of_a_drawing_are_ignored() -> None:
    _, labels, normals = plain()
    drawing = np.full((160, 240, 3), 150, np.uint8)
    drawing[labels > 0] = (60, 80, 160)
    assert guess_view(drawing, labels, normals, 0, 4, TOP)[0] is View.SIDE


def test_cues_decide_if_looks_are_unsure() -> None:
    unsure = ViewChances(0.3, 0.15, 0.55, 0.1)
    photo = plain()
    assert guess_view(*photo, 0, 4, unsure)[0] is View.SIDE
    assert guess_view(*photo, 6, 0, unsure)[0] is View.TOP


@pytest.mark.slow
@pytest.mark.parametrize(
    ("chances", "view", "tilt"),
    [(SIDE, "side", None), (OBLIQUE, "side", 45), (TOP, "top", None)],
)
def test_oblique_photo_gets_a_tilt(
    chances: ViewChances, view: str, tilt: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(boundary_support, "view_chances", lambda features: chances)
    rgb, labels, _ = plain()
    world = perceive(rgb, from_masks(labels)).document["world"]
    assert world["view"] == view
    assert world.get("tilt") == tilt


@pytest.mark.slow
def test_unsuitable_looks_are_a_doubt(monkeypatch: pytest.MonkeyPatch) -> None:
    rgb, labels, _ = plain()
    reasons = {}
    for chance in (0.1, 0.99):
        chances = ViewChances(0.9, 0.08, 0.02, chance)
        monkeypatch.setattr(viewpoint, "view_chances", lambda features, c=chances: c)
        found = from_masks(labels)
        object.__setattr__(found, "source", "learned")
        suits = perceive(rgb, found).suitability
        assert suits is not None
        reasons[chance] = set(suits.reasons)
    assert len(reasons[0.99] - reasons[0.1]) == 1
