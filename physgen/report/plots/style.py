"""The shared look of all figures: colours, type, units of axes, and saving with reproducible bytes."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import floor, log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physgen.files import write_atomic
from physgen.problems import InputError
from physgen.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# ----------------------------------------------------------------------
# How figures look: sizes, type, line widths, and colours that all eyes can tell apart.
#
# Text is 6 to 7.5 points, as journals ask; lines are thin; nothing is drawn that tells nothing.

MM = 25.4
"""An inch."""
DPI = 300.0
PALE = 0.45
FONT = "DejaVu Sans"
"""It comes with matplotlib: the same letters everywhere."""
OTHER_SCRIPTS = (
    "Noto Sans CJK JP",
    "Noto Sans CJK SC",
    "Noto Sans Devanagari",
    "Noto Sans Thai",
    "Noto Sans Bengali",
    "Noto Sans Tamil",
)
"""For names that the first has no letters for, where they are installed."""
TEXT, SMALL = 7.5, 6.5
"""pt."""
DASHES: tuple[Any, ...] = ("-", (0, (4.5, 1.6)), (0, (1.3, 1.3)), (0, (6, 1.4, 1.3, 1.4)))
"""Each goes round all colours once: together they tell 28 objects apart."""


@dataclass(frozen=True)
class Palette:
    """Colours after Okabe and Ito (2008), which are told apart by colour-blind eyes; lightened on dark paper."""

    paper: str
    ink: str
    soft: str
    """Of what stands back: frames, ticks' text is ink."""
    faint: str
    blue: str
    green: str
    orange: str
    purple: str
    lines: tuple[str, ...]
    """In the order in which objects take them."""


LIGHT = Palette(
    paper="#ffffff",
    ink="#1a1a1a",
    soft="#6b6b6b",
    faint="#d4d4d4",
    blue="#0072b2",
    green="#009e73",
    orange="#d55e00",
    purple="#a0478a",
    lines=("#0072b2", "#d55e00", "#009e73", "#b0508f", "#e69f00", "#3fa7dc", "#4d4d4d"),
)
DARK = Palette(
    paper="#14171b",
    ink="#eceef0",
    soft="#a4abb3",
    faint="#3a4047",
    blue="#58aee6",
    green="#3cc79b",
    orange="#f58a3c",
    purple="#dd93c4",
    lines=("#58aee6", "#f58a3c", "#3cc79b", "#dd93c4", "#f2c14e", "#9ad8f7", "#c9ced3"),
)
RED, HALO = "#e3001b", "#ffffff"
"""Of arrows on photos, as in the paper, and of the rim that keeps them legible on any."""


@dataclass(frozen=True)
class PlotStyle:
    """What a person may choose of a figure."""

    width: float | None = None
    """mm; None: as the kind of figure is best."""
    pixels: int | None = None
    """The same in px; at most one of the two is given."""
    dpi: float | None = None
    """px an inch of a PNG; None: 300, or as `pixels` asks, and in a strip so many that frames keep their own."""
    dark: bool = False
    si: bool = False
    """SI units alone; else those of the scene, with SI beside them where it has a scale."""

    @property
    def palette(self) -> Palette:
        """Its colours."""
        return DARK if self.dark else LIGHT

    def pale(self, colour: str) -> str:
        """A colour, half-way to the paper: what lies below does not shine through."""
        pairs = zip(_levels(colour), _levels(self.palette.paper), strict=True)
        return "#" + "".join(f"{round(PALE * one + (1 - PALE) * other):02x}" for one, other in pairs)

    def inches(self, best: float) -> float:
        """Of its width; `best` mm where nobody has chosen."""
        if self.pixels is not None and self.dpi is not None:
            return self.pixels / self.dpi
        return (self.width or best) / MM


def _levels(colour: str) -> list[int]:
    """Of `#rrggbb`."""
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]


def require_matplotlib() -> None:
    """Raises InputError where matplotlib is not installed: before anything is computed."""
    try:
        import matplotlib.figure  # noqa: F401
    except ModuleNotFoundError as error:
        missing = (error.name or "matplotlib").removesuffix(".figure")
        fix = 'pip install "physgen[plots]"'
        raise InputError.of("plot", "", f"needs {missing}, which is not installed", fix) from error


def stroke(k: int, palette: Palette) -> tuple[str, Any]:
    """Colour and dashes of the k-th object."""
    count = len(palette.lines)
    return palette.lines[k % count], DASHES[k // count % len(DASHES)]


@contextmanager
def plot_settings(look: PlotStyle) -> Iterator[None]:
    """Matplotlib with our settings and nobody's own, for a while."""
    import matplotlib
    from matplotlib import font_manager

    there = set(font_manager.get_font_names())
    ink, soft = look.palette.ink, look.palette.soft
    settings: dict[str, Any] = {
        "font.family": [FONT, *(name for name in OTHER_SCRIPTS if name in there)],
        "font.size": TEXT,
        "axes.titlesize": TEXT,
        "axes.labelsize": TEXT,
        "xtick.labelsize": SMALL,
        "ytick.labelsize": SMALL,
        "legend.fontsize": SMALL,
        "text.parse_math": False,  # a scene may be called $x$
        "text.color": ink,
        "axes.labelcolor": ink,
        "xtick.labelcolor": ink,
        "ytick.labelcolor": ink,
        "axes.edgecolor": soft,
        "xtick.color": soft,
        "ytick.color": soft,
        "axes.facecolor": "none",
        "figure.facecolor": look.palette.paper,
        "savefig.facecolor": look.palette.paper,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.linewidth": 0.6,
        "xtick.major.width": 0.6,
        "ytick.major.width": 0.6,
        "xtick.major.size": 2.6,
        "ytick.major.size": 2.6,
        "axes.labelpad": 3.0,
        "lines.linewidth": 1.1,
        "lines.solid_joinstyle": "round",
        "lines.solid_capstyle": "round",
        "lines.dash_capstyle": "butt",
        "lines.scale_dashes": True,
        "patch.linewidth": 0.6,
        "legend.frameon": False,
        "legend.handlelength": 2.2,
        "legend.columnspacing": 1.4,
        "legend.handletextpad": 0.6,
        "axes.formatter.useoffset": False,
        "axes.formatter.limits": (-4, 5),
        "axes.xmargin": 0.0,
        "pdf.fonttype": 42,  # TrueType, embedded: editors and publishers can work with it
        "svg.fonttype": "path",
        "svg.hashsalt": "physgen",  # the names inside an SVG are random otherwise
        "path.simplify": False,
        "image.composite_image": False,
        "image.resample": False,
    }
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(settings)
        yield


def new_figure(look: PlotStyle, width: float, height: float, dpi: float | None = None) -> Figure:
    """An empty figure, `width` and `height` in inches."""
    from matplotlib.figure import Figure

    asked = look.dpi or (look.pixels / width if look.pixels else DPI)
    return Figure(figsize=(width, height), dpi=dpi or asked)


def add_axes(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place in inches from the lower left."""
    across, up = figure.get_size_inches()
    axes = figure.add_axes((left / across, bottom / up, width / across, height / up))
    axes.patch.set_gid("area")  # as other parts have names, so that a program finds them in an SVG
    return axes


# ----------------------------------------------------------------------
# A figure -> its file: PNG, SVG or PDF, the same bytes on every run.

KINDS = (".png", ".svg", ".pdf")


def check_name(path: Path) -> None:
    """Raises InputError where no figure can go, before anything is computed."""
    if path.suffix.lower() not in KINDS or path.is_dir():
        raise InputError.of("-o", f'"{path}"', "is no name for a figure", "end it in .png, .svg or .pdf")


def write_figure(figure: Figure, path: Path, title: str, look: PlotStyle) -> None:
    """Whole or not at all; folders are created. Neither the time nor the machine gets in."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, figure_bytes(figure, path.suffix.lower()[1:], title, look))


def figure_bytes(figure: Figure, kind: str, title: str, look: PlotStyle) -> bytes:
    """As `png`, `svg` or `pdf`."""
    about = {
        "png": {"Title": title, "Software": "physgen"},
        "svg": {"Title": title, "Creator": "physgen", "Date": None},
        "pdf": {"Title": title, "Creator": "physgen", "Producer": "matplotlib", "CreationDate": None},
    }
    buffer = io.BytesIO()
    with plot_settings(look), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a box stands for it
        figure.savefig(buffer, format=kind, dpi=figure.dpi, metadata=about[kind])
    return buffer.getvalue()


# ----------------------------------------------------------------------
# px, s and g -> axes with units: the scene's own, SI beside them where the scene has a scale, or SI alone.

PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Quantity:
    """What an axis is of."""

    own: str
    """Its unit in scenes."""
    si: str
    grams: int
    """Powers in it, of mass and of length."""
    pixels: int

    def per(self, meter: float) -> float:
        """How many of the scene's units one of SI is, `meter` px to the metre."""
        return float(1000.0**self.grams * meter**self.pixels)


LENGTH = Quantity("px", "m", 0, 1)
SPEED = Quantity("px/s", "m/s", 0, 1)
IMPULSE = Quantity("g·px/s", "N·s", 1, 1)
ENERGY = Quantity("g·px²/s²", "J", 1, 2)


@dataclass(frozen=True)
class Units:
    """Those of one figure."""

    meter: float | None
    """px to the metre; None: the scene has no scale."""
    si: bool
    """SI alone."""

    @property
    def beside(self) -> bool:
        """Whether SI stands beside the scene's own."""
        return self.meter is not None and not self.si

    def axis(self, of: Quantity, most: float) -> Axis:
        """For values up to `most` of the scene's units, either sign."""
        if self.meter is None:
            return Axis(*_own(of, most), None)
        one = of.per(self.meter)
        power = _thousands(most / one)
        beside = f"{PREFIXES[power]}{of.si}", one * 10.0**power
        return Axis(*beside, None) if self.si else Axis(*_own(of, most), beside)

    def said(self, of: Quantity, value: float, like: float | None = None) -> str:
        """A number with its unit, of SI where there is a scale; with the prefix that `like` would have."""
        if self.meter is None:
            return f"{value:.3g} {of.own}"
        value /= of.per(self.meter)
        measure = value if like is None else like / of.per(self.meter)
        power = next((p for p in (0, -3, -6) if measure >= 10.0 ** (p - 2)), -9) if measure < 1e4 else 3
        return f"{value / 10.0**power:.3g} {PREFIXES[power]}{of.si}"


@dataclass(frozen=True)
class Axis:
    """A unit, and another beside it."""

    unit: str
    size: float
    """How many of the scene's units it is."""
    beside: tuple[str, float] | None
    """The same of SI."""

    def name(self, axes: Axes, name: str, side: str = "y") -> None:
        """Label an axis; SI stands on the other side of it, where it is beside."""
        set_label = axes.set_ylabel if side == "y" else axes.set_xlabel
        set_label(f"{name} ({self.unit})")
        if self.beside is None:
            return
        unit, size = self.beside
        ratio = self.size / size
        pair = (lambda value: value * ratio, lambda value: value / ratio)
        if side == "y":
            axes.secondary_yaxis("right", functions=pair).set_ylabel(f"{name} ({unit})")
        else:
            axes.secondary_xaxis("top", functions=pair).set_xlabel(f"{name} ({unit})")


def units(scene: Scene, look: PlotStyle) -> Units:
    """A scene's: px alone where nobody has said how large they are, unless SI is asked for."""
    known = look.si or "world.pixels_per_meter" in scene.places
    return Units(scene.world.pixels_per_meter if known else None, look.si)


def _own(of: Quantity, most: float) -> tuple[str, float]:
    power = _thousands(most)
    if -3 <= power <= 3:
        return of.own, 1.0
    return f"10{str(power).translate(RAISED)} {of.own}", 10.0**power


def _thousands(most: float) -> int:
    """The power of a thousand that leaves 1 to 1000 of a number.

    >>> [_thousands(v) for v in (0.0, 0.02, 3.0, 1e5, 1e30)]
    [0, -3, 0, 3, 9]
    """
    if not most:
        return 0
    return min(max(3 * floor(log10(abs(most)) / 3 + 1e-9), min(PREFIXES)), max(PREFIXES))
