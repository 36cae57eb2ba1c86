"""The classical segmenter on drawn scenes with known masks, on degenerate photos, and on real photos with masks."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from physgen.perceive.backends.segment_classical import classical

Photo = NDArray[np.uint8]
Labels = NDArray[np.uint16]

DISCS = [(90, 80, 30), (210, 70, 24), (330, 150, 34), (120, 210, 28), (250, 240, 26)]
TOUCHING = [(150, 150, 28), (206, 150, 28), (178, 198, 28), (320, 90, 28)]
BLOCKS = [(60, 60, 50, 90), (170, 60, 40, 100), (280, 70, 80, 50), (90, 210, 70, 50), (250, 200, 36, 80)]
COLOURS = [(210, 60, 50), (240, 200, 60), (40, 60, 170), (235, 235, 225), (120, 40, 110)]


def backdrop(height: int = 300, width: int = 400) -> NDArray[np.float64]:
    y, x = np.mgrid[:height, :width]
    return np.stack([60 + 30 * x / width, 130 - 20 * y / height, 90 + 25 * y / height], -1)


def grainy(image: NDArray[np.float64], seed: int = 0, grain: float = 4) -> Photo:
    soft = cv2.GaussianBlur(image, (0, 0), 0.7) + np.random.default_rng(seed).normal(0, grain, image.shape)
    return np.clip(soft, 0, 255).astype(np.uint8)


def shaded_discs(discs: list[tuple[int, int, int]]) -> tuple[Photo, Labels]:
    image, truth = backdrop(), np.zeros((300, 400), np.uint16)
    y, x = np.mgrid[:300, :400]
    for k, (cx, cy, radius) in enumerate(discs):
        u, v = (x - cx) / radius, (y - cy) / radius
        inside = u * u + v * v <= 1
        facing = np.clip(-0.4 * u - 0.5 * v + 0.75 * np.sqrt(np.clip(1 - u * u - v * v, 0, 1)), 0, 1)
        image[inside] = (np.array(COLOURS[k]) * (0.45 + 0.55 * facing[..., None]))[inside]
        truth[inside] = k + 1
    return grainy(image), truth


def blocks() -> tuple[Photo, Labels]:
    image, truth = backdrop(), np.zeros((300, 400), np.uint16)
    for k, (x, y, width, height) in enumerate(BLOCKS):
        image[y : y + height, x : x + width] = np.array(COLOURS[k]) * np.linspace(1, 0.85, width)[:, None]
        truth[y : y + height, x : x + width] = k + 1
    return grainy(image), truth


def matches(labels: Labels, truth: Labels, least: float = 0.5) -> list[float]:
    """Intersection over union of one-to-one matches, best first."""
    pairs = []
    for found in range(1, int(labels.max()) + 1):
        for true in np.unique(truth[(labels == found) & (truth > 0)]):
            a, b = labels == found, truth == true
            pairs.append((float((a & b).sum() / (a | b).sum()), found, int(true)))
    kept: list[tuple[float, int, int]] = []
    for pair in sorted(pairs, reverse=True):
        if pair[0] >= least and all(pair[1] != one[1] and pair[2] != one[2] for one in kept):
            kept.append(pair)
    return [pair[0] for pair in kept]


@pytest.mark.parametrize(
    ("scene", "tight"),
    [(shaded_discs(DISCS), 0.95), (shaded_discs(TOUCHING), 0.95), (blocks(), 0.92)],
    ids=["discs", "touching discs", "blocks"],
)
def test_finds_every_drawn_object_and_nothing_else(scene: tuple[Photo, Labels], tight: float) -> None:
    photo, truth = scene
    segments = classical()(photo)
    hits = matches(segments.labels, truth)
    assert len(hits) == truth.max() == segments.labels.max()
    assert min(hits) > tight


def test_labels_are_connected_and_numbered_from_left_to_right() -> None:
    segments = classical()(shaded_discs(TOUCHING)[0])
    assert segments.labels.dtype == np.uint16
    assert segments.confidence.shape == (segments.labels.max(),)
    assert np.all((segments.confidence > 0.5) & (segments.confidence <= 1))
    centroids = []
    for k in range(1, int(segments.labels.max()) + 1):
        parts, _ = cv2.connectedComponents((segments.labels == k).astype(np.uint8), connectivity=4)
        assert parts == 2
        centroids.append(np.nonzero(segments.labels == k)[1].mean())
    assert centroids == sorted(centroids)


def test_same_photo_same_bytes() -> None:
    photo, _ = shaded_discs(DISCS)
    first, second = classical()(photo), classical()(photo.copy())
    assert first.labels.tobytes() == second.labels.tobytes()
    assert first.confidence.tobytes() == second.confidence.tobytes()


@pytest.mark.parametrize("turn", [np.fliplr, np.flipud, lambda image: np.swapaxes(image, 0, 1)])
def test_a_mirrored_photo_gives_mirrored_objects(turn) -> None:  # type: ignore[no-untyped-def]
    photo, _ = shaded_discs(TOUCHING)
    plain = classical()(photo).labels
    mirrored = classical()(np.ascontiguousarray(turn(photo))).labels
    hits = matches(mirrored, turn(plain))
    assert len(hits) == plain.max() == mirrored.max()
    assert min(hits) > 0.95


def test_an_object_taken_away_leaves_the_others_as_they_were() -> None:
    every, without = (classical()(shaded_discs(discs)[0]).labels for discs in (DISCS, DISCS[:-1]))
    hits = matches(without, every)
    assert len(hits) == without.max() == every.max() - 1
    assert min(hits) > 0.95


@pytest.mark.parametrize("factor", [0.5, 2.5])
def test_outlines_follow_the_full_photo_at_other_sizes(factor: float) -> None:
    photo, truth = shaded_discs(DISCS)
    size = round(400 * factor), round(300 * factor)
    resized = cv2.resize(photo, size, interpolation=cv2.INTER_CUBIC if factor > 1 else cv2.INTER_AREA)
    expected = cv2.resize(truth, size, interpolation=cv2.INTER_NEAREST)
    segments = classical()(resized.astype(np.uint8))
    hits = matches(segments.labels, expected)
    assert segments.labels.shape == resized.shape[:2]
    assert len(hits) == 5 == segments.labels.max()
    assert np.mean(hits) > 0.93


def test_a_grey_photo() -> None:
    photo, truth = shaded_discs(DISCS[:4])
    grey = np.repeat(cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY)[..., None], 3, 2).astype(np.uint8)
    segments = classical()(grey)
    assert len(matches(segments.labels, truth)) >= 3
    assert segments.labels.max() <= 4


@pytest.mark.parametrize(
    "shape", [(1, 1), (1, 7), (3, 2), (16, 16), (5, 400), (400, 5), (60, 3000), (1, 50_000)]
)
@pytest.mark.parametrize("kind", ["uniform", "noise", "ramp"])
def test_photos_without_objects(shape: tuple[int, int], kind: str) -> None:
    photo = np.full((*shape, 3), 128, np.uint8)
    if kind == "noise":
        photo = np.random.default_rng(1).integers(0, 256, photo.shape, np.uint8)
    if kind == "ramp":
        photo[:] = (np.arange(shape[1]) * 255 // shape[1])[:, None]
    segments = classical()(photo)
    assert segments.labels.shape == shape
    assert segments.labels.max() == 0
    assert segments.confidence.shape == (0,)


@pytest.mark.peer_scenes
@pytest.mark.parametrize(("name", "least"), [("pool", 13), ("domino", 5), ("boxes", 19)])
def test_real_photos(peer_scenes: Path, name: str, least: int) -> None:
    photo = cv2.cvtColor(cv2.imread(str(peer_scenes / name / "original.png")), cv2.COLOR_BGR2RGB)
    truth = cv2.imread(str(peer_scenes / name / "mask.png"), cv2.IMREAD_UNCHANGED)
    segments = classical()(photo.astype(np.uint8))
    hits = matches(segments.labels, truth.astype(np.uint16))
    assert len(hits) >= least
    assert len(hits) >= 0.8 * segments.labels.max()
    assert np.mean(hits) > 0.85


@pytest.mark.parametrize("name", ["billiards", "dominoes"])
def test_our_own_photos(bundled: Path, name: str) -> None:
    photo = cv2.cvtColor(cv2.imread(str(bundled / name / "photo.png")), cv2.COLOR_BGR2RGB)
    truth = cv2.imread(str(bundled / name / "photo.assets" / "masks.png"), cv2.IMREAD_UNCHANGED)
    segments = classical()(photo.astype(np.uint8))
    hits = matches(segments.labels, truth.astype(np.uint16))
    assert len(hits) >= 0.8 * truth.max()
    assert len(hits) >= 0.8 * segments.labels.max()
    assert np.mean(hits) > 0.85
