"""Image-FID and Motion-FID of clips against a reference (paper, section 4.3), with
intervals over clips.

Motion pictures colour the flow between two frames as Baker et al. do (A Database and
Evaluation Methodology for Optical Flow, IJCV 92, 2011): hue is direction, saturation is
speed. Full colour is the speed of the reference's fastest pair of frames, for all
clips, so that rest is white and twice the speed looks different. Dense Inverse Search
(Kroeger et al., ECCV 2016) computes the flow, in OpenCV's version with its medium
setting.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.clip_frames import Rule, Source, have_one_shape
from physgen.evaluate.measure import Findings, Progress, Section, Table
from physgen.export.flow import colour_flow
from physgen.messages import Message
from physgen.problems import InputError, Place, Problem
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
    """Fixed choices of the measure."""

    level: float = 0.95
    """Level of intervals."""
    peak: float = 99.9
    """Percentile of the pixels' speeds for the speed of a pair of frames, %: it ignores
    outliers.
    """
    min_full_colour: float = 1.0
    """Minimum motion with full colour, px."""
    rounding: float = 1e-9
    """Smaller distances are 0."""


CONSTANTS = Constants()


# ---- distances


@dataclass(frozen=True)
class Moments:
    """Mean (D,) and a root (K, D), K <= D, of the covariance: root' root,
    divided by N - 1.
    """

    mean: F64
    root: F64


def moments(features: F64, weights: F64 | None = None) -> Moments:
    """Return the moments of (N, D) features, each counted `weights` (N,) times.

    Raise ValueError for fewer than two pictures.
    """
    counts: F64 = np.ones(len(features))
    if weights is not None:
        counts = np.asarray(weights, np.float64)
    total = float(counts.sum())
    if total < 2:
        raise ValueError("a covariance needs two pictures or more")
    # A resampled set leaves clips out; their features would only cost time.
    is_counted = counts > 0
    features = np.asarray(features[is_counted], np.float64)
    counts = counts[is_counted]
    mean = counts @ features / total
    # The root of the weights makes deviations' deviations the weighted covariance.
    roots = np.sqrt(counts / (total - 1))
    deviations = (features - mean) * roots[:, None]
    if len(deviations) <= deviations.shape[1]:
        return Moments(mean, deviations)
    # With more pictures than features, a triangle has the same moments and is smaller.
    return Moments(mean, np.asarray(np.linalg.qr(deviations, "r"), np.float64))


def frechet(first: Moments, second: Moments) -> float:
    """Return the squared Fréchet distance of two normal distributions: |m1 - m2|² + tr(S1 + S2 - 2 (S1 S2)^½).

    Heusel et al., GANs Trained by a Two Time-Scale Update Rule, NeurIPS 2017, equation 6. With S1 = A'A and S2 = B'B,
    the trace of the root is the sum of the singular values of A B': no matrix root, and fewer pictures than features
    will do.
    """
    singular_values = np.linalg.svd(first.root @ second.root.T, compute_uv=False)
    spread = float(np.square(first.root).sum() + np.square(second.root).sum())
    offset = float(np.square(first.mean - second.mean).sum())
    # Rounding may give a small negative number for equal sides.
    return max(0.0, offset + spread - 2 * float(singular_values.sum()))


@dataclass(frozen=True)
class Cloud:
    """Features (N, D) of one side's pictures, and the clip (N,) of each, from 0."""

    features: F64
    clips: NDArray[np.intp]

    @property
    def count(self) -> int:
        """Return the number of clips."""
        return int(self.clips[-1]) + 1

    def moments_of(self, counts: F64) -> Moments:
        """Return the moments if each clip counts as often as in `counts` (clips,)."""
        return moments(self.features, counts[self.clips])


def cloud(clips: Sequence[F64]) -> Cloud:
    """Return the features (frames, D) of all clips. Clips without features are left
    out.
    """
    clips = [features for features in clips if len(features)]
    frames = list(map(len, clips))
    numbers = np.repeat(np.arange(len(clips)), frames)
    return Cloud(np.concatenate(clips).astype(np.float64), numbers)


@dataclass(frozen=True)
class Distance:
    """Distance of a method from the reference."""

    value: float
    draws: tuple[float, ...]
    """Values for resampled clips, shifted so that their mean is `value`; empty for a
    side with a single clip.
    """

    @property
    def interval(self) -> tuple[float, float] | None:
        """Return the middle 95 % of the draws, 0 or more."""
        if not self.draws:
            return None
        lower_tail = (1 - CONSTANTS.level) / 2
        upper_tail = (1 + CONSTANTS.level) / 2
        low, high = np.quantile(self.draws, [lower_tail, upper_tail])
        return max(float(low), 0.0), max(float(high), 0.0)


def distances(
    reference: Cloud,
    methods: Mapping[str, Cloud],
    draws: int,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[str, Distance]:
    """Return the distance of every method, with `draws` resamplings of clips, 0 for no
    intervals.

    Whole clips are drawn with replacement. All methods share the draws of the
    reference, and methods with equal numbers of clips share their own draws, so that
    common errors cancel in differences. A resampled set has fewer different clips,
    which increases a Fréchet distance: only deviations of the draws from their own mean
    count.
    """
    # A common offset would cost digits.
    center = reference.features.mean(axis=0)
    reference = Cloud(reference.features - center, reference.clips)
    methods = {
        name: Cloud(method.features - center, method.clips)
        for name, method in methods.items()
    }
    # A single clip cannot be resampled: intervals then have no meaning.
    fewest_clips = min(side.count for side in (reference, *methods.values()))
    resamplings: dict[str, list[float]] = {name: [] for name in methods}
    if fewest_clips > 1:
        resamplings = _resample(reference, methods, draws, seed, progress)
    reference_moments = moments(reference.features)
    # The value itself is that of all clips; resampling gives its interval only.
    found = {}
    for name, method in methods.items():
        value = frechet(reference_moments, moments(method.features))
        found[name] = _shift_draws(value, resamplings[name])
    return found


def _resample(
    reference: Cloud,
    methods: Mapping[str, Cloud],
    draws: int,
    seed: int,
    progress: Callable[[int, int], None],
) -> dict[str, list[float]]:
    """Return the distances of every method for resampled clips."""
    resamplings: dict[str, list[float]] = {name: [] for name in methods}
    random = np.random.default_rng(seed)
    # A fixed order, so that a seed gives the same draws for any order of methods.
    sizes = sorted({method.count for method in methods.values()})
    for done in range(draws):
        # Methods with the same number of clips share a draw, and so do their common
        # errors.
        counts = {size: _draw_counts(random, size) for size in sizes}
        reference_counts = _draw_counts(random, reference.count)
        reference_moments = reference.moments_of(reference_counts)
        for name, method in methods.items():
            method_moments = method.moments_of(counts[method.count])
            resamplings[name].append(frechet(reference_moments, method_moments))
        progress(done + 1, draws)
    return resamplings


def _draw_counts(random: np.random.Generator, count: int) -> F64:
    """Return the count of each of `count` clips in as many draws."""
    clips = random.integers(0, count, count)
    return np.bincount(clips, minlength=count).astype(np.float64)


def _shift_draws(value: float, draws: Sequence[float]) -> Distance:
    """Return a distance with draws around its value."""
    shift = 0.0
    if draws:
        shift = value - float(np.mean(draws))
    return Distance(value, tuple(draw + shift for draw in draws))


# ---- pictures of motion, and reading


@dataclass(frozen=True)
class Settings:
    """Choices of a user, common to all compared clips."""

    rule: Rule = field(default_factory=Rule)
    draws: int = 200
    seed: int = 0


@dataclass
class Side:
    """Features of a method, or of the reference."""

    name: str
    lengths: list[int] = field(default_factory=list)
    """Number of frames of each clip."""
    features: dict[str, list[F64]] = field(default_factory=dict)
    """Features by kind, of each clip."""

    def count(self, kind: str) -> int:
        """Return the number of pictures."""
        return sum(map(len, self.features.get(kind, [])))


@dataclass(frozen=True)
class Comparison:
    """Distances of all methods from one reference."""

    reference: Side
    methods: Mapping[str, Side]
    distances: Mapping[str, Mapping[str, Distance]]
    """Distances by kind and method."""
    full_colour: float
    """Motion with full colour, px."""
    features: Inception
    feature_count: int
    """Number of features of a picture."""
    settings: Settings
    warnings: tuple[Problem, ...]


def flows(frames: Iterable[U8]) -> Iterator[F32]:
    """Yield the flow (H, W, 2) px from each frame to the next, right and down."""
    find = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    grey_frames = (cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in frames)
    for frame, next_frame in pairwise(grey_frames):
        flow = find.calc(frame, next_frame, None)  # type: ignore[call-overload]
        yield np.asarray(flow, np.float32)


def picture_flow(flow: F32, full_colour: float) -> U8:
    """Return the picture (H, W, 3) sRGB of a flow (H, W, 2). `full_colour` px and more
    have full colour.
    """
    speed = cv2.magnitude(flow[..., 0], flow[..., 1])
    # Faster pixels keep their direction, and get the full colour. The maximum avoids a
    # division by zero at rest.
    limit = np.minimum(1.0, full_colour / np.maximum(speed, full_colour))
    limited_flow = flow * limit.astype(np.float32)[..., None]
    # Reverse the channels from BGR to RGB.
    return np.ascontiguousarray(colour_flow(limited_flow, full_colour)[..., ::-1])


def measure(
    reference: Sequence[Source],
    methods: Mapping[str, Sequence[Source]],
    features: Inception,
    settings: Settings,
    progress: Progress = lambda stage, done, total: None,
) -> Comparison:
    """Compare methods with a reference. Raise InputError with all clips that
    cannot be read or compared.
    """
    clips_by_name = {REFERENCE: reference, **methods}
    # Flows of all sides share one scale of colours, that of the reference.
    full_colour = _check_sides(clips_by_name, settings, progress)
    sides = {}
    for name, clips in clips_by_name.items():
        sides[name] = side = Side(name, features={kind: [] for kind in KINDS})
        for k, clip in enumerate(clips):
            progress(f"look at {name}", k, len(clips))
            _add_clip(side, clip, features, settings, full_colour)
    # All clips are read before any distance, so that problems appear at once.
    truth = sides.pop(REFERENCE)
    by_kind = {}
    for kind in KINDS:
        clouds = {name: cloud(side.features[kind]) for name, side in sides.items()}

        def show(count: int, total: int, kind: str = kind) -> None:
            progress(f"draw {kind}", count, total)

        true_cloud = cloud(truth.features[kind])
        by_kind[kind] = distances(
            true_cloud, clouds, settings.draws, settings.seed, show
        )
    feature_count = truth.features[IMAGE][0].shape[1]
    return Comparison(
        reference=truth,
        methods=sides,
        distances=by_kind,
        full_colour=full_colour,
        features=features,
        feature_count=feature_count,
        settings=settings,
        warnings=tuple(_warnings(truth, sides, feature_count)),
    )


class _ClipCheck:
    """Collects the problems of clips, and the speeds of the reference."""

    def __init__(self, rule: Rule) -> None:
        self.problems: list[Problem] = []
        self.peaks = [CONSTANTS.min_full_colour]
        self._rule = rule
        self._first: tuple[tuple[int, int], Source] | None = None
        """Size and clip as a model for all others."""

    def read(self, clip: Source, is_reference: bool) -> int | None:
        """Read a clip, and return its number of frames; None for an unreadable clip."""
        try:
            frames = self._rule.frames(clip)
        except InputError as error:
            self.problems += error.problems
            return None
        size = frames[0].shape[0], frames[0].shape[1]
        if self._first is None:
            self._first = (size, clip)
        first_size, first_clip = self._first
        if not have_one_shape(size, first_size):
            problem = _shape_problem(clip, size, first_clip, first_size)
            self.problems.append(problem)
        elif is_reference:
            self.peaks += map(_peak_speed, flows(frames))
        return len(frames)


def _peak_speed(flow: F32) -> float:
    speed = cv2.magnitude(flow[..., 0], flow[..., 1])
    return float(np.percentile(speed, CONSTANTS.peak))


def _shape_problem(
    clip: Source, size: tuple[int, int], first: Source, first_size: tuple[int, int]
) -> Problem:
    return Message.CLIP_SHAPES_DIFFER.problem(
        Place(str(clip.path)),
        aspect=size[1] / size[0],
        other=first.path,
        other_aspect=first_size[1] / first_size[0],
    )


def _check_sides(
    sides: Mapping[str, Sequence[Source]], settings: Settings, progress: Progress
) -> float:
    """Read every clip once, and return the motion with full colour, px, from the
    reference.

    This happens before any computation, so that all problems are reported at once.
    """
    check = _ClipCheck(settings.rule)
    for name, clips in sides.items():
        lengths = []
        for k, clip in enumerate(clips):
            progress(f"read {name}", k, len(clips))
            length = check.read(clip, name == REFERENCE)
            if length is not None:
                lengths.append(length)
        # An unreadable clip would also make the count wrong, and cause a second
        # message.
        if len(lengths) == len(clips):
            check.problems += _count_problems(name, lengths)
    if check.problems:
        # A clip on two sides is named once.
        raise InputError(dict.fromkeys(check.problems))
    return max(check.peaks)


def _count_problems(name: str, lengths: Sequence[int]) -> list[Problem]:
    """Return a problem unless the clips make two pictures, the minimum for a
    covariance.
    """
    # A clip of n frames has n - 1 pictures of motion.
    if sum(length - 1 for length in lengths) >= 2:
        return []
    place = Place("--reference" if name == REFERENCE else name)
    value_text = f"{counted(sum(lengths), 'frame')} in {counted(len(lengths), 'clip')}"
    return [Message.MOTION_PICTURES_TOO_FEW.problem(place, "", value_text)]


def _add_clip(
    side: Side,
    clip: Source,
    features: Inception,
    settings: Settings,
    full_colour: float,
) -> None:
    """Add the features of a clip to its side."""
    frames = settings.rule.frames(clip)
    side.lengths.append(len(frames))
    motion_pictures = [picture_flow(flow, full_colour) for flow in flows(frames)]
    for kind, pictures in ((IMAGE, frames), (MOTION, motion_pictures)):
        if not pictures:
            continue
        values = features(np.stack(pictures))
        if not np.isfinite(values).all():
            raise Message.FEATURES_NOT_FINITE.error("--inception")
        side.features[kind].append(values)


def _warnings(
    truth: Side, sides: Mapping[str, Side], feature_count: int
) -> Iterator[Problem]:
    true_length = float(np.median(truth.lengths))
    for side in (truth, *sides.values()):
        place = Place("--reference" if side is truth else side.name)
        for kind in KINDS:
            count = side.count(kind)
            # A covariance of fewer pictures than features has no full rank.
            if count <= feature_count:
                yield Message.PICTURES_TOO_FEW.warning(
                    place, "", f"{count} pictures", features=feature_count, kind=kind
                )
        length = float(np.median(side.lengths))
        if length != true_length:
            yield Message.CLIP_LENGTHS_DIFFER.warning(
                place,
                "",
                f"{length:g} frames a clip",
                length=true_length,
                frames=min(true_length, length),
            )


# ---- report

INTERVAL_NOTE = (
    "Intervals are the middle 95 % of draws in which whole clips are drawn again. A Fréchet distance of few pictures "
    "is too large, the more so the fewer they are.",
)


def findings(comparison: Comparison, skipped_frames: int = 0) -> Findings:
    """Return the findings. `skipped_frames` at the start do not count; the record names
    them.
    """
    features = comparison.features
    tables = tuple(_table(comparison, kind) for kind in comparison.distances)
    return Findings(
        measure="fid",
        title="Frames and motion against a reference",
        sentences=tuple(_sentences(comparison)),
        sections=(
            Section("Distances", INTERVAL_NOTE, tables),
            Section("How", _method_sentences(comparison)),
        ),
        rows=rows(comparison),
        extra={
            "features": features.name,
            "features_note": dict(features.note()),
            "flow": f"DIS, medium, OpenCV {cv2.__version__}",
            "skipped": skipped_frames,
            "settings": settings_record(comparison),
            "reference": _counts(comparison.reference),
        },
    )


def rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Return one row per method: distances and 95 % intervals."""
    records = []
    for name, side in comparison.methods.items():
        record: dict[str, Any] = {"method": name, **_counts(side)}
        for kind, by_method in comparison.distances.items():
            record[f"{kind}_fid"] = by_method[name].value
        for kind, by_method in comparison.distances.items():
            record[f"{kind}_fid_95"] = by_method[name].interval
        records.append(record)
    return records


def settings_record(comparison: Comparison) -> dict[str, Any]:
    """Return the settings for JSON."""
    settings = comparison.settings
    return {
        "shorter_side_px": settings.rule.side,
        "frames_a_clip": settings.rule.count,
        "full_colour_px": comparison.full_colour,
        "draws": settings.draws,
        "seed": settings.seed,
        "features_of_a_picture": comparison.feature_count,
    }


def _counts(side: Side) -> dict[str, Any]:
    return {
        "clips": len(side.lengths),
        "frames": sum(side.lengths),
        "pairs": side.count(MOTION),
    }


def _format_number(value: float) -> str:
    if abs(value) < CONSTANTS.rounding:
        return "0"
    if abs(value) < 1000:
        return f"{value:.4g}"
    return f"{value:.0f}"


def _format_interval(distance: Distance) -> str:
    if distance.interval is None:
        return "-"
    low, high = distance.interval
    return f"[{_format_number(low)}, {_format_number(high)}]"


def _sentences(comparison: Comparison) -> Iterator[str]:
    """Yield the order of the methods, a sentence for each kind."""
    for kind, by_method in comparison.distances.items():
        order = sorted(by_method.items(), key=lambda pair: pair[1].value)
        parts = []
        for name, distance in order:
            interval = _format_interval(distance)
            parts.append(f"{name} {_format_number(distance.value)}, 95 %: {interval}")
        heading = WORDS[kind]
        if len(order) > 1:
            heading += ", the nearest first"
        yield f"{heading}: {'; '.join(parts)}."


def _table(comparison: Comparison, kind: str) -> Table:
    lines = []
    for name, side in comparison.methods.items():
        distance = comparison.distances[kind][name]
        counts = (str(len(side.lengths)), str(side.count(kind)))
        value = _format_number(distance.value)
        lines.append((name, *counts, value, _format_interval(distance)))
    reference = comparison.reference
    note = (
        f"Reference: {len(reference.lengths)} clips, {reference.count(kind)} pictures."
    )
    heads = ("method", "clips", "pictures", WORDS[kind], "95 %")
    return Table(heads, tuple(lines), note=note)


def _method_sentences(comparison: Comparison) -> tuple[str, str]:
    """Return sentences on the method of measuring."""
    rule = comparison.settings.rule
    if rule.count is None:
        count = "all frames"
    else:
        count = f"{rule.count} frames, evenly,"
    name = comparison.features.name
    return (
        f"Frames: {count} of each clip, the shorter side made {rule.side} px. Features: {name}.",
        "Motion: flow from each frame to the next, by DIS, coloured as Baker et al. (2011) do; full colour is "
        f"{comparison.full_colour:.4g} px, the speed of the reference's fastest pair.",
    )
