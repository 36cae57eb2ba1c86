"""Follow the objects of a scene through a film, by registration of their templates.

Each frame is explained as the background with all templates on it, the farthest first. The
nearest objects are registered first, since they hide others. An object is lost if its
template does not explain its pixels.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import cos, hypot, nan, pi, sin

import numpy as np

from physgen.arrays import F32, F64, U8, Mask
from physgen.compile.world import World
from physgen.fit.registration import (
    REGISTRATION,
    Match,
    Patch,
    brightness,
    disc_turn,
    find_pose,
    phase_shift,
)
from physgen.fit.template import Template, Window, make_templates, window_around
from physgen.fit.tracks import Tracks
from physgen.photometry import decode
from physgen.progress import Progress, silent
from physgen.render.stage import Stage


@dataclass(frozen=True)
class FollowerTuning:
    """Limits of the search for an object in a frame."""

    max_pose_error: float = 0.3
    """Error of a pose in the first frame, px, at most; a larger one is a wrong match."""
    hiding_coverage: float = 0.02
    """Coverage by a nearer object from which a pixel does not count."""
    min_gain: float = 0.4
    """Gain of a match, at least; with less gain the object is lost."""
    reliable_gain: float = 0.75
    """Gain below which phase correlation is tried."""
    search_margin: float = 2.0
    """Reach of phase correlation to each side, in sizes of the template."""
    residual_share: float = 0.9
    """Unexplained difference at a better angle of a disc, as a share, at most."""
    coasting_frames: int = 8
    """Number of frames for which the motion of a lost object is extrapolated."""


FOLLOWER = FollowerTuning()


@dataclass
class _State:
    """Pose and velocity of an object between two frames."""

    pose: F64
    velocity: F64 = field(default_factory=lambda: np.zeros(3))
    """Change of the pose per frame."""
    hidden_frames: int = 0
    """Number of frames since the last observation."""

    def next_pose(self) -> F64:
        """Return the expected pose in the next frame."""
        return self.pose + self.velocity

    def observe(self, pose: F64) -> None:
        """Update the state by an observed pose."""
        # After hidden frames, the motion since the last observation is spread over
        # them.
        self.velocity = (pose - self.pose) / (self.hidden_frames + 1)
        self.pose, self.hidden_frames = pose, 0

    def skip_frame(self) -> None:
        """Update the state by a frame without an observation."""
        self.hidden_frames += 1
        if self.hidden_frames == FOLLOWER.coasting_frames:
            self.velocity = np.zeros(3)


class Follower:
    """Follows all objects from frame to frame."""

    def __init__(self, templates: Sequence[Template], background: U8, world: World):
        self.templates = templates
        self.background = decode(background)
        self.body_count = len(world.bodies)
        self.states = {}
        for template in templates:
            self.states[template.body] = _State(np.array([*template.center, 0.0]))
        self.errors = np.zeros((self.body_count, 3))
        """(N, 3): errors of poses in the first frame, along the objects' own axes."""

    def calibrate(self, first_frame: U8) -> None:
        """Measure the errors of the scene's poses in the first frame."""
        picture = brightness(decode(first_frame))
        starts = {body: state.pose for body, state in self.states.items()}
        for k, template in enumerate(self.templates):
            patch = self._patch_around(k, starts, picture, 0.0)
            start = starts[template.body]
            match = find_pose(template, start, patch, REGISTRATION.blurs[-1:])
            if match is None or not match.is_stationary:
                continue
            error = match.pose - start
            largest = np.abs(error * [1, 1, template.gyration]).max()
            if largest < FOLLOWER.max_pose_error:
                self.errors[template.body] = error

    def follow(self, frame: U8) -> F64:
        """Return the poses (N, 3) in the next frame, NaN for objects out of sight."""
        picture = brightness(decode(frame))
        poses = {body: state.next_pose() for body, state in self.states.items()}
        # The first pass places all objects roughly, so that the second pass knows the
        # pixels of each object and of its background.
        self._register_all(poses, picture, is_last_pass=False)
        matches = self._register_all(poses, picture, is_last_pass=True)
        observations = np.full((self.body_count, 3), nan)
        for body, match in matches.items():
            if match.gain >= FOLLOWER.min_gain:
                # The scene's pose of an object may be off by a constant: the tracks are
                # relative to it.
                error = self._rotated_error(body, match.pose)
                observations[body] = match.observed_pose() - error
        for body, state in self.states.items():
            if np.isfinite(observations[body, 0]):
                state.observe(poses[body])
            else:
                state.skip_frame()
        return observations

    def _register_all(
        self, poses: dict[int, F64], picture: F32, *, is_last_pass: bool
    ) -> dict[int, Match]:
        """Return the matches by body, and write their poses into `poses`."""
        matches = {}
        # The nearest object comes first, since it may hide the others.
        for k in reversed(range(len(self.templates))):
            body = self.templates[k].body
            # A hidden object must not push its neighbours aside.
            if self.states[body].hidden_frames and not is_last_pass:
                continue
            match = self._match(k, poses, picture)
            if match is not None:
                poses[body] = match.pose
                matches[body] = match
        return matches

    def _rotated_error(self, body: int, pose: F64) -> F64:
        """Return the error (3,) of the first frame, turned with the object."""
        cosine = cos(pose[2])
        sine = sin(pose[2])
        x, y, angle = self.errors[body].tolist()
        return np.array([cosine * x - sine * y, sine * x + cosine * y, angle])

    def _match(self, k: int, poses: Mapping[int, F64], picture: F32) -> Match | None:
        """Return the match of an object with position and angle."""
        match = self._match_position(k, poses, picture)
        template = self.templates[k]
        if match is None or not template.is_circle or not template.can_turn:
            return match
        # The outline of a disc does not show its angle, and Gauss-Newton steps miss the
        # narrow valley of a thin mark.
        other_poses = {**poses, template.body: match.pose}
        patch = self._patch_around(k, other_poses, picture, 0.0)
        expected_angle = float(poses[template.body][2])
        turn = disc_turn(template, match.pose, patch, expected_angle)
        if abs(turn) < pi / REGISTRATION.disc_angles:
            return match
        pose = match.pose + np.array([0.0, 0.0, turn])
        turned_match = find_pose(template, pose, patch, REGISTRATION.blurs[-1:])
        if turned_match is None:
            return match
        # Spokes have the same picture after a part of a turn.
        limit = FOLLOWER.residual_share * (1 - match.gain)
        if 1 - turned_match.gain > limit:
            return match
        return turned_match

    def _match_position(
        self, k: int, poses: Mapping[int, F64], picture: F32
    ) -> Match | None:
        """Return the match near the expected pose, or else by phase correlation."""
        template = self.templates[k]
        start = poses[template.body]
        patch = self._patch_around(k, poses, picture, 0.0)
        match = find_pose(template, start, patch, REGISTRATION.blurs[-1:])
        if match is not None:
            is_reliable = match.gain >= FOLLOWER.reliable_gain
            if is_reliable and match.is_stationary:
                return match
        # After an impact the object is outside the valley around the expected pose.
        large_patch = self._patch_around(k, poses, picture, FOLLOWER.search_margin)
        if min(large_patch.window.size) < REGISTRATION.smallest_side:
            return match
        jump = start + phase_shift(template, start, large_patch)
        for candidate in (start, jump):
            other = find_pose(template, candidate, large_patch, REGISTRATION.blurs)
            if other is not None and (match is None or other.gain > match.gain):
                match = other
        return match

    def _patch_around(
        self, k: int, poses: Mapping[int, F64], picture: F32, margin: float
    ) -> Patch:
        """Return the neighbourhood of an object, with the other objects in `poses`.

        `margin` is the width of the border around the object, in its sizes.
        """
        template = self.templates[k]
        pose = poses[template.body]
        reach = template.reach * (1 + margin)
        window = window_around(pose, reach, picture.shape)
        background = window.crop(self.background).copy()
        cover = np.zeros(background.shape[:2], np.float32)
        for j, other in enumerate(self.templates):
            other_pose = poses[other.body]
            distance = hypot(*(other_pose[:2] - pose[:2]).tolist())
            if j == k or distance > reach + other.reach or not min(window.size):
                continue
            paint = other.draw(other_pose, window)
            if j < k:
                # A farther object belongs to the background.
                background = paint[..., :3] + (1 - paint[..., 3:]) * background
            elif self.states[other.body].hidden_frames == 0:
                # A nearer object hides this one, if its own pose is known.
                cover = np.maximum(cover, paint[..., 3])
        open_mask = cover <= FOLLOWER.hiding_coverage
        return Patch(window, window.crop(picture), background, open_mask)


def follow_film(
    frames: Iterator[U8],
    times: F64,
    stage: Stage,
    world: World,
    has_photo: bool,
    progress: Progress = silent,
) -> Tracks:
    """Return the tracks of all objects in a film; its first frame shows the scene."""
    first_frame = next(frames)
    templates = make_templates(stage, world, first_frame, has_photo)
    follower = Follower(templates, stage.background, world)
    follower.calibrate(first_frame)
    # The scene states the poses of the first frame.
    starts = np.full((len(world.bodies), 3), nan)
    for template in templates:
        starts[template.body] = (*template.center, 0.0)
    frame_poses = [starts]
    for k, frame in enumerate(frames, 1):
        progress("track", k, len(times))
        frame_poses.append(follower.follow(frame))
    poses = np.array(frame_poses)
    names = tuple(body.name for body in world.bodies)
    losses = []
    for body, time in _find_losses(templates, poses, times, first_frame):
        losses.append((names[body], time))
    return Tracks(times[: len(poses)], names, poses, tuple(losses))


def _find_losses(
    templates: Sequence[Template], poses: F64, times: F64, frame: U8
) -> list[tuple[int, float]]:
    """Return bodies lost in plain sight, with the time of their last observation, s."""
    losses = []
    for k, template in enumerate(templates):
        last = _last_observation(poses, template.body)
        # An object that leaves or hides is not lost.
        is_lost = last < len(poses) - 1
        if is_lost and not _moves_out_of_sight(templates, k, poses, frame):
            losses.append((template.body, float(times[last])))
    return sorted(losses)


def _last_observation(poses: F64, body: int) -> int:
    """Return the last frame with an observation; the first frame always has one."""
    return int(np.flatnonzero(np.isfinite(poses[:, body, 0]))[-1])


def _moves_out_of_sight(
    templates: Sequence[Template], k: int, poses: F64, frame: U8
) -> bool:
    """Return whether the last motion leads out of the picture or behind other objects."""
    template = templates[k]
    last = _last_observation(poses, template.body)
    pose = np.nan_to_num(poses[last, template.body])
    step = _last_step(poses[: last + 1], template.body)
    window = Window((0, 0), (frame.shape[1], frame.shape[0]))
    # The last velocity says nothing about much later frames.
    end = min(last + 1 + FOLLOWER.coasting_frames, len(poses))
    for index in range(last + 1, end):
        # The object keeps its last velocity.
        pose = pose + step
        visible_mask = template.draw(pose, window)[..., 3] > 0.5
        for nearer in templates[k + 1 :]:
            # Templates are ordered from far to near, so that later ones may hide it.
            visible_mask &= ~_cover_mask(nearer, poses[: index + 1], window)
        if visible_mask.sum() < REGISTRATION.min_visible_share * template.area:
            return True
    return False


def _last_step(poses: F64, body: int) -> F64:
    """Return the motion (x, y, 0) of an observed object up to the last frame, px/frame."""
    last = len(poses) - 1
    if last:
        previous = _last_observation(poses[:last], body)
    else:
        previous = last
    step = (poses[last, body] - poses[previous, body]) / max(last - previous, 1)
    return np.array([step[0], step[1], 0.0])


def _cover_mask(template: Template, poses: F64, window: Window) -> Mask:
    """Return the pixels of a window that an object covers in its last observed pose."""
    pose = np.nan_to_num(poses[_last_observation(poses, template.body), template.body])
    coverage = template.draw(pose, window)[..., 3]
    return np.asarray(coverage > FOLLOWER.hiding_coverage)
