"""Events of a clip as JSON, with one sentence for each event and a short caption."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import atan2, pi
from pathlib import Path
from typing import Any

import numpy as np

from physgen.export.event_detection import Event, EventKind, events
from physgen.export.labels import Clip, Writer, write_json
from physgen.scene.scene import Play, Point, View
from physgen.simulate.trajectory import REST_SPEED


@dataclass(frozen=True)
class CaptionStyle:
    """What sentences and captions mention."""

    at_start: float = 0.01
    """s of the clip: an earlier event happens at the start."""
    longest_noun: int = 40
    """Characters."""
    bounce: float = 0.2
    """Of the speed of approach: an object that parts faster from a wall bounces."""
    seen_motion: float = 0.005
    """Of the photo's longer side: the caption leaves out objects that move less."""
    same_speed: float = 0.02
    """Of the speed: a smaller difference between clip and motion is not mentioned."""
    few: int = 2
    most: int = 3
    """Objects of one kind of event that get a sentence each, and sentences of one kind."""


STYLE = CaptionStyle()

COMPASS = (
    *("to the right", "down and to the right", "down", "down and to the left"),
    *("to the left", "up and to the left", "up", "up and to the right"),
)
"""Of image axes, from +x on towards +y."""
LEAVING = {"left": "on the left", "right": "on the right", "top": "at the top", "bottom": "at the bottom"}
ENTERING = {"left": "from the left", "right": "from the right", "top": "from above", "bottom": "from below"}
STARTS = (EventKind.MOVING, EventKind.FALL, EventKind.MOVE)
PUSHES = (EventKind.PUSH, EventKind.PUSH_START)
BORDERS = (EventKind.OUTSIDE, EventKind.LEAVE, EventKind.ENTER)
ENDS = (EventKind.REST, EventKind.GOES_ON)
CAPTION_ORDER = (
    *(
        PUSHES,
        (EventKind.MOVING,),
        (EventKind.FALL, EventKind.MOVE),
        (EventKind.COLLISION,),
        (EventKind.TIP,),
    ),
    *((EventKind.ENTER,), (EventKind.LEAVE,), (EventKind.REST,), (EventKind.GOES_ON,), (EventKind.STAY,)),
)
TIMED = ((EventKind.TIP,), (EventKind.ENTER,), (EventKind.LEAVE,), (EventKind.REST,))
VERBS = {
    EventKind.MOVING: ("moves", "move when the clip starts"),
    EventKind.PUSH: ("is pushed", "are pushed"),
    EventKind.PUSH_START: ("is pushed", "are pushed"),
    EventKind.OUTSIDE: ("is outside the picture when the clip starts", ""),
    EventKind.STAY: ("does not move in this clip", "do not move in this clip"),
    EventKind.MOVE: ("starts to move", "start to move"),
    EventKind.FALL: ("starts to fall", "start to fall"),
    EventKind.TIP: ("tips over", "tip over"),
    EventKind.LEAVE: ("leaves", "leave the picture"),
    EventKind.ENTER: ("comes into", "come into the picture"),
    EventKind.REST: ("comes to rest", "come to rest"),
    EventKind.GOES_ON: ("still moves when the clip ends", "still move when the clip ends"),
}
"""Of one object, and of several in a caption."""
UNITS = {
    "time": "s of the motion",
    "clip_time": "s of the clip as it plays",
    "until": "s of the motion",
    "frame": "of the clip, from 0",
    "place": "px, +x right, +y down, (0, 0) the centre of the top-left pixel",
    "impulse": "g·px/s and N·s",
    "direction": "unit vector: where the second pushes the first",
    "vector": "a push: g·px/s (push) or g·px/s² (push_start, push_end); what moves: px/s",
    "torque": "g·px²/s², positive turns +x towards +y",
    "speed": "px/s of the centres of mass",
    "closing": "px/s at which the two come together at the place where they meet",
    "parting": "px/s at which they part there",
    "far": "px of the photo: how far it comes from where it was, or its rim turns, at most in the clip",
}


class ClipTimes:
    """Times of the motion as frames and seconds of the clip; of what is shown twice, the first time counts."""

    def __init__(self, clip: Clip) -> None:
        self._times, self._order = clip.trajectory.times, clip.shot.order
        self._fps, self._shot = clip.fps, clip.shot
        self._backward = clip.scene.render.play is Play.BACKWARD

    def frame(self, time: float) -> int:
        """The first frame that shows the state after a moment of the motion; played backward, the state before it."""
        last = len(self._times) - 1
        if self._backward:
            sample = max(int(np.searchsorted(self._times, time + 1e-9, side="right")) - 1, 0)
        else:
            sample = min(int(np.searchsorted(self._times, time - 1e-9)), last)
        return self._order.index(sample)

    def shown(self, time: float) -> float:
        """s from the clip's start as it plays; what comes after the last sample is not shown before the start."""
        step = float(self._times[1] - self._times[0]) if len(self._times) > 1 else 1.0
        samples = time / step
        if self._backward:
            samples = max(len(self._times) - 1 - samples, 0.0)
        return samples / self._fps

    def seen(self, at: Point, time: float) -> Point:
        """px of the photo -> px of the video at a moment."""
        x, y = (self._shot.affine(time) @ (*at, 1.0)).tolist()
        return x, y


@dataclass(frozen=True)
class Clause:
    """One sentence of the caption."""

    text: str
    events: tuple[int, ...]
    """Indices of the events that it is made of."""


@dataclass(frozen=True)
class Story:
    """The events of a clip, as data and in words."""

    events: tuple[Event, ...]
    sentences: tuple[str, ...]
    """One an event."""
    clauses: tuple[Clause, ...]

    @property
    def caption(self) -> str:
        """The whole clip, on one line."""
        return " ".join(clause.text for clause in self.clauses)


def story(clip: Clip) -> Story:
    """The events of a clip; the same clip always gives the same story."""
    found = events(clip.world, clip.trajectory, clip.shot, clip.sampled)
    sentences = Sentences(clip)
    texts = tuple(map(sentences.of, found))
    clauses = (*caption(found, texts, sentences), *_playing(clip, found))
    return Story(found, texts, clauses)


def pace(clip: Clip) -> float:
    """s of the clip that a second of the motion takes."""
    times = clip.trajectory.times
    return 1 / (clip.fps * float(times[1] - times[0])) if len(times) > 1 else 1.0


def noun(label: str) -> str:
    """A label as it stands in a sentence; one that is more than a few words is quoted and can end no sentence.

    >>> noun("a red ball"), noun("glass marble, blue"), noun("мяч"), noun("egg. It  explodes")
    ('red ball', 'glass marble', 'мяч', '“egg. It explodes”')
    """
    text = " ".join("".join(" " if unicodedata.category(c)[0] in "CZ" else c for c in label).split())
    short = re.sub(r"^(?:the|an?)\s+(?=\S)", "", re.split(r"\s*[,;(]", text)[0], flags=re.IGNORECASE)
    plain = short and all(c in " '’-" or unicodedata.category(c)[0] in "LMN" for c in short)
    if plain and len(short) <= STYLE.longest_noun:
        return short
    text = re.sub('[“”"]', "'", text)
    return f"“{text if len(text) <= STYLE.longest_noun else text[: STYLE.longest_noun - 1].rstrip() + '…'}”"


def _words(name: str) -> str:
    """A name without its number: `ball-12` is a ball."""
    return re.sub(r"[\s_-]*\d+$", "", name).replace("_", " ").replace("-", " ") or name


class Sentences:
    """One plain English sentence for each event; times are those of the clip as it plays."""

    def __init__(self, clip: Clip) -> None:
        names = [name for name, _ in clip.world.surfaces]
        labels = [item.label.strip() for item in clip.scene.objects] + [""] * len(clip.world.walls)
        nouns = [noun(label or _words(name)) for label, name in zip(labels, names, strict=True)]
        count = Counter(nouns)
        # objects of one label are called by their names
        self._the = [f"the {n}" if count[n] == 1 else name for n, name in zip(nouns, names, strict=True)]
        self.world, self._pace = clip.world, pace(clip)

    def of(self, event: Event) -> str:
        """In the present tense, with a full stop."""
        one, *others = [self._the[k] for k in event.surfaces]
        when = self.when(event.time)
        match event.kind:
            case EventKind.MOVING:
                text = f"{one} {self._moves(event)} when the clip starts"
            case EventKind.PUSH:
                text = f"{one} is {self._pushed(event)} {when}"
            case EventKind.PUSH_START:
                text = f"{one} is {self._pushed(event)} {self._span(event)}"
            case EventKind.PUSH_END:
                text = f"the push on {one} ends {when}"
            case EventKind.CONTACT:
                text = f"{one} touches {others[0]} {self._span(event)}"
            case EventKind.COLLISION:
                text = self._collision(event, when)
            case EventKind.FIRST_TOUCH:
                text = f"{one} touches {others[0]} for the first time {when}"
            case EventKind.LEAVE:
                text = f"{one} leaves the picture {LEAVING[event.side]} {when}"
            case EventKind.ENTER:
                text = f"{one} comes into the picture {ENTERING[event.side]} {when}"
            case EventKind.OUTSIDE | EventKind.STAY | EventKind.GOES_ON:
                text = f"{one} {VERBS[event.kind][0]}"
            case _:
                text = f"{one} {VERBS[event.kind][0]} {when}"
        return f"{text[:1].upper()}{text[1:]}."

    def when(self, time: float) -> str:
        """Of a moment of the motion, in s of the clip."""
        shown = time * self._pace
        return "at the start" if shown < STYLE.at_start else f"after {seconds(shown)}"

    def _span(self, event: Event) -> str:
        """`from the start on`, `from 0.2 s to 0.4 s`; where both read the same, the one moment."""
        since = self.when(event.time)
        until = None if event.until is None else self.when(event.until)
        if until == since:
            return f"for a moment {since}"
        end = "on" if until is None else f"to {until.removeprefix('after ')}"
        return f"from {since.removeprefix('after ').removeprefix('at ')} {end}"

    def _towards(self, vector: Point) -> str:
        """`to the right`, `up and to the left`."""
        words = COMPASS[round(atan2(vector[1], vector[0]) / (pi / 4)) % 8]
        if self.world.view is View.SIDE:
            return words
        return words.replace("up", "up the picture").replace("down", "down the picture")

    def _moves(self, event: Event) -> str:
        if event.vector is None or max(map(abs, event.vector)) < REST_SPEED:
            return "turns"
        return f"moves {self._towards(event.vector)}"

    def _pushed(self, event: Event) -> str:
        if event.vector is not None:
            return f"pushed {self._towards(event.vector)}"
        return "turned clockwise" if (event.torque or 0.0) > 0 else "turned counterclockwise"

    def _collision(self, event: Event, when: str) -> str:
        """The one that moves faster towards the other hits it; a wall never does."""
        (first, second), (mine, its) = event.surfaces, event.nearing or (0.0, 0.0)
        if second < len(self.world.bodies) and its > mine:
            first, second = second, first
        one, other = self._the[first], self._the[second]
        if event.closing < REST_SPEED:  # the impulse passes through a contact that was there already
            return f"{one} and {other} touch, and jolt each other {when}"
        wall = second >= len(self.world.bodies)
        bounces = wall and (event.parting or 0.0) > STYLE.bounce * event.closing
        return f"{one} hits {other} {when}" + (" and bounces" if bounces else "")


def caption(found: Sequence[Event], texts: Sequence[str], sentences: Sentences) -> tuple[Clause, ...]:
    """Pushes and starts, then collisions, tips and picture borders, then ends; many of one kind are counted.

    It is made of the sentences of events (`texts`) that are seen in the picture; never empty.
    """
    world = sentences.world
    least = STYLE.seen_motion * max(world.size)
    moving = {e.surfaces[0] for e in found if e.kind in STARTS and (e.far or 0.0) > least}
    pushed = {e.surfaces[0] for e in found if e.kind in PUSHES}
    seen = [k for k, event in enumerate(found) if event.kind in BORDERS or _in_picture(found, event)]
    stayed = [k for k in seen if found[k].kind is EventKind.STAY]
    if world.bodies and len(stayed) == len(world.bodies):
        return (Clause("Nothing moves.", tuple(stayed)),)
    clauses: list[Clause] = []
    for kinds in CAPTION_ORDER:
        which = [k for k in seen if found[k].kind in kinds]
        if set(kinds) <= {*STARTS, *ENDS}:
            which = [k for k in which if found[k].surfaces[0] in moving]
        if set(kinds) <= set(STARTS):
            which = [k for k in which if found[k].surfaces[0] not in pushed]
        if kinds == (EventKind.COLLISION,):
            which = _first_hits(found, which)
        if not which:
            continue
        first, bodies = found[which[0]], {found[k].surfaces[0] for k in which}
        if len(bodies) <= STYLE.few or first.kind is EventKind.COLLISION:
            clauses += [Clause(texts[k], (k,)) for k in which[: STYLE.most]]
        else:
            times = [found[k].time for k in which]
            last = f", the last one {sentences.when(max(times))}" if kinds in TIMED else ""
            clauses.append(Clause(f"{len(bodies)} objects {VERBS[first.kind][1]}{last}.", tuple(which)))
    ended = (*ENDS, EventKind.STAY)

    def order(clause: Clause) -> tuple[bool, float]:
        event = found[clause.events[0]]
        return (True, 0.0) if event.kind in ended else (False, event.time)

    return tuple(sorted(clauses, key=order)) or (Clause("Nothing happens in the picture.", ()),)


def _first_hits(found: Sequence[Event], which: Sequence[int]) -> list[int]:
    """The first collision of each pair that came together before it."""
    pairs: dict[tuple[int, ...], int] = {}
    for k in which:
        if found[k].closing >= REST_SPEED:
            pairs.setdefault(found[k].surfaces, k)
    return list(pairs.values())


def _in_picture(found: Sequence[Event], event: Event) -> bool:
    """Whether all objects of an event are in the picture when it happens."""
    for surface in event.surfaces:
        passed = [
            e.kind for e in found if e.kind in BORDERS and e.surfaces[0] == surface and e.time <= event.time
        ]
        if passed and passed[-1] is not EventKind.ENTER:
            return False
    return True


def _playing(clip: Clip, found: Sequence[Event]) -> Iterator[Clause]:
    """How the clip plays the motion, where it does not play it as it is."""
    if all(event.kind in (EventKind.STAY, EventKind.CONTACT) for event in found):
        return
    play = {Play.BACKWARD: "backward", Play.THERE_AND_BACK: "forward, then backward"}
    if clip.scene.render.play in play:
        yield Clause(f"The clip shows this {play[clip.scene.render.play]}.", ())
    slow = pace(clip)
    if abs(slow - 1) > STYLE.same_speed:
        factor = f"{slow:.2g} times slower" if slow >= 1 else f"{1 / slow:.2g} times faster"
        yield Clause(f"The clip shows this {factor} than it happens.", ())


def seconds(time: float) -> str:
    """To a hundredth.

    >>> seconds(0.4), seconds(1.234), seconds(12)
    ('0.4 s', '1.23 s', '12 s')
    """
    return f"{time:.2f}".rstrip("0").rstrip(".") + " s"


class Events(Writer):
    """`events.json`, and `caption.txt` with the caption alone."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._clip = folder, clip

    def close(self) -> None:
        """Write both files."""
        clip, found = self._clip, self._clip.shared(story)
        rows = [_event_json(clip, k, event) for k, event in enumerate(found.events)]
        about = {
            "version": 1,
            "clip": clip.name,
            "frames": clip.count,
            "fps": clip.fps,
            "size": list(clip.size),
            "scale": clip.scale.as_dict(),
            "units": UNITS,
            "objects": [
                {"name": item.name, "label": label}
                for item, label in zip(clip.scene.objects, clip.labels, strict=True)
            ],
            "boundaries": [wall.name for wall in clip.world.walls],
            "caption": found.caption,
            "sentences": [{"text": clause.text, "events": list(clause.events)} for clause in found.clauses],
            "events": rows,
        }
        write_json(self._folder / "events.json", about)
        (self._folder / "caption.txt").write_text(found.caption + "\n", encoding="utf-8")


def _event_json(clip: Clip, k: int, event: Event) -> dict[str, Any]:
    """An event as JSON, without empty fields."""
    times, names, N = ClipTimes(clip), [name for name, _ in clip.world.surfaces], len(clip.world.bodies)
    row: dict[str, Any] = {
        "id": k,
        "kind": event.kind.value,
        "time": event.time,
        "clip_time": times.shown(event.time),
        "until": event.until,
        "frame": times.frame(event.time),
        "who": [names[k] for k in event.surfaces],
        "objects": [names[k] for k in event.surfaces if k < N],
        "boundaries": [names[k] for k in event.surfaces if k >= N],
    }
    if event.at is not None:
        row["place"] = {"photo": list(event.at), "video": list(times.seen(event.at, event.time))}
    if event.impulse is not None:
        newton = clip.scale.newton_seconds(event.impulse)
        row["impulse"] = {"g_px_s": event.impulse, "N_s": newton}
    if event.vector is not None:
        row["direction" if event.nearing is not None else "vector"] = list(event.vector)
    if event.nearing is not None:
        row["speed"] = {"before": list(event.before), "after": list(event.after)}
        row |= {"closing": event.closing, "parting": event.parting}
    if event.torque is not None:
        row["torque"] = event.torque
    if event.far is not None:
        row["far"] = event.far
    if event.side:
        row["side"] = event.side
    return {key: value for key, value in row.items() if value is not None} | {
        "text": clip.shared(story).sentences[k]
    }
