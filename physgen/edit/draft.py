"""The draft folder beside a scene: unsaved changes, locked by one editor at a time.

`.NAME.editing/` contains `draft.json` with the newest text and the address of the
editor. An editor removes the folder at its end if everything is saved; otherwise, the
next editor continues the draft.
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


class DraftContent(BaseModel):
    """The content of draft.json. Earlier formats stored the whole history, or copies of
    maps.
    """

    model_config = ConfigDict(extra="forbid", strict=True)

    format: Literal[4] = 4
    text: str
    saved_text: str  # the text that the file held when it was read or written last
    folders: list[Annotated[str, Field(pattern=r"^[^/\\]+\.assets$")]] = []
    """Folders of maps beside the scene, written by corrections."""


class BusyError(Exception):
    """Error: another editor, at `address`, has opened the scene."""

    def __init__(self, address: str) -> None:
        super().__init__(address)
        self.address = address


def draft_folder(path: Path) -> Path:
    """Return the draft folder of a scene file."""
    real = Path(os.path.realpath(path))
    return real.with_name(f".{real.name}.editing")


class Draft:
    """The draft folder of one scene, locked by this process. Raises BusyError,
    InputError.
    """

    def __init__(self, path: Path) -> None:
        self.folder = draft_folder(path)
        self._file = self.folder / "draft.json"
        try:
            self.folder.mkdir(mode=0o700, exist_ok=True)
            folder_status = os.lstat(self.folder)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise Message.DRAFT_IMPOSSIBLE.error(str(path), reason=reason) from None
        # The draft contains the scene: in a folder of another user, it could be read or
        # replaced.
        if self.folder.is_symlink() or not is_private(folder_status):
            raise self._create_draft_error("is a draft of another user or machine")
        self._lock_file = self.folder / "lock"
        self._lock = FileLock(self._lock_file, timeout=0)
        try:
            self._lock.acquire()
        except Timeout:
            # The other editor writes its address once it listens, after it has locked.
            address = self.folder / "address"
            raise BusyError(
                address.read_text("utf-8") if address.is_file() else ""
            ) from None

    def _create_draft_error(self, fault: str) -> InputError:
        return Message.DRAFT_STRANGE.error(str(self.folder), fault=fault)

    def load(self) -> DraftContent | None:
        """Load the newest stored draft; None if nothing is stored. Raises
        InputError.
        """
        try:
            return DraftContent.model_validate_json(self._file.read_bytes())
        except FileNotFoundError:
            return None
        except (ValidationError, OSError):
            raise self._create_draft_error(
                "is a draft of another version of physgen"
            ) from None

    def store(self, draft: DraftContent) -> None:
        """Store a draft; the previous one stays until the new one is complete. Raises
        OSError.
        """
        # If another program removed the folder, its lock is lost: lock the new folder.
        if not self._lock_file.exists():
            self.folder.mkdir(mode=0o700, exist_ok=True)
            self._lock.release()
            self._lock.acquire()
        write_atomic(self._file, draft.model_dump_json().encode())

    def remove(self) -> None:
        """Remove the stored draft, since everything is saved."""
        self._file.unlink(missing_ok=True)

    def listens(self, address: str) -> None:
        """Write the address of this editor."""
        write_atomic(self.folder / "address", address.encode())

    def close(self, keep: bool) -> None:
        """Release the folder, and remove it unless `keep` is true."""
        if not keep:
            shutil.rmtree(self.folder, ignore_errors=True)
        self.release()

    def release(self) -> None:
        """Release the lock and leave the folder as it is."""
        self._lock.release()
