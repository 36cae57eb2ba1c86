"""Wheels of vehicles seen from the side, and where their fronts are.

Rims, hubs and treads are circles about one axle: gradients of the photo point at it
(Loy and Zelinsky, Fast radial symmetry for detecting points of interest, 2003). The
lowest point of the mask below an axle gives the wheel's radius.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.circle_votes import circle_votes
from physgen.geometry.polygon import Array
from physgen.materials import kind
from physgen.perceive.roles import Labels, Mask, Name, PhotoObject, Rgb, Wall
from physgen.scene.scene import Facing, Wheel

VEHICLES = {
    *("toy car", "die-cast car", "toy train", "toy motorcycle"),
    *("skateboard", "bicycle"),
}
"""Nouns of the material table: what drives on wheels."""


@dataclass(frozen=True)
class WheelSearch:
    """Constants of the search, tuned on cars, buses and bicycles of COCO by eye."""

    side: int = 240  # px: longer side of the object when it is searched
    likely: float = 0.3  # probability of a vehicle's label from which it is searched
    least: float = 0.07  # radius over the object's height
    most: float = 0.32
    flat: float = 0.5  # of the width: most radius of an object much wider than high
    step: float = 1.12  # ratio of neighbouring radii
    low: float = 0.5  # of the height: axles are lower
    circles: float = 0.35  # mean share of a circle about an axle that is an edge
    arc: float = 0.12  # of the radius by which the mask may leave the wheel's tread
    alike: float = 1.35  # ratio of two wheels' radii, at most
    apart: float = 2.1  # radii between two axles, at least
    level: float = 0.2  # slope of the road that two wheels stand on, at most
    span: float = 0.42  # of the width between two axles: less is one end of it
    sure: float = 0.84  # confidence from which wheels are written
    candidates: int = 12
    ground: float = 0.25  # of the radius by which the ground may be off


SEARCH = WheelSearch()


@dataclass(frozen=True)
class Vehicle:
    """What lets an object drive."""

    wheels: tuple[Wheel, ...]
    facing: Facing
    confidence: float


@dataclass(frozen=True)
class _Candidate:
    x: float
    y: float
    radius: float
    score: float


def find_vehicles(
    rgb: Rgb,
    labels: Labels,
    objects: Sequence[PhotoObject],
    names: Mapping[int, Name],
    walls: Sequence[Wall],
) -> dict[int, Vehicle]:
    """Return the vehicles among the objects of a photo from the side, by id."""
    vehicles = {}
    for item in objects:
        if item.cut or not may_drive(item.label, names.get(item.id)):
            continue
        mask = labels == item.id
        wheels, confidence = find_wheels(rgb, mask)
        if not wheels:
            continue
        grounded = tuple(_on_ground(wheel, walls) for wheel in wheels)
        facing = guess_facing(mask, grounded)
        vehicles[item.id] = Vehicle(grounded, facing, confidence)
    return vehicles


def may_drive(label: str, name: Name | None) -> bool:
    """Return whether a label, or one that the object may have, is a vehicle's."""
    if kind(label).noun in VEHICLES:
        return True
    if name is None or label != name.label or kind(label).noun:
        return False
    likely = [chance for other, chance in name.likely if kind(other).noun in VEHICLES]
    return sum(likely) >= SEARCH.likely


def find_wheels(rgb: Rgb, mask: Mask) -> tuple[tuple[Wheel, ...], float]:
    """Return the two wheels of an object, left to right, and their confidence.

    Without wheels if fewer than two circles stand on the lower edge of its mask.
    """
    x0, y0, width, height = cv2.boundingRect(mask.astype(np.uint8))
    scale = SEARCH.side / max(width, height)
    pad = max(4, round(0.03 * max(width, height)))
    left, top = max(x0 - pad, 0), max(y0 - pad, 0)
    part = np.s_[top : y0 + height + pad, left : x0 + width + pad]
    size = (
        max(round(rgb[part].shape[1] * scale), 8),
        max(round(rgb[part].shape[0] * scale), 8),
    )
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    grey = cv2.cvtColor(
        cv2.resize(rgb[part], size, interpolation=how), cv2.COLOR_RGB2GRAY
    )
    own = cv2.resize(mask[part].astype(np.uint8), size, interpolation=cv2.INTER_AREA)
    span = SEARCH.span * width * size[0] / rgb[part].shape[1]
    pair = _best_pair(_candidates(grey.astype(np.float32), own > 0), span)
    if pair is None:
        return (), 0.0
    ratio = (size[0] / rgb[part].shape[1], size[1] / rgb[part].shape[0])
    wheels = []
    for one in sorted(pair, key=lambda candidate: candidate.x):
        x = (one.x + 0.5) / ratio[0] - 0.5 + left
        y = (one.y + 0.5) / ratio[1] - 0.5 + top
        radius = one.radius / ratio[1]
        center = (round(float(x), 2), round(float(y), 2))
        wheels.append(Wheel(center, round(float(radius), 2)))
    confidence = min(0.95, 0.5 + 0.5 * min(one.score for one in pair))
    if confidence < SEARCH.sure:
        return (), 0.0
    return tuple(wheels), round(confidence, 2)


def _candidates(grey: NDArray[np.float32], own: Mask) -> list[_Candidate]:
    """Return axles near the lower edge of an object, the surest first."""
    rows = np.flatnonzero(own.any(axis=1))
    columns = np.flatnonzero(own.any(axis=0))
    height, width = int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1
    largest = min(SEARCH.most * height, 0.5 * width)
    if width > 2.5 * height:
        largest = min(SEARCH.flat * height, 0.5 * width)
    radii = [max(SEARCH.least * height, 3.0)]
    while radii[-1] * SEARCH.step < largest:
        radii.append(radii[-1] * SEARCH.step)
    votes = circle_votes(grey, own, radii)
    bottoms = _bottoms(own)
    evidence = np.sort(votes, axis=0)[-3:].mean(axis=0)
    evidence[: rows[0] + round(SEARCH.low * height)] = 0
    evidence[~own] = 0
    found = []
    while len(found) < SEARCH.candidates:
        y, x = np.unravel_index(int(evidence.argmax()), evidence.shape)
        score = float(evidence[y, x])
        if score < SEARCH.circles / 2:
            break
        reach = max(3, round(0.05 * height))
        near = np.s_[
            max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1
        ]
        evidence[near] = 0
        radius = float(bottoms[x] - y)
        if SEARCH.least * height <= radius <= 1.1 * largest:
            off = _off_tread(bottoms, float(x), float(y), radius)
            if off <= SEARCH.arc:
                found.append(_Candidate(float(x), float(y), radius, score))
    return found


def _bottoms(own: Mask) -> Array:
    """Return `(w,)` the row of the lowest pixel of each column, -inf without one."""
    height = len(own)
    lowest = height - own[::-1].argmax(axis=0) - 0.5
    return np.where(own.any(axis=0), lowest, -np.inf)


def _off_tread(bottoms: Array, x: float, y: float, radius: float) -> float:
    """Return by how much the mask's lower edge leaves a wheel's, in radii."""
    half = 0.6 * radius
    columns = np.arange(max(round(x - half), 0), min(round(x + half) + 1, len(bottoms)))
    tread = y + np.sqrt(np.maximum(radius**2 - (columns - x) ** 2, 0))
    off = np.abs(bottoms[columns] - tread)
    return float(np.median(off)) / radius


def _best_pair(
    candidates: Sequence[_Candidate], span: float
) -> tuple[_Candidate, _Candidate] | None:
    """Return the two surest axles of one vehicle, `span` px apart or more."""
    best, most = None, 2 * SEARCH.circles
    for one, other in combinations(candidates, 2):
        small, large = sorted((one.radius, other.radius))
        distance = abs(one.x - other.x)
        rise = abs((one.y + one.radius) - (other.y + other.radius))
        if large > SEARCH.alike * small:
            continue
        if distance < max(SEARCH.apart * large, span):
            continue
        if rise > SEARCH.level * distance:
            continue
        if one.score + other.score > most:
            best, most = (one, other), one.score + other.score
    return best


def _on_ground(wheel: Wheel, walls: Sequence[Wall]) -> Wheel:
    """Return the wheel between its axle and the ground that is near its tread."""
    x, y = wheel.center
    for wall in walls:
        for (ax, ay), (bx, by) in zip(wall.points, wall.points[1:], strict=False):
            if not min(ax, bx) <= x <= max(ax, bx) or ax == bx:
                continue
            ground = ay + (by - ay) * (x - ax) / (bx - ax)
            off = ground - (y + wheel.radius)
            if abs(off) <= SEARCH.ground * wheel.radius and abs(by - ay) < abs(bx - ax):
                radius = round(wheel.radius + off / 2, 2)
                return Wheel((x, round(float(ground) - radius, 2)), radius)
    return wheel


def guess_facing(mask: Mask, wheels: Sequence[Wheel]) -> Facing:
    """Return where the front is: away from the cabin, which is behind the middle."""
    columns = np.flatnonzero(mask.any(axis=0))
    tops = mask[:, columns].argmax(axis=0)
    bottom = max(wheel.center[1] + wheel.radius for wheel in wheels)
    heights = bottom - tops
    cabin = columns[heights > 0.8 * heights.max()]
    middle = float(np.mean([wheel.center[0] for wheel in wheels]))
    return Facing.LEFT if float(cabin.mean()) > middle else Facing.RIGHT
