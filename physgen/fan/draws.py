"""Doubts and a seed -> draws. A draw depends on the seed, on what is drawn and on its own number, on nothing else.

So the k-th draw is the same in a fan of 8 and of 800, and things keep their draws when others are added or taken away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from hashlib import sha256
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.fan.doubt import Doubt, LightDoubt
from physgen.fan.spread import NORMAL
from physgen.scene.model import Scene

Array = NDArray[np.float64]

MOST = 2**-54
"""The least share that is drawn: 0 has no quantile."""


def numbers(doubts: Sequence[Doubt], seed: int, count: int) -> Array:
    """(count, P): what is drawn of each doubt.

    What is open about things of one label is open in the same way, as far as they are alike: nine dominoes are of one
    wood, whatever wood that is.
    """

    @cache
    def normal(*key: str) -> Array:
        return np.array([NORMAL.inv_cdf(max(share, MOST)) for share in shares(seed, count, *key).tolist()])

    def column(doubt: Doubt) -> list[float]:
        z = np.zeros(count)
        if doubt.alike > 0:
            z += sqrt(doubt.alike) * normal("label", doubt.label, doubt.parameter)
        if doubt.alike < 1:
            z += sqrt(1 - doubt.alike) * normal(doubt.section, doubt.thing, doubt.parameter)
        return [doubt.spread.at(value) for value in z.tolist()]

    return np.array([column(doubt) for doubt in doubts]).T.reshape(count, len(doubts))


def directions(doubt: LightDoubt, seed: int, count: int) -> Array:
    """(count, 3) unit vectors towards the light."""
    off, turns = shares(seed, count, "light", "off"), shares(seed, count, "light", "turn")
    return np.array([doubt.cone.at(*pair) for pair in zip(off.tolist(), turns.tolist(), strict=True)])


def shares(seed: int, count: int, *key: str) -> Array:
    """(count,) in 0..1, evenly: a stream of its own for every `key`, of which the first `count` are taken."""
    text = "\0".join((str(seed), *key))
    stream = np.random.Generator(
        np.random.Philox(key=int.from_bytes(sha256(text.encode()).digest()[:16], "big"))
    )
    return stream.random(count)


def drawn(scene: Scene, doubts: Sequence[Doubt], values: Array) -> Scene:
    """The scene with its doubtful numbers as one draw `(P,)` has them."""
    edits: dict[tuple[str, str], dict[str, float]] = {}
    for doubt, value in zip(doubts, values.tolist(), strict=True):
        edits.setdefault((doubt.section, doubt.thing), {})[doubt.parameter] = value

    def edited(section: str, item: Any) -> Any:
        changes: Mapping[str, float] = edits.get((section, item.name), {})
        return replace(item, **changes) if changes else item

    return replace(
        scene,
        objects=tuple(edited("objects", item) for item in scene.objects),
        boundaries=tuple(edited("boundaries", item) for item in scene.boundaries),
    )
