"""Wheels of vehicles seen from the side, and the positions of their fronts.

Rims, hubs and treads are circles about one axle, so that gradients of the photo point
at it (Loy and Zelinsky, Fast radial symmetry for detecting points of interest, 2003).
The lowest point of the mask below an axle gives the wheel's radius.
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
"""Nouns of the material table for vehicles with wheels."""


@dataclass(frozen=True)
class WheelSearch:
    """Constants of the search, tuned on cars, buses and bicycles of COCO by eye."""

    # px: longer side of the object in the search.
    side: int = 240
    # Least probability of a vehicle's label for a search.
    probability: float = 0.3
    # Least radius over the object's height.
    least_radius: float = 0.07
    # Largest radius over the object's height.
    largest_radius: float = 0.32
    # Largest radius over the width, for an object much wider than high.
    flat_radius: float = 0.5
    step: float = 1.12  # ratio of neighbouring radii
    # Highest position of an axle over the height.
    low: float = 0.5
    # Least mean share of edge pixels on circles about an axle.
    circles: float = 0.35
    # Largest distance of the mask from the wheel's tread, in radii.
    arc: float = 0.12
    # Largest ratio of two wheels' radii.
    radius_ratio: float = 1.35
    # Least distance between two axles, in radii.
    distance: float = 2.1
    # Largest slope of the road under two wheels.
    level: float = 0.2
    # Least distance between two axles over the width; closer axles are at one end of
    # the vehicle.
    span: float = 0.42
    # Least confidence of written wheels.
    confidence: float = 0.84
    # Largest number of axle candidates.
    candidates: int = 12
    # Largest distance of the ground from the tread, in radii.
    ground: float = 0.25


SEARCH = WheelSearch()


@dataclass(frozen=True)
class Vehicle:
    """The wheels and the direction of a vehicle."""

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
        wheels_on_ground = tuple(_on_ground(wheel, walls) for wheel in wheels)
        facing = guess_facing(mask, wheels_on_ground)
        vehicles[item.id] = Vehicle(wheels_on_ground, facing, confidence)
    return vehicles


def may_drive(label: str, name: Name | None) -> bool:
    """Return whether the label, or a likely alternative, is a vehicle."""
    if kind(label).noun in VEHICLES:
        return True
    if name is None or label != name.label or kind(label).noun:
        return False
    chances = []
    for other, chance in name.alternatives:
        if kind(other).noun in VEHICLES:
            chances.append(chance)
    return sum(chances) >= SEARCH.probability


@dataclass(frozen=True, eq=False)
class _ObjectView:
    """An object in grey at the size of the search."""

    grey: NDArray[np.float32]  # (h, w)
    mask: Mask  # (h, w)
    # Column and row of the view's first pixel in the photo.
    corner: tuple[int, int]
    # Ratio of the view's pixels to the photo's along x and y.
    ratio: tuple[float, float]
    # Width of the object in the photo, px.
    width: int

    def place_wheel(self, axle: _Candidate) -> Wheel:
        """Return the wheel of an axle in pixels of the photo."""
        x = (axle.x + 0.5) / self.ratio[0] - 0.5 + self.corner[0]
        y = (axle.y + 0.5) / self.ratio[1] - 0.5 + self.corner[1]
        center = (round(float(x), 2), round(float(y), 2))
        return Wheel(center, round(float(axle.radius / self.ratio[1]), 2))


def find_wheels(rgb: Rgb, mask: Mask) -> tuple[tuple[Wheel, ...], float]:
    """Return the two wheels of an object, left to right, and their confidence.

    There are no wheels if fewer than two circles stand on the lower edge of the mask.
    """
    view = _crop_object(rgb, mask)
    least_span = SEARCH.span * view.width * view.ratio[0]
    pair = _best_pair(_find_axles(view.grey, view.mask), least_span)
    if pair is None:
        return (), 0.0
    confidence = min(0.95, 0.5 + 0.5 * min(axle.score for axle in pair))
    if confidence < SEARCH.confidence:
        return (), 0.0
    axles = sorted(pair, key=lambda candidate: candidate.x)
    wheels = tuple(map(view.place_wheel, axles))
    return wheels, round(confidence, 2)


def _crop_object(rgb: Rgb, mask: Mask) -> _ObjectView:
    """Return an object of the photo at the size of the search."""
    x0, y0, width, height = cv2.boundingRect(mask.astype(np.uint8))
    scale = SEARCH.side / max(width, height)
    pad = max(4, round(0.03 * max(width, height)))
    left = max(x0 - pad, 0)
    top = max(y0 - pad, 0)
    window = np.s_[top : y0 + height + pad, left : x0 + width + pad]
    rows, columns = mask[window].shape
    size = max(round(columns * scale), 8), max(round(rows * scale), 8)
    grey = _resize_to_grey(rgb[window], size, scale)
    small_mask = cv2.resize(
        mask[window].astype(np.uint8), size, interpolation=cv2.INTER_AREA
    )
    ratio = (size[0] / columns, size[1] / rows)
    return _ObjectView(grey, small_mask > 0, (left, top), ratio, width)


def _resize_to_grey(
    rgb: Rgb, size: tuple[int, int], scale: float
) -> NDArray[np.float32]:
    """Return the grey levels of a photo, scaled to `size`, width and height px."""
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    scaled = cv2.resize(rgb, size, interpolation=interpolation)
    return cv2.cvtColor(scaled, cv2.COLOR_RGB2GRAY).astype(np.float32)


def _find_axles(grey: NDArray[np.float32], mask: Mask) -> list[_Candidate]:
    """Return axles near the lower edge of an object, the most confident first."""
    rows = np.flatnonzero(mask.any(axis=1))
    height = int(np.ptp(rows)) + 1
    radii, largest = _list_radii(mask, height)
    votes = circle_votes(grey, mask, radii)
    bottoms = _bottoms(mask)
    evidence = np.sort(votes, axis=0)[-3:].mean(axis=0)
    evidence[: rows[0] + round(SEARCH.low * height)] = 0
    evidence[~mask] = 0
    reach = max(3, round(0.05 * height))
    axles: list[_Candidate] = []
    while len(axles) < SEARCH.candidates:
        y, x = np.unravel_index(int(evidence.argmax()), evidence.shape)
        score = float(evidence[y, x])
        if score < SEARCH.circles / 2:
            break
        # Suppress the neighbourhood of an axle, so that each axle is found once.
        evidence[
            max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1
        ] = 0
        radius = float(bottoms[x] - y)
        if SEARCH.least_radius * height <= radius <= 1.1 * largest:
            deviation = _off_tread(bottoms, float(x), float(y), radius)
            if deviation <= SEARCH.arc:
                axles.append(_Candidate(float(x), float(y), radius, score))
    return axles


def _list_radii(mask: Mask, height: int) -> tuple[list[float], float]:
    """Return the searched radii of an object's wheels, and the largest possible one."""
    width = int(np.ptp(np.flatnonzero(mask.any(axis=0)))) + 1
    largest = min(SEARCH.largest_radius * height, 0.5 * width)
    if width > 2.5 * height:
        largest = min(SEARCH.flat_radius * height, 0.5 * width)
    radii = [max(SEARCH.least_radius * height, 3.0)]
    while radii[-1] * SEARCH.step < largest:
        radii.append(radii[-1] * SEARCH.step)
    return radii, largest


def _bottoms(mask: Mask) -> Array:
    """Return the row of the lowest pixel of each column `(w,)`, or -inf without one."""
    height = len(mask)
    lowest = height - mask[::-1].argmax(axis=0) - 0.5
    return np.where(mask.any(axis=0), lowest, -np.inf)


def _off_tread(bottoms: Array, x: float, y: float, radius: float) -> float:
    """Return the deviation of the mask's lower edge from a wheel's tread, in radii."""
    half_width = 0.6 * radius
    columns = np.arange(
        max(round(x - half_width), 0), min(round(x + half_width) + 1, len(bottoms))
    )
    tread = y + np.sqrt(np.maximum(radius**2 - (columns - x) ** 2, 0))
    deviation = np.abs(bottoms[columns] - tread)
    return float(np.median(deviation)) / radius


def _best_pair(
    candidates: Sequence[_Candidate], span: float
) -> tuple[_Candidate, _Candidate] | None:
    """Return the two most confident axles of one vehicle, at least `span` px apart."""
    best = None
    best_score = 2 * SEARCH.circles
    for left, right in combinations(candidates, 2):
        small, large = sorted((left.radius, right.radius))
        distance = abs(left.x - right.x)
        rise = abs((left.y + left.radius) - (right.y + right.radius))
        if large > SEARCH.radius_ratio * small:
            continue
        if distance < max(SEARCH.distance * large, span):
            continue
        if rise > SEARCH.level * distance:
            continue
        if left.score + right.score > best_score:
            best = (left, right)
            best_score = left.score + right.score
    return best


def _on_ground(wheel: Wheel, walls: Sequence[Wall]) -> Wheel:
    """Return the wheel between its axle and the ground near its tread."""
    x, y = wheel.center
    for wall in walls:
        for (ax, ay), (bx, end_y) in zip(wall.points, wall.points[1:], strict=False):
            if not min(ax, bx) <= x <= max(ax, bx) or ax == bx:
                continue
            ground = ay + (end_y - ay) * (x - ax) / (bx - ax)
            gap = ground - (y + wheel.radius)
            if abs(gap) <= SEARCH.ground * wheel.radius and abs(end_y - ay) < abs(
                bx - ax
            ):
                radius = round(wheel.radius + gap / 2, 2)
                return Wheel((x, round(float(ground) - radius, 2)), radius)
    return wheel


def guess_facing(mask: Mask, wheels: Sequence[Wheel]) -> Facing:
    """Return the direction of the front: away from the cabin, which is behind the
    middle.
    """
    columns = np.flatnonzero(mask.any(axis=0))
    tops = mask[:, columns].argmax(axis=0)
    bottom = max(wheel.center[1] + wheel.radius for wheel in wheels)
    heights = bottom - tops
    cabin = columns[heights > 0.8 * heights.max()]
    middle = float(np.mean([wheel.center[0] for wheel in wheels]))
    if float(cabin.mean()) > middle:
        return Facing.LEFT
    return Facing.RIGHT
