"""Depth, volume, mass and true size of objects by their outlines, and the photo's
scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import exp, hypot, log, pi, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import (
    Array,
    Disc,
    Outline,
    Region,
    Ring,
    bounds,
    mass_properties,
)
from physgen.geometry.raster import coverage
from physgen.materials import Kind

PAPER_SCALE = 100
"""Scale of scene files without one, px/m: the paper's 1 px = 1 cm."""
MIN_SCALE_CONFIDENCE = 0.35
"""Confidence above which a scene uses the estimated scale: an error of 30 %. The assumed
scale is wrong by a factor of two as often as not.
"""


@dataclass(frozen=True)
class _ShapeLimits:
    """Limits for solids of revolution, and for the view of an object.

    Costs are |log| of an aspect ratio.
    """

    slices: int = 480
    """Grid cells along the longer side of a solid of revolution."""
    boxy: float = 0.88
    """Share of its smallest box above which an outline is that of a box."""
    lying: float = 0.25
    """Cost of an inclined axis."""
    end_on: float = 0.4
    """Cost of a view from the object's end."""
    flat_depth: float = 0.2
    """Depth over width of a disc or ring of unknown thickness."""


@dataclass(frozen=True)
class _ScaleLimits:
    """Limits for objects that count for the scale; spreads are standard deviations of
    log size.
    """

    min_label: float = 0.7
    """Minimum confidence of a label: a guess from a shape has no size."""
    max_mismatch: float = 0.6
    """Maximum |log| of proportions: beyond it, a part is hidden, or the label
    is wrong.
    """
    any_size: float = 0.5
    """Spread above which an object does not count: a plank has any length."""
    vague_spread: float = 0.3
    """Spread at which the confidence is 1 / e."""
    judged_spread: float = 0.1
    """Minimum spread of a size estimated by eye."""


SHAPE, LIMITS = _ShapeLimits(), _ScaleLimits()


@dataclass(frozen=True)
class PhotoObject:
    """An object of the photo: its id in the label map, its outline, and its label."""

    id: int
    outline: Outline
    label: str = ""
    """The label; `""` before labelling."""
    cut: bool = False
    """Whether the photo's border cuts the object off."""
    top: float = 0.0
    """Height of its mask above its front, px, for an outline half-way to its back."""


def photo_object(
    id_: int, outline: Outline, label: str, size: tuple[int, int]
) -> PhotoObject:
    """Create an object; its `cut` follows from the photo's width and height `size`."""
    x0, y0, x1, y1 = bounds(outline)
    is_cut = min(x0, y0) < 0 or x1 > size[0] - 1 or y1 > size[1] - 1
    return PhotoObject(id_, outline, label, is_cut)


@dataclass(frozen=True)
class Extent:
    """Measures of an object from its outline and kind."""

    volume: float
    """Volume with hollows, px³."""
    per_mm: float | None
    """px per mm at its ordinary size; None without one."""
    mismatch: float
    """|log| of its proportions over the ordinary ones; 0 for unknown proportions."""


@dataclass(frozen=True)
class SolidOfRevolution:
    """A solid of revolution from the mirror-symmetric part of an outline, px."""

    volume: float
    height: float
    """Length along its axis."""
    diameter: float
    """Largest diameter."""


def object_extent(outline: Outline, kind: Kind) -> Extent:
    """Return size and depth of an object with this outline (px) and of this kind.

    The sides of the ordinary object tell hidden sizes: the two sides that fit the
    outline best are visible, and the third is the depth. A bottle's depth is its width,
    slice by slice.
    """
    if kind.form == "turned":
        return _turned_extent(outline, kind)
    area = mass_properties(outline).area
    long, short = box_sides(outline)
    if kind.form == "ball":
        if isinstance(outline, Disc):
            diameter = long
        else:
            diameter = 2 * sqrt(area / pi)
        if kind.size:
            per_mm = long / kind.size[0]
        else:
            per_mm = None
        return Extent(area * diameter * 2 / 3, per_mm, log(long / short))
    if kind.box is None:
        return Extent(area * _mean_depth(outline, kind.form), None, 0.0)
    visible, depth, mismatch = _facing(long / short, kind.box)
    per_mm = long / visible[0]
    rounding = _rounding(kind, shows_face=min(depth, visible[1]) == depth)
    if kind.form == "hoop" and isinstance(outline, Disc):
        rounding *= kind.share  # its hole is not in the outline
    if kind.share < SHAPE.boxy and mismatch < LIMITS.max_mismatch:
        # A rectangle around a fork covers air, too.
        area = min(area, kind.share * long * short)
    return Extent(area * depth * per_mm * rounding, per_mm, mismatch)


def _rounding(kind: Kind, shows_face: bool) -> float:
    """Return the mean depth over the largest; discs seen from their face have a
    constant depth.
    """
    if kind.form == "lump":
        return 2 / 3
    if kind.form == "slab" or shows_face:
        return 1.0
    return pi / 4


def box_sides(outline: Outline) -> tuple[float, float]:
    """Return the longer and the shorter side of the smallest rotated box around an
    outline, px.
    """
    if isinstance(outline, Disc):
        return 2 * outline.radius, 2 * outline.radius
    points = np.concatenate([ring.outer for ring in outline.rings]).astype(np.float32)
    (_, (w, h), _) = cv2.minAreaRect(points)
    x0, y0, x1, y1 = bounds(outline)
    smallest_side = 1e-3 * max(x1 - x0, y1 - y0)
    return max(float(w), float(h), smallest_side), max(
        min(float(w), float(h)), smallest_side
    )


def revolve(outline: Region, axis: Array) -> SolidOfRevolution:
    """Revolve an outline about the line along `axis` (2,) with the largest volume.

    In each slice only the symmetric part counts, so that a mug's handle is left out.
    """
    radii, scale = _symmetric_radii(outline, axis)
    best = radii[:, int(np.argmax((radii**2).sum(axis=0)))]
    # A narrow end, such as a stalk or a spout, does not count for the height.
    slices = np.count_nonzero(best > 0.05 * best.max())
    volume = float(pi * (best**2).sum() / scale)
    return SolidOfRevolution(volume, float(slices) / scale, float(2 * best.max()))


def _symmetric_radii(outline: Region, axis: Array) -> tuple[Array, float]:
    """Return the symmetric half-widths (slices, places) px about lines along `axis`.

    Also returns the number of slices per px.
    """
    unit_axis = np.asarray(axis, float) / np.hypot(*axis)
    across_axis = np.array([-unit_axis[1], unit_axis[0]])
    frame = np.stack([across_axis, unit_axis])
    points = np.concatenate([ring.outer for ring in outline.rings]) @ frame.T
    lower_corner = points.min(axis=0)
    size = np.ptp(points, axis=0)
    scale = SHAPE.slices / max(size)

    def place(points: Array) -> Array:
        return np.asarray((points @ frame.T - lower_corner) * scale - 0.5)

    rings = []
    for ring in outline.rings:
        rings.append(Ring(place(ring.outer), tuple(map(place, ring.holes))))
    width, height = np.ceil(size * scale).astype(int).tolist()
    # Rasterize the outline with rows across the axis, so that each row is one slice.
    is_inside = coverage(Region(tuple(rings)), (width, height)) >= 0.5
    return _reach_within_rows(is_inside) / scale, scale


def _reach_within_rows(is_inside: NDArray[np.bool_]) -> Array:
    """Return the distance of each pixel to the nearest end of its run in its row, px; 0
    outside.
    """
    width = is_inside.shape[1]
    columns = np.arange(width)
    # For each place, find the nearest pixels outside on both sides of its row.
    outside_before = np.maximum.accumulate(np.where(is_inside, -1, columns), axis=1)
    reversed_ends = np.where(is_inside, width, columns)[:, ::-1]
    outside_after = np.minimum.accumulate(reversed_ends, axis=1)[:, ::-1]
    reach = np.minimum(columns - outside_before, outside_after - columns) - 0.5
    return np.where(is_inside, reach, 0.0)


def _turned_extent(outline: Outline, kind: Kind) -> Extent:
    """Return size and depth of a solid of revolution: upright, lying, or seen from its
    end.
    """
    area = mass_properties(outline).area
    end_on = _extent_from_end(outline, kind, area)
    if isinstance(outline, Disc):
        return end_on or Extent(area * 2 * outline.radius, None, 0.0)
    upright = revolve(outline, np.array([0.0, 1.0]))
    lying = [revolve(outline, axis) for axis in _box_axes(outline)]
    if end_on is None or kind.size is None:
        slenderest = max([upright, *lying], key=_slenderness)
        return Extent(slenderest.volume, None, 0.0)
    candidates = []
    for solid in (upright, *lying):
        if solid.volume > 0:
            extent = _solid_extent(solid, kind.size)
            cost = 0.0 if solid is upright else SHAPE.lying
            candidates.append((extent.mismatch + cost, extent))
    # For equal costs the first candidate wins: a view from the end is last.
    candidates.append((end_on.mismatch + SHAPE.end_on, end_on))
    return min(candidates, key=lambda candidate: candidate[0])[1]


def _solid_extent(solid: SolidOfRevolution, size: tuple[float, ...]) -> Extent:
    """Return the extent of a solid if its kind has this height and width, mm."""
    height, width = size
    tallness = solid.height / height
    breadth = solid.diameter / width
    mismatch = abs(log(tallness / breadth))
    return Extent(solid.volume, sqrt(tallness * breadth), mismatch)


def _extent_from_end(outline: Outline, kind: Kind, area: float) -> Extent | None:
    """Return size and depth of a solid seen from its end; None for an unknown size."""
    if not kind.size:
        return None
    long, short = box_sides(outline)
    height, width = kind.size
    per_mm = long / width
    return Extent(area * height * per_mm * kind.share, per_mm, log(long / short))


def _slenderness(solid: SolidOfRevolution) -> float:
    """Return height over diameter."""
    return solid.height / max(solid.diameter, 1e-6)


def _box_axes(outline: Region) -> tuple[Array, Array]:
    """Return the directions of the sides of the smallest box."""
    points = np.concatenate([ring.outer for ring in outline.rings]).astype(np.float32)
    turn = np.deg2rad(cv2.minAreaRect(points)[2])
    front_axis = np.array([np.cos(turn), np.sin(turn)])
    return front_axis, np.array([-front_axis[1], front_axis[0]])


def _facing(
    aspect: float, box: tuple[float, float, float]
) -> tuple[tuple[float, float], float, float]:
    """Return the visible sides (mm) of a box, its hidden side, and the mismatch.

    The visible sides fit the aspect ratio best; the mismatch is |log| of the
    difference.
    """
    candidates = []
    for hidden_index, pair in zip((2, 1, 0), combinations(range(3), 2), strict=True):
        short, long = sorted((box[pair[0]], box[pair[1]]))
        mismatch = abs(log(aspect * short / long))
        if long == max(box):
            cost = mismatch
        else:
            cost = mismatch + SHAPE.end_on
        candidates.append(
            (cost, hidden_index, (long, short), box[hidden_index], mismatch)
        )
    _, _, visible, depth, mismatch = min(candidates)
    return visible, depth, mismatch


def _mean_depth(outline: Outline, form: str) -> float:
    """Return the depth, px, of an object of unknown proportions."""
    long, short = box_sides(outline)
    if form in ("disc", "hoop"):
        if long < 2 * short:
            return SHAPE.flat_depth * long
        return long * pi / 4
    is_boxy = mass_properties(outline).area / (long * short) > SHAPE.boxy
    if form == "slab" or (form == "" and is_boxy):
        return short
    return short * 2 / 3


@dataclass(frozen=True)
class WeighingConstants:
    """Constants of the masses."""

    unscaled_confidence: float = 0.3
    """Maximum confidence of a mass with an assumed scale."""
    standard: float = 0.05
    """Spread of sizes up to which a kind has one standard mass."""
    like: float = 0.4
    """|log| of the size ratio up to which an object may be the ordinary one."""
    lightest: float = 1e-3
    """Minimum mass, g."""


WEIGHING = WeighingConstants()


def weigh(
    outline: Outline, kind: Kind, pixels_per_meter: float
) -> tuple[float, float, str]:
    """Return the mass in g to three digits, its confidence and an explanation."""
    extent = object_extent(outline, kind)
    mass, confidence, reason = _mass(extent, kind, pixels_per_meter)
    return float(f"{max(mass, WEIGHING.lightest):.3g}"), confidence, reason


def _mass(
    extent: Extent, kind: Kind, pixels_per_meter: float
) -> tuple[float, float, str]:
    """Return the mass in g, its confidence and an explanation."""
    volume = extent.volume / pixels_per_meter**3 * 1e6
    kind = kind.hollowed(10 * (6 * volume / pi) ** (1 / 3))
    mass = volume * kind.density
    estimate = f"{float(f'{volume:.3g}'):,g} cm³ of {_stuff(kind)}"
    if kind.mass is None:
        return mass, _confidence_of_kind(kind), estimate
    # An object of unusual size does not have the mass of an ordinary one.
    size_ratio = 0.0
    if extent.per_mm is not None:
        size_ratio = log(extent.per_mm * 1000 / pixels_per_meter)
    if abs(size_ratio) >= WEIGHING.like:
        return mass, 0.4, f"{estimate}; an ordinary {kind.noun} has another size"
    if kind.spread <= WEIGHING.standard:
        source = kind.source.replace("EST: ", "").replace("EST", "estimated")
        return kind.mass, 0.8, f"an ordinary {kind.noun} ({source})"
    ordinary = f"an ordinary {kind.noun}, {kind.mass:g} g"
    return sqrt(mass * kind.mass), 0.6, f"between {estimate}, and {ordinary}"


def _confidence_of_kind(kind: Kind) -> float:
    """Return the confidence of a mass by volume and density alone."""
    if kind.noun:
        return 0.4
    if kind.material.name != "unknown":
        return 0.35
    return 0.15


def _stuff(kind: Kind) -> str:
    """Describe the material in words.

    >>> from physgen.materials import kind
    >>> _stuff(kind("steel ball")), _stuff(kind("beer bottle"))
    ('steel, 7.85 g/cm³', 'glass and content, 1.19 g/cm³')
    """
    name = kind.material.name
    solid = kind.material.density
    if name == "unknown":
        name = "an unknown material"
    if kind.holds:
        return f"{name} and content, {kind.density:.3g} g/cm³"
    if abs(kind.filled - 1) < 0.01:
        return f"{name}, {solid:g} g/cm³"
    if kind.filled > 1:
        return f"{name}, {kind.density:.3g} g/cm³ in all"
    return f"{name}, {solid:g} g/cm³ and {100 * kind.filled:.2g} % of the volume"


@dataclass(frozen=True)
class Scale:
    """The scale of a photo."""

    pixels_per_meter: float
    """Scale, px/m, with significant digits only."""
    confidence: float
    """0..1: 0.6 at an uncertainty of 20 %, 0.9 at 7 %."""
    reason: str


def photo_scale(
    objects: Sequence[PhotoObject],
    kinds: Mapping[int, Kind],
    confidences: Mapping[int, float] | None = None,
) -> Scale | None:
    """Estimate the photo's scale by the ordinary sizes of its objects.

    `confidences` are the confidences of labels, 1 by default. All objects of one kind
    are one witness, by their median. The result is the median of the witnesses,
    weighted by the spread of their sizes. Cut objects do not count. None without any
    witness.
    """
    witnesses: dict[str, list[tuple[float, float]]] = {}
    for item in objects:
        object_kind = kinds[item.id]
        confidence = (confidences or {}).get(item.id, 1.0)
        has_size = bool(object_kind.size) and object_kind.spread < LIMITS.any_size
        if item.cut or not has_size or confidence < LIMITS.min_label:
            continue
        extent = object_extent(item.outline, object_kind)
        if extent.per_mm and extent.mismatch < LIMITS.max_mismatch:
            # The uncertainty of a witness: the spread of its kind, and the mismatch of
            # its shape.
            spread = hypot(object_kind.spread, extent.mismatch / 2)
            witnesses.setdefault(object_kind.noun, []).append((extent.per_mm, spread))
    if not witnesses:
        return None
    middle, spread = _combine(list(witnesses.values()))
    confidence = 0.95 * exp(-((spread / LIMITS.vague_spread) ** 2))
    # Do not pretend more precision than the spread allows.
    digits = 2
    if spread < 0.05:
        digits = 3
    value = float(f"{exp(middle) * 1000:.{digits}g}")
    return Scale(value, round(confidence, 2), _reason(witnesses, kinds, spread))


def _combine(
    witnesses: Sequence[Sequence[tuple[float, float]]],
) -> tuple[float, float]:
    """Return log of the scale, px/mm, and its standard deviation, from all
    witnesses.
    """
    medians = [np.median([scale for scale, _ in witness]) for witness in witnesses]
    spreads = [np.median([spread for _, spread in witness]) for witness in witnesses]
    logs = np.log(np.array(medians))
    weights = np.array(spreads) ** -2.0
    middle = _weighted_median(logs, weights)
    # The uncertainty is that of the witnesses, or their disagreement, if it is larger.
    variance = (weights * (logs - middle) ** 2).sum() / weights.sum()
    disagreement = np.sqrt(variance / max(len(logs) - 1, 1))
    return middle, max(float(weights.sum() ** -0.5), float(disagreement))


@dataclass(frozen=True)
class _Playback:
    """The photo's assumed size, and typical times of a push and a clip."""

    width: float = 0.5
    """Longer side of a photo without a known scale, m: a table top seen from nearby."""
    gravity: float = 9.8
    """Gravity, m/s²."""
    fall: float = 0.15
    """Height of a fall, as a share of the photo's longer side, that gives a push its
    speed.
    """
    crossing: float = 1.5
    """Approximate time of the video in which a push crosses the photo, s."""
    longest: float = 2.5
    """Duration of visible motion in the video, s, above which slow motion is
    reduced.
    """
    pause: float = 0.7
    """Duration of the video after the motion, s."""
    shortest: float = 2.5
    """Minimum duration of a clip, s."""
    least_motion: float = 1.0
    """Minimum duration of the motion by a push in the video, s."""


PLAYBACK = _Playback()


def assumed_scale(side: int) -> float:
    """Return the assumed scale, px/m, of a photo with this longer side, px."""
    return side / PLAYBACK.width


def is_assumed(pixels_per_meter: float, side: int) -> bool:
    """Check whether a scale is an assumed one, by perception or by the paper."""
    return pixels_per_meter in (PAPER_SCALE, assumed_scale(side))


def scale_entry(
    side: int, user_scale: float | None, photo_scale: Scale | None
) -> tuple[float, str]:
    """Return px/m for the scene, and its comment.

    The user's number has priority, then a scale with sufficient confidence.
    """
    if user_scale is not None:
        return user_scale, "as given"
    if photo_scale is not None and photo_scale.confidence >= MIN_SCALE_CONFIDENCE:
        comment = f"{photo_scale.reason} (confidence {photo_scale.confidence:g})"
        return photo_scale.pixels_per_meter, comment
    comment = f"assumed: the photo's longer side is {PLAYBACK.width:g} m"
    if photo_scale is not None:
        reason = photo_scale.reason.partition(" (")[0]
        comment += f"; perhaps {photo_scale.pixels_per_meter:g}, {reason}"
    return assumed_scale(side), comment


def push_speed(side: int, pixels_per_meter: float) -> float:
    """Return the speed of a push, px/s, at which objects slide and topple visibly.

    `side`: the photo's longer side, px. The result has two digits.
    """
    speed = sqrt(2 * PLAYBACK.gravity * pixels_per_meter * PLAYBACK.fall * side)
    return float(f"{speed:.2g}")


def slow_motion(side: int, pixels_per_meter: float) -> int:
    """Return `render.slow` (1, 2, 4 ...) for a push at a comfortable speed."""
    crossing = side / push_speed(side, pixels_per_meter)
    return int(2 ** max(0, round(log(PLAYBACK.crossing / crossing, 2))))


def slow_motion_comment(slow: float) -> str:
    """Return the comment of a scene in slow motion."""
    return f"slowed down {slow:g}x: at real speed the motion would soon be over"


def story_slow_motion(usual: int, seconds: float) -> int:
    """Return `render.slow` of a clip with a motion of these seconds.

    It is halved while the motion takes longer than `PLAYBACK.longest` s of video, and
    doubled once if the motion takes less than `PLAYBACK.least_motion` s: a short slide
    within the picture would look like a jerk.

    >>> story_slow_motion(4, 0.5), story_slow_motion(4, 1.0), story_slow_motion(4, 9.0)
    (4, 2, 1)
    >>> story_slow_motion(4, 0.2)
    8
    """
    slow = usual
    if usual * seconds < PLAYBACK.least_motion:
        return 2 * usual
    while slow > 1 and slow * seconds > PLAYBACK.longest:
        slow //= 2
    return slow


def _weighted_median(values: Array, weights: Array) -> float:
    """Return the weighted median; of two, the weighted mean.

    >>> _weighted_median(np.array([1.0, 9.0, 2.0]), np.ones(3)), _weighted_median(np.array([1.0, 2.0]), np.ones(2))
    (2.0, 1.5)
    """
    if len(values) == 2:
        return float((values * weights).sum() / weights.sum())
    order = np.argsort(values)
    cumulative_weights = np.cumsum(weights[order])
    return float(
        values[order][
            int(np.searchsorted(cumulative_weights, cumulative_weights[-1] / 2))
        ]
    )


def _reason(
    witnesses: Mapping[str, Sequence[object]], kinds: Mapping[int, Kind], spread: float
) -> str:
    """Describe the witnesses of a scale in words."""
    sizes = {object_kind.noun: object_kind.size for object_kind in kinds.values()}
    parts = []
    for noun, objects in witnesses.items():
        size = " x ".join(f"{mm:g}" for mm in sizes[noun])
        parts.append(f"{len(objects)} x {noun} ({size} mm)")
    further_kinds = ""
    if len(parts) > 3:
        further_kinds = f" and {len(parts) - 3} kinds more"
    accuracy = f"good to about {100 * max(spread, 0.01):.0f} %"
    return (
        f"from the ordinary size of {', '.join(parts[:3])}{further_kinds}, {accuracy}"
    )
