"""What refinement changed: measured changes, the strip of frames before and after, and the rows of the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import decode, encode_u8
from physgen.render.drawing import Colour, Layer, text_width
from physgen.report.html import webp
from physgen.report.perception import Comparison
from physgen.report.record import REFINING

# ----------------------------------------------------------------------
# A few frames before and after refinement -> one picture: columns in time; guidance, refined, and what
# changed.

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]
Size = tuple[int, int]
"""Width and height, px."""
Piece = str | U8
"""Of the key: words, or a picture (h, w, 3) sRGB."""

COLUMNS = 6
WIDEST = 1600
"""px of the strip."""
TALLEST = 300
"""px of a panel."""
NARROWEST = 440, 72
"""px of a strip and of a column: words need room beside the smallest frames."""
GAP, LETTER, LINE = 8, 18, 30
"""px between panels, of words, and of a line of them."""
ROWS = ("guidance", "refined", "change")
PAPER: Colour = (255, 255, 255)
WORDS: Colour = (32, 34, 40)
WARM: Colour = (178, 24, 43)
COOL: Colour = (33, 102, 172)
PALE = 176, 236
"""Grey levels that black and white have beneath the colours of change."""
LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""ITU-R BT.709, of sRGB codes."""
BORDER = 0.5
"""Of a pixel, that an object covers on its outline."""
LINES: Colour = (58, 62, 72)
ROBUST = 99.8
"""Percentile of one panel's changes that full colour stands for at least: a few odd pixels do not pale the rest."""
STEPS = (1, 2, 5, 10, 20, 50, 100, 255)
"""Grey levels that full colour may stand for."""
BAR = 150
"""px: length of the scale."""
FINE, PEN = 4, 3
"""Sub-pixels a side where outlines are drawn, and how many a line is wide."""


@dataclass(frozen=True)
class Column:
    """One moment, as large as a panel."""

    time: float
    """s of playing."""
    guidance: U8
    """(h, w, 3) sRGB."""
    refined: U8
    """(h, w, 3) sRGB."""
    change: F32
    """(h, w) grey levels of luma (ITU-R BT.709) by which the refined is brighter."""
    outlines: F32
    """(h, w) 0..1: how much of each pixel the line takes along which objects cover half."""


def panel(size: Size) -> Size:
    """Width and height of a panel for frames of this size.

    >>> panel((1920, 1080)), panel((1080, 1920))
    ((243, 137), (169, 300))
    """
    widest = (WIDEST - _left() - COLUMNS * GAP) // COLUMNS
    scale = min(widest / size[0], TALLEST / size[1])
    width, height = (max(1, round(side * scale)) for side in size)
    return width, height


def column(time: float, guidance: U8, refined: U8, change: F32, coverage: F32) -> Column:
    """Made small, in linear light: (H, W, 3) sRGB twice, (H, W) grey levels and (H, W) coverage 0..1."""
    size = panel((guidance.shape[1], guidance.shape[0]))
    small = [_sized(picture, size) for picture in (decode(guidance), decode(refined), change)]
    return Column(time, encode_u8(small[0]), encode_u8(small[1]), small[2], _outlines(coverage, size))


def full_scale(columns: Sequence[Column]) -> int:
    """Grey levels that full colour stands for.

    Nothing that is larger than a few pixels is beyond it; 0 where nothing changed.
    """
    if not any(one.change.any() for one in columns):
        return 0
    most = max(float(np.percentile(np.abs(one.change), ROBUST)) for one in columns)
    return next((step for step in STEPS if most < step + 0.5), STEPS[-1])


def strip(columns: Sequence[Column]) -> U8:
    """(H, W, 3) sRGB; W is at most WIDEST."""
    levels = full_scale(columns)
    height, width = columns[0].change.shape
    cell, tall = max(width, NARROWEST[1]), max(height, LINE)
    wide = max(_left() + len(columns) * (cell + GAP), NARROWEST[0])
    key = _flowed(_key(levels), wide - 2 * GAP)
    top, below = LINE + GAP // 2, LINE + GAP // 2 + len(ROWS) * (tall + GAP)
    page = np.empty((below + len(key) * LINE + GAP, wide, 3), np.uint8)
    page[:] = PAPER
    words = Layer((wide, page.shape[0]), 0.0)
    for j, name in enumerate(ROWS):
        words.words(name, (GAP + text_width(name, LETTER) / 2, top + j * (tall + GAP) + tall / 2), LETTER)
    for k, one in enumerate(columns):
        x = _left() + k * (cell + GAP)
        words.words(f"{one.time:.2f} s", (x + cell / 2, top - LINE / 2), LETTER)
        for j, picture in enumerate((one.guidance, one.refined, change_picture(one, levels))):
            y, left = top + j * (tall + GAP) + (tall - height) // 2, x + (cell - width) // 2
            page[y : y + height, left : left + width] = picture
    for j, line in enumerate(key):
        x, y = GAP, below + j * LINE
        for part in line:
            for piece in part:
                if isinstance(piece, str):
                    words.words(piece, (x + text_width(piece, LETTER) / 2, y + LINE / 2), LETTER)
                else:
                    bar = page[y + (LINE - len(piece)) // 2 :, x:]
                    bar[: len(piece), : piece.shape[1]] = piece
                x += _wide(piece) + GAP
            x += GAP
    words.onto(page, WORDS)
    return page


def change_picture(one: Column, levels: int) -> U8:
    """(h, w, 3) sRGB: the guidance in pale grey, warm where it is brighter now and cool where darker, with outlines."""
    grey = one.guidance @ LUMA
    picture = coloured_change(PALE[0] + (PALE[1] - PALE[0]) * grey / 255, one.change, levels)
    mixed = picture + one.outlines[..., None] * (np.array(LINES, np.float32) - picture)
    return np.asarray(np.rint(mixed), np.uint8)


def coloured_change(grey: NDArray[np.floating], change: NDArray[np.floating], levels: int) -> U8:
    """(h, w, 3) sRGB of grey (h, w) 0..255 beneath; `change` (h, w) grey levels of either sign."""
    share = np.minimum(np.abs(change) / max(levels, 1), 1)[..., None]
    colour = np.where(change[..., None] > 0, np.array(WARM, np.float32), np.array(COOL, np.float32))
    mixed = grey[..., None] * (1 - share) + colour * share
    return np.asarray(np.rint(mixed), np.uint8)


def _key(levels: int) -> list[list[Piece]]:
    """What the colours and lines mean, in parts that are not broken."""
    lines: list[Piece] = ["lines: objects' outlines"]
    if not levels:
        return [["no change at all"], lines]
    ramp = np.linspace(-levels, levels, BAR, dtype=np.float32)[None].repeat(LINE // 2, axis=0)
    bar = coloured_change(np.full_like(ramp, sum(PALE) / 2), ramp, levels)
    scale: list[Piece] = [f"darker by {levels}", bar, f"brighter by {levels}"]
    stronger = f", drawn {255 / levels:.3g} times as strong" if levels < 255 else ""
    return [scale, [f"grey levels of 255{stronger}"], lines]


def _flowed(parts: Sequence[Sequence[Piece]], room: float) -> list[list[Sequence[Piece]]]:
    """Lines of parts."""
    lines: list[list[Sequence[Piece]]] = [[]]
    taken = 0.0
    for part in parts:
        width = sum(_wide(piece) + GAP for piece in part) + GAP
        if lines[-1] and taken + width > room:
            lines.append([])
            taken = 0.0
        lines[-1].append(part)
        taken += width
    return lines


def _wide(piece: Piece) -> int:
    """px."""
    return ceil(text_width(piece, LETTER)) if isinstance(piece, str) else piece.shape[1]


def _left() -> int:
    """px from the border to the first panel."""
    return ceil(max(text_width(name, LETTER) for name in ROWS)) + 2 * GAP


def _sized(picture: F32, size: Size) -> F32:
    """Means of pixels where it becomes smaller; straight between pixels where larger, so that no sign is invented."""
    how = cv2.INTER_AREA if size[0] < picture.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, size, interpolation=how), np.float32)


def _outlines(coverage: F32, size: Size) -> F32:
    """See `Column.outlines`. Beyond the frame things go on: no line runs along its border."""
    fine = _sized(coverage, (size[0] * FINE, size[1] * FINE))
    covered = (fine >= BORDER).astype(np.uint8)
    wider = cv2.dilate(covered, np.ones((3, 3), np.uint8))
    narrower = cv2.erode(covered, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * PEN - 1, 2 * PEN - 1)))
    return _sized((wider - narrower).astype(np.float32), size)


# ----------------------------------------------------------------------
# Guidance, refined frames and coverage, one after the other -> what refinement changed: figures, and the
# strip.
#
# Only a few small columns and the frames before are held, so a clip may be as long as it likes.

CHANNELS = 3
NEAR = 0.05
"""Of the frame's diagonal: so far from an object its shadow, and what it reflects, is near it."""
PLACES = ("objects", "near", "elsewhere")


@dataclass
class _Jump:
    """The largest mean change from a frame to the next, in grey levels, and the later of the two."""

    size: float = 0.0
    at: int = 0

    def to(self, size: float, at: int) -> None:
        if size > self.size:
            self.size, self.at = size, at


@dataclass
class RefinementChanges:
    """What is told of frames as they come."""

    count: int
    """Frames of the clip."""
    fps: float
    most: int = 0
    """The frame that changed most."""
    refined: U8 = field(default_factory=lambda: np.zeros((0, 0, 3), np.uint8))
    """(H, W, 3) sRGB: what became of it."""
    _largest: float = -1.0
    _columns: list[Column] = field(default_factory=list)
    _last: tuple[U8, U8, NDArray[np.int16]] | None = None
    """The frame before: guidance, refined, and their difference."""
    _seen: int = 0
    _sums: NDArray[np.float64] = field(default_factory=lambda: np.zeros((len(PLACES), 2)))
    """Of each place: change, and pixels."""
    _first: float = 0.0
    _near: float = 0.0
    _guided: _Jump = field(default_factory=_Jump)
    _refined: _Jump = field(default_factory=_Jump)
    _apart: _Jump = field(default_factory=_Jump)

    def add(self, guidance: U8, refined: U8, coverage: F32) -> None:
        """The next frame: (H, W, 3) sRGB twice, and (H, W) coverage of objects, 0..1."""
        difference = np.subtract(refined, guidance, dtype=np.int16)
        change = _summed(np.asarray(cv2.absdiff(refined, guidance), np.uint8))
        self._near = NEAR * float(np.hypot(*change.shape))
        for k, share in enumerate(_shares(coverage, self._near)):
            pixels = float(share.sum(dtype=np.float64))
            self._sums[k] += float((share * change).sum(dtype=np.float64)) / CHANNELS, pixels
        at = self._seen
        if self._last is None:
            self._first = float(change.mean(dtype=np.float64)) / CHANNELS
        else:
            before, after, between = self._last
            self._guided.to(cv2.norm(guidance, before, cv2.NORM_L1) / guidance.size, at)
            self._refined.to(cv2.norm(refined, after, cv2.NORM_L1) / guidance.size, at)
            self._apart.to(cv2.norm(difference, between, cv2.NORM_L1) / guidance.size, at)
        if at in self._shown():
            luma = np.asarray(cv2.transform(difference.astype(np.float32), LUMA[None]), np.float32)
            self._columns.append(column(at / self.fps, guidance, refined, luma, coverage))
        if (mean := float(change.mean(dtype=np.float64))) > self._largest:
            self._largest, self.most, self.refined = mean, at, refined.copy()
        self._last = guidance, refined, difference
        self._seen += 1

    def figures(self) -> dict[str, float | None]:
        """Mean absolute changes of the sRGB codes, in grey levels of 255; None where there is no such place.

        `objects`, `near` them (up to `near_px` off) and `elsewhere`; each pixel counts by its coverage, or by what
        coverage leaves. `all`: of the whole clip, `first`: of the first frame. `jump_guidance` and `jump_refined`: the
        largest mean change from one frame to the next; `flicker`: how many times larger it became. `jump_of_change`:
        the same of refined less guidance, which moves with nothing, at `jump_at` s.
        """
        means = {
            place: float(total / pixels) if pixels > 0 else None
            for place, (total, pixels) in zip(PLACES, self._sums.tolist(), strict=True)
        }
        total, pixels = self._sums.sum(axis=0).tolist()
        before, after = self._guided.size, self._refined.size
        found = {
            **means,
            "all": total / max(pixels, 1.0),
            "near_px": self._near,
            "first": self._first,
            "jump_guidance": before,
            "jump_refined": after,
            "flicker": after / before if before > 0 else None,
            "jump_of_change": self._apart.size,
            "jump_at": self._apart.at / self.fps,
        }
        return {name: None if value is None else round(value, 4) for name, value in found.items()}

    @property
    def columns(self) -> list[Column]:
        """Moments of the strip, as far as they have come."""
        return self._columns

    def picture(self) -> U8:
        """(H, W, 3) sRGB: the difference strip."""
        return strip(self._columns)

    def _shown(self) -> set[int]:
        """Frames of the strip: the first, the last, and as many evenly between."""
        return set(np.linspace(0, self.count - 1, min(COLUMNS, self.count)).round().astype(int).tolist())


def _summed(codes: U8) -> F32:
    """(H, W) of (H, W, 3): over the channels."""
    return np.asarray(cv2.transform(codes.astype(np.float32), np.ones((1, CHANNELS), np.float32)), np.float32)


def _shares(coverage: F32, near: float) -> tuple[F32, F32, F32]:
    """(H, W) each, together 1: of objects, of what is up to `near` px from one, and of all else."""
    beyond = (coverage < 0.5).astype(np.uint8)
    left = 1 - coverage
    if beyond.all():  # the distance to nothing
        return coverage, np.zeros_like(left), left
    away = cv2.distanceTransform(beyond, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return coverage, np.where(away <= near, left, np.float32(0)), np.where(away > near, left, np.float32(0))


# ----------------------------------------------------------------------
# What a record tells of refinement -> the report's section on it: data for the template.

ELSEWHERE = frozenset(
    {
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
    }
)
"""Keys that are told in words of their own, or in another place."""


def refinement(told: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """`failed`: lines of a message; `changes` and `facts`: names and values.

    `told` is `RunRecord.refine`; None where nobody asked.
    """
    if told is None:
        return None
    return {
        "failed": str(told.get("failed", "")).splitlines(),
        "changes": _changes(told["changes"]) if "changes" in told else [],
        "facts": _facts(told),
    }


def _changes(found: Mapping[str, float | None]) -> list[tuple[str, str]]:
    """Means, and jumps from frame to frame."""
    near = f"near them (up to {found['near_px']:.0f} px off)"
    places = [
        ("objects", "on objects"),
        ("near", near),
        ("elsewhere", "elsewhere"),
        ("first", "in the first frame"),
    ]
    rows = [(said, _level(found[name])) for name, said in places if found[name] is not None]
    times = "" if found["flicker"] is None else f", {found['flicker']:.3g} times"
    jumps = f"{_level(found['jump_guidance'])} before, {_level(found['jump_refined'])} refined{times}"
    rows.append(("largest jump between frames", jumps))
    rows.append(
        (
            "largest jump of the change alone",
            f"{_level(found['jump_of_change'])} at {found['jump_at']:.2f} s",
        )
    )
    return rows


def _facts(told: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Who refined, and how."""
    rows = [("backend", str(told["backend"]))]
    if "steps_run" in told:
        steps = f"{told['steps_run']} of {told['steps']} run, {told['steps_fused']} of them fused with the guidance"
        rows.append(("steps", steps))
    if "windows" in told:
        spans = [f"{first}..{last - 1}" for first, last in told["windows"]]
        rows.append(("windows of latent frames", ", ".join(spans)))
    if "size" in told:
        rows.append(("frames shown to the model", "{} × {} px".format(*told["size"])))
    rows += [(name.replace("_", " "), _said(value)) for name, value in told.items() if name not in ELSEWHERE]
    return [(name, value) for name, value in rows if value]


def _level(value: float | None) -> str:
    return "none" if value is None else f"{value:.2f}"


def _said(value: object) -> str:
    """As a person writes it; nothing where nothing is told."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_said(part)}" for name, part in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(map(_said, value))
    return str(value)


# ----------------------------------------------------------------------
# Columns of what refinement changed -> the page's strip: small pictures in rows, with words in the page's
# letters.

QUALITY = 84
"""Of WebP: outlines are fine."""


@dataclass(frozen=True)
class Row:
    """Pictures of one kind, one a moment."""

    name: str
    about: str
    """Behind the moment, for those who do not see them."""
    pictures: tuple[str, ...]
    """Data URIs."""


@dataclass(frozen=True)
class RefinementStrip:
    """What a page shows of a refinement."""

    compared: Comparison
    """A frame before and after."""
    times: tuple[float, ...]
    """s of playing."""
    size: tuple[int, int]
    """Width and height of each picture, px."""
    rows: tuple[Row, ...]
    levels: int
    """Grey levels that full colour stands for; 0: nothing changed."""
    colours: tuple[str, str, str]
    """CSS: darker, unchanged, brighter."""


def refinement_strip(compared: Comparison, columns: Sequence[Column]) -> RefinementStrip:
    """`columns` as `report.changes.Changes` made them, at least one."""
    levels = full_scale(columns)
    height, width = columns[0].change.shape
    kinds = (
        ("as drawn", "as it was drawn", [one.guidance for one in columns]),
        ("refined", "refined", [one.refined for one in columns]),
        ("change", "what changed", [change_picture(one, levels) for one in columns]),
    )
    return RefinementStrip(
        compared,
        tuple(one.time for one in columns),
        (width, height),
        tuple(
            Row(name, about, tuple(webp(picture, QUALITY) for picture in pictures))
            for name, about, pictures in kinds
        ),
        levels,
        tuple(f"rgb({r} {g} {b})" for r, g, b in (COOL, (sum(PALE) // 2,) * 3, WARM)),  # type: ignore[arg-type]
    )
