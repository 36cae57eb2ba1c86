"""The judge: how well each candidate fits a whole movable object, by boosted trees.

It judges twice: a first time each candidate by itself, then each beside the first fits
of the others, which tells wholes from parts and piles. `studio/segmentation/judge.py`
makes the numbers in `judge.npz`.
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
"""Of trees: `feature`, `threshold`, `low`, `high` (children), `value` of all nodes,
`root` of each tree, `depth` and `base`."""

JUDGE = "judge.npz"
STAGES = ("first", "second")
"""Begin the names of the two judgements' numbers in the file."""


@dataclass(frozen=True, eq=False)
class Judge:
    """Both judgements, and the calibration."""

    first: Numbers
    second: Numbers
    fit: Array  # (k,): expected fits, and
    right: Array  # (k,): the share of chosen candidates of such a fit that are right

    def expected_fit(self, candidates: Sequence[Proposal], features: Array) -> Array:
        """Return (n,) 0..1: the expected IoU of candidates with the best object."""
        first = sum_trees(features, self.first)
        context = context_features(candidates, first)
        return sum_trees(np.hstack([features, context]), self.second)


@dataclass(frozen=True, eq=False)
class JudgedCandidates:
    """The candidates of a photo and what the judge expects of them."""

    found: Candidates
    fit: Array  # (n,) 0..1: expected IoU with the best movable object
    boxes: DetectedBoxes  # on the photo


def judge_photo(rgb: NDArray[np.uint8]) -> JudgedCandidates:
    """Return the judged candidates of a photo (H, W, 3) sRGB.

    Those of the last photo are kept, since a point needs them again.
    """
    return _judge_photo(rgb.tobytes(), rgb.shape[0], rgb.shape[1])


@lru_cache(maxsize=1)
def _judge_photo(codes: bytes, height: int, width: int) -> JudgedCandidates:
    rgb = np.frombuffer(codes, np.uint8).reshape(height, width, 3)
    seen = run_network(rgb)
    boxes = release_models(rgb, detect_boxes(rgb))
    found = find_candidates(rgb, seen, boxes, search_edges(rgb))
    fit = shipped_judge().expected_fit(found.proposals, found.features)
    return JudgedCandidates(found, fit, boxes)


def judge_others(
    rgb: NDArray[np.uint8], judged: JudgedCandidates, others: Sequence[Proposal]
) -> Array:
    """Return (n,) the expected fits of other masks beside the candidates of a photo."""
    if not others:
        return np.zeros(0)
    evidence = gather_evidence(rgb, run_network(rgb), judged.boxes)
    found = judged.found
    features = np.vstack([found.features, judge_features(others, evidence)])
    fit = shipped_judge().expected_fit([*found.proposals, *others], features)
    return fit[len(found.proposals) :]


def sum_trees(features: Array, trees: Numbers) -> Array:
    """Return the sum (n,) 0..1 of the leaves of all trees that features (n, k) reach."""
    feature, threshold = trees["feature"], trees["threshold"]
    rows = np.arange(len(features))[:, None]
    node = np.tile(trees["root"], (len(features), 1)).astype(np.intp)
    for _ in range(int(trees["depth"])):
        # a leaf leads to itself
        is_low = features[rows, feature[node]] <= threshold[node]
        node = np.where(is_low, trees["low"][node], trees["high"][node])
    total = trees["base"] + trees["value"][node].sum(axis=1)
    return np.asarray(np.clip(total, 0, 1), np.float64)


def confidence(fit: Array, judge: Judge | None = None) -> Array:
    """Return (n,) 0..1: the counted share of chosen candidates of such a fit that are right."""
    judge = judge or shipped_judge()
    return np.asarray(np.interp(fit, judge.fit, judge.right), np.float64)


@cache
def shipped_judge() -> Judge:
    """Return the judge of the package's file."""
    return read_judge(Path(__file__).with_name(JUDGE))


def read_judge(path: Path) -> Judge:
    """Read a judge's file."""
    with np.load(path) as stored:
        numbers = {name: stored[name] for name in stored.files}
    stages = [
        {
            name.removeprefix(f"{stage}."): part
            for name, part in numbers.items()
            if name.startswith(f"{stage}.")
        }
        for stage in STAGES
    ]
    return Judge(stages[0], stages[1], numbers["fit"], numbers["right"])
