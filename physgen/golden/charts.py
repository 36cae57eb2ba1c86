"""How far objects are from where they were -> charts over time and the ways they went, as coordinates for SVG."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, log10
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.golden.moved import MEASURES, SLACK, Moved

Array = NDArray[np.float64]

WIDTH, HEIGHT = 720, 230
LEFT, RIGHT, TOP, BOTTOM = 64, 14, 12, 30
"""px of a chart and its margins."""
MOST_LINES = 10
"""As many as there are colours."""
NAMES = {
    "px": "Away from where it was",
    "degrees": "Turned otherwise",
    "px_per_s": "Velocity",
    "degrees_per_s": "Spin",
}
MARGIN = 0.08
"""Of the larger side of a box around ways."""


@dataclass(frozen=True)
class Chart:
    """One measure over time, on a logarithmic scale."""

    title: str
    unit: str
    lines: tuple[tuple[int, str, str], ...]
    """Colour, name and points of each object."""
    ups: tuple[tuple[str, float], ...]
    """Labels of the scale, and where they stand."""
    acrosses: tuple[tuple[str, float], ...]
    allowed: tuple[str, float]
    first: tuple[str, float]
    """The time at which the first object strays."""


def shown(moved: Moved) -> list[str]:
    """The objects that are drawn, the first to stray first: those that stray farthest."""
    far = sorted(moved.strayed, key=lambda item: -moved.excess[:, moved.names.index(item.name)].max())[
        :MOST_LINES
    ]
    return [item.name for item in moved.strayed if item in far]


def charts(moved: Moved) -> list[Chart]:
    """One for each measure of which more is apart somewhere than is allowed."""
    names = shown(moved)
    over = [name for name in moved.apart if moved.most(name) > getattr(moved.allowed, name) * SLACK]
    return [_chart(moved, measure, names) for measure in over]


def _chart(moved: Moved, measure: str, names: list[str]) -> Chart:
    apart, allowed = moved.apart[measure], float(getattr(moved.allowed, measure))
    low, high = floor(log10(allowed)) - 1, max(ceil(log10(moved.most(measure))), floor(log10(allowed)) + 1)
    times = moved.times
    end = float(times[-1]) or 1.0

    def up(value: Array | float) -> Any:
        share = (np.log10(np.maximum(value, 10.0**low)) - low) / (high - low)
        return np.round(TOP + (1 - share) * (HEIGHT - TOP - BOTTOM), 1)

    def across(time: Array | float) -> Any:
        return np.round(LEFT + np.asarray(time) / end * (WIDTH - LEFT - RIGHT), 1)

    step = max(1, ceil((high - low) / 5))
    lines = [
        (
            k,
            name,
            " ".join(
                f"{x},{y}" for x, y in zip(across(times), up(apart[:, moved.names.index(name)]), strict=True)
            ),
        )
        for k, name in enumerate(names)
    ]
    begins = moved.strayed[0].time
    return Chart(
        NAMES[measure],
        MEASURES[measure].strip(),
        tuple(lines),
        tuple((f"{10.0**power:g}", float(up(10.0**power))) for power in range(low, high + 1, step)),
        tuple((f"{time:g}", float(across(time))) for time in _round_times(end)),
        (f"{allowed:g}", float(up(allowed))),
        (f"{begins:.3f}", float(across(begins))),
    )


def _round_times(end: float) -> list[float]:
    """About five from 0 on."""
    rough = end / 5
    power = 10.0 ** floor(log10(rough))
    step = next(power * k for k in (1, 2, 5, 10) if power * k >= rough * 0.999)
    return [round(k * step, 9) for k in range(int(end / step + 1e-9) + 1)]


@dataclass(frozen=True)
class Ways:
    """Where objects went, then and now, px of the photo."""

    box: tuple[float, float, float, float]
    """x, y, width, height."""
    unit: float
    """px: what a hundredth of the picture is."""
    lines: tuple[tuple[int, str, str, str], ...]
    """Colour, name, and the points of both ways."""


def ways(moved: Moved, size: tuple[int, int] | None) -> Ways | None:
    """On the whole canvas where its `size`, px, is given, else around the ways; None where nothing went elsewhere."""
    names = shown(moved)
    if not names or moved.most("px") <= moved.allowed.px * SLACK:
        return None
    both = [
        tuple(track.places[:, track.names.index(name)] for track in (moved.then, moved.now)) for name in names
    ]
    if size is not None:
        box = -0.5, -0.5, float(size[0]), float(size[1])
    else:
        spots = np.concatenate([way for ways in both for way in ways])
        low, high = spots.min(axis=0), spots.max(axis=0)
        margin = MARGIN * max(float((high - low).max()), 20.0)
        x, y, width, height = (round(float(v), 1) for v in (*(low - margin), *(high - low + 2 * margin)))
        box = x, y, width, height
    lines = tuple(
        (k, name, _points(then), _points(now))
        for k, (name, (then, now)) in enumerate(zip(names, both, strict=True))
    )
    return Ways(box, round(max(box[2:]) / 100, 3), lines)


def _points(way: Array) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in way)
