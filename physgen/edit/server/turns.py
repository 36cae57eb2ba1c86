"""Of what one window asks again and again only the newest is worked out."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar

from physgen.edit.refusing import EditError, Why

T = TypeVar("T")


class Turns:
    """Which preview of a window is its newest: one that was overtaken is not worked out."""

    def __init__(self) -> None:
        self._newest: dict[str, int] = {}
        self._lock = threading.Lock()
        self._working = threading.Lock()

    def take(self, window: str) -> int:
        """A turn."""
        with self._lock:
            while window not in self._newest and len(self._newest) > 100:
                del self._newest[next(iter(self._newest))]
            self._newest[window] = turn = self._newest.get(window, 0) + 1
            return turn

    def when_newest(self, window: str, turn: int, work: Callable[[], T]) -> T:
        """The work done, or EditError where a newer turn was taken meanwhile."""
        with self._working:
            if self._newest.get(window) != turn:
                raise overtaken()
            return work()


def overtaken() -> EditError:
    """A newer request of the same window took its place."""
    return EditError(Why.STALE, "a newer request overtook this one", "wait for that one", {"overtaken": True})
