"""Rules between keys of a scene that JSON Schema cannot express, and checks of the files that it names."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from math import ceil, floor, hypot, sqrt
from pathlib import Path
from typing import Any

from physgen import registry
from physgen.files import Stamp, file_stamp
from physgen.problems import InputError, Limit, RefusedError
from physgen.scene.document import Node, children, items, plain, whole
from physgen.scene.files import (
    ASSETS,
    OUTLINES,
    Record,
    confined,
    image_size,
    read_scene,
    similar,
    written,
)
from physgen.scene.scene import MAIN_GROUP, video_size
from physgen.scene.schema import advice, at
from physgen.scene.validate import Findings, check_part, misspelt_keys
from physgen.text import KeyPath, listed, nearest, number, quoted, shown

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
    "fields": ("wind", "air", "water", "attractor", "magnet"),
}
NEEDED = {
    "spring": "stiffness",
    "finger": "stiffness",
    "water": "density",
    "magnet": "pull",
    "motor": "speed",
    "wind": "drag",
    "attractor": "strength",
}
"""Kind of a joint or field -> the key without which it has no effect."""
OWNER = {
    **dict.fromkeys(("stiffness", "damping"), ("spring", "finger")),
    "length": ("spring", "rope", "pulley"),
    **dict.fromkeys(("speed", "limit"), ("motor",)),
    "limits": ("pivot", "motor"),
    "friction": ("pivot",),
    **dict.fromkeys(("drive", "force"), ("slider",)),
    "drag": ("wind", "air", "water"),
    "linear": ("air", "water"),
    "density": ("water",),
    "pull": ("magnet",),
    "strength": ("attractor",),
    "soften": ("attractor", "magnet"),
}
"""Key of a joint or field -> the only kinds that it belongs to."""
ONE_OF_TWO = "write only one of the two"
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
        """Width and height of an image, `written` in a scene, from its header; raises RefusedError."""
        key, stamp = str(path), file_stamp(path)
        if key not in self._sizes or self._sizes[key][0] != stamp:
            try:
                self._sizes[key] = stamp, image_size(path, written)
            except RefusedError as error:
                self._sizes[key] = stamp, error
        found = self._sizes[key][1]
        if isinstance(found, RefusedError):
            raise found
        return found

    def outlines(self, path: Path, name: str) -> Node:
        """The tree of `outlines.json`; raises InputError."""
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
        self.add = findings.add

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
        """The keys of a mapping whose values satisfy the schema."""
        return {
            key: part
            for key, part in children(node).items()
            if part not in self.findings.bad
        }

    # The canvas and the files

    def canvas(self) -> None:
        image, size = self.top.get("image"), self.top.get("size")
        if image and size:
            self.add(size.key_place, "size", "", "stands beside image", ONE_OF_TWO)
        meant = misspelt_keys(self.top, at("")["properties"])
        if image is None and size is None and not meant & {"image", "size"}:
            fix = "write image: photo.png, or size: [512, 512] for a scene without a photo"
            self.add(self.root.place, "image", "", "missing", fix)
        good = self.good(self.root)
        if image and "image" in good:
            folder = image.source.folder
            try:
                path = confined(
                    str(image.value), folder, folder, self.files.allow_outside
                )
                self.ground.size = self.files.size(path, str(image.value))
                self.ground.image = path
            except RefusedError as error:
                if self.is_in_missing_assets(image):
                    return
                self.add(
                    image.place, "image", shown(image.value), error.expected, error.fix
                )
        elif not image and "size" in good:
            width, height = whole(good["size"])
            if width * height > Limit.PIXELS.most:
                fix, found = (
                    f"{Limit.PIXELS.fix}, e.g. [512, 512]",
                    f"{width} x {height}",
                )
                self.add(good["size"].place, "size", found, Limit.PIXELS.expected, fix)
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
        found = shown(node.value)
        try:
            folder = confined(str(node.value), home, home, self.files.allow_outside)
            if not folder.is_dir():
                image = self.top.get("image")
                is_photo_lost = image is not None and self.is_in_missing_assets(image)
                fix = RESTORE_PHOTO if is_photo_lost else RESTORE_ASSETS
                if not self._is_own_folder(node):
                    fix = similar(str(node.value), folder, ("/",), fix)
                raise RefusedError("is not a folder", fix)
        except RefusedError as error:
            self.add(node.place, "assets", found, error.expected, error.fix)
            return
        self.ground.assets = folder
        for file in ASSETS:
            if os.path.lexists(folder / file):
                data = self.outlines if file == OUTLINES else self.record
                use = self.map_file if file.endswith(".png") else data
                try:
                    use(confined(file, folder, home, self.files.allow_outside))
                except RefusedError as error:
                    found = quoted(f"{node.value}/{file}")
                    self.add(node.place, "assets", found, error.expected, error.fix)
        self.check_map_sizes(node)

    def check_map_sizes(self, assets: Node) -> None:
        """Report maps that differ from the photo; once if the photo is another one."""
        canvas, sizes = self.ground.size, set(self.map_sizes.values())
        if canvas is None or sizes <= {canvas}:
            return
        now = f"{canvas[0]} x {canvas[1]}"
        image = self.good(self.root).get("image")
        is_perceived = self.ground.record.objects or self.ground.record.world
        if image is not None and is_perceived and len(sizes) == 1:
            (size,) = sizes
            self.ground.perceived_size = size
            expected = (
                f"is {now}, but this scene was made from {size[0]} x {size[1]} px"
            )
            fix = "restore the photo, or perceive it again"
            self.add(image.place, "image", shown(image.value), expected, fix)
            return
        for file, size in self.map_sizes.items():
            if size != canvas:
                found = quoted(f"{assets.value}/{file}")
                expected = f"is {size[0]} x {size[1]}, the canvas {now}"
                fix = "make them the same size"
                self.add(assets.place, "assets", found, expected, fix)

    def outlines(self, path: Path) -> None:
        """Reads the stored shapes; they are checked as those in the file are."""
        name = os.path.join(
            os.path.dirname(self.root.source.name),
            os.path.relpath(path, self.root.source.folder),
        )
        try:
            tree = self.files.outlines(path, name)
        except InputError as error:
            raise RefusedError(
                f"cannot be read: {error.problems[0]}",
                "remove it, and outlines are fitted",
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
                raise RefusedError(
                    f"has no outline at {quoted(key)}",
                    "remove it, and outlines are fitted",
                )
            before = len(self.findings.problems)
            check_part(shape, (key, "shape"), "objects.*.shape", self.findings)
            if len(self.findings.problems) > before or not isinstance(
                shape.value, dict
            ):
                continue
            for where, outline, crossing in _outlines(None, children(shape)):
                self.outline(outline, (key, *where), crossing)
            body = plain(solid) if solid is not None else None
            known = body if body in at("objects.*.solid")["enum"] else None
            self.ground.outlines[int(key)] = crc.value, plain(shape), known
            whole = children(entry).get("whole")
            if whole is not None:
                self.whole(whole, key)

    def whole(self, shape: Node, key: str) -> None:
        """Read a stored shape with its hidden part; one that is wrong adds a problem."""
        before = len(self.findings.problems)
        check_part(shape, (key, "whole"), "objects.*.shape", self.findings)
        is_sound = len(self.findings.problems) == before
        if is_sound and isinstance(shape.value, dict):
            for where, outline, crossing in _outlines(None, children(shape)):
                self.outline(outline, (key, *where), crossing)
            self.ground.wholes[int(key)] = plain(shape)

    def record(self, path: Path) -> None:
        self.ground.record = written(path)

    def map_file(self, path: Path) -> None:
        self.map_sizes[path.name] = self.files.size(path, path.name)

    def masks(self) -> None:
        """Ids that two parts use or that have no masks.png."""
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
                    expected = f"is the mask of {owner[id_]} already"
                    self.add(
                        mask.place,
                        path,
                        shown(id_),
                        expected,
                        "give each an id of its own",
                    )
                owner.setdefault(
                    id_, name if section == "objects" else f"boundary {name}"
                )
                if not has_masks and not is_reported:
                    is_reported = True
                    self.no_masks(mask, path, id_)

    def no_masks(self, mask: Node, path: KeyPath, id_: int) -> None:
        if self.ground.assets is None:
            fix = "write assets: and the folder of masks.png, or mask: {polygon: [[x, y], ...]}"
            self.add(
                mask.place,
                path,
                shown(id_),
                "is an id, but the scene names no assets",
                fix,
            )
        else:
            assets = self.top["assets"]
            self.add(
                assets.place,
                "assets",
                shown(assets.value),
                "has no masks.png",
                RESTORE_ASSETS,
            )

    # Objects and boundaries

    def object(self, name: str, node: Node) -> None:
        path: KeyPath = ("objects", name)
        parts, good = children(node), self.good(node)
        mask, shape = parts.get("mask"), parts.get("shape")
        if "mass" in parts and "density" in parts:
            place = parts["density"].key_place
            self.add(place, (*path, "density"), "", "stands beside mass", ONE_OF_TWO)
        is_bad = shape is not None and "shape" not in good
        kinds_of_shape = at("objects.*.shape")["properties"]
        is_misplaced = shape is None and any(key in kinds_of_shape for key in parts)
        needs_shape = shape is None or isinstance(shape.value, str)
        if mask is None and needs_shape and not (is_bad or is_misplaced):
            fix = "write mask: 1, or shape: {circle: {center: [470.5, 257.0], radius: 30.2}}"
            close = nearest(name, (other for other in self.objects if other != name))
            if close and shape is None and len(parts) < 3:
                fix += f"; or did you mean {quoted(close)}?"
            what = (
                "has neither mask nor shape"
                if shape is None
                else "has a shape to fit, but no mask"
            )
            self.add(node.place, path, "", what, fix)
        kinds = children(good.get("shape"))
        solid = good.get("solid")
        if (
            solid is not None
            and kinds
            and "circle" not in kinds
            and solid.value != "plate"
        ):
            expected = f"does not go with a {next(iter(kinds))}"
            self.add(
                solid.place,
                (*path, "solid"),
                shown(solid.value),
                expected,
                "write plate",
            )
        for where, outline, crossing in _outlines(good.get("mask"), kinds):
            self.outline(outline, (*path, *where), crossing)
        self.areas(kinds, path)
        if "motion" not in parts:
            self.extents(kinds, path)
        self.holes(kinds, path)
        motion = children(good.get("motion"))
        self.rising(items(motion.get("path")), (*path, "motion", "path"))
        self.loop(motion, (*path, "motion"))

    def outline(self, node: Node, path: KeyPath, crossing: bool) -> None:
        problem = outline_problem(_points(node), crossing)
        if problem:
            self.add(node.place, path, "", *problem)

    def areas(self, kinds: dict[str, Node], path: KeyPath) -> None:
        """Add a problem for each outline of a shape that is too small to simulate."""
        for where, node, crossing in _outlines(None, kinds):
            points = _points(node)
            area = abs(_signed_area(points))
            if "holes" in where or area >= LEAST_AREA:
                continue
            if outline_problem(points, crossing):
                continue
            expected = f"has an area of {area:.2g} px², below {LEAST_AREA:g} px²"
            fix = "draw it larger; did you mean meters? write each number as e.g. 0.5 m"
            self.add(node.place, (*path, *where), "", expected, fix)

    def extents(self, kinds: dict[str, Node], path: KeyPath) -> None:
        """Add a problem if the shape is far larger than the photo."""
        if self.ground.size is None:
            return
        longest = LONGEST_EXTENT * max(self.ground.size)
        for kind, node in kinds.items():
            extent = self._extent(kind, node)
            if extent <= longest:
                continue
            expected = f"is {extent:,.0f} px long, above {longest:,} px"
            fix = (
                f"write at most {LONGEST_EXTENT} times the photo's longer side; did you "
                "mean px? write the numbers without a unit"
            )
            self.add(node.place, (*path, "shape", kind), "", expected, fix)

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
            if outline_problem(points, crossing):
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
                    where: KeyPath = (*path, "shape", "polygons", index, "holes", hole)
                    self.add(
                        node.place,
                        where,
                        "",
                        "leads out of its outline",
                        "keep holes inside",
                    )

    def loop(self, motion: dict[str, Node], path: KeyPath) -> None:
        """Add a problem if a path that begins again does not end where it began."""
        knots = items(motion.get("path"))
        if "loop" not in motion or motion["loop"].value is not True or not knots:
            return
        first, last = items(knots[0]), items(knots[-1])
        if any(_number(first[k]) != _number(last[k]) for k in (1, 2)):
            x, y = _number(first[1]), _number(first[2])
            fix = f"end with [{_number(last[0]):g}, {x:g}, {y:g}]"
            what = "does not end where it began, and it is to begin again"
            self.add(knots[-1].place, (*path, "path"), "the path", what, fix)

    def rising(self, knots: list[Node], path: KeyPath) -> None:
        """Times of knots start at 0 and rise; the first wrong one is reported."""
        before: Any = None
        for index, knot in enumerate(knots):
            time = items(knot)[0]
            where: KeyPath = (*path, index, 0)
            now: Any = time.value
            if before is None and now != 0:
                self.add(
                    time.place,
                    where,
                    shown(now),
                    "is not 0",
                    "start the path at time 0",
                )
                return
            if before is not None and now <= before:
                fix = "write knots with rising times"
                self.add(
                    time.place, where, shown(now), f"is not after {number(before)}", fix
                )
                return
            before = now

    def boundary(self, node: Node, path: KeyPath) -> None:
        parts = children(node)
        kinds = ("segment", "polyline", "arc", "bezier", "shape", "mask")
        given = [key for key in kinds if key in parts]
        if len(given) != 1:
            has = f"has {listed(given, 'and')}" if given else "has no line"
            fix = "write segment: [[0, 457], [512, 457]], polyline, arc, bezier, shape or mask"
            self.add(
                node.place, path, "", has, "write only one of them" if given else fix
            )
            return
        line = self.good(node).get(given[0])
        if line is None:
            return
        if given == ["arc"]:
            self.arc(children(line), path)
            return
        if given == ["bezier"] and len(items(line)) % 3 != 1:
            found = f"has {len(items(line))} points"
            fix = "write one point, then three for each curve: 4, 7, 10, ..."
            self.add(line.place, (*path, "bezier"), "", found, fix)
            return
        if given == ["shape"]:
            shapes = children(line)
            for part, outline, crossing in _outlines(None, shapes):
                self.outline(outline, (*path, *part), crossing)
            self.areas(shapes, path)
            return
        if given == ["mask"]:
            for part, outline, crossing in _outlines(line, {}):
                self.outline(outline, (*path, *part), crossing)
            return
        points = _points(line)
        for index in range(1, len(points)):
            if (
                max(
                    abs(a - b)
                    for a, b in zip(points[index - 1], points[index], strict=True)
                )
                < SAME_POINT
            ):
                where: KeyPath = (*path, given[0], index)
                place = items(line)[index].place
                self.add(
                    place, where, "", "is the point before it again", "move or drop it"
                )
                return

    def arc(self, parts: dict[str, Node], path: KeyPath) -> None:
        """Add a problem if an arc has no length or goes round more than once."""
        begin, end = (
            _number(parts[key]) if key in parts else default
            for key, default in (("from", 0.0), ("to", 360.0))
        )
        if begin == end or abs(end - begin) > 360:
            what = "has no length" if begin == end else "goes round more than once"
            fix = "write angles at most 360 degrees apart"
            place = parts[next(iter(parts))].place
            self.add(place, (*path, "arc"), "the arc", what, fix)

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
                way = good.get("one_way")
                if way is not None and not any(_number(one) for one in items(way)):
                    fix = "write e.g. [0, -1]: others pass upwards"
                    key: KeyPath = (*path, "one_way")
                    self.add(way.place, key, "[0, 0]", "is no direction", fix)
        for group, where in listings:
            if str(group.value) not in names and group not in self.findings.bad:
                close = nearest(str(group.value), names)
                fix = f"write {listed(list(names)[:30])}"
                fix = f"did you mean {quoted(close)}?" if close else fix
                what = "is no collision_group of this scene"
                self.add(group.place, where, shown(group.value), what, fix)
        if len(names) > MOST_GROUPS:
            what = f"are more than {MOST_GROUPS}"
            found = f"{len(names)} collision groups"
            self.add(self.root.place, "", found, what, "join some of them")

    def static_friction(self, good: dict[str, Node], path: KeyPath) -> None:
        """Add a problem if what slides has more friction than what does not."""
        node = good.get("static_friction")
        if node is None:
            return
        friction = good.get("friction")
        default = at(f"{path[0]}.*")["properties"]["friction"]["default"]
        least = default if friction is None else _number(friction)
        if _number(node) < least:
            what = f"is less than the friction of {number(least)} while it slides"
            fix = "write a larger one, or a smaller friction"
            self.add(
                node.place, (*path, "static_friction"), shown(node.value), what, fix
            )

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
                fix = "name two objects, or one to hold it to the world"
                place = children(node)["objects"].place
                self.add(
                    place,
                    (*path, "objects"),
                    shown(names[0]),
                    "is joined to itself",
                    fix,
                )
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
            what = "names an object twice"
            self.add(good["magnet"].place, (*path, "magnet"), "", what, "drop one")
        self.finger(node, path)

    def finger(self, node: Node, path: KeyPath) -> None:
        """Add problems of the knots of a finger, and of one on two objects."""
        parts, good = children(node), self.good(node)
        before: Any = None
        for index, knot in enumerate(items(good.get("finger"))):
            now: Any = items(knot)[0].value
            if now < 0 or (before is not None and now <= before):
                where: KeyPath = (*path, "finger", index, 0)
                what = "is below 0" if now < 0 else f"is not after {number(before)}"
                fix = "write knots with rising times"
                self.add(items(knot)[0].place, where, shown(now), what, fix)
                break
            before = now
        if "finger" in parts and len(items(parts.get("objects"))) > 1:
            place, what = parts["objects"].place, "are two, and a finger pulls one"
            self.add(place, (*path, "objects"), "", what, "name one object")

    def joint(self, node: Node, path: KeyPath, names: list[Any]) -> None:
        """Add problems of a gear of one object, a rail without length, and a drive that is missing."""
        parts, good = children(node), self.good(node)
        if "gear" in parts and len(names) == 1:
            place = parts["objects"].place
            fix = "name two, each on a pin of its own"
            self.add(
                place,
                (*path, "objects"),
                "",
                "is one object, and a gear turns two",
                fix,
            )
        if "gear" in good and good["gear"].value == 0:
            fix = "write e.g. -2: the first turns twice as fast, the other way"
            self.add(good["gear"].place, (*path, "gear"), "0", "turns nothing", fix)
        for kind in ("slider", "pulley"):
            ends = _points(good[kind]) if kind in good else []
            for one, other in pairwise(ends[:2] if kind == "slider" else ends):
                if (
                    max(abs(a - b) for a, b in zip(one, other, strict=True))
                    < SAME_POINT
                ):
                    what = "has two points at the same place"
                    self.add(good[kind].place, (*path, kind), "", what, "move one")
                    break
        if "force" in parts and "drive" not in parts and "slider" in parts:
            fix = advice(at("joints.*")["properties"]["drive"])
            self.add(
                node.place, (*path, "drive"), "", "missing, and its force needs it", fix
            )
        self.rope(good, path)

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
                what = f"is less than the {least:.6g} px between its points"
                fix = "lengthen it, or move its ends"
                place = good["length"].place
                shown_length = shown(good["length"].value)
                self.add(place, (*path, "length"), shown_length, what, fix)

    def is_object(self, node: Node, path: KeyPath) -> None:
        """Adds a problem where a value names no object of the scene."""
        if str(node.value) in self.objects:
            return
        close = nearest(str(node.value), self.objects)
        fix = (
            f"did you mean {quoted(close)}?"
            if close
            else f"write {listed(list(self.objects)[:30])}"
        )
        fix = fix if self.objects else "write it under objects first"
        self.add(
            node.place, path, shown(node.value), "is not an object of this scene", fix
        )

    def one_of(self, node: Node, path: KeyPath, kinds: tuple[str, ...]) -> str | None:
        """The one kind that a mapping has; a problem where it has none or several."""
        given = [key for key in kinds if key in children(node)]
        if len(given) == 1:
            return given[0]
        known = at(f"{path[0]}.*" if path[0] in KINDS else "forces")
        known = known.get("items", known)["properties"]
        if not given and any(key not in known for key in children(node)):
            return None  # the message about the unknown key lists the kinds
        has = f"has {listed(given, 'and')}" if given else f"has no {listed(kinds)}"
        self.add(
            node.place, path, "", has, f"write exactly one of {listed(kinds, 'and')}"
        )
        return None

    def kind(self, node: Node, path: KeyPath, section: str) -> None:
        """A joint or a field has exactly one kind, the key that it needs, and none of other kinds."""
        kind = self.one_of(node, path, KINDS[section])
        if kind is None:
            return
        parts, needed = children(node), NEEDED.get(kind)
        if needed and needed not in parts:
            fix = advice(at(f"{section}.*")["properties"][needed])
            self.add(
                node.place,
                (*path, needed),
                "",
                f"missing, and {_a(kind)} needs it",
                fix,
            )
        for key, owner in OWNER.items():
            if key in parts and kind not in owner:
                owners = listed([_a(one) for one in owner])
                why = f"it belongs to {owners}, and this is {_a(kind)}"
                self.senseless(parts[key], (*path, key), why)

    def senseless(self, node: Node, path: KeyPath, why: str) -> None:
        self.add(node.key_place, path, "", f"has no meaning here: {why}", "take it out")

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
                    expected, fix = (
                        f"is not after {number(before)}",
                        "write views with rising times",
                    )
                    self.add(
                        good["time"].place, (*path, "time"), shown(now), expected, fix
                    )
                before = now
            if "follow" in good:
                self.is_object(good["follow"], (*path, "follow"))
            if "center" in good and self.ground.size is not None:
                self.in_photo(good["center"], (*path, "center"), self.ground.size)

    def exclusive(self, node: Node, path: KeyPath, schema_path: str) -> None:
        """Keys that exclude each other."""
        parts = children(node)
        for group in at(schema_path)["x-exclusive"]:
            first, *rest = [key for key in group if key in parts] or [""]
            for key in rest:
                self.add(
                    parts[key].key_place,
                    (*path, key),
                    "",
                    f"stands beside {first}",
                    ONE_OF_TWO,
                )

    def video_size(self, good: dict[str, Node]) -> None:
        """A video is no larger than a photo may be."""
        scale, size, photo = good.get("scale"), good.get("size"), self.ground.size
        if photo is None:
            return
        if size is not None:
            width, height = whole(size)
            if width * height > Limit.PIXELS.most:
                found, fix = (
                    f"{width} x {height}",
                    f"{Limit.PIXELS.fix}, e.g. [832, 480]",
                )
                self.add(size.place, "render.size", found, Limit.PIXELS.expected, fix)
        if scale is not None:
            factor: Any = scale.value
            width, height = video_size(photo, factor, None)
            if width * height > Limit.PIXELS.most:
                most = (
                    floor(sqrt(Limit.PIXELS.most / (photo[0] * photo[1])) * 100) / 100
                )
                expected = f"makes a video of {width} x {height}, which {Limit.PIXELS.expected}"
                self.add(
                    scale.place,
                    "render.scale",
                    shown(factor),
                    expected,
                    f"write at most {most:g}",
                )

    def in_photo(self, node: Node, path: KeyPath, photo: tuple[int, int]) -> None:
        x, y = _point(node)
        if not all(
            -0.5 <= c <= side - 0.5 for c, side in zip((x, y), photo, strict=True)
        ):
            expected = f"is beside the photo, which is {photo[0]} x {photo[1]}"
            fix = f"write a point in it, e.g. [{photo[0] // 2}, {photo[1] // 2}]"
            self.add(node.place, path, f"[{shown(x)}, {shown(y)}]", expected, fix)

    def refine(self) -> None:
        """The backend is known, and its strength leaves at least one step to run."""
        parts = self.good(self.top.get("refine"))
        backend = parts.get("backend")
        if backend is None or backend.value == "none":
            return
        known = registry.names("refine")
        if backend.value not in known:
            fix = registry.suggestion(str(backend.value), known)
            self.findings.value(
                backend, ("refine", "backend"), "is no backend that refines", fix
            )
        steps, strength = (
            parts[key].value if key in parts else at(f"refine.{key}")["default"]
            for key in ("steps", "strength")
        )
        if (
            isinstance(steps, int)
            and isinstance(strength, int | float)
            and steps * strength < 0.5
        ):
            wrong = parts.get("strength", parts.get("steps", backend))
            what = f"leaves none of {shown(steps)} steps to run"
            fix = f"write at least {number(ceil(50 / steps) / 100)}, or backend: none"
            self.add(wrong.place, ("refine", "strength"), shown(strength), what, fix)

    def light(self) -> None:
        direction = self.good(self.top.get("light")).get("direction")
        if direction is not None and not any(item.value for item in items(direction)):
            fix = advice(at("light.direction"))
            self.add(direction.place, "light.direction", "", "has no length", fix)

    def map_range(self, name: str, node: Node) -> None:
        if node in self.findings.bad:
            return
        low, high = _point(node)
        if low >= high:
            found = f"[{shown(low)}, {shown(high)}]"
            self.add(
                node.place,
                ("maps", name),
                found,
                "does not rise",
                "write the smaller number first",
            )


def _number(node: Node) -> float:
    """Return the value of a valid number."""
    value = node.value
    assert isinstance(value, int | float)
    return float(value)


def _outlines(
    mask: Node | None, kinds: dict[str, Node]
) -> Iterator[tuple[KeyPath, Node, bool]]:
    """Every outline of an object or a boundary, its path, and whether it may not cross itself."""
    if "polygon" in children(mask):
        yield ("mask", "polygon"), children(mask)["polygon"], False
    if "polygon" in kinds:
        yield ("shape", "polygon"), kinds["polygon"], True
    for index, piece in enumerate(items(kinds.get("polygons"))):
        where: KeyPath = ("shape", "polygons", index)
        yield (*where, "outline"), children(piece)["outline"], True
        for hole, node in enumerate(items(children(piece).get("holes"))):
            yield (*where, "holes", hole), node, True


def outline_problem(points: Sequence[Corner], crossing: bool) -> tuple[str, str] | None:
    """`expected` and `fix` of a Problem, None for a good outline; `crossing`: its lines may not cross.

    Only lines that properly cross are refused; an outline may touch itself, as contours of masks do.
    """
    xs = [x for x, _ in points]
    ys = [y for _, y in points]
    area = _signed_area(points)
    extent = (max(xs) - min(xs)) * (max(ys) - min(ys))
    flat = abs(area) < 1e-12 * extent
    if extent > 0 and crossing and (pair := _crossing(tuple(points))) is not None:
        if pair == (-1, -1):
            return Limit.CROSSINGS.expected, Limit.CROSSINGS.fix
        found = f"crosses itself: the lines from corners {pair[0]} and {pair[1]}"
        return found, "write the corners in order"
    if extent == 0 or (flat and (crossing or len(points) < 4)):
        return "has no area", "write at least three corners that are not on one line"
    return None


def _signed_area(points: Sequence[Corner]) -> float:
    """Return the area of an outline, px², positive if it turns +x towards +y."""
    x0, y0 = points[0]
    xs = [x - x0 for x, _ in points]
    ys = [y - y0 for _, y in points]
    return sum(xs[i - 1] * ys[i] - xs[i] * ys[i - 1] for i in range(len(points))) / 2


@lru_cache(REMEMBERED)
def _crossing(points: tuple[Corner, ...]) -> tuple[int, int] | None:
    """First pair of lines that properly cross, by their first corners; (-1, -1) beyond Limit.CROSSINGS."""
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


def _a(word: str) -> str:
    return f"{'an' if word[0] in 'aeiou' else 'a'} {word}"
