"""Read videos, pictures and folders of pictures as frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import av
import imageio.v3 as iio
import numpy as np
from av.error import FFmpegError
from av.video.reformatter import Colorspace, Interpolation
from PIL import Image

from physgen.arrays import U8 as U8
from physgen.messages import Message
from physgen.phone_formats import recognise
from physgen.photos import open_picture, over_white, read_photo
from physgen.problems import Limit, Place
from physgen.text import natural

SUFFIXES = (
    ".png",
    ".jpg",
    ".jpeg",
    ".webp",
    ".bmp",
    ".tif",
    ".tiff",
    ".ppm",
    ".pgm",
    ".pnm",
    ".avif",
    ".heic",
    ".heif",
    ".jxl",
)
"""Of pictures in a folder; other files are passed over."""
SIGNATURES = (
    b"\x89PNG",
    b"\xff\xd8\xff",
    b"GIF8",
    b"BM",
    b"II*\0",
    b"MM\0*",
    *(b"P%d" % k for k in range(1, 7)),
)
"""First bytes by which pictures are recognised; those of WebP stand at byte 8. FFmpeg reads other ones."""
ANIMATED = ("GIF", "WEBP", "PNG")
"""Formats of Pillow that may be animated; FFmpeg decodes no animated WebP."""
DEFAULT_DURATION = 0.1
"""s for which a frame of a GIF without a duration is shown, as browsers do."""
HD_LINES = 720
"""Lines from which on colours without a named matrix are BT.709's, as in players; BT.601's below."""
UNNAMED_MATRIX = 2
HDR_TRANSFERS = (16, 18)
"""PQ and HLG (ITU-T H.273)."""
CONVERT = "save it as MP4, GIF or WebP, or as a folder of PNG"


class VideoFrame(NamedTuple):
    """A frame, upright."""

    rgb: U8
    """(H, W, 3) sRGB."""
    seconds: float | None
    """Duration; None where the file has none."""
    place: str
    """As messages name it: its file, or the video's with its number from 0."""


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open the container and the stream of moving pictures. Raises InputError."""
    with path.open("rb") as file:
        # A playlist must not name other files or addresses.
        options = {"protocol_whitelist": "none"}
        try:
            container = av.open(file, options=options, metadata_errors="replace")
        except FFmpegError as error:
            reason = (error.strerror or str(error)).lower()
            raise Message.VIDEO_UNREADABLE.error(str(path), reason=reason) from None
        with container:
            stream = _moving_stream(container, path)
            if stream.width * stream.height > Limit.PIXELS.most:
                size = f"{stream.width} x {stream.height} px"
                raise Limit.PIXELS.error(Place(str(path)), found=size)
            yield container, stream


def _moving_stream(container: Any, path: Path) -> Any:
    """Return the first stream that is not a cover picture. Raises InputError."""
    for stream in container.streams.video:
        disposition = stream.disposition
        if not disposition & disposition.attached_pic:
            return stream
    raise Message.VIDEO_WITHOUT_PICTURES.error(str(path))


def _decoded_frames(path: Path) -> Iterator[VideoFrame]:
    """Yield the frames of a video. Raises InputError if a frame cannot be decoded."""
    count = 0
    with _opened(path) as (container, stream):
        stream.thread_type = "AUTO"
        try:
            for frame in container.decode(stream):
                yield _video_frame(frame, path, count)
                count += 1
        except FFmpegError as error:
            reason = (error.strerror or str(error)).lower()
            place = f"{path}: frame {count}"
            raise Message.FRAME_DAMAGED.error(place, reason=reason) from None


def _video_frame(frame: Any, path: Path, number: int) -> VideoFrame:
    """Convert a decoded frame. Raises InputError for a high dynamic range."""
    if frame.color_trc in HDR_TRANSFERS:
        raise Message.VIDEO_HIGH_RANGE.error(str(path))
    seconds = None
    if frame.duration:
        seconds = float(frame.duration * frame.time_base)
    rgb = _upright(_rgb(frame), frame)
    return VideoFrame(rgb, seconds, f"{path}: frame {number}")


def _rgb(frame: Any) -> U8:
    """Convert a frame to (H, W, 3) sRGB, as stored.

    libswscale's default rounding is a code or two too dark.
    """
    interpolation = (
        Interpolation.BILINEAR
        | Interpolation.ACCURATE_RND
        | Interpolation.FULL_CHR_H_INT
        | Interpolation.BITEXACT
    )
    matrix = None
    if frame.colorspace == UNNAMED_MATRIX:
        matrix = Colorspace.ITU709 if frame.height >= HD_LINES else Colorspace.ITU601
    has_alpha = any(part.is_alpha for part in frame.format.components)
    picture = frame.reformat(
        format="rgba" if has_alpha else "rgb24",
        src_colorspace=matrix,
        interpolation=interpolation,
    ).to_ndarray()
    return over_white(picture)[0] if has_alpha else np.asarray(picture, np.uint8)


def _upright(rgb: U8, frame: Any) -> U8:
    """Apply the file's display matrix: (x, y) goes to (a x + c y, b x + d y)."""
    data = frame.side_data.get("DISPLAYMATRIX")
    if data is None:
        return rgb
    (a, b, _), (c, d, _), _ = np.frombuffer(bytes(data), np.int32).reshape(3, 3)
    if a == d == 0:
        rgb = rgb.swapaxes(0, 1)
    elif not b == c == 0:
        return rgb  # not a multiple of 90 degrees
    rgb = rgb[:, ::-1] if a + c < 0 else rgb
    return np.ascontiguousarray(rgb[::-1] if b + d < 0 else rgb)


@dataclass(frozen=True)
class Video:
    """A video whose every frame could be decoded; its sound is not read."""

    path: Path
    size: tuple[int, int]
    """Width and height, px."""
    fps: float | None
    """1/s, the mean where frames are shown for different times.

    None: pictures, which have no time.
    """
    count: int
    """Of its frames."""
    durations: tuple[float | None, ...] = ()
    """s for which each frame is shown; None where the file does not tell."""

    def frames(self) -> Iterator[U8]:
        """Return an iterator of (H, W, 3) sRGB, decoded as they are read."""
        return (frame.rgb for frame in video_frames(self.path))


def read_video(path: Path) -> Video:
    """Read all frames once, to count and to check them. Raises InputError."""
    start, fps = _source(path)
    size = None
    seconds = []
    for frame in start():
        height, width = frame.rgb.shape[:2]
        size = size or (width, height)
        if size != (width, height):
            raise Message.FRAME_SIZE.error(
                frame.place, f"{width} x {height} px", width=size[0], height=size[1]
            )
        seconds.append(frame.seconds)
    if size is None:
        raise Message.VIDEO_EMPTY.error(str(path))
    durations = [s for s in seconds if s]
    if fps is None and durations:
        fps = len(durations) / sum(durations)
    return Video(path, size, fps, len(seconds), tuple(seconds))


def video_frames(path: Path) -> Iterator[VideoFrame]:
    """Return the frames of a video or a picture, unchecked. Raises InputError."""
    return _source(path)[0]()


def _source(path: Path) -> tuple[Callable[[], Iterator[VideoFrame]], float | None]:
    """Return a function that decodes from the first frame on; and frames per second, if known."""
    if path.is_dir():
        pictures = in_folder(path)
        return lambda: map(_still, pictures), None
    if is_picture(path):
        if plays(path):
            return lambda: _pages(path), None
        return lambda: iter([_still(path)]), None
    with _opened(path) as (_, stream):
        rate = stream.average_rate or stream.guessed_rate
    return lambda: _decoded_frames(path), float(rate) if rate else None


def in_folder(folder: Path) -> list[Path]:
    """Return the pictures of a folder in the natural order of their names.

    Raises InputError if there are none.
    """
    pictures = [path for path in folder.iterdir() if _is_frame_file(path)]
    if not pictures:
        raise Message.FOLDER_WITHOUT_PICTURES.error(str(folder))
    return sorted(pictures, key=lambda path: natural(path.name))


def _is_frame_file(path: Path) -> bool:
    is_hidden = path.name.startswith(".")
    return path.suffix.lower() in SUFFIXES and not is_hidden and path.is_file()


def is_picture(path: Path) -> bool:
    """Return whether a file is a picture, by its first bytes; it may be animated.

    Raises InputError if there is no file.
    """
    if not path.is_file():
        raise Message.NO_SUCH_FILE.error(str(path), fix="check the path")
    with path.open("rb") as file:
        head = file.read(16)
    is_sequence = head[8:12] in (b"avis", b"hevc", b"hevx", b"msf1")
    if recognise(path) is not None and not is_sequence:
        return True
    return head.startswith(SIGNATURES) or head[8:12] == b"WEBP"


def plays(picture: Path) -> bool:
    """Return whether a picture is animated. Raises InputError."""
    with open_picture(picture) as image:
        return image.format in ANIMATED and getattr(image, "n_frames", 1) > 1


def _still(path: Path) -> VideoFrame:
    return VideoFrame(read_photo(path).rgb, None, str(path))


def _pages(path: Path) -> Iterator[VideoFrame]:
    """Yield the frames of an animated picture."""
    with (
        open_picture(path) as image,
        path.open("rb") as file,
        iio.imopen(file, "r", plugin="pillow") as opened,
    ):
        reader: Any = opened  # its type lacks the plugin's arguments
        for k in range(int(getattr(image, "n_frames", 1))):
            place = f"{path}: frame {k}"
            try:
                rgba = reader.read(index=k, mode="RGBA")
                duration = float(reader.metadata(index=k).get("duration") or 0)
            except Exception:
                # damaged EXIF data raise errors of many kinds; a second reader decides
                rgba, duration = _decoded_page(image, k, place)
            yield VideoFrame(
                over_white(rgba)[0], duration / 1000 or DEFAULT_DURATION, place
            )


def _decoded_page(image: Image.Image, index: int, place: str) -> tuple[U8, float]:
    """Return a frame (H, W, 4) and its duration, ms, without EXIF data. Raises InputError."""
    try:
        image.seek(index)
        rgba = np.asarray(image.convert("RGBA"))
        duration = float(image.info.get("duration") or 0)
    except (EOFError, OSError, SyntaxError, ValueError):
        raise Message.PAGE_DAMAGED.error(place) from None
    return rgba, duration
