"""Whether the light on a round object is that of a sphere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physgen.geometry.polygon import Array, Disc
from physgen.materials import Kind
from physgen.perceive.roles import Rgb
from physgen.photometry import decode


@dataclass(frozen=True)
class SphereConstants:
    """Constants of the test; chosen on the round objects of COCO's photos."""

    # of the radius: farther out pixels are mixed with what is behind
    inner: float = 0.9
    dark: float = 0.03  # linear light: colours below tell little in logarithms
    least: int = 30  # pixels: a smaller disc shows no shading
    pixels: int = 4000  # at most, that are looked at
    rounds: int = 5  # of reweighted least squares
    outlier: float = 0.1  # of log light, from which a pixel counts less
    stiff: float = 1e-4  # of the pixels: keeps the system regular
    residual: float = 0.33  # of log light that the shading of a sphere leaves, at most
    explained: float = 0.6  # of the variance of log light that it explains, at least
    rim: float = 0.8  # of the radius, from which the rim's light is taken
    middle: float = 0.4  # of the radius, up to which the middle's is
    dimmest: float = -0.95  # log of the rim's light over the middle's: a tyre has less
    brightest: float = -0.08  # the same of a sphere in even light
    plain: float = 0.05  # of log light: a drawing without shading tells nothing


SPHERE = SphereConstants()
ROUND_FORMS = ("ball", "lump", "disc", "hoop", "turned")
"""Of `materials.Kind`: what may have a circle for its outline."""


def has_round_form(what: Kind) -> bool:
    """Return whether a kind of object may have a circle for its outline."""
    return what.form in ROUND_FORMS


@dataclass(frozen=True)
class SphereFit:
    """The shading of a sphere, fitted to a disc of a photo."""

    residual: float
    """Standard deviation of log light that it leaves."""
    shading: float
    """Standard deviation of log light that it has itself."""
    rim: float
    """Log of its light at the rim over that in the middle."""

    @property
    def is_plain(self) -> bool:
        """Return whether the disc has neither shading nor texture, as drawings have."""
        return max(self.residual, self.shading) < SPHERE.plain

    @property
    def is_sphere(self) -> bool:
        """Return whether the light is that of a sphere."""
        variance = self.residual**2 + self.shading**2
        is_smooth = self.residual <= SPHERE.residual
        is_explained = self.shading**2 >= SPHERE.explained * variance
        is_round = SPHERE.dimmest <= self.rim <= SPHERE.brightest
        return is_smooth and is_explained and is_round


def is_shaded_as_sphere(rgb: Rgb, disc: Disc) -> bool:
    """Return whether a disc of the photo is lit as a sphere is.

    Windows, faces, handles and seams leave more light unexplained. A disc without any
    shading, as in drawings, counts as a sphere: nothing contradicts its outline.
    """
    fit = fit_sphere_shading(rgb, disc)
    return fit is not None and (fit.is_plain or fit.is_sphere)


def fit_sphere_shading(rgb: Rgb, disc: Disc) -> SphereFit | None:
    """Return the fit of light of second degree (Basri and Jacobs 2003) on a sphere.

    None if the photo shows too few pixels of the disc.
    """
    (left, top), radius = disc.center - disc.radius, disc.radius
    x0, y0 = max(int(left), 0), max(int(top), 0)
    part = rgb[y0 : int(top + 2 * radius) + 2, x0 : int(left + 2 * radius) + 2]
    rows, columns = np.indices(part.shape[:2])
    u = (columns + x0 - disc.center[0]) / radius
    v = (rows + y0 - disc.center[1]) / radius
    inside = np.flatnonzero(np.hypot(u, v) < SPHERE.inner)
    if len(inside) < SPHERE.least:
        return None
    inside = inside[:: -(-len(inside) // SPHERE.pixels)]
    light = decode(part.reshape(-1, 3)[inside]).mean(axis=1)
    level = np.log(light + SPHERE.dark).astype(np.float64)
    return _fitted(level, u.ravel()[inside], v.ravel()[inside])


def _fitted(level: Array, u: Array, v: Array) -> SphereFit:
    """Return the fit by iteratively reweighted least squares."""
    z = np.sqrt(1 - u * u - v * v)
    one = np.ones_like(u)
    harmonics = [one, u, v, z, u * v, u * z, v * z, u * u - v * v, z * z]
    rows = np.column_stack(harmonics)
    stiffness = SPHERE.stiff * len(level) * np.eye(rows.shape[1])
    weight = np.ones(len(level))
    shading = level
    for _ in range(SPHERE.rounds):
        weighted = rows * weight[:, None]
        solution = np.linalg.solve(weighted.T @ rows + stiffness, weighted.T @ level)
        shading = rows @ solution
        weight = 1 / np.maximum(np.abs(level - shading) / SPHERE.outlier, 1)
    away = np.hypot(u, v)
    outer, middle = away > SPHERE.rim, away < SPHERE.middle
    rim = 0.0
    if outer.any() and middle.any():
        rim = float(shading[outer].mean() - shading[middle].mean())
    return SphereFit(float((level - shading).std()), float(shading.std()), rim)
