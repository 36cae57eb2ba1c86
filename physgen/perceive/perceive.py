"""Photo to percepts and scene document: the stages of perception in order. photo ->
segment -> label -> physics -> boundary -> normals -> intrinsic -> light -> matte ->
shadow -> inpaint

Each stage is a role, and a backend fills the role (`physgen.perceive.roles`,
`physgen.registry`). `write_scene` in `physgen.perceive.document` writes the result: a
scene file and its assets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from physgen.geometry.polygon import Outline
from physgen.geometry.scale import (
    Scale,
    assumed_scale,
    scale_entry,
    slow_motion,
    slow_motion_comment,
)
from physgen.maps import F32, Percepts
from physgen.messages import Message
from physgen.perceive import document, naming, shape_entries
from physgen.perceive.bites import fill_bites
from physgen.perceive.ground_lobes import detach_ground
from physgen.perceive.hidden_parts import continue_outlines
from physgen.perceive.inpaint.outgrowths import attach_outgrowths
from physgen.perceive.lower_rims import refine_lower_rims
from physgen.perceive.part_joints import close_part_joints
from physgen.perceive.perception_run import ROLES, PerceptionRun, nearest_labels
from physgen.perceive.photo_objects import (
    attach_loose_parts,
    fit_objects,
    outline_as_named,
    remain_problem,
    replace_by_discs,
)
from physgen.perceive.photo_size import check_size
from physgen.perceive.remains import Remain, attach_remains, find_remains
from physgen.perceive.roles import (
    BoundaryGuess,
    Detections,
    Intrinsics,
    Labels,
    LightGuess,
    Matter,
    PerceivedScene,
    PhotoObject,
    Rgb,
    Scenery,
    Shadows,
    Suitability,
)
from physgen.perceive.shadow.backgrounds import (
    Backgrounds,
    Surroundings,
    find_scenery,
)
from physgen.perceive.support.viewpoint import judge_suitability
from physgen.perceive.wheels import Vehicle, find_vehicles
from physgen.problems import Place, Problem
from physgen.progress import Progress, silent
from physgen.registry import Backends
from physgen.scene.scene import View
from physgen.text import listed

POINT = "mark them with --masks FILE, --box x,y,w,h or --point x,y"


@dataclass(frozen=True)
class KnownFacts:
    """Facts known before perception; None is estimated."""

    view: BoundaryGuess | None = None
    pixels_per_meter: float | None = None
    """px/m: the photo's true scale."""


NOTHING_KNOWN = KnownFacts()


@dataclass(frozen=True)
class _SceneEstimate:
    """Estimates about the objects, the scene and its light."""

    objects: Sequence[PhotoObject]
    names: naming.Names
    wholes: Mapping[int, Outline]
    """Outlines with their hidden parts, by id."""
    matter: Mapping[int, Matter]
    scale: Scale | None
    boundaries: BoundaryGuess
    depth: F32 | None
    normals: F32
    intrinsics: Intrinsics
    light: LightGuess


def perceive(
    rgb: Rgb,
    detections: Detections | None = None,
    *,
    renames: Sequence[str] = (),
    backends: Backends | None = None,
    nouns: Sequence[str] = (),
    facts: KnownFacts = NOTHING_KNOWN,
    progress: Progress = silent,
    meanwhile: Callable[[PerceivedScene], PerceivedScene] = lambda scene: scene,
) -> PerceivedScene:
    """Perceive a photo; segment it if `detections` is None.

    `renames` are `NAME=TEXT`: NAME is an object's name without renaming, its mask id,
    or a pattern (`ball-*`). `backends` fill the roles; `nouns` are for segmenters
    that take nouns; known `facts` are not estimated. `meanwhile` completes the scene
    while its backgrounds are computed, so that the scene passed to it has no
    backgrounds yet. Raises InputError if no scene is possible.
    """
    check_size(rgb)
    run = PerceptionRun(rgb, backends or Backends(), progress)
    if detections is None:
        segmentation = _segment_photo(run, nouns, facts.view)
    else:
        segmentation = _Segmentation(detections)
    objects, speck_count = fit_objects(rgb, segmentation.detections)
    if not objects:
        # Without objects, every rename is an error.
        naming.relabel_objects(objects, renames, {})
        scene = _empty_scene(rgb, segmentation.detections, facts)
        return run.sign(meanwhile(scene))
    detections = _extend_to_discs(segmentation.detections, objects)
    filled_labels = _labels_to_fill(detections)
    # The matte and the fill run in a second thread, beside stages without need for
    # them.
    with ThreadPoolExecutor(1) as executor:
        cutting = None
        if run.core("matte"):
            cutting = executor.submit(run.cut_out, filled_labels)
        estimate = _estimate_scene(
            run, detections, objects, renames, facts, segmentation.scenery
        )
        if cutting:
            surroundings = cutting.result()
        else:
            surroundings = run.cut_out(filled_labels)
        shadows = _find_shadows(run, detections, estimate, surroundings)
        run.progress("inpaint", ROLES.index("inpaint"), len(ROLES))
        filling = executor.submit(
            _fill_background,
            run,
            detections,
            estimate,
            surroundings,
            shadows,
            filled_labels,
        )
        draft = _draft_scene(
            run,
            detections,
            estimate,
            surroundings,
            shadows,
            facts,
            speck_count,
            segmentation.doubtful_parts,
        )
        # The caller completes the scene while the fill runs.
        draft = meanwhile(draft)
        backgrounds = filling.result()
        scene = _with_backgrounds(
            run, draft, detections, estimate, surroundings, backgrounds, shadows
        )
        run.crew.release("inpaint")
        return run.sign(scene)


@dataclass(frozen=True)
class _Segmentation:
    """The objects of a photo, and other results of its segmentation."""

    detections: Detections
    scenery: Scenery | None = None
    doubtful_parts: Sequence[Remain] = ()


def _segment_photo(
    run: PerceptionRun, nouns: Sequence[str], view: BoundaryGuess | None
) -> _Segmentation:
    """Segment a photo."""
    detections, scenery = run.detect(nouns)
    ids = []
    for i in np.unique(detections.labels):
        if i > 0:
            ids.append(int(i))
    # Thin parts and rims missed by the segmenter would stay behind when their
    # object moves.
    remains = find_remains(run.rgb, detections.labels, ids)
    labels, doubtful_parts = attach_remains(detections.labels, remains)
    labels = attach_outgrowths(run.rgb, labels)
    # Models of the extras draw finer masks than the network that fills bites.
    if run.core("segment"):
        filled_labels = fill_bites(run.rgb, labels)
        bites = filled_labels != labels
        labels = detach_ground(run.rgb, filled_labels)
        labels = refine_lower_rims(run.rgb, labels, bites)
    labels = close_part_joints(detections.labels, labels)
    detections = replace(detections, labels=labels)
    detections = attach_loose_parts(run.rgb, detections, view)
    return _Segmentation(detections, scenery, doubtful_parts)


def _extend_to_discs(
    detections: Detections, objects: Sequence[PhotoObject]
) -> Detections:
    """Return the detections, with masks of round objects extended to their discs.

    Masks of the user stay.
    """
    if detections.source == "given":
        return detections
    new_objects = []
    for item in objects:
        if item.id not in detections.mask_sources:
            new_objects.append(item)
    labels = replace_by_discs(detections.labels, new_objects)
    return replace(detections, labels=labels)


def _labels_to_fill(detections: Detections) -> Labels:
    """Return the ids (H, W) of objects and of regions that the user deleted."""
    if detections.removed_pixels is None:
        return detections.labels
    return np.where(detections.labels > 0, detections.labels, detections.removed_pixels)


def _estimate_scene(
    run: PerceptionRun,
    detections: Detections,
    objects: Sequence[PhotoObject],
    renames: Sequence[str],
    facts: KnownFacts,
    scenery: Scenery | None,
) -> _SceneEstimate:
    """Estimate labels, matter, boundaries, maps and light."""
    rgb = run.rgb
    labels = detections.labels
    # Labels decide about outlines, materials and sizes, so they come first.
    names = run.name(detections, objects, renames)
    outlined_objects = outline_as_named(rgb, labels, names.objects)
    outlined_objects, wholes = continue_outlines(labels, outlined_objects)
    names = replace(names, objects=outlined_objects)
    matter, scale = run.weigh(names, facts.pixels_per_meter)
    boundaries, depth, normals = run.find_boundaries(
        detections, names.objects, facts.view, scenery
    )
    objects = []
    for item in names.objects:
        outline = boundaries.outlines.get(item.id, item.outline)
        objects.append(replace(item, outline=outline))
    # The default normals depend on the boundaries, so they are computed again.
    if normals is None or run.core("normals"):
        normals = run.role("normals", rgb, labels, objects, boundaries)
    run.crew.release("normals")
    intrinsics: Intrinsics = run.role("intrinsic", rgb, labels, normals)
    light: LightGuess = run.role("light", rgb, labels, objects, normals, intrinsics)
    return _SceneEstimate(
        objects=objects,
        names=names,
        wholes=wholes,
        matter=matter,
        scale=scale,
        boundaries=boundaries,
        depth=depth,
        normals=normals,
        intrinsics=intrinsics,
        light=light,
    )


def _find_shadows(
    run: PerceptionRun,
    detections: Detections,
    estimate: _SceneEstimate,
    surroundings: Surroundings,
) -> Shadows:
    """Find the shadows of the objects, and their light."""
    shadows: Shadows = run.role(
        "shadow",
        surroundings.guess,
        surroundings.coverage,
        detections.labels,
        estimate.objects,
        estimate.matter,
        estimate.boundaries,
        estimate.light,
    )
    return shadows


def _fill_background(
    run: PerceptionRun,
    detections: Detections,
    estimate: _SceneEstimate,
    surroundings: Surroundings,
    shadows: Shadows,
    filled_labels: Labels,
) -> Backgrounds:
    """Fill the background behind all objects and deleted regions."""
    # Only floors seen from the side mirror the objects on them.
    is_side = estimate.boundaries.view is View.SIDE
    standing_labels = None
    if is_side:
        standing_labels = detections.labels
    # Objects cut off by the border do not move: they are scenery for the others.
    cut_ids = []
    for item in estimate.objects:
        if item.cut:
            cut_ids.append(item.id)
    fixed_ids = find_scenery(filled_labels, cut_ids)
    nearest_mask = nearest_labels(filled_labels, fixed_ids)
    scenery_mask = nearest_mask & (surroundings.coverage > 0)
    return run.fill(surroundings, shadows, standing_labels, scenery_mask)


def _with_backgrounds(
    run: PerceptionRun,
    draft: PerceivedScene,
    detections: Detections,
    estimate: _SceneEstimate,
    surroundings: Surroundings,
    backgrounds: Backgrounds,
    shadows: Shadows,
) -> PerceivedScene:
    """Return the scene with its backgrounds."""
    clean_background = backgrounds.clean_picture
    owners = shadows.owners
    if estimate.boundaries.view is View.SIDE:
        # Mirror images are removed last, from the filled background.
        standing_ids = []
        for item in estimate.objects:
            if item.id not in estimate.boundaries.held_ids:
                standing_ids.append(item.id)
        clean_background, owners = run.without_mirror_images(
            backgrounds,
            shadows,
            detections.labels,
            surroundings.coverage,
            standing_ids,
        )
    percepts = replace(
        draft.percepts,
        background=backgrounds.shaded_picture,
        clean=clean_background,
        shadows=owners,
    )
    return replace(draft, percepts=percepts)


def _draft_scene(
    run: PerceptionRun,
    detections: Detections,
    estimate: _SceneEstimate,
    surroundings: Surroundings,
    shadows: Shadows,
    facts: KnownFacts,
    speck_count: int,
    doubtful_parts: Sequence[Remain],
) -> PerceivedScene:
    """Return the scene without backgrounds."""
    boundaries = estimate.boundaries
    objects = estimate.objects
    labels, doubtful, doubt_reasons = document.with_doubtful(
        detections.labels, detections.doubtful
    )
    names_by_id = _name_objects(detections, estimate)
    entries, comments = _object_entries(run, detections, estimate, names_by_id)
    side = max(run.rgb.shape[:2])
    per_meter, comments["world.pixels_per_meter"] = scale_entry(
        side, facts.pixels_per_meter, estimate.scale
    )
    scene: dict[str, Any] = {
        "physgen": 1,
        "image": "photo.png",
        "assets": "photo.assets",
        "world": _world(boundaries, per_meter, shadows),
        "objects": entries,
        "boundaries": {w.name: shape_entries.wall_entry(w) for w in boundaries.walls},
    }
    if doubtful:
        scene["doubtful"] = doubtful
    scene["light"] = _light(estimate.light, shadows)
    scene["render"], render_comments = _render_settings(
        boundaries.view, scene["light"], slow_motion(side, per_meter)
    )
    comments |= render_comments
    comments |= document.scene_comments(detections, objects, speck_count, boundaries)
    comments |= doubt_reasons
    percepts = Percepts(
        rgb=run.rgb,
        labels=labels,
        coverage=surroundings.coverage,
        shadows=shadows.owners,
        depth=estimate.depth,
        normals=estimate.normals,
        albedo=estimate.intrinsics.albedo,
        shading=estimate.intrinsics.shading,
    )
    return PerceivedScene(
        percepts,
        scene,
        comments,
        _scene_warnings(estimate, names_by_id, doubtful_parts),
        (),
        judge_suitability(run.rgb, detections, objects, boundaries),
        document.provenance(boundaries.reason, boundaries.confidence),
        wholes=estimate.wholes,
    )


def _name_objects(detections: Detections, estimate: _SceneEstimate) -> dict[int, str]:
    """Return the names of the objects by id.

    Names in an existing scene stay, except for objects with a new label.
    """
    kept_names = {}
    for i, name in estimate.names.before.items():
        if i in detections.object_names or i not in estimate.names.renamed_ids:
            kept_names[i] = name
    return naming.object_names(estimate.objects, kept_names)


def _object_entries(
    run: PerceptionRun,
    detections: Detections,
    estimate: _SceneEstimate,
    names_by_id: Mapping[int, str],
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the entries of the objects, and the comments by dotted path."""
    names = estimate.names
    boundaries = estimate.boundaries
    vehicles: Mapping[int, Vehicle] = {}
    if boundaries.view is View.SIDE:
        vehicles = find_vehicles(
            run.rgb,
            detections.labels,
            estimate.objects,
            names.labels,
            boundaries.walls,
        )
    return document.object_entries(
        detections,
        estimate.objects,
        names_by_id,
        estimate.matter,
        boundaries,
        document.ObjectLabels(names.labels, names.sources),
        run.crew.name("physics"),
        vehicles,
    )


def _render_settings(
    view: View, light: Mapping[str, Any], slow: float
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return `render:` of a new scene, and the comments by dotted path.

    `slow` is the slow motion of the clip. Clips of small objects at true scale would last
    a fraction of a second.
    """
    settings: dict[str, Any] = {}
    comments = {}
    if slow > 1:
        settings["slow"] = slow
        comments["render"] = slow_motion_comment(slow)
    settings |= {
        "motion_blur": document.MOTION_BLUR,
        "grain": "match",
        "hold": document.HOLD,
        "contact_shade": True,
        "squash": True,
        "sound": True,
    }
    if view is View.SIDE and light["direction"][1] > 0:
        settings["relight"] = False
        comments["render.relight"] = (
            "unsure: the light seems to come from below, which is unlikely"
        )
    return settings, comments


def _scene_warnings(
    estimate: _SceneEstimate,
    names_by_id: Mapping[int, str],
    doubtful_parts: Sequence[Remain],
) -> tuple[Problem, ...]:
    """Return warnings of unknown labels, doubtful parts of objects and new names."""
    names = estimate.names
    warnings: list[Problem] = []
    for item in estimate.objects:
        if item.id in names.renamed_ids:
            problem = naming.unknown_label(item.label)
            # One label gives one warning, not one for each object.
            if problem and problem not in warnings:
                warnings.append(problem)
    for part in doubtful_parts:
        if part.owner in names_by_id:
            warnings.append(remain_problem(part, names_by_id[part.owner]))
    changes = []
    for i, name in names_by_id.items():
        if names.before[i] != name:
            changes.append(f"{names.before[i]} is {name}")
    if changes:
        message = Message.NAMES_FOLLOW_LABELS
        text = listed(changes, "and")
        warnings.append(message.warning(Place("--label"), "", text))
    return tuple(warnings)


def _empty_scene(rgb: Rgb, detections: Detections, facts: KnownFacts) -> PerceivedScene:
    """Return a scene without objects: the unchanged photo."""
    pixels_per_meter = facts.pixels_per_meter or assumed_scale(max(rgb.shape[:2]))
    scene: dict[str, Any] = {
        "physgen": 1, "image": "photo.png", "assets": "photo.assets",
        "world": {
            "view": View.SIDE.value, "pixels_per_meter": pixels_per_meter,
        },
        "objects": {}, "boundaries": {},
    }  # fmt: skip
    comments = {
        "objects": f"no region of the photo looks like a whole object that could be moved; {POINT}"
    }
    labels, scene["doubtful"], reasons = document.with_doubtful(
        np.zeros(rgb.shape[:2], np.uint16), detections.doubtful
    )
    comments |= reasons
    no_coverage = np.zeros(labels.shape, np.float32)
    percepts = Percepts(
        rgb=rgb, labels=labels, coverage=no_coverage, background=rgb, clean=None
    )
    suits = Suitability(("no sure objects",))
    return PerceivedScene(percepts, scene, comments, suitability=suits)


def _world(
    boundaries: BoundaryGuess, pixels_per_meter: float, shadows: Shadows
) -> dict[str, Any]:
    per_meter = shape_entries.short(pixels_per_meter)
    world: dict[str, Any] = {
        "view": boundaries.view.value,
        "pixels_per_meter": per_meter,
        "duration": "auto",
    }
    if boundaries.view is View.TOP:
        world["table"] = dict(document.TABLE)
    is_side = boundaries.view is View.SIDE
    if is_side and boundaries.tilt is not None:
        world["tilt"] = boundaries.tilt
    return world | shape_entries.view_entry(shadows, is_side)


def _light(guess: LightGuess, shadows: Shadows) -> dict[str, Any]:
    if shadows.clean_background is None:
        source = document.provenance("shading", guess.confidence)
        return shape_entries.light_entry(guess.light) | {"from": source}
    source = document.provenance("shadows", shadows.confidence)
    softness = shape_entries.short(shadows.softness)
    return shape_entries.light_entry(shadows.light) | {
        "softness": softness,
        "from": source,
    }
