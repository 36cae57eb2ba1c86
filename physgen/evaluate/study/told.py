"""A file of a study's key or of a rater's answers -> what is in it as JSON, or one problem that says what is not."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from physgen.problems import InputError

KEY, ANSWERS = "physgen-study-key", "physgen-study-answers"
"""What the files say they are, with the version of their form."""
VERSION = 1
MOST_BYTES = 16_000_000


def told(path: Path, kind: str) -> Mapping[str, Any]:
    """The file's contents. Raises InputError where it is not of that `kind`."""
    what, other, fix = {
        KEY: (
            "the key of a study",
            ANSWERS,
            "name the file NAME.key.json that was made with the page, with --key",
        ),
        ANSWERS: ("a rater's answers", KEY, "name files that the page of a study saved"),
    }[kind]
    if not path.is_file():
        raise InputError.of(str(path), "", "no such file", "check the path")
    if path.stat().st_size > MOST_BYTES:
        raise InputError.of(str(path), "", f"has over {MOST_BYTES // 1_000_000} MB: it is not {what}", fix)
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        reason = f" (line {error.lineno})" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError.of(str(path), "", f"cannot be read as JSON{reason}", fix) from None
    if isinstance(record, dict) and other in record:
        if kind == ANSWERS:
            raise InputError.of(str(path), "", "is the key of a study, not answers", "name it with --key")
        raise InputError.of(str(path), "", "holds answers: it is not the key", fix)
    if not isinstance(record, dict) or kind not in record:
        raise InputError.of(str(path), "", f"is not {what}", fix)
    if record[kind] != VERSION:
        expected = f"is of a form that this physgen does not know (it knows {VERSION})"
        raise InputError.of(
            str(path), f"{kind} {record[kind]}"[:60], expected, "use the physgen that made it"
        )
    return record
