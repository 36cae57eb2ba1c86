"""Words about a scene for people: its title, its first sentence, and the origin of its
masks.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from physgen.scene.files import RECORD

HEAD_BYTES = 4096
"""Number of bytes to read for a scene file's opening comment."""
LONGEST_SENTENCE = 160
"""Maximum number of characters; a longer sentence is cut at a word."""
PERCEIVED = "perceived"
HAND_MADE = "hand-made masks"

_PLAIN = re.compile(r"\w+(?:[-_]\w+)*").fullmatch
"""Match a name that can become words. Names in sweeps hold settings."""
_SENTENCE = re.compile(r".+?[.!?](?=\s|$)")


def title_of(name: str) -> str:
    """Return a scene's name as a title.

    >>> title_of("bottle-book"), title_of("mass=3,friction=0.1")
    ('Bottle book', 'mass=3,friction=0.1')
    """
    if not _PLAIN(name):
        return name
    words = name.replace("-", " ").replace("_", " ")
    return words[:1].upper() + words[1:]


def first_sentence(text: str) -> str:
    """Return the first sentence of a scene file's opening comment; empty without one.

    >>> first_sentence("# A break, from\\n# above. It is ours.\\nphysgen: 1\\n")
    'A break, from above.'
    """
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        words = line.removeprefix("#").strip()
        if not words.startswith("yaml-language-server:"):
            lines.append(words)
    comment = " ".join(" ".join(lines).split())
    sentence = _SENTENCE.match(comment)
    if sentence:
        words = sentence[0]
    else:
        words = comment
    # Cut a long sentence at the last whole word.
    if len(words) <= LONGEST_SENTENCE:
        return words
    return words[:LONGEST_SENTENCE].rsplit(" ", 1)[0] + " …"


def sentence_of(file: Path) -> str:
    """Return the first sentence of a scene file, or "" for an unreadable file."""
    try:
        with file.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
    except (OSError, ValueError):
        return ""
    # The block may end within a character of several bytes.
    return first_sentence(head.decode("utf-8", "ignore"))


def masks_from(document: Mapping[str, Any], inputs: Mapping[str, str]) -> str:
    """Return the origin of the masks of a rendered scene, or "" without masks.

    `perceive` writes its record into the assets, which are inputs of the clip. Masks
    without a record are hand-made.
    """
    objects = document.get("objects", {}).values()
    if not any(item.get("mask") is not None for item in objects):
        return ""
    has_record = any(Path(path).name == RECORD for path in inputs)
    if has_record:
        return PERCEIVED
    return HAND_MADE
