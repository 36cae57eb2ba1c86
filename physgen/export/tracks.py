"""Points drawn in views -> where they are in every view of the clip, in closed form; and how they are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.export.places import is_ball

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
U16 = NDArray[np.uint16]

MARGIN = 2
"""px around a pixel that show the same thing, where points are drawn; less where a thing is too thin for it."""
UNDER = 1e-9
"""Radii below a ball's widest part from which a point is underneath."""


@dataclass(frozen=True)
class Filmed:
    """T views."""

    lenses: Array
    """(T, 2, 3): photo px -> video px."""
    poses: Array
    """(T, N, 3): x px, y px, angle rad, of bodies in the photo."""
    spaces: Array | None
    """(T, N, 3, 3): how bodies have turned in space; None: in the picture alone."""


@dataclass(frozen=True)
class Points:
    """K points as they were drawn."""

    body: Index
    """(K,): whose; -1 the background's."""
    frame: Index
    """(K,): the view in which they were drawn."""
    at: Array
    """(K, 2) px of that view."""


def tracked(points: Points, filmed: Filmed, world: World) -> tuple[Array, Mask]:
    """(K, T, 2) px of each view, also where they are hidden or out of the picture; and (K, T) who is underneath."""
    large = filmed.lenses[:, 0, 0]
    shift = filmed.lenses[:, 0, 2] + 1j * filmed.lenses[:, 1, 2]
    photo = (points.at[:, 0] + 1j * points.at[:, 1] - shift[points.frame]) / large[points.frame]
    there = np.empty((len(photo), len(large)), np.complex128)
    under = np.zeros(there.shape, bool)
    for body in np.unique(points.body).tolist():
        own = points.body == body
        frame, place = points.frame[own], photo[own]
        if body < 0:
            there[own] = place[:, None]
            continue
        poses, thing = filmed.poses[:, body], world.bodies[body]
        middle = poses[:, 0] + 1j * poses[:, 1]
        if filmed.spaces is not None and is_ball(thing) and thing.radius is not None:
            moved, under[own] = _rolled((place - middle[frame]) / thing.radius, frame, filmed.spaces[:, body])
            there[own] = middle + thing.radius * moved
        else:
            turn = np.exp(1j * poses[:, 2])
            there[own] = middle + ((place - middle[frame]) / turn[frame])[:, None] * turn
    seen = large * there + shift
    return np.stack([seen.real, seen.imag], axis=-1), under


def _rolled(place: Complex, frame: Index, spaces: Array) -> tuple[Complex, Mask]:
    """Points of a ball, radii from its middle in their views -> (K, T) those of all views; who is underneath.

    What a mask has beyond the rim goes with the rim, as `places.Ball` has it.
    """
    rim = place / np.maximum(np.abs(place), 1)
    towards = np.sqrt(np.maximum(1 - np.abs(rim) ** 2, 0))
    normals = np.stack([rim.real, rim.imag, -towards], axis=-1)
    first = np.einsum("kij,ki->kj", spaces[frame], normals)  # as they were at t = 0
    turned = np.einsum("tij,kj->kti", spaces, first)
    return turned[..., 0] + 1j * turned[..., 1] + (place - rim)[:, None], turned[..., 2] > UNDER


def shares(areas: Array, most: int, least: int, ground: float) -> Index:
    """(N + 1,) how many points each owner gets of `most`, by areas (N + 1,) px, the background's first.

    A share `ground` is the background's; things get `least` each where they are seen at all, the rest by area.
    """
    things = areas[1:]
    seen = things > 0
    counts = np.zeros(len(areas), np.int64)
    counts[0] = 0 if areas[0] == 0 else round(most * ground) if seen.any() else most
    counts[1:][seen] = least
    left = most - int(counts.sum())
    if left > 0 and seen.any():
        exact = left * things / things.sum()
        counts[1:] += np.floor(exact).astype(np.int64)
        short = left - int(np.floor(exact).sum())
        counts[1:][np.argsort(np.floor(exact) - exact, kind="stable")[:short]] += 1
    return counts


def drawn(ids: U16, wanted: Sequence[tuple[int, int]], rng: np.random.Generator) -> list[Array]:
    """(k, 2) px anywhere within pixels of a view, for each id and number k of `wanted`: well inside, where that is."""
    kernel = np.ones((2 * MARGIN + 1, 2 * MARGIN + 1), np.uint8)
    inner = cv2.erode(ids, kernel) == cv2.dilate(ids, kernel)
    found = []
    for id_, count in wanted:
        own = ids == id_
        where = np.flatnonzero(own & inner)
        where = where if len(where) else np.flatnonzero(own)
        picked = rng.choice(where, count)
        pixels = np.column_stack([picked % ids.shape[1], picked // ids.shape[1]])
        found.append(pixels + rng.uniform(-0.5, 0.5, (count, 2)))
    return found
