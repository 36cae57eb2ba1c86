"""Files that raters saved, and the study's key -> scores by rater, method and scene; or all that is wrong with
them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from physgen.evaluate.study.intervals import Scores
from physgen.evaluate.study.key import Key
from physgen.evaluate.study.questions import QUESTIONS
from physgen.evaluate.study.told import ANSWERS, told
from physgen.problems import InputError, Place, Problem
from physgen.text import natural, shown

LOWEST, HIGHEST = 1, 5


@dataclass(frozen=True)
class Rater:
    """What one person answered."""

    name: str
    file: Path
    session: str
    """Of one person at one browser: two files of one session are of the same person."""
    saved: str
    """When, as ISO 8601; empty where the file does not say."""
    scores: Mapping[str, Mapping[str, int]]
    """Clip -> question -> 1 to 5; clips that were left out are not there."""
    seconds: tuple[float, ...]
    """That each clip was looked at."""

    @property
    def pace(self) -> float | None:
        """Median s a clip."""
        return median(self.seconds) if self.seconds else None


@dataclass(frozen=True)
class Answers:
    """Of all raters."""

    key: Key
    raters: tuple[Rater, ...]
    scores: Mapping[str, Scores]
    """Question -> (R, M, S): 1 to 5, 0 where there is none."""
    notes: tuple[str, ...]
    """What was left out, and why."""


def files_in(paths: Sequence[Path], key: Path) -> list[Path]:
    """Each file once; of a folder, its *.json but the key. Raises InputError where a folder has none."""
    found: dict[Path, Path] = {}
    for path in paths:
        inside = [path]
        if path.is_dir():
            inside = sorted(path.glob("*.json"), key=lambda p: natural(p.name))
            inside = [p for p in inside if p.resolve() != key.resolve()]
            if not inside:
                raise InputError.of(
                    str(path), "", "holds no answers (*.json)", "name files that the page saved"
                )
        for file in inside:
            found.setdefault(file.resolve(), file)
    return list(found.values())


def answers_in(folder: Path) -> bool:
    """Whether raters' files lie in it."""
    for file in folder.glob("*.json") if folder.is_dir() else ():
        with suppress(InputError):
            told(file, ANSWERS)
            return True
    return False


def read_answers(files: Sequence[Path], key: Key) -> Answers:
    """Raises InputError with everything that is wrong in any of them."""
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
    silent = [rater for rater in kept if not rater.scores]
    notes += [f"{rater.name} answered nothing and is left out." for rater in silent]
    kept = [rater for rater in kept if rater.scores]
    if not kept:
        place = ", ".join(map(str, files[:3])) or "ANSWERS"
        raise InputError.of(place, "", "holds no answer to any question", "rate clips on the page, then save")
    return Answers(key, tuple(kept), _arrays(kept, key), tuple(notes))


def _rater(file: Path, key: Key) -> Rater:
    """Raises InputError with all that is wrong in one file."""
    record = told(file, ANSWERS)
    place, problems = Place(str(file)), list[Problem]()
    if record.get("study") != key.study:
        expected = f'is another study than the key\'s "{key.study}"'
        raise InputError.of(
            str(file), shown(record.get("study")), expected, "name the key of this study with --key"
        )
    name = " ".join(record["rater"].split())[:80] if isinstance(record.get("rater"), str) else ""
    if not name:
        problems.append(
            Problem(place, "rater", shown(record.get("rater")), "is no name", "write who answered")
        )
    given = record.get("answers")
    if not isinstance(given, dict):
        raise InputError(
            [*problems, Problem(place, "answers", shown(given), "is no mapping", "save the page again")]
        )
    scores: dict[str, dict[str, int]] = {}
    seconds = []
    for clip, answer in given.items():
        if clip not in key.clips:
            problems.append(
                Problem(place, f"answers.{clip}"[:60], "", "is no clip of this study", "leave it out")
            )
        elif not isinstance(answer, dict):
            expected = "is no mapping of questions to scores"
            problems.append(Problem(place, f"answers.{clip}", shown(answer), expected, "save the page again"))
        else:
            scores[clip], wrong = _scores(answer, f"answers.{clip}", place)
            problems += wrong
            time = answer.get("seconds")
            if isinstance(time, int | float) and not isinstance(time, bool) and 0 <= time < 1e6:
                seconds.append(float(time))
    if problems:
        raise InputError(problems)
    scores = {clip: found for clip, found in scores.items() if found}
    session, saved = (
        record.get(part) if isinstance(record.get(part), str) else "" for part in ("session", "saved")
    )
    return Rater(name, file, str(session), str(saved), scores, tuple(seconds))


def _scores(answer: Mapping[str, Any], path: str, place: Place) -> tuple[dict[str, int], list[Problem]]:
    """Of one clip; an answer that is missing, or null, is none."""
    found, problems = {}, []
    for question in QUESTIONS:
        value = answer.get(question.key)
        if value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, int) or not LOWEST <= value <= HIGHEST:
            expected = f"is no score from {LOWEST} to {HIGHEST}"
            fix = "write a whole number, or leave it out"
            problems.append(Problem(place, f"{path}.{question.key}", shown(value), expected, fix))
        else:
            found[question.key] = value
    return found, problems


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
            found, expected = f'"{rater.name}"', f"has other answers in {before.file}"
            fix = 'leave one file out, or, if they are two people, change "rater" in one'
            problems.append(Problem(Place(str(rater.file)), "rater", found, expected, fix))
            continue
        last = max(before, rater, key=lambda r: (r.saved, len(r.scores)))
        by_name[rater.name.casefold()] = last
        other = before if last is rater else rater
        notes.append(
            f"{rater.name} saved more than once: {last.file.name} counts, {other.file.name} does not."
        )
    if problems:
        raise InputError(problems)
    return sorted(by_name.values(), key=lambda rater: natural(rater.name)), notes


def _arrays(raters: Sequence[Rater], key: Key) -> dict[str, Scores]:
    """0 where there is no answer."""
    shape = len(raters), len(key.methods), len(key.scenes)
    arrays = {question.key: np.zeros(shape, np.int64) for question in QUESTIONS}
    for r, rater in enumerate(raters):
        for clip, scores in rater.scores.items():
            method, scene = key.clips[clip]
            for name, score in scores.items():
                arrays[name][r, key.methods.index(method), key.scenes.index(scene)] = score
    return arrays
