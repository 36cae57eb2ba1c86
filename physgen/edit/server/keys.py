"""Keys that open the page one time: an address that a browser is started with is read by all of the machine."""

from __future__ import annotations

import secrets
import threading

MOST = 100
"""Keys that wait; the eldest are void."""


class Keys:
    """Those that were made and not used."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[str] = []

    def made(self) -> str:
        """A new one."""
        key = secrets.token_urlsafe(24)
        with self._lock:
            self._waiting = [*self._waiting[-MOST + 1 :], key]
        return key

    def used(self, key: str) -> bool:
        """Whether it was good; it is no more."""
        with self._lock:
            found = [one for one in self._waiting if secrets.compare_digest(one.encode(), key.encode())]
            self._waiting = [one for one in self._waiting if one not in found]
        return bool(found)
