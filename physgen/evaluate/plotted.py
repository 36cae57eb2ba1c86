"""A function that draws on axes -> a figure of a page, in the look of `physgen plot`. Needs the extra `plots`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from physgen.evaluate.findings import Figure
from physgen.report.plots.style import (
    MM,
    Palette,
    PlotStyle,
    add_axes,
    figure_bytes,
    new_figure,
    plot_settings,
    require_matplotlib,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


WIDTH, HEIGHT = 150.0, 75.0
"""mm."""
LEFT, RIGHT, BELOW, ABOVE = 15.0, 4.0, 11.0, 4.0
"""mm around the axes."""


def plotted(
    draw: Callable[[Axes, Palette], None], about: str, width: float = WIDTH, height: float = HEIGHT
) -> Figure:
    """As SVG, `width` by `height` mm, the same bytes on every run; `draw` has the axes and the colours.

    Raises InputError where matplotlib is not installed: call `plots.look.needed` before what takes long.
    """
    require_matplotlib()
    look = PlotStyle()
    with plot_settings(look):
        figure = new_figure(look, width / MM, height / MM)
        place = (LEFT, BELOW, width - LEFT - RIGHT, height - BELOW - ABOVE)
        draw(add_axes(figure, *(side / MM for side in place)), look.palette)
    return Figure(figure_bytes(figure, "svg", about, look).decode(), about)
