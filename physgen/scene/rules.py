"""Rules between keys of a scene that JSON Schema cannot express, and checks of the files that it names."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import ceil, floor, sqrt
from pathlib import Path
from typing import Any

from physgen import registry
from physgen.files import Stamp, file_stamp
from physgen.geometry.framing import Size, video_size
from physgen.image_formats import MOST_PIXELS
from physgen.scene.document import Node, children, items, whole
from physgen.scene.files import MAPS, RefusedError, confined, image_size
from physgen.scene.outlines import outline_problem, same_point
from physgen.scene.schema import Schema, advice, at
from physgen.scene.validate import Findings
from physgen.text import KeyPath, listed, nearest, number, quoted, shown

# ----------------------------------------------------------------------
# Forces, joints and fields of a tree -> Problems: whom they name, and keys that mean nothing for their kind.

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


def check_joints(root: Node, report: Findings) -> None:
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


def check_name(node: Node, path: KeyPath, names: Mapping[str, Node], report: Findings) -> None:
    """Adds a problem where a value names no object of the scene."""
    if str(node.value) in names:
        return
    close = nearest(str(node.value), names)
    fix = f"did you mean {quoted(close)}?" if close else f"write {listed(list(names)[:30])}"
    if not names:
        fix = "write it under objects first"
    report.add(node.place, path, shown(node.value), "is not an object of this scene", fix)


def check_forces(root: Node, report: Findings) -> None:
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


def _one_of(node: Node, path: KeyPath, kinds: tuple[str, ...], report: Findings) -> str | None:
    """The one kind that a mapping has; a problem where it has none or several."""
    given = [key for key in kinds if key in children(node)]
    if len(given) == 1:
        return given[0]
    has = f"has {listed(given, 'and')}" if given else f"has no {listed(kinds)}"
    report.add(node.place, path, "", has, f"write exactly one of {listed(kinds, 'and')}")
    return None


def _kind(node: Node, path: KeyPath, kinds: tuple[str, ...], schema: Schema, report: Findings) -> None:
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


def _senseless(node: Node, path: KeyPath, why: str, report: Findings) -> None:
    report.add(node.key_place, path, "", f"has no meaning here: {why}", "take it out")


def _not_itself(objects: Node | None, path: KeyPath, report: Findings) -> None:
    names = [item.value for item in items(objects) if item not in report.bad]
    if objects is not None and len(names) == 2 and names[0] == names[1]:
        fix = "name two objects, or one to hold it to the world"
        report.add(objects.place, (*path, "objects"), shown(names[0]), "is joined to itself", fix)


# ----------------------------------------------------------------------
# `render:` of a tree -> Problems between its keys: rivals, the video's size, and where the camera looks.


def check_film(root: Node, photo: Size | None, report: Findings) -> None:
    """Adds what is wrong in `render`; `photo` is the canvas, None where that is not known."""
    node = children(root).get("render")
    if node is None:
        return
    parts = children(node)
    _rivals(node, ("render",), at("render"), report)
    if photo is not None:
        _size(parts, photo, report)
    camera = parts.get("camera")
    if camera is None:
        return
    before: Any = None
    for view, path in _views(camera):
        _rivals(view, path, at("render.camera"), report)
        sight = {key: part for key, part in children(view).items() if part not in report.bad}
        if "time" in sight:
            before = _later(sight["time"], (*path, "time"), before, report)
        if "follow" in sight:
            check_name(sight["follow"], (*path, "follow"), children(root, "objects"), report)
        if "center" in sight and photo is not None:
            _inside(sight["center"], (*path, "center"), photo, report)


def _views(camera: Node) -> Iterator[tuple[Node, KeyPath]]:
    path: KeyPath = ("render", "camera")
    if isinstance(camera.value, list):
        yield from ((view, (*path, index)) for index, view in enumerate(camera.value))
    else:
        yield camera, path


def _rivals(node: Node, path: KeyPath, schema: Schema, report: Findings) -> None:
    """Keys that rule each other out."""
    parts = children(node)
    for group in schema["x-exclusive"]:
        first, *rest = [key for key in group if key in parts] or [""]
        for key in rest:
            place = parts[key].key_place
            report.add(place, (*path, key), "", f"stands beside {first}", "write only one of the two")


def _size(parts: dict[str, Node], photo: Size, report: Findings) -> None:
    """Neither larger than a photo may be."""
    scale, size = parts.get("scale"), parts.get("size")
    if size is not None and size not in report.bad:
        width, height = whole(size)
        if width * height > MOST_PIXELS:
            found, fix = f"{width} x {height}", "make it smaller, e.g. [832, 480]"
            report.add(size.place, "render.size", found, "is more than 100 megapixels", fix)
    if scale is not None and scale not in report.bad:
        factor: Any = scale.value
        width, height = video_size(photo, factor, None)
        if width * height > MOST_PIXELS:
            most = floor(sqrt(MOST_PIXELS / (photo[0] * photo[1])) * 100) / 100
            expected = f"makes a video of {width} x {height}, more than 100 megapixels"
            report.add(scale.place, "render.scale", shown(factor), expected, f"write at most {most:g}")


def _later(node: Node, path: KeyPath, before: Any, report: Findings) -> Any:
    """The time of a view, which is after the one `before`."""
    now: Any = node.value
    if before is not None and now <= before:
        expected = f"is not after {number(before)}"
        report.add(node.place, path, shown(now), expected, "write views with rising times")
    return now


def _inside(node: Node, path: KeyPath, photo: Size, report: Findings) -> None:
    x, y = (item.value for item in items(node))
    if not all(-0.5 <= c <= side - 0.5 for c, side in zip((x, y), photo, strict=True)):  # type: ignore[operator]
        expected = f"is beside the photo, which is {photo[0]} x {photo[1]}"
        fix = f"write a point in it, e.g. [{photo[0] // 2}, {photo[1] // 2}]"
        report.add(node.place, path, f"[{shown(x)}, {shown(y)}]", expected, fix)


# ----------------------------------------------------------------------
# Tree of a scene -> the canvas, the photo and the maps that it stands on, read no further than headers.


@dataclass
class Ground:
    """What a scene stands on: the canvas (width, height) px, the photo and the folder of maps."""

    size: tuple[int, int] | None = None
    image: Path | None = None
    assets: Path | None = None


class Files:
    """Files that a scene names, each looked at once however many variants are checked, until it is written.

    While a scene is being edited, its maps are in the folder `assets`, wherever its file says they will be.
    """

    def __init__(self, allow_outside: bool, assets: Path | None = None) -> None:
        self.allow_outside, self.assets = allow_outside, assets
        self._sizes: dict[str, tuple[Stamp, tuple[int, int] | RefusedError]] = {}

    def size(self, path: Path) -> tuple[int, int]:
        """Width and height of an image; raises RefusedError."""
        key, stamp = str(path), file_stamp(path)
        if key not in self._sizes or self._sizes[key][0] != stamp:
            try:
                self._sizes[key] = stamp, image_size(path)
            except RefusedError as error:
                self._sizes[key] = stamp, error
        found = self._sizes[key][1]
        if isinstance(found, RefusedError):
            raise found
        return found


def check_ground(root: Node, top: dict[str, Node], report: Findings, files: Files) -> Ground:
    """Adds what is wrong with image, size and assets, `top` being the mapping of `root`."""
    ground = Ground()
    _canvas(root, top, ground, report, files)
    _assets(top, ground, report, files)
    return ground


def _canvas(root: Node, top: dict[str, Node], ground: Ground, report: Findings, files: Files) -> None:
    image, size = top.get("image"), top.get("size")
    if image and size:
        report.add(size.key_place, "size", "", "stands beside image", "write only one of the two")
    if image is None and size is None:
        fix = "write image: photo.png, or size: [512, 512] for a scene without a photo"
        report.add(root.place, "image", "", "missing", fix)
    if image and image not in report.bad:
        assert isinstance(image.value, str)
        try:
            path = confined(image.value, image.source.folder, image.source.folder, files.allow_outside)
            ground.size = files.size(path)
            ground.image = path
        except RefusedError as error:
            report.add(image.place, "image", shown(image.value), error.expected, error.fix)
    elif size and size not in report.bad:
        width, height = whole(size)
        if width * height > MOST_PIXELS:
            text = f"{width} x {height}"
            report.add(
                size.place, "size", text, "is more than 100 megapixels", "make it smaller, e.g. [512, 512]"
            )
        else:
            ground.size = (width, height)


def _assets(top: dict[str, Node], ground: Ground, report: Findings, files: Files) -> None:
    assets = top.get("assets")
    if assets is None or assets in report.bad:
        return
    assert isinstance(assets.value, str)
    home = assets.source.folder

    def refuse(found: str, error: RefusedError) -> None:
        report.add(assets.place, "assets", found, error.expected, error.fix)

    try:
        folder = confined(assets.value, home, home, files.allow_outside)
    except RefusedError as error:
        return refuse(shown(assets.value), error)
    if files.assets is not None:
        folder = home = files.assets
    if not folder.is_dir():
        return refuse(shown(assets.value), RefusedError("is not a folder", "write the folder of masks.png"))
    ground.assets = folder
    for name in MAPS:
        file = f"{name}.png"
        if not os.path.lexists(folder / file):
            continue
        try:
            size = files.size(confined(file, folder, home, files.allow_outside))
        except RefusedError as error:
            refuse(quoted(f"{assets.value}/{file}"), error)
            continue
        if ground.size and size != ground.size:
            odd = RefusedError(
                f"is {size[0]} x {size[1]}, the canvas {ground.size[0]} x {ground.size[1]}",
                "make them the same size",
            )
            refuse(quoted(f"{assets.value}/{file}"), odd)
    return None


# ----------------------------------------------------------------------
# Masks of objects and boundaries -> Problems: an id that two share or no map holds, runs that miss the
# canvas.


def check_masks(root: Node, ground: Ground, report: Findings) -> None:
    """Adds ids that two use or that have no masks.png to be found in, and run lengths that do not fill the canvas."""
    owner: dict[int, str] = {}
    has_masks = ground.assets is not None and (ground.assets / "masks.png").is_file()
    top = children(root)
    told = "assets" in top and ground.assets is None
    things = (
        (section, name, node)
        for section in ("objects", "boundaries")
        for name, node in children(root, section).items()
    )
    for section, name, node in things:
        mask = children(node).get("mask")
        if mask is None or mask in report.bad:
            continue
        path: KeyPath = (section, name, "mask")
        if isinstance(mask.value, int | float):
            number_ = int(mask.value)
            if number_ in owner:
                expected = f"is the mask of {owner[number_]} already"
                report.add(mask.place, path, shown(number_), expected, "give each an id of its own")
            owner.setdefault(number_, name if section == "objects" else f"boundary {name}")
            if not has_masks and not told:
                told = True
                if ground.assets is None:
                    fix = "write assets: and the folder of masks.png, or mask: {polygon: [[x, y], ...]}"
                    what = "is an id, but the scene names no assets"
                    report.add(mask.place, path, shown(number_), what, fix)
                else:
                    place = top["assets"]
                    report.add(place.place, "assets", shown(place.value), "has no masks.png", "put it there")
        elif "rle" in children(mask) and ground.size:
            _rle(children(mask)["rle"], (*path, "rle"), ground.size, report)


def _rle(node: Node, path: KeyPath, canvas: tuple[int, int], report: Findings) -> None:
    size, counts = children(node)["size"], children(node)["counts"]
    height, width = whole(size)
    if (width, height) != canvas:
        expected = f"is not the canvas's height and width, [{canvas[1]}, {canvas[0]}]"
        fix = "write the mask at the photo's size"
        report.add(size.place, (*path, "size"), f"[{height}, {width}]", expected, fix)
        return
    total = sum(whole(counts))
    if total != width * height:
        expected = f"add up to {total}, not to {width * height} pixels"
        fix = "write runs that fill the mask, background first"
        report.add(counts.place, (*path, "counts"), "", expected, fix)


# ----------------------------------------------------------------------
# `refine:` of a tree -> Problems: a backend that nobody knows, and a strength that leaves no step to run.

PATH = ("refine",)


def check_refine(root: Node, report: Findings) -> None:
    """Adds what is wrong in `refine`; nothing is imported to look a backend up."""
    node = children(root).get("refine")
    parts = {key: part for key, part in children(node).items() if part not in report.bad}
    backend = parts.get("backend")
    if backend is None or backend.value == "none":
        return
    known = registry.names("refine")
    if backend.value not in known:
        close = nearest(str(backend.value), known)
        fix = (f"did you mean {close}? " if close else "") + f"choose {listed(known)}"
        report.value(backend, (*PATH, "backend"), "is no backend that refines", fix)
    values = {
        key: parts[key].value if key in parts else at(f"refine.{key}")["default"]
        for key in ("steps", "strength")
    }
    steps, strength = values["steps"], values["strength"]
    if isinstance(steps, int) and isinstance(strength, int | float) and steps * strength < 0.5:
        least = ceil(50 / steps) / 100
        guilty = "strength" if "strength" in parts else "steps"
        place = parts[guilty].place if guilty in parts else backend.place
        what = f"leaves none of {shown(steps)} steps to run"
        fix = f"write at least {number(least)}, or backend: none"
        report.add(place, (*PATH, "strength"), shown(strength), what, fix)


# ----------------------------------------------------------------------
# Tree that keeps to the schema -> Problems between its keys, and the canvas and files that it stands on.


def check_rules(root: Node, report: Findings, files: Files) -> Ground:
    """Adds what is wrong between keys; values in which the schema found problems are left out."""
    top = children(root)
    ground = check_ground(root, top, report, files)
    for name, node in children(root, "objects").items():
        if isinstance(node.value, dict) and node not in report.ruled:
            report.ruled.add(node)
            _object(name, node, root, report)
    check_masks(root, ground, report)
    for name, node in children(root, "boundaries").items():
        if isinstance(node.value, dict) and node not in report.ruled:
            report.ruled.add(node)
            _boundary(node, ("boundaries", name), report)
    check_forces(root, report)
    check_joints(root, report)
    check_film(root, ground.size, report)
    check_refine(root, report)
    _light_and_maps(root, report)
    return ground


# Objects


def _object(name: str, node: Node, root: Node, report: Findings) -> None:
    path: KeyPath = ("objects", name)
    parts = children(node)
    mask, shape = parts.get("mask"), parts.get("shape")
    if "mass" in parts and "density" in parts:
        place = parts["density"].key_place
        report.add(place, (*path, "density"), "", "stands beside mass", "write only one of the two")
    if mask is None and (shape is None or shape.value == "auto"):
        fix = "write mask: 1, or shape: {circle: {center: [470.5, 257.0], radius: 30.2}}"
        close = nearest(name, (other for other in children(root, "objects") if other != name))
        if close and shape is None and len(parts) < 3:
            fix += f"; or did you mean {quoted(close)}?"
        what = "has neither mask nor shape" if shape is None else "has a shape to fit, but no mask"
        report.add(node.place, path, "", what, fix)
    good = {key: part for key, part in parts.items() if part not in report.bad}
    kinds = children(good.get("shape"))
    solid = good.get("solid")
    if solid is not None and kinds and "circle" not in kinds and solid.value != "plate":
        kind = next(iter(kinds))
        what = f"does not go with a {kind}"
        report.add(solid.place, (*path, "solid"), shown(solid.value), what, "write plate")
    for where, outline, crossing in _outlines(good.get("mask"), kinds):
        _outline(outline, (*path, *where), crossing, report)
    _holes(kinds, path, report)
    knots = children(good.get("motion")).get("path")
    if knots is not None:
        _knots(knots, (*path, "motion", "path"), report)


def _outline(node: Node, path: KeyPath, crossing: bool, report: Findings) -> None:
    if node in report.ruled:
        return
    report.ruled.add(node)
    problem = outline_problem(_points(node), crossing)
    if problem:
        report.add(node.place, path, "", *problem)


def _outlines(mask: Node | None, kinds: dict[str, Node]) -> Iterator[tuple[KeyPath, Node, bool]]:
    """Every outline of an object or a boundary, where it stands, and whether it may not cross itself."""
    if "polygon" in children(mask):
        yield ("mask", "polygon"), children(mask)["polygon"], False
    if "polygon" in kinds:
        yield ("shape", "polygon"), kinds["polygon"], True
    for index, piece in enumerate(items(kinds.get("polygons"))):
        where: KeyPath = ("shape", "polygons", index)
        yield (*where, "outline"), children(piece)["outline"], True
        for hole, node in enumerate(items(children(piece).get("holes"))):
            yield (*where, "holes", hole), node, True


def _holes(kinds: dict[str, Node], path: KeyPath, report: Findings) -> None:
    for index, piece in enumerate(items(kinds.get("polygons"))):
        outer = _points(children(piece)["outline"])
        box = [(min(c), max(c)) for c in zip(*outer, strict=True)]
        for hole, node in enumerate(items(children(piece).get("holes"))):
            for (low, high), side in zip(box, zip(*_points(node), strict=True), strict=True):
                if min(side) < low or max(side) > high:
                    where: KeyPath = (*path, "shape", "polygons", index, "holes", hole)
                    report.add(node.place, where, "", "leads out of its outline", "keep holes inside")
                    break


def _points(node: Node) -> list[tuple[float, float]]:
    rows: Any = node.value
    return [(point.value[0].value, point.value[1].value) for point in rows]


def _knots(node: Node, path: KeyPath, report: Findings) -> None:
    before: Any = None
    for index, knot in enumerate(items(node)):
        time = items(knot)[0]
        where: KeyPath = (*path, index, 0)
        now: Any = time.value
        if before is None and now != 0:
            report.add(time.place, where, shown(now), "is not 0", "start the path at time 0")
            return
        if before is not None and now <= before:
            expected = f"is not after {number(before)}"
            report.add(time.place, where, shown(now), expected, "write knots with rising times")
            return
        before = now


# Boundaries and the rest


def _boundary(node: Node, path: KeyPath, report: Findings) -> None:
    parts = children(node)
    given = [key for key in ("segment", "polyline", "mask") if key in parts]
    if len(given) != 1:
        has = f"has {listed(given, 'and')}" if given else "has no line"
        fix = "write only one of them" if given else "write segment: [[0, 457], [512, 457]], polyline or mask"
        report.add(node.place, path, "", has, fix)
        return
    if parts[given[0]] in report.bad:
        return
    if given == ["mask"]:
        for part, outline, crossing in _outlines(parts["mask"], {}):
            _outline(outline, (*path, *part), crossing, report)
        return
    points = _points(parts[given[0]])
    for index in range(1, len(points)):
        if same_point(points[index - 1], points[index]):
            item = items(parts[given[0]])[index]
            where: KeyPath = (*path, given[0], index)
            report.add(item.place, where, "", "is the point before it again", "move or drop it")
            return


def _light_and_maps(root: Node, report: Findings) -> None:
    direction = children(root, "light").get("direction")
    usable = direction is not None and direction not in report.bad
    if direction and usable and not any(item.value for item in items(direction)):
        report.add(direction.place, "light.direction", "", "has no length", advice(at("light.direction")))
    for name, node in children(root, "maps").items():
        if node in report.bad:
            continue
        low, high = (item.value for item in items(node))
        if low >= high:  # type: ignore[operator]
            found = f"[{shown(low)}, {shown(high)}]"
            report.add(node.place, ("maps", name), found, "does not rise", "write the smaller number first")
