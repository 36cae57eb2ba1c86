"""Frames that are kept: the same afterwards, whatever befalls the folder."""

from __future__ import annotations

import resource
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.pipeline.cache import Store
from physgen.pipeline.footage import Add, Footage, footage
from physgen.problems import Problem
from physgen.simulate.trajectory import Trajectory

SCENE = """\
physgen: 1
size: [40, 30]
world: {duration: 0.25}
objects:
  ball: {shape: {circle: {center: [12, 12], radius: 5}}, mass: 100}
"""
SAID = {"stages": {"simulate": 0.25}, "effort": {"steps": 12}, "ball": "Bällchen"}
Pictures = list[tuple[np.ndarray, np.ndarray, np.ndarray]]


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Trajectory:
    path = tmp_path_factory.mktemp("scene") / "ball.yaml"
    path.write_text(SCENE)
    return pipeline.simulate(pipeline.compile(pipeline.load(path), None).world)


def pictures(kind: str, count: int = 7, size: tuple[int, int] = (30, 41)) -> Pictures:
    """A noisy photo in which a block moves; one that moves as a whole; noise."""
    rng = np.random.default_rng(5)
    wide = rng.integers(0, 256, (size[0], size[1] + count, 3), dtype=np.uint8)
    made = []
    for k in range(count):
        rgb = wide[:, : size[1]].copy()
        if kind == "camera":
            rgb = wide[:, k : k + size[1]]
        elif kind == "noise":
            rgb = rng.integers(0, 256, (*size, 3), dtype=np.uint8)
        coverage, ids = np.zeros(size, np.uint8), np.zeros(size, np.uint16)
        rgb = np.array(rgb)
        rgb[5:9, k : k + 6] = rng.integers(0, 256, (4, 6, 3))
        coverage[5:9, k : k + 6] = rng.integers(0, 256, (4, 6))
        ids[5:9, k : k + 6] = 300 + k
        made.append((rgb, coverage, ids))
    return made


def filming(frames: Pictures, motion: Trajectory, calls: list[int] | None = None):
    def film(add: Add) -> tuple[Trajectory, dict[str, object]]:
        if calls is not None:
            calls.append(1)
        for frame in frames:
            add(*frame)
        return motion, SAID

    return film


def agrees(found: Footage, frames: Pictures, motion: Trajectory) -> bool:
    same = len(found.rgb) == len(found.coverage) == len(found.ids) == len(frames)
    for k, (rgb, coverage, ids) in enumerate(frames):
        same &= np.array_equal(found.rgb[k], rgb) and np.array_equal(found.ids[k], ids)
        same &= np.array_equal(np.rint(found.coverage[k] * 255), coverage)
    same &= found.trajectory.sample_hashes() == motion.sample_hashes()
    return same and found.said == SAID


@pytest.mark.parametrize("kind", ["photo", "camera", "noise"])
def test_nothing_is_lost(kind: str, motion: Trajectory, tmp_path: Path) -> None:
    store, frames, calls = Store(tmp_path), pictures(kind), list[int]()
    for turn in range(3):
        with footage(store, "guidance-a", filming(frames, motion, calls)) as found:
            assert agrees(found, frames, motion)
            assert found.kept == (turn > 0)
            assert (found.rgb[0].dtype, found.coverage[0].dtype, found.ids[0].dtype) == (
                np.uint8,
                np.float32,
                np.uint16,
            )
            found.rgb[0][:] = 0  # what is handed out is the reader's own
            assert agrees(found, frames, motion)
    assert len(calls) == 1


def test_a_photo_that_stays_takes_little(motion: Trajectory, tmp_path: Path) -> None:
    store = Store(tmp_path)
    for kind in ("photo", "noise"):
        with footage(store, f"guidance-{kind}", filming(pictures(kind, 40, (60, 80)), motion)):
            pass
    size = {entry.key: entry.bytes for entry in store.sizes()}
    assert size["guidance-photo"] < size["guidance-noise"] / 8


def test_views_are_read_in_any_order(motion: Trajectory, tmp_path: Path) -> None:
    frames = pictures("photo")
    with footage(Store(tmp_path), "guidance-a", filming(frames, motion)):
        pass
    with footage(Store(tmp_path), "guidance-a", filming([], motion)) as found:
        assert np.array_equal(found.rgb[-1], frames[-1][0])  # before the first was asked for
        assert all(np.array_equal(a, b[0]) for a, b in zip(found.rgb, frames, strict=True))
        assert all(np.array_equal(a, b[2]) for a, b in zip(found.ids[2:5], frames[2:5], strict=True))
        order = (0, 1, 2, 6, 2, 1)
        played = found.rgb.shown(order)
        assert all(np.array_equal(a, frames[k][0]) for a, k in zip(played, order, strict=True))
        assert len(played[::2]) == 3
        with pytest.raises(IndexError):
            found.rgb[7]


def test_coverage_may_be_told_as_parts(motion: Trajectory) -> None:
    parts = np.linspace(-0.1, 1.1, 12, dtype=np.float32).reshape(3, 4)
    rgb, ids = np.zeros((3, 4, 3), np.uint8), np.zeros((3, 4), np.uint16)
    with footage(None, "", filming([(rgb, parts, ids)], motion)) as found:
        assert np.abs(found.coverage[0] - np.clip(parts, 0, 1)).max() <= 0.5 / 255 + 1e-6


def test_a_clip_of_no_frames(motion: Trajectory, tmp_path: Path) -> None:
    for kept in (False, True):
        with footage(Store(tmp_path), "guidance-a", filming([], motion)) as found:
            assert list(found.rgb) == []
            assert found.kept == kept


@contextmanager
def no_file_over(size: int) -> Iterator[None]:
    """The system refuses to write more, as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("room", [0, 1, 3000, 12_000, 25_000])
def test_a_full_disk_fails_nobody(room: int, motion: Trajectory, tmp_path: Path) -> None:
    told: list[Problem] = []
    store, frames = Store(tmp_path, warn=told.append), pictures("noise")
    with no_file_over(room):
        for _ in range(2):
            with footage(store, "guidance-a", filming(frames, motion)) as found:
                assert agrees(found, frames, motion)
                assert not found.kept
    assert store.sizes() == []
    assert list(tmp_path.glob(".*.part")) == []
    assert len(told) == 1
    assert "cannot be written" in str(told[0])
    with footage(store, "guidance-a", filming(frames, motion)) as found:
        pass
    assert len(store.sizes()) == 1


def test_without_a_store_and_without_a_folder(motion: Trajectory, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    frames = pictures("photo")
    for store in (None, Store(tmp_path / "file")):
        with footage(store, "guidance-a", filming(frames, motion)) as found:
            assert agrees(found, frames, motion)


def test_frames_outlive_the_folder(motion: Trajectory, tmp_path: Path) -> None:
    store, frames = Store(tmp_path / "stages"), pictures("photo")
    for _ in range(2):  # just filmed, and found
        with footage(store, "guidance-a", filming(frames, motion)):
            pass
        with footage(store, "guidance-a", filming([], motion)) as found:
            shutil.rmtree(tmp_path / "stages")
            assert agrees(found, frames, motion)
    with footage(store, "guidance-a", filming(frames, motion)) as found:
        shutil.rmtree(tmp_path / "stages")
        assert agrees(found, frames, motion)


@pytest.mark.parametrize("file", ["pictures.bin", "trajectory.npz", "footage.json"])
def test_a_damaged_one_is_filmed_again(file: str, motion: Trajectory, tmp_path: Path) -> None:
    store, frames = Store(tmp_path), pictures("photo")
    with footage(store, "guidance-a", filming(frames, motion)):
        pass
    path = tmp_path / "guidance-a" / file
    path.write_bytes(path.read_bytes()[:-7])
    for kept in (False, True):
        with footage(store, "guidance-a", filming(frames, motion)) as found:
            assert found.kept == kept
            assert agrees(found, frames, motion)


def test_nothing_is_kept_of_a_clip_that_failed(motion: Trajectory, tmp_path: Path) -> None:
    def film(add: Add) -> tuple[Trajectory, dict[str, object]]:
        add(*pictures("photo")[0])
        raise KeyboardInterrupt

    store = Store(tmp_path)
    with pytest.raises(KeyboardInterrupt), footage(store, "guidance-a", film):
        pass
    assert store.sizes() == []
    assert list(tmp_path.glob(".*.part")) == []


def test_what_was_saved_meanwhile_is_not_kept_and_can_be_read(motion: Trajectory, tmp_path: Path) -> None:
    store, frames = Store(tmp_path), pictures("photo")
    with footage(store, "guidance-a", filming(frames, motion), lambda: False) as found:
        assert agrees(found, frames, motion)
    assert store.sizes() == []
    assert list(tmp_path.glob(".*.part")) == []


def test_frames_of_two_sizes_are_refused(motion: Trajectory) -> None:
    frames = [pictures("photo")[0], pictures("photo", 1, (30, 40))[0]]
    with (
        pytest.raises(ValueError, match="frame 1 of 40 x 30 px"),
        footage(None, "", filming(frames, motion)),
    ):
        pass
