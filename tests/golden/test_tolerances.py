"""What is right and what is not: at the edges of tolerances, where clips do not match, and read by others than us."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pytest import approx

from physgen.batch.compare import MotionDifference, Samples, motion_difference
from physgen.batch.golden import Golden, differences, frame_difference, make_clip, read, save
from physgen.batch.tolerances import SIDE, GoldenOptions, Motion, Pixels
from physgen.pipeline import Stages
from physgen.simulate.trajectory import Trajectory

G, SPIN = 600.0, 90.0
OPTIONS = GoldenOptions(motion=Motion(px_per_s=1.0))
FALL = f"""\
physgen: 1
size: [320, 240]
world: {{gravity: [0, {G:g}], duration: 0.5}}
objects:
  ball: {{shape: {{circle: {{center: [30, 40], radius: 12}}}}, spin: {SPIN:g}}}
  shelf: {{shape: {{box: {{center: [250, 200], size: [80, 12]}}}}, motion: static}}
"""


@pytest.fixture(scope="module")
def fall(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trajectory, Golden]:
    path = tmp_path_factory.mktemp("fall") / "scene.yaml"
    path.write_text(FALL)
    return make_clip(path, OPTIONS, Stages())


def compared(
    then: Trajectory, now: Trajectory, allowed: Motion, until: float | None = None
) -> MotionDifference | None:
    return motion_difference(Samples.of(then, until), Samples.of(now, until), allowed)


def shifted(trajectory: Trajectory, sample: int, by: tuple[float, float, float]) -> Trajectory:
    """With the first object `by` px, px and degrees from where it is, from a sample on."""
    poses = trajectory.poses.copy()
    poses[sample:, 0] += (by[0], by[1], np.radians(by[2]))
    return replace(trajectory, poses=poses)


@pytest.mark.parametrize(
    ("by", "right"),
    [
        ((0.1, 0, 0), True),
        ((0.06, 0.08, 0), True),
        ((0.11, 0, 0), False),
        ((0.08, 0.08, 0), False),
        ((0, 0, 0.1), True),
        ((0, 0, -0.11), False),
        ((0, 0, 360), False),
    ],
)
def test_what_is_allowed_is_allowed_and_no_more(
    fall: tuple[Trajectory, Golden], by: tuple[float, float, float], right: bool
) -> None:
    then = fall[0]
    found = compared(then, shifted(then, 5, by), Motion(px=0.1, degrees=0.1))
    assert (found is None) is right
    if found is not None:
        [strayed] = found.objects
        assert (strayed.object, strayed.sample, strayed.time) == ("ball", 5, approx(5 / 30))
        amounts = {"px": np.hypot(*by[:2]), "degrees": abs(by[2])}
        assert strayed.amounts == approx({key: value for key, value in amounts.items() if value > 0.1})
        assert strayed.most_px == approx(amounts["px"])


def test_nothing_after_until_counts(fall: tuple[Trajectory, Golden]) -> None:
    then, now = fall[0], shifted(fall[0], 6, (5, 0, 0))
    assert compared(then, now, Motion(), until=5 / 30) is None
    assert compared(then, now, Motion(), until=6 / 30) is not None


def test_turns_in_space_count_as_angles_whatever_their_sign(fall: tuple[Trajectory, Golden]) -> None:
    trajectory = fall[0]

    def turned(degrees: float, sign: float = 1.0) -> Trajectory:
        half = np.radians(degrees) / 2
        turns = np.zeros((*trajectory.poses.shape[:2], 4))
        turns[...] = sign * np.array([np.cos(half), np.sin(half), 0, 0])
        return replace(trajectory, turns=turns)

    assert compared(turned(40), turned(40.05, -1), Motion(degrees=0.1)) is None
    found = compared(turned(40), turned(41), Motion(degrees=0.1))
    assert found is not None
    assert found.objects[0].amounts["degrees"] == approx(1, rel=0.02)


def test_velocities_count_where_they_are_asked_for(fall: tuple[Trajectory, Golden]) -> None:
    then = fall[0]
    now = replace(then, velocities=then.velocities + np.array([3.0, 0, 0]))
    assert compared(then, now, Motion()) is None
    assert compared(then, now, Motion(px_per_s=4.0)) is None
    found = compared(then, now, Motion(px_per_s=2.0))
    assert found is not None
    assert found.objects[0].amounts == approx({"px_per_s": 3.0})


def test_objects_and_times_that_do_not_match_are_told(fall: tuple[Trajectory, Golden]) -> None:
    then = fall[0]
    other = replace(then, names=("ball", "other"))
    found = compared(then, other, Motion())
    assert found is not None
    assert (found.gone, found.new, found.objects) == (("shelf",), ("other",), ())
    assert found.text() == "without shelf now; with other now"
    shorter = replace(then, times=then.times[:9], poses=then.poses[:9], turns=then.turns[:9])
    shorter = replace(shorter, velocities=then.velocities[:9])
    for one, two in ((then, shorter), (shorter, then)):
        found = compared(one, two, Motion())
        assert found is not None
        assert (found.samples, found.objects) == ((len(one.times), len(two.times)), ())
    slower = compared(then, replace(then, times=then.times * 2), Motion())
    assert slower is not None
    assert slower.retimed


@pytest.mark.parametrize(
    ("pixels", "levels", "right"),
    [(10, 100, True), (11, 9, False), (11, 8, True), (2000, 1, True), (2001, 1, False), (10_000, 0, True)],
)
def test_few_pixels_may_differ_much_or_many_a_little(pixels: int, levels: int, right: bool) -> None:
    """Of 10,000, 10 may differ by more than 8 levels; the mean may differ by 0.2."""
    now = np.full((100, 100, 3), 100, np.uint8)
    now.reshape(-1, 3)[:pixels] -= np.uint8(levels)
    text = frame_difference(np.full((100, 100, 3), 100, np.uint8), now, Pixels())
    assert (not text) is right
    assert right or f"by {levels} at most" in text


def test_what_is_not_kept_cannot_be_compared(fall: tuple[Trajectory, Golden], tmp_path: Path) -> None:
    now = fall[1]
    assert now.stills is not None
    assert now.motion is not None
    smaller = tuple(replace(still, rgb=still.rgb[:, :-1]) for still in now.stills)
    without = replace(now.motion, velocities=None)
    for kept, line in (
        (replace(now, stills=smaller), "kept it is 191 x 144 px, now 192 x 144 px"),
        (replace(now, stills=now.stills[:-1]), "frames 0, 3, 6, 8, 11 are kept, others are asked for"),
        (replace(now, motion=without), "velocities are to be compared, and not kept"),
    ):
        save(kept, tmp_path / "a.npz")
        assert line in differences(tmp_path / "a.npz", tmp_path / "a.webp", now, OPTIONS)[0]


def test_others_read_what_is_kept(fall: tuple[Trajectory, Golden], tmp_path: Path) -> None:
    """NumPy and Pillow, and what a falling body does: y = y0 + g t²/2, turning steadily."""
    path = tmp_path / "fall.npz"
    save(fall[1], path)
    with np.load(path, allow_pickle=False) as kept:
        t = kept["times"]
        x, y, angle = kept["poses"][:, kept["names"].tolist().index("ball")].T
        vy = kept["velocities"][:, 0, 1]
        frames, frame_times = kept["frames"], kept["frame_times"]
    assert t == approx(np.arange(15) / 30)
    assert x == approx(30, abs=0.006)
    assert y == approx(40 + G * t**2 / 2, abs=0.006)
    assert np.degrees(angle) == approx(SPIN * t, abs=0.006)
    assert vy == approx(G * t, abs=0.06)
    assert frames.tolist() == [0, 3, 6, 8, 11, 14]
    with Image.open(path.with_suffix(".webp")) as picture:
        sheet = np.asarray(picture.convert("RGB")).astype(int)
    assert sheet.shape == (SIDE * 240 // 320, 6 * SIDE, 3)
    scale = SIDE / 320
    paper = sheet[4, 4]
    for k, time in enumerate(frame_times.tolist()):
        part = sheet[:, k * SIDE : (k + 1) * SIDE]
        rows, columns = np.nonzero(np.abs(part[:, : SIDE // 2] - paper).max(axis=-1) > 40)
        assert columns.mean() == approx((30.5 * scale) - 0.5, abs=0.6)
        assert rows.mean() == approx((40.5 + G * time**2 / 2) * scale - 0.5, abs=0.6)


def test_a_clip_comes_back_as_it_was_kept(fall: tuple[Trajectory, Golden], tmp_path: Path) -> None:
    path = tmp_path / "fall.npz"
    save(fall[1], path)
    assert read(path, path.with_suffix(".webp")).motion is not None
    assert differences(path, path.with_suffix(".webp"), fall[1], OPTIONS) == []
    assert path.stat().st_size + path.with_suffix(".webp").stat().st_size < 20_000
