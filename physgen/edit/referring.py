"""A thing that goes or is renamed -> what else of the scene names it, and what becomes of that."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from physgen.edit.refusing import impossible
from physgen.edit.targets import ABSENT, InFile, Target, reach
from physgen.scene.overlay import parse_key
from physgen.scene.schema import published
from physgen.scene.words import KeyPath, dotted

NAMED = ("objects", "boundaries", "joints", "fields", "variants")
"""Sections whose keys are names."""


def remove(target: Target, path: KeyPath) -> str:
    """Take away a thing and all that names it; returns what was done. Raises EditError."""
    if reach(target.data(), path) is ABSENT:
        raise impossible(f"{dotted(path)} is not there", "ask for the state and edit again")
    told = [str(path[-1])] if path[0] in NAMED else [dotted(path)]
    if len(path) == 2 and path[0] == "objects":
        told += _leave(target, str(path[1]))
    if path[0] == "forces" and len(path) == 2 and isinstance(path[1], int):
        _without_forces(target, [path[1]])
    else:
        target.gone(path)
        if len(path) == 2 and path[0] in NAMED and isinstance(target, InFile):
            _unsaid(target, path)
    return "remove " + " and ".join(filter(None, [", ".join(told[:-1]), told[-1]]))


def _leave(target: Target, name: str) -> Iterator[str]:
    """What an object takes with it; what only names it among others stays."""
    data = target.data()
    forces = [at for at, force in _items(data, "forces") if force.get("object") == name]
    if forces:
        _without_forces(target, forces)
        yield "its force" if len(forces) == 1 else f"its {len(forces)} forces"
    for joint, told in _things(data, "joints"):
        if name in _names(told):
            target.gone(("joints", joint))
            if isinstance(target, InFile):
                _unsaid(target, ("joints", joint))
            yield f"joint {joint}"
    for field, told in _things(data, "fields"):
        if name in _names(told):
            rest = [other for other in _names(told) if other != name]
            if rest:
                target.put(("fields", field, "objects"), rest)
            else:
                target.gone(("fields", field))
                yield f"field {field}"
    for path in _followed(data, name):
        target.gone(path)
        yield "the camera's eye on it"
    if isinstance(target, InFile):
        _leave_variants(target, name)


def _without_forces(target: Target, gone: list[int]) -> None:
    """Forces by number; variants that count them count anew."""
    for at in sorted(gone, reverse=True):
        target.gone(("forces", at))
    if isinstance(target, InFile):
        for variant, edits in _things(target.data(), "variants"):
            for key in list(edits):
                path = parse_key(key) or ()
                if len(path) > 1 and path[0] == "forces" and isinstance(path[1], int):
                    where: KeyPath = ("variants", variant, key)
                    if path[1] in gone:
                        target.gone(where)
                    elif shift := sum(at < path[1] for at in gone):
                        target.rename(where, dotted(("forces", path[1] - shift, *path[2:])))


def _leave_variants(target: InFile, name: str) -> None:
    """What variants say of forces, joints and fields that name the object."""
    for variant, edits in _things(target.data(), "variants"):
        for key, value in list(edits.items()):
            path, where = parse_key(key) or (), ("variants", variant, key)
            match path:
                case ("forces",) if isinstance(value, list):
                    rest = [
                        item for item in value if not (isinstance(item, dict) and item.get("object") == name)
                    ]
                    if len(rest) < len(value):
                        target.put(where, rest)
                case ("joints", _) if name in _names(value):
                    target.gone(where)
                case ("joints" | "fields", _, "objects") if isinstance(value, list) and name in value:
                    target.gone(where)
                case ("fields", _) if name in _names(value):
                    rest = [other for other in _names(value) if other != name]
                    if rest:
                        target.put((*where, "objects"), rest)
                    else:
                        target.gone(where)
                case ("render", "camera", *_) if name in (
                    value,
                    value.get("follow") if isinstance(value, dict) else 0,
                ):
                    target.gone(where)
                case _:
                    pass


def _unsaid(target: InFile, path: KeyPath) -> None:
    """Variants say nothing more of what is gone."""
    for variant, edits in _things(target.data(), "variants"):
        for key in list(edits):
            if (parse_key(key) or ())[:2] == path:
                target.gone(("variants", variant, key))


def _named(target: Target, path: KeyPath, to: Any) -> tuple[InFile, str]:
    """The file, in which a thing at a path has a name, and a name. Raises EditError."""
    if not isinstance(target, InFile):
        raise impossible("a variant cannot give names", "do it in the file itself")
    if len(path) != 2 or path[0] not in NAMED or reach(target.data(), path) is ABSENT:
        fix = "name an object, a boundary, a joint, ..."
        raise impossible(f"{dotted(path)} has no name that can be changed", fix)
    rule = published()["$defs"]["name"]
    if not isinstance(to, str) or not re.fullmatch(rule["pattern"].strip("^$"), to):
        raise impossible("that is no name", f"write {rule['x-pattern']}")
    return target, to


def _free(target: InFile, path: KeyPath, to: str) -> None:
    if reach(target.data(), (path[0], to)) is not ABSENT:
        raise impossible(f"{to} is there already", "choose another name")


def rename(target: Target, path: KeyPath, to: Any) -> str:
    """Another name for a thing, wherever it is named; returns what was done. Raises EditError."""
    target, to = _named(target, path, to)
    data = target.data()
    section, old = str(path[0]), str(path[1])
    if to == old:
        return f"rename {old}"
    _free(target, path, to)
    target.rename(path, to)
    if section == "objects":
        for where in _mentions(data, old):
            target.put(where, to)
    for variant, edits in _things(target.data(), "variants"):
        for key, value in list(edits.items()):
            parts = parse_key(key) or ()
            if section == "objects":
                for inner in _within(parts, value, old):
                    target.put(("variants", variant, key, *inner), to)
            if section != "variants" and parts[:2] == path:
                target.rename(("variants", variant, key), dotted((section, to, *parts[2:])))
    return f"rename {old} to {to}"


def _mentions(data: Any, name: str) -> Iterator[KeyPath]:
    """Where a scene names an object."""
    for at, force in _items(data, "forces"):
        if force.get("object") == name:
            yield "forces", at, "object"
    for section in ("joints", "fields"):
        for thing, told in _things(data, section):
            for at, other in enumerate(_names(told)):
                if other == name:
                    yield section, thing, "objects", at
    yield from _followed(data, name)


def _within(parts: KeyPath, value: Any, name: str) -> Iterator[KeyPath]:
    """Where the value of a variant's key names an object."""
    whole: Any = value
    for part in reversed(parts):  # which item it is makes no difference: its place may be any number
        whole = [whole] if isinstance(part, int) or part == "[*]" else {part: whole}
    for path in _mentions(whole, name):
        yield path[len(parts) :]


def _followed(data: Any, name: str) -> Iterator[KeyPath]:
    camera = reach(data, ("render", "camera"))
    if isinstance(camera, dict) and camera.get("follow") == name:
        yield "render", "camera", "follow"
    if isinstance(camera, list):
        for at, view in enumerate(camera):
            if isinstance(view, dict) and view.get("follow") == name:
                yield "render", "camera", at, "follow"


def _things(data: Any, section: str) -> list[tuple[str, Mapping[str, Any]]]:
    found = reach(data, (section,))
    return [(k, v) for k, v in found.items() if isinstance(v, dict)] if isinstance(found, dict) else []


def _items(data: Any, section: str) -> list[tuple[int, Mapping[str, Any]]]:
    found = reach(data, (section,))
    return [(k, v) for k, v in enumerate(found) if isinstance(v, dict)] if isinstance(found, list) else []


def _names(told: Any) -> list[Any]:
    names = told.get("objects") if isinstance(told, dict) else None
    return names if isinstance(names, list) else []
