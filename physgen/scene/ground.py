"""Tree of a scene -> the canvas, the photo and the maps that it stands on, read no further than headers."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from physgen.pictures import MOST_PIXELS
from physgen.scene.files import MAPS, RefusedError, confined, image_size
from physgen.scene.node import Node, whole
from physgen.scene.report import Report
from physgen.scene.words import quoted, shown
from physgen.whole import Stamp, stamped


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
        key, stamp = str(path), stamped(path)
        if key not in self._sizes or self._sizes[key][0] != stamp:
            try:
                self._sizes[key] = stamp, image_size(path)
            except RefusedError as error:
                self._sizes[key] = stamp, error
        found = self._sizes[key][1]
        if isinstance(found, RefusedError):
            raise found
        return found


def check_ground(root: Node, top: dict[str, Node], report: Report, files: Files) -> Ground:
    """Adds what is wrong with image, size and assets, `top` being the mapping of `root`."""
    ground = Ground()
    _canvas(root, top, ground, report, files)
    _assets(top, ground, report, files)
    return ground


def _canvas(root: Node, top: dict[str, Node], ground: Ground, report: Report, files: Files) -> None:
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


def _assets(top: dict[str, Node], ground: Ground, report: Report, files: Files) -> None:
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
