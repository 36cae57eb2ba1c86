"""Light: sun, sky, windows, lamps, rooms, as Mitsuba emitters. Radiance in arbitrary linear units; +z is up.

Side view: the camera looks along +y, so a light at negative y stands on the camera's side.
"""

import numpy as np
from optics import T, mi

WARM = np.array([1.0, 0.78, 0.52])
DAY = np.array([1.0, 0.97, 0.93])
BLUE = np.array([0.72, 0.86, 1.0])


def panel(
    at: object,
    target: object,
    size: tuple[float, float],
    radiance: object,
    up: object = (0, 0, 1),
) -> dict:
    """A rectangle of light `at`, facing `target`: a window, a softbox, a lamp's shade. Small ones are hard."""
    aim = T().look_at(
        origin=list(map(float, at)),
        target=list(map(float, target)),
        up=list(map(float, up)),
    )
    return {
        "type": "rectangle",
        "to_world": aim @ T().scale([size[0] / 2, size[1] / 2, 1]),
        "emitter": {
            "type": "area",
            "radiance": {"type": "rgb", "value": np.asarray(radiance, float).tolist()},
        },
    }


def bulb(at: object, radius: float, radiance: object) -> dict:
    """A glowing sphere: the sun's disc (far away) or a bulb."""
    return {
        "type": "sphere",
        "center": list(map(float, at)),
        "radius": radius,
        "emitter": {
            "type": "area",
            "radiance": {"type": "rgb", "value": np.asarray(radiance, float).tolist()},
        },
    }


def sun(
    direction: object, irradiance: object, softness: float = 0.6, far: float = 30.0
) -> dict:
    """Hard light from `direction` (towards the sun): a disc `softness` degrees across radius, `far` m away.

    `irradiance` is what a surface that faces it receives.
    """
    towards = np.asarray(direction, float) / np.linalg.norm(direction)
    radius = far * np.tan(np.radians(softness))
    radiance = np.asarray(irradiance, float) * far**2 / (np.pi * radius**2)
    return bulb(towards * far, radius, radiance)


def environment(light: np.ndarray) -> dict:
    """Light from far away, (H, W, 3) longitude-latitude: row 0 straight up (+z); `sky` says where its columns lie."""
    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(light.astype(np.float32)),
        "to_world": T().rotate([1, 0, 0], 90),
    }


def sky(
    zenith: object, horizon: object, ground: object, patches: list[tuple] = ()
) -> dict:
    """A smooth surrounding, from `zenith` over `horizon` to `ground`, with soft `patches` of (direction, degrees,
    radiance): windows and lamps that glossy things mirror."""
    height, width = 128, 256
    polar = (np.arange(height) + 0.5) / height * np.pi
    around = (np.arange(width) + 0.5) / width * 2 * np.pi
    # what Mitsuba's map looks up, turned so that +z is up
    y = np.cos(polar)[:, None] + 0 * around
    x, z = (
        np.sin(polar)[:, None] * np.sin(around),
        -np.sin(polar)[:, None] * np.cos(around),
    )
    world = np.stack([x, -z, y], -1)
    lift = world[..., 2:]
    zenith, horizon, ground = (np.asarray(c, float) for c in (zenith, horizon, ground))
    above = horizon + (zenith - horizon) * np.clip(lift, 0, 1) ** 0.7
    below = horizon + (ground - horizon) * np.clip(-lift * 4, 0, 1)
    light = np.where(lift > 0, above, below)
    for direction, degrees, radiance in patches:
        towards = np.asarray(direction, float) / np.linalg.norm(direction)
        angle = np.degrees(np.arccos(np.clip(world @ towards, -1, 1)))
        light = light + np.clip((degrees - angle) / 3 + 0.5, 0, 1)[
            ..., None
        ] * np.asarray(radiance, float)
    return environment(light)
