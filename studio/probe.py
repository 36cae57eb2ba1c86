"""The light of a stage as the scene file has it: a direction, intensity and ambient, fitted to what truly falls there.

A small white sphere is imagined where the objects are, with no objects there: how much light a matt patch of it would
send back is measured for many directions of the patch, and ambient + intensity max(0, normal . direction) fitted to it.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from exposure import Studio, irradiance
from optics import dr, mi
from stage import Camera, Thing

LUMA = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class Light:
    """In the units of the photo: a matt surface of albedo 1 develops from its shading x exposure."""

    direction: list[float]
    """Unit, towards the light: +x right, +y down, +z to the viewer."""
    intensity: float
    ambient: float
    colour: list[float]
    """RGB of the directional part, mean 1."""
    residual: float
    """Root mean square of what the model misses, as a share of the mean shading."""


def probe(studio: Studio, clean: object, normals: int = 400, rays: int = 4096) -> Light:
    """`clean` is the scene without its things."""
    stage, camera = studio.stage, studio.camera
    rng = np.random.default_rng(5)
    n = rng.standard_normal((normals, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    n = n[n @ camera.axes[2] > 0.05]  # patches that the camera can see
    places = np.array([middle(camera, thing) for thing in stage.things])
    spot = np.repeat(places[rng.integers(len(places), size=len(n))], rays, 0).T
    normal = np.repeat(n, rays, 0).T
    hit = dr.zeros(mi.SurfaceInteraction3f, spot.shape[1])
    hit.p, hit.n = mi.Point3f(spot), mi.Normal3f(normal)
    hit.sh_frame = mi.Frame3f(mi.Normal3f(normal))
    hit.t = mi.Float(1.0) + dr.zeros(mi.Float, spot.shape[1])
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(11, spot.shape[1])
    light = irradiance(studio, clean, hit, sampler)
    shading = (
        np.stack([np.array(c).reshape(len(n), rays).mean(1) for c in light], -1)
        * stage.exposure
    )
    grey = shading @ LUMA
    image = n @ camera.axes.T * [1, -1, 1]
    if stage.sun is None:
        ambient, vector = _fit(image, grey)
    else:
        towards = np.array(stage.sun) @ camera.axes.T * [1, -1, 1]
        towards /= np.linalg.norm(towards)
        facing = np.maximum(image @ towards, 0)
        (ambient, strength), *_ = np.linalg.lstsq(
            np.column_stack([np.ones(len(facing)), facing]), grey, rcond=None
        )
        ambient, vector = max(float(ambient), 0.0), strength * towards
    strength = float(np.linalg.norm(vector))
    model = ambient + np.maximum(image @ vector, 0)
    direction = vector / max(strength, 1e-9)
    facing = np.maximum(image @ direction, 0)
    colour = [float(np.polyfit(facing, shading[:, k], 1)[0]) for k in range(3)]
    colour_ = np.maximum(colour, 0) / max(np.mean(np.maximum(colour, 0)), 1e-9)
    return Light(
        [round(float(v), 4) for v in direction],
        round(strength, 4),
        round(float(ambient), 4),
        [round(float(c), 3) for c in colour_],
        round(float(np.sqrt(np.mean((grey - model) ** 2)) / grey.mean()), 4),
    )


def middle(camera: Camera, thing: Thing) -> np.ndarray:
    """(3,) m: the middle of a thing's section; things drawn from their foot have their origin on the table."""
    shape = thing.shape(camera)
    if "polygon" in shape:
        outline = np.array(shape["polygon"], np.float32)
        moments = cv2.moments(outline)
        px = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
    else:
        px = np.array(next(iter(shape.values()))["center"])
    film = (np.array(camera.size) - 1) / 2
    right, up = (px - film) / camera.ppm * [1, -1] + camera.centre
    if camera.view == "top":
        return np.array([right, up, camera.plane])
    return np.array([right, thing.depth, up])


def _fit(normals: np.ndarray, shading: np.ndarray) -> tuple[float, np.ndarray]:
    """Least squares of ambient + max(0, n . b), ambient not negative: linear in what is lit, iterated to rest."""
    weight = np.maximum(shading - np.percentile(shading, 20), 0)
    b = (weight[:, None] * normals).sum(0)
    b *= (shading.max() - shading.min()) / max(np.linalg.norm(b), 1e-9)
    ambient = float(shading.min())
    for _ in range(100):
        lit = normals @ b > 0
        rows = np.column_stack([np.ones(len(normals)), normals * lit[:, None]])
        found = np.linalg.lstsq(rows, shading, rcond=None)[0]
        step = found[1:] - b
        ambient, b = float(found[0]), b + 0.5 * step
        if np.linalg.norm(step) < 1e-6 * np.linalg.norm(b):
            break
    return max(ambient, 0.0), b
