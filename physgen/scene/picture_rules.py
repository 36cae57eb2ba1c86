"""Rules of the video: size, cameras, refinement, light and the ranges of maps."""

from __future__ import annotations

from math import ceil, floor, sqrt
from typing import Any

from physgen import registry
from physgen.messages import Message
from physgen.problems import Limit
from physgen.scene.checked_tree import (
    CheckedTree,
    check_object_name,
    point_of,
    report_pixel_count,
    report_time_order,
)
from physgen.scene.document import Node, children, items, read_integers
from physgen.scene.framing import video_size
from physgen.scene.schema import advice, find_schema_part
from physgen.text import KeyPath, number, shown


def check_render(
    tree: CheckedTree,
) -> None:
    """Report faults of `render`: exclusive keys, the size, and the cameras."""
    node = tree.top.get("render")
    if node is None:
        return
    _check_exclusive(tree, node, ("render",), "render")
    _check_video_size(tree, tree.valid_keys(node))
    camera = children(node).get("camera")
    if camera is None:
        return
    if not isinstance(camera.value, list):
        _check_view(tree, camera, ("render", "camera"))
        return
    before: Any = None
    for index, view in enumerate(items(camera)):
        path: KeyPath = ("render", "camera", index)
        _check_view(tree, view, path)
        # Times of views must rise, as times of knots.
        time = tree.valid_keys(view).get("time")
        if time is not None:
            value: Any = time.value
            if before is not None and value <= before:
                report_time_order(tree, time, (*path, "time"), before, "views")
            before = value


def _check_view(tree: CheckedTree, view: Node, path: KeyPath) -> None:
    """Report faults of one view of the camera, except of its time."""
    _check_exclusive(tree, view, path, "render.camera")
    valid_keys = tree.valid_keys(view)
    if "follow" in valid_keys:
        check_object_name(tree, valid_keys["follow"], (*path, "follow"))
    if "center" in valid_keys and tree.ground.size is not None:
        _check_in_photo(tree, valid_keys["center"], (*path, "center"), tree.ground.size)


def _check_exclusive(
    tree: CheckedTree, node: Node, path: KeyPath, schema_path: str
) -> None:
    """Report exclusive keys of one mapping."""
    parts = children(node)
    for group in find_schema_part(schema_path)["x-exclusive"]:
        first, *rest = [key for key in group if key in parts] or [""]
        for key in rest:
            place = parts[key].key_place
            tree.report(Message.EXCLUDES.problem(place, (*path, key), other=first))


def _check_video_size(tree: CheckedTree, valid_keys: dict[str, Node]) -> None:
    """Report a video with more pixels than a photo may have."""
    scale = valid_keys.get("scale")
    size = valid_keys.get("size")
    photo = tree.ground.size
    if photo is None:
        return
    if size is not None:
        width, height = read_integers(size)
        if width * height > Limit.PIXELS.most:
            report_pixel_count(tree, size, "render.size", "[832, 480]")
    if scale is not None:
        factor: Any = scale.value
        width, height = video_size(photo, factor, None)
        if width * height > Limit.PIXELS.most:
            # Suggest the largest allowed scale, rounded down to two digits.
            most = floor(sqrt(Limit.PIXELS.most / (photo[0] * photo[1])) * 100) / 100
            problem = Message.VIDEO_TOO_LARGE.problem(
                scale.place,
                "render.scale",
                shown(factor),
                width=width,
                height=height,
                limit=Limit.PIXELS.expected,
                most=most,
            )
            tree.report(problem)


def _check_in_photo(
    tree: CheckedTree, node: Node, path: KeyPath, photo: tuple[int, int]
) -> None:
    x, y = point_of(node)
    # The photo begins half a pixel before the centre of its first pixel.
    if not all(-0.5 <= c <= side - 0.5 for c, side in zip((x, y), photo, strict=True)):
        width, height = photo
        problem = Message.POINT_OUTSIDE.problem(
            node.place,
            path,
            f"[{shown(x)}, {shown(y)}]",
            width=width,
            height=height,
            x=width // 2,
            y=height // 2,
        )
        tree.report(problem)


def check_refine(
    tree: CheckedTree,
) -> None:
    """Report an unknown backend, and a strength without a step to run."""
    parts = tree.valid_keys(tree.top.get("refine"))
    backend = parts.get("backend")
    if backend is None or backend.value == "none":
        return
    known = registry.names("refine")
    if backend.value not in known:
        fix = registry.suggestion(str(backend.value), known)
        unknown = Message.UNKNOWN_REFINER.refusal(fix=fix)
        tree.findings.value(backend, ("refine", "backend"), unknown)
    # If only one of both keys is written, the default of the other one counts.
    steps, strength = (
        parts[key].value
        if key in parts
        else find_schema_part(f"refine.{key}")["default"]
        for key in ("steps", "strength")
    )
    if (
        isinstance(steps, int)
        and isinstance(strength, int | float)
        and steps * strength < 0.5
    ):
        wrong = parts.get("strength", parts.get("steps", backend))
        # Steps times strength is rounded: from 0.5 on, one step runs. The suggestion is
        # rounded up to two digits.
        problem = Message.NO_STEP.problem(
            wrong.place,
            ("refine", "strength"),
            shown(strength),
            steps=shown(steps),
            least=number(ceil(50 / steps) / 100),
        )
        tree.report(problem)


def check_light(
    tree: CheckedTree,
) -> None:
    """Report a light without a direction."""
    direction = tree.valid_keys(tree.top.get("light")).get("direction")
    if direction is not None and not any(item.value for item in items(direction)):
        fix = advice(find_schema_part("light.direction"))
        zero = Message.DIRECTION_ZERO
        tree.report(zero.problem(direction.place, "light.direction", fix=fix))


def check_map_range(tree: CheckedTree, name: str, node: Node) -> None:
    """Report a range of a map with unordered ends."""
    if node in tree.findings.bad:
        return
    low, high = point_of(node)
    if low >= high:
        found = f"[{shown(low)}, {shown(high)}]"
        tree.report(Message.RANGE_ORDER.problem(node.place, ("maps", name), found))
