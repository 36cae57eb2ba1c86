"""A photo, or somebody else's files -> the scene's text, and its assets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.pipeline.watch import Keep, Progress, silent
from physgen.problems import InputError, Place, Problem, Severity, Warn, ignore_warning

if TYPE_CHECKING:
    from physgen.registry import Backends


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
    crew: Backends | None = None,
    asked: Sequence[str] = (),
    side: int | None = None,
    sheet: Path | None = None,
    progress: Progress = silent,
    warn: Warn = ignore_warning,
    keep: Keep = lambda kept: None,
) -> str:
    """Photo -> the scene's text; assets, and the scene where `output` is given, are written. Raises InputError.

    Objects come from `masks` (a label map), `coco` (annotations), `boxes` (x, y, w, h px) and `points` (x, y px), or
    from the segment backend, told to find `asked`. `labels` are `NAME=TEXT`. `crew` fills the roles, the offline one
    unless given; it may serve photo after photo. A photo whose longer side is over `side` px (1600 unless given)
    is made smaller, and `warn` told; masks, boxes and points are those of the photo as given. All that was perceived is
    drawn on one `sheet`, a PNG. `keep` is told of files that stood in the way and were kept.
    """
    from physgen.maps import read_labels
    from physgen.perceive.document import write_scene
    from physgen.perceive.import_coco import coco_objects, read_coco
    from physgen.perceive.perceive import LONGEST_SIDE, shrink_detections, shrink_photo
    from physgen.perceive.perceive import perceive as run
    from physgen.perceive.segment.prompts import from_masks, from_prompts, segmenter, weak_prompts
    from physgen.photos import read_photo
    from physgen.registry import Backends
    from physgen.report.perception import check_sheet, write_sheet

    crew = crew or Backends()
    crew.begin(warn)
    check_sheet(sheet, image)
    if sum((masks is not None, coco is not None, bool(boxes or points))) > 1:
        fix = "choose --masks, --coco, or --box and --point"
        raise InputError.of("perceive", "", "was told in more than one way where the objects are", fix)
    photo = read_photo(image)
    if not photo.readable:
        fix = "save it as sRGB if its colours look wrong"
        warn(Problem(Place(str(image)), "", "the colour profile", "cannot be used", fix, Severity.WARNING))
    rgb = shrink_photo(photo.rgb, side or LONGEST_SIDE)
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
        for problem in weak_prompts(found):
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
        found = shrink_detections(found, (width, height), rgb)
    perceived = run(rgb, found, renames=labels, crew=crew, asked=asked, progress=progress)
    for problem in perceived.warnings:
        warn(problem)
    if sheet is not None:
        write_sheet(sheet, perceived, keep)
    return write_scene(perceived, image if as_it_is else None, image.stem, output, assets, keep)


def import_physgen(
    folder: Path,
    output: Path | None = None,
    progress: Progress = silent,
    warn: Warn = ignore_warning,
    keep: Keep = lambda kept: None,
) -> str:
    """A folder of the paper's public code -> the scene's text; writes as `perceive` does."""
    from physgen.perceive.document import write_scene
    from physgen.perceive.import_physgen import import_physgen as run

    imported = run(folder, progress=progress)
    for problem in imported.warnings:
        warn(problem)
    assets = None if output else Path(f"{folder.resolve().name}.assets")
    return write_scene(imported, folder / "original.png", "original", output, assets, keep)


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
