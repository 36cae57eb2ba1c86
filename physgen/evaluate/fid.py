"""Image-FID and Motion-FID of clips against a reference (paper, section 4.3), with intervals over clips.

Motion pictures colour the flow between two frames as Baker et al. do (A Database and Evaluation Methodology for
Optical Flow, IJCV 92, 2011): hue is direction, saturation is speed. Full colour is the speed of the reference's
fastest pair of frames, for all clips, so that twice the speed looks different and rest is white. Flow is found by
Dense Inverse Search (Kroeger et al., ECCV 2016), as OpenCV has it, at its medium setting.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.clip_frames import Rule, Source, one_shape
from physgen.evaluate.measure import Findings, Progress, Section, Table
from physgen.export.flow import coloured
from physgen.problems import InputError, Place, Problem, Severity
from physgen.text import counted
from physgen.videos import U8

if TYPE_CHECKING:
    from physgen.evaluate.backends.inception import Inception

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

IMAGE, MOTION, REFERENCE = "image", "motion", "reference"
WORDS = {IMAGE: "Image-FID", MOTION: "Motion-FID"}
KINDS = tuple(WORDS)


@dataclass(frozen=True)
class Constants:
    """Choices of the measure that a user does not make."""

    level: float = 0.95  # of intervals
    peak: float = 99.9
    """% of pixels that are no faster than the speed of a pair of frames: outliers do not count."""
    least_colour: float = 1.0  # px of motion that are full colour, at least
    rounding: float = 1e-9  # distances below it are 0


CONSTANTS = Constants()


# ---- distances ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Moments:
    """Mean (D,) and a root (K, D), K <= D, of the covariance: root' root, divided by N - 1."""

    mean: F64
    root: F64


def moments(features: F64, weights: F64 | None = None) -> Moments:
    """Of (N, D) features, each counted `weights` (N,) times. Raises ValueError for fewer than two pictures."""
    counts = (
        np.ones(len(features)) if weights is None else np.asarray(weights, np.float64)
    )
    total = float(counts.sum())
    if total < 2:
        raise ValueError("a covariance needs two pictures or more")
    there = counts > 0
    features, counts = np.asarray(features[there], np.float64), counts[there]
    mean = counts @ features / total
    scaled = (features - mean) * np.sqrt(counts / (total - 1))[:, None]
    if len(scaled) <= scaled.shape[1]:
        return Moments(mean, scaled)
    # of more pictures than features, a triangle with the same moments
    return Moments(mean, np.asarray(np.linalg.qr(scaled, "r"), np.float64))


def frechet(one: Moments, other: Moments) -> float:
    """Squared Fréchet distance of two normal distributions: |m1 - m2|² + tr(S1 + S2 - 2 (S1 S2)^½), 0 or more.

    Heusel et al., GANs Trained by a Two Time-Scale Update Rule, NeurIPS 2017, equation 6. With S1 = A'A and S2 = B'B,
    the trace of the root is the sum of the singular values of A B': no matrix root, and fewer pictures than features
    will do.
    """
    shared = np.linalg.svd(one.root @ other.root.T, compute_uv=False)
    spread = float(np.square(one.root).sum() + np.square(other.root).sum())
    return max(
        0.0,
        float(np.square(one.mean - other.mean).sum())
        + spread
        - 2 * float(shared.sum()),
    )


@dataclass(frozen=True)
class Cloud:
    """Features (N, D) of one side's pictures, and the clip (N,) of each, from 0."""

    features: F64
    clips: NDArray[np.intp]

    @property
    def count(self) -> int:
        """Number of clips."""
        return int(self.clips[-1]) + 1

    def weighted(self, often: F64) -> Moments:
        return moments(self.features, often[self.clips])


def cloud(clips: Sequence[F64]) -> Cloud:
    """From features (frames, D) of each clip; clips without any are left out."""
    there = [features for features in clips if len(features)]
    numbers = np.repeat(np.arange(len(there)), [len(features) for features in there])
    return Cloud(np.concatenate(there).astype(np.float64), numbers)


@dataclass(frozen=True)
class Distance:
    """Distance of a method from the reference."""

    value: float
    draws: tuple[float, ...]
    """With clips drawn again, shifted so that their mean is `value`; empty where a side has a single clip."""

    @property
    def interval(self) -> tuple[float, float] | None:
        """The middle 95 % of the draws, 0 or more."""
        if not self.draws:
            return None
        low, high = np.quantile(
            self.draws, [(1 - CONSTANTS.level) / 2, (1 + CONSTANTS.level) / 2]
        )
        return max(float(low), 0.0), max(float(high), 0.0)


def distances(
    reference: Cloud,
    methods: Mapping[str, Cloud],
    draws: int,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[str, Distance]:
    """Of every method, with `draws` resamplings of clips, 0 for no intervals.

    Whole clips are drawn with replacement. All methods share the draws of the reference, and methods of as many clips
    share theirs, so that what methods have in common cancels in differences. A resampled set has fewer different
    clips, which moves a Fréchet distance up: only deviations of the draws from their own mean are taken.
    """
    middle = reference.features.mean(axis=0)  # a common offset would cost digits
    reference = Cloud(reference.features - middle, reference.clips)
    methods = {
        name: Cloud(one.features - middle, one.clips) for name, one in methods.items()
    }
    draws = (
        draws if min(side.count for side in (reference, *methods.values())) > 1 else 0
    )
    found: dict[str, list[float]] = {name: [] for name in methods}
    random = np.random.default_rng(seed)
    for done in range(draws):
        often = {
            count: _drawn(random, count)
            for count in sorted({side.count for side in methods.values()})
        }
        drawn = reference.weighted(_drawn(random, reference.count))
        for name, one in methods.items():
            found[name].append(frechet(drawn, one.weighted(often[one.count])))
        progress(done + 1, draws)
    whole = moments(reference.features)
    values = {
        name: frechet(whole, moments(one.features)) for name, one in methods.items()
    }
    return {name: _around(value, found[name]) for name, value in values.items()}


def _drawn(random: np.random.Generator, count: int) -> F64:
    """How often each of `count` clips comes in as many draws."""
    return np.bincount(random.integers(0, count, count), minlength=count).astype(
        np.float64
    )


def _around(value: float, draws: Sequence[float]) -> Distance:
    shift = value - float(np.mean(draws)) if draws else 0.0
    return Distance(value, tuple(draw + shift for draw in draws))


# ---- pictures of motion, and reading -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Settings:
    """How all clips are compared."""

    rule: Rule = field(default_factory=Rule)
    draws: int = 200
    seed: int = 0


@dataclass
class Side:
    """What was read of a method, or of the reference."""

    name: str
    lengths: list[int] = field(default_factory=list)  # frames of each clip
    features: dict[str, list[F64]] = field(
        default_factory=dict
    )  # by kind, of each clip

    def count(self, kind: str) -> int:
        """Number of pictures."""
        return sum(len(one) for one in self.features.get(kind, []))


@dataclass(frozen=True)
class Measured:
    """One comparison."""

    reference: Side
    methods: Mapping[str, Side]
    found: Mapping[str, Mapping[str, Distance]]  # by kind and method
    full: float  # px that are full colour
    features: Inception
    wide: int  # number of features of a picture
    settings: Settings
    warnings: tuple[Problem, ...]


def flows(frames: Iterable[U8]) -> Iterator[F32]:
    """(H, W, 2) px from each frame to the next, right and down."""
    find = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    for one, other in pairwise(
        cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in frames
    ):
        yield np.asarray(find.calc(one, other, None), np.float32)  # type: ignore[call-overload]


def pictured(moved: F32, full: float) -> U8:
    """(H, W, 3) sRGB of a flow (H, W, 2); `full` px and more are full colour."""
    speed = cv2.magnitude(moved[..., 0], moved[..., 1])
    held = np.minimum(1.0, full / np.maximum(speed, full)).astype(np.float32)
    return np.ascontiguousarray(coloured(moved * held[..., None], full)[..., ::-1])


def measure(
    reference: Sequence[Source],
    methods: Mapping[str, Sequence[Source]],
    features: Inception,
    settings: Settings,
    progress: Progress = lambda stage, done, total: None,
) -> Measured:
    """Raises InputError with all clips that cannot be read or compared."""
    named = {REFERENCE: reference, **methods}
    full = _check(named, settings, progress)
    sides = {}
    for name, clips in named.items():
        sides[name] = side = Side(name, features={kind: [] for kind in KINDS})
        for k, clip in enumerate(clips):
            progress(f"look at {name}", k, len(clips))
            _add_clip(side, clip, features, settings, full)
    truth = sides.pop(REFERENCE)
    found = {}
    for kind in KINDS:
        clouds = {name: cloud(side.features[kind]) for name, side in sides.items()}

        def show(done: int, total: int, kind: str = kind) -> None:
            progress(f"draw {kind}", done, total)

        found[kind] = distances(
            cloud(truth.features[kind]), clouds, settings.draws, settings.seed, show
        )
    wide = truth.features[IMAGE][0].shape[1]
    warnings = tuple(_warnings(truth, sides, wide))
    return Measured(truth, sides, found, full, features, wide, settings, warnings)


def _check(
    sides: Mapping[str, Sequence[Source]], settings: Settings, progress: Progress
) -> float:
    """Read every clip once, before anything is computed; the px that are full colour, by the reference's motion."""
    problems: list[Problem] = []
    shape: tuple[tuple[int, int], Source] | None = None
    peaks = [CONSTANTS.least_colour]
    for name, clips in sides.items():
        lengths = []
        for k, clip in enumerate(clips):
            progress(f"read {name}", k, len(clips))
            try:
                frames = settings.rule.frames(clip)
            except InputError as error:
                problems += error.problems
                continue
            lengths.append(len(frames))
            size = frames[0].shape[0], frames[0].shape[1]
            first, other = shape = shape or (size, clip)
            if not one_shape(size, first):
                found = f"is {size[1] / size[0]:.3g} times as wide as high"
                expected = f"and {other.path} is {first[1] / first[0]:.3g} times"
                fix = "crop the clips to one shape"
                problems.append(
                    Problem(Place(str(clip.path)), "", found, expected, fix)
                )
            elif name == REFERENCE:
                for moved in flows(frames):
                    speed = cv2.magnitude(moved[..., 0], moved[..., 1])
                    peaks.append(float(np.percentile(speed, CONSTANTS.peak)))
        if len(lengths) == len(clips):
            problems += _too_few(name, lengths)
    if problems:
        raise InputError(dict.fromkeys(problems))  # a clip of two sides is named once
    return max(peaks)


def _too_few(name: str, lengths: Sequence[int]) -> list[Problem]:
    """A covariance needs two pictures, of whichever clips."""
    if sum(length - 1 for length in lengths) >= 2:
        return []
    place = Place("--reference" if name == REFERENCE else name)
    found = f"{counted(sum(lengths), 'frame')} in {counted(len(lengths), 'clip')}"
    expected = "make fewer than two pictures of motion"
    return [
        Problem(place, "", found, expected, "name more clips, of two frames or more")
    ]


def _add_clip(
    side: Side, clip: Source, features: Inception, settings: Settings, full: float
) -> None:
    frames = settings.rule.frames(clip)
    side.lengths.append(len(frames))
    moving = [pictured(moved, full) for moved in flows(frames)]
    for kind, pictures in ((IMAGE, frames), (MOTION, moving)):
        if pictures:
            found = features(np.stack(pictures))
            if not np.isfinite(found).all():
                expected = "gives numbers that are not finite"
                raise InputError.of("--inception", "", expected, "name another file")
            side.features[kind].append(found)


def _warnings(truth: Side, sides: Mapping[str, Side], wide: int) -> Iterator[Problem]:
    def warn(side: Side, found: str, expected: str, fix: str) -> Problem:
        place = Place("--reference" if side is truth else side.name)
        return Problem(place, "", found, expected, fix, Severity.WARNING)

    for side in (truth, *sides.values()):
        for kind in KINDS:
            if (count := side.count(kind)) <= wide:
                expected = f"for {wide} features: fewer pictures make a Fréchet distance larger"
                yield warn(
                    side,
                    f"{count} pictures",
                    f"{expected} ({kind})",
                    "compare equal numbers",
                )
        one, other = (float(np.median(a.lengths)) for a in (truth, side))
        if one != other:
            expected = f"beside the reference's {one:g}: flow is then over other times"
            yield warn(
                side,
                f"{other:g} frames a clip",
                expected,
                f"give --frames {min(one, other):g}",
            )


# ---- report ------------------------------------------------------------------------------------------------------

BIASED = (
    "Intervals are the middle 95 % of draws in which whole clips are drawn again. A Fréchet distance of few pictures "
    "is too large, the more so the fewer they are.",
)


def findings(found: Measured, skipped: int = 0) -> Findings:
    """`skipped`: first frames that do not count, for the record."""
    features = found.features
    tables = tuple(_table(found, kind) for kind in found.found)
    sections = (Section("Distances", BIASED, tables), Section("How", _how(found)))
    more = {
        "features": features.name,
        "features_note": dict(features.note()),
        "flow": f"DIS, medium, OpenCV {cv2.__version__}",
        "skipped": skipped,
        "settings": settings_record(found),
        "reference": _counts(found.reference),
    }
    sentences = tuple(_sentences(found))
    return Findings(
        "fid",
        "Frames and motion against a reference",
        sentences,
        sections,
        rows(found),
        more=more,
    )


def rows(found: Measured) -> list[dict[str, Any]]:
    """One row a method: distances and 95 % intervals."""
    return [
        {
            "method": name,
            **_counts(side),
            **{f"{kind}_fid": one[name].value for kind, one in found.found.items()},
            **{
                f"{kind}_fid_95": one[name].interval
                for kind, one in found.found.items()
            },
        }
        for name, side in found.methods.items()
    ]


def settings_record(found: Measured) -> dict[str, Any]:
    """Settings as JSON."""
    chosen = found.settings
    return {
        "shorter_side_px": chosen.rule.side,
        "frames_a_clip": chosen.rule.count,
        "full_colour_px": found.full,
        "draws": chosen.draws,
        "seed": chosen.seed,
        "features_of_a_picture": found.wide,
    }


def _counts(side: Side) -> dict[str, Any]:
    return {
        "clips": len(side.lengths),
        "frames": sum(side.lengths),
        "pairs": side.count(MOTION),
    }


def _number(value: float) -> str:
    tiny = abs(value) < CONSTANTS.rounding
    return "0" if tiny else f"{value:.4g}" if abs(value) < 1000 else f"{value:.0f}"


def _between(distance: Distance) -> str:
    if distance.interval is None:
        return "-"
    low, high = distance.interval
    return f"[{_number(low)}, {_number(high)}]"


def _sentences(found: Measured) -> Iterator[str]:
    """The order of the methods."""
    for kind, one in found.found.items():
        order = sorted(one.items(), key=lambda pair: pair[1].value)
        names = [
            f"{name} {_number(distance.value)}, 95 %: {_between(distance)}"
            for name, distance in order
        ]
        yield f"{WORDS[kind]}{', the nearest first' * (len(order) > 1)}: {'; '.join(names)}."


def _table(found: Measured, kind: str) -> Table:
    lines = tuple(
        (
            name,
            str(len(side.lengths)),
            str(side.count(kind)),
            _number(one.value),
            _between(one),
        )
        for name, side in found.methods.items()
        for one in (found.found[kind][name],)
    )
    note = f"Reference: {len(found.reference.lengths)} clips, {found.reference.count(kind)} pictures."
    return Table(("method", "clips", "pictures", WORDS[kind], "95 %"), lines, note=note)


def _how(found: Measured) -> tuple[str, str]:
    rule = found.settings.rule
    count = "all frames" if rule.count is None else f"{rule.count} frames, evenly,"
    return (
        f"Frames: {count} of each clip, the shorter side made {rule.side} px. Features: {found.features.name}.",
        "Motion: flow from each frame to the next, by DIS, coloured as Baker et al. (2011) do; full colour is "
        f"{found.full:.4g} px, the speed of the reference's fastest pair.",
    )
