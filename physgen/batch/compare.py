"""Compare two clips: motion sample by sample, frames pixel by pixel."""

from __future__ import annotations

import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physgen.batch.golden_files import LATE, Still, Track, Units, track
from physgen.batch.tolerances import Motion, Pixels
from physgen.problems import InputError
from physgen.simulate.trajectory import Trajectory, read_trajectory

if TYPE_CHECKING:
    from physgen.export.video import Format
    from physgen.render.stage import Frame


# ----------------------------------------------------------------------
# The motion that a clip was made of, and what its scene moves like now -> the first sample and objects that
# differ.

Array = NDArray[np.float64]

ROUNDING = 1e-6
"""px, rad, px/s and rad/s: less is how two machines round, or two orders of summing; nobody sees it."""


@dataclass(frozen=True)
class Apart:
    """How far an object is from where it was, at one sample."""

    object: str
    px: float
    rad: float
    """In the photo's plane, whole turns counted."""
    px_s: float
    """px/s: of its velocity."""
    rad_s: float
    turned: float
    """rad: of how a sphere has turned in space."""

    @property
    def rounding(self) -> bool:
        """No more than rounding."""
        return max(self.px, self.rad, self.px_s, self.rad_s, self.turned) < ROUNDING


@dataclass(frozen=True)
class Farthest:
    """Where an amount is the largest of the whole clip."""

    amount: float
    object: str
    sample: int
    time: float
    """s."""


@dataclass(frozen=True)
class MotionDifference:
    """How two motions differ."""

    sample: int
    """The first that differs by more than rounding; where none does, the first that differs at all."""
    time: float
    """s."""
    objects: tuple[Apart, ...] = ()
    """Those that differ there, the farthest first; empty where the old motion is not known."""
    most_px: Farthest | None = None
    most_rad: Farthest | None = None
    rounding: tuple[int, float, tuple[str, ...]] | None = None
    """Before that: the first sample that differs by rounding, its time, and the objects."""
    gone: tuple[str, ...] = ()
    """Objects that are there no more."""
    new: tuple[str, ...] = ()
    samples: tuple[int, int] = (0, 0)
    """How many there were, and are."""
    retimed: bool = False
    """Samples are at other times now, from that one on: nothing can be compared there."""
    unnamed: str = ""
    """Why objects cannot be told."""


def stored_motion(path: Path, samples: Sequence[str]) -> Trajectory | None:
    """A clip's trajectory.npz, if it holds the `samples` of the manifest."""
    if not path.is_file():
        return None
    try:
        trajectory = read_trajectory(path)
        count, bodies = len(trajectory.times), len(trajectory.names)
        whole = (
            trajectory.poses.shape == trajectory.velocities.shape == (count, bodies, 3)
            and trajectory.turns.shape in ((count, 0, 4), (count, bodies, 4))
            and {a.dtype for a in (trajectory.poses, trajectory.velocities, trajectory.turns)}
            == {np.dtype(float)}
        )
        return trajectory if whole and trajectory.sample_hashes() == list(samples) else None
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        EOFError,
        zipfile.BadZipFile,
        zlib.error,
        AttributeError,
    ):
        return None


def apart(samples: Sequence[str], then: Trajectory | None, now: Trajectory) -> MotionDifference | None:
    """None where the motion is the same; `samples` are the hashes of the old one, `then` itself, where it is known."""
    hashes = now.sample_hashes()
    counts = len(samples), len(hashes)
    first = next((k for k, (a, b) in enumerate(zip(samples, hashes, strict=False)) if a != b), None)
    if first is None and counts[0] != counts[1]:
        first = min(counts)
    if then is None:
        if first is None:
            return None
        why = "trajectory.npz does not hold the old motion"
        return MotionDifference(first, _time(now, first), samples=counts, unnamed=why)
    shared = [name for name in then.names if name in now.names]
    table = _Table(then, now, shared)
    differs = table.differs
    if first is None and not differs.any():
        return None
    gone = tuple(name for name in then.names if name not in now.names)
    new = tuple(name for name in now.names if name not in then.names)
    rows = np.flatnonzero(differs.any(axis=1))
    if not len(rows):  # objects came or went, or the clip is longer, or sampled at other times
        at = first or 0
        return MotionDifference(
            at, _time(now, at), gone=gone, new=new, samples=counts, retimed=at >= table.count < min(counts)
        )
    row, early = int(rows[0]), None
    large = table.largest >= ROUNDING
    if large.any():
        first_large = int(np.flatnonzero(large.any(axis=1))[0])
        if first_large > row:
            early = row, _time(now, row), tuple(shared[k] for k in np.flatnonzero(differs[row]))
        row, differs = first_large, large
    objects = [table.apart(row, int(k)) for k in np.flatnonzero(differs[row])]
    objects.sort(key=lambda item: (-item.px, -item.rad, -item.px_s, -item.rad_s, -item.turned, item.object))
    return MotionDifference(
        sample=row,
        time=_time(now, row),
        objects=tuple(objects),
        most_px=table.farthest(table.px),
        most_rad=table.farthest(table.rad),
        rounding=early,
        gone=gone,
        new=new,
        samples=counts,
        retimed=table.count < min(counts),
    )


def _time(trajectory: Trajectory, sample: int) -> float:
    """s of a sample, the last one's where there is none."""
    times = trajectory.times
    return float(times[min(sample, len(times) - 1)]) if len(times) else 0.0


class _Table:
    """(T, N) each: how far the objects of both motions are apart, at the samples that both have."""

    def __init__(self, then: Trajectory, now: Trajectory, names: Sequence[str]) -> None:
        count = min(len(then.times), len(now.times))
        same = then.times[:count] == now.times[:count]
        count = self.count = count if same.all() else int(same.argmin())
        """Samples at the same times."""
        self.names, self._now = tuple(names), now
        old, new = ([t.names.index(name) for name in names] for t in (then, now))
        sides = ((then, old), (now, new))
        poses = [t.poses[:count, pick] for t, pick in sides]
        speeds = [t.velocities[:count, pick] for t, pick in sides]
        between, change = poses[1] - poses[0], speeds[1] - speeds[0]
        self.px = np.hypot(between[..., 0], between[..., 1])
        self.rad = np.abs(between[..., 2])
        self.px_s = np.hypot(change[..., 0], change[..., 1])
        self.rad_s = np.abs(change[..., 2])
        self.turned = np.zeros(self.px.shape)
        self.differs = _bits(*poses) | _bits(*speeds)
        if then.turns.shape[1] == len(then.names) and now.turns.shape[1] == len(now.names) and names:
            turns = [t.turns[:count, pick] for t, pick in sides]
            near, far = (np.linalg.norm(turns[1] - side * turns[0], axis=-1) for side in (1, -1))
            turning = _bits(*turns)
            self.turned = 4 * np.arcsin(np.clip(np.minimum(near, far) / 2, 0.0, 1.0))  # q and -q turn alike
            self.differs |= turning
        self.largest = np.max([self.px, self.rad, self.px_s, self.rad_s, self.turned], axis=0)

    def time(self, sample: int) -> float:
        """s."""
        return _time(self._now, sample)

    def apart(self, sample: int, k: int) -> Apart:
        """Of one object."""
        at = sample, k
        px, rad, px_s, rad_s, turned = (
            float(part[at]) for part in (self.px, self.rad, self.px_s, self.rad_s, self.turned)
        )
        return Apart(self.names[k], px, rad, px_s, rad_s, turned)

    def farthest(self, amounts: Array) -> Farthest | None:
        """None where it is nowhere above 0."""
        if not amounts.size or amounts.max() <= 0:
            return None
        sample, k = np.unravel_index(int(amounts.argmax()), amounts.shape)
        return Farthest(float(amounts.max()), self.names[int(k)], int(sample), self.time(int(sample)))


def _bits(one: Array, other: Array) -> NDArray[np.bool_]:
    """(T, N): whether any bit differs; what is equal as a number need not be."""
    differ = np.ascontiguousarray(one).view(np.int64) != np.ascontiguousarray(other).view(np.int64)
    return np.asarray(differ.any(axis=-1), np.bool_)


# ----------------------------------------------------------------------
# Frames that are drawn now, and a clip's hashes and films -> the first frame that differs, how many pixels,
# how far.
#
# A run keeps a hash of each frame, and the frames themselves only as PNG. Any other film has lost something
# of them, so
# the new frames are made into such a film, too, and the two are compared as they are decoded. What an encoder
# makes of a
# frame depends on the frames around it, so frames that are alike may come out a little differently: what is
# less than the
# film loses of its own frames says nothing.

U8 = NDArray[np.uint8]
Draw = Callable[[], Iterator["Frame"]]
"""Draws the clip from its first frame on."""
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Differing:
    """Which frames do."""

    frames: tuple[int, ...]
    """Among those that both clips have."""
    times: tuple[float, ...]
    """s of the motion: what each of them shows."""
    count: int
    """Frames that there are now."""


@dataclass(frozen=True)
class Amount:
    """How much of one frame differs."""

    frame: int
    pixels: int
    """Those of which a channel differs by more grey levels than the film may lose."""
    levels: int
    """Of 255: the most that a channel of a pixel differs by."""


@dataclass(frozen=True)
class Measured:
    """How much frames differ."""

    amounts: tuple[Amount, ...]
    """Of those that do, in their order."""
    film: str
    """What it was measured in: `video.mp4` ...; empty where that loses nothing."""
    loss: int
    """Grey levels: the most that the film loses of its own frames; less says nothing."""


def differing(frames: Iterator[Frame], hashes: Sequence[str], total: int, progress: Progress) -> Differing:
    """Which of `total` frames are not those of the `hashes`."""
    from physgen.report.record import frame_hash

    found, times, count = [], [], 0
    for count, frame in enumerate(frames, 1):
        if count <= len(hashes) and frame_hash(frame.rgb) != hashes[count - 1]:
            found.append(count - 1)
            times.append(frame.time)
        progress("render", count, total)
    return Differing(tuple(found), tuple(times), count)


def film_in(folder: Path, name: str, files: Sequence[str], sound: Callable[[str], bool]) -> Format | None:
    """What is best to compare with, of the films called `name` that a run wrote; `sound` ones only."""
    from physgen.export.video import Format

    for kind in (Format.PNG, Format.MP4, Format.WEBP, Format.GIF):
        file = kind.named(name)
        parts = [part for part in files if part == file or part.startswith(f"{file}/")]
        if parts and all(map(sound, parts)):
            return kind
    return None


def measured(
    draw: Draw,
    differ: Set[int],
    film: Path,
    kind: Format,
    size: tuple[int, int],
    fps: float,
    total: int,
    progress: Progress,
) -> Measured:
    """How much the frames `differ` are apart from those in `film`. Raises InputError where it cannot be read."""
    from physgen.export.video import Format, open_video
    from physgen.videos import video_frames

    if kind is Format.PNG:
        stored = (
            next(video_frames(film / f"{k:05d}.png")).rgb if k in differ else None for k in range(total)
        )
        return exactly(draw(), stored, differ, total, progress)
    counts, loss = {}, 0
    with tempfile.TemporaryDirectory(prefix="physgen-") as folder:
        with open_video(Path(folder), kind, size, fps) as write:
            for k, frame in enumerate(draw()):
                write(frame.rgb)
                progress("compare", k + 1, total)
        films = zip(video_frames(film), video_frames(Path(folder) / kind.file), draw(), strict=False)
        for k, (old, new, frame) in enumerate(films):
            height, width = frame.rgb.shape[:2]  # a film may have a row and a column more
            loss = max(loss, int(np.flatnonzero(levels(k, new.rgb[:height, :width], frame.rgb)).max()))
            if k in differ:
                counts[k] = levels(k, old.rgb, new.rgb)
    return Measured(tuple(_amount(k, count, loss) for k, count in counts.items()), film.name, loss)


def exactly(
    new: Iterator[Frame], old: Iterator[U8 | None], differ: Set[int], total: int, progress: Progress
) -> Measured:
    """How much the frames `differ` are apart from the `old` ones, of which only those are needed."""
    amounts = []
    for k, (frame, before) in enumerate(zip(new, old, strict=False)):
        if k in differ and before is not None:
            amounts.append(_amount(k, levels(k, before, frame.rgb), 0))
        progress("compare", k + 1, total)
    return Measured(tuple(amounts), "", 0)


def levels(frame: int, old: U8, new: U8) -> NDArray[np.int64]:
    """(256,): how many pixels of two pictures (H, W, 3) sRGB differ by so many grey levels in a channel, at most.

    Raises InputError where they are not as large.
    """
    if old.shape != new.shape:
        sizes = [f"{shape[1]} x {shape[0]} px" for shape in (old.shape, new.shape)]
        raise InputError.of(f"frame {frame}", sizes[0], f"is now {sizes[1]}", "")
    apart = np.abs(old.astype(np.int16) - new).max(axis=2)
    return np.bincount(apart.ravel(), minlength=256)


def _amount(frame: int, counts: NDArray[np.int64], loss: int) -> Amount:
    return Amount(frame, int(counts[loss + 1 :].sum()), int(np.flatnonzero(counts).max()))


# ----------------------------------------------------------------------
# The frames that are kept, and the frames now -> which differ, how many of their pixels, how far.

FRAME_SLACK = 1e-9


@dataclass(frozen=True)
class Compared:
    """A frame that is kept, and the same frame now."""

    then: Still
    now: Still
    levels: U8 | None
    """(h, w) grey levels: the most by which a channel of a pixel differs; None: the two are not of one size."""
    share: float
    """Of the pixels that differ by more levels than are allowed."""
    mean: float
    """Grey levels."""
    bad: bool

    @property
    def worst(self) -> int:
        """Grey levels: the most that any pixel differs by."""
        return 255 if self.levels is None else int(self.levels.max())


@dataclass(frozen=True)
class Drawn:
    """How frames compare."""

    allowed: Pixels
    frames: tuple[Compared, ...]
    """Those that are in both."""
    kept: tuple[int, ...]
    """Which frames were kept."""
    asked: tuple[int, ...]
    """Which are, now."""

    @property
    def first(self) -> Compared | None:
        """The first bad one."""
        return next((frame for frame in self.frames if frame.bad), None)

    @property
    def agrees(self) -> bool:
        """Whether nothing differs by more than is allowed."""
        return self.first is None and self.kept == self.asked

    @property
    def worst(self) -> int:
        """Grey levels."""
        return max((frame.worst for frame in self.frames), default=0)


def drawn(then: Sequence[Still], now: Sequence[Still], allowed: Pixels) -> Drawn:
    """Compare frames by their number."""
    frames = {still.index: still for still in now}
    return Drawn(
        allowed,
        tuple(_compared(still, frames[still.index], allowed) for still in then if still.index in frames),
        tuple(still.index for still in then),
        tuple(frames),
    )


def _compared(then: Still, now: Still, allowed: Pixels) -> Compared:
    if then.rgb.shape != now.rgb.shape:
        return Compared(then, now, None, 1.0, 255.0, bad=True)
    apart = np.abs(now.rgb.astype(np.int16) - then.rgb).astype(np.uint8)
    levels = apart.max(axis=-1)
    share, mean = float((levels > allowed.levels).mean()), float(apart.mean())
    bad = share > allowed.share + FRAME_SLACK or mean > allowed.mean + FRAME_SLACK
    return Compared(then, now, levels, share, mean, bad)


# ----------------------------------------------------------------------
# The motion that is kept, and the motion now -> which objects stray farther than allowed, when, and how far.

MEASURES = {"px": " px", "degrees": "°", "px_per_s": " px/s", "degrees_per_s": "°/s"}
"""What of a `Motion` is compared, and its unit as it is written behind a number."""
SLACK = 1 + 1e-9
"""Of what is allowed: 30 units of 0.01 are 0.3."""


@dataclass(frozen=True)
class Strayed:
    """An object that is not where it was."""

    name: str
    sample: int
    """The first at which it is farther away than allowed."""
    time: float
    """s."""
    there: Mapping[str, float]
    """How far it is then, by measure."""
    most: Mapping[str, tuple[float, float]]
    """How far it is at most, and when, s."""


@dataclass(frozen=True)
class Moved:
    """How two motions compare, at the samples and for the objects that both have."""

    allowed: Motion
    then: Track
    now: Track
    """In the units of `then`."""
    names: tuple[str, ...]
    samples: NDArray[np.int64]
    """(T,)."""
    times: Array
    """(T,) s."""
    apart: Mapping[str, Array]
    """(T, N) each, by measure."""

    @cached_property
    def gone(self) -> tuple[str, ...]:
        """Objects that are there no more."""
        return tuple(name for name in self.then.names if name not in self.names)

    @cached_property
    def new(self) -> tuple[str, ...]:
        """Objects that were not there."""
        return tuple(name for name in self.now.names if name not in self.names)

    @property
    def retimed(self) -> bool:
        """Whether the clip is longer or shorter, or sampled at other times."""
        return not len(self.then.times) == len(self.times) == len(self.now.times)

    @cached_property
    def excess(self) -> Array:
        """(T, N): the largest of what is apart, as a multiple of what is allowed."""
        shares = [apart / getattr(self.allowed, name) for name, apart in self.apart.items()]
        return np.asarray(np.max(shares, axis=0))

    @cached_property
    def strayed(self) -> tuple[Strayed, ...]:
        """The first to stray first; of those that do at the same sample, the farthest."""
        beyond = self.excess > SLACK
        found = []
        for k in np.flatnonzero(beyond.any(axis=0)).tolist():
            row = int(beyond[:, k].argmax())
            tops = {name: int(apart[:, k].argmax()) for name, apart in self.apart.items()}
            strayed = Strayed(
                self.names[k],
                int(self.samples[row]),
                float(self.times[row]),
                {name: float(apart[row, k]) for name, apart in self.apart.items()},
                {
                    name: (float(self.apart[name][top, k]), float(self.times[top]))
                    for name, top in tops.items()
                },
            )
            found.append((row, -self.excess[row, k], strayed))
        return tuple(item for *_, item in sorted(found, key=lambda row: row[:2]))

    @property
    def agrees(self) -> bool:
        """Whether nothing differs by more than is allowed."""
        return not (self.strayed or self.gone or self.new or self.retimed)

    def most(self, measure: str) -> float:
        """The largest of the whole clip."""
        apart = self.apart[measure]
        return float(apart.max()) if apart.size else 0.0


def moved(then: Track, trajectory: Trajectory, allowed: Motion, until: float | None) -> Moved:
    """Compare; `then` is fine enough, see `too_coarse`."""
    now = track(trajectory, then.units, until)
    names = tuple(name for name in then.names if name in now.names)
    old, new = ([t.names.index(name) for name in names] for t in (then, now))
    _, one, other = np.intersect1d(then.samples, now.samples, return_indices=True)
    alike = np.abs(then.times[one] - now.times[other]) <= LATE
    one, other = one[alike], other[alike]
    poses = now.poses[other][:, new] - then.poses[one][:, old]
    apart = {
        "px": np.hypot(poses[..., 0], poses[..., 1]) * then.units.px,
        "degrees": np.abs(poses[..., 2]) * then.units.degrees,
    }
    if then.turns.shape[1] and now.turns.shape[1]:
        turned = _turned(then.turns[one][:, old], now.turns[other][:, new], then.units.turn)
        apart["degrees"] = np.maximum(apart["degrees"], turned)
    if then.velocities is not None and now.velocities is not None:
        change = now.velocities[other][:, new] - then.velocities[one][:, old]
        if allowed.px_per_s is not None and then.units.px_per_s is not None:
            apart["px_per_s"] = np.hypot(change[..., 0], change[..., 1]) * then.units.px_per_s
        if allowed.degrees_per_s is not None and then.units.degrees_per_s is not None:
            apart["degrees_per_s"] = np.abs(change[..., 2]) * then.units.degrees_per_s
    return Moved(allowed, then, now, names, then.samples[one], then.times[one], apart)


def too_coarse(of: Units, allowed: Motion) -> str:
    """Why a motion kept in these units cannot be compared as closely as is asked; nothing where it can."""
    for name, unit in MEASURES.items():
        asked, kept = getattr(allowed, name), getattr(of, name)
        if asked is not None and kept is None:
            return f"velocities are not kept, and {asked:g}{unit} are asked for"
        if asked is not None and kept > asked * SLACK:
            return f"it is kept to {kept:g}{unit} only, and {asked:g}{unit} are asked for"
    return ""


def _turned(then: NDArray[np.int64], now: NDArray[np.int64], unit: float) -> Array:
    """Degrees between quaternions (..., 4) in a unit; q and -q are the same turn."""
    near = np.minimum(np.linalg.norm(now - then, axis=-1), np.linalg.norm(now + then, axis=-1)) * unit
    return np.asarray(np.degrees(4 * np.arcsin(np.clip(near / 2, 0.0, 1.0))))
