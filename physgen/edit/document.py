"""A scene file that is edited: its states, saving, and merging with what other programs write.

Not locked: `Session` calls one method at a time.
"""

from __future__ import annotations

import codecs
import os
import shutil
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

from physgen.edit.draft import Draft, draft_folder, sync, write_durably
from physgen.edit.errors import EditError, Why, impossible
from physgen.edit.history import History, State
from physgen.edit.yaml_tree import marked, readable
from physgen.files import back_up, file_stamp
from physgen.problems import InputError
from physgen.scene.document import MAX_BYTES, decode
from physgen.scene.files import MAPS, RefusedError, confined, scene_bytes

BY_OTHERS = "changed by another program"
"""What the history calls a state that another program wrote."""


class Document:
    """The states of one file. Raises InputError where it cannot be read, BusyError where another editor has it."""

    def __init__(self, path: Path, allow_outside: bool = False) -> None:
        self.path, self.allow_outside = path, allow_outside
        self.real = Path(os.path.realpath(path))
        text = self._read_first()
        self.draft = Draft(path)
        self.outside: str | None = None
        """`changed` or `gone`: what another program did to the file, where that is still to be resolved."""
        self.ids: deque[str] = deque(maxlen=100)
        """Of the newest requests: one that is sent again is not carried out twice."""
        self._saving = False
        """Whether maps and text are being written; the draft says so, so that a crash between the two is noticed."""
        self._copies = frozenset((0,))
        self.saved = State(text)
        """What the file held when it was read or written last."""
        self.history = History(self.saved)
        found = self.draft.load()
        if found is not None:
            self._continue(found)
        else:
            self._store()
        self._stamps = stamps(self._own(self.saved.text))
        self.recovered = not self.is_saved
        """Whether it continues what an editor left that ended before everything was saved."""

    def _continue(self, found: dict[str, Any]) -> None:
        """Take over what another editor left."""
        history = History.from_data(found["history"])
        if history.version == 1:  # nothing was edited
            self.draft.forget_maps(set())
            self._store()
            return
        self.history, self.saved = history, State(**found["saved"])
        self.ids += found["ids"]
        if found["saving"]:
            self._end_saving()
        self.history.replace_maps(self._has_maps, self.saved.maps)
        self.look_outside()

    def _has_maps(self, state: State) -> bool:
        return state.maps in (0, self.saved.maps) or self.draft.maps(state.maps).is_dir()

    def _end_saving(self) -> None:
        """An editor ended between maps and text: complete the save if the text is there, else take the maps back."""
        folder, kept = self._own(self.now.text), self.draft.maps(self.saved.maps)
        theirs = None
        with suppress(EditError):
            theirs = self._theirs()
        if theirs == self.now.text:
            if folder is not None:
                install(self.draft.maps(self.now.maps), folder)
            self._set_saved(State(self.now.text, self.now.maps))
        elif folder is not None and kept.is_dir():
            install(kept, folder)

    # The draft

    def _store(self) -> None:
        """Write all states. Raises OSError."""
        self.draft.store(
            {
                "history": self.history.as_data(),
                "saved": asdict(self.saved),
                "ids": list(self.ids),
                "saving": self._saving,
            }
        )

    @contextmanager
    def _stored(self) -> Iterator[None]:
        """Write what the block changes; where that fails, nothing is changed. Raises OSError."""
        self.restore_draft()
        before = self.history.copy(), self.saved, self.ids.copy(), self._saving
        try:
            yield
            self._store()
        except BaseException:
            self.history, self.saved, self.ids, self._saving = before
            raise

    def restore_draft(self) -> None:
        """Write the draft again where another program removed it. Raises OSError."""
        if self.draft.is_gone():
            self._store()
            self.history.replace_maps(self._has_maps, self.saved.maps)

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
        """Whether the present state is that which the file held when it was read or written last."""
        return (self.now.text, self.now.maps) == (self.saved.text, self.saved.maps)

    def maps(self, state: State) -> Path | None:
        """The folder of a state's maps; None: the scene's own, which another program may change."""
        return None if state.maps == self.saved.maps else self.draft.maps(state.maps)

    def _own(self, text: str) -> Path | None:
        """The folder that a text names for its maps; None: it names none, or one that it may not."""
        with suppress(EditError):
            return folder_of(text, self.path.absolute().parent, self.allow_outside)
        return None

    def note_maps(self) -> None:
        """Note the present state of the scene's own maps, of which the next correction is made."""
        if self.now.maps == self.saved.maps:
            self._stamps = stamps(self._own(self.now.text))

    # Changes

    def push(self, state: State) -> None:
        """Add a state. Raises OSError: then it is not added."""
        if len(state.text) > MAX_BYTES // 4 and len(state.text.encode()) > MAX_BYTES:
            raise EditError(
                Why.TOO_LARGE, "the file would be larger than 8 MiB", "keep pixels in image files"
            )
        with self._stored():
            self.history.push(replace(state, time=time.time()))
            if state.id:
                self.ids.append(state.id)
        if self.history.maps() != self._copies:
            self._copies = self.history.maps()
            self.draft.forget_maps({*self._copies, self.saved.maps})

    def step(self, by: int, request: str | None) -> None:
        """Undo (-1) or redo (1). Raises EditError, OSError."""
        if not self.history.can(by):
            word = "undo" if by < 0 else "redo"
            raise EditError(Why.IMPOSSIBLE, f"there is nothing to {word}", "edit something first")
        with self._stored():
            self.history.step(by)
            if request:
                self.ids.append(request)

    # The file

    def save(self, resolve: str | None) -> None:
        """Write the file; where another program changed it, as `resolve` says. Raises EditError, OSError."""
        try:
            theirs = self._theirs()
        except EditError:
            if resolve != "mine":
                raise
            back_up(self.real)  # as NAME~: it cannot be a step of the history
            theirs = None
        if resolve == "theirs":
            self._take(theirs)
            return
        differs = theirs is not None and theirs != self.saved.text
        if theirs is not None and differs and self._settle(theirs, resolve):
            return
        self._write(theirs, over=resolve == "mine" and not differs)

    def look_outside(self) -> str | None:
        """Take over what another program wrote: returns `taken`, `merged`, `clash`, `gone`, or None for no change."""
        try:
            theirs = self._theirs()
        except EditError:
            self.outside = "changed"
            return "clash"
        if theirs is None:
            before, self.outside = self.outside, "gone"
            return "gone" if before != "gone" else None
        if theirs == self.saved.text:
            before, self.outside = self.outside, None
            return "taken" if before is not None else None
        if self._nothing_made and self.outside is None:
            self._take(theirs)
            return "taken"
        if self._merge(theirs).text is not None:
            self._settle(theirs, None)
            return "merged"
        self.outside = "changed"
        return "clash"

    def close(self) -> Path | None:
        """Release the draft; returns its folder where something in it is not saved."""
        keep = not self.is_saved
        self.draft.close(keep)
        return self.draft.folder if keep else None

    def _take(self, theirs: str | None) -> None:
        """Make the text on the disk the newest state. Raises EditError."""
        if theirs is None:
            raise EditError(Why.IMPOSSIBLE, "the file is gone", "save, and it is there again")
        if (theirs, self.saved.maps) != (self.now.text, self.now.maps):
            self.push(State(theirs, self.saved.maps, BY_OTHERS))
        self._set_saved(State(theirs, self.saved.maps))

    def _settle(self, theirs: str, resolve: str | None) -> bool:
        """Merge with what another program wrote. Returns whether nothing is left to be written. Raises EditError."""
        if self._nothing_made and resolve is None:
            self._take(theirs)
            return True
        mine, made = self.now, self._merge(theirs)
        if resolve == "mine":  # theirs is one undo away
            self.push(State(theirs, mine.maps, BY_OTHERS))
            self.push(State(mine.text, mine.maps, "keep mine over another program's"))
        elif made.text is None:
            conflict = {"theirs": theirs, "merged": None, "clashes": list(made.clashes)}
            message = "another program changed the same lines of the file"
            self.outside = "changed"
            raise EditError(Why.STALE, message, "choose mine or theirs", {"conflict": conflict})
        elif made.text != mine.text:
            self.push(State(made.text, mine.maps, "merge with what another program wrote"))
        self._set_saved(State(theirs, self.saved.maps))
        return False

    def _merge(self, theirs: str) -> Merged:
        """Both changes; they also clash where two valid texts merge to an invalid one."""
        made = merged(self.saved.text, self.now.text, theirs)
        if made.text is None or not readable(self.now.text) or not readable(theirs) or readable(made.text):
            return made
        return Merged(None)

    def _set_saved(self, saved: State) -> None:
        """Note what the file holds."""
        with self._stored():
            self.saved, self._saving = saved, False
            self.history.end_step()
        self.outside = None
        self.note_maps()

    def _write(self, theirs: str | None, over: bool) -> None:
        """Write maps and text, both or neither. `over`: also over maps that another program wrote."""
        if self.now.maps == self.saved.maps:
            self._write_text(theirs)
        else:
            folder = folder_of(self.now.text, self.path.absolute().parent, self.allow_outside)
            if folder is None:
                raise impossible("the text names no folder for its maps", "write assets: and a folder's name")
            self._write_maps(folder, theirs, over)
        self._set_saved(State(self.now.text, self.now.maps))

    def _write_text(self, theirs: str | None) -> None:
        if theirs != self.now.text:
            write_durably(self.real, (codecs.BOM_UTF8 if self._bom else b"") + self.now.text.encode())

    def _write_maps(self, folder: Path, theirs: str | None, over: bool) -> None:
        """The old maps are copied to the draft for an undo, and restored where not all could be written."""
        own, kept = self._own(self.saved.text), self.draft.maps(self.saved.maps)
        if folder != own and has_maps(folder):
            fix = "name a folder that is not there yet, or that which the scene had"
            raise impossible(f"assets: {folder.name} holds maps of something else", fix)
        if folder == own and stamps(folder) != self._stamps and not over:
            message = "another program changed the scene's maps since yours were made"
            fix = "choose mine to write yours over them; theirs stay one step back"
            raise EditError(Why.STALE, message, fix, {"maps": True})
        copy_maps(own, kept)
        if own is not None and not same_maps(kept, own):  # painted by another program: one undo away, too
            number, mine = self.draft.new_maps(), self.now
            copy_maps(own, self.draft.maps(number))
            kept = self.draft.maps(number)
            self.push(State(mine.text, number, BY_OTHERS))
            self.push(State(mine.text, mine.maps, "keep my maps over another program's"))
        with self._stored():
            self._saving = True
        try:
            install(self.draft.maps(self.now.maps), folder)
            self._write_text(theirs)
        except BaseException:
            with suppress(OSError):
                install(kept, folder)
            self._stamps = stamps(folder)
            self._saving = False
            raise

    def _read_first(self) -> str:
        """The file's text, at the beginning. Raises InputError."""
        gone = not self.real.exists() and (draft_folder(self.path) / "draft.json").is_file()
        data = b"" if gone else scene_bytes(self.path, str(self.path))  # the draft still holds it
        text = decode(data, str(self.path))
        self._bom, self._crlf = data.startswith(codecs.BOM_UTF8), "\r\n" in text
        return text

    def with_line_ends(self, text: str) -> str:
        """A text of the page, whose fields have no carriage returns, with the line ends of the file."""
        text = text.removeprefix("\ufeff")
        return text.replace("\n", "\r\n") if self._crlf and "\r" not in text else text

    def _theirs(self) -> str | None:
        """The text of the file; None where it is gone. Raises EditError where it is not text."""
        try:
            with open(self.real, "rb") as stream:
                return decode(stream.read(MAX_BYTES + 1), str(self.path))
        except FileNotFoundError:
            return None
        except (InputError, OSError):
            message = "another program wrote something that is no scene into the file"
            raise EditError(Why.STALE, message, "put the file right, then save") from None


# Merging


@dataclass(frozen=True)
class Merged:
    """The text with both changes, None where they clash."""

    text: str | None
    clashes: tuple[dict[str, Any], ...] = ()
    """Lines that both changed, as `base`, `mine` and `theirs`; `line` counts from 1 in mine."""


def merged(base: str, mine: str, theirs: str) -> Merged:
    """Merge by lines, as diff3 does: lines that both left alone separate the changes.

    >>> merged("a\\nb\\nc\\n", "A\\nb\\nc\\n", "a\\nb\\nC\\n").text
    'A\\nb\\nC\\n'
    >>> merged("a\\n", "b\\n", "c\\n").clashes[0]["theirs"]
    'c\\n'
    """
    old, one, two = (_lines(text) for text in (base, mine, theirs))
    made: list[str] = []
    clashes: list[dict[str, Any]] = []
    at = a = b = 0
    for begin, end, first, second in [*_shared(old, one, two), (len(old), len(old), len(one), len(two))]:
        was, ours, others = old[at:begin], one[a:first], two[b:second]
        if ours == others or others == was:
            made += ours
        elif ours == was:
            made += others
        else:
            parts = {"base": was, "mine": ours, "theirs": others}
            clashes.append({"line": a + 1} | {name: "".join(lines) for name, lines in parts.items()})
        made += old[begin:end]
        at, a, b = end, first + end - begin, second + end - begin
    return Merged(None if clashes else "".join(made), tuple(clashes))


def _lines(text: str) -> list[str]:
    """Lines with their ends, split at line feeds alone, as editors count them."""
    return [line + "\n" for line in text.split("\n")[:-1]] + (
        [text.rpartition("\n")[2]] if text[-1:] != "\n" else []
    )


def _shared(old: list[str], one: list[str], two: list[str]) -> Iterator[tuple[int, int, int, int]]:
    """Runs of lines that neither changed: start and end in the old text, start in the two others."""
    left, right = _kept(old, one), _kept(old, two)
    i = j = 0
    while i < len(left) and j < len(right):
        (a, m, long), (b, n, wide) = left[i], right[j]
        begin, end = max(a, b), min(a + long, b + wide)
        if begin < end:
            yield begin, end, m + begin - a, n + begin - b
        if a + long < b + wide:
            i += 1
        else:
            j += 1


def _kept(old: list[str], new: list[str]) -> list[tuple[int, int, int]]:
    return [
        (m.a, m.b, m.size)
        for m in SequenceMatcher(None, old, new, autojunk=False).get_matching_blocks()
        if m.size
    ]


# Maps


def folder_of(text: str, home: Path, allow_outside: bool) -> Path | None:
    """The folder that a text names for its maps. Raises EditError where a scene may not read there."""
    node = marked(text).child("assets")
    if node is None or not isinstance(node.value, str):
        return None
    try:
        folder = confined(node.value, home, home, allow_outside)
    except RefusedError as error:
        raise impossible(f"assets {error.expected}, so its maps are not written", error.fix) from None
    for name in MAPS:
        if (folder / f"{name}.png").is_symlink():
            raise impossible(
                f"{name}.png is a link to a file elsewhere", "put a copy in its place, then save"
            )
    return folder


def stamps(folder: Path | None) -> dict[str, tuple[int, int, int]]:
    """Time, size and inode of each map, which change when it is written, and not when it is linked."""
    if folder is None:
        return {}
    found = {name: file_stamp(folder / f"{name}.png") for name in MAPS}
    return {name: (time, size, number) for name, (time, _, size, number) in found.items()}


def has_maps(folder: Path) -> bool:
    """Whether a folder holds maps."""
    return any(os.path.lexists(folder / f"{name}.png") for name in MAPS)


def copy_maps(folder: Path | None, into: Path) -> None:
    """Copy the maps, completely or not at all, unless there is a copy."""
    if into.is_dir():
        return
    beside = into.with_name(f"{into.name}.part")
    shutil.rmtree(beside, ignore_errors=True)
    beside.mkdir()
    for name in MAPS if folder is not None else ():
        file = (folder or into) / f"{name}.png"
        if file.is_file():
            shutil.copyfile(file, beside / file.name)
            sync(beside / file.name)
    sync(beside)
    beside.rename(into)
    sync(into.parent)


def install(source: Path, folder: Path) -> None:
    """Put the maps of `source`, and no others, into `folder`, each completely. Raises OSError."""
    folder.mkdir(exist_ok=True)
    for name in MAPS:
        made, file = source / f"{name}.png", folder / f"{name}.png"
        if made.is_file():
            data = made.read_bytes()
            if not (file.is_file() and file.read_bytes() == data):
                write_durably(file, data)
        elif os.path.lexists(file):
            file.unlink()


def same_maps(one: Path, other: Path) -> bool:
    """Whether two folders hold the same maps."""
    pairs = [(one / f"{name}.png", other / f"{name}.png") for name in MAPS]
    return all(_bytes(file) == _bytes(mate) for file, mate in pairs)


def _bytes(file: Path) -> bytes | None:
    return file.read_bytes() if file.is_file() else None
