"""Events -> the words that sentences about them are made of: who, when, where to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, pi

from physgen.compile.world import World
from physgen.export.telling.event import Event, Happening
from physgen.export.telling.nouns import Nouns
from physgen.scene.model import Point, View

SOON = 0.01
"""s of the clip: nobody sees that something happens so early, and not at the start."""
COMPASS = ("right", "down and right", "down", "down and left", "left", "up and left", "up", "up and right")
"""Of image axes, from +x on towards +y."""
AWAY = {"left": "on the left", "right": "on the right", "top": "at the top", "bottom": "at the bottom"}
INTO = {"left": "from the left", "right": "from the right", "top": "from above", "bottom": "from below"}
SQUARE = 0.95
"""Height by width from which on a thing stands: of a square, neither side is the longer one."""
LIFTS = 0.2
"""Of the speed at which things met: where they part faster, they bounce."""


@dataclass(frozen=True)
class Speech:
    """What all sentences about a clip share."""

    world: World
    nouns: Nouns
    pace: float
    """s of the clip that a second of the motion takes."""

    def when(self, time: float) -> str:
        """Of a moment of the motion, in s of the clip: that is what a viewer sees.

        A clip that is played backward or to and fro is told of as it runs forward.
        """
        shown = time * self.pace
        return "at the start" if shown < SOON else f"after {seconds(shown)}"

    def whens(self, times: Sequence[float]) -> str:
        """When each of several did what they did: of all alike, or of the last."""
        first, last = self.when(min(times)), self.when(max(times))
        return f" {last}" if first == last else f", the last one {last}"

    def stands(self, event: Event) -> str:
        """What tipping looks like: `tips over`, of what is as high as wide; lower things only tilt."""
        rim = [point for ring in self.world.bodies[event.who[0]].rings for point in ring]
        width = max(x for x, _ in rim) - min(x for x, _ in rim)
        height = max(y for _, y in rim) - min(y for _, y in rim)
        return "tip" if height >= SQUARE * width else "tilt"

    def towards(self, vector: Point) -> str:
        """`to the right`, `up and to the left`."""
        sector = COMPASS[round(atan2(vector[1], vector[0]) / (pi / 4)) % 8]
        words = sector.replace("right", "to the right").replace("left", "to the left")
        if self.world.view is View.SIDE:
            return words
        return words.replace("up", "up the picture").replace("down", "down the picture")

    def hitter(self, event: Event) -> tuple[int, int]:
        """Of a collision, who hits and who is hit: who comes up faster hits; a wall never does."""
        (one, other), (mine, its) = event.who, event.nearing or (0.0, 0.0)
        return (one, other) if other >= len(self.world.bodies) or mine >= its else (other, one)

    def bounces(self, event: Event) -> bool:
        """Whether a blow sends off again what hit something that cannot move."""
        struck = self.hitter(event)[1]
        return struck >= len(self.world.bodies) and (event.parting or 0.0) > LIFTS * event.closing > 0

    def shoved(self, event: Event) -> tuple[str, str]:
        """What is done to what is pushed, to one thing and to several: `is pushed to the right`."""
        if event.vector is not None:
            done = f"pushed {self.towards(event.vector)}"
        else:
            done = "turned clockwise" if (event.torque or 0.0) > 0 else "turned counterclockwise"
        return f"is {done}", f"are {done}"


def seconds(time: float) -> str:
    """To a hundredth.

    >>> seconds(0.4), seconds(1.234), seconds(12)
    ('0.4 s', '1.23 s', '12 s')
    """
    return f"{time:.2f}".rstrip("0").rstrip(".") + " s"


def times(slow: float) -> str:
    """How much slower a clip runs.

    >>> times(4.0), times(2.55), times(0.5)
    ('4 times slower', '2.5 times slower', '2 times faster')
    """
    factor, word = (slow, "slower") if slow >= 1 else (1 / slow, "faster")
    return f"{factor:.2g} times {word}"


def capital(text: str) -> str:
    """With a capital letter; nothing else changes."""
    return text[:1].upper() + text[1:]


AT_ONCE = "right away"
"""When something starts by itself; not `starts at the start`."""
ALONE = {
    Happening.OUTSIDE: "is outside the picture when the clip starts",
    Happening.STAY: "does not move in this clip",
    Happening.MOVE: "starts to move",
    Happening.FALL: "starts to fall",
    Happening.REST: "comes to rest",
    Happening.GOES_ON: "still moves when the clip ends",
}
"""What one object does, and that is all."""
