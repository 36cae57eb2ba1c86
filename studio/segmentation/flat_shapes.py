"""Drawings of flat shapes with their label maps, as researchers make by program.

    python studio/segmentation/flat_shapes.py -o FOLDER

Each drawing shows circles, boxes and triangles on a plain ground. There are six kinds:
coloured shapes on a light ground, the same on a dark ground, black and white only, a
ground of two tones, noise over all, and puzzles of five objects in the manner of PHYRE
(Bakhtin et al. 2019). One half of the drawings is held out: it only measures.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

COUNT = 60
"""Drawings in the set."""
KINDS = ("light", "dark", "black-and-white", "two-tone", "noise", "puzzle")
PUZZLE_OBJECTS = 5
PLAIN_OBJECTS = (3, 4)
"""Least and greatest number of shapes of the other kinds."""
PUZZLE_COLOURS = (
    (243, 79, 70), (107, 206, 187), (24, 119, 242), (75, 74, 164), (185, 202, 210),
)  # fmt: skip
"""sRGB of PHYRE's bodies: red, green, blue, purple, grey."""
SIDES = (256, 320, 448, 512, 640)
"""px of the longer side."""
OVERSAMPLING = 4
"""Shapes are drawn so many times larger, so that their borders come out smooth."""
LEAST_CONTRAST = 60
"""Of 255, in one channel: how far a shape's colour is from its ground's."""
TRIES = 60
"""Places tried for one shape before it is left out."""

Colour = tuple[int, int, int]
Rgb = NDArray[np.uint8]
Labels = NDArray[np.uint16]


@dataclass(frozen=True)
class Drawing:
    """One drawing and its truth."""

    name: str
    rgb: Rgb  # (H, W, 3) sRGB
    labels: Labels  # (H, W): 0 = ground, 1, 2, ... = one shape each

    @property
    def is_held_out(self) -> bool:
        """Whether the drawing only measures."""
        return int(self.name.rsplit("-", 1)[1]) % 2 == 1


def drawings() -> Iterator[Drawing]:
    """Draw the set, always the same."""
    for number in range(COUNT):
        # neighbours are of one kind, and one of the two is held out
        kind = KINDS[number // 2 % len(KINDS)]
        yield draw(f"{kind}-{number:02d}", kind, np.random.default_rng(number))


def draw(name: str, kind: str, rng: np.random.Generator) -> Drawing:
    """Draw one picture of a kind."""
    long_side = int(rng.choice(SIDES))
    height = round(long_side * rng.choice((1.0, 0.75, 0.66)))
    shape = height, long_side
    rgb = _ground(kind, shape, rng)
    labels = np.zeros(shape, np.uint16)
    count = PUZZLE_OBJECTS
    if kind != "puzzle":
        count = int(rng.integers(PLAIN_OBJECTS[0], PLAIN_OBJECTS[1] + 1))
    for number in range(1, count + 1):
        coverage = _place(kind, number, labels, rng)
        if coverage is None:
            continue
        ground = rgb[coverage > 0.5].mean(axis=0)
        colour = _colour(kind, number, ground, rng)
        rgb = rgb + coverage[..., None] * (np.array(colour) - rgb)
        if kind == "light" and rng.random() < 0.3:
            rgb = _outlined(rgb, coverage > 0.5)
        labels[coverage > 0.5] = number
    if kind == "noise":
        rgb = rgb + rng.normal(0, rng.uniform(8, 25), rgb.shape)
    return Drawing(name, np.clip(np.rint(rgb), 0, 255).astype(np.uint8), labels)


def _ground(
    kind: str, shape: tuple[int, int], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Paint the ground of a drawing of `shape` (height, width)."""
    first = _ground_colour(kind, rng)
    rgb = np.full((*shape, 3), first, np.float64)
    if kind == "two-tone":
        floor = round(shape[0] * rng.uniform(0.55, 0.85))
        rgb[floor:] = rng.integers(40, 230, 3)
    if kind == "puzzle" and rng.random() < 0.5:
        # PHYRE's static floor is black
        rgb[-round(0.04 * shape[0]) :] = 0
    return rgb


def _ground_colour(kind: str, rng: np.random.Generator) -> NDArray[np.int64]:
    """Choose the main colour of a ground."""
    if kind in ("light", "puzzle"):
        white = np.full(3, 255)
        return white if rng.random() < 0.6 else rng.integers(215, 256, 3)
    if kind == "dark":
        black = np.zeros(3, np.int64)
        return black if rng.random() < 0.5 else rng.integers(0, 60, 3)
    if kind == "black-and-white":
        return np.full(3, 255 * int(rng.random() < 0.5))
    return rng.integers(60, 256, 3)


def _colour(
    kind: str, number: int, ground: NDArray[np.float64], rng: np.random.Generator
) -> Colour:
    """Choose a colour that stands out from the mean colour of the ground beneath."""
    if kind == "black-and-white":
        level = 0 if ground.mean() > 127 else 255
        return level, level, level
    if kind == "puzzle":
        return PUZZLE_COLOURS[number - 1]
    while True:
        red, green, blue = rng.integers(0, 256, 3).tolist()
        if np.abs(np.array((red, green, blue)) - ground).max() >= LEAST_CONTRAST:
            return red, green, blue


def _place(
    kind: str, number: int, labels: Labels, rng: np.random.Generator
) -> NDArray[np.float64] | None:
    """Return the coverage (H, W) of the next shape at a free place; None without one."""
    height, width = labels.shape
    for _ in range(TRIES):
        size = min(height, width) * rng.uniform(0.05, 0.17)
        x = rng.uniform(1.2 * size, width - 1.2 * size)
        y = rng.uniform(1.2 * size, height - 1.2 * size)
        corners = _outline(kind, number, size, rng) + (x, y)
        coverage = _coverage(corners, labels.shape)
        grown = cv2.dilate((coverage > 0).astype(np.uint8), np.ones((5, 5), np.uint8))
        inside = (corners > 1).all() and (corners < (width - 1, height - 1)).all()
        if inside and not labels[grown > 0].any():
            return coverage
    return None


def _outline(
    kind: str, number: int, size: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return the corners (n, 2) px of a circle, a box or a triangle about the origin."""
    form = (number - 1) % 3
    turn = rng.uniform(0, 2 * np.pi) if rng.random() < 0.5 else 0.0
    if form == 0:
        angles = np.linspace(0, 2 * np.pi, 90, endpoint=False)
        return size * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if form == 1:
        slender = 0.3 if kind == "puzzle" else rng.uniform(0.5, 1)
        long = size * (1.8 if kind == "puzzle" else 1.0)
        half = np.array([long, slender * size])
        corners = half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    else:
        angles = np.deg2rad([-90, 30, 150]) + rng.uniform(-0.2, 0.2, 3)
        corners = 1.15 * size * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    across = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return np.asarray(corners @ across)


def _coverage(
    corners: NDArray[np.float64], shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """Return which share of each pixel (H, W) a polygon covers."""
    fine = np.zeros((OVERSAMPLING * shape[0], OVERSAMPLING * shape[1]), np.uint8)
    cv2.fillPoly(fine, [np.rint(OVERSAMPLING * corners).astype(np.int32)], 255)
    size = shape[1], shape[0]
    return cv2.resize(fine, size, interpolation=cv2.INTER_AREA).astype(float) / 255


def _outlined(rgb: NDArray[np.float64], mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Draw a black line of 2 px along the inside of a mask."""
    inner = cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    return np.where((mask & ~inner)[..., None], 0.0, rgb)


def main() -> None:
    """Write NAME.png and NAME.labels.png of each drawing to a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    for one in drawings():
        cv2.imwrite(str(args.output / f"{one.name}.png"), one.rgb[..., ::-1])
        cv2.imwrite(str(args.output / f"{one.name}.labels.png"), one.labels)


if __name__ == "__main__":
    main()
