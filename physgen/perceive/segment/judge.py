"""The judge: boosted trees that predict the fit of a candidate to a movable object.

It judges twice: first each candidate by itself, then each candidate beside the first
fits of the others, which separates wholes from parts and piles.
`studio/segmentation/judge.py` makes the numbers in `judge.npz`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physgen.perceive.segment.candidates import Candidates, find_candidates
from physgen.perceive.segment.detector import DetectedBoxes, detect_boxes
from physgen.perceive.segment.edges import search_edges
from physgen.perceive.segment.evidence import (
    context_features,
    gather_evidence,
    judge_features,
)
from physgen.perceive.segment.living import release_models
from physgen.perceive.segment.network import run_network
from physgen.perceive.segment.proposals import Proposal

Array = NDArray[np.float64]
Numbers = Mapping[str, NDArray[np.generic]]
"""Arrays of trees: `feature`, `threshold`, `low`, `high` (children) and `value` of all
nodes, `root` of each tree, `depth` and `base`.
"""

JUDGE = "judge.npz"
STAGES = ("first", "second")
"""Prefixes of the two judgements' arrays in the file."""


@dataclass(frozen=True, eq=False)
class Judge:
    """Both judgements and the calibration."""

    first: Numbers
    second: Numbers
    # (k,): expected fits, and
    fit: Array
    # (k,): the share of correct candidates among chosen ones with that fit.
    right: Array

    def expected_fit(self, candidates: Sequence[Proposal], features: Array) -> Array:
        """Return the expected IoU (n,) of candidates with the best object, 0..1."""
        first = sum_trees(features, self.first)
        context = context_features(candidates, first)
        return sum_trees(np.hstack([features, context]), self.second)


@dataclass(frozen=True, eq=False)
class JudgedCandidates:
    """The candidates of a photo and their expected fits."""

    candidates: Candidates
    # (n,) 0..1: expected IoU with the best movable object.
    fit: Array
    # On the photo.
    boxes: DetectedBoxes


def judge_photo(rgb: NDArray[np.uint8]) -> JudgedCandidates:
    """Return the judged candidates of a photo (H, W, 3) sRGB.

    The last result is cached, since a point uses it again.
    """
    return _judge_photo(rgb.tobytes(), rgb.shape[0], rgb.shape[1])


@lru_cache(maxsize=1)
def _judge_photo(codes: bytes, height: int, width: int) -> JudgedCandidates:
    """Return the judged candidates of a photo given as bytes."""
    rgb = np.frombuffer(codes, np.uint8).reshape(height, width, 3)
    maps = run_network(rgb)
    boxes = release_models(rgb, detect_boxes(rgb))
    candidates = find_candidates(rgb, maps, boxes, search_edges(rgb))
    fit = shipped_judge().expected_fit(candidates.proposals, candidates.features)
    return JudgedCandidates(candidates, fit, boxes)


def judge_others(
    rgb: NDArray[np.uint8], judgement: JudgedCandidates, others: Sequence[Proposal]
) -> Array:
    """Return the expected fits (n,) of other masks beside the candidates of a photo."""
    if not others:
        return np.zeros(0)
    evidence = gather_evidence(rgb, run_network(rgb), judgement.boxes)
    candidates = judgement.candidates
    # Context features compare each mask with all candidates of the photo.
    features = np.vstack([candidates.features, judge_features(others, evidence)])
    fit = shipped_judge().expected_fit([*candidates.proposals, *others], features)
    return fit[len(candidates.proposals) :]


def sum_trees(features: Array, trees: Numbers) -> Array:
    """Return the sum (n,) 0..1 of the leaves of all trees for features (n, k)."""
    feature = trees["feature"]
    threshold = trees["threshold"]
    rows = np.arange(len(features))[:, None]
    node = np.tile(trees["root"], (len(features), 1)).astype(np.intp)
    for _ in range(int(trees["depth"])):
        # A leaf points to itself, so that all rows take `depth` steps.
        is_low = features[rows, feature[node]] <= threshold[node]
        node = np.where(is_low, trees["low"][node], trees["high"][node])
    total = trees["base"] + trees["value"][node].sum(axis=1)
    return np.asarray(np.clip(total, 0, 1), np.float64)


def confidence(fit: Array, judge: Judge | None = None) -> Array:
    """Return the measured share (n,) 0..1 of correct candidates with such a fit."""
    judge = judge or shipped_judge()
    return np.asarray(np.interp(fit, judge.fit, judge.right), np.float64)


@cache
def shipped_judge() -> Judge:
    """Return the bundled judge."""
    return read_judge(Path(__file__).with_name(JUDGE))


def read_judge(path: Path) -> Judge:
    """Read a judge's file."""
    with np.load(path) as arrays:
        numbers = {name: arrays[name] for name in arrays.files}
    stages = []
    for stage in STAGES:
        stages.append(
            {
                name.removeprefix(f"{stage}."): part
                for name, part in numbers.items()
                if name.startswith(f"{stage}.")
            }
        )
    return Judge(stages[0], stages[1], numbers["fit"], numbers["right"])
