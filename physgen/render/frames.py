"""Stage and trajectory to frames, one at a time; blending and warping in linear light.

Only tiles that objects or their shadows touch are composed and encoded again, over a cached background in the light of
the objects that have not moved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise
from math import ceil, hypot

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import rotation
from physgen.geometry.shadows import F32, Silhouette
from physgen.maps import U16
from physgen.photometry import decode, encode_u8
from physgen.render.atlas import BallSprites, ShadowSprites
from physgen.render.occlusion import (
    add_shadow,
    occlusion_factors,
    relit_border,
    sprite_silhouette,
)
from physgen.render.shadow_decomposition import shaded_background
from physgen.render.sprites import CUT
from physgen.render.stage import (
    Cover,
    Frame,
    Layers,
    Placement,
    Slices,
    SpriteLayer,
    SpritePose,
    Stage,
    borders_left,
    draw_border,
    draw_halo,
    draw_sprite,
    enlarged_poses,
    halos_left,
    place_sprite,
    sprite_coverage,
    sprite_poses,
    three_channels,
)
from physgen.simulate.trajectory import Trajectory


def encode_picture(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The nearest sRGB code of linear light, any shape (h, w, 3); the same bytes as `encode_u8`, in less time."""
    index = np.clip(linear, 0, 1)
    index *= np.float32(65535)
    index += np.float32(0.5)
    look_up, table = _table()
    return np.asarray(look_up(index.astype(np.uint16), table), np.uint8)


@cache
def _table() -> tuple[Callable[..., object], NDArray[np.uint8]]:
    """What looks codes up, and (65536,) codes of 16-bit light."""
    table = encode_u8(np.arange(65536, dtype=np.float32) / np.float32(65535))
    try:
        cv2.LUT(np.zeros((1, 1, 3), np.uint16), table)
    except cv2.error:  # before OpenCV 5
        return (lambda index, table: table.take(index)), table
    return cv2.LUT, table


TILE = 32
"""px a side of the tiles in which touched pixels are counted."""


def touched_tiles(boxes: Sequence[Slices], size: tuple[int, int]) -> list[int]:
    """The tiles that the boxes touch: a number for each row of tiles, with a bit for each tile."""
    marked = [0] * (-(-size[1] // TILE))
    for rows, columns in boxes:
        if rows.stop > rows.start and columns.stop > columns.start:
            run = (1 << ((columns.stop - 1) // TILE + 1)) - (
                1 << (columns.start // TILE)
            )
            for row in range(rows.start // TILE, (rows.stop - 1) // TILE + 1):
                marked[row] |= run
    return marked


def boxes_of_tiles(tiles: Sequence[int], size: tuple[int, int]) -> list[Slices]:
    """The boxes of `union`, of tiles as `tiled` has them."""
    found: list[Slices] = []
    begun: dict[tuple[int, int], int] = {}
    for row, bits in enumerate([*tiles, 0]):
        here = []
        while bits:
            first = (bits & -bits).bit_length() - 1
            length = (~(bits >> first) & ((bits >> first) + 1)).bit_length() - 1
            here.append((first, first + length))
            bits &= ~(((1 << length) - 1) << first)
        for first, last in [run for run in begun if run not in here]:
            top = begun.pop((first, last))
            found.append(
                (
                    slice(top * TILE, min(row * TILE, size[1])),
                    slice(first * TILE, min(last * TILE, size[0])),
                )
            )
        for run in here:
            begun.setdefault(run, row)
    return found


class BackgroundCache:
    """What is left when objects have gone; kept from frame to frame, as most objects that move go on moving.

    It depends on none of the frames that came before: the same objects gone leave the same to the last bit.
    """

    def __init__(self, stage: Stage) -> None:
        self._lit = stage.lit
        self._gone: set[int] = set()
        self.dark: F32 | None = None if stage.lit is None else stage.lit.total.copy()
        """(H, W): -log of the light that is left."""
        self.light: F32 = (
            decode(stage.background) if stage.lit is None else stage.lit.behind()
        )
        """(H, W, 3) linear."""
        self.codes = encode_picture(self.light)
        """(H, W, 3) sRGB."""

    def by(self, stands: Sequence[SpritePose]) -> list[Slices]:
        """Go on to objects as they stand now; returns where anything changed."""
        lit, dark = self._lit, self.dark
        if lit is None or dark is None:
            return []
        gone = {
            s.k
            for s in stands
            if s.start != s.pose and lit.casts[s.k].whole is not None
        }
        if gone == self._gone:
            return []
        boxes = [
            whole[0]
            for k in gone ^ self._gone
            if (whole := lit.casts[k].whole) is not None
        ]
        self._gone = gone
        size = (dark.shape[1], dark.shape[0])
        changed = boxes_of_tiles(
            touched_tiles([np.s_[y0:y1, x0:x1] for x0, y0, x1, y1 in boxes], size), size
        )
        for box in changed:
            dark[box] = lit.total[box]
        for k in sorted(gone):
            if (whole := lit.casts[k].whole) is not None:
                for box in changed:
                    _take(dark, box, *whole)
        for box in changed:
            self.light[box] = shaded_background(lit.plate[box], dark[box], lit.tint)
            self.codes[box] = encode_picture(self.light[box])
        return changed


def _take(dark: F32, box: Slices, at: tuple[int, int, int, int], what: F32) -> None:
    """Take the part of `what` that lies in the box, of a picture whose box is `at`, from `dark` (H, W)."""
    x0, y0 = max(box[1].start, at[0]), max(box[0].start, at[1])
    x1, y1 = min(box[1].stop, at[2]), min(box[0].stop, at[3])
    if x0 < x1 and y0 < y1:
        dark[y0:y1, x0:x1] -= what[y0 - at[1] : y1 - at[1], x0 - at[0] : x1 - at[0]]


@contextmanager
def single_threaded() -> Iterator[None]:
    """OpenCV on this thread alone, for a while; a third less CPU time, and the encoder has the other core."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


@dataclass
class Picture:
    """What a frame shows of one sprite."""

    stand: SpritePose
    where: Placement
    light: F32
    """(h, w, 3) linear, times coverage."""
    coverage: F32
    """(h, w)."""
    rest: tuple[Slices, F32] | None
    """A box and (h, w, 3) what the photo shows there beyond light and background; as bright as the background is."""
    factor: F32 | None = None
    """(h, w) by which `light` was multiplied for the shadows of others."""


@dataclass(frozen=True)
class ExposureTuning:
    """How finely an exposure is divided."""

    sharp: float = 0.5
    """px of motion that no exposure shows."""
    step: float = 2.0
    """px that any point of an object moves between two of its pictures."""
    shadow: float = 8.0
    """px that its shadow moves, which is softer."""
    shadows: int = 4
    """Of an object in an exposure, at most."""


EXPOSURE = ExposureTuning()


def render_frames(
    stage: Stage,
    trajectory: Trajectory,
    order: Sequence[int] | None = None,
    parts: int = 1,
    ways: NDArray[np.float64] | None = None,
) -> Iterator[Frame]:
    """Frames of the trajectory's samples in their `order`, all one after the other unless given.

    Each is an exposure of `parts` samples, with the time and the ids of the last, as which it is composed; what moved
    is smeared along its way there (of `ways` (T, N, 3) where a camera moves, too), which is the mean of light wherever
    one object at most moves. Each object's own box is warped, and only touched tiles are encoded again. What a frame
    shows does not depend on those before it; the photo's own poses are those of sample 0.
    """
    samples = range(len(trajectory.times)) if order is None else order
    ways = trajectory.poses if ways is None else ways
    if parts > 1 and stage.scale != 1.0:
        ways = enlarged_poses(ways, stage.scale)
    size = (stage.background.shape[1], stage.background.shape[0])
    with single_threaded():
        balls, left = BallSprites(stage.sprites), BackgroundCache(stage)
        canvas: F32 = left.light.copy()
        shadows = _Shadows(stage, left)
        before = touched_tiles([], size)
        for index, (time, stands) in enumerate(
            sprite_poses(stage, trajectory, samples[parts - 1 :: parts])
        ):
            changed = left.by(stands)
            before = [
                a | b for a, b in zip(before, touched_tiles(changed, size), strict=True)
            ]
            pictures = list(_pictures(stage, balls, stands))
            trails = _trails(
                stage, ways[list(samples[index * parts : (index + 1) * parts])]
            )
            relit = shadows.thrown(canvas, stands, pictures, trails, changed)
            _add_sides(stage, pictures)
            for box in boxes_of_tiles(
                [a & ~b for a, b in zip(before, relit, strict=True)], size
            ):
                canvas[box] = left.light[box]
            layers = _LayerList(stage, left, canvas) if stage.keeps_layers else None
            touched = boxes_of_tiles(relit, size)
            around_them = halos_left(stage.sprites, stands)
            for picture in pictures:
                if (below := _mirrored(stage, picture, around_them)) is not None:
                    canvas[below[0]] += below[1]
                    touched.append(below[0])
                sprite = stage.sprites[picture.stand.k]
                if (
                    around := draw_halo(sprite, picture.stand, around_them)
                ) is not None:
                    shadows.add_border(canvas, *around)
                    touched.append(around[0])
            drawn = {picture.stand.k: picture for picture in pictures}
            for stand in stands:
                seen = drawn.get(stand.k)
                layer = (
                    None
                    if seen is None
                    else (seen.where.box, seen.light, seen.coverage)
                )
                if stand.k in trails:
                    layer = _smeared(stage, balls, stand, seen, trails[stand.k])
                if layer is not None:
                    if layers is not None:
                        layers.add(stage.sprites[stand.k].body, *layer)
                    under = canvas[layer[0]]
                    cv2.multiply(under, three_channels(1 - layer[2]), dst=under)
                    cv2.add(under, layer[1], dst=under)
                    touched.append(layer[0])
                if seen is not None and seen.rest is not None:
                    shadows.add_border(canvas, *seen.rest)
                    touched.append(seen.rest[0])
            before = touched_tiles(touched, size)
            rgb = left.codes.copy()
            for box in boxes_of_tiles(before, size):
                rgb[box] = encode_picture(canvas[box])
            covers = [
                (stage.sprites[p.stand.k].body + 1, p.where.box, p.coverage)
                for p in pictures
            ]
            yield Frame(
                index,
                time,
                rgb,
                partial(_named, covers, size),
                partial(_covering, covers),
                stage.faces,
                None if layers is None else layers.taken_apart,
            )


class _LayerList:
    """The layers of one frame as they are drawn, over a copy of the shaded background."""

    def __init__(self, stage: Stage, left: BackgroundCache, canvas: F32) -> None:
        self._plate = left.light if stage.lit is None else stage.lit.plate
        self._shaded = canvas.copy()
        self._order = tuple(dict.fromkeys(sprite.body for sprite in stage.sprites))
        self._sprites: list[SpriteLayer] = []

    def add(self, body: int, box: Slices, light: F32, coverage: F32) -> None:
        self._sprites.append(SpriteLayer(body, box, light, coverage))

    def taken_apart(self) -> Layers:
        return Layers(self._plate, self._shaded, self._sprites, self._order)


class _Shadows:
    """Shadows on the background and on objects, from frame to frame."""

    def __init__(self, stage: Stage, left: BackgroundCache) -> None:
        self._stage, self._lit, self._left = stage, stage.lit, left
        self._slides = ShadowSprites([] if stage.lit is None else stage.lit.casts)
        self._dark = None if left.dark is None else left.dark.copy()
        self._before: list[Slices] = []

    def thrown(
        self,
        canvas: F32,
        stands: Sequence[SpritePose],
        pictures: Sequence[Picture],
        trails: Mapping[int, Trail],
        changed: list[Slices],
    ) -> list[int]:
        """Shade the background and the `pictures`; returns the tiles of `canvas` (H, W, 3) that were made anew."""
        lit, dark, behind = self._lit, self._dark, self._left.dark
        size = (canvas.shape[1], canvas.shape[0])
        if lit is None or dark is None or behind is None:
            return touched_tiles([], size)
        for box in self._before + changed:
            dark[box] = behind[box]
        figures = _figures(self._stage, pictures)
        boxes: list[Slices] = []
        weights: dict[int, list[tuple[SpritePose, float]]] = {}
        for stand in stands:
            if stand.start == stand.pose:
                continue
            along = _along(trails.get(stand.k, ()), stand)
            weights[stand.k] = along
            if lit.casts[stand.k].sliding is None:
                for at, weight in along:
                    figure = figures.get(stand.k)
                    if figure is not None and at is not stand:
                        (left, top), (cx, cy) = figure.corner, figure.center
                        x, y = at.pose.x - stand.pose.x, at.pose.y - stand.pose.y
                        corner = (left + round(x), top + round(y))
                        figure = replace(figure, corner=corner, center=(cx + x, cy + y))
                    boxes += add_shadow(dark, lit, at, figure, weight)
        boxes += self._slides.thrown(
            dark, [one for along in weights.values() for one in along]
        )
        relit = touched_tiles(boxes, size)
        self._before = boxes_of_tiles(relit, size)
        for box in self._before:
            dark[box] = lit.limited(dark[box], box)
            canvas[box] = shaded_background(lit.plate[box], dark[box], lit.tint)
        factors = occlusion_factors(self._stage, [p.stand for p in pictures], figures)
        for picture in pictures:
            if (factor := factors.get(picture.stand.k)) is not None:
                picture.factor, picture.light = (
                    factor,
                    picture.light * three_channels(factor),
                )
        return relit

    def add_border(self, canvas: F32, box: Slices, rest: F32) -> None:
        """Add what the photo shows beside an object, (h, w, 3), in the light of the background as it is now."""
        lit, dark = self._lit, self._dark
        canvas[box] += (
            rest if dark is None or lit is None else relit_border(rest, lit, dark, box)
        )


Trail = tuple[tuple[float, float, float], ...]
"""px, px, rad: from an object's pose at the end of an exposure to those within it, the last of which it is."""


def _trails(stage: Stage, poses: NDArray[np.float64]) -> Mapping[int, Trail]:
    """The way of each sprite in an exposure, of `poses` (parts, N, 3), in steps too small to be seen; of those that
    hardly move, none."""
    sprites = stage.sprites
    way = (poses - poses[-1])[:, [sprite.body for sprite in sprites]].swapaxes(0, 1)
    way[[sprite.ball is not None for sprite in sprites], :, 2] = (
        0  # its picture never turns
    )
    reach = np.array([max(sprite.coverage.shape) / 2 for sprite in sprites])[:, None]
    x, y, turn = np.moveaxis(np.diff(way, axis=1), 2, 0)
    lengths = (np.hypot(x, y) + reach * np.abs(turn)).sum(axis=1)
    found: dict[int, Trail] = {}
    for k in np.flatnonzero(lengths > EXPOSURE.sharp).tolist():
        count = min(len(poses), max(2, ceil(lengths[k] / EXPOSURE.step) + 1))
        found[k] = tuple(map(tuple, way[k, _evenly(len(poses), count)].tolist()))
    return found


@cache
def _evenly(of: int, count: int) -> NDArray[np.int64]:
    """(count,) indices, from the first to the last."""
    return np.rint(np.linspace(0, of - 1, count)).astype(np.int64)


def _along(trail: Trail, stand: SpritePose) -> list[tuple[SpritePose, float]]:
    """Poses along the way of an exposure, as many as a shadow needs, and their weights, whose sum is 1."""
    if not trail:
        return [(stand, 1.0)]
    length = sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(trail))
    count = min(max(ceil(length / EXPOSURE.shadow), 1), EXPOSURE.shadows, len(trail))
    found, end = [], 0
    for k in range(count):
        begin, end = end, end + len(trail) // count + (k < len(trail) % count)
        x, y = (
            sum(at[axis] for at in trail[begin:end]) / (end - begin) for axis in (0, 1)
        )
        pose = stand.pose._replace(x=stand.pose.x + x, y=stand.pose.y + y)
        found.append((replace(stand, pose=pose), (end - begin) / len(trail)))
    return found


def _smeared(
    stage: Stage,
    balls: BallSprites,
    stand: SpritePose,
    picture: Picture | None,
    trail: Trail,
) -> tuple[Slices, F32, F32] | None:
    """A box of the canvas, light (h, w, 3) and coverage (h, w) there: means over the trail; None: nothing."""
    if (whole := _unclipped(stage, balls, stand, picture, trail)) is None:
        return None
    corner, light, coverage = whole
    right, bottom = coverage.shape[1] - 1, coverage.shape[0] - 1
    corners = np.array(
        [[0, 0, 1], [right, 0, 1], [0, bottom, 1], [right, bottom, 1]], np.float64
    )
    middle = (
        np.array([stand.pose.x, stand.pose.y + stage.sprites[stand.k].face]) - corner
    )
    way = np.array(trail)
    turns = np.array([rotation(angle) for _, _, angle in trail])
    shifts = middle + way[:, :2] - turns @ middle
    moves = np.concatenate([turns, shifts[..., None]], axis=2)
    ends = corners @ moves.transpose(0, 2, 1) + corner
    low = np.maximum(np.floor(ends.min(axis=(0, 1))).astype(int), 0)
    high = np.minimum(
        np.ceil(ends.max(axis=(0, 1))).astype(int) + 1, stage.background.shape[1::-1]
    )
    if (low >= high).any():
        return None
    shape = (int(high[0] - low[0]), int(high[1] - low[1]))
    sharp = np.empty((*coverage.shape, 4), np.float32)
    cv2.mixChannels([light, coverage], [sharp], [0, 0, 1, 1, 2, 2, 3, 3])
    total = np.zeros((shape[1], shape[0], 4), np.float32)
    moves[:, :, 2] += corner - low
    for move in moves:
        cv2.add(total, cv2.warpAffine(sharp, move, shape), dst=total)
    total *= np.float32(1 / len(moves))
    light = np.asarray(
        cv2.cvtColor(total, cv2.COLOR_BGRA2BGR), np.float32
    )  # the first three channels
    box = np.s_[int(low[1]) : int(high[1]), int(low[0]) : int(high[0])]
    return box, light, np.asarray(cv2.extractChannel(total, 3), np.float32)


def _unclipped(
    stage: Stage,
    balls: BallSprites,
    stand: SpritePose,
    picture: Picture | None,
    trail: Trail,
) -> tuple[NDArray[np.int64], F32, F32] | None:
    """Left and top, px, light (h, w, 3) and coverage (h, w) of what the trail brings into the canvas; None: nothing."""
    height, width = stage.background.shape[:2]
    if picture is not None:
        rows, columns = picture.where.box
        if (
            min(rows.start, columns.start) > 0
            and rows.stop < height
            and columns.stop < width
        ):
            return (
                np.array([columns.start, rows.start]),
                picture.light,
                picture.coverage,
            )
    sprite = stage.sprites[stand.k]
    rim = (
        ceil(
            max(
                hypot(x, y) + min(abs(a), 2.0) * hypot(*sprite.coverage.shape)
                for x, y, a in trail
            )
        )
        + 1
    )
    pose = stand.pose._replace(x=stand.pose.x + rim, y=stand.pose.y + rim)
    where = place_sprite(
        sprite, stand.start, pose, (width + 2 * rim, height + 2 * rim), stand.space
    )
    if where is None:
        return None
    ball = balls.drawn([(stand.k, where)], stage.supersample).get(stand.k)
    light, coverage = ball or draw_sprite(sprite, where, stage.supersample)
    top, left = (part.start - rim for part in where.box)
    if (
        picture is not None and picture.factor is not None
    ):  # the shade at the border goes on beyond it
        move = np.array([[1.0, 0, columns.start - left], [0, 1, rows.start - top]])
        shade = cv2.warpAffine(
            picture.factor, move, coverage.shape[::-1], borderMode=cv2.BORDER_REPLICATE
        )
        light = light * three_channels(np.asarray(shade, np.float32))
    return np.array([left, top]), light, coverage


def _named(covers: Sequence[tuple[int, Slices, F32]], size: tuple[int, int]) -> U16:
    """(H, W) ids of objects, the farthest first, that cover boxes so far."""
    ids = np.zeros(size[::-1], np.uint16)
    for id_, box, coverage in covers:
        np.copyto(ids[box], np.uint16(id_), where=coverage >= 0.5)
    return ids


def _covering(covers: Sequence[tuple[int, Slices, F32]]) -> list[Cover]:
    """The same, each by itself: nothing in it that ids would not show if nothing were in front."""
    return [Cover(id_ - 1, box, coverage >= 0.5) for id_, box, coverage in covers]


def _pictures(
    stage: Stage, balls: BallSprites, stands: Sequence[SpritePose]
) -> Iterator[Picture]:
    """What the picture shows of sprites as they stand, the farthest first."""
    there = [(stand, stand.where) for stand in stands if stand.where is not None]
    together = balls.drawn(
        ((stand.k, where) for stand, where in there), stage.supersample
    )
    borders = borders_left(stage.sprites, [stand for stand, _ in there])
    for (stand, where), left in zip(there, borders, strict=True):
        sprite = stage.sprites[stand.k]
        light, coverage = together.get(stand.k) or draw_sprite(
            sprite, where, stage.supersample
        )
        yield Picture(stand, where, light, coverage, draw_border(sprite, where, left))


def _add_sides(stage: Stage, pictures: Sequence[Picture]) -> None:
    """Add the sides of blocks that turned, where no front of another object is: fronts are in one plane."""
    turned = [
        (picture, sides)
        for picture in pictures
        if (sides := stage.sprites[picture.stand.k].sides) is not None
        and sides.share(picture.where.turn) > 0
    ]
    if not turned:
        return
    fronts = [(picture, picture.where.box, picture.coverage) for picture in pictures]
    for picture, sides in turned:
        (rows, columns), coverage = picture.where.box, picture.coverage
        side, shade = sides.drawn(coverage, picture.where.turn)
        mixed = np.minimum(2 * side, coverage)  # the light of border pixels is a guess
        kept = np.asarray(1 - mixed / np.maximum(coverage, 1e-3), np.float32)
        picture.light = np.asarray(
            cv2.multiply(picture.light, three_channels(kept)), np.float32
        )
        side, coverage = side + mixed, coverage - mixed
        lit = np.broadcast_to(shade, side.shape).copy()
        for other, (tall, wide), front in fronts:
            top, bottom = max(rows.start, tall.start), min(rows.stop, tall.stop)
            first, last = max(columns.start, wide.start), min(columns.stop, wide.stop)
            if other is picture or top >= bottom or first >= last:
                continue
            here = np.s_[
                top - rows.start : bottom - rows.start,
                first - columns.start : last - columns.start,
            ]
            part = front[
                top - tall.start : bottom - tall.start,
                first - wide.start : last - wide.start,
            ]
            side[here] *= 1 - part
            if sides.light is not None:
                lit[here] *= 1 - np.float32(CUT.side_hidden) * cv2.blur(
                    part, (2 * round(sides.depth) + 1,) * 2
                )
        lit *= side
        picture.light = np.asarray(
            cv2.add(picture.light, cv2.merge([lit * part for part in sides.colour])),
            np.float32,
        )
        picture.coverage = coverage + side


def _mirrored(stage: Stage, picture: Picture, left: F32) -> tuple[Slices, F32] | None:
    """A box of the canvas and (h, w, 3) what the floor mirrors of an object that has moved; None: nothing.

    As far as the photo's own reflection has gone, which is part of what is `left` (N + 1,) around the object.
    """
    k, (rows, columns) = picture.stand.k, picture.where.box
    stood = None if stage.mirror is None else stage.mirror.feet[k]
    if stage.mirror is None or stood is None or picture.where.own is not None:
        return None
    foot = stood[0]
    first = max(
        rows.start,
        foot + 1 - len(stage.mirror.share),
        2 * foot + 2 - len(stage.background),
    )
    last = min(rows.stop, foot + 1)
    if first >= last:
        return None
    share = stage.mirror.share[foot + 1 - last : foot + 1 - first] * (
        1 - left[stage.sprites[k].body + 1]
    )
    light = (
        picture.light[first - rows.start : last - rows.start][::-1]
        * share[:, None, None]
    )
    across = np.arange(columns.start, columns.stop)
    light *= ((across >= stood[1]) & (across <= stood[2]))[:, None]
    box = np.s_[2 * foot + 2 - last : 2 * foot + 2 - first, columns]
    light = cv2.GaussianBlur(
        light, (0, 0), stage.mirror.rough, borderType=cv2.BORDER_REPLICATE
    )
    return box, np.asarray(light, np.float32)


def _figures(stage: Stage, pictures: Sequence[Picture]) -> Mapping[int, Silhouette]:
    """Sprites in the picture as light sees them: it does not ask how finely an object is drawn."""
    found = {}
    for p in pictures:
        own = (
            p.coverage
            if stage.supersample == 1
            else sprite_coverage(stage.sprites[p.stand.k], p.where)
        )
        found[p.stand.k] = sprite_silhouette(stage, p.stand, p.where, own)
    return found
