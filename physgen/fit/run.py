"""Fit a scene file to a clip or to tracks: read, follow, estimate, write, report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import islice
from pathlib import Path

import numpy as np

from physgen.arrays import F64, U8
from physgen.compile.compile import CompiledScene
from physgen.files import install, write_atomic
from physgen.fit.film import follow_film
from physgen.fit.page import FitPage, film_pairs, write_page
from physgen.fit.parameters import DEFAULT_KINDS, Kind
from physgen.fit.solve import Fit, absent_kinds, fit_scene, track_noise
from physgen.fit.tracks import LEAST_TIMES, Tracks, read_tracks, tracks_csv
from physgen.fit.writing import fitted_text, interval_text, paths_outside
from physgen.messages import Message, one_of
from physgen.pipeline import stages
from physgen.problems import InputError, Place, Warn
from physgen.progress import Progress, silent
from physgen.render.stage import Stage
from physgen.scene.files import SUFFIXES
from physgen.scene.load import OpenedScene
from physgen.scene.saving import save_scene
from physgen.scene.scene import Scene
from physgen.videos import Video, read_video

MOST_FRAMES = 600
"""Frames of a clip that are followed."""
EVEN = 0.0015
"""s by which the frames of an even film differ, since files round them."""
POOR = 2.0
"""Residuals, of the noise of tracks, from which a fit may be in a wrong valley."""
SAME = 0.5
"""px by which a clip's size may differ."""


@dataclass(frozen=True)
class FitOptions:
    """What a caller can choose about a fit."""

    scene: Path
    output: Path
    clip: Path | None = None
    tracks: Path | None = None
    """A table with time, object, x, y and angle, in place of a clip."""
    kinds: tuple[Kind, ...] = DEFAULT_KINDS
    slow: float = 1.0
    """How many times slower than life the clip plays."""
    seed: int = 0
    allow_outside: bool = False
    has_report: bool = True


@dataclass(frozen=True)
class FitResult:
    """A fit and its files."""

    scene: Scene
    """Before the fit."""
    fit: Fit
    tracks: Tracks
    output: Path
    report: Path | None


def interval_lines(result: FitResult) -> list[str]:
    """Return the interval of each value that the clip determines, as text."""
    lines = []
    for estimate in result.fit.estimates:
        if estimate.is_determined:
            text = interval_text(estimate, result.scene)
            lines.append(f"{estimate.parameter.path}: {text}")
    return lines


def kinds_of(names: Sequence[str]) -> tuple[Kind, ...]:
    """Return the kinds of parameters of these names. Raises InputError."""
    known = [kind.value for kind in Kind]
    problems = []
    for name in names:
        if name not in known:
            fix = one_of(name, known)
            unknown = Message.FIT_UNKNOWN_KIND
            problems.append(unknown.problem(Place("free"), "", f'"{name}"', fix=fix))
    if problems:
        raise InputError(problems)
    return tuple(Kind(name) for name in names) or DEFAULT_KINDS


def fit_files(
    options: FitOptions, warn: Warn, progress: Progress = silent
) -> FitResult:
    """Fit a scene file, and write the fitted scene and its report. Raises InputError."""
    if find_spec("scipy") is None:
        raise Message.FIT_NEEDS_SCIPY.error("fit", install=install("fit"))
    _check_output(options)
    opened = OpenedScene(options.scene, options.allow_outside)
    scene = opened.scene()
    _check_paths(options)
    maps = stages.percepts(scene)
    compiled, _ = stages.ended(scene, stages.compile(scene, maps))
    film = None
    if options.tracks is None:
        assert options.clip is not None
        film = Film(options.clip, options.slow, scene)
        film.warn_of_frames(warn)
        stage = stages.stage(scene, compiled, maps)
        tracks = film.tracks(compiled, stage, maps is not None, progress)
    else:
        names = [body.name for body in compiled.world.bodies]
        tracks = read_tracks(options.tracks, names)
    origin = options.clip or options.tracks or options.scene
    place = Place(str(origin))
    _warn_of_losses(tracks, place, warn)
    if options.kinds != DEFAULT_KINDS:
        _warn_of_kinds(
            absent_kinds(scene, compiled, tracks, options.kinds), options, warn
        )
    _check_motion(tracks, place)
    fit = fit_scene(scene, compiled, tracks, options.kinds, options.seed, progress)
    rest = float(np.sqrt(np.nanmean(fit.residuals**2)))
    if rest > POOR * track_noise(tracks):
        poor = Message.FIT_POOR
        warn(poor.warning(place, "", f"{rest:.2g} px", seed=options.seed + 1))
    _save(options, scene, fit, origin.name)
    report = None
    if options.has_report:
        progress("report", 0, 1)
        report = _write_report(options, scene, compiled, film, tracks, fit)
    return FitResult(scene, fit, tracks, options.output, report)


def _warn_of_losses(tracks: Tracks, place: Place, warn: Warn) -> None:
    """Warn of objects that a tracker lost."""
    for name, time in tracks.losses:
        lost = Message.FIT_LOST
        warn(lost.warning(place, "", f'"{name}"', time=f"{time:.2f}"))


def _warn_of_kinds(absent: Sequence[Kind], options: FitOptions, warn: Warn) -> None:
    """Warn of kinds that have no effect beside others that have one."""
    if len(absent) == len(options.kinds):
        return  # the fit refuses them
    for kind in absent:
        warn(Message.FIT_KIND_ABSENT.warning(Place("free"), "", kind.value))


def _check_output(options: FitOptions) -> None:
    """Refuse an output that cannot be written. Raises InputError."""
    output = options.output
    example = options.scene.with_name(f"{options.scene.stem}-fitted.yaml")
    if output.suffix.lower() not in SUFFIXES or output.is_dir():
        wrong = Message.FIT_NOT_SCENE_NAME
        raise wrong.error("fitted", f'"{output}"', example=example)
    report = [output.with_suffix("")] if options.has_report else []
    for folder in (*report, *output.parents):
        if folder.exists() and not folder.is_dir():
            raise Message.FIT_OUTPUT_BLOCKED.error("fitted", f'"{folder}"')


def _check_paths(options: FitOptions) -> None:
    """Refuse an output that could not read the scene's files. Raises InputError."""
    source, output = options.scene, options.output
    if options.allow_outside or source.parent.resolve() == output.parent.resolve():
        return
    paths = paths_outside(source.read_text(encoding="utf-8"), source, output)
    if paths:
        example, names = source.with_name(output.name), ", ".join(paths)
        apart = Message.FIT_OUTPUT_APART
        raise apart.error("fitted", f'"{output}"', files=names, example=example)


def _save(options: FitOptions, scene: Scene, fit: Fit, origin: str) -> None:
    """Write the fitted scene, if it can be opened. Raises InputError."""
    source, output = options.scene, options.output
    text = source.read_text(encoding="utf-8")
    new_text = fitted_text(text, source, output, scene, fit, origin)
    output.parent.mkdir(parents=True, exist_ok=True)
    OpenedScene(output, options.allow_outside, new_text).scene()
    save_scene(output, new_text.encode())


def _check_motion(tracks: Tracks, place: Place) -> None:
    """Refuse tracks that are too short. Raises InputError."""
    if len(tracks.times) < LEAST_TIMES:
        found = f"{len(tracks.times)} frames"
        raise Message.TRACKS_FEW.error_at(place, "", found, least=LEAST_TIMES)


class Film:
    """A clip beside the scene of its first frame."""

    def __init__(self, path: Path, slow: float, scene: Scene) -> None:
        """Raise InputError if it cannot be read or has another size than the photo."""
        self.video: Video = read_video(path)
        width, height = scene.size
        wide, tall = self.video.size
        # encoders make odd sides even
        if abs(wide - width) > 1 + SAME or abs(tall - height) > 1 + SAME:
            raise Message.FIT_CLIP_SIZE.error(
                str(path), f"{wide} x {tall} px", width=width, height=height
            )
        if self.video.fps is None:
            raise Message.FIT_CLIP_WITHOUT_RATE.error(str(path))
        self.fps = self.video.fps
        self.size = (width, height)
        count = min(self.video.count, MOST_FRAMES)
        self.times: F64 = _frame_times(self.video.durations, self.fps)[:count] / slow

    def warn_of_frames(self, warn: Warn) -> None:
        """Warn of frames beyond those that are followed."""
        left = self.video.count - len(self.times)
        if left:
            place, found = Place(str(self.video.path)), f"{left} frames"
            warn(Message.FIT_FRAMES_LEFT.warning(place, "", found, most=MOST_FRAMES))

    def frames(self) -> Iterator[U8]:
        """Yield the frames, (H, W, 3) sRGB of the photo's size."""
        width, height = self.size
        for frame in islice(self.video.frames(), len(self.times)):
            tall, wide = frame.shape[:2]
            rows, columns = max(height - tall, 0), max(width - wide, 0)
            padded = np.pad(frame, ((0, rows), (0, columns), (0, 0)), mode="edge")
            yield np.ascontiguousarray(padded[:height, :width])

    def tracks(
        self, compiled: CompiledScene, stage: Stage, has_photo: bool, progress: Progress
    ) -> Tracks:
        """Return where the objects are in each frame."""
        world = compiled.world
        frames = self.frames()
        return follow_film(frames, self.times, stage, world, has_photo, progress)


def _frame_times(durations: Sequence[float | None], fps: float) -> F64:
    """Return when each frame begins to be shown, s."""
    shown = np.array([1 / fps if one is None else one for one in durations])
    if np.ptp(shown) < EVEN:
        return np.arange(len(shown)) / fps
    return np.concatenate([[0.0], np.cumsum(shown[:-1])])


def _write_report(
    options: FitOptions,
    scene: Scene,
    compiled: CompiledScene,
    film: Film | None,
    tracks: Tracks,
    fit: Fit,
) -> Path:
    """Write the page, the film beside the simulation, and the tracks; return the page."""
    folder = options.output.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    write_atomic(folder / "tracks.csv", tracks_csv(tracks).encode())
    maps = stages.percepts(fit.scene)
    after = stages.compile(fit.scene, maps)
    stage = stages.stage(fit.scene, after, maps)
    frames = film.frames() if film is not None else None
    rate = film.fps if film is not None else 1.0
    photo = film_pairs(folder, frames, stage, after, tracks, rate)
    origin = (options.clip or options.tracks or options.scene).name
    page = FitPage(options.output.name, origin, scene, compiled.world, tracks, fit)
    return write_page(folder, page, photo, has_film=film is not None)
