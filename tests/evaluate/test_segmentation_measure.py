"""`physgen evaluate segmentation FOLDER`: what it reads, writes, prints and refuses."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen.cli.main import main
from physgen.evaluate.segmentation import evaluate, pairs
from physgen.problems import InputError

DISCS = [(60, 60, 24), (150, 70, 28), (110, 150, 26), (24, 180, 28)]


def drawn(shift: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Four matt balls lit from above on plain ground, the last one cut by the border, and their ids."""
    rgb, labels = np.full((220, 220, 3), 90, np.uint8), np.zeros((220, 220), np.uint16)
    y, x = np.mgrid[:220, :220]
    for k, (cx, cy, radius) in enumerate(DISCS):
        inside = np.hypot(x - cx - shift, y - cy) <= radius
        up, away = (y - cy) / radius, np.hypot(x - cx - shift, y - cy) / radius
        light = 0.35 + 0.65 * np.clip(
            0.6 * np.sqrt(np.clip(1 - away**2, 0, 1)) - 0.8 * up, 0, 1
        )
        rgb[inside] = (light[..., None] * (230, 90 + 40 * k, 60))[inside]
        labels[inside] = k + 1
    grain = np.random.default_rng(0).normal(0, 2, rgb.shape)
    return np.clip(cv2.GaussianBlur(rgb, (0, 0), 0.7) + grain, 0, 255).astype(
        np.uint8
    ), labels


def put(path: Path, picture: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), picture if picture.ndim == 2 else picture[..., ::-1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Each layout once: ids of 16 bits beside, colours beside a JPEG, a folder with assets, ids of 8 bits."""
    root = tmp_path_factory.mktemp("photos")
    rgb, labels = drawn()
    put(root / "a.png", rgb)
    put(root / "a.labels.png", labels)
    put(root / "b.jpg", rgb)
    put(
        root / "b.labels.png",
        np.array(
            [[0, 0, 0], [255, 0, 0], [0, 255, 0], [9, 9, 200], [7, 1, 1]], np.uint8
        )[labels],
    )
    put(root / "c" / "photo.png", rgb)
    put(root / "c" / "photo.assets" / "masks.png", labels)
    put(root / "d.webp", rgb)
    put(root / "d.labels.png", labels.astype(np.uint8))
    return root


@pytest.mark.slow
def test_every_layout_tells_the_same(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate", "segmentation", str(folder), "--json"]) == 0
    told = capsys.readouterr()
    assert told.err == ""
    found = json.loads(told.out)
    assert [row["photo"] for row in found["rows"]] == ["a", "b", "c", "d"]
    for row in found["rows"]:
        assert (row["true"], row["hit"]) == (4, 4)
        assert row["iou"] > 0.9
    total = found["total"]
    assert total["true"] == 16
    assert total["recall"] == 1
    assert found["passed"] is True
    assert 0 <= total["error"] <= 1
    by_iou = total["ap_by_iou"]
    assert [one["iou"] for one in by_iou] == [
        0.5,
        0.55,
        0.6,
        0.65,
        0.7,
        0.75,
        0.8,
        0.85,
        0.9,
        0.95,
    ]
    assert np.mean([one["ap"] for one in by_iou]) == pytest.approx(total["ap"])
    assert by_iou[0]["ap"] == total["ap50"] >= by_iou[-1]["ap"]


@pytest.mark.slow
def test_tables_and_pictures(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "deep" / "out"
    arguments = [
        "evaluate",
        "segmentation",
        str(folder),
        "-o",
        str(out),
        "--backend",
        "segment=learned",
    ]
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert re.search(r"^a +4 +4 +4 +1\.000", text, re.M)
    record = json.loads((out / "result.json").read_text())
    assert (record["measure"], record["passed"]) == ("segmentation", True)
    page = (out / "index.html").read_text()
    assert "average precision at IoU" in page


@pytest.mark.slow
def test_photos_that_stand_alone_are_told_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rgb, labels = drawn()
    put(tmp_path / "a.png", rgb)
    put(tmp_path / "a.labels.png", labels)
    put(tmp_path / "lonely.png", rgb)
    put(tmp_path / "ghost.labels.png", labels)
    assert main(["evaluate", "segmentation", str(tmp_path), "--json"]) == 0
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 2
    assert any("lonely.png: warning: is left out" in line for line in told)
    assert any("ghost.labels.png: warning: has no photo" in line for line in told)


def test_names_stay_apart_and_inside(tmp_path: Path) -> None:
    rgb, labels = drawn()
    for place in ("", "one", "two words"):
        put(tmp_path / place / "a.png", rgb)
        put(tmp_path / place / "a.labels.png", labels)
    found, _ = pairs(tmp_path)
    assert [pair.name for pair in found] == ["a", "one-a", "two-words-a"]


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("missing", "no such file or folder; check the path"),
        (
            "empty",
            "has no photo with a label map; put NAME.labels.png beside each NAME.png",
        ),
        (
            "size",
            "100 x 90 px differs from the photo's 220 x 220 px; make it the photo's size",
        ),
        ("broken", "is not a picture that can be read"),
        ("twins", "could both be its photo; keep one of them"),
        ("backend", '--backend: "label" is not used here; write segment=NAME'),
        ("output", "is a file"),
    ],
)
def test_refusals(
    case: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root, more = tmp_path / "in", list[str]()
    root.mkdir()
    rgb, labels = drawn()
    if case not in ("empty", "missing"):
        put(root / "a.png", rgb)
        put(root / "a.labels.png", labels)
    if case == "missing":
        root = root / "nowhere"
    if case == "size":
        put(root / "a.labels.png", labels[:90, :100])
    if case == "broken":
        (root / "a.png").write_bytes(b"not a picture")
    if case == "twins":
        put(root / "a.jpg", rgb)
    if case == "backend":
        more = ["--backend", "label=shape"]
    if case == "output":
        (tmp_path / "taken").write_text("")
        more = ["-o", str(tmp_path / "taken")]
    assert main(["evaluate", "segmentation", str(root), *more]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert message in told.err
    assert len(told.err.splitlines()) == 1


def test_every_problem_is_told_at_once(tmp_path: Path) -> None:
    rgb, labels = drawn()
    for name in "ab":
        put(tmp_path / f"{name}.png", rgb)
        put(tmp_path / f"{name}.labels.png", labels[:50])
    with pytest.raises(InputError) as error:
        evaluate(pairs(tmp_path)[0])
    assert len(error.value.problems) == 2
