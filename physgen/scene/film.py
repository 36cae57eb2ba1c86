"""`render:` of a tree -> Problems between its keys: rivals, the video's size, and where the camera looks."""

from __future__ import annotations

from collections.abc import Iterator
from math import floor, sqrt
from typing import Any

from physgen.framing import Size, video_size
from physgen.pictures import MOST_PIXELS
from physgen.scene.joints import check_name
from physgen.scene.node import Node, children, items, whole
from physgen.scene.report import Report
from physgen.scene.schema import Schema, at
from physgen.scene.words import KeyPath, number, shown


def check_film(root: Node, photo: Size | None, report: Report) -> None:
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


def _rivals(node: Node, path: KeyPath, schema: Schema, report: Report) -> None:
    """Keys that rule each other out."""
    parts = children(node)
    for group in schema["x-exclusive"]:
        first, *rest = [key for key in group if key in parts] or [""]
        for key in rest:
            place = parts[key].key_place
            report.add(place, (*path, key), "", f"stands beside {first}", "write only one of the two")


def _size(parts: dict[str, Node], photo: Size, report: Report) -> None:
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


def _later(node: Node, path: KeyPath, before: Any, report: Report) -> Any:
    """The time of a view, which is after the one `before`."""
    now: Any = node.value
    if before is not None and now <= before:
        expected = f"is not after {number(before)}"
        report.add(node.place, path, shown(now), expected, "write views with rising times")
    return now


def _inside(node: Node, path: KeyPath, photo: Size, report: Report) -> None:
    x, y = (item.value for item in items(node))
    if not all(-0.5 <= c <= side - 0.5 for c, side in zip((x, y), photo, strict=True)):  # type: ignore[operator]
        expected = f"is beside the photo, which is {photo[0]} x {photo[1]}"
        fix = f"write a point in it, e.g. [{photo[0] // 2}, {photo[1] // 2}]"
        report.add(node.place, path, f"[{shown(x)}, {shown(y)}]", expected, fix)
