"""Background separated into light and the shadow of each object, and recomposed for new poses.

Shadows are kept as negative logarithms of the share of light that is left, so those of many objects add up, and at
t = 0 the sum is the photo's. The shadow that geometry predicts is an object's own; darkness of the photo beyond that
belongs to the nearest object and moves with it, as long as the object stands on the floor as it did. Where an object
may have thrown a shadow, the plate is the clean picture: what the photo shows beyond both goes as the object leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, Mask
from physgen.geometry.polygon import Pose
from physgen.geometry.shadows import (
    PixelBox,
    ShadowSetting,
    Silhouette,
    blurred,
    floor_share,
    joined_pictures,
    moved_silhouette,
    shadow_darkness,
)
from physgen.maps import U8
from physgen.perceive.inpaint.poisson import harmonic_fill
from physgen.photometry import decode, luminance


@dataclass(frozen=True)
class ShadowTuning:
    """Thresholds of the separation of shadows from the background."""

    lift: float = 0.25
    """Of an object's size: off the floor by as much, its shadow in the photo is no longer its own."""
    comes: float = 0.5
    """Of an object's size: moved by as much, it has mostly left an old shadow that was not removed."""
    parts: float = 0.1
    """Of an object's size: moved by as much, it has mostly left the photo's shadow for the predicted one."""
    still: float = 0.995
    """Share of the photo's shadow from which the predicted one is left out."""
    flies: float = 2.0
    """Of an object's thickness: so far above the floor its shadow falls on the wall, if there is one."""
    turn: float = 0.35
    """rad by which an object that is not round may turn until then."""
    smooth: float = 0.5
    """px, beside a median over 5 px: what the photo's shadows have of finer detail stays in the background."""
    ring: int = 2
    """px around objects where the background still shows traces of them."""
    gap: int = 4
    """px: half the width of gaps between objects in which no background is seen."""
    deepest: float = 3.5
    """-log of the least light that a shadow leaves."""
    near: float = 0.5
    """Of an object's size: how far around it what is dark may be its own."""
    claimed: tuple[float, float] = (0.02, 0.1)
    """Sum of objects' claims on a pixel from which its plate gives way to the clean picture, and where it is that."""
    explained: float = 0.5
    """Share of the spread of shadows' offsets that one near lamp must explain, to be believed."""
    shadows: int = 3
    """Shadows that slide, at least: two lie along any line by chance."""
    lamp: float = 1.5
    """Times that spread (fitted on billiards): a part of each offset is what geometry predicts for all alike."""
    leans: float = 0.3
    """px for each px of the object's way, at most."""
    faint: float = 0.006
    """-log of light that is not missed: half a grey level of a middle grey."""
    compared: tuple[float, int] = (0.2, 200)
    """-log of light from which, and px on which, predicted shadows are compared with the photo's."""
    lacking: tuple[float, float] = (0.65, 0.3)
    """Quantile of the photo's depth over the predicted one, for some lie beside it.

    And its least value. By tune.
    """
    cells: int = 24
    """Of the grid on which a shadow is worked out, at least so many across the object."""


SHADOW = ShadowTuning()
FAR = 1e6
"""px, beyond any picture."""


@dataclass(frozen=True)
class CastShadow:
    """One object's share of the photo's shadows; darkness is -log of the light that it leaves."""

    start: Silhouette
    step: int
    """px a side of the grid on which its shadow is worked out."""
    whole: tuple[PixelBox, F32] | None
    """All of it, at t = 0."""
    own: tuple[
        PixelBox, F32
    ]  # of `whole` what the photo shows beyond geometry, of either sign
    sliding: tuple[tuple[int, int], F32] | None
    """Where the shadow never changes its shape: its corner, and all of it, beyond the photo's border too."""
    round: bool
    """Whether turning changes nothing."""
    beyond: F32 | None = None
    """(h, w): the share of `own` that lies beyond the ends of the object's floor at t = 0; None: none of it."""
    lean: float = 0.0
    """px that a sliding shadow moves beyond its object for each px of the object's way: a lamp is near."""


@dataclass(frozen=True)
class LitBackground:
    """A background taken apart."""

    setting: ShadowSetting
    plate: F32
    """(H, W, 3) linear: in the light that no object keeps away.

    The clean picture where objects may have shadows.
    """
    tint: F32
    """(3,): by how much more or less than the average a channel darkens."""
    total: F32
    """(H, W): -log of the light left at t = 0, of all objects."""
    casts: Sequence[CastShadow]
    owner: NDArray[np.int32]
    """(H, W): 1 + the index of the cast whose object most likely changes the picture there, 0: none."""
    lifted: bool = True
    """Whether a backend has taken the photo's shadows apart from the background."""

    def behind(self) -> F32:
        """Return (H, W, 3) linear: the background at t = 0."""
        return shaded_background(self.plate, self.total, self.tint)

    def limited(self, darkness: F32, box: tuple[slice, slice]) -> F32:
        """Limit the sum `darkness` (h, w) of shadows, in place: it is at least that of the photo, or none.

        Direct light that one shadow keeps away, others keep away no more.
        """
        cv2.max(darkness, self._least[box], dst=darkness)
        over = darkness - self._most[box]
        if over.max() <= 0:
            return darkness
        kept = darkness - over
        kept += 1
        kept -= cv2.exp(-over)
        np.copyto(kept, darkness, where=over <= 0)
        return np.asarray(kept, np.float32)

    @cached_property
    def _least(self) -> F32:
        """Return (H, W) the least darkness: nothing is brighter than the photo, or the plate."""
        return np.minimum(self.total, 0)

    @cached_property
    def _most(self) -> F32:
        """Return (H, W) the darkness that one object may cause."""
        return np.maximum(self.total, self.setting.shade)

    def moved(
        self, k: int, now: Silhouette | None, start: Pose, pose: Pose
    ) -> list[tuple[PixelBox, F32]]:
        """Return the shadows of object k now, at `pose` instead of `start`: boxes, and the darkness in each."""
        cast = self.casts[k]
        if cast.sliding is not None:
            return self._slid(cast, cast.sliding, start, pose)
        if now is None:
            return []
        if not self.lifted:
            return self._late_shadow(cast, now, start, pose)
        turn = pose.angle - start.angle
        strength, shift = self._kept(cast, now, turn)
        share = np.float32(0)
        if cast.whole is not None:
            share = _photo_share(cast, start, pose)
        shadows = []
        if share > 0 and cast.whole is not None:
            (x0, y0, _, _), picture = cast.whole
            box, moved = shifted_picture(picture, (x0, y0), shift, self.setting.size)
            if box is not None:
                shadows.append((box, moved if share == 1 else share * moved))
        if share == 1:
            return shadows
        rest = np.float32(1 - share)
        predicted = predicted_shadow(now, self.setting, cast.step)
        if predicted is not None:
            box, picture = predicted
            shadows.append((box, picture if share == 0 else rest * picture))
        own = self._carried_shadow(cast, now, float(rest) * strength, shift)
        if own is not None:
            shadows.append(own)
        return shadows

    def _late_shadow(
        self, cast: CastShadow, now: Silhouette, start: Pose, pose: Pose
    ) -> list[tuple[PixelBox, F32]]:
        """Return the predicted shadow, which comes as the object leaves the photo's shadow behind."""
        predicted = predicted_shadow(now, self.setting, cast.step)
        if predicted is None:
            return []
        box, picture = predicted
        return [(box, picture * _departure(now, start, pose))]

    def _slid(
        self,
        cast: CastShadow,
        sliding: tuple[tuple[int, int], F32],
        start: Pose,
        pose: Pose,
    ) -> list[tuple[PixelBox, F32]]:
        """Return a shadow that keeps its shape."""
        corner, picture = sliding
        factor = 1 + cast.lean
        shift = factor * (pose.x - start.x), factor * (pose.y - start.y)
        box, moved = shifted_picture(picture, corner, shift, self.setting.size)
        return [] if box is None else [(box, moved)]

    def _carried_shadow(
        self,
        cast: CastShadow,
        now: Silhouette,
        strength: float,
        shift: tuple[float, float],
    ) -> tuple[PixelBox, F32] | None:
        """Return the part of the photo's shadow that geometry does not explain, as it moves with its object."""
        if strength <= LEAST_STRENGTH:
            return None
        (x0, y0, _, _), own = cast.own
        size = self.setting.size
        box, carried = shifted_picture(own, (x0, y0), shift, size)
        if box is None:
            return None
        carried *= np.float32(strength)
        if now.floor is not None and self._on_wall(cast.start):
            wall_foot = now.floor - self.setting.tilt * self.setting.backdrop
            rows = np.arange(box[1], box[3], dtype=np.float32)[:, None]
            carried *= np.clip(wall_foot - rows + 0.5, 0, 1)
        elif now.floor is not None and not np.isfinite(self.setting.backdrop):
            upon = floor_share(now.ends, self.setting, box, now.floor)
            if cast.beyond is not None:
                # What the photo shows beyond the floor has another ground.
                _, beyond = shifted_picture(cast.beyond, (x0, y0), shift, size)
                np.maximum(upon, beyond, out=upon)
            carried *= upon
            # What is upright behind the floor gets no shadow of an object that moves.
            rows = np.arange(box[1], box[3], dtype=np.float32)[:, None]
            end = now.floor - self.setting.tilt * size[0]
            carried *= np.clip(rows - np.float32(end) + 0.5, 0, 1)
        return box, carried

    def _on_wall(self, start: Silhouette) -> bool:
        """Return whether an object's shadow is mostly on the wall behind: it flies before one."""
        if not np.isfinite(self.setting.backdrop):
            return False
        if start.floor is None:
            return True
        return start.floor - start.center[1] > SHADOW.flies * start.thick

    def _kept(
        self, cast: CastShadow, now: Silhouette, turn: float
    ) -> tuple[float, tuple[float, float]]:
        """Return the share of the photo's own shadow that still holds, and its shift, px."""
        start = cast.start
        dx, dy = now.center[0] - start.center[0], now.center[1] - start.center[1]
        size = max(min(start.coverage.shape), 1)
        strength = 1.0 if cast.round else _bell(turn / SHADOW.turn)
        if self.setting.top or self._on_wall(start):
            return strength, (dx, dy)
        if start.floor is None or now.floor is None:
            distance = np.hypot(dx, dy)
            return strength * _bell(distance / (SHADOW.lift * size)), (0.0, 0.0)
        lift = (start.floor - start.center[1]) - (now.floor - now.center[1])
        strength *= _bell(lift / (SHADOW.lift * size))
        return strength, (dx, now.floor - start.floor)


LEAST_STRENGTH = 0.02
"""Share of the photo's own shadow below which it is left out: nobody sees it."""


def _bell(distance: float) -> float:
    """Return 1 at 0 and 0 far away, as a Gaussian."""
    return float(np.exp(-(distance**2)))


def _photo_share(cast: CastShadow, start: Pose, pose: Pose) -> np.float32:
    """Return 1 if an object is where it started, and 0 if it has left the photo's shadow."""
    shape = cast.start.coverage.shape
    distance = np.hypot(pose.x - start.x, pose.y - start.y)
    if not cast.round:
        distance += abs(pose.angle - start.angle) * max(shape) / 2
    share = _bell(distance / (SHADOW.parts * max(min(shape), 1)))
    if share >= SHADOW.still:
        return np.float32(1)
    return np.float32(share if share > LEAST_STRENGTH else 0)


def _departure(now: Silhouette, start: Pose, pose: Pose) -> np.float32:
    """Return 0 if an object is where it started, and 1 if it has left."""
    distance = np.hypot(pose.x - start.x, pose.y - start.y)
    size = max(min(now.coverage.shape), 1)
    departure = distance / (SHADOW.comes * size)
    return np.float32(1 - np.exp(-(departure**2)))


QUICK_STEPS = (2, 3)
"""px of grids on which a ball's shadow is computed in full: it is quick, and a floor has few rows."""


def predicted_shadow(
    silhouette: Silhouette, setting: ShadowSetting, step: int
) -> tuple[PixelBox, F32] | None:
    """Compute `shadow_darkness` on a grid of `step` px: shadows are soft, and large objects have large shadows."""
    if silhouette.radius is not None and step in QUICK_STEPS:
        shadow = shadow_darkness(silhouette, setting)
        # Blurred as much as the grid would: no steps at the shadow's edge.
        return shadow and (shadow[0], blurred(shadow[1], 0.4 * step))
    if step == 1:
        return shadow_darkness(silhouette, setting)
    coarse = _coarse_silhouette(silhouette, step)
    shadow = shadow_darkness(coarse, _coarse(setting, step))
    if shadow is None:
        return None
    (x0, y0, x1, y1), darkness = shadow
    size = ((x1 - x0) * step, (y1 - y0) * step)
    fine = cv2.resize(darkness, size, interpolation=cv2.INTER_LINEAR)
    width, height = setting.size
    x0, y0 = x0 * step, y0 * step
    x1, y1 = min(x1 * step, width), min(y1 * step, height)
    return (x0, y0, x1, y1), np.asarray(fine[: y1 - y0, : x1 - x0], np.float32)


def _coarse_silhouette(silhouette: Silhouette, step: int) -> Silhouette:
    """Return a silhouette on a grid of `step` px, whose cells begin at the photo's corner."""

    def scale(place: float) -> float:
        return (place + 0.5) / step - 0.5

    (x, y), (height, width) = silhouette.corner, silhouette.coverage.shape
    left, top = x % step, y % step
    padded = cv2.copyMakeBorder(
        silhouette.coverage,
        top,
        -(top + height) % step,
        left,
        -(left + width) % step,
        cv2.BORDER_CONSTANT,
    )
    cells = (padded.shape[1] // step, padded.shape[0] // step)
    small = cv2.resize(padded, cells, interpolation=cv2.INTER_AREA)
    (cx, cy), (first, last) = silhouette.center, silhouette.ends
    radius, floor = silhouette.radius, silhouette.floor
    return Silhouette(
        np.asarray(small, np.float32),
        corner=((x - left) // step, (y - top) // step),
        center=(scale(cx), scale(cy)),
        radius=None if radius is None else radius / step,
        thick=silhouette.thick / step,
        floor=None if floor is None else scale(floor),
        ends=(scale(first), scale(last)),
        walls=silhouette.walls,
    )


@lru_cache(maxsize=64)
def _coarse(setting: ShadowSetting, step: int) -> ShadowSetting:
    """Return the setting on a grid of `step` px."""
    width, height = setting.size
    size = (-(-width // step), -(-height // step))
    return replace(setting, size=size, backdrop=setting.backdrop / step)


def shaded_background(plate: F32, darkness: F32, tint: F32) -> F32:
    """Return (h, w, 3) a plate in the remaining light."""
    logarithm = cv2.merge([darkness * -part for part in tint])
    return np.asarray(cv2.multiply(plate, cv2.exp(logarithm)), np.float32)


def shifted_picture(
    picture: F32,
    corner: tuple[int, int],
    shift: tuple[float, float],
    size: tuple[int, int],
) -> tuple[PixelBox | None, F32]:
    """Return a picture moved by a fraction of pixels, cut to the photo."""
    height, width = picture.shape[:2]
    x, y = corner[0] + shift[0], corner[1] + shift[1]
    first_column, first_row = int(np.floor(x)), int(np.floor(y))
    left, top = max(first_column, 0), max(first_row, 0)
    right = min(first_column + width + 1, size[0])
    bottom = min(first_row + height + 1, size[1])
    if not picture.size or right <= left or bottom <= top:
        return None, picture
    matrix = np.array([[1.0, 0, x - left], [0, 1, y - top]])
    box_size = (right - left, bottom - top)
    moved = cv2.warpAffine(picture, matrix, box_size, borderMode=cv2.BORDER_CONSTANT)
    return (left, top, right, bottom), np.asarray(moved, np.float32)


def decompose_shadows(
    background: U8,
    clean: U8 | None,
    coverage: F32,
    starts: Sequence[Silhouette],
    rounds: Sequence[bool],
    setting: ShadowSetting,
    gone: Sequence[Silhouette] = (),
    changed: Mask | None = None,
) -> tuple[LitBackground, F32 | None]:
    """Separate `background` (H, W, 3) sRGB into light and shadows by `clean` without shadows; None: not removed.

    `gone` are objects of the photo that the scene leaves out: their shadows leave with them. `changed` (H, W): where
    the background is not the photo's, which tells nothing of shadows close to objects either. The second result is
    (H, W) -log of the light that those left; None where there are none.
    """
    lit = decode(background)
    if clean is None:
        return _undivided(lit, starts, rounds, setting), None
    bare = decode(clean)
    darkness = _log(luminance(bare)) - _log(luminance(lit))
    np.clip(darkness, -0.5, SHADOW.deepest, out=darkness)
    is_open = _open_background(coverage)
    if changed is not None:
        is_open &= ~changed
    everybody = [*starts, *gone]
    steps = [shadow_grid_step(silhouette) for silhouette in everybody]
    setting, firsts, total = _matched_shadows(
        everybody, steps, setting, darkness, is_open
    )
    rest = _unexplained(darkness, total, is_open)
    claims = _claims(everybody, firsts, setting.size)
    claimed, owner = _claimed(claims, darkness.shape)
    every_cast = []
    for k, start in enumerate(everybody):
        own = _owned(rest, claims[k], claimed)
        is_round = k < len(starts) and rounds[k]
        every_cast.append(_cast(start, steps[k], firsts[k], own, is_round, setting))
    casts, ghost_casts = every_cast[: len(starts)], every_cast[len(starts) :]
    total = _sum_of_shadows(casts, darkness.shape)
    ghost_shadows = _sum_of_shadows(ghost_casts, darkness.shape)
    tint = _tint(lit, bare, darkness, is_open)
    share = _clean_share(claimed, is_open)
    plate = _plate(lit, bare, (total + ghost_shadows), tint, share)
    result = LitBackground(setting, plate, tint, total, _leaning(casts), owner)
    return result, ghost_shadows if gone else None


def _undivided(
    lit: F32,
    starts: Sequence[Silhouette],
    rounds: Sequence[bool],
    setting: ShadowSetting,
) -> LitBackground:
    """Return a background whose old shadows stay: moving objects throw shadows of their own beside them."""
    nothing = (0, 0, 0, 0), np.zeros((0, 0), np.float32)
    casts = []
    for start, is_round in zip(starts, rounds, strict=True):
        step = shadow_grid_step(start)
        casts.append(CastShadow(start, step, None, nothing, None, is_round))
    darkness = np.zeros(lit.shape[:2], np.float32)
    no_owner = np.zeros(darkness.shape, np.int32)
    tint = np.ones(3, np.float32)
    return LitBackground(setting, lit, tint, darkness, casts, no_owner, lifted=False)


def _square(reach: int) -> U8:
    return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)


def _open_background(coverage: F32) -> Mask:
    """Return (H, W) where the background is reliable: not close to an object, nor in narrow gaps between objects."""
    gap = _square(SHADOW.gap)
    near = cv2.dilate((coverage > 0).astype(np.uint8), _square(SHADOW.ring))
    unknown = cv2.morphologyEx(near, cv2.MORPH_CLOSE, gap)
    reach = cv2.dilate((coverage >= 0.5).astype(np.uint8), gap)
    return np.asarray((unknown == 0) | (reach == 0), np.bool_)


def _matched_shadows(
    everybody: Sequence[Silhouette],
    steps: Sequence[int],
    setting: ShadowSetting,
    darkness: F32,
    is_open: Mask,
) -> tuple[ShadowSetting, list[tuple[PixelBox, F32] | None], F32]:
    """Predict the shadow of each object and their sum, as deep as the photo's shadows `darkness` (H, W)."""
    firsts, total = _predicted(everybody, steps, setting)
    (deep, fewest), (quantile, least) = SHADOW.compared, SHADOW.lacking
    compared = is_open & (total > deep)
    if np.count_nonzero(compared) <= fewest:
        return setting, firsts, total
    ratios = np.expm1(-darkness[compared]) / np.expm1(-total[compared])
    middle, high = np.quantile(ratios, (0.5, quantile))
    lacking = float(max(min(high, 1.0), middle, least))
    setting = replace(setting, lacking=lacking)
    return setting, *_predicted(everybody, steps, setting)


def _unexplained(darkness: F32, total: F32, is_open: Mask) -> F32:
    """Return (H, W) the photo's darkness beyond the predicted `total`, continued behind objects."""
    weight = is_open.astype(np.float32)
    difference = cv2.medianBlur(darkness - total, 5) * weight
    rest = _spread_into(difference, weight, SHADOW.smooth)
    rest = harmonic_fill(rest[..., None], ~is_open)[..., 0]
    # Nothing behind an object is brighter than without shadows.
    np.maximum(rest, np.where(is_open, rest, -total), out=rest)
    return rest


def _sum_of_shadows(casts: Sequence[CastShadow], shape: tuple[int, ...]) -> F32:
    """Return (H, W) the sum of whole shadows at t = 0."""
    total = np.zeros(shape, np.float32)
    for cast in casts:
        if cast.whole is not None:
            _add(total, *cast.whole)
    return total


def _clean_share(claimed: F32, is_open: Mask) -> F32:
    """Return (H, W) 0..1: the share of the clean picture in the plate."""
    least, most = SHADOW.claimed
    share = np.clip((claimed - least) / (most - least), 0, 1)
    return np.asarray(np.where(is_open, share, np.float32(1)), np.float32)


def _plate(lit: F32, bare: F32, total: F32, tint: F32, share: F32) -> F32:
    """Return (H, W, 3) the background without the shadows `total`, mixed with the clean picture by `share`."""
    plate = np.empty_like(lit)
    for channel in range(3):
        unshaded = _log(lit[..., channel]) + total * tint[channel]
        difference = _log(bare[..., channel]) - unshaded
        plate[..., channel] = cv2.exp(unshaded + share * difference)
    return plate


def _predicted(
    everybody: Sequence[Silhouette], steps: Sequence[int], setting: ShadowSetting
) -> tuple[list[tuple[PixelBox, F32] | None], F32]:
    """Return the shadow of each object, and (H, W) their sum."""
    shadows = []
    total = np.zeros(setting.size[::-1], np.float32)
    for silhouette, step in zip(everybody, steps, strict=True):
        shadow = predicted_shadow(silhouette, setting, step)
        shadows.append(shadow)
        if shadow is not None:
            _add(total, *shadow)
    return shadows, total


def _log(light: F32) -> F32:
    return np.asarray(cv2.log(light + np.float32(1e-4)), np.float32)


def _cast(
    start: Silhouette,
    step: int,
    first: tuple[PixelBox, F32] | None,
    own: tuple[PixelBox, F32],
    is_round: bool,
    setting: ShadowSetting,
) -> CastShadow:
    """Return an object's shadow at t = 0: the prediction of geometry, and what the photo shows beyond."""
    own = _trimmed(*own)
    slides = setting.top and is_round and first is not None
    geometry = unbounded_shadow(start, setting, step) if slides else first
    parts = [own] if geometry is None else [geometry, own]
    (x, y, *_), everything = _trimmed(*joined_pictures(parts))
    box, visible = shifted_picture(everything, (x, y), (0.0, 0.0), setting.size)
    whole = None if box is None else (box, visible)
    # An object far outside of the photo has no visible shadow that could slide.
    sliding = ((x, y), everything) if slides and everything.size else None
    beyond = _share_beyond_floor(start, own, setting)
    return CastShadow(start, step, whole, own, sliding, is_round, beyond)


def _share_beyond_floor(
    start: Silhouette, own: tuple[PixelBox, F32], setting: ShadowSetting
) -> F32 | None:
    """Return (h, w) the share of an object's own shadow that lies beyond its floor's ends.

    None if none does, or if a wall behind ends the floor.
    """
    box, picture = own
    if start.floor is None or np.isfinite(setting.backdrop) or not picture.size:
        return None
    beyond = 1 - floor_share(start.ends, setting, box, start.floor)
    return beyond if beyond.any() else None


def _leaning(casts: list[CastShadow]) -> list[CastShadow]:
    """Return the casts with the lean of sliding shadows: how their offsets from their objects change with place."""
    places, offsets, masses = [], [], []
    for cast in casts:
        if cast.sliding is None:
            continue
        corner, picture = cast.sliding
        moments = cv2.moments(np.maximum(picture, 0))
        mass = moments["m00"]
        if mass <= 0:
            continue
        middle = np.array([moments["m10"], moments["m01"]]) / mass + corner
        places.append(cast.start.center)
        offsets.append((middle - cast.start.center) / cast.start.thick)
        masses.append(mass)
    if len(masses) < SHADOW.shadows:
        return casts
    place = np.array(places) - np.average(places, axis=0, weights=masses)
    offset = np.array(offsets) - np.average(offsets, axis=0, weights=masses)
    weight = np.array(masses)[:, None]
    spread = float((weight * place**2).sum())
    slope = float((weight * place * offset).sum()) / max(spread, 1e-9)
    variance = max(float((weight * offset**2).sum()), 1e-9)
    if slope <= 0 or slope**2 * spread / variance < SHADOW.explained:
        return casts
    leaning = []
    for cast in casts:
        lean = min(SHADOW.lamp * slope * cast.start.thick, SHADOW.leans)
        leaning.append(replace(cast, lean=lean))
    return leaning


def unbounded_shadow(
    silhouette: Silhouette, setting: ShadowSetting, step: int
) -> tuple[PixelBox, F32]:
    """Return box and picture of an object's whole shadow on a table, as if the photo had no border."""
    reach = 10 * max(silhouette.coverage.shape) + 64
    margin = step * ceil(reach / step)
    (x, y), (cx, cy) = silhouette.corner, silhouette.center
    width, height = setting.size
    moved = replace(
        silhouette,
        corner=(x + margin, y + margin),
        center=(cx + margin, cy + margin),
    )
    large = replace(setting, size=(width + 2 * margin, height + 2 * margin))
    shadow = predicted_shadow(moved, large, step)
    if shadow is None:
        return (x, y, x + 1, y + 1), np.zeros((1, 1), np.float32)
    (x0, y0, x1, y1), darkness = shadow
    return (x0 - margin, y0 - margin, x1 - margin, y1 - margin), darkness


def _trimmed(box: PixelBox, picture: F32) -> tuple[PixelBox, F32]:
    """Return the visible part of a picture, fading to nothing at its border."""
    visible = np.abs(picture) > SHADOW.faint
    rows = np.flatnonzero(visible.any(axis=1))
    columns = np.flatnonzero(visible.any(axis=0))
    if not len(rows):
        return (box[0], box[1], box[0], box[1]), picture[:0, :0]
    y0, y1 = int(rows[0]), int(rows[-1]) + 1
    x0, x1 = int(columns[0]), int(columns[-1]) + 1
    part = picture[y0:y1, x0:x1]
    size = np.maximum(np.abs(part) - np.float32(SHADOW.faint), 0)
    part_box = (box[0] + x0, box[1] + y0, box[0] + x1, box[1] + y1)
    return part_box, np.asarray(np.sign(part) * size, np.float32)


def shadow_grid_step(silhouette: Silhouette) -> int:
    """Return px a side of the grid for an object's shadow: some 24 cells across the object, at most."""
    height, width = silhouette.coverage.shape
    return max(1, min(int(np.sqrt(height * width)) // SHADOW.cells, 8))


def _spread_into(values: F32, weight: F32, sigma: float) -> F32:
    """Blur known values, which die away in unknown pixels."""
    norm = blurred(weight, sigma)
    mean = blurred(values, sigma) / np.maximum(norm, 0.02)
    return np.asarray(mean * np.clip(norm * 4, 0, 1), np.float32)


def _tint(lit: F32, bare: F32, darkness: F32, is_open: Mask) -> F32:
    """Fit (3,) each channel's darkening to that of the luminance by least squares."""
    in_shadow = is_open & (darkness > 0.3)
    lit, bare, darkness = lit[in_shadow], bare[in_shadow], darkness[in_shadow][:, None]
    measurable = (lit.min(axis=1) > 2e-3) & (bare.min(axis=1) > 2e-3)
    if np.count_nonzero(measurable) < 200:
        return np.ones(3, np.float32)
    darkness = darkness[measurable]
    channels = np.log(bare[measurable] / lit[measurable])
    slope = (channels * darkness).sum(axis=0) / (darkness * darkness).sum()
    return np.asarray(np.clip(slope, 0.85, 1.15), np.float32)


def _claims(
    starts: Sequence[Silhouette],
    firsts: Sequence[tuple[PixelBox, F32] | None],
    size: tuple[int, int],
) -> list[tuple[PixelBox, F32]]:
    """Return how likely each object changes the picture around it: by its predicted shadow, and by its distance."""
    claims: list[tuple[PixelBox, F32]] = []
    for start, shadow in zip(starts, firsts, strict=True):
        reach = SHADOW.near * min(start.coverage.shape) + 4
        box = _claim_box(start, shadow, ceil(2 * reach), size)
        x0, y0, x1, y1 = box
        if x1 <= x0 or y1 <= y0:
            claims.append(((0, 0, 0, 0), np.zeros((0, 0), np.float32)))
            continue
        outside = (moved_silhouette(start, box, 0, 0, 0) <= 0.5).astype(np.uint8)
        distance = cv2.distanceTransform(outside, cv2.DIST_L2, 3)
        # OpenCV's distance is 1e19 if the object is out of the picture.
        distance = np.minimum(distance, FAR)
        claim = np.exp(-((distance / reach) ** 2)).astype(np.float32)
        if shadow is not None:
            (left, top, right, bottom), darkness = shadow
            cast = np.zeros_like(claim)
            cast[top - y0 : bottom - y0, left - x0 : right - x0] = darkness
            claim += 4 * cast + 4 * blurred(cast, 0.6 * reach)
        claims.append((box, claim))
    return claims


def _claim_box(
    start: Silhouette,
    shadow: tuple[PixelBox, F32] | None,
    margin: int,
    size: tuple[int, int],
) -> PixelBox:
    """Return the box of an object, its shadow and a margin around both, within the photo."""
    (x0, y0), (height, width) = start.corner, start.coverage.shape
    x1, y1 = x0 + width, y0 + height
    if shadow is not None:
        left, top, right, bottom = shadow[0]
        x0, y0, x1, y1 = min(x0, left), min(y0, top), max(x1, right), max(y1, bottom)
    return (
        max(x0 - margin, 0),
        max(y0 - margin, 0),
        min(x1 + margin, size[0]),
        min(y1 + margin, size[1]),
    )


def _claimed(
    claims: Sequence[tuple[PixelBox, F32]], shape: tuple[int, ...]
) -> tuple[F32, NDArray[np.int32]]:
    """Return (H, W) the sum of claims, and 1 + the index of the largest.

    0 where there are hardly any.
    """
    total, largest = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    owner = np.zeros(shape, np.int32)
    for number, ((x0, y0, x1, y1), claim) in enumerate(claims, 1):
        part = np.s_[y0:y1, x0:x1]
        total[part] += claim
        is_larger = claim > largest[part]
        largest[part][is_larger] = claim[is_larger]
        owner[part][is_larger] = number
    owner[total <= SHADOW.claimed[0]] = 0
    return total, owner


EDGE = 6
"""px over which an object's own shadow fades at the border of its box."""
BEYOND = 0.2
"""Share of the longer side over which that shadow fades beyond the photo's border."""


def _owned(
    rest: F32, claim: tuple[PixelBox, F32], claimed: F32
) -> tuple[PixelBox, F32]:
    """Return an object's part of the unexplained darkness: what it claims beyond all others together."""
    (x0, y0, x1, y1), own_claim = claim
    if not own_claim.size:
        return claim
    all_claims = claimed[y0:y1, x0:x1] + np.float32(SHADOW.claimed[0])
    share = own_claim / all_claims
    own = rest[y0:y1, x0:x1] * np.maximum(2 * share - 1, 0)
    # The shadow fades at the box's border, so that it may move unseen; beyond the photo's border it goes on.
    height, width = rest.shape
    beyond = max(round(BEYOND * max(height, width)), EDGE)
    above, below = beyond * (y0 <= 0), beyond * (y1 >= height)
    left, right = beyond * (x0 <= 0), beyond * (x1 >= width)
    own = np.pad(own, ((above, below), (left, right)), "edge")
    rows = _faded_ends(own.shape[0], above, below)
    columns = _faded_ends(own.shape[1], left, right)
    box = x0 - left, y0 - above, x1 + right, y1 + below
    return box, np.asarray(own * np.outer(rows, columns), np.float32)


def _faded_ends(count: int, before: int, after: int) -> F32:
    """Return (count,) 1, with ramps from 0 over `before` and `after` at its ends.

    Each ramp is `EDGE` long at least.
    """
    places = np.arange(count, dtype=np.float32)
    rise = np.minimum(places / max(before, EDGE), 1)
    fall = np.minimum(places[::-1] / max(after, EDGE), 1)
    return np.minimum(rise, fall)


def _add(canvas: F32, box: PixelBox, values: F32) -> None:
    x0, y0, x1, y1 = box
    if values.size:
        canvas[y0:y1, x0:x1] += values
