"""Photo from the side -> the objects' shadows on floor and wall, lifted, and the light that throws them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import atan, degrees, hypot, inf

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.outline.outline import bounds
from physgen.perceive import wall_shadow
from physgen.perceive.contact import contact
from physgen.perceive.owned import FAINT, FORETOLD, owners, told
from physgen.perceive.roles import Labels, LightGuess, Matter, Rgb, Setting, Shadows, Thing
from physgen.perceive.side_light import (
    BY_A_WALL,
    COARSE,
    FINE,
    TILT,
    TOLD,
    Fit,
    before_wall,
    best_light,
    refined,
    scaled,
    settled,
)
from physgen.perceive.silhouettes import grouped, joined, lowest_floor, silhouettes, typical
from physgen.perceive.trace import Trace, foretold, trace
from physgen.perceive.unshaded import lifted, roughness
from physgen.perceive.wall_shadow import Cast
from physgen.photometry import DistantLight
from physgen.shadow.cast import Box, Silhouette
from physgen.shadow.cast import Setting as Place
from physgen.shadow.darkness import darkness

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
    things: Sequence[Thing]
    matter: Mapping[int, Matter]
    setting: Setting
    traces: dict[tuple[int, float | None], Trace | None] = field(default_factory=dict)

    def at(self, scale: float, floor: float | None = None) -> list[Silhouette]:
        return silhouettes(self.labels, self.things, self.matter, self.setting, scale, floor)

    def trace(self, longest: int, floor: float | None = None) -> Trace | None:
        """Made once."""
        if (longest, floor) not in self.traces:
            made = trace(self.background, self.coverage, longest, lambda scale: self.at(scale, floor))
            self.traces[longest, floor] = made
        return self.traces[longest, floor]


def side_shadows(
    background: Rgb,
    coverage: F32,
    labels: Labels,
    things: Sequence[Thing],
    matter: Mapping[int, Matter],
    setting: Setting,
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
        clean = lifted(background, coverage, dark, typical(things_at))
        rough = roughness(background, clean, coverage)
        if rough <= SEEN and (rough <= CALM or nothing.owners is None):
            whose = owners(background, clean, coverage, _casts(things_at, fit, cast, labels.shape))
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
    shade = contact(photo.background, photo.coverage, lambda scale: photo.at(scale, bottom), from_above=False)
    if shade is None:
        return None
    fit = Fit(shade.place, 0.0, shade.factor, shade.factor)
    things = photo.at(1.0, bottom)
    dark = _foretold(things, fit, None, (H, W))
    # what stands where the shade is foretold, and is no darker there, lies in none
    there = np.where(photo.coverage > 0, 1, np.clip(shade.missing / FAINT, 0, 1))
    clean = lifted(photo.background, photo.coverage, np.asarray(dark * there, np.float32), typical(things))
    if roughness(photo.background, clean, photo.coverage) > SEEN:
        return None
    seen = np.where(dark > FORETOLD, shade.missing, 0).astype(np.float32)
    whose = told(photo.coverage, _casts(things, fit, None, (H, W)), seen)
    tilt = round(degrees(atan(shade.place.tilt)), 1)
    return Shadows(
        clean, whose, guess.light, shade.place.softness, tilt, None, shade.confidence, shade.reason
    )


def _foretold(
    things: Sequence[Silhouette], fit: Fit | None, cast: Cast | None, shape: tuple[int, ...]
) -> F32:
    """(H, W) -log of the light that the objects leave, on floor and wall."""
    H, W = shape
    dark = np.zeros((H, W), np.float32)
    if fit is not None:
        dark += np.float32(fit.factor) * foretold(joined(things), fit.place, _shifts(fit, things))
    if cast is not None:
        wall = np.zeros((H, W), np.float32)
        for what in things:
            np.maximum(wall, wall_shadow.thrown(what, cast, 1.0, (W, H)), out=wall)
        dark += np.float32(cast.factor) * cv2.GaussianBlur(wall, (0, 0), max(cast.soft, 0.5))
    return np.minimum(dark, DARKEST)


def _casts(
    things: Sequence[Silhouette], fit: Fit | None, cast: Cast | None, shape: tuple[int, ...]
) -> Iterator[tuple[int, Box, F32]]:
    """Of each object its id and -log of the light that it leaves in a box of the photo, on floor and wall."""
    H, W = shape
    if fit is not None:
        groups = grouped(things)
        for group, (dx, dy) in zip(groups, _shifts(fit, things), strict=True):
            for what in group:
                if (found := darkness(what, fit.place)) is not None:
                    (x0, y0, x1, y1), values = found
                    left, top = max(x0 + dx, 0), max(y0 + dy, 0)
                    right, bottom = min(x1 + dx, W), min(y1 + dy, H)
                    if right > left and bottom > top:
                        part = np.s_[top - y0 - dy : bottom - y0 - dy, left - x0 - dx : right - x0 - dx]
                        yield what.id, (left, top, right, bottom), np.float32(fit.factor) * values[part]
    if cast is not None:
        for what in things:
            wall = cv2.GaussianBlur(wall_shadow.thrown(what, cast, 1.0, (W, H)), (0, 0), max(cast.soft, 0.5))
            yield what.id, (0, 0, W, H), np.asarray(np.float32(cast.factor) * wall, np.float32)


def _floor(photo: _Photo, given: Trace, guess: LightGuess, walls: bool) -> tuple[list[Fit], float | None]:
    """Lights whose shadows lie on the floor, in px of the photo, the likeliest first; the floor's row if it is a guess.

    `walls`: whether a wall behind may take some of them.
    """
    traces: list[Trace] = [given]
    floors: list[float | None] = [None]
    lowest = lowest_floor(photo.setting)
    if lowest is not None and any(_off(s.floor, lowest / given.scale) for s in given.silhouettes):
        other = photo.trace(COARSE, lowest)
        if other is not None:
            traces.append(other)
            floors.append(lowest)
    H, W = photo.coverage.shape

    def found(back: Sequence[float]) -> tuple[Trace, Fit, float | None]:
        k, rough = best_light(traces, guess, back)
        fine = photo.trace(FINE, floors[k])
        assert fine is not None
        return fine, refined(fine, scaled(rough.place, given.scale / fine.scale, fine.size), guess), floors[k]

    fine, plain, floor = found((inf,))
    fits = [plain]
    if walls and (walled := before_wall(fine, plain, guess)) is not None:
        fits.insert(0, walled)
    elif walls and not _sure(fine, plain):  # what stands close to a wall throws hardly any shadow elsewhere
        fine, walled, floor = found([part * typical(given.silhouettes) for part in WALLS])
        fits = [walled]
    return [_full(fine, settled(fine, fit), (W, H)) for fit in fits if _sure(fine, fit)], floor


def _sure(fine: Trace, fit: Fit) -> bool:
    """Whether such shadows are there: alike, and dark enough to tell."""
    model = foretold(fine.joined, fit.place) * fine.known
    seen = model[model > 0.02]
    depth = fit.factor * float(np.percentile(seen, 95)) if seen.size else 0.0
    least = ALIKE if fit.place.backdrop == inf else BY_A_WALL
    return depth > FAINTEST and fit.likeness > least and fit.likeness + DEEP * min(depth, 1.0) > SURE


def _full(fine: Trace, fit: Fit, size: tuple[int, int]) -> Fit:
    """The same in px of the photo, of `size` (W, H), and how dark each thing's own shadow is."""
    groups = zip(grouped(fine.silhouettes), fit.shifts, strict=True) if fit.shifts else ()
    moved = {
        w.id: (round(dx * fine.scale), round(dy * fine.scale)) for group, (dx, dy) in groups for w in group
    }
    each = fit.factor
    if len(fine.joined) < len(fine.silhouettes):
        _, each = fine.agreement(foretold(fine.silhouettes, fit.place))
    return replace(fit, place=scaled(fit.place, fine.scale, size), each=each, shifts=(), moved=moved)


def _shifts(fit: Fit, things: Sequence[Silhouette]) -> list[tuple[int, int]]:
    """By how much the shadow of each of `grouped` lies elsewhere, px of the photo; other scales may group otherwise."""
    return [fit.moved.get(group[0].id, (0, 0)) for group in grouped(things)]


def _off(floor: float | None, lowest: float) -> bool:
    return floor is None or abs(floor - lowest) > 2


def _wall(photo: _Photo) -> Cast | None:
    """The shadows on a wall behind, where they are seen."""
    rough = photo.trace(ROUGH)
    cast = None if rough is None else wall_shadow.on_wall(rough)
    if rough is None or cast is None or not cast.convincing(len(rough.silhouettes)):
        return None
    fine = photo.trace(FINE)
    cast = cast if fine is None else wall_shadow.refined(fine, cast)
    return cast if cast.factor > FAINTEST else None


def _told(
    fit: Fit | None, cast: Cast | None, guess: LightGuess, size: tuple[int, int]
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
