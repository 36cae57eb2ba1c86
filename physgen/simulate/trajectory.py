"""The result of a simulation: poses, velocities, contacts and energy at sample times.

Also its files and rest times. Quaternions are (w, x, y, z), unit, of the rotation since
t = 0 about the image axes, +z into the photo, by the right-hand rule.
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
"""Heading of the table in CSV."""


@dataclass(frozen=True)
class Contacts:
    """Touches and impulses; the index of a partner counts the bodies first, then the
    walls.
    """

    surfaces: tuple[str, ...]
    """Names of bodies, then of walls."""
    touch_pairs: Index
    """Both partners of each touch, (E, 2)."""
    touch_times: Array
    """Begin and end of each touch, (E, 2) s; infinite if the touch outlasts the
    clip.
    """
    impulse_rows: Index
    """Sample, first partner, second partner, (R, 3)."""
    impulses: Array
    """Impulse on the first partner since the sample before, (R, 2) g·px/s."""


@dataclass(frozen=True)
class Energy:
    """Totals over all dynamic bodies at each sample, g·px²/s²."""

    kinetic: Array
    """Kinetic energy, (T,)."""
    potential: Array
    """Potential energy (T,) of gravity, springs and attractors; 0 for a body at the
    photo's origin.
    """
    dissipated: Array
    """Energy lost since t = 0 (T,) to elasticity below 1, sliding, rolling resistance
    and dampers. It is summed from impulses and closing, sliding and turning speeds, and
    is never a remainder.
    """
    work: Array
    """Work done since t = 0 (T,) by pushes, wind, motors and scripted bodies, and
    against gravity when overlapping shapes are pushed apart. The sum kinetic +
    potential + dissipated - work is constant.
    """


@dataclass(frozen=True)
class Effort:
    """The effort of the engine for its accuracy."""

    steps: int
    """Number of steps; a divided step counts by its parts."""
    divided: int
    """Number of base steps that were divided, for a fast body or a stiff spring."""
    most_parts: int
    """Largest number of parts of a step."""
    iterations: int
    """Largest number of sweeps of the contact solver in a step."""
    impacts: int
    """Number of contact points that bounced, resolved one after the other."""
    still: float
    """Largest closing speed, px/s, below which contacts did not bounce; heaps of
    hundreds of bodies raise it.
    """
    overworked: int = -1
    overworked_by: int = -1
    """Indices of the pair whose impacts used up the work of a run, bodies, then walls;
    -1 for no pair. From then on, impacts are resolved in one round per step. A single
    body: it moves so fast that its steps were divided into fewer parts than needed.
    """


def _unknown(times: Array) -> Trajectory:
    """Refuse to sample a motion from a file."""
    raise ValueError(
        "a motion that was read from a file is known at its own times only"
    )


@dataclass(frozen=True)
class Trajectory:
    """Motion of N bodies at T times."""

    times: Array
    """Sample times, (T,) s, beginning with 0."""
    names: tuple[str, ...]
    """Names of the N bodies in the world's order."""
    poses: Array
    """Poses of the centres of mass, (T, N, 3): x px, y px, angle rad, image axes."""
    velocities: Array
    """Velocities, (T, N, 3): px/s, px/s, rad/s."""
    rolls: Array
    """Angular velocity about +x and +y, (T, N, 2) rad/s, of spheres on a table seen
    from above; (T, 0, 2) without such spheres.
    """
    turns: Array
    """Rotation of these spheres since t = 0, (T, N, 4): unit quaternions w, x, y, z, +z
    into the photo; (T, 0, 4) without such spheres.
    """
    contacts: Contacts
    energy: Energy
    effort: Effort
    wheel_turns: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Angle of each wheel on its vehicle since t = 0, (T, W) rad, in the order of
    bodies and their wheels; (0, 0) without wheels.
    """
    resample: Callable[[Array], Trajectory] = field(
        default=_unknown, repr=False, compare=False
    )
    """Function that returns the same motion at other rising times (K,) s; only for a
    run, not for a file.
    """

    def imbalance(self, least_flow: float = 0.0) -> float:
        """Return the largest error of the energy balance as a share of the energy flow.

        The error is the largest change of kinetic + potential + dissipated - work. The
        flow counts as at least `least_flow`, g·px²/s², since no energy flows at rest.
        """
        energy = self.energy
        total = energy.kinetic + energy.potential + energy.dissipated - energy.work
        if not len(total):
            return 0.0
        # Energy changes its form: the largest change of one part tells how much has
        # flowed.
        flows = []
        for part in (
            energy.kinetic,
            energy.potential,
            energy.dissipated,
            energy.work,
        ):
            flows.append(float(np.ptp(part)))
        flow = max(least_flow, float(energy.kinetic.max()), *flows)
        if flow > 0:
            return float(np.ptp(total)) / flow
        return 0.0

    def time_of_departure(
        self, reaches: Array, size: tuple[int, int], least_distance: float
    ) -> float | None:
        """Return the time in s after which all moving bodies are outside the picture.

        `reaches` (N,) px are the radii about the centres of mass that contain the
        bodies, `size` is that of the picture in px. A body moves if its centre covers
        `least_distance` px or more. None if a body is inside at the end, or if none
        moves.
        """
        # A body is out of the picture if the whole circle around it is, which is on the
        # safe side for any rotation.
        centres = self.poses[:, :, :2]
        is_moving = np.ptp(centres, axis=0).max(axis=-1, initial=0.0) >= least_distance
        margins = reaches[is_moving][:, None]
        centres = centres[:, is_moving]
        is_beyond = (centres < -margins) | (centres > np.array(size) + margins)
        is_visible = ~is_beyond.any(axis=-1).all(axis=-1)
        if not is_moving.any() or is_visible[-1]:
            return None
        visible_samples = np.flatnonzero(is_visible)
        last_sample = 0
        if len(visible_samples):
            last_sample = int(visible_samples[-1])
        return float(self.times[last_sample])

    def sample_hashes(self) -> list[str]:
        """Return the SHA-256 of each sample's time, poses and velocities in
        little-endian float64.
        """
        hashes = []
        for t, p, v in zip(self.times, self.poses, self.velocities, strict=True):
            hashes.append(
                hashlib.sha256(
                    b"".join(
                        np.ascontiguousarray(a, "<f8").tobytes() for a in (t, p, v)
                    )
                ).hexdigest()
            )
        return hashes

    def save(self, path: Path) -> None:
        """Write a NumPy archive without pickles; equal motions give equal bytes.

        The file gets its name only when it is complete.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        buffer = io.BytesIO()
        np.savez_compressed(buffer, allow_pickle=False, **self.as_arrays())
        write_atomic(path, buffer.getvalue())

    def as_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return the arrays of the archive by name."""
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
            # Archives of scenes without wheels stay as they were before wheels existed.
            arrays["wheel_turns"] = self.wheel_turns
        for part, values in (
            ("contacts", self.contacts),
            ("energy", self.energy),
            ("effort", self.effort),
        ):
            for column in fields(values):
                if column.name != "surfaces":
                    arrays[f"{part}_{column.name}"] = np.asarray(
                        getattr(values, column.name)
                    )
        return arrays

    def as_json(self) -> str:
        """Return the arrays as a JSON object.

        A touch that outlasts the clip ends at null, since JSON has no infinity.
        """
        arrays = {name: array.tolist() for name, array in self.as_arrays().items()}
        times = self.contacts.touch_times.tolist()
        arrays["contacts_touch_times"] = [
            [begin, end if isfinite(end) else None] for begin, end in times
        ]
        return json.dumps(arrays, allow_nan=False) + "\n"

    def as_csv(self) -> str:
        """Return a line per sample and object: s, name, px, px, rad, px/s,
        px/s, rad/s.
        """
        lines = [HEADING]
        for t, time in enumerate(self.times.tolist()):
            for n, name in enumerate(self.names):
                row = (*self.poses[t, n].tolist(), *self.velocities[t, n].tolist())
                lines.append(f"{time!r},{name}," + ",".join(map(repr, row)))
        return "\n".join(lines) + "\n"


def is_trajectory(path: Path) -> bool:
    """Check whether a file has a format of this module, by its first bytes."""
    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            first_bytes = file.read(len(HEADING) + 16)
    except OSError:
        return False
    return (
        first_bytes.startswith(HEADING.encode())
        or first_bytes.startswith(b'{"times": [')
        or (first_bytes.startswith(b"PK\3\4") and first_bytes[30:39] == b"times.npy")
    )


def read_trajectory(path: Path | io.BytesIO) -> Trajectory:
    """Read a file of `Trajectory.save` without unpickling."""
    with np.load(path, allow_pickle=False) as file:
        # The names of arrays begin with their part, as `as_arrays` wrote them.
        parts = {}
        for part in ("contacts", "energy", "effort"):
            parts[part] = {
                name.removeprefix(f"{part}_"): file[name]
                for name in file.files
                if name.startswith(f"{part}_")
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
"""Speed, px/s, below which a body is at rest, if its spin is also below `REST_TURN`."""
REST_TURN = 1.0
"""Spin, degrees/s, below which a body is at rest."""
REST_DURATION = 0.1
"""Time at the clip's end, s, for which a body must be at rest: at the top of a throw, a
body is slow only for a moment.
"""
START_TIME = 0.005
"""Time, s, before which a touch counts as present from the start."""


def resting_mask(trajectory: Trajectory) -> NDArray[np.bool_]:
    """Return whether each body moves and turns slowly enough to be at rest, (T, N)."""
    velocity = trajectory.velocities
    spins = np.abs(velocity[..., 2:])
    if trajectory.rolls.shape[1]:
        spins = np.concatenate([spins, np.abs(trajectory.rolls)], axis=2)
    is_slow = np.hypot(velocity[..., 0], velocity[..., 1]) < REST_SPEED
    return np.asarray(is_slow & (np.degrees(spins) < REST_TURN).all(axis=2))


def rest_times(trajectory: Trajectory) -> list[float | None]:
    """Return the time (s) from which each body rests; 0 if it always does, None if it
    never does.
    """
    times = []
    for is_resting in resting_mask(trajectory).T:
        moving_samples = np.flatnonzero(~is_resting)
        # A body rests from the sample after its last motion on.
        first_sample = 0
        if len(moving_samples):
            first_sample = int(moving_samples[-1]) + 1
        # At the turning point of a swing, a body is slow for a moment, and does not
        # rest.
        is_too_short = (
            first_sample == len(is_resting)
            or trajectory.times[-1] - trajectory.times[first_sample]
            < REST_DURATION - 1e-9
        )
        times.append(None if is_too_short else float(trajectory.times[first_sample]))
    return times


def new_touches(trajectory: Trajectory) -> NDArray[np.bool_]:
    """Return the mask (E,) of touches of pairs that did not touch from the start."""
    contacts = trajectory.contacts
    pairs = list(map(tuple, contacts.touch_pairs.tolist()))
    is_early = contacts.touch_times[:, 0] < START_TIME
    first_pairs = set()
    for pair, is_first in zip(pairs, is_early.tolist(), strict=True):
        if is_first:
            first_pairs.add(pair)
    return np.array([pair not in first_pairs for pair in pairs], bool)


def quaternions_from_vectors(vector: Array) -> Array:
    """Return the quaternions (..., 4) of rotation vectors (..., 3) rad."""
    half = vector / 2
    angle = np.sqrt((half**2).sum(axis=-1, keepdims=True))
    return np.concatenate([np.cos(angle), half * np.sinc(angle / np.pi)], axis=-1)


def compose_quaternions(later: Array, earlier: Array) -> Array:
    """Return the quaternions (..., 4) of a rotation by `earlier`, then by `later`.

    The composition is Hamilton's product.
    """
    # Order of the components: w, x, y, z. The product is not commutative.
    a = np.moveaxis(later, -1, 0)
    b = np.moveaxis(earlier, -1, 0)
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
    """Return the quaternions (S, N, 4) after each of S steps from (N, 4).

    `vectors` (S, N, 3) are the rotation vectors of the steps. Products of neighbours
    are combined to products of 2, 4, 8 ... steps (Hillis and Steele, Commun. ACM 29,
    1170, 1986), so that the number of passes is logarithmic in S.
    """
    products = quaternions_from_vectors(vectors)
    reach = 1
    while reach < len(products):
        products = np.concatenate(
            [products[:reach], compose_quaternions(products[reach:], products[:-reach])]
        )
        reach *= 2
    products = compose_quaternions(products, np.broadcast_to(start, products.shape))
    return np.asarray(products / np.sqrt((products**2).sum(axis=-1, keepdims=True)))


def rotation_matrices(quaternion: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) of quaternions (..., 4) about the image
    axes.
    """
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    # The quaternion must have unit length; the formula does not divide by the length.
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
