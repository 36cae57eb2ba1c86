"""Shade and mirror light at an object's foot, on ground whose light is not known.

If no fitted light explains the photo, a dark strip or a glow below an object would
stay behind when the object moves, and the object would hover. Bare ground is smooth on
the scale of an object: the light around the foot is compared with a membrane (Laplace's
equation) through the ground farther out. A region that is darker, touches the foot
along much of its width and ends before the membrane's border belongs to the object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from physgen.geometry.polygon import mass_properties
from physgen.maps import F32
from physgen.perceive.inpaint.poisson import harmonic_fill
from physgen.perceive.roles import Labels, Mask, PhotoObject, Rgb
from physgen.perceive.shadow.seams import without_seams
from physgen.perceive.shadow.silhouettes import DARKEST, away_from_objects
from physgen.photometry import decode, encode_u8, largest_channel

Window = tuple[slice, slice]
"""Rows and columns of the photo."""


@dataclass(frozen=True)
class FootLimits:
    """Lengths are shares of the smaller side of an object's box, depths are -log of
    light. Chosen by eye on five photos: a remote-controlled car, a rubber duck, a can,
    a robot and a sneaker.
    """

    side: float = 120.0
    """px: smaller side of an object in the search."""
    smallest: int = 1500
    """px: least area of an object."""
    foot: float = 0.2
    """Part of an object's height, from below, with ground beside it."""
    reach: float = 0.45
    """Distance from the foot at which the ground is taken for bare."""
    least_room: float = 0.1
    """Least distance between the foot and the photo's lower side."""
    comparison_start: float = 0.7
    """Share of the reach from which on the ground below is compared."""
    blur_width: float = 0.02
    """Standard deviation of the blur against grain."""
    least_depth: float = 0.08
    """Least depth of shade ..."""
    loud: float = 2.0
    """... and least ratio to the standard deviation of the bare ground."""
    contact_distance: float = 0.06
    """Distance from the foot at which shade is deepest."""
    depth: float = 0.15
    """Least mean depth of shade there."""
    width_share: float = 0.3
    """Least share of the foot's width with shade."""
    fade: float = 0.12
    """Height over which the removal begins."""
    ends: float = 0.3
    """Largest share of the border of the search that is shaded: a longer dark region is
    another surface.
    """
    side_ends: float = 0.005
    """The same on both sides of the foot, for the edge of a board ..."""
    board: float = 0.15
    """... down to this part of the foot's width below the foot."""
    edge: float = 0.035
    """Width of the outer border in the search for an edge ..."""
    edge_share: float = 0.75
    """... and largest share of the depth that may be lost across it: shade is soft, a
    mat or a coaster ends in an edge.
    """
    deepest: float = 2.2
    """Largest depth that is removed."""
    tolerance: float = 0.01
    """Error of the membrane."""


FOOT = FootLimits()
NORMAL = 1.48
"""Standard deviation of a normal distribution over its median absolute deviation."""
EDGE_SEARCH = 3
"""Distance from a border of the search for an edge, in widths of the border."""


@dataclass(frozen=True)
class _FootShade:
    """The shade at one foot."""

    window: Window
    depth: F32
    """(h, w, 3): -log of the missing light."""


BOARD = _FootShade(np.s_[:0, :0], np.zeros((0, 0, 3), np.float32))
"""Instead of shade: the edge of a board under the object."""


def find_foot_shade(
    background: Rgb, coverage: F32, labels: Labels, objects: Sequence[PhotoObject]
) -> tuple[Rgb, Labels] | None:
    """Return the background without shade at feet, and the ids (H, W) of its objects.

    None if no object has such shade.
    """
    owners = np.zeros_like(labels)
    depths = np.zeros(background.shape, np.float32)
    free = away_from_objects(coverage, 1).astype(np.float32)
    for item in objects:
        if item.cut or mass_properties(item.outline).area < FOOT.smallest:
            continue
        # Each is measured on the same background, so that the order does not matter.
        shade = _shade_at_foot(background, free, labels == item.id)
        if shade is BOARD:
            # All objects beside it stand on the board, those at its ends, too.
            return None
        if shade is None:
            continue
        window = shade.window
        depth = shade.depth
        largest = largest_channel(np.abs(depth))
        # Shades of neighbours overlap: the deeper one is the pixel's.
        is_deeper = largest > largest_channel(np.abs(depths[window]))
        depths[window][is_deeper] = depth[is_deeper]
        is_shade = is_deeper & (largest > FOOT.least_depth / 2)
        owners[window][is_shade & (coverage[window] < 0.5)] = item.id
    if not owners.any():
        return None
    result = background.copy()
    is_changed = depths.any(axis=2)
    light = decode(background[is_changed]) * np.exp(depths[is_changed])
    result[is_changed] = encode_u8(np.minimum(light, 1.0).astype(np.float32))
    return result, owners


@dataclass(frozen=True)
class _Ground:
    """The surroundings of a foot, on a coarse grid."""

    depth: F32
    """(h, w, 3): -log of the light, without grain, relative to the membrane."""
    sharp_depth: F32
    """The same with grain and edges."""
    room: Mask
    """(h, w): the searched ground."""
    foot: Mask
    """(h, w): the lower part of the object."""
    distance: F32
    """(h, w): distance from the foot over the object's side."""
    noise: float
    """Standard deviation of the bare ground's -log of light."""
    depth_below: F32
    """(h, w, 3): -log of the light relative to the ground below the foot."""


def _search_window(own_mask: Mask) -> tuple[Window, int, int]:
    """Return the searched window around an object (H, W), the first row of its foot,
    and the smaller side of its box, px.
    """
    left, top, width, height = cv2.boundingRect(own_mask.astype(np.uint8))
    side = min(width, height)
    margin = round(2 * FOOT.reach * side)
    first = max(top + round((1 - FOOT.foot) * height), 0)
    window = (
        slice(max(first - margin, 0), top + height + margin),
        slice(max(left - margin, 0), left + width + margin),
    )
    return window, first, side


def _shade_at_foot(background: Rgb, free: F32, own_mask: Mask) -> _FootShade | None:
    """Return the shade at an object's foot, or None without any."""
    window, first, side = _search_window(own_mask)
    foot = own_mask[window].copy()
    foot[: first - window[0].start] = False
    rows = np.arange(window[0].start, window[0].start + len(foot))
    is_ground_row = np.broadcast_to((rows >= first)[:, None], foot.shape)
    scale = max(side / FOOT.side, 1.0)
    shape = max(round(foot.shape[1] / scale), 2), max(round(foot.shape[0] / scale), 2)

    def reduced(picture: F32) -> F32:
        small = cv2.resize(picture, shape, interpolation=cv2.INTER_AREA)
        return np.asarray(small, np.float32)

    ground = _ground(
        reduced(decode(background[window])),
        reduced(free[window]) > 0.95,
        reduced(foot.astype(np.float32)) > 0.5,
        reduced(is_ground_row.astype(np.float32)) > 0.5,
        side / scale,
    )
    if ground is None:
        shade = None
    else:
        shade = _joined_shade(ground, side / scale)
    if ground is None or shade is None:
        return None
    if _is_board(ground, shade):
        return BOARD
    if float(np.median(ground.depth.mean(axis=2)[shade])) > FOOT.deepest:
        # No shade is that deep: the front of a tray stays dark.
        return None
    small_depth = _soft_depth(ground, shade, side / scale)
    size = foot.shape[1], foot.shape[0]
    depth = cv2.resize(small_depth, size, interpolation=cv2.INTER_LINEAR)
    return _FootShade(window, np.asarray(depth, np.float32))


def _ground(
    linear: F32, open_mask: Mask, foot: Mask, is_ground_row: Mask, side: float
) -> _Ground | None:
    """Compare the light (h, w, 3) around a foot with a membrane; None without ground."""
    outside = (~foot).astype(np.uint8)
    distance_px = cv2.distanceTransform(outside, cv2.DIST_L2, 5)
    distance = np.asarray(distance_px / side, np.float32)
    room = open_mask & is_ground_row & (distance < FOOT.reach)
    bare = open_mask & is_ground_row & (distance >= FOOT.reach)
    if not foot.any() or not room.any() or not bare.any():
        return None
    logs = np.log(linear + DARKEST).astype(np.float32)
    smooth = _blur_known(logs, open_mask, max(FOOT.blur_width * side, 0.8))
    membrane = harmonic_fill(smooth, ~bare, FOOT.tolerance)
    rough = _blur_known(smooth, bare, max(4 * FOOT.blur_width * side, 2.0))
    grain = np.abs(smooth - rough).mean(axis=2)[bare]
    # A median: the ground may end in a meadow within the search.
    noise = NORMAL * float(np.median(grain))
    level = _level_below(smooth, foot, open_mask, side)
    if level is None:
        return None
    depth = without_seams(np.asarray(membrane - smooth, np.float32), foot, side)
    sharp_depth = np.asarray(membrane - logs, np.float32)
    below = without_seams(np.asarray(level - smooth, np.float32), foot, side)
    return _Ground(depth, sharp_depth, room, foot, distance, noise, below)


def _level_below(smooth: F32, foot: Mask, open_mask: Mask, side: float) -> F32 | None:
    """Return the median (3,) of the logarithm of light well below a foot.

    None if the photo ends close to the foot.
    """
    columns = np.flatnonzero(foot.any(axis=0))
    lowest = int(np.flatnonzero(foot.any(axis=1))[-1])
    room = min(FOOT.reach * side, len(foot) - 1 - lowest)
    if room < FOOT.least_room * side:
        return None
    first = lowest + round(FOOT.comparison_start * room)
    place = np.s_[first : lowest + round(room) + 1, columns[0] : columns[-1] + 1]
    values = smooth[place][open_mask[place]]
    if len(values) < len(columns):
        return None
    return np.asarray(np.median(values, axis=0), np.float32)


def _joined_shade(ground: _Ground, side: float) -> Mask | None:
    """Return the shaded ground (h, w) that touches the foot; None if it is no shade.

    `side`: smaller side of the object on the grid, px.
    """
    limit = max(FOOT.least_depth, FOOT.loud * ground.noise)
    # Shade differs from the ground on all sides, and from that below alone: the object
    # may stand on a dark carpet before a bright wall.
    strengths = [_strength(depth) for depth in (ground.depth, ground.depth_below)]
    shade = ground.room & (np.minimum(*strengths) > limit)
    near = ground.room & (ground.distance < FOOT.contact_distance)
    wide_foot = cv2.dilate(ground.foot.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    _, names = cv2.connectedComponents((shade | wide_foot).astype(np.uint8))
    foot_names = np.unique(names[ground.foot])
    shade &= np.isin(names, foot_names[foot_names > 0])
    border = ground.room & (ground.distance > 0.9 * FOOT.reach)
    near_shade = shade & near
    if not near_shade.any() or strengths[0][near_shade].mean() < FOOT.depth:
        return None
    width = np.count_nonzero(ground.foot.any(axis=0))
    shaded_width = np.count_nonzero(near_shade.any(axis=0))
    if shaded_width < FOOT.width_share * width:
        return None
    if np.count_nonzero(shade & border) > FOOT.ends * np.count_nonzero(border):
        return None
    if _has_hard_edge(ground, shade, side):
        return None
    return shade


def _has_hard_edge(ground: _Ground, shade: Mask, side: float) -> bool:
    """Check whether a dark region (h, w) ends in an edge, as paint and mats do.

    `side`: smaller side of the object on the grid, px.
    """
    bare = ground.room & ~shade
    # Only the border towards bare ground counts, not that towards the object.
    inner = cv2.distanceTransform((~bare).astype(np.uint8), cv2.DIST_L2, 5)
    outer = cv2.distanceTransform((~shade).astype(np.uint8), cv2.DIST_L2, 5)
    place = np.rint(np.where(shade, -inner, outer)).astype(int)
    width = max(round(FOOT.edge * side), 2)
    # The mean depth along the border, from inside to outside.
    profile = []
    for step in range(-EDGE_SEARCH * width, EDGE_SEARCH * width + 1):
        pixels = (shade | bare) & (place == step)
        if step != 0 and pixels.any():
            profile.append(ground.sharp_depth[pixels].mean(axis=0))
    strengths = _strength(np.array(profile, np.float32))
    if len(strengths) <= width:
        return False
    drops = strengths[:-width] - strengths[width:]
    return bool(drops.max() > FOOT.edge_share * strengths.max())


def _is_board(ground: _Ground, shade: Mask) -> bool:
    """Check whether a dark region (h, w) leaves the search on both sides of the foot.

    A cast shadow may leave it on one side; the edge of a shelf does so on both.
    """
    columns = np.flatnonzero(ground.foot.any(axis=0))
    lowest = int(np.flatnonzero(ground.foot.any(axis=1))[-1])
    border = ground.room & (ground.distance > 0.9 * FOOT.reach)
    level = border[: lowest + 2 + round(FOOT.board * len(columns))]
    shaded_border = shade[: len(level)] & level
    left = np.count_nonzero(shaded_border[:, : columns[0]])
    right = np.count_nonzero(shaded_border[:, columns[-1] + 1 :])
    return bool(min(left, right) > FOOT.side_ends * np.count_nonzero(border))


def _strength(depth: F32) -> F32:
    """Return the strength (...) of shade or mirror light (..., 3).

    Shade is dark; mirror light changes the colour more than the brightness.
    """
    grey = depth.mean(axis=-1)
    hue = np.abs(depth - grey[..., None]).max(axis=-1)
    return np.asarray(np.maximum(grey, hue), np.float32)


def _soft_depth(ground: _Ground, shade: Mask, side: float) -> F32:
    """Return the depths (h, w, 3) of shade with soft ends, continued behind the foot."""
    sigma = max(FOOT.blur_width * side, 1.0)
    wide_shade = cv2.dilate(shade.astype(np.uint8), np.ones((5, 5), np.uint8))
    weight = cv2.GaussianBlur(wide_shade.astype(np.float32), (0, 0), sigma)
    weight *= np.clip((FOOT.reach - ground.distance) / (0.2 * FOOT.reach), 0, 1)
    # Above the searched rows, shade may go on: it fades instead of ending at a line.
    rows = np.arange(len(weight)) - int(ground.room.any(axis=1).argmax())
    weight = weight * np.clip(rows / (FOOT.fade * side), 0, 1)[:, None]
    weight = np.where(ground.room, weight, 0).astype(np.float32)
    depth = np.clip(ground.depth, -FOOT.deepest, FOOT.deepest) * weight[..., None]
    continued = _blur_known(depth.astype(np.float32), ground.room, 2.0)
    behind = cv2.dilate(ground.room.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    result = np.where(behind[..., None], continued, np.float32(0))
    return np.where(ground.room[..., None], depth, result).astype(np.float32)


def _blur_known(values: F32, known_mask: Mask, sigma: float) -> F32:
    """Return a blur of (h, w, 3) from known pixels only."""
    weight = known_mask.astype(np.float32)
    weights = cv2.GaussianBlur(weight, (0, 0), sigma)[..., None]
    sums = cv2.GaussianBlur(values * weight[..., None], (0, 0), sigma)
    return np.asarray(sums / np.maximum(weights, 1e-3), np.float32)
