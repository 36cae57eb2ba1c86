"""Operations of the page (set, unset, add, remove, rename) applied to the text of a scene."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.edit.errors import impossible
from physgen.edit.targets import ABSENT, InFile, InVariant, Target, reach
from physgen.scene.overlay import parse_key
from physgen.scene.schema import expanded, published
from physgen.scene.write import schema_at
from physgen.text import KeyPath, dotted

# ----------------------------------------------------------------------
# An object that another takes in -> operations by which all that named it names the other; and what is left
# out.

Data = dict[str, Any]

OWN = ("mask", "shape", "place", "label", "prompt", "from", "mass", "density", "solid")
"""Keys of an object that mean itself alone: what a variant says of them is not true of a larger one."""


def adopted(document: Mapping[str, Any], kept: str, other: str) -> tuple[list[Data], list[str]]:
    """Operations on a scene's data, and what they leave out, in words; `other` itself is still to be removed."""
    ops: list[Data] = []
    gone: list[str] = []
    for section in ("forces", "joints", "fields", "render"):
        before = document.get(section)
        if before is None:
            continue
        after = _renamed(section, before, kept, other)
        if section == "joints" and isinstance(after, Mapping):
            for name in [name for name, told in after.items() if told is None]:
                gone.append(f"joint {name}")
                ops.append({"remove": ["joints", name]})
        ops += _differences([section], before, after)
    for variant, edits in _things(document.get("variants")):
        for key, value in edits.items():
            path = parse_key(key) or ()
            where = ["variants", variant, key]
            if path[:2] == ("objects", other):
                said = ".".join(("objects", kept, *map(str, path[2:])))
                if len(path) < 3 or path[2] in OWN or said in edits:
                    gone.append(f"{key} of {variant}")
                else:
                    ops.append({"set": ["variants", variant, said], "value": value})
                ops.append({"unset": where})
            elif path and (after := _deep(path, value, kept, other)) != value:
                ops.append({"unset": where} if after is None else {"set": where, "value": after})
                gone += [f"{key} of {variant}"] if after is None else []
    return ops, gone


def _renamed(section: str, value: Any, kept: str, other: str) -> Any:
    """A section with the one name in place of the other; a joint of the two with each other is None."""
    if section == "forces" and isinstance(value, list):
        return [_force(item, kept, other) for item in value]
    if section in ("joints", "fields") and isinstance(value, Mapping):
        return {name: _held(section, told, kept, other) for name, told in value.items()}
    if section == "render" and isinstance(value, Mapping) and "camera" in value:
        return {**value, "camera": _camera(value["camera"], kept, other)}
    return value


def _deep(path: Sequence[str | int], value: Any, kept: str, other: str) -> Any:
    """The value of a variant's key; None: it joins the object to itself."""
    match tuple(path):
        case ("forces" | "joints" | "fields" | "render" as section,):
            return _renamed(section, value, kept, other)
        case ("forces", _):
            return _force(value, kept, other)
        case ("joints" | "fields" as section, _):
            return _held(section, value, kept, other)
        case ("joints" | "fields" as section, _, "objects"):
            held = _held(section, {"objects": value}, kept, other)
            return None if held is None else held["objects"]
        case ("render", "camera"):
            return _camera(value, kept, other)
        case (
            ("forces", _, "object")
            | ("joints" | "fields", _, "objects", _)
            | ("render", "camera", *_, "follow")
        ):
            return kept if value == other else value
        case _:
            return value


def _force(item: Any, kept: str, other: str) -> Any:
    return {**item, "object": kept} if isinstance(item, Mapping) and item.get("object") == other else item


def _held(section: str, told: Any, kept: str, other: str) -> Any:
    names = told.get("objects") if isinstance(told, Mapping) else None
    if not isinstance(names, list) or other not in names:
        return told
    if section == "joints" and kept in names:
        return None
    return {**told, "objects": list(dict.fromkeys(kept if name == other else name for name in names))}


def _camera(value: Any, kept: str, other: str) -> Any:
    if isinstance(value, list):
        return [_camera(view, kept, other) for view in value]
    followed = isinstance(value, Mapping) and value.get("follow") == other
    return {**value, "follow": kept} if followed else value


def _differences(path: list[str | int], before: Any, after: Any) -> list[Data]:
    """Operations that make the one of the other, at the values that differ."""
    if before == after or after is None:
        return []
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        return [op for key in before for op in _differences([*path, key], before[key], after[key])]
    if (
        isinstance(before, list)
        and isinstance(after, list)
        and len(before) == len(after)
        and path[-1] != "objects"
    ):
        pairs = enumerate(zip(before, after, strict=True))
        return [op for k, (one, other) in pairs for op in _differences([*path, k], one, other)]
    return [{"set": path, "value": after}]


def _things(section: Any) -> list[tuple[str, Mapping[str, Any]]]:
    return (
        [(k, v) for k, v in section.items() if isinstance(v, Mapping)] if isinstance(section, Mapping) else []
    )


# ----------------------------------------------------------------------
# A thing that goes or is renamed -> what else of the scene names it, and what becomes of that.

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
    for joint, told in _referring_things(data, "joints"):
        if name in _names(told):
            target.gone(("joints", joint))
            if isinstance(target, InFile):
                _unsaid(target, ("joints", joint))
            yield f"joint {joint}"
    for field, told in _referring_things(data, "fields"):
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
        for variant, edits in _referring_things(target.data(), "variants"):
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
    for variant, edits in _referring_things(target.data(), "variants"):
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
    for variant, edits in _referring_things(target.data(), "variants"):
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
    for variant, edits in _referring_things(target.data(), "variants"):
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
        for thing, told in _referring_things(data, section):
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


def _referring_things(data: Any, section: str) -> list[tuple[str, Mapping[str, Any]]]:
    found = reach(data, (section,))
    return [(k, v) for k, v in found.items() if isinstance(v, dict)] if isinstance(found, dict) else []


def _items(data: Any, section: str) -> list[tuple[int, Mapping[str, Any]]]:
    found = reach(data, (section,))
    return [(k, v) for k, v in enumerate(found) if isinstance(v, dict)] if isinstance(found, list) else []


def _names(told: Any) -> list[Any]:
    names = told.get("objects") if isinstance(told, dict) else None
    return names if isinstance(names, list) else []


# ----------------------------------------------------------------------
# A file's text and the operations of an edit -> its text after them, and what they are called.

KINDS = {"set": ("value",), "unset": (), "add": ("value",), "rename": ("to",), "remove": ()}
"""Operations, and what each says beside its path."""
MAX_STEPS, MAX_KEY = 40, 1000
"""Keys of a path, and characters of a key."""
EXACT = 12
"""Digits from which on a number is what arithmetic left, not what anybody wrote."""


@dataclass(frozen=True)
class Edited:
    """The text, and what was done."""

    text: str
    what: str


def edited(
    text: str, ops: Sequence[Mapping[str, Any]], variant: str | None, file: Path, allow_outside: bool
) -> Edited:
    """All operations, in order, in the file or in a variant. Raises EditError for the first that cannot be made."""
    told: list[str] = []
    for op in ops:
        within = InFile(text, file, allow_outside)
        target: Target = within if variant is None else InVariant(within, variant)
        try:
            told.append(_made(target, op))
        except ValueError as error:  # of the writer: a key that is too long
            raise impossible(str(error), "send what a scene can hold") from None
        text = target.text
    return Edited(text, ", ".join(dict.fromkeys(told))[:200])


def _made(target: Target, op: Mapping[str, Any]) -> str:
    kind = next((kind for kind in KINDS if kind in op), None)
    if kind is None or set(op) != {kind, *KINDS[kind]}:
        raise impossible(
            "an operation is none that is known", 'send {"set": [...], "value": ...} or the like'
        )
    path = _path(op[kind])
    if kind == "remove":
        return remove(target, path)
    if kind == "rename":
        return rename(target, path, op["to"])
    if kind == "unset" or op["value"] is None:
        target.unset(path)
        return f"unset {_called(path)}"
    value = short(op["value"])
    if kind == "set":
        target.put(path, value)
        return f"set {_called(path)}"
    seen = reach(target.data(), path)
    if isinstance(seen, list) or (
        (schema_at(path) or expanded()).get("type") == "array" and seen in (ABSENT, None)
    ):
        target.append(path, value)
    elif seen is not ABSENT:
        raise impossible(f"{dotted(path)} is there already", "choose another name, or set it")
    else:
        target.put(path, value)
    return f"add {_called(path)}"


def _called(path: KeyPath) -> str:
    """A path as the history names it: an object's key by the object."""
    return dotted(path[1:] if len(path) > 2 and path[0] == "objects" else path)


def _path(told: Any) -> KeyPath:
    if isinstance(told, list) and 0 < len(told) <= MAX_STEPS and all(map(_is_step, told)):
        return tuple(told)
    raise impossible("a path is no list of keys and numbers", 'send ["objects", "ball", "mass"]')


def _is_step(key: Any) -> bool:
    return (isinstance(key, int) and not isinstance(key, bool) and 0 <= key <= 10**6) or (
        isinstance(key, str) and len(key) <= MAX_KEY
    )


def short(value: Any) -> Any:
    """A value as it is written: whole numbers as such, no more digits than anybody means.

    >>> short([412.5000000000001, -30.0, 0.25, 12345678.9])
    [412.5, -30, 0.25, 12345678.9]
    """
    if isinstance(value, dict):
        return {str(key): short(child) for key, child in value.items()}
    if isinstance(value, list):
        return [short(child) for child in value]
    if isinstance(value, float):
        if not math.isfinite(value):
            raise impossible("a number is not finite", "send a finite number")
        if sum(map(str.isdigit, repr(value).partition("e")[0].strip("-0."))) >= EXACT:
            value = float(f"{value:.6g}")
        return int(value) if value.is_integer() and abs(value) < 1e5 else value
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 1e5:
        if abs(value) > 1e300:
            raise impossible("a number is too large", "send a finite number")
        return float(value) if float(f"{value:.1e}") == value else value
    return value
