"""Rules of collision groups, forces, joints and fields."""

from __future__ import annotations

from itertools import pairwise
from math import hypot
from typing import Any

from physgen.messages import Message, one_of
from physgen.scene.checked_tree import (
    CheckedTree,
    check_object_name,
    check_rising,
    number_of,
    points_of,
    report_time_order,
)
from physgen.scene.document import Node, children, items
from physgen.scene.scene import MAIN_GROUP
from physgen.scene.schema import advice, find_schema_part
from physgen.text import KeyPath, listed, number, shown

FORCES = ("impulse", "force", "torque")

KINDS = {
    "joints": (
        "pivot",
        "spring",
        "weld",
        "motor",
        "slider",
        "rope",
        "pulley",
        "gear",
        "finger",
    ),
    "fields": (
        "wind",
        "air",
        "water",
        "attractor",
        "magnet",
        "belt",
        "turntable",
    ),
}

NEEDED = {
    "spring": "stiffness",
    "finger": "stiffness",
    "water": "density",
    "magnet": "pull",
    "motor": "speed",
    "wind": "drag",
    "attractor": "strength",
    "belt": "velocity",
    "turntable": "spin",
}
"""Kind of a joint or field -> its required key, without which it has no effect."""

OWNER = {
    **dict.fromkeys(("stiffness", "damping"), ("spring", "finger")),
    "length": ("spring", "rope", "pulley"),
    **dict.fromkeys(("speed", "limit"), ("motor",)),
    "limits": ("pivot", "motor"),
    "friction": ("pivot",),
    "breaks": tuple(kind for kind in KINDS["joints"] if kind != "finger"),
    **dict.fromkeys(("drive", "force"), ("slider",)),
    "drag": ("wind", "air", "water"),
    "linear": ("air", "water"),
    "density": ("water",),
    "pull": ("magnet",),
    "strength": ("attractor",),
    "soften": ("attractor", "magnet"),
    "velocity": ("belt",),
    "spin": ("turntable",),
}
"""Key of a joint or field -> the only kinds with this key."""

MOST_GROUPS = 32
"""Maximum number of collision groups: the engine has a bit for each."""

SAME_POINT = 1e-9
"""Maximum distance of equal points, px: the resolution of a float at 10^6 px."""


def check_groups(
    tree: CheckedTree,
) -> None:
    """Report unknown collision groups, and friction that grows during sliding."""
    # A dict keeps the order of the names for the message.
    names: dict[str, None] = {MAIN_GROUP: None}
    listings: list[tuple[Node, KeyPath]] = []
    for section in ("objects", "boundaries"):
        for name, node in children(tree.root, section).items():
            valid_keys = tree.valid_keys(node)
            path: KeyPath = (section, name)
            if "collision_group" in valid_keys:
                names[str(valid_keys["collision_group"].value)] = None
            for index, group in enumerate(items(valid_keys.get("collides_with"))):
                place: KeyPath = (*path, "collides_with", index)
                listings.append((group, place))
            _check_static_friction(tree, valid_keys, path)
            _check_one_way(tree, valid_keys, path)
    _check_group_names(tree, listings, list(names))


def _check_group_names(
    tree: CheckedTree, listings: list[tuple[Node, KeyPath]], names: list[str]
) -> None:
    """Report unknown groups, and more groups than the engine has bits."""
    for group, where in listings:
        if str(group.value) not in names and group not in tree.findings.bad:
            fix = one_of(str(group.value), names)
            problem = Message.UNKNOWN_GROUP.problem(
                group.place, where, shown(group.value), fix=fix
            )
            tree.report(problem)
    if len(names) > MOST_GROUPS:
        groups = f"{len(names)} collision groups"
        problem = Message.TOO_MANY_GROUPS.problem(
            tree.root.place, (), groups, most=MOST_GROUPS
        )
        tree.report(problem)


def _check_one_way(
    tree: CheckedTree, valid_keys: dict[str, Node], path: KeyPath
) -> None:
    """Report a one-way direction of zero."""
    way = valid_keys.get("one_way")
    if way is not None and not any(map(number_of, items(way))):
        key: KeyPath = (*path, "one_way")
        tree.report(Message.ONE_WAY_ZERO.problem(way.place, key, "[0, 0]"))


def _check_static_friction(
    tree: CheckedTree, valid_keys: dict[str, Node], path: KeyPath
) -> None:
    """Report a static friction below the sliding friction."""
    node = valid_keys.get("static_friction")
    if node is None:
        return
    friction = valid_keys.get("friction")
    # Objects and boundaries have different defaults.
    default = find_schema_part(f"{path[0]}.*")["properties"]["friction"]["default"]
    if friction is None:
        least = default
    else:
        least = number_of(friction)
    if number_of(node) < least:
        problem = Message.STATIC_FRICTION_LOW.problem(
            node.place,
            (*path, "static_friction"),
            shown(node.value),
            friction=number(least),
        )
        tree.report(problem)


def check_forces(
    tree: CheckedTree,
) -> None:
    """Report faults of forces: unknown objects, kinds, keys without effect,
    and times.
    """
    for index, node in enumerate(items(tree.top.get("forces"))):
        if not isinstance(node.value, dict):
            continue
        path: KeyPath = ("forces", index)
        if "object" in tree.valid_keys(node):
            check_object_name(tree, node.value["object"], (*path, "object"))
        kind = _find_kind(tree, node, path, FORCES)
        # Keys without effect are reported: the user expects an effect.
        if kind == "torque" and "at" in node.value:
            _report_no_effect(
                tree,
                node.value["at"],
                (*path, "at"),
                "a torque turns the body as a whole",
            )
        if kind == "impulse" and "profile" in node.value:
            reason = "an impulse is given at once"
            _report_no_effect(tree, node.value["profile"], (*path, "profile"), reason)
        table = children(tree.valid_keys(node).get("profile")).get("table")
        check_rising(tree, items(table), (*path, "profile", "table"))
        if kind == "impulse" and "duration" in node.value:
            reason = "an impulse is given at once"
            _report_no_effect(tree, node.value["duration"], (*path, "duration"), reason)


def check_joints(tree: CheckedTree, section: str) -> None:
    """Report faults of the joints or fields of a scene. `section` is a key of KINDS."""
    for name, node in children(tree.root, section).items():
        path: KeyPath = (section, name)
        object_names = _partner_names(tree, node, (*path, "objects"))
        if not isinstance(node.value, dict):
            continue
        _check_kind(tree, node, path, section)
        _check_magnet(tree, node, path)
        if section == "joints":
            _check_partners(tree, node, object_names, (*path, "objects"))
            _check_joint(tree, node, path, object_names)


def _partner_names(tree: CheckedTree, node: Node, path: KeyPath) -> list[Any]:
    """Report unknown objects of a joint or field; return all its usable names."""
    names = []
    for index, item in enumerate(items(children(node).get("objects"))):
        if item not in tree.findings.bad:
            check_object_name(tree, item, (*path, index))
            names.append(item.value)
    return names


def _check_partners(
    tree: CheckedTree, node: Node, names: list[Any], path: KeyPath
) -> None:
    """Report a joint between an object and itself."""
    if len(names) == 2 and names[0] == names[1]:
        place = children(node)["objects"].place
        message = Message.JOINED_TO_ITSELF
        tree.report(message.problem(place, path, shown(names[0])))


def _check_magnet(tree: CheckedTree, node: Node, path: KeyPath) -> None:
    """Report faults of a magnet's names."""
    parts = children(node)
    valid_keys = tree.valid_keys(node)
    names = items(valid_keys.get("magnet"))
    for index, item in enumerate(names):
        check_object_name(tree, item, (*path, "magnet", index))
    if names and "objects" in parts:
        reason = "the magnet names its objects"
        _report_no_effect(tree, parts["objects"], (*path, "objects"), reason)
    if len({str(item.value) for item in names}) < len(names):
        place = valid_keys["magnet"].place
        tree.report(Message.NAMED_TWICE.problem(place, (*path, "magnet")))
    _check_finger(tree, node, path)


def _check_finger(tree: CheckedTree, node: Node, path: KeyPath) -> None:
    """Report faults of a finger's knots, and a finger on two objects."""
    parts = children(node)
    valid_keys = tree.valid_keys(node)
    before: Any = None
    for index, knot in enumerate(items(valid_keys.get("finger"))):
        now: Any = items(knot)[0].value
        where: KeyPath = (*path, "finger", index, 0)
        time = items(knot)[0]
        # One fault per list: later times depend on the wrong one.
        if now < 0:
            problem = Message.TIME_NEGATIVE.problem(
                time.place, where, shown(now), items="knots"
            )
            tree.report(problem)
            break
        if before is not None and now <= before:
            report_time_order(tree, time, where, before, "knots")
            break
        before = now
    # A finger pulls one object towards a point of the picture.
    if "finger" in parts and len(items(parts.get("objects"))) > 1:
        place = parts["objects"].place
        tree.report(Message.FINGER_ON_TWO.problem(place, (*path, "objects")))


def _check_joint(
    tree: CheckedTree, node: Node, path: KeyPath, names: list[Any]
) -> None:
    """Report a gear on one object, a rail without length, and a missing drive."""
    parts = children(node)
    valid_keys = tree.valid_keys(node)
    if "gear" in parts and len(names) == 1:
        place = parts["objects"].place
        tree.report(Message.GEAR_ON_ONE.problem(place, (*path, "objects")))
    if "gear" in valid_keys and valid_keys["gear"].value == 0:
        place = valid_keys["gear"].place
        tree.report(Message.GEAR_ZERO.problem(place, (*path, "gear"), "0"))
    _check_joint_ends(tree, valid_keys, path)
    if "force" in parts and "drive" not in parts and "slider" in parts:
        fix = advice(find_schema_part("joints.*")["properties"]["drive"])
        key: KeyPath = (*path, "drive")
        message = Message.FORCE_WITHOUT_DRIVE
        tree.report(message.problem(node.place, key, fix=fix))
    _check_rope(tree, valid_keys, path)


def _check_joint_ends(
    tree: CheckedTree, valid_keys: dict[str, Node], path: KeyPath
) -> None:
    """Report a rail or a rope without length."""
    has_length = "length" in valid_keys and number_of(valid_keys["length"]) > 0
    for kind in ("slider", "pulley", "rope"):
        # A rope of a stated length may begin at its own end.
        if kind == "rope" and has_length:
            continue
        if kind in valid_keys:
            ends = points_of(valid_keys[kind])
        else:
            ends = []
        for one, other in pairwise(ends[:2] if kind == "slider" else ends):
            if max(abs(a - b) for a, b in zip(one, other, strict=True)) < SAME_POINT:
                place = valid_keys[kind].place
                tree.report(Message.SAME_ENDS.problem(place, (*path, kind)))
                break


def _check_rope(tree: CheckedTree, valid_keys: dict[str, Node], path: KeyPath) -> None:
    """Report a rope shorter than the distance of its points."""
    for kind in ("rope", "pulley"):
        if kind not in valid_keys or "length" not in valid_keys:
            continue
        least = sum(
            hypot(one[0] - other[0], one[1] - other[1])
            for one, other in pairwise(points_of(valid_keys[kind]))
        )
        # The tolerance is relative: lengths may be thousands of px.
        if number_of(valid_keys["length"]) < least - SAME_POINT * least:
            length = valid_keys["length"]
            problem = Message.ROPE_SHORT.problem(
                length.place, (*path, "length"), shown(length.value), least=least
            )
            tree.report(problem)


def _find_kind(
    tree: CheckedTree, node: Node, path: KeyPath, kinds: tuple[str, ...]
) -> str | None:
    """Return the only kind of a mapping. Report a mapping without a kind, or with
    several.
    """
    given = []
    for key in kinds:
        if key in children(node):
            given.append(key)
    if len(given) == 1:
        return given[0]
    known = find_schema_part(f"{path[0]}.*" if path[0] in KINDS else "forces")
    known = known.get("items", known)["properties"]
    if not given and any(key not in known for key in children(node)):
        # The message about the unknown key lists the kinds.
        return None
    if given:
        content = f"has {listed(given, 'and')}"
    else:
        content = f"has no {listed(kinds)}"
    problem = Message.NOT_ONE_KEY.problem(
        node.place, path, content=content, kinds=listed(kinds, "and")
    )
    tree.report(problem)
    return None


def _check_kind(tree: CheckedTree, node: Node, path: KeyPath, section: str) -> None:
    """Report a joint or field unless it has one kind, the required key of the kind, and
    no keys of other kinds.
    """
    kind = _find_kind(tree, node, path, KINDS[section])
    if kind is None:
        return
    # A key of another kind has no effect. Readers of the file would believe that it has
    # one: it is a problem rather than a warning.
    parts = children(node)
    needed = NEEDED.get(kind)
    if needed and needed not in parts:
        fix = advice(find_schema_part(f"{section}.*")["properties"][needed])
        where: KeyPath = (*path, needed)
        missing = Message.KEY_NEEDED
        tree.report(missing.problem(node.place, where, kind=_a(kind), fix=fix))
    for key, owner in OWNER.items():
        if key in parts and kind not in owner:
            owners = listed(list(map(_a, owner)))
            reason = f"only {owners} has it, and this is {_a(kind)}"
            _report_no_effect(tree, parts[key], (*path, key), reason)


def _report_no_effect(
    tree: CheckedTree, node: Node, path: KeyPath, reason: str
) -> None:
    """Report a key without effect."""
    message = Message.HAS_NO_EFFECT
    tree.report(message.problem(node.key_place, path, why=reason))


def _a(word: str) -> str:
    """Return a word with its article. Substances have none."""
    if word in ("air", "water", "wind"):
        return word
    return f"{'an' if word[0] in 'aeiou' else 'a'} {word}"
