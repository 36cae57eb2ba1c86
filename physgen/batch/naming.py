"""Where a clip stands in a sweep and what it is set to -> the name of its folder.

`04-01,velocity.x=-500,elasticity=0.9`: the fifth value of the first key, the second of the second. Draws count in four
digits or more: `0007,mass=183.4`. The numbers make names unique and sort them, as people and galleries sort, in the
order of the sweep; what stands behind them is for reading. A value that is added behind an axis, and draws that are
added to draws, leave the names of the others as they are.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from physgen.batch.values import Value

BYTES = 100
"""Of a name, at most: file systems take 255, and traces and parts of files are named after it."""
WORD = 24
"""Characters of a value, at most."""


def name(
    variant: int | None,
    said: str | None,
    places: Sequence[int],
    draw: int | None,
    told: Sequence[tuple[str, Value]],
) -> str:
    """`variant`: its index, None where there is one alone; `said`: its name. `told`: short keys with their values."""
    numbers = [f"{place:02d}" for place in ([] if variant is None else [variant]) + [*places]]
    numbers += [] if draw is None else [f"{draw:04d}"]
    parts = ([] if variant is None or said is None else [said]) + [f"{key}={short(v)}" for key, v in told]
    text = "-".join(numbers)
    for n, part in enumerate(parts):
        longer = f"{text},{part}"
        left = len(parts) - n - 1
        if len(longer.encode()) + (len(f",+{left}") if left else 0) > BYTES:
            return f"{text},+{left + 1}"
        text = longer
    return text


def short(value: Value) -> str:
    """A value in about four digits or a word, of characters that no shell and no file system minds.

    >>> [short(Value("", data)) for data in (-500, 0.1 + 0.2, 12345.678, 1.5e-7, True, None, [256, 256], "a b/c")]
    ['-500', '0.3', '12346', '1.5e-7', 'true', 'none', '256x256', 'a_b_c']
    """
    data = value.data
    if isinstance(data, list) and 0 < len(data) <= 4 and all(isinstance(item, int | float) for item in data):
        return "x".join(map(_scalar, data))
    return _scalar(value.text if isinstance(data, list | dict) else data)


def _scalar(data: Any) -> str:
    if data is None or isinstance(data, bool):
        return {None: "none", True: "true", False: "false"}[data]
    if isinstance(data, int | float):
        size = abs(data)
        text = f"{data:.0f}" if (size < 1e7 and data % 1 == 0) or 1e3 <= size < 1e7 else f"{data:.4g}"
        return re.sub(r"e\+?(-?)0*", r"e\1", text)
    return re.sub(r"[^\w.+-]+", "_", str(data)).strip("_.")[:WORD] or "_"
