"""A page in the browser -> a small picture of all of it and where its parts are; two such -> in what they differ.

Small and blurred, as one sees a page from far: letters may be drawn by another build of the browser, and yet a part
that is missing, empty, moved or of another colour shows. What differs from run to run is taken out before.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

GOLDEN = Path(__file__).with_name("shots")
LESS = 4
"""Times smaller than the page."""
SOFT, TILE = 1.0, 10
"""Small pixels: sigma of the blur, and sides of the squares whose means are compared."""
FAR = 13.0
"""Grey levels of 255 that the mean of a square may be off, in its worst channel: bolder letters reach 10, a table
without its words 28."""
JPEG = [cv2.IMWRITE_JPEG_QUALITY, 90, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
FONTS = """
*, *::before { font-family: "DejaVu Sans" !important; }
code, code *, pre, kbd { font-family: "DejaVu Sans Mono" !important; }
.times, .times-bar { display: none !important; }
"""
"""The same letters everywhere; times of stages differ on every run."""
STEADY = """() => {
  const set = (what, text) => document.querySelectorAll(what).forEach(e => { e.textContent = text; });
  set('.repeat > div:not(.wide) dd', '–');
  set('#provenance h3:has(+ .times-bar)', 'Time');
  set('footer p', 'Made by physgen.');
  set('header time', '2000-01-01');
  document.activeElement?.blur();
}"""
"""Memory, versions, times and days."""
BOXES = """parts => Object.fromEntries(parts.flatMap(part => [...document.querySelectorAll(part)]
  .map(e => e.getBoundingClientRect()).filter(b => b.width && b.height)
  .map((b, k) => [`${part} ${k + 1}`, [b.left + scrollX, b.top + scrollY, b.width, b.height].map(Math.round)])))"""


@dataclass(frozen=True)
class Shot:
    """A page as it was seen."""

    boxes: dict[str, list[int]]
    """Part -> left, top, width, height, px of the page."""
    picture: np.ndarray
    """(h, w, 3) BGR, LESS times smaller, blurred."""


def shot(page: Any, parts: Sequence[str]) -> Shot:
    """What the page looks like, and where all that the selectors `parts` find is."""
    page.add_style_tag(content=FONTS)
    page.evaluate(STEADY)
    page.wait_for_timeout(250)  # charts and the picture follow their new widths
    data = page.screenshot(full_page=True, animations="disabled")
    large = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    size = large.shape[1] // LESS, large.shape[0] // LESS
    small = cv2.GaussianBlur(cv2.resize(large, size, interpolation=cv2.INTER_AREA), (0, 0), SOFT)
    return Shot(page.evaluate(BOXES, list(parts)), small)


def save(name: str, seen: Shot) -> None:
    GOLDEN.mkdir(exist_ok=True)
    cv2.imwrite(str(GOLDEN / f"{name}.jpg"), seen.picture, JPEG)
    lines = (f" {json.dumps(part)}: {json.dumps(box)}" for part, box in seen.boxes.items())
    (GOLDEN / f"{name}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def golden(name: str) -> Shot:
    picture = cv2.imread(str(GOLDEN / f"{name}.jpg"))
    assert picture is not None, f"{name}.jpg is missing: make it with pytest --force-regen, and look at it"
    return Shot(json.loads((GOLDEN / f"{name}.json").read_text(encoding="utf-8")), picture)


def differences(seen: Shot, right: Shot) -> list[str]:
    """In words; none where the page is as it was."""
    found = [f"{part} is missing" for part in right.boxes.keys() - seen.boxes.keys()]
    found += [f"{part} is new" for part in seen.boxes.keys() - right.boxes.keys()]
    for part, box in right.boxes.items():
        if part not in seen.boxes:
            continue
        now = seen.boxes[part]
        for side, one, other, least, share in zip(
            ("left", "top", "width", "height"), now, box, (6, 12, 6, 8), (0, 0.012, 0.01, 0.02), strict=True
        ):
            if abs(one - other) > least + share * other:
                found.append(f"{part}: {side} is {one} px, and was {other}")
        off, where = _farthest(_cut(seen, now), _cut(right, box))
        if off > FAR:
            found.append(f"{part}: looks otherwise at {where[0]:.0%} across, {where[1]:.0%} down ({off:.1f})")
    return sorted(found)


def _cut(one: Shot, box: Sequence[int]) -> np.ndarray:
    height, width = one.picture.shape[:2]
    x0, y0 = (
        min(max(side // LESS, 0), most - 1) for side, most in zip(box[:2], (width, height), strict=True)
    )
    x1, y1 = (
        max(-(-(start + side) // LESS), low + 1)
        for start, side, low in zip(box[:2], box[2:], (x0, y0), strict=True)
    )
    return one.picture[y0:y1, x0:x1].astype(np.float32)


def _farthest(seen: np.ndarray, right: np.ndarray) -> tuple[float, tuple[float, float]]:
    """Grey levels by which the worst square is off, and where its middle is, of the part's width and height."""
    height, width = right.shape[:2]
    seen = cv2.resize(seen, (width, height), interpolation=cv2.INTER_LINEAR)
    off = np.abs(seen - right)
    tile = min(TILE, width), min(TILE, height)
    means = cv2.blur(off, tile).max(axis=2)
    y, x = np.unravel_index(int(means.argmax()), means.shape)
    return float(means[y, x]), (x / width, y / height)
