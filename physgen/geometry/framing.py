"""Which part of the photo the video shows: sizes, centre and zoom."""

from __future__ import annotations

from math import floor

Size = tuple[int, int]
"""Width and height, px."""
Point = tuple[float, float]


def video_size(photo: Size, scale: float | None, size: Size | None) -> Size:
    """What `render.scale` or `render.size` make of a photo's size; as large as the photo without them.

    >>> video_size((960, 541), 0.5, None)
    (480, 271)
    """
    if size is not None:
        return size
    width, height = (max(1, floor(side * (scale or 1.0) + 0.5)) for side in photo)
    return width, height


def magnification(photo: Size, video: Size, zoom: float) -> float:
    """Video pixels a photo pixel: the photo covers the video, and more so zoomed in.

    >>> magnification((960, 540), (480, 480), 2.25)
    2.0
    """
    return zoom * max(video[0] / photo[0], video[1] / photo[1])


def room(photo: Size, video: Size, zoom: float) -> tuple[Point, Point]:
    """Least and greatest x and y, px, of centres from which the view does not leave the photo.

    >>> room((200, 100), (100, 100), 1.0)
    ((49.5, 49.5), (149.5, 49.5))
    """
    large = magnification(photo, video, zoom)
    low, high = [], []
    for side, seen in zip(photo, video, strict=True):
        half, middle = seen / (2 * large), (side - 1) / 2
        low.append(min(half - 0.5, middle))  # where there is no room, a rounding must not make less
        high.append(max(side - 0.5 - half, middle))
    return (low[0], low[1]), (high[0], high[1])


def held(center: Point, photo: Size, video: Size, zoom: float) -> Point:
    """The nearest centre to `center` from which the view does not leave the photo.

    >>> held((0.0, 50.0), (200, 100), (100, 100), 1.0)
    (49.5, 49.5)
    """
    low, high = room(photo, video, zoom)
    x, y = (min(max(c, a), b) for c, a, b in zip(center, low, high, strict=True))
    return x, y


def affine(photo: Size, video: Size, center: Point, zoom: float) -> tuple[float, Point]:
    """Scale s and shift t of photo px x -> video px s x + t, with `center` in the video's middle.

    >>> affine((100, 50), (200, 100), (49.5, 24.5), 1.0)
    (2.0, (0.5, 0.5))
    """
    large = magnification(photo, video, zoom)
    x, y = ((side - 1) / 2 - large * c for side, c in zip(video, center, strict=True))
    return large, (x, y)
