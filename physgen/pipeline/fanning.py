"""Scene + Compiled -> what the photo decides of the motion: draws of what is uncertain, and what is told of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physgen.pipeline.stages import fan as draw_fan
from physgen.pipeline.watch import Progress, Warn
from physgen.problems import Problem, Severity

if TYPE_CHECKING:
    from physgen.compile.assemble import Compiled
    from physgen.fan.fan import Fan
    from physgen.fan.lights import Shadows
    from physgen.fan.verdict import Verdict
    from physgen.report.fanned import Section
    from physgen.scene.model import Scene

TABLE = "fan.csv"
"""Of all draws, in a clip's folder."""


@dataclass(frozen=True)
class Fanned:
    """A fan, and what is told of it."""

    scene: Scene
    compiled: Compiled
    fan: Fan
    verdicts: list[Verdict]
    shadows: Shadows | None

    def told(self) -> dict[str, Any]:
        """For the manifest."""
        from physgen.fan.verdict import headline

        return {
            "draws": len(self.fan.outcomes),
            "seed": self.fan.seed,
            "simulated": len(self.fan.whole),
            "verdict": headline(self.fan, self.verdicts),
            "objects": {verdict.name: verdict.as_dict() for verdict in self.verdicts},
            "light": None if self.shadows is None else self.shadows.as_dict(),
            "drawn": [
                {
                    "path": doubt.path,
                    "value": doubt.value,
                    "from": doubt.source.text,
                    "sure": doubt.source.sure,
                    "distribution": doubt.spread.name,
                    "alike": doubt.alike,
                }
                for doubt in self.fan.doubts
            ],
            "failures": [str(problem) for problem in self.fan.failures],
            "table": TABLE,
        }

    def save(self, folder: Path) -> None:
        """The table of all draws."""
        (folder / TABLE).write_text(self.fan.table(), encoding="utf-8")

    def section(self) -> Section:
        """For the page."""
        from physgen.report.fanned import section

        return section(self.fan, self.verdicts, self.shadows, self.compiled.world)


def fanned(
    scene: Scene,
    compiled: Compiled,
    count: int,
    seed: int,
    variant: str | None,
    progress: Progress,
    warn: Warn,
) -> Fanned | None:
    """`count` draws; None, and a warning, where nothing of the scene is uncertain."""
    from physgen.fan.fan import uncertain
    from physgen.fan.lights import shadows
    from physgen.fan.verdict import verdicts

    if not uncertain(scene, variant):
        fix = 'say who guessed a number and how sure, as in from: {mass: "by eye 0.6"}; perceive does'
        what = "so every draw would be the same and none is made"
        warn(
            Problem(
                scene.place("objects"),
                "--fan",
                "nothing in the scene is uncertain,",
                what,
                fix,
                Severity.WARNING,
            )
        )
        return None
    made = draw_fan(scene, compiled, count, seed, variant, progress)
    return Fanned(scene, compiled, made, verdicts(made), shadows(scene, made))
