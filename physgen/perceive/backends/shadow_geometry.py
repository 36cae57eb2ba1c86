"""Backend shadow=geometry: remove shadows and estimate the light.

The search finds the light whose shadows, by the simple geometry of
`physgen.geometry.shadows`, coincide with dark regions of the photo. A pixel is dark
relative to surroundings of similar colour. Shadows are then removed to the degree that
the photo is dark there. This method is for tables seen from above;
`physgen.perceive.shadow.side_view` treats photos from the side.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import cos, inf, pi, sin

import cv2
import numpy as np

from physgen.geometry.shadows import (
    PixelBox,
    ShadowSetting,
    Silhouette,
    blurred,
    shadow_darkness,
)
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
from physgen.perceive.shadow.shadow_owners import shadow_owners, shadow_owners_by_model
from physgen.perceive.shadow.shadow_removal import lighten
from physgen.perceive.shadow.side_view import side_view_shadows
from physgen.perceive.shadow.silhouettes import (
    DARKEST,
    away_from_objects,
    object_silhouettes,
    predicted_darkness,
    typical_size,
)
from physgen.perceive.shadow.surface_kinds import HUES, hue_weights, mean_of_kind
from physgen.photometry import DistantLight, decode, encode_u8, luminance
from physgen.scene.scene import View

COARSE = 176
"""px: longer side of the picture for the search of the light."""
FINER = 3
"""Factor of the finer picture for the softness of shadows."""
SURE = 0.5
"""Least correlation of predicted and measured darkness for real shadows."""
Cast = tuple[int, PixelBox, F32]
"""Id of an object, box of its shadow, and -log of the remaining light in the box."""


def geometry() -> Shadow:
    """Return the backend `geometry`."""
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
    silhouettes_at = partial(object_silhouettes, labels, objects, matter, boundaries)
    reduced_photo = reduce_photo(background, coverage)
    shadows = _find_reduced_shadows(
        reduced_photo, reduced_photo.at(silhouettes_at), light
    )
    return restore_size(shadows, reduced_photo, background, coverage)


def _find_reduced_shadows(
    reduced_photo: ReducedPhoto, silhouettes_at: SilhouettesAt, light: LightGuess
) -> Shadows:
    """Return the shadows of a reduced photo; `silhouettes_at` gives silhouettes at other scales."""
    background = reduced_photo.background
    coverage = reduced_photo.coverage
    no_shadows = Shadows(None, None, light.light, 4.0, 4.0, None, 0.0)
    scale = max(max(background.shape[:2]) / COARSE, 1.0)
    silhouettes = silhouettes_at(scale)
    if not silhouettes:
        return no_shadows
    # A coarse search over all directions comes first ...
    setting, score, factor = _search(
        _coarse_picture(background, coverage, silhouettes, scale), light
    )
    # Without a clear directional shadow, look for the soft shade of ambient light.
    if score < SURE or factor < 0.15:
        shade = find_ambient_shade(
            background, coverage, silhouettes_at, is_top_view=True
        )
        if shade is None:
            return no_shadows
        return _remove_ambient(
            background, coverage, shade, silhouettes_at(1.0), light.light
        )
    # ... then a finer picture determines direction and softness.
    setting = _refine_setting(reduced_photo, silhouettes_at, setting, light)
    clean_background, owners = _remove_directional(
        background, coverage, silhouettes_at(1.0), setting
    )
    confidence = round(min(0.9, score), 2)
    return Shadows(
        clean_background,
        owners,
        setting.light,
        round(setting.softness, 1),
        4.0,
        None,
        confidence,
    )


def _refine_setting(
    reduced_photo: ReducedPhoto,
    silhouettes_at: SilhouettesAt,
    setting: ShadowSetting,
    light: LightGuess,
) -> ShadowSetting:
    """Return a setting fitted to a finer picture, in px of the reduced photo."""
    background = reduced_photo.background
    coverage = reduced_photo.coverage
    scale = max(max(background.shape[:2]) / (FINER * COARSE), 1.0)
    picture = _coarse_picture(background, coverage, silhouettes_at(scale), scale)
    start = replace(setting, size=picture.darkness.shape[::-1])
    fitted_setting, _, factor = _climb(start, picture, light, 1 / FINER)
    # The matched share of direct light makes predicted and measured shadows equally
    # dark.
    return replace(_match_darkness(fitted_setting, factor), size=reduced_photo.size)


def _remove_directional(
    background: Rgb,
    coverage: F32,
    silhouettes: Sequence[Silhouette],
    setting: ShadowSetting,
) -> tuple[Rgb, Labels | None]:
    """Return the background without the shadows of a directional light, and their
    owners.
    """
    clean_background = lighten(
        background, *_seen_darkness(background, coverage, silhouettes, setting)
    )
    casts = _cast_shadows(silhouettes, setting)
    owners = shadow_owners(background, clean_background, coverage, casts)
    return clean_background, owners


def _cast_shadows(
    silhouettes: Sequence[Silhouette], setting: ShadowSetting, factor: float = 1.0
) -> list[Cast]:
    """Return the shadows of the silhouettes, with their darkness times `factor`."""
    casts: list[Cast] = []
    for silhouette in silhouettes:
        shadow = shadow_darkness(silhouette, setting)
        if shadow is not None:
            box, darkness = shadow
            if factor != 1:
                darkness = np.asarray(factor * darkness, np.float32)
            casts.append((silhouette.id, box, darkness))
    return casts


def _remove_ambient(
    background: Rgb,
    coverage: F32,
    shade: AmbientShade,
    silhouettes: Sequence[Silhouette],
    light: DistantLight,
) -> Shadows:
    """Return shadows of ambient light, removed by the model instead of the photo.

    The shade around rims is too faint and too close to the object to be measured pixel
    by pixel.
    """
    casts = _cast_shadows(silhouettes, shade.setting, shade.factor)
    darkness = np.zeros(coverage.shape, np.float32)
    for _, (x0, y0, x1, y1), values in casts:
        darkness[y0:y1, x0:x1] += values
    clean_background = encode_u8(
        decode(background)
        * np.exp(extend_behind_objects(darkness, coverage))[..., None]
    )
    owners = shadow_owners_by_model(coverage, casts, darkness)
    softness = shade.setting.softness
    return Shadows(
        clean_background,
        owners,
        light,
        softness,
        4.0,
        None,
        shade.confidence,
        is_faint_shadow=True,
    )


@dataclass(frozen=True)
class _Picture:
    """The photo at a coarse scale."""

    # (h, w): logarithm of the surrounding light minus that of the pixel.
    darkness: F32
    weight: F32  # (h, w)
    silhouettes: Sequence[Silhouette]
    # px: size of a typical object.
    size: float

    def score(self, setting: ShadowSetting) -> tuple[float, float]:
        """Return the correlation of predicted and measured darkness, and their
        ratio.
        """
        model = np.minimum(predicted_darkness(self.silhouettes, setting), 2.5)
        side = 2 * round(0.7 * self.size) + 1
        # Only pixels near a predicted shadow count.
        w = self.weight * cv2.dilate(
            (model > 0.04).astype(np.uint8), np.ones((side, side), np.uint8)
        )
        count = max(float(w.sum()), 1.0)
        # Subtract weighted means, as in Pearson's correlation.
        model = model - float((w * model).sum()) / count
        darkness = self.darkness - float((w * self.darkness).sum()) / count
        product = float((w * model * darkness).sum())
        square = float((w * model * model).sum())
        darkness_square = float((w * darkness * darkness).sum())
        return product / max((square * darkness_square) ** 0.5, 1e-9), product / max(
            square, 1e-9
        )


def _coarse_picture(
    background: Rgb, coverage: F32, silhouettes: Sequence[Silhouette], scale: float
) -> _Picture:
    """Return the darkness of a reduced photo relative to its surroundings."""
    h = max(1, round(background.shape[0] / scale))
    w = max(1, round(background.shape[1] / scale))
    light = np.log(luminance(decode(background)) + DARKEST)
    # Pixels at objects are unknown: average only the free ones.
    open_ = away_from_objects(coverage).astype(np.float32)
    known_share = np.asarray(
        cv2.resize(open_, (w, h), interpolation=cv2.INTER_AREA), np.float32
    )
    small = np.asarray(
        cv2.resize(light * open_, (w, h), interpolation=cv2.INTER_AREA), np.float32
    )
    small = np.where(
        known_share > 0.05, small / np.maximum(known_share, 0.05), 0
    ).astype(np.float32)
    size = typical_size(silhouettes)
    sigma = 1.2 * size
    # Normalised convolution gives the mean light around each pixel.
    sums = cv2.GaussianBlur(small * known_share, (0, 0), sigma)
    surroundings = np.asarray(
        sums / np.maximum(cv2.GaussianBlur(known_share, (0, 0), sigma), 1e-3),
        np.float32,
    )
    darkness = np.clip(surroundings - small, -0.3, 1.2)
    weight = known_share * (known_share > 0.5)
    return _Picture(
        np.asarray(darkness, np.float32),
        np.asarray(weight, np.float32),
        silhouettes,
        size,
    )


def _search(picture: _Picture, light: LightGuess) -> tuple[ShadowSetting, float, float]:
    """Return the best light, its correlation and its factor.

    Coordinate steps start from the two best of many directions.
    """
    h, w = picture.darkness.shape
    start = ShadowSetting(light.light, 4.0, True, 0.1, inf, (w, h))
    tries = []
    for candidate in _starts(start):
        if deviation_penalty(candidate.light, light) < inf:
            tries.append(candidate)
    best = sorted(tries, key=lambda one: -picture.score(one)[0])[:2]
    return max(
        (_climb(candidate, picture, light) for candidate in best),
        key=lambda found: found[1],
    )


def _climb(
    setting: ShadowSetting, picture: _Picture, light: LightGuess, step: float = 1.0
) -> tuple[ShadowSetting, float, float]:
    """Return the best setting near a start, as `_search` does.

    Changes of direction are `step` times the usual ones.
    """
    best = (setting, *picture.score(setting))
    for _ in range(2):
        for other in _steps(best[0], step):
            if deviation_penalty(other.light, light) < inf:
                score, factor = picture.score(other)
                if score > best[1]:
                    best = (other, score, factor)
    return best


def _starts(setting: ShadowSetting) -> Iterator[ShadowSetting]:
    """Yield start settings: the guessed light and 36 directions around the zenith."""
    yield setting
    for k in range(12):
        turn = 2 * pi * k / 12
        for height in (0.9, 0.75, 0.5):
            horizontal = (1 - height**2) ** 0.5
            yield with_direction(
                setting, (horizontal * cos(turn), horizontal * sin(turn), height)
            )


def _steps(setting: ShadowSetting, step: float) -> Iterator[ShadowSetting]:
    """Yield neighbours of a setting with one changed number.

    Directions change by `step` times 0.15.
    """
    x, y, z = setting.light.direction
    for dx, dy, dz in ((0.15, 0, 0), (0, 0.15, 0), (0, 0, 0.15)):
        for sign in (1, -1, 0.4, -0.4):
            new = np.array([x, y, z]) + step * sign * np.array([dx, dy, dz])
            if new[2] > 0.1:
                yield with_direction(setting, tuple(new / np.linalg.norm(new)))
    for softness in (0.5, 2.0, 4.0, 6.0, 8.0, 10.0, 14.0, 20.0, 28.0):
        yield replace(setting, softness=softness)
    for share in (0.15, 0.35, 0.6, 0.85):
        yield with_direct_share(setting, share)


def _match_darkness(setting: ShadowSetting, factor: float) -> ShadowSetting:
    """Return a setting whose shadows are as dark as the photo's.

    `factor` is the ratio of measured to predicted darkness; it changes the share of
    direct light.
    """
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
    """Return the measured darkness, the light without shadows, and the free pixels.

    Darkness (H, W) is -log of the missing light within reach of the predicted shadows;
    the light (H, W, 3) is that of similar surfaces in full light; free pixels (H, W)
    are 1 away from objects.
    """
    model = predicted_darkness(silhouettes, setting)
    size = typical_size(silhouettes)
    side = 2 * max(1, round(0.2 * size)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    dilated_model = cv2.dilate(model, disc)
    reach = blurred(np.asarray(dilated_model, np.float32), max(2.0, 0.15 * size))
    linear = decode(background)
    smooth_level = np.asarray(
        cv2.medianBlur(np.log(luminance(linear) + DARKEST), 5), np.float32
    )
    free = away_from_objects(coverage)
    full_light = _reference(linear, (reach <= 0.03) & free, size)
    # The estimated light has an error, so that shadows lie beside the predicted ones:
    # allow some darkness there.
    limit = 1.7 * cv2.dilate(dilated_model, disc) + 0.2
    darkness = np.clip(
        np.log(luminance(full_light) + DARKEST) - smooth_level, 0, limit
    ) * np.clip(reach / 0.08, 0, 1)
    return np.asarray(darkness, np.float32), full_light, free.astype(np.float32)


def _reference(linear: F32, visible_mask: Mask, size: float) -> F32:
    """Return the light (H, W, 3) of similar colours nearby, from `visible_mask` pixels."""
    if np.count_nonzero(visible_mask) < HUES:
        return np.asarray(cv2.medianBlur(linear, 5), np.float32)
    reaches = []
    for part, gain in ((0.4, 1.0), (1.0, 0.05), (3, 0.002)):
        reaches.append((part * size, part * size, gain))
    kinds = hue_weights(linear, visible_mask, 8000)

    def blur(picture: F32, sigma: float, down: float) -> F32:
        return blurred(picture, sigma)

    pixel_weights = visible_mask.astype(np.float32)
    logs = (cv2.medianBlur(np.log(part + DARKEST), 5) for part in cv2.split(linear))
    means = []
    for part in logs:
        means.append(
            mean_of_kind(
                part,
                pixel_weights,
                kinds,
                reaches,
                tiny=1e-9,
                prior=(1e-6, 1e-6),
                blur=blur,
            )
        )
    return np.asarray(np.exp(cv2.merge(means)) - DARKEST, np.float32)
