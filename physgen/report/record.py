"""The run record: inputs, stages and outputs of a run, written as manifest.json."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import __version__
from physgen.environment import this_machine
from physgen.files import write_atomic
from physgen.operating_system import peak_memory
from physgen.scene.files import DATA
from physgen.scene.scene import Scene

LIBRARIES = ("numpy", "pymunk", "opencv-python-headless", "av", "pillow")
REFINING = ("torch", "diffusers")
"""Libraries of models, with their versions in the record of a refinement."""
TIMING = "timing.json"
"""Times and memory of a run: the only file that differs between equal runs."""


@dataclass
class StageTime:
    """The cost of one stage."""

    wall: float = 0.0
    """s."""
    cpu: float = 0.0
    """Wall time, s."""


@dataclass
class RunRecord:
    """CPU time of all threads, s."""

    scene: str
    command: list[str]
    # The command for this clip only.
    clip_command: list[str] = field(default_factory=list)
    source: str = ""
    """Path of the scene file, relative to the clip's folder."""
    # Path relative to the scene's folder -> SHA-256.
    inputs: dict[str, str] = field(default_factory=dict)
    overrides: list[str] = field(default_factory=list)
    variant: str | None = None
    seeds: dict[str, int] = field(default_factory=dict)
    stages: dict[str, StageTime] = field(default_factory=dict)
    # SHA-256 of each trajectory sample.
    samples: list[str] = field(default_factory=list)
    frames: list[str] = field(default_factory=list)
    """SHA-256 of each frame's RGB bytes."""
    # `size`: width and height, px; `fps`: 1/s.
    video: dict[str, Any] = field(default_factory=dict)
    files: dict[str, str] = field(default_factory=dict)
    """Output file -> SHA-256."""
    warnings: list[dict[str, object]] = field(default_factory=list)
    document: Mapping[str, Any] = field(default_factory=dict)
    """The resolved scene."""
    effort: dict[str, float] = field(default_factory=dict)
    """Work of the engine; see `simulate.trajectory.Effort`."""
    imbalance: float = 0.0
    """Relative error of the energy balance; see `Trajectory.imbalance`."""
    fan: dict[str, Any] | None = None
    """Outcomes of draws of the scene's doubtful values; see `pipeline.fanning`.

    None if not requested.
    """
    refine: dict[str, Any] | None = None
    """`backend` and the entries of `Refinement.note`; or `backend` and the reason in
    `failed`.

    None if not requested.
    """
    mark: str = ""
    """Hash of all options of the clip; see `batch.resume`."""
    unrefined_frames: list[str] = field(default_factory=list)
    """SHA-256 of each frame's RGB bytes before refinement; empty without refinement."""

    @contextmanager
    def stage(
        self, name: str, clock: Callable[[], float] = time.process_time
    ) -> Iterator[None]:
        """Add the time of a block to a stage.

        `clock` measures CPU time, of all threads by default.
        """
        times = self.stages.setdefault(name, StageTime())
        wall, cpu = time.perf_counter(), clock()
        try:
            yield
        finally:
            times.wall += time.perf_counter() - wall
            times.cpu += clock() - cpu

    def manifest(self) -> dict[str, Any]:
        """Return the record as JSON data, with keys in reading order."""
        return {
            "manifest": 1,
            "scene": self.scene,
            "source": self.source,
            "command": self.command,
            "variant": self.variant,
            "overrides": self.overrides,
            "mark": self.mark,
            "versions": versions(self.refine),
            "platform": this_machine().as_dict(),
            "inputs": self.inputs,
            "seeds": self.seeds,
            "effort": self.effort,
            "energy_imbalance": self.imbalance,
            "fan": self.fan,
            "refine": self.refine,
            "warnings": self.warnings,
            "video": self.video,
            "files": self.files,
            "samples": self.samples,
            "frames": self.frames,
            "unrefined": self.unrefined_frames,
            "document": self.document,
        }

    def timing(self) -> dict[str, Any]:
        """Return the values that differ between equal runs, as JSON data."""
        stages = {}
        for name, t in self.stages.items():
            stages[name] = {k: round(v, 4) for k, v in asdict(t).items()}
        return {"stages": stages, "peak_memory_mib": round(peak_memory() / 2**20, 1)}


def versions(refine: Mapping[str, Any] | None = None) -> dict[str, str]:
    """Return the versions of physgen, Python and all libraries with an influence on the
    output, also in `refine`.
    """
    return _read_versions() | {
        name: str(refine[name]) for name in REFINING if refine and name in refine
    }


@cache
def _read_versions() -> dict[str, str]:
    known_versions = {"physgen": __version__, "python": platform.python_version()}
    return known_versions | {name: _installed_version(name) for name in LIBRARIES}


def _installed_version(name: str) -> str:
    """Read a version from the folder name of the metadata. Parsing the metadata takes
    as long as loading a scene.
    """
    # The first folder of the path has the imported version.
    for place in (place for place in sys.path if place.endswith("-packages")):
        for folder in Path(place).glob(f"{name.replace('-', '_')}-*.dist-info"):
            return folder.stem.partition("-")[2]
    return "unknown"


def file_hash(path: Path) -> str:
    """Compute the SHA-256 of a file in blocks.

    Raise OSError, also for anything but a regular file: reading a pipe never ends.
    """
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "is no plain file", str(path))
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def frame_hash(rgb: NDArray[np.uint8]) -> str:
    """Compute the SHA-256 of a frame's shape and bytes."""
    return hashlib.sha256(
        f"{rgb.shape}".encode() + np.ascontiguousarray(rgb).tobytes()
    ).hexdigest()


def source_of(path: Path, folder: Path) -> str:
    """Return the path of a scene from a clip's folder.

    Links are resolved in the folders, but not for the file itself: its name is the
    scene's name.
    """
    home = os.path.realpath(path.parent)
    return Path(
        os.path.relpath(os.path.join(home, path.name), os.path.realpath(folder))
    ).as_posix()


def write_json(path: Path, data: object) -> None:
    """Write indented UTF-8 JSON. It appears under its final name when complete."""
    text = json.dumps(data, indent=1, ensure_ascii=False, default=str) + "\n"
    # Paths may contain bytes without a character.
    write_atomic(path, text.encode("utf-8", "backslashreplace"))


def inputs(
    scene: Scene, path: Path, digest: Callable[[Path], str] = file_hash
) -> dict[str, str]:
    """Return the hashes of the scene file, the photo and every map, by path relative to
    the scene's folder.
    """
    files = [path, *scene.files]
    if scene.image is not None:
        files.append(scene.image)
        if scene.assets is not None and scene.assets.is_dir():
            files += sorted(
                p
                for p in scene.assets.iterdir()
                if p.suffix == ".png" or p.name in DATA
            )
    folder = scene.folder.resolve()
    paths = {}
    for file in dict.fromkeys(file.resolve() for file in files):
        paths[Path(os.path.relpath(file, folder)).as_posix()] = digest(file)
    return paths
