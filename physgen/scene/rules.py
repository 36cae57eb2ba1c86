"""Tree that keeps to the schema -> Problems between its keys, and the canvas and files that it stands on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from physgen.scene.advice import advice
from physgen.scene.film import check_film
from physgen.scene.ground import Files, Ground, check_ground
from physgen.scene.joints import check_forces, check_joints
from physgen.scene.node import Node, children, items
from physgen.scene.outlines import outline_problem, same_point
from physgen.scene.owners import check_masks
from physgen.scene.refinement import check_refine
from physgen.scene.report import Report
from physgen.scene.schema import at
from physgen.scene.words import KeyPath, listed, nearest, number, quoted, shown


def check_rules(root: Node, report: Report, files: Files) -> Ground:
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


def _object(name: str, node: Node, root: Node, report: Report) -> None:
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


def _outline(node: Node, path: KeyPath, crossing: bool, report: Report) -> None:
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


def _holes(kinds: dict[str, Node], path: KeyPath, report: Report) -> None:
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


def _knots(node: Node, path: KeyPath, report: Report) -> None:
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


def _boundary(node: Node, path: KeyPath, report: Report) -> None:
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
