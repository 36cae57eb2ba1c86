"""Shadows of a photo taken from the side: removal, owners and light."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import atan, degrees, hypot, inf

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import bounds
from physgen.geometry.shadows import PixelBox, Silhouette, shadow_darkness
from physgen.geometry.shadows import ShadowSetting as Place
from physgen.perceive.roles import BoundaryGuess, Labels, LightGuess, Matter, PhotoObject, Rgb, Shadows
from physgen.perceive.shadow import shadow_fit
from physgen.perceive.shadow.ambient_shade import find_ambient_shade
from physgen.perceive.shadow.shadow_assignment import FAINT, FORETOLD, shadow_owners, shadow_owners_by_model
from physgen.perceive.shadow.shadow_fit import (
    BY_A_WALL,
    COARSE,
    FINE,
    TILT,
    TOLD,
    LightFit,
    LightGradients,
    WallShadow,
    fit_wall,
    light_gradients,
    predicted_darkness,
    refine_light,
    scale_place,
    search_light,
    settle_shadows,
)
from physgen.perceive.shadow.shadow_removal import edge_ratio, remove_shadows
from physgen.perceive.shadow.silhouettes import (
    group_silhouettes,
    join_silhouettes,
    lowest_floor,
    object_silhouettes,
    typical_size,
)
from physgen.photometry import DistantLight

F32 = NDArray[np.float32]

ALIKE, SURE = 0.5, 0.75
"""Correlation of slopes that shadows on a floor need, and with DEEP for each unit of depth, up to one."""
DEEP = 0.3
CALM = 0.85
"""Of the slopes of light there, lifting must leave no more: a shadow's edges go with it."""
SEEN = 1.0
"""Up to this there are shadows, though they lie too far astray to be lifted."""
FAINTEST = 0.15
"""-log of light: shadows of less are not believed."""
WALLS = (0.3, 0.6, 1.2, 2.4)
"""Of an object's size: how far behind the objects a wall is looked for first."""
DARKEST = 2.5
"""-log of the least light that a shadow leaves."""
ROUGH = 240
"""px: longer side of the picture in which shadows on a wall are looked for."""
FULL = 1.2
"""Shading where light falls straight: there a surface shows its own colour."""


@dataclass(frozen=True)
class _Photo:
    """What is asked of at several scales."""

    background: Rgb
    coverage: F32
    labels: Labels
    things: Sequence[PhotoObject]
    matter: Mapping[int, Matter]
    setting: BoundaryGuess
    traces: dict[tuple[int, float | None], LightGradients | None] = field(default_factory=dict)

    def at(self, scale: float, floor: float | None = None) -> list[Silhouette]:
        return object_silhouettes(self.labels, self.things, self.matter, self.setting, scale, floor)

    def trace(self, longest: int, floor: float | None = None) -> LightGradients | None:
        """Made once."""
        if (longest, floor) not in self.traces:
            made = light_gradients(
                self.background, self.coverage, longest, lambda scale: self.at(scale, floor)
            )
            self.traces[longest, floor] = made
        return self.traces[longest, floor]


def side_view_shadows(
    background: Rgb,
    coverage: F32,
    labels: Labels,
    things: Sequence[PhotoObject],
    matter: Mapping[int, Matter],
    setting: BoundaryGuess,
    guess: LightGuess,
) -> Shadows:
    """The role `shadow` for a photo from the side."""
    photo = _Photo(background, coverage, labels, things, matter, setting)
    nothing = Shadows(None, None, guess.light, 4.0, 4.0, None, 0.0, "no shadow of the objects is seen")
    given = photo.trace(COARSE)
    if given is None:
        return nothing
    cast = _wall(photo)
    fits, floor = _floor(photo, given, guess, cast is None)
    things_at = photo.at(1.0, floor)
    for fit in (*fits, None):
        if fit is None and cast is None:
            break
        dark = _foretold(things_at, fit, cast, labels.shape)
        clean = remove_shadows(background, coverage, dark, typical_size(things_at))
        rough = edge_ratio(background, clean, coverage)
        if rough <= SEEN and (rough <= CALM or nothing.owners is None):
            whose = shadow_owners(background, clean, coverage, _casts(things_at, fit, cast, labels.shape))
            nothing = replace(nothing, owners=whose)
        if rough <= CALM:
            place, sure, reason = _told(fit, cast, guess, (labels.shape[1], labels.shape[0]))
            back = None if place.backdrop == inf else round(place.backdrop, 1)
            tilt, softness = round(degrees(atan(place.tilt)), 1), round(place.softness, 1)
            sure = round(min(0.9, sure), 2)
            return Shadows(clean, nothing.owners, place.light, softness, tilt, back, sure, reason)
    return _soft(photo, guess) or nothing


def _soft(photo: _Photo, guess: LightGuess) -> Shadows | None:
    """The shade of soft light on a floor under the lowest thing; None where the photo does not tell of it."""
    H, W = photo.labels.shape
    bottom = max(bounds(thing.outline)[3] for thing in photo.things)
    if bottom >= H - 1:
        return None
    shade = find_ambient_shade(
        photo.background, photo.coverage, lambda scale: photo.at(scale, bottom), from_above=False
    )
    if shade is None:
        return None
    fit = LightFit(shade.place, 0.0, shade.factor, shade.factor)
    things = photo.at(1.0, bottom)
    dark = _foretold(things, fit, None, (H, W))
    # what stands where the shade is foretold, and is no darker there, lies in none
    there = np.where(photo.coverage > 0, 1, np.clip(shade.missing / FAINT, 0, 1))
    clean = remove_shadows(
        photo.background, photo.coverage, np.asarray(dark * there, np.float32), typical_size(things)
    )
    if edge_ratio(photo.background, clean, photo.coverage) > SEEN:
        return None
    seen = np.where(dark > FORETOLD, shade.missing, 0).astype(np.float32)
    whose = shadow_owners_by_model(photo.coverage, _casts(things, fit, None, (H, W)), seen)
    tilt = round(degrees(atan(shade.place.tilt)), 1)
    return Shadows(
        clean, whose, guess.light, shade.place.softness, tilt, None, shade.confidence, shade.reason
    )


def _foretold(
    things: Sequence[Silhouette], fit: LightFit | None, cast: WallShadow | None, shape: tuple[int, ...]
) -> F32:
    """(H, W) -log of the light that the objects leave, on floor and wall."""
    H, W = shape
    dark = np.zeros((H, W), np.float32)
    if fit is not None:
        dark += np.float32(fit.factor) * predicted_darkness(
            join_silhouettes(things), fit.place, _shifts(fit, things)
        )
    if cast is not None:
        wall = np.zeros((H, W), np.float32)
        for what in things:
            np.maximum(wall, shadow_fit.cast_on_wall(what, cast, 1.0, (W, H)), out=wall)
        dark += np.float32(cast.factor) * cv2.GaussianBlur(wall, (0, 0), max(cast.soft, 0.5))
    return np.minimum(dark, DARKEST)


def _casts(
    things: Sequence[Silhouette], fit: LightFit | None, cast: WallShadow | None, shape: tuple[int, ...]
) -> Iterator[tuple[int, PixelBox, F32]]:
    """Of each object its id and -log of the light that it leaves in a box of the photo, on floor and wall."""
    H, W = shape
    if fit is not None:
        groups = group_silhouettes(things)
        for group, (dx, dy) in zip(groups, _shifts(fit, things), strict=True):
            for what in group:
                if (found := shadow_darkness(what, fit.place)) is not None:
                    (x0, y0, x1, y1), values = found
                    left, top = max(x0 + dx, 0), max(y0 + dy, 0)
                    right, bottom = min(x1 + dx, W), min(y1 + dy, H)
                    if right > left and bottom > top:
                        part = np.s_[top - y0 - dy : bottom - y0 - dy, left - x0 - dx : right - x0 - dx]
                        yield what.id, (left, top, right, bottom), np.float32(fit.factor) * values[part]
    if cast is not None:
        for what in things:
            wall = cv2.GaussianBlur(
                shadow_fit.cast_on_wall(what, cast, 1.0, (W, H)), (0, 0), max(cast.soft, 0.5)
            )
            yield what.id, (0, 0, W, H), np.asarray(np.float32(cast.factor) * wall, np.float32)


def _floor(
    photo: _Photo, given: LightGradients, guess: LightGuess, walls: bool
) -> tuple[list[LightFit], float | None]:
    """Lights whose shadows lie on the floor, in px of the photo, the likeliest first; the floor's row if it is a guess.

    `walls`: whether a wall behind may take some of them.
    """
    traces: list[LightGradients] = [given]
    floors: list[float | None] = [None]
    lowest = lowest_floor(photo.setting)
    if lowest is not None and any(_off(s.floor, lowest / given.scale) for s in given.silhouettes):
        other = photo.trace(COARSE, lowest)
        if other is not None:
            traces.append(other)
            floors.append(lowest)
    H, W = photo.coverage.shape

    def found(back: Sequence[float]) -> tuple[LightGradients, LightFit, float | None]:
        k, rough = search_light(traces, guess, back)
        fine = photo.trace(FINE, floors[k])
        assert fine is not None
        return (
            fine,
            refine_light(fine, scale_place(rough.place, given.scale / fine.scale, fine.size), guess),
            floors[k],
        )

    fine, plain, floor = found((inf,))
    fits = [plain]
    if walls and (walled := fit_wall(fine, plain, guess)) is not None:
        fits.insert(0, walled)
    elif walls and not _sure(fine, plain):  # what stands close to a wall throws hardly any shadow elsewhere
        fine, walled, floor = found([part * typical_size(given.silhouettes) for part in WALLS])
        fits = [walled]
    return [_full(fine, settle_shadows(fine, fit), (W, H)) for fit in fits if _sure(fine, fit)], floor


def _sure(fine: LightGradients, fit: LightFit) -> bool:
    """Whether such shadows are there: alike, and dark enough to tell."""
    model = predicted_darkness(fine.joined, fit.place) * fine.known
    seen = model[model > 0.02]
    depth = fit.factor * float(np.percentile(seen, 95)) if seen.size else 0.0
    least = ALIKE if fit.place.backdrop == inf else BY_A_WALL
    return depth > FAINTEST and fit.likeness > least and fit.likeness + DEEP * min(depth, 1.0) > SURE


def _full(fine: LightGradients, fit: LightFit, size: tuple[int, int]) -> LightFit:
    """The same in px of the photo, of `size` (W, H), and how dark each thing's own shadow is."""
    groups = zip(group_silhouettes(fine.silhouettes), fit.shifts, strict=True) if fit.shifts else ()
    moved = {
        w.id: (round(dx * fine.scale), round(dy * fine.scale)) for group, (dx, dy) in groups for w in group
    }
    each = fit.factor
    if len(fine.joined) < len(fine.silhouettes):
        _, each = fine.agreement(predicted_darkness(fine.silhouettes, fit.place))
    return replace(fit, place=scale_place(fit.place, fine.scale, size), each=each, shifts=(), moved=moved)


def _shifts(fit: LightFit, things: Sequence[Silhouette]) -> list[tuple[int, int]]:
    """By how much the shadow of each of `grouped` lies elsewhere, px of the photo; other scales may group otherwise."""
    return [fit.moved.get(group[0].id, (0, 0)) for group in group_silhouettes(things)]


def _off(floor: float | None, lowest: float) -> bool:
    return floor is None or abs(floor - lowest) > 2


def _wall(photo: _Photo) -> WallShadow | None:
    """The shadows on a wall behind, where they are seen."""
    rough = photo.trace(ROUGH)
    cast = None if rough is None else shadow_fit.find_wall_shadow(rough)
    if rough is None or cast is None or not cast.convincing(len(rough.silhouettes)):
        return None
    fine = photo.trace(FINE)
    cast = cast if fine is None else shadow_fit.refine_wall_shadow(fine, cast)
    return cast if cast.factor > FAINTEST else None


def _told(
    fit: LightFit | None, cast: WallShadow | None, guess: LightGuess, size: tuple[int, int]
) -> tuple[Place, float, str]:
    """The light and where its shadows fall; how sure; and why."""
    if fit is not None:
        facing = (0.0, -1.0, 0.0)
        share = 1 - (1 - min(fit.place.direct(facing), 0.98)) ** fit.each
        place = _shared(fit.place, facing, share)
        reason = f"where the objects' shadows lie on the floor (correlation {fit.likeness:.2f})"
        if cast is None:
            return place, fit.likeness, reason
        x, y, z = place.light.direction
        flat = np.array([-x / max(z, 0.2), -y / max(z, 0.2) - place.tilt])
        back = float(flat @ np.array(cast.shift) / max(float(flat @ flat), 1e-3))
        reason = f"where the objects' shadows lie on the floor and on a wall (correlation {fit.likeness:.2f})"
        return replace(place, backdrop=back) if back > 1 else place, max(fit.likeness, cast.likeness), reason
    assert cast is not None
    dx, dy = cast.shift
    x, y, z = guess.light.direction
    flat = np.array([-x, -y - TILT * z]) / max(z, 0.2)
    back = float(flat @ np.array(cast.shift) / max(float(flat @ flat), 1e-3))
    if guess.confidence < TOLD or back < 0.3 * hypot(dx, dy):
        back = 0.8 * hypot(dx, dy)
    direction = np.array([-dx / back, -(dy / back + TILT), 1.0])
    a, b, c = (direction / np.linalg.norm(direction)).tolist()
    far = back / max(c, 0.2) * float(np.hypot(1, 0.5 * hypot(a, b) / max(c, 0.2)))
    softness = degrees(atan(2 * max(cast.soft - 0.35, 0.0) / far))
    place = Place(DistantLight((a, b, c), 1.0, 0.2), min(max(softness, 0.3), 45.0), False, TILT, back, size)
    place = _shared(place, (0.0, 0.0, 1.0), 1 - float(np.exp(-cast.factor)))
    return (
        place,
        cast.likeness,
        f"where the objects' shadows lie on a wall behind (correlation {cast.likeness:.2f})",
    )


def _shared(place: Place, facing: tuple[float, float, float], share: float) -> Place:
    """The same with so much of the light direct on a surface that faces there."""
    share = min(max(share, 0.02), 0.97)
    now = min(max(place.direct(facing), 1e-3), 0.999)
    light = place.light
    ratio = light.intensity / max(light.ambient, 1e-3) * (share / (1 - share)) / (now / (1 - now))
    ambient = FULL / (1 + min(ratio, 100.0))
    return replace(place, light=DistantLight(light.direction, FULL - ambient, ambient))
