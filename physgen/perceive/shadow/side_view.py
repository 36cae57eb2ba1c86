"""Shadows of a photo taken from the side: removal, owners and light."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import atan, degrees, hypot, inf, radians, tan

import cv2
import numpy as np

from physgen.geometry.polygon import bounds
from physgen.geometry.shadows import ShadowSetting, Silhouette, shadow_darkness
from physgen.maps import F32
from physgen.perceive.roles import (
    BoundaryGuess,
    Labels,
    LightGuess,
    Matter,
    PhotoObject,
    Rgb,
    Shadows,
)
from physgen.perceive.shadow.ambient_shade import find_ambient_shade
from physgen.perceive.shadow.foot_shade import find_foot_shade
from physgen.perceive.shadow.hard_shadows import lighten_hard_shadows
from physgen.perceive.shadow.reduced import ReducedPhoto, reduce_photo, restore_size
from physgen.perceive.shadow.shadow_fit import (
    COARSE,
    FINE,
    FULL,
    TILT,
    TRUSTED,
    LightFit,
    LightGradients,
    WallShadow,
    cast_on_wall,
    find_wall_shadow,
    light_gradients,
    refine_light,
    refine_wall_shadow,
    search_light,
    wall_coverage,
    with_direction,
)
from physgen.perceive.shadow.shadow_owners import (
    PREDICTED,
    shadow_owners,
    shadow_owners_by_model,
)
from physgen.perceive.shadow.shadow_removal import FAINT, edge_ratio, remove_shadows
from physgen.perceive.shadow.silhouettes import (
    Casts,
    join_silhouettes,
    lowest_floor,
    object_silhouettes,
    predicted_darkness,
    typical_size,
)
from physgen.perceive.shadow.smooth_shade import find_smooth_shade
from physgen.photometry import DistantLight


@dataclass(frozen=True)
class _Limits:
    """Limits of accepted and removed shadows; depths are -log of light."""

    # Least correlation of gradients for shadows on a floor ...
    least_likeness: float = 0.5
    # ... and least sum of that correlation and `depth_weight` times the depth, up to a depth of
    # one.
    least_score: float = 0.75
    depth_weight: float = 0.3
    # Largest share of the gradients of light after removal, because a shadow's edges
    # disappear with it.
    removal_share: float = 0.92
    # Up to this share there are shadows, although they lie too far off to be removed.
    visible_share: float = 1.0
    # Share above which shade without a light is tried as well ...
    doubtful: float = 0.7
    # ... and the largest ratio of its share to that of the light, by eye on a toy car
    # over its mirror image.
    clearer: float = 0.8
    # Largest share of the gradients after removal of a shadow with a hard edge.
    hard_share: float = 0.5
    # Depth of the faintest shadows.
    faintest: float = 0.15
    # Depth of the darkest shadows.
    darkest: float = 2.5
    # Largest distance of an object's foot from its floor over the object's height.
    foot: float = 0.1
    # Share of direct light if only shade is known.
    direct: float = 0.05
    # degrees: angular radius of that light.
    light_radius: float = 40.0
    # Confidence of that light.
    unknown: float = 0.3
    # px: longer side of the picture for the search of shadows on a wall.
    wall_side: int = 240


LIMITS = _Limits()


@dataclass(frozen=True)
class _Photo:
    """The reduced background and its objects, with cached silhouettes and gradients.

    Lengths are px of the reduced background; labels, objects and boundaries are in px
    of the photo.
    """

    reduced_photo: ReducedPhoto
    labels: Labels
    objects: Sequence[PhotoObject]
    matter: Mapping[int, Matter]
    boundaries: BoundaryGuess
    gradient_cache: dict[tuple[int, float | None], LightGradients | None] = field(
        default_factory=dict
    )

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height of the reduced background, px."""
        return self.reduced_photo.size

    @property
    def background(self) -> Rgb:
        """Return the background (h, w, 3)."""
        return self.reduced_photo.background

    @property
    def coverage(self) -> F32:
        """Return the coverage (h, w)."""
        return self.reduced_photo.coverage

    def silhouettes(self, scale: float, floor: float | None = None) -> list[Silhouette]:
        """Return silhouettes at 1 / `scale` of the size; `floor` is a row of the
        photo.
        """
        silhouettes_at = partial(
            object_silhouettes,
            self.labels,
            self.objects,
            self.matter,
            self.boundaries,
            floor=floor,
        )
        return silhouettes_at(scale * self.reduced_photo.scale)

    def gradients(
        self, longest: int, floor: float | None = None
    ) -> LightGradients | None:
        """Return the gradients of a picture with a longer side of `longest` px,
        cached.
        """
        if (longest, floor) not in self.gradient_cache:
            silhouettes_at = partial(self.silhouettes, floor=floor)
            result = light_gradients(
                self.background, self.coverage, longest, silhouettes_at
            )
            self.gradient_cache[longest, floor] = result
        return self.gradient_cache[longest, floor]


def side_view_shadows(
    background: Rgb,
    coverage: F32,
    labels: Labels,
    objects: Sequence[PhotoObject],
    matter: Mapping[int, Matter],
    boundaries: BoundaryGuess,
    guess: LightGuess,
) -> Shadows:
    """Return the result of the role `shadow` for a photo from the side."""
    reduced_photo = reduce_photo(background, coverage)
    photo = _Photo(reduced_photo, labels, objects, matter, boundaries)
    shade = None
    if not _is_ground_known(photo):
        shade = find_smooth_shade(background, coverage, labels, objects)
    if shade is not None:
        return _soft_light(*shade, guess, boundaries.tilt)
    shadows = restore_size(
        _reduced_shadows(photo, guess), reduced_photo, background, coverage
    )
    ratio = 1.0
    if shadows.clean_background is not None:
        ratio = edge_ratio(background, shadows.clean_background, coverage)
    if ratio > LIMITS.doubtful:
        shade = shade_without_light(background, coverage, labels, objects)
    # A doubtful light remains if shade without a light does not explain far more edges.
    if shade is not None and shadows.clean_background is not None:
        shade_ratio = edge_ratio(background, shade[0], coverage)
        shade = shade if shade_ratio < LIMITS.clearer * ratio else None
    if shade is not None:
        return _soft_light(*shade, guess, boundaries.tilt)
    return shadows


def shade_without_light(
    background: Rgb, coverage: F32, labels: Labels, objects: Sequence[PhotoObject]
) -> tuple[Rgb, Labels] | None:
    """Return the background without shade that no fitted light explains, and the ids
    (H, W) of its objects; None without shade.

    An even ground around an object shows its whole shade, also above the foot; other
    objects lose the shade at their feet.
    """
    smooth_shade = find_smooth_shade(background, coverage, labels, objects)
    if smooth_shade is None:
        return find_foot_shade(background, coverage, labels, objects)
    clean, owners = smooth_shade
    other_objects = [item for item in objects if not (owners == item.id).any()]
    foot_shade = find_foot_shade(background, coverage, labels, other_objects)
    if foot_shade is None:
        return smooth_shade
    # Both are measured on the same background; the whole shade has priority.
    foot_clean, foot_owners = foot_shade
    is_smooth = (clean != background).any(axis=2)
    clean = np.where(is_smooth[..., None], clean, foot_clean)
    return clean, np.where(owners > 0, owners, foot_owners)


def _reduced_shadows(photo: _Photo, guess: LightGuess) -> Shadows:
    """Return the shadows of the reduced photo."""
    background = photo.background
    coverage = photo.coverage
    result = Shadows(None, None, guess.light, 4.0, 4.0, None, 0.0)
    gradients = photo.gradients(COARSE)
    if gradients is None:
        return result
    wall = _wall_shadow(photo)
    floor_light, floor = _floor_fit(photo, gradients, guess)
    silhouettes = photo.silhouettes(1.0, floor)
    # Shadows on floor and wall are tried first, then those on the wall alone.
    for fit in (floor_light, None) if floor_light else (None,):
        if fit is None and wall is None:
            break
        darkness = _predict_shadow_darkness(silhouettes, fit, wall, photo.size)
        # Removal must also remove edges; new edges mean that the light is wrong.
        clean_background, ratio = _remove_floor_shadows(
            background, coverage, darkness, typical_size(silhouettes)
        )
        if ratio <= LIMITS.visible_share and (
            ratio <= LIMITS.removal_share or result.owners is None
        ):
            casts = _casts(silhouettes, fit, wall, photo.size)
            owners = shadow_owners(background, clean_background, coverage, casts)
            result = replace(result, owners=owners)
        if ratio <= LIMITS.removal_share:
            return _describe_light(
                photo, _light(fit, wall, guess, photo.size), clean_background, result
            )
    return _soft_shade(photo, guess) or result


def _remove_floor_shadows(
    background: Rgb, coverage: F32, darkness: F32, size: float
) -> tuple[Rgb, float]:
    """Return the background without shadows, and its `edge_ratio`.

    `darkness` (h, w): predicted, -log of light; `size`: typical size of an object, px.
    """
    clean_background = remove_shadows(background, coverage, darkness, size)
    ratio = edge_ratio(background, clean_background, coverage)
    # The outline of a hard shadow is visible: it need not be predicted exactly.
    lit_background = lighten_hard_shadows(background, coverage, darkness, size)
    if lit_background is None:
        return clean_background, ratio
    hard_ratio = edge_ratio(background, lit_background, coverage)
    if hard_ratio < min(LIMITS.clearer * ratio, LIMITS.hard_share):
        return lit_background, hard_ratio
    return clean_background, ratio


def _describe_light(
    photo: _Photo,
    light: tuple[ShadowSetting, float],
    clean_background: Rgb,
    shadows: Shadows,
) -> Shadows:
    """Return `shadows` with a light, its confidence and the clean background."""
    setting, confidence = light
    setting = _with_known_tilt(setting, photo.boundaries.tilt)
    return Shadows(
        clean_background,
        shadows.owners,
        setting.light,
        round(setting.softness, 1),
        round(degrees(atan(setting.tilt)), 1),
        None if setting.backdrop == inf else round(setting.backdrop, 1),
        round(min(0.9, confidence), 2),
    )


def _is_ground_known(photo: _Photo) -> bool:
    """Return whether an object stands on a floor, seen from a small height."""
    if photo.boundaries.tilt is not None:
        return False
    gradients = photo.gradients(COARSE)
    for silhouette in [] if gradients is None else gradients.silhouettes:
        height = silhouette.coverage.shape[0]
        foot = silhouette.corner[1] + height
        if (
            silhouette.floor is not None
            and silhouette.floor - foot < LIMITS.foot * height
        ):
            return True
    return False


def _soft_light(
    clean: Rgb, owners: Labels, guess: LightGuess, tilt: float | None
) -> Shadows:
    """Return shade on a ground of unknown geometry, with a soft light.

    Geometry then predicts little, and each object keeps the shade that the photo shows
    with it.
    """
    direct = LIMITS.direct
    light = DistantLight(guess.light.direction, FULL * direct, FULL * (1 - direct))
    if tilt is None:
        tilt = round(degrees(atan(TILT)), 1)
    return Shadows(
        clean, owners, light, LIMITS.light_radius, tilt, None, LIMITS.unknown
    )


def _with_known_tilt(setting: ShadowSetting, angle: float | None) -> ShadowSetting:
    """Return the setting with the floor's true tilt and shadows at the same pixels.

    A shadow's length up the picture is the rise of the floor times the light's slant in
    depth; one fit cannot separate the two.
    """
    if angle is None:
        return setting
    rise = tan(radians(angle))
    x, y, z = setting.light.direction
    direction = np.array([x, y, z * setting.tilt / rise])
    direction /= np.linalg.norm(direction)
    return replace(with_direction(setting, direction.tolist()), tilt=rise)


def _soft_shade(photo: _Photo, guess: LightGuess) -> Shadows | None:
    """Return the shade of soft light on a floor under the lowest object, or None."""
    bottom = max(bounds(item.outline)[3] for item in photo.objects)
    if bottom >= len(photo.labels) - 1:
        return None
    silhouettes_at = partial(photo.silhouettes, floor=bottom)
    shade = find_ambient_shade(
        photo.background, photo.coverage, silhouettes_at, is_top_view=False
    )
    if shade is None:
        return None
    silhouettes = photo.silhouettes(1.0, bottom)
    fit = LightFit(shade.setting, 0.0, shade.factor, shade.factor)
    model_darkness = _predict_shadow_darkness(silhouettes, fit, None, photo.size)
    # A surface that is not darker at the predicted place lies in no shade, and no ground
    # becomes brighter than similar ground without shade.
    agreement = np.where(photo.coverage > 0, 1, np.clip(shade.depth / FAINT, 0, 1))
    prediction = np.minimum(
        model_darkness * agreement,
        np.maximum(np.where(photo.coverage > 0, model_darkness, shade.depth), 0),
    )
    clean_background = remove_shadows(
        photo.background,
        photo.coverage,
        prediction.astype(np.float32),
        typical_size(silhouettes),
        is_soft=True,
    )
    if (
        edge_ratio(photo.background, clean_background, photo.coverage)
        > LIMITS.visible_share
    ):
        return None
    owner_depth = np.where(model_darkness > PREDICTED, shade.depth, 0).astype(
        np.float32
    )
    owners = shadow_owners_by_model(
        photo.coverage, _casts(silhouettes, fit, None, photo.size), owner_depth
    )
    tilt = photo.boundaries.tilt
    # Shade all around an object does not depend on the tilt.
    if tilt is None:
        tilt = round(degrees(atan(shade.setting.tilt)), 1)
    softness = shade.setting.softness
    confidence = shade.confidence
    return Shadows(
        clean_background, owners, guess.light, softness, tilt, None, confidence
    )


def _predict_shadow_darkness(
    silhouettes: Sequence[Silhouette],
    fit: LightFit | None,
    wall: WallShadow | None,
    size: tuple[int, int],
) -> F32:
    """Return -log (H, W) of the light that the objects leave on floor and wall."""
    darkness = np.zeros(size[::-1], np.float32)
    if fit is not None:
        darkness += np.float32(fit.factor) * predicted_darkness(
            join_silhouettes(silhouettes), fit.setting
        )
    if wall is not None:
        darkness += np.float32(wall.factor) * _blur_wall_shadow(
            wall_coverage(silhouettes, wall, 1.0, size), wall
        )
    return np.minimum(darkness, LIMITS.darkest)


def _blur_wall_shadow(coverage: F32, wall: WallShadow) -> F32:
    return np.asarray(
        cv2.GaussianBlur(coverage, (0, 0), max(wall.blur, 0.5)), np.float32
    )


def _casts(
    silhouettes: Sequence[Silhouette],
    fit: LightFit | None,
    wall: WallShadow | None,
    size: tuple[int, int],
) -> Casts:
    """Yield the shadows of each object on floor and wall."""
    if fit is not None:
        for silhouette in silhouettes:
            if (cast := shadow_darkness(silhouette, fit.setting)) is not None:
                yield silhouette.id, cast[0], np.float32(fit.factor) * cast[1]
    if wall is not None:
        for silhouette in silhouettes:
            soft_shadow = _blur_wall_shadow(
                cast_on_wall(silhouette, wall, 1.0, size), wall
            )
            yield (
                silhouette.id,
                (0, 0, *size),
                np.asarray(np.float32(wall.factor) * soft_shadow, np.float32),
            )


def _floor_fit(
    photo: _Photo, given: LightGradients, guess: LightGuess
) -> tuple[LightFit | None, float | None]:
    """Return a light with shadows on the floor, in px of the photo, and the assumed
    floor row.

    Both may be None.
    """
    coarse_gradients: list[LightGradients] = [given]
    floors: list[float | None] = [None]
    lowest = lowest_floor(photo.boundaries)
    if lowest is not None:
        row = lowest / (given.scale * photo.reduced_photo.scale)
        has_other_floor = any(
            s.floor is None or abs(s.floor - row) > 2 for s in given.silhouettes
        )
        other = photo.gradients(COARSE, lowest) if has_other_floor else None
        if other is not None:
            coarse_gradients.append(other)
            floors.append(lowest)
    k, coarse_fit = search_light(coarse_gradients, guess)
    fine_gradients = photo.gradients(FINE, floors[k])
    assert fine_gradients is not None
    fit = refine_light(
        fine_gradients, replace(coarse_fit.setting, size=fine_gradients.size), guess
    )
    if not _is_convincing(fine_gradients, fit):
        return None, floors[k]
    single_factor = fit.factor
    if len(fine_gradients.groups) < len(fine_gradients.silhouettes):
        _, single_factor = fine_gradients.agreement(
            predicted_darkness(fine_gradients.silhouettes, fit.setting)
        )
    return replace(
        fit, setting=replace(fit.setting, size=photo.size), single_factor=single_factor
    ), floors[k]


def _is_convincing(gradients: LightGradients, fit: LightFit) -> bool:
    """Return whether the fit is good and dark enough for real shadows."""
    model = predicted_darkness(gradients.groups, fit.setting) * gradients.known_weights
    depths = model[model > 0.02]
    if depths.size:
        depth = fit.factor * float(np.percentile(depths, 95))
    else:
        depth = 0.0
    confident = (
        fit.likeness + LIMITS.depth_weight * min(depth, 1.0) > LIMITS.least_score
    )
    return (
        depth > LIMITS.faintest and fit.likeness > LIMITS.least_likeness and confident
    )


def _wall_shadow(photo: _Photo) -> WallShadow | None:
    """Return the shadows on a wall behind, or None if none are visible."""
    coarse_gradients = photo.gradients(LIMITS.wall_side)
    wall = None if coarse_gradients is None else find_wall_shadow(coarse_gradients)
    if (
        coarse_gradients is None
        or wall is None
        or not wall.convincing(len(coarse_gradients.silhouettes))
    ):
        return None
    fine_gradients = photo.gradients(FINE)
    wall = wall if fine_gradients is None else refine_wall_shadow(fine_gradients, wall)
    if wall.factor > LIMITS.faintest:
        return wall
    return None


def _light(
    fit: LightFit | None,
    wall: WallShadow | None,
    guess: LightGuess,
    size: tuple[int, int],
) -> tuple[ShadowSetting, float]:
    """Return the light with its surfaces, and its confidence."""
    if fit is None:
        assert wall is not None
        return _light_of_wall(wall, guess, size), wall.likeness
    facing = (0.0, -1.0, 0.0)
    share = 1 - (1 - min(fit.setting.direct(facing), 0.98)) ** fit.single_factor
    setting = _with_share(fit.setting, facing, share)
    if wall is None:
        return setting, fit.likeness
    x, y, z = setting.light.direction
    back = _distance_back(
        wall, np.array([-x / max(z, 0.2), -y / max(z, 0.2) - setting.tilt])
    )
    confidence = max(fit.likeness, wall.likeness)
    return (replace(setting, backdrop=back) if back > 1 else setting), confidence


def _distance_back(wall: WallShadow, flat: np.ndarray) -> float:
    """Return the distance to the wall, px, if shadows move by `flat` (2,) per px
    back.
    """
    return float(flat @ np.array(wall.shift) / max(float(flat @ flat), 1e-3))


def _light_of_wall(
    wall: WallShadow, guess: LightGuess, size: tuple[int, int]
) -> ShadowSetting:
    """Return the light of shadows that lie only on a wall."""
    dx, dy = wall.shift
    x, y, z = guess.light.direction
    back = _distance_back(wall, np.array([-x, -y - TILT * z]) / max(z, 0.2))
    if guess.confidence < TRUSTED or back < 0.3 * hypot(dx, dy):
        back = 0.8 * hypot(dx, dy)
    direction = np.array([-dx / back, -(dy / back + TILT), 1.0])
    a, b, c = (direction / np.linalg.norm(direction)).tolist()
    softness = _softness_on_wall(wall, back, (a, b, c))
    setting = ShadowSetting(
        DistantLight((a, b, c), 1.0, 0.2), softness, False, TILT, back, size
    )
    return _with_share(setting, (0.0, 0.0, 1.0), 1 - float(np.exp(-wall.factor)))


def _softness_on_wall(
    wall: WallShadow, back: float, direction: tuple[float, float, float]
) -> float:
    """Return the angular radius of the light, degrees, from its blur on a wall `back`
    px behind.
    """
    a, b, c = direction
    # The path of the light to the wall, longer for a slanting light.
    depth = max(c, 0.2)
    lengthening = float(np.hypot(1, 0.5 * hypot(a, b) / depth))
    distance = back / depth * lengthening
    # Edges of a sharp picture have a blur of about a third of a pixel.
    light_blur = 2 * max(wall.blur - 0.35, 0.0)
    angle = degrees(atan(light_blur / distance))
    return min(max(angle, 0.3), 45.0)


def _with_share(
    setting: ShadowSetting, facing: tuple[float, float, float], share: float
) -> ShadowSetting:
    """Return the setting with a share of direct light on a surface with normal
    `facing`.
    """
    share = min(max(share, 0.02), 0.97)
    old_share = min(max(setting.direct(facing), 1e-3), 0.999)
    light = setting.light
    ratio = (
        light.intensity
        / max(light.ambient, 1e-3)
        * (share / (1 - share))
        / (old_share / (1 - old_share))
    )
    ambient = FULL / (1 + min(ratio, 100.0))
    return replace(
        setting, light=DistantLight(light.direction, FULL - ambient, ambient)
    )
