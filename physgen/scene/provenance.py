"""Where each number of a scene comes from: a flag, a variant, an estimate, the file or a default."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from physgen.problems import Place
from physgen.scene.scene import Scene

_SURE = re.compile(r"^(.*?)\s*(?<![\d.])(0(?:\.\d+)?|1(?:\.0+)?)$")
"""Who, and a confidence in 0..1 behind it: `table 0.4`."""


@dataclass(frozen=True)
class Source:
    """Where a number comes from."""

    kind: str
    """`flag`, `variant`, `guess`, `file` or `default`; `worked out` where nobody says it."""
    text: str
    sure: float | None = None
    """0..1."""


def source(said: str) -> Source:
    """What `from` says of a number.

    >>> source("table 0.4")
    Source(kind='guess', text='table', sure=0.4)
    """
    match = _SURE.match(said.strip())
    if match is None or not match[1]:
        return Source("guess", said)
    return Source("guess", match[1], float(match[2]))


class Provenance:
    """Who said the value of a key."""

    def __init__(self, scene: Scene, variant: str | None) -> None:
        self._scene = scene
        start = f"variants.{variant}"
        self._edited = {
            place for key, place in scene.places.items() if variant is not None and key.startswith(start)
        }
        self._variant = variant
        root = scene.places.get("", Place(""))
        self._file = root.file

    def of(self, path: str, provenance: str | None, *, told: str | None = None, near: bool = False) -> Source:
        """Who said what was said last: the value at `path`, or the `provenance` that stands at the path `told`.

        With `near`, a value that is written nowhere by itself stands where what it belongs to does.
        """
        place = self._scene.places.get(path)
        if place is None and near:
            place = self._scene.place(path)
        if provenance is not None and self._counts(place, None if told is None else self._scene.place(told)):
            return source(provenance)
        if place is None:
            return Source("default", "default")
        if not place.line:
            return Source("flag", "--set")
        if place in self._edited:
            return Source("variant", f"variant {self._variant}")
        name = Path(place.file).name
        return Source(
            "file", f"line {place.line}" if place.file == self._file else f"{name}, line {place.line}"
        )

    def _counts(self, value: Place | None, told: Place | None) -> bool:
        """Whether a number is still the one that `from` told of: nobody wrote it anew in a later place."""
        if value is None or told is None:
            return value is None or self._rank(value) < 2
        if self._rank(value) == self._rank(told) == 0:
            return (
                value.file == told.file
            )  # of the files that are extended, which comes later is not known here
        return self._rank(value) <= self._rank(told)

    def _rank(self, place: Place) -> int:
        """Flags are read after variants, those after the file, and that after what it extends."""
        if not place.line:
            return 3
        if place in self._edited:
            return 2
        return 1 if place.file == self._file else 0
