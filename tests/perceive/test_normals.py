from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen import registry
from physgen.perceive.backends.normals_blended import (
    _shared_bulges,
    cushion_tilts,
    hidden_ball,
    turned_tilts,
)
from physgen.photometry import DistantLight
from physgen.scene.scene import View
from tests.perceive.lambertian import (
    apart,
    ball,
    boxed,
    can,
    plain,
    rendered,
    setting,
    towards,
)

LIGHT = DistantLight(towards(-0.6, -0.5, 0.6), 0.8, 0.2)


def seen(rgb, labels, things, view=View.SIDE):
    return registry.make("normals")(rgb, labels, things, setting(view))


def test_a_ball_is_a_sphere():
    normals, labels, thing = ball()
    rgb = rendered(normals, plain(labels=labels), LIGHT)
    off = apart(seen(rgb, labels, [thing]), normals)[labels > 0]
    assert off.max() < 3


def test_a_can_is_round_across_and_straight_upwards():
    normals, labels, thing = can()
    rgb = rendered(normals, plain(labels=labels), LIGHT)
    said = seen(rgb, labels, [thing])
    inner = cv2.erode((labels > 0).astype(np.uint8), np.ones((13, 13))) > 0
    assert apart(said, normals)[inner].mean() < 12
    assert np.abs(said[inner][:, 1]).max() < 0.15


def test_a_box_faces_the_viewer():
    labels, thing = boxed(80, 160, 90, 170)
    true = np.zeros((*labels.shape, 3), np.float32)
    true[..., 2] = 1
    rgb = rendered(true, plain(labels=labels), LIGHT)
    off = apart(seen(rgb, labels, [thing]), true)
    assert off[labels > 0].mean() < 6
    assert off[110:150, 100:140].max() < 1  # no noise on the face
    assert off[labels == 0].mean() < 1  # no table is seen


def test_an_ellipse_blows_up_to_an_ellipsoid():
    y, x = np.mgrid[:100, :140].astype(np.float32)
    u, v = (x - 69.5) / 60, (y - 49.5) / 40
    own = u * u + v * v <= 1
    field = cushion_tilts(own)
    depth = np.sqrt(2 / (1 / 60**2 + 1 / 40**2))
    z = np.sqrt(np.clip(1 - u * u - v * v, 0, 1))
    true = np.stack([u / 60, v / 40, z / depth], -1)
    true /= np.linalg.norm(true, axis=2, keepdims=True)
    said = np.dstack([field, np.sqrt(np.clip(1 - (field**2).sum(-1), 0, 1))])
    assert apart(said, true)[u * u + v * v < 0.9].mean() < 4


def test_a_cone_is_turned():
    own = np.zeros((120, 120), bool)
    for row in range(10, 110):
        half = 10 + 0.3 * (row - 10)
        own[row, int(60 - half) : int(60 + half)] = True
    field = turned_tilts(own)
    assert field[60, 60, 1] == pytest.approx(-0.3 / np.hypot(1, 0.3), abs=0.03)
    assert abs(field[60, 60, 0]) < 0.05


def test_what_a_bowl_hides_of_a_ball_is_a_ball():
    y, x = np.mgrid[:120, :120]
    part = (np.hypot(x - 60, y - 60) <= 40) & (y < 75)
    center, radius = hidden_ball(part)
    assert center == pytest.approx((60, 60), abs=1)
    assert radius == pytest.approx(40, abs=1)
    square = np.zeros((120, 120), bool)
    square[30:90, 30:90] = True
    assert hidden_ball(square) is None


def test_things_of_one_size_are_of_one_kind():
    masks = [np.ones(size, bool) for size in ((60, 20), (62, 20), (58, 21), (30, 30))]
    told = list(zip(masks, (0.0, 1.0, 0.1, 0.8), strict=True))
    assert _shared_bulges(told) == [0.1, 0.1, 0.1, 0.8]
