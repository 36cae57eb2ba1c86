"""Contact shadow in the hole of an object, and what looks like it."""

import numpy as np

from physgen.perceive.inpaint.contact_strips import contact_strips, shaded_islands
from physgen.perceive.inpaint.poisson import with_rim

Y, X = np.mgrid[:200, :300]


def ground() -> np.ndarray:
    """Return a light ground with a little grain."""
    grain = np.random.default_rng(1).normal(0, 3, (200, 300, 1))
    return np.clip(180 + grain, 0, 255).repeat(3, axis=2).astype(np.uint8)


def table() -> tuple[np.ndarray, np.ndarray]:
    """Return a photo of a body on two legs with its shade, and the mask of the body."""
    photo = ground()
    legs = (np.abs(X - 110) < 10) | (np.abs(X - 190) < 10)
    body = (X > 100) & (X < 200) & (Y > 60) & (Y < 140) & ((Y < 90) | legs)
    photo[(Y > 60) & (Y < 120) & (X > 100) & (X < 200)] = 120
    photo[(Y >= 120) & (Y < 142) & (X > 100) & (X < 200)] = 30
    photo[body] = (40, 120, 60)
    return photo, body


def test_dark_front_of_a_tray_is_no_contact_shadow():
    """It continues below and beside the searched ground, and shade ends there."""
    photo = ground()
    photo[(Y >= 140) & (Y < 165)] = 20
    pot = (np.abs(X - 150) < 50) & (Y > 60) & (Y < 140)
    photo[pot] = 60
    assert not contact_strips(photo, pot).any()
    photo[Y >= 144] = 180
    photo[(Y >= 140) & (np.abs(X - 150) > 52)] = 180
    assert contact_strips(photo, pot)[141, 110:190].all()


def test_shaded_ground_between_legs_belongs_to_the_hole():
    photo, body = table()
    hole = with_rim(photo, body)
    assert hole[90:140, 120:180].all()


def test_lit_ground_between_legs_stays():
    photo, body = table()
    photo[(Y >= 90) & (Y < 120) & (X > 120) & (X < 180)] = 200
    hole = with_rim(photo, body)
    assert not hole[100:110, 130:170].any()


def test_ground_without_strips_is_no_island():
    photo, body = table()
    assert not shaded_islands(photo, body, np.zeros_like(body)).any()
