"""Background fills: holes of real outlines in real photos where nothing stood, compared with what the photo shows.

    python benchmarks/fills.py FOLDER                 # 150 holes; half `report`
    python benchmarks/fills.py FOLDER --half tune --count 40
    python benchmarks/fills.py FOLDER --pairs OUT     # 40 pairs beside each other, left and right by chance

FOLDER holds photos ID.jpg and label maps ID.png (0 = background, 1.. = objects, 255 = not judged). A hole is the
outline of an object from one photo, at a place of another where no object is labelled. Halves are split by photo.

Contrast is the root mean square of grey minus its blur of DETAIL px, inside the fill over in the photo: a blur has
about 0.3. The rim is the step of contrast between bands of RIM px on both sides of what was filled, as a logarithm, in
36 sectors, less the same step in the photo. PSNR and SSIM are of the hole; both prefer a blur to a copy.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.backends.inpaint_fill import fill
from physgen.perceive.inpaint.poisson import fill_behind

Rgb = NDArray[np.uint8]
Mask = NDArray[np.bool_]

COUNT = 150
PAIRS = 40
DETAIL = 3.0
"""px: standard deviation of the blur that separates texture from colour."""
RIGHT = (0.85, 1.15)
"""Contrast over the photo's that counts as right."""
TEXTURED = 6.0
"""Levels of contrast from which a place counts as textured."""
RIM = 6
"""px: width of the bands on both sides of the rim."""
SECTORS = 36
FEWEST = 20
"""px of a band that a sector must have."""
SIZES = (0.01, 0.08)
"""Share of its photo that an outline covers."""
FREE = 0.02
"""Share of the hole's surroundings that may be of other objects."""
CELL = 16
"""px: side of the cells of two interleaved halves of a place."""
MOVES = 3
"""Places tried on each side of a hole, one beside the other."""
MEASURES = ("ratio", "rim", "psnr", "ssim", "seconds")


@dataclass(frozen=True)
class Hole:
    """A photo and the place that is filled in it."""

    photo: str
    half: str
    rgb: Rgb
    mask: Mask


def holes(folder: Path, count: int, half: str, seed: int = 0) -> Iterator[Hole]:
    """Up to `count` holes of one half of the photos in `folder`."""
    files = sorted(folder.glob("*.jpg"))
    rng = np.random.default_rng(seed)
    made = 0
    for index in rng.permutation(len(files) * 3):
        file = files[index % len(files)]
        donor = files[(index * 7 + 11) % len(files)]
        shape = _outline(donor, int(index))
        mask = None if shape is None else _placed(shape, _labels(file), rng)
        # the generator is used alike for both halves, so a hole does not depend on them
        if mask is None or _half(file.stem) != half:
            continue
        rgb = np.ascontiguousarray(cv2.imread(str(file))[..., ::-1])
        yield Hole(file.stem, half, rgb, mask)
        made += 1
        if made == count:
            return


def _half(photo: str) -> str:
    """Return the half of a photo, by its name."""
    digest = hashlib.md5(photo.encode(), usedforsecurity=False).hexdigest()
    return "tune" if int(digest, 16) % 2 else "report"


def _labels(file: Path) -> NDArray[np.uint8]:
    return cv2.imread(str(file.with_suffix(".png")), cv2.IMREAD_GRAYSCALE)


def _outline(donor: Path, index: int) -> Mask | None:
    """The mask of one object of a photo in its box; None if none has the right size."""
    labels = _labels(donor)
    share = np.bincount(labels.ravel(), minlength=256) / labels.size
    fitting = np.flatnonzero((share > SIZES[0]) & (share < SIZES[1]))
    ids = fitting[(fitting > 0) & (fitting < 255)]
    if not len(ids):
        return None
    own = labels == ids[index % len(ids)]
    left, top, width, height = cv2.boundingRect(own.astype(np.uint8))
    return own[top : top + height, left : left + width]


def _placed(
    shape: Mask, labels: NDArray[np.uint8], rng: np.random.Generator
) -> Mask | None:
    """(H, W) `shape` at a place where nothing is labelled; None if there is none."""
    objects = (labels > 0) & (labels < 255)
    rows, columns = np.array(labels.shape) - shape.shape - 10
    if min(rows, columns) < 1:
        return None
    for _ in range(100):
        top = int(rng.integers(5, 5 + rows))
        left = int(rng.integers(5, 5 + columns))
        mask = np.zeros(labels.shape, bool)
        mask[top : top + shape.shape[0], left : left + shape.shape[1]] = shape
        around = cv2.dilate(mask.astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
        if objects[around].mean() < FREE:
            return mask
    return None


def detail(rgb: Rgb) -> NDArray[np.float32]:
    """(H, W): grey levels minus their blur."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return grey - cv2.GaussianBlur(grey, (0, 0), DETAIL)


def contrast(rgb: Rgb, mask: Mask) -> float:
    """Levels: root mean square of the fine detail in `mask`."""
    return float(np.sqrt((detail(rgb)[mask] ** 2).mean()))


def rim_step(rgb: Rgb, region: Mask) -> float:
    """Mean step of the logarithm of contrast across the rim of `region`."""
    inside = cv2.distanceTransform(region.astype(np.uint8), cv2.DIST_L2, 5)
    outside = cv2.distanceTransform((~region).astype(np.uint8), cv2.DIST_L2, 5)
    middle = np.argwhere(region).mean(axis=0)
    rows, columns = np.indices(region.shape)
    angle = np.arctan2(rows - middle[0], columns - middle[1])
    sector = ((angle / (2 * np.pi) + 0.5) * SECTORS).astype(np.int64) % SECTORS
    energy = detail(rgb) ** 2
    sums, counts = [], []
    for distance in (inside, outside):
        band = (distance > 0) & (distance <= RIM)
        counts.append(np.bincount(sector[band], minlength=SECTORS))
        sums.append(np.bincount(sector[band], energy[band], SECTORS))
    usable = np.min(counts, axis=0) > FEWEST
    if not usable.any():
        return 0.0
    one, other = (
        total[usable] / count[usable] for total, count in zip(sums, counts, strict=True)
    )
    return float(np.abs(0.5 * np.log((one + 1) / (other + 1))).mean())


def similarity(one: Rgb, other: Rgb) -> NDArray[np.float64]:
    """(H, W) SSIM of grey levels (Wang et al. 2004; Gaussian window of 11 px)."""
    first, second = (
        cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float64) for rgb in (one, other)
    )

    def mean(picture: NDArray[np.float64]) -> NDArray[np.float64]:
        return cv2.GaussianBlur(picture, (11, 11), 1.5)

    means = mean(first), mean(second)
    variance = mean(first**2) - means[0] ** 2 + mean(second**2) - means[1] ** 2
    common = mean(first * second) - means[0] * means[1]
    low, high = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    light = (2 * means[0] * means[1] + low) / (means[0] ** 2 + means[1] ** 2 + low)
    return light * (2 * common + high) / (variance + high)


def measure(hole: Hole, filled: Rgb, seconds: float) -> dict[str, float]:
    """Measures of one fill; see the head of this file."""
    inner = cv2.erode(hole.mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    changed = np.abs(filled.astype(np.int16) - hole.rgb).max(axis=2) > 0
    region = (changed | hole.mask).astype(np.uint8)
    opened = cv2.morphologyEx(region, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)) > 0
    error = ((filled.astype(np.float64) - hole.rgb)[hole.mask] ** 2).mean()
    return {
        "ratio": contrast(filled, inner) / max(contrast(hole.rgb, inner), 0.5),
        "rim": rim_step(filled, opened) - rim_step(hole.rgb, opened),
        "psnr": float(10 * np.log10(255**2 / max(error, 1e-6))),
        "ssim": float(similarity(filled, hole.rgb)[hole.mask].mean()),
        "seconds": seconds,
    }


def place_beside(hole: Hole, labels: NDArray[np.uint8]) -> Mask | None:
    """(H, W) the hole moved to the nearest place without objects; None without one."""
    left, top, width, height = cv2.boundingRect(hole.mask.astype(np.uint8))
    shape = hole.mask[top : top + height, left : left + width]
    objects = (labels > 0) & (labels < 255)
    for move in range(1, MOVES + 1):
        for down, right in ((0, -1), (0, 1), (-1, 0), (1, 0)):
            y, x = top + move * down * height, left + move * right * width
            fits = y + height <= len(labels) and x + width <= labels.shape[1]
            if min(y, x) < 0 or not fits:
                continue
            moved = np.zeros_like(hole.mask)
            moved[y : y + height, x : x + width] = shape
            if objects[moved].mean() < FREE and not (moved & hole.mask).any():
                return moved
    return None


def truths(hole: Hole, labels: NDArray[np.uint8]) -> dict[str, float]:
    """Ratios of contrast of the photo itself: what a perfect copy would reach.

    `beside` is the nearest place without objects over the hole's; `halves` is one of
    two interleaved halves of the hole over the other.
    """
    rows, columns = np.indices(hole.mask.shape) // CELL
    is_even = (rows + columns) % 2 == 0
    even, odd = hole.mask & is_even, hole.mask & ~is_even
    result = {}
    if min(even.sum(), odd.sum()) > FEWEST:
        ratio = contrast(hole.rgb, even) / max(contrast(hole.rgb, odd), 0.5)
        result["halves"] = ratio
    moved = place_beside(hole, labels)
    if moved is not None:
        ratio = contrast(hole.rgb, moved) / max(contrast(hole.rgb, hole.mask), 0.5)
        result["beside"] = ratio
    return result


def fills(folder: Path, count: int = COUNT, half: str = "report") -> list[dict]:
    """One row a hole: measures of means of patches, and of copies of pieces."""
    rows = []
    ways = {"patches": fill(copies=False), "copies": fill()}
    for hole in holes(folder, count, half):
        inner = cv2.erode(hole.mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        if inner.sum() < 100:
            continue
        row: dict = {"photo": hole.photo, "contrast": contrast(hole.rgb, inner)}
        row["truth"] = truths(hole, _labels(folder / f"{hole.photo}.jpg"))
        for name, inpaint in ways.items():
            start = time.process_time()
            filled = fill_behind(hole.rgb, hole.mask, inpaint)
            row[name] = measure(hole, filled, time.process_time() - start)
        rows.append(row)
    return rows


def summary(rows: list[dict], way: str) -> dict[str, float]:
    """Means over rows, the median contrast and the shares that are right."""
    result = {key: float(np.mean([r[way][key] for r in rows])) for key in MEASURES}
    ratios = np.array([row[way]["ratio"] for row in rows])
    textured = np.array([row["contrast"] for row in rows]) > TEXTURED
    right = (ratios > RIGHT[0]) & (ratios < RIGHT[1])
    result["ratio"] = float(np.median(ratios))
    result["right"] = float(right.mean())
    result["textured"] = float(np.median(ratios[textured]))
    result["textured_right"] = float(right[textured].mean())
    return result


def table(rows: list[dict]) -> list[str]:
    """Lines of the table in docs/benchmarks.md."""
    names = ("patches", "copies")
    means = [summary(rows, name) for name in names]
    lines = [
        f"{len(rows)} holes of real outlines in real photos where nothing stood, of the half",
        "kept for reporting (the gain of fine detail alone was lowered after a look at it).",
        "Contrast: of fine detail, over the photo's. Rim: step",
        "of the logarithm of contrast across the rim, less the photo's own. PSNR and SSIM",
        "are of the hole, and prefer a blur to a copy.",
        "",
        "| measure | means of patches | copies of pieces |",
        "| --- | ---: | ---: |",
    ]
    formats = {
        "contrast, median": "{ratio:.2f}",
        "contrast within 15 % of the photo's": "{right:.0%}",
        "contrast of textured places, median": "{textured:.2f}",
        "the same, within 15 %": "{textured_right:.0%}",
        "rim": "{rim:.3f}",
        "PSNR, dB": "{psnr:.2f}",
        "SSIM": "{ssim:.3f}",
        "CPU seconds": "{seconds:.2f}",
    }
    for label, pattern in formats.items():
        one, other = (pattern.format(**mean) for mean in means)
        lines.append(f"| {label} | {one} | {other} |")
    return [*lines, *_truth_lines(rows)]


def _truth_lines(rows: list[dict]) -> list[str]:
    """Lines that say how often the photo itself has the right contrast."""
    shares = {}
    for name in ("beside", "halves"):
        ratios = [row["truth"][name] for row in rows if name in row["truth"]]
        inside = [RIGHT[0] < ratio < RIGHT[1] for ratio in ratios]
        shares[name] = f"{np.mean(inside):.0%} of {len(inside)}"
    return [
        "",
        "No copy can be within 15 % everywhere: the photo's own contrast at the nearest",
        f"free place is within 15 % of the hole's in {shares['beside']}, and that of two",
        f"interleaved halves of the hole, in squares of {CELL} px, in {shares['halves']}.",
    ]


def pairs(folder: Path, out: Path, count: int = PAIRS) -> None:
    """Write pairs of fills of the half `report` beside each other, and their key."""
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    key = {}
    for number, hole in enumerate(holes(folder, count, "report"), 1):
        ways = [("patches", fill(copies=False)), ("copies", fill())]
        if rng.random() < 0.5:
            ways.reverse()
        tiles = [fill_behind(hole.rgb, hole.mask, inpaint) for _, inpaint in ways]
        gap = np.full((len(hole.rgb), 16, 3), 255, np.uint8)
        picture = np.hstack([tiles[0], gap, tiles[1]])
        cv2.imwrite(str(out / f"{number:02d}.png"), picture[..., ::-1])
        key[f"{number:02d}"] = [name for name, _ in ways]
    (out.parent / "key.json").write_text(json.dumps(key, indent=1) + "\n")


def bench(_folder: Path) -> list[dict]:
    """Rows for `run.py`; PHYSGEN_LABELLED_PHOTOS names the folder of the photos."""
    return fills(Path(os.environ["PHYSGEN_LABELLED_PHOTOS"]))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--half", choices=("tune", "report"), default="report")
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--pairs", type=Path)
    options = parser.parse_args()
    if options.pairs:
        pairs(options.folder, options.pairs)
        return
    rows = fills(options.folder, options.count, options.half)
    sys.stdout.write("\n".join(table(rows)) + "\n")


if __name__ == "__main__":
    main()
