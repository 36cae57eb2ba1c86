"""The first motion of a perceived scene: what would fall is held, and one object is pushed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from physgen.messages import Message, Note
from physgen.pipeline.trial_scenes import open_trial
from physgen.problems import InputError, Place, Warn
from physgen.scene.provenance import meters, source
from physgen.text import listed

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from physgen.compile.world import World
    from physgen.perceive.roles import PerceivedScene
    from physgen.pipeline.push_trials import Outcome
    from physgen.pipeline.pushes import Push
    from physgen.pipeline.refusals import Refusals
    from physgen.scene.scene import Scene


REST_SECONDS = 2.0
"""s in which an object that nothing holds has moved."""
REST_SAMPLES = 81
"""Samples of that time."""
REST_BLOCK = 9
"""Samples after which the simulation is looked at; they divide all samples evenly."""
REST_RATE = 240.0
"""Steps in a second of that time; 120 are too few for objects on each other."""
REST_PX = 1.0
"""px from which an object has moved."""


def start_motion(
    perceived: PerceivedScene,
    still: bool,
    pushes: Sequence[str] = (),
    story: str | None = None,
) -> PerceivedScene:
    """Return the scene with falling objects held and one object pushed, unless `still`.

    `pushes`, or a `story` in words, take the place of the push that is chosen. Raises
    InputError if one of them is wrong.
    """
    from physgen.pipeline.verdicts import with_living_named, with_toys_named

    with suppress(InputError):  # it is reported when the scene is rendered
        perceived = _at_rest(perceived)
        if perceived.document["objects"] and not (still or pushes or story is not None):
            perceived = _pushed(perceived)
        perceived = with_living_named(perceived)
    perceived = with_toys_named(perceived)
    if pushes:
        perceived = _pushed_by_user(perceived, pushes)
    if story is not None:
        perceived = _moved_by_story(perceived, story)
    return perceived


def _moved_by_story(perceived: PerceivedScene, story: str) -> PerceivedScene:
    """Return the scene with the motion that a sentence asks for. Raises InputError."""
    from physgen.pipeline.stages import compile, ended
    from physgen.pipeline.story import tell_story

    scene = open_trial(perceived, "motion").scene()
    compiled, _ = ended(scene, compile(scene, None))
    telling = tell_story(scene, compiled, story)
    document = dict(perceived.document)
    objects = dict(document["objects"])
    comments = dict(perceived.comments)
    for key, value in telling.edits.items():
        if key == "forces":
            document["forces"] = value
            comments["forces"] = telling.outcome
            continue
        _, name, part = key.split(".")
        if part == "velocity":
            per_meter = scene.world.pixels_per_meter
            value = [meters(one / per_meter) for one in value]
        objects[name] = objects[name] | {part: value}
        comments[key] = telling.outcome
    document["objects"] = objects
    return replace(perceived, document=document, comments=comments)


def _at_rest(perceived: PerceivedScene, kept: Collection[str] = ()) -> PerceivedScene:
    """The scene in which objects are held, but for those `kept`, that go farther than 1 px in 2 s without a push, the
    first to go at first."""
    import numpy as np

    from physgen.compile.compile import compile_shapes
    from physgen.compile.shapes import shapes_of
    from physgen.scene.scene import View

    opened = open_trial(perceived)
    scene = opened.scene()
    shapes = shapes_of(scene, None)
    objects, comments = dict(perceived.document["objects"]), dict(perceived.comments)
    while scene.world.view is View.SIDE:
        goes = _first_to_go(
            compile_shapes(scene, shapes).world,
            np.array([item.name not in kept for item in scene.objects], bool),
        )
        if not goes.any():
            break
        for name in [
            item.name for item, gone in zip(scene.objects, goes, strict=True) if gone
        ]:
            item = {
                key: value
                for key, value in objects[name].items()
                if key not in ("rolling", "velocity")
            }
            sources = {
                key: value
                for key, value in item.get("from", {}).items()
                if key != "rolling"
            }
            objects[name] = (
                item | {"motion": "static"} | ({"from": sources} if sources else {})
            )
            comments[f"objects.{name}.motion"] = (
                "it would not stay there, so it is held; dynamic lets it go"
            )
        scene = opened.scene(
            [
                f"objects.{k}.motion=static"
                for k, one in objects.items()
                if "motion" in one
            ]
        )
    return replace(
        perceived, document=perceived.document | {"objects": objects}, comments=comments
    )


def _first_to_go(world: World, is_free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which of the objects (N,) that are free move first, in a world at rest.

    The simulation ends as soon as one moves.
    """
    import numpy as np

    from physgen.simulate.engine import Running

    times = np.linspace(0, REST_SECONDS, REST_SAMPLES)
    rate = min(world.steps_per_second, REST_RATE)
    running = Running(replace(world, steps_per_second=rate), times)
    for stop in range(REST_BLOCK, REST_SAMPLES + 1, REST_BLOCK):
        running.on(float(times[stop - 1]))
        places = running.trajectory().poses[:stop, :, :2]
        away = np.hypot(*np.moveaxis(places - places[:1], -1, 0)) > REST_PX
        away &= is_free
        if away.any():
            return np.asarray(away[away.any(axis=1).argmax()], bool)
    return np.zeros_like(is_free)


def _pushed(perceived: PerceivedScene, only: Collection[str] = ()) -> PerceivedScene:
    """Return the scene with the push that tells a short story and stays in the picture.

    Only objects of `only`, if any are named, are pushed. If no push moves anything, a
    held object is released and pushed alone.
    """
    from physgen.pipeline.refusals import find_refusals
    from physgen.pipeline.releases import is_oblique
    from physgen.pipeline.verdicts import stillness_doubts, with_doubts

    refusals = find_refusals(perceived)
    if refusals.photo:
        return with_doubts(perceived, refusals.reasons)
    names = set(perceived.document["objects"]) - set(refusals.objects)
    allowed = names & set(only) if only else names
    chosen = _chosen_push(perceived, allowed, refusals.barred)
    if not only and _is_weak(perceived, chosen):
        released = _release(perceived, refusals)
        if released is not None and _is_better(released[1], chosen):
            doubts = []
            if not is_oblique(perceived):  # else the ground is visible around it
                doubts.append(Note.GUESSED_FLOOR.text(name=released[1].name))
            return _with_push(with_doubts(released[0], doubts), released[1])
    if chosen is None:
        reasons = [*refusals.reasons, *stillness_doubts(perceived, allowed)]
        return with_doubts(perceived, reasons)
    return _with_push(perceived, chosen)


def _with_push(perceived: PerceivedScene, push: Push) -> PerceivedScene:
    """Return the scene with a push, its comment and its doubts."""
    per_meter = perceived.document["world"]["pixels_per_meter"]
    speeds = [meters(part / per_meter) for part in push.velocity]
    why = f"the push that sets it off, {push.phrase}; [0, 0] leaves it at rest"
    return _with_motion(perceived, {push.name: (speeds, why)}, push.outcome)


def _chosen_push(
    perceived: PerceivedScene,
    names: Collection[str],
    barred: Mapping[str, str],
    least: float = 0.0,
) -> Push | None:
    """Return the best push of the objects of these names; None if none moves anything.

    `barred` are sides to which objects are not pushed. Objects that are less sure than
    `least` count as if they were as sure.
    """
    from physgen.compile.shapes import shapes_of
    from physgen.perceive.document import mask_confidence
    from physgen.pipeline.pushes import default_push

    objects = perceived.document["objects"]
    confidence = {
        name: max(mask_confidence(item), least) if name in names else 0.0
        for name, item in objects.items()
    }
    facing = {
        name: item["facing"] for name, item in objects.items() if "facing" in item
    }
    scene = open_trial(perceived).scene()
    shapes = shapes_of(scene, None)
    unseen = _unseen_walls(perceived)
    return default_push(scene, shapes, confidence, unseen, facing, barred)


def _is_weak(perceived: PerceivedScene, push: Push | None) -> bool:
    """Return whether a released object may tell more than a push."""
    from physgen.pipeline.push_trials import TRIAL
    from physgen.pipeline.releases import is_oblique

    if push is None or not push.outcome.is_inside:
        return True
    return is_oblique(perceived) and push.outcome.travel < TRIAL.travel


def _is_better(push: Push, other: Push | None) -> bool:
    """Return whether a push has a better grade than another one, if there is one.

    Of two with one grade, the one that moves something farther is better, up to a limit.
    """
    from physgen.pipeline.push_trials import TRIAL

    if other is None:
        return True
    ranks = [
        (one.outcome.grade, min(one.outcome.travel, TRIAL.travel))
        for one in (push, other)
    ]
    return ranks[0] > ranks[1]


def _release(
    perceived: PerceivedScene, refusals: Refusals
) -> tuple[PerceivedScene, Push] | None:
    """Return the scene with one held object released, and its push; None if none moves."""
    from physgen.pipeline.releases import RELEASE, releases

    best: tuple[PerceivedScene, Push] | None = None
    for name, released in releases(perceived, refusals.objects):
        settled = _at_rest(released)
        push = _chosen_push(settled, [name], refusals.barred, RELEASE.certainty)
        if push is None:
            continue
        if best is None or _is_better(push, best[1]):
            best = settled, push
        if push.outcome.is_calm:
            break
    return best


def _unseen_walls(perceived: PerceivedScene) -> list[str]:
    """Return the names of walls that the photo does not show."""
    from physgen.perceive.support.supports import SOURCE

    walls = perceived.document["boundaries"].items()
    return [k for k, wall in walls if source(wall.get("from", "")).text == SOURCE]


def _with_motion(
    perceived: PerceivedScene,
    motions: Mapping[str, tuple[list[Any], str]],
    outcome: Outcome,
) -> PerceivedScene:
    """Return the scene with velocities and their comments, and doubts of the outcome.

    Slow motion is what suits the time in which something moves.
    """
    from physgen.geometry.scale import slow_motion_comment, story_slow_motion
    from physgen.pipeline.verdicts import (
        outcome_doubts,
        with_doubts,
        without_parts_at_rest,
    )

    document, comments = perceived.document, dict(perceived.comments)
    objects = dict(document["objects"])
    for name, (velocity, why) in motions.items():
        item = {k: v for k, v in objects[name].items() if k != "motion"}
        objects[name] = item | {"velocity": velocity}
        comments.pop(f"objects.{name}.motion", None)
        comments[f"objects.{name}.velocity"] = why
    render = dict(document.get("render", {}))
    usual = round(render.pop("slow", 1))
    slow = story_slow_motion(usual, outcome.seconds)
    render = ({"slow": slow} if slow > 1 else {}) | render
    if slow > 1:
        comments["render"] = slow_motion_comment(slow)
    else:
        comments.pop("render", None)
    document = document | {"objects": objects}
    if render or "render" in document:
        document["render"] = render
    moved = replace(perceived, document=document, comments=comments)
    moved = without_parts_at_rest(moved, outcome)
    return with_doubts(moved, outcome_doubts(moved, list(motions), outcome))


def _pushed_by_user(perceived: PerceivedScene, pushes: Sequence[str]) -> PerceivedScene:
    """Return the scene with the pushes `NAME=DIRECTION[@SPEED]`. Raises InputError."""
    from physgen.compile.shapes import shapes_of
    from physgen.pipeline.push_trials import compile_trials, simulate_push
    from physgen.pipeline.pushes import Push, direction_words, named_pushes

    dynamic_scene = _freed(
        perceived, [text.partition("=")[0].strip() for text in pushes]
    )
    scene = open_trial(dynamic_scene).scene()
    shapes = shapes_of(scene, None)
    trials = compile_trials(scene, shapes, _unseen_walls(dynamic_scene))
    motions = {}
    velocities = {}
    for item, velocity in named_pushes(scene, shapes, pushes):
        per_meter = scene.world.pixels_per_meter
        in_meters = [meters(part / per_meter) for part in velocity]
        push = Push(item.name, velocity, direction_words(velocity))
        why = f"the push that you gave, {push.phrase}; [0, 0] leaves it at rest"
        motions[item.name] = (in_meters, why)
        velocities[item.name] = velocity
    outcome = simulate_push(trials, velocities)
    return _with_motion(dynamic_scene, motions, outcome)


def push_anew(
    perceived: PerceivedScene, scene: Scene, pushes: Sequence[str]
) -> PerceivedScene:
    """Return a refreshed scene with pushes in place of the one of perception.

    Velocities that the user wrote in `scene` stay. Raises InputError.
    """
    from physgen.pipeline.pushes import perceived_pushes

    objects = dict(perceived.document["objects"])
    for name in perceived_pushes(scene):
        if name in objects:
            objects[name] = objects[name] | {"velocity": [0, 0]}
    document = perceived.document | {"objects": objects}
    return _pushed_by_user(replace(perceived, document=document), pushes)


def _freed(perceived: PerceivedScene, names: Collection[str]) -> PerceivedScene:
    """Return the scene in which objects of these names are no longer held."""
    objects = {}
    for name, item in perceived.document["objects"].items():
        if name in names:
            item = {key: value for key, value in item.items() if key != "motion"}
        objects[name] = item
    return replace(perceived, document=perceived.document | {"objects": objects})


def refresh_motion(
    perceived: PerceivedScene,
    scene: Scene,
    was: Mapping[str, Mapping[str, Any]],
    still: bool,
    warn: Warn,
) -> tuple[PerceivedScene, dict[str, Any]]:
    """The `scene` that is refreshed, whose objects `was` held, with what has a new prompt at rest, and a push where
    nothing moves and an object is let go, the view is another, or the push that perception wrote moves nothing now,
    which is a warning; and what moves as before, by name."""
    from physgen.compile.shapes import shapes_of
    from physgen.pipeline.push_trials import compile_trials, simulate_push
    from physgen.pipeline.pushes import perceived_pushes

    moving = {
        item.name: {"velocity": list(item.velocity)}
        for item in scene.objects
        if any(item.velocity)
    }
    pushes = (
        [] if still or scene.forces or scene.joints else list(perceived_pushes(scene))
    )
    with suppress(InputError):
        objects = perceived.document["objects"]
        same = [
            k
            for k, item in was.items()
            if item.get("prompt") == objects.get(k, item).get("prompt")
        ]
        perceived = _at_rest(perceived, same)
        now = perceived.document["objects"]
        free = {
            k
            for k, item in was.items()
            if "motion" in item and "motion" not in now.get(k, item)
        }
        turned = scene.record.world.get("view") not in (None, scene.world.view.value)
        trial_scene = open_trial(perceived, "velocity", "place", "layer").scene()
        able = [
            item
            for item in trial_scene.objects
            if item.name in pushes and any(item.velocity)
        ]
        trials = compile_trials(trial_scene, shapes_of(trial_scene, None))
        outcomes = [simulate_push(trials, {one.name: one.velocity}) for one in able]
        moves = any(outcome.grade for outcome in outcomes)
        stopped = pushes if turned or not moves else []
        for name in stopped:
            del moving[name]
        rest = {
            name: now[name] | {"velocity": [0, 0]} for name in stopped if name in now
        }
        perceived = replace(
            perceived, document=perceived.document | {"objects": now | rest}
        )
        if (free or turned or stopped) and not (still or moving or scene.forces):
            pushed = _pushed(perceived, () if turned or stopped else free)
            document = perceived.document | {"objects": pushed.document["objects"]}
            perceived = replace(perceived, document=document, comments=pushed.comments)
        new = [
            k
            for k, item in perceived.document["objects"].items()
            if any(item.get("velocity", ()))
        ]
        fix = "no other push moves anything"
        if new:
            fix = f"{listed(new, 'and')} is pushed instead"
        nothing, place = Message.PUSH_MOVES_NOTHING, Place("--refresh")
        for name in [] if turned else stopped:
            warn(nothing.warning(place, name, "its push", fix=fix))
    return perceived, moving
