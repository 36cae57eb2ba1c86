"""What `segmentation` found -> a folder to look at: every photo marked, the curves, and the result as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from physgen.evaluate.charts import diagram, precision_recall
from physgen.evaluate.marked import marked
from physgen.evaluate.photos import Pair
from physgen.evaluate.segmentation import Found, Photo
from physgen.percepts.maps import write_png
from physgen.problems import InputError
from physgen.whole import write_whole

NAMES = {"all": "all objects", "whole": "whole objects only"}


FILES = ("precision-recall.svg", "reliability.svg", "segmentation.json")


class Shown:
    """Writes into one folder, made at once; files of an earlier run are replaced."""

    def __init__(self, folder: Path, pairs: Sequence[Pair] = ()) -> None:
        """Raises InputError where one of the `pairs` that are measured would be written over."""
        if folder.exists() and not folder.is_dir():
            raise InputError.of("-o", f'"{folder}"', "is a file", "name a folder with -o")
        self._photos, self._folder = folder / "photos", folder
        ours = {(self._photos / f"{pair.name}.png").resolve() for pair in pairs}
        ours |= {(folder / name).resolve() for name in FILES}
        for path in (path for pair in pairs for path in (pair.photo, pair.truth)):
            if path.resolve() in ours:
                expected = "would be written over by the marked photos"
                raise InputError.of("-o", f'"{path}"', expected, "name another folder with -o")
        if self._photos.exists() and any(self._photos.iterdir()) and not (folder / FILES[-1]).exists():
            expected = "holds files that are not of an earlier run"
            raise InputError.of("-o", f'"{self._photos}"', expected, "name another folder with -o")
        self._photos.mkdir(parents=True, exist_ok=True)

    def photo(self, photo: Photo) -> None:
        """`photos/NAME.png`: outlines of what is found, missed and falsely said, with confidences."""
        path = self._photos / f"{photo.name}.png"
        path.unlink(missing_ok=True)
        write_png(path, marked(photo))

    def totals(self, found: Found, record: Mapping[str, Any]) -> None:
        """`precision-recall.svg`, `reliability.svg` and `segmentation.json`."""
        lines = {NAMES[scope]: (line, found.totals[scope]["ap50"]) for scope, line in found.curves.items()}
        texts = {
            "precision-recall.svg": precision_recall(lines),
            "reliability.svg": diagram(found.reliability),
            "segmentation.json": json.dumps(record, indent=1, ensure_ascii=False) + "\n",
        }
        for name, text in texts.items():
            write_whole(self._folder / name, text.encode("utf-8"))
