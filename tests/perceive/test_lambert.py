from __future__ import annotations

import numpy as np
import pytest

from physgen import registry
from physgen.perceive.backends.light_shading import highlights
from physgen.photometry import DistantLight, encode_u8
from physgen.scene.scene import View
from tests.perceive.lambertian import (
    ball,
    boxed,
    degrees,
    plain,
    rendered,
    setting,
    towards,
)

SKY = [
    (0, 0, 1), (0.5, -0.5, 0.7), (-0.8, -0.4, 0.4), (0.9, -0.1, 0.4), (0.1, -0.9, 0.4), (-0.2, 0.2, 0.9),
    (0.6, -0.2, 0.7), (-0.5, -0.7, 0.2),
]  # fmt: skip


def found(rgb, labels, things):
    normals = registry.make("normals")(rgb, labels, things, setting(View.TOP))
    return registry.make("light")(
        rgb, labels, things, normals, registry.make("intrinsic")(rgb, labels, normals)
    )


@pytest.mark.parametrize("direction", SKY)
def test_a_plain_ball_shows_the_light(direction):
    normals, labels, thing = ball()
    light = DistantLight(towards(*direction), 0.75, 0.25)
    guess = found(rendered(normals, plain(labels=labels), light), labels, [thing])
    assert degrees(guess.light.direction, light.direction) < 5
    assert guess.confidence > 0.6
    assert guess.light.ambient / guess.light.intensity == pytest.approx(1 / 3, rel=0.5)


@pytest.mark.parametrize("direction", SKY[1:4])
def test_a_painted_ball_shows_it_too(direction):
    normals, labels, thing = ball()
    light = DistantLight(towards(*direction), 0.75, 0.25)
    albedo = plain(labels=labels)
    y, x = np.mgrid[: labels.shape[0], : labels.shape[1]]
    stripes = (labels > 0) & ((x + y) // 18 % 2 == 0)
    albedo[stripes] = (0.08, 0.12, 0.4)
    spots = (labels > 0) & (np.hypot(x % 30 - 15, y % 30 - 15) < 6)
    albedo[spots] = (0.8, 0.8, 0.75)
    guess = found(rendered(normals, albedo, light), labels, [thing])
    assert degrees(guess.light.direction, light.direction) < 10


def test_a_highlight_is_the_lamp_mirrored():
    normals, labels, thing = ball()
    light = DistantLight(towards(-0.5, -0.5, 0.7), 0.75, 0.25)
    half = np.add(light.direction, (0, 0, 1))
    half /= np.linalg.norm(half)
    shine = 0.7 * np.clip(normals @ half, 0, 1) ** 300 * (labels > 0)
    linear = plain(labels=labels) * light.shade(normals)[..., None] + shine[..., None]
    told = highlights(encode_u8(linear), labels, [thing])
    assert len(told) == 1
    assert degrees(told[0], light.direction) < 6
    guess = found(encode_u8(linear), labels, [thing])
    assert degrees(guess.light.direction, light.direction) < 6


def test_an_even_box_shows_little():
    labels, thing = boxed(80, 160, 90, 170)
    normals = np.zeros((*labels.shape, 3), np.float32)
    normals[..., 2] = 1
    rgb = rendered(
        normals, plain(labels=labels), DistantLight((0.0, 0.0, 1.0), 0.7, 0.3)
    )
    assert found(rgb, labels, [thing]).confidence <= 0.3
