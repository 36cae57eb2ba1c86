"""Light on the floor moves with its object; light elsewhere stays."""

from __future__ import annotations

import numpy as np
import pytest

from physgen.geometry.polygon import Pose
from physgen.geometry.shadows import Silhouette
from physgen.photometry import decode, encode_u8
from physgen.render.foot_halos import FootHalo
from physgen.render.frames import render_frames
from physgen.render.halo_split import split_halos
from physgen.render.sprites import MARGIN, Sprite, anchor_sprites, cut_sprites
from physgen.render.stage import Stage
from physgen.simulate.trajectory import Contacts, Effort, Energy, Trajectory

SIZE = (200, 160)
"""Width and height of the canvas, px."""
FOOT = 100
"""Row below the lowest one of the object."""
GROUND = np.full((SIZE[1], SIZE[0], 3), 0.5, np.float32)
START = Pose(90.0, 80.0, 0.0)


def standing(
    light: float, *, is_mirror: bool = False, floor: float = FOOT - 0.5
) -> tuple[Sprite, Sprite]:
    """Return a block with a strip of `light` below its foot and one of 0.3 above its
    top, before and after its halo is split.
    """
    coverage = np.zeros((60 + 2 * MARGIN, 40 + 2 * MARGIN), np.float32)
    coverage[MARGIN:-MARGIN, MARGIN:-MARGIN] = 1
    corner = (70 - MARGIN, 40 - MARGIN)
    halo = np.zeros((SIZE[1], SIZE[0], 3), np.float32)
    halo[FOOT : FOOT + 12, 70:110] = light
    halo[32:40, 70:110] = 0.3
    near = np.zeros(halo.shape[:2], np.int32)
    picture = 0.5 * coverage[..., None].repeat(3, axis=2)
    sprite = Sprite(0, corner, picture, coverage, halo=((0, 0), halo, near))
    start = Silhouette(
        coverage, corner, (90.0, 70.0), None, 40.0, floor, ends=(0.0, 150.0)
    )
    split = split_halos([sprite], [start], 0.1, GROUND, is_mirror=is_mirror)
    return sprite, split[0]


def split_shade(
    coverage: np.ndarray, corner: tuple[int, int], halo: np.ndarray
) -> np.ndarray:
    """Return the shade of the foot halo of a dark object on plain ground, (H, W, 3)."""
    near = np.zeros(halo.shape[:2], np.int32)
    picture = 0.1 * coverage[..., None].repeat(3, axis=2)
    sprite = Sprite(0, corner, picture, coverage, halo=((0, 0), halo, near))
    height, width = coverage.shape
    center = (corner[0] + width / 2, corner[1] + height / 2)
    start = Silhouette(
        coverage, corner, center, None, 40.0, FOOT - 0.5, ends=(0.0, 200.0)
    )
    split = split_halos([sprite], [start], 0.1, GROUND, is_mirror=False)
    shade, _ = on_photo(foot_halo_of(split[0]))
    return shade


def foot_halo_of(sprite: Sprite) -> FootHalo:
    assert sprite.foot_halo is not None
    return sprite.foot_halo


def on_photo(foot_halo: FootHalo) -> tuple[np.ndarray, np.ndarray]:
    """Return shade and light of a foot halo on a canvas of the photo's size."""
    x, y = foot_halo.corner
    height, width = foot_halo.shade.shape[:2]
    pictures = []
    for part in (foot_halo.shade, foot_halo.light):
        canvas = np.zeros_like(GROUND)
        canvas[y : y + height, x : x + width] = part
        pictures.append(canvas)
    return pictures[0], pictures[1]


@pytest.mark.parametrize("is_mirror", [True, False])
def test_both_parts_are_the_whole_halo(is_mirror: bool) -> None:
    whole, sprite = standing(-0.2, is_mirror=is_mirror)
    assert whole.halo is not None
    assert sprite.halo is not None
    foot_halo = foot_halo_of(sprite)
    shade, light = on_photo(foot_halo)
    total = GROUND * np.exp(-shade) + light + sprite.halo[1]
    is_visible = np.ones(total.shape[:2], np.bool_)
    is_visible[40:FOOT, 70:110] = False
    assert total[is_visible] == pytest.approx(
        (GROUND + whole.halo[1])[is_visible], abs=1e-6
    )
    # What is above the object stays.
    assert not light[:60].any()
    assert not shade[:60].any()


def test_a_mirror_image_continues_below_a_base() -> None:
    """A base that is lifted would else uncover a strip of bright ground."""
    light = on_photo(foot_halo_of(standing(-0.2, is_mirror=True)[1]))[1]
    strip = light[FOOT - 6 : FOOT, 85:95]
    assert -0.2 <= strip.min() <= strip.max() < -0.12
    steps = np.diff(light[FOOT - 6 : FOOT + 2, 90, 0])
    assert np.abs(steps).max() < 0.03


def test_a_continued_mirror_image_keeps_soft_borders_as_in_the_photo() -> None:
    coverage = np.zeros((60 + 2 * MARGIN, 40 + 2 * MARGIN), np.float32)
    coverage[MARGIN:-MARGIN, MARGIN:-MARGIN] = 1
    coverage[-MARGIN - 1, MARGIN:-MARGIN] = 0.4
    corner = (70 - MARGIN, 40 - MARGIN)
    halo = np.zeros((SIZE[1], SIZE[0], 3), np.float32)
    halo[FOOT : FOOT + 12, 70:110] = -0.2
    near = np.zeros(halo.shape[:2], np.int32)
    picture = 0.5 * coverage[..., None].repeat(3, axis=2)
    rest = np.zeros_like(picture)
    sprite = Sprite(0, corner, picture, coverage, rest, halo=((0, 0), halo, near))
    start = Silhouette(
        coverage, corner, (90.0, 70.0), None, 40.0, FOOT - 0.5, ends=(0.0, 150.0)
    )
    split = split_halos([sprite], [start], 0.1, GROUND, is_mirror=True)[0]
    light = on_photo(foot_halo_of(split))[1][FOOT - 1, 85:95]
    assert light.max() < -0.1
    assert split.rest is not None
    columns = slice(85 - corner[0], 95 - corner[0])
    own_rest = split.rest[-MARGIN - 1, columns]
    assert 0.6 * light + own_rest == pytest.approx(np.zeros_like(light), abs=1e-6)


def drawn(foot_halo: FootHalo, pose: Pose) -> np.ndarray:
    """Return the change of the ground at a pose, (H, W, 3)."""
    moved = foot_halo.draw(START, pose, 0.0, SIZE)
    assert moved is not None
    place, factor, light = moved
    canvas = GROUND.copy()
    canvas[place] = canvas[place] * factor + light
    return np.asarray(canvas - GROUND)


def test_a_contact_shadow_moves_along_the_floor() -> None:
    foot_halo = foot_halo_of(standing(-0.2)[1])
    canvas = drawn(foot_halo, START._replace(x=115.0))
    columns = np.arange(SIZE[0])
    weight = -canvas[FOOT + 1 : FOOT + 4].sum(axis=(0, 2))
    assert weight @ columns / weight.sum() == pytest.approx(89.5 + 25, abs=0.3)
    # It is as dark as in the photo at the outline, and fades away from it.
    depths = canvas[FOOT : FOOT + 8, 105:125].mean(axis=(1, 2))
    assert -0.2 <= depths[0] < -0.16
    assert (np.diff(depths) > 0).all()


def test_shade_continues_below_the_soft_border_of_the_object() -> None:
    """Its halo is empty there: the ground would be a bright line."""
    coverage = np.zeros((62 + 2 * MARGIN, 40 + 2 * MARGIN), np.float32)
    coverage[MARGIN : MARGIN + 60, MARGIN:-MARGIN] = 1
    coverage[MARGIN + 60 : MARGIN + 62, MARGIN:-MARGIN] = 0.3
    corner = (70 - MARGIN, 40 - MARGIN)
    halo = np.zeros((SIZE[1], SIZE[0], 3), np.float32)
    halo[FOOT + 2 : FOOT + 14, 70:110] = -0.3
    shade = split_shade(coverage, corner, halo)
    rows = shade[FOOT : FOOT + 4, 80:100].mean(axis=(1, 2))
    assert rows[:2].min() > 0.7 * rows[2:].max()


def test_shade_below_an_overhang_has_no_upright_edge() -> None:
    """Below the head of a mushroom, the shade of the floor fades beside the head."""
    coverage = np.zeros((60 + 2 * MARGIN, 100 + 2 * MARGIN), np.float32)
    coverage[MARGIN : MARGIN + 30, MARGIN:-MARGIN] = 1
    coverage[MARGIN : MARGIN + 60, MARGIN + 40 : -MARGIN - 40] = 1
    corner = (50 - MARGIN, 40 - MARGIN)
    halo = np.zeros((SIZE[1], SIZE[0], 3), np.float32)
    halo[72:FOOT, 30:170] = -0.2
    halo[72:FOOT, 90:110] = 0
    shade = split_shade(coverage, corner, halo)
    row = shade[80, 30:60].mean(axis=1)
    assert row[-1] > 0.02
    assert np.abs(np.diff(row)).max() < 0.3 * row.max()


def test_it_vanishes_if_the_object_leaves_the_floor() -> None:
    foot_halo = foot_halo_of(standing(-0.2)[1])
    assert foot_halo.draw(START, START._replace(y=40.0), 0.0, SIZE) is None
    assert foot_halo.draw(START, START, 1.0, SIZE) is None


def test_it_ends_at_the_end_of_the_floor() -> None:
    foot_halo = foot_halo_of(standing(-0.2)[1])
    canvas = drawn(foot_halo, START._replace(x=140.0))
    assert not canvas[:, 151:].any()
    assert canvas[:, :151].min() < -0.1


def test_only_mirrors_carry_light_at_the_outline() -> None:
    strip = np.s_[FOOT : FOOT + 2, 80:100]
    mirror = foot_halo_of(standing(0.2, is_mirror=True)[1])
    assert on_photo(mirror)[1][strip].min() > 0.15
    carried = standing(0.2)[1].foot_halo
    assert carried is None or carried.light.max() < 0.05


def test_shade_across_the_edge_of_a_drawn_shadow_is_as_in_the_photo() -> None:
    # The drawn shadow has a hard lower edge; the photo's shade continues below it.
    coverage = np.zeros((60 + 2 * MARGIN, 40 + 2 * MARGIN), np.float32)
    coverage[MARGIN:-MARGIN, MARGIN:-MARGIN] = 1
    corner = (70 - MARGIN, 40 - MARGIN)
    behind = GROUND.copy()
    behind[: FOOT + 3] *= 0.1
    photo = GROUND.copy()
    photo[: FOOT + 3] *= 0.1
    photo[FOOT + 3 :] *= 0.4
    near = np.zeros(behind.shape[:2], np.int32)
    picture = 0.5 * coverage[..., None].repeat(3, axis=2)
    halo = ((0, 0), photo - behind, near)
    sprite = Sprite(0, corner, picture, coverage, halo=halo)
    start = Silhouette(
        coverage, corner, (90.0, 70.0), None, 40.0, FOOT - 0.5, ends=(0.0, 150.0)
    )
    split = split_halos([sprite], [start], 0.1, behind, is_mirror=False, plate=GROUND)
    shade, _ = on_photo(foot_halo_of(split[0]))
    left = np.exp(-shade[FOOT : FOOT + 3, 80:100])
    # Above the edge, the photo has no more shade than the drawn shadow.
    assert left.min() > 0.9


def test_objects_in_the_air_keep_their_halos() -> None:
    whole, sprite = standing(-0.2, floor=FOOT + 30.0)
    assert sprite is whole


BLOCKS = [slice(50, 90), slice(96, 136)]
"""Columns of two blocks whose shades overlap."""


def drawing(grain: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a photo of two blocks with light below both, its labels, and the
    background without that light.
    """
    rng = np.random.default_rng(3)
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    ground = 0.4 * np.exp(rng.normal(0, grain, (SIZE[1], SIZE[0], 1)))
    background = encode_u8(np.repeat(ground, 3, axis=2).astype(np.float32))
    labels = np.zeros((SIZE[1], SIZE[0]), np.uint16)
    depth = np.zeros(labels.shape)
    for number, block in enumerate(BLOCKS, 1):
        labels[60:FOOT, block] = number
        middle = (block.start + block.stop) / 2
        beside = np.exp(-(((columns - middle) / 32) ** 4))
        depth += 0.8 * np.exp(-(((rows - FOOT) / 10) ** 2)) * beside * (rows >= 80)
    visible = decode(background) * np.exp(-depth)[..., None] + 0.02 * (
        rows[..., None] < 60
    )
    visible = np.where(labels[..., None] > 0, 0.2, visible)
    photo = encode_u8(visible.astype(np.float32))
    return photo, labels, background


def two_blocks(
    order: tuple[int, int], grain: float, is_mirror: bool
) -> tuple[Stage, np.ndarray]:
    """Return a stage with two blocks, and the photo."""
    photo, labels, background = drawing(grain)
    coverage = (labels > 0).astype(np.float32)
    absent = np.zeros(labels.shape, np.bool_)
    sprites = cut_sprites(
        photo, labels, absent, coverage, background, dict.fromkeys(order, 0)
    )
    behind = decode(background)
    sprites = anchor_sprites(sprites, decode(photo), behind, absent, reach=1.0)
    starts = []
    for sprite in sprites:
        middle = (BLOCKS[sprite.body].start + BLOCKS[sprite.body].stop) / 2
        starts.append(
            Silhouette(
                sprite.coverage,
                sprite.corner,
                (middle, 80.0),
                None,
                40.0,
                FOOT - 0.5,
                ends=(60.0, 150.0),
            )
        )
    sprites = split_halos(sprites, starts, 0.1, behind, is_mirror=is_mirror)
    return Stage(background, sprites), photo


def resting() -> Trajectory:
    """Return two bodies at rest."""
    poses = np.array([[[69.5, 79.5, 0], [115.5, 79.5, 0]]])
    none = Contacts(
        (),
        np.zeros((0, 2), np.int32),
        np.zeros((0, 2)),
        np.zeros((0, 3), np.int32),
        np.zeros((0, 2)),
    )
    zero = np.zeros(1)
    return Trajectory(
        zero,
        ("a", "b"),
        poses,
        np.zeros_like(poses),
        np.zeros((1, 0, 2)),
        np.zeros((1, 0, 4)),
        none,
        Energy(zero, zero, zero, zero),
        Effort(1, 0, 0, 0, 0, 0.0),
    )


@pytest.mark.parametrize("is_mirror", [True, False])
@pytest.mark.parametrize("grain", [0.0, 0.02])
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_first_frame_is_the_photo(
    order: tuple[int, int], grain: float, is_mirror: bool
) -> None:
    stage, photo = two_blocks(order, grain, is_mirror)
    shades = [foot_halo_of(sprite) for sprite in stage.sprites]
    if not is_mirror:
        # Both shade the ground between the blocks.
        assert all(halo.shade.max() > 0.1 for halo in shades)
    [frame] = render_frames(stage, resting())
    assert np.array_equal(frame.rgb, photo)
