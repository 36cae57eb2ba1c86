"""How a finger, a cue or a stick looks: its outline, its colours and its light.

A place of a striker is (along, aside): mm from the end of its tip, and mm above its axis.
A striker is a round bar. A finger's bar ends in a hand, which consists of rounded parts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from physgen.arrays import F32, F64
from physgen.photometry import decode, luminance
from physgen.render.sprites import MARGIN, Sprite
from physgen.render.stage import Stage
from physgen.scene.scene import Striker


@dataclass(frozen=True)
class Band:
    """A part of a striker, from its tip on."""

    end: float
    """mm from the tip."""
    colour: tuple[int, int, int]
    """SRGB."""


@dataclass(frozen=True)
class Swelling:
    """A place where a finger is thicker."""

    distance: float
    """mm from the tip."""
    width: float
    """mm of its standard deviation."""
    upper_share: float
    """Share of the radius that it adds above the axis, and ..."""
    lower_share: float
    """... below it."""


@dataclass(frozen=True)
class Lobe:
    """A rounded part of a hand between two places."""

    start: tuple[float, float]
    """mm along and aside."""
    end: tuple[float, float]
    """mm along and aside."""
    radii: tuple[float, float]
    """mm at both."""
    offsets: tuple[float, float] = (0.0, 0.0)
    """mm towards the viewer at both."""


@dataclass(frozen=True)
class Form:
    """How a striker looks."""

    tip: float
    """mm: radius of its tip, which is round."""
    growth: float
    """mm of radius for each mm of its length."""
    largest_radius: float
    """mm: its largest radius, without swellings."""
    lift: float
    """degrees by which it comes from above, in a view from the side."""
    bands: tuple[Band, ...]
    """The last one goes on to its end."""
    joints: tuple[float, ...] = ()
    """mm from the tip, of creases."""
    swellings: tuple[Swelling, ...] = ()
    hand: tuple[Lobe, ...] = ()
    extent: float = 15.0
    """mm from its axis to its outline, at most."""
    is_skin: bool = False
    gloss: float = 0.0
    """Light of its highlight, linear."""


LONG = 1e9
"""mm: to the end."""
FINE = 2
"""Parts of a pixel's side, so that edges inside of a hand are smooth."""
STRIP = 64
"""Rows that are drawn at once, as many parts of a large photo's size need memory."""
FOREARM = 900.0
"""mm from the tip to the end of a forearm, which `_reach_out` continues."""
FINGER = Form(
    tip=7.6,
    growth=0.032,
    largest_radius=10.0,
    lift=32,
    bands=(Band(LONG, (222, 165, 134)),),
    joints=(25, 50),
    swellings=(
        # The pads of the first two segments, the two joints, and the knuckle.
        Swelling(10, 6, -0.02, 0.1),
        Swelling(25, 4.5, 0.05, 0.03),
        Swelling(37, 6, -0.03, 0.06),
        Swelling(50, 6.5, 0.13, 0.06),
        Swelling(88, 8, 0.1, 0),
    ),
    hand=(
        # The bone behind the finger, the back of the hand and the forearm.
        Lobe((96, -1), (160, -8), (11.5, 14)),
        Lobe((110, -13), (165, -14), (20, 20)),
        Lobe((165, -14), (FOREARM, -20), (20, 34)),
        # Two bent fingers and the thumb.
        Lobe((95, -29), (116, -32), (9, 11)),
        Lobe((86, -21), (112, -24), (9.5, 12), (5, 5)),
        Lobe((74, -14), (98, -17), (8.0, 9), (12, 12)),
        Lobe((98, -17), (140, -15), (9, 14), (12, 0)),
    ),
    extent=45.0,
    is_skin=True,
    gloss=0.02,
)
FORMS = {
    Striker.FINGER: FINGER,
    Striker.CUE: Form(
        6.2,
        0.006,
        14,
        9,
        (
            Band(5, (48, 92, 140)),
            Band(24, (236, 232, 220)),
            Band(LONG, (205, 160, 104)),
        ),
        gloss=0.12,
    ),
    Striker.STICK: Form(
        6.0, 0.0, 6.0, 20, (Band(16, (44, 44, 48)), Band(LONG, (196, 158, 112))), ()
    ),
}


@dataclass(frozen=True)
class SkinTuning:
    """The skin and the nail of a finger."""

    flush: tuple[float, float, float] = (0.02, 0.17, 0.16)
    """Share of red, green and blue light that redder skin lacks."""
    tip_flush: float = 8.0
    """mm from the tip in which skin is redder."""
    joint_flush: tuple[float, float] = (0.55, 5.0)
    """Redness of a joint, relative to the tip's, and mm of its standard deviation."""
    creases: tuple[tuple[float, float], ...] = ((-2.6, 0.5), (0.0, 1.0), (2.3, 0.7))
    """mm from a joint to its creases, and their depth relative to the deepest."""
    crease: float = 0.18
    """Depth of a crease, and ..."""
    crease_width: float = 0.5
    """... mm of its standard deviation, and ..."""
    crease_pixels: float = 0.6
    """... px of it at least, as thinner ones flicker."""
    mottle: float = 0.012
    """Change of light between spots of skin."""
    waves: tuple[tuple[float, float, float], ...] = (
        (0.11, 0.31, 0.4),
        (-0.17, 0.13, 2.1),
        (0.29, -0.09, 4.0),
        (0.07, 0.22, 5.2),
        (-0.41, -0.17, 1.3),
    )
    """Radians for each mm along and aside, and a phase: the waves of the spots."""
    wrap: float = 0.3
    """By which light reaches round the terminator, as skin lets it through."""
    blend: float = 1.6
    """mm of height within which parts of a hand blend."""
    fold: float = 0.5
    """Share of light that is missing in the folds between them."""


@dataclass(frozen=True)
class NailTuning:
    """The nail of a finger."""

    middle: float = 7.6
    """mm from the tip, and ..."""
    half_length: float = 6.0
    """... half of its length."""
    side_middle: float = 0.58
    """Share of the radius above the axis, seen from the side. From above it is 0."""
    half_width: float = 0.4
    """Share of the radius."""
    roundness: float = 2.8
    """Power of its outline: 2 is an ellipse."""
    border: float = 0.28
    """Depth of the groove around it, and ..."""
    border_width: float = 0.22
    """... its standard deviation, in sizes of the nail, and ..."""
    border_pixels: float = 0.6
    """... px of it at least."""
    colour: tuple[int, int, int] = (243, 200, 184)
    """SRGB."""
    free_edge: float = 2.6
    """mm from the tip in which the nail is ..."""
    free_colour: tuple[int, int, int] = (248, 232, 216)
    """... white (sRGB)."""
    gloss: float = 0.16
    """Light of its highlight, linear."""


@dataclass(frozen=True)
class LightTuning:
    """The light of a striker."""

    percentile: float = 95
    """Percentile of a photo's light that ..."""
    white: float = 0.6
    """... is as much as this if colours are as given."""
    limits: tuple[float, float] = (0.35, 1.1)
    """Limits of the light in darker and brighter photos."""
    gloss_power: float = 24
    """Of the cosine: a larger one makes a highlight smaller."""


SKIN = SkinTuning()
NAIL = NailTuning()
LIGHT = LightTuning()


@dataclass(frozen=True)
class Placement:
    """Where a striker is drawn."""

    start: F64
    """(2,) px of the middle of the round tip."""
    axis: F64
    """(2,) unit, from the tip along the striker."""
    length: float
    """px from `start`: it goes on at least so far."""
    scale: float
    """px a mm of its form."""
    is_from_side: bool
    """Whether the viewer sees it from its side; else from above."""


@dataclass(frozen=True)
class _Grid:
    """The pixels of a striker's sprite, (h, w) each."""

    distance: F64
    """mm from the end of the tip."""
    elevation: F64
    """mm above the axis."""
    scale: float
    """px a mm."""
    nail_middle: float
    """Share of the radius above the axis."""


@dataclass(frozen=True)
class _Relief:
    """A surface, (h, w) each."""

    depth: F64
    """mm from its outline."""
    normal: tuple[F64, F64, F64]
    """Unit: along, aside and towards the viewer."""
    height: F64
    """mm towards the viewer; negative outside."""


def draw_striker(stage: Stage, form: Form, placement: Placement, body: int) -> Sprite:
    """Return the sprite of a striker for a body of the trajectory."""
    start = placement.start
    form = _reach_out(form, placement)
    room = ceil(form.extent * placement.scale) + 2 * MARGIN
    end = start + placement.axis * placement.length
    low = np.floor(np.minimum(start, end)).astype(int) - room
    high = np.ceil(np.maximum(start, end)).astype(int) + room
    width, height = (high - low + 1).tolist()
    columns = low[0] - start[0] + _fine_places(0, width)
    strips = []
    for top in range(0, height, STRIP):
        rows = low[1] - start[1] + _fine_places(top, min(STRIP, height - top))
        fine = _draw_strip(stage, form, placement, (columns, rows[:, None]))
        strips.append(fine.reshape(-1, FINE, width, FINE, 4).mean(axis=(1, 3)))
    picture = np.concatenate(strips).astype(np.float32)
    picture[..., :3] *= _photo_level(stage)
    return Sprite(
        body, (int(low[0]), int(low[1])), picture[..., :3].copy(), picture[..., 3]
    )


def _reach_out(form: Form, placement: Placement) -> Form:
    """Return the form with a forearm that goes on for the length of its placement."""
    farthest = placement.length / placement.scale + form.extent
    longer_lobes = []
    for lobe in form.hand:
        if lobe.end[0] == FOREARM < farthest:
            end = (farthest, lobe.end[1])
            radius = lobe.radii[1]
            longer_lobes.append(Lobe(lobe.end, end, (radius, radius)))
    return replace(form, hand=(*form.hand, *longer_lobes))


def _fine_places(begin: int, count: int) -> F64:
    """Return px of the middles of the parts of pixels."""
    return begin - 0.5 + (np.arange(FINE * count) + 0.5) / FINE


def _draw_strip(
    stage: Stage, form: Form, placement: Placement, places: tuple[F64, F64]
) -> F64:
    """Return (h, w, 4) light and coverage at places, px right of and below the start."""
    columns, rows = places
    axis, scale = placement.axis, placement.scale
    sense = 1 if axis[0] < 0 else -1
    grid = _Grid(
        (columns * axis[0] + rows * axis[1]) / scale + form.tip,
        sense * (rows * axis[0] - columns * axis[1]) / scale,
        scale,
        NAIL.side_middle if placement.is_from_side else 0.0,
    )
    reliefs = [_bar(form, grid), *(_lobe(lobe, grid) for lobe in form.hand)]
    relief, fold = _joined(reliefs)
    coverage = np.clip(relief.depth * scale * FINE + 0.5, 0, 1)[..., None]
    nail = _nail_share(form, grid)
    normal = _on_canvas(relief, axis, sense)
    light = _colours(form, grid, nail) * _shading(stage, form, normal, nail)
    light *= (1 - fold)[..., None] * coverage
    return np.concatenate([light, coverage], axis=2)


def _bar(form: Form, grid: _Grid) -> _Relief:
    """Return the surface of a striker without its hand."""
    radius = _radius(form, grid)
    overhang = np.minimum(grid.distance - form.tip, 0)
    depth = radius - np.hypot(overhang, grid.elevation)
    if form.hand:
        # The finger ends in the hand.
        depth = np.minimum(depth, form.hand[0].start[0] - grid.distance)
    return _round_relief(overhang / radius, grid.elevation / radius, radius, depth)


def _radius(form: Form, grid: _Grid) -> F64:
    """Return (h, w) mm of the radius of the bar."""
    radius = np.clip(
        form.tip + form.growth * grid.distance, form.tip, form.largest_radius
    )
    # A half-pixel step between both sides would show as a line.
    top_share = 0.5 + 0.5 * np.tanh(grid.elevation / form.tip * 2)
    for swelling in form.swellings:
        shape = np.exp(
            -(((grid.distance - swelling.distance) / swelling.width) ** 2) / 2
        )
        share = (
            swelling.lower_share
            + (swelling.upper_share - swelling.lower_share) * top_share
        )
        radius = radius * (1 + share * shape)
    return np.asarray(radius, np.float64)


def _lobe(lobe: Lobe, grid: _Grid) -> _Relief:
    """Return the surface of a part of a hand."""
    start = np.array(lobe.start)
    span = np.array(lobe.end) - start
    distance, elevation = grid.distance - start[0], grid.elevation - start[1]
    share = np.clip((distance * span[0] + elevation * span[1]) / (span @ span), 0, 1)
    radius = lobe.radii[0] + (lobe.radii[1] - lobe.radii[0]) * share
    distance, elevation = distance - share * span[0], elevation - share * span[1]
    depth = radius - np.hypot(distance, elevation)
    relief = _round_relief(distance / radius, elevation / radius, radius, depth)
    offsets = lobe.offsets[0] + (lobe.offsets[1] - lobe.offsets[0]) * share
    height = relief.height + offsets * (depth > 0)
    return replace(relief, height=height)


def _round_relief(distance: F64, elevation: F64, radius: F64, depth: F64) -> _Relief:
    """Return a round surface by the parts of its normal."""
    size = np.maximum(np.hypot(distance, elevation), 1.0)
    distance, elevation = distance / size, elevation / size
    frontal = np.sqrt(np.clip(1 - distance**2 - elevation**2, 0, 1))
    height = np.where(depth > 0, frontal * radius, depth)
    return _Relief(depth, (distance, elevation, frontal), height)


def _joined(reliefs: list[_Relief]) -> tuple[_Relief, F64]:
    """Return the surface of all parts, and (h, w) share of light that folds lack."""
    if len(reliefs) == 1:
        return reliefs[0], np.zeros(reliefs[0].depth.shape)
    heights = np.stack([relief.height for relief in reliefs])
    weights = np.exp((heights - heights.max(axis=0)) / SKIN.blend)
    weights /= weights.sum(axis=0)
    distance, elevation, frontal = (
        np.sum([w * r.normal[k] for w, r in zip(weights, reliefs, strict=True)], axis=0)
        for k in range(3)
    )
    size = np.sqrt(distance**2 + elevation**2 + frontal**2) + 1e-6
    normal = (distance / size, elevation / size, frontal / size)
    # Where parts meet at an angle, their mean normal is short.
    fold = SKIN.fold * np.clip(2 * (1 - size), 0, 1)
    depth = np.max([relief.depth for relief in reliefs], axis=0)
    return _Relief(depth, normal, heights.max(axis=0)), fold


def _on_canvas(relief: _Relief, axis: F64, sense: int) -> tuple[F64, F64, F64]:
    """Return the normals in the picture: to the right, down and towards the viewer."""
    distance, elevation, frontal = relief.normal
    elevation = sense * elevation
    x = distance * axis[0] - elevation * axis[1]
    y = distance * axis[1] + elevation * axis[0]
    return np.asarray(x), np.asarray(y), frontal


def _nail_share(form: Form, grid: _Grid) -> F64:
    """Return (h, w) by how much a pixel is inside of the nail: 0 at its border, 1 in its middle."""
    if not form.is_skin:
        return np.full(grid.distance.shape, -LONG)
    distance = np.abs(grid.distance - NAIL.middle) / NAIL.half_length
    elevation = np.abs(grid.elevation / form.tip - grid.nail_middle) / NAIL.half_width
    return np.asarray(1 - distance**NAIL.roundness - elevation**NAIL.roundness)


def _nail_step(form: Form, scale: float) -> float:
    """Return by how much the nail's share changes within a pixel at its side."""
    return NAIL.roundness / (NAIL.half_width * form.tip * scale)


def _colours(form: Form, grid: _Grid, nail: F64) -> F32:
    """Return (h, w, 3) linear."""
    colours = np.zeros((*grid.distance.shape, 3), np.float32)
    begin = -np.inf
    for band in form.bands:
        is_inside = (grid.distance >= begin) & (grid.distance < band.end)
        colours[is_inside] = decode(np.array(band.colour, np.uint8))
        begin = band.end
    return _skin(form, grid, colours, nail) if form.is_skin else colours


def _skin(form: Form, grid: _Grid, colours: F32, nail: F64) -> F32:
    """Return colours (h, w, 3) with redness, spots, creases and the nail."""
    red = np.exp(-np.maximum(grid.distance, 0) / SKIN.tip_flush)
    amount, size = SKIN.joint_flush
    for joint in form.joints:
        red += amount * np.exp(-(((grid.distance - joint) / size) ** 2) / 2)
    spots = np.zeros(grid.distance.shape)
    for distance, elevation, phase in SKIN.waves:
        spots += np.sin(distance * grid.distance + elevation * grid.elevation + phase)
    shade = (1 - SKIN.crease * _creases(form, grid)) * (1 + SKIN.mottle * spots)
    skin = colours * shade[..., None] * (1 - red[..., None] * np.array(SKIN.flush))
    return _with_nail(form, grid, skin, nail)


def _creases(form: Form, grid: _Grid) -> F64:
    """Return (h, w) depth of the creases, of the deepest's."""
    creases = np.zeros(grid.distance.shape)
    width = max(SKIN.crease_width, SKIN.crease_pixels / grid.scale)
    # They bend towards the tip at both sides.
    curved_distance = grid.distance + (grid.elevation / form.tip) ** 2
    for joint in form.joints:
        for place, share in SKIN.creases:
            line = np.exp(-(((curved_distance - joint - place) / width) ** 2) / 2)
            creases = np.maximum(creases, share * line)
    # They are fine lines on top, and end towards the pad.
    top_share = np.clip(0.65 + 0.5 * grid.elevation / form.tip, 0, 1)
    return np.asarray(creases * top_share * (np.abs(grid.elevation) < 2 * form.tip))


def _with_nail(form: Form, grid: _Grid, skin: F64, nail: F64) -> F32:
    """Return colours (h, w, 3) of the skin with the nail and the groove around it."""
    step = _nail_step(form, grid.scale)
    border = max(NAIL.border_width, NAIL.border_pixels * step)
    groove = NAIL.border * np.exp(-((nail / border) ** 2) / 2)
    skin = skin * (1 - groove[..., None])
    is_free = np.clip(NAIL.free_edge + 0.5 - grid.distance, 0, 1)[..., None]
    plate = decode(np.array(NAIL.colour, np.uint8))
    edge = decode(np.array(NAIL.free_colour, np.uint8))
    share = np.clip(0.5 + FINE * nail / step, 0, 1)[..., None]
    nailed = skin + share * (plate + is_free * (edge - plate) - skin)
    return np.asarray(nailed, np.float32)


def _shading(stage: Stage, form: Form, normal: tuple[F64, F64, F64], nail: F64) -> F64:
    """Return (h, w, 1) light of a surface by the scene's light.

    It is 1 for a surface that faces the viewer in full light.
    """
    direction = np.array([0.0, -0.5, 0.86])
    ambient, intensity = 0.4, 0.6
    if stage.lit_background is not None:
        light = stage.lit_background.setting.light
        direction = np.array(light.direction)
        total = light.ambient + light.intensity
        ambient = light.ambient / total
        intensity = light.intensity / total
    facing = np.tensordot(direction, np.stack(normal), 1)
    wrap = SKIN.wrap if form.is_skin else 0.0
    direct = np.maximum(facing + wrap, 0) / (1 + wrap)
    shading = ambient * (0.5 + 0.5 * normal[2]) + intensity * direct
    # A face towards the viewer is as bright as its colour.
    shading = shading / max(ambient + intensity * max(direction[2], 0.3), 0.5)
    gloss = form.gloss + (NAIL.gloss - form.gloss) * np.clip(2 * nail, 0, 1)
    shading = shading + gloss * np.maximum(facing, 0) ** LIGHT.gloss_power
    return np.asarray(shading)[..., None]


def _photo_level(stage: Stage) -> float:
    """Return the light of a striker relative to its colours, by the photo's light."""
    background = luminance(decode(stage.background)).astype(np.float64)
    brightest = float(np.percentile(background, LIGHT.percentile))
    for sprite in stage.sprites:
        solid = sprite.coverage >= 1
        if solid.any():
            own_light = float(np.median(luminance(sprite.light[solid])))
            brightest = max(brightest, own_light)
    lowest, highest = LIGHT.limits
    return min(max(brightest / LIGHT.white, lowest), highest)
