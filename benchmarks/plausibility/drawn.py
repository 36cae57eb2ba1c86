"""Tracks -> frames with every body's outline filled in with its id -> tracks from those masks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from physgen.evaluate.plausibility.tracks import Ids, Tracks, from_maps

LARGEST = 1024
"""px of a picture's side; what goes beyond is cut, as it is in a film."""
BITS = 4
"""Places are rounded to 1/16 px as they are drawn."""


def from_drawn(tracks: Tracks) -> Tracks:
    """What is known from ids alone: no angles, no outlines but discs, nothing of what is hidden."""
    seen = from_maps(tracks.name, _maps(tracks), 1 / tracks.step, tracks.view)
    return replace(seen, times=tracks.times, held=tracks.held, flat=tracks.flat)


def _maps(tracks: Tracks) -> Iterator[Ids]:
    """As large as the way of all bodies, the camera stands that far away."""
    reach = max(form.reach for form in tracks.forms) + 3
    low = np.maximum(tracks.places.min(axis=(0, 1)) - reach, -LARGEST / 4)
    width, height = (
        np.ceil(np.clip(tracks.places.max(axis=(0, 1)) + reach - low, 16, LARGEST)).astype(int).tolist()
    )
    for frame in range(len(tracks.times)):
        ids = np.zeros((height, width), np.uint8)
        for k, form in enumerate(tracks.forms):
            x, y = (tracks.places[frame, k] - low).tolist()
            if abs(x) > 4 * LARGEST or abs(y) > 4 * LARGEST:
                continue
            if form.round:
                center = round(x * 2**BITS), round(y * 2**BITS)
                cv2.circle(ids, center, round(form.reach * 2**BITS), k + 1, cv2.FILLED, cv2.LINE_8, BITS)
                continue
            angle = 0.0 if tracks.angles is None else tracks.angles[frame, k]
            c, s = np.cos(angle), np.sin(angle)
            for piece in form.pieces:
                points = piece @ np.array([[c, s], [-s, c]]) + (x, y)
                cv2.fillConvexPoly(ids, np.rint(points * 2**BITS).astype(np.int32), k + 1, cv2.LINE_8, BITS)
        yield ids
