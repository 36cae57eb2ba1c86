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
from functools import partial
from math import exp
from typing import Any

import cv2
import numpy as np

from physgen.geometry import raster
from physgen.geometry.fitting import disc_iou, fit_outlines
from physgen.geometry.polygon import Disc, bounds
from physgen.geometry.scale import (
    LIMITS,
    MIN_SCALE_CONFIDENCE,
    Scale,
    assumed_scale,
    box_sides,
    photo_scale,
    scale_entry,
    slow_motion,
    slow_motion_comment,
)
from physgen.maps import F32, Percepts
from physgen.materials import kind
from physgen.messages import Message
from physgen.perceive import document
from physgen.perceive.contents import attach_contents
from physgen.perceive.hanging_parts import attach_hanging_parts
from physgen.perceive.hidden_parts import continue_outlines
from physgen.perceive.inpaint.outgrowths import attach_outgrowths
from physgen.perceive.remains import Remain, attach_remains, find_remains
from physgen.perceive.roles import (
    SMALLEST_OBJECT,
    BoundaryGuess,
    Detections,
    Intrinsics,
    Labels,
    LightGuess,
    Mask,
    Matter,
    Name,
    PerceivedScene,
    PhotoObject,
    Rgb,
    Scenery,
    Shadows,
    Suitability,
)
from physgen.perceive.segment.network import run_network
from physgen.perceive.segment.plain_ground import shows_ground_beyond
from physgen.perceive.segment.prompts import Segmenter
from physgen.perceive.shadow.backgrounds import (
    Backgrounds,
    Surroundings,
    fill_backgrounds,
    fill_before_scenery,
    find_scenery,
    find_surroundings,
)
from physgen.perceive.shadow.mirror_images import remove_mirror_images
from physgen.perceive.shadow.shadow_removal import remove_reflections
from physgen.perceive.spheres import has_round_form, is_shaded_as_sphere
from physgen.perceive.support.view_classifier import view_chances
from physgen.perceive.support.viewpoint import judge_suitability
from physgen.perceive.wheels import find_vehicles
from physgen.photometry import decode, encode_u8
from physgen.problems import THIS_PHOTO, Place, Problem
from physgen.progress import Progress, silent
from physgen.registry import Backends
from physgen.scene.scene import View
from physgen.text import listed

UNKNOWN = BoundaryGuess(View.SIDE, 0.0, "", ())
"""The boundaries before the boundary stage."""
POINT = "mark them with --masks FILE, --box x,y,w,h or --point x,y"
# Limits of a label map: ids if most of them are specks, and objects in any case.
MOST_IDS, MOST_OBJECTS = (200, 5000)
EXACTLY_ROUND = 0.975
"""Least IoU of a mask with its circle for a disc of any label: a wheel, a lid.

In COCO's photos a clock reaches 0.90, a pizza 0.93, a cup 0.96.
"""
# Least IoU of a mask with its circle for its replacement; balls have 0.96.
NEARLY_ROUND = 0.93
# px; the shadow search computes slopes at a coarse scale.
SMALLEST_SIDE = 8
# px, by default: more than most screens show, and perception still takes seconds.
LONGEST_SIDE = 1600
ROLES = (
    "categories", "segment", "label", "physics", "depth", "boundary", "normals", "intrinsic", "light", "matte",
    "shadow", "inpaint",
)  # fmt: skip
"""The roles in their order of execution."""
KEPT = ("inpaint", "normals", "label")
"""Roles with a late release, because they are called again or share a model with the
next role.
"""


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
    run = _Run(rgb, crew or Backends(), progress)
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
        found = _with_loose_parts(rgb, found, view)
    objects, specks = fit_objects(rgb, found)
    if not objects:
        document.relabel_objects(objects, renames, {})
        return run.signed(meanwhile(_empty_scene(rgb, found, pixels_per_meter)))
    if found.source != "given":
        new = [item for item in objects if item.id not in found.mask_sources]
        found = replace(found, labels=_replace_by_discs(found.labels, new))
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
        names_by_id = document.object_names(objects, kept_names)
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
            "boundaries": {w.name: document.wall_entry(w) for w in boundaries.walls},
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
            document.unknown_label(t.label) for t in objects if t.id in names.renamed
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


def _owners_beside_mirrors(shadows: Shadows, labels: Labels) -> Labels | None:
    """Return the owners of shadows for a clean background without mirror images.

    An empty map says that the background still contains its shadows.
    """
    if shadows.clean is None and shadows.owners is None:
        return np.zeros_like(labels)
    return shadows.owners


def check_size(rgb: Rgb, file: str = "the photo") -> None:
    """Raise InputError if a photo is too small."""
    if min(rgb.shape[:2]) < SMALLEST_SIDE:
        found_size = f"{rgb.shape[1]} x {rgb.shape[0]} px"
        raise Message.PHOTO_TOO_SMALL.error(file, found_size, least=SMALLEST_SIDE)


@dataclass(frozen=True)
class _Run:
    """A photo, the backends that perceive it, and the stages with more than one
    call.
    """

    rgb: Rgb
    crew: Backends
    progress: Progress

    def role(self, name: str, *arguments: Any, **extra: Any) -> Any:
        """Run one role and return its result."""
        self.progress(name, ROLES.index(name), len(ROLES))
        result = self.crew.call(name, *arguments, **extra)
        if name not in KEPT:
            self.crew.release(name)
        return result

    def core(self, *roles: str) -> bool:
        """Return whether none of the roles is filled by a model of the extras.

        Such a model may need the whole memory, so that nothing runs beside it.
        """
        return all(self.crew.row(role).extra is None for role in roles)

    def cut_out(self, labels: Labels) -> Surroundings:
        """Return the photo without the objects, with an estimate behind them."""
        coverage: F32 = self.crew.call("matte", self.rgb, labels)
        self.crew.release("matte")
        return find_surroundings(self.rgb, coverage)

    def fill(
        self,
        around: Surroundings,
        shadows: Shadows,
        standing: Labels | None,
        scenery_mask: Mask,
    ) -> Backgrounds:
        """Fill the background behind the objects; those of `scenery_mask` come last.

        If no shadows are removed, reflections of objects `standing` on a floor are
        removed as well.
        """
        inpaint = partial(self.crew.call, "inpaint")
        has_movable = ((around.coverage > 0) & ~scenery_mask).any()
        if has_movable and scenery_mask.any():
            backgrounds = fill_before_scenery(around, scenery_mask, shadows, inpaint)
        else:
            backgrounds = fill_backgrounds(around, shadows, inpaint)
        if backgrounds.clean is None or shadows.faint or standing is None:
            return backgrounds
        # Scenery stays in the picture, and so do its reflections.
        movable = np.where(scenery_mask, np.uint16(0), standing)
        coverage = np.where(scenery_mask, np.float32(0), around.coverage)
        clean_background = remove_reflections(
            backgrounds.clean, movable, coverage, inpaint
        )
        return replace(backgrounds, clean=clean_background)

    def without_mirror_images(
        self,
        backgrounds: Backgrounds,
        shadows: Shadows,
        labels: Labels,
        coverage: F32,
        ids: Sequence[int],
    ) -> tuple[Rgb | None, Labels | None]:
        """Return the clean background without mirror images of objects, and the owners
        of its shadows.

        Without mirror images in the photo, both stay as they are.
        """
        inpaint = partial(self.crew.call, "inpaint")
        visible = backgrounds.shaded if backgrounds.clean is None else backgrounds.clean
        mirrorless = remove_mirror_images(
            self.rgb, visible, labels, coverage, ids, inpaint
        )
        if mirrorless is None:
            return backgrounds.clean, shadows.owners
        return mirrorless, _owners_beside_mirrors(shadows, labels)

    def detect(self, nouns: Sequence[str]) -> tuple[Detections, Scenery | None]:
        """Segment the photo into detections and scenery."""
        self.progress("segment", ROLES.index("segment"), len(ROLES))
        segments = Segmenter(self.crew, nouns)(self.rgb)
        self.crew.release("segment")
        confidences = {k + 1: float(c) for k, c in enumerate(segments.confidence)}
        backend_name = self.crew.name("segment")
        detections = Detections(
            segments.labels,
            backend_name,
            confidences,
            segments.names,
            doubtful=segments.doubtful,
            named_by=backend_name,
        )
        return detections, segments.scenery

    def name(
        self, found: Detections, objects: Sequence[PhotoObject], renames: Sequence[str]
    ) -> document.Names:
        """Label the objects."""
        # A model labels only objects without labels. The default labels are computed
        # for all, so that a refresh can tell which names they made.
        new_objects = (
            [t for t in objects if t.id not in found.names]
            if self.crew.row("label").extra
            else objects
        )
        guesses: Mapping[int, Name] = (
            self.role("label", self.rgb, found.labels, new_objects)
            if new_objects
            else {}
        )
        labels = {**guesses, **found.names}
        source = {
            t.id: found.named_by if t.id in found.names else self.crew.name("label")
            for t in objects
        }
        # An existing scene already contains the sources of its labels.
        if found.object_names:
            source |= dict.fromkeys(found.names, "")
        objects = [replace(t, label=labels[t.id].label) for t in objects]
        old_names = {
            t.id: found.object_names[t.id]
            for t in objects
            if t.id in found.object_names
        }
        before = document.object_names(objects, old_names)
        objects, renamed_ids = document.relabel_objects(objects, renames, before)
        source |= dict.fromkeys(renamed_ids, "")
        confidence = document.label_confidences(found, labels, guesses, renamed_ids)
        return document.Names(objects, labels, source, confidence, before, renamed_ids)

    def weigh(
        self, names: document.Names, pixels_per_meter: float | None
    ) -> tuple[Mapping[int, Matter], Scale | None]:
        """Return the matter of the objects by id, and the photo's scale."""
        objects = names.objects
        scale = photo_scale(
            objects, {t.id: kind(t.label) for t in objects}, names.confidence
        )
        if (
            pixels_per_meter is None
            and scale is not None
            and scale.confidence >= MIN_SCALE_CONFIDENCE
        ):
            pixels_per_meter = scale.pixels_per_meter
        matter: Mapping[int, Matter] = self.role(
            "physics", self.rgb, objects, pixels_per_meter
        )
        self.crew.release("label")
        judged = judged_scale(objects, matter, self.crew.name("physics"))
        scales = [one for one in (scale, judged) if one is not None]
        return matter, max(scales, key=lambda one: one.confidence, default=None)

    def find_boundaries(
        self,
        found: Detections,
        objects: Sequence[PhotoObject],
        view: BoundaryGuess | None,
        scenery: Any,
    ) -> tuple[BoundaryGuess, Any, Any]:
        """Return view and walls, with depth and normals if they were computed, else
        None.
        """
        extra: dict[str, Any] = {"scenery": scenery}
        inputs = self.crew.row("boundary").uses
        if "depth" in inputs or "depth" in self.crew.plan.choices:
            extra["depth"] = self.role("depth", self.rgb)
        if "normals" in inputs:
            extra["normals"] = self.role(
                "normals", self.rgb, found.labels, objects, UNKNOWN
            )
        known_view = view and view.view
        guess: BoundaryGuess = self.role(
            "boundary", self.rgb, found.labels, objects, known_view, **extra
        )
        guess = (
            replace(guess, confidence=view.confidence, reason=view.reason)
            if view
            else guess
        )
        depth = None if self.crew.name("depth") == "none" else extra.get("depth")
        return guess, depth, extra.get("normals")

    def signed(self, made: PerceivedScene) -> PerceivedScene:
        """Return the scene with the record of the backends, if models took part."""
        # A role in the second thread may have finished out of order.
        self.crew.steps.sort(key=lambda step: ROLES.index(step.role))
        return (
            made
            if self.crew.all_default()
            else replace(made, record=self.crew.record())
        )


def nearest_labels(labels: Labels, ids: Sequence[int]) -> Mask:
    """Return the pixels (H, W) whose nearest object has one of the ids."""
    own_mask = np.isin(labels, ids)
    if not own_mask.any():
        return np.zeros(labels.shape, bool)
    others = (labels > 0) & ~own_mask
    if not others.any():
        return np.ones(labels.shape, bool)
    own_distance, other_distance = (
        cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
        for mask in (own_mask, others)
    )
    return np.asarray(own_distance < other_distance)


def judged_scale(
    objects: Sequence[PhotoObject], matter: Mapping[int, Matter], source: str
) -> Scale | None:
    """Return the photo's scale by the estimated sizes of objects (`Matter.size`), or
    None.

    The scale is the median of the estimates; their unweighted disagreement determines
    the confidence.
    """
    estimates = [
        (box_sides(item.outline)[0] / size, matter[item.id].confidence)
        for item in objects
        if not item.cut and (size := matter[item.id].size)
    ]
    if not estimates:
        return None
    logs = np.log([per_meter for per_meter, _ in estimates])
    middle = float(np.median(logs))
    spread = 1.5 * LIMITS.judged
    if len(logs) > 1:
        spread = max(float(np.median(np.abs(logs - middle))) * 1.48, LIMITS.judged)
    reliability = float(np.median([confidence for _, confidence in estimates])) ** 0.5
    count = f"{len(estimates)} objects" if len(estimates) > 1 else "one object"
    reason = f"{source} judged the size of {count}, which agree to about {100 * spread:.0f} %"
    confidence = round(0.95 * reliability * exp(-((spread / LIMITS.vague) ** 2)), 2)
    return Scale(float(f"{exp(middle):.2g}"), confidence, reason)


def fit_objects(rgb: Rgb, found: Detections) -> tuple[list[PhotoObject], int]:
    """Return every object with its outline, without specks, and the number of
    specks.
    """
    labels = found.labels
    height, width = rgb.shape[:2]
    if labels.shape != (height, width):
        size = f"{labels.shape[1]} x {labels.shape[0]} px"
        differs = Message.NOT_PHOTO_SIZE
        raise differs.error("--masks", size, width=width, height=height)
    counts = np.bincount(labels.ravel(), minlength=2)
    all_ids = np.flatnonzero(counts[1:]) + 1
    ids = [int(i) for i in all_ids if counts[i] >= SMALLEST_OBJECT]
    mostly_specks = 2 * len(ids) < len(all_ids)
    if (len(all_ids) > MOST_IDS and mostly_specks) or len(ids) > MOST_OBJECTS:
        specks = ", most of them of a few pixels" if mostly_specks else ""
        count = f"{len(all_ids):,} ids{specks}"
        raise Message.NOT_A_LABEL_MAP.error("--masks", count=count)
    if not ids and found.source == "given":
        if len(all_ids):
            raise Message.MASKS_OF_SPECKS.error("--masks", least=SMALLEST_OBJECT)
        raise Message.MASKS_EMPTY.error("--masks")
    if not ids:
        return [], len(all_ids)
    outlines = fit_outlines(labels, ids)
    # The mask of a network may end slightly before the border that cuts its object.
    margin = min(round(0.012 * max(width, height)), min(width, height) // 4)
    on_border, ids_near_border = (
        np.unique(
            np.concatenate([labels[k], labels[-1 - k], labels[:, k], labels[:, -1 - k]])
        )
        for k in (0, margin)
    )
    by_hand = ("given", "pointed at", "drawn", "kept")
    objects = []
    for i in ids:
        x0, y0, x1, y1 = bounds(outlines[i])
        excess = max(-0.5 - x0, -0.5 - y0, x1 - width + 0.5, y1 - height + 0.5)
        exact = i in found.prompts or (
            found.mask_sources.get(i) or found.source
        ).startswith(by_hand)
        ends = not exact and not isinstance(outlines[i], Disc) and i in ids_near_border
        # Visible ground outside the mask shows that the object is complete.
        ends = ends and not shows_ground_beyond(rgb, labels == i, margin)
        objects.append(
            PhotoObject(i, outlines[i], cut=bool(excess > 0 or i in on_border or ends))
        )
    return objects, len(all_ids) - len(ids)


def _with_loose_parts(
    rgb: Rgb, found: Detections, view: BoundaryGuess | None
) -> Detections:
    """Return the detections with parts that move with their objects, as the view tells."""
    if view is not None:
        return found
    chances = view_chances(run_network(rgb).features)
    if chances.tilt is not None:
        return attach_contents(found)
    if chances.is_level:
        attached = attach_hanging_parts(found.labels, found.confidence)
        return replace(found, labels=attached)
    return found


def remain_problem(remain: Remain, name: str) -> Problem:
    """Return a warning about a narrow part beside an object that may stay behind."""
    x, y = remain.place
    description = f"something narrow at {x}, {y}"
    path = f"objects.{name}.mask"
    return Message.REMAINS_BEHIND.warning(THIS_PHOTO, path, description)


def outline_as_named(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]
) -> list[PhotoObject]:
    """Return the objects, with circles replaced by regions unless there is evidence for
    them.

    Evidence is the label of a round object or the shading of a sphere: a pouf, a van or
    the face of a box does not roll.
    """
    rejected_ids = [
        item.id
        for item in objects
        if isinstance(item.outline, Disc)
        and not has_round_form(kind(item.label))
        and not is_shaded_as_sphere(rgb, item.outline)
        and disc_iou(item.outline, labels == item.id) < EXACTLY_ROUND
    ]
    if not rejected_ids:
        return list(objects)
    ids = [item.id for item in objects]
    regions = fit_outlines(labels, ids, never_discs=rejected_ids)
    return [
        replace(item, outline=regions[item.id]) if item.id in rejected_ids else item
        for item in objects
    ]


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


def _replace_by_discs(labels: Labels, objects: Sequence[PhotoObject]) -> Labels:
    """Return the label map with the masks of round objects extended to their discs.

    A mask is extended only if it changes little, so that a mug keeps its handle.
    """
    result = labels.copy()
    for item in objects:
        if isinstance(item.outline, Disc):
            mask = result == item.id
            disc = (
                raster.coverage(item.outline, (labels.shape[1], labels.shape[0])) >= 0.5
            )
            disc &= mask | (result == 0)
            if np.count_nonzero(mask & disc) > NEARLY_ROUND * np.count_nonzero(
                mask | disc
            ):
                # Parts outside the disc stay in the mask, not in the background.
                result[disc] = item.id
    return result


def _world(
    boundaries: BoundaryGuess, pixels_per_meter: float, shadows: Shadows
) -> dict[str, Any]:
    per_meter = document.short(pixels_per_meter)
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
    return world | document.view_entry(shadows, is_side)


def _light(guess: LightGuess, shadows: Shadows) -> dict[str, Any]:
    if shadows.clean is None:
        source = document.provenance("shading", guess.confidence)
        return document.light_entry(guess.light) | {"from": source}
    source = document.provenance("shadows", shadows.confidence)
    softness = document.short(shadows.softness)
    return document.light_entry(shadows.light) | {"softness": softness, "from": source}


def shrink_photo(rgb: Rgb, side: int) -> Rgb:
    """Return the photo (H, W, 3) with a longer side of at most `side` px.

    Areas are averaged in linear light, as in a camera with fewer pixels.
    """
    height, width = rgb.shape[:2]
    scale = side / max(height, width)
    if scale >= 1:
        return rgb
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    light = (
        decode(np.arange(256, dtype=np.uint8)) * np.float32(65535) + np.float32(0.5)
    ).astype(np.uint16)
    small = np.empty((size[1], size[0], 3), np.uint8)
    # Channels are reduced one by one, since linear light takes twice the memory of the
    # photo.
    for c in range(3):
        mean = cv2.resize(
            cv2.LUT(cv2.extractChannel(rgb, c), light),
            size,
            interpolation=cv2.INTER_AREA,
        )
        small[:, :, c] = encode_u8(mean.astype(np.float32) / np.float32(65535))
    return small


def shrink_detections(found: Detections, full: tuple[int, int], rgb: Rgb) -> Detections:
    """Return detections of a photo of `full` width and height, px, for the smaller
    `rgb`.

    Detections of another size stay as they are.
    """
    size = (rgb.shape[1], rgb.shape[0])
    if size == full or found.labels.shape != full[::-1]:
        return found
    labels = cv2.resize(found.labels, size, interpolation=cv2.INTER_NEAREST_EXACT)
    return replace(found, labels=np.asarray(labels, np.uint16))
