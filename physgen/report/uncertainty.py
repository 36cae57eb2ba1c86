"""The report section on uncertain numbers: paths and shares and outcomes of all draws."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.report.html import fitted, jpeg
from physgen.simulate.uncertainty import VERBS, Ensemble, Fate, Verdict, headline, percent

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]


@dataclass(frozen=True)
class SectionLimits:
    """What the section shows at most."""

    widest: int = 1000
    quality: int = 80
    """px of the photo below the paths, and of its JPEG."""
    most_draws: int = 64
    most_points: int = 100_000
    """Draws whose paths are drawn, and points of all paths; further draws are left out."""
    most_groups: int = 24
    """Groups of objects with sentences; the tables have all."""
    path_error: float = 0.25
    """px of a canvas 640 px wide by which a drawn path may deviate."""
    visible: float = 0.01
    """Of the canvas's longer side: shorter paths are not drawn."""


LIMITS = SectionLimits()

PLURAL = {Fate.STAYS: "stay", Fate.MOVES: "move", Fate.LEAVES: "leave the photo", Fate.FALLS: "fall"}
UncertaintySection = dict[str, Any]
"""Variables of `fan.html.j2`."""


def uncertainty_section(fan: Ensemble, found: Sequence[Verdict], world: World) -> UncertaintySection:
    """`found` are the ensemble's verdicts.

    `ways` are paths of bodies in draws, `own` those in the clip, `groups` bodies with equal sentences, `alike` those
    with a certain outcome, `rows` the table.
    """
    shown = fan.whole[
        : max(2, min(LIMITS.most_draws, LIMITS.most_points // (len(fan.times) * max(len(fan.names), 1))))
    ]
    ways = _paths(fan, shown, world)
    groups, alike = _groups(found)
    fates = {way["fate"] for way in ways}
    marks = []
    for one in groups:
        for name in one["names"]:
            x, y, _ = fan.own_poses[0, fan.names.index(name)].tolist()
            marks.append({"number": one["number"], "x": f"{x:.1f}", "y": f"{y:.1f}"})
    return {
        "headline": headline(fan, found),
        "facts": _facts(fan),
        "ways": ways,
        "own": [d for b in range(len(fan.names)) if (d := _path(fan.own_poses[:, b, :2], world))],
        "marks": marks,
        "faint": round(float(np.clip(2.4 / np.sqrt(max(len(shown), 1)), 0.28, 0.85)), 2),
        "shown": len(shown),
        "fates": [(f.name.lower(), VERBS[f]) for f in sorted(Fate, reverse=True) if f.name.lower() in fates],
        "groups": groups,
        "alike": alike,
        "rows": [_row(verdict) for verdict in found],
        "failures": [str(problem) for problem in fan.failures],
    }


def dimmed_photo(rgb: U8) -> str:
    """The photo `(H, W, 3)` sRGB below the paths, as a data URI."""
    return jpeg(fitted(rgb, LIMITS.widest), LIMITS.quality)


def _facts(fan: Ensemble) -> str:
    draws, what = len(fan.outcomes), len(fan.doubts)
    drawn = f"{what} number{'s' * (what != 1)}"
    lost = draws - len(fan.whole)
    failed = f"; {lost} could not be simulated" if lost else ""
    return (
        f"{draws} draws (seed {fan.seed}) of {drawn}, each as wide as its source is unsure, each simulated{failed}. "
        "All other numbers are kept, velocities and pushes included."
    )


def _paths(fan: Ensemble, shown: Sequence[int], world: World) -> list[dict[str, Any]]:
    """Paths of rare fates last, so that they stay visible."""
    found = []
    for k in shown:
        one = fan.outcomes[k]
        assert one is not None
        for b in range(len(fan.names)):
            if d := _path(fan.poses[k, :, b, :2], world):
                found.append({"fate": Fate(int(one.fates[b])).name.lower(), "d": d})
    count = Counter(way["fate"] for way in found)
    return sorted(found, key=lambda way: -count[way["fate"]])


def _path(points: Array, world: World) -> str:
    """Path data with no more corners than are visible; empty where the body hardly moves."""
    if np.hypot(*np.ptp(points, axis=0)) < LIMITS.visible * max(world.size):
        return ""
    error = LIMITS.path_error * max(world.size) / 640
    kept = cv2.approxPolyDP(np.ascontiguousarray(points, np.float32)[:, None], error, False)[:, 0]
    return _path_data(kept if len(kept) > 1 else points[[0, -1]])


def _path_data(points: NDArray[Any]) -> str:
    return "M" + " ".join(f"{x:.1f},{y:.1f}" for x, y in points.tolist())


def _groups(found: Sequence[Verdict]) -> tuple[list[dict[str, Any]], list[tuple[str, Sequence[str]]]]:
    """Uncertain bodies first, then certain ones, equal outcomes in one line."""
    apart = [v for v in found if not (v.decided and v.placed)]
    apart.sort(key=lambda v: (v.decided, abs(v.share - 0.5), -v.radius / v.size))
    groups: dict[Fate, list[str]] = {}
    for v in found:
        if v.decided and v.placed:
            groups.setdefault(v.event, []).append(v.name)
    same: dict[tuple[str, ...], list[Verdict]] = {}
    for v in apart:
        same.setdefault(tuple(v.sentences()), []).append(v)
    found_groups: list[dict[str, Any]] = [
        {"number": n, "names": [v.name for v in found if v in those], "lines": lines}
        for n, (lines, those) in enumerate(list(same.items())[: LIMITS.most_groups], 1)
    ]
    alike: list[tuple[str, Sequence[str]]] = []
    for fate in sorted(groups, reverse=True):
        names = groups[fate]
        total = found[0].total
        verb = PLURAL[fate] if len(names) > 1 else VERBS[fate]
        place = "" if fate is Fate.STAYS else ", with a certain final place"
        alike.append((f"{verb} in all {total} draws{place}", names))
    return found_groups, alike


def _row(v: Verdict) -> dict[str, Any]:
    return {
        "name": v.name,
        "counts": [v.counts[fate] for fate in sorted(Fate, reverse=True)],
        "interval": f"{percent(v.interval[0])} to {percent(v.interval[1])}",
        "event": VERBS[v.event],
        "radius": f"{v.radius:.3g}",
        "size": f"{v.size:.3g}",
        "clip": VERBS[v.own],
    }
