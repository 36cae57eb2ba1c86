"""What another object hid in the photo is there when that one moves away, beside the truth of a drawn scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.geometry.polygon import Disc, Outline, Region, Ring
from physgen.maps import Percepts, write_assets
from physgen.photometry import decode, encode_u8
from physgen.render.sprites import Sprite, cut_sprites
from physgen.simulate.engine import simulate

SCENE = """\
physgen: 1
image: photo.png
assets: photo.assets
world: {{view: top, duration: 1, table: {{friction: 0}}}}
objects:
  {back}: {{mask: 1, shape: {shape}}}
  {front}: {{mask: 2, shape: {{box: {{center: [{x}, 60], size: [40, 90]}}}}, layer: {layer}}}
"""
BACK = {
    "ball": "{circle: {center: [80, 60], radius: 30}}",
    "plank": "{box: {center: [80, 60], size: [110, 24]}}",
    "face": "{box: {center: [80, 60], size: [110, 24]}}",  # with a face that the lens sees above the shape
}


def pictures(kind: str, x: float) -> tuple[np.ndarray, ...]:
    """Linear light of a ground, the object behind alone on it, both objects; the masks' labels."""
    yy, xx = np.mgrid[:120, :160].astype(np.float32)
    ground = np.full((120, 160, 3), 0.4, np.float32)
    if kind == "ball":
        where = np.hypot(xx - 80, yy - 60) <= 30
        paint = (0.1 + 0.15 * np.clip(1 - np.hypot(xx - 70, yy - 50) / 45, 0, 1))[
            ..., None
        ] * np.float32([3, 1, 1])
    else:
        where = (
            (np.abs(xx - 80) <= 55)
            & (yy <= 72)
            & (yy >= (48 if kind == "plank" else 36))
        )
        paint = (0.2 + 0.05 * np.sin(yy) + 0.001 * xx)[..., None] * np.float32(
            [1.2, 1, 0.6]
        )
    alone = np.where(where[..., None], paint, ground)
    front = (np.abs(xx - x) <= 20) & (np.abs(yy - 60) <= 45)
    both = np.where(front[..., None], np.float32([0.05, 0.1, 0.5]), alone)
    labels = np.where(front, 2, np.where(where, 1, 0)).astype(np.uint16)
    return ground, alone, both, labels


def frames(
    kind: str, names: str, layer: int, shift: float, folder: Path
) -> tuple[np.ndarray, ...]:
    """The photo; sRGB of the clip's first frame, and of one whose object in front is `shift` px farther right.

    Within a layer objects are drawn in the order of their `names`: of the one behind, of the one in front.
    """
    x = 104 if kind == "ball" else 80
    ground, _, both, labels = pictures(kind, x)
    photo = encode_u8(both)
    cv2.imwrite(str(folder / "photo.png"), photo[..., ::-1])
    write_assets(
        Percepts(
            rgb=photo, labels=labels, coverage=(labels > 0).astype(np.float32), background=encode_u8(ground),
            clean=None, depth=None, normals=None, albedo=None, shading=None,
        ),
        folder / "photo.assets",
    )  # fmt: skip
    path = folder / "scene.yaml"
    back, front = names
    path.write_text(
        SCENE.format(back=back, front=front, shape=BACK[kind], x=x, layer=layer)
    )
    return photo, *drawn(path, front=front, shift=shift)


def drawn(
    path: Path, *edits: str, front: str = "", shift: float = 0
) -> list[np.ndarray]:
    """sRGB of a scene's first frame, and of one whose object in front is `shift` px farther right."""
    scene = pipeline.load(path, edits)
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    track = simulate(compiled.world, np.array([0.0, 0.9]))
    still = np.repeat(track.poses[:1], 2, axis=0)
    still[1, [item.name == front for item in scene.objects], 0] += shift
    return [
        f.rgb
        for f in pipeline.render(
            pipeline.stage(scene, compiled, maps), replace(track, poses=still)
        )
    ]


@pytest.mark.parametrize("kind", BACK)
@pytest.mark.parametrize("names", ["ab", "ba"])
def test_a_hidden_part_is_there_when_the_other_leaves_or_is_left_out(
    kind: str, names: str, tmp_path: Path
) -> None:
    ground, alone, _, labels = pictures(kind, 104 if kind == "ball" else 80)
    photo, first, last = frames(kind, names, 0, 1000, tmp_path)
    assert np.array_equal(first, photo)
    hidden = (labels == 2) & (np.abs(alone - ground).max(axis=2) > 0)
    inner = cv2.erode(hidden.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    without, _ = drawn(tmp_path / "scene.yaml", f"objects.{names[1]}=null")
    for seen in (last, without):
        assert (
            np.abs(decode(seen) - alone)[inner].mean()
            < 0.3 * np.abs(ground - alone)[inner].mean()
        )
    # and no seam is left along the border of what hid it
    line = (
        cv2.morphologyEx(
            (labels == 2).astype(np.uint8),
            cv2.MORPH_GRADIENT,
            np.ones((5, 5), np.uint8),
        )
        > 0
    )
    whole = (
        cv2.erode(
            (np.abs(alone - ground).max(axis=2) > 0).astype(np.uint8),
            np.ones((5, 5), np.uint8),
        )
        > 0
    )
    assert np.percentile(np.abs(decode(last) - alone)[line & whole], 99) < 0.05


def test_a_shape_smaller_than_a_pixel(tmp_path: Path) -> None:
    photo, *_ = frames("ball", "ab", 0, 0, tmp_path)
    tiny = "objects.a.shape={circle: {center: [80, 60], radius: 0.3}}"
    assert np.array_equal(drawn(tmp_path / "scene.yaml", tiny)[0], photo)


@pytest.mark.parametrize("layer", [-1, 0, 1])
def test_a_layer_decides_what_is_in_front(layer: int, tmp_path: Path) -> None:
    """Shifted by 24 px, the box covers what the photo shows of the plank, or goes behind it."""
    photo, first, last = frames("plank", "ab", layer, 24, tmp_path)
    assert np.array_equal(first, photo)
    shown = np.s_[
        52:69, 108:120
    ]  # the plank's alone in the photo, the box's place after the shift
    other = np.s_[75:95, 108:120]  # the box alone
    seen = (
        "plank" if np.abs(last[shown].astype(int) - photo[shown]).max() <= 2 else "box"
    )
    assert seen == ("plank" if layer < 0 else "box")
    assert np.abs(last[other].astype(int) - photo[60, 80]).max() <= 2


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_of_two_that_hide_parts_of_each_other_the_larger_is_completed(
    order: tuple[int, int],
) -> None:
    """A plank goes under the broad left leg of a gate and over its narrow right one."""
    yy, xx = np.mgrid[:120, :160]
    plank = (np.abs(xx - 80) <= 70) & (np.abs(yy - 70) <= 12)
    left, right = (
        (xx >= 30) & (xx <= 54) & (yy >= 20) & (yy <= 105),
        (xx >= 106) & (xx <= 115) & (yy >= 20) & (yy <= 105),
    )
    gate = left | right | ((xx >= 30) & (xx <= 115) & (yy >= 20) & (yy <= 40))
    labels = np.where(left, 2, np.where(plank, 1, np.where(gate, 2, 0))).astype(
        np.uint16
    )
    colours = np.array([[90, 90, 90], [200, 160, 60], [40, 60, 190]], np.uint8)
    corners = [
        (30, 20),
        (115, 20),
        (115, 105),
        (106, 105),
        (106, 40),
        (54, 40),
        (54, 105),
        (30, 105),
    ]
    shapes = [
        Region((Ring(np.array(points, float), ()),))
        for points in (
            [(9.5, 57.5), (150.5, 57.5), (150.5, 82.5), (9.5, 82.5)],
            corners,
        )
    ]
    found = cut_sprites(
        colours[labels], labels, np.zeros(labels.shape, bool), (labels > 0).astype(np.float32),
        np.broadcast_to(colours[0], (120, 160, 3)).copy(), dict.fromkeys(order, 0), shapes,
    )  # fmt: skip
    assert [sprite.body for sprite in found] == [0, 1]
    for sprite, truth in zip(found, (plank, gate & ~(plank & right)), strict=True):
        (x, y), (h, w) = sprite.corner, sprite.coverage.shape
        whole = np.zeros((120 + 2 * h, 160 + 2 * w))
        whole[h + y : 2 * h + y, w + x : 2 * w + x] = sprite.coverage
        off = (whole[h : h + 120, w : w + 160] > 0.5) != truth
        assert cv2.erode(off.astype(np.uint8), np.ones((3, 3), np.uint8)).sum() == 0


def test_a_crack_between_two_masks_belongs_to_the_one_behind() -> None:
    """Masks of a network leave single pixels between neighbours to no object."""
    ground, _, both, labels = pictures("ball", 104)
    edge = 104 - 20
    labels[55:58, edge] = 0
    back = cut_back(labels, both, ground, radius=30.0)
    crack = back.coverage[
        55 - back.corner[1] : 58 - back.corner[1], edge - back.corner[0]
    ]
    assert crack.min() > 0.95


def test_a_fruit_continues_from_its_visible_outline_without_a_step() -> None:
    """Its disc is smaller than its mask: a fruit is no exact ball."""
    ground, _, both, labels = pictures("ball", 104)
    back = cut_back(labels, both, ground, radius=28.0)
    row = back.coverage[:, 86 - back.corner[0]]
    hidden_rows = np.flatnonzero(row > 0.5) + back.corner[1]
    # The circle of radius 30 is at rows 31 and 89 there, that of radius 28 at 33 and 87.
    assert hidden_rows[0] <= 32
    assert hidden_rows[-1] >= 88


def test_a_crack_is_no_part_of_the_ball_in_front() -> None:
    ground, alone, _, _ = pictures("ball", 104)
    rows, columns = np.mgrid[:120, :160]
    front = np.hypot(columns - 104, rows - 60) <= 20
    both = np.where(front[..., None], np.float32([0.05, 0.1, 0.5]), alone)
    back = np.hypot(columns - 80, rows - 60) <= 30
    labels = np.where(front, 2, np.where(back, 1, 0)).astype(np.uint16)
    labels[58:63, 84] = 0
    shapes = [Disc(np.float64([80, 60]), 30.0), Disc(np.float64([104, 60]), 21.0)]
    sprites = cut_all(labels, both, ground, shapes)
    cracks = []
    for sprite in sprites:
        x, y = sprite.corner
        cracks.append(sprite.coverage[58 - y : 63 - y, 84 - x])
    assert cracks[0].min() > 0.95
    assert cracks[1].max() < 0.8


def cut_back(
    labels: np.ndarray, light: np.ndarray, ground: np.ndarray, radius: float
) -> Sprite:
    """Return the sprite of a ball of a `radius`, px, behind a box."""
    box = Region((Ring(np.float64([[84, 15], [124, 15], [124, 105], [84, 105]])),))
    shapes: list[Outline] = [Disc(np.float64([80, 60]), radius), box]
    return cut_all(labels, light, ground, shapes)[0]


def cut_all(
    labels: np.ndarray, light: np.ndarray, ground: np.ndarray, shapes: list[Outline]
) -> list[Sprite]:
    """Return the sprites of two objects, the farther one first."""
    coverage = (light.mean(axis=2) != ground.mean(axis=2)).astype(np.float32)
    absent = np.zeros(labels.shape, np.bool_)
    order = {0: 0, 1: 1}
    photo, background = encode_u8(light), encode_u8(ground)
    return cut_sprites(photo, labels, absent, coverage, background, order, shapes)
