"""Scene file to output folder: video, trajectory, report and manifest, complete or not
at all.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen import report, simulate
from physgen.compile.shapes import shapes_of
from physgen.export.video_formats import I16, U8, Format
from physgen.files import file_stamp
from physgen.messages import Message
from physgen.pipeline.clip_warnings import (
    HARDLY,
    LITTLE,
    UNMOVED,
    accuracy_warnings,
    departure_warnings,
    imbalance,
    reduced_rates,
)
from physgen.pipeline.fan_draws import Draws
from physgen.pipeline.film import Film, SideThreads
from physgen.pipeline.push_motion import measure_sweep
from physgen.pipeline.pushes import default_push
from physgen.pipeline.refining import (
    Footage,
    Refiners,
    guidance_footage,
    refine_footage,
)
from physgen.pipeline.render_options import Page, command_alone, output_name
from physgen.pipeline.render_options import RenderOptions as RenderOptions
from physgen.pipeline.sounding import write_sound
from physgen.pipeline.stages import Keep, Maps, Stages, fan, lint, render, resolved
from physgen.pipeline.writing import VideoFiles
from physgen.problems import (
    InputError,
    Place,
    Problem,
    Warn,
    ignore_warning,
    variant_named,
)
from physgen.progress import Progress, silent
from physgen.report.folders import (
    atomic_folder,
    lost_files,
    output_folder,
    read_manifest,
)
from physgen.report.record import (
    TIMING,
    RunRecord,
    file_hash,
    inputs,
    source_of,
    write_json,
)
from physgen.scene.scene import ADD_OBJECT, Motion
from physgen.scene.write import scene_text

if TYPE_CHECKING:
    from physgen.compile.world import World
    from physgen.report.perception import Comparison, Perception
    from physgen.report.player import Data
    from physgen.scene.scene import Object, Scene
    from physgen.simulate.trajectory import Trajectory
from physgen.pipeline.clip_labels import Labels


def render_scene(
    path: str | Path,
    out: str | Path = "out",
    options: RenderOptions | None = None,
    *,
    refiners: Refiners | None = None,
    stages: Stages | None = None,
    progress: Progress = silent,
    warn: Warn = ignore_warning,
    **changes: Any,
) -> Path:
    """Render a scene to `out/<name>/`: video, trajectory, manifest and report.

    The folder is complete or not written at all. `changes` are fields of RenderOptions,
    which replace those of `options`. `refiners` and `stages` share models and results
    between scenes. Returns the folder. Raises InputError; if the refinement fails, the
    folder is still written, with `unrefined.mp4`.
    """
    options = replace(options or RenderOptions(), **changes)
    # The side tasks of a run, such as the copy of inputs, end with it, also after an
    # error: nobody would wait for them later.
    run = _Run(path, Path(out), options, stages or Stages(Keep.NOTHING), progress, warn)
    try:
        return run.make_clip(refiners or Refiners())
    finally:
        run.aside.join()


def _displacements(world: World, trajectory: Trajectory) -> NDArray[np.float64]:
    """Return the displacements (N, 3) of bodies in a motion: px, px, px by rotation."""
    # A rotation moves a body's farthest point by angle times reach.
    reach = np.array([body.reach for body in world.bodies])[:, None]
    lengths = np.concatenate([np.ones((len(reach), 2)), reach], 1)
    return np.asarray(np.ptp(trajectory.poses, axis=0) * lengths)


def _new_record(path: str | Path, options: RenderOptions) -> RunRecord:
    """Return the record of a run that begins."""
    command = command_alone(path, options)
    record = RunRecord(
        scene="", command=list(options.command) or command, clip_command=command
    )
    record.overrides = list(options.overrides)
    record.variant = options.variant
    record.mark = options.mark
    return record


def _load_clip(
    path: str | Path, options: RenderOptions, stages: Stages, record: RunRecord
) -> tuple[Scene, Maps]:
    """Return the scene of a clip, with the clip's name, and the maps of its photo."""
    variant = options.variant
    with record.stage("load"):
        scene = stages.load(path, options.overrides, variant, options.allow_outside)
        scene = replace(scene, name=options.name or output_name(path, variant))
        return scene, stages.maps(scene)


def _describe_inputs(
    record: RunRecord, scene: Scene, path: Path, folder: Path, stages: Stages
) -> None:
    """Add the scene's name, its input files and the size of the video to a record."""
    record.scene = scene.name
    record.seeds = {"refine": scene.refine.seed}
    record.inputs = inputs(scene, path, stages.hash)
    record.source = source_of(path, folder)
    record.video = {"size": list(scene.video_size), "fps": scene.render.fps}


class _Run:
    """The state of one render, shared by its stages."""

    def __init__(
        self,
        path: str | Path,
        out: Path,
        options: RenderOptions,
        stages: Stages,
        progress: Progress,
        warn: Warn,
    ) -> None:
        self.options = options
        self.progress = progress
        self._warn = warn
        self.record = record = _new_record(path, options)
        # Files that another program writes after this time make the clip outdated.
        self._begun = time.time_ns()
        scene, maps = _load_clip(path, options, stages, record)
        self.scene = scene
        self._stamps = maps.stamps
        self.final = output_folder(out, scene.name)
        _describe_inputs(record, scene, Path(path), self.final, stages)
        progress("compile", 0, 1)
        # Problems of a variant name it, so that the user can find the edit.
        with record.stage("compile"), variant_named(options.variant):
            compiled_scene = stages.compile(scene, maps)
            record.document = resolved(scene, compiled_scene)
            warnings = lint(scene, compiled_scene, maps.percepts)
        for problem in [*warnings, *reduced_rates(scene, options.formats)]:
            self.warn(problem)
        self._failures: list[Problem] = []  # formats that cannot be written
        self.paged = bool(options.formats) and options.page is not Page.NONE
        self.film = Film(scene, compiled_scene, maps, record, stages)
        self.labels = Labels.for_clip(options.export, scene, maps.percepts)
        self.film.keeps_layers = any(kind.has_layers for kind in self.labels.kinds)
        # Without a video, the labels are written to the clip's folder itself, and would
        # replace the video of an earlier run.
        if options.export and not options.formats:
            self.labels.check_kept(self.final)
        self.aside = SideThreads(record, scene.size)
        self._percepts = maps.percepts if self.paged else None
        self._mask_ids = None if maps.percepts is None else maps.percepts.labels
        self._perceived: Callable[[], Perception | None]
        self._player: Callable[[], Data | None]
        self._sound_section: dict[str, Any] | None = None

    def make_clip(self, refiners: Refiners) -> Path:
        """Write the complete folder and return it. Raises InputError."""
        record = self.record
        film = self.film
        faults: Sequence[Problem] = ()
        footage = trajectory = None
        if self.scene.refine.backend != "none":
            self._draw_perception()
            footage = guidance_footage(film, record, self.progress)
            trajectory = footage.trajectory
        else:
            self.progress("simulate", 0, 1)
            trajectory = film.simulate_motion(self.progress)
            # Only after the simulation: the engine switches between threads at every
            # step, and a thread beside it costs more time than it gains.
            self._draw_perception()
        draws = self.analyse(trajectory)
        with atomic_folder(self.final) as folder:
            if footage is None:
                first_frame = self.draw(trajectory, folder)
                comparison = None
            else:
                faults, comparison = self.refine(footage, folder, refiners)
                first_frame = footage.rgb[0]
                if self.paged:
                    self._sample_player(trajectory)
            with record.stage("report", time.thread_time):
                trajectory.save(folder / "trajectory.npz")
                if draws is not None:
                    draws.save(folder)
                if self.paged:
                    self.write_page(trajectory, first_frame, folder, comparison, draws)
            if self._failures or not self.inputs_unchanged():
                # A format is missing, or an input changed during the run: without a
                # mark, the next run renders the clip again.
                record.mark = ""
            write_manifest(record, folder)
            earlier_manifest = read_manifest(self.final)
        self._warn_of_replaced_files(earlier_manifest)
        if faults:
            raise InputError(
                [*faults, _kept_clip(self.final, "has the clip without refinement")]
            )
        if self._failures:
            raise InputError(
                [
                    *dict.fromkeys(self._failures),
                    _kept_clip(self.final, "has the clip in the other formats"),
                ]
            )
        return self.final

    def _warn_of_replaced_files(self, earlier_manifest: Mapping[str, Any]) -> None:
        """Warn if the clip replaced that of another scene, or files of a former run."""
        source = earlier_manifest.get("source")
        place = Place(str(self.final))
        # Two scenes of the same name replace each other's clips.
        other_scene = os.path.normpath(self.final / str(source))
        if source != self.record.source and os.path.isfile(other_scene):
            self._warn(Message.CLIP_REPLACED.warning(place, scene=other_scene))
            return
        files = lost_files(earlier_manifest, {*self.record.files, "report.html"})
        if files:
            self._warn(Message.FILES_REPLACED.warning(place, files=files))

    def _draw_perception(self) -> None:
        """Start to draw the report's pictures of the photo; its maps are
        released then.
        """
        if self.paged:
            make = partial(
                report.perception.perception,
                self.scene,
                self.film.compiled,
                self._percepts,
            )
            self._perceived = self.aside.start("report", make)
            self._percepts = None

    def _sample_player(self, trajectory: Trajectory) -> None:
        """Start to collect the report's data of the motion, from frames that are
        sampled already.
        """
        film = self.film
        parts = film.compiled.world, trajectory, film.stage, film.shot(trajectory)

        def sample() -> Data | None:
            # Compile the template in this thread, too.
            report.html.template("report.html.j2")
            data = report.player.player_data(self.scene, *parts)
            if data is not None and film.hold:
                data["clip"]["hold"] = film.hold
            return data

        self._player = self.aside.start("report", sample)

    def warn(self, problem: Problem) -> None:
        """Warn the user, and add the warning to the record."""
        self._warn(problem)
        self.record.warnings.append({**problem.as_dict(), "text": str(problem)})

    def inputs_unchanged(self) -> bool:
        """Check that no input of the clip was written since the run began."""
        scene_folder = self.scene.folder.resolve()
        times = []
        for name in self.record.inputs:
            times.append(file_stamp(Path(os.path.normpath(scene_folder / name)))[:2])
        has_same_stamps = all(file_stamp(file) == stamp for file, stamp in self._stamps)
        return has_same_stamps and all(max(pair) < self._begun for pair in times)

    def analyse(self, trajectory: Trajectory) -> Draws | None:
        """Check motion and energy balance; return draws of uncertain values, if
        requested.
        """
        record = self.record
        options = self.options
        scene = self.scene
        world = self.film.compiled.world
        self._check_motion(trajectory)
        # The hashes let `verify` compare a motion without its file.
        record.samples = trajectory.sample_hashes()
        record.effort = asdict(trajectory.effort)
        for problem in accuracy_warnings(scene, world, trajectory, record.imbalance):
            self.warn(problem)
        if not options.draws:
            return None
        record.seeds["fan"] = options.draw_seed
        with record.stage("fan"):
            draws = self._draws()
            record.fan = None if draws is None else draws.as_dict()
        return draws

    def _check_motion(self, trajectory: Trajectory) -> None:
        """Warn if little or nothing moves or if objects leave, and record the energy
        balance of a motion.
        """
        scene = self.scene
        world = self.film.compiled.world
        displacements = _displacements(world, trajectory)
        # A pushed object should move visibly; without pushes, any motion at all is
        # enough.
        pushed_objects = []
        for item in scene.objects:
            if any(item.velocity):
                pushed_objects.append(item)
        if pushed_objects:
            smallest_visible = HARDLY * max(scene.size)
        else:
            smallest_visible = UNMOVED
        if displacements.max(initial=0.0) < smallest_visible:
            template = Message.NOTHING_MOVES
            if not world.bodies:
                template = Message.NOTHING_TO_MOVE
            fix = self._advise_motion(pushed_objects, smallest_visible)
            self.warn(template.warning(scene.place("objects"), fix=fix))
            return
        self.record.imbalance = imbalance(world, trajectory)
        # A rocking object moves its corners farther than its centre.
        sweep = measure_sweep(world, trajectory.poses)
        farthest = float(max(displacements.max(), sweep.max()))
        if pushed_objects and farthest < LITTLE * max(scene.size):
            name = pushed_objects[0].name
            place = scene.place(f"objects.{name}.velocity")
            self.warn(Message.HARDLY_MOVES.warning(place, name))
        for problem in departure_warnings(scene, world, trajectory):
            self.warn(problem)

    def _advise_motion(
        self, pushed_objects: Sequence[Object], smallest_visible: float
    ) -> str:
        """Return advice for a scene in which nothing moves by `smallest_visible` px."""
        scene = self.scene
        world = self.film.compiled.world
        look_hint = 'see what holds it by --set "render.overlay=[outlines, contacts]"'
        if pushed_objects:
            name = pushed_objects[0].name
            speed = float(np.hypot(*pushed_objects[0].velocity))
            # The push may be too weak, or the object may be held.
            if speed * world.duration < smallest_visible:
                return f"{name} has {speed:.3g} px/s, too little to see"
            return f"{name} has a velocity and is stuck: {look_hint}"
        push = default_push(scene, shapes_of(scene, self._mask_ids), {})
        if push:
            return f"try --push {push.name}={push.way}, or write a velocity or a force"
        if not world.bodies:
            return ADD_OBJECT
        if any(item.motion is Motion.STATIC for item in scene.objects):
            look_hint = f"write motion: dynamic, or {look_hint}"
        return f"no push moves anything: {look_hint}"

    def _draws(self) -> Draws | None:
        """Simulate with random values; None and a warning if no value of the scene is
        uncertain.
        """
        scene = self.scene
        compiled_scene = self.film.compiled
        options = self.options
        if not simulate.uncertain_values.uncertain_values(scene, options.variant):
            self.warn(
                Message.NOTHING_UNCERTAIN.warning(scene.place("objects"), "--fan")
            )
            return None
        ensemble = fan(
            scene,
            compiled_scene,
            options.draws,
            options.draw_seed,
            options.variant,
            self.progress,
        )
        return Draws(ensemble, simulate.uncertainty.verdicts(ensemble))

    def draw(self, trajectory: Trajectory, folder: Path) -> U8:
        """Write the video and the labels, and return the first frame."""
        film = self.film
        record = self.record
        # The frames are drawn one at a time, and labels read them on their way to the
        # video.
        film.sample_exposures(trajectory)
        if not self.options.export:
            record.video |= film.deliver()
        if self.paged:
            self._sample_player(trajectory)
        files = VideoFiles(
            self.scene,
            folder,
            self.options.formats,
            record,
            self.progress,
            self._failures,
            self._write_sound(trajectory, folder),
        )
        count = film.count(trajectory)
        with self.labels.export_labels(
            film, trajectory, self._truth(folder), record
        ) as tap:
            frames = film.deliver_frames(tap(film.frames(trajectory)), trajectory)
            record.frames, first_frame = files.write(frames, count)
        return first_frame

    def refine(
        self, footage: Footage, folder: Path, refiners: Refiners
    ) -> tuple[Sequence[Problem], Comparison | None]:
        """Write the clip unrefined and refined, and the labels.

        Returns the reasons for a failure, and the comparison of the most changed frame.
        """
        film = self.film
        record = self.record
        files = VideoFiles(
            self.scene,
            folder,
            self.options.formats,
            record,
            self.progress,
            self._failures,
            self._write_sound(footage.trajectory, folder),
        )
        # The video is written twice, before and after, so that the report can compare
        # both.
        outcome = refine_footage(film, footage, refiners, files)
        self.labels.of_frames(
            film, footage.trajectory, self._truth(folder), record, self.progress
        )
        earlier_manifest = read_manifest(self.final)
        # The refined clip of an earlier run may have taken hours: keep it.
        if (
            outcome.faults
            and earlier_manifest.get("refine")
            and earlier_manifest.get("frames")
        ):
            raise InputError(
                [
                    *outcome.faults,
                    _kept_clip(self.final, "keeps the clip that was refined before"),
                ]
            )
        return outcome.faults, outcome.largest_change

    def _write_sound(self, trajectory: Trajectory, folder: Path) -> I16 | None:
        """Write the sound track, if a format of the clip can have one; return its
        samples.
        """
        has_track = Format.MP4 in self.options.formats and self.options.sound
        if not has_track or self.scene.render.sound is None:
            return None

        track = write_sound(self.film, trajectory, folder, self.record)
        if track is None:
            return None
        if self.paged:
            self._sound_section = report.listening.sound_section(track)
        return track.samples

    def _truth(self, folder: Path) -> Path:
        """Return the folder of the labels."""
        if self.options.formats:
            return folder / "truth"
        return folder

    def write_page(
        self,
        trajectory: Trajectory,
        first: U8,
        folder: Path,
        comparison: Comparison | None,
        draws: Draws | None,
    ) -> None:
        """Write the report; `first` is the clip's first frame before refinement."""
        scene = self.scene
        film = self.film
        record = self.record
        world = film.compiled.world
        film_link = report.films.linked_film(self._video_files(folder))
        # The page draws its own overlay on the bare first frame of the whole photo.
        if scene.render.overlay or not film.shot(trajectory).opens_on_photo:
            first = next(render(film.stage, trajectory)).rgb
        parts = report.page.PageParts(
            self._player(),
            self._perceived(),
            comparison,
            None if draws is None else draws.section(world, first),
            home=self.final,
            sound=self._sound_section,
        )
        text = scene_text(record.document)
        html = report.page.report_page(
            scene, world, record, first, film_link, text, parts
        )
        (folder / "report.html").write_text(html, "utf-8", "backslashreplace")

    def _video_files(self, folder: Path) -> list[str]:
        """Return the names of the clip's films in a folder.

        A failed refinement leaves only the unrefined video.
        """
        if self.record.frames:
            name = "video"
        else:
            name = "unrefined"
        names = [kind.file_name(name) for kind in self.options.formats]
        return [video for video in names if (folder / video).exists()]


def _kept_clip(folder: Path, description: str) -> Problem:
    """Return the warning that the folder contains an earlier or partial clip."""
    return Message.CLIP_KEPT.warning(Place(str(folder)), content=description)


def write_manifest(record: RunRecord, folder: Path) -> None:
    """Write the record with the hashes of all files in the folder, and its
    times apart.
    """
    for file in sorted(
        p for p in folder.rglob("*") if p.is_file() and p != folder / TIMING
    ):
        record.files[file.relative_to(folder).as_posix()] = file_hash(file)
    write_json(folder / TIMING, record.timing())
    write_json(folder / "manifest.json", record.manifest())
