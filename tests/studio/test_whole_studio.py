"""The studio as a whole: scenes enough, the frozen split and its statistics, the clips, and what all weighs."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "studio"))
import measures  # noqa: E402  (needs no Mitsuba)
from split import digest, page  # noqa: E402

NAMES = sorted(
    path.parent.name for path in (ROOT / "studio/truth").glob("*/truth.json")
)
DIFFUSE = [
    n
    for n in NAMES
    if json.loads((ROOT / f"studio/truth/{n}/truth.json").read_text())["diffuse"]
]
FILMED = [n for n in NAMES if (ROOT / f"studio/truth/{n}/film").exists()]
SPLIT = json.loads((ROOT / "studio/split.json").read_text())


def picture(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path))


def test_there_are_scenes_enough() -> None:
    assert len(NAMES) >= 14
    assert len(FILMED) >= 6
    assert len(DIFFUSE) >= 2


def test_clips_vary_the_push() -> None:
    (folder,) = (ROOT / "studio/truth").glob("*/clips")
    about = json.loads((folder / "clips.json").read_text())
    assert len(about["clips"]) == 50
    assert len(about["times_s"]) == 8
    assert len({json.dumps(clip["set"]) for clip in about["clips"]}) == 50
    strips = [picture(folder / clip["clip"]) for clip in about["clips"]]
    assert {strip.shape for strip in strips} == {(256, 8 * 256, 3)}
    last = np.stack([strip[:, -256:].astype(np.float32) for strip in strips])
    empty = np.median(last, axis=0)
    scene = json.loads((folder.parent / "truth.json").read_text())
    (ball,) = [entry for entry in scene["objects"] if entry["name"] == "ball"]
    y, x = np.mgrid[:256, :256]
    scale = 256 / scene["size"][0]
    there, elsewhere = [], []
    for clip, picture_ in zip(about["clips"], last, strict=True):
        px, py = (np.array(clip["poses"]["ball"][-1][:2]) + 0.5) * scale - 0.5
        inside = np.hypot(x - px, y - py) < 0.8 * ball["circle"]["radius"] * scale
        off = np.abs(picture_ - empty).mean(-1)
        if inside.sum() > 50:
            there.append(off[inside].mean())
            elsewhere.append(off[~inside].mean())
    assert len(there) > 40
    assert np.median(there) > 5 * np.median(elsewhere), (
        "the ball is where its pose says"
    )


def test_split_is_frozen_and_fair() -> None:
    """`test` never changes: photo and masks by hash. And it is no easier than `tune`, by published means."""
    assert not set(SPLIT["tune"]) & set(SPLIT["test"])
    assert {*SPLIT["tune"], *SPLIT["test"]} == set(NAMES)
    assert min(len(SPLIT["tune"]), len(SPLIT["test"])) >= 6
    for name, frozen in SPLIT["sha256"].items():
        assert digest(name) == frozen, name
    assert set(SPLIT["sha256"]) == set(SPLIT["test"])
    tune, test = SPLIT["means"]["tune"], SPLIT["means"]["test"]
    for harder in ("objects", "touching_pairs", "faint_outline", "clutter"):
        assert test[harder] >= tune[harder], harder
    for easier in ("size_px", "outline_contrast"):
        assert test[easier] <= tune[easier], easier


def test_statistics_are_those_of_the_pictures() -> None:
    rows = {
        n: measures.measure(ROOT / "scenes" / n, ROOT / "studio/truth" / n)
        for n in NAMES
    }
    for name, row in rows.items():
        assert row == pytest.approx(SPLIT["scenes"][name], abs=0.06, rel=0.02), name
    assert measures.halves(SPLIT, SPLIT["scenes"]) == SPLIT["means"]


def test_the_repository_stays_small() -> None:
    folders = (ROOT / "scenes", ROOT / "studio", ROOT / "docs")
    assert (
        sum(p.stat().st_size for f in folders for p in f.rglob("*") if p.is_file())
        < 36e6
    )


def test_the_page_is_what_the_split_says() -> None:
    assert (ROOT / "studio/scenes.md").read_text() == page(SPLIT)
