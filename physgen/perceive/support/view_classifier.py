"""The view of a photo by its looks: linear models on features of the segmentation network.

The weights come from `studio/view_weights.py`, which learns them from photos labelled by hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import exp
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32

WEIGHTS = "view.npz"
CLIP = 4.0
"""Standard deviations at which a feature counts in full: photos unlike all others stay in range."""
TILTS = {"side": 10.0, "oblique": 45.0, "top": 75.0}
"""Degrees by which the camera looks down in the middle of each range of labels."""
OBLIQUE_TILTS = (30.0, 60.0)
"""Degrees: the range that is labelled as oblique; 60 is also the most that `world.tilt` takes."""
TILT_STEP = 5.0
"""Degrees to which a tilt is rounded: looks do not tell it better."""


@dataclass(frozen=True)
class ViewChances:
    """Chances of the ranges of views, which sum to 1, and of a photo that cannot be animated."""

    side: float
    """The camera looks down by less than 30 degrees."""
    oblique: float
    """By 30 to 60 degrees."""
    top: float
    """By more."""
    unsuitable: float
    """People, animals, landscapes, rooms: nothing loose at rest."""

    @property
    def is_level(self) -> bool:
        """Return whether the photo is rather one from the side than any other."""
        return self.side >= max(self.oblique, self.top)

    @property
    def tilt(self) -> float | None:
        """Degrees by which the camera looks down on the ground of an oblique photo.

        None if the photo is rather one from the side.
        """
        if self.oblique <= self.side:
            return None
        chances = (self.side, self.oblique, self.top)
        expected = np.dot(chances, list(TILTS.values()))
        rounded = TILT_STEP * round(float(expected) / TILT_STEP)
        return float(np.clip(rounded, *OBLIQUE_TILTS))


def view_chances(features: F32) -> ViewChances:
    """Return the chances of a photo by its features (D,), as `run_network` gives them."""
    model = _model()
    scaled = np.clip((features - model.mean) / model.spread, -CLIP, CLIP)
    logits = scaled @ model.weights.T + model.bias
    top, not_side, unsuitable = (_chance(logit) for logit in logits.tolist())
    not_side = max(not_side, top)
    return ViewChances(1 - not_side, not_side - top, top, unsuitable)


def _chance(logit: float) -> float:
    return 1 / (1 + exp(-min(max(logit, -30.0), 30.0)))


@dataclass(frozen=True, eq=False)
class _Model:
    mean: NDArray[np.float32]  # (D,)
    spread: NDArray[np.float32]  # (D,)
    weights: NDArray[
        np.float32
    ]  # (3, D): logits of top, of oblique or top, of unsuitable
    bias: NDArray[np.float32]  # (3,)


@cache
def _model() -> _Model:
    with np.load(Path(__file__).with_name(WEIGHTS)) as stored:
        names = ("mean", "spread", "weights", "bias")
        return _Model(*(stored[name].astype(np.float32) for name in names))
