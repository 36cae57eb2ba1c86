"""The search for the motion of a sentence: try pushes until its outcome happens.

A sentence names a wish, actors and targets. Every trial sets one actor in motion, runs
a simulation, and rates from 0 to 1 how much of the wish its motion fulfils.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import cos, degrees, hypot, isfinite, radians, sin
from typing import Any

import numpy as np

from physgen.arrays import F64
from physgen.compile.compile import CompiledScene, set_velocity
from physgen.compile.world import Body, Push, World
from physgen.geometry.scale import push_speed
from physgen.messages import Message
from physgen.pipeline.story_words import (
    STORY,
    NamedItem,
    Story,
    Wish,
    name_words,
    read_story,
)
from physgen.scene.scene import Load, Motion, Object, Scene, View
from physgen.simulate.engine import Running
from physgen.simulate.trajectory import Trajectory, new_touches, resting_mask
from physgen.text import listed, quoted


@dataclass(frozen=True)
class StoryLimits:
    """The search for a motion, and the thresholds of its outcomes."""

    speeds: tuple[float, ...] = (0.12, 0.25, 0.45, 0.7, 1.0, 1.5, 2.2, 3.2)
    """Speeds of trials, by the ordinary speed of a push, from gentle to hard."""
    elevations: tuple[float, ...] = (0.0, 20.0, 40.0, 60.0)
    """Elevations of throws above the line to the target, degrees."""
    fallen_angle: float = 60.0
    """Smallest turn of an object that has fallen over, degrees."""
    spun_angle: float = 90.0
    """Smallest turn of an object that spins, degrees."""
    shift: float = 0.05
    """Smallest visible shift, by the picture's longer side."""
    drop: float = 0.5
    """Smallest descent of an object that drops, by its height."""
    rise: float = 0.3
    """Smallest ascent of an object that rises, by its height."""
    spin: float = 540.0
    """Ordinary spin, degrees/s."""
    actors: int = 4
    """Largest number of actors to try, if a sentence means one of many."""
    max_simulations: int = 120
    """Largest number of simulations."""
    rate: float = 60.0
    """Samples of a motion per second, from which its outcome is rated."""
    leaving: float = 0.1
    """Loss of merit if the actor leaves the picture."""
    partial: float = 0.99
    """Smallest share of its outcome by which a story counts as fulfilled."""


LIMITS = StoryLimits()


@dataclass(frozen=True)
class Start:
    """One way to set an actor in motion."""

    actor: int
    velocity: tuple[float, float] = (0.0, 0.0)
    """px/s."""
    spin: float = 0.0
    """degrees/s."""
    lift: float = 0.0
    """Height by which the actor is raised before, px."""
    top_impulse: float = 0.0
    """Impulse to the right at its top, as of a finger, g·px/s."""
    has_motion: bool = True
    """False if nothing is pushed or lifted."""


@dataclass(frozen=True)
class Telling:
    """The best motion for a sentence."""

    edits: dict[str, Any]
    """Values by dotted key."""
    comes_true: bool
    outcome: str
    """Description of the motion in words."""
    trials: int
    """Number of simulations."""


@dataclass(frozen=True)
class _StoryTrial:
    """A simulated start of a story."""

    start: Start
    motion: Trajectory
    share: float
    """Share of the story that happens."""
    merit: float
    """The share, less if the actor leaves the picture."""


def tell_story(scene: Scene, compiled_scene: CompiledScene, text: str) -> Telling:
    """Return the edits for the motion that a sentence describes, or for the nearest
    one.

    Raises InputError if no verb or no object of the sentence is known.
    """
    world = compiled_scene.world
    story = read_story(text, scene_names(scene, world))
    actors = []
    for k in story.actors:
        if world.bodies[k].motion is not Motion.SCRIPTED:
            actors.append(k)
    if not actors:
        raise Message.STORY_WITHOUT_ACTOR.error(STORY, quoted(text))
    quiet = _at_rest(scene, world)
    best: _StoryTrial | None = None
    trial_count = 0
    for start in _starts(scene, compiled_scene, story, actors):
        trial = _try_start(scene, quiet, story, start)
        trial_count += 1
        # The trials begin with the gentlest. Of equal outcomes keep the first.
        if best is None or trial.merit > best.merit + 1e-6:
            best = trial
        if trial.merit >= LIMITS.partial or trial_count >= LIMITS.max_simulations:
            break
    assert best is not None
    comes_true = best.share >= LIMITS.partial
    words = outcome_words(scene, quiet, story, best.start, best.motion)
    edits = story_edits(scene, compiled_scene, best.start)
    return Telling(edits, comes_true, words, trial_count)


def _try_start(scene: Scene, quiet: World, story: Story, start: Start) -> _StoryTrial:
    """Simulate a start, and compare its motion with a story."""
    motion = _simulate_start(scene, quiet, start)
    share = fulfilment(quiet, story, start, motion)
    # Prefer a motion inside the picture: an actor that leaves it looks like an error.
    merit = share
    if start.has_motion and _leaves(quiet, start.actor, motion):
        merit -= LIMITS.leaving
    return _StoryTrial(start, motion, share, merit)


def scene_names(scene: Scene, world: World) -> list[NamedItem]:
    """Return the names of all objects and boundaries, in the order of
    `World.surfaces`.
    """
    candidates = []
    for k, (item, body) in enumerate(zip(scene.objects, world.bodies, strict=True)):
        x, y = body.center.tolist()
        candidates.append(name_words(k, item.name, item.label or "", (x, y)))
    for k, wall in enumerate(world.walls):
        x, y = np.concatenate(wall.chains).mean(axis=0).tolist()
        candidate = name_words(len(world.bodies) + k, wall.name, "", (x, y))
        candidates.append(replace(candidate, is_object=False))
    return candidates


def _at_rest(scene: Scene, world: World) -> World:
    """Return the world without the scene's own pushes: a story begins at rest."""
    bodies = []
    for item, body in zip(scene.objects, world.bodies, strict=True):
        if body.motion is Motion.DYNAMIC:
            resting_item = replace(item, velocity=(0.0, 0.0), spin=0.0)
            body = replace(set_velocity(body, resting_item, scene.world.view), spin=0.0)
        bodies.append(body)
    # A force without an end belongs to the place, such as a draught; pushes end.
    lasting = tuple(push for push in world.pushes if not isfinite(push.end))
    return replace(world, bodies=tuple(bodies), pushes=lasting)


def _starts(
    scene: Scene, compiled_scene: CompiledScene, story: Story, actors: Sequence[int]
) -> Iterator[Start]:
    """Yield the ways to set an actor in motion, from gentle to hard."""
    world = compiled_scene.world
    tried_actors = actors[: LIMITS.actors]
    # Without a push first: the outcome may happen by gravity alone.
    if story.precedes_verb or story.wish in (Wish.HALT, Wish.DROP):
        yield Start(tried_actors[0], has_motion=False)
    if story.wish is Wish.HALT:
        return
    if story.wish is Wish.DROP and not story.targets and scene.world.view is View.SIDE:
        for actor in tried_actors:
            for share in (1.0, 0.5, 2.0):
                yield Start(actor, lift=share * _height(world.bodies[actor]))
    ordinary_speed = push_speed(max(scene.size), scene.world.pixels_per_meter)
    for factor in _speed_factors(story.strength):
        for actor in tried_actors:
            yield from _starts_at(scene, world, story, actor, factor * ordinary_speed)


def _speed_factors(strength: float) -> list[float]:
    """Return the speeds in the order of trials, relative to the ordinary speed.

    A hard story begins with the fourth speed, so that its motion does not look gentle.
    """
    speeds = [speed * strength for speed in LIMITS.speeds]
    if strength > 1:
        return speeds[3:] + speeds[:3]
    return speeds


def _starts_at(
    scene: Scene, world: World, story: Story, actor: int, speed: float
) -> Iterator[Start]:
    """Yield the starts of one actor at a speed, px/s."""
    body = world.bodies[actor]
    signs = _signs_of(story)
    if story.wish is Wish.SPIN:
        for sign in signs:
            yield Start(actor, spin=sign * LIMITS.spin * speed / (body.reach * 10))
            # The spin at which the rim has the speed of a push.
            yield Start(actor, spin=sign * degrees(speed / body.reach))
        return
    is_upright = scene.world.view is View.SIDE and body.radius is None
    # An upright object turns over by a push at its top; a push through its centre of
    # mass would slide it.
    if story.wish is Wish.TURN and is_upright:
        if story.targets:
            signs = _signs_to_targets(world, story, actor)
        for sign in signs:
            yield Start(actor, top_impulse=sign * body.mass * speed / 2)
    for way in _directions(scene, world, story, actor):
        yield Start(actor, velocity=(way[0] * speed, way[1] * speed))


def _signs_of(story: Story) -> list[int]:
    """Return the sides to which a story may push: 1 right, -1 left."""
    if story.direction and story.direction[0]:
        return [story.direction[0]]
    return [1, -1]


def _signs_to_targets(world: World, story: Story, actor: int) -> list[int]:
    """Return the sides of the targets of an actor: 1 right, -1 left."""
    centers = _target_centers(world, story)
    offset = centers[:, 0] - world.bodies[actor].center[0]
    signs = [1 if value > 0 else -1 for value in offset.tolist()]
    return list(dict.fromkeys(signs))


def _directions(
    scene: Scene, world: World, story: Story, actor: int
) -> Iterator[tuple[float, float]]:
    """Yield the unit vectors of pushes on an actor."""
    is_side = scene.world.view is View.SIDE
    if story.direction is not None:
        x, y = story.direction
        yield float(x), float(y)
        for elevation in LIMITS.elevations[1:] if is_side and x else ():
            yield cos(radians(elevation)) * x, -sin(radians(elevation))
        if story.wish is not Wish.TOUCH:
            return
    if story.wish is Wish.RISE and not story.targets:
        yield 0.0, -1.0
        return
    if story.targets:
        yield from _generate_directions(world, story, actor, is_side)
        return
    # Without a target, any direction may work: in side view left and right, from above
    # eight.
    if is_side:
        count = 2
    else:
        count = 8
    for k in range(count):
        angle = 2 * np.pi * k / count
        yield float(np.cos(angle)), float(np.sin(angle))


def _generate_directions(
    world: World, story: Story, actor: int, is_side: bool
) -> Iterator[tuple[float, float]]:
    """Yield the directions to the nearest targets, with throws above them in
    side view.
    """
    center = world.bodies[actor].center
    offsets = _target_centers(world, story) - center
    order = np.argsort(np.hypot(*offsets.T))
    for offset in offsets[order][: LIMITS.actors]:
        x, y = (offset / max(float(np.hypot(*offset)), 1e-9)).tolist()
        if x >= 0:
            side = 1.0
        else:
            side = -1.0
        # Objects on a floor reach each other along it, wherever their centres are.
        if is_side:
            yield side, 0.0
        yield x, y
        # Throws rise above the horizon, and y points down.
        for elevation in LIMITS.elevations[1:] if is_side else ():
            yield side * cos(radians(elevation)), -sin(radians(elevation))


def _target_centers(world: World, story: Story) -> F64:
    """Return the centres (K, 2) of targets, px; for a wall, the mean of its points."""
    centers = []
    for k in story.targets:
        if k < len(world.bodies):
            centers.append(world.bodies[k].center)
        else:
            chains = world.walls[k - len(world.bodies)].chains
            centers.append(np.concatenate(chains).mean(axis=0))
    return np.array(centers, np.float64).reshape(-1, 2)


def _simulate_start(scene: Scene, world: World, start: Start) -> Trajectory:
    """Return the motion after a start, sampled evenly."""
    return sampled_motion(started_world(scene, world, start))


def sampled_motion(world: World) -> Trajectory:
    """Return the motion of a world, sampled evenly."""
    count = max(int(world.duration * LIMITS.rate), 2)
    times = np.linspace(0.0, world.duration, count + 1)
    running = Running(world, times)
    running.advance(float(times[-1]))
    return running.trajectory()


def started_world(scene: Scene, world: World, start: Start) -> World:
    """Return a world at rest with one object set in motion."""
    if not start.has_motion:
        return world
    item = scene.objects[start.actor]
    started_item = replace(item, velocity=start.velocity, motion=Motion.DYNAMIC)
    body = set_velocity(world.bodies[start.actor], started_item, scene.world.view)
    # Upwards is negative in the picture.
    shift = np.array([0.0, -start.lift])
    body = replace(
        body,
        center=body.center + shift,
        spin=radians(start.spin),
        motion=Motion.DYNAMIC,
    )
    bodies = list(world.bodies)
    bodies[start.actor] = body
    pushes = world.pushes
    if start.top_impulse:
        pushes = (*pushes, _tipping_push(body, start))
    return replace(world, bodies=tuple(bodies), pushes=pushes)


def _tipping_push(body: Body, start: Start) -> Push:
    """Return the push that tips a body over, at its top."""
    vector = np.array([start.top_impulse, 0.0])
    return Push(start.actor, Load.IMPULSE, vector, 0.0, _top(body), 0.0, 0.0)


def _top(body: Body) -> F64:
    """Return a point (2,) at the top of a body, above its centre of mass, px in its
    frame.
    """
    points = np.concatenate(body.rings)
    return np.array([0.0, float(points[:, 1].min()) * 0.95])


def _height(body: Body) -> float:
    """Return the height of a body's outline, px."""
    points = np.concatenate(body.rings)
    return float(np.ptp(points[:, 1]))


def fulfilment(world: World, story: Story, start: Start, motion: Trajectory) -> float:
    """Return the share from 0 to 1 of a story's wish that a motion fulfils."""
    if story.wish is Wish.HALT:
        return _halt_share(world, start.actor, motion)
    if story.wish is Wish.SHIFT:
        share = _measure_actor_shift(world, story, start.actor, motion)
        return _reduce_unless_rested(story, start, motion, share)
    # A sentence without an object of its verb, such as "the ball falls", is about the
    # actor itself.
    subjects = story.targets or (start.actor,)
    if story.wish is Wish.TOUCH:
        shares = [_touches(motion, start.actor, k) for k in subjects]
    else:
        shares = _change_shares(world, story, start.actor, subjects, motion)
    if not shares:
        return 0.0
    # "All bottles fall" is as fulfilled as the least of them, "a bottle falls" as the
    # best one.
    if story.needs_all:
        total_share = min(shares)
    else:
        total_share = max(shares)
    return _reduce_unless_rested(story, start, motion, total_share)


def _change_shares(
    world: World,
    story: Story,
    actor: int,
    subjects: Sequence[int],
    motion: Trajectory,
) -> list[float]:
    """Return the share of a story's change, from 0 to 1, of each body among the
    subjects.
    """
    shares = []
    for k in subjects:
        if k >= len(world.bodies):
            continue
        share = _change(world, story.wish, k, motion)
        # A target that moves by itself is no effect of the actor.
        if story.targets and story.wish is not Wish.DROP:
            share = _reduce_without_new_touch(motion, actor, share)
        shares.append(share)
    return shares


def _halt_share(world: World, actor: int, motion: Trajectory) -> float:
    """Return 1 if an actor rests at the end, otherwise at most half, less by its way."""
    if resting_mask(motion)[-1, actor]:
        return 1.0
    offsets = motion.poses[:, actor, :2] - motion.poses[0, actor, :2]
    distance = float(np.hypot(*offsets.T).max())
    return 0.5 / (1.0 + distance / (LIMITS.shift * max(world.size)))


def _reduce_unless_rested(
    story: Story, start: Start, motion: Trajectory, share: float
) -> float:
    """Return half a share if the actor should rest at the end and does not."""
    if not story.must_rest:
        return share
    is_resting = bool(resting_mask(motion)[-1, start.actor])
    if is_resting:
        return share
    return share / 2


def _touches(motion: Trajectory, actor: int, target: int) -> float:
    """Return 1 if an actor touches a target anew, otherwise a share below 1.

    The share is the reduction of the distance between both, by their first distance.
    """
    pair = {actor, target}
    is_new = new_touches(motion)
    pairs = motion.contacts.touch_pairs
    if any(set(row) == pair for row in pairs[is_new].tolist()):
        return 1.0
    if target >= motion.poses.shape[1]:
        return 0.0
    if any(set(row) == pair for row in pairs.tolist()):
        # Both touch from the beginning, so that the push must move the target.
        shift = motion.poses[:, target, :2] - motion.poses[0, target, :2]
        reach = LIMITS.shift * float(np.abs(motion.poses[0, :, :2]).max())
        return min(float(np.hypot(*shift.T).max()) / reach, 1.0)
    offsets = motion.poses[:, target, :2] - motion.poses[:, actor, :2]
    distances = np.hypot(*offsets.T)
    return float(0.9 * (1 - distances.min() / max(distances[0], 1e-9)))


def _reduce_without_new_touch(motion: Trajectory, actor: int, share: float) -> float:
    """Return a share in full only if the actor has touched something anew, else half of
    it.
    """
    pairs = motion.contacts.touch_pairs[new_touches(motion)]
    has_hit = any(actor in row for row in pairs.tolist())
    if has_hit:
        return share
    return 0.5 * share


def _measure_actor_shift(
    world: World, story: Story, actor: int, motion: Trajectory
) -> float:
    """Return the displacement of an actor as a share of a visible shift, from 0 to 1.

    With a direction in the story, it is the displacement along that direction.
    """
    offsets = motion.poses[:, actor, :2] - motion.poses[0, actor, :2]
    if story.direction is None:
        distance = float(np.hypot(*offsets.T).max())
    else:
        way = np.array(story.direction, np.float64)
        distance = float((offsets @ way).max())
    share = distance / (LIMITS.shift * max(world.size) * 1.2)
    return min(max(share, 0.0), 1.0)


def _change(world: World, wish: Wish, k: int, motion: Trajectory) -> float:
    """Return the turn, descent or ascent of a body as a share of the wish, from
    0 to 1.
    """
    poses = motion.poses[:, k]
    height = _height(world.bodies[k])
    if wish is Wish.TURN:
        value = (
            degrees(float(np.abs(poses[:, 2] - poses[0, 2]).max()))
            / LIMITS.fallen_angle
        )
    elif wish is Wish.SPIN:
        value = degrees(float(np.abs(poses[-1, 2] - poses[0, 2]))) / LIMITS.spun_angle
    elif wish is Wish.DROP:
        # The y axis points down: a fall raises y, and a rise lowers it.
        value = (poses[-1, 1] - poses[0, 1]) / (LIMITS.drop * height)
    else:
        value = (poses[0, 1] - poses[:, 1].min()) / (LIMITS.rise * height)
    return min(max(float(value), 0.0), 1.0)


def _leaves(world: World, actor: int, motion: Trajectory) -> bool:
    """Check whether an actor ends outside the picture."""
    x, y = motion.poses[-1, actor, :2].tolist()
    width, height = world.size
    return not (0 <= x < width and 0 <= y < height)


def outcome_words(
    scene: Scene, world: World, story: Story, start: Start, motion: Trajectory
) -> str:
    """Return a description of a motion's outcome in words."""
    names = [item.name for item in scene.objects]
    actor = names[start.actor]
    sentences = []
    pairs = motion.contacts.touch_pairs[new_touches(motion)].tolist()
    touched_surfaces = sorted(
        {k for row in pairs if start.actor in row for k in row} - {start.actor}
    )
    # Contacts count walls after bodies, in the order of `World.surfaces`.
    surfaces = [name for name, _ in world.surfaces]
    if touched_surfaces:
        sentences.append(
            f"{actor} touches {listed([surfaces[k] for k in touched_surfaces], 'and')}"
        )
    sentences += _turn_sentences(names, world, motion)
    offset = motion.poses[-1, start.actor, :2] - motion.poses[0, start.actor, :2]
    share = hypot(*offset.tolist()) / max(world.size)
    sentences.append(
        f"{actor} ends {share:.0%} of the picture from its start".replace("%", " %")
    )
    return "; ".join(sentences)


def story_edits(
    scene: Scene, compiled_scene: CompiledScene, start: Start
) -> dict[str, Any]:
    """Return the edits of a start, by dotted key, with the scene's own pushes
    removed.
    """
    edits = _resting_edits(scene.objects)
    # Pushes belong to the motion that the story replaces; lasting forces stay.
    own_forces = scene.document["forces"]
    forces = []
    for force in own_forces:
        if not {"impulse", "duration"} & set(force):
            forces.append(force)
    if len(forces) < len(own_forces):
        edits["forces"] = forces
    if not start.has_motion:
        return edits
    item = scene.objects[start.actor]
    body = compiled_scene.world.bodies[start.actor]
    key = f"objects.{item.name}"
    if item.motion is not Motion.DYNAMIC:
        edits[f"{key}.motion"] = "dynamic"
    if any(start.velocity):
        edits[f"{key}.velocity"] = [round(part, 1) + 0.0 for part in start.velocity]
    if start.spin:
        edits[f"{key}.spin"] = round(start.spin, 1)
    if start.lift:
        edits[f"{key}.place"] = _lifted_place(item, body, start.lift)
    if start.top_impulse:
        point = body.center + _top(body)
        push = {
            "object": item.name,
            "impulse": [float(f"{start.top_impulse:.4g}"), 0],
            "at": [round(float(part), 1) for part in point],
        }
        edits["forces"] = [*forces, push]
    return edits


def _turn_sentences(
    names: Sequence[str], world: World, motion: Trajectory
) -> list[str]:
    """Return a sentence for each object that falls over."""
    sentences = []
    for k, name in enumerate(names):
        turns = np.abs(motion.poses[:, k, 2] - motion.poses[0, k, 2])
        angle = degrees(float(turns.max()))
        if angle >= LIMITS.fallen_angle and world.bodies[k].radius is None:
            sentences.append(f"{name} turns by {angle:.0f} degrees")
    return sentences


def _resting_edits(objects: Sequence[Object]) -> dict[str, Any]:
    """Return the edits that stop all moving objects."""
    edits: dict[str, Any] = {}
    for item in objects:
        if item.motion is not Motion.DYNAMIC:
            continue
        if any(item.velocity):
            edits[f"objects.{item.name}.velocity"] = [0, 0]
        if item.spin:
            edits[f"objects.{item.name}.spin"] = 0
    return edits


def _lifted_place(item: Object, body: Body, lift: float) -> list[float]:
    """Return the `place` of an object after it is raised by `lift` px."""
    x, y = body.center.tolist()
    if item.place:
        angle = item.place[2]
    else:
        angle = 0.0
    place = [round(x, 2), round(y - lift, 2)]
    if angle:
        return [*place, angle]
    return place
