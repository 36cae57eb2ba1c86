"""Rules between keys of a scene that JSON Schema cannot express, and checks of its
files.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from physgen.files import Stamp, file_stamp
from physgen.messages import Message
from physgen.problems import InputError, Limit, RefusedError
from physgen.scene.checked_tree import (
    CheckedTree,
    Ground,
    report_pixel_count,
)
from physgen.scene.document import Node, children, read_integers, to_plain_data
from physgen.scene.element_rules import KINDS, check_forces, check_groups, check_joints
from physgen.scene.files import (
    ASSETS,
    OUTLINES,
    image_size,
    read_scene,
    read_written_record,
    resolve_confined,
    similar,
)
from physgen.scene.picture_rules import (
    check_light,
    check_map_range,
    check_refine,
    check_render,
)
from physgen.scene.schema import find_schema_part
from physgen.scene.shape_rules import (
    check_boundary,
    check_object,
    check_outline,
    outlines_of,
)
from physgen.scene.validate import Findings, check_part, misspelt_keys
from physgen.text import KeyPath, quoted, shown


class Files:
    """Image files of a scene. Each is read once for all variants, and again after a
    change.
    """

    def __init__(self, allow_outside: bool) -> None:
        self.allow_outside = allow_outside
        self._sizes: dict[str, tuple[Stamp, tuple[int, int] | RefusedError]] = {}
        self._outlines: dict[str, tuple[Stamp, Node]] = {}

    def size(self, path: Path, path_text: str) -> tuple[int, int]:
        """Return the width and height of an image from its header. Raise RefusedError.
        `path_text` is the path in the scene.
        """
        key, stamp = str(path), file_stamp(path)
        # Variants share the files: each is read once.
        if key not in self._sizes or self._sizes[key][0] != stamp:
            try:
                self._sizes[key] = stamp, image_size(path, path_text)
            except RefusedError as error:
                # A refusal is stored too: each variant has the same fault.
                self._sizes[key] = stamp, error
        size = self._sizes[key][1]
        if isinstance(size, RefusedError):
            raise size
        return size

    def outlines(self, path: Path, name: str) -> Node:
        """Return the tree of `outlines.json`. Raise InputError."""
        key, stamp = str(path), file_stamp(path)
        if key not in self._outlines or self._outlines[key][0] != stamp:
            self._outlines[key] = stamp, read_scene(path, name)
        return self._outlines[key][1]


RESTORE_ASSETS = "restore the folder of masks.png, or perceive the photo again"
"""Fix for missing assets."""
RESTORE_PHOTO = "restore the folder, which holds the photo, or perceive the original"
"""Fix for missing assets with the copy of the photo."""


def check_rules(root: Node, findings: Findings, files: Files) -> Ground:
    """Report faults between keys. Values with problems of the schema are left out."""
    return _Rules(root, findings, files).check()


def _known_solid(node: Node | None) -> Any:
    """Return the solid of a stored shape; None for an absent or unknown one."""
    if node is None:
        return None
    solid = to_plain_data(node)
    if solid in find_schema_part("objects.*.solid")["enum"]:
        return solid
    return None


class _Rules:
    """The rules of one tree."""

    def __init__(self, root: Node, findings: Findings, files: Files) -> None:
        self.tree, self.files = CheckedTree(root, findings), files
        self.ground = self.tree.ground
        self.report = findings.report
        self.map_sizes: dict[str, tuple[int, int]] = {}
        """Width and height of each map, px."""

    def check(self) -> Ground:
        # The canvas comes first: most places and sizes are checked against it. Masks
        # need the assets.
        self.canvas()
        self.assets()
        for name, node in self.tree.objects.items():
            if isinstance(node.value, dict):
                check_object(self.tree, name, node)
        self.masks()
        for name, node in children(self.tree.root, "boundaries").items():
            if isinstance(node.value, dict):
                check_boundary(self.tree, node, ("boundaries", name))
        check_groups(self.tree)
        check_forces(self.tree)
        for section in KINDS:
            check_joints(self.tree, section)
        check_render(self.tree)
        check_refine(self.tree)
        check_light(self.tree)
        for name, node in children(self.tree.root, "maps").items():
            check_map_range(self.tree, name, node)
        return self.ground

    def canvas(self) -> None:
        image = self.tree.top.get("image")
        size = self.tree.top.get("size")
        if image and size:
            self.report(Message.EXCLUDES.problem(size.key_place, "size", other="image"))
        # `imgae` is reported as unknown already: a missing canvas would be a second
        # message.
        misspelt = misspelt_keys(self.tree.top, find_schema_part("")["properties"])
        if image is None and size is None and not misspelt & {"image", "size"}:
            self.report(Message.NO_CANVAS.problem(self.tree.root.place, "image"))
        valid_keys = self.tree.valid_keys(self.tree.root)
        if image:
            if "image" in valid_keys:
                self._photo(image)
        elif "size" in valid_keys:
            width, height = read_integers(valid_keys["size"])
            if width * height > Limit.PIXELS.most:
                report_pixel_count(self.tree, valid_keys["size"], "size", "[512, 512]")
            else:
                self.ground.size = (width, height)

    def _photo(self, image: Node) -> None:
        """Read the size of the photo; report an unreadable one."""
        folder = image.source.folder
        try:
            path = resolve_confined(
                str(image.value), folder, folder, self.files.allow_outside
            )
            self.ground.size = self.files.size(path, str(image.value))
            self.ground.image = path
        except RefusedError as error:
            # A missing assets folder has its own message.
            if not self.is_in_missing_assets(image):
                self.report(error.problem(image.place, "image", shown(image.value)))

    def is_in_missing_assets(self, image: Node) -> bool:
        """Return whether the photo was in a missing assets folder."""
        assets = self.tree.valid_keys(self.tree.root).get("assets")
        if assets is None or not str(image.value).startswith(f"{assets.value}/"):
            return False
        return not os.path.lexists(assets.source.folder / str(assets.value))

    def _is_own_folder(self, node: Node) -> bool:
        """Return whether perception made the assets folder. Other folders belong to
        older scenes.
        """
        stem = re.escape(Path(node.place.file).stem)
        return re.fullmatch(rf"{stem}(-\d+)?\.assets", str(node.value)) is not None

    def assets(self) -> None:
        node = self.tree.valid_keys(self.tree.root).get("assets")
        if node is None:
            return
        # Paths in a file are relative to this file, also if another scene extends it.
        home = node.source.folder
        try:
            folder = resolve_confined(
                str(node.value), home, home, self.files.allow_outside
            )
            if not folder.is_dir():
                raise Message.ASSETS_NOT_FOLDER.refusal(fix=self._fix_of(node, folder))
        except RefusedError as error:
            self.report(error.problem(node.place, "assets", shown(node.value)))
            return
        self.ground.assets = folder
        for file in ASSETS:
            # A broken link exists for lexists, and is refused below.
            if os.path.lexists(folder / file):
                try:
                    path = resolve_confined(
                        file, folder, home, self.files.allow_outside
                    )
                    self._asset(file, path)
                except RefusedError as error:
                    value_text = quoted(f"{node.value}/{file}")
                    self.report(error.problem(node.place, "assets", value_text))
        self.check_map_sizes(node)

    def _fix_of(self, node: Node, folder: Path) -> str:
        """Return the fix for a missing assets folder."""
        image = self.tree.top.get("image")
        fix = RESTORE_ASSETS
        # If the photo was in the missing folder, perceiving it again is impossible.
        if image is not None and self.is_in_missing_assets(image):
            fix = RESTORE_PHOTO
        if self._is_own_folder(node):
            return fix
        return similar(str(node.value), folder, ("/",), fix)

    def _asset(self, file: str, path: Path) -> None:
        """Read a file of the assets. Raise RefusedError."""
        if file.endswith(".png"):
            self.map_file(path)
        elif file == OUTLINES:
            self.outlines(path)
        else:
            self.record(path)

    def check_map_sizes(self, assets: Node) -> None:
        """Report maps with other sizes than the photo; only once if the photo is
        another one.
        """
        canvas = self.ground.size
        sizes = set(self.map_sizes.values())
        if canvas is None or sizes <= {canvas}:
            return
        canvas_text = _size_text(canvas)
        image = self.tree.valid_keys(self.tree.root).get("image")
        is_perceived = self.ground.record.objects or self.ground.record.world
        # One other size for all maps means another photo, not faulty maps.
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
        """Read the stored shapes, and check them as shapes in the file."""
        name = os.path.join(
            os.path.dirname(self.tree.root.source.name),
            os.path.relpath(path, self.tree.root.source.folder),
        )
        try:
            tree = self.files.outlines(path, name)
        except InputError as error:
            raise Message.OUTLINES_UNREADABLE.refusal(
                reason=error.problems[0]
            ) from None
        for key, entry in children(tree).items():
            fields = children(entry)
            crc = fields.get("crc")
            shape = fields.get("shape")
            # Keys are ids of masks.png.
            crc_value: Any = None if crc is None else crc.value
            if shape is None or type(crc_value) is not int or not key.isdecimal():
                raise Message.OUTLINE_MISSING.refusal(key=quoted(key))
            if not self._is_sound(shape, (key, "shape")):
                continue
            solid = _known_solid(fields.get("solid"))
            self.ground.outlines[int(key)] = crc_value, to_plain_data(shape), solid
            whole_node = fields.get("whole")
            if whole_node is not None and self._is_sound(whole_node, (key, "whole")):
                self.ground.wholes[int(key)] = to_plain_data(whole_node)

    def _is_sound(self, shape: Node, path: KeyPath) -> bool:
        """Report the faults of a stored shape; return whether the schema permits it."""
        before = len(self.tree.findings.problems)
        check_part(shape, path, "objects.*.shape", self.tree.findings)
        if len(self.tree.findings.problems) > before or not isinstance(
            shape.value, dict
        ):
            return False
        for outline_path, outline, crossing in outlines_of(None, children(shape)):
            check_outline(self.tree, outline, (path[0], *outline_path), crossing)
        return True

    def record(self, path: Path) -> None:
        self.ground.record = read_written_record(path)

    def map_file(self, path: Path) -> None:
        self.map_sizes[path.name] = self.files.size(path, path.name)

    def masks(self) -> None:
        """Report repeated ids, and ids without masks.png."""
        owner: dict[int, str] = {}
        assets = self.ground.assets
        has_masks = assets is not None and (assets / "masks.png").is_file()
        is_reported = "assets" in self.tree.top and assets is None
        for section in ("objects", "boundaries"):
            for name, node in children(self.tree.root, section).items():
                mask = self.tree.valid_keys(node).get("mask")
                if mask is None:
                    continue
                path: KeyPath = (section, name, "mask")
                if not isinstance(mask.value, int | float):
                    continue
                id_ = int(mask.value)
                # Two objects with one mask would both be cut out of the same pixels.
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
            assets = self.tree.top["assets"]
            message = Message.ASSETS_WITHOUT_MASKS
            self.report(message.problem(assets.place, "assets", shown(assets.value)))


def _size_text(size: tuple[int, int]) -> str:
    """Return a width and height for messages."""
    return f"{size[0]} x {size[1]}"
