"""Shadows that keep their shape and move along -> how dark they make the background, many at a time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.render.atlas import GAP, Strip, laid, shared, warped
from physgen.render.lit import Cast
from physgen.render.placing import Slices
from physgen.render.stage import Stand

F32 = NDArray[np.float32]


class Slides:
    """The sliding shadows of a background taken apart."""

    def __init__(self, casts: Sequence[Cast]) -> None:
        sliding = [(k, *cast.sliding) for k, cast in enumerate(casts) if cast.sliding is not None]
        self._homes: dict[int, tuple[_Row, int]] = {}
        for members in shared([picture.shape[::-1] for _, _, picture in sliding]):
            row = _Row([sliding[i][1:] for i in members])
            self._homes |= {sliding[i][0]: (row, place) for place, i in enumerate(members)}

    def thrown(self, dark: F32, stands: Iterable[Stand]) -> list[Slices]:
        """Put the shadows of those of `stands` that slide into `dark` (H, W); returns where anything changed."""
        together: dict[int, tuple[_Row, list[tuple[int, Stand]]]] = {}
        for stand in stands:
            if stand.k in self._homes:
                row, place = self._homes[stand.k]
                together.setdefault(id(row), (row, []))[1].append((place, stand))
        return [box for row, some in together.values() for box in row.thrown(dark, some)]


class _Row:
    def __init__(self, members: Sequence[tuple[tuple[int, int], F32]]) -> None:
        self.picture, self.left = laid([picture for _, picture in members], cv2.BORDER_CONSTANT)
        self.corner = np.array([corner for corner, _ in members], np.float64)
        self.size = np.array([picture.shape[::-1] for _, picture in members])

    def thrown(self, dark: F32, some: Sequence[tuple[int, Stand]]) -> list[Slices]:
        which = np.array([place for place, _ in some])
        shift = np.array([(s.pose.x - s.start.x, s.pose.y - s.start.y) for _, s in some])
        at = self.corner[which] + shift
        first = np.floor(at)
        low = np.maximum(first, 0)
        high = np.minimum(first + self.size[which] + 1, dark.shape[::-1])
        seen = ((high > low).all(axis=1) & np.isfinite(at).all(axis=1)).nonzero()[0]
        if not len(seen):
            return []
        which, at, low, high = which[seen], at[seen], low[seen].astype(int), high[seen].astype(int)
        w, h = (high - low).max(axis=0).tolist()
        strip = Strip(len(seen), (h, w))
        x, y = strip.empty(), strip.empty()
        x[:] = strip.columns + strip.along(low[:, 0] - at[:, 0] + self.left[which])
        np.add(strip.rows, strip.along(low[:, 1] - at[:, 1] + GAP), out=y)
        picture = warped(self.picture, x, y)
        boxes: list[Slices] = []
        for j, (left, top, right, bottom) in enumerate(np.hstack([low, high]).tolist()):
            box = np.s_[top:bottom, left:right]
            dark[box] += picture[: bottom - top, j * w : j * w + right - left]
            boxes.append(box)
        return boxes
