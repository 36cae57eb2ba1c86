"""Rules of the shapes and paths of objects and boundaries."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
import shapely

from physgen.messages import Message
from physgen.problems import Limit, RefusedError
from physgen.scene.checked_tree import (
    CheckedTree,
    check_rising,
    number_of,
    points_of,
)
from physgen.scene.document import Node, children, items
from physgen.scene.element_rules import SAME_POINT
from physgen.scene.schema import find_schema_part
from physgen.text import KeyPath, dotted, listed, nearest, quoted, shown

LEAST_AREA = 0.01
"""Minimum area of an outline, px²: a box of the schema's smallest size. The engine
drops smaller pieces.
"""

LONGEST_EXTENT = 20
"""Maximum extent of a body, in longer sides of the photo. A larger one covers the
photo, and its collisions take minutes.
"""

BLOCK = 16
"""Number of lines compared with all others at a time. It bounds the memory if all lines
are near each other.
"""

REMEMBERED = 1000
"""Number of cached outlines with known crossings: variants share them."""

Corner = tuple[float, float]


def check_object(tree: CheckedTree, name: str, node: Node) -> None:
    """Report faults of the mask, shape and motion of an object."""
    path: KeyPath = ("objects", name)
    parts = children(node)
    valid_keys = tree.valid_keys(node)
    if "mass" in parts and "density" in parts:
        place = parts["density"].key_place
        density_path: KeyPath = (*path, "density")
        tree.report(Message.EXCLUDES.problem(place, density_path, other="mass"))
    if _lacks_shape(parts, valid_keys):
        _report_no_shape(tree, name, node)
    # Faults of an outline, of areas and of holes are reported together, so that the
    # user can correct all at once.
    kinds = children(valid_keys.get("shape"))
    _check_solid(tree, valid_keys.get("solid"), kinds, path)
    for outline_path, outline, crossing in outlines_of(valid_keys.get("mask"), kinds):
        check_outline(tree, outline, (*path, *outline_path), crossing)
    _check_areas(tree, kinds, path)
    # Static and scripted objects may be as large as a landscape.
    if "motion" not in parts:
        _check_extents(tree, kinds, path)
    _check_holes(tree, kinds, path)
    motion = children(valid_keys.get("motion"))
    check_rising(tree, items(motion.get("path")), (*path, "motion", "path"))
    _check_loop(tree, motion, (*path, "motion"))


def _lacks_shape(parts: dict[str, Node], valid_keys: dict[str, Node]) -> bool:
    """Return whether an object has neither mask nor shape, and no fault explains it."""
    shape = parts.get("shape")
    if "mask" in parts:
        return False
    if shape is not None:
        # `shape: outline` needs a mask, as no shape does.
        return "shape" in valid_keys and isinstance(shape.value, str)
    # `circle:` directly in the object is reported as unknown already.
    kinds_of_shape = find_schema_part("objects.*.shape")["properties"]
    return not any(key in kinds_of_shape for key in parts)


def _report_no_shape(tree: CheckedTree, name: str, node: Node) -> None:
    """Report an object without mask and shape; its name may be a misspelt one."""
    parts = children(node)
    fix = "write mask: 1, or shape: {circle: {center: [470.5, 257.0], radius: 30.2}}"
    message = Message.NO_MASK_FOR_SHAPE
    if "shape" not in parts:
        message = Message.NO_MASK_NOR_SHAPE
        close = nearest(name, (other for other in tree.objects if other != name))
        if close and len(parts) < 3:
            fix += f"; or did you mean {quoted(close)}?"
    tree.report(message.problem(node.place, ("objects", name), fix=fix))


def _check_solid(
    tree: CheckedTree, node: Node | None, kinds: dict[str, Node], path: KeyPath
) -> None:
    """Report a round solid without a circle as its shape."""
    if node is None or not kinds or "circle" in kinds or node.value == "plate":
        return
    solid_path: KeyPath = (*path, "solid")
    kind = next(iter(kinds))
    message = Message.SOLID_NEEDS_CIRCLE
    tree.report(message.problem(node.place, solid_path, shown(node.value), kind=kind))


def check_outline(tree: CheckedTree, node: Node, path: KeyPath, crossing: bool) -> None:
    """Report an outline that is not a simple polygon. `crossing` tells whether crossing
    lines are a fault.
    """
    refusal = outline_fault(points_of(node), crossing)
    if refusal is not None:
        tree.report(refusal.problem(node.place, dotted(path)))


def _check_areas(tree: CheckedTree, kinds: dict[str, Node], path: KeyPath) -> None:
    """Report outlines too small to simulate."""
    for outline_path, node, crossing in outlines_of(None, kinds):
        points = points_of(node)
        area = abs(_signed_area(points))
        # Only the area of a body matters to the engine, and not that of a hole.
        if "holes" in outline_path or area >= LEAST_AREA:
            continue
        if outline_fault(points, crossing) is not None:
            continue
        problem = Message.OUTLINE_SMALL.problem(
            node.place, (*path, *outline_path), area=area, least=LEAST_AREA
        )
        tree.report(problem)


def _check_extents(tree: CheckedTree, kinds: dict[str, Node], path: KeyPath) -> None:
    """Report a shape far larger than the photo."""
    if tree.ground.size is None:
        return
    longest = LONGEST_EXTENT * max(tree.ground.size)
    for kind, node in kinds.items():
        extent = _extent(tree, kind, node)
        if extent <= longest:
            continue
        problem = Message.SHAPE_HUGE.problem(
            node.place,
            (*path, "shape", kind),
            extent=extent,
            longest=longest,
            times=LONGEST_EXTENT,
        )
        tree.report(problem)


def _extent(tree: CheckedTree, kind: str, node: Node) -> float:
    """Return the length of a shape, px, or 0 for invalid numbers."""
    parts = children(node)
    if kind == "circle" and "radius" in parts:
        return 2.0 * number_of(parts["radius"])
    if kind == "box" and "size" in parts:
        return max(map(number_of, items(parts["size"])))
    sides = []
    for _, outline, crossing in outlines_of(None, {kind: node}):
        points = points_of(outline)
        if outline_fault(points, crossing) is not None:
            # It has its own problem.
            return 0.0
        sides += [max(axis) - min(axis) for axis in zip(*points, strict=True)]
    return max(sides, default=0.0)


def _check_holes(tree: CheckedTree, kinds: dict[str, Node], path: KeyPath) -> None:
    for index, piece in enumerate(items(kinds.get("polygons"))):
        outer = points_of(children(piece)["outline"])
        # The bounding box is enough to find a hole in wrong coordinates.
        box = [(min(c), max(c)) for c in zip(*outer, strict=True)]
        for hole, node in enumerate(items(children(piece).get("holes"))):
            sides = zip(*points_of(node), strict=True)
            if any(
                min(side) < low or max(side) > high
                for (low, high), side in zip(box, sides, strict=True)
            ):
                hole_path: KeyPath = (
                    *path,
                    "shape",
                    "polygons",
                    index,
                    "holes",
                    hole,
                )
                tree.report(Message.HOLE_OUTSIDE.problem(node.place, hole_path))


def _check_loop(tree: CheckedTree, motion: dict[str, Node], path: KeyPath) -> None:
    """Report a repeated path with different ends."""
    knots = items(motion.get("path"))
    if "loop" not in motion or motion["loop"].value is not True or not knots:
        return
    first = items(knots[0])
    last = items(knots[-1])
    # Knots are (time, x, y): only the positions must agree.
    if any(number_of(first[k]) != number_of(last[k]) for k in (1, 2)):
        problem = Message.LOOP_OPEN.problem(
            knots[-1].place,
            (*path, "path"),
            "the path",
            time=number_of(last[0]),
            x=number_of(first[1]),
            y=number_of(first[2]),
        )
        tree.report(problem)


def check_boundary(tree: CheckedTree, node: Node, path: KeyPath) -> None:
    """Report faults of the line of a boundary. It must have exactly one."""
    parts = children(node)
    kinds = ("segment", "polyline", "arc", "bezier", "shape", "mask")
    given_kinds = []
    for key in kinds:
        if key in parts:
            given_kinds.append(key)
    if not given_kinds:
        tree.report(Message.NO_LINE.problem(node.place, path))
        return
    if len(given_kinds) > 1:
        keys = listed(given_kinds, "and")
        tree.report(Message.SEVERAL_LINES.problem(node.place, path, keys=keys))
        return
    line = tree.valid_keys(node).get(given_kinds[0])
    if line is not None:
        _check_line(tree, given_kinds[0], line, path)


def _check_line(tree: CheckedTree, kind: str, line: Node, path: KeyPath) -> None:
    """Report faults of the only line of a boundary."""
    if kind == "arc":
        _check_arc(tree, children(line), path)
        return
    # Each cubic curve has three points after the common one: 3 n + 1 points.
    if kind == "bezier" and len(items(line)) % 3 != 1:
        key: KeyPath = (*path, "bezier")
        count = len(items(line))
        tree.report(Message.CURVE_POINTS.problem(line.place, key, count=count))
        return
    if kind == "shape":
        shapes = children(line)
        for part, outline, crossing in outlines_of(None, shapes):
            check_outline(tree, outline, (*path, *part), crossing)
        _check_areas(tree, shapes, path)
        return
    if kind == "mask":
        for part, outline, crossing in outlines_of(line, {}):
            check_outline(tree, outline, (*path, *part), crossing)
        return
    _check_distinct_points(tree, line, (*path, kind))


def _check_distinct_points(tree: CheckedTree, line: Node, path: KeyPath) -> None:
    """Report the first point equal to the previous one."""
    for index, (before, point) in enumerate(pairwise(points_of(line)), start=1):
        distance = max(abs(a - b) for a, b in zip(before, point, strict=True))
        if distance < SAME_POINT:
            place = items(line)[index].place
            tree.report(Message.POINT_REPEATED.problem(place, (*path, index)))
            return


def _check_arc(tree: CheckedTree, parts: dict[str, Node], path: KeyPath) -> None:
    """Report an arc without length, or with more than one turn."""
    begin, end = (
        number_of(parts[key]) if key in parts else default
        for key, default in (("from", 0.0), ("to", 360.0))
    )
    if begin == end or abs(end - begin) > 360:
        fault = "goes round more than once"
        if begin == end:
            fault = "has no length"
        place = parts[next(iter(parts))].place
        key: KeyPath = (*path, "arc")
        problem = Message.ARC_ANGLES.problem(place, key, "the arc", fault=fault)
        tree.report(problem)


def outlines_of(
    mask: Node | None, kinds: dict[str, Node]
) -> Iterator[tuple[KeyPath, Node, bool]]:
    """Yield every outline of an object or a boundary, its path, and whether crossing
    lines are a fault.
    """
    if "polygon" in children(mask):
        yield ("mask", "polygon"), children(mask)["polygon"], False
    if "polygon" in kinds:
        yield ("shape", "polygon"), kinds["polygon"], True
    for index, piece in enumerate(items(kinds.get("polygons"))):
        where: KeyPath = ("shape", "polygons", index)
        yield (*where, "outline"), children(piece)["outline"], True
        for hole, node in enumerate(items(children(piece).get("holes"))):
            yield (*where, "holes", hole), node, True


def outline_fault(points: Sequence[Corner], crossing: bool) -> RefusedError | None:
    """Return the fault of an outline, or None for a valid one. `crossing` tells whether
    crossing lines are a fault.

    Only proper crossings are refused. An outline may touch itself, as contours of masks
    do.
    """
    xs = [x for x, _ in points]
    ys = [y for _, y in points]
    extent = (max(xs) - min(xs)) * (max(ys) - min(ys))
    # All points are on one horizontal or vertical line.
    if extent == 0:
        return Message.OUTLINE_FLAT.refusal()
    if crossing:
        pair = _crossing(tuple(points))
        if pair == (-1, -1):
            return Limit.CROSSINGS.refusal()
        if pair is not None:
            return Message.OUTLINE_CROSSES.refusal(first=pair[0], second=pair[1])
    # The tolerance is relative to the box, so that small outlines count.
    is_flat = abs(_signed_area(points)) < 1e-12 * extent
    # The outline of a mask may cross itself, and its signed areas may then cancel.
    if is_flat and (crossing or len(points) < 4):
        return Message.OUTLINE_FLAT.refusal()
    return None


def _signed_area(points: Sequence[Corner]) -> float:
    """Return the area of an outline, px², positive if it turns +x towards +y."""
    # Coordinates relative to the first point keep the digits of a small, distant
    # outline.
    x0, y0 = points[0]
    xs = [x - x0 for x, _ in points]
    ys = [y - y0 for _, y in points]
    return sum(xs[i - 1] * ys[i] - xs[i] * ys[i - 1] for i in range(len(points))) / 2


@lru_cache(REMEMBERED)
def _crossing(points: tuple[Corner, ...]) -> tuple[int, int] | None:
    """Return the first pair of properly crossing lines, by their first corners; (-1,
    -1) beyond Limit.CROSSINGS.
    """
    corners = np.asarray(points, dtype=float)
    lines = shapely.linestrings(
        np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    )
    # The tree finds candidates in n log n instead of n².
    tree = shapely.STRtree(lines)
    compared = 0
    for start in range(0, len(lines), BLOCK):
        first, second = tree.query(lines[start : start + BLOCK])
        # The query counts from the start of the block.
        first += start
        compared += len(first)
        if compared > Limit.CROSSINGS.most:
            return (-1, -1)
        hits = (second > first) & shapely.crosses(lines[first], lines[second])
        if hits.any():
            return min(zip(first[hits].tolist(), second[hits].tolist(), strict=True))
    return None
