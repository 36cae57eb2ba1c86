"""Masks as others read them: pycocotools, Pillow and TrackEval against the ids of frames drawn again."""

from __future__ import annotations

import contextlib
import io
import shutil

import numpy as np
import pytest
import trackeval
from labelled import Labelled, scores
from PIL import Image
from pycocotools import mask as coco_mask
from pycocotools.cocoeval import COCOeval
from pytest import approx


def test_coco_masks_are_the_ids(clip: Labelled) -> None:
    coco = clip.coco
    assert len(coco.imgs) == len(clip.ids) == 8
    for number, image in coco.imgs.items():
        ids = clip.ids[number - 1]
        rows = coco.loadAnns(coco.getAnnIds(imgIds=[number]))
        assert sorted(row["track_id"] for row in rows) == [
            k for k in np.unique(ids) if k
        ]
        assert (image["height"], image["width"]) == ids.shape
        for row in rows:
            mask = coco.annToMask(row)
            assert np.array_equal(mask, ids == row["track_id"])
            assert row["area"] == mask.sum() == coco_mask.area(row["segmentation"])
            assert row["bbox"] == coco_mask.toBbox(row["segmentation"]).tolist()
            assert (
                row["amodal_bbox"]
                == coco_mask.toBbox(row["amodal_segmentation"]).tolist()
            )
            assert row["visible_fraction"] == approx(
                row["area"] / row["amodal_area"], abs=1e-6
            )
            label = coco.cats[row["category_id"]]["name"]
            assert label == clip.filming.scene.objects[row["track_id"] - 1].label


@pytest.mark.parametrize("how", ["segm", "bbox"])
def test_coco_scores_itself_as_perfect(clip: Labelled, how: str) -> None:
    rows = [
        {key: row[key] for key in ("image_id", "category_id", "segmentation")}
        | {"score": 1.0}
        for row in clip.coco.dataset["annotations"]
    ]
    with contextlib.redirect_stdout(io.StringIO()):
        judge = COCOeval(clip.coco, clip.coco.loadRes(rows), how)
        judge.evaluate()
        judge.accumulate()
        judge.summarize()
    assert judge.stats[0] == judge.stats[8] == approx(1)


def test_palettes_hold_ids(clip: Labelled) -> None:
    for frame, ids in enumerate(clip.ids):
        picture = Image.open(
            clip.folder / "davis/Annotations/Full-Resolution/hall" / f"{frame:05d}.png"
        )
        assert picture.mode == "P"
        assert np.array_equal(np.asarray(picture), ids)
        # red, green, yellow, blue: what every tool for DAVIS shows them as
        assert picture.getpalette()[:15] == [
            0,
            0,
            0,
            128,
            0,
            0,
            0,
            128,
            0,
            128,
            128,
            0,
            0,
            0,
            128,
        ]


def test_davis_is_scored_as_true_and_a_wrong_mask_is_not(
    clip: Labelled, tmp_path
) -> None:
    truth = clip.folder / "davis/Annotations/Full-Resolution"
    assert (clip.folder / "davis/ImageSets/2017/val.txt").read_text().split() == [
        "hall"
    ]
    shutil.copytree(truth / "hall", tmp_path / "same/data/hall")
    shutil.copytree(truth / "hall", tmp_path / "less/data/hall")
    last = tmp_path / "less/data/hall/00007.png"
    picture = np.asarray(Image.open(last)).copy()
    picture[picture == clip.names.index("tile") + 1] = 0
    Image.fromarray(picture).save(last)
    with contextlib.redirect_stdout(io.StringIO()):
        data = trackeval.datasets.DAVIS(
            {
                "GT_FOLDER": str(truth),
                "TRACKERS_FOLDER": str(tmp_path),
                "PRINT_CONFIG": False,
            }
        )
    found = scores(data, trackeval.metrics.HOTA({"PRINT_CONFIG": False}))
    same, less = (found[who]["hall"]["general"]["HOTA"] for who in ("same", "less"))
    rows = sum(len(np.unique(ids)) - 1 for ids in clip.ids)
    assert same["DetA"].min() == same["AssA"].min() == 1
    assert less["DetA"] == approx((rows - 1) / rows)
