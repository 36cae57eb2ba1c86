"""Events of a clip -> the few sentences that tell it: what starts, what meets what, and how it ends.

Each is made of events alone, and names them: whoever doubts a sentence looks there. Of much that happens the first and
the last is told, and the rest counted; what is not told is still an event.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
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
LEAST = 0.005
"""Of the photo's longer side: who moves no farther is not told to start, to rest or to go on."""
STIRRED = 0.1
"""s after a push or a blow in which what it stirs starts to move: a slow start takes a while to show."""
Groups = dict[tuple[str, ...], list[int]]
STARTS = (Happening.MOVING, Happening.FALL, Happening.MOVE)
CROSSING = (Happening.OUTSIDE, Happening.LEAVE, Happening.ENTER)
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
        clauses.append(Clause(mentions.more(len({events[k].who[0] for k in left})), left))
    clauses += [_said(told, mentions) for told in sorted(plot.middle(), key=lambda told: told.time)]
    clauses += [_said(told, mentions) for told in plot.ends()]
    if stayed := plot.stayed():
        told = {k for clause in clauses for number in clause.events for k in events[number].who}
        clauses.append(_unmoved(stayed, told, len(speech.world.bodies), mentions))
    return tuple(clauses) or (Clause("Nothing happens in the picture.", ()),)


def _said(told: Told, mentions: Mentions) -> Clause:
    single = len(told.who) == 1
    who = mentions.subject(told.who)
    does = told.one if single else told.many
    whom = "" if told.whom is None else f" {mentions.object(told.whom)}"
    end = told.end if single or told.ends is None else told.ends
    return Clause(capital(f"{who} {does}{whom}{end}") + ".", told.events)


def _unmoved(stayed: dict[int, int], told: Collection[int], bodies: int, mentions: Mentions) -> Clause:
    if len(stayed) == bodies:
        return Clause("Nothing moves.", tuple(stayed.values()))
    does = "does" if len(stayed) == 1 else "do"
    return Clause(
        f"{capital(mentions.unmoved(tuple(stayed), told))} {does} not move.", tuple(stayed.values())
    )


class _Plot:
    """What is worth telling."""

    def __init__(self, events: Sequence[Event], speech: Speech) -> None:
        self._events, self._speech = events, speech
        least = LEAST * max(speech.world.size)
        self._plain = {
            event.who[0] for event in events if event.kind in STARTS and (event.far or 0.0) > least
        }
        """Who moves so that anybody sees it."""
        self._felled: set[int] = set()
        """Of whom it is told elsewhere that they tip."""

        self._crossings: dict[int, list[tuple[float, bool]]] = {}
        """Of who is not always in the picture: from when on they are out, or are not."""
        for event in events:
            if event.kind in CROSSING:
                out = event.kind is not Happening.ENTER
                self._crossings.setdefault(event.who[0], []).append((event.time, out))

    def _of(self, *kinds: Happening) -> Iterator[tuple[int, Event]]:
        """Of what can be seen; and who comes and goes."""
        return (
            (k, event)
            for k, event in enumerate(self._events)
            if event.kind in kinds and (event.kind in CROSSING or self._seen(event))
        )

    def _seen(self, event: Event) -> bool:
        """Whether all of whom it tells are in the picture."""
        for who in event.who:
            passed = [out for time, out in self._crossings.get(who, ()) if time <= event.time]
            if passed and passed[-1]:
                return False
        return True

    def _when(self, which: Iterable[int]) -> str:
        """Of the first of some events."""
        return self._speech.when(min(self._events[k].time for k in which))

    def starts(self) -> tuple[list[Told], tuple[int, ...]]:
        """What is pushed, what moves when the clip starts, what starts to move then; and the events of all the rest."""
        pushed = {event.who[0] for _, event in self._of(*PUSHES)}
        groups: dict[tuple[str, str, float], list[int]] = {}
        for k, event in self._of(*PUSHES, *STARTS):
            soon = event.time * self._speech.pace < SOON
            if event.kind in PUSHES:
                words = self._speech.shoved(event)
            elif soon and event.who[0] in self._plain - pushed:
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
        """Who meets whom, starts to move by itself, tips, leaves the picture and comes back."""
        yield from self._met()
        yield from self._by_itself()
        yield from self._tips()
        yield from self._borders()

    def _met(self) -> Iterator[Told]:
        for meeting in meetings(self._events, self._speech, self._seen)[:MOST]:
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

    def _by_itself(self) -> Iterator[Told]:
        """What stood still for a while, and was neither pushed nor hit when it started."""
        shaken = [e for _, e in self._of(*PUSHES, Happening.COLLISION)]
        found = []
        for k, event in self._of(Happening.MOVE, Happening.FALL):
            since = (event.time - e.time for e in shaken if event.who[0] in e.who)
            stirred = any(-STIRRED / 10 < s < STIRRED for s in since)
            if event.time * self._speech.pace >= SOON and event.who[0] in self._plain and not stirred:
                found.append(k)
        if found:
            first = self._when(found)
            end = f" {first}" if len(found) == 1 else f", the first one {first}"
            time = self._events[found[0]].time
            yield Told(
                time, _bodies(self._events, found), "starts to move", "start to move", tuple(found), end=end
            )

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
        """Who comes to rest and who moves on."""
        rested = [k for k, event in self._of(Happening.REST) if event.who[0] in self._plain]
        going = [k for k, event in self._of(Happening.GOES_ON) if event.who[0] in self._plain]
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
