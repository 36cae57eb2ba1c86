"""The closed forms for the engine, by number. `physgen evaluate physics` runs them."""

from __future__ import annotations

from collections.abc import Iterator

from physgen.evaluate.physics import (
    barriers,
    bodies,
    carried,
    conserved,
    curves,
    energy,
    falling,
    forces,
    impacts,
    joints,
    machines,
    media,
    rocking,
    rolling,
    sliding,
    stacks,
    surfaces,
    tabletop,
)
from physgen.evaluate.physics.scorecard import Row, scene_file, scene_of

_GROUPS = (
    falling,
    sliding,
    rolling,
    rocking,
    impacts,
    conserved,
    curves,
    barriers,
    bodies,
    carried,
    tabletop,
    stacks,
    surfaces,
    forces,
    joints,
    machines,
    media,
    energy,
)
ROWS: tuple[Row, ...] = tuple(
    sorted((row for group in _GROUPS for row in group.ROWS), key=lambda row: row.number)
)


def examples() -> Iterator[tuple[str, str]]:
    """Yield file name and text of every scene of the first draws: the files of
    scenes/physics/.
    """
    for row in ROWS:
        for case in row.draw(0):
            yield scene_file(row, case, 0), scene_of(row, case)
