"""Stage and trajectory to frames, one at a time; blending and warping in linear light.

Only tiles that objects or their shadows touch are composed and encoded again, over a cached background in the light of
the objects that have not moved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from itertools import islice
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.shadows import Silhouette
from physgen.photometry import decode, encode_u8
from physgen.render.atlas import BallSprites, ShadowSprites
from physgen.render.occlusion import (
    add_shadow,
    occlusion_factors,
    relit_border,
    remove_photo_shadow,
    sprite_silhouette,
)
from physgen.render.shadow_decomposition import shaded_background
from physgen.render.stage import (
    Cover,
    Frame,
    Placement,
    SpritePose,
    Stage,
    draw_border,
    draw_halo,
    draw_sprite,
    sprite_coverage,
    sprite_poses,
    three_channels,
)
from physgen.render.stage import Slices as Slices_of_stage
from physgen.simulate.trajectory import Trajectory


def encode_picture(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The nearest sRGB code of linear light, any shape (h, w, 3); the same bytes as `encode_u8`, in half the time."""
    if not _looks_up():
        return encode_u8(linear)
    index = linear * np.float32(65535)
    index += np.float32(0.5)
    np.clip(index, 0, 65535, out=index)
    return np.asarray(cv2.LUT(index.astype(np.uint16), _table()), np.uint8)


@cache
def _table() -> NDArray[np.uint8]:
    """(65536,) codes of 16-bit light."""
    return encode_u8(np.arange(65536, dtype=np.float32) / np.float32(65535))


@cache
def _looks_up() -> bool:
    """Whether OpenCV has look-ups of 16 bits."""
    one: Any = np.zeros((1, 1, 3), np.uint16)
    try:
        return bool(cv2.LUT(one, _table()).dtype == np.uint8)
    except cv2.error:
        return False


TILE = 32
"""px a side of the tiles in which touched pixels are counted."""

Slices = tuple[slice, slice]


def covering_boxes(boxes: Sequence[Slices], size: tuple[int, int]) -> list[Slices]:
    """Runs of tiles that cover the boxes on a canvas of `size` (W, H); equal runs that touch become one box."""
    return boxes_of_tiles(touched_tiles(boxes, size), size)


def touched_tiles(boxes: Sequence[Slices], size: tuple[int, int]) -> list[int]:
    """The tiles that the boxes touch: a number for each row of tiles, with a bit for each tile."""
    marked = [0] * (-(-size[1] // TILE))
    for rows, columns in boxes:
        if rows.stop > rows.start and columns.stop > columns.start:
            run = (1 << ((columns.stop - 1) // TILE + 1)) - (1 << (columns.start // TILE))
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


F32 = NDArray[np.float32]


class BackgroundCache:
    """What is left when objects have gone; kept from frame to frame, as most objects that move go on moving.

    It depends on none of the frames that came before: the same objects gone leave the same to the last bit.
    """

    def __init__(self, stage: Stage, keep: bool) -> None:
        """With `keep` it stays the photo's background whatever moves."""
        self.keep = keep
        self._lit = stage.lit
        self._gone: set[int] = set()
        self.dark: F32 | None = None if stage.lit is None else stage.lit.total.copy()
        """(H, W): -log of the light that is left."""
        self.light: F32 = decode(stage.background) if stage.lit is None else stage.lit.behind()
        """(H, W, 3) linear."""
        self.codes = encode_picture(self.light)
        """(H, W, 3) sRGB."""

    def by(self, stands: Sequence[SpritePose]) -> list[Slices_of_stage]:
        """Go on to objects as they stand now; returns where anything changed."""
        lit, dark = self._lit, self.dark
        if self.keep or lit is None or dark is None:
            return []
        shadows = {s.k: lit.casts[s.k].whole for s in stands if s.start != s.pose}
        gone = {k for k, whole in shadows.items() if whole is not None}
        if gone == self._gone:
            return []
        boxes = [whole[0] for k in gone ^ self._gone if (whole := lit.casts[k].whole) is not None]
        self._gone = gone
        changed = covering_boxes(
            [np.s_[y0:y1, x0:x1] for x0, y0, x1, y1 in boxes], (dark.shape[1], dark.shape[0])
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


def _take(dark: F32, box: Slices_of_stage, at: tuple[int, int, int, int], what: F32) -> None:
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


U16 = NDArray[np.uint16]


@dataclass
class Picture:
    """What a frame shows of one sprite."""

    stand: SpritePose
    where: Placement
    light: F32
    """(h, w, 3) linear, times coverage."""
    coverage: F32
    """(h, w)."""
    through: F32
    """(h, w, 3): 1 - coverage."""
    rest: tuple[Slices_of_stage, F32] | None
    """A box and (h, w, 3) what the photo shows there beyond light and background; as bright as the background is."""


@dataclass(frozen=True)
class Moment:
    """A picture in linear light; `canvas` is overwritten by the next."""

    time: float
    canvas: F32
    """(H, W, 3)."""
    named: Callable[[], U16]
    """Works out the ids, (H, W)."""
    covering: Callable[[], Sequence[Cover]]
    """Works out where objects are, the farthest first."""
    boxes: list[Slices_of_stage]
    """Where the canvas is not what was `Left`; they do not overlap."""


def render_frames(
    stage: Stage, trajectory: Trajectory, order: Sequence[int] | None = None, parts: int = 1
) -> Iterator[Frame]:
    """Frames of the trajectory's samples in their `order`, all one after the other unless given.

    Each is the mean of the light of `parts` samples, with the time and the ids of the last. Each object's own box is
    warped, and only touched tiles are encoded again. What a frame shows does not depend on those before it; the
    photo's own poses are those of sample 0.
    """
    with single_threaded():
        left = BackgroundCache(stage, keep=parts > 1)
        moments = _moments(stage, sprite_poses(stage, trajectory, order), left)
        more = np.zeros_like(left.light) if parts > 1 else None
        index = 0
        while group := list(islice(_added(moments, left, more), parts)):
            last = group[-1]
            rgb = left.codes.copy()
            if more is None:
                for box in last.boxes:
                    rgb[box] = encode_picture(last.canvas[box])
            else:
                size = (rgb.shape[1], rgb.shape[0])
                for box in covering_boxes([box for moment in group for box in moment.boxes], size):
                    rgb[box] = encode_picture(left.light[box] + more[box] / np.float32(parts))
                    more[box] = 0
            yield Frame(index, last.time, rgb, last.named, last.covering)
            index += 1


def _added(moments: Iterator[Moment], left: BackgroundCache, more: F32 | None) -> Iterator[Moment]:
    """The same; what is there beyond what was left is added to `more` (H, W, 3)."""
    for moment in moments:
        if more is not None:
            for box in moment.boxes:
                more[box] += moment.canvas[box] - left.light[box]
        yield moment


def _moments(
    stage: Stage, moments: Iterable[tuple[float, list[SpritePose]]], left: BackgroundCache
) -> Iterator[Moment]:
    """The picture of each moment over what is `left` when objects have gone."""
    lit, size = stage.lit, (stage.background.shape[1], stage.background.shape[0])
    balls, slides = BallSprites(stage.sprites), ShadowSprites([] if lit is None else lit.casts)
    canvas: F32 = left.light.copy()
    dark = None if left.dark is None else left.dark.copy()
    shadowed: list[Slices_of_stage] = []
    before = touched_tiles([], size)
    for time, stands in moments:
        changed = left.by(stands)
        before = [a | b for a, b in zip(before, touched_tiles(changed, size), strict=True)]
        pictures = list(_pictures(stage, balls, stands))
        figures: Mapping[int, Silhouette] = {}
        relit = touched_tiles([], size)
        if lit is not None and dark is not None and left.dark is not None:
            for box in shadowed + changed:
                dark[box] = left.dark[box]
            figures, shadowed = _figures(stage, pictures), []
            moved = [stand for stand in stands if stand.start != stand.pose]
            for stand in moved:
                if left.keep:
                    shadowed += remove_photo_shadow(dark, lit, stand)
                if lit.casts[stand.k].sliding is None:
                    shadowed += add_shadow(dark, lit, stand, figures.get(stand.k))
            shadowed += slides.thrown(dark, moved)
            relit = touched_tiles(shadowed, size)
            for box in (shadowed := boxes_of_tiles(relit, size)):
                canvas[box] = shaded_background(lit.plate[box], dark[box], lit.tint)
            factors = occlusion_factors(stage, [p.stand for p in pictures], figures)
            for picture in pictures:
                if (factor := factors.get(picture.stand.k)) is not None:
                    picture.light = picture.light * three_channels(factor)
        for box in boxes_of_tiles([a & ~b for a, b in zip(before, relit, strict=True)], size):
            canvas[box] = left.light[box]
        touched = list(shadowed)
        for picture in pictures:
            if (around := draw_halo(stage.sprites[picture.stand.k], picture.stand)) is not None:
                box, rest = around
                canvas[box] += rest if dark is None or lit is None else relit_border(rest, lit, dark, box)
                touched.append(box)
        for picture in pictures:
            box = picture.where.box
            under = canvas[box]
            cv2.multiply(under, picture.through, dst=under)
            cv2.add(under, picture.light, dst=under)
            touched.append(box)
            if picture.rest is not None:
                box, rest = picture.rest
                canvas[box] += rest if dark is None or lit is None else relit_border(rest, lit, dark, box)
                touched.append(box)
        before = touched_tiles(touched, size)
        covers = [(stage.sprites[p.stand.k].body + 1, p.where.box, p.coverage) for p in pictures]
        named, covering = partial(_named, covers, size), partial(_covering, covers)
        yield Moment(time, canvas, named, covering, boxes_of_tiles(before, size))


def _named(covers: Sequence[tuple[int, Slices_of_stage, F32]], size: tuple[int, int]) -> U16:
    """(H, W) ids of objects, the farthest first, that cover boxes so far."""
    ids = np.zeros(size[::-1], np.uint16)
    for id_, box, coverage in covers:
        np.copyto(ids[box], np.uint16(id_), where=coverage >= 0.5)
    return ids


def _covering(covers: Sequence[tuple[int, Slices_of_stage, F32]]) -> list[Cover]:
    """The same, each by itself: nothing in it that ids would not show if nothing were in front."""
    return [Cover(id_ - 1, box, coverage >= 0.5) for id_, box, coverage in covers]


def _pictures(stage: Stage, balls: BallSprites, stands: Sequence[SpritePose]) -> Iterator[Picture]:
    """What the picture shows of sprites as they stand, the farthest first."""
    there = [(stand, stand.where) for stand in stands if stand.where is not None]
    together = balls.drawn(((stand.k, where) for stand, where in there), stage.supersample)
    for stand, where in there:
        sprite = stage.sprites[stand.k]
        if (ball := together.get(stand.k)) is not None:
            yield Picture(stand, where, ball.light, ball.coverage, ball.through, draw_border(sprite, where))
        else:
            light, coverage = draw_sprite(sprite, where, stage.supersample)
            yield Picture(
                stand, where, light, coverage, three_channels(1 - coverage), draw_border(sprite, where)
            )


def _figures(stage: Stage, pictures: Sequence[Picture]) -> Mapping[int, Silhouette]:
    """Sprites in the picture as light sees them: it does not ask how finely an object is drawn."""
    return {
        p.stand.k: sprite_silhouette(
            stage,
            p.stand,
            p.where,
            p.coverage if stage.supersample == 1 else sprite_coverage(stage.sprites[p.stand.k], p.where),
        )
        for p in pictures
    }
