"""Background separated into light and one shadow per object, and recomposed for new
poses.

Shadows are stored as negative logarithms of the remaining light, so that those of many
objects add up, and the sum at t = 0 is the photo's. The shadow predicted by geometry
belongs to its object. Further darkness of the photo belongs to the nearest object and
moves with it, as long as the object stands on the floor as in the photo. Around
shadows, the plate is the clean picture: the difference to the photo disappears as the
object leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64, Mask
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
from physgen.render.standing_shade import (
    BaseMotion,
    StandingShade,
    measure_base_motion,
)


@dataclass(frozen=True)
class ShadowTuning:
    """Thresholds of the separation of shadows from the background."""

    lift: float = 0.25
    """Height over the floor, in sizes of an object, over which its shadow in the photo
    fades.
    """
    comes: float = 0.5
    """Displacement, in sizes, over which a predicted shadow appears if the old one
    remains.
    """
    parts: float = 0.1
    """Displacement, in sizes, over which the predicted shadow replaces the photo's."""
    full_share: float = 0.995
    """Share of the photo's shadow above which the predicted one is left out."""
    flies: float = 2.0
    """Height over the floor, in thicknesses, above which the shadow falls on the wall,
    if any.
    """
    turn: float = 0.35
    """Rotation, rad, over which the photo's shadow of an object that is not round
    fades.
    """
    blur_width: float = 0.5
    """Standard deviation of the blur, px, after a median over 5 px: finer detail stays
    in the background.
    """
    ring: int = 2
    """Margin around objects, px, with traces of them in the background."""
    gap: int = 4
    """Half the width of gaps between objects, px, without visible background."""
    deepest: float = 3.5
    """Darkness (-log of light) of the deepest shadow."""
    claim_reach: float = 0.5
    """Largest distance of an object's own darkness, in its sizes."""
    claim_range: tuple[float, float] = (0.02, 0.1)
    """Sum of objects' claims from which the plate begins to be the clean picture, and
    at which it is.
    """
    lean_variance: float = 0.5
    """Share of the variance of shadows' offsets that a near lamp must explain."""
    shadows: int = 3
    """Minimum number of sliding shadows for a lamp: two are always on a line."""
    lamp: float = 1.5
    """Factor of the fitted lean (from billiards): geometry predicts a part of each
    offset without it.
    """
    leans: float = 0.3
    """Maximum lean, px per px of the object's displacement."""
    least_darkness: float = 0.006
    """Darkness (-log of light) that is invisible: half a grey level of a middle
    grey.
    """
    comparison_limits: tuple[float, int] = (0.2, 200)
    """Darkness from which predicted shadows are compared with the photo's, and the
    number of pixels for it.
    """
    lacking: tuple[float, float] = (0.65, 0.3)
    """Quantile of the photo's depth over the predicted depth, as some predictions miss;
    and its minimum. By tune.
    """
    cells: int = 24
    """Minimum number of grid cells across an object for its shadow."""


SHADOW = ShadowTuning()
FAR = 1e6
"""Distance beyond any picture, px."""


@dataclass(frozen=True)
class CastShadow:
    """One object's share of the photo's shadows; darkness is -log of the remaining
    light.
    """

    start: Silhouette
    step: int
    """Side of the grid cells for its shadow, px."""
    picture: tuple[PixelBox, F32] | None
    """The whole shadow at t = 0."""
    residual: tuple[PixelBox, F32]
    """Part of `picture` in the photo beyond geometry, of either sign."""
    sliding: tuple[tuple[int, int], F32] | None
    """Corner and picture of a shadow of constant shape, also beyond the photo's
    border.
    """
    is_round: bool
    """Whether rotation does not change the shadow."""
    share_beyond: F32 | None = None
    """Share (h, w) of `residual` beyond the ends of the object's floor at t = 0; None
    without any."""
    lean: float = 0.0
    """Additional displacement of a sliding shadow per px of its object: by a
    near lamp.
    """
    contact: StandingShade | None = None
    """Part of `picture` at the base of an object that may rock on its floor; None for
    other objects."""
    beyond_contact: tuple[PixelBox, F32] | None = None
    """Part of `moving_picture` beyond `contact`."""
    beyond_photo: tuple[PixelBox, F32] | None = None
    """The whole shadow at t = 0 with its part beyond the photo's border; None without
    such a part."""

    @property
    def moving_picture(self) -> tuple[PixelBox, F32] | None:
        """Return the whole shadow at t = 0, which may reach beyond the photo.

        A shadow that moves into the picture has no edge at the old border of the photo.
        """
        return self.beyond_photo or self.picture

    def base_motion(
        self, silhouette: Silhouette, start: Pose, pose: Pose
    ) -> BaseMotion | None:
        """Return the motion of the base of an object that may rock; None of others."""
        floor, start_floor = silhouette.floor, self.start.floor
        if self.contact is None or floor is None or start_floor is None:
            return None
        # The base stands on the floor: its shade follows the floor below the object as
        # the object moves on.
        climb = floor - start_floor
        return measure_base_motion(self.contact.points, start, pose, climb)


@dataclass(frozen=True)
class ContactShadow:
    """Shade at the base of an object that rocks."""

    box: tuple[slice, slice]
    """Rows and columns of the canvas."""
    factor: F32
    """Remaining share of light, (h, w, 3)."""
    share: float
    """Share of the object's shade that is drawn by the lift of its base."""


@dataclass(frozen=True)
class LitBackground:
    """A decomposed background."""

    setting: ShadowSetting
    plate: F32
    """Background in full light, (H, W, 3) linear; the clean picture around possible
    shadows.
    """
    tint: F32
    """Darkening of each channel relative to the average, (3,)."""
    total: F32
    """Darkness (-log of light) by all objects at t = 0, (H, W)."""
    casts: Sequence[CastShadow]
    owner: NDArray[np.int32]
    """1 + the index of the cast whose object most likely changes the pixel, (H, W); 0
    without one.
    """
    has_clean_plate: bool = True
    """Whether a backend has separated the photo's shadows from the background."""

    def photo_background(self) -> F32:
        """Return the background at t = 0, (H, W, 3) linear."""
        return shaded_background(self.plate, self.total, self.tint)

    def limit_darkness(self, darkness: F32, box: tuple[slice, slice]) -> F32:
        """Limit the sum `darkness` (h, w) of shadows, in place, between the photo's and
        one shade.

        Direct light that one shadow blocks cannot be blocked again by others.
        """
        cv2.max(darkness, self._least_darkness[box], dst=darkness)
        excess = darkness - self._largest_darkness[box]
        if excess.max() <= 0:
            return darkness
        # A soft limit: darkness - excess + 1 - exp(-excess) never exceeds the limit by
        # more than 1.
        soft_limit = darkness - excess
        soft_limit += 1
        soft_limit -= cv2.exp(-excess)
        np.copyto(soft_limit, darkness, where=excess <= 0)
        return np.asarray(soft_limit, np.float32)

    @cached_property
    def _least_darkness(self) -> F32:
        """Return the minimum darkness (H, W): not brighter than the photo or
        the plate.
        """
        return np.minimum(self.total, 0)

    @cached_property
    def _largest_darkness(self) -> F32:
        """Return the maximum darkness (H, W) by one object."""
        return np.maximum(self.total, self.setting.shade)

    def move_shadow(
        self, k: int, silhouette: Silhouette | None, start: Pose, pose: Pose
    ) -> list[tuple[PixelBox, F32]]:
        """Return the shadows of object k at `pose`, as boxes with their darkness.

        `start` is its pose in the photo, `silhouette` its present silhouette.
        """
        cast = self.casts[k]
        if cast.sliding is not None:
            return self._shift_constant_shadow(cast, cast.sliding, start, pose)
        if silhouette is None:
            return []
        if not self.has_clean_plate:
            return self._late_shadow(cast, silhouette, start, pose)
        shadows, share = self._rocking_shadow(cast, silhouette, start, pose)
        if share == 1:
            return shadows
        remaining_share = np.float32(1 - share)
        for box, picture in self._leaving_shadow(cast, silhouette, start, pose):
            if share > 0:
                picture = remaining_share * picture
            shadows.append((box, picture))
        return shadows

    def contact_shade(
        self, k: int, silhouette: Silhouette, start: Pose, pose: Pose
    ) -> ContactShadow | None:
        """Return the shade at the base of object k if the object rocks; else None."""
        cast = self.casts[k]
        motion = cast.base_motion(silhouette, start, pose)
        if cast.contact is None or motion is None:
            return None
        share = motion.rocking_share(cast.contact.side)
        if share <= LEAST_STRENGTH:
            return None
        shade = cast.contact.draw(motion, self.setting.size, silhouette.ends)
        if shade is None:
            return None
        (x0, y0, x1, y1), factor = shade
        if share < 1:
            factor = np.power(factor, np.float32(share))
        return ContactShadow(np.s_[y0:y1, x0:x1], factor, share)

    def _rocking_shadow(
        self, cast: CastShadow, silhouette: Silhouette, start: Pose, pose: Pose
    ) -> tuple[list[tuple[PixelBox, F32]], float]:
        """Return the photo's shade of an object that rocks, times its share, without
        that at its base, and the share.
        """
        motion = cast.base_motion(silhouette, start, pose)
        if cast.contact is None or motion is None:
            return [], 0.0
        share = motion.rocking_share(cast.contact.side)
        if share <= LEAST_STRENGTH:
            return [], 0.0
        if cast.beyond_contact is None:
            return [], share
        # The shade beyond the contact does not depend on the lift of the base, and only
        # moves along.
        (x0, y0, _, _), picture = cast.beyond_contact
        size = self.setting.size
        box, moved_picture = shifted_picture(picture, (x0, y0), motion.shift, size)
        if box is None:
            return [], share
        moved_picture *= self._floor_shares(cast, silhouette, box, motion.shift)
        return [(box, moved_picture * np.float32(share))], share

    def _floor_shares(
        self,
        cast: CastShadow,
        silhouette: Silhouette,
        box: PixelBox,
        shift: tuple[float, float],
    ) -> F32:
        """Return the share (h, w) of a box that gets the shade of an object.

        Light behind the floor has no shade, apart from shade that is beyond the floor
        in the photo.
        """
        if cast.start.floor is None or np.isfinite(self.setting.backdrop):
            return np.ones((box[3] - box[1], box[2] - box[0]), np.float32)
        # The far end of the floor moves with the object in the picture: a shade keeps
        # its distance to its object.
        floor = cast.start.floor + shift[1]
        shares = floor_share(silhouette.ends, self.setting, box, floor)
        near_share = _near_share(self.setting, box, floor)
        if self.setting.light.is_soft:
            shares *= near_share
        if cast.share_beyond is not None:
            (x0, y0, _, _), _ = cast.residual
            beyond_box, shares_beyond = shifted_picture(
                cast.share_beyond, (x0, y0), shift, self.setting.size
            )
            if beyond_box is not None:
                _raise_to(shares, box, shares_beyond, beyond_box)
        if not self.setting.light.is_soft:
            shares *= near_share
        return shares

    def _leaving_shadow(
        self, cast: CastShadow, silhouette: Silhouette, start: Pose, pose: Pose
    ) -> list[tuple[PixelBox, F32]]:
        """Return the shadow of an object that leaves its place in the photo."""
        turn = pose.angle - start.angle
        # Near its start, an object keeps the photo's shadow; farther away, it gets the
        # predicted one, together with the unexplained part of the photo's.
        strength, shift = self._valid_residual(cast, silhouette, turn)
        share = np.float32(0)
        moving_picture = cast.moving_picture
        if moving_picture is not None:
            share = _photo_share(cast, start, pose)
        shadows = []
        if share > 0 and moving_picture is not None:
            (x0, y0, _, _), picture = moving_picture
            box, moved_picture = shifted_picture(
                picture, (x0, y0), shift, self.setting.size
            )
            if box is not None:
                shadows.append(
                    (box, moved_picture if share == 1 else share * moved_picture)
                )
        if share == 1:
            return shadows
        # The shares of the photo's shadow and of the predicted one add up to 1 at any
        # time, so that the shadow neither fades nor doubles on the way.
        rest = np.float32(1 - share)
        prediction = predicted_shadow(silhouette, self.setting, cast.step)
        if prediction is not None:
            box, picture = prediction
            shadows.append((box, picture if share == 0 else rest * picture))
        own = self._carried_shadow(cast, silhouette, float(rest) * strength, shift)
        if own is not None:
            shadows.append(own)
        return shadows

    def _late_shadow(
        self, cast: CastShadow, silhouette: Silhouette, start: Pose, pose: Pose
    ) -> list[tuple[PixelBox, F32]]:
        """Return the predicted shadow, which appears as the object leaves the photo's
        shadow.
        """
        prediction = predicted_shadow(silhouette, self.setting, cast.step)
        if prediction is None:
            return []
        box, picture = prediction
        return [(box, picture * _departure(silhouette, start, pose))]

    def _shift_constant_shadow(
        self,
        cast: CastShadow,
        sliding: tuple[tuple[int, int], F32],
        start: Pose,
        pose: Pose,
    ) -> list[tuple[PixelBox, F32]]:
        """Return a shadow of constant shape at its present place."""
        corner, picture = sliding
        # Seen from above, a round object has the same shadow everywhere. Under a near
        # lamp the shadow moves faster than its object, away from the lamp.
        factor = 1 + cast.lean
        shift = factor * (pose.x - start.x), factor * (pose.y - start.y)
        box, moved_picture = shifted_picture(picture, corner, shift, self.setting.size)
        return [] if box is None else [(box, moved_picture)]

    def _carried_shadow(
        self,
        cast: CastShadow,
        silhouette: Silhouette,
        strength: float,
        shift: tuple[float, float],
    ) -> tuple[PixelBox, F32] | None:
        """Return the unexplained part of the photo's shadow, which moves with its
        object.
        """
        if strength <= LEAST_STRENGTH:
            return None
        (x0, y0, _, _), own_picture = cast.residual
        size = self.setting.size
        box, moved_picture = shifted_picture(own_picture, (x0, y0), shift, size)
        if box is None:
            return None
        moved_picture *= np.float32(strength)
        if silhouette.floor is not None and self._on_wall(cast.start):
            # A shadow on a wall ends at the foot of the wall; the ramp of a pixel keeps
            # this end smooth.
            wall_foot = silhouette.floor - self.setting.tilt * self.setting.backdrop
            rows = np.arange(box[1], box[3], dtype=np.float32)[:, None]
            moved_picture *= np.clip(wall_foot - rows + 0.5, 0, 1)
        elif silhouette.floor is not None and not np.isfinite(self.setting.backdrop):
            floor_shares = floor_share(
                silhouette.ends, self.setting, box, silhouette.floor
            )
            # Upright surfaces behind the floor get no shadow of a moving object.
            near_share = _near_share(self.setting, box, silhouette.floor)
            if self.setting.light.is_soft:
                floor_shares *= near_share
            if cast.share_beyond is not None:
                # A shadow of the photo beyond the floor is on another ground.
                _, shares_beyond = shifted_picture(
                    cast.share_beyond, (x0, y0), shift, size
                )
                np.maximum(floor_shares, shares_beyond, out=floor_shares)
            moved_picture *= floor_shares
            if not self.setting.light.is_soft:
                moved_picture *= near_share
        return box, moved_picture

    def _on_wall(self, start: Silhouette) -> bool:
        """Check whether an object's shadow is mostly on the wall: the object flies in
        front of it.
        """
        if not np.isfinite(self.setting.backdrop):
            return False
        if start.floor is None:
            return True
        return start.floor - start.center[1] > SHADOW.flies * start.thickness

    def _valid_residual(
        self, cast: CastShadow, silhouette: Silhouette, turn: float
    ) -> tuple[float, tuple[float, float]]:
        """Return the valid share of the photo's own shadow, and its shift, px."""
        start = cast.start
        dx, dy = (
            silhouette.center[0] - start.center[0],
            silhouette.center[1] - start.center[1],
        )
        size = max(min(start.coverage.shape), 1)
        # The residual contains the shape of the shadow in the photo, which is wrong for
        # an object in another orientation.
        strength = 1.0 if cast.is_round else _bell(turn / SHADOW.turn)
        # From above or on a wall, the shadow follows the object in both directions.
        if self.setting.top or self._on_wall(start):
            return strength, (dx, dy)
        if start.floor is None or silhouette.floor is None:
            # Without a floor there is no place for the shadow to move to: it stays, and
            # fades with the distance.
            distance = np.hypot(dx, dy)
            return strength * _bell(distance / (SHADOW.lift * size)), (0.0, 0.0)
        # A shadow on the floor stays valid while its object keeps its height over it.
        lift = (start.floor - start.center[1]) - (
            silhouette.floor - silhouette.center[1]
        )
        strength *= _bell(lift / (SHADOW.lift * size))
        return strength, (dx, silhouette.floor - start.floor)


LEAST_STRENGTH = 0.02
"""Largest invisible share of the photo's own shadow, left out."""


def _bell(distance: float) -> float:
    """Return exp(-distance²)."""
    return float(np.exp(-(distance**2)))


def _photo_share(cast: CastShadow, start: Pose, pose: Pose) -> np.float32:
    """Return 1 for an object at its start, and 0 after it has left the photo's
    shadow.
    """
    # A rotation moves the ends of an object by the angle times half its length.
    shape = cast.start.coverage.shape
    distance = np.hypot(pose.x - start.x, pose.y - start.y)
    if not cast.is_round:
        distance += abs(pose.angle - start.angle) * max(shape) / 2
    # A share next to 1 counts as 1, and one next to 0 as 0: both save the other
    # shadow's computation.
    share = _bell(distance / (SHADOW.parts * max(min(shape), 1)))
    if share >= SHADOW.full_share:
        return np.float32(1)
    return np.float32(share if share > LEAST_STRENGTH else 0)


def _raise_to(values: F32, box: PixelBox, limits: F32, limit_box: PixelBox) -> None:
    """Raise values (h, w) in a box to at least those of another box, in place."""
    x0, y0 = max(box[0], limit_box[0]), max(box[1], limit_box[1])
    x1, y1 = min(box[2], limit_box[2]), min(box[3], limit_box[3])
    if x0 >= x1 or y0 >= y1:
        return
    part = values[y0 - box[1] : y1 - box[1], x0 - box[0] : x1 - box[0]]
    x0, x1 = x0 - limit_box[0], x1 - limit_box[0]
    y0, y1 = y0 - limit_box[1], y1 - limit_box[1]
    np.maximum(part, limits[y0:y1, x0:x1], out=part)


def _departure(silhouette: Silhouette, start: Pose, pose: Pose) -> np.float32:
    """Return 0 for an object at its start, and 1 after it has left."""
    # 1 - exp(-d²) begins without a slope: no step is visible when the object starts.
    distance = np.hypot(pose.x - start.x, pose.y - start.y)
    size = max(min(silhouette.coverage.shape), 1)
    departure = distance / (SHADOW.comes * size)
    return np.float32(1 - np.exp(-(departure**2)))


QUICK_STEPS = (2, 3)
"""Grid steps, px, at which a ball's shadow is computed in full, since it is fast and a
floor has few rows.
"""


def predicted_shadow(
    silhouette: Silhouette, setting: ShadowSetting, step: int
) -> tuple[PixelBox, F32] | None:
    """Compute `shadow_darkness` on a grid of `step` px, as shadows of large objects are
    soft.
    """
    if silhouette.radius is not None and step in QUICK_STEPS:
        shadow = shadow_darkness(silhouette, setting)
        # Blur as much as the grid would, so that the shadow's edge has no steps.
        return shadow and (shadow[0], blurred(shadow[1], 0.4 * step))
    if step == 1:
        return shadow_darkness(silhouette, setting)
    # The penumbra of a large object is wide. A coarse grid contains all of its detail,
    # and the time falls with the square of the step.
    coarse_figure = _coarse_silhouette(silhouette, step)
    shadow = shadow_darkness(coarse_figure, _downscale_setting(setting, step))
    if shadow is None:
        return None
    (x0, y0, x1, y1), darkness = shadow
    size = ((x1 - x0) * step, (y1 - y0) * step)
    full_picture = cv2.resize(darkness, size, interpolation=cv2.INTER_LINEAR)
    width, height = setting.size
    x0, y0 = x0 * step, y0 * step
    x1, y1 = min(x1 * step, width), min(y1 * step, height)
    return (x0, y0, x1, y1), np.asarray(full_picture[: y1 - y0, : x1 - x0], np.float32)


def _coarse_silhouette(silhouette: Silhouette, step: int) -> Silhouette:
    """Return a silhouette on a grid of `step` px, with cells aligned to the photo's
    corner.
    """

    def scale(place: float) -> float:
        return (place + 0.5) / step - 0.5

    (x, y), (height, width) = silhouette.corner, silhouette.coverage.shape
    # Pad the silhouette to whole cells, so that all silhouettes share one coarse grid.
    left, top = x % step, y % step
    padded_cover = cv2.copyMakeBorder(
        silhouette.coverage,
        top,
        -(top + height) % step,
        left,
        -(left + width) % step,
        cv2.BORDER_CONSTANT,
    )
    # The mean over a cell keeps the area of thin parts; `scale` moves between centres
    # of pixels and of cells.
    cells = (padded_cover.shape[1] // step, padded_cover.shape[0] // step)
    coarse_cover = cv2.resize(padded_cover, cells, interpolation=cv2.INTER_AREA)
    (cx, cy), (first, last) = silhouette.center, silhouette.ends
    radius, floor = silhouette.radius, silhouette.floor
    return Silhouette(
        np.asarray(coarse_cover, np.float32),
        corner=((x - left) // step, (y - top) // step),
        center=(scale(cx), scale(cy)),
        radius=None if radius is None else radius / step,
        thickness=silhouette.thickness / step,
        floor=None if floor is None else scale(floor),
        ends=(scale(first), scale(last)),
        walls=silhouette.walls,
    )


@lru_cache(maxsize=64)
def _downscale_setting(setting: ShadowSetting, step: int) -> ShadowSetting:
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
    """Shift a picture by a fraction of pixels, and crop it to the photo."""
    height, width = picture.shape[:2]
    x, y = corner[0] + shift[0], corner[1] + shift[1]
    # A shift by a fraction of a pixel covers one more column and row.
    first_column, first_row = int(np.floor(x)), int(np.floor(y))
    left, top = max(first_column, 0), max(first_row, 0)
    right = min(first_column + width + 1, size[0])
    bottom = min(first_row + height + 1, size[1])
    if not picture.size or right <= left or bottom <= top:
        return None, picture
    matrix = np.array([[1.0, 0, x - left], [0, 1, y - top]])
    box_size = (right - left, bottom - top)
    result = cv2.warpAffine(picture, matrix, box_size, borderMode=cv2.BORDER_CONSTANT)
    return (left, top, right, bottom), np.asarray(result, np.float32)


def decompose_shadows(
    background: U8,
    clean_background: U8 | None,
    coverage: F32,
    starts: Sequence[Silhouette],
    rounds: Sequence[bool],
    setting: ShadowSetting,
    ghosts: Sequence[Silhouette] = (),
    is_changed: Mask | None = None,
) -> tuple[LitBackground, F32 | None]:
    """Separate `background` (H, W, 3) sRGB into light and shadows.

    `clean_background` is the background without shadows; None if they were not removed.
    `ghosts` are objects of the photo that the scene leaves out, with their shadows.
    `is_changed` (H, W): pixels that differ from the photo, and contain no information
    about shadows near objects. Also returns the darkness (H, W), -log of light, by the
    shadows of `ghosts`; None without such objects.
    """
    if clean_background is None:
        light = decode(background)
        return _keep_old_shadows(light, starts, rounds, setting), None
    # The background is visible only beside objects: all measurements use these pixels,
    # and are continued behind objects.
    open_mask = _open_background(coverage)
    if is_changed is not None:
        open_mask &= ~is_changed
    photo = _ShadowPhoto.measure(background, clean_background, open_mask)
    shape = photo.darkness.shape
    # Absent objects also claim darkness, which would otherwise go to their neighbours
    # and move with them.
    division = _divide_darkness(photo, [*starts, *ghosts], rounds, setting)
    casts = division.casts[: len(starts)]
    ghost_casts = division.casts[len(starts) :]
    total = _sum_of_shadows(casts, shape)
    ghost_shadows = _sum_of_shadows(ghost_casts, shape)
    # The plate is also without the shadows of ghosts, which return as darkness.
    plate, tint = photo.plate(total + ghost_shadows, division.claimed_area)
    result = LitBackground(
        division.setting, plate, tint, total, _leaning(casts), division.owner
    )
    return result, ghost_shadows if ghosts else None


@dataclass(frozen=True)
class _Division:
    """The darkness of a photo, divided among objects."""

    setting: ShadowSetting
    """With the depth of the photo's shadows."""
    casts: list[CastShadow]
    claimed_area: F32
    """(H, W): sum of the objects' claims."""
    owner: NDArray[np.int32]
    """(H, W): 1 + the index of the object with the largest claim; 0 without one."""


def _divide_darkness(
    photo: _ShadowPhoto,
    figures: Sequence[Silhouette],
    rounds: Sequence[bool],
    setting: ShadowSetting,
) -> _Division:
    """Return the shadows of all objects; objects beyond `rounds` do not roll."""
    steps = list(map(shadow_grid_step, figures))
    # Geometry predicts the shape of shadows; the photo tells their depth.
    setting, firsts, total = _matched_shadows(
        figures, steps, setting, photo.darkness, photo.is_open
    )
    difference = _compare_darkness(photo.darkness, total, photo.is_open)
    # Assign the unexplained darkness to the objects with the largest claims.
    claims = _claims(figures, firsts, setting.size)
    claimed_area, owner = _sum_claims(claims, photo.darkness.shape)
    casts = []
    for k, start in enumerate(figures):
        own_shadow = _claimed_darkness(difference, claims[k], claimed_area, firsts[k])
        is_round = k < len(rounds) and rounds[k]
        casts.append(_cast(start, steps[k], firsts[k], own_shadow, is_round, setting))
    return _Division(setting, casts, claimed_area, owner)


@dataclass(frozen=True)
class _ShadowPhoto:
    """A background with shadows and the same background without them."""

    light: F32
    """(H, W, 3) linear."""
    clean_light: F32
    """(H, W, 3) linear, without shadows."""
    darkness: F32
    """(H, W): -log of the share of light in shadows."""
    is_open: Mask
    """(H, W): pixels with reliable darkness."""

    @staticmethod
    def measure(background: U8, clean_background: U8, open_mask: Mask) -> _ShadowPhoto:
        """Measure the darkness of shadows between two backgrounds (H, W, 3) sRGB.

        `open_mask` (H, W): pixels with reliable darkness.
        """
        light = decode(background)
        clean_light = decode(clean_background)
        darkness = _log(luminance(clean_light)) - _log(luminance(light))
        np.clip(darkness, -0.5, SHADOW.deepest, out=darkness)
        return _ShadowPhoto(light, clean_light, darkness, open_mask)

    def plate(self, shadows: F32, claimed_area: F32) -> tuple[F32, F32]:
        """Return the background without `shadows` (H, W), and their tint (3,)."""
        tint = _tint(self.light, self.clean_light, self.darkness, self.is_open)
        share = _clean_share(claimed_area, self.is_open)
        plate = _plate(self.light, self.clean_light, shadows, tint, share)
        return plate, tint


def _keep_old_shadows(
    light: F32,
    starts: Sequence[Silhouette],
    rounds: Sequence[bool],
    setting: ShadowSetting,
) -> LitBackground:
    """Return a background with its old shadows; moving objects get additional
    shadows.
    """
    empty_shadow = (0, 0, 0, 0), np.zeros((0, 0), np.float32)
    casts = []
    for start, is_round in zip(starts, rounds, strict=True):
        step = shadow_grid_step(start)
        casts.append(CastShadow(start, step, None, empty_shadow, None, is_round))
    darkness = np.zeros(light.shape[:2], np.float32)
    no_owner = np.zeros(darkness.shape, np.int32)
    tint = np.ones(3, np.float32)
    return LitBackground(
        setting, light, tint, darkness, casts, no_owner, has_clean_plate=False
    )


def _square(reach: int) -> U8:
    """Return a square kernel of ones with this half width."""
    return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)


def _open_background(coverage: F32) -> Mask:
    """Return the mask (H, W) of reliable background.

    Pixels near objects and in narrow gaps between objects are unreliable.
    """
    gap = _square(SHADOW.gap)
    near_objects = cv2.dilate((coverage > 0).astype(np.uint8), _square(SHADOW.ring))
    closed_gaps = cv2.morphologyEx(near_objects, cv2.MORPH_CLOSE, gap)
    around_objects = cv2.dilate((coverage >= 0.5).astype(np.uint8), gap)
    return np.asarray((closed_gaps == 0) | (around_objects == 0), np.bool_)


def _matched_shadows(
    silhouettes: Sequence[Silhouette],
    steps: Sequence[int],
    setting: ShadowSetting,
    darkness: F32,
    is_open: Mask,
) -> tuple[ShadowSetting, list[tuple[PixelBox, F32] | None], F32]:
    """Predict the shadows of all objects, and scale them to the depth of the photo's.

    `darkness` (H, W) of the photo. Also returns the sum of shadows.
    """
    firsts, total = _predict_shadows(silhouettes, steps, setting)
    (least_darkness, least_count), (quantile, least_ratio) = (
        SHADOW.comparison_limits,
        SHADOW.lacking,
    )
    is_compared = is_open & (total > least_darkness)
    if np.count_nonzero(is_compared) <= least_count:
        return setting, firsts, total
    # Compare shares of light taken away: expm1 converts darkness to them.
    ratios = np.expm1(-darkness[is_compared]) / np.expm1(-total[is_compared])
    # Some predictions miss the shadow in the photo and lower the ratios. The upper
    # quantile is the depth in the parts that the geometry hits; the limits exclude a
    # shadow deeper than predicted, and nearly none at all.
    median_ratio, upper_ratio = np.quantile(ratios, (0.5, quantile))
    depth_ratio = float(max(min(upper_ratio, 1.0), median_ratio, least_ratio))
    # Depth changes all shadows alike, so that a second prediction suffices.
    setting = replace(setting, lacking=depth_ratio)
    return setting, *_predict_shadows(silhouettes, steps, setting)


def _compute_excess_darkness(darkness: F32, total: F32, is_open: Mask) -> F32:
    """Return the photo's darkness (H, W) beyond the predicted `total`, continued behind
    objects.
    """
    # The median removes texture that the clean picture misses, and the blur is a
    # normalised convolution that ignores hidden pixels.
    weight = is_open.astype(np.float32)
    difference = cv2.medianBlur(darkness - total, 5) * weight
    remainder = _spread_into(difference, weight, SHADOW.blur_width)
    remainder = harmonic_fill(remainder[..., None], ~is_open)[..., 0]
    # Behind an object, the background is not brighter than without shadows.
    np.maximum(remainder, np.where(is_open, remainder, -total), out=remainder)
    return remainder


def _sum_of_shadows(casts: Sequence[CastShadow], shape: tuple[int, ...]) -> F32:
    """Return the sum (H, W) of whole shadows at t = 0."""
    total = np.zeros(shape, np.float32)
    for cast in casts:
        if cast.picture is not None:
            _add(total, *cast.picture)
    return total


def _clean_share(claim_sum: F32, is_open: Mask) -> F32:
    """Return the share (H, W) of the clean picture in the plate, 0..1."""
    # Far from all objects the plate is the photo itself: only claimed pixels change to
    # the clean picture, along a ramp.
    lower, upper = SHADOW.claim_range
    share = np.clip((claim_sum - lower) / (upper - lower), 0, 1)
    return np.asarray(np.where(is_open, share, np.float32(1)), np.float32)


def _plate(light: F32, clean_light: F32, total: F32, tint: F32, share: F32) -> F32:
    """Return the background (H, W, 3) without the shadows `total`.

    It is mixed with the clean picture by `share`.
    """
    plate = np.empty_like(light)
    for channel in range(3):
        # Add the darkness of shadows in the logarithm, that is divide by their
        # remaining light; `tint` is the relative darkness of each channel.
        log_light = _log(light[..., channel]) + total * tint[channel]
        difference = _log(clean_light[..., channel]) - log_light
        plate[..., channel] = cv2.exp(log_light + share * difference)
    return plate


def _predict_shadows(
    silhouettes: Sequence[Silhouette], steps: Sequence[int], setting: ShadowSetting
) -> tuple[list[tuple[PixelBox, F32] | None], F32]:
    """Return the shadow of each object, and their sum (H, W)."""
    shadows = []
    total = np.zeros(setting.size[::-1], np.float32)
    for silhouette, step in zip(silhouettes, steps, strict=True):
        shadow = predicted_shadow(silhouette, setting, step)
        shadows.append(shadow)
        if shadow is not None:
            _add(total, *shadow)
    return shadows, total


def _log(light: F32) -> F32:
    """Return the logarithm of light, finite for black."""
    return np.asarray(cv2.log(light + np.float32(1e-4)), np.float32)


def _cast(
    start: Silhouette,
    step: int,
    first: tuple[PixelBox, F32] | None,
    residual: tuple[PixelBox, F32],
    is_round: bool,
    setting: ShadowSetting,
) -> CastShadow:
    """Return an object's shadow at t = 0: the prediction, and the photo's part beyond
    it.
    """
    # The photo's border cuts shadows. A shadow that will slide needs its whole shape,
    # which geometry provides.
    residual = crop_to_visible(*residual)
    is_sliding = setting.top and is_round and first is not None
    geometry = unbounded_shadow(start, setting, step) if is_sliding else first
    parts = [residual] if geometry is None else [geometry, residual]
    whole_box, whole_picture = crop_to_visible(*joined_pictures(parts))
    x, y = whole_box[:2]
    box, visible = shifted_picture(whole_picture, (x, y), (0.0, 0.0), setting.size)
    visible_shadow = None if box is None else (box, visible)
    # An object far outside the photo has no visible shadow.
    sliding = ((x, y), whole_picture) if is_sliding and whole_picture.size else None
    share_beyond = _share_beyond_floor(start, residual, setting)
    beyond_photo = None
    if visible_shadow is not None and visible.shape != whole_picture.shape:
        beyond_photo = whole_box, whole_picture
    return CastShadow(
        start,
        step,
        visible_shadow,
        residual,
        sliding,
        is_round,
        share_beyond,
        beyond_photo=beyond_photo,
    )


def _share_beyond_floor(
    start: Silhouette, residual: tuple[PixelBox, F32], setting: ShadowSetting
) -> F32 | None:
    """Return the share (h, w) of an object's own shadow beyond its floor's ends.

    None without such a part, or if a wall behind ends the floor.
    """
    box, picture = residual
    if start.floor is None or np.isfinite(setting.backdrop) or not picture.size:
        return None
    # The residual beyond the end of the floor lies on other ground in the photo, and
    # may stay visible there.
    shares = floor_share(start.ends, setting, box, start.floor)
    if setting.light.is_soft:
        # The tilt of the floor is a guess then: it reaches as far as its shade.
        shares *= _near_share(setting, box, start.floor)
    shares = 1 - shares
    return shares if shares.any() else None


def _near_share(setting: ShadowSetting, box: PixelBox, floor: float) -> F32:
    """Return the share (h, 1) of a box's rows before the far end of a floor at a row
    `floor`.
    """
    # The far end is as far behind the object as the tilt of the floor makes the width
    # of the picture appear.
    rows = np.arange(box[1], box[3], dtype=np.float32)[:, None]
    end = floor - setting.tilt * setting.size[0]
    return np.asarray(np.clip(rows - np.float32(end) + 0.5, 0, 1), np.float32)


def _leaning(casts: list[CastShadow]) -> list[CastShadow]:
    """Return the casts with the lean of sliding shadows.

    The lean is the change of the shadows' offsets from their objects with place.
    """
    places, offsets, masses = [], [], []
    for cast in casts:
        if cast.sliding is None:
            continue
        corner, picture = cast.sliding
        # The centre of mass of the shadow's darkness is its place. Offsets are divided
        # by the thickness of the object, since a taller object has a longer shadow.
        moments = cv2.moments(np.maximum(picture, 0))
        mass = moments["m00"]
        if mass <= 0:
            continue
        middle = np.array([moments["m10"], moments["m01"]]) / mass + corner
        places.append(cast.start.center)
        offsets.append((middle - cast.start.center) / cast.start.thickness)
        masses.append(mass)
    # Two offsets always lie on a line, and would prove a lamp anywhere.
    if len(masses) < SHADOW.shadows:
        return casts
    slope = _offset_slope(np.array(places), np.array(offsets), np.array(masses))
    if slope is None:
        return casts
    leaning = []
    for cast in casts:
        lean = min(SHADOW.lamp * slope * cast.start.thickness, SHADOW.leans)
        leaning.append(replace(cast, lean=lean))
    return leaning


def _offset_slope(places: F64, offsets: F64, masses: F64) -> float | None:
    """Return the change of shadows' offsets (n, 2) with their places (n, 2) by weighted
    regression; None if places do not explain offsets.

    Under a near lamp, shadows point away from it, and the farther the longer.
    """
    # Under a near lamp, the offset is proportional to the distance from the point below
    # the lamp: a line with one slope for both axes. Subtracting the means removes the
    # place of the lamp.
    place = places - np.average(places, axis=0, weights=masses)
    offset = offsets - np.average(offsets, axis=0, weights=masses)
    weight = masses[:, None]
    spread = float((weight * place**2).sum())
    slope = float((weight * place * offset).sum()) / max(spread, 1e-9)
    variance = max(float((weight * offset**2).sum()), 1e-9)
    # With a negative slope, shadows would point towards the lamp. The explained share
    # of the variance is slope² * spread / variance; a small share means that the
    # offsets have other causes, such as errors of the shadows.
    if slope <= 0 or slope**2 * spread / variance < SHADOW.lean_variance:
        return None
    return slope


def unbounded_shadow(
    silhouette: Silhouette, setting: ShadowSetting, step: int
) -> tuple[PixelBox, F32]:
    """Return an object's whole shadow on a table, also beyond the photo's border."""
    # Move the object into a setting so large that its whole shadow lies inside.
    margin = step * ceil((10 * max(silhouette.coverage.shape) + 64) / step)
    (x, y), (cx, cy) = silhouette.corner, silhouette.center
    width, height = setting.size
    moved_figure = replace(
        silhouette,
        corner=(x + margin, y + margin),
        center=(cx + margin, cy + margin),
    )
    large_setting = replace(setting, size=(width + 2 * margin, height + 2 * margin))
    shadow = predicted_shadow(moved_figure, large_setting, step)
    if shadow is None:
        return (x, y, x + 1, y + 1), np.zeros((1, 1), np.float32)
    (x0, y0, x1, y1), darkness = shadow
    return (x0 - margin, y0 - margin, x1 - margin, y1 - margin), darkness


def crop_to_visible(box: PixelBox, picture: F32) -> tuple[PixelBox, F32]:
    """Crop a picture to its visible part, with a smooth fade at its border."""
    is_visible = np.abs(picture) > SHADOW.least_darkness
    rows = np.flatnonzero(is_visible.any(axis=1))
    columns = np.flatnonzero(is_visible.any(axis=0))
    if not len(rows):
        return (box[0], box[1], box[0], box[1]), picture[:0, :0]
    y0, y1 = int(rows[0]), int(rows[-1]) + 1
    x0, x1 = int(columns[0]), int(columns[-1]) + 1
    part = picture[y0:y1, x0:x1]
    # Reduce all values by the visible limit, so that the picture ends at 0 without a
    # step.
    size = np.maximum(np.abs(part) - np.float32(SHADOW.least_darkness), 0)
    part_box = (box[0] + x0, box[1] + y0, box[0] + x1, box[1] + y1)
    return part_box, np.asarray(np.sign(part) * size, np.float32)


def shadow_grid_step(silhouette: Silhouette) -> int:
    """Return the side of the grid cells for an object's shadow, px."""
    # The step grows with the object, so that its shadow always has about the same
    # number of cells.
    height, width = silhouette.coverage.shape
    return max(1, min(int(np.sqrt(height * width)) // SHADOW.cells, 8))


def _spread_into(values: F32, weight: F32, sigma: float) -> F32:
    """Blur known values, which fade in unknown pixels."""
    # Normalised convolution: the mean of known values only. The lower bound avoids a
    # division by almost nothing; with less than a quarter of known weight, the mean
    # fades to 0.
    norm = blurred(weight, sigma)
    mean = blurred(values, sigma) / np.maximum(norm, 0.02)
    return np.asarray(mean * np.clip(norm * 4, 0, 1), np.float32)


def _tint(light: F32, clean_light: F32, darkness: F32, is_open: Mask) -> F32:
    """Fit each channel's darkening (3,) to that of the luminance by least squares."""
    # Only deep shadows determine a colour: in faint ones the noise of the photo is as
    # large as the difference of the channels.
    in_shadow = is_open & (darkness > 0.3)
    light, clean_light, darkness = (
        light[in_shadow],
        clean_light[in_shadow],
        darkness[in_shadow][:, None],
    )
    # Codes next to black are too coarse for a logarithm, and few pixels give no
    # reliable slope.
    is_measurable = (light.min(axis=1) > 2e-3) & (clean_light.min(axis=1) > 2e-3)
    if np.count_nonzero(is_measurable) < 200:
        return np.ones(3, np.float32)
    darkness = darkness[is_measurable]
    channels = np.log(clean_light[is_measurable] / light[is_measurable])
    # Least squares through the origin: without a shadow, no channel is darker. Sky
    # light makes shadows slightly bluish; the limits exclude errors of the clean
    # picture.
    slope = (channels * darkness).sum(axis=0) / (darkness * darkness).sum()
    return np.asarray(np.clip(slope, 0.85, 1.15), np.float32)


def _claims(
    starts: Sequence[Silhouette],
    firsts: Sequence[tuple[PixelBox, F32] | None],
    size: tuple[int, int],
) -> list[tuple[PixelBox, F32]]:
    """Return the likelihood of each object to change the picture around it.

    It follows from the object's predicted shadow and its distance.
    """
    claims: list[tuple[PixelBox, F32]] = []
    for start, shadow in zip(starts, firsts, strict=True):
        # Darkness near an object is probably its own. A few pixels are added for tiny
        # objects.
        reach = SHADOW.claim_reach * min(start.coverage.shape) + 4
        box = _claim_box(start, shadow, ceil(2 * reach), size)
        if box[2] <= box[0] or box[3] <= box[1]:
            claims.append(((0, 0, 0, 0), np.zeros((0, 0), np.float32)))
            continue
        is_outside = (moved_silhouette(start, box, 0, 0, 0) <= 0.5).astype(np.uint8)
        distance = cv2.distanceTransform(is_outside, cv2.DIST_L2, 3)
        # OpenCV's distance is 1e19 without any pixel of the object.
        distance = np.minimum(distance, FAR)
        claim = np.exp(-((distance / reach) ** 2)).astype(np.float32)
        if shadow is not None:
            shadow_picture = _picture_in_box(shadow, box)
            # A predicted shadow is stronger evidence than the distance: its weight lets
            # it win against a near neighbour. Its blurred copy also claims the
            # surroundings, since predictions are displaced by some pixels.
            claim += 4 * shadow_picture + 4 * blurred(shadow_picture, 0.6 * reach)
        claims.append((box, claim))
    return claims


def _picture_in_box(shadow: tuple[PixelBox, F32], box: PixelBox) -> F32:
    """Return a shadow in a larger box, 0 around it."""
    (left, top, right, bottom), darkness = shadow
    x0, y0, x1, y1 = box
    picture = np.zeros((y1 - y0, x1 - x0), np.float32)
    picture[top - y0 : bottom - y0, left - x0 : right - x0] = darkness
    return picture


def _claim_box(
    start: Silhouette,
    shadow: tuple[PixelBox, F32] | None,
    margin: int,
    size: tuple[int, int],
) -> PixelBox:
    """Return the box of an object and its shadow with a margin, within the photo."""
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


def _sum_claims(
    claims: Sequence[tuple[PixelBox, F32]], shape: tuple[int, ...]
) -> tuple[F32, NDArray[np.int32]]:
    """Return the sum of claims (H, W), and 1 + the index of the largest; 0 for small
    sums.
    """
    total, largest = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    owner = np.zeros(shape, np.int32)
    for number, ((x0, y0, x1, y1), claim) in enumerate(claims, 1):
        part = np.s_[y0:y1, x0:x1]
        total[part] += claim
        is_larger = claim > largest[part]
        largest[part][is_larger] = claim[is_larger]
        owner[part][is_larger] = number
    # A pixel with hardly any claim has no owner.
    owner[total <= SHADOW.claim_range[0]] = 0
    return total, owner


EDGE = 6
"""Width of the fade of an object's own shadow at the border of its box, px."""
BEYOND = 0.2
"""Width of that fade beyond the photo's border, as a share of the longer side."""


@dataclass(frozen=True)
class _Difference:
    """Difference between the photo's darkness and the predicted one, (H, W)."""

    excess: F32
    """Darkness beyond the prediction; negative if the photo is brighter than the
    clean picture.
    """
    lack: F32
    """Share 0..1 of the predicted darkness that the photo lacks."""


def _compare_darkness(darkness: F32, total: F32, is_open: Mask) -> _Difference:
    """Compare the photo's darkness (H, W) with the predicted `total`."""
    # Split the difference: up to the predicted darkness, a brighter photo means that a
    # part of the prediction is missing. The rest is darkness that no prediction
    # explains.
    residual = _compute_excess_darkness(darkness, total, is_open)
    lack = np.clip(-residual, 0, np.maximum(total, 0))
    share = lack / np.maximum(total, np.float32(SHADOW.least_darkness))
    excess = np.asarray(residual + lack, np.float32)
    return _Difference(excess, np.asarray(share, np.float32))


def _claimed_darkness(
    difference: _Difference,
    claim: tuple[PixelBox, F32],
    claim_sum: F32,
    first: tuple[PixelBox, F32] | None,
) -> tuple[PixelBox, F32]:
    """Return an object's part of the unexplained darkness.

    It is the excess of the object's claim over those of all others together. `first`
    is the object's predicted shadow: each prediction loses the share that the photo
    lacks, so that no object keeps a shadow that is not in the photo.
    """
    (x0, y0, x1, y1), own_claim = claim
    if not own_claim.size:
        return claim
    all_claims = claim_sum[y0:y1, x0:x1] + np.float32(SHADOW.claim_range[0])
    # 2 * share - 1 is the excess of the own claim over that of all others, relative to
    # their sum. Darkness that two objects claim alike goes to neither: it stays in the
    # plate and does not move with the wrong one.
    share = own_claim / all_claims
    rest = difference.excess
    own_part = rest[y0:y1, x0:x1] * np.maximum(2 * share - 1, 0)
    if first is not None:
        # The prediction will be added with the residual: subtract the share that the
        # photo does not show.
        (left, top, right, bottom), prediction = first
        lack = difference.lack[top:bottom, left:right] * prediction
        own_part[top - y0 : bottom - y0, left - x0 : right - x0] -= lack
    return _faded_at_border(claim[0], own_part, rest.shape)


def _faded_at_border(
    box: PixelBox, shade: F32, shape: tuple[int, ...]
) -> tuple[PixelBox, F32]:
    """Return shade (h, w) in a box, with a fade at the border of the box.

    `shape` (H, W) of the photo.
    """
    x0, y0, x1, y1 = box
    # The shadow fades at the box's border, so that its motion is invisible; beyond the
    # photo's border it is continued.
    height, width = shape
    fade_width = max(round(BEYOND * max(height, width)), EDGE)
    top_margin, bottom_margin = fade_width * (y0 <= 0), fade_width * (y1 >= height)
    left_margin, right_margin = fade_width * (x0 <= 0), fade_width * (x1 >= width)
    shade = np.pad(
        shade, ((top_margin, bottom_margin), (left_margin, right_margin)), "edge"
    )
    rows = _faded_ends(shade.shape[0], top_margin, bottom_margin)
    columns = _faded_ends(shade.shape[1], left_margin, right_margin)
    outer_box = x0 - left_margin, y0 - top_margin, x1 + right_margin, y1 + bottom_margin
    return outer_box, np.asarray(shade * np.outer(rows, columns), np.float32)


def _faded_ends(count: int, before: int, after: int) -> F32:
    """Return weights (count,) of 1, with ramps from 0 at both ends.

    The ramps are `before` and `after` long, and at least `EDGE`.
    """
    places = np.arange(count, dtype=np.float32)
    rise = np.minimum(places / max(before, EDGE), 1)
    fall = np.minimum(places[::-1] / max(after, EDGE), 1)
    return np.minimum(rise, fall)


def _add(canvas: F32, box: PixelBox, values: F32) -> None:
    """Add values to a box of a canvas."""
    x0, y0, x1, y1 = box
    if values.size:
        canvas[y0:y1, x0:x1] += values
