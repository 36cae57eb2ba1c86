"""Scene, world and photo to a Stage: cut-out sprites, flat shapes, or a matte.

A matte is a Stage of white objects in the dark. It is drawn like any other, so its light is the objects' coverage with
soft borders, supersampling, exposure, camera and size as in the frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, inf, radians, tan

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, Wheel, World
from physgen.geometry.polygon import Array, Disc, Outline, Region, Ring, bounds
from physgen.geometry.raster import coverage_box
from physgen.geometry.shadows import F32, ShadowSetting, Silhouette, floor_contact
from physgen.maps import U8, Percepts
from physgen.materials import is_billiard_ball
from physgen.photometry import DistantLight, decode
from physgen.render.ball import ball_from_photo, in_one_light, sphere_shading
from physgen.render.occlusion import (
    SUNK,
    ground_below,
    occluders,
    occlusions,
    silhouette,
)
from physgen.render.shadow_decomposition import decompose_shadows
from physgen.render.sprites import (
    CUT,
    MARGIN,
    MOST_RELIGHTING,
    Mask,
    Relief,
    Sides,
    Sprite,
    anchored,
    relief_of,
)
from physgen.render.stage import Frame, Mirror, ShadowBody, Stage, three_channels
from physgen.render.wheel_sprites import drawn_wheel, wheel_from_photo
from physgen.scene.scene import Scene, Solid, View

PAPER = (244, 242, 238)
INK = (70, 70, 74)
PALETTE = (
    (86, 130, 178), (214, 122, 84), (104, 160, 106), (196, 92, 104), (140, 116, 176),
    (208, 172, 82), (92, 166, 172), (170, 128, 104), (196, 134, 170), (128, 134, 146),
)  # fmt: skip
"""sRGB, one an object in turn: apart in hue and close in lightness, so that no object shouts."""


@dataclass(frozen=True)
class StagingTuning:
    """Assumed depths of objects, and limits of flat drawings."""

    large: int = 4_000_000  # px² that the sprite of one object may take in full
    fine: int = 8  # sub-pixels a side when lines are drawn
    flat: float = 0.8  # of its radius: how high a disc reaches above a table, where the scene does not say
    deep: float = 0.9  # of the root of its area: how far anything else reaches through the plane of motion
    ghosts: int = 200  # objects that a scene leaves out and whose shadows leave with them, about: the largest
    seen_top: float = 0.7  # px by which an object shows above and below its shape: less are ragged borders
    back: float = 0.8  # of what a top shows in the photo, that sides show: edges are rounded; by tune
    stray: float = 0.03  # share of a ball's pixels that may lie outside its circle
    lumpy: float = 0.5  # of its radius, by which a fruit may be larger than its circle
    around: float = (
        0.75  # of a disc's ring that must be seen, for light to be told from paint
    )
    uneven: float = 0.7  # change once around, of the mean, from which it is paint
    box: float = 0.9  # of the box around it, that a block fills
    edged: float = 0.3  # of the spread of an edge's light that one direction must explain, to be light
    lit: float = 0.5  # of a face's light, by which that of its edges changes with their direction, at most
    sun: float = 0.5  # weight of the scene's light in where edges are lit from: two sides alone do not show that
    faint: float = 0.05  # of a face's light: less at an edge may be its grain
    thread: float = 2.0  # px: how thick what hangs on a ball is
    steep: float = 0.25  # rise over run from which a boundary is no floor: shadows of a slope lie elsewhere
    mirrored: int = (
        60  # px below an object's foot in which a floor is asked what it mirrors
    )
    near_foot: int = (
        4  # px of these that objects' blurred rims and contact shadows may spoil
    )
    alike: float = 0.7  # correlation of what lies there with objects upside down, from which it mirrors them
    joined: float = 9.0  # px between the ends of two boundaries that are one floor


STAGING = StagingTuning()


def enlarged_world(
    world: World, outlines: Sequence[Outline], scale: float
) -> tuple[World, list[Outline]]:
    """Canvas, walls, bodies and outlines as large as they are on a canvas with `scale` pixels a photo pixel.

    For drawing alone: masses, velocities and the like stay as they are.
    """

    def at(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return (points + 0.5) * scale - 0.5

    bodies = tuple(
        replace(
            body,
            center=at(body.center),
            radius=None if body.radius is None else body.radius * scale,
            rings=tuple(ring * scale for ring in body.rings),
            wheels=tuple(
                Wheel(wheel.axle * scale, wheel.radius * scale) for wheel in body.wheels
            ),
        )
        for body in world.bodies
    )
    walls = tuple(
        replace(wall, chains=tuple(map(at, wall.chains))) for wall in world.walls
    )
    width, height = (ceil(side * scale - 1e-6) for side in world.size)
    shapes: list[Outline] = [
        Disc(at(shape.center), shape.radius * scale)
        if isinstance(shape, Disc)
        else Region(
            tuple(
                Ring(at(ring.outer), tuple(map(at, ring.holes))) for ring in shape.rings
            )
        )
        for shape in outlines
    ]
    return replace(world, size=(width, height), bodies=bodies, walls=walls), shapes


def flat_background(world: World, pen: float = 1.0) -> U8:
    """(H, W, 3) sRGB: paper, with walls as lines on the side away from the objects."""
    width, height = world.size
    scale = 4 if width * height <= 4_000_000 else 1
    canvas = np.empty((height * scale, width * scale, 3), np.uint8)
    canvas[:] = PAPER
    for wall in world.walls:
        for chain in wall.chains:
            points = np.rint((chain + 0.5) * scale * 16).astype(np.int64)
            points = np.clip(points, -(2**24), 2**24).astype(np.int32)
            cv2.polylines(
                canvas,
                [points],
                False,
                INK,
                round(2 * scale * pen),
                cv2.LINE_AA,
                shift=4,
            )
    return np.asarray(
        cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA), np.uint8
    )


def flat_sprites(
    world: World, outlines: Sequence[Outline], order: Sequence[int], pen: float = 1.0
) -> list[Sprite]:
    """One sprite an object: its colour, a darker rim, and for circles a spoke that shows how it turns.

    Of an object much larger than the canvas, only what lies in it and around is drawn.
    """
    sprites = []
    width, height = world.size
    around = min(max(width, height), STAGING.large // max(width, height))
    for k in order:
        x0, y0, x1, y1 = bounds(outlines[k])
        window = (-around, -around, width + around, height + around)
        alpha, (x0, y0) = coverage_box(
            outlines[k], window if (x1 - x0) * (y1 - y0) > STAGING.large else None
        )
        if not alpha.size:
            continue
        alpha = np.pad(alpha, MARGIN)
        corner = (x0 - MARGIN, y0 - MARGIN)
        fill = decode(np.array(PALETTE[k % len(PALETTE)], np.uint8))
        lines = _lines(world.bodies[k], corner, alpha.shape, pen)[..., None]
        colour = fill * (1 - lines) + fill * 0.3 * lines
        picture = (alpha[..., None] * colour).astype(np.float32)
        drawn = Sprite(k, corner, picture, alpha)
        sprites.append(_on_drawn_wheels(drawn, world, fill))
    return sprites


def _axles(sprite: Sprite, world: World) -> list[tuple[int, tuple[float, float]]]:
    """Return the number of each wheel of a sprite's body, and its axle in px of it."""
    before = sum(len(body.wheels) for body in world.bodies[: sprite.body])
    body = world.bodies[sprite.body]
    axles = []
    for k, wheel in enumerate(body.wheels):
        x, y = (body.center + wheel.axle - sprite.corner).tolist()
        axles.append((before + k, (x, y)))
    return axles


def _on_drawn_wheels(sprite: Sprite, world: World, colour: F32) -> Sprite:
    """Return the sprite with wheels of a colour `(3,)`, also where it is at rest."""
    radii = [wheel.radius for wheel in world.bodies[sprite.body].wheels]
    drawn = []
    light = sprite.light.copy()
    for (number, axle), radius in zip(_axles(sprite, world), radii, strict=True):
        drawn.append(drawn_wheel(number, axle, radius, 0.5 * colour))
        drawn[-1].draw(light, sprite.coverage, np.eye(2, 3), 0.0)
    return replace(sprite, light=light, wheels=tuple(drawn)) if drawn else sprite


def _on_wheels(sprite: Sprite, world: World) -> Sprite:
    """Return the sprite with the wheels of its body as the photo shows them."""
    radii = [wheel.radius for wheel in world.bodies[sprite.body].wheels]
    wheels = [
        wheel_from_photo(sprite.light, sprite.coverage, number, axle, radius)
        for (number, axle), radius in zip(_axles(sprite, world), radii, strict=True)
    ]
    shown = tuple(wheel for wheel in wheels if wheel is not None)
    return replace(sprite, wheels=shown) if shown else sprite


def _lines(
    body: Body, corner: tuple[int, int], shape: tuple[int, ...], pen: float
) -> F32:
    """(h, w) in 0..1: how much of a pixel the rim and spoke cover."""
    height, width = shape
    fine = STAGING.fine if height * width < 250_000 else 2
    canvas = np.zeros((height * fine, width * fine), np.uint8)
    thick = max(1, round(1.5 * fine * pen))

    def pixels(points: NDArray[np.float64]) -> NDArray[np.int32]:
        return np.rint((points + body.center - corner + 0.5) * fine).astype(np.int32)

    cv2.polylines(canvas, [pixels(ring) for ring in body.rings], True, 255, 2 * thick)
    if body.radius is not None:
        spoke = pixels(np.array([[0.0, 0.0], [body.radius, 0.0]]))
        cv2.line(canvas, spoke[0].tolist(), spoke[1].tolist(), 255, thick)
    return (
        cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA) / 255.0
    ).astype(np.float32)


NO_LIGHT = DistantLight(
    (0.0, 0.0, 1.0), 0.0, 1.0
)  # even, from all around: nothing is shaded


def matte_stage(stage: Stage) -> Stage:
    """The same objects, white without any shading, and nothing else: no photo, no boundaries, no shadows.

    Whatever is no object of the scene, objects of the photo that the scene leaves out among it, is dark.
    """
    return Stage(
        background=np.zeros_like(stage.background),
        sprites=[_white(sprite) for sprite in stage.sprites],
        supersample=stage.supersample,
        scale=stage.scale,
    )


def _white(sprite: Sprite) -> Sprite:
    """A ball stays one, for its picture does not turn with it: of dark skin and white gloss all over."""
    ball = sprite.ball
    if ball is not None:
        ball = replace(
            ball,
            skin=np.zeros_like(ball.skin),
            gloss=np.ones_like(ball.gloss),
            light=NO_LIGHT,
            even=None,
            pattern=None,
            trust=1.0,
            fade=None,
        )
    sides = sprite.sides and replace(
        sprite.sides, colour=np.ones(3, np.float32), light=None
    )
    return replace(
        sprite,
        light=three_channels(sprite.coverage),
        rest=None,
        halo=None,
        ball=ball,
        relief=None,
        sides=sides,
        wheels=(),
    )


def matte_coverage(frame: Frame) -> F32:
    """(H, W) 0..1 of all objects together: the linear light of a matte's frame."""
    return decode(frame.rgb[..., 0])


def lit_stage(
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
        sprites = [_on_wheels(sprite, world) for sprite in sprites]
        return Stage(
            background, anchored(sprites, decode(maps.rgb), decode(background), absent)
        )
    light = DistantLight(
        scene.light.direction, scene.light.intensity, scene.light.ambient
    )
    top = world.view is View.TOP
    sprites = [_on_wheels(sprite, world) for sprite in sprites]
    parts = []
    for sprite in sprites:
        is_fruit = top and not is_billiard_ball(scene.objects[sprite.body].label)
        lumpy = STAGING.lumpy if is_fruit else 0.0
        parts += _parted(sprite, world.bodies[sprite.body], lumpy)
    setting = ShadowSetting(
        light=light,
        softness=scene.light.softness,
        top=top,
        tilt=max(tan(radians(scene.world.tilt)), 1e-3),
        backdrop=inf if scene.world.backdrop is None else scene.world.backdrop,
        size=world.size,
    )
    grounds = [] if top else floors(world)
    if np.isfinite(setting.backdrop) and maps.shadows is not None:
        grounds = [
            ground
            for ground in grounds
            if not passed(ground, maps.labels, maps.shadows)
        ]
    actors = [
        _actor(sprite, world.bodies[sprite.body], loose, top) for sprite, loose in parts
    ]
    starts = [
        silhouette(
            grounds,
            s.coverage,
            s.corner,
            world.bodies[s.body].center,
            actor,
            setting.tilt,
        )
        for (s, _), actor in zip(parts, actors, strict=True)
    ]
    veils: list[F32 | None] = [None] * len(parts)
    if (
        scene.render.shadows and maps.clean is not None
    ):  # shadows of this light were seen
        near = occluders(starts, setting)
        thrown = occlusions(
            starts, {k: near.get(k, []) for k in range(len(starts))}, setting
        )
        veils = [thrown.get(k) for k in range(len(starts))]
        seen = [
            seen_share(sprite, actor, start, before, light)
            for (sprite, _), actor, start, before in zip(
                parts, actors, starts, veils, strict=True
            )
            if before is not None
        ]
        usual, known = float(np.median(seen)) if seen else 1.0, iter(seen)
        shares = [usual if before is None else next(known) for before in veils]
        actors = [
            replace(actor, veiled=share)
            for actor, share in zip(actors, shares, strict=True)
        ]
        veils = [
            None
            if before is None or share == 0
            else np.asarray(share * before, np.float32)
            for before, share in zip(veils, shares, strict=True)
        ]
    sprites = [
        sprite if top else _faced(sprite, world.bodies[sprite.body], light)
        for sprite, _ in parts
    ]
    if scene.render.relight:
        sprites = [
            sprite
            if actor.radius is None
            else _skinned(
                sprite,
                world.bodies[sprite.body],
                light,
                world.view,
                before,
                is_billiard_ball(scene.objects[sprite.body].label),
            )
            for sprite, actor, before in zip(sprites, actors, veils, strict=True)
        ]
        balls = iter(
            in_one_light([sprite.ball for sprite in sprites if sprite.ball is not None])
        )
        sprites = [
            sprite if sprite.ball is None else replace(sprite, ball=next(balls))
            for sprite in sprites
        ]
        if maps.normals is not None:
            sprites = [_relieved(sprite, maps.normals, light) for sprite in sprites]
        elif top:
            sprites = [
                _turned_disc(sprite, world.bodies[sprite.body]) for sprite in sprites
            ]
        if not top:
            sprites = [_edged(sprite, light) for sprite in sprites]
    if not scene.render.shadows:
        return Stage(
            background, anchored(sprites, decode(maps.rgb), decode(background), absent)
        )
    rounds = [
        world.bodies[s.body].radius is not None and not loose for s, loose in parts
    ]
    gone = _ghosts(maps.labels, absent, coverage, grounds, setting)
    changed = (
        cv2.inRange(cv2.absdiff(maps.rgb, background), (0, 0, 0), (0, 0, 0)) == 0
    ) & (coverage == 0)
    lit, left = decompose_shadows(
        background, maps.clean, coverage, starts, rounds, setting, gone, changed
    )
    photo = decode(maps.rgb)
    if left is not None:  # the photo as it would be without what is left out
        photo = photo * np.exp(np.where(coverage < 0.5, left, 0))[..., None].astype(
            np.float32
        )
    mirror = (
        None
        if top
        else floor_mirror(sprites, starts, photo - lit.behind(), coverage, setting.tilt)
    )
    sprites = anchored(sprites, photo, lit.behind(), absent, lit.owner)
    veils_seen = veils if maps.clean is not None else None
    return Stage(background, sprites, lit, actors, grounds, veils_seen, mirror=mirror)


def floor_mirror(
    sprites: Sequence[Sprite],
    starts: Sequence[Silhouette],
    beyond: F32,
    coverage: F32,
    tilt: float,
) -> Mirror | None:
    """What a floor mirrors of what stands on it; None where `beyond` (H, W, 3), linear light that the photo shows
    beyond the background, is not like the objects turned upside down."""
    sums, feet = np.zeros((3, STAGING.mirrored)), []
    for sprite, start in zip(sprites, starts, strict=True):
        rows, contact = (
            np.flatnonzero((sprite.coverage > 0.5).any(axis=1)),
            floor_contact(start, tilt),
        )
        stands = contact is not None and len(rows) and contact.low < 1
        feet.append((sprite.corner[1] + int(rows[-1]), *start.ends) if stands else None)
        if not stands:
            continue
        left, below = sprite.corner[0] + MARGIN, sprite.corner[1] + int(rows[-1]) + 1
        own = sprite.light[rows[-1] :: -1, MARGIN:-MARGIN][: STAGING.mirrored]
        there = np.s_[below : below + len(own), left : left + own.shape[1]]
        seen = beyond[there] * (coverage[there] == 0)[..., None]
        own = own[: len(seen)] * (coverage[there] == 0)[..., None]
        for total, product in zip(
            sums, (own * seen, own * own, seen * seen), strict=True
        ):
            total[: len(seen)] += product.sum(axis=(1, 2))
    share, alike = (
        sums[0] / np.maximum(sums[1], 1e-6),
        sums[0] / np.sqrt(sums[1] * sums[2] + 1e-12),
    )
    unlike = np.flatnonzero(alike[STAGING.near_foot :] < STAGING.alike)
    count = STAGING.near_foot + int(unlike[0]) if len(unlike) else len(share)
    if count < 3 * STAGING.near_foot:
        return None
    fade = np.minimum(np.arange(count, 0, -1) / (2 * STAGING.near_foot), 1)
    return Mirror((np.maximum(share[:count], 0) * fade).astype(np.float32), feet)


def _ghosts(
    labels: NDArray[np.uint16],
    absent: Mask,
    coverage: F32,
    grounds: Sequence[Array],
    setting: ShadowSetting,
) -> list[Silhouette]:
    """Things of the photo that the scene leaves out, as light saw them."""
    found = []
    every = np.nonzero(absent)
    order = np.argsort(labels[absent], kind="stable")
    ids, counts = np.unique(labels[absent], return_counts=True)
    least = np.sort(counts)[-STAGING.ghosts :].min(initial=0)
    for id_, pixels in zip(
        ids.tolist(), np.split(order, np.cumsum(counts)[:-1]), strict=False
    ):
        if len(pixels) < least:
            continue
        rows, columns = every[0][pixels], every[1][pixels]
        y0, y1, x0, x1 = rows.min(), rows.max() + 1, columns.min(), columns.max() + 1
        own = np.where(labels[y0:y1, x0:x1] == id_, coverage[y0:y1, x0:x1], 0).astype(
            np.float32
        )
        thick = STAGING.deep * float(np.sqrt(len(rows))) * (0.6 if setting.top else 1.0)
        middle = np.array([columns.mean(), rows.mean()])
        actor = ShadowBody(None, thick)
        found.append(
            silhouette(grounds, own, (int(x0), int(y0)), middle, actor, setting.tilt)
        )
    return found


def floors(world: World) -> list[Array]:
    """(8,) px: segments of walls that are level enough for shadows, the columns between which they go on level, and 1
    or 0: whether an upright wall stands at either end."""
    every = [
        np.concatenate(pair)
        for wall in world.walls
        for chain in wall.chains
        for pair in pairwise(chain)
    ]
    across, down = (np.abs([one[k + 2] - one[k] for one in every]) for k in (0, 1))
    found = [
        every[k] for k in np.flatnonzero((across > 1) & (down < STAGING.steep * across))
    ]
    upright = [every[k] for k in np.flatnonzero(across < STAGING.steep * down)]
    joined = []
    for one in found:
        level = [
            g
            for g in found
            if np.abs(np.subtract.outer(g[1::2], one[1::2])).min() < STAGING.joined
        ]
        spans = sorted((min(g[::2]), max(g[::2])) for g in level)
        left, right = sorted(one[::2])
        for a, b in (*spans, *reversed(spans)):
            if a <= right + STAGING.joined and b >= left - STAGING.joined:
                left, right = min(left, a), max(right, b)
        walls = [
            any(
                abs(foot[0] - x) < STAGING.joined
                and top[1] < min(one[1::2]) < foot[1] + STAGING.joined
                for top, foot in (
                    sorted((w[:2], w[2:]), key=lambda end: end[1]) for w in upright
                )
            )
            for x in (left, right)
        ]
        joined.append(np.array([*one, left, right, *walls]))
    return joined


def passed(
    ground: Array, labels: NDArray[np.uint16], shadows: NDArray[np.uint16]
) -> bool:
    """Whether the photo shows shadows pass by a floor: those of objects on it lie below it, on a wall behind.

    A floor that reaches back to the wall would have caught them; this one is a line that perception laid under objects
    in the air, or a thin ledge. `ground` (4,) px; `labels` and `shadows` (H, W) by id.
    """
    below, seen = 0, 0
    for i in np.unique(shadows[shadows > 0]):
        rows, columns = np.nonzero(labels == i)
        if not len(rows):
            continue
        bottom = float(rows.max())
        found = ground_below([ground], float(columns.mean()), bottom - SUNK)
        if found is not None and found[0] - bottom < 2 * SUNK:
            seen += 1
            below += bool(np.median(np.nonzero(shadows == i)[0]) > found[0] + SUNK)
    return 2 * below > seen


def thickness(body: Body, top: bool) -> float:
    """px that a body reaches above the table, or through the plane of motion: about its width, for want of better."""
    if body.radius is not None:
        return (
            2 * body.radius
            if body.solid is Solid.SPHERE or not top
            else STAGING.flat * body.radius
        )
    points = np.concatenate(body.pieces)
    width, height = np.ptp(points, axis=0).tolist()
    deep = float(STAGING.deep * np.sqrt(width * height) * (0.6 if top else 1.0))
    # what stands and is no box was turned on a wheel or a lathe
    w, h = cv2.minAreaRect(points.astype(np.float32))[1]
    full = (
        sum(cv2.contourArea(piece.astype(np.float32)) for piece in body.pieces)
        > STAGING.box * w * h
    )
    return deep if top or full else min(deep, width)


def seen_share(
    sprite: Sprite,
    actor: ShadowBody,
    start: Silhouette,
    before: F32,
    light: DistantLight,
) -> float:
    """How much of a predicted veil (h, w) the photo shows on an object, 0..1: light between objects fills some of it.

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
        level -= np.log(
            sphere_shading(light, *(part.astype(np.float32) for part in (u, v, z)))
        )
    terms = np.column_stack([np.ones(len(x)), x, y, -before[rows, columns]])
    terms[:, 1:3] /= max(sprite.coverage.shape)
    trust = np.ones(len(x))
    found = np.zeros(4)
    for _ in range(4):
        weighted = terms * trust[:, None]
        found = np.linalg.solve(
            weighted.T @ terms + 1e-3 * len(x) * np.diag([0.0, 1, 1, 0.1]),
            weighted.T @ level,
        )
        trust = 1 / np.maximum(np.abs(level - terms @ found) / 0.15, 1)
    return float(np.clip(found[3], 0, 1))


def _actor(sprite: Sprite, body: Body, loose: bool, top: bool) -> ShadowBody:
    if loose:
        return ShadowBody(None, STAGING.thread)
    ball = body.solid is Solid.SPHERE and sprite.coverage.max(initial=0) >= 1
    return ShadowBody(body.radius if ball else None, thickness(body, top))


def _faced(sprite: Sprite, body: Body, light: DistantLight) -> Sprite:
    """The sprite with its `face`: how far it shows below its shape, if as far above it as well, where its back is.

    The top of a block that is seen has its `sides`.
    """
    solid = sprite.coverage >= 0.5
    rows = np.flatnonzero(solid.any(axis=1))
    if body.radius is not None or not len(rows):
        return sprite
    shape = np.concatenate(body.rings)[:, 1] + body.center[1] - sprite.corner[1]
    face = float(min(shape.min() - rows[0], rows[-1] - shape.max())) + 0.5
    if face < STAGING.seen_top:
        return sprite
    tops = solid.argmax(axis=0)[solid.any(axis=0)]
    first = float(rows[0] - 0.5 + 2 * face)
    top = (sprite.coverage >= 1) & (np.arange(len(solid)) < first - 0.5)[:, None]
    block = len(body.rings) == 1 and len(body.rings[0]) == 4 and top.any()
    if not block or np.ptp(np.percentile(tops, (25, 75))) > CUT.flat:
        return replace(sprite, face=face)
    colour = np.median(sprite.light[top], axis=0)
    return replace(
        sprite, face=face, sides=Sides(first, STAGING.back * 2 * face, colour, light)
    )


def _parted(
    sprite: Sprite, body: Body, lumpy: float = 0.0
) -> list[tuple[Sprite, bool]]:
    """A ball apart from what hangs on it, a thread or a handle, which turns as a picture; and whether it is that.

    What reaches at most `lumpy` radii beyond the circle is the ball's own.
    """
    if body.radius is None or body.solid is not Solid.SPHERE:
        return [(sprite, False)]
    x, y = body.center.tolist()
    rows, columns = np.indices(sprite.coverage.shape)
    away = np.hypot(columns + sprite.corner[0] - x, rows + sprite.corner[1] - y)
    hangs = (
        sprite.coverage[away > body.radius + 2].sum()
        > STAGING.stray * sprite.coverage.sum()
    )
    farthest = away[sprite.coverage > 0.5].max(initial=0.0)
    hangs = hangs and bool(farthest > (1 + lumpy) * body.radius)
    # the thread lies beneath and reaches a pixel farther in, so that nothing shows through where they meet
    within = np.clip(body.radius + (1 if hangs else 2) - away, 0, 1).astype(np.float32)
    beyond = np.clip(away - body.radius + 1, 0, 1).astype(np.float32)
    return [
        (
            replace(
                sprite,
                light=sprite.light * part[..., None],
                coverage=sprite.coverage * part,
            ),
            loose,
        )
        for part, loose in ((beyond, True), (within, False))
        if hangs or not loose  # what was taken for its border only goes
    ]


def _skinned(
    sprite: Sprite,
    body: Body,
    light: DistantLight,
    view: View,
    before: F32 | None,
    is_painted: bool,
) -> Sprite:
    """A sphere's sprite with its skin; `before` (h, w) is -log of the light that other objects leave on it."""
    assert body.radius is not None
    x, y = body.center.tolist()
    alpha = sprite.coverage[..., None]
    colour = np.where(alpha > 1e-3, sprite.light / np.maximum(alpha, 1e-3), 0).astype(
        np.float32
    )
    if before is not None:
        colour *= np.exp(before)[..., None]
    ball = ball_from_photo(
        colour, sprite.corner, (x, y), body.radius, light, view, is_painted
    )
    return replace(sprite, ball=ball)


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
    there = np.s_[
        here[0].start - y0 : here[0].stop - y0, here[1].start - x0 : here[1].stop - x0
    ]
    own[there] = normals[here]
    known[there] = sprite.coverage[there] > 0.7
    return replace(sprite, relief=relief_of(own, known, light))


def _edged(sprite: Sprite, light: DistantLight) -> Sprite:
    """Anything but a ball, its edges rounded where the photo shows them lit: what changes on rings inside its outline
    as one direction towards the light has it stays as the object turns; more is paint."""
    solid = (sprite.coverage >= 1).astype(np.uint8)
    if sprite.sides is not None:
        solid[: ceil(sprite.sides.first)] = 0
    away = cv2.distanceTransform(np.pad(solid, 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    if (
        sprite.ball is not None
        or sprite.relief is not None
        or not (away > 2 * CUT.rim).any()
    ):
        return sprite
    soft = cv2.GaussianBlur(solid.astype(np.float32), (0, 0), CUT.clean)
    x, y = (-cv2.Sobel(soft, cv2.CV_32F, *axes) for axes in ((1, 0), (0, 1)))
    normal = np.stack([x, y], axis=2) / np.maximum(np.hypot(x, y), 1e-6)[..., None]
    bright, inner = sprite.light.mean(axis=2), (away > CUT.rim).astype(np.float32)
    near = [
        np.maximum(cv2.GaussianBlur(part, (0, 0), CUT.along), 1e-4)
        for part in (bright * inner, inner)
    ]
    edge = bright * near[1] / near[0] - 1
    gain, ring, strength = (
        np.zeros_like(normal),
        np.maximum(np.ceil(away), 1),
        [0.0] * CUT.rim,
    )
    sun = light.direction[:2] / np.maximum(np.hypot(*light.direction[:2]), 1e-6)
    for d in range(1, CUT.rim + 1):
        here = (ring == d) & (solid > 0)
        there, change = (
            normal[here] - normal[here].mean(axis=0),
            edge[here] - edge[here].mean(),
        )
        slope = np.linalg.lstsq(there, change)[0]
        explained = ((there @ slope) ** 2).sum() > STAGING.edged * (change**2).sum()
        if explained and slope @ light.direction[:2] > 0:
            strength[d - 1] = min(float(np.hypot(*slope)), STAGING.lit)
            way = slope / np.hypot(*slope) + STAGING.sun * sun
            gain[ring == d] = strength[d - 1] * way / np.hypot(*way)
    if max(strength) <= 2 * strength[-1]:  # there is no edge, or all of it is round
        return sprite
    (x, y), (gx, gy) = (np.moveaxis(part, 2, 0) for part in (normal, gain))
    toward, across = gx * x + gy * y, gx * y - gy * x
    # where the outline is off by a pixel, the photo shows no such edge: half of it will do, a quarter is none
    shown = np.divide(
        edge, toward, out=np.ones_like(edge), where=np.abs(toward) > STAGING.faint
    )
    toward, across = (part * np.clip(4 * shown - 1, 0, 1) for part in (toward, across))
    model = np.maximum(1 + toward, 1 / MOST_RELIGHTING)
    parts = (toward, across, np.ones_like(toward), np.zeros_like(toward))
    return replace(
        sprite, relief=Relief(*(np.asarray(part / model, np.float32) for part in parts))
    )


def _turned_disc(sprite: Sprite, body: Body) -> Sprite:
    """A disc seen from above, round about its middle: what changes a little once around, on rings that the photo shows
    all around, is light and stays; more is paint."""
    if body.radius is None or body.solid is Solid.SPHERE:
        return sprite
    rows, columns = np.indices(sprite.coverage.shape)
    x, y = (
        columns + sprite.corner[0] - body.center[0],
        rows + sprite.corner[1] - body.center[1],
    )
    away = np.maximum(np.hypot(x, y), 1.0)
    c, s, ring = (
        x / away,
        y / away,
        np.minimum(away, max(body.radius - 2, 0)).astype(int),
    )
    bright, sure = (
        sprite.light.mean(axis=2),
        (sprite.coverage >= 1) & (away < body.radius),
    )
    sums = [
        np.bincount(ring[sure], (bright * part)[sure], ring.max() + 1)
        for part in (np.ones_like(c), 2 * c, 2 * s)
    ]
    count = np.maximum(np.bincount(ring[sure], minlength=ring.max() + 1), 1)
    whole = count > STAGING.around * np.pi * (2 * np.arange(len(count)) + 1)
    light = whole & (np.hypot(*sums[1:]) < STAGING.uneven * sums[0])
    sums = [sums[0], *(part * light for part in sums[1:])]
    even, along, across = (
        cv2.GaussianBlur(part / count, (0, 0), 1.0).ravel()[ring] for part in sums
    )
    even = np.maximum(even, CUT.dark)
    first, second = (along * c + across * s) / even, (along * s - across * c) / even
    model = np.maximum(1 + first, 1 / MOST_RELIGHTING)
    fields = [
        np.asarray(part / model, np.float32)
        for part in (first, second, np.ones_like(c), np.zeros_like(c))
    ]
    return replace(sprite, relief=Relief(*fields))
