"""Views -> the text of MOTS (Voigtlaender et al., CVPR 2019): a line a frame and object that is seen, with its mask.

`frame id class height width mask`; frames count from 1, and masks are COCO's compressed run lengths. Every object has
the class 2: its tools know no others than 1, a car, and 2, a pedestrian, and the challenge's own measures read 2 alone.
"""

from __future__ import annotations

from pathlib import Path

from physgen.export.motion import Moment
from physgen.export.runs import compressed
from physgen.export.sequence import Sequence, one_line
from physgen.export.truth import Clip

CLASS = 2
APART = 1000
"""Ids of one class: tools divide by it."""


class Mots:
    """`gt/gt.txt`; `gt/tracks.txt` has what each id is."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._sequence = Sequence(folder, clip)
        tracks = "".join(f"{_id(body)} {one_line(label)}\n" for body, label in enumerate(clip.labels))
        (self._sequence.home / "gt" / "tracks.txt").write_text(tracks, encoding="utf-8")

    def add(self, moment: Moment) -> None:
        """A line for each object that is seen."""
        view = moment.view
        width, height = view.size
        head = f"{view.index + 1} "
        lines = [
            f"{head}{_id(thing.body)} {CLASS} {height} {width} {compressed(thing.seen, thing.box, view.size)}"
            for thing in view.presences
            if thing.seen_area
        ]
        self._sequence.add(view, lines)

    def close(self) -> None:
        """Nothing is left to be said."""


def _id(body: int) -> int:
    return CLASS * APART + body + 1
