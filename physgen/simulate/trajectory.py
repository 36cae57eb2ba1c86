"""The result of a simulation: poses, velocities, contacts and energy at sample times; its file and rest times.

Quaternions are (w, x, y, z), unit, of the turn since t = 0 about the image axes, +z into the photo (right hand).
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physgen.files import write_atomic
from physgen.geometry.polygon import Array

Index = NDArray[np.int32]


HEADING = "time_s,name,x_px,y_px,angle_rad,vx_px_s,vy_px_s,spin_rad_s"
"""Of the table as CSV."""


@dataclass(frozen=True)
class Contacts:
    """Who touched whom; a partner's index counts the bodies first, then the walls."""

    surfaces: tuple[str, ...]
    """Names: bodies, then walls."""
    touch_pairs: Index
    """(E, 2): the two partners of a touch."""
    touch_times: Array
    """(E, 2) s: begin, end; the end is infinite where the touch outlasts the clip."""
    impulse_rows: Index
    """(R, 3): sample, first partner, second partner."""
    impulses: Array
    """(R, 2) g·px/s: what the second partner gave the first between the sample before and this one."""


@dataclass(frozen=True)
class Energy:
    """Totals over all dynamic bodies at each sample, g·px²/s²."""

    kinetic: Array
    """(T,)."""
    potential: Array
    """(T,), of gravity (0 for a body at the photo's origin), springs and attractors."""
    dissipated: Array
    """(T,): lost since t = 0 to elasticity below 1, sliding, rolling resistance and dampers, summed from impulses and
    closing, sliding and turning speeds; never a remainder."""
    work: Array
    """(T,): done since t = 0 by pushes, wind, motors and scripted bodies, and against gravity where shapes that overlap
    are pushed apart. kinetic + potential + dissipated - work stays what it was."""


@dataclass(frozen=True)
class Effort:
    """What the engine did to reach its accuracy."""

    steps: int
    """Steps taken, divided ones counted by their parts."""
    divided: int
    """Base steps that were divided, because something moved too far or a spring was too stiff for one."""
    most_parts: int
    """Into how many parts, at most."""
    iterations: int
    """Sweeps of the contact solver a step, at most."""
    impacts: int
    """Contact points that bounced, resolved one after the other."""
    still: float
    """px/s: closing speed below which contacts did not bounce, at most; heaps of hundreds raise it."""
    overworked: int = -1
    overworked_by: int = -1
    """The pair whose impacts spent the work of a run, bodies, then walls; -1: none did. From there on impacts are
    resolved in one round a step. A body alone: it moves so far in a step that steps were divided into fewer parts than
    it needs."""


def _unknown(times: Array) -> Trajectory:
    raise ValueError(
        "a motion that was read from a file is known at its own times only"
    )


@dataclass(frozen=True)
class Trajectory:
    """Motion of N bodies at T times."""

    times: Array
    """(T,) s, t = 0 first."""
    names: tuple[str, ...]
    """N names, in the order of the world's bodies."""
    poses: Array
    """(T, N, 3): x px, y px, angle rad, of the centre of mass, image axes."""
    velocities: Array
    """(T, N, 3): px/s, px/s, rad/s."""
    rolls: Array
    """(T, N, 2) rad/s about +x and +y by the right hand: of spheres on a table seen from above; (T, 0, 2) without."""
    turns: Array
    """(T, N, 4) unit quaternions w, x, y, z: how they have turned since t = 0, +z into the photo; (T, 0, 4) without."""
    contacts: Contacts
    energy: Energy
    effort: Effort
    wheel_turns: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(T, W) rad: how far each wheel has turned on its vehicle since t = 0, in the order of bodies and their wheels;
    (0, 0) without wheels."""
    sampled: Callable[[Array], Trajectory] = field(
        default=_unknown, repr=False, compare=False
    )
    """The same motion at other times (K,) s, rising; of a run, not of a file."""

    def imbalance(self, least: float = 0.0) -> float:
        """Return the largest change of kinetic + potential + dissipated - work, as a part of the energy that flows.

        What flows counts as at least `least`, g·px²/s²: where all is at rest, nothing does.
        """
        e = self.energy
        total = e.kinetic + e.potential + e.dissipated - e.work
        if not len(total):
            return 0.0
        flows = [
            float(np.ptp(part))
            for part in (e.kinetic, e.potential, e.dissipated, e.work)
        ]
        flow = max(least, float(e.kinetic.max()), *flows)
        return float(np.ptp(total)) / flow if flow > 0 else 0.0

    def time_of_departure(
        self, reaches: Array, size: tuple[int, int], least: float
    ) -> float | None:
        """Return the time in s after which all bodies that move are outside the picture.

        `reaches` (N,) px are the radii about the centres of mass that contain the
        bodies, `size` is that of the picture in px. A body moves if its centre covers
        `least` px or more. None if a body is inside at the end, or if none moves.
        """
        centres = self.poses[:, :, :2]
        is_moving = np.ptp(centres, axis=0).max(axis=-1, initial=0.0) >= least
        margins = reaches[is_moving][:, None]
        centres = centres[:, is_moving]
        is_beyond = (centres < -margins) | (centres > np.array(size) + margins)
        is_visible = ~is_beyond.any(axis=-1).all(axis=-1)
        if not is_moving.any() or is_visible[-1]:
            return None
        visible_samples = np.flatnonzero(is_visible)
        last = int(visible_samples[-1]) if len(visible_samples) else 0
        return float(self.times[last])

    def sample_hashes(self) -> list[str]:
        """Return the SHA-256 of each sample's time, poses and velocities, as little-endian float64."""
        return [
            hashlib.sha256(
                b"".join(np.ascontiguousarray(a, "<f8").tobytes() for a in (t, p, v))
            ).hexdigest()
            for t, p, v in zip(self.times, self.poses, self.velocities, strict=True)
        ]

    def save(self, path: Path) -> None:
        """Write a NumPy archive (no pickles) under its final name when it is whole; the same bytes every time."""
        path.parent.mkdir(parents=True, exist_ok=True)
        buffer = io.BytesIO()
        np.savez_compressed(buffer, allow_pickle=False, **self.as_arrays())
        write_atomic(path, buffer.getvalue())

    def as_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return the archive's arrays by flat names."""
        arrays: dict[str, NDArray[np.generic]] = {
            "times": self.times,
            "names": np.array(self.names, dtype=np.str_),
            "poses": self.poses,
            "velocities": self.velocities,
            "rolls": self.rolls,
            "turns": self.turns,
            "contacts_surfaces": np.array(self.contacts.surfaces, dtype=np.str_),
        }
        if self.wheel_turns.size:
            arrays["wheel_turns"] = self.wheel_turns
        for part, of in (
            ("contacts", self.contacts),
            ("energy", self.energy),
            ("effort", self.effort),
        ):
            for one in fields(of):
                if one.name != "surfaces":
                    arrays[f"{part}_{one.name}"] = np.asarray(getattr(of, one.name))
        return arrays

    def as_json(self) -> str:
        """Return the arrays as one JSON object; a touch that outlasts the clip ends at null: JSON has no infinity."""
        arrays = {name: array.tolist() for name, array in self.as_arrays().items()}
        times = self.contacts.touch_times.tolist()
        arrays["contacts_touch_times"] = [
            [begin, end if isfinite(end) else None] for begin, end in times
        ]
        return json.dumps(arrays, allow_nan=False) + "\n"

    def as_csv(self) -> str:
        """Return a line a sample and object: s, name, px, px, rad, px/s, px/s, rad/s."""
        lines = [HEADING]
        for t, time in enumerate(self.times.tolist()):
            for n, name in enumerate(self.names):
                row = (*self.poses[t, n].tolist(), *self.velocities[t, n].tolist())
                lines.append(f"{time!r},{name}," + ",".join(map(repr, row)))
        return "\n".join(lines) + "\n"


def is_trajectory(path: Path) -> bool:
    """Return whether this module wrote a file, judged by its first bytes."""
    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            begin = file.read(len(HEADING) + 16)
    except OSError:
        return False
    return (
        begin.startswith(HEADING.encode())
        or begin.startswith(b'{"times": [')
        or (begin.startswith(b"PK\3\4") and begin[30:39] == b"times.npy")
    )


def read_trajectory(path: Path | io.BytesIO) -> Trajectory:
    """Read a file of `Trajectory.save`; nothing is unpickled."""
    with np.load(path, allow_pickle=False) as file:
        parts = {
            part: {
                name.removeprefix(f"{part}_"): file[name]
                for name in file.files
                if name.startswith(f"{part}_")
            }
            for part in ("contacts", "energy", "effort")
        }
        parts["contacts"]["surfaces"] = tuple(map(str, file["contacts_surfaces"]))
        return Trajectory(
            times=file["times"],
            names=tuple(map(str, file["names"])),
            poses=file["poses"],
            velocities=file["velocities"],
            rolls=file["rolls"],
            turns=file["turns"],
            contacts=Contacts(**parts["contacts"]),
            energy=Energy(**parts["energy"]),
            effort=Effort(
                **{name: value.item() for name, value in parts["effort"].items()}
            ),
            wheel_turns=file["wheel_turns"]
            if "wheel_turns" in file.files
            else np.zeros((0, 0)),
        )


REST_SPEED = 1.0
"""px/s: what is slower is at rest, if it turns slower than `STILL_TURN` too."""
REST_TURN = 1.0
"""degrees/s."""
REST_DURATION = 0.1
"""s for which it must have been so at the clip's end: what hangs at the top of its way does not rest."""
START_TIME = 0.005
"""s: what an object touches so early, it stood at or on before: that is no new touch."""


def resting_mask(trajectory: Trajectory) -> NDArray[np.bool_]:
    """Return whether a body moves and turns no faster than one at rest may, (T, N)."""
    velocity = trajectory.velocities
    turning = np.abs(velocity[..., 2:])
    if trajectory.rolls.shape[1]:
        turning = np.concatenate([turning, np.abs(trajectory.rolls)], axis=2)
    slow = np.hypot(velocity[..., 0], velocity[..., 1]) < REST_SPEED
    return np.asarray(slow & (np.degrees(turning) < REST_TURN).all(axis=2))


def rest_times(trajectory: Trajectory) -> list[float | None]:
    """Return the first time (s) from which on each body rests, 0 if it always does; None: it moves to the end."""
    found = []
    for quiet in resting_mask(trajectory).T:
        moving = np.flatnonzero(~quiet)
        since = int(moving[-1]) + 1 if len(moving) else 0
        over = (
            since == len(quiet)
            or trajectory.times[-1] - trajectory.times[since] < REST_DURATION - 1e-9
        )
        found.append(None if over else float(trajectory.times[since]))
    return found


def new_touches(trajectory: Trajectory) -> NDArray[np.bool_]:
    """Return which touches (E,) are of pairs that did not touch from the start."""
    contacts = trajectory.contacts
    pairs = [tuple(pair) for pair in contacts.touch_pairs.tolist()]
    early = contacts.touch_times[:, 0] < START_TIME
    old = {pair for pair, soon in zip(pairs, early.tolist(), strict=True) if soon}
    return np.array([pair not in old for pair in pairs], bool)


def quaternions_from_vectors(vector: Array) -> Array:
    """Return the quaternions (..., 4) of rotation vectors (..., 3) rad."""
    half = vector / 2
    angle = np.sqrt((half**2).sum(axis=-1, keepdims=True))
    return np.concatenate([np.cos(angle), half * np.sinc(angle / np.pi)], axis=-1)


def compose_quaternions(later: Array, earlier: Array) -> Array:
    """Return the quaternions (..., 4) of turning by `earlier`, then by `later` (Hamilton's product)."""
    a, b = np.moveaxis(later, -1, 0), np.moveaxis(earlier, -1, 0)
    return np.stack(
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ],
        axis=-1,
    )


def cumulative_quaternions(vectors: Array, start: Array) -> Array:
    """Return quaternions (S, N, 4) after each of S steps of rotation vectors (S, N, 3), begun at (N, 4).

    Products of neighbours, then of neighbours' neighbours (Hillis and Steele, Commun. ACM 29, 1170, 1986): as many
    passes as S has binary digits.
    """
    done = quaternions_from_vectors(vectors)
    reach = 1
    while reach < len(done):
        done = np.concatenate(
            [done[:reach], compose_quaternions(done[reach:], done[:-reach])]
        )
        reach *= 2
    done = compose_quaternions(done, np.broadcast_to(start, done.shape))
    return np.asarray(done / np.sqrt((done**2).sum(axis=-1, keepdims=True)))


def rotation_matrices(quaternion: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) of quaternions (..., 4) about the image axes, +z into the photo."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
