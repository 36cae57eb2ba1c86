"""Stage + Trajectory -> what the player draws: background, objects and shadows as small pictures in data URIs.

Shadows are true at a few moments of an object's way and shift and cross-fade between them. A ball's skin turns in space
and its light stays, as in the video; the shading of anything else turns with it, and no shadow falls on a thing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import encode_u8
from physgen.render.lit import Lit, shaded
from physgen.render.placing import covered
from physgen.render.shadowed import figured
from physgen.render.sprites import Sprite
from physgen.render.stage import Stage, Stand, planned
from physgen.report.encoded import smaller, webp
from physgen.shadow.cast import Box
from physgen.simulate.trajectory import Trajectory

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]
Array = NDArray[np.float64]

LARGEST = 1280
"""px of the background's longer side: twice what a page shows of it."""
QUALITY = 86
"""Of WebP."""
KEYS = 9
"""Moments at which a shadow is worked out, at most."""
STRAYS = 5.0
"""px by which a thing's border may be off its straight way between two of them."""
BALLS = 90
"""Of WebP, for what balls are put together from."""
SMALL = 20_000
"""px² of a picture that may be flat colours."""
LARGE = 60_000
"""px² of a ball's box up to which the page's script turns it in space: it does so one pixel after the other."""
GAMMA = 2.2
"""A shadow's share of linear light, to the power of 1 / GAMMA, is about that of an sRGB code, which browsers blend."""
FAINTEST = 0.012
"""Of light, that a shadow takes."""
SHADOW = 72
"""px of the longer side of a shadow's picture: it is soft."""


@dataclass(frozen=True)
class Cutouts:
    """Pictures of a stage; places and sizes are px of the photo, from its top-left pixel's centre."""

    background: str
    sprites: list[dict[str, Any]]
    """`body`, `box` (left, top, width, height), `turns`, `src`; the farthest first. Of a ball that shows how it turns
    also `ball`: `center` from the box's corner, `radius`, px, and `skin`, `lit`, `gloss`, each with its `most`."""
    shadows: list[dict[str, Any]]
    """`body`, `slides`, `keys`: `sample`, `box`, `at` (middle of its darkness), `src`."""


def cutouts(stage: Stage, trajectory: Trajectory) -> Cutouts:
    """What moves by itself as pictures of their own; what never moves keeps its shadow in the background."""
    moving = _moving(stage, trajectory)
    return Cutouts(plate(stage, moving), sprites(stage), shadows(stage, trajectory, moving))


def plate(stage: Stage, moving: Sequence[int]) -> str:
    """The background without the shadows of some of its sprites."""
    background = stage.background
    if stage.lit is not None and moving:
        dark = stage.lit.total.copy()
        for k in moving:
            if (whole := stage.lit.casts[k].whole) is not None:
                (x0, y0, x1, y1), was = whole
                dark[y0:y1, x0:x1] -= was
        background = encode_u8(shaded(stage.lit.plate, dark, stage.lit.tint))
    return webp(_smaller(background, _less(stage)), QUALITY)


def sprites(stage: Stage) -> list[dict[str, Any]]:
    """Rows as `Cutouts.sprites` has them, of all that shows."""
    return [_cut(sprite, _less(stage), stage.scale) for sprite in stage.sprites if sprite.coverage.any()]


def _less(stage: Stage) -> float:
    """Of the picture's size, at which it is shown."""
    return float(min(1.0, LARGEST / max(stage.background.shape[:2])))


def _smaller(pixels: U8, less: float) -> U8:
    if less >= 1:
        return pixels
    height, width = (max(1, round(side * less)) for side in pixels.shape[:2])
    return np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def _moving(stage: Stage, trajectory: Trajectory) -> list[int]:
    """Sprites whose body is ever elsewhere than at t = 0."""
    if not len(trajectory.poses):
        return []
    moves = (trajectory.poses != trajectory.poses[:1]).any(axis=(0, 2))
    if stage.starts:
        moves |= (trajectory.poses[0] != np.array(stage.starts)).any(axis=1)
    return [k for k, sprite in enumerate(stage.sprites) if moves[sprite.body]]


def _cut(sprite: Sprite, less: float, scale: float) -> dict[str, Any]:
    """A sprite with unmultiplied colours on what it covers, and a pixel around."""
    x0, y0, x1, y1 = sprite.within
    h, w = sprite.coverage.shape
    rows, columns = slice(max(y0 - 1, 0), min(y1 + 1, h)), slice(max(x0 - 1, 0), min(x1 + 1, w))
    alpha = sprite.coverage[rows, columns]
    bare = sprite.light[rows, columns] / np.maximum(alpha, 1e-3)[..., None]
    covers = np.rint(255 * np.clip(alpha, 0, 1)).astype(np.uint8)
    pixels = np.dstack([encode_u8(np.clip(bare, 0, 1)), covers])
    left, top = sprite.corner[0] + columns.start, sprite.corner[1] + rows.start
    found = {
        "body": sprite.body,
        "box": _placed((left, top, left + alpha.shape[1], top + alpha.shape[0]), scale),
        "turns": not _looks_alike(sprite),
        "src": (smaller if alpha.size <= SMALL else webp)(_smaller(pixels, less), QUALITY),
    }
    if sprite.ball is not None and found["turns"] and less == 1 and alpha.size <= LARGE:
        ball = sprite.ball
        found["ball"] = {
            "center": [round(ball.center[0] - left, 3), round(ball.center[1] - top, 3)],
            "radius": round(ball.radius, 3),
            "skin": _coded(ball.skin[rows, columns]),
            "lit": _coded(ball.lit[rows, columns]),
            "gloss": _coded(ball.gloss[rows, columns], signed=True),
        }
    return found


def _coded(values: F32, *, signed: bool = False) -> dict[str, Any]:
    """Linear light (h, w, 3) as a picture of its roots, which eyes see evenly; none is grey where `signed`."""
    most = max(float(np.abs(values).max()), 1e-6)
    roots = np.sqrt(np.abs(values) / most)
    codes = 128 + 127 * np.sign(values) * roots if signed else 255 * roots * (values > 0)
    return {"most": float(f"{most:.4g}"), "src": webp(np.rint(codes).astype(np.uint8), BALLS)}


def _looks_alike(sprite: Sprite) -> bool:
    """Whether a ball looks the same however it has turned: its skin is of one colour, and its shading stays."""
    return sprite.ball is not None and float(np.ptp(sprite.ball.skin, axis=(0, 1)).max()) < 1e-6


def _placed(box: Box, scale: float) -> list[float]:
    """Left, top, width, height, px of the photo; (0, 0) is the middle of a pixel."""
    x0, y0, x1, y1 = box
    return [round(v, 3) for v in (x0 / scale - 0.5, y0 / scale - 0.5, (x1 - x0) / scale, (y1 - y0) / scale)]


def keyed(path: Array, reach: float) -> list[int]:
    """Samples of a way (T, 3) px, px, rad between which it is about straight: ends and the most bent between them."""
    flat = path * (1, 1, reach)
    keys = [0, len(flat) - 1] if len(flat) > 1 else [0]
    while len(keys) < KEYS:
        samples = np.arange(len(flat))
        straight = np.stack([np.interp(samples, keys, column[keys]) for column in flat.T], axis=1)
        away = np.abs(flat - straight).max(axis=1)
        if away.max() <= STRAYS:
            break
        keys = sorted({*keys, int(away.argmax())})
    return keys


def shadows(stage: Stage, trajectory: Trajectory, moving: Sequence[int]) -> list[dict[str, Any]]:
    """Rows as `Cutouts.shadows` has them, of some of the sprites."""
    return [] if stage.lit is None or not moving else list(_shadows(stage, stage.lit, trajectory, moving))


def _shadows(
    stage: Stage, lit: Lit, trajectory: Trajectory, moving: Sequence[int]
) -> Iterator[dict[str, Any]]:
    """Of each thing that moves; one that slides keeps its shape and is worked out once."""
    keys: dict[int, list[int]] = {}
    for k in moving:
        body = stage.sprites[k].body
        reach = max(stage.sprites[k].coverage.shape) / 2
        keys[k] = [0] if lit.casts[k].sliding is not None else keyed(trajectory.poses[:, body], reach)
    order = sorted({sample for mine in keys.values() for sample in mine})
    rows: dict[int, list[dict[str, Any]]] = {k: [] for k in moving}
    for sample, (_, stands) in zip(order, planned(stage, trajectory, order), strict=True):
        for k in moving:
            if sample in keys[k]:
                dark = _dark(stage, lit, stands[k])
                rows[k].append({"sample": sample} | ({} if dark is None else _shadow(*dark)))
    for k in moving:
        if any("src" in row for row in rows[k]):
            slides = lit.casts[k].sliding is not None
            yield {"body": stage.sprites[k].body, "slides": slides, "keys": rows[k]}


def _dark(stage: Stage, lit: Lit, stand: Stand) -> tuple[Box, F32] | None:
    """A box that may leave the photo, and -log of the light that a thing leaves there as it stands."""
    cast = lit.casts[stand.k]
    if cast.sliding is not None:
        (x, y), dark = cast.sliding
        return (x, y, x + dark.shape[1], y + dark.shape[0]), dark
    if stand.start == stand.pose:
        return cast.whole
    now = None
    if stand.where is not None:
        now = figured(stage, stand, stand.where, covered(stage.sprites[stand.k], stand.where))
    parts = lit.moved(stand.k, now, stand.start, stand.pose)
    if not parts:
        return None
    x0, y0 = (min(box[k] for box, _ in parts) for k in (0, 1))
    x1, y1 = (max(box[k] for box, _ in parts) for k in (2, 3))
    total = np.zeros((y1 - y0, x1 - x0), np.float32)
    for (left, top, right, bottom), dark in parts:
        total[top - y0 : bottom - y0, left - x0 : right - x0] += dark
    return (x0, y0, x1, y1), total


def _shadow(box: Box, dark: F32) -> dict[str, Any]:
    """Its picture, black that covers more or less; nothing where it is too faint to be seen."""
    covers = 1 - np.exp(-np.maximum(dark, 0) / GAMMA)
    rows, columns = (np.flatnonzero((covers > FAINTEST).any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return {}
    y0, y1, x0, x1 = int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
    covers = covers[y0:y1, x0:x1]
    total = float(covers.sum())
    at = [
        float((covers.sum(axis=0) * np.arange(x1 - x0)).sum()) / total + box[0] + x0,
        float((covers.sum(axis=1) * np.arange(y1 - y0)).sum()) / total + box[1] + y0,
    ]
    alpha = np.rint(255 * covers).astype(np.uint8)
    black = np.zeros((*alpha.shape, 4), np.uint8)
    black[..., 3] = alpha
    black = _smaller(black, min(1.0, SHADOW / max(alpha.shape)))
    place = (box[0] + x0, box[1] + y0, box[0] + x1, box[1] + y1)
    return {
        "box": _placed(place, 1.0),
        "at": [round(v, 2) for v in at],
        "src": webp(black, 0),  # coverage is kept whatever the quality
    }
