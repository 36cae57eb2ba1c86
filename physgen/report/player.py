"""Scene, World, Trajectory, Stage, Shot -> the player's data: one JSON object that a page carries.

Places are px of the photo, its top-left pixel's centre the origin. Columns of numbers are whole multiples of a step,
each given as its difference from the one before. Rounded like that, a place is off by 1/64 px at most, an angle by
1/8192 rad, a velocity by 1/16000 of the largest; between samples places and angles change evenly, and there are samples
whenever things begin to touch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.render.scales import scales
from physgen.render.shot import Shot
from physgen.render.stage import Stage
from physgen.render.touches import Blow, blows, moments
from physgen.report.cutouts import cutouts
from physgen.scene.model import FieldKind, Load, Motion, Overlay, Scene, Solid, View
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]

FINER = 4
"""Times a frame that the player knows where things are."""
FEW = 40_000
"""Samples times objects of such a closer look."""
EFFORT = 200_000
"""Steps times objects of a run up to which it is looked at so closely: where it must be run again, some seconds."""
BLOWS = 500
"""The strongest that a page carries."""
MOST = 1_000_000
"""Samples times objects that a page can carry at all."""
PLACE, ANGLE, INSTANT = 1 / 32, 1 / 4096, 1e-6
"""px, rad and s: steps to which poses and times are rounded."""
TURN = 1 / 2048
"""Step of the parts of a quaternion."""
CODES = 8000
"""Steps of the largest speed, and of the range of an energy."""
OUTLINE = 0.05
"""px to which outlines are rounded."""

Data = dict[str, Any]


def player_data(
    scene: Scene,
    world: World,
    trajectory: Trajectory,
    stage: Stage,
    shot: Shot,
    sampled: Callable[[Array], Trajectory],
) -> Data | None:
    """Everything the page's script needs; None where there is no frame, or more than a page can carry.

    `trajectory` has one sample a frame played forward, and `sampled` gives the same motion at more times; heaps of
    hundreds are shown as their frames know them, without blows.
    """
    T, N = len(trajectory.times), len(world.bodies)
    if not T or T * N > MOST:
        return None
    seen, struck = trajectory, list[Blow]()
    if N and T > 1 and trajectory.effort.steps * N <= EFFORT:
        seen = sampled(moments(trajectory, FINER, max(T, FEW // N)))
        struck = blows(world, seen, world.duration / max(len(world.times), 1) / FINER)
        struck = sorted(sorted(struck, key=lambda blow: -blow.impulse)[:BLOWS], key=lambda blow: blow.time)
    kinds = set(Overlay)
    drawn = cutouts(stage, trajectory)
    fastest = float(np.abs(seen.velocities[..., :2]).max(initial=0.0))
    spin = float(np.abs(seen.velocities[..., 2]).max(initial=0.0))
    steps = {
        "turn": TURN,
        "time": INSTANT,
        "place": PLACE,
        "angle": ANGLE,
        "speed": fastest / CODES or 1.0,
        "spin": spin / CODES or 1.0,
    }
    return {
        "name": scene.name,
        "size": list(world.size),
        "scale": world.pixels_per_meter if "world.pixels_per_meter" in scene.places else None,
        "gravity": world.gravity.tolist(),
        "top": world.view is View.TOP,
        "steps": steps,
        "times": column(seen.times, INSTANT),
        "frames": np.searchsorted(seen.times, trajectory.times - INSTANT / 2).tolist(),
        "clip": {"fps": scene.render.fps, "order": scene.render.play.value},
        "camera": _camera(shot),
        "bodies": [_body(scene, k, body, seen, steps) for k, body in enumerate(world.bodies)],
        "walls": walls(world),
        "energy": _energy(seen),
        "touches": touches(seen),
        "blows": [_blow(blow) for blow in struck],
        "pushes": pushes(world),
        "joints": joints(world),
        "fields": fields(world),
        "arrows": asdict(scales(world, seen, kinds, [blow.impulse for blow in struck])),
        "background": drawn.background,
        "sprites": drawn.sprites,
        "shadows": drawn.shadows,
    }


def column(values: Array, step: float) -> list[int]:
    """Multiples of `step`, each less the one before.

    >>> column(np.array([1.0, 1.5, 1.5, 0.0]), 0.5)
    [2, 1, 0, -3]
    """
    codes = np.rint(np.asarray(values, np.float64) / step).astype(np.int64)
    return np.diff(codes, prepend=0).tolist()  # type: ignore[no-any-return]


def _short(value: float, digits: int = 5) -> float:
    return float(f"{value:.{digits}g}")


def _rounded(points: Array) -> list[list[float]]:
    return [[round(round(v / OUTLINE) * OUTLINE, 2) for v in point] for point in points.tolist()]


def _body(scene: Scene, k: int, body: Body, seen: Trajectory, steps: dict[str, float]) -> Data:
    pose, velocity = seen.poses[:, k], seen.velocities[:, k]
    found = figure(scene, k, body)
    if seen.turns.size and (seen.turns[:, k] != seen.turns[:1, k]).any():
        found["q"] = [column(part, TURN) for part in _steady(seen.turns[:, k]).T]
    for name, values, kind in (
        ("x", pose[:, 0], "place"),
        ("y", pose[:, 1], "place"),
        ("a", pose[:, 2], "angle"),
        ("vx", velocity[:, 0], "speed"),
        ("vy", velocity[:, 1], "speed"),
        ("w", velocity[:, 2], "spin"),
    ):
        found[name] = column(values, steps[kind])
    return found


def figure(scene: Scene, k: int, body: Body) -> Data:
    """What a body is, without its motion; outlines are about its centre of mass."""
    found: Data = {
        "name": body.name,
        "label": scene.objects[k].label,
        "motion": body.motion.value,
        "mass": _short(body.mass, 6),
        "ball": body.solid is Solid.SPHERE and body.radius is not None,
    }
    if body.radius is not None:
        found["radius"] = round(body.radius, 3)
    else:
        found["rings"] = [_rounded(ring) for ring in body.rings]
        found["pieces"] = [_rounded(piece) for piece in body.pieces]
    if body.rest is not None:  # the pose in which its picture was cut out
        x, y, angle = body.rest.tolist()
        found["rest"] = [round(x, 3), round(y, 3), round(angle, 6)]
    return found


def _steady(turns: Array) -> Array:
    """(T, 4) of the two quaternions that mean a turn, the one that is nearer to that before."""
    signs = np.cumprod(np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0, -1.0, 1.0))
    return np.asarray(turns * np.concatenate([[1.0], signs])[:, None])


def _energy(seen: Trajectory) -> Data:
    """Potential energy counts from its least: only its changes mean anything."""
    e = seen.energy
    low = float(e.potential.min()) if len(e.potential) else 0.0
    rows = {"kinetic": e.kinetic, "potential": e.potential - low, "dissipated": e.dissipated, "work": e.work}
    step = max(float(np.abs(values).max(initial=0.0)) for values in rows.values()) / CODES or 1.0
    return {"step": step, **{name: column(values, step) for name, values in rows.items()}}


def touches(seen: Trajectory) -> list[list[float | int | None]]:
    """First and second surface, begin and end (null: beyond the clip), s, and all that they gave each other, g·px/s."""
    contacts, N = seen.contacts, len(seen.contacts.surfaces)
    if not len(contacts.touch_pairs):
        return []
    when = seen.times[contacts.impulse_rows[:, 0]]
    pair = contacts.impulse_rows[:, 1].astype(np.int64) * N + contacts.impulse_rows[:, 2]
    size = np.hypot(*contacts.impulses.T)
    begins: dict[int, list[tuple[float, int]]] = {}
    for row, ((first, second), (begin, _)) in enumerate(
        zip(contacts.touch_pairs.tolist(), contacts.touch_times.tolist(), strict=True)
    ):
        begins.setdefault(first * N + second, []).append((begin, row))
    total = np.zeros(len(contacts.touch_pairs))
    for (
        key,
        mine,
    ) in begins.items():  # what was given up to a sample belongs to the touch begun last before it
        of = np.flatnonzero(pair == key)
        at = np.searchsorted([begin for begin, _ in mine], when[of] + INSTANT) - 1
        np.add.at(total, np.array([row for _, row in mine])[np.maximum(at, 0)], size[of])
    return [
        [first, second, round(begin, 6), round(end, 6) if np.isfinite(end) else None, _short(given)]
        for (first, second), (begin, end), given in zip(
            contacts.touch_pairs.tolist(), contacts.touch_times.tolist(), total.tolist(), strict=True
        )
    ]


def _blow(blow: Blow) -> list[float | int]:
    x, y = blow.at.tolist()
    return [round(blow.time, 6), round(x, 2), round(y, 2), _short(blow.impulse), *blow.pair]


def walls(world: World) -> list[Data]:
    """Boundaries as chains of points."""
    return [{"name": wall.name, "chains": [_rounded(chain) for chain in wall.chains]} for wall in world.walls]


def pushes(world: World) -> list[Data]:
    """Forces, impulses and torques of the scene while they act."""
    return [
        {
            "body": push.body,
            "load": push.load.value,
            "vector": [_short(v) for v in push.vector.tolist()],
            "torque": _short(push.torque),
            "at": [round(v, 2) for v in push.at.tolist()],
            "start": push.start,
            "end": push.start if push.load is Load.IMPULSE else min(push.end, world.duration),
        }
        for push in world.pushes
        if world.bodies[push.body].motion is Motion.DYNAMIC
    ]


def joints(world: World) -> list[Data]:
    """Ends in the frames of the two bodies; of the photo where the second is the world."""
    return [
        {
            "name": joint.name,
            "kind": joint.kind.value,
            "first": joint.first,
            "second": joint.second,
            "ends": _rounded(np.stack([joint.first_at, joint.second_at])),
        }
        for joint in world.joints
    ]


def fields(world: World) -> list[Data]:
    """Wind and attractors."""
    return [
        {
            "name": field.name,
            "wind": field.kind is FieldKind.WIND,
            "vector": [_short(v) for v in field.vector.tolist()],
        }
        for field in world.fields
    ]


def _camera(shot: Shot) -> list[list[float]] | None:
    """Left, top, width, height, px, of what each frame of the trajectory shows; None where that is all of the photo."""
    views: list[list[float]] = []
    for time in shot.times.tolist():
        (large, _, x), (_, _, y) = shot.affine(time)
        left, top = (-0.5 - x) / large, (-0.5 - y) / large
        views.append([round(float(v), 2) for v in (left, top, shot.video[0] / large, shot.video[1] / large)])
    whole = [-0.5, -0.5, *map(float, shot.photo)]
    return views if _differ(views, whole) else None


def _differ(views: Sequence[Sequence[float]], whole: Sequence[float]) -> bool:
    return bool(np.abs(np.array(views) - whole).max(initial=0.0) > 1.0)
