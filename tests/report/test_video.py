"""Every video format read back by a reader other than the one that wrote it."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from fractions import Fraction
from pathlib import Path
from time import sleep

import av
import cv2
import numpy as np
import pytest
from PIL import Image
from pytest import approx

from physgen.export import video
from physgen.export.video import (
    Format,
    FormatWriter,
    encode_in_thread,
    open_video,
)
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
    capture = cv2.VideoCapture(str(write(tmp_path, Format.MP4, size)))
    assert capture.get(cv2.CAP_PROP_FPS) == approx(30)
    for frame in clip(*size):
        found, bgr = capture.read()
        assert found
        rgb = bgr[: size[1], : size[0], ::-1].astype(int)
        assert np.abs(rgb - frame).mean() < 4
        assert rgb[32, 60] == approx(frame[32, 60].astype(int), abs=6)
    assert not capture.read()[0]


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
        InputError, match="17000 x 4 px is over the 16384 px per side of this format"
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


# ---- rates ----


def numbered(count: int):
    """Frames with their index in binary, as eight black or white bars."""
    for index in range(count):
        bits = [255 * (index >> bit & 1) for bit in range(8)]
        row = np.repeat(np.array(bits, np.uint8), 4)
        yield np.tile(row[None, :, None], (16, 1, 3))


def number(rgb: np.ndarray) -> int:
    bars = rgb[8, 2::4, 0] > 127
    return int(sum(2**bit for bit, is_white in enumerate(bars) if is_white))


def write_numbered(folder: Path, kind: Format, count: int, fps: float) -> Path:
    with open_video(folder, kind, (32, 16), fps) as put:
        for frame in numbered(count):
            put(frame)
    return folder / kind.file


def delays_by_pillow(path: Path) -> list[int]:
    """Delay of each frame, ms."""
    delays = []
    with Image.open(path) as image:
        for index in range(image.n_frames):
            image.seek(index)
            image.load()
            delays.append(int(image.info["duration"]))
    return delays


RATES = [1, 7, 12.5, 23.976, 29.97, 30, 48, 50, 59.94, 60, 90, 100, 120, 240, 1000]


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize(("kind", "least"), [(Format.GIF, 20), (Format.WEBP, 11)])
def test_delays_play_in_browsers_and_keep_duration(
    tmp_path: Path, fps: float, kind: Format, least: int
) -> None:
    count = min(max(round(fps), 3), 240)
    delays = delays_by_pillow(write_numbered(tmp_path, kind, count, fps))
    assert min(delays) >= least
    assert max(delays) <= max(1000 / fps + 10, least + 1)
    assert sum(delays) == approx(1000 * count / fps, abs=least)


@pytest.mark.parametrize("fps", [30, 60, 100, 144, 240, 1000])
def test_gif_frames_show_their_own_times(tmp_path: Path, fps: float) -> None:
    path = write_numbered(tmp_path, Format.GIF, 240, fps)
    with av.open(str(path)) as container:
        frames = list(container.decode(video=0))
    for frame in frames:
        index = number(frame.to_ndarray(format="rgb24"))
        assert index == approx(float(frame.time) * fps, abs=0.5 + 0.005 * fps)
    duration = frames[-1].time + frames[-1].duration * frames[-1].time_base
    assert float(duration) == approx(240 / fps, abs=0.02)


@pytest.mark.parametrize("fps", [29.97, 60, 240, 1000])
def test_mp4_holds_every_frame(tmp_path: Path, fps: float) -> None:
    path = write_numbered(tmp_path, Format.MP4, 50, fps)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert float(stream.duration * stream.time_base) == approx(50 / fps, rel=1e-3)
        assert len(list(container.decode(stream))) == 50


# ---- formats that fail ----


def test_failed_format_leaves_others_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opener = video._gif

    @contextmanager
    def failing(path: Path, size: tuple[int, int], rate: Fraction):
        with opener(path, size, rate):
            frames = iter(range(3))

            def write(rgb: np.ndarray) -> None:
                if next(frames, None) is None:
                    raise av.error.ValueError(22, "Invalid argument")

            yield write

    monkeypatch.setattr(video, "_gif", failing)
    kinds = [Format.GIF, Format.MP4, Format.PNG]
    writers = [FormatWriter(tmp_path, kind, (96, 64), 30.0, "video") for kind in kinds]
    with ExitStack() as files:
        for writer in writers:
            files.enter_context(writer)
        for frame in clip(96, 64):
            for writer in writers:
                writer.write(frame)
    [problem] = writers[0].problems
    assert "gif" in str(problem)
    assert not any(writer.problems for writer in writers[1:])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["frames", "video.mp4"]
    assert (
        cv2.VideoCapture(str(tmp_path / "video.mp4")).get(cv2.CAP_PROP_FRAME_COUNT)
        == COUNT
    )
    assert len(list((tmp_path / "frames").iterdir())) == COUNT


def test_full_disk_is_no_fault_of_one_format(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def failing(path: Path, size: tuple[int, int], rate: Fraction):
        def write(rgb: np.ndarray) -> None:
            raise OSError(28, "No space left on device")

        yield write

    monkeypatch.setattr(video, "_gif", failing)
    with (
        pytest.raises(OSError, match="No space"),
        FormatWriter(tmp_path, Format.GIF, (96, 64), 30.0, "video") as writer,
    ):
        writer.write(np.zeros((64, 96, 3), np.uint8))
