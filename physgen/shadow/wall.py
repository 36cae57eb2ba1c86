"""The shadow of a thing on an upright wall behind the plane of motion."""

from __future__ import annotations

from math import ceil, hypot

import numpy as np
from numpy.typing import NDArray

from physgen.shadow.cast import (
    LOWEST,
    Box,
    Setting,
    Silhouette,
    behind_ball,
    blurred,
    clipped,
    kept,
    moved,
    spread,
)

F32 = NDArray[np.float32]


def on_wall(what: Silhouette, setting: Setting) -> tuple[Box, F32] | None:
    """Box of the photo and (h, w) -log of the light that is left; None where there is no wall, or no shadow on it."""
    lx, ly, lz = setting.light.direction
    if not np.isfinite(setting.backdrop) or lz < 0.05:
        return None
    away, rise = setting.backdrop, max(lz, LOWEST)
    ax, ay = -lx / rise, -ly / rise  # px sideways and down for each px back
    lean = setting.tilt * away  # what lies farther back appears higher
    soft = spread(setting, away, rise, hypot(ax, ay))
    if what.radius is not None:
        x, y, reach = (
            what.center[0] + ax * away,
            what.center[1] + ay * away - lean,
            what.radius / rise + 2 * soft,
        )
        box = clipped((x - reach, y - reach, x + reach, y + reach), setting.size)
        if box is None:
            return None
        right = np.arange(box[0], box[2], dtype=np.float32)[None] - np.float32(what.center[0])
        below = np.arange(box[1], box[3], dtype=np.float32)[:, None] - np.float32(what.center[1] - lean)
        blocked = behind_ball(what.radius, setting, right, below, -away)
    else:
        (x0, y0), (h, w) = what.corner, what.coverage.shape
        half = min(what.thick / 2, away)
        pad = ceil(2.5 * soft + half * hypot(ax, ay)) + 1
        dx, dy = ax * away, ay * away - lean
        box = clipped((x0 + dx - pad, y0 + dy - pad, x0 + w + dx + pad, y0 + h + dy + pad), setting.size)
        if box is None:
            return None
        blocked = moved(what, box, dx, dy, 0.0)
        for back in (-half, half) if half * hypot(ax, ay) > 1 else ():
            np.maximum(blocked, moved(what, box, dx + ax * back, dy + ay * back, 0.0), out=blocked)
        blocked = blurred(blocked, soft)
    if what.floor is not None:  # the wall ends where the floor begins
        rows = np.arange(box[1], box[3], dtype=np.float32)[:, None]
        blocked = blocked * np.clip(np.float32(what.floor - lean + 0.5) - rows, 0, 1)
    return box, kept(setting.direct((0.0, 0.0, 1.0)), np.asarray(blocked, np.float32), np.zeros_like(blocked))
