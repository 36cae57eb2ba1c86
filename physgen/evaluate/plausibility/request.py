"""What the caller states about tracks, and tables of rows as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from physgen.evaluate.plausibility.tracks import Array, Known, Outline, Tracks
from physgen.problems import InputError, Place, Problem
from physgen.scene.scene import View
from physgen.text import natural

FPS = 30.0
"""1/s, where no one says it."""
MOST_FRAMES, MOST_CELLS = 100_000, 5_000_000
"""Frames, and frames times bodies."""
EVEN = 0.25
"""Of a frame's time: by so much times may be off an even grid, as rounded ones are."""


@dataclass(frozen=True)
class Request:
    """Flags of the command."""

    fps: float | None = None
    view: View = View.SIDE
    masses: Mapping[str, float] = field(default_factory=dict)
    """Name -> g."""
    held: tuple[str, ...] = ()
    pushed: tuple[tuple[str, float, float], ...] = ()
    """Name, from, until, s."""

    def applied(self, tracks: Tracks) -> Tracks:
        """Masses, what is held and what is pushed, by name. Raises InputError for names that are not there."""
        known = {name: k for k, name in enumerate(tracks.names)}
        named = [*self.masses, *self.held, *(name for name, _, _ in self.pushed)]
        problems = [
            Problem(
                Place(tracks.name),
                "",
                f'"{name}"',
                "is none of its bodies",
                f"it has {', '.join(tracks.names[:8])}",
            )
            for name in dict.fromkeys(named)
            if name not in known
        ]
        if problems:
            raise InputError(problems)
        given = tracks.given
        given = replace(
            given,
            held=given.held | {known[name] for name in self.held},
            pushed=(*given.pushed, *((known[name], start, end) for name, start, end in self.pushed)),
        )
        masses, weighed = tracks.masses, tracks.weighed
        if self.masses:
            missing = [name for name in tracks.names if name not in self.masses]
            if missing and not tracks.weighed:
                fix = f"weigh them too: --mass {missing[0]}=100"
                raise InputError.of(
                    tracks.name, f'"{", ".join(missing[:5])}"', "have no mass, others have", fix
                )
            masses = np.array(
                [self.masses.get(n, m) for n, m in zip(tracks.names, masses.tolist(), strict=True)]
            )
            weighed = True
        return replace(tracks, given=given, masses=masses, weighed=weighed)


@dataclass(frozen=True)
class Row:
    """One body in one frame."""

    name: str
    x: float
    y: float
    angle: float = np.nan
    core: float = 0.0
    reach: float = 0.0


def from_rows(
    name: str,
    frames: Sequence[int],
    rows: Sequence[Row],
    fps: float,
    floor: float,
    source: str,
    asked: Request,
) -> Tracks:
    """`rows` with the frame of each, from 0 on. Raises InputError for a body twice in a frame, and for too many."""
    if not rows:
        raise InputError.of(name, "", "has no tracks", "give what moves in it an id in every frame")
    names = sorted({row.name for row in rows}, key=natural)
    count = max(frames) + 1
    if count > MOST_FRAMES or count * len(names) > MOST_CELLS:
        found = f"{count:,} frames of {len(names):,} bodies"
        raise InputError.of(name, found, "are too many", f"keep frames x bodies below {MOST_CELLS:,}")
    places = np.full((count, len(names), 2), np.nan)
    angles = np.full((count, len(names)), np.nan)
    cores: list[list[float]] = [[] for _ in names]
    reaches: list[list[float]] = [[] for _ in names]
    index = {one: k for k, one in enumerate(names)}
    for frame, row in zip(frames, rows, strict=True):
        k = index[row.name]
        if np.isfinite(places[frame, k]).all():
            fix = "give each body an id of its own"
            raise InputError.of(name, f'"{row.name}"', f"is twice in frame {frame}", fix)
        places[frame, k] = row.x, row.y
        angles[frame, k] = row.angle
        cores[k].append(row.core)
        reaches[k].append(row.reach)
    forms = tuple(
        Outline(float(np.quantile(c, 0.2)), float(np.quantile(r, 0.8)), 0.6 * float(np.quantile(r, 0.8)))
        for c, r in zip(cores, reaches, strict=True)
    )
    return Tracks(
        name, np.arange(count) / fps, tuple(names), places, angles, forms, areas(forms), False, asked.view, floor,
        source, Known(), flat=False,
    )  # fmt: skip


def areas(forms: Sequence[Outline]) -> Array:
    """(N,): px² of discs as large as they reach; 1 for all where one is a point."""
    sizes = np.array([form.reach**2 for form in forms])
    return sizes if (sizes > 0).all() else np.ones(len(forms))


def frames_of(times: Array, name: str) -> tuple[list[int], float]:
    """s -> frames from 0 on, and 1/s. Raises InputError for times that are not even."""
    rising = np.unique(times)
    if len(rising) < 2:
        raise InputError.of(name, f"{len(rising)} moment", "is no motion", "give a row a frame and body")
    step = float(np.median(np.diff(rising)))
    frames = np.rint((times - rising[0]) / step)
    if np.abs((times - rising[0]) / step - frames).max() > EVEN or frames.max() > MOST_FRAMES:
        raise InputError.of(name, "its times", "are not evenly spaced", "give a column frame, and --fps")
    span = float(rising[-1] - rising[0]) / max(float(frames.max()), 1.0)
    return [int(frame) for frame in frames], 1 / span


def title(path: Path) -> str:
    """What a clip is called: its file's stem, or its folder's where all files are called so."""
    if path.stem in ("gt", "annotations", "tapvid", "trajectory", "scene"):
        folder = path.parent
        return (
            (folder.parent if folder.name in ("gt", "coco", "mot", "tapvid", "trajectory") else folder)
            .resolve()
            .name
        )
    return path.stem
