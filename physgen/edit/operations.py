"""Operations of the page (set, unset, add, remove, rename) applied to the text of a scene.

Each operation is made on plain data: the scene as the page shows it, with what the file extends and with the variant
that is edited. `Target.write` then changes the text, such that it means that data and all other lines stay as they are.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path as File
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    JsonValue,
    TypeAdapter,
    ValidationError,
)

from physgen.messages import Message
from physgen.problems import InputError
from physgen.scene import yaml_edit
from physgen.scene.document import Node, Source, to_plain_data
from physgen.scene.overlay import NAMED, SEALED, Edit, apply, kind_of, parse_key, rivals
from physgen.scene.schema import load_published_schema, schema_at
from physgen.scene.yaml_comments import with_true_comments
from physgen.scene.yaml_edit import are_equal, mark_values
from physgen.text import KeyPath, dotted

Data = dict[str, Any]

EXACT_DIGITS = 15
"""Digits from which on a number is an arithmetic result, and is rounded to 6."""

ABSENT = object()
"""No value, as opposed to null."""
_NOWHERE = Source("", File())


# The operations


def whole(value: object) -> object:
    """An integral number as an integer: JSON does not tell 1.0 from 1."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


Index = Annotated[int, Field(strict=True, ge=0, le=10**6), BeforeValidator(whole)]
Path = Annotated[
    list[Annotated[str, Field(max_length=1000)] | Index],
    Field(min_length=1, max_length=64),
]
"""Keys, and indices from 0."""


class Body(BaseModel):
    """Part of a request; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", strict=True)


class SetOp(Body):
    set: Path
    value: JsonValue


class UnsetOp(Body):
    unset: Path


class AddOp(Body):
    add: Path
    value: JsonValue


class RenameOp(Body):
    rename: Path
    to: str


class RemoveOp(Body):
    remove: Path


class MergeOp(Body):
    """An object is replaced by another; only corrections of masks make it."""

    merge: Path
    to: str


Op = SetOp | UnsetOp | AddOp | RenameOp | RemoveOp
_PARSER: TypeAdapter[Op | MergeOp] = TypeAdapter(Op | MergeOp)


@dataclass(frozen=True)
class Edited:
    """A text after operations, and their names."""

    text: str
    what: str


def edited(
    text: str, ops: Sequence[Op | Mapping[str, Any]], variant: str | None = None
) -> Edited:
    """All operations, in order, in the file or in a variant. Raises EditError for the first that is impossible."""
    made: list[str] = []
    for op in ops:
        try:
            parsed = _PARSER.validate_python(op)
        except ValidationError:
            raise Message.UNKNOWN_OPERATION.impossible() from None
        target = Target(text, variant)
        try:
            made.append(_make(target, parsed))
        except ValueError as error:  # of the writer: a key that is too long
            raise Message.UNUSABLE_VALUE.impossible(reason=str(error)) from None
        text = target.text
    return Edited(text, ", ".join(dict.fromkeys(made))[:200])


def _make(target: Target, op: Op | MergeOp) -> str:
    """Make one operation; returns its name."""
    match op:
        case RemoveOp():
            return _remove(target, tuple(op.remove))
        case RenameOp():
            return _rename(target, tuple(op.rename), op.to)
        case MergeOp():
            target.write(replaced(target.data, str(op.merge[-1]), op.to)[0])
            return f"merge {op.merge[-1]} into {op.to}"
        case UnsetOp():
            path, value, kind = tuple(op.unset), None, "unset"
        case SetOp():
            path, value, kind = tuple(op.set), op.value, "set"
        case AddOp():
            path, value, kind = tuple(op.add), op.value, "add"
    if target.variant is not None and path[0] in SEALED:
        raise Message.VARIANT_SECTION_FIXED.impossible(path=path[0])
    if value is None:
        target.unset(path)
        return f"unset {_name(path)}"
    value, data = short(value), deepcopy(target.data)
    if kind == "add":
        seen = reach(data, path)
        is_list = (schema_at(path) or {}).get("type") == "array"
        if isinstance(seen, list) or (is_list and seen in (ABSENT, None)):
            value = [*(seen if isinstance(seen, list) else []), value]
        elif seen is not ABSENT:
            raise Message.EXISTS_ALREADY.impossible(path=dotted(path))
    assign(data, path, value)
    holder = reach(data, path[:-1])
    for rival in rivals(kind_of(path[:-1])).get(str(path[-1]), ()):
        holder.pop(rival, None)
    target.write(data, path)
    return f"{kind} {_name(path)}"


def _name(path: KeyPath) -> str:
    """A path as the history shows it: without the section for a key of an object."""
    return dotted(path[1:] if len(path) > 2 and path[0] == "objects" else path)


def short(value: Any) -> Any:
    """A value as it is written: integers as such, and no digits that only come from arithmetic.

    >>> short([412.5000000000001, -30.0, 0.25, 12345678.9])
    [412.5, -30, 0.25, 12345678.9]
    """
    if isinstance(value, dict):
        return {str(key): short(child) for key, child in value.items()}
    if isinstance(value, list):
        return [short(child) for child in value]
    if isinstance(value, float):
        if not math.isfinite(value):
            raise Message.SENT_NOT_FINITE.impossible()
        if (
            sum(map(str.isdigit, repr(value).partition("e")[0].strip("-0.")))
            >= EXACT_DIGITS
        ):
            value = float(f"{value:.6g}")
        return int(value) if value.is_integer() and abs(value) < 1e5 else value
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 1e5:
        if abs(value) > 1e300:
            raise Message.SENT_TOO_LARGE.impossible()
        return float(value) if float(f"{value:.1e}") == value else value
    return value


# Plain data


def reach(data: Any, path: KeyPath) -> Any:
    """The value at a path of plain data; ABSENT where there is none."""
    for key in path:
        held = isinstance(data, dict) or (
            isinstance(data, list) and isinstance(key, int) and key >= 0
        )
        try:
            data = data[key] if held else None
        except (KeyError, IndexError):
            held = False
        if not held:
            return ABSENT
    return data


def assign(data: Data, path: KeyPath, value: Any) -> None:
    """Set the value at a path, and make the mappings that lead to it. Raises EditError."""
    holder: Any = data
    for depth, key in enumerate(path):
        if isinstance(holder, dict) and isinstance(key, str):
            if depth + 1 < len(path) and holder.get(key) is None:
                holder[key] = {}
        elif (
            not isinstance(holder, list)
            or not isinstance(key, int)
            or key > len(holder)
        ):
            where = dotted(path[:depth]) or "the file"
            raise Message.PART_MISSING.impossible(key=key, owner=where)
        elif key == len(holder):
            if depth + 1 < len(path):
                raise Message.ITEM_MISSING.impossible(path=dotted(path[: depth + 1]))
            holder.append(value)
        if depth + 1 < len(path):
            holder = holder[key]
        else:
            holder[key] = value


def take(data: Data, path: KeyPath) -> None:
    """Remove what is at a path, if anything is."""
    holder = reach(data, path[:-1])
    if isinstance(holder, dict):
        holder.pop(path[-1], None)
    elif (
        isinstance(holder, list)
        and isinstance(path[-1], int)
        and path[-1] < len(holder)
    ):
        del holder[path[-1]]


# Where an edit is written


class Target:
    """A file, or a variant of it. Raises EditError where the text cannot be read, or extends another file."""

    def __init__(self, text: str, variant: str | None) -> None:
        self.text, self.variant = text, variant
        self._whole: Data = mark_values(text).data()
        if self._whole.get("extends") is not None:
            raise Message.FILE_EXTENDS.impossible()
        self.data = self._whole
        """The scene as the page shows it, without defaults."""
        if variant is not None:
            self._edits = reach(self._whole, ("variants", variant))
            if not isinstance(self._edits, dict):
                raise Message.VARIANT_MISSING.impossible(variant=variant[:64])
            self.data = _with_edits(self._whole, self._edits)

    def write(
        self,
        data: Data,
        at: KeyPath | None = None,
        renamed: Mapping[str, str] | None = None,
    ) -> None:
        """Change the text such that the scene is `data`; a variant sets what changes at a path `at` as a whole.

        `renamed` are new names of objects by the old. Raises EditError.
        """
        if self.variant is None:
            text = yaml_edit.write(self.text, data)
            self.text = with_true_comments(text, self.data, renamed or {})
            return
        changes = {
            path: value
            for path, value in _changes(self.data, data, ())
            if path[0] not in SEALED
        }
        if at is not None and any(path[: len(at)] == at for path in changes):
            changes = {
                path: value for path, value in changes.items() if path[: len(at)] != at
            }
            changes[at] = reach(data, at)
        made: Data = {}
        for path, value in sorted(
            changes.items(), key=lambda change: change[1] is ABSENT
        ):
            if parse_key(dotted(path)) != path:
                raise Message.VARIANT_SECTION_FIXED.impossible(path=dotted(path)[:80])
            made[dotted(path)] = None if value is ABSENT else value
        others = {
            key: value
            for key, value in self._edits.items()
            if not _is_below(key, changes)
        }
        in_place = {
            key: value
            for key, value in self._edits.items()
            if key in made or key in others
        }
        for edits in (
            in_place | made,
            others | made,
        ):  # a later key may override one that stays in its place
            now = _with_edits(self._whole, edits)
            if all(
                are_equal(now.get(key), data.get(key))
                for key in {*now, *data} - set(SEALED)
            ):
                self._write_edits(edits)
                return
        raise Message.VARIANT_NOT_WRITABLE.impossible(variant=self.variant)

    def unset(self, path: KeyPath) -> None:
        """Remove a value: in a variant what the variant changes there, or else the value itself. Raises EditError."""
        if self.variant is not None and not isinstance(path[-1], int):
            edits = {
                key: value
                for key, value in self._edits.items()
                if not _is_below(key, [path])
            }
            if edits != self._edits:
                self._write_edits(edits)
                return
        data = deepcopy(self.data)
        take(data, path)
        self.write(data, path if isinstance(path[-1], str) else path[:-1])

    def _write_edits(self, edits: Data) -> None:
        whole = deepcopy(self._whole)
        whole["variants"][self.variant] = edits
        self.text = yaml_edit.write(self.text, whole)


def _is_below(key: str, paths: Iterable[KeyPath]) -> bool:
    """Whether a variant's key is one of these paths, or below one."""
    own = parse_key(key) or ()
    return any(own[: len(path)] == path for path in paths)


def _changes(old: Any, new: Any, path: KeyPath) -> Iterator[tuple[KeyPath, Any]]:
    """Paths at which plain data differs, with the new values; ABSENT for what goes."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in {**old, **new}:
            yield from _changes(
                old.get(key, ABSENT), new.get(key, ABSENT), (*path, key)
            )
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for at, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from _changes(one, other, (*path, at))
    elif not are_equal(old, new):
        yield path, new


def _with_edits(whole: Data, edits: Mapping[str, Any]) -> Data:
    """The scene with the edits of a variant; wrong ones, which are reported as problems, are left out."""
    root = _node(whole)
    for key, value in edits.items():
        with suppress(InputError):
            root = apply(root, Edit(key, _node(value), ()))
    made: Data = to_plain_data(root)
    return made


def _node(data: Any) -> Node:
    """Plain data as the tree of a file that is nowhere."""
    value = data
    if isinstance(data, dict):
        value = {key: _node(child) for key, child in data.items()}
    elif isinstance(data, list):
        value = [_node(child) for child in data]
    return Node(value, _NOWHERE)


# Removing and renaming


def _remove(target: Target, path: KeyPath) -> str:
    """Remove an entry and what refers to it; returns the name of the edit. Raises EditError."""
    if reach(target.data, path) is ABSENT:
        raise Message.EDITOR_NOT_THERE.impossible(path=dotted(path))
    names = [str(path[-1])] if path[0] in NAMED else [dotted(path)]
    if len(path) == 2 and path[0] == "objects":
        data, gone = replaced(target.data, str(path[1]), None)
        names += gone
    else:
        data = deepcopy(target.data)
        take(data, path)
        if len(path) == 2 and path[0] == "forces":
            names += _change_edits(data, lambda key: None if _is_of_force(key) else key)
        elif len(path) == 2 and path[0] in NAMED:
            _change_edits(data, lambda key: None if key[:2] == path else key)
    target.write(data)
    return "remove " + " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _rename(target: Target, path: KeyPath, to: str) -> str:
    """Rename an entry and what refers to it; returns the name of the edit. Raises EditError."""
    if target.variant is not None:
        raise Message.VARIANT_CANNOT_RENAME.impossible()
    if len(path) != 2 or path[0] not in NAMED or reach(target.data, path) is ABSENT:
        raise Message.NOT_RENAMABLE.impossible(path=dotted(path))
    rule = load_published_schema()["$defs"]["name"]
    if not re.fullmatch(rule["pattern"].strip("^$"), to):
        raise Message.NEW_NAME_WRONG.impossible(form=rule["x-pattern"])
    section, old = str(path[0]), str(path[1])
    renamed = {old: to} if section == "objects" else {}
    if to != old:
        if reach(target.data, (section, to)) is not ABSENT:
            raise Message.NAME_TAKEN.impossible(name=to)
        if section == "objects":
            data, _ = replaced(target.data, old, to)
        else:
            data = deepcopy(target.data)
            data[section] = {
                to if key == old else key: value for key, value in data[section].items()
            }
            _change_edits(
                data, lambda key: (section, to, *key[2:]) if key[:2] == path else key
            )
        target.write(data, renamed=renamed)
    return f"rename {old} to {to}"


def replaced(data: Data, name: str, to: str | None) -> tuple[Data, list[str]]:
    """A scene in which an object has another name, is merged into another object, or (None) is gone.

    Also returns, in words, what went with it: forces on an object that is gone, joints of two that became one.
    """
    data, gone = deepcopy(data), list[str]()
    merged = to in data["objects"]
    if to is None or merged:
        del data["objects"][name]
    else:
        data["objects"] = {
            to if key == name else key: value for key, value in data["objects"].items()
        }
    joints = list(data.get("joints") or {})
    forces = _refer(data, name, to, gone)
    if forces:
        gone.insert(0, "its force" if forces == 1 else f"its {forces} forces")
    lost = {("joints", joint) for joint in joints if joint not in data["joints"]}

    def change(key: KeyPath) -> KeyPath | None:
        if key[:2] == ("objects", name):
            return None if to is None or merged else ("objects", to, *key[2:])
        return None if key[:2] in lost or (forces and _is_of_force(key)) else key

    return data, gone + _change_edits(data, change)


def _refer(part: Data, name: str, to: str | None, gone: list[str]) -> int:
    """Replace an object's name wherever a scene refers to it, in place; returns the number of forces that go."""
    forces, dropped = part.get("forces"), 0
    if isinstance(forces, list):
        own = [
            force
            for force in forces
            if isinstance(force, dict) and force.get("object") == name
        ]
        for force in own:
            force["object"] = to
        dropped = len(own) if to is None else 0
        part["forces"] = [
            force for force in forces if to is not None or force not in own
        ]
    for section in ("joints", "fields"):
        for key, entry in _entries(part, section):
            list_key = "magnet" if "magnet" in entry else "objects"
            names = entry.get(list_key)
            if not isinstance(names, list) or name not in names:
                continue
            rest = list(
                dict.fromkeys(
                    to if one == name else one for one in names if one != name or to
                )
            )
            is_pair = section == "joints" and len(rest) < len(names)
            is_alone = list_key == "magnet" and len(rest) < 2
            if not rest or is_pair or is_alone:
                del part[section][key]
                gone.append(f"{section[:-1]} {key}")
            else:
                entry[list_key] = rest
    camera = reach(part, ("render", "camera"))
    for view in camera if isinstance(camera, list) else [camera]:
        if isinstance(view, dict) and view.get("follow") == name:
            view["follow"] = to
            if to is None:
                del view["follow"]
                gone.append("the camera that follows it")
    return dropped


def _change_edits(data: Data, change: Callable[[KeyPath], KeyPath | None]) -> list[str]:
    """Give the keys of all variants other paths, or (None) remove them; returns those, in words."""
    gone = []
    for variant, edits in _entries(data, "variants"):
        made: Data = {}
        for key, value in edits.items():
            path = parse_key(key) or ()
            new = change(path)
            if new is None:
                gone.append(f"{key} of {variant}")
            else:
                made[key if new == path else dotted(new)] = value
        data["variants"][variant] = made
    return gone


def _is_of_force(key: KeyPath) -> bool:
    """Whether a variant's key counts the forces, of which one goes."""
    return len(key) > 1 and key[0] == "forces"


def _entries(data: Data, section: str) -> list[tuple[str, Data]]:
    """The entries of a section that are mappings."""
    found = data.get(section)
    return (
        [(k, v) for k, v in found.items() if isinstance(v, dict)]
        if isinstance(found, dict)
        else []
    )
