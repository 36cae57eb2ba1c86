"""Doubts about a clip from the outcome of its push, for the photo's suitability."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.scale import PLAYBACK
from physgen.materials import is_living, kind
from physgen.messages import Message, Note
from physgen.perceive.roles import PerceivedScene, Suitability
from physgen.perceive.support.viewpoint import fine_detail
from physgen.pipeline.push_outcomes import Grade, Outcome
from physgen.pipeline.refusals import WATERCRAFT
from physgen.problems import Problem
from physgen.text import listed, percent


@dataclass(frozen=True)
class OutcomeLimits:
    """Limits of a doubtful outcome of a push; areas are shares of the photo."""

    brief: float = 0.5
    """Smallest duration of visible motion in the video, s; below it is a jerk."""
    filled_area: float = 0.25
    """Area of filled background behind moving objects, on any ground."""
    busy_filled: float = 0.06
    """The same area beside fine detail, which a fill does not continue."""
    busy: float = 0.5
    """Share of fine detail around moving objects."""
    ring: float = 0.04
    """Width of the surroundings, as a share of the photo's longer side."""


OUTCOME = OutcomeLimits()
STILL = Note.NOTHING_MOVES.text()
TOY_WORDS = frozenset(["toy", "toys", "model", "matchbox", "figure"])
"""Words of a label that mark a toy."""


def with_doubts(
    perceived_scene: PerceivedScene, reasons: Sequence[str]
) -> PerceivedScene:
    """Add reasons to doubt the suitability of a scene's photo."""
    earlier_reasons: tuple[str, ...] = ()
    if perceived_scene.suitability is not None:
        earlier_reasons = perceived_scene.suitability.reasons
    all_reasons = tuple(dict.fromkeys((*earlier_reasons, *reasons)))
    return replace(perceived_scene, suitability=Suitability(all_reasons))


def outcome_doubts(
    perceived_scene: PerceivedScene, pushed_names: Sequence[str], outcome: Outcome
) -> list[str]:
    """Return the doubts about a clip in which the objects `pushed_names` start a
    motion.
    """
    names = listed(list(pushed_names), "and")
    doubts = []
    if outcome.grade is Grade.NOTHING:
        doubts.append(Note.PUSH_MOVES_NOTHING.text(names=names))
    if outcome.grade is Grade.LEAVES and not outcome.left:
        doubts.append(Note.REBOUNDS.text(names=names))
    elif outcome.grade is Grade.LEAVES:
        leaving_names = listed(list(outcome.left), "and")
        doubts.append(Note.LEAVES_PICTURE.text(names=leaving_names))
    if outcome.grade is Grade.RESTLESS:
        doubts.append(Note.RESTLESS.text())
    # Viewers see the slow motion: judge the duration of the clip, not of the motion.
    slow_motion = round(perceived_scene.document.get("render", {}).get("slow", 1))
    seconds = outcome.seconds * slow_motion
    if outcome.grade is Grade.SHORT and seconds < OUTCOME.brief:
        doubts.append(Note.MOTION_BRIEF.text(seconds=seconds))
    doubts += _fill_doubts(perceived_scene, outcome)
    owners = _moving_owners(perceived_scene, outcome)
    if owners:
        doubts.append(Note.PART_MAY_STAY.text(names=listed(owners, "and")))
    return doubts


def _moving_owners(perceived_scene: PerceivedScene, outcome: Outcome) -> list[str]:
    """Return the moving objects with a warning of a part beside them."""
    owners = []
    for name in dict.fromkeys(map(_part_owner, perceived_scene.warnings)):
        if name in outcome.mover_names:
            owners.append(name)
    return owners


def without_parts_at_rest(
    photo_scene: PerceivedScene, outcome: Outcome
) -> PerceivedScene:
    """Return the scene without warnings of parts beside objects that do not move."""
    kept = []
    for problem in photo_scene.warnings:
        owner = _part_owner(problem)
        if not owner or owner in outcome.mover_names:
            kept.append(problem)
    return replace(photo_scene, warnings=tuple(kept))


def part_owners(photo_scene: PerceivedScene) -> set[str]:
    """Return the names of objects with parts that may stay behind."""
    owners = {_part_owner(problem) for problem in photo_scene.warnings}
    return owners - {""}


def _part_owner(problem: Problem) -> str:
    """Return the object whose part may stay behind by a warning; empty for others."""
    if problem.code != Message.REMAINS_BEHIND.code:
        return ""
    return problem.path.split(".")[1]


def _fill_doubts(perceived_scene: PerceivedScene, outcome: Outcome) -> list[str]:
    """Return the doubt about the filled background behind moving objects."""
    mask = np.zeros(perceived_scene.percepts.labels.shape, bool)
    area = 0.0
    for name in outcome.mover_names:
        object_mask = _object_mask(perceived_scene, name)
        columns = max(np.count_nonzero(object_mask.any(axis=0)), 1)
        # An object that moves by less than its own width uncovers only a part of its
        # background.
        uncovered_share = outcome.travel * max(object_mask.shape) / columns
        area += min(uncovered_share, 1.0) * float(object_mask.mean())
        mask |= object_mask
    if area:
        detail_share = _detail_around(perceived_scene, mask)
    else:
        detail_share = 0.0
    is_large = area > OUTCOME.filled_area
    has_much_detail = area > OUTCOME.busy_filled and detail_share > OUTCOME.busy
    if not (is_large or has_much_detail):
        return []
    if has_much_detail:
        note = Note.BUSY_FILLED
    else:
        note = Note.MUCH_FILLED
    return [note.text(share=percent(area))]


def _object_mask(perceived_scene: PerceivedScene, name: str) -> NDArray[np.bool_]:
    """Return the mask (H, W) of an object."""
    item = perceived_scene.document["objects"].get(name, {})
    labels = perceived_scene.percepts.labels
    number = item.get("mask")
    if not isinstance(number, int):
        return np.zeros(labels.shape, bool)
    return np.asarray(labels == number)


def _detail_around(perceived_scene: PerceivedScene, mask: NDArray[np.bool_]) -> float:
    """Return the share of fine detail around a mask (H, W)."""
    is_fine = fine_detail(perceived_scene.percepts.rgb)
    small_mask = cv2.resize(
        mask.astype(np.uint8), is_fine.shape[::-1], interpolation=cv2.INTER_AREA
    )
    radius = max(round(OUTCOME.ring * max(is_fine.shape)), 1)
    kernel = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    ring = (cv2.dilate(small_mask, kernel) > 0) & (small_mask == 0)
    if ring.any():
        return float(is_fine[ring].mean())
    return 0.0


def with_living_named(photo_scene: PerceivedScene) -> PerceivedScene:
    """Add the names of people and animals to the scene's suitability."""
    return with_doubts(photo_scene, living_doubts(photo_scene))


def with_toys_named(photo_scene: PerceivedScene) -> PerceivedScene:
    """Add the names of objects taken for toys to the comment on the scale."""
    key = "world.pixels_per_meter"
    comment = photo_scene.comments.get(key, "")
    note = toy_note(photo_scene)
    if not note or not comment or note in comment:
        return photo_scene
    comments = {**photo_scene.comments, key: f"{comment}; {note}"}
    return replace(photo_scene, comments=comments)


def living_doubts(perceived_scene: PerceivedScene) -> list[str]:
    """Return a reason with the names of people and animals; none is ever pushed."""
    objects = perceived_scene.document["objects"].items()
    labels = {name: item.get("label", "") for name, item in objects}
    living_labels = {}
    for name, label in labels.items():
        if is_living(label):
            living_labels[name] = label
    if not living_labels:
        return []
    kinds = {kind(label).noun for label in living_labels.values()}
    if len(kinds) > 1:
        kind_words = "people and animals"
    else:
        kind_words = f"a {min(kinds)}"
    if kinds == {"animal"}:
        kind_words = "an animal"
    names = listed(list(living_labels), "and")
    # A detected animal may be a toy, to be released by the user.
    for label in living_labels.values():
        if kind(label).noun == "animal":
            noun = label.split()[-1]
            note = Note.LIVING_OR_TOY
            return [note.text(names=names, kinds=kind_words, noun=noun)]
    return [Note.LIVING.text(names=names, kinds=kind_words)]


def stillness_doubts(photo_scene: PerceivedScene, names: Collection[str]) -> list[str]:
    """Return the reason why no push moves any of the objects of these names."""
    border_names = []
    for name in photo_scene.document["objects"]:
        if "cut off" in photo_scene.comments.get(f"objects.{name}.motion", ""):
            border_names.append(name)
    # Objects at the border of the photo are not pushed, since their shapes are unknown.
    if names and set(names) <= set(border_names):
        if len(names) == 1:
            verb = "is"
        else:
            verb = "are"
        cut_names = listed(sorted(names), "and")
        return [Note.CUT_BY_BORDER.text(names=cut_names, verb=verb)]
    if names:
        return [STILL]
    return []


def toy_note(photo_scene: PerceivedScene) -> str:
    """Return a note on objects taken for toys without a word for it in their labels.

    A photo does not tell a lone car from its model. Empty without such objects.
    """
    names = []
    for name, item in photo_scene.document["objects"].items():
        label = item.get("label", "")
        noun = kind(label).noun
        # The material table knows vehicles as toys only: a label such as "car" becomes
        # a toy, while "toy car" says so itself.
        is_toy = noun.startswith("toy ") and noun not in WATERCRAFT
        if is_toy and not TOY_WORDS.intersection(label.lower().split()):
            names.append(name)
    if not names:
        return ""
    if len(names) == 1:
        verb = "is taken for a toy"
    else:
        verb = "are taken for toys"
    return Note.TAKEN_FOR_TOY.text(names=listed(names, "and"), verb=verb)


def brief_summary(outcome: Outcome, slow: int) -> str:
    """Describe the distance and the duration of a motion in words."""
    seconds = max(outcome.seconds * slow, 0.0)
    clip = max(seconds + PLAYBACK.pause, PLAYBACK.shortest)
    return (
        f"{percent(outcome.travel)} of the photo's longer side in {seconds:.1f} s "
        f"of a clip of {clip:.1f} s"
    )
