"""Views -> the MOT Challenge's text (Milan et al., 2016): a line a frame and object, with the box of all of it.

`frame, id, left, top, width, height, 1, class, visibility`; frames, ids, classes and px count from 1. The box goes on
where something hides the object or the picture ends; visibility is the share of all its pixels that is seen.
"""

from __future__ import annotations

from pathlib import Path

from physgen.export.motion import Moment
from physgen.export.presence import Presence
from physgen.export.sequence import Sequence, one_line
from physgen.export.truth import Clip, View

FIRST = 1
"""The challenge's number for the first column and row of px."""


class Mot:
    """`gt/gt.txt`; `gt/labels.txt` has the classes' names, one a line."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._sequence, self._clip = Sequence(folder, clip), clip
        names = "".join(f"{one_line(name)}\n" for name in clip.categories)
        (self._sequence.home / "gt" / "labels.txt").write_text(names, encoding="utf-8")

    def add(self, moment: Moment) -> None:
        """A line for each object that reaches into the picture."""
        view = moment.view
        self._sequence.add(view, [self._line(view, thing) for thing in view.presences])

    def close(self) -> None:
        """Nothing is left to be said."""

    def _line(self, view: View, thing: Presence) -> str:
        all_of_it = self._clip.amodal(view, thing)
        x0, y0, x1, y1 = all_of_it.box
        box = ",".join(_short(number) for number in (x0 + FIRST, y0 + FIRST, x1 - x0, y1 - y0))
        visible = thing.visible * all_of_it.inside
        return f"{view.index + 1},{thing.body + 1},{box},1,{self._clip.classes[thing.body]},{visible:.6g}"


def _short(number: float) -> str:
    """To 1/100 px; no point where there is nothing behind it."""
    return f"{number:.2f}".rstrip("0").rstrip(".")
