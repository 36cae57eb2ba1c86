"""One editing session: the scene's state for the page, edits, undo, redo and saving, safe to call from any thread."""

from __future__ import annotations

import logging
import shutil
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.edit.document import Document
from physgen.edit.errors import EditError, Why
from physgen.edit.history import State
from physgen.edit.live import Live
from physgen.edit.operations import edited
from physgen.edit.picture import Pictures, photo_png
from physgen.edit.yaml_edit import without_guess_comments
from physgen.edit.yaml_tree import marked
from physgen.files import Stamp, file_stamp

# ----------------------------------------------------------------------
# A file -> told when another program wrote it, removed it or brought it back.

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
        self._seen = file_stamp(path)

    def run(self) -> None:
        """Until `end`."""
        before: Stamp = self._seen
        failed = False
        while not self._ended.wait(LOOK):
            now = file_stamp(self._path)
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


# ----------------------------------------------------------------------
# The doors of the page: each answers for the one scene that is edited, one edit at a time, from any thread.

Data = dict[str, Any]
Tell = Callable[[Data], None]
"""Hears what every window is to be told: `{"type": "version", ...}`."""


@dataclass(frozen=True)
class EditRequest:
    """A request for an edit: of which version, in which variant, and what it is called in the history."""

    version: int
    variant: str | None = None
    what: str = ""
    tag: str | None = None
    id: str | None = None
    """Its own; one that is sent again, as its answer was lost, is not made twice."""


class Session:
    """Edits one file. Raises InputError where it cannot be opened, BusyError where another editor has it."""

    def __init__(self, path: Path, allow_outside: bool = False, tell: Tell = lambda event: None) -> None:
        self.path, self.allow_outside = path, allow_outside
        self._tell = tell
        self._edits = threading.RLock()
        self._windows = 0
        self._names: list[str] = []
        self._unread = False
        """Whether another program changed the file, and that could not be taken in yet."""
        self.document = Document(path, allow_outside)
        self.live = Live(path, allow_outside)
        self.pictures = Pictures(self.live)
        self._watch = Watch(self.document.real, self._look_outside)
        self._watch.start()

    @property
    def recovered(self) -> bool:
        """Whether it goes on with what an editor left that ended before it was saved."""
        return self.document.recovered

    def close(self) -> Path | None:
        """End; the draft's folder where something in it is not saved."""
        self._watch.end()
        with self._edits:
            return self.document.close()

    # What there is

    def state(self, variant: str | None = None) -> Data:
        """The State of the interface."""
        with self._edits:
            now, told = self.document.now, self._told(variant)
            maps = self.document.maps(now)
        look = self.live.look(now.text, maps, variant)
        return told | {
            "problems": look.problems,
            "todo": look.todo,
            "scene": look.scene,
            "derived": look.derived,
            "motion": look.motion,
            "picture": look.picture,
            "made": None,
        }

    def _told(self, variant: str | None) -> Data:
        """The part of a State that needs no look at the scene."""
        history = self.document.history
        return {
            "version": history.version,
            "id": self.document.ids[-1] if self.document.ids else None,
            "file": {
                "name": self.path.name,
                "folder": str(self.path.absolute().parent),
                "saved": self.document.is_saved,
                "outside": "unread" if self._unread else self.document.outside,
                "recovered": self.document.recovered,
            },
            "windows": self._windows,
            "text": history.now.text,
            "variant": variant,
            "variants": self.variants(),
            "undo": history.undo,
            "redo": history.redo,
        }

    def variants(self) -> list[str]:
        """Names of the variants; of a text with errors, those that it had before."""
        try:
            node = marked(self.document.now.text).child("variants")
        except EditError:
            return self._names
        self._names = [key for key, _, _ in node.keys] if node is not None and node.is_map else []
        return self._names

    def photo(self) -> bytes:
        """PNG of the photo. Raises InputError."""
        text, maps = self._present()
        return photo_png(self.live.state(text, maps, None))

    def mask(self, variant: str | None, name: str) -> bytes:
        """PNG of the photo's size: 255 where an object is. Raises EditError."""
        from physgen.edit.corrections import mask_png

        text, maps = self._present()
        return mask_png(self.live, text, maps, name, variant)

    def _present(self) -> tuple[str, Path | None]:
        with self._edits:
            return self.document.now.text, self.document.maps(self.document.now)

    # Edits

    def edit(self, asked: EditRequest, ops: Sequence[Mapping[str, Any]]) -> Data:
        """Operations, all or none. Raises EditError."""
        with self._edits:
            if self._is_new(asked):
                now = self._current(asked)
                made = edited(now.text, ops, asked.variant, self.path, self.allow_outside)
                text = (
                    made.text
                    if asked.variant
                    else without_guess_comments(made.text, [op.get("set", ()) for op in ops])
                )
                self._push(asked, State(text, now.maps, asked.what or made.what))
        return self._answer(asked)

    def preview(self, asked: EditRequest, ops: Sequence[Mapping[str, Any]]) -> Data:
        """The motion that operations would give; nothing is kept. Raises EditError."""
        with self._edits:
            now = self._current(asked)
            maps = self.document.maps(now)
        made = edited(now.text, ops, asked.variant, self.path, self.allow_outside)
        look = self.live.preview(made.text, maps, asked.variant)
        return {"motion": look.motion, "problems": look.problems}

    def write(self, asked: EditRequest, text: str) -> Data:
        """Another text, right or wrong. Raises EditError."""
        with self._edits:
            if self._is_new(asked):
                now = self._current(asked)
                self._push(
                    asked, State(self.document.with_line_ends(text), now.maps, asked.what or "edit the YAML")
                )
        return self._answer(asked)

    def correct(self, asked: EditRequest, op: Mapping[str, Any]) -> Data:
        """A mask made right, and what follows of it. Raises EditError."""
        from physgen.edit.corrections import correct

        with self._edits:
            if not self._is_new(asked):
                return self._answer(asked)
            self._current(asked)
            self.document.restore_draft()
            now, draft = self.document.now, self.document.draft
            self.document.note_maps()
            number, maps = draft.new_maps(), self.document.maps(now)
        out = draft.maps(number)
        try:
            made = correct(self.live, now.text, maps, dict(op), out)  # which may take seconds
        except Exception:
            with self._edits:
                self._current(asked)  # of a state that is gone the maps may be, too
            raise
        with self._edits:
            try:
                self._current(asked)
                if draft.is_gone():
                    raise EditError(Why.STALE, "the draft was removed meanwhile", "do it again")
                if out.is_dir():
                    draft.keep_maps(out)
                kept = number if out.is_dir() else now.maps
                self._push(asked, State(made.text, kept, asked.what or made.what))
            except BaseException:
                shutil.rmtree(out, ignore_errors=True)
                raise
        return self._answer(asked) | {"made": made.made}

    def step(self, asked: EditRequest, by: int) -> Data:
        """Undo (-1) or redo (1). Raises EditError."""
        with self._edits:
            if self._is_new(asked):
                self._current(asked)
                self.document.step(by, asked.id)
                self._changed()
        return self._answer(asked)

    def save(self, asked: EditRequest, resolve: str | None = None) -> Data:
        """Write the file. Raises EditError where another program wrote it, too, and `resolve` does not settle it."""
        with self._edits:
            self._current(asked)
            self._save(resolve)
        return self._answer(asked)

    def save_for_rendering(self, version: int | None) -> None:
        """What is rendered is what is seen: the file is written first. Raises EditError."""
        with self._edits:
            if version is not None:
                self._current(EditRequest(version))
            if not self.document.is_saved:
                self._save(None)

    def _save(self, resolve: str | None) -> None:
        try:
            self.document.save(resolve)
        finally:
            self._changed()  # what another program wrote may be taken in though the file is not written

    def _answer(self, asked: EditRequest) -> Data:
        """The state after an edit, given out when the edit is on the disk. Raises OSError."""
        return self.state(asked.variant)

    def _is_new(self, asked: EditRequest) -> bool:
        return asked.id is None or asked.id not in self.document.ids

    def _current(self, asked: EditRequest) -> State:
        version = self.document.history.version
        if asked.version != version:
            message = f"version {asked.version} is not the present one, {version}"
            fix = "ask for the state and edit again"
            raise EditError(Why.STALE, message, fix, {"version": version})
        return self.document.now

    def _push(self, asked: EditRequest, state: State) -> None:
        now = self.document.now
        if (state.text, state.maps) != (now.text, now.maps):
            tag = None if asked.tag is None else f"{asked.variant or ''} {asked.tag}"
            self.document.push(State(state.text, state.maps, state.what, tag, asked.id))
            self._changed()

    # What happens

    def count_windows(self, count: int) -> None:
        """How many windows look."""
        self._windows = count

    def _changed(self) -> None:
        saved = self.document.is_saved
        self._tell({"type": "version", "version": self.document.history.version, "saved": saved})

    def _look_outside(self) -> None:
        with self._edits:
            before, self._unread = self._unread, True
            version = self.document.history.version
            try:
                outcome = self.document.look_outside()
            except Exception:
                if not before:
                    self._tell({"type": "file", "outcome": "failed", "version": version})
                raise
            self._unread = False
            version = self.document.history.version
        if outcome is not None or before:
            self._tell({"type": "file", "outcome": outcome or "read", "version": version})
