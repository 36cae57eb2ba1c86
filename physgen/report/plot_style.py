"""The shared look of all figures: colours, type, and saving with reproducible bytes.

Text is 6 to 7.5 points, as journals ask; lines are thin.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physgen.files import write_atomic
from physgen.problems import InputError

if TYPE_CHECKING:
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
KINDS = (".png", ".svg", ".pdf")


@dataclass(frozen=True)
class Palette:
    """Colours after Okabe and Ito (2008), distinct for colour-blind eyes."""

    paper: str = "#ffffff"
    ink: str = "#1a1a1a"
    soft: str = "#6b6b6b"
    """Of frames and of what stays in the background."""
    faint: str = "#d4d4d4"
    blue: str = "#0072b2"
    green: str = "#009e73"
    orange: str = "#d55e00"
    purple: str = "#a0478a"
    lines: tuple[str, ...] = ("#0072b2", "#d55e00", "#009e73", "#b0508f", "#e69f00", "#3fa7dc", "#4d4d4d")
    """In the order in which objects get them."""


PALETTE = Palette()
RED = "#e3001b"
"""Of arrows on photos, as in the paper."""


def require_matplotlib() -> None:
    """Raises InputError where matplotlib is not installed, before anything is computed."""
    try:
        import matplotlib.figure  # noqa: F401
    except ModuleNotFoundError as error:
        missing = (error.name or "matplotlib").removesuffix(".figure")
        fix = 'pip install "physgen[plots]"'
        raise InputError.of("plot", "", f"needs {missing}, which is not installed", fix) from error


def stroke(k: int, palette: Palette = PALETTE) -> tuple[str, Any]:
    """Colour and dashes of the k-th object."""
    count = len(palette.lines)
    return palette.lines[k % count], DASHES[k // count % len(DASHES)]


@contextmanager
def plot_settings() -> Iterator[None]:
    """Matplotlib with our settings, and none of the user's, for a while."""
    import matplotlib
    from matplotlib import font_manager

    installed = set(font_manager.get_font_names())
    settings: dict[str, Any] = {
        "font.family": [name for name in FONTS if name in installed],
        "font.size": TEXT,
        "axes.titlesize": TEXT,
        "axes.labelsize": TEXT,
        "legend.fontsize": SMALL,
        "legend.frameon": False,
        "xtick.labelsize": SMALL,
        "ytick.labelsize": SMALL,
        "text.parse_math": False,  # a scene may be called $x$
        "axes.facecolor": "none",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.linewidth": 0.6,
        "axes.xmargin": 0.0,
        "lines.linewidth": 1.1,
        "pdf.fonttype": 42,  # TrueType, embedded: editors and publishers can work with it
        "svg.hashsalt": "physgen",  # ids inside an SVG are random otherwise
        "path.simplify": False,
        "image.composite_image": False,
    }
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(settings)
        yield


def new_figure(width: float, height: float, **options: Any) -> Figure:
    """An empty figure, `width` and `height` in inches; `options` are those of matplotlib's `Figure`."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), **options)


def check_name(path: Path) -> None:
    """Raises InputError where no figure can be written, before anything is computed."""
    if path.suffix.lower() not in KINDS or path.is_dir():
        raise InputError.of("-o", f'"{path}"', "is no name for a figure", "end it in .png, .svg or .pdf")


def write_figure(figure: Figure, path: Path, title: str) -> None:
    """Atomically; folders are created. Neither time nor machine is recorded."""
    about = {
        ".png": {"Title": title, "Software": "physgen"},
        ".svg": {"Title": title, "Creator": "physgen", "Date": None},
        ".pdf": {"Title": title, "Creator": "physgen", "Producer": "matplotlib", "CreationDate": None},
    }
    kind = path.suffix.lower()
    buffer = io.BytesIO()
    with plot_settings(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a box is drawn instead
        figure.savefig(buffer, format=kind[1:], dpi=figure.dpi, metadata=about[kind])
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, buffer.getvalue())
