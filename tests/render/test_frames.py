"""Frames against what light does: the photo at t = 0, exact background elsewhere, sub-pixel motion, linear blending."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from pytest import approx

from physgen.photometry import decode, encode_u8
from physgen.render.frames import render_frames
from physgen.render.sprites import anchor_sprites, cut_sprites
from physgen.render.stage import Mirror, Stage
from physgen.simulate.trajectory import Contacts, Effort, Energy, Trajectory

H, W = 120, 160


def trajectory(*tracks):
    """One track a body: a list of (x, y, angle)."""
    poses = np.array(tracks, float).transpose(1, 0, 2)
    T, N, _ = poses.shape
    none = Contacts(
        (),
        np.zeros((0, 2), np.int32),
        np.zeros((0, 2)),
        np.zeros((0, 3), np.int32),
        np.zeros((0, 2)),
    )
    zero = np.zeros(T)
    return Trajectory(
        np.arange(T) / 30,
        tuple(f"b{k}" for k in range(N)),
        poses,
        np.zeros_like(poses),
        np.zeros((T, 0, 2)),
        np.zeros((T, 0, 4)),
        none,
        Energy(zero, zero, zero, zero),
        Effort(T, 0, 0, 0, 0, 0.0),
    )


def disc(x, y, r):
    yy, xx = np.mgrid[:H, :W]
    return np.hypot(xx - x, yy - y) <= r


@pytest.fixture
def photo():
    """Two touching textured discs on a ramp, anti-aliased and noisy as photos are."""
    rng = np.random.default_rng(5)
    ramp = np.linspace(60, 140, W)[None, :, None] * np.array(
        [0.6, 0.9, 0.7]
    ) + np.zeros((H, 1, 1))
    labels = np.zeros((H, W), np.uint16)
    labels[disc(50, 60, 20)] = 1
    labels[disc(90, 60, 20)] = 2
    texture = rng.uniform(0.5, 1.5, (H, W, 1))
    picture = ramp.copy()
    for k, colour in ((1, (200, 60, 50)), (2, (230, 220, 200))):
        soft = cv2.GaussianBlur((labels == k).astype(np.float32), (0, 0), 0.8)[
            ..., None
        ]
        picture = (
            picture * (1 - soft)
            + soft * np.array(colour) * cv2.GaussianBlur(texture, (0, 0), 1)[..., None]
        )
    picture += rng.normal(0, 2, picture.shape)
    coverage = cv2.GaussianBlur((labels > 0).astype(np.float32), (0, 0), 0.8)
    coverage[coverage < 0.01] = 0
    coverage[coverage > 0.99] = 1
    rgb = np.clip(picture, 0, 255).astype(np.uint8)
    background = np.where(coverage[..., None] > 0, np.clip(ramp, 0, 255), rgb).astype(
        np.uint8
    )
    return rgb, labels, coverage, background


def cut_out(rgb, labels, absent, coverage, background, order):
    sprites = cut_sprites(
        rgb, labels, absent, coverage, background, dict.fromkeys(order, 0)
    )
    return anchor_sprites(sprites, decode(rgb), decode(background), absent)


def staged(photo, order=(0, 1), absent=None):
    rgb, labels, coverage, background = photo
    absent = np.zeros(labels.shape, bool) if absent is None else absent
    return Stage(background, cut_out(rgb, labels, absent, coverage, background, order))


def test_at_rest_every_frame_is_the_photo(photo) -> None:
    still = trajectory([(50, 60, 0)] * 3, [(90, 60, 0)] * 3)
    for order in ((0, 1), (1, 0)):
        for frame in render_frames(staged(photo, order), still):
            assert np.array_equal(frame.rgb, photo[0])
            assert set(np.unique(frame.ids)) == {0, 1, 2}


def test_an_object_left_out_vanishes_without_a_rim(photo) -> None:
    rgb, labels, coverage, background = photo
    kept = np.where(labels == 1, labels, 0).astype(np.uint16)
    sprites = cut_out(rgb, kept, labels == 2, coverage, background, (0,))
    [frame] = render_frames(Stage(background, sprites), trajectory([(50, 60, 0)]))
    right = np.s_[:, 75:]
    assert np.array_equal(frame.rgb[right], background[right])
    assert np.array_equal(frame.rgb[:, :66], rgb[:, :66])


@pytest.mark.parametrize("shift", [0.1, 0.25, 0.5, 0.77])
def test_motion_by_a_fraction_of_a_pixel(shift: float) -> None:
    labels = disc(60, 60, 15).astype(np.uint16)
    soft = cv2.GaussianBlur(labels.astype(np.float32), (0, 0), 0.8)
    soft[soft < 0.01] = 0
    background = np.full((H, W, 3), 20, np.uint8)
    rgb = encode_u8(decode(background) * (1 - soft[..., None]) + soft[..., None] * 0.8)
    stage = Stage(
        background,
        cut_out(rgb, labels, np.zeros(labels.shape, bool), soft, background, (0,)),
    )
    first, second = render_frames(
        stage, trajectory([(60, 60, 0), (60 + shift, 60 - shift / 2, 0)])
    )

    def centroid(frame):
        light = decode(frame.rgb)[..., 0] - decode(background)[..., 0]
        yy, xx = np.mgrid[:H, :W]
        return np.array([(light * xx).sum(), (light * yy).sum()]) / light.sum()

    assert centroid(second) - centroid(first) == approx([shift, -shift / 2], abs=0.02)


def test_positive_angles_turn_x_towards_y() -> None:
    labels = np.zeros((H, W), np.uint16)
    labels[58:63, 60:90] = 1  # a bar that points to +x from its centre
    background = np.zeros((H, W, 3), np.uint8)
    rgb = np.where(labels[..., None] > 0, 255, background).astype(np.uint8)
    stage = Stage(
        background,
        cut_out(
            rgb, labels, labels > 1, (labels > 0).astype(np.float32), background, (0,)
        ),
    )
    *_, turned = render_frames(stage, trajectory([(60, 60, 0), (60, 60, np.pi / 2)]))
    rows, columns = np.nonzero(turned.ids)
    assert rows.min() >= 59
    assert rows.max() >= 88
    assert (columns.min(), columns.max()) == (58, 62)


def test_a_floor_mirrors_what_has_moved() -> None:
    labels = np.zeros((H, W), np.uint16)
    labels[50:60, 40:60] = 1
    background = np.zeros((H, W, 3), np.uint8)
    rgb = np.where(labels[..., None] > 0, 255, background).astype(np.uint8)
    cut = cut_out(
        rgb, labels, labels > 1, (labels > 0).astype(np.float32), background, (0,)
    )
    stage = Stage(
        background, cut, mirror=Mirror(np.full(6, 0.25, np.float32), [(59, 0, 1000)])
    )
    first, last = render_frames(stage, trajectory([(50, 55, 0), (80, 55, 0)]))
    assert np.array_equal(first.rgb, rgb)
    assert decode(last.rgb)[61:64, 75:85] == approx(0.25, abs=0.02)
    assert not last.rgb[66:].any()
    assert not last.rgb[60:, :60].any()


def test_blending_happens_in_linear_light() -> None:
    labels = np.zeros((H, W), np.uint16)
    labels[40:80, 40:80] = 1
    background = np.zeros((H, W, 3), np.uint8)
    rgb = np.where(labels[..., None] > 0, 255, background).astype(np.uint8)
    stage = Stage(
        background,
        cut_out(
            rgb, labels, labels > 1, (labels > 0).astype(np.float32), background, (0,)
        ),
    )
    *_, frame = render_frames(stage, trajectory([(60, 60, 0), (60.5, 60, 0)]))
    assert (
        abs(int(frame.rgb[60, 40, 0]) - 188) <= 1
    )  # half the light is 188 in sRGB, not 128


def test_a_mirrored_scene_gives_mirrored_frames(photo) -> None:
    rgb, labels, coverage, background = photo
    path = [(50 + 2.25 * k, 60 + 1.5 * k, 0.1 * k) for k in range(4)]
    mirrored = tuple(
        np.ascontiguousarray(a[:, ::-1]) for a in (rgb, labels, coverage, background)
    )
    plain = render_frames(staged(photo), trajectory(path, [(90, 60, 0)] * 4))
    other = render_frames(
        staged(mirrored),
        trajectory([(W - 1 - x, y, -a) for x, y, a in path], [(W - 1 - 90, 60, 0)] * 4),
    )
    for a, b in zip(plain, other, strict=True):
        difference = np.abs(a.rgb.astype(int) - b.rgb[:, ::-1])
        assert difference.mean() < 0.1


def test_frames_of_bodies_at_rest_are_equal_in_any_order(photo) -> None:
    """The engine moves them by less than anybody can see."""
    scene = staged(photo)
    still = (90, 60, 0)
    places = [50, 47, 45, 45.0004, 44.9996, 45]
    motion = trajectory([(x, 60, 0) for x in places], [still] * len(places))
    first_frames = [frame.rgb for frame in render_frames(scene, motion)]
    assert (first_frames[1] != first_frames[2]).any()
    for frame in first_frames[3:]:
        assert (frame == first_frames[2]).all()
    backwards = range(len(places))[::-1]
    last_frames = [frame.rgb for frame in render_frames(scene, motion, backwards)]
    for frame, other in zip(first_frames, last_frames[::-1], strict=True):
        assert (frame == other).all()
