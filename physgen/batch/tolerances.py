"""Options and tolerances of a golden test. Imported in every pytest session: the standard library only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Motion:
    """How far objects may be from where they were, at any sample.

    The same machine gives the same bytes. Another kind of processor rounds differently, by far less than the defaults
    unless the motion is chaotic: then only the time before chaos can be compared (`until`).
    """

    px: float = 0.1
    """Of the centre of mass, in the photo."""
    degrees: float = 0.1
    """Of the angle, with whole turns, and of the rotation of a sphere on a table."""
    px_per_s: float | None = None
    """Of the velocity. None: not kept; an impact a little earlier changes velocities at once, positions hardly."""
    degrees_per_s: float | None = None
    """Of the spin."""


@dataclass(frozen=True)
class Pixels:
    """How far kept frames may differ, at their kept size. Both conditions must hold."""

    levels: float = 8
    """Grey levels of 255: a pixel differs where any of its channels differs by more."""
    share: float = 0.001
    """Of a frame's pixels that may differ."""
    mean: float = 0.2
    """Grey levels: the mean difference of a frame, for a faint change everywhere, as of a light."""


MOTION, PIXELS = Motion(), Pixels()
FRAMES = 6
SIDE = 192
"""px of a kept frame's longer side: 6 frames of a photo are 40 to 95 kB."""


@dataclass(frozen=True)
class GoldenOptions:
    """What a golden test keeps and compares."""

    overrides: Sequence[str] = ()
    """`KEY=VALUE`, as `--set` takes them."""
    variant: str | None = None
    allow_outside: bool = False
    frames: int | Sequence[int] = FRAMES
    """How many, evenly spread from the first to the last; or which, counted from 0."""
    side: int = SIDE
    motion: Motion | None = MOTION
    """None: motion is neither kept nor compared."""
    pixels: Pixels | None = PIXELS
    """None: no frames are."""
    until: float | None = None
    """s: nothing later is kept or compared."""

    def __post_init__(self) -> None:
        if self.motion is None and self.pixels is None:
            raise ValueError("motion and pixels are None: nothing would be compared; leave one of them out")
