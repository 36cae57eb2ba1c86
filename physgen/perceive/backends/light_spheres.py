"""Photo and round outlines -> one distant light, from how balls are shaded; a guess where there are none.

A ball's outline gives its normals (a sphere seen from far), its luminance over the ball's own typical colour gives the
shading, and the light that explains it is linear in four unknowns (`photometry.fit_light`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physgen.outline.outline import Disc
from physgen.perceive.roles import Intrinsics, Labels, Light, LightGuess, Rgb, Thing
from physgen.photometry import DistantLight, decode, fit_light, luminance, sphere_normals

FROM_ABOVE = DistantLight((0.0, -0.6, 0.8), 0.8, 0.4)
"""Where lamps and skies mostly are: above and before the scene."""
PLAIN = 0.4
"""Share of a ball's own shades that one light explains, from which it is taken to be of one colour."""
SMALLEST = 8.0
"""px: radius of a ball whose shading can be seen."""


def spheres() -> Light:
    """The backend `spheres`."""
    return _spheres


def _spheres(
    rgb: Rgb, labels: Labels, things: Sequence[Thing], normals: NDArray[np.float32], intrinsics: Intrinsics
) -> LightGuess:
    linear = luminance(decode(rgb))
    parts = [
        samples
        for thing in things
        if isinstance(thing.outline, Disc) and thing.outline.radius >= SMALLEST
        if (samples := _samples(linear, labels, thing.id, thing.outline)) is not None
    ]
    fit = None
    plain = [part for part in parts if (one := fit_light(*part)) is not None and one.explained >= PLAIN]
    parts = plain or parts  # prints and stripes drown the shading of the others
    if parts:
        shading = np.concatenate([part[0] for part in parts])
        normals = np.concatenate([part[1] for part in parts])
        fit = fit_light(shading, normals)
    if fit is None or fit.light.intensity < 0.05 or fit.explained < 0.1:
        return LightGuess(
            FROM_ABOVE, 0.1, "nothing round shows the light; taken to come from above and the front"
        )
    light = fit.light
    total = (
        light.ambient + light.intensity
    )  # where it falls straight, a surface shows its own colour: shading 1.2
    even = DistantLight(light.direction, 1.2 * light.intensity / total, 1.2 * light.ambient / total)
    count = f"{len(parts)} balls" if len(parts) > 1 else "one ball"
    sure = round(min(0.8, 0.2 + 0.6 * fit.explained), 2)
    return LightGuess(
        even, sure, f"fitted to the shading of {count}, taken as spheres ({fit.explained:.0%} explained)"
    )


def _samples(
    linear: NDArray[np.float32], labels: Labels, number: int, disc: Disc
) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """Shading `(N,)` and normals `(N, 3)` of one ball, its blurred rim left out, at most about 2000 pixels."""
    height, width = linear.shape
    center = float(disc.center[0]), float(disc.center[1])
    left, top = (max(0, int(c - disc.radius)) for c in center)
    right, bottom = (
        min(width, int(center[0] + disc.radius) + 2),
        min(height, int(center[1] + disc.radius) + 2),
    )
    if right - left < 3 or bottom - top < 3:
        return None
    here = (slice(top, bottom), slice(left, right))
    h, w = linear[here].shape
    normals, _ = sphere_normals(h, w, (center[0] - left, center[1] - top), disc.radius)
    seen = (labels[here] == number) & (normals[..., 2] > 0.3)
    if seen.sum() < 50:
        return None
    values = linear[here][seen]
    step = max(1, len(values) // 2000)
    typical = float(np.median(values)) + 1e-4
    return values[::step] / np.float32(typical), normals[seen][::step]
