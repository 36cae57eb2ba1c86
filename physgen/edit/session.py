"""One editing session of a scene file: states, edits, undo, redo and saving;
thread-safe.
"""

from __future__ import annotations

import codecs
import os
import shutil
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from physgen.edit.corrections import correct
from physgen.edit.draft import Draft, DraftContent, draft_folder
from physgen.edit.live import Live
from physgen.edit.masks import PromptSegmenter
from physgen.edit.operations import Body, Op, SetOp, apply_operations, to_integer
from physgen.edit.pictures import Pictures, mask_png, photo_png
from physgen.edit.view_change import hold_objects
from physgen.files import back_up, file_stamp, write_atomic
from physgen.messages import Message
from physgen.problems import EditError, EditRefusal, InputError, Limit
from physgen.scene.document import decode
from physgen.scene.files import scene_bytes
from physgen.scene.yaml_comments import without_comments
from physgen.scene.yaml_edit import mark_values

PAUSE = 5.0
"""Pause, s, after which an edit is a step of its own in spite of its tag."""
MAX_STEPS = 200
"""Number of steps for undo; older steps are removed."""
BY_OTHERS = "changed by another program"
"""Name in the history for a state written by another program."""
LOOK_KEYS = {
    "problems": "problems",
    "todo": "todo",
    "scene": "scene",
    "derived": "derived_data",
    "motion": "motion",
    "picture": "picture",
    "doubtful": "doubtful",
    "perceived": "perception",
}
"""Key of the page -> field of a Look."""

MAX_WORDS = 200
"""Maximum number of characters of names and of titles of edits."""

Data = dict[str, Any]
Words = Annotated[str, Field(max_length=MAX_WORDS)]
Send = Callable[[Data], None]
"""Sends an event to all pages: `{"type": "version", ...}`."""


@dataclass(frozen=True)
class State:
    """The file's text after an edit. Corrections write maps into new folders, which the
    text names.
    """

    text: str
    title: str = ""
    """The edit that led here, for the undo button: `push cue-ball`."""
    tag: str | None = None
    """Consecutive edits with the same tag are one step, unless the file was saved or
    `PAUSE` passed in between.
    """
    time: float = 0.0  # s since 1970


class History:
    """The list of states, the index of the present state, and a version.

    The version counts all changes of the present state.
    """

    def __init__(self, states: Sequence[State]) -> None:
        self._states = list(states)
        self._at = len(self._states) - 1
        self.version = 1

    @property
    def current_state(self) -> State:
        """Return the present state."""
        return self._states[self._at]

    @property
    def undo(self) -> str | None:
        """Return the title of the edit to undo; None at the beginning."""
        if self._at:
            return self.current_state.title
        return None

    @property
    def redo(self) -> str | None:
        """Return the title of the edit to redo; None at the end."""
        if self._at + 1 < len(self._states):
            return self._states[self._at + 1].title
        return None

    def push(self, state: State) -> None:
        """Add a state after the present one, and remove the undone states.

        A state with the tag of the present state replaces it, so that both are one
        step.
        """
        has_same_tag = (
            state.tag is not None
            and self.current_state.tag == state.tag
            and self._at > 0
        )
        if has_same_tag and state.time - self.current_state.time < PAUSE:
            self._at -= 1
        self._states[self._at + 1 :] = [state]
        del self._states[: -MAX_STEPS - 1]
        self._at = len(self._states) - 1
        self.version += 1

    def neighbour(self, offset: int) -> State:
        """Return the state before (-1) or after (1) the present one. Raises
        EditError.
        """
        if not 0 <= self._at + offset < len(self._states):
            raise Message.NOTHING_TO_UNDO.impossible(
                step="undo" if offset < 0 else "redo"
            )
        return self._states[self._at + offset]

    def step(self, offset: int) -> None:
        """Move to the state before (-1) or after (1) the present one."""
        self._at += offset
        self.end_step()
        self.version += 1

    def end_step(self) -> None:
        """Remove the tag of the present state, so that the next edit is a step of its
        own.
        """
        self._states[self._at] = replace(self.current_state, tag=None)


class EditRequest(Body):
    """A request for an edit: its version and variant, and its title for the history."""

    version: Annotated[
        int, Field(strict=True, ge=0, le=2**53 - 1), BeforeValidator(to_integer)
    ]
    variant: Words | None = None
    title: Words | None = Field(default=None, alias="what")
    tag: Words | None = None


class Session:
    """Edits one file, one edit at a time.

    Raises InputError if the file cannot be opened, BusyError if another editor has it.
    """

    def __init__(
        self, path: Path, allow_outside: bool = False, send: Send = lambda event: None
    ) -> None:
        self.path = path
        self.allow_outside = allow_outside
        self.is_new = False
        """True if the photo was perceived for this session; the page then says so."""
        self.real = Path(os.path.realpath(path))
        self._send = send
        self._edits = threading.RLock()
        self._names: list[str] = []
        self._segmenter = PromptSegmenter()
        self.outside: str | None = None
        """Unresolved change of the file by another program: `changed` or `gone`."""
        # If the file was removed, the text is still in the draft.
        is_removed = (
            not self.real.exists() and (draft_folder(path) / "draft.json").is_file()
        )
        if is_removed:
            data = b""
        else:
            data = scene_bytes(path, str(path))
        text = decode(data, str(path))
        # The saved file keeps its byte order mark and its kind of line breaks.
        self._bom = data.startswith(codecs.BOM_UTF8)
        self._crlf = "\r\n" in text
        self.draft = Draft(path)
        try:
            draft = self.draft.load()
        except InputError:
            self.draft.release()
            raise
        self.saved_text = text
        """Content of the file when it was read or written last."""
        states = [State(text)]
        self._folders: list[str] = []
        # The first state is the file, the second the draft: undo restores the file.
        if draft is not None and draft.text != draft.saved_text:
            self.saved_text = draft.saved_text
            self._folders = draft.folders
            states = [
                State(draft.saved_text if is_removed else text),
                State(draft.text, "the edits of last time"),
            ]
        self.history = History(states)
        self._look_outside()
        self.recovered = not self.is_saved
        """True if the session continues the draft of an editor that did not end
        cleanly.
        """
        self.live = Live(path, allow_outside)
        self.pictures = Pictures(self.live)
        self._stamp = self._read = file_stamp(self.real)

    @property
    def current_state(self) -> State:
        """Return the present state."""
        return self.history.current_state

    @property
    def is_saved(self) -> bool:
        """Check whether the file contains the present state."""
        return self._check_unchanged and self.outside != "gone"

    @property
    def _check_unchanged(self) -> bool:
        """Check whether the present text equals the saved one."""
        return self.current_state.text == self.saved_text

    def close(self) -> Path | None:
        """Close the session; return the draft's folder if it has unsaved changes."""
        with self._edits:
            # Remove the maps of corrections that neither the file nor the draft refers
            # to.
            for name in self._folders:
                if name not in self.saved_text and (
                    self.is_saved or name not in self.current_state.text
                ):
                    shutil.rmtree(self.path.with_name(name), ignore_errors=True)
            self.draft.close(keep=not self.is_saved)
            if self.is_saved:
                return None
            return self.draft.folder

    # The contents of the page

    def state(self, variant: str | None = None) -> Data:
        """Return the data of the page for the present state, in a variant or in the
        file itself.
        """
        with self._edits:
            history = self.history
            text = self.current_state.text
            session_data: Data = {
                "version": history.version,
                "file": {
                    "name": self.path.name,
                    "folder": str(self.path.absolute().parent),
                    "saved": self.is_saved,
                    "outside": self.outside,
                    "recovered": self.recovered,
                },
                "text": text,
                "variant": variant,
                "variants": self.variants(),
                "undo": history.undo,
                "redo": history.redo,
                "made": None,
                "corrected": None,
            }
        # Simulation takes long and must not block edits: it runs outside the lock.
        look = self.live.look(text, variant)
        look_data: Data = {}
        for key, field in LOOK_KEYS.items():
            look_data[key] = getattr(look, field)
        if look_data["perceived"] is not None:
            look_data["perceived"] = look_data["perceived"] | {"new": self.is_new}
        return session_data | look_data

    def variants(self) -> list[str]:
        """List the names of the variants; for a text with errors, the names before the
        errors.
        """
        try:
            node = mark_values(self.current_state.text).child("variants")
        except EditError:
            return self._names
        if node is not None:
            self._names = [key for key, _, _ in node.keys]
        else:
            self._names = []
        return self._names

    def photo(self) -> bytes:
        """Return the photo as a PNG. Raises InputError."""
        return photo_png(self.live.state(self.current_state.text))

    def mask(self, variant: str | None, name: str) -> bytes:
        """Return the mask of an object as a PNG of the photo's size, 0 or 255. Raises
        EditError.
        """
        return mask_png(self.live.state(self.current_state.text, variant), name)

    # Edits

    def edit(self, request: EditRequest, ops: Sequence[Op | Mapping[str, Any]]) -> Data:
        """Apply operations, all or none. Raises EditError."""
        with self._edits:
            present_state = self._current(request)
            edit_result = apply_operations(present_state.text, ops, request.variant)
            text = edit_result.text
            # Comments of perception about changed values are no longer true. A text
            # with errors keeps its comments, since its record cannot be read.
            with suppress(InputError):
                own_comments: frozenset[str] = frozenset()
                if not request.variant:
                    present_scene = self.live.state(present_state.text).scene
                    own_comments = present_scene.record.comments
                text = without_comments(
                    text, [op.set for op in ops if isinstance(op, SetOp)], own_comments
                )
            title = edit_result.title
            # After a change of the view, objects would fall without new supports.
            change = hold_objects(self.live, present_state.text, text, request.variant)
            if change is not None:
                text = change.text
                title = f"{request.title or title}: {change.changes}"
                request = request.model_copy(update={"title": None})
            self._push(request, text, title)
        return self.state(request.variant)

    def preview(
        self, request: EditRequest, ops: Sequence[Op | Mapping[str, Any]]
    ) -> Data:
        """Return the motion after operations, without applying them. Raises
        EditError.
        """
        with self._edits:
            text = self._current(request).text
        edit_result = apply_operations(text, ops, request.variant)
        look = self.live.look(edit_result.text, request.variant, motion_only=True)
        return {"motion": look.motion, "problems": look.problems}

    def write(self, request: EditRequest, text: str) -> Data:
        """Replace the text; it may contain errors. Raises EditError."""
        with self._edits:
            self._current(request)
            text = text.removeprefix("\ufeff")
            # Text fields of a page have no carriage returns: restore those of the file.
            if self._crlf and "\r" not in text:
                text = text.replace("\n", "\r\n")
            self._push(request, text, "edit the YAML")
        return self.state(request.variant)

    def correct(self, request: EditRequest, op: Mapping[str, Any]) -> Data:
        """Apply a correction of a mask, and change the values that follow. Raises
        EditError.
        """
        with self._edits:
            correction = correct(
                self.live, self._current(request).text, op, self._segmenter
            )
            if correction.folder is not None:
                self._folders.append(correction.folder.name)
            try:
                self._push(request, correction.text, correction.title)
            except BaseException:
                if correction.folder is not None:
                    shutil.rmtree(correction.folder, ignore_errors=True)
                raise
        outcome = {"made": correction.new_name, "corrected": correction.changed_name}
        return self.state(request.variant) | outcome

    def step(self, request: EditRequest, offset: int) -> Data:
        """Undo (-1) or redo (1) one step. Raises EditError."""
        with self._edits:
            self._current(request)
            # Store first: if the disk is full, the history stays.
            self._store(self.history.neighbour(offset))
            self.history.step(offset)
            self._send_new_version()
        return self.state(request.variant)

    def _current(self, request: EditRequest) -> State:
        """Return the present state. Raises EditError if the request is about an older
        version.
        """
        version = self.history.version
        if request.version != version:
            message = f"version {request.version} is not the present one, {version}"
            fix = "ask for the state and edit again"
            raise EditError(EditRefusal.STALE, message, fix, {"version": version})
        return self.current_state

    def _push(self, request: EditRequest, text: str, title: str) -> None:
        """Add a state with a changed text. Raises EditError if the text is too
        large.
        """
        if text == self.current_state.text:
            return
        if len(text.encode()) > Limit.BYTES.most:
            limit = Limit.BYTES
            message = f"the file would be {limit.expected}"
            raise EditError(EditRefusal.TOO_LARGE, message, limit.fix, code=limit.code)
        if request.tag is None:
            tag = None
        else:
            tag = f"{request.variant or ''} {request.tag}"
        self._add(State(text, request.title or title, tag, time.time()))
        self._send_new_version()

    def _add(self, state: State) -> None:
        """Store a state and add it to the history. Raises OSError; the state is not
        added then.
        """
        self._store(state)
        self.history.push(state)

    def _store(self, state: State) -> None:
        """Store a state in the draft, before the request is answered."""
        self.draft.store(
            DraftContent(
                text=state.text, saved_text=self.saved_text, folders=self._folders
            )
        )

    def _send_new_version(self) -> None:
        """Send the new version to all pages."""
        self._send(
            {"type": "version", "version": self.history.version, "saved": self.is_saved}
        )

    # The file

    def save(self, request: EditRequest, resolve: str | None = None) -> Data:
        """Write the file. Raises EditError.

        `resolve` chooses `mine` or `theirs` if another program changed the file.
        """
        with self._edits:
            self._current(request)
            self._save(resolve)
        return self.state(request.variant)

    def save_for_rendering(self, version: int | None) -> None:
        """Write the file, so that the rendered scene is the one on the page. Raises
        EditError.
        """
        with self._edits:
            if version is not None:
                self._current(EditRequest(version=version))
            if not self.is_saved:
                self._save(None)

    def _save(self, resolve: str | None) -> None:
        """Write the present text, after a comparison with the text on the disk."""
        try:
            disk_text = self._read_file_text()
        except EditError:
            if resolve != "mine":
                raise
            # The file is not text and cannot be a state of the history: copy it to
            # NAME~ before it is overwritten.
            back_up(self.real)
            disk_text = None
        if resolve == "theirs":
            self._take(disk_text)
        else:
            if disk_text is not None and disk_text != self.saved_text:
                if resolve is None:
                    self.outside = "changed"
                    message = "another program changed the file"
                    raise EditError(
                        EditRefusal.STALE,
                        message,
                        "reload it, or overwrite it",
                        {"conflict": True},
                    )
                # Their text becomes the state before mine: one undo restores it.
                own_state = self.current_state
                self._add(State(disk_text, BY_OTHERS))
                self._add(
                    replace(
                        own_state, title="keep mine over another program's", tag=None
                    )
                )
            data = (
                codecs.BOM_UTF8 if self._bom else b""
            ) + self.current_state.text.encode()
            write_atomic(self.real, data, durable=True)
            self._set_saved(self.current_state.text)
        self._send_new_version()

    def _take(self, text: str | None) -> None:
        """Set the text on the disk as the newest state. Raises EditError."""
        if text is None:
            raise Message.FILE_REMOVED.impossible()
        if text != self.current_state.text:
            self._add(State(text, BY_OTHERS))
        self._set_saved(text)

    def _set_saved(self, text: str) -> None:
        """Record the text of the file as saved, and remove the draft."""
        self.saved_text = text
        self.outside = None
        self.history.end_step()
        self.draft.remove()

    def look_outside(self) -> None:
        """Compare the file with the disk; called with each poll of a page.

        A change by another program is used once the file is the same in two calls,
        since the program may still be writing.
        """
        if not self._edits.acquire(blocking=False):
            return  # an edit is in progress: the next call compares again
        try:
            before = self._stamp
            self._stamp = file_stamp(self.real)
            if self._stamp == self._read or self._stamp != before:
                return
            outcome = self._look_outside()
            self._read = self._stamp
            if outcome is not None:
                self._send(
                    {
                        "type": "file",
                        "outcome": outcome,
                        "version": self.history.version,
                    }
                )
        except OSError:  # for example a full disk: the next call tries again
            pass
        finally:
            self._edits.release()

    def _look_outside(self) -> str | None:
        """Compare the file with the disk, and use its text if nothing was edited here.

        Returns `taken`, `clash`, `gone`, or None for no change.
        """
        try:
            disk_text = self._read_file_text()
        except EditError:
            self.outside = "changed"
            return "clash"
        before = self.outside
        if disk_text is None:
            self.outside = "gone"
            if before != "gone":
                return "gone"
            return None
        # Another program may restore the saved text, which ends a clash.
        if disk_text == self.saved_text:
            self.outside = None
            if before is not None:
                return "taken"
            return None
        if self._check_unchanged and before is None:
            self._take(disk_text)
            return "taken"
        self.outside = "changed"
        return "clash"

    def _read_file_text(self) -> str | None:
        """Read the text of the file; None if the file was removed.

        Raises EditError if the content is not text.
        """
        try:
            with open(self.real, "rb") as stream:
                return decode(stream.read(Limit.BYTES.most + 1), str(self.path))
        except FileNotFoundError:
            return None
        except (InputError, OSError):
            message = "another program wrote something that is no scene into the file"
            raise EditError(
                EditRefusal.STALE, message, "put the file right, then save"
            ) from None
