"""Features of a reference and of methods, clip by clip -> distances, and how far they would be with other clips.

Clips are drawn anew with replacement, whole: frames of one clip depend on each other. All methods meet the same draws
of the reference, and methods of as many clips the same draws of clips, so that what differs between two of them is not
lost in what they share. A set drawn so has fewer different clips than the real one, which moves a Fréchet distance
up: of the draws, only the distances from their own mean are taken, around the distance that was found.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.fid.frechet import Moments, frechet, moments
from physgen.evaluate.fid.kernel import Blocks, blocks, kid

F64 = NDArray[np.float64]
LEVEL = 0.95
HALVINGS = 8
"""Times that the reference is cut into two halves at random."""


@dataclass(frozen=True)
class Cloud:
    """One side's pictures as the extractor sees them."""

    features: F64
    """(N, D)."""
    clips: NDArray[np.intp]
    """(N,): the clip of each, from 0."""

    @property
    def count(self) -> int:
        """Of clips."""
        return int(self.clips[-1]) + 1

    def weighted(self, often: F64) -> Moments:
        """Moments with every clip counted so often."""
        return moments(self.features, often[self.clips])


def cloud(clips: Sequence[F64]) -> Cloud:
    """From features (frames, D) of each clip; clips without any are passed over."""
    there = [features for features in clips if len(features)]
    numbers = np.repeat(np.arange(len(there)), [len(features) for features in there])
    return Cloud(np.concatenate(there).astype(np.float64), numbers)


@dataclass(frozen=True)
class Distance:
    """Of a method from the reference, or of one method's from another's."""

    value: float
    draws: tuple[float, ...]
    """Of clips drawn anew, moved so that their mean is `value`; none where a side has a single clip."""
    least: float = -inf
    """What it cannot be below."""

    @property
    def interval(self) -> tuple[float, float] | None:
        """The middle 95 % of the draws."""
        if not self.draws:
            return None
        low, high = np.quantile(self.draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
        return max(float(low), self.least), max(float(high), self.least)

    @property
    def above(self) -> float | None:
        """The share of draws above 0: of a difference, how surely it is one."""
        return float(np.mean(np.asarray(self.draws) > 0)) if self.draws else None


@dataclass(frozen=True)
class Distances:
    """Of one kind of picture."""

    frechet: Mapping[str, Distance]
    """By method."""
    kernel: Mapping[str, Distance | None]
    """None where a side has a single clip."""
    halves: float | None
    """Fréchet distance between two halves of the reference, a mean over halvings; None below four clips."""

    def apart(self, one: str, other: str) -> Distance:
        """How much farther `one` is than `other`."""
        first, second = self.frechet[one], self.frechet[other]
        return Distance(first.value - second.value, _less(first.draws, second.draws))

    def apart_by_kernel(self, one: str, other: str) -> Distance | None:
        """The same of KID."""
        first, second = self.kernel[one], self.kernel[other]
        if first is None or second is None:
            return None
        return Distance(first.value - second.value, _less(first.draws, second.draws))


def distances(
    reference: Cloud,
    methods: Mapping[str, Cloud],
    draws: int,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Distances:
    """Of every method; `draws` times with clips drawn anew, 0: no intervals."""
    middle = reference.features.mean(axis=0)  # what all share would cost digits
    reference = Cloud(reference.features - middle, reference.clips)
    methods = {name: Cloud(one.features - middle, one.clips) for name, one in methods.items()}
    whole = moments(reference.features)
    # KID's kernel is of the features as they are: moved, they would be others
    kernels = {name: _Kernels(reference, one, middle) for name, one in methods.items()}
    sides = [reference, *methods.values()]
    draws = draws if min(side.count for side in sides) > 1 else 0
    found: dict[str, list[float]] = {name: [] for name in methods}
    kids: dict[str, list[float]] = {name: [] for name in methods}
    random = np.random.default_rng(seed)
    for done in range(draws):
        often = {count: _drawn(random, count) for count in sorted({side.count for side in methods.values()})}
        first = _drawn(random, reference.count)
        drawn = reference.weighted(first)
        for name, one in methods.items():
            found[name].append(frechet(drawn, one.weighted(often[one.count])))
            if (value := kernels[name].kid(first, often[one.count])) is not None:
                kids[name].append(value)
        progress(done + 1, draws)
    values = {name: frechet(whole, moments(one.features)) for name, one in methods.items()}
    kernel = {name: kernels[name].whole() for name in methods}
    return Distances(
        {name: _around(value, found[name], 0.0) for name, value in values.items()},
        {name: None if value is None else _around(value, kids[name]) for name, value in kernel.items()},
        _halves(reference, seed),
    )


class _Kernels:
    """What KID of a method needs, summed up once."""

    def __init__(self, reference: Cloud, method: Cloud, middle: F64) -> None:
        one, other = reference.features + middle, method.features + middle
        self._one = blocks(one, reference.clips, one, reference.clips)
        self._other = blocks(other, method.clips, other, method.clips)
        self._across: Blocks = blocks(one, reference.clips, other, method.clips)

    def kid(self, first: F64, second: F64) -> float | None:
        return kid(self._one, self._other, self._across, first, second)

    def whole(self) -> float | None:
        return self.kid(*(np.ones(count) for count in self._across.sums.shape))


def _drawn(random: np.random.Generator, count: int) -> F64:
    """How often each of `count` clips comes in as many draws."""
    return np.bincount(random.integers(0, count, count), minlength=count).astype(np.float64)


def _around(value: float, draws: Sequence[float], least: float = -inf) -> Distance:
    moved = value - float(np.mean(draws)) if draws else 0.0
    return Distance(value, tuple(draw + moved for draw in draws), least)


def _less(one: Sequence[float], other: Sequence[float]) -> tuple[float, ...]:
    if len(one) != len(other):
        return ()
    return tuple(a - b for a, b in zip(one, other, strict=True))


def _halves(reference: Cloud, seed: int) -> float | None:
    if reference.count < 4:
        return None
    random = np.random.default_rng(seed)
    found = []
    for _ in range(HALVINGS):
        half = np.zeros(reference.count)
        half[random.permutation(reference.count)[: reference.count // 2]] = 1
        found.append(frechet(reference.weighted(half), reference.weighted(1 - half)))
    return float(np.mean(found))
