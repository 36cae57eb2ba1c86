"""A finger, a cue or a stick that comes into the picture, pushes what moves first, and leaves.

It is a sprite of its own on the stage, so that light, shadows, contacts and blur treat it as they treat objects. It
comes in during the frames of the photo before the motion, touches at t = 0, stays with the object while the push
ramps up, and goes back on its way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, hypot, radians, sqrt

import numpy as np

from physgen.arrays import F64
from physgen.compile.world import Body, World
from physgen.geometry.polygon import Pose, rotation
from physgen.geometry.shadows import Silhouette
from physgen.render.camera import Shot
from physgen.render.shadow_decomposition import CastShadow
from physgen.render.sprites import MARGIN, Sprite
from physgen.render.stage import ShadowBody, Stage
from physgen.render.striker_sprite import FORMS, Form, Placement, draw_striker
from physgen.scene.scene import Load, Motion, Striker, View
from physgen.simulate.trajectory import Trajectory


@dataclass(frozen=True)
class StrikerTuning:
    """Size and time of a striker."""

    least_radius_share: float = 0.1
    """Of the object's reach, and ..."""
    largest_radius_share: float = 0.4
    """... of it: limits of the tip's radius, as the scale may be a guess."""
    least_radius: float = 2.5
    """px of its radius."""
    back: int = 10
    """Frames in which it leaves."""
    slows: float = 2.2
    """Power with which the way that is left shrinks as it comes."""
    hit_share: float = 0.5
    """Share of its way that it comes at the speed of the hit, at most."""
    shadow_room: float = 0.25
    """Of the picture's size, by which it is longer than its own picture needs."""


STRIKER = StrikerTuning()


@dataclass(frozen=True)
class _Way:
    """The way of a striker on the canvas, px."""

    body: int
    """It pushes."""
    ramp: float
    """s during which it stays with the body."""
    speed: float
    """px/s at which it hits; 0 if the body gains its speed during the ramp."""
    arm: F64
    """(2,) from the body's centre to the middle of the round tip at t = 0."""
    axis: F64
    """(2,) unit, from the tip along the striker."""
    size: tuple[int, int]
    """Width and height of the picture, px."""
    clearance: float
    """px along the axis by which it must leave the picture to be out of sight."""
    margin: float
    """px from its axis to its outline, at most."""
    scale: float
    """px a mm of its form."""
    is_from_side: bool
    """Whether the viewer sees it from its side; else from above."""
    is_body_round: bool
    """Such a body rolls along the striker, whose tip stays where it is."""

    def distance(self, place: F64) -> float:
        """Return px along the axis, from a place (2,) of the tip to out of sight."""
        return _exit(place, self.axis, self.size, 0.0) + self.clearance

    def length(self, track: F64) -> float:
        """Return px from the tip to its far end, which no place (T, 2) of it brings in.

        Its shadow does not end in the picture either.
        """
        ways = [_exit(place, self.axis, self.size, self.margin) for place in track]
        return max(ways) + STRIKER.shadow_room * max(self.size)

    def place(self, pose: F64, side: float) -> F64:
        """Return (2,) px of the middle of the tip, by the pose (3,) of the body."""
        turn = 0.0 if self.is_body_round else float(pose[2])
        arm = rotation(turn) @ self.arm
        return np.asarray(pose[:2] + arm + side * self.axis, np.float64)


@dataclass(frozen=True)
class StruckScene:
    """A stage with strikers, and what it shows in each frame."""

    stage: Stage
    trajectory: Trajectory
    """`parts` samples a frame, those of the hold first, and the strikers as more bodies."""
    shot: Shot


def with_strikers(
    stage: Stage,
    world: World,
    kind: Striker,
    exposure: tuple[Trajectory, int],
    shot: Shot,
    hold: int,
) -> StruckScene | None:
    """Return the scene with a striker for each object that is pushed; None if none is, or in a single frame.

    `exposure` are the samples of the exposures, and how many a frame has; `hold` frames come before them.
    """
    fine, parts = exposure
    form = FORMS[kind]
    ways = []
    for strike in find_strikes(world):
        pose = fine.poses[parts - 1, strike.body]
        ways.append(_way(stage, world, strike, form, pose))
    if not ways or stage.scale != 1.0 or len(fine.times) < 2 * parts:
        return None
    longer = _with_hold(fine, parts, hold)
    tracks = [_track(way, longer, parts, hold) for way in ways]
    return StruckScene(
        _with_sprites(stage, form, ways, tracks, fine),
        _with_bodies(longer, tracks),
        replace(shot, order=_longer_order(shot.order, hold)),
    )


@dataclass(frozen=True)
class Strike:
    """A push at t = 0 whose cause a striker shows."""

    body: int
    """Index into `World.bodies`."""
    velocity: F64
    """(2,) px/s of the centre of mass by the push alone."""
    point: F64 | None = None
    """(2,) px of action in the body's frame; None: the centre of mass."""
    ramp: float = 0.0
    """s until the body has this velocity."""


def find_strikes(world: World) -> list[Strike]:
    """Return the pushes by which dynamic bodies start.

    Of bodies that joints hold together, only the heaviest pushed one is struck.
    """
    strikes: dict[int, Strike] = {}
    for push in world.pushes:
        body = world.bodies[push.body]
        if push.load is Load.IMPULSE and push.start == 0 and push.vector.any():
            velocity = push.vector / body.mass
            strikes.setdefault(push.body, Strike(push.body, velocity, push.point))
    for k, body in enumerate(world.bodies):
        if body.velocity.any():
            strikes[k] = Strike(k, body.velocity, ramp=body.ramp)
    for k in list(strikes):
        if world.bodies[k].motion is not Motion.DYNAMIC:
            del strikes[k]
    # A hand cannot push two bodies of one assembly at once.
    for joint in world.joints:
        first, second = joint.first, joint.second
        if second is None or first not in strikes or second not in strikes:
            continue
        is_lighter = world.bodies[first].mass < world.bodies[second].mass
        del strikes[first if is_lighter else second]
    return list(strikes.values())


def _longer_order(order: Sequence[int], hold: int) -> tuple[int, ...]:
    """Return the playing order with frames of the hold before the others."""
    return (*range(hold), *(sample + hold for sample in order))


def _way(stage: Stage, world: World, strike: Strike, form: Form, pose: F64) -> _Way:
    """Return the way of the striker that pushes a body."""
    body = world.bodies[strike.body]
    speed = hypot(*strike.velocity)
    push = strike.velocity / speed
    axis = -push
    if world.view is View.SIDE:
        # From above: the floor is below.
        lift = radians(form.lift) * (1 if push[0] > 0 else -1) * (abs(push[0]) > 0.5)
        axis = rotation(lift) @ axis
    usual = form.tip * world.pixels_per_meter / 1000
    radius = min(
        max(usual, STRIKER.least_radius_share * body.reach),
        STRIKER.largest_radius_share * body.reach,
    )
    radius = max(radius, STRIKER.least_radius)
    # The tip touches the rim opposite to the push, from outside: its centre is one
    # radius before the rim.
    arm = _rim(body, float(pose[2]), -push, strike.point) - radius * push
    scale = radius / form.tip
    reach = 2 * form.largest_radius
    if form.hand:
        # A hand is wider than its finger, and has to leave the picture as well.
        reach = max(reach, form.extent)
    height, width = stage.background.shape[:2]
    is_round = body.radius is not None
    return _Way(
        strike.body,
        strike.ramp,
        0.0 if strike.ramp else speed,
        arm if is_round else rotation(-float(pose[2])) @ arm,
        axis,
        (width, height),
        reach * scale + MARGIN,
        form.extent * scale + MARGIN,
        scale,
        world.view is View.SIDE,
        is_round,
    )


def _rim(body: Body, angle: float, direction: F64, point: F64 | None = None) -> F64:
    """Return (2,) px from the centre to a body's outline in a direction.

    With a `point` (2,) in the body's frame, the line runs through that point.
    """
    turn = rotation(angle)
    offset = np.zeros(2) if point is None else turn @ point
    across = np.array([-direction[1], direction[0]])
    if body.radius is not None:
        half_chord = sqrt(max(body.radius**2 - float(offset @ across) ** 2, 0.0))
        return offset + (half_chord - float(offset @ direction)) * direction
    reach = 0.0
    for ring in body.rings:
        corners = ring @ turn.T - offset
        along, side = corners @ direction, corners @ across
        next_along = np.roll(along, -1)
        next_side = np.roll(side, -1)
        crosses = (side > 0) != (next_side > 0)
        share = side[crosses] / (side[crosses] - next_side[crosses])
        places = along[crosses] + share * (next_along[crosses] - along[crosses])
        reach = max(reach, float(places.max(initial=0.0)))
    return offset + reach * direction


def _exit(place: F64, axis: F64, size: tuple[int, int], margin: float) -> float:
    """Return px along a direction from a place to `margin` px outside of the picture."""
    ways = []
    for x, step, side in zip(place.tolist(), axis.tolist(), size, strict=True):
        if abs(step) > 1e-9:
            ways.append(((side + margin if step > 0 else -margin) - x) / step)
    return max(float(min(ways)), 0.0)


def _with_hold(fine_motion: Trajectory, parts: int, hold: int) -> Trajectory:
    """Return the samples with those of the hold before them, which show t = 0.

    That is the last sample of the first frame: earlier ones may be moved back by its blur.
    """
    count = parts * hold

    def longer(values: F64) -> F64:
        first = np.repeat(values[parts - 1 : parts], count, axis=0)
        return np.concatenate([first, values]) if len(values) else values

    return replace(
        fine_motion,
        times=longer(fine_motion.times),
        poses=longer(fine_motion.poses),
        velocities=longer(fine_motion.velocities),
        turns=longer(fine_motion.turns)
        if fine_motion.turns.size
        else fine_motion.turns,
        wheel_turns=longer(fine_motion.wheel_turns),
    )


def _track(way: _Way, longer: Trajectory, parts: int, hold: int) -> F64:
    """Return (T, 2) px of the middle of the tip at all samples."""
    times = longer.times
    frame_time = float(times[-1] - times[-1 - parts])
    pushed = max(way.ramp / frame_time, 1.0)
    end = min(parts * (hold + 1 + ceil(pushed)), len(times)) - 1
    come = way.distance(way.place(longer.poses[0, way.body], 0.0))
    back = way.distance(way.place(longer.poses[end, way.body], 0.0))
    track = np.zeros((len(times), 2))
    # Part of its way, px, that it comes at the speed of the hit.
    hit = min(way.speed * frame_time * hold, STRIKER.hit_share * come)
    for sample in range(len(times)):
        # Frames since the push began.
        number = (sample + 1) / parts - 1 - hold
        if number <= 0:
            left = min(-number / max(hold, 1), 1.0)
            away = (come - hit) * left**STRIKER.slows + hit * left
        else:
            gone = max(number - pushed, 0.0) / STRIKER.back
            away = back * min(gone, 1.0) ** STRIKER.slows
        pose = longer.poses[min(sample, end), way.body]
        track[sample] = way.place(pose, away)
    return track


def _with_bodies(longer: Trajectory, tracks: Sequence[F64]) -> Trajectory:
    """Return the trajectory with the strikers as more bodies."""
    poses = [longer.poses]
    for track in tracks:
        still = np.zeros((len(track), 1))
        poses.append(np.concatenate([track, still], axis=1)[:, None])
    turns = longer.turns
    if turns.size:
        unturned = np.zeros((len(turns), len(tracks), 4))
        unturned[..., 0] = 1
        turns = np.concatenate([turns, unturned], axis=1)
    names = (*longer.names, *(f"striker {k}" for k in range(len(tracks))))
    return replace(
        longer, poses=np.concatenate(poses, axis=1), turns=turns, names=names
    )


def _with_sprites(
    stage: Stage,
    form: Form,
    ways: Sequence[_Way],
    tracks: Sequence[F64],
    fine_motion: Trajectory,
) -> Stage:
    """Return the stage with the strikers in front of all objects."""
    sprites = list(stage.sprites)
    starts = list(stage.starts)
    if not starts:
        starts = [Pose(*pose) for pose in fine_motion.poses[0].tolist()]
    actors, casts = list(stage.actors), []
    for number, (way, track) in enumerate(zip(ways, tracks, strict=True)):
        start = track[0]
        body = fine_motion.poses.shape[1] + number
        placement = Placement(
            start, way.axis, way.length(track), way.scale, way.is_from_side
        )
        sprite = draw_striker(stage, form, placement, body)
        sprites.append(sprite)
        starts.append(Pose(float(start[0]), float(start[1]), 0.0))
        thickness = 2 * form.tip * way.scale
        actors.append(ShadowBody(None, thickness))
        casts.append(_striker_cast(sprite, start, thickness))
    stage = replace(stage, sprites=sprites, starts=starts)
    if stage.actors:
        stage = replace(stage, actors=actors)
    return _with_casts(stage, casts)


def _striker_cast(sprite: Sprite, start: F64, thickness: float) -> CastShadow:
    """Return the shadow of a striker, which the photo does not have."""
    figure = Silhouette(
        sprite.coverage, sprite.corner, (start[0], start[1]), None, thickness, None
    )
    empty_shadow = ((0, 0, 1, 1), np.zeros((1, 1), np.float32))
    return CastShadow(figure, 2, None, empty_shadow, None, False)


def _with_casts(stage: Stage, casts: Sequence[CastShadow]) -> Stage:
    """Return the stage with the shadows of more sprites, without veils and mirrors."""
    empty = [None] * len(casts)
    background = stage.lit_background
    mirror = stage.mirror
    veils = stage.veils
    if background is not None:
        background = replace(background, casts=[*background.casts, *casts])
    if mirror is not None:
        mirror = replace(mirror, feet=[*mirror.feet, *empty])
    if veils is not None:
        veils = [*veils, *empty]
    return replace(stage, lit_background=background, mirror=mirror, veils=veils)
