"""The light that balls of one photo share, found from all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64, Mask
from physgen.render.ball import (
    Ball,
    paint_ball_skin,
    sample_picture,
    sphere_points,
)
from physgen.render.ball_patterns import (
    RIM,
    Ids,
    Pattern,
    average_each_paint,
    basis,
    deviations_from_median,
    solve_weights,
)
from physgen.render.ball_tuning import BALL


def in_one_light(balls: Sequence[Ball]) -> list[Ball]:
    """Return painted balls in their common light.

    Common are the brightness of each normal, and the mirror images of lamps, windows
    and the table, taken from balls without a near or mirrored neighbour. The paint that
    most balls have in common gets one colour.
    """
    painted_balls = [ball for ball in balls if ball.pattern is not None]
    if len(painted_balls) < BALL.set_count:
        return list(balls)
    common_radius = max(round(ball.radius) for ball in painted_balls)
    # Resample all balls to one radius, so that their pixels have common normals.
    views = _BallViews.sample(painted_balls, balls, common_radius)
    common_ball = replace(
        painted_balls[0],
        trust=float(np.median([ball.trust for ball in painted_balls])),
        lamp_weights=None,
    )
    normals = np.moveaxis(views.points, 2, 0)
    unlit_pictures = views.pictures / common_ball.shade(*normals)
    patterns = [ball.pattern for ball in painted_balls if ball.pattern is not None]
    # First the light common to all balls, then the mirror images in the remaining
    # light.
    light_weights, patterns = _shared_light(
        unlit_pictures, views.points, views.is_lit, patterns
    )
    common_ball = replace(common_ball, lamp_weights=light_weights)
    model = _paint_patterns(patterns, views.points, common_radius)
    model = model * common_ball.shade(*normals)
    gloss = _shared_gloss(views, model)
    fade = _shared_fade(views, model, gloss)
    common_ball = replace(common_ball, gloss=gloss, fade=fade)
    results = {}
    for ball, pattern in zip(painted_balls, patterns, strict=True):
        lit_ball = _in_common_light(ball, pattern, common_ball, common_radius)
        results[id(ball)] = paint_ball_skin(lit_ball)
    return [results.get(id(ball), ball) for ball in balls]


def _paint_patterns(
    patterns: Sequence[Pattern], points: NDArray[Any], radius: int
) -> NDArray[Any]:
    """Return the colours (n, h, w, 3) of patterns at points (h, w, 3)."""
    return np.stack([pattern.paint(points, 1 / radius) for pattern in patterns])


def _in_common_light(
    ball: Ball, pattern: Pattern, common_ball: Ball, common_radius: int
) -> Ball:
    """Return a ball with the gloss and the light of a common ball of another radius."""
    assert common_ball.fade is not None
    # Sample the common images back to the size and place of the ball.
    size = ball.skin.shape[1::-1]
    scale = common_radius / ball.radius
    shift = common_radius - scale * np.subtract(ball.center, ball.corner)
    return replace(
        ball,
        gloss=sample_picture(common_ball.gloss, size, scale, shift),
        fade=sample_picture(common_ball.fade, size, scale, shift),
        lamp_weights=common_ball.lamp_weights,
        trust=common_ball.trust,
        pattern=pattern,
    )


@dataclass(frozen=True)
class _BallViews:
    """Pictures of n balls at one size, (n, h, w)."""

    points: NDArray[Any]
    """Normals, (h, w, 3)."""
    pictures: F32
    """Linear light, (n, h, w, 3)."""
    is_lit: Mask
    """Whether no other ball reflects much light onto the pixel."""
    is_clear: Mask
    """Whether no other ball is mirrored in the pixel."""
    is_plain: Mask
    """Whether the pattern has one paint without writing here."""

    @classmethod
    def sample(
        cls, painted_balls: Sequence[Ball], balls: Sequence[Ball], radius: int
    ) -> _BallViews:
        """Sample painted balls at one radius, px."""
        size = (2 * radius + 1, 2 * radius + 1)
        points = sphere_points(size, (0, 0), (radius, radius), radius)
        pictures, masks = [], []
        for ball in painted_balls:
            # All balls are compared at one radius, pixel by pixel: the same pixel has
            # the same normal on each of them.
            corner = np.subtract(ball.center, ball.corner) - ball.radius
            pictures.append(
                sample_picture(ball.photo_light, size, ball.radius / radius, corner)
            )
            masks.append(_open(points, ball, balls))
        is_lit, is_clear, is_plain = (
            np.stack(part) for part in zip(*masks, strict=True)
        )
        return cls(points, np.stack(pictures), is_lit, is_clear, is_plain)


def _shared_gloss(views: _BallViews, model: F32) -> F32:
    """Return the mirror images (h, w, 3) of all balls, which are visible on
    dark paint.
    """
    is_dark = model < BALL.mirror_light
    excess = views.pictures - model
    is_clear = views.is_clear[..., None]
    is_plain = views.is_plain[..., None]
    gloss = np.maximum(_usual(excess, is_clear & is_dark, is_plain & is_dark), 0)
    is_clipped = views.pictures.min(axis=3, keepdims=True) > BALL.brightest_paint
    median_excess = np.median(np.where(is_clipped, 1, excess), axis=0)
    faces_viewer = views.points[..., 2:] ** 2 > 0.5
    return np.where(faces_viewer, np.clip(median_excess, 0, gloss), gloss)


def _shared_fade(views: _BallViews, model: F32, gloss: F32) -> F32:
    """Return the light of the rim over the model's, (h, w), and 1 inside."""
    is_dark = model < BALL.mirror_light
    share = (views.pictures - gloss) / np.maximum(model, BALL.least_light)
    share = np.clip(share, 1 / BALL.fades, BALL.fades)
    everywhere = np.ones_like(is_dark)
    usual_share = _usual(share, views.is_clear[..., None] & ~is_dark, everywhere)
    distance = np.hypot(views.points[..., 0], views.points[..., 1])
    is_rim = distance > BALL.rim_light
    return np.where(is_rim, usual_share.mean(axis=2), np.float32(1))


def _open(points: NDArray[Any], ball: Ball, balls: Sequence[Ball]) -> list[Mask]:
    """Return masks of a ball's pixels (h, w) without influence of other balls.

    They are: pixels without much light of others, pixels without mirror images of
    others, both only if plain, and the plain pixels: one paint without writing.
    """
    assert ball.pattern is not None
    writing, _ = ball.pattern.map_to_disc(points, 1e-3)
    has_one_paint = np.abs(ball.pattern.values(points)) > BALL.blur_width
    is_plain = has_one_paint & (writing[..., 0] == 0)
    is_lit = is_plain.copy()
    is_clear = is_plain.copy()
    viewer = np.array([0, 0, 1], np.float32)
    mirror_rays = 2 * points[..., 2:] * points - viewer
    for other in balls:
        x, y = np.subtract(other.center, ball.center)
        offset = np.array([x, y, other.radius - ball.radius]) / ball.radius
        distance = float(np.linalg.norm(offset))
        if distance <= 0:
            continue
        size = other.radius / ball.radius
        # The light of another sphere falls with the square of its distance, and with
        # the cosine of its direction to the normal.
        is_lit &= (points @ offset) * (size**2 / distance**3) < BALL.neighbour_light
        is_clear &= _misses_ball(points, mirror_rays, offset, size)
    return [is_lit if is_lit.any() else is_plain, is_clear, is_plain]


def _misses_ball(
    points: NDArray[Any], mirror_rays: NDArray[Any], offset: F64, size: float
) -> Mask:
    """Return the points (h, w) of a unit sphere that do not mirror another ball.

    A mirror image appears where the reflected ray of the viewer hits the other ball, at
    an `offset` and of a radius `size`.
    """
    ray = offset - points
    distance_along = (ray * mirror_rays).sum(axis=2)
    squared_distance = (ray * ray).sum(axis=2) - distance_along**2
    is_passing = squared_distance > (BALL.ray_distance * size) ** 2
    return np.asarray((distance_along < 0) | is_passing, np.bool_)


def _shared_light(
    unlit_paint: NDArray[Any],
    points: NDArray[Any],
    is_lit: Mask,
    patterns: Sequence[Pattern],
) -> tuple[F32, list[Pattern]]:
    """Find the weights (8, 3) of `basis` for the common light, and the patterns'
    colours in it.

    `unlit_paint` (n, h, w, 3): light of the balls over Lambert's shading, used at
    `is_lit`.
    """
    values = np.stack([pattern.values(points) for pattern in patterns])
    is_used = is_lit & (np.hypot(points[..., 0], points[..., 1]) < 0.99 * RIM)
    # Number all colours, two per pattern.
    number = (2 * np.arange(len(patterns))[:, None, None] + (values > 0))[is_used]
    numbers, paint = np.unique(number, return_inverse=True)
    light = np.maximum(unlit_paint[is_used], 0)
    level = np.log(light + np.float32(BALL.least_light)).astype(np.float64)
    directions = np.broadcast_to(points, unlit_paint.shape)[is_used].T
    rows = np.column_stack(basis(*directions)).astype(np.float64)
    light_weights = _robust_light(rows, level, paint)
    colours = np.stack([pattern.colours for pattern in patterns]).reshape(-1, 3)
    colours[numbers] = _paint_colours(light * np.exp(-rows @ light_weights), paint)
    _unite_common_paint(colours, number, len(patterns))
    result = []
    for k, pattern in enumerate(patterns):
        result.append(replace(pattern, colours=colours[2 * k : 2 * k + 2]))
    return light_weights.astype(np.float32), result


def _robust_light(rows: F64, level: F64, paint: Ids) -> F64:
    """Return the weights (8, 3) of `rows` that explain the log light `level` (n, 3).

    Iteratively reweighted least squares.
    """
    # Light is hardly visible on dark paint.
    visibility = 1 - BALL.least_light * np.exp(-level).mean(axis=1)
    light_weights = np.zeros((8, 3))
    pixel_weights = visibility
    for _ in range(BALL.rounds):
        light_weights = solve_weights(rows, level, paint, pixel_weights)
        errors = np.abs(
            deviations_from_median(level - rows @ light_weights, paint)
        ).max(axis=1)
        pixel_weights = visibility / np.maximum(errors / BALL.outlier_error, 1)
    return light_weights


def _paint_colours(unlit: F64, paint: Ids) -> F64:
    """Return the median of each paint, (K, 3).

    For dark paint, a low quantile, since some of it mirrors more light.
    """
    low_quantiles = average_each_paint(partial(np.quantile, q=0.2), unlit, paint)
    medians = average_each_paint(partial(np.quantile, q=0.5), unlit, paint)
    return np.where(medians < BALL.mirror_light, low_quantiles, medians)


def _unite_common_paint(colours: F32, number: Ids, patterns: int) -> None:
    """Set the most common paint of `colours` (K, 3) to its mean, in place.

    `number` (n,) is the colour of each pixel.
    """
    logarithm = np.log(colours + np.float32(BALL.least_light))
    grey = logarithm.mean(axis=1, keepdims=True)
    hue = logarithm - grey
    is_alike = np.abs(hue[:, None] - hue).max(axis=2) < BALL.hue_difference
    is_alike &= np.abs(grey - grey.T) < BALL.contrast
    is_common = is_alike[is_alike.sum(axis=1).argmax()]
    if 2 * is_common.sum() > patterns:
        counts = (
            np.bincount(number, minlength=len(colours))[is_common] + BALL.least_light
        )
        colours[is_common] = np.average(colours[is_common], axis=0, weights=counts)


def _usual(pictures: NDArray[Any], *masks: Mask) -> F32:
    """Return the usual value (h, w, 3) of pictures (n, h, w, 3).

    It is taken from the first mask with two pictures at a pixel; else the minimum.
    """
    result = pictures.min(axis=0)
    for mask in reversed(masks):
        count = mask.sum(axis=0)
        sorted_values = np.sort(np.where(mask, pictures, np.float32(np.inf)), axis=0)
        place = np.rint(BALL.usual * np.maximum(count - 1, 0)).astype(np.int64)
        quantile = np.take_along_axis(sorted_values, place[None], axis=0)[0]
        result = np.where(count > 1, quantile, result)
    return np.asarray(result, np.float32)
