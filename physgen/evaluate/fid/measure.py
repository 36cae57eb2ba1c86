"""Clips of a reference and of methods -> Image-FID and Motion-FID, as the paper's section 4.3 has them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from physgen.evaluate.fid.fitted import Fit, Rule, one_shape
from physgen.evaluate.fid.motion import LEAST, Normalise, flows, peak, pictured
from physgen.evaluate.fid.roles import F64, U8, Features, Flow
from physgen.evaluate.fid.sides import Source
from physgen.evaluate.fid.spread import Distances, cloud, distances
from physgen.problems import InputError, Place, Problem, Severity

Progress = Callable[[str, int, int], None]
IMAGE, MOTION = "image", "motion"
REFERENCE = "reference"
FEW = 8
"""Clips of a side below which drawing them anew tells little of others."""
SHOWN = 8
"""Frames of a clip that are kept to be looked at."""


@dataclass(frozen=True)
class Settings:
    """How all clips are compared."""

    rule: Rule = field(default_factory=Rule)
    normalise: Normalise | float = Normalise.REFERENCE
    """What is full colour, or how many px."""
    kinds: tuple[str, ...] = (IMAGE, MOTION)
    draws: int = 200
    seed: int = 0


@dataclass
class Side:
    """What was read of a method, or of the reference."""

    name: str
    lengths: list[int] = field(default_factory=list)
    """Frames of each clip."""
    size: tuple[int, int] = (0, 0)
    """Height and width of the first frame as it is compared, px."""
    features: dict[str, list[F64]] = field(default_factory=dict)
    """By kind, of each clip."""
    shown: tuple[tuple[U8, ...], tuple[U8, ...]] = ((), ())
    """Of the middle clip: frames, and pictures of flow."""
    which: str = ""
    """That clip."""

    def count(self, kind: str) -> int:
        """Of pictures."""
        return sum(len(one) for one in self.features.get(kind, []))


@dataclass(frozen=True)
class Measured:
    """All of one comparison."""

    reference: Side
    methods: Mapping[str, Side]
    found: Mapping[str, Distances]
    """By kind."""
    full: float | None
    """px that are full colour; None: each picture's own, or no flow."""
    features: Mapping[str, int]
    """How many there are, by kind."""
    settings: Settings
    warnings: tuple[Problem, ...]


def measure(
    reference: Sequence[Source],
    methods: Mapping[str, Sequence[Source]],
    features: Features,
    flow: Flow,
    settings: Settings,
    progress: Progress = lambda stage, done, total: None,
) -> Measured:
    """Raises InputError for clips that cannot be read, or be compared, with every one that is wrong."""
    named = {REFERENCE: reference, **methods}
    full = check(named, flow, settings, progress)
    sides = {
        name: _side(name, clips, features, flow, settings, full, progress) for name, clips in named.items()
    }
    truth = sides.pop(REFERENCE)
    found = {}
    for kind in settings.kinds:
        clouds = {name: cloud(side.features[kind]) for name, side in sides.items()}
        own = cloud(truth.features[kind])

        def tell(done: int, total: int, kind: str = kind) -> None:
            progress(f"draw {kind}", done, total)

        found[kind] = distances(own, clouds, settings.draws, settings.seed, tell)
    wide = {kind: truth.features[kind][0].shape[1] for kind in settings.kinds}
    warnings = tuple(_warnings(truth, sides, wide))
    return Measured(truth, sides, found, full, wide, settings, warnings)


def check(
    sides: Mapping[str, Sequence[Source]], flow: Flow, settings: Settings, progress: Progress
) -> float | None:
    """Read every clip once, before anything is made of them; of the reference's, how many px are full colour."""
    problems: list[Problem] = []
    shape: tuple[tuple[int, int], Source] | None = None
    peaks: list[float] = []
    wants_peak = MOTION in settings.kinds and settings.normalise is Normalise.REFERENCE
    for name, clips in sides.items():
        lengths = []
        for k, clip in enumerate(clips):
            progress(f"read {name}", k, len(clips))
            try:
                frames = list(settings.rule.frames(clip))
            except InputError as error:
                problems += error.problems
                continue
            lengths.append(len(frames))
            size = frames[0].shape[0], frames[0].shape[1]
            shape = shape or (size, clip)
            if settings.rule.fit is Fit.WHOLE and not one_shape(size, shape[0]):
                problems.append(_other_shape(clip, size, *shape))
            elif wants_peak and name == REFERENCE:
                peaks += [peak(moved) for moved in flows(frames, flow)]
        if len(lengths) == len(clips):
            problems += _too_few(name, lengths, settings.kinds)
    if problems:
        raise InputError(dict.fromkeys(problems))  # a clip of two sides is told of once
    if MOTION not in settings.kinds or settings.normalise is Normalise.FRAME:
        return None
    return max(LEAST, *peaks) if isinstance(settings.normalise, Normalise) else settings.normalise


def _side(
    name: str,
    clips: Sequence[Source],
    features: Features,
    flow: Flow,
    settings: Settings,
    full: float | None,
    progress: Progress,
) -> Side:
    side = Side(name, features={kind: [] for kind in settings.kinds})
    for k, clip in enumerate(clips):
        progress(f"look at {name}", k, len(clips))
        frames = list(settings.rule.frames(clip))
        side.lengths.append(len(frames))
        side.size = side.size if k else (frames[0].shape[0], frames[0].shape[1])
        moving = MOTION in settings.kinds
        pictures = [pictured(moved, full) for moved in flows(frames, flow)] if moving else []
        if IMAGE in settings.kinds:
            side.features[IMAGE].append(_seen(features, frames))
        if pictures:
            side.features[MOTION].append(_seen(features, pictures))
        if k == len(clips) // 2:
            side.shown, side.which = (_some(frames), _some(pictures)), str(clip.path)
    return side


def _seen(features: Features, pictures: Sequence[U8]) -> F64:
    found = features(np.stack(pictures))
    if not np.isfinite(found).all():
        raise InputError.of("--features", "", "gives numbers that are not finite", "choose another extractor")
    return found


def _some(pictures: Sequence[U8]) -> tuple[U8, ...]:
    if len(pictures) <= SHOWN:
        return tuple(pictures)
    return tuple(pictures[k] for k in np.rint(np.linspace(0, len(pictures) - 1, SHOWN)).astype(int))


def _other_shape(clip: Source, size: tuple[int, int], first: tuple[int, int], other: Source) -> Problem:
    found = f"is {size[1] / size[0]:.3g} times as wide as high"
    expected = f"and {other.path} is {first[1] / first[0]:.3g} times"
    fix = "give --fit crop for the middle square of all, or --fit stretch"
    return Problem(Place(str(clip.path)), "", found, expected, fix)


def _too_few(name: str, lengths: Sequence[int], kinds: Sequence[str]) -> list[Problem]:
    """A covariance needs two pictures, whichever clips they are of."""
    frames, pairs = sum(lengths), sum(length - 1 for length in lengths)
    place = Place("--reference" if name == REFERENCE else name)
    count = f"{frames} frame{'s' * (frames != 1)}"
    if frames < 2:
        return [Problem(place, "", count, "is too little: a distance needs two at least", "name more clips")]
    if MOTION in kinds and pairs < 2:
        expected = f"in {len(lengths)} clips make fewer than two pictures of motion"
        return [
            Problem(place, "", count, expected, "name clips of three frames or more, or give --only image")
        ]
    return []


def _warnings(truth: Side, sides: Mapping[str, Side], wide: Mapping[str, int]) -> list[Problem]:
    def warn(name: str, found: str, expected: str, fix: str) -> Problem:
        place = Place("--reference" if name == REFERENCE else name)
        return Problem(place, "", found, expected, fix, Severity.WARNING)

    told = []
    for side in (truth, *sides.values()):
        for kind, features in wide.items():
            if (count := side.count(kind)) <= features:
                pictures = f"{count} pictures" if kind == IMAGE else f"{count} pictures of motion"
                expected = f"for {features} features: fewer pictures make a Fréchet distance larger"
                told.append(
                    warn(side.name, pictures, expected, "compare equal numbers, and read KID beside it")
                )
        if len(side.lengths) < 2:
            told.append(warn(side.name, "", "is a single clip: no interval, no KID", "name more clips"))
        elif len(side.lengths) < FEW:
            expected = "are few: intervals and KID say little"
            told.append(warn(side.name, f"{len(side.lengths)} clips", expected, "name more clips"))
        if MOTION in wide and min(side.lengths) < 2:
            short = sum(length < 2 for length in side.lengths)
            told.append(
                warn(
                    side.name,
                    f"{short} of {len(side.lengths)} clips",
                    "are one frame: no motion",
                    "leave them out",
                )
            )
    for side in sides.values():
        one, other = (float(np.median(a.lengths)) for a in (truth, side))
        if MOTION in wide and one != other:
            expected = f"beside the reference's {one:g}: flow is then over other times"
            told.append(
                warn(side.name, f"{other:g} frames a clip", expected, f"give --frames {min(one, other):g}")
            )
    for one_side, other_side in pairwise(sides.values()):
        if one_side.count(IMAGE) != other_side.count(IMAGE):
            found = f"{other_side.count(IMAGE)} frames"
            expected = (
                f"beside the {one_side.count(IMAGE)} of {one_side.name}: distances of fewer frames are larger"
            )
            told.append(warn(other_side.name, found, expected, "compare equal numbers"))
    return told
