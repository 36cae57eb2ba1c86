"""How soon an edit shows its motion: whole round trips over HTTP to `physgen edit`, in a process of its own.

    python benchmarks/run.py editor

An edit sets the velocity of a body and is answered with the whole state: text, problems, lints and the first part of
the new motion, which the page plays while it asks for more. A preview is what an arrow that is being dragged asks for.
"""

from __future__ import annotations

import http.client
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

import layout
import numpy as np
from layout import prose

ROOT = Path(__file__).resolve().parent.parent
COUNTS = (1, 16, 100)
EDITS, WHOLE = 24, 4
"""Of each scene; of every fourth the whole motion is asked for."""
SIDE, GAP = 40, 4
"""px: of a box, and between two beside each other."""


def pyramid(count: int) -> str:
    """Boxes of one size in courses on a floor, each course one box shorter; the last may be cut short."""
    wide = next(n for n in range(1, count + 1) if n * (n + 1) // 2 >= count)
    middle, floor = 60 + wide * (SIDE + GAP) / 2, 60 + SIDE * wide
    lines = [
        "physgen: 1",
        f"size: [{round(2 * middle)}, {floor + 40}]",
        "world: {duration: 2.0}",
        "objects:",
    ]
    made = 0
    for course in range(wide):
        beside = min(wide - course, count - made)
        for k in range(beside):
            x = middle + (k - (wide - course - 1) / 2) * (SIDE + GAP)
            y = floor - SIDE / 2 - course * SIDE
            made += 1
            shape = f"{{box: {{center: [{x:g}, {y:g}], size: [{SIDE}, {SIDE}]}}}}"
            lines.append(
                f"  box-{made:03d}: {{shape: {shape}, mass: 100, friction: 0.6, elasticity: 0.1}}"
            )
    lines += [
        "boundaries:",
        f"  floor: {{segment: [[-2000, {floor}], [3000, {floor}]], friction: 0.8}}",
    ]
    return "\n".join(lines) + "\n"


class Client:
    """One connection to a running editor, as a browser keeps it."""

    def __init__(self, address: str) -> None:
        base, _, self.token = address.partition("/?token=")
        self.host = base.removeprefix("http://")
        self.connection = http.client.HTTPConnection(self.host, timeout=60)

    def ask(self, method: str, path: str, body: object = None) -> tuple[Any, float]:
        """The answer, read and parsed, and the s that it took."""
        head = {"X-Physgen-Token": self.token, "Content-Type": "application/json"}
        data = None if body is None else json.dumps(body).encode()
        began = time.perf_counter()
        self.connection.request(method, path, data, head)
        answer = self.connection.getresponse()
        told = json.loads(answer.read())
        took = time.perf_counter() - began
        assert answer.status == 200, told
        return told, took


def cpu(process: int) -> float:
    """s that a process has had of a processor, to a hundredth; other work takes none of it."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measured(path: Path, edits: int = EDITS) -> dict[str, Any]:
    """Times in ms of one scene: median and worst."""
    command = [sys.executable, "-m", "physgen", "edit", str(path), "--no-browser"]
    server = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        assert server.stdout is not None
        client = Client(server.stdout.readline().strip())
        state, opened = client.ask("GET", "/api/state")
        names = [
            body["name"]
            for body in state["motion"]["bodies"]
            if body["motion"] == "dynamic"
        ]
        pushed = names[len(names) // 2]
        random = np.random.default_rng(7)
        rows: dict[str, list[float]] = {"edit": [], "preview": [], "whole": []}
        first, worked = [], 0.0
        for k in range(edits):
            velocity = [round(float(v), 1) for v in random.uniform(-300, 300, 2)]
            op = {"set": ["objects", pushed, "velocity"], "value": velocity}
            body = {"version": state["version"], "variant": None, "ops": [op]}
            took = client.ask("POST", "/api/preview", body)[1]
            rows["preview"].append(took)
            # another value than the preview's: its motion would be at hand
            op["value"] = [velocity[0] + 1, velocity[1]]
            before = cpu(server.pid)
            state, took = client.ask(
                "POST", "/api/edit", {**body, "what": f"edit {k}", "tag": None}
            )
            worked += cpu(server.pid) - before
            rows["edit"].append(took)
            part = state["motion"]
            first.append(part["upto"] / part["total"])
            if k % WHOLE == 0:
                while not part["done"]:
                    part, more = client.ask(
                        "GET", f"/api/motion/{part['key']}?from={part['upto']}"
                    )
                    took += more
                rows["whole"].append(took)
    finally:
        server.send_signal(signal.SIGINT)
        server.wait(20)
    found = {
        name: [_ms(median(times)), _ms(max(times))] for name, times in rows.items()
    }
    return {
        "bodies": len(state["motion"]["bodies"]),
        "opened": _ms(opened),
        **found,
    } | {
        "first": round(median(first), 2),
        "cpu": _ms(worked / edits),
        "load": round(os.getloadavg()[0], 1),
    }


def _ms(seconds: float) -> float:
    return round(1000 * seconds, 1)


def editor(folder: Path) -> list[dict]:
    """Pyramids of 1, 16 and 100 boxes, then every bundled scene that has a photo; each on a copy."""
    rows = []
    for count in COUNTS:
        home = folder / f"pyramid-{count}"
        home.mkdir()
        (home / "scene.yaml").write_text(pyramid(count))
        rows.append(
            {
                "scene": f"{count} box{'es' * (count > 1)}",
                **measured(home / "scene.yaml"),
            }
        )
    for path in sorted((ROOT / "scenes").glob("*/scene.yaml")):
        home = folder / path.parent.name
        shutil.copytree(path.parent, home)
        rows.append({"scene": path.parent.name, **measured(home / "scene.yaml")})
    return rows


def table(rows: list[dict[str, Any]]) -> list[str]:
    """The slowest of the bundled scenes, and heaps."""
    bundled = [row for row in rows if row["scene"][0].isalpha()]
    heaps = [row for row in rows if not row["scene"][0].isalpha()]
    slowest = max(bundled, key=lambda row: row["edit"][0])
    body = [
        [
            row["scene"],
            row["bodies"],
            _pair(row["preview"]),
            _pair(row["edit"]),
            _pair(row["whole"]),
        ]
        for row in (*heaps, slowest)
    ]
    return [
        *prose(
            f"{EDITS} edits of one body's velocity and as many previews, whole round trips over HTTP, in ms: the",
            "median, the worst. An answer to an edit holds the new text, its problems and the first part of the new",
            "motion; `motion` is when the last of it has come. Of the bundled scenes the slowest is shown.",
        ),
        "",
        *layout.table(["scene", "bodies", "preview", "edit", "motion"], body),
    ]


def _pair(times: list[float]) -> str:
    return f"{times[0]:.0f}, {times[1]:.0f}"
