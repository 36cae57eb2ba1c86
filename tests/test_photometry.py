from __future__ import annotations

import numpy as np
import pytest

from physgen.photometry import (
    DistantLight,
    channel_mean,
    channel_sum,
    decode,
    encode,
    encode_u8,
    fit_light,
    largest_channel,
    sphere_normals,
)


def light(
    x: float, y: float, z: float, intensity: float, ambient: float
) -> DistantLight:
    n = np.array([x, y, z]) / np.linalg.norm([x, y, z])
    return DistantLight((float(n[0]), float(n[1]), float(n[2])), intensity, ambient)


def ball() -> np.ndarray:
    normals, inside = sphere_normals(91, 91, (45.0, 45.0), 42.5)
    return normals[inside]


@pytest.mark.parametrize("shape", [(7, 5, 3), (4, 3), (6, 2, 1)])
def test_largest_channel_equals_the_maximum(shape: tuple[int, ...]):
    picture = np.random.default_rng(0).normal(size=shape)
    picture[0, ..., 0] = np.nan
    unchanged = picture.copy()
    assert np.array_equal(
        largest_channel(picture), picture.max(axis=-1), equal_nan=True
    )
    assert np.array_equal(picture, unchanged, equal_nan=True)


@pytest.mark.parametrize("number", [np.float32, np.float64])
def test_sums_of_channels_equal_those_of_numpy(number: type[np.floating]):
    picture = np.random.default_rng(1).normal(size=(40, 30, 3)).astype(number)
    unchanged = picture.copy()
    assert np.array_equal(channel_sum(picture), picture.sum(axis=2))
    assert np.array_equal(channel_mean(picture), picture.mean(axis=2))
    assert channel_mean(picture).dtype == number
    assert np.array_equal(picture, unchanged)


def test_every_code_survives():
    codes = np.arange(256, dtype=np.uint8)
    assert np.array_equal(encode_u8(decode(codes)), codes)


@pytest.mark.parametrize(
    ("srgb", "linear"), [(0.0, 0.0), (0.04045, 0.0031308), (0.5, 0.2140411), (1.0, 1.0)]
)
def test_iec_61966(srgb: float, linear: float):
    assert float(decode(np.array(srgb))) == pytest.approx(linear, abs=2e-7)
    assert float(encode(np.array(linear))) == pytest.approx(srgb, abs=3e-6)


def test_the_table_rounds_like_the_curve():
    values = np.linspace(0, 1, 20001)
    exact = np.floor(encode(values).astype(float) * 255 + 0.5)
    assert np.abs(encode_u8(values) - exact).max() <= 1
    assert np.mean(encode_u8(values) != exact) < 0.002


def test_lambert_in_closed_form():
    lamp = light(0, -1, 0, 0.8, 0.3)
    normals = np.array([[0, -1, 0], [0, 1, 0], [0, -0.5, np.sqrt(0.75)]])
    assert lamp.shade(normals).tolist() == pytest.approx([1.1, 0.3, 0.7])


@pytest.mark.parametrize(
    "xyz", [(0.3, -0.6, 0.74), (-0.9, 0.1, 0.3), (0, 0, 1), (0.5, -0.8, -0.2)]
)
def test_the_light_is_found_exactly(xyz: tuple[float, float, float]):
    lamp = light(*xyz, 0.8, 0.25)
    normals = ball()
    fit = fit_light(lamp.shade(normals), normals)
    assert fit is not None
    assert fit.light.direction == pytest.approx(lamp.direction, abs=1e-4)
    assert (fit.light.intensity, fit.light.ambient) == pytest.approx(
        (0.8, 0.25), abs=1e-4
    )
    assert fit.explained == pytest.approx(1.0, abs=1e-6)


def test_the_light_is_found_under_highlights_and_print():
    lamp, normals, random = (
        light(0.4, -0.5, 0.77, 0.7, 0.3),
        ball(),
        np.random.default_rng(3),
    )
    shading = lamp.shade(normals) + random.normal(0, 0.02, len(normals))
    spots = random.random(len(normals)) < 0.08
    shading[spots] += 1.5
    fit = fit_light(shading, normals)
    assert fit is not None
    angle = np.degrees(
        np.arccos(np.clip(np.dot(fit.light.direction, lamp.direction), -1, 1))
    )
    assert angle < 2
    assert fit.light.intensity == pytest.approx(0.7, abs=0.03)
