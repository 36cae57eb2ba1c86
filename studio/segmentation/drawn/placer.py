"""Sets things down: which way up, how large, on what, clear of what already stands there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .build import Kind, Model, about
from .canvas import Pose
from .hand import Array, Hand
from .kinds import KINDS, NAMES, SEEN_BEFORE_A_WALL, WEIGHTS
from .parts import Part
from .room import Room
from .scene import Item, Scene

LAY: dict[str, Callable[[Hand], Array]] = {
    "stand": lambda hand: about("y", 0),
    "lie": lambda hand: about("z", 90),
    "side": lambda hand: about("z", 90),
    "flat": lambda hand: about("x", -90),
    "lean": lambda hand: (
        about("z", hand.one_of([-1, 1]) * hand.between(8, 40))
        @ about("x", hand.between(-12, 0))
    ),
}


class Placer:
    """Sets things on the floor of a room, or at a height above it, clear of each other."""

    def __init__(self, hand: Hand, room: Room, scene: Scene) -> None:
        self.hand, self.room, self.scene = hand, room, scene
        self.taken: list[tuple[float, float, float, float]] = []
        self.names: list[str] = []

    def nearness(self, y: float) -> float:
        """Things farther up a slanting floor look smaller."""
        if self.room.tilt > 1.2 or self.room.horizon < 0:
            return 1.0
        return 0.7 + 0.45 * (y - self.room.horizon) / max(
            self.room.size - self.room.horizon, 1
        )

    def kind(self, side_view: bool = False) -> Kind:
        while True:
            chosen = self.hand.one_of(NAMES, WEIGHTS)
            if not side_view or chosen in SEEN_BEFORE_A_WALL:
                return KINDS[chosen]

    def put(
        self, kind: Kind, x: float, y: float, px: float, *, pose: str | None = None, yaw: float | None = None, height: float = 0.0,
        clear: float | None = 0.9, model: Model | None = None, lay: Array | None = None,
    ) -> tuple[float, float] | None:  # fmt: skip
        """Set one thing, its longest edge `px`, its foot at pixel (x, y) of the floor and `height` px above it.

        Returns its height and half-width in px; None when it would stand in another by more than `clear` allows.
        """
        hand = self.hand
        made = model or kind.make(hand)
        if pose is None:
            pose = hand.one_of(kind.poses)
            if pose == "flat" and self.room.tilt < 0.25 and "lean" in kind.poses:
                pose = "lean"  # lying, it would be a line
        turn = hand.between(-180, 180) if yaw is None else yaw
        world = about("y", turn) @ (LAY[pose](hand) if lay is None else lay)
        hull = made.hull @ world.T
        low, high = hull.min(axis=0), hull.max(axis=0)
        scale = px / float((high - low).max())
        low, high = low * scale, high * scale
        spot = self.room.on_floor(x, y)
        half_x, half_z = float(high[0] - low[0]) / 2, float(high[2] - low[2]) / 2
        world_z = y / float(np.sin(self.room.tilt))
        if self.room.horizon > 0 and height == 0:
            world_z = max(world_z, self.room.wall + half_z)  # not in the wall
            spot = self.room.camera @ np.array([x, 0, world_z], np.float32)
        if clear is not None:
            for a, b, c, d in self.taken:
                if (
                    max(
                        abs(x - a) / (half_x + c + 1e-6),
                        abs(world_z - b) / (half_z + d + 1e-6),
                    )
                    < clear
                ):
                    return None
            self.taken.append((x, world_z, half_x, half_z))
        offset = np.array(
            [-(low[0] + high[0]) / 2, height - low[1], -(low[2] + high[2]) / 2],
            np.float32,
        )
        at = (spot + self.room.camera @ offset).astype(np.float32)
        self.scene.add(
            Item(
                made,
                Pose((self.room.camera @ world).astype(np.float32), at, scale),
                name=kind.name,
            )
        )
        self.names.append(kind.name)
        return float(high[1] - low[1]), half_x

    def anywhere(self) -> tuple[float, float]:
        """A pixel of the floor, at times just outside the picture."""
        size, top = self.room.size, max(self.room.horizon, 0)
        return self.hand.between(-0.03, 1.03) * size, self.hand.between(
            top + 0.06 * (size - top), size * 1.06
        )

    def length(self, kind: Kind, px_per_cm: float, most: float) -> float:
        """Px of such a thing; nearly life-size beside others, yet none too small to see."""
        natural = kind.cm * px_per_cm * self.hand.between(0.8, 1.25)
        return float(np.clip(natural, 12, most))

    def furniture(self, parts: list[Part], pose: Pose) -> None:
        self.scene.add(Item(Model(tuple(parts)), pose, movable=False))
