"""Fits of synthetic tracks: how often intervals hold, and how near estimates come.

    python benchmarks/fit.py --draws 5        # of each scene; 25 make the 200 draws of the goal

Each draw has random values and noise of 0.5 px; the fit begins with other values. Results
go into benchmarks/results/fit.json.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from physgen.fit.intervals import Estimate
from physgen.fit.parameters import Kind, Scale
from physgen.fit.solve import fit_scene
from physgen.fit.tracks import Tracks
from physgen.pipeline import stages
from physgen.scene.load import OpenedScene
from physgen.simulate.engine import simulate

RESULTS = Path(__file__).with_name("results") / "fit.json"
NOISE = 0.5
"""px, standard deviation of each coordinate."""
RATE = 30.0
"""Frames per second."""
SIDE = "physgen: 1\nsize: [400, 300]\nworld: {duration: 2}\n"
TOP = "physgen: 1\nsize: [400, 300]\nworld: {view: top, duration: 2, table: {friction: %s}}\n"
FLOOR = (
    "boundaries: {floor: {segment: [[-900, 250.5], [1900, 250.5]], friction: 0.5}}\n"
)
Generator = np.random.Generator


@dataclass(frozen=True)
class Case:
    """One scene with the values that a draw chooses."""

    text: str
    """With %(key)s for each value."""
    seconds: float
    ranges: dict[str, tuple[float, float]]
    others: dict[str, float]
    """Values with which the fit begins; velocities begin at rest."""
    kinds: tuple[Kind, ...]


V, S, F, E, R, M = (
    Kind.VELOCITY, Kind.SPIN, Kind.FRICTION, Kind.ELASTICITY, Kind.ROLLING, Kind.MASS
)  # fmt: skip
CASES = {
    "slide": Case(
        SIDE
        + "objects:\n  crate: {shape: {box: {center: [60, 230], size: [40, 40]}},"
        " mass: 200, friction: %(friction)s, velocity: [%(vx)s, 0]}\n" + FLOOR,
        0.8,
        {"friction": (0.2, 0.7), "vx": (250, 450)},
        {"friction": 0.4},
        (V, F),
    ),
    "bounce": Case(
        SIDE
        + "objects:\n  ball: {shape: {circle: {center: [60, 80], radius: 12}}, mass: 50,"
        " elasticity: %(elasticity)s, velocity: [%(vx)s, %(vy)s]}\n"
        + FLOOR.replace("friction: 0.5", "friction: 0.5, elasticity: 0.8"),
        1.2,
        {"elasticity": (0.4, 0.9), "vx": (60, 160), "vy": (-150, 50)},
        {"elasticity": 0.6},
        (V, E),
    ),
    "drop": Case(
        SIDE
        + "objects:\n  ball: {shape: {circle: {center: [200, 40], radius: 12}}, mass: 50,"
        " elasticity: %(elasticity)s, velocity: [0, %(vy)s]}\n"
        + FLOOR.replace("friction: 0.5", "friction: 0.5, elasticity: 0.8"),
        1.0,
        {"elasticity": (0.4, 0.9), "vy": (-80, 80)},
        {"elasticity": 0.6},
        (V, E, Kind.GRAVITY),
    ),
    "roll": Case(
        SIDE
        + "objects:\n  ball: {shape: {circle: {center: [40, 238], radius: 12}}, mass: 50,"
        " solid: sphere, rolling: %(rolling)s, velocity: [%(vx)s, 0]}\n" + FLOOR,
        1.0,
        {"rolling": (0.02, 0.15), "vx": (150, 300)},
        {"rolling": 0.05},
        (V, S, R),
    ),
    "push": Case(
        SIDE
        + "objects:\n  puck: {shape: {box: {center: [60, 235], size: [30, 30]}},"
        " mass: 200, friction: 0.3, velocity: [%(vx)s, 0]}\n"
        "  crate: {shape: {box: {center: [150, 230], size: [40, 40]}},"
        " mass: %(mass)s, friction: %(friction)s}\n" + FLOOR,
        0.8,
        {"friction": (0.2, 0.5), "vx": (300, 450), "mass": (100, 400)},
        {"friction": 0.4, "mass": 200},
        (V, F, M),
    ),
    "table": Case(
        TOP % "%(table)s"
        + "objects:\n  puck: {shape: {circle: {center: [60, 150], radius: 15}},"
        " mass: 200, friction: 0.5, velocity: [%(vx)s, %(vy)s], spin: %(spin)s}\n",
        1.0,
        {"table": (0.1, 0.5), "vx": (200, 350), "vy": (-60, 60), "spin": (-300, 300)},
        {"table": 0.2},
        (V, S, Kind.TABLE),
    ),
    "pucks": Case(
        TOP % "%(table)s"
        + "objects:\n  a: {shape: {circle: {center: [60, 150], radius: 15}}, mass: 200,"
        " elasticity: %(elasticity)s, velocity: [%(vx)s, 0]}\n"
        "  b: {shape: {circle: {center: [180, 158], radius: 15}}, mass: %(mass)s,"
        " elasticity: 0.9}\n",
        1.0,
        {"table": (0.05, 0.3), "vx": (250, 400), "elasticity": (0.4, 0.9),
         "mass": (100, 400)},
        {"table": 0.15, "elasticity": 0.6, "mass": 200},
        (V, E, M, Kind.TABLE),
    ),
    "ramp": Case(
        SIDE
        + "objects:\n  block: {shape: {box: {center: [70, 94.5], size: [30, 30], angle: 25}},"
        " mass: 100, friction: %(friction)s, velocity: [%(vx)s, %(vy)s]}\n"
        "boundaries: {slope: {segment: [[0, 79.3], [600, 359.1]], friction: 0.5}}\n",
        0.7,
        {"friction": (0.05, 0.3), "vx": (40, 120), "vy": (18, 55)},
        {"friction": 0.15},
        (V, S, F),
    ),
}  # fmt: skip


def draw_fit(case: Case, seed: int) -> list[dict[str, Any]]:
    """Return one row for each determined estimate of one draw."""
    generator = np.random.default_rng(seed)
    truth = {
        key: float(f"{generator.uniform(*ends):.4g}")
        for key, ends in case.ranges.items()
    }
    scene = OpenedScene("scene.yaml", text=case.text % truth).scene()
    world = stages.compile(scene, None).world
    times = np.arange(0.0, case.seconds + 1e-9, 1 / RATE)
    poses = simulate(world, times).poses.copy()
    for k, body in enumerate(world.bodies):
        widths = NOISE * np.array([1.0, 1.0, (body.mass / body.moment) ** 0.5])
        poses[:, k] += generator.normal(size=(len(times), 3)) * widths
    tracks = Tracks(times, tuple(body.name for body in world.bodies), poses)
    begin = dict.fromkeys(truth, 0.0) | case.others
    start = OpenedScene("scene.yaml", text=case.text % begin).scene()
    clock = time.process_time()
    fit = fit_scene(start, stages.compile(start, None), tracks, case.kinds)
    seconds = time.process_time() - clock
    rows = []
    for estimate in fit.estimates:
        if estimate.is_determined:
            row = _row(estimate, _true_value(scene, start, estimate))
            rows.append(row | {"seed": seed, "cpu_s": round(seconds, 2)})
    return rows


def _true_value(scene: Any, start: Any, estimate: Estimate) -> float:
    parameter = estimate.parameter
    if parameter.kind is Kind.TABLE:
        return float(scene.world.table_friction)
    if parameter.kind is Kind.GRAVITY:
        return float(scene.world.gravity[parameter.component])
    item = scene.objects[parameter.index]
    readers: dict[Kind, Callable[[], float]] = {
        Kind.VELOCITY: lambda: item.velocity[parameter.component],
        Kind.SPIN: lambda: np.radians(item.spin),
        Kind.MASS: lambda: _mass_factor(scene, start, parameter.index),
    }
    read = readers.get(parameter.kind, lambda: getattr(item, parameter.kind.value))
    return float(read())


def _mass_factor(scene: Any, start: Any, index: int) -> float:
    """Return the factor of the start's mass, beside the first object, which keeps its mass."""
    factors = [
        item.mass / begin.mass
        for item, begin in zip(scene.objects, start.objects, strict=True)
    ]
    return float(factors[index] / factors[0])


def _row(estimate: Estimate, truth: float) -> dict[str, Any]:
    is_linear = estimate.parameter.scale is Scale.LINEAR
    return {
        "path": estimate.parameter.path,
        "kind": estimate.parameter.kind.value,
        "truth": float(f"{truth:.6g}"),
        "value": float(f"{estimate.value:.6g}"),
        "is_covered": estimate.low <= truth <= estimate.high,
        "error": float(f"{abs(estimate.value - truth):.4g}"),
        "is_linear": is_linear,
    }


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return coverage, and median errors by kind: of speeds relative to the fastest."""
    errors: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        scale = 1.0
        if row["kind"] in ("friction", "table", "rolling", "mass"):
            scale = row["truth"]
        if row["kind"] == "velocity":
            same = [r for r in rows if r["seed"] == row["seed"] and r["kind"] == "velocity"
                    and r["scene"] == row["scene"]]  # fmt: skip
            scale = max(abs(r["truth"]) for r in same)
        if row["kind"] == "gravity":
            scale = 980.0
        errors[row["kind"]].append(row["error"] / max(scale, 1e-9))
    covered = [row["is_covered"] for row in rows]
    return {
        "draws": len({(row["scene"], row["seed"]) for row in rows}),
        "intervals": len(rows),
        "coverage": round(sum(covered) / max(len(covered), 1), 3),
        "median_errors": {
            kind: round(median(e), 4) for kind, e in sorted(errors.items())
        },
        "median_cpu_s": round(median(row["cpu_s"] for row in rows), 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=25, help="of each scene")
    parser.add_argument("--scenes", nargs="*", default=list(CASES))
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for seed in range(options.draws):
        for name in options.scenes:
            # the same seed means another draw in each scene
            number = 1000 * list(CASES).index(name) + seed
            for row in draw_fit(CASES[name], number):
                rows.append({"scene": name, **row})
            result = {"summary": summary(rows), "rows": rows}
            options.output.write_text(json.dumps(result, indent=1) + "\n")
        print(json.dumps(result["summary"]), flush=True)


if __name__ == "__main__":
    main()
