"""Verdicts -> Findings: which clips are called wrong, and why, in words, tables and plots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physgen.evaluate.measure import Bar, Figure, Findings, Section, Table
from physgen.evaluate.plausibility.judge import Verdict, verdict_word
from physgen.evaluate.plausibility.questions import QUESTIONS
from physgen.evaluate.plausibility.score import EVEN, score

MOST_FAULTS = 8
"""Told of a clip, the worst first."""
MOST_PLOTTED = 12
"""Clips with plots of their own: those called wrong first."""


def findings(verdicts: Sequence[Verdict], plots: bool) -> Findings:
    """Of one clip or many; figures where `plots` asks for them."""
    wrong = [v for v in verdicts if v.wrong]
    unasked = [v for v in verdicts if v.wrong is None]
    plotted = sorted(verdicts, key=lambda v: (v.overall is None, v.overall))[:MOST_PLOTTED] if plots else []
    sections = (
        Section("Scores", _about(), (_overview(verdicts),)),
        *(_section(title, v, v in plotted) for title, v in zip(_titles(verdicts), verdicts, strict=True)),
    )
    judged = len(verdicts) - len(unasked)
    sentences = [f"{_count(len(wrong), judged)} called wrong."]
    if unasked:
        names = ", ".join(v.tracks.name for v in unasked[:5])
        sentences.append(f"Nothing could be asked of {names}: that is no verdict.")
    count = f"{len(wrong)} of {judged}" if judged else "nothing could be asked"
    bar = Bar("clips called wrong", count, "0", not wrong and judged > 0)
    return Findings(
        "plausibility",
        "Is the motion physically possible?",
        tuple(sentences),
        sections,
        [v.as_dict() for v in verdicts],
        (bar,),
        {"even": EVEN},
    )


def _about() -> tuple[str, ...]:
    return (
        "1: nothing wrong is seen. Below 0.5 a clip is called wrong; its score is that of its worst question. "
        "-: the clip shows nothing that could be asked, which is no success.",
    )


def _overview(verdicts: Sequence[Verdict]) -> Table:
    names = [name for name in QUESTIONS if any(name in v.answers for v in verdicts)]
    rows = [
        (title, verdict_word(v.wrong), _score(v.overall), *(_score(v.score(name)) for name in names))
        for title, v in zip(_titles(verdicts), verdicts, strict=True)
    ]
    return Table(("clip", "verdict", "score", *names), tuple(rows))


def _titles(verdicts: Sequence[Verdict]) -> list[str]:
    """Names; where several have one, numbered."""
    names = [v.tracks.name for v in verdicts]
    return [f"{n} ({names[: k + 1].count(n)})" if names.count(n) > 1 else n for k, n in enumerate(names)]


def _section(title: str, verdict: Verdict, plotted: bool) -> Section:
    tracks = verdict.tracks
    sigma = sorted(float(s) for s in verdict.motion.sigma)
    noise = f"{sigma[0]:.2g}" if sigma[-1] < 1.05 * sigma[0] else f"{sigma[0]:.2g} to {sigma[-1]:.2g}"
    masses = "masses are known" if tracks.weighed else "masses are not known"
    said = [
        f"{tracks.source}; seen from {'above' if tracks.view.value == 'top' else 'the side'}; "
        f"{len(tracks.times)} frames, {1 / tracks.step:.4g} a second; "
        f"{len(tracks.names)} thing{'s' * (len(tracks.names) != 1)}; "
        f"noise {noise} px; {masses}."
    ]
    if (pulled := verdict.gravity) is not None:
        size, off = float(np.hypot(*pulled)), float(np.degrees(np.arctan2(abs(pulled[0]), pulled[1])))
        said.append(f"What flies falls at {size:.0f} px/s², {off:.0f}° from straight down.")
    parts: list[Table | Figure] = [_questions(verdict)]
    faults = verdict.faults()
    if faults:
        rows = tuple(
            (f"{score(name, e.deviation):.2f}", name, str(e.frame), e.text)
            for name, e in faults[:MOST_FAULTS]
        )
        more = len(faults) - MOST_FAULTS
        parts.append(
            Table(
                ("score", "question", "frame", "what was found"),
                rows,
                note=f"And {more} more." if more > 0 else "",
            )
        )
    if plotted:
        from physgen.evaluate.plausibility.drawn_paths import paths, speeds

        parts += [paths(verdict), *([speeds(verdict)] if verdict.wrong else [])]
    return Section(title, tuple(said), tuple(parts))


def _questions(verdict: Verdict) -> Table:
    rows = []
    for name, asked in verdict.answers.items():
        if asked.evidence:
            worst = asked.evidence[0]
            what = worst.text if worst.deviation > 0 else "nothing beyond noise"
            rows.append((QUESTIONS[name].text, str(len(asked.evidence)), _score(verdict.score(name)), what))
        else:
            rows.append((QUESTIONS[name].text, "0", "-", f"not asked: {asked.why_not}"))
    return Table(("what must hold", "asked", "score", "the worst"), tuple(rows))


def _score(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _count(wrong: int, judged: int) -> str:
    if judged == 1:
        return "The clip is" if wrong else "The clip is not"
    return f"{wrong} of {judged} clips are"
