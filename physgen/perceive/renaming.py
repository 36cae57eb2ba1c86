"""`NAME=TEXT` -> things under new labels, and how sure every label is."""

from __future__ import annotations

import difflib
import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import replace

from physgen.perceive.found import Found
from physgen.perceive.roles import Name, Thing
from physgen.problems import InputError


def renamed_things(
    things: Sequence[Thing], renames: Sequence[str], called: Mapping[int, str]
) -> tuple[list[Thing], set[int]]:
    """Things, `called` so, under their new labels, and the ids of those that got one.

    Raises InputError with every wrong NAME.
    """
    said: dict[int, str] = {}
    problems = []
    for rename in renames:
        name, sign, text = (part.strip() for part in rename.partition("="))
        hits = [i for i, n in called.items() if fnmatch.fnmatchcase(n, name) or str(i) == name]
        if not (sign and text and hits):
            near = difflib.get_close_matches(name, called.values(), 1)
            known = ", ".join(list(called.values())[:8]) + (", ..." if len(called) > 8 else "")
            fix = f"did you mean {near[0]}?" if near and near[0] != name else f"the objects are {known}"
            expected = "names no object" if sign and text else "is not NAME=TEXT"
            problems += InputError.of("--label", f'"{rename}"', expected, fix).problems
        said |= dict.fromkeys(hits, text)
    if problems:
        raise InputError(problems)
    return [replace(t, label=said[t.id]) if t.id in said else t for t in things], set(said)


def sure(
    found: Found, named: Mapping[int, Name], guessed: Mapping[int, Name], renamed: set[int]
) -> dict[int, float]:
    """How sure each label is: 1 where a person said it, or changed what was guessed."""
    people = found.names if found.called or found.named_by == "given" else {}
    said = {i for i in people if i not in guessed or found.names[i].label != guessed[i].label} | renamed
    return {i: 1.0 if i in said else name.confidence for i, name in named.items()}
