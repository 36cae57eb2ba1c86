"""Rules between keys of a scene that JSON Schema cannot express, and checks of the files that it names."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from math import ceil, floor, hypot, sqrt
from pathlib import Path
from typing import Any

from physgen import registry
from physgen.files import Stamp, file_stamp
from physgen.messages import Message, one_of
from physgen.problems import InputError, Limit, RefusedError
from physgen.scene.document import Node, children, items, read_integers, to_plain_data
from physgen.scene.files import (
    ASSETS,
    OUTLINES,
    Record,
    image_size,
    read_scene,
    read_written_record,
    resolve_confined,
    similar,
)
from physgen.scene.scene import MAIN_GROUP, video_size
from physgen.scene.schema import advice, find_schema_part
from physgen.scene.validate import Findings, check_part, misspelt_keys
from physgen.text import KeyPath, dotted, listed, nearest, number, quoted, shown

FORCES = ("impulse", "force", "torque")
KINDS = {
    "joints": (
        "pivot",
        "spring",
        "weld",
        "motor",
        "slider",
        "rope",
        "pulley",
        "gear",
        "finger",
    ),
    "fields": (
        "wind",
        "air",
        "water",
        "attractor",
        "magnet",
        "belt",
        "turntable",
    ),
}
NEEDED = {
    "spring": "stiffness",
    "finger": "stiffness",
    "water": "density",
    "magnet": "pull",
    "motor": "speed",
    "wind": "drag",
    "attractor": "strength",
    "belt": "velocity",
    "turntable": "spin",
}
"""Kind of a joint or field -> the key without which it has no effect."""
OWNER = {
    **dict.fromkeys(("stiffness", "damping"), ("spring", "finger")),
    "length": ("spring", "rope", "pulley"),
    **dict.fromkeys(("speed", "limit"), ("motor",)),
    "limits": ("pivot", "motor"),
    "friction": ("pivot",),
    "breaks": tuple(kind for kind in KINDS["joints"] if kind != "finger"),
    **dict.fromkeys(("drive", "force"), ("slider",)),
    "drag": ("wind", "air", "water"),
    "linear": ("air", "water"),
    "density": ("water",),
    "pull": ("magnet",),
    "strength": ("attractor",),
    "soften": ("attractor", "magnet"),
    "velocity": ("belt",),
    "spin": ("turntable",),
}
"""Key of a joint or field -> the only kinds that it belongs to."""
LEAST_AREA = 0.01
"""px² of an outline: a box of the schema's least size; the engine drops smaller pieces."""
LONGEST_EXTENT = 20
"""Longer sides of the photo: a body that is longer covers the whole photo, and its collisions take minutes."""
MOST_GROUPS = 32
"""Collision groups: the engine has a bit for each."""
SAME_POINT = 1e-9
"""px: to what a float of 10^6 px resolves."""
BLOCK = 16
"""Lines that are compared with all others at a time: bounds the memory where every line is near every other."""

REMEMBERED = 1000
"""Outlines whose crossings are known: variants share theirs."""

Corner = tuple[float, float]


@dataclass
class Ground:
    """The canvas (width, height) px, the photo and the folder of maps."""

    size: tuple[int, int] | None = None
    image: Path | None = None
    assets: Path | None = None
    outlines: dict[int, tuple[int, Any, str | None]] = field(default_factory=dict)
    """Stored shapes by id in masks.png: the CRC of the mask, the shape as plain data, and its `solid`."""
    wholes: dict[int, Any] = field(default_factory=dict)
    """Shapes with their hidden parts, by id in masks.png, as plain data."""
    record: Record = field(default_factory=Record)
    perceived_size: tuple[int, int] | None = None
    """Of the photo that the assets were made of, px, where the photo is another one."""


class Files:
    """Image files that a scene names, read once however many variants are checked, until they are written."""

    def __init__(self, allow_outside: bool) -> None:
        self.allow_outside = allow_outside
        self._sizes: dict[str, tuple[Stamp, tuple[int, int] | RefusedError]] = {}
        self._outlines: dict[str, tuple[Stamp, Node]] = {}

    def size(self, path: Path, written: str) -> tuple[int, int]:
        """Return the width and height of an image, `written` in a scene, from its header; raises RefusedError."""
        key, stamp = str(path), file_stamp(path)
        if key not in self._sizes or self._sizes[key][0] != stamp:
            try:
                self._sizes[key] = stamp, image_size(path, written)
            except RefusedError as error:
                self._sizes[key] = stamp, error
        size = self._sizes[key][1]
        if isinstance(size, RefusedError):
            raise size
        return size

    def outlines(self, path: Path, name: str) -> Node:
        """Return the tree of `outlines.json`; raises InputError."""
        key, stamp = str(path), file_stamp(path)
        if key not in self._outlines or self._outlines[key][0] != stamp:
            self._outlines[key] = stamp, read_scene(path, name)
        return self._outlines[key][1]


RESTORE_ASSETS = "restore the folder of masks.png, or perceive the photo again"
"""What to do about assets that are missing."""
RESTORE_PHOTO = "restore the folder, which holds the photo, or perceive the original"
"""What to do about assets that are missing, and the copy of the photo with them."""


def check_rules(root: Node, findings: Findings, files: Files) -> Ground:
    """Adds what is wrong between keys; values in which the schema found problems are left out."""
    return _Rules(root, findings, files).check()


class _Rules:
    """The rules of one tree."""

    def __init__(self, root: Node, findings: Findings, files: Files) -> None:
        self.root, self.findings, self.files = root, findings, files
        self.top = children(root)
        self.objects = children(root, "objects")
        self.ground = Ground()
        self.map_sizes: dict[str, tuple[int, int]] = {}
        """Width and height of each map, px."""
        self.report = findings.report

    def check(self) -> Ground:
        self.canvas()
        self.assets()
        for name, node in self.objects.items():
            if isinstance(node.value, dict):
                self.object(name, node)
        self.masks()
        for name, node in children(self.root, "boundaries").items():
            if isinstance(node.value, dict):
                self.boundary(node, ("boundaries", name))
        self.groups()
        self.forces()
        for section in KINDS:
            self.joints(section)
        self.render()
        self.refine()
        self.light()
        for name, node in children(self.root, "maps").items():
            self.map_range(name, node)
        return self.ground

    def good(self, node: Node | None) -> dict[str, Node]:
        """Return the keys of a mapping whose values satisfy the schema."""
        return {
            key: part
            for key, part in children(node).items()
            if part not in self.findings.bad
        }

    # The canvas and the files

    def canvas(self) -> None:
        image, size = self.top.get("image"), self.top.get("size")
        if image and size:
            self.report(Message.EXCLUDES.problem(size.key_place, "size", other="image"))
        misspelt = misspelt_keys(self.top, find_schema_part("")["properties"])
        if image is None and size is None and not misspelt & {"image", "size"}:
            self.report(Message.NO_CANVAS.problem(self.root.place, "image"))
        valid_keys = self.good(self.root)
        if image and "image" in valid_keys:
            folder = image.source.folder
            try:
                path = resolve_confined(
                    str(image.value), folder, folder, self.files.allow_outside
                )
                self.ground.size = self.files.size(path, str(image.value))
                self.ground.image = path
            except RefusedError as error:
                if self.is_in_missing_assets(image):
                    return
                self.report(error.problem(image.place, "image", shown(image.value)))
        elif not image and "size" in valid_keys:
            width, height = read_integers(valid_keys["size"])
            if width * height > Limit.PIXELS.most:
                self.too_many_pixels(valid_keys["size"], "size", "[512, 512]")
            else:
                self.ground.size = (width, height)

    def is_in_missing_assets(self, image: Node) -> bool:
        """Return whether the photo was in an assets folder that is not there."""
        assets = self.good(self.root).get("assets")
        if assets is None or not str(image.value).startswith(f"{assets.value}/"):
            return False
        return not os.path.lexists(assets.source.folder / str(assets.value))

    def _is_own_folder(self, node: Node) -> bool:
        """Return whether perception made the assets folder: others are of older scenes."""
        stem = re.escape(Path(node.place.file).stem)
        return re.fullmatch(rf"{stem}(-\d+)?\.assets", str(node.value)) is not None

    def assets(self) -> None:
        node = self.good(self.root).get("assets")
        if node is None:
            return
        home = node.source.folder
        value_text = shown(node.value)
        try:
            folder = resolve_confined(
                str(node.value), home, home, self.files.allow_outside
            )
            if not folder.is_dir():
                image = self.top.get("image")
                is_photo_lost = image is not None and self.is_in_missing_assets(image)
                fix = RESTORE_PHOTO if is_photo_lost else RESTORE_ASSETS
                if not self._is_own_folder(node):
                    fix = similar(str(node.value), folder, ("/",), fix)
                raise Message.ASSETS_NOT_FOLDER.refusal(fix=fix)
        except RefusedError as error:
            self.report(error.problem(node.place, "assets", value_text))
            return
        self.ground.assets = folder
        for file in ASSETS:
            if os.path.lexists(folder / file):
                data = self.outlines if file == OUTLINES else self.record
                use = self.map_file if file.endswith(".png") else data
                try:
                    use(resolve_confined(file, folder, home, self.files.allow_outside))
                except RefusedError as error:
                    value_text = quoted(f"{node.value}/{file}")
                    self.report(error.problem(node.place, "assets", value_text))
        self.check_map_sizes(node)

    def check_map_sizes(self, assets: Node) -> None:
        """Report maps that differ from the photo; once if the photo is another one."""
        canvas, sizes = self.ground.size, set(self.map_sizes.values())
        if canvas is None or sizes <= {canvas}:
            return
        canvas_text = _size_text(canvas)
        image = self.good(self.root).get("image")
        is_perceived = self.ground.record.objects or self.ground.record.world
        if image is not None and is_perceived and len(sizes) == 1:
            (size,) = sizes
            self.ground.perceived_size = size
            problem = Message.PHOTO_CHANGED.problem(
                image.place,
                "image",
                shown(image.value),
                size=canvas_text,
                perceived=_size_text(size),
            )
            self.report(problem)
            return
        for file, size in self.map_sizes.items():
            if size != canvas:
                value_text = quoted(f"{assets.value}/{file}")
                problem = Message.MAP_SIZE.problem(
                    assets.place,
                    "assets",
                    value_text,
                    size=_size_text(size),
                    canvas=canvas_text,
                )
                self.report(problem)

    def outlines(self, path: Path) -> None:
        """Reads the stored shapes; they are checked as those in the file are."""
        name = os.path.join(
            os.path.dirname(self.root.source.name),
            os.path.relpath(path, self.root.source.folder),
        )
        try:
            tree = self.files.outlines(path, name)
        except InputError as error:
            raise Message.OUTLINES_UNREADABLE.refusal(
                reason=error.problems[0]
            ) from None
        for key, entry in children(tree).items():
            crc, shape, solid = (
                children(entry).get(part) for part in ("crc", "shape", "solid")
            )
            if not (
                key.isdecimal()
                and crc is not None
                and type(crc.value) is int
                and shape is not None
            ):
                raise Message.OUTLINE_MISSING.refusal(key=quoted(key))
            before = len(self.findings.problems)
            check_part(shape, (key, "shape"), "objects.*.shape", self.findings)
            if len(self.findings.problems) > before or not isinstance(
                shape.value, dict
            ):
                continue
            for outline_path, outline, crossing in _outlines(None, children(shape)):
                self.outline(outline, (key, *outline_path), crossing)
            body = to_plain_data(solid) if solid is not None else None
            known = (
                body if body in find_schema_part("objects.*.solid")["enum"] else None
            )
            self.ground.outlines[int(key)] = crc.value, to_plain_data(shape), known
            whole_node = children(entry).get("whole")
            if whole_node is not None:
                self.whole(whole_node, key)

    def whole(self, shape: Node, key: str) -> None:
        """Read a stored shape with its hidden part; one that is wrong adds a problem."""
        before = len(self.findings.problems)
        check_part(shape, (key, "whole"), "objects.*.shape", self.findings)
        is_sound = len(self.findings.problems) == before
        if is_sound and isinstance(shape.value, dict):
            for outline_path, outline, crossing in _outlines(None, children(shape)):
                self.outline(outline, (key, *outline_path), crossing)
            self.ground.wholes[int(key)] = to_plain_data(shape)

    def record(self, path: Path) -> None:
        self.ground.record = read_written_record(path)

    def map_file(self, path: Path) -> None:
        self.map_sizes[path.name] = self.files.size(path, path.name)

    def masks(self) -> None:
        """Report ids that two parts use or that have no masks.png."""
        owner: dict[int, str] = {}
        assets = self.ground.assets
        has_masks = assets is not None and (assets / "masks.png").is_file()
        is_reported = "assets" in self.top and assets is None
        for section in ("objects", "boundaries"):
            for name, node in children(self.root, section).items():
                mask = self.good(node).get("mask")
                if mask is None:
                    continue
                path: KeyPath = (section, name, "mask")
                if not isinstance(mask.value, int | float):
                    continue
                id_ = int(mask.value)
                if id_ in owner:
                    message = Message.MASK_TAKEN
                    problem = message.problem(
                        mask.place, path, shown(id_), owner=owner[id_]
                    )
                    self.report(problem)
                owner.setdefault(
                    id_, name if section == "objects" else f"boundary {name}"
                )
                if not has_masks and not is_reported:
                    is_reported = True
                    self.no_masks(mask, path, id_)

    def no_masks(self, mask: Node, path: KeyPath, id_: int) -> None:
        if self.ground.assets is None:
            self.report(Message.NO_ASSETS.problem(mask.place, path, shown(id_)))
        else:
            assets, message = self.top["assets"], Message.ASSETS_WITHOUT_MASKS
            self.report(message.problem(assets.place, "assets", shown(assets.value)))

    # Objects and boundaries

    def object(self, name: str, node: Node) -> None:
        path: KeyPath = ("objects", name)
        parts, valid_keys = children(node), self.good(node)
        mask, shape = parts.get("mask"), parts.get("shape")
        if "mass" in parts and "density" in parts:
            place = parts["density"].key_place
            density_path: KeyPath = (*path, "density")
            self.report(Message.EXCLUDES.problem(place, density_path, other="mass"))
        is_bad = shape is not None and "shape" not in valid_keys
        kinds_of_shape = find_schema_part("objects.*.shape")["properties"]
        is_misplaced = shape is None and any(key in kinds_of_shape for key in parts)
        needs_shape = shape is None or isinstance(shape.value, str)
        if mask is None and needs_shape and not (is_bad or is_misplaced):
            fix = "write mask: 1, or shape: {circle: {center: [470.5, 257.0], radius: 30.2}}"
            close = nearest(name, (other for other in self.objects if other != name))
            if close and shape is None and len(parts) < 3:
                fix += f"; or did you mean {quoted(close)}?"
            message = Message.NO_MASK_FOR_SHAPE
            if shape is None:
                message = Message.NO_MASK_NOR_SHAPE
            self.report(message.problem(node.place, path, fix=fix))
        kinds = children(valid_keys.get("shape"))
        self.solid(valid_keys.get("solid"), kinds, path)
        for density_path, outline, crossing in _outlines(valid_keys.get("mask"), kinds):
            self.outline(outline, (*path, *density_path), crossing)
        self.areas(kinds, path)
        if "motion" not in parts:
            self.extents(kinds, path)
        self.holes(kinds, path)
        motion = children(valid_keys.get("motion"))
        self.rising(items(motion.get("path")), (*path, "motion", "path"))
        self.loop(motion, (*path, "motion"))

    def solid(self, node: Node | None, kinds: dict[str, Node], path: KeyPath) -> None:
        """Add the problem of a round solid whose shape is not a circle."""
        if node is None or not kinds or "circle" in kinds or node.value == "plate":
            return
        solid_path: KeyPath = (*path, "solid")
        kind, message = next(iter(kinds)), Message.SOLID_NEEDS_CIRCLE
        self.report(
            message.problem(node.place, solid_path, shown(node.value), kind=kind)
        )

    def outline(self, node: Node, path: KeyPath, crossing: bool) -> None:
        refusal = outline_fault(_points(node), crossing)
        if refusal is not None:
            self.report(refusal.problem(node.place, dotted(path)))

    def areas(self, kinds: dict[str, Node], path: KeyPath) -> None:
        """Add a problem for each outline of a shape that is too small to simulate."""
        for outline_path, node, crossing in _outlines(None, kinds):
            points = _points(node)
            area = abs(_signed_area(points))
            if "holes" in outline_path or area >= LEAST_AREA:
                continue
            if outline_fault(points, crossing) is not None:
                continue
            problem = Message.OUTLINE_SMALL.problem(
                node.place, (*path, *outline_path), area=area, least=LEAST_AREA
            )
            self.report(problem)

    def extents(self, kinds: dict[str, Node], path: KeyPath) -> None:
        """Add a problem if the shape is far larger than the photo."""
        if self.ground.size is None:
            return
        longest = LONGEST_EXTENT * max(self.ground.size)
        for kind, node in kinds.items():
            extent = self._extent(kind, node)
            if extent <= longest:
                continue
            problem = Message.SHAPE_HUGE.problem(
                node.place,
                (*path, "shape", kind),
                extent=extent,
                longest=longest,
                times=LONGEST_EXTENT,
            )
            self.report(problem)

    def _extent(self, kind: str, node: Node) -> float:
        """Return the length of a shape, px; 0 if its numbers are not valid."""
        parts = children(node)
        if kind == "circle" and "radius" in parts:
            return 2.0 * _number(parts["radius"])
        if kind == "box" and "size" in parts:
            return max(_number(side) for side in items(parts["size"]))
        sides = []
        for _, outline, crossing in _outlines(None, {kind: node}):
            points = _points(outline)
            if outline_fault(points, crossing) is not None:
                return 0.0  # it has a problem of its own
            sides += [max(axis) - min(axis) for axis in zip(*points, strict=True)]
        return max(sides, default=0.0)

    def holes(self, kinds: dict[str, Node], path: KeyPath) -> None:
        for index, piece in enumerate(items(kinds.get("polygons"))):
            outer = _points(children(piece)["outline"])
            box = [(min(c), max(c)) for c in zip(*outer, strict=True)]
            for hole, node in enumerate(items(children(piece).get("holes"))):
                sides = zip(*_points(node), strict=True)
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
                    self.report(Message.HOLE_OUTSIDE.problem(node.place, hole_path))

    def loop(self, motion: dict[str, Node], path: KeyPath) -> None:
        """Add a problem if a path that begins again does not end where it began."""
        knots = items(motion.get("path"))
        if "loop" not in motion or motion["loop"].value is not True or not knots:
            return
        first, last = items(knots[0]), items(knots[-1])
        if any(_number(first[k]) != _number(last[k]) for k in (1, 2)):
            problem = Message.LOOP_OPEN.problem(
                knots[-1].place,
                (*path, "path"),
                "the path",
                time=_number(last[0]),
                x=_number(first[1]),
                y=_number(first[2]),
            )
            self.report(problem)

    def rising(self, knots: list[Node], path: KeyPath) -> None:
        """Report the first knot whose time does not start at 0 or rise."""
        before: Any = None
        for index, knot in enumerate(knots):
            time = items(knot)[0]
            time_path: KeyPath = (*path, index, 0)
            value: Any = time.value
            if before is None and value != 0:
                self.report(
                    Message.PATH_START.problem(time.place, time_path, shown(value))
                )
                return
            if before is not None and value <= before:
                self.not_rising(time, time_path, before, "knots")
                return
            before = value

    def not_rising(self, time: Node, path: KeyPath, before: float, kind: str) -> None:
        """Add the problem of a time that is not after the one before it."""
        problem = Message.TIMES_NOT_RISING.problem(
            time.place, path, shown(time.value), before=number(before), items=kind
        )
        self.report(problem)

    def boundary(self, node: Node, path: KeyPath) -> None:
        parts = children(node)
        kinds = ("segment", "polyline", "arc", "bezier", "shape", "mask")
        given_kinds = [key for key in kinds if key in parts]
        if not given_kinds:
            self.report(Message.NO_LINE.problem(node.place, path))
            return
        if len(given_kinds) > 1:
            keys = listed(given_kinds, "and")
            self.report(Message.SEVERAL_LINES.problem(node.place, path, keys=keys))
            return
        line = self.good(node).get(given_kinds[0])
        if line is None:
            return
        if given_kinds == ["arc"]:
            self.arc(children(line), path)
            return
        if given_kinds == ["bezier"] and len(items(line)) % 3 != 1:
            key: KeyPath = (*path, "bezier")
            count = len(items(line))
            self.report(Message.CURVE_POINTS.problem(line.place, key, count=count))
            return
        if given_kinds == ["shape"]:
            shapes = children(line)
            for part, outline, crossing in _outlines(None, shapes):
                self.outline(outline, (*path, *part), crossing)
            self.areas(shapes, path)
            return
        if given_kinds == ["mask"]:
            for part, outline, crossing in _outlines(line, {}):
                self.outline(outline, (*path, *part), crossing)
            return
        self.distinct_points(line, (*path, given_kinds[0]))

    def distinct_points(self, line: Node, path: KeyPath) -> None:
        """Add the problem of the first point that repeats the one before it."""
        for index, (before, point) in enumerate(pairwise(_points(line)), start=1):
            distance = max(abs(a - b) for a, b in zip(before, point, strict=True))
            if distance < SAME_POINT:
                place = items(line)[index].place
                self.report(Message.POINT_REPEATED.problem(place, (*path, index)))
                return

    def arc(self, parts: dict[str, Node], path: KeyPath) -> None:
        """Add a problem if an arc has no length or goes round more than once."""
        begin, end = (
            _number(parts[key]) if key in parts else default
            for key, default in (("from", 0.0), ("to", 360.0))
        )
        if begin == end or abs(end - begin) > 360:
            fault = "has no length" if begin == end else "goes round more than once"
            place = parts[next(iter(parts))].place
            key: KeyPath = (*path, "arc")
            problem = Message.ARC_ANGLES.problem(place, key, "the arc", fault=fault)
            self.report(problem)

    def groups(self) -> None:
        """Add problems of collision groups that nothing has, and of friction that grows with sliding."""
        names: dict[str, None] = {MAIN_GROUP: None}
        listings: list[tuple[Node, KeyPath]] = []
        for section in ("objects", "boundaries"):
            for name, node in children(self.root, section).items():
                good = self.good(node)
                path: KeyPath = (section, name)
                if "collision_group" in good:
                    names[str(good["collision_group"].value)] = None
                for index, group in enumerate(items(good.get("collides_with"))):
                    place: KeyPath = (*path, "collides_with", index)
                    listings.append((group, place))
                self.static_friction(good, path)
                self.one_way(good, path)
        self.group_names(listings, list(names))

    def group_names(
        self, listings: list[tuple[Node, KeyPath]], names: list[str]
    ) -> None:
        """Add problems of groups that nothing has, and of more groups than the engine knows."""
        for group, where in listings:
            if str(group.value) not in names and group not in self.findings.bad:
                fix = one_of(str(group.value), names)
                problem = Message.UNKNOWN_GROUP.problem(
                    group.place, where, shown(group.value), fix=fix
                )
                self.report(problem)
        if len(names) > MOST_GROUPS:
            groups = f"{len(names)} collision groups"
            problem = Message.TOO_MANY_GROUPS.problem(
                self.root.place, (), groups, most=MOST_GROUPS
            )
            self.report(problem)

    def one_way(self, good: dict[str, Node], path: KeyPath) -> None:
        """Add a problem if a way has no direction."""
        way = good.get("one_way")
        if way is not None and not any(_number(one) for one in items(way)):
            key: KeyPath = (*path, "one_way")
            self.report(Message.ONE_WAY_ZERO.problem(way.place, key, "[0, 0]"))

    def static_friction(self, good: dict[str, Node], path: KeyPath) -> None:
        """Add a problem if what slides has more friction than what does not."""
        node = good.get("static_friction")
        if node is None:
            return
        friction = good.get("friction")
        default = find_schema_part(f"{path[0]}.*")["properties"]["friction"]["default"]
        least = default if friction is None else _number(friction)
        if _number(node) < least:
            problem = Message.STATIC_FRICTION_LOW.problem(
                node.place,
                (*path, "static_friction"),
                shown(node.value),
                friction=number(least),
            )
            self.report(problem)

    # Forces, joints and fields

    def forces(self) -> None:
        for index, node in enumerate(items(self.top.get("forces"))):
            if not isinstance(node.value, dict):
                continue
            path: KeyPath = ("forces", index)
            if "object" in self.good(node):
                self.is_object(node.value["object"], (*path, "object"))
            kind = self.one_of(node, path, FORCES)
            if kind == "torque" and "at" in node.value:
                self.senseless(
                    node.value["at"],
                    (*path, "at"),
                    "a torque turns the body as a whole",
                )
            if kind == "impulse" and "profile" in node.value:
                why = "an impulse is given at once"
                self.senseless(node.value["profile"], (*path, "profile"), why)
            table = children(self.good(node).get("profile")).get("table")
            self.rising(items(table), (*path, "profile", "table"))
            if kind == "impulse" and "duration" in node.value:
                why = "an impulse is given at once"
                self.senseless(node.value["duration"], (*path, "duration"), why)

    def joints(self, section: str) -> None:
        for name, node in children(self.root, section).items():
            path: KeyPath = (section, name)
            bad, objects = self.findings.bad, items(children(node).get("objects"))
            for index, item in enumerate(objects):
                if item not in bad:
                    self.is_object(item, (*path, "objects", index))
            if not isinstance(node.value, dict):
                continue
            self.kind(node, path, section)
            self.magnet(node, path)
            names = (
                [item.value for item in objects if item not in bad]
                if section == "joints"
                else []
            )
            if len(names) == 2 and names[0] == names[1]:
                place = children(node)["objects"].place
                itself, where = Message.JOINED_TO_ITSELF, (*path, "objects")
                self.report(itself.problem(place, where, shown(names[0])))
            if section == "joints":
                self.joint(node, path, names)

    def magnet(self, node: Node, path: KeyPath) -> None:
        """Add problems of the names of a magnet."""
        parts, good = children(node), self.good(node)
        names = items(good.get("magnet"))
        for index, item in enumerate(names):
            self.is_object(item, (*path, "magnet", index))
        if names and "objects" in parts:
            why = "the magnet names its objects"
            self.senseless(parts["objects"], (*path, "objects"), why)
        if len({str(item.value) for item in names}) < len(names):
            place = good["magnet"].place
            self.report(Message.NAMED_TWICE.problem(place, (*path, "magnet")))
        self.finger(node, path)

    def finger(self, node: Node, path: KeyPath) -> None:
        """Add problems of the knots of a finger, and of one on two objects."""
        parts, good = children(node), self.good(node)
        before: Any = None
        for index, knot in enumerate(items(good.get("finger"))):
            now: Any = items(knot)[0].value
            where: KeyPath = (*path, "finger", index, 0)
            time = items(knot)[0]
            if now < 0:
                problem = Message.TIME_NEGATIVE.problem(
                    time.place, where, shown(now), items="knots"
                )
                self.report(problem)
                break
            if before is not None and now <= before:
                self.not_rising(time, where, before, "knots")
                break
            before = now
        if "finger" in parts and len(items(parts.get("objects"))) > 1:
            place = parts["objects"].place
            self.report(Message.FINGER_ON_TWO.problem(place, (*path, "objects")))

    def joint(self, node: Node, path: KeyPath, names: list[Any]) -> None:
        """Add problems of a gear of one object, a rail without length, and a drive that is missing."""
        parts, good = children(node), self.good(node)
        if "gear" in parts and len(names) == 1:
            place = parts["objects"].place
            self.report(Message.GEAR_ON_ONE.problem(place, (*path, "objects")))
        if "gear" in good and good["gear"].value == 0:
            place = good["gear"].place
            self.report(Message.GEAR_ZERO.problem(place, (*path, "gear"), "0"))
        self.joint_ends(good, path)
        if "force" in parts and "drive" not in parts and "slider" in parts:
            fix = advice(find_schema_part("joints.*")["properties"]["drive"])
            key: KeyPath = (*path, "drive")
            message = Message.FORCE_WITHOUT_DRIVE
            self.report(message.problem(node.place, key, fix=fix))
        self.rope(good, path)

    def joint_ends(self, good: dict[str, Node], path: KeyPath) -> None:
        """Add a problem if a rail or a pulley's rope has no length."""
        has_length = "length" in good and _number(good["length"]) > 0
        for kind in ("slider", "pulley", "rope"):
            if kind == "rope" and has_length:
                continue
            ends = _points(good[kind]) if kind in good else []
            for one, other in pairwise(ends[:2] if kind == "slider" else ends):
                if (
                    max(abs(a - b) for a, b in zip(one, other, strict=True))
                    < SAME_POINT
                ):
                    place = good[kind].place
                    self.report(Message.SAME_ENDS.problem(place, (*path, kind)))
                    break

    def rope(self, good: dict[str, Node], path: KeyPath) -> None:
        """Add a problem if a rope is shorter than the way between its points."""
        for kind in ("rope", "pulley"):
            if kind not in good or "length" not in good:
                continue
            least = sum(
                hypot(one[0] - other[0], one[1] - other[1])
                for one, other in pairwise(_points(good[kind]))
            )
            if _number(good["length"]) < least - SAME_POINT * least:
                length = good["length"]
                problem = Message.ROPE_SHORT.problem(
                    length.place, (*path, "length"), shown(length.value), least=least
                )
                self.report(problem)

    def is_object(self, node: Node, path: KeyPath) -> None:
        """Adds a problem where a value names no object of the scene."""
        if str(node.value) in self.objects:
            return
        fix = "write it under objects first"
        if self.objects:
            fix = one_of(str(node.value), list(self.objects))
        unknown = Message.UNKNOWN_OBJECT
        self.report(unknown.problem(node.place, path, shown(node.value), fix=fix))

    def one_of(self, node: Node, path: KeyPath, kinds: tuple[str, ...]) -> str | None:
        """Return the one kind that a mapping has; a problem where it has none or several."""
        given = [key for key in kinds if key in children(node)]
        if len(given) == 1:
            return given[0]
        known = find_schema_part(f"{path[0]}.*" if path[0] in KINDS else "forces")
        known = known.get("items", known)["properties"]
        if not given and any(key not in known for key in children(node)):
            return None  # the message about the unknown key lists the kinds
        content = f"has {listed(given, 'and')}" if given else f"has no {listed(kinds)}"
        problem = Message.NOT_ONE_KEY.problem(
            node.place, path, content=content, kinds=listed(kinds, "and")
        )
        self.report(problem)
        return None

    def kind(self, node: Node, path: KeyPath, section: str) -> None:
        """A joint or a field has exactly one kind, the key that it needs, and none of other kinds."""
        kind = self.one_of(node, path, KINDS[section])
        if kind is None:
            return
        parts, needed = children(node), NEEDED.get(kind)
        if needed and needed not in parts:
            fix = advice(find_schema_part(f"{section}.*")["properties"][needed])
            where: KeyPath = (*path, needed)
            missing = Message.KEY_NEEDED
            self.report(missing.problem(node.place, where, kind=_a(kind), fix=fix))
        for key, owner in OWNER.items():
            if key in parts and kind not in owner:
                owners = listed([_a(one) for one in owner])
                why = f"only {owners} has it, and this is {_a(kind)}"
                self.senseless(parts[key], (*path, key), why)

    def senseless(self, node: Node, path: KeyPath, why: str) -> None:
        """Add the problem of a key without an effect."""
        message = Message.HAS_NO_EFFECT
        self.report(message.problem(node.key_place, path, why=why))

    # The video and the rest

    def render(self) -> None:
        node = self.top.get("render")
        if node is None:
            return
        self.exclusive(node, ("render",), "render")
        self.video_size(self.good(node))
        camera = children(node).get("camera")
        views = (
            items(camera)
            if camera is not None and isinstance(camera.value, list)
            else [camera]
        )
        before: Any = None
        for index, view in enumerate(views):
            if view is None:
                continue
            path: KeyPath = (
                "render",
                "camera",
                *((index,) if view is not camera else ()),
            )
            self.exclusive(view, path, "render.camera")
            good = self.good(view)
            if "time" in good:
                now: Any = good["time"].value
                if before is not None and now <= before:
                    self.not_rising(good["time"], (*path, "time"), before, "views")
                before = now
            if "follow" in good:
                self.is_object(good["follow"], (*path, "follow"))
            if "center" in good and self.ground.size is not None:
                self.in_photo(good["center"], (*path, "center"), self.ground.size)

    def exclusive(self, node: Node, path: KeyPath, schema_path: str) -> None:
        """Report keys that exclude each other."""
        parts = children(node)
        for group in find_schema_part(schema_path)["x-exclusive"]:
            first, *rest = [key for key in group if key in parts] or [""]
            for key in rest:
                place = parts[key].key_place
                self.report(Message.EXCLUDES.problem(place, (*path, key), other=first))

    def video_size(self, good: dict[str, Node]) -> None:
        """Report a video that is larger than a photo may be."""
        scale, size, photo = good.get("scale"), good.get("size"), self.ground.size
        if photo is None:
            return
        if size is not None:
            width, height = read_integers(size)
            if width * height > Limit.PIXELS.most:
                self.too_many_pixels(size, "render.size", "[832, 480]")
        if scale is not None:
            factor: Any = scale.value
            width, height = video_size(photo, factor, None)
            if width * height > Limit.PIXELS.most:
                most = (
                    floor(sqrt(Limit.PIXELS.most / (photo[0] * photo[1])) * 100) / 100
                )
                problem = Message.VIDEO_TOO_LARGE.problem(
                    scale.place,
                    "render.scale",
                    shown(factor),
                    width=width,
                    height=height,
                    limit=Limit.PIXELS.expected,
                    most=most,
                )
                self.report(problem)

    def too_many_pixels(self, size: Node, path: str, example: str) -> None:
        """Add the problem of a canvas or a video that is too large."""
        width, height = read_integers(size)
        problem = Limit.PIXELS.problem(size.place, path, f"{width} x {height}")
        self.report(replace(problem, fix=f"{problem.fix}, e.g. {example}"))

    def in_photo(self, node: Node, path: KeyPath, photo: tuple[int, int]) -> None:
        x, y = _point(node)
        if not all(
            -0.5 <= c <= side - 0.5 for c, side in zip((x, y), photo, strict=True)
        ):
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
            self.report(problem)

    def refine(self) -> None:
        """Report an unknown backend, and a strength that leaves no step to run."""
        parts = self.good(self.top.get("refine"))
        backend = parts.get("backend")
        if backend is None or backend.value == "none":
            return
        known = registry.names("refine")
        if backend.value not in known:
            fix = registry.suggestion(str(backend.value), known)
            unknown = Message.UNKNOWN_REFINER.refusal(fix=fix)
            self.findings.value(backend, ("refine", "backend"), unknown)
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
            problem = Message.NO_STEP.problem(
                wrong.place,
                ("refine", "strength"),
                shown(strength),
                steps=shown(steps),
                least=number(ceil(50 / steps) / 100),
            )
            self.report(problem)

    def light(self) -> None:
        direction = self.good(self.top.get("light")).get("direction")
        if direction is not None and not any(item.value for item in items(direction)):
            fix = advice(find_schema_part("light.direction"))
            zero = Message.DIRECTION_ZERO
            self.report(zero.problem(direction.place, "light.direction", fix=fix))

    def map_range(self, name: str, node: Node) -> None:
        if node in self.findings.bad:
            return
        low, high = _point(node)
        if low >= high:
            found = f"[{shown(low)}, {shown(high)}]"
            self.report(Message.RANGE_ORDER.problem(node.place, ("maps", name), found))


def _number(node: Node) -> float:
    """Return the value of a valid number."""
    value = node.value
    assert isinstance(value, int | float)
    return float(value)


def _outlines(
    mask: Node | None, kinds: dict[str, Node]
) -> Iterator[tuple[KeyPath, Node, bool]]:
    """Yield every outline of an object or a boundary, its path, and whether it may not cross itself."""
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
    """Return why an outline is wrong, None for a good one; `crossing`: its lines may not cross.

    Only lines that properly cross are refused; an outline may touch itself, as contours of masks do.
    """
    xs = [x for x, _ in points]
    ys = [y for _, y in points]
    area = _signed_area(points)
    extent = (max(xs) - min(xs)) * (max(ys) - min(ys))
    flat = abs(area) < 1e-12 * extent
    if extent > 0 and crossing and (pair := _crossing(tuple(points))) is not None:
        if pair == (-1, -1):
            return Limit.CROSSINGS.refusal()
        return Message.OUTLINE_CROSSES.refusal(first=pair[0], second=pair[1])
    if extent == 0 or (flat and (crossing or len(points) < 4)):
        return Message.OUTLINE_FLAT.refusal()
    return None


def _signed_area(points: Sequence[Corner]) -> float:
    """Return the area of an outline, px², positive if it turns +x towards +y."""
    x0, y0 = points[0]
    xs = [x - x0 for x, _ in points]
    ys = [y - y0 for _, y in points]
    return sum(xs[i - 1] * ys[i] - xs[i] * ys[i - 1] for i in range(len(points))) / 2


@lru_cache(REMEMBERED)
def _crossing(points: tuple[Corner, ...]) -> tuple[int, int] | None:
    """Return the first pair of lines that properly cross, by their first corners; (-1, -1) beyond Limit.CROSSINGS."""
    import numpy as np
    import shapely

    corners = np.asarray(points, dtype=float)
    lines = shapely.linestrings(
        np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    )
    tree = shapely.STRtree(lines)
    compared = 0
    for start in range(0, len(lines), BLOCK):
        first, second = tree.query(lines[start : start + BLOCK])
        first += start
        compared += len(first)
        if compared > Limit.CROSSINGS.most:
            return (-1, -1)
        hits = (second > first) & shapely.crosses(lines[first], lines[second])
        if hits.any():
            return min(zip(first[hits].tolist(), second[hits].tolist(), strict=True))
    return None


def _point(node: Node) -> tuple[float, float]:
    row: Any = node.value
    return row[0].value, row[1].value


def _points(node: Node) -> list[tuple[float, float]]:
    return [_point(item) for item in items(node)]


def _size_text(size: tuple[int, int]) -> str:
    """Return a width and height as messages show them."""
    return f"{size[0]} x {size[1]}"


def _a(word: str) -> str:
    """Return a word with its article; substances have none."""
    if word in ("air", "water", "wind"):
        return word
    return f"{'an' if word[0] in 'aeiou' else 'a'} {word}"
