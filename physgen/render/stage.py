"""What is drawn: sprites, background and their placement at each sample."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil, cos, exp, floor, hypot, isfinite, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Array, Pose, rotation
from physgen.geometry.shadows import F32
from physgen.maps import U8, U16
from physgen.render.shadow_decomposition import LitBackground
from physgen.render.sprites import Sprite
from physgen.simulate.trajectory import Trajectory
from physgen.simulate.trajectory import rotation_matrices as in_space

Slices = tuple[slice, slice]

LEAVES = 0.1
"""Of an object's size: moved by as much, it takes what the photo shows around it, of rims and shadows, with it."""
FAINT = 0.02
"""Share of a halo that nobody sees."""
FADE = 3.0
"""px of motion over which the photo's own border pixels give way to the object's clean ones."""
SPREAD = 1.5
"""px beyond its pixels that a warped picture may reach."""
WARP_FLAGS = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


@dataclass(frozen=True)
class Placement:
    """Where a sprite falls on the canvas."""

    box: Slices
    """Rows and columns of the canvas."""
    own: Slices | None = None
    """At rest: the same on the sprite, whose pixels are then the photo's."""
    matrix: Array | None = None
    """(2, 3) Moved: pixel of the box -> pixel of the sprite."""
    turn: float = 0.0
    """rad by which the sprite's picture turns."""
    space: Array | None = None
    """(3, 3) A ball: how its skin has turned."""
    shift: tuple[float, float] = (0.0, 0.0)
    """px by which the centre has moved."""
    wheel_turns: tuple[float, ...] = ()
    """rad, of each of the sprite's wheels."""


def place_sprite(
    sprite: Sprite, start: Pose, pose: Pose, size: tuple[int, int], space: Array | None
) -> Placement | None:
    """Where the sprite falls on a canvas of `size` (W, H); None when outside.

    `space` (3, 3): a ball's turn so far; None where it has none, or only the angle is known.
    """
    x0, y0 = sprite.corner
    turn = pose.angle - start.angle
    if turn == 0.0 and pose[:2] == start[:2] and (sprite.ball is None or space is None):
        height, width = sprite.coverage.shape  # at rest: the photo's own pixels
        left, top = max(-x0, 0), max(-y0, 0)
        right, bottom = min(width, size[0] - x0), min(height, size[1] - y0)
        if left >= right or top >= bottom:
            return None
        return Placement(
            np.s_[y0 + top : y0 + bottom, x0 + left : x0 + right],
            np.s_[top:bottom, left:right],
        )
    if not sprite.hull:
        return None
    if sprite.ball is not None:
        return _rolled(sprite, start, pose, size, space)
    start, pose = (at._replace(y=at.y + sprite.face) for at in (start, pose))
    c, s = cos(turn), sin(turn)
    away = [
        (x - start.x, y - start.y) for x, y in sprite.hull
    ]  # a dozen points: quicker than arrays
    xs, ys = (
        [c * x - s * y + pose.x for x, y in away],
        [s * x + c * y + pose.y for x, y in away],
    )
    above = SPREAD + (0.0 if sprite.sides is None else sprite.sides.depth)
    box = _boxed(
        min(xs) - SPREAD, min(ys) - above, max(xs) + SPREAD, max(ys) + SPREAD, size
    )
    if box is None:
        return None
    # canvas pixel p (from the box's corner) comes from sprite pixel R^-1 (p + box - pose) + start - corner
    dx, dy = box[1].start - pose.x, box[0].start - pose.y
    matrix = np.array(
        [
            [c, s, c * dx + s * dy + start.x - x0],
            [-s, c, c * dy - s * dx + start.y - y0],
        ]
    )
    return Placement(box, matrix=matrix, turn=turn)


def _rolled(
    sprite: Sprite, start: Pose, pose: Pose, size: tuple[int, int], space: Array | None
) -> Placement | None:
    """`placed` of a ball: its picture moves without turning, its skin alone turns."""
    if space is None:
        space = np.eye(3)
        space[:2, :2] = rotation(pose.angle - start.angle)
    dx, dy = pose.x - start.x, pose.y - start.y
    lx, ly, hx, hy = sprite.within
    x, y = sprite.corner[0] + dx, sprite.corner[1] + dy
    box = _boxed(x + lx - 1, y + ly - 1, x + hx, y + hy, size)
    if box is None:
        return None
    matrix = np.array([[1.0, 0, box[1].start - x], [0, 1, box[0].start - y]])
    return Placement(box, None, matrix, 0.0, space, (dx, dy))


def _boxed(
    lx: float, ly: float, hx: float, hy: float, size: tuple[int, int]
) -> Slices | None:
    """The pixels of a canvas of `size` (W, H) between two corners; None where there are none."""
    if (
        not isfinite(lx + hx + ly + hy)
        or hx < 0
        or hy < 0
        or lx >= size[0]
        or ly >= size[1]
    ):
        return None
    rows = slice(max(floor(ly), 0), min(ceil(hy) + 1, size[1]))
    return rows, slice(max(floor(lx), 0), min(ceil(hx) + 1, size[0]))


def draw_sprite(sprite: Sprite, where: Placement, fine: int = 1) -> tuple[F32, F32]:
    """(h, w, 3) linear light times coverage, and coverage (h, w), on its box; of anything but a ball that moved.

    Where it moved, each pixel is the mean of `fine` x `fine` samples.
    """
    if where.own is not None:
        return sprite.light[where.own], sprite.coverage[where.own]
    assert where.matrix is not None
    rows, columns = where.box
    size = (columns.stop - columns.start, rows.stop - rows.start)
    many = (size[0] * fine, size[1] * fine)
    matrix = _finer(where.matrix, fine)
    warped = cv2.warpAffine(
        sprite.fine, 2 * matrix, many, flags=WARP_FLAGS, borderMode=cv2.BORDER_CONSTANT
    )
    light = np.asarray(
        cv2.cvtColor(warped, cv2.COLOR_BGRA2BGR), np.float32
    )  # the first three channels
    coverage = np.asarray(cv2.extractChannel(warped, 3), np.float32)
    if sprite.relief is not None and where.turn != 0.0:
        ratio = sprite.relief.ratio(where.turn)
        there = cv2.warpAffine(
            ratio, matrix, many, flags=WARP_FLAGS, borderMode=cv2.BORDER_REPLICATE
        )
        light *= three_channels(np.asarray(there, np.float32))
    for wheel, turn in zip(sprite.wheels, where.wheel_turns, strict=False):
        wheel.draw(light, coverage, matrix, turn)
    if sprite.sides is not None and sprite.sides.share(where.turn) > 0:
        kept = sprite.sides.kept(matrix, coverage.shape, where.turn)
        light, coverage = light * three_channels(kept), coverage * kept
    if fine > 1:
        light = np.asarray(
            cv2.resize(light, size, interpolation=cv2.INTER_AREA), np.float32
        )
        coverage = np.asarray(
            cv2.resize(coverage, size, interpolation=cv2.INTER_AREA), np.float32
        )
    return light, coverage


def draw_border(
    sprite: Sprite, where: Placement, left: NDArray[np.float32]
) -> tuple[Slices, F32] | None:
    """A box and (h, w, 3) the share of `Sprite.rest` that still shows there; None: nothing.

    `left` (N + 1,): of what each body leaves on this one, by `borders_left`; 0: of what is its own.
    """
    if sprite.rest is None or not (shares := left[sprite.beside]).any():
        return None
    if (
        where.own is None
        and sprite.ball is not None
        and sprite.ball.pattern is not None
    ):
        return None  # it is painted anew: these are mixtures of the photo's pixels
    rest = sprite.rest
    if shares.min() < 1:
        rest = rest * (
            left[0] if sprite.hider is None else three_channels(left[sprite.hider])
        )
    if where.own is not None:
        return where.box, rest[where.own]
    assert where.matrix is not None
    rows, columns = where.box
    size = (columns.stop - columns.start, rows.stop - rows.start)
    border = cv2.warpAffine(
        rest, where.matrix, size, flags=WARP_FLAGS, borderMode=cv2.BORDER_CONSTANT
    )
    return where.box, np.asarray(border, np.float32)


def borders_left(
    sprites: Sequence[Sprite], there: Sequence[SpritePose]
) -> NDArray[np.float32]:
    """(n, N + 1) of those `there`, in the picture: the share that each body, from 1 on, still leaves on their borders.

    It goes as the two part, however both have moved; 0: what is their own, which goes as they leave their place.
    """
    shifts = np.full(
        (max((sprite.hiders for sprite in sprites), default=0) + 1, 3), np.inf
    )
    shifts[0] = 0
    seen = [sprites[at.k] for at in there]
    turns = [
        0.0 if sprite.ball else at.pose.angle - at.start.angle
        for at, sprite in zip(there, seen, strict=True)
    ]
    moves = [
        (at.pose.x - at.start.x, at.pose.y - at.start.y, turn)
        for at, turn in zip(there, turns, strict=True)
    ]
    own = np.array(moves).reshape(-1, 3)
    shifts[[sprite.body + 1 for sprite in seen]] = own
    far = np.abs(own[:, None] - shifts)
    far[..., 2] *= np.array([max(sprite.coverage.shape) / 2 for sprite in seen])[
        :, None
    ]
    return np.asarray(np.maximum(1 - far.max(axis=2) / FADE, 0), np.float32)


def halos_left(
    sprites: Sequence[Sprite], stands: Sequence[SpritePose]
) -> NDArray[np.float32]:
    """(N + 1,) from 1 on: of each body, the share of what the photo shows around it that it has not taken away."""
    left = np.ones(
        max((sprite.hiders for sprite in sprites), default=0) + 1, np.float32
    )
    for stand in stands:
        sprite = sprites[stand.k]
        side = max(min(sprite.coverage.shape), 1)
        dx, dy = stand.pose.x - stand.start.x, stand.pose.y - stand.start.y
        moved = hypot(dx, dy) / side + abs(stand.pose.angle - stand.start.angle) / 2
        left[sprite.body + 1] = exp(-((moved / LEAVES) ** 2))
    return left


def draw_halo(
    sprite: Sprite, stand: SpritePose, left: NDArray[np.float32]
) -> tuple[Slices, F32] | None:
    """A box of the canvas and (h, w, 3) what still shows of `Sprite.halo` there, by `halos_left`; None: nothing."""
    share = left[sprite.body + 1]
    if sprite.halo is None or stand.where is None or share < FAINT:
        return None
    (x, y), picture, beside = sprite.halo
    box = np.s_[y : y + picture.shape[0], x : x + picture.shape[1]]
    shares = np.minimum(left[beside], share)
    return box, picture if shares.min() == 1 else picture * three_channels(shares)


def sprite_coverage(sprite: Sprite, where: Placement) -> F32:
    """(h, w) the coverage of `drawn` alone."""
    if where.own is not None:
        return sprite.coverage[where.own]
    assert where.matrix is not None
    rows, columns = where.box
    size = (columns.stop - columns.start, rows.stop - rows.start)
    warped = cv2.warpAffine(
        sprite.fine_coverage,
        2 * where.matrix,
        size,
        flags=WARP_FLAGS,
        borderMode=cv2.BORDER_CONSTANT,
    )
    return np.asarray(warped, np.float32)


def _finer(matrix: Array, fine: int) -> Array:
    """(2, 3) from the pixels of a grid `fine` times as fine, where `matrix` is from the pixels."""
    into = (
        np.array([[1, 0, 0.5 - fine / 2], [0, 1, 0.5 - fine / 2], [0, 0, fine]]) / fine
    )
    return matrix @ into if fine > 1 else matrix


def three_channels(values: F32) -> F32:
    """(h, w) -> (h, w, 3): a picture's own shape, which NumPy multiplies far faster than it broadcasts."""
    return np.asarray(cv2.merge((values, values, values)), np.float32)


@dataclass(frozen=True)
class Cover:
    """Where a body is in a picture, what hides it taken away."""

    body: int
    box: Slices
    """Rows and columns of the picture that hold it."""
    mask: NDArray[np.bool_]
    """(h, w) on its box."""


@dataclass(frozen=True)
class SpriteLayer:
    """A sprite as a frame shows it, without what hides it."""

    body: int
    box: Slices
    """Rows and columns of the picture."""
    light: F32
    """(h, w, 3) linear, times coverage."""
    coverage: F32
    """(h, w)."""


@dataclass(frozen=True)
class Layers:
    """A picture taken apart, in linear light; what is mixed at borders is in none of them."""

    plate: F32
    """(H, W, 3): the background in the light that no object keeps away."""
    shaded: F32
    """(H, W, 3): the same with shadows."""
    sprites: Sequence[SpriteLayer]
    """The farthest first."""
    order: Sequence[int]
    """All bodies of the clip, the farthest first."""

    def pictures(self) -> dict[int, F32]:
        """Return (H, W, 4) of each body: light times coverage, and coverage; 0 outside of the picture."""
        pictures = {}
        for body in self.order:
            pictures[body] = np.zeros((*self.plate.shape[:2], 4), np.float32)
        for sprite in self.sprites:
            canvas = pictures[sprite.body][sprite.box]
            canvas *= 1 - sprite.coverage[..., None]
            canvas += np.dstack([sprite.light, sprite.coverage])
        return pictures


@dataclass(frozen=True)
class Frame:
    """One picture of the video."""

    index: int
    time: float
    """s."""
    rgb: U8
    """(H, W, 3) sRGB."""
    named: Callable[[], U16] = field(
        repr=False, compare=False
    )  # works out `ids`: few ask
    covering: Callable[[], Sequence[Cover]] = field(
        default=tuple, repr=False, compare=False
    )
    """Works out `covers`."""
    faces: Mapping[int, float] = field(default_factory=dict, repr=False, compare=False)
    """px of the photo by which the front of a body lies below its centre, where it does."""
    layering: Callable[[], Layers] | None = field(
        default=None, repr=False, compare=False
    )
    """Works out `Layers`, if the stage keeps them."""

    @cached_property
    def ids(self) -> U16:
        """(H, W): body k shows as k + 1, 0 = background."""
        return self.named()

    @cached_property
    def covers(self) -> Sequence[Cover]:
        """Of objects that reach into the picture, the farthest first; a body may be made of several."""
        return self.covering()


@dataclass(frozen=True)
class ShadowBody:
    """What light has to know of a body: as its silhouette, see `shadow.Silhouette`."""

    radius: float | None
    """px, of a sphere."""
    thick: float
    """px."""
    veiled: float = 1.0
    """Share of the shadows of others that is seen on it, 0..1."""


@dataclass(frozen=True)
class Mirror:
    """What a floor mirrors of what stands on it."""

    share: F32
    """(n,): of the light of an object's lowest rows, of each row below its foot."""
    feet: Sequence[tuple[int, float, float] | None]
    """One a sprite: the row of the photo at which it ends, and its floor's end columns; None: it does not stand."""
    rough: float = 2.0
    """px, standard deviation: how much less sharp this is than the object."""


@dataclass(frozen=True)
class Stage:
    """What is drawn: sprites in order, the farthest first, over a background `(H, W, 3)` sRGB."""

    background: U8
    sprites: Sequence[Sprite]
    lit: LitBackground | None = None
    """Where shadows move: the background taken apart, with a cast for each sprite in turn."""
    actors: Sequence[ShadowBody] = ()
    """One a sprite, where there is `lit`."""
    grounds: Sequence[
        Array
    ] = ()  # side view: as `staging.floors` has them, what shadows fall on from above.
    veils: Sequence[F32 | None] | None = None
    """One a sprite, on its box: -log of the light that the others leave on it at t = 0; None: none."""
    supersample: int = 1
    """Samples a pixel, along each side, of what moves."""
    starts: Sequence[Pose] = ()
    """One a body: the pose in which its sprite was cut out, where some are put elsewhere; empty: as at t = 0."""
    mirror: Mirror | None = None
    scale: float = 1.0
    """Canvas pixels a photo pixel: a scene without a photo is drawn as large as it is seen."""
    keeps_layers: bool = False
    """Whether frames can be taken apart into layers."""

    @property
    def faces(self) -> Mapping[int, float]:
        """See `Frame.faces`."""
        return {
            sprite.body: sprite.face / self.scale
            for sprite in self.sprites
            if sprite.face
        }


@dataclass(frozen=True)
class SpritePose:
    """How a sprite stands in a frame."""

    k: int
    """Index into the stage's sprites."""
    start: Pose
    pose: Pose
    where: Placement | None
    """None: out of the picture."""
    space: Array | None = None
    """(3, 3) a ball's turn so far; None where it has none, or only the angle is known."""


def sprite_poses(
    stage: Stage, trajectory: Trajectory, order: Sequence[int] | None = None
) -> Iterator[tuple[float, list[SpritePose]]]:
    """Time, s, of each sample in its `order` and how every sprite stands then: geometry alone."""
    if stage.scale != 1.0:
        trajectory = replace(
            trajectory, poses=enlarged_poses(trajectory.poses, stage.scale)
        )
    size = (stage.background.shape[1], stage.background.shape[0])
    starts: Sequence[Pose] = stage.starts
    if not starts and len(trajectory.poses):
        starts = [Pose(*pose) for pose in trajectory.poses[0].tolist()]
    turns = in_space(trajectory.turns) if trajectory.turns.size else None
    turned = None if turns is None else (turns != np.eye(3)).any(axis=(2, 3))
    for sample in range(len(trajectory.times)) if order is None else order:
        poses = [Pose(*pose) for pose in trajectory.poses[sample].tolist()]
        stands = []
        for k, sprite in enumerate(stage.sprites):
            start, pose = starts[sprite.body], poses[sprite.body]
            space = None
            if turns is not None and turned is not None and turned[sample, sprite.body]:
                space = turns[sample, sprite.body]
                if start.angle:  # it lies turned by as much at t = 0
                    space = space @ _about(-start.angle)
            where = place_sprite(sprite, start, pose, size, space)
            if sprite.wheels and where is not None:
                where = replace(
                    where, wheel_turns=wheel_turns(sprite, trajectory, sample)
                )
            stands.append(SpritePose(k, start, pose, where, space))
        yield float(trajectory.times[sample]), stands


def wheel_turns(
    sprite: Sprite, trajectory: Trajectory, sample: int
) -> tuple[float, ...]:
    """Return the turns in rad of a sprite's wheels; empty if they are not known."""
    if not trajectory.wheel_turns.size:
        return ()
    turns = trajectory.wheel_turns[sample]
    return tuple(float(turns[wheel.number]) for wheel in sprite.wheels)


def _about(angle: float) -> Array:
    """(3, 3): a turn in the picture."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(angle)
    return turn


def enlarged_poses(poses: Array, scale: float) -> Array:
    """Poses (..., 3) on a canvas with `scale` pixels a photo pixel."""
    return np.concatenate(
        [(poses[..., :2] + 0.5) * scale - 0.5, poses[..., 2:]], axis=-1
    )
