"""What was measured -> tables, plots and JSON of `evaluate fid`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

from physgen.evaluate.fid.drawn import plot, sheets
from physgen.evaluate.fid.measure import FEW, IMAGE, MOTION, Measured, Side
from physgen.evaluate.fid.motion import PEAK, Normalise
from physgen.evaluate.fid.spread import Distance
from physgen.evaluate.findings import Findings, Section, Table

WORDS = {IMAGE: "Image-FID", MOTION: "Motion-FID"}
BIASED = (
    "Intervals are the middle 95 % of draws in which whole clips are drawn anew. A Fréchet distance of few pictures is "
    "too large, the more so the fewer they are; KID is not, and is below 0 by chance where two sets are alike.",
)
TINY = 1e-9
"""What is smaller is rounding."""
UNLIKE = "NOT comparable with published FIDs: these are distances of"


def findings(found: Measured, who: Mapping[str, Any], comparable: bool, pictures: bool = False) -> Findings:
    """`who` is what was used: extractor and flow; `pictures` asks for plots, which only a page shows."""
    heads = {kind: word if comparable else f"{word}, {who['features']}" for kind, word in WORDS.items()}
    sections = [Section("Distances", BIASED, tuple(_tables(found, heads)))]
    if len(found.methods) > 1:
        sections.append(_apart(found, heads))
    if pictures:
        sections[0] = Section("Distances", sections[0].sentences, (*sections[0].parts, plot(found, heads)))
        sections.append(Section("What was compared", (), tuple(sheets(found))))
    sections.append(Section("How", tuple(_how(found, who))))
    return Findings(
        "fid",
        "Frames and motion against a reference",
        (*_first(found, heads), *_few(found), *_named(who, comparable)),
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
    if value is None:
        return "-"
    return "0" if abs(value) < TINY else f"{value:.4g}" if abs(value) < 1000 else f"{value:.0f}"


def _between(distance: Distance | None) -> str:
    if distance is None or distance.interval is None:
        return "-"
    low, high = distance.interval
    return f"[{_number(low)}, {_number(high)}]"


def _after(distance: Distance) -> str:
    return "" if distance.interval is None else f" {_between(distance)}"


def _first(found: Measured, heads: Mapping[str, str]) -> Iterator[str]:
    if len(found.methods) == 1:
        name = next(iter(found.methods))
        told = [
            f"{heads[kind]} {_number(one.frechet[name].value)}{_after(one.frechet[name])}"
            for kind, one in found.found.items()
        ]
        yield f"{name}: {'; '.join(told)}."
        return
    for kind, one in found.found.items():
        order = sorted(found.methods, key=lambda name: one.frechet[name].value)
        told = [order[0], *(_next(one.apart(other, name), other) for name, other in pairwise(order))]
        yield f"By {heads[kind]}, the nearest first: {', '.join(told)}."


def _next(more: Distance, name: str) -> str:
    """Who comes after another, and whether that is sure."""
    if more.interval is None or more.interval[0] > 0:
        return name
    return f"{name} (not surely farther: in {_share(more)} of the draws)"


def _few(found: Measured) -> Iterator[str]:
    least = min(len(side.lengths) for side in (found.reference, *found.methods.values()))
    if least < FEW:
        clips = "clip" if least == 1 else "clips"
        yield f"A side of {least} {clips} is small: below {FEW}, distances and intervals say little of others."


def _named(who: Mapping[str, Any], comparable: bool) -> Iterator[str]:
    if not comparable:
        what = "colours and edges in fields of the picture" if who["features"] == "bank" else who["features"]
        yield (
            f"{UNLIKE} {what}. Name the Inception file with --features inception:PATH for those; "
            "see docs/fid.md."
        )


def _tables(found: Measured, heads: Mapping[str, str]) -> Iterator[Table]:
    for kind, all_of in found.found.items():
        columns = (
            "method",
            "clips",
            "pictures",
            heads[kind],
            "95 %",
            heads[kind].replace("FID", "KID"),
            "95 %",
        )
        lines = []
        for name, side in found.methods.items():
            one, kernel = all_of.frechet[name], all_of.kernel[name]
            told = [
                _number(one.value),
                _between(one),
                _number(kernel.value if kernel else None),
                _between(kernel),
            ]
            lines.append((name, str(len(side.lengths)), str(side.count(kind)), *told))
        truth = found.reference
        note = f"Reference: {len(truth.lengths)} clips, {truth.count(kind)} pictures."
        if all_of.halves is not None:
            note += (
                f" One half of its clips is {_number(all_of.halves)} from the other: about what no difference looks "
                "like among half as many."
            )
        yield Table(columns, tuple(lines), note=note)


def _apart(found: Measured, heads: Mapping[str, str]) -> Section:
    names = list(found.methods)
    tables = []
    for kind, one in found.found.items():
        lines = []
        for name in names[1:]:
            more, kernel = one.apart(name, names[0]), one.apart_by_kernel(name, names[0])
            line = [name, f"{more.value:+.3g}", _between(more), _share(more)]
            lines.append((*line, "-" if kernel is None else f"{kernel.value:+.3g}", _between(kernel)))
        by_kid = heads[kind].replace("FID", "KID")
        tables.append(Table(("method", heads[kind], "95 %", "farther in", by_kid, "95 %"), tuple(lines)))
    sentence = (
        f"How much farther from the reference than {names[0]} each is, and in how many of the draws; all meet the same "
        "draws, so that what methods share cancels."
    )
    return Section(f"Against {names[0]}", (sentence,), tuple(tables))


def _share(distance: Distance) -> str:
    return "-" if distance.above is None else f"{100 * distance.above:.0f} %"


def _how(found: Measured, who: Mapping[str, Any]) -> Iterator[str]:
    said = found.settings
    count = "all frames" if said.rule.count is None else f"{said.rule.count} frames, evenly,"
    if who.get("skipped"):
        count += f" (but the first {who['skipped']} of the methods')"
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
    return ", ".join(str(value) if key == "name" else f"{key} {value}" for key, value in note.items())
