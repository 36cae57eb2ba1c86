"""The detector's photos, boxes, loss and exported file."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "studio/segmentation"))
from boxes import MEAN, BoxFinder, decoded, ious, prepared, suppressed  # noqa: E402
from coco_classes import CLASSES, MOVABLE, MOVABLE_INDICES  # noqa: E402
from detector import Detector, cells, decode_boxes  # noqa: E402
from detector_drawings import flat_drawing  # noqa: E402
from detector_loss import Target, assign, losses  # noqa: E402
from detector_views import MOVABLE as MOVABLE_ROLE  # noqa: E402
from detector_views import flat_example, placed, view  # noqa: E402
from export import export_detector  # noqa: E402
from labelled_photos import box_of  # noqa: E402
from photo_split import is_coco_training, is_held_out, is_training  # noqa: E402

SIDE = 416


def target(*boxes: tuple[float, float, float, float], cell_count: int) -> Target:
    return Target(
        torch.tensor(boxes),
        torch.full((len(boxes),), MOVABLE_ROLE),
        torch.full((len(boxes),), -1),
        torch.ones(cell_count),
        torch.zeros(cell_count),
    )


def bins_of(box: tuple[float, float, float, float]) -> torch.Tensor:
    """Logits (N, 32) with which every cell predicts `box`, if its bins reach so far."""
    centres, strides = cells(SIDE)
    sides = torch.tensor(box)
    distances = torch.cat([centres - sides[:2], sides[2:] - centres], dim=1)
    distances = (distances / strides[:, None]).clamp(0, 6.99)
    lower = distances.long()
    shares = torch.full((len(centres), 4, 8), 1e-9)
    shares.scatter_(2, lower[..., None], (1 - distances + lower)[..., None])
    shares.scatter_(2, lower[..., None] + 1, (distances - lower)[..., None])
    return shares.clamp(min=1e-9).log().reshape(-1, 32)


def test_split_holds_out_a_fifth() -> None:
    names = [f"glass{number}" for number in range(2000)]
    share = np.mean([is_held_out(name) for name in names])
    assert 0.17 < share < 0.23
    assert not any(is_training("class5", name) for name in names if is_held_out(name))
    assert all(is_training("caltech101-part", name) for name in names)


def test_split_excludes_validation_photos_of_coco() -> None:
    numbers = [9, 650, 632, 8, 651, 5001]
    assert [is_coco_training(str(number)) for number in numbers] == [
        True, True, False, False, False, False,
    ]  # fmt: skip


def test_class_table_covers_coco() -> None:
    assert len(CLASSES) == len(set(CLASSES)) == 80
    assert CLASSES[0] == "person"
    assert CLASSES[79] == "toothbrush"
    assert "cup" in MOVABLE
    assert not MOVABLE & {"person", "dog", "bed", "stop sign"}
    assert {CLASSES[k] for k in MOVABLE_INDICES} == MOVABLE


def test_decoders_of_boxes_agree() -> None:
    generator = torch.Generator().manual_seed(0)
    centres, strides = cells(SIDE)
    logits = torch.randn(len(centres), 32, generator=generator)
    boxes = decode_boxes(logits, centres, strides).numpy()
    parts = [
        decoded(logits[strides == stride].numpy(), stride) for stride in (8, 16, 32, 64)
    ]
    np.testing.assert_allclose(np.concatenate(parts), boxes, atol=1e-3)


def test_suppression_leaves_distinct_boxes() -> None:
    boxes = np.array(
        [[0, 0, 100, 100], [2, 2, 100, 100], [200, 0, 300, 100], [0, 0, 20, 20]],
        np.float32,
    )
    scores = np.array([0.8, 0.9, 0.5, 0.001], np.float32)
    assert suppressed(boxes, scores).tolist() == [1, 2]
    assert ious(boxes, boxes)[0, 2] == 0


def test_photo_is_at_top_left_of_black() -> None:
    values = prepared(np.full((100, 200, 3), 255, np.uint8))
    assert values.shape == (1, 3, SIDE, SIDE)
    black = -MEAN[0] / 57.375
    assert np.allclose(values[0, 0, 208:], black)
    assert (values[0, 0, :207] > 2).all()


def test_views_keep_boxes_on_objects() -> None:
    example = flat_example(5)
    bgr = np.zeros((*example.read().shape[:2], 3), np.uint8)
    left, top, right, bottom = example.boxes[0].astype(int)
    bgr[top:bottom, left:right] = 255
    middle = np.array([left + right, top + bottom]) / 2
    for scale in (0.4, 1.0, 1.7):
        offset = (200, 300) - middle * scale
        shown = placed(bgr, example, (512, 512), scale, offset)
        visible = cv2.threshold(shown.bgr[..., 0], 127, 255, cv2.THRESH_BINARY)[1]
        x, y, width, height = cv2.boundingRect(visible)
        expected = np.array([x, y, x + width, y + height])
        distances = np.abs(shown.boxes - expected).max(axis=1)
        assert distances.min() <= 1.5


def test_views_repeat_with_their_seed() -> None:
    examples = [flat_example(seed) for seed in range(3)]
    shown = []
    for _ in range(2):
        rng = np.random.default_rng(4)
        shown.append(view(lambda rng=rng: examples[rng.integers(3)], 320, rng))
    assert np.array_equal(shown[0].bgr, shown[1].bgr)
    assert np.array_equal(shown[0].boxes, shown[1].boxes)
    assert shown[0].bgr.shape == (320, 320, 3)


def test_flat_drawings_label_their_shapes() -> None:
    for seed in range(5):
        bgr, labels = flat_drawing(seed)
        assert bgr.shape[:2] == labels.shape
        assert labels.max() >= 1
        inside, outside = bgr[labels > 0], bgr[labels == 0]
        assert len(inside) >= 60
        assert len(outside) > len(inside) * 0.1


def test_cells_of_an_object_are_near_it() -> None:
    box = (100.0, 120.0, 200.0, 220.0)
    centres, strides = cells(SIDE)
    boxes = decode_boxes(bins_of(box), centres, strides)
    scores = torch.full((len(centres), 82), -4.0)
    chosen = assign(
        scores, boxes, target(box, cell_count=len(centres)), centres, strides
    )
    assert 1 <= len(chosen.cells) <= 10
    assert (chosen.objects == 0).all()
    middle = torch.tensor([150.0, 170.0])
    distance = (centres[chosen.cells] - middle).abs().amax(1)
    assert (distance <= 2.5 * strides[chosen.cells]).all()
    assert (chosen.overlaps > 0.95).all()


def test_loss_prefers_true_boxes_and_scores() -> None:
    box = (100.0, 120.0, 200.0, 220.0)
    centres, strides = cells(SIDE)
    truth = target(box, cell_count=len(centres))
    scores = torch.full((1, len(centres), 82), -6.0)
    right = losses(scores, bins_of(box)[None], [truth], centres, strides)
    shifted = bins_of((130.0, 120.0, 230.0, 220.0))[None]
    wrong = losses(scores, shifted, [truth], centres, strides)
    assert right["boxes"] < 0.05 < wrong["boxes"]
    chosen = assign(scores[0], decode_boxes(bins_of(box), centres, strides), truth, centres, strides)  # fmt: skip
    movable, immovable = scores.clone(), scores.clone()
    movable[0, chosen.cells, 0] = 4.0
    immovable[0, chosen.cells, 1] = 4.0
    sums = [
        float(losses(s, bins_of(box)[None], [truth], centres, strides)["wholes"])
        for s in (movable, scores, immovable)
    ]
    assert sums[0] < sums[1] < sums[2]


def test_network_gives_a_score_per_cell() -> None:
    detector = Detector().eval()
    with torch.inference_mode():
        outputs = detector(torch.zeros(1, 3, SIDE, SIDE))
        scores, bins = detector.logits(torch.zeros(1, 3, SIDE, SIDE))
    counts = [52 * 52, 26 * 26, 13 * 13, 7 * 7]
    assert [tuple(o.shape[1:]) for o in outputs[:4]] == [(n, 82) for n in counts]
    assert [tuple(o.shape[1:]) for o in outputs[4:]] == [(n, 32) for n in counts]
    assert scores.shape == (1, sum(counts), 82)
    assert torch.equal(torch.cat(outputs[4:], dim=1), bins)


@pytest.mark.slow
def test_exported_file_matches_its_network(tmp_path: Path) -> None:
    path = tmp_path / "detector.onnx"
    torch.manual_seed(0)
    detector = Detector()
    error = export_detector(detector.state_dict(), path)
    assert error < 0.03
    finder = BoxFinder(path, "movable")
    bgr = np.random.default_rng(0).integers(0, 256, (300, 400, 3), dtype=np.uint8)
    scores, boxes = finder.raw(bgr)
    assert scores.shape == (3598, 82)
    assert boxes.shape == (3598, 4)
    with torch.inference_mode():
        logits, _ = detector.eval().logits(torch.from_numpy(prepared(bgr)))
    np.testing.assert_allclose(scores, logits[0].sigmoid().numpy(), atol=0.03)


def test_shipped_detector_ranks_objects_first() -> None:
    finder = BoxFinder(ROOT / "physgen/perceive/segment/detector.onnx", "movable")
    for name, least_first in (("kitchen", 0.5), ("shelf", 0.8)):
        scene = ROOT / "scenes" / name
        boxes = finder.find(cv2.imread(str(scene / "photo.png")))
        labels = cv2.imread(str(scene / "photo.assets/masks.png"), cv2.IMREAD_UNCHANGED)
        truth = [box_of(labels == label) for label in np.unique(labels) if label]
        overlaps = ious(np.array(truth, np.float32), boxes.boxes)
        assert (overlaps.max(axis=1) > 0.5).mean() > 0.85, name
        first = overlaps[:, : len(truth)].max(axis=0) > 0.5
        assert first.mean() >= least_first, name
    best = overlaps.argmax(axis=1)
    assert boxes.classes[best].sum(axis=0).argmax() == CLASSES.index("book")
