"""Scene files with the mistakes that people make when they edit by hand.

`write_mistaken_scene` copies a scene into a folder, applies one to three mistakes
to it and returns their names. The mistakes act on three levels:

- `TREE_MISTAKES` change the parsed document (references to removed objects, metres
  in place of pixels); the document is then written again.
- `TEXT_MISTAKES` change lines of the file (indentation, units, colons, quotes).
- `ENCODINGS` change the bytes of the file (byte order marks, line ends).
"""

from __future__ import annotations

import json
import random
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

Tree = dict[str, Any]
TreeMistake = Callable[[Tree, random.Random], None]
TextMistake = Callable[[str, random.Random], str]
Encoding = Callable[[str], bytes]

ROOT = Path(__file__).resolve().parent.parent
NUMBER = re.compile(r"(?<![\w.#-])-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(?![\w.])")
KEY = re.compile(r"^(?P<indent> *)(?P<key>[\w.-]+):(?P<rest>.*)$")
ENTRY = re.compile(r"^  [\w-]+:")
"""First line of an object, a boundary or a joint in the style of the bundled scenes."""

WRITTEN_NUMBERS = (
    "0,5", "1.000,5", "1_000", "50%", "1/2", "~3", "approx 5", "5-6", "1e3 g", "+5",
    "\u22125", "\uff15", "0x10", "010", ".5", "5.", "1:30", "inf", "None", "null", "yes",
    "5e", "--5", "5 5", "1e-320", "1e308", "three", "'7'", "[7]", "{a: 7}", "<7>", "?",
)  # fmt: skip
"""Numbers as people write them, most of which YAML or the schema does not accept."""
UNITS = (
    "g", "kg", "mg", "t", "lb", "mm", "cm", "m", "km", "in", "px", "m/s", "px/s", "km/h",
    "mph", "m/s²", "m/s^2", "g", "N", "Ns", "N s", "deg", "°", "rad", "rpm", "%", "s", "ms",
    "min", "fps", "Hz", "kg/m²", "g/cm³", "kg m/s", "N·m", "Nm", "degrees", "seconds", "pixels",
    "meters", "metres", "Px", "KG", "µm", "J", "Pa",
)  # fmt: skip
SCALES = (1e-9, 1e-6, 1e-4, 1e-3, 0.01, 0.1, 10, 100, 1e3, 1e4, 1e6, 1e9)
"""Factors between what was meant and what was written."""
SHAPE_KEYS = ("center", "radius", "size", "polygon", "outline", "segment", "polyline")
OBJECT_KEYS = ("mass", "friction", "velocity", "spin", "mask", "shape", "label")
ODD_NAMES = (
    "my ball", "1", "ball.1", "Ball", "bäll", "ball:", "", "null", "true", "on", "~", "b" * 300,
    "ball/1", "*", "a b c", "-", "ball-", "world", "objects", "球", "__proto__", "0.5", "<b>", "'",
)  # fmt: skip
MISPLACED_LINES = (
    "gravity: [0, 980]", "mass: 170", "fps: 60", "friction: 0.3", "view: top", "duration: 3",
    "velocity: [100, 0]", "objects: {}", "camera: {zoom: 2}", "pixels_per_meter: 500",
    "forces: {push: {object: ball, impulse: [1, 0]}}", "joints: [{objects: [ball]}]", "scale: 2",
    "joints: {s: {slider: [1, 2]}}", "restitution: 0.5", "color: red", "position: [10, 20]",
    "size: [100, 100]", "image: other.png", "extends: scene.yaml", "slow: 2", "light: true",
    "variants: {}", "variants: [fast]", "render: fast", "world: side", "background: white",
)  # fmt: skip
"""Lines that are right at another place, or in another program."""
PASTED = (
    "<<<<<<< HEAD", "=======", ">>>>>>> main", "```yaml", "```", "---", "...", "- ", "//", "/* x */",
    "TODO: weigh the ball", "see photo", "\f", "\\", "%", "&ball", "*ball", "!important", ";",
    "<<: *default", "include: other.yaml", "{{ mass }}", "${MASS}", "\u200b", "  \u00a0", "🙂: 1",
)  # fmt: skip
SMART = {
    '"': "\u201c",
    "'": "\u2019",
    "-": "\u2013",
    ": ": ":\u00a0",
    "  ": "\u00a0\u00a0",
    "...": "\u2026",
}
"""What word processors and chat programs put in place of plain characters."""
COMMENTS = (
    "# note",
    "#note",
    "  # 5 g: light",
    "// note",
    "# {",
    '# "',
    "#",
    "/* 5 */",
    "# é \u202e",
)
SETTINGS = (
    "objects.ball.mass", "objects.ball.mass=", "objects.ball.mass=170 g", "objects.ball=",
    "objects.ball", "=3", "", "world.gravity=[0, 9.81]", "world.gravity=9.81 m/s²",
    "world.gravity=0", "objects.*.mass=0", "objects.*.velocity=1 m/s", "objects.*=",
    "objects.*.shape=", "forces[9].impulse=[1, 2]", "forces[0]=", "forces=[]", "forces=",
    "objects.nobody.mass=3", "joints=", "world=", "world.duration=auto", "world.duration=-1",
    "render.camera.follow=nobody", "render.fps=0", "objects=", "objects={}", "objects=[]",
    "variants=", "physgen=", "physgen=2", "extends=scene.yaml", "image=", "assets=", "size=[9, 9]",
    "objects.*.elasticity=2", "objects.*.motion=fixed", "objects.*.place=[0, 0]", "a.b.c=1",
    "world.gravity=[0,", "objects.*.mass=1e3 kg", "world.view=top", "world.pixels_per_meter=0",
    "world.pixels_per_meter=1e-300", "render.scale=0.01", "boundaries=", "light=", "fields=",
    "objects.*.shape={circle: {center: [50, 50], radius: 5}}", "objects.*.layer=1",
)  # fmt: skip
"""Values of --set."""


RIGHT_UNITS = {
    "mass": ("kg", "g", "mg"), "velocity": ("m/s", "px/s", "cm/s"), "spin": ("rad/s", "deg/s", "rpm"),
    "center": ("px", "cm", "m"), "radius": ("mm", "cm", "m", "px"), "size": ("m", "mm"),
    "duration": ("s", "ms", "min"), "gravity": ("m/s²", "px/s²"), "segment": ("px", "m"),
}  # fmt: skip
"""Units that fit a key; the number in front was meant for another one."""
EXTREMES: dict[str, tuple[Any, ...]] = {
    "mass": (1e-9, 1e-3, 1e9, "1 mg", "1000 kg"),
    "friction": (0, 1e-9, 10),
    "elasticity": (0, 1),
    "rolling": (10, 1e-9),
    "velocity": ([1e6, -1e6], [1e-9, 0], ["1 m/s", "0 px/s"], [0, 9999]),
    "spin": (1e6, -1e-9, 36_000),
    "place": ([0, 0], [-1e5, 1e5], [50, 50, 720]),
    "motion": (
        "static",
        {"path": [[0, 100, 100], [0.1, 1e5, 0]]},
        {"path": [[0, 9, 9]]},
    ),
    "layer": (-1_000_000, 1_000_000),
    "solid": ("sphere", "hoop", "disc", "plate"),
    "roll": ("none", [1e5, 0]),
    "label": ("", "a" * 500, "<b>&amp;", "{{x}}", "\u202e", "100 %"),
}
"""Values of objects that the schema admits and nobody means."""
RENDERS: dict[str, tuple[Any, ...]] = {
    "scale": (0.01, 0.02, 3),
    "size": ([1, 1], [1, 900], [640, 2]),
    "fps": (1, 1000, 23.976),
    "supersample": (4, 2),
    "motion_blur": (1, 1e-9),
    "play": ("backward", "there-and-back"),
    "overlay": (["outlines", "velocity", "forces", "weight", "trails", "contacts"],),
    "camera": (
        {"center": [0, 0], "zoom": 100},
        {"zoom": 1.0001},
        {"center": [1e6, -1e6]},
    ),
    "relight": (False,),
    "shadows": (False,),
}
WORLDS: dict[str, tuple[Any, ...]] = {
    "pixels_per_meter": (1e-6, 1, 1e6),
    "gravity": ([0, 0], [0, 1e7], [1e6, 0], [0, 9.81], [0, -980]),
    "view": ("top", "side"),
    "steps_per_second": (60, 20_000),
    "combine": ("multiply",),
    "tilt": (0, 60),
    "backdrop": (1e-3, 1e6),
    "table": ({"friction": 10},),
}
FIELDS: tuple[Any, ...] = (
    {"attractor": [100, 100], "strength": 1e12},
    {"attractor": [100, 100], "strength": -1e3, "soften": 0},
    {"wind": [1e6, 0], "drag": 10},
    {"wind": [0, 0], "drag": 0},
)
JOINTS: tuple[Any, ...] = (
    {"spring": [[0, 0], [1, 1]], "stiffness": 1e12},
    {"spring": [[50, 50], [50, 50]], "stiffness": 1e-9, "length": 1e6},
    {"motor": [1e5, 0], "speed": 1e6},
    {"pivot": [-1e6, 1e6]},
    {"weld": [0, 0]},
)


# Mistakes in the document


def metres_for_pixels(tree: Tree, chance: random.Random) -> None:
    """Divide the lengths of one object, or of all, by the scale of the photo."""
    world = tree.get("world") or {}
    scale = float(world.get("pixels_per_meter") or 100)
    objects = _mapping(tree, "objects")
    names = list(objects)
    if chance.random() < 0.5:
        names = names[:1]
    for name in names:
        objects[name] = _scaled(objects[name], 1 / scale)


def wrong_size(tree: Tree, chance: random.Random) -> None:
    """Make one shape or boundary too small or too large by a power of ten."""
    group = _mapping(tree, chance.choice(("objects", "objects", "boundaries")))
    if group:
        name = chance.choice(list(group))
        group[name] = _scaled(group[name], chance.choice(SCALES))


def _scaled(node: Any, factor: float, is_length: bool = False) -> Any:
    """Return a copy of a node whose lengths are multiplied by `factor`."""
    if isinstance(node, dict):
        items = node.items()
        return {k: _scaled(v, factor, is_length or k in SHAPE_KEYS) for k, v in items}
    if isinstance(node, list):
        return [_scaled(item, factor, is_length) for item in node]
    if is_length and isinstance(node, int | float) and not isinstance(node, bool):
        return node * factor
    return node


def dangling_reference(tree: Tree, chance: random.Random) -> None:
    """Refer to an object, then remove it, rename it, or let a variant remove it."""
    objects = _mapping(tree, "objects")
    if not objects:
        return
    name = str(chance.choice(list(objects)))
    for _ in range(chance.choice((1, 1, 2))):
        add_reference(tree, name, chance)
    removal = chance.randrange(5)
    if removal == 0:
        objects.pop(name, None)
    elif removal == 1:
        renamed = chance.choice((name.upper(), f"{name}2", name.replace("-", "_")))
        objects[renamed] = objects.pop(name)
    else:
        target = chance.choice((f"objects.{name}", f"objects.{name}.mask", "objects"))
        edits = {target: None}
        if removal == 3:
            edits[f"objects.{name}.mass"] = 5
        _mapping(tree, "variants")[f"without-{len(objects)}"] = edits


def add_reference(tree: Tree, name: str, chance: random.Random) -> None:
    """Add a force, a joint, a field, a camera or a variant that names an object."""
    kind = chance.randrange(5)
    if kind == 0:
        forces = tree.get("forces")
        force = {"object": name, "impulse": [chance.choice((0, 1e3, 1e5)), 0]}
        tree["forces"] = [*(forces if isinstance(forces, list) else []), force]
    elif kind == 1:
        others = [str(other) for other in _mapping(tree, "objects")]
        ends = list(dict.fromkeys((name, chance.choice(others))))
        joint = {"objects": ends, "pivot": [100, 100]}
        _mapping(tree, "joints")["link"] = joint
    elif kind == 2:
        wind = {"wind": [300, 0], "drag": 0.002, "objects": [name]}
        _mapping(tree, "fields")["breeze"] = wind
    elif kind == 3:
        _mapping(tree, "render")["camera"] = {"follow": name, "zoom": 2}
    else:
        _mapping(tree, "variants")["heavy"] = {f"objects.{name}.mass": 5000}


def extreme_value(tree: Tree, chance: random.Random) -> None:
    """Write values of objects, of the render or of the world that nobody means."""
    objects = [item for item in _mapping(tree, "objects").values() if item]
    sections = ((_mapping(tree, "render"), RENDERS), (_mapping(tree, "world"), WORLDS))
    for _ in range(chance.choice((1, 1, 2, 4))):
        section, values = chance.choice(sections)
        if objects and chance.random() < 0.6:
            section, values = chance.choice(objects), EXTREMES
        key = chance.choice(list(values))
        section[key] = chance.choice(values[key])
        if key == "scale":
            section.pop("size", None)
        elif key == "size":
            section.pop("scale", None)


def extreme_force(tree: Tree, chance: random.Random) -> None:
    """Add a field or a joint with values that nobody means."""
    names = [str(name) for name in _mapping(tree, "objects")]
    if not names:
        return
    if chance.random() < 0.4:
        _mapping(tree, "fields")["odd"] = chance.choice(FIELDS)
    else:
        ends = [chance.choice(names) for _ in range(chance.choice((1, 2)))]
        joint = {"objects": list(dict.fromkeys(ends)), **chance.choice(JOINTS)}
        _mapping(tree, "joints")["odd"] = joint


def odd_name(tree: Tree, chance: random.Random) -> None:
    """Give an object, a boundary or a variant a name that people try."""
    kinds = [kind for kind in ("objects", "boundaries", "variants") if tree.get(kind)]
    if not kinds:
        return
    group = _mapping(tree, chance.choice(kinds))
    if group:
        group[chance.choice(ODD_NAMES)] = group.pop(chance.choice(list(group)))


def objects_as_list(tree: Tree, chance: random.Random) -> None:
    """Write a mapping as a list of mappings, or the other way round."""
    kind = chance.choice(("objects", "boundaries", "forces", "joints", "variants"))
    group = tree.get(kind)
    if isinstance(group, dict):
        entries = [{"name": name, **_as_mapping(item)} for name, item in group.items()]
        tree[kind] = entries
    elif isinstance(group, list):
        tree[kind] = {f"push-{k}": item for k, item in enumerate(group)}


def points_as_mappings(tree: Tree, chance: random.Random) -> None:
    """Write points as {x, y}, as text, or with a number too many or too few."""
    way = chance.randrange(5)

    def write(point: list[Any]) -> Any:
        x, y = point
        ways = ({"x": x, "y": y}, f"{x}, {y}", f"({x}, {y})", [x, y, 0], x)
        return ways[way]

    objects = _mapping(tree, "objects")
    if not objects:
        return
    name = chance.choice(list(objects))
    objects[name] = _with_points(objects[name], write)


def _with_points(node: Any, write: Callable[[list[Any]], Any]) -> Any:
    if isinstance(node, dict):
        return {key: _with_points(item, write) for key, item in node.items()}
    if not isinstance(node, list):
        return node
    if len(node) == 2 and not any(isinstance(item, list) for item in node):
        return write(node)
    return [_with_points(item, write) for item in node]


def key_in_wrong_section(tree: Tree, chance: random.Random) -> None:
    """Move a key of the world, of the render or of an object somewhere else."""
    sections = [tree]
    for name in ("world", "render", "light"):
        sections.append(_mapping(tree, name))
    objects = _mapping(tree, "objects").values()
    sections += [item for item in objects if isinstance(item, dict)]
    filled = [section for section in sections if section]
    source = chance.choice(filled)
    target = chance.choice(sections)
    key = chance.choice(list(source))
    moved = source.pop(key)
    if moved is not target:
        target[key] = moved


def emptied_value(tree: Tree, chance: random.Random) -> None:
    """Leave out the value of a key."""
    sections = [tree, *(item for item in tree.values() if isinstance(item, dict))]
    section = chance.choice([section for section in sections if section])
    key = chance.choice(list(section))
    section[key] = chance.choice((None, "", {}, []))


def _mapping(tree: Tree, key: str) -> Tree:
    """Return the mapping under a key, which is made if there is none."""
    if not isinstance(tree.get(key), dict):
        tree[key] = {}
    section: Tree = tree[key]
    return section


def _as_mapping(item: Any) -> Tree:
    return item if isinstance(item, dict) else {"value": item}


# Mistakes in the text


def wrong_indentation(text: str, chance: random.Random) -> str:
    """Indent a line, or all lines of a block, by some spaces more or less."""
    lines = text.splitlines()
    first = chance.randrange(len(lines))
    last = min(len(lines), first + chance.choice((1, 1, 3, 8)))
    shift = chance.choice((-3, -2, -1, 1, 2, 4))
    for k in range(first, last):
        if shift > 0:
            lines[k] = " " * shift + lines[k]
        else:
            indent = len(lines[k]) - len(lines[k].lstrip(" "))
            lines[k] = lines[k][min(indent, -shift) :]
    return _joined(lines)


def swapped_lines(text: str, chance: random.Random) -> str:
    """Swap two lines, which are neighbours in half of the cases."""
    lines = text.splitlines()
    first = chance.randrange(len(lines))
    second = min(first + 1, len(lines) - 1)
    if chance.random() < 0.5:
        second = chance.randrange(len(lines))
    lines[first], lines[second] = lines[second], lines[first]
    return _joined(lines)


def entry_pasted_twice(text: str, chance: random.Random) -> str:
    """Paste an object or a boundary a second time, here or at the end."""
    lines = text.splitlines()
    starts = [k for k, line in enumerate(lines) if ENTRY.match(line)]
    if not starts:
        return text
    first = chance.choice(starts)
    last = first + 1
    while last < len(lines) and lines[last].startswith("    "):
        last += 1
    target = chance.choice((last, len(lines)))
    return _joined([*lines[:target], *lines[first:last], *lines[target:]])


def repeated_key(text: str, chance: random.Random) -> str:
    """Write a key again, some lines below the first one."""
    lines = text.splitlines()
    keyed = [k for k, line in enumerate(lines) if KEY.match(line)]
    if not keyed:
        return text
    k = chance.choice(keyed)
    match = KEY.match(lines[k])
    assert match
    again = (
        f"{match['indent']}{match['key']}: {chance.choice((1, 'x', '[1, 2]', '{}'))}"
    )
    lines.insert(min(len(lines), k + chance.choice((1, 1, 2, 5))), again)
    return _joined(lines)


def number_with_unit(text: str, chance: random.Random) -> str:
    """Write a unit behind a number, which may not fit."""
    unit = chance.choice(UNITS)
    space = chance.choice((" ", " ", "", "  "))
    return _replace_number(text, lambda number: f"{number}{space}{unit}", chance)


def unit_of_another_size(text: str, chance: random.Random) -> str:
    """Write a unit that fits behind the numbers of a key that were meant without."""
    places = []
    for key, units in RIGHT_UNITS.items():
        pattern = rf"\b{key}: (\[[^\[\]]*\]|-?[\d.]+)(?=[,}}\s])"
        places += [(match, units) for match in re.finditer(pattern, text)]
    if not places:
        return text
    match, units = chance.choice(places)
    unit = chance.choice(units)
    written = NUMBER.sub(lambda number: f"{number[0]} {unit}", match[1])
    return text[: match.start(1)] + written + text[match.end(1) :]


def number_as_people_write(text: str, chance: random.Random) -> str:
    """Write a number with a comma, a percent sign, in words, ..."""
    written = chance.choice(WRITTEN_NUMBERS)
    return _replace_number(text, lambda _: written, chance)


def number_of_wrong_scale(text: str, chance: random.Random) -> str:
    """Multiply a number by a power of ten, or change its sign."""
    factor = chance.choice((*SCALES, -1, 0))
    return _replace_number(text, lambda number: f"{float(number) * factor:g}", chance)


def _replace_number(
    text: str, write: Callable[[str], str], chance: random.Random
) -> str:
    numbers = list(NUMBER.finditer(text))
    if not numbers:
        return text
    match = chance.choice(numbers)
    return text[: match.start()] + write(match[0]) + text[match.end() :]


def wrong_colon(text: str, chance: random.Random) -> str:
    """Leave out the space behind a colon, or write another sign for it."""
    colon = chance.choice((":", ":", " ", " = ", " : ", ":: ", "; ", "： ", "->", ""))
    places = [match.start() for match in re.finditer(r": ", text)]
    if not places:
        return text
    place = chance.choice(places)
    return text[:place] + colon + text[place + 2 :]


def misspelt_key(text: str, chance: random.Random) -> str:
    """Drop, swap or double a letter of a key, or write it in another case."""
    lines = text.splitlines()
    keyed = [k for k, line in enumerate(lines) if KEY.match(line)]
    if not keyed:
        return text
    k = chance.choice(keyed)
    match = KEY.match(lines[k])
    assert match
    key = match["key"]
    place = chance.randrange(len(key))
    spellings = (
        key[:place] + key[place + 1 :],
        key[:place] + key[place] + key[place:],
        key[:place][::-1] + key[place:],
        key.capitalize(),
        key.upper(),
        key.replace("_", "-"),
        key.replace("-", "_"),
        key.replace("_", " "),
        f"{key}s",
        f'"{key}',
    )
    lines[k] = f"{match['indent']}{chance.choice(spellings)}:{match['rest']}"
    return _joined(lines)


def misplaced_line(text: str, chance: random.Random) -> str:
    """Write a line where it does not belong."""
    lines = text.splitlines()
    place = chance.randrange(len(lines) + 1)
    indent = " " * chance.choice((0, 0, 2, 4, 6))
    lines.insert(place, indent + chance.choice(MISPLACED_LINES))
    return _joined(lines)


def pasted_text(text: str, chance: random.Random) -> str:
    """Leave marks of version control, of a chat or of a template in the file."""
    lines = text.splitlines()
    for _ in range(chance.choice((1, 1, 3))):
        lines.insert(chance.randrange(len(lines) + 1), chance.choice(PASTED))
    return _joined(lines)


def smart_characters(text: str, chance: random.Random) -> str:
    """Replace plain quotes, dashes and spaces as word processors do."""
    plain = chance.choice([plain for plain in SMART if plain in text] or ['"'])
    return text.replace(plain, SMART[plain], chance.choice((-1, 1, 1)))


def quoted_value(text: str, chance: random.Random) -> str:
    """Put quotes of some kind around a value, or only one of them."""
    first, last = chance.choice(('""', "''", "“”", "‘’", '" ', "' ", "``", "<>", "()"))
    return _replace_number(text, lambda number: first + number + last, chance)


def unbalanced_bracket(text: str, chance: random.Random) -> str:
    """Drop, double or replace a bracket or a comma."""
    places = [match.start() for match in re.finditer(r"[\[\]{},]", text)]
    if not places:
        return text
    place = chance.choice(places)
    written = chance.choice(("", text[place] * 2, "(", ")", "]", "}", " ", ";"))
    return text[:place] + written + text[place + 1 :]


def tabs(text: str, chance: random.Random) -> str:
    """Use tabs for the indentation, behind colons or at the ends of lines."""
    way = chance.randrange(4)
    if way == 0:
        return re.sub(r"^ +", lambda m: "\t" * (len(m[0]) // 2), text, flags=re.M)
    if way == 1:
        return text.replace(": ", ":\t", chance.choice((1, -1)))
    if way == 2:
        return text.replace("\n", "\t\n")
    lines = text.splitlines()
    k = chance.randrange(len(lines))
    lines[k] = "\t" + lines[k].lstrip()
    return _joined(lines)


def comments_everywhere(text: str, chance: random.Random) -> str:
    """Write comments behind and between lines, right and wrong ones."""
    lines = []
    is_everywhere = chance.random() < 0.3
    for line in text.splitlines():
        if is_everywhere or chance.random() < 0.1:
            line += chance.choice(("", " ")) + chance.choice(COMMENTS)
        lines.append(line)
        if chance.random() < 0.1:
            lines.append(" " * chance.randrange(6) + chance.choice(COMMENTS))
    return _joined(lines)


def cut_off(text: str, chance: random.Random) -> str:
    """Keep only the first part of the file, as a full disk or a bad copy does."""
    return text[: chance.randrange(len(text))]


def whole_file_indented(text: str, chance: random.Random) -> str:
    """Indent each line, except perhaps the first."""
    indent = " " * chance.choice((1, 2, 4))
    lines = [indent + line for line in text.splitlines()]
    if chance.random() < 0.3:
        lines[0] = lines[0].lstrip()
    return _joined(lines)


def json_in_place_of_yaml(text: str, chance: random.Random) -> str:
    """Write the scene as JSON, with the slips that JSON does not forgive."""
    try:
        tree = yaml.safe_load(text)
    except yaml.YAMLError:
        return text
    indent = chance.choice((None, 1, 2, "\t"))
    written = json.dumps(tree, indent=indent, ensure_ascii=chance.random() < 0.5)
    slips = (
        written,
        written,
        written.replace("}", ",}", 1),
        written.replace("]", ",]"),
        written.replace('"', "'"),
        written.replace('": ', '":'),
        written.replace("{", "{ // a scene\n", 1),
        written.replace('"physgen"', "physgen", 1),
        written + "\n" + written,
        f"[{written}]",
        json.dumps(written),
    )
    return chance.choice(slips)


def _joined(lines: list[str]) -> str:
    return "\n".join(lines) + "\n"


TREE_MISTAKES: tuple[TreeMistake, ...] = (
    metres_for_pixels, wrong_size, wrong_size, wrong_size, dangling_reference, dangling_reference,
    dangling_reference, extreme_value, extreme_value, extreme_value, extreme_force, odd_name,
    objects_as_list, points_as_mappings, key_in_wrong_section, emptied_value,
)  # fmt: skip
TEXT_MISTAKES: tuple[TextMistake, ...] = (
    wrong_indentation, swapped_lines, entry_pasted_twice, repeated_key, number_with_unit,
    number_as_people_write, number_of_wrong_scale, number_of_wrong_scale,
    number_of_wrong_scale, unit_of_another_size, unit_of_another_size, unit_of_another_size,
    wrong_colon, misspelt_key, misplaced_line, pasted_text, smart_characters, quoted_value,
    unbalanced_bracket, tabs, comments_everywhere, cut_off, whole_file_indented,
    json_in_place_of_yaml,
)  # fmt: skip
ENCODINGS: dict[str, Encoding] = {
    "byte_order_mark": lambda text: b"\xef\xbb\xbf" + _utf8(text),
    "windows_line_ends": lambda text: _utf8(text.replace("\n", "\r\n")),
    "old_macintosh_line_ends": lambda text: _utf8(text.replace("\n", "\r")),
    "mixed_line_ends": lambda text: _utf8(text.replace("\n", "\r\n", 7)),
    "mark_and_windows_line_ends": lambda text: _utf8("\ufeff" + text.replace("\n", "\r\n")),
    "no_last_line_end": lambda text: _utf8(text.rstrip("\n")),
    "spaces_at_line_ends": lambda text: _utf8(text.replace("\n", "   \n")),
    "blank_lines": lambda text: _utf8("\n\n" + text.replace("\n", "\n\n") + "\n" * 50),
    "utf_16": lambda text: text.encode("utf-16", "surrogatepass"),
    "latin_1": lambda text: text.replace("a", "ä", 3).encode("latin-1", "replace"),
    "zero_byte_at_end": lambda text: _utf8(text) + b"\0",
    "end_of_file_character": lambda text: _utf8(text) + b"\x1a",
}  # fmt: skip


def _utf8(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


# A scene with mistakes


def write_mistaken_scene(folder: Path, chance: random.Random) -> list[str]:
    """Write scene.yaml with mistakes, and what it refers to; return their names."""
    seed = choose_scene(chance)
    if seed.name == "scene.yaml":
        unused = shutil.ignore_patterns("*.md")
        shutil.copytree(seed.parent, folder, dirs_exist_ok=True, ignore=unused)
    text = seed.read_text(encoding="utf-8")
    names = []
    if chance.random() < 0.6:
        mistake = chance.choice(TREE_MISTAKES)
        names.append(mistake.__name__)
        tree = yaml.safe_load(text)
        mistake(tree, chance)
        text = yaml.dump(tree, allow_unicode=True, sort_keys=False)
    if not names or chance.random() < 0.15:
        for _ in range(chance.choice((1, 1, 1, 1, 2))):
            change = chance.choice(TEXT_MISTAKES)
            names.append(change.__name__)
            text = change(text or "\n", chance)
    data = _utf8(text)
    if chance.random() < 0.12:
        name = chance.choice(list(ENCODINGS))
        names.append(name)
        data = ENCODINGS[name](text)
    (folder / "scene.yaml").write_bytes(data)
    if chance.random() < 0.12:
        names.append(extend_scene(folder, chance))
    return names


def choose_scene(chance: random.Random) -> Path:
    """Return a bundled scene, or one of the physics scorecard."""
    pattern = chance.choice(("scenes/*/scene.yaml", "scenes/physics/*.yaml"))
    return chance.choice(sorted(ROOT.glob(pattern)))


def extend_scene(folder: Path, chance: random.Random) -> str:
    """Make scene.yaml extend what it was, which changes or removes its objects."""
    scene = folder / "scene.yaml"
    base = folder / chance.choice(
        (*("base.yaml", "base.yml", "my base.yaml") * 3, "base.txt")
    )
    scene.replace(base)
    found = re.findall(rb"^  ([\w-]+):", base.read_bytes(), flags=re.M)
    names = [name.decode() for name in found] or ["ball"]
    name = chance.choice(names)
    edits = (
        f"objects: {{{name}: null}}",
        f"objects: {{{name}: {{mass: 3 kg}}}}",
        f"objects: {{{name}: {{shape: null}}}}",
        f"forces: [{{object: {name}, impulse: [1000, 0]}}]\nobjects: {{{name}: null}}",
        f"variants: {{gone: {{objects.{name}: null}}}}",
        f"variants: {{gone: {{objects.{name}: null}}, odd: {{objects.{name}.mass: x}}}}",
        f"render: {{camera: {{follow: {name}}}}}\nobjects: {{{name}: null}}",
        "objects: null",
        "world: null",
        "image: null",
        "",
    )
    target = chance.choice((*(base.name,) * 8, "nowhere.yaml"))
    text = f"physgen: 1\nextends: {target}\n{chance.choice(edits)}\n"
    scene.write_text(text, encoding="utf-8")
    return "extends"
