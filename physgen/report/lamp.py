"""A scene's light -> words and a picture: a white ball in it, and an arrow from where it comes."""

from __future__ import annotations

from math import hypot

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import DistantLight, encode_u8, sphere_normals
from physgen.render.ink import Colour, Layer
from physgen.render.marks import circle, straight_arrow
from physgen.scene.model import Light

U8 = NDArray[np.uint8]

SUN: Colour = (255, 205, 64)


def light_words(light: Light) -> str:
    """Where it comes from, as one says it.

    >>> light_words(Light((-0.6, -0.64, 0.48), 1.0, 0.25, 2.0))
    'From the upper left, in front of the scene; 20 % of it from all around.'
    """
    x, y, z = light.direction
    across = "" if abs(x) < 0.2 else "right" if x > 0 else "left"
    up = "" if abs(y) < 0.2 else "above" if y < 0 else "below"
    corner = {"above": "upper", "below": "lower"}.get(up, "")
    where = f"the {corner} {across}" if across and up else f"the {across}" if across else up
    deep = "" if abs(z) < 0.2 else "in front of the scene" if z > 0 else "behind the scene"
    share = light.ambient / max(light.ambient + light.intensity, 1e-6)
    whence = ", ".join(part for part in (where, deep) if part)
    return f"From {whence}; {share:.0%} of it from all around.".replace("%", " %", 1)


def light_picture(light: Light, size: tuple[int, int]) -> U8:
    """(h, w, 3) of `size` (w, h): a white ball in the light, an arrow from where that comes."""
    width, height = size
    radius, middle = 0.26 * min(size), np.array([(width - 1) / 2, (height - 1) / 2])
    card = _ball(light, size, radius)
    way = np.array(light.direction[:2])
    flat, toward = float(hypot(*way)), light.direction[2]
    layer, pen = Layer(size, 1.0), max(2.0, min(size) / 90)
    if flat > 0.12:
        tail, tip = middle + 1.75 * radius * way, middle + 1.12 * radius * way
        if toward < 0:  # it ends behind the ball's rim
            tip = middle + way / flat * max(1.12 * flat, 1.04) * radius
            tail = tip + way / flat * max(0.63 * flat, 0.3) * radius
        straight_arrow(layer, tail, tip, pen)
    else:  # straight at us, or from us
        spot = middle + radius * way
        layer.line(circle(spot, 4.2 * pen), pen, closed=True)
        if toward > 0:
            layer.area(circle(spot, 1.3 * pen))
    layer.onto(card, SUN)
    return card


def _ball(light: Light, size: tuple[int, int], radius: float, fine: int = 3) -> U8:
    """The ball is drawn `fine` times as large and averaged, in linear light, so that its rim is smooth."""
    width, height = size
    across = (np.arange(width, dtype=np.float32) / width - 0.5)[None]
    down = (np.arange(height, dtype=np.float32) / height - 0.5)[:, None]
    linear = 0.06 - 0.05 * np.hypot(across, down)
    # a box around it that begins and ends with whole pixels
    x0, y0 = (int((side - 1) / 2 - radius) - 1 for side in size)
    wide, tall = width - 2 * x0, height - 2 * y0
    normals, inside = sphere_normals(
        fine * tall, fine * wide, ((fine * wide - 1) / 2, (fine * tall - 1) / 2), radius * fine
    )
    lamp = DistantLight(light.direction, light.intensity, light.ambient)
    shades = 0.86 * lamp.shade(normals) / max(light.ambient + light.intensity, 1e-6)
    box = linear[y0 : y0 + tall, x0 : x0 + wide]
    around = box.repeat(fine, axis=0).repeat(fine, axis=1)
    drawn = np.where(inside, np.maximum(shades, 0.012), around).astype(np.float32)
    box[:] = cv2.resize(drawn, (wide, tall), interpolation=cv2.INTER_AREA)
    return np.repeat(encode_u8(linear)[..., None], 3, 2)
