"""Silhouette and setting -> what is dark on all that the light falls on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.shadow.cast import Box, Setting, Silhouette
from physgen.shadow.floor import on_floor
from physgen.shadow.table import on_table
from physgen.shadow.wall import on_wall


def darkness(what: Silhouette, setting: Setting) -> tuple[Box, NDArray[np.float32]] | None:
    """Box of the photo and (h, w) -log of the light that is left there; None where it throws no shadow."""
    parts = [on_table(what, setting)] if setting.top else [on_floor(what, setting), on_wall(what, setting)]
    found = [part for part in parts if part is not None]
    if len(found) < 2:
        return found[0] if found else None
    x0, y0 = (min(part[0][k] for part in found) for k in (0, 1))
    x1, y1 = (max(part[0][k] for part in found) for k in (2, 3))
    total = np.zeros((y1 - y0, x1 - x0), np.float32)
    for (a, b, c, d), dark in found:
        total[b - y0 : d - y0, a - x0 : c - x0] += dark
    return (x0, y0, x1, y1), total
