"""Construct the frozen Scene from a checked tree."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import cache
from math import acos, ceil, cos, pi, radians, sin, sqrt
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from physgen.problems import Place
from physgen.scene import scene as parts
from physgen.scene.checked_tree import Ground
from physgen.scene.document import (
    Node,
    Source,
    children,
    items,
    to_plain_data,
)
from physgen.scene.files import Record
from physgen.scene.schema import (
    with_defaults,
)
from physgen.scene.tree_numbers import OpenDuration
from physgen.text import KeyPath, dotted, natural

T = TypeVar("T")

EARTH = 9.8
"""Gravity of the paper's code, m/s². Multiplied by pixels_per_meter, it is the default
of scenes.
"""


def _complete_objects(
    items: dict[str, Any], entries: Mapping[str, Any], record: Record, ground: Ground
) -> None:
    """Add the sources and the computed defaults to the objects of a scene.

    `entries` are the objects of the file, `items` those with defaults.
    """
    for name, entry in entries.items():
        item = items[name]
        item["from"] = record.sources(entry, item, name)
        if "shape" in entry or not isinstance(entry.get("mask"), int):
            continue
        # The file's own shape has its own solid; the stored one belongs to the stored
        # shape.
        stored_shapes = ground.outlines.get(entry["mask"])
        if stored_shapes is not None and stored_shapes[2] is not None:
            item.setdefault("solid", stored_shapes[2])
    for item in items.values():
        # Without mass and density, objects have the density 1 g/px².
        if "mass" not in item and "density" not in item:
            item["density"] = 1


def _default_gravity(world: Mapping[str, Any]) -> list[float]:
    """Return the gravity of the earth, or none from above, px/s²."""
    if world["view"] != "side":
        return [0, 0]
    return [0, round(EARTH * world["pixels_per_meter"], 9)]


def _maps(
    stored_maps: Mapping[str, parts.Point], file_maps: Mapping[str, Sequence[float]]
) -> Mapping[str, parts.Point]:
    """Return the ends of the maps; those in the file replace those of the record."""
    ends = dict(stored_maps)
    for name, values in file_maps.items():
        ends[name] = _pair(values)
    return MappingProxyType(ends)


def _settings(root: Node, world: Mapping[str, Any]) -> parts.Settings:
    """Return the settings of the world."""
    return _make(
        parts.Settings,
        world,
        gravity_in_units=_has_unit(children(root, "world").get("gravity")),
        table_friction=float(world["table"]["friction"]),
        until_rest=isinstance(world["duration"], OpenDuration),
    )


def _real_path(path: Path | None) -> Path | None:
    """Return a path without symbolic links."""
    if path is None:
        return None
    return Path(os.path.realpath(path))


def scene_from_tree(
    root: Node, record: Record, name: str, source: Source, ground: Ground
) -> parts.Scene:
    """Return the scene of a checked tree, with the name `name`; `source` is the opened
    file.

    `record` is the record of perception with later consequences. Named parts have the
    natural order of their names, so that no number depends on the order of keys in a
    file.
    """
    data = _complete_data(root, record, source, ground)
    light = None
    if "light" in data:
        light = _light(data["light"])
    assert ground.size is not None
    return parts.Scene(
        name=name,
        folder=source.folder,
        # Real paths: a link that changes later must not change a loaded scene.
        image=_real_path(ground.image),
        size=ground.size,
        assets=_real_path(ground.assets),
        world=_settings(root, data["world"]),
        objects=tuple(
            _add_stored_shape(item, ground)
            for item in _make_named(data["objects"], _object)
        ),
        boundaries=_make_named(data["boundaries"], _boundary),
        forces=tuple(map(_force, data["forces"])),
        joints=_make_named(data["joints"], _joint),
        fields=_make_named(data["fields"], _field),
        light=light,
        render=_render(data["render"]),
        refine=refinement(data["refine"]),
        maps=_maps(ground.record.maps, data.get("maps", {})),
        record=replace(ground.record, world=record.world),
        places=MappingProxyType(dict(_places(root, ()))),
        document=MappingProxyType(data),
        variants=tuple(data["variants"]),
        title=data.get("title"),
    )


def _complete_data(
    root: Node, record: Record, source: Source, ground: Ground
) -> dict[str, Any]:
    """Return the data of a checked tree with defaults, and paths from the opened file.

    Defaults come before the construction, so that the manifest's document has them too.
    """
    scene_data = to_plain_data(root)
    data: dict[str, Any] = with_defaults(scene_data)
    _complete_objects(data["objects"], scene_data.get("objects", {}), record, ground)
    # Paths of an extended file start at its own folder.
    for key in ("image", "assets"):
        node = children(root).get(key)
        if node is not None and node.source.folder != source.folder:
            path = node.source.folder / str(node.value)
            data[key] = Path(os.path.relpath(path, source.folder)).as_posix()
    world = data["world"]
    # The default of gravity depends on the scale and the view, and cannot be in the
    # schema.
    if "gravity" not in world:
        world["gravity"] = _default_gravity(world)
    return data


def _has_unit(node: Node | None) -> bool:
    """Return whether a vector was written with a unit."""
    return any(item.text is not None for item in items(node))


def refinement(item: Mapping[str, Any]) -> parts.Refine:
    """Return `refine:` as plain data with defaults."""
    return _make(parts.Refine, item)


def _places(node: Node, path: KeyPath) -> Iterator[tuple[str, Place]]:
    """Yield the place of every key's value and of every mapping in a list. Points have
    the place of their list.
    """
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


def _make_named(
    section: Mapping[str, Any], make: Callable[[str, Any], T]
) -> tuple[T, ...]:
    return tuple(make(name, section[name]) for name in sorted(section, key=natural))


def _make(dataclass_type: type[T], item: Mapping[str, Any], /, **given: Any) -> T:
    """Return a dataclass of the keys of `item`, converted to the types of its fields.
    Missing keys become None.
    """
    for name, convert in _readers(dataclass_type):  # type: ignore[arg-type]
        if name not in given:
            value = item.get(name)
            if value is None:
                given[name] = None
            else:
                given[name] = convert(value)
    return dataclass_type(**given)


@cache
def _readers(dataclass_type: Any) -> tuple[tuple[str, Callable[[Any], Any]], ...]:
    """Return the name of each field, and the converter of its value."""
    readers = (
        (field.name, str(field.type).removesuffix(" | None"))
        for field in fields(dataclass_type)
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
"""Type of a field -> converter of a value in the file. Other types are enums, or need
no conversion.
"""


def _object(name: str, item: Mapping[str, Any]) -> parts.Object:
    if isinstance(item["motion"], dict):
        path = item["motion"]["path"]
    else:
        path = []
    return _make(
        parts.Object,
        item,
        name=name,
        roll=item["roll"] if isinstance(item["roll"], str) else _pair(item["roll"]),
        motion=parts.Motion.SCRIPTED if path else parts.Motion(item["motion"]),
        loop=isinstance(item["motion"], dict) and item["motion"].get("loop", False),
        # A knot is time, x, y and an optional angle, 0 by default.
        path=tuple(
            parts.Waypoint(float(k[0]), _pair(k[1:3]), float([*k, 0][3])) for k in path
        ),
        provenance=MappingProxyType(dict(item["from"])),
        prompt=_prompt(item["prompt"]) if "prompt" in item else None,
        place=tuple(map(float, [*item["place"], 0][:3])) if "place" in item else None,
        wheels=tuple(_make(parts.Wheel, wheel) for wheel in item.get("wheels", ())),
    )


def _add_stored_shape(item: parts.Object, ground: Ground) -> parts.Object:
    """Return the object with the shape stored for its mask."""
    if isinstance(item.mask, parts.MaskId):
        stored_shape = ground.outlines.get(item.mask.id)
    else:
        stored_shape = None
    if stored_shape is None or not isinstance(item.shape, parts.Auto):
        return item
    shape = _shape(stored_shape[1])
    assert not isinstance(shape, parts.Auto)
    assert isinstance(item.mask, parts.MaskId)
    whole_node = ground.wholes.get(item.mask.id)
    if whole_node is None:
        whole_outline = None
    else:
        whole_outline = _shape(whole_node)
    assert not isinstance(whole_outline, parts.Auto)
    return replace(item, shape=parts.Auto(shape, stored_shape[0], whole_outline))


def _prompt(value: Mapping[str, Any]) -> parts.BoxPrompt | parts.PointPrompt:
    # The schema allows exactly one of the two keys.
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
    if "shape" in item:
        shape = _shape(item["shape"])
    else:
        shape = None
    values = {"name": name, "points": points, "shape": shape, "is_smooth": is_smooth}
    return _make(parts.Boundary, item, **values)


SAG = 0.002
"""Maximum distance of a curve from its chords, px: less than the overlap of
contacts.
"""

MOST_CHORDS = 2000
"""Maximum number of chords of one curve."""


def arc_points(item: Mapping[str, Any]) -> parts.Points:
    """Return points along an arc. The chords are within SAG of it."""
    (x, y), radius = _pair(item["center"]), float(item["radius"])
    begin = radians(float(item.get("from", 0.0)))
    turn = radians(float(item.get("to", 360.0))) - begin
    # The sagitta of a chord is r (1 - cos(angle/2)). The bound keeps small arcs round.
    chord = 2 * acos(max(1 - SAG / radius, 0.9))
    count = min(max(1, ceil(abs(turn) / chord)), MOST_CHORDS)
    angles = [begin + turn * k / count for k in range(count + 1)]
    points = [(x + radius * cos(a), y + radius * sin(a)) for a in angles]
    # Rounding must not leave a gap in a full circle.
    if abs(abs(turn) - 2 * pi) < 1e-9:
        points[-1] = points[0]
    return tuple(points)


def bezier_points(values: Sequence[Sequence[float]]) -> parts.Points:
    """Return points along cubic Bézier curves. The chords are within SAG of them."""
    corners = np.array(values, np.float64)
    points = [corners[0]]
    for k in range(0, len(corners) - 1, 3):
        a, b, c, d = corners[k : k + 4]
        # The distance of a chord over 1/n of the parameter is at most |p''|/(8 n²).
        bend = 6 * max(np.hypot(*(a - 2 * b + c)), np.hypot(*(b - 2 * c + d)))
        count = min(max(1, ceil(sqrt(bend / (8 * SAG)))), MOST_CHORDS)
        # Bernstein polynomials of degree 3; the last point of a curve is the first of
        # the next one.
        t = np.arange(1, count + 1)[:, None] / count
        s = 1 - t
        points += list(s**3 * a + 3 * s**2 * t * b + 3 * s * t**2 * c + t**3 * d)
    return tuple((float(x), float(y)) for x, y in points)


def _force(item: Mapping[str, Any]) -> parts.Force:
    (load,) = (load for load in parts.Load if load.value in item)
    turning = load is parts.Load.TORQUE
    if turning:
        vector = (0.0, 0.0)
    else:
        vector = _pair(item[load.value])
    if "profile" in item:
        profile = _profile(item["profile"])
    else:
        profile = None
    values = {"torque": 0, **item}
    return _make(parts.Force, values, load=load, vector=vector, profile=profile)


def _profile(item: Mapping[str, Any]) -> parts.Profile:
    ((name, value),) = item.items()
    kind = parts.ProfileKind(name)
    numbers: parts.Points
    if kind in SINGLE:
        numbers = ((float(value), 0.0),)
    else:
        numbers = ()
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
    # A kind of joint has one point, a line of points, a path over time or none.
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
    # The numbers of a field are a velocity, a place, or a place with an extent.
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
    # The file may have a direction of any length.
    length = (x * x + y * y + z * z) ** 0.5
    direction = (x / length, y / length, z / length)
    return _make(
        parts.Light, item, direction=direction, provenance=item.get("from", "")
    )


def _render(item: Mapping[str, Any]) -> parts.Render:
    camera = item.get("camera", ())
    # A single view lasts for the whole clip.
    if isinstance(camera, dict):
        views = [{"time": 0, **camera}]
    else:
        views = camera
    handheld = 0.0
    if isinstance(camera, dict):
        handheld = camera.get("handheld", 0.0)
    return _make(
        parts.Render,
        {"slow": 1, **item},
        overlay=tuple(map(parts.Overlay, dict.fromkeys(item["overlay"]))),
        camera=tuple(_make(parts.CameraView, view) for view in views),
        sound=_sound_level(item.get("sound", False)),
        handheld=handheld,
    )


def _sound_level(item: bool | Mapping[str, Any]) -> parts.SoundLevel | None:
    """Return the level of `sound:`, or None for false."""
    if isinstance(item, Mapping):
        return parts.SoundLevel(item.get("level", "peak"))
    if item:
        return parts.SoundLevel.PEAK
    return None
