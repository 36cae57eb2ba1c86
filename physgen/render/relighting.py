"""Skins and reliefs of sprites, so that their light changes as they turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from physgen.arrays import F32
from physgen.compile.world import Body, World
from physgen.materials import (
    is_billiard_ball,
    is_polished_metal,
)
from physgen.photometry import DistantLight
from physgen.render.ball import ball_from_photo
from physgen.render.ball_light import in_one_light
from physgen.render.hanging_ball import has_one_hue
from physgen.render.highlights import DiscPicture, shared_highlights
from physgen.render.reliefs import add_disc_relief, add_edge_relief
from physgen.render.sprites import (
    Gloss,
    Sprite,
    relief_of,
)
from physgen.render.stage import ShadowBody
from physgen.scene.scene import Scene, Solid, View


def relight_sprites(
    scene: Scene,
    world: World,
    sprites: Sequence[Sprite],
    actors: Sequence[ShadowBody],
    veils: Sequence[F32 | None],
    normals: F32 | None,
    light: DistantLight,
) -> list[Sprite]:
    """Return the sprites with skins or reliefs, so that their light changes as they
    turn.

    `normals`: those of the photo, (H, W, 3), if known.
    """
    is_top = world.view is View.TOP
    new_sprites = []
    for sprite, actor, veil in zip(sprites, actors, veils, strict=True):
        if actor.radius is not None:
            body = world.bodies[sprite.body]
            label = scene.objects[sprite.body].label
            sprite = _add_sphere_skin(sprite, body, light, world.view, veil, label)
        new_sprites.append(sprite)
    # Skins first, one by one; then balls of a set share their light.
    new_sprites = _share_ball_light(new_sprites)
    if normals is not None:
        new_sprites = [_add_relief(sprite, normals, light) for sprite in new_sprites]
    elif is_top:
        new_sprites = _part_highlights_of_discs(new_sprites, world)
        new_sprites = [
            add_disc_relief(sprite, world.bodies[sprite.body]) for sprite in new_sprites
        ]
    if not is_top:
        new_sprites = [add_edge_relief(sprite, light) for sprite in new_sprites]
    return new_sprites


def _share_ball_light(sprites: Sequence[Sprite]) -> list[Sprite]:
    """Return the sprites with their balls as in `in_one_light`."""
    balls = in_one_light([s.ball for s in sprites if s.ball is not None])
    remaining = iter(balls)
    result = []
    for sprite in sprites:
        if sprite.ball is not None:
            sprite = replace(sprite, ball=next(remaining))
        result.append(sprite)
    return result


def _add_sphere_skin(
    sprite: Sprite,
    body: Body,
    light: DistantLight,
    view: View,
    veil: F32 | None,
    label: str,
) -> Sprite:
    """Return a sphere's sprite with its skin.

    `veil` (h, w): -log of the light that remains behind other objects; `label`: the
    ball's noun.
    """
    assert body.radius is not None
    x, y = body.center.tolist()
    # The sprite's light is premultiplied; the skin needs the object's own colour.
    alpha = sprite.coverage[..., None]
    own_light = sprite.light / np.maximum(alpha, 1e-3)
    colour = np.where(alpha > 1e-3, own_light, 0).astype(np.float32)
    colour = _over_circle(colour, sprite, (x, y), body.radius)
    if veil is not None:
        colour *= np.exp(veil)[..., None]
    ball = ball_from_photo(
        colour,
        sprite.corner,
        (x, y),
        body.radius,
        light,
        view,
        has_paints=is_billiard_ball(label),
        is_mirror=is_polished_metal(label) and has_one_hue(sprite),
    )
    return replace(sprite, ball=ball)


def _over_circle(
    colour: F32, sprite: Sprite, center: tuple[float, float], radius: float
) -> F32:
    """Return the colour (h, w, 3) of a ball, also where its mask leaves its circle out.

    Lumpy fruit has bays in its circle that would turn as dark spots.
    """
    rows, columns = np.indices(sprite.coverage.shape)
    x = columns + sprite.corner[0]
    y = rows + sprite.corner[1]
    is_inside = np.hypot(x - center[0], y - center[1]) < radius
    is_open = is_inside & (sprite.coverage <= 1e-3)
    source = sprite.coverage > 0.5
    if not is_open.any() or not source.any():
        return colour
    # Bays take the colour of the nearest pixel of the mask.
    _, seeds = cv2.distanceTransformWithLabels(
        (~source).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.zeros((int(seeds.max()) + 1, 2), np.int64)
    places[seeds[source]] = np.argwhere(source)
    nearest = places[seeds[is_open]]
    filled = colour.copy()
    filled[is_open] = colour[nearest[:, 0], nearest[:, 1]]
    return filled


def _add_relief(sprite: Sprite, normals: F32, light: DistantLight) -> Sprite:
    """Add the relief of the photo's `normals` (H, W, 3) to a sprite that is not
    a ball.
    """
    if sprite.ball is not None:
        return sprite
    height, width = normals.shape[:2]
    h, w = sprite.coverage.shape
    x0, y0 = sprite.corner
    # The margin of a sprite may reach beyond the photo.
    top = max(y0, 0)
    bottom = min(y0 + h, height)
    left = max(x0, 0)
    right = min(x0 + w, width)
    box = np.s_[top - y0 : bottom - y0, left - x0 : right - x0]
    own_normals = np.zeros((h, w, 3), np.float32)
    own_normals[box] = normals[top:bottom, left:right]
    is_known = np.zeros((h, w), bool)
    is_known[box] = sprite.coverage[box] > 0.7
    return replace(sprite, relief=relief_of(own_normals, is_known, light))


def _part_highlights_of_discs(sprites: Sequence[Sprite], world: World) -> list[Sprite]:
    """Return the sprites; discs of one size get the `gloss` of their set."""
    groups: dict[int, list[int]] = {}
    for k, sprite in enumerate(sprites):
        body = world.bodies[sprite.body]
        if body.radius is not None and body.solid is not Solid.SPHERE:
            groups.setdefault(round(body.radius), []).append(k)
    result = list(sprites)
    for group in groups.values():
        pictures = [_disc_picture(sprites[k], world) for k in group]
        highlights = shared_highlights(pictures)
        for k, picture, light in zip(group, pictures, highlights, strict=False):
            if light.any():
                gloss = Gloss(light, picture.center)
                result[k] = replace(sprites[k], gloss=gloss)
    return result


def _disc_picture(sprite: Sprite, world: World) -> DiscPicture:
    """Return the picture of a disc's sprite."""
    body = world.bodies[sprite.body]
    assert body.radius is not None
    x, y = (body.center - sprite.corner).tolist()
    return DiscPicture(sprite.light, sprite.coverage >= 1, (x, y), body.radius)
