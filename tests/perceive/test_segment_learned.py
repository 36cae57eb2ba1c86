"""The default segmenter on what is no ordinary photo; empty scenes; doubtful things that a person switches on."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.geometry.fitting import fit_outlines
from physgen.geometry.polygon import Disc
from physgen.perceive.backends.segment_learned import (
    continued_colours,
    own_box,
    segment,
)
from physgen.perceive.perceive import perceive
from physgen.perceive.roles import Detections, Doubt
from physgen.perceive.scene_files import write_scene
from physgen.perceive.segment.evidence import FEATURES
from physgen.perceive.segment.proposals import Proposal


def noise(size: tuple[int, int]) -> np.ndarray:
    return np.random.default_rng(3).integers(0, 256, (*size, 3), np.uint8)


def text() -> np.ndarray:
    page = np.full((300, 240, 3), 245, np.uint8)
    for k in range(12):
        cv2.putText(
            page,
            "lorem ipsum dolor",
            (10, 30 + 22 * k),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.6,
            (20, 20, 20),
            1,
        )
    return page


def many() -> np.ndarray:
    """200 coins."""
    tray = np.full((400, 800, 3), (60, 70, 90), np.uint8)
    for k in range(200):
        at = 20 + 40 * (k % 20), 20 + 40 * (k // 20)
        cv2.circle(tray, at, 14, (200, 150 + k % 60, 60), -1, cv2.LINE_AA)
    return tray


@pytest.mark.slow
@pytest.mark.parametrize(
    "photo",
    [
        noise((128, 160)),
        np.full((90, 120, 3), 128, np.uint8),
        np.zeros((64, 64, 3), np.uint8),
        text(),
        cv2.GaussianBlur(noise((40, 700)), (0, 0), 4),
        many(),
    ],
    ids=["noise", "grey", "black and small", "text", "wide and blurred", "many"],
)
def test_any_picture_gives_labels_in_order(photo) -> None:
    found = segment(photo)
    assert found.labels.shape == photo.shape[:2]
    ids = np.unique(found.labels)
    assert ids[ids > 0].tolist() == list(range(1, len(found.confidence) + 1))
    assert ((found.confidence >= 0.25) & (found.confidence <= 1)).all()
    middles = [
        np.nonzero(found.labels == i)[1].mean()
        for i in range(1, len(found.confidence) + 1)
    ]
    assert middles == sorted(middles)
    assert all(
        0 < doubt.confidence < 1 and len(doubt.polygon) >= 3 for doubt in found.doubtful
    )
    again = segment(photo)
    assert (again.labels == found.labels).all()
    assert (again.confidence == found.confidence).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "count", "quality"),
    [("dominoes", 9, 70), ("dominoes", 9, 50), ("billiards", 16, 50)],
)
def test_compressed_photos_show_the_same_objects(
    name: str, count: int, quality: int
) -> None:
    """A gap between dominoes had become a block, and balls of a rack polygons."""
    photo = cv2.imread(str(Path(__file__).parents[2] / "scenes" / name / "photo.png"))
    packed = cv2.imencode(".jpg", photo, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    found = segment(
        np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR)[..., ::-1], np.uint8)
    )
    assert len(found.confidence) == count
    outlines = fit_outlines(found.labels, range(1, count + 1))
    assert all(isinstance(one, Disc) for one in outlines.values()) == (
        name == "billiards"
    )


@pytest.mark.parametrize("size", [(10, 400), (400, 10), (8, 1600)])
def test_photos_of_a_few_rows_or_columns(size: tuple[int, int]) -> None:
    """The network's map of them is narrower than its pairs of pixels are apart."""
    assert not len(segment(noise(size)).confidence)


def test_a_photo_without_objects_becomes_an_empty_scene(tmp_path: Path) -> None:
    rgb = np.full((96, 128, 3), (90, 120, 140), np.uint8)
    made = perceive(rgb, Detections(np.zeros((96, 128), np.uint16), "learned", {}, {}))
    out = tmp_path / "empty.yaml"
    said = write_scene(made, None, "empty", out)
    assert "no region of the photo looks like" in said
    scene = pipeline.load(out, ["render.frames=2"])
    assert not scene.objects
    folder = pipeline.render_scene(
        out, tmp_path / "out", overrides=["render.frames=2", "world.duration=0.1"]
    )
    assert (folder / "video.mp4").exists()


def test_a_doubtful_thing_can_be_switched_on(tmp_path: Path) -> None:
    rgb = np.full((120, 160, 3), (40, 60, 50), np.uint8)
    labels = np.zeros((120, 160), np.uint16)
    cv2.circle(rgb, (40, 60), 20, (200, 80, 60), -1)
    cv2.circle(rgb, (110, 60), 20, (60, 80, 200), -1)
    labels[
        np.hypot(*(np.mgrid[:120, :160] - np.array([60, 40])[:, None, None])) <= 20
    ] = 1
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    round_ = [
        (round(110 + 20 * float(np.cos(a)), 1), round(60 + 20 * float(np.sin(a)), 1))
        for a in turn
    ]
    found = Detections(labels, "learned", {1: 0.9}, {}, doubtful=[Doubt(round_, 0.31)])
    out = tmp_path / "scene.yaml"
    said = write_scene(perceive(rgb, found), None, "photo", out)
    assert len(pipeline.load(out).objects) == 1
    line = "  maybe-1: {mask: 2, confidence: 0.31}\n"
    assert line in said
    moved = (
        said.replace(line, "")
        .replace("  ball-1:", f"{line}  ball-1:")
        .replace("doubtful:", "#")
    )
    out.write_text(moved)
    scene = pipeline.load(out)
    assert [one.name for one in scene.objects] == ["ball-1", "maybe-1"]
    compiled = pipeline.compile(scene, pipeline.percepts(scene))
    x, y = compiled.world.bodies[1].center
    assert abs(x - 110) < 1
    assert abs(y - 60) < 1


def test_gap_shows_colours_around_it() -> None:
    random = np.random.default_rng(0)
    rgb = random.normal((90, 60, 40), 6, (120, 160, 3))
    rgb = np.clip(rgb, 0, 255).astype(np.uint8)
    chosen = [
        Proposal(left, 30, np.ones((60, 20), bool), 1200) for left in (40, 60, 80)
    ]
    rgb[30:90, 40:60] = rgb[30:90, 80:100] = (220, 210, 170)
    shares = continued_colours(rgb, chosen, (120, 160))
    assert shares[1] > 0.9
    assert max(shares[0], shares[2]) < 0.1
    assert continued_colours(rgb, [], (120, 160)).shape == (0,)


def test_object_with_own_box_is_no_gap() -> None:
    features = np.zeros((3, len(FEATURES)))
    features[:, FEATURES.index("movable box")] = 0.2, 0.6, 0.8
    sureness = own_box(features)
    assert sureness[0] == 0
    assert 0 < sureness[1] < 1
    assert sureness[2] == 1
