"""Names of objects at their centres: how large, and on which line where neighbours stand close."""

from __future__ import annotations

from physgen.compile.world import Body, World
from physgen.render.ink import Layer, breadth
from physgen.render.sheet import Sheet

LEAST = 0.65
"""Of a letter: as small as a name becomes on a small object."""
LINE = 1.15
"""Letters from line to line."""
LINES = (0, -1, 1, -2, 2)


def lettering(body: Body, sheet: Sheet) -> float:
    """px: the size of a name's letters."""
    room = 2 * body.reach * sheet.zoom / breadth(body.name, sheet.letter)
    return sheet.letter * min(max(room, LEAST), 1.0)


def staggered(world: World, sheet: Sheet) -> tuple[int, ...]:
    """By how many lines each name stands below its centre, so that neighbours' names at t = 0 can be read.

    It is so for the whole clip: names do not hop. None leaves its object by more than half a line.
    """
    taken: list[tuple[float, float, float, float]] = []
    lines = []
    for body in world.bodies:
        size = lettering(body, sheet)
        x, y = sheet.at(body.center).tolist()
        wide, tall = breadth(body.name, size) / 2, size / 2
        near = [line for line in LINES if abs(line) * LINE * size <= body.reach * sheet.zoom + size / 2]
        crowds = []
        for line in near:
            row = y + line * LINE * size
            over = [max(0.0, wide + w - abs(x - a)) for a, b, w, t in taken if abs(row - b) < tall + t]
            crowds.append((sum(over), abs(line), line))
        _, _, line = min(crowds)
        taken.append((x, y + line * LINE * size, wide, tall))
        lines.append(line)
    return tuple(lines)


def write_name(layer: Layer, sheet: Sheet, body: Body, center: tuple[float, float], line: int) -> None:
    """A name at a centre, px of the frame, so many lines below it."""
    size = lettering(body, sheet)
    layer.words(body.name, (center[0], center[1] + line * LINE * size), size)
