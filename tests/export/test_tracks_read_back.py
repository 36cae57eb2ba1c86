"""Tracks as others read them: motmetrics and TrackEval; truth against itself, and against what has known faults."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import motmetrics
import numpy as np
import pytest
import trackeval
from labelled import Labelled, hall, labelled
from pycocotools import mask as coco_mask
from pytest import approx

QUIET = {"PRINT_RESULTS": False, "PRINT_CONFIG": False, "TIME_PROGRESS": False, "DISPLAY_LESS_PROGRESS": True}
QUIET |= {
    "OUTPUT_SUMMARY": False,
    "OUTPUT_DETAILED": False,
    "PLOT_CURVES": False,
    "PRINT_ONLY_COMBINED": True,
}


@pytest.fixture(scope="module")
def clip(tmp_path_factory) -> Labelled:
    home = tmp_path_factory.mktemp("tracks")
    return labelled(hall(home), home / "out", "coco,mot,mots")


def rows_of(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def scores(data, *metrics):
    with contextlib.redirect_stdout(io.StringIO()):
        found, _ = trackeval.Evaluator(QUIET).evaluate([data], list(metrics))
    return next(iter(found.values()))


def faults(clip: Labelled, guesses: Path) -> dict[str, tuple[float, int, int]]:
    """MOTA, misses and switches of each folder of `guesses`, as TrackEval counts them; all classes are one."""
    told = {
        "GT_FOLDER": str(clip.folder / "mot"),
        "TRACKERS_FOLDER": str(guesses),
        "SEQ_INFO": {"hall": None},
    }
    told |= {"SKIP_SPLIT_FOL": True, "BENCHMARK": "MOT15", "PRINT_CONFIG": False}
    with contextlib.redirect_stdout(io.StringIO()):
        data = trackeval.datasets.MotChallenge2DBox(told)
    found = scores(data, trackeval.metrics.CLEAR({"PRINT_CONFIG": False}))
    rows = {who: found[who]["hall"]["pedestrian"]["CLEAR"] for who in data.tracker_list}
    return {who: (row["MOTA"], row["CLR_FN"], row["IDSW"]) for who, row in rows.items()}


def test_mot_is_perfect_and_its_faults_are_counted(clip: Labelled, tmp_path) -> None:
    rows = [row.split(",")[:7] for row in rows_of(clip.folder / "mot/hall/gt/gt.txt")]
    # two tracks change names from the sixth frame on
    names = {"3": "4", "4": "3"}
    swapped = [[f[0], names.get(f[1], f[1]) if int(f[0]) > 5 else f[1], *f[2:]] for f in rows]
    for who, guess in (("same", rows), ("less", rows[1:]), ("swapped", swapped)):
        (tmp_path / who / "data").mkdir(parents=True)
        (tmp_path / who / "data/hall.txt").write_text("".join(f"{','.join(f)}\n" for f in guess))
    found = faults(clip, tmp_path)
    assert found["same"] == (1, 0, 0)
    assert found["less"] == (approx(1 - 1 / len(rows)), 1, 0)
    assert found["swapped"] == (approx(1 - 2 / len(rows)), 0, 2)


def test_mot_boxes_hold_all_of_what_is_in_the_picture(clip: Labelled) -> None:
    read = motmetrics.io.loadtxt(str(clip.folder / "mot/hall/gt/gt.txt"), fmt="mot16")
    labels = rows_of(clip.folder / "mot/hall/gt/labels.txt")
    whole = clip.whole
    assert len(read) == len(whole)
    for (frame, name), mask in whole.items():
        row = read.loc[(frame + 1, clip.names.index(name) + 1)]
        x, y, w, h = coco_mask.toBbox(coco_mask.encode(np.asfortranarray(mask.astype(np.uint8))))
        inside = max(row.X, 0), max(row.Y, 0), min(row.X + row.Width, 96), min(row.Y + row.Height, 72)
        assert inside == (x, y, x + w, y + h)
        if inside == (row.X, row.Y, row.X + row.Width, row.Y + row.Height):
            assert row.Visibility == approx(clip.mask(frame, name).sum() / mask.sum(), abs=1e-5)
        assert labels[int(row.ClassId) - 1] == clip.filming.scene.objects[clip.names.index(name)].label


def test_what_leaves_the_picture_keeps_its_size(clip: Labelled) -> None:
    read = motmetrics.io.loadtxt(str(clip.folder / "mot/hall/gt/gt.txt"), fmt="mot16")
    ball = read.xs(clip.names.index("ball") + 1, level="Id")
    visible = []
    for frame, row in ball.iterrows():
        center = 70 + (105 - 70) * (frame - 1) / 8
        assert row.Width == approx(18, abs=1.1)
        assert row.X + row.Width / 2 == approx(center + 0.5, abs=0.6)
        # a circle's segment is what is left of it
        part = np.clip((95.5 - center) / 9, -1, 1)
        visible.append((row.Visibility, 1 - (np.arccos(part) - part * np.sqrt(1 - part**2)) / np.pi))
    found, true = np.array(visible).T
    assert found == approx(true, abs=0.03)
    assert found[0] == 1
    assert found[-1] < 0.5


def test_mots_masks_are_the_ids_and_perfect(clip: Labelled, tmp_path) -> None:
    home = clip.folder / "mots"
    seen = [np.zeros((72, 96), np.uint16) for _ in clip.ids]
    for row in rows_of(home / "hall/gt/gt.txt"):
        frame, track, kind, height, width, counts = row.split(" ")
        assert kind == "2"
        mask = coco_mask.decode({"size": [int(height), int(width)], "counts": counts.encode()})
        seen[int(frame) - 1] += np.uint16(int(track) - 2000) * mask
    assert all(np.array_equal(mine, ids) for mine, ids in zip(seen, clip.ids, strict=True))
    (tmp_path / "same/data").mkdir(parents=True)
    (tmp_path / "same/data/hall.txt").write_text((home / "hall/gt/gt.txt").read_text())
    told = {
        "GT_FOLDER": str(home),
        "TRACKERS_FOLDER": str(tmp_path),
        "SKIP_SPLIT_FOL": True,
        "SEQ_INFO": {"hall": None},
    }
    data = trackeval.datasets.MOTSChallenge(told | {"PRINT_CONFIG": False})
    found = scores(data, trackeval.metrics.HOTA({"PRINT_CONFIG": False}))["same"]["hall"]["pedestrian"][
        "HOTA"
    ]
    assert found["HOTA"].min() == 1


def test_coco_tracks_are_read_as_taos(clip: Labelled, tmp_path) -> None:
    rows = [row | {"score": 1.0} for row in clip.coco.dataset["annotations"]]
    (tmp_path / "same/data").mkdir(parents=True)
    (tmp_path / "same/data/tracks.json").write_text(json.dumps(rows))
    told = {"GT_FOLDER": str(clip.folder / "coco"), "TRACKERS_FOLDER": str(tmp_path), "PRINT_CONFIG": False}
    data = trackeval.datasets.TAO(told)
    assert data.class_list == ["ball", "post", "tile"]
    found = scores(data, trackeval.metrics.HOTA({"PRINT_CONFIG": False}))["same"]["hall"]
    assert all(found[name]["HOTA"]["HOTA"].min() == 1 for name in data.class_list)
