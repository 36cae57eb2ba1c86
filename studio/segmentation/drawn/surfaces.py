"""Flat surfaces as pictures: floors, cloths, walls and what is printed on them or hangs there; sRGB uint8, none of it movable."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from .hand import Array, Hand
from .textures import SIDE, smaller

Rgb8 = NDArray[np.uint8]

TABLES = [
    "wood",
    "planks",
    "plain",
    "grain",
    "weave",
    "marble",
    "stone",
    "tiles",
    "tartan",
    "checks",
    "carpet",
    "grass",
    "stripes",
    "floral",
    "dots",
]
TABLE_ODDS = [5, 3, 4, 3, 3, 1, 1.5, 1.5, 1, 0.7, 1.5, 0.8, 0.7, 0.7, 0.4]
WALLS = [
    "plain",
    "plain",
    "grain",
    "floral",
    "stripes",
    "tiles",
    "planks",
    "dots",
    "stone",
    "weave",
]


def srgb8(linear: Array) -> tuple[int, int, int]:
    """A linear reflectance as an 8-bit colour for OpenCV's drawing."""
    r, g, b = (
        np.clip(np.power(np.maximum(linear, 0), 1 / 2.2) * 255, 0, 255)
        .astype(int)
        .tolist()
    )
    return r, g, b


LINEAR = (np.arange(256) / 255.0).astype(np.float32) ** np.float32(2.2)
"""Linear value of each 8-bit one."""


def surface(hand: Hand, names: list[str], odds: list[float] | None, side: int) -> Rgb8:
    """(side, side, 3) a textured surface between two or three colours."""
    name = hand.one_of(names, odds)
    base = (
        hand.green() * 0.6
        if name == "grass"
        else hand.wood()
        if name in ("wood", "planks") and hand.chance(0.75)
        else hand.one_of([hand.colour, hand.white, hand.grey, hand.muted])()
    )
    strength = (
        hand.between(0.05, 0.5)
        if name in ("plain", "grain", "wood", "marble")
        else hand.between(0.15, 0.9)
    )
    other = (
        hand.colour()
        if hand.chance(0.3 if name not in ("wood", "planks", "grass") else 0)
        else base * hand.between(0.25, 2.0)
    )
    other = np.clip(base + (other - base) * strength, 0.01, 0.9)
    t = np.linspace(0, 1, 256)[:, None]
    ramp = np.clip((base * (1 - t) + other * t) ** (1 / 2.2) * 255, 0, 255).astype(
        np.uint8
    )
    zoom = hand.between(0.5, 2.2)  # texels per pixel
    halvings = 1 if zoom > 1.3 else 0
    values = smaller(name, hand.whole(0, 9), halvings)
    values = values.T if hand.chance(0.4) else values
    wanted = min(values.shape[0], max(16, int(side * zoom / 2**halvings)))
    y, x = (
        hand.whole(0, values.shape[0] - wanted),
        hand.whole(0, values.shape[0] - wanted),
    )
    part = np.ascontiguousarray(values[y : y + wanted, x : x + wanted])
    return ramp[
        cv2.resize(
            part,
            (side, side),
            interpolation=cv2.INTER_AREA if wanted > side else cv2.INTER_LINEAR,
        )
    ]


def print_on(hand: Hand, image: Rgb8) -> str:
    """Print or lay something flat on (n, n, 3) `image` in place; says what."""
    n = image.shape[0]
    what = hand.one_of(
        [
            "disc",
            "rings",
            "letters",
            "logo",
            "page",
            "cloth",
            "lines",
            "checker",
            "stain",
            "shapes",
        ],
        [2, 1, 2, 1, 1.5, 2, 1, 0.7, 1, 1],
    )
    ink, other = srgb8(hand.colour()), srgb8(hand.colour())
    x, y, size = hand.whole(0, n), hand.whole(0, n), hand.between(0.05, 0.35) * n
    if what == "disc":
        for _ in range(hand.whole(1, 9)):
            cv2.circle(
                image,
                (hand.whole(0, n), hand.whole(0, n)),
                int(size * hand.between(0.25, 1)),
                ink if hand.chance(0.7) else other,
                -1,
                cv2.LINE_AA,
            )
    elif what == "rings":
        for k in range(hand.whole(1, 4)):
            cv2.circle(
                image,
                (x, y),
                int(size * (1 - k / 5)),
                ink,
                hand.whole(1, 6),
                cv2.LINE_AA,
            )
    elif what == "letters":
        text = "".join(chr(hand.whole(48, 90)) for _ in range(hand.whole(1, 7)))
        cv2.putText(
            image,
            text,
            (x - n // 4, y),
            hand.one_of([0, 2, 3, 4]),
            size / 22,
            ink,
            max(1, int(size / 9)),
            cv2.LINE_AA,
        )
    elif what == "logo":
        cv2.circle(image, (x, y), int(size * 0.6), ink, -1, cv2.LINE_AA)
        cv2.putText(
            image,
            chr(hand.whole(65, 90)),
            (int(x - size / 4), int(y + size / 4)),
            0,
            size / 35,
            other,
            max(1, int(size / 10)),
            cv2.LINE_AA,
        )
    elif what in ("page", "cloth"):
        _laid(hand, image, what, (x, y), size)
    elif what == "lines":
        for _ in range(hand.whole(1, 5)):
            ends = [(hand.whole(-n, 2 * n), hand.whole(-n, 2 * n)) for _ in range(2)]
            cv2.line(image, ends[0], ends[1], ink, hand.whole(1, 5), cv2.LINE_AA)
    elif what == "checker":
        cell, count = max(4, int(size / 4)), hand.whole(3, 8)
        for i in range(count):
            for j in range(count):
                cv2.rectangle(
                    image,
                    (x + i * cell, y + j * cell),
                    (x + i * cell + cell - 1, y + j * cell + cell - 1),
                    ink if (i + j) % 2 else other,
                    -1,
                )
    elif what == "stain":
        spot = np.zeros(image.shape[:2], np.float32)
        cv2.ellipse(
            spot,
            (x, y),
            (int(size), int(size * hand.between(0.3, 1))),
            hand.between(0, 180),
            0,
            360,
            1.0,
            -1,
        )
        spot = cv2.GaussianBlur(spot, (0, 0), hand.between(1, 0.2 * size + 2))[
            ..., None
        ] * hand.between(0.1, 0.5)
        image[:] = (image * (1 - spot) + spot * np.array(other)).astype(np.uint8)
    else:
        for _ in range(hand.whole(1, 6)):
            corners = np.array(
                [[hand.whole(0, n), hand.whole(0, n)]]
            ) + hand.rng.integers(-int(size), int(size) + 1, (hand.whole(3, 5), 2))
            cv2.fillPoly(
                image,
                [cv2.convexHull(corners.astype(np.int32))],
                ink if hand.chance(0.5) else other,
                cv2.LINE_AA,
            )
    return what


def _laid(hand: Hand, image: Rgb8, what: str, at: tuple[int, int], size: float) -> None:
    """A page of print, a cloth or rug spread flat: part of the table, not a thing."""
    n = image.shape[0]
    wide = size * (2 if what == "cloth" else 1) + 20
    tall = wide * hand.between(0.6, 1.5)
    corners = cv2.boxPoints((at, (wide, tall), hand.between(0, 180)))
    if what == "page":
        side = 160
        y, x = hand.whole(0, SIDE - side), hand.whole(0, SIDE - side)
        grey = smaller("text", hand.whole(0, 9), 0)[y : y + side, x : x + side]
        sheet = np.repeat(grey[..., None], 3, axis=2)
    else:
        side = n
        sheet = surface(
            hand,
            ["weave", "tartan", "stripes", "dots", "floral", "carpet", "checks"],
            None,
            n,
        )
        if hand.chance(0.4):
            cv2.rectangle(
                sheet, (6, 6), (n - 7, n - 7), srgb8(hand.colour()), hand.whole(2, 10)
            )
    turn = cv2.getPerspectiveTransform(
        np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32),
        corners.astype(np.float32),
    )
    cv2.warpPerspective(
        sheet,
        turn,
        (n, n),
        dst=image,
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_TRANSPARENT,
    )


def hang(hand: Hand, image: Rgb8, floor: int) -> str:
    """Draw something fixed to a wall, above row `floor` of (n, n, 3) `image`, in place; says what."""
    n = image.shape[0]
    what = hand.one_of(
        [
            "frame",
            "window",
            "mirror",
            "socket",
            "panels",
            "poster",
            "door",
            "curtain",
            "shelf edge",
            "switch",
            "radiator",
        ],
        [3, 1.5, 1.2, 1.2, 2, 1.5, 1.2, 1, 1, 0.6, 0.6],
    )
    ink, other = (
        srgb8(hand.colour()),
        srgb8(hand.one_of([hand.white, hand.wood, hand.grey])()),
    )
    x, w = hand.whole(-20, n - 20), int(n * hand.between(0.12, 0.5))
    h = int(w * hand.between(0.6, 1.6))
    y = hand.whole(-h // 2, max(0, floor - h // 2))
    if what in ("frame", "mirror", "window", "poster"):
        edge = 0 if what == "poster" else hand.whole(2, 8)
        inner = _view(hand, what, max(4, w - 2 * edge), max(4, h - 2 * edge))
        if what == "frame" and hand.chance(0.3):
            cv2.ellipse(
                image,
                (x + w // 2, y + h // 2),
                (w // 2, h // 2),
                0,
                0,
                360,
                other,
                -1,
                cv2.LINE_AA,
            )
            cv2.ellipse(
                image,
                (x + w // 2, y + h // 2),
                (max(1, w // 2 - edge), max(1, h // 2 - edge)),
                0,
                0,
                360,
                ink,
                -1,
                cv2.LINE_AA,
            )
            return what
        cv2.rectangle(image, (x, y), (x + w, y + h), other, -1)
        cv2.rectangle(
            image, (x, y), (x + w, y + h), tuple(int(c * 0.6) for c in other), 1
        )
        _paste(image, inner, x + edge, y + edge)
        if what == "window":
            cv2.line(image, (x + w // 2, y), (x + w // 2, y + h), other, edge)
            cv2.line(image, (x, y + h // 3), (x + w, y + h // 3), other, edge)
    elif what in ("panels", "door", "radiator"):
        _front(hand, image, what, floor, other)
    elif what in ("socket", "switch"):
        s, y = hand.whole(8, 22), hand.whole(0, max(1, floor - 24))
        cv2.rectangle(
            image, (x, y), (x + s, y + s), srgb8(hand.white()), -1, cv2.LINE_AA
        )
        cv2.rectangle(image, (x, y), (x + s, y + s), (120, 120, 120), 1, cv2.LINE_AA)
        if what == "socket":
            cv2.circle(
                image, (x + s // 2, y + s // 2), s // 3, (150, 150, 150), 1, cv2.LINE_AA
            )
            for k in (-1, 1):
                cv2.circle(
                    image,
                    (x + s // 2 + k * s // 7, y + s // 2),
                    1,
                    (20, 20, 20),
                    -1,
                    cv2.LINE_AA,
                )
        else:
            cv2.line(
                image, (x + 2, y + s // 2), (x + s - 2, y + s // 2), (150, 150, 150), 1
            )
    elif what == "curtain":
        folds = (
            np.sin(
                np.arange(w) * hand.between(0.15, 0.6) + 2 * np.sin(np.arange(w) * 0.07)
            )
            * 0.25
            + 0.75
        )
        cloth = (np.array(ink)[None, None] * folds[None, :, None]).astype(np.uint8)
        _paste(image, np.repeat(cloth, floor + 1, axis=0), x, 0)
    else:
        y = hand.whole(0, max(1, floor - 10))
        cv2.rectangle(image, (0, y), (n, y + hand.whole(2, 9)), other, -1)
        cv2.line(
            image,
            (0, y + 10),
            (n, y + 10),
            tuple(int(c * 0.5) for c in other),
            1,
            cv2.LINE_AA,
        )
    return what


def _view(hand: Hand, what: str, w: int, h: int) -> Rgb8:
    """What a frame shows: painted shapes, a landscape, a mirrored room, the sky."""
    n = 96
    image = surface(hand, ["plain", "grain", "blotches", "marble"], None, n)
    if what == "window":
        image = np.clip(image.astype(np.int32) // 3 + 150, 0, 255).astype(np.uint8)
    horizon = hand.whole(30, 80)
    cv2.rectangle(image, (0, horizon), (n, n), srgb8(hand.colour()), -1)
    for _ in range(hand.whole(0, 6)):
        at, r = (hand.whole(0, n), hand.whole(0, n)), hand.whole(3, 25)
        if hand.chance(0.5):
            cv2.circle(image, at, r, srgb8(hand.colour()), -1, cv2.LINE_AA)
        else:
            cv2.rectangle(
                image, at, (at[0] + r, at[1] + 2 * r), srgb8(hand.colour()), -1
            )
    if what in ("window", "mirror"):
        image = cv2.GaussianBlur(image, (0, 0), hand.between(2, 7))
    return cv2.resize(image, (w, h), interpolation=cv2.INTER_AREA)


def _front(
    hand: Hand, image: Rgb8, what: str, floor: int, colour: tuple[int, int, int]
) -> None:
    """A front of furniture: rows of panels with frames, seams, knobs or bars; or a door; or a radiator."""
    n, columns = image.shape[0], hand.whole(1, 4)
    rows = 1 if what == "door" else hand.whole(1, 4)
    x0, x1 = hand.whole(-60, n // 3), hand.whole(n // 2, n + 60)
    y0, y1 = (hand.whole(-40, floor // 2) if floor > 20 else 0), floor
    if what == "radiator":
        columns, rows = hand.whole(8, 18), 1
    cv2.rectangle(image, (x0, y0), (x1, y1), colour, -1)
    dark, light = (
        tuple(int(c * 0.55) for c in colour),
        tuple(min(255, int(c * 1.2 + 10)) for c in colour),
    )
    knob, shape, inset = (
        srgb8(hand.grey()),
        hand.one_of(["knob", "bar", "none"]),
        hand.whole(3, 10),
    )
    for i in range(columns):
        for j in range(rows):
            a, b = (
                (x0 + (x1 - x0) * i // columns, y0 + (y1 - y0) * j // rows),
                (x0 + (x1 - x0) * (i + 1) // columns, y0 + (y1 - y0) * (j + 1) // rows),
            )
            cv2.rectangle(image, a, b, dark, 1)
            if b[0] - a[0] > 3 * inset and b[1] - a[1] > 3 * inset:
                cv2.rectangle(
                    image,
                    (a[0] + inset, a[1] + inset),
                    (b[0] - inset, b[1] - inset),
                    dark,
                    1,
                )
                cv2.line(
                    image,
                    (a[0] + inset + 1, b[1] - inset + 1),
                    (b[0] - inset, b[1] - inset + 1),
                    light,
                    1,
                )
                middle = ((a[0] + b[0]) // 2, (a[1] + b[1]) // 2)
                if shape == "knob":
                    cv2.circle(image, middle, hand.whole(2, 5), knob, -1, cv2.LINE_AA)
                    cv2.circle(
                        image, (middle[0] - 1, middle[1] - 1), 1, light, -1, cv2.LINE_AA
                    )
                elif shape == "bar":
                    cv2.line(
                        image,
                        (middle[0] - 9, middle[1]),
                        (middle[0] + 9, middle[1]),
                        knob,
                        2,
                        cv2.LINE_AA,
                    )


def _paste(image: Rgb8, patch: Rgb8, x: int, y: int) -> None:
    x0, y0 = max(0, x), max(0, y)
    x1, y1 = (
        min(image.shape[1], x + patch.shape[1]),
        min(image.shape[0], y + patch.shape[0]),
    )
    if x1 > x0 and y1 > y0:
        image[y0:y1, x0:x1] = patch[y0 - y : y1 - y, x0 - x : x1 - x]
