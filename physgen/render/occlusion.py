"""Silhouettes of sprites, their shadows on the background and on each other.

Each object is a ball, or its silhouette with a thickness. All objects stand in one
plane (side view) or on one table (top view). A point of an object loses its direct
light if the path to the light meets another object.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, radians, tan
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, Indices, Mask
from physgen.geometry.polygon import Array
from physgen.geometry.shadows import (
    LEAST_LIGHT_HEIGHT,
    MOST_BLOCKED,
    ShadowSetting,
    Silhouette,
)
from physgen.render.shadow_decomposition import LitBackground
from physgen.render.stage import (
    WARP_FLAGS,
    Placement,
    ShadowBody,
    Slices,
    SpritePose,
    Stage,
    three_channels,
)


@dataclass(frozen=True)
class OcclusionTuning:
    """Resolution and thresholds of shadows on other objects."""

    cells: int = 16
    """Number of grid cells across a figure for the computation of a veil."""
    stops: int = 4
    """Number of samples of a silhouette along the path through its thickness."""
    rim: float = 0.4
    """Component of a ball's normal towards the viewer above which a veil is fully
    visible.
    """
    floor: float = 1.0
    """Darkness (-log of light) of a ball by the floor that it touches; by tune."""
    height: float = 0.09
    """Height over the floor, in radii, at which this falls to a third; by tune."""
    least_darkness: float = 0.01
    """Darkness (-log of light) below which a veil is left out."""


OCCLUSION = OcclusionTuning()


def middle(figure: Silhouette, top: bool) -> float:
    """Return the coordinate of an object's middle towards the viewer, px.

    It is the height above the table, or the distance from the plane of all objects.
    """
    return _half_depth(figure) if top else 0.0


def _half_depth(figure: Silhouette) -> float:
    """Return half the thickness of an object, px."""
    return figure.thickness / 2 if figure.radius is None else figure.radius


def face(figure: Silhouette, top: bool) -> float:
    """Return the coordinate of an object's nearest point towards the viewer, px."""
    return middle(figure, top) + _half_depth(figure)


def occluders(
    figures: Sequence[Silhouette], setting: ShadowSetting
) -> dict[int, list[int]]:
    """Return the objects whose shadows may fall on each object's face.

    Boxes are compared, and for balls their distances.
    """
    if len(figures) < 2 or not setting.light.intensity:
        return {}
    faces = np.array([face(figure, setting.top) for figure in figures])
    lower_faces = []
    for figure in figures:
        measure = face if figure.radius is None else middle
        lower_faces.append(measure(figure, setting.top))
    # Length of the path of light, px, from each blocker (column) to a receiver (row).
    path = faces[None] - np.array(lower_faces)[:, None]
    path = path / max(setting.light.direction[2], LEAST_LIGHT_HEIGHT)
    spread = 1 + path * setting.light_radius
    # Light must climb from the face to the blocker: without a difference of height
    # there is no shadow. Cheap tests by boxes come first, then distances of balls.
    may_meet = (path > 0) & _boxes_meet(figures, path, spread, setting)
    np.fill_diagonal(may_meet, False)
    receivers, blockers = np.nonzero(may_meet)
    meets_ball = _balls_meet(
        figures, receivers, blockers, spread[receivers, blockers], setting
    )
    pairs: dict[int, list[int]] = {}
    for k, other in zip(
        receivers[meets_ball].tolist(), blockers[meets_ball].tolist(), strict=True
    ):
        pairs.setdefault(k, []).append(other)
    return pairs


def _boxes_meet(
    figures: Sequence[Silhouette], path: Array, spread: Array, setting: ShadowSetting
) -> Mask:
    """Return the mask (n, n) of boxes of objects (rows) that meet a box of a shadow
    (columns).
    """
    lower_corners = np.array([figure.corner for figure in figures], np.float64)
    upper_corners = lower_corners + [figure.coverage.shape[::-1] for figure in figures]
    may_meet = np.ones(path.shape, bool)
    for axis, component in enumerate(setting.light.direction[:2]):
        # A shadow moves away from the light along its path: sweep the box to its end.
        shift = -component * path
        shadow_low = lower_corners[:, axis][None] + np.minimum(shift, 0) - spread
        shadow_high = upper_corners[:, axis][None] + np.maximum(shift, 0) + spread
        may_meet &= shadow_low < upper_corners[:, axis][:, None]
        may_meet &= shadow_high > lower_corners[:, axis][:, None]
    return may_meet


def _balls_meet(
    figures: Sequence[Silhouette],
    receivers: Indices,
    casters: Indices,
    spread: Array,
    setting: ShadowSetting,
) -> Mask:
    """Return the mask (n,) of pairs in which the shadow of ball `casters` meets ball `receivers`.

    Always true for other objects.
    """
    lx, ly, lz = setting.light.direction
    radius = np.array([np.nan if f.radius is None else f.radius for f in figures])
    middles = np.array([(*f.center, middle(f, setting.top)) for f in figures]).T
    x, y, z = middles[:, receivers] - middles[:, casters]
    distance_along = x * lx + y * ly + z * lz
    distance = np.sqrt(
        np.maximum(x * x + y * y + z * z - distance_along * distance_along, 0)
    )
    sum_of_radii = radius[receivers] + radius[casters]
    # The radius of other objects is nan, and comparisons with it are false: they are
    # never clear.
    is_beside = distance >= sum_of_radii + spread
    is_clear = (is_beside | (distance_along >= radius[receivers])) & ~np.isnan(
        sum_of_radii
    )
    return np.asarray(~is_clear, np.bool_)


def occlusions(
    figures: Sequence[Silhouette],
    neighbours: Mapping[int, Sequence[int]],
    setting: ShadowSetting,
) -> dict[int, F32]:
    """Return the veil of each object, (h, w) on its box: -log of the remaining light.

    Objects without a veil are left out. `neighbours`: the result of `occluders`.
    """
    veils = {}
    for k, others in neighbours.items():
        veil = occlusion_of(figures[k], [figures[other] for other in others], setting)
        if veil is not None:
            veils[k] = veil
    return veils


@dataclass(frozen=True)
class _Surface:
    """Points of an object's face on a grid, (h, w) each."""

    x: NDArray[Any]
    y: NDArray[Any]
    """Coordinates, px of the photo."""
    depth: NDArray[Any]
    """Coordinate towards the viewer, px."""
    direct: F32
    """Direct share of the light."""
    down: NDArray[Any] | None = None
    """Vertical component of a ball's normals."""
    facing_viewer: NDArray[Any] | None = None
    """Component of a ball's normals towards the viewer."""


def occlusion_of(
    receiver: Silhouette, others: Sequence[Silhouette], setting: ShadowSetting
) -> F32 | None:
    """Return the veil (h, w) of `others` on the face of `receiver`: -log of the remaining
    light.

    It covers the box of `receiver`; None without a veil.
    """
    if not others and (receiver.radius is None or receiver.floor is None):
        return None
    # The area is used, because the box of a leaning object is mostly empty.
    step = max(1, int(np.sqrt(receiver.area)) // OCCLUSION.cells)
    all_balls = all(figure.radius is not None for figure in (receiver, *others))
    surface = _surface(receiver, step, np.float64 if all_balls else np.float32, setting)
    # Beer and Lambert: darkness is -log of the remaining light, so that several veils
    # add up.
    remaining = _remaining_light(surface, others, step, setting)
    darkness = _visible_darkness(remaining, surface.facing_viewer)
    if surface.down is not None and receiver.radius and receiver.floor is not None:
        # The floor close below a ball lies in the ball's shadow and reflects no light.
        height = np.maximum(receiver.floor - surface.y, 0) / np.float32(receiver.radius)
        floor_fade = np.exp(-height / OCCLUSION.height)
        downward_share = np.clip(surface.down, 0, 1) ** 2
        darkness = darkness + OCCLUSION.floor * downward_share * floor_fade
    if darkness.max() < OCCLUSION.least_darkness:
        return None
    height_px, width_px = receiver.coverage.shape
    size = (darkness.shape[1] * step, darkness.shape[0] * step)
    full_size = cv2.resize(darkness, size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(full_size[:height_px, :width_px], np.float32)


def _surface(
    receiver: Silhouette, step: int, kind: Any, setting: ShadowSetting
) -> _Surface:
    """Return points `step` px apart on an object's face.

    `kind` is their type: balls on balls need float64.
    """
    height, width = receiver.coverage.shape
    columns = receiver.corner[0] + step * (np.arange(-(-width // step)) + 0.5) - 0.5
    rows = receiver.corner[1] + step * (np.arange(-(-height // step)) + 0.5) - 0.5
    x, y = (np.asarray(part, kind) for part in np.meshgrid(columns, rows))
    # A face is flat and parallel to the photo, a ball has its own normal at each point.
    if receiver.radius is not None:
        return _ball_surface(receiver, x, y, setting)
    lz = np.float32(setting.light.direction[2])
    viewer_distance = np.full(x.shape, face(receiver, setting.top), np.float32)
    light_cosine = np.full(x.shape, max(lz, 0), np.float32)
    return _Surface(x, y, viewer_distance, _direct_share(light_cosine, setting))


def _ball_surface(
    receiver: Silhouette, x: NDArray[Any], y: NDArray[Any], setting: ShadowSetting
) -> _Surface:
    """Return the points of a ball's near side at columns and rows (h, w), px."""
    assert receiver.radius is not None
    lx, ly, lz = (np.float32(part) for part in setting.light.direction)
    cx, cy, radius = (np.float32(part) for part in (*receiver.center, receiver.radius))
    # Coordinates relative to the ball's radius are the components of the unit normal; z
    # follows from its length 1.
    u = (x - cx) / radius
    v = (y - cy) / radius
    z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
    viewer_distance = np.float32(middle(receiver, setting.top)) + radius * z
    light_cosine = np.maximum(u * lx + v * ly + z * lz, 0)
    return _Surface(x, y, viewer_distance, _direct_share(light_cosine, setting), v, z)


def _direct_share(facing: NDArray[Any], setting: ShadowSetting) -> F32:
    """Return the direct share of the light, from the cosine of normal and light."""
    direct_light = setting.light.intensity * facing
    all_light = np.maximum(direct_light + setting.light.ambient, 1e-6)
    return np.asarray(direct_light / all_light, np.float32)


def _remaining_light(
    surface: _Surface,
    others: Sequence[Silhouette],
    step: int,
    setting: ShadowSetting,
) -> F32:
    """Return the remaining share of light (h, w) behind all others together."""
    coordinates = (surface.x, surface.y, surface.depth)
    x, y, depths = (part.astype(np.float32) for part in coordinates)
    balls = [other for other in others if other.radius is not None]
    behind_balls = iter(_behind_balls(balls, (x, y, depths), setting) if balls else ())
    remaining = np.ones(x.shape, np.float32)
    for other in others:
        if other.radius is None:
            blocked_share = _behind_slab(other, x, y, depths, step, setting)
        else:
            blocked_share = next(behind_balls)
        # Several blockers multiply: each takes a share of the light behind the others.
        remaining *= 1 - np.float32(MOST_BLOCKED) * surface.direct * blocked_share
    return remaining


def _visible_darkness(remaining: F32, facing_viewer: NDArray[Any] | None) -> F32:
    """Return -log of the remaining light; slanted parts of a ball have none.

    They are mixed with the background, and the neighbours' light fills them.
    """
    darkness = -np.log(np.maximum(remaining, 1 - MOST_BLOCKED))
    if facing_viewer is not None:
        share = np.clip(facing_viewer / np.float32(OCCLUSION.rim), 0, 1)
        darkness = darkness * share
    return np.asarray(darkness, np.float32)


def stack(values: Iterable[float]) -> F32:
    """Return values as an array (n, 1, 1)."""
    return np.array(list(values), np.float32)[:, None, None]


def _behind_balls(
    balls: Sequence[Silhouette], points: tuple[F32, ...], setting: ShadowSetting
) -> F32:
    """Return the share of light (n, h, w) that each ball blocks at points.

    `points`: columns, rows and px towards the viewer.
    """
    radius = stack(ball.radius or 0.0 for ball in balls)
    distance_along, gap = _ray_distances(balls, points, radius, setting)
    spread = np.float32(0.6 * tan(radians(setting.softness)))
    width = np.maximum(0.6 + spread * np.abs(distance_along), 0.6)
    # 1 for points with the ball between them and the light.
    blocking_side = np.clip(-distance_along / (np.float32(0.5) * radius), 0, 1)
    fade = 1 + np.exp(np.clip(gap / (0.6 * width), -30, 30))
    return np.asarray(blocking_side / fade, np.float32)


def _ray_distances(
    balls: Sequence[Silhouette],
    points: tuple[F32, ...],
    radius: F32,
    setting: ShadowSetting,
) -> tuple[F32, F32]:
    """Return the distances (n, h, w) from balls to points along the light, and of the
    balls to the rays of light through the points, px.
    """
    lx, ly, lz = (np.float32(part) for part in setting.light.direction)
    x, y, z = points
    px = x - stack(ball.center[0] for ball in balls)
    py = y - stack(ball.center[1] for ball in balls)
    pz = z - stack(middle(ball, setting.top) for ball in balls)
    distance_along = px * lx + py * ly + pz * lz
    square_distance = np.maximum(
        px * px + py * py + pz * pz - distance_along * distance_along, 0
    )
    return distance_along, np.sqrt(square_distance) - radius


def _behind_slab(
    slab: Silhouette, x: F32, y: F32, depth: F32, step: int, setting: ShadowSetting
) -> F32:
    """Return the share of light (h, w) that an object of constant thickness blocks.

    The points are `step` px apart.
    """
    lx, ly, lz = (float(part) for part in setting.light.direction)
    # Walk from each point towards the light until the height of the slab's face, in a
    # few stops. The point is in shadow if the slab covers any of them: the largest
    # coverage counts.
    path = np.maximum(face(slab, setting.top) - depth, 0)
    path = path / max(lz, LEAST_LIGHT_HEIGHT)
    margin = 8 + step
    cover = _blur_slab(slab, margin, float(path.max()), step, setting)
    left = np.float32(margin - slab.corner[0])
    top = np.float32(margin - slab.corner[1])
    blocked_light = np.zeros(x.shape, np.float32)
    for stop in range(1, OCCLUSION.stops + 1):
        distance = path * np.float32(stop / OCCLUSION.stops)
        columns = x + distance * np.float32(lx) + left
        rows = y + distance * np.float32(ly) + top
        light_share = cv2.remap(cover, columns, rows, cv2.INTER_LINEAR, borderValue=0)
        np.maximum(blocked_light, light_share, out=blocked_light)
    # A face at the height of the slab's own face gets the full light.
    blocked_light *= np.clip(path * np.float32(hypot(lx, ly)) / 2, 0, 1)
    return np.asarray(blocked_light, np.float32)


def _blur_slab(
    slab: Silhouette, margin: int, path: float, step: int, setting: ShadowSetting
) -> F32:
    """Return a slab's coverage with a margin, blurred by the light's width after a
    path, px.
    """
    blur = min(0.6 + 0.6 * setting.light_radius * path, 4.0)
    padded_cover = np.pad(slab.coverage, margin)
    blurred_cover = cv2.GaussianBlur(padded_cover, (0, 0), max(blur, step / 2))
    return np.asarray(blurred_cover, np.float32)


SUNK = 3.0
"""Largest tolerated depth of an object's pixels below its floor, px."""
NARROW = 0.5
"""Width of a floor, in thicknesses of an object, below which it shows no shadow of the
object, such as the top of a log.
"""


def ground_below(
    grounds: Sequence[Array], x: float, y: float, width: float = 0.0
) -> tuple[float, Array] | None:
    """Return the highest floor below a point, at least `width` px wide, with its row
    there.

    None without a floor.
    """
    highest: tuple[float, Array] | None = None
    for ground in grounds:
        ax, ay, bx, by = ground[:4]
        if ax == bx or not min(ax, bx) <= x <= max(ax, bx):
            continue
        if width and ground[5] - ground[4] < width:
            continue
        row = float(ay + (by - ay) * (x - ax) / (bx - ax))
        if row >= y and (highest is None or row < highest[0]):
            highest = row, ground
    return highest


def sprite_silhouette(
    stage: Stage, stand: SpritePose, placement: Placement, coverage: F32
) -> Silhouette:
    """Return a sprite's silhouette for shadows; `coverage` (h, w) is on its placement's
    box.
    """
    corner = (placement.box[1].start, placement.box[0].start)
    tilt = 0.0 if stage.lit_background is None else stage.lit_background.setting.tilt
    return silhouette(
        stage.grounds, coverage, corner, stand.pose[:2], stage.actors[stand.k], tilt
    )


def silhouette(
    grounds: Sequence[Array],
    coverage: F32,
    corner: tuple[int, int],
    center: Sequence[float] | Array,
    actor: ShadowBody,
    tilt: float,
) -> Silhouette:
    """Create a body's silhouette for shadows, with the floor below it.

    A camera that looks down by `tilt` sees the body's near edge below the floor's line.
    """
    x, y = map(float, center)
    shape = Silhouette(coverage, corner, (x, y), actor.radius, actor.thickness, None)
    if not grounds:
        return shape
    last_row = 0
    if coverage.size:
        rows = np.flatnonzero(coverage.max(axis=1) > 0.5)
        last_row = int(rows[-1]) if len(rows) else 0
    # Search from its middle, since an impact presses it into the floor for a while; a
    # thin object may reach below the floor's line.
    bottom = float(corner[1] + last_row)
    highest = min(y, bottom - SUNK - tilt * actor.thickness / 2)
    floor = ground_below(grounds, x, highest, NARROW * actor.thickness)
    if floor is None:
        return shape
    row, ground = floor
    left, right, left_wall, right_wall = ground[4:].tolist()
    walls = (left_wall > 0, right_wall > 0)
    return replace(shape, floor=row, ends=(left, right), walls=walls)


def add_shadow(
    darkness: F32,
    background: LitBackground,
    stand: SpritePose,
    silhouette: Silhouette | None,
    weight: float = 1.0,
) -> list[Slices]:
    """Add the shadow of a sprite at its pose, times a `weight`, to `darkness` (H, W).

    Returns its boxes. A sliding shadow does not need the sprite's silhouette `silhouette`.
    """
    boxes = []
    for (x0, y0, x1, y1), shadow in background.move_shadow(
        stand.k, silhouette, stand.start, stand.pose
    ):
        if weight != 1:
            shadow = np.float32(weight) * shadow
        darkness[y0:y1, x0:x1] += shadow
        boxes.append(np.s_[y0:y1, x0:x1])
    return boxes


def relit_border(
    rest: F32, background: LitBackground, darkness: F32, box: Slices
) -> F32:
    """Return the rest of a border (h, w, 3) in the present light of the background.

    `darkness` (h, w) of the box. Without it, a border would be black in a passing
    shadow.
    """
    difference = background.total[box] - darkness
    rows = np.flatnonzero(difference.any(axis=1))
    if not len(rows):
        return rest
    # A changed shadow covers a part of a border: the light elsewhere stays.
    columns = np.flatnonzero(difference.any(axis=0))
    part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    gain = three_channels(cv2.exp(np.minimum(difference[part], 1)))
    old_light = rest[part]
    result = rest.copy()
    # A negative rest may be on another object, which has no more light to subtract.
    np.maximum(old_light * gain, np.minimum(old_light, 0), out=result[part])
    return result


def occlusion_factors(
    stage: Stage, stands: Sequence[SpritePose], figures: Mapping[int, Silhouette]
) -> dict[int, F32]:
    """Return the factors (h, w) of light on the box of each sprite with a changed veil.

    Veils are shadows of other objects: those of the photo are removed, and the present
    ones are added. `stands` are in the picture.
    """
    if stage.veils is None or stage.lit_background is None:
        return {}
    # The photo already contains its own veils. A moved object needs the quotient of its
    # new veil and the old one.
    setting = stage.lit_background.setting
    has_moved = np.array(
        [s.placement is None or s.placement.photo_box is None for s in stands]
    )
    if not has_moved.any():
        return {}
    # Only objects with a changed surrounding need a new veil, since veils are costly.
    visible_figures = [figures[stand.k] for stand in stands]
    blockers = occluders(visible_figures, setting)
    changed_indices = _changed_veils(stage, stands, has_moved, blockers)
    shares = {k: stage.actors[stands[k].k].veil_share for k in changed_indices}
    active_blockers = {k: blockers.get(k, []) for k in changed_indices if shares[k]}
    new_veils = occlusions(visible_figures, active_blockers, setting)
    factors: dict[int, F32] = {}
    for k in changed_indices:
        stand = stands[k]
        if stand.placement is None:
            continue
        shape = visible_figures[k].coverage.shape
        old_veil = _old_veil(stage, stand.k, stand.placement, shape)
        factor = _veil_factor(old_veil, new_veils.get(k), shares[k])
        if factor is not None:
            factors[stand.k] = factor
    return factors


def _changed_veils(
    stage: Stage,
    stands: Sequence[SpritePose],
    has_moved: Mask,
    blockers: Mapping[int, Sequence[int]],
) -> list[int]:
    """Return the indices of the poses with a veil that may have changed.

    A veil changes only if the object, or one that may shade it, has moved.
    """
    assert stage.veils is not None
    indices = []
    for k, stand in enumerate(stands):
        has_old_veil = stage.veils[stand.k] is not None
        is_shaded_anew = has_moved[list(blockers.get(k, []))].any()
        if has_moved[k] or has_old_veil or is_shaded_anew:
            indices.append(k)
    return indices


def _veil_factor(
    old_veil: F32 | None, new_veil: F32 | None, share: float
) -> F32 | None:
    """Return the factor (h, w) of light from an old to a share of a new veil.

    Veils are -log of the remaining light. Their difference is the exponent.
    """
    if new_veil is None:
        return None if old_veil is None else np.asarray(cv2.exp(old_veil), np.float32)
    shade = np.float32(share) * new_veil
    difference = -shade if old_veil is None else old_veil - shade
    return np.asarray(cv2.exp(difference), np.float32)


def _old_veil(
    stage: Stage, k: int, placement: Placement, shape: tuple[int, ...]
) -> F32 | None:
    """Return the photo's veil (h, w) on sprite k, on its placement's box; None without
    a veil.
    """
    veil = None if stage.veils is None else stage.veils[k]
    if veil is None:
        return None
    if placement.photo_box is not None:
        return veil[placement.photo_box]
    if stage.sprites[k].ball is not None or placement.matrix is None:
        return None
    size = (shape[1], shape[0])
    border = cv2.BORDER_REPLICATE
    result = cv2.warpAffine(
        veil, placement.matrix, size, flags=WARP_FLAGS, borderMode=border
    )
    return np.asarray(result, np.float32)
