"""Follow the objects of a scene through a film, by registration of their sprites.

Every object is a sprite, cut out of the first frame. A frame is explained as the
background with the sprites on it, the farthest first: the pose of a sprite is where the
picture made so differs least from the frame. Phase correlation finds it roughly if it
jumped, and Gauss-Newton steps to hundredths of a pixel. Pixels that nearer objects cover
count for nothing, and an object that no longer explains its pixels is lost.

Pictures are mixed in linear light, as a camera does: mixed in codes, a border between
light and dark moves by tenths of a pixel. Differences are those of the square root of
light, whose noise is nearly even, in codes from 0 to 255.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import ceil, cos, hypot, nan, sin

import cv2
import numpy as np

from physgen.arrays import F32, F64, U8
from physgen.compile.world import Body, World
from physgen.fit.tracks import Tracks
from physgen.photometry import decode
from physgen.progress import Progress, silent
from physgen.render.stage import Stage


@dataclass(frozen=True)
class TrackTuning:
    """Steps, windows and limits of the registration."""

    smallest: int = 3
    """px: the shorter side of a window."""
    margin: int = 6
    """px of a window around a sprite."""
    blurs: tuple[float, ...] = (3.0, 0.0)
    """px, standard deviations: wide ones have a wider valley."""
    steps: int = 8
    """Gauss-Newton steps for each blur, at most."""
    delta: float = 0.25
    """px of a difference quotient; angles by the radius of gyration."""
    converged: float = 0.004
    """px of a step that is the last."""
    longest: float = 6.0
    """px of a step, at most."""
    robust: float = 12.0
    """Codes from which a pixel's difference counts less."""
    cover: float = 0.02
    """Coverage by a nearer object from which a pixel is left out."""
    visible: float = 0.3
    """Of a sprite's pixels, below which it is not registered."""
    gain: float = 0.4
    """Share of the difference that the sprite must explain, or it is lost."""
    poor: float = 0.75
    """The same, below which phase correlation is tried."""
    turning: float = 0.004
    """Share of a shift's information that an angle must have, to be observed."""
    searched: float = 2.0
    """Of a sprite's size: how far phase correlation looks to each side."""
    missing: int = 8
    """Frames after which the motion of a lost object is no longer extrapolated."""


TRACK = TrackTuning()
CODES = 255.0
"""Brightness of white."""


@dataclass(frozen=True)
class Template:
    """The picture of one object at the start."""

    body: int
    corner: tuple[int, int]
    """Column and row of its first pixel."""
    paint: F32
    """(h, w, 4): linear light multiplied by coverage, and the coverage."""
    center: tuple[float, float]
    """px: of mass, about which it turns."""
    gyration: float
    """px: radius of gyration."""
    can_turn: bool
    """Whether its picture turns in the plane: not of spheres seen from above."""

    def transform(self, pose: F64, origin: tuple[int, int]) -> F64:
        """Return the affine map (2, 3) of its pixels to a window at `origin`."""
        x, y, angle = pose.tolist()
        c, s = cos(angle), sin(angle)
        left = self.corner[0] - self.center[0]
        top = self.corner[1] - self.center[1]
        shift_x = c * left - s * top + x - origin[0]
        shift_y = s * left + c * top + y - origin[1]
        return np.array([[c, -s, shift_x], [s, c, shift_y]])

    def drawn(self, pose: F64, window: Window) -> F32:
        """Return its paint (H, W, 4) on a window."""
        matrix = self.transform(pose, window.origin)
        size = window.size
        return np.asarray(cv2.warpAffine(self.paint, matrix, size), np.float32)

    @property
    def reach(self) -> float:
        """Return the distance of its farthest corner from the centre, px."""
        height, width = self.paint.shape[:2]
        left = self.center[0] - self.corner[0]
        top = self.center[1] - self.corner[1]
        return hypot(max(left, width - left), max(top, height - top))


@dataclass(frozen=True)
class Window:
    """A part of the picture."""

    origin: tuple[int, int]
    size: tuple[int, int]
    """Width and height; zero if it lies outside."""

    def of(self, picture: F32) -> F32:
        """Return the pixels of a picture."""
        (x, y), (width, height) = self.origin, self.size
        return picture[y : y + height, x : x + width]


def window_around(pose: F64, reach: float, shape: Sequence[int]) -> Window:
    """Return the window of a reach around a pose, within a picture's shape."""
    height, width = shape[:2]
    margin = ceil(reach) + TRACK.margin
    x, y = round(float(pose[0])), round(float(pose[1]))
    left, right = max(x - margin, 0), min(x + margin + 1, width)
    top, bottom = max(y - margin, 0), min(y + margin + 1, height)
    return Window((left, top), (max(right - left, 0), max(bottom - top, 0)))


def templates_of(
    stage: Stage, world: World, first: U8, has_photo: bool
) -> list[Template]:
    """Return the templates of a scene's sprites, the farthest first.

    With a photo they are cut out of the film's first frame.
    """
    templates = []
    height, width = first.shape[:2]
    for sprite in stage.sprites:
        body = world.bodies[sprite.body]
        alpha = np.asarray(sprite.coverage, np.float32)
        tall, wide = alpha.shape
        left, top = sprite.corner
        light = np.asarray(sprite.light, np.float32)
        if has_photo:
            rows = np.clip(np.arange(top, top + tall), 0, height - 1)
            columns = np.clip(np.arange(left, left + wide), 0, width - 1)
            light = decode(first[rows][:, columns]) * alpha[..., None]
        paint = np.dstack([light, alpha]).astype(np.float32)
        x, y = body.center.tolist()
        templates.append(
            Template(
                body=sprite.body,
                corner=(left, top),
                paint=paint,
                center=(x, y),
                gyration=max((body.moment / body.mass) ** 0.5, 1.0),
                can_turn=not _rolls_in_space(body, world),
            )
        )
    return templates


def _rolls_in_space(body: Body, world: World) -> bool:
    return world.press > 0 and body.solid.value == "sphere"


@dataclass
class _State:
    """What is known of an object while it is followed."""

    pose: F64
    velocity: F64 = field(default_factory=lambda: np.zeros(3))
    """Per frame."""
    missing: int = 0
    """Frames since it was last seen."""

    def predicted(self) -> F64:
        """Return the pose in the next frame."""
        return self.pose + self.velocity

    def observe(self, pose: F64) -> None:
        """Take the pose of a frame in which it is seen."""
        self.velocity = (pose - self.pose) / (self.missing + 1)
        self.pose, self.missing = pose, 0

    def pass_by(self) -> None:
        """Take a frame in which it is not seen."""
        self.missing += 1
        if self.missing == TRACK.missing:
            self.velocity = np.zeros(3)


class Follower:
    """Follows all objects from frame to frame."""

    def __init__(self, templates: Sequence[Template], background: U8, world: World):
        self.templates = templates
        self.background = decode(background)
        self.count = len(world.bodies)
        self.states = {}
        for template in templates:
            self.states[template.body] = _State(np.array([*template.center, 0.0]))

    def follow(self, frame: U8) -> F64:
        """Return the poses (N, 3) of the next frame, NaN where an object is not seen."""
        picture = _brightness(decode(frame))
        current = {body: state.predicted() for body, state in self.states.items()}
        poses = np.full((self.count, 3), nan)
        for is_last in (False, True):
            # the nearest first, since it may hide the others
            for k in reversed(range(len(self.templates))):
                body = self.templates[k].body
                if self.states[body].missing and not is_last:
                    continue
                match = self._match(k, current, picture)
                if match is not None:
                    current[body] = match.pose
                if is_last and match is not None and match.gain >= TRACK.gain:
                    poses[body] = match.observed()
        for body, state in self.states.items():
            if np.isfinite(poses[body, 0]):
                state.observe(current[body])
            else:
                state.pass_by()
        return poses

    def _match(self, k: int, current: dict[int, F64], picture: F32) -> _Match | None:
        """Return where an object is, near the expected pose or else by phase correlation."""
        template = self.templates[k]
        start = current[template.body]
        near = self._scene_without(k, current, picture, 0.0)
        match = _descend(template, start, near, TRACK.blurs[-1:])
        if match is not None and match.gain >= TRACK.poor:
            return match
        wide = self._scene_without(k, current, picture, TRACK.searched)
        if min(wide.window.size) < TRACK.smallest:
            return match
        shifted = start + _phase_shift(template, start, wide)
        for place in (start, shifted):
            other = _descend(template, place, wide, TRACK.blurs)
            if other is not None and (match is None or other.gain > match.gain):
                match = other
        return match

    def _scene_without(
        self, k: int, poses: dict[int, F64], picture: F32, searched: float
    ) -> _Scene:
        """Return the frame around an object, what lies behind it, and what hides it.

        `searched` is the share of its size that is seen beyond it.
        """
        template = self.templates[k]
        pose = poses[template.body]
        reach = template.reach * (1 + searched)
        window = window_around(pose, reach, picture.shape)
        behind = window.of(self.background).copy()
        hidden = np.zeros(behind.shape[:2], np.float32)
        for j, other in enumerate(self.templates):
            place = poses[other.body]
            gap = hypot(*(place[:2] - pose[:2]).tolist())
            if j == k or gap > reach + other.reach or not min(window.size):
                continue
            paint = other.drawn(place, window)
            if j < k:
                behind = paint[..., :3] + (1 - paint[..., 3:]) * behind
            elif self.states[other.body].missing == 0:
                hidden = np.maximum(hidden, paint[..., 3])
        return _Scene(window, window.of(picture), behind, hidden <= TRACK.cover)


@dataclass(frozen=True)
class _Scene:
    """The neighbourhood of one object in one frame."""

    window: Window
    frame: F32
    """(h, w, 3): brightness."""
    behind: F32
    """(h, w, 3): linear light of the picture without the object."""
    is_open: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    """(h, w): where no nearer object hides it."""

    def part(self, window: Window) -> _Scene:
        """Return a smaller window of it."""
        shift = (
            window.origin[0] - self.window.origin[0],
            window.origin[1] - self.window.origin[1],
        )
        inner = Window(shift, window.size)
        mask = inner.of(self.is_open.astype(np.float32)) > 0
        return _Scene(window, inner.of(self.frame), inner.of(self.behind), mask)

    def blurred(self, sigma: float) -> _Scene:
        """Return it out of focus."""
        if not sigma:
            return self
        light = (self.frame / CODES) ** 2
        frame = _brightness(np.asarray(cv2.GaussianBlur(light, (0, 0), sigma)))
        behind = np.asarray(cv2.GaussianBlur(self.behind, (0, 0), sigma), np.float32)
        return _Scene(self.window, frame, behind, self.is_open)


@dataclass(frozen=True)
class _Match:
    """A registered pose."""

    pose: F64
    gain: float
    """Share of the difference from the background that the sprite explains."""
    turns: bool
    """Whether its picture tells its angle."""

    def observed(self) -> F64:
        """Return the pose, without an angle that is not observed."""
        x, y, angle = self.pose.tolist()
        return np.array([x, y, angle if self.turns else nan])


def _phase_shift(template: Template, start: F64, scene: _Scene) -> F64:
    """Return the shift (x, y, 0) px by which phase correlation finds an object."""
    paint = template.drawn(start, scene.window)
    behind = _brightness(scene.behind)
    expected = np.abs(_mixed(paint, scene.behind) - behind).sum(axis=2)
    difference = np.abs(scene.frame - behind).sum(axis=2) * scene.is_open
    hanning = cv2.createHanningWindow(scene.window.size, cv2.CV_32F)
    first, second = expected.astype(np.float32), difference.astype(np.float32)
    (x, y), _ = cv2.phaseCorrelate(first, second, hanning)
    return np.array([x, y, 0.0])


def _descend(
    template: Template, start: F64, scene: _Scene, blurs: Sequence[float]
) -> _Match | None:
    """Return the pose nearest to a start where the sprite explains the frame."""
    window = window_around(start, template.reach, (*_far_edge(scene.window),))
    window = _within(window, scene.window)
    if min(window.size) < TRACK.smallest:
        return None
    near = scene.part(window)
    pose, turns = start.copy(), False
    for sigma in blurs:
        sight = near.blurred(sigma)
        for _ in range(TRACK.steps):
            step, turns = _step(template, pose, sight, sigma)
            pose = pose + step
            if np.abs(step * [1, 1, template.gyration]).max() < TRACK.converged:
                break
    return _judged(template, pose, near, turns)


def _far_edge(window: Window) -> tuple[int, int]:
    """Return the height and width up to which a window reaches."""
    return window.origin[1] + window.size[1], window.origin[0] + window.size[0]


def _within(window: Window, outer: Window) -> Window:
    """Return the part of a window inside another one."""
    left = max(window.origin[0], outer.origin[0])
    top = max(window.origin[1], outer.origin[1])
    width = window.origin[0] + window.size[0] - left
    height = window.origin[1] + window.size[1] - top
    return Window((left, top), (max(width, 0), max(height, 0)))


def _predicted(template: Template, pose: F64, scene: _Scene, sigma: float) -> F32:
    """Return the brightness (h, w, 3) with the object in a pose; `behind` is blurred already."""
    paint = template.drawn(pose, scene.window)
    if sigma:
        paint = np.asarray(cv2.GaussianBlur(paint, (0, 0), sigma), np.float32)
    return _mixed(paint, scene.behind)


def _mixed(paint: F32, behind: F32) -> F32:
    """Return the brightness (h, w, 3) of a sprite's paint on the light behind it."""
    return _brightness(paint[..., :3] + (1 - paint[..., 3:]) * behind)


def _brightness(light: F32) -> F32:
    """Return the square root of linear light, in codes from 0 to 255."""
    return np.asarray(CODES * np.sqrt(np.maximum(light, 0.0)), np.float32)


def _step(
    template: Template, pose: F64, scene: _Scene, sigma: float
) -> tuple[F64, bool]:
    """Return one Gauss-Newton step, and whether the picture tells the angle."""
    residual = (scene.frame - _predicted(template, pose, scene, sigma))[scene.is_open]
    distance = np.abs(residual).mean(axis=-1, keepdims=True)
    weight = 1.0 / np.maximum(1.0, (distance / TRACK.robust) ** 2)
    deltas = np.array([TRACK.delta, TRACK.delta, TRACK.delta / template.gyration])
    slopes = []
    for k in range(3 if template.can_turn else 2):
        shift = np.zeros(3)
        shift[k] = deltas[k]
        upper = _predicted(template, pose + shift, scene, sigma)
        lower = _predicted(template, pose - shift, scene, sigma)
        slopes.append(((upper - lower)[scene.is_open] / (2 * TRACK.delta)).ravel())
    matrix = np.array(slopes, np.float64)
    weights = np.broadcast_to(weight, residual.shape).ravel()
    normal = (matrix * weights) @ matrix.T
    right = (matrix * weights) @ residual.ravel()
    turns = len(normal) == 3
    if turns:
        information = (normal[0, 0] + normal[1, 1]) / 2
        turns = bool(normal[2, 2] > TRACK.turning * information)
    size = 3 if turns else 2
    damping = 1e-3 * np.trace(normal[:size, :size]) / size + 1e-9
    part = np.linalg.solve(normal[:size, :size] + damping * np.eye(size), right[:size])
    part *= min(1.0, TRACK.longest / max(float(np.abs(part).max()), 1e-9))
    step = np.zeros(3)
    step[:size] = part
    step[2] /= template.gyration
    return step, turns


def _judged(template: Template, pose: F64, scene: _Scene, turns: bool) -> _Match | None:
    """Return the match of a pose with its gain, None if too little is visible."""
    paint = template.drawn(pose, scene.window)
    inside = (paint[..., 3] > 0.5) & scene.is_open
    area = float((template.paint[..., 3] > 0.5).sum())
    if inside.sum() < TRACK.visible * area:
        return None
    difference = (scene.frame - _predicted(template, pose, scene, 0.0))[inside]
    empty = (scene.frame - _brightness(scene.behind))[inside]
    limit = 4 * TRACK.robust
    left = np.minimum(np.abs(difference), limit).mean()
    whole = np.minimum(np.abs(empty), limit).mean()
    gain = 1.0 - float(left) / max(float(whole), 1.0)
    return _Match(pose, gain, turns)


def follow_film(
    frames: Iterator[U8],
    times: F64,
    stage: Stage,
    world: World,
    has_photo: bool,
    progress: Progress = silent,
) -> Tracks:
    """Return the tracks of all objects of a film, whose first frame is the photo's moment."""
    first = next(frames)
    templates = templates_of(stage, world, first, has_photo)
    follower = Follower(templates, stage.background, world)
    starts = np.full((len(world.bodies), 3), nan)
    for template in templates:
        starts[template.body] = (*template.center, 0.0)
    poses = [starts]
    for k, frame in enumerate(frames, 1):
        progress("track", k, len(times))
        poses.append(follower.follow(frame))
    names = tuple(body.name for body in world.bodies)
    observed = np.array(poses)
    losses = []
    for k, template in enumerate(templates):
        last = _last_seen(observed, template.body)
        is_lost = last < len(observed) - 1
        if is_lost and not _goes_out_of_sight(templates, k, observed, first):
            losses.append((template.body, float(times[last])))
    named = tuple((names[body], time) for body, time in sorted(losses))
    return Tracks(times[: len(poses)], names, observed, named)


def _last_seen(poses: F64, body: int) -> int:
    """Return the last frame in which an object is seen; it is in the first one."""
    return int(np.flatnonzero(np.isfinite(poses[:, body, 0]))[-1])


def _goes_out_of_sight(
    templates: Sequence[Template], k: int, poses: F64, frame: U8
) -> bool:
    """Return whether an object's last motion leads out of the picture or behind others."""
    template = templates[k]
    last = _last_seen(poses, template.body)
    pose = np.nan_to_num(poses[last, template.body])
    step = _last_step(poses[: last + 1], template.body)
    area = float((template.paint[..., 3] > 0.5).sum())
    window = Window((0, 0), (frame.shape[1], frame.shape[0]))
    for later in range(last + 1, min(last + 1 + TRACK.missing, len(poses))):
        pose = pose + step
        is_visible = template.drawn(pose, window)[..., 3] > 0.5
        for nearer in templates[k + 1 :]:
            is_visible &= ~_covered(nearer, poses[: later + 1], window)
        if is_visible.sum() < TRACK.visible * area:
            return True
    return False


def _last_step(poses: F64, body: int) -> F64:
    """Return the motion (x, y, 0) px per frame of an object that the last frame shows."""
    last = len(poses) - 1
    before = _last_seen(poses[:last], body) if last else last
    step = (poses[last, body] - poses[before, body]) / max(last - before, 1)
    return np.array([step[0], step[1], 0.0])


def _covered(
    template: Template, poses: F64, window: Window
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return where an object covers a window, as it was last seen."""
    pose = np.nan_to_num(poses[_last_seen(poses, template.body), template.body])
    return np.asarray(template.drawn(pose, window)[..., 3] > TRACK.cover)
