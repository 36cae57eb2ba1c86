"""Pixels that change hands, and the ground that follows -> the operations on the scene's text, all at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physgen.compile.standing import standing
from physgen.edit import following
from physgen.edit.following import Data
from physgen.edit.ground import Ground, off
from physgen.edit.masking import Work, count, written
from physgen.edit.nearby import fitted
from physgen.edit.ops import edited
from physgen.edit.reasons import forgotten, said_of_walls
from physgen.outline.outline import Outline
from physgen.perceive import words
from physgen.perceive.roles import Thing
from physgen.scene.model import Motion

U16 = NDArray[np.uint16]

OWN = 0.75
"""px between a written shape and a perceived outline that are one: what is written is rounded."""


@dataclass(frozen=True)
class Painted:
    """Who has which pixels from now on."""

    after: U16
    """(H, W): ids as `ids` has them, 0 for nobody."""
    ids: Mapping[str, int]
    stored: Mapping[str, int]
    """By name, ids in masks.png of those whose mask is to be found there from now on."""

    def sides(self, work: Work) -> list[str]:
        """Names of the corrected things."""
        return [*work.masks, *work.fresh]


def things(work: Work, painted: Painted, ground: Ground) -> list[Thing]:
    """The corrected ones, on what holds them."""
    names = painted.sides(work)
    ids = [painted.ids[name] for name in names]
    fits = fitted(painted.after, ids)
    kept = tuple(wall for wall in work.scene.boundaries if wall.name not in ground.changed)
    outlines = tuple(ground.outlines.get(i, fits[i]) for i in ids)
    stood = standing(replace(work.scene, boundaries=kept), outlines, [True] * len(ids))
    return [
        following.thing(i, outline, _label(work, name), work.scene.size)
        for i, name, outline in zip(ids, names, stood, strict=True)
    ]


def text(work: Work, painted: Painted, ground: Ground, corrected: list[Thing]) -> str:
    """The file's text with all of it. Raises EditError."""
    ops, source = list(work.ops), work.text
    held = {item.name for item in work.scene.objects if held_by_perception(work, item.name)}
    if work.fresh and not work.entries:  # of a thing that is cut each half is held as the whole was
        held |= {name for name in work.fresh if held & set(work.masks)}
    for name, one in zip(painted.sides(work), corrected, strict=True):
        made = _numbers(work, name, one, painted.after)
        _rest(work, name, made, ground, one.id, name in held)
        _found_by(work, name, made)
        made["mask"] = painted.stored[name]
        if name in work.fresh:
            ops.append({"add": ["objects", name], "value": _ordered(made)})
        else:
            ops += written(work, name, made)
    for name in painted.stored.keys() - set(painted.sides(work)):
        ops.append({"set": ["objects", name, "mask"], "value": painted.stored[name]})
    for item in work.scene.objects:
        if item.name not in work.masks and item.name != work.gone:
            ops += _neighbour(work, item.name, painted.ids[item.name], ground, item.name in held)
    for op in ops:
        if op.get("unset", [])[-1:] == ["motion"]:
            source = forgotten(source, [op["unset"]])
    new = edited(source, [*ops, *ground.ops], None, work.live.path, work.live.allow_outside).text
    return said_of_walls(new, ground.remarks)


def held_by_perception(work: Work, name: str) -> bool:
    """Whether a thing is static since perception saw nothing under it, and nobody said so since."""
    if work.known.document["objects"].get(name, {}).get("motion") != Motion.STATIC.value:
        return False
    return work.text != forgotten(work.text, [["objects", name, "motion"]])


def _rest(work: Work, name: str, made: Data, ground: Ground, id_: int, held: bool) -> None:
    """What nothing keeps from falling is held, and no longer where something does; a slope's friction is enough."""
    if id_ in ground.held:
        made.setdefault("motion", Motion.STATIC.value)
    elif held and ground.freed:
        made.pop("motion", None)
    grip = ground.grip.get(id_, 0.0)
    if made.get("friction", grip) < grip and (name in work.fresh or "friction" in made.get("from", {})):
        made["friction"] = grip
        made["from"] = {**made.get("from", {}), "friction": words.source("lies on a slope", 0.5)}


def _neighbour(work: Work, name: str, id_: int, ground: Ground, held: bool) -> list[Data]:
    """What follows for a thing that was not corrected."""
    if name not in work.known.document["objects"]:
        return []
    was = work.known.was(name)
    ops: list[Data] = []
    if id_ in ground.freed and held:
        ops.append({"unset": ["objects", name, "motion"]})
    elif id_ in ground.held and "motion" not in was:
        ops.append({"set": ["objects", name, "motion"], "value": Motion.STATIC.value})
    before, now = ground.moved.get(id_, (None, None))
    if before is not None and now is not None and _is_its_own(work, id_, was, before):
        ops.append({"set": ["objects", name, "shape"], "value": words.shape(now)})
    return ops


def _is_its_own(work: Work, id_: int, was: Data, before: Outline) -> bool:
    """Whether a written shape is what perception wrote, and where the photo shows the thing."""
    return (
        was.get("shape", "auto") != "auto"
        and "place" not in was
        and not isinstance(was.get("motion"), Mapping)
        and off(work.known.outlines[id_ - 1], before) <= OWN
    )


def _label(work: Work, name: str) -> str:
    """What an object, or the one that a new one was cut from, is called."""
    if name in work.entries:
        return str(work.entries[name]["label"])
    source = name if name in work.masks else next(iter(work.masks))
    return work.scene.objects[work.index(source)].label


def _numbers(work: Work, name: str, one: Thing, after: U16) -> Data:
    """The entry of an object with the numbers that follow."""
    known = work.known
    if name in work.entries:
        return dict(work.entries[name])
    if work.gone is not None:
        return following.joined(known, name, work.gone, one, after)
    if work.fresh and not work.entries:  # halves
        (source,) = work.masks
        whole = count(work.mask(source))
        part = count(after == one.id) / max(whole, 1)
        return following.shared(known, source, name, part, one, after)
    return following.changed(known, name, one, after)


def _found_by(work: Work, name: str, made: Data) -> None:
    """`from` and `prompt` say who found the mask; of one that a person drew nothing is said."""
    said = {key: value for key, value in (made.get("from") or {}).items() if key != "mask"}
    made.pop("prompt", None)
    if name in work.found:
        sure, prompt = work.found[name]
        said = {"mask": words.source("pointed at", sure), **said}
        made["prompt"] = prompt
    if said or made.get("from"):
        made["from"] = said
    if not made.get("from", True):
        del made["from"]


def _ordered(made: Data) -> Data:
    """As perception writes it: what it is, numbers, then who said so."""
    first = [key for key in ("label", "mask", "shape") if key in made]
    last = [key for key in ("from", "prompt") if key in made]
    middle = [key for key in made if key not in (*first, *last)]
    return {key: made[key] for key in (*first, *middle, *last)}
