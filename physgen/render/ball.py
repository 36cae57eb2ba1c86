"""A sphere in the photo: its colour without light, its gloss, and its shading.

The colour turns with the ball; shading and highlights stay with the light. A ball has
few paints: if each pixel's paint is known, the remaining smooth change over the ball is
light; if the light is known, paints can be separated. Both are found alternately, in
logarithms. If a band, a cut or a disc explains the near side, the whole ball is painted
with it; otherwise a point of the far side has the colour of its antipode.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64, Mask
from physgen.photometry import DistantLight
from physgen.render.sphere_texture import part_highlights
from physgen.scene.scene import View

Ids = NDArray[np.int64]
"""Number of the paint of each pixel, (n,)."""


@dataclass(frozen=True)
class BallTuning:
    """Thresholds of the separation of a ball into colour, gloss and shading."""

    paints: int = 5
    """Maximum number of paints on one ball."""
    dim: float = 0.03
    """Smallest linear light at which colours separate paints."""
    most_pixels: int = 500
    """Maximum number of sampled pixels of a ball."""
    rounds: int = 4
    stiff: float = 0.02
    """Weight of Lambert's shading, in shares of the ball's pixels."""
    odd: float = 0.15
    """Error in log light above which a pixel counts less: a highlight, a seam."""
    undecided: float = 0.08
    """Distance from all paints, relative to the brightest, above which a pixel is a
    mixture.
    """
    excess: float = 1.3
    """Light relative to the paint above which a pixel is a reflection."""
    most_departure: float = 1.0
    """Maximum departure from Lambert's law, in log light."""
    darkest: float = 0.18
    """Share of full light below which the photo's darkness belongs to the skin."""
    painted: float = 0.5
    """Share of mixed pixels below which a ball counts as painted."""
    plainly: float = 0.6
    """Slope of brightness over predicted shading above which the light is used
    fully.
    """
    rim_light: float = 0.85
    """Distance from the centre, radii, beyond which brightness differs from the
    model.
    """
    even: float = 0.08
    """Width of its smoothing, radii."""
    fades: float = 1.6
    """Maximum ratio to the model."""
    smooth: float = 0.15
    """Width over which a difference from the paints is light, radii."""
    plain: float = 0.2
    """Error of a linear change of log light up to which a ball has one colour."""
    gloss_width: float = 0.5
    """Maximum width of a highlight, radii."""
    line_width: float = 0.25
    """Maximum width of the lines of a number, radii."""
    gloss_least: float = 0.6
    """Minimum linear light of a highlight's dimmest channel."""
    outshines: float = 1.2
    """Minimum brightness of a highlight, relative to the brightest paint elsewhere on
    the ball.
    """
    clipped: float = 0.9
    """Linear light that hardly any paint reflects."""
    axes: int = 400
    """Number of directions in the search for borders of two paints."""
    steps: int = 64
    """Number of places of a border along each direction."""
    lopsided: float = 0.01
    """Minimum share of pixels that a cut explains in addition to a band."""
    closer: tuple[float, ...] = (0.08, 0.03, 0.01, 0.0)
    """Search ranges around the best direction in later rounds, rad."""
    disc: float = 0.8
    """Minimum cosine of a disc's radius."""
    seen: float = 0.2
    """Cosine to the viewer above which writing is readable in the photo."""
    marked: float = 0.015
    """Minimum share of pixels that a disc explains."""
    explained: float = 0.8
    """Minimum share of pixels that a pattern explains."""
    contrast: float = 1.0
    """Minimum difference of two paints in log light of some channel."""
    together: int = 5
    """Minimum number of balls to tell lamps from neighbouring balls."""
    usual: float = 0.35
    """Quantile of the light on several balls: neighbours and errors add more often than
    they subtract.
    """
    lent: float = 0.05
    """Share of a normal's light by a neighbour up to which a ball counts as alone."""
    beyond: float = 1.1
    """Distance of a ray from a neighbour's centre, radii, above which it does not meet
    it.
    """
    dark: float = 0.1
    """Linear light of paint up to which mirror images are visible on it."""
    alike: float = 0.25
    """Difference of hues in log light up to which paints of several balls are one."""
    beside: float = 0.4
    """Distance from the line between two paints, relative to its length, above which a
    pixel is neither.
    """
    gloss_cosine: float = 0.80
    """Minimum cosine between a highlight's normal and the mirror direction."""


BALL = BallTuning()


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

    even: F32
    """Weights of `basis`, (8, 3): log of each channel's light beyond Lambert's law."""
    colours: F32
    """Linear colours in full light, (K, 3)."""
    between: float
    """Largest share of pixels unlike all paints on a painted ball."""


def find_paints(bare: F32, u: F32, v: F32, z: F32, use: Mask) -> Paints | None:
    """Find a ball's paints and its light alternately; None for too few pixels.

    `bare` (h, w, 3) is light over Lambert's shading of the normals (u, v, z), from the
    pixels in `use`.
    """
    pixels = np.flatnonzero(use)
    if len(pixels) < 80:
        return None
    pixels = pixels[:: -(-len(pixels) // BALL.most_pixels)]
    light = np.maximum(bare.reshape(-1, 3)[pixels], 0)
    level: F64 = np.log(light + np.float32(BALL.dim)).astype(np.float64)
    pictures = [np.broadcast_to(b, use.shape).ravel()[pixels] for b in basis(u, v, z)]
    rows: F64 = np.column_stack(pictures).astype(np.float64)
    grey = level.mean(axis=1)
    # Begin with paints mainly by hue, which light changes little.
    paint_ids = _split(np.column_stack([2 * (level - grey[:, None]), 0.7 * grey]))
    light_weights, pixel_weights = np.zeros(8), np.ones(len(grey))
    for _ in range(BALL.rounds):
        errors = np.abs(_from_median(grey - rows @ light_weights, paint_ids))
        pixel_weights = 1 / np.maximum(errors / BALL.odd, 1)
        light_weights = _solve_weights(rows, grey, paint_ids, pixel_weights)
        unlit = level - (rows @ light_weights)[:, None]
        paint_ids = _nearest(unlit, _average_each_paint(np.median, unlit, paint_ids))
    # Then fit the light of each channel with these paints: coloured neighbours change
    # the
    # colour of the light.
    channels = _solve_weights(
        rows, level - (rows @ light_weights)[:, None], paint_ids, pixel_weights
    )
    channels = light_weights[:, None] + channels
    unlit = np.maximum(np.exp(level - rows @ channels) - BALL.dim, 0)
    order = np.argsort(-np.bincount(paint_ids), kind="stable")
    colours = _average_each_paint(np.median, unlit, paint_ids)[order]
    distances = [np.abs(unlit - colour).max(axis=1) for colour in colours]
    is_unlike = np.min(distances, axis=0) > BALL.undecided * colours.max()
    return Paints(
        channels.astype(np.float32),
        colours.astype(np.float32),
        float(is_unlike.mean()),
    )


def _from_median(values: F64, paint: Ids) -> F64:
    """Subtract the median of its paint from each value (n, ...)."""
    return np.asarray(values - _average_each_paint(np.median, values, paint)[paint])


def _solve_weights(rows: F64, level: F64, paint: Ids, trust: F64) -> F64:
    """Return weights (8, ...) of `rows` (n, 8) that explain `level` (n, ...) within
    paints.

    Least squares. A constant over one paint is no light: each paint's mean is
    subtracted.
    """
    terms, target, weight = rows.copy(), level.copy(), trust[:, None]
    for k in range(paint.max() + 1):
        is_paint = paint == k
        own_trust = trust[is_paint]
        terms[is_paint] -= np.average(terms[is_paint], axis=0, weights=own_trust)
        target[is_paint] -= np.average(target[is_paint], axis=0, weights=own_trust)
    weighted_terms = (terms * weight).T
    normal = weighted_terms @ terms + BALL.stiff * len(rows) * np.eye(rows.shape[1])
    return np.asarray(np.linalg.solve(normal, weighted_terms @ target))


def _average_each_paint(mean: Callable[..., Any], points: F64, paint: Ids) -> F64:
    """Return a mean or median of the points of each paint, (K, ...)."""
    numbers = range(paint.max() + 1)
    return np.array([mean(points[paint == k], axis=0) for k in numbers])


def _split(points: F64) -> Ids:
    """Return the paint of each point, by Lloyd's algorithm.

    Each start is a point far from the earlier ones.
    """
    middles = [np.median(points, axis=0)]
    for _ in range(BALL.paints - 1):
        squares = [((points - middle) ** 2).sum(axis=1) for middle in middles]
        distance = np.min(squares, axis=0)
        # The very farthest point may be a highlight.
        farthest = np.argsort(distance)[int(0.97 * len(distance))]
        if distance[farthest] < 0.3**2:
            break
        middles.append(points[farthest])
    paint = _nearest(points, np.array(middles))
    for _ in range(4):
        paint = _nearest(points, _average_each_paint(np.mean, points, paint))
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
    at: float
    """Distance from the centre, radii."""
    folded: bool
    """Whether there are two planes."""
    sign: float
    """Sign of `values` beyond."""

    def values(self, points: F64) -> F64:
        """Return the approximate signed distance (...) of points (..., 3) from the
        border, radii.
        """
        heights = points @ self.normal
        if self.folded:
            heights = np.abs(heights)
        slope = np.sqrt(max(1 - self.at**2, 0.1))
        return np.asarray(self.sign * (heights - self.at) / slope)


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

    def painted(self, points: F64, soft: float) -> F32:
        """Return the colours (..., 3) of points (..., 3); a border is `soft` radii
        wide.
        """
        share = np.clip(0.5 + self.values(points) / soft, 0, 1)
        first, second = self.colours
        mixed_colours = first + share[..., None].astype(np.float32) * (second - first)
        return np.asarray(mixed_colours, np.float32)

    def written(self, points: F64, soft: float) -> tuple[F32, F64]:
        """Return the share (..., 1) of points (..., 3) in a disc, and their source
        places (..., 3).

        The disc at the antipode is rotated by half a turn about the band's normal, so
        that its number can be read.
        """
        if self.disc is None:
            return np.zeros((*points.shape[:-1], 1), np.float32), points
        middle, upward = self.disc.normal, self.border.normal
        upward = upward - (upward @ middle) * middle
        upward = upward / np.linalg.norm(upward)
        # The rear shows the same disc, turned by half a turn about the vertical.
        rear_places = 2 * (points @ upward)[..., None] * upward - points
        is_front = (points @ middle)[..., None] > 0
        places = np.where(is_front, points, rear_places)
        share = np.clip(self.disc.values(points) / soft - 0.5, 0, 1)
        share = share * (places[..., 2] > BALL.seen)
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
    is_paint = distance < BALL.beside * np.linalg.norm(step)
    if not is_paint.any():
        return None
    value = np.where(share > 0.5, 1.0, -1.0)[is_paint]
    places = points[is_paint]
    # Try a symmetric band and a single cut; prefer the band unless the cut explains
    # clearly more.
    share_band, border = _border(places, value, folded=True)
    share_cut, cut = _border(places, value, folded=False)
    if share_cut > share_band + BALL.lopsided:
        border = cut
    pattern = _with_disc(Pattern(pair, border), places, value)
    explained_count = (value * pattern.values(places) > 0).sum()
    return pattern if explained_count > BALL.explained * len(skin) else None


def _contrasting_pair(skin: F32, colours: F32) -> F32 | None:
    """Return the first colour and the most frequent one far from it, (2, 3).

    None if all are similar.
    """
    first = colours[0]
    nearest = np.abs(skin[:, None] - colours).max(axis=2).argmin(axis=1)
    counts = np.bincount(nearest, minlength=len(colours))
    logarithms = np.log((colours + BALL.dim) / (first + BALL.dim))
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
    if border.folded and border.at > BALL.disc:
        # A band of this size is a disc, and the rest of the ball has one paint.
        axis = np.eye(3)[np.abs(border.normal).argmin()]
        nowhere = replace(border, normal=axis, at=2.0)
        return Pattern(pattern.colours, nowhere, replace(border, sign=1.0))
    is_right = value * pattern.values(places) > 0
    share, disc = _border(places, np.where(is_right, -1.0, 1.0), folded=True)
    is_disc = disc.sign > 0 and disc.at > BALL.disc
    if is_disc and share > is_right.mean() + BALL.marked:
        return replace(pattern, disc=disc)
    return pattern


def _border(points: F64, value: F64, *, folded: bool) -> tuple[float, Border]:
    """Return the best border of `points` (n, 3) by their `value` (n,), 1 or -1, and its
    share.

    The share is that of correctly separated points.
    """
    steps = BALL.steps if folded else 2 * BALL.steps
    axes = _spiral(BALL.axes)
    stride = -(-len(value) // BALL.most_pixels)
    # Search a coarse grid of directions on few points, then finer grids around the
    # best.
    for width in BALL.closer:
        heights = points[::stride] @ axes.T
        share = np.abs(heights) if folded else (heights + 1) / 2
        gain = _separation_gain(share, value[::stride], steps)
        best, step = np.unravel_index(np.argmax(np.abs(gain)), gain.shape)
        normal, largest, place = axes[best], gain[best, step], (step + 1) / steps
        axes = _axes_around(normal, width)
        stride = 1
    distance = float(place if folded else 2 * place - 1)
    border = Border(normal, distance, folded, float(np.sign(largest)))
    return 0.5 + abs(largest) / (2 * len(value)), border


def _spiral(count: int) -> F64:
    """Return `count` directions (n, 3), evenly over a hemisphere."""
    k = np.arange(count) + 0.5
    height, turn = k / count, np.pi * (1 + 5**0.5) * k
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
    seen: F32
    """Linear light in the photo, (h, w, 3), continued beyond the rim."""
    even: F32 | None = None
    """Weights (8, 3) of `basis`: log of light beyond Lambert's law."""
    trust: float = 1.0
    """Visibility of the light on the ball in the photo, 0..1: a power of Lambert's
    shading.
    """
    pattern: Pattern | None = None
    """Pattern of a ball in the top view."""
    fade: F32 | None = None
    """Fixed factor (h, w) of the light at the rim."""
    is_continued: bool = False
    """Whether its far side continues the texture of the near side."""

    def shade(self, u: F32, v: F32, z: F32) -> F32:
        """Return the shading (h, w, 3) of normals (u, v, z to the viewer)."""
        shading = sphere_shading(self.light, u, v, z)[..., None]
        if self.trust < 1:
            shading = np.power(shading, np.float32(self.trust))
        if self.even is None:
            return shading
        harmonics = np.stack(np.broadcast_arrays(*basis(u, v, z)), axis=-1)
        limit = BALL.most_departure
        departure = np.clip(harmonics @ self.even, -limit, limit)
        return np.asarray(shading * np.exp(departure), np.float32)

    @cached_property
    def lit(self) -> F32:
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
    is_painted: bool = True,
) -> Ball:
    """Separate a ball into skin, gloss and shading.

    `colour` (h, w, 3) is its linear light on a box at `corner`. In the top view a ball
    turns its far side up; in the side view it turns in the picture, and its near side
    suffices. If `is_painted`, the far side has the pattern of billiard balls; otherwise
    it continues the texture.
    """
    normals = _Normals(*normals_within(colour.shape, corner, center, radius))
    inner_light = _carry_light_inwards(colour, corner, center, radius, normals)
    shine = _gloss(inner_light, *normals.parts, radius, light)
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
    paints = find_paints(ball.skin, *normals.parts, use)
    if paints is not None and paints.between < BALL.painted:
        has_pattern = view is View.TOP and is_painted
        ball, smooth_light = _with_paints(ball, paints, normals, use, has_pattern)
    if _plain(ball.skin, *normals.parts, normals.inside):
        # A ball of one colour looks the same after any rotation: all unevenness is
        # light,
        # and stays.
        median = np.median(ball.skin[normals.inside], axis=0)
        skin = np.broadcast_to(median, ball.skin.shape).copy()
        ball = replace(ball, skin=skin, pattern=None)
        return replace(ball, gloss=colour - ball.skin * ball.lit)
    if view is View.TOP and not is_painted:
        ball = _without_highlights(ball, normals.inside)
    return replace(ball, fade=_rim_light(ball, colour, normals, smooth_light))


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
    radius, inner_light, shine = ball.radius, ball.seen, ball.gloss
    ball = replace(ball, even=paints.even)
    shade = ball.shade(*normals.parts)
    skin = (inner_light - shine) / shade
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    distances = [np.abs(skin - paint).max(axis=2) for paint in paints.colours]
    paint = np.argmin(distances, axis=0).astype(np.uint8)
    # The median removes details narrower than 2 px.
    painted_skin = paints.colours[cv2.medianBlur(paint, 3)]
    pattern = None
    if has_pattern:
        points = _points(inner_light.shape, ball.corner, ball.center, radius)
        pattern = find_pattern(skin[use], paints.colours, points[use])
        if pattern is not None:
            painted_skin = pattern.painted(points, 1 / radius)
            shine = np.minimum(shine, np.maximum(inner_light - painted_skin * shade, 0))
            skin = (inner_light - shine) / shade
    excess = np.maximum(skin - BALL.excess * cv2.dilate(painted_skin, cross), 0)
    # A thin line is paint, not a reflection.
    excess = cv2.morphologyEx(excess, cv2.MORPH_OPEN, cross)
    skin, shine = skin - excess, shine + excess * shade
    smooth_light = np.ones_like(normals.rho)
    if pattern is None:
        is_within = (normals.rho < 1).astype(np.float32)
        brightness, flat_brightness = skin.mean(axis=2), painted_skin.mean(axis=2)
        sigma = BALL.smooth * radius
        smooth_light = blurred_share(brightness, flat_brightness, is_within, sigma)
        skin = skin / smooth_light[..., None]
    else:
        skin = _paint_ball_skin(replace(ball, gloss=shine, pattern=pattern)).skin
    return replace(ball, skin=skin, gloss=shine, pattern=pattern), smooth_light


def _rim_light(ball: Ball, colour: F32, normals: _Normals, soft: F32) -> F32:
    """Return the photo's light over the model's at the rim, (h, w), and `soft` inside.

    The difference at the rim is light and stays: in brightness, not in colours.
    """
    model = (ball.skin * ball.lit).mean(axis=2)
    brightness = (colour - ball.gloss).mean(axis=2)
    is_within = (normals.rho < 1).astype(np.float32)
    sigma = max(1.0, BALL.even * ball.radius)
    share = blurred_share(brightness, model, is_within, sigma)
    is_rim = normals.rho > BALL.rim_light
    return np.asarray(np.where(is_rim, share, soft), np.float32)


def _without_highlights(ball: Ball, inside: Mask) -> Ball:
    """Move highlights from the skin to the gloss; the far side continues the skin."""
    skin = part_highlights(ball.skin, inside, ball.radius)
    gloss = ball.gloss + (ball.skin - skin) * ball.lit
    return replace(ball, skin=skin, gloss=gloss, is_continued=True)


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
    share = (blurred_brightness + np.float32(BALL.dim)) / (
        blurred_model + np.float32(BALL.dim)
    )
    return np.asarray(np.clip(share, 1 / BALL.fades, BALL.fades), np.float32)


def in_one_light(balls: Sequence[Ball]) -> list[Ball]:
    """Return painted balls in their common light.

    Common are the brightness of each normal, and the mirror images of lamps, windows
    and the table, taken from balls without a near or mirrored neighbour. The paint that
    most balls have in common gets one colour.
    """
    painted_balls = [ball for ball in balls if ball.pattern is not None]
    if len(painted_balls) < BALL.together:
        return list(balls)
    common_radius = max(round(ball.radius) for ball in painted_balls)
    # Resample all balls to one radius, so that their pixels have common normals.
    views = _BallViews.of(painted_balls, balls, common_radius)
    trust = float(np.median([ball.trust for ball in painted_balls]))
    common_ball = replace(painted_balls[0], trust=trust, even=None)
    shade = common_ball.shade(*np.moveaxis(views.points, 2, 0))
    patterns = [ball.pattern for ball in painted_balls if ball.pattern is not None]
    # First the light common to all balls, then the mirror images in the remaining
    # light.
    light_weights, patterns = _shared_light(
        views.pictures / shade, views.points, views.is_lit, patterns
    )
    common_ball = replace(common_ball, even=light_weights)
    shade = common_ball.shade(*np.moveaxis(views.points, 2, 0))
    painted_pictures = [
        pattern.painted(views.points, 1 / common_radius) for pattern in patterns
    ]
    model = np.stack(painted_pictures) * shade
    gloss = _shared_gloss(views, model)
    fade = _shared_fade(views, model, gloss)
    # Sample the common images back to the size and place of each ball.
    results = {}
    for ball, pattern in zip(painted_balls, patterns, strict=True):
        size, scale = ball.skin.shape[1::-1], common_radius / ball.radius
        shift = common_radius - scale * np.subtract(ball.center, ball.corner)
        lit_ball = replace(
            ball,
            gloss=_sampled(gloss, size, scale, shift),
            fade=_sampled(fade, size, scale, shift),
            even=light_weights,
            trust=trust,
            pattern=pattern,
        )
        results[id(ball)] = _paint_ball_skin(lit_ball)
    return [results.get(id(ball), ball) for ball in balls]


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
    def of(
        cls, painted: Sequence[Ball], balls: Sequence[Ball], half: int
    ) -> _BallViews:
        """Sample painted balls at a radius of `half` px."""
        size = (2 * half + 1, 2 * half + 1)
        points = _points(size, (0, 0), (half, half), half)
        pictures, masks = [], []
        for ball in painted:
            corner = np.subtract(ball.center, ball.corner) - ball.radius
            pictures.append(_sampled(ball.seen, size, ball.radius / half, corner))
            masks.append(_open(points, ball, balls))
        is_lit, is_clear, is_plain = (
            np.stack(part) for part in zip(*masks, strict=True)
        )
        return cls(points, np.stack(pictures), is_lit, is_clear, is_plain)


def _shared_gloss(views: _BallViews, model: F32) -> F32:
    """Return the mirror images (h, w, 3) of all balls, which are visible on
    dark paint.
    """
    is_dark = model < BALL.dark
    excess = views.pictures - model
    is_clear, is_plain = views.is_clear[..., None], views.is_plain[..., None]
    gloss = np.maximum(_usual(excess, is_clear & is_dark, is_plain & is_dark), 0)
    is_clipped = views.pictures.min(axis=3, keepdims=True) > BALL.clipped
    median_excess = np.median(np.where(is_clipped, 1, excess), axis=0)
    faces_viewer = views.points[..., 2:] ** 2 > 0.5
    return np.where(faces_viewer, np.clip(median_excess, 0, gloss), gloss)


def _shared_fade(views: _BallViews, model: F32, gloss: F32) -> F32:
    """Return the light of the rim over the model's, (h, w), and 1 inside."""
    is_dark = model < BALL.dark
    share = (views.pictures - gloss) / np.maximum(model, BALL.dim)
    share = np.clip(share, 1 / BALL.fades, BALL.fades)
    everywhere = np.ones_like(is_dark)
    usual_share = _usual(share, views.is_clear[..., None] & ~is_dark, everywhere)
    distance = np.hypot(views.points[..., 0], views.points[..., 1])
    is_rim = distance > BALL.rim_light
    return np.where(is_rim, usual_share.mean(axis=2), np.float32(1))


def _paint_ball_skin(ball: Ball) -> Ball:
    """Return a ball with the skin of its pattern, and the writing of the photo
    on it.
    """
    assert ball.pattern is not None
    points = _points(ball.skin.shape, ball.corner, ball.center, ball.radius)
    border = 1 / ball.radius
    painted_skin = ball.pattern.painted(points, border)
    skin = (ball.seen - ball.gloss) / ball.lit
    brightest = ball.pattern.colours.max(axis=0)
    ink = np.clip(skin, 0, brightest) - painted_skin
    share, _ = ball.pattern.written(points, border)
    return replace(ball, skin=np.asarray(painted_skin + share * ink, np.float32))


def _points(
    shape: tuple[int, ...],
    corner: tuple[int, int],
    center: tuple[float, float],
    radius: float,
) -> NDArray[Any]:
    """Return the normals (h, w, 3), as `normals_within`."""
    u, v, z, _ = normals_within(shape, corner, center, radius)
    return np.stack(np.broadcast_arrays(u, v, z), axis=-1)


def _sampled(picture: F32, size: Sequence[int], scale: float, shift: F64) -> F32:
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


def _open(points: NDArray[Any], ball: Ball, balls: Sequence[Ball]) -> list[Mask]:
    """Return masks of a ball's pixels (h, w) without influence of other balls.

    They are: pixels without much light of others, pixels without mirror images of
    others, both only if plain, and the plain pixels: one paint without writing.
    """
    assert ball.pattern is not None
    writing, _ = ball.pattern.written(points, 1e-3)
    has_one_paint = np.abs(ball.pattern.values(points)) > BALL.even
    is_plain = has_one_paint & (writing[..., 0] == 0)
    is_lit, is_clear = is_plain.copy(), is_plain.copy()
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
        is_lit &= (points @ offset) * (size**2 / distance**3) < BALL.lent
        ray = offset - points
        # A mirror image appears where the reflected ray of the viewer hits the other
        # ball.
        distance_along = (ray * mirror_rays).sum(axis=2)
        is_passing = (ray * ray).sum(axis=2) - distance_along**2 > (
            BALL.beyond * size
        ) ** 2
        is_clear &= (distance_along < 0) | is_passing
    return [is_lit if is_lit.any() else is_plain, is_clear, is_plain]


def _shared_light(
    bare: NDArray[Any],
    points: NDArray[Any],
    is_lit: Mask,
    patterns: Sequence[Pattern],
) -> tuple[F32, list[Pattern]]:
    """Find the weights (8, 3) of `basis` for the common light, and the patterns'
    colours in it.

    `bare` (n, h, w, 3): light of the balls over Lambert's shading, used at `is_lit`.
    """
    values = np.stack([pattern.values(points) for pattern in patterns])
    distance = np.hypot(points[..., 0], points[..., 1])
    is_used = is_lit & (distance < 0.99 * RIM)
    # Number all colours, two per pattern.
    number = (2 * np.arange(len(patterns))[:, None, None] + (values > 0))[is_used]
    numbers, paint = np.unique(number, return_inverse=True)
    light = np.maximum(bare[is_used], 0)
    level = np.log(light + np.float32(BALL.dim)).astype(np.float64)
    directions = np.broadcast_to(points, bare.shape)[is_used].T
    rows = np.column_stack(basis(*directions)).astype(np.float64)
    light_weights = _robust_light(rows, level, paint)
    unlit = light * np.exp(-rows @ light_weights)
    colours = np.stack([pattern.colours for pattern in patterns]).reshape(-1, 3)
    colours[numbers] = _paint_colours(unlit, paint)
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
    visibility = 1 - BALL.dim * np.exp(-level).mean(axis=1)
    light_weights, pixel_weights = np.zeros((8, 3)), visibility
    for _ in range(BALL.rounds):
        light_weights = _solve_weights(rows, level, paint, pixel_weights)
        errors = np.abs(_from_median(level - rows @ light_weights, paint)).max(axis=1)
        pixel_weights = visibility / np.maximum(errors / BALL.odd, 1)
    return light_weights


def _paint_colours(unlit: F64, paint: Ids) -> F64:
    """Return the median of each paint, (K, 3).

    For dark paint, a low quantile, since some of it mirrors more light.
    """
    low_quantiles = _average_each_paint(partial(np.quantile, q=0.2), unlit, paint)
    medians = _average_each_paint(partial(np.quantile, q=0.5), unlit, paint)
    return np.where(medians < BALL.dark, low_quantiles, medians)


def _unite_common_paint(colours: F32, number: Ids, patterns: int) -> None:
    """Set the most common paint of `colours` (K, 3) to its mean, in place.

    `number` (n,) is the colour of each pixel.
    """
    logarithm = np.log(colours + np.float32(BALL.dim))
    grey = logarithm.mean(axis=1, keepdims=True)
    hue = logarithm - grey
    is_alike = np.abs(hue[:, None] - hue).max(axis=2) < BALL.alike
    is_alike &= np.abs(grey - grey.T) < BALL.contrast
    is_common = is_alike[is_alike.sum(axis=1).argmax()]
    if 2 * is_common.sum() > patterns:
        counts = np.bincount(number, minlength=len(colours))[is_common] + BALL.dim
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


def _plain(skin: F32, u: F32, v: F32, z: F32, inside: Mask) -> bool:
    """Check whether a ball has one colour: nine tenths of its skin change linearly."""
    if np.count_nonzero(inside) < 50:
        return False
    level = np.log(np.maximum(skin, 1e-3))[inside].astype(np.float64)
    normals = [np.broadcast_to(part, inside.shape)[inside] for part in (u, v, z)]
    rows = np.column_stack([np.ones(len(level)), *normals])
    residuals = level - rows @ np.linalg.lstsq(rows, level, rcond=None)[0]
    return bool(np.percentile(np.abs(residuals), 90) < BALL.plain)


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
    dimmest = colour.min(axis=2)
    is_core = (dimmest > BALL.gloss_least) & is_near
    is_core &= dimmest > 1.5 * beneath.min(axis=2) + 0.05
    # A white stripe is as white elsewhere on the ball; a highlight is brighter than all
    # of it.
    is_elsewhere = ~is_near & (u * u + v * v < 0.99 * RIM * RIM)
    if not is_elsewhere.any():
        return no_gloss
    paint = dimmest / sphere_shading(light, u, v, z)
    brightest = np.percentile(paint[is_elsewhere], 97)
    is_core &= (paint > BALL.outshines * brightest) | (dimmest > BALL.clipped)
    if not is_core.any():
        return no_gloss
    reach = max(2, round(0.12 * radius))
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    spot = cv2.dilate(is_core.astype(np.uint8), square).astype(np.float32)
    blurred_spot = cv2.GaussianBlur(spot, (0, 0), max(0.6, reach / 3))
    return np.asarray(
        np.maximum(colour - beneath, 0) * blurred_spot[..., None], np.float32
    )


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
