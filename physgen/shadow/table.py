"""The shadow of a thing on a table seen from above."""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

from physgen.shadow.cast import LOWEST, Box, Setting, Silhouette, clipped, faded, kept, moved, spread

F32 = NDArray[np.float32]


def on_table(what: Silhouette, setting: Setting) -> tuple[Box, F32] | None:
    """Box of the photo and (h, w) -log of the light that is left; None where it lies outside the photo."""
    lx, ly, lz = setting.light.direction
    rise = max(lz, LOWEST)
    ax, ay = -lx / rise, -ly / rise  # px of shadow for each px of height
    direct = setting.direct((0.0, 0.0, 1.0))
    if what.radius is not None:
        r, (cx, cy) = what.radius, what.center
        soft = spread(setting, r, rise)
        reach = r / rise + 2.5 * soft + r
        box = clipped(
            (
                cx + min(0, ax * r) - reach,
                cy + min(0, ay * r) - reach,
                cx + max(0, ax * r) + reach,
                cy + max(0, ay * r) + reach,
            ),
            setting.size,
        )
        if box is None:
            return None
        x = (np.arange(box[0], box[2], dtype=np.float32) - np.float32(cx))[None, :]
        y = (np.arange(box[1], box[3], dtype=np.float32) - np.float32(cy))[:, None]
        # a point sees the light past the sphere by how far its ray to the light passes the centre
        px, py = x - np.float32(ax * r), y - np.float32(ay * r)
        along = px * np.float32(lx) + py * np.float32(ly)
        miss = np.sqrt(np.maximum(px * px + py * py - along * along, 0)) - np.float32(r)
        width = np.float32(max(0.35, soft * rise))
        blocked = 1 / (1 + np.exp(np.clip(miss / (0.6 * width), -30, 30)))
        # cosine-weighted solid angle of a sphere that lies on the table
        near = np.float32(r * r) / (x * x + y * y + np.float32(r * r))
        return box, kept(direct, blocked, near * np.sqrt(near) * faded(x, y, 2.2 * r))
    h, w = what.coverage.shape
    t = what.thick
    most = spread(setting, t, rise)
    pad = ceil(2.5 * most + 0.8 * t) + 1
    x0, y0 = what.corner
    box = clipped(
        (
            x0 - pad + min(0, ax * t),
            y0 - pad + min(0, ay * t),
            x0 + w + pad + max(0, ax * t),
            y0 + h + pad + max(0, ay * t),
        ),
        setting.size,
    )
    if box is None:
        return None
    blocked = np.zeros((box[3] - box[1], box[2] - box[0]), np.float32)
    for part in (0.0, 0.33, 0.67, 1.0):
        cast = moved(what, box, ax * t * part, ay * t * part, spread(setting, t * part, rise))
        np.maximum(blocked, cast, out=blocked)
    hidden = 0.9 * moved(what, box, 0, 0, max(0.4, 0.35 * t))
    return box, kept(direct, blocked, hidden)
