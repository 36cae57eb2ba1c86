"""A file -> told when another program wrote it, removed it or brought it back."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from pathlib import Path

from physgen.whole import Stamp, stamped

_log = logging.getLogger(__name__)

LOOK = 0.1
"""s between looks; a file that was written is read when it stayed the same for one."""


class Watch(threading.Thread):
    """Looks at one file until it is ended; `changed` is called in this thread, after each change.

    Where `changed` raises, that is told once on stderr, and the same change is looked at again until it is taken.
    """

    def __init__(self, path: Path, changed: Callable[[], None]) -> None:
        super().__init__(name="watch", daemon=True)
        self._path, self._changed = path, changed
        self._ended = threading.Event()
        self._seen = stamped(path)

    def run(self) -> None:
        """Until `end`."""
        before: Stamp = self._seen
        failed = False
        while not self._ended.wait(LOOK):
            now = stamped(self._path)
            if now != self._seen and now == before:
                try:
                    self._changed()
                except Exception as error:  # a full disk, say
                    if not failed:
                        _log.warning("%s: was changed, and could not be taken in: %s", self._path, error)
                    failed = True
                else:
                    self._seen, failed = now, False
            before = now

    def end(self) -> None:
        """No further call once this returns."""
        self._ended.set()
        if self.is_alive() and threading.current_thread() is not self:
            self.join()
