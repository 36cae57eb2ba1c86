"""The report section on uncertain numbers: paths and outcomes of all draws."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.report.html import U8, fit_to_side, webp
from physgen.simulate.uncertainty import (
    VERBS,
    Ensemble,
    Fate,
    Verdict,
    headline,
    percent,
)
from physgen.text import rounded

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SectionLimits:
    """Maximum sizes of the section."""

    widest: int = 1000
    quality: int = 80
    """Width of the photo below the paths, px, and quality of its WebP."""
    most_draws: int = 64
    most_points: int = 100_000
    """Maximum number of draws with paths, and of points of all paths."""
    path_error: float = 0.25
    """Maximum deviation of a drawn path, px of a canvas 640 px wide."""
    visible: float = 0.01
    """Minimum length of a visible path over the canvas's longer side."""


LIMITS = SectionLimits()


def uncertainty_section(
    fan: Ensemble, verdicts: Sequence[Verdict], world: World, first: U8
) -> dict[str, Any]:
    """Return the section on uncertainty; `verdicts` are the ensemble's verdicts.

    `ways` are paths of bodies in draws, `own` the paths in the clip, `rows` the table.
    """
    # The page must stay quick with many objects.
    points = len(fan.times) * max(len(fan.names), 1)
    shown = fan.complete_draws[
        : max(2, min(LIMITS.most_draws, LIMITS.most_points // points))
    ]
    ways = _paths(fan, shown, world)
    fates = {way["fate"] for way in ways}
    return {
        "headline": headline(fan, verdicts),
        "photo": webp(fit_to_side(first, LIMITS.widest), LIMITS.quality),
        "facts": _facts(fan),
        "ways": ways,
        "own": [
            d
            for b in range(len(fan.names))
            if (d := _path(fan.own_poses[:, b, :2], world))
        ],
        "shown": len(shown),
        "fates": [
            (f.name.lower(), VERBS[f])
            for f in sorted(Fate, reverse=True)
            if f.name.lower() in fates
        ],
        "rows": list(map(_row, verdicts)),
        "failures": list(map(str, fan.failures)),
    }


def _facts(fan: Ensemble) -> str:
    draws, number_count = len(fan.outcomes), len(fan.doubts)
    number_text = f"{number_count} number{'s' * (number_count != 1)}"
    failure_count = draws - len(fan.complete_draws)
    failure_note = ""
    if failure_count:
        failure_note = f"; {failure_count} could not be simulated"
    return (
        f"{draws} draws (seed {fan.seed}) of {number_text}, each as wide as its source is unsure, "
        f"each simulated{failure_note}. "
        "All other numbers are kept, velocities and pushes included."
    )


def _paths(fan: Ensemble, draws: Sequence[int], world: World) -> list[dict[str, Any]]:
    """Return the paths. Rare fates come last, so that they stay visible."""
    found = []
    for k in draws:
        path = fan.outcomes[k]
        assert path is not None
        for b in range(len(fan.names)):
            if d := _path(fan.poses[k, :, b, :2], world):
                found.append({"fate": Fate(int(path.fates[b])).name.lower(), "d": d})
    count = Counter(way["fate"] for way in found)
    return sorted(found, key=lambda way: -count[way["fate"]])


def _path(points: Array, world: World) -> str:
    """Return path data with visible corners only, or "" if the body hardly moves."""
    # Resting bodies would only add dots.
    if np.hypot(*np.ptp(points, axis=0)) < LIMITS.visible * max(world.size):
        return ""
    # The page scales the canvas to its width, and the deviation with it.
    error = LIMITS.path_error * max(world.size) / 640
    # Douglas and Peucker's algorithm removes points within this distance of the path.
    kept = cv2.approxPolyDP(
        np.ascontiguousarray(points, np.float32)[:, None], error, False
    )[:, 0]
    if len(kept) > 1:
        corners = kept.tolist()
    else:
        corners = points[[0, -1]].tolist()
    return "M" + " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)


def _row(v: Verdict) -> dict[str, Any]:
    return {
        "name": v.name,
        "counts": [v.counts[fate] for fate in sorted(Fate, reverse=True)],
        "interval": f"{percent(v.interval[0])} to {percent(v.interval[1])}",
        "event": VERBS[v.event],
        "radius": rounded(v.radius),
        "size": rounded(v.size),
        "clip": VERBS[v.clip_fate],
    }
