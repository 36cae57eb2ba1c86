"""Refinement of a scene's clip by a video diffusion model, which sees all frames at
once.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from physgen import refine, registry, report
from physgen.export.video_formats import U8
from physgen.pipeline.film import Film
from physgen.problems import InputError, Problem
from physgen.progress import Progress
from physgen.registry import Choice, Plan
from physgen.render.mattes import matte_coverage
from physgen.render.stage import Frame

if TYPE_CHECKING:
    from physgen.maps import F32, U16
    from physgen.pipeline.writing import VideoFiles
    from physgen.refine.denoiser import Denoiser
    from physgen.refine.fusion import RefineSettings
    from physgen.report.perception import Comparison
    from physgen.report.record import RunRecord
    from physgen.scene.scene import Scene
    from physgen.simulate.trajectory import Trajectory


@dataclass(frozen=True)
class Footage:
    """A clip before refinement, with one frame per sample of its trajectory."""

    trajectory: Trajectory
    rgb: list[U8] = field(default_factory=list)
    """Frames, (H, W, 3) sRGB each."""
    coverage: list[F32] = field(default_factory=list)
    """Coverage of objects, (H, W) each, 0..1."""
    ids: list[U16] = field(default_factory=list)
    """Ids, (H, W) each: k + 1 for body k, 0 for the background."""


class LargestChange:
    """The frame with the largest change by refinement, updated frame by frame."""

    def __init__(self) -> None:
        self.index = 0
        self.refined: U8 = np.zeros((0, 0, 3), np.uint8)
        """(H, W, 3) sRGB: that frame after refinement."""
        self._seen = 0
        self._largest = -1.0

    def add(self, guidance: U8, refined_frame: U8) -> None:
        """Add the next frame, (H, W, 3) sRGB, before and after refinement."""
        mean_difference = float(
            np.abs(np.subtract(refined_frame, guidance, dtype=np.int16)).mean()
        )
        # The largest difference so far makes the best example for the report.
        if mean_difference > self._largest:
            self._largest = mean_difference
            self.index = self._seen
            self.refined = refined_frame.copy()
        self._seen += 1


class Refiners:
    """Refinement models by backend, loaded at first use and kept for later clips."""

    def __init__(self, plan: Callable[[], Plan] = Plan) -> None:
        """Create an empty set of models.

        `plan` returns weights, device and options; its choice for `refine` applies to
        scenes with that backend.
        """
        self._plan = plan
        self._models: dict[str, Denoiser] = {}

    def model(self, name: str) -> Denoiser:
        """Return the model of a backend. Raises InputError without its libraries or
        weights.
        """
        if name not in self._models:
            plan = self._plan()
            planned_choice = plan.choices.get("refine")
            if planned_choice is not None and planned_choice.name == name:
                choice = planned_choice
            else:
                choice = Choice(name)
            setup = replace(plan, choices={"refine": choice}).setup("refine")
            self._models[name] = registry.make("refine", name, setup)
        return self._models[name]

    def close(self) -> None:
        """Release all models."""
        for model in self._models.values():
            model.close()
        self._models.clear()


@dataclass(frozen=True)
class Outcome:
    """The result of a refinement."""

    faults: Sequence[Problem]
    """Reasons for a failure; empty after a success."""
    largest_change: Comparison | None
    """Comparison of the most changed frame, before and after."""


def refine_settings(scene: Scene) -> RefineSettings:
    """Return the settings of `refine:` in a scene; the default prompt lists its
    labels.
    """
    section = scene.refine
    # A prompt of the user replaces that of the labels as a whole.
    if section.prompt is None:
        prompt = refine.fusion.prompt_of(item.label for item in scene.objects)
    else:
        prompt = section.prompt
    return refine.fusion.RefineSettings(
        strength=section.strength,
        stop=section.stop,
        steps=section.steps,
        seed=section.seed,
        prompt=refine.denoiser.PromptSettings(
            prompt, section.negative, section.guidance
        ),
        lock=section.lock,
        detail=section.detail,
        hold=refine.fusion.hold_frames(scene.render.fps),
    )


def guidance_footage(film: Film, record: RunRecord, progress: Progress) -> Footage:
    """Render the clip without refinement, one frame per sample."""
    progress("simulate", 0, 1)
    footage = Footage(film.simulate_motion(progress))
    count = len(footage.trajectory.times)
    frames = film.frames(footage.trajectory, range(count))
    mattes = film.frames(footage.trajectory, range(count), matte=True)
    for index in range(count):
        with record.stage("render"):
            frame = next(frames)
            # The arrays may be views of a batch of frames, which would stay in memory.
            footage.rgb.append(frame.rgb.copy())
            footage.ids.append(frame.ids.copy())
        with record.stage("cover"):
            footage.coverage.append(matte_coverage(next(mattes)))
        progress("render", index + 1, count)
    return footage


def refine_footage(
    film: Film, footage: Footage, refiners: Refiners, files: VideoFiles
) -> Outcome:
    """Write the clip unrefined and, in all formats, refined."""
    scene = film.scene
    trajectory = footage.trajectory
    record = files.record
    sample_order = film.shot(trajectory).order
    count = len(footage.rgb)

    def clip(pictures: Iterator[U8]) -> Iterator[Frame]:
        return film.draw_overlays(
            _frames(footage, pictures, sample_order, film.stage.faces), trajectory
        )

    def unrefined_clip() -> Iterator[Frame]:
        return clip(footage.rgb[sample] for sample in sample_order)

    # The unrefined clip comes first: it remains if the refinement fails after hours.
    record.unrefined_frames = _write_unrefined(files, unrefined_clip, len(sample_order))
    name = scene.refine.backend
    try:
        with record.stage("load model"), refine.fusion.backend_errors("--refine", name):
            model = refiners.model(name)
        refinement = refine.fusion.Refinement(
            model, refine_settings(scene), scene.video_size, count, files.progress
        )
        largest_change = LargestChange()
        refined_frames = _record_frame_changes(
            name,
            refinement.frames(footage.rgb, footage.coverage),
            footage,
            largest_change,
        )
        # The model yields each frame once: a clip that plays samples in another order
        # needs all of them in memory.
        if list(sample_order) != list(range(count)):
            with record.stage("refine"):
                pictures = [rgb.copy() for rgb in refined_frames]
            refined_frames = map(pictures.__getitem__, sample_order)
        record.frames = files.write(
            clip(refined_frames), len(sample_order), "video", "refine", "decode"
        )[0]
    except InputError as error:
        _remove_refined(files)
        record.frames = []
        record.refine = {"backend": name, "failed": "; ".join(map(str, error.problems))}
        return Outcome(error.problems, None)
    record.refine = {"backend": name, **refinement.note()}
    return Outcome((), _compare(footage, largest_change))


def _compare(footage: Footage, largest_change: LargestChange) -> Comparison:
    """Return the comparison of the most changed frame, before and after."""
    time = float(footage.trajectory.times[largest_change.index])
    before = ("as it was drawn", footage.rgb[largest_change.index])
    after = ("refined", largest_change.refined)
    caption = f"The frame that changed most, at {time:.2f} s."
    return report.perception.compare_frames(
        "refined", "Refined", caption, before, after
    )


def _remove_refined(files: VideoFiles) -> None:
    """Remove the incomplete files of a failed refinement."""
    for video_format in files.formats:
        path = files.folder / video_format.file_name("video")
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def _write_unrefined(
    files: VideoFiles, frames: Callable[[], Iterator[Frame]], count: int
) -> list[str]:
    """Write the unrefined clip in the first possible format; return the hashes of its
    frames.
    """
    problems: list[Problem] = []
    for video_format in files.formats:
        single = replace(files, formats=[video_format])
        try:
            return single.write(frames(), count, "unrefined", "read")[0]
        except InputError as error:
            problems += error.problems
    raise InputError(problems)


def _record_frame_changes(
    name: str, frames: Iterator[U8], footage: Footage, largest_change: LargestChange
) -> Iterator[U8]:
    """Yield the same frames, and add each to `largest_change`."""
    for before in footage.rgb:
        with refine.fusion.backend_errors("--refine", name):
            rgb = next(frames)
        largest_change.add(before, rgb)
        yield rgb


def _frames(
    footage: Footage,
    pictures: Iterator[U8],
    order: Sequence[int],
    faces: Mapping[int, float],
) -> Iterator[Frame]:
    """Yield pictures in playing order as frames of the clip."""
    for index, (sample, rgb) in enumerate(zip(order, pictures, strict=True)):
        load_ids = partial(footage.ids.__getitem__, sample)
        yield Frame(
            index, float(footage.trajectory.times[sample]), rgb, load_ids, faces=faces
        )
