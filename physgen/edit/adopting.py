"""An object that another takes in -> operations by which all that named it names the other; and what is left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from physgen.scene.overlay import parse_key

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
