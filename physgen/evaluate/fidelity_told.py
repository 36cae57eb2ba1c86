"""What `fidelity` measured -> a sentence, tables, its bar, a plot, and strips of frames to be looked at."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from physgen.evaluate.fidelity import BAR, REGIONS, Truth
from physgen.evaluate.measure import Bar, Figure, Findings, Section, Table, plotted
from physgen.evaluate.strips import SHOWN, strip

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.style import Palette


WAYS = ("ours", "ours, true maps", "paper, relit", "paper, relit, no old shadows")
"""That are told scene by scene."""
MEANS, SCENES = "Means over scenes", "Scene by scene"
"""Titles of sections."""
QUALITY = 88


def findings(result: Mapping[str, Any]) -> Findings:
    """Of what `fidelity.evaluate` gives; no bar where no scene is of the test half."""
    ahead = result["ahead"]
    sentence, bars = "None of these scenes is of the test half: there is no bar.", tuple[Bar, ...]()
    if ahead is not None:
        better = "ours over the paper's way, relit, on objects and shadows of the test half"
        bars = (Bar(better, f"{ahead:.2f} dB", f"{BAR:g} dB", ahead >= BAR),)
        sentence = (
            f"On the test half, ours is {ahead:.2f} dB nearer to the truth than the paper's way, relit, over objects "
            "and shadows. The bar is this project's own."
        )
    sections = (
        Section(MEANS, (), (_means(result["means"]),)),
        Section(SCENES, (), (_scenes(result["rows"]),)),
    )
    more = {"means": result["means"], "ahead": ahead}
    return Findings("fidelity", "Frames against the truth", (sentence,), sections, result["rows"], bars, more)


def _means(found: Sequence[Mapping[str, Any]]) -> Table:
    heads = ["half", "way", *(f"{r}, dB" for r in REGIONS), *(f"{r}, SSIM" for r in REGIONS), "flicker"]
    keys = [*(f"psnr_{r}" for r in REGIONS), *(f"ssim_{r}" for r in REGIONS), "flicker"]
    rows = tuple((row["half"], row["way"], *(_cell(row, key) for key in keys)) for row in found)
    return Table(tuple(heads), rows)


def _scenes(found: Sequence[Mapping[str, Any]]) -> Table:
    rows, ways = [], [way for way in WAYS if any(row["way"] == way for row in found)]
    for name, mine in _by_scene(found).items():
        cells = (f"{_cell(mine[w], 'psnr_objects')} / {_cell(mine[w], 'psnr_shadows')}" for w in ways)
        rows.append((name, next(iter(mine.values()))["half"], *cells))
    return Table(("scene", "half", *(f"{way}: objects / shadows, dB" for way in ways)), tuple(rows))


def _by_scene(found: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Mapping[str, Any]]]:
    names = dict.fromkeys(row["scene"] for row in found)
    return {name: {row["way"]: row for row in found if row["scene"] == name} for name in names}


def _cell(row: Mapping[str, Any], key: str) -> str:
    value = row.get(key)
    return "-" if value is None else f"{value:.3f}" if key.startswith("ssim") else f"{value:.2f}"


def plot(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Of every scene, how near each way comes, over objects and shadows together."""
    scenes = _by_scene(rows)
    height = 28 + 8 * len(scenes)

    def draw(axes: Axes, palette: Palette) -> None:
        colours, marks = (palette.blue, palette.green, palette.orange, palette.soft), "os^v"
        for way, colour, mark in zip(WAYS, colours, marks, strict=True):
            at = [(mine[way]["psnr_both"], k) for k, mine in enumerate(scenes.values()) if way in mine]
            there = [(value, k) for value, k in at if value is not None]
            axes.plot(
                [value for value, _ in there],
                [k for _, k in there],
                mark,
                color=colour,
                markersize=4,
                label=way,
            )
        axes.set_yticks(range(len(scenes)), list(scenes))
        axes.set_ylim(len(scenes) - 0.5, -0.5)
        axes.set_xlabel("PSNR over objects and shadows, dB: more is nearer")
        axes.margins(x=0.05)
        axes.set_position((0.16, 13 / height, 0.8, 1 - 22 / height))  # names and the key need room
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(WAYS), frameon=False)

    return plotted(draw, "How near each way comes to the truth, scene by scene.", height=height)


def strips(truths: Sequence[Truth]) -> Iterator[Figure]:
    """A sheet of frames of each: the paper's way, ours, and the truth."""
    for truth in truths:
        _, data = cv2.imencode(
            ".jpg", np.ascontiguousarray(strip(truth)[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
        )
        yield Figure(bytes(data), f"{truth.name}: {', '.join(SHOWN)}, and the truth, at the same moments.")
