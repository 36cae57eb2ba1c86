"""Events -> the meetings that a caption tells: who hits whom first of its kind, and what comes of it for sure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from physgen.export.telling.event import Event, Happening
from physgen.export.telling.speech import Speech
from physgen.simulate.settled import START, STILL

TOGETHER = 0.02
"""s of the motion within which things that hit the same hit it together, and what starts to move starts by a blow."""


@dataclass(frozen=True)
class Meeting:
    """Some hit one."""

    who: tuple[int, ...]
    whom: int
    time: float
    collisions: tuple[int, ...]
    """Indices of events."""
    moves: int | None = None
    """The event that whom was hit starts to move by it: it stood still until then."""
    fells: int | None = None
    """The event that it tips by it: nothing else has hit it by then."""

    @property
    def events(self) -> tuple[int, ...]:
        """All that it is made of."""
        more = (k for k in (self.moves, self.fells) if k is not None)
        return (*self.collisions, *more)


def meetings(events: Sequence[Event], speech: Speech, seen: Callable[[Event], bool]) -> list[Meeting]:
    """By time; of each two kinds of things the first meeting that can be `seen` alone.

    What touched from the start does not meet. Things that hit the same thing together are told together.
    """
    old = {event.who for event in events if event.kind is Happening.CONTACT and event.time < START}
    found: list[Meeting] = []
    kinds: set[frozenset[str]] = set()
    for k, event in enumerate(events):
        if event.kind is not Happening.COLLISION or event.who in old or not _closes(event) or not seen(event):
            continue
        one, other = speech.hitter(event)
        last = found[-1] if found else None
        kind = frozenset((speech.nouns.of(one), speech.nouns.of(other)))
        joins = last is not None and last.whom == other and event.time - last.time < TOGETHER
        if kind in kinds and not (joins and last is not None and kind in _kinds(last, speech)):
            continue
        if joins and last is not None and last.moves is None and one not in last.who:
            found[-1] = replace(last, who=(*last.who, one), collisions=(*last.collisions, k))
        elif kind not in kinds:
            found.append(Meeting((one,), other, event.time, (k,), *_outcome(events, k, speech, old, seen)))
        kinds.add(kind)
    return found


def _kinds(meeting: Meeting, speech: Speech) -> set[frozenset[str]]:
    return {frozenset((speech.nouns.of(one), speech.nouns.of(meeting.whom))) for one in meeting.who}


def _outcome(
    events: Sequence[Event],
    k: int,
    speech: Speech,
    old: set[tuple[int, ...]],
    seen: Callable[[Event], bool],
) -> tuple[int | None, int | None]:
    """Events of moving and of tipping that the blow alone can have caused: nothing else has hit who was hit."""
    one, other = speech.hitter(events[k])

    def hits(others: Sequence[Event]) -> set[int]:
        """Who hits it."""
        blows = (e for e in others if e.kind is Happening.COLLISION and other in e.who and e.who not in old)
        return {who for who, whom in map(speech.hitter, filter(_closes, blows)) if whom == other}

    start = _find(events, Happening.MOVE, other)
    early = -2 / speech.world.steps_per_second  # blows of one step are told apart by less
    if start is None or not early <= events[start].time - events[k].time < TOGETHER or hits(events[:k]):
        return None, None
    tip = _find(events, Happening.TIP, other)
    felled = tip is not None and seen(events[tip]) and hits(events[k + 1 : tip]) <= {one}
    return start, tip if felled else None


def _closes(collision: Event) -> bool:
    """Whether the two came together; a blow also passes through what touches already."""
    return collision.closing >= STILL


def _find(events: Sequence[Event], kind: Happening, who: int) -> int | None:
    return next((k for k, event in enumerate(events) if event.kind is kind and event.who == (who,)), None)
