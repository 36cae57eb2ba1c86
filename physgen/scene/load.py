"""Loads a scene file: inheritance, variants, overrides, checks, and the frozen Scene."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from math import acos, ceil, cos, pi, radians, sin, sqrt
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from physgen.files import file_stamp
from physgen.messages import Message, one_of
from physgen.problems import InputError, Limit, Place, Problem
from physgen.scene import scene as parts
from physgen.scene.document import Node, Source, children, decode, items, plain, read
from physgen.scene.files import Record, merge_bases, read_bases, read_scene
from physgen.scene.overlay import (
    Edit,
    apply,
    edit_of_flag,
    edits_of_variant,
    targets,
    variants_of,
)
from physgen.scene.rules import Files, Ground, check_rules
from physgen.scene.schema import Schema, at, expanded, inner, with_defaults
from physgen.scene.validate import (
    MAX_PROBLEMS,
    Findings,
    TooManyError,
    check_schema,
)
from physgen.text import KeyPath, dotted, natural, quantity, quoted

T = TypeVar("T")

ONE_FOR_TWO = ("gravity", "velocity", "force", "impulse", "wind")
"""Vectors for which one number with its unit may stand."""
LARGEST_SCALE = 1e6
"""px/m, as the schema allows."""
EARTH = 9.8
"""m/s², the gravity of the paper's code; times pixels_per_meter where a scene names none."""


class Opened:
    """A scene file that was read and checked, for any number of its variants.

    While it is being edited, `text` is its future content.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        allow_outside: bool = False,
        text: str | None = None,
    ) -> None:
        self.file = Path(os.fspath(path))
        self.allow_outside = allow_outside
        name = os.fspath(path)
        self._source = Source(name, Path(os.path.abspath(self.file)).parent)
        self._stamps = {self.file: file_stamp(self.file)} if text is None else {}
        own_problems = (
            read_scene(self.file, name)
            if text is None
            else read(decode(text.encode("utf-8", "surrogatepass"), name), self._source)
        )
        self._chain = read_bases(own_problems, self.file, allow_outside, self._stamps)
        self._root = merge_bases(self._chain)
        self._files = Files(allow_outside)
        self.variants = tuple(name for name, _ in variants_of(self._root))
        self._own = Findings()
        self.ground = _check(in_numbers(self._root), self._own, self._files)
        """The photo and the assets of the file itself, as far as they can be used."""

    @cached_property
    def variant_problems(self) -> tuple[Problem, ...]:
        """Return the problems of each variant that the file itself does not have.

        They do not keep the file and its other variants from being used.
        """
        return tuple(_problems_of_variants(self._root, self._own, self._files))

    def document(self) -> dict[str, Any]:
        """As plain YAML data, with what it extends and without any default."""
        data = plain(self._root)
        assert isinstance(data, dict)
        return data

    def place(self, path: KeyPath) -> Place:
        """Return where the value at a path is written, or the nearest above it."""
        node = self._root
        for key in path:
            child_nodes = children(node).get(str(key))
            if child_nodes is None:
                break
            node = child_nodes
        return node.place

    def stale(self) -> bool:
        """Return whether the file, or one that it extends, was written since."""
        return any(file_stamp(file) != stamp for file, stamp in self._stamps.items())

    def scene(
        self, overrides: Sequence[str] = (), variant: str | None = None
    ) -> parts.Scene:
        """With one of its variants and `KEY=VALUE` overrides on top; raises InputError with all problems."""
        report = Findings()
        edits = _edits(self._root, overrides, variant, self._source)
        edited_root = _apply_edits(self._root, edits)
        ground = _check(in_numbers(edited_root), report, self._files)
        if report.problems:
            raise InputError(self._at_causes(report, edits))
        scene = scene_from_tree(
            *_followed(edited_root, self._root, ground),
            scene_name(self.file),
            self._source,
            ground,
        )
        return replace(scene, files=tuple(self._stamps))

    def _at_causes(self, report: Findings, edits: Sequence[Edit]) -> list[Problem]:
        """Return the problems, each at the key of the overlay that caused it."""
        from physgen.scene.causes import name_edits, name_extending_keys

        def check(root: Node) -> dict[Problem, None]:
            return _problems(root, self._files)

        own_problems = [
            problem for problem in report.problems if problem in self._own.problems
        ]
        new = [problem for problem in report.problems if problem not in own_problems]
        if len(self._chain) > 1:
            own_problems = name_extending_keys(own_problems, self._chain, check)
        return [*own_problems, *name_edits(new, self._root, edits, check)]


def load(
    path: str | os.PathLike[str],
    overrides: Sequence[str] = (),
    variant: str | None = None,
    allow_outside: bool = False,
) -> parts.Scene:
    """Return the scene of a file, with what it extends, one of its variants and `KEY=VALUE` overrides on top.

    A variant that fails keeps neither the file nor its other variants from being loaded. Paths in the file stay below
    its folder unless `allow_outside`; see files.py. Raises InputError with all problems, sorted by place.
    """
    return Opened(path, allow_outside).scene(overrides, variant)


def _edits(
    root: Node, overrides: Sequence[str], variant: str | None, source: Source
) -> list[Edit]:
    """Return the edits of a variant and of the overrides; raises InputError with all that are malformed."""
    problems: list[Problem] = []
    edits: list[Edit] = []
    variants = dict(variants_of(root))
    if variant in variants:
        edits += edits_of_variant(variants[variant], variant)
    elif variant is not None:
        problems.append(_unknown_variant(variant, list(variants)))
    for text in overrides:
        try:
            edits.append(edit_of_flag(text, source))
        except InputError as error:
            problems += error.problems
    if not problems:
        return edits
    try:
        _apply_edits(root, edits)
    except InputError as error:
        problems += error.problems
    raise InputError(dict.fromkeys(problems))


def _unknown_variant(variant: str, known: Sequence[str]) -> Problem:
    """Return the problem with `--variant`."""
    fix = one_of(variant, known) if known else "the file has no variants"
    place = Place(f"--variant {quoted(variant, '')}")
    return Message.UNKNOWN_VARIANT.problem(place, "", quoted(variant), fix=fix)


def _apply_edits(root: Node, edits: Sequence[Edit]) -> Node:
    """Return the tree after the edits; raises InputError with every edit that cannot be made."""
    problems: list[Problem] = []
    left = Limit.SET.most
    for edit in edits:
        if edit.variant:
            left -= targets(root, edit) * _values(edit.value)
        if left < 0:  # at once: no other problem may be looked for in such a tree
            raise edit.error(Limit.SET.refusal())
        try:
            root = apply(root, edit)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(dict.fromkeys(problems))
    return root


LONGEST = 10.0
"""s of a clip that ends when all rests."""


class _Open(float):
    """The number that stands for `auto`."""


def in_numbers(root: Node) -> Node:
    """Return the tree with numbers in place of texts with units that fit.

    The schema reports the other texts. One number in place of a vector, with or without
    a unit, points to the right, and gravity down.
    """
    return _NumberTree(_scale(root)).convert(root, expanded(), (), "")


def _scale(root: Node) -> float:
    """Return the scale of the file, px/m, the default if it has none that is valid."""
    default = float(at("world.pixels_per_meter")["default"])
    node = children(root, "world").get("pixels_per_meter")
    if node is None:
        return default
    value: object = node.value
    if isinstance(value, str):
        value = quantity(value, "px/m", 1.0)
    if isinstance(value, int | float) and 0 < value <= LARGEST_SCALE:
        return value
    return default


@dataclass(frozen=True)
class _NumberTree:
    """Conversion of the texts with units in a tree."""

    scale: float
    """px/m."""

    def convert(self, node: Node, part: Schema, path: KeyPath, unit: str) -> Node:
        """Return the node in numbers; `part` is the schema of the node."""
        value = node.value
        if isinstance(value, str):
            return self._text(node, part, path, unit)
        if isinstance(value, int | float):
            is_vector = part.get("type") == "array" and not isinstance(value, bool)
            return _vector(node, value, path[-1]) if is_vector else node
        if isinstance(value, dict):
            changes = self._children(value.items(), part, path, unit)
            return node.with_value({**value, **changes}) if changes else node
        if isinstance(value, list) and not _has_names(part):
            changes = self._children(enumerate(value), part, path, unit)
            if changes:
                children = [changes.get(n, child) for n, child in enumerate(value)]
                return node.with_value(children)
        return node

    def _text(self, node: Node, part: Schema, path: KeyPath, unit: str) -> Node:
        """Return the number or vector that a text stands for, else the node itself."""
        text = str(node.value)
        if path == ("world", "duration") and text.strip() == "auto":
            return node.with_value(_Open(LONGEST))
        number = quantity(text, unit, self.scale) if unit else None
        if number is None or part.get("type") not in ("number", "array"):
            return node
        if part["type"] == "number":
            return node.with_value(number, text=text)
        return _vector(node, number, path[-1], text)

    def _children(
        self,
        children: Iterable[tuple[Any, Node]],
        part: Schema,
        path: KeyPath,
        unit: str,
    ) -> dict[Any, Node]:
        """Return the converted children that differ, by key or index."""
        changes: dict[Any, Node] = {}
        for key, child in children:
            # single numbers need no conversion, apart from those that stand for vectors
            if key not in ONE_FOR_TWO and not isinstance(
                child.value, str | list | dict
            ):
                continue
            schema = inner(part, key)
            if schema is None:
                continue
            # the items of a list have the unit of the list
            inherited_unit = unit if isinstance(key, int) else ""
            unit_of_child = schema.get("x-unit", inherited_unit)
            converted = self.convert(child, schema, (*path, key), unit_of_child)
            if converted is not child:
                changes[key] = converted
        return changes


def _has_names(part: Schema) -> bool:
    """Return whether a schema is that of a list of names."""
    return bool(part.get("items", {}).get("type") == "string")


def _vector(node: Node, length: float, key: str | int, text: str | None = None) -> Node:
    """Return the vector that one number stands for, the node itself if none may."""
    if key not in ONE_FOR_TWO:
        return node
    ends = (0.0, length) if key == "gravity" else (length, 0.0)
    return node.with_value([node.with_value(end, text=text) for end in ends])


def _check(root: Node, report: Findings, files: Files) -> Ground:
    try:
        check_schema(root, report)
        return check_rules(root, report, files)
    except TooManyError:
        return Ground()


def _problems(root: Node, files: Files) -> dict[Problem, None]:
    """Return the problems of a tree."""
    report = Findings()
    _check(in_numbers(root), report, files)
    return report.problems


def _problems_of_variants(root: Node, own: Findings, files: Files) -> Iterator[Problem]:
    """Yield problems of each variant that the file itself, whose problems are in `own`, does not have."""
    variants = list(variants_of(root))
    if not variants or len(own.problems) > 100:
        return
    edits = sum(1 + len(children(node)) for _, node in variants)
    if edits * _values(root) > Limit.CHECKS.most:
        place = children(root)["variants"].key_place
        yield from Limit.CHECKS.error(place, "variants").problems
        return
    count = 0
    left = Limit.SET.most
    for name, node in variants:
        edits_of_one = edits_of_variant(node, name)
        left -= sum(targets(root, edit) * _values(edit.value) for edit in edits_of_one)
        if left < 0:
            yield from (edits_of_one[-1].error(Limit.SET.refusal()).problems)
            return
        problems = _problems_of_variant(root, edits_of_one, own, files)
        yield from problems
        count += len(problems)
        if count > MAX_PROBLEMS:
            return


def _problems_of_variant(
    root: Node, edits: Sequence[Edit], own: Findings, files: Files
) -> list[Problem]:
    """Return the problems of one variant that are not those of the file itself."""
    from physgen.scene.causes import name_edits

    try:
        problems = _problems(_apply_edits(root, edits), files)
    except InputError as error:
        return error.problems
    new = [problem for problem in problems if problem not in own.problems]
    return name_edits(new, root, edits, lambda tree: _problems(tree, files))


def _values(node: Node) -> int:
    """Return the number of values in a tree."""
    child_nodes = node.value.values() if isinstance(node.value, dict) else items(node)
    return 1 + sum(map(_values, child_nodes))


def scene_name(file: Path) -> str:
    """Return the file's stem, or its folder's name where the file is called `scene.yaml`."""
    return (
        Path(os.path.abspath(file)).parent.name
        if file.name == "scene.yaml"
        else file.stem
    )


def _followed(root: Node, file: Node, ground: Ground) -> tuple[Node, Record]:
    """Return the tree in numbers, with what follows from labels and scale that a user changed, and the record of that.

    What an override, a variant or a file beside the perceived one says never follows; `file` is the tree before edits.
    """
    record, tree = ground.record, in_numbers(root)
    if not record.objects or ground.size is None:
        return tree, record
    from physgen.scene.provenance import followed

    data = plain(tree)
    outlines: dict[str, Any] = {}
    for name, entry in data.get("objects", {}).items():
        stored_shapes = (
            ground.outlines.get(entry["mask"])
            if isinstance(entry.get("mask"), int)
            else None
        )
        shape = (
            entry["shape"]
            if isinstance(entry.get("shape"), dict)
            else stored_shapes[1]
            if stored_shapes
            else None
        )
        outline = None if shape is None else parts.shape_outline(_shape(shape))
        outlines |= {} if outline is None else {name: outline}
    values, record = followed(
        plain(root), with_defaults(data), record, outlines, ground.size
    )
    home = children(root)["assets"].source
    for path, value in sorted(values.items(), key=lambda one: len(one[0])):
        key = dotted(path)
        node = _at(root, path)
        written_node = children(root, *path[:-1]).get(path[-1])
        if written_node is not None and (
            written_node.source != home
            or written_node is not children(file, *path[:-1]).get(path[-1])
        ):
            continue
        new_node = (
            [node.with_value(part) for part in value]
            if isinstance(value, list)
            else value
        )
        root = apply(root, Edit(key, node.with_value(new_node), ()))
    return in_numbers(root) if values else tree, record


def _at(root: Node, path: KeyPath) -> Node:
    """Return the node at a path, or the nearest above it."""
    for key in path:
        root = children(root).get(str(key), root)
    return root


def scene_from_tree(
    root: Node, record: Record, name: str, source: Source, ground: Ground
) -> parts.Scene:
    """Return the scene of a checked tree, called `name`; `source` is the file that was opened.

    `record` is what perception wrote, and what followed from it since.

    Named parts stand in the natural order of their names, so that no number depends on the order of keys in a file.
    """
    scene_data = plain(root)
    data = with_defaults(scene_data)
    for own_name, entry in scene_data.get("objects", {}).items():
        item = data["objects"][own_name]
        item["from"] = record.sources(entry, item, own_name)
        stored_shapes = (
            ground.outlines.get(entry["mask"])
            if isinstance(entry.get("mask"), int)
            else None
        )
        if (
            stored_shapes is not None
            and stored_shapes[2] is not None
            and "shape" not in entry
        ):
            item.setdefault("solid", stored_shapes[2])
    for key in ("image", "assets"):
        node = children(root).get(key)
        if node is not None and node.source.folder != source.folder:
            data[key] = Path(
                os.path.relpath(node.source.folder / str(node.value), source.folder)
            ).as_posix()
    world = data["world"]
    if "gravity" not in world:
        down = (
            round(EARTH * world["pixels_per_meter"], 9)
            if world["view"] == "side"
            else 0
        )
        world["gravity"] = [0, down]
    for item in data["objects"].values():
        if "mass" not in item and "density" not in item:
            item["density"] = 1
    assert ground.size is not None
    return parts.Scene(
        name=name,
        folder=source.folder,
        image=None if ground.image is None else Path(os.path.realpath(ground.image)),
        size=ground.size,
        assets=None if ground.assets is None else Path(os.path.realpath(ground.assets)),
        world=_make(
            parts.Settings,
            world,
            gravity_in_units=_has_unit(children(root, "world").get("gravity")),
            table_friction=float(world["table"]["friction"]),
            until_rest=isinstance(world["duration"], _Open),
        ),
        objects=tuple(
            _add_stored_shape(item, ground) for item in _named(data["objects"], _object)
        ),
        boundaries=_named(data["boundaries"], _boundary),
        forces=tuple(map(_force, data["forces"])),
        joints=_named(data["joints"], _joint),
        fields=_named(data["fields"], _field),
        light=_light(data["light"]) if "light" in data else None,
        render=_render(data["render"]),
        refine=refinement(data["refine"]),
        maps=MappingProxyType(
            {
                **ground.record.maps,
                **{name: _pair(ends) for name, ends in data.get("maps", {}).items()},
            }
        ),
        record=replace(ground.record, world=record.world),
        places=MappingProxyType(dict(_places(root, ()))),
        document=MappingProxyType(data),
        variants=tuple(data["variants"]),
        title=data.get("title"),
    )


def _has_unit(node: Node | None) -> bool:
    """Return whether a vector of the file was written with a unit."""
    return any(item.text is not None for item in items(node))


def refinement(item: Mapping[str, Any]) -> parts.Refine:
    """Return `refine:` as plain data, its defaults filled in."""
    return _make(parts.Refine, item)


def _places(node: Node, path: KeyPath) -> Iterator[tuple[str, Place]]:
    """Yield the place of every key's value and of every mapping in a list; points stand in the place of their list."""
    yield dotted(path), node.place
    if isinstance(node.value, dict):
        for key, child in node.value.items():
            yield from _places(child, (*path, key))
    elif (
        isinstance(node.value, list)
        and node.value
        and isinstance(node.value[0].value, dict)
    ):
        for index, child in enumerate(node.value):
            yield from _places(child, (*path, index))


def _named(section: Mapping[str, Any], make: Callable[[str, Any], T]) -> tuple[T, ...]:
    return tuple(make(name, section[name]) for name in sorted(section, key=natural))


def _make(made: type[T], item: Mapping[str, Any], /, **given: Any) -> T:
    """A dataclass of the keys of `item`, converted to the types of its fields; None for a key that is not there."""
    for name, convert in _readers(made):  # type: ignore[arg-type]
        if name not in given:
            value = item.get(name)
            given[name] = None if value is None else convert(value)
    return made(**given)


@cache
def _readers(made: Any) -> tuple[tuple[str, Callable[[Any], Any]], ...]:
    """Name of each field, and what converts its value."""
    readers = (
        (field.name, str(field.type).removesuffix(" | None")) for field in fields(made)
    )
    return tuple(
        (name, _CONVERSIONS.get(text, getattr(parts, text, lambda value: value)))
        for name, text in readers
    )


def _pair(values: Sequence[float]) -> parts.Point:
    return float(values[0]), float(values[1])


def _points(values: Sequence[Sequence[float]]) -> parts.Points:
    return tuple((float(x), float(y)) for x, y in values)


def _mask(value: Any) -> parts.Mask:
    if not isinstance(value, dict):
        return parts.MaskId(int(value))
    return parts.MaskPolygon(_points(value["polygon"]))


def _shape(value: Any) -> parts.Shape:
    if not isinstance(value, dict):
        return parts.Auto()
    ((kind, part),) = value.items()
    if kind == "circle":
        return _make(parts.Circle, part)
    if kind == "box":
        return _make(parts.Box, {"angle": 0, **part})
    if kind == "polygon":
        return parts.Polygon((parts.Ring(_points(part)),))
    rings = (
        parts.Ring(
            _points(piece["outline"]), tuple(map(_points, piece.get("holes", ())))
        )
        for piece in part
    )
    return parts.Polygon(tuple(rings))


_CONVERSIONS: dict[str, Callable[[Any], Any]] = {
    "float": float,
    "int": int,
    "Point": _pair,
    "Points": _points,
    "Mask": _mask,
    "Shape": _shape,
    "tuple[str, ...]": tuple,
    "tuple[int, int]": lambda value: (int(value[0]), int(value[1])),
}
"""Type of a field -> what makes it of a value of the file; other types are enums, or stay as they are."""


def _object(name: str, item: Mapping[str, Any]) -> parts.Object:
    path = item["motion"]["path"] if isinstance(item["motion"], dict) else []
    return _make(
        parts.Object,
        item,
        name=name,
        roll=item["roll"] if isinstance(item["roll"], str) else _pair(item["roll"]),
        motion=parts.Motion.SCRIPTED if path else parts.Motion(item["motion"]),
        loop=isinstance(item["motion"], dict) and item["motion"].get("loop", False),
        path=tuple(
            parts.Waypoint(float(k[0]), _pair(k[1:3]), float([*k, 0][3])) for k in path
        ),
        provenance=MappingProxyType(dict(item["from"])),
        prompt=_prompt(item["prompt"]) if "prompt" in item else None,
        place=tuple(map(float, [*item["place"], 0][:3])) if "place" in item else None,
        wheels=tuple(_make(parts.Wheel, wheel) for wheel in item.get("wheels", ())),
    )


def _add_stored_shape(item: parts.Object, ground: Ground) -> parts.Object:
    """Return the object with the shape that is stored for its mask."""
    stored_shape = (
        ground.outlines.get(item.mask.id)
        if isinstance(item.mask, parts.MaskId)
        else None
    )
    if stored_shape is None or not isinstance(item.shape, parts.Auto):
        return item
    shape = _shape(stored_shape[1])
    assert not isinstance(shape, parts.Auto)
    assert isinstance(item.mask, parts.MaskId)
    whole_node = ground.wholes.get(item.mask.id)
    whole_outline = None if whole_node is None else _shape(whole_node)
    assert not isinstance(whole_outline, parts.Auto)
    return replace(item, shape=parts.Auto(shape, stored_shape[0], whole_outline))


def _prompt(value: Mapping[str, Any]) -> parts.BoxPrompt | parts.PointPrompt:
    if "point" in value:
        return parts.PointPrompt(_pair(value["point"]))
    x, y, width, height = map(float, value["box"])
    return parts.BoxPrompt((x, y, width, height))


def _boundary(name: str, item: Mapping[str, Any]) -> parts.Boundary:
    points = _points(item.get("segment") or item.get("polyline") or ())
    is_smooth = "arc" in item or "bezier" in item
    if "arc" in item:
        points = arc_points(item["arc"])
    elif "bezier" in item:
        points = bezier_points(item["bezier"])
    shape = _shape(item["shape"]) if "shape" in item else None
    values = {"name": name, "points": points, "shape": shape, "is_smooth": is_smooth}
    return _make(parts.Boundary, item, **values)


SAG = 0.002
"""px by which a chord of a curve may leave it: less than contacts overlap."""
MOST_CHORDS = 2000
"""Of one curve."""


def arc_points(item: Mapping[str, Any]) -> parts.Points:
    """Return points along an arc, whose chords are within SAG of it."""
    (x, y), radius = _pair(item["center"]), float(item["radius"])
    begin = radians(float(item.get("from", 0.0)))
    turn = radians(float(item.get("to", 360.0))) - begin
    chord = 2 * acos(max(1 - SAG / radius, 0.9))
    count = min(max(1, ceil(abs(turn) / chord)), MOST_CHORDS)
    angles = [begin + turn * k / count for k in range(count + 1)]
    points = [(x + radius * cos(a), y + radius * sin(a)) for a in angles]
    if abs(abs(turn) - 2 * pi) < 1e-9:
        points[-1] = points[0]
    return tuple(points)


def bezier_points(values: Sequence[Sequence[float]]) -> parts.Points:
    """Return points along cubic Bézier curves, whose chords are within SAG of them."""
    corners = np.array(values, np.float64)
    points = [corners[0]]
    for k in range(0, len(corners) - 1, 3):
        a, b, c, d = corners[k : k + 4]
        # a chord over 1/n of the parameter leaves the curve by |p''|/(8 n²) at most
        bend = 6 * max(np.hypot(*(a - 2 * b + c)), np.hypot(*(b - 2 * c + d)))
        count = min(max(1, ceil(sqrt(bend / (8 * SAG)))), MOST_CHORDS)
        t = np.arange(1, count + 1)[:, None] / count
        s = 1 - t
        points += list(s**3 * a + 3 * s**2 * t * b + 3 * s * t**2 * c + t**3 * d)
    return tuple((float(x), float(y)) for x, y in points)


def _force(item: Mapping[str, Any]) -> parts.Force:
    (load,) = (load for load in parts.Load if load.value in item)
    turning = load is parts.Load.TORQUE
    vector = (0.0, 0.0) if turning else _pair(item[load.value])
    profile = _profile(item["profile"]) if "profile" in item else None
    values = {"torque": 0, **item}
    return _make(parts.Force, values, load=load, vector=vector, profile=profile)


def _profile(item: Mapping[str, Any]) -> parts.Profile:
    ((name, value),) = item.items()
    kind = parts.ProfileKind(name)
    numbers: parts.Points = ((float(value), 0.0),) if kind in SINGLE else ()
    if kind is parts.ProfileKind.PULSE:
        numbers = (_pair(value),)
    elif kind is parts.ProfileKind.TABLE:
        numbers = _points(value)
    return parts.Profile(kind, numbers)


SINGLE = (parts.ProfileKind.RAMP, parts.ProfileKind.SINE)
"""Profiles with one number."""


LINES = (
    parts.JointKind.SPRING,
    parts.JointKind.SLIDER,
    parts.JointKind.ROPE,
    parts.JointKind.PULLEY,
)
"""Joints along several points."""


def _joint(name: str, item: Mapping[str, Any]) -> parts.Joint:
    (kind,) = (kind for kind in parts.JointKind if kind.value in item)
    points: parts.Points = ()
    if kind in LINES:
        points = _points(item[kind.value])
    elif kind is parts.JointKind.FINGER:
        points = (_pair(item["finger"][0][1:]), _pair(item["finger"][0][1:]))
    elif kind is not parts.JointKind.GEAR:
        points = (_pair(item[kind.value]),)
    defaults = {"stiffness": 0, "damping": 0, "speed": 0, "gear": 1, "friction": 0}
    item = {**defaults, **item}
    knots = tuple(tuple(map(float, knot)) for knot in item.get("finger", ()))
    return _make(parts.Joint, item, name=name, kind=kind, points=points, knots=knots)


def _field(name: str, item: Mapping[str, Any]) -> parts.Field:
    (kind,) = (kind for kind in parts.FieldKind if kind.value in item)
    zeros = dict.fromkeys(NUMBERS_OF_FIELD, 0)
    item = {"objects": (), "velocity": (0, 0), **zeros, **item}
    vector = extent = (0.0, 0.0)
    if kind is parts.FieldKind.MAGNET:
        item["objects"] = item["magnet"]
    elif kind is not parts.FieldKind.AIR:
        vector = _pair(item[kind.value][:2])
    if kind in REGIONS:
        lengths = item[kind.value][2:]
        extent = _pair((lengths[0], lengths[-1]))
    return _make(parts.Field, item, name=name, kind=kind, vector=vector, extent=extent)


REGIONS = (parts.FieldKind.WATER, parts.FieldKind.BELT, parts.FieldKind.TURNTABLE)
"""Fields with a width and a height, or a radius."""
NUMBERS_OF_FIELD = (
    "drag",
    "strength",
    "soften",
    "linear",
    "density",
    "pull",
    "spin",
)


def _light(item: Mapping[str, Any]) -> parts.Light:
    x, y, z = (float(value) for value in item["direction"])
    length = (x * x + y * y + z * z) ** 0.5
    direction = (x / length, y / length, z / length)
    return _make(
        parts.Light, item, direction=direction, provenance=item.get("from", "")
    )


def _render(item: Mapping[str, Any]) -> parts.Render:
    camera = item.get("camera", ())
    views = (
        [{"time": 0, **camera}] if isinstance(camera, dict) else camera
    )  # one view holds all the time
    handheld = camera.get("handheld", 0.0) if isinstance(camera, dict) else 0.0
    return _make(
        parts.Render,
        {"slow": 1, **item},
        overlay=tuple(map(parts.Overlay, dict.fromkeys(item["overlay"]))),
        camera=tuple(_make(parts.CameraView, view) for view in views),
        sound=_sound_level(item.get("sound", False)),
        handheld=handheld,
    )


def _sound_level(item: bool | Mapping[str, Any]) -> parts.SoundLevel | None:
    """Return the level of `sound:`; None if it is false."""
    if isinstance(item, Mapping):
        return parts.SoundLevel(item.get("level", "peak"))
    return parts.SoundLevel.PEAK if item else None
