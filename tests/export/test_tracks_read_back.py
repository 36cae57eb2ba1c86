"""Tracks as another program reads them: TrackEval, truth against itself."""

from __future__ import annotations

import json

import trackeval
from labelled import Labelled, scores


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
