"""A verdict -> plots of where things were, and how fast, with what is called wrong marked where it happens."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physgen.evaluate.measure import Figure, plotted
from physgen.evaluate.plausibility.judge import Verdict
from physgen.report.plots.style import RED, SMALL, Palette, stroke

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MOST = 5
"""Marks: more would lie over each other."""
NAMED = 10
"""Things, at most, that are named in the plot."""
HEIGHT = 95.0
"""mm."""


def paths(verdict: Verdict) -> Figure:
    """px, y downwards as in the picture; dots are frames."""
    faults = verdict.faults()[:MOST]
    told = ", ".join(f"{k + 1}: {e.text}" for k, (_, e) in enumerate(faults))
    about = f"Ways of {verdict.tracks.name}, a dot a frame, px. " + (
        f"Called wrong: {told}." if told else "Nothing is wrong."
    )
    return plotted(lambda axes, palette: _draw(axes, palette, verdict), about, height=HEIGHT)


def _draw(axes: Axes, palette: Palette, verdict: Verdict) -> None:
    tracks = verdict.tracks
    low, high = np.nanmin(tracks.places[..., 0]), np.nanmax(tracks.places[..., 0])
    for k, name in enumerate(tracks.names):
        colour, dashes = stroke(k, palette)
        x, y = tracks.places[:, k].T
        axes.plot(x, y, color=colour, linestyle=dashes, linewidth=0.7)
        axes.plot(x, y, ".", color=colour, markersize=2.2)
        seen = np.flatnonzero(np.isfinite(x))
        if len(seen) and len(tracks.names) <= NAMED:
            inwards = x[seen[0]] > low + 0.7 * (high - low)  # to the right of it a name would be cut off
            axes.annotate(
                name,
                (x[seen[0]], y[seen[0]]),
                (-3 if inwards else 3, 3),
                textcoords="offset points",
                ha="right" if inwards else "left",
                fontsize=SMALL,
                color=colour,
            )
    for number, (_, evidence) in enumerate(verdict.faults()[:MOST], 1):
        at = tracks.places[min(evidence.frame, len(tracks.times) - 1), list(evidence.things)]
        at = at[np.isfinite(at).all(axis=1)]
        if not len(at):
            continue
        x, y = at.mean(axis=0)
        axes.plot(
            [x],
            [y],
            "o",
            markersize=11,
            markerfacecolor="none",
            markeredgecolor=RED,
            markeredgewidth=1.2,
        )
        axes.annotate(str(number), (x, y), (8, 6), textcoords="offset points", color=RED, fontweight="bold")
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    axes.set_xlabel("x, px")
    axes.set_ylabel("y, px")


def speeds(verdict: Verdict) -> Figure:
    """Of what is called wrong: where that is its fall, its velocity downwards, of which gravity makes a slope; else its
    speed.
    """
    faults = verdict.faults()[:MOST]
    things = list(dict.fromkeys(k for _, evidence in faults for k in evidence.things))[:NAMED]
    down = bool(faults) and faults[0][0] == "gravity"
    what = "Velocity downwards" if down else "Speed"
    law = "All that flies has one slope; a blow is a step." if down else "A blow is a step, a jump a peak."
    about = f"{what} of what is called wrong, from frame to frame. {law}"

    def draw(axes: Axes, palette: Palette) -> None:
        tracks = verdict.tracks
        velocity = np.diff(tracks.places, axis=0) / tracks.step
        middle = (tracks.times[1:] + tracks.times[:-1]) / 2
        for k in things:
            colour, dashes = stroke(k, palette)
            value = velocity[:, k, 1] if down else np.hypot(velocity[:, k, 0], velocity[:, k, 1])
            axes.plot(middle, value, color=colour, linestyle=dashes, linewidth=0.7, label=tracks.names[k])
            axes.plot(middle, value, ".", color=colour, markersize=2.2)
        for number, (_, evidence) in enumerate(faults, 1):
            time = tracks.times[min(evidence.frame, len(tracks.times) - 1)]
            axes.axvline(time, color=RED, linewidth=0.7)
            axes.annotate(
                str(number),
                (time, 1 - 0.06 * number),
                (2, 0),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                color=RED,
                fontweight="bold",
            )
        axes.set_xlabel("time, s")
        axes.set_ylabel(f"{what.lower()}, px/s")
        axes.legend(fontsize=SMALL, frameon=False, loc="best")

    return plotted(draw, about)
