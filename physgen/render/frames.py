"""Composition of frames, one at a time, from a stage and a trajectory.

Sprites are blended and warped in linear light. Only the tiles of 32 px that objects or
their shadows touch are composed and encoded again. The other tiles come from a stored
background in the light of the objects that have not moved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise
from math import ceil, hypot

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64, U8, U16
from physgen.geometry.polygon import rotation
from physgen.geometry.shadows import Silhouette
from physgen.photometry import decode, encode_u8
from physgen.render.atlas import BallSprites, ShadowSprites
from physgen.render.contact_shade import ContactShade, multiply_light
from physgen.render.floor_contacts import floor_contact_shades
from physgen.render.occlusion import (
    add_shadow,
    occlusion_factors,
    relit_border,
    sprite_silhouette,
)
from physgen.render.shadow_decomposition import (
    ContactShadow,
    LitBackground,
    shaded_background,
)
from physgen.render.sprites import CUT, Sides
from physgen.render.squash import squash_picture
from physgen.render.stage import (
    Cover,
    Frame,
    Layers,
    Placement,
    Slices,
    SpriteLayer,
    SpritePose,
    Stage,
    borders_left,
    draw_border,
    draw_foot_halo,
    draw_halo,
    draw_sprite,
    enlarged_poses,
    halos_left,
    place_sprite,
    sprite_coverage,
    sprite_poses,
    three_channels,
)
from physgen.simulate.trajectory import Trajectory


def encode_picture(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the sRGB codes (h, w, 3) of linear light (h, w, 3), rounded to the
    nearest.

    The bytes are those of the slower `encode_u8`.
    """
    index = np.clip(linear, 0, 1)
    index *= np.float32(65535)
    index += np.float32(0.5)
    take_codes, table = _table()
    return np.asarray(take_codes(index.astype(np.uint16), table), np.uint8)


@cache
def _table() -> tuple[Callable[..., object], NDArray[np.uint8]]:
    """Return a function to look codes up, and the codes (65536,) of 16-bit light."""
    table = encode_u8(np.arange(65536, dtype=np.float32) / np.float32(65535))
    try:
        cv2.LUT(np.zeros((1, 1, 3), np.uint16), table)
    except cv2.error:  # before OpenCV 5
        return (lambda index, table: table.take(index)), table
    return cv2.LUT, table


TILE = 32
"""px: side of the square tiles by which touched pixels are counted."""


def touched_tiles(boxes: Sequence[Slices], size: tuple[int, int]) -> list[int]:
    """Return the tiles that boxes touch, as one number per row of tiles, one bit per
    tile.
    """
    tiles = [0] * (-(-size[1] // TILE))
    for rows, columns in boxes:
        if rows.stop <= rows.start or columns.stop <= columns.start:
            continue
        # Bits from `first` to `last` in one number: union of boxes is a bitwise or.
        first, last = columns.start // TILE, (columns.stop - 1) // TILE
        bits = (1 << (last + 1)) - (1 << first)
        for row in range(rows.start // TILE, (rows.stop - 1) // TILE + 1):
            tiles[row] |= bits
    return tiles


def boxes_of_tiles(tiles: Sequence[int], size: tuple[int, int]) -> list[Slices]:
    """Return disjoint boxes that cover `tiles`, as `touched_tiles` returns them."""
    boxes: list[Slices] = []
    first_rows: dict[tuple[int, int], int] = {}
    # A box grows down while the next row has the same run of tiles. An empty row at the
    # end closes the last boxes.
    for row, bits in enumerate([*tiles, 0]):
        runs = _runs_of_bits(bits)
        for first, last in [run for run in first_rows if run not in runs]:
            top = first_rows.pop((first, last))
            rows = slice(top * TILE, min(row * TILE, size[1]))
            boxes.append((rows, slice(first * TILE, min(last * TILE, size[0]))))
        for run in runs:
            first_rows.setdefault(run, row)
    return boxes


def _runs_of_bits(bits: int) -> list[tuple[int, int]]:
    """Return the index of the first bit of each run of set bits, and that after its
    last.
    """
    runs = []
    while bits:
        # bits & -bits isolates the lowest set bit.
        first = (bits & -bits).bit_length() - 1
        # The lowest zero bit ends the run.
        remaining_bits = bits >> first
        length = (~remaining_bits & (remaining_bits + 1)).bit_length() - 1
        runs.append((first, first + length))
        bits &= ~(((1 << length) - 1) << first)
    return runs


class BackgroundCache:
    """The background without the shadows of moved objects, kept from frame to frame.

    It depends on the moved objects alone, to the last bit, and not on the frames
    before.
    """

    def __init__(self, stage: Stage) -> None:
        self._lit = stage.lit_background
        self._moved: set[int] = set()
        self.dark: F32 | None = None
        """Darkness (H, W) of its shadows: -log of the remaining share of light."""
        if stage.lit_background is None:
            light = decode(stage.background)
        else:
            light = stage.lit_background.photo_background()
            self.dark = stage.lit_background.total.copy()
        self.light: F32 = light
        """(H, W, 3) linear."""
        self.codes = encode_picture(self.light)
        """(H, W, 3) sRGB."""

    def update(self, stands: Sequence[SpritePose]) -> list[Slices]:
        """Update the background for objects at new poses; return the boxes of the
        changes.
        """
        background, darkness = self._lit, self.dark
        if background is None or darkness is None:
            return []
        shadows = {}
        for stand in stands:
            shadow = background.casts[stand.k].picture
            if stand.start != stand.pose and shadow is not None:
                shadows[stand.k] = shadow
        moved_objects = set(shadows)
        if moved_objects == self._moved:
            return []
        # Only objects that began or ceased to move change the background (the symmetric
        # difference of both sets).
        boxes = self._shadow_boxes(moved_objects ^ self._moved)
        self._moved = moved_objects
        for box in boxes:
            # Restore the darkness of all objects at rest first. The remaining shadows
            # are then subtracted from exact values, and rounding errors do not add up
            # over frames.
            darkness[box] = background.total[box]
        # Subtract in the order of objects, so that rounding is the same in every frame.
        for k in sorted(moved_objects):
            for box in boxes:
                _take(darkness, box, *shadows[k])
        for box in boxes:
            self.light[box] = shaded_background(
                background.plate[box], darkness[box], background.tint
            )
            self.codes[box] = encode_picture(self.light[box])
        return boxes

    def _shadow_boxes(self, objects: set[int]) -> list[Slices]:
        """Return boxes of the tiles that the shadows of `objects` touch."""
        assert self._lit is not None
        boxes = []
        for k in objects:
            shadow = self._lit.casts[k].picture
            if shadow is not None:
                x0, y0, x1, y1 = shadow[0]
                boxes.append(np.s_[y0:y1, x0:x1])
        height, width = self.light.shape[:2]
        return boxes_of_tiles(touched_tiles(boxes, (width, height)), (width, height))


def _take(
    darkness: F32, box: Slices, shadow_box: tuple[int, int, int, int], shadow: F32
) -> None:
    """Subtract the part of a shadow inside a box from `darkness` (H, W)."""
    left, top, right, bottom = shadow_box
    x0, y0 = max(box[1].start, left), max(box[0].start, top)
    x1, y1 = min(box[1].stop, right), min(box[0].stop, bottom)
    if x0 < x1 and y0 < y1:
        darkness[y0:y1, x0:x1] -= shadow[y0 - top : y1 - top, x0 - left : x1 - left]


@contextmanager
def single_threaded() -> Iterator[None]:
    """Limit OpenCV to one thread, for a while.

    This takes a third less CPU time, and leaves the other core to the encoder.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


@dataclass
class Picture:
    """The appearance of one sprite in a frame."""

    stand: SpritePose
    placement: Placement
    light: F32
    """(h, w, 3) linear, times coverage."""
    coverage: F32
    """(h, w)."""
    rest: tuple[Slices, F32] | None
    """A box and the rest (h, w, 3) of the photo there beyond light and background.

    As bright as the background is.
    """
    factor: F32 | None = None
    """(h, w) by which `light` was multiplied for the shadows of others."""
    is_flat: bool = False
    """Whether an impact has flattened it, so that it is not as its placement draws it."""


@dataclass(frozen=True)
class ExposureTuning:
    """The fineness of an exposure."""

    sharp: float = 0.5
    """px: largest motion that an exposure leaves sharp."""
    step: float = 2.0
    """px: largest motion of a point between two pictures of an object."""
    shadow: float = 8.0
    """px: the same for the softer shadow."""
    shadows: int = 4
    """Largest number of shadows of an object in an exposure."""


EXPOSURE = ExposureTuning()
GREEN = 1
"""Channel that stands for the brightness of shade."""
LEAST_FACTOR = np.float32(1e-3)
"""Smallest share of light with a finite darkness."""


def render_frames(
    stage: Stage,
    trajectory: Trajectory,
    order: Sequence[int] | None = None,
    parts: int = 1,
    ways: NDArray[np.float64] | None = None,
) -> Iterator[Frame]:
    """Yield a frame per exposure of the trajectory's samples, in `order` if given.

    An exposure consists of `parts` samples and has the time and the ids of the last.
    Moving objects are smeared along `ways` (T, N, 3), px, px, rad, which differ from
    the trajectory if the camera moves; the result is the mean of light where at most
    one object moves. Frames are independent of each other. The poses in the photo are
    those of sample 0.
    """
    trajectory = settle_motion(trajectory)
    samples = range(len(trajectory.times)) if order is None else order
    ways = trajectory.poses if ways is None else ways
    if parts > 1 and stage.scale != 1.0:
        ways = enlarged_poses(ways, stage.scale)
    with single_threaded():
        painter = _Painter(stage)
        poses = sprite_poses(stage, trajectory, samples[parts - 1 :: parts])
        # Frames are painted in any order, so that only equal looks in a row are shared.
        last_look = None
        for index, (time, stands) in enumerate(poses):
            exposure = list(samples[index * parts : (index + 1) * parts])
            trails = _trails(stage, ways[exposure])
            look = None if trails else _still_look(stage, trajectory, exposure[-1])
            # Objects at rest look as in the last frame, which need not be painted anew.
            if look is None or look != last_look:
                pictures = list(_pictures(stage, painter.balls, stands))
                _flatten(stage, pictures, time)
                rgb = painter.paint(stands, pictures, trails)
                covers = _covers(stage, pictures)
            last_look = look
            yield Frame(
                index,
                time,
                rgb.copy(),
                partial(_draw_ids, covers, painter.size),
                partial(_covering, covers),
                stage.faces,
                None if painter.layers is None else painter.layers.to_layers,
            )


def settle_motion(trajectory: Trajectory) -> Trajectory:
    """Return the trajectory with the last pose for samples in which a body has settled.

    The engine still moves a body at rest by less than anybody can see.
    """
    if not len(trajectory.poses):
        return trajectory
    return replace(
        trajectory,
        poses=_settle(trajectory.poses, SETTLED),
        turns=_settle(trajectory.turns, SETTLED[2]),
        wheel_turns=_settle(trajectory.wheel_turns[..., None], SETTLED[2])[..., 0],
    )


def _settle(states: F64, tolerance: F64) -> F64:
    """Return states (T, N, K) with the last one for all within a tolerance of it."""
    if not states.size:
        return states
    is_settled = (np.abs(states - states[-1]) <= tolerance).all(axis=2)
    return np.asarray(np.where(is_settled[..., None], states[-1], states), np.float64)


def _still_look(stage: Stage, trajectory: Trajectory, sample: int) -> object:
    """Return a value that is equal for samples with equal frames, in objects without
    motion blur; None if an impact flattens an object.
    """
    time = float(trajectory.times[sample])
    if stage.squashes is not None and stage.squashes.find(time):
        return None
    states = [trajectory.poses, trajectory.turns, trajectory.wheel_turns]
    return tuple(state[sample].tobytes() for state in states if state.size)


SETTLED = np.array([1e-3, 1e-3, 1e-6])
"""Distance from the last pose, px, px and rad, that is invisible."""


class _LayerList:
    """The layers of one frame in the order of drawing, over a copy of the
    background.
    """

    def __init__(self, stage: Stage, left: BackgroundCache, canvas: F32) -> None:
        self._plate = (
            left.light if stage.lit_background is None else stage.lit_background.plate
        )
        self._shaded = canvas.copy()
        self._order = tuple(dict.fromkeys(sprite.body for sprite in stage.sprites))
        self._sprites: list[SpriteLayer] = []

    def add(self, body: int, box: Slices, light: F32, coverage: F32) -> None:
        """Add a sprite in front of the others."""
        self._sprites.append(SpriteLayer(body, box, light, coverage))

    def to_layers(self) -> Layers:
        """Return the layers, with the sprites in the order of drawing."""
        return Layers(self._plate, self._shaded, self._sprites, self._order)


def _covers(stage: Stage, pictures: Sequence[Picture]) -> list[tuple[int, Slices, F32]]:
    """Return the id, the box and the coverage of each picture."""
    covers = []
    for picture in pictures:
        id_ = stage.sprites[picture.stand.k].body + 1
        covers.append((id_, picture.placement.box, picture.coverage))
    return covers


class _Painter:
    """A painter of one frame after the other on one canvas.

    It paints only touched tiles again.
    """

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._background = BackgroundCache(stage)
        self._canvas: F32 = self._background.light.copy()
        self._shadows = _Shadows(stage, self._background)
        self._contacts = ContactShade(stage.sprites, stage.contact_depth)
        self.balls = BallSprites(stage.sprites)
        height, width = stage.background.shape[:2]
        self.size = (width, height)
        self._painted_tiles = touched_tiles([], self.size)
        self.layers: _LayerList | None = None
        """The layers of the last frame, if the stage keeps layers."""

    def paint(
        self,
        stands: Sequence[SpritePose],
        pictures: Sequence[Picture],
        trails: Mapping[int, Trail],
    ) -> U8:
        """Return a frame (H, W, 3) in sRGB codes."""
        # The background first, then shadows on it, then halos, and the objects on top.
        background_boxes = self._background.update(stands)
        shaded_tiles = self._shadows.throw(
            self._canvas, stands, pictures, trails, background_boxes
        )
        self._darken_contacts(pictures)
        _add_sides(self._stage, pictures)
        self._restore(background_boxes, shaded_tiles)
        if self._stage.keeps_layers:
            self.layers = _LayerList(self._stage, self._background, self._canvas)
        boxes = boxes_of_tiles(shaded_tiles, self.size)
        boxes += self._paint_surroundings(stands, pictures)
        boxes += self._paint_objects(stands, pictures, trails)
        self._painted_tiles = touched_tiles(boxes, self.size)
        # Encode only touched tiles; the codes of the background serve for all others.
        rgb = self._background.codes.copy()
        for box in boxes_of_tiles(self._painted_tiles, self.size):
            rgb[box] = encode_picture(self._canvas[box])
        return rgb

    def _darken_contacts(self, pictures: Sequence[Picture]) -> None:
        """Darken the pictures where objects have begun to touch each other."""
        parts = {}
        for picture in pictures:
            parts[picture.stand.k] = picture.placement.box, picture.coverage
        factors = self._contacts.factors(parts)
        for picture in pictures:
            factor = factors.get(picture.stand.k)
            if factor is not None:
                picture.light = multiply_light(picture.light, factor)

    def _restore(
        self, background_boxes: Sequence[Slices], shaded_tiles: Sequence[int]
    ) -> None:
        """Restore the background in the last frame's tiles that have no shadow now."""
        changed_tiles = touched_tiles(background_boxes, self.size)
        stale_tiles = []
        tiles = zip(self._painted_tiles, changed_tiles, shaded_tiles, strict=True)
        for old_bits, changed_bits, shaded_bits in tiles:
            stale_tiles.append((old_bits | changed_bits) & ~shaded_bits)
        for box in boxes_of_tiles(stale_tiles, self.size):
            self._canvas[box] = self._background.light[box]

    def _paint_surroundings(
        self, stands: Sequence[SpritePose], pictures: Sequence[Picture]
    ) -> list[Slices]:
        """Paint reflections and halos of objects below the objects; return the changed
        boxes.
        """
        # Reflections and halos lie on the floor: they come before all objects.
        boxes = self._paint_foot_halos(pictures)
        contacts = self._shadows.contacts
        shares = halos_left(self._stage.sprites, stands)
        for picture in pictures:
            reflection = _draw_floor_reflection(self._stage, picture, shares)
            if reflection is not None:
                box, light = reflection
                self._canvas[box] += light
                boxes.append(box)
            sprite = self._stage.sprites[picture.stand.k]
            contact = contacts.get(picture.stand.k)
            contact_share = 0.0 if contact is None else contact.share
            halo = draw_halo(sprite, picture.stand, shares, contact_share)
            if halo is not None:
                self._shadows.add_border(self._canvas, *halo)
                boxes.append(halo[0])
        return boxes

    def _paint_foot_halos(self, pictures: Sequence[Picture]) -> list[Slices]:
        """Paint contact shadows and mirror images that move with their objects; return
        the changed boxes.
        """
        halos = []
        for picture in pictures:
            sprite = self._stage.sprites[picture.stand.k]
            contact = self._shadows.contacts.get(picture.stand.k)
            contact_share = 0.0 if contact is None else contact.share
            halo = draw_foot_halo(sprite, picture.stand, self.size, contact_share)
            if halo is not None:
                halos.append(halo)
        # All shade comes first: it dims the ground, not the light of others.
        boxes = []
        for shadow in self._shadows.contacts.values():
            self._canvas[shadow.box] *= shadow.factor
            boxes.append(shadow.box)
        for box, floor_factor in self._shadows.floor_contacts:
            self._canvas[box] *= floor_factor[..., None]
            boxes.append(box)
        for box, factor, _ in halos:
            self._canvas[box] *= factor
        for box, _, light in halos:
            self._canvas[box] += light
            boxes.append(box)
        return boxes

    def _paint_objects(
        self,
        stands: Sequence[SpritePose],
        pictures: Sequence[Picture],
        trails: Mapping[int, Trail],
    ) -> list[Slices]:
        """Paint the objects from back to front; return the changed boxes."""
        boxes = []
        by_sprite = {picture.stand.k: picture for picture in pictures}
        for stand in stands:
            picture = by_sprite.get(stand.k)
            layer = self._layer(stand, picture, trails.get(stand.k))
            if layer is not None:
                box, light, coverage = layer
                if self.layers is not None:
                    body = self._stage.sprites[stand.k].body
                    self.layers.add(body, box, light, coverage)
                # The painter's algorithm with premultiplied light: canvas * (1 -
                # coverage) + light.
                canvas_part = self._canvas[box]
                cv2.multiply(canvas_part, three_channels(1 - coverage), dst=canvas_part)
                cv2.add(canvas_part, light, dst=canvas_part)
                boxes.append(box)
            # An object at its place in the photo keeps the photo's border pixels,
            # unless it is smeared by its motion.
            is_blurred_photo = stand.k in trails and stand.start == stand.pose
            rest = None if picture is None or is_blurred_photo else picture.rest
            if rest is not None:
                self._shadows.add_border(self._canvas, *rest)
                boxes.append(rest[0])
        return boxes

    def _layer(
        self, stand: SpritePose, picture: Picture | None, trail: Trail | None
    ) -> tuple[Slices, F32, F32] | None:
        """Return the box, light and coverage of an object; None if it is outside the
        canvas.
        """
        if trail is not None:
            return _blur_along_trail(self._stage, self.balls, stand, picture, trail)
        if picture is None:
            return None
        return picture.placement.box, picture.light, picture.coverage


class _Shadows:
    """The shadows on the background and on objects, from frame to frame."""

    def __init__(self, stage: Stage, background: BackgroundCache) -> None:
        self._stage, self._lit, self._background = (
            stage,
            stage.lit_background,
            background,
        )
        self._slides = ShadowSprites(
            [] if stage.lit_background is None else stage.lit_background.casts
        )
        self._dark = None if background.dark is None else background.dark.copy()
        self._shaded: list[Slices] = []
        self.contacts: dict[int, ContactShadow] = {}
        """Shade at the base of each object that rocks in the last frame."""
        self.floor_contacts: list[tuple[Slices, F32]] = []
        """Factors of the floor's light along new contacts in the last frame."""

    def throw(
        self,
        canvas: F32,
        stands: Sequence[SpritePose],
        pictures: Sequence[Picture],
        trails: Mapping[int, Trail],
        background_boxes: list[Slices],
    ) -> list[int]:
        """Shade the background and the pictures; return the tiles that were composed
        again.

        `canvas`: (H, W, 3) linear.
        """
        background, darkness, base_darkness = (
            self._lit,
            self._dark,
            self._background.dark,
        )
        size = (canvas.shape[1], canvas.shape[0])
        if background is None or darkness is None or base_darkness is None:
            return touched_tiles([], size)
        # Reset the darkness only where the last frame had shadows or the background
        # changed.
        for box in self._shaded + background_boxes:
            darkness[box] = base_darkness[box]
        # Silhouettes are those of the drawn pictures: shadow and object then agree.
        figures = _figures(self._stage, pictures)
        self.contacts = _contact_shadows(background, stands, figures)
        self.floor_contacts = floor_contact_shades(
            background, self._stage.contact_depth, stands, figures
        )
        boxes = self._add_shadows(darkness, background, stands, figures, trails)
        shaded_tiles = touched_tiles(boxes, size)
        self._shaded = boxes_of_tiles(shaded_tiles, size)
        for box in self._shaded:
            darkness[box] = background.limit_darkness(darkness[box], box)
            canvas[box] = shaded_background(
                background.plate[box], darkness[box], background.tint
            )
        self._veil(pictures, figures)
        return shaded_tiles

    def _add_shadows(
        self,
        darkness: F32,
        background: LitBackground,
        stands: Sequence[SpritePose],
        figures: Mapping[int, Silhouette],
        trails: Mapping[int, Trail],
    ) -> list[Slices]:
        """Add the shadows of moved objects to `darkness` (H, W); return their boxes."""
        boxes: list[Slices] = []
        exposures = []
        for stand in stands:
            if stand.start == stand.pose:
                continue
            # During an exposure a shadow is the mean of those at several moments, like
            # the object itself.
            exposure = _sample_exposure_poses(trails.get(stand.k, ()), stand)
            exposures += exposure
            # Shadows that only slide are drawn together at the end, from an atlas.
            if background.casts[stand.k].sliding is not None:
                continue
            for moment, weight in exposure:
                figure = figures.get(stand.k)
                if figure is not None and moment is not stand:
                    figure = _moved_figure(figure, stand, moment)
                boxes += add_shadow(darkness, background, moment, figure, weight)
        return boxes + self._slides.add_shadows(darkness, exposures)

    def _veil(
        self, pictures: Sequence[Picture], figures: Mapping[int, Silhouette]
    ) -> None:
        """Darken the pictures by the shadows of other objects."""
        stands = [picture.stand for picture in pictures]
        factors = occlusion_factors(self._stage, stands, figures)
        for picture in pictures:
            factor = factors.get(picture.stand.k)
            if factor is not None:
                picture.factor = factor
                picture.light = picture.light * three_channels(factor)

    def _darkness_with_contacts(self, darkness: F32, box: Slices) -> F32:
        """Return the darkness (h, w) of a box with the shade at bases."""
        result = darkness[box]
        for contact in self.contacts.values():
            overlap = _overlap(box, contact.box)
            if overlap is None:
                continue
            part, contact_part = overlap
            if result.base is not None:
                result = result.copy()
            factor = contact.factor[contact_part][..., GREEN]
            result[part] -= cv2.log(np.maximum(factor, LEAST_FACTOR))
        return result

    def add_border(self, canvas: F32, box: Slices, rest: F32) -> None:
        """Add the photo's light beside an object, (h, w, 3), in the present light."""
        if self._dark is not None and self._lit is not None:
            darkness = self._darkness_with_contacts(self._dark, box)
            rest = relit_border(rest, self._lit, darkness, box)
        canvas[box] += rest


def _contact_shadows(
    background: LitBackground,
    stands: Sequence[SpritePose],
    figures: Mapping[int, Silhouette],
) -> dict[int, ContactShadow]:
    """Return the shade at the base of each object that rocks."""
    contacts = {}
    for stand in stands:
        figure = figures.get(stand.k)
        if stand.start == stand.pose or figure is None:
            continue
        contact = background.contact_shade(stand.k, figure, stand.start, stand.pose)
        if contact is not None:
            contacts[stand.k] = contact
    return contacts


def _moved_figure(
    figure: Silhouette, stand: SpritePose, moment: SpritePose
) -> Silhouette:
    """Return a silhouette at another moment of an exposure, shifted by whole pixels."""
    x, y = moment.pose.x - stand.pose.x, moment.pose.y - stand.pose.y
    (left, top), (cx, cy) = figure.corner, figure.center
    corner = (left + round(x), top + round(y))
    return replace(figure, corner=corner, center=(cx + x, cy + y))


Trail = tuple[tuple[float, float, float], ...]
"""Poses within an exposure, relative to its last: px, px, rad."""


def _trails(stage: Stage, poses: NDArray[np.float64]) -> Mapping[int, Trail]:
    """Return the trail of each sprite in an exposure, in steps too small to see.

    `poses` (parts, N, 3): px, px, rad. Sprites that hardly move have no trail.
    """
    sprites = stage.sprites
    bodies = [sprite.body for sprite in sprites]
    # Displacements count from the last pose, at which the sharp picture is drawn.
    ways = (poses - poses[-1])[:, bodies].swapaxes(0, 1)
    is_ball = [sprite.ball is not None for sprite in sprites]
    ways[is_ball, :, 2] = 0  # The picture of a ball never turns as a whole.
    reach = np.array([max(sprite.coverage.shape) / 2 for sprite in sprites])[:, None]
    x, y, turn = np.moveaxis(np.diff(ways, axis=1), 2, 0)
    # A point at the border of the sprite moves farthest: add the path of its rotation.
    lengths = (np.hypot(x, y) + reach * np.abs(turn)).sum(axis=1)
    trails: dict[int, Trail] = {}
    for k in np.flatnonzero(lengths > EXPOSURE.sharp).tolist():
        steps = ceil(lengths[k] / EXPOSURE.step) + 1
        count = min(len(poses), max(2, steps))
        places = ways[k, _evenly(len(poses), count)]
        trails[k] = tuple(map(tuple, places.tolist()))
    return trails


@cache
def _evenly(length: int, count: int) -> NDArray[np.int64]:
    """Return `count` indices, evenly spaced from the first to the last of a
    sequence.
    """
    return np.rint(np.linspace(0, length - 1, count)).astype(np.int64)


def _sample_exposure_poses(
    trail: Trail, stand: SpritePose
) -> list[tuple[SpritePose, float]]:
    """Return the poses of an object's shadows in an exposure, with weights of sum 1."""
    if not trail:
        return [(stand, 1.0)]
    length = sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(trail))
    count = max(ceil(length / EXPOSURE.shadow), 1)
    count = min(count, EXPOSURE.shadows, len(trail))
    # Split the trail into parts of nearly equal length, and put a shadow at the mean of
    # each.
    poses, end = [], 0
    for k in range(count):
        start = end
        end += len(trail) // count + (k < len(trail) % count)
        part = trail[start:end]
        x = sum(place[0] for place in part) / len(part)
        y = sum(place[1] for place in part) / len(part)
        pose = stand.pose._replace(x=stand.pose.x + x, y=stand.pose.y + y)
        poses.append((replace(stand, pose=pose), len(part) / len(trail)))
    return poses


def _blur_along_trail(
    stage: Stage,
    balls: BallSprites,
    stand: SpritePose,
    picture: Picture | None,
    trail: Trail,
) -> tuple[Slices, F32, F32] | None:
    """Return the means over a trail: a box of the canvas, light (h, w, 3), coverage (h,
    w).

    Return None if the box is empty.
    """
    whole_picture = _draw_unclipped(stage, balls, stand, picture, trail)
    if whole_picture is None:
        return None
    # A picture cut at the border of the canvas would leave a dark trail: draw it whole,
    # as far as the trail reaches.
    corner, light, coverage = whole_picture
    face = stage.sprites[stand.k].face
    center = np.array([stand.pose.x, stand.pose.y + face], np.float64)
    moves = _trail_moves(trail, np.asarray(center - corner, np.float64))
    box = _swept_box(moves, coverage.shape, corner, stage.background.shape[1::-1])
    if box is None:
        return None
    rows, columns = box
    size = (columns.stop - columns.start, rows.stop - rows.start)
    moves[:, :, 2] += corner - (columns.start, rows.start)
    # Warp light and coverage together, as one image of four channels.
    sharp = np.empty((*coverage.shape, 4), np.float32)
    cv2.mixChannels([light, coverage], [sharp], [0, 0, 1, 1, 2, 2, 3, 3])
    total = np.zeros((size[1], size[0], 4), np.float32)
    for move in moves:
        cv2.add(total, cv2.warpAffine(sharp, move, size), dst=total)
    total *= np.float32(1 / len(moves))
    # The conversion keeps the first three channels.
    mean_light = np.asarray(cv2.cvtColor(total, cv2.COLOR_BGRA2BGR), np.float32)
    return box, mean_light, np.asarray(cv2.extractChannel(total, 3), np.float32)


def _trail_moves(trail: Trail, middle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrices (n, 2, 3) that move a picture along a trail.

    The picture turns about `middle` (2,), px.
    """
    shifts = np.array(trail)[:, :2]
    turns = np.array([rotation(angle) for _, _, angle in trail])
    shifts = middle + shifts - turns @ middle
    return np.concatenate([turns, shifts[..., None]], axis=2)


def _swept_box(
    moves: NDArray[np.float64],
    shape: tuple[int, ...],
    corner: NDArray[np.int64],
    size: tuple[int, ...],
) -> Slices | None:
    """Return the box of a canvas of `size` (W, H) that a moving picture sweeps; None if
    empty.
    """
    right, bottom = shape[1] - 1, shape[0] - 1
    corners = np.array(
        [[0, 0, 1], [right, 0, 1], [0, bottom, 1], [right, bottom, 1]], np.float64
    )
    places = corners @ moves.transpose(0, 2, 1) + corner
    # The corners of all positions bound the sweep, clipped to the canvas.
    low = np.maximum(np.floor(places.min(axis=(0, 1))).astype(int), 0)
    high = np.ceil(places.max(axis=(0, 1))).astype(int) + 1
    high = np.minimum(high, size)
    if (low >= high).any():
        return None
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _draw_unclipped(
    stage: Stage,
    balls: BallSprites,
    stand: SpritePose,
    picture: Picture | None,
    trail: Trail,
) -> tuple[NDArray[np.int64], F32, F32] | None:
    """Return an object's picture beyond the canvas, as far as the trail moves it
    inside.

    It is left and top, px, light (h, w, 3) and coverage (h, w); None if it is empty.
    """
    height, width = stage.background.shape[:2]
    if picture is not None and _is_inside(picture.placement.box, (width, height)):
        rows, columns = picture.placement.box
        corner = np.array([columns.start, rows.start])
        return corner, picture.light, picture.coverage
    # Draw on a canvas that is larger by the reach of the trail on each side.
    sprite = stage.sprites[stand.k]
    margin = _trail_reach(trail, sprite.coverage.shape) + 1
    pose = stand.pose._replace(x=stand.pose.x + margin, y=stand.pose.y + margin)
    size = (width + 2 * margin, height + 2 * margin)
    placement = place_sprite(sprite, stand.start, pose, size, stand.space)
    if placement is None:
        return None
    ball = balls.draw([(stand.k, placement)], stage.supersample).get(stand.k)
    light, coverage = ball or draw_sprite(sprite, placement, stage.supersample)
    rows, columns = placement.box
    corner = np.array([columns.start - margin, rows.start - margin])
    if picture is not None and picture.factor is not None:
        shade = _continue_shade(picture, picture.factor, corner, coverage.shape)
        light = light * three_channels(shade)
    return corner, light, coverage


def _is_inside(box: Slices, size: tuple[int, int]) -> bool:
    """Check whether a box touches no border of a canvas of `size` (W, H)."""
    rows, columns = box
    ends_inside = rows.stop < size[1] and columns.stop < size[0]
    return bool(min(rows.start, columns.start) > 0 and ends_inside)


def _continue_shade(
    picture: Picture, factor: F32, corner: NDArray[np.int64], shape: tuple[int, ...]
) -> F32:
    """Return the shade (h, w) of a picture, continued beyond the canvas's border.

    `corner` and `shape` are those of the larger picture.
    """
    rows, columns = picture.placement.box
    # Shade is known on the canvas only. The nearest known value continues it, as shade
    # changes slowly.
    shift_x, shift_y = columns.start - corner[0], rows.start - corner[1]
    move = np.array([[1.0, 0, shift_x], [0, 1, shift_y]])
    border = cv2.BORDER_REPLICATE
    shade = cv2.warpAffine(factor, move, (shape[1], shape[0]), borderMode=border)
    return np.asarray(shade, np.float32)


def _trail_reach(trail: Trail, shape: tuple[int, ...]) -> int:
    """Return the largest displacement of any point of a picture along a trail, px."""
    diagonal = hypot(*shape)
    reaches = [hypot(x, y) + min(abs(turn), 2.0) * diagonal for x, y, turn in trail]
    return ceil(max(reaches))


def _draw_ids(covers: Sequence[tuple[int, Slices, F32]], size: tuple[int, int]) -> U16:
    """Return the ids (H, W) of the nearest objects, given covers from back to front."""
    ids = np.zeros(size[::-1], np.uint16)
    for id_, box, coverage in covers:
        np.copyto(ids[box], np.uint16(id_), where=coverage >= 0.5)
    return ids


def _covering(covers: Sequence[tuple[int, Slices, F32]]) -> list[Cover]:
    """Return the whole mask of each object, as if nothing were in front of it."""
    return [Cover(id_ - 1, box, coverage >= 0.5) for id_, box, coverage in covers]


def _pictures(
    stage: Stage, balls: BallSprites, stands: Sequence[SpritePose]
) -> Iterator[Picture]:
    """Yield the pictures of visible sprites at their poses, from back to front."""
    visible = [
        (stand, stand.placement) for stand in stands if stand.placement is not None
    ]
    placements = [(stand.k, placement) for stand, placement in visible]
    drawn_balls = balls.draw(placements, stage.supersample)
    borders = borders_left(stage.sprites, [stand for stand, _ in visible])
    for (stand, placement), shares in zip(visible, borders, strict=True):
        sprite = stage.sprites[stand.k]
        picture = drawn_balls.get(stand.k)
        if picture is None:
            picture = draw_sprite(sprite, placement, stage.supersample)
        light, coverage = picture
        border = draw_border(sprite, placement, shares)
        yield Picture(stand, placement, light, coverage, border)


def _flatten(stage: Stage, pictures: Sequence[Picture], time: float) -> None:
    """Flatten the soft objects that an impact presses at a time, s."""
    if stage.squashes is None:
        return
    squashes = stage.squashes.find(time)
    if not squashes:
        return
    size = (stage.background.shape[1], stage.background.shape[0])
    for picture in pictures:
        sprite, pose = stage.sprites[picture.stand.k], picture.stand.pose
        squash = squashes.get(sprite.body)
        if squash is None or picture.placement.photo_box is not None:
            continue
        # The impact flattens the object about its centre.
        center = (pose.x, pose.y + sprite.face)
        flat = squash_picture(
            squash.scale_to(stage.scale),
            center,
            picture.placement.box,
            picture.light,
            picture.coverage,
            size,
        )
        if flat is None:
            continue
        box, picture.light, picture.coverage = flat
        picture.placement = replace(picture.placement, box=box)
        # The photo's border pixels fit the round outline alone.
        picture.rest = None
        picture.is_flat = True


def _add_sides(stage: Stage, pictures: Sequence[Picture]) -> None:
    """Add the sides of turned blocks, except behind fronts, which lie in one plane."""
    turned_blocks = []
    for picture in pictures:
        sides = stage.sprites[picture.stand.k].sides
        if sides is not None and sides.share(picture.placement.turn) > 0:
            turned_blocks.append((picture, sides))
    if not turned_blocks:
        return
    # Keep the coverages from before any side is added: sides lie behind all fronts.
    fronts = [
        (picture, picture.placement.box, picture.coverage) for picture in pictures
    ]
    for picture, sides in turned_blocks:
        others = [(box, front) for other, box, front in fronts if other is not picture]
        _add_block_sides(picture, sides, others)


def _add_block_sides(
    picture: Picture, sides: Sides, others: Sequence[tuple[Slices, F32]]
) -> None:
    """Add the sides of a block to its picture.

    `others`: boxes and coverages of the other fronts.
    """
    coverage = picture.coverage
    matrix = picture.placement.matrix
    assert matrix is not None
    side, shade = sides.draw(coverage, picture.placement.turn)
    side, colours = sides.paint(side, shade, matrix, picture.placement.turn)
    # The light of border pixels mixes front and side and is uncertain: give them to the
    # side.
    border_share = np.minimum(2 * side, coverage)
    front_share = np.asarray(1 - border_share / np.maximum(coverage, 1e-3), np.float32)
    light = cv2.multiply(picture.light, three_channels(front_share))
    side, coverage = side + border_share, coverage - border_share
    light_share = np.ones_like(side)
    blur = 2 * round(sides.depth) + 1
    for box, front in others:
        overlap = _overlap(picture.placement.box, box)
        if overlap is None:
            continue
        block_part, other_part = overlap
        front_coverage = front[other_part]
        # Other fronts are in the same plane and hide the side behind them.
        side[block_part] *= 1 - front_coverage
        if sides.light is not None:
            # A front close by keeps light from the side.
            darkness = np.float32(CUT.side_hidden) * cv2.blur(
                front_coverage, (blur, blur)
            )
            light_share[block_part] *= 1 - darkness
    # The composition needs premultiplied light: colour times coverage.
    colours *= (light_share * side)[..., None]
    picture.light = np.asarray(cv2.add(light, colours), np.float32)
    picture.coverage = coverage + side


def _overlap(box: Slices, other: Slices) -> tuple[Slices, Slices] | None:
    """Return the common pixels of two boxes, relative to each box; None without any."""
    (rows, columns), (other_rows, other_columns) = box, other
    top, bottom = max(rows.start, other_rows.start), min(rows.stop, other_rows.stop)
    left = max(columns.start, other_columns.start)
    right = min(columns.stop, other_columns.stop)
    if top >= bottom or left >= right:
        return None
    y, x = rows.start, columns.start
    other_y, other_x = other_rows.start, other_columns.start
    return (
        np.s_[top - y : bottom - y, left - x : right - x],
        np.s_[top - other_y : bottom - other_y, left - other_x : right - other_x],
    )


def _draw_floor_reflection(
    stage: Stage, picture: Picture, shares: F32
) -> tuple[Slices, F32] | None:
    """Return the floor's reflection of a moved object: a box and light (h, w, 3), or
    None.

    It is as strong as the photo's own reflection is gone: `shares` (N + 1,) are the
    parts of it that remain.
    """
    mirror, k, (rows, columns) = stage.mirror, picture.stand.k, picture.placement.box
    if mirror is None or picture.placement.photo_box is not None:
        return None
    floor = mirror.feet[k]
    if floor is None:
        return None
    foot, left, right = floor
    # Take only the rows of the object whose reflection lies within the photo.
    lowest_visible = 2 * foot + 2 - len(stage.background)
    first = max(rows.start, foot + 1 - len(mirror.share), lowest_visible)
    last = min(rows.stop, foot + 1)
    if first >= last:
        return None
    # The photo's reflection fades as the object leaves, and the drawn one takes its
    # place: both shares add up to 1.
    removed_share = 1 - shares[stage.sprites[k].body + 1]
    share = mirror.share[foot + 1 - last : foot + 1 - first] * removed_share
    # A mirror image in a level floor: the row at a height h over the foot appears h
    # below it.
    mirrored_light = picture.light[first - rows.start : last - rows.start][::-1]
    light = mirrored_light * share[:, None, None]
    # The reflecting floor ends at both sides.
    places = np.arange(columns.start, columns.stop)
    light *= ((places >= left) & (places <= right))[:, None]
    # A rough floor blurs its reflection.
    blurred_light = cv2.GaussianBlur(
        light, (0, 0), mirror.blur_width, borderType=cv2.BORDER_REPLICATE
    )
    box = np.s_[2 * foot + 2 - last : 2 * foot + 2 - first, columns]
    return box, np.asarray(blurred_light, np.float32)


def _figures(stage: Stage, pictures: Sequence[Picture]) -> Mapping[int, Silhouette]:
    """Return the silhouettes of visible sprites, which do not depend on how finely an
    object is drawn.
    """
    figures = {}
    for picture in pictures:
        stand, coverage = picture.stand, picture.coverage
        if stage.supersample != 1 and not picture.is_flat:
            coverage = sprite_coverage(stage.sprites[stand.k], picture.placement)
        figures[stand.k] = sprite_silhouette(stage, stand, picture.placement, coverage)
    return figures
