"""Videos and folders of pictures read back: against what was drawn, and against readers other than ours."""

from __future__ import annotations

import struct
import wave
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from PIL import Image
from pytest import approx

from physgen.export.video import Format, open_video
from physgen.problems import InputError
from physgen.videos import _pages, in_folder, read_video

COLOURS = [
    (128, 128, 128),
    (230, 200, 40),
    (20, 60, 120),
    (255, 255, 255),
    (0, 0, 0),
    (200, 30, 30),
    (30, 200, 30),
]
MATRICES = {1: (1.5748, 0.1873, 0.4681, 1.8556), 5: (1.402, 0.344136, 0.714136, 1.772)}
"""BT.709 and BT.601: what of V goes to red, of U and V from green, of U to blue."""


def drawn(size=(48, 32), count: int = 7) -> list[np.ndarray]:
    """Nothing in it looks the same turned or mirrored."""
    yy, xx = np.mgrid[: size[1], : size[0]]
    ramp = np.stack([xx * 4 % 256, yy * 6 % 256, 0 * xx + 90], axis=-1).astype(np.uint8)
    frames = []
    for k in range(count):
        frame = ramp.copy()
        frame[4:12, 2 + 3 * k : 10 + 3 * k] = (240, 220, 30)
        frames.append(frame)
    return frames


def written(
    folder: Path, kind: Format, frames: list[np.ndarray], fps: float = 24.0
) -> Path:
    folder.mkdir(exist_ok=True)
    with open_video(folder, kind, frames[0].shape[1::-1], fps) as put:
        for frame in frames:
            put(frame)
    return folder / kind.file


def bare_mp4(
    path: Path, frames: list[np.ndarray], tag: int | None, times=None, aspect=None
) -> Path:
    """As other programs write it: planes made by hand with one matrix, `tag` says which, or nothing."""
    red, gu, gv, blue = MATRICES[tag or 5]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = (
            frames[0].shape[1],
            frames[0].shape[0],
            "yuv420p",
        )
        stream.options = {"crf": "1"}
        if aspect:
            stream.codec_context.sample_aspect_ratio = aspect
        if tag:
            stream.codec_context.colorspace = tag
        stream.codec_context.time_base = Fraction(1, 100)
        for k, rgb in enumerate(frames):
            r, g, b = (rgb[..., c].astype(float) / 255 for c in range(3))
            y = (gu / blue * b + gv / red * r + g) / (1 + gu / blue + gv / red)
            planes = [
                16 + 219 * y,
                128 + 224 * (b - y)[::2, ::2] / blue,
                128 + 224 * (r - y)[::2, ::2] / red,
            ]
            frame = av.VideoFrame(rgb.shape[1], rgb.shape[0], "yuv420p")
            for plane, values in zip(frame.planes, planes, strict=True):
                padded = np.zeros((plane.height, plane.line_size), np.uint8)
                padded[:, : plane.width] = np.rint(values)
                plane.update(padded.tobytes())
            frame.pts, frame.time_base = (
                (times or [4 * i for i in range(len(frames))])[k],
                Fraction(1, 100),
            )
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def told(path: Path) -> str:
    with pytest.raises(InputError) as error:
        read_video(path)
    [problem] = error.value.problems
    return str(problem)


def test_what_we_write_comes_back_in_its_colours(tmp_path: Path) -> None:
    frames = [np.full((32, 48, 3), colour, np.uint8) for colour in COLOURS]
    clip = read_video(written(tmp_path, Format.MP4, frames))
    assert (clip.size, clip.count, clip.fps) == ((48, 32), 7, 24.0)
    for colour, frame in zip(COLOURS, clip.frames(), strict=True):
        assert frame[16, 24].astype(int) == approx(np.array(colour), abs=1)


@pytest.mark.parametrize("tag", [1, 5, None])
def test_colours_of_other_programs_are_read_by_their_own_matrix(
    tmp_path: Path, tag: int | None
) -> None:
    frames = [np.full((32, 48, 3), colour, np.uint8) for colour in COLOURS]
    clip = read_video(bare_mp4(tmp_path / "a.mp4", frames, tag))
    for colour, frame in zip(COLOURS, clip.frames(), strict=True):
        assert frame[16, 24].astype(int) == approx(np.array(colour), abs=2)


@pytest.mark.parametrize("size", [(48, 32), (47, 31)])
@pytest.mark.parametrize("kind", [Format.GIF, Format.WEBP])
def test_gif_and_webp_are_as_another_reader_sees_them(
    tmp_path: Path, size, kind: Format
) -> None:
    path = written(tmp_path, kind, drawn(size))
    clip = read_video(path)
    assert (clip.size, clip.fps) == (size, approx(24, rel=0.03))
    if kind is Format.GIF:
        with av.open(str(path)) as container:
            other = [
                frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)
            ]
    else:
        read, animation = cv2.imreadanimation(str(path))
        assert read
        other = [frame[..., 2::-1] for frame in animation.frames]
    assert np.array_equal(np.stack(list(clip.frames())), np.stack(other))
    assert np.abs(np.stack(other).astype(int) - drawn(size)).mean() < (
        8 if kind is Format.GIF else 5
    )
    with Image.open(path) as shown:
        assert shown.info["loop"] == 0, "for ever"


def test_a_png_that_plays_is_exact_and_lies_on_white(tmp_path: Path) -> None:
    frames = [
        np.dstack([frame, np.full(frame.shape[:2], 255, np.uint8)]) for frame in drawn()
    ]
    frames[3][:8, :8, 3] = 0
    pages = [Image.fromarray(frame) for frame in frames]
    pages[0].save(
        tmp_path / "a.png", save_all=True, append_images=pages[1:], duration=50
    )
    clip = read_video(tmp_path / "a.png")
    assert clip.fps == approx(20)
    wanted = drawn()
    wanted[3][:8, :8] = 255
    assert np.array_equal(np.stack(list(clip.frames())), wanted)


def test_a_folder_is_read_in_the_order_people_count(tmp_path: Path) -> None:
    frames = drawn(count=12)
    for k, frame in enumerate(frames):
        Image.fromarray(frame).save(tmp_path / f"f{k}.png")
    for other in ("notes.txt", ".hidden.png", "Thumbs.db"):
        (tmp_path / other).write_text("no picture")
    (tmp_path / "sub").mkdir()
    clip = read_video(tmp_path)
    assert np.array_equal(np.stack(list(clip.frames())), frames)
    assert clip.fps is None
    assert [p.name for p in in_folder(tmp_path)][-2:] == ["f10.png", "f11.png"]


def test_one_picture_is_a_video_of_one_frame(tmp_path: Path) -> None:
    Image.fromarray(drawn()[0]).save(tmp_path / "a.png")
    clip = read_video(tmp_path / "a.png")
    (frame,) = clip.frames()
    assert np.array_equal(frame, drawn()[0])


def turned(path: Path, a: int, b: int, c: int, d: int) -> Path:
    """The file with another display matrix: where its header has the identity."""
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 4 + 4 + 20 + 8 + 8
    assert struct.unpack(">9i", data[at : at + 36]) == (
        65536,
        0,
        0,
        0,
        65536,
        0,
        0,
        0,
        1 << 30,
    )
    x, y = 48 * (a < 0) + 32 * (c < 0), 32 * (d < 0) + 48 * (b < 0)
    data[at : at + 36] = struct.pack(
        ">9i", a << 16, b << 16, 0, c << 16, d << 16, 0, x << 16, y << 16, 1 << 30
    )
    other = path.with_name("turned.mp4")
    other.write_bytes(data)
    return other


@pytest.mark.parametrize(
    ("matrix", "turns"), [((0, 1, -1, 0), -1), ((-1, 0, 0, -1), 2), ((0, -1, 1, 0), 1)]
)
def test_a_phone_held_on_its_side_is_read_upright(
    tmp_path: Path, matrix, turns: int
) -> None:
    path = written(tmp_path, Format.MP4, drawn())
    clip, plain = read_video(turned(path, *matrix)), read_video(path)
    assert clip.size == ((48, 32) if turns == 2 else (32, 48))
    first, _, third, *_ = clip.frames()
    assert np.array_equal(third, np.rot90(list(plain.frames())[2], turns))
    seen = cv2.VideoCapture(str(path.with_name("turned.mp4"))).read()[1][..., ::-1]
    assert np.abs(first.astype(int) - seen).mean() < 3


def test_what_cannot_be_read_is_told_in_one_line(tmp_path: Path) -> None:
    assert (
        told(tmp_path / "no.mp4")
        == f"{tmp_path / 'no.mp4'}: no such file; check the path"
    )
    (tmp_path / "a.mp4").write_text("words, not pictures, and many of them")
    assert told(tmp_path / "a.mp4").startswith(
        f"{tmp_path / 'a.mp4'}: is not a video that can be read (invalid data"
    )
    assert told(tmp_path / "a.mp4").endswith(
        "; save it as MP4, GIF or WebP, or as a folder of PNG"
    )
    (tmp_path / "empty").mkdir()
    assert (
        told(tmp_path / "empty")
        == f"{tmp_path / 'empty'}: has no pictures; name a folder with one picture per frame"
    )
    with wave.open(str(tmp_path / "a.wav"), "wb") as sound:
        sound.setnchannels(1)
        sound.setsampwidth(2)
        sound.setframerate(8000)
        sound.writeframes(bytes(1600))
    assert (
        told(tmp_path / "a.wav")
        == f"{tmp_path / 'a.wav'}: has no moving picture; name a video"
    )


def test_frames_of_another_size_are_told_by_name(tmp_path: Path) -> None:
    for k, width in enumerate((48, 48, 40)):
        Image.fromarray(drawn()[0][:, :width]).save(tmp_path / f"{k}.png")
    expected = "40 x 32 px differs from the 48 x 32 px of the first frame; make all frames the same size"
    assert told(tmp_path) == f"{tmp_path / '2.png'}: {expected}"


def test_a_damaged_frame_is_told_before_anything_is_done(tmp_path: Path) -> None:
    path = written(tmp_path, Format.MP4, drawn((320, 240), 30))
    data = bytearray(path.read_bytes())
    start = data.index(b"mdat")
    for at in range(start + (len(data) - start) // 2, len(data)):
        data[at] = at * 97 % 256
    path.write_bytes(data)
    assert ": frame " in told(path)
    assert "cannot be decoded (" in told(path)
    pictures = written(tmp_path, Format.PNG, drawn())
    whole = (pictures / "00003.png").read_bytes()
    (pictures / "00003.png").write_bytes(whole[: len(whole) // 2])
    assert told(pictures).startswith(
        f"{pictures / '00003.png'}: is not a picture that can be read"
    )


def test_light_beyond_white_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=24)
        stream.width, stream.height, stream.pix_fmt = 48, 32, "yuv420p"
        stream.codec_context.color_trc = 16
        for frame in drawn():
            container.mux(
                stream.encode(
                    av.VideoFrame.from_ndarray(frame, format="rgb24").reformat(
                        format="yuv420p"
                    )
                )
            )
        container.mux(stream.encode(None))
    assert (
        told(path)
        == f"{path}: is a video of high dynamic range; tone-map it to standard range first"
    )


def test_a_playlist_opens_no_other_file(tmp_path: Path) -> None:
    """What it names would be read from anywhere on this machine, or fetched."""
    secret = written(tmp_path, Format.MP4, drawn())
    text = f"#EXTM3U\n#EXT-X-VERSION:7\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{secret}\n#EXT-X-ENDLIST\n"
    (tmp_path / "a.m3u8").write_text(text)
    (tmp_path / "a.ffconcat").write_text(f"ffconcat version 1.0\nfile '{secret}'\n")
    (tmp_path / "b.ffconcat").write_text(
        f"ffconcat version 1.0\nfile '{secret.name}'\n"
    )
    for name in ("a.m3u8", "a.ffconcat", "b.ffconcat"):
        assert "is not a video that can be read" in told(tmp_path / name)


def test_damaged_exif_data_keep_the_frames(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    pictures = []
    for _ in range(2):
        rgb = rng.integers(0, 255, (24, 32, 3)).astype(np.uint8)
        pictures.append(Image.fromarray(rgb))
    pictures[0].save(
        tmp_path / "clip.webp",
        save_all=True,
        append_images=pictures[1:],
        duration=[100, 200],
        lossless=True,
        exif=b"Exif\0\0XXXX",
    )
    frames = list(_pages(tmp_path / "clip.webp"))
    assert [frame.seconds for frame in frames] == [approx(0.1), approx(0.2)]
    for frame, picture in zip(frames, pictures, strict=True):
        assert np.array_equal(frame.rgb, np.asarray(picture))
