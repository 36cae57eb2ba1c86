"""Methods, what became of their clips, and scores -> a table of who stands where."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from physgen.evaluate.board.scores import OWN, Score, told
from physgen.evaluate.measure import Findings, Section, Table
from physgen.evaluate.methods import Methods

MOST = 5
"""Scores in the terminal's table; the page and the JSON have all."""


def findings(methods: Methods, broken: dict[tuple[str, str], str], scores: Sequence[Score]) -> Findings:
    """`broken` says of clips why they cannot be shown."""
    rows = [_row(methods, broken, scores, name) for name in methods.names]
    heads = ("method", "clips", "failed", "missing", *(score.name for score in scores[:MOST]))
    cells = tuple(
        (
            row["method"],
            str(row["clips"]),
            str(len(row["failed"])),
            str(len(row["missing"])),
            *(told(score.of(row["method"])) for score in scores[:MOST]),
        )
        for row in rows
    )
    sections = [Section("Methods", (), (Table(heads, cells, note=_more(scores)),))]
    failures = [(name, scene, why) for (name, scene), why in _failures(methods, broken).items()]
    if failures:
        lines = tuple((name, scene, why) for name, scene, why in sorted(failures))
        sections.append(Section("What failed", (), (Table(("method", "scene", "why"), lines),)))
    sentences = [_counted(len(methods.names), "method") + ", " + _counted(len(methods.scenes), "scene") + "."]
    sentences += _leaders(methods, scores)
    if not scores:
        sentences.append("No scores lie beside the clips: physgen evaluate MEASURE -o DIR makes some.")
    more = {
        "scenes": list(methods.scenes),
        "scores": [{"name": s.name, "better": s.better or None} for s in scores],
    }
    return Findings(OWN, "Leaderboard", tuple(sentences), tuple(sections), rows, more=more)


def _row(
    methods: Methods, broken: dict[tuple[str, str], str], scores: Sequence[Score], name: str
) -> dict[str, Any]:
    """As JSON."""
    failed = [scene for scene in methods.scenes if (name, scene) in _failures(methods, broken)]
    missing = [scene for scene in methods.scenes if (name, scene) not in methods.entries]
    return {
        "method": name,
        "clips": len(methods.scenes) - len(failed) - len(missing),
        "failed": failed,
        "missing": missing,
        "scores": {score.name: score.of(name) for score in scores},
        "by_scene": {
            scene: own
            for scene in methods.scenes
            if (own := {s.name: s.clips[name, scene] for s in scores if (name, scene) in s.clips})
        },
    }


def _failures(methods: Methods, broken: dict[tuple[str, str], str]) -> dict[tuple[str, str], str]:
    failed = {pair: entry.problems[0] for pair, entry in methods.entries.items() if entry.problems}
    return {**failed, **broken}


def _leaders(methods: Methods, scores: Sequence[Score]) -> list[str]:
    """A sentence a score of which it is known what is better."""
    said = []
    for score in scores[:MOST]:
        best = [name for name in methods.names if name in score.best(methods.names)]
        if best:
            word = "lowest" if score.better == "low" else "highest"
            values = dict.fromkeys(told(score.of(name)) for name in best)
            said.append(f"{score.name}: {' and '.join(best)} {word}, {' and '.join(values)}.")
    return said


def _more(scores: Sequence[Score]) -> str:
    left = len(scores) - MOST
    return f"{_counted(left, 'score')} more: --json has all, and so has the page." if left > 0 else ""


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
