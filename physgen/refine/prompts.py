"""Labels of a scene's objects -> what the model is told that the video shows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

SAYS_NOTHING = frozenset({"", "object", "thing"})
"""Labels that are none."""


def prompt_of(labels: Iterable[str]) -> str:
    """The things that are there, the most frequent first, each once.

    >>> prompt_of(["billiard ball", "billiard ball", "cue", "object"])
    'billiard ball, cue'
    """
    said: dict[str, str] = {}  # as it is written first
    found = Counter(said.setdefault(label.strip().lower(), label.strip()).lower() for label in labels)
    return ", ".join(said[label] for label, _ in found.most_common() if label not in SAYS_NOTHING)
