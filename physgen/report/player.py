"""Data of the page's interactive player: motion, contacts and cut-out pictures.

Places are px of the photo, with the origin at its top-left pixel's centre. Columns of
numbers are integer multiples of a step, stored as differences of neighbours. The
rounding error of a place is at most 1/64 px, of an angle 1/8192 rad, of a velocity
1/16000 of the largest. Poses between samples are interpolated linearly, and each
contact begins at a sample. Shadows are exact at a few moments of an object's path;
between them, they shift and cross-fade. A ball's skin turns in space under a fixed
light, as in the video. The shading of other objects turns with them, and no shadow
falls on an object.
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
from physgen.render.ball import Ball
from physgen.render.camera import Shot
from physgen.render.contacts import Impact, find_impacts, sample_times
from physgen.render.occlusion import sprite_silhouette
from physgen.render.scales import scales
from physgen.render.shadow_decomposition import (
    CastShadow,
    LitBackground,
    shaded_background,
)
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
    """Maximum longer side of the background, px: twice its size on a page."""
    quality: int = 86
    """Quality of WebP."""
    keys: int = 9
    """Maximum number of computed shadows on a path."""
    strays: float = 5.0
    """Maximum deviation of an object's border from a straight path between two shadows,
    px.
    """
    balls: int = 90
    """Quality of WebP for the layers of balls."""
    large: int = 60_000
    """Maximum area of a ball's box, px²: the page's script rotates every
    pixel of it.
    """
    gamma: float = 2.2
    """Exponent of browsers: a share of linear light to the power of 1 / gamma
    approximates a share of sRGB codes.
    """
    least_light: float = 1e-3
    """Smallest share of light under an object: its logarithm stays finite."""
    faintest: float = 0.012
    """Minimum share of light that a visible shadow removes."""
    shadow: int = 72
    """Longer side of a shadow's picture, px; shadows are soft."""
    finer: int = 4
    """Samples per frame in the player."""
    fine_samples: int = 40_000
    """Maximum number of such samples times objects."""
    effort: int = 200_000
    """Maximum number of steps times objects of a run with extra samples. A second run
    takes some seconds.
    """
    most_impacts: int = 500
    """Maximum number of impacts in a page, the strongest."""
    max_samples: int = 1_000_000
    """Maximum number of samples times objects in a page."""
    place: float = 1 / 32
    angle: float = 1 / 4096
    instant: float = 1e-6
    """Rounding steps of poses and times, px, rad and s."""
    turn: float = 1 / 2048
    """Rounding step of a quaternion's components."""
    codes: int = 8000
    """Number of rounding steps for the largest speed and for the range of an energy."""
    outline: float = 0.05
    """Rounding step of outlines, px."""


LIMITS = PlayerLimits()


def plate(stage: Stage, moving: Sequence[int]) -> str:
    """Return the background without the shadows of the moving sprites."""
    background = stage.background
    # Shadows of moving sprites are separate pictures.
    if stage.lit_background is not None and moving:
        # Shadows of several objects add up as logarithms of the remaining light.
        shadow_share = stage.lit_background.total.copy()
        for k in moving:
            if (full_plate := stage.lit_background.casts[k].picture) is not None:
                (x0, y0, x1, y1), before = full_plate
                shadow_share[y0:y1, x0:x1] -= before
        background = encode_u8(
            shaded_background(
                stage.lit_background.plate, shadow_share, stage.lit_background.tint
            )
        )
    return webp(_smaller(background, _display_scale(stage)), LIMITS.quality)


def sprites(stage: Stage) -> list[dict[str, Any]]:
    """Return `body`, `box` (left, top, width, height), `turns` and `src` of each
    sprite, the farthest first.

    A ball with visible rotation also has `ball`: `center` from the box's corner and
    `radius`, px, and `skin`, `lit`, `gloss`, each with its `most`.
    """
    return [
        _cut(sprite, _display_scale(stage), stage.scale)
        for sprite in stage.sprites
        if sprite.coverage.any()
    ]


def _display_scale(stage: Stage) -> float:
    """Return the scale of the picture on the page."""
    return float(min(1.0, LIMITS.largest / max(stage.background.shape[:2])))


def _smaller(pixels: U8, scale: float) -> U8:
    if scale >= 1:
        return pixels
    height, width = (max(1, round(side * scale)) for side in pixels.shape[:2])
    return np.asarray(
        cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA), np.uint8
    )


def _moving(stage: Stage, trajectory: Trajectory) -> list[int]:
    """Return the sprites of moving bodies."""
    if not len(trajectory.poses):
        return []
    # A sprite moves if its body moves in the clip, or stands elsewhere than in
    # the photo.
    moves = (trajectory.poses != trajectory.poses[:1]).any(axis=(0, 2))
    if stage.starts:
        moves |= (trajectory.poses[0] != np.array(stage.starts)).any(axis=1)
    return [k for k, sprite in enumerate(stage.sprites) if moves[sprite.body]]


def _cut(sprite: Sprite, display_scale: float, scale: float) -> dict[str, Any]:
    """Cut a sprite with unmultiplied colours from its covered pixels, with a margin of
    one pixel.
    """
    rows, columns = _with_margin(sprite.covered_box, sprite.coverage.shape)
    alpha = sprite.coverage[rows, columns]
    height, width = alpha.shape
    left, top = sprite.corner[0] + columns.start, sprite.corner[1] + rows.start
    ball = sprite.ball
    # The rotation of a ball with one colour is invisible, and its shading does not
    # turn.
    is_plain = ball is not None and float(np.ptp(ball.skin, axis=(0, 1)).max()) < 1e-6
    pixels = _unmultiplied(sprite.light[rows, columns], alpha)
    picture = {
        "body": sprite.body,
        "box": _place_box((left, top, left + width, top + height), scale),
        "turns": not is_plain,
        "face": round(sprite.face / scale, 3),
        "src": webp(_smaller(pixels, display_scale), LIMITS.quality),
    }
    # The script turns a skin pixel by pixel, and not at another scale.
    is_small = display_scale == 1 and alpha.size <= LIMITS.large
    if ball is not None and not is_plain and is_small:
        picture["ball"] = _ball_data(ball, (rows, columns), (left, top))
    return picture


def _with_margin(box: PixelBox, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return the rows and columns of a box with a margin of 1 px, in an image (h, w)."""
    x0, y0, x1, y1 = box
    height, width = shape
    rows = slice(max(y0 - 1, 0), min(y1 + 1, height))
    return rows, slice(max(x0 - 1, 0), min(x1 + 1, width))


def _unmultiplied(light: F32, alpha: F32) -> U8:
    """Return the colours and the coverage of premultiplied linear light, (h, w, 4)."""
    # Browsers expect colours that are not multiplied by the coverage.
    colours = light / np.maximum(alpha, 1e-3)[..., None]
    covers = np.rint(255 * np.clip(alpha, 0, 1)).astype(np.uint8)
    return np.dstack([encode_u8(np.clip(colours, 0, 1)), covers])


def _ball_data(
    ball: Ball, window: tuple[slice, slice], corner: tuple[int, int]
) -> dict[str, Any]:
    """Return the textures of a ball in a window of its sprite, which begins at `corner`
    of the photo, px.
    """
    x, y = ball.center
    left, top = corner
    return {
        "center": [round(x - left, 3), round(y - top, 3)],
        "radius": round(ball.radius, 3),
        "skin": _encode_roots(ball.skin[window]),
        "lit": _encode_roots(ball.shading[window]),
        "gloss": _encode_roots(ball.gloss[window], signed=True),
    }


def _encode_roots(values: F32, *, signed: bool = False) -> dict[str, Any]:
    """Encode linear light (h, w, 3) as a picture of its roots, which are even steps for
    the eye.

    With `signed`, zero is grey.
    """
    max_value = max(float(np.abs(values).max()), 1e-6)
    # Roots give dark tones more of the 256 codes.
    roots = np.sqrt(np.abs(values) / max_value)
    if signed:
        codes = 128 + 127 * np.sign(values) * roots
    else:
        codes = 255 * roots * (values > 0)
    return {
        "most": float(f"{max_value:.4g}"),
        "src": webp(np.rint(codes).astype(np.uint8), LIMITS.balls),
    }


def _place_box(box: PixelBox, scale: float) -> list[float]:
    """Return left, top, width, height, px of the photo; (0, 0) is the centre of a
    pixel.
    """
    x0, y0, x1, y1 = box
    # A pixel's border is half a pixel before its centre.
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
    """Return samples of a path (T, 3) px, px, rad with almost straight parts between
    them: the ends, and the most bent samples.
    """
    # An angle counts as the motion of the border.
    scaled_path = path * (1, 1, reach)
    if len(scaled_path) > 1:
        keys = [0, len(scaled_path) - 1]
    else:
        keys = [0]
    # Add the sample farthest from the straight parts until all samples are close
    # to them.
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
    """Return `body`, `slides` and `keys` of the moving sprites.

    A key has `sample`, `box`, `at` (centre of darkness) and `src`.
    """
    lit = stage.lit_background
    if lit is None or not moving:
        return []
    # A sliding shadow keeps its shape and is computed once.
    keys: dict[int, list[int]] = {}
    for k in moving:
        body = stage.sprites[k].body
        # Distance of the border from the centre, as a bound for a turn's effect.
        reach = max(stage.sprites[k].coverage.shape) / 2
        if lit.casts[k].sliding is not None:
            keys[k] = [0]
        else:
            keys[k] = select_keys(trajectory.poses[:, body], reach)
    # Poses of each sample are computed once for all sprites.
    samples = sorted(set().union(*keys.values()))
    rows: dict[int, list[dict[str, Any]]] = {k: [] for k in moving}
    poses_of_samples = sprite_poses(stage, trajectory, samples)
    for sample, (_, poses) in zip(samples, poses_of_samples, strict=True):
        for k in moving:
            if sample in keys[k]:
                darkening = _measure_darkening(stage, lit, poses[k])
                row: dict[str, Any] = {"sample": sample}
                if darkening is not None:
                    row |= _shadow(*darkening)
                rows[k].append(row)
    entries = []
    for k in moving:
        if any("src" in row for row in rows[k]):
            body = stage.sprites[k].body
            entries.append(_shadow_entry(body, lit.casts[k], rows[k]))
    return entries


def _shadow_entry(
    body: int, cast: CastShadow, rows: list[dict[str, Any]]
) -> dict[str, Any]:
    entry = {"body": body, "slides": cast.sliding is not None, "keys": rows}
    if cast.lean:
        entry["lean"] = round(cast.lean, 4)
    return entry


def _measure_darkening(
    stage: Stage, lit: LitBackground, stand: SpritePose
) -> tuple[PixelBox, F32] | None:
    """Return a box and -log of the light that passes an object there. The box may leave
    the photo.
    """
    cast = lit.casts[stand.k]
    # A sliding shadow keeps its shape.
    if cast.sliding is not None:
        (x, y), dark = cast.sliding
        return (x, y, x + dark.shape[1], y + dark.shape[0]), dark
    # An object at its place in the photo has the shadow of the photo.
    if stand.start == stand.pose:
        return cast.picture
    now = None
    if stand.placement is not None:
        now = sprite_silhouette(
            stage,
            stand,
            stand.placement,
            sprite_coverage(stage.sprites[stand.k], stand.placement),
        )
    # A shadow may consist of several pictures: they are joined into one, as the page
    # draws one picture for each object.
    parts = list(lit.move_shadow(stand.k, now, stand.start, stand.pose))
    # `move_shadow` leaves out the shade at the base of an object that rocks.
    contact = None
    if now is not None:
        contact = lit.contact_shade(stand.k, now, stand.start, stand.pose)
    if contact is not None:
        rows, columns = contact.box
        box = (columns.start, rows.start, columns.stop, rows.stop)
        # The page's shadows are black: the green channel is nearest to brightness.
        green_light = np.maximum(contact.factor[..., 1], LIMITS.least_light)
        parts.append((box, -np.log(green_light)))
    if parts:
        return joined_pictures(parts)
    return None


def _shadow(box: PixelBox, darkness: F32) -> dict[str, Any]:
    """Return a shadow's picture: black with varying coverage.

    Return an empty mapping for an invisible shadow.
    """
    # The page multiplies codes, not linear light: gamma approximates the difference.
    covers = 1 - np.exp(-np.maximum(darkness, 0) / LIMITS.gamma)
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
    # Most of the box is invisible: send only the visible part.
    covers = covers[y0:y1, x0:x1]
    total = float(covers.sum())
    # The page moves a shadow between its keys by their centres of darkness.
    offset = [
        float((covers.sum(axis=0) * np.arange(x1 - x0)).sum()) / total + box[0] + x0,
        float((covers.sum(axis=1) * np.arange(y1 - y0)).sum()) / total + box[1] + y0,
    ]
    alpha = np.rint(255 * covers).astype(np.uint8)
    black = np.zeros((*alpha.shape, 4), np.uint8)
    black[..., 3] = alpha
    # A shadow is soft, so that a small picture suffices.
    black = _smaller(black, min(1.0, LIMITS.shadow / max(alpha.shape)))
    place = (box[0] + x0, box[1] + y0, box[0] + x1, box[1] + y1)
    return {
        "box": _place_box(place, 1.0),
        "at": [round(v, 2) for v in offset],
        # Alpha is lossless at every quality.
        "src": webp(black, 0),
    }


Data = dict[str, Any]


def _largest_impacts(world: World, samples: Trajectory) -> list[Impact]:
    """Return the impacts with the largest impulses, by time."""
    frame_time = world.duration / max(len(world.times), 1)
    impacts = find_impacts(world, samples, frame_time / LIMITS.finer)
    # A page with all impacts of a heap would be slow: keep the strongest ones.
    largest = sorted(impacts, key=lambda impact: -impact.impulse)
    return sorted(largest[: LIMITS.most_impacts], key=lambda impact: impact.time)


def _code_steps(samples: Trajectory) -> dict[str, float]:
    """Return the units of the page's integers."""
    # The page stores integers: a unit is the largest value divided by
    # the number of codes.
    fastest = float(np.abs(samples.velocities[..., :2]).max(initial=0.0))
    spin = float(np.abs(samples.velocities[..., 2]).max(initial=0.0))
    return {
        "turn": LIMITS.turn,
        "time": LIMITS.instant,
        "place": LIMITS.place,
        "angle": LIMITS.angle,
        "speed": fastest / LIMITS.codes or 1.0,
        "spin": spin / LIMITS.codes or 1.0,
    }


def player_data(
    scene: Scene, world: World, trajectory: Trajectory, stage: Stage, shot: Shot
) -> Data | None:
    """Return all data for the page's script, or None without a frame or with too much
    data for a page.

    `trajectory` has one sample per frame, in forward order. Heaps of hundreds of
    objects have only their frames, without impacts.
    """
    T, N = len(trajectory.times), len(world.bodies)
    # A page must load quickly: motion with too many samples has no player at all.
    if not T or LIMITS.max_samples < T * N:
        return None
    samples, impacts = trajectory, list[Impact]()
    # Contacts between frames need finer samples than the video's.
    if N and T > 1 and trajectory.effort.steps * N <= LIMITS.effort:
        times = sample_times(trajectory, LIMITS.finer, max(T, LIMITS.fine_samples // N))
        samples = trajectory.resample(times)
        impacts = _largest_impacts(world, samples)
    # The page can show every overlay, so that it needs the scales of all.
    kinds = set(Overlay)
    moving = _moving(stage, trajectory)
    steps = _code_steps(samples)
    return {
        **fixed_data(scene, world),
        "steps": steps,
        "times": column(samples.times, LIMITS.instant),
        # Half a step of tolerance: the time of a frame's sample may be rounded down.
        "frames": np.searchsorted(
            samples.times, trajectory.times - LIMITS.instant / 2
        ).tolist(),
        "camera": _camera(shot),
        "bodies": [
            _body(scene, k, body, samples, steps) for k, body in enumerate(world.bodies)
        ],
        "energy": _energy(samples),
        "touches": touches(samples),
        "impacts": list(map(_impact, impacts)),
        "arrows": asdict(
            scales(world, samples, kinds, [impact.impulse for impact in impacts])
        ),
        "background": plate(stage, moving),
        "sprites": sprites(stage),
        "shadows": shadows(stage, trajectory, moving),
    }


def fixed_data(scene: Scene, world: World) -> Data:
    """Return the constant data."""
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
    """Encode multiples of `step` as differences of neighbours.

    >>> column(np.array([1.0, 1.5, 1.5, 0.0]), 0.5)
    [2, 1, 0, -3]
    """
    # Differences of the rounded values: errors do not add up.
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
    scene: Scene, k: int, body: Body, samples: Trajectory, steps: dict[str, float]
) -> Data:
    pose, velocity = samples.poses[:, k], samples.velocities[:, k]
    columns = figure(scene, k, body)
    if samples.turns.size and (samples.turns[:, k] != samples.turns[:1, k]).any():
        columns["q"] = [
            column(part, LIMITS.turn) for part in _steady(samples.turns[:, k]).T
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
    """Return a body without its motion. Outlines are relative to its centre of mass."""
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
        figure_data["rings"] = list(map(_round_points, body.rings))
        figure_data["pieces"] = list(map(_round_points, body.pieces))
    # The pose of its picture.
    if body.rest is not None:
        x, y, angle = body.rest.tolist()
        figure_data["rest"] = [round(x, 3), round(y, 3), round(angle, 6)]
    return figure_data


def _steady(turns: Array) -> Array:
    """Return quaternions (T, 4) with continuous signs. Both signs mean the same turn;
    choose the one nearer to the previous.
    """
    # The page interpolates components: a change of sign would spin the ball.
    # A change of sign holds for all later samples, up to the next change.
    signs = np.cumprod(np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0, -1.0, 1.0))
    return np.asarray(turns * np.concatenate([[1.0], signs])[:, None])


def _energy(samples: Trajectory) -> Data:
    """Return the energy. Potential energy is relative to its minimum, because only
    changes have a meaning.
    """
    e = samples.energy
    low = 0.0
    if len(e.potential):
        low = float(e.potential.min())
    rows = {
        "kinetic": e.kinetic,
        "potential": e.potential - low,
        "dissipated": e.dissipated,
        "work": e.work,
    }
    # One unit for all four curves, because the page adds and compares them.
    step = (
        max(float(np.abs(values).max(initial=0.0)) for values in rows.values())
        / LIMITS.codes
        or 1.0
    )
    return {
        "step": step,
        **{name: column(values, step) for name, values in rows.items()},
    }


def touches(samples: Trajectory) -> list[list[float | int | None]]:
    """Return first and second surface, start and end (null: beyond the clip), s, and
    total impulse, g·px/s, of each touch.
    """
    contacts = samples.contacts
    if not len(contacts.touch_pairs):
        return []
    totals = _total_impulses(samples)
    rows: list[list[float | int | None]] = []
    for (first, second), (begin, end), total in zip(
        contacts.touch_pairs.tolist(),
        contacts.touch_times.tolist(),
        totals.tolist(),
        strict=True,
    ):
        rounded_end = None
        if np.isfinite(end):
            rounded_end = round(end, 6)
        rows.append([first, second, round(begin, 6), rounded_end, _short(total)])
    return rows


def _total_impulses(samples: Trajectory) -> Array:
    """Return the sum of the impulses of each touch, (T,) g·px/s.

    The impulses of a sample belong to the latest touch of the pair before it.
    """
    contacts = samples.contacts
    surface_count = len(contacts.surfaces)
    impulse_times = samples.times[contacts.impulse_rows[:, 0]]
    codes_of_impulses = _pair_codes(contacts.impulse_rows[:, 1:3], surface_count)
    sizes = np.hypot(*contacts.impulses.T)
    codes = _pair_codes(contacts.touch_pairs, surface_count)
    begins = contacts.touch_times[:, 0]
    totals = np.zeros(len(contacts.touch_pairs))
    # Touches of one pair are sorted by their begin: bisection finds the last touch that
    # began before an impulse. An impulse in the instant of a begin belongs to it, and
    # one before the first touch to the first.
    for code in np.unique(codes).tolist():
        rows = np.flatnonzero(codes == code)
        indices = np.flatnonzero(codes_of_impulses == code)
        latest_times = impulse_times[indices] + LIMITS.instant
        positions = np.searchsorted(begins[rows], latest_times) - 1
        np.add.at(totals, rows[np.maximum(positions, 0)], sizes[indices])
    return totals


def _pair_codes(pairs: NDArray[Any], count: int) -> NDArray[np.int64]:
    """Return one number for each pair (K, 2) of `count` surfaces."""
    return np.asarray(pairs[:, 0].astype(np.int64) * count + pairs[:, 1])


def _impact(impact: Impact) -> list[float | int]:
    x, y = impact.place.tolist()
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
        {"name": wall.name, "chains": list(map(_round_points, wall.chains))}
        for wall in world.walls
    ]


def _pushes(world: World) -> list[Data]:
    """Return the forces, impulses and torques on dynamic bodies, with their times."""
    return [
        {
            "body": push.body,
            "load": push.load.value,
            "vector": list(map(_short, push.vector.tolist())),
            "torque": _short(push.torque),
            "at": [round(v, 2) for v in push.point.tolist()],
            "start": push.start,
            "end": push.start
            if push.load is Load.IMPULSE
            else min(push.end, world.duration),
        }
        for push in world.pushes
        if world.bodies[push.body].motion is Motion.DYNAMIC
    ]


def _joints(world: World) -> list[Data]:
    """Return the ends of joints in the frames of their bodies, or in the photo for the
    world.
    """
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
            "vector": list(map(_short, field.vector.tolist())),
        }
        for field in world.fields
        if field.kind in (FieldKind.WIND, FieldKind.ATTRACTOR)
    ]


def _camera(shot: Shot) -> list[list[float]] | None:
    """Return left, top, width, height, px, of each frame's camera view.

    Return None if all views show the whole photo.
    """
    views: list[list[float]] = []
    for time in shot.times.tolist():
        # The camera maps a photo place p to large * p + shift. Pixel -0.5 of the video
        # is its border: invert the map there.
        (large, _, x), (_, _, y) = shot.affine(time)
        left, top = (-0.5 - x) / large, (-0.5 - y) / large
        views.append(
            [
                round(float(v), 2)
                for v in (left, top, shot.video[0] / large, shot.video[1] / large)
            ]
        )
    # A view that differs by less than a pixel is the whole photo.
    canvas = [-0.5, -0.5, *map(float, shot.photo)]
    if np.abs(np.array(views) - canvas).max(initial=0.0) > 1.0:
        return views
    return None
