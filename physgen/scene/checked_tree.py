"""The tree under check, and the common checks of several kinds of rules."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from physgen.messages import Message, one_of
from physgen.problems import Limit
from physgen.scene.document import Node, children, items, read_integers
from physgen.scene.files import (
    Record,
)
from physgen.scene.validate import Findings
from physgen.text import KeyPath, number, shown


@dataclass
class Ground:
    """The canvas (width, height) px, the photo and the folder of maps."""

    size: tuple[int, int] | None = None
    image: Path | None = None
    assets: Path | None = None
    outlines: dict[int, tuple[int, Any, str | None]] = field(default_factory=dict)
    """Stored shapes by id in masks.png: the CRC of the mask, the shape as plain data,
    and its `solid`.
    """
    wholes: dict[int, Any] = field(default_factory=dict)
    """Shapes with their hidden parts as plain data, by id in masks.png."""
    record: Record = field(default_factory=Record)
    perceived_size: tuple[int, int] | None = None
    """Size of the photo behind the assets, px, if it is not the scene's photo."""


class CheckedTree:
    """A tree with the schema's problems, to which rules add theirs."""

    def __init__(self, root: Node, findings: Findings) -> None:
        self.root, self.findings = root, findings
        self.top = children(root)
        self.objects = children(root, "objects")
        self.ground = Ground()
        self.report = findings.report

    def valid_keys(self, node: Node | None) -> dict[str, Node]:
        """Return the keys of a mapping with valid values."""
        keys = {}
        for key, part in children(node).items():
            if part not in self.findings.bad:
                keys[key] = part
        return keys


def check_rising(tree: CheckedTree, knots: list[Node], path: KeyPath) -> None:
    """Report the first knot with a time out of order. Times start at 0 and rise."""
    # Only the first fault is reported: later knots often repeat it.
    before: Any = None
    for index, knot in enumerate(knots):
        time = items(knot)[0]
        time_path: KeyPath = (*path, index, 0)
        value: Any = time.value
        if before is None and value != 0:
            tree.report(Message.PATH_START.problem(time.place, time_path, shown(value)))
            return
        if before is not None and value <= before:
            report_time_order(tree, time, time_path, before, "knots")
            return
        before = value


def report_time_order(
    tree: CheckedTree, time: Node, path: KeyPath, before: float, kind: str
) -> None:
    """Report a time that is not after the previous one."""
    problem = Message.TIMES_NOT_RISING.problem(
        time.place, path, shown(time.value), before=number(before), items=kind
    )
    tree.report(problem)


def check_object_name(tree: CheckedTree, node: Node, path: KeyPath) -> None:
    """Report a value that does not name an object of the scene."""
    if str(node.value) in tree.objects:
        return
    # An empty scene has no similar name to suggest.
    fix = "write it under objects first"
    if tree.objects:
        fix = one_of(str(node.value), list(tree.objects))
    unknown = Message.UNKNOWN_OBJECT
    tree.report(unknown.problem(node.place, path, shown(node.value), fix=fix))


def report_pixel_count(tree: CheckedTree, size: Node, path: str, example: str) -> None:
    """Report a canvas or a video with too many pixels."""
    width, height = read_integers(size)
    problem = Limit.PIXELS.problem(size.place, path, f"{width} x {height}")
    tree.report(replace(problem, fix=f"{problem.fix}, e.g. {example}"))


def number_of(node: Node) -> float:
    """Return the value of a valid number."""
    value = node.value
    assert isinstance(value, int | float)
    return float(value)


def point_of(node: Node) -> tuple[float, float]:
    """Return the coordinates of a valid point, px."""
    row: Any = node.value
    return row[0].value, row[1].value


def points_of(node: Node) -> list[tuple[float, float]]:
    """Return the coordinates of a valid list of points, px."""
    return list(map(point_of, items(node)))
