"""Everything needed to repeat a run, as data for the report page."""

from __future__ import annotations

import hashlib
import platform
import shlex
from collections.abc import Mapping
from dataclasses import dataclass

from markupsafe import Markup

from physgen.report.html import highlight_yaml
from physgen.report.record import RunRecord, StageTime, peak_memory, versions

SLICES = 8
"""Colours of the bar; the stages beyond go round."""
SLIVER = 0.5
"""%: narrower slices are not drawn, and stay in the legend."""


@dataclass(frozen=True)
class Slice:
    """One stage of the bar."""

    name: str
    wall: str
    """s, as it is read."""
    cpu: str
    percent: float
    """Of the wall time of all."""
    begin: float
    """%: where on the bar it begins."""
    colour: int
    """0 to SLICES - 1."""


@dataclass(frozen=True)
class Text:
    """A text to look at and to copy."""

    title: str
    html: Markup
    lines: int


@dataclass(frozen=True)
class Provenance:
    """What `provenance.html.j2` shows."""

    command: str
    texts: tuple[Text, ...]
    """The scene file as it was written, where given, and with every default filled in."""
    stages: tuple[Slice, ...]
    wall: str
    """s of all stages."""
    facts: tuple[tuple[str, str], ...]
    """Platform, device, seeds, memory."""
    edits: tuple[str, ...]
    """What the command set."""
    versions: Mapping[str, str]
    hashes: tuple[tuple[str, str], ...]
    """What was read: path and SHA-256."""
    frames: str
    """SHA-256 of the hashes of all frames, "" without any: two runs made the same clip where it is the same."""


def provenance(record: RunRecord, resolved: str, written: str | None = None) -> Provenance:
    """`resolved`: the scene with every default; `written`: the file as it is, where it can be read."""
    texts = [] if written is None else [_text("Scene file", written)]
    texts.append(
        _text(
            "Scene file with every default filled in"
            if texts
            else "Scene file, with every default filled in",
            resolved,
        )
    )
    slices = _slices(record)
    return Provenance(
        command=shlex.join(record.command),
        texts=tuple(texts),
        stages=slices,
        wall=f"{sum(stage.wall for name, stage in _timed(record)):.2f}",
        facts=_facts(record),
        edits=tuple(record.overrides),
        versions=versions(record.refine),
        hashes=tuple(record.inputs.items()),
        frames=_digest(record.frames),
    )


def _text(title: str, text: str) -> Text:
    return Text(title, highlight_yaml(text), text.count("\n") + (not text.endswith("\n")))


def _timed(record: RunRecord) -> list[tuple[str, StageTime]]:
    return [
        (name, stage) for name, stage in record.stages.items() if name != "report"
    ]  # this page, not yet done


def _slices(record: RunRecord) -> tuple[Slice, ...]:
    stages = _timed(record)
    whole = sum(stage.wall for _, stage in stages) or 1.0
    slices, begin = [], 0.0
    for k, (name, stage) in enumerate(stages):
        percent = 100 * stage.wall / whole
        slices.append(
            Slice(
                name, f"{stage.wall:.2f}", f"{stage.cpu:.2f}", round(percent, 3), round(begin, 3), k % SLICES
            )
        )
        begin += percent
    return tuple(slices)


def _facts(record: RunRecord) -> tuple[tuple[str, str], ...]:
    facts = [
        ("platform", f"{platform.system()}, {platform.machine()}"),
        ("frames drawn by", record.device),
        ("peak memory", f"{peak_memory() / 2**20:,.0f} MiB"),
        *(
            (f"seed of {name}", str(seed))
            for name, seed in record.seeds.items()
            if record.refine or name != "refine"
        ),
    ]
    if record.variant is not None:
        facts.append(("variant", record.variant))
    return tuple(facts)


def _digest(hashes: list[str]) -> str:
    return hashlib.sha256("\n".join(hashes).encode()).hexdigest() if hashes else ""
