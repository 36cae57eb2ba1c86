"""What each library says of a known scene, in its own convention, comes out in ours.

The networks' answers are put in their mouths, right behind their last layer: all that the library does after it, and
all that we do, is the real thing.
"""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import torch

from physgen import registry
from physgen.perceive.backends.depth_anything import DEPTH, invert_depth
from physgen.photometry import decode, encode, encode_u8, luminance
from physgen.registry import Setup
from tests.contract import tiny_depth, tiny_maps

H, W = 48, 64
Y, X = np.mgrid[:H, :W]
PHOTO = np.full((H, W, 3), 120, np.uint8)
NOTHING = np.zeros((H, W), np.uint16)


def ball() -> tuple[np.ndarray, np.ndarray]:
    """Normals of a ball before a wall, +x right, +y down, +z to the viewer, and where the ball is."""
    u, v = (X - 30) / 18, (Y - 24) / 18
    inside = np.hypot(u, v) < 1
    z = np.sqrt(np.clip(1 - u * u - v * v, 0, 1))
    return np.where(inside[..., None], np.stack([u, v, z], -1), (0.0, 0.0, 1.0)).astype(
        np.float32
    ), inside


def says(pipe, *maps: np.ndarray) -> None:
    """The decoder answers one map (H, W, 3) in -1..1 after the other, whatever it is given."""
    left = [
        torch.from_numpy(np.ascontiguousarray(m, np.float32)).permute(2, 0, 1)[None]
        for m in maps
    ]
    pipe.vae.decode = lambda latents, return_dict=True: (left.pop(0).clone(),)


def test_marigolds_normals_come_out_right_side_up(tiny):
    run = registry.make("normals", "marigold", tiny.setup("normals", "marigold"))
    true, inside = ball()
    says(run._model, true * (1, -1, 1))  # theirs: y up
    found = run(PHOTO, NOTHING, [], None)
    off = np.degrees(np.arccos(np.clip((found * true).sum(-1), -1, 1)))
    assert off.max() < 1
    assert found[8, 30, 1] < -0.8  # the ball's top faces up: y is negative
    assert found[24, 46, 0] > 0.8  # its right side faces right
    assert inside[24, 30]
    assert found[24, 30] == pytest.approx([0, 0, 1], abs=0.1)


def test_marigolds_normals_stay_unit_and_seen_in_another_size(tiny):
    run = registry.make("normals", "marigold", tiny.setup("normals", "marigold"))
    true, _ = ball()
    says(run._model, true * (1, -1, 1))
    photo = np.full((3 * H, 3 * W, 3), 120, np.uint8)
    found = run(photo, np.zeros((3 * H, 3 * W), np.uint16), [], None)
    assert np.linalg.norm(found, axis=2) == pytest.approx(1, abs=1e-5)
    large = cv2.resize(true, (3 * W, 3 * H), interpolation=cv2.INTER_LINEAR)
    large /= np.linalg.norm(large, axis=2, keepdims=True)
    assert (found * large).sum(-1).min() > 0.999


def test_marigolds_depth_is_larger_farther(tiny):
    run = registry.make("depth", "marigold", tiny.setup("depth", "marigold"))
    true = 1 - Y / (H - 1)  # a floor that recedes upwards
    says(
        run._model, np.repeat((2 * true - 1)[..., None], 3, -1)
    )  # theirs: 0 near, 1 far
    found = run(PHOTO)
    assert found == pytest.approx(true, abs=1e-3)
    assert found[0, 0] > found[-1, 0]


def answers(run, raw: np.ndarray) -> None:
    """The network answers `raw`, in whatever size it is asked."""

    def network(pixels):
        size = tuple(pixels.shape[-2:])
        resized = torch.from_numpy(cv2.resize(raw, size[::-1]))
        return SimpleNamespace(predicted_depth=resized[None])

    assert run._model is not None  # the real one is loaded, and states its kind
    run._model = network


def test_depth_anythings_inverse_depth_becomes_depth(tiny):
    run = registry.make(
        "depth", "depth-anything", tiny.setup("depth", "depth-anything")
    )
    true = 1 + 2 * (1 - Y / (H - 1))  # 1 m at the lower border, 3 m at the upper
    answers(run, (7.5 / true).astype(np.float32))  # theirs: inverse, in any scale
    column = run(PHOTO)[:, 20]
    assert (np.diff(column) <= 0).all()  # upwards is farther
    ratio = column / column[-1] / (true[:, 20] / true[-1, 20])
    assert ratio == pytest.approx(1, abs=0.06)


def test_inverse_depth_keeps_its_order():
    inverse = np.array([[0.0, 1e-3, 0.5, 4.0, 8.0]], np.float32)
    depth = invert_depth(inverse)
    assert depth[0, 0] == pytest.approx(DEPTH.farthest)
    assert depth[0, -1] == pytest.approx(1)
    assert (np.diff(depth[0]) < 0).all()
    assert (invert_depth(np.zeros((2, 2), np.float32)) == 1).all()


def test_metric_depth_stays_in_metres(tmp_path):
    path = tiny_depth.depth_anything(tmp_path / "metric", "metric")
    setup = Setup(str(path), "cpu", options={"resolution": 70})
    run = registry.make("depth", "depth-anything", setup)
    answers(run, np.where(Y < 20, np.float32(4), np.float32(2)).astype(np.float32))
    found = run(PHOTO)
    assert found[4, 9] == pytest.approx(4)
    assert found[40, 9] == pytest.approx(2)
    assert run.note()["unit"] == "m"


def lit_scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Albedo (H, W, 3) of a chequered board, shading and a highlight (H, W), all linear."""
    red, blue = np.array([0.5, 0.12, 0.08]), np.array([0.08, 0.14, 0.35])
    albedo = np.where(((X // 8 + Y // 8) % 2 == 0)[..., None], red, blue)
    shading = 0.3 + 0.6 * X / W
    gloss = 0.15 * np.exp(-((X - 40) ** 2 + (Y - 20) ** 2) / 60)
    return albedo, shading, gloss


@pytest.mark.parametrize("scales", [(1.0, 1.0), (0.4, 0.8)])
def test_marigolds_lighting_is_linear_and_up_to_scale(tiny, scales):
    albedo, shading, gloss = lit_scene()
    photo = encode_u8(albedo * shading[..., None] + gloss[..., None])
    run = registry.make("intrinsic", "marigold", tiny.setup("intrinsic", "marigold"))
    grey = [
        np.repeat((m * k)[..., None], 3, -1)
        for m, k in zip((shading, gloss), scales, strict=True)
    ]
    says(run._model, *(2 * m - 1 for m in (albedo, *grey)))
    found = run(photo, NOTHING, None)
    assert np.abs(found.albedo * found.shading[..., None] - decode(photo)).max() < 1e-5
    dull = gloss < 0.002
    assert found.shading[dull] == pytest.approx(shading[dull], rel=0.05)
    assert found.albedo[dull] == pytest.approx(albedo[dull], abs=0.03)
    assert (
        np.abs(luminance(found.albedo) / luminance(albedo) - 1).max() < 0.1
    )  # a highlight is light, not paint


def test_marigolds_appearance_is_in_srgb(tmp_path):
    albedo, shading, _ = lit_scene()
    photo = encode_u8(albedo * shading[..., None])
    path = tiny_maps.marigold("intrinsic", target_properties=tiny_maps.APPEARANCE)(
        tmp_path / "appearance"
    )
    run = registry.make("intrinsic", "marigold", Setup(str(path), "cpu"))
    says(run._model, 2 * encode(albedo) - 1, np.zeros((H, W, 3)))
    found = run(photo, NOTHING, None)
    assert found.albedo == pytest.approx(albedo, abs=0.02)
    assert found.shading == pytest.approx(shading, rel=0.05)
    taken_for_light = encode(albedo)  # what it would be without decoding
    assert np.abs(found.albedo - taken_for_light).mean() > 0.15
