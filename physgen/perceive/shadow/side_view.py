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
from physgen.perceive.shadow.shadow_removal import (
    FAINT,
    PREDICTED,
    edge_ratio,
    remove_shadows,
    shadow_owners,
    shadow_owners_by_model,
)
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
    """Which shadows are believed and removed; depths are -log of light."""

    alike: float = 0.5  # correlation of slopes that shadows on a floor need ...
    sure: float = 0.75  # ... and with `deep` for each unit of depth, up to one
    deep: float = 0.3
    # share of the slopes of light that removal may leave: a shadow's edges go with it
    calm: float = 0.92
    # up to this share there are shadows, though they lie too far astray to be removed
    seen: float = 1.0
    faintest: float = 0.15  # depth of the faintest shadows
    darkest: float = 2.5  # depth of the darkest
    foot: float = 0.1  # of an object's height, from its foot to the floor it stands on
    direct: float = 0.05  # share of direct light where only shade is known
    soft: float = 40.0  # degrees: half the width of that light
    unknown: float = 0.3  # confidence of that light
    # px: longer side of the picture in which shadows on a wall are searched
    rough: int = 240


LIMITS = _Limits()


@dataclass(frozen=True)
class _Photo:
    """The reduced background and its objects; silhouettes and gradients at several
    scales, each made once.

    Lengths are px of the reduced background; labels, objects and boundaries are in px
    of the photo.
    """

    reduced: ReducedPhoto
    labels: Labels
    objects: Sequence[PhotoObject]
    matter: Mapping[int, Matter]
    boundaries: BoundaryGuess
    made: dict[tuple[int, float | None], LightGradients | None] = field(
        default_factory=dict
    )

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the reduced background, px."""
        return self.reduced.size

    @property
    def background(self) -> Rgb:
        """(h, w, 3)."""
        return self.reduced.background

    @property
    def coverage(self) -> F32:
        """(h, w)."""
        return self.reduced.coverage

    def silhouettes(self, scale: float, floor: float | None = None) -> list[Silhouette]:
        """Silhouettes at 1 / `scale` of the size; `floor` is a row of the photo."""
        at = partial(
            object_silhouettes,
            self.labels,
            self.objects,
            self.matter,
            self.boundaries,
            floor=floor,
        )
        return at(scale * self.reduced.scale)

    def gradients(
        self, longest: int, floor: float | None = None
    ) -> LightGradients | None:
        if (longest, floor) not in self.made:
            at = partial(self.silhouettes, floor=floor)
            made = light_gradients(self.background, self.coverage, longest, at)
            self.made[longest, floor] = made
        return self.made[longest, floor]


def side_view_shadows(
    background: Rgb,
    coverage: F32,
    labels: Labels,
    objects: Sequence[PhotoObject],
    matter: Mapping[int, Matter],
    boundaries: BoundaryGuess,
    guess: LightGuess,
) -> Shadows:
    """Return the role `shadow` for a photo from the side."""
    reduced = reduce_photo(background, coverage)
    photo = _Photo(reduced, labels, objects, matter, boundaries)
    found = None
    if not _is_ground_known(photo):
        found = find_smooth_shade(background, coverage, labels, objects)
    if found is not None:
        return _soft_light(*found, guess, boundaries.tilt)
    return restore_size(_reduced_shadows(photo, guess), reduced, background, coverage)


def _reduced_shadows(photo: _Photo, guess: LightGuess) -> Shadows:
    """Shadows of the reduced photo."""
    background, coverage = photo.background, photo.coverage
    nothing = Shadows(None, None, guess.light, 4.0, 4.0, None, 0.0)
    given = photo.gradients(COARSE)
    if given is None:
        return nothing
    wall = _wall_shadow(photo)
    found, floor = _floor_fit(photo, given, guess)
    silhouettes = photo.silhouettes(1.0, floor)
    for fit in (found, None) if found else (None,):
        if fit is None and wall is None:
            break
        dark = _predicted(silhouettes, fit, wall, photo.size)
        clean = remove_shadows(background, coverage, dark, typical_size(silhouettes))
        ratio = edge_ratio(background, clean, coverage)
        if ratio <= LIMITS.seen and (ratio <= LIMITS.calm or nothing.owners is None):
            casts = _casts(silhouettes, fit, wall, photo.size)
            nothing = replace(
                nothing, owners=shadow_owners(background, clean, coverage, casts)
            )
        if ratio <= LIMITS.calm:
            setting, sure = _light(fit, wall, guess, photo.size)
            setting = _with_known_tilt(setting, photo.boundaries.tilt)
            back = None if setting.backdrop == inf else round(setting.backdrop, 1)
            tilt, softness = (
                round(degrees(atan(setting.tilt)), 1),
                round(setting.softness, 1),
            )
            sure = round(min(0.9, sure), 2)
            return Shadows(
                clean, nothing.owners, setting.light, softness, tilt, back, sure
            )
    return _soft_shade(photo, guess) or nothing


def _is_ground_known(photo: _Photo) -> bool:
    """Return whether an object stands on a floor, seen from a small height."""
    if photo.boundaries.tilt is not None:
        return False
    given = photo.gradients(COARSE)
    for what in [] if given is None else given.silhouettes:
        height = what.coverage.shape[0]
        foot = what.corner[1] + height
        if what.floor is not None and what.floor - foot < LIMITS.foot * height:
            return True
    return False


def _soft_light(
    clean: Rgb, owners: Labels, guess: LightGuess, tilt: float | None
) -> Shadows:
    """Return shade on a ground of unknown geometry, with a soft light.

    Geometry then predicts little, and each object takes the shade that the photo shows
    with it.
    """
    direct = LIMITS.direct
    light = DistantLight(guess.light.direction, FULL * direct, FULL * (1 - direct))
    if tilt is None:
        tilt = round(degrees(atan(TILT)), 1)
    return Shadows(clean, owners, light, LIMITS.soft, tilt, None, LIMITS.unknown)


def _with_known_tilt(setting: ShadowSetting, angle: float | None) -> ShadowSetting:
    """Return the setting with the floor's true tilt, in which shadows lie at the same
    pixels.

    A shadow's length up the picture is the rise of the floor times the light's slant in
    depth: one fit cannot tell them apart.
    """
    if angle is None:
        return setting
    rise = tan(radians(angle))
    x, y, z = setting.light.direction
    direction = np.array([x, y, z * setting.tilt / rise])
    direction /= np.linalg.norm(direction)
    return replace(with_direction(setting, direction.tolist()), tilt=rise)


def _soft_shade(photo: _Photo, guess: LightGuess) -> Shadows | None:
    """Return the shade of soft light on a floor under the lowest object; None where it
    is not seen.
    """
    bottom = max(bounds(item.outline)[3] for item in photo.objects)
    if bottom >= len(photo.labels) - 1:
        return None
    at = partial(photo.silhouettes, floor=bottom)
    shade = find_ambient_shade(photo.background, photo.coverage, at, from_above=False)
    if shade is None:
        return None
    fit = LightFit(shade.setting, 0.0, shade.factor, shade.factor)
    silhouettes = photo.silhouettes(1.0, bottom)
    dark = _predicted(silhouettes, fit, None, photo.size)
    # a surface where shade is predicted, and that is no darker there, lies in none
    there = np.where(photo.coverage > 0, 1, np.clip(shade.missing / FAINT, 0, 1))
    predicted = np.asarray(dark * there, np.float32)
    clean = remove_shadows(
        photo.background, photo.coverage, predicted, typical_size(silhouettes)
    )
    if edge_ratio(photo.background, clean, photo.coverage) > LIMITS.seen:
        return None
    seen = np.where(dark > PREDICTED, shade.missing, 0).astype(np.float32)
    owners = shadow_owners_by_model(
        photo.coverage, _casts(silhouettes, fit, None, photo.size), seen
    )
    tilt = photo.boundaries.tilt
    if tilt is None:  # shade all around an object does not depend on the tilt
        tilt = round(degrees(atan(shade.setting.tilt)), 1)
    softness, sure = shade.setting.softness, shade.confidence
    return Shadows(clean, owners, guess.light, softness, tilt, None, sure)


def _predicted(
    silhouettes: Sequence[Silhouette],
    fit: LightFit | None,
    wall: WallShadow | None,
    size: tuple[int, int],
) -> F32:
    """(H, W) -log of the light that the objects leave, on floor and wall."""
    dark = np.zeros(size[::-1], np.float32)
    if fit is not None:
        dark += np.float32(fit.factor) * predicted_darkness(
            join_silhouettes(silhouettes), fit.setting
        )
    if wall is not None:
        dark += np.float32(wall.factor) * _softened(
            wall_coverage(silhouettes, wall, 1.0, size), wall
        )
    return np.minimum(dark, LIMITS.darkest)


def _softened(coverage: F32, wall: WallShadow) -> F32:
    return np.asarray(
        cv2.GaussianBlur(coverage, (0, 0), max(wall.soft, 0.5)), np.float32
    )


def _casts(
    silhouettes: Sequence[Silhouette],
    fit: LightFit | None,
    wall: WallShadow | None,
    size: tuple[int, int],
) -> Casts:
    """Shadows of each object on floor and wall."""
    if fit is not None:
        for what in silhouettes:
            if (found := shadow_darkness(what, fit.setting)) is not None:
                yield what.id, found[0], np.float32(fit.factor) * found[1]
    if wall is not None:
        for what in silhouettes:
            soft = _softened(cast_on_wall(what, wall, 1.0, size), wall)
            yield (
                what.id,
                (0, 0, *size),
                np.asarray(np.float32(wall.factor) * soft, np.float32),
            )


def _floor_fit(
    photo: _Photo, given: LightGradients, guess: LightGuess
) -> tuple[LightFit | None, float | None]:
    """Return a light whose shadows lie on the floor, in px of the photo, if there is
    one; and the floor's row if guessed.
    """
    coarse: list[LightGradients] = [given]
    floors: list[float | None] = [None]
    lowest = lowest_floor(photo.boundaries)
    if lowest is not None:
        row = lowest / (given.scale * photo.reduced.scale)
        elsewhere = any(
            s.floor is None or abs(s.floor - row) > 2 for s in given.silhouettes
        )
        other = photo.gradients(COARSE, lowest) if elsewhere else None
        if other is not None:
            coarse.append(other)
            floors.append(lowest)
    k, rough = search_light(coarse, guess)
    fine = photo.gradients(FINE, floors[k])
    assert fine is not None
    fit = refine_light(fine, replace(rough.setting, size=fine.size), guess)
    if not _is_sure(fine, fit):
        return None, floors[k]
    each = fit.factor
    if len(fine.joined) < len(fine.silhouettes):
        _, each = fine.agreement(predicted_darkness(fine.silhouettes, fit.setting))
    return replace(
        fit, setting=replace(fit.setting, size=photo.size), each=each
    ), floors[k]


def _is_sure(fine: LightGradients, fit: LightFit) -> bool:
    """Return whether such shadows are there: alike, and dark enough."""
    model = predicted_darkness(fine.joined, fit.setting) * fine.known
    seen = model[model > 0.02]
    depth = fit.factor * float(np.percentile(seen, 95)) if seen.size else 0.0
    sure = fit.likeness + LIMITS.deep * min(depth, 1.0) > LIMITS.sure
    return depth > LIMITS.faintest and fit.likeness > LIMITS.alike and sure


def _wall_shadow(photo: _Photo) -> WallShadow | None:
    """Return the shadows on a wall behind, where they are seen."""
    rough = photo.gradients(LIMITS.rough)
    wall = None if rough is None else find_wall_shadow(rough)
    if rough is None or wall is None or not wall.convincing(len(rough.silhouettes)):
        return None
    fine = photo.gradients(FINE)
    wall = wall if fine is None else refine_wall_shadow(fine, wall)
    return wall if wall.factor > LIMITS.faintest else None


def _light(
    fit: LightFit | None,
    wall: WallShadow | None,
    guess: LightGuess,
    size: tuple[int, int],
) -> tuple[ShadowSetting, float]:
    """Return the light and where its shadows fall, and its confidence."""
    if fit is None:
        assert wall is not None
        return _light_of_wall(wall, guess, size), wall.likeness
    facing = (0.0, -1.0, 0.0)
    share = 1 - (1 - min(fit.setting.direct(facing), 0.98)) ** fit.each
    setting = _with_share(fit.setting, facing, share)
    if wall is None:
        return setting, fit.likeness
    x, y, z = setting.light.direction
    back = _distance_back(
        wall, np.array([-x / max(z, 0.2), -y / max(z, 0.2) - setting.tilt])
    )
    sure = max(fit.likeness, wall.likeness)
    return (replace(setting, backdrop=back) if back > 1 else setting), sure


def _distance_back(wall: WallShadow, flat: np.ndarray) -> float:
    """px to the wall, where shadows move by `flat` (2,) for each px back."""
    return float(flat @ np.array(wall.shift) / max(float(flat @ flat), 1e-3))


def _light_of_wall(
    wall: WallShadow, guess: LightGuess, size: tuple[int, int]
) -> ShadowSetting:
    """Return the light of shadows that lie on a wall alone."""
    dx, dy = wall.shift
    x, y, z = guess.light.direction
    back = _distance_back(wall, np.array([-x, -y - TILT * z]) / max(z, 0.2))
    if guess.confidence < TRUSTED or back < 0.3 * hypot(dx, dy):
        back = 0.8 * hypot(dx, dy)
    direction = np.array([-dx / back, -(dy / back + TILT), 1.0])
    a, b, c = (direction / np.linalg.norm(direction)).tolist()
    far = back / max(c, 0.2) * float(np.hypot(1, 0.5 * hypot(a, b) / max(c, 0.2)))
    softness = min(max(degrees(atan(2 * max(wall.soft - 0.35, 0.0) / far)), 0.3), 45.0)
    setting = ShadowSetting(
        DistantLight((a, b, c), 1.0, 0.2), softness, False, TILT, back, size
    )
    return _with_share(setting, (0.0, 0.0, 1.0), 1 - float(np.exp(-wall.factor)))


def _with_share(
    setting: ShadowSetting, facing: tuple[float, float, float], share: float
) -> ShadowSetting:
    """Return the same with so much of the light direct on a surface that faces
    there.
    """
    share = min(max(share, 0.02), 0.97)
    now = min(max(setting.direct(facing), 1e-3), 0.999)
    light = setting.light
    ratio = (
        light.intensity
        / max(light.ambient, 1e-3)
        * (share / (1 - share))
        / (now / (1 - now))
    )
    ambient = FULL / (1 + min(ratio, 100.0))
    return replace(
        setting, light=DistantLight(light.direction, FULL - ambient, ambient)
    )
