"""A contact sheet of drawn pictures, outlines of the labels beside each: `python studio/segmentation/sheet.py -o FILE.png`."""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from drawn import draw_told
from numpy.typing import NDArray
from picture import Picture


def outlined(picture: Picture) -> NDArray[np.uint8]:
    """(H, W, 3) the darkened picture with each object's outline in a colour of its own, unsaid pixels grey."""
    image = (picture.rgb * 0.45).astype(np.uint8)
    image[picture.unsaid] = 128
    for number in range(1, int(picture.labels.max()) + 1):
        mask = (picture.labels == number).astype(np.uint8)
        loops, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        hue = cv2.cvtColor(
            np.array([[[number * 47 % 180, 200, 255]]], np.uint8), cv2.COLOR_HSV2RGB
        )[0, 0]
        cv2.drawContours(image, loops, -1, tuple(int(c) for c in hue), 1)
    return image


def sheet(seed: int, rows: int, columns: int) -> NDArray[np.uint8]:
    """(rows * 256, columns * 512, 3) pictures of consecutive seeds."""
    lines = []
    for row in range(rows):
        cells = []
        for column in range(columns):
            told = draw_told(seed + row * columns + column)
            cells += [told.picture.rgb, outlined(told.picture)]
        lines.append(np.hstack(cells))
    return np.vstack(lines)


def main() -> None:
    """Write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rows", type=int, default=5)
    parser.add_argument("--columns", type=int, default=4)
    told = parser.parse_args()
    cv2.imwrite(str(told.output), sheet(told.seed, told.rows, told.columns)[..., ::-1])


if __name__ == "__main__":
    cv2.setNumThreads(1)
    main()
