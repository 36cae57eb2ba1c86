"""A scene's clip, unrefined -> kept in the cache -> refined by a video diffusion model, or left where that fails."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen.pipeline.filming import Filming
from physgen.pipeline.watch import Progress
from physgen.pipeline.writing import write_video
from physgen.problems import InputError, Problem, Warn
from physgen.registry import Choice, Plan

if TYPE_CHECKING:
    from physgen.export.video import Format
    from physgen.pipeline.footage import Footage
    from physgen.refine.denoiser import Denoiser
    from physgen.refine.fusion import RefineSettings
    from physgen.render.stage import Frame
    from physgen.report.record import RunRecord
    from physgen.report.refinement import RefinementChanges, RefinementStrip
    from physgen.scene.scene import Scene
    from physgen.simulate.trajectory import Trajectory


U8 = NDArray[np.uint8]
STRIP = "refinement.png"
"""What changed, as a picture, in the folder of the clip."""


class Refiners:
    """Models that refine, by the name of their backend: made when first asked for, kept for the next clip."""

    def __init__(self, plan: Callable[[], Plan] = Plan) -> None:
        """`plan` tells weights, device and options, and is asked when the first model is; its choice for `refine`
        counts where a scene names that backend.
        """
        self._ask = plan
        self._made: dict[str, Denoiser] = {}

    def model(self, name: str) -> Denoiser:
        """Raises InputError where its libraries or weights are not here."""
        from physgen import registry

        if name not in self._made:
            plan = self._ask()
            said = plan.choices.get("refine")
            choice = said if said is not None and said.name == name else Choice(name)
            setup = replace(plan, choices={"refine": choice}).setup("refine")
            self._made[name] = registry.make("refine", name, setup)
        return self._made[name]

    def close(self) -> None:
        """They go."""
        for model in self._made.values():
            model.close()
        self._made.clear()


@dataclass(frozen=True)
class Outcome:
    """How refinement went."""

    faults: Sequence[Problem]
    """What went wrong; nothing where it is empty."""
    retouched: RefinementStrip | None
    """What it changed, for the page."""


def refine_settings(scene: Scene) -> RefineSettings:
    """`refine:` of a scene, with the prompt that its labels make unless it has one."""
    from physgen.refine.denoiser import PromptSettings
    from physgen.refine.fusion import RefineSettings, hold_frames, prompt_of

    told = scene.refine
    prompt = prompt_of(item.label for item in scene.objects) if told.prompt is None else told.prompt
    return RefineSettings(
        strength=told.strength,
        stop=told.stop,
        steps=told.steps,
        seed=told.seed,
        said=PromptSettings(prompt, told.negative, told.guidance),
        lock=told.lock,
        detail=told.detail,
        hold=hold_frames(scene.render.fps),
    )


@contextmanager
def guidance_footage(
    filming: Filming,
    record: RunRecord,
    progress: Progress,
    warn: Warn,
    cached: bool = True,
    sound: Callable[[], bool] = lambda: True,
) -> Iterator[Footage]:
    """The clip as it is without refinement, a frame a sample, from the cache where it is kept; else it is made.

    It is kept for the next time where it is still `sound` then: nothing that it was made of was saved meanwhile.
    """
    from physgen.pipeline.cache import open_store
    from physgen.pipeline.cache_keys import guidance_key
    from physgen.pipeline.footage import Add, footage
    from physgen.render.staging import matte_coverage

    def film(add: Add) -> tuple[Trajectory, Mapping[str, Any]]:
        progress("simulate", 0, 1)
        trajectory = filming.simulated(progress, cached, warn)
        count = len(trajectory.times)
        frames = filming.frames(trajectory, range(count))
        mattes = filming.frames(trajectory, range(count), matte=True)
        for index in range(count):
            with record.stage("render"):
                frame = next(frames)
            with record.stage("cover"):
                covered = matte_coverage(next(mattes))
            with record.stage("keep"):
                add(frame.rgb, covered, frame.ids)
            progress("render", index + 1, count)
        return trajectory, {}

    key = guidance_key(filming.scene, record.inputs, record.device)
    with footage(open_store(warn=warn) if cached else None, key, film, sound) as kept:
        yield kept


def refine_footage(
    filming: Filming,
    footage: Footage,
    refiners: Refiners,
    folder: Path,
    kinds: Sequence[Format],
    record: RunRecord,
    progress: Progress,
) -> Outcome:
    """Writes the clip unrefined and, in all `kinds`, refined."""
    from physgen.maps import write_png
    from physgen.refine.fusion import Refinement, backend_errors
    from physgen.report.perception import compared
    from physgen.report.refinement import RefinementChanges, refinement_strip

    scene, trajectory = filming.scene, footage.trajectory
    order = filming.shot(trajectory).order

    def write(
        pictures: Iterator[U8], kinds: Sequence[Format], name: str, stage: str, doing: str = ""
    ) -> list[str]:
        frames = filming.annotated(_frames(footage, pictures, order), trajectory)
        count = len(order)
        return write_video(
            frames, count, scene, folder, kinds, record, progress, name=name, stage=stage, doing=doing
        )[0]

    record.unrefined = write(iter(footage.rgb.shown(order)), kinds[:1], "unrefined", "read")
    name = scene.refine.backend
    try:
        with record.stage("load model"), backend_errors("--refine", name):
            model = refiners.model(name)
        refinement = Refinement(model, refine_settings(scene), scene.video_size, len(footage.rgb), progress)
        step = float(trajectory.times[1] - trajectory.times[0]) if len(trajectory.times) > 1 else 1.0
        changes = RefinementChanges(len(footage.rgb), 1 / step)
        made = _watched(name, refinement.frames(footage.rgb, footage.coverage), footage, changes)
        with _played(made, order, scene.video_size, len(footage.rgb), folder, record) as pictures:
            record.frames = write(pictures, kinds, "video", "refine", "decode")
    except InputError as error:
        for kind in kinds:
            _removed(folder / kind.named("video"))
        record.frames = []
        record.refine = {"backend": name, "failed": "; ".join(map(str, error.problems))}
        return Outcome(error.problems, None)
    picture = changes.picture()
    write_png(folder / STRIP, picture)
    strip = {"file": STRIP, "size": [picture.shape[1], picture.shape[0]]}
    told = {"backend": name, **refinement.note(), "changes": changes.figures(), "strip": strip}
    record.refine = told
    before, after = ("as it was drawn", footage.rgb[changes.most]), ("refined", changes.refined)
    said = f"The frame that changed most, at {float(trajectory.times[changes.most]):.2f} s."
    return Outcome((), refinement_strip(compared("refined", "Refined", said, before, after), changes.columns))


def _watched(name: str, frames: Iterator[U8], footage: Footage, changes: RefinementChanges) -> Iterator[U8]:
    """The same frames; `changes` is told of each."""
    from physgen.refine.fusion import backend_errors

    for index in range(len(footage.rgb)):
        with backend_errors("--refine", name):
            rgb = next(frames)
        changes.add(footage.rgb[index], rgb, footage.coverage[index])
        yield rgb


def _frames(footage: Footage, pictures: Iterator[U8], order: Sequence[int]) -> Iterator[Frame]:
    """Pictures in the order of play as frames of the clip."""
    from physgen.render.stage import Frame

    for index, (sample, rgb) in enumerate(zip(order, pictures, strict=True)):
        named = partial(footage.ids.__getitem__, sample)
        yield Frame(index, float(footage.trajectory.times[sample]), rgb, named)


@contextmanager
def _played(
    frames: Iterator[U8],
    order: Sequence[int],
    size: tuple[int, int],
    count: int,
    folder: Path,
    record: RunRecord,
) -> Iterator[Iterator[U8]]:
    """Pictures of all samples, one after the other -> in the order of play; where they come again, from a file."""
    if list(order) == list(range(count)):
        yield frames
        return
    shape = (size[1], size[0], 3)
    with tempfile.TemporaryFile(dir=folder) as file:
        with record.stage("refine"):
            for rgb in frames:
                file.write(np.ascontiguousarray(rgb).data)

        def read(sample: int) -> U8:
            file.seek(sample * shape[0] * shape[1] * 3)
            return np.frombuffer(file.read(shape[0] * shape[1] * 3), np.uint8).reshape(shape)

        yield map(read, order)


def _removed(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
