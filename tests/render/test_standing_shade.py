"""Shade below a box that tilts about one corner on a lit floor."""

from __future__ import annotations

from dataclasses import replace
from math import cos, hypot, sin, tan
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from physgen.geometry.polygon import Pose
from physgen.geometry.shadows import PixelBox, ShadowSetting, Silhouette
from physgen.photometry import DistantLight, encode_u8
from physgen.render.contact_shades import add_contact_shades
from physgen.render.shadow_decomposition import LitBackground, decompose_shadows
from physgen.render.sprites import Sprite
from physgen.render.stage import SpritePose, Stage
from physgen.render.standing_shade import (
    STANDING,
    BaseMotion,
    StandingShade,
    base_points,
    measure_base_motion,
    split_contact_shade,
)
from physgen.report import player


def _layout() -> SimpleNamespace:
    """Return the photo's width and height, the first and last + 1 column and row of the
    box, the row of the floor, px, and turns of the box, rad.
    """
    return SimpleNamespace(
        size=(200, 160),
        left=60,
        top=40,
        right=140,
        bottom=120,
        foot=119.5,
        start=Pose(99.5, 79.5, 0.0),
        turns=(0, 0.02, 0.05, 0.1, 0.15),
    )


BOX = _layout()


def _box() -> Silhouette:
    coverage = np.ones((BOX.bottom - BOX.top, BOX.right - BOX.left), np.float32)
    center = (BOX.start.x, BOX.start.y)
    return Silhouette(coverage, (BOX.left, BOX.top), center, None, 60.0, BOX.foot)


def _photo_shade() -> np.ndarray:
    """Return shade (H, W) that fades within some px below the box."""
    rows, columns = np.indices(BOX.size[::-1])
    below = np.maximum(rows - BOX.foot, 0)
    beside = np.maximum(np.maximum(BOX.left - columns, columns - BOX.right + 1), 0)
    shade = 0.8 * np.exp(-np.hypot(below, beside) / 4)
    return np.where(rows >= BOX.bottom - 30, shade, 0).astype(np.float32)


def _parts() -> tuple[StandingShade, np.ndarray]:
    shade = np.repeat(_photo_shade()[..., None], 3, axis=2)
    measured = np.ones(BOX.size[::-1], np.bool_)
    parts = split_contact_shade(_box(), (0, 0, *BOX.size), shade, measured)
    assert parts is not None
    return parts


def _tilted(turn: float) -> Pose:
    """Return the pose of the box after a turn about its lower right corner, or for a
    negative turn its lower left one.
    """
    corner = BOX.right - 1 if turn > 0 else BOX.left
    x, y = BOX.start.x - corner, BOX.start.y - BOX.foot
    c, s = cos(turn), sin(turn)
    return Pose(corner + c * x - s * y, BOX.foot + s * x + c * y, turn)


def _motion(turn: float) -> BaseMotion:
    return measure_base_motion(base_points(_box()), BOX.start, _tilted(turn), 0.0)


def _darkness(turn: float) -> np.ndarray:
    """Return the darkness (H, W) of the shade below the tilted box."""
    canvas = np.zeros(BOX.size[::-1], np.float32)
    drawn = _parts()[0].draw(_motion(turn), BOX.size)
    assert drawn is not None
    (x0, y0, x1, y1), factor = drawn
    canvas[y0:y1, x0:x1] = -np.log(factor[..., 0])
    return canvas


@pytest.mark.parametrize("turn", [0.1, -0.1])
def test_lift_of_a_base_grows_from_the_touching_corner(turn: float) -> None:
    motion = _motion(turn)
    ends = np.array([BOX.left, BOX.right - 1], np.float32)
    lifts = motion.lifts(ends)
    low, high = (1, 0) if turn > 0 else (0, 1)
    width = BOX.right - 1 - BOX.left
    assert lifts[low] == pytest.approx(0, abs=1e-4)
    assert lifts[high] == pytest.approx(width * tan(abs(turn)), rel=0.01)
    assert hypot(*motion.shift) < 1e-6
    assert motion.height == pytest.approx(0, abs=1e-6)


def test_shade_without_lift_is_that_of_the_photo() -> None:
    motion = measure_base_motion(base_points(_box()), BOX.start, BOX.start, 0.0)
    assert motion.rocking_share(80.0) == 0
    # The first row below the box contains a part of its border.
    ground = np.s_[BOX.bottom + 1 :]
    shade = _darkness(0.0) + _parts()[1]
    assert shade[ground] == pytest.approx(_photo_shade()[ground], abs=0.01)


def test_shade_is_lighter_the_higher_the_base() -> None:
    under_lifted_end = [
        _darkness(turn)[BOX.bottom + 1, BOX.left + 8] for turn in BOX.turns
    ]
    assert (np.diff(under_lifted_end) < 0).all()
    under_corner = [
        _darkness(turn)[BOX.bottom + 1, BOX.right - 2] for turn in BOX.turns
    ]
    assert under_corner == pytest.approx([under_corner[0]] * 5, abs=0.06)


def test_shade_is_wider_the_higher_the_base() -> None:
    widths = []
    for turn in BOX.turns:
        profile = _darkness(turn)[BOX.bottom :, BOX.left + 8]
        rows = np.arange(len(profile))
        widths.append((profile * rows).sum() / profile.sum())
    assert (np.diff(widths) > 0).all()


def test_shade_continues_into_the_gap() -> None:
    """Light enters it: no step between the gap and the ground before it."""
    column = _darkness(0.1)[BOX.bottom - 8 : BOX.bottom + 10, BOX.left + 8]
    assert np.abs(np.diff(column)).max() < 0.08
    assert column.min() > 0


def _lit_background(height: int = 0) -> LitBackground:
    """Return the background of a photo with the shade, and a clean one without it.

    The box is `height` px over the floor.
    """
    light = np.full((*BOX.size[::-1], 3), 0.5, np.float32)
    shaded = light * np.exp(-_photo_shade())[..., None]
    coverage = np.zeros(BOX.size[::-1], np.float32)
    coverage[BOX.top : BOX.bottom, BOX.left : BOX.right] = 1
    setting = ShadowSetting(
        DistantLight((0.0, -0.6, 0.8), 0.06, 1.14), 40.0, False, 0.1, np.inf, BOX.size
    )
    start = replace(_box(), floor=BOX.foot + height)
    background, _ = decompose_shadows(
        encode_u8(shaded), encode_u8(light), coverage, [start], [False], setting
    )
    sprite = cast(Sprite, SimpleNamespace(foot_halo=None))
    return add_contact_shades(background, [sprite])


def _ground_light(background: LitBackground, turn: float) -> np.ndarray:
    """Return the share (H, W) of light that the shadows of the tilted box leave."""
    pose = _tilted(turn)
    darkness = np.zeros(BOX.size[::-1], np.float32)
    for (x0, y0, x1, y1), shade in background.move_shadow(0, _box(), BOX.start, pose):
        darkness[y0:y1, x0:x1] += shade
    share = np.exp(-darkness)
    contact = background.contact_shade(0, _box(), BOX.start, pose)
    if contact is not None:
        share[contact.box] *= contact.factor[..., 0]
    return share


def test_shade_begins_to_move_without_a_jump() -> None:
    background = _lit_background()
    ground = np.s_[BOX.bottom + STANDING.ring :]
    photo = np.exp(-background.total)
    previous = photo
    for turn in (1e-5, 1e-3, 3e-3, 6e-3, 0.01, 0.0125):
        share = _ground_light(background, turn)
        assert np.abs(share - previous)[ground].max() < 0.03
        previous = share


def test_only_standing_objects_have_contact_shade() -> None:
    assert _lit_background().casts[0].contact is not None
    assert _lit_background(height=20).casts[0].contact is None


def test_player_shows_the_shade_of_a_rocking_object(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The page's shadow pictures have the same darkness as the frames."""
    background = _lit_background()
    monkeypatch.setattr(player, "sprite_coverage", lambda *_: None)
    monkeypatch.setattr(player, "sprite_silhouette", lambda *_: _box())
    turn = 0.05
    stand = SimpleNamespace(
        k=0, start=BOX.start, pose=_tilted(turn), placement="any but None"
    )
    stage = SimpleNamespace(sprites=[None])
    measured = player._measure_darkening(
        cast(Stage, stage), background, cast(SpritePose, stand)
    )
    assert measured is not None
    darkness = _on_canvas(*measured)
    expected = -np.log(_ground_light(background, turn))
    ground = np.s_[BOX.bottom + 1 :]
    assert expected[ground].max() > 0.1
    assert darkness[ground] == pytest.approx(expected[ground], abs=0.02)


def _on_canvas(box: PixelBox, picture: np.ndarray) -> np.ndarray:
    """Return (H, W) of the photo's part of a picture, whose box may leave the photo."""
    x0, y0, x1, y1 = box
    margin = 500
    wide = np.zeros((BOX.size[1] + 2 * margin, BOX.size[0] + 2 * margin), np.float32)
    wide[y0 + margin : y1 + margin, x0 + margin : x1 + margin] = picture
    return wide[margin:-margin, margin:-margin]
