"""MOT Challenge and MOTS text: boxes, masks and tracks of objects (Milan et al., 2016; Voigtlaender et al., 2019)."""

from __future__ import annotations

from pathlib import Path

from physgen.export.labels import Clip, Moment, View, Writer
from physgen.export.masks import Presence, compressed

FIRST = 1
"""The MOT Challenge's number of the first column and row of px."""
PEDESTRIAN = 2
"""MOTS tools know two classes, 1 for cars and 2 for pedestrians, and the challenge's own measures read 2 alone."""
IDS_PER_CLASS = 1000
"""MOTS tools divide an id by it to get the class."""


class MotFolder:
    """`img1/000001.jpg` ..., `seqinfo.ini`, and the lines of `gt/gt.txt`, written frame by frame."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self.home = folder / clip.name
        self._images, self._truth = self.home / "img1", self.home / "gt" / "gt.txt"
        for made in (self._images, self._truth.parent):
            made.mkdir(parents=True)
        self._truth.write_text("", encoding="utf-8")
        info = f"name={clip.name}\nimDir=img1\nframeRate={clip.fps:g}\nseqLength={clip.count}\n"
        info += f"imWidth={clip.size[0]}\nimHeight={clip.size[1]}\nimExt=.jpg\n"
        (self.home / "seqinfo.ini").write_text(f"[Sequence]\n{info}", encoding="utf-8")

    def add(self, view: View, lines: list[str]) -> None:
        """A frame and its lines."""
        (self._images / f"{view.index + 1:06d}.jpg").write_bytes(view.jpeg)
        if lines:
            with self._truth.open("a", encoding="utf-8") as file:
                file.write("\n".join(lines) + "\n")

    def write_names(self, name: str, lines: list[str]) -> None:
        """A file in `gt/`; labels may hold line breaks, which become spaces."""
        text = "".join(" ".join(line.split()) + "\n" for line in lines)
        (self.home / "gt" / name).write_text(text, encoding="utf-8")


class Mot(Writer):
    """`frame, id, left, top, width, height, 1, class, visibility`; frames, ids, classes and px count from 1.

    The box holds hidden parts, and parts beyond the picture; visibility is the visible share of all of the object.
    `gt/labels.txt` has the classes' names, one a line.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._clip = MotFolder(folder, clip), clip
        self._folder.write_names("labels.txt", list(clip.categories))

    def add(self, moment: Moment) -> None:
        """A line for each object that reaches into the picture."""
        view = moment.view
        self._folder.add(view, [self._line(view, presence) for presence in view.presences])

    def _line(self, view: View, presence: Presence) -> str:
        (x0, y0, x1, y1), inside = self._clip.amodal(view, presence)
        numbers = (x0 + FIRST, y0 + FIRST, x1 - x0, y1 - y0)
        box = ",".join(f"{number:.2f}".rstrip("0").rstrip(".") for number in numbers)
        number = self._clip.classes[presence.body]
        return f"{view.index + 1},{presence.body + 1},{box},1,{number},{presence.visible * inside:.6g}"


class Mots(Writer):
    """`frame id class height width mask`; frames count from 1, masks are COCO's compressed run lengths.

    Every object has the class `PEDESTRIAN`. `gt/tracks.txt` has the label of each id.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder = MotFolder(folder, clip)
        self._folder.write_names(
            "tracks.txt", [f"{_id(body)} {label}" for body, label in enumerate(clip.labels)]
        )

    def add(self, moment: Moment) -> None:
        """A line for each visible object."""
        view = moment.view
        width, height = view.size
        lines = []
        for presence in view.presences:
            if presence.seen_area:
                mask = compressed(presence.seen, presence.box, view.size)
                number = _id(presence.body)
                lines.append(f"{view.index + 1} {number} {PEDESTRIAN} {height} {width} {mask}")
        self._folder.add(view, lines)


def _id(body: int) -> int:
    return PEDESTRIAN * IDS_PER_CLASS + body + 1
