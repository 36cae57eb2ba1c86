"""Motions <-> entries of the store, one file each."""

from __future__ import annotations

from physgen.cache.store import Store
from physgen.simulate.trajectory import Trajectory, read_trajectory

MOTION = "trajectory.npz"


def kept(store: Store | None, key: str) -> Trajectory | None:
    """The motion of a key; None where it is not kept."""
    if store is None:
        return None
    with store.find(key) as folder:
        if folder is None:
            return None
        try:
            return read_trajectory(folder / MOTION)
        except (OSError, ValueError, KeyError, TypeError):
            return None


def keep(store: Store | None, key: str, motion: Trajectory) -> None:
    """For the next time; where it cannot be written, the user is told, and nobody fails."""
    if store is None:
        return
    with store.fill(key) as filling:
        if filling is not None:
            try:
                motion.save(filling.folder / MOTION)
            except OSError as error:
                filling.give_up(error)
