"""Image-FID and Motion-FID of clips against a reference (paper, section 4.3), with intervals over clips, and KID.

Motion pictures colour the flow between two frames as Baker et al. do (A Database and Evaluation Methodology for
Optical Flow, IJCV 92, 2011): hue is direction, saturation is speed. The speed that is full colour decides what a
distance of such pictures means. `REFERENCE`: the speed of the reference's fastest pair of frames, for all clips, so
that twice the speed looks different and rest is white. `FRAME`: each picture's own fastest, as RAFT's pictures have
it: speed is then not visible, and where nothing moves, noise is in full colour.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.backends.roles import F32, F64, U8, Features, Flow
from physgen.evaluate.clip_frames import Fit, Rule, Source, one_shape
from physgen.evaluate.measure import Figure, Findings, Progress, Section, Table, photo, plotted
from physgen.export.flow import coloured
from physgen.problems import InputError, Place, Problem, Severity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.style import Palette


IMAGE, MOTION, REFERENCE = "image", "motion", "reference"
WORDS = {IMAGE: "Image-FID", MOTION: "Motion-FID"}
LEVEL = 0.95
"""Of intervals."""
HALVINGS = 8
"""Random halvings of the reference."""
FEW = 8
"""Clips of a side below which resampling them says little."""
SHOWN = 8
"""Frames of a clip that are kept for the page."""
PEAK = 99.9
"""% of pixels that are no faster than the speed of a pair of frames: outliers do not count."""
LEAST_COLOUR = 1.0
"""px of motion that are full colour, at least."""
TINY_FLOW = 1e-5
"""px that RAFT's pictures add before they divide."""
ROUNDING = 1e-9
"""Distances below it are 0."""
TILE, GAP = 128, 4
"""px of a picture's height on the page, and between two."""
MARKERS = "osD^v"


# ---- distances ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Moments:
    """Mean (D,) and a root (K, D), K <= D, of the covariance: root' root, divided by N - 1."""

    mean: F64
    root: F64


def moments(features: F64, weights: F64 | None = None) -> Moments:
    """Of (N, D) features, each counted `weights` (N,) times. Raises ValueError for fewer than two pictures."""
    counts = np.ones(len(features)) if weights is None else np.asarray(weights, np.float64)
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
    return max(0.0, float(np.square(one.mean - other.mean).sum()) + spread - 2 * float(shared.sum()))


@dataclass(frozen=True)
class Blocks:
    """Sums of a kernel over the pairs of frames of every pair of clips, and the number of pairs; (A, B) each."""

    sums: F64
    pairs: F64

    def mean(self, weights: F64) -> float | None:
        count = float((self.pairs * weights).sum())
        return float((self.sums * weights).sum()) / count if count else None


def blocks(one: F64, first: NDArray[np.intp], other: F64, second: NDArray[np.intp]) -> Blocks:
    """Kernel (x·y / D + 1)³ of features (N, D) and (M, D), whose clips `first` (N,) and `second` (M,) count from 0."""
    kernel = (one @ other.T / one.shape[1] + 1) ** 3
    sums = np.zeros((first.max() + 1, len(other)))
    np.add.at(sums, first, kernel)
    both = np.zeros((first.max() + 1, second.max() + 1))
    np.add.at(both.T, second, sums.T)
    return Blocks(both, np.outer(np.bincount(first), np.bincount(second)).astype(np.float64))


def kid(one: Blocks, other: Blocks, across: Blocks, first: F64, second: F64) -> float | None:
    """Squared kernel distance without bias; below 0 by chance, where two sets are alike. None for a single clip.

    Binkowski et al., Demystifying MMD GANs, ICLR 2018. Frames of one clip depend on each other, so within a set only
    pairs of frames of different clips count. `first` and `second` say how often each clip counts; a clip that counts
    twice is no pair with itself.
    """
    within = one.mean(np.outer(first, first) * (1 - np.eye(len(first))))
    beside = other.mean(np.outer(second, second) * (1 - np.eye(len(second))))
    between = across.mean(np.outer(first, second))
    if within is None or beside is None or between is None:
        return None
    return within + beside - 2 * between


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
    """Distance of a method from the reference, or the difference of two methods' distances."""

    value: float
    draws: tuple[float, ...]
    """With clips drawn again, shifted so that their mean is `value`; empty where a side has a single clip."""
    least: float = -inf
    """Lower limit."""

    @property
    def interval(self) -> tuple[float, float] | None:
        """The middle 95 % of the draws."""
        if not self.draws:
            return None
        low, high = np.quantile(self.draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
        return max(float(low), self.least), max(float(high), self.least)

    @property
    def above(self) -> float | None:
        """Share of draws above 0: how sure a difference is."""
        return float(np.mean(np.asarray(self.draws) > 0)) if self.draws else None

    def less(self, other: Distance) -> Distance:
        """The difference, draw by draw."""
        same = len(self.draws) == len(other.draws)
        draws = tuple(a - b for a, b in zip(self.draws, other.draws, strict=True)) if same else ()
        return Distance(self.value - other.value, draws)


@dataclass(frozen=True)
class Distances:
    """Of one kind of picture, by method."""

    frechet: Mapping[str, Distance]
    kernel: Mapping[str, Distance | None]
    """None where a side has a single clip."""
    halves: float | None
    """Mean Fréchet distance between two halves of the reference; None below four clips."""

    def apart(self, one: str, other: str) -> Distance:
        """How much farther `one` is than `other`."""
        return self.frechet[one].less(self.frechet[other])

    def apart_by_kernel(self, one: str, other: str) -> Distance | None:
        first, second = self.kernel[one], self.kernel[other]
        return None if first is None or second is None else first.less(second)


def distances(
    reference: Cloud,
    methods: Mapping[str, Cloud],
    draws: int,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Distances:
    """Of every method, with `draws` resamplings of clips, 0 for no intervals.

    Whole clips are drawn with replacement. All methods share the draws of the reference, and methods of as many clips
    share theirs, so that what methods have in common cancels in differences. A resampled set has fewer different
    clips, which moves a Fréchet distance up: only deviations of the draws from their own mean are taken.
    """
    middle = reference.features.mean(axis=0)  # a common offset would cost digits
    # KID's kernel takes features as they are
    first_kernel = blocks(reference.features, reference.clips, reference.features, reference.clips)
    kernels = {
        name: (
            blocks(one.features, one.clips, one.features, one.clips),
            blocks(reference.features, reference.clips, one.features, one.clips),
        )
        for name, one in methods.items()
    }
    reference = Cloud(reference.features - middle, reference.clips)
    methods = {name: Cloud(one.features - middle, one.clips) for name, one in methods.items()}
    draws = draws if min(side.count for side in (reference, *methods.values())) > 1 else 0
    found: dict[str, list[float]] = {name: [] for name in methods}
    kids: dict[str, list[float]] = {name: [] for name in methods}
    random = np.random.default_rng(seed)
    for done in range(draws):
        often = {count: _drawn(random, count) for count in sorted({side.count for side in methods.values()})}
        first = _drawn(random, reference.count)
        drawn = reference.weighted(first)
        for name, one in methods.items():
            second = often[one.count]
            found[name].append(frechet(drawn, one.weighted(second)))
            if (value := kid(first_kernel, *kernels[name], first, second)) is not None:
                kids[name].append(value)
        progress(done + 1, draws)
    whole = moments(reference.features)
    kernel: dict[str, Distance | None] = {}
    for name, one in methods.items():
        value = kid(first_kernel, *kernels[name], np.ones(reference.count), np.ones(one.count))
        kernel[name] = None if value is None else _around(value, kids[name])
    values = {name: frechet(whole, moments(one.features)) for name, one in methods.items()}
    return Distances(
        {name: _around(value, found[name], 0.0) for name, value in values.items()},
        kernel,
        _halves(reference, seed),
    )


def _drawn(random: np.random.Generator, count: int) -> F64:
    """How often each of `count` clips comes in as many draws."""
    return np.bincount(random.integers(0, count, count), minlength=count).astype(np.float64)


def _around(value: float, draws: Sequence[float], least: float = -inf) -> Distance:
    shift = value - float(np.mean(draws)) if draws else 0.0
    return Distance(value, tuple(draw + shift for draw in draws), least)


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


# ---- pictures of motion, and reading -----------------------------------------------------------------------------


class Normalise(Enum):
    """What is full colour, where no number of px is given."""

    REFERENCE = "reference"
    FRAME = "frame"


@dataclass(frozen=True)
class Settings:
    """How all clips are compared."""

    rule: Rule = field(default_factory=Rule)
    normalise: Normalise | float = Normalise.REFERENCE
    """Full colour, or its number of px."""
    kinds: tuple[str, ...] = (IMAGE, MOTION)
    draws: int = 200
    seed: int = 0


@dataclass
class Side:
    """What was read of a method, or of the reference."""

    name: str
    lengths: list[int] = field(default_factory=list)
    """Frames of each clip."""
    features: dict[str, list[F64]] = field(default_factory=dict)
    """By kind, of each clip."""
    shown: tuple[tuple[U8, ...], tuple[U8, ...]] = ((), ())
    """Of the middle clip: frames, and pictures of flow."""
    which: str = ""
    """That clip."""

    def count(self, kind: str) -> int:
        """Number of pictures."""
        return sum(len(one) for one in self.features.get(kind, []))


@dataclass(frozen=True)
class Measured:
    """One comparison."""

    reference: Side
    methods: Mapping[str, Side]
    found: Mapping[str, Distances]
    """By kind."""
    full: float | None
    """px that are full colour; None: each picture's own, or no flow."""
    features: Mapping[str, int]
    """Number of features, by kind."""
    settings: Settings
    warnings: tuple[Problem, ...]


def flows(frames: Iterable[U8], flow: Flow) -> Iterator[F32]:
    """(H, W, 2) px from each frame to the next."""
    return (flow(one, other) for one, other in pairwise(frames))


def pictured(moved: F32, full: float | None) -> U8:
    """(H, W, 3) sRGB of a flow (H, W, 2); `full` px and more are full colour. None: this flow's fastest."""
    speed = cv2.magnitude(moved[..., 0], moved[..., 1])
    if full is None:
        full = float(speed.max()) + TINY_FLOW
    held = np.minimum(1.0, full / np.maximum(speed, TINY_FLOW)).astype(np.float32)
    return np.ascontiguousarray(coloured(moved * held[..., None], full)[..., ::-1])


def measure(
    reference: Sequence[Source],
    methods: Mapping[str, Sequence[Source]],
    features: Features,
    flow: Flow,
    settings: Settings,
    progress: Progress = lambda stage, done, total: None,
) -> Measured:
    """Raises InputError with all clips that cannot be read or compared."""
    named = {REFERENCE: reference, **methods}
    full = _check(named, flow, settings, progress)
    sides = {}
    for name, clips in named.items():
        sides[name] = side = Side(name, features={kind: [] for kind in settings.kinds})
        for k, clip in enumerate(clips):
            progress(f"look at {name}", k, len(clips))
            _add_clip(side, clip, k == len(clips) // 2, features, flow, settings, full)
    truth = sides.pop(REFERENCE)
    found = {}
    for kind in settings.kinds:
        clouds = {name: cloud(side.features[kind]) for name, side in sides.items()}

        def show(done: int, total: int, kind: str = kind) -> None:
            progress(f"draw {kind}", done, total)

        found[kind] = distances(cloud(truth.features[kind]), clouds, settings.draws, settings.seed, show)
    wide = {kind: truth.features[kind][0].shape[1] for kind in settings.kinds}
    return Measured(truth, sides, found, full, wide, settings, tuple(_warnings(truth, sides, wide)))


def _check(
    sides: Mapping[str, Sequence[Source]], flow: Flow, settings: Settings, progress: Progress
) -> float | None:
    """Read every clip once, before anything is computed; the px that are full colour, by the reference's motion."""
    problems: list[Problem] = []
    shape: tuple[tuple[int, int], Source] | None = None
    peaks: list[float] = []
    wants_peak = MOTION in settings.kinds and settings.normalise is Normalise.REFERENCE
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
            if settings.rule.fit is Fit.WHOLE and not one_shape(size, first):
                found = f"is {size[1] / size[0]:.3g} times as wide as high"
                expected = f"and {other.path} is {first[1] / first[0]:.3g} times"
                fix = "give --fit crop for the middle square of all, or --fit stretch"
                problems.append(Problem(Place(str(clip.path)), "", found, expected, fix))
            elif wants_peak and name == REFERENCE:
                for moved in flows(frames, flow):
                    speed = cv2.magnitude(moved[..., 0], moved[..., 1])
                    peaks.append(float(np.percentile(speed, PEAK)))
        if len(lengths) == len(clips):
            problems += _too_few(name, lengths, settings.kinds)
    if problems:
        raise InputError(dict.fromkeys(problems))  # a clip of two sides is named once
    if MOTION not in settings.kinds or settings.normalise is Normalise.FRAME:
        return None
    return max(LEAST_COLOUR, *peaks) if isinstance(settings.normalise, Normalise) else settings.normalise


def _too_few(name: str, lengths: Sequence[int], kinds: Sequence[str]) -> list[Problem]:
    """A covariance needs two pictures, of whichever clips."""
    frames, pairs = sum(lengths), sum(length - 1 for length in lengths)
    place = Place("--reference" if name == REFERENCE else name)
    count = f"{frames} frame{'s' * (frames != 1)}"
    if frames < 2:
        return [Problem(place, "", count, "is too little: a distance needs two at least", "name more clips")]
    if MOTION in kinds and pairs < 2:
        expected = f"in {len(lengths)} clips make fewer than two pictures of motion"
        fix = "name clips of three frames or more, or give --only image"
        return [Problem(place, "", count, expected, fix)]
    return []


def _add_clip(
    side: Side,
    clip: Source,
    shown: bool,
    features: Features,
    flow: Flow,
    settings: Settings,
    full: float | None,
) -> None:
    frames = settings.rule.frames(clip)
    side.lengths.append(len(frames))
    moving = [pictured(moved, full) for moved in flows(frames, flow)] if MOTION in settings.kinds else []
    for kind, pictures in ((IMAGE, frames), (MOTION, moving)):
        if kind in settings.kinds and pictures:
            found = features(np.stack(pictures))
            if not np.isfinite(found).all():
                expected = "gives numbers that are not finite"
                raise InputError.of("--features", "", expected, "choose another extractor")
            side.features[kind].append(found)
    if shown:
        side.shown, side.which = (_some(frames), _some(moving)), str(clip.path)


def _some(pictures: Sequence[U8]) -> tuple[U8, ...]:
    if len(pictures) <= SHOWN:
        return tuple(pictures)
    return tuple(pictures[k] for k in np.rint(np.linspace(0, len(pictures) - 1, SHOWN)).astype(int))


def _warnings(truth: Side, sides: Mapping[str, Side], wide: Mapping[str, int]) -> Iterator[Problem]:
    def warn(name: str, found: str, expected: str, fix: str) -> Problem:
        place = Place("--reference" if name == REFERENCE else name)
        return Problem(place, "", found, expected, fix, Severity.WARNING)

    for side in (truth, *sides.values()):
        clips = len(side.lengths)
        for kind, features in wide.items():
            if (count := side.count(kind)) <= features:
                pictures = f"{count} pictures" if kind == IMAGE else f"{count} pictures of motion"
                expected = f"for {features} features: fewer pictures make a Fréchet distance larger"
                yield warn(side.name, pictures, expected, "compare equal numbers, and read KID beside it")
        if clips < 2:
            yield warn(side.name, "", "is a single clip: no interval, no KID", "name more clips")
        elif clips < FEW:
            yield warn(
                side.name, f"{clips} clips", "are few: intervals and KID say little", "name more clips"
            )
        if MOTION in wide and min(side.lengths) < 2:
            short = f"{sum(length < 2 for length in side.lengths)} of {clips} clips"
            yield warn(side.name, short, "are one frame: no motion", "leave them out")
    for side in sides.values():
        one, other = (float(np.median(a.lengths)) for a in (truth, side))
        if MOTION in wide and one != other:
            expected = f"beside the reference's {one:g}: flow is then over other times"
            yield warn(side.name, f"{other:g} frames a clip", expected, f"give --frames {min(one, other):g}")
    for first, second in pairwise(sides.values()):
        if first.count(IMAGE) != second.count(IMAGE):
            expected = (
                f"beside the {first.count(IMAGE)} of {first.name}: distances of fewer frames are larger"
            )
            yield warn(second.name, f"{second.count(IMAGE)} frames", expected, "compare equal numbers")


# ---- report ------------------------------------------------------------------------------------------------------

BIASED = (
    "Intervals are the middle 95 % of draws in which whole clips are drawn again. A Fréchet distance of few pictures "
    "is too large, the more so the fewer they are; KID is not, and is below 0 by chance where two sets are alike.",
)


def findings(found: Measured, tools: Mapping[str, Any], comparable: bool, pictures: bool = False) -> Findings:
    """`tools` names extractor and flow with their notes; `pictures` asks for plots, which only a page shows."""
    heads = {kind: word if comparable else f"{word}, {tools['features']}" for kind, word in WORDS.items()}
    sections = [Section("Distances", BIASED, tuple(_tables(found, heads)))]
    if len(found.methods) > 1:
        sections.append(_apart(found, heads))
    if pictures:
        sections[0] = Section("Distances", BIASED, (*sections[0].parts, _plot(found, heads)))
        sections.append(Section("What was compared", (), tuple(_sheets(found))))
    sections.append(Section("How", tuple(_how(found, tools))))
    halves = {kind: one.halves for kind, one in found.found.items()}
    more = {
        **tools,
        "comparable": comparable,
        "settings": _settings(found),
        "reference": _counts(found.reference),
    }
    return Findings(
        "fid",
        "Frames and motion against a reference",
        tuple(_sentences(found, heads, tools, comparable)),
        tuple(sections),
        rows(found),
        more={**more, "halves_of_reference": halves},
    )


def rows(found: Measured) -> list[dict[str, Any]]:
    """One row a method: distances, 95 % intervals, and how much farther than the first method."""
    first = next(iter(found.methods))
    result = []
    for name, side in found.methods.items():
        row: dict[str, Any] = {"method": name, **_counts(side)}
        for kind, one in found.found.items():
            kernel = one.kernel[name]
            row[f"{kind}_fid"], row[f"{kind}_fid_95"] = one.frechet[name].value, _pair(one.frechet[name])
            row[f"{kind}_kid"] = None if kernel is None else kernel.value
            row[f"{kind}_kid_95"] = None if kernel is None else _pair(kernel)
            if name != first:
                more = one.apart(name, first)
                row[f"{kind}_fid_more"], row[f"{kind}_fid_more_95"] = more.value, _pair(more)
                row[f"{kind}_fid_more_sure"] = more.above
        result.append(row)
    return result


def _settings(found: Measured) -> dict[str, Any]:
    chosen = found.settings
    normalise = chosen.normalise.value if isinstance(chosen.normalise, Normalise) else chosen.normalise
    return {
        "frames": str(chosen.rule),
        "frames_a_clip": chosen.rule.count,
        "full_colour": normalise if MOTION in chosen.kinds else None,
        "full_colour_px": found.full,
        "draws": chosen.draws,
        "seed": chosen.seed,
        "features_of_a_picture": dict(found.features),
    }


def _counts(side: Side) -> dict[str, Any]:
    pairs = side.count(MOTION) if MOTION in side.features else None
    return {"clips": len(side.lengths), "frames": sum(side.lengths), "pairs": pairs}


def _pair(distance: Distance) -> list[float] | None:
    return None if distance.interval is None else list(distance.interval)


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return "0" if abs(value) < ROUNDING else f"{value:.4g}" if abs(value) < 1000 else f"{value:.0f}"


def _between(distance: Distance | None) -> str:
    if distance is None or distance.interval is None:
        return "-"
    low, high = distance.interval
    return f"[{_number(low)}, {_number(high)}]"


def _share(distance: Distance) -> str:
    return "-" if distance.above is None else f"{100 * distance.above:.0f} %"


def _sentences(
    found: Measured, heads: Mapping[str, str], tools: Mapping[str, Any], comparable: bool
) -> Iterator[str]:
    """The order of the methods, and what limits it."""
    if len(found.methods) == 1:
        [name] = found.methods
        values = []
        for kind, one in found.found.items():
            distance = one.frechet[name]
            after = "" if distance.interval is None else f" {_between(distance)}"
            values.append(f"{heads[kind]} {_number(distance.value)}{after}")
        yield f"{name}: {'; '.join(values)}."
    else:
        for kind, one in found.found.items():
            order = sorted(found.methods, key=lambda name: one.frechet[name].value)
            names = order[:1]
            for before, name in pairwise(order):
                more = one.apart(name, before)
                sure = more.interval is None or more.interval[0] > 0
                names.append(name if sure else f"{name} (not surely farther: in {_share(more)} of the draws)")
            yield f"By {heads[kind]}, the nearest first: {', '.join(names)}."
    least = min(len(side.lengths) for side in (found.reference, *found.methods.values()))
    if least < FEW:
        clips = "clip" if least == 1 else "clips"
        yield f"A side of {least} {clips} is small: below {FEW}, distances and intervals say little of others."
    if not comparable:
        what = (
            "colours and edges in fields of the picture" if tools["features"] == "bank" else tools["features"]
        )
        yield (
            f"NOT comparable with published FIDs: these are distances of {what}. Name the Inception file with "
            "--features inception:PATH for those; see docs/fid.md."
        )


def _tables(found: Measured, heads: Mapping[str, str]) -> Iterator[Table]:
    for kind, all_of in found.found.items():
        by_kid = heads[kind].replace("FID", "KID")
        lines = []
        for name, side in found.methods.items():
            one, kernel = all_of.frechet[name], all_of.kernel[name]
            clips, pictures = str(len(side.lengths)), str(side.count(kind))
            by_kernel = _number(kernel.value if kernel else None), _between(kernel)
            lines.append((name, clips, pictures, _number(one.value), _between(one), *by_kernel))
        note = f"Reference: {len(found.reference.lengths)} clips, {found.reference.count(kind)} pictures."
        if all_of.halves is not None:
            note += (
                f" One half of its clips is {_number(all_of.halves)} from the other: about what no difference looks "
                "like among half as many."
            )
        yield Table(
            ("method", "clips", "pictures", heads[kind], "95 %", by_kid, "95 %"), tuple(lines), note=note
        )


def _apart(found: Measured, heads: Mapping[str, str]) -> Section:
    first, *others = found.methods
    tables = []
    for kind, one in found.found.items():
        lines = []
        for name in others:
            more, kernel = one.apart(name, first), one.apart_by_kernel(name, first)
            by_kernel = "-" if kernel is None else f"{kernel.value:+.3g}", _between(kernel)
            lines.append((name, f"{more.value:+.3g}", _between(more), _share(more), *by_kernel))
        by_kid = heads[kind].replace("FID", "KID")
        tables.append(Table(("method", heads[kind], "95 %", "farther in", by_kid, "95 %"), tuple(lines)))
    sentence = (
        f"How much farther from the reference than {first} each is, and in how many of the draws; all share the draws, "
        "so that what methods have in common cancels."
    )
    return Section(f"Against {first}", (sentence,), tuple(tables))


def _how(found: Measured, tools: Mapping[str, Any]) -> Iterator[str]:
    chosen = found.settings
    count = "all frames" if chosen.rule.count is None else f"{chosen.rule.count} frames, evenly,"
    if tools.get("skipped"):
        count += f" (but the first {tools['skipped']} of the methods')"
    note = _note(tools["features_note"])
    yield f"Frames: {count} of each clip, {chosen.rule}. Features: {tools['features']}, {note}."
    if MOTION not in chosen.kinds:
        return
    if found.full is None:
        full = "each picture's own fastest pixel, so that speed is not seen and noise is where nothing moves"
    elif chosen.normalise is Normalise.REFERENCE:
        full = f"{found.full:.4g} px, the speed of the reference's fastest pair ({PEAK} % of its pixels), for all clips"
    else:
        full = f"{found.full:.4g} px, for all clips"
    yield (
        f"Motion: flow from each frame to the next, by {tools['flow']} ({_note(tools['flow_note'])}), coloured as "
        f"Baker et al. (2011) do; full colour is {full}."
    )


def _note(note: Mapping[str, Any]) -> str:
    return ", ".join(str(value) if key == "name" else f"{key} {value}" for key, value in note.items())


def _plot(found: Measured, heads: Mapping[str, str]) -> Figure:
    """Distances with their intervals: both kinds against each other, or the one alone."""
    kinds = tuple(found.found)

    def reach(distance: Distance) -> Any:
        if distance.interval is None:
            return None
        low, high = distance.interval
        return np.array([[max(distance.value - low, 0)], [max(high - distance.value, 0)]])

    def draw(axes: Axes, palette: Palette) -> None:
        for k, name in enumerate(found.methods):
            spots = [found.found[kind].frechet[name] for kind in kinds]
            two = len(kinds) > 1
            axes.errorbar(
                [spots[0].value], [spots[1].value if two else float(k)], label=name, elinewidth=0.8, capsize=2,
                xerr=reach(spots[0]), yerr=reach(spots[1]) if two else None, markersize=4,
                color=palette.lines[k % len(palette.lines)], fmt=MARKERS[k // len(palette.lines) % len(MARKERS)],
            )  # fmt: skip
        axes.set_xlabel(heads[kinds[0]])
        if len(kinds) > 1:
            axes.set_ylabel(heads[kinds[1]])
            axes.set_ylim(bottom=0)
        else:
            axes.set_yticks([])
            axes.set_ylim(-0.6, len(found.methods) - 0.2)
        axes.set_xlim(left=0)
        if len(found.methods) > 1:
            axes.legend(loc="best", fontsize=6, frameon=False, ncols=1 + len(found.methods) // 12)

    about = f"{' and '.join(heads[kind] for kind in kinds)} of every method, with 95 % intervals; nearer 0 is better."
    return plotted(draw, about)


def _sheets(found: Measured) -> Iterator[Figure]:
    """Of each side, the middle clip: a row of frames and, between them below, their flow."""
    for side in (found.reference, *found.methods.values()):
        frames, moving = ([_small(picture) for picture in row] for row in side.shown)
        wide = frames[0].shape[1]
        page = np.full(
            ((1 + bool(moving)) * (TILE + GAP) - GAP, len(frames) * (wide + GAP) - GAP, 3), 255, np.uint8
        )
        for line, row in enumerate((frames, moving)):
            shift = (wide + GAP) // 2 if line and len(row) < len(frames) else 0
            for k, picture in enumerate(row):
                top, left = line * (TILE + GAP), shift + k * (wide + GAP)
                page[top : top + TILE, left : left + wide] = picture[:, :wide]
        what = "frames" + (" and the flow between them" if moving else "")
        yield photo(page, f"{side.name}: {what}, {side.which}", ".png")


def _small(picture: U8) -> U8:
    height, width = picture.shape[:2]
    size = max(1, round(width * TILE / height)), TILE
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
