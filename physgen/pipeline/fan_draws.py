"""The draws of a fan: outcomes of uncertain values."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physgen import report, simulate
from physgen.export.video_formats import U8

if TYPE_CHECKING:
    from physgen.compile.world import World
    from physgen.simulate.uncertainty import Ensemble, Verdict

TABLE = "fan.csv"
"""Name of the table of all draws in a clip's folder."""


@dataclass(frozen=True)
class Draws:
    """Simulations with drawn values, and their summary."""

    ensemble: Ensemble
    verdicts: list[Verdict]

    def as_dict(self) -> dict[str, Any]:
        """Return the summary for the manifest."""
        ensemble = self.ensemble
        drawn_values = []
        for doubt in ensemble.doubts:
            drawn_values.append(
                {
                    "path": doubt.path,
                    "value": doubt.value,
                    "from": doubt.source.text,
                    "sure": doubt.source.confidence,
                    "alike": doubt.shared_variance,
                }
            )
        return {
            "draws": len(ensemble.outcomes),
            "seed": ensemble.seed,
            "simulated": len(ensemble.complete_draws),
            "verdict": simulate.uncertainty.headline(ensemble, self.verdicts),
            "objects": {verdict.name: verdict.as_dict() for verdict in self.verdicts},
            "drawn": drawn_values,
            "failures": list(map(str, ensemble.failures)),
            "table": TABLE,
        }

    def save(self, folder: Path) -> None:
        """Write the table of all draws."""
        (folder / TABLE).write_text(self.ensemble.table(), encoding="utf-8")

    def section(self, world: World, first: U8) -> dict[str, Any]:
        """Return the section of the report."""
        return report.uncertainty.uncertainty_section(
            self.ensemble, self.verdicts, world, first
        )
