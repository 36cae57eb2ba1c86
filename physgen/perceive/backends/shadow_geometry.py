"""Backend shadow=geometry: shadows removed and the light that casts them.

A light is searched whose shadows, by the simple geometry of `physgen.geometry.shadows`, lie where the photo is darker
than its surroundings of like colour; they are removed as far as the photo is dark there. So it is on a table seen from
above; photos from the side go another way, `physgen.perceive.shadow.side_view`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import cos, inf, pi, sin

import cv2
import numpy as np

from physgen.geometry.shadows import ShadowSetting, Silhouette, blurred, shadow_darkness
from physgen.maps import F32
from physgen.perceive.roles import (
    BoundaryGuess,
    Labels,
    LightGuess,
    Mask,
    Matter,
    PhotoObject,
    Rgb,
    Shadow,
    Shadows,
)
from physgen.perceive.shadow.ambient_shade import (
    AmbientShade,
    extend_behind_objects,
    find_ambient_shade,
)
from physgen.perceive.shadow.reduced import (
    ReducedPhoto,
    SilhouettesAt,
    reduce_photo,
    restore_size,
)
from physgen.perceive.shadow.shadow_fit import (
    FULL,
    deviation_penalty,
    with_direct_share,
    with_direction,
)
from physgen.perceive.shadow.shadow_removal import (
    HUES,
    hue_weights,
    lightened,
    mean_of_kind,
    shadow_owners,
    shadow_owners_by_model,
)
from physgen.perceive.shadow.side_view import side_view_shadows
from physgen.perceive.shadow.silhouettes import (
    DARKEST,
    away_from_objects,
    object_silhouettes,
    predicted_darkness,
    typical_size,
)
from physgen.photometry import DistantLight, decode, encode_u8, luminance
from physgen.scene.scene import View

COARSE = 176  # px: longer side of the picture in which the light is searched
FINER = 3  # times as many px show how soft shadows' edges are
SURE = 0.5  # correlation of predicted and seen darkness from which shadows are believed


def geometry() -> Shadow:
    """The backend `geometry`."""
    return _geometry


def _geometry(
    background: Rgb,
    coverage: F32,
    labels: Labels,
    objects: Sequence[PhotoObject],
    matter: Mapping[int, Matter],
    boundaries: BoundaryGuess,
    light: LightGuess,
) -> Shadows:
    if boundaries.view is View.SIDE:
        return side_view_shadows(
            background, coverage, labels, objects, matter, boundaries, light
        )
    at = partial(object_silhouettes, labels, objects, matter, boundaries)
    reduced = reduce_photo(background, coverage)
    shadows = _find_reduced_shadows(reduced, reduced.at(at), light)
    return restore_size(shadows, reduced, background, coverage)


def _find_reduced_shadows(
    reduced: ReducedPhoto, at: SilhouettesAt, light: LightGuess
) -> Shadows:
    """Shadows of a reduced photo; `at` gives the silhouettes on smaller ones."""
    background, coverage = reduced.background, reduced.coverage
    nothing = Shadows(None, None, light.light, 4.0, 4.0, None, 0.0)
    scale = max(max(background.shape[:2]) / COARSE, 1.0)
    silhouettes = at(scale)
    if not silhouettes:
        return nothing
    setting, score, factor = _search(
        _coarse_picture(background, coverage, silhouettes, scale), light
    )
    if score < SURE or factor < 0.15:
        shade = find_ambient_shade(background, coverage, at, from_above=True)
        if shade is None:
            return nothing
        return _remove_ambient(background, coverage, shade, at(1.0), light.light)
    scale = max(max(background.shape[:2]) / (FINER * COARSE), 1.0)
    picture = _coarse_picture(background, coverage, at(scale), scale)
    setting, _, factor = _climb(
        replace(setting, size=picture.dark.shape[::-1]), picture, light, 1 / FINER
    )
    setting = replace(_matched(setting, factor), size=reduced.size)
    silhouettes = at(1.0)
    clean = lightened(
        background, *_seen_darkness(background, coverage, silhouettes, setting)
    )
    casts = [
        (what.id, *found)
        for what in silhouettes
        if (found := shadow_darkness(what, setting)) is not None
    ]
    owners = shadow_owners(background, clean, coverage, casts)
    sure = round(min(0.9, score), 2)
    return Shadows(
        clean, owners, setting.light, round(setting.softness, 1), 4.0, None, sure
    )


def _remove_ambient(
    background: Rgb,
    coverage: F32,
    shade: AmbientShade,
    silhouettes: Sequence[Silhouette],
    light: DistantLight,
) -> Shadows:
    """The shade of soft light about rims is too faint, and too near, to be seen but on the whole."""
    found = [
        (what.id, *cast)
        for what in silhouettes
        if (cast := shadow_darkness(what, shade.setting)) is not None
    ]
    casts = [
        (i, box, np.asarray(shade.factor * dark, np.float32)) for i, box, dark in found
    ]
    dark = np.zeros(coverage.shape, np.float32)
    for _, (x0, y0, x1, y1), values in casts:
        dark[y0:y1, x0:x1] += values
    clean = encode_u8(
        decode(background) * np.exp(extend_behind_objects(dark, coverage))[..., None]
    )
    owners = shadow_owners_by_model(coverage, casts, dark)
    soft = shade.setting.softness
    return Shadows(clean, owners, light, soft, 4.0, None, shade.confidence, faint=True)


@dataclass(frozen=True)
class _Picture:
    """The photo at a coarse scale."""

    dark: F32  # (h, w): by how much the logarithm of light stays below that of the surroundings
    weight: F32  # (h, w)
    silhouettes: Sequence[Silhouette]
    size: float  # px of a typical object

    def score(self, setting: ShadowSetting) -> tuple[float, float]:
        """Correlation of predicted and seen darkness, and the factor from one to the other."""
        model = np.minimum(predicted_darkness(self.silhouettes, setting), 2.5)
        side = 2 * round(0.7 * self.size) + 1
        w = self.weight * cv2.dilate(
            (model > 0.04).astype(np.uint8), np.ones((side, side), np.uint8)
        )
        count = max(float(w.sum()), 1.0)
        model = model - float((w * model).sum()) / count
        dark = self.dark - float((w * self.dark).sum()) / count
        both, square = float((w * model * dark).sum()), float((w * model * model).sum())
        seen = float((w * dark * dark).sum())
        return both / max((square * seen) ** 0.5, 1e-9), both / max(square, 1e-9)


def _coarse_picture(
    background: Rgb, coverage: F32, silhouettes: Sequence[Silhouette], scale: float
) -> _Picture:
    h, w = (max(1, round(n / scale)) for n in background.shape[:2])
    light = np.log(luminance(decode(background)) + DARKEST)
    open_ = away_from_objects(coverage).astype(np.float32)
    known = np.asarray(
        cv2.resize(open_, (w, h), interpolation=cv2.INTER_AREA), np.float32
    )
    small = np.asarray(
        cv2.resize(light * open_, (w, h), interpolation=cv2.INTER_AREA), np.float32
    )
    small = np.where(known > 0.05, small / np.maximum(known, 0.05), 0).astype(
        np.float32
    )
    size = typical_size(silhouettes)
    sigma = 1.2 * size
    sums = cv2.GaussianBlur(small * known, (0, 0), sigma)
    around = np.asarray(
        sums / np.maximum(cv2.GaussianBlur(known, (0, 0), sigma), 1e-3), np.float32
    )
    dark = np.clip(around - small, -0.3, 1.2)
    weight = known * (known > 0.5)
    return _Picture(
        np.asarray(dark, np.float32), np.asarray(weight, np.float32), silhouettes, size
    )


def _search(picture: _Picture, light: LightGuess) -> tuple[ShadowSetting, float, float]:
    """The best light, its correlation and factor: coordinate steps from several directions."""
    h, w = picture.dark.shape
    start = ShadowSetting(light.light, 4.0, True, 0.1, inf, (w, h))
    tries = [one for one in _starts(start) if deviation_penalty(one.light, light) < inf]
    best = sorted(tries, key=lambda one: -picture.score(one)[0])[:2]
    return max(
        (_climb(one, picture, light) for one in best), key=lambda found: found[1]
    )


def _climb(
    setting: ShadowSetting, picture: _Picture, light: LightGuess, step: float = 1.0
) -> tuple[ShadowSetting, float, float]:
    """As `_search`, from one setting on; changes of direction are `step` times the usual ones."""
    now = (setting, *picture.score(setting))
    for _ in range(2):
        for other in _steps(now[0], step):
            if deviation_penalty(other.light, light) < inf:
                score, factor = picture.score(other)
                if score > now[1]:
                    now = (other, score, factor)
    return now


def _starts(setting: ShadowSetting) -> Iterator[ShadowSetting]:
    yield setting
    for k in range(12):
        turn = 2 * pi * k / 12
        for height in (0.9, 0.75, 0.5):
            flat = (1 - height**2) ** 0.5
            yield with_direction(setting, (flat * cos(turn), flat * sin(turn), height))


def _steps(setting: ShadowSetting, step: float) -> Iterator[ShadowSetting]:
    """Neighbours of a setting, one number changed; directions by `step` times 0.15."""
    x, y, z = setting.light.direction
    for dx, dy, dz in ((0.15, 0, 0), (0, 0.15, 0), (0, 0, 0.15)):
        for sign in (1, -1, 0.4, -0.4):
            new = np.array([x, y, z]) + step * sign * np.array([dx, dy, dz])
            if new[2] > 0.1:
                yield with_direction(setting, tuple(new / np.linalg.norm(new)))
    for soft in (0.5, 2.0, 4.0, 6.0, 8.0, 10.0, 14.0, 20.0, 28.0):
        yield replace(setting, softness=soft)
    for share in (0.15, 0.35, 0.6, 0.85):
        yield with_direct_share(setting, share)


def _matched(setting: ShadowSetting, factor: float) -> ShadowSetting:
    """The share of direct light made such that the predicted shadows are as dark as the seen ones."""
    x, y, z = setting.light.direction
    share = min(setting.direct((0.0, 0.0, 1.0)) * min(max(factor, 0.3), 1.6), 0.97)
    ambient = max(setting.light.ambient, 0.05)
    intensity = min(share / (1 - share) * ambient / max(z, 0.05), 100.0 * ambient)
    total = (intensity + ambient) / FULL
    return replace(
        setting, light=DistantLight((x, y, z), intensity / total, ambient / total)
    )


def _seen_darkness(
    background: Rgb,
    coverage: F32,
    silhouettes: Sequence[Silhouette],
    setting: ShadowSetting,
) -> tuple[F32, F32, F32]:
    """(H, W) -log of the light that the photo misses, within reach of what geometry predicts; (H, W, 3) the light of
    like surfaces in full light; (H, W) 1 where no object is near."""
    model = predicted_darkness(silhouettes, setting)
    size = typical_size(silhouettes)
    side = 2 * max(1, round(0.2 * size)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    wide = cv2.dilate(model, disc)
    reach = blurred(np.asarray(wide, np.float32), max(2.0, 0.15 * size))
    linear = decode(background)
    smooth = np.asarray(
        cv2.medianBlur(np.log(luminance(linear) + DARKEST), 5), np.float32
    )
    free = away_from_objects(coverage)
    lit = _reference(linear, (reach <= 0.03) & free, size)
    # the light found may be a little off, so that shadows lie beside those of the model
    most = 1.7 * cv2.dilate(wide, disc) + 0.2
    dark = np.clip(np.log(luminance(lit) + DARKEST) - smooth, 0, most) * np.clip(
        reach / 0.08, 0, 1
    )
    return np.asarray(dark, np.float32), lit, free.astype(np.float32)


def _reference(linear: F32, known: Mask, size: float) -> F32:
    """(H, W, 3): the light of like-coloured surfaces nearby, from where it is `known`."""
    if np.count_nonzero(known) < HUES:
        return np.asarray(cv2.medianBlur(linear, 5), np.float32)
    reaches = [
        (part * size, part * size, gain)
        for part, gain in ((0.4, 1.0), (1.0, 0.05), (3, 0.002))
    ]
    kinds = hue_weights(linear, known, 8000)

    def blur(picture: F32, across: float, down: float) -> F32:
        return blurred(picture, across)

    plain = known.astype(np.float32)
    logs = (cv2.medianBlur(np.log(part + DARKEST), 5) for part in cv2.split(linear))
    means = [
        mean_of_kind(
            part, plain, kinds, reaches, tiny=1e-9, prior=(1e-6, 1e-6), blur=blur
        )
        for part in logs
    ]
    return np.asarray(np.exp(cv2.merge(means)) - DARKEST, np.float32)
