"""Backend shadow=geometry: shadows removed and the light that casts them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import cos, inf, pi, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.shadows import ShadowSetting as Place
from physgen.geometry.shadows import Silhouette, blurred, shadow_darkness
from physgen.perceive.roles import (
    BoundaryGuess,
    Labels,
    LightGuess,
    Matter,
    PhotoObject,
    Rgb,
    Shadow,
    Shadows,
)
from physgen.perceive.shadow.ambient_shade import AmbientShade, extend_behind_objects, find_ambient_shade
from physgen.perceive.shadow.shadow_assignment import shadow_owners, shadow_owners_by_model
from physgen.perceive.shadow.shadow_fit import deviation_penalty
from physgen.perceive.shadow.side_view import side_view_shadows
from physgen.perceive.shadow.silhouettes import object_silhouettes, typical_size
from physgen.photometry import DistantLight, decode, encode_u8, luminance
from physgen.scene.scene import View

F32 = NDArray[np.float32]
Matters = Mapping[int, Matter]

COARSE = 176
"""px: longer side of the picture in which the light is looked for."""
FLOOR = 2e-3
"""Linear light added before logarithms are taken."""
SURE = 0.5
"""Correlation of what is foretold with what is dark, from which shadows are believed."""
HUES = 6
"""Kinds of surface that are told apart by their hue."""
RING = 2
"""px around objects where the background still shows traces of them."""


def geometry() -> Shadow:
    """The backend `geometry`."""
    return _geometry


@dataclass(frozen=True)
class _Scene:
    """What the search compares, at a coarse scale."""

    dark: F32
    """(h, w): by how much the logarithm of light stays below that of the surroundings."""
    weight: F32
    """(h, w): where it counts."""
    silhouettes: Sequence[Silhouette]
    size: float
    """px of a typical object."""

    def score(self, place: Place) -> tuple[float, float]:
        """Correlation of foretold and seen darkness, and the factor from one to the other."""
        model = np.zeros(self.dark.shape, np.float32)
        for what in self.silhouettes:
            found = shadow_darkness(what, place)
            if found is not None:
                (x0, y0, x1, y1), values = found
                model[y0:y1, x0:x1] += values
        model = np.minimum(model, 2.5)
        side = 2 * round(0.7 * self.size) + 1
        w = self.weight * cv2.dilate((model > 0.04).astype(np.uint8), np.ones((side, side), np.uint8))
        count = max(float(w.sum()), 1.0)
        model, dark = (
            model - float((w * model).sum()) / count,
            self.dark - float((w * self.dark).sum()) / count,
        )
        both, square = float((w * model * dark).sum()), float((w * model * model).sum())
        seen = float((w * dark * dark).sum())
        return both / max((square * seen) ** 0.5, 1e-9), both / max(square, 1e-9)


def _geometry(
    background: Rgb,
    coverage: F32,
    labels: Labels,
    things: Sequence[PhotoObject],
    matter: Matters,
    setting: BoundaryGuess,
    light: LightGuess,
) -> Shadows:
    if setting.view is View.SIDE:
        return side_view_shadows(background, coverage, labels, things, matter, setting, light)
    scene = _scene(background, coverage, labels, things, matter, setting)
    nothing = Shadows(None, None, light.light, 4.0, 4.0, None, 0.0, "no shadow of the objects is seen")
    if scene is None:
        return nothing

    def at(scale: float) -> list[Silhouette]:
        return object_silhouettes(labels, things, matter, setting, scale)

    place, score, factor = _search(scene, light)
    if score < SURE or factor < 0.15:
        shade = find_ambient_shade(background, coverage, at, from_above=True)
        return nothing if shade is None else _soft(background, coverage, shade, at(1.0), light.light)
    even = _even(place, factor)
    dark = _seen(background, coverage, labels, things, matter, setting, even)
    clean = encode_u8(decode(background) * np.exp(dark)[..., None])
    full = replace(even, size=(labels.shape[1], labels.shape[0]))
    casts = [(what.id, *found) for what in at(1.0) if (found := shadow_darkness(what, full)) is not None]
    reason = f"where the objects' shadows lie (correlation {score:.2f})"
    whose = shadow_owners(background, clean, coverage, casts)
    sure = round(min(0.9, score), 2)
    return Shadows(clean, whose, even.light, round(even.softness, 1), 4.0, None, sure, reason)


def _soft(
    background: Rgb, coverage: F32, shade: AmbientShade, things: Sequence[Silhouette], light: DistantLight
) -> Shadows:
    """What soft light leaves of itself about rims is too faint, and too near, to be seen but on the whole."""
    found = [(what.id, *cast) for what in things if (cast := shadow_darkness(what, shade.place)) is not None]
    casts = [(who, box, np.asarray(shade.factor * dark, np.float32)) for who, box, dark in found]
    dark = np.zeros(coverage.shape, np.float32)
    for _, (x0, y0, x1, y1), values in casts:
        dark[y0:y1, x0:x1] += values
    clean = encode_u8(decode(background) * np.exp(extend_behind_objects(dark, coverage))[..., None])
    whose = shadow_owners_by_model(coverage, casts, dark)
    soft = shade.place.softness
    return Shadows(clean, whose, light, soft, 4.0, None, shade.confidence, shade.reason, faint=True)


def _scene(
    background: Rgb,
    coverage: F32,
    labels: Labels,
    things: Sequence[PhotoObject],
    matter: Matters,
    setting: BoundaryGuess,
) -> _Scene | None:
    scale = max(max(background.shape[:2]) / COARSE, 1.0)
    found = object_silhouettes(labels, things, matter, setting, scale)
    if not found:
        return None
    h, w = (max(1, round(n / scale)) for n in background.shape[:2])
    light = np.log(luminance(decode(background)) + FLOOR)
    open_ = (cv2.dilate((coverage > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) == 0).astype(np.float32)
    known = np.asarray(cv2.resize(open_, (w, h), interpolation=cv2.INTER_AREA), np.float32)
    small = np.asarray(cv2.resize(light * open_, (w, h), interpolation=cv2.INTER_AREA), np.float32)
    small = np.where(known > 0.05, small / np.maximum(known, 0.05), 0).astype(np.float32)
    size = typical_size(found)
    weight = known * (known > 0.5)
    dark = _around(small, known, size) - small
    dark = np.clip(dark, -0.3, 1.2)
    return _Scene(
        np.asarray(dark, np.float32),
        np.asarray(weight, np.float32),
        found,
        size,
    )


def _around(values: F32, weight: F32, size: float) -> F32:
    """The mean of what is known round about."""
    sigma = 1.2 * size
    sums = cv2.GaussianBlur(values * weight, (0, 0), sigma)
    return np.asarray(sums / np.maximum(cv2.GaussianBlur(weight, (0, 0), sigma), 1e-3), np.float32)


def _search(scene: _Scene, light: LightGuess) -> tuple[Place, float, float]:
    """The best light and place by steps along one number after the other, from several directions."""
    h, w = scene.dark.shape
    start = Place(light.light, 4.0, True, 0.1, inf, (w, h))

    def allowed(place: Place) -> bool:
        return deviation_penalty(place.light, light) < inf

    def best(starts: list[Place]) -> tuple[Place, float, float]:
        found: tuple[Place, float, float] = (start, *scene.score(start))
        tries = [(scene.score(place)[0], k, place) for k, place in enumerate(starts) if allowed(place)]
        for _, _, place in sorted(tries, key=lambda t: (-t[0], t[1]))[:2]:
            now = (place, *scene.score(place))
            for _ in range(2):
                for other in _steps(now[0]):
                    if allowed(other):
                        score, factor = scene.score(other)
                        if score > now[1]:
                            now = (other, score, factor)
            if now[1] > found[1]:
                found = now
        return found

    return best(list(_starts(start)))


def _starts(place: Place) -> Iterator[Place]:
    yield place
    for k in range(12):
        turn = 2 * pi * k / 12
        for height in (0.9, 0.75, 0.5):
            flat = (1 - height**2) ** 0.5
            yield replace(place, light=_towards(place.light, (flat * cos(turn), flat * sin(turn), height)))


def _steps(place: Place) -> Iterator[Place]:
    """Neighbours of a place, one number changed."""
    x, y, z = place.light.direction
    for dx, dy, dz in ((0.15, 0, 0), (0, 0.15, 0), (0, 0, 0.15)):
        for sign in (1, -1, 0.4, -0.4):
            new = np.array([x + sign * dx, y + sign * dy, z + sign * dz])
            if new[2] > 0.1:
                yield replace(place, light=_towards(place.light, tuple(new / np.linalg.norm(new))))
    for soft in (0.5, 2.0, 5.0, 10.0, 18.0, 28.0):
        yield replace(place, softness=soft)
    for share in (0.15, 0.35, 0.6, 0.85):
        yield replace(place, light=DistantLight(place.light.direction, share * 1.2, (1 - share) * 1.2))


def _towards(light: DistantLight, direction: Sequence[float]) -> DistantLight:
    x, y, z = (float(c) for c in direction)
    return DistantLight((x, y, z), light.intensity, light.ambient)


def _even(place: Place, factor: float) -> Place:
    """The share of direct light made such that the foretold shadows are as dark as the seen ones."""
    x, y, z = place.light.direction
    facing = max(z, 0.05)
    share = min(place.direct((0.0, 0.0, 1.0)) * min(max(factor, 0.3), 1.6), 0.97)
    ambient = max(place.light.ambient, 0.05)
    intensity = min(share / (1 - share) * ambient / facing, 100.0 * ambient)
    total = (
        intensity + ambient
    ) / 1.2  # where it falls straight, a surface shows its own colour: shading 1.2
    return replace(place, light=DistantLight((x, y, z), intensity / total, ambient / total))


def _seen(
    background: Rgb,
    coverage: F32,
    labels: Labels,
    things: Sequence[PhotoObject],
    matter: Matters,
    setting: BoundaryGuess,
    place: Place,
) -> F32:
    """(H, W) -log of the light that the photo shows to be missing, within reach of what geometry foretells."""
    H, W = coverage.shape
    full = replace(place, size=(W, H))
    model = np.zeros((H, W), np.float32)
    casting = object_silhouettes(labels, things, matter, setting, 1.0)
    for what in casting:
        if (found := shadow_darkness(what, full)) is not None:
            (x0, y0, x1, y1), values = found
            model[y0:y1, x0:x1] += values
    size = typical_size(casting)
    solid = cv2.dilate((coverage > 0).astype(np.uint8), np.ones((2 * RING + 1, 2 * RING + 1), np.uint8)) > 0
    side = 2 * max(1, round(0.2 * size)) + 1
    wide = cv2.dilate(model, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)))
    reach = blurred(np.asarray(wide, np.float32), max(2.0, 0.15 * size))
    region = (reach > 0.03) | solid
    linear = decode(background)
    light = np.log(luminance(linear) + FLOOR)
    smooth = np.asarray(cv2.medianBlur(light, 5), np.float32)
    reference = _reference(linear, smooth, ~region, size)
    most = 1.7 * np.maximum(model, reach) + 0.2
    window = np.clip(reach / 0.08, 0, 1)
    dark = np.clip(reference - smooth, 0, most) * window
    return np.asarray(dark, np.float32)


def _reference(linear: F32, light: F32, known: NDArray[np.bool_], size: float) -> F32:
    """(H, W): the light of like-coloured surfaces round about, from where it is `known`."""
    grey = linear.sum(axis=2) + 3 * FLOOR
    hue = cv2.GaussianBlur(np.dstack([(linear[..., c] + FLOOR) / grey for c in (0, 2)]), (0, 0), 2)
    sample = np.ascontiguousarray(hue[known][:: max(1, int(known.sum()) // 8000)], np.float32)
    total = np.full(light.shape, 1e-6, np.float32)
    if len(sample) < HUES:
        return light
    cv2.setRNGSeed(1)
    _, names, centers = cv2.kmeans(
        sample, HUES, np.zeros((len(sample), 1), np.int32), (3, 20, 1e-3), 1, cv2.KMEANS_PP_CENTERS
    )
    width = max(0.03, 2 * float(np.abs(sample - centers[names.ravel()]).mean()))
    result = 1e-6 * light
    w = known.astype(np.float32)
    for center in centers:
        kin = np.exp(-((hue - center) ** 2).sum(-1) / (2 * width * width)).astype(np.float32)
        sums, weights = np.full(light.shape, 1e-9, np.float32) * light, np.full(light.shape, 1e-9, np.float32)
        for sigma, gain in ((0.4 * size, 1.0), (1.0 * size, 0.05), (3 * size, 0.002)):
            sums = sums + gain * blurred(light * w * kin, sigma)
            weights = weights + gain * blurred(w * kin, sigma)
        result = result + kin * sums / weights
        total = total + kin
    return np.asarray(result / total, np.float32)
