"""Problems of an input, as data: collected, sorted by place, printed together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, NamedTuple, TypeVar

T = TypeVar("T")


class Place(NamedTuple):
    """Where a value was written: a file with line and column from 1, or a flag (line 0)."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file


UNKNOWN_PLACE = Place("scene")
"""Place of a problem that only shows as the scene runs; `Scene.located` finds its line."""

THIS_PHOTO = Place("the photo")
"""Place of a problem of a photo, if one photo alone is perceived."""


class Severity(Enum):
    """An error stops the command with exit code 2.

    A warning does not, unless `--strict` is given.
    """

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True)
class Problem:
    """One error or warning, with its fix.

    `str(problem)` is `file:line:column: path: found expected; fix`, for example
    `scene.yaml:14:11: objects.cue.mass: "heavy" is not a number; write grams, e.g. 170`.
    """

    place: Place
    path: str
    """Dotted path of the value in the scene, `""` for the file as a whole."""
    found: str
    """What was written, quoted and cut to a readable length."""
    expected: str
    """What is wrong with it, as a verb phrase: `is not a number`."""
    fix: str
    """What to do, as an imperative: `write grams, e.g. 170`."""
    severity: Severity = Severity.ERROR
    variant: str = ""
    """Name of the variant whose edits are wrong, `""` for the file itself."""
    origin: Place | None = None
    """Where the wrong value was written, if an overlay at `place` made it wrong."""
    code: str = ""
    """Name of the template in `physgen.messages`, or of the limit: `not-a-number`."""

    def __str__(self) -> str:
        parts = [str(self.place)]
        if self.variant:
            parts.append(f"variant {self.variant}")
        if self.path:
            parts.append(self.path)
        if self.severity is Severity.WARNING:
            parts.append("warning")
        words = [self.found, self.expected]
        if self.origin is not None:
            words.append(f"({self.origin})")
        parts.append(" ".join(filter(None, words)))
        text = ": ".join(parts)
        if self.fix:
            text += f"; {self.fix}"
        # A file may contain control characters, which could drive a terminal.
        return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)

    def refusal(self) -> RefusedError:
        """Return the refusal of the value, without its place."""
        return RefusedError(self.expected, self.fix, self.code)

    def as_dict(self) -> dict[str, object]:
        """Return the problem as JSON, for `--json`."""
        return {
            "code": self.code,
            "file": self.place.file,
            "line": self.place.line,
            "column": self.place.column,
            "path": self.path,
            "found": self.found,
            "expected": self.expected,
            "fix": self.fix,
            "severity": self.severity.value,
            "variant": self.variant or None,
            "origin": None if self.origin is None else str(self.origin),
        }


def as_warnings(problems: Iterable[Problem]) -> list[Problem]:
    """Return the problems as warnings."""
    return [replace(problem, severity=Severity.WARNING) for problem in problems]


Warn = Callable[[Problem], None]
"""Receives warnings: what is allowed and probably not intended."""


def ignore_warning(problem: Problem) -> None:
    """Do nothing with a warning."""


def by_place(problems: Iterable[Problem]) -> list[Problem]:
    """Return the problems sorted by file, line, column and path."""
    return sorted(problems, key=lambda p: (p.place, p.path, p.expected))


class InputError(Exception):
    """An input cannot be used; carries every problem found, sorted.

    The command line prints them and exits 2.
    """

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = by_place(problems)
        super().__init__("\n".join(map(str, self.problems)))

    @classmethod
    def of(cls, file: str, found: str, expected: str, fix: str) -> InputError:
        """Return the error of one problem with a whole file or a flag."""
        return cls([Problem(Place(file), "", found, expected, fix)])


@contextmanager
def variant_named(variant: str | None) -> Iterator[None]:
    """Name the variant, if there is one, in the problems that the block raises."""
    try:
        yield
    except InputError as error:
        if variant is None:
            raise
        raise InputError(
            problem if problem.variant else replace(problem, variant=variant)
            for problem in error.problems
        ) from None


class OutputError(InputError):
    """No file can be written into the output folder, whatever the input is."""


def collect(calls: Iterable[Callable[[], T]]) -> list[T]:
    """Return the results of all calls. Raises InputError with the problems of all, each once."""
    results: list[T] = []
    problems: list[Problem] = []
    for call in calls:
        try:
            results.append(call())
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(dict.fromkeys(problems))
    return results


class RefusedError(ValueError):
    """One value that cannot be used.

    `expected` and `fix` become those of a Problem where its place is known.
    """

    def __init__(self, expected: str, fix: str, code: str = "") -> None:
        super().__init__(expected)
        self.expected, self.fix, self.code = expected, fix, code

    def problem(
        self,
        place: Place,
        path: str = "",
        found: str = "",
        severity: Severity = Severity.ERROR,
    ) -> Problem:
        """Return the problem of the value at its place."""
        problem = Problem(place, path, found, self.expected, self.fix, severity)
        return replace(problem, code=self.code)


MIB = 2**20
_UNITS = {"MiB": MIB, "megapixels": 10**6}


class Limit(Enum):
    """What an input holds at most, since it may come from anybody; docs/scene.md lists all of them.

    Each is the amount and its unit, what it counts, the message beyond it with `{}` for the amount, what to do, and the
    reason for the amount. Corners of outlines and ranges of values are limited by the schema.
    """

    BYTES = (8 * MIB, "MiB", "size of a scene file", "larger than {}", "keep pixels in image files",
             "10,000 objects, each with an outline of 50 corners")  # fmt: skip
    DEPTH = (
        50,
        "levels",
        "nesting",
        "nested deeper than {}",
        "nest less",
        "far more than the schema's 9",
    )
    VALUES = (500_000, "values", "keys and values of a file", "more than {}", "keep pixels in image files",
              "what 8 MiB hold; some seconds to check")  # fmt: skip
    OBJECTS = (
        10_000,
        "objects",
        "objects",
        "more than {}",
        "split the scene",
        "a step takes 0.1 s",
    )
    EXTENDS = (10, "files", "`extends`", "is one of more than {} that extend each other",
               "extend fewer files", "far more than people keep in mind")  # fmt: skip
    CHECKS = (3_000_000, "edits times values", "variants: their edits times the scene's values", "are over {}",
              "use sweep", "each variant is checked as a whole: some 10 s")  # fmt: skip
    SET = (200_000, "values", "values that variants set, at each place of a `*`",
           "sets more than {}, with the edits before it", "name fewer objects", "some 5 s")  # fmt: skip
    CROSSINGS = (2_000_000, "pairs", "an outline's lines near each other", "is too tangled to check, with over {}",
                 "simplify it", "a contour of 20,000 corners has some 80,000")  # fmt: skip
    NAME = (255, "bytes", "name of a file", "has too long a name", "write a name of at most {}",
            "what file systems allow")  # fmt: skip
    PIXELS = (10**8, "megapixels", "picture, canvas or video", "is over {}", "make it smaller",
              "0.3 GB a picture")  # fmt: skip
    IDS = (10_000, "ids", "ids of a label map", "are too many for a label map",
           "give each object one colour; at most {}", "as many as objects")  # fmt: skip
    PULLS = (1_000_000, "", "fields times objects that each acts on", "of fields on objects are too many",
             "name the objects of each field, at most {} in all", "every step looks at all: 0.1 s")  # fmt: skip
    STEPS = (20_000_000, "", "duration times steps_per_second", "from duration times steps_per_second are too many",
             "make it at most {}", "some hours")  # fmt: skip
    FRAMES = (
        100_000,
        "",
        "duration times fps times slow",
        "are too many",
        "at most {}",
        "an hour of video",
    )
    POSES = (20_000_000, "", "samples times objects of one motion", "are too many to hold",
             "keep samples x objects below {}", "2 GB")  # fmt: skip

    def __init__(
        self, most: int, unit: str, what: str, expected: str, fix: str, reason: str
    ) -> None:
        self.most, self.what, self.reason = most, what, reason
        self.amount = f"{most // _UNITS.get(unit, 1):,} {unit}".strip()
        self.expected, self.fix = expected.format(self.amount), fix.format(self.amount)

    @property
    def code(self) -> str:
        """Name of the limit in problems: `limit-pixels`."""
        return f"limit-{self.name.lower()}"

    def problem(self, place: Place, path: str = "", found: str = "") -> Problem:
        """Return the problem of an input that exceeds the limit."""
        return self.refusal().problem(place, path, found)

    def refusal(self) -> RefusedError:
        """Return the refusal of a value that exceeds the limit."""
        return RefusedError(self.expected, self.fix, self.code)

    def error(self, place: Place, path: str = "", found: str = "") -> InputError:
        """Return the error of an input that exceeds the limit."""
        return InputError([self.problem(place, path, found)])


# Refusals of the editor, and of edits of a file


class EditRefusal(Enum):
    """What kind of refusal it is; the value is HTTP's number for it."""

    MALFORMED = 400
    """The request itself is not what the interface says."""
    UNTRUSTED = 401
    FOREIGN = 403
    ABSENT = 404
    STALE = 409
    """It was asked of a state that is gone, or the file on disk is another by now."""
    TOO_LARGE = 413
    KIND = 415
    IMPOSSIBLE = 422
    """It is well asked, and cannot be done to this scene."""


class EditError(Exception):
    """Raised wherever an edit, or a request, is refused.

    `more` goes beside `error` in the answer.
    """

    def __init__(
        self,
        why: EditRefusal,
        message: str,
        fix: str,
        more: Mapping[str, Any] | None = None,
        code: str = "",
    ) -> None:
        super().__init__(message)
        self.why, self.message, self.fix, self.code = why, message, fix, code
        self.more: Mapping[str, Any] = more or {}

    def body(self) -> dict[str, Any]:
        """Return the answer as JSON."""
        error = {"code": self.code, "message": self.message, "fix": self.fix}
        return {"error": error, "problems": [], **self.more}


def impossible(message: str, fix: str) -> EditError:
    """Return the error of an operation that cannot be made on this scene."""
    return EditError(EditRefusal.IMPOSSIBLE, message, fix)


def overtaken() -> EditError:
    """Return the error of a request that a newer one replaced."""
    return EditError(
        EditRefusal.STALE,
        "a newer request overtook this one",
        "wait for that one",
        {"overtaken": True},
    )
