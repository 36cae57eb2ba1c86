"""Labels of objects and names of boundaries -> what sentences call them: alone, among their like, and in groups.

A label is text that anybody may have written, in any script: what is more than a few words is shown in quotation marks,
and can never end a sentence or begin one.
"""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Sequence

NUMBERS = (
    *(
        "no",
        "one",
        "two",
        "three",
        "four",
        "five",
        "six",
        "seven",
        "eight",
        "nine",
        "ten",
        "eleven",
        "twelve",
    ),
    *("thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen", "twenty"),
)
LONGEST = 40
"""Characters of a noun."""
SIDES = ("left", "right", "top", "bottom", "upper", "lower", "front", "back", "near", "far")
"""Words that people put behind a boundary's name, and speech before it."""
ODD = {
    "man": "men", "woman": "women", "child": "children", "person": "people", "foot": "feet", "tooth": "teeth",
    "goose": "geese", "mouse": "mice", "die": "dice", "knife": "knives", "shelf": "shelves", "leaf": "leaves",
    "loaf": "loaves", "half": "halves", "wolf": "wolves", "domino": "dominoes", "potato": "potatoes",
    "tomato": "tomatoes", "mango": "mangoes", "box": "boxes", "quiz": "quizzes", "sheep": "sheep", "fish": "fish",
    "scissors": "scissors", "dice": "dice", "glasses": "glasses",
}  # fmt: skip
"""Plurals that no rule gives."""
_ARTICLE = re.compile(r"^(?:the|an?)\s+(?=\S)", re.IGNORECASE)
_NUMBER = re.compile(r"[\s_-]*\d+$")
_LETTERS = re.compile(r"[a-z]+(?:[ '-][a-z0-9]+)*", re.IGNORECASE)


def named(name: str) -> str:
    """What a thing is called that has a name and no label.

    >>> named("ball-12"), named("cushion_left"), named("p")
    ('ball', 'left cushion', 'p')
    """
    words = (_NUMBER.sub("", name) or name).replace("_", " ").replace("-", " ").split()
    if len(words) > 1 and words[-1] in SIDES:
        words.insert(0, words.pop())
    return " ".join(words) or name


def noun(label: str) -> str:
    """A label as it stands in a sentence: without its article and what follows a comma; odd ones in quotation marks.

    >>> noun("a red ball"), noun("glass marble, blue"), noun("мяч"), noun("egg. It  explodes")
    ('red ball', 'glass marble', 'мяч', '“egg. It explodes”')
    """
    text = "".join(" " if unicodedata.category(c)[0] in "CZ" else c for c in label)
    text = " ".join(text.split())
    short = _ARTICLE.sub("", re.split(r"\s*[,;(]", text)[0])
    plain = short and all(c in " '’-" or unicodedata.category(c)[0] in "LMN" for c in short)
    if plain and len(short) <= LONGEST:
        return short
    text = text.replace("“", "'").replace("”", "'").replace('"', "'")
    cut = text if len(text) <= LONGEST else text[: LONGEST - 1].rstrip() + "…"
    return f"“{cut}”"


def plural(noun: str) -> str:
    """Of an English noun; others stay as they are.

    >>> plural("tin of tomatoes"), plural("glass"), plural("berry"), plural("toy"), plural("мяч")
    ('tins of tomatoes', 'glasses', 'berries', 'toys', 'мяч')
    """
    if not _LETTERS.fullmatch(noun):
        return noun
    head, of, rest = noun.partition(" of ")
    *before, word = head.split(" ")
    low = word.lower()
    if low in ODD:
        many = ODD[low]
    elif re.search(r"(?:s|x|z|ch|sh)$", low):
        many = f"{word}es"
    elif re.search(r"[^aeiou]y$", low):
        many = f"{word[:-1]}ies"
    else:
        many = f"{word}s"
    return " ".join([*before, many]) + of + rest


def number(count: int) -> str:
    """In words up to twenty."""
    return NUMBERS[count] if count < len(NUMBERS) else f"{count:,}"


def listed(phrases: Sequence[str]) -> str:
    """`a, b and c`."""
    return phrases[0] if len(phrases) == 1 else f"{', '.join(phrases[:-1])} and {phrases[-1]}"


class Nouns:
    """What the surfaces of a scene are called, each noun counted."""

    def __init__(self, labels: Sequence[str]) -> None:
        """Of the surfaces, in their order."""
        self._nouns = [noun(label) for label in labels]
        self._count = Counter(self._nouns)

    def of(self, k: int) -> str:
        """The bare noun."""
        return self._nouns[k]

    def many(self, k: int) -> int:
        """How many there are of the kind."""
        return self._count[self._nouns[k]]

    def the(self, k: int) -> str:
        """`the ball`, or `one of the three balls`."""
        word, count = self._nouns[k], self.many(k)
        return f"the {word}" if count == 1 else f"one of the {number(count)} {plural(word)}"

    def other(self, k: int, than: int) -> str:
        """`k`, told right after `than`: `the other ball`, `another ball` where they are of a kind."""
        if self._nouns[k] != self._nouns[than] or k == than:
            return self.the(k)
        return f"the other {self._nouns[k]}" if self.many(k) == 2 else f"another {self._nouns[k]}"

    def group(self, word: str, count: int) -> str:
        """Several of a kind: `both balls`, `two of the three balls`."""
        every = self._count[word]
        if count == every:
            return f"both {plural(word)}" if every == 2 else f"all {number(every)} {plural(word)}"
        return f"{number(count)} of the {number(every)} {plural(word)}"

    def others(self, word: str, count: int) -> str:
        """All that is left of a kind: `the other two balls`."""
        every = self._count[word]
        if count == every:
            return f"the {word}" if count == 1 else self.group(word, count)
        return f"the other {word}" if count == 1 else f"the other {number(count)} {plural(word)}"
