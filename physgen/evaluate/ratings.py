"""Answers to a study -> means, distributions, comparisons of methods, and agreement of raters.

Intervals of means are bootstraps over raters and scenes, drawn with replacement and apart from each other (A. Owen,
The pigeonhole bootstrap, Annals of Applied Statistics 2007; it errs on the wide side). Methods share the draws.

The test between two methods flips signs: without a difference, the mean difference of a rater would as often be the
other way round (R. Fisher, The Design of Experiments, 1935, section 21). It is done with raters and with scenes as
what varies, and the larger p counts (H. Clark, The language-as-fixed-effect fallacy, 1973). docs/study.md has its
rate of false alarms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.measure import Figure, Findings, Section, Table, counted, interval, number, plotted
from physgen.evaluate.study import ANSWERS, QUESTIONS, SCALE, Key, read_record
from physgen.problems import InputError, Place, Problem
from physgen.text import natural, shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.style import Palette

F64 = NDArray[np.float64]
Scores = NDArray[np.int64]
"""(R, M, S): 1 to 5 that R raters gave M methods in S scenes, 0 where a rater gave none."""

POINTS = 5
DRAWS = 5000
"""Bootstrap draws of raters and scenes."""
CLIP_DRAWS = 2000
"""Bootstrap draws of clips, for agreement."""
COVER = (0.025, 0.975)
EXACT = 16
"""Differences up to which all patterns of signs are enumerated."""
SIGN_DRAWS = 50_000
"""Patterns that are drawn beyond that."""
SIGNIFICANT = 0.05
FEW = 5
"""Raters or videos below which an interval is too narrow."""
PAPER = (
    ("SEINE", 1.39, 1.86),
    ("DynamiCrafter", 1.68, 1.81),
    ("I2VGen-XL", 2.11, 2.25),
    ("PhysGen", 4.14, 3.86),
)
"""The paper's means of physical-realism and photo-realism: 14 participants, 15 videos a method."""


# ---- reading -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rater:
    """Answers of one person."""

    name: str
    file: Path
    session: str
    """Of one person at one browser: two files of one session are of the same person."""
    saved: str
    """ISO 8601; empty where the file does not say."""
    scores: Mapping[str, Mapping[str, int]]
    """Clip -> question -> 1 to 5."""
    seconds: tuple[float, ...]
    """That each clip was looked at."""


@dataclass(frozen=True)
class Answers:
    """Of all raters."""

    key: Key
    raters: tuple[Rater, ...]
    scores: Mapping[str, Scores]
    """By question."""
    notes: tuple[str, ...]
    """What was left out, and why."""


def files_in(paths: Sequence[Path], key: Path) -> list[Path]:
    """Each file once; of a folder, its *.json but the key. Raises InputError where a folder has none."""
    found: dict[Path, Path] = {}
    for path in paths:
        inside = [path]
        if path.is_dir():
            inside = sorted(path.glob("*.json"), key=lambda file: natural(file.name))
            inside = [file for file in inside if file.resolve() != key.resolve()]
            if not inside:
                fix = "name files that the page saved"
                raise InputError.of(str(path), "", "holds no answers (*.json)", fix)
        for file in inside:
            found.setdefault(file.resolve(), file)
    return list(found.values())


def answers_in(folder: Path) -> bool:
    """Whether raters' files lie in it."""
    for file in folder.glob("*.json") if folder.is_dir() else ():
        with suppress(InputError):
            read_record(file, ANSWERS)
            return True
    return False


def read_answers(files: Sequence[Path], key: Key) -> Answers:
    """Raises InputError with all problems of all files."""
    raters: list[Rater] = []
    problems: list[Problem] = []
    for file in files:
        try:
            raters.append(_rater(file, key))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    kept, notes = _one_each(raters)
    notes += [f"{rater.name} answered nothing and is left out." for rater in kept if not rater.scores]
    kept = [rater for rater in kept if rater.scores]
    if not kept:
        place = ", ".join(map(str, files[:3])) or "ANSWERS"
        raise InputError.of(place, "", "holds no answer to any question", "rate clips on the page, then save")
    shape = len(kept), len(key.methods), len(key.scenes)
    arrays = {question.key: np.zeros(shape, np.int64) for question in QUESTIONS}
    for r, rater in enumerate(kept):
        for clip, scores in rater.scores.items():
            method, scene = key.clips[clip]
            for name, score in scores.items():
                arrays[name][r, key.methods.index(method), key.scenes.index(scene)] = score
    return Answers(key, tuple(kept), arrays, tuple(notes))


def _rater(file: Path, key: Key) -> Rater:
    """Raises InputError with all problems of one file."""
    record = read_record(file, ANSWERS)
    problems = list[Problem]()

    def wrong(path: str, found: str, expected: str, fix: str) -> None:
        problems.append(Problem(Place(str(file)), path, found, expected, fix))

    if record.get("study") != key.study:
        expected = f'is another study than the key\'s "{key.study}"'
        fix = "name the key of this study with --key"
        raise InputError.of(str(file), shown(record.get("study")), expected, fix)
    name = " ".join(record["rater"].split())[:80] if isinstance(record.get("rater"), str) else ""
    if not name:
        wrong("rater", shown(record.get("rater")), "is no name", "write who answered")
    given = record.get("answers")
    if not isinstance(given, dict):
        wrong("answers", shown(given), "is no mapping", "save the page again")
        raise InputError(problems)
    scores: dict[str, dict[str, int]] = {}
    seconds = []
    for clip, answer in given.items():
        if clip not in key.clips:
            wrong(f"answers.{clip}"[:60], "", "is no clip of this study", "leave it out")
        elif not isinstance(answer, dict):
            expected = "is no mapping of questions to scores"
            wrong(f"answers.{clip}", shown(answer), expected, "save the page again")
        else:
            for question in QUESTIONS:
                value = answer.get(question.key)
                if value is None:
                    continue
                if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= POINTS:
                    fix = "write a whole number, or leave it out"
                    wrong(
                        f"answers.{clip}.{question.key}", shown(value), f"is no score from 1 to {POINTS}", fix
                    )
                else:
                    scores.setdefault(clip, {})[question.key] = value
            time = answer.get("seconds")
            if isinstance(time, int | float) and not isinstance(time, bool) and 0 <= time < 1e6:
                seconds.append(float(time))
    if problems:
        raise InputError(problems)
    session, saved = (record.get(k) if isinstance(record.get(k), str) else "" for k in ("session", "saved"))
    return Rater(name, file, str(session), str(saved), scores, tuple(seconds))


def _one_each(raters: Sequence[Rater]) -> tuple[list[Rater], list[str]]:
    """A person counts once. Raises InputError where a name stands for two."""
    by_name: dict[str, Rater] = {}
    notes: list[str] = []
    problems = []
    for rater in raters:
        before = by_name.setdefault(rater.name.casefold(), rater)
        if before is rater:
            continue
        if rater.scores != before.scores and (not rater.session or rater.session != before.session):
            expected = f"has other answers in {before.file}"
            fix = 'leave one file out, or, if they are two people, change "rater" in one'
            problems.append(Problem(Place(str(rater.file)), "rater", f'"{rater.name}"', expected, fix))
            continue
        last = max(before, rater, key=lambda one: (one.saved, len(one.scores)))
        by_name[rater.name.casefold()] = last
        other = before if last is rater else rater
        notes.append(
            f"{rater.name} saved more than once: {last.file.name} counts, {other.file.name} does not."
        )
    if problems:
        raise InputError(problems)
    return sorted(by_name.values(), key=lambda rater: natural(rater.name)), notes


# ---- statistics --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Mean:
    """With its 95 % interval; None where nothing is known, and no interval of a single answer."""

    mean: float | None
    low: float | None
    high: float | None


class Draws:
    """Bootstrap draws of raters and scenes, shared by all statistics of a study."""

    def __init__(self, raters: int, scenes: int, seed: int = 0) -> None:
        self.alone = raters == 1 and scenes == 1
        """Then nothing can be drawn."""
        random = np.random.default_rng(seed)
        self._raters, self._scenes = (
            random.multinomial(count, np.full(count, 1 / count), DRAWS).astype(np.float64)
            for count in (raters, scenes)
        )

    def sums(self, values: F64) -> F64:
        """(R, M, S) -> (B, M): their sum in every draw."""
        raters, methods, scenes = values.shape
        by_raters = (self._raters @ values.reshape(raters, -1)).reshape(-1, methods, scenes)
        return np.asarray((by_raters * self._scenes[:, None]).sum(axis=2), np.float64)


def means(scores: Scores, draws: Draws) -> list[Mean]:
    """One a method: of all answers that it got."""
    return _ratios(scores.astype(np.float64), (scores > 0).astype(np.float64), draws)


def _ratios(values: F64, weights: F64, draws: Draws) -> list[Mean]:
    """Means of (R, M, S) values by method, over `weights`, with intervals."""
    count, total = weights.sum(axis=(0, 2)), values.sum(axis=(0, 2))
    if draws.alone:
        return [Mean(float(t / n) if n else None, None, None) for t, n in zip(total, count, strict=True)]
    tops, below = draws.sums(values), draws.sums(weights)
    found = []
    for k, n in enumerate(count):
        has = below[:, k] > 0  # where answers are missing, a draw may hold none
        if not n or not has.any():
            found.append(Mean(None, None, None))
            continue
        ends = np.quantile(tops[has, k] / below[has, k], COVER).tolist() if n > 1 else (None, None)
        found.append(Mean(float(total[k] / n), *ends))
    return found


@dataclass(frozen=True)
class Agreement:
    """Krippendorff's alpha for ordinal data: 1 is perfect agreement, 0 is chance. With its 95 % interval."""

    alpha: float | None
    """None where it has no meaning: one rater, or the same score everywhere."""
    low: float | None = None
    high: float | None = None


def agreement(scores: Scores, seed: int = 0) -> Agreement:
    """Of (R, U) scores 1 to 5 that R raters gave U clips, 0 where a rater gave none.

    K. Krippendorff, Computing Krippendorff's Alpha-Reliability (2011), section E. The interval draws clips, not
    raters: a rater drawn twice would agree with himself.
    """
    counts = np.stack([(scores == point).sum(axis=0) for point in range(1, POINTS + 1)], axis=1).astype(
        np.float64
    )
    answers = counts.sum(axis=1)
    counts, answers = counts[answers > 1], answers[answers > 1]
    # (U, 5, 5): how often score c meets score k in a clip, a pair of raters weighing 1 / (answers - 1)
    pairs = counts[:, :, None] * counts[:, None, :] - counts[:, :, None] * np.eye(POINTS)
    units = pairs / (answers - 1)[:, None, None]
    alpha = float(_alphas(units.sum(axis=0, keepdims=True))[0])
    if not np.isfinite(alpha):
        return Agreement(None)
    if len(units) < 2:
        return Agreement(alpha)
    chances = np.full(len(units), 1 / len(units))
    drawn = np.random.default_rng(seed).multinomial(len(units), chances, CLIP_DRAWS).astype(np.float64)
    found = _alphas(np.tensordot(drawn, units, axes=1))
    found = found[np.isfinite(found)]
    low, high = np.quantile(found, COVER).tolist() if len(found) else (None, None)
    return Agreement(alpha, low, high)


def _alphas(met: F64) -> F64:
    """Of (B, 5, 5) coincidences; NaN where scores do not differ at all."""
    of_score = met.sum(axis=2)
    middle = np.cumsum(of_score, axis=1) - of_score / 2
    far = (middle[:, :, None] - middle[:, None, :]) ** 2  # the ordinal distance
    seen = (met * far).sum(axis=(1, 2))
    by_chance = (of_score[:, :, None] * of_score[:, None, :] * far).sum(axis=(1, 2))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(1 - (of_score.sum(axis=1) - 1) * seen / by_chance, np.float64)


@dataclass(frozen=True)
class Pair:
    """One method against another in one question."""

    one: int
    other: int
    """Methods, from 0."""
    apart: Mean
    """Mean of `one` less that of `other`."""
    better: int
    even: int
    worse: int
    """Answers of one rater to one scene in which `one` has more, as much, less."""
    by_raters: float | None
    by_videos: float | None
    """p, two-sided; None for one rater or one video alone, or where no rater scored both methods."""
    adjusted: float | None = None
    """The larger of them after Holm, for all pairs of a question."""

    @property
    def p(self) -> float | None:
        """The larger of the two."""
        return max((p for p in (self.by_raters, self.by_videos) if p is not None), default=None)


def pairs(scores: Scores, draws: Draws, seed: int = 0) -> list[Pair]:
    """Every two methods of (R, M, S) scores."""
    found = []
    for one, other in combinations(range(scores.shape[1]), 2):
        both = (scores[:, one] > 0) & (scores[:, other] > 0)
        apart = np.where(both, scores[:, one] - scores[:, other], 0)
        p = []
        for axis, units in ((1, scores.shape[0]), (0, scores.shape[2])):
            count = both.sum(axis=axis)
            differences = np.asarray(apart.sum(axis=axis)[count > 0] / count[count > 0], np.float64)
            p.append(sign_flip(differences, seed) if units > 1 and both.any() else None)
        mean = _ratios(apart[:, None].astype(np.float64), both[:, None].astype(np.float64), draws)[0]
        better, even, worse = (int(some.sum()) for some in (apart > 0, both & (apart == 0), apart < 0))
        found.append(Pair(one, other, mean, better, even, worse, *p))
    adjusted = holm([pair.p for pair in found])
    return [replace(pair, adjusted=p) for pair, p in zip(found, adjusted, strict=True)]


def sign_flip(values: F64, seed: int = 0) -> float:
    """p, two-sided, of a mean as far from 0 as that of `values` (n,) under random signs; exact up to 16 values."""
    n = len(values)
    if n == 0:
        return 1.0
    seen = abs(values.sum()) * (1 - 1e-12) - 1e-12
    if n <= EXACT:
        signs = 1 - 2 * ((np.arange(2**n)[:, None] >> np.arange(n)) & 1)
        return float((np.abs(signs @ values) >= seen).mean())
    signs = 1 - 2 * np.random.default_rng(seed).integers(0, 2, (SIGN_DRAWS, n), np.int8)
    return float((1 + (np.abs(signs @ values) >= seen).sum()) / (1 + SIGN_DRAWS))


def holm(found: Sequence[float | None]) -> list[float | None]:
    """p of several tests, adjusted so that the chance of any false alarm is kept (S. Holm, 1979).

    >>> holm([0.01, 0.04, None, 0.03])
    [0.03, 0.06, None, 0.06]
    """
    known = sorted((p, k) for k, p in enumerate(found) if p is not None)
    adjusted: list[float | None] = [None] * len(found)
    most = 0.0
    for rank, (p, k) in enumerate(known):
        most = max(most, min((len(known) - rank) * p, 1.0))
        adjusted[k] = most
    return adjusted


# ---- report ------------------------------------------------------------------------------------------------------

PAIRED = (
    "Each line takes the answers in which one rater scored both methods in the same scene. p is of a test that flips "
    "signs, two-sided, made once with raters and once with videos as what varies. A difference that is to hold for "
    "others of both needs both small: the last column is the larger, adjusted by Holm for the number of lines."
)
ALPHA = (
    "Krippendorff's alpha for ordinal data: 1 is perfect agreement, 0 what chance would give. From 0.8 up raters agree "
    "well, from 0.667 up enough for tentative conclusions (Krippendorff 2004). The interval draws clips again."
)
THEIRS = (
    "Means of the paper's own study: 14 participants, 15 videos a method. Other videos and other people: they stand "
    "here for the scale's sake, not to be compared digit by digit."
)


def findings(answers: Answers, plots: bool = False, seed: int = 0) -> Findings:
    """With the figures of the page, where `plots` asks for them."""
    key, scores = answers.key, answers.scores
    names, raters = key.methods, len(answers.raters)
    draws = Draws(raters, len(key.scenes), seed)
    mean = {q.key: means(scores[q.key], draws) for q in QUESTIONS}
    physical, photo = (mean[q.key] for q in QUESTIONS)
    order = sorted(range(len(names)), key=lambda m: (-(physical[m].mean or 0), -(photo[m].mean or 0)))
    compared = {q.key: pairs(scores[q.key], draws, seed) for q in QUESTIONS}
    alike = {q.key: agreement(scores[q.key].reshape(raters, -1), seed) for q in QUESTIONS}
    counts = {
        q.key: [
            [int((scores[q.key][:, m] == point).sum()) for point in range(1, 6)] for m in range(len(names))
        ]
        for q in QUESTIONS
    }
    parts: list[Table | Figure] = []
    for q in QUESTIONS:
        if plots:
            parts.append(
                _distribution(q.name, [(names[m], counts[q.key][m], mean[q.key][m].mean) for m in order])
            )
        lines = tuple((names[m], *map(str, counts[q.key][m])) for m in order)
        parts.append(Table(("method", "1", "2", "3", "4", "5"), lines, q.name))
    sections = [
        Section("Means", (_interval_note(answers),), (_mean_table(names, mean, order),)),
        Section("Distribution of scores", (), tuple(parts)),
    ]
    if len(names) > 1:
        tables = tuple(_pair_table(q.name, names, compared[q.key], order) for q in QUESTIONS)
        sections.append(Section("Methods against each other", (PAIRED, *_limits(answers)), tables))
    theirs = Table(
        ("method", *(q.name for q in QUESTIONS)), tuple((n, f"{a:.2f}", f"{b:.2f}") for n, a, b in PAPER)
    )
    sections += [
        Section("Agreement between raters", (ALPHA,), (_agreement_table(alike), _rater_table(answers))),
        Section("Scene by scene", (), (_scene_table(answers, order),)),
        Section("The paper", (THEIRS,), (theirs,)),
    ]
    rows = []
    for m in order:
        row: dict[str, Any] = {"method": names[m]}
        for q in QUESTIONS:
            own = counts[q.key][m]
            row[q.key] = {**asdict(mean[q.key][m]), "answers": sum(own), "counts": own}
        rows.append(row)
    more = {
        "study": key.study,
        "raters": raters,
        "videos": len(key.scenes),
        "clips": len(key.clips),
        "interval": f"95 %, {DRAWS} bootstrap draws of raters and videos, seed {seed}",
        "agreement": {q.key: asdict(alike[q.key]) for q in QUESTIONS},
        "comparisons": {
            q.key: [
                {**asdict(pair), "one": names[pair.one], "other": names[pair.other]}
                for pair in compared[q.key]
            ]
            for q in QUESTIONS
        },
        "notes": list(answers.notes),
    }
    title = f"Human evaluation of {counted(len(names), 'method')}"
    sentences = tuple(_sentences(answers, mean, compared, order))
    return Findings("study", title, sentences, tuple(sections), rows, more=more)


def _sentences(
    answers: Answers, mean: Mapping[str, list[Mean]], compared: Mapping[str, list[Pair]], order: Sequence[int]
) -> list[str]:
    key, raters, videos = answers.key, len(answers.raters), len(answers.key.scenes)
    lines = [f"{q.name}: {_leader(key.methods, mean[q.key], compared[q.key], order)}" for q in QUESTIONS]
    given = sum(int((answers.scores[q.key] > 0).sum()) for q in QUESTIONS)
    asked = len(key.clips) * raters * len(QUESTIONS)
    text = f"{counted(raters, 'rater')}, {counted(videos, 'video')} a method, {given} answers"
    lines.append(f"{text}." if given == asked else f"{text}; {asked - given} of {asked} are missing.")
    if raters == 1:
        lines.append(
            "One rater alone: what others would answer is not known, and intervals are over videos only."
        )
    elif raters < FEW or videos < FEW:
        lines.append(f"With fewer than {FEW} raters or videos, intervals are narrower than they should be.")
    return [*lines, *answers.notes]


def _leader(names: Sequence[str], mean: Sequence[Mean], pairs: Sequence[Pair], order: Sequence[int]) -> str:
    """The best method, and those of which that is not sure."""
    known = [m for m in order if mean[m].mean is not None]
    if not known:
        return "no rater answered."
    best = max(known, key=lambda m: mean[m].mean or 0)
    ends = interval(mean[best].low, mean[best].high)
    value = number(mean[best].mean) + ("" if ends == "-" else f" {ends}")
    if len(known) == 1:
        return f"{names[best]}{' alone was rated,' if len(names) > 1 else ''} {value} of 5."
    even = [m for m in known if number(mean[m].mean) == number(mean[best].mean)]
    if len(even) > 1:
        return f"{' and '.join(names[m] for m in even)} score alike, {number(mean[best].mean)} of 5."
    doubtful = []
    for pair in pairs:
        other = pair.other if pair.one == best else pair.one
        if best in (pair.one, pair.other) and other in known:
            if pair.adjusted is None:
                doubtful.append(names[other])
            elif pair.adjusted >= SIGNIFICANT:
                doubtful.append(f"{names[other]} (p {_p(pair.adjusted)})")
    unsure = f", not surely more than {', '.join(doubtful)}" if doubtful else ""
    return f"{names[best]} scores highest, {value} of 5{unsure}."


def _limits(answers: Answers) -> list[str]:
    """Where there are too few for a small p."""
    limits = []
    for count, what in ((len(answers.raters), "rater"), (len(answers.key.scenes), "video")):
        least = 2 ** (1 - count)
        if count > 1 and least > SIGNIFICANT:
            limits.append(
                f"{counted(count, what)} cannot give a p below {least:g}, however clear the difference."
            )
    return limits


def _interval_note(answers: Answers) -> str:
    over = [
        what for what, some in (("raters", answers.raters), ("videos", answers.key.scenes)) if len(some) > 1
    ]
    if not over:
        return "One rater and one video have no interval."
    return f"In brackets the 95 % interval: a bootstrap over {' and '.join(over)}, {DRAWS} draws."


def _mean_table(names: Sequence[str], mean: Mapping[str, list[Mean]], order: Sequence[int]) -> Table:
    heads = ["method"]
    for q in QUESTIONS:
        heads += [q.name, "95 %"]
    rows = []
    for m in order:
        row = [names[m]]
        for q in QUESTIONS:
            found = mean[q.key][m]
            row += [number(found.mean), interval(found.low, found.high)]
        rows.append(tuple(row))
    return Table(tuple(heads), tuple(rows), note="1 is strongly disagree, 5 strongly agree.")


def _pair_table(title: str, names: Sequence[str], compared: Sequence[Pair], order: Sequence[int]) -> Table:
    heads = (
        "method",
        "against",
        "difference",
        "95 %",
        "better, even, worse",
        "p by raters",
        "by videos",
        "adjusted",
    )
    place = {m: k for k, m in enumerate(order)}
    lines = []
    for pair in sorted(compared, key=lambda p: sorted((place[p.one], place[p.other]))):
        way = -1 if place[pair.one] > place[pair.other] else 1  # the one ahead comes first
        one, other = (pair.one, pair.other)[::way]
        low, high = (None if end is None else way * end for end in (pair.apart.low, pair.apart.high)[::way])
        difference = None if pair.apart.mean is None else way * pair.apart.mean
        wins = ", ".join(map(str, (pair.better, pair.even, pair.worse)[::way]))
        p = map(_p, (pair.by_raters, pair.by_videos, pair.adjusted))
        lines.append(
            (names[one], names[other], number(difference, "+.2f"), interval(low, high, "+.2f"), wins, *p)
        )
    return Table(heads, tuple(lines), title)


def _agreement_table(alike: Mapping[str, Agreement]) -> Table:
    found = [(q.name, alike[q.key]) for q in QUESTIONS]
    rows = tuple((name, number(one.alpha), interval(one.low, one.high)) for name, one in found)
    unknown = any(one.alpha is None for _, one in found)
    note = "-: it has no value, for one rater alone or where all scores are the same." if unknown else ""
    return Table(("question", "alpha", "95 %"), rows, note=note)


def _mean_of(scores: Scores, form: str) -> str:
    return number(float(scores[scores > 0].mean()) if (scores > 0).any() else None, form)


def _rater_table(answers: Answers) -> Table:
    rows = []
    for r, rater in enumerate(answers.raters):
        own = (_mean_of(answers.scores[q.key][r], ".2f") for q in QUESTIONS)
        pace = number(median(rater.seconds) if rater.seconds else None, ".0f")
        rows.append((rater.name, f"{len(rater.scores)} of {len(answers.key.clips)}", *own, pace))
    heads = ("rater", "clips", *(f"mean {q.name}" for q in QUESTIONS), "s a clip")
    return Table(heads, tuple(rows))


def _scene_table(answers: Answers, order: Sequence[int]) -> Table:
    """Both means in one cell: the table stays narrow."""
    rows = tuple(
        (
            scene,
            *(" / ".join(_mean_of(answers.scores[q.key][:, m, s], ".1f") for q in QUESTIONS) for m in order),
        )
        for s, scene in enumerate(answers.key.scenes)
    )
    note = f"Means of {' / '.join(q.name for q in QUESTIONS)}."
    return Table(("scene", *(answers.key.methods[m] for m in order)), rows, note=note)


def _p(value: float | None) -> str:
    return "< 0.001" if value is not None and value < 0.001 else number(value, ".3f")


COLOURS = ("#b3491b", "#eba97c", "#dedede", "#8dbfe0", "#1f6fae")
"""From disagreement to agreement, distinct for colour-blind eyes and ordered in grey."""
INKS = ("#ffffff", "#1a1a1a", "#1a1a1a", "#1a1a1a", "#ffffff")
LEAST_SHARE = 5.5
"""% of a bar that has room for its number."""
LONGEST = 60
"""Letters of a name."""


def _distribution(name: str, methods: Sequence[tuple[str, Sequence[int], float | None]]) -> Figure:
    """Of one question: a bar a method (name, counts of the scores 1 to 5, mean), as in the paper's appendix."""

    def draw(axes: Axes, palette: Palette) -> None:
        for row, (method, counts, mean) in enumerate(methods):
            whole, left = max(sum(counts), 1), 0.0
            for score, count in enumerate(counts):
                share = 100 * count / whole
                axes.barh(-row, share, 0.5, left=left, color=COLOURS[score], linewidth=0)
                if share >= LEAST_SHARE:
                    middle, ink = left + share / 2, INKS[score]
                    axes.text(
                        middle, -row, f"{share:.0f} %", ha="center", va="center", color=ink, fontsize=6.5
                    )
                left += share
            short = method if len(method) <= LONGEST else method[: LONGEST - 1] + "…"
            axes.text(0, 0.31 - row, short, ha="left", va="bottom", weight="bold")
            if mean is not None:
                axes.text(100, 0.31 - row, f"mean {mean:.2f}", ha="right", va="bottom")
        key = [axes.barh(0, 0, color=colour, label=f"{k + 1} {SCALE[k]}") for k, colour in enumerate(COLOURS)]
        axes.legend(
            handles=key, loc="upper center", bbox_to_anchor=(0.5, 1.02), ncol=5,
            handlelength=1.0, columnspacing=1.1, borderaxespad=0,
        )  # fmt: skip
        axes.set(xlim=(0, 100), ylim=(-len(methods) + 0.6, 1.48), yticks=[])
        axes.spines["left"].set_visible(False)
        axes.set_xlabel(f"{name}: share of all answers, %")

    about = (
        f"Distribution of {name} scores by method, from 1, strongly disagree, to 5, strongly agree. The table below "
        "has the numbers."
    )
    return plotted(draw, about, height=26.0 + 11.0 * len(methods))
