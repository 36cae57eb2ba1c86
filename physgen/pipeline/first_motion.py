"""The first motion of a perceived scene: falling objects are held, one object is
pushed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physgen import simulate
from physgen.compile.compile import compile_shapes
from physgen.compile.shapes import shapes_of
from physgen.geometry import scale
from physgen.messages import Message, Note
from physgen.perceive.support.supports import SOURCE
from physgen.pipeline.push_choice import push_confidence, round_ends
from physgen.pipeline.push_outcomes import ramp_of
from physgen.pipeline.push_trials import compile_trials, simulate_push
from physgen.pipeline.pushes import (
    Push,
    default_push,
    direction_words,
    named_pushes,
    perceived_pushes,
)
from physgen.pipeline.refusals import find_refusals
from physgen.pipeline.releases import (
    RELEASE,
    is_better,
    is_oblique,
    is_weak_push,
    releases,
    stands_behind,
)
from physgen.pipeline.stages import compile, ended
from physgen.pipeline.story_server import StoryScene, photo_overview, tell
from physgen.pipeline.trial_scenes import open_trial
from physgen.pipeline.verdicts import (
    outcome_doubts,
    stillness_doubts,
    with_doubts,
    with_living_named,
    with_toys_named,
    without_parts_at_rest,
)
from physgen.problems import InputError, Place, Warn
from physgen.scene.provenance import meters, source, stated_scale
from physgen.scene.scene import View
from physgen.scene.write import edit_texts
from physgen.text import listed

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from physgen.compile.world import World
    from physgen.perceive.roles import PerceivedScene
    from physgen.pipeline.push_outcomes import Outcome
    from physgen.pipeline.refusals import Refusals
    from physgen.pipeline.story import Telling
    from physgen.registry import Plan
    from physgen.scene.scene import Scene


REST_SECONDS = 2.0
"""Time, s, in which an object without support moves."""
REST_SAMPLES = 81
"""Number of samples of that time."""
REST_BLOCK = 9
"""Number of samples between two checks of the motion; it divides `REST_SAMPLES`."""
REST_RATE = 240.0
"""Steps per second of that simulation; 120 are too few for stacked objects."""
REST_END = 1e-3, 1e-4
"""Motion, px and rad, between two checks below which all objects stay at rest.

Settling objects move a quarter as far in each block, an unstable one ever farther.
"""
REST_PX = 1.0
"""Distance, px, from which an object counts as moving."""


@dataclass(frozen=True)
class StoryRequest:
    """What is to happen, in words, and who may be asked about it."""

    text: str
    plan: Plan
    """Backends, and the settings of a server."""
    warn: Warn


def start_motion(
    perceived_scene: PerceivedScene,
    is_still: bool,
    pushes: Sequence[str] = (),
    story: StoryRequest | None = None,
) -> PerceivedScene:
    """Return the scene with falling objects held and one object pushed.

    No object is pushed if `is_still`. `pushes`, or a `story` in words, replace the
    automatic push. Raises InputError if one of them is wrong.
    """
    # A problem of the scene is reported when the scene is rendered.
    with suppress(InputError):
        perceived_scene = _at_rest(perceived_scene)
        if perceived_scene.document["objects"] and not (
            is_still or pushes or story is not None
        ):
            perceived_scene = _add_story_push(perceived_scene)
        perceived_scene = with_living_named(perceived_scene)
    perceived_scene = with_toys_named(perceived_scene)
    if pushes:
        perceived_scene = push_by_request(perceived_scene, pushes)
    if story is not None:
        perceived_scene = _moved_by_story(perceived_scene, story)
    return perceived_scene


def _moved_by_story(
    perceived_scene: PerceivedScene, story: StoryRequest
) -> PerceivedScene:
    """Return the scene with the motion that a sentence asks for. Raises InputError."""
    # Compile the scene once; `tell` tries its edits on copies of the scene.
    opened = open_trial(perceived_scene, "motion")
    scene = opened.scene()
    compiled, _ = ended(scene, compile(scene, None))

    def apply_edits(edits: Mapping[str, Any]) -> Scene:
        return opened.scene(edit_texts(edits))

    picture = photo_overview(perceived_scene.percepts, perceived_scene.document)
    subject = StoryScene(
        scene, compiled, apply_edits, picture, may_change_objects=False
    )
    telling = tell(subject, story.text, story.plan, story.warn)
    per_meter = scene.world.pixels_per_meter
    return _with_story_edits(perceived_scene, telling, per_meter)


def _with_story_edits(
    perceived_scene: PerceivedScene, telling: Telling, pixels_per_meter: float
) -> PerceivedScene:
    """Return the scene with the edits of a story, and its outcome as their comment."""
    document = dict(perceived_scene.document)
    objects = dict(document["objects"])
    comments = dict(perceived_scene.comments)
    for key, value in telling.edits.items():
        if key == "forces":
            # Forces belong to the whole scene; all other edits are keys
            # `objects.NAME.PART`.
            document["forces"] = value
            comments["forces"] = telling.outcome
            continue
        _, name, part = key.split(".")
        # Perceived scenes have velocities in m/s, so that a corrected scale keeps the
        # motion real.
        if part == "velocity":
            value = [meters(component / pixels_per_meter) for component in value]
        objects[name] = objects[name] | {part: value}
        comments[key] = telling.outcome
    document["objects"] = objects
    return replace(perceived_scene, document=document, comments=comments)


def _at_rest(
    perceived_scene: PerceivedScene, exempt_names: Collection[str] = ()
) -> PerceivedScene:
    """Hold the objects that move more than `REST_PX` without a push, in order of
    motion.

    Objects of `exempt_names` are not held. Only in the side view can objects fall.
    """
    trial = open_trial(perceived_scene)
    scene = trial.scene()
    shapes = shapes_of(scene, None)
    objects = dict(perceived_scene.document["objects"])
    comments = dict(perceived_scene.comments)
    # Hold the first objects that move and simulate again: objects that rest on them may
    # stay at rest then.
    while scene.world.view is View.SIDE:
        is_moving = _first_to_go(
            compile_shapes(scene, shapes).world,
            np.array([item.name not in exempt_names for item in scene.objects], bool),
        )
        if not is_moving.any():
            break
        for name in [
            item.name
            for item, is_gone in zip(scene.objects, is_moving, strict=True)
            if is_gone
        ]:
            # A held object cannot roll, move or spin: these keys would contradict its
            # motion.
            item = {}
            for key, value in objects[name].items():
                if key not in ("rolling", "velocity", "spin"):
                    item[key] = value
            sources = {}
            for key, value in item.get("from", {}).items():
                if key != "rolling":
                    sources[key] = value
            objects[name] = (
                item | {"motion": "static"} | ({"from": sources} if sources else {})
            )
            comments[f"objects.{name}.motion"] = (
                "it would not stay there, so it is held; dynamic lets it go"
            )
        scene = trial.scene(
            [
                f"objects.{k}.motion=static"
                for k, entry in objects.items()
                if "motion" in entry
            ]
        )
    return replace(
        perceived_scene,
        document=perceived_scene.document | {"objects": objects},
        comments=comments,
    )


def _first_to_go(world: World, is_free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask (N,) of the free objects that move first, in a world at rest.

    The simulation ends at the first motion, or when all objects have settled.
    """
    # The world has no pushes yet: any motion comes from gravity, from overlaps of masks
    # or from a missing support.
    times = np.linspace(0, REST_SECONDS, REST_SAMPLES)
    rate = min(world.steps_per_second, REST_RATE)
    running = simulate.engine.Running(replace(world, steps_per_second=rate), times)
    # Simulate in blocks, to stop soon after the first motion.
    for stop in range(REST_BLOCK, REST_SAMPLES + 1, REST_BLOCK):
        running.advance(float(times[stop - 1]))
        poses = running.trajectory().poses[:stop]
        # A displacement counts from the first sample on, and not per block: slow
        # tilting adds up to a visible motion.
        positions = poses[:, :, :2]
        is_moving = np.hypot(*np.moveaxis(positions - positions[:1], -1, 0)) > REST_PX
        is_moving &= is_free
        if is_moving.any():
            return np.asarray(is_moving[is_moving.any(axis=1).argmax()], bool)
        # All objects have settled if the last block moved and turned them less than
        # rounding of a pixel could show; the rest of the two seconds would bring
        # nothing new.
        change = np.abs(np.diff(poses[[-REST_BLOCK, -1]], axis=0))
        px, rad = REST_END
        if (change[..., :2] < px).all() and (change[..., 2] < rad).all():
            break
    return np.zeros_like(is_free)


def _add_story_push(
    perceived_scene: PerceivedScene, candidate_names: Collection[str] = ()
) -> PerceivedScene:
    """Return the scene with the push of a short story inside the picture.

    Only objects of `candidate_names`, if any are named, are pushed. If no push moves an
    object, a held object is released and pushed alone.
    """
    refusals = find_refusals(perceived_scene)
    if refusals.photo:
        return with_doubts(perceived_scene, refusals.reasons)
    candidates = set(perceived_scene.document["objects"]) - set(refusals.objects)
    if candidate_names:
        movable_names = candidates & set(candidate_names)
    else:
        movable_names = candidates
    # Try the objects that nothing speaks against; someone beside an object bars one
    # side.
    push = _chosen_push(perceived_scene, movable_names, refusals.barred_sides)
    # At an angle, the upper border of a nearer thing is no ledge to slide along.
    is_behind = push is not None and stands_behind(perceived_scene, push.name)
    if not candidate_names and (is_behind or is_weak_push(perceived_scene, push)):
        # A push of an object on a guessed floor is still better than no motion, or than
        # a motion out of the picture.
        release = _release(perceived_scene, refusals)
        if release is not None and is_better(release[1], None if is_behind else push):
            doubts = []
            # At an angle, the ground is visible around the object.
            if not is_oblique(perceived_scene):
                doubts.append(Note.GUESSED_FLOOR.text(name=release[1].name))
            return _with_push(with_doubts(release[0], doubts), release[1])
    if push is None:
        reasons = [*refusals.reasons, *stillness_doubts(perceived_scene, movable_names)]
        return with_doubts(perceived_scene, reasons)
    return _with_push(perceived_scene, push)


def _with_push(perceived_scene: PerceivedScene, push: Push) -> PerceivedScene:
    """Return the scene with a push, its comment and its doubts."""
    per_meter = perceived_scene.document["world"]["pixels_per_meter"]
    speeds = [meters(part / per_meter) for part in push.velocity]
    comment = f"the push that sets it off, {push.phrase}; [0, 0] leaves it at rest"
    # A spin about the foot moves the top farthest: the comment therefore names the top
    # as the place of the push.
    if push.spin:
        comment = (
            f"the push that sets it off, at its top {push.phrase}; "
            f"[0, 0] and spin: 0 leave it at rest"
        )
        perceived_scene = _with_spin(perceived_scene, push.name, push.spin)
    motions = {push.name: (speeds, comment)}
    return _with_motion(perceived_scene, motions, push.outcome, push.ramp)


def _with_spin(
    perceived_scene: PerceivedScene, name: str, spin: float
) -> PerceivedScene:
    """Return the scene with the spin of an object, degrees/s."""
    objects = dict(perceived_scene.document["objects"])
    objects[name] = objects[name] | {"spin": spin}
    return replace(
        perceived_scene, document=perceived_scene.document | {"objects": objects}
    )


def _chosen_push(
    perceived_scene: PerceivedScene,
    names: Collection[str],
    barred_sides: Mapping[str, str],
    least_confidence: float = 0.0,
) -> Push | None:
    """Return the best push of the objects of these names; None if no push moves an
    object.

    `barred_sides` are the sides to which objects are not pushed. Confidences below
    `least_confidence` are raised to `least_confidence`.
    """
    objects = perceived_scene.document["objects"]
    confidence = push_confidence(perceived_scene, names, least_confidence)
    # A face or a car moves forwards rather than backwards.
    facing = {}
    for name, item in objects.items():
        if "facing" in item:
            facing[name] = item["facing"]
    scene = open_trial(perceived_scene).scene()
    shapes = shapes_of(scene, None)
    invisible_walls = _unseen_walls(perceived_scene)
    ramp = None
    if "ramp" in perceived_scene.document["world"]:
        ramp = scene.world.ramp
    return default_push(
        scene,
        shapes,
        confidence,
        invisible_walls,
        facing,
        barred_sides,
        ramp,
        round_ends(perceived_scene),
    )


def _release(
    perceived_scene: PerceivedScene, refusals: Refusals
) -> tuple[PerceivedScene, Push] | None:
    """Release one held object and return its scene and push; None if no object
    moves.
    """
    best: tuple[PerceivedScene, Push] | None = None
    rested_names = set()
    for name, released_scene in releases(perceived_scene, refusals.objects):
        if name in rested_names:
            continue
        # The guessed floor may not support the object.
        resting_scene = _at_rest(released_scene)
        if "motion" in resting_scene.document["objects"][name]:
            continue
        rested_names.add(name)
        push = _chosen_push(
            resting_scene, [name], refusals.barred_sides, RELEASE.certainty
        )
        if push is None:
            continue
        if best is None or is_better(push, best[1]):
            best = resting_scene, push
        if push.outcome.has_calm_end:
            break
    return best


def _unseen_walls(perceived_scene: PerceivedScene) -> list[str]:
    """Return the names of walls outside the picture."""
    walls = perceived_scene.document["boundaries"].items()
    return [k for k, wall in walls if source(wall.get("from", "")).text == SOURCE]


def _with_motion(
    perceived_scene: PerceivedScene,
    motions: Mapping[str, tuple[list[Any], str]],
    outcome: Outcome,
    ramp: float | None = None,
) -> PerceivedScene:
    """Return the scene with velocities and their comments, and doubts about the
    outcome.

    The slow motion is chosen for the duration of the visible motion. `ramp`: that of
    the outcome, s; 0: none was as good; None: it is to be tried.
    """
    document, comments = perceived_scene.document, dict(perceived_scene.comments)
    objects = dict(document["objects"])
    for name, (velocity, comment) in motions.items():
        item = {}
        for k, v in objects[name].items():
            if k != "motion":
                item[k] = v
        objects[name] = item | {"velocity": velocity}
        comments.pop(f"objects.{name}.motion", None)
        comments[f"objects.{name}.velocity"] = comment
    # Store the playback only if it differs from the default, so that simple scenes have
    # short files.
    render = dict(document.get("render", {}))
    # The slow motion of the perceived scene suits a fall across the picture; here, the
    # duration of the simulated motion decides.
    default_slow = round(render.pop("slow", 1))
    slow = scale.story_slow_motion(default_slow, outcome.seconds)
    render = ({"slow": slow} if slow > 1 else {}) | render
    if slow > 1:
        comments["render"] = scale.slow_motion_comment(slow)
    else:
        comments.pop("render", None)
    document = document | {"objects": objects}
    if render or "render" in document:
        document["render"] = render
    moving_scene = replace(perceived_scene, document=document, comments=comments)
    moving_scene = _with_ramp(moving_scene, outcome, ramp)
    moving_scene = without_parts_at_rest(moving_scene, outcome)
    return with_doubts(
        moving_scene, outcome_doubts(moving_scene, list(motions), outcome)
    )


def _with_ramp(
    perceived_scene: PerceivedScene, outcome: Outcome, tried_ramp: float | None
) -> PerceivedScene:
    """Return the scene whose push takes some frames, if the motion is then as good.

    The outcome is that of a ramp of `tried_ramp` s, if given; 0: no ramp was as good.
    A ramp of the document stays.
    """
    if tried_ramp == 0 or "ramp" in perceived_scene.document["world"]:
        return perceived_scene
    # The ramp lasts a fixed number of video frames; with slow motion, these are less
    # time in the scene.
    ramp = ramp_of(perceived_scene.document.get("render", {}).get("slow", 1))
    # A sudden start looks unnatural, but a slow one may not topple anything.
    ramped = _set_ramp(perceived_scene, ramp)
    if ramp == tried_ramp:
        return ramped
    # The trial has used another ramp or none. Simulate with the final ramp before it is
    # written, since a slower start may end in another grade.
    scene = open_trial(ramped, "velocity", "spin").scene()
    velocities = {}
    for item in scene.objects:
        if any(item.velocity):
            velocities[item.name] = item.velocity
    trials = compile_trials(scene, shapes_of(scene, None), _unseen_walls(ramped))
    if velocities and simulate_push(trials, velocities).grade >= outcome.grade:
        return ramped
    # The trial was without any ramp and the ramped motion is worse: keep the sudden
    # start. Otherwise keep the ramp of the trial.
    if tried_ramp is None:
        return perceived_scene
    return _set_ramp(perceived_scene, tried_ramp)


def _set_ramp(perceived_scene: PerceivedScene, ramp: float) -> PerceivedScene:
    """Return the scene with the time of its push, s, and its comment."""
    world = perceived_scene.document["world"] | {"ramp": f"{ramp:.2g} s"}
    comment = "the push takes this time; 0 gives the velocity at once"
    comments = perceived_scene.comments | {"world.ramp": comment}
    document = perceived_scene.document | {"world": world}
    return replace(perceived_scene, document=document, comments=comments)


def push_by_request(
    perceived_scene: PerceivedScene, pushes: Sequence[str]
) -> PerceivedScene:
    """Return the scene with the pushes `NAME=DIRECTION[@SPEED]`. Raises InputError."""
    # A push of a held object means that the user wants it to move: release it first.
    dynamic_scene = _release_objects(
        perceived_scene, [text.partition("=")[0].strip() for text in pushes]
    )
    # The outcome of the pushes decides about slow motion and doubts, as for an
    # automatic push.
    scene = open_trial(dynamic_scene).scene()
    shapes = shapes_of(scene, None)
    trials = compile_trials(scene, shapes, _unseen_walls(dynamic_scene))
    motions = {}
    velocities = {}
    for item, velocity in named_pushes(scene, shapes, pushes):
        per_meter = scene.world.pixels_per_meter
        velocity_in_meters = [meters(part / per_meter) for part in velocity]
        push = Push(item.name, velocity, direction_words(velocity))
        comment = f"the push that you gave, {push.phrase}; [0, 0] leaves it at rest"
        motions[item.name] = (velocity_in_meters, comment)
        velocities[item.name] = velocity
    outcome = simulate_push(trials, velocities)
    return _with_motion(dynamic_scene, motions, outcome)


def push_anew(
    perceived_scene: PerceivedScene, scene: Scene, pushes: Sequence[str]
) -> PerceivedScene:
    """Return a refreshed scene with pushes of the user in place of perception's push.

    Velocities of the user in `scene` stay. Raises InputError.
    """
    objects = dict(perceived_scene.document["objects"])
    for name in perceived_pushes(scene):
        # Only pushes that perception wrote are removed. A velocity that the user wrote
        # is the user's decision.
        if name in objects:
            still_item = {}
            for k, v in objects[name].items():
                if k != "spin":
                    still_item[k] = v
            objects[name] = still_item | {"velocity": [0, 0]}
    document = perceived_scene.document | {"objects": objects}
    perceived_scene = replace(perceived_scene, document=document)
    pushed_scene = push_by_request(_with_usual_playback(perceived_scene, scene), pushes)
    document = pushed_scene.document | _playback(perceived_scene, pushed_scene, scene)
    return replace(pushed_scene, document=document)


def _has_perceived_slow_motion(scene: Scene) -> bool:
    """Check whether the slow motion of a scene is that of perception."""
    slow = scene.document.get("render", {}).get("slow", 1)
    record = scene.record
    return (
        slow == record.world.get("slow")
        or scale.slow_motion_comment(slow) in record.comments
    )


def _with_usual_playback(
    perceived_scene: PerceivedScene, scene: Scene
) -> PerceivedScene:
    """Return a refreshed scene with the playback of a scene before its first push.

    A new push has its own slow motion and ramp. A ramp of the user stays. `scene` is
    the scene before the refresh.
    """
    if not _has_perceived_slow_motion(scene):
        return perceived_scene
    document = dict(perceived_scene.document)
    world = dict(document.get("world", {}))
    # A ramp equal to the automatic one was written by perception, and depends on a push
    # that no longer exists.
    if scene.world.ramp == ramp_of(scene.document.get("render", {}).get("slow", 1)):
        world.pop("ramp", None)
    slow = scale.slow_motion(
        max(perceived_scene.percepts.labels.shape), stated_scale(document)
    )
    render = document.get("render", {}) | {"slow": slow}
    document |= {"world": world, "render": render}
    return replace(perceived_scene, document=document)


def _playback(
    perceived_scene: PerceivedScene, pushed_scene: PerceivedScene, scene: Scene
) -> dict[str, Any]:
    """Return the sections `world` and `render` of a refreshed scene with a new push.

    Slow motion of the user is that of the scene before the push, `perceived_scene`.
    """
    if _has_perceived_slow_motion(scene):
        with_slow = pushed_scene
    else:
        with_slow = perceived_scene
    sections = {"world": pushed_scene.document["world"]}
    if render := with_slow.document.get("render"):
        sections["render"] = render
    return sections


def _with_story_push(
    perceived_scene: PerceivedScene, scene: Scene, names: Collection[str]
) -> PerceivedScene:
    """Return a refreshed scene with the push of a story, if there is one.

    `names` are the objects that may be pushed; if empty, all. `scene` is the scene
    before the refresh.
    """
    resting_scene = _with_usual_playback(perceived_scene, scene)
    pushed_scene = _add_story_push(resting_scene, names)
    objects = pushed_scene.document["objects"]
    document = perceived_scene.document | {"objects": objects}
    if any(any(item.get("velocity", ())) for item in objects.values()):
        document |= _playback(perceived_scene, pushed_scene, scene)
    return replace(perceived_scene, document=document, comments=pushed_scene.comments)


def with_slow_motion_comment(perceived_scene: PerceivedScene) -> PerceivedScene:
    """Return a refreshed scene whose comment on slow motion is about its own value."""
    comments = dict(perceived_scene.comments)
    slow = perceived_scene.document.get("render", {}).get("slow", 1)
    if comments.pop("render", None) and slow > 1:
        comments["render"] = scale.slow_motion_comment(slow)
    return replace(perceived_scene, comments=comments)


def _release_objects(
    perceived_scene: PerceivedScene, names: Collection[str]
) -> PerceivedScene:
    """Return the scene with the objects of these names released."""
    objects = {}
    for name, item in perceived_scene.document["objects"].items():
        if name in names:
            item = {key: value for key, value in item.items() if key != "motion"}
        objects[name] = item
    return replace(
        perceived_scene, document=perceived_scene.document | {"objects": objects}
    )


@dataclass(frozen=True)
class _MotionChanges:
    """Changes of a refreshed scene after which other objects may be pushed."""

    released_names: Collection[str]
    """Objects that are no longer held."""
    has_new_view: bool
    stopped_names: Sequence[str]
    """Objects whose push of perception is removed."""

    @property
    def candidate_names(self) -> Collection[str]:
        """Return the objects that may be pushed; empty for all.

        After another view or a stopped push, any object may be pushed, otherwise only
        those that the refresh released.
        """
        if self.has_new_view or self.stopped_names:
            return ()
        return self.released_names

    def allow_push(self) -> bool:
        """Return whether a push may be added."""
        return bool(self.released_names or self.has_new_view or self.stopped_names)


def refresh_motion(
    perceived_scene: PerceivedScene,
    scene: Scene,
    old_entries: Mapping[str, Mapping[str, Any]],
    is_still: bool,
    warn: Warn,
) -> tuple[PerceivedScene, dict[str, Any]]:
    """Set the objects of a refreshed scene in motion again.

    Objects with a new prompt are held if they would fall. A push is added if nothing
    else moves and if an object was released, the view has changed, or perception's old
    push now moves nothing; the last case is a warning. `scene` is the scene before the
    refresh, `old_entries` its entries of objects by name. Returns the refreshed scene,
    and the values of objects that move as before, by name.
    """
    moving = _moving_values(scene)
    pushes: list[str] = []
    if not (is_still or scene.forces or scene.joints):
        pushes = list(perceived_pushes(scene))
    # After a problem of the scene, the changes so far remain: rendering reports it.
    with suppress(InputError):
        perceived_scene = _hold_changed_objects(perceived_scene, old_entries)
        changes = _find_changes(perceived_scene, scene, old_entries, pushes)
        for name in changes.stopped_names:
            del moving[name]
        perceived_scene = _stop_objects(perceived_scene, changes.stopped_names)
        is_at_rest = not (is_still or moving or scene.forces)
        if changes.allow_push() and is_at_rest:
            names = changes.candidate_names
            perceived_scene = _with_story_push(perceived_scene, scene, names)
        if not changes.has_new_view:
            _warn_of_stopped_pushes(perceived_scene, changes.stopped_names, warn)
    return perceived_scene, moving


def _moving_values(scene: Scene) -> dict[str, dict[str, Any]]:
    """Return the velocity, and the spin if any, of each moving object by name."""
    values: dict[str, dict[str, Any]] = {}
    for item in scene.objects:
        if any(item.velocity):
            values[item.name] = {"velocity": list(item.velocity)}
            if item.spin:
                values[item.name]["spin"] = item.spin
    return values


def _hold_changed_objects(
    perceived_scene: PerceivedScene, old_entries: Mapping[str, Mapping[str, Any]]
) -> PerceivedScene:
    """Hold the objects with a new prompt that would fall.

    Objects with an unchanged prompt keep the motion that they had, whether they fall or
    not.
    """
    objects = perceived_scene.document["objects"]
    unchanged_names = []
    for name, entry in old_entries.items():
        if entry.get("prompt") == objects.get(name, entry).get("prompt"):
            unchanged_names.append(name)
    return _at_rest(perceived_scene, unchanged_names)


def _find_changes(
    perceived_scene: PerceivedScene,
    scene: Scene,
    old_entries: Mapping[str, Mapping[str, Any]],
    pushes: Sequence[str],
) -> _MotionChanges:
    """Compare a refreshed scene with the scene before. Raises InputError.

    `pushes` are the names of objects with a push of perception.
    """
    objects = perceived_scene.document["objects"]
    # Entries without `motion` are dynamic: an object is released if only its old entry
    # had the key.
    released_names = set()
    for name, entry in old_entries.items():
        if "motion" in entry and "motion" not in objects.get(name, entry):
            released_names.add(name)
    old_view = scene.record.world.get("view")
    has_new_view = old_view not in (None, scene.world.view.value)
    has_motion = _push_moves(perceived_scene, pushes)
    # In another view gravity acts in another direction, so that perception's old push
    # says nothing about the new scene.
    if has_new_view or not has_motion:
        stopped_names = pushes
    else:
        stopped_names = []
    return _MotionChanges(released_names, has_new_view, stopped_names)


def _push_moves(perceived_scene: PerceivedScene, pushes: Sequence[str]) -> bool:
    """Check whether one of perception's pushes still moves an object.

    It may now meet an obstacle, since masks have changed. Raises InputError.
    """
    keys = ("velocity", "spin", "place", "layer")
    trial_scene = open_trial(perceived_scene, *keys).scene()
    trials = compile_trials(trial_scene, shapes_of(trial_scene, None))
    for item in trial_scene.objects:
        if item.name in pushes and any(item.velocity):
            outcome = simulate_push(trials, {item.name: item.velocity})
            if outcome.grade:
                return True
    return False


def _stop_objects(
    perceived_scene: PerceivedScene, names: Collection[str]
) -> PerceivedScene:
    """Return the scene with the objects of these names at rest."""
    objects = dict(perceived_scene.document["objects"])
    for name in names:
        if name in objects:
            entry = {}
            for k, v in objects[name].items():
                if k != "spin":
                    entry[k] = v
            objects[name] = entry | {"velocity": [0, 0]}
    document = perceived_scene.document | {"objects": objects}
    return replace(perceived_scene, document=document)


def _warn_of_stopped_pushes(
    perceived_scene: PerceivedScene, stopped_names: Sequence[str], warn: Warn
) -> None:
    """Warn of perception's pushes that move nothing, and name the present ones."""
    pushed_names = []
    for name, entry in perceived_scene.document["objects"].items():
        if any(entry.get("velocity", ())):
            pushed_names.append(name)
    fix = "no other push moves anything"
    if pushed_names:
        fix = f"{listed(pushed_names, 'and')} is pushed instead"
    template, place = Message.PUSH_MOVES_NOTHING, Place("--refresh")
    for name in stopped_names:
        warn(template.warning(place, name, "its push", fix=fix))
