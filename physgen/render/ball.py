"""A sphere in the photo: its colour without light, its gloss, and its shading.

The colour turns with the ball; shading and highlights stay with the light. A ball has
few paints: if each pixel's paint is known, the remaining smooth change over the ball is
light; if the light is known, paints can be separated. Both are found alternately, in
logarithms. If a band, a cut or a disc explains the near side, the whole ball is painted
with it; otherwise a point of the far side has the colour of its antipode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64, Mask
from physgen.photometry import DistantLight
from physgen.render.ball_patterns import (
    RIM,
    Paints,
    Pattern,
    basis,
    find_paints,
    find_pattern,
)
from physgen.render.ball_tuning import BALL
from physgen.render.sphere_texture import part_highlights
from physgen.scene.scene import View


@dataclass(frozen=True)
class Ball:
    """The visible half of a sphere, on its sprite's box.

    The centre of a cut or hidden sphere may be outside the box.
    """

    corner: tuple[int, int]
    """Column and row of the box's first pixel in the photo."""
    center: tuple[float, float]
    """Centre in the photo at t = 0, px."""
    radius: float
    skin: F32
    """Linear light over shading, (h, w, 3), continued beyond the rim."""
    gloss: F32
    """Linear light (h, w, 3), of either sign, beyond skin and Lambert's law, such as
    highlights.

    It does not turn.
    """
    light: DistantLight
    photo_light: F32
    """Linear light in the photo, (h, w, 3), continued beyond the rim."""
    lamp_weights: F32 | None = None
    """Weights (8, 3) of `basis`: log of light beyond Lambert's law."""
    trust: float = 1.0
    """Visibility of the light on the ball in the photo, 0..1: a power of Lambert's
    shading.
    """
    pattern: Pattern | None = None
    """Pattern of a ball in the top view."""
    fade: F32 | None = None
    """Fixed factor (h, w) of the light at the rim."""
    has_continued_texture: bool = False
    """Whether its far side continues the texture of the near side."""

    def shade(self, u: F32, v: F32, z: F32) -> F32:
        """Return the shading (h, w, 3) of normals (u, v, z to the viewer)."""
        shading = sphere_shading(self.light, u, v, z)[..., None]
        if self.trust < 1:
            shading = np.power(shading, np.float32(self.trust))
        if self.lamp_weights is None:
            return shading
        harmonics = np.stack(np.broadcast_arrays(*basis(u, v, z)), axis=-1)
        limit = BALL.most_departure
        departure = np.clip(harmonics @ self.lamp_weights, -limit, limit)
        return np.asarray(shading * np.exp(departure), np.float32)

    @cached_property
    def shading(self) -> F32:
        """Return the shading (h, w, 3) on the ball's own box."""
        shape = self.skin.shape
        u, v, z, _ = normals_within(shape, self.corner, self.center, self.radius)
        picture = self.shade(u, v, z)
        if self.fade is not None:
            picture = picture * self.fade[..., None]
        return np.asarray(np.broadcast_to(picture, shape).copy(), np.float32)


def normals_within(
    shape: tuple[int, ...],
    corner: tuple[int, int],
    center: tuple[float, float],
    radius: float,
) -> tuple[F32, F32, F32, F32]:
    """Return u, v, z of a sphere's normals on a box, (h, w), and distances from the
    centre.

    Distances are radii; beyond `RIM` the normals are those at `RIM`.
    """
    x = np.arange(shape[1]) + corner[0] - center[0]
    y = np.arange(shape[0]) + corner[1] - center[1]
    u, v = np.meshgrid((x / radius).astype(np.float32), (y / radius).astype(np.float32))
    rho = np.sqrt(np.maximum(u * u + v * v, 1e-12))
    # Near the rim the normal changes infinitely fast with the place: a limit keeps the
    # light there finite.
    squeeze = np.minimum(np.float32(1), np.float32(RIM) / rho)
    u, v = u * squeeze, v * squeeze
    return u, v, np.sqrt(np.maximum(1 - u * u - v * v, 0)), rho


def sphere_shading(light: DistantLight, u: F32, v: F32, z: F32) -> F32:
    """Return Lambert's shading of a unit sphere's normals (u, v, z to the viewer).

    It is at least `BALL.darkest` of the maximum.
    """
    lx, ly, lz = (np.float32(part) for part in light.direction)
    light_cosine = np.maximum(lx * u + ly * v + lz * z, 0)
    shade = np.float32(light.ambient) + np.float32(light.intensity) * light_cosine
    minimum = np.float32(BALL.darkest * (light.ambient + light.intensity))
    return np.asarray(np.maximum(shade, minimum), np.float32)


@dataclass(frozen=True)
class _Normals:
    """A sphere's normals on a box, (h, w) each; beyond `RIM` they are those at
    `RIM`.
    """

    u: F32
    v: F32
    z: F32
    rho: F32
    """Distance from the centre, radii."""

    @property
    def parts(self) -> tuple[F32, F32, F32]:
        return self.u, self.v, self.z

    @property
    def inside(self) -> Mask:
        return np.asarray(self.rho < RIM, np.bool_)


def ball_from_photo(
    colour: F32,
    corner: tuple[int, int],
    center: tuple[float, float],
    radius: float,
    light: DistantLight,
    view: View,
    has_paints: bool = True,
    is_mirror: bool = False,
) -> Ball:
    """Separate a ball into skin, gloss and shading.

    `colour` (h, w, 3) is its linear light on a box at `corner`. In the top view a ball
    turns its far side up; in the side view it turns in the picture, and its near side
    suffices. If `has_paints`, the far side has the pattern of billiard balls; otherwise
    it continues the texture. If `is_mirror`, the ball shows only its surroundings, and
    nothing on it turns.
    """
    normals = _Normals(*normals_within(colour.shape, corner, center, radius))
    inner_light = _carry_light_inwards(colour, corner, center, radius, normals)
    if is_mirror:
        no_gloss = np.zeros_like(colour)
        ball = Ball(corner, center, radius, inner_light, no_gloss, light, inner_light)
        return _with_one_colour(ball, colour, normals.inside)
    # Gloss belongs to the lamp and stays in place; the skin below it turns with the
    # ball.
    shine = _gloss(inner_light, *normals.parts, radius, light)
    # The photo's own shading decides how much of Lambert's law the light follows.
    trust = _measure_shading_strength(
        inner_light - shine, sphere_shading(light, *normals.parts), normals.inside
    )
    ball = Ball(
        corner, center, radius, inner_light, shine, light, inner_light, trust=trust
    )
    skin = (inner_light - shine) / ball.shade(*normals.parts)
    ball = replace(ball, skin=np.ascontiguousarray(skin, np.float32))
    smooth_light = np.ones_like(normals.rho)
    use = normals.inside & (shine.max(axis=2) <= 0)
    # Known paints separate the skin from the remaining light.
    paints = find_paints(ball.skin, *normals.parts, use)
    if paints is not None:
        has_pattern = view is View.TOP and has_paints
        painting = _painting(ball, paints, normals, use, has_pattern)
        if painting is not None:
            ball, smooth_light = painting
    if _has_one_colour(ball.skin, *normals.parts, normals.inside):
        return _with_one_colour(ball, colour, normals.inside)
    if not has_paints:
        ball = _without_highlights(ball, normals.inside)
        ball = replace(ball, has_continued_texture=view is View.TOP)
    return replace(ball, fade=_rim_light(ball, colour, normals, smooth_light))


def _painting(
    ball: Ball, paints: Paints, normals: _Normals, use: Mask, has_pattern: bool
) -> tuple[Ball, F32] | None:
    """Return the ball with a skin of its paints, and the smooth light (h, w) beyond
    shading; None if its paints are unclear.
    """
    limit = BALL.mixture_share
    if has_pattern:
        limit = BALL.painted_by_name
    if paints.mixture_share >= limit:
        return None
    painting = _with_paints(ball, paints, normals, use, has_pattern)
    # Between both limits, only a pattern proves the paints.
    if painting[0].pattern is None and paints.mixture_share >= BALL.mixture_share:
        return None
    return painting


def _with_one_colour(ball: Ball, colour: F32, inside: Mask) -> Ball:
    """Return a ball of one colour.

    It looks the same after any rotation: all unevenness is light, and stays.
    """
    median = np.median(ball.skin[inside], axis=0)
    skin = np.broadcast_to(median, ball.skin.shape).copy()
    ball = replace(ball, skin=skin, pattern=None)
    return replace(ball, gloss=colour - ball.skin * ball.shading)


def _carry_light_inwards(
    colour: F32,
    corner: tuple[int, int],
    center: tuple[float, float],
    radius: float,
    normals: _Normals,
) -> F32:
    """Return a ball's light (h, w, 3), with that near its rim continued outwards."""
    x = normals.u * np.float32(radius) + np.float32(center[0] - corner[0])
    y = normals.v * np.float32(radius) + np.float32(center[1] - corner[1])
    border = cv2.BORDER_REPLICATE
    picture = cv2.remap(colour, x, y, cv2.INTER_LINEAR, borderMode=border)
    return np.asarray(picture, np.float32)


def _with_paints(
    ball: Ball, paints: Paints, normals: _Normals, use: Mask, has_pattern: bool
) -> tuple[Ball, F32]:
    """Return the ball with a skin of its paints, and the smooth light (h, w) beyond
    shading.
    """
    inner_light, shine = ball.photo_light, ball.gloss
    ball = replace(ball, lamp_weights=paints.lamp_weights)
    shade = ball.shade(*normals.parts)
    skin = (inner_light - shine) / shade
    # The nearest paint predicts the skin; the rest above it is gloss, and below it is
    # shade.
    painted_skin = _paint_by_nearest_colour(skin, paints)
    pattern = None
    if has_pattern:
        points = sphere_points(inner_light.shape, ball.corner, ball.center, ball.radius)
        pattern = find_pattern(skin[use], paints.colours, points[use])
        if pattern is not None:
            painted_skin = pattern.paint(points, 1 / ball.radius)
            shine = np.minimum(shine, np.maximum(inner_light - painted_skin * shade, 0))
            skin = (inner_light - shine) / shade
    excess = _excess_light(skin, painted_skin)
    skin, shine = skin - excess, shine + excess * shade
    smooth_light = np.ones_like(normals.rho)
    if pattern is None:
        smooth_light = _smooth_skin_light(skin, painted_skin, normals, ball.radius)
        skin = skin / smooth_light[..., None]
    else:
        skin = paint_ball_skin(replace(ball, gloss=shine, pattern=pattern)).skin
    return replace(ball, skin=skin, gloss=shine, pattern=pattern), smooth_light


def _paint_by_nearest_colour(skin: F32, paints: Paints) -> F32:
    """Return a skin (h, w, 3) of paints alone."""
    distances = [np.abs(skin - paint).max(axis=2) for paint in paints.colours]
    paint = np.argmin(distances, axis=0).astype(np.uint8)
    # The median removes details narrower than 2 px.
    return np.asarray(paints.colours[cv2.medianBlur(paint, 3)], np.float32)


def _excess_light(skin: F32, painted_skin: F32) -> F32:
    """Return the light (h, w, 3) of a skin beyond its paint: reflections."""
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    excess = np.maximum(skin - BALL.excess * cv2.dilate(painted_skin, cross), 0)
    # A thin line is paint, not a reflection.
    return np.asarray(cv2.morphologyEx(excess, cv2.MORPH_OPEN, cross), np.float32)


def _smooth_skin_light(
    skin: F32, painted_skin: F32, normals: _Normals, radius: float
) -> F32:
    """Return the smooth light (h, w) by which a skin differs from its paints."""
    is_within = (normals.rho < 1).astype(np.float32)
    brightness = skin.mean(axis=2)
    flat_brightness = painted_skin.mean(axis=2)
    sigma = BALL.light_width * radius
    return blurred_share(brightness, flat_brightness, is_within, sigma)


def _rim_light(ball: Ball, colour: F32, normals: _Normals, softness: F32) -> F32:
    """Return the photo's light over the model's at the rim, (h, w), and `softness` inside.

    The difference at the rim is light and stays: in brightness, not in colours.
    """
    model = (ball.skin * ball.shading).mean(axis=2)
    brightness = (colour - ball.gloss).mean(axis=2)
    is_within = (normals.rho < 1).astype(np.float32)
    sigma = max(1.0, BALL.blur_width * ball.radius)
    share = blurred_share(brightness, model, is_within, sigma)
    is_rim = normals.rho > BALL.rim_light
    return np.asarray(np.where(is_rim, share, softness), np.float32)


def _without_highlights(ball: Ball, inside: Mask) -> Ball:
    """Move highlights from the skin to the gloss; the far side continues the skin."""
    skin = part_highlights(ball.skin, inside, ball.radius)
    gloss = ball.gloss + (ball.skin - skin) * ball.shading
    return replace(ball, skin=skin, gloss=gloss)


def _measure_shading_strength(colour: F32, shade: F32, inside: Mask) -> float:
    """Return the slope of a ball's brightness over its predicted shading, in logs,
    0..1.

    It is 1 from `BALL.plainly` on.
    """
    if np.count_nonzero(inside) < 50:
        return 1.0
    x = np.log(np.maximum(shade[inside], 5e-3)).astype(np.float64)
    brightness = colour.mean(axis=2)
    y = np.log(np.maximum(brightness[inside], 5e-3)).astype(np.float64)
    # A ball under even light has no variance of its predicted shading, and gives no
    # slope.
    x -= x.mean()
    variance = float((x * x).mean())
    if variance < 1e-4:
        return 1.0
    trust = np.ones(len(x))
    slope = level = 0.0
    # Regress the logarithms with Huber weights, since writing and stains do not follow
    # the shading. A small ridge keeps the slope finite.
    for _ in range(4):
        level = float(np.average(y - slope * x, weights=trust))
        product = (trust * x * (y - level)).sum()
        square = (trust * x * x).sum() + 0.02 * variance * len(x)
        slope = float(product / square)
        trust = 1 / np.maximum(np.abs(y - level - slope * x) / 0.2, 1)
    return float(np.clip(slope / BALL.plainly, 0, 1))


def blurred_share(brightness: F32, model: F32, weight: F32, sigma: float) -> F32:
    """Return the smooth ratio (h, w) of an object's brightness to that of its model."""
    blurred_brightness = cv2.GaussianBlur(brightness * weight, (0, 0), sigma)
    blurred_model = cv2.GaussianBlur(model * weight, (0, 0), sigma)
    # On dark skin the ratio is uncertain: the constant keeps it near 1.
    share = (blurred_brightness + np.float32(BALL.least_light)) / (
        blurred_model + np.float32(BALL.least_light)
    )
    return np.asarray(np.clip(share, 1 / BALL.fades, BALL.fades), np.float32)


def _has_one_colour(skin: F32, u: F32, v: F32, z: F32, inside: Mask) -> bool:
    """Check whether a ball has one colour: nine tenths of its skin change linearly."""
    if np.count_nonzero(inside) < 50:
        return False
    level = np.log(np.maximum(skin, 1e-3))[inside].astype(np.float64)
    normals = [np.broadcast_to(part, inside.shape)[inside] for part in (u, v, z)]
    # A linear function of the normal is any remaining shading by a distant light: only
    # the residuals are colour.
    rows = np.column_stack([np.ones(len(level)), *normals])
    residuals = level - rows @ np.linalg.lstsq(rows, level, rcond=None)[0]
    return bool(np.percentile(np.abs(residuals), 90) < BALL.colour_error)


def _gloss(
    colour: F32, u: F32, v: F32, z: F32, radius: float, light: DistantLight
) -> F32:
    """Return bright spots (h, w, 3) near the mirror direction of the light."""
    no_gloss = np.zeros_like(colour)
    half_vector = np.array(light.direction) + np.array([0.0, 0.0, 1.0])
    length = float(np.linalg.norm(half_vector))
    if length < 1e-6 or radius < 4:
        return no_gloss
    hx, hy, hz = (np.float32(part / length) for part in half_vector)
    is_near = hx * u + hy * v + hz * z > BALL.gloss_cosine
    beneath = _beneath_spots(colour, radius)
    # A white stripe is as white elsewhere on the ball; a highlight is brighter than all
    # of it.
    is_elsewhere = ~is_near & (u * u + v * v < 0.99 * RIM * RIM)
    if not is_elsewhere.any():
        return no_gloss
    paint = colour.min(axis=2) / sphere_shading(light, u, v, z)
    is_core = is_near & _is_brighter_than_paint(colour, beneath, paint, is_elsewhere)
    if not is_core.any():
        return no_gloss
    spot = _soft_spot(is_core, radius)
    return np.asarray(np.maximum(colour - beneath, 0) * spot[..., None], np.float32)


def _is_brighter_than_paint(
    colour: F32, beneath: F32, paint: F32, is_elsewhere: Mask
) -> Mask:
    """Return the pixels (h, w) brighter than their surroundings and than any paint.

    `beneath` (h, w, 3): light without spots; `paint` (h, w): light over shading.
    """
    dimmest = colour.min(axis=2)
    is_spot = dimmest > BALL.gloss_least
    is_spot &= dimmest > 1.5 * beneath.min(axis=2) + 0.05
    brightest = np.percentile(paint[is_elsewhere], 97)
    is_spot &= (paint > BALL.outshines * brightest) | (dimmest > BALL.brightest_paint)
    return np.asarray(is_spot, np.bool_)


def _soft_spot(core: Mask, radius: float) -> F32:
    """Return the share (h, w) of a highlight around its core."""
    reach = max(2, round(0.12 * radius))
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    spot = cv2.dilate(core.astype(np.uint8), square).astype(np.float32)
    blurred_spot = cv2.GaussianBlur(spot, (0, 0), max(0.6, reach / 3))
    return np.asarray(blurred_spot, np.float32)


def _beneath_spots(colour: F32, radius: float) -> F32:
    """Return a ball's light without bright spots.

    Lines of a number on a bright disc are not gaps in the disc.
    """
    line = _ellipse(BALL.line_width * radius)
    spot = _ellipse(BALL.gloss_width * radius)
    border = cv2.BORDER_REPLICATE
    without_lines = cv2.morphologyEx(colour, cv2.MORPH_CLOSE, line, borderType=border)
    without_spots = cv2.morphologyEx(
        without_lines, cv2.MORPH_OPEN, spot, borderType=border
    )
    dilated_light = cv2.dilate(without_spots, np.ones((3, 3), np.uint8))
    return np.asarray(np.minimum(dilated_light, colour), np.float32)


def _ellipse(diameter: float) -> NDArray[Any]:
    """Return a round structuring element of this diameter, px."""
    side = 2 * max(1, round(diameter / 2)) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))


def paint_ball_skin(ball: Ball) -> Ball:
    """Return a ball with the skin of its pattern, and the writing of the photo
    on it.
    """
    assert ball.pattern is not None
    points = sphere_points(ball.skin.shape, ball.corner, ball.center, ball.radius)
    border = 1 / ball.radius
    painted_skin = ball.pattern.paint(points, border)
    skin = (ball.photo_light - ball.gloss) / ball.shading
    brightest = ball.pattern.colours.max(axis=0)
    ink = np.clip(skin, 0, brightest) - painted_skin
    share, _ = ball.pattern.map_to_disc(points, border)
    return replace(ball, skin=np.asarray(painted_skin + share * ink, np.float32))


def sphere_points(
    shape: tuple[int, ...],
    corner: tuple[int, int],
    center: tuple[float, float],
    radius: float,
) -> NDArray[Any]:
    """Return the normals (h, w, 3), as `normals_within`."""
    u, v, z, _ = normals_within(shape, corner, center, radius)
    return np.stack(np.broadcast_arrays(u, v, z), axis=-1)


def sample_picture(picture: F32, size: Sequence[int], scale: float, shift: F64) -> F32:
    """Sample a picture at `scale` times the columns and rows of `size`, plus
    `shift`.
    """
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    matrix = np.column_stack([scale * np.eye(2), shift])
    result = cv2.warpAffine(
        picture,
        matrix,
        (size[0], size[1]),
        flags=flags,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(result, np.float32)
