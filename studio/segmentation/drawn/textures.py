"""A bank of grey textures of a home's surfaces: wood, cloth, tiles, paper, carpet, stone, grass, print. Made when first asked."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from .hand import Array, Hand

SIDE = 512
"""Texels a side."""
VARIANTS = 10
"""Textures of each name; each has a seed of its own, so that none depends on what was drawn before."""


def _noise(hand: Hand, cell: float, stretch: float = 1.0) -> Array:
    """(SIDE, SIDE) smooth noise of deviation about 1 whose grain is `cell` texels wide and `stretch` times as tall."""
    shape = (max(3, int(SIDE / cell / stretch) + 2), max(3, int(SIDE / cell) + 2))
    return cv2.resize(
        hand.rng.standard_normal(shape, np.float32),
        (SIDE, SIDE),
        interpolation=cv2.INTER_CUBIC,
    )


def _grid() -> tuple[Array, Array]:
    y, x = np.mgrid[:SIDE, :SIDE].astype(np.float32)
    return y, x


def grain(hand: Hand) -> Array:
    return sum(
        (_noise(hand, c) * c**0.4 for c in (2, 6, 20, 70)),
        np.zeros((SIDE, SIDE), np.float32),
    )


def wood(hand: Hand) -> Array:
    y, _ = _grid()
    bend = _noise(hand, 150, 0.3) * hand.between(10, 40) + _noise(hand, 40, 0.3) * 3
    rings = np.sin((y + bend) * hand.between(0.08, 0.3)) + 0.6 * np.sin(
        (y + 1.3 * bend) * hand.between(0.3, 0.8)
    )
    fibre = cv2.blur(_noise(hand, 1.5), (61, 1)) * 6
    return rings * hand.between(0.2, 1) + fibre


def planks(hand: Hand) -> Array:
    y, x = _grid()
    height = hand.between(35, 120)
    row = (y / height).astype(int)
    length = hand.between(150, 500)
    column = ((x + row * 171.7 % length) / length).astype(int)
    tone = hand.rng.standard_normal((20, 20))[row % 20, column % 20].astype(np.float32)
    seam = (y % height < 2.2) | ((x + row * 171.7 % length) % length < 2.2)
    return 0.6 * wood(hand) + tone - 4.0 * seam


def weave(hand: Hand) -> Array:
    y, x = _grid()
    k = hand.between(0.6, 1.6)
    return (
        np.sin(k * x) * np.sin(k * y)
        + 0.5 * _noise(hand, 2)
        + 0.5 * cv2.blur(_noise(hand, 2), (31, 1)) * 3
    )


def stripes(hand: Hand) -> Array:
    _, x = _grid()
    period = hand.between(12, 70)
    thin = np.sin(x * 6.283 / period * hand.one_of([2, 3, 5])) > hand.between(0.2, 0.9)
    return (
        np.where(
            np.sin(x * 6.283 / period) > hand.between(-0.6, 0.8), 1.0, -1.0
        ).astype(np.float32)
        + hand.between(0, 0.6) * thin
    )


def tartan(hand: Hand) -> Array:
    across = stripes(hand)
    return across + across.T + 0.3 * weave(hand)


def checks(hand: Hand) -> Array:
    y, x = _grid()
    cell = hand.between(20, 80)
    return (((x // cell) + (y // cell)) % 2) * 2.0 - 1 + 0.15 * _noise(hand, 4)


def dots(hand: Hand) -> Array:
    y, x = _grid()
    cell = hand.between(18, 70)
    shift = (y // cell % 2) * cell / 2 * hand.whole(0, 1)
    away = np.hypot((x + shift) % cell - cell / 2, y % cell - cell / 2)
    return np.clip(cell * hand.between(0.15, 0.38) - away, -1, 1)


def tiles(hand: Hand) -> Array:
    y, x = _grid()
    wide = hand.between(40, 130)
    tall = wide * hand.one_of([1, 1, 0.5, 0.33])
    row = (y / tall).astype(int)
    shifted = x + (row % 2) * wide / 2 * (tall < wide)
    seam = (shifted % wide < hand.between(2, 5)) | (y % tall < 3)
    tone = hand.rng.standard_normal((32, 32)).astype(np.float32)[
        row % 32, (shifted / wide).astype(int) % 32
    ]
    return (
        hand.one_of([-4.0, 3.0]) * seam
        + hand.between(0, 0.6) * tone
        + hand.between(0, 0.5) * _noise(hand, 30)
    )


def carpet(hand: Hand) -> Array:
    return (
        _noise(hand, 1.5)
        + 0.7 * _noise(hand, 3)
        + 0.5 * _noise(hand, 60)
        + hand.between(0, 1) * dots(hand)
    )


def stone(hand: Hand) -> Array:
    speck = np.where(
        _noise(hand, hand.between(2, 6)) > hand.between(0.8, 1.6),
        hand.one_of([-2.5, 2.0]),
        0,
    )
    return grain(hand) * 0.4 + speck + 0.4 * _noise(hand, 2)


def marble(hand: Hand) -> Array:
    y, x = _grid()
    bend = _noise(hand, 120) * 60 + _noise(hand, 30) * 15
    return -(
        np.abs(np.sin((x * hand.between(0.3, 1) + y + bend) * 0.02)) ** 0.25
    ) * 3 + 0.3 * _noise(hand, 60)


def grass(hand: Hand) -> Array:
    blades = np.zeros((SIDE, SIDE), np.float32)
    for x, y in hand.rng.integers(0, SIDE, (5000, 2)):
        tip = (int(x + hand.rng.normal(0, 6)), int(y - hand.between(5, 22)))
        cv2.line(blades, (int(x), int(y)), tip, hand.between(-1, 1), 1, cv2.LINE_AA)
    return blades


def floral(hand: Hand) -> Array:
    values = np.zeros((SIDE, SIDE), np.float32)
    cell = hand.whole(40, 110)
    petals, size = hand.whole(3, 7), hand.between(0.12, 0.3) * cell
    for row, y in enumerate(range(0, SIDE + cell, cell)):
        for x in range((row % 2) * cell // 2, SIDE + cell, cell):
            for k in range(petals):
                turn = 6.283 * k / petals
                at = (int(x + size * np.cos(turn)), int(y + size * np.sin(turn)))
                cv2.ellipse(
                    values,
                    at,
                    (int(size * 0.8), int(size * 0.4)),
                    np.degrees(turn),
                    0,
                    360,
                    1.0,
                    -1,
                    cv2.LINE_AA,
                )
            cv2.circle(values, (x, y), int(size * 0.4) + 1, -0.6, -1, cv2.LINE_AA)
    return values


def blotches(hand: Hand) -> Array:
    return np.tanh(
        (_noise(hand, hand.between(15, 60)) - hand.between(0.2, 1)) * 6
    ) + 0.1 * _noise(hand, 3)


def text(hand: Hand) -> Array:
    """Lines of print: dark letters on a light page, sometimes with a heading or a block."""
    page = np.full((SIDE, SIDE), 255, np.uint8)
    size = hand.between(0.35, 1.1)
    step = int(30 * size + 8)
    for y in range(step, SIDE, step):
        if hand.chance(0.12):
            continue
        words = " ".join(
            "".join(chr(hand.whole(97, 122)) for _ in range(hand.whole(2, 9)))
            for _ in range(12)
        )
        cv2.putText(
            page,
            words,
            (hand.whole(8, 14), y),
            hand.one_of([0, 3, 4]),
            size,
            0,
            hand.whole(1, 2),
            cv2.LINE_AA,
        )
    return page.astype(np.float32)


def plain(hand: Hand) -> Array:
    return _noise(hand, 2) * 0.3 + _noise(hand, 200)


MAKERS: dict[str, Callable[[Hand], Array]] = {
    f.__name__: f
    for f in (
        grain,
        wood,
        planks,
        weave,
        stripes,
        tartan,
        checks,
        dots,
        tiles,
        carpet,
        stone,
        marble,
        grass,
        floral,
        blotches,
        text,
        plain,
    )
}


@cache
def texture(name: str, variant: int) -> NDArray[np.uint8]:
    """(SIDE, SIDE) uint8, spread over 0..255 by its own deviation, mean at 128."""
    hand = Hand(1000 * sorted(MAKERS).index(name) + variant % VARIANTS)
    values = MAKERS[name](hand)
    values = (values - values.mean()) / (values.std() + 1e-6)
    return np.clip(values * 50 + 128, 0, 255).astype(np.uint8)


@cache
def smaller(name: str, variant: int, halvings: int) -> NDArray[np.uint8]:
    """The texture halved in size `halvings` times, so that far surfaces do not shimmer."""
    values = texture(name, variant)
    for _ in range(halvings):
        values = cv2.resize(values, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return values


def look_up(values: NDArray[np.uint8], u: Array, v: Array) -> Array:
    """0..1 at texel coordinates (u, v) of any shape; the texture is mirrored beyond its edges."""
    height, width = values.shape
    x = np.abs(u.astype(np.int32) % (2 * width - 2) - (width - 1))
    y = np.abs(v.astype(np.int32) % (2 * height - 2) - (height - 1))
    return values[y, x].astype(np.float32) * np.float32(1 / 255)
