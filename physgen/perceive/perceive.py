"""Photo to percepts and scene document: the stages of perception in order."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import raster
from physgen.geometry.fitting import fit_outlines
from physgen.geometry.polygon import Disc, bounds
from physgen.maps import Percepts
from physgen.materials import kind
from physgen.perceive import document as remarks
from physgen.perceive.document import label_confidences, object_entries, relabel_objects
from physgen.perceive.roles import (
    SMALLEST_OBJECT,
    BoundaryGuess,
    Detections,
    Intrinsics,
    LightGuess,
    Matter,
    Name,
    PerceivedScene,
    PhotoObject,
    Rgb,
    Scenery,
    Shadows,
)
from physgen.perceive.scale import MIN_SCALE_CONFIDENCE, judged_scale, photo_scale, scale_entry
from physgen.perceive.segment.prompts import segmenter
from physgen.perceive.shadow.shadow_removal import refill_background
from physgen.photometry import decode, encode_u8
from physgen.problems import InputError
from physgen.registry import Backends
from physgen.scene.scene import View

# ----------------------------------------------------------------------
# Photo, and masks if there are any -> percepts, scene document and comments: the roles of perception, run in
# order.

Progress = Callable[[str, int, int], None]
"""Told the stage that begins, how much of it is done, and of how much."""
HEADER = """\
A photo as physgen perceived it. Change any number and run: physgen render THIS-FILE
A number that you have set is no guess any more: take its entry out of from, which render --fan goes by"""
UNKNOWN = BoundaryGuess(View.SIDE, 0.0, "", ())
"""What holds the objects, before anybody has looked."""
POINT = "mark them with --masks FILE, --box x,y,w,h or --point x,y"
MOST_IDS, MOST_OBJECTS = 200, 5000
"""Ids from which mostly specks, and objects from which anything, is a picture and no label map."""
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


def no_progress(stage: str, done: int, total: int) -> None:
    """Progress that nobody follows."""


def perceive(
    rgb: Rgb,
    found: Detections | None = None,
    *,
    image: str = "photo.png",
    assets: str = "photo.assets",
    renames: Sequence[str] = (),
    crew: Backends | None = None,
    asked: Sequence[str] = (),
    view: View | None = None,
    pixels_per_meter: float | None = None,
    progress: Progress = no_progress,
) -> PerceivedScene:
    """The whole of perception. `found` None: segment the photo.

    `renames` are `NAME=TEXT`: NAME is the name of an object as it would be called without, its mask id, or a pattern
    (`ball-*`). `crew` fills the roles; `asked` are the nouns to find, for those that find what they are told to.
    `pixels_per_meter` is the photo's true scale, where somebody knows it. Raises InputError where there is nothing
    to make a scene of.
    """
    crew = crew or Backends()

    def role(name: str, *arguments: Any, **extra: Any) -> Any:
        progress(name, ROLES.index(name), len(ROLES))
        result = crew.call(name, *arguments, **extra)
        if name not in (
            "inpaint",
            "normals",
            "label",
        ):  # asked again later, or the next may ask the same model
            crew.release(name)
        return result

    scenery: Scenery | None = None
    if found is None:
        progress("segment", ROLES.index("segment"), len(ROLES))
        segments = segmenter(crew, asked)(rgb)
        crew.release("segment")
        scenery = segments.scenery
        likely = {k + 1: float(c) for k, c in enumerate(segments.confidence)}
        who = crew.name("segment")
        found = Detections(
            segments.labels, who, likely, segments.names, doubtful=segments.doubtful, named_by=who
        )
    things, left_out = fit_objects(rgb, found)
    if not things:
        relabel_objects(things, renames, {})
        return _signed(_empty(rgb, found, image, assets, pixels_per_meter), crew)
    if found.source not in ("given", "coco"):
        new = [thing for thing in things if thing.id not in found.said]
        found = replace(found, labels=_rounded(found.labels, new))
    # a model is not asked twice what a thing is; our own guess tells a refreshed scene which names it made
    nameless = [t for t in things if t.id not in found.names] if crew.row("label").extra else things
    guessed: Mapping[int, Name] = role("label", rgb, found.labels, nameless) if nameless else {}
    named = {**guessed, **found.names}
    label_source = {t.id: found.named_by if t.id in found.names else crew.name("label") for t in things}
    if found.called:  # the scene knows who said them
        label_source |= dict.fromkeys(found.names, "")
    things = [replace(t, label=named[t.id].label) for t in things]
    before = remarks.object_names(things, {t.id: found.called[t.id] for t in things if t.id in found.called})
    things, renamed = relabel_objects(things, renames, before)
    label_source |= dict.fromkeys(renamed, "")
    told_scale = photo_scale(
        things, {t.id: kind(t.label) for t in things}, label_confidences(found, named, guessed, renamed)
    )
    if pixels_per_meter is None and told_scale is not None and told_scale.confidence >= MIN_SCALE_CONFIDENCE:
        measured: float | None = told_scale.pixels_per_meter
    else:
        measured = pixels_per_meter
    matter: Mapping[int, Matter] = role("physics", rgb, things, measured)
    crew.release("label")
    scales = [
        one for one in (told_scale, judged_scale(things, matter, crew.name("physics"))) if one is not None
    ]
    told_scale = max(scales, key=lambda one: one.confidence, default=None)
    surroundings: dict[str, Any] = {"scenery": scenery}
    wanted = crew.row("boundary").uses
    if "depth" in wanted or "depth" in crew.plan.choices:
        surroundings["depth"] = role("depth", rgb)
    if "normals" in wanted:
        surroundings["normals"] = role("normals", rgb, found.labels, things, UNKNOWN)
    setting: BoundaryGuess = role("boundary", rgb, found.labels, things, view, **surroundings)
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
    if clean is not None and not shadows.faint:
        clean = refill_background(clean, background, coverage, partial(crew.call, "inpaint"))
    crew.release("inpaint")
    percepts = Percepts(
        rgb=rgb, labels=found.labels, coverage=coverage, background=background, clean=clean, shadows=shadows.owners,
        depth=None if crew.name("depth") == "none" else surroundings.get("depth"),
        normals=normals, albedo=intrinsics.albedo, shading=intrinsics.shading,
    )  # fmt: skip

    called = remarks.object_names(things, {i: name for i, name in before.items() if i not in renamed})
    objects, comments = object_entries(
        found, things, called, matter, setting, named, label_source, crew.name("physics")
    )
    per_meter, comments["world.pixels_per_meter"] = scale_entry(pixels_per_meter, told_scale)
    document: dict[str, Any] = {
        "physgen": 1,
        "image": image,
        "assets": assets,
        "world": _world(setting, per_meter, shadows),
        "objects": objects,
        "boundaries": {w.name: remarks.wall_entry(w) for w in setting.walls},
        "forces": [],
        "light": _light(light, shadows),
    }
    comments |= remarks.scene_comments(found, things, left_out, setting, light, shadows)
    comments["forces"] = remarks.push_comment(found, setting, things, called, matter, per_meter)
    said = (remarks.unknown_label(t.label) for t in things if t.id in renamed)
    warnings = tuple(dict.fromkeys(problem for problem in said if problem))
    return _signed(PerceivedScene(percepts, document, comments, HEADER, warnings), crew)


def _signed(made: PerceivedScene, crew: Backends) -> PerceivedScene:
    """With what the crew says of itself: the record, and who took over from whom."""
    if crew.all_default():
        return made
    fell = [
        f"{step.role}={step.instead_of} failed ({step.because}): {step.backend} took over"
        for step in crew.fallbacks()
    ]
    return replace(made, header="\n".join([made.header, *fell]), record=crew.record())


def fit_objects(rgb: Rgb, found: Detections) -> tuple[list[PhotoObject], int]:
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
    ids = [int(i) for i in every if counts[i] >= SMALLEST_OBJECT]
    if (len(every) > MOST_IDS and 2 * len(ids) < len(every)) or len(ids) > MOST_OBJECTS:
        what = (
            f"has {len(every):,} ids, most of them of a few pixels"
            if 2 * len(ids) < len(every)
            else f"has {len(every):,} ids"
        )
        fix = "give each object one id or colour, without soft borders, saved as PNG"
        raise InputError.of("--masks", "", f"is no label map: it {what}", fix)
    if not ids and found.source == "given":
        shows = f"shows no object of {SMALLEST_OBJECT} px or more" if len(every) else "shows no object"
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
        things.append(PhotoObject(i, outlines[i], cut=bool(edge[i] > 0 or beyond > 0)))
    return things, len(every) - len(ids)


def _empty(
    rgb: Rgb, found: Detections, image: str, assets: str, pixels_per_meter: float | None
) -> PerceivedScene:
    """A scene without objects: the photo as it is."""
    nothing = np.zeros(rgb.shape[:2], np.float32)
    document: dict[str, Any] = {
        "physgen": 1, "image": image, "assets": assets,
        "world": {"view": View.SIDE.value, "pixels_per_meter": pixels_per_meter or 100, "duration": 2.0},
        "objects": {}, "boundaries": {}, "forces": [],
    }  # fmt: skip
    comments = {"objects": f"nothing in the photo looks like a whole thing that could be moved; {POINT}"}
    if found.doubtful:
        first, *lines = remarks.doubt_comments(found.doubtful, found.source).split("\n")
        indented = "".join(f"\n  {line}" for line in lines)
        comments["boundaries"] = f"{first}, and the {{}} after objects:{indented}"
    percepts = Percepts(
        rgb=rgb, labels=np.zeros(rgb.shape[:2], np.uint16), coverage=nothing, background=rgb, clean=None
    )
    return PerceivedScene(percepts, document, comments, HEADER)


def _rounded(labels: NDArray[np.uint16], things: Sequence[PhotoObject]) -> NDArray[np.uint16]:
    """Masks of round things made as round as they are: what leaked out is given back, what was missed is taken in."""
    result = labels.copy()
    for thing in things:
        if isinstance(thing.outline, Disc):
            inside = raster.coverage(thing.outline, (labels.shape[1], labels.shape[0])) >= 0.5
            result[(labels == thing.id) & ~inside] = 0
            result[(result == 0) & inside] = thing.id
    return result


def _world(setting: BoundaryGuess, pixels_per_meter: float, shadows: Shadows) -> dict[str, Any]:
    world: dict[str, Any] = {"view": setting.view.value, "pixels_per_meter": pixels_per_meter}
    if setting.view is View.TOP:
        world["table"] = {"friction": 0}
    return world | {"duration": 2.0} | remarks.view_entry(shadows, setting.view is View.SIDE)


def _light(guess: LightGuess, shadows: Shadows) -> dict[str, Any]:
    if shadows.clean is None:
        return remarks.light_entry(guess.light) | {"from": remarks.provenance("shading", guess.confidence)}
    said = remarks.provenance("shadows", shadows.confidence)
    return remarks.light_entry(shadows.light) | {"softness": shadows.softness, "from": said}


# ----------------------------------------------------------------------
# A large photo and what is known of it -> the same at a size that a video can have.

LONGEST_SIDE = 1600
"""px, unless told: more than most screens show of a clip, and perception takes seconds."""


def shrink_photo(rgb: Rgb, side: int) -> Rgb:
    """The photo (H, W, 3) with its longer side at most `side` px; itself where it is no larger.

    Averaged over areas in linear light, as a camera of fewer pixels would have seen it.
    """
    height, width = rgb.shape[:2]
    scale = side / max(height, width)
    if scale >= 1:
        return rgb
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    light = (decode(np.arange(256, dtype=np.uint8)) * np.float32(65535) + np.float32(0.5)).astype(np.uint16)
    small = np.empty((size[1], size[0], 3), np.uint8)
    for c in range(3):  # one by one: the light of a large photo is twice its size
        mean = cv2.resize(cv2.LUT(cv2.extractChannel(rgb, c), light), size, interpolation=cv2.INTER_AREA)
        small[:, :, c] = encode_u8(mean.astype(np.float32) / np.float32(65535))
    return small


def shrink_detections(found: Detections, full: tuple[int, int], rgb: Rgb) -> Detections:
    """Objects marked on the photo of `full` width and height, px, on the smaller `rgb`; others stay as they are."""
    size = (rgb.shape[1], rgb.shape[0])
    if size == full or found.labels.shape != full[::-1]:
        return found
    labels = cv2.resize(found.labels, size, interpolation=cv2.INTER_NEAREST_EXACT)
    return replace(found, labels=np.asarray(labels, np.uint16))
