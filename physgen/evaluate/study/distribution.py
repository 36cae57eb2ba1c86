"""How often each score was given -> a bar a method, stacked from 1 to 5, as in the paper's appendix."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from physgen.evaluate.measure import Figure, plotted
from physgen.evaluate.study.questions import SCALE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.style import Palette


COLOURS = ("#b3491b", "#eba97c", "#dedede", "#8dbfe0", "#1f6fae")
"""From disagreement to agreement, told apart by colour-blind eyes and in grey by their order."""
INKS = ("#ffffff", "#1a1a1a", "#1a1a1a", "#1a1a1a", "#ffffff")
LEAST = 5.5
"""% of a bar that has room for its number."""
TALL, MARGIN = 11.0, 26.0
"""mm of a method, and of what is above and below all."""
LONGEST = 60
"""Letters of a name."""


def distribution(
    name: str, methods: Sequence[str], counts: Sequence[Sequence[int]], means: Sequence[float | None]
) -> Figure:
    """Of one question: `counts` of the scores 1 to 5 by method, and their means."""
    about = (
        f"Distribution of {name} scores by method, from 1, strongly disagree, to 5, strongly agree. The table below "
        "has the numbers."
    )

    def draw(axes: Axes, palette: Palette) -> None:
        for row, (method, count, mean) in enumerate(zip(methods, counts, means, strict=True)):
            whole, left = max(sum(count), 1), 0.0
            for score, n in enumerate(count):
                share = 100 * n / whole
                axes.barh(-row, share, 0.5, left=left, color=COLOURS[score], linewidth=0)
                if share >= LEAST:
                    axes.text(
                        left + share / 2, -row, f"{share:.0f} %",
                        ha="center", va="center", color=INKS[score], fontsize=6.5,
                    )  # fmt: skip
                left += share
            axes.text(0, 0.31 - row, _cut(method), ha="left", va="bottom", weight="bold")
            if mean is not None:
                axes.text(100, 0.31 - row, f"mean {mean:.2f}", ha="right", va="bottom")
        key = [axes.barh(0, 0, color=colour, label=f"{k + 1} {SCALE[k]}") for k, colour in enumerate(COLOURS)]
        axes.legend(
            handles=key, loc="upper center", bbox_to_anchor=(0.5, 1.02), ncol=5,
            handlelength=1.0, columnspacing=1.1, borderaxespad=0,
        )  # fmt: skip
        axes.set_xlim(0, 100)
        axes.set_ylim(-len(methods) + 0.6, 0.75 + 8 / TALL)
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        axes.set_xlabel(f"{name}: share of all answers, %")

    return plotted(draw, about, height=MARGIN + TALL * len(methods))


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
