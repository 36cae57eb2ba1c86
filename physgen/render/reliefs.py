"""Reliefs of sprites without normals: light on rounded edges and on turning discs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64, Mask
from physgen.compile.world import Body
from physgen.maps import U8
from physgen.photometry import DistantLight
from physgen.render.sprites import (
    CUT,
    MOST_RELIGHTING,
    Relief,
    Sprite,
)
from physgen.scene.scene import Solid


@dataclass(frozen=True)
class ReliefTuning:
    """Limits between light and paint on edges and discs."""

    ring_share: float = 0.75
    """Smallest visible share of a disc's ring to tell light from paint."""
    paint_change: float = 0.7
    """Change around a ring, relative to its mean, above which it is paint."""
    direction_variance: float = 0.3
    """Share of the variance of an edge's light that one direction must explain."""
    light_change: float = 0.5
    """Maximum change of an edge's light with its direction, relative to the face."""
    sun_weight: float = 0.5
    """Weight of the scene's light in the direction of edges' light, which two sides
    alone do not tell.
    """
    grain_change: float = 0.05
    """Light of an edge, relative to the face, below which it may be grain."""


RELIEF = ReliefTuning()


def add_edge_relief(sprite: Sprite, light: DistantLight) -> Sprite:
    """Add rounded edges to a sprite if the photo shows light on them.

    A change of light on rings inside the outline that one direction of light explains
    stays as the object turns; any other change is paint.
    """
    solid = (sprite.coverage >= 1).astype(np.uint8)
    if sprite.sides is not None:
        solid[: ceil(sprite.sides.first)] = 0
    # The depth below the outline gives the rings of an edge.
    padded_depth = cv2.distanceTransform(np.pad(solid, 1), cv2.DIST_L2, 5)
    depth = np.asarray(padded_depth[1:-1, 1:-1], np.float32)
    has_inside = (depth > 2 * CUT.rim).any()
    if sprite.ball is not None or sprite.relief is not None or not has_inside:
        return sprite
    normal = _outward_normals(solid)
    edge = _edge_light(sprite, depth)
    gain = _edge_gain(normal, edge, depth, solid > 0, light)
    if gain is None:
        return sprite
    edge_gain, cross_gain = _project_gain(gain, normal)
    strength = _edge_strength(edge, edge_gain)
    relief = _build_edge_relief(edge_gain * strength, cross_gain * strength)
    return replace(sprite, relief=relief)


def _project_gain(gain: F32, normal: F32) -> tuple[F32, F32]:
    """Return the parts (h, w) of a gain (h, w, 2) along the normals and across them."""
    x = normal[..., 0]
    y = normal[..., 1]
    gain_x = gain[..., 0]
    gain_y = gain[..., 1]
    return gain_x * x + gain_y * y, gain_x * y - gain_y * x


def _edge_strength(edge: F32, edge_gain: F32) -> F32:
    """Return the share (h, w) of an edge's expected light that the photo confirms.

    If the outline is wrong by a pixel, the photo shows no such edge: half of the
    expected light counts in full, a quarter not at all.
    """
    has_light = np.abs(edge_gain) > RELIEF.grain_change
    visible_share = np.divide(edge, edge_gain, out=np.ones_like(edge), where=has_light)
    return np.asarray(np.clip(4 * visible_share - 1, 0, 1), np.float32)


def _outward_normals(solid: U8) -> F32:
    """Return the outward unit vectors (h, w, 2) of a shape, right and down."""
    blurred_shape = cv2.GaussianBlur(solid.astype(np.float32), (0, 0), CUT.clean_depth)
    x = -cv2.Sobel(blurred_shape, cv2.CV_32F, 1, 0)
    y = -cv2.Sobel(blurred_shape, cv2.CV_32F, 0, 1)
    length = np.maximum(np.hypot(x, y), 1e-6)[..., None]
    return np.asarray(np.stack([x, y], axis=2) / length, np.float32)


def _edge_light(sprite: Sprite, depth: F32) -> F32:
    """Return the light of a sprite relative to its face nearby, minus 1, (h, w)."""
    brightness = sprite.light.mean(axis=2)
    inner = (depth > CUT.rim).astype(np.float32)
    face_light = cv2.GaussianBlur(brightness * inner, (0, 0), CUT.outline_width)
    weight = cv2.GaussianBlur(inner, (0, 0), CUT.outline_width)
    face_light = np.maximum(face_light, 1e-4)
    weight = np.maximum(weight, 1e-4)
    return np.asarray(brightness * weight / face_light - 1, np.float32)


def _edge_gain(
    normal: F32, edge: F32, depth: F32, solid: Mask, light: DistantLight
) -> F32 | None:
    """Return the gain of light (h, w, 2) at edges by their normals.

    None without an edge, or for a completely round shape.
    """
    gain = np.zeros_like(normal)
    rings = np.maximum(np.ceil(depth), 1)
    toward_light = np.array(light.direction[:2])
    sun = light.direction[:2] / np.maximum(np.hypot(*light.direction[:2]), 1e-6)
    strengths = [0.0] * CUT.rim
    # Regress the light of each ring on its normals: a slope towards the light is
    # shading.
    for number in range(1, CUT.rim + 1):
        ring = (rings == number) & solid
        directions = normal[ring] - normal[ring].mean(axis=0)
        change = edge[ring] - edge[ring].mean()
        slope = np.linalg.lstsq(directions, change)[0]
        explained_sum = ((directions @ slope) ** 2).sum()
        is_light = explained_sum > RELIEF.direction_variance * (change**2).sum()
        if is_light and slope @ toward_light > 0:
            strength = min(float(np.hypot(*slope)), RELIEF.light_change)
            direction = slope / np.hypot(*slope) + RELIEF.sun_weight * sun
            gain[rings == number] = strength * direction / np.hypot(*direction)
            strengths[number - 1] = strength
    if max(strengths) <= 2 * strengths[-1]:
        return None
    return gain


def _build_edge_relief(light_part: F32, cross_part: F32) -> Relief:
    """Return the relief of light that changes by `light_part`, and by `cross_part` a quarter
    turn on.
    """
    model = np.maximum(1 + light_part, 1 / MOST_RELIGHTING)
    unit_gain = np.ones_like(light_part)
    zeros = np.zeros_like(light_part)
    return Relief(
        plane_light=np.asarray(light_part / model, np.float32),
        cross_light=np.asarray(cross_part / model, np.float32),
        view_light=np.asarray(unit_gain / model, np.float32),
        ambient_light=np.asarray(zeros / model, np.float32),
    )


def add_disc_relief(sprite: Sprite, body: Body) -> Sprite:
    """Return a turning disc in the top view with light from a fixed direction.

    On completely visible rings, a small change of light around the axis is light; a
    larger one is paint.
    """
    if body.radius is None or body.solid is Solid.SPHERE:
        return sprite
    rows, columns = np.indices(sprite.coverage.shape)
    x = columns + sprite.corner[0] - body.center[0]
    y = rows + sprite.corner[1] - body.center[1]
    distance = np.maximum(np.hypot(x, y), 1.0)
    cosine, sine = x / distance, y / distance
    rings = np.minimum(distance, max(body.radius - 2, 0)).astype(int)
    is_known = (sprite.coverage >= 1) & (distance < body.radius)
    # Light from one side changes once around the axis: the first harmonic of each ring.
    harmonic = _fit_ring_harmonic(sprite, rings, is_known, cosine, sine)
    mean_light, cosine_part, sine_part = [values[rings] for values in harmonic]
    mean_light = np.maximum(mean_light, CUT.least_light)
    relief = _build_edge_relief(
        (cosine_part * cosine + sine_part * sine) / mean_light,
        (cosine_part * sine - sine_part * cosine) / mean_light,
    )
    return replace(sprite, relief=relief)


def _fit_ring_harmonic(
    sprite: Sprite, rings: NDArray[np.int64], is_known: Mask, cosine: F64, sine: F64
) -> list[NDArray[np.float64]]:
    """Return the mean, the cosine and the sine part (n,) of the light on each ring.

    Light does not turn with a disc, paint does. The first harmonic of the brightness on
    each ring of 1 px is a + b cos(angle) + c sin(angle); b and c are 0 for paint.
    """
    count = rings.max() + 1
    own_rings = rings[is_known]
    brightness = sprite.turning_light.mean(axis=2)
    sums = []
    for term in (np.ones_like(cosine), 2 * cosine, 2 * sine):
        sums.append(np.bincount(own_rings, (brightness * term)[is_known], count))
    counts = np.maximum(np.bincount(own_rings, minlength=count), 1)
    # A partly hidden ring has no reliable harmonic.
    circumferences = np.pi * (2 * np.arange(len(counts)) + 1)
    is_visible = counts > RELIEF.ring_share * circumferences
    is_even = np.hypot(*sums[1:]) < RELIEF.paint_change * sums[0]
    is_light = is_visible & is_even
    terms = [sums[0], sums[1] * is_light, sums[2] * is_light]
    # Smooth across rings, since a single ring has few pixels.
    return [
        np.asarray(cv2.GaussianBlur(term / counts, (0, 0), 1.0).ravel())
        for term in terms
    ]
