"""True numbers and told ones -> how far off masses are, and how often two objects are put in the right order.

Masses as in NeRF2Physics (Zhai et al., CVPR 2024): ADE, ALDE, APE and MnRE; and the paper's share within 30 %
(appendix, "GPT-4V physical property estimation evaluation").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import exp, log

import numpy as np

from physgen.simulate.uncertainty_summary import wilson

NEAR = 0.3
"""Error, as a part of the truth, up to which the paper counts a mass as right."""


@dataclass(frozen=True)
class Masses:
    """How far off masses are."""

    count: int
    ade: float
    """Mean absolute difference, g."""
    alde: float
    """Mean |ln(told / true)|."""
    ape: float
    """Mean |told - true| / true."""
    mnre: float
    """Mean of the smaller of told / true and true / told, 0..1: 1 is right."""
    bias: float
    """Geometric mean of told / true: 1 where neither too heavy nor too light."""
    near: int
    """How many are within 30 % of the truth."""

    @property
    def share(self) -> float:
        """Of those within 30 %."""
        return self.near / self.count

    @property
    def interval(self) -> tuple[float, float]:
        """95 % of the share, after Wilson (1927): other objects would have given another."""
        return wilson(self.near, self.count)

    def as_dict(self) -> dict[str, float | int | list[float]]:
        """As JSON."""
        return {
            "objects": self.count,
            "ade_g": self.ade,
            "within_30": self.near,
            "share": self.share,
            "interval": list(self.interval),
            "alde": self.alde,
            "ape": self.ape,
            "mnre": self.mnre,
            "bias": self.bias,
        }


def masses(pairs: Sequence[tuple[float, float]]) -> Masses | None:
    """Of (true, told), g, all above 0; None of none.

    >>> score = masses([(100, 200), (100, 80)])
    >>> score.ade, score.ape, score.mnre, score.near
    (60.0, 0.6, 0.65, 1)
    """
    if not pairs:
        return None
    true, told = np.array(pairs, np.float64).T
    off, logs = np.abs(told - true), np.log(told / true)
    return Masses(
        count=len(pairs),
        ade=float(off.mean()),
        alde=float(np.abs(logs).mean()),
        ape=float((off / true).mean()),
        mnre=float(np.exp(-np.abs(logs)).mean()),
        bias=exp(float(logs.mean())),
        near=int((off <= NEAR * true * (1 + 1e-12)).sum()),
    )


@dataclass(frozen=True)
class Order:
    """How two by two are told in the right order."""

    count: int
    """Pairs whose true values differ."""
    right: int
    tied: int
    """Told to be equal: not right."""
    wrong: tuple[tuple[str, str], ...]
    """(truly more, truly less) of the pairs that are told the other way round, or as equal."""

    def __add__(self, other: Order) -> Order:
        return Order(
            self.count + other.count,
            self.right + other.right,
            self.tied + other.tied,
            self.wrong + other.wrong,
        )


def order(true: Mapping[str, float], told: Mapping[str, float]) -> Order:
    """Of every pair of names whose true values differ.

    >>> order({"a": 3, "b": 2, "c": 1}, {"a": 0.9, "b": 0.1, "c": 0.5})
    Order(count=3, right=2, tied=0, wrong=(('b', 'c'),))
    """
    count = right = tied = 0
    wrong = []
    for one, other in combinations(true, 2):
        if true[one] == true[other]:
            continue
        more, less = (one, other) if true[one] > true[other] else (other, one)
        count += 1
        right += told[more] > told[less]
        tied += told[more] == told[less]
        if told[more] <= told[less]:
            wrong.append((more, less))
    return Order(count, right, tied, tuple(wrong))


NONE = Order(0, 0, 0, ())


def factor(true: float, told: float) -> float:
    """By how much a mass is off, 1 or more: 2 is half or twice.

    >>> round(factor(100, 50), 6)
    2.0
    """
    return exp(abs(log(told / true)))
