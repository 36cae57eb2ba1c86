from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pycocotools import mask as coco

from physgen.perceive.import_coco import (
    coco_objects,
    decode_segmentation,
    read_coco,
)
from physgen.problems import InputError

SIZE = 30, 20


def square() -> np.ndarray:
    mask = np.zeros((20, 30), bool)
    mask[4:12, 10:25] = True
    return mask


def lengths(mask: np.ndarray) -> list[int]:
    flat = mask.T.ravel().astype(int)
    ends = np.flatnonzero(np.diff(np.concatenate([[0], flat, [1 - flat[-1]]])))
    return np.diff(np.concatenate([[0], ends])).tolist()


def test_the_three_forms_mean_the_same():
    mask = square()
    counts = lengths(mask)
    compressed = coco.frPyObjects({"size": [20, 30], "counts": counts}, 20, 30)
    polygon = [[10, 4, 25, 4, 25, 12, 10, 12]]
    assert np.array_equal(decode_segmentation(polygon, SIZE), mask)
    assert np.array_equal(decode_segmentation({"size": [20, 30], "counts": counts}, SIZE), mask)
    assert np.array_equal(decode_segmentation(compressed, SIZE), mask)


@pytest.mark.parametrize(
    "wrong",
    [None, 3, [[1, 2, 3]], [["a", 2, 3, 4, 5, 6]], [[1, 2]], {"size": [20, 30]}, {"size": [2, 3], "counts": [6]},
     {"size": [20, 30], "counts": [-1, 601]}, {"size": [20, 30], "counts": [599]}, {"size": [20, 30], "counts": "\x01"},
     {"size": [20, 30], "counts": "o"}, [[1, 2, float("nan"), 4, 5, 6]]],
)  # fmt: skip
def test_what_cannot_be_read_is_said(wrong: Any):
    with pytest.raises(ValueError, match=r"^(is|has) "):
        decode_segmentation(wrong, SIZE)


def write(path: Path, **changes: Any) -> Path:
    data: dict[str, Any] = {
        "images": [{"id": 5, "file_name": "a.png"}, {"id": 6, "file_name": "b.png"}],
        "categories": [{"id": 1, "name": "sports ball"}],
        "annotations": [
            {"id": 1, "image_id": 5, "category_id": 1, "segmentation": [[0, 0, 20, 0, 20, 20, 0, 20]]},
            {
                "id": 2,
                "image_id": 5,
                "category_id": 9,
                "segmentation": [[10, 4, 25, 4, 25, 12, 10, 12]],
                "score": 0.5,
            },
            {"id": 3, "image_id": 5, "category_id": 1, "iscrowd": 1, "segmentation": None},
            {"id": 4, "image_id": 6, "category_id": 1, "segmentation": []},
        ],
    }
    path.write_text(json.dumps(data | changes))
    return path


def test_objects_of_one_photo(tmp_path: Path):
    file = write(tmp_path / "c.json")
    found = coco_objects(file, read_coco(file, Path("elsewhere/a.png")), SIZE)
    assert np.array_equal(found.labels == 2, square())
    assert (found.labels == 1).sum() == 400 - 80
    assert found.names[1].label == "sports ball"
    assert 2 not in found.names
    assert found.confidence[2] == 0.5


@pytest.mark.parametrize(
    ("changes", "image", "message"),
    [
        ({}, None, "2 photos are in it and none was named; it has a.png, b.png"),
        ({}, "z.png", '"z.png" is not among its photos'),
        ({"annotations": 3}, "a.png", "has no list of annotations"),
        ({"annotations": []}, "a.png", '"a.png" has no annotated object'),
    ],
)
def test_a_file_that_does_not_help(tmp_path: Path, changes: dict[str, Any], image: str | None, message: str):
    file = write(tmp_path / "c.json", **changes)
    with pytest.raises(InputError) as error:
        read_coco(file, Path(image) if image else None)
    assert message in str(error.value)


def test_every_wrong_annotation_is_named(tmp_path: Path):
    wrong = [{"id": n, "image_id": 5, "segmentation": n} for n in (7, 8)]
    file = write(tmp_path / "c.json", annotations=wrong)
    with pytest.raises(InputError) as error:
        coco_objects(file, read_coco(file, Path("a.png")), SIZE)
    assert [p.path for p in error.value.problems] == [
        "annotations[0].segmentation",
        "annotations[1].segmentation",
    ]


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "\udcff", "3"])
def test_no_traceback(tmp_path: Path, text: str):
    file = tmp_path / "c.json"
    file.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError):
        read_coco(file)
    with pytest.raises(InputError, match="no such file"):
        read_coco(tmp_path / "none.json")
