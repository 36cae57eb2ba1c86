"""A photo, a folder of the paper's code, or a scene to be perceived again: to the scene's text and its assets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physgen.files import check_text_names, check_writable
from physgen.messages import Message
from physgen.pipeline.first_motion import (
    push_anew,
    refresh_motion,
    start_motion,
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
    from physgen.scene.load import Opened
    from physgen.scene.scene import Scene

Keep = Callable[[Path], None]
"""Called with the new name of every file that stood in the way and was renamed."""


@dataclass(frozen=True)
class PerceiveOptions:
    """What a caller can choose about perception."""

    masks: Path | None = None
    """A label map that shows the objects."""
    boxes: Sequence[tuple[float, float, float, float]] = ()
    """x, y, w, h px of objects, in the photo that was given, upright."""
    points: Sequence[tuple[float, float]] = ()
    """x, y px on objects, in the same photo."""
    smallest: bool = False
    """Whether a point means the smallest object there, and not the whole one."""
    labels: Sequence[str] = ()
    """`NAME=TEXT`."""
    asked: Sequence[str] = ()
    """Objects that the segment backend is to find."""
    side: int | None = None
    """px: longest side of the photo, made smaller above; None: the default."""
    still: bool = False
    """Whether the push that sets the scene in motion is left out."""
    allow_outside: bool = False
    """Whether a scene that is perceived again may read files outside its folder."""
    pushes: Sequence[str] = ()
    """`NAME=DIRECTION[@SPEED]`, in place of the push that perception chooses."""
    story: str | None = None
    """What is to happen, in words, in place of that push."""
    view: str | None = None
    """`side` or `top`; None: perception decides."""
    makes_cache: bool = False
    """Whether the assets get a cache, which `render` uses."""


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
    """Photo -> the scene's text; assets, and the scene where `output` is given, are written. Raises InputError.

    `stdout` is the file that the caller writes the text to: without `output`, the assets
    go beside it.

    Objects come from `masks`, `boxes` and `points`, or else from the segment backend. `crew` fills the roles,
    the offline backends unless given. `given` are fields of PerceiveOptions. `inform` is called with a summary:
    some lines, the first of which has the photo's suitability.
    """
    from physgen.perceive.document import write_scene
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
    # last: nobody may read it any more
    lines = [*description.summary, *_overview_lines(text, output or stdout)]
    inform(f"{image}: " + "\n".join(lines))
    return text


def _description(perceived: PerceivedScene) -> Description:
    """Return the overview and the summary of a perceived photo."""
    from physgen.perceive.document import summary
    from physgen.perceive.roles import Description
    from physgen.report.overview import overview_png

    velocities: dict[str, Sequence[float]] = {}
    with suppress(InputError):  # it is reported when the scene is rendered
        for item in open_trial(perceived, "velocity").scene().objects:
            velocities[item.name] = item.velocity
    rgb, labels = perceived.percepts.rgb, perceived.percepts.labels
    overview = overview_png(rgb, labels, perceived.document, velocities)
    return Description(overview, summary(perceived))


def _overview_lines(text: str, target: Path | None) -> list[str]:
    """Return the line of the summary that names the overview of a scene's text."""
    folder = Path() if target is None else target.parent
    assets = named_assets(text.encode("utf-8"), folder)
    if assets is None or not (assets / OVERVIEW).is_file():
        return []
    return [f"  picture   {assets / OVERVIEW}"]


@dataclass(frozen=True)
class _PerceivedPhoto:
    """The scene of a photo, set in motion, and how the scene can refer to the file."""

    perceived: PerceivedScene
    is_nameable: bool
    """Whether the file's pixels are those of the scene."""


def _perceive_photo(
    image: Path,
    options: PerceiveOptions,
    crew: Backends,
    progress: Progress,
    warn: Warn,
) -> _PerceivedPhoto:
    """Perceive a photo and set its objects in motion. Raises InputError."""
    from physgen.maps import read_object_masks
    from physgen.perceive.perceive import (
        LONGEST_SIDE,
        KnownFacts,
        check_size,
        shrink_detections,
        shrink_photo,
    )
    from physgen.perceive.perceive import perceive as run
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
    as_it_is = photo.plain and rgb is photo.rgb
    if rgb is not photo.rgb:
        was, now = f"{width} x {height} px", f"{rgb.shape[1]} x {rgb.shape[0]} px"
        warn(
            Message.PHOTO_MADE_SMALLER.warning(
                place, "", f"the photo of {was}", width=max(width, height), size=now
            )
        )
    del photo  # a large one is larger than all maps together
    found = None
    if labels is not None:
        found = from_masks(labels)
    elif boxes or points:
        frame = PromptFrame(width, height, rgb.shape[1] / width)
        check_prompts(boxes, points, frame)
        segmenter = Segmenter(crew, options.asked, options.smallest)
        found = from_prompts(rgb, boxes, points, segmenter, frame)
        crew.release("segment")
    for problem in _unused_choices(crew, options):
        warn(problem)
    if found is not None:
        found = shrink_detections(found, (width, height), rgb)
    full_size = None if rgb.shape[:2] == (height, width) else (width, height)

    def set_in_motion(perceived: PerceivedScene) -> PerceivedScene:
        progress("push", 0, 1)
        perceived = replace(perceived, full_size=full_size)
        moved = start_motion(perceived, options.still, options.pushes, options.story)
        for problem in moved.warnings:
            warn(problem)
        return moved

    moved = run(
        rgb,
        found,
        renames=options.labels,
        crew=crew,
        asked=options.asked,
        known=KnownFacts(_given_view(options)),
        progress=progress,
        meanwhile=set_in_motion,
    )
    return _PerceivedPhoto(moved, as_it_is)


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
    """Raise InputError unless masks have the size of the photo, or of the smaller photo that the scene gets."""
    if shape in photo_shapes:
        return
    found = f"{shape[1]} x {shape[0]} px"
    height, width = photo_shapes[0]
    raise Message.MASKS_SIZE.error(
        str(masks), found, width=width, height=height, image=image
    )


def _prompt_frames(opened: Opened, scene: Scene) -> PromptFrames:
    """Return the frames of new prompts, and of those that are written in a scene."""
    from physgen.perceive import refresh as old_and_new
    from physgen.perceive.segment.prompts import PromptFrame
    from physgen.scene.scene import BoxPrompt

    width, height = scene.size
    full_width, full_height = old_and_new.full_size(scene) or scene.size
    places = {}
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
    """Warnings about options that the segment backend does not use."""
    uses, found = crew.row("segment").uses, []
    if options.asked and (options.masks or "categories" not in uses):
        asked = f'"{", ".join(options.asked)}"'
        found.append(Message.FIND_HAS_NO_EFFECT.warning(Place("--find"), "", asked))
    if "categories" in crew.plan.choices and "categories" not in uses:
        chosen = f"categories={crew.plan.choices['categories']}"
        found.append(
            Message.CATEGORIES_HAVE_NO_EFFECT.warning(
                Place("--backend"), "", chosen, name=crew.name("segment")
            )
        )
    return found


def import_physgen(
    folder: Path,
    output: Path | None = None,
    progress: Progress = silent,
    warn: Warn = ignore_warning,
    keep: Keep = lambda kept: None,
    stdout: Path | None = None,
) -> str:
    """A folder of the paper's public code -> the scene's text; writes as `perceive` does."""
    from physgen.perceive.document import write_scene
    from physgen.perceive.import_physgen import import_physgen as run

    check_text_names(folder, output)
    check_writable((output or stdout or Path()).parent)
    imported = run(folder, progress=progress)
    for problem in imported.warnings:
        warn(problem)
    return write_scene(
        imported,
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
    """A scene's photo perceived again -> the new scene's text; writes as `perceive` does. Raises InputError.

    Values that `from` names are written anew where they are as perception wrote them; all others stay, and so does
    every other line. Objects with a `prompt` are found again; new `boxes` and `points` replace what they cover, with a
    warning for objects inside them. `inform` is called with a summary, as by `perceive`.
    """
    from physgen.pipeline.rebuilding import (
        check_own_assets,
        has_other_shape,
        with_fitting_assets,
    )
    from physgen.registry import Backends
    from physgen.scene.load import Opened

    options = PerceiveOptions(**given)
    crew = crew or Backends()
    crew.begin()
    check_writable(output.parent)
    opened = Opened(path, options.allow_outside)
    is_resized = opened.ground.perceived_size is not None
    run = _Refresh(
        path, output, options, crew, progress, warn, keep, inform, is_resized
    )
    if has_other_shape(opened.ground):
        check_own_assets(path.read_bytes().decode("utf-8-sig"), path)
        return _perceive_anew(opened, run)

    def perceive_objects(
        image: Path, boxes: Sequence[Any], points: Sequence[Any]
    ) -> PerceivedScene:
        # the scene is in the pixels of its photo, which keeps its size
        side = max(opened.ground.size or (0, 0)) or None
        prompts = PerceiveOptions(boxes=boxes, points=points, side=side)
        photo = _perceive_photo(image, prompts, run.crew, progress, ignore_warning)
        return photo.perceived

    with with_fitting_assets(opened, path, output, perceive_objects) as (fitting, text):
        return _refresh(*_with_view(fitting, text, options.view), run)


def _with_view(opened: Opened, text: str, view: str | None) -> tuple[Opened, str]:
    """Return the scene and its text with another `world.view`, if one is given.

    Boundaries and the push are found anew, as if the user had written the view.
    """
    from physgen.scene.load import Opened
    from physgen.scene.yaml_edit import marked, write

    document = marked(text).data()
    world = document.get("world") or {}
    if view is None or world.get("view") == view:
        return opened, text
    text = write(text, document | {"world": {**world, "view": view}})
    return Opened(opened.file, opened.allow_outside, text), text


@dataclass(frozen=True)
class _Refresh:
    """What the steps of a refresh share: files, options and callbacks."""

    path: Path
    output: Path
    options: PerceiveOptions
    crew: Backends
    progress: Progress
    warn: Warn
    keep: Keep
    inform: Callable[[str], None]
    is_resized: bool
    """Whether the photo has another size than when it was perceived."""


def _perceive_anew(opened: Opened, run: _Refresh) -> str:
    """Perceive a photo of other proportions; keep what is not in pixels of the old one."""
    from physgen.perceive.carry import carry_over
    from physgen.perceive.document import write_scene

    image, path = opened.ground.image, run.path
    assert image is not None
    anew = _perceive_photo(image, run.options, run.crew, run.progress, run.warn)
    old = opened.document()
    _report_lost_objects(old, anew.perceived, path, run.warn)
    carried = carry_over(old, opened.ground.record, anew.perceived)
    description = _description(carried.perceived)
    for key in carried.dropped:
        run.warn(Message.VALUE_OF_OTHER_PHOTO.warning(Place(str(path)), key))
    text = write_scene(
        replace(carried.perceived, description=description),
        image if anew.is_nameable else None,
        image.stem,
        run.output,
        run.keep,
    )
    lines = [*description.summary, *_overview_lines(text, run.output)]
    run.inform(f"{path}: " + "\n".join(lines))
    run.inform(f"{path}: kept: {listed(carried.kept, 'and') or 'nothing'}")
    return text


def _report_lost_objects(
    old: dict[str, Any], perceived: PerceivedScene, path: Path, warn: Warn
) -> None:
    """Warn of objects that are not in the new photo. Raises InputError if none is."""
    names = perceived.document["objects"]
    lost = [name for name in old.get("objects", {}) if name not in names]
    if lost and not names:
        raise Message.NO_OBJECT_FOUND_AGAIN.error(str(path))
    for name in lost:
        problem = Message.OBJECT_NOT_FOUND_AGAIN.problem(
            Place(str(path)), f"objects.{name}"
        )
        warn(replace(problem, severity=Severity.WARNING))


def _refresh(opened: Opened, text: str, run: _Refresh) -> str:
    """Refresh a scene whose assets fit its photo; `text` is that of its file."""
    from physgen.compile.compile import compile_scene
    from physgen.perceive import refresh as old_and_new
    from physgen.perceive.document import renamed_labels, write_scene
    from physgen.perceive.perceive import KnownFacts
    from physgen.perceive.perceive import perceive as perceive_scene
    from physgen.perceive.segment.prompts import Segmenter, check_prompts
    from physgen.photos import read_photo
    from physgen.pipeline.stages import percepts
    from physgen.scene.provenance import follows_scale

    path, options, crew, warn = run.path, run.options, run.crew, run.warn
    scene = opened.scene()
    if scene.image is None:
        raise Message.REFRESH_WITHOUT_PHOTO.error("--refresh", f'"{path}"')
    frames = _prompt_frames(opened, scene)
    check_prompts(options.boxes, options.points, frames.new)
    check_prompts(*old_and_new.prompts_of(scene.objects), frames.old)
    maps = percepts(scene)
    ids = compile_scene(scene, None if maps is None else maps.labels).labels
    photo = read_photo(scene.image)
    find = Segmenter(crew, options.asked, options.smallest)
    own = opened.document()
    old = old_and_new.with_sources(own, scene)
    begun = old_and_new.start_refresh(
        photo.rgb,
        scene.objects,
        old,
        ids,
        options.boxes,
        options.points,
        find,
        frames,
    )
    crew.release("segment")
    for name in begun.gone:
        warn(Message.POINTED_PART_LOST.warning(Place(str(path)), f"objects.{name}"))
    called = {
        i: name
        for i, name in begun.found.object_names.items()
        if name in old["objects"]
    }
    side, record = max(scene.size), scene.record
    scaled = follows_scale(old, record, side)
    gone = (
        None
        if maps is None
        else old_and_new.taken_out(scene.objects, maps.cut_out, begun.found.labels)
    )
    layers = old_and_new.user_layers(old)
    layer_of = {i: layers[name] for i, name in called.items() if name in layers}
    perceived = perceive_scene(
        photo.rgb,
        replace(begun.found, layers=layer_of, gone=gone),
        renames=options.labels,
        crew=crew,
        known=KnownFacts(
            _given_view(options) or old_and_new.known_view(scene),
            None if scaled else scene.world.pixels_per_meter,
        ),
        progress=run.progress,
    )
    new_labels = {
        called[i]: text for i, text in renamed_labels(options.labels, called)[0].items()
    }
    doubtful: dict[str, Any] = {}
    if maps is not None and gone is not None:
        marked, doubtful = old_and_new.kept_doubtful(
            old, maps.labels, perceived.percepts.labels, gone
        )
        if old_and_new.same_objects(scene, maps.labels, marked):
            is_resized = run.is_resized
            perceived = old_and_new.as_before(perceived, scene, is_resized)
    seen, every = perceived.document, perceived.comments
    document = old_and_new.merge_documents(old, seen, begun, new_labels, scaled, record)
    reasons = old_and_new.true_comments(every, document, seen, record.world)
    document, wrote = old_and_new.rescaled(own, document, record, side)
    wrote[""]["boundaries"] = seen["boundaries"]
    if maps is not None:
        document |= {"doubtful": doubtful} if "doubtful" in old else {}
        # whether shadows were removed depends on the scene's own light
        clean = None if maps.clean is None else perceived.percepts.clean
        depth = (
            maps.depth if perceived.percepts.depth is None else perceived.percepts.depth
        )
        kept_maps = replace(perceived.percepts, labels=marked, clean=clean, depth=depth)
        perceived = replace(perceived, percepts=kept_maps)
    perceived = replace(perceived, document=document, comments=reasons)
    is_still = options.still or bool(options.pushes)
    perceived, moving = refresh_motion(perceived, scene, old["objects"], is_still, warn)
    if options.pushes:
        perceived, moving = push_anew(perceived, scene, options.pushes), {}
    document, told = perceived.document, dict(seen["objects"])
    for name in told.keys() & document["objects"].keys():
        own = document["objects"][name] | moving.get(name, {})
        told[name] = told[name] | {
            key: own[key] for key in ("motion", "velocity") if key in own
        }
    all_of = {**seen, "objects": told, "doubtful": doubtful}
    summed = replace(
        perceived, document=all_of, comments={**every, **perceived.comments}
    )
    before = None if "extends" in own else text
    perceived = replace(
        perceived,
        comments={} if before is None else perceived.comments,
        wrote=wrote,
        full_size=old_and_new.full_size(scene),
    )
    image = scene.image if photo.plain else None
    description = _description(summed)
    new = write_scene(
        replace(perceived, description=description),
        image,
        scene.image.stem,
        run.output,
        run.keep,
        before,
        record,
    )
    lines = [*description.summary, *_overview_lines(new, run.output)]
    run.inform(f"{path}: " + "\n".join(lines))
    return new
