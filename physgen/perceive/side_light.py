"""Photo from the side -> the light whose shadows on the floor go with the photo's own.

A floor seen from the side is a strip a few pixels high. What is compared is where light changes, not how much there is:
the slopes of the logarithm of light, at two widths, with those of the shadows that a light foretells, near these alone.
A far edge of the floor or a picture on the wall has slopes too, but elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import cos, inf, pi, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import LightGuess, Rgb
from physgen.perceive.silhouettes import joined, typical
from physgen.photometry import DistantLight, decode, luminance
from physgen.shadow import Setting as Place
from physgen.shadow import Silhouette, darkness

F32 = NDArray[np.float32]
Shift = tuple[int, int]
"""px right and down."""

DARKEST = 2e-3
"""Linear light added before logarithms are taken."""
COARSE, FINE = 320, 640
"""px: longer side of the pictures in which the light is looked for, first and then."""
WIDTHS = (0.03, 0.08)
"""Of an object's size: how far slopes are smoothed."""
TRUSTED = 0.77
"""Cosine of the angle to a light that balls told with a confidence of TOLD or more."""
TOLD = 0.5
TILT = 0.1
"""Rise over run of the floor where nothing tells."""
WALLED = 0.1
"""By how much more a wall behind the objects must explain: it explains almost any dark patch somewhere."""
ASTRAY = 0.15
"""Of its height: how far aside the shadow of a thing in the air may lie from where it is foretold; less up or down."""
MOVED = 0.05
"""By how much better it must explain what is seen there."""
LEAST_SEEN = 0.1
"""Of the foretold slopes, as much must be in sight."""


@dataclass(frozen=True)
class Trace:
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

    def likeness(self, place: Place) -> tuple[float, float]:
        """Correlation of seen slopes and those of a light's shadows, and the factor from one to the other."""
        return self.agreement(foretold(self.joined, place))

    def agreement(self, model: F32) -> tuple[float, float]:
        """Correlation of seen slopes and those of a darkness (h, w), and the factor; means over the widths."""
        rows, columns = np.flatnonzero(model.max(axis=1) > 0.02), np.flatnonzero(model.max(axis=0) > 0.02)
        if len(rows) < 2 or len(columns) < 2:
            return 0.0, 0.0
        pad = int(3 * self.slopes[-1][0]) + 4
        part = np.s_[
            max(rows[0] - pad, 0) : rows[-1] + pad + 1, max(columns[0] - pad, 0) : columns[-1] + pad + 1
        ]
        model, known = np.minimum(model[part], 2.5), self.known[part]
        within = np.asarray(cv2.erode(known, np.ones((3, 3), np.uint8)), np.float32)
        result = np.zeros(2)
        for width, near, right, down in self.slopes:
            soft = cv2.GaussianBlur(model * known, (0, 0), width) / np.maximum(near[part], 0.05)
            dy, dx = np.gradient(soft)
            energy = np.asarray(dx * dx + dy * dy, np.float32)
            most = float((energy * within).max())
            edges = cv2.dilate((energy > 0.01 * most).astype(np.float32), np.ones((9, 9), np.uint8))
            weight = within * np.asarray(edges, np.float32)
            own = float((weight * energy).sum())
            if own < LEAST_SEEN * float(energy.sum()):
                return 0.0, 0.0
            both = -float((weight * (dx * right[part] + dy * down[part])).sum())
            seen = float((weight * (right[part] ** 2 + down[part] ** 2)).sum())
            result += (both / max((own * seen) ** 0.5, 1e-9), both / max(own, 1e-9))
        correlation, factor = (result / len(self.slopes)).tolist()
        return correlation, factor


def foretold(things: Sequence[Silhouette], place: Place, shifts: Sequence[Shift] = ()) -> F32:
    """(h, w) -log of the light that things leave; `shifts`: by how much each one's shadow lies elsewhere, whole px."""
    w, h = place.size
    model = np.zeros((h, w), np.float32)
    for k, what in enumerate(things):
        if (found := darkness(what, place)) is None:
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


def trace(
    background: Rgb, coverage: F32, longest: int, of: Callable[[float], Sequence[Silhouette]]
) -> Trace | None:
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
        width = max(part * typical(things), 1.0)
        near = np.asarray(cv2.GaussianBlur(known, (0, 0), width), np.float32)
        down, right = np.gradient(cv2.GaussianBlur(small * known, (0, 0), width) / np.maximum(near, 0.05))
        slopes.append((width, near, np.asarray(right, np.float32), np.asarray(down, np.float32)))
    return Trace(scale, (w, h), known, slopes, things, joined(things))


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
    """By how much the shadow of each thing (of a trace's `joined`) lies elsewhere than foretold."""


def scaled(place: Place, by: float, size: tuple[int, int]) -> Place:
    """The same place on a picture so much larger."""
    return replace(place, backdrop=place.backdrop * by, size=size)


def best_light(
    traces: Sequence[Trace], guess: LightGuess, walls: Sequence[float] = (inf,)
) -> tuple[int, Fit]:
    """By steps along one number after the other, from several directions: which trace, and the light in its px.

    `traces`: of one size, with floors in different places. `walls`: px back to an upright wall, to start from.
    """
    near = TRUSTED if guess.confidence >= TOLD else -1.0
    toward = np.array(guess.light.direction)
    first = Place(guess.light, 4.0, False, TILT, inf, traces[0].size)

    def rated(k: int, place: Place) -> Fit:
        told = float(toward @ np.array(place.light.direction)) >= near
        likeness, factor = traces[k].likeness(place) if told else (-1.0, 0.0)
        return Fit(place, likeness - _odd(place, factor), factor)

    starts = [
        (k, rated(k, replace(place, backdrop=wall)))
        for k in range(len(traces))
        for wall in walls
        for place in _starts(first, guess)
        if wall == inf or place.light.direction[2] > 0.3
    ]
    starts.sort(key=lambda start: -start[1].likeness)
    best = starts[0]
    for k, fit in starts[:3]:
        for _ in range(3):
            before = fit
            for place in _steps(fit.place):
                if (other := rated(k, place)).likeness > fit.likeness and other.factor > 0:
                    fit = other
            if fit.likeness < before.likeness + 0.005:
                break
        if fit.likeness > best[1].likeness:
            best = k, fit
    return best


def refined(fine: Trace, place: Place) -> Fit:
    """Smaller steps from a place, in px of `fine`."""

    def rated(where: Place) -> Fit:
        likeness, factor = fine.likeness(where)
        return Fit(where, likeness - _odd(where, factor), factor)

    fit = rated(place)
    for step in (0.12, 0.06, 0.06, 0.03, 0.03):
        for where in list(_near(fit.place, step)):
            if (other := rated(where)).likeness > fit.likeness and other.factor > 0:
                fit = other
    return replace(fit, likeness=fit.likeness + _odd(fit.place, fit.factor))


def settled(fine: Trace, fit: Fit) -> Fit:
    """The shadows of what flies high moved onto dark places near by, and the light's softness looked for again.

    What is far off is drawn smaller, which no distant light explains.
    """
    best = fit
    for guess in (fit.place.softness, 2.0):  # a light thought wide covers what lies astray
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
    for dy in range(-down, down + 1, max(1, down // 6)):
        for dx in range(-across, across + 1, max(1, across // 12)):
            moved = np.roll(model, (dy, dx), axis=(0, 1))
            if (likeness := fine.agreement(moved)[0]) > best:
                best, where = likeness, (dx, dy)
    return where


def _odd(place: Place, factor: float) -> float:
    """What a fit must explain more for being odd: low or high light, a steep or a flat floor, other darkness."""
    x, y, z = place.light.direction
    length = (x * x + z * z) ** 0.5 / max(-y, 0.05)
    slant = 0.03 * max(length - 2, 0.0) + 0.03 * max(0.4 - length, 0.0)
    strength = 0.03 * abs(np.log(max(factor, 0.05)))
    return float(slant + 0.02 * abs(np.log(place.tilt / TILT)) + strength + WALLED * (place.backdrop < inf))


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
    x, y, z = place.light.direction
    for dx, dy, dz in ((step, 0, 0), (0, step, 0), (0, 0, step)):
        for sign in (1, -1):
            new = np.array([x + sign * dx, y + sign * dy, z + sign * dz])
            if -new[1] > 0.1:
                yield replace(place, light=_towards(place.light, tuple(new / np.linalg.norm(new))))


def _steps(place: Place) -> Iterator[Place]:
    """Neighbours of a place, one number changed."""
    yield from _turned(place, 0.15)
    yield from _turned(place, 0.06)
    for soft in (1.0, 3.0, 6.0, 12.0, 20.0, 35.0):
        yield replace(place, softness=soft)
    for share in (0.15, 0.35, 0.6, 0.85):
        yield replace(place, light=DistantLight(place.light.direction, share * 1.2, (1 - share) * 1.2))
    for tilt in (0.05, 0.08, 0.11, 0.14, 0.18):
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
