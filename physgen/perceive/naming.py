"""Names and labels of the objects in a photo."""

from __future__ import annotations

import difflib
import fnmatch
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from physgen.geometry.polygon import mass_properties
from physgen.materials import kind, nouns
from physgen.messages import Message, did_you_mean
from physgen.perceive.roles import (
    Detections,
    Name,
    PhotoObject,
)
from physgen.problems import InputError, Place, Problem
from physgen.scene.provenance import provenance as provenance

GENERIC = ("object", "thing")
"""Labels without information."""


@dataclass(frozen=True)
class Names:
    """Labels and names of the objects, by id."""

    # The objects with their labels.
    objects: Sequence[PhotoObject]
    labels: Mapping[int, Name]
    # Sources of the labels, for `from`; `""` for labels of the user.
    sources: Mapping[int, str]
    confidence: Mapping[int, float]
    # Names without the user's new labels.
    before: Mapping[int, str]
    # Ids of objects with a new label of the user.
    renamed_ids: set[int]


def slug(label: str) -> str:
    """Return a label as the start of a name.

    The result has letters, digits and -, begins with a letter and is at most 48
    characters long.
    """
    text = re.sub(r"[^a-z0-9]+", "-", label.lower()).strip("-")[:48].strip("-")
    if not text:
        return "object"
    if text[0].isalpha():
        return text
    return f"object-{text}"


def object_names(
    objects: Sequence[PhotoObject], earlier_names: Mapping[int, str] | None = None
) -> dict[int, str]:
    """Return a name for every object by id, numbered per label from left to right.

    Names in `earlier_names` stay.
    """
    earlier_names = earlier_names or {}
    used_names = set(earlier_names.values())
    objects_by_position = sorted(
        objects,
        key=lambda t: (round(float(mass_properties(t.outline).center[0]), 1), t.id),
    )
    counts: dict[str, int] = {}
    result = {}
    for item in objects_by_position:
        if item.id in earlier_names:
            result[item.id] = earlier_names[item.id]
            continue
        start = slug(item.label)
        counts[start] = counts.get(start, 0) + 1
        while f"{start}-{counts[start]}" in used_names:
            counts[start] += 1
        result[item.id] = f"{start}-{counts[start]}"
    return result


def relabel_objects(
    objects: Sequence[PhotoObject],
    renames: Sequence[str],
    names_by_id: Mapping[int, str],
) -> tuple[list[PhotoObject], set[int]]:
    """Return the objects with their new labels, and the ids of objects with a new
    label.

    `names_by_id` gives the objects' names by id. Raises InputError with every invalid NAME
    of `renames`, each NAME=TEXT.
    """
    labels, problems = renamed_labels(renames, names_by_id)
    if problems:
        raise InputError(problems)
    return [
        replace(t, label=labels[t.id]) if t.id in labels else t for t in objects
    ], set(labels)


def renamed_labels(
    renames: Sequence[str], names_by_id: Mapping[int, str]
) -> tuple[dict[int, str], list[Problem]]:
    """Return the new labels by object id, and problems with unknown names.

    An exact name takes precedence over a pattern.
    """
    pattern_labels: dict[int, str] = {}
    exact_labels: dict[int, str] = {}
    problems = []
    for rename in renames:
        name, sign, text = (part.strip() for part in rename.partition("="))
        exact_ids = []
        for i, n in names_by_id.items():
            if name in (n, str(i)):
                exact_ids.append(i)
        ids = exact_ids or [
            i for i, n in names_by_id.items() if fnmatch.fnmatchcase(n, name)
        ]
        has_text = bool(sign and text)
        if not (has_text and ids):
            problems.append(_rename_problem(rename, name, has_text, names_by_id))
        if exact_ids:
            labels = exact_labels
        else:
            labels = pattern_labels
        labels.update(dict.fromkeys(ids, text))
    return pattern_labels | exact_labels, problems


def _rename_problem(
    rename: str, name: str, has_text: bool, names_by_id: Mapping[int, str]
) -> Problem:
    """Return the problem of NAME=TEXT without an object or without a text."""
    matches = difflib.get_close_matches(name, names_by_id.values(), 1)
    known_names = ", ".join(list(names_by_id.values())[:8])
    if len(names_by_id) > 8:
        known_names += ", ..."
    fix = f"the objects are {known_names}"
    if matches and matches[0] != name:
        fix = did_you_mean(matches[0])
    message = Message.LABEL_WITHOUT_NAME
    if has_text:
        message = Message.LABEL_OF_NO_OBJECT
    return message.problem(Place("--label"), "", f'"{rename}"', fix=fix)


def label_confidences(
    detections: Detections,
    names: Mapping[int, Name],
    guesses: Mapping[int, Name],
    renamed_ids: set[int],
) -> dict[int, float]:
    """Return the confidence of each label: 1 if the user gave or changed it."""
    if detections.object_names or detections.name_source == "given":
        user_names = detections.names
    else:
        user_names = {}
    user_ids = {
        i
        for i in user_names
        if i not in guesses or detections.names[i].label != guesses[i].label
    } | renamed_ids
    return {i: 1.0 if i in user_ids else name.confidence for i, name in names.items()}


def unknown_label(label: str) -> Problem | None:
    """Return a warning about a label without an entry in the material table, or
    None.
    """
    label_kind = kind(label)
    if label_kind.noun or label_kind.material.name != "unknown" or label in GENERIC:
        return None
    known_nouns = sorted({word for _, words in nouns() for word in words})
    matches = (
        difflib.get_close_matches(text, known_nouns, 1)
        for text in (label.lower(), label.lower().split()[-1])
    )
    close = next((match for match in matches if match), None)
    fix = "name a material, too, as in: wooden spoon"
    if close:
        fix = did_you_mean(close[0])
    return Message.UNKNOWN_LABEL.warning(Place("--label"), "", f'"{label}"', fix=fix)
