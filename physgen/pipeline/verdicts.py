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
from physgen.pipeline.push_trials import Grade, Outcome
from physgen.pipeline.refusals import WATERCRAFT
from physgen.problems import Problem
from physgen.text import listed, percent


@dataclass(frozen=True)
class OutcomeLimits:
    """Limits from which the outcome of a push is doubtful; areas are shares of the photo."""

    brief: float = 0.5
    """s of video in which something moves: a shorter motion is a jerk."""
    filled: float = 0.25
    """Area that is filled behind what moves, on any ground."""
    busy_filled: float = 0.06
    """The same beside fine detail, which a fill does not continue."""
    busy: float = 0.5
    """Share of fine detail around what moves."""
    ring: float = 0.04
    """Width of the surroundings, as a share of the photo's longer side."""


OUTCOME = OutcomeLimits()
STILL = Note.NOTHING_MOVES.text()
TOY_WORDS = frozenset(["toy", "toys", "model", "matchbox", "figure"])
"""Words of a label that name a toy as such."""


def with_doubts(perceived: PerceivedScene, reasons: Sequence[str]) -> PerceivedScene:
    """Return the scene with further reasons to doubt that its photo suits."""
    known = () if perceived.suitability is None else perceived.suitability.reasons
    every = tuple(dict.fromkeys((*known, *reasons)))
    return replace(perceived, suitability=Suitability(every))


def outcome_doubts(
    perceived: PerceivedScene, pushed: Sequence[str], outcome: Outcome
) -> list[str]:
    """Return the doubts about a clip in which the objects `pushed` set off a motion."""
    names = listed(list(pushed), "and")
    doubts = []
    if outcome.grade is Grade.NOTHING:
        doubts.append(Note.PUSH_MOVES_NOTHING.text(names=names))
    if outcome.grade is Grade.LEAVES and not outcome.left:
        doubts.append(Note.REBOUNDS.text(names=names))
    elif outcome.grade is Grade.LEAVES:
        left = listed(list(outcome.left), "and")
        doubts.append(Note.LEAVES_PICTURE.text(names=left))
    if outcome.grade is Grade.RESTLESS:
        doubts.append(Note.RESTLESS.text())
    slow = round(perceived.document.get("render", {}).get("slow", 1))
    seconds = outcome.seconds * slow
    if outcome.grade is Grade.SHORT and seconds < OUTCOME.brief:
        doubts.append(Note.MOTION_BRIEF.text(seconds=seconds))
    doubts += _fill_doubts(perceived, outcome)
    parts = list(dict.fromkeys(map(_part_owner, perceived.warnings)))
    owners = [name for name in parts if name in outcome.moved]
    if owners:
        doubts.append(Note.PART_MAY_STAY.text(names=listed(owners, "and")))
    return doubts


def without_parts_at_rest(
    photo_scene: PerceivedScene, outcome: Outcome
) -> PerceivedScene:
    """Return the scene without warnings of parts beside objects that do not move."""
    kept = []
    for problem in photo_scene.warnings:
        owner = _part_owner(problem)
        if not owner or owner in outcome.moved:
            kept.append(problem)
    return replace(photo_scene, warnings=tuple(kept))


def _part_owner(problem: Problem) -> str:
    """Return the object whose part may stay behind by a warning; empty for others."""
    if problem.code != Message.REMAINS_BEHIND.code:
        return ""
    return problem.path.split(".")[1]


def _fill_doubts(perceived: PerceivedScene, outcome: Outcome) -> list[str]:
    """Return the doubt about what is filled behind the objects that move."""
    mask = np.zeros(perceived.percepts.labels.shape, bool)
    area = 0.0
    for name in outcome.moved:
        own = _object_mask(perceived, name)
        columns = max(np.count_nonzero(own.any(axis=0)), 1)
        passed = outcome.travel * max(own.shape) / columns
        area += min(passed, 1.0) * float(own.mean())
        mask |= own
    busy = _detail_around(perceived, mask) if area else 0.0
    is_large = area > OUTCOME.filled
    is_busy = area > OUTCOME.busy_filled and busy > OUTCOME.busy
    if not (is_large or is_busy):
        return []
    note = Note.BUSY_FILLED if is_busy else Note.MUCH_FILLED
    return [note.text(share=percent(area))]


def _object_mask(perceived: PerceivedScene, name: str) -> NDArray[np.bool_]:
    """Return the pixels (H, W) of an object."""
    item = perceived.document["objects"].get(name, {})
    labels = perceived.percepts.labels
    number = item.get("mask")
    if not isinstance(number, int):
        return np.zeros(labels.shape, bool)
    return np.asarray(labels == number)


def _detail_around(perceived: PerceivedScene, mask: NDArray[np.bool_]) -> float:
    """Return the share of fine detail around a mask (H, W)."""
    is_fine = fine_detail(perceived.percepts.rgb)
    inside = cv2.resize(
        mask.astype(np.uint8), is_fine.shape[::-1], interpolation=cv2.INTER_AREA
    )
    radius = max(round(OUTCOME.ring * max(is_fine.shape)), 1)
    kernel = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    ring = (cv2.dilate(inside, kernel) > 0) & (inside == 0)
    return float(is_fine[ring].mean()) if ring.any() else 0.0


def with_living_named(photo_scene: PerceivedScene) -> PerceivedScene:
    """Return the scene whose suitability names people and animals."""
    return with_doubts(photo_scene, living_doubts(photo_scene))


def with_toys_named(photo_scene: PerceivedScene) -> PerceivedScene:
    """Return the scene whose comment on the scale names what is taken for a toy."""
    key = "world.pixels_per_meter"
    comment = photo_scene.comments.get(key, "")
    note = toy_note(photo_scene)
    if not note or not comment or note in comment:
        return photo_scene
    comments = {**photo_scene.comments, key: f"{comment}; {note}"}
    return replace(photo_scene, comments=comments)


def living_doubts(perceived: PerceivedScene) -> list[str]:
    """Return a reason that names the people and animals, which are never pushed."""
    objects = perceived.document["objects"].items()
    labels = {name: item.get("label", "") for name, item in objects}
    living = {name: label for name, label in labels.items() if is_living(label)}
    if not living:
        return []
    kinds = {kind(label).noun for label in living.values()}
    what = "people and animals" if len(kinds) > 1 else f"a {min(kinds)}"
    if kinds == {"animal"}:
        what = "an animal"
    names = listed(list(living), "and")
    for label in living.values():
        if kind(label).noun == "animal":
            noun, note = label.split()[-1], Note.LIVING_OR_TOY
            return [note.text(names=names, kinds=what, noun=noun)]
    return [Note.LIVING.text(names=names, kinds=what)]


def stillness_doubts(photo_scene: PerceivedScene, names: Collection[str]) -> list[str]:
    """Return why no push moves any of the objects of these names."""
    cut = [
        name
        for name in photo_scene.document["objects"]
        if "cut off" in photo_scene.comments.get(f"objects.{name}.motion", "")
    ]
    if names and set(names) <= set(cut):
        verb = "is" if len(names) == 1 else "are"
        cut_names = listed(sorted(names), "and")
        return [Note.CUT_BY_BORDER.text(names=cut_names, verb=verb)]
    return [STILL] if names else []


def toy_note(photo_scene: PerceivedScene) -> str:
    """Return which objects are taken for toys though their labels do not say so.

    A photo does not tell a lone car from its model. Empty if there is none.
    """
    names = []
    for name, item in photo_scene.document["objects"].items():
        label = item.get("label", "")
        noun = kind(label).noun
        is_toy = noun.startswith("toy ") and noun not in WATERCRAFT
        if is_toy and not TOY_WORDS.intersection(label.lower().split()):
            names.append(name)
    if not names:
        return ""
    verb = "is taken for a toy" if len(names) == 1 else "are taken for toys"
    return Note.TAKEN_FOR_TOY.text(names=listed(names, "and"), verb=verb)


def brief_summary(outcome: Outcome, slow: int) -> str:
    """Return how far and how long something moves, in words."""
    seconds = max(outcome.seconds * slow, 0.0)
    clip = max(seconds + PLAYBACK.pause, PLAYBACK.shortest)
    return (
        f"{percent(outcome.travel)} of the photo's longer side in {seconds:.1f} s "
        f"of a clip of {clip:.1f} s"
    )
