"""How much a request may hold."""

from __future__ import annotations

from physgen.edit.ops import MAX_KEY, MAX_STEPS

__all__ = ["BODY", "MAX_DEPTH", "MAX_KEY", "MAX_OPS", "MAX_STEPS", "MAX_VALUES", "MAX_WORDS", "RESOLVED"]

BODY = 8 * 2**20 + 2**16
"""Bytes of a body: a scene file is at most 8 MiB."""
MAX_VALUES = 500_000
"""Texts, lists, objects and commas of a body: no fewer than values."""
MAX_OPS = 1000
MAX_WORDS = 200
"""Characters of `what`, `tag` and names."""
MAX_DEPTH = 40
RESOLVED = ("mine", "theirs", "merge")
