"""Fit of a distant light to the shadows that objects cast on a floor or a table.

Slopes of the logarithm of light are compared, at two widths, with those of the predicted darkness, near these alone:
a far edge of the floor or a picture on a wall has slopes too, but elsewhere. The light is searched from directions all
over the sky on a small picture, by the largest objects, and refined on a larger one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import acos, asin, atan2, cos, degrees, inf, pi, sin

import cv2
import numpy as np

from physgen.geometry.shadows import ShadowSetting, Silhouette
from physgen.perceive.roles import F32, LightGuess, Rgb
from physgen.perceive.shadow.silhouettes import (
    DARKEST,
    away_from_objects,
    join_silhouettes,
    predicted_darkness,
    typical_size,
)
from physgen.photometry import DistantLight, decode, luminance


@dataclass(frozen=True)
class _Tuning:
    """Tuning of the search, on studio photos of the split `tune`; sizes are shares of an object's."""

    coarse: int = 192  # px: longer side of the picture in which the light is searched ...
    fine: int = 384  # ... and of the one in which it is refined
    starts: int = 3  # directions from which the search goes on; the best
    coarse_steps: tuple[float, ...] = (0.3, 0.15, 0.15, 0.06)  # radians, and shares of other numbers
    fine_steps: tuple[float, ...] = (0.12, 0.06, 0.06, 0.03, 0.015)
    widths: tuple[float, ...] = (0.03, 0.08)  # over which slopes are smoothed
    least_seen: float = 0.1  # share of the predicted slopes that must be in sight
    telling: int = 3  # objects that the light is searched by; the largest
    walls: tuple[float, ...] = (
        0.5,
        0.8,
        1.2,
        1.8,
        2.7,
        4.0,
        6.0,
        9.0,
    )  # distances back to a wall that are tried
    tilt: float = 0.1  # rise over run of the floor where it is unknown
    full: float = 1.2  # shading of a surface that faces the light: there it shows its own colour
    trusted: float = 0.3  # confidence of a light from shading from which it counts
    well: float = 0.5  # and from which it counts most
    # degrees, standard deviation of such lights: trusted, trusted well
    deviation: tuple[float, float] = (20.0, 7.0)
    # degrees, and standard deviations: no light is tried farther from it
    beyond: tuple[float, float] = (40.0, 2.5)
    pull: float = 0.02  # correlation that one standard deviation from it must gain
    alike: float = 0.5  # correlation of slopes that shadows need ...
    sure: float = 0.75  # ... and with `deep` for each unit of depth (-log of light), up to one
    deep: float = 0.3
    faintest: float = 0.15  # depth of the faintest shadows


TUNING = _Tuning()


@dataclass(frozen=True)
class LightGradients:
    """A photo's light at one scale, and the silhouettes that may block some of it."""

    scale: float
    """px of the photo in one of this picture."""
    size: tuple[int, int]
    """Width and height, px."""
    known: F32
    """(h, w) 1 where no object is near."""
    slopes: Sequence[tuple[float, F32, F32, F32]]
    """Width of smoothing, px; (h, w) share known within it; (h, w) slopes of the logarithm of light, x and y."""
    silhouettes: Sequence[Silhouette]

    @property
    def telling(self) -> list[Silhouette]:
        """The largest silhouettes; the small ones would take as long and add little."""
        return sorted(self.silhouettes, key=lambda what: -what.area)[: TUNING.telling]

    def agreement(self, model: F32) -> tuple[float, float]:
        """Correlation of seen slopes and those of a darkness (h, w), and the factor; means over the widths.

        0 and 0 where hardly any of it is in sight.
        """
        rows, columns = np.flatnonzero(model.max(axis=1) > 0.02), np.flatnonzero(model.max(axis=0) > 0.02)
        if len(rows) < 2 or len(columns) < 2:
            return 0.0, 0.0
        pad = int(3 * self.slopes[-1][0]) + 4
        top, left = max(int(rows[0]) - pad, 0), max(int(columns[0]) - pad, 0)
        part = np.s_[top : int(rows[-1]) + pad + 1, left : int(columns[-1]) + pad + 1]
        model, known = np.minimum(model[part], 2.5), self.known[part]
        within = cv2.erode(known, np.ones((3, 3), np.uint8))
        alike, factors = [], []
        for width, near, right, down in self.slopes:
            soft = cv2.GaussianBlur(model * known, (0, 0), width) / np.maximum(near[part], 0.05)
            dy, dx = np.gradient(soft)
            energy = np.asarray(dx * dx + dy * dy, np.float32)
            edges = energy > 0.01 * float((energy * within).max())
            weight = within * cv2.dilate(edges.astype(np.uint8), np.ones((9, 9), np.uint8))
            own = float((weight * energy).sum())
            if own <= TUNING.least_seen * float(energy.sum()):
                return 0.0, 0.0
            both = -float((weight * (dx * right[part] + dy * down[part])).sum())
            seen = float((weight * (right[part] ** 2 + down[part] ** 2)).sum())
            alike.append(both / max((own * seen) ** 0.5, 1e-9))
            factors.append(both / max(own, 1e-9))
        return sum(alike) / len(alike), sum(factors) / len(factors)


def light_gradients(
    background: Rgb, coverage: F32, longest: int, at: Callable[[float], Sequence[Silhouette]]
) -> LightGradients | None:
    """The photo with a longer side of `longest` px; `at` gives the silhouettes at a scale. None where none are."""
    scale = max(max(background.shape[:2]) / longest, 1.0)
    silhouettes = at(scale)
    if not silhouettes:
        return None
    h, w = (max(1, round(n / scale)) for n in background.shape[:2])
    light = np.log(luminance(decode(background)) + DARKEST)
    open_ = away_from_objects(coverage).astype(np.float32)
    share = np.asarray(cv2.resize(open_, (w, h), interpolation=cv2.INTER_AREA), np.float32)
    small = np.asarray(cv2.resize(light * open_, (w, h), interpolation=cv2.INTER_AREA), np.float32)
    small = np.asarray(small / np.maximum(share, 0.05), np.float32)
    known = np.asarray(share * (share > 0.5), np.float32)
    slopes = []
    for part in TUNING.widths:
        width = max(part * typical_size(silhouettes), 1.0)
        near = np.asarray(cv2.GaussianBlur(known, (0, 0), width), np.float32)
        down, right = np.gradient(cv2.GaussianBlur(small * known, (0, 0), width) / np.maximum(near, 0.05))
        slopes.append((width, near, np.asarray(right, np.float32), np.asarray(down, np.float32)))
    return LightGradients(scale, (w, h), known, slopes, join_silhouettes(silhouettes))


@dataclass(frozen=True)
class LightFit:
    """A light and how well its shadows agree with the photo's."""

    setting: ShadowSetting
    likeness: float
    """Correlation of predicted and seen slopes."""
    factor: float
    """Seen over predicted darkness, as a logarithm."""
    floor: float | None = None
    """The row, px, of the floor under all objects; None: each stands over the boundary below it."""


def fit_light(
    background: Rgb,
    coverage: F32,
    at: Callable[..., Sequence[Silhouette]],
    floors: Sequence[float | None],
    guess: LightGuess,
    *,
    top: bool,
) -> LightFit | None:
    """The light whose shadows are seen, in px of the photo; None where none are.

    `at(scale, floor=row)` gives the silhouettes at a scale and over a floor, one of `floors`, that is tried.
    """
    tries: list[tuple[float | None, float, LightFit]] = []
    for row in floors:
        picture = light_gradients(background, coverage, TUNING.coarse, partial(at, floor=row))
        if picture is None:
            return None
        tries.append((row, picture.scale, _search(picture, guess, top=top, on_wall=row == inf)))
    floor, scale, fit = max(tries, key=lambda one: one[2].likeness)
    fine = light_gradients(background, coverage, TUNING.fine, partial(at, floor=floor))
    assert fine is not None
    start = _rescaled(fit.setting, scale / fine.scale, fine.size)
    fit = _climb(fine, _rated(fine, start, guess), TUNING.fine_steps, guess)
    model = predicted_darkness(fine.silhouettes, fit.setting)
    likeness, factor = fine.agreement(model)
    seen = (model * fine.known)[model * fine.known > 0.02]
    depth = factor * float(np.percentile(seen, 95)) if seen.size else 0.0
    sure = likeness + TUNING.deep * min(depth, 1.0) > TUNING.sure
    if depth < TUNING.faintest or likeness < TUNING.alike or not sure:
        return None
    setting = _rescaled(fit.setting, fine.scale, (coverage.shape[1], coverage.shape[0]))
    return LightFit(setting, likeness, factor, floor)


def _rescaled(setting: ShadowSetting, by: float, size: tuple[int, int]) -> ShadowSetting:
    """The same in px of a picture so many times as large."""
    return replace(setting, backdrop=setting.backdrop * by, size=size)


def _search(picture: LightGradients, guess: LightGuess, *, top: bool, on_wall: bool) -> LightFit:
    """The best light: coordinate steps from the best of several directions."""
    first = ShadowSetting(guess.light, 4.0, top, TUNING.tilt, inf, picture.size)
    size = typical_size(picture.silhouettes)
    tries = [
        replace(one, backdrop=back * size)
        for one in _starts(first)
        for back in (TUNING.walls if on_wall else (inf,))
        if back == inf or one.light.direction[2] > 0.3
    ]
    starts = sorted((_rated(picture, one, guess) for one in tries), key=lambda fit: -fit.likeness)
    climbed = (_climb(picture, fit, TUNING.coarse_steps, guess) for fit in starts[: TUNING.starts])
    return max(climbed, key=lambda fit: fit.likeness)


def _climb(picture: LightGradients, fit: LightFit, steps: Sequence[float], guess: LightGuess) -> LightFit:
    """One number changed at a time, by smaller and smaller steps."""
    for step in steps:
        for setting in list(_neighbours(fit.setting, step)):
            other = _rated(picture, setting, guess)
            if other.likeness > fit.likeness and other.factor > 0:
                fit = other
    return fit


def _rated(picture: LightGradients, setting: ShadowSetting, guess: LightGuess) -> LightFit:
    """A light by the largest objects; what is unusual must agree better."""
    penalty = _distance_penalty(setting.light, guess)
    if penalty == inf:
        return LightFit(setting, -inf, 0.0)
    likeness, factor = picture.agreement(predicted_darkness(picture.telling, setting))
    return LightFit(setting, likeness - penalty - _oddness(setting, factor), factor)


def _distance_penalty(light: DistantLight, guess: LightGuess) -> float:
    """Correlation that a light must gain for its distance from the one of shading; infinite where it is too far."""
    if guess.confidence < TUNING.trusted:
        return 0.0
    sure = min((guess.confidence - TUNING.trusted) / (TUNING.well - TUNING.trusted), 1.0)
    deviation = TUNING.deviation[0] + sure * (TUNING.deviation[1] - TUNING.deviation[0])
    cosine = sum(a * b for a, b in zip(light.direction, guess.light.direction, strict=True))
    angle = degrees(acos(min(max(cosine, -1.0), 1.0)))
    if angle > min(TUNING.beyond[0], TUNING.beyond[1] * deviation):
        return inf
    return TUNING.pull * (angle / deviation) ** 2


def _oddness(setting: ShadowSetting, factor: float) -> float:
    """Correlation that an unusual fit must gain: low or high light, a steep or a flat floor, other darkness."""
    strength = 0.03 * abs(np.log(max(factor, 0.05)))
    if setting.top:
        return float(strength)
    x, y, z = setting.light.direction
    length = (x * x + z * z) ** 0.5 / max(-y, 0.05)
    slant = 0.03 * max(length - 2, 0.0) + 0.03 * max(0.4 - length, 0.0)
    return float(slant + 0.02 * abs(np.log(setting.tilt / TUNING.tilt)) + strength)


def _starts(first: ShadowSetting) -> Iterator[ShadowSetting]:
    """The light of shading, one from straight over the surface, and others all around."""
    _, y, z = first.light.direction
    if (z if first.top else -y) > 0.1:
        yield first
    yield replace(
        _turned(first, 0.0, pi / 2), light=DistantLight(_direction(first.top, 0.0, pi / 2), 0.3, 0.9)
    )
    for k in range(12):
        for height in (0.5, 0.75, 0.9) if first.top else (0.4, 0.75):
            yield _turned(first, 2 * pi * k / 12, asin(height))


def _direction(top: bool, around: float, rise: float) -> tuple[float, float, float]:
    """The unit vector so many radians around the normal of the surface that shadows fall on, and above it."""
    across, along, up = cos(rise) * cos(around), cos(rise) * sin(around), sin(rise)
    return (across, along, up) if top else (across, -up, along)


def _turned(setting: ShadowSetting, around: float, rise: float) -> ShadowSetting:
    light = setting.light
    direction = _direction(setting.top, around, rise)
    return replace(setting, light=DistantLight(direction, light.intensity, light.ambient))


def _neighbours(setting: ShadowSetting, step: float) -> Iterator[ShadowSetting]:
    """Neighbours of a setting, one number changed."""
    x, y, z = setting.light.direction
    up, along = (z, y) if setting.top else (-y, z)
    around, rise = atan2(along, x), asin(min(max(up, -1.0), 1.0))
    for turn, lift in ((step, 0), (-step, 0), (0, step), (0, -step), (step, -step), (-step, -step)):
        if 0.1 < rise + lift < pi / 2:
            yield _turned(setting, around + turn / max(cos(rise), 0.3), rise + lift)
    for by in (1 + 4 * step, 1 / (1 + 4 * step)):
        yield replace(setting, softness=min(max(setting.softness * by, 0.5), 45.0))
    for by in (1 + 2 * step, 1 / (1 + 2 * step)) if not setting.top else ():
        yield replace(setting, tilt=min(max(setting.tilt * by, 0.02), 0.5))
        if setting.backdrop < inf:
            yield replace(setting, backdrop=setting.backdrop * by)
    now = setting.light.intensity / max(setting.light.intensity + setting.light.ambient, 1e-6)
    for share in (min(now + step, 0.98), max(now - step, 0.02)):
        light = DistantLight(setting.light.direction, share * TUNING.full, (1 - share) * TUNING.full)
        yield replace(setting, light=light)


def matched_light(fit: LightFit) -> DistantLight:
    """The light with so much of it direct that predicted shadows are as dark as the seen ones."""
    setting = fit.setting
    share = setting.direct((0.0, 0.0, 1.0) if setting.top else (0.0, -1.0, 0.0))
    now = min(max(share, 1e-3), 0.98)
    wanted = min(max(1 - (1 - now) ** fit.factor, 0.02), 0.97)
    light = setting.light
    ratio = light.intensity / max(light.ambient, 1e-3) * (wanted / (1 - wanted)) / (now / (1 - now))
    ambient = TUNING.full / (1 + min(ratio, 100.0))
    return DistantLight(light.direction, TUNING.full - ambient, ambient)
