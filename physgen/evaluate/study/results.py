"""Answers to a study -> what they say: means, intervals, distribution, comparisons of methods, agreement of
raters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from physgen.evaluate.measure import Figure, Findings, Section, Table
from physgen.evaluate.study.agreement import Agreement, agreement
from physgen.evaluate.study.answers import Answers
from physgen.evaluate.study.intervals import DRAWS, Draws, Mean, means
from physgen.evaluate.study.paired import Pair, pairs
from physgen.evaluate.study.questions import PAPER, QUESTIONS

ALPHA_LEVEL = 0.05
"""That a p is usually held against."""
FEW = 5
"""Raters or videos below which an interval says less than it seems to."""
Draw = Callable[[str, Sequence[str], Sequence[Sequence[int]], Sequence[float | None]], Figure]


def findings(answers: Answers, draw: Draw | None = None, seed: int = 0) -> Findings:
    """`draw` makes the figures of the page, where there is to be one."""
    key, scores = answers.key, answers.scores
    draws = Draws(len(answers.raters), len(key.scenes), seed)
    mean = {q.key: means(scores[q.key], draws) for q in QUESTIONS}
    first = QUESTIONS[0].key
    order = sorted(
        range(len(key.methods)),
        key=lambda m: (-(mean[first][m].mean or 0), -(mean[QUESTIONS[1].key][m].mean or 0)),
    )
    compared = {q.key: pairs(scores[q.key], draws, seed) for q in QUESTIONS}
    alike = {q.key: agreement(scores[q.key].reshape(len(answers.raters), -1), seed) for q in QUESTIONS}
    counts = {q.key: _counts(scores[q.key]) for q in QUESTIONS}
    sections = [
        Section("Means", (_how(answers),), (_means(answers, mean, order),)),
        Section("Distribution of scores", (), tuple(_distribution(answers, counts, mean, order, draw))),
    ]
    if len(key.methods) > 1:
        sections.append(
            Section(
                "Methods against each other", _what_p_says(answers), tuple(_paired(answers, compared, order))
            )
        )
    sections += [
        Section("Agreement between raters", (ALPHA,), (_agreement(alike), _raters(answers))),
        Section("Scene by scene", (), (_scenes(answers, order),)),
        Section("The paper", (THEIRS,), (_paper(),)),
    ]
    rows = [
        {
            "method": key.methods[m],
            **{
                q.key: {
                    **asdict(mean[q.key][m]),
                    "answers": sum(counts[q.key][m]),
                    "counts": counts[q.key][m],
                }
                for q in QUESTIONS
            },
        }
        for m in order
    ]
    more = {
        "study": key.study,
        "raters": len(answers.raters),
        "videos": len(key.scenes),
        "clips": len(key.clips),
        "interval": f"95 %, {DRAWS} bootstrap draws of raters and videos, seed {seed}",
        "agreement": {q.key: asdict(alike[q.key]) for q in QUESTIONS},
        "comparisons": {q.key: [_pair(pair, key.methods) for pair in compared[q.key]] for q in QUESTIONS},
        "notes": list(answers.notes),
    }
    title = f"Human evaluation of {_counted(len(key.methods), 'method')}"
    return Findings(
        "study", title, tuple(_sentences(answers, mean, compared, order)), tuple(sections), rows, more=more
    )


PAIRED = (
    "Each line takes the answers in which one rater scored both methods in the same scene. p is of a test that flips "
    "signs, two-sided, made once with raters and once with videos as what varies. A difference that is to hold for "
    "others of both needs both small: the last column is the larger, adjusted by Holm for the number of lines."
)
ALPHA = (
    "Krippendorff's alpha for ordinal data: 1 is perfect agreement, 0 what chance would give. From 0.8 up raters agree "
    "well, from 0.667 up enough for tentative conclusions (Krippendorff 2004). The interval draws clips anew."
)
THEIRS = (
    "Means of the paper's own study: 14 participants, 15 videos a method. Other videos and other people: they stand "
    "here for the scale's sake, not to be compared digit by digit."
)


def _sentences(
    answers: Answers,
    mean: Mapping[str, list[Mean]],
    compared: Mapping[str, list[Pair]],
    order: Sequence[int],
) -> list[str]:
    """Who is ahead, and on what that rests."""
    said = [
        f"{q.name}: {_leader(answers.key.methods, mean[q.key], compared[q.key], order)}" for q in QUESTIONS
    ]
    clips, raters = len(answers.key.clips), len(answers.raters)
    given = sum(int((answers.scores[q.key] > 0).sum()) for q in QUESTIONS)
    asked = clips * raters * len(QUESTIONS)
    text = (
        f"{_counted(raters, 'rater')}, {_counted(len(answers.key.scenes), 'video')} a method, {given} answers"
    )
    said.append(f"{text}." if given == asked else f"{text}; {asked - given} of {asked} are missing.")
    if raters == 1:
        said.append(
            "One rater alone: nothing is known of what others would say, and intervals are over videos only."
        )
    elif raters < FEW or len(answers.key.scenes) < FEW:
        said.append(f"With fewer than {FEW} raters or videos, intervals are narrower than they should be.")
    return [*said, *answers.notes]


def _leader(names: Sequence[str], mean: Sequence[Mean], pairs: Sequence[Pair], order: Sequence[int]) -> str:
    """Who is ahead, and of whom that is not sure."""
    known = [m for m in order if mean[m].mean is not None]
    if not known:
        return "nobody answered."
    best = max(known, key=lambda m: mean[m].mean or 0)
    if len(known) == 1:
        alone = " alone was rated," if len(names) > 1 else ""
        return f"{names[best]}{alone} {_told(mean[best])} of 5."
    even = [m for m in known if _number(mean[m].mean) == _number(mean[best].mean)]
    if len(even) > 1:
        return f"{' and '.join(names[m] for m in even)} score alike, {_number(mean[best].mean)} of 5."
    told = f"{names[best]} scores highest, {_told(mean[best])} of 5"
    doubtful = []
    for pair in pairs:
        other = pair.other if pair.one == best else pair.one
        if best in (pair.one, pair.other) and other in known:
            if pair.adjusted is None:
                doubtful.append(names[other])
            elif pair.adjusted >= ALPHA_LEVEL:
                doubtful.append(f"{names[other]} (p {_p(pair.adjusted)})")
    return f"{told}, not surely more than {', '.join(doubtful)}." if doubtful else f"{told}."


def _what_p_says(answers: Answers) -> tuple[str, ...]:
    """And where there are too few to say anything."""
    limits = []
    for count, what in ((len(answers.raters), "rater"), (len(answers.key.scenes), "video")):
        least = 2 ** (1 - count)
        if count > 1 and least > ALPHA_LEVEL:
            limits.append(
                f"{_counted(count, what)} cannot give a p below {least:g}, however clear the difference."
            )
    return (PAIRED, *limits)


def _how(answers: Answers) -> str:
    if len(answers.raters) == 1 and len(answers.key.scenes) == 1:
        return "One rater and one video have no interval."
    over = {(True, True): "raters and videos", (True, False): "raters", (False, True): "videos"}
    what = over[len(answers.raters) > 1, len(answers.key.scenes) > 1]
    return f"In brackets the 95 % interval: a bootstrap over {what}, {DRAWS} draws."


def _means(answers: Answers, mean: Mapping[str, list[Mean]], order: Sequence[int]) -> Table:
    heads = ["method"]
    for question in QUESTIONS:
        heads += [question.name, "95 %"]
    rows = []
    for m in order:
        row = [answers.key.methods[m]]
        for question in QUESTIONS:
            found = mean[question.key][m]
            row += [_number(found.mean), _interval(found.low, found.high)]
        rows.append(tuple(row))
    return Table(tuple(heads), tuple(rows), note="1 is strongly disagree, 5 strongly agree.")


def _distribution(
    answers: Answers,
    counts: Mapping[str, list[list[int]]],
    mean: Mapping[str, list[Mean]],
    order: Sequence[int],
    draw: Draw | None,
) -> list[Table | Figure]:
    names, parts = answers.key.methods, list[Table | Figure]()
    for question in QUESTIONS:
        found = counts[question.key]
        if draw:
            shown = [mean[question.key][m].mean for m in order]
            parts.append(draw(question.name, [names[m] for m in order], [found[m] for m in order], shown))
        rows = tuple((names[m], *map(str, found[m])) for m in order)
        parts.append(Table(("method", "1", "2", "3", "4", "5"), rows, question.name))
    return parts


def _paired(answers: Answers, compared: Mapping[str, list[Pair]], order: Sequence[int]) -> list[Table]:
    names = answers.key.methods
    place = {m: k for k, m in enumerate(order)}
    heads = (
        "method", "against", "difference", "95 %", "better, even, worse", "p by raters", "by videos", "adjusted"
    )  # fmt: skip
    tables = []
    for question in QUESTIONS:
        lines = []
        for pair in sorted(compared[question.key], key=lambda p: sorted((place[p.one], place[p.other]))):
            turned = place[pair.one] > place[pair.other]  # the one ahead comes first
            way, (one, other) = (-1 if turned else 1), (pair.one, pair.other)[:: -1 if turned else 1]
            apart = pair.apart
            low, high = (None if end is None else way * end for end in (apart.low, apart.high)[::way])
            lines.append(
                (
                    names[one],
                    names[other],
                    "-" if apart.mean is None else f"{way * apart.mean:+.2f}",
                    _interval(low, high, "+"),
                    ", ".join(map(str, (pair.better, pair.even, pair.worse)[::way])),
                    *map(_p, (pair.by_raters, pair.by_videos, pair.adjusted)),
                )
            )
        tables.append(Table(heads, tuple(lines), question.name))
    return tables


def _agreement(alike: Mapping[str, Agreement]) -> Table:
    rows = tuple(
        (q.name, _number(alike[q.key].alpha), _interval(alike[q.key].low, alike[q.key].high))
        for q in QUESTIONS
    )
    unknown = any(alike[q.key].alpha is None for q in QUESTIONS)
    note = "-: it has no value, for one rater alone or where all scores are the same." if unknown else ""
    return Table(("question", "alpha", "95 %"), rows, note=note)


def _raters(answers: Answers) -> Table:
    clips = len(answers.key.clips)
    rows = []
    for r, rater in enumerate(answers.raters):
        given = [answers.scores[q.key][r] for q in QUESTIONS]
        own = (f"{score[score > 0].mean():.2f}" if (score > 0).any() else "-" for score in given)
        pace = "-" if rater.pace is None else f"{rater.pace:.0f}"
        rows.append((rater.name, f"{len(rater.scores)} of {clips}", *own, pace))
    heads = ("rater", "clips", *(f"mean {q.name}" for q in QUESTIONS), "s a clip")
    return Table(heads, tuple(rows))


def _scenes(answers: Answers, order: Sequence[int]) -> Table:
    """Both means in one cell: the table stays narrow."""
    names = answers.key.methods
    rows = []
    for s, scene in enumerate(answers.key.scenes):
        cells = []
        for m in order:
            found = [answers.scores[q.key][:, m, s] for q in QUESTIONS]
            told = [f"{score[score > 0].mean():.1f}" if (score > 0).any() else "-" for score in found]
            cells.append(" / ".join(told))
        rows.append((scene, *cells))
    note = f"Means of {' / '.join(q.name for q in QUESTIONS)}."
    return Table(("scene", *(names[m] for m in order)), tuple(rows), note=note)


def _paper() -> Table:
    rows = tuple((name, *(f"{mean:.2f}" for mean in found)) for name, *found in PAPER)
    return Table(("method", *(q.name for q in QUESTIONS)), rows)


def _pair(pair: Pair, names: Sequence[str]) -> dict[str, Any]:
    """As JSON."""
    return {**asdict(pair), "one": names[pair.one], "other": names[pair.other]}


def _counts(scores: np.ndarray) -> list[list[int]]:
    """By method, of 1 to 5."""
    return [[int((scores[:, m] == point).sum()) for point in range(1, 6)] for m in range(scores.shape[1])]


def _told(mean: Mean) -> str:
    return " ".join(part for part in (_number(mean.mean), _interval(mean.low, mean.high)) if part != "-")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _interval(low: float | None, high: float | None, sign: str = "") -> str:
    return "-" if low is None or high is None else f"[{low:{sign}.2f}, {high:{sign}.2f}]"


def _p(value: float | None) -> str:
    return "-" if value is None else "< 0.001" if value < 0.001 else f"{value:.3f}"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
