"""MOT Challenge text: boxes and tracks of objects (Milan et al., 2016)."""

from __future__ import annotations

from pathlib import Path

from physgen.export.labels import Clip, Moment, Writer

FIRST = 1
"""Number of the first column and row in the MOT Challenge."""


class Mot(Writer):
    """Writes `frame, id, left, top, width, height, 1, class, visibility`, all counted
    from 1.

    The box contains hidden parts and ends at the picture's borders. Visibility is the
    visible share of the part in the picture. `gt/labels.txt` has the classes' names,
    one per line; line breaks in labels become spaces.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        super().__init__(folder, clip)
        home = folder / clip.name
        self._images = home / "img1"
        self._truth = home / "gt" / "gt.txt"
        self._images.mkdir(parents=True)
        self._truth.parent.mkdir()
        width, height = clip.size
        lines = [
            "[Sequence]",
            f"name={clip.name}",
            "imDir=img1",
            f"frameRate={clip.fps:g}",
            f"seqLength={clip.count}",
            f"imWidth={width}",
            f"imHeight={height}",
            "imExt=.jpg",
        ]
        (home / "seqinfo.ini").write_text("\n".join(lines) + "\n", encoding="utf-8")
        # A line break in a label would shift all later classes.
        names = [" ".join(label.split()) + "\n" for label in clip.categories]
        labels = self._truth.with_name("labels.txt")
        labels.write_text("".join(names), encoding="utf-8")
        self._truth.write_text("", encoding="utf-8")

    def add(self, moment: Moment) -> None:
        """Write a line for each object with pixels in the picture."""
        view = moment.view
        (self._images / f"{view.index + 1:06d}.jpg").write_bytes(view.jpeg)
        with self._truth.open("a", encoding="utf-8") as file:
            for presence in view.presences:
                x, y, width, height = presence.box
                box = (x + FIRST, y + FIRST, width, height)
                numbers = (view.index + 1, presence.body + 1, *box, 1)
                category = self._clip.classes[presence.body]
                columns = ",".join(map(str, (*numbers, category)))
                file.write(f"{columns},{presence.visible_share:.6g}\n")
