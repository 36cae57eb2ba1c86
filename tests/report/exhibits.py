"""Folders as `physgen render` leaves them, made without rendering: a manifest, a report and a small film each."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from physgen.export.video import Format, open_video

SIZE, FPS, FRAMES = (48, 32), 10, 11


def level(k: int, seed: int = 0) -> int:
    """The grey level of frame k of a film."""
    return 20 + 20 * k + seed


def film(folder: Path, seed: int = 0, kind: Format = Format.MP4) -> Path:
    """Eleven plain frames at 10 per second, each lighter than the one before."""
    with open_video(folder, kind, SIZE, FPS) as write:
        for k in range(FRAMES):
            write(np.full((SIZE[1], SIZE[0], 3), level(k, seed), np.uint8))
    return folder / kind.file


@cache
def _film(seed: int) -> bytes:
    with TemporaryDirectory() as folder:
        return film(Path(folder), seed).read_bytes()


def document(**changes: Any) -> dict[str, Any]:
    """A resolved scene; a dotted key in `changes` sets what it names."""
    scene: dict[str, Any] = {
        "world": {"view": "side", "gravity": [0, 980], "duration": 1},
        "objects": {
            name: {"label": label, "mass": 100, "friction": 0.5, "velocity": [0, 0]}
            for name, label in (("ball", "billiard ball"), ("crate", "wooden crate"))
        },
        "boundaries": {},
        "forces": [],
        "render": {"fps": 30},
    }
    for key, value in changes.items():
        *parents, last = key.split("__")
        inner = scene
        for parent in parents:
            inner = inner[parent]
        inner[last] = value
    return scene


def exhibit(
    folder: Path, resolved: dict[str, Any] | None = None, seed: int = 0, **told: Any
) -> Path:
    """One clip's folder; `told` goes into its manifest."""
    folder.mkdir(parents=True)
    (folder / "video.mp4").write_bytes(_film(seed))
    (folder / "report.html").write_text("<!doctype html><title>report</title>")
    files = {
        name: hashlib.sha256((folder / name).read_bytes()).hexdigest()
        for name in ("video.mp4", "report.html")
    }
    manifest = {
        "manifest": 1,
        "scene": folder.name,
        "variant": None,
        "overrides": [],
        "inputs": {},
        "warnings": [],
        "video": {"size": SIZE, "fps": FPS},
        "files": files,
        "samples": [""] * FRAMES,
        "frames": [""] * FRAMES,
        "document": document() if resolved is None else resolved,
        **told,
    }
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    return folder


def failure(folder: Path, name: str, problem: str, **told: Any) -> Path:
    """What a clip leaves that failed."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.failed.json"
    trace = {
        "failed": 1,
        "scene": name,
        "path": f"{name}.yaml",
        "variant": None,
        "overrides": [],
        "command": ["physgen", "render"],
        "problems": [problem],
        "warnings": [],
        **told,
    }
    file.write_text(json.dumps(trace), encoding="utf-8")
    return file


def sweep(
    home: Path, masses: list[float], frictions: list[float], broken: int | None = None
) -> Path:
    """One clip for every pair of values; number `broken` failed."""
    for k, (mass, friction) in enumerate((m, f) for m in masses for f in frictions):
        told = [f"objects.*.mass={mass}", f"objects.ball.friction={friction}"]
        if k == broken:
            failure(
                home / f"run-{k}",
                "pair",
                "pair.yaml:3:1: the disk is full",
                overrides=told,
            )
            continue
        scene = document(
            objects__ball__mass=mass,
            objects__crate__mass=mass,
            objects__ball__friction=friction,
        )
        exhibit(home / f"run-{k}" / "pair", scene, seed=k % 10, overrides=told)
    return home
