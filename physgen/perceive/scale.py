"""Depth, volume and true size of objects from their outlines, and the scale of the photo."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import exp, hypot, log, pi, sqrt

import cv2
import numpy as np

from physgen.geometry.polygon import Array, Disc, Outline, Region, bounds, mass_properties
from physgen.materials import Kind
from physgen.perceive.roles import Matter, PhotoObject

# ----------------------------------------------------------------------
# An outline and the kind of thing it shows -> how deep the thing is, its volume, and the photo's scale by its
# size.

SLICES = 240
"""Into how many a solid of revolution is cut."""
AXES = 79
"""At how many places across it an axis is tried."""
BOXY = 0.88
"""Share of its smallest box from which an outline is that of a box."""
LYING = 0.25
"""How much worse (log of an aspect ratio) an upright axis may fit before another is taken."""
END_ON = 0.4
"""The same, before a thing is taken to be seen from its end."""
FLAT = 0.2
"""Depth of a disc or ring whose thickness nobody knows, as a share of its width."""


@dataclass(frozen=True)
class Extent:
    """A thing's measures as far as its outline and kind tell."""

    volume: float
    """px³ that it takes up, hollows within and all."""
    per_mm: float | None
    """px per mm if it is of its ordinary size, None where it has none."""
    mismatch: float
    """By how much its proportions are not the ordinary ones: |log| of a ratio; 0 where nothing is known of them."""


@dataclass(frozen=True)
class Revolved:
    """A body of revolution, as an outline's mirror-symmetric part gives it."""

    volume: float
    """px³."""
    height: float
    """px along its axis."""
    diameter: float
    """px at its widest."""


def object_extent(outline: Outline, what: Kind) -> Extent:
    """How large and how deep a thing is that has this outline (px) and is of this kind.

    What its form leaves open follows from the sides of the ordinary thing: those two that fit the outline best are
    seen, the third is the depth. A bottle's depth is its width, slice by slice.
    """
    if what.form == "turned":
        return _turned(outline, what)
    area = mass_properties(outline).area
    long, short = box_sides(outline)
    if what.form == "ball":
        across = long if isinstance(outline, Disc) else 2 * sqrt(area / pi)
        per_mm = long / what.size[0] if what.size else None
        return Extent(area * across * 2 / 3, per_mm, log(long / short))
    if what.box is None:
        return Extent(area * _deep(outline, what.form), None, 0.0)
    seen, hidden, mismatch = _facing(long / short, what.box)
    per_mm = long / seen[0]
    flat = min(hidden, seen[1]) == hidden  # it shows its face
    rounding = {"lump": 2 / 3, "slab": 1.0}.get(what.form, 1.0 if flat else pi / 4)
    if what.form == "hoop" and isinstance(outline, Disc):
        rounding *= what.share  # its hole is not in the outline
    return Extent(area * hidden * per_mm * rounding, per_mm, mismatch)


def box_sides(outline: Outline) -> tuple[float, float]:
    """px: the longer and the shorter side of the smallest box around it, turned as it likes."""
    if isinstance(outline, Disc):
        return 2 * outline.radius, 2 * outline.radius
    points = np.concatenate([ring.outer for ring in outline.rings]).astype(np.float32)
    (_, (w, h), _) = cv2.minAreaRect(points)
    x0, y0, x1, y1 = bounds(outline)
    least = 1e-3 * max(x1 - x0, y1 - y0)
    return max(float(w), float(h), least), max(min(float(w), float(h)), least)


def revolve(outline: Region, axis: Array) -> Revolved:
    """The outline turned about a line along `axis` (2,), the one that takes up most of it.

    In each slice counts what lies alike on both sides of the axis, so that a mug's handle is left out.
    """
    along = np.asarray(axis, float) / np.hypot(*axis)
    frame = np.stack([np.array([-along[1], along[0]]), along])  # across, along
    edges = []
    for ring in outline.rings:
        for border in (ring.outer, *ring.holes):
            points = border @ frame.T
            edges.append(np.concatenate([points, np.roll(points, -1, axis=0)], axis=1))
    every = np.concatenate(edges)
    low, high = float(every[:, 1].min()), float(every[:, 1].max())
    step = (high - low) / SLICES
    spans = [_crossings(every, low + (k + 0.5) * step) for k in range(SLICES)]
    crossings = np.full((SLICES, max(map(len, spans)) + 1), np.inf)
    for row, span in zip(crossings, spans, strict=True):
        row[: len(span)] = span
    left, right = float(every[:, 0].min()), float(every[:, 0].max())
    radii = _radii(crossings, np.linspace(left, right, AXES + 2)[1:-1])
    best = radii[:, int(np.argmax((radii**2).sum(axis=0)))]
    kept = best > 0
    # a spike at an end (a stalk, a spout) is no part of the height
    height = step * float(np.count_nonzero(kept & (best > 0.05 * best.max())))
    return Revolved(float(pi * step * (best**2).sum()), height, float(2 * best.max()))


def _crossings(edges: Array, y: float) -> Array:
    """Sorted places (2K,) where a line across meets the borders."""
    (y0, y1) = edges[:, 1], edges[:, 3]
    meets = (y0 <= y) != (y1 <= y)
    x0, y0, x1, y1 = edges[meets].T
    return np.sort(x0 + (y - y0) / (y1 - y0) * (x1 - x0))


def _radii(crossings: Array, axes: Array) -> Array:
    """(SLICES, X) px: how far each slice reaches on both sides of axes at (X,); `crossings` end with inf."""
    at = (crossings[:, :, None] < axes).sum(axis=1)
    before = np.take_along_axis(crossings, np.maximum(at - 1, 0), axis=1)
    after = np.take_along_axis(crossings, at, axis=1)
    inside = at % 2 == 1
    return np.where(
        inside, np.minimum(axes - np.where(inside, before, 0), np.where(inside, after, 0) - axes), 0
    )


def _turned(outline: Outline, what: Kind) -> Extent:
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
    lying = [revolve(outline, axis) for axis in _axes(outline)]
    if above is None:
        return Extent(
            max([upright, *lying], key=lambda t: t.height / max(t.diameter, 1e-6)).volume, None, 0.0
        )
    found = []
    for turned, cost in ((upright, 0.0), *((one, LYING) for one in lying)):
        if turned.volume > 0:
            tall, broad = turned.height / high, turned.diameter / wide
            seen = Extent(turned.volume, sqrt(tall * broad), abs(log(tall / broad)))
            found.append((seen.mismatch + cost, seen))
    found.append((above.mismatch + END_ON, above))
    return min(found, key=lambda one: one[0])[1]


def _axes(outline: Region) -> tuple[Array, Array]:
    """Directions of the sides of the smallest box."""
    points = np.concatenate([ring.outer for ring in outline.rings]).astype(np.float32)
    turn = np.deg2rad(cv2.minAreaRect(points)[2])
    along = np.array([np.cos(turn), np.sin(turn)])
    return along, np.array([-along[1], along[0]])


def _facing(aspect: float, box: tuple[float, float, float]) -> tuple[tuple[float, float], float, float]:
    """Of a box, the two sides (mm) that show the aspect ratio best, the hidden one, and how far off they are."""
    found = []
    for k, pair in zip((2, 1, 0), combinations(range(3), 2), strict=True):
        seen = sorted((box[pair[0]], box[pair[1]]), reverse=True)
        off = abs(log(aspect * seen[1] / seen[0]))
        cost = off if seen[0] == max(box) else off + END_ON
        found.append((cost, k, (seen[0], seen[1]), box[k], off))
    _, _, shown, hidden, off = min(found)
    return shown, hidden, off


def _deep(outline: Outline, form: str) -> float:
    """px: mean depth of a thing of unknown proportions."""
    long, short = box_sides(outline)
    if form in ("disc", "hoop"):
        return FLAT * long if long < 2 * short else long * pi / 4
    boxy = mass_properties(outline).area / (long * short) > BOXY
    return short if form == "slab" or (form == "" and boxy) else short * 2 / 3


# ----------------------------------------------------------------------
# Things of known size in a photo -> its scale, and how sure it is.

SURE = 0.7
"""A label counts from this confidence on: a guess from a shape tells no size."""
MISMATCH = 0.6
"""|log| of proportions beyond which a thing does not count: part of it is hidden, or it is no such thing."""
ANY = 0.5
"""Spread of sizes from which a thing tells nothing: a plank is of any length."""
VAGUE = 0.3
"""Standard deviation of log scale at which the confidence has fallen to 1 / e."""
DEFAULT_SCALE = 100
"""px/m of a scene where nothing tells: the paper's 1 px = 1 cm."""
JUDGED = 0.1
"""Standard deviation of the log of a size that somebody judges by eye, at the least."""
MIN_SCALE_CONFIDENCE = 0.5
"""Confidence from which a scene takes the scale."""


@dataclass(frozen=True)
class Scale:
    """How large a photo shows things."""

    pixels_per_meter: float
    """px/m, to as many digits as it is good for."""
    confidence: float
    """0..1: 0.6 where it is good to 20 %, 0.9 to 7 %."""
    reason: str


def photo_scale(
    things: Sequence[PhotoObject], kinds: Mapping[int, Kind], sure: Mapping[int, float] | None = None
) -> Scale | None:
    """The photo's scale by the sizes of what is in it, None where nothing tells.

    `sure` says how sure each label is, 1 where it is silent. Alike things are one witness, the median of them; the
    median of witnesses counts, weighted by how little the sizes of such things differ. Cut things do not count.
    """
    seen: dict[str, list[tuple[float, float]]] = {}
    for thing in things:
        what = kinds[thing.id]
        if thing.cut or not what.size or what.spread >= ANY or (sure or {}).get(thing.id, 1.0) < SURE:
            continue
        found = object_extent(thing.outline, what)
        if found.per_mm and found.mismatch < MISMATCH:
            seen.setdefault(what.noun, []).append((found.per_mm, hypot(what.spread, found.mismatch / 2)))
    if not seen:
        return None
    logs, spreads = (
        np.array([np.median([one[k] for one in each]) for each in seen.values()]) for k in (0, 1)
    )
    logs = np.log(logs)
    weights = spreads**-2.0
    middle = _middle(logs, weights)
    # what the witnesses promise, or how far they are from each other where that is more
    spread = float(weights.sum() ** -0.5)
    apart = float(np.sqrt((weights * (logs - middle) ** 2).sum() / weights.sum() / max(len(logs) - 1, 1)))
    spread = max(spread, apart)
    confidence = 0.95 * exp(-((spread / VAGUE) ** 2))
    digits = 3 if spread < 0.05 else 2
    value = float(f"{exp(middle) * 1000:.{digits}g}")
    return Scale(value, round(confidence, 2), _reason(seen, kinds, spread))


def judged_scale(things: Sequence[PhotoObject], matter: Mapping[int, Matter], who: str) -> Scale | None:
    """The photo's scale by how long each thing is judged to be (`Matter.size`), None where nobody judged.

    The median counts; how far the judgements are from each other, weighted by nothing, says how sure that is.
    """
    found = [
        (box_sides(thing.outline)[0] / size, matter[thing.id].confidence)
        for thing in things
        if not thing.cut and (size := matter[thing.id].size)
    ]
    if not found:
        return None
    logs = np.log([per_meter for per_meter, _ in found])
    middle = float(np.median(logs))
    spread = max(float(np.median(np.abs(logs - middle))) * 1.48, JUDGED) if len(logs) > 1 else 1.5 * JUDGED
    sure = float(np.median([confidence for _, confidence in found])) ** 0.5
    value = float(f"{exp(middle):.2g}")
    count = f"{len(found)} objects" if len(found) > 1 else "one object"
    reason = f"{who} judged the size of {count}, which agree to about {100 * spread:.0f} %"
    return Scale(value, round(0.95 * sure * exp(-((spread / VAGUE) ** 2)), 2), reason)


def scale_entry(given: float | None, found: Scale | None) -> tuple[float, str]:
    """px/m as a scene states it, and a sentence about it; a person's number wins, then a scale that is sure enough."""
    if given is not None:
        return given, "as given; masses and gravity (9.8 m/s² x this) follow from it"
    if found is not None and found.confidence >= MIN_SCALE_CONFIDENCE:
        follows = "masses and gravity (9.8 m/s² x this) follow from it"
        return found.pixels_per_meter, f"{found.reason} (confidence {found.confidence:g});\n{follows}"
    sentence = (
        "1 px = 1 cm, as in the paper: things look large and fall slowly; masses do not follow from it.\n"
        "A larger number makes things fall faster: gravity is 9.8 m/s² x this"
    )
    if found is None:
        return DEFAULT_SCALE, sentence
    guess = f"{found.pixels_per_meter:g}, {found.reason}, is unsure (confidence {found.confidence:g})"
    return DEFAULT_SCALE, f"{sentence}.\n{guess}"


def _middle(values: Array, weights: Array) -> float:
    """The weighted median; of two, the weighted mean.

    >>> _middle(np.array([1.0, 9.0, 2.0]), np.ones(3)), _middle(np.array([1.0, 2.0]), np.ones(2))
    (2.0, 1.5)
    """
    if len(values) == 2:
        return float((values * weights).sum() / weights.sum())
    order = np.argsort(values)
    summed = np.cumsum(weights[order])
    return float(values[order][int(np.searchsorted(summed, summed[-1] / 2))])


def _reason(seen: Mapping[str, Sequence[object]], kinds: Mapping[int, Kind], spread: float) -> str:
    sizes = {what.noun: what.size for what in kinds.values()}
    told = [
        f"{len(each)} x {noun} ({' x '.join(f'{mm:g}' for mm in sizes[noun])} mm)"
        for noun, each in seen.items()
    ]
    more = f" and {len(told) - 3} kinds more" if len(told) > 3 else ""
    return f"from the ordinary size of {', '.join(told[:3])}{more}, good to about {100 * max(spread, 0.01):.0f} %"
