"""Scene file -> its clip as golden files keep it: the motion, a few small frames, and what they were made of."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.cache.keys import ROOMS, code_version
from physgen.compile.world import World
from physgen.golden.asking import Asked
from physgen.golden.tracks import LATE
from physgen.pipeline import Warm
from physgen.pipeline.filming import Filming
from physgen.problems import InputError
from physgen.report.record import RunRecord, inputs, json_text, versions
from physgen.scene.model import Scene
from physgen.simulate.trajectory import Trajectory

U8 = NDArray[np.uint8]

LONGEST = 200_000
"""Letters of a resolved scene, as JSON, that are kept: deflated, a tenth of that."""


@dataclass(frozen=True)
class Still:
    """A frame that is kept."""

    index: int
    """In the clip, from 0."""
    time: float
    """s of the motion."""
    rgb: U8
    """(h, w, 3) sRGB, small."""


@dataclass(frozen=True)
class Made:
    """What a clip was made of, as JSON data."""

    asked: dict[str, Any]
    """`overrides`, `variant` and `until`."""
    inputs: dict[str, str]
    """SHA-256 of the files that were read, by path relative to the scene's folder."""
    document: dict[str, Any] | None
    """The resolved scene; None for one that is too long to be kept."""
    versions: dict[str, str]
    """Of physgen, Python and libraries; `sources`: a hash of physgen's own."""
    machine: dict[str, str]
    """`kind` of processor, `system`, and which `instructions` OpenCV uses there."""
    size: tuple[int, int]
    """Width and height of the video, px."""
    on_photo: bool
    """Whether the video's first frame shows the whole canvas, as it is at t = 0."""


@dataclass(frozen=True)
class Clip:
    """A clip that was just made."""

    trajectory: Trajectory
    stills: tuple[Still, ...] | None
    """None: nobody asked."""
    made: Made
    world: World


def taken(path: Path, asked: Asked, warm: Warm) -> Clip:
    """Simulate a scene and draw the frames that are kept; nothing comes from the disk's cache. Raises InputError."""
    scene = warm.load(path, asked.overrides, asked.variant, asked.allow_outside)
    maps = warm.maps(scene)
    compiled = warm.compile(scene, maps)
    trajectory = warm.simulate(compiled.world, cached=False)
    filming = Filming(scene, compiled, maps, "cpu", RunRecord(scene=scene.name, command=[]), warm)
    shot = filming.shot(trajectory)
    stills = None
    if asked.pixels is not None:
        shown = _shown(asked, [float(trajectory.times[sample]) for sample in shot.order])
        frames = filming.frames(trajectory, [shot.order[index] for index in shown])
        drawn = filming.annotated(frames, trajectory)
        stills = tuple(
            Still(index, frame.time, small(frame.rgb, asked.side))
            for index, frame in zip(shown, drawn, strict=True)
        )
    return Clip(
        trajectory,
        stills,
        _made(scene, path, asked, warm, shot.opens_on_photo),
        compiled.world,
    )


def _shown(asked: Asked, times: Sequence[float]) -> list[int]:
    """Which frames of a clip are kept, by the time, s, that each of them shows."""
    early = [k for k, time in enumerate(times) if asked.until is None or time <= asked.until + LATE]
    if isinstance(asked.frames, int):
        picks = np.linspace(0, len(early) - 1, min(asked.frames, len(early))).round().astype(int)
        return [early[k] for k in dict.fromkeys(picks.tolist())]
    if late := [index for index in asked.frames if index not in early]:
        found = ", ".join(map(str, late))
        what = (
            f"are not among the clip's first {len(early)}"
            if asked.until is None
            else f"are not before {asked.until} s"
        )
        raise InputError.of("frames", found, what, "frames are counted from 0")
    return sorted(set(asked.frames))


def small(rgb: U8, side: int) -> U8:
    """(H, W, 3) -> (h, w, 3), its longer side at most `side`: means of the pixels, as they are encoded."""
    height, width = rgb.shape[:2]
    factor = side / max(height, width)
    if factor >= 1:
        return rgb
    size = max(1, round(width * factor)), max(1, round(height * factor))
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def _made(scene: Scene, path: Path, asked: Asked, warm: Warm, on_photo: bool) -> Made:
    document = json.loads(json_text(scene.document))
    return Made(
        asked={"overrides": list(asked.overrides), "variant": asked.variant, "until": asked.until},
        inputs=inputs(scene, path, warm.hash),
        document=document if len(json.dumps(document)) <= LONGEST else None,
        versions={**versions(), "sources": code_version(ROOMS)["sources"]},
        machine={
            "kind": platform.machine(),
            "system": platform.system(),
            "instructions": cv2.getCPUFeaturesLine(),
        },
        size=scene.video_size,
        on_photo=on_photo,
    )
