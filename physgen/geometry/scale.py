"""Depth, volume, mass and true size of objects from their outlines, and the scale of the photo."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import exp, hypot, log, pi, sqrt

import cv2
import numpy as np

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
"""px/m: the paper's 1 px = 1 cm, of scene files that name no scale."""
MIN_SCALE_CONFIDENCE = 0.5
"""From which a scene takes the scale."""


@dataclass(frozen=True)
class _ShapeLimits:
    """Solids of revolution, and how an object faces the camera; costs are |log| of an aspect ratio."""

    slices: int = 480
    """Cells of the grid along the longer side of a solid of revolution."""
    boxy: float = 0.88
    """Share of its smallest box from which an outline is a box's."""
    lying: float = 0.25
    """Cost of an axis that is not upright."""
    end_on: float = 0.4
    """Cost of a view from the object's end."""
    flat: float = 0.2
    """Depth over width of a disc or ring of unknown thickness."""


@dataclass(frozen=True)
class _ScaleLimits:
    """Which objects count for the scale; spreads are standard deviations of the log of size."""

    min_label: float = 0.7
    """Confidence of a label: a guess from a shape has no size."""
    max_mismatch: float = 0.6
    """|log| of proportions: beyond, part of it is hidden, or the label is wrong."""
    any_size: float = 0.5
    """Spread from which an object says nothing of scale: a plank is of any length."""
    vague: float = 0.3
    """Spread at which the confidence has fallen to 1 / e."""
    judged: float = 0.1
    """Least spread of a size that is judged by eye."""


SHAPE, LIMITS = _ShapeLimits(), _ScaleLimits()


@dataclass(frozen=True)
class PhotoObject:
    """An object of the photo: its id in the label map, its outline, and its label."""

    id: int
    outline: Outline
    label: str = ""
    """`""` until it is named."""
    cut: bool = False
    """Whether the photo's border cuts it off."""
    top: float = 0.0
    """px of its mask above its front, where the outline is the section half-way to its back."""


def photo_object(
    id_: int, outline: Outline, label: str, size: tuple[int, int]
) -> PhotoObject:
    """An object, and whether the border of a photo of this width and height cuts it off."""
    x0, y0, x1, y1 = bounds(outline)
    return PhotoObject(
        id_, outline, label, min(x0, y0) < 0 or x1 > size[0] - 1 or y1 > size[1] - 1
    )


@dataclass(frozen=True)
class Extent:
    """Measures of an object from its outline and kind."""

    volume: float
    """Px³ that it takes up, hollows included."""
    per_mm: float | None
    """px per mm if it is of its ordinary size, None where it has none."""
    mismatch: float
    """|log| of its proportions over the ordinary ones; 0 where they are unknown."""


@dataclass(frozen=True)
class Revolved:
    """A body of revolution from the mirror-symmetric part of an outline, px."""

    volume: float
    height: float
    """Along its axis."""
    diameter: float
    """At its widest."""


def object_extent(outline: Outline, what: Kind) -> Extent:
    """Size and depth of an object with this outline (px) and of this kind.

    Open sizes follow from the sides of the ordinary object: those two that fit the outline best are seen, the third is
    the depth. A bottle's depth is its width, slice by slice.
    """
    if what.form == "turned":
        return _turned_extent(outline, what)
    area = mass_properties(outline).area
    long, short = box_sides(outline)
    if what.form == "ball":
        across = long if isinstance(outline, Disc) else 2 * sqrt(area / pi)
        per_mm = long / what.size[0] if what.size else None
        return Extent(area * across * 2 / 3, per_mm, log(long / short))
    if what.box is None:
        return Extent(area * _mean_depth(outline, what.form), None, 0.0)
    seen, hidden, mismatch = _facing(long / short, what.box)
    per_mm = long / seen[0]
    shows_face = min(hidden, seen[1]) == hidden
    rounding = {"lump": 2 / 3, "slab": 1.0}.get(
        what.form, 1.0 if shows_face else pi / 4
    )
    if what.form == "hoop" and isinstance(outline, Disc):
        rounding *= what.share  # its hole is not in the outline
    if (
        what.share < SHAPE.boxy and mismatch < LIMITS.max_mismatch
    ):  # a rectangle around a fork covers air, too
        area = min(area, what.share * long * short)
    return Extent(area * hidden * per_mm * rounding, per_mm, mismatch)


def box_sides(outline: Outline) -> tuple[float, float]:
    """px: the longer and the shorter side of the smallest box around it, of any angle."""
    if isinstance(outline, Disc):
        return 2 * outline.radius, 2 * outline.radius
    points = np.concatenate([ring.outer for ring in outline.rings]).astype(np.float32)
    (_, (w, h), _) = cv2.minAreaRect(points)
    x0, y0, x1, y1 = bounds(outline)
    least = 1e-3 * max(x1 - x0, y1 - y0)
    return max(float(w), float(h), least), max(min(float(w), float(h)), least)


def revolve(outline: Region, axis: Array) -> Revolved:
    """The outline revolved about a line along `axis` (2,), the one that gives the largest volume.

    In each slice only what is symmetric about the axis counts, so that a mug's handle is left out.
    """
    along = np.asarray(axis, float) / np.hypot(*axis)
    frame = np.stack([np.array([-along[1], along[0]]), along])  # across, along
    every = np.concatenate([ring.outer for ring in outline.rings]) @ frame.T
    low, size = every.min(axis=0), np.ptp(every, axis=0)
    scale = SHAPE.slices / max(size)  # of the grid on which the outline is drawn

    def drawn(points: Array) -> Array:
        return np.asarray((points @ frame.T - low) * scale - 0.5)

    rings = tuple(
        Ring(drawn(ring.outer), tuple(map(drawn, ring.holes))) for ring in outline.rings
    )
    width, height = np.ceil(size * scale).astype(int).tolist()
    inside = coverage(Region(rings), (width, height)) >= 0.5
    columns = np.arange(width)
    before = np.maximum.accumulate(np.where(inside, -1, columns), axis=1)
    after = np.minimum.accumulate(np.where(inside, width, columns)[:, ::-1], axis=1)[
        :, ::-1
    ]
    radii = (
        np.where(inside, np.minimum(columns - before, after - columns) - 0.5, 0.0)
        / scale
    )
    best = radii[:, int(np.argmax((radii**2).sum(axis=0)))]
    # a spike at an end (a stalk, a spout) is no part of the height
    tall = float(np.count_nonzero(best > 0.05 * best.max())) / scale
    return Revolved(float(pi * (best**2).sum() / scale), tall, float(2 * best.max()))


def _turned_extent(outline: Outline, what: Kind) -> Extent:
    long, short = box_sides(outline)
    area = mass_properties(outline).area
    above = None
    if what.size:
        high, wide = what.size
        per_mm = long / wide
        above = Extent(area * high * per_mm * what.share, per_mm, log(long / short))
    if isinstance(outline, Disc):
        return above or Extent(area * 2 * outline.radius, None, 0.0)
    upright = revolve(outline, np.array([0.0, 1.0]))
    lying = [revolve(outline, axis) for axis in _box_axes(outline)]
    if above is None:
        slenderest = max(
            [upright, *lying], key=lambda t: t.height / max(t.diameter, 1e-6)
        )
        return Extent(slenderest.volume, None, 0.0)
    found = []
    for turned, cost in ((upright, 0.0), *((one, SHAPE.lying) for one in lying)):
        if turned.volume > 0:
            tall, broad = turned.height / high, turned.diameter / wide
            seen = Extent(turned.volume, sqrt(tall * broad), abs(log(tall / broad)))
            found.append((seen.mismatch + cost, seen))
    found.append((above.mismatch + SHAPE.end_on, above))
    return min(found, key=lambda one: one[0])[1]


def _box_axes(outline: Region) -> tuple[Array, Array]:
    """Directions of the sides of the smallest box."""
    points = np.concatenate([ring.outer for ring in outline.rings]).astype(np.float32)
    turn = np.deg2rad(cv2.minAreaRect(points)[2])
    along = np.array([np.cos(turn), np.sin(turn)])
    return along, np.array([-along[1], along[0]])


def _facing(
    aspect: float, box: tuple[float, float, float]
) -> tuple[tuple[float, float], float, float]:
    """Of a box, the two sides (mm) that fit the aspect ratio best, the hidden one, and |log| of the misfit."""
    found = []
    for k, pair in zip((2, 1, 0), combinations(range(3), 2), strict=True):
        seen = sorted((box[pair[0]], box[pair[1]]), reverse=True)
        off = abs(log(aspect * seen[1] / seen[0]))
        cost = off if seen[0] == max(box) else off + SHAPE.end_on
        found.append((cost, k, (seen[0], seen[1]), box[k], off))
    _, _, shown, hidden, off = min(found)
    return shown, hidden, off


def _mean_depth(outline: Outline, form: str) -> float:
    """px, of an object of unknown proportions."""
    long, short = box_sides(outline)
    if form in ("disc", "hoop"):
        return SHAPE.flat * long if long < 2 * short else long * pi / 4
    boxy = mass_properties(outline).area / (long * short) > SHAPE.boxy
    return short if form == "slab" or (form == "" and boxy) else short * 2 / 3


@dataclass(frozen=True)
class WeighingConstants:
    """Constants of the masses."""

    unscaled: float = 0.3
    """Confidence of a mass, at most, where the scale is assumed."""
    standard: float = 0.05
    """Spread of sizes up to which the kind has one standard mass."""
    like: float = 0.4
    """|log| of the size ratio up to which an object may be the typical one."""
    lightest: float = 1e-3
    """g."""


WEIGHING = WeighingConstants()


def weigh(
    outline: Outline, what: Kind, pixels_per_meter: float
) -> tuple[float, float, str]:
    """Mass in g to three digits, confidence and a sentence."""
    mass, confidence, reason = _mass(
        object_extent(outline, what), what, pixels_per_meter
    )
    return float(f"{max(mass, WEIGHING.lightest):.3g}"), confidence, reason


def _mass(
    found: Extent, what: Kind, pixels_per_meter: float
) -> tuple[float, float, str]:
    volume = found.volume / pixels_per_meter**3 * 1e6
    what = what.hollowed(10 * (6 * volume / pi) ** (1 / 3))
    weighed = volume * what.density
    estimate = f"{float(f'{volume:.3g}'):,g} cm³ of {_stuff(what)}"
    if what.mass is None:
        return (
            weighed,
            0.4 if what.noun else 0.35 if what.material.name != "unknown" else 0.15,
            estimate,
        )
    source = what.source.replace("EST: ", "").replace("EST", "estimated")
    ordinary = f"an ordinary {what.noun} ({source})"
    off = 0.0 if found.per_mm is None else log(found.per_mm * 1000 / pixels_per_meter)
    if abs(off) < WEIGHING.like and what.spread <= WEIGHING.standard:
        return what.mass, 0.8, ordinary
    if abs(off) < WEIGHING.like:
        return (
            sqrt(weighed * what.mass),
            0.6,
            f"between {estimate}, and an ordinary {what.noun}, {what.mass:g} g",
        )
    return weighed, 0.4, f"{estimate}; an ordinary {what.noun} has another size"


def _stuff(what: Kind) -> str:
    """The material, in words.

    >>> from physgen.materials import kind
    >>> _stuff(kind("steel ball")), _stuff(kind("beer bottle"))
    ('steel, 7.85 g/cm³', 'glass and content, 1.19 g/cm³')
    """
    name, solid = what.material.name, what.material.density
    name = "an unknown material" if name == "unknown" else name
    if what.holds:
        return f"{name} and content, {what.density:.3g} g/cm³"
    if abs(what.filled - 1) < 0.01:
        return f"{name}, {solid:g} g/cm³"
    if what.filled > 1:
        return f"{name}, {what.density:.3g} g/cm³ in all"
    return f"{name}, {solid:g} g/cm³ and {100 * what.filled:.2g} % of the volume"


@dataclass(frozen=True)
class Scale:
    """The scale of a photo."""

    pixels_per_meter: float
    """px/m, to as many digits as are significant."""
    confidence: float
    """0..1: 0.6 at an uncertainty of 20 %, 0.9 at 7 %."""
    reason: str


def photo_scale(
    objects: Sequence[PhotoObject],
    kinds: Mapping[int, Kind],
    sure: Mapping[int, float] | None = None,
) -> Scale | None:
    """The photo's scale by the ordinary sizes of its objects, None where none has one.

    `sure` are the confidences of labels, 1 where absent. Objects of one kind are one witness, by their median; the
    median of witnesses counts, weighted by how little the sizes of such objects differ. Cut objects do not count.
    """
    seen: dict[str, list[tuple[float, float]]] = {}
    for item in objects:
        what = kinds[item.id]
        confidence = (sure or {}).get(item.id, 1.0)
        if (
            item.cut
            or not what.size
            or what.spread >= LIMITS.any_size
            or confidence < LIMITS.min_label
        ):
            continue
        found = object_extent(item.outline, what)
        if found.per_mm and found.mismatch < LIMITS.max_mismatch:
            seen.setdefault(what.noun, []).append(
                (found.per_mm, hypot(what.spread, found.mismatch / 2))
            )
    if not seen:
        return None
    logs, spreads = (
        np.array([np.median([one[k] for one in each]) for each in seen.values()])
        for k in (0, 1)
    )
    logs = np.log(logs)
    weights = spreads**-2.0
    middle = _weighted_median(logs, weights)
    # the witnesses' own uncertainty, or their disagreement where that is more
    disagreement = (
        (weights * (logs - middle) ** 2).sum() / weights.sum() / max(len(logs) - 1, 1)
    )
    spread = max(float(weights.sum() ** -0.5), float(np.sqrt(disagreement)))
    confidence = 0.95 * exp(-((spread / LIMITS.vague) ** 2))
    value = float(f"{exp(middle) * 1000:.{3 if spread < 0.05 else 2}g}")
    return Scale(value, round(confidence, 2), _reason(seen, kinds, spread))


@dataclass(frozen=True)
class _Playback:
    """The photo's assumed size, and how a push and a clip suit it."""

    width: float = 0.5
    """m along the longer side of a photo that shows no scale: a table top seen from near by."""
    gravity: float = 9.8
    """m/s²."""
    fall: float = 0.15
    """Of the photo's longer side: a fall over it gives the speed of a push."""
    crossing: float = 1.5
    """s of the video in which a push crosses the photo, about."""
    longest: float = 2.5
    """s of the video in which something moves, in less slow motion where that helps."""
    pause: float = 0.7
    """s of the video after that."""
    shortest: float = 2.5
    """s of a clip: a shorter one is over before it is watched."""
    least_motion: float = 1.0
    """s of the video in which a push moves something."""


PLAYBACK = _Playback()


def assumed_scale(side: int) -> float:
    """px/m of a photo that shows no scale; `side` is its longer side, px."""
    return side / PLAYBACK.width


def is_assumed(pixels_per_meter: float, side: int) -> bool:
    """Whether a scene's scale is what perception assumes, today or as the paper does, and none that is known."""
    return pixels_per_meter in (PAPER_SCALE, assumed_scale(side))


def scale_entry(
    side: int, given: float | None, found: Scale | None
) -> tuple[float, str]:
    """px/m for the scene, and its comment; the user's number wins, then a scale that is sure enough."""
    if given is not None:
        return given, "as given"
    if found is not None and found.confidence >= MIN_SCALE_CONFIDENCE:
        return (
            found.pixels_per_meter,
            f"{found.reason} (confidence {found.confidence:g})",
        )
    guess = (
        ""
        if found is None
        else f"; perhaps {found.pixels_per_meter:g}, {found.reason.partition(' (')[0]}"
    )
    return assumed_scale(side), f"assumed: the photo shows {PLAYBACK.width:g} m{guess}"


def push_speed(side: int, pixels_per_meter: float) -> float:
    """px/s to two digits: a speed at which objects of a photo of this longer side, px, slide and topple visibly."""
    return float(
        f"{sqrt(2 * PLAYBACK.gravity * pixels_per_meter * PLAYBACK.fall * side):.2g}"
    )


def slow_motion(side: int, pixels_per_meter: float) -> int:
    """`render.slow` (1, 2, 4 ...) at which a push can be watched."""
    crossing = side / push_speed(side, pixels_per_meter)
    return int(2 ** max(0, round(log(PLAYBACK.crossing / crossing, 2))))


def story_slow_motion(usual: int, seconds: float) -> int:
    """`render.slow` of a clip in which something moves for these s.

    It is halved while the motion takes longer than `PLAYBACK.longest` s of video, and
    doubled once if the motion takes less than `PLAYBACK.least_motion` s: what slides
    to a stop within the picture is a jerk otherwise.

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
    """The weighted median; of two, the weighted mean.

    >>> _weighted_median(np.array([1.0, 9.0, 2.0]), np.ones(3)), _weighted_median(np.array([1.0, 2.0]), np.ones(2))
    (2.0, 1.5)
    """
    if len(values) == 2:
        return float((values * weights).sum() / weights.sum())
    order = np.argsort(values)
    summed = np.cumsum(weights[order])
    return float(values[order][int(np.searchsorted(summed, summed[-1] / 2))])


def _reason(
    seen: Mapping[str, Sequence[object]], kinds: Mapping[int, Kind], spread: float
) -> str:
    sizes = {what.noun: what.size for what in kinds.values()}
    parts = [
        f"{len(each)} x {noun} ({' x '.join(f'{mm:g}' for mm in sizes[noun])} mm)"
        for noun, each in seen.items()
    ]
    more = f" and {len(parts) - 3} kinds more" if len(parts) > 3 else ""
    accuracy = f"good to about {100 * max(spread, 0.01):.0f} %"
    return f"from the ordinary size of {', '.join(parts[:3])}{more}, {accuracy}"
