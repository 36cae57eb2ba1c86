"""Read answers to a study, and report means of methods and agreement of raters.

Intervals are bootstraps over raters and scenes, drawn with replacement and
independently (A. Owen, The pigeonhole bootstrap, Annals of Applied Statistics 2007; the
intervals tend to be too wide). All methods share the draws.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import krippendorff
import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.measure import Findings, Section, Table, interval, number
from physgen.evaluate.study import ANSWERS, QUESTIONS, Key, read_record
from physgen.messages import Message
from physgen.problems import InputError, Place, Problem
from physgen.text import counted, natural, shown

F64 = NDArray[np.float64]
Scores = NDArray[np.int64]
"""(R, M, S): scores 1 to 5 of R raters for M methods in S scenes, 0 for a
missing one.
"""

POINTS = 5
DRAWS, CLIP_DRAWS = 5000, 500
"""Numbers of bootstrap draws of raters and scenes, and of clips, for agreement."""
QUANTILES = (0.025, 0.975)
"""Quantiles of intervals."""
ENOUGH = 5
"""Minimum number of raters or videos. Below it, an interval is too narrow."""
MAX_PATH = 60
"""Maximum length of a clip's path in a message, characters."""
MAX_NAME = 80
"""Maximum length of names in files of answers, characters."""


# ---- reading


@dataclass(frozen=True)
class Rater:
    """Answers of one person."""

    name: str
    file: Path
    session: str
    """Id of one person at one browser: two files of one session belong to the same
    person.
    """
    save_time: str
    """ISO 8601; empty if missing."""
    scores: Mapping[str, Mapping[str, int]]
    """Scores by clip and question, 1 to 5."""


@dataclass(frozen=True)
class Answers:
    """Answers of all raters."""

    key: Key
    raters: tuple[Rater, ...]
    scores: Mapping[str, Scores]
    """Scores by question."""


def files_in(paths: Sequence[Path], key: Path) -> list[Path]:
    """Return each file once. For a folder, return its *.json files without the key."""
    files: set[Path] = set()
    for path in paths:
        candidates = [path]
        if path.is_dir():
            candidates = list(path.glob("*.json"))
        files.update(file.resolve() for file in candidates)
    files.discard(key.resolve())
    return sorted(files, key=lambda file: natural(file.name))


def read_answers(files: Sequence[Path], key: Key) -> Answers:
    """Return the answers of all raters with an answer. The last file of a person
    counts.

    Raise InputError with all problems.
    """
    raters: dict[str, Rater] = {}
    problems: list[Problem] = []
    for file in files:
        try:
            rater = _read_rater(file, key)
        except InputError as error:
            problems += error.problems
            continue
        # Names differ in case only by a slip.
        previous = raters.setdefault(rater.name.casefold(), rater)
        if previous.session != rater.session:
            problem = Message.RATER_TWICE.problem(
                Place(str(file)), "rater", f'"{rater.name}"', file=previous.file
            )
            problems.append(problem)
        last = max(previous, rater, key=lambda rater: rater.save_time)
        raters[rater.name.casefold()] = last
    if problems:
        raise InputError(problems)
    answering_raters = [rater for rater in raters.values() if rater.scores]
    if not answering_raters:
        names = ", ".join(map(str, files[:3])) or "ANSWERS"
        raise Message.NO_ANSWERS.error(names)
    answering_raters.sort(key=lambda rater: natural(rater.name))
    return Answers(key, tuple(answering_raters), _score_arrays(answering_raters, key))


def _score_arrays(raters: Sequence[Rater], key: Key) -> dict[str, Scores]:
    """Return the scores by question."""
    shape = len(raters), len(key.methods), len(key.scenes)
    arrays = {question.key: np.zeros(shape, np.int64) for question in QUESTIONS}
    for r, rater in enumerate(raters):
        for clip, scores in rater.scores.items():
            # Clips have random names, so that raters do not know the method.
            method, scene = key.clips[clip]
            m = key.methods.index(method)
            s = key.scenes.index(scene)
            for name, score in scores.items():
                arrays[name][r, m, s] = score
    return arrays


def _read_rater(file: Path, key: Key) -> Rater:
    """Return the answers in one file. Raise InputError with all its problems."""
    record = read_record(file, ANSWERS)
    if record.get("study") != key.study:
        raise Message.OTHER_STUDY.error(
            str(file), shown(record.get("study")), study=key.study
        )
    name, session, save_time = (
        str(record.get(word) or "").strip()[:MAX_NAME]
        for word in ("rater", "session", "saved")
    )
    answers = record.get("answers")
    if not name or not isinstance(answers, dict):
        raise Message.ANSWERS_INCOMPLETE.error(str(file))
    problems: list[Problem] = []
    all_scores: dict[str, dict[str, int]] = {}
    for clip, answer in answers.items():
        if clip not in key.clips or not isinstance(answer, dict):
            path = f"answers.{clip}"[:MAX_PATH]
            problems.append(Message.NOT_STUDY_CLIP.problem(Place(str(file)), path))
            continue
        scores = _read_scores(file, clip, answer, problems)
        if scores:
            all_scores[clip] = scores
    if problems:
        raise InputError(problems)
    return Rater(name, file, session, save_time, all_scores)


def _read_scores(
    file: Path, clip: str, answer: Mapping[str, Any], problems: list[Problem]
) -> dict[str, int]:
    """Return the scores of a clip by question, and add the problems of wrong ones."""
    scores = {}
    for question in QUESTIONS:
        value = answer.get(question.key)
        if type(value) is int and 1 <= value <= POINTS:
            scores[question.key] = value
        elif value is not None:
            problem = Message.NOT_A_SCORE.problem(
                Place(str(file)),
                f"answers.{clip}.{question.key}",
                shown(value),
                most=POINTS,
            )
            problems.append(problem)
    return scores


# ---- statistics


@dataclass(frozen=True)
class Mean:
    """A mean with its 95 % interval; None if unknown, and no interval for a single
    answer.
    """

    mean: float | None
    low: float | None = None
    high: float | None = None


class Draws:
    """Bootstrap draws of raters and scenes, shared by all statistics of a study."""

    def __init__(self, raters: int, scenes: int, seed: int = 0) -> None:
        random = np.random.default_rng(seed)
        self._raters = _draw_counts(random, raters)
        self._scenes = _draw_counts(random, scenes)

    def sums(self, values: F64) -> F64:
        """Return the sum of (R, M, S) values in every draw, (B, M)."""
        raters, methods, scenes = values.shape
        # Each draw weights raters and scenes by their counts: two products sum all of
        # them.
        rater_sums = self._raters @ values.reshape(raters, -1)
        rater_sums = rater_sums.reshape(-1, methods, scenes)
        scene_sums = (rater_sums * self._scenes[:, None]).sum(axis=2)
        return np.asarray(scene_sums, np.float64)

    def means(self, values: F64, weights: F64) -> list[Mean]:
        """Return the means of (R, M, S) values by method, over `weights`, with
        intervals.
        """
        counts = weights.sum(axis=(0, 2))
        totals = values.sum(axis=(0, 2))
        drawn_totals = self.sums(values)
        drawn_counts = self.sums(weights)
        means = []
        for k, count in enumerate(counts):
            if not count:
                means.append(Mean(None))
                continue
            mean = float(totals[k] / count)
            if count == 1:
                means.append(Mean(mean))
                continue
            # Missing answers can leave a draw without any.
            has_answers = drawn_counts[:, k] > 0
            ratios = drawn_totals[has_answers, k] / drawn_counts[has_answers, k]
            low, high = np.quantile(ratios, QUANTILES).tolist()
            means.append(Mean(mean, low, high))
        return means


def _draw_counts(random: np.random.Generator, count: int) -> F64:
    """Return the count of each of `count` in each draw, (B, count)."""
    # Draws with replacement have multinomial counts.
    counts = random.multinomial(count, np.full(count, 1 / count), DRAWS)
    return counts.astype(np.float64)


def means(scores: Scores, draws: Draws) -> list[Mean]:
    """Return the mean of each method over all its answers."""
    return draws.means(scores.astype(np.float64), (scores > 0).astype(np.float64))


def agreement(scores: Scores, seed: int = 0) -> Mean:
    """Return Krippendorff's alpha for ordinal data: 1 is perfect agreement, 0 is
    chance; None if undefined.

    The scores (R, U) are 1 to 5 of R raters for U clips, 0 for a missing one. The
    interval draws clips, not raters: a rater drawn twice would agree with himself.
    """
    points = range(1, POINTS + 1)
    # Alpha needs only how often each clip got each score.
    counts = np.stack([(scores == point).sum(axis=0) for point in points], axis=1)
    # A single rating of a clip tells nothing about agreement.
    counts = counts[counts.sum(axis=1) > 1]
    if _is_meaningless(counts):
        return Mean(None)
    if len(counts) < 2:
        return Mean(_alpha(counts))
    shape = (CLIP_DRAWS, len(counts))
    clip_draws = np.random.default_rng(seed).integers(0, len(counts), shape)
    alphas = [_alpha(counts[clips]) for clips in clip_draws]
    # A draw of clips with one score for all has no alpha.
    low, high = np.nanquantile(alphas, QUANTILES).tolist()
    return Mean(_alpha(counts), low, high)


def _is_meaningless(counts: Scores) -> bool:
    """Return whether no clip has two ratings, or all scores (U, points) are equal."""
    return int((counts.sum(axis=0) > 0).sum()) < 2


def _alpha(counts: Scores) -> float:
    """Return Krippendorff's alpha of (U, points) counts, or NaN if undefined."""
    if _is_meaningless(counts):
        return float("nan")
    alpha = krippendorff.alpha(
        value_counts=counts,
        value_domain=np.arange(1, POINTS + 1),
        level_of_measurement="ordinal",
    )
    return float(alpha)


# ---- report

ALPHA = (
    "Krippendorff's alpha for ordinal data: 1 is perfect agreement, 0 chance. From 0.8 up raters agree well, from "
    "0.667 up enough for tentative conclusions (Krippendorff 2004)."
)


def findings(answers: Answers, seed: int = 0) -> Findings:
    """Return means, preferences and agreement."""
    key = answers.key
    raters = len(answers.raters)
    rows = _method_rows(answers, seed)
    agreements = {}
    for question in QUESTIONS:
        scores = answers.scores[question.key].reshape(raters, -1)
        agreements[question.key] = agreement(scores, seed)
    tables = [_mean_table(question.name, question.key, rows) for question in QUESTIONS]
    agreement_table = _agreement_table(agreements)
    return Findings(
        measure="study",
        title=f"Human evaluation of {counted(len(key.methods), 'method')}",
        sentences=tuple(_sentences(answers, rows)),
        sections=(
            Section("Scores", (), tuple(tables)),
            Section("Agreement between raters", (ALPHA,), (agreement_table,)),
        ),
        rows=rows,
        extra={
            "study": key.study,
            "raters": raters,
            "videos": len(key.scenes),
            "clips": len(key.clips),
            "interval": f"95 %, {DRAWS} bootstrap draws of raters and videos, seed {seed}",
            "agreement": {
                name: {"alpha": alpha.mean, "low": alpha.low, "high": alpha.high}
                for name, alpha in agreements.items()
            },
        },
    )


def _method_rows(answers: Answers, seed: int) -> list[dict[str, Any]]:
    """Return means and counts of each method for JSON, the best method first."""
    key, scores = answers.key, answers.scores
    draws = Draws(len(answers.raters), len(key.scenes), seed)
    rows: list[dict[str, Any]] = [{"method": name} for name in key.methods]
    for question in QUESTIONS:
        question_scores = scores[question.key]
        for m, mean in enumerate(means(question_scores, draws)):
            counts = []
            for point in range(1, POINTS + 1):
                counts.append(int((question_scores[:, m] == point).sum()))
            numbers = {"answers": sum(counts), "counts": counts}
            rows[m][question.key] = {**asdict(mean), **numbers}
    return sorted(rows, key=_preference)


def _preference(row: Mapping[str, Any]) -> tuple[float, ...]:
    """Return a sort key for methods by their means, the best first."""
    return tuple(-(row[question.key]["mean"] or 0) for question in QUESTIONS)


def _sentences(answers: Answers, rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the best method by question, the number of answers, and a doubt about a
    small number.
    """
    for question in QUESTIONS:
        best_row = max(rows, key=lambda row: row[question.key]["mean"] or 0)
        best = best_row[question.key]
        if best["answers"]:
            ends = interval(best["low"], best["high"])
            value = f"{number(best['mean'])} {ends}".removesuffix(" -")
            method = best_row["method"]
            yield f"{question.name}: {method} scores highest, {value} of {POINTS}."
        else:
            yield f"{question.name}: no rater answered."
    raters = len(answers.raters)
    videos = len(answers.key.scenes)
    given = sum(int((scores > 0).sum()) for scores in answers.scores.values())
    possible = len(answers.key.clips) * raters * len(QUESTIONS)
    text = f"{counted(raters, 'rater')}, {counted(videos, 'video')} a method, {given} answers"
    if given == possible:
        yield f"{text}."
    else:
        yield f"{text}; {possible - given} of {possible} are missing."
    if raters < ENOUGH or videos < ENOUGH:
        yield f"With fewer than {ENOUGH} raters or videos, intervals are narrower than they should be."


def _agreement_table(agreements: Mapping[str, Mean]) -> Table:
    lines = []
    for question in QUESTIONS:
        alpha = agreements[question.key]
        ends = interval(alpha.low, alpha.high)
        lines.append((question.name, number(alpha.mean), ends))
    note = "-: one rater alone, or the same score everywhere."
    return Table(("question", "alpha", "95 %"), tuple(lines), note=note)


def _mean_table(title: str, question: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    lines = []
    for row in rows:
        score = row[question]
        ends = interval(score["low"], score["high"])
        counts = map(str, score["counts"])
        lines.append((row["method"], number(score["mean"]), ends, *counts))
    heads = ("method", "mean", "95 %", *map(str, range(1, POINTS + 1)))
    note = "Last columns: answers from 1, strongly disagree, to 5, strongly agree."
    return Table(heads, tuple(lines), title, note)
