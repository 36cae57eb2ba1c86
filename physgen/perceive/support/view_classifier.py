"""The view of a photo by its looks: linear models on the segmentation network's
features.

`studio/view_weights.py` learns the weights from photos labelled by hand.
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
"""Standard deviations at which a feature is clipped, so that unusual photos stay in
range.
"""
TILTS = {"side": 10.0, "oblique": 45.0, "top": 75.0}
"""Tilt of the camera in the middle of each range of labels, degrees."""
OBLIQUE_TILTS = (30.0, 60.0)
"""Degrees: the range with the label oblique; 60 is also the largest `world.tilt`."""
TILT_STEP = 5.0
"""Degrees to which a tilt is rounded, the accuracy of this estimate."""


@dataclass(frozen=True)
class ViewChances:
    """Probabilities of the ranges of views, with sum 1, and of an unsuitable photo."""

    side: float
    """The camera is tilted by less than 30 degrees."""
    oblique: float
    """The camera is tilted by 30 to 60 degrees."""
    top: float
    """The camera is tilted by more than 60 degrees."""
    unsuitable: float
    """The photo shows people, animals, landscapes or rooms: no loose object at rest."""

    @property
    def is_level(self) -> bool:
        """Return whether the photo is rather one from the side than any other."""
        return self.side >= max(self.oblique, self.top)

    @property
    def tilt(self) -> float | None:
        """Return the tilt of the camera to the ground of an oblique photo, degrees.

        Returns None if the photo is rather one from the side.
        """
        if self.oblique <= self.side:
            return None
        chances = (self.side, self.oblique, self.top)
        mean_tilt = np.dot(chances, list(TILTS.values()))
        tilt = TILT_STEP * round(float(mean_tilt) / TILT_STEP)
        return float(np.clip(tilt, *OBLIQUE_TILTS))


def view_chances(features: F32) -> ViewChances:
    """Return the chances of a photo by its features (D,) from `run_network`."""
    model = _model()
    scores = np.clip((features - model.mean) / model.spread, -CLIP, CLIP)
    logits = scores @ model.weights.T + model.bias
    top, not_side, unsuitable = (_chance(logit) for logit in logits.tolist())
    # Top views are part of the views that are not from the side.
    not_side = max(not_side, top)
    return ViewChances(1 - not_side, not_side - top, top, unsuitable)


def _chance(logit: float) -> float:
    return 1 / (1 + exp(-min(max(logit, -30.0), 30.0)))


@dataclass(frozen=True, eq=False)
class _Model:
    mean: NDArray[np.float32]  # (D,)
    spread: NDArray[np.float32]  # (D,)
    # (3, D): logits of top, of oblique or top, of unsuitable
    weights: NDArray[np.float32]
    bias: NDArray[np.float32]  # (3,)


@cache
def _model() -> _Model:
    with np.load(Path(__file__).with_name(WEIGHTS)) as arrays:
        names = ("mean", "spread", "weights", "bias")
        return _Model(*(arrays[name].astype(np.float32) for name in names))
