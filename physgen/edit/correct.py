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

from physgen.edit.consequences import Painted, held_by_perception, text, things
from physgen.edit.ground import Ground
from physgen.edit.live import Live
from physgen.edit.masking import KINDS, Op, Work, begun, count
from physgen.edit.ops import edited
from physgen.edit.patched import Change, write_patched
from physgen.edit.reasons import reasoned
from physgen.edit.refusing import EditError, impossible
from physgen.edit.stillness import STILL, depth, drift
from physgen.perceive.found import SMALLEST
from physgen.problems import InputError
from physgen.scene.files import MAPS
from physgen.scene.model import MaskId

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
    folder = maps
    try:
        if work.masks or work.fresh:
            _linked(work.scene.assets, out)
            new, folder = _finish(work, out), out
        else:
            new = edited(work.text, work.ops, None, live.path, live.allow_outside).text
        scene = live.state(new, folder).scene
        told = reasoned(new, scene, str(live.path), work.known.reasons, work.fresh)
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


def _finish(work: Work, into: Path) -> str:
    """Label map, outlines and maps, which are written, and the text with the entries."""
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
    _assets(work)
    painted = Painted(after, ids, stored)
    corrected = things(work, painted, Ground())
    made = write_patched(work.maps, into, change, corrected, after, scene.world.view)
    work.live.hand_over(replace(scene, assets=into.resolve()), made)
    return _grounded(work, painted, text(work, painted, Ground(), corrected), into)


def _grounded(work: Work, painted: Painted, plain: str, maps: Path) -> str:
    """The text with the ground as it was, or with the one that follows where things stand still on that alone."""
    walls = work.known.document.get("boundaries") or {}
    if not any(isinstance((wall or {}).get("from"), str) for wall in walls.values()):
        return plain
    names = painted.sides(work)
    freed = any(held_by_perception(work, name) for name in work.masks)
    moved, deep = _drift(work, plain, maps), _depth(work, plain, maps, names)
    if not freed and max(deep, *moved.values(), 0.0) <= STILL:
        return plain
    before = _drift(work, work.text, work.folder)
    stood = {name for name in moved if before.get(name, 0.0) <= STILL}  # what fell before may fall
    bad = max(deep, *(moved[name] for name in stood), 0.0)
    if not freed and bad <= STILL:
        return plain
    view, was = work.scene.world.view, work.sight.compiled.labels
    ground = work.live.layer.follow(work.maps.rgb, was, painted.after, view, walls)
    if ground is None:
        return plain
    try:
        other = text(work, painted, ground, things(work, painted, ground))
        then = _drift(work, other, maps)
        left = max(_depth(work, other, maps, names), *(then.get(name, 0.0) for name in {*stood, *names}), 0.0)
    except (EditError, InputError):
        return plain
    return other if left < bad or (freed and left <= STILL) else plain


def _drift(work: Work, text: str, maps: Path | None) -> dict[str, float]:
    """px by which things move though nobody pushes them. Raises InputError."""
    return drift(work.live.state(text, maps).compiled.world)


def _depth(work: Work, text: str, maps: Path, names: list[str]) -> float:
    """px by which walls of perception's lie within things. Raises InputError."""
    sight = work.live.state(text, maps)
    ours = work.live.document(text, maps).get("boundaries") or {}
    walls = [
        np.array(wall.points, np.float64).reshape(-1, 2)
        for wall in sight.scene.boundaries
        if wall.points and isinstance(ours[wall.name].get("from"), str)
    ]
    outlines = zip(sight.scene.objects, sight.compiled.shapes.outlines, strict=True)
    return depth((outline for item, outline in outlines if item.name in names), walls)


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
