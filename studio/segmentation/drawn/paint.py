"""Paints: what colour the points of a part have. Each function takes chances or colours and returns a paint."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from .hand import Array, Hand
from .surface import Paint, Surface
from .textures import look_up, smaller, texture

Where = Callable[[Surface], Array]
"""(N,) 0..1: how much of a pattern lies on each point."""


def plain(colour: Array) -> Paint:
    return lambda s: np.broadcast_to(colour, (len(s.u), 3))


def textured(
    hand: Hand, colour: Array, name: str, strength: float = 0.4, repeat: float = 1.0
) -> Paint:
    """The colour varied by a texture laid over the solid in its own space; `repeat` textures a unit."""
    variant, dark = hand.whole(0, 9), colour * np.float32(1 - strength)
    light = np.minimum(colour * np.float32(1 + strength), 0.95)
    shift = hand.rng.random(2).astype(np.float32) * 512

    def paint(s: Surface) -> Array:
        texels = 512 * repeat * s.texel
        halvings = int(np.clip(np.floor(np.log2(max(texels, 1))), 0, 4))
        k = np.float32(512 * repeat / 2**halvings)
        p = s.own
        t = look_up(
            smaller(name, variant, halvings),
            (p[:, 0] + 0.7 * p[:, 2]) * k + shift[0],
            (p[:, 1] + 0.6 * p[:, 2]) * k + shift[1],
        )
        return dark + (light - dark) * t[:, None]

    return paint


def over(base: Paint, pattern: Where, top: Paint) -> Paint:
    """`top` painted on `base` where `pattern` says."""

    def paint(s: Surface) -> Array:
        share = pattern(s)[:, None]
        if not share.any():
            return base(s)
        return base(s) * (1 - share) + top(s) * share

    return paint


def band(low: float, high: float) -> Where:
    """Between two heights v."""
    return lambda s: ((s.v >= low) & (s.v <= high)).astype(np.float32)


def patch(u: float, v: float, half_u: float, half_v: float) -> Where:
    """A rectangle in u, v."""
    return lambda s: ((np.abs(s.u - u) <= half_u) & (np.abs(s.v - v) <= half_v)).astype(
        np.float32
    )


def disc(u: float, v: float, radius: float, stretch: float = 1.0) -> Where:
    """A round spot in u, v; `stretch` = height of the face over its width."""
    return lambda s: (np.hypot(s.u - u, (s.v - v) * stretch) <= radius).astype(
        np.float32
    )


def ring(u: float, v: float, radius: float, width: float) -> Where:
    return lambda s: (np.abs(np.hypot(s.u - u, s.v - v) - radius) <= width).astype(
        np.float32
    )


def anywhere(patterns: Sequence[Where]) -> Where:
    return lambda s: (
        np.max([p(s) for p in patterns], axis=0)
        if patterns
        else np.zeros(len(s.u), np.float32)
    )


def stripes(direction: Array, count: float, share: float, phase: float = 0.0) -> Where:
    """Planes across the solid's own space: `count` stripes a unit, `share` of them filled."""
    return lambda s: (
        ((s.own @ direction) * np.float32(count) + np.float32(phase)) % 1 < share
    ).astype(np.float32)


def caps(directions: Array, cosine: float, centre: Array) -> Where:
    """Round spots on a ball about `centre`, where one of (K, 3) `directions` is nearer than acos(cosine)."""

    def pattern(s: Surface) -> Array:
        p = s.own - centre
        p = p / np.maximum(np.linalg.norm(p, axis=1, keepdims=True), 1e-6)
        return ((p @ directions.T).max(axis=1) >= cosine).astype(np.float32)

    return pattern


def stamp(mask: Array, u: float, v: float, half_u: float, half_v: float) -> Where:
    """A drawn mask (h, w) 0..255 laid in the rectangle of u, v; its first row is at the top."""
    height, width = mask.shape

    def pattern(s: Surface) -> Array:
        x = ((s.u - u) / (2 * half_u) + 0.5) * width
        y = (0.5 - (s.v - v) / (2 * half_v)) * height
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        out = np.zeros(len(s.u), np.float32)
        out[inside] = (
            mask[y[inside].astype(int), x[inside].astype(int)].astype(np.float32) / 255
        )
        return out

    return pattern


def words(hand: Hand, lines: int = 1, letters: int = 6) -> Array:
    """(h, w) uint8 mask of printed lines."""
    mask = np.zeros((40 * lines, 26 * letters), np.uint8)
    for k in range(lines):
        count = hand.whole(max(1, letters // 2), letters)
        written = "".join(chr(hand.whole(65, 90)) for _ in range(count))
        cv2.putText(
            mask,
            written,
            (3, 40 * k + 32),
            hand.one_of([0, 2, 3, 4]),
            1.0,
            255,
            hand.whole(2, 5),
            cv2.LINE_AA,
        )
    return mask


def numeral(text: str) -> Array:
    """(64, 64) uint8 mask of a short text in the middle."""
    mask = np.zeros((64, 64), np.uint8)
    size = 1.6 if len(text) == 1 else 1.1
    (w, h), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, size, 4)
    cv2.putText(
        mask,
        text,
        (32 - w // 2, 32 + h // 2),
        cv2.FONT_HERSHEY_DUPLEX,
        size,
        255,
        4,
        cv2.LINE_AA,
    )
    return mask


def printed(hand: Hand, base: Paint) -> Paint:
    """A face or wall of u, v with something printed on it: words, blocks, discs, a picture."""
    for _ in range(hand.whole(1, 3)):
        ink = plain(hand.colour())
        u, v = hand.between(-0.4, 0.4), hand.between(-0.5, 0.6)
        what = hand.one_of(["words", "words", "block", "disc", "band", "text"])
        if what == "words":
            lines = hand.whole(1, 3)
            base = over(
                base,
                stamp(
                    words(hand, lines, hand.whole(3, 9)),
                    u * 0.3,
                    v,
                    hand.between(0.3, 0.8),
                    0.16 * lines,
                ),
                ink,
            )
        elif what == "block":
            base = over(
                base, patch(u, v, hand.between(0.1, 0.8), hand.between(0.05, 0.5)), ink
            )
        elif what == "disc":
            base = over(base, disc(u, v, hand.between(0.1, 0.6)), ink)
        elif what == "band":
            base = over(base, band(v - hand.between(0.03, 0.3), v + 0.1), ink)
        else:
            base = over(
                base,
                stamp(
                    255 - texture("text", hand.whole(0, 9))[:200, :200], 0, v, 0.8, 0.3
                ),
                ink,
            )
    return base


def finishable(hand: Hand, colour: Array) -> Paint:
    """The colour as household things have it: even, or faintly textured."""
    if hand.chance(0.55):
        return plain(colour)
    name = hand.one_of(
        ["plain", "grain", "wood", "weave", "stone", "blotches", "carpet"],
        [3, 3, 2, 2, 1, 1, 1],
    )
    return textured(hand, colour, name, hand.between(0.08, 0.45), hand.between(0.4, 2))
