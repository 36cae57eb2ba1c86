"""What is drawn: sprites, background and their placement at each sample."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil, cos, exp, floor, hypot, isfinite, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64
from physgen.geometry.polygon import Pose, rotation
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
    matrix: F64 | None = None
    """(2, 3) Moved: pixel of the box -> pixel of the sprite."""
    turn: float = 0.0
    """rad by which the sprite's picture turns."""
    space: F64 | None = None
    """(3, 3) A ball: how its skin has turned."""
    shift: tuple[float, float] = (0.0, 0.0)
    """px by which the centre has moved."""
    wheel_turns: tuple[float, ...] = ()
    """rad, of each of the sprite's wheels."""


def place_sprite(
    sprite: Sprite, start: Pose, pose: Pose, size: tuple[int, int], space: F64 | None
) -> Placement | None:
    """Place the sprite on a canvas of `size` (W, H); None if it is outside.

    `space` (3, 3): a ball's turn so far; None where it has none, or only the angle is known.
    """
    turn = pose.angle - start.angle
    is_turned_ball = sprite.ball is not None and space is not None
    if turn == 0.0 and pose[:2] == start[:2] and not is_turned_ball:
        return _at_rest(sprite, size)
    if not sprite.hull:
        return None
    if sprite.ball is not None:
        return _rolled(sprite, start, pose, size, space)
    start = start._replace(y=start.y + sprite.face)
    pose = pose._replace(y=pose.y + sprite.face)
    box = _turned_box(sprite, start, pose, size)
    if box is None:
        return None
    # canvas pixel p (from the box's corner) comes from sprite pixel R^-1 (p + box - pose) + start - corner
    c, s = cos(turn), sin(turn)
    dx, dy = box[1].start - pose.x, box[0].start - pose.y
    x0, y0 = sprite.corner
    shift_x = c * dx + s * dy + start.x - x0
    shift_y = c * dy - s * dx + start.y - y0
    matrix = np.array([[c, s, shift_x], [-s, c, shift_y]])
    return Placement(box, matrix=matrix, turn=turn)


def _at_rest(sprite: Sprite, size: tuple[int, int]) -> Placement | None:
    """Place a sprite where it was cut out: the photo's own pixels."""
    x0, y0 = sprite.corner
    height, width = sprite.coverage.shape
    left, top = max(-x0, 0), max(-y0, 0)
    right, bottom = min(width, size[0] - x0), min(height, size[1] - y0)
    if left >= right or top >= bottom:
        return None
    box = np.s_[y0 + top : y0 + bottom, x0 + left : x0 + right]
    return Placement(box, np.s_[top:bottom, left:right])


def _turned_box(
    sprite: Sprite, start: Pose, pose: Pose, size: tuple[int, int]
) -> Slices | None:
    """Return the pixels of a canvas that a turned sprite can touch; None if there are none."""
    turn = pose.angle - start.angle
    c, s = cos(turn), sin(turn)
    # Lists: for a dozen points they are quicker than arrays.
    xs, ys = [], []
    for corner_x, corner_y in sprite.hull:
        x, y = corner_x - start.x, corner_y - start.y
        xs.append(c * x - s * y + pose.x)
        ys.append(s * x + c * y + pose.y)
    above = SPREAD
    if sprite.sides is not None:
        above += sprite.sides.depth
    left, top = min(xs) - SPREAD, min(ys) - above
    return _boxed(left, top, max(xs) + SPREAD, max(ys) + SPREAD, size)


def _rolled(
    sprite: Sprite, start: Pose, pose: Pose, size: tuple[int, int], space: F64 | None
) -> Placement | None:
    """Place a ball: its picture moves without turning, its skin alone turns."""
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
    left: float, top: float, right: float, bottom: float, size: tuple[int, int]
) -> Slices | None:
    """Return the pixels of a canvas of `size` (W, H) between two corners.

    None if there are none.
    """
    if not isfinite(left + right + top + bottom):
        return None
    if right < 0 or bottom < 0 or left >= size[0] or top >= size[1]:
        return None
    rows = slice(max(floor(top), 0), min(ceil(bottom) + 1, size[1]))
    return rows, slice(max(floor(left), 0), min(ceil(right) + 1, size[0]))


def draw_sprite(sprite: Sprite, placement: Placement, fine: int = 1) -> tuple[F32, F32]:
    """Draw (h, w, 3) linear light times coverage, and coverage (h, w), on its box; of anything but a moved ball.

    Where it moved, each pixel is the mean of `fine` x `fine` samples.
    """
    if placement.own is not None:
        return sprite.light[placement.own], sprite.coverage[placement.own]
    assert placement.matrix is not None
    size = _box_size(placement.box)
    fine_size = (size[0] * fine, size[1] * fine)
    matrix = _finer(placement.matrix, fine)
    # `Sprite.fine` has two samples a pixel.
    warped = _warped(sprite.fine, 2 * matrix, fine_size)
    # The conversion keeps the first three channels.
    light = np.asarray(cv2.cvtColor(warped, cv2.COLOR_BGRA2BGR), np.float32)
    coverage = np.asarray(cv2.extractChannel(warped, 3), np.float32)
    if sprite.relief is not None and placement.turn != 0.0:
        ratio = sprite.relief.ratio(placement.turn)
        ratio = _warped(ratio, matrix, fine_size, cv2.BORDER_REPLICATE)
        light *= three_channels(ratio)
    for wheel, turn in zip(sprite.wheels, placement.wheel_turns, strict=False):
        wheel.draw(light, coverage, matrix, turn)
    if sprite.sides is not None and sprite.sides.share(placement.turn) > 0:
        kept = sprite.sides.kept(matrix, coverage.shape, placement.turn)
        light, coverage = light * three_channels(kept), coverage * kept
    if fine > 1:
        area = cv2.INTER_AREA
        light = np.asarray(cv2.resize(light, size, interpolation=area), np.float32)
        small = cv2.resize(coverage, size, interpolation=area)
        coverage = np.asarray(small, np.float32)
    return light, coverage


def _box_size(box: Slices) -> tuple[int, int]:
    """Return width and height of a box."""
    rows, columns = box
    return columns.stop - columns.start, rows.stop - rows.start


def _warped(
    picture: F32, matrix: F64, size: tuple[int, int], border: int = cv2.BORDER_CONSTANT
) -> F32:
    """Return a picture on a box of `size` (w, h), from whose pixels `matrix` (2, 3) leads to the picture's."""
    result = cv2.warpAffine(picture, matrix, size, flags=WARP_FLAGS, borderMode=border)
    return np.asarray(result, np.float32)


def draw_border(
    sprite: Sprite, placement: Placement, shares: F32
) -> tuple[Slices, F32] | None:
    """Draw a box and (h, w, 3) the share of `Sprite.rest` that still shows there; None if none of it does.

    `shares` (N + 1,): what each body leaves on this one, by `borders_left`; 0: what is its own.
    """
    if sprite.rest is None:
        return None
    own_shares = shares[sprite.beside]
    if not own_shares.any():
        return None
    is_repainted = sprite.ball is not None and sprite.ball.pattern is not None
    if placement.own is None and is_repainted:
        return None  # its rest is of mixtures of the photo's pixels
    rest = sprite.rest
    if own_shares.min() < 1:
        if sprite.hider is None:
            rest = rest * shares[0]
        else:
            rest = rest * three_channels(shares[sprite.hider])
    if placement.own is not None:
        return placement.box, rest[placement.own]
    assert placement.matrix is not None
    return placement.box, _warped(rest, placement.matrix, _box_size(placement.box))


def borders_left(sprites: Sequence[Sprite], visible: Sequence[SpritePose]) -> F32:
    """Return (n, N + 1) for visible sprites: the share that each body, from 1 on, still leaves on their borders.

    It goes as the two part, however both have moved; 0: what is their own, which goes as they leave their place.
    """
    count = max((sprite.hiders for sprite in sprites), default=0) + 1
    moves = []
    for stand in visible:
        turn = stand.pose.angle - stand.start.angle
        if sprites[stand.k].ball:
            turn = 0.0  # its picture never turns
        moves.append((stand.pose.x - stand.start.x, stand.pose.y - stand.start.y, turn))
    own_moves = np.array(moves).reshape(-1, 3)
    all_moves = np.full((count, 3), np.inf)
    all_moves[0] = 0
    all_moves[[sprites[stand.k].body + 1 for stand in visible]] = own_moves
    distance = np.abs(own_moves[:, None] - all_moves)
    radii = [max(sprites[stand.k].coverage.shape) / 2 for stand in visible]
    distance[..., 2] *= np.array(radii)[:, None]
    shares = np.maximum(1 - distance.max(axis=2) / FADE, 0)
    return np.asarray(shares, np.float32)


def halos_left(sprites: Sequence[Sprite], stands: Sequence[SpritePose]) -> F32:
    """Return (N + 1,), from 1 on: the share of the photo around each body that it has not taken away."""
    count = max((sprite.hiders for sprite in sprites), default=0) + 1
    shares = np.ones(count, np.float32)
    for stand in stands:
        sprite = sprites[stand.k]
        side = max(min(sprite.coverage.shape), 1)
        dx, dy = stand.pose.x - stand.start.x, stand.pose.y - stand.start.y
        turn = abs(stand.pose.angle - stand.start.angle)
        moved = hypot(dx, dy) / side + turn / 2
        shares[sprite.body + 1] = exp(-((moved / LEAVES) ** 2))
    return shares


def _moved_px(sprite: Sprite, stand: SpritePose) -> float:
    """Return how far a sprite is from its start, px, with half its turn."""
    side = max(min(sprite.coverage.shape), 1)
    way = hypot(stand.pose.x - stand.start.x, stand.pose.y - stand.start.y)
    return way + abs(stand.pose.angle - stand.start.angle) * side / 2


def draw_halo(
    sprite: Sprite, stand: SpritePose, shares: F32
) -> tuple[Slices, F32] | None:
    """Draw a box of the canvas and (h, w, 3) what still shows of `Sprite.halo`, by `halos_left`.

    What is at the outline, as a rim that the mask left out, goes after as many px as it
    is wide; soft shade farther out stays longer. None if nothing shows.
    """
    own_share = shares[sprite.body + 1]
    if sprite.halo is None or stand.where is None or own_share < FAINT:
        return None
    (x, y), picture, beside = sprite.halo
    height, width = picture.shape[:2]
    box = np.s_[y : y + height, x : x + width]
    pixel_shares = np.minimum(shares[beside], own_share)
    if pixel_shares.min() == 1:
        return box, picture
    moved = _moved_px(sprite, stand)
    if moved > 0:
        width_px = sprite.halo_reach + np.float32(FADE)
        rims = np.exp(-np.square(np.float32(moved) / width_px))
        pixel_shares = np.minimum(pixel_shares, rims)
    return box, picture * three_channels(pixel_shares)


def sprite_coverage(sprite: Sprite, placement: Placement) -> F32:
    """Return (h, w) the coverage of `draw_sprite` alone."""
    if placement.own is not None:
        return sprite.coverage[placement.own]
    assert placement.matrix is not None
    return _warped(sprite.fine_coverage, 2 * placement.matrix, _box_size(placement.box))


def _finer(matrix: F64, fine: int) -> F64:
    """Return (2, 3) from the pixels of a grid `fine` times as fine, where `matrix` is from the pixels."""
    if fine <= 1:
        return matrix
    shift = 0.5 - fine / 2
    to_pixels = np.array([[1, 0, shift], [0, 1, shift], [0, 0, fine]]) / fine
    return matrix @ to_pixels


def three_channels(values: F32) -> F32:
    """Repeat (h, w) as (h, w, 3): a picture's own shape, which NumPy multiplies far faster than it broadcasts."""
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
        """Return (H, W): body k shows as k + 1, 0 = background."""
        return self.named()

    @cached_property
    def covers(self) -> Sequence[Cover]:
        """Return objects that reach into the picture, the farthest first.

        A body may be made of several.
        """
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
    """One a sprite: the row of the photo at which it ends, and its floor's end columns.

    None: it does not stand.
    """
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
        F64
    ] = ()  # side view: as `staging.floors` has them, what shadows fall on from above.
    veils: Sequence[F32 | None] | None = None
    """One a sprite, on its box: -log of the light that the others leave on it at t = 0.

    None: none.
    """
    supersample: int = 1
    """Samples a pixel, along each side, of what moves."""
    starts: Sequence[Pose] = ()
    """One a body: the pose in which its sprite was cut out, where some are put elsewhere.

    Empty: as at t = 0.
    """
    mirror: Mirror | None = None
    scale: float = 1.0
    """Canvas pixels a photo pixel: a scene without a photo is drawn as large as it is seen."""
    contact_depth: float = 0.0
    """Share of light that objects lose where they come to touch each other."""
    keeps_layers: bool = False
    """Whether frames can be taken apart into layers."""

    @property
    def faces(self) -> Mapping[int, float]:
        """Return the same as `Frame.faces`."""
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
    space: F64 | None = None
    """(3, 3) a ball's turn so far; None where it has none, or only the angle is known."""


def sprite_poses(
    stage: Stage, trajectory: Trajectory, order: Sequence[int] | None = None
) -> Iterator[tuple[float, list[SpritePose]]]:
    """Yield the time, s, of each sample in its `order` and the pose of every sprite: geometry alone."""
    if stage.scale != 1.0:
        poses = enlarged_poses(trajectory.poses, stage.scale)
        trajectory = replace(trajectory, poses=poses)
    starts: Sequence[Pose] = stage.starts
    if not starts and len(trajectory.poses):
        starts = [Pose(*pose) for pose in trajectory.poses[0].tolist()]
    turns = _BallTurns(trajectory)
    height, width = stage.background.shape[:2]
    for sample in range(len(trajectory.times)) if order is None else order:
        sample_poses = trajectory.poses[sample].tolist()
        stands = []
        for k, sprite in enumerate(stage.sprites):
            start, pose = starts[sprite.body], Pose(*sample_poses[sprite.body])
            space = turns.find(sample, sprite.body, start)
            placement = place_sprite(sprite, start, pose, (width, height), space)
            if sprite.wheels and placement is not None:
                turned_wheels = wheel_turns(sprite, trajectory, sample)
                placement = replace(placement, wheel_turns=turned_wheels)
            stands.append(SpritePose(k, start, pose, placement, space))
        yield float(trajectory.times[sample]), stands


class _BallTurns:
    """Turns of balls in space."""

    def __init__(self, trajectory: Trajectory) -> None:
        self._turns: F64 | None = None
        if trajectory.turns.size:
            self._turns = in_space(trajectory.turns)
            self._is_turned = (self._turns != np.eye(3)).any(axis=(2, 3))

    def find(self, sample: int, body: int, start: Pose) -> F64 | None:
        """Return (3, 3) the turn of a body since t = 0.

        None if it has none, or only its angle is known.
        """
        if self._turns is None or not self._is_turned[sample, body]:
            return None
        turn: F64 = self._turns[sample, body]
        if start.angle:  # it lies turned by as much at t = 0
            turn = turn @ _about(-start.angle)
        return turn


def wheel_turns(
    sprite: Sprite, trajectory: Trajectory, sample: int
) -> tuple[float, ...]:
    """Return the turns in rad of a sprite's wheels; empty if they are not known."""
    if not trajectory.wheel_turns.size:
        return ()
    turns = trajectory.wheel_turns[sample]
    return tuple(float(turns[wheel.number]) for wheel in sprite.wheels)


def _about(angle: float) -> F64:
    """Return (3, 3): a turn in the picture."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(angle)
    return turn


def enlarged_poses(poses: F64, scale: float) -> F64:
    """Return poses (..., 3) on a canvas with `scale` pixels a photo pixel."""
    places = (poses[..., :2] + 0.5) * scale - 0.5
    return np.concatenate([places, poses[..., 2:]], axis=-1)
