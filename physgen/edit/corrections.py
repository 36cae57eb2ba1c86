"""A corrected mask: the maps, numbers and boundaries that follow from it, written as one edit."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.shapes import snapped_to_boundaries
from physgen.compile.world import World
from physgen.edit import object_entries
from physgen.edit.errors import EditError, impossible
from physgen.edit.ground import Ground, off
from physgen.edit.live import Live
from physgen.edit.map_patches import Change, fitted, write_patched
from physgen.edit.masks import Work, begun, count, make, parse_op, written
from physgen.edit.object_entries import Data
from physgen.edit.operations import edited
from physgen.edit.yaml_edit import forgotten, reasoned, said_of_walls
from physgen.geometry.polygon import Array, Outline
from physgen.perceive import document
from physgen.perceive.roles import SMALLEST_OBJECT, PhotoObject
from physgen.perceive.support.supports import depth_inside
from physgen.problems import InputError
from physgen.scene.files import MAPS
from physgen.scene.scene import MaskId, Motion
from physgen.simulate.engine import simulate

# ----------------------------------------------------------------------
# Pixels that change hands, and the ground that follows -> the operations on the scene's text, all at once.

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


def things(work: Work, painted: Painted, ground: Ground) -> list[PhotoObject]:
    """The corrected ones, on what holds them."""
    names = painted.sides(work)
    ids = [painted.ids[name] for name in names]
    fits = fitted(painted.after, ids)
    kept = tuple(wall for wall in work.scene.boundaries if wall.name not in ground.changed)
    outlines = tuple(ground.outlines.get(i, fits[i]) for i in ids)
    stood = snapped_to_boundaries(replace(work.scene, boundaries=kept), outlines, [True] * len(ids))
    return [
        object_entries.thing(i, outline, _label(work, name), work.scene.size)
        for i, name, outline in zip(ids, names, stood, strict=True)
    ]


def text(work: Work, painted: Painted, ground: Ground, corrected: list[PhotoObject]) -> str:
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
        made["from"] = {**made.get("from", {}), "friction": document.provenance("lies on a slope", 0.5)}


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
        ops.append({"set": ["objects", name, "shape"], "value": document.shape_entry(now)})
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


def _numbers(work: Work, name: str, one: PhotoObject, after: U16) -> Data:
    """The entry of an object with the numbers that follow."""
    known = work.known
    if name in work.entries:
        return dict(work.entries[name])
    if work.gone is not None:
        return object_entries.joined(known, name, work.gone, one, after)
    if work.fresh and not work.entries:  # halves
        (source,) = work.masks
        whole = count(work.mask(source))
        part = count(after == one.id) / max(whole, 1)
        return object_entries.shared(known, source, name, part, one, after)
    return object_entries.changed(known, name, one, after)


def _found_by(work: Work, name: str, made: Data) -> None:
    """`from` and `prompt` say who found the mask; of one that a person drew nothing is said."""
    said = {key: value for key, value in (made.get("from") or {}).items() if key != "mask"}
    made.pop("prompt", None)
    if name in work.found:
        sure, prompt = work.found[name]
        said = {"mask": document.provenance("pointed at", sure), **said}
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


# ----------------------------------------------------------------------
# A world -> which of its things move though nobody pushes them: what a photo shows at rest is to stay at
# rest.

FOR = 0.5
"""s that are simulated."""
STILL = 1.5
"""px that nobody sees."""


def drift(world: World) -> dict[str, float]:
    """px by which each thing's farthest point leaves its place within `FOR`; of those that move freely.

    Without pushes, fields and the speeds of the beginning. Infinity where a motion leaves all numbers.
    """
    none = np.zeros(2)
    bodies = tuple(replace(body, velocity=none, spin=0.0, roll=none) for body in world.bodies)
    free = [k for k, body in enumerate(bodies) if body.motion is Motion.DYNAMIC]
    try:
        run = simulate(replace(world, bodies=bodies, pushes=(), fields=()), np.array([0.0, FOR]))
    except InputError:
        return {bodies[k].name: float("inf") for k in free}
    dx, dy, turn = np.abs(run.poses[-1] - run.poses[0]).T
    reach = [
        0.0 if body.radius is not None else body.reach for body in bodies
    ]  # a disc looks the same turned
    return {bodies[k].name: float(np.hypot(dx[k], dy[k]) + turn[k] * reach[k]) for k in free}


def depth(outlines: Iterable[Outline], walls: Iterable[Array]) -> float:
    """px by which walls, each `(K, 2)` px, lie within outlines at most."""
    lines = [_sampled(wall) for wall in walls]
    return max((float(depth_inside(one, line).max()) for one in outlines for line in lines), default=0.0)


def _sampled(wall: Array) -> Array:
    """Points along a wall, a px apart."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(wall, axis=0).T))])
    at = np.append(np.arange(0.0, along[-1]), along[-1])
    return np.stack([np.interp(at, along, wall[:, k]) for k in (0, 1)], axis=1)


# ----------------------------------------------------------------------
# A mask that a person corrects -> new text and new maps: everything that follows from it follows, the rest
# stays.


@dataclass(frozen=True)
class Corrected:
    """A correction that was made."""

    text: str
    what: str
    """As the history calls it."""
    made: str | None = None
    """The object that is new."""


def correct(
    live: Live, text: str, maps: Path | None, variant: str | None, op: Data, out: Path
) -> Corrected:
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


def _corrected(live: Live, text: str, maps: Path | None, op: Data, out: Path) -> Corrected:
    parsed = parse_op(op)
    work = begun(live, text, maps)
    what = make(work, parsed)
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
        if before and count(after == k + 1) < min(before, SMALLEST_OBJECT):
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
