"""What happens -> every window that asks what is new; a window is there as long as it asks.

Asked again and again, not told by a stream that stays open: a browser opens six connections to a server, and with as
many streams a seventh window would wait for ever.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

KEPT = 1000
"""Events that wait for the windows."""
PATIENCE = {False: 5.0, True: 130.0}
"""s without a question after which a window is gone: one that is seen, and a hidden one, which browsers slow down."""
MOST = 200
"""Windows that are counted."""


class Windows:
    """The windows that ask; told from any thread."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.run = secrets.token_urlsafe(6)
        """Another for each server: numbers of events begin anew."""
        self._clock = clock
        self._lock = threading.Lock()
        self._events: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._next = 0
        self._gone: dict[str, float] = {}
        """When a window that asks no more is gone."""
        self._left: dict[str, float] = {}
        """Until when a question of a window that was closed is its last one, which was under way."""
        self._told = 0
        self._counted: Callable[[int], None] = lambda count: None

    def counted(self, heard: Callable[[int], None]) -> None:
        """`heard` is told how many there are whenever that changes."""
        self._counted = heard

    def count(self) -> int:
        """How many there are."""
        with self._lock:
            return len(self._gone)

    def tell(self, event: dict[str, Any]) -> None:
        """Each of them; from any thread."""
        with self._lock:
            self._add(event)

    def ask(self, window: str, run: str, since: int, hidden: bool = False) -> dict[str, Any]:
        """What is new since event `since` of a server's `run`; from another run, only how many windows there are."""
        with self._lock:
            now = self._clock()
            self._left = {name: until for name, until in self._left.items() if until > now}
            if window not in self._left and (window in self._gone or len(self._gone) < MOST):
                self._gone[window] = now + PATIENCE[hidden]
            self._recount(now)
            if run != self.run:
                events = [{"type": "windows", "windows": self._told}]
            else:
                old = max(since - (self._next - len(self._events)), 0)
                events = list(self._events)[old:]
            return {"run": self.run, "next": self._next, "events": events}

    def leave(self, window: str) -> None:
        """A window that was closed."""
        with self._lock:
            now = self._clock()
            self._gone.pop(window, None)
            self._left[window] = now + PATIENCE[False]
            self._recount(now)

    def _recount(self, now: float) -> None:
        self._gone = {name: until for name, until in self._gone.items() if until > now}
        if len(self._gone) != self._told:
            self._told = len(self._gone)
            self._counted(self._told)
            self._add({"type": "windows", "windows": self._told})

    def _add(self, event: dict[str, Any]) -> None:
        self._events.append(event)
        self._next += 1
