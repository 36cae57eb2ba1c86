"""Events of a clip as JSON, with one sentence for each event and a short caption."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, pi
from pathlib import Path
from typing import Any

import numpy as np

from physgen.export.event_detection import Event, EventKind, events
from physgen.export.labels import Clip, Writer, write_json
from physgen.scene.scene import Play, Point
from physgen.simulate.trajectory import REST_SPEED

AT_START = 0.01
"""s of the clip: an earlier event happens at the start."""
LONGEST_NOUN = 40
"""Characters: an object with a longer label is called by its name."""
MOST = 3
"""Objects of one kind of event that get a sentence each in the caption."""
SAME_PACE = 0.02
"""Of the speed: a smaller difference between clip and motion is not mentioned."""

COMPASS = (
    *("to the right", "down and to the right", "down", "down and to the left"),
    *("to the left", "up and to the left", "up", "up and to the right"),
)
"""Of image axes, from +x on towards +y."""
BORDERS = {"left": "on the left", "right": "on the right", "top": "at the top", "bottom": "at the bottom"}
VERBS = {
    EventKind.MOVING: ("moves", "move"),
    EventKind.PUSH: ("is pushed", "are pushed"),
    EventKind.MOVE: ("starts to move", "start to move"),
    EventKind.FALL: ("starts to fall", "start to fall"),
    EventKind.COLLISION: ("hits", "hit"),
    EventKind.TIP: ("tips over", "tip over"),
    EventKind.LEAVE: ("leaves the picture", "leave the picture"),
    EventKind.ENTER: ("comes into the picture", "come into the picture"),
    EventKind.REST: ("comes to rest", "come to rest"),
}
"""Of one object, and of several in a caption."""
UNITS = {
    "time, until": "s of the motion",
    "clip_time": "s of the clip as it plays",
    "frame": "of the clip, from 0",
    "place": "px, +x right, +y down, (0, 0) the centre of the top-left pixel",
    "impulse": "g·px/s and N·s",
    "vector": "collision: where the second pushes the first, unit; push: g·px/s or g·px/s²; what moves: px/s",
    "torque": "g·px²/s², positive turns +x towards +y",
    "closing": "px/s at which the two come together at the place where they meet",
}


class ClipTimes:
    """Times of the motion as frames and seconds of the clip; of what is shown twice, the first time counts."""

    def __init__(self, clip: Clip) -> None:
        self._times, self._order, self._fps = clip.trajectory.times, clip.shot.order, clip.fps
        self._backward = clip.scene.render.play is Play.BACKWARD
        self._step = float(self._times[1] - self._times[0]) if len(self._times) > 1 else 1.0
        self.pace = 1 / (clip.fps * self._step) if len(self._times) > 1 else 1.0
        """s of the clip that a second of the motion takes."""

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
        samples = time / self._step
        if self._backward:
            samples = max(len(self._times) - 1 - samples, 0.0)
        return samples / self._fps


@dataclass(frozen=True)
class Story:
    """The events of a clip, as data and in words."""

    events: tuple[Event, ...]
    sentences: tuple[str, ...]
    """One an event."""
    caption: str
    """The whole clip, on one line."""


def story(clip: Clip) -> Story:
    """The events of a clip; the same clip always gives the same story."""
    found = events(clip.world, clip.trajectory, clip.shot, clip.sampled)
    sentences = Sentences(clip)
    texts = tuple(map(sentences.of, found))
    return Story(found, texts, caption(clip, found, texts))


def seconds(time: float) -> str:
    """To a hundredth.

    >>> seconds(0.4), seconds(1.234), seconds(12)
    ('0.4 s', '1.23 s', '12 s')
    """
    return f"{time:.2f}".rstrip("0").rstrip(".") + " s"


def noun(label: str, name: str) -> str:
    """What an object is called: its label up to a comma, or the name where that is no few plain words.

    >>> noun("a red ball", "ball-1"), noun("glass marble, blue", "m"), noun("egg. It explodes", "egg-12")
    ('red ball', 'glass marble', 'egg')
    """
    text = re.sub(r"^(?:the|an?)\s+(?=\S)", "", label.split(",")[0].strip(), flags=re.IGNORECASE)
    if text and len(text) <= LONGEST_NOUN and all(c.isalnum() or c in " '-" for c in text):
        return text
    return re.sub(r"[\s_-]*\d+$", "", name).replace("_", " ").replace("-", " ") or name


class Sentences:
    """One plain English sentence for each event; times are those of the clip as it plays."""

    def __init__(self, clip: Clip) -> None:
        names = [name for name, _ in clip.world.surfaces]
        labels = [item.label for item in clip.scene.objects] + [""] * len(clip.world.walls)
        nouns = [noun(label, name) for label, name in zip(labels, names, strict=True)]
        count = Counter(nouns)
        # objects of one label are called by their names
        self._the = [f"the {n}" if count[n] == 1 else name for n, name in zip(nouns, names, strict=True)]
        self._pace = ClipTimes(clip).pace

    def of(self, event: Event) -> str:
        """In the present tense, with a full stop."""
        one, *others = [self._the[k] for k in event.surfaces]
        shown, verb = event.time * self._pace, VERBS[event.kind][0]
        if _is_jolt(event):
            verb = "jolts"
        elif event.kind is EventKind.PUSH and event.vector is None:
            verb = "is turned"
        words = [one, verb, *others]
        if (
            event.kind in (EventKind.MOVING, EventKind.PUSH)
            and event.vector is not None
            and any(event.vector)
        ):
            x, y = event.vector
            words.append(COMPASS[round(atan2(y, x) / (pi / 4)) % 8])
        if event.kind in (EventKind.LEAVE, EventKind.ENTER):
            words.append(BORDERS[event.side])
        words.append("at the start" if shown < AT_START else f"after {seconds(shown)}")
        text = " ".join(words)
        return f"{text[:1].upper()}{text[1:]}."


def _is_jolt(event: Event) -> bool:
    """Whether the impulse of a collision passes through a contact that was there already."""
    return event.closing is not None and event.closing < REST_SPEED


def caption(clip: Clip, found: Sequence[Event], texts: Sequence[str]) -> str:
    """The sentences of events that are seen in the picture, by time; of a kind that many objects have, the number.

    Of collisions, the first of each pair that came together before it; what is pushed moves, of course.
    """
    pushed = {event.surfaces for event in found if event.kind is EventKind.PUSH}
    first: dict[EventKind, dict[tuple[int, ...], int]] = {}
    for k, event in enumerate(found):
        known = event.kind is EventKind.MOVE and event.surfaces in pushed
        if not known and not _is_jolt(event) and _in_picture(clip, event):
            first.setdefault(event.kind, {}).setdefault(tuple(sorted(event.surfaces)), k)
    lines: list[tuple[float, str]] = []
    for kind, which in first.items():
        rows = list(which.values())
        if len(rows) > MOST and kind is not EventKind.COLLISION:
            lines.append((found[rows[0]].time, f"{len(rows)} objects {VERBS[kind][1]}."))
        else:
            lines += [(found[k].time, texts[k]) for k in rows[:MOST]]
    words = [text for _, text in sorted(lines, key=lambda line: line[0])] or ["Nothing moves."]
    if clip.scene.render.play is not Play.FORWARD:
        words.append(f"The clip shows this {clip.scene.render.play.value.replace('-', ' ')}.")
    pace = ClipTimes(clip).pace
    if abs(pace - 1) > SAME_PACE:
        factor = f"{pace:.2g} times slower" if pace >= 1 else f"{1 / pace:.2g} times faster"
        words.append(f"The clip shows this {factor} than it happens.")
    return " ".join(words)


def _in_picture(clip: Clip, event: Event) -> bool:
    """Whether an event is seen."""
    (x, y), (width, height) = _place_seen(clip, event), clip.size
    return event.kind in (EventKind.LEAVE, EventKind.ENTER) or (0 <= x < width and 0 <= y < height)


def _place_seen(clip: Clip, event: Event) -> Point:
    """px of the video."""
    x, y = (clip.shot.affine(event.time) @ (*event.at, 1.0)).tolist()
    return x, y


class Events(Writer):
    """`events.json`, and `caption.txt` with the caption alone."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._clip = folder, clip

    def close(self) -> None:
        """Write both files."""
        clip, found = self._clip, story(self._clip)
        about = {
            "version": 2,
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
            "events": [
                _event_json(clip, event, text)
                for event, text in zip(found.events, found.sentences, strict=True)
            ],
        }
        write_json(self._folder / "events.json", about)
        (self._folder / "caption.txt").write_text(found.caption + "\n", encoding="utf-8")


def _event_json(clip: Clip, event: Event, text: str) -> dict[str, Any]:
    """An event as JSON, without empty fields."""
    times, names = ClipTimes(clip), [name for name, _ in clip.world.surfaces]
    impulse = event.impulse
    row: dict[str, Any] = {
        "kind": event.kind.value,
        "time": event.time,
        "clip_time": times.shown(event.time),
        "until": event.until,
        "frame": times.frame(event.time),
        "who": [names[k] for k in event.surfaces],
        "place": {"photo": list(event.at), "video": list(_place_seen(clip, event))},
        "impulse": None
        if impulse is None
        else {"g_px_s": impulse, "N_s": clip.scale.newton_seconds(impulse)},
        "vector": None if event.vector is None else list(event.vector),
        "torque": event.torque or None,
        "closing": event.closing,
        "side": event.side or None,
        "text": text,
    }
    return {key: value for key, value in row.items() if value is not None}
