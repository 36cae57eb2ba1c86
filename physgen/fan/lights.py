"""Draws of the light's direction -> where shadows fall in them, and how far shading turns; in sentences."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.fan.fan import Fan
from physgen.fan.spread import widest
from physgen.fan.statistics import MOST, wilson
from physgen.fan.verdict import percent
from physgen.scene.model import Scene, View
from physgen.shadow.cast import LOWEST

Array = NDArray[np.float64]

STRAIGHT = 0.1
"""px sideways for a px of height, up to which a shadow falls to neither side."""


@dataclass(frozen=True)
class Shadows:
    """What N draws of the light do to shadows and shading."""

    said: str
    """Who found the light, and how sure."""
    apart: float
    """degrees from the file's direction within which 9 of 10 draws lie."""
    own: Array
    """(2,) px in the photo by which the shadow of a thing 1 px high reaches, as the file has it."""
    drawn: Array
    """(N, 2): the same of each draw."""
    sides: tuple[tuple[str, int], ...]
    """Whither shadows fall, and in how many draws; the most frequent first."""
    own_light: Array
    """(3,) the file's direction."""
    lights: Array
    """(N, 3)."""

    def sentences(self) -> list[str]:
        """What of it the photo decides."""
        total = len(self.drawn)
        side, count = self.sides[0]
        low, high = (percent(end) for end in wilson(count, total))
        lines = [
            f"Light ({self.said}): 9 of 10 draws come from within {self.apart:.0f}° of the file's direction. "
            "It moves nothing, but shadows and shading turn with it."
        ]
        if count == total:
            lines.append(f"Decided by the photo: shadows fall {side} in all {total} draws.")
        else:
            others = ", ".join(f"{other} in {n}" for other, n in self.sides[1:])
            lines.append(
                f"Not decided: shadows fall {side} in {count} of {total} draws ({percent(count / total)}, "
                f"95 % interval {low} to {high}), {others}."
            )
        long = np.hypot(*self.drawn.T)
        low_long, high_long = np.quantile(long, [(1 - MOST) / 2, (1 + MOST) / 2])
        lines.append(
            f"A thing 100 px high throws one of {100 * low_long:.0f} to {100 * high_long:.0f} px in 9 of 10 draws; "
            f"the file's light one of {100 * float(np.hypot(*self.own)):.0f} px."
        )
        return lines

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "from": self.said,
            "within_degrees": round(self.apart, 2),
            "shadows": dict(self.sides),
            "verdict": " ".join(self.sentences()),
        }


def shadows(scene: Scene, fan: Fan) -> Shadows | None:
    """None where the light is certain, or there is none."""
    if fan.light is None or scene.light is None:
        return None
    own = _reach(np.array([scene.light.direction]), scene)[0]
    drawn = _reach(fan.directions, scene)
    sides = [_side(reach, scene.world.view) for reach in drawn]
    counts = {side: sides.count(side) for side in dict.fromkeys(sides)}
    told = fan.light.source
    return Shadows(
        said=f"{told.text}, {percent(told.sure or 0.0)} sure",
        apart=float(np.degrees(widest(fan.light.cone.concentration, MOST))),
        own=own,
        drawn=drawn,
        sides=tuple(sorted(counts.items(), key=lambda item: -item[1])),
        own_light=np.array(scene.light.direction),
        lights=fan.directions,
    )


def _reach(lights: Array, scene: Scene) -> Array:
    """(N, 2) px of the photo by which a shadow reaches for each px of height: on the floor, or on the table.

    As `shadow.cast` has it: light that is lower than `LOWEST` throws no longer ones.
    """
    x, y, z = lights.T
    if scene.world.view is View.TOP:
        rise = np.maximum(z, LOWEST)
        return np.stack([-x / rise, -y / rise], axis=1)
    rise = np.maximum(-y, LOWEST)
    return np.stack([-x / rise, -z / rise * _tilt(scene)], axis=1)


def _tilt(scene: Scene) -> float:
    """px of the photo for a px of the floor's depth."""
    return float(np.tan(np.radians(scene.world.tilt)))


def _side(reach: Array, view: View) -> str:
    """Whither a shadow falls: of a table seen from above, the nearest of four ways."""
    across, along = reach.tolist()
    if view is View.TOP and abs(along) > abs(across):
        across, sides = along, ("up", "down")
    else:
        sides = ("to the left", "to the right")
    return "to neither side" if abs(across) <= STRAIGHT else sides[across > 0]
