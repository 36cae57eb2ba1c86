"""Refinement of a scene's clip by a video diffusion model, which looks at all frames together."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from physgen.export.video import U8
from physgen.pipeline.stages import Film
from physgen.problems import InputError, Problem
from physgen.progress import Progress
from physgen.registry import Choice, Plan

if TYPE_CHECKING:
    from physgen.maps import F32, U16
    from physgen.pipeline.writing import VideoFiles
    from physgen.refine.denoiser import Denoiser
    from physgen.refine.fusion import RefineSettings
    from physgen.render.stage import Frame
    from physgen.report.perception import Comparison
    from physgen.report.record import RunRecord
    from physgen.scene.scene import Scene
    from physgen.simulate.trajectory import Trajectory


@dataclass(frozen=True)
class Footage:
    """A clip before it is refined, one frame a sample of its trajectory."""

    trajectory: Trajectory
    rgb: list[U8] = field(default_factory=list)
    """(H, W, 3) sRGB each."""
    coverage: list[F32] = field(default_factory=list)
    """(H, W) each, of objects: 0..1."""
    ids: list[U16] = field(default_factory=list)
    """(H, W) each: body k shows as k + 1, 0 = background."""


class MostChanged:
    """The frame that refinement changed most, of frames as they come."""

    def __init__(self) -> None:
        self.index = 0
        self.refined: U8 = np.zeros((0, 0, 3), np.uint8)
        """(H, W, 3) sRGB: that frame after refinement."""
        self._seen, self._largest = 0, -1.0

    def add(self, guidance: U8, refined: U8) -> None:
        """The next frame, (H, W, 3) sRGB, before and after."""
        change = float(np.abs(np.subtract(refined, guidance, dtype=np.int16)).mean())
        if change > self._largest:
            self._largest, self.index, self.refined = change, self._seen, refined.copy()
        self._seen += 1


class Refiners:
    """Refinement models by the name of their backend: loaded when first needed, kept for the next clip."""

    def __init__(self, plan: Callable[[], Plan] = Plan) -> None:
        """`plan` returns weights, device and options; its choice for `refine` holds for scenes with that backend."""
        self._plan = plan
        self._models: dict[str, Denoiser] = {}

    def model(self, name: str) -> Denoiser:
        """Raises InputError where its libraries or weights are missing."""
        from physgen import registry

        if name not in self._models:
            plan = self._plan()
            chosen = plan.choices.get("refine")
            choice = (
                chosen if chosen is not None and chosen.name == name else Choice(name)
            )
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
    """Why it failed; empty where it did not."""
    changed: Comparison | None
    """The frame that changed most, before and after."""


def refine_settings(scene: Scene) -> RefineSettings:
    """`refine:` of a scene, with a prompt made of its labels unless it has one."""
    from physgen.refine.denoiser import PromptSettings
    from physgen.refine.fusion import RefineSettings, hold_frames, prompt_of

    given = scene.refine
    prompt = (
        prompt_of(item.label for item in scene.objects)
        if given.prompt is None
        else given.prompt
    )
    return RefineSettings(
        strength=given.strength,
        stop=given.stop,
        steps=given.steps,
        seed=given.seed,
        prompt=PromptSettings(prompt, given.negative, given.guidance),
        lock=given.lock,
        detail=given.detail,
        hold=hold_frames(scene.render.fps),
    )


def guidance_footage(film: Film, record: RunRecord, progress: Progress) -> Footage:
    """The clip without refinement, a frame a sample."""
    from physgen.render.staging import matte_coverage

    progress("simulate", 0, 1)
    kept = Footage(film.simulated(progress))
    count = len(kept.trajectory.times)
    frames = film.frames(kept.trajectory, range(count))
    mattes = film.frames(kept.trajectory, range(count), matte=True)
    for index in range(count):
        with record.stage("render"):
            frame = next(frames)
            kept.rgb.append(frame.rgb.copy())  # it may be part of a batch
            kept.ids.append(frame.ids.copy())
        with record.stage("cover"):
            kept.coverage.append(matte_coverage(next(mattes)))
        progress("render", index + 1, count)
    return kept


def refine_footage(
    film: Film, kept: Footage, refiners: Refiners, files: VideoFiles
) -> Outcome:
    """Write the clip unrefined and, in all formats, refined."""
    from physgen.refine.fusion import Refinement, backend_errors
    from physgen.report.perception import compare_frames

    scene, trajectory, record = film.scene, kept.trajectory, files.record
    order, count = film.shot(trajectory).order, len(kept.rgb)

    def clip(pictures: Iterator[U8]) -> Iterator[Frame]:
        return film.annotated(
            _frames(kept, pictures, order, film.stage.faces), trajectory
        )

    def shown() -> Iterator[Frame]:
        return clip(kept.rgb[sample] for sample in order)

    record.unrefined = _write_unrefined(files, shown, len(order))
    name = scene.refine.backend
    try:
        with record.stage("load model"), backend_errors("--refine", name):
            model = refiners.model(name)
        refinement = Refinement(
            model, refine_settings(scene), scene.video_size, count, files.progress
        )
        changed = MostChanged()
        made = _measured(
            name, refinement.frames(kept.rgb, kept.coverage), kept, changed
        )
        if list(order) != list(range(count)):
            with record.stage("refine"):
                pictures = [rgb.copy() for rgb in made]
            made = map(pictures.__getitem__, order)
        record.frames = files.write(
            clip(made), len(order), "video", "refine", "decode"
        )[0]
    except InputError as error:
        for kind in files.formats:
            path = files.folder / kind.file_name("video")
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        record.frames = []
        record.refine = {"backend": name, "failed": "; ".join(map(str, error.problems))}
        return Outcome(error.problems, None)
    record.refine = {"backend": name, **refinement.note()}
    before, after = (
        ("as it was drawn", kept.rgb[changed.index]),
        ("refined", changed.refined),
    )
    caption = f"The frame that changed most, at {float(trajectory.times[changed.index]):.2f} s."
    return Outcome((), compare_frames("refined", "Refined", caption, before, after))


def _write_unrefined(
    files: VideoFiles, frames: Callable[[], Iterator[Frame]], count: int
) -> list[str]:
    """Write the unrefined clip in the first format that can be written; returns the hashes of its frames."""
    problems: list[Problem] = []
    for kind in files.formats:
        single = replace(files, formats=[kind])
        try:
            return single.write(frames(), count, "unrefined", "read")[0]
        except InputError as error:
            problems += error.problems
    raise InputError(problems)


def _measured(
    name: str, frames: Iterator[U8], kept: Footage, changed: MostChanged
) -> Iterator[U8]:
    """The same frames, added to `changed`."""
    from physgen.refine.fusion import backend_errors

    for before in kept.rgb:
        with backend_errors("--refine", name):
            rgb = next(frames)
        changed.add(before, rgb)
        yield rgb


def _frames(
    kept: Footage,
    pictures: Iterator[U8],
    order: Sequence[int],
    faces: Mapping[int, float],
) -> Iterator[Frame]:
    """Pictures in playing order as frames of the clip."""
    from physgen.render.stage import Frame

    for index, (sample, rgb) in enumerate(zip(order, pictures, strict=True)):
        named = partial(kept.ids.__getitem__, sample)
        yield Frame(
            index, float(kept.trajectory.times[sample]), rgb, named, faces=faces
        )
