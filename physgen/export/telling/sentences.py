"""Event -> one sentence that says it, and nothing else."""

from __future__ import annotations

from physgen.export.telling.event import Event, Happening
from physgen.export.telling.speech import ALONE, AT_ONCE, AWAY, INTO, SOON, Speech, capital
from physgen.simulate.settled import STILL


def sentence(event: Event, speech: Speech) -> str:
    """Plain English in the present tense, with a full stop; times are those of the clip as it plays."""
    return capital(TELL.get(event.kind, _alone)(event, speech)) + "."


def _alone(event: Event, speech: Speech) -> str:
    who, does = speech.nouns.the(event.who[0]), ALONE[event.kind]
    if event.kind in (Happening.OUTSIDE, Happening.STAY, Happening.GOES_ON):
        return f"{who} {does}"
    if event.kind is Happening.MOVE and event.vector is not None and max(map(abs, event.vector)) >= STILL:
        does += f" {speech.towards(event.vector)}"
    soon = event.kind in (Happening.MOVE, Happening.FALL) and event.time * speech.pace < SOON
    return f"{who} {does} {AT_ONCE if soon else speech.when(event.time)}"


def _moving(event: Event, speech: Speech) -> str:
    moves = moving(event, speech)[0]
    return f"{speech.nouns.the(event.who[0])} {moves} when the clip starts"


def moving(event: Event, speech: Speech) -> tuple[str, str]:
    """What one does that moves from the start, and what several do."""
    if event.vector is None or max(map(abs, event.vector)) < STILL:
        return "turns", "turn"
    where = speech.towards(event.vector)
    return f"moves {where}", f"move {where}"


def _push(event: Event, speech: Speech) -> str:
    return f"{speech.nouns.the(event.who[0])} {speech.shoved(event)[0]} {speech.when(event.time)}"


def _push_start(event: Event, speech: Speech) -> str:
    return f"{speech.nouns.the(event.who[0])} {speech.shoved(event)[0]} {_span(event, speech)}"


def _span(event: Event, speech: Speech) -> str:
    """`from the start on`, `from 0.2 s to 0.4 s`; where both are the same to read, when it was."""
    since = speech.when(event.time)
    until = None if event.until is None else speech.when(event.until)
    if until == since:
        return f"for a moment {since}"
    end = "on" if until is None else f"to {until.removeprefix('after ')}"
    return f"from {since.removeprefix('after ').removeprefix('at ')} {end}"


def _push_end(event: Event, speech: Speech) -> str:
    return f"the push on {speech.nouns.the(event.who[0])} ends {speech.when(event.time)}"


def _contact(event: Event, speech: Speech) -> str:
    one, other = event.who
    return f"{speech.nouns.the(one)} touches {speech.nouns.other(other, one)} {_span(event, speech)}"


def _collision(event: Event, speech: Speech) -> str:
    one, other = speech.hitter(event)
    who, whom, when = speech.nouns.the(one), speech.nouns.other(other, one), speech.when(event.time)
    if event.closing < STILL:  # it passes through what touched already
        return f"{who} and {whom} touch, and jolt each other {when}"
    return f"{who} hits {whom} {when}" + (" and bounces" if speech.bounces(event) else "")


def _first_touch(event: Event, speech: Speech) -> str:
    one, other = event.who
    who, whom = speech.nouns.the(one), speech.nouns.other(other, one)
    return f"{who} first meets something new {speech.when(event.time)}: {whom}"


def _tip(event: Event, speech: Speech) -> str:
    over = "over " if speech.stands(event) == "tip" else ""
    return f"{speech.nouns.the(event.who[0])} {speech.stands(event)}s {over}{speech.when(event.time)}"


def _leave(event: Event, speech: Speech) -> str:
    who = speech.nouns.the(event.who[0])
    return f"{who} leaves the picture {AWAY[event.side]} {speech.when(event.time)}"


def _enter(event: Event, speech: Speech) -> str:
    who = speech.nouns.the(event.who[0])
    return f"{who} comes into the picture {INTO[event.side]} {speech.when(event.time)}"


TELL = {
    Happening.MOVING: _moving,
    Happening.PUSH: _push,
    Happening.PUSH_START: _push_start,
    Happening.PUSH_END: _push_end,
    Happening.CONTACT: _contact,
    Happening.COLLISION: _collision,
    Happening.FIRST_TOUCH: _first_touch,
    Happening.TIP: _tip,
    Happening.LEAVE: _leave,
    Happening.ENTER: _enter,
}
