"""Check backends: each usable one runs once on a drawn photo; times, memory and faults.

`INPUTS` has the arguments of every role. Inputs from other roles come from their
default backends.
"""

from __future__ import annotations

import gc
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from physgen import registry
from physgen.geometry.polygon import Disc, Region, Ring
from physgen.maps import F32
from physgen.messages import Message
from physgen.operating_system import peak_memory, reset_peak_memory
from physgen.perceive.roles import (
    BoundaryGuess,
    Category,
    Intrinsics,
    Labels,
    LightGuess,
    Matter,
    PhotoObject,
    Rgb,
)
from physgen.refine.denoiser import PromptSettings
from physgen.refine.fusion import Refinement, RefineSettings
from physgen.registry import Backend, Choice, Plan, Setup
from physgen.weights import offline_hub

SIZE = (128, 96)
"""Width and height of the photo, px: a detector finds its shapes, and a model on a CPU
takes seconds.
"""
HORIZON = 70
"""First row of the table, px."""
BALL = (36, 60, 16)
"""Centre and radius, px."""
BLOCK = (78, 46, 26, 32)
"""Left, top, width and height, px."""
GRAIN = 2.0
"""Standard deviation of the grain, grey levels: a photo is never flat."""
OFFSETS = range(0, 16, 2)
"""Shifts of the picture in the frames of the clip, px."""
REFINE = RefineSettings(
    strength=0.5,
    stop=1,
    steps=4,
    seed=0,
    prompt=PromptSettings("a ball and a block", "blur", None),
    lock=0.0,
    detail=1.0,
    hold=0,
)
"""Two steps with and without fusion: times per step are in the reports of clips."""


@dataclass(frozen=True)
class BackendCheck:
    """The result of one backend."""

    role: str
    name: str
    weights: str
    """Weights of the choice; `""`: the row's own."""
    missing: Sequence[str] = ()
    """The fix of each missing part. The backend runs only without missing parts."""
    fault: str = ""
    """Reason of a failure; empty after success."""
    load_seconds: float | None = None
    run_seconds: float | None = None
    memory_bytes: int | None = None
    """Growth of the process's memory at its peak."""
    gpu_bytes: int | None = None
    """Peak of torch's memory on the GPU; None without a GPU."""

    @property
    def state(self) -> str:
        """Return `ready`, `missing` or `failed`."""
        if self.missing:
            return "missing"
        if self.fault:
            return "failed"
        return "ready"

    @property
    def setting(self) -> str:
        """Return the choice in the form of a flag."""
        return f"{self.role}={Choice(self.name, self.weights)}"

    def as_json(self) -> dict[str, Any]:
        """Return all fields, with the state first."""
        return {"state": self.state, **asdict(self)}


class Sample:
    """A ball and a block on a table before a wall, with the inputs of all roles; rows
    refer to them by name.
    """

    categories = (Category("ball", True), Category("block", True))
    scenery = None

    def __init__(self, seed: int = 0) -> None:
        """Draw the sample; `seed` belongs to the grain."""
        self.labels: Labels = np.zeros(SIZE[::-1], np.uint16)
        self.rgb = self._draw(seed)
        left, top, width, height = BLOCK
        right = left + width - 0.5
        bottom = top + height - 0.5
        corners = np.array(
            [
                [left - 0.5, top - 0.5],
                [right, top - 0.5],
                [right, bottom],
                [left - 0.5, bottom],
            ]
        )
        x, y, radius = BALL
        self.objects = [
            PhotoObject(1, Disc(np.array([x, y], float), float(radius)), "ball"),
            PhotoObject(2, Region((Ring(corners),)), "wooden block"),
        ]

    def _draw(self, seed: int) -> Rgb:
        """Draw the photo (H, W, 3) and its labels."""
        picture = np.empty((*self.labels.shape, 3), np.float64)
        picture[:HORIZON] = (90, 110, 140)
        picture[HORIZON:] = (150, 110, 70)
        rows, columns = np.indices(self.labels.shape)
        x, y, radius = BALL
        # A shaded ball, so that backends see its shape.
        offset = np.hypot(columns - x, rows - y) / radius
        ball = offset <= 1
        shading = 0.5 + 0.5 * np.sqrt(np.maximum(0, 1 - offset**2))
        picture[ball] = (np.array([200, 60, 40]) * shading[..., None])[ball]
        self.labels[ball] = 1
        left, top, width, height = BLOCK
        block = np.s_[top : top + height, left : left + width]
        picture[block] = (220, 200, 120)
        self.labels[block] = 2
        # Grain of a camera: a perfectly even picture would be unlike any photo.
        picture += np.random.default_rng(seed).normal(0, GRAIN, picture.shape)
        return np.clip(picture, 0, 255).astype(np.uint8)

    @cached_property
    def boundary(self) -> BoundaryGuess:
        """Return the view and walls."""
        find = registry.make("boundary")
        guess: BoundaryGuess = find(self.rgb, self.labels, self.objects, None)
        return guess

    @cached_property
    def normals(self) -> F32:
        """Return unit normals (H, W, 3)."""
        find = registry.make("normals")
        normals: F32 = find(self.rgb, self.labels, self.objects, self.boundary)
        return normals

    @cached_property
    def depth(self) -> F32:
        """Return (H, W): a table up to a wall, and objects on its middle."""
        width, height = SIZE
        column = np.interp(np.arange(height), (HORIZON, height - 1), (2, 1))
        depth = np.repeat(column[:, None], width, axis=1)
        depth[self.labels > 0] = 1.5
        return depth.astype(np.float32)

    @cached_property
    def intrinsics(self) -> Intrinsics:
        """Return albedo and shading."""
        split = registry.make("intrinsic")
        intrinsics: Intrinsics = split(self.rgb, self.labels, self.normals)
        return intrinsics

    @cached_property
    def light(self) -> LightGuess:
        """Return the light."""
        find = registry.make("light")
        surfaces = self.normals, self.intrinsics
        guess: LightGuess = find(self.rgb, self.labels, self.objects, *surfaces)
        return guess

    @cached_property
    def matter(self) -> Mapping[int, Matter]:
        """Return properties of the objects."""
        judge = registry.make("physics")
        matter: Mapping[int, Matter] = judge(self.rgb, self.objects, None)
        return matter

    @property
    def coverage(self) -> F32:
        """Return the coverage of objects, (H, W): 0 or 1."""
        return (self.labels > 0).astype(np.float32)


INPUTS: Mapping[str, Callable[[Sample], tuple[Any, ...]]] = {
    "categories": lambda sample: (sample.rgb,),
    "segment": lambda sample: (sample.rgb,),
    "label": lambda sample: (sample.rgb, sample.labels, sample.objects),
    "physics": lambda sample: (sample.rgb, sample.objects, None),
    "depth": lambda sample: (sample.rgb,),
    "normals": lambda sample: (
        sample.rgb,
        sample.labels,
        sample.objects,
        sample.boundary,
    ),
    "intrinsic": lambda sample: (sample.rgb, sample.labels, sample.normals),
    "light": lambda sample: (
        sample.rgb,
        sample.labels,
        sample.objects,
        sample.normals,
        sample.intrinsics,
    ),
    "matte": lambda sample: (sample.rgb, sample.labels),
    "inpaint": lambda sample: (sample.rgb, sample.labels > 0),
    "shadow": lambda sample: (
        sample.rgb,
        sample.coverage,
        sample.labels,
        sample.objects,
        sample.matter,
        sample.boundary,
        sample.light,
    ),
    "boundary": lambda sample: (sample.rgb, sample.labels, sample.objects, None),
    "refine": lambda sample: (
        [np.roll(sample.rgb, offset, axis=1) for offset in OFFSETS],
        [np.roll(sample.coverage, offset, axis=1) for offset in OFFSETS],
    ),
}
"""Positional arguments of each role; `refine` has frames and coverage."""


def read_choices(settings: Sequence[str]) -> list[tuple[str, Choice]]:
    """Read choices `ROLE=NAME[:WEIGHTS]`, also several of one role. Raise
    InputError.
    """
    pairs: list[tuple[str, Choice]] = []
    for setting in settings:
        pairs += registry.choices([setting]).items()
    for role, choice in pairs:
        if choice.name == registry.MAP_FILE and choice.weights:
            raise Message.MAP_IN_CHECK.error(
                "--check", f'"{role}={choice}"', reader=f"{role}={choice.name}"
            )
    return pairs


def check_backends(
    plan: Plan, pairs: Sequence[tuple[str, Choice]] = ()
) -> Iterator[BackendCheck]:
    """Yield the check of each pair of role and choice, or of all rows, one after the other.

    The plan has weights, device and options. Nothing is fetched.
    """
    for role, choice in pairs or _all_choices(plan):
        with offline_hub():
            yield _check(replace(plan, choices={role: choice}), role)


def _all_choices(plan: Plan) -> Iterator[tuple[str, Choice]]:
    """Yield every row with a program, with the plan's weights."""
    for row in registry.BACKENDS:
        if row.target:
            choice = plan.choices.get(row.role)
            is_own = choice is None or choice.name != row.name or _reads_map(row)
            yield row.role, Choice(row.name) if is_own or choice is None else choice


def _check(plan: Plan, role: str) -> BackendCheck:
    """Check the plan's backend of `role`."""
    row = plan.row(role)
    choice = plan.choices[role]
    check = BackendCheck(role, row.name, choice.weights)
    with tempfile.TemporaryDirectory() as folder:
        # Answers of a server are cached by picture: each check draws another grain.
        sample = Sample(time.time_ns() if row.settings else 0)
        if _reads_map(row):
            path = _write_map(role, sample, Path(folder))
            plan = replace(plan, choices={role: Choice(row.name, str(path))})
        missing = registry.missing_parts(row, plan)
        if missing:
            return replace(check, missing=missing)
        if not row.target:
            return check
        try:
            return replace(check, **_measure(row, plan.setup(role), sample))
        # Libraries raise errors of every type for broken weights.
        except Exception as error:
            return replace(check, fault=registry.describe_error(error))


def _measure(row: Backend, setup: Setup, sample: Sample) -> dict[str, Any]:
    """Return times and memory of a load and a run, by the fields of `BackendCheck`."""
    arguments = INPUTS[row.role](sample)
    extra = {key: getattr(sample, key) for key in row.uses}
    # Peaks are those of this load and run only.
    reset_peak_memory()
    _reset_gpu_peak()
    memory = peak_memory()
    start = time.perf_counter()
    with _release_after(registry.make(row.role, row.name, setup)) as backend:
        load = getattr(backend, "load", None)
        if load is not None:
            load()
        loaded = time.perf_counter()
        _run(row.role, backend, arguments, extra)
        end = time.perf_counter()
        return {
            "load_seconds": round(loaded - start, 3),
            "run_seconds": round(end - loaded, 3),
            "memory_bytes": peak_memory() - memory,
            "gpu_bytes": _gpu_peak(),
        }


@contextmanager
def _release_after(backend: Any) -> Iterator[Any]:
    """Close a backend at the end, and return its memory."""
    try:
        yield backend
    finally:
        close = getattr(backend, "close", None)
        if close is not None:
            close()
        gc.collect()


def _run(
    role: str, backend: Any, arguments: tuple[Any, ...], extra: Mapping[str, Any]
) -> None:
    """Run a backend once. Raise ValueError for infinite numbers."""
    if role == "refine":
        refinement = Refinement(backend, REFINE, SIZE, len(OFFSETS))
        _refuse_infinite(list(refinement.frames(*arguments)))
        return
    _refuse_infinite(backend(*arguments, **extra))
    if role == "segment" and hasattr(backend, "segment_meant_objects"):
        x, y, _ = BALL
        backend.segment_meant_objects(arguments[0], [BLOCK], [(x, y)])


def _refuse_infinite(result: Any) -> None:
    """Raise ValueError if a result is an array, or a list of arrays, with infinite
    numbers.
    """
    if isinstance(result, list):
        arrays = result
    else:
        arrays = [result]
    for array in arrays:
        if isinstance(array, np.ndarray) and not np.isfinite(array).all():
            raise ValueError("it returns numbers that are not finite")


def _reads_map(row: Backend) -> bool:
    return row.name == registry.MAP_FILE


def _write_map(role: str, sample: Sample, folder: Path) -> Path:
    """Write the map for the backend `file` of a role, as another program would."""
    if role == "inpaint":
        path = folder / "background.png"
        cv2.imwrite(str(path), np.full_like(sample.rgb, 120))
        return path
    path = folder / f"{role}.npy"
    if role == "intrinsic":
        np.save(path, sample.intrinsics.shading)
    else:
        np.save(path, getattr(sample, role))
    return path


def _cuda() -> Any:
    """Return `torch.cuda`, or None without a GPU or before a backend has imported
    torch.
    """
    torch = sys.modules.get("torch")
    if torch is not None and torch.cuda.is_available():
        return torch.cuda
    return None


def _reset_gpu_peak() -> None:
    cuda = _cuda()
    if cuda is not None:
        cuda.reset_peak_memory_stats()


def _gpu_peak() -> int | None:
    """Return the peak in bytes."""
    cuda = _cuda()
    if cuda is None:
        return None
    return int(cuda.max_memory_allocated())
