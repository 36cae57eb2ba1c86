"""A sphere in the photo: its colour without light, its gloss, and its shading.

The colour turns with the ball; shading and highlights stay where the light is. A point of the far side has the colour
of its antipode: stripes go on round the ball, and numbers have their like behind. A ball has few paints: with each
pixel's paint known, what else changes evenly over the ball is light; with light known, paints tell apart. Both are
found in turn, in logarithms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import DistantLight
from physgen.scene.scene import View

F32 = NDArray[np.float32]
Array = NDArray[np.float64]
Ids = NDArray[np.int64]


@dataclass(frozen=True)
class BallTuning:
    """Thresholds of the separation of a ball into colour, gloss and shading."""

    paints: int = 5  # at most, on one ball
    dim: float = 0.03  # linear light below which colours hardly tell paints apart
    most_pixels: int = 500  # of a ball, that are asked
    rounds: int = 4
    stiff: float = 0.02  # weight, in shares of the ball's pixels, that keeps shading near Lambert's
    odd: float = 0.15
    """Departure in log light from which a pixel counts less: a highlight, a seam, a mixed pixel."""
    same: float = 0.25  # distance in log light up to which two paints are one
    mixed: float = 0.08  # of linear light: what is so near to a paint, or to a mixture of two, is none
    undecided: float = 0.08  # of the brightest paint: what differs more from every paint is between them
    excess: float = 1.3  # times its paint that a pixel may send back: what is more is a reflection
    most_departure: float = 1.0  # of the departure from Lambert, in log light
    darkest: float = 0.18  # of full light: where less falls, the photo's own darkness is taken for the skin's
    painted: float = 0.55  # share of pixels between paints up to which a ball is taken for a painted one
    plainly: float = 0.6
    """Slope of a ball's brightness over its predicted shading from which the light is taken as it is."""
    brighter: float = 1.6  # than all that is seen of a ball, that its skin may be
    rim_light: float = 0.85
    """Of the radius: farther out the photo's own brightness is separated from the model's."""
    even: float = 0.08  # of the radius over which it is evened out
    fades: float = 1.6  # by how much it may differ
    plain: float = 0.2  # departure of log light from an even change, up to which a ball is of one colour
    gloss_width: float = 0.5
    """Of the radius: what outshines its surroundings over no more than this, in any direction, may be a highlight."""
    gloss_least: float = 0.6  # linear light that the dimmest channel of a highlight has at least
    outshines: float = 1.2  # times the brightest paint elsewhere on the ball that a highlight has at least
    clipped: float = 0.9  # linear light that hardly any paint sends back
    angles: int = 128  # places along the rim at which paints are looked up
    gloss_cosine: float = 0.80
    """Of the angle between a highlight's normal and the mirror's direction, at least."""


BALL = BallTuning()


def basis(u: F32, v: F32, z: F32) -> list[F32]:
    """Real harmonics of first and second degree on the unit sphere, unnormalised: 8 pictures."""
    return [u, v, z - np.float32(0.5), u * v, u * z, v * z, u * u - v * v, 3 * z * z - 1]


@dataclass(frozen=True)
class Paints:
    """What a ball wears, and in what light."""

    even: F32  # (8, 3) weights of `basis`: log of what each channel's light does beyond Lambert's law
    colours: F32  # (K, 3) linear, in full light
    between: float  # Share of pixels that are unlike all paints: few on a painted ball


def find_paints(bare: F32, u: F32, v: F32, z: F32, use: NDArray[np.bool_]) -> Paints | None:
    """`bare` (h, w, 3) is light over Lambert's shading of the normals (u, v, z), from the pixels in `use`."""
    used = np.flatnonzero(use)
    if len(used) < 80:
        return None
    used = used[:: -(-len(used) // BALL.most_pixels)]
    level: Array = np.log(np.maximum(bare.reshape(-1, 3)[used], 0) + np.float32(BALL.dim)).astype(np.float64)
    pictures = [np.broadcast_to(b, use.shape).ravel()[used] for b in basis(u, v, z)]
    rows: Array = np.column_stack(pictures).astype(np.float64)
    grey = level.mean(axis=1)
    # first paints by colour above all, of which light changes little
    paint = _split(np.column_stack([2 * (level - grey[:, None]), 0.7 * grey]))
    even, trust = np.zeros(8), np.ones(len(grey))
    for _ in range(BALL.rounds):
        left = grey - rows @ even
        trust = 1 / np.maximum(np.abs(left - _each(np.median, left, paint)[paint]) / BALL.odd, 1)
        even = _solved(rows, grey, paint, trust)
        bare_now = level - (rows @ even)[:, None]
        paint = _nearest(bare_now, _apart(_each(np.median, bare_now, paint)))
    # then each channel's own light, with the paints as they are: what stands near lends its colour
    each = even[:, None] + _solved(rows, level - (rows @ even)[:, None], paint, trust)
    left = np.maximum(np.exp(level - rows @ each) - BALL.dim, 0)
    colours = _unmixed(_each(np.median, left, paint)[np.argsort(-np.bincount(paint), kind="stable")])
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


def _apart(centers: Array) -> Array:
    """Centres of which none is another one over again."""
    kept: list[Array] = []
    for center in centers:
        if all(np.linalg.norm(center - other) > BALL.same for other in kept):
            kept.append(center)
    return np.array(kept)


def _unmixed(colours: Array) -> Array:
    """Of linear `colours` (K, 3), the most frequent first, those that more frequent ones do not make between them.

    Borders of paints mix, and so do dark paints and what they reflect.
    """
    kept: list[Array] = []
    for colour in colours:
        ways = [(one, other - one) for one in kept for other in kept]
        shares = [np.clip((colour - one) @ way / max(way @ way, 1e-9), 0, 1) for one, way in ways]
        mixtures = [one + share * way for (one, way), share in zip(ways, shares, strict=True)]
        if all(np.abs(colour - mixture).max() > BALL.mixed for mixture in mixtures):
            kept.append(colour)
    return np.array(kept)


def _nearest(points: Array, centers: Array) -> Ids:
    """Number of the nearest centre; centres without points are dropped."""
    away = np.stack([((points - c) ** 2).sum(axis=1) for c in centers])
    return np.unique(np.argmin(away, axis=0), return_inverse=True)[1].astype(np.int64).ravel()


RIM = 0.955
"""Of the radius: farther out pixels are mixed, and so much foreshortened that they tell little."""
NEAR_RIM = 0.75, 0.9
"""Of the radius: between these, pixels give way to paints."""


@dataclass(frozen=True)
class Ball:
    """What is seen of a sphere, on its sprite's box: of one that is cut or hidden, its centre may lie outside."""

    corner: tuple[int, int]  # Photo column and row of the box's first pixel
    center: tuple[float, float]  # px in the photo at t = 0
    radius: float
    skin: F32  # (h, w, 3) linear light over shading, carried outwards from the rim
    gloss: F32
    """(h, w, 3) linear, of either sign: highlights, and what skin and Lambert's law do not tell; it does not turn."""
    light: DistantLight
    even: F32 | None = None  # (8, 3) of `paints.basis`: log of what light does beyond Lambert's law
    trust: float = 1.0
    """0..1: how far the photo shows this light on it; the power that Lambert's shading is raised to."""
    paints: F32 | None = (
        None  # (K, 3) linear, of a ball that is seen from above: all that its skin has at the rim
    )
    fade: F32 | None = None  # (h, w) by which the light at the rim differs from that; it does not turn

    def shade(self, u: F32, v: F32, z: F32) -> F32:
        """(h, w, 3) shading of the normals (u, v, z to the viewer)."""
        plain = sphere_shading(self.light, u, v, z)[..., None]
        if self.trust < 1:
            plain = np.power(plain, np.float32(self.trust))
        if self.even is None:
            return plain
        more = np.stack(np.broadcast_arrays(*basis(u, v, z)), axis=-1) @ self.even
        return np.asarray(
            plain * np.exp(np.clip(more, -BALL.most_departure, BALL.most_departure)), np.float32
        )

    @cached_property
    def lit(self) -> F32:
        """(h, w, 3) shading on the ball's own box."""
        h, w = self.skin.shape[:2]
        u = (np.arange(w, dtype=np.float32) + np.float32(self.corner[0] - self.center[0]))[None, :]
        v = (np.arange(h, dtype=np.float32) + np.float32(self.corner[1] - self.center[1]))[:, None]
        u, v = u / np.float32(self.radius), v / np.float32(self.radius)
        squeeze = np.minimum(np.float32(1), np.float32(RIM) / np.sqrt(np.maximum(u * u + v * v, 1e-12)))
        su, sv = u * squeeze, v * squeeze
        picture = self.shade(su, sv, np.sqrt(np.maximum(1 - su * su - sv * sv, 0)))
        if self.fade is not None:
            picture = picture * self.fade[..., None]
        return np.asarray(np.broadcast_to(picture, (h, w, 3)).copy(), np.float32)


def sphere_shading(light: DistantLight, u: F32, v: F32, z: F32) -> F32:
    """Lambert's law on a unit sphere's normals (u, v, z to the viewer), never below BALL.darkest of the most."""
    lx, ly, lz = (np.float32(c) for c in light.direction)
    facing = np.maximum(lx * u + ly * v + lz * z, 0)
    shade = np.float32(light.ambient) + np.float32(light.intensity) * facing
    return np.asarray(
        np.maximum(shade, np.float32(BALL.darkest * (light.ambient + light.intensity))), np.float32
    )


def ball_from_photo(
    colour: F32,
    corner: tuple[int, int],
    center: tuple[float, float],
    radius: float,
    light: DistantLight,
    view: View,
) -> Ball:
    """`colour` (h, w, 3) linear light of the ball alone on a box of the photo that begins at `corner`.

    Seen from above a ball turns its far side up; seen from the side it turns in the picture, and all that is needed is
    there.
    """
    h, w = colour.shape[:2]
    u = (np.arange(w, dtype=np.float32) + np.float32(corner[0] - center[0]))[None, :] / np.float32(radius)
    v = (np.arange(h, dtype=np.float32) + np.float32(corner[1] - center[1]))[:, None] / np.float32(radius)
    rho = np.sqrt(np.maximum(u * u + v * v, 1e-12))
    squeeze = np.minimum(np.float32(1), np.float32(RIM) / rho)
    su, sv = u * squeeze, v * squeeze
    z = np.sqrt(np.maximum(1 - su * su - sv * sv, 0))
    x = su * np.float32(radius) + np.float32(center[0] - corner[0])
    y = sv * np.float32(radius) + np.float32(center[1] - corner[1])
    inner = np.asarray(cv2.remap(colour, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)
    shine = _gloss(inner, su, sv, z, radius, light)
    ball = Ball(corner, center, radius, inner, shine, light)
    ball = replace(ball, trust=_shown(inner - shine, sphere_shading(light, su, sv, z), rho < RIM))
    bare = np.ascontiguousarray((inner - shine) / ball.shade(su, sv, z), np.float32)
    ball = replace(ball, skin=bare)
    found = find_paints(bare, su, sv, z, (rho < RIM) & (shine.max(axis=2) <= 0))
    if found is not None and found.between < BALL.painted:
        ball = replace(ball, even=found.even)
        lit = ball.shade(su, sv, z)
        seen = (inner - shine) / lit
        cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
        excess = np.maximum(seen - BALL.excess * cv2.dilate(_flat(seen, found, 3), cross), 0)
        excess = cv2.morphologyEx(excess, cv2.MORPH_OPEN, cross)  # a line is paint
        bare, shine = seen - excess, shine + excess * lit
        ball = replace(ball, gloss=shine)
        if view is View.TOP:
            # towards the rim, where few slanted pixels stand for much of the far side, paints instead of pixels
            share = np.clip((rho - NEAR_RIM[0]) / (NEAR_RIM[1] - NEAR_RIM[0]), 0, 1)[..., None]
            bare += share * (_flat(bare, found, 5) - bare)
            ball = replace(ball, paints=found.colours)
        ball = replace(ball, skin=bare)
    if _plain(bare, su, sv, z, rho < RIM):
        # a ball of one colour looks the same however it has turned: all that is uneven is light, and stays
        even = np.broadcast_to(np.median(bare[rho < RIM], axis=0), bare.shape).copy()
        ball = replace(ball, skin=even, paints=None)
        return replace(ball, gloss=colour - ball.skin * ball.lit)
    # no skin sends back more than the brightest that is seen of it in full light
    brightest = np.percentile((inner - shine)[rho < RIM], 98, axis=0) if (rho < RIM).any() else np.ones(3)
    most = BALL.brighter * brightest / (light.ambient + light.intensity)
    paints = None if ball.paints is None else np.minimum(ball.paints, most.astype(np.float32))
    ball = replace(ball, skin=np.minimum(ball.skin, most.astype(np.float32)), paints=paints)
    # what the model has not of the rim is the light's doing, and stays: its brightness, not its colours
    model = (ball.skin * ball.lit).mean(axis=2)
    share = blurred_share(
        (colour - shine).mean(axis=2), model, (rho < 1).astype(np.float32), max(1.0, BALL.even * radius)
    )
    return replace(ball, fade=np.asarray(np.where(rho > BALL.rim_light, share, 1), np.float32))


def _shown(colour: F32, shade: F32, inside: NDArray[np.bool_]) -> float:
    """0..1: the slope of a ball's own brightness over its foretold shading, in logarithms; 1 from BALL.plainly on."""
    if np.count_nonzero(inside) < 50:
        return 1.0
    x, y = (
        np.log(np.maximum(part[inside], 5e-3)).astype(np.float64) for part in (shade, colour.mean(axis=2))
    )
    x -= x.mean()
    if (spread := float((x * x).mean())) < 1e-4:
        return 1.0
    trust = np.ones(len(x))
    slope = level = 0.0
    for _ in range(4):
        level = float(np.average(y - slope * x, weights=trust))
        slope = float((trust * x * (y - level)).sum() / ((trust * x * x).sum() + 0.02 * spread * len(x)))
        trust = 1 / np.maximum(np.abs(y - level - slope * x) / 0.2, 1)
    return float(np.clip(slope / BALL.plainly, 0, 1))


def blurred_share(seen: F32, model: F32, weight: F32, sigma: float) -> F32:
    """(h, w) how much brighter an object is than its model, evenly."""
    above, below = (cv2.GaussianBlur(part * weight, (0, 0), sigma) for part in (seen, model))
    return np.asarray(np.clip(above / np.maximum(below, 1e-3), 1 / BALL.fades, BALL.fades), np.float32)


def equal_area(skin: F32, center: Array, radius: float, paints: F32 | None) -> F32:
    """(h, w, 3) the near side of a `skin` (h, w, 3) in Lambert's azimuthal equal-area projection.

    There the rim, which the photo hardly shows, is wide enough for borders between `paints` to go on from where they
    meet it to where those of the antipodes do: signed distances from borders change evenly between them.
    """
    n, last = BALL.angles, float(np.sqrt(1 - RIM * RIM))

    def seen(u: Array, v: Array) -> F32:
        x, y = (np.asarray(c + radius * part, np.float32) for c, part in zip(center, (u, v), strict=True))
        return np.asarray(
            cv2.remap(skin, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32
        )

    x, y = ((np.arange(size) - c) / radius for size, c in zip(skin.shape[1::-1], center, strict=True))
    u, v = np.meshgrid(x, y)
    z = 1 - u * u - v * v
    out = np.sqrt(1 + np.maximum(z, 0))
    found = seen(out * u, out * v)
    if paints is None or len(paints) < 2:
        return found
    turn = 2 * np.pi * np.arange(n)[None] / n
    rim = seen(RIM * np.cos(turn), RIM * np.sin(turn))[0]
    painted = np.abs(rim[:, None] - paints).max(axis=2).argmin(axis=1)[:, None] == np.arange(len(paints))
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    apart = np.minimum(apart, n - apart)[..., None]
    to, off = (np.where(part[None], apart, n).min(axis=1) for part in (painted, ~painted))
    border = off - to  # (n, K)
    edge = z < last
    at = np.rint(np.arctan2(v[edge], u[edge]) / (2 * np.pi) * n).astype(int)
    share = (0.5 - 0.5 * np.maximum(z[edge], 0) / last)[:, None]
    mixed = (1 - share) * border[at % n] + share * border[(at + n // 2) % n]
    found[edge] = paints[mixed.argmax(axis=1)]
    return found


def _flat(bare: F32, found: Paints, width: int) -> F32:
    """(h, w, 3) the paint that is nearest to each pixel; what is narrower than half of `width` px is left out."""
    paint = np.argmin([np.abs(bare - c).max(axis=2) for c in found.colours], axis=0).astype(np.uint8)
    return np.asarray(found.colours[cv2.medianBlur(paint, width)], np.float32)


def _plain(bare: F32, u: F32, v: F32, z: F32, inside: NDArray[np.bool_]) -> bool:
    """Whether a ball is of one colour: its skin as it seems changes evenly, but for a tenth of it."""
    if np.count_nonzero(inside) < 50:
        return False
    level = np.log(np.maximum(bare, 1e-3))[inside].astype(np.float64)
    rows = np.column_stack(
        [np.ones(len(level)), *(np.broadcast_to(n, inside.shape)[inside] for n in (u, v, z))]
    )
    left = level - rows @ np.linalg.lstsq(rows, level, rcond=None)[0]
    return bool(np.percentile(np.abs(left), 90) < BALL.plain)


def _gloss(colour: F32, u: F32, v: F32, z: F32, radius: float, light: DistantLight) -> F32:
    """Bright spots near where a mirror would show the light."""
    half = np.array(light.direction) + np.array([0.0, 0.0, 1.0])
    length = float(np.linalg.norm(half))
    if length < 1e-6 or radius < 4:
        return np.zeros_like(colour)
    hx, hy, hz = (np.float32(c / length) for c in half)
    side = 2 * max(1, round(BALL.gloss_width * radius / 2)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    beneath = cv2.morphologyEx(colour, cv2.MORPH_OPEN, kernel, borderType=cv2.BORDER_REPLICATE)
    dimmest = colour.min(axis=2)
    near = hx * u + hy * v + hz * z > BALL.gloss_cosine
    core = (dimmest > BALL.gloss_least) & near
    core &= dimmest > 1.5 * beneath.min(axis=2) + 0.05
    # a white stripe is as white elsewhere on the ball; a highlight outshines all of it
    paint = dimmest / sphere_shading(light, u, v, z)
    beside = ~near & (u * u + v * v < 0.99 * RIM * RIM)
    if not beside.any():  # nothing beside it to outshine
        return np.zeros_like(colour)
    core &= (paint > BALL.outshines * np.percentile(paint[beside], 97)) | (dimmest > BALL.clipped)
    count, names, boxes, _ = cv2.connectedComponentsWithStats(core.astype(np.uint8))
    for k in range(1, count):
        long = max(boxes[k, cv2.CC_STAT_WIDTH], boxes[k, cv2.CC_STAT_HEIGHT])
        if long > BALL.gloss_width * radius + 1:
            core[names == k] = False
    if not core.any():
        return np.zeros_like(colour)
    reach = max(2, round(0.12 * radius))
    around = cv2.dilate(core.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    soft = cv2.GaussianBlur(around.astype(np.float32), (0, 0), max(0.6, reach / 3))
    return np.asarray(np.maximum(colour - beneath, 0) * soft[..., None], np.float32)
