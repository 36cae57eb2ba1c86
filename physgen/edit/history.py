"""States of an edited scene in order, with undo and redo."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import asdict, dataclass, replace
from typing import Any

PAUSE = 5.0
"""s after which an edit is a step of its own, whatever its tag."""
MAX_STEPS = 1000
"""Steps that can be undone; the oldest are forgotten."""


@dataclass(frozen=True)
class State:
    """What an edit changes: the file's text, and which copy of its maps belongs to it."""

    text: str
    maps: int = 0
    """Number of the folder of maps in the draft; 0: the scene's own."""
    what: str = ""
    """The edit that led here, for the undo button: `push cue-ball`."""
    tag: str | None = None
    """Consecutive edits with the same tag are one step, unless one was saved or a pause passed."""
    id: str | None = None
    """Of the request that made it: a request that is sent again is not carried out twice."""
    time: float = 0.0
    """s since 1970."""


@dataclass(frozen=True)
class _Stored:
    """A state without its text, and the change that makes its text of that of the state next to it, nearer to now."""

    state: State
    change: Sequence[Any]


class History:
    """The states, which of them is present, and a version that counts all changes of that."""

    def __init__(self, first: State, version: int = 1) -> None:
        self._past: list[_Stored] = []
        self._now = first
        self._future: list[_Stored] = []
        self.version = version

    @property
    def now(self) -> State:
        """The present state."""
        return self._now

    @property
    def undo(self) -> str | None:
        """What would be undone; None at the beginning."""
        return self._now.what if self._past else None

    @property
    def redo(self) -> str | None:
        """What would be done again; None at the end."""
        return self._future[-1].state.what if self._future else None

    def push(self, state: State) -> None:
        """Add a state; what was undone before is forgotten. With the tag of the present state, its step grows."""
        self._future.clear()
        if self._past and self._extends_step(state):
            before = _recalled(self._now, self._past.pop())
            state = replace(state, what=state.what or self._now.what)
        else:
            before = self._now
        self._past.append(_stored(before, state))
        del self._past[: max(0, len(self._past) - MAX_STEPS)]
        self._now = state
        self.version += 1

    def _extends_step(self, state: State) -> bool:
        alike = state.tag is not None and self._now.tag == state.tag
        return alike and state.time - self._now.time < PAUSE

    def end_step(self) -> None:
        """Make the next edit a step of its own."""
        self._now = replace(self._now, tag=None)

    def can(self, by: int) -> bool:
        """Whether there is a state to step to."""
        return bool(self._past if by == -1 else self._future if by == 1 else False)

    def step(self, by: int) -> None:
        """Go one state back (-1) or forward (1)."""
        source, other = (self._past, self._future) if by < 0 else (self._future, self._past)
        state = _recalled(self._now, source.pop())
        other.append(_stored(self._now, state))
        self._now = replace(state, tag=None)
        self.version += 1

    def replace_maps(self, has: Callable[[State], bool], maps: int) -> None:
        """Give the states whose maps are lost others."""

        def mended(state: State) -> State:
            return state if has(state) else replace(state, maps=maps)

        self._now = mended(self._now)
        for part in (self._past, self._future):
            part[:] = [_Stored(mended(one.state), one.change) for one in part]

    def maps(self) -> frozenset[int]:
        """Numbers of the copies of maps that can be reached."""
        others = (one.state for one in (*self._past, *self._future))
        return frozenset(state.maps for state in (self._now, *others))

    def copy(self) -> History:
        """The same states, independent of later changes of this history."""
        made = copy(self)
        made._past, made._future = list(self._past), list(self._future)
        return made

    def as_data(self) -> dict[str, Any]:
        """For the draft."""
        past, future = (
            [[asdict(one.state), one.change] for one in part] for part in (self._past, self._future)
        )
        return {"version": self.version, "now": asdict(self._now), "past": past, "future": future}

    @staticmethod
    def from_data(data: Mapping[str, Any]) -> History:
        """The history of a draft. Raises KeyError, TypeError or ValueError where the data is none."""
        made = History(State(**data["now"]), int(data["version"]))
        made._past, made._future = (
            [_Stored(State(**state), change) for state, change in data[part]] for part in ("past", "future")
        )
        return made


def _stored(state: State, nearer: State) -> _Stored:
    return _Stored(replace(state, text=""), difference(nearer.text, state.text))


def _recalled(nearer: State, stored: _Stored) -> State:
    return replace(stored.state, text=patched(nearer.text, stored.change))


def difference(old: str, new: str) -> list[Any]:
    """Where two texts part, how many characters of the old one go, and what replaces them.

    >>> difference("a: 1", "a: 12"), patched("a: 1", [4, 0, "2"])
    ([4, 0, '2'], 'a: 12')
    """
    head = _alike(old, new)
    tail = _alike(old[head:][::-1], new[head:][::-1])
    return [head, len(old) - head - tail, new[head : len(new) - tail]]


def patched(old: str, change: Sequence[Any]) -> str:
    """The new text of a difference."""
    at, cut, text = change
    return old[:at] + str(text) + old[at + cut :]


def _alike(one: str, other: str) -> int:
    """Number of characters with which both begin, by bisection."""
    low, high = 0, min(len(one), len(other))
    while low < high:
        middle = (low + high + 1) // 2
        if one[low:middle] == other[low:middle]:
            low = middle
        else:
            high = middle - 1
    return low
