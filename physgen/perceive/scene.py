"""Photo, and masks if there are any -> percepts, scene document and comments: the roles of perception, run in order."""

from __future__ import annotations

import difflib
import fnmatch
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.crew import Crew
from physgen.materials import kind
from physgen.outline import raster
from physgen.outline.outline import Disc, bounds, mass_properties
from physgen.outline.touching import fit_outlines
from physgen.perceive import words
from physgen.perceive.lifted import refilled
from physgen.perceive.roles import (
    Category,
    Doubt,
    Intrinsics,
    LightGuess,
    Matter,
    Name,
    Rgb,
    Scenery,
    Setting,
    Shadows,
    Thing,
)
from physgen.perceive.scale import ENOUGH, judged, scale, stated
from physgen.percepts.maps import Percepts
from physgen.problems import InputError, Problem
from physgen.scene.model import View

Progress = Callable[[str, int, int], None]
"""Told the stage that begins, how much of it is done, and of how much."""
HEADER = "A photo as physgen perceived it. Change any number and run: physgen render THIS-FILE"
UNKNOWN = Setting(View.SIDE, 0.0, "", ())
"""What holds the objects, before anybody has looked."""
POINT = "mark them with --masks FILE, --box x,y,w,h or --point x,y"
GRAVITY = 9.8
"""m/s², as a scene has it unless it says something else."""
SMALLEST = 12
"""px: an id of fewer pixels is a speck, no object."""
ROLES = (
    "categories",
    "segment",
    "label",
    "physics",
    "depth",
    "boundary",
    "normals",
    "intrinsic",
    "light",
    "matte",
    "inpaint",
    "shadow",
)


@dataclass(frozen=True)
class Found:
    """The objects that perception starts from, found or given."""

    labels: NDArray[np.uint16]
    """(H, W), 0 = background."""
    source: str
    """Who found them, for `from`."""
    confidence: Mapping[int, float]
    """0..1, by id."""
    names: Mapping[int, Name]
    """What some of them are called already, by id."""
    prompts: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)
    """Where a person pointed, by id, as the scene says it: `{"box": [x, y, w, h]}` or `{"point": [x, y]}`, px."""
    doubtful: Sequence[Doubt] = ()
    """What may be an object and was not taken for one."""
    called: Mapping[int, str] = field(default_factory=dict)
    """What objects are named in the scene already, by id."""
    said: Mapping[int, str] = field(default_factory=dict)
    """Who found single masks, by id, as the scene's `from` has it; `source` found the others."""
    named_by: str = "given"
    """Who said `names`, for `from`."""


@dataclass(frozen=True)
class Perceived:
    """What a photo became."""

    percepts: Percepts
    document: dict[str, Any]
    """A scene as plain YAML data, valid once the assets are written; `maps` is for the writer of the assets to add."""
    comments: dict[str, str]
    """Dotted path -> a sentence or more to stand above it."""
    header: str
    """What to say at the top of the file."""
    warnings: tuple[Problem, ...] = ()
    """What was strange in the input and could be passed over."""
    record: Sequence[Mapping[str, Any]] = ()
    """How each role went, where others than the core's own had a part."""


def silent(stage: str, done: int, total: int) -> None:
    """Progress that nobody follows."""


def perceive(
    rgb: Rgb,
    found: Found | None = None,
    *,
    image: str = "photo.png",
    assets: str = "photo.assets",
    renames: Sequence[str] = (),
    crew: Crew | None = None,
    asked: Sequence[str] = (),
    view: View | None = None,
    pixels_per_meter: float | None = None,
    progress: Progress = silent,
) -> Perceived:
    """The whole of perception. `found` None: segment the photo.

    `renames` are `NAME=TEXT`: NAME is the name of an object as it would be called without, its mask id, or a pattern
    (`ball-*`). `crew` fills the roles; `asked` are the nouns to find, for those that find what they are told to.
    `pixels_per_meter` is the photo's true scale, where somebody knows it. Raises InputError where there is nothing
    to make a scene of.
    """
    crew = crew or Crew()

    def role(name: str, *arguments: Any, **extra: Any) -> Any:
        progress(name, ROLES.index(name), len(ROLES))
        result = crew.call(name, *arguments, **extra)
        if name not in ("inpaint", "normals", "label"):  # asked again later, or the next may ask the same model
            crew.release(name)
        return result

    scenery: Scenery | None = None
    if found is None:
        categories: Sequence[Category] = [Category(noun, True) for noun in asked]
        if "categories" in crew.row("segment").uses and not asked:
            categories = role("categories", rgb)
        segments = role("segment", rgb, categories=categories)
        scenery = segments.scenery
        sure = {k + 1: float(c) for k, c in enumerate(segments.confidence)}
        found = Found(segments.labels, crew.name("segment"), sure, segments.names, doubtful=segments.doubtful)
        found = replace(found, named_by=crew.name("segment"))
    things, left_out = outlined(rgb, found)
    if not things:
        renamed_things(things, renames, {})
        return _signed(_empty(rgb, found, image, assets, pixels_per_meter), crew)
    if found.source not in ("given", "coco"):
        new = [thing for thing in things if thing.id not in found.said]
        found = replace(found, labels=_rounded(found.labels, new))
    guessed: Mapping[int, Name] = role("label", rgb, found.labels, things)
    named = {**guessed, **found.names}
    label_source = {t.id: found.named_by if t.id in found.names else crew.name("label") for t in things}
    if found.called:  # the scene knows who said them
        label_source |= dict.fromkeys(found.names, "")
    things = [replace(t, label=named[t.id].label) for t in things]
    before = words.names(things, {t.id: found.called[t.id] for t in things if t.id in found.called})
    things, renamed = renamed_things(things, renames, before)
    label_source |= dict.fromkeys(renamed, "")
    told_scale = scale(things, {t.id: kind(t.label) for t in things}, _sure(found, named, guessed, renamed))
    if pixels_per_meter is None and told_scale is not None and told_scale.confidence >= ENOUGH:
        measured: float | None = told_scale.pixels_per_meter
    else:
        measured = pixels_per_meter
    matter: Mapping[int, Matter] = role("physics", rgb, things, measured)
    crew.release("label")
    told_scale = judged(things, matter, crew.name("physics")) or told_scale
    surroundings: dict[str, Any] = {"scenery": scenery}
    wanted = crew.row("boundary").uses
    if "depth" in wanted or "depth" in crew.plan.choices:
        surroundings["depth"] = role("depth", rgb)
    if "normals" in wanted:
        surroundings["normals"] = role("normals", rgb, found.labels, things, UNKNOWN)
    setting: Setting = role("boundary", rgb, found.labels, things, view, **surroundings)
    things = [replace(t, outline=setting.outlines.get(t.id, t.outline)) for t in things]
    normals = surroundings.get("normals")
    if normals is None or crew.row("normals").extra is None:  # our own go by what holds the things
        normals = role("normals", rgb, found.labels, things, setting)
    crew.release("normals")
    intrinsics: Intrinsics = role("intrinsic", rgb, found.labels, normals)
    light: LightGuess = role("light", rgb, found.labels, things, normals, intrinsics)
    coverage = role("matte", rgb, found.labels)
    background = role("inpaint", rgb, coverage > 0)
    shadows: Shadows = role("shadow", background, coverage, found.labels, things, matter, setting, light)
    clean = shadows.clean
    if clean is not None:
        clean = refilled(clean, background, coverage, crew.get("inpaint"))
    crew.release("inpaint")
    percepts = Percepts(
        rgb=rgb, labels=found.labels, coverage=coverage, background=background, clean=clean, shadows=shadows.owners,
        depth=surroundings.get("depth"), normals=normals, albedo=intrinsics.albedo, shading=intrinsics.shading,
    )  # fmt: skip

    called = words.names(things, {i: name for i, name in before.items() if i not in renamed})
    objects: dict[str, Any] = {}
    comments: dict[str, str] = {}
    for thing in sorted(things, key=lambda t: list(called).index(t.id)):
        name, it = called[thing.id], matter[thing.id]
        told = {"mask": _masked(found, thing.id)}
        if label_source[thing.id]:
            told["label"] = words.source(label_source[thing.id], named[thing.id].confidence)
        table = crew.name("physics")
        told |= {
            "mass": words.source(table, it.confidence),
            "friction": words.source(table, 0.5 * it.confidence + 0.2),
        }
        told["elasticity"] = told["friction"]
        one: dict[str, Any] = {"label": thing.label, "mask": thing.id, "shape": words.shape(thing.outline)}
        one |= {
            "solid": it.solid.value,
            "mass": it.mass,
            "friction": max(it.friction, setting.grip.get(thing.id, 0.0)),
            "elasticity": it.elasticity,
        }
        still = thing.cut or thing.id in setting.held
        if words.rolls(thing, it.solid, setting.view) and not still:
            one["rolling"] = it.rolling
            told["rolling"] = told["friction"]
        if it.surface:
            comments[f"objects.{name}.friction"] = it.surface
        if thing.cut:
            one["motion"] = "static"
            comments[f"objects.{name}.motion"] = (
                "cut off by the photo's border, so it is held; dynamic lets it go"
            )
        elif thing.id in setting.held:
            one["motion"] = "static"
            comments[f"objects.{name}.motion"] = (
                "nothing that is seen keeps it from falling, so it is held; dynamic lets it go"
            )
        if it.friction < setting.grip.get(thing.id, 0.0):
            told["friction"] = words.source("lies on a slope", 0.5)
            comments[f"objects.{name}.friction"] = "at least this much, since it lies still on a slope"
        comments[f"objects.{name}.mass"] = f"g: {it.reason}"
        if not objects and found.doubtful:
            comments[f"objects.{name}"] = words.doubts(found.doubtful, found.source)
        objects[name] = {**one, "from": told}
        if thing.id in found.prompts:
            objects[name]["prompt"] = dict(found.prompts[thing.id])
    per_meter, comments["world.pixels_per_meter"] = stated(pixels_per_meter, told_scale)
    document: dict[str, Any] = {
        "physgen": 1,
        "image": image,
        "assets": assets,
        "world": _world(setting, per_meter, shadows),
        "objects": objects,
        "boundaries": {w.name: words.wall(w) for w in setting.walls},
        "forces": [],
        "light": _light(light, shadows),
    }
    comments |= _comments(found, things, left_out, setting, light, shadows)
    comments["forces"] = _push(found, setting, things, called, matter, per_meter)
    said = (words.unknown(t.label) for t in things if t.id in renamed)
    warnings = tuple(dict.fromkeys(problem for problem in said if problem))
    return _signed(Perceived(percepts, document, comments, HEADER, warnings), crew)


def _signed(made: Perceived, crew: Crew) -> Perceived:
    """With what the crew says of itself: the record, and who took over from whom."""
    if not crew.models():
        return made
    fell = [f"{step.role}={step.instead_of} failed ({step.because}): {step.backend} took over" for step in crew.fell()]
    return replace(made, header="\n".join([made.header, *fell]), record=crew.record())


def _masked(found: Found, i: int) -> str:
    """Who found an object's mask, and how sure."""
    source = "pointed at" if i in found.prompts else found.source
    return found.said.get(i) or words.source(source, found.confidence.get(i, 1.0))


def outlined(rgb: Rgb, found: Found) -> tuple[list[Thing], int]:
    """Outlines of every object that is more than a speck, and how many specks there were."""
    labels = found.labels
    height, width = rgb.shape[:2]
    if labels.shape != (height, width):
        size = f"{labels.shape[1]} x {labels.shape[0]} px"
        raise InputError.of(
            "--masks", size, f"differs from the photo's {width} x {height} px", "make them one size"
        )
    counts = np.bincount(labels.ravel(), minlength=2)
    every = np.flatnonzero(counts[1:]) + 1
    ids = [int(i) for i in every if counts[i] >= SMALLEST]
    if not ids and found.source == "given":
        shows = f"shows no object of {SMALLEST} px or more" if len(every) else "shows no object"
        raise InputError.of("--masks", "", shows, POINT)
    if not ids:
        return [], len(every)
    outlines = fit_outlines(labels, ids)
    frame = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    edge = np.bincount(frame, minlength=int(labels.max()) + 1)
    things = []
    for i in ids:
        x0, y0, x1, y1 = bounds(outlines[i])
        beyond = max(-0.5 - x0, -0.5 - y0, x1 - width + 0.5, y1 - height + 0.5)
        things.append(Thing(i, outlines[i], cut=bool(edge[i] > 0 or beyond > 0)))
    return things, len(every) - len(ids)


def _empty(rgb: Rgb, found: Found, image: str, assets: str, pixels_per_meter: float | None) -> Perceived:
    """A scene without objects: the photo as it is."""
    nothing = np.zeros(rgb.shape[:2], np.float32)
    document: dict[str, Any] = {
        "physgen": 1, "image": image, "assets": assets,
        "world": {"view": View.SIDE.value, "pixels_per_meter": pixels_per_meter or 100, "duration": 2.0},
        "objects": {}, "boundaries": {}, "forces": [],
    }  # fmt: skip
    comments = {"objects": f"nothing in the photo looks like a whole thing that could be moved; {POINT}"}
    if found.doubtful:
        first, *lines = words.doubts(found.doubtful, found.source).split("\n")
        indented = "".join(f"\n  {line}" for line in lines)
        comments["boundaries"] = f"{first}, and the {{}} after objects:{indented}"
    percepts = Percepts(
        rgb=rgb, labels=np.zeros(rgb.shape[:2], np.uint16), coverage=nothing, background=rgb, clean=None
    )
    return Perceived(percepts, document, comments, HEADER)


def _rounded(labels: NDArray[np.uint16], things: Sequence[Thing]) -> NDArray[np.uint16]:
    """Masks of round things made as round as they are: what leaked out is given back, what was missed is taken in."""
    result = labels.copy()
    for thing in things:
        if isinstance(thing.outline, Disc):
            inside = raster.coverage(thing.outline, (labels.shape[1], labels.shape[0])) >= 0.5
            result[(labels == thing.id) & ~inside] = 0
            result[(result == 0) & inside] = thing.id
    return result


def renamed_things(
    things: Sequence[Thing], renames: Sequence[str], called: Mapping[int, str]
) -> tuple[list[Thing], set[int]]:
    """Things, `called` so, under their new labels, and the ids of those that got one.

    Raises InputError with every wrong NAME.
    """
    said: dict[int, str] = {}
    problems = []
    for rename in renames:
        name, sign, text = (part.strip() for part in rename.partition("="))
        hits = [i for i, n in called.items() if fnmatch.fnmatchcase(n, name) or str(i) == name]
        if not (sign and text and hits):
            near = difflib.get_close_matches(name, called.values(), 1)
            known = ", ".join(list(called.values())[:8]) + (", ..." if len(called) > 8 else "")
            fix = f"did you mean {near[0]}?" if near and near[0] != name else f"the objects are {known}"
            expected = "names no object" if sign and text else "is not NAME=TEXT"
            problems += InputError.of("--label", f'"{rename}"', expected, fix).problems
        said |= dict.fromkeys(hits, text)
    if problems:
        raise InputError(problems)
    return [replace(t, label=said[t.id]) if t.id in said else t for t in things], set(said)


def _sure(
    found: Found, named: Mapping[int, Name], guessed: Mapping[int, Name], renamed: set[int]
) -> dict[int, float]:
    """How sure each label is: 1 where a person said it, or changed what was guessed."""
    said = {i for i in found.names if i not in guessed or found.names[i].label != guessed[i].label} | renamed
    return {i: 1.0 if i in said else name.confidence for i, name in named.items()}


def _world(setting: Setting, pixels_per_meter: float, shadows: Shadows) -> dict[str, Any]:
    world: dict[str, Any] = {"view": setting.view.value, "pixels_per_meter": pixels_per_meter}
    if setting.view is View.TOP:
        world["table"] = {"friction": 0}
    return world | {"duration": 2.0} | words.view(shadows, setting.view is View.SIDE)


def _light(guess: LightGuess, shadows: Shadows) -> dict[str, Any]:
    if shadows.clean is None:
        return words.light(guess.light)
    return words.light(shadows.light) | {"softness": shadows.softness}


def _comments(
    found: Found,
    things: Sequence[Thing],
    left_out: int,
    setting: Setting,
    light: LightGuess,
    shadows: Shadows,
) -> dict[str, str]:
    """Sentences about where each guess came from."""
    told = {
        "given": "from the masks given",
        "pointed at": "where you pointed",
        "coco": "from the annotations",
        "kept": "as the scene had them, and where you pointed",
    }
    how = told.get(found.source, f"found by {found.source}")
    specks = f"; {left_out} specks of under {SMALLEST} px left out" if left_out else ""
    comments = {
        "world.view": f"side or top: {setting.reason} (confidence {setting.confidence:g})",
        "objects": f"{words.counted({t.id: t.label for t in things})}, {how}, counted from left to right{specks}",
        "light": f"{light.reason} (confidence {light.confidence:g})"
        if shadows.clean is None
        else f"{shadows.reason} (confidence {shadows.confidence:g})",
    }
    if setting.view is View.TOP:
        comments["world.table"] = "nobody can see friction: 0 lets things glide for ever, 0.2 is cloth"
    for wall in setting.walls:
        comments[f"boundaries.{wall.name}"] = wall.reason
    return comments


def _push(
    found: Found,
    setting: Setting,
    things: Sequence[Thing],
    called: Mapping[int, str],
    matter: Mapping[int, Matter],
    pixels_per_meter: float,
) -> str:
    """A force to try: a sure thing far from the others, pushed towards them as fast as it would fall its size."""
    loose = [t for t in things if not t.cut and t.id not in setting.held] or list(things)
    sure = {t.id: found.confidence.get(t.id, 1.0) for t in loose}
    movable = [t for t in loose if sure[t.id] >= 0.8 * max(sure.values())]
    centers = np.array([mass_properties(t.outline).center for t in movable])
    away = centers - centers.mean(0)
    if setting.view is View.SIDE:
        away[:, 1] = 0
    k = int(np.argmax((away**2).sum(1)))
    length = float(np.hypot(*away[k]))
    towards = -away[k] / length if length > 1 else np.array([1.0, 0.0])
    size = mass_properties(movable[k].outline).area ** 0.5
    speed = float(f"{(2 * GRAVITY * pixels_per_meter * size) ** 0.5:.1g}")
    push = matter[movable[k].id].mass * speed
    x, y = (float(f"{push * c:.2g}") if abs(c) > 0.01 else 0.0 for c in towards)
    return (
        f"to set something going, replace [] by a list such as (impulse in g px/s, here {speed:g} px/s):\n"
        f"  - {{object: {called[movable[k].id]}, impulse: [{x:g}, {y:g}]}}"
    )
