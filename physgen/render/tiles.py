"""Boxes of touched pixels -> tiles -> few boxes that do not overlap and cover them."""

from __future__ import annotations

from collections.abc import Sequence

TILE = 32
"""px a side of the tiles in which touched pixels are counted."""

Slices = tuple[slice, slice]


def union(boxes: Sequence[Slices], size: tuple[int, int]) -> list[Slices]:
    """Runs of tiles that cover the boxes on a canvas of `size` (W, H); equal runs that touch become one box."""
    return runs(tiled(boxes, size), size)


def tiled(boxes: Sequence[Slices], size: tuple[int, int]) -> list[int]:
    """The tiles that the boxes touch: a number for each row of tiles, with a bit for each tile."""
    marked = [0] * (-(-size[1] // TILE))
    for rows, columns in boxes:
        if rows.stop > rows.start and columns.stop > columns.start:
            run = (1 << ((columns.stop - 1) // TILE + 1)) - (1 << (columns.start // TILE))
            for row in range(rows.start // TILE, (rows.stop - 1) // TILE + 1):
                marked[row] |= run
    return marked


def runs(tiles: Sequence[int], size: tuple[int, int]) -> list[Slices]:
    """The boxes of `union`, of tiles as `tiled` has them."""
    found: list[Slices] = []
    begun: dict[tuple[int, int], int] = {}
    for row, bits in enumerate([*tiles, 0]):
        here = []
        while bits:
            first = (bits & -bits).bit_length() - 1
            length = (~(bits >> first) & ((bits >> first) + 1)).bit_length() - 1
            here.append((first, first + length))
            bits &= ~(((1 << length) - 1) << first)
        for first, last in [run for run in begun if run not in here]:
            top = begun.pop((first, last))
            found.append(
                (
                    slice(top * TILE, min(row * TILE, size[1])),
                    slice(first * TILE, min(last * TILE, size[0])),
                )
            )
        for run in here:
            begun.setdefault(run, row)
    return found
