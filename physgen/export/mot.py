"""MOT Challenge and MOTS text: boxes, masks and tracks of objects (Milan et al., 2016; Voigtlaender et al., 2019)."""

from __future__ import annotations

from pathlib import Path

from physgen.export.labels import Clip, Moment, View
from physgen.export.masks import Presence, compressed

# ----------------------------------------------------------------------
# Views -> a sequence's folder as the MOT Challenge has it: `img1/000001.jpg` ... and `seqinfo.ini`.


class MotFolder:
    """What MOT and MOTS share; lines of `gt/gt.txt` go to the file as they come."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self.home = folder / clip.name
        self._images, self._truth = self.home / "img1", self.home / "gt" / "gt.txt"
        for made in (self._images, self._truth.parent):
            made.mkdir(parents=True)
        self._truth.write_text("", encoding="utf-8")
        (self.home / "seqinfo.ini").write_text(_info(clip), encoding="utf-8")

    def add(self, view: View, lines: list[str]) -> None:
        """A picture, and what `gt.txt` says of it."""
        (self._images / f"{view.index + 1:06d}.jpg").write_bytes(view.jpeg)
        if lines:
            with self._truth.open("a", encoding="utf-8") as file:
                file.write("\n".join(lines) + "\n")


def one_line(label: str) -> str:
    """A label, in files that have one a line."""
    return " ".join(label.split())


def _info(clip: Clip) -> str:
    width, height = clip.size
    told = {
        "name": clip.name,
        "imDir": "img1",
        "frameRate": f"{clip.fps:g}",
        "seqLength": clip.count,
        "imWidth": width,
        "imHeight": height,
        "imExt": ".jpg",
    }
    return "[Sequence]\n" + "".join(f"{key}={value}\n" for key, value in told.items())


# ----------------------------------------------------------------------
# Views -> the MOT Challenge's text (Milan et al., 2016): a line a frame and object, with the box of all of
# it.
#
# `frame, id, left, top, width, height, 1, class, visibility`; frames, ids, classes and px count from 1. The
# box goes on
# where something hides the object or the picture ends; visibility is the share of all its pixels that is
# seen.

FIRST = 1
"""The challenge's number for the first column and row of px."""


class Mot:
    """`gt/gt.txt`; `gt/labels.txt` has the classes' names, one a line."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._sequence, self._clip = MotFolder(folder, clip), clip
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


# ----------------------------------------------------------------------
# Views -> the text of MOTS (Voigtlaender et al., CVPR 2019): a line a frame and object that is seen, with its
# mask.
#
# `frame id class height width mask`; frames count from 1, and masks are COCO's compressed run lengths. Every
# object has
# the class 2: its tools know no others than 1, a car, and 2, a pedestrian, and the challenge's own measures
# read 2 alone.

CLASS = 2
APART = 1000
"""Ids of one class: tools divide by it."""


class Mots:
    """`gt/gt.txt`; `gt/tracks.txt` has what each id is."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._sequence = MotFolder(folder, clip)
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
