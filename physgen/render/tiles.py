"""Boxes of touched pixels -> few boxes that do not overlap and cover them."""

from __future__ import annotations

from collections.abc import Sequence

TILE = 32
"""px a side of the tiles in which touched pixels are counted."""

Slices = tuple[slice, slice]


def union(boxes: Sequence[Slices], size: tuple[int, int]) -> list[Slices]:
    """Runs of tiles that cover the boxes on a canvas of `size` (W, H); equal runs that touch become one box."""
    marked = [0] * (-(-size[1] // TILE))  # a bit for each tile of a row
    for rows, columns in boxes:
        if rows.stop > rows.start and columns.stop > columns.start:
            run = (1 << ((columns.stop - 1) // TILE + 1)) - (1 << (columns.start // TILE))
            for row in range(rows.start // TILE, (rows.stop - 1) // TILE + 1):
                marked[row] |= run
    found: list[Slices] = []
    begun: dict[tuple[int, int], int] = {}
    for row, bits in enumerate([*marked, 0]):
        runs = []
        while bits:
            first = (bits & -bits).bit_length() - 1
            length = (~(bits >> first) & ((bits >> first) + 1)).bit_length() - 1
            runs.append((first, first + length))
            bits &= ~(((1 << length) - 1) << first)
        for first, last in [run for run in begun if run not in runs]:
            top = begun.pop((first, last))
            found.append(
                (
                    slice(top * TILE, min(row * TILE, size[1])),
                    slice(first * TILE, min(last * TILE, size[0])),
                )
            )
        for run in runs:
            begun.setdefault(run, row)
    return found
