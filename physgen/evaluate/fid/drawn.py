"""What was measured -> its plot, and a sheet of frames and flow of each side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from physgen.evaluate.fid.measure import Measured
from physgen.evaluate.fid.roles import U8
from physgen.evaluate.fid.spread import Distance
from physgen.evaluate.findings import Figure
from physgen.evaluate.plotted import plotted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.style import Palette


TILE, GAP = 128, 4
"""px of a picture's height, and between two."""
MARKERS = "osD^v"
"""Each goes round all colours once."""


def plot(found: Measured, heads: Mapping[str, str]) -> Figure:
    """Distances with their intervals: both kinds against each other, as the paper's argument goes, or the one alone."""
    kinds = tuple(found.found)
    names = tuple(found.methods)

    def draw(axes: Axes, palette: Palette) -> None:
        for k, name in enumerate(names):
            colour = palette.lines[k % len(palette.lines)]
            spots = [found.found[kind].frechet[name] for kind in kinds]
            at = [one.value for one in spots] if len(kinds) > 1 else [spots[0].value, float(k)]
            reach = [_reach(one) for one in spots] + ([None] if len(kinds) < 2 else [])
            axes.errorbar(
                at[:1], at[1:], xerr=reach[0], yerr=reach[1], color=colour, label=name, elinewidth=0.8, capsize=2,
                fmt=MARKERS[k // len(palette.lines) % len(MARKERS)], markersize=4,
            )  # fmt: skip
        axes.set_xlabel(heads[kinds[0]])
        if len(kinds) > 1:
            axes.set_ylabel(heads[kinds[1]])
            axes.set_ylim(bottom=0)
        else:
            axes.set_yticks([])
            axes.set_ylim(-0.6, len(names) - 0.2)
        axes.set_xlim(left=0)
        if len(names) > 1:
            axes.legend(loc="best", fontsize=6, frameon=False, ncols=1 + len(names) // 12)

    about = f"{' and '.join(heads[kind] for kind in kinds)} of every method, with 95 % intervals; nearer 0 is better."
    return plotted(draw, about)


def _reach(distance: Distance) -> Any:
    if distance.interval is None:
        return None
    low, high = distance.interval
    return np.array([[max(distance.value - low, 0)], [max(high - distance.value, 0)]])


def sheets(found: Measured) -> Iterator[Figure]:
    """Of the reference and each method: the middle one of its clips."""
    for side in (found.reference, *found.methods.values()):
        frames, moving = side.shown
        what = "frames" + (" and the flow between them" if moving else "")
        yield Figure(sheet(frames, moving), f"{side.name}: {what}, {side.which}")


def sheet(frames: tuple[U8, ...], moving: tuple[U8, ...]) -> bytes:
    """A row of frames and, between them below, their flow; PNG."""
    small = [[_small(picture) for picture in row] for row in (frames, moving) if row]
    wide = small[0][0].shape[1]
    page = np.full((len(small) * (TILE + GAP) - GAP, len(frames) * (wide + GAP) - GAP, 3), 255, np.uint8)
    for line, row in enumerate(small):
        shift = (wide + GAP) // 2 if line and len(row) < len(frames) else 0
        for k, picture in enumerate(row):
            top, left = line * (TILE + GAP), shift + k * (wide + GAP)
            page[top : top + TILE, left : left + wide] = picture[:, :wide]
    _, data = cv2.imencode(".png", page[..., ::-1])
    return bytes(data)


def _small(picture: U8) -> U8:
    height, width = picture.shape[:2]
    size = max(1, round(width * TILE / height)), TILE
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
