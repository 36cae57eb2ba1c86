"""The view of a photo in a video: sizes, magnification, and centres inside the
photo.
"""

from __future__ import annotations

from math import floor

Size = tuple[int, int]
"""Width and height, px."""
Point = tuple[float, float]
"""x px, y px."""


def video_size(photo: Size, scale: float | None, size: Size | None) -> Size:
    """Return the size of the video from `render.scale` or `render.size`, or the photo's
    size.

    >>> video_size((960, 541), 0.5, None)
    (480, 271)
    """
    if size is not None:
        return size
    width, height = (max(1, floor(side * (scale or 1.0) + 0.5)) for side in photo)
    return width, height


def magnification(photo: Size, video: Size, zoom: float) -> float:
    """Return the video pixels per photo pixel. At zoom 1, the photo just covers the
    video.

    >>> magnification((960, 540), (480, 480), 2.25)
    2.0
    """
    return zoom * max(video[0] / photo[0], video[1] / photo[1])


def room(photo: Size, video: Size, zoom: float) -> tuple[Point, Point]:
    """Return the smallest and largest centre (x, y), px, of views inside the photo.

    >>> room((200, 100), (100, 100), 1.0)
    ((49.5, 49.5), (149.5, 49.5))
    """
    large = magnification(photo, video, zoom)
    low, high = [], []
    for side, visible_length in zip(photo, video, strict=True):
        # Half of the visible length, in pixels of the photo.
        half_share = visible_length / (2 * large)
        middle = (side - 1) / 2
        # Without room, rounding must not exclude the middle.
        low.append(min(half_share - 0.5, middle))
        high.append(max(side - 0.5 - half_share, middle))
    return (low[0], low[1]), (high[0], high[1])


def confine_center(center: Point, photo: Size, video: Size, zoom: float) -> Point:
    """Return the nearest centre to `center` of a view inside the photo.

    >>> confine_center((0.0, 50.0), (200, 100), (100, 100), 1.0)
    (49.5, 49.5)
    """
    low, high = room(photo, video, zoom)
    x, y = (min(max(c, a), b) for c, a, b in zip(center, low, high, strict=True))
    return x, y


def affine(photo: Size, video: Size, center: Point, zoom: float) -> tuple[float, Point]:
    """Return scale s and shift t from photo px x to video px s x + t, with `center` in
    the video's middle.

    >>> affine((100, 50), (200, 100), (49.5, 24.5), 1.0)
    (2.0, (0.5, 0.5))
    """
    large = magnification(photo, video, zoom)
    # Pixel centres are integers, so that the middle of the video is (side - 1)/2.
    x, y = ((side - 1) / 2 - large * c for side, c in zip(video, center, strict=True))
    return large, (x, y)
