"""One editing session of a scene file: its states, edits, undo, redo and saving, safe to call from any thread."""

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
from physgen.edit.draft import Draft, Unsaved, draft_folder
from physgen.edit.live import Live, Pictures, mask_png, photo_png
from physgen.edit.masks import PromptSegmenter
from physgen.edit.operations import Body, Op, SetOp, edited, whole
from physgen.edit.view_change import hold_objects
from physgen.files import back_up, file_stamp, write_atomic
from physgen.messages import Message
from physgen.problems import EditError, InputError, Limit, Why
from physgen.scene.document import decode
from physgen.scene.files import scene_bytes
from physgen.scene.yaml_comments import without_comments
from physgen.scene.yaml_edit import mark_values

PAUSE = 5.0
"""s after which an edit is a step of its own, whatever its tag."""
MAX_STEPS = 200
"""Steps that can be undone; the oldest are forgotten."""
BY_OTHERS = "changed by another program"
"""What the history calls a state that another program wrote."""
LOOK_KEYS = (
    "problems",
    "todo",
    "scene",
    "derived",
    "motion",
    "picture",
    "doubtful",
    "perceived",
)

MAX_WORDS = 200
"""Characters of names, and of what an edit is called."""

Data = dict[str, Any]
Words = Annotated[str, Field(max_length=MAX_WORDS)]
Send = Callable[[Data], None]
"""Sends an event to all pages: `{"type": "version", ...}`."""


@dataclass(frozen=True)
class State:
    """The file's text after an edit. Corrections write maps into new folders, which the text names."""

    text: str
    what: str = ""
    """The edit that led here, for the undo button: `push cue-ball`."""
    tag: str | None = None
    """Consecutive edits with the same tag are one step, unless one was saved or a pause passed."""
    time: float = 0.0  # s since 1970


class History:
    """The states, which of them is present, and a version that counts all changes of that."""

    def __init__(self, states: Sequence[State]) -> None:
        self._states = list(states)
        self._at = len(self._states) - 1
        self.version = 1

    @property
    def now(self) -> State:
        """The present state."""
        return self._states[self._at]

    @property
    def undo(self) -> str | None:
        """What would be undone; None at the beginning."""
        return self.now.what if self._at else None

    @property
    def redo(self) -> str | None:
        """What would be done again; None at the end."""
        return (
            self._states[self._at + 1].what
            if self._at + 1 < len(self._states)
            else None
        )

    def push(self, state: State) -> None:
        """Add a state; what was undone before is forgotten. With the tag of the present state, its step grows."""
        alike = state.tag is not None and self.now.tag == state.tag and self._at > 0
        if alike and state.time - self.now.time < PAUSE:
            self._at -= 1
        self._states[self._at + 1 :] = [state]
        del self._states[: -MAX_STEPS - 1]
        self._at = len(self._states) - 1
        self.version += 1

    def beside(self, by: int) -> State:
        """The state before (-1) or after (1) the present one. Raises EditError."""
        if not 0 <= self._at + by < len(self._states):
            raise Message.NOTHING_TO_UNDO.impossible(step="undo" if by < 0 else "redo")
        return self._states[self._at + by]

    def step(self, by: int) -> None:
        """Go to the state `beside`."""
        self._at += by
        self.end_step()
        self.version += 1

    def end_step(self) -> None:
        """Make the next edit a step of its own."""
        self._states[self._at] = replace(self.now, tag=None)


class EditRequest(Body):
    """A request for an edit: the version and the variant it is about, and its name in the history."""

    version: Annotated[
        int, Field(strict=True, ge=0, le=2**53 - 1), BeforeValidator(whole)
    ]
    variant: Words | None = None
    what: Words | None = None
    tag: Words | None = None


class Session:
    """Edits one file, one edit at a time.

    Raises InputError where the file cannot be opened, BusyError where another editor has it.
    """

    def __init__(
        self, path: Path, allow_outside: bool = False, send: Send = lambda event: None
    ) -> None:
        self.path, self.allow_outside = path, allow_outside
        self.is_new = False
        """Whether the photo was perceived for this session, and the page says so."""
        self.real = Path(os.path.realpath(path))
        self._send = send
        self._edits = threading.RLock()
        self._names: list[str] = []
        self._segmenter = PromptSegmenter()
        self.outside: str | None = None
        """`changed` or `gone`: what another program did to the file, where that is still to be resolved."""
        gone = not self.real.exists() and (draft_folder(path) / "draft.json").is_file()
        data = b"" if gone else scene_bytes(path, str(path))  # the draft still holds it
        text = decode(data, str(path))
        self._bom, self._crlf = data.startswith(codecs.BOM_UTF8), "\r\n" in text
        self.draft = Draft(path)
        try:
            found = self.draft.load()
        except InputError:
            self.draft.release()
            raise
        self.saved = text
        """What the file held when it was read or written last."""
        states = [State(text)]
        self._folders: list[str] = []
        if found is not None and found.text != found.saved:
            self.saved, self._folders = found.saved, found.folders
            states = [
                State(found.saved if gone else text),
                State(found.text, "the edits of last time"),
            ]
        self.history = History(states)
        self._look_outside()
        self.recovered = not self.is_saved
        """Whether it continues what an editor left that ended before everything was saved."""
        self.live = Live(path, allow_outside)
        self.pictures = Pictures(self.live)
        self._stamp = self._read = file_stamp(self.real)

    @property
    def now(self) -> State:
        """The present state."""
        return self.history.now

    @property
    def is_saved(self) -> bool:
        """Whether the file holds the present state."""
        return self._nothing_made and self.outside != "gone"

    @property
    def _nothing_made(self) -> bool:
        return self.now.text == self.saved

    def close(self) -> Path | None:
        """End. Returns the draft's folder where something is not saved."""
        with self._edits:
            for name in self._folders:
                if name not in self.saved and (
                    self.is_saved or name not in self.now.text
                ):
                    shutil.rmtree(self.path.with_name(name), ignore_errors=True)
            self.draft.close(keep=not self.is_saved)
            return None if self.is_saved else self.draft.folder

    # What the page shows

    def state(self, variant: str | None = None) -> Data:
        """All that the page shows of the present state, in a variant or in the file itself."""
        with self._edits:
            history = self.history
            text = self.now.text
            known: Data = {
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
        look = self.live.look(text, variant)
        shown: Data = {name: getattr(look, name) for name in LOOK_KEYS}
        if shown["perceived"] is not None:
            shown["perceived"] = shown["perceived"] | {"new": self.is_new}
        return known | shown

    def variants(self) -> list[str]:
        """Names of the variants; of a text with errors, those that it had before."""
        try:
            node = mark_values(self.now.text).child("variants")
        except EditError:
            return self._names
        self._names = [key for key, _, _ in node.keys] if node is not None else []
        return self._names

    def photo(self) -> bytes:
        """PNG of the photo. Raises InputError."""
        return photo_png(self.live.state(self.now.text))

    def mask(self, variant: str | None, name: str) -> bytes:
        """PNG of the photo's size: 255 where an object is. Raises EditError."""
        return mask_png(self.live.state(self.now.text, variant), name)

    # Edits

    def edit(self, request: EditRequest, ops: Sequence[Op | Mapping[str, Any]]) -> Data:
        """Make operations, all or none. Raises EditError."""
        with self._edits:
            now = self._current(request)
            made = edited(now.text, ops, request.variant)
            text = made.text
            with suppress(InputError):  # a text with errors keeps its comments
                ours = (
                    frozenset()
                    if request.variant
                    else self.live.state(now.text).scene.record.comments
                )
                text = without_comments(
                    text, [op.set for op in ops if isinstance(op, SetOp)], ours
                )
            what = made.what
            change = hold_objects(self.live, now.text, text, request.variant)
            if change is not None:
                text, what = change.text, f"{request.what or what}: {change.what}"
                request = request.model_copy(update={"what": None})
            self._push(request, text, what)
        return self.state(request.variant)

    def preview(
        self, request: EditRequest, ops: Sequence[Op | Mapping[str, Any]]
    ) -> Data:
        """The motion that operations would give, without making them. Raises EditError."""
        with self._edits:
            text = self._current(request).text
        made = edited(text, ops, request.variant)
        look = self.live.look(made.text, request.variant, motion_only=True)
        return {"motion": look.motion, "problems": look.problems}

    def write(self, request: EditRequest, text: str) -> Data:
        """Replace the text, by a valid one or not. Raises EditError."""
        with self._edits:
            self._current(request)
            text = text.removeprefix("\ufeff")
            if (
                self._crlf and "\r" not in text
            ):  # fields of a page have no carriage returns
                text = text.replace("\n", "\r\n")
            self._push(request, text, "edit the YAML")
        return self.state(request.variant)

    def correct(self, request: EditRequest, op: Mapping[str, Any]) -> Data:
        """Correct a mask, and what follows from it. Raises EditError."""
        with self._edits:
            made = correct(self.live, self._current(request).text, op, self._segmenter)
            if made.folder is not None:
                self._folders.append(made.folder.name)
            try:
                self._push(request, made.text, made.what)
            except BaseException:
                if made.folder is not None:
                    shutil.rmtree(made.folder, ignore_errors=True)
                raise
        outcome = {"made": made.made, "corrected": made.corrected}
        return self.state(request.variant) | outcome

    def step(self, request: EditRequest, by: int) -> Data:
        """Undo (-1) or redo (1). Raises EditError."""
        with self._edits:
            self._current(request)
            self._store(self.history.beside(by))
            self.history.step(by)
            self._changed()
        return self.state(request.variant)

    def _current(self, request: EditRequest) -> State:
        version = self.history.version
        if request.version != version:
            message = f"version {request.version} is not the present one, {version}"
            fix = "ask for the state and edit again"
            raise EditError(Why.STALE, message, fix, {"version": version})
        return self.now

    def _push(self, request: EditRequest, text: str, what: str) -> None:
        if text == self.now.text:
            return
        if len(text.encode()) > Limit.BYTES.most:
            limit = Limit.BYTES
            message = f"the file would be {limit.expected}"
            raise EditError(Why.TOO_LARGE, message, limit.fix, code=limit.code)
        tag = None if request.tag is None else f"{request.variant or ''} {request.tag}"
        self._add(State(text, request.what or what, tag, time.time()))
        self._changed()

    def _add(self, state: State) -> None:
        """A new state. Raises OSError: then it is not added."""
        self._store(state)
        self.history.push(state)

    def _store(self, state: State) -> None:
        """Write a state to the draft before it is answered."""
        self.draft.store(
            Unsaved(text=state.text, saved=self.saved, folders=self._folders)
        )

    def _changed(self) -> None:
        self._send(
            {"type": "version", "version": self.history.version, "saved": self.is_saved}
        )

    # The file

    def save(self, request: EditRequest, resolve: str | None = None) -> Data:
        """Write the file; `resolve` chooses `mine` or `theirs` where another program changed it. Raises EditError."""
        with self._edits:
            self._current(request)
            self._save(resolve)
        return self.state(request.variant)

    def save_for_rendering(self, version: int | None) -> None:
        """Write the file, so that what is rendered is what the page shows. Raises EditError."""
        with self._edits:
            if version is not None:
                self._current(EditRequest(version=version))
            if not self.is_saved:
                self._save(None)

    def _save(self, resolve: str | None) -> None:
        try:
            theirs = self._theirs()
        except EditError:
            if resolve != "mine":
                raise
            back_up(self.real)  # as NAME~: it cannot be a step of the history
            theirs = None
        if resolve == "theirs":
            self._take(theirs)
        else:
            if theirs is not None and theirs != self.saved:
                if resolve is None:
                    self.outside = "changed"
                    message = "another program changed the file"
                    raise EditError(
                        Why.STALE,
                        message,
                        "reload it, or overwrite it",
                        {"conflict": True},
                    )
                mine = self.now  # theirs is one undo away
                self._add(State(theirs, BY_OTHERS))
                self._add(
                    replace(mine, what="keep mine over another program's", tag=None)
                )
            data = (codecs.BOM_UTF8 if self._bom else b"") + self.now.text.encode()
            write_atomic(self.real, data, durable=True)
            self._set_saved(self.now.text)
        self._changed()

    def _take(self, theirs: str | None) -> None:
        """Make the text on the disk the newest state. Raises EditError."""
        if theirs is None:
            raise Message.FILE_REMOVED.impossible()
        if theirs != self.now.text:
            self._add(State(theirs, BY_OTHERS))
        self._set_saved(theirs)

    def _set_saved(self, saved: str) -> None:
        self.saved, self.outside = saved, None
        self.history.end_step()
        self.draft.clear()

    def look_outside(self) -> None:
        """Take in what another program did to the file, once it stayed the same from one call to the next."""
        if not self._edits.acquire(blocking=False):
            return  # the next call looks again
        try:
            before, self._stamp = self._stamp, file_stamp(self.real)
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
        except OSError:  # a full disk, say
            pass
        finally:
            self._edits.release()

    def _look_outside(self) -> str | None:
        """`taken`, `clash`, `gone`, or None for no change: what was not edited here is taken in."""
        try:
            theirs = self._theirs()
        except EditError:
            self.outside = "changed"
            return "clash"
        before = self.outside
        if theirs is None:
            self.outside = "gone"
            return "gone" if before != "gone" else None
        if theirs == self.saved:
            self.outside = None
            return "taken" if before is not None else None
        if self._nothing_made and before is None:
            self._take(theirs)
            return "taken"
        self.outside = "changed"
        return "clash"

    def _theirs(self) -> str | None:
        """The text of the file; None where it is gone. Raises EditError where it is not text."""
        try:
            with open(self.real, "rb") as stream:
                return decode(stream.read(Limit.BYTES.most + 1), str(self.path))
        except FileNotFoundError:
            return None
        except (InputError, OSError):
            message = "another program wrote something that is no scene into the file"
            raise EditError(
                Why.STALE, message, "put the file right, then save"
            ) from None
