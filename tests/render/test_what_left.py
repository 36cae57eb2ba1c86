"""What objects leave behind, beside the path tracer's picture of the empty place."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.compile.compile import CompiledScene
from physgen.maps import Percepts
from physgen.perceive.inpaint.poisson import dilate
from physgen.photometry import decode
from physgen.render.stage import Stage
from physgen.simulate.engine import simulate


def opened(bundled: Path, name: str) -> tuple[Percepts, CompiledScene, Stage]:
    """A bundled scene's maps, world and stage."""
    scene = pipeline.load(bundled / name / "scene.yaml")
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    return maps, compiled, pipeline.stage(scene, compiled, maps)


def emptied(compiled: CompiledScene, stage: Stage, stays: str = "") -> list[np.ndarray]:
    """sRGB of the first frame, and of one that all objects but one have left."""
    track = simulate(compiled.world, np.array([0.0, 0.1]))
    far = np.full(track.poses[0].shape, 1e5)
    far[:, 2] = 0
    far[[body.name == stays for body in compiled.world.bodies]] = 0
    away = replace(track, poses=track.poses + np.stack([0 * far, far]))
    return [frame.rgb.astype(int) for frame in pipeline.render(stage, away)]


@pytest.mark.parametrize("name", ["wall-ball", "rubber-balls"])
def test_objects_take_their_shadows_and_rims_with_them(
    bundled: Path, name: str
) -> None:
    maps, compiled, stage = opened(bundled, name)
    first, empty = emptied(compiled, stage)
    assert np.abs(first - maps.rgb).max() <= 1
    old = np.abs(maps.rgb.astype(int) - maps.clean).max(axis=2) > 20
    assert np.count_nonzero(old) > 3000
    off = np.abs(empty - maps.clean).max(axis=2)
    assert off[old].max() <= 2


def test_marbles_leave_no_rims_beside_their_trough(bundled: Path) -> None:
    maps, compiled, stage = opened(bundled, "marbles")
    _, left = emptied(compiled, stage, "trough")
    trough = [body.name for body in compiled.world.bodies].index("trough")
    beside = (maps.labels > 0) & ~dilate(compiled.labels == trough + 1, 2)
    assert np.count_nonzero(beside) > 4000
    assert np.abs(left - maps.clean)[beside].max() <= 12


def test_shadows_go_on_behind_what_throws_them(bundled: Path) -> None:
    """What the photo shows of a shadow beside the plank, and what is worked out behind it, meet without a step."""
    maps, compiled, stage = opened(bundled, "seesaw")
    lit = stage.lit_background
    plank = compiled.labels == 1 + [body.name for body in compiled.world.bodies].index(
        "plank"
    )
    dark = cv2.blur(
        np.log(decode(maps.clean).mean(axis=2) / lit.photo_background().mean(axis=2)),
        (5, 1),
    )
    for x in range(130, 190):  # clear of the stone above and of the log below
        bottom = np.flatnonzero(plank[:, x]).max()
        assert abs(dark[bottom + 4, x] - dark[bottom + 1, x]) < 0.35
        assert dark[bottom - 8, x] > -0.02


def test_shadows_of_many_leave_light_and_end_at_their_shelf(bundled: Path) -> None:
    """Three books lean together at the end: their shadows stay out of the shelf below, and nothing is black."""
    maps, compiled, stage = opened(bundled, "shelf")
    track = simulate(compiled.world, np.array([0.0, 1.5]))
    _, last = (frame.rgb.astype(int) for frame in pipeline.render(stage, track))
    assert np.count_nonzero(last.max(axis=2) < 4) < 20
    assert np.abs(last - maps.rgb)[470:, 20:490].max() <= 8


def rack(folder: Path, doubtful: str = "") -> tuple[Percepts, CompiledScene, Stage]:
    """Two balls side by side on a table, dark between them, with a sliver beside the first that `coverage` holds."""
    y, x = np.mgrid[:120, :200].astype(float)
    away = [np.hypot(x - cx, y - 60) for cx in (70, 114)]
    rgb = np.full((120, 200, 3), (40, 130, 60), np.uint8)
    gap = (np.abs(x - 92) < 5) & (np.abs(np.abs(y - 60) - 9) < 7)
    rgb[gap] = (8, 26, 12)
    masks = np.zeros((120, 200), np.uint8)
    for k, (one, colour) in enumerate(
        zip(away, ((200, 60, 40), (60, 70, 200)), strict=True), 1
    ):
        rgb[one <= 20] = colour
        masks[one <= 20] = k
    sliver = (away[0] > 20) & (away[0] <= 24) & (np.abs(y - 60) < 6) & (x < 60)
    rgb[sliver], masks[sliver] = (220, 210, 190), 3
    scene = folder / "scene.yaml"
    assets = folder / "photo.assets"
    assets.mkdir()
    background = np.full_like(rgb, (60, 130, 40))  # BGR
    pictures = {
        "masks": masks,
        "coverage": np.uint8(255 * (masks > 0)),
        "background": background,
    }
    for name, picture in pictures.items():
        cv2.imwrite(str(assets / f"{name}.png"), picture)
    cv2.imwrite(str(folder / "photo.png"), rgb[..., ::-1])
    balls = "".join(
        f"  ball-{k}: {{mask: {k}, solid: sphere, shape: {{circle: {{center: [{cx}, 60], radius: 20}}}}}}\n"
        for k, cx in ((1, 70), (2, 114))
    )
    world = "world: {view: top, pixels_per_meter: 700}\nlight: {direction: [0, 0, 1], intensity: 1, ambient: 0.5}\n"
    world += "render: {shadows: false}\n"
    scene.write_text(
        f"physgen: 1\nimage: photo.png\nassets: photo.assets\n{world}objects:\n{balls}{doubtful}"
    )
    opened_one = pipeline.load(scene)
    maps = pipeline.percepts(opened_one)
    compiled = pipeline.compile(opened_one, maps)
    return maps, compiled, pipeline.stage(opened_one, compiled, maps)


def test_a_doubtful_sliver_stays_and_what_was_taken_out_does_not(
    tmp_path: Path,
) -> None:
    maps, compiled, stage = rack(
        tmp_path, "doubtful:\n  maybe-1: {mask: 3, confidence: 0.2}\n"
    )
    first, _ = emptied(compiled, stage)
    assert np.abs(first - maps.rgb).max() <= 1
    (tmp_path / "without").mkdir()
    maps, compiled, stage = rack(tmp_path / "without")
    first, _ = emptied(compiled, stage)
    assert np.abs(first - maps.rgb)[maps.labels == 3].max(axis=1).mean() > 60


def test_a_ball_ends_at_its_circle(tmp_path: Path) -> None:
    _, _, stage = rack(tmp_path, "doubtful:\n  maybe-1: {mask: 3, confidence: 0.2}\n")
    ball = next(sprite for sprite in stage.sprites if sprite.body == 0)
    rows, columns = np.nonzero(ball.coverage)
    away = np.hypot(columns + ball.corner[0] - 70, rows + ball.corner[1] - 60)
    assert 19 < away[ball.coverage[rows, columns] > 0.02].max() < 22.5


def test_the_dark_between_two_balls_goes_with_either(tmp_path: Path) -> None:
    maps, compiled, stage = rack(
        tmp_path, "doubtful:\n  maybe-1: {mask: 3, confidence: 0.2}\n"
    )
    dark = (maps.rgb.max(axis=2) < 30) & (maps.labels == 0)
    assert np.count_nonzero(dark) > 30
    for stays in ("ball-1", "ball-2"):
        first, left = emptied(compiled, stage, stays)
        assert first[dark].max() < 32
        assert left[dark].mean(axis=0) == pytest.approx((40, 130, 60), abs=12)


def test_what_is_called_doubtful_afterwards_is_put_back(tmp_path: Path) -> None:
    """An object that is none: taken out it leaves the picture, under `doubtful` it stays, in every frame."""
    rack(tmp_path)
    path = tmp_path / "scene.yaml"
    written = re.sub(r"  ball-2.*\n", "", path.read_text())
    for doubtful, off in (("doubtful: {ball-2: {mask: 2}}\n", 1), ("", None)):
        path.write_text(written + doubtful)
        scene = pipeline.load(path)
        maps = pipeline.percepts(scene)
        compiled = pipeline.compile(scene, maps)
        first, left = emptied(compiled, pipeline.stage(scene, compiled, maps))
        ball = maps.labels == 2
        worst = max(np.abs(frame - maps.rgb)[ball].max() for frame in (first, left))
        assert worst <= off if off is not None else worst > 60


@pytest.mark.parametrize(
    ("mask", "said"),
    [(9, "is not an id in masks.png"), (1, "is the mask of the object ball-1")],
)
def test_a_doubtful_id_that_can_mean_nothing_is_told(
    mask: int, said: str, tmp_path: Path
) -> None:
    rack(tmp_path, f"doubtful:\n  mirror: {{mask: {mask}}}\n")
    scene = pipeline.load(tmp_path / "scene.yaml")
    maps = pipeline.percepts(scene)
    (told,) = [
        p
        for p in pipeline.lint(scene, pipeline.compile(scene, maps), maps)
        if p.path == "doubtful.mirror.mask"
    ]
    assert said in str(told)
    assert told.place.line is not None


def test_a_polished_floor_mirrors_dominoes_and_a_dull_one_no_ball(
    bundled: Path,
) -> None:
    """The share fades with depth, as far below as there is anything like the dominoes upside down."""
    mirror = opened(bundled, "dominoes")[2].mirror
    assert mirror is not None
    assert 0.05 < mirror.share[8] < 0.12
    assert (np.diff(mirror.share[4:]) < 0.005).all()
    assert opened(bundled, "wall-ball")[2].mirror is None


def test_borders_are_lit_when_the_narrow_gap_beside_them_has_opened(
    bundled: Path,
) -> None:
    """The left edge of pyramid's ninth block faces the window, and is black in the gap to the eighth."""
    maps, compiled, stage = opened(bundled, "pyramid")
    block = [body.name for body in compiled.world.bodies].index("block-9")
    sprite = next(sprite for sprite in stage.sprites if sprite.body == block)
    x, y = 281 - sprite.corner[0], 246 - sprite.corner[1]
    light = sprite.light.mean(axis=2)[y - 20 : y + 20]
    assert (
        decode(maps.rgb)[226:266, 281].mean()
        < 0.1 * decode(maps.rgb)[226:266, 286].mean()
    )
    assert light[:, x].mean() > 0.5 * light[:, x + 5].mean()


def test_what_left_takes_its_line_off_an_object_that_moved_a_little_itself(
    bundled: Path,
) -> None:
    _, compiled, stage = opened(bundled, "pyramid")
    names = [body.name for body in compiled.world.bodies]
    track = simulate(compiled.world, np.array([0.0, 0.1]))
    poses = np.repeat(track.poses[:1], 2, axis=0)
    poses[1, names.index("block-8"), 1] -= 1000
    poses[1, names.index("block-5"), 0] += 0.5
    _, last = (
        frame.rgb.astype(int)
        for frame in pipeline.render(stage, replace(track, poses=poses))
    )
    line, below = (
        decode(rows.astype(np.uint8)).mean()
        for rows in (last[286, 210:225], last[289, 210:225])
    )
    assert line > 0.85 * below


def posed(
    compiled: CompiledScene, stage: Stage, **poses: list[tuple[float, float, float]]
) -> list[np.ndarray]:
    """sRGB of frames with objects at poses, by name, a frame after the other; the others stay."""
    track = simulate(compiled.world, np.arange(1 + max(map(len, poses.values()))) / 1e9)
    track.poses[1:] = track.poses[0]
    for name, path in poses.items():
        track.poses[1:, track.names.index(name.replace("_", "-"))] = path
    return [frame.rgb.astype(int) for frame in pipeline.render(stage, track)][1:]


def test_what_an_impact_presses_into_the_floor_keeps_shadow_and_reflection(
    bundled: Path,
) -> None:
    _, compiled, stage = opened(bundled, "dominoes")
    path = [(842, 389.7, 1.5708), (842, 391.1, 1.5545), (842, -4e3, 1.5708)]
    lies, sunk, away = posed(compiled, stage, domino_9=path)
    for there in (
        np.s_[408:412, 790:890],
        np.s_[395:403, 922:945],
    ):  # reflection, shadow
        effect = np.abs(lies[there] - away[there]).mean()
        assert effect > 8
        assert np.abs(sunk[there] - lies[there]).mean() < 0.45 * effect


def test_a_bottle_no_deeper_than_wide_leaves_the_spine_of_a_deep_book_in_the_light(
    bundled: Path,
) -> None:
    """As in the set that the photo was taken of: the lamp shines from the front, and the spine is nearer to it."""
    _, compiled, stage = opened(bundled, "bottle-book")
    lean, bottle = (183.1, 334.4, 0.561), (283.5, 335, 0)
    beside, alone = posed(
        compiled, stage, book=[lean] * 2, bottle=[bottle, (9e3, 0, 0)]
    )
    assert np.abs(beside - alone)[230:290, 205:235].mean() < 1


@pytest.mark.parametrize("side", [-1, 1])
def test_light_comes_from_above_onto_the_edges_of_what_lies(
    bundled: Path, side: int
) -> None:
    """Its edges are rounded: upright, the photo shows the left one lit and the right one dark."""
    _, compiled, stage = opened(bundled, "dominoes")
    [lies] = posed(compiled, stage, domino_9=[(840, 390.0, side * np.pi / 2)])
    rows = lies[378:406, 790:890].mean(axis=(1, 2))
    assert rows[4:8].max() > rows[-8:].max() + 8
    assert rows[3] > rows[2] - 10, "no dark line between its top and its front"


def test_a_ball_takes_its_shadow_off_the_top_of_the_book_on_which_it_lay(
    bundled: Path,
) -> None:
    _, compiled, stage = opened(bundled, "shelf")
    first, empty = (
        rgb[401:407].mean(axis=(0, 2)) for rgb in emptied(compiled, stage, "book-2")
    )
    assert first[78:135].min() < 0.6 * first[150:170].mean()
    assert (
        np.abs(empty[50:170] - empty[150:170].mean()).max()
        < 0.15 * empty[150:170].mean()
    )


def test_a_shadow_cut_by_the_photos_border_stays_whole_as_its_ball_moves(
    bundled: Path,
) -> None:
    maps, compiled, stage = opened(bundled, "rubber-balls")
    start = simulate(compiled.world, np.zeros(1))
    x, y, _ = start.poses[0, start.names.index("foam-ball")]
    [lower] = posed(compiled, stage, foam_ball=[(x, y + 30, 0.0)])
    bare = cv2.blur(maps.clean.astype(float).mean(axis=2), (3, 3))
    before, after = (
        cv2.blur(rgb.mean(axis=2), (3, 3)) / bare
        for rgb in (maps.rgb.astype(float), lower)
    )
    assert before[230:300, 500:].min() < 0.6
    assert (
        np.abs(after[260:330, 500:] - before[230:300, 500:]).mean(axis=0).max() < 0.05
    )
