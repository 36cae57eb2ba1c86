"""Motion -> events.json and events.csv, what happens in the clip and a sentence for each; caption.txt, all in a few.

Times are s of the motion and s of the clip as it plays; places are px of the photo, and of the video.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from physgen.export.motion import Moment
from physgen.export.plain import write_json
from physgen.export.scale import Scale
from physgen.export.telling.event import Event
from physgen.export.telling.reel import Reel
from physgen.export.truth import Clip

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
COLUMNS = (
    *("id", "kind", "time_s", "clip_time_s", "until_s", "frame"),
    *("first", "second", "first_is", "second_is"),
    *("x_px", "y_px", "video_x_px", "video_y_px"),
    *("impulse_g_px_s", "impulse_N_s", "vector_x", "vector_y", "torque_g_px2_s2"),
    *("first_before_px_s", "first_after_px_s", "second_before_px_s", "second_after_px_s"),
    *("closing_px_s", "parting_px_s", "far_px", "side", "sentence"),
)


class Events:
    """Both files hold the same events, in one order."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._clip = folder, clip

    def add(self, moment: Moment) -> None:
        """Pictures tell nothing new."""

    def close(self) -> None:
        """Write all."""
        clip, story = self._clip, self._clip.story
        told = [_told(clip, k, event) for k, event in enumerate(story.events)]
        about = {
            "version": 1,
            "clip": clip.name,
            "frames": clip.count,
            "fps": clip.fps,
            "size": list(clip.size),
            "scale": Scale.of(clip.scene).as_dict(),
            "units": UNITS,
            "objects": [
                {"name": item.name, "label": label}
                for item, label in zip(clip.scene.objects, clip.labels, strict=True)
            ],
            "boundaries": [wall.name for wall in clip.world.walls],
            "caption": story.caption,
            "sentences": [{"text": clause.text, "events": list(clause.events)} for clause in story.clauses],
            "events": told,
        }
        write_json(self._folder / "events.json", about)
        with (self._folder / "events.csv").open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(COLUMNS)
            rows.writerows(_row(event) for event in told)
        (self._folder / "caption.txt").write_text(story.caption + "\n", encoding="utf-8")


def _told(clip: Clip, k: int, event: Event) -> dict[str, Any]:
    """An event as JSON; what it has not is left out."""
    reel, names, N = Reel(clip), [name for name, _ in clip.world.surfaces], len(clip.world.bodies)
    told: dict[str, Any] = {
        "id": k,
        "kind": event.kind.value,
        "time": event.time,
        "clip_time": reel.shown(event.time),
        "until": event.until,
        "frame": reel.frame(event.time),
        "who": [names[who] for who in event.who],
        "objects": [names[who] for who in event.who if who < N],
        "boundaries": [names[who] for who in event.who if who >= N],
    }
    if event.at is not None:
        told["place"] = {"photo": list(event.at), "video": list(reel.seen(event.at, event.time))}
    if event.impulse is not None:
        newton = Scale.of(clip.scene).newton_seconds(event.impulse)
        told["impulse"] = {"g_px_s": event.impulse, "N_s": newton}
    if event.vector is not None:
        told["direction" if event.nearing is not None else "vector"] = list(event.vector)
    if event.nearing is not None:
        told["speed"] = {"before": list(event.before), "after": list(event.after)}
        told |= {"closing": event.closing, "parting": event.parting}
    if event.torque is not None:
        told["torque"] = event.torque
    if event.far is not None:
        told["far"] = event.far
    if event.side:
        told["side"] = event.side
    return {key: value for key, value in told.items() if value is not None} | {
        "text": clip.story.sentences[k]
    }


def _row(told: dict[str, Any]) -> list[Any]:
    """The same in the order of the columns; floats to the last bit."""
    who = [*told["who"], ""][:2]
    kinds = [*["object"] * len(told["objects"]), *["boundary"] * len(told["boundaries"]), ""][
        :2
    ]  # objects first
    place, impulse, speed = told.get("place", {}), told.get("impulse", {}), told.get("speed", {})
    vector = told.get("direction") or told.get("vector") or ["", ""]
    before, after = [*speed.get("before", []), "", ""], [*speed.get("after", []), "", ""]
    cells = [
        *(told["id"], told["kind"], told["time"], told["clip_time"], told.get("until", ""), told["frame"]),
        *(*who, *kinds),
        *(*place.get("photo", ["", ""]), *place.get("video", ["", ""])),
        *(impulse.get("g_px_s", ""), impulse.get("N_s", ""), *vector, told.get("torque", "")),
        *(before[0], after[0], before[1], after[1]),
        *(
            told.get("closing", ""),
            told.get("parting", ""),
            told.get("far", ""),
            told.get("side", ""),
            told["text"],
        ),
    ]
    return ["" if cell is None else cell for cell in cells]
