"""Compare two clips: motion sample by sample, pictures pixel by pixel, and what they were made of.

`verify` compares a clip with its scene rendered again, bit by bit; golden tests compare a clip with kept files, within
tolerances. Both use the distances of this module.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from physgen.text import quoted

F64 = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int64]
U8 = NDArray[np.uint8]

MISSING = object()
FILE_KEYS = {("image",), ("assets",)}
"""Keys of a scene that name files, which are compared by content."""
SCENE_SUFFIXES = (".yaml", ".yml", ".json")
MAX_VALUE_LENGTH = 60
"""Characters of a value in a message."""


class SampledMotion(Protocol):
    """Motion of N objects at T samples: a Trajectory, or a golden file's motion."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the objects."""

    @property
    def times(self) -> F64:
        """(T,) s."""

    @property
    def poses(self) -> F64:
        """(T, N, 3): px, px, rad of the centres of mass."""

    @property
    def velocities(self) -> F64 | None:
        """(T, N, 3): px/s, px/s, rad/s; None where they are not kept."""

    @property
    def turns(self) -> F64:
        """(T, N, 4) quaternions of spheres on a table, or (T, 0, 4)."""


@dataclass(frozen=True)
class Distances:
    """How far the objects of two motions are apart, at the samples and for the objects that both have."""

    names: tuple[str, ...]
    gone: tuple[str, ...]
    """Objects of the first motion only."""
    new: tuple[str, ...]
    """Objects of the second motion only."""
    times: F64
    """(T,) s."""
    px: F64
    """(T, N), as all others."""
    rad: F64
    """In the plane of the photo, with whole turns."""
    px_s: F64
    rad_s: F64
    turned: F64
    """rad: rotation of spheres in space."""
    differs: Flags
    """(T, N): whether any bit differs."""

    @cached_property
    def largest(self) -> F64:
        """(T, N): the largest of all amounts."""
        return np.asarray(np.max([self.px, self.rad, self.px_s, self.rad_s, self.turned], axis=0))


def distances(then: SampledMotion, now: SampledMotion, rows: tuple[Index, Index]) -> Distances:
    """Compares the samples of both motions in `rows`, pair by pair."""
    names = tuple(name for name in then.names if name in now.names)
    first, second = ([motion.names.index(name) for name in names] for motion in (then, now))

    def both(one: F64, other: F64) -> tuple[F64, F64]:
        return one[rows[0]][:, first], other[rows[1]][:, second]

    poses = both(then.poses, now.poses)
    between = poses[1] - poses[0]
    differs = _differing_bits(*poses)
    change = np.zeros_like(between)
    if then.velocities is not None and now.velocities is not None:
        velocities = both(then.velocities, now.velocities)
        change = velocities[1] - velocities[0]
        differs = differs | _differing_bits(*velocities)
    turned = np.zeros(differs.shape)
    if names and then.turns.shape[1] == len(then.names) and now.turns.shape[1] == len(now.names):
        turns = both(then.turns, now.turns)
        # q and -q are the same rotation
        near = np.minimum(*(np.linalg.norm(turns[1] - sign * turns[0], axis=-1) for sign in (1, -1)))
        turned = 4 * np.arcsin(np.clip(near / 2, 0.0, 1.0))
        differs = differs | _differing_bits(*turns)
    return Distances(
        names=names,
        gone=tuple(name for name in then.names if name not in names),
        new=tuple(name for name in now.names if name not in names),
        times=now.times[rows[1]],
        px=np.hypot(between[..., 0], between[..., 1]),
        rad=np.abs(between[..., 2]),
        px_s=np.hypot(change[..., 0], change[..., 1]),
        rad_s=np.abs(change[..., 2]),
        turned=turned,
        differs=differs,
    )


def _differing_bits(one: F64, other: F64) -> Flags:
    """(T, N): equal numbers need not have equal bits."""
    different = np.ascontiguousarray(one).view(np.int64) != np.ascontiguousarray(other).view(np.int64)
    return np.asarray(different.any(axis=-1), np.bool_)


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


def changed_files(
    then: Mapping[str, str], now: Mapping[str, str], ignored: tuple[str, ...] = ()
) -> Iterator[str]:
    """A sentence for each input file that differs, by hashes; those with an `ignored` suffix do not count."""
    for name in (*then, *(name for name in now if name not in then)):
        if then.get(name) != now.get(name) and not name.endswith(ignored):
            if name not in then:
                change = "is read now, was not"
            else:
                change = "has changed" if name in now else "is not read any more"
            yield f"{quoted(name, '', 80)} {change}"


def changed_environment(then: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    """A sentence for each version or property of the machine that differs, of those that are known of both."""
    for name, value in then.items():
        if name in now and now[name] != value:
            if name == "sources":
                yield "physgen's own code has changed"
            else:
                yield f"{name} is {quoted(now[name], '', 200)}, was {quoted(value, '', 200)}"


def few(texts: Sequence[str], most: int, separator: str = ", ") -> str:
    """The first ones, and the number of the others."""
    more = len(texts) - most
    return separator.join(texts[:most]) + (f" and {more} more" if more > 0 else "")
