"""Every video format read back by a reader other than the one that wrote it."""

from __future__ import annotations

from pathlib import Path
from time import sleep

import cv2
import numpy as np
import pytest
from PIL import Image
from pytest import approx

from physgen.export.video import Format, encode_in_thread, open_video
from physgen.problems import InputError

COUNT = 24


def clip(width: int, height: int):
    """A square that moves one pixel a frame over a colour ramp."""
    yy, xx = np.mgrid[:height, :width]
    ramp = np.stack(
        [xx * 200 // width, yy * 200 // height, 100 + 0 * xx], axis=-1
    ).astype(np.uint8)
    for k in range(COUNT):
        frame = ramp.copy()
        frame[8:24, 4 + k : 20 + k] = (230, 200, 40)
        yield frame


def write(folder: Path, kind: Format, size=(96, 64), fps=30.0) -> Path:
    folder.mkdir(exist_ok=True)
    with open_video(folder, kind, size, fps) as put:
        for frame in clip(*size):
            put(frame)
    return folder / kind.file


@pytest.mark.parametrize("size", [(96, 64), (97, 65)])
def test_mp4_read_by_opencv(tmp_path: Path, size: tuple[int, int]) -> None:
    video = cv2.VideoCapture(str(write(tmp_path, Format.MP4, size)))
    assert video.get(cv2.CAP_PROP_FPS) == approx(30)
    for frame in clip(*size):
        found, bgr = video.read()
        assert found
        rgb = bgr[: size[1], : size[0], ::-1].astype(int)
        assert np.abs(rgb - frame).mean() < 4
        assert rgb[32, 60] == approx(frame[32, 60].astype(int), abs=6)
    assert not video.read()[0]


def test_png_frames_are_exact(tmp_path: Path) -> None:
    folder = write(tmp_path, Format.PNG)
    for path, frame in zip(sorted(folder.iterdir()), clip(96, 64), strict=True):
        assert np.array_equal(np.asarray(Image.open(path)), frame)


@pytest.mark.parametrize("kind", list(Format))
def test_the_same_bytes_every_run(tmp_path: Path, kind: Format) -> None:
    one, two = write(tmp_path / "one", kind), write(tmp_path / "two", kind)
    for a, b in (
        zip(sorted(one.iterdir()), sorted(two.iterdir()), strict=True)
        if one.is_dir()
        else [(one, two)]
    ):
        assert a.read_bytes() == b.read_bytes()


def test_pictures_larger_than_an_encoder_takes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match="17000 x 4 px is over the 16384 px that it allows a side"
    ):
        open_video(tmp_path, Format.MP4, (17000, 4), 30).__enter__()
    assert not list(tmp_path.iterdir())


def test_frames_wait_in_line_and_all_arrive_in_order() -> None:
    seen: list[int] = []

    def slow(rgb: np.ndarray) -> None:
        sleep(0.002)
        seen.append(int(rgb[0, 0, 0]))

    with encode_in_thread([slow]) as put:
        for k in range(30):
            put(np.full((1, 1, 3), k, np.uint8))
    assert seen == list(range(30))


def test_a_full_disk_stops_the_frames_and_is_told_once() -> None:
    made: list[int] = []

    def full(rgb: np.ndarray) -> None:
        raise OSError(28, "No space left on device")

    def draw() -> None:
        with encode_in_thread([full]) as put:
            for k in range(10_000):
                made.append(k)
                put(np.zeros((1, 1, 3), np.uint8))

    with pytest.raises(OSError, match="No space"):
        draw()
    assert len(made) < 10_000, "it went on for nobody"
