"""The table of backends and a plan -> who can do each step here, what is missing for the rest, and how to get it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from physgen import backends
from physgen.backends import Backend, Weights, install
from physgen.crew import Plan

WIDTH = 24
"""Of the column of names."""
MAP = "file"
"""The name of the rows that take another program's map, which somebody has to name."""


def listing(plan: Plan | None = None) -> list[Mapping[str, Any]]:
    """One mapping a row: role, name, default, chosen, ready, missing, install, weights, settings, about.

    `chosen` rows are those that `plan` takes, `ready` those that would run now; nothing is imported or fetched.
    `weights` of rows that take another program's map is that file.
    """
    plan = plan or Plan()
    return [_row(row, plan) for row in backends.BACKENDS]


def _row(row: Backend, plan: Plan) -> dict[str, Any]:
    chosen = plan.row(row.role) is row
    said = plan.choices[row.role].weights if chosen and row.role in plan.choices else ""
    kept = _kept(row, said)
    unset = (
        [name for name in row.settings if not os.environ.get(name) and name not in _told(row, plan)]
        if not said
        else []
    )
    return {
        "role": row.role,
        "name": row.name,
        "default": row is backends.find(row.role),
        "chosen": chosen,
        "installed": not row.missing(),
        "ready": not row.missing() and not unset and all(one["here"] for one in kept),
        "missing": list(row.missing()),
        "install": install(row),
        "weights": kept,
        "unset": unset,
        "about": row.about,
    }


def _kept(row: Backend, said: str) -> list[dict[str, Any]]:
    """What a row reads when it runs: its own weights, those that `said` names in their place, or a map's file."""
    if row.name == MAP:
        there = bool(said) and Path(said).expanduser().is_file()
        get = "" if said else f"write {row.role}={row.name}:PATH"
        return [{"id": said, "size": "", "licence": "", "here": there, "get": get}]
    # where one path is meant, it may have a comma in its name
    parts = [part.strip() for part in said.split(",")] if len(row.weights) > 1 else [said] * len(row.weights)
    parts += [""] * (len(row.weights) - len(parts))
    owns = (*row.weights, *(Weights("", "", "") for _ in parts[len(row.weights) :]))
    return [
        {"id": part, "size": "", "licence": "", "here": here(part), "get": ""}
        if part
        else {"id": own.id, "size": own.size, "licence": own.licence, "here": here(own.id), "get": how(own)}
        for own, part in zip(owns, parts, strict=True)
    ]


def _told(row: Backend, plan: Plan) -> Iterator[str]:
    """Settings that the configuration's table for the backend holds: `url` for PHYSGEN_VLM_URL."""
    options = plan.options.get(row.name, {})
    return (name for name in row.settings if options.get(name.rsplit("_", 1)[-1].lower()))


def here(weights: str) -> bool:
    """Whether weights lie on this machine: at a path, or in the hub's cache."""
    if not weights:
        return False
    if Path(weights).expanduser().exists():
        return True
    return cached(weights)


def cached(weights: str) -> bool:
    """Whether anything of a hub id has been fetched before."""
    return any((hub_cache() / f"models--{weights.replace('/', '--')}" / "snapshots").glob("*/*"))


def hub_cache() -> Path:
    """Where the hub's library keeps what it fetches: as `huggingface_hub.constants` finds it, not imported."""
    said = os.environ.get
    home = said("HF_HOME", os.path.join(said("XDG_CACHE_HOME", "~/.cache"), "huggingface"))
    cache = said("HF_HUB_CACHE", said("HUGGINGFACE_HUB_CACHE", os.path.join(home, "hub")))
    return Path(os.path.expandvars(os.path.expanduser(cache)))


def how(weights: Weights) -> str:
    """How to get weights."""
    return weights.get or f"hf download {weights.id}"


def text(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Lines for people: a role, its backends, and below each what it still lacks."""
    role = None
    for row in rows:
        if row["role"] != role:
            role = row["role"]
            yield role
        yield f"  {'*' if row['chosen'] else ' '} {row['name']:<{WIDTH}} {row['about']}"
        yield from (f"{'':{WIDTH + 5}}{line}" for line in _lacks(row))


def _lacks(row: Mapping[str, Any]) -> Iterator[str]:
    if row["missing"]:
        yield f"[needs {', '.join(row['missing'])}: {row['install']}]"
    for one in row["weights"]:
        if row["name"] == MAP and not one["id"]:
            yield f"[{one['get']}]"
            continue
        what = ", ".join(part for part in (one["size"], one["licence"]) if part)
        named = f"{one['id'] or 'its file'}" + (f" ({what})" if what else "")
        yield (
            f"{named}, here"
            if one["here"]
            else f"[lacks {named}" + (f": {one['get']}]" if one["get"] else "]")
        )
    if row["unset"]:
        yield f"[set {' and '.join(row['unset'])}]"
