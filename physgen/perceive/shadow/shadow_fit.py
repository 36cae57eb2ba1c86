"""Fit of a distant light to the shadows in a side view, on the floor and on a wall."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import acos, asin, atan2, cos, degrees, inf, pi, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.shadows import ShadowSetting as Place
from physgen.geometry.shadows import Silhouette, shadow_darkness
from physgen.perceive.roles import LightGuess, Rgb
from physgen.perceive.shadow.silhouettes import join_silhouettes, typical_size
from physgen.photometry import DistantLight, decode, luminance

# ----------------------------------------------------------------------
# A photo's light at one scale, and what darkness that geometry foretells has to do with it.
#
# What is compared is where light changes, not how much there is: slopes of the logarithm of light, at two
# widths, with
# those of a darkness, near these alone. A far edge of the floor or a picture on the wall has slopes too, but
# elsewhere.

F32 = NDArray[np.float32]
Shift = tuple[int, int]
"""px right and down."""

DARKEST = 2e-3
"""Linear light added before logarithms are taken."""
WIDTHS = (0.03, 0.08)
"""Of an object's size: how far slopes are smoothed."""
LEAST_SEEN = 0.1
"""Of the foretold slopes, as much must be in sight."""


@dataclass(frozen=True)
class LightGradients:
    """A photo's light at one scale, and what may keep some of it away."""

    scale: float
    """px of the photo in one of this picture."""
    size: tuple[int, int]
    """Width and height, px."""
    known: F32
    """(h, w) 1 where no object is near."""
    slopes: Sequence[tuple[float, F32, F32, F32]]
    """Width of smoothing, px; (h, w) how much is known within it; (h, w) slopes of the logarithm of light, x and y."""
    silhouettes: Sequence[Silhouette]
    joined: Sequence[Silhouette]
    """The same, those that stand side by side as one."""

    @cached_property
    def within(self) -> F32:
        """(h, w) `known`, a pixel less on all sides."""
        return np.asarray(cv2.erode(self.known, np.ones((3, 3), np.uint8)), np.float32)

    def likeness(self, place: Place) -> tuple[float, float]:
        """Correlation of seen slopes and those of a light's shadows, and the factor from one to the other."""
        return self.agreement(predicted_darkness(self.joined, place))

    def agreement(self, model: F32, above: float = inf) -> tuple[float, float]:
        """Correlation of seen slopes and those of a darkness (h, w), and the factor; means over the widths.

        Told by the rows `above` a row alone, px.
        """
        sums = self._sums(model, above)
        alike = [both / max((own * seen) ** 0.5, 1e-9) for both, own, seen in sums]
        factors = [both / max(own, 1e-9) for both, own, _ in sums]
        return (sum(alike) / len(sums), sum(factors) / len(sums)) if sums else (0.0, 0.0)

    def explained(self, model: F32, above: float) -> float:
        """Squares of the seen slopes that a darkness explains at its best strength, of one sign."""
        return sum(max(both, 0.0) ** 2 / max(own, 1e-9) for both, own, _ in self._sums(model, above))

    def _sums(self, model: F32, above: float) -> list[tuple[float, float, float]]:
        """Of each width: products of foretold and seen slopes, squares of either, near what is foretold.

        Nothing where hardly any of it is in sight.
        """
        rows, columns = np.flatnonzero(model.max(axis=1) > 0.02), np.flatnonzero(model.max(axis=0) > 0.02)
        if len(rows) < 2 or len(columns) < 2:
            return []
        pad = int(3 * self.slopes[-1][0]) + 4
        top, left = max(int(rows[0]) - pad, 0), max(int(columns[0]) - pad, 0)
        part = np.s_[top : int(rows[-1]) + pad + 1, left : int(columns[-1]) + pad + 1]
        model, known = np.minimum(model[part], 2.5), self.known[part]
        within = self.within[part].copy()
        told = max(int(min(above, len(self.known))) - top, 0)
        within[told:] = 0
        found = []
        for width, near, right, down in self.slopes:
            soft = cv2.GaussianBlur(model * known, (0, 0), width) / np.maximum(near[part], 0.05)
            dy, dx = np.gradient(soft)
            energy = np.asarray(dx * dx + dy * dy, np.float32)
            edges = energy > 0.01 * float((energy * within).max())
            weight = within * cv2.dilate(edges.astype(np.uint8), np.ones((9, 9), np.uint8))
            own = float((weight * energy).sum())
            if own <= LEAST_SEEN * float(energy[:told].sum()):
                return []
            both = -float((weight * (dx * right[part] + dy * down[part])).sum())
            found.append((both, own, float((weight * (right[part] ** 2 + down[part] ** 2)).sum())))
        return found


def predicted_darkness(things: Sequence[Silhouette], place: Place, shifts: Sequence[Shift] = ()) -> F32:
    """(h, w) -log of the light that things leave; `shifts`: by how much each one's shadow lies elsewhere, whole px."""
    w, h = place.size
    model = np.zeros((h, w), np.float32)
    for k, what in enumerate(things):
        if (found := shadow_darkness(what, place)) is None:
            continue
        (x0, y0, x1, y1), values = found
        dx, dy = shifts[k] if shifts else (0, 0)
        left, top = max(x0 + dx, 0), max(y0 + dy, 0)
        right, bottom = min(x1 + dx, w), min(y1 + dy, h)
        if right > left and bottom > top:
            model[top:bottom, left:right] += values[
                top - y0 - dy : bottom - y0 - dy, left - x0 - dx : right - x0 - dx
            ]
    return model


def light_gradients(
    background: Rgb, coverage: F32, longest: int, of: Callable[[float], Sequence[Silhouette]]
) -> LightGradients | None:
    """The photo at a scale; `of` gives the objects' silhouettes at it. None where there are none."""
    scale = max(max(background.shape[:2]) / longest, 1.0)
    things = of(scale)
    if not things:
        return None
    h, w = (max(1, round(n / scale)) for n in background.shape[:2])
    light = np.log(luminance(decode(background)) + DARKEST)
    open_ = (cv2.dilate((coverage > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) == 0).astype(np.float32)
    share = np.asarray(cv2.resize(open_, (w, h), interpolation=cv2.INTER_AREA), np.float32)
    small = np.asarray(cv2.resize(light * open_, (w, h), interpolation=cv2.INTER_AREA), np.float32)
    small = np.asarray(small / np.maximum(share, 0.05), np.float32)
    known = np.asarray(share * (share > 0.5), np.float32)
    slopes = []
    for part in WIDTHS:
        width = max(part * typical_size(things), 1.0)
        near = np.asarray(cv2.GaussianBlur(known, (0, 0), width), np.float32)
        down, right = np.gradient(cv2.GaussianBlur(small * known, (0, 0), width) / np.maximum(near, 0.05))
        slopes.append((width, near, np.asarray(right, np.float32), np.asarray(down, np.float32)))
    return LightGradients(scale, (w, h), known, slopes, things, join_silhouettes(things))


# ----------------------------------------------------------------------
# Photo from the side -> the light whose shadows on the floor, and on a wall behind, go with the photo's own.

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
class LightFit:
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


def scale_place(place: Place, by: float, size: tuple[int, int]) -> Place:
    """The same place on a picture so much larger."""
    return replace(place, backdrop=place.backdrop * by, size=size)


def search_light(
    traces: Sequence[LightGradients], guess: LightGuess, walls: Sequence[float] = (inf,)
) -> tuple[int, LightFit]:
    """By steps along one number after the other, from several directions: which trace, and the light in its px.

    `traces`: of one size, with floors in different places. `walls`: px back to an upright one, to start from.
    """
    first = Place(guess.light, 4.0, False, TILT, inf, traces[0].size)
    traces = [replace(one, joined=_largest(one.joined)) for one in traces]

    def rated(k: int, place: Place) -> LightFit:
        if (against := deviation_penalty(place.light, guess)) == inf:
            return LightFit(place, -inf, 0.0)
        likeness, factor = traces[k].likeness(place)
        return LightFit(place, likeness - _odd(place, factor) - against, factor)

    starts = [
        (k, rated(k, replace(place, backdrop=wall)))
        for k in range(len(traces))
        for wall in walls
        for place in _starts(first, guess)
        if wall == inf or place.light.direction[2] > 0.3
    ]
    starts.sort(key=lambda start: -start[1].likeness)

    def climbed(k: int, fit: LightFit) -> LightFit:
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


def deviation_penalty(light: DistantLight, guess: LightGuess) -> float:
    """What a light must explain more for being another than balls told; infinite where it is too far from it."""
    if guess.confidence < TOLD:
        return 0.0
    sure = min((guess.confidence - TOLD) / (WELL - TOLD), 1.0)
    off = ASKEW[0] + sure * (ASKEW[1] - ASKEW[0])
    cosine = sum(a * b for a, b in zip(light.direction, guess.light.direction, strict=True))
    angle = degrees(acos(min(max(cosine, -1.0), 1.0)))
    return inf if angle > min(BEYOND[0], BEYOND[1] * off) else PULL * (angle / off) ** 2


def refine_light(fine: LightGradients, place: Place, guess: LightGuess) -> LightFit:
    """Smaller steps from a place, in px of `fine`, by the largest things; how alike it is, by all."""

    telling = replace(fine, joined=_largest(fine.joined))

    def odd(where: Place, factor: float) -> float:
        return _odd(where, factor) + deviation_penalty(where.light, guess)

    def rated(where: Place) -> LightFit:
        if deviation_penalty(where.light, guess) == inf:
            return LightFit(where, -inf, 0.0)
        likeness, factor = telling.likeness(where)
        return LightFit(where, likeness - odd(where, factor), factor)

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
    return LightFit(fit.place, *fine.likeness(fit.place))


def fit_wall(fine: LightGradients, fit: LightFit, guess: LightGuess) -> LightFit | None:
    """The same before a wall, where shadows on one at some distance are seen as well as those on the floor."""
    if fit.place.light.direction[2] < 0.2:
        return None

    telling = _largest(fine.joined)
    floors = [what.floor for what in fine.joined if what.floor is not None]
    plain = predicted_darkness(telling, replace(fit.place, backdrop=inf))

    def better(place: Place, on_floor: F32) -> float:
        """Correlation above the wall's foot; 0 where the floor alone, going on there, explains as much."""
        foot = min(floors, default=inf) - place.tilt * place.backdrop - 3
        on_both = predicted_darkness(telling, place)
        likeness, factor = fine.agreement(on_both, foot)
        more = fine.explained(on_both, foot) > MORE * fine.explained(on_floor, foot)
        return likeness if more and 0.2 < factor < 4 else 0.0

    backs = np.geomspace(*NEAREST_FARTHEST, 12) * typical_size(fine.silhouettes)
    tries = [replace(fit.place, backdrop=float(back)) for back in backs]
    for likeness, _, place in sorted(((better(p, plain), -k, p) for k, p in enumerate(tries)), reverse=True)[
        :2
    ]:
        if likeness > HALF_SEEN:
            found = refine_light(fine, place, guess)
            alone = predicted_darkness(telling, replace(found.place, backdrop=inf))
            if found.place.backdrop < inf and better(found.place, alone) > BY_A_WALL:
                return found
    return None


def settle_shadows(fine: LightGradients, fit: LightFit) -> LightFit:
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
            likeness, factor = fine.agreement(predicted_darkness(fine.joined, place, shifts))
            if likeness > best.likeness:
                best = replace(fit, place=place, likeness=likeness, factor=factor, shifts=shifts)
    return best


def _astray(fine: LightGradients, what: Silhouette, place: Place) -> Shift:
    """Where the thing's own shadow lies, seen from where it is foretold; nowhere else for what stands on the floor."""
    if what.floor is None:
        return 0, 0
    flies = what.floor - what.corner[1] - what.coverage.shape[0]
    across, down = int(ASTRAY * flies), int(0.3 * ASTRAY * flies)
    if flies < what.thick or across < 2:
        return 0, 0
    model = predicted_darkness([what], place)
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


# ----------------------------------------------------------------------
# Photo from the side -> where on a wall behind them the objects' shadows lie: all of them moved alike.
#
# One distant light moves every shadow on an upright wall by the same way; seen in perspective, farther off,
# the whole is
# a little smaller. That way and size are looked for at which the outlines go with slopes of the photo's
# light.

SIZES = (1.0, 0.94, 0.88, 0.82)
"""How large the objects are when drawn as far back as the wall."""
FARTHEST = 5.0
"""Of an object's size: how far from it its shadow is looked for."""
IN_SIGHT = 0.5
"""Share of all outlines that must lie in the photo, and free."""
STEEPEST = 97
"""Percentile of the photo's slopes: steeper ones are edges of things, and count as this."""


@dataclass(frozen=True)
class WallShadow:
    """The objects' shadows on a wall, in px of the photo."""

    shift: tuple[float, float]
    """From an object to its shadow, in the middle of the photo."""
    size: float
    """Of shadow to object, about the middle of the photo."""
    likeness: float
    """Correlation of slopes along the outlines."""
    factor: float
    """-log of the light that is left."""
    soft: float = 0.0
    """px, standard deviation of the shadows' edges."""

    def convincing(self, things: int) -> bool:
        """One round thing finds a round patch almost anywhere; several must find theirs all at once."""
        return self.likeness >= float(0.5 + 0.35 / max(things, 1) ** 0.5)


def cast_on_wall(what: Silhouette, cast: WallShadow, scale: float, size: tuple[int, int]) -> F32:
    """(h, w) coverage of the wall by its shadow, on a picture of `size` (w, h), 1 / scale of the photo's."""
    middle = (size[0] - 1) / 2, (size[1] - 1) / 2
    matrix = np.zeros((2, 3))
    for k in (0, 1):
        matrix[k, k] = cast.size
        matrix[k, 2] = cast.size * (what.corner[k] - middle[k]) + middle[k] + cast.shift[k] / scale
    return np.asarray(cv2.warpAffine(what.coverage, matrix, size, flags=cv2.INTER_LINEAR), np.float32)


def wall_coverage(trace: LightGradients, cast: WallShadow) -> F32:
    """(h, w) coverage of the wall by all shadows, on the trace's picture."""
    total = np.zeros(trace.known.shape, np.float32)
    for what in trace.silhouettes:
        np.maximum(total, cast_on_wall(what, cast, trace.scale, trace.size), out=total)
    soft = cast.soft / trace.scale
    return total if soft < 0.3 else np.asarray(cv2.GaussianBlur(total, (0, 0), soft), np.float32)


def refine_wall_shadow(trace: LightGradients, cast: WallShadow) -> WallShadow:
    """Smaller steps from a cast, and the softness of its edges, on a finer picture."""

    def rated(one: WallShadow) -> WallShadow:
        likeness, factor = trace.agreement(wall_coverage(trace, one))
        return replace(one, likeness=likeness, factor=factor)

    best = rated(replace(cast, soft=trace.slopes[0][0] * trace.scale))
    for step in (4.0, 2.0, 1.0):
        (dx, dy), by = best.shift, 0.01 * step
        tries = [
            replace(best, shift=(dx + a * step, dy + b * step)) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))
        ]
        tries += [replace(best, size=best.size + by), replace(best, size=best.size - by)]
        tries += [replace(best, soft=best.soft * 1.5), replace(best, soft=best.soft / 1.5)]
        for _ in range(2):
            best = max([best, *(rated(one) for one in tries)], key=lambda one: one.likeness)
            (dx, dy) = best.shift
            tries = [
                replace(best, shift=(dx + a * step, dy + b * step))
                for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))
            ]
            tries += [replace(best, soft=best.soft * 1.5), replace(best, soft=best.soft / 1.5)]
    return best


def find_wall_shadow(trace: LightGradients) -> WallShadow | None:
    """The best way to move the objects onto their shadows; None where no way keeps enough of them in sight."""
    width, near, right, down = trace.slopes[-1]
    within = cv2.erode(trace.known, np.ones((3, 3), np.uint8)) * (near > 0.3)
    steep = np.hypot(right, down)
    free = steep[within > 0]
    if not free.size:
        return None
    cut = np.minimum(1, np.percentile(free, STEEPEST) / np.maximum(steep, 1e-6))
    right, down = within * right * cut, within * down * cut
    shape = (cv2.getOptimalDFTSize(2 * trace.size[1]), cv2.getOptimalDFTSize(2 * trace.size[0]))
    spectra = [np.fft.rfft2(part, shape) for part in (right, down, right * right + down * down, within)]
    rows, columns = (np.fft.fftfreq(n, 1 / n)[:, None] for n in shape)
    reach = FARTHEST * typical_size(trace.silhouettes)
    allowed = (np.abs(columns.T) < reach) & (rows > -0.12 * reach) & (rows < reach)
    best: WallShadow | None = None
    for size in SIZES:
        outline = np.zeros(trace.known.shape, np.float32)
        for what in trace.silhouettes:
            still = WallShadow((0.0, 0.0), size, 0.0, 0.0)
            np.maximum(outline, cast_on_wall(what, still, 1.0, trace.size), out=outline)
        dy, dx = np.gradient(cv2.GaussianBlur(outline, (0, 0), width))
        energy = dx * dx + dy * dy
        edges = (energy > 0.02 * energy.max()).astype(np.float32)
        band = np.asarray(cv2.dilate(edges, np.ones((5, 5), np.uint8)), np.float32)

        def moved(k: int, by: F32) -> NDArray[np.float64]:
            return np.fft.irfft2(spectra[k] * np.conj(np.fft.rfft2(by, shape)), shape)

        both = -(moved(0, dx) + moved(1, dy))
        own, seen = np.maximum(moved(3, energy), 1e-9), np.maximum(moved(2, band), 1e-9)
        likeness = np.where(allowed & (own > IN_SIGHT * energy.sum()), both / np.sqrt(own * seen), -1.0)
        row, column = np.unravel_index(int(likeness.argmax()), likeness.shape)
        if likeness[row, column] > (best.likeness if best else 0.0):
            shift = float(columns[column, 0]) * trace.scale, float(rows[row, 0]) * trace.scale
            best = WallShadow(
                shift, size, float(likeness[row, column]), float(both[row, column] / own[row, column])
            )
    return best
