"""Scenes, worlds and trajectories as self-contained SVG, for notebooks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.appearance import photo_poses
from physgen.compile.world import World
from physgen.render.drawing import arrow
from physgen.report.html import fitted, jpeg, template
from physgen.report.parameters import arrows, constraint_drawing, outlines, svg_points
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]

SIDE = 720
"""px: the longer side of the photo, at most."""
LINES = ("#0072b2", "#d55e00", "#009e73", "#b0508f", "#e69f00", "#56b4e9", "#7f7f7f")
"""After Okabe and Ito: distinct for colour-blind eyes, and legible on white and on black."""
MOST_NAMES = 14
"""Of the legend."""
MOST_POINTS = 400
"""Of one path."""
STILL = 2.0
"""px: an object that moves less has no path."""


def scene_svg(scene: Scene, world: World, photo: U8 | None) -> str:
    """`photo` (H, W, 3) sRGB, None without one; it is left out where objects are placed elsewhere at t = 0."""
    photo = None if photo_poses(world) else photo
    labels = {item.name: item.label for item in scene.objects}
    return _svg(world, labels, photo, constraint_drawing(scene, world), f"The scene {scene.name}")


def world_svg(world: World) -> str:
    """Outlines, walls, velocities and forces on white."""
    return _svg(world, {}, None, {"lines": [], "dots": [], "arrows": []}, "The world")


def paths_svg(trajectory: Trajectory) -> tuple[str, list[tuple[str, str]]]:
    """The paths of moving objects, and the first names with their colours."""
    poses = np.asarray(trajectory.poses)
    moving: list[int] = []
    if len(poses):
        moving = np.flatnonzero(np.ptp(poses[..., :2], axis=0).max(axis=-1) > STILL).tolist()
    shown = poses[:: max(1, -(-len(poses) // MOST_POINTS))]
    shown = np.concatenate([shown, poses[-1:]])
    places = poses[..., :2].reshape(-1, 2) if poses.size else np.zeros((1, 2))
    low, high = places.min(axis=0), places.max(axis=0)
    margin = 0.06 * float(max(*(high - low), 20.0))
    x, y, width, height = (round(float(v), 1) for v in (*(low - margin), *(high - low + 2 * margin)))
    paths = [
        {
            "name": trajectory.names[body],
            "colour": LINES[k % len(LINES)],
            "points": svg_points(shown[:, body, :2]),
            "begin": _point(poses[0, body]),
            "end": _point(poses[-1, body]),
        }
        for k, body in enumerate(moving)
    ]
    still = [_point(pose) for body, pose in enumerate(poses[0] if len(poses) else ()) if body not in moving]
    unit = round(max(width, height) / 120, 3)
    svg: str = template("paths.svg.j2").render(box=(x, y, width, height), paths=paths, still=still, unit=unit)
    names = [(str(path["name"]), str(path["colour"])) for path in paths]
    more = [(f"and {len(names) - MOST_NAMES} more", "none")] if len(names) > MOST_NAMES else []
    return svg, names[:MOST_NAMES] + more


def _svg(
    world: World, labels: dict[str, str], photo: U8 | None, held: dict[str, list[dict[str, Any]]], title: str
) -> str:
    svg: str = template("scene.svg.j2").render(
        title=title,
        size=world.size,
        photo=None if photo is None else jpeg(fitted(photo, SIDE), 84),
        walls=[
            {"name": wall.name, "chains": [svg_points(chain) for chain in wall.chains]}
            for wall in world.walls
        ],
        objects=outlines(world, labels),
        held=held,
        arrows=[
            {"kind": kind, "path": f"M{svg_points(arrow(tail, tip, max(world.size) / 160))}Z", "title": title}
            for kind, tail, tip, title in arrows(world)
        ],
        unit=round(max(world.size) / 400, 3),
    )
    return svg


def _point(pose: Array) -> dict[str, float]:
    return {"x": round(float(pose[0]), 2), "y": round(float(pose[1]), 2)}
