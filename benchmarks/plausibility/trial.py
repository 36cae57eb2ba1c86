"""Seeds -> clips that are right or wrong, exact and shaken -> what the judge says of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from physgen.evaluate.plausibility.judge import Verdict, judge
from physgen.evaluate.plausibility.tracks import Tracks, from_world
from physgen.simulate.engine import simulate

from . import balls, families, faults, films

RIGHT = "right"
FINE = 480
"""Samples a second of the run that faults are planned by."""
RATES = (16, 24, 30)
"""Frames a second of a clip: one each."""
HELD_OUT = 1000
"""The first seed that no threshold was ever chosen on."""
TRIES = 8
"""Draws of a ball clip in which a fault may show."""
OWN, OTHER = "physgen", "closed form"


@dataclass(frozen=True)
class Said:
    """Of one clip."""

    source: str
    """physgen, in pieces where something is wrong, or the closed form of `balls`."""
    family: str
    fault: str
    seed: int
    fps: float
    tracker: str
    """How its tracks came about: exact, or noise of some px."""
    score: float | None
    deviations: dict[str, float]
    """Question -> deviation, where it was asked."""


Tracker = Callable[[Tracks, np.random.Generator], Tracks]
TRACKERS: dict[str, Tracker] = {
    "exact": lambda tracks, rng: films.stranger(tracks),
    "0.25 px": lambda tracks, rng: films.shaken(films.stranger(tracks), 0.25, rng),
    "0.5 px": lambda tracks, rng: films.shaken(films.stranger(tracks), 0.5, rng),
    "0.5 px, masses known": lambda tracks, rng: films.shaken(
        films.weighed(tracks), 0.5, rng
    ),
    "1 px": lambda tracks, rng: films.shaken(films.stranger(tracks), 1.0, rng),
}


def trial(
    seeds: range,
    workers: int = 1,
    show: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> list[Said]:
    """All clips of all seeds; the same whatever `workers`."""
    jobs = [
        (family, seed, k)
        for seed in seeds
        for k, family in enumerate((*families.FAMILIES, *[OTHER] * 3))
    ]
    said: list[Said] = []
    with ProcessPoolExecutor(max(workers, 1)) as pool:
        run = pool.map(_one, jobs, chunksize=4) if workers > 1 else map(_one, jobs)
        for k, found in enumerate(run):
            said += found
            show("clips", k + 1, len(jobs))
    return said


def _one(job: tuple[str, int, int]) -> list[Said]:
    family, seed, number = job
    rng = np.random.default_rng([20, seed, number])
    fps = RATES[(number + seed) % len(RATES)]
    clips = _closed(rng, fps) if family == OTHER else _own(family, rng, fps)
    said = []
    for fault, tracks in clips:
        for tracker, track in TRACKERS.items():
            verdict = judge(track(tracks, rng))
            said.append(
                _said(
                    OTHER if family == OTHER else OWN,
                    family,
                    fault,
                    seed,
                    fps,
                    tracker,
                    verdict,
                )
            )
    return said


def _said(
    source: str,
    family: str,
    fault: str,
    seed: int,
    fps: float,
    tracker: str,
    verdict: Verdict,
) -> Said:
    deviations = {
        name: found[0].deviation for name, found in verdict.answers.items() if found
    }
    return Said(source, family, fault, seed, fps, tracker, verdict.overall, deviations)


def _own(
    family: str, rng: np.random.Generator, fps: float
) -> Iterator[tuple[str, Tracks]]:
    world = families.world_of(family, rng)
    times = np.arange(int(world.duration * fps + 1e-9) + 1) / fps
    fine = simulate(world, np.arange(int(world.duration * FINE) + 1) / FINE)
    right = simulate(world, times).poses
    as_tracks = partial(from_world, family, world, times)
    yield RIGHT, as_tracks(right)
    for fault, make in faults.FAULTS.items():
        poses = make(world, times, fine, rng)
        if poses is not None:
            yield fault, as_tracks(poses)


def _closed(rng: np.random.Generator, fps: float) -> Iterator[tuple[str, Tracks]]:
    for fault in (None, *balls.KINDS):
        for _ in range(TRIES):
            tracks = balls.made(rng, fault, fps)
            if tracks is not None:
                yield fault or RIGHT, tracks
                break
