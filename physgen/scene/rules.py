"""Tree that keeps to the schema -> Problems between its keys, and the canvas and files that it stands on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from physgen.scene.advice import advice
from physgen.scene.ground import Files, Ground, check_ground
from physgen.scene.node import Node, children, items, whole
from physgen.scene.outlines import outline_problem, same_point
from physgen.scene.report import Report
from physgen.scene.schema import at
from physgen.scene.words import Path, listed, nearest, number, quoted, shown


def check_rules(root: Node, report: Report, files: Files) -> Ground:
    """Adds what is wrong between keys; values in which the schema found problems are left out."""
    top = children(root)
    ground = check_ground(root, top, report, files)
    for name, node in children(root, "objects").items():
        if isinstance(node.value, dict) and node not in report.ruled:
            report.ruled.add(node)
            _object(name, node, root, report)
    _masks(root, ground, report)
    for name, node in children(root, "boundaries").items():
        if isinstance(node.value, dict) and node not in report.ruled:
            report.ruled.add(node)
            _boundary(node, ("boundaries", name), report)
    _forces(root, report)
    _light_and_maps(root, report)
    return ground


# Objects


def _object(name: str, node: Node, root: Node, report: Report) -> None:
    path: Path = ("objects", name)
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
        if outline in report.ruled:
            continue
        report.ruled.add(outline)
        problem = outline_problem(_points(outline), crossing)
        if problem:
            report.add(outline.place, (*path, *where), "", *problem)
    _holes(kinds, path, report)
    knots = children(good.get("motion")).get("path")
    if knots is not None:
        _knots(knots, (*path, "motion", "path"), report)


def _outlines(mask: Node | None, kinds: dict[str, Node]) -> Iterator[tuple[Path, Node, bool]]:
    """Every outline of an object, where it stands, and whether it may not cross itself."""
    if "polygon" in children(mask):
        yield ("mask", "polygon"), children(mask)["polygon"], False
    if "polygon" in kinds:
        yield ("shape", "polygon"), kinds["polygon"], True
    for index, piece in enumerate(items(kinds.get("polygons"))):
        where: Path = ("shape", "polygons", index)
        yield (*where, "outline"), children(piece)["outline"], True
        for hole, node in enumerate(items(children(piece).get("holes"))):
            yield (*where, "holes", hole), node, True


def _holes(kinds: dict[str, Node], path: Path, report: Report) -> None:
    for index, piece in enumerate(items(kinds.get("polygons"))):
        outer = _points(children(piece)["outline"])
        box = [(min(c), max(c)) for c in zip(*outer, strict=True)]
        for hole, node in enumerate(items(children(piece).get("holes"))):
            for (low, high), side in zip(box, zip(*_points(node), strict=True), strict=True):
                if min(side) < low or max(side) > high:
                    where: Path = (*path, "shape", "polygons", index, "holes", hole)
                    report.add(node.place, where, "", "leads out of its outline", "keep holes inside")
                    break


def _points(node: Node) -> list[tuple[float, float]]:
    rows: Any = node.value
    return [(point.value[0].value, point.value[1].value) for point in rows]


def _knots(node: Node, path: Path, report: Report) -> None:
    before: Any = None
    for index, knot in enumerate(items(node)):
        time = items(knot)[0]
        where: Path = (*path, index, 0)
        now: Any = time.value
        if before is None and now != 0:
            report.add(time.place, where, shown(now), "is not 0", "start the path at time 0")
            return
        if before is not None and now <= before:
            expected = f"is not after {number(before)}"
            report.add(time.place, where, shown(now), expected, "write knots with rising times")
            return
        before = now


def _masks(root: Node, ground: Ground, report: Report) -> None:
    """Mask ids are used once and have a masks.png to be found in; run lengths fill the canvas."""
    owner: dict[int, str] = {}
    has_masks = ground.assets is not None and (ground.assets / "masks.png").is_file()
    top = children(root)
    told = "assets" in top and ground.assets is None
    for name, node in children(root, "objects").items():
        mask = children(node).get("mask")
        if mask is None or mask in report.bad:
            continue
        path: Path = ("objects", name, "mask")
        if isinstance(mask.value, int | float):
            number_ = int(mask.value)
            if number_ in owner:
                expected = f"is the mask of {owner[number_]} already"
                report.add(mask.place, path, shown(number_), expected, "give each object an id of its own")
            owner.setdefault(number_, name)
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


def _rle(node: Node, path: Path, canvas: tuple[int, int], report: Report) -> None:
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


# Boundaries, forces and the rest


def _boundary(node: Node, path: Path, report: Report) -> None:
    parts = children(node)
    given = [key for key in ("segment", "polyline") if key in parts]
    if len(given) != 1:
        has = "has both segment and polyline" if given else "has no line"
        fix = "write only one of the two" if given else "write segment: [[0, 457], [512, 457]], or polyline"
        report.add(node.place, path, "", has, fix)
        return
    if parts[given[0]] in report.bad:
        return
    points = _points(parts[given[0]])
    for index in range(1, len(points)):
        if same_point(points[index - 1], points[index]):
            item = items(parts[given[0]])[index]
            where: Path = (*path, given[0], index)
            report.add(item.place, where, "", "is the point before it again", "move or drop it")
            return


def _forces(root: Node, report: Report) -> None:
    forces = children(root).get("forces")
    if forces is None:
        return
    names = children(root, "objects")
    loads = ("impulse", "force", "torque")
    for index, node in enumerate(items(forces)):
        if not isinstance(node.value, dict):
            continue
        path: Path = ("forces", index)
        parts = children(node)
        target = parts.get("object")
        if target is not None and target not in report.bad and str(target.value) not in names:
            close = nearest(str(target.value), names)
            fix = f"did you mean {quoted(close)}?" if close else f"write one of {listed(list(names)[:30])}"
            if not names:
                fix = "write it under objects first"
            what = "is not an object of this scene"
            report.add(target.place, (*path, "object"), shown(target.value), what, fix)
        given = [key for key in loads if key in parts]
        if len(given) != 1:
            has = f"has {listed(given, 'and')}" if given else "has no impulse, force or torque"
            report.add(node.place, path, "", has, "write exactly one of impulse, force and torque")
            continue
        senseless = {"torque": "at", "impulse": "duration"}.get(given[0])
        if senseless in parts:
            why = "a torque turns the body as a whole" if senseless == "at" else "an impulse is given at once"
            place = parts[senseless].key_place
            report.add(place, (*path, senseless), "", f"has no meaning here: {why}", "take it out")


def _light_and_maps(root: Node, report: Report) -> None:
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
