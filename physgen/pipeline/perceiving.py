"""Perception as a whole: from a photo, a folder of the paper's code, or an older scene
to a scene's text and its assets.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import atan2, degrees, hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physgen import report
from physgen.files import check_text_names, check_writable
from physgen.maps import read_object_masks
from physgen.messages import Message
from physgen.perceive import perceive as perception
from physgen.perceive.import_physgen import import_physgen as run
from physgen.perceive.import_shot import as_shot
from physgen.perceive.photo_size import (
    LONGEST_SIDE,
    check_size,
    shrink_detections,
    shrink_photo,
)
from physgen.perceive.roles import BoundaryGuess, Description
from physgen.perceive.scene_files import write_scene
from physgen.perceive.segment.prompts import (
    PromptFrame,
    Segmenter,
    check_prompts,
    from_masks,
    from_prompts,
)
from physgen.perceive.summary import summary
from physgen.photos import read_photo
from physgen.pipeline.asset_cache import make_cache
from physgen.pipeline.first_motion import (
    StoryRequest,
    push_by_request,
    start_motion,
)
from physgen.pipeline.trial_scenes import open_trial
from physgen.problems import InputError, Place, Problem, Warn, ignore_warning
from physgen.progress import Progress, silent
from physgen.registry import Backends
from physgen.scene.files import OVERVIEW
from physgen.scene.saving import named_assets
from physgen.scene.scene import View

if TYPE_CHECKING:
    from physgen.perceive.roles import Detections, Labels, PerceivedScene, Rgb

GENTLE_PUSH = (
    "the direction of sim.yaml; physgen chose the speed, as the paper's code pushes at"
    " the picture's corner, which flings an object away"
)
"""Comment of such a push."""
SLOWEST_PUSH = 1.0
"""px/s: speed up to which a velocity is a rest of rounding, and has no direction."""

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
    options = PerceiveOptions(**given)
    crew = crew or Backends()
    crew.begin()
    if options.masks is not None and (options.boxes or options.points):
        raise Message.OBJECTS_GIVEN_TWICE.error("perceive")
    # Check names and folders before the perception, which takes much longer.
    check_text_names(image, output)
    check_writable((output or stdout or Path()).parent)
    photo = perceive_photo(image, options, crew, progress, warn)
    perceived = photo.perceived_scene
    description = describe(perceived)
    text = write_scene(
        replace(perceived, description=description),
        image if photo.is_nameable else None,
        image.stem,
        output,
        keep,
        stdout=stdout,
    )
    if options.makes_cache:
        make_cache(perceived.percepts, text, output or stdout)
    # The reader of the summary may have closed the pipe: inform at the very end.
    lines = [*description.summary, *overview_lines(text, output or stdout)]
    inform(f"{image}: " + "\n".join(lines))
    return text


def describe(perceived_scene: PerceivedScene) -> Description:
    """Return the overview and the summary of a perceived photo."""
    velocities: dict[str, Sequence[float]] = {}
    # A problem of the scene is reported when the scene is rendered.
    with suppress(InputError):
        for item in open_trial(perceived_scene, "velocity").scene().objects:
            velocities[item.name] = item.velocity
    rgb = perceived_scene.percepts.rgb
    labels = perceived_scene.percepts.labels
    overview = report.overview.overview_png(
        rgb, labels, perceived_scene.document, velocities
    )
    return Description(overview, summary(perceived_scene))


def overview_lines(text: str, target: Path | None) -> list[str]:
    """Return the line of the summary with the path of the overview."""
    if target is None:
        folder = Path()
    else:
        folder = target.parent
    assets = named_assets(text.encode("utf-8"), folder)
    if assets is None or not (assets / OVERVIEW).is_file():
        return []
    return [f"  picture   {assets / OVERVIEW}"]


@dataclass(frozen=True)
class PerceivedPhoto:
    """The scene of a photo, set in motion, and the way in which it can refer to the
    file.
    """

    perceived_scene: PerceivedScene
    is_nameable: bool
    """Whether the file has exactly the pixels of the scene."""


def perceive_photo(
    image: Path,
    options: PerceiveOptions,
    crew: Backends,
    progress: Progress,
    warn: Warn,
) -> PerceivedPhoto:
    """Perceive a photo and set its objects in motion. Raises InputError."""
    photo = _read_photo(image, options, warn)
    rgb = photo.rgb
    detections = _given_detections(photo, options, crew)
    for problem in _unused_choices(crew, options):
        warn(problem)
    # Detections are in pixels of the file, and perception works on a smaller photo.
    if detections is not None:
        detections = shrink_detections(detections, photo.full_size, rgb)
    is_full_size = photo.full_size == (rgb.shape[1], rgb.shape[0])

    def set_in_motion(perceived_scene: PerceivedScene) -> PerceivedScene:
        progress("push", 0, 1)
        full_size = None
        if not is_full_size:
            full_size = photo.full_size
        perceived_scene = replace(perceived_scene, full_size=full_size)
        story = None
        if options.story is not None:
            story = StoryRequest(options.story, crew.plan, warn)
        moving_scene = start_motion(
            perceived_scene, options.still, options.pushes, story
        )
        for problem in moving_scene.warnings:
            warn(problem)
        return moving_scene

    # `meanwhile` runs the trials of pushes while the backgrounds are computed.
    moving_scene = perception.perceive(
        rgb,
        detections,
        renames=options.labels,
        backends=crew,
        nouns=options.asked,
        facts=perception.KnownFacts(given_view(options)),
        progress=progress,
        meanwhile=set_in_motion,
    )
    return PerceivedPhoto(moving_scene, photo.equals_file)


@dataclass(frozen=True)
class _SizedPhoto:
    """A photo, made smaller if it is too large, and the masks of its objects."""

    rgb: Rgb
    full_size: tuple[int, int]
    """Width and height in the file, px."""
    equals_file: bool
    """Whether the file has exactly these pixels."""
    masks: Labels | None
    """The label map that the caller gave."""


def _read_photo(image: Path, options: PerceiveOptions, warn: Warn) -> _SizedPhoto:
    """Read a photo and the masks of its objects, and make a large photo smaller.

    Raises InputError.
    """
    photo = read_photo(image)
    place = Place(str(image))
    if not photo.readable:
        warn(Message.PROFILE_UNUSABLE.warning(place, "", "the colour profile"))
    rgb = shrink_photo(photo.rgb, options.side or LONGEST_SIDE)
    check_size(rgb, str(image))
    masks = None
    if options.masks is not None:
        masks = read_object_masks(options.masks)
        photo_shapes = photo.rgb.shape[:2], rgb.shape[:2]
        _check_masks(options.masks, masks.shape, image, photo_shapes)
    height, width = photo.rgb.shape[:2]
    if rgb is not photo.rgb:
        old_size = f"{width} x {height} px"
        new_size = f"{rgb.shape[1]} x {rgb.shape[0]} px"
        subject = f"the photo of {old_size}"
        longest_side = max(width, height)
        warn(
            Message.PHOTO_MADE_SMALLER.warning(
                place, "", subject, width=longest_side, size=new_size
            )
        )
    # The result does not refer to the large photo, which takes more memory than all
    # maps together.
    equals_file = photo.plain and rgb is photo.rgb
    return _SizedPhoto(rgb, (width, height), equals_file, masks)


def _given_detections(
    photo: _SizedPhoto, options: PerceiveOptions, crew: Backends
) -> Detections | None:
    """Return the objects that the caller marked; None if the segment backend is to find
    objects.

    Raises InputError.
    """
    if photo.masks is not None:
        return from_masks(photo.masks)
    if not (options.boxes or options.points):
        return None
    width, height = photo.full_size
    frame = PromptFrame(width, height, photo.rgb.shape[1] / width)
    check_prompts(options.boxes, options.points, frame)
    segmenter = Segmenter(crew, options.asked, options.smallest)
    detections = from_prompts(
        photo.rgb, options.boxes, options.points, segmenter, frame
    )
    # The segment backend is not needed any more, and its memory is.
    crew.release("segment")
    return detections


def given_view(options: PerceiveOptions) -> BoundaryGuess | None:
    """Return the view that the caller chose, without boundaries."""
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


def _unused_choices(crew: Backends, options: PerceiveOptions) -> list[Problem]:
    """Return warnings about options without effect on the segment backend."""
    options_in_use = crew.row("segment").uses
    problems = []
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
    check_text_names(folder, output)
    check_writable((output or stdout or Path()).parent)
    scene = run(folder, progress=progress)
    # The pushes of the paper's scenes were made for 16 frames, and fling objects out
    # of a longer clip.
    if not faithful:
        scene = _with_gentle_pushes(as_shot(scene))
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


def _with_gentle_pushes(shot: PerceivedScene) -> PerceivedScene:
    """Return an imported shot in which a push that flings an object is gentle.

    The paper's code pushes polygons at the picture's corner, a long lever. Here, the
    direction stays, and physgen chooses the speed. Without a velocity there is no
    direction, and the spin stays.
    """
    flung = {}
    for name, entry in shot.document["objects"].items():
        if entry.get("spin") and hypot(*entry["velocity"]) > SLOWEST_PUSH:
            flung[name] = entry
    pushes = []
    objects = dict(shot.document["objects"])
    for name, entry in flung.items():
        # The direction of the push, and a new speed that physgen chooses.
        right, down = entry["velocity"]
        pushes.append(f"{name}={degrees(atan2(down, right)):.4g}")
        without_spin = {}
        for key, value in entry.items():
            if key != "spin":
                without_spin[key] = value
        objects[name] = without_spin | {"velocity": [0.0, 0.0]}
    if not pushes:
        return shot
    at_rest = replace(shot, document=shot.document | {"objects": objects})
    pushed = push_by_request(at_rest, pushes)
    comments = dict(pushed.comments)
    for name in flung:
        comments[f"objects.{name}.velocity"] = GENTLE_PUSH
    return replace(pushed, comments=comments)
