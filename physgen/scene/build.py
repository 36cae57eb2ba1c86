"""Path of a scene file, flags -> frozen Scene; raises InputError with every problem at once."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from physgen.problems import InputError, Place, Problem
from physgen.scene import model
from physgen.scene.check import checker
from physgen.scene.files import read_scene, with_bases
from physgen.scene.ground import Files, Ground
from physgen.scene.node import Node, Source, children, plain
from physgen.scene.overlay import apply, edit_of_flag, edits_of_variant, targets, variants_of
from physgen.scene.report import Report, TooManyError
from physgen.scene.rules import check_rules
from physgen.scene.schema import with_defaults
from physgen.scene.words import Path as Keys
from physgen.scene.words import dotted, listed, nearest, quoted

EARTH = 9.8
"""m/s², the gravity of the paper's code; times pixels_per_meter where a scene names none."""
MAX_CHECKS = 500_000
"""Variants times the things in a scene: what checking every variant may cost."""
MAX_EDITS = 20_000
"""Values that the variants of a file set, a * counted as often as it applies."""


def scene_name(file: Path) -> str:
    """The file's stem, or its folder's name where the file is called `scene.yaml`."""
    return Path(os.path.abspath(file)).parent.name if file.name == "scene.yaml" else file.stem


def load(
    path: str | os.PathLike[str],
    overrides: Sequence[str] = (),
    variant: str | None = None,
    allow_outside: bool = False,
) -> model.Scene:
    """The scene of a file, with what it extends, one of its variants and `KEY=VALUE` overrides on top.

    Every variant of the file is checked, whichever is asked for. Paths in the file stay below its folder
    unless `allow_outside`; see files.py. Raises InputError with all problems, sorted by place.
    """
    name = os.fspath(path)
    file = Path(name)
    source = Source(name, Path(os.path.abspath(file)).parent)
    written = with_bases(read_scene(file, name), file, allow_outside)
    files = Files(allow_outside)
    edited = _edited(written, overrides, variant, source)
    report = Report()
    ground = _check(edited, report, files)
    _check_variants(written, report if edited is written else Report(), report, files)
    if report.problems:
        raise InputError(report.problems)
    return _scene(edited, file, source, ground)


def _edited(root: Node, overrides: Sequence[str], variant: str | None, source: Source) -> Node:
    """The tree after a variant and the overrides; raises InputError with every edit that cannot be made."""
    problems: list[Problem] = []
    edits = []
    if variant is not None:
        known = dict(variants_of(root))
        if variant in known:
            edits += edits_of_variant(known[variant], variant)
        else:
            close = nearest(variant, known)
            fix = f'did you mean "{close}"?' if close else f"write one of {listed(list(known)[:30])}"
            fix = fix if known else "the file has no variants"
            found = quoted(variant)
            problems.append(
                Problem(Place(f"--variant {quoted(variant, '')}"), "", found, "is not a variant", fix)
            )
    for text in overrides:
        try:
            edits.append(edit_of_flag(text, source))
        except InputError as error:
            problems += error.problems
    for edit in edits:
        try:
            root = apply(root, edit)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(dict.fromkeys(problems))
    return root


def _check(root: Node, report: Report, files: Files) -> Ground:
    try:
        checker()(root, (), report)
        return check_rules(root, report, files)
    except TooManyError:
        return Ground()


def _check_variants(root: Node, report: Report, into: Report, files: Files) -> None:
    """Adds to `into` what each variant of the file would break that the file itself does not."""
    named = list(variants_of(root))
    if not named or len(into.problems) > 100:
        return
    things = 16 + sum(len(children(root, key)) for key in ("objects", "boundaries"))
    forces = children(root).get("forces")
    things += len(forces.value) if forces and isinstance(forces.value, list) else 0
    edits = sum(targets(root, key) for _, node in named for key in children(node))
    place = children(root)["variants"].key_place
    if len(named) * things > MAX_CHECKS or edits > MAX_EDITS:
        into.problems[
            Problem(place, "variants", "", "are too many for a scene of this size", "use sweep")
        ] = None
        return
    if report is not into:
        _check(root, report, files)
    before = set(report.problems)
    for name, node in named:
        changed = root
        try:
            for edit in edits_of_variant(node, name):
                changed = apply(changed, edit)
        except InputError as error:
            report.problems.update(dict.fromkeys(error.problems))
            continue
        _check(changed, report, files)
    into.problems.update((problem, None) for problem in report.problems if problem not in before)


# Tree -> Scene


def _scene(root: Node, file: Path, source: Source, ground: Ground) -> model.Scene:
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
        name=scene_name(file),
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
        ),
        objects=tuple(_object(name, item) for name, item in data["objects"].items()),
        boundaries=tuple(_boundary(name, item) for name, item in data["boundaries"].items()),
        forces=tuple(map(_force, data["forces"])),
        joints=(),
        fields=(),
        light=_light(data["light"]) if "light" in data else None,
        render=_render(data["render"]),
        refine=model.Refine(
            backend=data["refine"]["backend"],
            strength=float(data["refine"]["strength"]),
            stop=int(data["refine"]["stop"]),
            steps=int(data["refine"]["steps"]),
            seed=int(data["refine"]["seed"]),
        ),
        maps=MappingProxyType({name: _pair(ends) for name, ends in data.get("maps", {}).items()}),
        places=MappingProxyType(dict(_places(root, ()))),
        document=MappingProxyType(data),
        variants=tuple(data["variants"]),
    )


def _places(node: Node, path: Keys) -> Iterator[tuple[str, Place]]:
    """Place of every key's value and of every mapping in a list; points stand in the place of their list."""
    yield dotted(path), node.place
    if isinstance(node.value, dict):
        for key, child in node.value.items():
            yield from _places(child, (*path, key))
    elif isinstance(node.value, list) and node.value and isinstance(node.value[0].value, dict):
        for index, child in enumerate(node.value):
            yield from _places(child, (*path, index))


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
        mass=float(item["mass"]) if "mass" in item else None,
        density=float(item["density"]) if "density" in item else None,
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
    )


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
    points = _points(item["segment"] if "segment" in item else item["polyline"])
    return model.Boundary(name, points, None, float(item["friction"]), float(item["elasticity"]))


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
        duration=float(item["duration"]) if "duration" in item else None,
    )


def _light(item: Mapping[str, Any]) -> model.Light:
    x, y, z = (float(value) for value in item["direction"])
    length = (x * x + y * y + z * z) ** 0.5
    return model.Light((x / length, y / length, z / length), float(item["intensity"]), float(item["ambient"]))


def _render(item: Mapping[str, Any]) -> model.Render:
    return model.Render(
        fps=float(item["fps"]),
        frames=int(item["frames"]) if "frames" in item else None,
        relight=item["relight"],
        shadows=item["shadows"],
        motion_blur=float(item["motion_blur"]),
    )
