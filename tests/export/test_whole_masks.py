"""Whole masks against scenes without what hides them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from labelled import ROOT, Labelled, labelled

CROSSING = (
    "objects.*.motion=static",
    "objects.ball.motion={path: [[0, 49.28, 273.28], [0.2, 400, 390, 90]]}",
    "objects.ball.velocity=",
    "objects.ball.spin=",
    "objects.ball.layer=5",
    "forces=[]",
    "render.frames=2",
    "world.duration=0.2",
)
"""A ball flies past tins that stand; both are soft at their borders."""
FILMED = (
    "render.camera=[{time: 0, center: [230, 330], zoom: 1.7}, {time: 0.2, center: [290, 330], zoom: 2.3}]",
    "render.size=[200, 160]",
    "render.play=there-and-back",
    "render.motion_blur=0.5",
    "render.fps=10",
    "render.slow=1.5",
)


def without(clip: Labelled, *names: str) -> Labelled:
    """The same scene where some things are not; nothing is exported."""
    return Labelled(
        clip.scene, (*clip.edits, *(f"objects.{name}=" for name in names)), Path()
    )


def test_a_whole_mask_is_what_is_seen_when_nothing_else_is_there(
    clip: Labelled,
) -> None:
    whole = clip.whole
    for name in clip.names:
        alone = without(clip, *(other for other in clip.names if other != name))
        for frame in range(len(clip.ids)):
            found = whole.get((frame, name), np.zeros((72, 96), bool))
            assert np.array_equal(found, alone.mask(frame, name))


def test_what_is_hidden_altogether_is_told_of_apart(clip: Labelled) -> None:
    hidden = clip.coco.dataset["hidden_annotations"]
    assert {
        (row["image_id"] - 1, clip.names[row["track_id"] - 1]) for row in hidden
    } == {(frame, "post") for frame in range(8) if not clip.mask(frame, "post").any()}
    assert hidden
    assert all(
        row["visible_fraction"] == 0 and row["amodal_area"] > 100 for row in hidden
    )
    tile = [
        row
        for row in clip.coco.dataset["annotations"]
        if row["track_id"] == clip.names.index("tile") + 1
    ]
    fractions = [row["visible_fraction"] for row in tile]
    assert fractions[0] == 1
    assert min(fractions) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("film", [(), FILMED], ids=["plain", "filmed"])
def test_of_a_photo_too_however_it_is_filmed(film: tuple[str, ...], tmp_path) -> None:
    photo = ROOT / "scenes/cans/scene.yaml"
    clip = labelled(photo, tmp_path, "coco", *CROSSING, *film)
    whole = clip.whole
    assert len(clip.ids) == (5 if film else 2)
    assert (
        min(row["visible_fraction"] for row in clip.coco.dataset["annotations"]) < 0.8
    )
    for name in ("ball", "tin-5"):
        alone = without(clip, *(other for other in clip.names if other != name))
        masks = [alone.mask(k, name) for k in range(len(clip.ids))]
        assert {k for k, mask in enumerate(masks) if mask.any()} == {
            k for k, other in whole if other == name
        }
        for k, mask in enumerate(masks):
            if mask.any():  # slivers along a border that two claim belong to one of them where both are there
                off = (whole[k, name] != mask).astype(np.uint8)
                assert not cv2.morphologyEx(
                    off, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
                ).any()
    # tins touch: that one is taken away leaves their common border where it was
    fewer = labelled(
        photo, tmp_path / "fewer", "coco", *without(clip, "ball", "tin-6").edits
    )
    assert all(np.array_equal(mask, whole[key]) for key, mask in fewer.whole.items())
    assert len(whole) - len(fewer.whole) == sum(
        name in ("ball", "tin-6") for _, name in whole
    )
