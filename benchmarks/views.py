"""The view that perception finds, against labels of photos by hand; see studio/view_labels.py."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from layout import prose, table

from physgen.perceive.photo_size import shrink_photo

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "studio"))

from view_labels import LabelledPhoto, labelled_photos, material_folder  # noqa: E402

PLAIN = ("trashnet-grabcut", "class5", "fruits-nuts")
"""Sets of things on a plain ground, all seen from above."""
BINS = (0.5, 0.6, 0.75, 0.9, 1.0)
"""Borders of the stated confidences that are compared with the share that is right."""


def views(folder: Path) -> list[dict]:
    """Measure every photo of the half that nothing was learned from."""
    material = material_folder()
    if material is None:
        sys.exit("PHYSGEN_MATERIAL: name the folder of the labelled photos")
    rows = []
    for photo in labelled_photos():
        if not photo.is_for_training:
            rows.append(measure(photo, photo.file(material)))
            print(photo.name, file=sys.stderr, flush=True)
    return rows


def measure(photo: LabelledPhoto, file: Path) -> dict:
    """Return the view with objects found, by looks and cues, by each alone."""
    from physgen.perceive.backends.boundary_support import feet_groups, view_evidence
    from physgen.perceive.photo_objects import fit_objects
    from physgen.perceive.roles import Detections
    from physgen.perceive.segment.network import run_network
    from physgen.perceive.segment.prompts import Segmenter
    from physgen.perceive.support.view_classifier import view_chances
    from physgen.perceive.support.viewpoint import guess_view
    from physgen.photos import read_photo
    from physgen.registry import Backends

    rgb = shrink_photo(read_photo(file).rgb, 1600)
    maps = run_network(rgb)
    chances = view_chances(maps.features)
    row = {
        "photo": photo.name,
        "true": photo.view,
        "can_animate": photo.can_animate,
        "top": round(chances.top, 4),
        "oblique": round(chances.oblique, 4),
        "unsuitable": round(chances.unsuitable, 4),
        "tilt": chances.tilt,
    }
    if not photo.can_animate:
        return row
    crew = Backends()
    crew.begin()
    segments = Segmenter(crew, ())(rgb)
    found = Detections(segments.labels, "learned", {}, segments.names)
    objects, _ = fit_objects(rgb, found)
    evidence = view_evidence(objects, feet_groups(found.labels, objects))
    arguments = rgb, found.labels, maps.normals, *evidence
    view, sure, _ = guess_view(*arguments, chances)
    cues, cues_sure, _ = guess_view(*arguments)
    return row | {
        "view": view.value,
        "sure": sure,
        "cues": cues.value,
        "cues_sure": cues_sure,
    }


def is_right(row: dict, view: str) -> bool:
    """Return whether a view is that of the label: an oblique photo is one from the side."""
    return (view == "top") == (row["true"] == "top")


def _groups(rows: Sequence[dict]) -> Iterator[tuple[str, list[dict]]]:
    names = list(dict.fromkeys(row["photo"].partition("/")[0] for row in rows))
    for name in names:
        yield name, [row for row in rows if row["photo"].startswith(f"{name}/")]
    varied = [row for row in rows if row["photo"].partition("/")[0] not in PLAIN]
    yield "all but objects on plain grounds", varied
    yield "all", list(rows)


def tables(rows: list[dict]) -> list[str]:
    """Return the lines of the section."""
    animated = [row for row in rows if row["can_animate"]]
    body = []
    for name, group in _groups(animated):
        if not group:
            continue
        top = sum(row["true"] == "top" for row in group)
        oblique = sum(row["true"] == "oblique" for row in group)
        looks = np.mean([is_right(row, _looks(row)) for row in group])
        measured = [row for row in group if "view" in row]
        shares = [f"{looks:.3f}", len(measured)]
        for key in ("cues", "view"):
            right = [is_right(row, row[key]) for row in measured]
            shares.append(f"{np.mean(right):.3f}" if right else "-")
        body.append([name, len(group), top, oblique, *shares])
    reliability = []
    for low, high in pairwise(BINS):
        inside = [row for row in animated if low <= row.get("sure", 0) < high]
        if inside:
            right = np.mean([is_right(row, row["view"]) for row in inside])
            stated = np.mean([row["sure"] for row in inside])
            label = f"{low:.2f} to {high:.2f}"
            reliability.append([label, len(inside), f"{stated:.2f}", f"{right:.2f}"])
    side = [row for row in animated if row["true"] != "top"]
    angle = np.mean(
        [(row["tilt"] is not None) == (row["true"] == "oblique") for row in side]
    )
    loose = np.array([row["unsuitable"] for row in rows if row["can_animate"]])
    others = np.array([row["unsuitable"] for row in rows if not row["can_animate"]])
    told = float((loose[:, None] < others).mean())
    return [
        *prose(
            "Share of photos whose view is right. The photos were labelled by hand; half of them, with the bundled",
            "photos, taught the looks, and these are the others. Oblique photos, in which the camera looks down by",
            "30 to 60 degrees, are photos from the side. Cues: the background and the objects alone, as before the",
            "looks were learned. Both need the objects, and not all photos were searched for objects.",
        ),
        "",
        *table(
            [
                "set",
                "photos",
                "from above",
                "oblique",
                "looks",
                "with objects found",
                "cues",
                "both",
            ],
            body,
        ),
        "",
        *table(["confidence", "photos", "stated", "right"], reliability),
        "",
        *prose(
            f"Of {len(side)} photos from the side, oblique or not is right for {angle:.0%}.",
            "A photo that cannot be animated",
            f"scores higher as such than one that can in {told:.1%} of pairs.",
        ),
    ]


def _looks(row: dict) -> str:
    return "top" if row["top"] > 0.5 else "side"
