"""Who was named so far in a text -> how they are named next, so that nobody is taken for somebody else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence

from physgen.export.telling.nouns import Nouns, listed, number, plural
from physgen.export.telling.speech import capital

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
NAMED = 3
"""Kinds of things in one sentence that are named; of more it is counted how many there are."""


class Mentions:
    """Of one text, from its beginning. Of several of a kind, `the second ball` is the second that was named alone."""

    def __init__(self, nouns: Nouns, bodies: int) -> None:
        """The first `bodies` surfaces are objects, the others are boundaries."""
        self._nouns, self._bodies = nouns, bodies
        self._known: dict[str, list[int]] = {}
        self._last: tuple[int, ...] = ()
        """The subject of the sentence before, which `it` or `they` is understood to be."""

    def subject(self, who: Sequence[int]) -> str:
        """Who begins the next sentence."""
        same = tuple(who) == self._last
        self._last = tuple(who)
        if same:
            return "it" if len(who) == 1 else "they"
        return self._alone(who[0]) if len(who) == 1 else self._together(who)

    def object(self, whom: int) -> str:
        """Who stands behind the verb; where that is an object, nobody could tell whom `it` means then."""
        if whom < self._bodies:
            self._last = ()
        return self._alone(whom)

    def unmoved(self, who: Sequence[int], told: Collection[int]) -> str:
        """Those that do not move; where all else was `told` of, they are the others."""
        self._last = ()
        if len({*who, *told}) < self._bodies:
            return self._together(who)
        kinds = Counter(self._nouns.of(k) for k in sorted(who))
        if len(kinds) <= NAMED:
            return listed([self._nouns.others(word, count) for word, count in kinds.items()])
        return f"the other {number(len(who))} {self._sort(who)[0]}"

    def more(self, count: int) -> str:
        """A sentence about things that are only counted."""
        self._last = ()
        does = "object is pushed or starts" if count == 1 else "objects are pushed or start"
        return f"{capital(number(count))} more {does} to move."

    def _alone(self, k: int) -> str:
        word, every = self._nouns.of(k), self._nouns.many(k)
        if every == 1:
            return f"the {word}"
        known = self._known.setdefault(word, [])
        if k in known:
            at = known.index(k)
            return f"the {ORDINALS[at]} {word}" if at < len(ORDINALS) else self._nouns.the(k)
        known.append(k)
        if len(known) == 1:
            return self._nouns.the(k)
        if len(known) == 2:
            return f"the other {word}" if every == 2 else f"another {word}"
        return (
            f"a {ORDINALS[len(known) - 1]} {word}" if len(known) <= len(ORDINALS) else f"yet another {word}"
        )

    def _together(self, who: Sequence[int]) -> str:
        kinds: dict[str, list[int]] = {}
        for k in sorted(who):
            kinds.setdefault(self._nouns.of(k), []).append(k)
        if len(kinds) <= NAMED:
            some = [
                self._alone(these[0]) if len(these) == 1 else self._nouns.group(word, len(these))
                for word, these in kinds.items()
            ]
            return listed(some)
        sort, every = self._sort(who)
        if len(who) == every:
            return f"all {number(every)} {sort}"
        return f"{number(len(who))} of the {number(every)} {sort}"

    def _sort(self, who: Sequence[int]) -> tuple[str, int]:
        """What things of many kinds have in common: the last word of their names, or that they are objects.

        And how many objects are of that sort.
        """
        heads = {self._head(k) for k in who}
        head = heads.pop() if len(heads) == 1 else None
        if head is None:
            return "objects", self._bodies
        return plural(head), sum(self._head(k) == head for k in range(self._bodies))

    def _head(self, k: int) -> str | None:
        noun = self._nouns.of(k)
        return None if noun.startswith("“") else noun.partition(" of ")[0].rpartition(" ")[2]
