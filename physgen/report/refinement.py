"""What refinement changed: measured changes, the strip of frames before and after, and the rows of the page.

Frames come one after the other; only a few small columns are kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import decode, encode_u8
from physgen.render.drawing import Colour, Layer
from physgen.report.perception import Comparison
from physgen.report.record import REFINING

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

NEAR = 0.05
"""Of the frame's diagonal: pixels up to this distance from an object count as near it, as shadows are."""
PLACES = ("objects", "near", "elsewhere")


@dataclass(frozen=True)
class StripStyle:
    """Measures and layout of the picture of changes."""

    columns: int = 6
    """Moments of the strip."""
    panel: tuple[int, int] = 240, 300
    """px: largest width and height of a panel."""
    cell: int = 72
    """px: smallest width of a column, which leaves room for its time."""
    robust: float = 99.8
    """Percentile of a panel's changes that full colour is for: a few odd pixels do not pale the rest."""
    scales: tuple[int, int, int, int, int, int, int, int] = (1, 2, 5, 10, 20, 50, 100, 255)
    """Grey levels that full colour may stand for."""


STRIP = StripStyle()

MARGIN, GAP, LETTER, LINE = 90, 8, 18, 30
"""px: column of names, space between panels, letters, and a line of them."""
ROWS = ("guidance", "refined", "change")
PAPER: Colour = (255, 255, 255)
WORDS: Colour = (32, 34, 40)
WARM: Colour = (178, 24, 43)
COOL: Colour = (33, 102, 172)
PALE = 176, 236
"""Grey levels of black and white under the colours of change."""
LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""ITU-R BT.709, of sRGB codes."""
HANDLED_KEYS = frozenset(
    (
        "backend",
        "steps",
        "steps_run",
        "steps_fused",
        "windows",
        "size",
        "changes",
        "strip",
        "failed",
        *REFINING,
    )
)
"""Keys of `RunRecord.refine` that have sentences of their own, or are shown elsewhere."""


@dataclass(frozen=True)
class Column:
    """One moment, in the size of a panel."""

    time: float
    """s of playing."""
    guidance: U8
    """(h, w, 3) sRGB."""
    refined: U8
    """(h, w, 3) sRGB."""
    change: F32
    """(h, w) grey levels of luma by which the refined frame is brighter."""


class RefinementChanges:
    """Measures of frames as they come."""

    def __init__(self, count: int, fps: float) -> None:
        """`count` frames of the clip, at `fps` 1/s."""
        self._fps = fps
        self._shown = set(np.linspace(0, count - 1, min(STRIP.columns, count)).round().astype(int).tolist())
        self.columns: list[Column] = []
        self.most = 0
        """The frame that changed most."""
        self.refined: U8 = np.zeros((0, 0, 3), np.uint8)
        """(H, W, 3) sRGB: that frame after refinement."""
        self._largest, self._first, self._near = -1.0, 0.0, 0.0
        self._seen = 0
        self._sums = np.zeros((len(PLACES), 2))  # of each place: change, and pixels

    def add(self, guidance: U8, refined: U8, coverage: F32) -> None:
        """The next frame: (H, W, 3) sRGB twice, and (H, W) coverage of objects, 0..1."""
        difference = np.subtract(refined, guidance, dtype=np.int16)
        change = np.abs(difference).sum(axis=2).astype(np.float32) / 3
        self._near = NEAR * float(np.hypot(*change.shape))
        for k, share in enumerate(_shares(coverage, self._near)):
            pixels = float(share.sum(dtype=np.float64))
            self._sums[k] += float((share * change).sum(dtype=np.float64)), pixels
        mean = float(change.mean(dtype=np.float64))
        if self._seen == 0:
            self._first = mean
        if self._seen in self._shown:
            self.columns.append(_column(self._seen / self._fps, guidance, refined, difference))
        if mean > self._largest:
            self._largest, self.most, self.refined = mean, self._seen, refined.copy()
        self._seen += 1

    def figures(self) -> dict[str, float | None]:
        """Mean absolute changes of the sRGB codes, in grey levels of 255; None where there is no such place.

        `objects`, `near` them (up to `near_px` away) and `elsewhere`; each pixel counts by its coverage, or by the
        rest. `all`: of the whole clip, `first`: of the first frame.
        """
        means = {
            place: total / pixels if pixels > 0 else None
            for place, (total, pixels) in zip(PLACES, self._sums.tolist(), strict=True)
        }
        total, pixels = self._sums.sum(axis=0).tolist()
        found = {
            **means,
            "all": total / max(pixels, 1.0),
            "near_px": self._near,
            "first": self._first,
        }
        return {name: None if value is None else round(value, 4) for name, value in found.items()}

    def picture(self) -> U8:
        """(H, W, 3) sRGB: the strip; rows are guidance, refined and change, columns are moments."""
        levels = full_scale(self.columns)
        height, width = self.columns[0].change.shape
        cell = max(width, STRIP.cell)
        size = (MARGIN + len(self.columns) * (cell + GAP), 2 * LINE + len(ROWS) * (height + GAP) + GAP)
        size = (max(size[0], 4 * MARGIN), size[1])
        page = np.full((size[1], size[0], 3), PAPER[0], np.uint8)
        words = Layer(size, 0.0)
        for j, name in enumerate(ROWS):
            words.words(name, (MARGIN / 2, LINE + j * (height + GAP) + height / 2), LETTER)
        for k, one in enumerate(self.columns):
            x = MARGIN + k * (cell + GAP)
            words.words(f"{one.time:.2f} s", (x + cell / 2, LINE / 2), LETTER)
            for j, picture in enumerate((one.guidance, one.refined, change_picture(one, levels))):
                y, left = LINE + j * (height + GAP), x + (cell - width) // 2
                page[y : y + height, left : left + width] = picture
        key = f"red: brighter, blue: darker, by {levels} of 255" if levels else "no change at all"
        words.words(key, (size[0] / 2, size[1] - LINE / 2), LETTER)
        words.onto(page, WORDS)
        return page


def _shares(coverage: F32, near: float) -> tuple[F32, F32, F32]:
    """(H, W) each, together 1: of objects, of pixels up to `near` px from one, and of all others."""
    beyond = (coverage < 0.5).astype(np.uint8)
    rest = 1 - coverage
    if beyond.all():
        return coverage, np.zeros_like(rest), rest
    away = cv2.distanceTransform(beyond, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return coverage, np.where(away <= near, rest, np.float32(0)), np.where(away > near, rest, np.float32(0))


def panel(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of a panel for frames of this size, px.

    >>> panel((1920, 1080)), panel((1080, 1920))
    ((240, 135), (169, 300))
    """
    scale = min(STRIP.panel[0] / size[0], STRIP.panel[1] / size[1])
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def _column(time: float, guidance: U8, refined: U8, difference: NDArray[np.int16]) -> Column:
    """Resized in linear light."""
    size = panel((guidance.shape[1], guidance.shape[0]))
    how = cv2.INTER_AREA if size[0] < guidance.shape[1] else cv2.INTER_LINEAR
    luma = difference.astype(np.float32) @ LUMA
    small = [
        cv2.resize(picture, size, interpolation=how) for picture in (decode(guidance), decode(refined), luma)
    ]
    return Column(time, encode_u8(small[0]), encode_u8(small[1]), np.asarray(small[2], np.float32))


def full_scale(columns: Sequence[Column]) -> int:
    """Grey levels that full colour stands for; 0 where nothing changed."""
    if not any(one.change.any() for one in columns):
        return 0
    most = max(float(np.percentile(np.abs(one.change), STRIP.robust)) for one in columns)
    return next((scale for scale in STRIP.scales if most < scale + 0.5), STRIP.scales[-1])


def change_picture(one: Column, levels: int) -> U8:
    """(h, w, 3) sRGB: the guidance in pale grey, warm where the refined frame is brighter and cool where darker."""
    grey = (PALE[0] + (PALE[1] - PALE[0]) * (one.guidance @ LUMA) / 255)[..., None]
    share = np.minimum(np.abs(one.change) / max(levels, 1), 1)[..., None]
    colour = np.where(one.change[..., None] > 0, np.array(WARM, np.float32), np.array(COOL, np.float32))
    return np.asarray(np.rint(grey * (1 - share) + colour * share), np.uint8)


@dataclass(frozen=True)
class RefinementStrip:
    """A refinement on a page."""

    compared: Comparison
    """A frame before and after."""
    picture: str
    """`RefinementChanges.picture` as a data URI."""
    size: tuple[int, int]
    """Its width and height, px."""


def refinement(note: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """`RunRecord.refine` for the page: `failed`, lines of a message; `changes` and `facts`, names and values."""
    if note is None:
        return None
    return {
        "failed": str(note.get("failed", "")).splitlines(),
        "changes": _change_rows(note["changes"]) if "changes" in note else [],
        "facts": _facts(note),
    }


def _change_rows(found: Mapping[str, float | None]) -> list[tuple[str, str]]:
    near = f"near them (up to {found['near_px']:.0f} px away)"
    places = {"objects": "on objects", "near": near, "elsewhere": "elsewhere", "first": "in the first frame"}
    return [(text, f"{found[name]:.2f}") for name, text in places.items() if found[name] is not None]


def _facts(note: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Backend and settings."""
    rows = [("backend", str(note["backend"]))]
    if "steps_run" in note:
        steps = f"{note['steps_run']} of {note['steps']} run, {note['steps_fused']} of them fused with the guidance"
        rows.append(("steps", steps))
    if "windows" in note:
        spans = [f"{first}..{last - 1}" for first, last in note["windows"]]
        rows.append(("windows of latent frames", ", ".join(spans)))
    if "size" in note:
        rows.append(("frames shown to the model", "{} × {} px".format(*note["size"])))
    rows += [
        (name.replace("_", " "), _text(value)) for name, value in note.items() if name not in HANDLED_KEYS
    ]
    return [(name, value) for name, value in rows if value]


def _text(value: object) -> str:
    """Empty for None."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_text(part)}" for name, part in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(map(_text, value))
    return str(value)
