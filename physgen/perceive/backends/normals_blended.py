"""Backend normals=blended: normals from outlines, shading and the network.

The segmentation network sees how much an object bulges but not how steep its rim is, an outline shows the second and
not the first: so the outline gives the form, the network and the photo's shading how much of it there is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from physgen.geometry.circles import robust_circle
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
"""Nouns of objects that bulge, whatever the light shows."""
DOMED = {
    "stone": 0.6, "puck": 0.4, "wheel": 0.3, "coin": 0.05, "disc": 0.3, "plate": 0.3, "button": 0.3, "token": 0.1,
}  # fmt: skip
"""Nouns of round objects that are no balls, and the share of a ball's tilt that they have."""


@dataclass(frozen=True)
class _Limits:
    """Slope is the network's tilt over that of the form; light is a logarithm."""

    slope: float = 0.35  # from which an object bulges ...
    slope_range: float = 0.1  # ... and over how much more it surely does
    # the same of the change of light across it: its spread times its smooth share squared
    shaded: float = 0.05
    shaded_range: float = 0.05
    clear_spread: float = 0.15  # spread and ...
    clear_smooth: float = (
        0.95  # ... smooth share of that change which no flat faces have,
    )
    clear_slope: float = 0.25  # and by how much less slope is then needed
    handle: float = 0.12  # of the smaller side: half the width of a handle
    whole: float = (
        0.95  # share of the area that is left without handles where there are none
    )
    alike: float = 0.15  # between the sides of objects of one kind
    columns: int = 12  # bins of tilt
    rim: float = 0.12  # of the smaller side, over which a flat face's edge is rounded
    edge: float = 0.5  # sine of the tilt at a flat face's very edge
    floor: float = (
        -0.2
    )  # y of the network's normals, below which a row may be a table ...
    floor_drop: float = 0.12  # ... and how much more than those above it
    sharp: float = 0.02  # change of light a px at the edge of a table
    tilt: float = 8.0  # degrees that a camera mostly looks down on a table
    tries: int = (
        8  # halves of the border of a hidden ball through which a circle is laid
    )
    arc: float = 0.55  # share of its border on one circle
    fit: float = 0.03  # of the radius, that the border may be off it
    within: float = 0.97  # share of the mask inside it


LIMITS = _Limits()


def blended() -> Normals:
    """The backend `blended`."""
    return _blended


def _blended(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject], boundaries: BoundaryGuess
) -> F32:
    height, width = labels.shape
    network = cv2.resize(
        run_network(rgb).normals, (width, height), interpolation=cv2.INTER_LINEAR
    )
    seen = np.asarray(network, np.float32)
    level = np.log(luminance(decode(rgb)) + np.float32(2e-3))
    tilts = np.zeros((height, width, 2), np.float32)
    forms = []
    for item in objects:
        own = labels == item.id
        rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
        if not len(rows):
            continue
        here = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        corner = float(columns[0]), float(rows[0])
        part = own[here]
        forms.append((here, part, *_form(item, part, corner, seen[here], level[here])))
    bulges = _shared_bulges([(part, bulge) for _, part, _, bulge in forms])
    for (here, part, field, _), bulge in zip(forms, bulges, strict=True):
        tilt = (
            field if bulge is None else bulge * field + (1 - bulge) * _flat_face(part)
        )
        tilts[here][part] = tilt[part]
    if boundaries.view is View.SIDE:
        _tilt_table(tilts, labels, seen, level, boundaries)
    length = np.linalg.norm(tilts, axis=2, keepdims=True)
    tilts *= np.minimum(1, np.float32(0.999) / np.maximum(length, 1e-6))
    z = np.sqrt(np.maximum(1 - (tilts**2).sum(axis=2, keepdims=True), 0))
    return np.concatenate([tilts, z], axis=2).astype(np.float32)


def _shared_bulges(found: Sequence[tuple[Mask, float | None]]) -> list[float | None]:
    """Bulges by mask, alike for objects of one size: a row of dominoes, a pile of cans."""
    sizes = np.array([own.shape for own, _ in found], np.float64).reshape(-1, 2)
    shared: list[float | None] = []
    for (_, bulge), size in zip(found, sizes, strict=True):
        near = np.atleast_1d(
            (np.abs(sizes / size - 1) < LIMITS.alike).all(axis=1)
        ).tolist()
        same = [b for (_, b), k in zip(found, near, strict=True) if k and b is not None]
        shared.append(None if bulge is None else float(np.median(same)))
    return shared


def _form(
    item: PhotoObject, own: Mask, corner: tuple[float, float], seen: F32, level: F32
) -> tuple[F32, float | None]:
    """Tilts (h, w, 2) of one object on its box, and its share of them over a flat face; None: it is sure.

    `own` (h, w) is its mask; `seen` (h, w, 3) the network's normals.
    """
    nouns = _nouns(item.label)
    if isinstance(item.outline, Disc):
        center = (
            float(item.outline.center[0]) - corner[0],
            float(item.outline.center[1]) - corner[1],
        )
        field = ball_tilts(own.shape, center, float(item.outline.radius))
        return field * np.float32(
            min((DOMED[noun] for noun in nouns & set(DOMED)), default=1.0)
        ), None
    smaller = min(own.shape)
    body = (
        without_thin_parts(own, round(LIMITS.handle * smaller)) if smaller > 12 else own
    )
    body = own if body.sum() > LIMITS.whole * own.sum() else body
    if (
        item.label.lower().startswith("ball")
        or not nouns & ROUND
        or nouns & {"apple", "egg", "lemon"}
    ):
        core = without_thin_parts(own, 2)
        found = hidden_ball(core)
        if found is not None:
            return np.where(
                core[..., None], ball_tilts(own.shape, *found), cushion_tilts(own)
            ), None
    if _ellipse_likeness(body) > 0.94 and not _is_rectangular(
        own
    ):  # as round as an egg or a pebble
        field, axis = cushion_tilts(own), -1
    else:
        field, axis = _turned(own, body)
    return field, None if nouns & ROUND else _bulge(
        seen, level, field, _inner(own), axis
    )


def _nouns(label: str) -> set[str]:
    """A label's noun, and its container: `tin of tomatoes` is a tin, `cork roof` no cork."""
    return {
        part.split()[-1]
        for part in label.lower().replace("-", " ").split(" of ")
        if part.split()
    }


def _turned(own: Mask, body: Mask) -> tuple[F32, int]:
    """An object as a solid of revolution, its handles as cushions; and 0 for an upright axis, 1 for a lying one."""
    wide = own.shape[1] > 2 * own.shape[0]
    lying = wide and _iou(body, body[::-1]) >= _iou(
        body, body[:, ::-1]
    )  # a pencil lies, a saucer stands
    form = turned_tilts(body.T if lying else body)
    field = form.transpose(1, 0, 2)[..., ::-1] if lying else form
    beside = own & ~body
    if beside.any():
        field = np.where(beside[..., None], cushion_tilts(beside), field)
    return np.asarray(field, np.float32), int(lying)


def _iou(one: Mask, other: Mask) -> float:
    return float((one & other).sum() / max((one | other).sum(), 1))


def _inner(own: Mask) -> Mask:
    inner = (
        cv2.erode(np.pad(own, 1).astype(np.uint8), np.ones((3, 3), np.uint8))[
            1:-1, 1:-1
        ]
        > 0
    )
    return np.asarray(inner if inner.sum() > 20 else own)


def _slope(seen: F32, field: F32, inner: Mask) -> float:
    """The network's tilts over a form's, 0..1 and a little."""
    a, b = seen[..., :2][inner], field[inner]
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    return float((a * b).sum() / max(float((b * b).sum()), 1e-6))


def _bulge(seen: F32, level: F32, field: F32, inner: Mask, axis: int) -> float:
    """0..1: whether an object has the normals `field` (h, w, 2) rather than a flat face, by network and shading.

    `axis` of a solid of revolution; -1 for other forms.
    """
    sides = [0, 1] if axis < 0 else [axis]
    spread, smooth = max(
        (_light_profile(level, field[..., side], inner) for side in sides), key=np.prod
    )
    clear = spread > LIMITS.clear_spread and smooth > LIMITS.clear_smooth
    least = LIMITS.slope - (LIMITS.clear_slope if clear else 0)
    slope = np.clip((_slope(seen, field, inner) - least) / LIMITS.slope_range, 0, 1)
    return float(
        slope
        * np.clip((spread * smooth**2 - LIMITS.shaded) / LIMITS.shaded_range, 0, 1)
    )


def _light_profile(level: F32, place: F32, inner: Mask) -> tuple[float, float]:
    """Change of the light (its logarithm) with the tilt: the spread of a parabola through medians, and r²."""
    bins = np.floor((place + 0.8) / 1.6 * LIMITS.columns).astype(int)
    known = inner & (bins >= 0) & (bins < LIMITS.columns)
    kept = [
        k for k in range(LIMITS.columns) if np.count_nonzero(known & (bins == k)) > 5
    ]
    if len(kept) < 5:
        return 0.0, 0.0
    medians = np.array([float(np.median(level[known & (bins == k)])) for k in kept])
    x = np.array(kept) / LIMITS.columns - 0.5
    matrix = np.column_stack([np.ones(len(x)), x, x * x])
    fit = matrix @ np.linalg.lstsq(matrix, medians, rcond=None)[0]
    share = 1 - float((medians - fit).var()) / max(float(medians.var()), 1e-9)
    return float(fit.std()), max(share, 0.0)


def _is_rectangular(own: Mask) -> bool:
    border = max(
        cv2.findContours(
            own.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )[0],
        key=len,
    )
    w, h = cv2.minAreaRect(border)[1]
    return bool(own.sum() > 0.87 * (w + 1) * (h + 1))


def _ellipse_likeness(own: Mask) -> float:
    """Intersection over union with the ellipse of the same moments."""
    rows, columns = np.nonzero(own)
    if len(rows) < 12:
        return 0.0
    spread = np.cov(np.stack([columns, rows]))
    grid = np.stack(np.meshgrid(np.arange(own.shape[1]), np.arange(own.shape[0])), -1)
    away = grid - [columns.mean(), rows.mean()]
    inside = np.einsum("hwi,ij,hwj->hw", away, np.linalg.pinv(spread), away) <= 4
    return _iou(inside, own)


def _flat_face(own: Mask) -> F32:
    """A flat face whose edges are rounded a little."""
    h, w = own.shape
    depth = cv2.distanceTransform(np.pad(own, 1).astype(np.uint8), cv2.DIST_L2, 5)
    reach = max(2.0, LIMITS.rim * min(h, w))
    depth = cv2.GaussianBlur(depth, (0, 0), 1.0)
    gy, gx = np.gradient(
        depth
    )  # the pixel around it is still there: a thread is one pixel wide
    amount = LIMITS.edge * np.clip(1 - depth / reach, 0, 1) ** 2
    return np.asarray(
        np.stack([-gx * amount, -gy * amount], -1)[1:-1, 1:-1], np.float32
    )


def _tilt_table(
    tilts: F32, labels: Labels, seen: F32, level: F32, boundaries: BoundaryGuess
) -> None:
    """Rows below a table's far edge face upwards, in place."""
    free = labels == 0
    height = labels.shape[0]
    known = np.flatnonzero(free.sum(axis=1) > 20)
    if len(known) < 16:
        return
    every = np.arange(height)
    up = np.interp(every, known, [float(np.median(seen[y, free[y], 1])) for y in known])
    step = np.abs(np.diff(cv2.GaussianBlur(level, (0, 0), 1.0), axis=0))
    sharp = np.median(step, axis=1)
    lines = [
        int(y)
        for wall in boundaries.walls
        if wall.name.startswith("floor")
        for _, y in wall.points
    ]
    best, at = 0.0, -1
    for y in range(height // 4, min([height - 4, *lines])):
        edge = float(sharp[y - 1 : y + 2].max())
        below = float(up[y:].mean())
        drop = float(up[max(0, y - height // 5) : y].mean()) - below
        worth = drop * (1 + 20 * edge)
        if (
            below < LIMITS.floor
            and drop > LIMITS.floor_drop
            and edge > LIMITS.sharp
            and worth > best
        ):
            best, at = worth, y
    if at < 0:
        return
    ground = free.copy()
    ground[:at] = False
    tilts[ground] = (0, -np.cos(np.radians(LIMITS.tilt)))


# normals of simple solids from masks: (h, w, 2) x and y of the unit normal; z, towards the viewer, is the rest


def ball_tilts(
    shape: tuple[int, int], center: tuple[float, float], radius: float
) -> F32:
    """A sphere's normals; beyond its rim those of the rim."""
    x = (np.arange(shape[1], dtype=np.float32) - center[0])[None, :] / radius
    y = (np.arange(shape[0], dtype=np.float32) - center[1])[:, None] / radius
    field = np.stack(np.broadcast_arrays(x, y), -1)
    return np.asarray(
        field / np.maximum(np.linalg.norm(field, axis=2, keepdims=True), 1), np.float32
    )


def turned_tilts(own: Mask) -> F32:
    """`own` (h, w) as a solid of revolution with an upright axis, seen from far.

    Each row is a cut across it; radii are smoothed against ripples.
    """
    rows = np.flatnonzero(own.any(axis=1))
    left = own.argmax(axis=1)[rows].astype(np.float32)
    right = own.shape[1] - 1 - own[:, ::-1].argmax(axis=1)[rows].astype(np.float32)
    every = np.arange(own.shape[0])
    middle, half = (
        np.interp(every, rows, part).astype(np.float32)
        for part in ((left + right) / 2, (right - left + 1) / 2)
    )
    flare = np.zeros(1, np.float32)
    if len(half) > 1:
        sigma = max(1.0, 0.02 * own.shape[0])
        soft = cv2.GaussianBlur(
            half[:, None],
            (1, 0),
            sigmaX=0.01,
            sigmaY=sigma,
            borderType=cv2.BORDER_REPLICATE,
        )
        flare = np.gradient(np.asarray(soft[:, 0], np.float32)).astype(np.float32)
    offset = np.arange(own.shape[1], dtype=np.float32)[None, :] - middle[:, None]
    across = offset / np.maximum(half[:, None], 1)
    slope = np.broadcast_to(flare[:, None], across.shape)
    return np.asarray(
        np.stack([np.clip(across, -1, 1), -slope], -1)
        / np.sqrt(1 + slope[..., None] ** 2),
        np.float32,
    )


def cushion_tilts(own: Mask) -> F32:
    """`own` (h, w) inflated like a cushion: an upright rim all around, and a sphere where it is a disc.

    Height is the root of the solution of Poisson's equation with 0 at the border (Johnston 2002, Lumo; Sykora et al.
    2014): an ellipse becomes an ellipsoid.
    """
    h, w = own.shape
    # with the squared distance from the centre added, the solution of Poisson's equation is harmonic
    y, x = np.mgrid[-1 : h + 1, -1 : w + 1].astype(np.float32)
    bowl = ((x - w / 2) ** 2 + (y - h / 2) ** 2)[..., None]
    height = (harmonic_fill(bowl, np.pad(own, 1), 0.1) - bowl)[..., 0]
    gy, gx = np.gradient(height)
    maps = np.stack([-gx / 2, -gy / 2, np.sqrt(np.maximum(height, 0))], -1)[1:-1, 1:-1]
    length = np.maximum(np.linalg.norm(maps, axis=2, keepdims=True), 1e-6)
    return np.asarray((maps / length)[..., :2], np.float32)


def without_thin_parts(own: Mask, radius: int) -> Mask:
    """`own` without parts thinner than 2 `radius` px (threads, handles); all of it where that leaves little."""
    if radius < 1:
        return own
    disc = cv2.getStructuringElement(
        cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)
    )
    body = cv2.morphologyEx(np.pad(own, radius).astype(np.uint8), cv2.MORPH_OPEN, disc)
    body = body[radius:-radius, radius:-radius]
    count, ids, stats, _ = cv2.connectedComponentsWithStats(body, connectivity=8)
    if count < 2:
        return own
    return np.asarray(ids == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()))


def hidden_ball(body: Mask) -> tuple[tuple[float, float], float] | None:
    """Centre and radius px of the ball that `body` (h, w) is a part of; None where its border is no circle's."""
    contours = cv2.findContours(
        np.pad(body, 1).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )[0]
    border = max(contours, key=len)[:, 0].astype(np.float64) - 1
    if len(border) < 24:
        return None
    half = np.arange(len(border) // 2)
    stretches = [
        (half + k * len(border) // LIMITS.tries) % len(border)
        for k in range(LIMITS.tries)
    ]
    tries = [robust_circle(border[stretch]) for stretch in stretches]
    best = max(tries, key=lambda circle: np.count_nonzero(_on_circle(border, circle)))
    circle = robust_circle(border[_on_circle(border, best)])
    x, y, radius = circle.tolist()
    rows, columns = np.nonzero(body)
    within = np.hypot(columns - x, rows - y) <= radius + 1.5
    if _on_circle(border, circle).mean() < LIMITS.arc or within.mean() < LIMITS.within:
        return None
    return (
        x,
        y,
    ), radius + 0.5  # the border's pixels lie half a pixel within the outline


def _on_circle(border: Array, circle: Array) -> Mask:
    """(n,) whether points of the border lie on a circle: x, y, radius."""
    off = np.abs(
        np.hypot(border[:, 0] - circle[0], border[:, 1] - circle[1]) - circle[2]
    )
    return np.asarray(off <= max(0.8, LIMITS.fit * circle[2]))
