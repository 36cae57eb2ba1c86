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

_log = logging.getLogger(__name__)

WATCH_INTERVAL = 0.1
"""s between looks at the file; a change is read when the file stayed the same for one."""

Data = dict[str, Any]
Send = Callable[[Data], None]
"""Sends an event to all windows: `{"type": "version", ...}`."""


@dataclass(frozen=True)
class EditRequest:
    """A request for an edit: the version and the variant it is about, and its name in the history."""

    version: int
    variant: str | None = None
    what: str = ""
    tag: str | None = None
    id: str | None = None
    """Of the request: one that is sent again, as its answer was lost, is not carried out twice."""


LOOK_KEYS = ("problems", "todo", "scene", "derived", "motion", "picture")


class Session:
    """Edits one file, one edit at a time.

    Raises InputError where the file cannot be opened, BusyError where another editor has it.
    """

    def __init__(self, path: Path, allow_outside: bool = False, send: Send = lambda event: None) -> None:
        self.path, self.allow_outside = path, allow_outside
        self._send = send
        self._edits = threading.RLock()
        self._windows = 0
        self._names: list[str] = []
        self._unread = False
        """Whether another program changed the file, and that could not be read yet."""
        self.document = Document(path, allow_outside)
        self.live = Live(path, allow_outside)
        self.pictures = Pictures(self.live)
        self._watch = Watch(self.document.real, self._look_outside)
        self._watch.start()

    @property
    def recovered(self) -> bool:
        """Whether it continues a draft that was not saved."""
        return self.document.recovered

    def close(self) -> Path | None:
        """End. Returns the draft's folder where something is not saved."""
        self._watch.end()
        with self._edits:
            return self.document.close()

    def state(self, variant: str | None = None) -> Data:
        """What the page shows; see `api.State`."""
        with self._edits:
            document, history = self.document, self.document.history
            now, maps = document.now, document.maps(document.now)
            known: Data = {
                "version": history.version,
                "id": document.ids[-1] if document.ids else None,
                "file": {
                    "name": self.path.name,
                    "folder": str(self.path.absolute().parent),
                    "saved": document.is_saved,
                    "outside": "unread" if self._unread else document.outside,
                    "recovered": document.recovered,
                },
                "windows": self._windows,
                "text": now.text,
                "variant": variant,
                "variants": self.variants(),
                "undo": history.undo,
                "redo": history.redo,
                "made": None,
            }
        look = self.live.look(now.text, maps, variant)
        return known | {name: getattr(look, name) for name in LOOK_KEYS}

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

    def edit(self, request: EditRequest, ops: Sequence[Mapping[str, Any]]) -> Data:
        """Make operations, all or none. Raises EditError."""
        with self._edits:
            if self._is_new(request):
                now = self._current(request)
                made = edited(now.text, ops, request.variant, self.path, self.allow_outside)
                text = made.text
                if not request.variant:
                    text = without_guess_comments(text, [op.get("set", ()) for op in ops])
                self._push(request, State(text, now.maps, request.what or made.what))
        return self.state(request.variant)

    def preview(self, request: EditRequest, ops: Sequence[Mapping[str, Any]]) -> Data:
        """The motion that operations would give, without making them. Raises EditError."""
        with self._edits:
            now = self._current(request)
            maps = self.document.maps(now)
        made = edited(now.text, ops, request.variant, self.path, self.allow_outside)
        look = self.live.look(made.text, maps, request.variant, motion_only=True)
        return {"motion": look.motion, "problems": look.problems}

    def write(self, request: EditRequest, text: str) -> Data:
        """Replace the text, by a valid one or not. Raises EditError."""
        with self._edits:
            if self._is_new(request):
                now = self._current(request)
                text = self.document.with_line_ends(text)
                self._push(request, State(text, now.maps, request.what or "edit the YAML"))
        return self.state(request.variant)

    def correct(self, request: EditRequest, op: Mapping[str, Any]) -> Data:
        """Correct a mask, and what follows from it. Raises EditError."""
        from physgen.edit.corrections import correct

        with self._edits:
            if not self._is_new(request):
                return self.state(request.variant)
            self._current(request)
            self.document.restore_draft()
            now, draft = self.document.now, self.document.draft
            self.document.note_maps()
            number, maps = draft.new_maps(), self.document.maps(now)
        out = draft.maps(number)
        try:
            made = correct(self.live, now.text, maps, dict(op), out)  # which may take seconds
        except Exception:
            with self._edits:
                self._current(request)  # the maps of a state that is gone may be gone, too
            raise
        with self._edits:
            try:
                self._current(request)
                if draft.is_gone():
                    raise EditError(Why.STALE, "the draft was removed meanwhile", "do it again")
                if out.is_dir():
                    draft.keep_maps(out)
                kept = number if out.is_dir() else now.maps
                self._push(request, State(made.text, kept, request.what or made.what))
            except BaseException:
                shutil.rmtree(out, ignore_errors=True)
                raise
        return self.state(request.variant) | {"made": made.made}

    def step(self, request: EditRequest, by: int) -> Data:
        """Undo (-1) or redo (1). Raises EditError."""
        with self._edits:
            if self._is_new(request):
                self._current(request)
                self.document.step(by, request.id)
                self._changed()
        return self.state(request.variant)

    def save(self, request: EditRequest, resolve: str | None = None) -> Data:
        """Write the file; `resolve` says whose text stands where another program changed it, too. Raises EditError."""
        with self._edits:
            self._current(request)
            self._save(resolve)
        return self.state(request.variant)

    def save_for_rendering(self, version: int | None) -> None:
        """Write the file, so that what is rendered is what the page shows. Raises EditError."""
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

    def _is_new(self, request: EditRequest) -> bool:
        return request.id is None or request.id not in self.document.ids

    def _current(self, request: EditRequest) -> State:
        version = self.document.history.version
        if request.version != version:
            message = f"version {request.version} is not the present one, {version}"
            fix = "ask for the state and edit again"
            raise EditError(Why.STALE, message, fix, {"version": version})
        return self.document.now

    def _push(self, request: EditRequest, state: State) -> None:
        now = self.document.now
        if (state.text, state.maps) != (now.text, now.maps):
            tag = None if request.tag is None else f"{request.variant or ''} {request.tag}"
            self.document.push(State(state.text, state.maps, state.what, tag, request.id))
            self._changed()

    def count_windows(self, count: int) -> None:
        """Note the number of open windows."""
        self._windows = count

    def _changed(self) -> None:
        saved = self.document.is_saved
        self._send({"type": "version", "version": self.document.history.version, "saved": saved})

    def _look_outside(self) -> None:
        with self._edits:
            before, self._unread = self._unread, True
            version = self.document.history.version
            try:
                outcome = self.document.look_outside()
            except Exception:
                if not before:
                    self._send({"type": "file", "outcome": "failed", "version": version})
                raise
            self._unread = False
            version = self.document.history.version
        if outcome is not None or before:
            self._send({"type": "file", "outcome": outcome or "read", "version": version})


class Watch(threading.Thread):
    """Watches one file until `end`; `changed` is called in this thread, after each change.

    Where `changed` raises, that is logged once, and it is called again for the same change until it succeeds.
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
        while not self._ended.wait(WATCH_INTERVAL):
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
