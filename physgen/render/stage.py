"""The content of frames: sprites, background and their placement at each sample."""

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
from physgen.render.squash import Squashes
from physgen.render.standing_shade import STANDING
from physgen.simulate.trajectory import Trajectory
from physgen.simulate.trajectory import rotation_matrices as in_space

Slices = tuple[slice, slice]

LEAVES = 0.1
"""Displacement, in sizes of an object, over which its halo (rims and shadows in the
photo) fades.
"""
FAINT = 0.02
"""Largest invisible share of a halo."""
FADE = 3.0
"""Displacement, px, over which the photo's border pixels are replaced by the object's
clean ones.
"""
SPREAD = 1.5
"""Margin of a warped picture around its pixels, px."""
WARP_FLAGS = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


@dataclass(frozen=True)
class Placement:
    """The place of a sprite on the canvas."""

    box: Slices
    """Rows and columns of the canvas."""
    photo_box: Slices | None = None
    """At rest: rows and columns of the sprite, with the photo's pixels."""
    matrix: F64 | None = None
    """In motion: matrix (2, 3) from a pixel of the box to a pixel of the sprite."""
    turn: float = 0.0
    """Rotation of the sprite's picture, rad."""
    space: F64 | None = None
    """Rotation of a ball's skin, (3, 3)."""
    shift: tuple[float, float] = (0.0, 0.0)
    """Displacement of the centre, px."""
    wheel_turns: tuple[float, ...] = ()
    """Rotation of each wheel of the sprite, rad."""


def place_sprite(
    sprite: Sprite, start: Pose, pose: Pose, size: tuple[int, int], space: F64 | None
) -> Placement | None:
    """Place a sprite on a canvas of `size` (W, H); None if it is outside.

    `space` (3, 3): a ball's rotation so far; None if there is none, or if only the
    angle is known.
    """
    # An object at its place shows the photo's own pixels, without any interpolation.
    turn = pose.angle - start.angle
    is_turned_ball = sprite.ball is not None and space is not None
    if turn == 0.0 and pose[:2] == start[:2] and not is_turned_ball:
        return _at_rest(sprite, size)
    if not sprite.hull:
        return None
    if sprite.ball is not None:
        return _place_ball(sprite, start, pose, size, space)
    start = start._replace(y=start.y + sprite.face)
    pose = pose._replace(y=pose.y + sprite.face)
    box = _turned_box(sprite, start, pose, size)
    if box is None:
        return None
    # The canvas pixel p (from the box's corner) shows the sprite pixel
    # R^-1 (p + box - pose) + start - corner.
    c, s = cos(turn), sin(turn)
    dx, dy = box[1].start - pose.x, box[0].start - pose.y
    x0, y0 = sprite.corner
    shift_x = c * dx + s * dy + start.x - x0
    shift_y = c * dy - s * dx + start.y - y0
    matrix = np.array([[c, s, shift_x], [-s, c, shift_y]])
    return Placement(box, matrix=matrix, turn=turn)


def _at_rest(sprite: Sprite, size: tuple[int, int]) -> Placement | None:
    """Place a sprite at its place in the photo, with the photo's own pixels."""
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
    """Return the pixels of a canvas that a rotated sprite can touch; None
    without any.
    """
    turn = pose.angle - start.angle
    c, s = cos(turn), sin(turn)
    # For a dozen points, lists are faster than arrays.
    xs, ys = [], []
    for corner_x, corner_y in sprite.hull:
        x, y = corner_x - start.x, corner_y - start.y
        xs.append(c * x - s * y + pose.x)
        ys.append(s * x + c * y + pose.y)
    # Sides of a block rise above its front.
    upper_margin = SPREAD
    if sprite.sides is not None:
        upper_margin += sprite.sides.depth
    left, top = min(xs) - SPREAD, min(ys) - upper_margin
    return _clip_box_to_canvas(left, top, max(xs) + SPREAD, max(ys) + SPREAD, size)


def _place_ball(
    sprite: Sprite, start: Pose, pose: Pose, size: tuple[int, int], space: F64 | None
) -> Placement | None:
    """Place a ball: its picture moves without rotation, and only its skin turns."""
    if space is None:
        space = np.eye(3)
        space[:2, :2] = rotation(pose.angle - start.angle)
    # The picture of a ball is the same in every orientation, apart from its skin: light
    # comes from outside.
    dx, dy = pose.x - start.x, pose.y - start.y
    lx, ly, hx, hy = sprite.covered_box
    x, y = sprite.corner[0] + dx, sprite.corner[1] + dy
    box = _clip_box_to_canvas(x + lx - 1, y + ly - 1, x + hx, y + hy, size)
    if box is None:
        return None
    matrix = np.array([[1.0, 0, box[1].start - x], [0, 1, box[0].start - y]])
    return Placement(box, None, matrix, 0.0, space, (dx, dy))


def _clip_box_to_canvas(
    left: float, top: float, right: float, bottom: float, size: tuple[int, int]
) -> Slices | None:
    """Return the pixels of a canvas of `size` (W, H) between two corners; None without
    any.
    """
    if not isfinite(left + right + top + bottom):
        return None
    if right < 0 or bottom < 0 or left >= size[0] or top >= size[1]:
        return None
    rows = slice(max(floor(top), 0), min(ceil(bottom) + 1, size[1]))
    return rows, slice(max(floor(left), 0), min(ceil(right) + 1, size[0]))


def draw_sprite(
    sprite: Sprite, placement: Placement, samples: int = 1
) -> tuple[F32, F32]:
    """Draw a sprite on its box: linear light times coverage (h, w, 3), and coverage (h,
    w).

    In motion, each pixel is the mean of `samples` x `samples` samples. Moved balls are drawn
    by `BallSprites`.
    """
    if placement.photo_box is not None:
        return sprite.light[placement.photo_box], sprite.coverage[placement.photo_box]
    assert placement.matrix is not None
    size = _box_size(placement.box)
    fine_size = (size[0] * samples, size[1] * samples)
    matrix = _finer(placement.matrix, samples)
    # `Sprite.half_pixels` has two samples a pixel.
    warped_sprite = _warp_picture(sprite.half_pixels, 2 * matrix, fine_size)
    # The conversion keeps the first three channels.
    light = np.asarray(cv2.cvtColor(warped_sprite, cv2.COLOR_BGRA2BGR), np.float32)
    coverage = np.asarray(cv2.extractChannel(warped_sprite, 3), np.float32)
    # The order follows the light: shading by the relief, glints that do not turn, then
    # parts that move on their own.
    if sprite.relief is not None and placement.turn != 0.0:
        ratio = sprite.relief.ratio(placement.turn)
        ratio = _warp_picture(ratio, matrix, fine_size, cv2.BORDER_REPLICATE)
        light *= three_channels(ratio)
    if sprite.gloss is not None:
        light += sprite.gloss.draw(matrix, fine_size)
    for wheel, turn in zip(sprite.wheels, placement.wheel_turns, strict=False):
        wheel.draw(light, coverage, matrix, turn)
    if sprite.sides is not None and sprite.sides.share(placement.turn) > 0:
        visible_share = sprite.sides.remaining_share(
            matrix, coverage.shape, placement.turn
        )
        light, coverage = (
            light * three_channels(visible_share),
            coverage * visible_share,
        )
    if samples > 1:
        # The mean over the samples of a pixel avoids stairs at edges that the photo's
        # own optics had blurred.
        area = cv2.INTER_AREA
        light = np.asarray(cv2.resize(light, size, interpolation=area), np.float32)
        small_coverage = cv2.resize(coverage, size, interpolation=area)
        coverage = np.asarray(small_coverage, np.float32)
    return light, coverage


def _box_size(box: Slices) -> tuple[int, int]:
    """Return width and height of a box."""
    rows, columns = box
    return columns.stop - columns.start, rows.stop - rows.start


def _warp_picture(
    picture: F32, matrix: F64, size: tuple[int, int], border: int = cv2.BORDER_CONSTANT
) -> F32:
    """Warp a picture to a box of `size` (w, h); `matrix` (2, 3) leads from box to
    picture.
    """
    result = cv2.warpAffine(picture, matrix, size, flags=WARP_FLAGS, borderMode=border)
    return np.asarray(result, np.float32)


def draw_border(
    sprite: Sprite, placement: Placement, shares: F32
) -> tuple[Slices, F32] | None:
    """Draw the visible share of `Sprite.rest`: a box and (h, w, 3); None without any.

    `shares` (N + 1,): the shares by `borders_left`, of this sprite itself at 0.
    """
    if sprite.rest is None:
        return None
    own_shares = shares[sprite.neighbours]
    if not own_shares.any():
        return None
    is_repainted = sprite.ball is not None and sprite.ball.pattern is not None
    if placement.photo_box is None and is_repainted:
        return None  # its rest contains mixtures of the photo's pixels
    rest = sprite.rest
    # Fade the border towards each neighbour by itself.
    if own_shares.min() < 1:
        if sprite.hider is None:
            rest = rest * shares[0]
        else:
            rest = rest * three_channels(shares[sprite.hider])
    if placement.photo_box is not None:
        return placement.box, rest[placement.photo_box]
    assert placement.matrix is not None
    return placement.box, _warp_picture(
        rest, placement.matrix, _box_size(placement.box)
    )


def borders_left(sprites: Sequence[Sprite], visible: Sequence[SpritePose]) -> F32:
    """Return the share of the photo's border between visible sprites and bodies, (n, N
    + 1).

    Column k is the share at the border to body k - 1, which fades as the two part,
    however they move. Column 0 is the sprite's own border, which fades as it leaves its
    place.
    """
    count = max((sprite.hiders for sprite in sprites), default=0) + 1
    displacements = []
    for stand in visible:
        turn = stand.pose.angle - stand.start.angle
        if sprites[stand.k].ball:
            turn = 0.0  # the picture of a ball never turns
        displacements.append(
            (stand.pose.x - stand.start.x, stand.pose.y - stand.start.y, turn)
        )
    own_moves = np.array(displacements).reshape(-1, 3)
    # Bodies outside the picture count as infinitely far away.
    all_moves = np.full((count, 3), np.inf)
    all_moves[0] = 0
    all_moves[[sprites[stand.k].body + 1 for stand in visible]] = own_moves
    # Two objects that move alike keep their common border: the difference of their
    # displacements counts, and the largest of its components.
    distance = np.abs(own_moves[:, None] - all_moves)
    radii = [max(sprites[stand.k].coverage.shape) / 2 for stand in visible]
    # Convert a turn to the displacement of the sprite's outermost point, px.
    distance[..., 2] *= np.array(radii)[:, None]
    shares = np.maximum(1 - distance.max(axis=2) / FADE, 0)
    return np.asarray(shares, np.float32)


def halos_left(sprites: Sequence[Sprite], stands: Sequence[SpritePose]) -> F32:
    """Return the share of the photo's halo at each body, (N + 1,), from index 1 on."""
    count = max((sprite.hiders for sprite in sprites), default=0) + 1
    shares = np.ones(count, np.float32)
    for stand in stands:
        sprite = sprites[stand.k]
        side = max(min(sprite.coverage.shape), 1)
        dx, dy = stand.pose.x - stand.start.x, stand.pose.y - stand.start.y
        turn = abs(stand.pose.angle - stand.start.angle)
        relative_motion = hypot(dx, dy) / side + turn / 2
        shares[sprite.body + 1] = exp(-((relative_motion / LEAVES) ** 2))
    return shares


def _moved_px(sprite: Sprite, stand: SpritePose) -> float:
    """Return how far a sprite is from its start, px, with half its turn."""
    side = max(min(sprite.coverage.shape), 1)
    way = hypot(stand.pose.x - stand.start.x, stand.pose.y - stand.start.y)
    turn = abs(float(stand.pose.angle - stand.start.angle))
    return float(way + turn * side / 2)


def draw_halo(
    sprite: Sprite, stand: SpritePose, shares: F32, contact_share: float = 0.0
) -> tuple[Slices, F32] | None:
    """Draw the visible share of `Sprite.halo`: a box and (h, w, 3); None without any.

    `shares`: those of `halos_left`. A rim that the mask left out at the outline fades
    within as many px of motion as it is wide; soft shade farther out fades later.
    `contact_share`: share of a shade at the base that contains the halo on the floor.
    """
    own_share = shares[sprite.body + 1]
    if sprite.halo is None or stand.placement is None or own_share < FAINT:
        return None
    (x, y), picture, neighbours = sprite.halo
    height, width = picture.shape[:2]
    box = np.s_[y : y + height, x : x + width]
    pixel_shares = np.minimum(shares[neighbours], own_share)
    if pixel_shares.min() == 1:
        return box, picture
    moved = _moved_px(sprite, stand)
    if moved > 0:
        width_px = sprite.halo_reach + np.float32(FADE)
        rims = np.exp(-np.square(np.float32(moved) / width_px))
        pixel_shares = np.minimum(pixel_shares, rims)
    if contact_share > 0:
        pixel_shares = np.minimum(pixel_shares, _halo_share(sprite, contact_share))
    return box, picture * three_channels(pixel_shares)


def _halo_share(sprite: Sprite, contact_share: float) -> F32:
    """Return the share (h, w) of a halo that a contact shade does not contain."""
    assert sprite.halo is not None
    (x, y), _, _ = sprite.halo
    # The shade is continued below the border of the object, too.
    border = np.clip(2 - sprite.halo_reach / np.float32(STANDING.ring), 0, 1)
    shares = np.asarray(1 - np.float32(contact_share) * border, np.float32)
    foot_halo = sprite.foot_halo
    if foot_halo is None or foot_halo.darkness is None:
        return shares
    left, top = foot_halo.corner[0] - x, foot_halo.corner[1] - y
    height, width = foot_halo.weight.shape
    part = shares[top : top + height, left : left + width]
    np.minimum(part, 1 - np.float32(contact_share) * foot_halo.weight, out=part)
    return shares


def draw_foot_halo(
    sprite: Sprite,
    stand: SpritePose,
    size: tuple[int, int],
    contact_share: float = 0.0,
) -> tuple[Slices, F32, F32] | None:
    """Draw the part of a halo that moves with its object on a canvas of `size` (W, H):
    a box, a factor and added light (h, w, 3); None without any.

    `contact_share`: share of a shade at the base that contains the halo's shade.
    """
    if sprite.foot_halo is None or stand.placement is None:
        return None
    turn = stand.pose.angle - stand.start.angle
    if sprite.ball is not None:
        turn = 0.0  # the picture of a ball never turns
    share = 1.0 if sprite.foot_halo.darkness is None else 1.0 - contact_share
    return sprite.foot_halo.draw(stand.start, stand.pose, turn, size, share)


def sprite_coverage(sprite: Sprite, placement: Placement) -> F32:
    """Return (h, w) the coverage of `draw_sprite` alone."""
    if placement.photo_box is not None:
        return sprite.coverage[placement.photo_box]
    assert placement.matrix is not None
    return _warp_picture(
        sprite.fine_coverage, 2 * placement.matrix, _box_size(placement.box)
    )


def _finer(matrix: F64, samples: int) -> F64:
    """Convert a matrix from pixels to one from a grid, `samples` times as fine, (2, 3)."""
    if samples <= 1:
        return matrix
    shift = 0.5 - samples / 2
    to_pixels = np.array([[1, 0, shift], [0, 1, shift], [0, 0, samples]]) / samples
    return matrix @ to_pixels


def three_channels(values: F32) -> F32:
    """Repeat (h, w) as (h, w, 3), which NumPy multiplies much faster than it
    broadcasts.
    """
    return np.asarray(cv2.merge((values, values, values)), np.float32)


@dataclass(frozen=True)
class Cover:
    """The visible pixels of a body in a picture."""

    body: int
    box: Slices
    """Rows and columns of the picture with the body."""
    mask: NDArray[np.bool_]
    """Mask (h, w) on its box."""


@dataclass(frozen=True)
class SpriteLayer:
    """A sprite of a frame without occlusion by others."""

    body: int
    box: Slices
    """Rows and columns of the picture."""
    light: F32
    """Linear light times coverage, (h, w, 3)."""
    coverage: F32
    """Coverage, (h, w)."""


@dataclass(frozen=True)
class Layers:
    """The layers of a picture, in linear light, without the mixtures at borders."""

    plate: F32
    """Background in full light, (H, W, 3)."""
    shaded_plate: F32
    """Background with shadows, (H, W, 3)."""
    sprites: Sequence[SpriteLayer]
    """Sprites, the farthest first."""
    order: Sequence[int]
    """All bodies of the clip, the farthest first."""

    def pictures(self) -> dict[int, F32]:
        """Return light times coverage, and coverage, (H, W, 4), of each body; 0 without
        the body.
        """
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
    """Time, s."""
    rgb: U8
    """Picture, (H, W, 3) sRGB."""
    draw_ids: Callable[[], U16] = field(repr=False, compare=False)
    """Computes `ids`, which few callers need."""
    covering: Callable[[], Sequence[Cover]] = field(
        default=tuple, repr=False, compare=False
    )
    """Computes `covers`."""
    faces: Mapping[int, float] = field(default_factory=dict, repr=False, compare=False)
    """Distance of a body's front below its centre, px of the photo, for bodies with
    one.
    """
    layering: Callable[[], Layers] | None = field(
        default=None, repr=False, compare=False
    )
    """Computes `Layers`, if the stage keeps them."""

    @cached_property
    def ids(self) -> U16:
        """Return the ids (H, W): k + 1 for body k, 0 for the background."""
        return self.draw_ids()

    @cached_property
    def covers(self) -> Sequence[Cover]:
        """Return the covers of objects in the picture, the farthest first.

        A body may have several.
        """
        return self.covering()


@dataclass(frozen=True)
class ShadowBody:
    """Properties of a body for shadows; see `shadow.Silhouette`."""

    radius: float | None
    """Radius of a sphere, px."""
    thickness: float
    """Thickness, px."""
    veil_share: float = 1.0
    """Visible share of the shadows of others on it, 0..1."""


@dataclass(frozen=True)
class Mirror:
    """Reflections of standing objects on a floor."""

    share: F32
    """Share (n,) of the light of an object's lowest rows in each row below its foot."""
    feet: Sequence[tuple[int, float, float] | None]
    """For each sprite the row of its foot in the photo, and its floor's end columns;
    None without a floor.
    """
    blur_width: float = 2.0
    """Standard deviation of the blur of reflections, px."""


@dataclass(frozen=True)
class Stage:
    """The content of all frames: sprites over a background `(H, W, 3)` sRGB.

    Sprites are in order, the farthest first.
    """

    background: U8
    sprites: Sequence[Sprite]
    lit_background: LitBackground | None = None
    """With moving shadows: the decomposed background, with a cast for each sprite."""
    actors: Sequence[ShadowBody] = ()
    """One per sprite, with `lit_background`."""
    grounds: Sequence[F64] = ()
    """Side view: floors under shadows, as returned by `staging.floors`."""
    veils: Sequence[F32 | None] | None = None
    """Veil of each sprite on its box, -log of the light that others leave at t = 0;
    None without a veil.
    """
    supersample: int = 1
    """Samples per pixel, along each side, of moving sprites."""
    starts: Sequence[Pose] = ()
    """Poses of bodies at which their sprites were cut out, if these differ from
    t = 0.
    """
    mirror: Mirror | None = None
    scale: float = 1.0
    """Canvas pixels per photo pixel: a scene without a photo is drawn at the size of
    its views.
    """
    contact_depth: float = 0.0
    """Lost share of objects' light at a contact."""
    squashes: Squashes | None = None
    """Soft bodies that impacts flatten; None: no body is flattened."""
    keeps_layers: bool = False
    """Whether frames keep their layers."""

    @property
    def faces(self) -> Mapping[int, float]:
        """Return `Frame.faces`."""
        return {
            sprite.body: sprite.face / self.scale
            for sprite in self.sprites
            if sprite.face
        }


@dataclass(frozen=True)
class SpritePose:
    """The pose of a sprite in a frame."""

    k: int
    """Index of the stage's sprite."""
    start: Pose
    pose: Pose
    placement: Placement | None
    """Place on the canvas; None outside the picture."""
    space: F64 | None = None
    """Rotation of a ball so far, (3, 3); None if there is none, or if only the angle is
    known.
    """


def sprite_poses(
    stage: Stage, trajectory: Trajectory, order: Sequence[int] | None = None
) -> Iterator[tuple[float, list[SpritePose]]]:
    """Yield the time, s, of each sample in `order`, with the poses of all sprites."""
    if stage.scale != 1.0:
        poses = enlarged_poses(trajectory.poses, stage.scale)
        trajectory = replace(trajectory, poses=poses)
    starts: Sequence[Pose] = stage.starts
    if not starts and len(trajectory.poses):
        # Without stored poses of the photo, the photo shows the first sample.
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
                placement = replace(
                    placement, wheel_turns=wheel_turns(sprite, trajectory, sample)
                )
            stands.append(SpritePose(k, start, pose, placement, space))
        yield float(trajectory.times[sample]), stands


class _BallTurns:
    """Rotations of balls in space."""

    def __init__(self, trajectory: Trajectory) -> None:
        self._turns: F64 | None = None
        if trajectory.turns.size:
            self._turns = in_space(trajectory.turns)
            self._is_turned = (self._turns != np.eye(3)).any(axis=(2, 3))

    def find(self, sample: int, body: int, start: Pose) -> F64 | None:
        """Return the rotation (3, 3) of a body since t = 0.

        None if there is none, or if only its angle is known.
        """
        if self._turns is None or not self._is_turned[sample, body]:
            return None
        turn: F64 = self._turns[sample, body]
        # The sprite was cut out at another angle than 0.
        if start.angle:
            turn = turn @ _create_rotation_matrix(-start.angle)
        return turn


def wheel_turns(
    sprite: Sprite, trajectory: Trajectory, sample: int
) -> tuple[float, ...]:
    """Return the rotations of a sprite's wheels, rad; empty if they are unknown."""
    if not trajectory.wheel_turns.size:
        return ()
    turns = trajectory.wheel_turns[sample]
    return tuple(float(turns[wheel.number]) for wheel in sprite.wheels)


def _create_rotation_matrix(angle: float) -> F64:
    """Return a rotation in the picture's plane, (3, 3)."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(angle)
    return turn


def enlarged_poses(poses: F64, scale: float) -> F64:
    """Return poses (..., 3) on a canvas with `scale` pixels per photo pixel."""
    places = (poses[..., :2] + 0.5) * scale - 0.5
    return np.concatenate([places, poses[..., 2:]], axis=-1)
