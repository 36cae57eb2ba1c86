"""Scene, World and sprites -> a Stage in true light: balls with a skin that turns, and shadows that move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import inf, radians, tan

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.geometry import Pose
from physgen.percepts.maps import Percepts
from physgen.photometry import DistantLight, decode
from physgen.render.apart import take_apart
from physgen.render.ball import shading, skin
from physgen.render.relief import relief
from physgen.render.shadowed import SUNK, ground_below, silhouette
from physgen.render.sprites import Sprite, anchored
from physgen.render.stage import Actor, Stage
from physgen.render.veils import reaching, veiling
from physgen.scene.model import Scene, Solid, View
from physgen.shadow.cast import Setting, Silhouette

F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Array = NDArray[np.float64]

FLAT = 0.8
"""Of its radius: how high a disc reaches above a table, where nobody says."""
DEEP = 0.9
"""Of the root of its area: how far anything else reaches through the plane of motion."""
STRAY = 0.03
"""Share of a ball's pixels that may lie outside its circle."""
THREAD = 2.0
"""px: how thick what hangs on a ball is."""
STEEP = 1.2
"""Rise over run from which a boundary is a wall, no floor."""


def staged(
    scene: Scene,
    world: World,
    sprites: Sequence[Sprite],
    maps: Percepts,
    background: U8,
    coverage: F32,
    absent: Mask,
) -> Stage:
    """`background` (H, W, 3) sRGB with the objects' shadows; `coverage` (H, W) of all objects, `absent` ones too."""
    if scene.light is None:
        return Stage(background, sprites)
    light = DistantLight(scene.light.direction, scene.light.intensity, scene.light.ambient)
    parts = [part for sprite in sprites for part in _parted(sprite, world.bodies[sprite.body])]
    top = world.view is View.TOP
    setting = Setting(
        light=light,
        softness=scene.light.softness,
        top=top,
        tilt=max(tan(radians(scene.world.tilt)), 1e-3),
        backdrop=inf if scene.world.backdrop is None else scene.world.backdrop,
        size=world.size,
    )
    grounds = [] if top else floors(world)
    if np.isfinite(setting.backdrop) and maps.shadows is not None:
        grounds = [ground for ground in grounds if not passed(ground, maps.labels, maps.shadows)]
    actors = [_actor(sprite, world.bodies[sprite.body], loose, top) for sprite, loose in parts]
    starts = [
        silhouette(grounds, s.coverage, s.corner, _start(world.bodies[s.body]), actor)
        for (s, _), actor in zip(parts, actors, strict=True)
    ]
    veils: list[F32 | None] = [None] * len(parts)
    if scene.render.shadows and maps.clean is not None:  # a light that somebody has seen shadows of
        thrown = veiling(starts, reaching(starts, setting), setting)
        veils = [thrown.get(k) for k in range(len(starts))]
        shares = [
            1.0 if before is None else seen_share(sprite, actor, start, before, light)
            for (sprite, _), actor, start, before in zip(parts, actors, starts, veils, strict=True)
        ]
        actors = [replace(actor, veiled=share) for actor, share in zip(actors, shares, strict=True)]
        veils = [
            None if before is None or share == 0 else np.asarray(share * before, np.float32)
            for before, share in zip(veils, shares, strict=True)
        ]
    sprites = [sprite for sprite, _ in parts]
    if scene.render.relight:
        sprites = [
            sprite
            if actor.radius is None
            else _skinned(sprite, world.bodies[sprite.body], light, world.view, before)
            for sprite, actor, before in zip(sprites, actors, veils, strict=True)
        ]
        if maps.normals is not None:
            sprites = [_relieved(sprite, maps.normals, light) for sprite in sprites]
    if not scene.render.shadows:
        return Stage(background, anchored(sprites, decode(maps.rgb), decode(background), absent))
    rounds = [world.bodies[s.body].radius is not None and not loose for s, loose in parts]
    gone = _ghosts(maps.labels, absent, coverage, grounds, top)
    lit, left = take_apart(background, maps.clean, coverage, starts, rounds, setting, gone)
    photo = decode(maps.rgb)
    if left is not None:  # the photo as it would be without what is left out
        photo = photo * np.exp(np.where(coverage < 0.5, left, 0))[..., None].astype(np.float32)
    sprites = anchored(sprites, photo, lit.behind(), absent)
    return Stage(background, sprites, lit, actors, grounds, veils if maps.clean is not None else None)


def _ghosts(
    labels: NDArray[np.uint16], absent: Mask, coverage: F32, grounds: Sequence[Array], top: bool
) -> list[Silhouette]:
    """Things of the photo that the scene leaves out, as light saw them."""
    found = []
    for id_ in np.unique(labels[absent]).tolist():
        rows, columns = np.nonzero(absent & (labels == id_))
        y0, y1, x0, x1 = rows.min(), rows.max() + 1, columns.min(), columns.max() + 1
        own = np.where(labels[y0:y1, x0:x1] == id_, coverage[y0:y1, x0:x1], 0).astype(np.float32)
        thick = DEEP * float(np.sqrt(len(rows))) * (0.6 if top else 1.0)
        middle = Pose(float(columns.mean()), float(rows.mean()), 0.0)
        found.append(silhouette(grounds, own, (int(x0), int(y0)), middle, Actor(None, thick)))
    return found


def floors(world: World) -> list[Array]:
    """(4,) px: the segments of all walls on which things can stand."""
    found = []
    for wall in world.walls:
        for chain in wall.chains:
            for a, b in pairwise(chain):
                run, rise = abs(float(b[0] - a[0])), abs(float(b[1] - a[1]))
                if run > 1 and rise < STEEP * run:
                    found.append(np.array([*a, *b]))
    return found


def passed(ground: Array, labels: NDArray[np.uint16], shadows: NDArray[np.uint16]) -> bool:
    """Whether the photo shows shadows pass by a floor: those of things on it lie below it, on a wall behind.

    A floor that reaches back to the wall would have caught them; this one is a line that perception laid under things
    in the air, or a thin ledge. `ground` (4,) px; `labels` and `shadows` (H, W) by id.
    """
    below, seen = 0, 0
    for i in np.unique(shadows[shadows > 0]):
        rows, columns = np.nonzero(labels == i)
        if not len(rows):
            continue
        bottom = float(rows.max())
        row = ground_below([ground], float(columns.mean()), bottom)
        if row is not None and row - bottom < 2 * SUNK:
            seen += 1
            below += bool(np.median(np.nonzero(shadows == i)[0]) > row + SUNK)
    return 2 * below > seen


def thickness(body: Body, top: bool) -> float:
    """px that a body reaches above the table, or through the plane of motion: about its width, for want of better."""
    if body.radius is not None:
        return 2 * body.radius if body.solid is Solid.SPHERE or not top else FLAT * body.radius
    points = np.concatenate(body.pieces)
    width, height = np.ptp(points, axis=0).tolist()
    return float(DEEP * np.sqrt(width * height) * (0.6 if top else 1.0))


def _start(body: Body) -> Pose:
    x, y = body.center.tolist()
    return Pose(x, y, 0.0)


def seen_share(sprite: Sprite, actor: Actor, start: Silhouette, before: F32, light: DistantLight) -> float:
    """How much of a foretold veil (h, w) the photo shows on a thing, 0..1: light between things fills some of it.

    By least squares on the logarithm of its light, beside Lambert's shading of a ball and an even change over any face.
    """
    sure = sprite.coverage >= 1
    if np.count_nonzero(sure) < 80:
        return 0.0
    rows, columns = np.nonzero(sure)
    level = np.log(sprite.light[rows, columns].mean(axis=1) + 0.01).astype(np.float64)
    x, y = columns - columns.mean(), rows - rows.mean()
    if actor.radius is not None:
        u = (columns + sprite.corner[0] - start.center[0]) / actor.radius
        v = (rows + sprite.corner[1] - start.center[1]) / actor.radius
        z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
        level -= np.log(shading(light, *(part.astype(np.float32) for part in (u, v, z))))
    told = np.column_stack([np.ones(len(x)), x, y, -before[rows, columns]])
    told[:, 1:3] /= max(sprite.coverage.shape)
    trust = np.ones(len(x))
    found = np.zeros(4)
    for _ in range(4):
        weighted = told * trust[:, None]
        found = np.linalg.solve(
            weighted.T @ told + 1e-3 * len(x) * np.diag([0.0, 1, 1, 0.1]), weighted.T @ level
        )
        trust = 1 / np.maximum(np.abs(level - told @ found) / 0.15, 1)
    return float(np.clip(found[3], 0, 1))


def _actor(sprite: Sprite, body: Body, loose: bool, top: bool) -> Actor:
    if loose:
        return Actor(None, THREAD)
    ball = body.solid is Solid.SPHERE and sprite.coverage.max(initial=0) >= 1
    return Actor(body.radius if ball else None, thickness(body, top))


def _parted(sprite: Sprite, body: Body) -> list[tuple[Sprite, bool]]:
    """A ball apart from what hangs on it, a thread or a handle, which turns as a picture; and whether it is that."""
    if body.radius is None or body.solid is not Solid.SPHERE:
        return [(sprite, False)]
    x, y = body.center.tolist()
    rows, columns = np.indices(sprite.coverage.shape)
    away = np.hypot(columns + sprite.corner[0] - x, rows + sprite.corner[1] - y)
    if sprite.coverage[away > body.radius + 2].sum() <= STRAY * sprite.coverage.sum():
        return [(sprite, False)]
    # the thread lies beneath and reaches a pixel farther in, so that nothing shows through where they meet
    within = np.clip(body.radius + 1 - away, 0, 1).astype(np.float32)
    beyond = np.clip(away - body.radius + 1, 0, 1).astype(np.float32)
    return [
        (replace(sprite, light=sprite.light * part[..., None], coverage=sprite.coverage * part), loose)
        for part, loose in ((beyond, True), (within, False))
    ]


def _skinned(sprite: Sprite, body: Body, light: DistantLight, view: View, before: F32 | None) -> Sprite:
    """A sphere's sprite with its skin; `before` (h, w) is -log of the light that other things leave on it."""
    assert body.radius is not None
    x, y = body.center.tolist()
    alpha = sprite.coverage[..., None]
    colour = np.where(alpha > 1e-3, sprite.light / np.maximum(alpha, 1e-3), 0).astype(np.float32)
    if before is not None:
        colour *= np.exp(before)[..., None]
    return replace(sprite, ball=skin(colour, sprite.corner, (x, y), body.radius, light, view))


def _relieved(sprite: Sprite, normals: F32, light: DistantLight) -> Sprite:
    """Any other sprite with the photo's `normals` (H, W, 3)."""
    if sprite.ball is not None:
        return sprite
    height, width = normals.shape[:2]
    h, w = sprite.coverage.shape
    x0, y0 = sprite.corner
    own = np.zeros((h, w, 3), np.float32)
    known = np.zeros((h, w), bool)
    here = np.s_[max(y0, 0) : min(y0 + h, height), max(x0, 0) : min(x0 + w, width)]
    there = np.s_[here[0].start - y0 : here[0].stop - y0, here[1].start - x0 : here[1].stop - x0]
    own[there] = normals[here]
    known[there] = sprite.coverage[there] > 0.7
    return replace(sprite, relief=relief(own, known, light))
