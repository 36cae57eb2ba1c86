"""Verdicts -> tables, sentences and plots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from physgen.evaluate.measure import Bar, Figure, Findings, Section, Table, plotted
from physgen.evaluate.plausibility.evidence import EVEN, score
from physgen.evaluate.plausibility.judge import QUESTIONS, Verdict, verdict_word
from physgen.report.plots.style import RED, SMALL, Palette, stroke

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MOST = 5
"""Marks: more would lie over each other."""
NAMED = 10
"""Bodies, at most, that are named in the plot."""
HEIGHT = 95.0
"""mm."""


def paths(verdict: Verdict) -> Figure:
    """px, y downwards as in the picture; dots are frames."""
    faults = verdict.faults()[:MOST]
    marked = ", ".join(f"{k + 1}: {e.text}" for k, (_, e) in enumerate(faults))
    about = f"Ways of {verdict.tracks.name}, a dot a frame, px. " + (
        f"Called wrong: {marked}." if marked else "Nothing is wrong."
    )
    return plotted(lambda axes, palette: _draw(axes, palette, verdict), about, height=HEIGHT)


def _draw(axes: Axes, palette: Palette, verdict: Verdict) -> None:
    tracks = verdict.tracks
    low, high = np.nanmin(tracks.places[..., 0]), np.nanmax(tracks.places[..., 0])
    for k, name in enumerate(tracks.names):
        colour, dashes = stroke(k, palette)
        x, y = tracks.places[:, k].T
        axes.plot(x, y, color=colour, linestyle=dashes, linewidth=0.7)
        axes.plot(x, y, ".", color=colour, markersize=2.2)
        seen = np.flatnonzero(np.isfinite(x))
        if len(seen) and len(tracks.names) <= NAMED:
            inwards = x[seen[0]] > low + 0.7 * (high - low)  # to the right of it a name would be cut off
            axes.annotate(
                name,
                (x[seen[0]], y[seen[0]]),
                (-3 if inwards else 3, 3),
                textcoords="offset points",
                ha="right" if inwards else "left",
                fontsize=SMALL,
                color=colour,
            )
    for number, (_, evidence) in enumerate(verdict.faults()[:MOST], 1):
        at = tracks.places[min(evidence.frame, len(tracks.times) - 1), list(evidence.bodies)]
        at = at[np.isfinite(at).all(axis=1)]
        if not len(at):
            continue
        x, y = at.mean(axis=0)
        axes.plot(
            [x],
            [y],
            "o",
            markersize=11,
            markerfacecolor="none",
            markeredgecolor=RED,
            markeredgewidth=1.2,
        )
        axes.annotate(str(number), (x, y), (8, 6), textcoords="offset points", color=RED, fontweight="bold")
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    axes.set_xlabel("x, px")
    axes.set_ylabel("y, px")


def speeds(verdict: Verdict) -> Figure:
    """Of what is called wrong: where that is its fall, its velocity downwards, of which gravity makes a slope; else its
    speed.
    """
    faults = verdict.faults()[:MOST]
    bodies = list(dict.fromkeys(k for _, evidence in faults for k in evidence.bodies))[:NAMED]
    down = bool(faults) and faults[0][0] == "gravity"
    what = "Velocity downwards" if down else "Speed"
    law = "All that flies has one slope; a blow is a step." if down else "A blow is a step, a jump a peak."
    about = f"{what} of what is called wrong, from frame to frame. {law}"

    def draw(axes: Axes, palette: Palette) -> None:
        tracks = verdict.tracks
        velocity = np.diff(tracks.places, axis=0) / tracks.step
        middle = (tracks.times[1:] + tracks.times[:-1]) / 2
        for k in bodies:
            colour, dashes = stroke(k, palette)
            value = velocity[:, k, 1] if down else np.hypot(velocity[:, k, 0], velocity[:, k, 1])
            axes.plot(middle, value, color=colour, linestyle=dashes, linewidth=0.7, label=tracks.names[k])
            axes.plot(middle, value, ".", color=colour, markersize=2.2)
        for number, (_, evidence) in enumerate(faults, 1):
            time = tracks.times[min(evidence.frame, len(tracks.times) - 1)]
            axes.axvline(time, color=RED, linewidth=0.7)
            axes.annotate(
                str(number),
                (time, 1 - 0.06 * number),
                (2, 0),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                color=RED,
                fontweight="bold",
            )
        axes.set_xlabel("time, s")
        axes.set_ylabel(f"{what.lower()}, px/s")
        axes.legend(fontsize=SMALL, frameon=False, loc="best")

    return plotted(draw, about)


MOST_FAULTS = 8
"""Reported of a clip, the worst first."""
MOST_PLOTTED = 12
"""Clips with plots of their own: those called wrong first."""


def summary(verdicts: Sequence[Verdict], plots: bool) -> Findings:
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
    sentences = [
        f"{tracks.source}; seen from {'above' if tracks.view.value == 'top' else 'the side'}; "
        f"{len(tracks.times)} frames, {1 / tracks.step:.4g} a second; "
        f"{len(tracks.names)} body{'s' * (len(tracks.names) != 1)}; "
        f"noise {noise} px; {masses}."
    ]
    if (pulled := verdict.gravity) is not None:
        size, off = float(np.hypot(*pulled)), float(np.degrees(np.arctan2(abs(pulled[0]), pulled[1])))
        sentences.append(f"What flies falls at {size:.0f} px/s², {off:.0f}° from straight down.")
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
        parts += [paths(verdict), *([speeds(verdict)] if verdict.wrong else [])]
    return Section(title, tuple(sentences), tuple(parts))


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
