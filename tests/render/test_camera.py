"""How a clip is filmed and played, against what an affine map and a clock say; an independent decoder of the file."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from pytest import approx

from physgen import pipeline
from physgen.photometry import decode, encode_u8
from physgen.render.camera import exposure_times, film_frames, shot_of
from physgen.render.stage import Frame
from physgen.simulate.engine import simulate

W, H = 200, 120
DARK, BRIGHT = (float(decode(np.array(code, np.uint8))) for code in (120, 230))
BALL = """\
physgen: 1
size: [200, 120]
world: {gravity: [0, 500], duration: 0.5}
objects:
  ball: {shape: {circle: {center: [40.3, 30.6], radius: 14}}, velocity: [150, 0], spin: 200, elasticity: 0.8}
  crate: {shape: {box: {center: [150, 90], size: [20, 20]}}}
boundaries: {floor: {segment: [[0, 100], [200, 100]]}}
"""
BOUNCES = BALL.replace("duration: 0.5", "duration: 1.4").replace(
    "velocity: [150, 0]", "velocity: [80, 0]"
)


def scene(tmp_path: Path, *overrides: str, text: str = BALL):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    return pipeline.load(path, [f"render.{edit}" for edit in overrides])


def clip(
    tmp_path: Path, *overrides: str, blur: float = 0.0, text: str = BALL
) -> list[Frame]:
    found = scene(tmp_path, *overrides, text=text)
    world = (compiled := pipeline.compile(found, None)).world
    trajectory = simulate(world)
    times, parts = exposure_times(simulate(world), world, blur)
    drawn = pipeline.stage(found, compiled, None)
    fine = trajectory if parts == 1 else simulate(world, times)
    return list(pipeline.render(drawn, fine, parts, pipeline.shot(found, trajectory)))


def taken(tmp_path: Path, *overrides: str, size: tuple[int, int] = (W, H)):
    """A shot of a picture of `size`."""
    text = f"physgen: 1\nsize: [{size[0]}, {size[1]}]\nworld: {{duration: 1}}\n"
    found = scene(tmp_path, *overrides, text=text)
    return shot_of(found, simulate(pipeline.compile(found, None).world))


def seen(
    tmp_path: Path, rgb: np.ndarray, *overrides: str, time: float = 0.0
) -> tuple[Frame, np.ndarray]:
    """A picture through a camera, and the matrix from the one to the other."""
    through = taken(tmp_path, *overrides, size=(rgb.shape[1], rgb.shape[0]))
    frame = Frame(0, time, rgb, lambda: np.zeros(rgb.shape[:2], np.uint16))
    (found,) = film_frames(iter([frame]), through)
    return found, through.affine(time)


def disc(x: float, y: float, r: float) -> np.ndarray:
    """A white disc on grey, in linear light, exact to 1/16 px."""
    yy, xx = (np.mgrid[: H * 16, : W * 16] + 0.5) / 16 - 0.5
    cover = cv2.resize(
        (np.hypot(xx - x, yy - y) <= r).astype(np.float32),
        (W, H),
        interpolation=cv2.INTER_AREA,
    )
    return encode_u8(np.repeat((DARK + (BRIGHT - DARK) * cover)[..., None], 3, axis=2))


def measured(rgb: np.ndarray) -> tuple[float, float, float]:
    """Centroid, px, and radius, px, of what is brighter than the ground."""
    cover = (decode(rgb)[..., 0].astype(float) - DARK) / (BRIGHT - DARK)
    yy, xx = np.mgrid[: rgb.shape[0], : rgb.shape[1]]
    total = cover.sum()
    return (
        (cover * xx).sum() / total,
        (cover * yy).sum() / total,
        np.sqrt(total / np.pi),
    )


# ---- where ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "view",
    ["scale=1", f"size=[{W}, {H}]", "camera={zoom: 1}", "camera={center: [3, 4]}"],
)
def test_all_of_the_photo_at_its_own_size_is_the_very_frame(
    tmp_path, view: str
) -> None:
    through = taken(tmp_path, view)
    assert np.array_equal(through.affine(0.3), np.eye(2, 3))
    frame = Frame(0, 0.0, disc(60, 50, 20), lambda: np.zeros((H, W), np.uint16))
    assert next(film_frames(iter([frame]), through)) is frame


@pytest.mark.parametrize(
    "view",
    [
        ["camera={center: [80, 60], zoom: 2}"],
        ["camera={center: [77.3, 58.9], zoom: 2.7}"],
        ["scale=2"],
        ["scale=0.5"],
        ["scale=1.37"],
        ["size=[90, 90]", "camera={center: [77.25, 60]}"],
        ["size=[90, 90]", "camera={center: [77.25, 61], zoom: 1.2}"],
    ],
)
def test_a_disc_lies_where_the_matrix_says(tmp_path, view: list[str]) -> None:
    x, y, r = 74.3, 55.8, 17.0
    found, matrix = seen(tmp_path, disc(x, y, r), *view)
    # borders of a whole disc: what is beside it is even, so its light is all there
    assert measured(found.rgb) == approx(
        (*(matrix @ (x, y, 1)), r * matrix[0, 0]), abs=0.02
    )


def test_a_slow_pan_does_not_tremble(tmp_path) -> None:
    picture = disc(74.3, 55.8, 17.0)
    for x in np.arange(77, 78, 0.07):
        found, matrix = seen(
            tmp_path, picture, "size=[90, 120]", f"camera={{center: [{x:.3f}, 60]}}"
        )
        assert matrix[0, 0] == 1.0
        assert measured(found.rgb)[0] == approx(matrix[0] @ (74.3, 55.8, 1), abs=0.02)


@pytest.mark.parametrize("factor", [0.4, 3])
def test_no_line_is_drawn_beside_an_edge(tmp_path, factor: float) -> None:
    picture = np.full((H, W, 3), 40, np.uint8)
    picture[:, 71:] = 230
    found, _ = seen(tmp_path, picture, f"scale={factor}")
    assert (found.rgb.min(), found.rgb.max()) == (40, 230)
    row = found.rgb[H // 4, :, 0].astype(int)
    assert (np.diff(row) >= 0).all()


def test_ids_go_with_the_picture(tmp_path) -> None:
    view = "camera={center: [98, 60], zoom: 1.25}"
    whole, near = clip(tmp_path)[3], clip(tmp_path, view)[3]
    matrix = taken(tmp_path, view).affine(0.0)
    assert near.ids.shape == near.rgb.shape[:2] == (H, W)
    for body in (1, 2):
        middles = [
            np.argwhere(frame.ids == body).mean(0)[::-1] for frame in (whole, near)
        ]
        assert matrix @ (*middles[0], 1) == approx(middles[1], abs=0.6)


# ---- a moving camera -----------------------------------------------------------------------------------------------

MOVE = "camera=[{time: 0.1}, {time: 0.4, center: [150, 80], zoom: 4}, {time: 0.9, center: [50, 30], zoom: 2.5}]"


def test_a_move_is_smooth_and_stays_in_the_photo(tmp_path) -> None:
    through = taken(tmp_path, MOVE, "size=[160, 120]")
    times = np.linspace(0, 1, 2001)
    views = np.array([through.affine(float(time)) for time in times])
    scale, left, top = views[:, 0, 0], views[:, 0, 2], views[:, 1, 2]
    corners = np.stack([(-0.5 - left) / scale, (-0.5 - top) / scale], 1)
    far = np.stack([(159.5 - left) / scale, (119.5 - top) / scale], 1)
    assert (corners > -0.5 - 1e-9).all()
    assert (far < (W - 0.5 + 1e-9, H - 0.5 + 1e-9)).all()
    for track in (*corners.T, *far.T, np.log(scale)):
        speed = np.diff(track)
        assert np.abs(np.diff(speed)).max() < 0.02 * np.abs(speed).max(), (
            "it never jumps to another speed"
        )
        assert np.abs(speed[times[1:] < 0.1]).max() == 0


@pytest.mark.parametrize(
    ("zoom", "size"), [(2.0, (W, H)), (3.0, (W, H)), (1.0, (80, 120))]
)
def test_a_camera_follows(tmp_path, zoom: float, size: tuple[int, int]) -> None:
    found = scene(
        tmp_path,
        f"camera={{follow: ball, zoom: {zoom}}}",
        f"size=[{size[0]}, {size[1]}]",
        text=BOUNCES,
    )
    trajectory = simulate(pipeline.compile(found, None).world)
    through = pipeline.shot(found, trajectory)
    assert through.moves
    away, way = [], []
    for k, time in enumerate(trajectory.times):
        matrix = through.affine(float(time))
        inner = np.clip(trajectory.poses[k, 0, :2], (0, 0), (W, H))
        away.append(np.abs(matrix @ (*inner, 1) - (np.array(size) - 1) / 2) / size)
        way.append(-matrix[:, 2] / matrix[0, 0])
    assert np.max(away) < 0.5
    middle = np.array(away)[
        5:40
    ]  # once the ball is not so near the photo's border that the camera cannot be
    assert middle[:, 0].max() <= 0.3
    if zoom > 1:  # so near, it has to go along
        return
    kinks = [
        np.abs(np.diff(path, 2, axis=0)).max()
        for path in (np.array(way), trajectory.poses[:, 0, :2])
    ]
    assert kinks[0] < kinks[1] / 3, "it does not bounce with the ball"


# ---- when ----------------------------------------------------------------------------------------------------------


def same(one: Frame, other: Frame) -> bool:
    return (
        np.array_equal(one.rgb, other.rgb)
        and np.array_equal(one.ids, other.ids)
        and one.time == other.time
    )


def test_slow_motion_holds_every_frame_of_the_true_speed(tmp_path) -> None:
    plain = clip(tmp_path)
    for slow in (3, 4):
        slowed = clip(tmp_path, f"slow={slow}")
        assert len(slowed) == slow * len(plain)
        assert all(map(same, plain, slowed[::slow]))
        assert not np.array_equal(slowed[5].rgb, slowed[6].rgb)


@pytest.mark.parametrize("blur", [0.0, 0.5])
@pytest.mark.parametrize(
    "view", [(), ("camera=[{time: 0}, {time: 0.4, follow: ball, zoom: 2}]",)]
)
def test_backward_is_the_same_film(
    tmp_path, blur: float, view: tuple[str, ...]
) -> None:
    forward = clip(tmp_path, *view, blur=blur)
    for play, order in (
        ("backward", forward[::-1]),
        ("there-and-back", forward + forward[-2::-1]),
    ):
        played = clip(tmp_path, *view, f"play={play}", blur=blur)
        assert len(played) == len(order)
        assert all(map(same, played, order))
        assert [frame.index for frame in played] == list(range(len(order)))


# ---- finer ---------------------------------------------------------------------------------------------------------


def test_a_flat_scene_is_drawn_as_large_as_it_is_seen(tmp_path) -> None:
    plain, large = clip(tmp_path)[3], clip(tmp_path, "scale=3")[3]
    assert large.rgb.shape == (3 * H, 3 * W, 3)
    fall = 500 * 0.1**2 / 2
    x, y = 3 * (40.3 + 15 + 0.5) - 0.5, 3 * (30.6 + fall + 0.5) - 0.5
    yy, xx = np.mgrid[: 3 * H, : 3 * W]
    away = np.hypot(xx - x, yy - y)
    assert (large.ids[away < 3 * 14 - 1] == 1).all()
    assert (large.ids[away > 3 * 14 + 1] != 1).all()

    def grey(frame: Frame) -> int:
        """Pixels of the bare upper rows that are neither paper nor any of the colours: borders."""
        light = decode(frame.rgb)[..., 2]
        even = (
            cv2.dilate(light, np.ones((3, 3))) - cv2.erode(light, np.ones((3, 3)))
            < 0.02
        )
        return int(np.count_nonzero(~even))

    assert grey(large) < 4 * grey(plain), "borders are three times as long and no wider"


# ---- files ---------------------------------------------------------------------------------------------------------


def test_the_video_has_the_size_and_the_frames_that_are_asked_for(tmp_path) -> None:
    scene(tmp_path)
    edits = [
        "size=[64, 96]",
        "slow=2",
        "play=there-and-back",
        "camera={follow: ball, zoom: 2}",
    ]
    folder = pipeline.render_scene(
        tmp_path / "scene.yaml",
        tmp_path / "out",
        overrides=[f"render.{edit}" for edit in edits],
    )
    with av.open(str(folder / "video.mp4")) as video:
        pictures = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
        assert float(video.streams.video[0].average_rate) == 30
    assert {picture.shape for picture in pictures} == {(96, 64, 3)}
    assert len(pictures) == 2 * 30 - 1
    assert np.abs(pictures[0].astype(int) - pictures[-1]).mean() < 2
    assert '"size": [\n   64,\n   96\n  ]' in (folder / "manifest.json").read_text()
    assert 'width="200" height="120"' in (folder / "report.html").read_text(), (
        "outlines are drawn on the whole photo"
    )


def test_a_camera_that_cannot_do_what_is_written_is_told(tmp_path) -> None:
    edits = [
        "camera=[{time: 0, center: [3, 60], zoom: 2}, {time: 0.2, follow: ball}, {time: 9, zoom: 2}]"
    ]
    found = scene(tmp_path, *edits)
    told = [
        (problem.path, problem.expected)
        for problem in pipeline.lint(found, pipeline.compile(found, None))
        if problem.path.startswith("render")
    ]
    assert told == [
        (
            "render.camera[0].center",
            "is too near the photo's border for zoom 2: the view stops at [49.5, 60]",
        ),
        (
            "render.camera[2].time",
            "is after the end of the motion at 0.5 s: this view is never reached",
        ),
    ]
