"""Shade and mirror light at a foot are removed; paint and other surfaces are not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from physgen.geometry.fitting import fit_outlines
from physgen.geometry.scale import photo_object
from physgen.perceive.shadow.foot_shade import find_foot_shade
from physgen.photometry import decode, encode_u8

SIZE = (320, 260)
"""Width and height of the drawings, px."""
FOOT = 150
"""Row below the lowest one of the object."""
BELOW = np.s_[FOOT + 2 : FOOT + 8, 120:200]

Depth = Callable[[np.ndarray, np.ndarray], np.ndarray]


def drawing(depth: Depth) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a box on a fine-grained ground in slowly varying light, its labels, and
    the linear light of the bare ground.
    """
    width, height = SIZE
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    grain = np.random.default_rng(5).normal(0, 0.02, (height, width))
    light = 0.3 * np.exp(0.3 * columns / width - 0.2 * rows / height + grain)
    bare = light[..., None] * np.array([1.0, 0.7, 0.6])
    labels = np.zeros((height, width), np.uint16)
    labels[60:FOOT, 110:210] = 1
    ground = bare * np.exp(-depth(rows, columns))
    visible = np.where(labels[..., None] > 0, 0.2, ground)
    return encode_u8(visible.astype(np.float32)), labels, bare


def found(rgb: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    item = photo_object(1, fit_outlines(labels, [1])[1], "", SIZE)
    coverage = (labels > 0).astype(np.float32)
    return find_foot_shade(rgb, coverage, labels, [item])


def at_foot(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return a contact shadow that ends within 15 px."""
    beside = np.exp(-(((columns - 160) / 55) ** 4))
    depth = 0.8 * np.exp(-(((rows - FOOT) / 9) ** 2)) * beside
    return np.asarray(depth[..., None].repeat(3, axis=2))


def glow(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return a mirror image that takes blue light and leaves the rest."""
    depth = at_foot(rows, columns)
    depth[..., :2] *= 0.1
    return np.asarray(depth)


def nothing(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    return np.zeros((*rows.shape, 3))


def tray(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return a nearly black surface in place of a contact shadow."""
    beside = np.exp(-(((columns - 160) / 52) ** 16))
    depth = 5 * np.exp(-(((rows - FOOT) / 22) ** 8)) * beside * (rows >= FOOT)
    return np.asarray(depth[..., None].repeat(3, axis=2))


def carpet(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return a darker surface from the foot to the photo's lower side."""
    return np.asarray((0.8 * (rows >= FOOT))[..., None].repeat(3, axis=2))


def board(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return the dark edge of a board below the object, across the photo."""
    is_edge = (rows >= FOOT) & (rows < FOOT + 8)
    return np.asarray((0.8 * is_edge)[..., None].repeat(3, axis=2))


def mat(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return a dark mat with sharp edges under the object, as wide as the object."""
    is_mat = (rows >= FOOT) & (rows < FOOT + 15) & (columns >= 110) & (columns < 210)
    return np.asarray((0.8 * is_mat)[..., None].repeat(3, axis=2))


def coaster(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return a flat ellipse below the object, with the blur of a lens at its edge."""
    radius = np.hypot((rows - FOOT + 5) / 25, (columns - 160) / 70)
    share = np.clip(0.5 + 12 * (1 - radius), 0, 1)
    return np.asarray((0.6 * share)[..., None].repeat(3, axis=2))


def distant(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return a painted spot that does not touch the object."""
    spot = (np.hypot(rows - FOOT - 30, columns - 160) < 8) * 0.8
    return np.asarray(spot[..., None].repeat(3, axis=2))


@pytest.mark.parametrize(("depth", "channel"), [(at_foot, 1), (glow, 2)])
def test_light_at_feet_is_removed(depth: Depth, channel: int) -> None:
    rgb, labels, bare = drawing(depth)
    shade = found(rgb, labels)
    assert shade is not None
    clean, owners = shade
    values = decode(rgb), decode(clean), bare
    before, after, truth = (part[(*BELOW, channel)].mean() for part in values)
    assert np.log(before / truth) < -0.4
    assert abs(np.log(after / truth)) < 0.1
    assert (owners[BELOW] == 1).mean() > 0.9
    # Nothing changes far away and above the foot.
    assert (clean[:110] == rgb[:110]).all()
    assert (clean[FOOT + 60 :] == rgb[FOOT + 60 :]).all()


@pytest.mark.parametrize("depth", [nothing, carpet, board, mat, coaster, distant])
def test_other_surfaces_stay(depth: Depth) -> None:
    rgb, labels, _ = drawing(depth)
    assert found(rgb, labels) is None


def test_mirrored_photos_have_mirrored_shade() -> None:
    rgb, labels, _ = drawing(at_foot)
    shade = found(rgb, labels)
    mirrored = found(rgb[:, ::-1].copy(), labels[:, ::-1].copy())
    assert shade is not None
    assert mirrored is not None
    difference = shade[0].astype(int) - mirrored[0][:, ::-1]
    assert np.abs(difference).mean() < 0.2


@pytest.mark.parametrize("gap", [12, 30])
def test_order_of_objects_does_not_matter(gap: int) -> None:
    labels = np.zeros((SIZE[1], SIZE[0]), np.uint16)
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]].astype(np.float32)
    light = np.full(labels.shape, 0.3)
    for number, left in enumerate((155 - gap - 90, 155)):
        labels[70:FOOT, left : left + 90] = number + 1
        beside = np.exp(-(((columns - left - 45) / 60) ** 4))
        reach = 9 + 3 * number
        light *= np.exp(-0.7 * np.exp(-(((rows - FOOT) / reach) ** 2)) * beside)
    light = np.where(labels > 0, 0.15, light)
    rgb = encode_u8(np.repeat(light[..., None], 3, axis=2).astype(np.float32))
    coverage = (labels > 0).astype(np.float32)
    outlines = fit_outlines(labels, [1, 2])
    items = [photo_object(number, outlines[number], "", SIZE) for number in (1, 2)]
    result = find_foot_shade(rgb, coverage, labels, items)
    swapped = find_foot_shade(rgb, coverage, labels, items[::-1])
    assert result is not None
    assert swapped is not None
    assert set(np.unique(result[1])) == {0, 1, 2}
    assert np.array_equal(result[0], swapped[0])
    assert np.array_equal(result[1], swapped[1])


def test_black_surface_at_a_foot_is_no_shade() -> None:
    rgb, labels, _ = drawing(tray)
    assert found(rgb, labels) is None
    rgb, labels, _ = drawing(at_foot)
    assert found(rgb, labels) is not None
