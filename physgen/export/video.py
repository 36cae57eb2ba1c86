"""Encode frames as MP4, GIF, WebP or a folder of PNG, as a stream, with the same bytes
on every run.
"""

from __future__ import annotations

import platform
import shutil
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from math import floor
from pathlib import Path
from types import TracebackType
from typing import Any

import av
import numpy as np
from av.error import FFmpegError
from numpy.typing import NDArray
from PIL import Image

from physgen.export.video_formats import I16 as I16
from physgen.export.video_formats import MAX_RATES as MAX_RATES
from physgen.export.video_formats import NO_ROOM as NO_ROOM
from physgen.export.video_formats import SOUND_RATE as SOUND_RATE
from physgen.export.video_formats import U8 as U8
from physgen.export.video_formats import Format as Format
from physgen.maps import write_png
from physgen.messages import Message
from physgen.problems import InputError, Problem

SOUND_BITS = 192_000
"""Bit rate of AAC, bit/s, without audible loss."""

X264 = {"crf": "14", "preset": "veryfast", "threads": "1"}
"""Settings of x264. At crf 17, blurred objects had specks. Bytes depend on the number
of threads: one thread serves single clips and batches.
"""
if platform.machine().lower() in ("x86_64", "amd64"):
    # The macroblock tree of x264 for AVX-512 reads uninitialised memory: one clip gave
    # two
    # streams. SSE4.2 is as fast, and older processors write the same bytes.
    X264["x264-params"] = "asm=SSE4.2"
PALETTE_FRAMES = 8
"""Number of first frames for a GIF's palette; frames are a stream."""


SUBSAMPLED = 420
"""Chroma layout of all browsers: one value for four pixels."""


@dataclass(frozen=True)
class Mp4Options:
    """Options of an MP4."""

    chroma: int = SUBSAMPLED
    """420 or 444: half or full resolution of colours on each side."""
    sound: I16 | None = None
    """(N, 2): left and right, `SOUND_RATE` samples/s."""


PLAIN_MP4 = Mp4Options()


MAX_SIDES = {Format.MP4: 16384, Format.WEBP: 16383, Format.GIF: 65535}
"""Maximum side of the encoders, px."""

HEADER = 4096
"""Number of bytes, more than the header of any format."""

# ---- clips with alpha: ProRes 4444, and VP9 in WebM
PRORES_OPTIONS = {"profile": "4444", "alpha_bits": "16", "vendor": "apl0"}
VP9_OPTIONS = {"crf": "8", "b": "0", "auto-alt-ref": "0", "cpu-used": "4"}
"""With this quality, layers reach 40 dB. Alpha does not allow hidden frames."""
ALPHA_WAYS = {
    ".mov": ("mov", "prores_ks", ("yuv444p10le", "yuva444p10le"), PRORES_OPTIONS),
    ".webm": ("webm", "libvpx-vp9", ("yuv444p", "yuva420p"), VP9_OPTIONS),
}
"""Container, encoder, pixel formats without and with alpha, and options."""
BITEXACT = 1 << 23
"""Encoder flag for a stream without the encoder's version."""

Write = Callable[[U8], None]
WAITING = 4
"""Maximum number of frames between drawing and encoding."""


@contextmanager
def open_video(
    folder: Path,
    kind: Format,
    size: tuple[int, int],
    fps: float,
    name: str = "video",
    mp4: Mp4Options = PLAIN_MP4,
) -> Iterator[Write]:
    """Yield a function that takes one (H, W, 3) sRGB frame after the other; `size` is
    (W, H) px, `fps` in 1/s.

    Above the rate of `MAX_RATES`, frames are left out, and the clip's duration stays.
    `mp4` has the options of an MP4; other formats ignore them.
    """
    max_side = MAX_SIDES.get(kind)
    place = f"--format {kind.value}"
    if max_side is not None and max(size) > max_side:
        found = f"{size[0]} x {size[1]} px"
        raise Message.SIDE_TOO_LONG.error(place, found, most=max_side)
    # Rates of television such as 30000/1001 stay exact fractions.
    source_rate = Fraction(fps).limit_denominator(1001)
    rate = min(source_rate, Fraction(MAX_RATES.get(kind, source_rate)))
    path = folder / kind.file_name(name)
    if kind is not Format.PNG:
        # PyAV crashes if a disk has no room for the header: test it first.
        path.write_bytes(bytes(HEADER))
    try:
        open_format: Callable[..., AbstractContextManager[Write]] = partial(
            _mp4, mp4=mp4
        )
        if kind is not Format.MP4:
            open_format = _opener(kind)
        with open_format(path, size, rate) as write:
            yield write if rate == source_rate else _resample(write, source_rate, rate)
    except FFmpegError as error:
        if error.errno in NO_ROOM:
            file = str(folder / kind.file)
            raise OSError(error.errno, error.strerror, file) from None
        found = f"{size[0]} x {size[1]} px at {fps:g} fps"
        reason = error.strerror or error
        raise Message.ENCODING_REFUSED.error(place, found, reason=reason) from None


def _opener(kind: Format) -> Callable[..., AbstractContextManager[Write]]:
    """Return the function that opens a file of a format without sound."""
    openers = {
        Format.GIF: _gif,
        Format.WEBP: _webp,
        Format.PNG: _png,
    }
    return openers[kind]


def _resample(write: Write, source_rate: Fraction, rate: Fraction) -> Write:
    """Return a function that writes the frames nearest to the times of a lower `rate`,
    1/s.
    """
    step = source_rate / rate
    frame_count = written_count = 0

    def write_nearest(rgb: U8) -> None:
        nonlocal frame_count, written_count
        # Fractions: floats would drift over a long clip.
        if frame_count == floor(written_count * step + Fraction(1, 2)):
            write(rgb)
            written_count += 1
        frame_count += 1

    return write_nearest


class FormatWriter:
    """Writes one format of a clip. After a failure, its file is removed and `problems`
    has the reason.

    Other formats continue. A full disk and a lack of memory affect all formats, so that
    these errors are raised.
    """

    def __init__(
        self,
        folder: Path,
        kind: Format,
        size: tuple[int, int],
        fps: float,
        name: str,
        mp4: Mp4Options = PLAIN_MP4,
    ) -> None:
        self.problems: Sequence[Problem] = ()
        self._format = kind.value
        self._path = folder / kind.file_name(name)
        self._video = open_video(folder, kind, size, fps, name, mp4)
        self._put: Write | None = None

    def __enter__(self) -> FormatWriter:
        try:
            self._put = self._video.__enter__()
        except InputError as error:
            self._abandon(error)
        return self

    def write(self, rgb: U8) -> None:
        """Write one (H, W, 3) sRGB frame, or nothing after a failure."""
        if self._put is None:
            return
        try:
            self._put(rgb)
        except Exception as error:
            self._close(error)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._put is None:
            return
        if error is not None:
            self._video.__exit__(kind, error, traceback)
            return
        try:
            self._video.__exit__(None, None, None)
        except (OSError, MemoryError):
            raise
        except Exception as failure:
            self._abandon(self._as_input_error(failure))

    def _close(self, error: Exception) -> None:
        """Close the file after an `error` of its encoder."""
        try:
            self._video.__exit__(type(error), error, error.__traceback__)
        except InputError as refusal:
            self._abandon(refusal)
            return
        if isinstance(error, OSError | MemoryError):
            raise error
        self._abandon(self._as_input_error(error))

    def _as_input_error(self, error: Exception) -> InputError:
        if isinstance(error, InputError):
            return error
        reason = str(error) or type(error).__name__
        refused = Message.ENCODING_REFUSED
        return refused.error(f"--format {self._format}", reason=reason)

    def _abandon(self, error: InputError) -> None:
        """Store the reason of the failure, and remove the file."""
        self.problems = error.problems
        self._put = None
        if self._path.is_dir():
            shutil.rmtree(self._path)
        self._path.unlink(missing_ok=True)


@contextmanager
def encode_in_thread(writes: Sequence[Write]) -> Iterator[Write]:
    """Yield a function that passes a frame to all `writes` and returns at once: a
    thread encodes the frame.

    At most `WAITING` frames wait. An encoding error is raised by a later call or at the
    end.
    """
    waiting: deque[Future[None]] = deque()

    def encode(rgb: U8) -> None:
        for write in writes:
            write(rgb)

    with ThreadPoolExecutor(1, "encode") as thread:

        def put(rgb: U8) -> None:
            # Waiting for the oldest frame bounds the memory, and raises its error
            # early.
            while waiting and (len(waiting) >= WAITING or waiting[0].done()):
                waiting.popleft().result()
            waiting.append(thread.submit(encode, rgb))

        try:
            yield put
            for future in waiting:
                future.result()
        except BaseException:
            # Drop the waiting frames.
            thread.shutdown(cancel_futures=True)
            raise


@contextmanager
def _mp4(
    path: Path, size: tuple[int, int], rate: Fraction, mp4: Mp4Options
) -> Iterator[Write]:
    """Yield a writer of H.264, BT.709. For odd sizes, the last column and row are
    repeated.
    """
    # Chroma of 4:2:0 has one sample for two columns and two rows, so that both
    # lengths of the picture must be even.
    width = size[0] + size[0] % 2
    height = size[1] + size[1] % 2
    options = {"fflags": "+bitexact", "movflags": "+faststart"}
    with av.open(str(path), "w", format="mp4", options=options) as container:
        stream = container.add_stream("libx264", rate=rate)
        layout = f"yuv{mp4.chroma}p"
        stream.width, stream.height, stream.pix_fmt = width, height, layout
        stream.options = dict(X264)
        context = stream.codec_context
        # FFmpeg numbers these: limited range and the BT.709 matrix are both 1, BT.709
        # primaries are 1, and 13 is the transfer function of sRGB.
        context.color_range, context.colorspace = 1, 1
        context.color_primaries, context.color_trc = 1, 13
        context.flags |= BITEXACT
        border = _padding(size)
        track = None
        if mp4.sound is not None:
            track = _SoundWriter(container, av.AudioFrame, mp4.sound)
        frame_count = 0

        def write(rgb: U8) -> None:
            nonlocal frame_count
            if size != (width, height):
                rgb = np.pad(rgb, border, mode="edge")
            even = np.ascontiguousarray(rgb)
            frame = av.VideoFrame.from_ndarray(even, format="rgb24")
            frame = frame.reformat(format=layout, dst_colorspace="ITU709")
            container.mux(stream.encode(frame))
            frame_count += 1
            if track is not None:
                track.write_until(float(frame_count / rate))

        yield write
        # Encoders hold frames back; encoding None writes those that remain.
        container.mux(stream.encode(None))
        if track is not None:
            track.close()


class _SoundWriter:
    """Encodes samples as AAC beside the frames of an open MP4."""

    def __init__(self, container: Any, frame_type: Any, sound: I16) -> None:
        self._container = container
        self._frame_type = frame_type
        self._sound = sound
        self._done = 0
        self._stream: Any = container.add_stream(
            "aac", rate=SOUND_RATE, layout="stereo"
        )
        self._stream.bit_rate = SOUND_BITS
        self._stream.codec_context.flags |= BITEXACT

    def write_until(self, time: float) -> None:
        """Encode the samples up to a time (s), so that both streams stay
        interleaved.
        """
        end = min(round(time * SOUND_RATE), len(self._sound))
        if end <= self._done:
            return
        part = self._sound[self._done : end].reshape(1, -1)
        frame = self._frame_type.from_ndarray(part, format="s16", layout="stereo")
        frame.sample_rate = SOUND_RATE
        # Time stamps count the samples before the frame.
        frame.pts = self._done
        frame.time_base = Fraction(1, SOUND_RATE)
        self._container.mux(self._stream.encode(frame))
        self._done = end

    def close(self) -> None:
        """Encode the remaining samples."""
        self.write_until(len(self._sound) / SOUND_RATE)
        self._container.mux(self._stream.encode(None))


@contextmanager
def _webp(path: Path, size: tuple[int, int], rate: Fraction) -> Iterator[Write]:
    with av.open(
        str(path), "w", format="webp", options={"loop": "0", "fflags": "+bitexact"}
    ) as container:
        stream = container.add_stream("libwebp_anim", rate=rate)
        stream.width, stream.height, stream.pix_fmt = *size, "bgra"
        stream.options = {"quality": "88", "compression_level": "2", "threads": "1"}

        def write(rgb: U8) -> None:
            frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
            container.mux(stream.encode(frame.reformat(format="bgra")))

        yield write
        # Encoders hold frames back; encoding None writes those that remain.
        container.mux(stream.encode(None))


@contextmanager
def _gif(path: Path, size: tuple[int, int], rate: Fraction) -> Iterator[Write]:
    """Yield a writer with one palette for all frames.

    GIF counts time in hundredths of a second: delays of 30 fps are 30 and 40 ms.
    """
    with av.open(
        str(path), "w", format="gif", options={"loop": "0", "fflags": "+bitexact"}
    ) as container:
        stream = container.add_stream("gif", rate=rate)
        stream.width, stream.height, stream.pix_fmt = *size, "pal8"
        first_frames: list[U8] = []
        palettes: list[tuple[Image.Image, U8]] = []
        """Empty before the choice of the palette, then one entry."""

        def put(rgb: U8) -> None:
            palette, table = palettes[0]
            dither = Image.Dither.FLOYDSTEINBERG
            picture = Image.fromarray(rgb).quantize(palette=palette, dither=dither)
            indexed: Any = (np.ascontiguousarray(np.asarray(picture)), table)
            frame = av.VideoFrame.from_ndarray(indexed, format="pal8")
            container.mux(stream.encode(frame))

        def flush() -> None:
            if not palettes and first_frames:
                picture = Image.fromarray(np.concatenate(first_frames))
                palette = picture.quantize(255)
                palettes.append((palette, _palette_table(palette)))
            for rgb in first_frames:
                put(rgb)
            first_frames.clear()

        def write(rgb: U8) -> None:
            if palettes:
                put(rgb)
                return
            first_frames.append(rgb)
            # The palette needs some frames; a clip may also end before.
            if len(first_frames) == PALETTE_FRAMES:
                flush()

        yield write
        flush()
        container.mux(stream.encode(None))


def _palette_table(palette: Any) -> U8:
    """Return the colours of a picture with a palette, (256, 4): alpha, then RGB."""
    colours = np.array(palette.getpalette(), np.uint8).reshape(-1, 3)
    table = np.zeros((256, 4), np.uint8)
    table[:, 0] = 255
    table[: len(colours), 1:] = colours
    return table


@contextmanager
def _png(path: Path, size: tuple[int, int], rate: Fraction) -> Iterator[Write]:
    path.mkdir(parents=True, exist_ok=True)
    count = 0

    def write(rgb: U8) -> None:
        nonlocal count
        write_png(path / f"{count:05d}.png", rgb)
        count += 1

    yield write


def _padding(size: tuple[int, int]) -> list[tuple[int, int]]:
    """Return the columns and rows that make a size (w, h) even, for `np.pad`."""
    width, height = size
    return [(0, height % 2), (0, width % 2), (0, 0)]


@contextmanager
def open_alpha_clip(
    path: Path, size: tuple[int, int], fps: float, channels: int
) -> Iterator[Callable[[NDArray[np.uint16]], None]]:
    """Yield a function that takes (h, w, 3) sRGB or (h, w, 4) straight alpha, 16 bits;
    `size` is (w, h).

    For odd sizes, the last column and row are repeated.
    """
    container_name, encoder, pixel_formats, options = ALPHA_WAYS[path.suffix]
    width = size[0] + size[0] % 2
    height = size[1] + size[1] % 2
    bitexact = {"fflags": "+bitexact"}
    with av.open(str(path), "w", format=container_name, options=bitexact) as container:
        stream: Any = container.add_stream(
            encoder, rate=Fraction(fps).limit_denominator(1001)
        )
        stream.width, stream.height = width, height
        stream.pix_fmt = pixel_formats[channels == 4]
        stream.options = {**options, "threads": "1"}
        context = stream.codec_context
        context.flags |= BITEXACT
        context.color_range, context.colorspace = 1, 1
        context.color_primaries, context.color_trc = 1, 13
        layout = "rgb48le"
        if channels == 4:
            layout = "rgba64le"

        def write(picture: NDArray[np.uint16]) -> None:
            border = _padding(size)
            even = np.ascontiguousarray(np.pad(picture, border, mode="edge"))
            frame = av.VideoFrame.from_ndarray(even, format=layout)
            frame = frame.reformat(
                format=stream.pix_fmt,
                dst_colorspace="ITU709",
                dst_color_range="MPEG",
            )
            container.mux(stream.encode(frame))

        yield write
        # Encoders hold frames back; encoding None writes those that remain.
        container.mux(stream.encode(None))


def sample_frames(path: Path, count: int, side: int) -> list[U8]:
    """Return up to `count` frames (H, W, 3) sRGB of an MP4 of `open_video`, evenly from
    first to last.

    Frames are at most `side` px long. Only these frames are converted, which is fast.
    Raise OSError for an unreadable file.
    """
    samples = []
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            places = np.linspace(0, stream.frames - 1, count)
            numbers = set(places.round().astype(int).tolist())
            scale = min(side / max(stream.width, stream.height), 1.0)
            width = max(round(stream.width * scale), 1)
            height = max(round(stream.height * scale), 1)
            # Frames depend on frames before them, so all are decoded, but only those of
            # the sample are converted to RGB and made smaller.
            for number, frame in enumerate(container.decode(stream)):
                if number in numbers:
                    small = frame.reformat(width, height, "rgb24", interpolation="AREA")
                    samples.append(np.asarray(small.to_ndarray(), np.uint8))
    except (av.error.FFmpegError, IndexError) as error:
        raise OSError(f"{path} cannot be read: {error}") from error
    return samples
