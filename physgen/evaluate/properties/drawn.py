"""True numbers and told ones -> plots for the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import log10
from typing import TYPE_CHECKING

from physgen.evaluate.measure import Figure, plotted
from physgen.evaluate.properties.answers import Answer
from physgen.evaluate.properties.scores import NEAR, factor
from physgen.evaluate.properties.table import Ranking

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.style import Palette


NAMED = 7
"""Of the points farthest off, so many are named, where there is room."""
WIDE = 100
"""Times the least mass that the largest may be for the numbers 2 and 5 to have room between those of tens."""


def mass_plot(sets: Mapping[str, Sequence[tuple[str, float, float]]]) -> Figure:
    """`sets` by title: name, true g, told g. Both axes are logarithmic; the band holds what is within 30 %."""

    def draw(axes: Axes, palette: Palette) -> None:
        from matplotlib.ticker import LogLocator, NullFormatter

        every = [number for rows in sets.values() for _, true, told in rows for number in (true, told)]
        low, high = min(every) / 1.6, max(every) * 1.6
        axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high))
        axes.fill_between(
            [low, high], [(1 - NEAR) * low, (1 - NEAR) * high], [(1 + NEAR) * low, (1 + NEAR) * high],
            color=palette.faint, alpha=0.7, linewidth=0, zorder=1,
        )  # fmt: skip
        axes.plot([low, high], [low, high], color=palette.soft, linewidth=0.7, zorder=2)
        colours = (palette.blue, palette.orange, palette.green)
        marks = ("o", "^", "s")
        for (title, rows), colour, mark in zip(sets.items(), colours, marks, strict=False):
            axes.scatter(
                [row[1] for row in rows],
                [row[2] for row in rows],
                s=11,
                color=colour,
                marker=mark,
                linewidths=0,
                alpha=0.85,
                label=title,
                zorder=3,
            )
        near: list[tuple[float, float]] = []
        for name, true, told in sorted(
            (row for rows in sets.values() for row in rows), key=lambda row: -factor(row[1], row[2])
        ):
            at = log10(true), log10(told)
            if len(near) == NAMED or any(abs(at[0] - x) < 0.7 and abs(at[1] - y) < 0.1 for x, y in near):
                continue
            near.append(at)
            axes.annotate(
                name,
                (true, told),
                (4, 1),
                textcoords="offset points",
                fontsize=5.5,
                va="center",
                color=palette.ink,
            )
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1,) if high / low > WIDE else (1, 2, 5)))
            axis.set_major_formatter(lambda value, _: f"{value:g}")
            axis.set_minor_formatter(NullFormatter())
        axes.set(xlabel="true mass (g)", ylabel="told mass (g)")
        axes.legend(loc="upper left")

    what = " and of ".join(sets)
    about = f"Masses of {what}, told over true; the band is within 30 %. Some of the farthest off are named."
    return plotted(draw, about, 110, 100)


def order_plot(ranking: Ranking, answers: Mapping[str, Answer]) -> Figure:
    """Told over true coefficients of one comparison: what rises from left to right is in order."""
    names = sorted(ranking.values, key=lambda name: ranking.values[name])
    told = [float(getattr(answers[name], ranking.of)) for name in names]

    def draw(axes: Axes, palette: Palette) -> None:
        true = [ranking.values[name] for name in names]
        axes.plot(range(len(names)), true, color=palette.soft, marker="o", markersize=3, label="measured")
        axes.plot(
            range(len(names)), told, color=palette.blue, marker="s", markersize=3, linewidth=0, label="told"
        )
        axes.set_xticks(
            range(len(names)), [name.replace("-", " ") for name in names], rotation=30, ha="right"
        )
        axes.set(ylabel=ranking.of, ylim=(0, max(*true, *told) * 1.1), xlim=(-0.4, len(names) - 0.6))
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
        axes.set_position((0.14, 0.34, 0.83, 0.56))  # names need room

    source = f" ({ranking.source})" if ranking.source else ""
    about = f"{ranking.of.capitalize()}, {ranking.about}: measured{source}, and told. Only the order counts."
    return plotted(draw, about, 110, 62)
