"""Test whether a round object is lit as a sphere."""

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

    # Radius of the tested disc; outside it pixels are mixed with the background.
    inner: float = 0.9
    # Linear light: logarithms of darker colours are noise.
    darkest: float = 0.03
    # Least number of pixels of a disc with measurable shading.
    least_pixels: int = 30
    # Largest number of sampled pixels.
    pixels: int = 4000
    # Rounds of reweighted least squares.
    rounds: int = 5
    # Residual of log light above which a pixel gets less weight.
    outlier: float = 0.1
    # Ridge term per pixel: keeps the system regular.
    stiff: float = 1e-4
    # Largest residual of log light of a sphere.
    residual: float = 0.33
    # Least share of the variance of log light that a sphere's shading explains.
    variance_share: float = 0.6
    # Inner radius of the rim.
    rim: float = 0.8
    # Outer radius of the middle.
    middle: float = 0.4
    # Least log ratio of light at the rim and in the middle; a tyre has less.
    dimmest: float = -0.95
    # Largest log ratio of a sphere: that in even light.
    brightest: float = -0.08
    # Log light: a drawing without shading has less variation and proves nothing.
    least_variation: float = 0.05


SPHERE = SphereConstants()
ROUND_FORMS = ("ball", "lump", "disc", "hoop", "turned")
"""Values of `materials.Kind.form` of objects that may have a circular outline."""


def has_round_form(noun_kind: Kind) -> bool:
    """Return whether objects of a kind may have a circular outline."""
    return noun_kind.form in ROUND_FORMS


@dataclass(frozen=True)
class SphereFit:
    """The shading of a sphere, fitted to a disc of a photo."""

    residual: float
    """Unexplained standard deviation of log light."""
    shading: float
    """Explained standard deviation of log light."""
    rim: float
    """Log ratio of the light at the rim and in the middle."""

    @property
    def has_plain_disc(self) -> bool:
        """Return whether the disc has neither shading nor texture, as in drawings."""
        return max(self.residual, self.shading) < SPHERE.least_variation

    @property
    def is_sphere(self) -> bool:
        """Return whether the light is that of a sphere."""
        variance = self.residual**2 + self.shading**2
        has_small_residual = self.residual <= SPHERE.residual
        has_shading = self.shading**2 >= SPHERE.variance_share * variance
        has_dark_rim = SPHERE.dimmest <= self.rim <= SPHERE.brightest
        return has_small_residual and has_shading and has_dark_rim


def is_shaded_as_sphere(rgb: Rgb, disc: Disc) -> bool:
    """Return whether a disc of the photo is lit as a sphere.

    Windows, faces, handles and seams leave larger residuals. A disc without any
    shading, as in drawings, counts as a sphere, because its outline is the only
    evidence.
    """
    fit = fit_sphere_shading(rgb, disc)
    return fit is not None and (fit.has_plain_disc or fit.is_sphere)


def fit_sphere_shading(rgb: Rgb, disc: Disc) -> SphereFit | None:
    """Return the fit of second-degree light (Basri and Jacobs 2003) on a sphere.

    Returns None if the photo shows too few pixels of the disc.
    """
    (left, top), radius = disc.center - disc.radius, disc.radius
    x0 = max(int(left), 0)
    y0 = max(int(top), 0)
    part = rgb[y0 : int(top + 2 * radius) + 2, x0 : int(left + 2 * radius) + 2]
    rows, columns = np.indices(part.shape[:2])
    u = (columns + x0 - disc.center[0]) / radius
    v = (rows + y0 - disc.center[1]) / radius
    inside = np.flatnonzero(np.hypot(u, v) < SPHERE.inner)
    if len(inside) < SPHERE.least_pixels:
        return None
    inside = inside[:: -(-len(inside) // SPHERE.pixels)]
    light = decode(part.reshape(-1, 3)[inside]).mean(axis=1)
    level = np.log(light + SPHERE.darkest).astype(np.float64)
    return _fit_shading(level, u.ravel()[inside], v.ravel()[inside])


def _fit_shading(level: Array, u: Array, v: Array) -> SphereFit:
    """Return the fit by iteratively reweighted least squares.

    Highlights and prints get less weight, so that they do not bend the fit.
    """
    z = np.sqrt(1 - u * u - v * v)
    constant = np.ones_like(u)
    harmonics = [constant, u, v, z, u * v, u * z, v * z, u * u - v * v, z * z]
    rows = np.column_stack(harmonics)
    stiffness = SPHERE.stiff * len(level) * np.eye(rows.shape[1])
    weight = np.ones(len(level))
    shading = level
    for _ in range(SPHERE.rounds):
        weighted_rows = rows * weight[:, None]
        solution = np.linalg.solve(
            weighted_rows.T @ rows + stiffness, weighted_rows.T @ level
        )
        shading = rows @ solution
        weight = 1 / np.maximum(np.abs(level - shading) / SPHERE.outlier, 1)
    distance = np.hypot(u, v)
    outer = distance > SPHERE.rim
    middle = distance < SPHERE.middle
    rim = 0.0
    if outer.any() and middle.any():
        rim = float(shading[outer].mean() - shading[middle].mean())
    return SphereFit(float((level - shading).std()), float(shading.std()), rim)
