"""Balls that turn in space, and shadows that move: closed forms, and pictures made another way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.compile.world import Body
from physgen.geometry.polygon import Disc, Pose
from physgen.geometry.shadows import (
    ShadowSetting,
    Silhouette,
    shadow_darkness,
    shadows_on_sides,
)
from physgen.photometry import DistantLight, decode, encode_u8
from physgen.render import reliefs
from physgen.render.atlas import BallSprites
from physgen.render.ball import ball_from_photo
from physgen.render.ball_light import in_one_light
from physgen.render.shadow_decomposition import decompose_shadows, predicted_shadow
from physgen.render.sprites import Sides, Sprite, cut_sprites, lambert, relief_of
from physgen.render.stage import Placement, draw_border, draw_sprite, place_sprite
from physgen.scene.scene import Solid, View
from physgen.simulate.engine import simulate

SUN = DistantLight((-0.36, -0.48, 0.8), 0.7, 0.35)


def hues(m):
    """(..., 3) a colour for every direction: smooth, and different everywhere."""
    return np.stack(
        [
            0.45 + 0.3 * np.sin(3 * m[..., k] + k) * np.cos(2 * m[..., (k + 1) % 3])
            for k in range(3)
        ],
        -1,
    )


def sphere(r, center, size, turn):
    """(H, W, 3) linear light of a painted sphere, and (H, W) its normals' z, by hand."""
    y, x = np.mgrid[: size[1], : size[0]]
    u, v = (x - center[0]) / r, (y - center[1]) / r
    z2 = 1 - u * u - v * v
    z = np.sqrt(np.maximum(z2, 0))
    body = np.stack([u, v, -z], -1) @ turn  # turn.T applied to each point
    facing = np.maximum(np.stack([u, v, z], -1) @ np.array(SUN.direction), 0)
    light = hues(body) * (SUN.ambient + SUN.intensity * facing)[..., None]
    return (
        np.where((z2 > 0)[..., None], light, 0).astype(np.float32),
        np.where(z2 > 0, z, 0),
        body[..., 2],
    )


def turned(ball, center, turn, size, at):
    """(h, w, 3) a ball without its gloss that covers all of its box, at `center` in a box of `size` from `at` on."""
    bare = replace(ball, gloss=np.zeros_like(ball.skin))
    sprite = Sprite(
        0,
        ball.corner,
        np.zeros_like(ball.skin),
        np.ones(ball.skin.shape[:2], np.float32),
        ball=bare,
    )
    box = np.s_[at[1] : at[1] + size[1], at[0] : at[0] + size[0]]
    shift = center[0] - ball.center[0], center[1] - ball.center[1]
    [found] = (
        BallSprites([sprite])
        .draw([(0, Placement(box, space=turn, shift=shift))])
        .values()
    )
    return found[0]


@pytest.mark.parametrize(
    "vector", [(0.0, 0.0, 0.7), (0.5, 0.0, 0.0), (-0.3, 0.6, 0.2), (0.7, -0.5, 0.4)]
)
def test_a_ball_turned_in_space_shows_what_it_should(vector) -> None:
    r, size = 40.0, (101, 101)
    photo, _, _ = sphere(r, (50, 50), size, np.eye(3))
    ball = ball_from_photo(photo, (0, 0), (50.0, 50.0), r, SUN, View.SIDE)
    turn = cv2.Rodrigues(np.array(vector))[0]
    expected, z, was = sphere(r, (50, 50), size, turn)
    found = turned(ball, (50.0, 50.0), turn, size, (0, 0)) + ball.gloss
    known = (z > 0.4) & (was < -0.4)  # seen now, and seen in the photo
    assert known.sum() > 300
    off = np.abs(encode_u8(found).astype(int) - encode_u8(expected))[known]
    assert off.mean() < 1.5
    assert np.percentile(off, 99) < 8


def test_a_ball_at_rest_is_the_photo() -> None:
    photo, z, _ = sphere(30.0, (40, 40), (81, 81), np.eye(3))
    ball = ball_from_photo(photo, (0, 0), (40.0, 40.0), 30.0, SUN, View.SIDE)
    found = turned(ball, (40.0, 40.0), np.eye(3), (81, 81), (0, 0)) + ball.gloss
    off = np.abs(encode_u8(found).astype(int) - encode_u8(photo))
    assert off[z > 0.55].max() <= 2
    assert off[z > 0.2].mean() < 2, "at the rim the model's light is evened out"


def test_a_highlight_stays_where_the_light_is() -> None:
    r, center = 40.0, (50, 50)
    photo, _, _ = sphere(r, center, (101, 101), np.eye(3))
    half = np.array(SUN.direction) + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    y, x = np.mgrid[:101, :101]
    spot = np.exp(
        -((x - 50 - r * half[0]) ** 2 + (y - 50 - r * half[1]) ** 2) / (2 * 3.0**2)
    )
    photo = np.minimum(photo * 0.4 + spot[..., None] * 2, 1).astype(np.float32)
    ball = ball_from_photo(photo, (0, 0), (50.0, 50.0), r, SUN, View.SIDE)
    spun = turned(
        ball,
        (50.0, 50.0),
        cv2.Rodrigues(np.array([0.0, 0.0, 2.5]))[0],
        (101, 101),
        (0, 0),
    )
    bright = (spun + ball.gloss).min(-1)
    assert (
        np.hypot(
            *(np.unravel_index(bright.argmax(), bright.shape) - half[1::-1] * r - 50)
        )
        < 4
    )
    assert spun.min(-1).max() < 0.5, "none of it turned with the skin"


def test_a_disc_with_a_number_near_the_highlight_turns() -> None:
    """The strokes of the number leave no place in the disc that is as wide as a highlight."""
    r, size = 40.0, (101, 101)
    y, x = np.mgrid[:101, :101]
    u, v = (x - 50) / r, (y - 50) / r
    z = np.sqrt(np.maximum(1 - u * u - v * v, 0))

    def ball_turned(angle):
        across, down = (
            np.cos(angle) * u + np.sin(angle) * v,
            np.cos(angle) * v - np.sin(angle) * u,
        )
        disc = np.hypot(u, v) < 0.36
        number = (
            disc
            & ((np.abs(np.abs(across) - 0.12) < 0.04) | (np.abs(down) < 0.04))
            & (np.hypot(u, v) < 0.3)
        )
        paint = np.where(disc[..., None], [0.93, 0.93, 0.9], [0.1, 0.02, 0.2])
        paint[number] = 0.01
        return (paint * (0.5 + 0.5 * z[..., None])).astype(np.float32)

    light = replace(SUN, direction=(0.0, -0.2, 0.98))
    ball = ball_from_photo(ball_turned(0.0), (0, 0), (50.0, 50.0), r, light, View.SIDE)
    turn = cv2.Rodrigues(np.array([0.0, 0.0, 0.9]))[0]
    found, expected = (
        turned(ball, (50.0, 50.0), turn, size, (0, 0)) + ball.gloss,
        ball_turned(0.9),
    )
    assert np.abs(found - expected)[z > 0.6].mean() < 0.03


def test_light_that_nobody_told_of_does_not_turn_with_a_painted_ball() -> None:
    """Two paints in stripes; a floor below lends light and colour that Lambert's law with one light has not."""
    r, size = 40.0, (101, 101)
    y, x = np.mgrid[:101, :101]
    u, v = (x - 50) / r, (y - 50) / r
    z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
    lambertian = SUN.ambient + SUN.intensity * np.maximum(
        np.stack([u, v, z], -1) @ np.array(SUN.direction), 0
    )
    more = np.exp(-0.35 * v + 0.2 * u)[..., None] * np.exp(
        0.15 * v[..., None] * np.array([1, 0, -1])
    )

    def ball_turned(angle):
        across = (np.cos(angle) * u + np.sin(angle) * v) * 5
        paint = np.where(
            (np.sin(across) > 0)[..., None], [0.7, 0.12, 0.08], [0.62, 0.55, 0.36]
        )
        return (paint * lambertian[..., None] * more).astype(np.float32)

    ball = ball_from_photo(ball_turned(0.0), (0, 0), (50.0, 50.0), r, SUN, View.SIDE)
    turn = cv2.Rodrigues(np.array([0.0, 0.0, 2.0]))[0]
    found, expected = turned(ball, (50.0, 50.0), turn, size, (0, 0)), ball_turned(2.0)
    inside = z > 0.4
    off = np.abs(encode_u8(found).astype(int) - encode_u8(expected))[inside]
    assert np.median(off) <= 3, "Lambert's law alone leaves 10"
    plain = np.abs(
        encode_u8(
            ball_turned(0.0) * 0
            + found / np.maximum(ball.shade(u, v, z), 1e-6) * lambertian[..., None]
        ).astype(int)
        - encode_u8(expected)
    )[inside]
    assert np.median(off) < 0.4 * np.median(plain)


@pytest.mark.parametrize("turn", [0.5, 2.0, -1.2])
def test_normals_turn_with_a_thing_and_its_light_does_not(turn) -> None:
    y, x = np.mgrid[-20:21, -20:21] / 22.0
    known = x * x + y * y < 0.8
    normals = np.stack([x, y, np.sqrt(np.maximum(1 - x * x - y * y, 0.01))], -1).astype(
        np.float32
    )
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    found = relief_of(normals, known, SUN)
    c, s = np.cos(turn), np.sin(turn)
    turned = normals.copy()
    turned[..., 0], turned[..., 1] = c * x - s * y, s * x + c * y
    turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
    expected = lambert(SUN, turned) / lambert(SUN, normals)
    assert found.ratio(turn)[known] == pytest.approx(expected[known], rel=1e-3)
    assert found.ratio(0.0)[known] == pytest.approx(1.0, abs=1e-6)


def setting(light=SUN, softness=1.0, top=True, **rest):
    return ShadowSetting(
        light,
        softness,
        top,
        rest.get("tilt", 0.1),
        rest.get("backdrop", np.inf),
        (300, 300),
    )


def disc(x, y, r):
    yy, xx = np.mgrid[:300, :300]
    cover = np.clip(r + 0.5 - np.hypot(xx - x, yy - y), 0, 1).astype(np.float32)
    return cover


def ball_at(x, y, r, floor=None):
    return Silhouette(disc(x, y, r), (0, 0), (x, y), r, 2 * r, floor)


def test_a_ball_on_a_table_hides_the_sky_by_its_solid_angle() -> None:
    """Cosine-weighted, (1 + (d/r)^2)^(-3/2) for a ball that touches the table at distance 0."""
    (x0, y0, _, _), dark = shadow_darkness(
        ball_at(150, 150, 20.0), setting(DistantLight((0, 0, 1), 0.0, 1.0))
    )
    for d in (5, 10, 15):
        left = np.exp(-dark[150 - y0, 150 + d - x0])
        assert left == pytest.approx(1 - 0.98 * (1 + (d / 20) ** 2) ** -1.5, abs=0.02)


def test_a_ball_on_a_table_throws_its_ellipse() -> None:
    r, (lx, ly, lz) = 20.0, SUN.direction
    bare = DistantLight(SUN.direction, 1.0, 0.0)
    (x0, y0, x1, y1), dark = shadow_darkness(ball_at(150, 150, r), setting(bare, 0.1))
    shade = 1 - np.exp(-dark)
    y, x = np.mgrid[y0:y1, x0:x1]
    middle = np.array([(shade * x).sum(), (shade * y).sum()]) / shade.sum()
    assert middle == pytest.approx([150 - r * lx / lz, 150 - r * ly / lz], abs=0.5)
    assert (shade / 0.98).sum() == pytest.approx(np.pi * r * r / lz, rel=0.05)


def seen(
    what: Silhouette, place: ShadowSetting
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns, rows and how much of the direct light is taken away there."""
    (x0, y0, x1, y1), dark = shadow_darkness(what, place)
    y, x = np.mgrid[y0:y1, x0:x1]
    return x, y, (1 - np.exp(-dark)) / 0.98


@pytest.mark.parametrize(
    ("ball", "area"), [(True, np.pi * 20**2 / SUN.direction[2]), (False, np.pi * 20**2)]
)
def test_a_wall_behind_takes_the_silhouette_moved_along_the_light(ball, area) -> None:
    """A ball's is an ellipse; that of a flat thing keeps its shape."""
    lx, ly, lz = SUN.direction
    bare = DistantLight(SUN.direction, 1.0, 0.0)
    what = (
        ball_at(100, 100, 20.0)
        if ball
        else Silhouette(disc(100, 100, 20.0), (0, 0), (100, 100), None, 0, None)
    )
    x, y, shade = seen(what, setting(bare, 0.1, top=False, backdrop=60.0))
    middle = np.array([(shade * x).sum(), (shade * y).sum()]) / shade.sum()
    assert middle == pytest.approx(
        [100 - 60 * lx / lz, 100 - 60 * (ly / lz + 0.1)], abs=0.5
    )
    assert shade.sum() == pytest.approx(area, rel=0.03)


LOW = DistantLight((-0.6, -0.64, 0.48), 1.0, 0.0)


def test_a_ball_in_the_air_throws_its_ellipse_on_the_floor() -> None:
    """Of the area pi r² / sine of the light's height, seen under the floor's slope; along the light below it."""
    r, height, tilt = 20.0, 60.0, 0.25
    x, y, shade = seen(
        ball_at(100, 200 - height, r, floor=200.0),
        setting(LOW, 0.1, top=False, tilt=tilt),
    )
    lx, ly, lz = LOW.direction
    middle = np.array([(shade * x).sum(), (shade * y).sum()]) / shade.sum()
    assert middle == pytest.approx(
        [100 + height * lx / ly, 200 + tilt * height * lz / ly], abs=0.5
    )
    assert shade.sum() == pytest.approx(np.pi * r * r / -ly * tilt, rel=0.05)


@pytest.mark.parametrize("softness", [0.1, 6.0])
def test_a_block_throws_a_shadow_as_long_as_the_light_is_low(softness) -> None:
    """Its foot's area, drawn out over its height: w t + h |lz| w / |ly| + h |lx| t / |ly|; dark within, soft or not."""
    w, h, t, tilt = 60.0, 80.0, 40.0, 0.25
    cover = np.zeros((300, 300), np.float32)
    cover[120:200, 60:120] = 1
    what = Silhouette(cover, (0, 0), (89.5, 159.5), None, t, 199.5)
    lx, ly, lz = (abs(c) for c in LOW.direction)
    x, y, shade = seen(what, setting(LOW, softness, top=False, tilt=tilt))
    assert shade.sum() == pytest.approx(
        (w * t + h * lz / ly * w + h * lx / ly * t) * tilt, rel=0.06
    )
    row = (
        199.5 - tilt * t / 2
    )  # where it stands; its near edge is what one sees of its foot
    for height in (10, 30, 50):
        spot = (
            np.hypot(x - (90 + height * lx / ly), y - (row - tilt * height * lz / ly))
            < 1.5
        )
        assert shade[spot].min() > 0.9, "thrown by the middle of the block"
    assert shade[(y > row + tilt * t / 2 + 3) | (x < 50)].max() < 0.1


def test_a_floor_ends_at_a_line_that_runs_towards_the_middle_of_the_picture() -> None:
    """As the foot of a wall beside it does, farther back: no shadow of the floor is painted on the wall."""
    what = replace(ball_at(165, 180, 20.0, floor=250.0), ends=(-np.inf, 240.0))
    x, y, shade = seen(what, setting(LOW, 0.1, top=False, tilt=0.1))
    foot = 150 + 90 * (y - 150) / 100
    assert shade[x > foot + 2].max() == 0
    assert shade[x < foot - 2].max() > 0.9


@pytest.mark.parametrize(
    ("ball", "area"), [(True, np.pi * 20**2 / 0.6), (False, np.pi * 20**2 * 0.8)]
)
def test_a_wall_beside_takes_the_shadow_where_the_light_meets_it(ball, area) -> None:
    """60 px to the right, 64 down and 48 back, where the picture of all is smaller by 1000 / 1048."""
    what = ball_at(180, 120, 20.0, floor=250.0)
    what = replace(
        what, ends=(-np.inf, 240.0), walls=(False, True), radius=20.0 if ball else None
    )
    [((x0, y0, x1, y1), dark)] = shadows_on_sides(
        what, setting(LOW, 0.1, top=False, tilt=0.1)
    )
    (y, x), shade = np.mgrid[y0:y1, x0:x1], (1 - np.exp(-dark)) / 0.98
    middle = [(part * shade).sum() / shade.sum() for part in (x, y)]
    assert middle == pytest.approx(
        [150 + 90 / 1.048, 150 + (120 + 64 - 150) / 1.048], abs=1.0
    )
    assert shade.sum() == pytest.approx(area * 90 / 1000 / 1.048**3, rel=0.1)
    assert not list(
        shadows_on_sides(
            replace(what, walls=(False, False)), setting(LOW, 0.1, top=False)
        )
    )


@pytest.mark.parametrize("depth", [0.5, 1.2])
def test_shadows_are_as_deep_as_those_of_the_photo(depth: float) -> None:
    """The light keeps its strength in the scene file; half of what a shadow lacks comes back from other surfaces, or
    the light was taken for too weak."""
    cover = np.zeros((300, 300), np.float32)
    cover[120:200, 60:120] = 1
    what = Silhouette(
        cover[120:200, 60:120], (60, 120), (89.5, 159.5), None, 40.0, 199.5
    )
    model = setting(DistantLight(LOW.direction, 1.0, 0.3), 3.0, top=False)
    (x0, y0, x1, y1), dark = shadow_darkness(what, model)
    light = np.full((300, 300, 3), 0.4, np.float32)
    light[y0:y1, x0:x1] *= np.maximum(1 - depth * (1 - np.exp(-dark)), 0.02)[..., None]
    clean = np.full((300, 300, 3), encode_u8(np.float32(0.4)), np.uint8)
    lit, _ = decompose_shadows(encode_u8(light), clean, cover, [what], [False], model)
    assert lit.setting.direct((0, -1, 0)) / model.direct((0, -1, 0)) == pytest.approx(
        depth + 0.05, abs=0.1
    )


def test_the_edge_of_a_balls_shadow_on_a_floor_has_no_steps() -> None:
    """Its upper border rises, and falls, by parts of pixels: of columns that follow on each other, few are alike."""
    found = predicted_shadow(
        ball_at(100, 175, 25.0, floor=200.0), setting(LOW, 0.3, top=False, tilt=0.13), 2
    )
    assert found is not None
    area = found[1].sum(axis=0)
    area = area[area > 0.2 * area.max()]
    assert np.abs(np.diff(area, 3)).max() < 0.05 * area.max()


def test_beneath_a_thing_that_leans_the_sky_is_hidden() -> None:
    """A plate of height 0 at one end and 60 px at the other, in ambient light alone: ever less dark."""
    cover = np.zeros((300, 300), np.float32)
    for k in range(120):
        cover[200 - k // 2 - 20 : 200 - k // 2, 60 + k] = 1
    what = Silhouette(cover, (0, 0), (120.0, 160.0), None, 60.0, 199.5)
    x, y, shade = seen(
        what, setting(DistantLight((0, -1, 0), 0.0, 1.0), top=False, tilt=0.1)
    )
    under = shade[(y == round(199.5 - 3))]
    columns = x[0]
    found = [float(under[columns == c][0]) for c in (64, 90, 120, 150, 175)]
    assert found[0] > 0.8
    assert found == sorted(found, reverse=True)


# ---- whole scenes ------------------------------------------------------------------------------------------------


@pytest.fixture
def table(tmp_path):
    """A grey disc on a grainy table, with a shadow of our own making, and its scene file."""
    rng = np.random.default_rng(3)
    grain = (0.3 + 0.02 * rng.standard_normal((200, 300, 1))).astype(np.float32) * [
        1.0,
        0.9,
        0.8,
    ]
    yy, xx = np.mgrid[:200, :300]
    shadow = cv2.GaussianBlur(
        np.clip(26.5 - np.hypot(xx - 92, yy - 112), 0, 1).astype(np.float32), (0, 0), 3
    )
    lit = grain * (1 - 0.5 * shadow[..., None])
    cover = np.clip(25.5 - np.hypot(xx - 80, yy - 100), 0, 1)
    photo = lit * (1 - cover[..., None]) + cover[..., None] * [0.5, 0.2, 0.2]
    assets = tmp_path / "photo.assets"
    assets.mkdir()
    pictures = {
        "photo.png": photo,
        "photo.assets/clean.png": grain,
        "photo.assets/background.png": lit,
    }
    for name, picture in pictures.items():
        cv2.imwrite(str(tmp_path / name), encode_u8(picture)[..., ::-1])
    cv2.imwrite(str(assets / "masks.png"), (cover >= 0.5).astype(np.uint8))
    cv2.imwrite(str(assets / "coverage.png"), np.rint(cover * 255).astype(np.uint8))
    (tmp_path / "scene.yaml").write_text("""\
physgen: 1
image: photo.png
assets: photo.assets
world: {view: top, duration: 1}
objects: {a: {mask: 1, shape: {circle: {center: [80, 100], radius: 25}}, velocity: [100, 0]}}
light: {direction: [-0.4, -0.4, 0.8]}
""")
    return tmp_path / "scene.yaml", shadow, grain


def frames(path, times, **edits):
    scene = pipeline.load(
        path, overrides=[f"{key}={value}" for key, value in edits.items()]
    )
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    return list(
        pipeline.render(
            pipeline.stage(scene, compiled, maps),
            simulate(compiled.world, np.array(times)),
        )
    )


def test_a_shadow_goes_with_its_object(table) -> None:
    path, shadow, grain = table
    first, last = frames(path, [0.0, 1.0])
    photo = cv2.imread(str(path.parent / "photo.png"))[..., ::-1]
    assert np.array_equal(first.rgb, photo)
    moved = np.roll(shadow, 100, axis=1)
    cover = np.roll(np.hypot(*np.mgrid[-100:100, -80:220]) < 29, 100, axis=1)
    expected = grain * (1 - 0.5 * moved[..., None])
    off = np.abs(decode(last.rgb) - expected).max(-1)
    assert off[~cover].max() < 0.05, (
        "light where the shadow was, shadow where the object is"
    )
    assert off[~cover].mean() < 0.004
    far = np.ones(shadow.shape, bool)
    far[50:190, 20:290] = False
    assert np.array_equal(last.rgb[far], photo[far])


SCENES = sorted(
    path.parent.name
    for path in (Path(__file__).parents[2] / "scenes").glob("*/scene.yaml")
)
QUICK = ("billiards", "dominoes")


@pytest.mark.parametrize(
    "name",
    [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in SCENES],
)
def test_the_first_frame_is_the_photo_however_it_is_lit(name) -> None:
    path = Path(__file__).parents[2] / "scenes" / name / "scene.yaml"
    maps = pipeline.percepts(pipeline.load(path))
    for shadows, relight in (("true", "true"), ("false", "true"), ("false", "false")):
        scene = pipeline.load(
            path, [f"render.shadows={shadows}", f"render.relight={relight}"]
        )
        compiled = pipeline.compile(scene, maps)
        still = simulate(compiled.world, np.array([0.0]))
        [frame] = pipeline.render(pipeline.stage(scene, compiled, maps), still)
        assert np.array_equal(frame.rgb, maps.rgb), (shadows, relight)


def test_what_is_left_out_takes_its_shadow_along() -> None:
    """The elephant of a shelf: where it stood and around, the picture comes close to the true empty shelf."""
    path = Path(__file__).parents[2] / "scenes" / "shelf" / "scene.yaml"
    scene = pipeline.load(path, variant="no-elephant")
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    still = simulate(compiled.world, np.array([0.0]))
    [frame] = pipeline.render(pipeline.stage(scene, compiled, maps), still)
    gone = (maps.labels > 0) & (compiled.labels == 0)
    near = cv2.dilate(gone.astype(np.uint8), np.ones((41, 41))) > 0
    near &= cv2.dilate((compiled.labels > 0).astype(np.uint8), np.ones((61, 61))) == 0
    dark = near & (
        np.abs(maps.clean.astype(int) - maps.background).max(-1) > 12
    )  # its shadow fell there
    assert dark.sum() > 300
    before, after = (
        np.abs(p.astype(int) - maps.clean)[dark].mean()
        for p in (maps.background, frame.rgb)
    )
    assert after < 0.45 * before


def test_what_a_neighbour_lends_a_painted_ball_does_not_turn_with_it() -> None:
    r = 20.0
    y, x = np.mgrid[:51, :51]
    u, v = (x - 25) / r, (y - 25) / r
    z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
    shade = SUN.ambient + SUN.intensity * np.maximum(
        np.stack([u, v, z], -1) @ np.array(SUN.direction), 0
    )
    photo = (
        np.where((v > 0.55)[..., None], [0.6, 0.5, 0.3], [0.05, 0.01, 0.06])
        * shade[..., None]
    )
    spot = np.hypot(x - 33, y - 25) < 4
    lent = (0.1 * spot)[..., None] * np.array([1.0, 0.8, 0.5])  # as of a white one
    photo = np.where((u * u + v * v < 1)[..., None], photo + lent, 0).astype(np.float32)
    ball = ball_from_photo(photo, (0, 0), (25.0, 25.0), r, SUN, View.TOP)
    inside = np.hypot(x - 33, y - 25) < 2.5
    assert (ball.skin * ball.shading)[inside].max() < 0.07
    assert np.abs(ball.gloss - lent)[inside].mean() < 0.06
    edge = np.abs(np.hypot(x - 33, y - 25) - 4)
    away = (
        (u * u + v * v < 0.5) & (np.abs(v - 0.55) > 0.11) & (edge > 1.5)
    )  # from borders
    assert np.abs(ball.skin * ball.shading + ball.gloss - photo)[away].max() < 0.04


@pytest.mark.parametrize("degrees", [0.001, 30, 90, 150, -60])
def test_a_block_seen_from_above_shows_its_upper_sides_above_its_front(
    degrees: float,
) -> None:
    """As if swept: width x depth of pixels more, all above the front, which turns about its own middle."""
    coverage = np.zeros((80, 80), np.float32)
    coverage[20:60, 34:46] = 1
    sides = Sides(19.5, 4.0, np.full(3, 0.5), SUN)
    sprite = Sprite(
        0,
        (0, 0),
        coverage[..., None].repeat(3, 2) * 0.3,
        coverage,
        face=5.0,
        sides=sides,
    )
    turn = np.radians(degrees)
    where = place_sprite(
        sprite, Pose(39.5, 34.5, 0.0), Pose(39.5, 34.5, turn), (80, 80), None
    )
    assert where is not None
    _, front = draw_sprite(sprite, where)
    rows, columns = np.indices(front.shape)
    middle = [(part * front).sum() / front.sum() for part in (columns, rows)]
    assert np.allclose(
        middle, [39.5 - where.box[1].start, 39.5 - where.box[0].start], atol=0.1
    )
    side, shade = sides.draw(front, turn)
    wide = 12 * abs(np.cos(turn)) + 40 * abs(np.sin(turn))
    assert side.sum() == pytest.approx(4 * wide * sides.share(turn), rel=0.06, abs=1)
    assert 0.7 <= shade.min() <= shade.max() < 1.6
    below = (rows > np.where(front > 0.5, rows, -1).max(axis=0)) & (front > 0.5).any(
        axis=0
    )
    assert not side[below & (front < 0.1)].any()


def test_the_far_side_of_a_ball_goes_on_with_its_stripe() -> None:
    """A striped ball is alike at antipodes: half a turn about any axis shows a stripe that the photo does not show."""
    r, size = 40.0, (101, 101)
    y, x = np.mgrid[:101, :101]
    u, v = (x - 50) / r, (y - 50) / r
    z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
    lambertian = (
        SUN.ambient
        + SUN.intensity * np.maximum(np.stack([u, v, z], -1) @ SUN.direction, 0)
    )[..., None]

    def ball_turned(turn):
        body = np.stack([u, v, -z], -1) @ turn
        stripe = np.abs(body @ np.array([0.5, 0.62, 0.6])) < 0.35
        return (
            np.where(stripe[..., None], [0.6, 0.1, 0.08], [0.62, 0.55, 0.4])
            * lambertian
        ).astype(np.float32)

    ball = ball_from_photo(
        ball_turned(np.eye(3)), (0, 0), (50.0, 50.0), r, SUN, View.TOP
    )
    for vector in ([0.0, np.pi, 0.0], [0.0, 1.5, 0.0]):
        turn = cv2.Rodrigues(np.array(vector))[0]
        found = turned(ball, (50.0, 50.0), turn, size, (0, 0)) + ball.gloss
        off = np.abs(encode_u8(found).astype(int) - encode_u8(ball_turned(turn))).max(
            -1
        )[z > 0.35]
        assert (off > 30).mean() < 0.035


def pool_ball(turn, number: float = 0.0, r: float = 20.0, band=(0.35, 0.02, 0.03)):
    """(51, 51, 3) light of a ball, (51, 51) how far it faces the viewer, and the normals: a band or none, and two discs
    with an L on each; `number` turns where they are."""
    y, x = np.mgrid[-1 / 3 : 50.5 : 1 / 3, -1 / 3 : 50.5 : 1 / 3]
    u, v = (x - 25) / r, (y - 25) / r
    z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
    normals = np.stack([u, v, z], -1)
    seat = cv2.Rodrigues(np.array([0.5, 0.4, 0.3 + number]))[0]
    body = np.stack([u, v, -z], -1) @ turn @ seat
    up, side = body[..., 1], body[..., 0] * np.sign(body[..., 2])
    disc = np.hypot(up, side) < 0.4
    ink = ((np.abs(side + 0.1) < 0.06) & (np.abs(up) < 0.24)) | (
        (np.abs(up - 0.18) < 0.06) & (np.abs(side) < 0.16)
    )
    coloured = (np.abs(up) < 0.56) & ~disc
    paint = np.where(coloured[..., None], band, [0.62, 0.55, 0.4])
    paint = np.where((ink & disc)[..., None], 0.015, paint)
    shade = SUN.ambient + SUN.intensity * np.maximum(
        normals @ np.array(SUN.direction), 0
    )
    light = np.where(
        (u * u + v * v < 1.1)[..., None], paint * shade[..., None], 0
    ).astype(np.float32)
    return (
        cv2.resize(light, (51, 51), interpolation=cv2.INTER_AREA),
        z[1::3, 1::3],
        normals[1::3, 1::3],
    )


def reflected(normals, at, wide: float, light):
    """Light of a lamp or a neighbour that a ball shows at a normal."""
    at = np.array(at) / np.linalg.norm(at)
    return (np.asarray(light) * (normals @ at > np.cos(wide))[..., None]).astype(
        np.float32
    )


@pytest.mark.parametrize("number", [0.0, 3.0, 5.0])
def test_the_far_side_of_a_pool_ball_has_a_smooth_band_and_a_number_that_reads(
    number: float,
) -> None:
    """Beside truth, from all around; neighbours lend the near side what has no place on the far one."""
    photo, _, normals = pool_ball(np.eye(3), number)
    lent = reflected(normals, (0.7, -0.6, 0.35), 0.2, [0.1, 0.08, 0.05])
    ball = ball_from_photo(photo + lent, (0, 0), (25.0, 25.0), 20.0, SUN, View.TOP)
    off = []
    for vector in (
        [0.0, np.pi, 0.0],
        [0.0, 1.6, 0.0],
        [1.6, 0.0, 0.0],
        [-1.0, 2.0, 0.0],
    ):
        turn = cv2.Rodrigues(np.array(vector))[0]
        found = turned(ball, (25.0, 25.0), turn, (51, 51), (0, 0))
        expected, z, _ = pool_ball(turn, number)
        off.append(
            np.abs(encode_u8(found).astype(int) - encode_u8(expected)).max(-1)[z > 0.35]
        )
    assert (np.concatenate(off) > 40).mean() < 0.025, "antipodes leave more"
    assert np.median(np.concatenate(off)) < 8


def test_lamps_stay_on_balls_and_neighbours_do_not() -> None:
    """Of three pairs, each ball reflects the other one and one lamp, which their discs hide in part."""
    balls, photos = [], []
    for k in range(6):
        photo, _, normals = pool_ball(np.eye(3), float(k))
        lamp = reflected(normals, (-0.25, -0.3, 0.9), 0.12, [1.0, 1.0, 1.0])
        angle = k // 2 + np.pi * (k % 2)
        way = np.array([np.cos(angle), np.sin(angle)])
        lent = reflected(normals, (*way, 0.6), 0.2, [0.12, 0.09, 0.05])
        photos.append(np.minimum(photo + lamp + lent, 1))
        x, y = np.array([500.0 * (k // 2), 0.0]) - 20 * way  # they touch
        balls.append(
            ball_from_photo(photos[-1], (0, 0), (25.0, 25.0), 20.0, SUN, View.TOP)
        )
        balls[-1] = replace(balls[-1], center=(x + 25, y + 25), corner=(x, y))
    for ball in in_one_light(balls):
        assert ball.gloss[lamp.max(-1) > 0].mean() > 0.45
        assert (
            ball.gloss[cv2.dilate(lamp.max(-1), np.ones((9, 9))) == 0].max() < 0.04
        ), "a third of the neighbours'"
    assert sum(ball.pattern is not None for ball in balls) >= 5


def test_black_balls_stay_black_and_rims_alike_in_the_light_of_a_rack() -> None:
    """Black is no shade of the white that all wear; most of it mirrors the table, which is no paint, and one ball's rim
    mirrors a neighbour."""
    balls = []
    bands = 3 * [(0.015, 0.013, 0.01)] + 4 * [(0.35, 0.02, 0.03)]
    for k, band in enumerate(bands):
        photo, _, normals = pool_ball(np.eye(3), float(k), band=band)
        seen = photo + reflected(normals, (0, -1, 0.3), 1.5, [0.03, 0.027, 0.02])
        if k == 0:
            seen += reflected(normals, (1, 0, 0.15), 0.4, [0.3, 0.3, 0.3])
        ball = ball_from_photo(seen, (0, 0), (25.0, 25.0), 20.0, SUN, View.TOP)
        balls.append(replace(ball, center=(500.0 * k + 25, 25.0), corner=(500 * k, 0)))
    shared = in_one_light(balls)
    painted = [ball for ball in shared if ball.pattern is not None]
    assert len(painted) >= 5
    black = [
        ball.pattern.colours.max(axis=1).min()
        for ball in shared[:3]
        if ball.pattern is not None
    ]
    assert len(black) == 2
    assert max(black) < 0.02
    assert np.ptp([ball.fade for ball in painted], axis=0).max() < 0.02


def test_a_rack_breaks_up_into_balls_that_mirror_the_table_and_wear_one_white() -> None:
    """Of seven that touch, each shows the table where its mirrored ray meets no other one, and is lit by red ones."""
    turns = np.radians(60 * np.arange(6))
    places = np.vstack([[[0, 0]], 40 * np.column_stack([np.cos(turns), np.sin(turns)])])
    balls = []
    for k, place in enumerate(places):
        photo, z, normals = pool_ball(np.eye(3), float(k))
        ray = 2 * z[..., None] * normals - np.array([0, 0, 1.0])
        table, lent = ray[..., 2] < 0, np.zeros_like(z)
        for other in np.delete(places, k, axis=0):
            way = np.append((other - place) / 20, 0)
            nearest = (
                way - normals - ((way - normals) * ray).sum(-1, keepdims=True) * ray
            )
            met = (np.linalg.norm(nearest, axis=-1) < 1) & (
                ((way - normals) * ray).sum(-1) > 0
            )
            table, lent = (
                table & ~met,
                lent + np.maximum(normals @ way, 0) / np.linalg.norm(way) ** 3,
            )
        light = 1 + 0.8 * lent[..., None] * np.array([1.0, 0.1, 0.1])
        seen = photo * light + table[..., None] * np.array([0.0, 0.06, 0.02])
        ball = ball_from_photo(
            seen.astype(np.float32), (0, 0), (25.0, 25.0), 20.0, SUN, View.TOP
        )
        balls.append(replace(ball, center=tuple(place + 25), corner=tuple(place)))
    shared = in_one_light(balls)
    for ball in shared:
        rim = (normals[..., 2] > 0.4) & (normals[..., 2] < 0.6)
        assert ball.gloss[rim][:, 1].mean() > 0.003, "where dark paint shows it"
        whites = [
            ball.pattern.colours[ball.pattern.colours[:, 1].argmax()] for ball in shared
        ]
        assert np.allclose(whites, whites[0]), "one paint"
    assert whites[0][0] < 1.2 * whites[0][1], "not the red of neighbours"


def test_soft_shade_where_a_neighbour_is_near_does_not_turn_and_dark_paint_does() -> (
    None
):
    """An orange with pores and a dark patch lies on another one: too near for even light, soft all the same."""
    y, x = np.mgrid[:101, :101]
    u, v = (x - 50) / 40, (y - 50) / 40
    z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
    shade = SUN.ambient + SUN.intensity * np.maximum(
        np.stack([u, v, z], -1) @ np.array(SUN.direction), 0
    )
    shade = shade * (1 - 0.6 * np.exp(-((u + 0.5) ** 2 + (v - 0.8) ** 2) / 0.09))

    def orange(angle):
        a, b = (
            np.cos(angle) * u + np.sin(angle) * v,
            np.cos(angle) * v - np.sin(angle) * u,
        )
        pores = np.sin(25 * a + 3 * np.sin(9 * b)) * np.sin(25 * b) > 0.75
        paint = np.where(pores[..., None], [0.42, 0.15, 0.03], [0.6, 0.22, 0.04])
        paint = np.where(((a > 0.3) & (b > 0.3))[..., None], [0.16, 0.05, 0.01], paint)
        return (paint * shade[..., None]).astype(np.float32)

    ball = ball_from_photo(orange(0.0), (0, 0), (50.0, 50.0), 40.0, SUN, View.SIDE)
    turn = cv2.Rodrigues(np.array([0.0, 0.0, 2.5]))[0]
    found = turned(ball, (50.0, 50.0), turn, (101, 101), (0, 0)) + ball.gloss
    off = np.abs(encode_u8(found).astype(int) - encode_u8(orange(2.5))).max(-1)[
        z > 0.35
    ]
    assert off.mean() < 5.4


def test_a_ball_that_moved_shows_nothing_of_the_border_that_the_photo_showed() -> None:
    """Mixed pixels between touching balls were white dots and black dashes for a frame, as they parted."""
    photo, z, _ = pool_ball(np.eye(3))
    ball = ball_from_photo(photo, (0, 0), (25.0, 25.0), 20.0, SUN, View.TOP)
    coverage = (z > 0).astype(np.float32)
    sprite = Sprite(
        0, (0, 0), photo, coverage, ball=ball, rest=np.full_like(photo, 0.5)
    )
    start = Pose(25.0, 25.0, 0.0)
    for pose, shows in ((start, True), (Pose(26.0, 25.0, 0.0), False)):
        where = place_sprite(sprite, start, pose, (51, 51), None)
        assert where is not None
        assert (draw_border(sprite, where, np.ones(2, np.float32)) is not None) == shows


def test_shadows_of_a_near_lamp_lean_away_from_it(tmp_path) -> None:
    """Three discs, their shadows the farther off the farther they are from a lamp; one moves to its other side."""
    lamp, lean, soft, way = np.array([130.0, 90.0]), 0.12, 3, np.array([110.0, 0.0])
    yy, xx = np.mgrid[:180, :320]

    def shade(middles):
        dark = np.ones(xx.shape)
        for at in middles:
            x, y = at + lean * (at - lamp)
            dark *= 1 - 0.5 * cv2.GaussianBlur(
                np.clip(16.5 - np.hypot(xx - x, yy - y), 0, 1), (0, 0), soft
            )
        return dark[..., None]

    middles = [
        np.array([60.0, 60.0]),
        np.array([270.0, 130.0]),
        np.array([60.0, 140.0]),
    ]
    empty = np.full((180, 320, 3), 0.3)
    cover = sum(np.clip(15.5 - np.hypot(xx - x, yy - y), 0, 1) for x, y in middles)
    lit = empty * shade(middles)
    (tmp_path / "photo.assets").mkdir()
    photo = lit * (1 - cover[..., None]) + 0.5 * cover[..., None]
    for name, picture in {
        "photo": photo,
        "photo.assets/clean": empty,
        "photo.assets/background": lit,
    }.items():
        cv2.imwrite(
            str(tmp_path / f"{name}.png"), encode_u8(picture.astype(np.float32))
        )
    masks = sum(
        k * (np.hypot(xx - x, yy - y) < 15.5) for k, (x, y) in enumerate(middles, 1)
    )
    cv2.imwrite(str(tmp_path / "photo.assets/masks.png"), masks.astype(np.uint8))
    (tmp_path / "scene.yaml").write_text("""\
physgen: 1
image: photo.png
assets: photo.assets
world: {view: top, duration: 1}
objects:
  a: {mask: 1, shape: {circle: {center: [60, 60], radius: 15}}, velocity: [110, 0]}
  b: {mask: 2, shape: {circle: {center: [270, 130], radius: 15}}}
  c: {mask: 3, shape: {circle: {center: [60, 140], radius: 15}}}
light: {direction: [0, 0, 1]}
""")
    last = decode(frames(tmp_path / "scene.yaml", [0.0, 1.0])[-1].rgb)
    now = [middles[0] + way, *middles[1:]]
    bare = np.min([np.hypot(xx - x, yy - y) for x, y in now], axis=0) > 18
    off = np.abs(last - empty * shade(now)).max(-1)[
        bare & (np.hypot(xx - 170, yy - 60) < 45)
    ]
    along = (
        lamp + (middles[0] - lamp) * (1 + lean) + way
    )  # a shadow that only moves along with its disc
    stiff = 1 - 0.5 * cv2.GaussianBlur(
        np.clip(16.5 - np.hypot(xx - along[0], yy - along[1]), 0, 1), (0, 0), soft
    )
    unlit = np.abs(empty[..., 0] * stiff - (empty * shade(now))[..., 0])[
        bare & (np.hypot(xx - 170, yy - 60) < 45)
    ]
    assert off.mean() < 0.6 * unlit.mean()


def test_the_highlight_of_a_disc_stays_as_it_turns(bundled: Path) -> None:
    """Turned by a half, a curling stone without normals is still bright towards the lamps, not away from them."""
    scene = pipeline.load(bundled / "curling" / "scene.yaml")
    maps = pipeline.percepts(scene)
    assert maps.normals is None
    compiled = pipeline.compile(scene, maps)
    stone = [body.name for body in compiled.world.bodies].index("red-3")
    track = simulate(compiled.world, np.array([0.0, 0.01]))
    poses = np.repeat(track.poses[:1], 2, axis=0)
    poses[1, stone, 2] += np.pi
    x, y = poses[0, stone, :2]
    yy, xx = np.mgrid[:512, :512] - np.array([y, x])[:, None, None]
    ring = (np.hypot(xx, yy) > 12) & (np.hypot(xx, yy) < 22)
    ways = []
    for frame in pipeline.render(
        pipeline.stage(scene, compiled, maps), replace(track, poses=poses)
    ):
        light = frame.rgb.astype(float).mean(axis=2)[ring]
        ways.append(np.array([(light * part[ring]).mean() for part in (xx, yy)]))
    assert ways[0] @ ways[1] > 0.5 * (ways[0] @ ways[0])


@pytest.mark.parametrize(
    ("kind", "kept"), [("halves", True), ("cut", True), ("lit", False)]
)
def test_a_disc_keeps_its_paint_and_not_its_light(kind: str, kept: bool) -> None:
    """Halves of two paints, an even disc half beyond the photo, and an even one that is brighter to one side."""
    yy, xx = np.mgrid[:50, :50] - 24.5
    cover = (np.hypot(xx, yy) < 20).astype(np.float32)
    shade = {
        "halves": np.where(xx < 0, 0.02, 0.5),
        "cut": np.full(xx.shape, 0.1),
        "lit": 0.2 + 0.004 * xx,
    }[kind]
    cover[:, :25] *= kind != "cut"
    light = np.repeat((shade * cover)[..., None], 3, axis=2).astype(np.float32)
    body = SimpleNamespace(radius=20.0, solid=Solid.DISC, center=np.array([24.5, 24.5]))
    relief = reliefs.add_disc_relief(
        Sprite(0, (0, 0), light, cover), cast(Body, body)
    ).relief
    assert relief is not None
    ratio = relief.ratio(np.pi)[(cover > 0) & (np.hypot(xx, yy) < 16)]
    assert (np.ptp(ratio) < 0.01) == kept
    if kind == "lit":
        inside = np.hypot(xx, yy) < 16
        assert relief.ratio(np.pi / 2)[inside] == pytest.approx(
            ((0.2 - 0.004 * yy) / shade)[inside], abs=0.05
        )


@pytest.mark.parametrize("cut", [0, 2])
def test_an_outline_that_cuts_an_edge_off_lights_no_line_on_the_face(cut: int) -> None:
    """A block with a lit left edge and a dark right one, of which the outline lacks `cut` px along a part."""
    light = np.full((160, 48), 0.5, np.float32)
    light[:, 8:11], light[:, 37:40] = 0.7, 0.2
    cover = np.zeros_like(light)
    cover[8:152, 8:40] = 1
    cover[60:90, 40 - cut : 40] = 0
    sprite = Sprite(0, (0, 0), (light * cover)[..., None].repeat(3, 2), cover)
    relief = reliefs.add_edge_relief(
        sprite, DistantLight((-0.8, -0.4, 0.45), 0.8, 0.3)
    ).relief
    assert relief is not None
    lit = (light * relief.ratio(np.pi / 2))[12:148]
    face, edge = lit[:, 12:36], lit[:, 37:40][cover[12:148, 37:40] > 0]
    assert np.abs(face[54:72] - 0.5).max() < 0.06, "beside the outline's gap"
    assert edge.mean() > 0.2, (
        "what faces down is lit from below a little more than what faced away"
    )


def test_the_dark_rim_of_a_disc_is_its_own() -> None:
    """Pixels along its border show it and the table: of a disc, what is its own there is told apart."""
    yy, xx = np.mgrid[:80, :80] - 39.5
    away = np.hypot(xx, yy)
    cover = np.clip(24.5 - away, 0, 1).astype(np.float32)
    own, table = np.where(away > 22, 0.05, 0.5), 0.25
    rgb = encode_u8(
        (cover * own + (1 - cover) * table)[..., None].repeat(3, 2).astype(np.float32)
    )
    behind = encode_u8(np.full((80, 80, 3), table, np.float32))
    shape = Disc(np.array([39.5, 39.5]), 24.0)
    labels, none = (cover >= 0.5).astype(np.uint16), np.zeros((80, 80), bool)
    [sprite] = cut_sprites(rgb, labels, none, cover, behind, {0: 0}, [shape])
    half = (sprite.coverage > 0.45) & (sprite.coverage < 0.7)
    assert half.sum() > 20
    assert (sprite.light[half].mean(axis=1) / sprite.coverage[half]).max() < 0.07


@pytest.mark.parametrize("side", [-1, 1])
def test_an_edge_that_turns_up_is_lit_from_above(side: int) -> None:
    """The photo shows a block's left and right edges alone; the scene's light says how high it comes from."""
    light = np.full((160, 48), 0.5, np.float32)
    light[:, 8:11], light[:, 37:40] = 0.7, 0.2
    cover = np.zeros_like(light)
    cover[8:152, 8:40] = 1
    sprite = Sprite(0, (0, 0), (light * cover)[..., None].repeat(3, 2), cover)
    relief = reliefs.add_edge_relief(
        sprite, DistantLight((-0.5, -0.75, 0.45), 0.8, 0.3)
    ).relief
    assert relief is not None
    lit = (light * relief.ratio(side * np.pi / 2))[40:120]
    up, down = (
        (lit[:, 8:11], lit[:, 37:40]) if side > 0 else (lit[:, 37:40], lit[:, 8:11])
    )
    assert up.mean() > down.mean() + 0.02


@pytest.mark.slow
def test_object_outside_photo_casts_no_shadow(tmp_path: Path) -> None:
    """A ball whose position was written in other units; seen from above, shadows slide."""
    root = Path(__file__).resolve().parents[2]
    edits = (
        "objects.ball-1.shape={circle: {center: [6090, 3195], radius: 200}}",
        "world.duration=0.1",
        "render.frames=2",
    )
    scene = root / "scenes" / "billiards" / "scene.yaml"
    folder = pipeline.render_scene(scene, tmp_path, overrides=edits)
    assert (folder / "video.mp4").is_file()
