"""A figure -> its file: PNG, SVG or PDF, the same bytes on every run."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.problems import InputError
from physgen.report.plots.look import Look, drawing
from physgen.whole import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = (".png", ".svg", ".pdf")


def check_name(path: Path) -> None:
    """Raises InputError where no figure can go, before anything is computed."""
    if path.suffix.lower() not in KINDS or path.is_dir():
        raise InputError.of("-o", f'"{path}"', "is no name for a figure", "end it in .png, .svg or .pdf")


def write_figure(figure: Figure, path: Path, title: str, look: Look) -> None:
    """Whole or not at all; folders are created. Neither the time nor the machine gets in."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, figure_bytes(figure, path.suffix.lower()[1:], title, look))


def figure_bytes(figure: Figure, kind: str, title: str, look: Look) -> bytes:
    """As `png`, `svg` or `pdf`."""
    about = {
        "png": {"Title": title, "Software": "physgen"},
        "svg": {"Title": title, "Creator": "physgen", "Date": None},
        "pdf": {"Title": title, "Creator": "physgen", "Producer": "matplotlib", "CreationDate": None},
    }
    buffer = io.BytesIO()
    with drawing(look), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a box stands for it
        figure.savefig(buffer, format=kind, dpi=figure.dpi, metadata=about[kind])
    return buffer.getvalue()
