"""Views -> a sequence's folder as the MOT Challenge has it: `img1/000001.jpg` ... and `seqinfo.ini`."""

from __future__ import annotations

from pathlib import Path

from physgen.export.truth import Clip, View


class Sequence:
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
