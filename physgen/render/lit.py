"""Background taken apart, and poses -> the background with every shadow where its object stands now.

All is kept as logarithms of the share of light that is left, so that shadows of many objects add up, and at t = 0 the
sum is the photo's. How it comes apart is told in `apart.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Pose
from physgen.shadow.cast import Box, Setting, Silhouette
from physgen.shadow.darkness import darkness

F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]

LIFT = 0.25
"""Of an object's size: off the floor by as much, its shadow in the photo is no longer its own."""
COMES = 0.5
"""Of an object's size: moved by as much, it has mostly left an old shadow that nobody could lift."""
FLIES = 1.2
"""Of an object's thickness: so far above the floor its shadow falls on the wall, if there is one."""
TURN = 0.35
"""rad by which an object that is not round may turn until then."""


@dataclass(frozen=True)
class Cast:
    """One object's share of the photo's shadows; darkness is -log of the light that it leaves."""

    start: Silhouette
    step: int
    """px a side of the grid on which its shadow is worked out."""
    whole: tuple[Box, F32] | None
    """All of it, at t = 0."""
    own: tuple[Box, F32]
    """Of `whole` what the photo shows beyond geometry, of either sign."""
    sliding: tuple[tuple[int, int], F32] | None
    """Where the shadow never changes its shape: its corner, and all of it, beyond the photo's border too."""
    round: bool
    """Whether turning changes nothing."""


@dataclass(frozen=True)
class Lit:
    """A background taken apart."""

    setting: Setting
    plate: F32
    """(H, W, 3) linear: in the light that no object keeps away."""
    tint: F32
    """(3,): by how much more or less than the average a channel darkens."""
    total: F32
    """(H, W): -log of the light left at t = 0, of all objects."""
    casts: Sequence[Cast]
    lifted: bool = True
    """Whether anybody has taken the photo's shadows apart from the background."""

    def behind(self) -> F32:
        """(H, W, 3) linear: the background at t = 0."""
        return shaded(self.plate, self.total, self.tint)

    def moved(self, k: int, now: Silhouette | None, start: Pose, pose: Pose) -> list[tuple[Box, F32]]:
        """What object k adds now, at `pose` instead of `start`: boxes, and what is dark there."""
        cast = self.casts[k]
        if cast.sliding is not None:
            corner, picture = cast.sliding
            box, carried = carry(picture, corner, (pose.x - start.x, pose.y - start.y), self.setting.size)
            return [] if box is None else [(box, carried)]
        found: list[tuple[Box, F32]] = []
        if now is None:
            return found
        if (dark := foretold(now, self.setting, cast.step)) is not None:
            box, picture = dark
            if not self.lifted:  # the photo's shadow is still there: today's comes as it is left behind
                away = np.hypot(pose.x - start.x, pose.y - start.y) / (
                    COMES * max(min(now.coverage.shape), 1)
                )
                picture = picture * np.float32(1 - np.exp(-(away**2)))
            found.append((box, picture))
        strength, shift = self._kept(cast, now, pose.angle - start.angle)
        if strength > 0.02:
            (x0, y0, _, _), own = cast.own
            box, carried = carry(own, (x0, y0), shift, self.setting.size)
            if box is not None:
                carried *= np.float32(strength)
                if not self.setting.top and self._on_wall(cast.start) and now.floor is not None:
                    end = now.floor - self.setting.tilt * self.setting.backdrop  # the wall's foot
                    rows = np.arange(box[1], box[3], dtype=np.float32)[:, None]
                    carried = carried * np.clip(end - rows + 0.5, 0, 1).astype(np.float32)
                found.append((box, carried))
        return found

    def _on_wall(self, start: Silhouette) -> bool:
        """Whether its shadow is mostly on the wall behind: it flies before one."""
        if not np.isfinite(self.setting.backdrop):
            return False
        return start.floor is None or start.floor - start.center[1] > FLIES * start.thick

    def _kept(self, cast: Cast, now: Silhouette, turn: float) -> tuple[float, tuple[float, float]]:
        """How much of the photo's own shadow still holds, and by how much it has moved, px."""
        start = cast.start
        dx, dy = now.center[0] - start.center[0], now.center[1] - start.center[1]
        size = max(min(start.coverage.shape), 1)
        strength = 1.0 if cast.round else float(np.exp(-((turn / TURN) ** 2)))
        if self.setting.top or self._on_wall(start):
            return strength, (dx, dy)
        if start.floor is None or now.floor is None:
            return strength * float(np.exp(-((np.hypot(dx, dy) / (LIFT * size)) ** 2))), (0.0, 0.0)
        lift = (start.floor - start.center[1]) - (now.floor - now.center[1])
        strength *= float(np.exp(-((lift / (LIFT * size)) ** 2)))
        return strength, (dx, now.floor - start.floor)


def foretold(what: Silhouette, setting: Setting, step: int) -> tuple[Box, F32] | None:
    """`darkness`, worked out on a grid of `step` px: shadows are soft, and large things have large shadows."""
    if step == 1:
        return darkness(what, setting)
    (x, y), (h, w) = what.corner, what.coverage.shape
    left, top = x % step, y % step
    padded = cv2.copyMakeBorder(
        what.coverage, top, -(top + h) % step, left, -(left + w) % step, cv2.BORDER_CONSTANT
    )
    small = cv2.resize(
        padded, (padded.shape[1] // step, padded.shape[0] // step), interpolation=cv2.INTER_AREA
    )
    W, H = setting.size
    rough = darkness(
        Silhouette(
            np.asarray(small, np.float32),
            ((x - left) // step, (y - top) // step),
            ((what.center[0] + 0.5) / step - 0.5, (what.center[1] + 0.5) / step - 0.5),
            None if what.radius is None else what.radius / step,
            what.thick / step,
            None if what.floor is None else (what.floor + 0.5) / step - 0.5,
        ),
        _coarse(setting, step),
    )
    if rough is None:
        return None
    (x0, y0, x1, y1), dark = rough
    fine = cv2.resize(dark, ((x1 - x0) * step, (y1 - y0) * step), interpolation=cv2.INTER_LINEAR)
    x0, y0 = x0 * step, y0 * step
    x1, y1 = min(x1 * step, W), min(y1 * step, H)
    return (x0, y0, x1, y1), np.asarray(fine[: y1 - y0, : x1 - x0], np.float32)


@lru_cache(maxsize=64)
def _coarse(setting: Setting, step: int) -> Setting:
    """The same on a grid of `step` px."""
    W, H = setting.size
    return replace(setting, size=(-(-W // step), -(-H // step)), backdrop=setting.backdrop / step)


def shaded(plate: F32, dark: F32, tint: F32) -> F32:
    """(h, w, 3) of a plate in the light that is left."""
    left = cv2.merge([dark * -part for part in tint])
    return np.asarray(cv2.multiply(plate, cv2.exp(left)), np.float32)


def carry(
    picture: F32, corner: tuple[int, int], shift: tuple[float, float], size: tuple[int, int]
) -> tuple[Box | None, F32]:
    """A picture moved by a fraction of pixels, cut to the photo."""
    h, w = picture.shape
    x, y = corner[0] + shift[0], corner[1] + shift[1]
    x0, y0 = int(np.floor(x)), int(np.floor(y))
    left, top = max(x0, 0), max(y0, 0)
    right, bottom = min(x0 + w + 1, size[0]), min(y0 + h + 1, size[1])
    if not picture.size or right <= left or bottom <= top:
        return None, picture
    matrix = np.array([[1.0, 0, x - left], [0, 1, y - top]])
    moved = cv2.warpAffine(picture, matrix, (right - left, bottom - top), borderMode=cv2.BORDER_CONSTANT)
    return (left, top, right, bottom), np.asarray(moved, np.float32)
