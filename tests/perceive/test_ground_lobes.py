"""Pieces of the ground in the masks of objects."""

from __future__ import annotations

import cv2
import numpy as np

from physgen.perceive.ground_lobes import detach_ground

RED, DARK = (150, 50, 60), (40, 42, 44)


def pot_on_tray(lobe_colour):
    """Return a dark pot on a red tray, its mask with a lobe beside its foot, and the
    lobe.
    """
    random = np.random.default_rng(0)
    photo = np.full((300, 400, 3), 110, np.uint8)
    cv2.rectangle(photo, (40, 195), (360, 230), RED, -1)
    cv2.rectangle(photo, (130, 90), (230, 220), DARK, -1)
    labels = np.zeros((300, 400), np.uint16)
    cv2.rectangle(labels, (130, 90), (230, 220), 1, -1)
    lobe = np.zeros((300, 400), np.uint8)
    cv2.rectangle(lobe, (231, 198), (270, 220), 1, -1)
    photo[lobe > 0] = lobe_colour
    labels[lobe > 0] = 1
    noise = random.normal(0, 4, photo.shape)
    return np.clip(photo + noise, 0, 255).astype(np.uint8), labels, lobe > 0


def test_the_tray_beside_a_foot_leaves_the_mask() -> None:
    photo, labels, lobe = pot_on_tray(RED)
    detached = detach_ground(photo, labels)
    removed = (labels == 1) & (detached == 0)
    common = (removed & lobe).sum() / (removed | lobe).sum()
    assert common > 0.85


def test_a_foot_with_the_colour_of_its_object_stays() -> None:
    photo, labels, _ = pot_on_tray(DARK)
    assert np.array_equal(detach_ground(photo, labels), labels)
