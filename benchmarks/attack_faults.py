"""Faults that the output of a command shows: repeated messages, wrong places, motion.

`benchmarks/attack.py` counts them beside its own, which concern exit codes, time,
memory and files left behind.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

MESSAGE_PLACE = re.compile(r"^(?P<file>[^:\n]+):(?P<line>\d+):(?P<column>\d+): ")
MOVED = 1.0
"""px by which a body moves that is not at rest; the engine's own tolerance is 0.25 px."""
MARGIN = 0.5
"""Of the picture's size: how far outside its centre is, so that no part of it is visible."""


def repeated_messages(lines: Sequence[str]) -> list[str]:
    """Return a fault if a message is printed twice."""
    counts = Counter(line for line in lines if line.strip())
    return ["a message printed twice"] * any(count > 1 for count in counts.values())


def wrong_places(lines: Sequence[str], folder: Path) -> list[str]:
    """Return a fault if a message names a line or column that its file does not have."""
    for message in lines:
        match = MESSAGE_PLACE.match(message)
        if match is None or not (folder / match["file"]).is_file():
            continue
        data = (folder / match["file"]).read_bytes()
        text = data.decode("utf-8", "replace").removeprefix("\ufeff")
        # a file that ends too early is refused behind its last line
        rows = [*re.split(r"\r\n|\n|\r", text), ""]
        line, column = int(match["line"]), int(match["column"])
        if line > len(rows) or column > len(rows[line - 1]) + 1:
            return ["a place that the file does not have"]
    return []


def invalid_json(arguments: Sequence[str], out: str) -> list[str]:
    """Return a fault if --json prints something else than one JSON document."""
    if "--json" not in arguments:
        return []
    try:
        json.loads(out)
    except json.JSONDecodeError:
        return ["output of --json that is not JSON"]
    return []


def motion_faults(
    clips: Path, size: tuple[int, int], lines: Sequence[str]
) -> list[str]:
    """Return faults of the trajectories below a folder of clips.

    They are values that are not finite, and a clip whose moving objects are all
    outside of the picture after its first fifth without a word about it.
    """
    faults = []
    for file in clips.rglob("trajectory.npz"):
        with np.load(file) as motion:
            poses, velocities = motion["poses"], motion["velocities"]
        if not (np.isfinite(poses).all() and np.isfinite(velocities).all()):
            faults.append("a trajectory that is not finite")
        elif not lines and has_left(poses, size):
            faults.append("silent though everything leaves the picture")
    return faults


def has_left(poses: np.ndarray, size: Sequence[int]) -> bool:
    """Return whether all bodies that move are far outside after the first fifth."""
    centres = poses[:, :, :2]
    is_moving = np.ptp(centres, axis=0).max(axis=-1) > MOVED
    if not is_moving.any():
        return False
    later = centres[-(-len(centres) // 5) :, is_moving]
    extent = np.array(size, float)
    is_outside = (later < -MARGIN * extent) | (later > (1 + MARGIN) * extent)
    return bool(is_outside.any(axis=-1).all())
