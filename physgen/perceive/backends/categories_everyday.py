"""Backend categories=everyday: the same nouns for every photo, for segmenters that need
nouns.
"""

from __future__ import annotations

from collections.abc import Sequence

from physgen.perceive.roles import Categories, Category, Rgb

MOVABLE = (
    "ball", "block", "box", "book", "bottle", "cup", "mug", "bowl", "plate", "can", "jar", "vase", "glass", "toy",
    "car", "doll", "domino", "coin", "pen", "pencil", "phone", "fork", "spoon", "knife", "apple", "orange", "banana",
    "lemon",
    "egg", "pot", "pan", "basket", "candle", "clock", "lamp", "shoe", "bag", "tin", "tube", "wheel", "ring", "stone",
)  # fmt: skip
"""Common movable objects; they fit into one text of Grounding DINO (256 tokens)."""
STATIC = ("table", "shelf", "floor", "wall", "ramp", "desk")
"""Common surfaces."""


def everyday() -> Categories:
    """Return the backend `everyday`."""
    return _everyday


def _everyday(rgb: Rgb) -> Sequence[Category]:
    return [Category(noun, True) for noun in MOVABLE] + [
        Category(noun, False) for noun in STATIC
    ]
