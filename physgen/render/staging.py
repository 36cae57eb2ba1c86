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
from physgen.render.ball import skin
from physgen.render.frames import Actor, Stage, silhouette
from physgen.render.relief import relief
from physgen.render.sprites import Sprite, anchored
from physgen.scene.model import Scene, Solid, View
from physgen.shadow import Setting

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
    if scene.render.relight:
        sprites = [_skinned(sprite, world.bodies[sprite.body], light, world.view) for sprite in sprites]
        if maps.normals is not None:
            sprites = [_relieved(sprite, maps.normals, light) for sprite in sprites]
    if not scene.render.shadows:
        return Stage(background, sprites)
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
    actors = [Actor(_radius(world.bodies[s.body]), thickness(world.bodies[s.body], top)) for s in sprites]
    starts = [
        silhouette(grounds, s.coverage, s.corner, _start(world.bodies[s.body]), actor)
        for s, actor in zip(sprites, actors, strict=True)
    ]
    rounds = [world.bodies[s.body].radius is not None for s in sprites]
    lit = take_apart(background, maps.clean, coverage, starts, rounds, setting)
    sprites = anchored(sprites, decode(maps.rgb), lit.behind(), absent)
    return Stage(background, sprites, lit, actors, grounds)


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


def _radius(body: Body) -> float | None:
    return body.radius if body.solid is Solid.SPHERE else None


def _skinned(sprite: Sprite, body: Body, light: DistantLight, view: View) -> Sprite:
    """A sphere's sprite with its skin; any other as it is."""
    if body.radius is None or body.solid is not Solid.SPHERE or sprite.coverage.max(initial=0) < 1:
        return sprite
    x, y = body.center.tolist()
    rows, columns = np.indices(sprite.coverage.shape)
    away = np.hypot(columns + sprite.corner[0] - x, rows + sprite.corner[1] - y)
    if sprite.coverage[away > body.radius + 2].sum() > STRAY * sprite.coverage.sum():
        return sprite  # a thread, a handle: what is no ball turns as a picture
    alpha = sprite.coverage[..., None]
    colour = np.where(alpha > 1e-3, sprite.light / np.maximum(alpha, 1e-3), 0).astype(np.float32)
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
