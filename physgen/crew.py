"""Who fills each role of perception, and how it went: choices -> backends called in turn, timed, and let go again."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from physgen import backends
from physgen.backends import Backend, Setup
from physgen.problems import InputError, Place, Problem, Severity

Warn = Callable[[Problem], None]
FLAG = Place("--backend")


@dataclass(frozen=True)
class Choice:
    """One backend of a role, as `--backend` or a configuration names it."""

    name: str
    weights: str = ""
    """A hub id, or a path of weights or of a map; `""`: the row's own."""
    place: Place = field(default=FLAG, compare=False)
    """Where it was written."""

    def __str__(self) -> str:
        return f"{self.name}:{self.weights}" if self.weights else self.name


@dataclass(frozen=True)
class Plan:
    """Who shall do what, and with what; nothing is imported yet."""

    choices: Mapping[str, Choice] = field(default_factory=dict)
    """By role; the others are filled by their defaults."""
    device: str = "auto"
    dtype: str = "auto"
    keep: bool = False
    """Whether models stay in memory once their role is done, for the next photo."""
    fallback: bool = False
    """Whether the default of a role takes over from a backend that fails."""
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Tables of the configuration, by backend."""

    def row(self, role: str) -> Backend:
        """The row of the table that fills `role`."""
        choice = self.choices.get(role)
        return backends.find(role, choice.name if choice else None)

    def setup(self, role: str) -> Setup:
        """What its factory is told."""
        choice = self.choices.get(role)
        options = self.options.get(self.row(role).name, {})
        return Setup(choice.weights if choice else "", self.device, self.dtype, options)

    def of(self, roles: Iterable[str]) -> Plan:
        """The same without what was chosen for other roles: a crew makes, and checks, all that is chosen."""
        kept = set(roles)
        return replace(self, choices={role: who for role, who in self.choices.items() if role in kept})


def choices(settings: Iterable[str], place: Place = FLAG) -> dict[str, Choice]:
    """`["segment=sam3:models/sam3", ...]` -> role -> Choice. Raises InputError with every wrong one.

    >>> str(choices(["inpaint=fill"])["inpaint"])
    'fill'
    """
    result: dict[str, Choice] = {}
    problems: list[Problem] = []
    for setting in settings:
        role, sign, text = setting.partition("=")
        name, colon, weights = text.partition(":")
        try:
            if not sign:
                raise InputError(
                    [Problem(place, "", f'"{setting}"', "is not ROLE=NAME", "write e.g. inpaint=fill")]
                )
            result[role] = choice(role, name, weights, place, bool(colon))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return result


def choice(role: str, name: str, weights: str = "", place: Place = FLAG, colon: bool = False) -> Choice:
    """A choice that the table knows. Raises InputError."""
    try:
        row = backends.find(role, name)
    except InputError as error:
        raise InputError([Problem(place, "", p.found, p.expected, p.fix) for p in error.problems]) from None
    said = f'"{role}={name}{":" if colon or weights else ""}{weights}"'
    takes = bool(row.weights or row.told)
    if (colon or weights) and not takes:
        raise InputError(
            [Problem(place, "", said, "names weights for what has none", f"write {role}={name}")]
        )
    if colon and not weights:
        raise InputError(
            [Problem(place, "", said, "names nothing after the colon", f"write {role}={name}:PATH")]
        )
    return Choice(name, weights, place)


@dataclass
class Step:
    """How one role went, for the record."""

    role: str
    backend: str
    weights: str
    seconds: float
    instead_of: str = ""
    """What had been chosen and failed."""
    because: str = ""
    """How it failed."""
    note: Mapping[str, Any] = field(default_factory=dict)
    """What the backend says of its run: device, requests, tokens ..."""


def _unheard(problem: Problem) -> None:
    """Warnings that nobody reads."""


class Crew:
    """Backends by role, made when first called.

    A backend may have `close()`, which lets its model go, and `note()`, a mapping for the record.
    """

    def __init__(self, plan: Plan | None = None, warn: Warn = _unheard) -> None:
        """Raises InputError with everything that the plan needs and that is not here."""
        self.plan = plan or Plan()
        self.steps: list[Step] = []
        self._warn = warn
        self._made: dict[str, Any] = {}
        self._fallen: set[str] = set()
        problems: list[Problem] = []
        for role, said in self.plan.choices.items():
            missing = backends.unmet(self.plan.row(role))
            if self.plan.fallback:
                continue  # what fails is told when its turn comes
            if missing is not None:
                problems.append(replace(missing, place=said.place))
                continue
            try:
                self.get(role)  # no weights are loaded yet
            except InputError as error:
                problems += [p if p.place != FLAG else replace(p, place=said.place) for p in error.problems]
        if "depth" in self.plan.row("boundary").uses and self.plan.row("depth").name == "none":
            place = self.plan.choices["boundary"].place
            fix = "choose who tells depth, too: depth=depth-anything, or depth=file:PATH"
            problems.append(
                Problem(place, "", f'"boundary={self.plan.choices["boundary"]}"', "needs depth", fix)
            )
        if problems:
            raise InputError(problems)

    def begin(self, warn: Warn = _unheard) -> None:
        """Another photo: the record starts anew, and what failed on the last is tried again."""
        self.steps, self._warn = [], warn
        for role in self._fallen:  # the stand-in goes, the chosen one is made again
            self.close(role)
        self._fallen.clear()

    def row(self, role: str) -> Backend:
        """The row that fills `role`: the default where the chosen one has failed."""
        return backends.find(role) if role in self._fallen else self.plan.row(role)

    def name(self, role: str) -> str:
        """The row's name, for `from`."""
        return self.row(role).name

    def get(self, role: str) -> Any:
        """The backend itself."""
        if role not in self._made:
            setup = Setup() if role in self._fallen else self.plan.setup(role)
            self._made[role] = backends.make(role, self.name(role), setup)
        return self._made[role]

    def call(self, role: str, *arguments: Any, **extra: Any) -> Any:
        """What the role's backend makes of `arguments`; of `extra` it is given what its row uses. See `run`."""

        def use(made: Any) -> Any:
            uses = self.row(role).uses
            return made(*arguments, **{key: extra[key] for key in uses if key in extra})

        return self.run(role, use)

    def run(self, role: str, use: Callable[[Any], Any]) -> Any:
        """What `use` makes of the role's backend; it takes a step of the record.

        Where it fails and the plan allows that, the role's default does it, `warn` is told, and so is the record.
        Raises InputError where what was chosen fails.
        """
        started = time.perf_counter()
        step = Step(role, self.name(role), self._weights(role), 0.0)
        try:
            result = use(self.get(role))
        except Exception as error:
            if self.row(role) is backends.find(role):
                raise  # our own: nobody who chooses can mend that
            said, because = f"{role}={self.plan.choices[role]}", f"failed ({why(error)})"
            if not self.plan.fallback:
                if isinstance(error, InputError):
                    raise
                fix = "see what failed, choose another, or let the offline one take over: --fallback"
                raise InputError([Problem(FLAG, "", said, because, fix)]) from error
            step.instead_of, step.because = str(self.plan.choices[role]), why(error)
            self.close(role)
            self._fallen.add(role)
            step.backend, step.weights = self.name(role), ""
            fix = f"{step.backend} took over: see what failed, or choose another"
            self._warn(Problem(FLAG, "", said, because, fix, Severity.WARNING))
            result = use(self.get(role))
        step.seconds = time.perf_counter() - started
        told = getattr(self._made.get(role), "note", None)
        step.note = told() if told else {}
        self.steps.append(step)
        return result

    def fallen(self, role: str) -> bool:
        """Whether what was chosen has failed on this photo."""
        return role in self._fallen

    def _weights(self, role: str) -> str:
        row, said = self.row(role), self.plan.setup(role).weights
        return said or (row.weights[0].id if row.weights else "")

    def release(self, *roles: str) -> None:
        """The roles are done for this photo: their models go, unless they are to be kept."""
        if not self.plan.keep:
            for role in roles:
                self.close(role)

    def close(self, *roles: str) -> None:
        """Let go of what was made for `roles`, or for all."""
        for role in roles or tuple(self._made):
            let_go = getattr(self._made.pop(role, None), "close", None)
            if let_go is not None:
                with suppress(Exception):
                    let_go()

    def fell(self) -> list[Step]:
        """Steps that a default took over."""
        return [step for step in self.steps if step.instead_of]

    def models(self) -> bool:
        """Whether others than the core's own had a part, or were to have one."""
        return any(step.instead_of or step.backend != backends.find(step.role).name for step in self.steps)

    def record(self) -> list[dict[str, Any]]:
        """Every step as JSON."""
        return [
            {**asdict(step), "seconds": round(step.seconds, 3), "note": dict(step.note)}
            for step in self.steps
        ]


def why(error: Exception) -> str:
    """One line of what went wrong.

    >>> why(ValueError("a\\nb"))
    'ValueError: a'
    """
    if isinstance(error, InputError):
        told = "; ".join(" ".join(part for part in (p.found, p.expected) if part) for p in error.problems)
        return " ".join(told.split())
    lines = [line for line in str(error).splitlines() if line.strip()]
    return f"{type(error).__name__}: {lines[0][:200]}" if lines else type(error).__name__
