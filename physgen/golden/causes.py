"""What a golden clip was made of, and what the clip is made of now -> what has changed since."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from physgen.golden.taking import Made
from physgen.scene.words import quoted

MISSING = object()
NAMES = {("image",), ("assets",)}
"""Keys that name files, whose bytes count."""
TEXTS = (".yaml", ".yml", ".json")
"""Of scene files: what they mean counts."""


@dataclass(frozen=True)
class Causes:
    """Sentences, each about one thing that is not as it was."""

    scene: tuple[str, ...]
    """In the scene, what the test asks of it, or the files that it reads."""
    versions: tuple[str, ...]
    """Of physgen, Python and libraries."""
    machine: tuple[str, ...]


def causes(then: Made, now: Made) -> Causes:
    """Compare; what the scene file says counts by its meaning, so that comments and the order of keys do not."""
    scene = [
        f"the test says {key}={_shown(now.asked.get(key))} now, not {_shown(value)}"
        for key, value in then.asked.items()
        if value != now.asked.get(key)
    ]
    known = then.document is not None and now.document is not None
    if known:
        scene += _keys(then.document, now.document, ())
    for name in (*then.inputs, *(name for name in now.inputs if name not in then.inputs)):
        if then.inputs.get(name) != now.inputs.get(name) and not (known and name.endswith(TEXTS)):
            how = "has changed" if name in now.inputs else "is not read any more"
            scene.append(f"{quoted(name, '', 80)} {how if name in then.inputs else 'is read now, was not'}")
    versions = [
        "physgen's own code has changed"
        if name == "sources"
        else f"{name} is {now.versions.get(name)}, was {number}"
        for name, number in then.versions.items()
        if now.versions.get(name) != number
    ]
    machine = [
        f"the {what} is {quoted(str(now.machine.get(key)), '', 200)}, was {quoted(str(then.machine.get(key)), '', 200)}"
        for key, what in (
            ("kind", "processor"),
            ("system", "system"),
            ("instructions", "processor's set of instructions"),
        )
        if then.machine.get(key) != now.machine.get(key)
    ]
    return Causes(tuple(scene), tuple(versions), tuple(machine))


def _keys(then: Any, now: Any, path: tuple[str, ...]) -> Iterator[str]:
    """Where two documents differ, with what is there and was."""
    if path in NAMES:
        return
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for key in (*then, *(key for key in now if key not in then)):
            yield from _keys(then.get(key, MISSING), now.get(key, MISSING), (*path, key))
    elif then != now:
        name = quoted(".".join(path), "", 120)
        if then is MISSING:
            yield f"{name} is {_shown(now)}, was not there"
        elif now is MISSING:
            yield f"{name} is gone, was {_shown(then)}"
        else:
            yield f"{name} is {_shown(now)}, was {_shown(then)}"


def _shown(value: Any) -> str:
    if isinstance(value, Mapping):
        return "a mapping"
    return quoted(json.dumps(value, ensure_ascii=False), "", 60)
