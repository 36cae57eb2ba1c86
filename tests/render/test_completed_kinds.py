"""Uncovered parts are completed by the kind of object, beside the truth of drawn ones."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import cv2
import numpy as np
import pytest

from physgen.compile.world import Body
from physgen.geometry.polygon import Pose
from physgen.maps import F32
from physgen.materials import drawn_kinds
from physgen.photometry import DistantLight
from physgen.render.ball import ball_from_photo
from physgen.render.block_tops import top_of_book
from physgen.render.box_faces import with_closed_faces
from physgen.render.hanging_ball import has_one_hue, without_eyelet
from physgen.render.highlights import DiscPicture, shared_highlights
from physgen.render.sprites import MARGIN, Gloss, Sprite, cut_sprites
from physgen.render.stage import draw_sprite, place_sprite
from physgen.render.vessels import (
    SHALLOW_VESSEL,
    open_vessel,
    opening_of,
    with_room_for_opening,
)
from physgen.scene.scene import View

FINE = 8


def drawn(shape: tuple[int, int], *layers: tuple[np.ndarray, tuple[float, ...]]) -> F32:
    """Polygons of colours over each other, (h, w, 3), with soft borders."""
    canvas = np.zeros((shape[0] * FINE, shape[1] * FINE, 3), np.float32)
    for points, colour in layers:
        corners = np.rint((points + 0.5) * FINE).astype(np.int32)
        cv2.fillPoly(canvas, [corners], colour)
    size = (shape[1], shape[0])
    return np.asarray(
        cv2.resize(canvas, size, interpolation=cv2.INTER_AREA), np.float32
    )


def boxed(corners: np.ndarray) -> Body:
    """A body with four corners about their middle."""
    middle = corners.mean(axis=0)
    rings = (corners - middle,)
    return cast(Body, SimpleNamespace(radius=None, rings=rings, center=middle))


def book(pages: float, covers: float) -> tuple[F32, F32]:
    """Light and coverage of a spine from row 20 on, with a band of 6 rows above it."""
    light = np.zeros((80, 40, 3), np.float32)
    light[20:78, 5:35] = 0.1
    light[14:20, 5:35] = pages
    light[14:20, 5:9] = light[14:20, 31:35] = covers
    return light, (light[..., 0] > 0).astype(np.float32)


@pytest.mark.parametrize("turn", [-0.6, 0.4])
def test_pages_stay_between_covers_above_the_edge(turn: float) -> None:
    """A point of the band is right above its point of the turned edge, as depth is."""
    light, coverage = book(pages=0.6, covers=0.12)
    top = top_of_book(light, coverage, 19.5, (5, 34), None)
    assert top is not None
    assert top.is_visible(turn)
    c, s = np.cos(turn), np.sin(turn)
    forwards = np.array([[c, -s, 40.0], [s, c, 40.0]])
    matrix = np.asarray(cv2.invertAffineTransform(forwards), np.float64)
    colour, cover = top.warp(matrix, (120, 120), turn)
    for x, paint in ((7.0, 0.12), (20.0, 0.6), (32.0, 0.12)):
        for above in (2.0, 4.0):
            edge = forwards @ [x, top.edge, 1.0]
            column, row = np.rint(edge - [0, above]).astype(int)
            assert colour[row, column, 0] == pytest.approx(paint, abs=0.08)
            assert cover[row, column] > 0.9
    assert not top.is_visible(turn + np.pi)


@pytest.mark.parametrize(("pages", "covers"), [(0.6, 0.6), (0.11, 0.1), (0.1, 0.6)])
def test_an_even_top_shows_no_pages(pages: float, covers: float) -> None:
    light, coverage = book(pages, covers)
    assert top_of_book(light, coverage, 19.5, (5, 34), None) is None


def test_the_light_of_a_turned_top_follows_lambert() -> None:
    light, coverage = book(pages=0.6, covers=0.12)
    lamp = DistantLight((0.6, -0.8, 0.0), 1.0, 0.2)
    top = top_of_book(light, coverage, 19.5, (5, 34), lamp)
    assert top is not None
    identity = np.eye(2, 3)
    colour, _ = top.warp(identity, (80, 40), 0.0)
    assert colour[17, 20, 0] == pytest.approx(0.6, abs=0.01)
    turn = np.arctan2(0.6, 0.8)  # The top faces the lamp.
    lit, _ = top.warp(identity, (80, 40), float(turn))
    assert lit[17, 20, 0] / colour[17, 20, 0] == pytest.approx(1.2 / 1.0, abs=0.01)


def vessel() -> tuple[Sprite, Body, np.ndarray]:
    """A cylinder with a lid over its upper end, 12 degrees from above."""
    labels = np.zeros((120, 120), np.uint16)
    labels[40:100, 30:90] = 1
    labels[20:47, 28:92] = 2
    light = np.zeros((120, 120, 3), np.float32)
    light[40:100, 30:90] = 0.5
    coverage = (light[..., 0] > 0).astype(np.float32)
    corners = np.array([[29.5, 39.5], [89.5, 39.5], [89.5, 99.5], [29.5, 99.5]])
    return Sprite(0, (0, 0), light, coverage), boxed(corners), labels


def test_a_vessel_below_its_lid_is_open() -> None:
    """The opening is a dark ellipse with the camera's foreshortening, in a bright rim."""
    sprite, body, labels = vessel()
    tilt = np.tan(np.radians(12))
    opening = opening_of(body, sprite.corner, float(tilt))
    assert opening is not None
    assert opening.half_height == pytest.approx(30 * np.sin(np.radians(12)), abs=0.01)
    opened = open_vessel(sprite, body, labels, float(tilt))
    middle = opened.light[:, 59, 0]
    far_rim, near_rim = 39.5 - opening.half_height, 39.5 + opening.half_height
    assert middle[round(far_rim) + 1] > 0.5 < middle[round(near_rim) - 1]
    assert (middle[36:44] < 0.4).all()
    assert (middle[36:44] > 0.15).all()
    assert (np.diff(middle[37:43]) < 0).all()  # darker towards the near rim
    columns = np.flatnonzero(opened.light[39, :, 0] < 0.4)
    inside = columns[(columns > 29) & (columns < 90)]
    assert abs(inside.mean() - 59.5) < 0.6
    assert np.array_equal(opened.light[60:], sprite.light[60:])


def test_saucer_below_its_cup_is_lit_like_its_visible_inside() -> None:
    """The visible ends of the ellipse set the light between them."""
    sprite, body, labels = vessel()
    tilt = float(np.tan(np.radians(12)))
    opening = opening_of(body, sprite.corner, tilt)
    assert opening is not None
    rows, columns = np.mgrid[:120, :120]
    distance = np.hypot(
        (columns - opening.x) / opening.half_width,
        (rows - opening.y) / opening.half_height,
    )
    sprite.light[distance < 1] = 0.8
    sprite.coverage[distance < 1] = 1
    labels[:] = np.where(sprite.coverage > 0, 1, 0)
    labels[20:47, 45:75] = 2
    sprite.light[20:47, 45:75] = sprite.coverage[20:47, 45:75] = 0
    opened = open_vessel(sprite, body, labels, tilt, tuning=SHALLOW_VESSEL)
    inside = opened.light[:, 48:72][distance[:, 48:72] < 0.8]
    assert inside.mean() == pytest.approx(0.8, rel=0.08)
    assert inside.std() < 0.08
    # A deep vessel is dark inside.
    deep = open_vessel(sprite, body, labels, tilt)
    assert deep.light[:, 48:72][distance[:, 48:72] < 0.8].mean() < 0.5


def test_a_vessel_without_a_lid_stays_as_it_is() -> None:
    sprite, body, labels = vessel()
    labels[labels == 2] = 0
    assert open_vessel(sprite, body, labels, 0.2) is sprite
    assert opening_of(body, sprite.corner, 0.0) is None  # seen level


def test_fruit_in_a_bowl_does_not_hide_it() -> None:
    """An object that is drawn before the vessel lies in it."""
    sprite, body, labels = vessel()
    assert open_vessel(sprite, body, labels, 0.2, [0, 1]) is not sprite
    assert open_vessel(sprite, body, labels, 0.2, [0]) is sprite


def test_a_cropped_vessel_gets_room_above() -> None:
    sprite, body, labels = vessel()
    cropped = Sprite(0, (0, 38), sprite.light[38:], sprite.coverage[38:])
    roomy = with_room_for_opening(cropped, body, labels, 0.2)
    opened = open_vessel(roomy, body, labels, 0.2)
    assert opened.corner[1] < 34
    assert opened.coverage[39 - opened.corner[1], 59] == 1


def test_room_for_an_opening_ends_at_the_border_of_the_photo() -> None:
    """A vessel at the photo's top: the photo has no rows for its far rim."""
    tilt = np.tan(np.radians(12))
    sprite, body, labels = vessel()
    shift = 38
    body.center[1] -= shift
    labels = labels[shift:]
    light = np.pad(sprite.light[shift:], ((MARGIN, 0), (0, 0), (0, 0)))
    cover = np.pad(sprite.coverage[shift:], ((MARGIN, 0), (0, 0)))
    padded = Sprite(0, (0, -MARGIN), light, cover)
    assert with_room_for_opening(padded, body, labels, tilt).corner == (0, -MARGIN)
    for crop in (4, 6):
        cropped = Sprite(0, (0, crop - MARGIN), light[crop:], cover[crop:])
        roomy = with_room_for_opening(cropped, body, labels, tilt)
        assert roomy.corner == (0, -MARGIN)
    labels[labels == 2] = 0  # Nothing hides it: nothing is drawn there.
    assert with_room_for_opening(cropped, body, labels, tilt) is cropped


@pytest.mark.parametrize(("foot", "is_open"), [(50, True), (60, True), (80, False)])
def test_a_vessel_with_a_wider_foot_is_upside_down(foot: int, is_open: bool) -> None:
    x = np.array([29.5, 89.5, 59.5 + foot / 2, 59.5 - foot / 2])
    body = boxed(np.column_stack([x, [39.5, 39.5, 99.5, 99.5]]))
    assert (opening_of(body, (0, 0), 0.2) is not None) == is_open


@pytest.mark.parametrize(
    ("label", "kinds"),
    [
        ("billiard ball", "b"),
        ("mug", "o"),
        ("plastic cup on the left", "o"),
        ("upside-down plastic cup", ""),
        ("closed jar", ""),
        ("jar with a lid", ""),
        ("jar of jam", ""),
        ("barrel", ""),
        ("teapot", ""),
        ("chrome ball", "m"),
        ("painted metal ball", ""),
        ("petanque ball", ""),
        ("steel football", ""),
        ("old dictionary", "p"),
        ("suitcase", ""),
    ],
)
def test_labels_decide_what_is_completed(label: str, kinds: str) -> None:
    assert drawn_kinds(label) == tuple(letter in kinds for letter in "bomp")


def tilted_plank() -> tuple[np.ndarray, Sprite, np.ndarray]:
    """A plank at 15 degrees whose mask goes 3 px below it, and a block in front."""
    c, s = np.cos(np.radians(15)), np.sin(np.radians(15))
    along, down = np.array([c, s]), np.array([-s, c])
    steps = [0 * along, 90 * along, 90 * along + 20 * down, 20 * down]
    corners = np.array([20.0, 30.0]) + np.array(steps)
    picture = corners + np.array([0 * down, 0 * down, 3 * down, 3 * down])
    light = drawn((100, 130), (picture, (0.5, 0.4, 0.3)))
    cover = drawn((100, 130), (picture, (1, 1, 1)))[..., 0]
    labels = (cover >= 0.5).astype(np.uint16)
    labels[:, 55:75] = 2
    shown = (labels != 2).astype(np.float32)
    return corners, Sprite(0, (0, 0), light * shown[..., None], cover * shown), labels


def test_a_plank_gets_no_face_below_it() -> None:
    corners, sprite, labels = tilted_plank()
    assert with_closed_faces(sprite, boxed(corners), labels) is sprite
    upwards = np.array([129.0, 99.0]) - corners
    light, cover = sprite.light[::-1, ::-1], sprite.coverage[::-1, ::-1]
    over = replace(sprite, light=light, coverage=cover)
    turned = labels[::-1, ::-1]
    assert with_closed_faces(over, boxed(upwards), turned) is not over


def test_a_short_edge_has_no_face() -> None:
    corners = np.array([[60, 30], [130, 60], [130.2, 60.3], [60, 110]])
    cover = drawn((130, 150), (corners, (1, 1, 1)))
    labels = (cover[..., 0] >= 0.5).astype(np.uint16)
    labels[40:80, 125:] = 2
    sprite = Sprite(0, (0, 0), cover, cover[..., 0])
    closed = with_closed_faces(sprite, boxed(corners), labels)
    assert np.isfinite(closed.light).all()


def test_the_top_of_a_tilted_box_reaches_both_ends() -> None:
    """A box on its corner, half of its top behind another: as if the other were not there."""
    turn = np.radians(25)
    along, down = (
        np.array([np.cos(turn), np.sin(turn)]),
        np.array([-np.sin(turn), np.cos(turn)]),
    )
    start = np.array([40.0, 30.0])
    corners = start + np.array(
        [0 * along, 70 * along, 70 * along + 40 * down, 40 * down]
    )
    band = np.array(
        [start, start + 70 * along, start + 70 * along - 6 * down, start - 6 * down]
    )
    truth = drawn((120, 130), (corners, (0.6, 0.5, 0.3)), (band, (0.3, 0.2, 0.1)))
    cover = drawn((120, 130), (corners, (1, 1, 1)), (band, (1, 1, 1)))[..., 0]
    x, y = np.meshgrid(np.arange(130), np.arange(120))
    distance = (np.stack([x, y], axis=2) - start) @ along
    behind = (distance > 35) & ((np.stack([x, y], axis=2) - start) @ -down > 0)
    labels = np.where(behind, 2, cover >= 0.5).astype(np.uint16)
    hidden = np.where(behind, 0, 1).astype(np.float32)
    sprite = Sprite(0, (0, 0), truth * hidden[..., None], cover * hidden)
    closed = with_closed_faces(sprite, boxed(corners), labels)
    is_checked = behind & (cover > 0.95) & (distance < 66)
    assert np.count_nonzero(is_checked) > 100
    assert np.abs(closed.light - truth)[is_checked].mean() < 0.03
    assert np.abs(closed.coverage - cover)[behind].mean() < 0.01
    nothing_hidden = np.where(labels == 2, 0, labels).astype(np.uint16)
    assert with_closed_faces(sprite, boxed(corners), nothing_hidden) is sprite


def stones(marks: list[float]) -> tuple[list[DiscPicture], F32]:
    """Discs with a dark bar each and one highlight in common, and the light of the highlight."""
    y, x = np.mgrid[:61, :61] - 30.0
    inside = np.hypot(x, y) < 25
    shine = 0.6 * np.exp(-(((x - 8) / 2) ** 2 + ((y + 10) / 2) ** 2))
    discs = []
    for mark in marks:
        across = x * np.sin(mark) - y * np.cos(mark)
        along = x * np.cos(mark) + y * np.sin(mark)
        bar = (np.abs(across) < 3) & (np.abs(along) < 20)
        paint = np.where(bar, 0.05, 0.2)
        light = np.repeat((inside * (paint + shine))[..., None], 3, axis=2)
        discs.append(DiscPicture(light.astype(np.float32), inside, (30.0, 30.0), 25.0))
    return discs, shine.astype(np.float32)


def test_highlights_of_a_set_are_told_from_marks() -> None:
    discs, shine = stones([0.2, 0.9, 1.7, 2.4, 2.9])
    highlights = shared_highlights(discs)
    assert len(highlights) == 5
    core = shine > 0.3
    for light in highlights:
        assert light[core].mean() > 0.7 * shine[core].mean()
        assert light[shine < 0.005].mean() < 0.01
    # Marks that are turned alike may be what looks like light.
    assert shared_highlights(stones([0.2] * 5)[0]) == []
    assert shared_highlights(discs[:2]) == []


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("columns", [61, 44])
def test_a_disc_that_is_cut_off_tells_no_highlights(columns: int) -> None:
    """What the photo's border hides of one disc is no difference between the discs."""
    discs, _ = stones([0.2] * 5)
    light, known = discs[0].light[:, :columns], discs[0].mask[:, :columns]
    discs[0] = replace(discs[0], light=light, mask=known)
    assert shared_highlights(discs) == []
    discs, shine = stones([0.2, 0.9, 1.7, 2.4, 2.9])
    light, known = discs[0].light[:, :columns], discs[0].mask[:, :columns]
    discs[0] = replace(discs[0], light=light, mask=known)
    highlights = shared_highlights(discs)
    assert highlights[1][shine > 0.3].mean() > 0.7 * shine[shine > 0.3].mean()


@pytest.mark.parametrize("turn", [0.7, np.pi])
def test_gloss_moves_and_does_not_turn(turn: float) -> None:
    discs, shine = stones([0.2])
    cover = discs[0].mask.astype(np.float32)
    gloss = Gloss(np.repeat(shine[..., None], 3, axis=2), (30.0, 30.0))
    sprite = Sprite(0, (0, 0), discs[0].light, cover, gloss=gloss)
    start, pose = Pose(30.0, 30.0, 0.0), Pose(45.0, 38.0, float(turn))
    where = place_sprite(sprite, start, pose, (100, 100), None)
    assert where is not None
    light, _ = draw_sprite(sprite, where)
    row, column = np.unravel_index(light[..., 0].argmax(), light.shape[:2])
    place = [column + where.box[1].start, row + where.box[0].start]
    assert np.abs(np.subtract(place, [45 + 8, 38 - 10])).max() <= 1


def test_a_background_that_is_wrong_leaves_no_colour_in_borders() -> None:
    """A dark green disc before a red light that the background does not have."""
    y, x = np.mgrid[:80, :80] - 40.0
    distance = np.hypot(x, y)
    cover = np.clip(20.5 - distance, 0, 1).astype(np.float32)
    red = np.array([250, 60, 60], np.uint8)
    green = np.array([20, 60, 20], np.uint8)
    photo = cover[..., None] * green + (1 - cover[..., None]) * red
    labels = (cover >= 0.5).astype(np.uint16)
    background = np.full((80, 80, 3), 40, np.uint8)
    absent = np.zeros((80, 80), bool)
    rgb = np.rint(photo).astype(np.uint8)
    (sprite,) = cut_sprites(rgb, labels, absent, cover, background, {0: 0})
    border = (sprite.coverage > 0.2) & (sprite.coverage < 1)
    own = sprite.light[border] / sprite.coverage[border][:, None]
    assert np.count_nonzero(border) > 50
    assert own[:, 0].max() < 0.1  # the red light has 0.95, the disc 0.007


def test_a_bright_rim_stays_before_a_true_background() -> None:
    """A dark disc lit from behind: its rim is brighter than its inside and the wall."""
    y, x = np.mgrid[:80, :80] - 40.0
    distance = np.hypot(x, y)
    cover = np.clip(20.5 - distance, 0, 1).astype(np.float32)
    paint = np.where(distance < 19, 20, 220)[..., None]
    photo = cover[..., None] * paint + (1 - cover[..., None]) * 40
    rgb = np.repeat(np.rint(photo).astype(np.uint8), 3, axis=2)
    labels, absent = (cover >= 0.5).astype(np.uint16), np.zeros((80, 80), bool)
    background = np.full((80, 80, 3), 40, np.uint8)
    (sprite,) = cut_sprites(rgb, labels, absent, cover, background, {0: 0})
    border = (sprite.coverage > 0.5) & (sprite.coverage < 1)
    own = sprite.light[border] / sprite.coverage[border][:, None]
    assert np.median(own) > 0.3  # the inside has 0.007


def test_a_painted_metal_ball_is_no_mirror() -> None:
    y, x = np.mgrid[:60, :60] - 30.0
    cover = (np.hypot(x, y) < 25).astype(np.float32)
    shade = cover * (0.4 + 0.01 * y)
    images = shade[..., None] * np.array([0.9, 0.7, 0.3], np.float32)
    bare = Sprite(0, (0, 0), images.astype(np.float32), cover)
    red = np.array([0.9, 0.05, 0.05], np.float32) * shade[..., None]
    half = np.where((x < 0)[..., None], red, images).astype(np.float32)
    assert has_one_hue(bare)
    assert not has_one_hue(replace(bare, light=half))


def test_a_metal_ball_keeps_its_mirror_images_and_not_its_eyelet() -> None:
    """A ball with a bright eyelet at one o'clock: without it, the ball is the gradient that it mirrors."""
    y, x = np.mgrid[:80, :80] - 40.0
    distance = np.hypot(x, y)
    truth = (0.3 + 0.004 * y)[..., None] * np.array([1, 0.8, 0.4], np.float32)
    angle = np.radians(-60)
    across = np.abs(x * np.sin(angle) - y * np.cos(angle))
    along = x * np.cos(angle) + y * np.sin(angle)
    eyelet = (across < 3) & (along > 16) & (along < 28)
    cover = (distance <= 20).astype(np.float32)
    photo = np.where(eyelet[..., None], 0.9, truth)
    ball = Sprite(0, (0, 0), (photo * cover[..., None]).astype(np.float32), cover)
    outside = (eyelet & (distance > 20)).astype(np.float32)
    thread = Sprite(0, (0, 0), np.repeat(outside[..., None], 3, axis=2), outside)
    body = cast(Body, SimpleNamespace(radius=20.0, center=np.array([40.0, 40.0])))
    bare = without_eyelet(ball, thread, body)
    assert np.abs(ball.light - truth)[distance < 19].max() > 0.5
    assert np.abs(bare.light - truth)[distance < 19].max() < 0.02
    lamp = DistantLight((0.0, -0.6, 0.8), 1.0, 0.3)
    mirror = ball_from_photo(
        bare.light, (0, 0), (40.0, 40.0), 20.0, lamp, View.SIDE, is_mirror=True
    )
    assert np.ptp(mirror.skin, axis=(0, 1)).max() == 0  # nothing that could turn
    shown = mirror.skin * mirror.shading + mirror.gloss
    assert np.abs(shown - truth)[distance < 19].max() < 0.02
