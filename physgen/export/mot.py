"""MOT Challenge text: boxes and tracks of objects (Milan et al., 2016)."""

from __future__ import annotations

from pathlib import Path

from physgen.export.labels import Clip, Moment, Writer

FIRST = 1
"""The MOT Challenge's number of the first column and row of px."""


class Mot(Writer):
    """`frame, id, left, top, width, height, 1, class, visibility`; frames, ids, classes and px count from 1.

    The box holds hidden parts and ends at the picture's borders; visibility is the visible share of what is in the
    picture. `gt/labels.txt` has the classes' names, one a line; labels may hold line breaks, which become spaces.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        home = folder / clip.name
        self._clip, self._images, self._truth = clip, home / "img1", home / "gt" / "gt.txt"
        for made in (self._images, self._truth.parent):
            made.mkdir(parents=True)
        info = f"name={clip.name}\nimDir=img1\nframeRate={clip.fps:g}\nseqLength={clip.count}\n"
        info += f"imWidth={clip.size[0]}\nimHeight={clip.size[1]}\nimExt=.jpg\n"
        (home / "seqinfo.ini").write_text(f"[Sequence]\n{info}", encoding="utf-8")
        names = "".join(" ".join(label.split()) + "\n" for label in clip.categories)
        (home / "gt" / "labels.txt").write_text(names, encoding="utf-8")
        self._truth.write_text("", encoding="utf-8")

    def add(self, moment: Moment) -> None:
        """A line for each object that reaches into the picture."""
        view = moment.view
        (self._images / f"{view.index + 1:06d}.jpg").write_bytes(view.jpeg)
        with self._truth.open("a", encoding="utf-8") as file:
            for presence in view.presences:
                x, y, w, h = presence.box
                number = self._clip.classes[presence.body]
                row = (view.index + 1, presence.body + 1, x + FIRST, y + FIRST, w, h, 1, number)
                file.write(",".join(map(str, row)) + f",{presence.visible:.6g}\n")
