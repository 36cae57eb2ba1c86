"""All backends in one place: the table of roles and names, the choice among them, and how they are called.

A backend is one file under a `backends/` folder and one row of `backends.json`; the contract tests then run on it.
Nothing is imported before a backend is made, and this is the only module that imports by name. A `Plan` holds the
choice made by `physgen.toml` and flags; `Backends` makes what the plan chooses, calls it and keeps the record;
`listing` reports what is missing.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import json
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from physgen.files import install
from physgen.messages import Message
from physgen.problems import InputError, Place, Problem, collect
from physgen.weights import weights_present

FLAG = Place("--backend")
MAP_FILE = "file"
"""The name of the backends that read a map from a file."""


@dataclass(frozen=True)
class Weights:
    """Numbers that a model loads when it first runs: a file or a folder."""

    id: str
    """On the hub."""
    size: str
    """Approximate, e.g. `1.1 GB`."""
    licence: str
    """According to its model card."""
    get: str = ""
    """How to get them; empty: by `hf download`."""


@dataclass(frozen=True)
class Setup:
    """The argument of a backend's factory."""

    weights: str = ""
    """A hub id or a local path, from after the colon of its name; `""`: the row's own."""
    device: str = "auto"
    """`auto`, `cpu`, `cuda`, `cuda:1`, `mps`."""
    dtype: str = "auto"
    """`auto`, `float32`, `float16`, `bfloat16`."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """The backend's section of `physgen.toml`, e.g. `[vlm]`."""


Options = Mapping[str, tuple[Any, Mapping[str, Any]]]
"""Default and JSON schema of each option, by name; None: left to the weights."""


def read_options(setup: Setup, table: str, known: Options) -> dict[str, Any]:
    """Read every option of the section `[table]`, missing ones with their defaults.

    Raises InputError with every wrong one.

    >>> read_options(Setup(options={"steps": 4}), "marigold", {"steps": (1, {"type": "integer"}), "seed": (0, {})})
    {'steps': 4, 'seed': 0}
    """
    problems: list[Problem] = []
    for key, value in setup.options.items():
        problems += _option_problems(f"{table}.{key}", key, value, known)
    if problems:
        raise InputError(problems)
    return {key: setup.options.get(key, default) for key, (default, _) in known.items()}


def _option_problems(
    path: str, key: str, value: Any, known: Options
) -> Iterator[Problem]:
    # Imported here, since only models have options and the import takes 60 ms.
    from jsonschema import Draft202012Validator

    place = Place("physgen.toml")
    if key not in known:
        yield Message.UNKNOWN_OPTION.problem(
            place, path, f'"{key}"', fix=suggestion(key, known)
        )
        return
    default, schema = known[key]
    fix = "leave it out" if default is None else f"the default is {default!r}"
    for error in Draft202012Validator(schema).iter_errors(value):
        yield Message.WRONG_OPTION.problem(place, path, reason=error.message, fix=fix)


@dataclass(frozen=True)
class Backend:
    """One row of the table."""

    role: str
    """`segment`, `inpaint` ...; the Protocol of the same name documents inputs and outputs."""
    name: str
    target: str
    """`module:factory`, empty where the role is left out; the factory returns a callable of the role's Protocol. It
    takes a `Setup` where the row has `weights` or `takes_setup`."""
    about: str
    """One sentence for `physgen backends`."""
    needs: tuple[str, ...] = ()
    """Modules that it imports beyond the core; the extra `models` installs them."""
    weights: tuple[Weights, ...] = ()
    """Default weights; `NAME:WEIGHTS` replaces the first, `NAME:A,B` replaces two."""
    takes_setup: bool = False
    """Whether the factory takes a `Setup` though it loads no weights, e.g. the name of a map or a server."""
    settings: tuple[str, ...] = ()
    """Environment variables that it needs unless weights are named after a colon."""
    uses: tuple[str, ...] = ()
    """Keyword arguments that its callable takes beyond the Protocol's: `categories`.

    `depth`, `normals`, `scenery`, `barriers`.
    """

    @property
    def extra(self) -> str | None:
        """Return the extra that installs its imports; None: part of the core."""
        return "models" if self.needs else None

    def missing(self) -> tuple[str, ...]:
        """Return the needed modules that are not installed, without an import of any."""
        return tuple(
            name for name in self.needs if importlib.util.find_spec(name) is None
        )


def _read_row(entry: Mapping[str, Any]) -> Backend:
    """Read an entry of `backends.json`, which leaves defaults out."""
    weights = tuple(
        Weights(**weights_entry) for weights_entry in entry.get("weights", ())
    )
    lists = {key: tuple(entry.get(key, ())) for key in ("needs", "settings", "uses")}
    return Backend(**{**entry, **lists, "weights": weights})


_TABLE = Path(__file__).with_name("backends.json")
BACKENDS = tuple(map(_read_row, json.loads(_TABLE.read_text(encoding="utf-8"))))
"""In each role, the first row is the default."""


def roles() -> tuple[str, ...]:
    """Return every role, in the table's order."""
    return tuple(dict.fromkeys(row.role for row in BACKENDS))


def names(role: str) -> tuple[str, ...]:
    """Return the names of one role's backends, the default first."""
    return tuple(row.name for row in BACKENDS if row.role == role)


def find(role: str, name: str | None = None) -> Backend:
    """Return the row of `role` called `name` (None: the role's default).

    Raises InputError for a role or a name that is not in the table.

    >>> find("inpaint").name
    'fill'
    """
    if role not in roles():
        raise Message.UNKNOWN_ROLE.error(
            "--backend", f'"{role}"', fix=suggestion(role, roles())
        )
    for row in BACKENDS:
        if row.role == role and name in (None, row.name):
            return row
    value_text = f'{role}="{name}"'
    raise Message.UNKNOWN_BACKEND.error(
        "--backend", value_text, fix=suggestion(str(name), names(role))
    )


def make(role: str, name: str | None = None, setup: Setup | None = None) -> Any:
    """Make a new backend, imported now: a callable of the role's Protocol.

    Raises InputError for an unknown role or name, or when a needed library is not installed.
    """
    row = find(role, name)
    if missing_packages := row.missing():
        verb = "is" if len(missing_packages) == 1 else "are"
        raise Message.PACKAGES_MISSING.error_at(
            FLAG,
            "",
            f'{role}="{row.name}"',
            verb=verb,
            packages=", ".join(missing_packages),
            install=install("models"),
        )
    module, _, factory = row.target.partition(":")
    build = getattr(importlib.import_module(module), factory)
    return build(setup or Setup()) if row.weights or row.takes_setup else build()


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return the fix for an unknown name: the nearest of the `known` names, then all."""
    known = list(known)
    matches = difflib.get_close_matches(name, known, 1)
    question = f"did you mean {matches[0]}? " if matches else ""
    return f"{question}choose from {', '.join(known)}"


# --- choice: flags and physgen.toml ---


@dataclass(frozen=True)
class Choice:
    """One backend of a role, named by `--backend` or a configuration file."""

    name: str
    weights: str = ""
    """A hub id, or a path of weights or of a map; `""`: the row's own."""
    place: Place = field(default=FLAG, compare=False)
    """Where it was written."""

    def __str__(self) -> str:
        return f"{self.name}:{self.weights}" if self.weights else self.name


@dataclass(frozen=True)
class Plan:
    """The chosen backend of every role and how to run it; nothing is imported yet."""

    choices: Mapping[str, Choice] = field(default_factory=dict)
    """By role; other roles have their defaults."""
    device: str = "auto"
    dtype: str = "auto"
    keep: bool = False
    """Whether models stay in memory for the next photo."""
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Tables of the configuration, by backend."""

    def row(self, role: str) -> Backend:
        """Return the row chosen for `role`."""
        choice = self.choices.get(role)
        return find(role, choice.name if choice else None)

    def setup(self, role: str) -> Setup:
        """Return the argument of the factory of a role's backend."""
        choice = self.choices.get(role)
        options = self.options.get(self.row(role).name, {})
        return Setup(choice.weights if choice else "", self.device, self.dtype, options)

    def of(self, roles: Iterable[str]) -> Plan:
        """Return the plan without the choices for other roles: `Backends` makes and checks every choice."""
        roles = set(roles)
        choices = {
            role: backend_choice
            for role, backend_choice in self.choices.items()
            if role in roles
        }
        return replace(self, choices=choices)


def choices(settings: Iterable[str], place: Place = FLAG) -> dict[str, Choice]:
    """Read `["segment=grounding-dino+sam:models/dino", ...]` as choices by role.

    Raises InputError with every wrong one.

    >>> str(choices(["inpaint=fill"])["inpaint"])
    'fill'
    """

    def read(setting: str) -> tuple[str, Choice]:
        role, sign, text = setting.partition("=")
        if not sign:
            raise Message.CHOICE_WITHOUT_ROLE.error_at(place, "", f'"{setting}"')
        return role, choice(role, text, place)

    return dict(collect(partial(read, setting) for setting in settings))


def choice(role: str, text: str, place: Place = FLAG) -> Choice:
    """Read the choice `NAME` or `NAME:WEIGHTS`.

    Raises InputError for an unknown role or name, and for weights that it does not take.
    """
    name, colon, weights = text.partition(":")
    try:
        row = find(role, name)
    except InputError as error:
        raise InputError(
            [replace(problem, place=place) for problem in error.problems]
        ) from None
    value_text = f'"{role}={text}"'
    if colon and not (row.weights or row.takes_setup):
        message = Message.TAKES_NO_WEIGHTS
        raise message.error_at(place, "", value_text, role=role, name=name)
    if colon and not weights:
        empty = Message.WEIGHTS_EMPTY
        raise empty.error_at(place, "", value_text, role=role, name=name)
    return Choice(name, weights, place)


CONFIGURATION = "physgen.toml"
_SURFACES = {
    "normals": "marigold",
    "intrinsic": "marigold",
    "boundary": "depth-normals",
}
_WORDS = {"categories": "vlm", "label": "vlm", "physics": "vlm"}
PROFILES: Mapping[str, Mapping[str, str]] = {
    "offline": {},
    "models": {
        **_WORDS,
        **_SURFACES,
        "segment": "sam3",
        "depth": "depth-anything",
        "inpaint": "diffusion",
    },
    "paper": {
        **_WORDS,
        **_SURFACES,
        "segment": "grounding-dino+sam",
        "depth": "marigold",
        "inpaint": "lama",
    },
    "small": {
        **_SURFACES,
        "segment": "sam2",
        "depth": "depth-anything",
        "inpaint": "diffusion",
    },
}
"""Role to backend; other roles have their defaults. `paper` has the backends of section
3.1 of the paper, or their nearest kin: Marigold for GeoWizard and for the intrinsic
decomposition of Careaga and Aksoy. `small` needs 8 GB of GPU memory and no server."""
SWITCHES = ("device", "dtype", "profile")
DTYPES = ("auto", "float32", "float16", "bfloat16")
DEVICE = re.compile(r"auto|cpu|mps|cuda(:\d+)?")


Configuration = tuple[
    Mapping[str, str], Mapping[str, Choice], Mapping[str, Mapping[str, Any]]
]
"""Checked content of a file: `profile`, `device`, `dtype`; choices by role; other sections, by backend."""


def load_plan(
    settings: Sequence[str] = (),
    *,
    profile: str | None = None,
    config: Path | None = None,
) -> Plan:
    """Load the plan from flags, then from `config` or the user's own file; `settings` are `ROLE=NAME[:WEIGHTS]`.

    A `profile`, one of PROFILES, stands in place of the file's choices. Raises InputError with everything wrong.
    """
    path = config or _user_configuration()
    content: Configuration = ({}, {}, {})
    if config or path.is_file():
        content = read_configuration(path)
    switches, file_choices, tables = content
    flag_choices = choices(settings)
    backends = PROFILES[profile or switches.get("profile", "offline")]
    plan_choices = {role: Choice(backend) for role, backend in backends.items()}
    if profile is None:
        plan_choices |= file_choices
    return Plan(
        plan_choices | flag_choices,
        switches.get("device", "auto"),
        switches.get("dtype", "auto"),
        options=tables,
    )


def _user_configuration() -> Path:
    home = os.environ.get("XDG_CONFIG_HOME")
    folder = Path(home) if home else Path.home() / ".config"
    return folder / "physgen" / CONFIGURATION


def _switch_problems(switches: Mapping[str, Any], place: Place) -> Iterator[Problem]:
    for key, value in switches.items():
        if not isinstance(value, str):
            yield Message.SWITCH_NOT_TEXT.problem(place, key, repr(value))
        elif key == "device" and not DEVICE.fullmatch(value):
            yield Message.UNKNOWN_DEVICE.problem(place, "", f'"{value}"')
        elif key == "dtype" and value not in DTYPES:
            yield Message.UNKNOWN_NUMBER_FORMAT.problem(
                place, "", f'"{value}"', fix=suggestion(value, DTYPES)
            )
        elif key == "profile" and value not in PROFILES:
            yield Message.UNKNOWN_PROFILE.problem(
                place, "", f'"{value}"', fix=suggestion(value, PROFILES)
            )


def read_configuration(path: Path) -> Configuration:
    """Read one configuration file. Raises InputError with everything wrong in it."""
    place = Place(str(path))
    data = _read_toml(path)
    switches = {key: data.pop(key) for key in SWITCHES if key in data}
    problems = list(_switch_problems(switches, place))
    file_choices: dict[str, Choice] = {}
    section = data.pop("backend", {})
    entries = section.items() if isinstance(section, dict) else [("", section)]
    for role, value in entries:
        try:
            file_choices[role] = _file_choice(role, value, path)
        except InputError as error:
            problems += error.problems
    backend_names = sorted({row.name for row in BACKENDS})
    for name, table in data.items():
        if name not in backend_names or not isinstance(table, dict):
            fix = suggestion(name, [*SWITCHES, "backend", *backend_names])
            unknown = Message.UNKNOWN_TABLE
            problems.append(unknown.problem(place, name, f'"{name}"', fix=fix))
    if problems:
        raise InputError(problems)
    return switches, file_choices, data


def _read_toml(path: Path) -> dict[str, Any]:
    # Imported here, since every scene that is read imports this module.
    import tomllib

    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        unreadable, reason = Message.CONFIGURATION_UNREADABLE, str(error.strerror)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        unreadable, reason = Message.NOT_TOML, str(error)
    raise unreadable.error(str(path), reason=reason) from None


def _file_choice(role: str, value: Any, path: Path) -> Choice:
    """Read a line of the section `[backend]`. Raises InputError."""
    place = Place(str(path))
    if not role or not isinstance(value, str):
        key = f"backend.{role}"
        raise Message.CHOICE_NOT_TEXT.error_at(place, key, repr(value))
    name, colon, weights = value.partition(":")
    parts = [_relative_to(path, part) for part in weights.split(",")]
    return choice(role, f"{name}{colon}{','.join(parts)}", place)


def _relative_to(path: Path, weights: str) -> str:
    """Return weights named in the file `path`: a path if it exists beside that file, else unchanged."""
    try:
        weights_path = path.parent / Path(weights).expanduser()
        return str(weights_path) if weights and weights_path.exists() else weights
    except (OSError, RuntimeError, ValueError):  # not a path
        return weights


# --- calls ---


@dataclass
class Step:
    """The record of one call."""

    role: str
    backend: str
    weights: str
    seconds: float
    note: Mapping[str, Any] = field(default_factory=dict)
    """The backend's own entries: device, requests, tokens ..."""


class Backends:
    """The backends of a plan by role, made when first called.

    A backend may have `close()`, which frees its model, and `note()`, a mapping for the record.
    """

    def __init__(self, plan: Plan | None = None) -> None:
        """Raise InputError with everything that the plan needs and that is missing."""
        self.plan = plan or Plan()
        self.steps: list[Step] = []
        self._made: dict[str, Any] = {}
        problems: list[Problem] = []
        for role, choice in self.plan.choices.items():
            try:
                self.get(role)  # no weights are loaded yet
            except InputError as error:
                for problem in error.problems:
                    if problem.place == FLAG:
                        problem = replace(problem, place=choice.place)
                    problems.append(problem)
        problems += self._depth_problems()
        if problems:
            raise InputError(problems)

    def _depth_problems(self) -> Iterator[Problem]:
        """Yield the problem of a boundary that needs depth in a plan without depth."""
        needs_depth = "depth" in self.plan.row("boundary").uses
        if needs_depth and self.plan.row("depth").name == "none":
            boundary = self.plan.choices["boundary"]
            name = f'"boundary={boundary}"'
            yield Message.NEEDS_DEPTH.problem(boundary.place, "", name)

    def begin(self) -> None:
        """Start another photo with an empty record."""
        self.steps = []

    def row(self, role: str) -> Backend:
        """Return the row in use for `role`."""
        return self.plan.row(role)

    def name(self, role: str) -> str:
        """Return the row's name, for `from`."""
        return self.row(role).name

    def get(self, role: str) -> Any:
        """Return the backend itself."""
        if role not in self._made:
            self._made[role] = make(role, self.name(role), self.plan.setup(role))
        return self._made[role]

    def call(self, role: str, *arguments: Any, **extra: Any) -> Any:
        """Return the result of the role's backend for `arguments`, and for those of `extra` that its row uses.

        See `run` for the errors.
        """
        used_arguments = {
            key: extra[key] for key in self.row(role).uses if key in extra
        }
        return self.run(role, lambda backend: backend(*arguments, **used_arguments))

    def run(self, role: str, use: Callable[[Any], Any]) -> Any:
        """Return `use(backend)` of the role's backend, as a step of the record.

        Raises InputError if a chosen backend fails.
        """
        start = time.perf_counter()
        row = self.row(role)
        weights = self.plan.setup(role).weights
        if not weights and row.weights:
            weights = row.weights[0].id
        try:
            result = use(self.get(role))
        except InputError:
            raise
        except Exception as error:
            if row is find(role):
                raise  # a defect of the default, not of a choice
            name = f"{role}={self.plan.choices[role]}"
            raise Message.BACKEND_FAILED.error_at(
                FLAG, "", name, error=describe_error(error)
            ) from error
        take_note = getattr(self._made[role], "note", None)
        seconds = time.perf_counter() - start
        note = take_note() if take_note else {}
        self.steps.append(Step(role, row.name, weights, seconds, note))
        return result

    def release(self, *roles: str) -> None:
        """Close the models of roles that are done for this photo, unless the plan keeps them."""
        if not self.plan.keep:
            for role in roles:
                self.close(role)

    def close(self, *roles: str) -> None:
        """Close the backends of `roles`, or of all roles."""
        for role in roles or tuple(self._made):
            close = getattr(self._made.pop(role, None), "close", None)
            if close is not None:
                with suppress(Exception):
                    close()

    def all_default(self) -> bool:
        """Return whether every step was done by the default of its role."""
        return all(step.backend == find(step.role).name for step in self.steps)

    def record(self) -> list[dict[str, Any]]:
        """Return every step as JSON."""
        return [
            {**asdict(step), "seconds": round(step.seconds, 3), "note": dict(step.note)}
            for step in self.steps
        ]


def describe_error(error: Exception) -> str:
    """Return one line about an error.

    >>> describe_error(ValueError("a\\nb"))
    'ValueError: a'
    """
    if isinstance(error, InputError):
        texts = []
        for problem in error.problems:
            texts.append(" ".join(filter(None, (problem.found, problem.expected))))
        return " ".join("; ".join(texts).split())
    name = type(error).__name__
    lines = [line for line in str(error).splitlines() if line.strip()]
    return f"{name}: {lines[0][:200]}" if lines else name


# --- listing: what is ready, what is missing ---


def listing(plan: Plan | None = None) -> list[Mapping[str, Any]]:
    """List the rows as mappings: role, name, default, chosen, ready, missing, about, weights.

    `chosen` rows are those of `plan`, `ready` ones would run now: nothing is in their list `missing`, which names
    libraries, weights and settings with the way to get each; `weights` are the row's own, with size and licence. No
    model is imported, and nothing is fetched.
    """
    plan = plan or Plan()
    rows: list[Mapping[str, Any]] = []
    for row in BACKENDS:
        missing_packages = missing_parts(row, plan)
        rows.append(
            {
                "role": row.role,
                "name": row.name,
                "default": row is find(row.role),
                "chosen": plan.row(row.role) is row,
                "ready": not missing_packages,
                "missing": missing_packages,
                "about": row.about,
                "weights": list(map(asdict, row.weights)),
            }
        )
    return rows


def missing_parts(row: Backend, plan: Plan) -> list[str]:
    """Return the fix of each part that a row lacks to run now, with the weights of the plan if it chooses the row."""
    weights = ""
    if plan.row(row.role) is row and row.role in plan.choices:
        weights = plan.choices[row.role].weights
    return list(_missing(row, weights, plan.options.get(row.name, {})))


def _missing(row: Backend, choice: str, options: Mapping[str, Any]) -> Iterator[str]:
    """Yield the fix of each missing part of a row.

    `choice` are the weights, or the map, of its choice.
    """
    modules = row.missing()
    if modules:
        yield f"needs {', '.join(modules)}: {install('models')}"
    if row.name == MAP_FILE:
        if not choice:
            yield f"write {row.role}={row.name}:PATH"
        elif not Path(choice).expanduser().is_file():
            yield f"lacks {choice}"
    yield from _missing_weights(row, choice)
    unset = []
    for name in row.settings:
        # `url` of [vlm] stands for PHYSGEN_VLM_URL; a model after the colon stands for both.
        option = options.get(name.rsplit("_", 1)[-1].lower())
        if not (os.environ.get(name) or option or choice):
            unset.append(name)
    if unset:
        yield f"set {' and '.join(unset)}"


def _missing_weights(row: Backend, choice: str) -> Iterator[str]:
    """Yield the fix of each of the row's weights that is not on this machine."""
    parts = [choice]
    if len(row.weights) > 1:  # a single path may contain a comma
        parts = [part.strip() for part in choice.split(",")]
    for k, default in enumerate(row.weights):
        part = parts[k] if k < len(parts) else ""
        if part and not weights_present(part):
            yield f"lacks {part}"
        elif not part and not weights_present(default.id):
            terms = f"{default.size}, {default.licence}"
            command = default.get or f"hf download {default.id}"
            yield f"lacks {default.id} ({terms}): {command}"
