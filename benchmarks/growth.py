"""Heaps of 10 to 1,000 bodies for 2 s: CPU seconds, size of the trajectory file, how cost grows; a plot for docs/."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import yaml

COUNTS = (10, 32, 100, 316, 1000)
KINDS = ("heap", "stacks")
CODE = """
import json, sys, time
from pathlib import Path
from physgen import pipeline
world = pipeline.compile(pipeline.load(sys.argv[1]), None).world
began = time.process_time()
trajectory = pipeline.simulate(world)
cpu = time.process_time() - began
trajectory.save(Path(sys.argv[1]).with_suffix(".npz"))
effort = trajectory.effort
print(json.dumps({"cpu": round(cpu, 3), "mb": round(Path(sys.argv[1]).with_suffix(".npz").stat().st_size / 1e6, 2),
                  "impacts": effort.impacts, "iterations": effort.iterations,
                  "still": round(effort.still, 2)}))
"""


def scene(kind: str, count: int) -> dict:
    """heap: balls and boxes that fall into a trough; stacks: columns of boxes at rest, side by side."""
    rng = np.random.default_rng(count)
    columns = int(np.ceil(np.sqrt(count) * (1 if kind == "heap" else 2)))
    objects = {}
    for k in range(count):
        i, j = k % columns, k // columns
        if kind == "stacks":
            shape = {
                "box": {"center": [20.5 + 21 * i, -10.0 - 20 * j], "size": [20, 20]}
            }
            objects[f"b{k}"] = {"shape": shape, "mass": 50}
            continue
        x, y = round(30 + 24 * i + rng.uniform(-2, 2), 2), -12.0 - 24 * j
        if (i + j) % 2:
            shape = {"box": {"center": [x, y], "size": [18, 18]}}
            objects[f"b{k}"] = {
                "shape": shape,
                "mass": 50,
                "spin": round(rng.uniform(-60, 60), 1),
            }
        else:
            objects[f"b{k}"] = {
                "shape": {"circle": {"center": [x, y], "radius": 9}},
                "mass": 40,
            }
    wide, high = 24 * columns + 40, 60.0 * columns
    walls = [[0, -high], [0, 0], [wide, 0], [wide, -high]]
    return {
        "physgen": 1,
        "size": [wide, 100],
        "world": {"duration": 2.0},
        "objects": objects,
        "boundaries": {"trough": {"polyline": walls}},
    }


def growth(folder: Path) -> list[dict]:
    """One process a scene; the least of two runs counts, three for the small ones."""
    rows = []
    for kind in KINDS:
        for count in COUNTS:
            path = folder / f"{kind}-{count}.yaml"
            path.write_text(yaml.safe_dump(scene(kind, count)))
            runs = []
            for _ in range(3 if count < 300 else 2):
                run = subprocess.run(
                    [sys.executable, "-c", CODE, str(path)],
                    check=True,
                    capture_output=True,
                    text=True,
                )
                runs.append(json.loads(run.stdout))
            rows.append(
                {"kind": kind, "bodies": count, **min(runs, key=lambda row: row["cpu"])}
            )
    return rows


def exponent(rows: list[dict]) -> float:
    """Of cost ~ bodies^p, by least squares over all sizes of one kind."""
    x, y = (np.log([row[key] for row in rows]) for key in ("bodies", "cpu"))
    return float(np.polyfit(x, y, 1)[0])


def plot(rows: list[dict]) -> str:
    """CPU seconds over bodies, both axes logarithmic, as SVG."""
    left, top, width, height = 70, 20, 560, 340
    low_x, high_x, low_y, high_y = 1.0, 3.0, -1.5, 1.5

    def at(bodies: float, cpu: float) -> tuple[float, float]:
        x = left + (np.log10(bodies) - low_x) / (high_x - low_x) * width
        y = top + height - (np.log10(cpu) - low_y) / (high_y - low_y) * height
        return round(float(x), 1), round(float(y), 1)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {left + width + 30} {top + height + 60}" '
        'font-family="system-ui, sans-serif" font-size="13">',
        '<rect width="100%" height="100%" fill="#ffffff"/>',
    ]
    for bodies in (10, 20, 50, 100, 200, 500, 1000):
        x, bottom = at(bodies, 10**low_y)
        parts.append(f'<path d="M{x} {top}V{bottom}" stroke="#e4e4e4"/>')
        parts.append(
            f'<text x="{x}" y="{bottom + 18}" text-anchor="middle" fill="#444">{bodies:,}</text>'
        )
    for cpu in (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20):
        x, y = at(10, cpu)
        parts.append(f'<path d="M{left} {y}H{left + width}" stroke="#e4e4e4"/>')
        parts.append(
            f'<text x="{left - 8}" y="{y + 4}" text-anchor="end" fill="#444">{cpu:g}</text>'
        )
    for kind, colour in zip(KINDS, ("#c2410c", "#1d4ed8"), strict=True):
        mine = [row for row in rows if row["kind"] == kind]
        points = [at(row["bodies"], row["cpu"]) for row in mine]
        line = "M" + "L".join(f"{x} {y}" for x, y in points)
        parts.append(
            f'<path d="{line}" fill="none" stroke="{colour}" stroke-width="2"/>'
        )
        parts += [
            f'<circle cx="{x}" cy="{y}" r="4" fill="{colour}"/>' for x, y in points
        ]
        y = top + 250 + 24 * KINDS.index(kind)
        label = f"{kind}: bodies^{exponent(mine):.2f}"
        parts.append(f'<text x="{left + 380}" y="{y}" fill="{colour}">{label}</text>')
    first = next(row for row in rows if row["kind"] == KINDS[0])
    last = 10 * (10**high_y / first["cpu"]) ** (
        1 / 1.2
    )  # where the line leaves the plot
    (x0, y0), (x1, y1) = at(10, first["cpu"]), at(last, 10**high_y)
    parts.append(
        f'<path d="M{x0} {y0}L{x1} {y1}" stroke="#888" stroke-dasharray="5 5"/>'
    )
    parts.append(
        f'<text x="{x1 - 34}" y="{y1 + 14}" text-anchor="end" fill="#666">bodies^1.2</text>'
    )
    middle = left + width / 2
    parts.append(
        f'<text x="{middle}" y="{top + height + 46}" text-anchor="middle">bodies</text>'
    )
    parts.append(
        f'<text transform="translate(18 {top + height / 2}) rotate(-90)" text-anchor="middle">CPU s for 2 s</text>'
    )
    return "\n".join([*parts, "</svg>", ""])
