"""Comments in which perception told where a number came from -> the same for the number that took its place."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Mapping, Sequence

from physgen.edit.marked import Marked, marked
from physgen.edit.refusing import EditError
from physgen.scene.model import Scene

WIDTH = 100
"""Columns of a comment."""
OURS = {"mass": ("g: ",), "friction": ("friction", "ordinary friction"), "layer": ("in front: ",)}
"""How such a comment begins, by key; any other is a person's."""
GUESSED = {
    "mass": ("g: ",),
    "density": ("g: ",),
    "friction": ("friction", "ordinary friction", "at least this much", "nobody can see friction"),
    "layer": ("in front: ",),
    "motion": ("cut off by the photo's border", "nothing that is seen keeps"),
    "pixels_per_meter": ("1 px = 1 cm", "from the ordinary size", "as given; masses", "as it was, for what"),
    "view": ("side or top: ",),
    "table": ("nobody can see friction",),
}
"""The same of all that a person may set in their place."""


def reasoned(
    text: str, scene: Scene, file: str, reasons: Mapping[str, str], fresh: Collection[str] = ()
) -> str:
    """`reasons` by dotted path; `scene` is that of the text, which is in `file`. Comments of others stay.

    Objects that are `fresh` get comments where they have none.
    """
    lines = text.split("\n")
    for path, reason in sorted(reasons.items(), key=lambda item: -_line(scene, file, item[0])):
        at, starts = _line(scene, file, path), OURS.get(path.rpartition(".")[2])
        if not at or starts is None:
            continue
        line = lines[at - 1]
        behind = re.search(_behind(starts), line)
        if behind is not None:
            lines[at - 1] = f"{line[: behind.start()]}  # {' '.join(reason.split())}"
            continue
        _, name, key = path.split(".", 2)
        if name in fresh and re.fullmatch(rf"\s+{key}: [^#{{]*", line):
            lines[at - 1] = f"{line}  # {' '.join(reason.split())}"
            continue
        first = at - 1
        while first and lines[first - 1].lstrip().startswith("#"):
            first -= 1
        if first < at - 1 and lines[first].lstrip(" #").startswith(starts):
            indent = line[: len(line) - len(line.lstrip())]
            lines[first : at - 1] = [
                f"{indent}# {part}" for part in textwrap.wrap(reason, WIDTH - len(indent))
            ]
    return "\n".join(lines)


def said_of_walls(text: str, remarks: Mapping[str, tuple[str, str]]) -> str:
    """What perception said of walls, by name, and says now, behind each one's name; other remarks stay.

    >>> said_of_walls("boundaries:\\n  floor:  # below 3\\n    x: 1\\n", {"floor": ("below 3", "below 4")})
    'boundaries:\\n  floor:  # below 4\\n    x: 1\\n'
    """
    head, key, walls = text.partition("\nboundaries:") if "\nboundaries:" in text else ("", "", text)
    for name, (before, now) in remarks.items():
        old = rf"  # {re.escape(before)}" if before else ""
        said = f"  # {' '.join(now.split())}" if now else ""
        found = re.search(rf"(?m)^  {re.escape(name)}:(?P<old>{old})$", walls)
        if found is not None:
            walls = walls[: found.start("old")] + said + walls[found.end("old") :]
    return head + key + walls


def forgotten(text: str, paths: Sequence[Sequence[str | int]]) -> str:
    """The text without what perception said of numbers that a person has set now; other remarks stay.

    >>> forgotten("world:\\n  # 1 px = 1 cm, as\\n  pixels_per_meter: 9\\n", [["world", "pixels_per_meter"]])
    'world:\\n  pixels_per_meter: 9\\n'
    """
    for path in paths:
        for k, key in enumerate(path):
            if isinstance(key, str) and key in GUESSED and (k != 1 or path[0] == "world"):
                text = _without(text, path[: k + 1], GUESSED[key])
    return text


def _behind(starts: tuple[str, ...]) -> str:
    """A comment at the end of a line that begins in one of these ways."""
    return rf"\s+#\s+(?:{'|'.join(map(re.escape, starts))}).*$"


def _without(text: str, path: Sequence[str | int], starts: tuple[str, ...]) -> str:
    """Without the comment behind, or right above, the key at a path, where it begins in one of these ways."""
    try:
        node: Marked | None = marked(text)
    except EditError:
        return text
    for key in path[:-1]:
        node = None if node is None else node.child(key)
    begin = None if node is None else next((at for name, at, _ in node.keys if name == path[-1]), None)
    if begin is None:
        return text
    lines, number = text.split("\n"), text.count("\n", 0, begin)
    if lines[number][: begin - text.rfind("\n", 0, begin) - 1].strip():
        return text  # on a line with others
    behind = re.search(_behind(starts), lines[number])
    if behind is not None:
        lines[number] = lines[number][: behind.start()]
        return "\n".join(lines)
    first = number
    while first and lines[first - 1].lstrip().startswith("#"):
        first -= 1
    for k in range(first, number):
        if lines[k].lstrip(" #").startswith(starts):
            return "\n".join(lines[:k] + lines[number:])
    return text


def _line(scene: Scene, file: str, path: str) -> int:
    """Where a number stands, counted from 1; 0 where it is not in this file."""
    place = scene.places.get(path)
    return place.line if place is not None and place.file == file else 0
