"""Data of the page's interactive player: motion, contacts and cut-out pictures.

Places are px of the photo, with the origin at its top-left pixel's centre. Columns of numbers are whole multiples of a
step, each given as its difference from the one before; rounded like that, a place is off by at most 1/64 px, an angle
by 1/8192 rad, a velocity by 1/16000 of the largest. Between samples poses change linearly, and there are samples at the
beginning of each contact. Shadows are exact at a few moments of an object's path, and shift and cross-fade between
them. A ball's skin turns in space and its light stays, as in the video; the shading of other objects turns with them,
and no shadow falls on an object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.geometry.shadows import F32, PixelBox, joined_pictures
from physgen.maps import U8
from physgen.photometry import encode_u8
from physgen.render.camera import Shot
from physgen.render.contacts import Impact, find_impacts, sample_times
from physgen.render.occlusion import sprite_silhouette
from physgen.render.scales import scales
from physgen.render.shadow_decomposition import LitBackground, shaded_background
from physgen.render.sprites import Sprite
from physgen.render.stage import SpritePose, Stage, sprite_coverage, sprite_poses
from physgen.report.html import webp
from physgen.scene.scene import FieldKind, Load, Motion, Overlay, Scene, Solid, View
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlayerLimits:
    """Sizes, qualities and rounding of the player's data."""

    largest: int = 1280
    """px of the background's longer side: twice its size on a page."""
    quality: int = 86
    """Of WebP."""
    keys: int = 9
    """Moments at which a shadow is computed, at most."""
    strays: float = 5.0
    """px by which an object's border may deviate from a straight path between two of them."""
    balls: int = 90
    """Of WebP, for the layers of balls."""
    large: int = 60_000
    """px² of a ball's box up to which the page's script rotates it, pixel by pixel."""
    gamma: float = 2.2
    """A shadow's share of linear light, to the power of 1 / gamma, is about that of the sRGB codes in browsers."""
    faintest: float = 0.012
    """Of light that a shadow removes, at least."""
    shadow: int = 72
    """px of the longer side of a shadow's picture: it is soft."""
    finer: int = 4
    """Samples a frame in the player."""
    few: int = 40_000
    """Samples times objects of such a closer look."""
    effort: int = 200_000
    """Steps times objects of a run up to which it is looked at so closely: where it must be run again, some seconds."""
    most_impacts: int = 500
    """In a page, the strongest."""
    most: int = 1_000_000
    """Samples times objects in a page."""
    place: float = 1 / 32
    angle: float = 1 / 4096
    instant: float = 1e-6
    """px, rad and s: steps to which poses and times are rounded."""
    turn: float = 1 / 2048
    """Step of the parts of a quaternion."""
    codes: int = 8000
    """Steps of the largest speed, and of the range of an energy."""
    outline: float = 0.05
    """px to which outlines are rounded."""


LIMITS = PlayerLimits()


def plate(stage: Stage, moving: Sequence[int]) -> str:
    """Return the background without the shadows of some of its sprites."""
    background = stage.background
    if stage.lit is not None and moving:
        shadow_share = stage.lit.total.copy()
        for k in moving:
            if (full_plate := stage.lit.casts[k].whole) is not None:
                (x0, y0, x1, y1), before = full_plate
                shadow_share[y0:y1, x0:x1] -= before
        background = encode_u8(
            shaded_background(stage.lit.plate, shadow_share, stage.lit.tint)
        )
    return webp(_smaller(background, _display_scale(stage)), LIMITS.quality)


def sprites(stage: Stage) -> list[dict[str, Any]]:
    """Return `body`, `box` (left, top, width, height), `turns` and `src` of each, the farthest first.

    Of a ball that shows its rotation also `ball`: `center` from the box's corner and `radius`, px, and `skin`, `lit`,
    `gloss`, each with its `most`.
    """
    return [
        _cut(sprite, _display_scale(stage), stage.scale)
        for sprite in stage.sprites
        if sprite.coverage.any()
    ]


def _display_scale(stage: Stage) -> float:
    """Return the share of the picture's size at which it is shown."""
    return float(min(1.0, LIMITS.largest / max(stage.background.shape[:2])))


def _smaller(pixels: U8, less: float) -> U8:
    if less >= 1:
        return pixels
    height, width = (max(1, round(side * less)) for side in pixels.shape[:2])
    return np.asarray(
        cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA), np.uint8
    )


def _moving(stage: Stage, trajectory: Trajectory) -> list[int]:
    """Return sprites of bodies that move."""
    if not len(trajectory.poses):
        return []
    moves = (trajectory.poses != trajectory.poses[:1]).any(axis=(0, 2))
    if stage.starts:
        moves |= (trajectory.poses[0] != np.array(stage.starts)).any(axis=1)
    return [k for k, sprite in enumerate(stage.sprites) if moves[sprite.body]]


def _cut(sprite: Sprite, less: float, scale: float) -> dict[str, Any]:
    """Cut a sprite with unmultiplied colours on what it covers, and a pixel around."""
    x0, y0, x1, y1 = sprite.within
    h, w = sprite.coverage.shape
    rows, columns = (
        slice(max(y0 - 1, 0), min(y1 + 1, h)),
        slice(max(x0 - 1, 0), min(x1 + 1, w)),
    )
    alpha = sprite.coverage[rows, columns]
    colours = sprite.light[rows, columns] / np.maximum(alpha, 1e-3)[..., None]
    covers = np.rint(255 * np.clip(alpha, 0, 1)).astype(np.uint8)
    pixels = np.dstack([encode_u8(np.clip(colours, 0, 1)), covers])
    left, top = sprite.corner[0] + columns.start, sprite.corner[1] + rows.start
    # a ball whose skin is of one colour looks the same however it has turned: its shading stays
    is_equal = (
        sprite.ball is not None
        and float(np.ptp(sprite.ball.skin, axis=(0, 1)).max()) < 1e-6
    )
    picture = {
        "body": sprite.body,
        "box": _place_box(
            (left, top, left + alpha.shape[1], top + alpha.shape[0]), scale
        ),
        "turns": not is_equal,
        "face": round(sprite.face / scale, 3),
        "src": webp(_smaller(pixels, less), LIMITS.quality),
    }
    if (
        sprite.ball is not None
        and picture["turns"]
        and less == 1
        and alpha.size <= LIMITS.large
    ):
        ball = sprite.ball
        picture["ball"] = {
            "center": [round(ball.center[0] - left, 3), round(ball.center[1] - top, 3)],
            "radius": round(ball.radius, 3),
            "skin": _encode_roots(ball.skin[rows, columns]),
            "lit": _encode_roots(ball.lit[rows, columns]),
            "gloss": _encode_roots(ball.gloss[rows, columns], signed=True),
        }
    return picture


def _encode_roots(values: F32, *, signed: bool = False) -> dict[str, Any]:
    """Encode linear light (h, w, 3) as a picture of its roots, which eyes see evenly.

    Zero is grey if `signed`.
    """
    max_value = max(float(np.abs(values).max()), 1e-6)
    roots = np.sqrt(np.abs(values) / max_value)
    codes = (
        128 + 127 * np.sign(values) * roots if signed else 255 * roots * (values > 0)
    )
    return {
        "most": float(f"{max_value:.4g}"),
        "src": webp(np.rint(codes).astype(np.uint8), LIMITS.balls),
    }


def _place_box(box: PixelBox, scale: float) -> list[float]:
    """Return left, top, width, height, px of the photo; (0, 0) is the middle of a pixel."""
    x0, y0, x1, y1 = box
    return [
        round(v, 3)
        for v in (
            x0 / scale - 0.5,
            y0 / scale - 0.5,
            (x1 - x0) / scale,
            (y1 - y0) / scale,
        )
    ]


def select_keys(path: Array, reach: float) -> list[int]:
    """Samples of a way (T, 3) px, px, rad between which it is about straight: ends and the most bent between them."""
    scaled_path = path * (1, 1, reach)
    keys = [0, len(scaled_path) - 1] if len(scaled_path) > 1 else [0]
    while len(keys) < LIMITS.keys:
        samples = np.arange(len(scaled_path))
        chords = np.stack(
            [np.interp(samples, keys, column[keys]) for column in scaled_path.T], axis=1
        )
        distances = np.abs(scaled_path - chords).max(axis=1)
        if distances.max() <= LIMITS.strays:
            break
        keys = sorted({*keys, int(distances.argmax())})
    return keys


def shadows(
    stage: Stage, trajectory: Trajectory, moving: Sequence[int]
) -> list[dict[str, Any]]:
    """Return `body`, `slides` and `keys` of some sprites.

    A key has `sample`, `box`, `at` (centre of darkness) and `src`.
    """
    lit = stage.lit
    if lit is None or not moving:
        return []
    keys: dict[
        int, list[int]
    ] = {}  # a shadow that only slides keeps its shape and is computed once
    for k in moving:
        body = stage.sprites[k].body
        reach = max(stage.sprites[k].coverage.shape) / 2
        keys[k] = (
            [0]
            if lit.casts[k].sliding is not None
            else select_keys(trajectory.poses[:, body], reach)
        )
    order = sorted({sample for mine in keys.values() for sample in mine})
    rows: dict[int, list[dict[str, Any]]] = {k: [] for k in moving}
    for sample, (_, stands) in zip(
        order, sprite_poses(stage, trajectory, order), strict=True
    ):
        for k in moving:
            if sample in keys[k]:
                dark = _measure_darkening(stage, lit, stands[k])
                rows[k].append(
                    {"sample": sample} | ({} if dark is None else _shadow(*dark))
                )
    return [
        {
            "body": stage.sprites[k].body,
            "slides": lit.casts[k].sliding is not None,
            "keys": rows[k],
        }
        | ({"lean": round(lit.casts[k].lean, 4)} if lit.casts[k].lean else {})
        for k in moving
        if any("src" in row for row in rows[k])
    ]


def _measure_darkening(
    stage: Stage, lit: LitBackground, stand: SpritePose
) -> tuple[PixelBox, F32] | None:
    """Return a box, which may leave the photo, and -log of the light that an object lets through there."""
    cast = lit.casts[stand.k]
    if cast.sliding is not None:
        (x, y), dark = cast.sliding
        return (x, y, x + dark.shape[1], y + dark.shape[0]), dark
    if stand.start == stand.pose:
        return cast.whole
    now = None
    if stand.where is not None:
        now = sprite_silhouette(
            stage,
            stand,
            stand.where,
            sprite_coverage(stage.sprites[stand.k], stand.where),
        )
    parts = lit.moved(stand.k, now, stand.start, stand.pose)
    return joined_pictures(parts) if parts else None


def _shadow(box: PixelBox, dark: F32) -> dict[str, Any]:
    """Return a shadow's picture, black that covers more or less.

    Nothing if it is too faint to be seen.
    """
    covers = 1 - np.exp(-np.maximum(dark, 0) / LIMITS.gamma)
    rows, columns = (
        np.flatnonzero((covers > LIMITS.faintest).any(axis=axis)) for axis in (1, 0)
    )
    if not len(rows):
        return {}
    y0, y1, x0, x1 = (
        int(rows[0]),
        int(rows[-1]) + 1,
        int(columns[0]),
        int(columns[-1]) + 1,
    )
    covers = covers[y0:y1, x0:x1]
    total = float(covers.sum())
    offset = [
        float((covers.sum(axis=0) * np.arange(x1 - x0)).sum()) / total + box[0] + x0,
        float((covers.sum(axis=1) * np.arange(y1 - y0)).sum()) / total + box[1] + y0,
    ]
    alpha = np.rint(255 * covers).astype(np.uint8)
    black = np.zeros((*alpha.shape, 4), np.uint8)
    black[..., 3] = alpha
    black = _smaller(black, min(1.0, LIMITS.shadow / max(alpha.shape)))
    place = (box[0] + x0, box[1] + y0, box[0] + x1, box[1] + y1)
    return {
        "box": _place_box(place, 1.0),
        "at": [round(v, 2) for v in offset],
        "src": webp(black, 0),  # coverage is kept whatever the quality
    }


Data = dict[str, Any]


def player_data(
    scene: Scene, world: World, trajectory: Trajectory, stage: Stage, shot: Shot
) -> Data | None:
    """Return everything the page's script needs; None without a frame, or for more than a page can carry.

    `trajectory` has one sample a frame played forward; heaps of hundreds of objects are shown by their frames alone,
    without impacts.
    """
    T, N = len(trajectory.times), len(world.bodies)
    if not T or LIMITS.most < T * N:
        return None
    seen, impacts = trajectory, list[Impact]()
    if N and T > 1 and trajectory.effort.steps * N <= LIMITS.effort:
        seen = trajectory.sampled(
            sample_times(trajectory, LIMITS.finer, max(T, LIMITS.few // N))
        )
        impacts = find_impacts(
            world, seen, world.duration / max(len(world.times), 1) / LIMITS.finer
        )
        impacts = sorted(
            sorted(impacts, key=lambda impact: -impact.impulse)[: LIMITS.most_impacts],
            key=lambda impact: impact.time,
        )
    kinds = set(Overlay)
    moving = _moving(stage, trajectory)
    fastest = float(np.abs(seen.velocities[..., :2]).max(initial=0.0))
    spin = float(np.abs(seen.velocities[..., 2]).max(initial=0.0))
    steps = {
        "turn": LIMITS.turn,
        "time": LIMITS.instant,
        "place": LIMITS.place,
        "angle": LIMITS.angle,
        "speed": fastest / LIMITS.codes or 1.0,
        "spin": spin / LIMITS.codes or 1.0,
    }
    return {
        **fixed_data(scene, world),
        "steps": steps,
        "times": column(seen.times, LIMITS.instant),
        "frames": np.searchsorted(
            seen.times, trajectory.times - LIMITS.instant / 2
        ).tolist(),
        "camera": _camera(shot),
        "bodies": [
            _body(scene, k, body, seen, steps) for k, body in enumerate(world.bodies)
        ],
        "energy": _energy(seen),
        "touches": touches(seen),
        "impacts": [_impact(impact) for impact in impacts],
        "arrows": asdict(
            scales(world, seen, kinds, [impact.impulse for impact in impacts])
        ),
        "background": plate(stage, moving),
        "sprites": sprites(stage),
        "shadows": shadows(stage, trajectory, moving),
    }


def fixed_data(scene: Scene, world: World) -> Data:
    """Return what does not change with time."""
    return {
        "name": scene.name,
        "size": list(world.size),
        "scale": world.pixels_per_meter
        if "world.pixels_per_meter" in scene.places
        else None,
        "gravity": world.gravity.tolist(),
        "top": world.view is View.TOP,
        "clip": {"fps": scene.render.fps, "order": scene.render.play.value},
        "walls": _walls(world),
        "pushes": _pushes(world),
        "joints": _joints(world),
        "fields": _fields(world),
    }


def column(values: Array, step: float) -> list[int]:
    """Encode multiples of `step`, each less the one before.

    >>> column(np.array([1.0, 1.5, 1.5, 0.0]), 0.5)
    [2, 1, 0, -3]
    """
    codes = np.rint(np.asarray(values, np.float64) / step).astype(np.int64)
    return np.diff(codes, prepend=0).tolist()  # type: ignore[no-any-return]


def _short(value: float, digits: int = 5) -> float:
    return float(f"{value:.{digits}g}")


def _round_points(points: Array) -> list[list[float]]:
    return [
        [round(round(v / LIMITS.outline) * LIMITS.outline, 2) for v in point]
        for point in points.tolist()
    ]


def _body(
    scene: Scene, k: int, body: Body, seen: Trajectory, steps: dict[str, float]
) -> Data:
    pose, velocity = seen.poses[:, k], seen.velocities[:, k]
    columns = figure(scene, k, body)
    if seen.turns.size and (seen.turns[:, k] != seen.turns[:1, k]).any():
        columns["q"] = [
            column(part, LIMITS.turn) for part in _steady(seen.turns[:, k]).T
        ]
    for name, values, kind in (
        ("x", pose[:, 0], "place"),
        ("y", pose[:, 1], "place"),
        ("a", pose[:, 2], "angle"),
        ("vx", velocity[:, 0], "speed"),
        ("vy", velocity[:, 1], "speed"),
        ("w", velocity[:, 2], "spin"),
    ):
        columns[name] = column(values, steps[kind])
    return columns


def figure(scene: Scene, k: int, body: Body) -> Data:
    """Return a body without its motion; outlines are about its centre of mass."""
    figure_data: Data = {
        "name": body.name,
        "label": scene.objects[k].label,
        "motion": body.motion.value,
        "mass": _short(body.mass, 6),
        "ball": body.solid is Solid.SPHERE and body.radius is not None,
    }
    if body.radius is not None:
        figure_data["radius"] = round(body.radius, 3)
    else:
        figure_data["rings"] = [_round_points(ring) for ring in body.rings]
        figure_data["pieces"] = [_round_points(piece) for piece in body.pieces]
    if body.rest is not None:  # the pose in which its picture was cut out
        x, y, angle = body.rest.tolist()
        figure_data["rest"] = [round(x, 3), round(y, 3), round(angle, 6)]
    return figure_data


def _steady(turns: Array) -> Array:
    """Return (T, 4) of the two quaternions that mean a turn, the one that is nearer to that before."""
    signs = np.cumprod(np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0, -1.0, 1.0))
    return np.asarray(turns * np.concatenate([[1.0], signs])[:, None])


def _energy(seen: Trajectory) -> Data:
    """Return the energy; potential energy counts from its least: only its changes mean anything."""
    e = seen.energy
    low = float(e.potential.min()) if len(e.potential) else 0.0
    rows = {
        "kinetic": e.kinetic,
        "potential": e.potential - low,
        "dissipated": e.dissipated,
        "work": e.work,
    }
    step = (
        max(float(np.abs(values).max(initial=0.0)) for values in rows.values())
        / LIMITS.codes
        or 1.0
    )
    return {
        "step": step,
        **{name: column(values, step) for name, values in rows.items()},
    }


def touches(seen: Trajectory) -> list[list[float | int | None]]:
    """Return first and second surface, start and end (null: beyond the clip), s, and their total impulse, g·px/s."""
    contacts, N = seen.contacts, len(seen.contacts.surfaces)
    if not len(contacts.touch_pairs):
        return []
    when = seen.times[contacts.impulse_rows[:, 0]]
    pair = (
        contacts.impulse_rows[:, 1].astype(np.int64) * N + contacts.impulse_rows[:, 2]
    )
    size = np.hypot(*contacts.impulses.T)
    begins: dict[int, list[tuple[float, int]]] = {}
    for row, ((first, second), (begin, _)) in enumerate(
        zip(contacts.touch_pairs.tolist(), contacts.touch_times.tolist(), strict=True)
    ):
        begins.setdefault(first * N + second, []).append((begin, row))
    total = np.zeros(len(contacts.touch_pairs))
    for (
        key,
        total_rows,
    ) in (
        begins.items()
    ):  # impulses up to a sample belong to the touch begun last before it
        indices = np.flatnonzero(pair == key)
        row_indices = (
            np.searchsorted(
                [begin for begin, _ in total_rows], when[indices] + LIMITS.instant
            )
            - 1
        )
        np.add.at(
            total,
            np.array([row for _, row in total_rows])[np.maximum(row_indices, 0)],
            size[indices],
        )
    return [
        [
            first,
            second,
            round(begin, 6),
            round(end, 6) if np.isfinite(end) else None,
            _short(given),
        ]
        for (first, second), (begin, end), given in zip(
            contacts.touch_pairs.tolist(),
            contacts.touch_times.tolist(),
            total.tolist(),
            strict=True,
        )
    ]


def _impact(impact: Impact) -> list[float | int]:
    x, y = impact.at.tolist()
    return [
        round(impact.time, 6),
        round(x, 2),
        round(y, 2),
        _short(impact.impulse),
        *impact.pair,
    ]


def _walls(world: World) -> list[Data]:
    """Return boundaries as chains of points."""
    return [
        {"name": wall.name, "chains": [_round_points(chain) for chain in wall.chains]}
        for wall in world.walls
    ]


def _pushes(world: World) -> list[Data]:
    """Return forces, impulses and torques of the scene while they act."""
    return [
        {
            "body": push.body,
            "load": push.load.value,
            "vector": [_short(v) for v in push.vector.tolist()],
            "torque": _short(push.torque),
            "at": [round(v, 2) for v in push.at.tolist()],
            "start": push.start,
            "end": push.start
            if push.load is Load.IMPULSE
            else min(push.end, world.duration),
        }
        for push in world.pushes
        if world.bodies[push.body].motion is Motion.DYNAMIC
    ]


def _joints(world: World) -> list[Data]:
    """Return ends in the frames of the two bodies; of the photo if the second is the world."""
    return [
        {
            "name": joint.name,
            "kind": joint.kind.value,
            "first": joint.first,
            "second": joint.second,
            "ends": _round_points(np.stack([joint.first_at, joint.second_at])),
        }
        for joint in world.joints
    ]


def _fields(world: World) -> list[Data]:
    """Return wind and attractors."""
    return [
        {
            "name": field.name,
            "wind": field.kind is FieldKind.WIND,
            "vector": [_short(v) for v in field.vector.tolist()],
        }
        for field in world.fields
        if field.kind in (FieldKind.WIND, FieldKind.ATTRACTOR)
    ]


def _camera(shot: Shot) -> list[list[float]] | None:
    """Return left, top, width, height, px, of each frame's view of the trajectory.

    None if that is all of the photo.
    """
    views: list[list[float]] = []
    for time in shot.times.tolist():
        (large, _, x), (_, _, y) = shot.affine(time)
        left, top = (-0.5 - x) / large, (-0.5 - y) / large
        views.append(
            [
                round(float(v), 2)
                for v in (left, top, shot.video[0] / large, shot.video[1] / large)
            ]
        )
    canvas = [-0.5, -0.5, *map(float, shot.photo)]
    return views if np.abs(np.array(views) - canvas).max(initial=0.0) > 1.0 else None
