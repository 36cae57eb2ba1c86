from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen import registry
from physgen.photometry import DistantLight, decode, encode_u8, luminance
from tests.perceive.lambertian import ball, plain, rendered, towards

H, W = 200, 260
Y, X = np.mgrid[:H, :W].astype(np.float32)
FACING = np.broadcast_to(np.array([0, 0, 1], np.float32), (H, W, 3)).copy()
NOTHING = np.zeros((H, W), np.uint16)
RED, BLUE = np.array([0.5, 0.12, 0.08]), np.array([0.08, 0.14, 0.35])


def parted(linear, labels=NOTHING, normals=FACING):
    rgb = encode_u8(np.clip(linear, 0, 1))
    return decode(rgb), registry.make("intrinsic", "retinex")(rgb, labels, normals)


def checker() -> np.ndarray:
    return np.where(((X // 26 + Y // 26) % 2 == 0)[..., None], RED, BLUE).astype(
        np.float32
    )


def contrast(values, inner, around) -> float:
    """Logarithm of the mean in `around` over that in `inner`."""
    return float(np.log(values[around].mean() / values[inner].mean()))


def test_paint_stays_in_albedo():
    linear, found = parted(checker())
    painted = np.log(luminance(linear)).std()
    assert np.log(found.shading[20:-20, 20:-20]).std() < 0.35 * painted


@pytest.mark.parametrize("softness", [2.0, 5.0])
def test_a_cast_shadow_on_a_painted_plane_is_shading(softness):
    inside = (np.hypot(X - 130, Y - 100) < 45).astype(np.float32)
    dim = 1 - 0.6 * cv2.GaussianBlur(inside, (0, 0), softness)
    _, found = parted(checker() * dim[..., None])
    inner, around = np.hypot(X - 130, Y - 100) < 30, np.hypot(X - 130, Y - 100) > 65
    seen = np.log(1 / 0.4)
    assert contrast(found.shading, inner, around) > 0.55 * seen
    assert contrast(luminance(found.albedo), inner, around) < 0.45 * seen


def test_a_plain_balls_light_is_shading():
    normals, labels, _ = ball()
    light = DistantLight(towards(-0.6, -0.5, 0.6), 0.8, 0.2)
    albedo = plain(labels=labels)
    rgb = rendered(normals, albedo, light)
    found = registry.make("intrinsic", "retinex")(rgb, labels, normals)
    own = cv2.erode((labels > 0).astype(np.uint8), np.ones((7, 7))) > 0
    rest, before = (
        np.log(luminance(a))[own].std() for a in (found.albedo, decode(rgb))
    )
    assert rest < 0.5 * before


def test_together_they_are_the_photo_at_any_exposure():
    first = None
    for exposure in (0.3, 1.0):
        linear, found = parted(exposure * checker())
        assert np.abs(found.albedo * found.shading[..., None] - linear).max() < 0.01
        first = found.albedo if first is None else first
    assert np.abs(first - found.albedo).mean() < 0.06


def test_mirrored_photo_mirrored_albedo():
    linear = checker() * (0.4 + 0.6 * X / W)[..., None]
    _, one = parted(linear)
    _, two = parted(linear[:, ::-1])
    assert np.abs(one.albedo - two.albedo[:, ::-1]).mean() < 0.01


def test_behind_a_table_there_is_less_light():
    linear = np.full((H, W, 3), 0.4, np.float32)
    linear[: H // 2] = (0.08, 0.1, 0.12)
    table = FACING.copy()
    table[H // 2 :] = (0, -0.99, 0.14)
    shares = []
    for normals in (FACING, table):
        _, found = parted(linear, normals=normals)
        shares.append(np.log(found.shading[-60:].mean() / found.shading[:60].mean()))
    assert shares[1] > shares[0] + 0.2


def stood(*paints):
    """Boxes of these paints side by side on a table, in even light; their labels and normals."""
    linear, labels, normals = (
        np.full((H, W, 3), 0.3, np.float32),
        NOTHING.copy(),
        FACING.copy(),
    )
    normals[120:] = (0, -0.99, 0.14)
    linear[:120] = 0.18
    for k, paint in enumerate(paints):
        box = np.s_[90:150, 30 + 80 * k : 80 + 80 * k]
        linear[box], labels[box], normals[box] = paint, k + 1, (0, 0, 1)
    return linear, labels, normals


def test_things_beside_each_other_are_lit_alike_and_painted_not():
    linear, labels, normals = stood((0.6, 0.6, 0.55), (0.08, 0.09, 0.1))
    _, found = parted(linear, labels, normals)
    one, two = (
        cv2.erode((labels == i).astype(np.uint8), np.ones((9, 9))) > 0 for i in (1, 2)
    )
    seen = contrast(luminance(linear), two, one)
    assert abs(contrast(found.shading, two, one)) < 0.3 * seen
    assert contrast(luminance(found.albedo), two, one) > 0.7 * seen
