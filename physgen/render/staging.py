"""From scene, world and photo to a Stage: sprites with light and shadows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, radians, tan

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, U16, Mask
from physgen.compile.world import Body, World
from physgen.geometry.polygon import Array
from physgen.geometry.shadows import ShadowSetting, Silhouette
from physgen.maps import U8, Percepts
from physgen.materials import (
    is_book,
    is_open_vessel,
    is_shallow_vessel,
)
from physgen.photometry import DistantLight, decode
from physgen.render.ball_parts import is_lump, split_balls
from physgen.render.box_faces import with_closed_faces
from physgen.render.contact_shade import contact_depth
from physgen.render.contact_shades import add_contact_shades
from physgen.render.floor_mirror import floor_mirror
from physgen.render.floors import floors, shadows_pass_below
from physgen.render.front_faces import add_front_face
from physgen.render.halo_split import split_halos
from physgen.render.occlusion import (
    silhouette,
)
from physgen.render.relighting import relight_sprites
from physgen.render.shadow_decomposition import LitBackground, decompose_shadows
from physgen.render.smooth_outlines import smooth_outline
from physgen.render.soft_rims import continue_soft_rims
from physgen.render.sprites import (
    Sprite,
    anchor_sprites,
)
from physgen.render.stage import ShadowBody, Stage
from physgen.render.vehicle_wheels import add_photo_wheels
from physgen.render.veils import measure_veils
from physgen.render.vessels import (
    SHALLOW_VESSEL,
    VESSEL,
    VesselTuning,
    open_vessel,
    with_room_for_opening,
)
from physgen.scene.scene import Scene, Solid, View


@dataclass(frozen=True)
class StagingTuning:
    """Assumed depths of objects, and limits of their shadows."""

    disc_height: float = 0.8
    """Height of a disc above a table, radii, if the scene does not state it."""
    thickness: float = 0.9
    """Thickness of other objects, in roots of their areas."""
    ghost_count: int = 200
    """Approximate number of the largest left-out objects with removed shadows."""
    box_share: float = 0.9
    """Share of its bounding box that a block fills."""
    thread_thickness: float = 2.0
    """Thickness of a thread on a ball, px."""
    light_width: float = 40.0
    """Half the width of a light, degrees, from which geometry predicts no dark contact
    strip, as that of ambient shade.
    """


STAGING = StagingTuning()


@dataclass(frozen=True)
class _PhotoScene:
    """A scene and its photo: the inputs of all steps of `lit_stage`."""

    scene: Scene
    world: World
    maps: Percepts
    background: U8
    """Photo without objects, but with their shadows, (H, W, 3) sRGB."""
    coverage: F32
    """Coverage (H, W) of all objects, also of `absent` ones."""
    absent: Mask
    labels: U16
    """Ids (H, W): id k + 1 is body k."""


@dataclass(frozen=True)
class _ShadowCasters:
    """Sprites and their properties for shadows, in the order of drawing."""

    sprites: Sequence[Sprite]
    actors: Sequence[ShadowBody]
    starts: Sequence[Silhouette]
    """Silhouettes in the photo."""
    rounds: Sequence[bool]
    """Whether rotation does not change the shadow."""
    floors: Sequence[Array]
    """Floors, as `floors`, under the photo's shadows."""


@dataclass(frozen=True)
class _Plates:
    """Backgrounds of a photo, sRGB."""

    background: U8
    """The photo without objects, with or without their mirror images."""
    clean: U8 | None
    """The background without shadows; None if they were not removed."""
    has_mirror_images: bool
    """Whether only mirror images were removed from the background."""

    @property
    def halo_reach(self) -> float | None:
        """Return the reach of halos for `anchor_sprites`: mirror images stay in them."""
        return 1.0 if self.has_mirror_images else None


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
    # The order is fixed: shapes first, then their shadows, and light on sprites at
    # last, since veils and reflections depend on all shapes.
    source = _PhotoScene(scene, world, maps, background, coverage, absent, labels)
    sprites = _complete_sprites(source, sprites)
    if scene.render.smooth_outlines:
        sprites = _with_smooth_outlines(world, sprites)
    if scene.light is None:
        sprites = _with_vessels(open_vessel, source, sprites)
        return _stage_without_shadows(source, sprites, background)
    setting = _shadow_setting(scene, world)
    casters = _find_casters(source, sprites, setting)
    plates = _select_plates(maps, background)
    veils: Sequence[F32 | None] = [None] * len(casters.sprites)
    if scene.render.shadows and plates.clean is not None:
        # A clean picture exists, so shadows of this light are visible in the photo.
        actors, veils = measure_veils(
            casters.sprites, casters.actors, casters.starts, setting
        )
        casters = replace(casters, actors=actors)
    sprites = _light_sprites(source, casters, veils, setting)
    if not scene.render.shadows:
        return _stage_without_shadows(source, sprites, plates.background)
    casters = replace(casters, sprites=sprites)
    return _stage_with_shadows(source, casters, plates, veils, setting)


def _complete_sprites(
    source: _PhotoScene, sprites: Sequence[Sprite]
) -> Sequence[Sprite]:
    """Return the sprites with wheels, room for openings and whole faces of boxes."""
    world = source.world
    sprites = [add_photo_wheels(sprite, world) for sprite in sprites]
    sprites = _with_vessels(with_room_for_opening, source, sprites)
    if world.view is View.TOP:
        return sprites
    return _with_closed_faces(world, sprites, source.labels)


def _with_smooth_outlines(world: World, sprites: Sequence[Sprite]) -> list[Sprite]:
    """Return the sprites with smooth outlines; discs look the same at any rotation."""
    result = []
    for sprite in sprites:
        if world.bodies[sprite.body].radius is None:
            sprite = smooth_outline(sprite)
        result.append(sprite)
    return result


def _stage_without_shadows(
    source: _PhotoScene, sprites: Sequence[Sprite], background: U8
) -> Stage:
    """Create a stage whose shadows stay in the background."""
    photo = decode(source.maps.rgb)
    sprites = anchor_sprites(sprites, photo, decode(background), source.absent)
    return Stage(background, sprites)


def _find_casters(
    source: _PhotoScene, sprites: Sequence[Sprite], setting: ShadowSetting
) -> _ShadowCasters:
    """Split balls from their threads, and find the silhouettes of all parts."""
    world = source.world
    shadow_floors = _shadow_floors(world, source.maps, setting)
    parts = split_balls(source.scene, world, sprites)
    actors, starts, rounds = [], [], []
    for sprite, is_thread in parts:
        body = world.bodies[sprite.body]
        actor = _create_actor(sprite, body, is_thread, setting.top)
        start = silhouette(
            shadow_floors,
            sprite.coverage,
            sprite.corner,
            body.center,
            actor,
            setting.tilt,
        )
        actors.append(actor)
        starts.append(start)
        rounds.append(body.radius is not None and not is_thread)
    return _ShadowCasters(
        [sprite for sprite, _ in parts], actors, starts, rounds, shadow_floors
    )


def _select_plates(maps: Percepts, background: U8) -> _Plates:
    """Return the backgrounds with and without shadows."""
    if maps.clean is not None and _has_mirrors_alone(maps):
        # The difference consists of no shadows, and stays in the halos.
        return _Plates(maps.clean, None, has_mirror_images=True)
    return _Plates(background, maps.clean, has_mirror_images=False)


def _light_sprites(
    source: _PhotoScene,
    casters: _ShadowCasters,
    veils: Sequence[F32 | None],
    setting: ShadowSetting,
) -> Sequence[Sprite]:
    """Return the sprites with open vessels, front faces, and skins or reliefs."""
    scene, world = source.scene, source.world
    # Shadows in the photo are those of vessels with their lids on: open them only now.
    sprites = _with_vessels(open_vessel, source, casters.sprites)
    if not setting.top:
        sprites = _with_front_faces(scene, world, sprites, setting.light)
    if not scene.render.relight:
        return sprites
    return relight_sprites(
        scene, world, sprites, casters.actors, veils, source.maps.normals, setting.light
    )


def _with_front_faces(
    scene: Scene, world: World, sprites: Sequence[Sprite], light: DistantLight
) -> list[Sprite]:
    """Return the sprites with their front faces as in `add_front_face`."""
    result = []
    for sprite in sprites:
        body = world.bodies[sprite.body]
        has_pages = is_book(scene.objects[sprite.body].label)
        result.append(add_front_face(sprite, body, light, has_pages))
    return result


def _stage_with_shadows(
    source: _PhotoScene,
    casters: _ShadowCasters,
    plates: _Plates,
    veils: Sequence[F32 | None],
    setting: ShadowSetting,
) -> Stage:
    """Create a stage with moving shadows and reflections."""
    sprites, starts = casters.sprites, casters.starts
    lit_background, ghost_shadows = _separate_shadows(source, casters, plates, setting)
    photo = decode(source.maps.rgb)
    if ghost_shadows is not None:
        # Remove the shadows of left-out objects from the photo, too.
        shadows = np.where(source.coverage < 0.5, ghost_shadows, 0)
        photo = photo * np.exp(shadows)[..., None].astype(np.float32)
    behind = lit_background.photo_background()
    mirror = None
    if not setting.top:
        mirror = floor_mirror(
            sprites, starts, photo - behind, source.coverage, setting.tilt
        )
    sprites = anchor_sprites(
        sprites,
        photo,
        behind,
        source.absent,
        lit_background.owner,
        plates.halo_reach,
    )
    if not setting.top and mirror is None and _has_loose_shade(plates, setting):
        sprites = split_halos(
            sprites,
            starts,
            setting.tilt,
            behind,
            is_mirror=plates.has_mirror_images,
            plate=None if plates.clean is None else lit_background.plate,
        )
    if not setting.top and plates.clean is not None:
        lit_background = add_contact_shades(lit_background, sprites)
    return Stage(
        plates.background,
        continue_soft_rims(sprites, behind),
        lit_background,
        casters.actors,
        casters.floors,
        None if plates.clean is None else veils,
        mirror=mirror,
        contact_depth=contact_depth(source.scene),
    )


def _separate_shadows(
    source: _PhotoScene,
    casters: _ShadowCasters,
    plates: _Plates,
    setting: ShadowSetting,
) -> tuple[LitBackground, F32 | None]:
    """Separate the background into light and shadows.

    Also returns the darkness (H, W), -log of light, of left-out objects' shadows, if
    there are any.
    """
    ghosts = _ghosts(
        source.maps.labels, source.absent, source.coverage, casters.floors, setting
    )
    difference = cv2.absdiff(source.maps.rgb, plates.background)
    is_equal = cv2.inRange(difference, (0, 0, 0), (0, 0, 0)) > 0
    is_changed = ~is_equal & (source.coverage == 0)
    return decompose_shadows(
        plates.background,
        plates.clean,
        source.coverage,
        casters.starts,
        casters.rounds,
        setting,
        ghosts,
        is_changed,
    )


def _has_loose_shade(plates: _Plates, setting: ShadowSetting) -> bool:
    """Check whether the photo may have shade at contacts that geometry does not
    predict.
    """
    is_wide = setting.softness >= STAGING.light_width
    return plates.clean is None or is_wide or setting.light.is_soft


def _has_mirrors_alone(maps: Percepts) -> bool:
    """Check whether the clean background lacks mirror images, but no shadows.

    A map of shadows without any id says so; without a map, nothing is known.
    """
    return (
        maps.clean is not None and maps.shadows is not None and not maps.shadows.any()
    )


def _with_vessels(
    change: Callable[[Sprite, Body, U16, float, Sequence[int], VesselTuning], Sprite],
    source: _PhotoScene,
    sprites: Sequence[Sprite],
) -> list[Sprite]:
    """Return the sprites; those of vessels that may be open are changed by `change`."""
    scene, world = source.scene, source.world
    tilt = tan(radians(scene.world.tilt))
    result = []
    for k, sprite in enumerate(sprites):
        if _may_be_open(scene, world, sprite):
            # Only objects that are drawn later are nearer and may hide an opening.
            nearer_bodies = _bodies(sprites[k:])
            body = world.bodies[sprite.body]
            tuning = VESSEL
            if is_shallow_vessel(scene.objects[sprite.body].label):
                tuning = SHALLOW_VESSEL
            sprite = change(sprite, body, source.labels, tilt, nearer_bodies, tuning)
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
    return [
        ground
        for ground in grounds
        if not shadows_pass_below(ground, maps.labels, shadows)
    ]


def _ghosts(
    labels: U16,
    absent: Mask,
    coverage: F32,
    grounds: Sequence[Array],
    setting: ShadowSetting,
) -> list[Silhouette]:
    """Return the silhouettes of the largest objects that the scene leaves out."""
    ghosts = []
    for id_, rows, columns in _largest_absent_objects(labels, absent):
        x0, y0 = int(columns.min()), int(rows.min())
        box = np.s_[y0 : rows.max() + 1, x0 : columns.max() + 1]
        own_coverage = np.where(labels[box] == id_, coverage[box], 0)
        actor = ShadowBody(None, _ghost_thickness(len(rows), setting.top))
        ghost = silhouette(
            grounds,
            own_coverage.astype(np.float32),
            (x0, y0),
            np.array([columns.mean(), rows.mean()]),
            actor,
            setting.tilt,
        )
        ghosts.append(ghost)
    return ghosts


def _largest_absent_objects(
    labels: U16, absent: Mask
) -> Iterator[tuple[int, NDArray[np.int64], NDArray[np.int64]]]:
    """Yield the id, the rows and the columns of about `STAGING.ghost_count` objects."""
    rows, columns = np.nonzero(absent)
    absent_ids = labels[absent]
    # Group the pixels of each object by one sort, instead of a search per object.
    order = np.argsort(absent_ids, kind="stable")
    ids, counts = np.unique(absent_ids, return_counts=True)
    smallest_count = np.sort(counts)[-STAGING.ghost_count :].min(initial=0)
    groups = np.split(order, np.cumsum(counts)[:-1])
    for id_, pixels in zip(ids.tolist(), groups, strict=False):
        if len(pixels) >= smallest_count:
            yield id_, rows[pixels], columns[pixels]


def _ghost_thickness(area: int, is_top: bool) -> float:
    """Return the assumed thickness of a left-out object, px."""
    return STAGING.thickness * float(np.sqrt(area)) * (0.6 if is_top else 1.0)


def thickness(body: Body, top: bool) -> float:
    """Return the thickness of a body above the table, or across the plane of motion,
    px.

    It is about the width, unless the scene states it.
    """
    if body.radius is not None:
        if body.solid is Solid.SPHERE or not top:
            return 2 * body.radius
        return STAGING.disc_height * body.radius
    # The photo has no depth of a body. The geometric mean of its sides is a guess for
    # its third side.
    points = np.concatenate(body.pieces)
    width, height = np.ptp(points, axis=0).tolist()
    depth = STAGING.thickness * np.sqrt(width * height) * (0.6 if top else 1.0)
    # An upright object other than a box is probably a solid of revolution.
    box_width, box_height = cv2.minAreaRect(points.astype(np.float32))[1]
    area = sum(cv2.contourArea(piece.astype(np.float32)) for piece in body.pieces)
    is_box = area > STAGING.box_share * box_width * box_height
    if top or is_box:
        return float(depth)
    return float(min(depth, width))


def _create_actor(sprite: Sprite, body: Body, is_thread: bool, top: bool) -> ShadowBody:
    """Return the properties of a sprite's body for shadows."""
    if is_thread:
        return ShadowBody(None, STAGING.thread_thickness)
    ball = body.solid is Solid.SPHERE and sprite.coverage.max(initial=0) >= 1
    ball &= top or not is_lump(sprite, body)
    return ShadowBody(body.radius if ball else None, thickness(body, top))
