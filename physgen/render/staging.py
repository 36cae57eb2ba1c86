"""From scene, world and photo to a Stage: cut-out sprites, flat shapes, or a matte.

A matte is a Stage of white objects in the dark. It is drawn like any other stage, so
its light is the objects' coverage with soft borders, supersampling, exposure, camera
and size as in the frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from physgen.materials import (
    is_billiard_ball,
    is_book,
    is_open_vessel,
    is_polished_metal,
    is_shallow_vessel,
)
from physgen.photometry import DistantLight, decode
from physgen.render.ball import ball_from_photo, sphere_shading
from physgen.render.ball_light import in_one_light
from physgen.render.block_tops import TOPS, top_of_book
from physgen.render.box_faces import with_closed_faces
from physgen.render.contact_shade import contact_depth
from physgen.render.halo_split import split_halos
from physgen.render.hanging_ball import has_one_hue, without_eyelet
from physgen.render.highlights import DiscPicture, shared_highlights
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
    Gloss,
    Relief,
    Sides,
    Sprite,
    anchored,
    relief_of,
)
from physgen.render.stage import Frame, Mirror, ShadowBody, Stage, three_channels
from physgen.render.vessels import (
    SHALLOW_VESSEL,
    VESSEL,
    VesselTuning,
    open_vessel,
    with_room_for_opening,
)
from physgen.render.wheel_sprites import drawn_wheel, wheel_from_photo
from physgen.scene.scene import Scene, Solid, View

PAPER = (244, 242, 238)
INK = (70, 70, 74)
PALETTE = (
    (86, 130, 178), (214, 122, 84), (104, 160, 106), (196, 92, 104), (140, 116, 176),
    (208, 172, 82), (92, 166, 172), (170, 128, 104), (196, 134, 170), (128, 134, 146),
)  # fmt: skip
"""Colours of objects in turn, sRGB: different in hue and close in lightness, so that no
object stands out.
"""


@dataclass(frozen=True)
class StagingTuning:
    """Assumed depths of objects, and limits of flat drawings."""

    large: int = 4_000_000
    """Area of the sprite of one object above which only its visible part is
    drawn, px².
    """
    fine: int = 8
    """Sub-pixels per side for lines."""
    flat: float = 0.8
    """Height of a disc above a table, radii, if the scene does not state it."""
    deep: float = 0.9
    """Thickness of other objects, in roots of their areas."""
    ghosts: int = 200
    """Approximate number of the largest left-out objects with removed shadows."""
    seen_top: float = 0.7
    """Height of an object's picture above and below its shape, px, that is not just a
    ragged border.
    """
    back: float = 0.8
    """Share of a visible top that the sides show, since edges are rounded; by tune."""
    stray: float = 0.03
    """Largest share of a ball's pixels outside its circle."""
    lumpy: float = 0.5
    """Extent of a fruit beyond its circle, radii."""
    lumpy_turn: float = 0.2
    """Share of a turn in which a lump reaches beyond its circle; a thread
    covers less.
    """
    around: float = 0.75
    """Smallest visible share of a disc's ring to tell light from paint."""
    uneven: float = 0.7
    """Change around a ring, relative to its mean, above which it is paint."""
    box: float = 0.9
    """Share of its bounding box that a block fills."""
    edged: float = 0.3
    """Share of the variance of an edge's light that one direction must explain."""
    lit: float = 0.5
    """Maximum change of an edge's light with its direction, relative to the face."""
    sun: float = 0.5
    """Weight of the scene's light in the direction of edges' light, which two sides
    alone do not tell.
    """
    faint: float = 0.05
    """Light of an edge, relative to the face, below which it may be grain."""
    thread: float = 2.0
    """Thickness of a thread on a ball, px."""
    steep: float = 0.25
    """Slope above which a boundary is not a floor: its shadows are elsewhere."""
    mirrored: int = 60
    """Rows below an object's foot in which a reflection is measured, px."""
    near_foot: int = 4
    """Rows of these that objects' blurred rims and contact shadows may disturb, px."""
    alike: float = 0.7
    """Correlation with the upside-down object above which a floor mirrors it."""
    soft: float = 0.1
    """Direct over ambient light below which a light is soft."""
    joined: float = 9.0
    """Gap between two boundaries of one floor, px."""


STAGING = StagingTuning()


def enlarged_world(
    world: World, outlines: Sequence[Outline], scale: float
) -> tuple[World, list[Outline]]:
    """Enlarge canvas, walls, bodies and outlines by `scale`, for drawing.

    Masses, velocities and other properties stay as they are.
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
    larger_world = replace(
        world,
        size=(ceil(width * scale - 1e-6), ceil(height * scale - 1e-6)),
        bodies=tuple(map(enlarge_body, world.bodies)),
        walls=tuple(walls),
    )
    return larger_world, list(map(enlarge_outline, outlines))


SHIFT_BITS = 4
"""Fractional bits of OpenCV's coordinates."""
FARTHEST = 2**24
"""Largest coordinate of OpenCV without overflow, 1 / 2**SHIFT_BITS px."""


def flat_background(world: World, pen: float = 1.0) -> U8:
    """Draw a background (H, W, 3) sRGB: paper, with walls as lines.

    Lines are on the side of the walls away from the objects.
    """
    width, height = world.size
    # Draw small pictures four times as large and reduce them, for smooth lines.
    scale = 4 if width * height <= 4_000_000 else 1
    canvas = np.empty((height * scale, width * scale, 3), np.uint8)
    canvas[:] = PAPER
    line_width = round(2 * scale * pen)
    for wall in world.walls:
        for chain in wall.chains:
            # OpenCV draws from integers with a fixed number of binary digits.
            points = np.rint((chain + 0.5) * scale * 2**SHIFT_BITS).astype(np.int64)
            corners = np.clip(points, -FARTHEST, FARTHEST).astype(np.int32)
            line_type = cv2.LINE_AA
            cv2.polylines(
                canvas, [corners], False, INK, line_width, line_type, SHIFT_BITS
            )
    small_canvas = cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small_canvas, np.uint8)


def flat_sprites(
    world: World, outlines: Sequence[Outline], order: Sequence[int], pen: float = 1.0
) -> list[Sprite]:
    """Draw one sprite per object: its colour with a darker rim, and a spoke in circles.

    Of an object much larger than the canvas, only the part near the canvas is drawn.
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
        # The margin leaves room for interpolation at the border of a sprite.
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
    """Return the number of each wheel of a sprite's body, and its axle in px of the
    sprite.
    """
    before = sum(len(body.wheels) for body in world.bodies[: sprite.body])
    body = world.bodies[sprite.body]
    axles = []
    for k, wheel in enumerate(body.wheels):
        x, y = (body.center + wheel.axle - sprite.corner).tolist()
        axles.append((before + k, (x, y)))
    return axles


def _on_drawn_wheels(sprite: Sprite, world: World, colour: F32) -> Sprite:
    """Add wheels of a colour `(3,)` to a sprite, also at rest."""
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
    """Add the wheels of its body to a sprite, cut from the photo."""
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
    """Return the share (h, w) 0..1 of each pixel under the rim and the spoke."""
    height, width = shape
    scale = STAGING.fine if height * width < 250_000 else 2
    canvas = np.zeros((height * scale, width * scale), np.uint8)
    line_width = max(1, round(1.5 * scale * pen))

    def pixels(points: Array) -> NDArray[np.int32]:
        return np.rint((points + body.center - corner + 0.5) * scale).astype(np.int32)

    rings = [pixels(ring) for ring in body.rings]
    cv2.polylines(canvas, rings, True, 255, 2 * line_width)
    if body.radius is not None:
        spoke = pixels(np.array([[0.0, 0.0], [body.radius, 0.0]]))
        cv2.line(canvas, spoke[0].tolist(), spoke[1].tolist(), 255, line_width)
    small_canvas = cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
    return (small_canvas / 255.0).astype(np.float32)


NO_LIGHT = DistantLight((0.0, 0.0, 1.0), 0.0, 1.0)
"""Even light from all directions, without shading."""


def matte_stage(stage: Stage) -> Stage:
    """Return a stage of the same objects in white, without shading and shadows.

    All else is dark, also objects of the photo that the scene leaves out.
    """
    return Stage(
        background=np.zeros_like(stage.background),
        sprites=[_white(sprite) for sprite in stage.sprites],
        supersample=stage.supersample,
        scale=stage.scale,
    )


def _white(sprite: Sprite) -> Sprite:
    """Return a white sprite.

    A ball gets dark skin and white gloss, because its picture does not turn with it.
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
    white_sides = sprite.sides and replace(
        sprite.sides,
        colour=np.ones(3, np.float32),
        light=None,
        top=sprite.sides.top and sprite.sides.top.white_copy(),
    )
    return replace(
        sprite,
        light=three_channels(sprite.coverage),
        rest=None,
        halo=None,
        foot_halo=None,
        ball=ball,
        relief=None,
        gloss=None,
        sides=white_sides,
        wheels=(),
    )


def matte_coverage(frame: Frame) -> F32:
    """Return the coverage of all objects together, (H, W) 0..1, from a matte's
    frame.
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
    labels: U16,
) -> Stage:
    """Create the stage of a photo, with sprites that react to light and shadows.

    `background` (H, W, 3) sRGB with the objects' shadows; `coverage` (H, W) of all
    objects, also of `absent` ones; `labels` (H, W): id k + 1 is body k.
    """
    photo = decode(maps.rgb)
    sprites = [_on_wheels(sprite, world) for sprite in sprites]
    sprites = _with_vessels(with_room_for_opening, scene, world, sprites, labels)
    if world.view is not View.TOP:
        sprites = _with_closed_faces(world, sprites, labels)
    if scene.light is None:
        sprites = _with_vessels(open_vessel, scene, world, sprites, labels)
        return Stage(background, anchored(sprites, photo, decode(background), absent))
    setting = _shadow_setting(scene, world)
    shadow_floors = _shadow_floors(world, maps, setting)
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
        starts.append(
            silhouette(shadow_floors, picture, corner, center, actor, setting.tilt)
        )
    veils: list[F32 | None] = [None] * len(sprites)
    clean, halo_reach = maps.clean, None
    is_mirror = _has_mirrors_alone(maps)
    if is_mirror and clean is not None:
        # The difference consists of no shadows, and stays in the halos.
        background, clean, halo_reach = clean, None, 1.0
    if scene.render.shadows and clean is not None:
        # A clean picture exists, so shadows of this light are visible in the photo.
        actors, veils = _visible_veils(sprites, actors, starts, setting)
    # Shadows in the photo are those of vessels with their lids on.
    sprites = _with_vessels(open_vessel, scene, world, sprites, labels)
    if not setting.top:
        sprites = [
            _add_front_face(
                sprite,
                world.bodies[sprite.body],
                setting.light,
                is_book(scene.objects[sprite.body].label),
            )
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
    ghosts = _ghosts(maps.labels, absent, coverage, shadow_floors, setting)
    difference = cv2.absdiff(maps.rgb, background)
    is_equal = cv2.inRange(difference, (0, 0, 0), (0, 0, 0)) > 0
    is_changed = ~is_equal & (coverage == 0)
    lit, ghost_shadows = decompose_shadows(
        background, clean, coverage, starts, rounds, setting, ghosts, is_changed
    )
    if ghost_shadows is not None:
        # Remove the shadows of left-out objects from the photo, too.
        shadows = np.where(coverage < 0.5, ghost_shadows, 0)
        photo = photo * np.exp(shadows)[..., None].astype(np.float32)
    behind = lit.behind()
    mirror = None
    if not setting.top:
        mirror = floor_mirror(sprites, starts, photo - behind, coverage, setting.tilt)
    sprites = anchored(sprites, photo, behind, absent, lit.owner, halo_reach)
    has_loose_shade = clean is None or _is_soft(setting.light)
    if not setting.top and mirror is None and has_loose_shade:
        sprites = split_halos(
            sprites,
            starts,
            setting.tilt,
            behind,
            is_mirror=is_mirror,
            plate=None if clean is None else lit.plate,
        )
    return Stage(
        background,
        sprites,
        lit,
        actors,
        shadow_floors,
        None if clean is None else veils,
        mirror=mirror,
        contact_depth=contact_depth(scene),
    )


def _has_mirrors_alone(maps: Percepts) -> bool:
    """Check whether the clean background lacks mirror images, but no shadows.

    A map of shadows without any id says so; without a map, nothing is known.
    """
    return (
        maps.clean is not None and maps.shadows is not None and not maps.shadows.any()
    )


def _is_soft(light: DistantLight) -> bool:
    """Check whether a light has hardly a direction: geometry predicts few shadows."""
    return light.intensity < STAGING.soft * light.ambient


def _with_vessels(
    change: Callable[[Sprite, Body, U16, float, Sequence[int], VesselTuning], Sprite],
    scene: Scene,
    world: World,
    sprites: Sequence[Sprite],
    labels: U16,
) -> list[Sprite]:
    """Return the sprites; those of vessels that may be open are changed by `change`."""
    tilt = tan(radians(scene.world.tilt))
    result = []
    for k, sprite in enumerate(sprites):
        if _may_be_open(scene, world, sprite):
            # Only objects that are drawn later are nearer and may hide an opening.
            nearer_bodies = _bodies(sprites[k:])
            body = world.bodies[sprite.body]
            is_shallow = is_shallow_vessel(scene.objects[sprite.body].label)
            tuning = SHALLOW_VESSEL if is_shallow else VESSEL
            sprite = change(sprite, body, labels, tilt, nearer_bodies, tuning)
        result.append(sprite)
    return result


def _with_closed_faces(
    world: World, sprites: Sequence[Sprite], labels: U16
) -> list[Sprite]:
    """Return the sprites; faces of boxes behind other objects reach both ends."""
    result = []
    for k, sprite in enumerate(sprites):
        body = world.bodies[sprite.body]
        result.append(with_closed_faces(sprite, body, labels, _bodies(sprites[k:])))
    return result


def _bodies(sprites: Sequence[Sprite]) -> list[int]:
    """Return the bodies of sprites.

    Those drawn before a bowl may lie in it, and do not hide it.
    """
    return [sprite.body for sprite in sprites]


def _may_be_open(scene: Scene, world: World, sprite: Sprite) -> bool:
    """Check whether a sprite shows a vessel from the side."""
    label = scene.objects[sprite.body].label
    is_vessel = is_open_vessel(label) or is_shallow_vessel(label)
    return world.view is not View.TOP and is_vessel


def _shadow_setting(scene: Scene, world: World) -> ShadowSetting:
    """Return the surroundings for shadows: light, floor and wall."""
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
    """Return the floors, as `floors`, under the photo's shadows."""
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
    """Separate balls from threads as `_parted`; lumps in the side view stay whole."""
    parts = []
    for sprite in sprites:
        lumpiness = 0.0
        label = scene.objects[sprite.body].label
        if world.view is View.SIDE and _is_lump(sprite, world.bodies[sprite.body]):
            parts.append((sprite, False))
            continue
        if world.view is View.TOP and not is_billiard_ball(label):
            lumpiness = STAGING.lumpy
        body = world.bodies[sprite.body]
        own_parts = _parted(sprite, body, lumpiness)
        if len(own_parts) == 2 and is_polished_metal(label):
            thread, ball = own_parts
            bare_ball = without_eyelet(ball[0], thread[0], body)
            own_parts = [thread, (bare_ball, False)]
        parts += own_parts
    return parts


def _visible_veils(
    sprites: Sequence[Sprite],
    actors: Sequence[ShadowBody],
    starts: Sequence[Silhouette],
    setting: ShadowSetting,
) -> tuple[list[ShadowBody], list[F32 | None]]:
    """Predict the veils that objects cast on each other, as strong as in the photo.

    Returns the actors with this strength, and the veil (h, w) of each sprite, -log of
    light.
    """
    neighbours = occluders(starts, setting)
    all_neighbours = {k: neighbours.get(k, []) for k in range(len(starts))}
    predictions = occlusions(starts, all_neighbours, setting)
    shares = {}
    for k, prediction in predictions.items():
        shares[k] = seen_share(
            sprites[k], actors[k], starts[k], prediction, setting.light
        )
    # An object without a veil at the start gets the median strength for later ones.
    typical = float(np.median([*shares.values()])) if shares else 1.0
    visible_veils: list[F32 | None] = []
    veiled_actors = []
    for k, actor in enumerate(actors):
        share = shares.get(k, typical)
        veiled_actors.append(replace(actor, veiled=share))
        veil: F32 | None = None
        if k in predictions and share != 0:
            veil = np.asarray(share * predictions[k], np.float32)
        visible_veils.append(veil)
    return veiled_actors, visible_veils


def _relit_sprites(
    scene: Scene,
    world: World,
    sprites: Sequence[Sprite],
    actors: Sequence[ShadowBody],
    veils: Sequence[F32 | None],
    maps: Percepts,
) -> list[Sprite]:
    """Return the sprites with skins or reliefs, so that their light changes as they
    turn.
    """
    light = _shadow_setting(scene, world).light
    is_top = world.view is View.TOP
    new_sprites = []
    for sprite, actor, veil in zip(sprites, actors, veils, strict=True):
        if actor.radius is not None:
            body = world.bodies[sprite.body]
            label = scene.objects[sprite.body].label
            sprite = _add_sphere_skin(sprite, body, light, world.view, veil, label)
        new_sprites.append(sprite)
    # Skins first, one by one; then balls of a set share their light.
    new_sprites = _in_one_light(new_sprites)
    if maps.normals is not None:
        new_sprites = [
            _add_relief(sprite, maps.normals, light) for sprite in new_sprites
        ]
    elif is_top:
        new_sprites = _part_highlights_of_discs(new_sprites, world)
        new_sprites = [
            _turned_disc(sprite, world.bodies[sprite.body]) for sprite in new_sprites
        ]
    if not is_top:
        new_sprites = [_edged(sprite, light) for sprite in new_sprites]
    return new_sprites


def _in_one_light(sprites: Sequence[Sprite]) -> list[Sprite]:
    """Return the sprites with their balls as in `in_one_light`."""
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
    """Measure the reflections of objects on their floor.

    `reflections` (H, W, 3): linear light of the photo beyond the background. None
    unless they resemble the objects upside down.
    """
    # Sums over pixels of object x reflection, object², reflection², by row below the
    # foot, give the regression and the correlation of each row.
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
    unlike_rows = np.flatnonzero(correlation[STAGING.near_foot :] < STAGING.alike)
    if len(unlike_rows):
        count = STAGING.near_foot + int(unlike_rows[0])
    if count < 3 * STAGING.near_foot:
        return None
    fade = np.minimum(np.arange(count, 0, -1) / (2 * STAGING.near_foot), 1)
    return Mirror((np.maximum(share[:count], 0) * fade).astype(np.float32), feet)


def _standing_foot(sprite: Sprite, start: Silhouette, tilt: float) -> int | None:
    """Return the last row of a sprite that stands on a floor, in the photo;
    else None.
    """
    rows = np.flatnonzero((sprite.coverage > 0.5).any(axis=1))
    contact = floor_contact(start, tilt)
    if contact is None or not len(rows) or contact.low >= 1:
        return None
    return sprite.corner[1] + int(rows[-1])


def _add_reflection(
    sums: Array, sprite: Sprite, foot: int, reflections: F32, coverage: F32
) -> None:
    """Add the products of the upside-down sprite and the photo below its foot,
    by row.
    """
    left, first_row, last_row = (
        sprite.corner[0] + MARGIN,
        foot + 1,
        foot - sprite.corner[1],
    )
    flipped_sprite = sprite.light[last_row::-1, MARGIN:-MARGIN][: STAGING.mirrored]
    height, width = flipped_sprite.shape[:2]
    place = np.s_[first_row : first_row + height, left : left + width]
    # Compare only pixels of the bare floor, not of other objects.
    is_floor = (coverage[place] == 0)[..., None]
    reflection = reflections[place] * is_floor
    count = len(reflection)
    flipped_sprite = flipped_sprite[:count] * is_floor
    products = (
        flipped_sprite * reflection,
        flipped_sprite * flipped_sprite,
        reflection * reflection,
    )
    for total, product in zip(sums, products, strict=True):
        total[:count] += product.sum(axis=(1, 2))


def _ghosts(
    labels: U16,
    absent: Mask,
    coverage: F32,
    grounds: Sequence[Array],
    setting: ShadowSetting,
) -> list[Silhouette]:
    """Return the silhouettes of the largest objects that the scene leaves out."""
    every_row, every_column = np.nonzero(absent)
    absent_ids = labels[absent]
    # Group the pixels of each object by one sort, instead of a search per object.
    order = np.argsort(absent_ids, kind="stable")
    ids, counts = np.unique(absent_ids, return_counts=True)
    smallest_count = np.sort(counts)[-STAGING.ghosts :].min(initial=0)
    groups = np.split(order, np.cumsum(counts)[:-1])
    ghosts = []
    for id_, pixels in zip(ids.tolist(), groups, strict=False):
        if len(pixels) < smallest_count:
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
    """Return the assumed thickness of a left-out object, px."""
    return STAGING.deep * float(np.sqrt(area)) * (0.6 if is_top else 1.0)


def floors(world: World) -> list[Array]:
    """Return (8,) px for each nearly level segment of a wall.

    The values are both ends of the segment, the columns of both ends of its level
    floor, and 1 or 0 for an upright wall at either end.
    """
    segments = []
    for wall in world.walls:
        for chain in wall.chains:
            segments += [np.concatenate(pair) for pair in pairwise(chain)]
    level_segments, upright_segments = [], []
    for segment in segments:
        run, rise = np.abs(segment[2:] - segment[:2])
        if run > 1 and rise < STAGING.steep * run:
            level_segments.append(segment)
        if run < STAGING.steep * rise:
            upright_segments.append(segment)
    # Adjoining level segments form one floor, which ends at a wall or at an edge.
    grounds = []
    for segment in level_segments:
        left, right = _level_span(segment, level_segments)
        top = min(segment[1::2])
        walls = [_has_wall_at(x, top, upright_segments) for x in (left, right)]
        grounds.append(np.array([*segment, left, right, *walls]))
    return grounds


def _level_span(segment: Array, level: Sequence[Array]) -> tuple[float, float]:
    """Return the columns of both ends of a floor: of a segment and its level
    continuations.
    """
    spans = []
    for other in level:
        gaps = np.abs(np.subtract.outer(other[1::2], segment[1::2]))
        if gaps.min() < STAGING.joined:
            spans.append((min(other[::2]), max(other[::2])))
    spans.sort()
    left, right = sorted(segment[::2])
    # Forwards and backwards, so that the span grows on both sides.
    for start, end in (*spans, *reversed(spans)):
        if start <= right + STAGING.joined and end >= left - STAGING.joined:
            left, right = min(left, start), max(right, end)
    return left, right


def _has_wall_at(x: float, floor: float, upright: Sequence[Array]) -> bool:
    """Check whether an upright segment stands at column `x` of a floor in this row."""
    for segment in upright:
        top, foot = sorted((segment[:2], segment[2:]), key=lambda end: end[1])
        is_near = abs(foot[0] - x) < STAGING.joined
        if is_near and top[1] < floor < foot[1] + STAGING.joined:
            return True
    return False


def passed(ground: Array, labels: U16, shadows: U16) -> bool:
    """Check whether the photo's shadows pass by a floor.

    Shadows of objects on it are then below it, on a wall behind. A floor that leads
    back to the wall would have received them; such a floor is a line that perception
    laid under floating objects, or a thin ledge. `ground` (4,) px; `labels` and
    `shadows` (H, W) by id.
    """
    count_below, count_standing = 0, 0
    for id_ in np.unique(shadows[shadows > 0]):
        rows, columns = np.nonzero(labels == id_)
        if not len(rows):
            continue
        bottom = float(rows.max())
        # Only objects that stand on a floor tell whether shadows fall on it or pass
        # below.
        floor = ground_below([ground], float(columns.mean()), bottom - SUNK)
        if floor is None or floor[0] - bottom >= 2 * SUNK:
            continue
        count_standing += 1
        shadow_row = np.median(np.nonzero(shadows == id_)[0])
        count_below += bool(shadow_row > floor[0] + SUNK)
    return 2 * count_below > count_standing


def thickness(body: Body, top: bool) -> float:
    """Return the thickness of a body above the table, or across the plane of motion,
    px.

    It is about the width, unless the scene states it.
    """
    if body.radius is not None:
        if body.solid is Solid.SPHERE or not top:
            return 2 * body.radius
        return STAGING.flat * body.radius
    points = np.concatenate(body.pieces)
    width, height = np.ptp(points, axis=0).tolist()
    depth = STAGING.deep * np.sqrt(width * height) * (0.6 if top else 1.0)
    # An upright object other than a box is probably a solid of revolution.
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
    """Return the visible share 0..1 of a predicted veil (h, w) in the photo.

    Light between objects reduces a veil. Least squares on the logarithm of the light,
    beside Lambert's shading of a ball and a linear change over the face.
    """
    is_opaque = sprite.coverage >= 1
    if np.count_nonzero(is_opaque) < 80:
        return 0.0
    rows, columns = np.nonzero(is_opaque)
    mean_light = sprite.light[rows, columns].mean(axis=1)
    # Light is a product of factors: paint, shading and veils. Its logarithm is a sum.
    level = np.log(mean_light + 0.01).astype(np.float64)
    if actor.radius is not None:
        u = (columns + sprite.corner[0] - start.center[0]) / actor.radius
        v = (rows + sprite.corner[1] - start.center[1]) / actor.radius
        z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
        normal = [part.astype(np.float32) for part in (u, v, z)]
        level -= np.log(sphere_shading(light, *normal))
    x, y = columns - columns.mean(), rows - rows.mean()
    # The unknowns are a constant, two slopes over the face and the share of the veil.
    terms = np.column_stack([np.ones(len(x)), x, y, -veil[rows, columns]])
    terms[:, 1:3] /= max(sprite.coverage.shape)
    return float(np.clip(_robust_weights(terms, level)[3], 0, 1))


VEIL_NOISE = 0.15
"""Error of log light above which a pixel counts less, as paint."""


def _robust_weights(terms: Array, level: Array) -> Array:
    """Return the weights (4,) of `terms` (n, 4) that explain `level` (n,).

    Iteratively reweighted least squares.
    """
    count = len(level)
    # A weak ridge decides where terms cannot be told apart.
    stiffness = 1e-3 * count * np.diag([0.0, 1, 1, 0.1])
    trust: Array = np.ones(count)
    weights: Array = np.zeros(4)
    for _ in range(4):
        weighted_terms = terms * trust[:, None]
        normal = weighted_terms.T @ terms + stiffness
        weights = np.asarray(
            np.linalg.solve(normal, weighted_terms.T @ level), np.float64
        )
        errors = np.abs(level - terms @ weights)
        # Huber weights: paint that does not follow the terms counts less.
        trust = 1 / np.maximum(errors / VEIL_NOISE, 1)
    return weights


def _actor(sprite: Sprite, body: Body, loose: bool, top: bool) -> ShadowBody:
    """Return the properties of a sprite's body for shadows."""
    if loose:
        return ShadowBody(None, STAGING.thread)
    ball = body.solid is Solid.SPHERE and sprite.coverage.max(initial=0) >= 1
    ball &= top or not _is_lump(sprite, body)
    return ShadowBody(body.radius if ball else None, thickness(body, top))


def _add_front_face(
    sprite: Sprite, body: Body, light: DistantLight, has_pages: bool
) -> Sprite:
    """Return the sprite with its `face`: the height of its picture below its shape.

    It counts only if the picture also reaches as far above the shape. A block with a
    visible top also gets its `sides`; one that may have pages (`has_pages`), the
    photo's.
    """
    is_solid = sprite.coverage >= 0.5
    rows = np.flatnonzero(is_solid.any(axis=1))
    if body.radius is not None or not len(rows):
        return sprite
    shape = np.concatenate(body.rings)[:, 1] + body.center[1] - sprite.corner[1]
    face = float(min(shape.min() - rows[0], rows[-1] - shape.max())) + 0.5
    if face < STAGING.seen_top:
        return sprite
    # The top of a block is the band of its picture above the front.
    first = float(rows[0] - 0.5 + 2 * face)
    is_above = np.arange(len(is_solid)) < first - 0.5
    top = (sprite.coverage >= 1) & is_above[:, None]
    has_four_corners = len(body.rings) == 1 and len(body.rings[0]) == 4
    top_rows = is_solid.argmax(axis=0)[is_solid.any(axis=0)]
    is_level = np.ptp(np.percentile(top_rows, (25, 75))) <= CUT.flat
    if not (has_four_corners and top.any() and is_level):
        return replace(sprite, face=face)
    colour = np.median(sprite.light[top], axis=0)
    depth = STAGING.back * 2 * face
    columns = _columns(sprite, body)
    pages = None
    if has_pages:
        pages = top_of_book(sprite.light, sprite.coverage, first, columns, light)
    if pages is not None:
        first = pages.edge
        depth = max(2 * face, first - rows[0])
        colour = _cover_colour(sprite, first, columns)
    sides = Sides(first, depth, colour, light, pages)
    return replace(sprite, face=face, sides=sides)


def _columns(sprite: Sprite, body: Body) -> tuple[int, int]:
    """Return the first and the last column of a body's shape, px of its sprite."""
    x = np.concatenate(body.rings)[:, 0] + body.center[0] - sprite.corner[0]
    return max(round(x.min()), 0), min(round(x.max()), sprite.coverage.shape[1] - 1)


def _cover_colour(sprite: Sprite, first: float, columns: tuple[int, int]) -> F32:
    """Return the linear light (3,) of a book's covers above the first row of
    its front.
    """
    band = np.zeros_like(sprite.coverage, np.bool_)
    left, right = columns
    width = max(round(TOPS.cover * (right - left)), 1)
    for start in (left, right + 1 - width):
        band[: ceil(first), start : start + width] = True
    is_cover = band & (sprite.coverage >= 1)
    if not is_cover.any():
        is_cover = sprite.coverage >= 1
    return np.asarray(np.median(sprite.light[is_cover], axis=0), np.float32)


def _is_lump(sprite: Sprite, body: Body) -> bool:
    """Check whether a rolling object reaches beyond its circle on many sides.

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
    """Separate a ball from a thread or a handle on it, which turns as a picture.

    The second value of a pair is True for a thread. Parts up to `lumpiness` radii
    beyond the circle belong to the ball.
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
    # The thread is beneath the ball and reaches a pixel farther inwards, so that no gap
    # is visible between both.
    rim = 1 if has_thread else 2
    ball_share = np.clip(body.radius + rim - distance, 0, 1).astype(np.float32)
    ball = _mask_sprite(sprite, ball_share)
    if not has_thread:
        return [(ball, False)]
    thread_share = np.clip(distance - body.radius + 1, 0, 1).astype(np.float32)
    return [(_mask_sprite(sprite, thread_share), True), (ball, False)]


def _mask_sprite(sprite: Sprite, share: F32) -> Sprite:
    """Return the sprite with a share (h, w) of its light and coverage."""
    light = sprite.light * share[..., None]
    return replace(sprite, light=light, coverage=sprite.coverage * share)


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
        is_painted=is_billiard_ball(label),
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


def _add_relief(sprite: Sprite, normals: F32, light: DistantLight) -> Sprite:
    """Add the relief of the photo's `normals` (H, W, 3) to a sprite that is not
    a ball.
    """
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
    is_known = np.zeros((h, w), bool)
    is_known[box] = sprite.coverage[box] > 0.7
    return replace(sprite, relief=relief_of(own_normals, is_known, light))


def _edged(sprite: Sprite, light: DistantLight) -> Sprite:
    """Add rounded edges to a sprite if the photo shows light on them.

    A change of light on rings inside the outline that one direction of light explains
    stays as the object turns; any other change is paint.
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
    edge_gain, cross_gain = gain_x * x + gain_y * y, gain_x * y - gain_y * x
    # If the outline is wrong by a pixel, the photo shows no such edge: half of the
    # expected light counts in full, a quarter not at all.
    has_light = np.abs(edge_gain) > STAGING.faint
    visible_share = np.divide(edge, edge_gain, out=np.ones_like(edge), where=has_light)
    strength = np.clip(4 * visible_share - 1, 0, 1)
    return replace(
        sprite, relief=_edge_relief(edge_gain * strength, cross_gain * strength)
    )


def _outward_normals(solid: U8) -> F32:
    """Return the outward unit vectors (h, w, 2) of a shape, right and down."""
    blurred_shape = cv2.GaussianBlur(solid.astype(np.float32), (0, 0), CUT.clean)
    x = -cv2.Sobel(blurred_shape, cv2.CV_32F, 1, 0)
    y = -cv2.Sobel(blurred_shape, cv2.CV_32F, 0, 1)
    length = np.maximum(np.hypot(x, y), 1e-6)[..., None]
    return np.asarray(np.stack([x, y], axis=2) / length, np.float32)


def _edge_light(sprite: Sprite, depth: F32) -> F32:
    """Return the light of a sprite relative to its face nearby, minus 1, (h, w)."""
    brightness = sprite.light.mean(axis=2)
    inner = (depth > CUT.rim).astype(np.float32)
    face_light = cv2.GaussianBlur(brightness * inner, (0, 0), CUT.along)
    weight = cv2.GaussianBlur(inner, (0, 0), CUT.along)
    face_light, weight = np.maximum(face_light, 1e-4), np.maximum(weight, 1e-4)
    return np.asarray(brightness * weight / face_light - 1, np.float32)


def _edge_gain(
    normal: F32, edge: F32, depth: F32, solid: Mask, light: DistantLight
) -> F32 | None:
    """Return the gain of light (h, w, 2) at edges by their normals.

    None without an edge, or for a completely round shape.
    """
    gain = np.zeros_like(normal)
    rings = np.maximum(np.ceil(depth), 1)
    toward_light = np.array(light.direction[:2])
    sun = light.direction[:2] / np.maximum(np.hypot(*light.direction[:2]), 1e-6)
    strengths = [0.0] * CUT.rim
    # Regress the light of each ring on its normals: a slope towards the light is
    # shading.
    for number in range(1, CUT.rim + 1):
        ring = (rings == number) & solid
        directions = normal[ring] - normal[ring].mean(axis=0)
        change = edge[ring] - edge[ring].mean()
        slope = np.linalg.lstsq(directions, change)[0]
        explained_sum = ((directions @ slope) ** 2).sum()
        is_light = explained_sum > STAGING.edged * (change**2).sum()
        if is_light and slope @ toward_light > 0:
            strength = min(float(np.hypot(*slope)), STAGING.lit)
            direction = slope / np.hypot(*slope) + STAGING.sun * sun
            gain[rings == number] = strength * direction / np.hypot(*direction)
            strengths[number - 1] = strength
    if max(strengths) <= 2 * strengths[-1]:
        return None
    return gain


def _edge_relief(toward: F32, across: F32) -> Relief:
    """Return the relief of light that changes by `toward`, and by `across` a quarter
    turn on.
    """
    model = np.maximum(1 + toward, 1 / MOST_RELIGHTING)
    unit_gain, zeros = np.ones_like(toward), np.zeros_like(toward)
    return Relief(
        along=np.asarray(toward / model, np.float32),
        across=np.asarray(across / model, np.float32),
        fixed=np.asarray(unit_gain / model, np.float32),
        even=np.asarray(zeros / model, np.float32),
    )


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


def _turned_disc(sprite: Sprite, body: Body) -> Sprite:
    """Return a turning disc in the top view with light from a fixed direction.

    On completely visible rings, a small change of light around the axis is light; a
    larger one is paint.
    """
    if body.radius is None or body.solid is Solid.SPHERE:
        return sprite
    rows, columns = np.indices(sprite.coverage.shape)
    x = columns + sprite.corner[0] - body.center[0]
    y = rows + sprite.corner[1] - body.center[1]
    distance = np.maximum(np.hypot(x, y), 1.0)
    cosine, sine = x / distance, y / distance
    # Light does not turn with a disc, paint does. Fit the first harmonic of the
    # brightness on each ring of 1 px: a + b cos(angle) + c sin(angle).
    rings = np.minimum(distance, max(body.radius - 2, 0)).astype(int)
    is_known = (sprite.coverage >= 1) & (distance < body.radius)
    brightness = sprite.turning_light.mean(axis=2)
    sums = []
    for term in (np.ones_like(cosine), 2 * cosine, 2 * sine):
        sums.append(
            np.bincount(rings[is_known], (brightness * term)[is_known], rings.max() + 1)
        )
    counts = np.bincount(rings[is_known], minlength=rings.max() + 1)
    counts = np.maximum(counts, 1)
    # A partly hidden ring has no reliable harmonic.
    circumferences = np.pi * (2 * np.arange(len(counts)) + 1)
    is_visible = counts > STAGING.around * circumferences
    is_even = np.hypot(*sums[1:]) < STAGING.uneven * sums[0]
    is_light = is_visible & is_even
    sums = [sums[0], sums[1] * is_light, sums[2] * is_light]
    means = []
    # Smooth across rings, since a single ring has few pixels.
    for term in sums:
        smooth_means = cv2.GaussianBlur(term / counts, (0, 0), 1.0).ravel()
        means.append(smooth_means[rings])
    mean_light = np.maximum(means[0], CUT.dark)
    light_part = (means[1] * cosine + means[2] * sine) / mean_light
    cross_part = (means[1] * sine - means[2] * cosine) / mean_light
    return replace(sprite, relief=_edge_relief(light_part, cross_part))
