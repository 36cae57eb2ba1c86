"""Operations of the page (set, unset, add, remove, rename) on the text of a scene.

Each operation is applied to plain data: the scene of the page, with `extends` and with
the edited variant. `Target.write` then changes the text such that it means this data,
and all other lines stay as they are.
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
"""Number of digits above which a number is an arithmetic result, and is rounded
to 6.
"""

ABSENT = object()
"""Stands for no value, as opposed to null."""
_NOWHERE = Source("", File())


# The operations


def to_integer(value: object) -> object:
    """Convert an integral number to an integer, since JSON does not tell 1.0 from 1."""
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value


Index = Annotated[int, Field(strict=True, ge=0, le=10**6), BeforeValidator(to_integer)]
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
    """Replacement of an object by another one, only by corrections of masks."""

    merge: Path
    to: str


Op = SetOp | UnsetOp | AddOp | RenameOp | RemoveOp
_PARSER: TypeAdapter[Op | MergeOp] = TypeAdapter(Op | MergeOp)


@dataclass(frozen=True)
class EditResult:
    """A text after operations, and the title of the edit."""

    text: str
    title: str


def apply_operations(
    text: str, ops: Sequence[Op | Mapping[str, Any]], variant: str | None = None
) -> EditResult:
    """Apply all operations in order, to the file or to a variant.

    Raises EditError for the first impossible operation.
    """
    titles: list[str] = []
    for op in ops:
        try:
            parsed_op = _PARSER.validate_python(op)
        except ValidationError:
            raise Message.UNKNOWN_OPERATION.impossible() from None
        target = Target(text, variant)
        try:
            titles.append(_make(target, parsed_op))
        except ValueError as error:  # of the writer: a key that is too long
            raise Message.UNUSABLE_VALUE.impossible(reason=str(error)) from None
        # The next operation applies to the result of this one.
        text = target.text
    return EditResult(text, ", ".join(dict.fromkeys(titles))[:200])


def _make(target: Target, op: Op | MergeOp) -> str:
    """Apply one operation and return its title."""
    match op:
        case RemoveOp():
            return _remove(target, tuple(op.remove))
        case RenameOp():
            return _rename(target, tuple(op.rename), op.to)
        case MergeOp():
            target.write(replace_name(target.data, str(op.merge[-1]), op.to)[0])
            return f"merge {op.merge[-1]} into {op.to}"
        case UnsetOp():
            path = tuple(op.unset)
            value = None
            kind = "unset"
        case SetOp():
            path = tuple(op.set)
            value = op.value
            kind = "set"
        case AddOp():
            path = tuple(op.add)
            value = op.value
            kind = "add"
    if target.variant is not None and path[0] in SEALED:
        raise Message.VARIANT_SECTION_FIXED.impossible(path=path[0])
    if value is None:
        target.unset(path)
        return f"unset {_name(path)}"
    value = short(value)
    data = deepcopy(target.data)
    if kind == "add":
        present_value = reach(data, path)
        is_list = (schema_at(path) or {}).get("type") == "array"
        if isinstance(present_value, list) or (
            is_list and present_value in (ABSENT, None)
        ):
            value = [*(present_value if isinstance(present_value, list) else []), value]
        elif present_value is not ABSENT:
            raise Message.EXISTS_ALREADY.impossible(path=dotted(path))
    assign(data, path, value)
    holder = reach(data, path[:-1])
    # Keys that exclude each other, such as mass and density: the new one replaces the
    # others.
    for rival in rivals(kind_of(path[:-1])).get(str(path[-1]), ()):
        holder.pop(rival, None)
    target.write(data, path)
    return f"{kind} {_name(path)}"


def _name(path: KeyPath) -> str:
    """Return a path as in the history: without the section for a key of an object."""
    return dotted(path[1:] if len(path) > 2 and path[0] == "objects" else path)


def short(value: Any) -> Any:
    """Round a value to the digits that a person would write.

    Integers are written as such, and digits from arithmetic are dropped.

    >>> short([412.5000000000001, -30.0, 0.25, 12345678.9])
    [412.5, -30, 0.25, 12345678.9]
    """
    if isinstance(value, dict):
        return {str(key): short(child) for key, child in value.items()}
    if isinstance(value, list):
        return list(map(short, value))
    if isinstance(value, float):
        return _short_float(value)
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 1e5:
        if abs(value) > 1e300:
            raise Message.SENT_TOO_LARGE.impossible()
        # A large round number is written with an exponent: 4.0e5.
        if float(f"{value:.1e}") == value:
            return float(value)
    return value


def _short_float(value: float) -> float | int:
    if not math.isfinite(value):
        raise Message.SENT_NOT_FINITE.impossible()
    mantissa = repr(value).partition("e")[0].strip("-0.")
    # A number with that many digits comes from arithmetic.
    if sum(map(str.isdigit, mantissa)) >= EXACT_DIGITS:
        value = float(f"{value:.6g}")
    if value.is_integer() and abs(value) < 1e5:
        return int(value)
    return value


# Plain data


def reach(data: Any, path: KeyPath) -> Any:
    """Return the value at a path of plain data; ABSENT without one."""
    for key in path:
        is_present = isinstance(data, dict) or (
            isinstance(data, list) and isinstance(key, int) and key >= 0
        )
        try:
            if is_present:
                data = data[key]
            else:
                data = None
        except (KeyError, IndexError):
            is_present = False
        if not is_present:
            return ABSENT
    return data


def assign(data: Data, path: KeyPath, value: Any) -> None:
    """Set the value at a path, and create the mappings to it. Raises EditError."""
    holder: Any = data
    for depth, key in enumerate(path[:-1]):
        _check_holder(holder, path, depth)
        if isinstance(holder, dict):
            if holder.get(key) is None:
                holder[key] = {}
        # Only the last part of a path may append an item.
        elif key == len(holder):
            raise Message.ITEM_MISSING.impossible(path=dotted(path[: depth + 1]))
        holder = holder[key]
    if path:
        _check_holder(holder, path, len(path) - 1)
        if isinstance(holder, list) and path[-1] == len(holder):
            holder.append(value)
        holder[path[-1]] = value


def _check_holder(holder: Any, path: KeyPath, depth: int) -> None:
    """Raise EditError unless a mapping or list can hold the value of its key."""
    key = path[depth]
    if isinstance(holder, dict) and isinstance(key, str):
        return
    if isinstance(holder, list) and isinstance(key, int) and key <= len(holder):
        return
    owner = dotted(path[:depth]) or "the file"
    raise Message.PART_MISSING.impossible(key=key, owner=owner)


def take(data: Data, path: KeyPath) -> None:
    """Remove the value at a path, if there is one."""
    holder = reach(data, path[:-1])
    if isinstance(holder, dict):
        holder.pop(path[-1], None)
    elif (
        isinstance(holder, list)
        and isinstance(path[-1], int)
        and path[-1] < len(holder)
    ):
        del holder[path[-1]]


def _are_same_scenes(first: Data, second: Data) -> bool:
    """Return whether two scenes are equal but for their variants and extended files."""
    keys = {*first, *second} - set(SEALED)
    return all(are_equal(first.get(key), second.get(key)) for key in keys)


# The place of an edit in the file


class Target:
    """A file, or a variant of it.

    Raises EditError if the text cannot be read, or extends another file.
    """

    def __init__(self, text: str, variant: str | None) -> None:
        self.text = text
        self.variant = variant
        self._whole: Data = mark_values(text).data()
        if self._whole.get("extends") is not None:
            raise Message.FILE_EXTENDS.impossible()
        self.data = self._whole
        """The scene of the page, without defaults."""
        if variant is not None:
            self._edits = reach(self._whole, ("variants", variant))
            if not isinstance(self._edits, dict):
                raise Message.VARIANT_MISSING.impossible(variant=variant[:64])
            self.data = _with_edits(self._whole, self._edits)

    def write(
        self,
        data: Data,
        changed_path: KeyPath | None = None,
        new_names: Mapping[str, str] | None = None,
    ) -> None:
        """Change the text such that the scene is `data`.

        A variant sets the changed value at `changed_path` as a whole. `new_names` are
        new names of objects by the old ones. Raises EditError.
        """
        if self.variant is None:
            text = yaml_edit.write(self.text, data)
            self.text = with_true_comments(text, self.data, new_names or {})
            return
        changes = self._variant_changes(data, changed_path)
        new_edits: Data = {}
        # Removals come last.
        for path, value in sorted(
            changes.items(), key=lambda change: change[1] is ABSENT
        ):
            # A name with a dot or a bracket has no dotted key.
            if parse_key(dotted(path)) != path:
                raise Message.VARIANT_SECTION_FIXED.impossible(path=dotted(path)[:80])
            new_edits[dotted(path)] = None if value is ABSENT else value
        other_edits: Data = {}
        edits_in_place: Data = {}
        for key, value in self._edits.items():
            if not _is_key_below(key, changes):
                other_edits[key] = value
            if key in new_edits or key in other_edits:
                edits_in_place[key] = value
        # Keep the order of keys if possible; otherwise append the new ones, since a
        # later key overrides an earlier one.
        for edits in (edits_in_place | new_edits, other_edits | new_edits):
            if _are_same_scenes(_with_edits(self._whole, edits), data):
                self._write_edits(edits)
                return
        raise Message.VARIANT_NOT_WRITABLE.impossible(variant=self.variant)

    def _variant_changes(
        self, data: Data, changed_path: KeyPath | None
    ) -> dict[KeyPath, Any]:
        """Return the changed values of the scene; that at `changed_path` as a whole."""
        changes = {}
        inner_paths = []
        for path, value in _changes(self.data, data, ()):
            if path[0] in SEALED:
                continue
            if changed_path is not None and path[: len(changed_path)] == changed_path:
                inner_paths.append(path)
            else:
                changes[path] = value
        if changed_path is not None and inner_paths:
            changes[changed_path] = reach(data, changed_path)
        return changes

    def unset(self, path: KeyPath) -> None:
        """Remove a value: from a variant its edits there, or else the value itself.

        Raises EditError.
        """
        if self.variant is not None and not isinstance(path[-1], int):
            edits = {}
            for key, value in self._edits.items():
                if not _is_key_below(key, [path]):
                    edits[key] = value
            # Without an edit at the path, the variant has the value of the file.
            if edits != self._edits:
                self._write_edits(edits)
                return
        data = deepcopy(self.data)
        take(data, path)
        self.write(data, path if isinstance(path[-1], str) else path[:-1])

    def _write_edits(self, edits: Data) -> None:
        """Write the edits of the variant into the text."""
        document = deepcopy(self._whole)
        document["variants"][self.variant] = edits
        self.text = yaml_edit.write(self.text, document)


def _is_key_below(key: str, paths: Iterable[KeyPath]) -> bool:
    """Check whether a variant's key is one of these paths, or below one."""
    key_path = parse_key(key) or ()
    return any(key_path[: len(path)] == path for path in paths)


def _changes(old: Any, new: Any, path: KeyPath) -> Iterator[tuple[KeyPath, Any]]:
    """Yield the paths of differences between plain data, with new values; ABSENT if
    removed.
    """
    if isinstance(old, dict) and isinstance(new, dict):
        for key in {**old, **new}:
            yield from _changes(
                old.get(key, ABSENT), new.get(key, ABSENT), (*path, key)
            )
    # Lists of different lengths have no common places, so they change as a whole.
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (old_item, new_item) in enumerate(zip(old, new, strict=True)):
            yield from _changes(old_item, new_item, (*path, index))
    elif not are_equal(old, new):
        yield path, new


def _with_edits(scene_data: Data, edits: Mapping[str, Any]) -> Data:
    """Return the scene with the edits of a variant.

    Wrong edits are left out, and reported as problems.
    """
    root = _node(scene_data)
    for key, value in edits.items():
        with suppress(InputError):
            root = apply(root, Edit(key, _node(value), ()))
    data: Data = to_plain_data(root)
    return data


def _node(data: Any) -> Node:
    """Convert plain data to the tree of a file without a place."""
    value = data
    if isinstance(data, dict):
        value = {key: _node(child) for key, child in data.items()}
    elif isinstance(data, list):
        value = list(map(_node, data))
    return Node(value, _NOWHERE)


# Removing and renaming


def _remove(target: Target, path: KeyPath) -> str:
    """Remove an entry and all references to it; return the title. Raises EditError."""
    if reach(target.data, path) is ABSENT:
        raise Message.EDITOR_NOT_THERE.impossible(path=dotted(path))
    if path[0] in NAMED:
        names = [str(path[-1])]
    else:
        names = [dotted(path)]
    if len(path) == 2 and path[0] == "objects":
        data, removed_parts = replace_name(target.data, str(path[1]), None)
        names += removed_parts
    else:
        data = deepcopy(target.data)
        take(data, path)
        # Forces have numbers instead of names, so that edits of later forces would now
        # refer to others: remove all of them.
        if len(path) == 2 and path[0] == "forces":
            names += _change_edits(data, lambda key: None if _is_of_force(key) else key)
        elif len(path) == 2 and path[0] in NAMED:
            _change_edits(data, lambda key: None if key[:2] == path else key)
    target.write(data)
    return "remove " + " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _rename(target: Target, path: KeyPath, new_id: str) -> str:
    """Rename an entry and all references to it; return the title. Raises EditError."""
    if target.variant is not None:
        raise Message.VARIANT_CANNOT_RENAME.impossible()
    if len(path) != 2 or path[0] not in NAMED or reach(target.data, path) is ABSENT:
        raise Message.NOT_RENAMABLE.impossible(path=dotted(path))
    rule = load_published_schema()["$defs"]["name"]
    if not re.fullmatch(rule["pattern"].strip("^$"), new_id):
        raise Message.NEW_NAME_WRONG.impossible(form=rule["x-pattern"])
    section = str(path[0])
    old = str(path[1])
    title = f"rename {old} to {new_id}"
    if new_id == old:
        return title
    if reach(target.data, (section, new_id)) is not ABSENT:
        raise Message.NAME_TAKEN.impossible(name=new_id)
    if section == "objects":
        # Forces, joints and fields refer to objects; only edits of variants refer to
        # others.
        data, _ = replace_name(target.data, old, new_id)
        target.write(data, new_names={old: new_id})
        return title
    data = deepcopy(target.data)
    data[section] = _with_new_key(data[section], old, new_id)

    def change(key: KeyPath) -> KeyPath:
        if key[:2] == path:
            return (section, new_id, *key[2:])
        return key

    _change_edits(data, change)
    target.write(data, new_names={})
    return title


def _with_new_key(mapping: Data, old: str, new: str) -> Data:
    """Return a mapping with another name of one key, in the same order."""
    return {new if key == old else key: value for key, value in mapping.items()}


def replace_name(data: Data, name: str, new_name: str | None) -> tuple[Data, list[str]]:
    """Rename an object, merge it into another one, or (None) remove it.

    Returns the new data, and in words all parts that were removed with it: forces on a
    removed object, and joints of two objects that became one.
    """
    data = deepcopy(data)
    removed_parts = list[str]()
    remaining_name = new_name
    if new_name in data["objects"]:
        remaining_name = None
    if remaining_name is None:
        del data["objects"][name]
    else:
        data["objects"] = _with_new_key(data["objects"], name, remaining_name)
    joints = list(data.get("joints") or {})
    forces = _refer(data, name, new_name, removed_parts)
    if forces:
        removed_parts.insert(0, "its force" if forces == 1 else f"its {forces} forces")
    # Edits of variants that refer to a removed part are removed with it.
    removed_joints = {("joints", joint) for joint in joints}
    removed_joints -= {("joints", joint) for joint in data.get("joints") or {}}

    def change(key: KeyPath) -> KeyPath | None:
        if key[:2] == ("objects", name):
            if remaining_name is None:
                return None
            return ("objects", remaining_name, *key[2:])
        if key[:2] in removed_joints or (forces and _is_of_force(key)):
            return None
        return key

    return data, removed_parts + _change_edits(data, change)


def _refer(
    part: Data, name: str, new_name: str | None, removed_parts: list[str]
) -> int:
    """Replace an object's name in all references, in place; return the number of lost
    forces.

    `new_name` None: the object is removed. Removed parts are added to `removed_parts`
    in words.
    """
    lost_count = _refer_in_forces(part, name, new_name)
    for section in ("joints", "fields"):
        for key, entry in _entries(part, section):
            if not _refer_in_list(section, entry, name, new_name):
                del part[section][key]
                removed_parts.append(f"{section[:-1]} {key}")
    _refer_in_cameras(part, name, new_name, removed_parts)
    return lost_count


def _refer_in_forces(part: Data, name: str, new_name: str | None) -> int:
    """Replace an object's name in the forces on it; return the number of lost
    forces.
    """
    forces = part.get("forces")
    if not isinstance(forces, list):
        return 0
    own_forces = []
    for force in forces:
        if isinstance(force, dict) and force.get("object") == name:
            own_forces.append(force)
    for force in own_forces:
        force["object"] = new_name
    # A force acts on one object alone: without its object it has no meaning and is
    # removed.
    if new_name is not None:
        return 0
    part["forces"] = [force for force in forces if force not in own_forces]
    return len(own_forces)


def _refer_in_list(
    section: str, entry: Data, name: str, target_name: str | None
) -> bool:
    """Replace an object's name in a joint or a field; return whether the entry still
    has a meaning.

    Without the object, a field goes on for the others; a joint of one object, or a
    magnet without a partner, has no meaning.
    """
    list_key = "objects"
    least_count = 1
    if "magnet" in entry:
        list_key = "magnet"
        least_count = 2
    names = entry.get(list_key)
    if not isinstance(names, list) or name not in names:
        return True
    if section == "joints":
        least_count = max(least_count, len(names))
    new_names = _with_new_name(names, name, target_name)
    if len(new_names) < least_count:
        return False
    entry[list_key] = new_names
    return True


def _with_new_name(names: list[Any], old: str, new: str | None) -> list[Any]:
    """Return names with a new one for an old one, each once; without a new name, the
    old one is left out.
    """
    new_names: list[Any] = []
    for name in names:
        if name == old:
            if not new:
                continue
            name = new
        # Two objects that became one are named once.
        if name not in new_names:
            new_names.append(name)
    return new_names


def _refer_in_cameras(
    part: Data, name: str, new_name: str | None, removed_parts: list[str]
) -> None:
    """Replace an object's name in the cameras that follow it."""
    camera = reach(part, ("render", "camera"))
    if isinstance(camera, list):
        views = camera
    else:
        views = [camera]
    for view in views:
        if not isinstance(view, dict) or view.get("follow") != name:
            continue
        view["follow"] = new_name
        # A camera that follows the object stays where it is, if the object is removed.
        if new_name is None:
            del view["follow"]
            removed_parts.append("the camera that follows it")


def _change_edits(data: Data, change: Callable[[KeyPath], KeyPath | None]) -> list[str]:
    """Change the paths of all variants' keys, or (None) remove them; return those in
    words.
    """
    removed_parts = []
    for variant, edits in _entries(data, "variants"):
        new_edits: Data = {}
        for key, value in edits.items():
            path = parse_key(key) or ()
            new_path = change(path)
            if new_path is None:
                removed_parts.append(f"{key} of {variant}")
            else:
                new_edits[key if new_path == path else dotted(new_path)] = value
        data["variants"][variant] = new_edits
    return removed_parts


def _is_of_force(key: KeyPath) -> bool:
    """Check whether a variant's key has the index of a force, which a removal would
    change.
    """
    return len(key) > 1 and key[0] == "forces"


def _entries(data: Data, section: str) -> list[tuple[str, Data]]:
    """Return the mappings among the entries of a section."""
    section_data = data.get(section)
    if isinstance(section_data, dict):
        return [(k, v) for k, v in section_data.items() if isinstance(v, dict)]
    return []
