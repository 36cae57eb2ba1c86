"""A photo -> the same everyday nouns every time, for segmenters that find what they are told to and nobody asked."""

from __future__ import annotations

from collections.abc import Sequence

from physgen.perceive.roles import Categories, Category, Rgb

THINGS = (
    "ball", "block", "box", "book", "bottle", "cup", "mug", "bowl", "plate", "can", "jar", "vase", "glass", "toy",
    "car", "doll", "domino", "coin", "pen", "pencil", "phone", "fork", "spoon", "knife", "apple", "orange", "banana",
    "lemon",
    "egg", "pot", "pan", "basket", "candle", "clock", "lamp", "shoe", "bag", "tin", "tube", "wheel", "ring", "stone",
)  # fmt: skip
"""What people photograph to see it move; as many as a text of Grounding DINO holds (256 tokens) with room to spare."""
STUFF = ("table", "shelf", "floor", "wall", "ramp", "desk")
"""What holds them."""


def everyday() -> Categories:
    """The backend `everyday`."""
    return _everyday


def _everyday(rgb: Rgb) -> Sequence[Category]:
    return [Category(noun, True) for noun in THINGS] + [Category(noun, False) for noun in STUFF]
