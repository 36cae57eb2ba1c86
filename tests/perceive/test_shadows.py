"""Shadows drawn as polygons and ellipses: lifted where they are and given to what casts them, none found elsewhere."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen import registry
from physgen.geometry.polygon import Disc, Region, Ring
from physgen.geometry.shadows import (
    ShadowSetting,
    Silhouette,
    attenuation,
    shadow_on_table,
)
from physgen.perceive.roles import BoundaryGuess, LightGuess, PhotoObject, Shadows, Wall
from physgen.perceive.shadow import side_view
from physgen.perceive.shadow.refills import refill_background
from physgen.perceive.shadow.reflections import remove_reflections
from physgen.perceive.shadow.shadow_removal import lighten, remove_shadows
from physgen.photometry import DistantLight, decode, encode_u8
from physgen.scene.scene import View
from tests.perceive.lambertian import overlap

WIDTH, HEIGHT = 480, 320
FLOOR = 240.5
"""The row on which things are seen to end."""
TILT = 0.12
GUESS = LightGuess(DistantLight((0.0, -0.6, 0.8), 0.8, 0.4), 0.1)


def room(grain: float = 0.03) -> np.ndarray:
    """(H, W, 3) linear: a wall, and from row 200 on a floor of boards."""
    random = np.random.default_rng(5)
    rows = np.arange(HEIGHT)[:, None]
    walls, boards = np.array([0.30, 0.34, 0.38]), np.array([0.42, 0.30, 0.20])
    picture = (
        np.where((rows < 200)[..., None], walls, boards)
        * (0.9 + 0.2 * np.linspace(0, 1, WIDTH))[None, :, None]
    )
    lines = cv2.GaussianBlur(
        random.normal(0, 1, (HEIGHT, WIDTH)), (0, 0), sigmaX=25, sigmaY=1.0
    )
    lines += cv2.GaussianBlur(random.normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 1.0) * 0.3
    return np.asarray(
        picture * np.exp(grain * lines / lines.std())[..., None], np.float32
    )


def srgb(linear: np.ndarray) -> np.ndarray:
    v = np.clip(linear, 0, 1)
    return np.rint(
        255 * np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)
    ).astype(np.uint8)


def drawn(polygon: list[tuple[float, float]]) -> np.ndarray:
    """(H, W) 0..1: how much of each pixel a polygon covers."""
    points = np.rint((np.array(polygon) + 0.5) * 16 - 8).astype(np.int32)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.fillPoly(mask, [cv2.convexHull(points)], 255, cv2.LINE_AA, 4)
    return mask.astype(np.float32) / 255


def cast(
    x0: float, x1: float, height: float, thick: float, ax: float, az: float
) -> np.ndarray:
    """(H, W) the floor that a block keeps from a small light: its foot, drawn out along the light."""
    middle = FLOOR - TILT * thick / 2
    corners = [(x, z) for x in (x0, x1) for z in (-thick / 2, thick / 2)]
    return drawn(
        [
            (x + ax * k * height, middle + TILT * (z + az * k * height))
            for x, z in corners
            for k in (0, 1)
        ]
    )


def photo(shade: np.ndarray, blocks: list[tuple[int, int, int]], picture: np.ndarray):
    """What the role `shadow` is given: a background with shadows, perfectly filled, and what stands before it."""
    labels = np.zeros((HEIGHT, WIDTH), np.uint16)
    things = []
    for k, (x0, x1, top) in enumerate(blocks, 1):
        labels[top:241, x0 : x1 + 1] = k
        ring = np.array(
            [
                [x0 - 0.5, top - 0.5],
                [x1 + 0.5, top - 0.5],
                [x1 + 0.5, 240.5],
                [x0 - 0.5, 240.5],
            ]
        )
        things.append(PhotoObject(k, Region((Ring(ring),)), "wooden block"))
    return srgb(picture * (1 - shade)[..., None]), labels, things


def lift(background, labels, things, walls=None, view=View.SIDE):
    floor = Wall("floor", ((-0.5, FLOOR), (WIDTH - 0.5, FLOOR)), 0.5, 0.5, 0.9, "", "")
    setting = BoundaryGuess(view, 1.0, "", (floor,) if walls is None else walls)
    matter = registry.make("physics")(background, things, None)
    coverage = (labels > 0).astype(np.float32)
    return registry.make("shadow")(
        background, coverage, labels, things, matter, setting, GUESS
    )


BLOCKS = [(120, 149, 180), (250, 279, 190)]


@pytest.mark.parametrize("side", [1, -1])
def test_a_block_shadow_on_the_floor_is_lifted(side) -> None:
    each = [
        cast(x0 - 0.5, x1 + 0.5, 240.5 - top, 40, side * 1.3, -0.8)
        for x0, x1, top in BLOCKS
    ]
    shade = 0.55 * cv2.GaussianBlur(np.maximum(*each), (0, 0), 1.0)
    truth = srgb(room())
    background, labels, things = photo(shade, BLOCKS, room())
    found = lift(background, labels, things)
    assert found.clean_background is not None
    assert found.backdrop is None
    x, y, z = found.light.direction
    assert -x / -y == pytest.approx(side * 1.3, abs=0.5)
    assert z > 0
    free = cv2.dilate((labels > 0).astype(np.uint8), np.ones((7, 7), np.uint8)) == 0
    before, after = (
        np.abs(p.astype(int) - truth).max(-1)
        for p in (background, found.clean_background)
    )
    dark = free & (shade > 0.2)
    assert before[dark].mean() > 30
    assert after[dark].mean() < 5
    assert after[free & (shade < 0.003)].mean() < 0.2, "and nothing else"
    assert found.owners is not None
    assert found.owners.dtype == np.uint16
    for k, one in enumerate(each, 1):
        assert overlap(free & (found.owners == k), free & (one > 0.2)) > 0.6
        assert (found.owners[free & (one > 0.9)] == k).mean() > 0.95
    assert not found.owners[:200].any(), "the wall behind has none"


@pytest.mark.slow
def test_a_hole_in_a_shadow_is_filled_in_the_light() -> None:
    """The tall block's shadow goes on behind the other one, where nobody saw it."""
    blocks = [(120, 149, 110), (230, 254, 195)]
    shade = np.zeros((HEIGHT, WIDTH), np.float32)
    for x0, x1, top in blocks:
        np.maximum(
            shade, cast(x0 - 0.5, x1 + 0.5, 240.5 - top, 40, 1.3, -0.8), out=shade
        )
    truth, inpaint = srgb(room()), registry.make("inpaint")
    background, labels, things = photo(0.55 * shade, blocks, room())
    coverage = (labels > 0).astype(np.float32)
    background[labels > 0] = 20
    background = inpaint(background, coverage > 0)
    found = lift(background, labels, things)
    assert found.clean_background is not None
    clean = refill_background(found.clean_background, background, coverage, inpaint)
    hidden = (labels == 2) & (shade > 0.9)
    before, after = (
        np.abs(p.astype(int) - truth).mean(-1)[hidden].mean()
        for p in (background, clean)
    )
    assert hidden.sum() > 100
    assert after < 0.5 * before


@pytest.mark.parametrize("what", ["nothing", "grain", "rug", "stripe"])
def test_dark_things_that_are_no_shadows_stay(what) -> None:
    picture = room(0.12 if what == "grain" else 0.03)
    if what == "rug":
        picture *= (1 - 0.4 * drawn([(20, 262), (90, 250), (110, 300), (15, 310)]))[
            ..., None
        ]
    if what == "stripe":  # across all of the photo, where shadows would lie
        picture[226:234] *= 0.5
    background, labels, things = photo(
        np.zeros((HEIGHT, WIDTH), np.float32), BLOCKS, picture
    )
    assert lift(background, labels, things).clean_background is None


def test_balls_before_a_wall_leave_no_shadows_on_it() -> None:
    """Drawn as ellipses, 70 px right and 55 px down, and a little smaller since the wall is farther off."""
    balls = [(70.0, 60.0, 18.0), (150.0, 80.0, 24.0), (240.0, 55.0, 15.0)]
    labels = np.zeros((HEIGHT, WIDTH), np.uint16)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    shade = np.zeros((HEIGHT, WIDTH), np.float32)
    things = []
    for k, (cx, cy, r) in enumerate(balls, 1):
        labels[np.hypot(x - cx, y - cy) <= r] = k
        things.append(PhotoObject(k, Disc(np.array([cx, cy]), r), "ball"))
        mx, my = 240 + 0.93 * (cx - 240) + 70, 160 + 0.93 * (cy - 160) + 55
        u, v = (
            ((x - mx) * 70 + (y - my) * 55) / 89,
            ((y - my) * 70 - (x - mx) * 55) / 89,
        )
        shade += np.clip(0.93 * r + 0.5 - np.hypot(u / 1.25, v), 0, 1).astype(
            np.float32
        )
    shade = 0.5 * cv2.GaussianBlur(shade, (0, 0), 1.5)
    truth = srgb(room())
    background = srgb(room() * (1 - shade)[..., None])
    found = lift(background, labels, things, walls=())
    assert found.clean_background is not None
    assert found.backdrop is not None
    assert found.light.direction[0] < -0.2
    assert found.light.direction[1] < -0.2
    free = cv2.dilate((labels > 0).astype(np.uint8), np.ones((7, 7), np.uint8)) == 0
    before, after = (
        np.abs(p.astype(int) - truth).max(-1)[free & (shade > 0.2)].mean()
        for p in (background, found.clean_background)
    )
    assert before > 30
    assert after < 6


def balls_from_above() -> tuple[np.ndarray, list[PhotoObject], list[np.ndarray]]:
    """Labels of three balls on a table, the balls, and their shadows from 45 degrees: discs moved by one radius and
    drawn out along the light."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    labels, things, each = np.zeros((HEIGHT, WIDTH), np.uint16), [], []
    for k, (cx, cy) in enumerate([(120.0, 100.0), (260.0, 120.0), (190.0, 220.0)], 1):
        labels[np.hypot(x - cx, y - cy) <= 22] = k
        things.append(PhotoObject(k, Disc(np.array([cx, cy]), 22.0), "ball"))
        each.append(np.hypot((x - cx - 22) / 2**0.5, y - cy) <= 22)
    return labels, things, each


def test_from_above_each_ball_owns_the_patch_beside_it() -> None:
    labels, things, each = balls_from_above()
    shade = cv2.GaussianBlur(np.any(each, axis=0).astype(np.float32), (0, 0), 1.0)
    grain = cv2.GaussianBlur(
        np.random.default_rng(5).normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 1.0
    )
    table = np.array([0.42, 0.36, 0.30]) * np.exp(0.03 * grain / grain.std())[..., None]
    found = lift(
        srgb(table * (1 - 0.55 * shade)[..., None]), labels, things, (), View.TOP
    )
    assert found.owners is not None
    free = cv2.dilate((labels > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) == 0
    for k, one in enumerate(each, 1):
        assert overlap(free & (found.owners == k), free & one) > 0.6


def test_shadows_that_fan_out_under_a_near_lamp_leave_no_marks() -> None:
    """One distant light is found for all: the shadows seen lie a little beside those that it throws."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    labels, things, shade = (
        np.zeros((HEIGHT, WIDTH), np.uint16),
        [],
        np.zeros((HEIGHT, WIDTH), np.float32),
    )
    centers = [
        (90.0, 90.0),
        (230.0, 80.0),
        (370.0, 100.0),
        (150.0, 210.0),
        (310.0, 220.0),
    ]
    for k, (cx, cy) in enumerate(centers, 1):
        labels[np.hypot(x - cx, y - cy) <= 20] = k
        things.append(PhotoObject(k, Disc(np.array([cx, cy]), 20.0), "ball"))
        turn = np.radians(80 - 30 * (cx - 230) / 140)
        along, across = (
            np.array([np.cos(turn), np.sin(turn)]),
            np.array([-np.sin(turn), np.cos(turn)]),
        )
        u, v = (way[0] * (x - cx) + way[1] * (y - cy) for way in (along, across))
        shade[np.hypot((u - 18) / 1.3, v) <= 20] = 1
    shade = cv2.GaussianBlur(shade, (0, 0), 2.0)
    table = np.broadcast_to(np.array([0.1, 0.3, 0.15]), (HEIGHT, WIDTH, 3))
    found = lift(
        srgb(table * (1 - 0.78 * shade)[..., None]), labels, things, (), View.TOP
    )
    assert found.clean_background is not None
    free = cv2.dilate((labels > 0).astype(np.uint8), np.ones((9, 9), np.uint8)) == 0
    left = (srgb(table).astype(int) - found.clean_background).mean(axis=2)[free]
    assert left.max() < 10


def test_from_above_a_shadow_goes_with_its_colour() -> None:
    """Warm light is blocked, and the cool light of a window is left: no blue disc stays on the table."""
    labels, things, each = balls_from_above()
    shade = cv2.GaussianBlur(np.any(each, axis=0).astype(np.float32), (0, 0), 1.0)
    table = np.broadcast_to(np.array([0.2, 0.2, 0.2]), (HEIGHT, WIDTH, 3))
    found = lift(
        srgb(table * (1 - shade[..., None] * [0.75, 0.65, 0.5])),
        labels,
        things,
        (),
        View.TOP,
    )
    assert found.clean_background is not None
    there = (shade > 0.9) & (
        cv2.dilate((labels > 0).astype(np.uint8), np.ones((9, 9), np.uint8)) == 0
    )
    assert abs(np.median(found.clean_background[there].astype(int) @ [1, 0, -1])) < 8


# soft light from all sides leaves it dark about feet and rims


DISCS = [
    (100.0, 90.0, 24.0),
    (250.0, 80.0, 24.0),
    (380.0, 150.0, 24.0),
    (160.0, 220.0, 24.0),
]


def ice() -> np.ndarray:
    """(H, W, 3) linear: two colours in wide stripes, and grain."""
    grain = cv2.GaussianBlur(
        np.random.default_rng(5).normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 1.0
    )
    stripe = (np.arange(WIDTH) // 120 % 2 == 0)[None, :, None]
    picture = np.where(stripe, np.array([0.5, 0.55, 0.6]), np.array([0.15, 0.2, 0.5]))
    return picture * np.exp(0.03 * grain / grain.std())[..., None]


def stones(
    dark: float, moved: tuple[int, int] = (0, 0)
) -> tuple[Shadows, np.ndarray, np.ndarray]:
    """What the role says of stones on ice, (H, W) how far each pixel is from their rims, and the ice in the light.

    Light at a rim falls by `dark` and comes back with distance; `moved`: the dark rims lie elsewhere.
    """
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    labels, things = np.zeros((HEIGHT, WIDTH), np.uint16), []
    away = np.full((HEIGHT, WIDTH), 1e3)
    for k, (cx, cy, r) in enumerate(DISCS, 1):
        labels[np.hypot(x - cx, y - cy) <= r] = k
        things.append(PhotoObject(k, Disc(np.array([cx, cy]), r), "curling stone"))
        away = np.minimum(
            away, np.abs(np.hypot(x - cx - moved[0], y - cy - moved[1]) - r)
        )
    lit = ice()
    background = srgb(lit * np.exp(-dark * np.exp(-away / 6))[..., None])
    found = lift(background, labels, things, (), View.TOP)
    return found, np.where(labels > 0, -1.0, away), srgb(lit)


def test_rims_of_stones_are_found_and_lifted() -> None:
    found, away, lit = stones(0.35)
    assert found.clean_background is not None
    assert found.is_faint_shadow, "little was lifted: the first fill is kept"
    near = (away > 2) & (away < 8)
    before = np.abs(
        srgb(ice() * np.exp(-0.35 * np.exp(-away / 6))[..., None]).astype(int) - lit
    )[near].mean()
    after = np.abs(found.clean_background.astype(int) - lit)[near].mean()
    assert after < 0.5 * before
    assert found.owners is not None
    told = found.owners > 0
    assert told[(away > 2) & (away < 5)].mean() > 0.8
    assert not told[away > 25].any()
    assert np.unique(found.owners[told]).tolist() == [1, 2, 3, 4]


def test_no_rims_none_found() -> None:
    assert stones(0.0)[0].clean_background is None
    assert stones(0.0)[0].owners is None


def test_dark_rings_that_lie_beside_the_stones_are_paint() -> None:
    assert stones(0.35, moved=(0, -70))[0].clean_background is None


def plank(dark: float) -> tuple[Shadows, np.ndarray]:
    """What the role says of a plank on two feet under an even sky, and (H, W) where it must be dark: below it."""
    labels = np.zeros((HEIGHT, WIDTH), np.uint16)
    ring = [
        (150, 214),
        (330, 214),
        (330, 241),
        (310, 241),
        (310, 226),
        (170, 226),
        (170, 241),
        (150, 241),
    ]
    cv2.fillPoly(labels, [np.array(ring, np.int32)], 1)
    labels[241:] = 0
    outline = Region((Ring(np.array(ring, float) - [0, 0.5]),))
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    below = np.exp(-(((y - 237) / 5.0) ** 2)) / (
        1 + np.exp((np.abs(x - 240) - 85) / 6.0)
    )
    grain = cv2.GaussianBlur(
        np.random.default_rng(5).normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 1.0
    )
    picture = (
        np.array([0.42, 0.36, 0.30])
        * np.exp(0.03 * grain / grain.std() - dark * below)[..., None]
    )
    found = lift(srgb(picture), labels, [PhotoObject(1, outline, "board")])
    open_ = cv2.dilate((labels > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) == 0
    return found, open_ & (below > 0.3)


def test_it_is_dark_under_a_plank() -> None:
    found, below = plank(0.6)
    assert found.owners is not None
    assert (found.owners[below] > 0).mean() > 0.7
    assert not found.owners[:200].any()


def test_a_plank_in_the_light_throws_nothing() -> None:
    found, _ = plank(0.0)
    assert found.clean_background is None
    assert found.owners is None


@pytest.mark.parametrize(("grey", "lifted"), [(150, True), (20, False)])
def test_a_black_panel_is_no_shadow(grey: int, lifted: bool) -> None:
    """A shadow leaves a share of the light: a patch over twelve times as dark is another surface."""
    picture = (
        230 + np.random.default_rng(0).normal(0, 2, (160, 240, 1)).repeat(3, 2)
    ).astype(np.uint8)
    picture[80:110, 90:150] = grey
    predicted = np.zeros((160, 240), np.float32)
    predicted[80:110, 90:150] = 1.5
    clean = remove_shadows(picture, np.zeros((160, 240), np.float32), predicted, 40.0)
    inside = float(clean[88:102, 98:122].mean())
    assert inside > 215 if lifted else inside < grey + 5


# refilling

Y, X = np.mgrid[:120, :200]
BOARDS = np.where((Y < 60)[..., None], [150, 120, 90], [200, 180, 160])
BOARDS = np.clip(
    BOARDS + np.random.default_rng(0).normal(0, 3, (120, 200, 1)), 0, 255
).astype(np.uint8)
LEFT, RIGHT = np.hypot(X - 50, Y - 70) < 14, np.hypot(X - 150, Y - 70) < 14
SHADOW = (np.hypot((X - 172) / 2, Y - 84) < 6) & ~RIGHT


def never(*_: object) -> None:
    raise AssertionError("nothing is to be filled")


def test_where_nothing_was_lifted_the_first_fill_stays() -> None:
    inpaint = registry.make("inpaint")
    coverage = LEFT.astype(np.float32)
    photo = np.where(LEFT[..., None], np.uint8(20), BOARDS)
    background = inpaint(photo, LEFT)
    assert np.array_equal(
        refill_background(background, background, coverage, never), background
    )  # type: ignore[arg-type]


def test_only_the_fill_near_a_lifted_shadow_changes() -> None:
    """Two balls, one with a shadow: behind the other nothing changes, and behind this one no shadow is left."""
    inpaint = registry.make("inpaint")
    both = LEFT | RIGHT
    coverage = both.astype(np.float32)
    dark = np.where(SHADOW[..., None], BOARDS // 3, BOARDS)
    background = inpaint(np.where(both[..., None], np.uint8(20), dark), both)
    lifted = np.where(SHADOW[..., None], BOARDS, background)
    clean = refill_background(lifted, background, coverage, inpaint)
    assert np.array_equal(clean[LEFT], background[LEFT])
    before, after = (
        abs(p[RIGHT].astype(float) - BOARDS[RIGHT]).mean() for p in (background, clean)
    )
    assert after <= before
    assert after < 8


def test_no_bright_wall_comes_where_a_dark_panel_is() -> None:
    """A fill may be lit again, but no brighter than a shadow was dark: a wall came into a black shelf."""
    background = np.full((120, 160, 3), 250, np.uint8)
    background[30:90] = 30
    coverage = np.zeros((120, 160), np.float32)
    coverage[40:80, 40:120] = 1
    lifted = background.copy()
    lifted[80:90] = 80  # taken for a shadow
    for grey, kept in ((250, True), (110, True), (80, False)):

        def inpaint(rgb: np.ndarray, hole: np.ndarray, grey: int = grey) -> np.ndarray:
            return np.where(hole[..., None], np.uint8(grey), rgb)

        clean = refill_background(lifted, background, coverage, inpaint)[76:80, 60:100]
        assert (clean == (30 if kept else grey)).all(), grey


def test_what_a_floor_mirrors_of_an_object_goes_and_the_floors_own_pattern_stays() -> (
    None
):
    inpaint = registry.make("inpaint")
    labels = np.zeros((120, 200), np.uint16)
    labels[20:70, 50:70], labels[30:70, 130:150] = 1, 2
    fade = np.clip(1 - (Y - 70) / 18, 0, 1) * (Y >= 70)
    mirrored = 0.5 * fade * (np.abs(X - 59.5) < 10)
    floor = BOARDS * (1 - mirrored[..., None]) + mirrored[..., None] * np.array(
        [250, 120, 30]
    )
    floor[70:100, 137:142] = (
        BOARDS[70:100, 137:142] * 0.8
    )  # a groove, narrower than the object's foot
    picture = floor.astype(np.uint8)
    clean = remove_reflections(
        picture, labels, (labels > 0).astype(np.float32), inpaint
    )
    there = mirrored > 0.1
    was, now = (
        np.abs(p[there].astype(float) - BOARDS[there]).mean() for p in (picture, clean)
    )
    assert was > 20
    assert now < 8
    assert np.array_equal(clean[:, 100:], picture[:, 100:])


def test_no_light_is_left_where_neither_lamp_nor_sky_is_seen() -> None:
    one = np.ones((1, 1), np.float32)
    assert np.exp(-attenuation(0.7, one, one)).item() < 0.03, (
        "shares that are multiplied leave 0.21"
    )
    assert np.exp(-attenuation(0.7, one, 0 * one)).item() == pytest.approx(
        0.3, abs=0.03
    )


def test_a_balls_shadow_on_a_table_is_as_soft_as_a_round_lamp_makes_it() -> None:
    """Beside rays to points of the lamp's disc, counted; its far end is softer than where it begins."""
    r, soft, size = 30.0, 12.0, (200, 200)
    toward = np.array([-0.5, -0.3, (1 - 0.34) ** 0.5])
    setting = ShadowSetting(
        DistantLight(tuple(toward), 1.0, 0.0), soft, True, 0.1, np.inf, size
    )
    ball = Silhouette(
        np.ones((60, 60), np.float32), (50, 50), (80.0, 80.0), r, 2 * r, None
    )
    (x0, y0, _, _), dark = shadow_on_table(ball, setting)
    k = np.arange(400) + 0.5
    across = np.linalg.svd(toward[None])[2][1:]
    spread = (
        np.tan(np.radians(soft)) * (k / 400) ** 0.5 * [np.cos(2.4 * k), np.sin(2.4 * k)]
    )
    rays = toward + spread.T @ across
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    along = np.arange(30.0, 100.0, 2.0)  # px from the ball's foot, away from the lamp
    way = -toward[:2] / np.linalg.norm(toward[:2])
    points = np.column_stack([along[:, None] * way, np.full(len(along), -r)])
    off = np.linalg.norm(np.cross(points[:, None], rays), axis=2) < r
    there = np.rint(80 + along[:, None] * way).astype(int) - (x0, y0)
    seen = 1 - np.exp(-dark[there[:, 1], there[:, 0]])
    assert np.abs(seen - off.mean(axis=1)).mean() < 0.03


def test_the_shade_of_a_shelf_stays_when_its_balls_leave() -> None:
    """It lies below a row of balls, along all of the shelf, and is deeper than soft light can make theirs."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    along = np.clip(np.minimum(x - 60, 420 - x) / 12.0, 0, 1)
    shade = 0.5 * along * np.clip(1 - (y - 246) / 14.0, 0, 1) * (y > 246)
    board = np.where((y > 240) & (y <= 246) & (x > 55) & (x < 425), 0.03, 1.0)
    labels, things = np.zeros((HEIGHT, WIDTH), np.uint16), []
    for k, cx in enumerate(range(84, 400, 52), 1):
        labels[np.hypot(x - cx, y - 217) <= 23.5] = k
        things.append(PhotoObject(k, Disc(np.array([cx, 217.0]), 23.5), "ball"))
    background = srgb(np.repeat((0.9 * board * (1 - shade))[..., None], 3, axis=2))
    assert lift(background, labels, things).clean_background is None


def test_in_a_balls_shadow_less_of_the_sky_is_missed() -> None:
    """There table and ball light each other: the share of the direct light that is blocked is not hidden once more."""
    r, light = 30.0, DistantLight((0.0, 0.0, 1.0), 0.6, 0.4)
    setting = ShadowSetting(light, 1.0, True, 0.1, np.inf, (200, 200))
    ball = Silhouette(
        np.ones((60, 60), np.float32), (70, 70), (100.0, 100.0), r, 2 * r, None
    )
    (x0, y0, _, _), dark = shadow_on_table(ball, setting)
    for away in (6, 12, 18):
        hidden = (1 + (away / r) ** 2) ** -1.5
        left = np.exp(-dark[100 - y0, 100 + away - x0])
        assert left == pytest.approx(0.4 * (1 - 0.4 * hidden), abs=0.03)


def test_shadows_of_oblique_photos_stay_in_place() -> None:
    """With the floor's known tilt, shadows fall on the same pixels as with the fitted one."""
    setting = ShadowSetting(
        DistantLight((0.3, -0.7, 0.65), 1.0, 0.2), 4.0, False, 0.1, np.inf, (320, 240)
    )
    known = side_view._with_known_tilt(setting, 45.0)
    assert known.tilt == pytest.approx(1.0)
    assert np.linalg.norm(known.light.direction) == pytest.approx(1)
    x, y, z = setting.light.direction
    a, b, c = known.light.direction
    assert x / y == pytest.approx(a / b)
    assert setting.tilt * z / y == pytest.approx(known.tilt * c / b)
    assert side_view._with_known_tilt(setting, None) is setting


def test_removal_leaves_nothing_brighter_than_the_ground() -> None:
    """Beside an object nothing is measured, and the prediction may be too dark."""
    y, x = np.mgrid[:160, :240]
    away = np.hypot(x - 120, y - 80)
    grain = np.random.default_rng(0).normal(0, 2, (160, 240, 1))
    picture = np.clip(205 + grain + np.zeros((160, 240, 3)), 0, 255).astype(np.uint8)
    ground = np.full((160, 240, 3), decode(np.uint8([[[205]]]))[0, 0, 0], np.float32)
    dark = np.where(away < 36, 0.5, 0).astype(np.float32)
    free = (away > 34).astype(np.float32)
    clean = lighten(picture, dark, ground, free)
    assert clean[away < 36].max() <= picture[away > 40].max()
    assert np.array_equal(clean[away > 36], picture[away > 36])


def test_soft_shade_leaves_no_bright_ground() -> None:
    rng = np.random.default_rng(4)
    ground = 0.3 * np.exp(rng.normal(0, 0.05, (120, 160)))
    rows, columns = np.mgrid[:120, :160]
    spot = np.exp(-(((rows - 70) / 12) ** 2) - ((columns - 80) / 30) ** 2)
    shaded = ground * np.exp(-0.3 * spot)
    rgb = encode_u8(np.repeat(shaded[..., None], 3, axis=2).astype(np.float32))
    coverage = np.zeros((120, 160), np.float32)
    # The prediction is three times as deep as the shade.
    prediction = np.asarray(0.9 * spot, np.float32)
    clean = remove_shadows(rgb, coverage, prediction, 40.0, is_soft=True)
    level = decode(clean)[64:76, 60:100].mean() / ground[64:76, 60:100].mean()
    assert 0.9 < level < 1.05
