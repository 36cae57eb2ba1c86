"""Errors that the editor shows to its user, each with a fix."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Any


class Why(Enum):
    """What kind of refusal it is; the value is HTTP's number for it."""

    MALFORMED = 400
    """The request itself is not what the interface says."""
    UNTRUSTED = 401
    FOREIGN = 403
    ABSENT = 404
    STALE = 409
    """It was asked of a state that is gone, or the file on disk is another by now."""
    TOO_LARGE = 413
    KIND = 415
    IMPOSSIBLE = 422
    """It is well asked, and cannot be done to this scene."""


class EditError(Exception):
    """Raised wherever an edit, or a request, is refused; `more` goes beside `error` in the answer."""

    def __init__(self, why: Why, message: str, fix: str, more: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.why, self.message, self.fix = why, message, fix
        self.more: Mapping[str, Any] = more or {}

    def body(self) -> dict[str, Any]:
        """The answer as JSON has it."""
        error = {"message": self.message, "fix": self.fix}
        return {"error": error, "problems": [], **self.more}


def impossible(message: str, fix: str) -> EditError:
    """An operation that cannot be made on this scene."""
    return EditError(Why.IMPOSSIBLE, message, fix)


def overtaken() -> EditError:
    """The error of a request about something that a newer one replaced."""
    return EditError(Why.STALE, "a newer request overtook this one", "wait for that one", {"overtaken": True})
