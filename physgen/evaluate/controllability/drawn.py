"""Pushes and answers -> plots: a fan of paths over the photo, and how far each push takes the object."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physgen.evaluate.controllability.answers import Answers, answers
from physgen.evaluate.controllability.sweep import Swept
from physgen.evaluate.measure import Figure, plotted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.style import Palette


SHORT, PALE = 400, 0.55
"""px of the photo's longer side at most, and how much of it is left under the paths."""
LEGEND = 8
"""Directions that a legend names."""


def plots(swept: Swept) -> tuple[Figure, Figure]:
    """For the page."""
    found = answers(swept)
    return fan(swept, found), reach(swept, found)


def _colours(found: Answers) -> list[tuple[float, ...]]:
    """One a direction, round the colour circle as the directions go round; legible on white and on photos."""
    import matplotlib

    wheel = matplotlib.colormaps["hsv"]
    return [tuple(0.8 * c for c in wheel(one.angle / 360)[:3]) for one in found.along]


def fan(swept: Swept, found: Answers) -> Figure:
    """All paths; a dot ends each, a ring where it met somebody."""
    every = np.concatenate([one.path.places for one in swept.outcomes])
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.04 * float((high - low).max()) + 1
    low, high = low - margin, high + margin
    frame = np.array([-0.5, -0.5]), np.array([-0.5, -0.5])
    if swept.photo is not None:
        frame = frame[0], np.array(swept.photo.shape[1::-1]) - 0.5
        low, high = np.minimum(low, frame[0]), np.maximum(high, frame[1])

    def draw(axes: Axes, palette: Palette) -> None:
        if swept.photo is not None:
            step = max(1, -(-max(swept.photo.shape[:2]) // SHORT))
            small = swept.photo[::step, ::step].astype(np.float32) / 255
            axes.imshow(
                1 - PALE * (1 - small), extent=(frame[0][0], frame[1][0], frame[1][1], frame[0][1]), zorder=0
            )
        for one, colour in zip(found.along, _colours(found), strict=True):
            for k, each in enumerate(one.outcomes):
                strong = (k + 1) / len(one.outcomes)
                axes.plot(*each.path.places.T, color=colour, linewidth=0.6 + 0.7 * strong, zorder=2)
                axes.plot(*each.path.places[-1], "o", color=colour, markersize=2 + 1.6 * strong, zorder=3)
                if each.met:
                    where = each.path.places[each.path.free - 1]
                    axes.plot(*where, "o", markersize=3.5, mfc="none", mec=palette.ink, mew=0.5, zorder=4)
        axes.plot(*swept.outcomes[0].path.places[0], "+", color=palette.ink, markersize=7, zorder=5)
        axes.set(
            xlim=(low[0], high[0]), ylim=(high[1], low[1]), xlabel="x (px)", ylabel="y (px)", aspect="equal"
        )

    rings = "; a ring is where it first met somebody" if any(one.met for one in swept.outcomes) else ""
    about = (
        f"Paths of {swept.object} after each push, a colour a direction, thicker for harder pushes; a dot is where it "
        f"ends{rings}."
    )
    width, height = high - low
    return plotted(draw, about, 120, float(np.clip(120 * height / width, 60, 150)))


def reach(swept: Swept, found: Answers) -> Figure:
    """Length of the answer over the size of the push, with the closed form where there is one."""

    def draw(axes: Axes, palette: Palette) -> None:
        most = max(one.push.size for one in swept.outcomes)
        for one, colour in zip(found.along, _colours(found), strict=True):
            sizes, lengths = [o.push.size for o in one.outcomes], [o.length for o in one.outcomes]
            label = f"{one.angle:g}°" if len(found.along) <= LEGEND else None
            axes.plot(
                sizes, lengths, "o-", color=colour, markersize=2.5, linewidth=0.7, label=label, zorder=3
            )
        if swept.law is not None:
            lasts = float(swept.outcomes[0].path.times[-1])
            grid = np.linspace(0, most, 100)
            exact = [swept.law.way(float(v), lasts) for v in grid]
            axes.plot(
                grid, exact, color=palette.ink, linewidth=1.6, alpha=0.35, label="closed form", zorder=1
            )
        axes.set(xlabel="push: impulse / mass (px/s)", ylabel="answer (px)", xlim=(0, 1.05 * most))
        axes.set_ylim(bottom=0)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper left", ncols=2)

    law = f" The closed form: {swept.law.formula}." if swept.law is not None else ""
    return plotted(draw, f"How far each push takes {swept.object}, a colour a direction.{law}", 120, 75)
