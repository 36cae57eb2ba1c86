"""One seeded source of chance for a picture, and the colours of homes (linear light, RGB)."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
"""Of float32, where nothing else is said."""
Choice = TypeVar("Choice")


class Hand:
    """Draws chances from one generator; the same seed draws the same picture."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def between(self, low: float, high: float) -> float:
        return float(low + (high - low) * self.rng.random())

    def whole(self, low: int, high: int) -> int:
        """Both ends included."""
        return int(self.rng.integers(low, high + 1))

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def one_of(
        self, choices: Sequence[Choice], weights: Sequence[float] | None = None
    ) -> Choice:
        if weights is None:
            return choices[self.whole(0, len(choices) - 1)]
        share = np.cumsum(weights) / np.sum(weights)
        return choices[
            min(
                int(np.searchsorted(share, self.rng.random(), side="right")),
                len(choices) - 1,
            )
        ]

    def direction(self) -> Array:
        """(3,) unit vector, all directions alike."""
        v = self.rng.standard_normal(3)
        return (v / np.linalg.norm(v)).astype(np.float32)

    # Colours -------------------------------------------------------------------------------------------

    def grey(self, low: float = 0.02, high: float = 0.85) -> Array:
        """Whites, greys and blacks, hardly tinted; low and high are reflectances."""
        value = low * (high / low) ** self.rng.random()
        return np.clip(
            value * (1 + 0.05 * self.rng.standard_normal(3)), 0.01, 0.95
        ).astype(np.float32)

    def white(self) -> Array:
        return np.clip(
            self.between(0.55, 0.9)
            * np.array([1, self.between(0.94, 1), self.between(0.8, 1)]),
            0,
            0.92,
        ).astype(np.float32)

    def wood(self) -> Array:
        return _hsv(
            self.between(0.05, 0.11), self.between(0.3, 0.75), self.between(0.25, 0.9)
        )

    def green(self) -> Array:
        return _hsv(
            self.between(0.2, 0.42), self.between(0.3, 0.85), self.between(0.2, 0.7)
        )

    def muted(self) -> Array:
        return _hsv(self.rng.random(), self.between(0.1, 0.45), self.between(0.2, 0.9))

    def bright(self) -> Array:
        hue = self.one_of(
            [0.0, 0.03, 0.08, 0.14, 0.3, 0.38, 0.5, 0.58, 0.64, 0.75, 0.9]
        ) + self.between(-0.03, 0.03)
        return _hsv(hue, self.between(0.6, 0.97), self.between(0.35, 0.98))

    def colour(self) -> Array:
        """(3,) reflectance of one of the things in a home: more whites, greys and browns than bright ones."""
        return self.one_of(
            [self.white, self.grey, self.wood, self.muted, self.bright],
            [0.16, 0.16, 0.14, 0.24, 0.3],
        )()


def _hsv(hue: float, saturation: float, value: float) -> Array:
    """SRGB hue, saturation, value -> (3,) linear reflectance."""
    srgb = np.array(colorsys.hsv_to_rgb(hue % 1, saturation, value))
    return np.clip(srgb**2.2, 0.008, 0.92).astype(np.float32)
