"""The stages of perception with more than one call of a backend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import exp
from typing import Any

import cv2
import numpy as np

from physgen.geometry.scale import (
    LIMITS,
    MIN_SCALE_CONFIDENCE,
    Scale,
    box_sides,
    photo_scale,
)
from physgen.maps import F32
from physgen.materials import kind
from physgen.perceive import naming
from physgen.perceive.roles import (
    BoundaryGuess,
    Detections,
    Inpaint,
    Labels,
    Mask,
    Matter,
    Name,
    PerceivedScene,
    PhotoObject,
    Rgb,
    Scenery,
    Shadows,
)
from physgen.perceive.segment.copy_barriers import find_copy_barriers
from physgen.perceive.segment.prompts import Segmenter
from physgen.perceive.shadow.backgrounds import (
    Backgrounds,
    Surroundings,
    fill_backgrounds,
    fill_before_scenery,
    find_surroundings,
)
from physgen.perceive.shadow.mirror_images import remove_mirror_images
from physgen.perceive.shadow.reflections import remove_reflections
from physgen.progress import Progress
from physgen.registry import Backends
from physgen.scene.scene import View

UNKNOWN = BoundaryGuess(View.SIDE, 0.0, "", ())
"""The boundaries before the boundary stage."""

ROLES = (
    "categories", "segment", "label", "physics", "depth", "boundary", "normals", "intrinsic", "light", "matte",
    "shadow", "inpaint",
)  # fmt: skip
"""The roles in their order of execution."""

KEPT = ("inpaint", "normals", "label")
"""Roles with a late release, because they are called again or share a model with the
next role.
"""


def _owners_beside_mirrors(shadows: Shadows, labels: Labels) -> Labels | None:
    """Return the owners of shadows for a clean background without mirror images.

    An empty map says that the background still contains its shadows.
    """
    if shadows.clean_background is None and shadows.owners is None:
        return np.zeros_like(labels)
    return shadows.owners


@dataclass(frozen=True)
class PerceptionRun:
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
        surroundings: Surroundings,
        shadows: Shadows,
        standing: Labels | None,
        scenery_mask: Mask,
    ) -> Backgrounds:
        """Fill the background behind the objects; those of `scenery_mask` come last.

        If no shadows are removed, reflections of objects `standing` on a floor are
        removed as well.
        """
        inpaint = self._make_inpaint(surroundings)
        has_movable = ((surroundings.coverage > 0) & ~scenery_mask).any()
        if has_movable and scenery_mask.any():
            backgrounds = fill_before_scenery(
                surroundings, scenery_mask, shadows, inpaint
            )
        else:
            backgrounds = fill_backgrounds(surroundings, shadows, inpaint)
        if (
            backgrounds.clean_picture is None
            or shadows.is_faint_shadow
            or standing is None
        ):
            return backgrounds
        # Scenery stays in the picture, and so do its reflections.
        movable = np.where(scenery_mask, np.uint16(0), standing)
        coverage = np.where(scenery_mask, np.float32(0), surroundings.coverage)
        clean_background = remove_reflections(
            backgrounds.clean_picture, movable, coverage, inpaint
        )
        return replace(backgrounds, clean_picture=clean_background)

    def _make_inpaint(self, surroundings: Surroundings) -> Inpaint:
        """Return the role `inpaint`, which copies no objects into holes of the ground.

        Crops of the photo, around small holes, are filled from all their pixels.
        """
        uses_barriers = "barriers" in self.crew.row("inpaint").uses
        if not (uses_barriers and surroundings.hole.any()):
            return partial(self.crew.call, "inpaint")
        barriers = find_copy_barriers(self.rgb, surroundings.hole)

        def fill_ground(photo: Rgb, hole: Mask) -> Rgb:
            extra: dict[str, Mask] = {}
            if photo.shape == self.rgb.shape:
                extra["barriers"] = barriers
            result: Rgb = self.crew.call("inpaint", photo, hole, **extra)
            return result

        return fill_ground

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
        if backgrounds.clean_picture is None:
            visible = backgrounds.shaded_picture
        else:
            visible = backgrounds.clean_picture
        mirrorless = remove_mirror_images(
            self.rgb, visible, labels, coverage, ids, inpaint
        )
        if mirrorless is None:
            return backgrounds.clean_picture, shadows.owners
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
            name_source=backend_name,
        )
        return detections, segments.scenery

    def name(
        self,
        detections: Detections,
        objects: Sequence[PhotoObject],
        renames: Sequence[str],
    ) -> naming.Names:
        """Label the objects."""
        # A model labels only objects without labels. The default labels are computed
        # for all, so that a refresh can tell which names they made.
        new_objects = objects
        if self.crew.row("label").extra:
            new_objects = []
            for t in objects:
                if t.id not in detections.names:
                    new_objects.append(t)
        guesses: Mapping[int, Name] = (
            self.role("label", self.rgb, detections.labels, new_objects)
            if new_objects
            else {}
        )
        labels = {**guesses, **detections.names}
        source = {}
        for t in objects:
            source[t.id] = (
                detections.name_source
                if t.id in detections.names
                else self.crew.name("label")
            )
        # An existing scene already contains the sources of its labels.
        if detections.object_names:
            source |= dict.fromkeys(detections.names, "")
        objects = [replace(t, label=labels[t.id].label) for t in objects]
        old_names = {}
        for t in objects:
            if t.id in detections.object_names:
                old_names[t.id] = detections.object_names[t.id]
        before = naming.object_names(objects, old_names)
        objects, renamed_ids = naming.relabel_objects(objects, renames, before)
        source |= dict.fromkeys(renamed_ids, "")
        confidence = naming.label_confidences(detections, labels, guesses, renamed_ids)
        return naming.Names(objects, labels, source, confidence, before, renamed_ids)

    def weigh(
        self, names: naming.Names, pixels_per_meter: float | None
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
        scales = []
        for one in (scale, judged):
            if one is not None:
                scales.append(one)
        return matter, max(scales, key=lambda one: one.confidence, default=None)

    def find_boundaries(
        self,
        detections: Detections,
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
                "normals", self.rgb, detections.labels, objects, UNKNOWN
            )
        known_view = view and view.view
        guess: BoundaryGuess = self.role(
            "boundary", self.rgb, detections.labels, objects, known_view, **extra
        )
        if view:
            guess = replace(guess, confidence=view.confidence, reason=view.reason)
        if self.crew.name("depth") == "none":
            depth = None
        else:
            depth = extra.get("depth")
        return guess, depth, extra.get("normals")

    def sign(self, scene: PerceivedScene) -> PerceivedScene:
        """Return the scene with the record of the backends, if models took part."""
        # A role in the second thread may have finished out of order.
        self.crew.steps.sort(key=lambda step: ROLES.index(step.role))
        if self.crew.all_default():
            return scene
        return replace(scene, record=self.crew.record())


def nearest_labels(labels: Labels, ids: Sequence[int]) -> Mask:
    """Return the pixels (H, W) whose nearest object has one of the ids."""
    own_mask = np.isin(labels, ids)
    if not own_mask.any():
        return np.zeros(labels.shape, bool)
    others = (labels > 0) & ~own_mask
    if not others.any():
        return np.ones(labels.shape, bool)
    own_distance = cv2.distanceTransform((~own_mask).astype(np.uint8), cv2.DIST_L2, 5)
    other_distance = cv2.distanceTransform((~others).astype(np.uint8), cv2.DIST_L2, 5)
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
    spread = 1.5 * LIMITS.judged_spread
    if len(logs) > 1:
        spread = max(
            float(np.median(np.abs(logs - middle))) * 1.48, LIMITS.judged_spread
        )
    reliability = float(np.median([confidence for _, confidence in estimates])) ** 0.5
    if len(estimates) > 1:
        count = f"{len(estimates)} objects"
    else:
        count = "one object"
    reason = f"{source} judged the size of {count}, which agree to about {100 * spread:.0f} %"
    confidence = round(
        0.95 * reliability * exp(-((spread / LIMITS.vague_spread) ** 2)), 2
    )
    return Scale(float(f"{exp(middle):.2g}"), confidence, reason)
