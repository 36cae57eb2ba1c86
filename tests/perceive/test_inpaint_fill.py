from __future__ import annotations

import tracemalloc

import cv2
import numpy as np
import pytest

from physgen.perceive.backends.inpaint_fill import _copy_detail, _goes_on, fill
from physgen.perceive.inpaint.contact_strips import contact_strips
from physgen.perceive.inpaint.patch_match import RADIUS, Level, _Search
from physgen.perceive.inpaint.poisson import fill_behind, harmonic_fill, seamless
from physgen.perceive.inpaint.shift_map import _Window

H, W = 90, 130
Y, X = np.mgrid[:H, :W].astype(np.float32)


def blob(kind: str) -> np.ndarray:
    hole = np.hypot(X - 60, Y - 45) < 25
    if kind == "two":
        hole = hole & (np.abs(X - 60) > 1) | (np.hypot(X - 110, Y - 20) < 9)
    if kind == "ring":
        hole &= np.hypot(X - 60, Y - 45) > 10
    return hole


@pytest.mark.parametrize("kind", ["disc", "two", "ring"])
@pytest.mark.parametrize("plane", [(0.7, -0.3, 20), (0.0, 1.5, -4), (0.0, 0.0, 9)])
def test_a_plane_is_harmonic(kind: str, plane: tuple[float, float, float]):
    whole = (plane[0] * X + plane[1] * Y + plane[2])[:, :, None]
    hole = blob(kind)
    filled = harmonic_fill(
        np.where(hole[:, :, None], np.float32(-77), whole), hole, 1e-4
    )
    assert np.abs(filled - whole).max() < 2e-3


def test_no_value_leaves_the_range_around_the_hole():
    random = np.random.default_rng(0)
    picture = random.uniform(50, 60, (H, W, 3)).astype(np.float32)
    filled = harmonic_fill(picture, blob("disc"))
    assert filled.min() >= 49.9
    assert filled.max() <= 60.1


def test_a_hole_at_the_border_continues_level():
    picture = np.repeat(Y[:, :, None], 3, 2)
    hole = (X < 30) & (np.abs(Y - 45) < 25)
    assert (
        np.abs(
            harmonic_fill(np.where(hole[:, :, None], 0, picture), hole, 1e-3) - picture
        ).max()
        < 0.05
    )


def test_nothing_known_or_nothing_missing():
    picture = np.ones((9, 9, 1), np.float32)
    for hole in (np.zeros((9, 9), bool), np.ones((9, 9), bool)):
        assert np.array_equal(harmonic_fill(picture, hole), picture)


def test_seamless_is_the_continuation_of_the_photo():
    photo = np.stack([60 + X, 200 - X, 90 + Y], -1).astype(np.uint8)
    hole = blob("disc")
    torn = np.where(hole[:, :, None], 0, photo).astype(np.uint8)
    flat = (photo.astype(int) - 37 + (X / 10)[:, :, None].astype(int)).astype(
        np.uint8
    )  # another's exposure
    mended = seamless(flat, torn, hole)
    assert np.abs(mended.astype(int) - photo)[~hole].max() <= 1
    assert np.abs(mended.astype(int) - photo)[hole].max() <= 2


def wood() -> np.ndarray:
    random = np.random.default_rng(4)
    grain = 12 * np.sin(Y / 3 + np.sin(X / 40)) + random.normal(0, 4, Y.shape)
    return np.clip(np.stack([150 + grain, 110 + grain, 70 + grain], -1), 0, 255).astype(
        np.uint8
    )


def test_fill_has_the_colour_and_the_grain_of_what_is_around():
    rgb, hole = wood(), blob("disc")
    filled = fill()(
        np.where(hole[:, :, None], (255, 0, 0), rgb).astype(np.uint8), hole
    ).astype(float)
    inside, outside = filled[hole], rgb[~hole].astype(float)
    assert np.abs(inside.mean(0) - outside.mean(0)).max() < 6
    assert 0.7 < inside.std() / rgb[hole].std() < 1.3
    lines = np.corrcoef(filled[hole][:, 0], 12 * np.sin(Y / 3 + np.sin(X / 40))[hole])[
        0, 1
    ]
    assert lines > 0.5  # the grain goes on through the hole


def test_fill_learns_nothing_from_an_object_s_blurred_rim():
    rgb = np.full((H, W, 3), 120, np.uint8)
    hole = blob("disc")
    rim = (np.hypot(X - 60, Y - 45) < 26.5) & ~hole
    rgb[rim] = (220, 60, 60)
    rgb[hole] = (255, 0, 0)
    filled = fill_behind(rgb, hole, fill())
    assert np.abs(filled[hole | rim].astype(int) - 120).max() <= 2


@pytest.mark.slow
def test_fill_continues_a_disc_s_border():
    """As an arc, or as its chord, 4 px inside at most."""
    y, x = np.mgrid[:240, :240].astype(np.float32)
    part = np.clip(90.5 - np.hypot(x - 110, y - 125), 0, 1)[:, :, None]
    whole = (part * (170, 60, 70) + (1 - part) * (200, 215, 220)).astype(np.uint8)
    for angle in (0.3, 2.2, 4.0):
        hole = np.hypot(x - 110 - 90 * np.cos(angle), y - 125 - 90 * np.sin(angle)) < 26
        filled = fill()(
            np.where(hole[:, :, None], (40, 40, 45), whole).astype(np.uint8), hole
        )
        assert np.abs(filled.astype(int) - whole)[hole].mean() < 10


def test_fill_ends_a_border_at_the_one_in_front_of_it():
    y, x = np.mgrid[:200, :240].astype(np.float32)
    wall = np.where((x < 120)[:, :, None], (160, 175, 165), (70, 60, 55))
    whole = np.where((y > 120)[:, :, None], (205, 160, 105), wall).astype(np.uint8)
    hole = (np.abs(x - 122) < 34) & (y > 60) & (y < 160)
    filled = fill()(np.where(hole[:, :, None], 255, whole).astype(np.uint8), hole)
    assert np.abs(filled.astype(int) - whole)[hole].mean() < 5


def test_fill_brings_no_wall_into_a_narrow_panel():
    """At coarse scales hardly a patch of the panel is known as a whole: white blobs came where balls had stood."""
    y, x = np.mgrid[:200, :260]
    whole = np.full((200, 260, 3), 245, np.uint8)
    whole[70:130, 20:240] = 35
    hole = np.any(
        [np.hypot(x - middle, y - 104) <= 12.6 for middle in range(42, 240, 25)], axis=0
    )
    filled = fill()(np.where(hole[:, :, None], np.uint8(140), whole), hole)
    assert np.abs(filled.astype(int) - whole)[hole].mean() < 4


def test_fill_keeps_a_ramp_smooth():
    ramp = np.stack([60 + X, 200 - X, 90 + Y], -1).astype(np.uint8)
    hole = blob("disc")
    filled = fill()(np.where(hole[:, :, None], 0, ramp).astype(np.uint8), hole)
    assert np.abs(filled.astype(int) - ramp)[hole].max() < 12
    assert np.abs(np.diff(filled.astype(int), axis=1))[hole[:, 1:]].max() <= 6


@pytest.mark.parametrize(
    "where",
    [X < 20, (X > 100) & (Y > 60), np.abs(Y - 45) < 40, X + Y > 0, (X > 3) & (Y > 3)],
)
def test_fill_takes_any_hole(where: np.ndarray):
    rgb = wood()
    filled = fill()(rgb, where)
    assert filled.shape == rgb.shape
    assert np.array_equal(filled[~where], rgb[~where])
    assert np.array_equal(fill()(rgb, where & False), rgb)


@pytest.mark.slow
@pytest.mark.parametrize(("height", "width"), [(20, 3000), (90, 1600), (1600, 90)])
def test_long_photos_take_little_memory(height: int, width: int) -> None:
    """A ramp with a stripe along it and grain: the fill is like what was there."""
    y, x = np.mgrid[:height, :width]
    along, across, long = (x, y, height) if width > height else (y, x, width)
    grain = np.random.default_rng(0).normal(0, 3, (height, width, 1))
    truth = (
        80
        + 60 * along[..., None] / max(height, width)
        + 40 * (across < long // 3)[..., None] * [1, 0.5, 0]
    )
    photo = np.clip(truth + grain, 0, 255).astype(np.uint8)
    hole = (abs(along - 700) < 40) & (across > long // 4) & (across < 3 * long // 4)
    photo[hole] = 0
    inpaint = fill()
    tracemalloc.start()
    filled = inpaint(photo, hole)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 300 * 2**20
    assert np.array_equal(filled[~hole], photo[~hole])
    assert abs(filled[hole] - truth[hole]).mean() < 12


def test_grain_is_no_pattern_of_one_place():
    random = np.random.default_rng(0)
    y, x = np.mgrid[:200, :240]
    photo = np.repeat(
        np.clip(150 + random.normal(0, 6, (200, 240, 1)), 0, 255), 3, 2
    ).astype(np.uint8)
    hole = np.hypot(x - 120, y - 100) <= 50
    filled = fill()(photo, hole)[80:120, 100:140, 0].astype(float) - 150
    assert 4 < filled.std() < 8
    for down, right in (
        (0, 2),
        (2, 0),
        (2, 2),
        (0, 4),
        (4, 0),
    ):  # noise knows nothing of its neighbours
        alike = (
            filled[down:, right:] * filled[: 40 - down, : 40 - right]
        ).mean() / filled.var()
        assert abs(alike) < 0.15, (down, right)


def test_streaks_of_a_cloth_go_on_where_a_large_object_lay():
    """They are wider than fine grain, and too faint for patches to carry on."""
    noise = cv2.GaussianBlur(
        np.random.default_rng(1).normal(0, 1, (240, 400)), (0, 0), sigmaX=4, sigmaY=2
    )
    photo = (
        np.repeat((90 + 1.5 * noise / noise.std())[..., None], 3, 2)
        .round()
        .astype(np.uint8)
    )
    y, x = np.mgrid[:240, :400]
    hole = np.hypot(x - 120, y - 120) <= 50
    inside = fill()(photo, hole)[np.hypot(x - 120, y - 120) <= 40]
    assert 0.7 < inside.std() / photo.std() < 1.2


@pytest.mark.parametrize("dark", [True, False])
def test_behind_balls_on_a_shelf_is_what_is_above_them(dark: bool):
    """A wall above a black shelf, or the inside of one whose sides are behind the outer balls."""
    random = np.random.default_rng(0)
    y, x = np.mgrid[:200, :320]
    foot = 130 if dark else 100
    photo = np.full((200, 320, 3), 240.0)
    photo[40 : 130 if dark else 150, 40:280] = 25
    if not dark:
        photo[:100] = 240
    photo[foot : foot + 4, 30:290] = 15
    photo = np.clip(photo + random.normal(0, 2, photo.shape), 0, 255).astype(np.uint8)
    hole = np.zeros((200, 320), bool)
    for centre in range(42, 282, 40):
        hole |= np.hypot(x - centre, y - foot + 19.5) <= 20.5
    behind = fill()(photo, hole)[hole & (y < foot - 8) & (x > 70) & (x < 250)].mean()
    assert behind < 45 if dark else behind > 230


def test_the_thin_edge_of_a_shelf_goes_on_below_what_stood_on_it() -> None:
    """Three rows of black on white, which balls cover here and there; a ramp of grey below them is no line."""
    grain = np.random.default_rng(2).normal(0, 2, (120, 200, 1))
    picture = np.clip(235 + grain + np.zeros((120, 200, 3)), 0, 255)
    picture[70:73] = 25
    picture[90:110] -= 4 * np.arange(20)[:, None, None]
    picture = picture.astype(np.uint8)
    y, x = np.mgrid[:120, :200]
    hole = np.min([np.hypot(x - c, y - 50) for c in (45, 81, 119, 155)], axis=0) < 24
    found = fill()(np.where(hole[..., None], np.uint8([200, 40, 30]), picture), hole)
    assert np.abs(found[71, 20:180].astype(int) - 25).max() < 40
    assert np.abs(found[:66].astype(int) - picture[:66]).mean() < 3
    assert np.array_equal(found[80:], picture[80:])


def test_what_stands_in_the_hole_changes_nothing() -> None:
    """Neither its colours nor its edges."""
    random, hole = np.random.default_rng(0), blob("disc")
    rough = random.integers(0, 256, (H, W, 3), np.uint8)
    photos = [np.where(hole[..., None], inside, wood()) for inside in (rough, wood())]
    assert np.array_equal(*(fill()(photo, hole) for photo in photos))


def test_comparisons_are_whole_numbers_that_single_precision_holds() -> None:
    """On white and black, whose squares are the largest; the order of sums beyond 2^24 would change the fill."""
    photo = np.where(
        (X // 8 + Y // 8)[..., None] % 2 < 1, 255, np.zeros((H, W, 3))
    ).astype(np.float32)
    level = Level(photo, blob("disc"), blob("disc") & False)
    search = _Search(level, RADIUS)
    known = search._patches(search.half_levels)
    target = known[search.at[:, 0], search.at[:, 1]]
    weighted = np.abs(target) * search.mask[..., None]
    largest = (weighted * 64 * 2).sum((1, 2, 3)) + (search.mask * 64**2 * 3).sum((1, 2))
    assert largest.max() < 2**24


def leaves() -> np.ndarray:
    """Foliage: blobs of two greens, far from smooth."""
    noise = np.random.default_rng(5).normal(0, 1, (220, 320))
    coarse = cv2.GaussianBlur(noise, (0, 0), 2.0)
    light = 110 + 45 * coarse / coarse.std()
    return np.clip(np.stack([0.7 * light, light, 0.4 * light], -1), 0, 255).astype(
        np.uint8
    )


def test_fill_of_foliage_is_as_rough_as_foliage():
    photo = leaves()
    y, x = np.mgrid[:220, :320]
    hole = np.hypot(x - 160, y - 110) < 45
    filled = fill()(photo, hole)
    inside = np.hypot(x - 160, y - 110) < 38

    def roughness(picture: np.ndarray) -> float:
        grey = picture.astype(np.float32).mean(axis=2)
        return float((grey - cv2.GaussianBlur(grey, (0, 0), 3))[inside].std())

    assert 0.85 < roughness(filled) / roughness(photo) < 1.15
    assert np.array_equal(filled[~hole], photo[~hole])


def test_copies_keep_to_the_depth_they_are_at():
    """A blurred wall above woven cloth: neither is copied into the other."""
    noise = np.random.default_rng(6).normal(0, 1, (220, 320))
    soft, fine = cv2.GaussianBlur(noise, (0, 0), 9), cv2.GaussianBlur(noise, (0, 0), 1)
    y, x = np.mgrid[:220, :320]
    grey = np.where(y < 110, 150 + 9 * soft / soft.std(), 130 + 25 * fine / fine.std())
    photo = np.repeat(np.clip(grey, 0, 255)[..., None], 3, axis=2).astype(np.uint8)
    hole = (np.abs(x - 160) < 35) & (np.abs(y - 110) < 60)
    filled = fill()(photo, hole).astype(np.float32).mean(axis=2)
    detail = filled - cv2.GaussianBlur(filled, (0, 0), 3)
    core = np.abs(x - 160) < 30
    wall = detail[core & (y > 58) & (y < 100)].std()
    cloth = detail[core & (y > 120) & (y < 162)].std()
    true = detail[(np.abs(x - 160) > 60) & (y > 120)].std()
    assert wall < 0.3 * true
    assert 0.8 < cloth / true < 1.2


@pytest.mark.slow
@pytest.mark.parametrize("axes", [(90, 90), (110, 60)])
def test_a_painted_ring_stays_a_ring(axes: tuple[int, int]):
    y, x = np.mgrid[:240, :320]
    radius = np.hypot((x - 160) / axes[0], (y - 120) / axes[1])
    ring = np.abs(radius - 1) * min(axes) < 4
    grain = np.random.default_rng(0).normal(0, 1.5, (240, 320, 1))
    colours = np.where(ring[..., None], [180, 40, 50], [215, 225, 235]) + grain
    photo = cv2.GaussianBlur(np.clip(colours, 0, 255).astype(np.uint8), (0, 0), 0.8)
    hole = (x > 150) & (y < 118) & (y > 20) & (x < 285)
    if axes == (90, 90):
        hole = np.hypot(x - 160, y - 30) < 48
    filled = fill()(np.where(hole[..., None], np.uint8([20, 90, 30]), photo), hole)
    line = np.abs(radius - 1) * min(axes) < 1.5
    assert np.abs(filled[hole & line].astype(int) - [180, 40, 50]).mean() < 45
    beside = hole & (np.abs(radius - 1) * min(axes) > 12)
    assert np.abs(filled[beside].astype(int) - photo[beside]).mean() < 8


def test_contact_shadow_between_wheels_is_filled():
    """A car on a road: two wheels, a body above, and a dark strip under it."""
    y, x = np.mgrid[:200, :320]
    grain = np.random.default_rng(0).normal(0, 3, (200, 320, 1))
    photo = np.where((y > 80)[..., None], [120, 120, 125], [150, 170, 190]) + grain
    car = (np.abs(x - 160) < 80) & (y > 80) & (y < 132)
    for centre in (105, 215):
        car |= np.hypot(x - centre, y - 140) < 22
    strip = (np.abs(x - 160) < 60) & (y >= 130) & (y < 160) & ~car
    photo[strip] = 12
    photo[car] = [200, 90, 20]
    photo = np.clip(photo, 0, 255).astype(np.uint8)
    filled = fill_behind(photo, car, fill())
    assert filled[strip].min(axis=1).mean() > 100
    found = contact_strips(photo, car)
    road = (y > 80) & ~car & ~strip
    assert found[strip].mean() > 0.75
    assert found[road].mean() < 0.02


def test_line_that_ends_at_border_is_seam() -> None:
    """A fill without the photo's line has a larger step across the hole's border."""
    rng = np.random.default_rng(2)
    picture = rng.normal(130, 6, (H, W, 3)).astype(np.float32)
    broken = picture.copy()
    picture[40:46] -= 90
    hole = np.hypot(X - 65, Y - 45) < 25
    broken = np.where(hole[..., None], broken, picture)
    window = _Window(picture, picture, hole, hole)
    assert window.seam_growth(broken) > 0.3
    assert window.seam_growth(picture) == 0
    assert _Window(picture, broken, hole, hole).seam_growth(picture) < -0.3


def test_edge_of_a_large_photo_continues_in_place() -> None:
    """Edges of photos over 1,600 px are continued on a smaller photo."""
    photo = np.full((240, 1760, 3), (200, 190, 180), np.uint8)
    photo[120:] = (60, 70, 80)
    hole = np.zeros((240, 1760), bool)
    hole[60:180, 800:900] = True
    covered = np.where(hole[..., None], np.uint8(255), photo)
    filled = fill()(covered, hole)
    wrong = np.abs(filled.astype(int) - photo).max(axis=2) > 40
    rows = np.flatnonzero(wrong.any(axis=1))
    assert np.abs(rows - 119.5).max(initial=0.0) <= 2


@pytest.mark.parametrize("length", [4, 40])
def test_line_goes_on_beyond_its_ends(length: int) -> None:
    """Grains of a carpet are some px long."""
    row = np.full((130, 3), 200, np.float32)
    row[50 - length : 80 + length] = 20
    row[50:80] = np.nan
    ends = np.full((2, 4, 3), 20, np.float32)
    assert _goes_on(row, (50, 80), ends, 180) is (length > 12)


def test_a_bright_speck_is_not_copied_as_a_grid_of_dots() -> None:
    random = np.random.default_rng(0)
    photo = (120 + random.normal(0, 1, (64, 64, 3))).astype(np.float32)
    photo[10, 10] = 250
    small = cv2.resize(photo, (32, 32), interpolation=cv2.INTER_AREA)
    hole = np.zeros((64, 64), bool)
    hole[32:56, 8:56] = True
    places = np.stack(np.indices((32, 32)), axis=2)
    places[16:28] -= (14, 0)
    places[18::4, 6::4] = 5
    pixels = np.stack(np.nonzero(hole))
    steps = np.full((2, 1), 2.0)
    detail = _copy_detail((photo, small), hole, places, pixels, steps)
    assert np.abs(detail).max() < 20
    assert detail.std() > 0.5
