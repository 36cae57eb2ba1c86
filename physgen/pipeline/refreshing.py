"""Refresh of a scene: its photo is perceived again, and the user's values stay."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from physgen.compile.compile import compile_scene
from physgen.files import check_writable
from physgen.maps import Percepts
from physgen.messages import Message
from physgen.perceive import perceive as perception
from physgen.perceive import refresh as old_and_new
from physgen.perceive.carry import carry_over
from physgen.perceive.naming import renamed_labels
from physgen.perceive.refresh import PromptFrames, RefreshStart
from physgen.perceive.roles import Labels, PerceivedScene
from physgen.perceive.scene_files import write_scene
from physgen.perceive.segment.prompts import PromptFrame, Segmenter, check_prompts
from physgen.photos import Photo, read_photo
from physgen.pipeline.first_motion import (
    push_anew,
    refresh_motion,
    with_slow_motion_comment,
)
from physgen.pipeline.perceiving import (
    Keep,
    PerceiveOptions,
    describe,
    given_view,
    overview_lines,
    perceive_photo,
)
from physgen.pipeline.rebuilding import (
    check_own_assets,
    has_other_shape,
    with_fitting_assets,
)
from physgen.pipeline.stages import percepts
from physgen.problems import Place, Severity, Warn, ignore_warning
from physgen.progress import Progress, silent
from physgen.registry import Backends
from physgen.scene.load import OpenedScene
from physgen.scene.provenance import follows_scale
from physgen.scene.scene import BoxPrompt, Scene
from physgen.scene.yaml_edit import mark_values, write
from physgen.text import listed


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
        photo = perceive_photo(image, prompts, run.crew, progress, ignore_warning)
        return photo.perceived_scene

    with with_fitting_assets(scene_file, path, output, perceive_objects) as (
        fitting_scene,
        text,
    ):
        return _refresh(*_with_view(fitting_scene, text, options.view), run)


def _with_view(
    opened_scene: OpenedScene, text: str, view: str | None
) -> tuple[OpenedScene, str]:
    """Return the scene and its text with another `world.view`, if one is given.

    Boundaries and the push are found anew, as if the user had written the view.
    """
    document = mark_values(text).data()
    world = document.get("world") or {}
    if view is None or world.get("view") == view:
        return opened_scene, text
    text = write(text, document | {"world": {**world, "view": view}})
    return OpenedScene(opened_scene.file, opened_scene.allow_outside, text), text


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
    has_new_size: bool
    """Whether the photo's size has changed since it was perceived."""


def _perceive_anew(opened_scene: OpenedScene, run: _Refresh) -> str:
    """Perceive a photo of other proportions; values without pixels of the old photo are
    kept.
    """
    image = opened_scene.ground.image
    path = run.path
    assert image is not None
    new_photo = perceive_photo(image, run.options, run.crew, run.progress, run.warn)
    old_document = opened_scene.document()
    _report_lost_objects(old_document, new_photo.perceived_scene, path, run.warn)
    # Values with a meaning in any photo stay; those in pixels of the old photo are
    # dropped.
    transfer = carry_over(
        old_document, opened_scene.ground.record, new_photo.perceived_scene
    )
    description = describe(transfer.scene)
    for key in transfer.dropped_keys:
        run.warn(Message.VALUE_OF_OTHER_PHOTO.warning(Place(str(path)), key))
    text = write_scene(
        replace(transfer.scene, description=description),
        image if new_photo.is_nameable else None,
        image.stem,
        run.output,
        run.keep,
    )
    lines = [*description.summary, *overview_lines(text, run.output)]
    run.inform(f"{path}: " + "\n".join(lines))
    run.inform(f"{path}: kept: {listed(transfer.kept_keys, 'and') or 'nothing'}")
    return text


def _report_lost_objects(
    old: dict[str, Any], perceived_scene: PerceivedScene, path: Path, warn: Warn
) -> None:
    """Warn of objects that are missing in the new photo. Raises InputError if
    all are.
    """
    names = perceived_scene.document["objects"]
    # A photo without any of the old objects is most likely the wrong file.
    lost_names = []
    for name in old.get("objects", {}):
        if name not in names:
            lost_names.append(name)
    if lost_names and not names:
        raise Message.NO_OBJECT_FOUND_AGAIN.error(str(path))
    for name in lost_names:
        problem = Message.OBJECT_NOT_FOUND_AGAIN.problem(
            Place(str(path)), f"objects.{name}"
        )
        warn(replace(problem, severity=Severity.WARNING))


@dataclass(frozen=True)
class _OldScene:
    """A scene before its refresh."""

    scene: Scene
    image: Path
    photo: Photo
    maps: Percepts | None
    frames: PromptFrames
    written_document: dict[str, Any]
    """The data of its file."""
    document: dict[str, Any]
    """The same data with the sources of values that the user has not changed."""

    @property
    def side(self) -> int:
        """Return the longest side of the photo, px."""
        return max(self.scene.size)

    @property
    def has_default_scale(self) -> bool:
        """Check whether the scale follows from perception."""
        return follows_scale(self.document, self.scene.record, self.side)


@dataclass(frozen=True)
class _NewPerception:
    """The result of perceiving a photo again."""

    perceived_scene: PerceivedScene
    labels: Labels | None
    """Label map with the doubtful and the removed regions of the old scene; None if
    that has no maps.
    """
    doubtful: dict[str, Any]
    """Entries of the doubtful regions that remain."""


def _refresh(opened_scene: OpenedScene, text: str, run: _Refresh) -> str:
    """Refresh a scene with fitting assets; `text` is the text of its file."""
    old, labels = _read_old_scene(opened_scene, run)
    selection = _select_objects(old, labels, run)
    old_names = _old_names(old, selection)
    new = _perceive_again(old, selection, old_names, run)
    new_labels = _new_labels(run.options, old_names)
    merged, record_changes = _merge_scenes(old, new, selection, new_labels)
    # Motion comes last, since it depends on all shapes and supports.
    moving_scene, motions = _set_in_motion(merged, old, run)
    description = describe(_summary_scene(moving_scene, new, motions))
    final_scene = replace(
        moving_scene,
        wrote=record_changes,
        full_size=old_and_new.full_size(old.scene),
        description=description,
    )
    old_text: str | None = text
    # A scene that extends another one is written completely, without the old text.
    if "extends" in old.written_document:
        old_text = None
        final_scene = replace(final_scene, comments={})
    new_text = write_scene(
        final_scene,
        old.image if old.photo.plain else None,
        old.image.stem,
        run.output,
        run.keep,
        old_text,
        old.scene.record,
    )
    lines = [*description.summary, *overview_lines(new_text, run.output)]
    run.inform(f"{run.path}: " + "\n".join(lines))
    return new_text


def _old_names(old: _OldScene, selection: RefreshStart) -> dict[int, str]:
    """Return the names of the detections that are objects of the old scene, by
    number.
    """
    old_names = {}
    for number, name in selection.detections.object_names.items():
        if name in old.document["objects"]:
            old_names[number] = name
    return old_names


def _prompt_frames(opened_scene: OpenedScene, scene: Scene) -> PromptFrames:
    """Return the frames of new prompts, and of the prompts in a scene."""
    width, height = scene.size
    full_width, full_height = old_and_new.full_size(scene) or scene.size
    places = {}
    # Prompts of the scene are in its own pixels; a problem of one is reported at its
    # line.
    for order, item in enumerate(old_and_new.list_prompts(scene.objects)):
        path = ("objects", item.name, "prompt")
        if isinstance(item.prompt, BoxPrompt):
            kind = "box"
        else:
            kind = "point"
        places[order] = (
            opened_scene.place((*path, kind)),
            f"objects.{item.name}.prompt.{kind}",
        )
    return old_and_new.PromptFrames(
        PromptFrame(full_width, full_height, width / full_width),
        PromptFrame(width, height, places=places),
    )


def _read_old_scene(
    opened_scene: OpenedScene, run: _Refresh
) -> tuple[_OldScene, Labels]:
    """Read a scene with its photo, and return it with the label map of its objects.

    Raises InputError for a scene without a photo, and for wrong prompts.
    """
    scene = opened_scene.scene()
    if scene.image is None:
        raise Message.REFRESH_WITHOUT_PHOTO.error("--refresh", f'"{run.path}"')
    # Check all prompts before any slow work.
    frames = _prompt_frames(opened_scene, scene)
    check_prompts(run.options.boxes, run.options.points, frames.new)
    check_prompts(*old_and_new.prompts_of(scene.objects), frames.old)
    maps = percepts(scene)
    compiled_scene = compile_scene(scene, None if maps is None else maps.labels)
    photo = read_photo(scene.image)
    written_document = opened_scene.document()
    old = _OldScene(
        scene,
        scene.image,
        photo,
        maps,
        frames,
        written_document,
        old_and_new.with_sources(written_document, scene),
    )
    return old, compiled_scene.labels


def _select_objects(old: _OldScene, labels: Labels, run: _Refresh) -> RefreshStart:
    """Find the objects with prompts again, and those of new prompts.

    `labels` (H, W): id k + 1 is the k-th object of the scene.
    """
    options = run.options
    crew = run.crew
    segmenter = Segmenter(crew, options.asked, options.smallest)
    # Objects without a prompt keep their pixels, those with one are segmented again.
    selection = old_and_new.start_refresh(
        old.photo.rgb,
        old.scene.objects,
        old.document,
        labels,
        options.boxes,
        options.points,
        segmenter,
        old.frames,
    )
    crew.release("segment")
    place = Place(str(run.path))
    for name in selection.absorbed_names:
        run.warn(Message.POINTED_PART_LOST.warning(place, f"objects.{name}"))
    return selection


def _perceive_again(
    old: _OldScene, selection: RefreshStart, old_names: dict[int, str], run: _Refresh
) -> _NewPerception:
    """Perceive the photo with the selected objects; `old_names` are those of the scene,
    by id.
    """
    scene = old.scene
    maps = old.maps
    removed_pixels = None
    if maps is not None:
        removed_pixels = old_and_new.taken_out(
            scene.objects, maps.cut_out, selection.detections.labels
        )
    # The layers of the user decide which object covers which, also in the new masks.
    layers = old_and_new.user_layers(old.document)
    layers_by_id = {}
    for i, name in old_names.items():
        if name in layers:
            layers_by_id[i] = layers[name]
    # A scale that follows from perception may change; a scale of the user is a known
    # fact.
    known_scale = None if old.has_default_scale else scene.world.pixels_per_meter
    known_view = given_view(run.options) or old_and_new.known_view(scene)
    perceived = perception.perceive(
        old.photo.rgb,
        replace(
            selection.detections, layers=layers_by_id, removed_pixels=removed_pixels
        ),
        renames=run.options.labels,
        backends=run.crew,
        facts=perception.KnownFacts(known_view, known_scale),
        progress=run.progress,
    )
    if maps is None or removed_pixels is None:
        return _NewPerception(perceived, None, {})
    new_labels, doubtful = old_and_new.kept_doubtful(
        old.document, maps.labels, perceived.percepts.labels, removed_pixels
    )
    # With the same objects, small differences of masks are noise: keep the former
    # values.
    if old_and_new.same_objects(scene, maps.labels, new_labels):
        perceived = old_and_new.as_before(perceived, scene, run.has_new_size)
    return _NewPerception(perceived, new_labels, doubtful)


def _new_labels(options: PerceiveOptions, old_names: dict[int, str]) -> dict[str, str]:
    """Return the labels that the caller gives to objects, by name."""
    labels_by_id, _ = renamed_labels(options.labels, old_names)
    return {old_names[i]: text for i, text in labels_by_id.items()}


def _merge_scenes(
    old: _OldScene,
    new: _NewPerception,
    selection: RefreshStart,
    new_labels: dict[str, str],
) -> tuple[PerceivedScene, dict[str, dict[str, Any]]]:
    """Return the old scene with new values of perception, and the values of perception
    that the user has changed.
    """
    record = old.scene.record
    perceived = new.perceived_scene
    document = old_and_new.merge_documents(
        old.document,
        perceived.document,
        selection,
        new_labels,
        old.has_default_scale,
        record,
    )
    # A comment stays only if it is about a value that perception still stands for.
    comments = old_and_new.true_comments(
        perceived.comments, document, perceived.document, record.world
    )
    # After the merge, values of perception have to suit the user's scale.
    document, record_changes = old_and_new.rescale_document(
        old.written_document, document, record, old.side
    )
    record_changes[""]["boundaries"] = perceived.document["boundaries"]
    if old.maps is not None:
        if "doubtful" in old.document:
            document = document | {"doubtful": new.doubtful}
        final_percepts = _final_percepts(old.maps, new)
        perceived = replace(perceived, percepts=final_percepts)
    merged = replace(perceived, document=document, comments=comments)
    return merged, record_changes


def _final_percepts(old_maps: Percepts, new: _NewPerception) -> Percepts:
    """Return the new maps with the old scene's regions, and its depth if no new one
    exists.
    """
    new_percepts = new.perceived_scene.percepts
    assert new.labels is not None
    # Whether the clean background exists depends on the light of this scene, not
    # on that of the new perception.
    clean_photo = None
    if old_maps.clean is not None:
        clean_photo = new_percepts.clean
    if new_percepts.depth is None:
        depth = old_maps.depth
    else:
        depth = new_percepts.depth
    return replace(new_percepts, labels=new.labels, clean=clean_photo, depth=depth)


def _set_in_motion(
    merged_scene: PerceivedScene, old: _OldScene, run: _Refresh
) -> tuple[PerceivedScene, dict[str, Any]]:
    """Set the objects in motion, and return the values of those that move as before."""
    pushes = run.options.pushes
    is_still = run.options.still or bool(pushes)
    moving_scene, motions = refresh_motion(
        merged_scene, old.scene, old.document["objects"], is_still, run.warn
    )
    if pushes:
        moving_scene = push_anew(moving_scene, old.scene, pushes)
        motions = {}
    return with_slow_motion_comment(moving_scene), motions


def _summary_scene(
    moving_scene: PerceivedScene, new: _NewPerception, motions: dict[str, Any]
) -> PerceivedScene:
    """Return the photo as perceived, but with the motion of the final scene.

    `motions`: values of objects that move as before, by name.
    """
    perceived_document = new.perceived_scene.document
    final_objects = moving_scene.document["objects"]
    objects = dict(perceived_document["objects"])
    # The summary describes the new photo; only motion comes from the kept scene.
    for name in objects.keys() & final_objects.keys():
        final_entry = final_objects[name] | motions.get(name, {})
        motion = {}
        for key in old_and_new.MOTION_KEYS:
            if key in final_entry:
                motion[key] = final_entry[key]
        objects[name] = objects[name] | motion
    document = {**perceived_document, "objects": objects, "doubtful": new.doubtful}
    comments = {**new.perceived_scene.comments, **moving_scene.comments}
    return replace(moving_scene, document=document, comments=comments)
