"""Photo to percepts and scene document: the stages of perception in order. photo ->
segment -> label -> physics -> boundary -> normals -> intrinsic -> light -> matte ->
shadow -> inpaint

Each stage is a role, and a backend fills the role (`physgen.perceive.roles`,
`physgen.registry`). `write_scene` in `physgen.perceive.document` writes the result: a
scene file and its assets.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from physgen.geometry.scale import (
    assumed_scale,
    scale_entry,
    slow_motion,
    slow_motion_comment,
)
from physgen.maps import Percepts
from physgen.messages import Message
from physgen.perceive import document, naming, shape_entries
from physgen.perceive.hidden_parts import continue_outlines
from physgen.perceive.inpaint.outgrowths import attach_outgrowths
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
    LightGuess,
    PerceivedScene,
    Rgb,
    Scenery,
    Shadows,
    Suitability,
)
from physgen.perceive.shadow.backgrounds import (
    find_scenery,
)
from physgen.perceive.support.viewpoint import judge_suitability
from physgen.perceive.wheels import find_vehicles
from physgen.problems import Place
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


def perceive(
    rgb: Rgb,
    found: Detections | None = None,
    *,
    renames: Sequence[str] = (),
    crew: Backends | None = None,
    asked: Sequence[str] = (),
    known: KnownFacts = NOTHING_KNOWN,
    progress: Progress = silent,
    meanwhile: Callable[[PerceivedScene], PerceivedScene] = lambda scene: scene,
) -> PerceivedScene:
    """Perceive a photo; segment it if `found` is None.

    `renames` are `NAME=TEXT`: NAME is an object's name without renaming, its mask id,
    or a pattern (`ball-*`). `crew` fills the roles; `asked` are nouns for segmenters
    that take nouns; `known` facts are not estimated. `meanwhile` completes the scene
    while its backgrounds are computed, so that the scene passed to it has no
    backgrounds yet. Raises InputError if no scene is possible.
    """
    check_size(rgb)
    view, pixels_per_meter = known.view, known.pixels_per_meter
    run = PerceptionRun(rgb, crew or Backends(), progress)
    scenery: Scenery | None = None
    doubtful_parts: Sequence[Remain] = ()
    if found is None:
        found, scenery = run.detect(asked)
        ids = [int(i) for i in np.unique(found.labels) if i > 0]
        # Thin parts and rims missed by the segmenter would stay behind when their
        # object moves.
        extended_labels, doubtful_parts = attach_remains(
            found.labels, find_remains(rgb, found.labels, ids)
        )
        extended_labels = attach_outgrowths(rgb, extended_labels)
        found = replace(found, labels=extended_labels)
        found = attach_loose_parts(rgb, found, view)
    objects, specks = fit_objects(rgb, found)
    if not objects:
        naming.relabel_objects(objects, renames, {})
        return run.signed(meanwhile(_empty_scene(rgb, found, pixels_per_meter)))
    if found.source != "given":
        new = [item for item in objects if item.id not in found.mask_sources]
        found = replace(found, labels=replace_by_discs(found.labels, new))
    # Regions deleted by the user are filled like objects.
    filled_labels = (
        found.labels
        if found.gone is None
        else np.where(found.labels > 0, found.labels, found.gone)
    )
    # The matte and the fill run in a second thread, beside stages without need for
    # them.
    with ThreadPoolExecutor(1) as executor:
        is_core = run.core("matte")
        cutting = executor.submit(run.cut_out, filled_labels) if is_core else None
        # Labels decide about outlines, materials and sizes, so they come first.
        names = run.name(found, objects, renames)
        outlined_objects = outline_as_named(rgb, found.labels, names.objects)
        outlined_objects, wholes = continue_outlines(found.labels, outlined_objects)
        names = replace(names, objects=outlined_objects)
        matter, scale = run.weigh(names, pixels_per_meter)
        boundaries, depth, normals = run.find_boundaries(
            found, names.objects, view, scenery
        )
        objects = [
            replace(t, outline=boundaries.outlines.get(t.id, t.outline))
            for t in names.objects
        ]
        # The default normals depend on the boundaries, so they are computed again.
        if normals is None or run.core("normals"):
            normals = run.role("normals", rgb, found.labels, objects, boundaries)
        run.crew.release("normals")
        intrinsics: Intrinsics = run.role("intrinsic", rgb, found.labels, normals)
        light: LightGuess = run.role(
            "light", rgb, found.labels, objects, normals, intrinsics
        )
        surroundings = cutting.result() if cutting else run.cut_out(filled_labels)
        coverage = surroundings.coverage
        shadows: Shadows = run.role(
            "shadow",
            surroundings.guess,
            coverage,
            found.labels,
            objects,
            matter,
            boundaries,
            light,
        )
        # Only floors seen from the side mirror the objects on them.
        standing = found.labels if boundaries.view is View.SIDE else None
        run.progress("inpaint", ROLES.index("inpaint"), len(ROLES))
        # Objects cut off by the border do not move: they are scenery for the others.
        cut = [item.id for item in objects if item.cut]
        fixed_ids = find_scenery(filled_labels, cut)
        scenery_mask = nearest_labels(filled_labels, fixed_ids) & (coverage > 0)
        filling = executor.submit(
            run.fill, surroundings, shadows, standing, scenery_mask
        )
        labels, doubtful, reasons = document.with_doubtful(found.labels, found.doubtful)
        # Names in an existing scene stay, except for objects with a new label.
        kept_names = {
            i: n
            for i, n in names.before.items()
            if i in found.object_names or i not in names.renamed
        }
        names_by_id = naming.object_names(objects, kept_names)
        vehicles = (
            find_vehicles(rgb, found.labels, objects, names.labels, boundaries.walls)
            if boundaries.view is View.SIDE
            else {}
        )
        entries, comments = document.object_entries(
            found,
            objects,
            names_by_id,
            matter,
            boundaries,
            document.ObjectLabels(names.labels, names.sources),
            run.crew.name("physics"),
            vehicles,
        )
        side = max(rgb.shape[:2])
        per_meter, comments["world.pixels_per_meter"] = scale_entry(
            side, pixels_per_meter, scale
        )
        scene: dict[str, Any] = {
            "physgen": 1,
            "image": "photo.png",
            "assets": "photo.assets",
            "world": _world(boundaries, per_meter, shadows),
            "objects": entries,
            "boundaries": {
                w.name: shape_entries.wall_entry(w) for w in boundaries.walls
            },
            **({"doubtful": doubtful} if doubtful else {}),
            "light": _light(light, shadows),
        }
        slow = slow_motion(side, per_meter)
        # Clips of small objects at true scale would last a fraction of a second: slow
        # them down.
        scene["render"] = ({"slow": slow} if slow > 1 else {}) | {
            "motion_blur": document.MOTION_BLUR,
            "grain": "match",
            "hold": document.HOLD,
            "contact_shade": True,
            "squash": True,
            "sound": True,
        }
        if boundaries.view is View.SIDE and scene["light"]["direction"][1] > 0:
            scene["render"]["relight"] = False
            comments["render.relight"] = (
                "unsure: the light seems to come from below, which is unlikely"
            )
        if slow > 1:
            comments["render"] = slow_motion_comment(slow)
        comments |= document.scene_comments(found, objects, specks, boundaries)
        comments |= reasons
        unknown = (
            naming.unknown_label(t.label) for t in objects if t.id in names.renamed
        )
        # A label missing in the material table gives one warning, not one per object.
        warnings = tuple(dict.fromkeys(problem for problem in unknown if problem))
        warnings += tuple(
            remain_problem(remain, names_by_id[remain.owner])
            for remain in doubtful_parts
            if remain.owner in names_by_id
        )
        if changes := [
            f"{names.before[i]} is {name}"
            for i, name in names_by_id.items()
            if names.before[i] != name
        ]:
            warnings += (
                Message.NAMES_FOLLOW_LABELS.warning(
                    Place("--label"), "", listed(changes, "and")
                ),
            )
        suits = judge_suitability(rgb, found, objects, boundaries)
        percepts = Percepts(
            rgb=rgb, labels=labels, coverage=coverage, shadows=shadows.owners,
            depth=depth, normals=normals, albedo=intrinsics.albedo, shading=intrinsics.shading,
        )  # fmt: skip
        reason = document.provenance(boundaries.reason, boundaries.confidence)
        # The caller completes the scene while the fill runs.
        scene_draft = meanwhile(
            PerceivedScene(
                percepts, scene, comments, warnings, (), suits, reason, wholes=wholes
            )
        )
        backgrounds = filling.result()
        clean_background, owners = backgrounds.clean, shadows.owners
        if boundaries.view is View.SIDE:
            # Mirror images are removed last, from the filled background.
            standing_ids = [t.id for t in objects if t.id not in boundaries.held]
            clean_background, owners = run.without_mirror_images(
                backgrounds, shadows, found.labels, coverage, standing_ids
            )
        run.crew.release("inpaint")
        percepts = replace(
            scene_draft.percepts,
            background=backgrounds.shaded,
            clean=clean_background,
            shadows=owners,
        )
        return run.signed(replace(scene_draft, percepts=percepts))


def _empty_scene(
    rgb: Rgb, found: Detections, pixels_per_meter: float | None
) -> PerceivedScene:
    """Return a scene without objects: the unchanged photo."""
    scene: dict[str, Any] = {
        "physgen": 1, "image": "photo.png", "assets": "photo.assets",
        "world": {
            "view": View.SIDE.value, "pixels_per_meter": pixels_per_meter or assumed_scale(max(rgb.shape[:2])),
        },
        "objects": {}, "boundaries": {},
    }  # fmt: skip
    comments = {
        "objects": f"no region of the photo looks like a whole object that could be moved; {POINT}"
    }
    labels, scene["doubtful"], reasons = document.with_doubtful(
        np.zeros(rgb.shape[:2], np.uint16), found.doubtful
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
    if shadows.clean is None:
        source = document.provenance("shading", guess.confidence)
        return shape_entries.light_entry(guess.light) | {"from": source}
    source = document.provenance("shadows", shadows.confidence)
    softness = shape_entries.short(shadows.softness)
    return shape_entries.light_entry(shadows.light) | {
        "softness": softness,
        "from": source,
    }
