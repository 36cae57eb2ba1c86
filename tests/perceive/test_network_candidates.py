"""What follows from the network's maps, where they are true: every object proposed, and told from its parts."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from pytest import approx

from physgen.perceive.segment.candidates import network_proposals
from physgen.perceive.segment.evidence import MAP_FEATURES, map_features
from physgen.perceive.segment.network import (
    OFFSETS,
    WEIGHTS,
    NetworkMaps,
    rough_mask_in_box,
    run_network,
)
from physgen.perceive.segment.proposals import Proposal, cut_out


def true_maps(labels: np.ndarray, sure: float = 0.97) -> NetworkMaps:
    """What a network would say that is right everywhere, and almost sure."""
    on = labels > 0
    border = np.zeros(labels.shape, bool)
    for axis in (0, 1):
        differ = np.diff(labels, axis=axis) != 0
        a, b = [slice(None)] * 2, [slice(None)] * 2
        a[axis], b[axis] = slice(1, None), slice(None, -1)
        border[tuple(a)] |= differ
        border[tuple(b)] |= differ
    pairs = np.zeros((len(OFFSETS), *labels.shape), bool)
    wide = np.pad(labels, 27)
    h, w = labels.shape
    for n, (down, right) in enumerate(OFFSETS):
        there = wide[27 + down : 27 + down + h, 27 + right : 27 + right + w]
        pairs[n] = (labels == there) & on

    def said(truth: np.ndarray) -> np.ndarray:
        return np.where(truth, sure, 1 - sure).astype(np.float32)

    normals = np.zeros((*labels.shape, 3), np.float32)
    normals[..., 2] = 1
    return NetworkMaps(
        said(on),
        said(border),
        said(pairs),
        normals,
        np.zeros(labels.shape, np.float32),
        said(on),
    )


def touching() -> np.ndarray:
    """Three discs that touch, a block that stands on another, and a ring with something in its hole."""
    labels = np.zeros((160, 200), np.uint8)
    for k in range(3):
        cv2.circle(labels, (30 + 36 * k, 30), 18, k + 1, -1)
    labels[80:110, 20:70] = 4
    labels[110:150, 10:90] = 5
    cv2.circle(labels, (150, 110), 34, 6, -1)
    cv2.circle(labels, (150, 110), 14, 7, -1)
    return labels


def whole(mask: np.ndarray) -> Proposal:
    found = cut_out(mask, 0, 0, 1)
    assert found is not None
    return found


def test_every_object_is_among_the_parts() -> None:
    labels = touching()
    found, wholes = network_proposals(true_maps(labels), 14, labels.size // 2)
    assert len(wholes) == 7
    found += wholes
    for k in range(1, 8):
        if k == 6:  # a proposal has no hole: the ring is found with what it holds
            truth = (labels == 6) | (labels == 7)
        else:
            truth = labels == k
        best = max(
            (one.on(labels.shape) & truth).sum() / (one.on(labels.shape) | truth).sum()
            for one in found
        )
        assert best > 0.85, k


def test_evidence_tells_wholes_from_halves_and_pairs() -> None:
    labels = touching()
    seen = true_maps(labels)
    half = labels == 5
    half[:, 45:] = False
    told = map_features(
        [whole(labels == 5), whole(half), whole((labels == 4) | (labels == 5))], seen
    )
    at = {name: k for k, name in enumerate(MAP_FEATURES)}
    object_, part, pair = told
    assert object_[at["foreground"]] == approx(0.97, abs=0.01)
    assert (
        object_[at["border along its weakest quarter"]]
        > 0.9
        > 0.5
        > part[at["border along its weakest quarter"]]
    )
    assert object_[at["border inside"]] == approx(0.03, abs=0.01)
    assert pair[at["border inside, strongest fiftieth"]] > 0.5
    assert object_[at["together, farther"]] > 0.9 > pair[at["together, farther"]]
    assert part[at["with others, farther"]] > 0.3 > object_[at["with others, farther"]]
    assert object_[at["log size"]] == approx(np.log((labels == 5).mean()), abs=1e-6)
    assert object_[at["cut by the photo"]] == 0


def test_rough_mask_lies_where_object_is() -> None:
    """In a box that reaches beyond the photo, and on a grid of another size."""
    rgb = np.full((240, 320, 3), (190, 190, 185), np.uint8)
    cv2.circle(rgb, (290, 60), 50, (150, 60, 40), -1, cv2.LINE_AA)
    for shape in ((120, 160), (240, 320), (96, 128)):
        found = rough_mask_in_box(rgb, (235.0, 5.0, 345.0, 115.0), shape)
        assert found is not None
        y, x = np.indices(shape)
        scale = 240 / shape[0]
        away = np.hypot((x + 0.5) * scale - 290.5, (y + 0.5) * scale - 60.5)
        truth = away <= 50
        mask = found.on(shape)
        assert (mask & truth).sum() > 0.85 * (mask | truth).sum(), shape
    assert rough_mask_in_box(rgb, (500.0, 5.0, 600.0, 99.0), (120, 160)) is None


@pytest.mark.slow
def test_the_shipped_network_is_small_and_sees_mirrored_what_is_mirrored() -> None:
    from physgen.perceive.segment import network

    file = network.Path(network.__file__).with_name(WEIGHTS)
    assert file.stat().st_size < 10e6
    rng = np.random.default_rng(0)
    photo = cv2.GaussianBlur(rng.integers(0, 255, (192, 256, 3), np.uint8), (0, 0), 3)
    cv2.circle(photo, (90, 96), 40, (200, 60, 40), -1)
    seen, mirrored = (
        run_network(photo),
        run_network(np.ascontiguousarray(photo[:, ::-1])),
    )
    assert seen.foreground.shape == (192, 256)
    assert np.abs(np.linalg.norm(seen.normals, axis=2) - 1).max() < 1e-3
    for name in ("foreground", "boundary", "shadow", "movable"):
        assert getattr(mirrored, name)[:, ::-1] == approx(getattr(seen, name), abs=1e-3)
    assert mirrored.normals[:, ::-1] * [-1, 1, 1] == approx(seen.normals, abs=2e-3)
    for (down, right), here in zip(OFFSETS, seen.pairs, strict=True):
        there = mirrored.pairs[
            OFFSETS.index((down, -right) if down else (0, right)), :, ::-1
        ]
        if down:  # of two pixels of a row, the other comes first
            assert there == approx(here, abs=1e-3)
        else:
            assert there[:, right:] == approx(here[:, :-right], abs=1e-3)
