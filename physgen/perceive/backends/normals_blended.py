"""Backend normals=blended: normals from outlines, shading and the network."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Disc
from physgen.perceive.maps.shape_normals import (
    ball_tilts,
    cushion_tilts,
    hidden_ball,
    solid_of_revolution,
    without_thin_parts,
)
from physgen.perceive.roles import BoundaryGuess, Labels, Normals, PhotoObject, Rgb
from physgen.perceive.segment.network import run_network
from physgen.photometry import decode, luminance
from physgen.scene.scene import View

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

ROUND = {
    "apple", "bottle", "bowl", "candle", "can", "cork", "cup", "cylinder", "egg", "flask", "glass", "jar",
    "jug", "lemon", "lid", "mug", "pear", "pin", "plate", "plates", "pot", "saucer", "shaker", "tin", "vase",
}  # fmt: skip
"""Words of labels whose things bulge, whatever the light shows."""
DOMED = {
    "stone": 0.6,
    "puck": 0.4,
    "wheel": 0.3,
    "coin": 0.05,
    "disc": 0.3,
    "plate": 0.3,
    "button": 0.3,
    "token": 0.1,
}
"""Words of labels of round things that are no balls, and what they have of a ball's tilt."""
SLOPE = 0.35, 0.1
"""Of the network's tilt over that of the form: from where a thing bulges, and how much more until it surely does."""
SHADED = 0.05, 0.05
"""The same of the change of light across it: its spread (logarithm) times the square of the share that is smooth."""
CLEAR = 0.15, 0.95, 0.25
"""Spread and smooth share of that change which no flat faces have, and by how much less tilt need then be seen."""
FLAT_BALL = 0.2, 0.15
"""A disc is a flat one where network and shading both show less than this of a ball."""
HANDLE, WHOLE = 0.12, 0.95
"""Of the smaller side: half the width of a handle; of the area: what is left without handles where there are none."""
ALIKE = 0.15
"""By how much the sides of things may differ that are taken to be of one kind."""
COLUMNS = 12
RIM = 0.12
"""Of the smaller side, the width over which a flat face's edge is rounded."""
EDGE = 0.5
"""Sine of the tilt at a flat face's very edge."""
FLOOR = -0.2, 0.12
"""y of the network's normals, below which a row may be a table, and how much more than those above it."""
SHARP, APART = 0.02, 0.15
"""Change of light (logarithm): a px at the edge of a table, and from what is behind it to all of it."""
DEPTH = 0.22
"""Of the photo's height: how far a table reaches up behind the first edge found, at most."""
TILT = 8.0
"""degrees that a camera mostly looks down on a table."""


def blended() -> Normals:
    """The backend `blended`."""
    return _blended


def _blended(rgb: Rgb, labels: Labels, things: Sequence[PhotoObject], setting: BoundaryGuess) -> F32:
    height, width = labels.shape
    seen = np.asarray(
        cv2.resize(run_network(rgb).normals, (width, height), interpolation=cv2.INTER_LINEAR), np.float32
    )
    level = np.log(luminance(decode(rgb)) + np.float32(2e-3))
    tilts = np.zeros((height, width, 2), np.float32)
    forms = []
    for thing in things:
        own = labels == thing.id
        rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
        if not len(rows):
            continue
        here = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        corner = float(columns[0]), float(rows[0])
        part = own[here]
        forms.append((here, part, *_form(thing, part, corner, seen[here], level[here])))
    bulges = _shared([(part, bulge) for _, part, _, bulge in forms])
    for (here, part, field, _), bulge in zip(forms, bulges, strict=True):
        tilt = field if bulge is None else bulge * field + (1 - bulge) * _edge(part)
        tilts[here][part] = tilt[part]
    if setting.view is View.SIDE:
        _table(tilts, labels, seen, level, setting)
    length = np.linalg.norm(tilts, axis=2, keepdims=True)
    tilts *= np.minimum(1, np.float32(0.999) / np.maximum(length, 1e-6))
    z = np.sqrt(np.maximum(1 - (tilts**2).sum(axis=2, keepdims=True), 0))
    return np.concatenate([tilts, z], axis=2).astype(np.float32)


def _shared(found: Sequence[tuple[Mask, float | None]]) -> list[float | None]:
    """Masks and how much each bulges -> the same, with things of one size alike: a row of dominoes, a pile of cans."""
    sizes = np.array([own.shape for own, _ in found], np.float64).reshape(-1, 2)
    shared: list[float | None] = []
    for (_, bulge), size in zip(found, sizes, strict=True):
        near = np.atleast_1d((np.abs(sizes / size - 1) < ALIKE).all(axis=1)).tolist()
        same = [b for (_, b), k in zip(found, near, strict=True) if k and b is not None]
        shared.append(None if bulge is None else float(np.median(same)))
    return shared


def _form(
    thing: PhotoObject, own: Mask, corner: tuple[float, float], seen: F32, level: F32
) -> tuple[F32, float | None]:
    """Tilts (h, w, 2) of one thing on its box, and how much it has of them and not of a flat face; None: it is sure.

    `own` (h, w) is its mask; `seen` (h, w, 3) the network's normals.
    """
    words = _nouns(thing.label)
    inner = _inner(own)
    if isinstance(thing.outline, Disc):
        center = float(thing.outline.center[0]) - corner[0], float(thing.outline.center[1]) - corner[1]
        field = ball_tilts(own.shape, center, float(thing.outline.radius))
        for word in words & set(DOMED):
            return field * np.float32(DOMED[word]), None
        flat = _slope(seen, field, inner) < FLAT_BALL[0] and _explained(level, field, inner) < FLAT_BALL[1]
        return (_edge(own) if flat else field), None
    smaller = min(own.shape)
    body = without_thin_parts(own, round(HANDLE * smaller)) if smaller > 12 else own
    body = own if body.sum() > WHOLE * own.sum() else body
    if thing.label.lower().startswith("ball") or not words & ROUND or words & {"apple", "egg", "lemon"}:
        core = without_thin_parts(own, 2)
        found = hidden_ball(core)
        if found is not None:
            return np.where(core[..., None], ball_tilts(own.shape, *found), cushion_tilts(own)), None
    square = _rectangular(own)
    hull = _solid(body)
    if hull > 0.94 and not square:  # as round as an egg or a pebble
        field = cushion_tilts(own)
        return field, None if words & ROUND else _bulge(seen, level, field, inner)
    field, axis = _lathed(own, body)
    return field, None if words & ROUND else _bulge(seen, level, field, inner, axis)


def _nouns(label: str) -> set[str]:
    """What a label's noun is, and of what it is one: `tin of tomatoes` is a tin, `cork roof` no cork."""
    return {part.split()[-1] for part in label.lower().replace("-", " ").split(" of ") if part.split()}


def _lathed(own: Mask, body: Mask) -> tuple[F32, int]:
    """A thing as turned on a lathe, its handles as cushions; and 0 for an upright axis, 1 for a lying one."""
    wide = own.shape[1] > 2 * own.shape[0]
    lying = wide and _alike(body, body[::-1]) >= _alike(body, body[:, ::-1])  # a pencil lies, a saucer stands
    form = solid_of_revolution(body.T if lying else body).field()
    field = form.transpose(1, 0, 2)[..., ::-1] if lying else form
    beside = own & ~body
    if beside.any():
        field = np.where(beside[..., None], cushion_tilts(beside), field)
    return np.asarray(field, np.float32), int(lying)


def _alike(one: Mask, other: Mask) -> float:
    return float((one & other).sum() / max((one | other).sum(), 1))


def _inner(own: Mask) -> Mask:
    inner = cv2.erode(np.pad(own, 1).astype(np.uint8), np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0
    return np.asarray(inner if inner.sum() > 20 else own)


def _slope(seen: F32, field: F32, inner: Mask) -> float:
    """How much of a form's tilts the network sees, 0..1 and a little."""
    a, b = seen[..., :2][inner], field[inner]
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    return float((a * b).sum() / max(float((b * b).sum()), 1e-6))


def _bulge(seen: F32, level: F32, field: F32, inner: Mask, axis: int = -1) -> float:
    """0..1: whether a thing has the normals `field` (h, w, 2) rather than a flat face, as network and shading show."""
    sides = [0, 1] if axis < 0 else [axis]
    spread, smooth = max((_profile(level, field[..., side], inner) for side in sides), key=np.prod)
    least = SLOPE[0] - (CLEAR[2] if spread > CLEAR[0] and smooth > CLEAR[1] else 0)
    slope = np.clip((_slope(seen, field, inner) - least) / SLOPE[1], 0, 1)
    return float(slope * np.clip((spread * smooth**2 - SHADED[0]) / SHADED[1], 0, 1))


def _profile(level: F32, place: F32, inner: Mask) -> tuple[float, float]:
    """How the light (its logarithm) changes with the tilt: the spread of a parabola through medians, and r²."""
    bins = np.floor((place + 0.8) / 1.6 * COLUMNS).astype(int)
    known = inner & (bins >= 0) & (bins < COLUMNS)
    kept = [k for k in range(COLUMNS) if np.count_nonzero(known & (bins == k)) > 5]
    if len(kept) < 5:
        return 0.0, 0.0
    medians = np.array([float(np.median(level[known & (bins == k)])) for k in kept])
    x = np.array(kept) / COLUMNS - 0.5
    told = np.column_stack([np.ones(len(x)), x, x * x])
    fit = told @ np.linalg.lstsq(told, medians, rcond=None)[0]
    share = 1 - float((medians - fit).var()) / max(float(medians.var()), 1e-9)
    return float(fit.std()), max(share, 0.0)


def _explained(level: F32, field: F32, inner: Mask) -> float:
    """Share of a disc's changes of light that its normals, as a ball's, explain."""
    x, y = field[inner].T.astype(np.float64)
    told = np.column_stack([np.ones(len(x)), x, y, x * x + y * y])
    values = level[inner].astype(np.float64)
    rest = values - told @ np.linalg.lstsq(told, values, rcond=None)[0]
    return 1 - float(rest.var()) / max(float(values.var()), 1e-9)


def _rectangular(own: Mask) -> bool:
    border = max(cv2.findContours(own.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0], key=len)
    w, h = cv2.minAreaRect(border)[1]
    return bool(own.sum() > 0.87 * (w + 1) * (h + 1))


def _solid(own: Mask) -> float:
    """Of its ellipse of the same moments: how alike, 0..1."""
    rows, columns = np.nonzero(own)
    if len(rows) < 12:
        return 0.0
    spread = np.cov(np.stack([columns, rows]))
    away = np.stack(np.meshgrid(np.arange(own.shape[1]), np.arange(own.shape[0])), -1) - [
        columns.mean(),
        rows.mean(),
    ]
    inside = np.einsum("hwi,ij,hwj->hw", away, np.linalg.pinv(spread), away) <= 4
    return float((inside & own).sum() / max((inside | own).sum(), 1))


def _edge(own: Mask) -> F32:
    """A flat face whose edges are rounded a little."""
    h, w = own.shape
    depth = cv2.distanceTransform(np.pad(own, 1).astype(np.uint8), cv2.DIST_L2, 5)
    reach = max(2.0, RIM * min(h, w))
    depth = cv2.GaussianBlur(depth, (0, 0), 1.0)
    gy, gx = np.gradient(depth)  # the pixel around it is still there: a thread is one pixel wide
    amount = EDGE * np.clip(1 - depth / reach, 0, 1) ** 2
    return np.asarray(np.stack([-gx * amount, -gy * amount], -1)[1:-1, 1:-1], np.float32)


def _table(tilts: F32, labels: Labels, seen: F32, level: F32, setting: BoundaryGuess) -> None:
    """Rows below a table's far edge face upwards, in place."""
    free = labels == 0
    height = labels.shape[0]
    known = np.flatnonzero(free.sum(axis=1) > 20)
    if len(known) < 16:
        return
    every = np.arange(height)
    up, light = (
        np.interp(every, known, [float(np.median(part[y, free[y]])) for y in known])
        for part in (seen[..., 1], level)
    )
    step = np.abs(np.diff(cv2.GaussianBlur(level, (0, 0), 1.0), axis=0))
    sharp = np.median(step, axis=1)
    lines = [y for wall in setting.walls if wall.name.startswith("floor") for _, y in wall.points]
    best, at = 0.0, -1
    for y in range(height // 4, min([height - 4, *(int(y) for y in lines)])):
        edge = float(sharp[y - 1 : y + 2].max())
        below = float(up[y:].mean())
        drop = float(up[max(0, y - height // 5) : y].mean()) - below
        if below < FLOOR[0] and drop > FLOOR[1] and edge > SHARP and drop * (1 + 20 * edge) > best:
            best, at = drop * (1 + 20 * edge), y
    if at < 0:
        return
    at = _far_edge(light, at)
    ground = free.copy()
    ground[:at] = False
    tilts[ground] = (0, -np.cos(np.radians(TILT)))


def _far_edge(light: NDArray[np.float64], near: int) -> int:
    """Row of a table's far edge, at `near` or above, where the rows' light (H,) says that the table goes on."""
    height = len(light)
    wide = max(4, height // 10)
    best, at = APART, near
    for y in range(max(height // 4, near - round(DEPTH * height)), near - 3):
        table = light[y:near].mean()
        gain = abs(light[max(0, y - wide) : y].mean() - table) - abs(table - light[near : near + wide].mean())
        if gain > best:
            best, at = gain, y
    return at
