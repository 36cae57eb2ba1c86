"""What was measured -> tables, plots and JSON of `evaluate fid`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from physgen.evaluate.fid.measure import IMAGE, MOTION, Measured, Side
from physgen.evaluate.fid.motion import PEAK, Normalise
from physgen.evaluate.fid.roles import U8
from physgen.evaluate.fid.spread import Distance
from physgen.evaluate.findings import Figure, Findings, Section, Table
from physgen.evaluate.plotted import plotted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.look import Palette

WORDS = {IMAGE: "Image-FID", MOTION: "Motion-FID"}
TILE, GAP = 128, 4
"""px of a picture's height, and between two."""
UNLIKE = "NOT comparable with published FIDs: these are distances of"


def findings(found: Measured, who: Mapping[str, Any], comparable: bool, pictures: bool = False) -> Findings:
    """`who` is what was used: extractor and flow; `pictures` asks for plots, which only a page shows."""
    heads = {kind: word if comparable else f"{word}, {who['features']}" for kind, word in WORDS.items()}
    sections = [Section("Distances", tuple(_biased(found)), (_table(found, heads),))]
    if len(found.methods) > 1:
        sections.append(_apart(found, heads))
    if pictures:
        sections[0] = Section("Distances", sections[0].sentences, (*sections[0].parts, plot(found, heads)))
        sections.append(Section("What was compared", (), tuple(_sheets(found))))
    sections.append(Section("How", tuple(_how(found, who))))
    return Findings(
        "fid",
        "Frames and motion against a reference",
        (*_first(found, heads), *_named(who, comparable)),
        tuple(sections),
        rows(found),
        more={**who, "comparable": comparable, "settings": settings(found), "reference": _counts(found.reference),
              "halves_of_reference": {kind: one.halves for kind, one in found.found.items()}},
    )  # fmt: skip


def rows(found: Measured) -> list[dict[str, Any]]:
    """One a method, numbers in full: distances, 95 % intervals, and how much farther than the first method."""
    first = next(iter(found.methods))
    told = []
    for name, side in found.methods.items():
        row: dict[str, Any] = {"method": name, **_counts(side)}
        for kind, one in found.found.items():
            kernel = one.kernel[name]
            row[f"{kind}_fid"], row[f"{kind}_fid_95"] = one.frechet[name].value, _pair(one.frechet[name])
            row[f"{kind}_kid"], row[f"{kind}_kid_95"] = (
                (None, None) if kernel is None else (kernel.value, _pair(kernel))
            )
            if name != first:
                more = one.apart(name, first)
                row[f"{kind}_fid_more"], row[f"{kind}_fid_more_95"] = more.value, _pair(more)
                row[f"{kind}_fid_more_sure"] = more.above
        told.append(row)
    return told


def settings(found: Measured) -> dict[str, Any]:
    """As JSON."""
    said = found.settings
    normalise = said.normalise.value if isinstance(said.normalise, Normalise) else said.normalise
    return {
        "frames": str(said.rule),
        "frames_a_clip": said.rule.count,
        "full_colour": normalise if MOTION in said.kinds else None,
        "full_colour_px": found.full,
        "draws": said.draws,
        "seed": said.seed,
        "features_of_a_picture": dict(found.features),
    }


def _counts(side: Side) -> dict[str, Any]:
    pairs = side.count(MOTION) if MOTION in side.features else None
    return {"clips": len(side.lengths), "frames": sum(side.lengths), "pairs": pairs}


def _pair(distance: Distance) -> list[float] | None:
    return None if distance.interval is None else list(distance.interval)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}" if abs(value) < 1000 else f"{value:.0f}"


def _between(distance: Distance | None) -> str:
    if distance is None or distance.interval is None:
        return "-"
    low, high = distance.interval
    return f"[{low:.3g}, {high:.3g}]"


def _first(found: Measured, heads: Mapping[str, str]) -> Iterator[str]:
    if len(found.methods) == 1:
        name = next(iter(found.methods))
        told = [
            f"{heads[kind]} {_number(one.frechet[name].value)} {_between(one.frechet[name]).replace('-', '')}".strip()
            for kind, one in found.found.items()
        ]
        yield f"{name}: {'; '.join(told)}."
        return
    for kind, one in found.found.items():
        order = sorted(found.methods, key=lambda name: one.frechet[name].value)
        yield f"By {heads[kind]}, the nearest first: {', '.join(order)}."


def _named(who: Mapping[str, Any], comparable: bool) -> Iterator[str]:
    if not comparable:
        what = "colours and edges in fields of the picture" if who["features"] == "bank" else who["features"]
        yield (
            f"{UNLIKE} {what}. Name the Inception file with --features inception:PATH for those; "
            "see docs/fid.md."
        )


def _biased(found: Measured) -> Iterator[str]:
    halves = [
        f"{_number(one.halves)} by {WORDS[kind]}"
        for kind, one in found.found.items()
        if one.halves is not None
    ]
    yield (
        "Intervals are the middle 95 % of draws in which whole clips are drawn anew. A Fréchet distance of few "
        "pictures is too large, the more so the fewer they are; KID is not, and is below 0 by chance where two "
        "sets are alike."
    )
    if halves:
        yield f"Two halves of the reference are {' and '.join(halves)} apart: about what no difference looks like."


def _table(found: Measured, heads: Mapping[str, str]) -> Table:
    kinds = tuple(found.found)
    columns = ["method", "clips", "frames"]
    for kind in kinds:
        columns += [heads[kind], "95 %", heads[kind].replace("FID", "KID"), "95 %"]
    lines = []
    for name, side in found.methods.items():
        line = [name, str(len(side.lengths)), str(sum(side.lengths))]
        for kind in kinds:
            one, kernel = found.found[kind].frechet[name], found.found[kind].kernel[name]
            line += [
                _number(one.value),
                _between(one),
                _number(kernel.value if kernel else None),
                _between(kernel),
            ]
        lines.append(tuple(line))
    truth = found.reference
    return Table(
        tuple(columns),
        tuple(lines),
        note=f"Reference: {len(truth.lengths)} clips, {sum(truth.lengths)} frames.",
    )


def _apart(found: Measured, heads: Mapping[str, str]) -> Section:
    names = list(found.methods)
    columns = ["method"]
    for kind in found.found:
        columns += [f"{heads[kind]} farther by", "95 %", "in draws"]
    lines = []
    for name in names[1:]:
        line = [name]
        for one in found.found.values():
            more = one.apart(name, names[0])
            sure = "-" if more.above is None else f"{100 * more.above:.0f} %"
            line += [f"{more.value:+.3g}", _between(more), sure]
        lines.append(tuple(line))
    sentence = (
        "How much farther from the reference each is, and in how many of the draws; all meet the same draws."
    )
    return Section(f"Against {names[0]}", (sentence,), (Table(tuple(columns), tuple(lines)),))


def _how(found: Measured, who: Mapping[str, Any]) -> Iterator[str]:
    said = found.settings
    count = "all frames" if said.rule.count is None else f"{said.rule.count} frames, evenly,"
    yield f"Frames: {count} of each clip, {said.rule}. Features: {who['features']}, {_kept(who['features_note'])}."
    if MOTION not in said.kinds:
        return
    if found.full is None:
        full = "each picture's own fastest pixel, so that speed is not seen and noise is where nothing moves"
    elif said.normalise is Normalise.REFERENCE:
        full = f"{found.full:.4g} px, the speed of the reference's fastest pair ({PEAK} % of its pixels), for all clips"
    else:
        full = f"{found.full:.4g} px, for all clips"
    yield (
        f"Motion: flow from each frame to the next, by {who['flow']} ({_kept(who['flow_note'])}), coloured as Baker "
        f"et al. (2011) do; full colour is {full}."
    )


def _kept(note: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} {value}" for key, value in note.items())


def plot(found: Measured, heads: Mapping[str, str]) -> Figure:
    """Distances with their intervals: both kinds against each other, as the paper's argument goes, or the one alone."""
    kinds = tuple(found.found)
    names = tuple(found.methods)

    def draw(axes: Axes, palette: Palette) -> None:
        for k, name in enumerate(names):
            colour = palette.lines[k % len(palette.lines)]
            spots = [found.found[kind].frechet[name] for kind in kinds]
            at = [one.value for one in spots] if len(kinds) > 1 else [spots[0].value, float(k)]
            reach = [_reach(one) for one in spots] + ([None] if len(kinds) < 2 else [])
            axes.errorbar(
                *([value] for value in at), xerr=reach[0], yerr=reach[1], fmt="o", color=colour, markersize=4,
                elinewidth=0.8, capsize=2,
            )  # fmt: skip
            axes.annotate(
                name, (at[0], at[1]), xytext=(5, 4), textcoords="offset points", color=colour, fontsize=6.5
            )
        axes.set_xlabel(heads[kinds[0]])
        if len(kinds) > 1:
            axes.set_ylabel(heads[kinds[1]])
            axes.set_ylim(bottom=0)
        else:
            axes.set_yticks([])
            axes.set_ylim(-0.6, len(names) - 0.2)
        axes.set_xlim(left=0)
        axes.margins(0.15)

    about = f"{' and '.join(heads[kind] for kind in kinds)} of every method, with 95 % intervals; nearer 0 is better."
    return plotted(draw, about)


def _reach(distance: Distance) -> Any:
    if distance.interval is None:
        return None
    low, high = distance.interval
    return np.array([[max(distance.value - low, 0)], [max(high - distance.value, 0)]])


def _sheets(found: Measured) -> Iterator[Figure]:
    for side in (found.reference, *found.methods.values()):
        frames, moving = side.shown
        what = "frames" + (" and the flow between them" if moving else "")
        yield Figure(sheet(frames, moving), f"{side.name}: {what}, {side.which}")


def sheet(frames: tuple[U8, ...], moving: tuple[U8, ...]) -> bytes:
    """A row of frames and, between them below, their flow; PNG."""
    small = [[_small(picture) for picture in row] for row in (frames, moving) if row]
    wide = small[0][0].shape[1]
    page = np.full((len(small) * (TILE + GAP) - GAP, len(frames) * (wide + GAP) - GAP, 3), 255, np.uint8)
    for line, row in enumerate(small):
        shift = (wide + GAP) // 2 if line and len(row) < len(frames) else 0
        for k, picture in enumerate(row):
            top, left = line * (TILE + GAP), shift + k * (wide + GAP)
            page[top : top + TILE, left : left + wide] = picture[:, :wide]
    _, data = cv2.imencode(".png", page[..., ::-1])
    return bytes(data)


def _small(picture: U8) -> U8:
    height, width = picture.shape[:2]
    size = max(1, round(width * TILE / height)), TILE
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
