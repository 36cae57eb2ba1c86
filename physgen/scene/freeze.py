"""Tree that keeps to every rule -> frozen Scene, with defaults filled in."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from physgen.problems import Place
from physgen.scene import model
from physgen.scene.ground import Ground
from physgen.scene.node import Node, Source, children, plain
from physgen.scene.schema import with_defaults
from physgen.scene.words import KeyPath, dotted, natural

EARTH = 9.8
"""m/s², the gravity of the paper's code; times pixels_per_meter where a scene names none."""

T = TypeVar("T")


def frozen(root: Node, name: str, source: Source, ground: Ground) -> model.Scene:
    """The scene of a checked tree, called `name`; `source` is the file that was opened.

    Named things stand in the natural order of their names, so that no number depends on the order of keys in a file.
    """
    data = with_defaults(plain(root))
    for key in ("image", "assets"):
        node = children(root).get(key)
        if node is not None and node.source.folder != source.folder:
            data[key] = Path(os.path.relpath(node.source.folder / str(node.value), source.folder)).as_posix()
    world = data["world"]
    if "gravity" not in world:
        down = round(EARTH * world["pixels_per_meter"], 9) if world["view"] == "side" else 0
        world["gravity"] = [0, down]
    for item in data["objects"].values():
        if "mass" not in item and "density" not in item:
            item["density"] = 1
    assert ground.size is not None
    return model.Scene(
        name=name,
        folder=source.folder,
        image=None if ground.image is None else Path(os.path.realpath(ground.image)),
        size=ground.size,
        assets=None if ground.assets is None else Path(os.path.realpath(ground.assets)),
        world=model.Settings(
            view=model.View(world["view"]),
            pixels_per_meter=float(world["pixels_per_meter"]),
            gravity=_pair(world["gravity"]),
            table_friction=float(world["table"]["friction"]),
            combine=model.Combine(world["combine"]),
            duration=float(world["duration"]),
            steps_per_second=float(world["steps_per_second"]),
            tilt=float(world["tilt"]),
            backdrop=float(world["backdrop"]) if "backdrop" in world else None,
        ),
        objects=_named(data["objects"], _object),
        boundaries=_named(data["boundaries"], _boundary),
        forces=tuple(map(_force, data["forces"])),
        joints=_named(data["joints"], _joint),
        fields=_named(data["fields"], _field),
        light=_light(data["light"]) if "light" in data else None,
        render=_render(data["render"]),
        refine=refinement(data["refine"]),
        maps=MappingProxyType({name: _pair(ends) for name, ends in data.get("maps", {}).items()}),
        places=MappingProxyType(dict(_places(root, ()))),
        document=MappingProxyType(data),
        variants=tuple(data["variants"]),
    )


def refinement(item: Mapping[str, Any]) -> model.Refine:
    """`refine:` as plain data, its defaults filled in."""
    return model.Refine(
        backend=item["backend"],
        strength=float(item["strength"]),
        stop=int(item["stop"]),
        steps=int(item["steps"]),
        seed=int(item["seed"]),
        prompt=item.get("prompt"),
        negative=item["negative"],
        guidance=_number(item, "guidance"),
        lock=float(item["lock"]),
        detail=float(item["detail"]),
    )


def _places(node: Node, path: KeyPath) -> Iterator[tuple[str, Place]]:
    """Place of every key's value and of every mapping in a list; points stand in the place of their list."""
    yield dotted(path), node.place
    if isinstance(node.value, dict):
        for key, child in node.value.items():
            yield from _places(child, (*path, key))
    elif isinstance(node.value, list) and node.value and isinstance(node.value[0].value, dict):
        for index, child in enumerate(node.value):
            yield from _places(child, (*path, index))


def _named(section: Mapping[str, Any], make: Callable[[str, Any], T]) -> tuple[T, ...]:
    return tuple(make(name, section[name]) for name in sorted(section, key=natural))


def _pair(values: Sequence[float]) -> model.Point:
    return float(values[0]), float(values[1])


def _points(values: Sequence[Sequence[float]]) -> model.Points:
    return tuple((float(x), float(y)) for x, y in values)


def _object(name: str, item: Mapping[str, Any]) -> model.Object:
    path = item["motion"]["path"] if isinstance(item["motion"], dict) else []
    return model.Object(
        name=name,
        label=item["label"],
        mask=_mask(item["mask"]) if "mask" in item else None,
        shape=_shape(item["shape"]),
        solid=model.Solid(item["solid"]) if "solid" in item else None,
        mass=_number(item, "mass"),
        density=_number(item, "density"),
        friction=float(item["friction"]),
        elasticity=float(item["elasticity"]),
        rolling=float(item["rolling"]),
        velocity=_pair(item["velocity"]),
        spin=float(item["spin"]),
        roll=item["roll"] if isinstance(item["roll"], str) else _pair(item["roll"]),
        motion=model.Motion.SCRIPTED if path else model.Motion(item["motion"]),
        path=tuple(model.Waypoint(float(k[0]), _pair(k[1:3]), float([*k, 0][3])) for k in path),
        layer=int(item["layer"]),
        provenance=MappingProxyType(dict(item["from"])),
        prompt=_prompt(item["prompt"]) if "prompt" in item else None,
        place=_place(item["place"]) if "place" in item else None,
    )


def _place(value: Sequence[float]) -> tuple[float, float, float]:
    x, y, *turn = map(float, value)
    return x, y, turn[0] if turn else 0.0


def _prompt(value: Mapping[str, Any]) -> model.BoxPrompt | model.PointPrompt:
    if "point" in value:
        return model.PointPrompt(_pair(value["point"]))
    x, y, width, height = map(float, value["box"])
    return model.BoxPrompt((x, y, width, height))


def _mask(value: Any) -> model.Mask:
    if not isinstance(value, dict):
        return model.MaskId(int(value))
    if "polygon" in value:
        return model.MaskPolygon(_points(value["polygon"]))
    height, width = value["rle"]["size"]
    return model.MaskRle((int(height), int(width)), tuple(map(int, value["rle"]["counts"])))


def _shape(value: Any) -> model.Shape:
    if not isinstance(value, dict):
        return model.Auto()
    ((kind, part),) = value.items()
    if kind == "circle":
        return model.Circle(_pair(part["center"]), float(part["radius"]))
    if kind == "box":
        return model.Box(_pair(part["center"]), _pair(part["size"]), float(part["angle"]))
    if kind == "polygon":
        return model.Polygon((model.Ring(_points(part)),))
    rings = (model.Ring(_points(piece["outline"]), tuple(map(_points, piece["holes"]))) for piece in part)
    return model.Polygon(tuple(rings))


def _boundary(name: str, item: Mapping[str, Any]) -> model.Boundary:
    points = _points(item.get("segment") or item.get("polyline") or ())
    mask = _mask(item["mask"]) if "mask" in item else None
    return model.Boundary(name, points, mask, float(item["friction"]), float(item["elasticity"]))


def _force(item: Mapping[str, Any]) -> model.Force:
    (load,) = (load for load in model.Load if load.value in item)
    turning = load is model.Load.TORQUE
    return model.Force(
        object=item["object"],
        load=load,
        vector=(0.0, 0.0) if turning else _pair(item[load.value]),
        torque=float(item["torque"]) if turning else 0.0,
        at=_pair(item["at"]) if "at" in item else None,
        start=float(item["start"]),
        duration=_number(item, "duration"),
    )


def _joint(name: str, item: Mapping[str, Any]) -> model.Joint:
    (kind,) = (kind for kind in model.JointKind if kind.value in item)
    spring = kind is model.JointKind.SPRING
    return model.Joint(
        name=name,
        kind=kind,
        objects=tuple(item["objects"]),
        points=_points(item["spring"]) if spring else (_pair(item[kind.value]),),
        length=_number(item, "length"),
        stiffness=float(item.get("stiffness", 0)),
        damping=float(item.get("damping", 0)),
        speed=float(item.get("speed", 0)),
        limit=_number(item, "limit"),
        collide=item["collide"],
    )


def _field(name: str, item: Mapping[str, Any]) -> model.Field:
    (kind,) = (kind for kind in model.FieldKind if kind.value in item)
    return model.Field(
        name=name,
        kind=kind,
        objects=tuple(item.get("objects", ())),
        vector=_pair(item[kind.value]),
        drag=float(item.get("drag", 0)),
        strength=float(item.get("strength", 0)),
        soften=float(item.get("soften", 0)),
    )


def _number(item: Mapping[str, Any], key: str) -> float | None:
    return float(item[key]) if key in item else None


def _light(item: Mapping[str, Any]) -> model.Light:
    x, y, z = (float(value) for value in item["direction"])
    length = (x * x + y * y + z * z) ** 0.5
    return model.Light(
        (x / length, y / length, z / length),
        float(item["intensity"]),
        float(item["ambient"]),
        float(item["softness"]),
        item.get("from", ""),
    )


def _views(camera: Any) -> Sequence[Mapping[str, Any]]:
    """One view is a move of one."""
    return [{"time": 0, **camera}] if isinstance(camera, dict) else camera


def _sight(item: Mapping[str, Any]) -> model.Sight:
    center = _pair(item["center"]) if "center" in item else None
    return model.Sight(float(item["time"]), center, item.get("follow"), float(item["zoom"]))


def _render(item: Mapping[str, Any]) -> model.Render:
    return model.Render(
        fps=float(item["fps"]),
        frames=int(item["frames"]) if "frames" in item else None,
        relight=item["relight"],
        shadows=item["shadows"],
        motion_blur=float(item["motion_blur"]),
        overlay=tuple(map(model.Overlay, dict.fromkeys(item["overlay"]))),
        slow=float(item.get("slow", 1)),
        play=model.Play(item["play"]),
        scale=_number(item, "scale"),
        size=(int(item["size"][0]), int(item["size"][1])) if "size" in item else None,
        camera=tuple(map(_sight, _views(item.get("camera", ())))),
        supersample=int(item["supersample"]),
    )
