"""Fit of a distant light to the shadows in a side view, on the floor or a wall behind.

The gradients of the logarithm of light are compared, at two widths, with the gradients
of the predicted darkness, only near predicted shadows: a far edge of the floor or a
picture on the wall has gradients, too, but elsewhere. On an upright wall behind, a
distant light shifts every shadow equally; in perspective the farther shadows are a
little smaller.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import acos, asin, atan2, cos, degrees, inf, pi, sin
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.shadows import ShadowSetting, Silhouette
from physgen.maps import F32
from physgen.perceive.roles import LightGuess, Mask, Rgb
from physgen.perceive.shadow.silhouettes import (
    DARKEST,
    away_from_objects,
    join_silhouettes,
    predicted_darkness,
    typical_size,
)
from physgen.photometry import DistantLight, decode, luminance

Spectrum = NDArray[np.complexfloating[Any, Any]]

COARSE, FINE = 192, 384
"""px: longer side of the pictures for the search of the light, first and second."""
# Rise over run of the floor if it is unknown.
TILT = 0.1
# degrees: angular radius of usual lights, lamps and windows.
SOFT = 8.0
# Least confidence of a usable light from shading.
TRUSTED = 0.3
# Shading of a surface that faces the light and shows its true colour.
FULL = 1.2


@dataclass(frozen=True)
class _Tuning:
    """Tuning of the search on studio photos of the split `tune`.

    Sizes are shares of an object's.
    """

    # Widths of the smoothing of gradients.
    widths: tuple[float, ...] = (0.03, 0.08)
    # Least visible share of the predicted gradients.
    least_visible_share: float = 0.1
    # Confidence of a light from shading with full weight.
    well: float = 0.5
    # degrees: standard deviations of such a light at low and full confidence.
    deviation: tuple[float, float] = (20.0, 7.0)
    # Largest tested distance from that light: degrees, and standard deviations.
    largest_deviation: tuple[float, float] = (40.0, 2.5)
    # Correlation that one standard deviation from that light must gain.
    pull: float = 0.02
    # Number of the largest objects or groups in the first search.
    telling: int = 3
    # Relative sizes of shadows on a wall, in perspective.
    wall_sizes: tuple[float, ...] = (
        1.0,
        0.94,
        0.88,
        0.82,
    )
    # Largest distance from an object to its shadow on a wall.
    farthest: float = 5.0
    # Least free share of all outlines inside the photo.
    in_sight: float = 0.5
    # Percentile of the photo's gradients: steeper ones are edges of objects and are
    # clipped to it.
    steepest: float = 97


TUNING = _Tuning()


@dataclass(frozen=True)
class LightGradients:
    """A photo's light at one scale, and the silhouettes that may block some of it."""

    # px of the photo per px of this picture.
    scale: float
    # Width and height, px.
    size: tuple[int, int]
    # (h, w): 1 away from objects.
    known_weights: F32
    slopes: Sequence[tuple[float, F32, F32, F32]]
    """Per width: the width, px; the known share (h, w) within it; the gradients (h, w)
    of the logarithm of light in x and y.
    """
    silhouettes: Sequence[Silhouette]
    # The silhouettes, with neighbours side by side joined.
    groups: Sequence[Silhouette]

    @cached_property
    def inner_weights(self) -> F32:
        """Return `known_weights` (h, w), eroded by one pixel."""
        return np.asarray(
            cv2.erode(self.known_weights, np.ones((3, 3), np.uint8)), np.float32
        )

    @property
    def telling(self) -> list[Silhouette]:
        """Return the largest of `groups`; small ones cost as much and add little."""
        areas = [silhouette.area for silhouette in self.groups]
        return [self.groups[k] for k in np.argsort(areas)[::-1][: TUNING.telling]]

    def agreement(self, model: F32) -> tuple[float, float]:
        """Return the correlation of measured and predicted gradients, and their ratio.

        `model` is a darkness (h, w); results are means over the widths.
        """
        sums = self._sums(model)
        correlations = [
            product / max((model_energy * photo_energy) ** 0.5, 1e-9)
            for product, model_energy, photo_energy in sums
        ]
        factors = [
            product / max(model_energy, 1e-9) for product, model_energy, _ in sums
        ]
        if sums:
            return (sum(correlations) / len(sums), sum(factors) / len(sums))
        return (0.0, 0.0)

    def _sums(self, model: F32) -> list[tuple[float, float, float]]:
        """Return, per width, products and squares of predicted and measured gradients.

        Only pixels near predicted edges count. The list is empty if hardly any of them
        are visible.
        """
        part = self._window(model)
        if part is None:
            return []
        shadows = np.minimum(model[part], 2.5) * self.known_weights[part]
        inner_weights = self.inner_weights[part]
        result = []
        for width, known_share, right, down in self.slopes:
            dy, dx = np.gradient(
                cv2.GaussianBlur(shadows, (0, 0), width)
                / np.maximum(known_share[part], 0.05)
            )
            energy = np.asarray(dx * dx + dy * dy, np.float32)
            weight = inner_weights * _near_edges(energy, inner_weights)
            model_energy = float((weight * energy).sum())
            if model_energy <= TUNING.least_visible_share * float(energy.sum()):
                return []
            product = -float((weight * (dx * right[part] + dy * down[part])).sum())
            photo_energy = weight * (right[part] ** 2 + down[part] ** 2)
            result.append((product, model_energy, float(photo_energy.sum())))
        return result

    def _window(self, model: F32) -> tuple[slice, slice] | None:
        """Return rows and columns around visible shadows of `model` (h, w), or None."""
        rows = np.flatnonzero(model.max(axis=1) > 0.02)
        columns = np.flatnonzero(model.max(axis=0) > 0.02)
        if len(rows) < 2 or len(columns) < 2:
            return None
        pad = int(3 * self.slopes[-1][0]) + 4
        top = max(int(rows[0]) - pad, 0)
        left = max(int(columns[0]) - pad, 0)
        bottom = int(rows[-1]) + pad + 1
        right = int(columns[-1]) + pad + 1
        return slice(top, bottom), slice(left, right)


def _near_edges(energy: F32, inner_weights: F32) -> NDArray[np.uint8]:
    """Return 1 (h, w) near the edges of predicted shadows, else 0.

    `energy` (h, w) is the squared gradient of the prediction.
    """
    edges = energy > 0.01 * float((energy * inner_weights).max())
    near_edges = cv2.dilate(edges.astype(np.uint8), np.ones((9, 9), np.uint8))
    return np.asarray(near_edges, np.uint8)


def light_gradients(
    background: Rgb,
    coverage: F32,
    longest: int,
    silhouettes_at: Callable[[float], Sequence[Silhouette]],
) -> LightGradients | None:
    """Return the photo at a scale, or None without silhouettes; `silhouettes_at` gives them."""
    scale = max(max(background.shape[:2]) / longest, 1.0)
    silhouettes = silhouettes_at(scale)
    if not silhouettes:
        return None
    h = max(1, round(background.shape[0] / scale))
    w = max(1, round(background.shape[1] / scale))
    light = np.log(luminance(decode(background)) + DARKEST)
    open_ = away_from_objects(coverage).astype(np.float32)
    share = np.asarray(
        cv2.resize(open_, (w, h), interpolation=cv2.INTER_AREA), np.float32
    )
    small = np.asarray(
        cv2.resize(light * open_, (w, h), interpolation=cv2.INTER_AREA), np.float32
    )
    small = np.asarray(small / np.maximum(share, 0.05), np.float32)
    known_weights = np.asarray(share * (share > 0.5), np.float32)
    size = typical_size(silhouettes)
    slopes = []
    for part in TUNING.widths:
        slopes.append(_slopes(small, known_weights, max(part * size, 1.0)))
    return LightGradients(
        scale, (w, h), known_weights, slopes, silhouettes, join_silhouettes(silhouettes)
    )


def _slopes(
    light: F32, known_weights: F32, width: float
) -> tuple[float, F32, F32, F32]:
    """Return `width`, the known share (h, w) within it, and the gradients of `light`
    (h, w) in x and y.
    """
    known_share = np.asarray(cv2.GaussianBlur(known_weights, (0, 0), width), np.float32)
    down, right = np.gradient(
        cv2.GaussianBlur(light * known_weights, (0, 0), width)
        / np.maximum(known_share, 0.05)
    )
    return (
        width,
        known_share,
        np.asarray(right, np.float32),
        np.asarray(down, np.float32),
    )


@dataclass(frozen=True)
class LightFit:
    """A light and the surfaces with its shadows, in px of the photo."""

    setting: ShadowSetting
    # Correlation of predicted and measured gradients.
    likeness: float
    # Ratio of measured and predicted darkness, as logarithms.
    factor: float
    # The same if the shadows of objects side by side are added.
    single_factor: float = 1.0


def search_light(
    gradients: Sequence[LightGradients], guess: LightGuess
) -> tuple[int, LightFit]:
    """Return the index of the best of `gradients`, and the light in its px.

    Coordinate steps start from several directions. `gradients` have one size and differ
    in the positions of floors.
    """
    first = ShadowSetting(guess.light, 4.0, False, TILT, inf, gradients[0].size)
    telling = [candidate.telling for candidate in gradients]

    def rate(k: int, setting: ShadowSetting) -> LightFit:
        return _rate_setting(gradients[k], telling[k], setting, guess)

    starts = [
        (k, rate(k, setting))
        for k in range(len(gradients))
        for setting in _starts(first, guess)
    ]
    starts.sort(key=lambda start: -start[1].likeness)

    def climb(k: int, fit: LightFit) -> LightFit:
        return _choose_better_fit(
            fit, _coarse_steps(fit.setting), lambda setting: rate(k, setting)
        )

    k, best = max(
        ((k, climb(k, fit)) for k, fit in starts[:3]), key=lambda end: end[1].likeness
    )
    # Repeat the steps while they still improve the fit.
    for _ in range(2):
        before = best
        best = climb(k, best)
        if best.likeness < before.likeness + 0.005:
            break
    return k, best


def _rate_setting(
    gradients: LightGradients,
    silhouettes: Sequence[Silhouette],
    setting: ShadowSetting,
    guess: LightGuess,
) -> LightFit:
    if (penalty := deviation_penalty(setting.light, guess)) == inf:
        return LightFit(setting, -inf, 0.0)
    likeness, factor = gradients.agreement(predicted_darkness(silhouettes, setting))
    return LightFit(setting, likeness - (_oddness(setting, factor) + penalty), factor)


def _choose_better_fit(
    fit: LightFit,
    settings: Iterator[ShadowSetting],
    rate: Callable[[ShadowSetting], LightFit],
) -> LightFit:
    for setting in settings:
        if (other := rate(setting)).likeness > fit.likeness and other.factor > 0:
            fit = other
    return fit


def deviation_penalty(light: DistantLight, guess: LightGuess) -> float:
    """Return the correlation that a light must gain for its distance from the shading's
    light.

    The penalty is infinite if the light is too far away.
    """
    if guess.confidence < TRUSTED:
        return 0.0
    weight = min((guess.confidence - TRUSTED) / (TUNING.well - TRUSTED), 1.0)
    deviation = TUNING.deviation[0] + weight * (
        TUNING.deviation[1] - TUNING.deviation[0]
    )
    cosine = sum(
        a * b for a, b in zip(light.direction, guess.light.direction, strict=True)
    )
    angle = degrees(acos(min(max(cosine, -1.0), 1.0)))
    if angle > min(
        TUNING.largest_deviation[0], TUNING.largest_deviation[1] * deviation
    ):
        return inf
    return TUNING.pull * (angle / deviation) ** 2


def refine_light(
    fine: LightGradients, setting: ShadowSetting, guess: LightGuess
) -> LightFit:
    """Return the light after smaller steps from a setting, in px of `fine`.

    The steps use the largest objects; the final likeness uses all objects.
    """
    telling = fine.telling

    def rate(candidate: ShadowSetting) -> LightFit:
        return _rate_setting(fine, telling, candidate, guess)

    fit = rate(setting)
    for step, times in ((0.12, 1), (0.06, 2), (0.03, 1)):
        for _ in range(times):
            before = fit
            fit = _choose_better_fit(
                fit, iter(list(_fine_steps(fit.setting, step))), rate
            )
            # The same steps would fail again.
            if fit is before:
                break
    if fit.likeness == -inf:
        return fit
    return LightFit(
        fit.setting, *fine.agreement(predicted_darkness(fine.groups, fit.setting))
    )


def _oddness(setting: ShadowSetting, factor: float) -> float:
    """Return the correlation that an unusual fit must gain.

    Unusual are a low, high or sharp light, a steep or flat floor, and an unusual
    darkness.
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
            horizontal = (1 - height**2) ** 0.5
            yield with_direction(
                first, (horizontal * cos(turn), -height, horizontal * sin(turn))
            )


def _turn_light(setting: ShadowSetting, step: float) -> Iterator[ShadowSetting]:
    """Yield the light turned about the vertical, and raised and lowered, by `step`
    radians.
    """
    x, y, z = setting.light.direction
    turn = atan2(z, x)
    rise = asin(min(max(-y, -1.0), 1.0))
    for turn_step, rise_step in (
        (step, 0),
        (-step, 0),
        (0, step),
        (0, -step),
        (step, -step),
        (-step, -step),
    ):
        a = turn + turn_step / max(cos(rise), 0.3)
        e = rise + rise_step
        if sin(e) > 0.1 and e < pi / 2:
            yield with_direction(setting, (cos(e) * cos(a), -sin(e), cos(e) * sin(a)))


def _coarse_steps(setting: ShadowSetting) -> Iterator[ShadowSetting]:
    """Yield neighbours of a setting with one changed number."""
    yield from _turn_light(setting, 0.15)
    yield from _turn_light(setting, 0.06)
    for softness in (1.0, 3.0, 6.0, 12.0, 25.0):
        yield replace(setting, softness=softness)
    for share in (0.2, 0.5, 0.85):
        yield with_direct_share(setting, share)
    for tilt in (0.05, 0.08, 0.12, 0.17):
        yield replace(setting, tilt=tilt)


def _fine_steps(setting: ShadowSetting, step: float) -> Iterator[ShadowSetting]:
    yield from _turn_light(setting, step)
    for ratio in (1 + 4 * step, 1 / (1 + 4 * step)):
        yield replace(setting, softness=min(max(setting.softness * ratio, 0.5), 45.0))
    for ratio in (1 + 2 * step, 1 / (1 + 2 * step)):
        yield replace(setting, tilt=min(max(setting.tilt * ratio, 0.02), 0.5))
    direct_share = setting.light.intensity / max(
        setting.light.intensity + setting.light.ambient, 1e-6
    )
    for share in (min(direct_share + step, 0.98), max(direct_share - step, 0.02)):
        yield with_direct_share(setting, share)


def with_direction(setting: ShadowSetting, direction: Sequence[float]) -> ShadowSetting:
    """Return the setting with a light from another (unit) direction."""
    x, y, z = (float(c) for c in direction)
    light = setting.light
    return replace(
        setting, light=DistantLight((x, y, z), light.intensity, light.ambient)
    )


def with_direct_share(setting: ShadowSetting, share: float) -> ShadowSetting:
    """Return the setting with a share of direct light at normal incidence."""
    light = DistantLight(setting.light.direction, share * FULL, (1 - share) * FULL)
    return replace(setting, light=light)


@dataclass(frozen=True)
class WallShadow:
    """The objects' shadows on a wall behind, in px of the photo."""

    # From an object to its shadow, in the middle of the photo.
    shift: tuple[float, float]
    # Ratio of shadow and object, about the middle of the photo.
    size: float
    # Correlation of gradients along the outlines.
    likeness: float = 0.0
    # -log of the remaining light.
    factor: float = 0.0
    # px: standard deviation of the shadows' edges.
    blur: float = 0.0

    def convincing(self, count: int) -> bool:
        """Return whether the likeness suffices for `count` objects.

        A single round object matches some round patch almost anywhere; several objects
        must all match at once.
        """
        return self.likeness >= float(0.5 + 0.35 / max(count, 1) ** 0.5)


def cast_on_wall(
    silhouette: Silhouette, shadow: WallShadow, scale: float, size: tuple[int, int]
) -> F32:
    """Return the coverage (h, w) of the wall by a shadow, on a picture of `size` (w,
    h).

    The picture is 1 / `scale` of the photo's size.
    """
    middle = (size[0] - 1) / 2, (size[1] - 1) / 2
    matrix = np.zeros((2, 3))
    for k in (0, 1):
        matrix[k, k] = shadow.size
        matrix[k, 2] = (
            shadow.size * (silhouette.corner[k] - middle[k])
            + middle[k]
            + shadow.shift[k] / scale
        )
    return np.asarray(
        cv2.warpAffine(silhouette.coverage, matrix, size, flags=cv2.INTER_LINEAR),
        np.float32,
    )


def wall_coverage(
    silhouettes: Sequence[Silhouette],
    shadow: WallShadow,
    scale: float,
    size: tuple[int, int],
) -> F32:
    """Return the coverage (h, w) of the wall by all shadows, with sharp edges."""
    total = np.zeros(size[::-1], np.float32)
    for silhouette in silhouettes:
        np.maximum(total, cast_on_wall(silhouette, shadow, scale, size), out=total)
    return total


def refine_wall_shadow(gradients: LightGradients, shadow: WallShadow) -> WallShadow:
    """Return a wall shadow after smaller steps on a finer picture, with soft edges."""
    first_blur = gradients.slopes[0][0] * gradients.scale
    best = _rate_wall_shadow(gradients, replace(shadow, blur=first_blur))
    for step in (4.0, 2.0, 1.0):
        shifts = _shift_steps(best, step)
        blurs = _blur_steps(best)
        tries = [*shifts, *_size_steps(best, 0.01 * step), *blurs]
        for _ in range(2):
            fits = [_rate_wall_shadow(gradients, candidate) for candidate in tries]
            best = max([best, *fits], key=lambda fit: fit.likeness)
            tries = [*_shift_steps(best, step), *_blur_steps(best)]
    return best


def _rate_wall_shadow(gradients: LightGradients, shadow: WallShadow) -> WallShadow:
    """Return a wall shadow with its likeness and factor."""
    model = wall_coverage(
        gradients.silhouettes, shadow, gradients.scale, gradients.size
    )
    blur = shadow.blur / gradients.scale
    if blur >= 0.3:
        model = np.asarray(cv2.GaussianBlur(model, (0, 0), blur), np.float32)
    likeness, factor = gradients.agreement(model)
    return replace(shadow, likeness=likeness, factor=factor)


def _shift_steps(shadow: WallShadow, step: float) -> list[WallShadow]:
    dx, dy = shadow.shift
    result: list[WallShadow] = []
    for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        result.append(replace(shadow, shift=(dx + a * step, dy + b * step)))
    return result


def _size_steps(shadow: WallShadow, step: float) -> list[WallShadow]:
    return [replace(shadow, size=shadow.size + sign * step) for sign in (1, -1)]


def _blur_steps(shadow: WallShadow) -> list[WallShadow]:
    return [
        replace(shadow, blur=shadow.blur * 1.5),
        replace(shadow, blur=shadow.blur / 1.5),
    ]


@dataclass(frozen=True)
class _ShiftSearch:
    """Correlations of a photo's gradients over all shifts: products of spectra."""

    shape: tuple[int, int]
    # Spectra of the gradients in x and y.
    right: Spectrum
    down: Spectrum
    # Spectra of the squared gradients and of the weights.
    energy: Spectrum
    weights: Spectrum
    # (h, w): shifts of a shadow that lies beside or below its object.
    allowed_shifts: Mask

    def correlate(self, spectrum: Spectrum, model: F32) -> NDArray[np.float64]:
        """Return the correlation (h, w) of a spectrum with a picture over all
        shifts.
        """
        model_spectrum = np.conj(np.fft.rfft2(model, self.shape))
        return np.asarray(np.fft.irfft2(spectrum * model_spectrum, self.shape))

    def best_shift(
        self, outline: F32, blur: float
    ) -> tuple[tuple[float, float], float, float]:
        """Return the best shift of shadows of an `outline` (h, w), its likeness and
        factor.

        The shift is down and right, px; `blur` is the width of the photo's gradients.
        """
        dy, dx = np.gradient(cv2.GaussianBlur(outline, (0, 0), blur))
        energy = dx * dx + dy * dy
        edges = (energy > 0.02 * energy.max()).astype(np.float32)
        band = np.asarray(cv2.dilate(edges, np.ones((5, 5), np.uint8)), np.float32)
        products = -(self.correlate(self.right, dx) + self.correlate(self.down, dy))
        model_energy = np.maximum(self.correlate(self.weights, energy), 1e-9)
        photo_energy = np.maximum(self.correlate(self.energy, band), 1e-9)
        visible = self.allowed_shifts & (model_energy > TUNING.in_sight * energy.sum())
        likeness = np.where(
            visible, products / np.sqrt(model_energy * photo_energy), -1.0
        )
        row, column = (
            int(k) for k in np.unravel_index(int(likeness.argmax()), likeness.shape)
        )
        shift = _signed_shift(row, self.shape[0]), _signed_shift(column, self.shape[1])
        factor = float(products[row, column] / model_energy[row, column])
        return shift, float(likeness[row, column]), factor


def find_wall_shadow(gradients: LightGradients) -> WallShadow | None:
    """Return the shift of the objects onto their shadows, or None if too few are
    visible.
    """
    search = _shift_search(gradients)
    if search is None:
        return None
    blur = gradients.slopes[-1][0]
    best: WallShadow | None = None
    for size in TUNING.wall_sizes:
        outline = wall_coverage(
            gradients.silhouettes, WallShadow((0.0, 0.0), size), 1.0, gradients.size
        )
        (down, right), likeness, factor = search.best_shift(outline, blur)
        if likeness > (best.likeness if best else 0.0):
            shift = right * gradients.scale, down * gradients.scale
            best = WallShadow(shift, size, likeness, factor)
    return best


def _shift_search(gradients: LightGradients) -> _ShiftSearch | None:
    """Return the search of shadows in the widest gradients; None without free pixels.

    Gradients steeper than a percentile are edges of objects and are clipped to it.
    """
    _, known_share, right, down = gradients.slopes[-1]
    inner_weights = cv2.erode(gradients.known_weights, np.ones((3, 3), np.uint8)) * (
        known_share > 0.3
    )
    steepness = np.hypot(right, down)
    free = steepness[inner_weights > 0]
    if not free.size:
        return None
    cut = np.minimum(
        1, np.percentile(free, TUNING.steepest) / np.maximum(steepness, 1e-6)
    )
    right = inner_weights * right * cut
    down = inner_weights * down * cut
    shape = (
        cv2.getOptimalDFTSize(2 * gradients.size[1]),
        cv2.getOptimalDFTSize(2 * gradients.size[0]),
    )
    reach = TUNING.farthest * typical_size(gradients.silhouettes)
    return _ShiftSearch(
        shape,
        right=np.fft.rfft2(right, shape),
        down=np.fft.rfft2(down, shape),
        energy=np.fft.rfft2(right * right + down * down, shape),
        weights=np.fft.rfft2(inner_weights, shape),
        allowed_shifts=_allowed_shifts(shape, reach),
    )


def _allowed_shifts(shape: tuple[int, int], reach: float) -> Mask:
    """Return shifts (h, w) of a shadow beside or below its object, up to `reach` px."""
    rows, columns = (np.fft.fftfreq(n, 1 / n)[:, None] for n in shape)
    is_beside = np.abs(columns.T) < reach
    return np.asarray(is_beside & (rows > -0.12 * reach) & (rows < reach))


def _signed_shift(index: int, count: int) -> float:
    """Return the shift of an index in a periodic correlation; the upper half is
    negative.
    """
    return float(np.fft.fftfreq(count, 1 / count)[index])
