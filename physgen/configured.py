"""physgen.toml, the user's and the folder's, and flags -> the plan of who perceives, with the mistakes in them."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import urlsplit

from physgen import backends
from physgen.backends import choose
from physgen.crew import Choice, Plan, choice, choices
from physgen.problems import InputError, Place, Problem

NAME = "physgen.toml"
PROFILES: Mapping[str, Mapping[str, str]] = {
    "offline": {},
    "models": {
        "categories": "vlm",
        "segment": "grounding-dino+sam",
        "label": "vlm",
        "physics": "vlm",
        "depth": "depth-anything",
        "normals": "marigold",
        "intrinsic": "marigold",
        "inpaint": "diffusion",
        "boundary": "depth-normals",
    },
    "best": {
        "categories": "vlm",
        "segment": "sam3",
        "label": "vlm",
        "physics": "vlm",
        "depth": "marigold",
        "normals": "marigold",
        "intrinsic": "marigold",
        "inpaint": "diffusion",
        "boundary": "depth-normals",
    },
}
"""Profiles that are always there: role -> backend; the roles that they leave out have their defaults."""
SWITCHES = {"keep": bool, "fallback": bool, "device": str, "dtype": str, "profile": str}
PROGRAMS = ("lama", "inception", "module")
"""Backends whose weights are a program."""
OURS = f"say it on the command line, with --config, or in ~/.config/physgen/{NAME}"
DTYPES = ("auto", "float32", "float16", "bfloat16")
DEVICE = re.compile(r"auto|cpu|mps|cuda(:\d+)?")


@dataclass(frozen=True)
class Configuration:
    """One file's say, checked."""

    switches: Mapping[str, Any] = field(default_factory=dict)
    """`profile`, `device`, `dtype`, `keep`, `fallback`."""
    choices: Mapping[str, Choice] = field(default_factory=dict)
    profiles: Mapping[str, Mapping[str, Choice]] = field(default_factory=dict)
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Other tables, by backend."""
    place: Place = field(default=Place(NAME), compare=False)
    """Of its profile."""


def plan(
    settings: Sequence[str] = (),
    *,
    profile: str | None = None,
    config: Path | None = None,
    otherwise: Mapping[str, Any] = MappingProxyType({}),
    **switches: Any,
) -> Plan:
    """Flags over the folder's physgen.toml over the user's; `settings` are `ROLE=NAME[:WEIGHTS]`.

    `config` is read in place of both files. `switches` are `device`, `dtype`, `keep` and `fallback`, None where
    nobody said; `otherwise` has them where no file says either. Raises InputError with everything wrong.
    """
    files = [read(config)] if config else [read(path, ours=path == user_file()) for path in found()]
    problems: list[Problem] = []
    said: dict[str, Choice] = {}
    try:
        said = choices(settings)
    except InputError as error:
        problems += error.problems
    told: dict[str, Any] = dict(otherwise)
    merged: dict[str, Choice] = {}
    options: dict[str, dict[str, Any]] = {}
    profiles: dict[str, Mapping[str, Choice]] = {
        name: {role: choice(role, who) for role, who in rows.items()} for name, rows in PROFILES.items()
    }

    def take(name: str, place: Place) -> Mapping[str, Choice]:
        if name not in profiles:
            problems.append(Problem(place, "", f'"{name}"', "is no profile", choose(name, profiles)))
        # what a profile leaves out has its default, whoever chose before
        return profiles.get(name, {})

    for file in files:
        profiles |= file.profiles
        if (name := file.switches.get("profile")) is not None:
            merged = dict(take(name, file.place))
        merged |= file.choices
        told |= {key: value for key, value in file.switches.items() if key != "profile"}
        for name, table in file.options.items():
            options.setdefault(name, {}).update(table)
    if profile is not None:
        merged = dict(take(profile, Place("--profile")))
    merged |= said
    told |= {key: value for key, value in switches.items() if value is not None}
    problems += _odd(told, Place("--device"), Place("--dtype"))
    if problems:
        raise InputError(problems)
    return Plan(merged, options=options, **told)


def user_file() -> Path:
    """The user's own configuration."""
    home = os.environ.get("XDG_CONFIG_HOME")
    return (Path(home) if home else Path.home() / ".config") / "physgen" / NAME


def found() -> Iterator[Path]:
    """The configuration files that are there: the user's, then that of the folder or of one above it.

    Folders above that belong to somebody else are not looked into.
    """
    if user_file().is_file():
        yield user_file()
    here = Path.cwd()
    for folder in (here, *here.parents):
        if folder.stat().st_uid != here.stat().st_uid:
            return
        if (folder / NAME).is_file():
            yield folder / NAME
            return


def read(path: Path, ours: bool = True) -> Configuration:
    """One file. Raises InputError with everything wrong in it, by line.

    One that is not `ours`, but came with a folder, may not name programs to run or servers that photos are sent to.
    """
    try:
        text = path.read_text(encoding="utf-8")
        data = tomllib.loads(text)
    except OSError as error:
        raise InputError.of(str(path), "", f"cannot be read ({error.strerror})", "see --config") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError.of(
            str(path), "", f"is not TOML: {error}", "see docs/models.md for an example"
        ) from None
    problems: list[Problem] = []

    def at(*keys: str) -> Place:
        return Place(str(path), *_line(text, keys))

    def rows(table: Any, *above: str) -> dict[str, Choice]:
        result: dict[str, Choice] = {}
        if not isinstance(table, dict):
            problems.append(
                Problem(at(*above), ".".join(above), "", "is not a table", 'write segment = "sam3" below it')
            )
            return result
        for role, text_of in table.items():
            place = at(*above, role)
            if not isinstance(text_of, str):
                problems.append(Problem(place, role, repr(text_of), "is not text", 'write e.g. "sam3"'))
                continue
            who, colon, weights = text_of.partition(":")
            weights = ",".join(_beside(path, part) for part in weights.split(","))
            if who in PROGRAMS and weights and not ours:
                found = f'"{role} = {text_of}"'
                problems.append(
                    Problem(place, role, found, "is a program that a folder's file may not run", OURS)
                )
                continue
            try:
                result[role] = choice(role, who, weights, place, bool(colon))
            except InputError as error:
                problems.extend(error.problems)
        return result

    switches = {key: data.pop(key) for key in SWITCHES if key in data}
    for key, value in list(switches.items()):
        if not isinstance(value, SWITCHES[key]):
            kind = "true or false" if SWITCHES[key] is bool else "text"
            problems.append(Problem(at(key), key, repr(value), f"is not {kind}", f"write {kind}"))
            del switches[key]
    problems += _odd(switches, at("device"), at("dtype"))
    chosen = rows(data.pop("backend", {}), "backend")
    named = {name: rows(table, "profiles", name) for name, table in data.pop("profiles", {}).items()}
    known = {row.name for row in backends.BACKENDS}
    options = {}
    for name, table in data.items():
        if name not in known or not isinstance(table, dict):
            keys = [*SWITCHES, "backend", "profiles", *sorted(known)]
            problems.append(Problem(at(name), name, f'"{name}"', "means nothing here", choose(name, keys)))
        else:
            options[name] = table
    for name, table in () if ours else options.items():
        host = urlsplit(str(table.get("url", ""))).hostname
        if host not in (None, "localhost", "127.0.0.1", "::1"):
            expected = "is a server that a folder's file may not choose: photos are sent to it"
            problems.append(Problem(at(name, "url"), f"{name}.url", f'"{host}"', expected, OURS))
    if problems:
        raise InputError(problems)
    return Configuration(switches, chosen, named, options, at("profile"))


def _beside(path: Path, weights: str) -> str:
    """A name of weights as a file has it: a path is one beside that file."""
    try:
        beside = path.parent / Path(weights).expanduser()
        return str(beside) if weights and beside.exists() else weights
    except (OSError, RuntimeError, ValueError):  # no path at all
        return weights


def _odd(switches: Mapping[str, Any], device: Place, dtype: Place) -> Iterator[Problem]:
    where = switches.get("device", "auto")
    if not DEVICE.fullmatch(where):
        yield Problem(device, "", f'"{where}"', "is no device", "write auto, cpu, cuda, cuda:1 or mps")
    kind = switches.get("dtype", "auto")
    if kind not in DTYPES:
        yield Problem(dtype, "", f'"{kind}"', "is no number format", choose(kind, DTYPES))


def _line(text: str, keys: Sequence[str]) -> tuple[int, int]:
    """Line and column, from 1, of a key; (0, 0) where it cannot be told."""
    table = ".".join(keys[:-1])
    inside = not table
    for number, line in enumerate(text.splitlines(), 1):
        header = re.match(r"\s*\[([^\]]+)\]", line)
        if header:
            if header[1].strip() == ".".join(keys):
                return number, line.index("[") + 1
            inside = header[1].strip() == table
        elif inside and (key := re.match(rf"""(\s*)["']?{re.escape(keys[-1])}["']?\s*=""", line)):
            return number, len(key[1]) + 1
    return 0, 0
