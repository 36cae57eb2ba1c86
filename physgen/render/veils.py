"""Strength of the veils that objects cast on each other in the photo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from physgen.arrays import F32
from physgen.geometry.polygon import Array
from physgen.geometry.shadows import ShadowSetting, Silhouette
from physgen.photometry import DistantLight
from physgen.render.ball import sphere_shading
from physgen.render.occlusion import (
    occluders,
    occlusions,
)
from physgen.render.sprites import (
    Sprite,
)
from physgen.render.stage import ShadowBody


def measure_veils(
    sprites: Sequence[Sprite],
    actors: Sequence[ShadowBody],
    starts: Sequence[Silhouette],
    setting: ShadowSetting,
) -> tuple[list[ShadowBody], list[F32 | None]]:
    """Predict the veils that objects cast on each other, as strong as in the photo.

    Returns the actors with this strength, and the veil (h, w) of each sprite, -log of
    light.
    """
    neighbours = occluders(starts, setting)
    all_neighbours = {k: neighbours.get(k, []) for k in range(len(starts))}
    predictions = occlusions(starts, all_neighbours, setting)
    shares = {}
    for k, prediction in predictions.items():
        shares[k] = measure_veil_share(
            sprites[k], actors[k], starts[k], prediction, setting.light
        )
    # An object without a veil at the start gets the median strength for later ones.
    typical = float(np.median([*shares.values()])) if shares else 1.0
    visible_veils: list[F32 | None] = []
    veiled_actors = []
    for k, actor in enumerate(actors):
        share = shares.get(k, typical)
        veiled_actors.append(replace(actor, veil_share=share))
        veil: F32 | None = None
        if k in predictions and share != 0:
            veil = np.asarray(share * predictions[k], np.float32)
        visible_veils.append(veil)
    return veiled_actors, visible_veils


def measure_veil_share(
    sprite: Sprite,
    actor: ShadowBody,
    start: Silhouette,
    veil: F32,
    light: DistantLight,
) -> float:
    """Return the visible share 0..1 of a predicted veil (h, w) in the photo.

    Light between objects reduces a veil. Least squares on the logarithm of the light,
    beside Lambert's shading of a ball and a linear change over the face.
    """
    is_opaque = sprite.coverage >= 1
    if np.count_nonzero(is_opaque) < 80:
        return 0.0
    rows, columns = np.nonzero(is_opaque)
    mean_light = sprite.light[rows, columns].mean(axis=1)
    # Light is a product of factors: paint, shading and veils. Its logarithm is a sum.
    level = np.log(mean_light + 0.01).astype(np.float64)
    if actor.radius is not None:
        u = (columns + sprite.corner[0] - start.center[0]) / actor.radius
        v = (rows + sprite.corner[1] - start.center[1]) / actor.radius
        z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
        normal = [part.astype(np.float32) for part in (u, v, z)]
        level -= np.log(sphere_shading(light, *normal))
    x = columns - columns.mean()
    y = rows - rows.mean()
    # The unknowns are a constant, two slopes over the face and the share of the veil.
    terms = np.column_stack([np.ones(len(x)), x, y, -veil[rows, columns]])
    terms[:, 1:3] /= max(sprite.coverage.shape)
    return float(np.clip(_fit_weights(terms, level)[3], 0, 1))


VEIL_NOISE = 0.15
"""Error of log light above which a pixel counts less, as paint."""


def _fit_weights(terms: Array, level: Array) -> Array:
    """Return the weights (4,) of `terms` (n, 4) that explain `level` (n,).

    Iteratively reweighted least squares.
    """
    count = len(level)
    # A weak ridge decides where terms cannot be told apart.
    stiffness = 1e-3 * count * np.diag([0.0, 1, 1, 0.1])
    trust: Array = np.ones(count)
    weights: Array = np.zeros(4)
    for _ in range(4):
        weighted_terms = terms * trust[:, None]
        normal = weighted_terms.T @ terms + stiffness
        weights = np.asarray(
            np.linalg.solve(normal, weighted_terms.T @ level), np.float64
        )
        errors = np.abs(level - terms @ weights)
        # Huber weights: paint that does not follow the terms counts less.
        trust = 1 / np.maximum(errors / VEIL_NOISE, 1)
    return weights
