"""The order in which pushes are tried, by the room and the objects ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from typing import TYPE_CHECKING

import numpy as np

from physgen.materials import is_living
from physgen.pipeline.push_outcomes import (
    SIDES,
    TRIAL,
    Array,
    Direction,
    TrialScene,
)
from physgen.scene.scene import Motion, Object, Scene, View

if TYPE_CHECKING:
    from physgen.compile.world import Body


@dataclass(frozen=True)
class RankWeights:
    """Weights for the surroundings of an object; lengths are shares of the
    longer side.
    """

    room: float = 0.3
    """Free distance ahead with full weight."""
    room_beyond: float = 0.1
    """Weight of the room behind the last object ahead, for its fall."""
    ahead: float = 1.5
    """Weight of objects ahead, relative to a free path: they will be struck."""
    load_weight: float = 0.5
    """Weight of an object jammed under others in the side view."""
    side_share: float = 0.1
    """Smallest share of an object's width in the path to be ahead."""
    touch: float = 2.0
    """Gap between objects on each other, px."""


RANK = RankWeights()


def rank_pushes(
    trials: TrialScene, confidence: Mapping[str, float]
) -> list[tuple[Object, Direction]]:
    """Return objects with directions of pushes, the most promising first."""
    scene, bodies = trials.scene, trials.world.bodies
    corners = [np.concatenate(body.rings) + body.center for body in bodies]
    scored_pushes: list[tuple[float, int, Object, Direction]] = []
    for k, item in enumerate(scene.objects):
        object_confidence = confidence.get(item.name, 1.0)
        if item.motion is not Motion.DYNAMIC or object_confidence < TRIAL.confidence:
            continue
        if is_living(item.label):
            continue
        # Prefer objects without others on top, which would fall with them.
        weight = object_confidence * (
            RANK.load_weight if has_load(scene, corners, k) else 1.0
        )
        barred_side = SIDES.get(trials.barred_sides.get(item.name, ""), 0.0)
        for direction in _directions(scene, bodies, k):
            if barred_side * direction[0] > 0:
                continue
            score = weight * _room_score(trials, corners, k, direction)
            # The negative count sorts pushes of equal score in the order of the file,
            # so that the result is reproducible.
            scored_pushes.append((score, -len(scored_pushes), item, direction))
    scored_pushes.sort(key=lambda one: one[:2], reverse=True)
    return [(item, direction) for _, _, item, direction in scored_pushes]


def has_load(scene: Scene, corners: Sequence[Array], k: int) -> bool:
    """Check whether another object lies on an object in the side view."""
    if scene.world.view is not View.SIDE:
        return False
    left, top = corners[k].min(axis=0)
    right = corners[k][:, 0].max()
    for n, points in enumerate(corners):
        (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
        # Boxes around outlines meet only roughly: allow a tenth of the upper object's
        # height.
        is_near = abs(y1 - top) < RANK.touch + 0.1 * (y1 - y0)
        if n != k and is_near and x0 < right and x1 > left:
            return True
    return False


def loaded_names(trials: TrialScene) -> set[str]:
    """Return the names of objects on which others lie."""
    corners = [np.concatenate(body.rings) + body.center for body in trials.world.bodies]
    objects = enumerate(trials.scene.objects)
    names = set()
    for k, item in objects:
        if has_load(trials.scene, corners, k):
            names.add(item.name)
    return names


def _directions(scene: Scene, bodies: Sequence[Body], k: int) -> list[Direction]:
    """Return the unit directions of possible pushes of an object.

    In the side view they are level; in the top view they point to the nearest object,
    to the centre of all objects, and to the centre of the photo.
    """
    if scene.world.view is View.SIDE:
        return [(1.0, 0.0), (-1.0, 0.0)]
    center = bodies[k].center
    others = []
    for n, body in enumerate(bodies):
        if n != k:
            others.append(body.center)
    middle = (np.array(scene.size) - 1) / 2
    # From above, push towards the nearest object, the middle of all others and the
    # middle of the photo.
    goals = [middle]
    if others:
        distances = [float(np.hypot(*(other - center))) for other in others]
        goals = [others[int(np.argmin(distances))], np.mean(others, axis=0), middle]
    directions: list[Direction] = []
    for goal in goals:
        x, y = (float(part) for part in goal - center)
        length = hypot(x, y)
        directions.append((x / length, y / length) if length > 1 else (1.0, 0.0))
    return list(dict.fromkeys(directions))


def _room_score(
    trials: TrialScene, corners: Sequence[Array], k: int, direction: Direction
) -> float:
    """Return a score of the free path and the objects ahead of an object."""
    # In axes along and across the push, the picture's end and other objects are
    # intervals.
    frame = np.array([direction, (-direction[1], direction[0])])
    turned_corners = [points @ frame.T for points in corners]
    lower_corners = np.array([points.min(axis=0) for points in turned_corners])
    upper_corners = np.array([points.max(axis=0) for points in turned_corners])
    objects_ahead = _objects_ahead(lower_corners, upper_corners, k)
    picture_end = max(np.array([[0, 0], trials.scene.size]) @ frame[0])
    full_room = RANK.room * trials.side
    # The free path ends at the border of the picture or at the first object ahead.
    room = picture_end - trials.world.bodies[k].center @ frame[0]
    last_edge = upper_corners[k, 0]
    for n in objects_ahead:
        room = min(room, lower_corners[n, 0] - upper_corners[k, 0])
        last_edge = max(last_edge, upper_corners[n, 0])
    free_share = float(np.clip(room / full_room, 0, 1))
    room_beyond = float(np.clip((picture_end - last_edge) / full_room, 0, 1))
    # Objects ahead make a better story, each further one half as much as the one
    # before: 1 - 0.5^n.
    return (
        free_share
        + RANK.room_beyond * room_beyond
        + RANK.ahead * (1 - 0.5 ** len(objects_ahead))
    )


def _objects_ahead(lower_corners: Array, upper_corners: Array, k: int) -> list[int]:
    """Return the indices of objects in the path of object k.

    Corners (N, 2) are those of boxes, in axes along and across the path.
    """
    overlaps = np.minimum(upper_corners, upper_corners[k]) - np.maximum(
        lower_corners, lower_corners[k]
    )
    widths = (upper_corners - lower_corners)[:, 1]
    is_in_path = overlaps[:, 1] > RANK.side_share * widths
    is_ahead = is_in_path & (lower_corners[:, 0] > upper_corners[k, 0] - RANK.touch)
    return [n for n in np.flatnonzero(is_ahead).tolist() if n != k]
