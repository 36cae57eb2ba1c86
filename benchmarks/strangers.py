"""`physgen clip` on photos of strangers: what moves, how the clip ends, and what it costs.

    PHYSGEN_MATERIAL=DIR python benchmarks/run.py strangers      # photos DIR/photos/strangers
    PHYSGEN_MATERIAL=DIR python benchmarks/strangers.py OUT      # the same; keeps the clips in OUT

Ratings of the clips by eye are in benchmarks/ratings.yaml.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from statistics import mean, median
from subprocess import run
from typing import Any

import av
import cv2
import numpy as np
import yaml
from layout import prose, table

from physgen import pipeline
from physgen.pipeline import perceiving
from physgen.pipeline.push_motion import measure_travel
from physgen.simulate.trajectory import read_trajectory

RATINGS = Path(__file__).with_name("ratings.yaml")
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
LEAST_PATH = 0.05
"""Displacement of a point from which a motion is visible, by the photo's longer side."""
LEAST_TIME = 2.5
"""Length of a clip, s."""
REST_TIME = 0.3
"""Time at the end, s of video, in which nothing moves visibly."""
REST_PX = 1.0
"""Displacement within `REST_TIME` of an object at rest, px."""
BORDER = 0.005
"""Distance by which a point at rest may lie outside the picture, by its side."""


def strangers(folder: Path) -> list[dict[str, Any]]:
    """Make a clip of each photo; return a row of measures for each."""
    if "PHYSGEN_MATERIAL" not in os.environ:
        sys.exit("PHYSGEN_MATERIAL: name the folder of photos/strangers")
    folder_of_photos = Path(os.environ["PHYSGEN_MATERIAL"]) / "photos/strangers"
    photos = sorted(folder_of_photos.glob("*.jpg"))
    if not photos:
        sys.exit(f"{folder_of_photos}: no photos (*.jpg); set PHYSGEN_MATERIAL")
    rows = []
    for photo in photos:
        command = [sys.executable, __file__, "--photo", str(photo), str(folder)]
        environment = os.environ | ONE_THREAD
        out = run(command, check=True, capture_output=True, text=True, env=environment)
        rows.append(json.loads(out.stdout.splitlines()[-1]))
        print(rows[-1], file=sys.stderr, flush=True)
    return rows


def measure_clip(photo: Path, folder: Path) -> dict[str, Any]:
    """Perceive and render a photo in this process; return its row."""
    cv2.setNumThreads(1)
    push_costs = []
    start_motion = perceiving.start_motion

    def timed_start(*arguments: Any, **options: Any) -> Any:
        start = time.thread_time()
        perceived_scene = start_motion(*arguments, **options)
        push_costs.append(time.thread_time() - start)
        return perceived_scene

    perceiving.start_motion = timed_start
    path = folder / f"{photo.stem}.yaml"
    start = time.process_time()
    pipeline.perceive(photo, path)
    perceive_cost = time.process_time() - start
    clip = folder / photo.stem
    pipeline.render_scene(path, folder)
    cost = time.process_time() - start
    row = {
        "photo": photo.stem,
        "perceive": round(perceive_cost, 1),
        "push": round(sum(push_costs), 2),
        "cpu": round(cost, 1),
    }
    return row | measure_motion(path, clip)


def measure_motion(path: Path, clip: Path) -> dict[str, Any]:
    """Return the displacement, the length and the end of a clip."""
    scene = pipeline.load(path)
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    motion = read_trajectory(clip / "trajectory.npz")
    side = max(scene.size)
    travel = float(measure_travel(world, motion).max(initial=0.0)) / side
    with av.open(str(clip / "video.mp4")) as video:
        frame_count = sum(1 for _ in video.decode(video=0))
        frame_rate = float(video.streams.video[0].average_rate)
    last_count = max(int(REST_TIME * frame_rate), 2)
    late_shift = np.ptp(motion.poses[-last_count:, :, :2], axis=0).max(initial=0.0)
    return {
        "travel": round(travel, 3),
        "seconds": round(frame_count / frame_rate, 2),
        "rests": bool(late_shift < REST_PX),
        "inside": _ends_inside(world, motion, scene.size),
    }


def _ends_inside(world: Any, motion: Any, size: tuple[int, int]) -> bool:
    """Check whether each body that moves has its outline inside the picture at the end.

    Points outside the picture at the start are not counted.
    """
    margin = BORDER * max(size)
    for k, body in enumerate(world.bodies):
        first, last = motion.poses[0, k], motion.poses[-1, k]
        if np.hypot(*(last - first)[:2]) < REST_PX:
            continue
        points = _body_points(body)
        was_inside = _is_inside(_place(points, first), size, margin)
        is_inside = _is_inside(_place(points, last), size, margin)
        if (was_inside & ~is_inside).any():
            return False
    return True


def _body_points(body: Any) -> np.ndarray:
    """Return points (P, 2) of the outline in the body's frame, px."""
    if body.radius is None:
        return np.concatenate(body.rings)
    turns = np.linspace(0, 2 * np.pi, 16)
    return body.radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)


def _place(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Transform points (P, 2) of a body by its pose (3,): px, px, rad."""
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    turned = points @ np.array([[cosine, sine], [-sine, cosine]])
    return turned + pose[:2]


def _is_inside(points: np.ndarray, size: tuple[int, int], margin: float) -> np.ndarray:
    """Return the mask (P,) of points inside the picture."""
    limits = np.array(size) + margin
    return ((points > -margin) & (points < limits)).all(axis=1)


def strangers_table(rows: list[dict[str, Any]]) -> list[str]:
    """Return the lines of the table, with the ratings by eye."""
    ratings = yaml.safe_load(RATINGS.read_text())
    body = []
    for row in rows:
        travel = f"{100 * row['travel']:.1f}"
        end = _describe_end(row)
        given = ratings["clips"].get(row["photo"], {})
        scores = [given.get(column, "-") for column in ("before", "now")]
        costs = [row["perceive"], row["push"], row["cpu"]]
        body.append([row["photo"], travel, row["seconds"], end, *costs, *scores])
    moving = [row for row in rows if row["travel"] > 0]
    good = [row for row in moving if _is_good(row)]
    now = [given["now"] for given in ratings["clips"].values() if "now" in given]
    before = [given["before"] for given in ratings["clips"].values()]
    push_cost = median(row["push"] for row in rows)
    heads = ["photo", "path, %", "s", "end", "perceive", "push", "clip"]
    return [
        *prose(
            f"`physgen clip` on {len(rows)} photos, default options. {len(good)} of the",
            f"{len(moving)} with a motion move by {100 * LEAST_PATH:.0f} % of the longer",
            f"side, last {LEAST_TIME:g} s and end at rest inside the picture. CPU seconds",
            "on one core by `perceive`, by its choice of a push (median",
            f"{push_cost:.2f}), and by the whole command.",
            ratings["note"],
            f"Median {median(now):g} ({median(before):g} before), mean",
            f"{mean(now):.1f} ({mean(before):.1f}).",
        ),
        "",
        *table([*heads, "rating before", "rating now"], body),
    ]


def _is_good(row: dict[str, Any]) -> bool:
    """Check whether a clip has a visible motion that ends well."""
    is_long = row["seconds"] >= LEAST_TIME
    return row["travel"] >= LEAST_PATH and is_long and row["rests"] and row["inside"]


def _describe_end(row: dict[str, Any]) -> str:
    """Return how a clip ends, in words."""
    if row["travel"] == 0:
        return "nothing moves"
    if not row["inside"]:
        return "outside"
    if not row["rests"]:
        return "moving"
    return "at rest"


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("name the folder for the clips: python benchmarks/strangers.py OUT")
    if sys.argv[1] == "--photo":
        print(json.dumps(measure_clip(Path(sys.argv[2]), Path(sys.argv[3]))))
    else:
        output = Path(sys.argv[1])
        output.mkdir(parents=True, exist_ok=True)
        strangers(output)
