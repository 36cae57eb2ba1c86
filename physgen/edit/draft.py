"""The draft folder beside a scene: what is not saved yet, held by one editor at a time.

`.NAME.editing/` holds `draft.json` with the newest text and the address of the editor. It is removed when the editor
ends with everything saved; the next editor continues one that is left.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Annotated, Literal

from filelock import FileLock, Timeout
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from physgen.files import write_atomic
from physgen.messages import Message
from physgen.operating_system import is_private
from physgen.problems import InputError


class Unsaved(BaseModel):
    """What draft.json holds. Earlier formats held the whole history, or copies of maps."""

    model_config = ConfigDict(extra="forbid", strict=True)

    format: Literal[4] = 4
    text: str
    saved: str  # the text that the file held when it was read or written last
    folders: list[Annotated[str, Field(pattern=r"^[^/\\]+\.assets$")]] = []
    """Maps of corrections, beside the scene."""


class BusyError(Exception):
    """Another editor, at `address`, has the scene."""

    def __init__(self, address: str) -> None:
        super().__init__(address)
        self.address = address


def draft_folder(path: Path) -> Path:
    """The draft folder of a scene file."""
    real = Path(os.path.realpath(path))
    return real.with_name(f".{real.name}.editing")


class Draft:
    """The draft folder of one scene, held by this process alone. Raises BusyError, InputError."""

    def __init__(self, path: Path) -> None:
        self.folder = draft_folder(path)
        self._file = self.folder / "draft.json"
        try:
            self.folder.mkdir(mode=0o700, exist_ok=True)
            found = os.lstat(self.folder)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise Message.DRAFT_IMPOSSIBLE.error(str(path), reason=reason) from None
        if self.folder.is_symlink() or not is_private(found):
            raise self._strange("is a draft of another user or machine")
        self._lock_file = self.folder / "lock"
        self._lock = FileLock(self._lock_file, timeout=0)
        try:
            self._lock.acquire()
        except Timeout:
            address = self.folder / "address"  # not there while the other one starts
            raise BusyError(
                address.read_text("utf-8") if address.is_file() else ""
            ) from None

    def _strange(self, what: str) -> InputError:
        return Message.DRAFT_STRANGE.error(str(self.folder), fault=what)

    def load(self) -> Unsaved | None:
        """What `store` wrote last; None where there is nothing. Raises InputError."""
        try:
            return Unsaved.model_validate_json(self._file.read_bytes())
        except FileNotFoundError:
            return None
        except (ValidationError, OSError):
            raise self._strange("is a draft of another version of physgen") from None

    def store(self, unsaved: Unsaved) -> None:
        """Write it to the disk; what was stored before stays until this is complete. Raises OSError."""
        if (
            not self._lock_file.exists()
        ):  # the folder was removed: hold the new one, too
            self.folder.mkdir(mode=0o700, exist_ok=True)
            self._lock.release()
            self._lock.acquire()
        write_atomic(self._file, unsaved.model_dump_json().encode())

    def clear(self) -> None:
        """Remove what is stored: everything is saved."""
        self._file.unlink(missing_ok=True)

    def listens(self, address: str) -> None:
        """Write the address of this editor."""
        write_atomic(self.folder / "address", address.encode())

    def close(self, keep: bool) -> None:
        """Release the folder, and remove it unless it is to be kept."""
        if not keep:
            shutil.rmtree(self.folder, ignore_errors=True)
        self.release()

    def release(self) -> None:
        """Leave the folder, as it is, to others."""
        self._lock.release()
