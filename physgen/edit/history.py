"""States of an edited scene in order, with undo and redo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

PAUSE = 5.0
"""s after which an edit is a step of its own, whatever its tag."""
MOST = 1000
"""Steps that can be undone; the eldest are forgotten."""


@dataclass(frozen=True)
class State:
    """All that an edit changes: the file's text, and which copy of its maps goes with it."""

    text: str
    maps: int = 0
    """Number of the folder of maps in the draft; 0: those that the scene had at the beginning."""
    what: str = ""
    """What led here, as a person reads it: `push cue-ball`."""
    tag: str | None = None
    """Edits in a row with the same tag are one step, unless one was saved or a while passed."""
    id: str | None = None
    """Of the request that made it: one that is sent again is not made twice."""
    time: float = 0.0
    """s since 1970."""


@dataclass(frozen=True)
class _Left:
    """A state that is not now, without its text: how that differs from the state that is nearer to now."""

    state: State
    change: Sequence[Any]


class History:
    """The states, which of them is now, and a version that counts every change of that."""

    def __init__(self, first: State, version: int = 1) -> None:
        self._past: list[_Left] = []
        self._now = first
        self._future: list[_Left] = []
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
        """A new state; what was undone before is forgotten. Of a tag seen last, the step grows."""
        self._future.clear()
        if self._past and self._grows(state):
            left = _recalled(self._now, self._past.pop())
            state = replace(state, what=state.what or self._now.what)
        else:
            left = self._now
        self._past.append(_left(left, state))
        del self._past[: max(0, len(self._past) - MOST)]
        self._now = state
        self.version += 1

    def _grows(self, state: State) -> bool:
        alike = state.tag is not None and self._now.tag == state.tag
        return alike and state.time - self._now.time < PAUSE

    def end_step(self) -> None:
        """The next edit is a step of its own."""
        self._now = replace(self._now, tag=None)

    def can(self, by: int) -> bool:
        """Whether there is a state to step to."""
        return bool(self._past if by == -1 else self._future if by == 1 else False)

    def step(self, by: int) -> None:
        """One back (-1) or on (1), which is there. A step that was undone does not grow."""
        source, other = (self._past, self._future) if by < 0 else (self._future, self._past)
        state = _recalled(self._now, source.pop())
        other.append(_left(self._now, state))
        self._now = replace(state, tag=None)
        self.version += 1

    def states(self) -> tuple[list[State], int]:
        """All that can be reached, the eldest first, and which of them is now."""
        past, future = [self._now], [self._now]
        for left in reversed(self._past):
            past.append(_recalled(past[-1], left))
        for left in reversed(self._future):
            future.append(_recalled(future[-1], left))
        return [*reversed(past), *future[1:]], len(self._past)

    def mend(self, has: Callable[[State], bool], maps: int) -> None:
        """States whose maps are lost have others."""

        def mended(state: State) -> State:
            return state if has(state) else replace(state, maps=maps)

        self._now = mended(self._now)
        for part in (self._past, self._future):
            part[:] = [_Left(mended(left.state), left.change) for left in part]

    def maps(self) -> frozenset[int]:
        """Which copies of maps can be reached."""
        return frozenset(
            state.maps for state in (self._now, *(left.state for left in (*self._past, *self._future)))
        )


def _left(state: State, nearer: State) -> _Left:
    return _Left(replace(state, text=""), difference(nearer.text, state.text))


def _recalled(nearer: State, left: _Left) -> State:
    return replace(left.state, text=patched(nearer.text, left.change))


def difference(old: str, new: str) -> list[Any]:
    """Where two texts part, how much of the old goes, and what comes.

    >>> difference("a: 1", "a: 12"), patched("a: 1", [4, 0, "2"])
    ([4, 0, '2'], 'a: 12')
    """
    head = _alike(old, new)
    tail = _alike(old[head:][::-1], new[head:][::-1])
    return [head, len(old) - head - tail, new[head : len(new) - tail]]


def patched(old: str, change: Sequence[Any]) -> str:
    """The new text again. Raises ValueError where the change is none of this text."""
    at, cut, text = change
    if not (isinstance(text, str) and 0 <= at <= at + cut <= len(old)):
        raise ValueError("not of this text")
    return old[:at] + text + old[at + cut :]


def _alike(one: str, other: str) -> int:
    """Characters that both begin with: halves are compared, as that is fast."""
    low, high = 0, min(len(one), len(other))
    while low < high:
        middle = (low + high + 1) // 2
        if one[low:middle] == other[low:middle]:
            low = middle
        else:
            high = middle - 1
    return low
