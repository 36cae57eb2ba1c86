"""How a scene is filmed, played, drawn over and retouched: `render:` and `refine:`; frozen."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from physgen.scene.model.things import Point


class Overlay(Enum):
    """What is drawn over finished frames, for teaching."""

    OUTLINES = "outlines"
    """Of the objects' shapes."""
    VELOCITY = "velocity"
    """Arrows from the centres."""
    FORCES = "forces"
    """The scene's forces, impulses and torques while they act."""
    WEIGHT = "weight"
    """Arrows from the centres, on the forces' scale."""
    TRAILS = "trails"
    """Where the centres have been."""
    CONTACTS = "contacts"
    """Where things touch, and rings where they strike."""
    BOUNDARIES = "boundaries"
    """Walls and floors."""
    NAMES = "names"
    """At the centres."""


class Play(Enum):
    """Which way a clip runs."""

    FORWARD = "forward"
    BACKWARD = "backward"
    THERE_AND_BACK = "there-and-back"


@dataclass(frozen=True)
class Sight:
    """One view of the camera; one alone holds from the first frame to the last."""

    time: float
    """s of the motion at which it is reached."""
    center: Point | None
    """px of the photo; None: its middle, or whom it follows."""
    follow: str | None
    """Name of an object."""
    zoom: float


@dataclass(frozen=True)
class Render:
    """`render:`."""

    fps: float
    frames: int | None
    """None: fps x duration x slow, rounded. Given: t_k = k duration / frames, and fps only says how fast it plays."""
    relight: bool
    shadows: bool
    motion_blur: float
    overlay: tuple[Overlay, ...]
    slow: float
    play: Play
    scale: float | None
    size: tuple[int, int] | None
    """Width and height of the video, px; at most one of scale and size is given."""
    camera: tuple[Sight, ...]
    """In the order of their times; empty: all of the photo."""
    supersample: int


@dataclass(frozen=True)
class Refine:
    """`refine:`."""

    backend: str
    strength: float
    stop: int
    steps: int
    seed: int
    prompt: str | None
    """None: made of the objects' labels."""
    negative: str
    guidance: float | None
    """None: as the model's authors advise."""
    lock: float
    detail: float
