"""Scenes, worlds and trajectories as self-contained SVG."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.appearance import photo_poses
from physgen.compile.world import World
from physgen.render.drawing import arrow
from physgen.report.html import jpeg, template
from physgen.report.parameters import constraint_drawing
from physgen.scene.scene import Load, Scene

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]

SIDE = 720
"""px: the longer side of the photo in it, at most."""
LONGEST_ARROW = 0.14
"""Of the canvas's diagonal."""
LINES = ("#0072b2", "#d55e00", "#009e73", "#b0508f", "#e69f00", "#56b4e9", "#7f7f7f")
"""After Okabe and Ito: told apart by colour-blind eyes, and legible on white and on black."""
MOST_NAMES = 14
MOST_POINTS = 400
"""Of one path."""
STILL = 2.0
"""px: what moves less has no path."""


def scene_svg(scene: Scene, world: World, photo: U8 | None) -> str:
    """`photo` (H, W, 3) sRGB, None for a scene without one; it is left out where things are put elsewhere at t = 0."""
    photo = None if photo_poses(world) else photo
    labels = {item.name: item.label for item in scene.objects}
    return _drawn(world, labels, photo, constraint_drawing(scene, world), f"The scene {scene.name}")


def world_svg(world: World) -> str:
    """Outlines, walls, velocities and forces on paper."""
    return _drawn(world, {}, None, {"lines": [], "dots": [], "arrows": []}, "The world")


def paths_svg(trajectory: Any) -> tuple[str, list[tuple[str, str]]]:
    """The ways of what moves, and the first few names with their colours."""
    poses = np.asarray(trajectory.poses)
    moving = (
        np.flatnonzero(np.ptp(poses[..., :2], axis=0).max(axis=-1) > STILL)
        if len(poses)
        else np.zeros(0, int)
    )
    shown = poses[:: max(1, -(-len(poses) // MOST_POINTS))]
    if len(poses):
        shown = np.concatenate([shown, poses[-1:]])
    spots = poses[..., :2].reshape(-1, 2) if poses.size else np.zeros((1, 2))
    low, high = spots.min(axis=0), spots.max(axis=0)
    margin = 0.06 * float(max(*(high - low), 20.0))
    x, y, width, height = (round(float(v), 1) for v in (*(low - margin), *(high - low + 2 * margin)))
    paths = [
        {
            "name": trajectory.names[body],
            "colour": LINES[k % len(LINES)],
            "points": _points(shown[:, body, :2]),
            "begin": _point(poses[0, body]),
            "end": _point(poses[-1, body]),
        }
        for k, body in enumerate(moving.tolist())
    ]
    still = (
        [_point(poses[0, body]) for body in range(poses.shape[1]) if body not in moving] if len(poses) else []
    )
    svg: str = template("paths.svg.j2").render(
        box=(x, y, width, height), paths=paths, still=still, unit=round(max(width, height) / 120, 3)
    )
    names = [(path["name"], path["colour"]) for path in paths]
    more = [(f"and {len(names) - MOST_NAMES} more", "none")] if len(names) > MOST_NAMES else []
    return svg, names[:MOST_NAMES] + more


def _drawn(
    world: World, labels: dict[str, str], photo: U8 | None, held: dict[str, list[dict[str, Any]]], title: str
) -> str:
    svg: str = template("scene.svg.j2").render(
        title=title,
        size=world.size,
        photo=None if photo is None else _small(photo),
        walls=[
            {"name": wall.name, "chains": [_points(chain) for chain in wall.chains]} for wall in world.walls
        ],
        objects=[
            {
                "name": body.name,
                "label": labels.get(body.name, ""),
                "motion": body.motion.value,
                "path": " ".join(f"M{_points(ring + body.center)}Z" for ring in body.rings),
            }
            for body in world.bodies
        ],
        held=held,
        arrows=_arrows(world),
        unit=round(max(world.size) / 400, 3),
    )
    return svg


def _arrows(world: World) -> list[dict[str, str]]:
    """Velocities and forces as outlines, each kind to a scale of its own."""
    found: dict[str, list[tuple[Array, Array, str]]] = {"velocity": [], "force": []}
    for body in world.bodies:
        if body.velocity.any():
            told = f"{body.name}: {body.velocity[0]:g}, {body.velocity[1]:g} px/s"
            found["velocity"].append((body.center, body.velocity, told))
    for push in world.pushes:
        if push.load is not Load.TORQUE and push.vector.any():
            body, unit = world.bodies[push.body], "g·px/s" if push.load is Load.IMPULSE else "g·px/s²"
            told = f"{push.load.value} on {body.name}: {push.vector[0]:g}, {push.vector[1]:g} {unit}"
            found["force"].append((body.center + push.at, push.vector, f"{told} from {push.start:g} s"))
    longest, width = LONGEST_ARROW * float(np.hypot(*world.size)), max(world.size) / 160
    drawn_arrows = []
    for kind, rows in found.items():
        most = max((float(np.hypot(*vector)) for _, vector, _ in rows), default=0.0)
        for tail, vector, told in rows:
            outline = arrow(tail, tail + vector / most * longest, width)
            drawn_arrows.append({"kind": kind, "path": f"M{_points(outline)}Z", "title": told})
    return drawn_arrows


def _small(photo: U8) -> str:
    """As a data URI."""
    height, width = photo.shape[:2]
    scale = min(1.0, SIDE / max(height, width))
    if scale < 1:
        size = max(1, round(width * scale)), max(1, round(height * scale))
        photo = np.asarray(cv2.resize(photo, size, interpolation=cv2.INTER_AREA), np.uint8)
    return jpeg(photo, 84)


def _points(points: Array) -> str:
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in points)


def _point(pose: Sequence[float] | Array) -> dict[str, float]:
    return {"x": round(float(pose[0]), 2), "y": round(float(pose[1]), 2)}
