"""The report section on uncertain numbers: paths and final places of all draws, shares and tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.report.html import jpeg
from physgen.simulate.uncertain_values import UncertainValue
from physgen.simulate.uncertainty import Ensemble, Fate
from physgen.simulate.uncertainty_summary import VERBS, ShadowSpread, Verdict, headline, percent

# ----------------------------------------------------------------------
# Numbers that are drawn -> one sentence's worth of which, with their values, and whose guesses they are.

MOST_GUESSES = 6
"""Numbers that are named as guesses above the picture; the table has all."""


def guesses(doubts: Sequence[UncertainValue]) -> str:
    """Which numbers are drawn; those that are alike once. No file tells which was edited since it was guessed."""
    said: dict[tuple[object, ...], list[UncertainValue]] = {}
    for doubt in doubts:
        kind = (doubt.label or doubt.thing, doubt.parameter, doubt.value, doubt.source)
        said.setdefault(kind, []).append(doubt)
    named = []
    for first, *others in said.values():
        whose = f"of all {1 + len(others)} called “{first.label}”" if others else f"of {first.thing}"
        sure = f", {percent(first.source.sure)} sure" if first.source.sure is not None else ""
        named.append(f"{first.parameter} {whose}, {first.value:.4g} ({first.source.text}{sure})")
    shown, more = named[:MOST_GUESSES], len(named) - MOST_GUESSES
    return "; ".join([*shown, f"{more} more" if more > 0 else ""]).removesuffix("; ")


# ----------------------------------------------------------------------
# Fan -> the section of the report: ways and ends drawn over the photo, shares, sentences, tables.

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]

WIDEST = 1000
"""px of the picture below."""
QUALITY = 80
"""Of its JPEG."""
MOST_WAYS = 64
"""Draws whose ways are drawn."""
MOST_POINTS = 100_000
"""Of all ways together, before those that nobody sees are left out; then fewer draws are shown."""
MOST_ENDS = 1500
"""Outlines at the end; then fewer draws show theirs."""
MOST_TOLD = 24
"""Different things that are said of bodies; the tables have all."""
FINE = 0.25
"""px of a canvas 640 px wide by which a drawn way may be off."""
TELLING = 0.01
"""Of the canvas's longer side: what moves less than that has no way that could be seen."""
Z90 = 1.6448536269514722
"""Of the normal distribution: 9 of 10 draws are within."""
PLURAL = {Fate.STAYS: "stay", Fate.MOVES: "move", Fate.LEAVES: "leave the photo", Fate.FALLS: "fall"}


@dataclass(frozen=True)
class UncertaintySection:
    """What the template shows."""

    headline: str
    facts: str
    guesses: str
    """Which numbers count as guesses, and as whose."""
    ways: Sequence[dict[str, Any]]
    """`fate`, `d`: of one body in one draw."""
    ends: Sequence[dict[str, Any]]
    """`fate`, `body`, `x`, `y`, `turn` degrees."""
    outlines: Sequence[dict[str, Any]]
    """`id`, `d`: of the bodies that `ends` show, in their own frames."""
    own: Sequence[str]
    """Ways in the clip, as path data."""
    marks: Sequence[dict[str, Any]]
    """`number`, `x`, `y`: of bodies of which there are sentences."""
    faint: float
    """Opacity of a way."""
    fill: float
    """Opacity of what an outline holds."""
    shown: int
    """Draws that are drawn."""
    fates: Sequence[tuple[str, str]]
    """Class and word of every fate that has a colour here."""
    told: Sequence[dict[str, Any]]
    """`number`, `names`, `bar`, `lines`: of bodies that the same is said of."""
    alike: Sequence[tuple[str, Sequence[str]]]
    """What many are decided to do, and who they are."""
    rows: Sequence[dict[str, Any]]
    """Of the table of outcomes."""
    drawn: Sequence[dict[str, Any]]
    """Of the table of distributions."""
    light: dict[str, Any] | None
    failures: Sequence[str]


def uncertainty_section(
    fan: Ensemble, found: Sequence[Verdict], lights: ShadowSpread | None, world: World
) -> UncertaintySection:
    """`found` are the fan's verdicts, `lights` what is told of its light."""
    shown = _shown(fan)
    ways, ends = _ways(fan, shown, world), _ends(fan, shown)
    used = sorted({end["body"] for end in ends})
    told, alike = _told(found)
    fates = {way["fate"] for way in ways} | {part["fate"] for one in told for part in one["bar"]["parts"]}
    return UncertaintySection(
        headline=headline(fan, found),
        facts=_facts(fan),
        guesses=guesses(fan.doubts),
        ways=ways,
        ends=ends,
        outlines=[{"id": b, "d": _rings(world, b)} for b in used],
        own=[d for b in range(len(fan.names)) if (d := _path(fan.own_poses[:, b, :2], world))],
        marks=[_mark(fan, one["number"], fan.names.index(name)) for one in told for name in one["names"]],
        faint=round(float(np.clip(2.4 / np.sqrt(max(len(shown), 1)), 0.28, 0.85)), 2),
        fill=round(min(0.5 / max(len(shown), 1), 0.1), 3),
        shown=len(shown),
        fates=[
            (fate.name.lower(), VERBS[fate])
            for fate in sorted(Fate, reverse=True)
            if fate.name.lower() in fates
        ],
        told=told,
        alike=alike,
        rows=[_row(v) for v in found],
        drawn=[_distribution(doubt) for doubt in fan.doubts],
        light=None if lights is None else _light(lights),
        failures=[str(problem) for problem in fan.failures],
    )


def dimmed_photo(rgb: U8) -> str:
    """A picture `(H, W, 3)` sRGB that others are drawn over, no wider than it is shown, as a data URI."""
    less = min(1.0, WIDEST / max(rgb.shape[:2]))
    shrunk = cv2.resize(rgb, None, fx=less, fy=less, interpolation=cv2.INTER_AREA)
    return jpeg(rgb if less == 1 else np.asarray(shrunk, np.uint8), QUALITY)


def _facts(fan: Ensemble) -> str:
    draws, what = len(fan.outcomes), len(fan.doubts)
    numbers = f"{what} number{'s' * (what != 1)}" if what else ""
    drawn = " and ".join(filter(None, (numbers, "the light's direction" if fan.light is not None else "")))
    lost = draws - len(fan.whole)
    failed = f"; {lost} could not be simulated" if lost else ""
    return (
        f"{draws} draws (seed {fan.seed}) of {drawn}, each as wide as its source is unsure, each simulated{failed}. "
        "All else is kept as it is, velocities and pushes too. Where no number is said to matter most, none stands out."
    )


def _shown(fan: Ensemble) -> list[int]:
    """Draws that are drawn: the first of those that could be simulated."""
    bodies = max(len(fan.names), 1)
    return fan.whole[: max(2, min(MOST_WAYS, MOST_POINTS // (len(fan.times) * bodies)))]


def _ways(fan: Ensemble, shown: Sequence[int], world: World) -> list[dict[str, Any]]:
    """Fates that are rarer than others last, so that nothing hides them."""
    found = []
    for k in shown:
        one = fan.outcomes[k]
        assert one is not None
        for b in range(len(fan.names)):
            if d := _path(fan.poses[k, :, b, :2], world):
                found.append({"fate": Fate(int(one.fates[b])).name.lower(), "d": d})
    often = Counter(way["fate"] for way in found)
    return sorted(found, key=lambda way: -often[way["fate"]])


def _ends(fan: Ensemble, shown: Sequence[int]) -> list[dict[str, Any]]:
    """Where bodies are at the end, of draws in which they do not stay."""
    fates = np.array([one.fates for k in shown if (one := fan.outcomes[k]) is not None])
    moved = np.flatnonzero((fates != Fate.STAYS).any(axis=0)).tolist() if len(fates) else []
    found = []
    for n, k in enumerate(shown[: max(1, MOST_ENDS // max(len(moved), 1))]):
        for b in moved:
            x, y, angle = fan.poses[k, -1, b].tolist()
            fate = Fate(int(fates[n, b]))
            if fate in (Fate.MOVES, Fate.FALLS):
                end = {"x": f"{x:.1f}", "y": f"{y:.1f}", "turn": f"{degrees(angle) % 360:.1f}"}
                found.append({"fate": fate.name.lower(), "body": b, **end})
    return found


def _path(points: Array, world: World) -> str:
    """Path data of a way, with no more corners than can be seen; "" where it goes nowhere."""
    if np.hypot(*np.ptp(points, axis=0)) < TELLING * max(world.size):
        return ""
    fine = FINE * max(world.size) / 640
    kept = cv2.approxPolyDP(np.ascontiguousarray(points, np.float32)[:, None], fine, False)[:, 0]
    if len(kept) < 2:
        kept = points[[0, -1]]
    return "M" + " ".join(f"{x:.1f},{y:.1f}" for x, y in kept.tolist())


def _rings(world: World, b: int) -> str:
    return " ".join(
        "M" + " ".join(f"{x:.1f},{y:.1f}" for x, y in ring) + "Z" for ring in world.bodies[b].rings
    )


def _mark(fan: Ensemble, number: int, b: int) -> dict[str, Any]:
    """A body's number, where it stands at the start."""
    x, y, _ = fan.own_poses[0, b].tolist()
    return {"number": number, "x": f"{x:.1f}", "y": f"{y:.1f}"}


def _told(found: Sequence[Verdict]) -> tuple[list[dict[str, Any]], list[tuple[str, Sequence[str]]]]:
    """What is open first, then what is decided of things that move; those that are decided alike in one line."""
    apart = [v for v in found if not (v.decided and v.placed)]
    apart.sort(key=lambda v: (v.decided, abs(v.share - 0.5), -v.radius / v.size))
    groups: dict[Fate, list[str]] = {}
    for v in found:
        if v.decided and v.placed:
            groups.setdefault(v.event, []).append(v.name)
    same: dict[tuple[str, ...], list[Verdict]] = {}
    for v in apart:
        same.setdefault(tuple(v.sentences()), []).append(v)
    told: list[dict[str, Any]] = [
        {"number": n, "names": [v.name for v in found if v in those], "bar": _bar(those[0]), "lines": lines}
        for n, (lines, those) in enumerate(list(same.items())[:MOST_TOLD], 1)
    ]
    alike: list[tuple[str, Sequence[str]]] = []
    for fate in sorted(groups, reverse=True):
        names = groups[fate]
        total = found[0].total
        verb = PLURAL[fate] if len(names) > 1 else VERBS[fate]
        place = "" if fate is Fate.STAYS else ", and where is decided, too"
        alike.append((f"{verb} in all {total} draws{place}", names))
    return told, alike


def _bar(v: Verdict) -> dict[str, Any]:
    """Shares as parts of a bar, the counted event first, with its interval."""
    order = sorted((fate for fate in Fate if v.counts[fate]), key=lambda fate: -fate)
    parts = [
        {
            "fate": fate.name.lower(),
            "width": f"{100 * v.counts[fate] / v.total:.2f}",
        }
        for fate in order
    ]
    low, high = v.interval
    words = ", ".join(f"{VERBS[fate]} in {v.counts[fate]} of {v.total}" for fate in order)
    return {
        "parts": parts,
        "from": None if v.decided else f"{100 * low:.2f}",
        "wide": f"{100 * (high - low):.2f}",
        "words": words,
    }


def _row(v: Verdict) -> dict[str, Any]:
    touches = ", ".join(f"{name} {count}" for name, count in list(v.touches.items())[:4])
    return {
        "name": v.name,
        "counts": [v.counts[fate] for fate in sorted(Fate, reverse=True)],
        "interval": f"{percent(v.interval[0])} to {percent(v.interval[1])}",
        "event": VERBS[v.event],
        "radius": f"{v.radius:.3g}",
        "size": f"{v.size:.3g}",
        "parted": "never" if np.isinf(v.parted) else f"{v.parted:.2f} s",
        "rests": v.rests,
        "touches": touches + (" ..." if len(v.touches) > 4 else ""),
        "clip": VERBS[v.own],
    }


def _distribution(doubt: UncertainValue) -> dict[str, Any]:
    return {
        "path": doubt.path,
        "value": f"{doubt.value:.4g}",
        "source": doubt.source,
        "low": f"{doubt.spread.at(-Z90):.3g}",
        "high": f"{doubt.spread.at(Z90):.3g}",
        "family": doubt.spread.name,
    }


STICK = 46.0
"""Units high of the thing that throws shadows in the picture of the light."""
LONGEST = 3.4
"""Times its height that a shadow is drawn, at most."""
BALL = 50.0
"""Units: radius of the ball beside it."""


def _light(lights: ShadowSpread) -> dict[str, Any]:
    """Shadows of an upright thing, and where a ball is brightest, in each draw."""

    def tip(reach: Array) -> tuple[str, str]:
        long = float(np.hypot(*reach))
        x, y = reach * STICK * min(1.0, LONGEST / max(long, 1e-9))
        return f"{x:.1f}", f"{y:.1f}"

    def spot(light: Array) -> dict[str, Any]:
        x, y, z = light.tolist()
        return {"x": f"{BALL * x:.1f}", "y": f"{BALL * y:.1f}", "behind": z < 0}

    drawn = lights.drawn[:MOST_WAYS]
    return {
        "lines": lights.sentences(),
        "stick": STICK,
        "ball": BALL,
        "tips": [tip(reach) for reach in drawn],
        "own": tip(lights.own),
        "spots": [spot(light) for light in lights.lights[:MOST_WAYS]],
        "own_spot": spot(lights.own_light),
        "faint": round(float(np.clip(2.2 / np.sqrt(len(drawn)), 0.25, 0.8)), 2),
    }
