"""Events for the open windows of the editor.

Windows ask again and again rather than hold a stream open: a browser opens six connections to a server, so that with
as many streams a seventh window would wait for ever.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from physgen.edit.errors import EditError, Why

KEPT = 1000
"""Events that wait for the windows."""
PATIENCE = {False: 5.0, True: 130.0}
"""s without a request after which a window is gone: a visible one, and a hidden one, which browsers slow down."""
MAX_WINDOWS = 200
"""Windows that are counted."""


class Windows:
    """The windows that ask for events; its methods may be called from any thread."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.run = secrets.token_urlsafe(6)
        """Identifies this server: numbers of events start again with each."""
        self._clock = clock
        self._lock = threading.Lock()
        self._events: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._next = 0
        self._gone: dict[str, float] = {}
        """Time at which a window that stops asking counts as gone."""
        self._left: dict[str, float] = {}
        """Time until which a request of a closed window may still arrive."""
        self._count = 0
        self._counted: Callable[[int], None] = lambda count: None

    def counted(self, heard: Callable[[int], None]) -> None:
        """Call `heard` with the number of windows whenever that changes."""
        self._counted = heard

    def count(self) -> int:
        """Number of windows."""
        with self._lock:
            return len(self._gone)

    def send(self, event: dict[str, Any]) -> None:
        """Send an event to all windows."""
        with self._lock:
            self._add(event)

    def ask(self, window: str, run: str, since: int, hidden: bool = False) -> dict[str, Any]:
        """Events since number `since` of a server's `run`; of another run only the number of windows."""
        with self._lock:
            now = self._clock()
            self._left = {name: until for name, until in self._left.items() if until > now}
            if window not in self._left and (window in self._gone or len(self._gone) < MAX_WINDOWS):
                self._gone[window] = now + PATIENCE[hidden]
            self._recount(now)
            if run != self.run:
                events = [{"type": "windows", "windows": self._count}]
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
        if len(self._gone) != self._count:
            self._count = len(self._gone)
            self._counted(self._count)
            self._add({"type": "windows", "windows": self._count})

    def _add(self, event: dict[str, Any]) -> None:
        self._events.append(event)
        self._next += 1


def overtaken() -> EditError:
    """The error of a request about something that a newer one replaced."""
    return EditError(Why.STALE, "a newer request overtook this one", "wait for that one", {"overtaken": True})
