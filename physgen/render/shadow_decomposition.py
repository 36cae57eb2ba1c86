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

from physgen.geometry.polygon import Pose
from physgen.geometry.shadows import (
    F32,
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
    """Quantile of the photo's depth over the predicted one, for some lie beside it; and its least value. By tune."""
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
    lean: float = 0.0
    """px that a sliding shadow moves beyond its object for each px of the object's way: a lamp is near."""


@dataclass(frozen=True)
class LitBackground:
    """A background taken apart."""

    setting: ShadowSetting
    plate: F32
    """(H, W, 3) linear: in the light that no object keeps away; the clean picture where objects may have shadows."""
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
        """(H, W, 3) linear: the background at t = 0."""
        return shaded_background(self.plate, self.total, self.tint)

    def limited(self, dark: F32, box: tuple[slice, slice]) -> F32:
        """(h, w) of the sum `dark` (h, w) of shadows: of direct light that one keeps away others keep away no more."""
        over = dark - self._most[box]
        if over.max() <= 0:
            return dark
        kept = dark - over
        kept += 1
        kept -= cv2.exp(-over)
        np.copyto(kept, dark, where=over <= 0)
        return np.asarray(kept, np.float32)

    @cached_property
    def _most(self) -> F32:
        """(H, W): what one object may keep away."""
        return np.maximum(self.total, self.setting.shade)

    def moved(
        self, k: int, now: Silhouette | None, start: Pose, pose: Pose
    ) -> list[tuple[PixelBox, F32]]:
        """What object k adds now, at `pose` instead of `start`: boxes, and what is dark there."""
        cast = self.casts[k]
        if cast.sliding is not None:
            corner, picture = cast.sliding
            far = 1 + cast.lean
            shift = far * (pose.x - start.x), far * (pose.y - start.y)
            box, carried = shifted_picture(picture, corner, shift, self.setting.size)
            return [] if box is None else [(box, carried)]
        found: list[tuple[PixelBox, F32]] = []
        if now is None:
            return found
        if (dark := predicted_shadow(now, self.setting, cast.step)) is not None:
            box, picture = dark
            if (
                not self.lifted
            ):  # the photo's shadow is still there: today's comes as it is left behind
                away = np.hypot(pose.x - start.x, pose.y - start.y) / (
                    SHADOW.comes * max(min(now.coverage.shape), 1)
                )
                picture = picture * np.float32(1 - np.exp(-(away**2)))
            found.append((box, picture))
        strength, shift = self._kept(cast, now, pose.angle - start.angle)
        if strength > 0.02:
            (x0, y0, _, _), own = cast.own
            box, carried = shifted_picture(own, (x0, y0), shift, self.setting.size)
            if box is not None:
                carried *= np.float32(strength)
                if now.floor is not None and self._on_wall(cast.start):
                    end = (
                        now.floor - self.setting.tilt * self.setting.backdrop
                    )  # the wall's foot
                    rows = np.arange(box[1], box[3], dtype=np.float32)[:, None]
                    carried *= np.clip(end - rows + 0.5, 0, 1)
                elif now.floor is not None and not np.isfinite(self.setting.backdrop):
                    carried *= floor_share(now.ends, self.setting, box, now.floor)
                found.append((box, carried))
        return found

    def _on_wall(self, start: Silhouette) -> bool:
        """Whether its shadow is mostly on the wall behind: it flies before one."""
        if not np.isfinite(self.setting.backdrop):
            return False
        return (
            start.floor is None
            or start.floor - start.center[1] > SHADOW.flies * start.thick
        )

    def _kept(
        self, cast: CastShadow, now: Silhouette, turn: float
    ) -> tuple[float, tuple[float, float]]:
        """How much of the photo's own shadow still holds, and by how much it has moved, px."""
        start = cast.start
        dx, dy = now.center[0] - start.center[0], now.center[1] - start.center[1]
        size = max(min(start.coverage.shape), 1)
        strength = 1.0 if cast.round else float(np.exp(-((turn / SHADOW.turn) ** 2)))
        if self.setting.top or self._on_wall(start):
            return strength, (dx, dy)
        if start.floor is None or now.floor is None:
            return strength * float(
                np.exp(-((np.hypot(dx, dy) / (SHADOW.lift * size)) ** 2))
            ), (0.0, 0.0)
        lift = (start.floor - start.center[1]) - (now.floor - now.center[1])
        strength *= float(np.exp(-((lift / (SHADOW.lift * size)) ** 2)))
        return strength, (dx, now.floor - start.floor)


def predicted_shadow(
    what: Silhouette, setting: ShadowSetting, step: int
) -> tuple[PixelBox, F32] | None:
    """`darkness`, worked out on a grid of `step` px: shadows are soft, and large objects have large shadows."""
    if what.radius is not None and step in (
        2,
        3,
    ):  # quick, and few rows of a floor: no steps at its edge
        found = shadow_darkness(what, setting)
        return found and (found[0], blurred(found[1], 0.4 * step))
    if step == 1:
        return shadow_darkness(what, setting)
    (x, y), (h, w) = what.corner, what.coverage.shape
    left, top = x % step, y % step
    padded = cv2.copyMakeBorder(
        what.coverage,
        top,
        -(top + h) % step,
        left,
        -(left + w) % step,
        cv2.BORDER_CONSTANT,
    )
    small = cv2.resize(
        padded,
        (padded.shape[1] // step, padded.shape[0] // step),
        interpolation=cv2.INTER_AREA,
    )
    W, H = setting.size
    rough = shadow_darkness(
        Silhouette(
            np.asarray(small, np.float32),
            ((x - left) // step, (y - top) // step),
            ((what.center[0] + 0.5) / step - 0.5, (what.center[1] + 0.5) / step - 0.5),
            None if what.radius is None else what.radius / step,
            what.thick / step,
            None if what.floor is None else (what.floor + 0.5) / step - 0.5,
            ((what.ends[0] + 0.5) / step - 0.5, (what.ends[1] + 0.5) / step - 0.5),
            what.walls,
        ),
        _coarse(setting, step),
    )
    if rough is None:
        return None
    (x0, y0, x1, y1), dark = rough
    fine = cv2.resize(
        dark, ((x1 - x0) * step, (y1 - y0) * step), interpolation=cv2.INTER_LINEAR
    )
    x0, y0 = x0 * step, y0 * step
    x1, y1 = min(x1 * step, W), min(y1 * step, H)
    return (x0, y0, x1, y1), np.asarray(fine[: y1 - y0, : x1 - x0], np.float32)


@lru_cache(maxsize=64)
def _coarse(setting: ShadowSetting, step: int) -> ShadowSetting:
    """The same on a grid of `step` px."""
    W, H = setting.size
    return replace(
        setting, size=(-(-W // step), -(-H // step)), backdrop=setting.backdrop / step
    )


def shaded_background(plate: F32, dark: F32, tint: F32) -> F32:
    """(h, w, 3) of a plate in the light that is left."""
    left = cv2.merge([dark * -part for part in tint])
    return np.asarray(cv2.multiply(plate, cv2.exp(left)), np.float32)


def shifted_picture(
    picture: F32,
    corner: tuple[int, int],
    shift: tuple[float, float],
    size: tuple[int, int],
) -> tuple[PixelBox | None, F32]:
    """A picture moved by a fraction of pixels, cut to the photo."""
    h, w = picture.shape[:2]
    x, y = corner[0] + shift[0], corner[1] + shift[1]
    x0, y0 = int(np.floor(x)), int(np.floor(y))
    left, top = max(x0, 0), max(y0, 0)
    right, bottom = min(x0 + w + 1, size[0]), min(y0 + h + 1, size[1])
    if not picture.size or right <= left or bottom <= top:
        return None, picture
    matrix = np.array([[1.0, 0, x - left], [0, 1, y - top]])
    moved = cv2.warpAffine(
        picture, matrix, (right - left, bottom - top), borderMode=cv2.BORDER_CONSTANT
    )
    return (left, top, right, bottom), np.asarray(moved, np.float32)


def decompose_shadows(
    background: U8,
    clean: U8 | None,
    coverage: F32,
    starts: Sequence[Silhouette],
    rounds: Sequence[bool],
    setting: ShadowSetting,
    gone: Sequence[Silhouette] = (),
    changed: NDArray[np.bool_] | None = None,
) -> tuple[LitBackground, F32 | None]:
    """`background` (H, W, 3) sRGB with the objects' shadows, `clean` without; None: they were not removed.

    `gone` are objects of the photo that the scene leaves out: their shadows leave with them. `changed` (H, W): where
    the background is not the photo's, which tells nothing of shadows close to objects either. The second result is
    (H, W) -log of the light that those left; None where there are none.
    """
    lit = decode(background)
    steps = [shadow_grid_step(start) for start in starts]
    if (
        clean is None
    ):  # all that is dark stays, and what moves throws a shadow of its own beside it
        nothing = (0, 0, 0, 0), np.zeros((0, 0), np.float32)
        casts = [
            CastShadow(s, step, None, nothing, None, r)
            for s, step, r in zip(starts, steps, rounds, strict=True)
        ]
        dark = np.zeros(lit.shape[:2], np.float32)
        nobody = np.zeros(dark.shape, np.int32)
        return LitBackground(
            setting, lit, np.ones(3, np.float32), dark, casts, nobody, lifted=False
        ), None
    bare = decode(clean)
    dark = _log(luminance(bare)) - _log(luminance(lit))
    np.clip(dark, -0.5, SHADOW.deepest, out=dark)
    # close to an object, and in narrow gaps between objects, the background is not to be trusted
    ring, gap = (
        np.ones((2 * by + 1, 2 * by + 1), np.uint8) for by in (SHADOW.ring, SHADOW.gap)
    )
    unknown = cv2.morphologyEx(
        cv2.dilate((coverage > 0).astype(np.uint8), ring), cv2.MORPH_CLOSE, gap
    )
    reach = cv2.dilate((coverage >= 0.5).astype(np.uint8), gap)
    open_ = (unknown == 0) | (reach == 0)
    if changed is not None:
        open_ &= ~changed
    weight = open_.astype(np.float32)
    everybody = [*starts, *gone]
    steps += [shadow_grid_step(ghost) for ghost in gone]
    firsts, total = _predicted(everybody, steps, setting)
    (deep, fewest), (quantile, least) = SHADOW.compared, SHADOW.lacking
    there = open_ & (total > deep)
    if np.count_nonzero(there) > fewest:
        middle, high = np.quantile(
            np.expm1(-dark[there]) / np.expm1(-total[there]), (0.5, quantile)
        )
        setting = replace(setting, lacking=float(max(min(high, 1.0), middle, least)))
        firsts, total = _predicted(everybody, steps, setting)
    rest = _spread_into(cv2.medianBlur(dark - total, 5) * weight, weight, SHADOW.smooth)
    # behind objects the difference goes on smoothly; nothing there is brighter than without shadows
    rest = harmonic_fill(rest[..., None], ~open_)[..., 0]
    np.maximum(rest, np.where(open_, rest, -total), out=rest)
    casts = []
    claims = _claims(everybody, firsts, setting.size)
    claimed, owner = _claimed(claims, dark.shape)
    total, left = np.zeros(dark.shape, np.float32), np.zeros(dark.shape, np.float32)
    for k, (start, step, first, claim) in enumerate(
        zip(everybody, steps, firsts, claims, strict=True)
    ):
        own = _owned(rest, claim, claimed)
        cast = _cast(start, step, first, own, k < len(starts) and rounds[k], setting)
        if k < len(starts):
            casts.append(cast)
        if cast.whole is not None:
            _add(total if k < len(starts) else left, *cast.whole)
    casts = _leaning(casts)
    tint = _tint(lit, bare, dark, open_)
    least, most = SHADOW.claimed
    given = np.clip((claimed - least) / (most - least), 0, 1)
    given = np.where(open_, given, np.float32(1))
    plate = np.empty_like(lit)
    for c in range(3):
        seen = _log(lit[..., c]) + (total + left) * tint[c]
        plate[..., c] = cv2.exp(seen + given * (_log(bare[..., c]) - seen))
    return LitBackground(
        setting, plate, tint, total, casts, owner
    ), left if gone else None


def _predicted(
    everybody: Sequence[Silhouette], steps: Sequence[int], setting: ShadowSetting
) -> tuple[list[tuple[PixelBox, F32] | None], F32]:
    """The shadow of each, and (H, W) their sum."""
    firsts = [
        predicted_shadow(one, setting, step)
        for one, step in zip(everybody, steps, strict=True)
    ]
    total = np.zeros(setting.size[::-1], np.float32)
    for first in firsts:
        if first is not None:
            _add(total, *first)
    return firsts, total


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
    """One object's shadow at t = 0: what geometry foretells, and what the photo shows beyond."""
    own = _trimmed(*own)
    slides = setting.top and is_round and first is not None
    geometry = unbounded_shadow(start, setting, step) if slides else first
    (x, y, *_), everything = _trimmed(
        *joined_pictures([own] if geometry is None else [geometry, own])
    )
    box, seen = shifted_picture(everything, (x, y), (0.0, 0.0), setting.size)
    whole = None if box is None else (box, seen)
    # an object far outside of the photo has no visible shadow that could slide
    sliding = ((x, y), everything) if slides and everything.size else None
    return CastShadow(start, step, whole, own, sliding, is_round)


def _leaning(casts: list[CastShadow]) -> list[CastShadow]:
    """The same, with the lean of sliding shadows: how their offsets from their objects change with place."""
    places, offsets, weights = [], [], []
    for cast in casts:
        if (
            cast.sliding is not None
            and (moments := cv2.moments(np.maximum(cast.sliding[1], 0)))["m00"] > 0
        ):
            middle = (
                np.array([moments["m10"], moments["m01"]]) / moments["m00"]
                + cast.sliding[0]
            )
            places.append(cast.start.center)
            offsets.append((middle - places[-1]) / cast.start.thick)
            weights.append(moments["m00"])
    if len(weights) < SHADOW.shadows:
        return casts
    place, offset = (
        np.array(part) - np.average(part, axis=0, weights=weights)
        for part in (places, offsets)
    )
    weight = np.array(weights)[:, None]
    spread = float((weight * place**2).sum())
    slope = float((weight * place * offset).sum()) / max(spread, 1e-9)
    explained = slope**2 * spread / max(float((weight * offset**2).sum()), 1e-9)
    if slope <= 0 or explained < SHADOW.explained:
        return casts
    return [
        replace(cast, lean=min(SHADOW.lamp * slope * cast.start.thick, SHADOW.leans))
        for cast in casts
    ]


def unbounded_shadow(
    what: Silhouette, setting: ShadowSetting, step: int
) -> tuple[PixelBox, F32]:
    """Box and picture of an object's whole shadow on a table, as if the photo had no border."""
    beyond = step * ceil((10 * max(what.coverage.shape) + 64) / step)
    (x, y), (cx, cy), (W, H) = what.corner, what.center, setting.size
    far = replace(
        what, corner=(x + beyond, y + beyond), center=(cx + beyond, cy + beyond)
    )
    found = predicted_shadow(
        far, replace(setting, size=(W + 2 * beyond, H + 2 * beyond)), step
    )
    if found is None:
        return (x, y, x + 1, y + 1), np.zeros((1, 1), np.float32)
    (x0, y0, x1, y1), dark = found
    return (x0 - beyond, y0 - beyond, x1 - beyond, y1 - beyond), dark


def _trimmed(box: PixelBox, picture: F32) -> tuple[PixelBox, F32]:
    """The part of a picture in which anything is to be seen, fading to nothing at its border."""
    seen = np.abs(picture) > SHADOW.faint
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if not len(rows):
        return (box[0], box[1], box[0], box[1]), picture[:0, :0]
    y0, y1, x0, x1 = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    kept = picture[y0:y1, x0:x1]
    kept = np.asarray(
        np.sign(kept) * np.maximum(np.abs(kept) - np.float32(SHADOW.faint), 0),
        np.float32,
    )
    return (
        int(box[0] + x0),
        int(box[1] + y0),
        int(box[0] + x1),
        int(box[1] + y1),
    ), kept


def shadow_grid_step(what: Silhouette) -> int:
    """px a side of the grid for its shadow: some 24 cells across the object, at most."""
    h, w = what.coverage.shape
    return max(1, min(int(np.sqrt(h * w)) // SHADOW.cells, 8))


def _spread_into(values: F32, weight: F32, sigma: float) -> F32:
    """A blur of what is known, which dies away in what is not."""
    near = blurred(weight, sigma)
    return np.asarray(
        blurred(values, sigma) / np.maximum(near, 0.02) * np.clip(near * 4, 0, 1),
        np.float32,
    )


def _tint(lit: F32, bare: F32, dark: F32, where: NDArray[np.bool_]) -> F32:
    """(3,) least squares of each channel's darkening by that of the luminance."""
    there = where & (dark > 0.3)
    lit, bare, d = lit[there], bare[there], dark[there][:, None]
    seen = (lit.min(axis=1) > 2e-3) & (bare.min(axis=1) > 2e-3)
    if np.count_nonzero(seen) < 200:
        return np.ones(3, np.float32)
    each, d = np.log(bare[seen] / lit[seen]), d[seen]
    return np.asarray(
        np.clip((each * d).sum(axis=0) / (d * d).sum(), 0.85, 1.15), np.float32
    )


def _claims(
    starts: Sequence[Silhouette],
    firsts: Sequence[tuple[PixelBox, F32] | None],
    size: tuple[int, int],
) -> list[tuple[PixelBox, F32]]:
    """How likely each object changes the picture around it: by the shadow it foretells, and by how near it is."""
    W, H = size
    claims: list[tuple[PixelBox, F32]] = []
    for start, first in zip(starts, firsts, strict=True):
        h, w = start.coverage.shape
        reach = SHADOW.near * min(h, w) + 4
        pad = ceil(2 * reach)
        x0, y0 = (side - pad for side in start.corner)
        x1, y1 = start.corner[0] + w + pad, start.corner[1] + h + pad
        if first is not None:
            (a, b, c, d), _ = first
            x0, y0, x1, y1 = (
                min(x0, a - pad),
                min(y0, b - pad),
                max(x1, c + pad),
                max(y1, d + pad),
            )
        box = max(x0, 0), max(y0, 0), min(x1, W), min(y1, H)
        x0, y0, x1, y1 = box
        if x1 <= x0 or y1 <= y0:
            claims.append(((0, 0, 0, 0), np.zeros((0, 0), np.float32)))
            continue
        away = (moved_silhouette(start, box, 0, 0, 0) <= 0.5).astype(np.uint8)
        distance = cv2.distanceTransform(away, cv2.DIST_L2, 3)
        distance = np.minimum(
            distance, FAR
        )  # it is 1e19 where the object is out of the picture
        claim = np.exp(-((distance / reach) ** 2)).astype(np.float32)
        if first is not None:
            (a, b, c, d), dark = first
            cast = np.zeros_like(claim)
            cast[b - y0 : d - y0, a - x0 : c - x0] = dark
            claim += 4 * cast + 4 * blurred(cast, 0.6 * reach)
        claims.append((box, claim))
    return claims


def _claimed(
    claims: Sequence[tuple[PixelBox, F32]], shape: tuple[int, ...]
) -> tuple[F32, NDArray[np.int32]]:
    """(H, W) the sum of claims, and 1 + the index of the largest; 0 where there are hardly any."""
    total, most = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    owner = np.zeros(shape, np.int32)
    for k, ((x0, y0, x1, y1), claim) in enumerate(claims, 1):
        part = np.s_[y0:y1, x0:x1]
        total[part] += claim
        more = claim > most[part]
        most[part][more] = claim[more]
        owner[part][more] = k
    owner[total <= SHADOW.claimed[0]] = 0
    return total, owner


def _owned(
    rest: F32, claim: tuple[PixelBox, F32], claimed: F32
) -> tuple[PixelBox, F32]:
    """An object's part of what geometry does not explain: what it claims beyond all others together."""
    (x0, y0, x1, y1), mine = claim
    if not mine.size:
        return claim
    share = mine / (claimed[y0:y1, x0:x1] + np.float32(SHADOW.claimed[0]))
    own = rest[y0:y1, x0:x1] * np.maximum(2 * share - 1, 0)
    # nothing at the box's border, so that it may move unseen; at the photo's, where nobody knows, it goes on as there
    edge = 6
    height, width = rest.shape
    beyond = [edge * met for met in (y0 <= 0, y1 >= height, x0 <= 0, x1 >= width)]
    own = np.pad(own, (beyond[:2], beyond[2:]), "edge")
    down, across = (
        np.clip(np.minimum(np.arange(n), np.arange(n)[::-1]) / edge, 0, 1)
        for n in own.shape
    )
    box = x0 - beyond[2], y0 - beyond[0], x1 + beyond[3], y1 + beyond[1]
    return box, np.asarray(own * np.outer(down, across).astype(np.float32), np.float32)


def _add(canvas: F32, box: PixelBox, values: F32) -> None:
    x0, y0, x1, y1 = box
    if values.size:
        canvas[y0:y1, x0:x1] += values
