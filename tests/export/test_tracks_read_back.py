"""Tracks as others read them: motmetrics and TrackEval; truth against itself, and against what has known faults."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import motmetrics
import numpy as np
import trackeval
from labelled import Labelled, scores
from pycocotools import mask as coco_mask
from pytest import approx


def rows_of(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


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
        assert (row.X, row.Y, row.Width, row.Height) == (x, y, w, h)
        assert row.Visibility == approx(clip.mask(frame, name).sum() / mask.sum(), abs=1e-5)
        assert labels[int(row.ClassId) - 1] == clip.filming.scene.objects[clip.names.index(name)].label


def test_coco_tracks_are_read_as_taos(clip: Labelled, tmp_path) -> None:
    rows = [row | {"score": 1.0} for row in clip.coco.dataset["annotations"]]
    (tmp_path / "same/data").mkdir(parents=True)
    (tmp_path / "same/data/tracks.json").write_text(json.dumps(rows))
    told = {"GT_FOLDER": str(clip.folder / "coco"), "TRACKERS_FOLDER": str(tmp_path), "PRINT_CONFIG": False}
    data = trackeval.datasets.TAO(told)
    assert data.class_list == ["ball", "post", "tile"]
    found = scores(data, trackeval.metrics.HOTA({"PRINT_CONFIG": False}))["same"]["hall"]
    assert all(found[name]["HOTA"]["HOTA"].min() == 1 for name in data.class_list)
