"""The shared look of all figures: colours, type, units of axes, and saving with reproducible bytes.

Text is 6 to 7.5 points, as journals ask; lines are thin.
"""

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

MM = 25.4
"""Of an inch."""
DPI = 300.0
TEXT, SMALL = 7.5, 6.5
"""pt."""
FONTS = ("DejaVu Sans", "Noto Sans CJK JP", "Noto Sans CJK SC", "Noto Sans Devanagari", "Noto Sans Thai")
"""The first comes with matplotlib; the others, where installed, have letters of other scripts for names."""
DASHES: tuple[Any, ...] = ("-", (0, (4.5, 1.6)), (0, (1.3, 1.3)), (0, (6, 1.4, 1.3, 1.4)))
"""Each is used with all colours once: together they distinguish 28 objects."""
PALE = 0.45
"""Share of a colour in its pale version."""
KINDS = (".png", ".svg", ".pdf")


@dataclass(frozen=True)
class Palette:
    """Colours after Okabe and Ito (2008), distinct for colour-blind eyes; lightened on dark paper."""

    paper: str
    ink: str
    soft: str
    """Of frames and of what stays in the background."""
    faint: str
    blue: str
    green: str
    orange: str
    purple: str
    lines: tuple[str, ...]
    """In the order in which objects get them."""


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
"""Of arrows on photos, as in the paper, and of their rim."""


@dataclass(frozen=True)
class PlotStyle:
    """A user's choices for a figure."""

    width: float | None = None
    """mm; None: as suits the kind of figure."""
    pixels: int | None = None
    """The same in px; at most one of the two is given."""
    dpi: float | None = None
    """px an inch of a PNG; None: 300, or as `pixels` asks; in a strip, so many that frames keep their pixels."""
    dark: bool = False
    si: bool = False
    """SI units alone; else those of the scene, with SI on a second axis where it has a scale."""

    @property
    def palette(self) -> Palette:
        """Its colours."""
        return DARK if self.dark else LIGHT

    def pale(self, colour: str) -> str:
        """A colour mixed with the paper; opaque."""
        pairs = zip(rgb_of(colour), rgb_of(self.palette.paper), strict=True)
        return "#" + "".join(f"{round(PALE * one + (1 - PALE) * other):02x}" for one, other in pairs)

    def inches(self, best: float) -> float:
        """Its width; `best` mm by default."""
        if self.pixels is not None and self.dpi is not None:
            return self.pixels / self.dpi
        return (self.width or best) / MM


def rgb_of(colour: str) -> list[int]:
    """Of `#rrggbb`."""
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]


def require_matplotlib() -> None:
    """Raises InputError where matplotlib is not installed, before anything is computed."""
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


def halo(width: float, colour: str, alpha: float = 1.0) -> list[Any]:
    """A rim around lines, `width` points in all."""
    from matplotlib import patheffects

    return [patheffects.Stroke(linewidth=width, foreground=colour, alpha=alpha), patheffects.Normal()]


@contextmanager
def plot_settings(look: PlotStyle) -> Iterator[None]:
    """Matplotlib with our settings, and none of the user's, for a while."""
    import matplotlib
    from matplotlib import font_manager

    installed = set(font_manager.get_font_names())
    ink, soft, paper = look.palette.ink, look.palette.soft, look.palette.paper
    settings: dict[str, Any] = {
        "font.family": [name for name in FONTS if name in installed],
        "font.size": TEXT,
        "legend.fontsize": SMALL,
        "text.parse_math": False,  # a scene may be called $x$
        "text.color": ink,
        "axes.titlesize": TEXT,
        "axes.labelsize": TEXT,
        "axes.labelcolor": ink,
        "axes.edgecolor": soft,
        "axes.facecolor": "none",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.linewidth": 0.6,
        "axes.labelpad": 3.0,
        "axes.formatter.useoffset": False,
        "axes.formatter.limits": (-4, 5),
        "axes.xmargin": 0.0,
        "figure.facecolor": paper,
        "savefig.facecolor": paper,
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
        "pdf.fonttype": 42,  # TrueType, embedded: editors and publishers can work with it
        "svg.fonttype": "path",
        "svg.hashsalt": "physgen",  # ids inside an SVG are random otherwise
        "path.simplify": False,
        "image.composite_image": False,
        "image.resample": False,
    }
    for axis in ("xtick", "ytick"):
        settings |= {f"{axis}.labelsize": SMALL, f"{axis}.labelcolor": ink, f"{axis}.color": soft}
        settings |= {f"{axis}.major.width": 0.6, f"{axis}.major.size": 2.6}
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
    axes.patch.set_gid("area")  # parts have ids, so that programs find them in an SVG
    return axes


def check_name(path: Path) -> None:
    """Raises InputError where no figure can be written, before anything is computed."""
    if path.suffix.lower() not in KINDS or path.is_dir():
        raise InputError.of("-o", f'"{path}"', "is no name for a figure", "end it in .png, .svg or .pdf")


def write_figure(figure: Figure, path: Path, title: str, look: PlotStyle) -> None:
    """Atomically; folders are created. Neither time nor machine is recorded."""
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
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a box is drawn instead
        figure.savefig(buffer, format=kind, dpi=figure.dpi, metadata=about[kind])
    return buffer.getvalue()


PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Quantity:
    """What an axis shows."""

    own: str
    """Its unit in scenes."""
    si: str
    grams: int
    """Powers in it, of mass and of length."""
    pixels: int

    def per(self, meter: float) -> float:
        """Scene units in one SI unit, with `meter` px to the metre."""
        return float(1000.0**self.grams * meter**self.pixels)


LENGTH = Quantity("px", "m", 0, 1)
SPEED = Quantity("px/s", "m/s", 0, 1)
FORCE = Quantity("g·px/s²", "N", 1, 1)
IMPULSE = Quantity("g·px/s", "N·s", 1, 1)
ENERGY = Quantity("g·px²/s²", "J", 1, 2)
TORQUE = Quantity("g·px²/s²", "N·m", 1, 2)


@dataclass(frozen=True)
class Units:
    """Those of one figure."""

    meter: float | None
    """px to the metre; None: the scene has no scale."""
    si: bool
    """SI alone."""

    @property
    def beside(self) -> bool:
        """Whether there is a second axis in SI."""
        return self.meter is not None and not self.si

    def axis(self, of: Quantity, most: float) -> Axis:
        """For values up to `most` scene units, of either sign."""
        power = _thousands(most)
        own = (
            (of.own, 1.0)
            if abs(power) <= 3
            else (f"10{str(power).translate(SUPERSCRIPTS)} {of.own}", 10.0**power)
        )
        if self.meter is None:
            return Axis(*own, None)
        one = of.per(self.meter)
        power = _thousands(most / one)
        second = f"{PREFIXES[power]}{of.si}", one * 10.0**power
        return Axis(*second, None) if self.si else Axis(*own, second)

    def text(self, of: Quantity, value: float, like: float | None = None) -> str:
        """A number with its unit, in SI where there is a scale; with the prefix that `like` would have."""
        if self.meter is None:
            return f"{value:.3g} {of.own}"
        value /= of.per(self.meter)
        measure = value if like is None else like / of.per(self.meter)
        power = next((p for p in (0, -3, -6) if measure >= 10.0 ** (p - 2)), -9) if measure < 1e4 else 3
        return f"{value / 10.0**power:.3g} {PREFIXES[power]}{of.si}"


@dataclass(frozen=True)
class Axis:
    """The unit of an axis, and that of a second one."""

    unit: str
    size: float
    """In scene units."""
    beside: tuple[str, float] | None
    """The same of SI."""

    def name(self, axes: Axes, name: str, side: str = "y") -> None:
        """Label an axis, and the SI axis opposite."""
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
    """A scene's: px alone where it has no scale, unless SI is asked for."""
    known = look.si or "world.pixels_per_meter" in scene.places
    return Units(scene.world.pixels_per_meter if known else None, look.si)


def _thousands(most: float) -> int:
    """The power of a thousand that leaves 1 to 1000 of a number.

    >>> [_thousands(v) for v in (0.0, 0.02, 3.0, 1e5, 1e30)]
    [0, -3, 0, 3, 9]
    """
    if not most:
        return 0
    return min(max(3 * floor(log10(abs(most)) / 3 + 1e-9), min(PREFIXES)), max(PREFIXES))
