"""World and its first moment -> the red arrows of the paper: velocities, and what pushes, at t = 0.

Velocities are full, forces and impulses hollow; a white rim keeps both legible on any photo.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.render.marks import HEAD, arc, arrow, head
from physgen.render.scales import SWEEP, Scales, largest_round, scales
from physgen.report.plots.look import HALO, RED
from physgen.report.plots.units import ENERGY, IMPULSE, SPEED, Quantity, Units
from physgen.scene.model import Load, Motion, Overlay
from physgen.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

FORCE = Quantity("g·px/s²", "N", 1, 1)
TORQUE = replace(ENERGY, si="N·m")
SHAFT, RIM = 1.15, 0.7
"""Points: the width of a shaft, and of the white around it."""
SHORT = 2.0
"""Points: shorter arrows are not drawn."""
SAMPLE = 0.11
"""Of the picture's longer side: how long an arrow of the key is at most."""


@dataclass(frozen=True)
class Arrow:
    """One, px of the photo."""

    tail: Array
    """(2,)."""
    way: Array
    """(2,): from its tail to its point; of a torque, (sweep in rad, radius)."""
    load: Load | None
    """None: a velocity."""


@dataclass(frozen=True)
class Arrows:
    """All of one picture, and the lengths they are drawn with."""

    found: tuple[Arrow, ...]
    scales: Scales


def arrows(world: World, trajectory: Trajectory) -> Arrows:
    """Of what moves, and of what is pushed, at t = 0."""
    now = tuple(push for push in world.pushes if push.start <= 1e-9)
    moving = [body for body in world.bodies if body.motion is not Motion.STATIC]
    # those of the scene: what an impulse gives at once is told by the impulse
    speeds = np.array([_velocity(body, trajectory) for body in moving]).reshape(1, -1, 2)
    start = replace(
        trajectory,
        poses=np.array([[*body.center, 0.0] for body in moving]).reshape(1, -1, 3),
        velocities=np.concatenate([speeds, np.zeros((1, len(moving), 1))], axis=2),
    )
    size = scales(replace(world, pushes=now), start, (Overlay.VELOCITY, Overlay.FORCES), ())
    found = [
        Arrow(body.center, size.velocity * speed, None)
        for body, speed in zip(moving, speeds[0], strict=True)
        if speed.any()
    ]
    per = {Load.FORCE: size.force, Load.IMPULSE: size.impulse}
    for push in now:
        body = world.bodies[push.body]
        if body.motion is not Motion.DYNAMIC:
            continue
        if push.load is Load.TORQUE:
            way = np.array([size.torque * push.torque, min(1.25 * body.reach, 0.2 * max(world.size))])
            found.append(Arrow(body.center, way, push.load))
        else:
            found.append(Arrow(body.center + push.at, per[push.load] * push.vector, push.load))
    return Arrows(tuple(found), size)


def _velocity(body: Body, trajectory: Trajectory) -> Array:
    """(2,) px/s: that of a script, or the scene's own."""
    if body.motion is Motion.SCRIPTED and len(trajectory.times):
        return np.asarray(trajectory.velocities[0, trajectory.names.index(body.name), :2])
    return body.velocity


def draw(axes: Axes, of: Arrows, lens: Array, point: float, photo: float) -> None:
    """On axes whose units are px of a frame; `lens` (2, 3) takes the photo's px there, `point` px are a point.

    `photo` px of the frame are a px of the photo seen whole: the measure of arrows.
    """
    for one in of.found:
        tail = lens[:, :2] @ one.tail + lens[:, 2]
        if one.load is Load.TORQUE:
            sweep, radius = one.way.tolist()
            if abs(sweep) * radius * photo > SHORT * point:
                _curved(axes, arc(tail, radius * photo, sweep), point)
        elif np.hypot(*one.way) * photo > SHORT * point:
            tip = tail + one.way * photo
            _patch(axes, arrow(tail, tip, SHAFT * point), one.load is not None, point)


def key(of: Arrows, units: Units, side: float) -> list[tuple[float, bool, str]]:
    """For each kind there: px of the photo of a sample, whether it is hollow, and what it stands for."""
    there = {one.load for one in of.found}
    rows: Sequence[tuple[Load | None, str, float, Quantity, float]] = (
        (None, "velocity", of.scales.velocity, SPEED, SAMPLE * side),
        (Load.FORCE, "force", of.scales.force, FORCE, SAMPLE * side),
        (Load.IMPULSE, "impulse", of.scales.impulse, IMPULSE, SAMPLE * side),
        (Load.TORQUE, "torque", of.scales.torque, TORQUE, SWEEP),
    )
    entries = []
    for load, name, size, quantity, most in rows:
        if load not in there or size <= 0:
            continue
        per = 1.0 if units.meter is None else quantity.per(units.meter)
        value = largest_round(most / (size * per)) * per
        length = value * size if load is not Load.TORQUE else 0.0
        entries.append((length, load is not None, f"{name} {units.said(quantity, value)}"))
    return entries


def sample(axes: Axes, at: tuple[float, float], length: float, hollow: bool, point: float) -> None:
    """An arrow of the key, on axes in px of a frame."""
    tail = np.array(at)
    _patch(axes, arrow(tail, tail + np.array([length, 0.0]), SHAFT * point), hollow, point)


def _patch(axes: Axes, outline: Array, hollow: bool, point: float) -> None:
    from matplotlib.patches import Polygon

    fill, edge = (HALO, RED) if hollow else (RED, "none")
    thin = 0.9 if hollow else 0.0
    axes.add_patch(
        Polygon(outline, closed=True, facecolor=fill, edgecolor=edge, linewidth=thin, joinstyle="miter",
                path_effects=_rim(thin), zorder=5)
    )  # fmt: skip


def _curved(axes: Axes, path: Array, point: float) -> None:
    """A torque's: hollow, too, since it pushes."""
    length = HEAD * SHAFT * point
    left = np.cumsum(np.hypot(*np.diff(path, axis=0).T)[::-1])[::-1]
    root = int(np.flatnonzero(left >= min(0.8 * length, 0.6 * left[0]))[-1])
    axes.plot(*path[: root + 1].T, color=RED, linewidth=SHAFT, path_effects=_rim(SHAFT), zorder=5)
    _patch(axes, head(path[-1], path[-1] - path[root], min(length, 0.62 * float(left[0]))), True, point)


def _rim(width: float) -> list[Any]:
    from matplotlib import patheffects

    return [patheffects.Stroke(linewidth=width + 2 * RIM, foreground=HALO), patheffects.Normal()]
