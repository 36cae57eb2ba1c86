"""A sphere in the photo: its colour without light, its gloss, and its shading.

The colour turns with the ball; shading and highlights stay where the light is. A ball has few paints: with each
pixel's paint known, what else changes evenly over the ball is light; with light known, paints tell apart. Both are
found in turn, in logarithms. Where a band, a cut or a disc explains the near side, the ball is painted so all over;
else a point of the far side has the colour of its antipode.
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
"""(n,) number of the paint of each pixel."""


@dataclass(frozen=True)
class BallTuning:
    """Thresholds of the separation of a ball into colour, gloss and shading."""

    paints: int = 5
    """At most, on one ball."""
    dim: float = 0.03
    """Linear light below which colours hardly tell paints apart."""
    most_pixels: int = 500
    """Of a ball, that are asked."""
    rounds: int = 4
    stiff: float = 0.02
    """Weight, in shares of the ball's pixels, that keeps shading near Lambert's."""
    odd: float = 0.15
    """Departure in log light from which a pixel counts less: a highlight, a seam."""
    undecided: float = 0.08
    """Of the brightest paint: what differs more from every paint is between them."""
    excess: float = 1.3
    """Times its paint that a pixel may send back: what is more is a reflection."""
    most_departure: float = 1.0
    """Of the departure from Lambert, in log light."""
    darkest: float = 0.18
    """Of full light: where less falls, the photo's own darkness is taken for the skin's."""
    painted: float = 0.5
    """Share of pixels between paints up to which a ball is taken for a painted one."""
    plainly: float = 0.6
    """Slope of brightness over predicted shading from which light is taken as it is."""
    rim_light: float = 0.85
    """Of the radius: farther out brightness is separated from the model's."""
    even: float = 0.08
    """Of the radius over which it is evened out."""
    fades: float = 1.6
    """By how much it may differ."""
    smooth: float = 0.15
    """Of the radius over which what differs from the paints is light."""
    plain: float = 0.2
    """Departure of log light from an even change, up to which a ball is of one colour."""
    gloss_width: float = 0.5
    """Of the radius: what outshines all around over no more may be a highlight."""
    line_width: float = 0.25
    """Of the radius: lines of a number have no more."""
    gloss_least: float = 0.6
    """Linear light that the dimmest channel of a highlight has at least."""
    outshines: float = 1.2
    """Times the brightest paint elsewhere on the ball that a highlight has at least."""
    clipped: float = 0.9
    """Linear light that hardly any paint sends back."""
    axes: int = 400
    """Directions in which borders of two paints are looked for."""
    steps: int = 64
    """Places of a border along each."""
    lopsided: float = 0.01
    """Share of pixels that a cut explains more than a band, at least."""
    closer: tuple[float, ...] = (
        0.08,
        0.03,
        0.01,
        0.0,
    )  # rad around the best, in which to look next
    disc: float = 0.8
    """Cosine of a disc's radius, at least."""
    seen: float = 0.2
    """Cosine to the viewer, up to which the photo shows what is written."""
    marked: float = 0.015
    """Share of pixels that a disc explains, at least."""
    explained: float = 0.8
    """Of the pixels, by a pattern that a ball is painted with."""
    contrast: float = 1.0
    """Of log light in some channel: shades of one paint differ less."""
    together: int = 5
    """Balls, at least, that tell lamps from their neighbours."""
    usual: float = 0.35
    """Quantile of what balls show: neighbours and errors add more often than they take."""
    lent: float = 0.05
    """Share of a normal's light that a neighbour may change, where a ball is alone."""
    beyond: float = 1.1
    """Of a neighbour's radius: a ray that passes so far from its middle does not meet it."""
    dark: float = 0.1
    """Linear light up to which paint shows what is mirrored on it."""
    alike: float = 0.25
    """Of log light: paints of several balls whose hues differ less are one."""
    beside: float = 0.4
    """Of the way between two paints: what is farther off it is neither."""
    gloss_cosine: float = 0.80
    """Of the angle between a highlight's normal and the mirror's direction."""


BALL = BallTuning()


def basis(u: F32, v: F32, z: F32) -> list[F32]:
    """Return real harmonics of first and second degree on the unit sphere, unnormalised: 8 pictures."""
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
    """What a ball wears, and in what light."""

    even: F32
    """(8, 3) weights of `basis`: log of what each channel's light does beyond Lambert's law."""
    colours: F32
    """(K, 3) linear, in full light."""
    between: float
    """Share of pixels that are unlike all paints: few on a painted ball."""


def find_paints(bare: F32, u: F32, v: F32, z: F32, use: Mask) -> Paints | None:
    """Find a ball's paints and its light in turn; None for too few pixels.

    `bare` (h, w, 3) is light over Lambert's shading of the normals (u, v, z), from the pixels in `use`.
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
    # First paints by colour above all, of which light changes little.
    paint = _split(np.column_stack([2 * (level - grey[:, None]), 0.7 * grey]))
    even, trust = np.zeros(8), np.ones(len(grey))
    for _ in range(BALL.rounds):
        errors = np.abs(_from_median(grey - rows @ even, paint))
        trust = 1 / np.maximum(errors / BALL.odd, 1)
        even = _solved(rows, grey, paint, trust)
        unlit = level - (rows @ even)[:, None]
        paint = _nearest(unlit, _each(np.median, unlit, paint))
    # Then each channel's own light, with the paints as they are: neighbours lend their colour.
    channels = _solved(rows, level - (rows @ even)[:, None], paint, trust)
    channels = even[:, None] + channels
    unlit = np.maximum(np.exp(level - rows @ channels) - BALL.dim, 0)
    order = np.argsort(-np.bincount(paint), kind="stable")
    colours = _each(np.median, unlit, paint)[order]
    distances = [np.abs(unlit - colour).max(axis=1) for colour in colours]
    is_unlike = np.min(distances, axis=0) > BALL.undecided * colours.max()
    return Paints(
        channels.astype(np.float32),
        colours.astype(np.float32),
        float(is_unlike.mean()),
    )


def _from_median(values: F64, paint: Ids) -> F64:
    """Return values (n, ...) less the median of their paint."""
    return np.asarray(values - _each(np.median, values, paint)[paint])


def _solved(rows: F64, level: F64, paint: Ids, trust: F64) -> F64:
    """Return (8, ...) weights of `rows` (n, 8) that explain `level` (n, ...) within each paint, by least squares.

    What is even over one paint shows no light: each paint's own mean is left out.
    """
    terms, target, weight = rows.copy(), level.copy(), trust[:, None]
    for k in range(paint.max() + 1):
        is_paint = paint == k
        own_trust = trust[is_paint]
        terms[is_paint] -= np.average(terms[is_paint], axis=0, weights=own_trust)
        target[is_paint] -= np.average(target[is_paint], axis=0, weights=own_trust)
    weighted = (terms * weight).T
    normal = weighted @ terms + BALL.stiff * len(rows) * np.eye(rows.shape[1])
    return np.asarray(np.linalg.solve(normal, weighted @ target))


def _each(mean: Callable[..., Any], points: F64, paint: Ids) -> F64:
    """Return (K, ...) a mean or median of the points of each paint."""
    numbers = range(paint.max() + 1)
    return np.array([mean(points[paint == k], axis=0) for k in numbers])


def _split(points: F64) -> Ids:
    """Return the paint of each point: the farthest from those chosen makes the next one, then means (Lloyd)."""
    middles = [np.median(points, axis=0)]
    for _ in range(BALL.paints - 1):
        squares = [((points - middle) ** 2).sum(axis=1) for middle in middles]
        distance = np.min(squares, axis=0)
        # Not the very farthest: that may be a highlight.
        farthest = np.argsort(distance)[int(0.97 * len(distance))]
        if distance[farthest] < 0.3**2:
            break
        middles.append(points[farthest])
    paint = _nearest(points, np.array(middles))
    for _ in range(4):
        paint = _nearest(points, _each(np.mean, points, paint))
    return paint


def _nearest(points: F64, centers: F64) -> Ids:
    """Return the number of the nearest centre; centres without points are dropped."""
    squares = np.stack([((points - center) ** 2).sum(axis=1) for center in centers])
    _, numbers = np.unique(np.argmin(squares, axis=0), return_inverse=True)
    return numbers.astype(np.int64).ravel()


RIM = 0.955
"""Of the radius: farther out pixels are mixed, and so much foreshortened that they tell little."""


@dataclass(frozen=True)
class Border:
    """A plane that parts a sphere, or two that are each other's mirror image."""

    normal: F64
    """(3,) z to the viewer."""
    at: float
    """Radii from the middle."""
    folded: bool
    """Whether there are two."""
    sign: float
    """Of `values` beyond."""

    def values(self, points: F64) -> F64:
        """Return the distance (...) of points (..., 3) from the border in radii, about.

        Of either sign.
        """
        along = points @ self.normal
        if self.folded:
            along = np.abs(along)
        slope = np.sqrt(max(1 - self.at**2, 0.1))
        return np.asarray(self.sign * (along - self.at) / slope)


@dataclass(frozen=True)
class Pattern:
    """Two paints on a sphere: a band or a cut, and perhaps a disc with its like at the antipode."""

    colours: F32
    """(2, 3) linear: where `values` are negative, and where positive."""
    border: Border
    disc: Border | None = None
    """Which shows what the photo shows there."""

    def values(self, points: F64) -> F64:
        """Return the distance (...) of points (..., 3) from a border in radii, about.

        Of either sign.
        """
        values = self.border.values(points)
        if self.disc is None:
            return values
        sign = -np.sign(self.border.values(self.disc.normal))
        return np.asarray(sign * np.maximum(sign * values, self.disc.values(points)))

    def painted(self, points: F64, soft: float) -> F32:
        """Return the colours (..., 3) of points (..., 3); a border is `soft` radii wide."""
        share = np.clip(0.5 + self.values(points) / soft, 0, 1)
        first, second = self.colours
        mixed = first + share[..., None].astype(np.float32) * (second - first)
        return np.asarray(mixed, np.float32)

    def written(self, points: F64, soft: float) -> tuple[F32, F64]:
        """Return (..., 1) how far points (..., 3) are in a disc, and the places (..., 3) of the writing on them.

        The disc at the antipode is turned by half about the band's normal: a number can be read there.
        """
        if self.disc is None:
            return np.zeros((*points.shape[:-1], 1), np.float32), points
        middle, up = self.disc.normal, self.border.normal
        up = up - (up @ middle) * middle
        up = up / np.linalg.norm(up)
        behind = 2 * (points @ up)[..., None] * up - points
        is_front = (points @ middle)[..., None] > 0
        places = np.where(is_front, points, behind)
        share = np.clip(self.disc.values(points) / soft - 0.5, 0, 1)
        share = share * (places[..., 2] > BALL.seen)
        return share[..., None].astype(np.float32), places


def find_pattern(skin: F32, colours: F32, points: F64) -> Pattern | None:
    """Find the pattern of a `skin` (n, 3) at `points` (n, 3) with `colours` (K, 3), the most frequent first.

    None if no pattern explains the skin.
    """
    pair = _contrasting_pair(skin, colours)
    if pair is None:
        return None
    step = (pair[1] - pair[0]).astype(np.float64)
    share = (skin - pair[0]) @ step / (step @ step)
    mixed = np.clip(share, 0, 1)[:, None] * step
    distance = np.linalg.norm(skin - pair[0] - mixed, axis=1)
    is_clear = distance < BALL.beside * np.linalg.norm(step)
    if not is_clear.any():
        return None
    value = np.where(share > 0.5, 1.0, -1.0)[is_clear]
    places = points[is_clear]
    share_band, border = _border(places, value, folded=True)
    share_cut, cut = _border(places, value, folded=False)
    if share_cut > share_band + BALL.lopsided:
        border = cut
    pattern = _with_disc(Pattern(pair, border), places, value)
    explained = (value * pattern.values(places) > 0).sum()
    return pattern if explained > BALL.explained * len(skin) else None


def _contrasting_pair(skin: F32, colours: F32) -> F32 | None:
    """Return the first colour and the most frequent one far from it, (2, 3).

    None if all are alike.
    """
    first = colours[0]
    nearest = np.abs(skin[:, None] - colours).max(axis=2).argmin(axis=1)
    counts = np.bincount(nearest, minlength=len(colours))
    logarithms = np.log((colours + BALL.dim) / (first + BALL.dim))
    is_other = np.abs(logarithms).max(axis=1) >= BALL.contrast
    if not is_other.any():
        return None
    squares = ((colours - first) ** 2).sum(axis=1)
    second = colours[np.argmax(is_other * counts * squares)]
    return np.stack([first, second])


def _with_disc(pattern: Pattern, places: F64, value: F64) -> Pattern:
    """Return the pattern with a disc if that explains more of the signs `value` (n,) at `places` (n, 3)."""
    border = pattern.border
    if border.folded and border.at > BALL.disc:
        # But for discs, the ball is of one paint.
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
    """Return the share of `points` (n, 3) that the best border separates by their `value` (n,), 1 or -1; and it."""
    steps = BALL.steps if folded else 2 * BALL.steps
    axes = _spiral(BALL.axes)
    stride = -(-len(value) // BALL.most_pixels)
    for width in BALL.closer:
        along = points[::stride] @ axes.T
        share = np.abs(along) if folded else (along + 1) / 2
        gain = _separation_gain(share, value[::stride], steps)
        best, step = np.unravel_index(np.argmax(np.abs(gain)), gain.shape)
        normal, largest, place = axes[best], gain[best, step], (step + 1) / steps
        axes = _axes_around(normal, width)
        stride = 1
    distance = float(place if folded else 2 * place - 1)
    border = Border(normal, distance, folded, float(np.sign(largest)))
    return 0.5 + abs(largest) / (2 * len(value)), border


def _spiral(count: int) -> F64:
    """Return `count` directions (n, 3) that are even over a hemisphere."""
    k = np.arange(count) + 0.5
    height, turn = k / count, np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - height**2)
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), height])


def _separation_gain(share: F64, value: F64, steps: int) -> F64:
    """Return (axes, steps): the sum of `value` (n,) beyond a border at each step, less that within.

    `share` (n, axes): the places of the points along each axis, 0..1.
    """
    axes = share.shape[1]
    cell = np.minimum((steps * share).astype(np.int64), steps - 1)
    cell = cell + steps * np.arange(axes)
    weights = np.broadcast_to(value[:, None], cell.shape).ravel()
    sums = np.bincount(cell.ravel(), weights, steps * axes)
    within = sums.reshape(-1, steps).cumsum(axis=1)
    return np.asarray(within[:, -1:] - 2 * within)


def _axes_around(normal: F64, width: float) -> F64:
    """Return unit vectors (25, 3) around a normal, up to `width` rad away."""
    shift = width * np.linspace(-1, 1, 5)
    right, down = np.linalg.svd(normal[None])[2][1:]
    offsets = shift[:, None, None] * right + shift[:, None] * down
    axes = normal + offsets.reshape(-1, 3)
    return np.asarray(axes / np.linalg.norm(axes, axis=1)[:, None])


@dataclass(frozen=True)
class Ball:
    """What is seen of a sphere, on its sprite's box: of one that is cut or hidden, its centre may lie outside."""

    corner: tuple[int, int]
    """Photo column and row of the box's first pixel."""
    center: tuple[float, float]
    """px in the photo at t = 0."""
    radius: float
    skin: F32
    """(h, w, 3) linear light over shading, carried outwards from the rim."""
    gloss: F32
    """(h, w, 3) linear, of either sign: highlights, and what skin and Lambert's law do not tell.

    It does not turn.
    """
    light: DistantLight
    seen: F32
    """(h, w, 3) linear light in the photo, carried outwards from the rim."""
    even: F32 | None = None
    """(8, 3) of `paints.basis`: log of what light does beyond Lambert's law."""
    trust: float = 1.0
    """0..1: how far the photo shows this light on it; power of Lambert's shading."""
    pattern: Pattern | None = None
    """Of a ball that is seen from above."""
    fade: F32 | None = None
    """(h, w) by which the light at the rim differs from that; it does not turn."""
    is_continued: bool = False
    """Whether its far side continues the texture of the near side."""

    def shade(self, u: F32, v: F32, z: F32) -> F32:
        """Return the shading (h, w, 3) of the normals (u, v, z to the viewer)."""
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
    """Return (h, w) u, v and z of a sphere's normals on a box of a photo, beyond RIM as they are there; and radii."""
    x = np.arange(shape[1]) + corner[0] - center[0]
    y = np.arange(shape[0]) + corner[1] - center[1]
    u, v = np.meshgrid((x / radius).astype(np.float32), (y / radius).astype(np.float32))
    rho = np.sqrt(np.maximum(u * u + v * v, 1e-12))
    squeeze = np.minimum(np.float32(1), np.float32(RIM) / rho)
    u, v = u * squeeze, v * squeeze
    return u, v, np.sqrt(np.maximum(1 - u * u - v * v, 0)), rho


def sphere_shading(light: DistantLight, u: F32, v: F32, z: F32) -> F32:
    """Return Lambert's law on a unit sphere's normals (u, v, z to the viewer), at least BALL.darkest of the most."""
    lx, ly, lz = (np.float32(part) for part in light.direction)
    facing = np.maximum(lx * u + ly * v + lz * z, 0)
    shade = np.float32(light.ambient) + np.float32(light.intensity) * facing
    least = np.float32(BALL.darkest * (light.ambient + light.intensity))
    return np.asarray(np.maximum(shade, least), np.float32)


@dataclass(frozen=True)
class _Normals:
    """A sphere's normals on a box, (h, w) each, beyond RIM as they are there."""

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
    """Separate a ball into skin, gloss and shading, by `colour` (h, w, 3): its linear light on a box at `corner`.

    Seen from above a ball turns its far side up; seen from the side it turns in the picture, and all that is needed is
    there. If `is_painted`, the far side has the pattern of billiard balls; else it continues the texture.
    """
    normals = _Normals(*normals_within(colour.shape, corner, center, radius))
    inner = _carried_inwards(colour, corner, center, radius, normals)
    shine = _gloss(inner, *normals.parts, radius, light)
    trust = _shown(inner - shine, sphere_shading(light, *normals.parts), normals.inside)
    ball = Ball(corner, center, radius, inner, shine, light, inner, trust=trust)
    skin = (inner - shine) / ball.shade(*normals.parts)
    ball = replace(ball, skin=np.ascontiguousarray(skin, np.float32))
    soft = np.ones_like(normals.rho)
    use = normals.inside & (shine.max(axis=2) <= 0)
    paints = find_paints(ball.skin, *normals.parts, use)
    if paints is not None and paints.between < BALL.painted:
        has_pattern = view is View.TOP and is_painted
        ball, soft = _with_paints(ball, paints, normals, use, has_pattern)
    if _plain(ball.skin, *normals.parts, normals.inside):
        # A ball of one colour looks the same however it has turned: all that is uneven is light, and stays.
        median = np.median(ball.skin[normals.inside], axis=0)
        skin = np.broadcast_to(median, ball.skin.shape).copy()
        ball = replace(ball, skin=skin, pattern=None)
        return replace(ball, gloss=colour - ball.skin * ball.lit)
    if view is View.TOP and not is_painted:
        ball = _without_highlights(ball, normals.inside)
    return replace(ball, fade=_rim_light(ball, colour, normals, soft))


def _carried_inwards(
    colour: F32,
    corner: tuple[int, int],
    center: tuple[float, float],
    radius: float,
    normals: _Normals,
) -> F32:
    """Return a ball's light (h, w, 3), that at its rim carried outwards."""
    x = normals.u * np.float32(radius) + np.float32(center[0] - corner[0])
    y = normals.v * np.float32(radius) + np.float32(center[1] - corner[1])
    border = cv2.BORDER_REPLICATE
    picture = cv2.remap(colour, x, y, cv2.INTER_LINEAR, borderMode=border)
    return np.asarray(picture, np.float32)


def _with_paints(
    ball: Ball, paints: Paints, normals: _Normals, use: Mask, has_pattern: bool
) -> tuple[Ball, F32]:
    """Return the ball with a skin of its paints, and (h, w) the even light that is on the skin beyond its shading."""
    radius, inner, shine = ball.radius, ball.seen, ball.gloss
    ball = replace(ball, even=paints.even)
    shade = ball.shade(*normals.parts)
    skin = (inner - shine) / shade
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    distances = [np.abs(skin - paint).max(axis=2) for paint in paints.colours]
    paint = np.argmin(distances, axis=0).astype(np.uint8)
    # without what is narrower than 2 px
    flat = paints.colours[cv2.medianBlur(paint, 3)]
    pattern = None
    if has_pattern:
        points = _points(inner.shape, ball.corner, ball.center, radius)
        pattern = find_pattern(skin[use], paints.colours, points[use])
        if pattern is not None:
            flat = pattern.painted(points, 1 / radius)
            shine = np.minimum(shine, np.maximum(inner - flat * shade, 0))
            skin = (inner - shine) / shade
    excess = np.maximum(skin - BALL.excess * cv2.dilate(flat, cross), 0)
    # A line is paint, not a reflection.
    excess = cv2.morphologyEx(excess, cv2.MORPH_OPEN, cross)
    skin, shine = skin - excess, shine + excess * shade
    soft = np.ones_like(normals.rho)
    if pattern is None:
        within = (normals.rho < 1).astype(np.float32)
        brightness, flat_brightness = skin.mean(axis=2), flat.mean(axis=2)
        sigma = BALL.smooth * radius
        soft = blurred_share(brightness, flat_brightness, within, sigma)
        skin = skin / soft[..., None]
    else:
        skin = _painted(replace(ball, gloss=shine, pattern=pattern)).skin
    return replace(ball, skin=skin, gloss=shine, pattern=pattern), soft


def _rim_light(ball: Ball, colour: F32, normals: _Normals, soft: F32) -> F32:
    """Return (h, w) the photo's light over the model's at the rim, and `soft` farther in.

    The difference at the rim is light, and stays: its brightness, not its colours.
    """
    model = (ball.skin * ball.lit).mean(axis=2)
    brightness = (colour - ball.gloss).mean(axis=2)
    within = (normals.rho < 1).astype(np.float32)
    sigma = max(1.0, BALL.even * ball.radius)
    share = blurred_share(brightness, model, within, sigma)
    is_rim = normals.rho > BALL.rim_light
    return np.asarray(np.where(is_rim, share, soft), np.float32)


def _without_highlights(ball: Ball, inside: Mask) -> Ball:
    """Return a ball whose far side continues its skin, highlights moved to its gloss."""
    skin = part_highlights(ball.skin, inside, ball.radius)
    gloss = ball.gloss + (ball.skin - skin) * ball.lit
    return replace(ball, skin=skin, gloss=gloss, is_continued=True)


def _shown(colour: F32, shade: F32, inside: Mask) -> float:
    """Return 0..1: the slope of a ball's own brightness over its predicted shading, in logs.

    1 from BALL.plainly on.
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
    for _ in range(4):
        level = float(np.average(y - slope * x, weights=trust))
        product = (trust * x * (y - level)).sum()
        square = (trust * x * x).sum() + 0.02 * variance * len(x)
        slope = float(product / square)
        trust = 1 / np.maximum(np.abs(y - level - slope * x) / 0.2, 1)
    return float(np.clip(slope / BALL.plainly, 0, 1))


def blurred_share(brightness: F32, model: F32, weight: F32, sigma: float) -> F32:
    """Return (h, w) how much brighter an object is than its model, evenly."""
    above = cv2.GaussianBlur(brightness * weight, (0, 0), sigma)
    below = cv2.GaussianBlur(model * weight, (0, 0), sigma)
    # Dark skin shows little of its light.
    share = (above + np.float32(BALL.dim)) / (below + np.float32(BALL.dim))
    return np.asarray(np.clip(share, 1 / BALL.fades, BALL.fades), np.float32)


def in_one_light(balls: Sequence[Ball]) -> list[Ball]:
    """Return painted balls in the light that they share, by what all show where no neighbour is near or mirrored.

    Shared are how bright each normal is, and what it mirrors of lamps, windows and the table. The paint that most of
    them wear is one.
    """
    painted = [ball for ball in balls if ball.pattern is not None]
    if len(painted) < BALL.together:
        return list(balls)
    half = max(round(ball.radius) for ball in painted)
    views = _BallViews.of(painted, balls, half)
    trust = float(np.median([ball.trust for ball in painted]))
    shared = replace(painted[0], trust=trust, even=None)
    shade = shared.shade(*np.moveaxis(views.points, 2, 0))
    patterns = [ball.pattern for ball in painted if ball.pattern is not None]
    even, patterns = _shared_light(
        views.pictures / shade, views.points, views.is_lit, patterns
    )
    shared = replace(shared, even=even)
    shade = shared.shade(*np.moveaxis(views.points, 2, 0))
    flat = [pattern.painted(views.points, 1 / half) for pattern in patterns]
    model = np.stack(flat) * shade
    gloss = _shared_gloss(views, model)
    fade = _shared_fade(views, model, gloss)
    results = {}
    for ball, pattern in zip(painted, patterns, strict=True):
        size, scale = ball.skin.shape[1::-1], half / ball.radius
        shift = half - scale * np.subtract(ball.center, ball.corner)
        lit_ball = replace(
            ball,
            gloss=_sampled(gloss, size, scale, shift),
            fade=_sampled(fade, size, scale, shift),
            even=even,
            trust=trust,
            pattern=pattern,
        )
        results[id(ball)] = _painted(lit_ball)
    return [results.get(id(ball), ball) for ball in balls]


@dataclass(frozen=True)
class _BallViews:
    """Pictures of n balls at one size, (n, h, w)."""

    points: NDArray[Any]
    """(h, w, 3) normals."""
    pictures: F32
    """(n, h, w, 3) linear light."""
    is_lit: Mask
    """Whether no other ball gives much light."""
    is_clear: Mask
    """Whether no other ball is mirrored."""
    is_plain: Mask
    """Whether the pattern has one paint, and nothing is written on it."""

    @classmethod
    def of(
        cls, painted: Sequence[Ball], balls: Sequence[Ball], half: int
    ) -> _BallViews:
        """Sample painted balls with a radius of `half` px."""
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
    """Return (h, w, 3) what balls mirror: it shows on dark paint, as light does on bright paint."""
    is_dark = model < BALL.dark
    excess = views.pictures - model
    clear, plain = views.is_clear[..., None], views.is_plain[..., None]
    gloss = np.maximum(_usual(excess, clear & is_dark, plain & is_dark), 0)
    is_clipped = views.pictures.min(axis=3, keepdims=True) > BALL.clipped
    middle = np.median(np.where(is_clipped, 1, excess), axis=0)
    faces_viewer = views.points[..., 2:] ** 2 > 0.5
    return np.where(faces_viewer, np.clip(middle, 0, gloss), gloss)


def _shared_fade(views: _BallViews, model: F32, gloss: F32) -> F32:
    """Return (h, w) the light of the rim over the model's, 1 farther in."""
    is_dark = model < BALL.dark
    share = (views.pictures - gloss) / np.maximum(model, BALL.dim)
    share = np.clip(share, 1 / BALL.fades, BALL.fades)
    everywhere = np.ones_like(is_dark)
    usual = _usual(share, views.is_clear[..., None] & ~is_dark, everywhere)
    distance = np.hypot(views.points[..., 0], views.points[..., 1])
    is_rim = distance > BALL.rim_light
    return np.where(is_rim, usual.mean(axis=2), np.float32(1))


def _painted(ball: Ball) -> Ball:
    """Return a ball with the skin of its pattern, and the writing that the photo shows on it."""
    assert ball.pattern is not None
    points = _points(ball.skin.shape, ball.corner, ball.center, ball.radius)
    border = 1 / ball.radius
    flat = ball.pattern.painted(points, border)
    skin = (ball.seen - ball.gloss) / ball.lit
    brightest = ball.pattern.colours.max(axis=0)
    ink = np.clip(skin, 0, brightest) - flat
    share, _ = ball.pattern.written(points, border)
    return replace(ball, skin=np.asarray(flat + share * ink, np.float32))


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
    """Sample a picture at `scale` times the columns and rows of `size`, and `shift`."""
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    matrix = np.column_stack([scale * np.eye(2), shift])
    moved = cv2.warpAffine(
        picture,
        matrix,
        (size[0], size[1]),
        flags=flags,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(moved, np.float32)


def _open(points: NDArray[Any], ball: Ball, balls: Sequence[Ball]) -> list[Mask]:
    """Return (h, w) where no other ball gives a ball's normals (h, w, 3) much light, and where they mirror none.

    Both only in plain pixels, the third result: their pattern has one paint, and nothing is written on it.
    """
    assert ball.pattern is not None
    writing, _ = ball.pattern.written(points, 1e-3)
    has_one_paint = np.abs(ball.pattern.values(points)) > BALL.even
    is_plain = has_one_paint & (writing[..., 0] == 0)
    is_lit, is_clear = is_plain.copy(), is_plain.copy()
    viewer = np.array([0, 0, 1], np.float32)
    mirrored = 2 * points[..., 2:] * points - viewer
    for other in balls:
        x, y = np.subtract(other.center, ball.center)
        offset = np.array([x, y, other.radius - ball.radius]) / ball.radius
        distance = float(np.linalg.norm(offset))
        if distance <= 0:
            continue
        size = other.radius / ball.radius
        is_lit &= (points @ offset) * (size**2 / distance**3) < BALL.lent
        ray = offset - points
        along = (ray * mirrored).sum(axis=2)
        passes = (ray * ray).sum(axis=2) - along**2 > (BALL.beyond * size) ** 2
        is_clear &= (along < 0) | passes
    return [is_lit if is_lit.any() else is_plain, is_clear, is_plain]


def _shared_light(
    bare: NDArray[Any],
    points: NDArray[Any],
    is_lit: Mask,
    patterns: Sequence[Pattern],
) -> tuple[F32, list[Pattern]]:
    """Find (8, 3) weights of `basis` of the light on all balls, and the patterns with their colours in it.

    `bare` (n, h, w, 3): their light over Lambert's shading; used where they are `is_lit` (n, h, w).
    """
    values = np.stack([pattern.values(points) for pattern in patterns])
    distance = np.hypot(points[..., 0], points[..., 1])
    use = is_lit & (distance < 0.99 * RIM)
    # Colours are numbered through: two of each pattern.
    number = (2 * np.arange(len(patterns))[:, None, None] + (values > 0))[use]
    numbers, paint = np.unique(number, return_inverse=True)
    light = np.maximum(bare[use], 0)
    level = np.log(light + np.float32(BALL.dim)).astype(np.float64)
    directions = np.broadcast_to(points, bare.shape)[use].T
    rows = np.column_stack(basis(*directions)).astype(np.float64)
    even = _robust_light(rows, level, paint)
    unlit = light * np.exp(-rows @ even)
    colours = np.stack([pattern.colours for pattern in patterns]).reshape(-1, 3)
    colours[numbers] = _paint_colours(unlit, paint)
    _unite_common_paint(colours, number, len(patterns))
    result = []
    for k, pattern in enumerate(patterns):
        result.append(replace(pattern, colours=colours[2 * k : 2 * k + 2]))
    return even.astype(np.float32), result


def _robust_light(rows: F64, level: F64, paint: Ids) -> F64:
    """Return weights (8, 3) of `rows` that explain the log light `level` (n, 3), by reweighted least squares."""
    # Dark paint shows little of the light on it.
    visibility = 1 - BALL.dim * np.exp(-level).mean(axis=1)
    even, trust = np.zeros((8, 3)), visibility
    for _ in range(BALL.rounds):
        even = _solved(rows, level, paint, trust)
        errors = np.abs(_from_median(level - rows @ even, paint)).max(axis=1)
        trust = visibility / np.maximum(errors / BALL.odd, 1)
    return even


def _paint_colours(unlit: F64, paint: Ids) -> F64:
    """Return (K, 3) the median of each paint.

    Of dark paint, some of which mirrors more, a low quantile.
    """
    low = _each(partial(np.quantile, q=0.2), unlit, paint)
    middle = _each(partial(np.quantile, q=0.5), unlit, paint)
    return np.where(middle < BALL.dark, low, middle)


def _unite_common_paint(colours: F32, number: Ids, patterns: int) -> None:
    """Set the most common paint of `colours` (K, 3) to its mean.

    `number` (n,) has the colour of each pixel.
    """
    logarithm = np.log(colours + np.float32(BALL.dim))
    grey = logarithm.mean(axis=1, keepdims=True)
    hue = logarithm - grey
    is_alike = np.abs(hue[:, None] - hue).max(axis=2) < BALL.alike
    is_alike &= np.abs(grey - grey.T) < BALL.contrast
    common = is_alike[is_alike.sum(axis=1).argmax()]
    if 2 * common.sum() > patterns:
        counts = np.bincount(number, minlength=len(colours))[common] + BALL.dim
        colours[common] = np.average(colours[common], axis=0, weights=counts)


def _usual(pictures: NDArray[Any], *masks: Mask) -> F32:
    """Return (h, w, 3) the usual value of pictures (n, h, w, 3), in the first of `masks` with two of them; else the
    least.
    """
    result = pictures.min(axis=0)
    for mask in reversed(masks):
        count = mask.sum(axis=0)
        ordered = np.sort(np.where(mask, pictures, np.float32(np.inf)), axis=0)
        place = np.rint(BALL.usual * np.maximum(count - 1, 0)).astype(np.int64)
        quantile = np.take_along_axis(ordered, place[None], axis=0)[0]
        result = np.where(count > 1, quantile, result)
    return np.asarray(result, np.float32)


def _plain(skin: F32, u: F32, v: F32, z: F32, inside: Mask) -> bool:
    """Return whether a ball is of one colour: its apparent skin changes evenly, but for a tenth of it."""
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
    """Return (h, w, 3) bright spots near where a mirror would show the light."""
    nothing = np.zeros_like(colour)
    half = np.array(light.direction) + np.array([0.0, 0.0, 1.0])
    length = float(np.linalg.norm(half))
    if length < 1e-6 or radius < 4:
        return nothing
    hx, hy, hz = (np.float32(part / length) for part in half)
    is_near = hx * u + hy * v + hz * z > BALL.gloss_cosine
    beneath = _beneath_spots(colour, radius)
    dimmest = colour.min(axis=2)
    core = (dimmest > BALL.gloss_least) & is_near
    core &= dimmest > 1.5 * beneath.min(axis=2) + 0.05
    # A white stripe is as white elsewhere on the ball; a highlight outshines all of it.
    elsewhere = ~is_near & (u * u + v * v < 0.99 * RIM * RIM)
    if not elsewhere.any():
        return nothing
    paint = dimmest / sphere_shading(light, u, v, z)
    brightest = np.percentile(paint[elsewhere], 97)
    core &= (paint > BALL.outshines * brightest) | (dimmest > BALL.clipped)
    if not core.any():
        return nothing
    reach = max(2, round(0.12 * radius))
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    spot = cv2.dilate(core.astype(np.uint8), square).astype(np.float32)
    soft = cv2.GaussianBlur(spot, (0, 0), max(0.6, reach / 3))
    return np.asarray(np.maximum(colour - beneath, 0) * soft[..., None], np.float32)


def _beneath_spots(colour: F32, radius: float) -> F32:
    """Return a ball's light without bright spots.

    Lines of a number on a bright disc are no gaps in the disc.
    """
    line = _ellipse(BALL.line_width * radius)
    spot = _ellipse(BALL.gloss_width * radius)
    border = cv2.BORDER_REPLICATE
    closed = cv2.morphologyEx(colour, cv2.MORPH_CLOSE, line, borderType=border)
    opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, spot, borderType=border)
    grown = cv2.dilate(opened, np.ones((3, 3), np.uint8))
    return np.asarray(np.minimum(grown, colour), np.float32)


def _ellipse(diameter: float) -> NDArray[Any]:
    """Return a round structuring element of this diameter, px."""
    side = 2 * max(1, round(diameter / 2)) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
