"""Runs the closed forms on our engine and on others."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import numpy as np

from physgen.compile.world import World
from physgen.evaluate.physics import ROWS, examples
from physgen.evaluate.physics.scorecard import (
    DRAWS,
    Row,
    evaluate,
    run_draw,
    write_scenes,
)
from physgen.simulate.trajectory import Trajectory

from .engines import ENGINES, Unsupported, make

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "benchmarks" / "results" / "physics.json"
PATIENCE = 60
"""s that a second engine may take for one draw."""


def physics(folder: Path) -> list[dict]:
    """The scorecard; results of other engines are kept from the last time. Writes scenes/physics/ too."""
    scenes = ROOT / "scenes" / "physics"
    scenes.mkdir(exist_ok=True)
    for old in scenes.glob("*.yaml"):
        old.unlink()
    for name, text in examples():
        (scenes / name).write_text(text)
    rows = evaluate(ROWS, workers=os.cpu_count() or 1)
    before = json.loads(RESULT.read_text())["rows"] if RESULT.exists() else []
    known = {
        (row["name"], m["name"]): m["rivals"]
        for row in before
        for m in row["measures"]
        if "rivals" in m
    }
    for row in rows:
        for measure in row["measures"]:
            if (row["name"], measure["name"]) in known:
                measure["rivals"] = known[row["name"], measure["name"]]
    return rows


def rivals(folder: Path) -> list[dict]:
    """The rows in other engines, worst of the draws; null where one cannot run a row, or takes too long.

    Added to benchmarks/results/physics.json, which `physics` writes.
    """
    rows = json.loads(RESULT.read_text())["rows"]
    by_number = {row.number: row for row in ROWS}
    signal.signal(signal.SIGALRM, _too_slow)
    for record in rows:
        row = by_number[record["row"]]
        for index in range(DRAWS):
            write_scenes(row, index, folder)
        for name in ENGINES:
            found = _errors(name, row, folder)
            for measure in record["measures"]:
                measure.setdefault("rivals", {})[name] = found.get(measure["name"])
    return rows


def _errors(name: str, row: Row, folder: Path) -> dict[str, float]:
    run, engine = make(name), ENGINES[name]

    def simulate(world: World, rate: float) -> Trajectory:
        rate = engine.rate_near(rate)
        return run(world, np.arange(int(world.duration * rate + 1e-9) + 1) / rate)

    worst: dict[str, float] = {}
    try:
        for index in range(DRAWS):
            signal.alarm(PATIENCE)
            for measure, found in run_draw(
                row, index, folder, simulate=simulate
            ).errors.items():
                worst[measure] = max(worst.get(measure, 0.0), found.size)
    except (Unsupported, ArithmeticError, ValueError, IndexError, TimeoutError):
        return {}
    finally:
        signal.alarm(0)
    return {
        measure: float(f"{error:.3g}")
        for measure, error in worst.items()
        if np.isfinite(error)
    }


def _too_slow(*_: object) -> None:
    raise TimeoutError
