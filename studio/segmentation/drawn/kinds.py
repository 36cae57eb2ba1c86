"""All kinds of movable things, by name, and how likely each is."""

from __future__ import annotations

from . import belongings, crockery, games, garden, kitchen, oddments, paper, tools, toys
from .build import Kind

CUPBOARDS = (crockery, kitchen, games, toys, oddments, paper, tools, belongings, garden)
KINDS: dict[str, Kind] = {
    kind.name: kind for cupboard in CUPBOARDS for kind in cupboard.KINDS
}

COMMON = {
    "mug": 3,
    "book": 3,
    "toy_ball": 3,
    "carton": 2,
    "block": 2,
    "bottle": 2,
    "spoon": 1.5,
    "fork": 1.5,
    "knife": 1.5,
    "potted_plant": 1.5,
    "vehicle": 1.5,
    "animal": 1.5,
    "billiard_ball": 1.5,
}
"""Weight of a kind among things that lie about; others 1."""

NAMES = list(KINDS)
WEIGHTS = [COMMON.get(name, 1.0) for name in NAMES]

STACKED = [
    "book",
    "book",
    "carton",
    "block",
    "die",
    "coin",
    "plate",
    "bowl",
    "can",
    "notebook",
    "puzzle_cube",
    "gift",
    "tape",
    "domino",
    "mug",
]
RACKED = [
    "billiard_ball",
    "billiard_ball",
    "toy_ball",
    "marble",
    "coin",
    "block",
    "die",
    "domino",
    "mug",
    "can",
    "bottle",
    "citrus",
    "apple",
    "egg",
    "tumbler",
    "chess_piece",
    "button",
    "star",
    "candle",
    "book",
]
HOLDERS = [
    "mug",
    "mug",
    "mug",
    "vase",
    "vase",
    "tumbler",
    "basket",
    "bowl",
    "bowl",
    "cup_and_saucer",
]
TALL = [
    "pencil",
    "pen",
    "spoon",
    "fork",
    "knife",
    "brush",
    "flower",
    "screwdriver",
    "scissors",
    "wrench",
]
LOOSE = [
    "apple",
    "citrus",
    "egg",
    "tomato",
    "toy_ball",
    "marble",
    "grapes",
    "banana",
    "block",
    "key",
    "stone",
]
"""What lies in bowls and baskets."""
FLAT = [
    "spoon",
    "fork",
    "knife",
    "pencil",
    "pen",
    "scissors",
    "key",
    "coin",
    "phone",
    "notebook",
    "plate",
    "screwdriver",
    "wrench",
    "pliers",
    "hammer",
    "brush",
    "button",
    "leaf",
    "star",
    "remote",
    "spectacles",
    "book",
]
SEEN_BEFORE_A_WALL = [
    n
    for n in NAMES
    if "stand" in KINDS[n].poses or "lean" in KINDS[n].poses or "side" in KINDS[n].poses
]
