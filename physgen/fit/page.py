"""The report of a fit: film and simulation side by side, estimates, residuals, flat directions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from physgen.arrays import F64, U8
from physgen.compile.compile import CompiledScene
from physgen.compile.world import World
from physgen.export.video import Format, open_video
from physgen.files import resource, write_atomic
from physgen.fit.intervals import Fit
from physgen.fit.tracks import Tracks
from physgen.fit.writing import interval_text, shown_value, unit
from physgen.pipeline import stages
from physgen.render.stage import Stage
from physgen.report.html import fit_to_side, template, webp
from physgen.scene.scene import Scene
from physgen.simulate.engine import simulate
from physgen.text import rounded

VIDEO = "pair"
"""Name of the video without its suffix."""
SIDE = 640
"""Longer side of each picture in the video, px, at most."""
QUALITY = 80
"""Quality of the page's photo as WebP."""
CHART = (600, 120)
"""Width and height of a chart of residuals."""
LEAST_SCALE = 1.0
"""Range of a chart of residuals to each side, px, at least."""
COLOURS = 10
"""Number of colours for objects in the page's style."""


@dataclass(frozen=True)
class FitPage:
    """Content of a report."""

    name: str
    origin: str
    scene: Scene
    """The scene before the fit."""
    world: World
    tracks: Tracks
    fit: Fit


def film_pairs(
    folder: Path,
    frames: Iterator[U8] | None,
    stage: Stage,
    compiled_scene: CompiledScene,
    tracks: Tracks,
    rate: float,
) -> U8:
    """Write the film beside the simulation as MP4, and return the first frame.

    Without a film, no video is written.
    """
    # The pair is small, so that smooth edges are not worth their time.
    stage = replace(stage, supersample=1)
    end = float(tracks.times[-1])
    world = replace(compiled_scene.world, duration=end + 1e-6)
    # A simulation starts at 0, tracks may start later.
    if tracks.times[0] == 0:
        times = tracks.times
    else:
        times = np.append(0.0, tracks.times)
    motion = simulate(world, times)
    if frames is None:
        first = next(iter(stages.render(stage, motion)))
        return first.rgb
    first_frame = None
    rendering = stages.render(stage, motion)
    size = _pair_size(world.size)
    with open_video(folder, Format.MP4, size, rate, VIDEO) as write:
        # A film may have more frames than the tracks.
        for film_frame, frame in zip(frames, rendering, strict=False):
            if first_frame is None:
                first_frame = film_frame
            write(_side_by_side(film_frame, frame.rgb, size))
    assert first_frame is not None
    return first_frame


def root_mean_square(residuals: F64) -> float:
    """Return the root mean square of residuals (..., 3) of x, y and the angle, px."""
    return float(np.sqrt(np.nanmean(residuals**2)))


def _pair_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return the width and height of two pictures side by side, even."""
    scale = min(1.0, SIDE / max(size))
    width = max(2, round(size[0] * scale))
    height = max(2, round(size[1] * scale))
    # Encoders need even sides.
    return 2 * width, height + height % 2


def _side_by_side(film: U8, simulation: U8, size: tuple[int, int]) -> U8:
    """Return the film on the left and the simulation on the right."""
    canvas = np.zeros((size[1], size[0], 3), np.uint8)
    middle = size[0] // 2
    for k, picture in enumerate((film, simulation)):
        small = fit_to_side(picture, SIDE)[: size[1], :middle]
        left = k * middle
        canvas[: small.shape[0], left : left + small.shape[1]] = small
    return canvas


def write_page(folder: Path, page: FitPage, photo: U8, *, has_film: bool) -> Path:
    """Write the report into a folder and return its path."""
    style = resource("templates", "page.css").read_text(encoding="utf-8")
    width, height = page.scene.size
    values = {
        "name": page.name,
        "origin": page.origin,
        "style": style,
        "video": f"{VIDEO}.mp4" if has_film else None,
        "photo": webp(fit_to_side(photo, 2 * SIDE), QUALITY),
        "size": [width, height],
        "rows": _estimate_rows(page),
        "flat": list(page.fit.flat_directions),
        "losses": [f"{name}, after {time:.2f} s" for name, time in page.tracks.losses],
        "rest": f"{root_mean_square(page.fit.residuals):.2g}",
        "objects": object_rows(page),
        "chart": list(CHART),
        "facts": _facts(page),
    }
    text = template("fit.html.j2").render(**values)
    path = folder / "report.html"
    write_atomic(path, text.encode())
    return path


def _facts(page: FitPage) -> str:
    """Return the length of the tracks and the work of the fit."""
    times = page.tracks.times
    return (
        f"{len(times)} frames over {rounded(float(times[-1]))} s; "
        f"{page.fit.simulations} simulations"
    )


def _estimate_rows(page: FitPage) -> list[dict[str, Any]]:
    """Return the rows of the table of estimates."""
    rows = []
    for estimate in page.fit.estimates:
        value = shown_value(estimate, page.scene, estimate.value)
        interval = "not determined"
        if estimate.is_determined:
            interval = interval_text(estimate, page.scene)
        rows.append(
            {
                "path": estimate.parameter.path,
                "value": rounded(value, 4) if estimate.is_determined else "",
                "interval": interval,
                "unit": unit(estimate, page.scene),
                "is_determined": estimate.is_determined,
            }
        )
    return rows


def object_rows(page: FitPage) -> list[dict[str, Any]]:
    """Return the paths and residuals of each observed object."""
    result = []
    for k, name in enumerate(page.tracks.names):
        points = page.tracks.poses[:, k, :2]
        is_observed = np.isfinite(points[:, 0])
        if not is_observed.any():
            continue
        residuals = page.fit.residuals[:, k]
        scale = max(LEAST_SCALE, float(np.nanmax(np.abs(residuals))))
        result.append(
            {
                "name": name,
                "colour": k % COLOURS,
                "dots": points[is_observed].round(1).tolist(),
                "path": _line(page.fit.poses[:, k, 0], page.fit.poses[:, k, 1]),
                "rms": rounded(root_mean_square(residuals)),
                "scale": rounded(scale),
                "frames": int(is_observed.sum()),
                "charts": _charts(page.tracks.times, residuals, scale),
            }
        )
    return result


def _charts(times: F64, residuals: F64, scale: float) -> list[str]:
    """Return SVG paths of the residuals of x, y and the angle, px."""
    width, height = CHART
    x = times / max(float(times[-1]), 1e-9) * width
    charts = []
    for axis in range(3):
        # Rows of a picture count downwards.
        y = height / 2 - residuals[:, axis] / scale * (height / 2)
        charts.append(_line(x, y))
    return charts


def _line(x: F64, y: F64) -> str:
    """Return an SVG path through points; NaN breaks it."""
    parts = []
    command = "M"
    for column, row in zip(x.tolist(), y.tolist(), strict=True):
        if not np.isfinite(column + row):
            # The next point begins a new line.
            command = "M"
            continue
        parts.append(f"{command}{column:.1f} {row:.1f}")
        command = "L"
    return "".join(parts)
