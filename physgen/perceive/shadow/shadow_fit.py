"""Fit of a distant light to the shadows in a side view: on the floor, or on a wall
behind the objects.

Slopes of the logarithm of light are compared, at two widths, with those of the
predicted darkness, near these alone: a far edge of the floor or a picture on the wall
has slopes too, but elsewhere. On an upright wall behind, one distant light moves every
shadow alike; in perspective, farther off, the whole is a little smaller.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import acos, asin, atan2, cos, degrees, inf, pi, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.shadows import ShadowSetting, Silhouette
from physgen.maps import F32
from physgen.perceive.roles import LightGuess, Rgb
from physgen.perceive.shadow.silhouettes import (
    DARKEST,
    away_from_objects,
    join_silhouettes,
    predicted_darkness,
    typical_size,
)
from physgen.photometry import DistantLight, decode, luminance

COARSE, FINE = 192, 384
"""px: longer side of the pictures in which the light is searched, first and then."""
TILT = 0.1  # rise over run of the floor where it is unknown
SOFT = 8.0  # degrees: half the width of usual lights, lamps and windows
TRUSTED = 0.3  # confidence of a light from shading from which it counts
FULL = 1.2  # shading of a surface that faces the light: there it shows its own colour


@dataclass(frozen=True)
class _Tuning:
    """Tuning of the search, on studio photos of the split `tune`; sizes are shares of
    an object's.
    """

    widths: tuple[float, ...] = (0.03, 0.08)  # over which slopes are smoothed
    least_seen: float = 0.1  # share of the predicted slopes that must be in sight
    well: float = 0.5  # confidence of a light from shading from which it counts most
    # degrees, standard deviation of such lights: trusted, trusted well
    deviation: tuple[float, float] = (20.0, 7.0)
    # degrees, and standard deviations: no light is tried farther from it
    beyond: tuple[float, float] = (40.0, 2.5)
    pull: float = 0.02  # correlation that one standard deviation from it must gain
    # objects, or groups of them, that the light is searched by at first; the largest
    telling: int = 3
    # of shadows on a wall, in perspective
    wall_sizes: tuple[float, ...] = (
        1.0,
        0.94,
        0.88,
        0.82,
    )
    farthest: float = 5.0  # from an object to its shadow on a wall
    in_sight: float = 0.5  # share of all outlines that must lie in the photo, and free
    # percentile of the photo's slopes: steeper ones are edges of objects, and cut to this
    steepest: float = 97


TUNING = _Tuning()


@dataclass(frozen=True)
class LightGradients:
    """A photo's light at one scale, and the silhouettes that may block some of it."""

    scale: float  # px of the photo in one of this picture
    size: tuple[int, int]  # Width and height, px
    known: F32  # (h, w) 1 where no object is near
    slopes: Sequence[tuple[float, F32, F32, F32]]
    """Width of smoothing, px; (h, w) share known within it; (h, w) slopes of the
    logarithm of light, x and y.
    """
    silhouettes: Sequence[Silhouette]
    joined: Sequence[Silhouette]  # The same, those that stand side by side as one

    @cached_property
    def within(self) -> F32:
        """(h, w) `known`, a pixel less on all sides."""
        return np.asarray(cv2.erode(self.known, np.ones((3, 3), np.uint8)), np.float32)

    @property
    def telling(self) -> list[Silhouette]:
        """Return the largest of `joined`; the small ones would take as long and add
        little.
        """
        areas = [what.area for what in self.joined]
        return [self.joined[k] for k in np.argsort(areas)[::-1][: TUNING.telling]]

    def agreement(self, model: F32) -> tuple[float, float]:
        """Correlation of seen slopes and those of a darkness (h, w), and the factor;
        means over the widths.
        """
        sums = self._sums(model)
        alike = [both / max((own * seen) ** 0.5, 1e-9) for both, own, seen in sums]
        factors = [both / max(own, 1e-9) for both, own, _ in sums]
        return (
            (sum(alike) / len(sums), sum(factors) / len(sums)) if sums else (0.0, 0.0)
        )

    def _sums(self, model: F32) -> list[tuple[float, float, float]]:
        """Of each width: products of predicted and seen slopes, squares of either, near
        what is predicted.

        Empty where hardly any of it is in sight.
        """
        rows, columns = (
            np.flatnonzero(model.max(axis=1) > 0.02),
            np.flatnonzero(model.max(axis=0) > 0.02),
        )
        if len(rows) < 2 or len(columns) < 2:
            return []
        pad = int(3 * self.slopes[-1][0]) + 4
        top, left = max(int(rows[0]) - pad, 0), max(int(columns[0]) - pad, 0)
        part = np.s_[top : int(rows[-1]) + pad + 1, left : int(columns[-1]) + pad + 1]
        model, known = np.minimum(model[part], 2.5), self.known[part]
        within = self.within[part]
        found = []
        for width, near, right, down in self.slopes:
            soft = cv2.GaussianBlur(model * known, (0, 0), width) / np.maximum(
                near[part], 0.05
            )
            dy, dx = np.gradient(soft)
            energy = np.asarray(dx * dx + dy * dy, np.float32)
            edges = energy > 0.01 * float((energy * within).max())
            weight = within * cv2.dilate(
                edges.astype(np.uint8), np.ones((9, 9), np.uint8)
            )
            own = float((weight * energy).sum())
            if own <= TUNING.least_seen * float(energy.sum()):
                return []
            both = -float((weight * (dx * right[part] + dy * down[part])).sum())
            found.append(
                (
                    both,
                    own,
                    float((weight * (right[part] ** 2 + down[part] ** 2)).sum()),
                )
            )
        return found


def light_gradients(
    background: Rgb,
    coverage: F32,
    longest: int,
    at: Callable[[float], Sequence[Silhouette]],
) -> LightGradients | None:
    """Return the photo at a scale; `at` gives the silhouettes at it.

    None where there are none.
    """
    scale = max(max(background.shape[:2]) / longest, 1.0)
    silhouettes = at(scale)
    if not silhouettes:
        return None
    h, w = (max(1, round(n / scale)) for n in background.shape[:2])
    light = np.log(luminance(decode(background)) + DARKEST)
    open_ = away_from_objects(coverage).astype(np.float32)
    share = np.asarray(
        cv2.resize(open_, (w, h), interpolation=cv2.INTER_AREA), np.float32
    )
    small = np.asarray(
        cv2.resize(light * open_, (w, h), interpolation=cv2.INTER_AREA), np.float32
    )
    small = np.asarray(small / np.maximum(share, 0.05), np.float32)
    known = np.asarray(share * (share > 0.5), np.float32)
    slopes = []
    for part in TUNING.widths:
        width = max(part * typical_size(silhouettes), 1.0)
        near = np.asarray(cv2.GaussianBlur(known, (0, 0), width), np.float32)
        down, right = np.gradient(
            cv2.GaussianBlur(small * known, (0, 0), width) / np.maximum(near, 0.05)
        )
        slopes.append(
            (width, near, np.asarray(right, np.float32), np.asarray(down, np.float32))
        )
    return LightGradients(
        scale, (w, h), known, slopes, silhouettes, join_silhouettes(silhouettes)
    )


@dataclass(frozen=True)
class LightFit:
    """A light and the surfaces that its shadows fall on, in px of the photo."""

    setting: ShadowSetting
    likeness: float  # Correlation of predicted and seen slopes
    factor: float  # Seen over predicted darkness, as a logarithm
    each: float = 1.0  # the same where the shadows of objects side by side are added up


def search_light(
    gradients: Sequence[LightGradients], guess: LightGuess
) -> tuple[int, LightFit]:
    """Return the index of the best of `gradients`, and the light in its px: coordinate
    steps from several directions.

    `gradients`: of one size, with floors in different places.
    """
    first = ShadowSetting(guess.light, 4.0, False, TILT, inf, gradients[0].size)
    telling = [one.telling for one in gradients]

    def rated(k: int, setting: ShadowSetting) -> LightFit:
        return _rated(gradients[k], telling[k], setting, guess)

    starts = [
        (k, rated(k, setting))
        for k in range(len(gradients))
        for setting in _starts(first, guess)
    ]
    starts.sort(key=lambda start: -start[1].likeness)

    def climbed(k: int, fit: LightFit) -> LightFit:
        return _climbed(
            fit, _coarse_steps(fit.setting), lambda setting: rated(k, setting)
        )

    k, best = max(
        ((k, climbed(k, fit)) for k, fit in starts[:3]), key=lambda end: end[1].likeness
    )
    for _ in range(2):
        before, best = best, climbed(k, best)
        if best.likeness < before.likeness + 0.005:
            break
    return k, best


def _rated(
    gradients: LightGradients,
    silhouettes: Sequence[Silhouette],
    setting: ShadowSetting,
    guess: LightGuess,
) -> LightFit:
    if (penalty := deviation_penalty(setting.light, guess)) == inf:
        return LightFit(setting, -inf, 0.0)
    likeness, factor = gradients.agreement(predicted_darkness(silhouettes, setting))
    return LightFit(setting, likeness - (_oddness(setting, factor) + penalty), factor)


def _climbed(
    fit: LightFit,
    settings: Iterator[ShadowSetting],
    rated: Callable[[ShadowSetting], LightFit],
) -> LightFit:
    for setting in settings:
        if (other := rated(setting)).likeness > fit.likeness and other.factor > 0:
            fit = other
    return fit


def deviation_penalty(light: DistantLight, guess: LightGuess) -> float:
    """Correlation that a light must gain for its distance from the one of shading;
    infinite where it is too far.
    """
    if guess.confidence < TRUSTED:
        return 0.0
    sure = min((guess.confidence - TRUSTED) / (TUNING.well - TRUSTED), 1.0)
    deviation = TUNING.deviation[0] + sure * (TUNING.deviation[1] - TUNING.deviation[0])
    cosine = sum(
        a * b for a, b in zip(light.direction, guess.light.direction, strict=True)
    )
    angle = degrees(acos(min(max(cosine, -1.0), 1.0)))
    if angle > min(TUNING.beyond[0], TUNING.beyond[1] * deviation):
        return inf
    return TUNING.pull * (angle / deviation) ** 2


def refine_light(
    fine: LightGradients, setting: ShadowSetting, guess: LightGuess
) -> LightFit:
    """Smaller steps from a setting, in px of `fine`, by the largest objects; its
    likeness by all.
    """
    telling = fine.telling

    def rated(where: ShadowSetting) -> LightFit:
        return _rated(fine, telling, where, guess)

    fit = rated(setting)
    for step, times in ((0.12, 1), (0.06, 2), (0.03, 1)):
        for _ in range(times):
            before = fit
            fit = _climbed(fit, iter(list(_fine_steps(fit.setting, step))), rated)
            if fit is before:  # the same steps again would lead nowhere either
                break
    if fit.likeness == -inf:
        return fit
    return LightFit(
        fit.setting, *fine.agreement(predicted_darkness(fine.joined, fit.setting))
    )


def _oddness(setting: ShadowSetting, factor: float) -> float:
    """Correlation that an unusual fit must gain: low or high or sharp light, a steep or
    flat floor, other darkness.
    """
    x, y, z = setting.light.direction
    length = (x * x + z * z) ** 0.5 / max(-y, 0.05)
    slant = 0.03 * max(length - 2, 0.0) + 0.03 * max(0.4 - length, 0.0)
    strength = 0.03 * abs(np.log(max(factor, 0.05)))
    usual = abs(np.log(setting.tilt / TILT)) + abs(np.log(setting.softness / SOFT))
    return float(slant + 0.02 * usual + strength)


def _starts(first: ShadowSetting, guess: LightGuess) -> Iterator[ShadowSetting]:
    if -guess.light.direction[1] > 0.1:
        yield first
    yield replace(first, light=DistantLight((0.0, -1.0, 0.0), 0.3, 0.9))
    for k in range(12):
        turn = 2 * pi * k / 12
        for height in (0.4, 0.75):
            flat = (1 - height**2) ** 0.5
            yield with_direction(first, (flat * cos(turn), -height, flat * sin(turn)))


def _turned(setting: ShadowSetting, step: float) -> Iterator[ShadowSetting]:
    """Return the light turned about the upright, and higher and lower, by so many
    radians.
    """
    x, y, z = setting.light.direction
    turn, rise = atan2(z, x), asin(min(max(-y, -1.0), 1.0))
    for around, up in (
        (step, 0),
        (-step, 0),
        (0, step),
        (0, -step),
        (step, -step),
        (-step, -step),
    ):
        a, e = turn + around / max(cos(rise), 0.3), rise + up
        if sin(e) > 0.1 and e < pi / 2:
            yield with_direction(setting, (cos(e) * cos(a), -sin(e), cos(e) * sin(a)))


def _coarse_steps(setting: ShadowSetting) -> Iterator[ShadowSetting]:
    """Neighbours of a setting, one number changed."""
    yield from _turned(setting, 0.15)
    yield from _turned(setting, 0.06)
    for soft in (1.0, 3.0, 6.0, 12.0, 25.0):
        yield replace(setting, softness=soft)
    for share in (0.2, 0.5, 0.85):
        yield with_direct_share(setting, share)
    for tilt in (0.05, 0.08, 0.12, 0.17):
        yield replace(setting, tilt=tilt)


def _fine_steps(setting: ShadowSetting, step: float) -> Iterator[ShadowSetting]:
    yield from _turned(setting, step)
    for by in (1 + 4 * step, 1 / (1 + 4 * step)):
        yield replace(setting, softness=min(max(setting.softness * by, 0.5), 45.0))
    for by in (1 + 2 * step, 1 / (1 + 2 * step)):
        yield replace(setting, tilt=min(max(setting.tilt * by, 0.02), 0.5))
    now = setting.light.intensity / max(
        setting.light.intensity + setting.light.ambient, 1e-6
    )
    for share in (min(now + step, 0.98), max(now - step, 0.02)):
        yield with_direct_share(setting, share)


def with_direction(setting: ShadowSetting, direction: Sequence[float]) -> ShadowSetting:
    """Return the same under a light from another direction (unit)."""
    x, y, z = (float(c) for c in direction)
    light = setting.light
    return replace(
        setting, light=DistantLight((x, y, z), light.intensity, light.ambient)
    )


def with_direct_share(setting: ShadowSetting, share: float) -> ShadowSetting:
    """Return the same with so much of the light direct where it falls straight."""
    light = DistantLight(setting.light.direction, share * FULL, (1 - share) * FULL)
    return replace(setting, light=light)


@dataclass(frozen=True)
class WallShadow:
    """The objects' shadows on a wall behind, in px of the photo."""

    # From an object to its shadow, in the middle of the photo
    shift: tuple[float, float]
    size: float  # Of shadow to object, about the middle of the photo
    likeness: float = 0.0  # correlation of slopes along the outlines
    factor: float = 0.0  # -log of the light that is left
    soft: float = 0.0  # px, standard deviation of the shadows' edges

    def convincing(self, count: int) -> bool:
        """One round object finds a round patch almost anywhere; several must find
        theirs all at once.
        """
        return self.likeness >= float(0.5 + 0.35 / max(count, 1) ** 0.5)


def cast_on_wall(
    what: Silhouette, shadow: WallShadow, scale: float, size: tuple[int, int]
) -> F32:
    """(h, w) coverage of the wall by its shadow, on a picture of `size` (w, h), 1 /
    scale of the photo's.
    """
    middle = (size[0] - 1) / 2, (size[1] - 1) / 2
    matrix = np.zeros((2, 3))
    for k in (0, 1):
        matrix[k, k] = shadow.size
        matrix[k, 2] = (
            shadow.size * (what.corner[k] - middle[k])
            + middle[k]
            + shadow.shift[k] / scale
        )
    return np.asarray(
        cv2.warpAffine(what.coverage, matrix, size, flags=cv2.INTER_LINEAR), np.float32
    )


def wall_coverage(
    silhouettes: Sequence[Silhouette],
    shadow: WallShadow,
    scale: float,
    size: tuple[int, int],
) -> F32:
    """(h, w) coverage of the wall by all shadows, with sharp edges."""
    total = np.zeros(size[::-1], np.float32)
    for what in silhouettes:
        np.maximum(total, cast_on_wall(what, shadow, scale, size), out=total)
    return total


def refine_wall_shadow(gradients: LightGradients, shadow: WallShadow) -> WallShadow:
    """Smaller steps from a wall shadow, and the softness of its edges, on a finer
    picture.
    """

    def rated(one: WallShadow) -> WallShadow:
        total = wall_coverage(
            gradients.silhouettes, one, gradients.scale, gradients.size
        )
        soft = one.soft / gradients.scale
        model = (
            total
            if soft < 0.3
            else np.asarray(cv2.GaussianBlur(total, (0, 0), soft), np.float32)
        )
        likeness, factor = gradients.agreement(model)
        return replace(one, likeness=likeness, factor=factor)

    def steps(one: WallShadow, step: float) -> list[WallShadow]:
        (dx, dy) = one.shift
        moved = [
            replace(one, shift=(dx + a * step, dy + b * step))
            for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))
        ]
        return [
            *moved,
            replace(one, soft=one.soft * 1.5),
            replace(one, soft=one.soft / 1.5),
        ]

    best = rated(replace(shadow, soft=gradients.slopes[0][0] * gradients.scale))
    for step in (4.0, 2.0, 1.0):
        by = 0.01 * step
        sizes = [replace(best, size=best.size + by), replace(best, size=best.size - by)]
        tries = steps(best, step)
        tries = [*tries[:4], *sizes, *tries[4:]]
        for _ in range(2):
            best = max(
                [best, *(rated(one) for one in tries)], key=lambda one: one.likeness
            )
            tries = steps(best, step)
    return best


def find_wall_shadow(gradients: LightGradients) -> WallShadow | None:
    """Return the best way to move the objects onto their shadows; None where no way
    keeps enough of them in sight.
    """
    width, near, right, down = gradients.slopes[-1]
    within = cv2.erode(gradients.known, np.ones((3, 3), np.uint8)) * (near > 0.3)
    steep = np.hypot(right, down)
    free = steep[within > 0]
    if not free.size:
        return None
    cut = np.minimum(1, np.percentile(free, TUNING.steepest) / np.maximum(steep, 1e-6))
    right, down = within * right * cut, within * down * cut
    shape = (
        cv2.getOptimalDFTSize(2 * gradients.size[1]),
        cv2.getOptimalDFTSize(2 * gradients.size[0]),
    )
    spectra = [
        np.fft.rfft2(part, shape)
        for part in (right, down, right * right + down * down, within)
    ]
    rows, columns = (np.fft.fftfreq(n, 1 / n)[:, None] for n in shape)
    reach = TUNING.farthest * typical_size(gradients.silhouettes)
    allowed = (np.abs(columns.T) < reach) & (rows > -0.12 * reach) & (rows < reach)

    def correlated(k: int, by: F32) -> NDArray[np.float64]:
        return np.fft.irfft2(spectra[k] * np.conj(np.fft.rfft2(by, shape)), shape)

    best: WallShadow | None = None
    for size in TUNING.wall_sizes:
        outline = wall_coverage(
            gradients.silhouettes, WallShadow((0.0, 0.0), size), 1.0, gradients.size
        )
        dy, dx = np.gradient(cv2.GaussianBlur(outline, (0, 0), width))
        energy = dx * dx + dy * dy
        edges = (energy > 0.02 * energy.max()).astype(np.float32)
        band = np.asarray(cv2.dilate(edges, np.ones((5, 5), np.uint8)), np.float32)
        both = -(correlated(0, dx) + correlated(1, dy))
        own, seen = (
            np.maximum(correlated(3, energy), 1e-9),
            np.maximum(correlated(2, band), 1e-9),
        )
        visible = allowed & (own > TUNING.in_sight * energy.sum())
        likeness = np.where(visible, both / np.sqrt(own * seen), -1.0)
        row, column = np.unravel_index(int(likeness.argmax()), likeness.shape)
        if likeness[row, column] > (best.likeness if best else 0.0):
            shift = (
                float(columns[column, 0]) * gradients.scale,
                float(rows[row, 0]) * gradients.scale,
            )
            factor = float(both[row, column] / own[row, column])
            best = WallShadow(shift, size, float(likeness[row, column]), factor)
    return best
