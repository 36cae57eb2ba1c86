"""Right and wrong clips by `evaluate plausibility`, on seeds that no threshold was chosen on, and our own scenes."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from physgen import pipeline
from physgen.evaluate.plausibility.judge import Verdict, judge
from physgen.evaluate.plausibility.tracks import Tracks, from_scene, from_world
from physgen.scene.load import OpenedScene

from .confusion import counted
from .trial import HELD_OUT, trial

ROOT = Path(__file__).resolve().parents[2]
SEEDS = 24


def plausibility(folder: Path) -> list[dict]:
    """The answers for the clips of the calibration, and of each bundled scene and variant."""
    said = trial(range(HELD_OUT, HELD_OUT + SEEDS), os.cpu_count() or 1)
    rows = [
        {key: value for key, value in row.items() if key != "scores"}
        for row in counted(said)
    ]
    return [*rows, *scenes(), *studio()]


def scenes() -> list[dict]:
    """Bundled scenes with their variants, and the first draws of the physics scorecard."""
    rows = []
    for path, variant in bundled_clips():
        verdict = judge(from_scene(path, variant=variant))
        row = {
            "scene": str(path.relative_to(ROOT)),
            "variant": variant,
            "score": verdict.overall,
            "asked": {},
        }
        row["asked"] = {
            name: len(found) for name, found in verdict.answers.items() if found
        }
        row["faults"] = [
            f"{name}: {evidence.text}" for name, evidence in verdict.faults()[:3]
        ]
        rows.append(
            row | {"score": None if row["score"] is None else round(row["score"], 4)}
        )
    return rows


def bundled_clips() -> Iterator[tuple[Path, str | None]]:
    """Files of bundled scenes, and None or a variant."""
    for path in sorted((ROOT / "scenes").glob("*/*.yaml")):
        yield path, None
        for variant in OpenedScene(path).document().get("variants") or {}:
            yield path, variant


def studio() -> list[dict]:
    """The studio's truth: poses of its films and of the 50 clips of one scene."""
    rows = []
    for path in sorted((ROOT / "studio/truth").glob("*/film/film.json")):
        told = json.loads(path.read_text())
        name = path.parent.parent.name
        posed = _posed(told["scene"], (), told["times_s"], told["objects"])
        rows.append(_row(f"{name}, film", "poses", [judge(posed)]))
    for path in sorted((ROOT / "studio/truth").glob("*/clips/clips.json")):
        told = json.loads(path.read_text())
        clips = [
            _posed(told["scene"], clip["set"], told["times_s"], clip["poses"])
            for clip in told["clips"]
        ]
        rows.append(
            _row(f"{path.parent.parent.name}, clips", "poses", list(map(judge, clips)))
        )
    return rows


def _posed(
    scene: str, overrides: Sequence[str], times: list[float], objects: dict
) -> Tracks:
    loaded = pipeline.load(ROOT / scene, tuple(overrides))
    world = pipeline.compile(loaded, pipeline.percepts(loaded)).world
    poses = np.array([objects[body.name] for body in world.bodies]).transpose(1, 0, 2)
    poses[..., 2] = np.radians(poses[..., 2])
    return from_world(scene, world, np.array(times), poses)


def _row(name: str, tracks: str, verdicts: list[Verdict]) -> dict:
    scores = [verdict.overall for verdict in verdicts if verdict.overall is not None]
    return {
        "studio": name,
        "tracks": tracks,
        "clips": len(verdicts),
        "called_wrong": sum(verdict.is_wrong is True for verdict in verdicts),
        "not_asked": len(verdicts) - len(scores),
        "least": round(min(scores), 4) if scores else None,
        "faults": [
            f"{name}: {evidence.text}"
            for verdict in verdicts
            for name, evidence in verdict.faults()[:1]
        ][:3],
    }
