"""Photo from the side -> the light whose shadows on the floor, and on a wall behind, go with the photo's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import acos, asin, atan2, cos, degrees, inf, pi, sin

import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import LightGuess
from physgen.perceive.silhouettes import typical
from physgen.perceive.trace import Shift, Trace, foretold
from physgen.photometry import DistantLight
from physgen.shadow.cast import Setting as Place
from physgen.shadow.cast import Silhouette

F32 = NDArray[np.float32]

COARSE, FINE = 192, 384
"""px: longer side of the pictures in which the light is looked for, first and then."""
TOLD, WELL = 0.3, 0.5
"""Confidences of a light that shading told: from the first on it counts, from the second on it counts most."""
ASKEW = 20.0, 7.0
"""degrees by which such lights are off, standard deviation (studio photos of the split `tune`)."""
BEYOND = 40.0, 2.5
"""Farther from such a light none is looked for: degrees, and standard deviations."""
PULL = 0.02
"""What a fit must explain more for lying one standard deviation from such a light."""
TELLING = 3
"""Things, or groups of them, that the light is looked for by at first; the largest."""
TILT = 0.1
"""Rise over run of the floor where nothing tells."""
BY_A_WALL = 0.7
"""Correlation of slopes that shadows on a wall behind need."""
HALF_SEEN = 0.3
"""The same before the light has been looked for with the wall."""
MORE = 1.2
"""By how much more a wall must explain, of what lies above its foot, than a floor that goes on."""
NEAREST_FARTHEST = (0.3, 8.0)
"""Of an object's size: how far behind the objects a wall is looked for."""
ASTRAY = 0.15
"""Of its height: how far aside the shadow of a thing in the air may lie from where it is foretold; less up or down."""
MOVED = 0.05
"""By how much better it must explain what is seen there."""


@dataclass(frozen=True)
class Fit:
    """A light and what its shadows fall on, in px of the photo."""

    place: Place
    likeness: float
    """Correlation of foretold and seen slopes."""
    factor: float
    """By how much more is dark than foretold, as a logarithm."""
    each: float = 1.0
    """The same where the shadows of things side by side are added up."""
    shifts: tuple[Shift, ...] = ()
    """px, of each of `joined`: by how much its shadow lies elsewhere."""
    moved: Mapping[int, Shift] = field(default_factory=dict)
    """The same by the object's id, px of the photo."""


def scaled(place: Place, by: float, size: tuple[int, int]) -> Place:
    """The same place on a picture so much larger."""
    return replace(place, backdrop=place.backdrop * by, size=size)


def best_light(
    traces: Sequence[Trace], guess: LightGuess, walls: Sequence[float] = (inf,)
) -> tuple[int, Fit]:
    """By steps along one number after the other, from several directions: which trace, and the light in its px.

    `traces`: of one size, with floors in different places. `walls`: px back to an upright one, to start from.
    """
    first = Place(guess.light, 4.0, False, TILT, inf, traces[0].size)
    traces = [replace(one, joined=_largest(one.joined)) for one in traces]

    def rated(k: int, place: Place) -> Fit:
        if (against := contrary(place.light, guess)) == inf:
            return Fit(place, -inf, 0.0)
        likeness, factor = traces[k].likeness(place)
        return Fit(place, likeness - _odd(place, factor) - against, factor)

    starts = [
        (k, rated(k, replace(place, backdrop=wall)))
        for k in range(len(traces))
        for wall in walls
        for place in _starts(first, guess)
        if wall == inf or place.light.direction[2] > 0.3
    ]
    starts.sort(key=lambda start: -start[1].likeness)

    def climbed(k: int, fit: Fit) -> Fit:
        for place in _steps(fit.place):
            if (other := rated(k, place)).likeness > fit.likeness and other.factor > 0:
                fit = other
        return fit

    k, best = max(((k, climbed(k, fit)) for k, fit in starts[:3]), key=lambda end: end[1].likeness)
    for _ in range(2):
        before, best = best, climbed(k, best)
        if best.likeness < before.likeness + 0.005:
            break
    return k, best


def _largest(things: Sequence[Silhouette]) -> list[Silhouette]:
    """Those that tell the light; the small ones would take as long and tell little."""
    areas = [what.area for what in things]
    return [things[k] for k in np.argsort(areas)[::-1][:TELLING]]


def contrary(light: DistantLight, guess: LightGuess) -> float:
    """What a light must explain more for being another than balls told; infinite where it is too far from it."""
    if guess.confidence < TOLD:
        return 0.0
    sure = min((guess.confidence - TOLD) / (WELL - TOLD), 1.0)
    off = ASKEW[0] + sure * (ASKEW[1] - ASKEW[0])
    cosine = sum(a * b for a, b in zip(light.direction, guess.light.direction, strict=True))
    angle = degrees(acos(min(max(cosine, -1.0), 1.0)))
    return inf if angle > min(BEYOND[0], BEYOND[1] * off) else PULL * (angle / off) ** 2


def refined(fine: Trace, place: Place, guess: LightGuess) -> Fit:
    """Smaller steps from a place, in px of `fine`, by the largest things; how alike it is, by all."""

    telling = replace(fine, joined=_largest(fine.joined))

    def odd(where: Place, factor: float) -> float:
        return _odd(where, factor) + contrary(where.light, guess)

    def rated(where: Place) -> Fit:
        if contrary(where.light, guess) == inf:
            return Fit(where, -inf, 0.0)
        likeness, factor = telling.likeness(where)
        return Fit(where, likeness - odd(where, factor), factor)

    fit = rated(place)
    for step, times in ((0.12, 1), (0.06, 2), (0.03, 1)):
        for _ in range(times):
            before = fit
            for where in list(_near(fit.place, step)):
                if (other := rated(where)).likeness > fit.likeness and other.factor > 0:
                    fit = other
            if fit is before:  # the same steps again would lead nowhere either
                break
    if fit.likeness == -inf:
        return fit
    return Fit(fit.place, *fine.likeness(fit.place))


def before_wall(fine: Trace, fit: Fit, guess: LightGuess) -> Fit | None:
    """The same before a wall, where shadows on one at some distance are seen as well as those on the floor."""
    if fit.place.light.direction[2] < 0.2:
        return None

    telling = _largest(fine.joined)
    floors = [what.floor for what in fine.joined if what.floor is not None]
    plain = foretold(telling, replace(fit.place, backdrop=inf))

    def better(place: Place, on_floor: F32) -> float:
        """Correlation above the wall's foot; 0 where the floor alone, going on there, explains as much."""
        foot = min(floors, default=inf) - place.tilt * place.backdrop - 3
        on_both = foretold(telling, place)
        likeness, factor = fine.agreement(on_both, foot)
        more = fine.explained(on_both, foot) > MORE * fine.explained(on_floor, foot)
        return likeness if more and 0.2 < factor < 4 else 0.0

    backs = np.geomspace(*NEAREST_FARTHEST, 12) * typical(fine.silhouettes)
    tries = [replace(fit.place, backdrop=float(back)) for back in backs]
    for likeness, _, place in sorted(((better(p, plain), -k, p) for k, p in enumerate(tries)), reverse=True)[
        :2
    ]:
        if likeness > HALF_SEEN:
            found = refined(fine, place, guess)
            alone = foretold(telling, replace(found.place, backdrop=inf))
            if found.place.backdrop < inf and better(found.place, alone) > BY_A_WALL:
                return found
    return None


def settled(fine: Trace, fit: Fit) -> Fit:
    """The shadows of what flies high moved onto dark places near by, and the light's softness looked for again.

    What is far off is drawn smaller, which no distant light explains.
    """
    best = fit
    wide = (2.0,) if fit.place.softness > 2.0 else ()
    for guess in (fit.place.softness, *wide):  # a light thought wide covers what lies astray
        place = replace(fit.place, softness=guess)
        shifts = tuple(_astray(fine, what, place) for what in fine.joined)
        if not any(dx or dy for dx, dy in shifts):
            continue
        for soft in (guess, 0.5 * guess, 2 * guess):
            place = replace(fit.place, softness=soft)
            likeness, factor = fine.agreement(foretold(fine.joined, place, shifts))
            if likeness > best.likeness:
                best = replace(fit, place=place, likeness=likeness, factor=factor, shifts=shifts)
    return best


def _astray(fine: Trace, what: Silhouette, place: Place) -> Shift:
    """Where the thing's own shadow lies, seen from where it is foretold; nowhere else for what stands on the floor."""
    if what.floor is None:
        return 0, 0
    flies = what.floor - what.corner[1] - what.coverage.shape[0]
    across, down = int(ASTRAY * flies), int(0.3 * ASTRAY * flies)
    if flies < what.thick or across < 2:
        return 0, 0
    model = foretold([what], place)
    best, where = fine.agreement(model)[0] + MOVED, (0, 0)
    x, y, right, lower = 0, 0, across, down
    while right > 1 or lower > 1:  # a finer and finer grid about the best so far
        for dy in range(y - lower, y + lower + 1, max(1, lower // 3)):
            for dx in range(x - right, x + right + 1, max(1, right // 5)):
                likeness, _ = fine.agreement(np.roll(model, (dy, dx), axis=(0, 1)))
                if likeness > best:
                    best, where = likeness, (dx, dy)
        (x, y), right, lower = where, right // 4, lower // 4
    return where


def _odd(place: Place, factor: float) -> float:
    """What a fit must explain more for being odd: low or high light, a steep or a flat floor, other darkness."""
    x, y, z = place.light.direction
    length = (x * x + z * z) ** 0.5 / max(-y, 0.05)
    slant = 0.03 * max(length - 2, 0.0) + 0.03 * max(0.4 - length, 0.0)
    strength = 0.03 * abs(np.log(max(factor, 0.05)))
    return float(slant + 0.02 * abs(np.log(place.tilt / TILT)) + strength)


def _starts(first: Place, guess: LightGuess) -> Iterator[Place]:
    if -guess.light.direction[1] > 0.1:
        yield first
    yield replace(first, light=DistantLight((0.0, -1.0, 0.0), 0.3, 0.9))
    for k in range(12):
        turn = 2 * pi * k / 12
        for height in (0.4, 0.75):
            flat = (1 - height**2) ** 0.5
            yield replace(first, light=_towards(first.light, (flat * cos(turn), -height, flat * sin(turn))))


def _turned(place: Place, step: float) -> Iterator[Place]:
    """The light turned about the upright, and higher and lower, by so many radians."""
    x, y, z = place.light.direction
    turn, rise = atan2(z, x), asin(min(max(-y, -1.0), 1.0))
    for around, up in ((step, 0), (-step, 0), (0, step), (0, -step), (step, -step), (-step, -step)):
        a, e = turn + around / max(cos(rise), 0.3), rise + up
        if sin(e) > 0.1 and e < pi / 2:
            yield replace(place, light=_towards(place.light, (cos(e) * cos(a), -sin(e), cos(e) * sin(a))))


def _steps(place: Place) -> Iterator[Place]:
    """Neighbours of a place, one number changed."""
    yield from _turned(place, 0.15)
    yield from _turned(place, 0.06)
    for soft in (1.0, 3.0, 6.0, 12.0, 25.0):
        yield replace(place, softness=soft)
    for share in (0.2, 0.5, 0.85):
        yield replace(place, light=DistantLight(place.light.direction, share * 1.2, (1 - share) * 1.2))
    for tilt in (0.05, 0.08, 0.12, 0.17):
        yield replace(place, tilt=tilt)
    if place.backdrop < inf:
        for part in (0.7, 0.85, 1.15, 1.4):
            yield replace(place, backdrop=part * place.backdrop)


def _near(place: Place, step: float) -> Iterator[Place]:
    yield from _turned(place, step)
    for by in (1 + 4 * step, 1 / (1 + 4 * step)):
        yield replace(place, softness=min(max(place.softness * by, 0.5), 45.0))
    for by in (1 + 2 * step, 1 / (1 + 2 * step)):
        yield replace(place, tilt=min(max(place.tilt * by, 0.02), 0.5))
        if place.backdrop < inf:
            yield replace(place, backdrop=place.backdrop * by)
    now = place.light.intensity / max(place.light.intensity + place.light.ambient, 1e-6)
    for share in (min(now + step, 0.98), max(now - step, 0.02)):
        yield replace(place, light=DistantLight(place.light.direction, share * 1.2, (1 - share) * 1.2))


def _towards(light: DistantLight, direction: Sequence[float]) -> DistantLight:
    x, y, z = (float(c) for c in direction)
    return DistantLight((x, y, z), light.intensity, light.ambient)
