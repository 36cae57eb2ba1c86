"""A mask that a person corrects -> new text and new maps: everything that follows from it follows, the rest stays."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.standing import standing
from physgen.edit import following
from physgen.edit.following import Data
from physgen.edit.ground import Ground
from physgen.edit.live import Live
from physgen.edit.masking import KINDS, Op, Work, begun, count, write
from physgen.edit.nearby import fitted
from physgen.edit.ops import edited
from physgen.edit.patched import Change, write_patched
from physgen.edit.reasons import forgotten, reasoned
from physgen.edit.refusing import impossible
from physgen.outline.outline import Outline
from physgen.perceive.found import SMALLEST
from physgen.perceive.roles import Thing
from physgen.perceive.words import source
from physgen.percepts.maps import Percepts
from physgen.problems import InputError
from physgen.scene.files import MAPS
from physgen.scene.model import MaskId, Scene

U16 = NDArray[np.uint16]


@dataclass(frozen=True)
class Corrected:
    """A correction that was made."""

    text: str
    what: str
    """As the history calls it."""
    made: str | None = None
    """The object that is new."""


def correct(live: Live, text: str, maps: Path | None, variant: str | None, op: Op, out: Path) -> Corrected:
    """One operation on masks; see docs/editing.md. `out`, which is not there yet, holds all maps afterwards.

    `maps` is the folder that stands in for the scene's assets now, None for its own. What does not change is linked;
    where no map changes there is no `out`. Masks and shapes are those of the file itself, whatever the `variant`.
    Raises EditError where it cannot be done: then nothing is left behind.
    """
    if out.exists():
        raise FileExistsError(out)
    try:
        return _corrected(live, text, maps, op, out)
    except BaseException:
        shutil.rmtree(out, ignore_errors=True)
        raise


def _corrected(live: Live, text: str, maps: Path | None, op: Op, out: Path) -> Corrected:
    kind = op.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise impossible("a correction is none that is known", f"send one of {', '.join(KINDS)}")
    work = begun(live, text, maps)
    what = KINDS[kind](work, op)
    if work.masks or work.fresh:
        _linked(work.scene.assets, out)
        made = _finish(work, out)
    new = edited(work.text, work.ops, None, live.path, live.allow_outside).text
    folder = maps
    if work.masks or work.fresh:
        folder = out
        live.hand_over(replace(work.scene, assets=out.resolve()), made)
    try:
        scene = live.state(new, folder).scene
        told = reasoned(new, scene, str(live.path), work.known.reasons)
        if told != new:
            new, _ = told, live.state(told, folder)
    except InputError as error:
        problem = error.problems[0]
        raise impossible(
            f"then {problem.path or 'the scene'} {problem.found} {problem.expected}", problem.fix
        ) from error
    return Corrected(new, what, next(iter(work.fresh), None))


def _linked(assets: Path | None, out: Path) -> None:
    """The maps under a second name; copies where the disk is another."""
    out.mkdir(parents=True)
    for name in MAPS if assets is not None else ():
        assert assets is not None
        file = assets / f"{name}.png"
        if file.is_file():
            try:
                os.link(os.path.realpath(file), out / file.name)
            except OSError:
                shutil.copyfile(file, out / file.name)


def mask_png(live: Live, text: str, maps: Path | None, name: str, variant: str | None = None) -> bytes:
    """An object's pixels as a grey PNG of the photo's size, 0 or 255. Raises EditError, InputError."""
    sight = live.state(text, maps, variant)
    every = [item.name for item in sight.scene.objects]
    if name not in every:
        raise impossible(f"no object is called {name!r}", "choose an object")
    shown = np.where(sight.compiled.labels == every.index(name) + 1, np.uint8(255), np.uint8(0))
    done, data = cv2.imencode(".png", shown)
    assert done
    return data.tobytes()


# What follows


def _finish(work: Work, into: Path) -> Percepts:
    """Label map, outlines, maps and entries; the maps as they are written."""
    scene, labels = work.scene, work.sight.compiled.labels
    count = len(scene.objects)
    ids = {item.name: k + 1 for k, item in enumerate(scene.objects)}
    ids |= {name: count + 1 + k for k, name in enumerate(work.fresh)}
    after = labels.copy()
    after[np.isin(labels, [ids[name] for name in (*work.masks, work.gone) if name is not None])] = 0
    for name, mask in (*work.masks.items(), *work.fresh.items()):
        after[mask] = ids[name]
    _check_others(work, after)
    stored, change = _stored(work, after, ids)
    walls = work.known.document.get("boundaries") or {}
    laid = work.live.layer.follow(work.maps.rgb, labels, after, scene.world.view, walls)
    outlines = _outlines(scene, after, [ids[name] for name in (*work.masks, *work.fresh)], laid)
    things = []
    for name in (*work.masks, *work.fresh):
        one = following.thing(ids[name], outlines[ids[name]], _label(work, name), scene.size)
        things.append(one)
        made = _numbers(work, name, one, after)
        _held(work, name, made, laid, one.id)
        _found_by(work, name, made)
        made["mask"] = stored[name]
        if name in work.fresh:
            work.ops.append({"add": ["objects", name], "value": _ordered(made)})
        else:
            write(work, name, made)
    for name in stored.keys() - {*work.masks, *work.fresh}:
        work.ops.append({"set": ["objects", name, "mask"], "value": stored[name]})
    work.ops += laid.ops
    _assets(work)
    return write_patched(work.maps, into, change, things, after, scene.world.view)


def _outlines(scene: Scene, after: U16, sides: list[int], laid: Ground) -> dict[int, Outline]:
    """Of these ids, on what holds them."""
    fits = fitted(after, sides)
    if not laid.ops:  # the lines are as they were
        stood = standing(scene, tuple(fits[side] for side in sides), [True] * len(sides))
        fits = dict(zip(sides, stood, strict=True))
    return {side: laid.outlines.get(side, fits[side]) for side in sides}


def _held(work: Work, name: str, made: Data, laid: Ground, id_: int) -> None:
    """What nothing keeps from falling is held, and no longer where something does: until a person says so."""
    if id_ in laid.held:
        made.setdefault("motion", "static")
    elif id_ in laid.freed and made.get("motion") == "static":
        text = forgotten(work.text, [["objects", name, "motion"]])
        if text != work.text:  # perception said so
            work.text = text
            del made["motion"]


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
        return following.shared(known, source, part, one, after)
    return following.changed(known, name, one, after)


def _found_by(work: Work, name: str, made: Data) -> None:
    """`from` and `prompt` say who found the mask; of one that a person drew nothing is said."""
    said = {key: value for key, value in (made.get("from") or {}).items() if key != "mask"}
    made.pop("prompt", None)
    if name in work.found:
        sure, prompt = work.found[name]
        said = {"mask": source("pointed at", sure), **said}
        made["prompt"] = prompt
    if said or made.get("from"):
        made["from"] = said
    if not made.get("from", True):
        del made["from"]


def _check_others(work: Work, after: U16) -> None:
    """Nobody else may be painted over to nothing."""
    for k, item in enumerate(work.scene.objects):
        if item.name in work.masks or item.name == work.gone:
            continue
        before = count(work.sight.compiled.labels == k + 1)
        if before and count(after == k + 1) < min(before, SMALLEST):
            raise impossible(f"nothing would be left of {item.name}", "delete it first, or merge the two")


def _stored(work: Work, after: U16, ids: Mapping[str, int]) -> tuple[dict[str, int], Change]:
    """Ids in masks.png of those whose mask is to be found there from now on, and the map before and after."""
    before = work.maps.labels
    used = {item.mask.id for item in work.scene.objects if isinstance(item.mask, MaskId)}
    used |= {item.mask.id for item in work.scene.boundaries if isinstance(item.mask, MaskId)}
    own = {item.name: item.mask.id for item in work.scene.objects if isinstance(item.mask, MaskId)}
    free = iter(range(max({int(before.max()), *used}) + 1, 65536))
    stored: dict[str, int] = {}
    moved: list[str] = [*work.masks, *work.fresh]
    for item in work.scene.objects:
        if item.name in moved or item.name == work.gone or isinstance(item.mask, MaskId):
            continue
        was, now = (part == ids[item.name] for part in (work.sight.compiled.labels, after))
        if (was != now).any():  # an outline in the file would be drawn over what was painted
            moved.append(item.name)
    new = before.copy()
    for name in (*moved, *([work.gone] if work.gone else [])):
        if name in own:
            new[before == own[name]] = 0
    for name in moved:
        identity = own.get(name)
        if identity is None:
            identity = next(free, None)
            if identity is None:
                raise impossible("the label map has no id left", "merge objects, or delete some")
        new[after == ids[name]] = identity
        stored[name] = identity
    compiled = work.sight.compiled
    gone = [] if work.gone is None else [ids[work.gone]]
    touched = np.isin(compiled.labels, [*(ids[name] for name in work.masks), *gone])
    touched |= np.isin(after, [ids[name] for name in (*work.masks, *work.fresh)])
    scenery = compiled.scenery
    was = (compiled.labels > 0) | ((before > 0) & ~scenery)
    now = (after > 0) | ((new > 0) & ~scenery)
    return stored, Change(before, new, touched, now, was)


def _assets(work: Work) -> None:
    """A scene without a folder of maps of its own gets one."""
    scene, path = work.scene, work.live.path
    place = scene.places.get("assets")
    if scene.assets is not None and place is not None and place.file == str(path):
        return
    name, number = f"{path.stem}.assets", 1
    while (path.parent / name).exists():
        number += 1
        name = f"{path.stem}-{number}.assets"
    work.ops.append({"set": ["assets"], "value": name})


def _ordered(made: Data) -> Data:
    """As perception writes it: what it is, numbers, then who said so."""
    first = [key for key in ("label", "mask", "shape") if key in made]
    last = [key for key in ("from", "prompt") if key in made]
    middle = [key for key in made if key not in (*first, *last)]
    return {key: made[key] for key in (*first, *middle, *last)}
