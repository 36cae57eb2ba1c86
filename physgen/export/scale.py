"""A scene -> what its pixels, grams and seconds are in SI units, where somebody has said how large it is."""

from __future__ import annotations

from dataclasses import dataclass

from physgen.scene.model import Scene

ASSUMED = "assumed"
"""Nobody has said; 100 px/m, which gravity is reckoned with, is the paper's convention and no measurement."""


@dataclass(frozen=True)
class Scale:
    """Pixels by metres."""

    pixels_per_meter: float
    source: str
    """Who said so: `written`, or `ASSUMED`."""

    @classmethod
    def of(cls, scene: Scene) -> Scale:
        """As the scene has it, by its file, a variant or `--set`."""
        written = "world.pixels_per_meter" in scene.places
        return cls(scene.world.pixels_per_meter, "written" if written else ASSUMED)

    @property
    def known(self) -> bool:
        """Whether lengths in metres mean something."""
        return self.source != ASSUMED

    def meters(self, px: float) -> float | None:
        """m, of px; m/s, of px/s; None where the scale is not known."""
        return px / self.pixels_per_meter if self.known else None

    def newton_seconds(self, impulse: float) -> float | None:
        """N·s of g·px/s; N of g·px/s²."""
        return impulse / 1000 / self.pixels_per_meter if self.known else None

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return {"pixels_per_meter": self.pixels_per_meter, "from": self.source}
