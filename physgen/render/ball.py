"""A sphere in the photo: its colour without light, its gloss, and its shading.

The colour turns with the ball; shading and highlights stay where the light is. A ball has few paints: with each
pixel's paint known, what else changes evenly over the ball is light; with light known, paints tell apart. Both are
found in turn, in logarithms. Where a band, a cut or a disc explains the near side, the ball is painted so all over;
else a point of the far side has the colour of its antipode.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import DistantLight
from physgen.render.sphere_texture import part_highlights
from physgen.scene.scene import View

F32 = NDArray[np.float32]
Array = NDArray[np.float64]
Ids = NDArray[np.int64]


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
    """Real harmonics of first and second degree on the unit sphere, unnormalised: 8 pictures."""
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


def find_paints(
    bare: F32, u: F32, v: F32, z: F32, use: NDArray[np.bool_]
) -> Paints | None:
    """`bare` (h, w, 3) is light over Lambert's shading of the normals (u, v, z), from the pixels in `use`."""
    used = np.flatnonzero(use)
    if len(used) < 80:
        return None
    used = used[:: -(-len(used) // BALL.most_pixels)]
    level: Array = np.log(
        np.maximum(bare.reshape(-1, 3)[used], 0) + np.float32(BALL.dim)
    ).astype(np.float64)
    pictures = [np.broadcast_to(b, use.shape).ravel()[used] for b in basis(u, v, z)]
    rows: Array = np.column_stack(pictures).astype(np.float64)
    grey = level.mean(axis=1)
    # first paints by colour above all, of which light changes little
    paint = _split(np.column_stack([2 * (level - grey[:, None]), 0.7 * grey]))
    even, trust = np.zeros(8), np.ones(len(grey))
    for _ in range(BALL.rounds):
        left = grey - rows @ even
        trust = 1 / np.maximum(
            np.abs(left - _each(np.median, left, paint)[paint]) / BALL.odd, 1
        )
        even = _solved(rows, grey, paint, trust)
        bare_now = level - (rows @ even)[:, None]
        paint = _nearest(bare_now, _each(np.median, bare_now, paint))
    # then each channel's own light, with the paints as they are: what stands near lends its colour
    each = even[:, None] + _solved(rows, level - (rows @ even)[:, None], paint, trust)
    left = np.maximum(np.exp(level - rows @ each) - BALL.dim, 0)
    colours = _each(np.median, left, paint)[
        np.argsort(-np.bincount(paint), kind="stable")
    ]
    away = np.min([np.abs(left - c).max(axis=1) for c in colours], axis=0)
    between = float((away > BALL.undecided * colours.max()).mean())
    return Paints(each.astype(np.float32), colours.astype(np.float32), between)


def _solved(rows: Array, level: Array, paint: Ids, trust: Array) -> Array:
    """(8, ...) weights of `rows` (n, 8) that explain `level` (n, ...) within each paint, by weighted least squares.

    What is even over one paint shows no light: each paint's own mean is left out.
    """
    a, b, w = rows.copy(), level.copy(), trust[:, None]
    for k in range(paint.max() + 1):
        mine = paint == k
        a[mine] -= np.average(a[mine], axis=0, weights=trust[mine])
        b[mine] -= np.average(b[mine], axis=0, weights=trust[mine])
    normal = (a * w).T @ a + BALL.stiff * len(rows) * np.eye(rows.shape[1])
    return np.asarray(np.linalg.solve(normal, (a * w).T @ b))


def _each(of: Callable[..., Any], points: Array, paint: Ids) -> Array:
    """(K, ...) a mean or median of the points of each paint."""
    return np.array([of(points[paint == k], axis=0) for k in range(paint.max() + 1)])


def _split(points: Array) -> Ids:
    """Paint of each point: the farthest from those chosen makes the next one, then means (Lloyd)."""
    middles = [np.median(points, axis=0)]
    for _ in range(BALL.paints - 1):
        away = np.min([((points - m) ** 2).sum(axis=1) for m in middles], axis=0)
        far = np.argsort(away)[int(0.97 * len(away))]
        if away[far] < 0.3**2:
            break
        middles.append(points[far])
    centers = np.array(middles)
    paint = _nearest(points, centers)
    for _ in range(4):
        paint = _nearest(points, _each(np.mean, points, paint))
    return paint


def _nearest(points: Array, centers: Array) -> Ids:
    """Number of the nearest centre; centres without points are dropped."""
    away = np.stack([((points - c) ** 2).sum(axis=1) for c in centers])
    return (
        np.unique(np.argmin(away, axis=0), return_inverse=True)[1]
        .astype(np.int64)
        .ravel()
    )


RIM = 0.955
"""Of the radius: farther out pixels are mixed, and so much foreshortened that they tell little."""


@dataclass(frozen=True)
class Border:
    """A plane that parts a sphere, or two that are each other's mirror image."""

    normal: Array
    """(3,) z to the viewer."""
    at: float
    """Radii from the middle."""
    folded: bool
    """Whether there are two."""
    sign: float
    """Of `values` beyond."""

    def values(self, points: Array) -> Array:
        """(...) of points (..., 3): their distance from it in radii, about; of either sign."""
        along = points @ self.normal
        away = (np.abs(along) if self.folded else along) - self.at
        return np.asarray(self.sign * away / np.sqrt(max(1 - self.at**2, 0.1)))


@dataclass(frozen=True)
class Pattern:
    """Two paints on a sphere: a band or a cut, and perhaps a disc with its like at the antipode."""

    colours: F32
    """(2, 3) linear: where `values` are negative, and where positive."""
    border: Border
    disc: Border | None = None
    """Which shows what the photo shows there."""

    def values(self, points: Array) -> Array:
        """(...) of points (..., 3): their distance from a border in radii, about; of either sign."""
        values = self.border.values(points)
        if self.disc is None:
            return values
        other = -np.sign(self.border.values(self.disc.normal))
        return np.asarray(other * np.maximum(other * values, self.disc.values(points)))

    def painted(self, points: Array, soft: float) -> F32:
        """(..., 3) colours of points (..., 3); a border is `soft` radii wide."""
        share = np.clip(0.5 + self.values(points) / soft, 0, 1)[..., None].astype(
            np.float32
        )
        return np.asarray(
            self.colours[0] + share * (self.colours[1] - self.colours[0]), np.float32
        )

    def written(self, points: Array, soft: float) -> tuple[F32, Array]:
        """(..., 1) how far points (..., 3) are in a disc, and where what is written on it shows, (..., 3).

        Its like is that turned by half about the band's normal: a number can be read there.
        """
        if self.disc is None:
            return np.zeros((*points.shape[:-1], 1), np.float32), points
        middle, up = self.disc.normal, self.border.normal
        up = up - (up @ middle) * middle
        up = up / np.linalg.norm(up)
        behind = 2 * (points @ up)[..., None] * up - points
        there = np.where((points @ middle)[..., None] > 0, points, behind)
        share = np.clip(self.disc.values(points) / soft - 0.5, 0, 1) * (
            there[..., 2] > BALL.seen
        )
        return share[..., None].astype(np.float32), there


def find_pattern(seen: F32, colours: F32, points: Array) -> Pattern | None:
    """Of skin `seen` (n, 3) at `points` (n, 3) that has `colours` (K, 3), the most frequent first; None: no such."""
    counts = np.bincount(
        np.abs(seen[:, None] - colours).max(axis=2).argmin(axis=1),
        minlength=len(colours),
    )
    apart = (
        np.abs(np.log((colours + BALL.dim) / (colours[0] + BALL.dim))).max(axis=1)
        >= BALL.contrast
    )
    if not apart.any():
        return None
    pair = np.stack(
        [
            colours[0],
            colours[
                np.argmax(apart * counts * ((colours - colours[0]) ** 2).sum(axis=1))
            ],
        ]
    )
    way = (pair[1] - pair[0]).astype(np.float64)
    share = (seen - pair[0]) @ way / (way @ way)
    off = np.linalg.norm(seen - pair[0] - np.clip(share, 0, 1)[:, None] * way, axis=1)
    clear = off < BALL.beside * np.linalg.norm(way)
    value, at = np.where(share > 0.5, 1.0, -1.0)[clear], points[clear]
    if not clear.any():
        return None
    (share_band, border), (share_cut, cut) = (
        _border(at, value, folded=folded) for folded in (True, False)
    )
    if share_cut > share_band + BALL.lopsided:
        border = cut
    found = Pattern(pair, border)
    right = value * found.values(at) > 0
    if border.folded and border.at > BALL.disc:  # but for discs it is of one paint
        axis = np.eye(3)[np.abs(border.normal).argmin()]
        found = Pattern(
            pair, replace(border, normal=axis, at=2.0), replace(border, sign=1.0)
        )
    else:
        share_disc, disc = _border(at, np.where(right, -1.0, 1.0), folded=True)
        if (
            disc.sign > 0
            and disc.at > BALL.disc
            and share_disc > right.mean() + BALL.marked
        ):
            found = replace(found, disc=disc)
    return (
        found
        if (value * found.values(at) > 0).sum() > BALL.explained * len(seen)
        else None
    )


def _border(points: Array, value: Array, *, folded: bool) -> tuple[float, Border]:
    """What best parts `points` (n, 3) by their `value` (n,), 1 or -1; and the share that it parts rightly."""
    k, n = np.arange(BALL.axes) + 0.5, BALL.steps if folded else 2 * BALL.steps
    level, turn = np.sqrt(1 - (k / BALL.axes) ** 2), np.pi * (1 + 5**0.5) * k
    axes = np.column_stack(
        [level * np.cos(turn), level * np.sin(turn), k / BALL.axes]
    )  # a spiral
    every = -(-len(value) // BALL.most_pixels)
    for wide in BALL.closer:
        along = points[::every] @ axes.T
        place = (n * (np.abs(along) if folded else (along + 1) / 2)).astype(np.int64)
        place = np.minimum(place, n - 1) + n * np.arange(len(axes))
        weights = np.broadcast_to(value[::every, None], place.shape).ravel()
        sums = (
            np.bincount(place.ravel(), weights, n * len(axes))
            .reshape(-1, n)
            .cumsum(axis=1)
        )
        gain = sums[:, -1:] - 2 * sums  # what is beyond, less what is within
        best, step = np.unravel_index(np.argmax(np.abs(gain)), gain.shape)
        normal, most, at = axes[best], gain[best, step], (step + 1) / n
        shift = wide * np.linspace(-1, 1, 5)
        right, down = np.linalg.svd(normal[None])[2][1:]
        axes = normal + (shift[:, None, None] * right + shift[:, None] * down).reshape(
            -1, 3
        )
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        every = 1
    found = Border(
        normal, float(at if folded else 2 * at - 1), folded, float(np.sign(most))
    )
    return 0.5 + abs(most) / (2 * len(value)), found


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
    """(h, w, 3) linear, of either sign: highlights, and what skin and Lambert's law do not tell; it does not turn."""
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
        """(h, w, 3) shading of the normals (u, v, z to the viewer)."""
        plain = sphere_shading(self.light, u, v, z)[..., None]
        if self.trust < 1:
            plain = np.power(plain, np.float32(self.trust))
        if self.even is None:
            return plain
        more = np.stack(np.broadcast_arrays(*basis(u, v, z)), axis=-1) @ self.even
        return np.asarray(
            plain * np.exp(np.clip(more, -BALL.most_departure, BALL.most_departure)),
            np.float32,
        )

    @cached_property
    def lit(self) -> F32:
        """(h, w, 3) shading on the ball's own box."""
        shape = self.skin.shape
        picture = self.shade(
            *normals_within(shape, self.corner, self.center, self.radius)[:3]
        )
        if self.fade is not None:
            picture = picture * self.fade[..., None]
        return np.asarray(np.broadcast_to(picture, shape).copy(), np.float32)


def normals_within(
    shape: tuple[int, ...],
    corner: tuple[int, int],
    center: tuple[float, float],
    radius: float,
) -> tuple[F32, F32, F32, F32]:
    """(h, w) u, v and z of a sphere's normals on a box of a photo, beyond RIM as they are there; and radii away."""
    x, y = (
        np.arange(n) + k - c
        for n, k, c in zip(shape[1::-1], corner, center, strict=True)
    )
    u, v = np.meshgrid((x / radius).astype(np.float32), (y / radius).astype(np.float32))
    rho = np.sqrt(np.maximum(u * u + v * v, 1e-12))
    squeeze = np.minimum(np.float32(1), np.float32(RIM) / rho)
    u, v = u * squeeze, v * squeeze
    return u, v, np.sqrt(np.maximum(1 - u * u - v * v, 0)), rho


def sphere_shading(light: DistantLight, u: F32, v: F32, z: F32) -> F32:
    """Lambert's law on a unit sphere's normals (u, v, z to the viewer), never below BALL.darkest of the most."""
    lx, ly, lz = (np.float32(c) for c in light.direction)
    facing = np.maximum(lx * u + ly * v + lz * z, 0)
    shade = np.float32(light.ambient) + np.float32(light.intensity) * facing
    return np.asarray(
        np.maximum(shade, np.float32(BALL.darkest * (light.ambient + light.intensity))),
        np.float32,
    )


def ball_from_photo(
    colour: F32,
    corner: tuple[int, int],
    center: tuple[float, float],
    radius: float,
    light: DistantLight,
    view: View,
    is_painted: bool = True,
) -> Ball:
    """`colour` (h, w, 3) linear light of the ball alone on a box of the photo that begins at `corner`.

    Seen from above a ball turns its far side up; seen from the side it turns in the picture, and all that is needed is
    there. If `is_painted`, the far side has the pattern of billiard balls; else it continues the texture.
    """
    su, sv, z, rho = normals_within(colour.shape, corner, center, radius)
    x = su * np.float32(radius) + np.float32(center[0] - corner[0])
    y = sv * np.float32(radius) + np.float32(center[1] - corner[1])
    inner = np.asarray(
        cv2.remap(colour, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
        np.float32,
    )
    shine = _gloss(inner, su, sv, z, radius, light)
    ball = Ball(corner, center, radius, inner, shine, light, inner)
    ball = replace(
        ball, trust=_shown(inner - shine, sphere_shading(light, su, sv, z), rho < RIM)
    )
    bare = np.ascontiguousarray((inner - shine) / ball.shade(su, sv, z), np.float32)
    ball = replace(ball, skin=bare)
    inside, soft = (rho < 1).astype(np.float32), np.ones_like(rho)
    found = find_paints(bare, su, sv, z, (rho < RIM) & (shine.max(axis=2) <= 0))
    if found is not None and found.between < BALL.painted:
        ball = replace(ball, even=found.even)
        lit = ball.shade(su, sv, z)
        seen = (inner - shine) / lit
        cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
        paint = np.argmin(
            [np.abs(seen - c).max(axis=2) for c in found.colours], axis=0
        ).astype(np.uint8)
        flat = found.colours[
            cv2.medianBlur(paint, 3)
        ]  # without what is narrower than 2 px
        points, pattern = _points(colour.shape, corner, center, radius), None
        if view is View.TOP and is_painted:
            use = (rho < RIM) & (shine.max(axis=2) <= 0)
            pattern = find_pattern(seen[use], found.colours, points[use])
        if pattern is not None:
            flat = pattern.painted(points, 1 / radius)
            shine = np.minimum(shine, np.maximum(inner - flat * lit, 0))
            seen = (inner - shine) / lit
        excess = np.maximum(seen - BALL.excess * cv2.dilate(flat, cross), 0)
        excess = cv2.morphologyEx(excess, cv2.MORPH_OPEN, cross)  # a line is paint
        bare, shine = seen - excess, shine + excess * lit
        if pattern is None:
            soft = blurred_share(
                bare.mean(axis=2), flat.mean(axis=2), inside, BALL.smooth * radius
            )
            bare = bare / soft[..., None]
        else:
            bare = _painted(replace(ball, gloss=shine, pattern=pattern)).skin
        ball = replace(ball, skin=bare, gloss=shine, pattern=pattern)
    if _plain(bare, su, sv, z, rho < RIM):
        # a ball of one colour looks the same however it has turned: all that is uneven is light, and stays
        even = np.broadcast_to(np.median(bare[rho < RIM], axis=0), bare.shape).copy()
        ball = replace(ball, skin=even, pattern=None)
        return replace(ball, gloss=colour - ball.skin * ball.lit)
    if view is View.TOP and not is_painted:
        ball = _without_highlights(ball, rho < RIM)
        shine = ball.gloss
    # what the model has not of the rim is the light's doing, and stays: its brightness, not its colours
    model = (ball.skin * ball.lit).mean(axis=2)
    share = blurred_share(
        (colour - shine).mean(axis=2), model, inside, max(1.0, BALL.even * radius)
    )
    return replace(
        ball, fade=np.asarray(np.where(rho > BALL.rim_light, share, soft), np.float32)
    )


def _without_highlights(ball: Ball, inside: NDArray[np.bool_]) -> Ball:
    """Return a ball whose far side continues its skin, highlights moved to its gloss."""
    skin = part_highlights(ball.skin, inside, ball.radius)
    gloss = ball.gloss + (ball.skin - skin) * ball.lit
    return replace(ball, skin=skin, gloss=gloss, is_continued=True)


def _shown(colour: F32, shade: F32, inside: NDArray[np.bool_]) -> float:
    """0..1: the slope of a ball's own brightness over its foretold shading, in logarithms; 1 from BALL.plainly on."""
    if np.count_nonzero(inside) < 50:
        return 1.0
    x, y = (
        np.log(np.maximum(part[inside], 5e-3)).astype(np.float64)
        for part in (shade, colour.mean(axis=2))
    )
    x -= x.mean()
    if (spread := float((x * x).mean())) < 1e-4:
        return 1.0
    trust = np.ones(len(x))
    slope = level = 0.0
    for _ in range(4):
        level = float(np.average(y - slope * x, weights=trust))
        slope = float(
            (trust * x * (y - level)).sum()
            / ((trust * x * x).sum() + 0.02 * spread * len(x))
        )
        trust = 1 / np.maximum(np.abs(y - level - slope * x) / 0.2, 1)
    return float(np.clip(slope / BALL.plainly, 0, 1))


def blurred_share(seen: F32, model: F32, weight: F32, sigma: float) -> F32:
    """(h, w) how much brighter an object is than its model, evenly."""
    above, below = (
        cv2.GaussianBlur(part * weight, (0, 0), sigma) for part in (seen, model)
    )
    share = (above + np.float32(BALL.dim)) / (
        below + np.float32(BALL.dim)
    )  # dark skin tells little
    return np.asarray(np.clip(share, 1 / BALL.fades, BALL.fades), np.float32)


def in_one_light(balls: Sequence[Ball]) -> list[Ball]:
    """Painted balls in the light that they share, by what all show where no neighbour is near or mirrored: how bright
    each normal is, and what it mirrors of lamps, windows and the table. The paint that most of them wear is one."""
    painted = [ball for ball in balls if ball.pattern is not None]
    if len(painted) < BALL.together:
        return list(balls)
    half = max(round(ball.radius) for ball in painted)
    side = (2 * half + 1, 2 * half + 1)
    points = _points(side, (0, 0), (half, half), half)
    middles = [np.subtract(ball.center, ball.corner) for ball in painted]
    shown = [
        (
            _sampled(ball.seen, side, ball.radius / half, middle - ball.radius),
            *_open(points, ball, balls),
        )
        for ball, middle in zip(painted, middles, strict=True)
    ]
    seen, lit, clear, plain = (np.stack(part) for part in zip(*shown, strict=True))
    shared = replace(
        painted[0], trust=float(np.median([ball.trust for ball in painted])), even=None
    )
    patterns = [ball.pattern for ball in painted if ball.pattern is not None]
    shade = shared.shade(*np.moveaxis(points, 2, 0))
    even, patterns = _shared_light(seen / shade, points, lit, patterns)
    shared = replace(shared, even=even)
    shade = shared.shade(*np.moveaxis(points, 2, 0))
    model = np.stack([one.painted(points, 1 / half) for one in patterns]) * shade
    # what is mirrored shows on dark paint, light on bright paint
    dim = model < BALL.dark
    gloss = np.maximum(
        _usual(seen - model, clear[..., None] & dim, plain[..., None] & dim), 0
    )
    most = np.median(
        np.where(seen.min(axis=3, keepdims=True) > BALL.clipped, 1, seen - model),
        axis=0,
    )
    gloss = np.where(points[..., 2:] ** 2 > 0.5, np.clip(most, 0, gloss), gloss)
    share = np.clip(
        (seen - gloss) / np.maximum(model, BALL.dim), 1 / BALL.fades, BALL.fades
    )
    share = _usual(share, clear[..., None] & ~dim, np.ones_like(dim)).mean(axis=2)
    fade = np.where(
        np.hypot(points[..., 0], points[..., 1]) > BALL.rim_light, share, np.float32(1)
    )
    found = {}
    for ball, middle, pattern in zip(painted, middles, patterns, strict=True):
        size, scale = ball.skin.shape[1::-1], half / ball.radius
        shine, rim = (
            _sampled(part, size, scale, half - scale * middle) for part in (gloss, fade)
        )
        one = replace(
            ball, gloss=shine, fade=rim, even=even, trust=shared.trust, pattern=pattern
        )
        found[id(ball)] = _painted(one)
    return [found.get(id(ball), ball) for ball in balls]


def _painted(ball: Ball) -> Ball:
    """A ball `seen` in the photo with the skin of its pattern, and what is written on it."""
    assert ball.pattern is not None
    points = _points(ball.skin.shape, ball.corner, ball.center, ball.radius)
    flat, ink = (
        ball.pattern.painted(points, 1 / ball.radius),
        (ball.seen - ball.gloss) / ball.lit,
    )
    ink = np.clip(ink, 0, ball.pattern.colours.max(axis=0)) - flat
    skin = flat + ball.pattern.written(points, 1 / ball.radius)[0] * ink
    return replace(ball, skin=np.asarray(skin, np.float32))


def _points(
    shape: tuple[int, ...],
    corner: tuple[int, int],
    center: tuple[float, float],
    radius: float,
) -> NDArray[Any]:
    """(h, w, 3) normals, as `normals_within`."""
    return np.stack(
        np.broadcast_arrays(*normals_within(shape, corner, center, radius)[:3]), axis=-1
    )


def _sampled(picture: F32, size: Sequence[int], scale: float, shift: Array) -> F32:
    """Of a picture, at `scale` times the columns and rows of `size`, and `shift`."""
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


def _open(
    points: NDArray[Any], ball: Ball, balls: Sequence[Ball]
) -> list[NDArray[np.bool_]]:
    """(h, w) where no other ball gives a ball's normals (h, w, 3) much light, where they mirror none, and either: where
    its pattern has one paint, and nothing is written on it."""
    assert ball.pattern is not None
    plain = (np.abs(ball.pattern.values(points)) > BALL.even) & (
        ball.pattern.written(points, 1e-3)[0][..., 0] == 0
    )
    lit, clear = plain.copy(), plain.copy()
    mirrored = 2 * points[..., 2:] * points - np.array([0, 0, 1], np.float32)
    for other in balls:
        way = (
            np.append(
                np.subtract(other.center, ball.center), other.radius - ball.radius
            )
            / ball.radius
        )
        far, size = float(np.linalg.norm(way)), other.radius / ball.radius
        if far > 0:
            off = way - points
            along = (off * mirrored).sum(axis=2)
            lit &= (points @ way) * (size**2 / far**3) < BALL.lent
            clear &= (along < 0) | (
                (off * off).sum(axis=2) - along**2 > (BALL.beyond * size) ** 2
            )
    return [lit if lit.any() else plain, clear, plain]


def _shared_light(
    bare: NDArray[Any],
    points: NDArray[Any],
    lit: NDArray[np.bool_],
    patterns: Sequence[Pattern],
) -> tuple[F32, list[Pattern]]:
    """(8, 3) weights of `basis` of the light on all balls, whose light over Lambert's shading is `bare` (n, h, w, 3),
    from where they are `lit` (n, h, w); and the patterns with their colours in it."""
    values = np.stack([pattern.values(points) for pattern in patterns])
    use = lit & (np.hypot(points[..., 0], points[..., 1]) < 0.99 * RIM)
    which = (2 * np.arange(len(patterns))[:, None, None] + (values > 0))[use]
    kinds, paint = np.unique(which, return_inverse=True)
    level = np.log(np.maximum(bare[use], 0) + np.float32(BALL.dim)).astype(np.float64)
    rows = np.column_stack(basis(*np.broadcast_to(points, bare.shape)[use].T)).astype(
        np.float64
    )
    shows = 1 - BALL.dim * np.exp(-level).mean(axis=1)
    even, trust = np.zeros((8, 3)), shows
    for _ in range(BALL.rounds):
        even = _solved(rows, level, paint, trust)
        left = level - rows @ even
        off = np.abs(left - _each(np.median, left, paint)[paint]).max(axis=1)
        trust = shows / np.maximum(off / BALL.odd, 1)
    colours = np.stack([pattern.colours for pattern in patterns]).reshape(-1, 3)
    left = np.maximum(bare[use], 0) * np.exp(-rows @ even)
    low, middle = (
        _each(lambda part, axis, q=q: np.quantile(part, q, axis), left, paint)
        for q in (0.2, 0.5)
    )
    colours[kinds] = np.where(
        middle < BALL.dark, low, middle
    )  # of dark paint some mirrors more
    tone = np.log(colours + np.float32(BALL.dim))
    grey = tone.mean(axis=1, keepdims=True)
    alike = np.abs((tone - grey)[:, None] - (tone - grey)).max(axis=2) < BALL.alike
    alike &= np.abs(grey - grey.T) < BALL.contrast
    most = alike[alike.sum(axis=1).argmax()]
    if 2 * most.sum() > len(patterns):
        seen = np.bincount(which, minlength=len(colours))[most] + BALL.dim
        colours[most] = np.average(colours[most], axis=0, weights=seen)
    return even.astype(np.float32), [
        replace(pattern, colours=colours[2 * k : 2 * k + 2])
        for k, pattern in enumerate(patterns)
    ]


def _usual(pictures: F32, *known: NDArray[np.bool_]) -> F32:
    """(h, w, 3) what pictures (n, h, w, 3) have, of the first of `known` that two are of; else their least."""
    found = pictures.min(axis=0)
    for where in reversed(known):
        ordered = np.sort(np.where(where, pictures, np.float32(np.inf)), axis=0)
        place = np.rint(BALL.usual * np.maximum(where.sum(axis=0) - 1, 0)).astype(
            np.int64
        )
        found = np.where(
            where.sum(axis=0) > 1,
            np.take_along_axis(ordered, place[None], axis=0)[0],
            found,
        )
    return np.asarray(found, np.float32)


def _plain(bare: F32, u: F32, v: F32, z: F32, inside: NDArray[np.bool_]) -> bool:
    """Whether a ball is of one colour: its skin as it seems changes evenly, but for a tenth of it."""
    if np.count_nonzero(inside) < 50:
        return False
    level = np.log(np.maximum(bare, 1e-3))[inside].astype(np.float64)
    rows = np.column_stack(
        [
            np.ones(len(level)),
            *(np.broadcast_to(n, inside.shape)[inside] for n in (u, v, z)),
        ]
    )
    left = level - rows @ np.linalg.lstsq(rows, level, rcond=None)[0]
    return bool(np.percentile(np.abs(left), 90) < BALL.plain)


def _gloss(
    colour: F32, u: F32, v: F32, z: F32, radius: float, light: DistantLight
) -> F32:
    """Bright spots near where a mirror would show the light."""
    half = np.array(light.direction) + np.array([0.0, 0.0, 1.0])
    length = float(np.linalg.norm(half))
    if length < 1e-6 or radius < 4:
        return np.zeros_like(colour)
    hx, hy, hz = (np.float32(c / length) for c in half)
    # a bright disc with a number is as wide as the disc
    line, wide = (
        cv2.getStructuringElement(
            cv2.MORPH_ELLIPSE, (2 * max(1, round(width * radius / 2)) + 1,) * 2
        )
        for width in (BALL.line_width, BALL.gloss_width)
    )
    beneath = cv2.morphologyEx(
        colour, cv2.MORPH_CLOSE, line, borderType=cv2.BORDER_REPLICATE
    )
    beneath = cv2.morphologyEx(
        beneath, cv2.MORPH_OPEN, wide, borderType=cv2.BORDER_REPLICATE
    )
    beneath = np.minimum(cv2.dilate(beneath, np.ones((3, 3), np.uint8)), colour)
    dimmest = colour.min(axis=2)
    near = hx * u + hy * v + hz * z > BALL.gloss_cosine
    core = (dimmest > BALL.gloss_least) & near
    core &= dimmest > 1.5 * beneath.min(axis=2) + 0.05
    # a white stripe is as white elsewhere on the ball; a highlight outshines all of it
    paint = dimmest / sphere_shading(light, u, v, z)
    beside = ~near & (u * u + v * v < 0.99 * RIM * RIM)
    if not beside.any():  # nothing beside it to outshine
        return np.zeros_like(colour)
    core &= (paint > BALL.outshines * np.percentile(paint[beside], 97)) | (
        dimmest > BALL.clipped
    )
    if not core.any():
        return np.zeros_like(colour)
    reach = max(2, round(0.12 * radius))
    around = cv2.dilate(
        core.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    )
    soft = cv2.GaussianBlur(around.astype(np.float32), (0, 0), max(0.6, reach / 3))
    return np.asarray(np.maximum(colour - beneath, 0) * soft[..., None], np.float32)
