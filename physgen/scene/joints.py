"""Forces, joints and fields of a tree -> Problems: whom they name, and keys that mean nothing for their kind."""

from __future__ import annotations

from collections.abc import Mapping

from physgen.scene.advice import advice
from physgen.scene.node import Node, children, items
from physgen.scene.report import Report
from physgen.scene.schema import Schema, at
from physgen.scene.words import KeyPath, listed, nearest, quoted, shown

FORCES = ("impulse", "force", "torque")
JOINTS = ("pivot", "spring", "weld", "motor")
FIELDS = ("wind", "attractor")

_NEEDED = {"spring": "stiffness", "motor": "speed", "wind": "drag", "attractor": "strength"}
"""Kind -> the key without which it would do nothing."""

_OWNER = {
    **dict.fromkeys(("stiffness", "damping", "length"), "spring"),
    **dict.fromkeys(("speed", "limit"), "motor"),
    "drag": "wind",
    **dict.fromkeys(("strength", "soften"), "attractor"),
}
"""Key -> the only kind that it means something for."""


def check_joints(root: Node, report: Report) -> None:
    """Adds what is wrong between the keys of joints and fields."""
    names = children(root, "objects")
    for section, kinds in (("joints", JOINTS), ("fields", FIELDS)):
        for name, node in children(root, section).items():
            if not isinstance(node.value, dict):
                continue
            path: KeyPath = (section, name)
            parts = node.value
            for index, item in enumerate(items(parts.get("objects"))):
                if item not in report.bad:
                    check_name(item, (*path, "objects", index), names, report)
            if node in report.ruled:
                continue
            report.ruled.add(node)
            _kind(node, path, kinds, at(f"{section}.*"), report)
            if section == "joints":
                _not_itself(parts.get("objects"), path, report)


def check_name(node: Node, path: KeyPath, names: Mapping[str, Node], report: Report) -> None:
    """Adds a problem where a value names no object of the scene."""
    if str(node.value) in names:
        return
    close = nearest(str(node.value), names)
    fix = f"did you mean {quoted(close)}?" if close else f"write {listed(list(names)[:30])}"
    if not names:
        fix = "write it under objects first"
    report.add(node.place, path, shown(node.value), "is not an object of this scene", fix)


def check_forces(root: Node, report: Report) -> None:
    """Adds what is wrong between the keys of forces."""
    names = children(root, "objects")
    for index, node in enumerate(items(children(root).get("forces"))):
        if not isinstance(node.value, dict):
            continue
        path: KeyPath = ("forces", index)
        parts = node.value
        target = parts.get("object")
        if target is not None and target not in report.bad:
            check_name(target, (*path, "object"), names, report)
        kind = _one_of(node, path, FORCES, report)
        senseless = {"torque": "at", "impulse": "duration"}.get(kind or "")
        if senseless in parts:
            why = "a torque turns the body as a whole" if senseless == "at" else "an impulse is given at once"
            _senseless(parts[senseless], (*path, senseless), why, report)


def _one_of(node: Node, path: KeyPath, kinds: tuple[str, ...], report: Report) -> str | None:
    """The one kind that a mapping has; a problem where it has none or several."""
    given = [key for key in kinds if key in children(node)]
    if len(given) == 1:
        return given[0]
    has = f"has {listed(given, 'and')}" if given else f"has no {listed(kinds)}"
    report.add(node.place, path, "", has, f"write exactly one of {listed(kinds, 'and')}")
    return None


def _kind(node: Node, path: KeyPath, kinds: tuple[str, ...], schema: Schema, report: Report) -> None:
    """Exactly one kind, with the key that it needs and without those of other kinds."""
    kind = _one_of(node, path, kinds, report)
    if kind is None:
        return
    parts = children(node)
    needed = _NEEDED.get(kind)
    if needed and needed not in parts:
        fix = advice(schema["properties"][needed])
        report.add(node.place, (*path, needed), "", f"missing, and {_a(kind)} needs it", fix)
    for key, owner in _OWNER.items():
        if key in parts and owner != kind:
            why = f"it belongs to {_a(owner)}, and this is {_a(kind)}"
            _senseless(parts[key], (*path, key), why, report)


def _a(word: str) -> str:
    return f"{'an' if word[0] in 'aeiou' else 'a'} {word}"


def _senseless(node: Node, path: KeyPath, why: str, report: Report) -> None:
    report.add(node.key_place, path, "", f"has no meaning here: {why}", "take it out")


def _not_itself(objects: Node | None, path: KeyPath, report: Report) -> None:
    names = [item.value for item in items(objects) if item not in report.bad]
    if objects is not None and len(names) == 2 and names[0] == names[1]:
        fix = "name two objects, or one to hold it to the world"
        report.add(objects.place, (*path, "objects"), shown(names[0]), "is joined to itself", fix)
