"""What is a sphere: by the light on it, or by its label."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen.geometry.polygon import Disc
from physgen.perceive.backends.label_shape import shape
from physgen.perceive.backends.physics_table import table
from physgen.perceive.photo_objects import outline_as_named
from physgen.perceive.roles import PhotoObject
from physgen.perceive.spheres import fit_sphere_shading, is_shaded_as_sphere
from physgen.photometry import encode_u8
from physgen.scene.scene import Solid

CENTER, RADIUS = np.array([80.0, 70.0]), 50.0


def shaded_ball(texture: float = 0.0) -> np.ndarray:
    """A sphere in light from the left above, with grain of a standard deviation."""
    y, x = np.mgrid[:140, :160]
    u, v = (x - CENTER[0]) / RADIUS, (y - CENTER[1]) / RADIUS
    z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
    light = 0.25 + 0.7 * np.maximum(-0.4 * u - 0.5 * v + 0.77 * z, 0)
    grain = np.random.default_rng(3).normal(0, 1, light.shape)
    light = light * np.exp(texture * grain)
    inside = (u * u + v * v <= 1)[..., None]
    colour = light[..., None] * np.array([0.7, 0.25, 0.1])
    return encode_u8(np.where(inside, colour, 0.5).astype(np.float32))


def van_front() -> np.ndarray:
    """A round outline with a window, a bumper and a dark grille."""
    photo = np.full((140, 160, 3), 200, np.uint8)
    cv2.circle(photo, (80, 70), 50, (190, 40, 40), -1)
    cv2.rectangle(photo, (50, 40), (110, 65), (30, 40, 50), -1)
    cv2.rectangle(photo, (40, 90), (120, 100), (240, 240, 240), -1)
    cv2.rectangle(photo, (55, 102), (105, 112), (15, 15, 15), -1)
    return photo


def mask_of_disc() -> np.ndarray:
    """Labels of the disc, dented: its outline is round, and not that of a drawing."""
    labels = np.zeros((140, 160), np.uint16)
    cv2.ellipse(labels, (80, 70), (50, 47), 0, 0, 360, 1, -1)
    return labels


@pytest.mark.parametrize("texture", [0.0, 0.1, 0.2])
def test_a_shaded_ball_is_a_sphere(texture: float):
    assert is_shaded_as_sphere(shaded_ball(texture), Disc(CENTER, RADIUS))


def test_a_van_in_a_round_outline_is_no_sphere():
    assert not is_shaded_as_sphere(van_front(), Disc(CENTER, RADIUS))


def test_light_of_a_sphere_is_explained():
    fit = fit_sphere_shading(shaded_ball(0.1), Disc(CENTER, RADIUS))
    assert fit is not None
    assert fit.residual == pytest.approx(0.1, abs=0.03)
    assert fit.shading > 0.2
    assert -0.95 < fit.rim < -0.1


@pytest.mark.parametrize(
    ("label", "solid"),
    [("apple", Solid.SPHERE), ("tennis ball", Solid.SPHERE), ("object", Solid.DISC)],
)
def test_a_label_makes_a_sphere_of_a_disc(label: str, solid: Solid):
    item = PhotoObject(1, Disc(CENTER, RADIUS), label)
    assert table()(van_front(), [item], None)[1].solid is solid


def test_shape_names_a_ball_by_its_light():
    labels = mask_of_disc()
    item = PhotoObject(1, Disc(CENTER, RADIUS))
    assert shape()(shaded_ball(), labels, [item])[1].label == "ball"
    assert shape()(van_front(), labels, [item])[1].label == "object"


def test_a_round_outline_without_reason_becomes_a_region():
    """A van does not roll; an apple, a plate and what is lit as a sphere may."""
    labels = mask_of_disc()
    van = PhotoObject(1, Disc(CENTER, RADIUS), "object")
    plate = PhotoObject(1, Disc(CENTER, RADIUS), "plate")
    assert not isinstance(outline_as_named(van_front(), labels, [van])[0].outline, Disc)
    assert isinstance(outline_as_named(van_front(), labels, [plate])[0].outline, Disc)
    assert isinstance(outline_as_named(shaded_ball(), labels, [van])[0].outline, Disc)
