"""Perception as a whole: from a photo, a folder of the paper's code, or an older scene
to a scene's text and its assets.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physgen.files import check_text_names, check_writable
from physgen.messages import Message
from physgen.pipeline.first_motion import (
    StoryRequest,
    push_anew,
    refresh_motion,
    start_motion,
    with_slow_motion_comment,
)
from physgen.pipeline.trial_scenes import open_trial
from physgen.problems import InputError, Place, Problem, Severity, Warn, ignore_warning
from physgen.progress import Progress, silent
from physgen.scene.files import OVERVIEW
from physgen.scene.saving import named_assets
from physgen.text import listed

if TYPE_CHECKING:
    from physgen.perceive.refresh import PromptFrames
    from physgen.perceive.roles import BoundaryGuess, Description, PerceivedScene
    from physgen.registry import Backends
    from physgen.scene.load import OpenedScene
    from physgen.scene.scene import Scene

Keep = Callable[[Path], None]
"""Callback with the new name of every file renamed to make room."""


@dataclass(frozen=True)
class PerceiveOptions:
    """Choices of a caller about perception."""

    masks: Path | None = None
    """A label map of the objects."""
    boxes: Sequence[tuple[float, float, float, float]] = ()
    """Boxes of objects, x, y, w, h px, in the upright photo of the file."""
    points: Sequence[tuple[float, float]] = ()
    """Points on objects, x, y px, in the same photo."""
    smallest: bool = False
    """Whether a point selects the smallest object there, not the whole one."""
    labels: Sequence[str] = ()
    """`NAME=TEXT` texts: labels of objects."""
    asked: Sequence[str] = ()
    """Nouns of objects for the segment backend to find."""
    side: int | None = None
    """Longest side of the photo, px, above which it is made smaller; None: the
    default.
    """
    still: bool = False
    """Whether the scene gets no push."""
    allow_outside: bool = False
    """Whether a refreshed scene may read files outside its folder."""
    pushes: Sequence[str] = ()
    """`NAME=DIRECTION[@SPEED]` texts, in place of the automatic push."""
    story: str | None = None
    """A sentence about the motion, in place of the automatic push."""
    view: str | None = None
    """`side` or `top`; None: perception decides."""
    makes_cache: bool = False
    """Whether the assets get a cache for `render`."""


def perceive(
    image: Path,
    output: Path | None = None,
    *,
    crew: Backends | None = None,
    progress: Progress = silent,
    warn: Warn = ignore_warning,
    keep: Keep = lambda kept: None,
    inform: Callable[[str], None] = lambda line: None,
    stdout: Path | None = None,
    **given: Any,
) -> str:
    """Convert a photo to the text of a scene, and write the assets. Raises InputError.

    The scene itself is written only if `output` is given. `stdout` is the file to which
    the caller writes the text: without `output`, the assets go beside it.

    Objects come from `masks`, `boxes` and `points`, or else from the segment backend.
    `crew` fills the roles; by default, these are the offline backends. `given` are
    fields of PerceiveOptions. `inform` is called with a summary of several lines, of
    which the first contains the photo's suitability.
    """
    from physgen.perceive.scene_files import write_scene
    from physgen.registry import Backends

    options = PerceiveOptions(**given)
    crew = crew or Backends()
    crew.begin()
    if options.masks is not None and (options.boxes or options.points):
        raise Message.OBJECTS_GIVEN_TWICE.error("perceive")
    check_text_names(image, output)
    check_writable((output or stdout or Path()).parent)
    photo = _perceive_photo(image, options, crew, progress, warn)
    perceived = photo.perceived
    description = _description(perceived)
    text = write_scene(
        replace(perceived, description=description),
        image if photo.is_nameable else None,
        image.stem,
        output,
        keep,
        stdout=stdout,
    )
    if options.makes_cache:
        from physgen.pipeline.asset_cache import make_cache

        make_cache(perceived.percepts, text, output or stdout)
    # The reader of the summary may have closed the pipe: inform at the very end.
    lines = [*description.summary, *_overview_lines(text, output or stdout)]
    inform(f"{image}: " + "\n".join(lines))
    return text


def _description(perceived: PerceivedScene) -> Description:
    """Return the overview and the summary of a perceived photo."""
    from physgen.perceive.roles import Description
    from physgen.perceive.summary import summary
    from physgen.report.overview import overview_png

    velocities: dict[str, Sequence[float]] = {}
    # A problem of the scene is reported when the scene is rendered.
    with suppress(InputError):
        for item in open_trial(perceived, "velocity").scene().objects:
            velocities[item.name] = item.velocity
    rgb, labels = perceived.percepts.rgb, perceived.percepts.labels
    overview = overview_png(rgb, labels, perceived.document, velocities)
    return Description(overview, summary(perceived))


def _overview_lines(text: str, target: Path | None) -> list[str]:
    """Return the line of the summary with the path of the overview."""
    folder = Path() if target is None else target.parent
    assets = named_assets(text.encode("utf-8"), folder)
    if assets is None or not (assets / OVERVIEW).is_file():
        return []
    return [f"  picture   {assets / OVERVIEW}"]


@dataclass(frozen=True)
class _PerceivedPhoto:
    """The scene of a photo, set in motion, and the way in which it can refer to the
    file.
    """

    perceived: PerceivedScene
    is_nameable: bool
    """Whether the file has exactly the pixels of the scene."""


def _perceive_photo(
    image: Path,
    options: PerceiveOptions,
    crew: Backends,
    progress: Progress,
    warn: Warn,
) -> _PerceivedPhoto:
    """Perceive a photo and set its objects in motion. Raises InputError."""
    from physgen.maps import read_object_masks
    from physgen.perceive import perceive as perception
    from physgen.perceive.photo_size import (
        LONGEST_SIDE,
        check_size,
        shrink_detections,
        shrink_photo,
    )
    from physgen.perceive.segment.prompts import (
        PromptFrame,
        Segmenter,
        check_prompts,
        from_masks,
        from_prompts,
    )
    from physgen.photos import read_photo

    masks, boxes, points = options.masks, options.boxes, options.points
    photo = read_photo(image)
    place = Place(str(image))
    if not photo.readable:
        warn(Message.PROFILE_UNUSABLE.warning(place, "", "the colour profile"))
    rgb = shrink_photo(photo.rgb, options.side or LONGEST_SIDE)
    check_size(rgb, str(image))
    labels = None
    if masks is not None:
        labels = read_object_masks(masks)
        _check_masks(masks, labels.shape, image, (photo.rgb.shape[:2], rgb.shape[:2]))
    height, width = photo.rgb.shape[:2]
    is_unchanged = photo.plain and rgb is photo.rgb
    if rgb is not photo.rgb:
        old_size, new_size = (
            f"{width} x {height} px",
            f"{rgb.shape[1]} x {rgb.shape[0]} px",
        )
        warn(
            Message.PHOTO_MADE_SMALLER.warning(
                place,
                "",
                f"the photo of {old_size}",
                width=max(width, height),
                size=new_size,
            )
        )
    # A large photo takes more memory than all maps together.
    del photo
    # Objects that the caller marks replace the detections of the segment backend.
    detections = None
    if labels is not None:
        detections = from_masks(labels)
    elif boxes or points:
        frame = PromptFrame(width, height, rgb.shape[1] / width)
        check_prompts(boxes, points, frame)
        segmenter = Segmenter(crew, options.asked, options.smallest)
        detections = from_prompts(rgb, boxes, points, segmenter, frame)
        # The segment backend is not needed any more, and its memory is.
        crew.release("segment")
    for problem in _unused_choices(crew, options):
        warn(problem)
    if detections is not None:
        detections = shrink_detections(detections, (width, height), rgb)
    full_size = None if rgb.shape[:2] == (height, width) else (width, height)

    def set_in_motion(perceived: PerceivedScene) -> PerceivedScene:
        progress("push", 0, 1)
        perceived = replace(perceived, full_size=full_size)
        story = None
        if options.story is not None:
            story = StoryRequest(options.story, crew.plan, warn)
        moved = start_motion(perceived, options.still, options.pushes, story)
        for problem in moved.warnings:
            warn(problem)
        return moved

    moving_scene = perception.perceive(
        rgb,
        detections,
        renames=options.labels,
        backends=crew,
        nouns=options.asked,
        facts=perception.KnownFacts(_given_view(options)),
        progress=progress,
        meanwhile=set_in_motion,
    )
    return _PerceivedPhoto(moving_scene, is_unchanged)


def _given_view(options: PerceiveOptions) -> BoundaryGuess | None:
    """Return the view that the caller chose, without boundaries."""
    from physgen.perceive.roles import BoundaryGuess
    from physgen.scene.scene import View

    if options.view is None:
        return None
    return BoundaryGuess(View(options.view), 1.0, "as given", ())


def _check_masks(
    masks: Path,
    shape: tuple[int, ...],
    image: Path,
    photo_shapes: tuple[tuple[int, ...], ...],
) -> None:
    """Check that masks have the size of the photo or of the scene. Raises
    InputError.
    """
    if shape in photo_shapes:
        return
    size_text = f"{shape[1]} x {shape[0]} px"
    height, width = photo_shapes[0]
    raise Message.MASKS_SIZE.error(
        str(masks), size_text, width=width, height=height, image=image
    )


def _prompt_frames(opened: OpenedScene, scene: Scene) -> PromptFrames:
    """Return the frames of new prompts, and of the prompts in a scene."""
    from physgen.perceive import refresh as old_and_new
    from physgen.perceive.segment.prompts import PromptFrame
    from physgen.scene.scene import BoxPrompt

    width, height = scene.size
    full_width, full_height = old_and_new.full_size(scene) or scene.size
    places = {}
    # Prompts of the scene are in its own pixels; a problem of one is reported at its
    # line.
    for order, item in enumerate(old_and_new.prompted(scene.objects)):
        path = ("objects", item.name, "prompt")
        kind = "box" if isinstance(item.prompt, BoxPrompt) else "point"
        places[order] = (
            opened.place((*path, kind)),
            f"objects.{item.name}.prompt.{kind}",
        )
    return old_and_new.PromptFrames(
        PromptFrame(full_width, full_height, width / full_width),
        PromptFrame(width, height, places=places),
    )


def _unused_choices(crew: Backends, options: PerceiveOptions) -> list[Problem]:
    """Return warnings about options without effect on the segment backend."""
    options_in_use, problems = crew.row("segment").uses, []
    if options.asked and (options.masks or "categories" not in options_in_use):
        nouns = f'"{", ".join(options.asked)}"'
        problems.append(Message.FIND_HAS_NO_EFFECT.warning(Place("--find"), "", nouns))
    if "categories" in crew.plan.choices and "categories" not in options_in_use:
        choice = f"categories={crew.plan.choices['categories']}"
        problems.append(
            Message.CATEGORIES_HAVE_NO_EFFECT.warning(
                Place("--backend"), "", choice, name=crew.name("segment")
            )
        )
    return problems


def import_physgen(
    folder: Path,
    output: Path | None = None,
    progress: Progress = silent,
    warn: Warn = ignore_warning,
    keep: Keep = lambda kept: None,
    stdout: Path | None = None,
    *,
    faithful: bool = False,
) -> str:
    """Convert a folder of the paper's public code to the text of a scene.

    It becomes a shot, unless it is to be `faithful` to the frames and discs of that
    code. Writes files as `perceive` does.
    """
    from physgen.perceive.import_physgen import import_physgen as run
    from physgen.perceive.import_shot import as_shot
    from physgen.perceive.scene_files import write_scene

    check_text_names(folder, output)
    check_writable((output or stdout or Path()).parent)
    scene = run(folder, progress=progress)
    if not faithful:
        scene = as_shot(scene)
    for problem in scene.warnings:
        warn(problem)
    return write_scene(
        scene,
        folder / "original.png",
        folder.resolve().name,
        output,
        keep,
        stdout=stdout,
    )


def refresh(
    path: Path,
    output: Path,
    *,
    crew: Backends | None = None,
    progress: Progress = silent,
    warn: Warn = ignore_warning,
    keep: Keep = lambda kept: None,
    inform: Callable[[str], None] = lambda line: None,
    **given: Any,
) -> str:
    """Perceive a scene's photo again, and return the text of the new scene.

    Writes files as `perceive` does. A value named in `from` is replaced if it is still
    as perception wrote it; all other values and lines stay. Objects with a `prompt` are
    found again. New `boxes` and `points` replace the objects that they cover, with a
    warning for objects inside them. `inform` is called with a summary. Raises
    InputError.
    """
    from physgen.pipeline.rebuilding import (
        check_own_assets,
        has_other_shape,
        with_fitting_assets,
    )
    from physgen.registry import Backends
    from physgen.scene.load import OpenedScene

    options = PerceiveOptions(**given)
    crew = crew or Backends()
    crew.begin()
    check_writable(output.parent)
    scene_file = OpenedScene(path, options.allow_outside)
    has_new_size = scene_file.ground.perceived_size is not None
    run = _Refresh(
        path, output, options, crew, progress, warn, keep, inform, has_new_size
    )
    if has_other_shape(scene_file.ground):
        check_own_assets(path.read_bytes().decode("utf-8-sig"), path)
        # No length in pixels fits a photo of other proportions: perceive it as a new
        # photo.
        return _perceive_anew(scene_file, run)

    def perceive_objects(
        image: Path, boxes: Sequence[Any], points: Sequence[Any]
    ) -> PerceivedScene:
        # The scene is in pixels of its photo: the photo must not be made smaller.
        side = max(scene_file.ground.size or (0, 0)) or None
        prompts = PerceiveOptions(boxes=boxes, points=points, side=side)
        photo = _perceive_photo(image, prompts, run.crew, progress, ignore_warning)
        return photo.perceived

    with with_fitting_assets(scene_file, path, output, perceive_objects) as (
        fitting_scene,
        text,
    ):
        return _refresh(*_with_view(fitting_scene, text, options.view), run)


def _with_view(
    opened: OpenedScene, text: str, view: str | None
) -> tuple[OpenedScene, str]:
    """Return the scene and its text with another `world.view`, if one is given.

    Boundaries and the push are found anew, as if the user had written the view.
    """
    from physgen.scene.load import OpenedScene
    from physgen.scene.yaml_edit import mark_values, write

    document = mark_values(text).data()
    world = document.get("world") or {}
    if view is None or world.get("view") == view:
        return opened, text
    text = write(text, document | {"world": {**world, "view": view}})
    return OpenedScene(opened.file, opened.allow_outside, text), text


@dataclass(frozen=True)
class _Refresh:
    """The state of a refresh, shared by its steps: files, options and callbacks."""

    path: Path
    output: Path
    options: PerceiveOptions
    crew: Backends
    progress: Progress
    warn: Warn
    keep: Keep
    inform: Callable[[str], None]
    is_resized: bool
    """Whether the photo's size has changed since it was perceived."""


def _perceive_anew(opened: OpenedScene, run: _Refresh) -> str:
    """Perceive a photo of other proportions; values without pixels of the old photo are
    kept.
    """
    from physgen.perceive.carry import carry_over
    from physgen.perceive.scene_files import write_scene

    image, path = opened.ground.image, run.path
    assert image is not None
    new_photo = _perceive_photo(image, run.options, run.crew, run.progress, run.warn)
    old_document = opened.document()
    _report_lost_objects(old_document, new_photo.perceived, path, run.warn)
    # Values with a meaning in any photo stay; those in pixels of the old photo are
    # dropped.
    transfer = carry_over(old_document, opened.ground.record, new_photo.perceived)
    description = _description(transfer.perceived)
    for key in transfer.dropped:
        run.warn(Message.VALUE_OF_OTHER_PHOTO.warning(Place(str(path)), key))
    text = write_scene(
        replace(transfer.perceived, description=description),
        image if new_photo.is_nameable else None,
        image.stem,
        run.output,
        run.keep,
    )
    lines = [*description.summary, *_overview_lines(text, run.output)]
    run.inform(f"{path}: " + "\n".join(lines))
    run.inform(f"{path}: kept: {listed(transfer.kept, 'and') or 'nothing'}")
    return text


def _report_lost_objects(
    old: dict[str, Any], perceived: PerceivedScene, path: Path, warn: Warn
) -> None:
    """Warn of objects that are missing in the new photo. Raises InputError if
    all are.
    """
    names = perceived.document["objects"]
    lost_names = [name for name in old.get("objects", {}) if name not in names]
    if lost_names and not names:
        raise Message.NO_OBJECT_FOUND_AGAIN.error(str(path))
    for name in lost_names:
        problem = Message.OBJECT_NOT_FOUND_AGAIN.problem(
            Place(str(path)), f"objects.{name}"
        )
        warn(replace(problem, severity=Severity.WARNING))


def _refresh(opened: OpenedScene, text: str, run: _Refresh) -> str:
    """Refresh a scene with fitting assets; `text` is the text of its file."""
    from physgen.compile.compile import compile_scene
    from physgen.perceive import perceive as perception
    from physgen.perceive import refresh as old_and_new
    from physgen.perceive.naming import renamed_labels
    from physgen.perceive.scene_files import write_scene
    from physgen.perceive.segment.prompts import Segmenter, check_prompts
    from physgen.photos import read_photo
    from physgen.pipeline.stages import percepts
    from physgen.scene.provenance import follows_scale

    path, options, crew, warn = run.path, run.options, run.crew, run.warn
    scene = opened.scene()
    if scene.image is None:
        raise Message.REFRESH_WITHOUT_PHOTO.error("--refresh", f'"{path}"')
    # Check all prompts before any slow work.
    frames = _prompt_frames(opened, scene)
    check_prompts(options.boxes, options.points, frames.new)
    check_prompts(*old_and_new.prompts_of(scene.objects), frames.old)
    maps = percepts(scene)
    ids = compile_scene(scene, None if maps is None else maps.labels).labels
    photo = read_photo(scene.image)
    segmenter = Segmenter(crew, options.asked, options.smallest)
    written_document = opened.document()
    old_document = old_and_new.with_sources(written_document, scene)
    # Objects without a prompt keep their pixels, those with one are segmented again.
    selection = old_and_new.start_refresh(
        photo.rgb,
        scene.objects,
        old_document,
        ids,
        options.boxes,
        options.points,
        segmenter,
        frames,
    )
    crew.release("segment")
    for name in selection.gone:
        warn(Message.POINTED_PART_LOST.warning(Place(str(path)), f"objects.{name}"))
    old_names = {
        i: name
        for i, name in selection.found.object_names.items()
        if name in old_document["objects"]
    }
    # A scale that follows from perception may change; a scale of the user is a known
    # fact.
    side, record = max(scene.size), scene.record
    has_default_scale = follows_scale(old_document, record, side)
    removed_pixels = (
        None
        if maps is None
        else old_and_new.taken_out(scene.objects, maps.cut_out, selection.found.labels)
    )
    # The layers of the user decide which object covers which, also in the new masks.
    layers = old_and_new.user_layers(old_document)
    layer_of = {i: layers[name] for i, name in old_names.items() if name in layers}
    perceived = perception.perceive(
        photo.rgb,
        replace(selection.found, layers=layer_of, gone=removed_pixels),
        renames=options.labels,
        backends=crew,
        facts=perception.KnownFacts(
            _given_view(options) or old_and_new.known_view(scene),
            None if has_default_scale else scene.world.pixels_per_meter,
        ),
        progress=run.progress,
    )
    new_labels = {
        old_names[i]: text
        for i, text in renamed_labels(options.labels, old_names)[0].items()
    }
    doubtful: dict[str, Any] = {}
    if maps is not None and removed_pixels is not None:
        new_labels_map, doubtful = old_and_new.kept_doubtful(
            old_document, maps.labels, perceived.percepts.labels, removed_pixels
        )
        # With the same objects, small differences of masks are noise: keep the former
        # values.
        if old_and_new.same_objects(scene, maps.labels, new_labels_map):
            is_resized = run.is_resized
            perceived = old_and_new.as_before(perceived, scene, is_resized)
    perceived_document, perceived_comments = perceived.document, perceived.comments
    document = old_and_new.merge_documents(
        old_document,
        perceived_document,
        selection,
        new_labels,
        has_default_scale,
        record,
    )
    # A comment stays only if it is about a value that perception still stands for.
    reasons = old_and_new.true_comments(
        perceived_comments, document, perceived_document, record.world
    )
    document, record_changes = old_and_new.rescaled(
        written_document, document, record, side
    )
    record_changes[""]["boundaries"] = perceived_document["boundaries"]
    if maps is not None:
        document |= {"doubtful": doubtful} if "doubtful" in old_document else {}
        # Whether the clean background exists depends on the light of this scene, not
        # on that of the new perception.
        clean_photo = None if maps.clean is None else perceived.percepts.clean
        depth = (
            maps.depth if perceived.percepts.depth is None else perceived.percepts.depth
        )
        final_maps = replace(
            perceived.percepts, labels=new_labels_map, clean=clean_photo, depth=depth
        )
        perceived = replace(perceived, percepts=final_maps)
    perceived = replace(perceived, document=document, comments=reasons)
    # Motion comes last, since it depends on all shapes and supports.
    is_still = options.still or bool(options.pushes)
    perceived, moving = refresh_motion(
        perceived, scene, old_document["objects"], is_still, warn
    )
    if options.pushes:
        perceived, moving = push_anew(perceived, scene, options.pushes), {}
    perceived = with_slow_motion_comment(perceived)
    document, summary_objects = perceived.document, dict(perceived_document["objects"])
    # The summary describes the photo as perceived, but with the motion of the final
    # scene.
    for name in summary_objects.keys() & document["objects"].keys():
        object_entry = document["objects"][name] | moving.get(name, {})
        summary_objects[name] = summary_objects[name] | {
            key: object_entry[key]
            for key in ("motion", "velocity", "spin")
            if key in object_entry
        }
    summary_document = {
        **perceived_document,
        "objects": summary_objects,
        "doubtful": doubtful,
    }
    summary_scene = replace(
        perceived,
        document=summary_document,
        comments={**perceived_comments, **perceived.comments},
    )
    # A scene that extends another one is written as a whole, without the old text.
    old_text = None if "extends" in written_document else text
    perceived = replace(
        perceived,
        comments={} if old_text is None else perceived.comments,
        wrote=record_changes,
        full_size=old_and_new.full_size(scene),
    )
    image = scene.image if photo.plain else None
    description = _description(summary_scene)
    new_text = write_scene(
        replace(perceived, description=description),
        image,
        scene.image.stem,
        run.output,
        run.keep,
        old_text,
        record,
    )
    lines = [*description.summary, *_overview_lines(new_text, run.output)]
    run.inform(f"{path}: " + "\n".join(lines))
    return new_text
