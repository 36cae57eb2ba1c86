"""Things of known size in a photo -> its scale, and how sure it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, hypot

import numpy as np

from physgen.geometry import Array
from physgen.materials import Kind
from physgen.perceive.extent import extent, sides
from physgen.perceive.roles import Matter, Thing

SURE = 0.7
"""A label counts from this confidence on: a guess from a shape tells no size."""
MISMATCH = 0.6
"""|log| of proportions beyond which a thing does not count: part of it is hidden, or it is no such thing."""
ANY = 0.5
"""Spread of sizes from which a thing tells nothing: a plank is of any length."""
VAGUE = 0.3
"""Standard deviation of log scale at which the confidence has fallen to 1 / e."""
DEFAULT = 100
"""px/m of a scene where nothing tells: the paper's 1 px = 1 cm."""
JUDGED = 0.1
"""Standard deviation of the log of a size that somebody judges by eye, at the least."""
ENOUGH = 0.5
"""Confidence from which a scene takes the scale."""


@dataclass(frozen=True)
class Scale:
    """How large a photo shows things."""

    pixels_per_meter: float
    """px/m, to as many digits as it is good for."""
    confidence: float
    """0..1: 0.6 where it is good to 20 %, 0.9 to 7 %."""
    reason: str


def scale(
    things: Sequence[Thing], kinds: Mapping[int, Kind], sure: Mapping[int, float] | None = None
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
        found = extent(thing.outline, what)
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


def judged(things: Sequence[Thing], matter: Mapping[int, Matter], who: str) -> Scale | None:
    """The photo's scale by how long each thing is judged to be (`Matter.size`), None where nobody judged.

    The median counts; how far the judgements are from each other, weighted by nothing, says how sure that is.
    """
    found = [
        (sides(thing.outline)[0] / size, matter[thing.id].confidence)
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


def stated(given: float | None, found: Scale | None) -> tuple[float, str]:
    """px/m as a scene states it, and a sentence about it; a person's number wins, then a scale that is sure enough."""
    if given is not None:
        return given, "as given; masses and gravity (9.8 m/s² x this) follow from it"
    if found is not None and found.confidence >= ENOUGH:
        follows = "masses and gravity (9.8 m/s² x this) follow from it"
        return found.pixels_per_meter, f"{found.reason} (confidence {found.confidence:g});\n{follows}"
    sentence = (
        "1 px = 1 cm, as in the paper: things look large and fall slowly; masses do not follow from it.\n"
        "A larger number makes things fall faster: gravity is 9.8 m/s² x this"
    )
    if found is None:
        return DEFAULT, sentence
    guess = f"{found.pixels_per_meter:g}, {found.reason}, is unsure (confidence {found.confidence:g})"
    return DEFAULT, f"{sentence}.\n{guess}"


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
