"""Learns the view of a photo from labelled photos; writes physgen/perceive/support/view.npz.

    PHYSGEN_MATERIAL=FOLDER python studio/view_weights.py --cache out/view-features.npz

Half of the labelled photos, crops of them and the bundled photos are learned from; the
other half is measured, and no choice depends on it. Some 20 minutes on one core, or a few
seconds where the cache has the features.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from view_labels import (
    LabelledPhoto,
    bundled_photos,
    labelled_photos,
    material_folder,
)

from physgen.perceive.photo_size import shrink_photo
from physgen.perceive.segment.network import run_network
from physgen.perceive.support.view_classifier import CLIP, WEIGHTS
from physgen.photos import read_photo

F64 = NDArray[np.float64]
OUTPUT = Path(__file__).parents[1] / "physgen/perceive/support" / WEIGHTS
SET_WEIGHTS = {"trashnet-grabcut": 0.4, "class5": 0.3, "caltech101-part": 0.7}
"""Of a photo: sets whose photos look alike count less."""
UNSUITABLE_WEIGHT = 0.3
"""Of a photo that cannot be animated: most are from the side, and none will be used."""
CROP_WEIGHT, BUNDLED_WEIGHT = 0.35, 0.7
"""Of a crop of a photo, and of a bundled photo."""
CROPS = 2
"""Crops of each photo that can be animated."""
WITHOUT_CROPS = ("trashnet-grabcut", "class5", "fruits-nuts")
"""Sets of one view that have many photos already."""
CROP_SIDES = 0.68, 0.95
"""Sides of a crop, of the photo's."""
RIDGE = 0.01
"""Penalty of squared weights, per feature; the best of a tenth to ten times as much in
five-fold cross-validation in the half that is learned from."""
DRAWINGS = "caltech101-part"
"""Set whose photos that cannot be animated are mostly drawings, which have no view."""
ITERATIONS = 30
"""Newton steps; the loss changes by less than 1e-6 after a dozen."""


@dataclass(frozen=True)
class Example:
    """A photo or a crop to learn from or to measure with."""

    name: str
    view: str
    can_animate: bool
    weight: float
    is_for_training: bool


def examples(
    photos: Sequence[LabelledPhoto], material: Path
) -> Iterator[tuple[Example, Path, int | None]]:
    """Yield examples with their file, and the seed of a crop."""
    for photo in photos:
        weight = SET_WEIGHTS.get(photo.set, 1.0)
        if not photo.can_animate:
            weight *= UNSUITABLE_WEIGHT
        if photo.set == DRAWINGS and not photo.can_animate:
            continue
        file = photo.file(material)
        view, training = photo.view, photo.is_for_training
        yield Example(photo.name, view, photo.can_animate, weight, training), file, None
        can_crop = photo.can_animate and photo.set not in WITHOUT_CROPS
        if not (training and can_crop):
            continue
        for seed in range(CROPS):
            name = f"{photo.name}#{seed}"
            yield Example(name, view, True, weight * CROP_WEIGHT, True), file, seed
    for name, file, view in bundled_photos():
        yield Example(name, view, True, BUNDLED_WEIGHT, True), file, None


def features_of(file: Path, name: str, seed: int | None) -> NDArray[np.float32]:
    """Return the features of a photo, or of a crop of it."""
    rgb = shrink_photo(read_photo(file).rgb, 1600)
    if seed is not None:
        draw = random.Random(name)
        height, width = rgb.shape[:2]
        high = int(height * draw.uniform(*CROP_SIDES))
        wide = int(width * draw.uniform(*CROP_SIDES))
        top, left = draw.randint(0, height - high), draw.randint(0, width - wide)
        rgb = np.ascontiguousarray(rgb[top : top + high, left : left + wide])
    return run_network(rgb).features


def all_features(material: Path, cache: Path) -> tuple[list[Example], F64]:
    """Return all examples and their features (N, D), kept in a cache file."""
    stored: dict[str, NDArray[np.float32]] = {}
    if cache.is_file():
        with np.load(cache) as known:
            stored = dict(zip(known["names"].tolist(), known["features"], strict=True))
    rows = []
    for example, file, seed in examples(labelled_photos(), material):
        if example.name not in stored:
            stored[example.name] = features_of(file, example.name, seed)
            print(f"\r{len(stored)} {example.name:<50}", end="", file=sys.stderr)
        rows.append(example)
    cache.parent.mkdir(parents=True, exist_ok=True)
    table = np.stack(list(stored.values()))
    np.savez(cache, names=list(stored), features=table)
    return rows, np.stack([stored[row.name] for row in rows]).astype(np.float64)


def fit_logistic(x: F64, y: F64, weights: F64, ridge: float) -> tuple[F64, float]:
    """Return weights (D,) and bias of a penalised logistic regression, by Newton's method."""
    # the solution lies in the span of the examples, which has fewer dimensions
    _, sizes, axes = np.linalg.svd(x, full_matrices=False)
    axes = axes[sizes > 1e-9 * sizes[0]]
    reduced = np.hstack([x @ axes.T, np.ones((len(x), 1))])
    penalty = np.full(reduced.shape[1], ridge)
    penalty[-1] = 1e-9
    solution = np.zeros(reduced.shape[1])
    for _ in range(ITERATIONS):
        chance = 1 / (1 + np.exp(-np.clip(reduced @ solution, -30, 30)))
        gradient = reduced.T @ (weights * (chance - y)) + penalty * solution
        curvature = weights * chance * (1 - chance)
        hessian = (reduced * curvature[:, None]).T @ reduced + np.diag(penalty)
        solution -= np.linalg.solve(hessian, gradient)
    return axes.T @ solution[:-1], float(solution[-1])


def train(rows: Sequence[Example], features: F64) -> dict[str, NDArray[np.float32]]:
    """Return the arrays of the weights file."""
    training = np.array([row.is_for_training for row in rows])
    mean = features[training].mean(axis=0)
    spread = features[training].std(axis=0) + 1e-6
    x = np.clip((features[training] - mean) / spread, -CLIP, CLIP)
    chosen = [row for row in rows if row.is_for_training]
    weights = np.array([row.weight for row in chosen])
    targets = (
        [row.view == "top" for row in chosen],
        [row.view != "side" for row in chosen],
        [not row.can_animate for row in chosen],
    )
    found = []
    for target in targets:
        y = np.array(target, np.float64)
        found.append(fit_logistic(x, y, weights, RIDGE * x.shape[1]))
    arrays = {
        "mean": mean,
        "spread": spread,
        "weights": np.stack([one for one, _ in found]),
        "bias": np.array([bias for _, bias in found]),
    }
    return {name: array.astype(np.float32) for name, array in arrays.items()}


def main() -> None:
    """Learn the weights and write them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path, default=Path("out/view-features.npz"))
    options = parser.parse_args()
    material = material_folder()
    if material is None:
        sys.exit("PHYSGEN_MATERIAL: name the folder of the labelled photos")
    rows, features = all_features(material, options.cache)
    arrays = train(rows, features)
    stored = {name: array.astype(np.float16) for name, array in arrays.items()}
    np.savez_compressed(OUTPUT, **stored)
    print(f"{OUTPUT}: {OUTPUT.stat().st_size} bytes, from {len(rows)} examples")


if __name__ == "__main__":
    main()
