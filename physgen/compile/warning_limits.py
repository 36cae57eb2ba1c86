"""Thresholds of warnings about a compiled scene, and the form of a warning."""

from __future__ import annotations

from dataclasses import dataclass

from physgen.messages import Message
from physgen.problems import Problem
from physgen.scene.scene import Scene


@dataclass(frozen=True)
class WarningLimits:
    """Thresholds of warnings."""

    # Invisible shift of a camera view, px.
    view_shift: float = 0.5
    # Reach of soft coverage beyond a mask's border, px.
    reach: int = 5
    # Approximate number of named overlapping pairs; further ones are counted.
    pairs: int = 200
    # Overlap at t = 0 that the engine resolves invisibly, px.
    overlap: float = 0.25
    filled_margin: float = 42 / 512
    """Distance from covered pixels in which `background.png` may differ from the photo,
    in longer sides of the photo: rims and contact shadows are filled there.
    """
    mean_side: int = 5
    """Side of the squares for mean differences, px. Artefacts of compression vanish in
    the mean.
    """
    # Minimum mean difference of an edited pixel, grey levels.
    levels: int = 8
    # Minimum number of connected edited pixels: 8 x 8 px.
    min_pixels: int = 64
    max_missed_share: float = 0.03
    """Maximum share of a mask outside its shape, or of a shape beyond every visible
    object.
    """
    mask_reach: float = 0.08
    """Maximum reach of a mask beyond the hull of its shape, in square roots of its
    area.

    The photo also shows a top, an inside or a near rim.
    """
    # Maximum width of threads and wires without a shape, px.
    thread_width: int = 5
    # One minute of video at 30 frames a second: longer clips are seldom intended.
    frames: int = 1800
    # Invisible change of a start velocity by joints, as a share.
    start_change: float = 0.01
    min_gravity: float = 0.1
    """Minimum strength of gravity, in strengths on Earth. The Moon has 0.17; a weaker
    value is m/s² without the unit.
    """
    fall: float = 0.2
    """Maximum fall within one step, px. Beyond it, stacks sink by 0.4 px or more."""
    most_steps: float = 1e5
    """Maximum number of steps to suggest, 1/s."""
    # Minimum distance of the farthest point from the centre, px: a smaller object fills
    # no pixel.
    visible: float = 0.5
    # Approximate time for a frame of 512 x 512 px and its files on two cores of 2020,
    # s.
    draws: float = 0.03
    support: float = 4.0
    """Maximum gap between an object and its support, px. Outlines and floors of photos
    deviate by as much.
    """


LIMITS = WarningLimits()


def warning(
    scene: Scene, path: str, value_text: str, message: Message, **values: object
) -> Problem:
    """Return a warning at the place of `path` in the file."""
    return message.warning(scene.place(path), path, value_text, **values)
