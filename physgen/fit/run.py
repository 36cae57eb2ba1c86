"""Fit a scene file to a clip or to tracks: read, follow, estimate, write, report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from physgen.compile.compile import CompiledScene
from physgen.files import install, write_atomic
from physgen.fit.clip import FilmedClip
from physgen.fit.intervals import Fit
from physgen.fit.page import FitPage, film_pairs, root_mean_square, write_page
from physgen.fit.parameters import DEFAULT_KINDS, Kind
from physgen.fit.residuals import track_noise
from physgen.fit.solve import absent_kinds, fit_scene
from physgen.fit.tracks import LEAST_TIMES, Tracks, read_tracks, tracks_csv
from physgen.fit.writing import fitted_text, interval_text, paths_outside
from physgen.messages import Message, one_of
from physgen.pipeline import stages
from physgen.problems import InputError, Place, Warn
from physgen.progress import Progress, silent
from physgen.scene.files import SUFFIXES
from physgen.scene.load import OpenedScene
from physgen.scene.saving import save_scene
from physgen.scene.scene import Scene

POOR_FIT = 2.0
"""Residuals, as a multiple of the tracks' noise, of a fit in a wrong valley."""


@dataclass(frozen=True)
class FitOptions:
    """Choices of a caller for a fit."""

    scene: Path
    output: Path
    clip: Path | None = None
    tracks: Path | None = None
    """A table with time, object, x, y and angle, in place of a clip."""
    kinds: tuple[Kind, ...] = DEFAULT_KINDS
    slowdown: float = 1.0
    """Duration of the clip, as a multiple of the motion's."""
    seed: int = 0
    allow_outside: bool = False
    has_report: bool = True

    @property
    def origin(self) -> Path:
        """Return the file with the observed motion."""
        return self.clip or self.tracks or self.scene


@dataclass(frozen=True)
class FitResult:
    """A fit and its files."""

    scene: Scene
    """The scene before the fit."""
    fit: Fit
    tracks: Tracks
    output: Path
    report: Path | None


def interval_lines(result: FitResult) -> list[str]:
    """Return the intervals of all determined values as text."""
    lines = []
    for estimate in result.fit.estimates:
        if estimate.is_determined:
            text = interval_text(estimate, result.scene)
            lines.append(f"{estimate.parameter.path}: {text}")
    return lines


def kinds_of(names: Sequence[str]) -> tuple[Kind, ...]:
    """Return the kinds of parameters of these names. Raises InputError."""
    kind_names = [kind.value for kind in Kind]
    problems = []
    for name in names:
        if name not in kind_names:
            fix = one_of(name, kind_names)
            message = Message.FIT_UNKNOWN_KIND
            problems.append(message.problem(Place("free"), "", f'"{name}"', fix=fix))
    if problems:
        raise InputError(problems)
    return tuple(map(Kind, names)) or DEFAULT_KINDS


def fit_files(
    options: FitOptions, warn: Warn, progress: Progress = silent
) -> FitResult:
    """Fit a scene file, and write the fitted scene and its report. Raises InputError."""
    if find_spec("scipy") is None:
        raise Message.FIT_NEEDS_SCIPY.error("fit", install=install("fit"))
    # All refusals come before the work of minutes.
    _check_output(options)
    opened_scene = OpenedScene(options.scene, options.allow_outside)
    scene = opened_scene.scene()
    _check_paths(options)
    maps = stages.percepts(scene)
    compiled_scene, _ = stages.ended(scene, stages.compile(scene, maps))
    clip = None
    if options.tracks is None:
        assert options.clip is not None
        clip = FilmedClip(options.clip, options.slowdown, scene)
        clip.warn_of_frames(warn)
        stage = stages.stage(scene, compiled_scene, maps)
        tracks = clip.tracks(compiled_scene, stage, maps is not None, progress)
    else:
        names = [body.name for body in compiled_scene.world.bodies]
        tracks = read_tracks(options.tracks, names)
    place = Place(str(options.origin))
    _warn_of_losses(tracks, place, warn)
    # The default kinds are not a wish, so that an absent kind needs no warning.
    if options.kinds != DEFAULT_KINDS:
        absent = absent_kinds(scene, compiled_scene, tracks, options.kinds)
        _warn_of_kinds(absent, options, warn)
    _check_motion(tracks, place)
    fit = fit_scene(
        scene, compiled_scene, tracks, options.kinds, options.seed, progress
    )
    _warn_of_residuals(fit, tracks, options, warn)
    _save(options, scene, fit, options.origin.name)
    report = None
    if options.has_report:
        progress("report", 0, 1)
        report = _write_report(options, scene, compiled_scene, clip, tracks, fit)
    return FitResult(scene, fit, tracks, options.output, report)


def _warn_of_residuals(
    fit: Fit, tracks: Tracks, options: FitOptions, warn: Warn
) -> None:
    """Warn of a fit with larger residuals than the noise of the tracks."""
    remainder = root_mean_square(fit.residuals)
    if remainder > POOR_FIT * track_noise(tracks):
        poor = Message.FIT_POOR
        place = Place(str(options.origin))
        found = f"{remainder:.2g} px"
        warn(poor.warning(place, "", found, seed=options.seed + 1))


def _warn_of_losses(tracks: Tracks, place: Place, warn: Warn) -> None:
    """Warn of objects lost in plain sight."""
    for name, time in tracks.losses:
        message = Message.FIT_LOST
        warn(message.warning(place, "", f'"{name}"', time=f"{time:.2f}"))


def _warn_of_kinds(absent: Sequence[Kind], options: FitOptions, warn: Warn) -> None:
    """Warn of kinds without an effect, beside kinds with one."""
    if len(absent) == len(options.kinds):
        # The fit refuses these kinds.
        return
    for kind in absent:
        warn(Message.FIT_KIND_ABSENT.warning(Place("free"), "", kind.value))


def _check_output(options: FitOptions) -> None:
    """Refuse an impossible output path. Raises InputError."""
    output = options.output
    example = options.scene.with_name(f"{options.scene.stem}-fitted.yaml")
    if output.suffix.lower() not in SUFFIXES or output.is_dir():
        message = Message.FIT_NOT_SCENE_NAME
        raise message.error("fitted", f'"{output}"', example=example)
    folders = list(output.parents)
    if options.has_report:
        folders.insert(0, output.with_suffix(""))
    for folder in folders:
        if folder.exists() and not folder.is_dir():
            raise Message.FIT_OUTPUT_BLOCKED.error("fitted", f'"{folder}"')


def _check_paths(options: FitOptions) -> None:
    """Refuse an output from which the scene's files are unreachable. Raises InputError."""
    source, output = options.scene, options.output
    if options.allow_outside or source.parent.resolve() == output.parent.resolve():
        return
    paths = paths_outside(source.read_text(encoding="utf-8"), source, output)
    if paths:
        message = Message.FIT_OUTPUT_APART
        example = source.with_name(output.name)
        names = ", ".join(paths)
        raise message.error("fitted", f'"{output}"', files=names, example=example)


def _save(options: FitOptions, scene: Scene, fit: Fit, origin: str) -> None:
    """Write the fitted scene after a test of its text. Raises InputError."""
    source, output = options.scene, options.output
    text = source.read_text(encoding="utf-8")
    new_text = fitted_text(text, source, output, scene, fit, origin)
    output.parent.mkdir(parents=True, exist_ok=True)
    OpenedScene(output, options.allow_outside, new_text).scene()
    save_scene(output, new_text.encode())


def _check_motion(tracks: Tracks, place: Place) -> None:
    """Refuse too short tracks. Raises InputError."""
    if len(tracks.times) < LEAST_TIMES:
        count = f"{len(tracks.times)} frames"
        raise Message.TRACKS_FEW.error_at(place, "", count, least=LEAST_TIMES)


def _write_report(
    options: FitOptions,
    scene: Scene,
    compiled_scene: CompiledScene,
    clip: FilmedClip | None,
    tracks: Tracks,
    fit: Fit,
) -> Path:
    """Write the page, the film beside the simulation, and the tracks; return the page."""
    folder = options.output.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    write_atomic(folder / "tracks.csv", tracks_csv(tracks).encode())
    maps = stages.percepts(fit.scene)
    fitted_scene = stages.compile(fit.scene, maps)
    stage = stages.stage(fit.scene, fitted_scene, maps)
    # Tracks alone have no frames; their rate is not used.
    frames, rate = None, 1.0
    if clip is not None:
        frames, rate = clip.frames(), clip.fps
    photo = film_pairs(folder, frames, stage, fitted_scene, tracks, rate)
    name = options.output.name
    origin = options.origin.name
    page = FitPage(name, origin, scene, compiled_scene.world, tracks, fit)
    return write_page(folder, page, photo, has_film=clip is not None)
