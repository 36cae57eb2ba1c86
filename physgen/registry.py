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
from physgen.problems import InputError, Place, Problem, collect

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
    """Every option of the section `[table]`, missing ones with their defaults. Raises InputError with every wrong one.

    >>> read_options(Setup(options={"steps": 4}), "marigold", {"steps": (1, {"type": "integer"}), "seed": (0, {})})
    {'steps': 4, 'seed': 0}
    """
    from jsonschema import Draft202012Validator  # here, since only models have options

    problems = []
    for key, value in setup.options.items():
        default, schema = known.get(key, (None, {}))
        found = "" if key in known else f'"{key}"'
        faults = [
            error.message for error in Draft202012Validator(schema).iter_errors(value)
        ]
        fix = "leave it out" if default is None else f"the default is {default!r}"
        if key not in known:
            faults, fix = ["means nothing here"], suggestion(key, known)
        place = Place("physgen.toml")
        problems += [
            Problem(place, f"{table}.{key}", found, fault, fix) for fault in faults
        ]
    if problems:
        raise InputError(problems)
    return {key: setup.options.get(key, default) for key, (default, _) in known.items()}


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
    """Keyword arguments that its callable takes beyond the Protocol's: `categories`; `depth`, `normals`, `scenery`."""

    @property
    def extra(self) -> str | None:
        """The extra that installs its imports; None: part of the core."""
        return "models" if self.needs else None

    def missing(self) -> tuple[str, ...]:
        """Needed modules that are not installed; none is imported to find out."""
        return tuple(
            name for name in self.needs if importlib.util.find_spec(name) is None
        )


def _read_row(entry: Mapping[str, Any]) -> Backend:
    """From an entry of `backends.json`, which leaves defaults out."""
    weights = tuple(Weights(**one) for one in entry.get("weights", ()))
    lists = {key: tuple(entry.get(key, ())) for key in ("needs", "settings", "uses")}
    return Backend(**{**entry, **lists, "weights": weights})


_TABLE = Path(__file__).with_name("backends.json")
BACKENDS = tuple(map(_read_row, json.loads(_TABLE.read_text(encoding="utf-8"))))
"""In each role, the first row is the default."""


def roles() -> tuple[str, ...]:
    """Every role, in the table's order."""
    return tuple(dict.fromkeys(row.role for row in BACKENDS))


def names(role: str) -> tuple[str, ...]:
    """Names of one role's backends, the default first."""
    return tuple(row.name for row in BACKENDS if row.role == role)


def find(role: str, name: str | None = None) -> Backend:
    """The row of `role` called `name` (None: the role's default).

    Raises InputError for a role or a name that is not in the table.

    >>> find("inpaint").name
    'fill'
    """
    if role not in roles():
        raise InputError.of(
            "--backend", f'"{role}"', "is not a role", suggestion(role, roles())
        )
    for row in BACKENDS:
        if row.role == role and name in (None, row.name):
            return row
    found = f'{role}="{name}"'
    raise InputError.of(
        "--backend", found, "is not a backend", suggestion(str(name), names(role))
    )


def make(role: str, name: str | None = None, setup: Setup | None = None) -> Any:
    """A new backend, imported now: a callable of the role's Protocol.

    Raises InputError for an unknown role or name, or when a needed library is not installed.
    """
    row = find(role, name)
    if missing := row.missing():
        verb = "is" if len(missing) == 1 else "are"
        expected = f"needs {', '.join(missing)}, which {verb} not installed"
        raise InputError(
            [Problem(FLAG, "", f'{role}="{row.name}"', expected, install("models"))]
        )
    module, _, factory = row.target.partition(":")
    build = getattr(importlib.import_module(module), factory)
    return build(setup or Setup()) if row.weights or row.takes_setup else build()


def suggestion(found: str, known: Iterable[str]) -> str:
    """The fix for an unknown name: the nearest of the `known` names, then all."""
    known = list(known)
    near = difflib.get_close_matches(found, known, 1)
    return (
        f"did you mean {near[0]}? " if near else ""
    ) + f"choose from {', '.join(known)}"


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
        """The row chosen for `role`."""
        choice = self.choices.get(role)
        return find(role, choice.name if choice else None)

    def setup(self, role: str) -> Setup:
        """The argument of its factory."""
        choice = self.choices.get(role)
        options = self.options.get(self.row(role).name, {})
        return Setup(choice.weights if choice else "", self.device, self.dtype, options)

    def of(self, roles: Iterable[str]) -> Plan:
        """The plan without the choices for other roles: `Backends` makes and checks every choice."""
        kept = set(roles)
        return replace(
            self,
            choices={role: one for role, one in self.choices.items() if role in kept},
        )


def choices(settings: Iterable[str], place: Place = FLAG) -> dict[str, Choice]:
    """`["segment=grounding-dino+sam:models/dino", ...]` as choices by role. Raises InputError with every wrong one.

    >>> str(choices(["inpaint=fill"])["inpaint"])
    'fill'
    """

    def read(setting: str) -> tuple[str, Choice]:
        role, sign, text = setting.partition("=")
        if not sign:
            fix = "write e.g. inpaint=fill"
            raise InputError(
                [Problem(place, "", f'"{setting}"', "is not ROLE=NAME", fix)]
            )
        return role, choice(role, text, place)

    return dict(collect(partial(read, setting) for setting in settings))


def choice(role: str, text: str, place: Place = FLAG) -> Choice:
    """The choice that `NAME` or `NAME:WEIGHTS` makes.

    Raises InputError for an unknown role or name, and for weights that it does not take.
    """
    name, colon, weights = text.partition(":")
    try:
        row = find(role, name)
    except InputError as error:
        raise InputError(
            [replace(problem, place=place) for problem in error.problems]
        ) from None
    found = f'"{role}={text}"'
    if colon and not (row.weights or row.takes_setup):
        expected, fix = "names weights for what has none", f"write {role}={name}"
        raise InputError([Problem(place, "", found, expected, fix)])
    if colon and not weights:
        fix = f"write {role}={name}:PATH"
        raise InputError(
            [Problem(place, "", found, "names nothing after the colon", fix)]
        )
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
    """The plan from flags, then from `config` or the user's own file; `settings` are `ROLE=NAME[:WEIGHTS]`.

    A `profile`, one of PROFILES, stands in place of the file's choices. Raises InputError with everything wrong.
    """
    home = os.environ.get("XDG_CONFIG_HOME")
    users = (
        (Path(home) if home else Path.home() / ".config") / "physgen" / CONFIGURATION
    )
    path = config or users
    found: Configuration = (
        read_configuration(path) if config or path.is_file() else ({}, {}, {})
    )
    switches, file_choices, tables = found
    given = choices(settings)
    named = PROFILES[profile or switches.get("profile", "offline")]
    chosen = {role: Choice(backend) for role, backend in named.items()}
    if profile is None:
        chosen |= file_choices
    device, dtype = (switches.get(key, "auto") for key in ("device", "dtype"))
    return Plan(chosen | given, device, dtype, options=tables)


def _switch_problems(switches: Mapping[str, Any], place: Place) -> Iterator[Problem]:
    for key, value in switches.items():
        if not isinstance(value, str):
            yield Problem(place, key, repr(value), "is not text", "write text")
        elif key == "device" and not DEVICE.fullmatch(value):
            fix = "write auto, cpu, cuda, cuda:1 or mps"
            yield Problem(place, "", f'"{value}"', "is no device", fix)
        elif key == "dtype" and value not in DTYPES:
            yield Problem(
                place,
                "",
                f'"{value}"',
                "is no number format",
                suggestion(value, DTYPES),
            )
        elif key == "profile" and value not in PROFILES:
            yield Problem(
                place, "", f'"{value}"', "is no profile", suggestion(value, PROFILES)
            )


def read_configuration(path: Path) -> Configuration:
    """One configuration file. Raises InputError with everything wrong in it."""
    import tomllib  # here, since reading a scene imports this module

    place = Place(str(path))
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError.of(
            str(path), "", f"cannot be read ({error.strerror})", "see --config"
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        fix = "see docs/models.md for an example"
        raise InputError.of(str(path), "", f"is not TOML: {error}", fix) from None
    switches = {key: data.pop(key) for key in SWITCHES if key in data}
    problems = list(_switch_problems(switches, place))
    chosen: dict[str, Choice] = {}
    table = data.pop("backend", {})
    for role, value in table.items() if isinstance(table, dict) else [("", table)]:
        if not role or not isinstance(value, str):
            fix = 'write e.g. depth = "marigold" below [backend]'
            problems.append(
                Problem(place, f"backend.{role}", repr(value), "is not text", fix)
            )
            continue
        name, colon, weights = value.partition(":")
        weights = ",".join(_relative_to(path, part) for part in weights.split(","))
        try:
            chosen[role] = choice(role, f"{name}{colon}{weights}", place)
        except InputError as error:
            problems += error.problems
    known = sorted({row.name for row in BACKENDS})
    for name, table in data.items():
        if name not in known or not isinstance(table, dict):
            fix = suggestion(name, [*SWITCHES, "backend", *known])
            problems.append(
                Problem(place, name, f'"{name}"', "means nothing here", fix)
            )
    if problems:
        raise InputError(problems)
    return switches, chosen, data


def _relative_to(path: Path, weights: str) -> str:
    """Weights named in the file `path`: a path where it exists beside that file, else unchanged."""
    try:
        beside = path.parent / Path(weights).expanduser()
        return str(beside) if weights and beside.exists() else weights
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
        """Raises InputError with everything that the plan needs and that is missing."""
        self.plan = plan or Plan()
        self.steps: list[Step] = []
        self._made: dict[str, Any] = {}
        problems: list[Problem] = []
        for role, chosen in self.plan.choices.items():
            try:
                self.get(role)  # no weights are loaded yet
            except InputError as error:
                problems += [
                    p if p.place != FLAG else replace(p, place=chosen.place)
                    for p in error.problems
                ]
        if (
            "depth" in self.plan.row("boundary").uses
            and self.plan.row("depth").name == "none"
        ):
            boundary = self.plan.choices["boundary"]
            fix = "choose one for depth, too: depth=marigold, or depth=file:PATH"
            problems.append(
                Problem(
                    boundary.place, "", f'"boundary={boundary}"', "needs depth", fix
                )
            )
        if problems:
            raise InputError(problems)

    def begin(self) -> None:
        """Start another photo: the record is emptied."""
        self.steps = []

    def row(self, role: str) -> Backend:
        """The row in use for `role`."""
        return self.plan.row(role)

    def name(self, role: str) -> str:
        """The row's name, for `from`."""
        return self.row(role).name

    def get(self, role: str) -> Any:
        """The backend itself."""
        if role not in self._made:
            self._made[role] = make(role, self.name(role), self.plan.setup(role))
        return self._made[role]

    def call(self, role: str, *arguments: Any, **extra: Any) -> Any:
        """The result of the role's backend for `arguments`, and for those of `extra` that its row uses. See `run`."""
        used = {key: extra[key] for key in self.row(role).uses if key in extra}
        return self.run(role, lambda backend: backend(*arguments, **used))

    def run(self, role: str, use: Callable[[Any], Any]) -> Any:
        """`use(backend)` of the role's backend, as a step of the record.

        Raises InputError where a chosen backend fails.
        """
        started = time.perf_counter()
        row = self.row(role)
        weights = self.plan.setup(role).weights or next(
            (one.id for one in row.weights), ""
        )
        try:
            result = use(self.get(role))
        except InputError:
            raise
        except Exception as error:
            if row is find(role):
                raise  # a defect of the default, not of a choice
            found, expected = (
                f"{role}={self.plan.choices[role]}",
                f"failed ({describe_error(error)})",
            )
            fix = "see what failed, or choose another"
            raise InputError([Problem(FLAG, "", found, expected, fix)]) from error
        note = getattr(self._made[role], "note", None)
        seconds = time.perf_counter() - started
        self.steps.append(
            Step(role, row.name, weights, seconds, note() if note else {})
        )
        return result

    def release(self, *roles: str) -> None:
        """Free the models of roles that are done for this photo, unless the plan keeps them."""
        if not self.plan.keep:
            for role in roles:
                self.close(role)

    def close(self, *roles: str) -> None:
        """Free the backends of `roles`, or of all roles."""
        for role in roles or tuple(self._made):
            close = getattr(self._made.pop(role, None), "close", None)
            if close is not None:
                with suppress(Exception):
                    close()

    def all_default(self) -> bool:
        """Whether every step was done by the default of its role."""
        return all(step.backend == find(step.role).name for step in self.steps)

    def record(self) -> list[dict[str, Any]]:
        """Every step as JSON."""
        return [
            {**asdict(step), "seconds": round(step.seconds, 3), "note": dict(step.note)}
            for step in self.steps
        ]


def describe_error(error: Exception) -> str:
    """One line about an error.

    >>> describe_error(ValueError("a\\nb"))
    'ValueError: a'
    """
    if isinstance(error, InputError):
        text = "; ".join(
            " ".join(part for part in (p.found, p.expected) if part)
            for p in error.problems
        )
        return " ".join(text.split())
    lines = [line for line in str(error).splitlines() if line.strip()]
    return (
        f"{type(error).__name__}: {lines[0][:200]}" if lines else type(error).__name__
    )


# --- listing: what is ready, what is missing ---


def listing(plan: Plan | None = None) -> list[Mapping[str, Any]]:
    """One mapping a row: role, name, default, chosen, ready, missing, about.

    `chosen` rows are those of `plan`, `ready` ones would run now: nothing is in their list `missing`, which names
    libraries, weights and settings with the way to get each. No model is imported, and nothing is fetched.
    """
    plan = plan or Plan()
    rows: list[Mapping[str, Any]] = []
    for row in BACKENDS:
        chosen = plan.row(row.role) is row
        named = (
            plan.choices[row.role].weights
            if chosen and row.role in plan.choices
            else ""
        )
        missing = list(_missing(row, named, plan.options.get(row.name, {})))
        rows.append(
            {
                "role": row.role,
                "name": row.name,
                "default": row is find(row.role),
                "chosen": chosen,
                "ready": not missing,
                "missing": missing,
                "about": row.about,
            }
        )
    return rows


def _missing(row: Backend, named: str, options: Mapping[str, Any]) -> Iterator[str]:
    """What a row lacks here, with the fix; `named` are the weights, or the map, of its choice."""
    if modules := row.missing():
        yield f"needs {', '.join(modules)}: {install('models')}"
    if row.name == MAP_FILE and not named:
        yield f"write {row.role}={row.name}:PATH"
    elif row.name == MAP_FILE and not Path(named).expanduser().is_file():
        yield f"lacks {named}"
    several = len(row.weights) > 1  # a single path may contain a comma
    parts = [part.strip() for part in named.split(",")] if several else [named]
    for k, default in enumerate(row.weights):
        part = parts[k] if k < len(parts) else ""
        if part and not weights_present(part):
            yield f"lacks {part}"
        elif not part and not weights_present(default.id):
            get = default.get or f"hf download {default.id}"
            yield f"lacks {default.id} ({default.size}, {default.licence}): {get}"
    # `url` of [vlm] stands for PHYSGEN_VLM_URL; a model named after the colon stands for both
    configured = {
        name for name in row.settings if options.get(name.rsplit("_", 1)[-1].lower())
    }
    if unset := [
        name
        for name in row.settings
        if not (os.environ.get(name) or name in configured or named)
    ]:
        yield f"set {' and '.join(unset)}"


def weights_present(weights: str) -> bool:
    """Whether weights are on this machine: at a path, or in the hub's cache."""
    return bool(weights) and (
        Path(weights).expanduser().exists() or in_hub_cache(weights)
    )


def in_hub_cache(weights: str) -> bool:
    """Whether any file of a hub id has been fetched before."""
    return any((hub_folder(weights) / "snapshots").glob("*/*"))


def hub_folder(weights: str) -> Path:
    """The folder of a hub id in the cache of the hub's library; where that is not installed, one that is not there."""
    try:
        from huggingface_hub.constants import HF_HUB_CACHE
    except ModuleNotFoundError:
        return Path("/nowhere")
    return Path(HF_HUB_CACHE) / f"models--{weights.replace('/', '--')}"
