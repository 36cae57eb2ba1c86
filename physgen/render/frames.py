"""Stage + Trajectory -> Frames, one at a time; blending and warping happen in linear light."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.render.balls import Balls
from physgen.render.encoding import encoded
from physgen.render.left import Left
from physgen.render.lit import shaded
from physgen.render.placing import Placement, Slices, covered, drawn, resting, thrice
from physgen.render.shadowed import brightened, figured, lifted, thrown, veiled
from physgen.render.slides import Slides
from physgen.render.stage import Cover, Frame, Stage, Stand, planned
from physgen.render.threads import one_thread
from physgen.render.tiles import runs, tiled, union
from physgen.shadow.cast import Silhouette
from physgen.simulate.trajectory import Trajectory

F32 = NDArray[np.float32]
U16 = NDArray[np.uint16]


@dataclass
class Picture:
    """What a frame shows of one sprite."""

    stand: Stand
    where: Placement
    light: F32
    """(h, w, 3) linear, times coverage."""
    coverage: F32
    """(h, w)."""
    through: F32
    """(h, w, 3): 1 - coverage."""
    rest: tuple[Slices, F32] | None
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
    """Works out where things are, the farthest first."""
    boxes: list[Slices]
    """Where the canvas is not what was `Left`; they do not overlap."""


def render_frames(
    stage: Stage, trajectory: Trajectory, order: Sequence[int] | None = None, parts: int = 1
) -> Iterator[Frame]:
    """Frames of the trajectory's samples in their `order`, all one after the other unless given.

    Each is the mean of the light of `parts` samples, with the time and the ids of the last. Each object's own box is
    warped, and only touched tiles are encoded again. What a frame shows does not depend on those before it; the
    photo's own poses are those of sample 0.
    """
    with one_thread():
        left = Left(stage, keep=parts > 1)
        moments = _moments(stage, planned(stage, trajectory, order), left)
        more = np.zeros_like(left.light) if parts > 1 else None
        index = 0
        while group := list(islice(_added(moments, left, more), parts)):
            last = group[-1]
            rgb = left.codes.copy()
            if more is None:
                for box in last.boxes:
                    rgb[box] = encoded(last.canvas[box])
            else:
                size = (rgb.shape[1], rgb.shape[0])
                for box in union([box for moment in group for box in moment.boxes], size):
                    rgb[box] = encoded(left.light[box] + more[box] / np.float32(parts))
                    more[box] = 0
            yield Frame(index, last.time, rgb, last.named, last.covering)
            index += 1


def _added(moments: Iterator[Moment], left: Left, more: F32 | None) -> Iterator[Moment]:
    """The same; what is there beyond what was left is added to `more` (H, W, 3)."""
    for moment in moments:
        if more is not None:
            for box in moment.boxes:
                more[box] += moment.canvas[box] - left.light[box]
        yield moment


def _moments(stage: Stage, moments: Iterable[tuple[float, list[Stand]]], left: Left) -> Iterator[Moment]:
    """The picture of each moment over what is `left` when things have gone."""
    lit, size = stage.lit, (stage.background.shape[1], stage.background.shape[0])
    balls, slides = Balls(stage.sprites), Slides([] if lit is None else lit.casts)
    canvas: F32 = left.light.copy()
    dark = None if left.dark is None else left.dark.copy()
    shadowed: list[Slices] = []
    before = tiled([], size)
    for time, stands in moments:
        changed = left.by(stands)
        before = [a | b for a, b in zip(before, tiled(changed, size), strict=True)]
        pictures = list(_pictures(stage, balls, stands))
        figures: Mapping[int, Silhouette] = {}
        relit = tiled([], size)
        if lit is not None and dark is not None and left.dark is not None:
            for box in shadowed + changed:
                dark[box] = left.dark[box]
            figures, shadowed = _figures(stage, pictures), []
            moved = [stand for stand in stands if stand.start != stand.pose]
            for stand in moved:
                if left.keep:
                    shadowed += lifted(dark, lit, stand)
                if lit.casts[stand.k].sliding is None:
                    shadowed += thrown(dark, lit, stand, figures.get(stand.k))
            shadowed += slides.thrown(dark, moved)
            relit = tiled(shadowed, size)
            for box in (shadowed := runs(relit, size)):
                canvas[box] = shaded(lit.plate[box], dark[box], lit.tint)
            factors = veiled(stage, [p.stand for p in pictures], figures)
            for picture in pictures:
                if (factor := factors.get(picture.stand.k)) is not None:
                    picture.light = picture.light * thrice(factor)
        for box in runs([a & ~b for a, b in zip(before, relit, strict=True)], size):
            canvas[box] = left.light[box]
        touched = list(shadowed)
        for picture in pictures:
            box = picture.where.box
            under = canvas[box]
            cv2.multiply(under, picture.through, dst=under)
            cv2.add(under, picture.light, dst=under)
            touched.append(box)
            if picture.rest is not None:
                box, rest = picture.rest
                canvas[box] += rest if dark is None or lit is None else brightened(rest, lit, dark, box)
                touched.append(box)
        before = tiled(touched, size)
        covers = [(stage.sprites[p.stand.k].body + 1, p.where.box, p.coverage) for p in pictures]
        named, covering = partial(_named, covers, size), partial(_covering, covers)
        yield Moment(time, canvas, named, covering, runs(before, size))


def _named(covers: Sequence[tuple[int, Slices, F32]], size: tuple[int, int]) -> U16:
    """(H, W) ids of things, the farthest first, that cover boxes so far."""
    ids = np.zeros(size[::-1], np.uint16)
    for id_, box, coverage in covers:
        np.copyto(ids[box], np.uint16(id_), where=coverage >= 0.5)
    return ids


def _covering(covers: Sequence[tuple[int, Slices, F32]]) -> list[Cover]:
    """The same, each by itself: nothing in it that ids would not show if nothing were in front."""
    return [Cover(id_ - 1, box, coverage >= 0.5) for id_, box, coverage in covers]


def _pictures(stage: Stage, balls: Balls, stands: Sequence[Stand]) -> Iterator[Picture]:
    """What the picture shows of sprites as they stand, the farthest first."""
    there = [(stand, stand.where) for stand in stands if stand.where is not None]
    together = balls.drawn(((stand.k, where) for stand, where in there), stage.supersample)
    for stand, where in there:
        sprite = stage.sprites[stand.k]
        if (ball := together.get(stand.k)) is not None:
            yield Picture(stand, where, ball.light, ball.coverage, ball.through, resting(sprite, where))
        else:
            light, coverage = drawn(sprite, where, stage.supersample)
            yield Picture(stand, where, light, coverage, thrice(1 - coverage), resting(sprite, where))


def _figures(stage: Stage, pictures: Sequence[Picture]) -> Mapping[int, Silhouette]:
    """Sprites in the picture as light sees them: it does not ask how finely a thing is drawn."""
    return {
        p.stand.k: figured(
            stage,
            p.stand,
            p.where,
            p.coverage if stage.supersample == 1 else covered(stage.sprites[p.stand.k], p.where),
        )
        for p in pictures
    }
