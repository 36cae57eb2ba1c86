"""Exact places -> tracks as a tracker would give them: with noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from physgen.evaluate.plausibility.tracks import Tracks

Rng = np.random.Generator


def stranger(tracks: Tracks) -> Tracks:
    """As anybody's: no walls, pushes or joints are known; masses neither."""
    return replace(tracks, guided_bodies=frozenset(), masses=None)


def weighed(tracks: Tracks) -> Tracks:
    """The same with its masses."""
    return replace(tracks, guided_bodies=frozenset())


def shaken(tracks: Tracks, sigma: float, rng: Rng) -> Tracks:
    """Places with normal noise of `sigma` px along each axis; angles off by as much at the rim."""
    if sigma == 0:
        return tracks
    reach = np.array([max(form.reach, 4.0) for form in tracks.forms])
    places = tracks.places + rng.normal(0, sigma, tracks.places.shape)
    turned = rng.normal(0, 1, tracks.places.shape[:2]) * sigma / reach
    return replace(
        tracks,
        places=places,
        angles=None if tracks.angles is None else tracks.angles + turned,
    )
