"""Compare a clip with its scene rendered again: motion sample by sample, and what both were made of."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.trajectory import Trajectory
from physgen.text import quoted, rounded

MISSING = object()
FILE_KEYS = {("image",), ("assets",)}
"""Keys of a scene that name files, which are compared by content."""
MAX_VALUE_LENGTH = 60
"""Characters of a value in a message."""
MAX_NAMED = 3
"""Objects or files that a line names; the others are counted."""
TIME_ROUNDING = 1e-9
"""s."""


@dataclass(frozen=True)
class ObjectDifference:
    """How far an object is from where it was, at the first sample at which any bit of its state differs."""

    object: str
    sample: int
    px: float
    degrees: float
    """With the rotation in space of a sphere on a table."""
    most_px: float
    """The largest distance of the clip."""
    most_time: float
    """s."""

    def __str__(self) -> str:
        return f"{self.object} by {rounded(self.px)} px and {rounded(self.degrees)}°"


@dataclass(frozen=True)
class MotionDifference:
    """How two motions differ."""

    sample: int
    """The first that differs."""
    time: float
    """s."""
    samples: tuple[int, int]
    """How many there were, and are."""
    objects: tuple[ObjectDifference, ...] = ()
    """The first to differ first; of those at the same sample, the farthest."""
    gone: tuple[str, ...] = ()
    new: tuple[str, ...] = ()
    unnamed: str = ""
    """Why objects cannot be compared."""

    def text(self) -> str:
        """For a person."""
        before, now = self.samples
        parts = [f"{counted(before, 'sample')} then, {now} now"] if before != now else []
        parts += [f"without {few(self.gone)} now"] if self.gone else []
        parts += [f"with {few(self.new)} now"] if self.new else []
        if self.objects or not parts:
            at_once = [str(item) for item in self.objects if item.sample == self.sample]
            where = f"from sample {self.sample} ({self.time:.3f} s)"
            parts.append(f"{where}: {few(at_once)}" if at_once else where)
        if self.objects:
            far = max(self.objects, key=lambda item: item.most_px)
            most = f"at most {rounded(far.most_px)} px ({far.object} at {far.most_time:.3f} s)"
            parts.append(f"{counted(len(self.objects), 'object')}, {most}")
        return "; ".join([*parts, *([self.unnamed] if self.unnamed else [])])


def motion_difference(then: Trajectory, now: Trajectory) -> MotionDifference | None:
    """None for motions that agree bit by bit. Samples at the same times and objects of the same name are compared."""
    names = [name for name in then.names if name in now.names]
    gone = tuple(name for name in then.names if name not in names)
    new = tuple(name for name in now.names if name not in names)
    counts = len(then.times), len(now.times)
    early = slice(min(counts))
    rows = np.flatnonzero(np.abs(then.times[early] - now.times[early]) <= TIME_ROUNDING)

    def states(motion: Trajectory, field: str) -> NDArray[np.float64]:
        values: NDArray[np.float64] = getattr(motion, field)[rows]
        return values[:, [motion.names.index(name) for name in names]]

    fields = ["poses", "velocities"]
    if then.turns.shape[1] and now.turns.shape[1]:
        fields.append("turns")
    pairs = [(states(then, field), states(now, field)) for field in fields]
    differs = np.any([(a != b).any(axis=-1) for a, b in pairs], axis=0)
    between = pairs[0][1] - pairs[0][0]
    px, degrees = np.hypot(between[..., 0], between[..., 1]), np.degrees(np.abs(between[..., 2]))
    if len(pairs) > 2:  # q and -q are the same rotation
        cosine = np.abs((pairs[2][0] * pairs[2][1]).sum(axis=-1))
        degrees = np.maximum(degrees, 2 * np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0))))
    objects = []
    for k in np.flatnonzero(differs.any(axis=0)).tolist():
        row, top = int(differs[:, k].argmax()), int(px[:, k].argmax())
        most = float(px[top, k]), float(now.times[rows[top]])
        found = ObjectDifference(names[k], int(rows[row]), float(px[row, k]), float(degrees[row, k]), *most)
        objects.append(found)
    objects.sort(key=lambda item: (item.sample, -item.px, item.object))
    if not (objects or gone or new or counts[0] != counts[1] or len(rows) < min(counts)):
        return None
    first = objects[0].sample if objects else 0
    time = float(now.times[first]) if objects else 0.0
    return MotionDifference(first, time, counts, tuple(objects), gone, new)


def changed_values(then: Any, now: Any, path: tuple[str, ...] = ()) -> Iterator[str]:
    """A sentence for each key in which two resolved scenes differ, with both values."""
    if path in FILE_KEYS:
        return
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for key in (*then, *(key for key in now if key not in then)):
            yield from changed_values(then.get(key, MISSING), now.get(key, MISSING), (*path, key))
    elif then != now:
        name = quoted(".".join(path), "", 120)
        if then is MISSING:
            yield f"{name} is {value_text(now)}, was not there"
        elif now is MISSING:
            yield f"{name} is gone, was {value_text(then)}"
        else:
            yield f"{name} is {value_text(now)}, was {value_text(then)}"


def value_text(value: Any) -> str:
    """A value of a scene, shortened."""
    if isinstance(value, Mapping):
        return "a mapping"
    return quoted(json.dumps(value, ensure_ascii=False), "", MAX_VALUE_LENGTH)


def changed_files(then: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    """A sentence for each input file that differs, by hashes."""
    for name in (*then, *(name for name in now if name not in then)):
        if then.get(name) != now.get(name):
            if name not in then:
                change = "is read now, was not"
            else:
                change = "has changed" if name in now else "is not read any more"
            yield f"{quoted(name, '', 80)} {change}"


def changed_environment(then: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    """A sentence for each version or property of the machine that differs, of those that are known of both."""
    for name, value in then.items():
        if name in now and now[name] != value:
            yield f"{name} is {quoted(now[name], '', 200)}, was {quoted(value, '', 200)}"


def few(texts: Sequence[str]) -> str:
    """The first ones, and the number of the others."""
    more = len(texts) - MAX_NAMED
    return ", ".join(texts[:MAX_NAMED]) + (f" and {more} more" if more > 0 else "")


def counted(count: int, noun: str) -> str:
    """A number and its noun."""
    return f"{count} {noun}{'s' * (count != 1)}"
