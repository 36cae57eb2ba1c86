"""px, s and g -> axes with units: the scene's own, SI beside them where the scene has a scale, or SI alone."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, log10
from typing import TYPE_CHECKING

from physgen.report.plots.look import Look
from physgen.scene.model import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Quantity:
    """What an axis is of."""

    own: str
    """Its unit in scenes."""
    si: str
    grams: int
    """Powers in it, of mass and of length."""
    pixels: int

    def per(self, meter: float) -> float:
        """How many of the scene's units one of SI is, `meter` px to the metre."""
        return float(1000.0**self.grams * meter**self.pixels)


LENGTH = Quantity("px", "m", 0, 1)
SPEED = Quantity("px/s", "m/s", 0, 1)
IMPULSE = Quantity("g·px/s", "N·s", 1, 1)
ENERGY = Quantity("g·px²/s²", "J", 1, 2)


@dataclass(frozen=True)
class Units:
    """Those of one figure."""

    meter: float | None
    """px to the metre; None: the scene has no scale."""
    si: bool
    """SI alone."""

    @property
    def beside(self) -> bool:
        """Whether SI stands beside the scene's own."""
        return self.meter is not None and not self.si

    def axis(self, of: Quantity, most: float) -> Axis:
        """For values up to `most` of the scene's units, either sign."""
        if self.meter is None:
            return Axis(*_own(of, most), None)
        one = of.per(self.meter)
        power = _thousands(most / one)
        beside = f"{PREFIXES[power]}{of.si}", one * 10.0**power
        return Axis(*beside, None) if self.si else Axis(*_own(of, most), beside)

    def said(self, of: Quantity, value: float, like: float | None = None) -> str:
        """A number with its unit, of SI where there is a scale; with the prefix that `like` would have."""
        if self.meter is None:
            return f"{value:.3g} {of.own}"
        value /= of.per(self.meter)
        measure = value if like is None else like / of.per(self.meter)
        power = next((p for p in (0, -3, -6) if measure >= 10.0 ** (p - 2)), -9) if measure < 1e4 else 3
        return f"{value / 10.0**power:.3g} {PREFIXES[power]}{of.si}"


@dataclass(frozen=True)
class Axis:
    """A unit, and another beside it."""

    unit: str
    size: float
    """How many of the scene's units it is."""
    beside: tuple[str, float] | None
    """The same of SI."""

    def name(self, axes: Axes, name: str, side: str = "y") -> None:
        """Label an axis; SI stands on the other side of it, where it is beside."""
        set_label = axes.set_ylabel if side == "y" else axes.set_xlabel
        set_label(f"{name} ({self.unit})")
        if self.beside is None:
            return
        unit, size = self.beside
        ratio = self.size / size
        pair = (lambda value: value * ratio, lambda value: value / ratio)
        if side == "y":
            axes.secondary_yaxis("right", functions=pair).set_ylabel(f"{name} ({unit})")
        else:
            axes.secondary_xaxis("top", functions=pair).set_xlabel(f"{name} ({unit})")


def units(scene: Scene, look: Look) -> Units:
    """A scene's: px alone where nobody has said how large they are, unless SI is asked for."""
    known = look.si or "world.pixels_per_meter" in scene.places
    return Units(scene.world.pixels_per_meter if known else None, look.si)


def _own(of: Quantity, most: float) -> tuple[str, float]:
    power = _thousands(most)
    if -3 <= power <= 3:
        return of.own, 1.0
    return f"10{str(power).translate(RAISED)} {of.own}", 10.0**power


def _thousands(most: float) -> int:
    """The power of a thousand that leaves 1 to 1000 of a number.

    >>> [_thousands(v) for v in (0.0, 0.02, 3.0, 1e5, 1e30)]
    [0, -3, 0, 3, 9]
    """
    if not most:
        return 0
    return min(max(3 * floor(log10(abs(most)) / 3 + 1e-9), min(PREFIXES)), max(PREFIXES))
