"""What changed between a recorded run and now: inputs, scene values, versions, machine."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.batch.clips import Manifest
from physgen.batch.golden_files import Made
from physgen.report.record import file_hash, json_text, versions
from physgen.text import quoted

# ----------------------------------------------------------------------
# What a run told of what it read and ran on, and what is there now -> what has changed.

ABSENT = object()
UNCOMPARED = {("image",), ("assets",)}
"""Names of files: their bytes count."""


def changed_files(told: Manifest, inputs: Mapping[str, str]) -> tuple[str, ...]:
    """Files that were read and are not as they were; `inputs` as `report.record.inputs` tells them now."""
    found = []
    for name, digest in told.inputs.items():
        if name not in inputs:
            found.append(f"{name} is not read any more")
        elif inputs[name] != digest:
            found.append(f"{name} has changed")
    return (*found, *(f"{name} is new" for name in inputs if name not in told.inputs))


def changed_values(told: Manifest, document: Mapping[str, Any]) -> tuple[str, ...]:
    """Keys of the resolved scene, with what they are and were."""
    return tuple(_keys(told.document, json.loads(json_text(document)), ()))


def _keys(then: Any, now: Any, path: tuple[str, ...]) -> Iterator[str]:
    """Where two documents differ, the values told."""
    if path in UNCOMPARED:
        return
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for key in (*then, *(key for key in now if key not in then)):
            yield from _keys(then.get(key, ABSENT), now.get(key, ABSENT), (*path, key))
    elif then != now:
        name = ".".join(path)
        if then is ABSENT:
            yield f"{name} is {_shown(now)}, was not there"
        elif now is ABSENT:
            yield f"{name} is gone, was {_shown(then)}"
        else:
            yield f"{name} is {_shown(now)}, was {_shown(then)}"


def _shown(value: Any) -> str:
    if isinstance(value, Mapping):
        return "a mapping"
    return quoted(json.dumps(value, ensure_ascii=False), "", 30)


def elsewhere(told: Manifest, device: str) -> tuple[str, ...]:
    """Versions, machine and device of the run that are not those of this one."""
    now = versions()
    found = [
        f"{name} {number}, not {now[name]}"
        for name, number in told.versions.items()
        if name in now and now[name] != number
    ]
    here = f"{platform.machine()} {platform.system()}"
    if told.machine != here:
        found.append(f"{told.machine}, not {here}")
    if told.device != device:
        found.append(f"{told.device} drawing, not {device}")
    return tuple(found)


def damaged(
    folder: Path, files: Mapping[str, str], progress: Callable[[str, int, int], None]
) -> dict[str, str]:
    """Output files that are not as they were written -> what befell them."""
    found = {}
    for count, (name, digest) in enumerate(files.items(), 1):
        path = folder / name
        if ".." in name.split("/") or Path(name).is_absolute():
            found[name] = "is no file of the clip"
        elif not path.is_file():
            found[name] = "is missing"
        elif file_hash(path) != digest:
            found[name] = "is not as it was written"
        progress("files", count, len(files))
    return found


# ----------------------------------------------------------------------
# What a golden clip was made of, and what the clip is made of now -> what has changed since.

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
        f"the test says {key}={_causes_shown(now.asked.get(key))} now, not {_causes_shown(value)}"
        for key, value in then.asked.items()
        if value != now.asked.get(key)
    ]
    known = then.document is not None and now.document is not None
    if known:
        scene += _causes_keys(then.document, now.document, ())
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


def _causes_keys(then: Any, now: Any, path: tuple[str, ...]) -> Iterator[str]:
    """Where two documents differ, with what is there and was."""
    if path in NAMES:
        return
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for key in (*then, *(key for key in now if key not in then)):
            yield from _causes_keys(then.get(key, ABSENT), now.get(key, ABSENT), (*path, key))
    elif then != now:
        name = quoted(".".join(path), "", 120)
        if then is ABSENT:
            yield f"{name} is {_causes_shown(now)}, was not there"
        elif now is ABSENT:
            yield f"{name} is gone, was {_causes_shown(then)}"
        else:
            yield f"{name} is {_causes_shown(now)}, was {_causes_shown(then)}"


def _causes_shown(value: Any) -> str:
    if isinstance(value, Mapping):
        return "a mapping"
    return quoted(json.dumps(value, ensure_ascii=False), "", 60)
