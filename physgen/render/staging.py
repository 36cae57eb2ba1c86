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

from physgen.arrays import F32, U16, Mask
from physgen.compile.world import Body, Wheel, World
from physgen.geometry.polygon import Array, Disc, Outline, Region, Ring, bounds
from physgen.geometry.raster import coverage_box
from physgen.geometry.shadows import ShadowSetting, Silhouette, floor_contact
from physgen.maps import U8, Percepts
from physgen.materials import is_billiard_ball
from physgen.photometry import DistantLight, decode
from physgen.render.ball import ball_from_photo, in_one_light, sphere_shading
from physgen.render.contact_shade import contact_depth
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

    large: int = 4_000_000
    """px² that the sprite of one object may take in full."""
    fine: int = 8
    """Sub-pixels a side when lines are drawn."""
    flat: float = 0.8
    """Of its radius: how high a disc reaches above a table, where the scene does not say."""
    deep: float = 0.9
    """Of the root of its area: how far anything else reaches through the plane of motion."""
    ghosts: int = 200
    """Objects that a scene leaves out and whose shadows leave with them, about: the largest."""
    seen_top: float = 0.7
    """px by which an object shows above and below its shape: less are ragged borders."""
    back: float = 0.8
    """Of what a top shows in the photo, that sides show: edges are rounded; by tune."""
    stray: float = 0.03
    """Share of a ball's pixels that may lie outside its circle."""
    lumpy: float = 0.5
    """Of its radius, by which a fruit may be larger than its circle."""
    lumpy_turn: float = 0.2
    """Share of a turn in which a lump reaches beyond its circle; a thread's is less."""
    around: float = 0.75
    """Of a disc's ring that must be seen, for light to be told from paint."""
    uneven: float = 0.7
    """Change once around, of the mean, from which it is paint."""
    box: float = 0.9
    """Of the box around it, that a block fills."""
    edged: float = 0.3
    """Of the spread of an edge's light that one direction must explain, to be light."""
    lit: float = 0.5
    """Of a face's light, by which that of its edges changes with their direction, at most."""
    sun: float = 0.5
    """Weight of the scene's light in where edges are lit from: two sides alone do not show that."""
    faint: float = 0.05
    """Of a face's light: less at an edge may be its grain."""
    thread: float = 2.0
    """px: how thick what hangs on a ball is."""
    steep: float = 0.25
    """Rise over run from which a boundary is no floor: shadows of a slope lie elsewhere."""
    mirrored: int = 60
    """px below an object's foot in which a floor is asked what it mirrors."""
    near_foot: int = 4
    """px of these that objects' blurred rims and contact shadows may spoil."""
    alike: float = 0.7
    """Correlation of what lies there with objects upside down, from which it mirrors them."""
    joined: float = 9.0
    """px between the ends of two boundaries that are one floor."""


STAGING = StagingTuning()


def enlarged_world(
    world: World, outlines: Sequence[Outline], scale: float
) -> tuple[World, list[Outline]]:
    """Enlarge canvas, walls, bodies and outlines for a canvas with `scale` pixels a photo pixel.

    For drawing alone: masses, velocities and the like stay as they are.
    """

    def enlarge(points: Array) -> Array:
        return (points + 0.5) * scale - 0.5

    def enlarge_body(body: Body) -> Body:
        wheels = [Wheel(w.axle * scale, w.radius * scale) for w in body.wheels]
        return replace(
            body,
            center=enlarge(body.center),
            radius=None if body.radius is None else body.radius * scale,
            rings=tuple(ring * scale for ring in body.rings),
            wheels=tuple(wheels),
        )

    def enlarge_outline(outline: Outline) -> Outline:
        if isinstance(outline, Disc):
            return Disc(enlarge(outline.center), outline.radius * scale)
        rings = []
        for ring in outline.rings:
            rings.append(Ring(enlarge(ring.outer), tuple(map(enlarge, ring.holes))))
        return Region(tuple(rings))

    walls = []
    for wall in world.walls:
        walls.append(replace(wall, chains=tuple(map(enlarge, wall.chains))))
    width, height = world.size
    enlarged = replace(
        world,
        size=(ceil(width * scale - 1e-6), ceil(height * scale - 1e-6)),
        bodies=tuple(map(enlarge_body, world.bodies)),
        walls=tuple(walls),
    )
    return enlarged, list(map(enlarge_outline, outlines))


SHIFT_BITS = 4
"""Binary digits behind the point of OpenCV's coordinates."""
FARTHEST = 2**24
"""Largest coordinate that OpenCV draws to without overflow, 1 / 2**SHIFT_BITS px."""


def flat_background(world: World, pen: float = 1.0) -> U8:
    """Draw (H, W, 3) sRGB: paper, with walls as lines on the side away from the objects."""
    width, height = world.size
    scale = 4 if width * height <= 4_000_000 else 1
    canvas = np.empty((height * scale, width * scale, 3), np.uint8)
    canvas[:] = PAPER
    line_width = round(2 * scale * pen)
    for wall in world.walls:
        for chain in wall.chains:
            points = np.rint((chain + 0.5) * scale * 2**SHIFT_BITS).astype(np.int64)
            corners = np.clip(points, -FARTHEST, FARTHEST).astype(np.int32)
            kind = cv2.LINE_AA
            cv2.polylines(canvas, [corners], False, INK, line_width, kind, SHIFT_BITS)
    small = cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def flat_sprites(
    world: World, outlines: Sequence[Outline], order: Sequence[int], pen: float = 1.0
) -> list[Sprite]:
    """Draw one sprite an object: its colour, a darker rim, and for circles a spoke that shows how it turns.

    Of an object much larger than the canvas, only the part in and around the canvas is drawn.
    """
    sprites = []
    width, height = world.size
    margin = min(max(width, height), STAGING.large // max(width, height))
    window = (-margin, -margin, width + margin, height + margin)
    for k in order:
        x0, y0, x1, y1 = bounds(outlines[k])
        is_large = (x1 - x0) * (y1 - y0) > STAGING.large
        alpha, (left, top) = coverage_box(outlines[k], window if is_large else None)
        if not alpha.size:
            continue
        alpha = np.pad(alpha, MARGIN)
        corner = (left - MARGIN, top - MARGIN)
        fill = decode(np.array(PALETTE[k % len(PALETTE)], np.uint8))
        lines = _lines(world.bodies[k], corner, alpha.shape, pen)[..., None]
        colour = fill * (1 - lines) + fill * 0.3 * lines
        picture = (alpha[..., None] * colour).astype(np.float32)
        sprite = Sprite(k, corner, picture, alpha)
        sprites.append(_on_drawn_wheels(sprite, world, fill))
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
    body = world.bodies[sprite.body]
    if not body.wheels:
        return sprite
    wheels = []
    light = sprite.light.copy()
    pairs = zip(_axles(sprite, world), body.wheels, strict=True)
    for (number, axle), body_wheel in pairs:
        wheel = drawn_wheel(number, axle, body_wheel.radius, 0.5 * colour)
        wheel.draw(light, sprite.coverage, np.eye(2, 3), 0.0)
        wheels.append(wheel)
    return replace(sprite, light=light, wheels=tuple(wheels))


def _on_wheels(sprite: Sprite, world: World) -> Sprite:
    """Return the sprite with the wheels of its body as the photo shows them."""
    body = world.bodies[sprite.body]
    wheels = []
    pairs = zip(_axles(sprite, world), body.wheels, strict=True)
    for (number, axle), body_wheel in pairs:
        radius = body_wheel.radius
        wheel = wheel_from_photo(sprite.light, sprite.coverage, number, axle, radius)
        if wheel is not None:
            wheels.append(wheel)
    return replace(sprite, wheels=tuple(wheels)) if wheels else sprite


def _lines(
    body: Body, corner: tuple[int, int], shape: tuple[int, ...], pen: float
) -> F32:
    """Return (h, w) in 0..1: the share of each pixel that the rim and the spoke cover."""
    height, width = shape
    fine = STAGING.fine if height * width < 250_000 else 2
    canvas = np.zeros((height * fine, width * fine), np.uint8)
    line_width = max(1, round(1.5 * fine * pen))

    def pixels(points: Array) -> NDArray[np.int32]:
        return np.rint((points + body.center - corner + 0.5) * fine).astype(np.int32)

    rings = [pixels(ring) for ring in body.rings]
    cv2.polylines(canvas, rings, True, 255, 2 * line_width)
    if body.radius is not None:
        spoke = pixels(np.array([[0.0, 0.0], [body.radius, 0.0]]))
        cv2.line(canvas, spoke[0].tolist(), spoke[1].tolist(), 255, line_width)
    small = cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
    return (small / 255.0).astype(np.float32)


NO_LIGHT = DistantLight(
    (0.0, 0.0, 1.0), 0.0, 1.0
)  # even, from all around: nothing is shaded


def matte_stage(stage: Stage) -> Stage:
    """Return the same objects, white without any shading, and nothing else: no photo, no boundaries, no shadows.

    Whatever is no object of the scene, objects of the photo that the scene leaves out among it, is dark.
    """
    return Stage(
        background=np.zeros_like(stage.background),
        sprites=[_white(sprite) for sprite in stage.sprites],
        supersample=stage.supersample,
        scale=stage.scale,
    )


def _white(sprite: Sprite) -> Sprite:
    """Return a white sprite.

    A ball stays one, of dark skin and white gloss, for its picture does not turn with it.
    """
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
    """Return the coverage (H, W).

    0..1 of all objects together: the linear light of a matte's frame.
    """
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
    """Build the stage of a photo: sprites that light and shadows change as they move.

    `background` (H, W, 3) sRGB with the objects' shadows; `coverage` (H, W) of all objects, `absent` ones too.
    """
    photo = decode(maps.rgb)
    sprites = [_on_wheels(sprite, world) for sprite in sprites]
    if scene.light is None:
        return Stage(background, anchored(sprites, photo, decode(background), absent))
    setting = _shadow_setting(scene, world)
    grounds = _shadow_floors(world, maps, setting)
    parts = _split_balls(scene, world, sprites)
    sprites = [sprite for sprite, _ in parts]
    actors = []
    for sprite, is_loose in parts:
        body = world.bodies[sprite.body]
        actors.append(_actor(sprite, body, is_loose, setting.top))
    starts = []
    for sprite, actor in zip(sprites, actors, strict=True):
        center = world.bodies[sprite.body].center
        picture, corner = sprite.coverage, sprite.corner
        starts.append(silhouette(grounds, picture, corner, center, actor, setting.tilt))
    veils: list[F32 | None] = [None] * len(sprites)
    if scene.render.shadows and maps.clean is not None:
        # A clean picture exists, so shadows of this light are visible in the photo.
        actors, veils = _visible_veils(sprites, actors, starts, setting)
    if not setting.top:
        sprites = [
            _faced(sprite, world.bodies[sprite.body], setting.light)
            for sprite in sprites
        ]
    if scene.render.relight:
        sprites = _relit_sprites(scene, world, sprites, actors, veils, maps)
    if not scene.render.shadows:
        return Stage(background, anchored(sprites, photo, decode(background), absent))
    rounds = [
        world.bodies[sprite.body].radius is not None and not is_loose
        for sprite, is_loose in parts
    ]
    ghosts = _ghosts(maps.labels, absent, coverage, grounds, setting)
    difference = cv2.absdiff(maps.rgb, background)
    is_equal = cv2.inRange(difference, (0, 0, 0), (0, 0, 0)) > 0
    changed = ~is_equal & (coverage == 0)
    lit, ghost_shadows = decompose_shadows(
        background, maps.clean, coverage, starts, rounds, setting, ghosts, changed
    )
    if ghost_shadows is not None:
        # The photo as it would be without the objects that the scene leaves out.
        shadows = np.where(coverage < 0.5, ghost_shadows, 0)
        photo = photo * np.exp(shadows)[..., None].astype(np.float32)
    behind = lit.behind()
    mirror = None
    if not setting.top:
        mirror = floor_mirror(sprites, starts, photo - behind, coverage, setting.tilt)
    return Stage(
        background,
        anchored(sprites, photo, behind, absent, lit.owner),
        lit,
        actors,
        grounds,
        None if maps.clean is None else veils,
        mirror=mirror,
        contact_depth=contact_depth(scene),
    )


def _shadow_setting(scene: Scene, world: World) -> ShadowSetting:
    light = scene.light
    assert light is not None
    backdrop = scene.world.backdrop
    return ShadowSetting(
        light=DistantLight(light.direction, light.intensity, light.ambient),
        softness=light.softness,
        top=world.view is View.TOP,
        tilt=max(tan(radians(scene.world.tilt)), 1e-3),
        backdrop=inf if backdrop is None else backdrop,
        size=world.size,
    )


def _shadow_floors(world: World, maps: Percepts, setting: ShadowSetting) -> list[Array]:
    """Return the floors, as `floors`, on which the photo's shadows fall."""
    if setting.top:
        return []
    grounds = floors(world)
    shadows = maps.shadows
    if not np.isfinite(setting.backdrop) or shadows is None:
        return grounds
    return [ground for ground in grounds if not passed(ground, maps.labels, shadows)]


def _split_balls(
    scene: Scene, world: World, sprites: Sequence[Sprite]
) -> list[tuple[Sprite, bool]]:
    """Return all sprites as `_parted`; lumps seen from the side stay whole."""
    parts = []
    for sprite in sprites:
        lumpiness = 0.0
        label = scene.objects[sprite.body].label
        if world.view is View.SIDE and _is_lump(sprite, world.bodies[sprite.body]):
            parts.append((sprite, False))
            continue
        if world.view is View.TOP and not is_billiard_ball(label):
            lumpiness = STAGING.lumpy
        parts += _parted(sprite, world.bodies[sprite.body], lumpiness)
    return parts


def _visible_veils(
    sprites: Sequence[Sprite],
    actors: Sequence[ShadowBody],
    starts: Sequence[Silhouette],
    setting: ShadowSetting,
) -> tuple[list[ShadowBody], list[F32 | None]]:
    """Predict the veils that objects throw on each other in the photo, as strong as the photo shows them.

    Return the actors with that strength, and -log of the light (h, w) that each veil leaves on its sprite.
    """
    neighbours = occluders(starts, setting)
    every = {k: neighbours.get(k, []) for k in range(len(starts))}
    predicted = occlusions(starts, every, setting)
    shares = {}
    for k, prediction in predicted.items():
        shares[k] = seen_share(
            sprites[k], actors[k], starts[k], prediction, setting.light
        )
    typical = float(np.median([*shares.values()])) if shares else 1.0
    visible: list[F32 | None] = []
    veiled_actors = []
    for k, actor in enumerate(actors):
        share = shares.get(k, typical)
        veiled_actors.append(replace(actor, veiled=share))
        veil: F32 | None = None
        if k in predicted and share != 0:
            veil = np.asarray(share * predicted[k], np.float32)
        visible.append(veil)
    return veiled_actors, visible


def _relit_sprites(
    scene: Scene,
    world: World,
    sprites: Sequence[Sprite],
    actors: Sequence[ShadowBody],
    veils: Sequence[F32 | None],
    maps: Percepts,
) -> list[Sprite]:
    """Return the sprites with the skins or reliefs that light changes as they turn."""
    light = _shadow_setting(scene, world).light
    is_top = world.view is View.TOP
    relit = []
    for sprite, actor, veil in zip(sprites, actors, veils, strict=True):
        if actor.radius is not None:
            body = world.bodies[sprite.body]
            is_painted = is_billiard_ball(scene.objects[sprite.body].label)
            sprite = _skinned(sprite, body, light, world.view, veil, is_painted)
        relit.append(sprite)
    relit = _in_one_light(relit)
    if maps.normals is not None:
        relit = [_relieved(sprite, maps.normals, light) for sprite in relit]
    elif is_top:
        relit = [_turned_disc(sprite, world.bodies[sprite.body]) for sprite in relit]
    if not is_top:
        relit = [_edged(sprite, light) for sprite in relit]
    return relit


def _in_one_light(sprites: Sequence[Sprite]) -> list[Sprite]:
    """Return the sprites with balls as `in_one_light`."""
    balls = in_one_light([s.ball for s in sprites if s.ball is not None])
    remaining = iter(balls)
    result = []
    for sprite in sprites:
        if sprite.ball is not None:
            sprite = replace(sprite, ball=next(remaining))
        result.append(sprite)
    return result


def floor_mirror(
    sprites: Sequence[Sprite],
    starts: Sequence[Silhouette],
    reflections: F32,
    coverage: F32,
    tilt: float,
) -> Mirror | None:
    """Measure how much a floor mirrors of the objects that stand on it.

    `reflections` (H, W, 3): linear light that the photo shows beyond the background; None if it is not like the
    objects upside down.
    """
    # sums over pixels of object x reflection, object², reflection², by row below the foot
    sums = np.zeros((3, STAGING.mirrored))
    feet: list[tuple[int, float, float] | None] = []
    for sprite, start in zip(sprites, starts, strict=True):
        foot = _standing_foot(sprite, start, tilt)
        feet.append(None if foot is None else (foot, *start.ends))
        if foot is not None:
            _add_reflection(sums, sprite, foot, reflections, coverage)
    share = sums[0] / np.maximum(sums[1], 1e-6)
    correlation = sums[0] / np.sqrt(sums[1] * sums[2] + 1e-12)
    count = len(share)
    unlike = np.flatnonzero(correlation[STAGING.near_foot :] < STAGING.alike)
    if len(unlike):
        count = STAGING.near_foot + int(unlike[0])
    if count < 3 * STAGING.near_foot:
        return None
    fade = np.minimum(np.arange(count, 0, -1) / (2 * STAGING.near_foot), 1)
    return Mirror((np.maximum(share[:count], 0) * fade).astype(np.float32), feet)


def _standing_foot(sprite: Sprite, start: Silhouette, tilt: float) -> int | None:
    """Return the last row of a sprite that stands on a floor, in the photo; None for others."""
    rows = np.flatnonzero((sprite.coverage > 0.5).any(axis=1))
    contact = floor_contact(start, tilt)
    if contact is None or not len(rows) or contact.low >= 1:
        return None
    return sprite.corner[1] + int(rows[-1])


def _add_reflection(
    sums: Array, sprite: Sprite, foot: int, reflections: F32, coverage: F32
) -> None:
    """Add the products of a sprite upside down and the photo below its foot, by row."""
    left, below, last_row = sprite.corner[0] + MARGIN, foot + 1, foot - sprite.corner[1]
    flipped = sprite.light[last_row::-1, MARGIN:-MARGIN][: STAGING.mirrored]
    height, width = flipped.shape[:2]
    place = np.s_[below : below + height, left : left + width]
    is_floor = (coverage[place] == 0)[..., None]
    reflection = reflections[place] * is_floor
    count = len(reflection)
    flipped = flipped[:count] * is_floor
    products = flipped * reflection, flipped * flipped, reflection * reflection
    for total, product in zip(sums, products, strict=True):
        total[:count] += product.sum(axis=(1, 2))


def _ghosts(
    labels: U16,
    absent: Mask,
    coverage: F32,
    grounds: Sequence[Array],
    setting: ShadowSetting,
) -> list[Silhouette]:
    """Return the silhouettes of the photo's objects that the scene leaves out, the largest of them."""
    every_row, every_column = np.nonzero(absent)
    absent_ids = labels[absent]
    order = np.argsort(absent_ids, kind="stable")
    ids, counts = np.unique(absent_ids, return_counts=True)
    least = np.sort(counts)[-STAGING.ghosts :].min(initial=0)
    groups = np.split(order, np.cumsum(counts)[:-1])
    ghosts = []
    for id_, pixels in zip(ids.tolist(), groups, strict=False):
        if len(pixels) < least:
            continue
        rows, columns = every_row[pixels], every_column[pixels]
        x0, y0 = int(columns.min()), int(rows.min())
        box = np.s_[y0 : rows.max() + 1, x0 : columns.max() + 1]
        own_coverage = np.where(labels[box] == id_, coverage[box], 0)
        center = np.array([columns.mean(), rows.mean()])
        actor = ShadowBody(None, _ghost_thickness(len(rows), setting.top))
        ghosts.append(
            silhouette(
                grounds,
                own_coverage.astype(np.float32),
                (x0, y0),
                center,
                actor,
                setting.tilt,
            )
        )
    return ghosts


def _ghost_thickness(area: int, is_top: bool) -> float:
    return STAGING.deep * float(np.sqrt(area)) * (0.6 if is_top else 1.0)


def floors(world: World) -> list[Array]:
    """Return (8,) px for each segment of a wall that is level enough for shadows.

    The segment's two ends, the columns between which the floor goes on level, and 1 or 0: whether an upright wall
    stands at either end.
    """
    segments = []
    for wall in world.walls:
        for chain in wall.chains:
            segments += [np.concatenate(pair) for pair in pairwise(chain)]
    level, upright = [], []
    for segment in segments:
        across, down = np.abs(segment[2:] - segment[:2])
        if across > 1 and down < STAGING.steep * across:
            level.append(segment)
        if across < STAGING.steep * down:
            upright.append(segment)
    grounds = []
    for segment in level:
        left, right = _level_span(segment, level)
        top = min(segment[1::2])
        walls = [_has_wall_at(x, top, upright) for x in (left, right)]
        grounds.append(np.array([*segment, left, right, *walls]))
    return grounds


def _level_span(segment: Array, level: Sequence[Array]) -> tuple[float, float]:
    """Return the columns between which a segment goes on, with others that are as high and close to its ends."""
    spans = []
    for other in level:
        gaps = np.abs(np.subtract.outer(other[1::2], segment[1::2]))
        if gaps.min() < STAGING.joined:
            spans.append((min(other[::2]), max(other[::2])))
    spans.sort()
    left, right = sorted(segment[::2])
    # From left to right and back again, so that the span grows on both sides.
    for start, end in (*spans, *reversed(spans)):
        if start <= right + STAGING.joined and end >= left - STAGING.joined:
            left, right = min(left, start), max(right, end)
    return left, right


def _has_wall_at(x: float, floor: float, upright: Sequence[Array]) -> bool:
    """Return whether an upright segment stands at the column `x` of a floor at this row."""
    for segment in upright:
        top, foot = sorted((segment[:2], segment[2:]), key=lambda end: end[1])
        is_near = abs(foot[0] - x) < STAGING.joined
        if is_near and top[1] < floor < foot[1] + STAGING.joined:
            return True
    return False


def passed(ground: Array, labels: U16, shadows: U16) -> bool:
    """Return whether the photo's shadows pass by a floor: those of objects on it lie below it, on a wall behind.

    A floor that reaches back to the wall would have caught them; this one is a line that perception laid under objects
    in the air, or a thin ledge. `ground` (4,) px; `labels` and `shadows` (H, W) by id.
    """
    below, standing = 0, 0
    for id_ in np.unique(shadows[shadows > 0]):
        rows, columns = np.nonzero(labels == id_)
        if not len(rows):
            continue
        bottom = float(rows.max())
        floor = ground_below([ground], float(columns.mean()), bottom - SUNK)
        if floor is None or floor[0] - bottom >= 2 * SUNK:
            continue
        standing += 1
        shadow_row = np.median(np.nonzero(shadows == id_)[0])
        below += bool(shadow_row > floor[0] + SUNK)
    return 2 * below > standing


def thickness(body: Body, top: bool) -> float:
    """Return px that a body reaches above the table, or through the plane of motion: about its width, unless known."""
    if body.radius is not None:
        if body.solid is Solid.SPHERE or not top:
            return 2 * body.radius
        return STAGING.flat * body.radius
    points = np.concatenate(body.pieces)
    width, height = np.ptp(points, axis=0).tolist()
    depth = STAGING.deep * np.sqrt(width * height) * (0.6 if top else 1.0)
    # An upright object that is not a box was turned on a wheel or a lathe.
    box_width, box_height = cv2.minAreaRect(points.astype(np.float32))[1]
    area = sum(cv2.contourArea(piece.astype(np.float32)) for piece in body.pieces)
    is_box = area > STAGING.box * box_width * box_height
    if top or is_box:
        return float(depth)
    return float(min(depth, width))


def seen_share(
    sprite: Sprite,
    actor: ShadowBody,
    start: Silhouette,
    veil: F32,
    light: DistantLight,
) -> float:
    """Return the share 0..1 of a predicted veil (h, w) that the photo shows: light between objects fills some of it.

    By least squares on the logarithm of its light, beside Lambert's shading of a ball and an even change over any face.
    """
    opaque = sprite.coverage >= 1
    if np.count_nonzero(opaque) < 80:
        return 0.0
    rows, columns = np.nonzero(opaque)
    mean_light = sprite.light[rows, columns].mean(axis=1)
    level = np.log(mean_light + 0.01).astype(np.float64)
    if actor.radius is not None:
        u = (columns + sprite.corner[0] - start.center[0]) / actor.radius
        v = (rows + sprite.corner[1] - start.center[1]) / actor.radius
        z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
        normal = [part.astype(np.float32) for part in (u, v, z)]
        level -= np.log(sphere_shading(light, *normal))
    x, y = columns - columns.mean(), rows - rows.mean()
    terms = np.column_stack([np.ones(len(x)), x, y, -veil[rows, columns]])
    terms[:, 1:3] /= max(sprite.coverage.shape)
    return float(np.clip(_robust_weights(terms, level)[3], 0, 1))


VEIL_NOISE = 0.15
"""Error in log light beyond which a pixel counts less: paint, not shadow."""


def _robust_weights(terms: Array, level: Array) -> Array:
    """Return the weights (4,) of `terms` (n, 4) that explain `level` (n,), by reweighted least squares."""
    count = len(level)
    stiffness = 1e-3 * count * np.diag([0.0, 1, 1, 0.1])
    trust: Array = np.ones(count)
    weights: Array = np.zeros(4)
    for _ in range(4):
        weighted = terms * trust[:, None]
        normal = weighted.T @ terms + stiffness
        weights = np.asarray(np.linalg.solve(normal, weighted.T @ level), np.float64)
        errors = np.abs(level - terms @ weights)
        trust = 1 / np.maximum(errors / VEIL_NOISE, 1)
    return weights


def _actor(sprite: Sprite, body: Body, loose: bool, top: bool) -> ShadowBody:
    if loose:
        return ShadowBody(None, STAGING.thread)
    ball = body.solid is Solid.SPHERE and sprite.coverage.max(initial=0) >= 1
    ball &= top or not _is_lump(sprite, body)
    return ShadowBody(body.radius if ball else None, thickness(body, top))


def _faced(sprite: Sprite, body: Body, light: DistantLight) -> Sprite:
    """Return the sprite with its `face`: how far it shows below its shape, if as far above it as well.

    A block whose top is visible also has its `sides`.
    """
    solid = sprite.coverage >= 0.5
    rows = np.flatnonzero(solid.any(axis=1))
    if body.radius is not None or not len(rows):
        return sprite
    shape = np.concatenate(body.rings)[:, 1] + body.center[1] - sprite.corner[1]
    face = float(min(shape.min() - rows[0], rows[-1] - shape.max())) + 0.5
    if face < STAGING.seen_top:
        return sprite
    first = float(rows[0] - 0.5 + 2 * face)
    is_above = np.arange(len(solid)) < first - 0.5
    top = (sprite.coverage >= 1) & is_above[:, None]
    has_four_corners = len(body.rings) == 1 and len(body.rings[0]) == 4
    top_rows = solid.argmax(axis=0)[solid.any(axis=0)]
    is_level = np.ptp(np.percentile(top_rows, (25, 75))) <= CUT.flat
    if not (has_four_corners and top.any() and is_level):
        return replace(sprite, face=face)
    colour = np.median(sprite.light[top], axis=0)
    sides = Sides(first, STAGING.back * 2 * face, colour, light)
    return replace(sprite, face=face, sides=sides)


def _is_lump(sprite: Sprite, body: Body) -> bool:
    """Return whether a rolling object reaches beyond its circle on many sides.

    Such fruit turns as a picture: a skin on its circle would leave its outline behind.
    """
    if body.radius is None:
        return False
    rows, columns = np.nonzero(sprite.coverage > 0.5)
    x = columns + sprite.corner[0] - body.center[0]
    y = rows + sprite.corner[1] - body.center[1]
    is_stray = np.hypot(x, y) > body.radius + 2
    if np.count_nonzero(is_stray) <= STAGING.stray * len(rows):
        return False
    steps = np.unique((np.arctan2(y, x)[is_stray] * 36 / np.pi).astype(int))
    return len(steps) >= STAGING.lumpy_turn * 72


def _parted(
    sprite: Sprite, body: Body, lumpiness: float = 0.0
) -> list[tuple[Sprite, bool]]:
    """Separate a ball from a thread or a handle that hangs on it, which turns as a picture; and whether it is that.

    What reaches at most `lumpiness` radii beyond the circle is the ball's own.
    """
    if body.radius is None or body.solid is not Solid.SPHERE:
        return [(sprite, False)]
    x, y = body.center.tolist()
    rows, columns = np.indices(sprite.coverage.shape)
    distance = np.hypot(columns + sprite.corner[0] - x, rows + sprite.corner[1] - y)
    stray_area = sprite.coverage[distance > body.radius + 2].sum()
    farthest = distance[sprite.coverage > 0.5].max(initial=0.0)
    has_thread = bool(
        stray_area > STAGING.stray * sprite.coverage.sum()
        and farthest > (1 + lumpiness) * body.radius
    )
    # The thread lies beneath and reaches a pixel farther in, so that no gap shows between them.
    rim = 1 if has_thread else 2
    inside = np.clip(body.radius + rim - distance, 0, 1).astype(np.float32)
    ball = _masked(sprite, inside)
    if not has_thread:
        return [(ball, False)]
    outside = np.clip(distance - body.radius + 1, 0, 1).astype(np.float32)
    return [(_masked(sprite, outside), True), (ball, False)]


def _masked(sprite: Sprite, share: F32) -> Sprite:
    """Return the sprite with a share (h, w) of its light and coverage."""
    light = sprite.light * share[..., None]
    return replace(sprite, light=light, coverage=sprite.coverage * share)


def _skinned(
    sprite: Sprite,
    body: Body,
    light: DistantLight,
    view: View,
    veil: F32 | None,
    is_painted: bool,
) -> Sprite:
    """Return a sphere's sprite with its skin.

    `veil` (h, w) is -log of the light that other objects leave on it.
    """
    assert body.radius is not None
    x, y = body.center.tolist()
    alpha = sprite.coverage[..., None]
    own_light = sprite.light / np.maximum(alpha, 1e-3)
    colour = np.where(alpha > 1e-3, own_light, 0).astype(np.float32)
    colour = _over_circle(colour, sprite, (x, y), body.radius)
    if veil is not None:
        colour *= np.exp(veil)[..., None]
    ball = ball_from_photo(
        colour, sprite.corner, (x, y), body.radius, light, view, is_painted
    )
    return replace(sprite, ball=ball)


def _over_circle(
    colour: F32, sprite: Sprite, center: tuple[float, float], radius: float
) -> F32:
    """Return the colour (h, w, 3) of a ball, also where its mask leaves its circle out.

    Lumpy fruit has bays in its circle that would turn as dark spots.
    """
    rows, columns = np.indices(sprite.coverage.shape)
    x, y = columns + sprite.corner[0], rows + sprite.corner[1]
    is_inside = np.hypot(x - center[0], y - center[1]) < radius
    is_open = is_inside & (sprite.coverage <= 1e-3)
    source = sprite.coverage > 0.5
    if not is_open.any() or not source.any():
        return colour
    _, seeds = cv2.distanceTransformWithLabels(
        (~source).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.zeros((int(seeds.max()) + 1, 2), np.int64)
    places[seeds[source]] = np.argwhere(source)
    nearest = places[seeds[is_open]]
    filled = colour.copy()
    filled[is_open] = colour[nearest[:, 0], nearest[:, 1]]
    return filled


def _relieved(sprite: Sprite, normals: F32, light: DistantLight) -> Sprite:
    """Return a sprite that is no ball with the photo's `normals` (H, W, 3)."""
    if sprite.ball is not None:
        return sprite
    height, width = normals.shape[:2]
    h, w = sprite.coverage.shape
    x0, y0 = sprite.corner
    top, bottom = max(y0, 0), min(y0 + h, height)
    left, right = max(x0, 0), min(x0 + w, width)
    box = np.s_[top - y0 : bottom - y0, left - x0 : right - x0]
    own_normals = np.zeros((h, w, 3), np.float32)
    own_normals[box] = normals[top:bottom, left:right]
    known = np.zeros((h, w), bool)
    known[box] = sprite.coverage[box] > 0.7
    return replace(sprite, relief=relief_of(own_normals, known, light))


def _edged(sprite: Sprite, light: DistantLight) -> Sprite:
    """Return the sprite with rounded edges if the photo shows them lit.

    A change of light on rings inside the outline that one direction towards the light explains stays as the object
    turns; any other change is paint.
    """
    solid = (sprite.coverage >= 1).astype(np.uint8)
    if sprite.sides is not None:
        solid[: ceil(sprite.sides.first)] = 0
    padded_depth = cv2.distanceTransform(np.pad(solid, 1), cv2.DIST_L2, 5)
    depth = np.asarray(padded_depth[1:-1, 1:-1], np.float32)
    has_inside = (depth > 2 * CUT.rim).any()
    if sprite.ball is not None or sprite.relief is not None or not has_inside:
        return sprite
    normal = _outward_normals(solid)
    edge = _edge_light(sprite, depth)
    gain = _edge_gain(normal, edge, depth, solid > 0, light)
    if gain is None:
        return sprite
    x, y = normal[..., 0], normal[..., 1]
    gain_x, gain_y = gain[..., 0], gain[..., 1]
    toward, across = gain_x * x + gain_y * y, gain_x * y - gain_y * x
    # Where the outline is off by a pixel, the photo shows no such edge: half of it will do, a quarter is none.
    has_light = np.abs(toward) > STAGING.faint
    shown = np.divide(edge, toward, out=np.ones_like(edge), where=has_light)
    strength = np.clip(4 * shown - 1, 0, 1)
    return replace(sprite, relief=_edge_relief(toward * strength, across * strength))


def _outward_normals(solid: U8) -> F32:
    """Return (h, w, 2) unit vectors, right and down, that point out of a shape."""
    soft = cv2.GaussianBlur(solid.astype(np.float32), (0, 0), CUT.clean)
    x = -cv2.Sobel(soft, cv2.CV_32F, 1, 0)
    y = -cv2.Sobel(soft, cv2.CV_32F, 0, 1)
    length = np.maximum(np.hypot(x, y), 1e-6)[..., None]
    return np.asarray(np.stack([x, y], axis=2) / length, np.float32)


def _edge_light(sprite: Sprite, depth: F32) -> F32:
    """Return (h, w) the light of a sprite relative to that of its face close by, less 1."""
    brightness = sprite.light.mean(axis=2)
    inner = (depth > CUT.rim).astype(np.float32)
    face_light = cv2.GaussianBlur(brightness * inner, (0, 0), CUT.along)
    weight = cv2.GaussianBlur(inner, (0, 0), CUT.along)
    face_light, weight = np.maximum(face_light, 1e-4), np.maximum(weight, 1e-4)
    return np.asarray(brightness * weight / face_light - 1, np.float32)


def _edge_gain(
    normal: F32, edge: F32, depth: F32, solid: Mask, light: DistantLight
) -> F32 | None:
    """Return (h, w, 2) the light of edges by their normals.

    None if there is no edge, or the whole shape is round.
    """
    gain = np.zeros_like(normal)
    rings = np.maximum(np.ceil(depth), 1)
    toward_light = np.array(light.direction[:2])
    sun = light.direction[:2] / np.maximum(np.hypot(*light.direction[:2]), 1e-6)
    strengths = [0.0] * CUT.rim
    for number in range(1, CUT.rim + 1):
        ring = (rings == number) & solid
        directions = normal[ring] - normal[ring].mean(axis=0)
        change = edge[ring] - edge[ring].mean()
        slope = np.linalg.lstsq(directions, change)[0]
        explained = ((directions @ slope) ** 2).sum()
        is_light = explained > STAGING.edged * (change**2).sum()
        if is_light and slope @ toward_light > 0:
            strength = min(float(np.hypot(*slope)), STAGING.lit)
            direction = slope / np.hypot(*slope) + STAGING.sun * sun
            gain[rings == number] = strength * direction / np.hypot(*direction)
            strengths[number - 1] = strength
    if max(strengths) <= 2 * strengths[-1]:
        return None
    return gain


def _edge_relief(toward: F32, across: F32) -> Relief:
    """Return the relief of light that changes by `toward`, and by `across` if turned by a quarter."""
    model = np.maximum(1 + toward, 1 / MOST_RELIGHTING)
    fixed, even = np.ones_like(toward), np.zeros_like(toward)
    return Relief(
        along=np.asarray(toward / model, np.float32),
        across=np.asarray(across / model, np.float32),
        fixed=np.asarray(fixed / model, np.float32),
        even=np.asarray(even / model, np.float32),
    )


def _turned_disc(sprite: Sprite, body: Body) -> Sprite:
    """Return a disc seen from above with light that stays as it turns.

    A small change of light once around, on rings that the photo shows all around, is light; more is paint.
    """
    if body.radius is None or body.solid is Solid.SPHERE:
        return sprite
    rows, columns = np.indices(sprite.coverage.shape)
    x = columns + sprite.corner[0] - body.center[0]
    y = rows + sprite.corner[1] - body.center[1]
    distance = np.maximum(np.hypot(x, y), 1.0)
    cosine, sine = x / distance, y / distance
    rings = np.minimum(distance, max(body.radius - 2, 0)).astype(int)
    known = (sprite.coverage >= 1) & (distance < body.radius)
    brightness = sprite.light.mean(axis=2)
    sums = []
    for term in (np.ones_like(cosine), 2 * cosine, 2 * sine):
        sums.append(
            np.bincount(rings[known], (brightness * term)[known], rings.max() + 1)
        )
    counts = np.bincount(rings[known], minlength=rings.max() + 1)
    counts = np.maximum(counts, 1)
    circumferences = np.pi * (2 * np.arange(len(counts)) + 1)
    is_visible = counts > STAGING.around * circumferences
    is_even = np.hypot(*sums[1:]) < STAGING.uneven * sums[0]
    is_light = is_visible & is_even
    sums = [sums[0], sums[1] * is_light, sums[2] * is_light]
    means = []
    for term in sums:
        smooth = cv2.GaussianBlur(term / counts, (0, 0), 1.0).ravel()
        means.append(smooth[rings])
    even = np.maximum(means[0], CUT.dark)
    toward = (means[1] * cosine + means[2] * sine) / even
    across = (means[1] * sine - means[2] * cosine) / even
    return replace(sprite, relief=_edge_relief(toward, across))
