"""A corrected mask: the maps, numbers and boundaries that follow from it, written as one edit.

What a user set stays; what perception guessed from the old mask follows the new one.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.shapes import snapped_to_boundaries
from physgen.compile.world import World
from physgen.edit import object_entries
from physgen.edit.errors import EditError, impossible
from physgen.edit.ground import Ground, distance
from physgen.edit.live import Live
from physgen.edit.map_patches import Change, fitted, write_patched
from physgen.edit.masks import Correction, begin, count, make, parse_op, written
from physgen.edit.object_entries import Data
from physgen.edit.operations import edited
from physgen.edit.yaml_edit import with_boundary_comments, with_reasons, without_guess_comments
from physgen.geometry.polygon import Array, Outline
from physgen.perceive import document
from physgen.perceive.roles import SMALLEST_OBJECT, PhotoObject
from physgen.perceive.support.supports import depth_inside
from physgen.problems import InputError
from physgen.scene.files import MAPS
from physgen.scene.scene import MaskId, Motion
from physgen.simulate.engine import simulate

U16 = NDArray[np.uint16]

ROUNDING = 0.75
"""px between a written shape and a perceived outline that count as one: what is written is rounded."""
WATCHED = 0.5
"""s that are simulated to see whether objects stay where the photo shows them."""
STILL = 1.5
"""px of motion that is not visible."""


@dataclass(frozen=True)
class Corrected:
    """A correction: the new text, its name for the history, and the new object, if any."""

    text: str
    what: str
    made: str | None = None


@dataclass(frozen=True)
class Painted:
    """The pixels of all objects after a correction."""

    after: U16
    """(H, W): ids as `ids` has them, 0 for none."""
    ids: Mapping[str, int]
    stored: Mapping[str, int]
    """By name, ids in masks.png of the objects whose mask is stored there from now on."""
    corrected: tuple[str, ...]
    """Names of the corrected objects."""


def correct(live: Live, text: str, maps: Path | None, op: Data, out: Path) -> Corrected:
    """One operation on masks; see docs/editing.md. `out`, which does not exist yet, holds all maps afterwards.

    `maps` is the folder that stands in for the scene's assets now, None for its own. Unchanged maps are linked; where
    no map changes there is no `out`. Raises EditError where it is impossible; then nothing is left behind.
    """
    if out.exists():
        raise FileExistsError(out)
    try:
        parsed = parse_op(op)
        work = begin(live, text, maps)
        what = make(work, parsed)
        folder = maps
        if work.masks or work.fresh:
            _link_maps(work.scene.assets, out)
            new, folder = _finish(work, out), out
        else:
            new = edited(work.text, work.ops, None, live.path, live.allow_outside).text
        live.state(new, folder)
        new = with_reasons(new, work.known.reasons, work.fresh)
        live.state(new, folder)
    except InputError as error:
        shutil.rmtree(out, ignore_errors=True)
        problem = error.problems[0]
        message = f"then {problem.path or 'the scene'} {problem.found} {problem.expected}"
        raise impossible(message, problem.fix) from error
    except BaseException:
        shutil.rmtree(out, ignore_errors=True)
        raise
    return Corrected(new, what, next(iter(work.fresh), None))


def mask_png(live: Live, text: str, maps: Path | None, name: str, variant: str | None = None) -> bytes:
    """An object's pixels as a grey PNG of the photo's size, 0 or 255. Raises EditError, InputError."""
    sight = live.state(text, maps, variant)
    names = [item.name for item in sight.scene.objects]
    if name not in names:
        raise impossible(f"no object is called {name!r}", "choose an object")
    mask = np.where(sight.compiled.labels == names.index(name) + 1, np.uint8(255), np.uint8(0))
    done, data = cv2.imencode(".png", mask)
    assert done
    return data.tobytes()


def _link_maps(assets: Path | None, out: Path) -> None:
    """The maps under a second name; copies where the disk is another."""
    out.mkdir(parents=True)
    for name in MAPS if assets is not None else ():
        file = (assets or out) / f"{name}.png"
        if file.is_file():
            try:
                os.link(os.path.realpath(file), out / file.name)
            except OSError:
                shutil.copyfile(file, out / file.name)


def _finish(work: Correction, into: Path) -> str:
    """Write the maps; returns the text with the entries that follow."""
    scene = work.scene
    painted, change = _paint(work)
    place = scene.places.get("assets")
    if scene.assets is None or place is None or place.file != str(work.live.path):
        work.ops.append({"set": ["assets"], "value": _free_assets(work.live.path)})
    objects = _photo_objects(work, painted, Ground())
    maps = write_patched(work.maps, into, change, objects, painted.after, scene.world.view)
    work.live.hand_over(replace(scene, assets=into.resolve()), maps)
    return _with_ground(work, painted, _text(work, painted, Ground(), objects), into)


def _free_assets(path: Path) -> str:
    name, number = f"{path.stem}.assets", 1
    while (path.parent / name).exists():
        number += 1
        name = f"{path.stem}-{number}.assets"
    return name


def _paint(work: Correction) -> tuple[Painted, Change]:
    """The label maps after the correction: of all objects, and masks.png before and after. Raises EditError."""
    scene, labels, before = work.scene, work.sight.compiled.labels, work.maps.labels
    ids = {item.name: k + 1 for k, item in enumerate(scene.objects)}
    ids |= {name: len(scene.objects) + 1 + k for k, name in enumerate(work.fresh)}
    corrected = (*work.masks, *work.fresh)
    cleared = [ids[name] for name in (*work.masks, work.gone) if name is not None]
    after = labels.copy()
    after[np.isin(labels, cleared)] = 0
    for name, mask in (*work.masks.items(), *work.fresh.items()):
        after[mask] = ids[name]
    moved = list(corrected)
    for item in scene.objects:
        if item.name in corrected or item.name == work.gone:
            continue
        was, now = (part == ids[item.name] for part in (labels, after))
        if was.any() and count(now) < min(count(was), SMALLEST_OBJECT):
            raise impossible(f"nothing would be left of {item.name}", "delete it first, or merge the two")
        if not isinstance(item.mask, MaskId) and (was != now).any():
            moved.append(item.name)  # an outline in the file would be drawn over what was painted
    own = {item.name: item.mask.id for item in scene.objects if isinstance(item.mask, MaskId)}
    used = {item.mask.id for item in scene.boundaries if isinstance(item.mask, MaskId)} | set(own.values())
    free = iter(range(max({int(before.max()), *used}) + 1, 65536))
    new = before.copy()
    new[np.isin(before, [own[name] for name in (*moved, work.gone) if name in own])] = 0
    stored: dict[str, int] = {}
    for name in moved:
        identity = own[name] if name in own else next(free, None)
        if identity is None:
            raise impossible("the label map has no id left", "merge objects, or delete some")
        new[after == ids[name]] = stored[name] = identity
    scenery = work.sight.compiled.scenery
    touched = np.isin(labels, cleared) | np.isin(after, [ids[name] for name in corrected])
    union_before = (labels > 0) | ((before > 0) & ~scenery)
    union = (after > 0) | ((new > 0) & ~scenery)
    return Painted(after, ids, stored, corrected), Change(before, new, touched, union, union_before)


def _photo_objects(work: Correction, painted: Painted, ground: Ground) -> list[PhotoObject]:
    """The corrected objects with their new outlines, set on what supports them."""
    ids = [painted.ids[name] for name in painted.corrected]
    fits = fitted(painted.after, ids)
    walls = tuple(wall for wall in work.scene.boundaries if wall.name not in ground.changed)
    outlines = tuple(ground.outlines.get(i, fits[i]) for i in ids)
    placed = snapped_to_boundaries(replace(work.scene, boundaries=walls), outlines, [True] * len(ids))
    return [
        object_entries.photo_object(i, outline, _label(work, name), work.scene.size)
        for i, name, outline in zip(ids, painted.corrected, placed, strict=True)
    ]


def _label(work: Correction, name: str) -> str:
    """The label of an object, or of the one that a new one was split from."""
    if name in work.entries:
        return str(work.entries[name]["label"])
    source = name if name in work.masks else next(iter(work.masks))
    return work.scene.objects[work.index(source)].label


# The text


def _text(work: Correction, painted: Painted, ground: Ground, objects: list[PhotoObject]) -> str:
    """The file's text with all that follows. Raises EditError."""
    ops, text = list(work.ops), work.text
    held = {item.name for item in work.scene.objects if _is_held_by_perception(work, item.name)}
    if work.fresh and not work.entries and held & set(work.masks):
        held |= set(work.fresh)  # halves of an object that was held
    for name, one in zip(painted.corrected, objects, strict=True):
        made = _entry(work, name, one, painted.after)
        _support(made, ground, one.id, name in held, name in work.fresh)
        _set_provenance(work, name, made)
        made["mask"] = painted.stored[name]
        if name in work.fresh:
            ops.append({"add": ["objects", name], "value": _ordered(made)})
        else:
            ops += written(work, name, made)
    for name in painted.stored.keys() - set(painted.corrected):
        ops.append({"set": ["objects", name, "mask"], "value": painted.stored[name]})
    for item in work.scene.objects:
        if item.name not in work.masks and item.name != work.gone:
            ops += _neighbour(work, item.name, painted.ids[item.name], ground, item.name in held)
    for op in ops:
        if op.get("unset", [])[-1:] == ["motion"]:
            text = without_guess_comments(text, [op["unset"]])
    text = edited(text, [*ops, *ground.ops], None, work.live.path, work.live.allow_outside).text
    return with_boundary_comments(text, ground.remarks)


def _is_held_by_perception(work: Correction, name: str) -> bool:
    """Whether an object is static because perception saw nothing under it, and no user has set that since."""
    if work.known.document["objects"].get(name, {}).get("motion") != Motion.STATIC.value:
        return False
    return work.text != without_guess_comments(work.text, [["objects", name, "motion"]])


def _entry(work: Correction, name: str, one: PhotoObject, after: U16) -> Data:
    """The entry of a corrected object with the numbers that follow."""
    if name in work.entries:
        return dict(work.entries[name])
    if work.gone is not None:
        return object_entries.joined(work.known, name, work.gone, one, after)
    if work.fresh and not work.entries:  # halves
        (source,) = work.masks
        share = count(after == one.id) / max(count(work.mask(source)), 1)
        return object_entries.shared(work.known, source, name, share, one, after)
    return object_entries.changed(work.known, name, one, after)


def _support(made: Data, ground: Ground, id_: int, held: bool, is_new: bool) -> None:
    """An object that nothing supports is static, and moves again once something does; on a slope it does not slide."""
    if id_ in ground.held:
        made.setdefault("motion", Motion.STATIC.value)
    elif held and ground.freed:
        made.pop("motion", None)
    grip = ground.grip.get(id_, 0.0)
    if made.get("friction", grip) < grip and (is_new or "friction" in made.get("from", {})):
        made["friction"] = grip
        made["from"] = {**made.get("from", {}), "friction": document.provenance("lies on a slope", 0.5)}


def _set_provenance(work: Correction, name: str, made: Data) -> None:
    """`from` and `prompt` name the source of the mask; a mask that a user drew has none."""
    sources = {key: value for key, value in (made.pop("from", None) or {}).items() if key != "mask"}
    made.pop("prompt", None)
    if name in work.found:
        sure, prompt = work.found[name]
        sources = {"mask": document.provenance("pointed at", sure), **sources}
        made["prompt"] = prompt
    if sources:
        made["from"] = sources


def _ordered(made: Data) -> Data:
    """In the order in which perception writes entries."""
    first = [key for key in ("label", "mask", "shape") if key in made]
    last = [key for key in ("from", "prompt") if key in made]
    middle = [key for key in made if key not in (*first, *last)]
    return {key: made[key] for key in (*first, *middle, *last)}


def _neighbour(work: Correction, name: str, id_: int, ground: Ground, held: bool) -> list[Data]:
    """Operations for an object that was not corrected."""
    if name not in work.known.document["objects"]:
        return []
    was, path = work.known.was(name), ["objects", name]
    ops: list[Data] = []
    if id_ in ground.freed and held:
        ops.append({"unset": [*path, "motion"]})
    elif id_ in ground.held and "motion" not in was:
        ops.append({"set": [*path, "motion"], "value": Motion.STATIC.value})
    if id_ in ground.moved:
        before, now = ground.moved[id_]
        own = was.get("shape", "auto") != "auto" and "place" not in was  # not one that a user put elsewhere
        own = own and not isinstance(was.get("motion"), Mapping)
        if own and distance(work.known.outlines[id_ - 1], before) <= ROUNDING:
            ops.append({"set": [*path, "shape"], "value": document.shape_entry(now)})
    return ops


# The ground


def _with_ground(work: Correction, painted: Painted, plain: str, maps: Path) -> str:
    """The text with the ground as it was, or with the new one where objects stay at rest only on that."""
    walls = work.known.document.get("boundaries") or {}
    if not any(isinstance((wall or {}).get("from"), str) for wall in walls.values()):
        return plain
    names = painted.corrected
    freed = any(_is_held_by_perception(work, name) for name in work.masks)
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
        other = _text(work, painted, ground, _photo_objects(work, painted, ground))
        then = _drift(work, other, maps)
        deep = _depth(work, other, maps, names)
    except (EditError, InputError):
        return plain
    left = max(deep, *(then.get(name, 0.0) for name in {*stood, *names}), 0.0)
    return other if left < bad or (freed and left <= STILL) else plain


def _drift(work: Correction, text: str, maps: Path | None) -> dict[str, float]:
    """Motion of the objects of a text that nothing pushes; see `drift`. Raises InputError."""
    return drift(work.live.state(text, maps).compiled.world)


def drift(world: World) -> dict[str, float]:
    """px by which the farthest point of each dynamic object moves within `WATCHED`, by name.

    Without pushes, fields and initial velocities. Infinity where the motion has no numbers.
    """
    none = np.zeros(2)
    bodies = tuple(replace(body, velocity=none, spin=0.0, roll=none) for body in world.bodies)
    free = [k for k, body in enumerate(bodies) if body.motion is Motion.DYNAMIC]
    try:
        run = simulate(replace(world, bodies=bodies, pushes=(), fields=()), np.array([0.0, WATCHED]))
    except InputError:
        return {bodies[k].name: float("inf") for k in free}
    dx, dy, turn = np.abs(run.poses[-1] - run.poses[0]).T
    reach = [0.0 if body.radius is not None else body.reach for body in bodies]  # a disc may turn unseen
    return {bodies[k].name: float(np.hypot(dx[k], dy[k]) + turn[k] * reach[k]) for k in free}


def _depth(work: Correction, text: str, maps: Path, names: tuple[str, ...]) -> float:
    """px by which boundaries of perception lie within objects. Raises InputError."""
    sight = work.live.state(text, maps)
    ours = work.live.document(text, maps).get("boundaries") or {}
    lines = [
        _sampled(np.array(wall.points, np.float64).reshape(-1, 2))
        for wall in sight.scene.boundaries
        if wall.points and isinstance(ours[wall.name].get("from"), str)
    ]
    pairs = zip(sight.scene.objects, sight.compiled.shapes.outlines, strict=True)
    outlines: list[Outline] = [outline for item, outline in pairs if item.name in names]
    return max((float(depth_inside(one, line).max()) for one in outlines for line in lines), default=0.0)


def _sampled(wall: Array) -> Array:
    """Points along a wall, 1 px apart."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(wall, axis=0).T))])
    at = np.append(np.arange(0.0, along[-1]), along[-1])
    return np.stack([np.interp(at, along, wall[:, k]) for k in (0, 1)], axis=1)
