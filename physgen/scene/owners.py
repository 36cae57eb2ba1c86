"""Masks of objects and boundaries -> Problems: an id that two share or no map holds, runs that miss the canvas."""

from __future__ import annotations

from physgen.scene.ground import Ground
from physgen.scene.node import Node, children, whole
from physgen.scene.report import Report
from physgen.scene.words import KeyPath, shown


def check_masks(root: Node, ground: Ground, report: Report) -> None:
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


def _rle(node: Node, path: KeyPath, canvas: tuple[int, int], report: Report) -> None:
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
