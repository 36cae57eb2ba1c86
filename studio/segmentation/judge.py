"""Candidates of labelled pictures -> how well each fits an object, learned.

    python studio/segmentation/judge_examples.py -o out/segmentation/judge
    python studio/segmentation/judge.py out/segmentation/judge

Boosted trees learn the overlap (IoU) of each candidate with the best movable object;
what edges select earns a bonus, from which they do not learn. Judges of two thirds of
the photos choose in the remaining third, and how often they are right there is the
calibration of the shipped one, which learns from all.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.isotonic import IsotonicRegression

from physgen.perceive.backends.segment_learned import with_agreement
from physgen.perceive.segment import judge
from physgen.perceive.segment.evidence import context_features
from physgen.perceive.segment.focus import blur_shares
from physgen.perceive.segment.proposals import Proposal
from physgen.perceive.segment.selection import choose_candidates

Array = NDArray[np.float64]

SHIPPED = Path(judge.__file__).with_name(judge.JUDGE)
FOLDS = 3
RIGHT = 0.5
"""IoU from which a candidate is right."""
UNKNOWN = 0.5
"""Share of unjudged pixels from which a candidate is neither right nor wrong."""
LEAST_AREA = 0.01
"""Of the photo: smaller objects of COCO do not count, and to find one is not wrong."""
COUNTED = 0.25
"""Fit from which chosen candidates are counted: doubtful regions lie below the rest."""
COUNTED_SETS = (
    "coco", "coco-minis", "trashnet-grabcut", "fruits-nuts", "class5", "bundled", "homes",
)  # fmt: skip
"""Sets that tell how often a choice is right: photos and rendered ones.

Of those of caltech101-part only one object has a mask.
"""
HIGHEST = 1.5
"""Fit with the whole bonus."""
MOST_WRONG = 70
"""Candidates of a picture that fit nothing, of which the judge learns at most."""
HARDLY = 0.2
"""IoU below which a candidate fits nothing."""
WEIGHTS = {"drawn": 1.5, "homes": 2.0, "bundled": 3.0, "caltech101-part": 0.6}
"""Weight of a picture of a set, where it is not 1."""
TREES = {
    "max_iter": 100, "learning_rate": 0.1, "max_leaf_nodes": 16, "min_samples_leaf": 30,
    "l2_regularization": 5.0, "max_features": 0.5, "early_stopping": False,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Judged:
    """One picture's candidates with their truth."""

    set_name: str
    name: str
    shape: tuple[int, int]
    features: Array
    alone: Array  # the same of candidates without those that edges select
    proposals: Sequence[Proposal]
    overlap: Array  # (n, objects): IoU with each true object
    unjudged: Array  # (n,)
    edges: Array  # (n,) 0..1: confidence of what edges select, else 0
    sharpness: Array  # (n,): of the rims
    is_movable: NDArray[np.bool_]  # (objects,)
    area: Array  # (objects,): of the picture

    @property
    def fit(self) -> Array:
        """(n,): IoU with the best movable object."""
        return self.overlap[:, self.is_movable].max(axis=1, initial=0.0)

    @property
    def counts(self) -> NDArray[np.bool_]:
        """(objects,): movable and large enough to count."""
        least = LEAST_AREA if self.set_name.startswith("coco") else 0.0
        return self.is_movable & (self.area >= least)

    def without_edges(self) -> Judged:
        """Return the picture without what edges select, which comes last."""
        count = len(self.alone)
        return replace(
            self,
            features=self.alone,
            proposals=self.proposals[:count],
            overlap=self.overlap[:count],
            unjudged=self.unjudged[:count],
            edges=self.edges[:count],
            sharpness=self.sharpness[:count],
        )

    def score(self, chosen: NDArray[np.intp]) -> tuple[NDArray[np.bool_], Array]:
        """Return which of the chosen are judged, and their overlap where they are right.

        `chosen` are in falling order of confidence; an object is matched once.
        """
        free = self.counts.copy()
        is_judged = np.ones(len(chosen), np.bool_)
        reached = np.zeros(len(chosen))
        for place, k in enumerate(chosen.tolist()):
            overlap = np.where(free, self.overlap[k], 0)
            best = int(overlap.argmax()) if len(overlap) else -1
            if best >= 0 and overlap[best] >= RIGHT:
                reached[place], free[best] = overlap[best], False
                continue
            small = self.overlap[k][self.is_movable & ~self.counts].max(initial=0.0)
            is_judged[place] = self.unjudged[k] < UNKNOWN and small < RIGHT
        return is_judged, reached


def read_folder(folder: Path) -> list[Judged]:
    """Return the pictures that judge_examples.py wrote to a folder."""
    return [_read(path) for path in sorted(folder.glob("*/*.npz"))]


def _read(path: Path) -> Judged:
    with np.load(path) as stored:
        parts = {name: stored[name] for name in stored.files}
    boxes = parts["boxes"]
    sizes = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    bits = np.unpackbits(parts["masks"])[: sizes.sum()].astype(bool)
    proposals = []
    for box, mask in zip(
        boxes.tolist(), np.split(bits, np.cumsum(sizes)[:-1]), strict=False
    ):
        mask = mask.reshape(box[3] - box[1], box[2] - box[0])
        proposals.append(Proposal(box[0], box[1], mask, int(mask.sum())))
    height, width = parts["shape"].tolist()
    return Judged(
        path.parent.name, path.stem, (height, width), parts["features"].astype(float),
        parts["alone"].astype(float), proposals, parts["overlap"].astype(float), parts["unjudged"].astype(float),
        parts["edges"], parts["sharpness"], parts["is_movable"], parts["area"],
    )  # fmt: skip


def teach(pictures: Sequence[Judged], seed: int) -> dict[str, NDArray]:
    """Return the judge's numbers without the calibration."""
    x, y, weight = [], [], []
    rng = np.random.default_rng(seed)
    for one in pictures:
        is_known = one.unjudged < UNKNOWN
        wrong = np.flatnonzero(is_known & (one.fit < HARDLY))
        is_known[rng.permutation(wrong)[MOST_WRONG:]] = False
        if not is_known.any():
            continue
        fit = one.fit[is_known]
        share = (0.3 + fit) / (0.3 + fit).sum()
        objects = max(1, int(one.is_movable.sum()))
        x.append(one.features[is_known])
        y.append(fit)
        weight.append(share * WEIGHTS.get(one.set_name, 1.0) * objects**0.5)
    weights = np.concatenate(weight)
    model = HistGradientBoostingRegressor(**TREES, random_state=seed)
    model.fit(np.concatenate(x), np.concatenate(y), weights / weights.mean())
    return _as_numbers(model)


def _as_numbers(model: HistGradientBoostingRegressor) -> dict[str, NDArray]:
    """Return the nodes of all trees one after another; a leaf leads to itself."""
    parts: dict[str, list] = {
        key: [] for key in ("feature", "threshold", "low", "high", "value", "root")
    }
    start = depth = 0
    for (tree,) in model._predictors:
        nodes = tree.nodes
        places, is_leaf = np.arange(len(nodes)), nodes["is_leaf"].astype(bool)
        parts["root"].append([start])
        parts["feature"].append(np.where(is_leaf, 0, nodes["feature_idx"]))
        parts["threshold"].append(np.where(is_leaf, 0, nodes["num_threshold"]))
        parts["low"].append(start + np.where(is_leaf, places, nodes["left"]))
        parts["high"].append(start + np.where(is_leaf, places, nodes["right"]))
        parts["value"].append(np.where(is_leaf, nodes["value"], 0))
        start, depth = start + len(nodes), max(depth, int(nodes["depth"].max()))
    kinds = {"feature": np.uint8, "threshold": np.float32, "value": np.float32}
    numbers = {
        key: np.concatenate(values).astype(kinds.get(key, np.uint16))
        for key, values in parts.items()
    }
    base = float(model._baseline_prediction.ravel()[0])
    return {**numbers, "depth": np.array(depth), "base": np.array(base)}


def mean_judge(
    one: dict[str, NDArray], other: dict[str, NDArray]
) -> dict[str, NDArray]:
    """Return the numbers of a judge that expects the mean of two judges' fits."""
    mean = {"fit": one["fit"], "right": (one["right"] + other["right"]) / 2}
    for stage in judge.STAGES:
        count = len(one[f"{stage}.feature"])
        for part in ("feature", "threshold", "low", "high", "root", "value"):
            name = f"{stage}.{part}"
            # places of nodes move behind the nodes of the first judge
            is_place = part in ("low", "high", "root")
            moved = other[name] + is_place * count
            mean[name] = np.concatenate([one[name], moved]).astype(one[name].dtype)
        mean[f"{stage}.value"] /= 2
        depths = one[f"{stage}.depth"], other[f"{stage}.depth"]
        mean[f"{stage}.depth"] = np.maximum(*depths)
        bases = one[f"{stage}.base"], other[f"{stage}.base"]
        mean[f"{stage}.base"] = np.mean(bases)
    return mean


def calibrate(fit: Array, right: Array) -> dict[str, NDArray]:
    """Return pairs of a fit and the share of chosen candidates of such a fit that are right."""
    curve = IsotonicRegression(y_min=0, y_max=1, out_of_bounds="clip").fit(fit, right)
    places = np.linspace(0, HIGHEST, 61)
    share = curve.predict(places)
    # steps of the curve are smoothed, and nothing is certain
    share = np.convolve(np.pad(share, 2, mode="edge"), np.ones(5) / 5, mode="valid")
    return {"fit": places, "right": np.clip(share, 0.0, 0.99)}


def cross_fit(pictures: Sequence[Judged], taught: Sequence[Judged]) -> list[Array]:
    """Return the fits of each picture's candidates by a judge that did not learn from it.

    `taught` are the same pictures as a judge learns from them.
    """
    fits: list[Array] = [np.zeros(0)] * len(pictures)
    for fold in range(FOLDS):
        learning = [one for k, one in enumerate(taught) if k % FOLDS != fold]
        trees = teach(learning, fold)
        for k in range(fold, len(pictures), FOLDS):
            fits[k] = judge.sum_trees(pictures[k].features, trees)
    return fits


def with_context(pictures: Sequence[Judged], fits: Sequence[Array]) -> list[Judged]:
    """Return the pictures with the features that a first judgement adds."""
    return [
        replace(
            one,
            features=np.hstack([one.features, context_features(one.proposals, fit)]),
        )
        for one, fit in zip(pictures, fits, strict=True)
    ]


def choose(one: Judged, fit: Array, least: float) -> tuple[NDArray[np.intp], Array]:
    """Return what `segment` would choose but for its rule of gaps, and its fit."""
    fit = with_agreement(fit, one.edges, one.features)
    chosen = choose_candidates(one.proposals, one.shape, fit, least)
    areas = np.array([one.proposals[k].area for k in chosen.tolist()], float)
    worth = fit[chosen] * (1 - blur_shares(one.sharpness[chosen], areas))
    order = np.argsort(-worth, kind="stable")
    order = order[worth[order] > least]
    return chosen[order], worth[order]


def count_right(
    pictures: Sequence[Judged], fits: Sequence[Array], least: float
) -> tuple[Array, Array]:
    """Return the fit of every chosen and judged candidate, and whether it is right."""
    stated_fits, right = [np.zeros(0)], [np.zeros(0)]
    for one, fit in zip(pictures, fits, strict=True):
        chosen, worth = choose(one, fit, least)
        is_judged, reached = one.score(chosen)
        stated_fits.append(worth[is_judged])
        right.append((reached > 0)[is_judged])
    return np.concatenate(stated_fits), np.concatenate(right).astype(float)


def report(
    name: str, pictures: Sequence[Judged], fits: Sequence[Array], least: float
) -> None:
    """Print precision, recall and F1 of a set on the network's grid."""
    stated_fits, right = count_right(pictures, fits, least)
    true = sum(int(one.counts.sum()) for one in pictures)
    best = sum(
        int((one.overlap.max(axis=0, initial=0)[one.counts] >= RIGHT).sum())
        for one in pictures
    )
    hit = right.sum()
    print(
        f"{name:18} {len(pictures):4} photos {true:5} true  P {hit / max(len(stated_fits), 1):.3f}"
        f"  R {hit / max(true, 1):.3f}  F {2 * hit / max(len(stated_fits) + true, 1):.3f}"
        f"  in reach {best / max(true, 1):.3f}",
        file=sys.stderr,
    )


def report_sets(
    pictures: Sequence[Judged], fits: Sequence[Array], least: float
) -> None:
    """Print the figures of each set."""
    for name in sorted({one.set_name for one in pictures}):
        subset = [k for k, one in enumerate(pictures) if one.set_name == name]
        report(name, [pictures[k] for k in subset], [fits[k] for k in subset], least)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("examples", type=Path, help="folder of judge_examples.py")
    parser.add_argument("-o", "--output", type=Path, default=SHIPPED)
    parser.add_argument(
        "--mean-with", type=Path, help="former judge, of which half is kept"
    )
    parser.add_argument("--least", type=float, default=0.55, help="fit of an object")
    args = parser.parse_args()
    pictures = read_folder(args.examples / "training")
    order = np.random.default_rng(0).permutation(len(pictures))
    pictures = [pictures[k] for k in order.tolist()]
    taught = [one.without_edges() for one in pictures]
    described = with_context(taught, cross_fit(taught, taught))
    with_edges = with_context(pictures, cross_fit(pictures, taught))
    fits = cross_fit(with_edges, described)
    print("cross-fitted, training photos:", file=sys.stderr)
    report_sets(pictures, fits, args.least)
    counted = [k for k, one in enumerate(pictures) if one.set_name in COUNTED_SETS]
    stated_fits, right = count_right(
        [pictures[k] for k in counted], [fits[k] for k in counted], COUNTED
    )
    numbers = calibrate(stated_fits, right)
    for stage, subset in zip(judge.STAGES, (taught, described), strict=True):
        trees = teach(subset, FOLDS)
        numbers |= {f"{stage}.{name}": part for name, part in trees.items()}
    if args.mean_with:
        with np.load(args.mean_with) as stored:
            numbers = mean_judge(dict(stored), numbers)
    np.savez_compressed(args.output, **numbers)
    report_held_out(
        args.examples / "held-out", judge.read_judge(args.output), args.least
    )


def report_held_out(folder: Path, made: judge.Judge, least: float) -> None:
    """Print the figures of pictures that only measure, and the reliability."""
    pictures = read_folder(folder)
    if not pictures:
        return
    fits = [made.expected_fit(one.proposals, one.features) for one in pictures]
    print("held-out photos:", file=sys.stderr)
    report_sets(pictures, fits, least)
    stated_fits, right = count_right(pictures, fits, least)
    stated = judge.confidence(stated_fits, made)
    for low in np.arange(0.3, 1.0, 0.1):
        subset = (stated >= low) & (stated < low + 0.1)
        if subset.any():
            share = right[subset].mean()
            print(
                f"stated {low:.1f}: {int(subset.sum())} found, {share:.2f} right",
                file=sys.stderr,
            )


if __name__ == "__main__":
    main()
