"""Scene file to output folder: video, trajectory, report and manifest."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen.files import Stamp, file_stamp
from physgen.pipeline.filming import Filming
from physgen.pipeline.labels import Labels
from physgen.pipeline.options import Page, RenderOptions
from physgen.pipeline.packs import scene_file
from physgen.pipeline.refining import Refiners, guidance_footage, refine_footage
from physgen.pipeline.stages import chaos, drawn_by, lint, render
from physgen.pipeline.stages import fan as draw_fan
from physgen.pipeline.warm import Keep, Warm
from physgen.pipeline.watch import Progress, silent
from physgen.pipeline.writing import write_video
from physgen.problems import InputError, Place, Problem, Severity, Warn, ignore_warning

if TYPE_CHECKING:
    from physgen.compile.compile import Compiled
    from physgen.compile.world import World
    from physgen.export.video import Format
    from physgen.report.perception import Perception
    from physgen.report.record import RunRecord
    from physgen.report.refinement import RefinementStrip
    from physgen.report.uncertainty import UncertaintySection
    from physgen.scene.scene import Scene
    from physgen.simulate.trajectory import Trajectory
    from physgen.simulate.uncertainty import Ensemble
    from physgen.simulate.uncertainty_summary import ShadowSpread, Verdict


# ----------------------------------------------------------------------
# Scene + Compiled -> what the photo decides of the motion: draws of what is uncertain, and what is told of
# them.

TABLE = "fan.csv"
"""Of all draws, in a clip's folder."""


@dataclass(frozen=True)
class DrawsReport:
    """A fan, and what is told of it."""

    scene: Scene
    compiled: Compiled
    fan: Ensemble
    verdicts: list[Verdict]
    shadows: ShadowSpread | None

    def told(self) -> dict[str, Any]:
        """For the manifest."""
        from physgen.simulate.uncertainty_summary import headline

        return {
            "draws": len(self.fan.outcomes),
            "seed": self.fan.seed,
            "simulated": len(self.fan.whole),
            "verdict": headline(self.fan, self.verdicts),
            "objects": {verdict.name: verdict.as_dict() for verdict in self.verdicts},
            "light": None if self.shadows is None else self.shadows.as_dict(),
            "drawn": [
                {
                    "path": doubt.path,
                    "value": doubt.value,
                    "from": doubt.source.text,
                    "sure": doubt.source.sure,
                    "distribution": doubt.spread.name,
                    "alike": doubt.alike,
                }
                for doubt in self.fan.doubts
            ],
            "failures": [str(problem) for problem in self.fan.failures],
            "table": TABLE,
        }

    def save(self, folder: Path) -> None:
        """The table of all draws."""
        (folder / TABLE).write_text(self.fan.table(), encoding="utf-8")

    def section(self) -> UncertaintySection:
        """For the page."""
        from physgen.report.uncertainty import uncertainty_section

        return uncertainty_section(self.fan, self.verdicts, self.shadows, self.compiled.world)


def simulate_draws(
    scene: Scene,
    compiled: Compiled,
    count: int,
    seed: int,
    variant: str | None,
    progress: Progress,
    warn: Warn,
) -> DrawsReport | None:
    """`count` draws; None, and a warning, where nothing of the scene is uncertain."""
    from physgen.simulate.uncertainty import uncertain
    from physgen.simulate.uncertainty_summary import shadow_spread, verdicts

    if not uncertain(scene, variant):
        fix = 'say who guessed a number and how sure, as in from: {mass: "by eye 0.6"}; perceive does'
        what = "so every draw would be the same and none is made"
        warn(
            Problem(
                scene.place("objects"),
                "--fan",
                "nothing in the scene is uncertain,",
                what,
                fix,
                Severity.WARNING,
            )
        )
        return None
    made = draw_fan(scene, compiled, count, seed, variant, progress)
    return DrawsReport(scene, compiled, made, verdicts(made), shadow_spread(scene, made))


# ----------------------------------------------------------------------
# A clip that was made -> whether it is what it is taken for: its files as they were read, its energy
# accounted for.

UNBALANCED = 0.03
"""Part of the energy that flows above which a simulation is not to be trusted."""


def inputs_unchanged(
    scene: Scene, record: RunRecord, begun: int, stamps: Sequence[tuple[Path, Stamp]]
) -> bool:
    """Whether nothing that the clip was made of was written since: `begun`, ns since 1970, or maps were stamped."""
    home = scene.folder.resolve()
    times = [file_stamp(Path(os.path.normpath(home / name)))[:2] for name in record.inputs]
    same = all(file_stamp(file) == stamp for file, stamp in stamps)
    return same and all(max(pair) < begun for pair in times)


def energy_problem(scene: Scene, world: World, trajectory: Trajectory, record: RunRecord) -> Problem | None:
    """A simulation that is not to be trusted."""
    # a body's fall by a pixel is the least that counts: at rest, nothing flows
    weight = sum(body.mass for body in world.bodies) * float(np.hypot(*world.gravity))
    record.imbalance = trajectory.imbalance(weight)
    if record.imbalance <= UNBALANCED:
        return None
    fix = "raise world.steps_per_second, or look for masses far apart or joints that contradict each other"
    found = f"miss {record.imbalance:.0%} of what flows"
    return Problem(scene.place("world"), "world", "the books of energy", found, fix, Severity.WARNING)


# ----------------------------------------------------------------------
# Scene file -> output folder: video, trajectory, report and manifest, whole or not at all.

U8 = NDArray[np.uint8]


def render_scene(
    path: str | Path,
    out: str | Path = "out",
    options: RenderOptions | None = None,
    *,
    refiners: Refiners | None = None,
    warm: Warm | None = None,
    progress: Progress = silent,
    warn: Warn = ignore_warning,
    **changes: Any,
) -> Path:
    """Renders a scene to `out/<name>/`: video, trajectory, manifest and report, complete or not at all.

    `changes` are fields of RenderOptions, which replace those of `options`. `refiners` keep models from one scene to
    the next, and `warm` keeps what stages of the previous scene computed. Returns the folder. Raises InputError; where
    refinement fails, the folder exists all the same, with `unrefined.mp4`.
    """
    from physgen.report.films import size_warning
    from physgen.report.folders import atomic_folder, output_folder
    from physgen.report.perception import perception
    from physgen.report.record import RunRecord, inputs, source_of

    options = replace(options or RenderOptions(), **changes)
    variant, origin, page = options.variant, options.origin, options.page
    record = RunRecord(scene="", command=list(options.command) or ["physgen", "render", str(path)])
    record.overrides, record.variant, record.mark = list(options.overrides), variant, options.mark
    record.device = drawn_by(options.device)
    warm = warm or Warm(Keep.NOTHING)
    begun = time.time_ns()
    with record.stage("load"):
        shown = origin.path if origin else None
        scene = warm.load(path, options.overrides, variant, options.allow_outside, shown)
        scene = replace(scene, name=options.name or output_name(path, variant))
        maps = warm.maps(scene)
    final = output_folder(Path(out), scene.name)
    record.scene, record.document = scene.name, scene.document
    record.seeds = {"refine": scene.refine.seed}
    record.inputs = inputs(scene, scene_file(path), warm.hash)
    record.source = origin.source if origin else source_of(Path(path), final)
    record.video = {"size": list(scene.video_size), "fps": scene.render.fps}

    def odd(problem: Problem) -> None:
        warn(problem)
        record.warnings.append({**problem.as_dict(), "text": str(problem)})

    progress("compile", 0, 1)
    with record.stage("compile"):
        compiled = warm.compile(scene, maps)
        lints = lint(scene, compiled, maps.percepts)
    for problem in lints:
        odd(problem)
    with record.stage("report"):
        seen = perception(scene, compiled, maps.percepts) if page is Page.FULL else None
    filming = Filming(scene, compiled, maps, options.device, record, warm)
    labels = Labels.of(options.export, scene, maps.percepts)
    still_sound = partial(inputs_unchanged, scene, record, begun, maps.stamps)
    del maps
    kinds = tuple(options.formats)
    if options.export and not kinds:
        labels.check_kept(final)
    faults: Sequence[Problem] = ()
    retouched = None
    with ExitStack() as held:
        footage = None
        if scene.refine.backend != "none":
            footage = held.enter_context(
                guidance_footage(filming, record, progress, warn, options.cached, still_sound)
            )
            trajectory = footage.trajectory
        else:
            progress("simulate", 0, 1)
            trajectory = filming.simulated(progress, options.cached, warn)
        record.samples, record.effort = trajectory.sample_hashes(), asdict(trajectory.effort)
        if (lost := energy_problem(scene, compiled.world, trajectory, record)) is not None:
            odd(lost)
        if options.chaos:
            with record.stage("chaos"):
                record.chaos = chaos(compiled.world, progress).as_dict()
        spread = None
        if options.draws:
            record.seeds["fan"] = options.draw_seed
            with record.stage("fan"):
                spread = simulate_draws(
                    scene, compiled, options.draws, options.draw_seed, variant, progress, odd
                )
                record.fan = None if spread is None else spread.told()
        folder = held.enter_context(atomic_folder(final))
        truth = folder / "truth" if kinds else folder
        if footage is not None:
            outcome = refine_footage(
                filming, footage, refiners or Refiners(), folder, kinds, record, progress
            )
            faults, retouched, first = outcome.faults, outcome.retouched, footage.rgb[0]
            labels.of_frames(filming, trajectory, truth, record, progress)
            if faults and _is_refined(final):  # hours of work may be in it
                raise InputError([*faults, _left(final, "keeps the clip that was refined before")])
        else:
            count = len(filming.shot(trajectory).order)
            with labels.exported(filming, trajectory, truth, record) as tap:
                frames = filming.annotated(tap(filming.frames(trajectory)), trajectory)
                record.frames, first = write_video(frames, count, scene, folder, kinds, record, progress)
        with record.stage("report"):
            trajectory.save(folder / "trajectory.npz")
            if spread is not None:
                spread.save(folder)
            if kinds and page is not Page.NONE:
                decided = None if spread is None else spread.section()
                _report(
                    filming,
                    trajectory,
                    first,
                    record,
                    folder,
                    kinds,
                    page,
                    seen,
                    retouched,
                    options.single_file,
                    decided,
                )
        if not options.draws:
            _fan_goes(final, warn)
        if kinds:
            labels.tell_gone(final, warn)
        if not still_sound():
            record.mark = ""  # the next run makes it again: nobody knows which of the two was drawn
        write_manifest(record, folder)
    if options.single_file and page is not Page.NONE:
        large = size_warning(final / "report.html", "make the clip shorter or smaller")
        if large is not None:
            warn(large)
    if faults:
        raise InputError([*faults, _left(final, "has the clip without refinement")])
    return final


def _fan_goes(folder: Path, warn: Warn) -> None:
    """Tells of a fan that an earlier run left there, which nobody asked for now."""
    if not (folder / TABLE).is_file():
        return
    try:
        told = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        count = int(told["fan"]["draws"])
    except (OSError, ValueError, KeyError, TypeError):
        return
    what = f"had a fan of {count} draws, which was not asked for this time, and goes"
    fix = f"render with --fan {count} to have it again"
    warn(Problem(Place(str(folder)), "", "", what, fix, Severity.WARNING))


def _is_refined(folder: Path) -> bool:
    """Whether an earlier run left a refined clip there."""
    try:
        told = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        return bool(told["refine"] and told["frames"])
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _left(folder: Path, what: str) -> Problem:
    fix = "once that is mended, frames come from the cache: nothing is simulated twice"
    return Problem(Place(str(folder)), "", "", what, fix, Severity.WARNING)


def _report(
    filming: Filming,
    trajectory: Trajectory,
    first: U8,
    record: RunRecord,
    folder: Path,
    kinds: Sequence[Format],
    page: Page,
    seen: Perception | None,
    retouched: RefinementStrip | None,
    single_file: bool,
    decided: UncertaintySection | None,
) -> None:
    """The page; `first` is the clip's first frame, unrefined."""
    from physgen.report.films import embedded_film, linked_film
    from physgen.report.page import PageParts, report_page
    from physgen.report.perception import relighting_comparison
    from physgen.report.player import player_data
    from physgen.scene.write import scene_text

    name = "video" if record.frames else "unrefined"
    made = [kind.named(name) for kind in kinds if record.frames or kind is kinds[0]]
    scene, world = filming.scene, filming.compiled.world
    film = (
        embedded_film(folder, made, scene.render.fps, scene.name)
        if single_file
        else linked_film(folder, made)
    )
    text = scene_text(scene.document)
    if scene.render.overlay or not filming.shot(trajectory).opens_on_photo:
        first = next(
            render(filming.stage, trajectory)
        ).rgb  # outlines and forces are drawn on the photo itself
    player = None
    if page is Page.FULL:
        player = player_data(
            scene, world, trajectory, filming.stage, filming.shot(trajectory), filming.sampled
        )
    if seen is not None and (pair := relighting_comparison(filming.stage, trajectory)) is not None:
        seen = replace(seen, comparisons=(pair, *seen.comparisons))
    html = report_page(
        scene, world, record, first, film, text, PageParts(player, seen, retouched, decided)
    )
    (folder / "report.html").write_text(html, encoding="utf-8")


def write_manifest(record: RunRecord, folder: Path) -> None:
    """Of all that is in the folder now."""
    from physgen.report.record import file_hash, write_json

    for file in sorted(p for p in folder.rglob("*") if p.is_file()):
        name = file.relative_to(folder).as_posix()
        record.files[name], record.sizes[name] = file_hash(file), file.stat().st_size
    write_json(folder / "manifest.json", record.manifest())


def output_name(path: str | Path, variant: str | None) -> str:
    """Name of a clip's folder: the scene's, and the variant's behind it."""
    from physgen.scene.load import scene_name

    name = scene_name(Path(path))
    if not name.isprintable():
        fix = "rename the file: its name becomes that of a folder"
        raise InputError.of(repr(str(path)), "", "has characters in its name that cannot be shown", fix)
    return f"{name}-{variant}" if variant is not None else name
