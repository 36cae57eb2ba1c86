"""The training of the head that cuts out: photos, weights of pixels, exported file."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from physgen.perceive.segment.network import OUTPUTS, SIDE

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "studio/segmentation"))
from cutout import FRESH, Replay, examples, loss, shape_weights  # noqa: E402
from cutout_photos import (  # noqa: E402
    SET_SHARES,
    photo_objects,
    with_loose_outlines,
)
from network import Cutout, Network, load_exported  # noqa: E402
from photo_split import is_training  # noqa: E402

SHIPPED = ROOT / "physgen/perceive/segment"


def disc_with_stem() -> np.ndarray:
    """(96, 96) 0 or 1: a disc of radius 20 px and a stem of 3 px above it."""
    rows, columns = np.mgrid[:96, :96]
    disc = np.hypot(rows - 65, columns - 48) < 20
    stem = (np.abs(columns - 48) < 2) & (rows > 10) & (rows < 65)
    return (disc | stem).astype(np.float32)


def write_set(folder: Path, names: dict[str, dict[str, str]]) -> None:
    """Write a set of photos with one labelled rectangle for each label."""
    (folder / "images").mkdir(parents=True)
    (folder / "masks").mkdir()
    (folder / "labels.json").write_text(json.dumps({"labels": names}))
    for name, labels in names.items():
        mask = np.zeros((60, 80), np.uint8)
        for label in labels:
            mask[10:50, 15 * int(label) : 15 * int(label) + 12] = int(label)
        cv2.imwrite(str(folder / "images" / f"{name}.jpg"), np.zeros((60, 80, 3)))
        cv2.imwrite(str(folder / "masks" / f"{name}.png"), mask)


@pytest.fixture
def material(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PHYSGEN_MATERIAL", str(tmp_path))
    minis = tmp_path / "material/coco-minis"
    write_set(minis, {"a": {"1": "cup", "2": "dining table", "3": "person"}, "b": {}})
    (minis / "photo_licence_ids.json").write_text(json.dumps({"a": 4, "b": 3}))
    return tmp_path


def test_closed_licences_teach_nothing(material: Path) -> None:
    photos = list(photo_objects("coco-minis"))
    assert len(photos) == 1
    assert len(list(photo_objects("coco-minis", licences=None))) == 2


def test_polygons_that_cover_other_things_are_excluded(material: Path) -> None:
    _, _, movable, fixed = next(photo_objects("coco-minis"))
    assert (movable, fixed) == ([1], [3])


def test_held_out_photos_teach_nothing(material: Path) -> None:
    names = {f"glass{number}": {"1": "glass"} for number in range(12)}
    write_set(material / "material/trashnet-grabcut", names)
    training = [name for name in names if is_training("trashnet-grabcut", name)]
    assert 0 < len(training) < len(names)
    assert len(list(photo_objects("trashnet-grabcut"))) == len(training)


def test_set_shares_sum_to_one() -> None:
    assert sum(SET_SHARES.values()) == pytest.approx(1)


def test_loose_outlines_are_unjudged_on_both_sides() -> None:
    labels = np.zeros((40, 40), np.uint8)
    labels[10:30, 10:30] = 1
    loose = with_loose_outlines(labels, 2)
    assert loose[20, 7:13].tolist() == [0, 255, 255, 255, 255, 1]
    only = next(examples(np.zeros((40, 40, 3), np.uint8), loose, [1], slack=2), None)
    assert only is None  # too small an object
    large = np.zeros((80, 80), np.uint8)
    large[10:70, 10:70] = 1
    banded = with_loose_outlines(large, 2)
    example = next(examples(np.zeros((80, 80, 3), np.uint8), banded, [1], slack=2))
    assert tuple(example.box) == (10, 10, 70, 70)


def test_thin_parts_and_outlines_weigh_more() -> None:
    truth = torch.from_numpy(disc_with_stem())[None]
    weights = shape_weights(truth)[0]
    stem, outline = float(weights[25, 48]), float(weights[65, 48 + 19])
    body, background = float(weights[65, 48]), float(weights[10, 10])
    assert body == background == 1
    assert stem > outline > body


def test_a_missing_stem_costs_more_than_a_patch() -> None:
    truth = torch.from_numpy(disc_with_stem())[None]
    weight = torch.ones_like(truth)
    sure = 8 * (2 * truth - 1)
    without_stem, without_patch = sure.clone(), sure.clone()
    without_stem[0, 11:41, 47:50] = -8
    without_patch[0, 60:69, 43:53] = -8
    batch = {"truth": truth, "weight": weight}
    assert (
        loss(without_stem, batch) > 2 * loss(without_patch, batch) > loss(sure, batch)
    )


def test_replay_repeats_earlier_crops() -> None:
    replay = Replay(0)
    first = torch.arange(FRESH, dtype=torch.float32)[:, None]
    (fresh,) = replay.filled([first], 4)
    assert torch.equal(fresh, first)
    (filled,) = replay.filled([first + 100], 4)
    assert torch.equal(filled[:FRESH], first + 100)
    assert set(filled[FRESH:, 0].tolist()) <= set(first[:, 0].tolist())
    assert len(filled) == FRESH + 4


def test_loaded_head_equals_exported_file() -> None:
    network, head = Network().eval(), Cutout(SIDE).eval()
    crop = torch.randn(1, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(0))
    load_exported(network, SHIPPED / "segmentation.onnx", torch.zeros(1, 3, SIDE, SIDE))
    with torch.no_grad():
        levels = network.levels(crop)
    load_exported(head, SHIPPED / "cutout.onnx", levels, torch.zeros(1, 1, 1, 1))
    file = cv2.dnn.readNetFromONNX(str(SHIPPED / "cutout.onnx"))
    for at_point in (0.0, 1.0):
        for name, level in zip(OUTPUTS[1:], levels, strict=True):
            file.setInput(level.numpy(), name)
        kind = torch.full((1, 1, 1, 1), at_point)
        file.setInput(kind.numpy(), "at-point")
        with torch.no_grad():
            ours = head(levels, kind).numpy()
        assert np.abs(file.forward() - ours).max() < 1e-4 * np.abs(ours).max()
