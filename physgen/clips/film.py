"""A video's file -> its frames, upright, in sRGB: whatever container, codec and colours FFmpeg's libraries read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.clips.shown import Shown, over_white
from physgen.pictures import MOST_PIXELS
from physgen.problems import InputError

U8 = NDArray[np.uint8]

HIGH = 720
"""Lines from which on colours that name no matrix are BT.709's, as players have it; BT.601's below."""
UNNAMED = 2
BEYOND_WHITE = (16, 18)
"""Transfers PQ and HLG (ITU-T H.273)."""
AGAIN = "save it as MP4, GIF or WebP, or as a folder of PNG"


@dataclass(frozen=True)
class Told:
    """What a file says of itself."""

    fps: float | None
    """1/s."""
    remarks: tuple[tuple[str, str], ...]
    """What does not come along, and what is done instead."""


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """Container and stream of moving pictures. Raises InputError."""
    import av
    from av.error import FFmpegError

    with path.open("rb") as file:
        try:
            # by its bytes alone: a playlist that names other files, or addresses, opens none of them
            container = av.open(file, options={"protocol_whitelist": "none"}, metadata_errors="replace")
        except FFmpegError as error:
            reason = (error.strerror or str(error)).lower()
            raise InputError.of(str(path), "", f"is not a video that can be read ({reason})", AGAIN) from None
        with container:
            streams = [s for s in container.streams.video if not s.disposition & s.disposition.attached_pic]
            if not streams:
                raise InputError.of(str(path), "", "has no moving picture", "name a video")
            stream = streams[0]
            if stream.width * stream.height > MOST_PIXELS:
                found = f"{stream.width} x {stream.height} px"
                raise InputError.of(str(path), found, "is over 100 megapixels", "make the video smaller")
            yield container, stream


def told(path: Path) -> Told:
    """Rate, and what is lost. Raises InputError."""
    with _opened(path) as (container, stream):
        rate = stream.average_rate or stream.guessed_rate
        remarks = []
        if container.streams.audio:
            remarks.append(("has sound", "the new video has none"))
        shape = stream.sample_aspect_ratio
        if shape and shape != 1:
            remarks.append((f"has pixels of {shape} times their height", "the new video's are square"))
        return Told(float(rate) if rate else None, tuple(remarks))


def plays_anywhere(path: Path) -> bool:
    """Whether every browser plays what is in it: H.264 of 8 bits, 4:2:0. Raises InputError."""
    with _opened(path) as (_, stream):
        codec = stream.codec_context
        return codec.name == "h264" and codec.pix_fmt in ("yuv420p", "yuvj420p")


def frames(path: Path) -> Iterator[Shown]:
    """From the first one on. Raises InputError where one cannot be decoded."""
    from av.error import FFmpegError

    count = 0
    with _opened(path) as (container, stream):
        stream.thread_type = "AUTO"
        try:
            for frame in container.decode(stream):
                if frame.color_trc in BEYOND_WHITE:
                    fix = "tone-map it to standard range first"
                    raise InputError.of(str(path), "", "is a video of light beyond white", fix)
                seconds = float(frame.duration * frame.time_base) if frame.duration else None
                yield Shown(_turned(_rgb(frame), frame), seconds, f"{path}: frame {count}")
                count += 1
        except FFmpegError as error:
            reason = (error.strerror or str(error)).lower()
            place = f"{path}: frame {count}"
            raise InputError.of(place, "", f"cannot be decoded ({reason})", AGAIN) from None


def _rgb(frame: Any) -> U8:
    """(H, W, 3) sRGB, as stored. Rounded, not cut: libswscale's quick way is a code or two too dark."""
    from av.video.reformatter import Colorspace, Interpolation

    clear = any(part.is_alpha for part in frame.format.components)
    exact = Interpolation.ACCURATE_RND | Interpolation.FULL_CHR_H_INT | Interpolation.BITEXACT
    matrix = None
    if frame.colorspace == UNNAMED:
        matrix = Colorspace.ITU709 if frame.height >= HIGH else Colorspace.ITU601
    picture = frame.reformat(
        format="rgba" if clear else "rgb24",
        src_colorspace=matrix,
        interpolation=Interpolation.BILINEAR | exact,
    ).to_ndarray()
    return over_white(picture) if clear else np.asarray(picture, np.uint8)


def _turned(rgb: U8, frame: Any) -> U8:
    """Upright, as the file's display matrix has it: (x, y) goes to (a x + c y, b x + d y)."""
    data = frame.side_data.get("DISPLAYMATRIX")
    if data is None:
        return rgb
    (a, b, _), (c, d, _), _ = np.frombuffer(bytes(data), np.int32).reshape(3, 3)
    if a == d == 0:
        rgb = rgb.swapaxes(0, 1)
    elif not b == c == 0:
        return rgb  # neither upright nor on a side: nobody films so
    rgb = rgb[:, ::-1] if a + c < 0 else rgb
    return np.ascontiguousarray(rgb[::-1] if b + d < 0 else rgb)
