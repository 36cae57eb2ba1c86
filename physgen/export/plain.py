"""Plain data -> a file of JSON."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

_SHORT = re.compile(r"\[\n\s+([^\[\]{}]*?)\n\s+\]")
"""Lists that hold no others; a string of JSON has no line breaks of its own."""


def json_text(data: Any) -> str:
    """Indented, a list of plain values on one line, a number as short as it reads back exactly; always the same.

    >>> print(json_text({"a": [1, 0.5], "b": "[\\n 1]"}))
    {
     "a": [1, 0.5],
     "b": "[\\n 1]"
    }
    """
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    return _SHORT.sub(lambda found: "[" + re.sub(r",\n\s+", ", ", found[1]) + "]", text)


def write_json(path: Path, data: Any) -> None:
    """UTF-8."""
    path.write_text(json_text(data) + "\n", encoding="utf-8")
