"""Paints of balls, and the borders, stripes and discs between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64, Mask
from physgen.render.ball_tuning import BALL

Ids = NDArray[np.int64]
"""Number of the paint of each pixel, (n,)."""


def basis(u: F32, v: F32, z: F32) -> list[F32]:
    """Return real harmonics of degree 1 and 2 on the unit sphere: 8 pictures,
    unnormalised.
    """
    return [
        u,
        v,
        z - np.float32(0.5),
        u * v,
        u * z,
        v * z,
        u * u - v * v,
        3 * z * z - 1,
    ]


@dataclass(frozen=True)
class Paints:
    """The paints of a ball, and the light on it."""

    lamp_weights: F32
    """Weights of `basis`, (8, 3): log of each channel's light beyond Lambert's law."""
    colours: F32
    """Linear colours in full light, (K, 3)."""
    mixture_share: float
    """Largest share of pixels unlike all paints on a painted ball."""


def find_paints(unlit_colours: F32, u: F32, v: F32, z: F32, use: Mask) -> Paints | None:
    """Find a ball's paints and its light alternately; None for too few pixels.

    `unlit_colours` (h, w, 3) is light over Lambert's shading of the normals (u, v, z),
    from the pixels in `use`.
    """
    pixels = np.flatnonzero(use)
    if len(pixels) < 80:
        return None
    pixels = pixels[:: -(-len(pixels) // BALL.most_pixels)]
    light = np.maximum(unlit_colours.reshape(-1, 3)[pixels], 0)
    # In logarithms, light times paint is a sum, and linear least squares can separate
    # both.
    level: F64 = np.log(light + np.float32(BALL.least_light)).astype(np.float64)
    pictures = []
    for picture in basis(u, v, z):
        pictures.append(np.broadcast_to(picture, use.shape).ravel()[pixels])
    rows: F64 = np.column_stack(pictures).astype(np.float64)
    channels, paint_ids = _fit_light_and_paints(rows, level)
    unlit = np.maximum(np.exp(level - rows @ channels) - BALL.least_light, 0)
    order = np.argsort(-np.bincount(paint_ids), kind="stable")
    colours = average_each_paint(np.median, unlit, paint_ids)[order]
    # Pixels between paints are borders; many of them mean that the ball is not painted.
    distances = [np.abs(unlit - colour).max(axis=1) for colour in colours]
    is_unlike = np.min(distances, axis=0) > BALL.mixture_distance * colours.max()
    return Paints(
        channels.astype(np.float32),
        colours.astype(np.float32),
        float(is_unlike.mean()),
    )


def _fit_light_and_paints(rows: F64, level: F64) -> tuple[F64, Ids]:
    """Return the weights (8, 3) of each channel's light, and the paint of each pixel.

    `rows` (n, 8) are the values of `basis`, `level` (n, 3) the log light.
    """
    grey = level.mean(axis=1)
    # Begin with paints mainly by hue, which light changes little.
    hue = level - grey[:, None]
    paint_ids = _split(np.column_stack([2 * hue, 0.7 * grey]))
    light_weights = np.zeros(8)
    pixel_weights = np.ones(len(grey))
    for _ in range(BALL.rounds):
        errors = np.abs(deviations_from_median(grey - rows @ light_weights, paint_ids))
        pixel_weights = 1 / np.maximum(errors / BALL.outlier_error, 1)
        light_weights = solve_weights(rows, grey, paint_ids, pixel_weights)
        unlit = level - (rows @ light_weights)[:, None]
        paint_ids = _nearest(unlit, average_each_paint(np.median, unlit, paint_ids))
    # Then fit the light of each channel with these paints: coloured neighbours change
    # the colour of the light.
    remaining_light = level - (rows @ light_weights)[:, None]
    channels = solve_weights(rows, remaining_light, paint_ids, pixel_weights)
    return light_weights[:, None] + channels, paint_ids


def deviations_from_median(values: F64, paint: Ids) -> F64:
    """Subtract the median of its paint from each value (n, ...)."""
    return np.asarray(values - average_each_paint(np.median, values, paint)[paint])


def solve_weights(rows: F64, level: F64, paint: Ids, trust: F64) -> F64:
    """Return weights (8, ...) of `rows` (n, 8) that explain `level` (n, ...) within
    paints.

    Least squares. A constant over one paint is no light: each paint's mean is
    subtracted.
    """
    terms = rows.copy()
    target = level.copy()
    weight = trust[:, None]
    for k in range(paint.max() + 1):
        is_paint = paint == k
        own_trust = trust[is_paint]
        terms[is_paint] -= np.average(terms[is_paint], axis=0, weights=own_trust)
        target[is_paint] -= np.average(target[is_paint], axis=0, weights=own_trust)
    weighted_terms = (terms * weight).T
    # Ridge regression: the damping keeps terms small that the visible normals hardly
    # determine.
    damping = BALL.stiff * len(rows) * np.eye(rows.shape[1])
    # Normal equations of the weighted least squares.
    normal = weighted_terms @ terms + damping
    return np.asarray(np.linalg.solve(normal, weighted_terms @ target))


def average_each_paint(mean: Callable[..., Any], points: F64, paint: Ids) -> F64:
    """Return a mean or median of the points of each paint, (K, ...)."""
    numbers = range(paint.max() + 1)
    return np.array([mean(points[paint == k], axis=0) for k in numbers])


def _split(points: F64) -> Ids:
    """Return the paint of each point, by Lloyd's algorithm.

    Each start is a point far from the earlier ones.
    """
    middles = [np.median(points, axis=0)]
    for _ in range(BALL.paints - 1):
        # The next start is far from all paints so far.
        squares = [((points - middle) ** 2).sum(axis=1) for middle in middles]
        distance = np.min(squares, axis=0)
        # The very farthest point may be a highlight.
        farthest = np.argsort(distance)[int(0.97 * len(distance))]
        if distance[farthest] < 0.3**2:
            break
        middles.append(points[farthest])
    paint = _nearest(points, np.array(middles))
    for _ in range(4):
        paint = _nearest(points, average_each_paint(np.mean, points, paint))
    return paint


def _nearest(points: F64, centers: F64) -> Ids:
    """Return the number of the nearest centre; centres without points are dropped."""
    squares = np.stack([((points - center) ** 2).sum(axis=1) for center in centers])
    _, numbers = np.unique(np.argmin(squares, axis=0), return_inverse=True)
    return numbers.astype(np.int64).ravel()


RIM = 0.955
"""Distance from the centre, radii, beyond which pixels are mixed and too
foreshortened.
"""


@dataclass(frozen=True)
class Border:
    """A plane through a sphere, or two mirror-symmetric planes."""

    normal: F64
    """Unit normal (3,), z to the viewer."""
    distance: float
    """Distance from the centre, radii."""
    has_two_planes: bool
    """Whether there are two planes."""
    sign: float
    """Sign of `values` beyond."""

    def values(self, points: F64) -> F64:
        """Return the approximate signed distance (...) of points (..., 3) from the
        border, radii.
        """
        heights = points @ self.normal
        if self.has_two_planes:
            heights = np.abs(heights)
        slope = np.sqrt(max(1 - self.distance**2, 0.1))
        return np.asarray(self.sign * (heights - self.distance) / slope)


@dataclass(frozen=True)
class Pattern:
    """Two paints on a sphere: a band or a cut, and perhaps a disc with another at the
    antipode.
    """

    colours: F32
    """Linear colours (2, 3) at negative and at positive `values`."""
    border: Border
    disc: Border | None = None
    """Disc with the photo's pixels."""

    def values(self, points: F64) -> F64:
        """Return the approximate signed distance (...) of points (..., 3) from a
        border, radii.
        """
        values = self.border.values(points)
        if self.disc is None:
            return values
        sign = -np.sign(self.border.values(self.disc.normal))
        return np.asarray(sign * np.maximum(sign * values, self.disc.values(points)))

    def paint(self, points: F64, softness: float) -> F32:
        """Return the colours (..., 3) of points (..., 3); a border is `softness` radii
        wide.
        """
        share = np.clip(0.5 + self.values(points) / softness, 0, 1)
        first, second = self.colours
        mixed_colours = first + share[..., None].astype(np.float32) * (second - first)
        return np.asarray(mixed_colours, np.float32)

    def map_to_disc(self, points: F64, softness: float) -> tuple[F32, F64]:
        """Return the share (..., 1) of points (..., 3) in a disc, and their source
        places (..., 3).

        The disc at the antipode is rotated by half a turn about the band's normal, so
        that its number can be read.
        """
        if self.disc is None:
            return np.zeros((*points.shape[:-1], 1), np.float32), points
        middle = self.disc.normal
        upward = self.border.normal
        # Remove the part along the middle (Gram and Schmidt), so that the axis lies in
        # the plane of the disc.
        upward = upward - (upward @ middle) * middle
        upward = upward / np.linalg.norm(upward)
        # The rear shows the same disc, turned by half a turn about the vertical.
        rear_places = 2 * (points @ upward)[..., None] * upward - points
        is_front = (points @ middle)[..., None] > 0
        places = np.where(is_front, points, rear_places)
        # A border of the width `softness` avoids stairs around the disc; places at the
        # rim of the photo are too oblique to read.
        share = np.clip(self.disc.values(points) / softness - 0.5, 0, 1)
        share = share * (places[..., 2] > BALL.view_cosine)
        return share[..., None].astype(np.float32), places


def find_pattern(skin: F32, colours: F32, points: F64) -> Pattern | None:
    """Find the pattern of a `skin` (n, 3) at `points` (n, 3) with `colours` (K, 3).

    The most frequent colour is first. None if no pattern explains the skin.
    """
    pair = _contrasting_pair(skin, colours)
    if pair is None:
        return None
    step = (pair[1] - pair[0]).astype(np.float64)
    # Project each colour on the line between both paints.
    share = (skin - pair[0]) @ step / (step @ step)
    nearest_mixture = np.clip(share, 0, 1)[:, None] * step
    distance = np.linalg.norm(skin - pair[0] - nearest_mixture, axis=1)
    is_paint = distance < BALL.line_distance * np.linalg.norm(step)
    if not is_paint.any():
        return None
    value = np.where(share > 0.5, 1.0, -1.0)[is_paint]
    places = points[is_paint]
    # Try a symmetric band and a single cut; prefer the band unless the cut explains
    # clearly more.
    share_band, border = _border(places, value, has_two_planes=True)
    share_cut, cut = _border(places, value, has_two_planes=False)
    if share_cut > share_band + BALL.cut_share:
        border = cut
    pattern = _with_disc(Pattern(pair, border), places, value)
    explained_count = (value * pattern.values(places) > 0).sum()
    return pattern if explained_count > BALL.pattern_share * len(skin) else None


def _contrasting_pair(skin: F32, colours: F32) -> F32 | None:
    """Return the first colour and the most frequent one far from it, (2, 3).

    None if all are similar.
    """
    first = colours[0]
    nearest = np.abs(skin[:, None] - colours).max(axis=2).argmin(axis=1)
    counts = np.bincount(nearest, minlength=len(colours))
    logarithms = np.log((colours + BALL.least_light) / (first + BALL.least_light))
    is_other = np.abs(logarithms).max(axis=1) >= BALL.contrast
    if not is_other.any():
        return None
    squares = ((colours - first) ** 2).sum(axis=1)
    # The second paint is frequent and far from the first in colour.
    second = colours[np.argmax(is_other * counts * squares)]
    return np.stack([first, second])


def _with_disc(pattern: Pattern, places: F64, value: F64) -> Pattern:
    """Add a disc to a pattern if it then explains more of the signs `value` (n,) at
    `places`.
    """
    border = pattern.border
    is_right = value * pattern.values(places) > 0
    share, disc = _border(places, np.where(is_right, -1.0, 1.0), has_two_planes=True)
    is_disc = disc.sign > 0 and disc.distance > BALL.disc
    is_marked = is_disc and share > is_right.mean() + BALL.disc_share
    if border.has_two_planes and border.distance > BALL.disc:
        # A band of this size is a disc, and the rest of the ball has one paint, unless
        # a disc lies between its two caps.
        is_between = abs(float(border.normal @ disc.normal)) < BALL.disc_cosine
        if is_marked and is_between:
            return replace(pattern, disc=disc)
        axis = np.eye(3)[np.abs(border.normal).argmin()]
        nowhere = replace(border, normal=axis, distance=2.0)
        return Pattern(pattern.colours, nowhere, replace(border, sign=1.0))
    if not is_marked:
        return pattern
    return replace(pattern, disc=disc)


def _border(points: F64, value: F64, *, has_two_planes: bool) -> tuple[float, Border]:
    """Return the best border of `points` (n, 3) by their `value` (n,), 1 or -1, and its
    share.

    The share is that of correctly separated points.
    """
    steps = BALL.steps if has_two_planes else 2 * BALL.steps
    axes = _spiral(BALL.axes)
    stride = -(-len(value) // BALL.most_pixels)
    # Search a coarse grid of directions on few points, then finer grids around the
    # best.
    for width in BALL.closer:
        heights = points[::stride] @ axes.T
        share = np.abs(heights) if has_two_planes else (heights + 1) / 2
        gain = _separation_gain(share, value[::stride], steps)
        best, step = np.unravel_index(np.argmax(np.abs(gain)), gain.shape)
        normal = axes[best]
        largest = gain[best, step]
        place = (step + 1) / steps
        axes = _axes_around(normal, width)
        stride = 1
    distance = float(place if has_two_planes else 2 * place - 1)
    border = Border(normal, distance, has_two_planes, float(np.sign(largest)))
    return 0.5 + abs(largest) / (2 * len(value)), border


def _spiral(count: int) -> F64:
    """Return `count` directions (n, 3), evenly over a hemisphere."""
    k = np.arange(count) + 0.5
    height = k / count
    turn = np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - height**2)
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), height])


def _separation_gain(share: F64, value: F64, steps: int) -> F64:
    """Return (axes, steps): the sum of `value` (n,) beyond a border minus that within.

    `share` (n, axes): places of the points along each axis, 0..1.
    """
    axes = share.shape[1]
    cell = np.minimum((steps * share).astype(np.int64), steps - 1)
    cell = cell + steps * np.arange(axes)
    weights = np.broadcast_to(value[:, None], cell.shape).ravel()
    sums = np.bincount(cell.ravel(), weights, steps * axes)
    sums_within = sums.reshape(-1, steps).cumsum(axis=1)
    return np.asarray(sums_within[:, -1:] - 2 * sums_within)


def _axes_around(normal: F64, width: float) -> F64:
    """Return unit vectors (25, 3) around a normal, up to `width` rad away."""
    shift = width * np.linspace(-1, 1, 5)
    first_tangent, second_tangent = np.linalg.svd(normal[None])[2][1:]
    offsets = shift[:, None, None] * first_tangent + shift[:, None] * second_tangent
    axes = normal + offsets.reshape(-1, 3)
    return np.asarray(axes / np.linalg.norm(axes, axis=1)[:, None])
