"""Tracks as another program reads them: TrackEval, truth against itself and against known faults."""

from __future__ import annotations

import contextlib
import csv
import io
import json
from pathlib import Path

import numpy as np
import trackeval
from labelled import Labelled, scores
from pycocotools import mask as coco_mask
from pytest import approx


def test_coco_tracks_are_read_as_taos(clip: Labelled, tmp_path) -> None:
    rows = [row | {"score": 1.0} for row in clip.coco.dataset["annotations"]]
    (tmp_path / "same/data").mkdir(parents=True)
    (tmp_path / "same/data/tracks.json").write_text(json.dumps(rows))
    told = {
        "GT_FOLDER": str(clip.folder / "coco"),
        "TRACKERS_FOLDER": str(tmp_path),
        "PRINT_CONFIG": False,
    }
    data = trackeval.datasets.TAO(told)
    assert data.class_list == ["ball", "post", "tile"]
    found = scores(data, trackeval.metrics.HOTA({"PRINT_CONFIG": False}))["same"][
        "hall"
    ]
    assert all(found[name]["HOTA"]["HOTA"].min() == 1 for name in data.class_list)


def mot_faults(clip: Labelled, guesses: Path) -> dict[str, tuple[float, int, int]]:
    """MOTA, misses and switches of each folder of `guesses`, as TrackEval counts them."""
    settings = {
        "GT_FOLDER": str(clip.folder / "mot"),
        "TRACKERS_FOLDER": str(guesses),
        "SEQ_INFO": {"hall": None},
        "SKIP_SPLIT_FOL": True,
        "BENCHMARK": "MOT15",
        "PRINT_CONFIG": False,
    }
    with contextlib.redirect_stdout(io.StringIO()):
        data = trackeval.datasets.MotChallenge2DBox(settings)
    found = scores(data, trackeval.metrics.CLEAR({"PRINT_CONFIG": False}))
    rows = {who: found[who]["hall"]["pedestrian"]["CLEAR"] for who in data.tracker_list}
    return {who: (row["MOTA"], row["CLR_FN"], row["IDSW"]) for who, row in rows.items()}


def mot_rows(clip: Labelled) -> list[list[str]]:
    """Columns of the truth, as text."""
    with (clip.folder / "mot/hall/gt/gt.txt").open() as file:
        return list(csv.reader(file))


def test_mot_faults_are_counted_by_trackeval(clip: Labelled, tmp_path) -> None:
    rows = [row[:7] for row in mot_rows(clip)]
    # two tracks change names from the sixth frame on
    names = {"3": "4", "4": "3"}
    swapped = [list(row) for row in rows]
    for row in swapped:
        if int(row[0]) > 5:
            row[1] = names.get(row[1], row[1])
    for who, guess in (("same", rows), ("less", rows[1:]), ("swapped", swapped)):
        (tmp_path / who / "data").mkdir(parents=True)
        text = "".join(",".join(row) + "\n" for row in guess)
        (tmp_path / who / "data/hall.txt").write_text(text)
    found = mot_faults(clip, tmp_path)
    assert found["same"] == (1, 0, 0)
    assert found["less"] == (approx(1 - 1 / len(rows)), 1, 0)
    assert found["swapped"] == (approx(1 - 2 / len(rows)), 0, 2)


def test_mot_boxes_are_those_of_whole_masks(clip: Labelled) -> None:
    rows = {(int(row[0]), int(row[1])): row for row in mot_rows(clip)}
    labels = (clip.folder / "mot/hall/gt/labels.txt").read_text().splitlines()
    whole = clip.whole
    assert len(rows) == len(whole)
    for (frame, name), mask in whole.items():
        body = clip.names.index(name)
        row = rows[frame + 1, body + 1]
        encoded = coco_mask.encode(np.asfortranarray(mask.astype(np.uint8)))
        x, y, width, height = coco_mask.toBbox(encoded)
        assert list(map(float, row[2:6])) == [x + 1, y + 1, width, height]
        visible = clip.mask(frame, name).sum() / mask.sum()
        assert float(row[8]) == approx(visible, abs=1e-5)
        assert labels[int(row[7]) - 1] == clip.filming.scene.objects[body].label
