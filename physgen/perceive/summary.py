"""The summary of a perceived scene in a few lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from physgen.messages import Note
from physgen.perceive.document import label_counts
from physgen.perceive.roles import (
    PerceivedScene,
)
from physgen.perceive.support.viewpoint import DOUBTS
from physgen.scene.provenance import provenance as provenance
from physgen.scene.scene import ADD_OBJECT
from physgen.text import counted, listed


def summary(scene: PerceivedScene) -> list[str]:
    """Return the results, their confidence and possible corrections as lines.

    The first line is short; one line per subject follows.
    """
    objects = scene.document["objects"]
    confidences = {name: mask_confidence(item) for name, item in objects.items()}
    doubtful_names = []
    for name, value in confidences.items():
        if value < DOUBTS.object_confidence:
            doubtful_names.append(f"{name} ({value:.2f})")
    table = {"objects": Note.NO_OBJECTS.text(fix=ADD_OBJECT)}
    if objects:
        table = _object_rows(scene)
    doubts = _doubtful_row(scene, doubtful_names)
    if doubts:
        table["doubtful"] = doubts
    return [
        _first_line(scene, confidences, doubtful_names),
        *(f"  {name:<9} {' '.join(text.split())}" for name, text in table.items()),
    ]


def _first_line(
    scene: PerceivedScene,
    confidences: Mapping[str, float],
    doubtful_names: Sequence[str],
) -> str:
    """Return the number of objects, their confidence and the suitability."""
    line = counted(len(confidences), "object")
    if confidences:
        ends = sorted({min(confidences.values()), max(confidences.values())})
        line += f", confidence {' to '.join(f'{end:.2f}' for end in ends)}"
    line += f"; suitability: {scene.suitability}"
    if doubtful_names and str(scene.suitability) == "good":
        names = [name.split()[0] for name in doubtful_names]
        line += f", but look at {listed(names, 'and')}"
    return line


def _object_rows(scene: PerceivedScene) -> dict[str, str]:
    """Return the rows about the objects, scale, view, supports and motion."""
    document = scene.document
    comments = scene.comments
    world = document["world"]
    labels = {k: item["label"] for k, item in enumerate(document["objects"].values())}
    view_reason = comments.get("world.view", "").partition(": ")[2]
    return {
        "objects": label_counts(labels),
        "scale": Note.SCALE.text(
            scale=world["pixels_per_meter"],
            reason=comments.get("world.pixels_per_meter", ""),
        ),
        "view": f"{world['view']}: {view_reason}",
        "support": _support_row(document),
        "motion": _motion_row(scene),
    }


def _support_row(document: Mapping[str, Any]) -> str:
    """Return the names of the boundaries and of the static objects."""
    walls = []
    for name in document["boundaries"]:
        if name != "bottom":
            walls.append(name)
    row = ", ".join(walls) or Note.NO_BOUNDARY.text()
    static = []
    for name, item in document["objects"].items():
        if item.get("motion") == "static":
            static.append(name)
    if not static:
        return row
    return Note.STATIC.text(boundaries=row, names=", ".join(static))


def _motion_row(scene: PerceivedScene) -> str:
    """Return the row with the pushes."""
    pushes = []
    for name, item in scene.document["objects"].items():
        if any(item.get("velocity", ())):
            comment = scene.comments.get(f"objects.{name}.velocity", ", as before")
            direction = comment.split(", ")[1].partition(";")[0]
            pushes.append(Note.PUSHED.text(name=name, way=direction))
    return "; ".join(pushes) or Note.NOTHING_PUSHED.text()


def _doubtful_row(scene: PerceivedScene, doubtful_names: Sequence[str]) -> str:
    """Return the row with `doubtful_names` objects and doubtful regions."""
    document = scene.document
    comments = scene.comments
    doubts: list[str] = []
    if doubtful_names:
        doubts.append(Note.UNSURE.text(names=", ".join(doubtful_names)))
    # Regions drawn by the user have no confidence and are not doubtful.
    regions = [
        name
        for name, entry in document.get("doubtful", {}).items()
        if "confidence" in entry
    ]
    if regions:
        name = regions[0]
        doubt = Note.ONE_REGION.text(name=name)
        if len(regions) > 1:
            doubt = Note.SEVERAL_REGIONS.text(count=len(regions), name=name)
        doubts.append(doubt)
    reasons: dict[str, list[str]] = {}
    for name in regions:
        if reason := comments.get(f"doubtful.{name}"):
            reasons.setdefault(reason, []).append(name)
    for reason, names_of_reason in reasons.items():
        doubts.append(f"{listed(names_of_reason, 'and')}: {reason}")
    if not doubts:
        return ""
    return "; ".join([*doubts, "--box and --point add missing objects"])


def mask_confidence(item: Mapping[str, Any]) -> float:
    """Return the confidence of an object's mask, from its `from`."""
    return float(item["from"]["mask"].rpartition(" ")[2])
