"""Events of a clip -> the few sentences that tell it: what starts, what meets what, and how it ends.

Each is made of events alone, and names them: whoever doubts a sentence looks there. Of much that happens the first and
the last is told, and the rest counted; what is not told is still an event.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from physgen.export.telling.event import Event, Happening
from physgen.export.telling.meetings import meetings
from physgen.export.telling.mentions import Mentions
from physgen.export.telling.sentences import moving
from physgen.export.telling.speech import ALONE, AT_ONCE, AWAY, INTO, SOON, Speech, capital

MOST = 3
"""Sentences of one sort: pushes and starts, and meetings."""
FEW = 2
"""Kinds of things of which it is told, kind by kind, that they tip or leave; of more it is told together."""
Groups = dict[tuple[str, ...], list[int]]
PUSHES = (Happening.PUSH, Happening.PUSH_START)


@dataclass(frozen=True)
class Clause:
    """One sentence."""

    text: str
    events: tuple[int, ...]
    """Indices of those that it is made of."""


@dataclass(frozen=True)
class Told:
    """What is said of a group of objects, before it is put in words."""

    time: float
    """s: sentences stand in its order."""
    who: tuple[int, ...]
    one: str
    """The verb and what belongs to it, of one object."""
    many: str
    events: tuple[int, ...]
    whom: int | None = None
    """Stands behind the verb."""
    end: str = ""
    ends: str | None = None
    """The same of several, where it differs."""


def caption(events: Sequence[Event], speech: Speech) -> tuple[Clause, ...]:
    """In the order in which things happen; never empty."""
    plot = _Plot(events, speech)
    mentions = Mentions(speech.nouns, len(speech.world.bodies))
    begun, left = plot.starts()
    clauses = [_said(told, mentions) for told in begun]
    if left:
        count = mentions.count(len({events[k].who[0] for k in left}))
        plenty = "object is" if count == "one" else "objects are"
        clauses.append(Clause(f"{capital(count)} more {plenty} pushed or start to move.", left))
    clauses += [_said(told, mentions) for told in sorted(plot.middle(), key=lambda told: told.time)]
    clauses += [_said(told, mentions) for told in plot.ends()]
    if stayed := plot.stayed():
        clauses.append(_unmoved(stayed, mentions))
    return tuple(clauses) or (Clause("Nothing happens.", ()),)


def _said(told: Told, mentions: Mentions) -> Clause:
    single = len(told.who) == 1
    who = mentions.subject(told.who)
    does = told.one if single else told.many
    whom = "" if told.whom is None else f" {mentions.object(told.whom)}"
    end = told.end if single or told.ends is None else told.ends
    return Clause(capital(f"{who} {does}{whom}{end}") + ".", told.events)


def _unmoved(stayed: dict[int, int], mentions: Mentions) -> Clause:
    does = "does" if len(stayed) == 1 else "do"
    who = mentions.others(tuple(stayed))
    text = "Nothing moves." if who is None else f"{capital(who)} {does} not move."
    return Clause(text, tuple(stayed.values()))


class _Plot:
    """What is worth telling."""

    def __init__(self, events: Sequence[Event], speech: Speech) -> None:
        self._events, self._speech = events, speech
        self._felled: set[int] = set()
        """Of whom it is told elsewhere that they tip."""

    def _of(self, *kinds: Happening) -> Iterator[tuple[int, Event]]:
        return ((k, event) for k, event in enumerate(self._events) if event.kind in kinds)

    def _when(self, which: Iterable[int]) -> str:
        """Of the first of some events."""
        return self._speech.when(min(self._events[k].time for k in which))

    def starts(self) -> tuple[list[Told], tuple[int, ...]]:
        """What is pushed, what moves when the clip starts, what starts to move then; and the events of all the rest."""
        pushed = {event.who[0] for _, event in self._of(*PUSHES)}
        groups: dict[tuple[str, str, float], list[int]] = {}
        for k, event in self._of(*PUSHES, Happening.MOVING, Happening.FALL, Happening.MOVE):
            soon = event.time * self._speech.pace < SOON
            if event.kind in PUSHES:
                words = self._speech.shoved(event)
            elif soon and event.who[0] not in pushed:
                words = self._starting(event)
            else:
                continue
            groups.setdefault((*words, 0.0 if soon else event.time), []).append(k)
        told = []
        for (one, many, time), which in groups.items():
            own = self._events[which[0]].kind in (Happening.MOVE, Happening.FALL)
            end = f" {AT_ONCE if own else self._when(which)}"
            told.append(Told(time, _bodies(self._events, which), one, many, tuple(which), end=end))
        told.sort(key=lambda each: each.time)
        return told[:MOST], tuple(k for each in told[MOST:] for k in each.events)

    def _starting(self, event: Event) -> tuple[str, str]:
        if event.kind is Happening.MOVING:
            return moving(event, self._speech)
        one = ALONE[event.kind]
        return one, one.replace("starts", "start")

    def middle(self) -> Iterator[Told]:
        """Who meets whom, tips, leaves the picture and comes back."""
        yield from self._met()
        yield from self._tips()
        yield from self._borders()

    def _met(self) -> Iterator[Told]:
        for meeting in meetings(self._events, self._speech)[:MOST]:
            when = f" {self._speech.when(meeting.time)}"
            told = Told(meeting.time, meeting.who, "hits", "hit", meeting.events, meeting.whom, when)
            if meeting.fells is not None:
                self._felled.add(meeting.whom)
                over = self._speech.stands(self._events[meeting.fells]) == "tip"
                told = replace(told, end=when + (" and knocks it over" if over else " and tilts it"))
            elif meeting.moves is not None:
                told = replace(told, end=f"{when} and sets it moving")
            elif all(self._speech.bounces(self._events[k]) for k in meeting.collisions):
                told = replace(told, end=f"{when} and bounces", ends=f"{when} and bounce")
            yield told

    def _tips(self) -> Iterator[Told]:
        groups = self._kinds((Happening.TIP,), lambda event: (self._speech.stands(event),))
        for (over, *_), which in groups.items():
            who = _bodies(self._events, which)
            if set(who) <= self._felled:
                continue
            one, many = ("tips over", "tip over") if over == "tip" else ("tilts", "tilt")
            times = [self._events[k].time for k in which]
            yield Told(max(times), who, one, many, tuple(which), end=self._speech.whens(times))

    def _borders(self) -> Iterator[Told]:
        for kind in (Happening.ENTER, Happening.LEAVE):
            gone = kind is Happening.LEAVE
            for which in self._kinds((kind,), lambda event: (event.side,)).values():
                who = _bodies(self._events, which)
                sides = {self._events[k].side for k in which}
                where = "" if len(sides) > 1 else f" {(AWAY if gone else INTO)[sides.pop()]}"
                first = "" if len(which) == 1 else ", first" if len(who) == 1 else ", the first one"
                end = f"{where}{first} {self._when(which)}"
                one, many = ("leaves", "leave") if gone else ("comes into", "come into")
                time = self._events[which[0]].time
                yield Told(time, who, f"{one} the picture", f"{many} the picture", tuple(which), end=end)

    def _kinds(self, kinds: tuple[Happening, ...], of: Callable[[Event], tuple[str, ...]]) -> Groups:
        """Events by what is said of them and the noun; where that makes many groups, by the first alone."""
        groups: Groups = {}
        for k, event in self._of(*kinds):
            groups.setdefault((*of(event), self._speech.nouns.of(event.who[0])), []).append(k)
        if len(groups) <= FEW:
            return groups
        wide: Groups = {}
        for k, event in self._of(*kinds):
            wide.setdefault(of(event) if kinds[0] is Happening.TIP else ("",), []).append(k)
        return wide

    def ends(self) -> Iterator[Told]:
        """Who comes to rest and who moves on, of those that are in the picture then."""
        out: set[int] = set()
        for _, event in self._of(Happening.LEAVE, Happening.ENTER):
            (out.add if event.kind is Happening.LEAVE else out.discard)(event.who[0])
        rested = [k for k, event in self._of(Happening.REST) if event.who[0] not in out]
        going = [k for k, event in self._of(Happening.GOES_ON) if event.who[0] not in out]
        if rested:
            end = self._speech.whens([self._events[k].time for k in rested])
            who = _bodies(self._events, rested)
            yield Told(0.0, who, "comes to rest", "come to rest", tuple(rested), end=end)
        if going:
            one = ALONE[Happening.GOES_ON]
            many = "still move when the clip ends"
            yield Told(0.0, _bodies(self._events, going), one, many, tuple(going))

    def stayed(self) -> dict[int, int]:
        """Who never moved, with the events that say so."""
        return {event.who[0]: k for k, event in self._of(Happening.STAY)}


def _bodies(events: Sequence[Event], which: Iterable[int]) -> tuple[int, ...]:
    """Each once."""
    return tuple(dict.fromkeys(events[k].who[0] for k in which))
