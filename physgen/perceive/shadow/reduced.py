"""Shadows of a reduced photo, and the removed shadow's light at full size.

Shadows are wide: their search at a fixed size costs the same for every photo. A guided
filter (He, Sun and Tang 2013) transfers the added light to full size: at a shadow's
edge it follows the photo's edge, elsewhere it is smooth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.shadows import Silhouette
from physgen.maps import F32
from physgen.perceive.roles import Labels, Rgb, Shadows
from physgen.perceive.shadow.silhouettes import DARKEST
from physgen.perceive.working_size import working_size
from physgen.photometry import decode, encode_u8, luminance

GUIDE_SIDE = 5
"""px of the reduced photo: side of the guided filter's windows."""
GUIDE_TEXTURE = 0.01
"""Squared -log of light: texture of a tenth of the light is not a shadow's edge."""
VISIBLE = 1e-3
"""-log of light: smaller changes are not applied."""

SilhouettesAt = Callable[[float], Sequence[Silhouette]]
"""Return the silhouettes on a picture reduced by a factor."""


@dataclass(frozen=True, eq=False)
class ReducedPhoto:
    """A background (h, w, 3) and its coverage (h, w), reduced if they are large."""

    background: Rgb
    coverage: F32
    scale: float
    """px of the photo per px of these maps."""

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height, px."""
        return self.coverage.shape[1], self.coverage.shape[0]

    def at(self, silhouettes: SilhouettesAt) -> SilhouettesAt:
        """Return a function for silhouettes of this picture from one for the photo."""
        return lambda scale: silhouettes(scale * self.scale)


def reduce_photo(background: Rgb, coverage: F32) -> ReducedPhoto:
    """Return a background (H, W, 3) and coverage (H, W) at the working size."""
    size = working_size(coverage.shape)
    if size is None:
        return ReducedPhoto(background, coverage, 1.0)
    scale = max(coverage.shape) / max(size)
    small = cv2.resize(background, size, interpolation=cv2.INTER_AREA)
    share = cv2.resize(coverage, size, interpolation=cv2.INTER_AREA)
    return ReducedPhoto(
        np.asarray(small, np.uint8), np.asarray(share, np.float32), scale
    )


def restore_size(
    shadows: Shadows, reduced: ReducedPhoto, background: Rgb, coverage: F32
) -> Shadows:
    """Return the shadows of a reduced photo at the size of its `background` (H,
    W, 3).
    """
    if reduced.scale == 1:
        return shadows
    owners = shadows.owners
    clean_background = shadows.clean_background
    backdrop = shadows.backdrop
    if backdrop is not None:
        backdrop = round(backdrop * reduced.scale, 1)
    if clean_background is not None:
        clean_background = _lighten(background, reduced.background, clean_background)
    if owners is not None:
        owners = _enlarge_owners(owners, coverage)
    return replace(
        shadows, clean_background=clean_background, owners=owners, backdrop=backdrop
    )


def _enlarge_owners(owners: Labels, coverage: F32) -> Labels | None:
    """Return the owners at full size outside objects, or None if there are none."""
    size = coverage.shape[::-1]
    large = cv2.resize(owners, size, interpolation=cv2.INTER_NEAREST_EXACT)
    large[coverage >= 0.5] = 0
    if large.any():
        return np.asarray(large, np.uint16)
    return None


@dataclass(frozen=True)
class _Box:
    """A box of the full picture, and its scale over the small one."""

    left: int
    top: int
    right: int
    bottom: int
    # Ratios of both pictures' widths and heights.
    x_ratio: float
    y_ratio: float

    @property
    def slices(self) -> tuple[slice, slice]:
        """Return rows and columns."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def enlarge(self, small: F32) -> F32:
        """Return the values of a small map (h, w), interpolated in the box."""
        matrix = np.array(
            [
                [1 / self.x_ratio, 0, (self.left + 0.5) / self.x_ratio - 0.5],
                [0, 1 / self.y_ratio, (self.top + 0.5) / self.y_ratio - 0.5],
            ]
        )
        values = cv2.warpAffine(
            np.ascontiguousarray(small),
            matrix,
            (self.right - self.left, self.bottom - self.top),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return np.asarray(values, np.float32)


def _lighten(background: Rgb, small: Rgb, lifted: Rgb) -> Rgb:
    """Return `background` with the light by which `lifted` exceeds `small` (h, w,
    3).
    """
    guide = _log(luminance(decode(small)))
    gain = _log(decode(lifted)) - _log(decode(small))
    box = _changed_box(gain, background.shape)
    if box is None:
        return background
    slope, level = _fit_lines(guide, gain)
    linear = decode(background[box.slices])
    levels = _log(luminance(linear))
    for channel in range(3):
        slope_map = box.enlarge(slope[..., channel])
        level_map = box.enlarge(level[..., channel])
        log_gain = np.maximum(slope_map * levels + level_map, 0)
        linear[..., channel] *= np.where(
            log_gain > VISIBLE, cv2.exp(log_gain), np.float32(1)
        )
    result = background.copy()
    result[box.slices] = encode_u8(np.minimum(linear, 1))
    return result


def _changed_box(gain: F32, shape: tuple[int, ...]) -> _Box | None:
    """Return the box of visible changes, extended by the windows' reach, or None.

    `gain` (h, w, 3) is small; `shape` is the full picture's.
    """
    height, width = shape[:2]
    is_visible = np.asarray((np.abs(gain) > VISIBLE).any(axis=2))
    rows = np.flatnonzero(is_visible.any(axis=1))
    columns = np.flatnonzero(is_visible.any(axis=0))
    if not len(rows):
        return None
    y_ratio = height / gain.shape[0]
    x_ratio = width / gain.shape[1]
    return _Box(
        max(int((columns[0] - GUIDE_SIDE) * x_ratio), 0),
        max(int((rows[0] - GUIDE_SIDE) * y_ratio), 0),
        min(int((columns[-1] + GUIDE_SIDE) * x_ratio) + 1, width),
        min(int((rows[-1] + GUIDE_SIDE) * y_ratio) + 1, height),
        x_ratio,
        y_ratio,
    )


def _fit_lines(guide: F32, values: F32) -> tuple[F32, F32]:
    """Return slope and level (h, w, 3) of the lines from `guide` (h, w) to `values`."""
    middle = _box_mean(guide)
    spread = _box_mean(guide * guide) - middle * middle
    means = _box_mean(values)
    products = np.asarray(guide[..., None] * values, np.float32)
    covariance = _box_mean(products) - middle[..., None] * means
    slope = covariance / (np.maximum(spread, 0) + np.float32(GUIDE_TEXTURE))[..., None]
    level = means - slope * middle[..., None]
    slopes = np.asarray(slope, np.float32)
    return _box_mean(slopes), _box_mean(np.asarray(level, np.float32))


def _box_mean(values: NDArray[np.floating[Any]]) -> F32:
    return np.asarray(cv2.blur(values, (GUIDE_SIDE, GUIDE_SIDE)), np.float32)


def _log(light: F32) -> F32:
    return np.asarray(cv2.log(light + np.float32(DARKEST)), np.float32)
