"""Answers to a study -> means of methods, and agreement of raters.

Intervals are bootstraps over raters and scenes, drawn with replacement and apart from each other (A. Owen, The
pigeonhole bootstrap, Annals of Applied Statistics 2007; it errs on the wide side). All methods share the draws.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.measure import Findings, Section, Table, interval, number
from physgen.evaluate.study import ANSWERS, QUESTIONS, Key, read_record
from physgen.problems import InputError, Place, Problem
from physgen.text import counted, natural, shown

F64 = NDArray[np.float64]
Scores = NDArray[np.int64]
"""(R, M, S): 1 to 5 that R raters gave M methods in S scenes, 0 where a rater gave none."""

POINTS = 5
DRAWS, CLIP_DRAWS = 5000, 500
"""Bootstrap draws of raters and scenes; of clips, for agreement."""
COVER = (0.025, 0.975)
FEW = 5
"""Raters or videos below which an interval is too narrow."""


# ---- reading -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rater:
    """Answers of one person."""

    name: str
    file: Path
    session: str  # of one person at one browser: two files of one session are of the same person
    saved: str  # ISO 8601; empty where the file does not state it
    scores: Mapping[str, Mapping[str, int]]  # clip -> question -> 1 to 5


@dataclass(frozen=True)
class Answers:
    """Of all raters."""

    key: Key
    raters: tuple[Rater, ...]
    scores: Mapping[str, Scores]  # by question


def files_in(paths: Sequence[Path], key: Path) -> list[Path]:
    """Each file once; of a folder, its *.json but the key."""
    inside = [
        file
        for path in paths
        for file in (path.glob("*.json") if path.is_dir() else [path])
    ]
    return sorted(
        {file.resolve() for file in inside} - {key.resolve()},
        key=lambda file: natural(file.name),
    )


def read_answers(files: Sequence[Path], key: Key) -> Answers:
    """Of those who answered anything; the last file of a person counts. Raises InputError with all problems."""
    raters: dict[str, Rater] = {}
    problems: list[Problem] = []
    for file in files:
        try:
            rater = _rater(file, key)
        except InputError as error:
            problems += error.problems
            continue
        before = raters.setdefault(rater.name.casefold(), rater)
        if before.session != rater.session:
            expected = f"has other answers in {before.file}"
            fix = (
                'leave one file out, or, if they are two people, change "rater" in one'
            )
            problems.append(
                Problem(Place(str(file)), "rater", f'"{rater.name}"', expected, fix)
            )
        raters[rater.name.casefold()] = max(before, rater, key=lambda one: one.saved)
    if problems:
        raise InputError(problems)
    kept = sorted(
        (one for one in raters.values() if one.scores),
        key=lambda one: natural(one.name),
    )
    if not kept:
        place = ", ".join(map(str, files[:3])) or "ANSWERS"
        raise InputError.of(
            place,
            "",
            "holds no answer to any question",
            "rate clips on the page, then save",
        )
    shape = len(kept), len(key.methods), len(key.scenes)
    arrays = {question.key: np.zeros(shape, np.int64) for question in QUESTIONS}
    for r, rater in enumerate(kept):
        for clip, scores in rater.scores.items():
            method, scene = key.clips[clip]
            for name, score in scores.items():
                arrays[name][r, key.methods.index(method), key.scenes.index(scene)] = (
                    score
                )
    return Answers(key, tuple(kept), arrays)


def _rater(file: Path, key: Key) -> Rater:
    """Raises InputError with all problems of one file."""
    record = read_record(file, ANSWERS)
    if record.get("study") != key.study:
        expected = f'is another study than the key\'s "{key.study}"'
        fix = "name the key of this study with --key"
        raise InputError.of(str(file), shown(record.get("study")), expected, fix)
    name, session, saved = (
        str(record.get(word) or "").strip()[:80]
        for word in ("rater", "session", "saved")
    )
    given = record.get("answers")
    if not name or not isinstance(given, dict):
        raise InputError.of(
            str(file), "", "names no rater, or has no answers", "save the page again"
        )
    problems: list[Problem] = []
    scores: dict[str, dict[str, int]] = {}
    for clip, answer in given.items():
        if clip not in key.clips or not isinstance(answer, dict):
            expected = "is no clip of this study with its answers"
            problems.append(
                Problem(
                    Place(str(file)),
                    f"answers.{clip}"[:60],
                    "",
                    expected,
                    "leave it out",
                )
            )
            continue
        for question in QUESTIONS:
            value = answer.get(question.key)
            if type(value) is int and 1 <= value <= POINTS:
                scores.setdefault(clip, {})[question.key] = value
            elif value is not None:
                path, expected = (
                    f"answers.{clip}.{question.key}",
                    f"is no score from 1 to {POINTS}",
                )
                fix = "write a whole number, or leave it out"
                problems.append(
                    Problem(Place(str(file)), path, shown(value), expected, fix)
                )
    if problems:
        raise InputError(problems)
    return Rater(name, file, session, saved, scores)


# ---- statistics --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Mean:
    """With its 95 % interval; None where nothing is known, and no interval of a single answer."""

    mean: float | None
    low: float | None = None
    high: float | None = None


class Draws:
    """Bootstrap draws of raters and scenes, shared by all statistics of a study."""

    def __init__(self, raters: int, scenes: int, seed: int = 0) -> None:
        random = np.random.default_rng(seed)
        self._raters, self._scenes = (
            random.multinomial(count, np.full(count, 1 / count), DRAWS).astype(
                np.float64
            )
            for count in (raters, scenes)
        )

    def sums(self, values: F64) -> F64:
        """(R, M, S) -> (B, M): their sum in every draw."""
        raters, methods, scenes = values.shape
        by_raters = (self._raters @ values.reshape(raters, -1)).reshape(
            -1, methods, scenes
        )
        return np.asarray((by_raters * self._scenes[:, None]).sum(axis=2), np.float64)

    def means(self, values: F64, weights: F64) -> list[Mean]:
        """Means of (R, M, S) values by method, over `weights`, with intervals."""
        count, total = weights.sum(axis=(0, 2)), values.sum(axis=(0, 2))
        tops, below = self.sums(values), self.sums(weights)
        found = []
        for k, n in enumerate(count):
            has = below[:, k] > 0  # where answers are missing, a draw may hold none
            ends = (
                np.quantile(tops[has, k] / below[has, k], COVER).tolist()
                if n > 1
                else (None, None)
            )
            found.append(Mean(float(total[k] / n), *ends) if n else Mean(None))
        return found


def means(scores: Scores, draws: Draws) -> list[Mean]:
    """One a method: of all answers that it got."""
    return draws.means(scores.astype(np.float64), (scores > 0).astype(np.float64))


def agreement(scores: Scores, seed: int = 0) -> Mean:
    """Krippendorff's alpha for ordinal data: 1 is perfect agreement, 0 is chance; None where it has no meaning.

    Of (R, U) scores 1 to 5 that R raters gave U clips, 0 where a rater gave none. The interval draws clips, not
    raters: a rater drawn twice would agree with himself.
    """
    import krippendorff

    counts = np.stack(
        [(scores == point).sum(axis=0) for point in range(1, POINTS + 1)], axis=1
    )
    counts = counts[counts.sum(axis=1) > 1]
    if (
        counts.sum(axis=0) > 0
    ).sum() < 2:  # no clip twice, or the same score everywhere
        return Mean(None)

    def alpha(units: Scores) -> float:
        if (units.sum(axis=0) > 0).sum() < 2:
            return float("nan")
        value = krippendorff.alpha(
            value_counts=units,
            value_domain=np.arange(1, POINTS + 1),
            level_of_measurement="ordinal",
        )
        return float(value)

    if len(counts) < 2:
        return Mean(alpha(counts))
    drawn = np.random.default_rng(seed).integers(
        0, len(counts), (CLIP_DRAWS, len(counts))
    )
    low, high = np.nanquantile([alpha(counts[rows]) for rows in drawn], COVER).tolist()
    return Mean(alpha(counts), low, high)


# ---- report ------------------------------------------------------------------------------------------------------

ALPHA = (
    "Krippendorff's alpha for ordinal data: 1 is perfect agreement, 0 chance. From 0.8 up raters agree well, from "
    "0.667 up enough for tentative conclusions (Krippendorff 2004)."
)


def findings(answers: Answers, seed: int = 0) -> Findings:
    """Means, preferences and agreement."""
    key, scores = answers.key, answers.scores
    names, raters = key.methods, len(answers.raters)
    draws = Draws(raters, len(key.scenes), seed)
    mean = {q.key: means(scores[q.key], draws) for q in QUESTIONS}
    order = sorted(
        range(len(names)),
        key=lambda m: tuple(-(mean[q.key][m].mean or 0) for q in QUESTIONS),
    )
    alike = [(q, agreement(scores[q.key].reshape(raters, -1), seed)) for q in QUESTIONS]
    rows: list[dict[str, Any]] = []
    for m in order:
        row: dict[str, Any] = {"method": names[m]}
        for q in QUESTIONS:
            counts = [
                int((scores[q.key][:, m] == point).sum())
                for point in range(1, POINTS + 1)
            ]
            row[q.key] = {
                **asdict(mean[q.key][m]),
                "answers": sum(counts),
                "counts": counts,
            }
        rows.append(row)
    lines = tuple(
        (q.name, number(one.mean), interval(one.low, one.high)) for q, one in alike
    )
    alphas = Table(
        ("question", "alpha", "95 %"),
        lines,
        note="-: one rater alone, or the same score everywhere.",
    )
    sections = [
        Section(
            "Scores", (), tuple(_mean_table(q.name, q.key, rows) for q in QUESTIONS)
        ),
        Section("Agreement between raters", (ALPHA,), (alphas,)),
    ]
    more = {
        "study": key.study,
        "raters": raters,
        "videos": len(key.scenes),
        "clips": len(key.clips),
        "interval": f"95 %, {DRAWS} bootstrap draws of raters and videos, seed {seed}",
        "agreement": {
            q.key: {"alpha": one.mean, "low": one.low, "high": one.high}
            for q, one in alike
        },
    }
    sentences = []
    for q in QUESTIONS:
        method, best = max(
            ((row["method"], row[q.key]) for row in rows),
            key=lambda pair: pair[1]["mean"] or 0,
        )
        value = f"{number(best['mean'])} {interval(best['low'], best['high'])}".removesuffix(
            " -"
        )
        highest = f"{method} scores highest, {value} of {POINTS}."
        sentences.append(
            f"{q.name}: {highest if best['answers'] else 'no rater answered.'}"
        )
    given = sum(int((scores[q.key] > 0).sum()) for q in QUESTIONS)
    asked = len(key.clips) * raters * len(QUESTIONS)
    text = f"{counted(raters, 'rater')}, {counted(len(key.scenes), 'video')} a method, {given} answers"
    sentences.append(
        f"{text}."
        if given == asked
        else f"{text}; {asked - given} of {asked} are missing."
    )
    if raters < FEW or len(key.scenes) < FEW:
        sentences.append(
            f"With fewer than {FEW} raters or videos, intervals are narrower than they should be."
        )
    title = f"Human evaluation of {counted(len(names), 'method')}"
    return Findings("study", title, tuple(sentences), tuple(sections), rows, more=more)


def _mean_table(title: str, question: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    lines = []
    for row in rows:
        one = row[question]
        ends = interval(one["low"], one["high"])
        lines.append(
            (row["method"], number(one["mean"]), ends, *map(str, one["counts"]))
        )
    heads = ("method", "mean", "95 %", *(f"{point}" for point in range(1, POINTS + 1)))
    note = "Last columns: answers from 1, strongly disagree, to 5, strongly agree."
    return Table(heads, tuple(lines), title, note)
