"""Backend normals=blended: normals from outlines, shading and the network.

The segmentation network predicts how much an object bulges but not how steep its rim
is; an outline shows the opposite. Therefore the outline gives the form, and the network
and the photo's shading give its degree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.circles import robust_circle
from physgen.geometry.morphology import open_by_disc
from physgen.geometry.polygon import Array, Disc
from physgen.maps import F32
from physgen.perceive.inpaint.poisson import harmonic_fill
from physgen.perceive.roles import (
    BoundaryGuess,
    Labels,
    Mask,
    Normals,
    PhotoObject,
    Rgb,
)
from physgen.perceive.segment.network import run_network
from physgen.photometry import decode, luminance
from physgen.scene.scene import View

ROUND = {
    "apple", "bottle", "bowl", "candle", "can", "cork", "cup", "cylinder", "egg", "flask", "glass", "jar",
    "jug", "lemon", "lid", "mug", "pear", "pin", "plate", "plates", "pot", "saucer", "shaker", "tin", "vase",
}  # fmt: skip
"""Nouns of objects that bulge whatever the shading shows."""
DOMED = {
    "stone": 0.6, "puck": 0.4, "wheel": 0.3, "coin": 0.05, "disc": 0.3, "plate": 0.3, "button": 0.3, "token": 0.1,
}  # fmt: skip
"""Nouns of discs flatter than balls, with their share of a ball's tilt."""


@dataclass(frozen=True)
class _Limits:
    """Limits of the forms; slope is the network's tilt over the form's, light is a
    logarithm.
    """

    # Least slope of a bulging object ...
    slope: float = 0.35
    # ... and the increase over which the bulge becomes certain.
    slope_range: float = 0.1
    # Least change of light across a bulging object: its spread times its smooth share
    # squared ...
    light_change: float = 0.05
    # ... and the increase over which the bulge becomes certain.
    shaded_range: float = 0.05
    # Spread of the change of light ...
    clear_spread: float = 0.15
    # ... and its smooth share that no flat face reaches,
    smooth_share: float = 0.95
    # and the reduction of the required slope in that case.
    clear_slope: float = 0.25
    # Half the width of a handle, as a share of the smaller side.
    handle: float = 0.12
    # Least share of the area without handles; above it an object has no handles.
    body_share: float = 0.95
    # Largest relative difference between the sides of objects of one kind.
    size_difference: float = 0.15
    # Bins of tilt.
    columns: int = 12
    # Width of the rounded edge of a flat face, as a share of the smaller side.
    rim: float = 0.12
    # Sine of the tilt at the edge of a flat face.
    edge: float = 0.5
    # Largest y of the network's normals on a table ...
    floor: float = -0.2
    # ... and its least difference from the rows above.
    floor_drop: float = 0.12
    # Least change of light per px at the far edge of a table.
    sharp: float = 0.02
    # Usual tilt of a camera towards a table, degrees.
    tilt: float = 8.0
    # Number of halves of a border for circle fits to a hidden ball.
    tries: int = 8
    # Least share of the border on one circle.
    arc: float = 0.55
    # Largest distance of the border from the circle, as a share of the radius.
    fit: float = 0.03
    # Least share of the mask inside the circle.
    inner_share: float = 0.97


LIMITS = _Limits()


def blended() -> Normals:
    """Return the backend `blended`."""
    return _blend_normals


@dataclass(frozen=True, eq=False)
class _ObjectTilts:
    """The tilts of an object on its box."""

    box: tuple[slice, slice]
    mask: Mask  # (h, w)
    tilts: F32  # (h, w, 2)
    # Share of the tilts over a flat face; None for a certain form.
    bulge: float | None


def _blend_normals(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject], boundaries: BoundaryGuess
) -> F32:
    """Return unit normals (H, W, 3): +x right, +y down, +z to the viewer."""
    height, width = labels.shape
    network_normals = np.asarray(
        cv2.resize(
            run_network(rgb).normals, (width, height), interpolation=cv2.INTER_LINEAR
        ),
        np.float32,
    )
    level = np.log(luminance(decode(rgb)) + np.float32(2e-3))
    forms = []
    for item in objects:
        form = _find_object_tilts(item, labels, network_normals, level)
        if form is not None:
            forms.append(form)
    tilts = np.zeros((height, width, 2), np.float32)
    bulges = _shared_bulges([(form.mask, form.bulge) for form in forms])
    for form, bulge in zip(forms, bulges, strict=True):
        tilt = form.tilts
        if bulge is not None:
            tilt = bulge * form.tilts + (1 - bulge) * _flat_face(form.mask)
        tilts[form.box][form.mask] = tilt[form.mask]
    if boundaries.view is View.SIDE:
        _tilt_table(tilts, labels, network_normals, level, boundaries)
    return _complete_tilts(tilts)


def _find_object_tilts(
    item: PhotoObject, labels: Labels, network_normals: F32, level: F32
) -> _ObjectTilts | None:
    """Return the tilts of an object, or None if it has no pixels."""
    mask = labels == item.id
    rows = np.flatnonzero(mask.any(axis=1))
    columns = np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    corner = float(columns[0]), float(rows[0])
    part = mask[box]
    tilts, bulge = _form(item, part, corner, network_normals[box], level[box])
    return _ObjectTilts(box, part, tilts, bulge)


def _complete_tilts(tilts: F32) -> F32:
    """Return the unit normals (H, W, 3) of tilts (H, W, 2).

    Tilts of blended forms may exceed 1; z completes the unit vector.
    """
    length = np.linalg.norm(tilts, axis=2, keepdims=True)
    tilts = tilts * np.minimum(1, np.float32(0.999) / np.maximum(length, 1e-6))
    z = np.sqrt(np.maximum(1 - (tilts**2).sum(axis=2, keepdims=True), 0))
    return np.concatenate([tilts, z], axis=2).astype(np.float32)


def _shared_bulges(
    bulges_of_masks: Sequence[tuple[Mask, float | None]],
) -> list[float | None]:
    """Return one bulge per mask: the median over objects of the same size.

    A row of dominoes or a pile of cans gets a common value.
    """
    sizes = np.array([mask.shape for mask, _ in bulges_of_masks], np.float64).reshape(
        -1, 2
    )
    bulges: list[float | None] = []
    for (_, bulge), size in zip(bulges_of_masks, sizes, strict=True):
        is_similar = np.atleast_1d(
            (np.abs(sizes / size - 1) < LIMITS.size_difference).all(axis=1)
        ).tolist()
        similar_bulges = [
            b
            for (_, b), k in zip(bulges_of_masks, is_similar, strict=True)
            if k and b is not None
        ]
        bulges.append(None if bulge is None else float(np.median(similar_bulges)))
    return bulges


def _form(
    item: PhotoObject,
    mask: Mask,
    corner: tuple[float, float],
    network_normals: F32,
    level: F32,
) -> tuple[F32, float | None]:
    """Return the tilts (h, w, 2) of an object on its box, and its bulge.

    The bulge is the share of these tilts over a flat face; None means a certain form.
    `mask` (h, w) is the mask and `network_normals` (h, w, 3) are the network's normals.
    """
    nouns = _nouns(item.label)
    if isinstance(item.outline, Disc):
        center = (
            float(item.outline.center[0]) - corner[0],
            float(item.outline.center[1]) - corner[1],
        )
        field = ball_tilts(mask.shape, center, float(item.outline.radius))
        return field * np.float32(
            min((DOMED[noun] for noun in nouns & set(DOMED)), default=1.0)
        ), None
    smaller = min(mask.shape)
    # Handles are treated apart from the body.
    if smaller > 12:
        body = without_thin_parts(mask, round(LIMITS.handle * smaller))
    else:
        body = mask
    if body.sum() > LIMITS.body_share * mask.sum():
        body = mask
    if (
        item.label.lower().startswith("ball")
        or not nouns & ROUND
        or nouns & {"apple", "egg", "lemon"}
    ):
        core = without_thin_parts(mask, 2)
        ball = hidden_ball(core)
        if ball is not None:
            return np.where(
                core[..., None], ball_tilts(mask.shape, *ball), cushion_tilts(mask)
            ), None
    # An ellipse is an egg or a pebble rather than a solid of revolution.
    if _ellipse_likeness(body) > 0.94 and not _is_rectangular(mask):
        field = cushion_tilts(mask)
        axis = -1
    else:
        field, axis = _compute_revolved_tilts(mask, body)
    return field, None if nouns & ROUND else _bulge(
        network_normals, level, field, _inner(mask), axis
    )


def _nouns(label: str) -> set[str]:
    """Return the nouns of a label: `tin of tomatoes` is a tin, `cork roof` is a
    roof.
    """
    return {
        part.split()[-1]
        for part in label.lower().replace("-", " ").split(" of ")
        if part.split()
    }


def _compute_revolved_tilts(mask: Mask, body: Mask) -> tuple[F32, int]:
    """Return the tilts of a solid of revolution with handles as cushions, and its axis.

    The axis is 0 if it is upright and 1 if it is level.
    """
    has_level_shape = mask.shape[1] > 2 * mask.shape[0]
    # A pencil has a level axis, a saucer an upright one.
    lying = has_level_shape and _iou(body, body[::-1]) >= _iou(body, body[:, ::-1])
    form = turned_tilts(body.T if lying else body)
    if lying:
        field = form.transpose(1, 0, 2)[..., ::-1]
    else:
        field = form
    handles = mask & ~body
    if handles.any():
        field = np.where(handles[..., None], cushion_tilts(handles), field)
    return np.asarray(field, np.float32), int(lying)


def _iou(first: Mask, other: Mask) -> float:
    return float((first & other).sum() / max((first | other).sum(), 1))


def _inner(mask: Mask) -> Mask:
    inner = (
        cv2.erode(np.pad(mask, 1).astype(np.uint8), np.ones((3, 3), np.uint8))[
            1:-1, 1:-1
        ]
        > 0
    )
    return np.asarray(inner if inner.sum() > 20 else mask)


def _slope(normals: F32, field: F32, inner: Mask) -> float:
    """Return the regression slope of the network's tilts over a form's: about 0..1."""
    a = normals[..., :2][inner]
    b = field[inner]
    a = a - a.mean(axis=0)
    b = b - b.mean(axis=0)
    return float((a * b).sum() / max(float((b * b).sum()), 1e-6))


def _bulge(normals: F32, level: F32, field: F32, inner: Mask, axis: int) -> float:
    """Return the degree, 0..1, to which an object has the tilts `field` (h, w, 2).

    0 is a flat face. The network and the shading must agree. `axis` belongs to a solid
    of revolution and is -1 for other forms.
    """
    if axis < 0:
        sides = [0, 1]
    else:
        sides = [axis]
    spread, smooth_share = max(
        (_light_profile(level, field[..., side], inner) for side in sides), key=np.prod
    )
    clear_change = spread > LIMITS.clear_spread and smooth_share > LIMITS.smooth_share
    least_slope = LIMITS.slope - (LIMITS.clear_slope if clear_change else 0)
    slope = np.clip(
        (_slope(normals, field, inner) - least_slope) / LIMITS.slope_range, 0, 1
    )
    return float(
        slope
        * np.clip(
            (spread * smooth_share**2 - LIMITS.light_change) / LIMITS.shaded_range, 0, 1
        )
    )


def _light_profile(level: F32, place: F32, inner: Mask) -> tuple[float, float]:
    """Return the change of light with the tilt: spread and r² of a parabola.

    Light is a logarithm; the parabola is fitted to the medians of the bins.
    """
    bins = np.floor((place + 0.8) / 1.6 * LIMITS.columns).astype(int)
    known_pixels = inner & (bins >= 0) & (bins < LIMITS.columns)
    full_bins = []
    for k in range(LIMITS.columns):
        if np.count_nonzero(known_pixels & (bins == k)) > 5:
            full_bins.append(k)
    if len(full_bins) < 5:
        return 0.0, 0.0
    medians = np.array(
        [float(np.median(level[known_pixels & (bins == k)])) for k in full_bins]
    )
    x = np.array(full_bins) / LIMITS.columns - 0.5
    matrix = np.column_stack([np.ones(len(x)), x, x * x])
    fit = matrix @ np.linalg.lstsq(matrix, medians, rcond=None)[0]
    share = 1 - float((medians - fit).var()) / max(float(medians.var()), 1e-9)
    return float(fit.std()), max(share, 0.0)


def _is_rectangular(mask: Mask) -> bool:
    border = max(
        cv2.findContours(
            mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )[0],
        key=len,
    )
    w, h = cv2.minAreaRect(border)[1]
    return bool(mask.sum() > 0.87 * (w + 1) * (h + 1))


def _ellipse_likeness(mask: Mask) -> float:
    """Return the IoU of a mask and the ellipse with the same moments."""
    rows, columns = np.nonzero(mask)
    if len(rows) < 12:
        return 0.0
    spread = np.cov(np.stack([columns, rows]))
    height, width = mask.shape
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1)
    offsets = grid - [columns.mean(), rows.mean()]
    # The border of an ellipse lies at two standard deviations.
    inverse = np.linalg.pinv(spread)
    squared_deviations = np.einsum("hwi,ij,hwj->hw", offsets, inverse, offsets)
    return _iou(squared_deviations <= 4, mask)


def _flat_face(mask: Mask) -> F32:
    """Return the tilts of a flat face with slightly rounded edges."""
    h, w = mask.shape
    depth = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)
    reach = max(2.0, LIMITS.rim * min(h, w))
    depth = cv2.GaussianBlur(depth, (0, 0), 1.0)
    # The padding is cut off later: a thread is one pixel wide, and its gradient needs
    # neighbours.
    gy, gx = np.gradient(depth)
    amount = LIMITS.edge * np.clip(1 - depth / reach, 0, 1) ** 2
    return np.asarray(
        np.stack([-gx * amount, -gy * amount], -1)[1:-1, 1:-1], np.float32
    )


def _tilt_table(
    tilts: F32, labels: Labels, normals: F32, level: F32, boundaries: BoundaryGuess
) -> None:
    """Tilt rows below a table's far edge upwards, in place."""
    free = labels == 0
    rows_in_view = np.flatnonzero(free.sum(axis=1) > 20)
    if len(rows_in_view) < 16:
        return
    upward = np.interp(
        np.arange(len(labels)),
        rows_in_view,
        [float(np.median(normals[y, free[y], 1])) for y in rows_in_view],
    )
    step = np.abs(np.diff(cv2.GaussianBlur(level, (0, 0), 1.0), axis=0))
    lowest_row = min(
        [len(labels) - 4]
        + [
            int(y)
            for wall in boundaries.walls
            if wall.name.startswith("floor")
            for _, y in wall.points
        ]
    )
    edge_row = _find_table_edge(upward, np.median(step, axis=1), lowest_row)
    if edge_row is None:
        return
    ground = free.copy()
    ground[:edge_row] = False
    tilts[ground] = (0, -np.cos(np.radians(LIMITS.tilt)))


def _find_table_edge(
    upward: NDArray[np.float64], sharpness: NDArray[np.floating], lowest_row: int
) -> int | None:
    """Return the row of a table's far edge above `lowest_row`, or None.

    At that row the normals turn upwards and the light changes. `upward` (H,) are the
    y components of the normals, `sharpness` (H - 1,) the changes of light.
    """
    height = len(upward)
    best, edge_row = 0.0, None
    for y in range(height // 4, lowest_row):
        edge = float(sharpness[y - 1 : y + 2].max())
        mean_below = float(upward[y:].mean())
        drop = float(upward[max(0, y - height // 5) : y].mean()) - mean_below
        worth = drop * (1 + 20 * edge)
        is_edge = drop > LIMITS.floor_drop and edge > LIMITS.sharp
        if mean_below < LIMITS.floor and is_edge and worth > best:
            best = worth
            edge_row = y
    return edge_row


# Normals of simple solids from masks: (h, w, 2), x and y of the unit normal. z, towards
# the viewer, completes the unit length.


def ball_tilts(
    shape: tuple[int, int], center: tuple[float, float], radius: float
) -> F32:
    """Return a sphere's tilts (h, w, 2); outside its rim those of the rim."""
    x = (np.arange(shape[1], dtype=np.float32) - center[0])[None, :] / radius
    y = (np.arange(shape[0], dtype=np.float32) - center[1])[:, None] / radius
    field = np.stack(np.broadcast_arrays(x, y), -1)
    return np.asarray(
        field / np.maximum(np.linalg.norm(field, axis=2, keepdims=True), 1), np.float32
    )


def turned_tilts(mask: Mask) -> F32:
    """Return the tilts of a solid of revolution with an upright axis, seen from far.

    Each row of `mask` (h, w) is a cross-section; radii are smoothed against ripples.
    """
    rows = np.flatnonzero(mask.any(axis=1))
    left = mask.argmax(axis=1)[rows].astype(np.float32)
    from_right = mask[:, ::-1].argmax(axis=1)[rows].astype(np.float32)
    right = mask.shape[1] - 1 - from_right
    all_rows = np.arange(mask.shape[0])
    middle = np.interp(all_rows, rows, (left + right) / 2).astype(np.float32)
    half_width = np.interp(all_rows, rows, (right - left + 1) / 2).astype(np.float32)
    flare = np.zeros(1, np.float32)
    if len(half_width) > 1:
        sigma = max(1.0, 0.02 * mask.shape[0])
        smooth_radius = cv2.GaussianBlur(
            half_width[:, None],
            (1, 0),
            sigmaX=0.01,
            sigmaY=sigma,
            borderType=cv2.BORDER_REPLICATE,
        )
        flare = np.gradient(np.asarray(smooth_radius[:, 0], np.float32)).astype(
            np.float32
        )
    offset = np.arange(mask.shape[1], dtype=np.float32)[None, :] - middle[:, None]
    ratio = offset / np.maximum(half_width[:, None], 1)
    slope = np.broadcast_to(flare[:, None], ratio.shape)
    return np.asarray(
        np.stack([np.clip(ratio, -1, 1), -slope], -1)
        / np.sqrt(1 + slope[..., None] ** 2),
        np.float32,
    )


def cushion_tilts(mask: Mask) -> F32:
    """Return the tilts of `mask` (h, w) inflated like a cushion with an upright rim.

    Height is the square root of the solution of Poisson's equation with 0 at the border
    (Johnston 2002, Lumo; Sykora et al. 2014): a disc becomes a sphere, an ellipse an
    ellipsoid.
    """
    h, w = mask.shape
    # With the squared distance from the centre added, the solution of Poisson's
    # equation is harmonic.
    y, x = np.mgrid[-1 : h + 1, -1 : w + 1].astype(np.float32)
    bowl = ((x - w / 2) ** 2 + (y - h / 2) ** 2)[..., None]
    height = (harmonic_fill(bowl, np.pad(mask, 1), 0.1) - bowl)[..., 0]
    gy, gx = np.gradient(height)
    upward = np.sqrt(np.maximum(height, 0))
    padded_maps = np.stack([-gx / 2, -gy / 2, upward], -1)
    maps = padded_maps[1:-1, 1:-1]
    length = np.maximum(np.linalg.norm(maps, axis=2, keepdims=True), 1e-6)
    return np.asarray((maps / length)[..., :2], np.float32)


def without_thin_parts(mask: Mask, radius: int) -> Mask:
    """Return `mask` without parts thinner than 2 `radius` px (threads, handles).

    Returns all of it if nothing else remains.
    """
    if radius < 1:
        return mask
    body = open_by_disc(np.pad(mask, radius).astype(np.uint8), radius)
    body = body[radius:-radius, radius:-radius]
    count, ids, stats, _ = cv2.connectedComponentsWithStats(body, connectivity=8)
    if count < 2:
        return mask
    return np.asarray(ids == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()))


def hidden_ball(body: Mask) -> tuple[tuple[float, float], float] | None:
    """Return centre and radius, px, of a partly hidden ball, or None.

    `body` (h, w) is the visible part; its border must lie on a circle.
    """
    contours = cv2.findContours(
        np.pad(body, 1).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )[0]
    border = max(contours, key=len)[:, 0].astype(np.float64) - 1
    if len(border) < 24:
        return None
    half_border = np.arange(len(border) // 2)
    stretches = []
    for k in range(LIMITS.tries):
        stretches.append((half_border + k * len(border) // LIMITS.tries) % len(border))
    tries = [robust_circle(border[stretch]) for stretch in stretches]
    best = max(tries, key=lambda circle: np.count_nonzero(_on_circle(border, circle)))
    circle = robust_circle(border[_on_circle(border, best)])
    x, y, radius = circle.tolist()
    rows, columns = np.nonzero(body)
    is_inside = np.hypot(columns - x, rows - y) <= radius + 1.5
    if (
        _on_circle(border, circle).mean() < LIMITS.arc
        or is_inside.mean() < LIMITS.inner_share
    ):
        return None
    # The border's pixels lie half a pixel inside the outline.
    return (x, y), radius + 0.5


def _on_circle(border: Array, circle: Array) -> Mask:
    """Return (n,) whether border points lie on a circle (x, y, radius)."""
    distance = np.abs(
        np.hypot(border[:, 0] - circle[0], border[:, 1] - circle[1]) - circle[2]
    )
    return np.asarray(distance <= max(0.8, LIMITS.fit * circle[2]))
