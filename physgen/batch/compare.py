"""Compare two clips: motion sample by sample, pictures pixel by pixel, and what they were made of.

`verify` compares a clip with its scene rendered again, bit by bit; golden tests compare a clip with kept files, within
tolerances. Both use the differences of this module.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.batch.tolerances import Motion
from physgen.simulate.trajectory import Trajectory
from physgen.text import quoted

F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]

MISSING = object()
FILE_KEYS = {("image",), ("assets",)}
"""Keys of a scene that name files, which are compared by content."""
MAX_VALUE_LENGTH = 60
"""Characters of a value in a message."""
MAX_NAMED = 3
"""Objects or files that a line names; the others are counted."""
TIME_ROUNDING = 1e-9
"""s."""
ROUNDING = 1 + 1e-9
"""Factor of tolerances: 30 units of 0.01 are 0.3."""
UNITS = {"px": " px", "degrees": "°", "px_per_s": " px/s", "degrees_per_s": "°/s"}
"""Of the tolerances of Motion, as written after a number."""


@dataclass(frozen=True)
class Samples:
    """Motion of N objects at T samples."""

    names: tuple[str, ...]
    times: F64
    """(T,) s."""
    poses: F64
    """(T, N, 3): px, px, rad of the centres of mass."""
    turns: F64
    """(T, N, 4) quaternions of spheres on a table, or (T, 0, 4)."""
    velocities: F64 | None
    """(T, N, 3): px/s, px/s, rad/s; None where they are not kept."""

    @classmethod
    def of(cls, trajectory: Trajectory, until: float | None = None) -> Samples:
        """The motion of a clip, up to a time, s, if one is given."""
        times = trajectory.times
        end = (
            len(times) if until is None else int(np.searchsorted(times, until + TIME_ROUNDING, side="right"))
        )
        return cls(
            trajectory.names,
            times[:end],
            trajectory.poses[:end],
            trajectory.turns[:end],
            trajectory.velocities[:end],
        )


@dataclass(frozen=True)
class ObjectDifference:
    """How far an object is from where it was, at the first sample at which it is too far."""

    object: str
    sample: int
    time: float
    """s."""
    amounts: Mapping[str, float]
    """By the names of the tolerances of Motion: those that are too large."""
    most_px: float
    """The largest distance of the clip."""
    most_time: float
    """s."""

    def __str__(self) -> str:
        amounts = [f"{number(value)}{UNITS[key]}" for key, value in self.amounts.items()]
        return f"{self.object} by {' and '.join(amounts) or 'less than a digit'}"


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
    """Those that are too far, the first to be so first; of those at the same sample, the farthest."""
    compared: int = 0
    """Number of objects that both have."""
    gone: tuple[str, ...] = ()
    new: tuple[str, ...] = ()
    retimed: bool = False
    """Samples are at other times."""
    unnamed: str = ""
    """Why objects cannot be compared."""

    def text(self) -> str:
        """For a person."""
        parts = []
        before, now = self.samples
        if before != now:
            parts.append(f"{counted(before, 'sample')} then, {now} now")
        if self.gone:
            parts.append(f"without {few(self.gone)} now")
        if self.new:
            parts.append(f"with {few(self.new)} now")
        if self.retimed:
            parts.append("samples are at other times now")
        if self.objects or not parts:
            where = f"from sample {self.sample} ({self.time:.3f} s)"
            at_once = [str(item) for item in self.objects if item.sample == self.sample]
            parts.append(f"{where}: {few(at_once)}" if at_once else where)
        if self.objects:
            far = max(self.objects, key=lambda item: item.most_px)
            most = f"at most {number(far.most_px)} px ({far.object} at {far.most_time:.3f} s)"
            parts.append(f"{len(self.objects)} of {self.compared} objects, {most}")
        return "; ".join([*parts, *([self.unnamed] if self.unnamed else [])])


def motion_difference(then: Samples, now: Samples, allowed: Motion | None = None) -> MotionDifference | None:
    """None for motions that agree: within what is `allowed`, or bit by bit. Common samples and objects are compared."""
    names = tuple(name for name in then.names if name in now.names)
    gone, new = set(then.names) - set(names), set(now.names) - set(names)
    rows = np.flatnonzero(
        np.abs(then.times[: len(now.times)] - now.times[: len(then.times)]) <= TIME_ROUNDING
    )
    amounts, differs = _amounts(then, now, names, rows)
    excess = amounts["px"]
    limits: dict[str, float] = {}
    if allowed is not None:
        limits = {key: limit for key in amounts if (limit := getattr(allowed, key)) is not None}
        excess = np.max([amounts[key] / limit for key, limit in limits.items()], axis=0)
        differs = excess > ROUNDING
    objects = []
    for k in np.flatnonzero(differs.any(axis=0)).tolist():
        row, top = int(differs[:, k].argmax()), int(amounts["px"][:, k].argmax())
        there = {
            key: value
            for key, amount in amounts.items()
            if (value := float(amount[row, k])) > limits.get(key, 0.0 if allowed is None else np.inf)
        }
        most = float(amounts["px"][top, k]), float(now.times[rows[top]])
        item = ObjectDifference(names[k], int(rows[row]), float(now.times[rows[row]]), there, *most)
        objects.append((row, -excess[row, k], names[k], item))
    ordered = tuple(item for *_, item in sorted(objects, key=lambda entry: entry[:3]))
    counts = len(then.times), len(now.times)
    retimed = len(rows) < min(counts)
    if not (ordered or gone or new or retimed or counts[0] != counts[1]):
        return None
    first = ordered[0] if ordered else None
    return MotionDifference(
        sample=0 if first is None else first.sample,
        time=0.0 if first is None else first.time,
        samples=counts,
        objects=ordered,
        compared=len(names),
        gone=tuple(name for name in then.names if name in gone),
        new=tuple(name for name in now.names if name in new),
        retimed=retimed,
    )


def _amounts(
    then: Samples, now: Samples, names: Sequence[str], rows: NDArray[np.int64]
) -> tuple[dict[str, F64], NDArray[np.bool_]]:
    """(R, N) each, by the names of the tolerances of Motion; and where any bit differs."""
    first, second = ([motion.names.index(name) for name in names] for motion in (then, now))

    def both(one: F64, other: F64) -> tuple[F64, F64]:
        return one[rows][:, first], other[rows][:, second]

    pairs = [both(then.poses, now.poses)]
    between = pairs[0][1] - pairs[0][0]
    change, turned = np.zeros_like(between), np.zeros(between.shape[:2])
    if then.velocities is not None and now.velocities is not None:
        pairs.append(both(then.velocities, now.velocities))
        change = pairs[-1][1] - pairs[-1][0]
    if names and then.turns.shape[1] == len(then.names) and now.turns.shape[1] == len(now.names):
        pairs.append(both(then.turns, now.turns))
        one, other = pairs[-1]
        # q and -q are the same rotation
        near = np.minimum(*(np.linalg.norm(other - sign * one, axis=-1) for sign in (1, -1)))
        turned = 4 * np.arcsin(np.clip(near / 2, 0.0, 1.0))
    differs = np.any([(one != other).any(axis=-1) for one, other in pairs], axis=0)
    amounts = {
        "px": np.hypot(between[..., 0], between[..., 1]),
        "degrees": np.degrees(np.maximum(np.abs(between[..., 2]), turned)),
        "px_per_s": np.hypot(change[..., 0], change[..., 1]),
        "degrees_per_s": np.degrees(np.abs(change[..., 2])),
    }
    return amounts, differs


def level_differences(then: U8, now: U8) -> U8 | None:
    """(H, W, 3) grey levels by which two pictures differ; None where their sizes do."""
    if then.shape != now.shape:
        return None
    return np.asarray(np.abs(now.astype(np.int16) - then), np.uint8)


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


def few(texts: Sequence[str], most: int = MAX_NAMED, separator: str = ", ") -> str:
    """The first ones, and the number of the others."""
    more = len(texts) - most
    return separator.join(texts[:most]) + (f" and {more} more" if more > 0 else "")


def counted(count: int, noun: str) -> str:
    """A number and its noun."""
    return f"{count} {noun}{'s' * (count != 1)}"


def number(value: float) -> str:
    """Three digits.

    >>> [number(v) for v in (0.0, 0.123456, 41.26, 12345.6)]
    ['0', '0.123', '41.3', '12346']
    """
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
