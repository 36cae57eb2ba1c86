"""What `segmentation` found -> a folder to look at: every photo marked, the curves, and figures for its page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from physgen.evaluate.charts import diagram, precision_recall
from physgen.evaluate.findings import Figure, Findings, Section
from physgen.evaluate.marked import marked
from physgen.evaluate.page import PAGE, RESULT, check_folder
from physgen.evaluate.photos import Pair
from physgen.evaluate.segmentation import DRAWN, Found, Photo
from physgen.evaluate.segmentation_told import CURVES, NAMES
from physgen.files import write_atomic
from physgen.maps import write_png
from physgen.problems import InputError

PLOTS = {
    "precision-recall.svg": "Precision over recall at an IoU of 0.5: as it is (thin), and as AP reads it (bold).",
    "precision-recall-by-iou.svg": "The same of all objects at three IoUs: how well outlines must fit.",
    "reliability.svg": "Share that is right over said confidence; on the diagonal, confidences can be believed.",
}
FILES = (*PLOTS, PAGE, RESULT)
MOST = 24
"""Photos on the page; the folder has all."""
QUALITY = 88


class Shown:
    """Writes into one folder, made at once; files of an earlier run are replaced."""

    def __init__(self, folder: Path, pairs: Sequence[Pair] = ()) -> None:
        """Raises InputError where one of the `pairs` that are measured would be written over."""
        check_folder(folder)
        self._photos, self._folder, self._pictures = folder / "photos", folder, list[Figure]()
        ours = {(self._photos / f"{pair.name}.png").resolve() for pair in pairs}
        ours |= {(folder / name).resolve() for name in FILES}
        for path in (path for pair in pairs for path in (pair.photo, pair.truth)):
            if path.resolve() in ours:
                expected = "would be written over by the marked photos"
                raise InputError.of("-o", f'"{path}"', expected, "name another folder with -o")
        if self._photos.exists() and any(self._photos.iterdir()) and not (folder / RESULT).exists():
            expected = "holds files that are not of an earlier run"
            raise InputError.of("-o", f'"{self._photos}"', expected, "name another folder with -o")
        self._photos.mkdir(parents=True, exist_ok=True)

    def photo(self, photo: Photo) -> None:
        """`photos/NAME.png`: outlines of what is found, missed and falsely said, with confidences."""
        path = self._photos / f"{photo.name}.png"
        path.unlink(missing_ok=True)
        picture = marked(photo)
        write_png(path, picture)
        if len(self._pictures) < MOST:
            _, data = cv2.imencode(
                ".jpg", np.ascontiguousarray(picture[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
            )
            row = photo.as_dict()
            about = (
                f"{photo.name}: {row['hit']} of {row['true']} found, {row['said'] - row['hit']} falsely said."
            )
            self._pictures.append(Figure(bytes(data), about))

    def plots(self, found: Found) -> None:
        """The three files of `PLOTS`."""
        lines = {NAMES[scope]: (line, found.totals[scope]["ap50"]) for scope, line in found.curves.items()}
        known = {one["iou"]: one["ap"] for one in found.totals["all"]["ap_by_iou"]}
        strict = {f"IoU {iou:.2f}": (found.strict[iou], known[iou]) for iou in DRAWN}
        drawn = (precision_recall(lines), precision_recall(strict), diagram(found.reliability))
        for name, text in zip(PLOTS, drawn, strict=True):
            write_atomic(self._folder / name, text.encode("utf-8"))

    def illustrated(self, told: Findings) -> Findings:
        """With plots and marked photos."""
        plots = [
            Figure((self._folder / name).read_text(encoding="utf-8"), about) for name, about in PLOTS.items()
        ]
        sections = (
            replace(section, parts=(*section.parts, *plots)) if section.title == CURVES else section
            for section in told.sections
        )
        return replace(told, sections=(*sections, Section("The photos", (), tuple(self._pictures))))
