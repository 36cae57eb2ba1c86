"""What happens in a clip, one thing at a time: kinds of events, and an event."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from physgen.scene.model import Point


class Happening(Enum):
    """Kinds of events, in the order in which those of one moment are told."""

    MOVING = "moving"
    """It moves when the clip starts."""
    OUTSIDE = "outside"
    """It is wholly outside the picture when the clip starts."""
    STAY = "stay"
    """It stays where it is for the whole clip."""
    PUSH = "push"
    """An impulse is given to it."""
    PUSH_START = "push_start"
    """A force or torque begins to act."""
    PUSH_END = "push_end"
    CONTACT = "contact"
    """Two things touch, until `until`."""
    COLLISION = "collision"
    """A blow between two things."""
    FIRST_TOUCH = "first_touch"
    """It meets, for the first time, something that it did not touch from the start."""
    MOVE = "move"
    """What stood still starts to move: it goes on to move by more than `alone.SHIFT`."""
    FALL = "fall"
    """The same where nothing touches, holds or pushes it: gravity alone moves it."""
    TIP = "tip"
    """It has turned by 45 degrees away from how it stood; no balls and discs, and seen from the side alone."""
    LEAVE = "leave"
    """The last of it leaves the picture."""
    ENTER = "enter"
    """The first of it comes into the picture."""
    REST = "rest"
    """It has moved, and rests from then on."""
    GOES_ON = "goes_on"
    """It still moves when the clip ends."""


@dataclass(frozen=True)
class Event:
    """One thing that happens. Surfaces are counted as in `World.surfaces`: bodies, then walls."""

    kind: Happening
    time: float
    """s of the motion."""
    who: tuple[int, ...]
    """One surface, or the two of a contact or collision; of a first touch, who it is and whom it meets."""
    at: Point | None = None
    """px of the photo: where they touch, or the push acts; the centre of mass where an object does something alone."""
    until: float | None = None
    """s: the end of a contact or of a lasting push; None: it outlasts the clip, or has no length."""
    impulse: float | None = None
    """g·px/s: of a collision or an impulse; what presses for longer is not in it."""
    vector: Point | None = None
    """Of a collision the unit vector in which the second pushes the first; of a push g·px/s or g·px/s²; px/s of what
    moves."""
    torque: float | None = None
    """g·px²/s²."""
    before: tuple[float, ...] = ()
    """px/s: speed of each of `who` just before a collision."""
    after: tuple[float, ...] = ()
    """px/s: just after."""
    nearing: tuple[float, float] | None = None
    """px/s at which the point of each that meets the other's comes nearer just before a collision, along `vector`."""
    parting: float | None = None
    """px/s at which they part after it."""
    far: float | None = None
    """px by which what moves or starts to comes away from where it was at t = 0, or its rim turns, at most."""
    side: str = ""
    """Of the picture, where something leaves or comes in: left, right, top or bottom."""

    @property
    def closing(self) -> float:
        """px/s at which the points that meet come together before a collision."""
        return 0.0 if self.nearing is None else sum(self.nearing)
