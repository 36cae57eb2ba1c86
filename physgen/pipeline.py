"""The house on one page: one call a stage, top-down. Scene file -> output folder.

>>> from physgen import pipeline
>>> scene = pipeline.load("scenes/dominoes/scene.yaml")                     # doctest: +SKIP
>>> compiled = pipeline.compile(scene, pipeline.percepts(scene))            # doctest: +SKIP
>>> trajectory = pipeline.simulate(compiled.world)                          # doctest: +SKIP
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physgen.problems import InputError, Place, Problem, Severity

if TYPE_CHECKING:
    from physgen.compile.assemble import Compiled
    from physgen.compile.world import World
    from physgen.crew import Crew
    from physgen.percepts.maps import Percepts
    from physgen.render.shot import Shot
    from physgen.render.stage import Frame, Stage
    from physgen.report.video import Format
    from physgen.scene.model import Scene
    from physgen.simulate.chaos import Chaos
    from physgen.simulate.trajectory import Trajectory

UNBALANCED = 0.03
"""Part of the energy that flows above which a simulation is not to be trusted."""
MOST_POSES = 20_000_000
"""Samples times objects of one trajectory: about 2 GB."""

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, how much is done and how much there is."""


def silent(stage: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


Warn = Callable[[Problem], None]
"""Told of everything that is allowed and probably not meant."""


Keep = Callable[[Path], None]
"""Told of every file that stood in the way and was kept under another name."""


def unheard(problem: Problem) -> None:
    """Warnings that nobody reads."""


def perceive(
    image: Path,
    output: Path | None = None,
    *,
    masks: Path | None = None,
    coco: Path | None = None,
    boxes: Sequence[tuple[float, float, float, float]] = (),
    points: Sequence[tuple[float, float]] = (),
    labels: Sequence[str] = (),
    assets: Path | None = None,
    crew: Crew | None = None,
    asked: Sequence[str] = (),
    side: int | None = None,
    sheet: Path | None = None,
    progress: Progress = silent,
    warn: Warn = unheard,
    keep: Keep = lambda kept: None,
) -> str:
    """Photo -> the scene's text; assets, and the scene where `output` is given, are written. Raises InputError.

    Objects come from `masks` (a label map), `coco` (annotations), `boxes` (x, y, w, h px) and `points` (x, y px), or
    from the segment backend, told to find `asked`. `labels` are `NAME=TEXT`. `crew` fills the roles, the offline one
    unless given; it may serve photo after photo. A photo whose longer side is over `side` px (1600 unless given)
    is made smaller, and `warn` told; masks, boxes and points are those of the photo as given. All that was perceived is
    drawn on one `sheet`, a PNG. `keep` is told of files that stood in the way and were kept.
    """
    from physgen.crew import Crew
    from physgen.perceive.asking import segmenter
    from physgen.perceive.given import from_masks, from_prompts, weak
    from physgen.perceive.import_coco import coco_objects, read_coco
    from physgen.perceive.lay_out import lay_out
    from physgen.perceive.scene import perceive as run
    from physgen.perceive.smaller import LONGEST_SIDE, fitted, smaller
    from physgen.percepts.maps import read_labels
    from physgen.percepts.photo import read_photo
    from physgen.report.perceived import check_sheet, write_sheet

    crew = crew or Crew()
    crew.begin(warn)
    check_sheet(sheet, image)
    if sum((masks is not None, coco is not None, bool(boxes or points))) > 1:
        fix = "choose --masks, --coco, or --box and --point"
        raise InputError.of("perceive", "", "was told in more than one way where the objects are", fix)
    photo = read_photo(image)
    if not photo.readable:
        fix = "save it as sRGB if its colours look wrong"
        warn(Problem(Place(str(image)), "", "the colour profile", "cannot be used", fix, Severity.WARNING))
    rgb = smaller(photo.rgb, side or LONGEST_SIDE)
    height, width = photo.rgb.shape[:2]
    as_it_is = photo.plain and rgb is photo.rgb
    if rgb is not photo.rgb:
        was, now = f"{width} x {height} px", f"{rgb.shape[1]} x {rgb.shape[0]} px"
        fix = f"--side {max(width, height)} keeps its size"
        warn(Problem(Place(str(image)), "", f"the photo of {was}", f"was made {now}", fix, Severity.WARNING))
    del photo  # a large one is larger than all that comes of it
    found = None
    if masks is not None:
        found = from_masks(read_labels(masks))
    elif coco is not None:
        found = coco_objects(coco, read_coco(coco, image), (width, height))
    elif boxes or points:
        x, y = rgb.shape[1] / width, rgb.shape[0] / height
        boxes = [(box[0] * x, box[1] * y, box[2] * x, box[3] * y) for box in boxes]
        points = [(point[0] * x, point[1] * y) for point in points]
        found = from_prompts(rgb, boxes, points, segmenter(crew, asked))
        crew.release("segment")
        for problem in weak(found):
            warn(problem)
    if asked and (masks or coco or "categories" not in crew.row("segment").uses):
        fix = "choose e.g. --backend segment=grounding-dino+sam"
        expected = "is not heard: nothing here finds what it is told to"
        warn(Problem(Place("--find"), "", f'"{", ".join(asked)}"', expected, fix, Severity.WARNING))
    if "categories" in crew.plan.choices and "categories" not in crew.row("segment").uses:
        fix = "choose e.g. --backend segment=grounding-dino+sam, or leave it out"
        found_by = f"categories={crew.plan.choices['categories']}"
        expected = f"is not asked: segment={crew.name('segment')} finds things without"
        warn(Problem(Place("--backend"), "", found_by, expected, fix, Severity.WARNING))
    if found is not None:
        found = fitted(found, (width, height), rgb)
    perceived = run(rgb, found, renames=labels, crew=crew, asked=asked, progress=progress)
    for problem in perceived.warnings:
        warn(problem)
    if sheet is not None:
        write_sheet(sheet, perceived, keep)
    return lay_out(perceived, image if as_it_is else None, image.stem, output, assets, keep)


def import_physgen(
    folder: Path,
    output: Path | None = None,
    progress: Progress = silent,
    warn: Warn = unheard,
    keep: Keep = lambda kept: None,
) -> str:
    """A folder of the paper's public code -> the scene's text; writes as `perceive` does."""
    from physgen.perceive.import_physgen import import_physgen as run
    from physgen.perceive.lay_out import lay_out

    imported = run(folder, progress=progress)
    for problem in imported.warnings:
        warn(problem)
    assets = None if output else Path(f"{folder.resolve().name}.assets")
    return lay_out(imported, folder / "original.png", "original", output, assets, keep)


def import_coco(
    file: Path,
    image: Path | None = None,
    output: Path | None = None,
    progress: Progress = silent,
    keep: Keep = lambda kept: None,
) -> str:
    """One photo of a COCO file -> the scene's text; writes as `perceive` does."""
    from physgen.perceive.import_coco import read_coco

    return perceive(image or read_coco(file).file, output, coco=file, progress=progress, keep=keep)


def load(
    path: str | Path, overrides: Sequence[str] = (), variant: str | None = None, allow_outside: bool = False
) -> Scene:
    """Scene file -> Scene, with overlays applied and defaults filled in. Raises InputError with every problem."""
    from physgen.scene.build import load as load_scene

    return load_scene(Path(path), overrides, variant, allow_outside)


def percepts(scene: Scene) -> Percepts | None:
    """The photo and its maps; None for a scene without a photo."""
    from physgen.percepts.maps import read_percepts

    return read_percepts(scene.image, scene.assets, scene.maps)


def compile(scene: Scene, maps: Percepts | None) -> Compiled:
    """Outlines, centres, masses, moments and pairs, resolved."""
    from physgen.compile.assemble import compile_scene

    return compile_scene(scene, None if maps is None else maps.labels)


def lint(scene: Scene, compiled: Compiled) -> list[Problem]:
    """What is allowed and probably not meant."""
    from physgen.compile.lints import lint as lint_scene

    return lint_scene(scene, compiled)


def simulate(world: World, rate: float | None = None, progress: Progress = silent) -> Trajectory:
    """Motion at the video's frame times, or from t = 0 to the end at `rate` samples a second."""
    from physgen.simulate.engine import simulate as run

    if rate is None:
        return run(world, progress=progress)
    count = int(world.duration * rate + 1e-9) + 1
    if count * max(len(world.bodies), 1) > MOST_POSES:
        found = f"{count:,} samples of {len(world.bodies)} objects"
        raise InputError.of(
            "--rate", found, "are too many to hold", f"keep samples x objects below {MOST_POSES:,}"
        )
    return run(world, np.arange(count) / rate, progress)


def chaos(world: World, progress: Progress = silent) -> Chaos:
    """How long the motion can be foretold: the world run again a hair apart, with half the step, other sweeps."""
    from physgen.simulate.chaos import chaos as compare

    return compare(world, progress)


def stage(scene: Scene, compiled: Compiled, maps: Percepts | None) -> Stage:
    """What is drawn: the filled background and the objects cut out of the photo, or flat shapes on paper.

    Flat shapes are drawn as large as `render` shows them at most.
    """
    from physgen.render.flat import enlarged, flat_background, flat_sprites
    from physgen.render.shot import drawn_large
    from physgen.render.sprites import cut_sprites
    from physgen.render.stage import Stage
    from physgen.render.staging import staged
    from physgen.render.threads import one_thread

    order = sorted(range(len(scene.objects)), key=lambda k: scene.objects[k].layer)
    fine = scene.render.supersample
    if maps is None:
        large = drawn_large(scene)
        world, outlines = enlarged(compiled.world, compiled.outlines, large)
        sprites = flat_sprites(world, outlines, order, large)
        return Stage(flat_background(world, large), sprites, supersample=fine, scale=large)
    coverage, background = filled(maps, compiled.labels, compiled.scenery)
    absent = (maps.labels > 0) & (compiled.labels == 0) & ~compiled.scenery
    with one_thread():
        sprites = cut_sprites(maps.rgb, compiled.labels, absent, coverage, background, order)
        made = staged(scene, compiled.world, sprites, maps, background, coverage, absent)
    return replace(made, supersample=fine)


def filled(
    maps: Percepts, labels: NDArray[np.uint16], scenery: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Coverage and background as stored; made now where the assets lack them or know less than the scene's masks.

    They are also made now where the assets took a boundary, whose pixels are `scenery`, for an object.
    """
    from physgen.render.sprites import covers_scenery

    new = bool(((labels > 0) & (maps.labels == 0)).any())
    new |= maps.coverage is not None and covers_scenery(maps.coverage, labels, scenery)
    if maps.coverage is not None and maps.background is not None and not new:
        return maps.coverage, maps.background
    from physgen import backends

    union = np.where(labels > 0, labels, np.where(scenery, np.uint16(0), maps.labels))
    coverage = maps.coverage
    if coverage is None or new:
        coverage = backends.make("matte")(maps.rgb, union)
    return coverage, backends.make("inpaint")(maps.rgb, coverage > 0)


def shot(scene: Scene, trajectory: Trajectory) -> Shot:
    """How the scene's clip is filmed and played; `trajectory` has one sample a frame."""
    from physgen.render.shot import shot as take

    return take(scene, trajectory)


def render(
    drawn: Stage,
    trajectory: Trajectory,
    parts: int = 1,
    through: Shot | None = None,
    device: str = "cpu",
) -> Iterator[Frame]:
    """Frames, one at a time; each the mean of `parts` samples, in linear light.

    `through` is a shot: without one, all of the canvas is seen and played forward. On a `device` other than the
    processor (`cuda`, `cuda:1`) torch draws them, the same within 1 grey level.
    """
    from physgen.render.shot import filmed
    from physgen.render.shutter import exposed

    if device == "cpu":
        from physgen.render.frames import render_frames
    else:
        from physgen.render.backends.torch_frames import render_frames_torch

        render_frames = partial(render_frames_torch, device=device)
    if through is None:
        return render_frames(drawn, trajectory, parts=parts)
    samples = through.samples(parts)
    if parts > 1 and through.moves:  # while the shutter is open, too: what the camera follows stays sharp
        return exposed(filmed(render_frames(drawn, trajectory, samples), through, drawn.scale), parts)
    return filmed(render_frames(drawn, trajectory, samples, parts), through, drawn.scale)


def drawn_by(device: str) -> str:
    """What draws frames on `device`, for the manifest. Raises InputError where it, or torch, is not there."""
    if device == "cpu":
        return device
    try:
        from physgen.render.backends.torch_frames import title
    except ModuleNotFoundError as error:
        found, fix = f"needs {error.name}, which is not installed", 'pip install "physgen[models]"'
        raise InputError.of("--device", f'"{device}"', found, fix) from error
    return title(device)


def render_scene(
    path: str | Path,
    out: str | Path = "out",
    *,
    overrides: Sequence[str] = (),
    variant: str | None = None,
    allow_outside: bool = False,
    formats: Sequence[Format] | None = None,
    command: Sequence[str] = (),
    ask_chaos: bool = False,
    device: str = "cpu",
    progress: Progress = silent,
    warn: Warn = unheard,
) -> Path:
    """The whole line: `out/<scene>/` with video, trajectory, manifest and report, whole or not at all; returns it.

    `ask_chaos` runs the scene's neighbours too, for the report; `device` is that of `render`. Raises InputError.
    """
    from physgen.render.shutter import shutter
    from physgen.report.folder import output_folder, whole_folder
    from physgen.report.page import report_page
    from physgen.report.player import player_data
    from physgen.report.record import RunRecord, file_hash, frame_hash, inputs, write_json
    from physgen.report.video import Format, alongside, open_video
    from physgen.scene.write import scene_text
    from physgen.simulate.engine import simulate as run_at

    record = RunRecord(scene="", command=list(command) or ["physgen", "render", str(path)])
    record.overrides, record.variant = list(overrides), variant
    record.device = drawn_by(device)
    with record.stage("load"):
        scene = load(path, overrides, variant, allow_outside)
        scene = replace(scene, name=output_name(path, variant))
        maps = percepts(scene)
    final = output_folder(Path(out), scene.name)
    record.scene, record.document = scene.name, scene.document
    record.seeds = {"refine": scene.refine.seed}
    record.inputs = inputs(scene, Path(path))
    progress("compile", 0, 1)
    with record.stage("compile"):
        compiled = compile(scene, maps)
        lints = lint(scene, compiled)
    for problem in lints:
        warn(problem)
    record.warnings = [{**problem.as_dict(), "text": str(problem)} for problem in lints]
    progress("simulate", 0, 1)
    with record.stage("simulate"):
        trajectory = simulate(compiled.world, progress=progress)
    record.samples, record.effort = trajectory.sample_hashes(), asdict(trajectory.effort)
    # a body's fall by a pixel is the least that counts: at rest, nothing flows
    weight = sum(body.mass for body in compiled.world.bodies) * float(np.hypot(*compiled.world.gravity))
    record.imbalance = trajectory.imbalance(weight)
    if record.imbalance > UNBALANCED:
        fix = (
            "raise world.steps_per_second, or look for masses far apart or joints that contradict each other"
        )
        found = f"miss {record.imbalance:.0%} of what flows"
        problem = Problem(scene.place("world"), "world", "the books of energy", found, fix, Severity.WARNING)
        lints.append(problem)
        warn(problem)
        record.warnings.append({**problem.as_dict(), "text": str(problem)})
    if ask_chaos:
        with record.stage("chaos"):
            record.chaos = chaos(compiled.world, progress).as_dict()
    with record.stage("cut out"):
        drawn = stage(scene, compiled, maps)
    del maps
    take = shot(scene, trajectory)
    record.video = {"size": list(take.video), "fps": scene.render.fps}
    # the engine's steps do not depend on its samples: the fine run is the same motion
    moments, parts = shutter(trajectory, compiled.world, scene.render.motion_blur)
    fine = trajectory
    if parts > 1:
        with record.stage("expose"):
            fine = run_at(compiled.world, moments)
    kinds = tuple(formats) if formats else (Format.MP4,)
    with whole_folder(final) as folder:
        started = time.process_time()
        with ExitStack() as files:
            with record.stage("encode"):
                writers = [
                    files.enter_context(open_video(folder, k, take.video, scene.render.fps)) for k in kinds
                ]
            frames = render(drawn, fine, parts, take, device)
            if scene.render.overlay:
                from physgen.render.overlay import annotated

                frames = annotated(
                    frames,
                    compiled.world,
                    trajectory,
                    scene.render.overlay,
                    lambda frame: take.affine(frame.time),
                )
            with alongside(writers) as write:
                for index in range(len(take.order)):
                    with record.stage("render", time.thread_time):
                        frame = next(frames)
                        record.frames.append(frame_hash(frame.rgb))
                    if index == 0:
                        first = frame.rgb.copy()  # it may be one of a batch
                    with record.stage("encode"):
                        write(frame.rgb)
                    progress("render", index + 1, len(take.order))
            with record.stage("encode"):
                files.close()
        # the encoder's own threads run on while frames are rendered: its share is what rendering did not take
        record.stages["encode"].cpu = time.process_time() - started - record.stages["render"].cpu
        with record.stage("report"):
            trajectory.save(folder / "trajectory.npz")
            video = next((kind.file for kind in kinds if kind is not Format.PNG), "frames/00000.png")
            text = scene_text(scene.document)
            if (
                scene.render.overlay or not take.opens_on_photo
            ):  # outlines and forces are drawn on the photo itself
                first = next(render(drawn, trajectory)).rgb
            beside = video if video == Format.MP4.file else None
            player = player_data(scene, compiled.world, trajectory, drawn, take, beside)
            page = report_page(scene, compiled.world, record, first, video, text, player)
            (folder / "report.html").write_text(page, encoding="utf-8")
        for file in sorted(p for p in folder.rglob("*") if p.is_file()):
            record.files[file.relative_to(folder).as_posix()] = file_hash(file)
        write_json(folder / "manifest.json", record.manifest())
    return final


def output_name(path: str | Path, variant: str | None) -> str:
    """Name of a clip's folder: the scene's, and the variant's behind it."""
    from physgen.scene.build import scene_name

    name = scene_name(Path(path))
    if not name.isprintable():
        fix = "rename the file: its name becomes that of a folder"
        raise InputError.of(repr(str(path)), "", "has characters in its name that cannot be shown", fix)
    return f"{name}-{variant}" if variant is not None else name
