"""Draw the energy of two cases with joints, before and after joints and impacts were
solved together, as docs/joint-energy.svg.

    python benchmarks/joint_energy.py BASELINE

BASELINE is a folder with an older version of physgen (`git archive 38588860`).
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

DOCS = Path(__file__).parents[1] / "docs"
BRIDGE = """\
physgen: 1
size: [600, 900]
world: {duration: 2}
objects:
  left: {shape: {box: {center: [250, 300], size: [100, 10]}}, mass: 50}
  right: {shape: {box: {center: [350, 300], size: [100, 10]}}, mass: 50}
  ball: {shape: {circle: {center: [290, 229], radius: 20}}, mass: 5000, elasticity: 0}
joints:
  bank: {objects: [left], pivot: [200, 300]}
  middle: {objects: [left, right], pivot: [300, 300]}
  other-bank: {objects: [right], pivot: [400, 300]}
"""
ROOM = """\
physgen: 1
size: [400, 300]
world: {duration: 20, gravity: [0, 0]}
objects:
  a:
    {shape: {box: {center: [150, 150], size: [70, 16]}}, mass: 150, elasticity: 1,
     friction: 0, velocity: [120, 50], spin: 114.592}
  b:
    {shape: {box: {center: [205, 150], size: [40, 10]}}, mass: 30, elasticity: 1,
     friction: 0, velocity: [120, 60], spin: -171.887}
joints:
  hinge: {objects: [a, b], pivot: [185, 150]}
boundaries:
  room: {polyline: [[10, 10], [390, 10], [390, 290], [10, 290], [10, 10]], elasticity: 1, friction: 0}
"""
CASES = (
    ("A ball of 5 kg falls on two pinned planks of 50 g", BRIDGE),
    ("Two hinged rods in an elastic room without gravity", ROOM),
)
JOULES = 1e-7
"""J per g px²/s² at the default of 100 px/m."""
SAMPLES_PER_SECOND = 60
WIDTH, HEIGHT = 330, 200
"""px: the area of one chart."""
LEFT, TOP, GAP, FOOT = 60, 50, 80, 60
"""px: around the charts."""
MARGIN = 0.08
"""Free part of a chart below and above the curves."""
COLOURS = {"before": "#b4452c", "after": "#1f6f8b"}


@dataclass(frozen=True)
class Curve:
    """Mechanical energy (J) of a run, and its times (s)."""

    times: NDArray[np.float64]
    energy: NDArray[np.float64]


def energy_curve(version: Path, text: str) -> Curve:
    """Simulate a scene with the physgen of a folder."""
    with TemporaryDirectory() as folder:
        scene, output = Path(folder, "scene.yaml"), Path(folder, "run.npz")
        scene.write_text(text)
        command = [sys.executable, "-m", "physgen", "simulate", str(scene)]
        command += ["-o", str(output), "--rate", str(SAMPLES_PER_SECOND)]
        subprocess.run(
            command,
            check=True,
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(version)},
        )
        with np.load(output) as run:
            energy = run["energy_kinetic"] + run["energy_potential"]
            return Curve(run["times"], energy * JOULES)


def ticks(low: float, high: float) -> list[float]:
    """Return about five round numbers between two values."""
    steps = (high - low) / 5
    power = 10.0 ** np.floor(np.log10(steps))
    step = power * next(k for k in (1, 2, 5, 10) if k * power >= steps)
    return [float(k * step) for k in range(ceil(low / step), floor(high / step) + 1)]


def chart(left: float, title: str, curves: Mapping[str, Curve]) -> list[str]:
    """Return one chart, energy over time, as elements of SVG."""
    every = np.concatenate([curve.energy for curve in curves.values()])
    margin = MARGIN * float(np.ptp(every))
    low, high = float(every.min()) - margin, float(every.max()) + margin
    duration = float(next(iter(curves.values())).times[-1])

    def place(time: float, energy: float) -> tuple[float, float]:
        x = left + time / duration * WIDTH
        y = TOP + HEIGHT - (energy - low) / (high - low) * HEIGHT
        return round(x, 1), round(y, 1)

    parts = [f'<text x="{left}" y="{TOP - 14}" fill="#222">{title}</text>']
    parts += [_polyline(name, curve, place) for name, curve in curves.items()]
    for energy in ticks(low, high):
        x, y = place(0, energy)
        amount = f"{energy:g}".replace("-", "−")
        parts.append(f'<path d="M{x} {y}h{WIDTH}" stroke="#e4e4e4"/>')
        label = f'<text x="{x - 6}" y="{y + 4}" text-anchor="end" fill="#444">'
        parts.append(f"{label}{amount} J</text>")
    for time in ticks(0, duration):
        x, y = place(time, low)
        label = f'<text x="{x}" y="{y + 18}" text-anchor="middle" fill="#444">'
        parts.append(f"{label}{time:g} s</text>")
    return parts


def _polyline(
    name: str, curve: Curve, place: Callable[[float, float], tuple[float, float]]
) -> str:
    """Return a curve as an element of SVG, with the place of each sample in px."""
    samples = zip(curve.times, curve.energy, strict=True)
    line = " ".join("{},{}".format(*place(*sample)) for sample in samples)
    return f'<polyline points="{line}" fill="none" stroke="{COLOURS[name]}"/>'


def plot(charts: Sequence[tuple[str, Mapping[str, Curve]]]) -> str:
    """Return the charts beside each other, with their key, as SVG."""
    width = len(charts) * (LEFT + WIDTH) + GAP
    height = TOP + HEIGHT + FOOT
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="system-ui, sans-serif" font-size="12">',
        '<rect width="100%" height="100%" fill="#ffffff"/>',
    ]
    for k, (title, curves) in enumerate(charts):
        parts += chart(LEFT + k * (WIDTH + GAP), title, curves)
    for k, (name, colour) in enumerate(COLOURS.items()):
        x, y = LEFT + k * GAP, height - 14
        parts.append(f'<path d="M{x} {y}h24" stroke="{colour}" stroke-width="3"/>')
        parts.append(f'<text x="{x + 30}" y="{y + 4}" fill="#222">{name}</text>')
    return "\n".join([*parts, "</svg>", ""])


def main() -> None:
    """Draw the charts of both cases."""
    versions = {"before": Path(sys.argv[1]).resolve(), "after": DOCS.parent}
    charts = []
    for title, text in CASES:
        curves = {name: energy_curve(path, text) for name, path in versions.items()}
        charts.append((title, curves))
        for name, curve in curves.items():
            ends = curve.energy[[0, -1]]
            print(f"{title}, {name}: {ends[0]:.3f} J, at the end {ends[1]:.3f} J")
    (DOCS / "joint-energy.svg").write_text(plot(charts))


if __name__ == "__main__":
    main()
