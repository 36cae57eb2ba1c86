"""What a run told of what it read and ran on, and what is there now -> what has changed."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from physgen.batch.verify.told import Told
from physgen.report.record import file_hash, json_text, versions
from physgen.scene.words import quoted

MISSING = object()
UNCOMPARED = {("image",), ("assets",)}
"""Names of files: their bytes count."""


def files(told: Told, inputs: Mapping[str, str]) -> tuple[str, ...]:
    """Files that were read and are not as they were; `inputs` as `report.record.inputs` tells them now."""
    found = []
    for name, digest in told.inputs.items():
        if name not in inputs:
            found.append(f"{name} is not read any more")
        elif inputs[name] != digest:
            found.append(f"{name} has changed")
    return (*found, *(f"{name} is new" for name in inputs if name not in told.inputs))


def values(told: Told, document: Mapping[str, Any]) -> tuple[str, ...]:
    """Keys of the resolved scene, with what they are and were."""
    return tuple(_keys(told.document, json.loads(json_text(document)), ()))


def _keys(then: Any, now: Any, path: tuple[str, ...]) -> Iterator[str]:
    """Where two documents differ, the values told."""
    if path in UNCOMPARED:
        return
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for key in (*then, *(key for key in now if key not in then)):
            yield from _keys(then.get(key, MISSING), now.get(key, MISSING), (*path, key))
    elif then != now:
        name = ".".join(path)
        if then is MISSING:
            yield f"{name} is {_shown(now)}, was not there"
        elif now is MISSING:
            yield f"{name} is gone, was {_shown(then)}"
        else:
            yield f"{name} is {_shown(now)}, was {_shown(then)}"


def _shown(value: Any) -> str:
    if isinstance(value, Mapping):
        return "a mapping"
    return quoted(json.dumps(value, ensure_ascii=False), "", 30)


def elsewhere(told: Told, device: str) -> tuple[str, ...]:
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
