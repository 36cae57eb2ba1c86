"""Loads a scene file: inheritance, variants, overrides, checks, and the frozen Scene."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from physgen.files import file_stamp
from physgen.problems import InputError, Place, Problem
from physgen.scene import scene
from physgen.scene.document import Node, Source, children, decode, items, plain, read
from physgen.scene.files import read_scene, with_bases
from physgen.scene.overlay import apply, edit_of_flag, edits_of_variant, targets, variants_of
from physgen.scene.rules import Files, Ground, check_rules
from physgen.scene.schema import with_defaults
from physgen.scene.validate import Findings, TooManyError, checker
from physgen.text import KeyPath, dotted, listed, natural, nearest, quoted

# ----------------------------------------------------------------------
# Tree that keeps to every rule -> frozen Scene, with defaults filled in.

EARTH = 9.8
"""m/s², the gravity of the paper's code; times pixels_per_meter where a scene names none."""

T = TypeVar("T")


def scene_from_tree(root: Node, name: str, source: Source, ground: Ground) -> scene.Scene:
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
    return scene.Scene(
        name=name,
        folder=source.folder,
        image=None if ground.image is None else Path(os.path.realpath(ground.image)),
        size=ground.size,
        assets=None if ground.assets is None else Path(os.path.realpath(ground.assets)),
        world=scene.Settings(
            view=scene.View(world["view"]),
            pixels_per_meter=float(world["pixels_per_meter"]),
            gravity=_pair(world["gravity"]),
            table_friction=float(world["table"]["friction"]),
            combine=scene.Combine(world["combine"]),
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


def refinement(item: Mapping[str, Any]) -> scene.Refine:
    """`refine:` as plain data, its defaults filled in."""
    return scene.Refine(
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


def _pair(values: Sequence[float]) -> scene.Point:
    return float(values[0]), float(values[1])


def _points(values: Sequence[Sequence[float]]) -> scene.Points:
    return tuple((float(x), float(y)) for x, y in values)


def _object(name: str, item: Mapping[str, Any]) -> scene.Object:
    path = item["motion"]["path"] if isinstance(item["motion"], dict) else []
    return scene.Object(
        name=name,
        label=item["label"],
        mask=_mask(item["mask"]) if "mask" in item else None,
        shape=_shape(item["shape"]),
        solid=scene.Solid(item["solid"]) if "solid" in item else None,
        mass=_number(item, "mass"),
        density=_number(item, "density"),
        friction=float(item["friction"]),
        elasticity=float(item["elasticity"]),
        rolling=float(item["rolling"]),
        velocity=_pair(item["velocity"]),
        spin=float(item["spin"]),
        roll=item["roll"] if isinstance(item["roll"], str) else _pair(item["roll"]),
        motion=scene.Motion.SCRIPTED if path else scene.Motion(item["motion"]),
        path=tuple(scene.Waypoint(float(k[0]), _pair(k[1:3]), float([*k, 0][3])) for k in path),
        layer=int(item["layer"]),
        provenance=MappingProxyType(dict(item["from"])),
        prompt=_prompt(item["prompt"]) if "prompt" in item else None,
        place=_place(item["place"]) if "place" in item else None,
    )


def _place(value: Sequence[float]) -> tuple[float, float, float]:
    x, y, *turn = map(float, value)
    return x, y, turn[0] if turn else 0.0


def _prompt(value: Mapping[str, Any]) -> scene.BoxPrompt | scene.PointPrompt:
    if "point" in value:
        return scene.PointPrompt(_pair(value["point"]))
    x, y, width, height = map(float, value["box"])
    return scene.BoxPrompt((x, y, width, height))


def _mask(value: Any) -> scene.Mask:
    if not isinstance(value, dict):
        return scene.MaskId(int(value))
    if "polygon" in value:
        return scene.MaskPolygon(_points(value["polygon"]))
    height, width = value["rle"]["size"]
    return scene.MaskRle((int(height), int(width)), tuple(map(int, value["rle"]["counts"])))


def _shape(value: Any) -> scene.Shape:
    if not isinstance(value, dict):
        return scene.Auto()
    ((kind, part),) = value.items()
    if kind == "circle":
        return scene.Circle(_pair(part["center"]), float(part["radius"]))
    if kind == "box":
        return scene.Box(_pair(part["center"]), _pair(part["size"]), float(part["angle"]))
    if kind == "polygon":
        return scene.Polygon((scene.Ring(_points(part)),))
    rings = (scene.Ring(_points(piece["outline"]), tuple(map(_points, piece["holes"]))) for piece in part)
    return scene.Polygon(tuple(rings))


def _boundary(name: str, item: Mapping[str, Any]) -> scene.Boundary:
    points = _points(item.get("segment") or item.get("polyline") or ())
    mask = _mask(item["mask"]) if "mask" in item else None
    return scene.Boundary(name, points, mask, float(item["friction"]), float(item["elasticity"]))


def _force(item: Mapping[str, Any]) -> scene.Force:
    (load,) = (load for load in scene.Load if load.value in item)
    turning = load is scene.Load.TORQUE
    return scene.Force(
        object=item["object"],
        load=load,
        vector=(0.0, 0.0) if turning else _pair(item[load.value]),
        torque=float(item["torque"]) if turning else 0.0,
        at=_pair(item["at"]) if "at" in item else None,
        start=float(item["start"]),
        duration=_number(item, "duration"),
    )


def _joint(name: str, item: Mapping[str, Any]) -> scene.Joint:
    (kind,) = (kind for kind in scene.JointKind if kind.value in item)
    spring = kind is scene.JointKind.SPRING
    return scene.Joint(
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


def _field(name: str, item: Mapping[str, Any]) -> scene.Field:
    (kind,) = (kind for kind in scene.FieldKind if kind.value in item)
    return scene.Field(
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


def _light(item: Mapping[str, Any]) -> scene.Light:
    x, y, z = (float(value) for value in item["direction"])
    length = (x * x + y * y + z * z) ** 0.5
    return scene.Light(
        (x / length, y / length, z / length),
        float(item["intensity"]),
        float(item["ambient"]),
        float(item["softness"]),
        item.get("from", ""),
    )


def _views(camera: Any) -> Sequence[Mapping[str, Any]]:
    """One view is a move of one."""
    return [{"time": 0, **camera}] if isinstance(camera, dict) else camera


def _sight(item: Mapping[str, Any]) -> scene.CameraView:
    center = _pair(item["center"]) if "center" in item else None
    return scene.CameraView(float(item["time"]), center, item.get("follow"), float(item["zoom"]))


def _render(item: Mapping[str, Any]) -> scene.Render:
    return scene.Render(
        fps=float(item["fps"]),
        frames=int(item["frames"]) if "frames" in item else None,
        relight=item["relight"],
        shadows=item["shadows"],
        motion_blur=float(item["motion_blur"]),
        overlay=tuple(map(scene.Overlay, dict.fromkeys(item["overlay"]))),
        slow=float(item.get("slow", 1)),
        play=scene.Play(item["play"]),
        scale=_number(item, "scale"),
        size=(int(item["size"][0]), int(item["size"][1])) if "size" in item else None,
        camera=tuple(map(_sight, _views(item.get("camera", ())))),
        supersample=int(item["supersample"]),
    )


# ----------------------------------------------------------------------
# Path of a scene file, flags -> frozen Scene; raises InputError with every problem at once.
#
# An `Opened` file makes any number of scenes.

MAX_CHECKS = 500_000
"""Variants times the things in a scene: what checking every variant may cost."""
MAX_EDITS = 20_000
"""Values that the variants of a file set, a * counted as often as it applies."""


class Opened:
    """A scene file that was read and checked, for any number of its variants: an edit costs what it changes.

    Of a scene that is right, what an edit leaves as it was is not checked again. `shown` is what messages call it
    where that is not its path. While it is being edited, `text` is what the file will hold, and `assets` the folder
    that its maps are in meanwhile.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        allow_outside: bool = False,
        shown: str | None = None,
        text: str | None = None,
        assets: Path | None = None,
    ) -> None:
        self.file = Path(os.fspath(path))
        name = shown or os.fspath(path)
        self._source = Source(name, Path(os.path.abspath(self.file)).parent)
        self._stamps = {self.file: file_stamp(self.file)} if text is None else {}
        own = read_scene(self.file, name) if text is None else _draft(text, self._source)
        self._root = with_bases(own, self.file, allow_outside, self._stamps)
        self._files = Files(allow_outside, assets)
        self.variants = tuple(name for name, _ in variants_of(self._root))
        self._own = Findings()
        _check(self._root, self._own, self._files)
        self._of_variants = tuple(_problems_of_variants(self._root, self._own, self._files))

    def document(self) -> dict[str, Any]:
        """As plain YAML data, with what it extends and without any default."""
        data = plain(self._root)
        assert isinstance(data, dict)
        return data

    def stale(self) -> bool:
        """Whether it, or a file that it extends, was written since."""
        return any(file_stamp(file) != stamp for file, stamp in self._stamps.items())

    def scene(self, overrides: Sequence[str] = (), variant: str | None = None) -> scene.Scene:
        """With one of its variants and `KEY=VALUE` overrides on top; raises InputError with all problems."""
        edited = _edited(self._root, overrides, variant, self._source)
        report = Findings() if self._own.problems else self._own.beyond()
        ground = _check(
            edited, report, self._files
        )  # of the file itself too: the photo may be another by now
        problems = dict.fromkeys((*report.problems, *self._of_variants))
        if problems:
            raise InputError(problems)
        return replace(
            scene_from_tree(edited, scene_name(self.file), self._source, ground), files=tuple(self._stamps)
        )


def load(
    path: str | os.PathLike[str],
    overrides: Sequence[str] = (),
    variant: str | None = None,
    allow_outside: bool = False,
) -> scene.Scene:
    """The scene of a file, with what it extends, one of its variants and `KEY=VALUE` overrides on top.

    Every variant of the file is checked, whichever is asked for. Paths in the file stay below its folder
    unless `allow_outside`; see files.py. Raises InputError with all problems, sorted by place.
    """
    return Opened(path, allow_outside).scene(overrides, variant)


def raw_document(path: str | os.PathLike[str], allow_outside: bool = False) -> dict[str, Any]:
    """A file as plain YAML data, with what it extends and without any default. Raises InputError."""
    name = os.fspath(path)
    document = plain(with_bases(read_scene(Path(name), name), Path(name), allow_outside))
    assert isinstance(document, dict)
    return document


def _draft(text: str, source: Source) -> Node:
    """The tree of a file's text; raises InputError as if the file were read."""
    return read(decode(text.encode("utf-8", "surrogatepass"), source.name), source)


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


def _check(root: Node, report: Findings, files: Files) -> Ground:
    try:
        checker()(root, (), report)
        return check_rules(root, report, files)
    except TooManyError:
        return Ground()


def _problems_of_variants(root: Node, own: Findings, files: Files) -> Iterator[Problem]:
    """What each variant of the file would break that the file itself, of which `own` tells, does not."""
    named = list(variants_of(root))
    if not named or len(own.problems) > 100:
        return
    things = 16 + _things(root)
    edits = sum(targets(root, key) for _, node in named for key in children(node))
    place = children(root)["variants"].key_place
    if len(named) * things > MAX_CHECKS or edits > MAX_EDITS:
        yield Problem(place, "variants", "", "are too many for a scene of this size", "use sweep")
        return
    report = own.beyond()
    report.problems = dict(own.problems)
    for name, node in named:
        changed = root
        try:
            for edit in edits_of_variant(node, name):
                changed = apply(changed, edit)
        except InputError as error:
            report.problems.update(dict.fromkeys(error.problems))
            continue
        _check(changed, report, files)
    yield from (problem for problem in report.problems if problem not in own.problems)


def _things(root: Node) -> int:
    """How many mappings and names the rules between keys look at."""
    sections = [children(root, key) for key in ("objects", "boundaries", "joints", "fields")]
    names = sum(len(items(children(node).get("objects"))) for part in sections[2:] for node in part.values())
    listed_things = (children(root).get("forces"), children(root, "render").get("camera"))
    return sum(map(len, sections)) + names + sum(len(items(node)) for node in listed_things)


def scene_name(file: Path) -> str:
    """The file's stem, or its folder's name where the file is called `scene.yaml`."""
    return Path(os.path.abspath(file)).parent.name if file.name == "scene.yaml" else file.stem
