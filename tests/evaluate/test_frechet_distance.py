"""The Fréchet distance against torchmetrics, scipy's root of a matrix, and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import torch
from torchmetrics.image.fid import FrechetInceptionDistance

from physgen.evaluate.fid import Moments, cloud, distances, frechet, moments

RANDOM = np.random.default_rng


def moments_of(mean: np.ndarray, covariance: np.ndarray) -> Moments:
    values, vectors = np.linalg.eigh(covariance)
    return Moments(mean, np.sqrt(np.maximum(values, 0))[:, None] * vectors.T)


def correlated(seed: int, count: int, wide: int, shift: float = 0.0) -> np.ndarray:
    random = RANDOM(seed)
    return (
        random.normal(size=(count, wide)) @ random.normal(size=(wide, wide))
        + shift
        + random.normal(size=wide)
    )


class Passed(torch.nn.Module):
    """Features that stand in the pictures' first pixels, as they are: what torchmetrics sees is what we see."""

    def __init__(self, wide: int) -> None:
        super().__init__()
        self.num_features = wide

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        return pictures.flatten(1)[:, : self.num_features]


def by_torchmetrics(one: np.ndarray, other: np.ndarray) -> float:
    judge = FrechetInceptionDistance(
        feature=Passed(one.shape[1]), normalize=True, input_img_size=(3, 8, 8)
    )
    judge.set_dtype(torch.float64)
    judge.used_custom_model = True
    for real, features in ((True, one), (False, other)):
        pictures = np.zeros((len(features), 3 * 8 * 8))
        pictures[:, : features.shape[1]] = features
        judge.update(torch.from_numpy(pictures).reshape(-1, 3, 8, 8), real=real)
    return float(judge.compute())


def by_scipy(one: np.ndarray, other: np.ndarray) -> float:
    first, second = np.cov(one.T), np.cov(other.T)
    root = scipy.linalg.sqrtm(first @ second)
    apart = ((one.mean(0) - other.mean(0)) ** 2).sum()
    return float(apart + np.trace(first + second - 2 * root.real))


@pytest.mark.parametrize(("wide", "shift"), [(5, 0.0), (40, 0.7), (100, 30.0)])
def test_agrees_with_two_others(wide: int, shift: float) -> None:
    one, other = correlated(1, 250, wide), correlated(2, 400, wide, shift)
    found = frechet(moments(one), moments(other))
    assert found == pytest.approx(by_torchmetrics(one, other), rel=1e-6)
    assert found == pytest.approx(by_scipy(one, other), rel=1e-6)
    of_moments = [
        moments_of(features.mean(0), np.cov(features.T)) for features in (one, other)
    ]
    assert found == pytest.approx(frechet(*of_moments), rel=1e-9)


def test_closed_form_of_covariances_that_commute() -> None:
    random = RANDOM(3)
    axes, _ = np.linalg.qr(random.normal(size=(30, 30)))
    first, second = random.uniform(0.01, 9, 30), random.uniform(0.01, 9, 30)
    first[:4] = second[10:15] = 0  # flat in some directions
    mean = random.normal(size=30)
    true = (mean**2).sum() + ((np.sqrt(first) - np.sqrt(second)) ** 2).sum()
    one = moments_of(np.zeros(30), axes @ np.diag(first) @ axes.T)
    other = moments_of(mean, axes @ np.diag(second) @ axes.T)
    assert frechet(one, other) == pytest.approx(true, rel=1e-6)


def test_fewer_pictures_than_features() -> None:
    """In other axes, where both sets fill all of the space that they have, scipy can tell."""
    random = RANDOM(4)
    inside = [
        random.normal(size=(300, 12)),
        random.normal(size=(200, 12)) @ np.diag(random.uniform(0.2, 3, 12)) + 1,
    ]
    axes, _ = np.linalg.qr(random.normal(size=(2048, 12)))
    outside = [features @ axes.T + 5 for features in inside]
    true = by_scipy(*inside)
    assert frechet(*map(moments, outside)) == pytest.approx(true, rel=1e-6)
    few = [features[:9] for features in outside]  # ranks of 8, in spaces that differ
    assert frechet(*map(moments, few)) > true
    assert frechet(moments(few[0]), moments(few[0])) == pytest.approx(0, abs=1e-9)


def test_two_pictures_are_enough_and_one_is_not() -> None:
    pair = np.array([[0.0, 0.0], [2.0, 0.0]])  # variance 2 along x
    other = np.array([[1.0, 3.0], [1.0, 5.0]])  # variance 2 along y, 4 higher
    assert frechet(moments(pair), moments(other)) == pytest.approx(16 + 2 + 2)
    with pytest.raises(ValueError, match="two pictures"):
        moments(pair[:1])


def test_weights_are_repetitions() -> None:
    features = correlated(5, 20, 6)
    often = RANDOM(6).integers(0, 4, 20)
    one, other = (
        moments(features, often.astype(float)),
        moments(np.repeat(features, often, axis=0)),
    )
    assert np.allclose(one.root.T @ one.root, other.root.T @ other.root)
    assert np.allclose(one.mean, other.mean)


def test_intervals_are_of_clips_not_of_frames() -> None:
    """Frames that repeat their clip make no interval narrower; independent ones would, by about the root of eight."""
    random = RANDOM(12)
    truth, clips = random.normal(size=(40, 1, 3)), random.normal(size=(40, 1, 3)) + 0.8
    found = {}
    for frames in (1, 8):
        sides = [np.repeat(side, frames, axis=1) for side in (truth, clips)]
        low, high = distances(cloud(sides[0]), {"it": cloud(sides[1])}, draws=200)[
            "it"
        ].interval
        found[frames] = high - low
    assert found[8] == pytest.approx(found[1], rel=0.1)


def test_an_interval_holds_what_other_clips_give() -> None:
    """Coverage: 95 % intervals, moved from each finding, hold the mean of all findings in most of many repetitions."""
    random = RANDOM(13)
    found = []
    for _ in range(60):
        sides = random.normal(size=(2, 30, 2, 3))
        one = distances(cloud(sides[0]), {"it": cloud(sides[1] + 1)}, draws=60)["it"]
        found.append((one.value, *one.interval))
    values, lows, highs = np.array(found).T
    mean = values.mean()
    assert np.mean((lows <= mean) & (mean <= highs)) > 0.85
    assert ((lows <= values) & (values <= highs)).all()
