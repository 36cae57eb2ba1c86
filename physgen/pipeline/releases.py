"""Release of one held object on a floor of its own, if nothing else of a photo can
move.

Perception holds an object if no visible support would keep it from falling: the lower
border of its mask is ragged, or its ground is not recognised. A viewer still sees that
it stands. The object is released on a level floor through its lowest point, and all
other objects are held.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from math import hypot, radians, sin, sqrt
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from physgen.compile.compile import compile_shapes
from physgen.compile.shapes import shapes_of
from physgen.geometry.fitting import fit_outlines
from physgen.geometry.polygon import Disc, Outline, bounds
from physgen.geometry.scale import PhotoObject
from physgen.materials import is_living, kind
from physgen.perceive.shape_entries import corners, shape_entry
from physgen.perceive.summary import mask_confidence
from physgen.perceive.support.flat_bases import add_base, needs_base
from physgen.perceive.support.ground_contact import Line, find_foot
from physgen.perceive.support.level_feet import straighten_foot
from physgen.pipeline.push_outcomes import TRIAL
from physgen.pipeline.trial_scenes import open_trial
from physgen.pipeline.verdicts import part_owners
from physgen.problems import InputError
from physgen.scene.construction import EARTH
from physgen.scene.scene import View

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physgen.perceive.roles import Labels, PerceivedScene
    from physgen.pipeline.pushes import Push


@dataclass(frozen=True)
class ReleaseLimits:
    """Limits for released objects and their bases."""

    confidence: float = 0.2
    """Least confidence of an object: below it, the object is rather a part or a
    patch.
    """
    certainty: float = TRIAL.confidence
    """Least confidence that a released object counts with in the choice of a push."""
    max_trials: int = 3
    """Number of objects to try: each takes the time of a search."""
    rags: tuple[float, ...] = (0.04, 0.12)
    """Heights of an object's levelled lower border, by the object's height: the second
    if the object does not rest with the first.
    """
    part: float = 0.35
    """Share of an object's area up to which an unsure object beside it is a part."""
    part_confidence: float = 0.7
    """Confidence below which an object can be such a part."""
    touch: float = 0.1
    """Smallest share of a part's border at its object."""
    friction: float = 0.6
    """Friction of the floor, equal to that of perceived floors."""
    torn_weight: float = 0.4
    """Weight of an object with parts that may stay behind, in the order of releases
    and in the choice of a push.
    """
    floor_confidence: float = 0.3
    """Confidence of the floor, for `from`."""
    oblique: float = 30.0
    """Least angle of the camera, degrees, at which objects pass each other."""
    depth: float = 0.35
    """Largest distance on the ground between objects that meet, over the sum of their
    smaller sides.
    """
    foot: float = 0.12
    """Part of an object's height, from below, that is its foot ..."""
    gap: float = 0.06
    """... and largest gap below the foot, by the object's height."""
    carrier_share: float = 0.5
    """Least share of a foot's columns above the object that seems to carry it."""
    road_slopes: tuple[float, float] = (0.02, 0.25)
    """Slopes of a line below wheels: a smaller one is level, a larger one no road."""
    side_width: float = 0.5
    """Width, by that of the foot, of the places beside it where its carrier shows."""


RELEASE = ReleaseLimits()
FLOOR = "floor"
FEWEST_WHEELS = 2
MOVING, NEAR = "moving", "near"
"""Collision groups of what moves and of what it may meet."""


def releases(
    photo_scene: PerceivedScene, refused_names: Collection[str]
) -> Iterator[tuple[str, PerceivedScene]]:
    """Yield scenes in which one object is released on a floor, the surest object first.

    Each object comes twice: the second time, more of its lower border is level.
    Objects in `refused_names`, living objects and objects cut off by the photo's border
    are not released.
    """
    if photo_scene.document["world"]["view"] != View.SIDE.value:
        return
    sorted_names = _rank_releasable_objects(photo_scene, refused_names)
    if is_oblique(photo_scene):
        sorted_names.sort(key=lambda name: -_low(photo_scene, name))
    for name in sorted_names[: RELEASE.max_trials]:
        if name not in photo_scene.document["objects"]:
            continue
        # An object whose outline cannot be made level is skipped.
        with suppress(InputError):
            merged_scene = _with_parts(photo_scene, name)
            for rag in RELEASE.rags:
                yield name, _release_object(merged_scene, name, rag)


def is_oblique(photo_scene: PerceivedScene) -> bool:
    """Return whether the ground is visible around objects, at an angle."""
    tilt = float(photo_scene.document["world"].get("tilt", 0))
    return tilt >= RELEASE.oblique


def is_weak_push(photo_scene: PerceivedScene, push: Push | None) -> bool:
    """Return whether a released object may tell more than a push."""
    if push is None or not push.outcome.is_inside:
        return True
    return is_oblique(photo_scene) and push.outcome.travel < TRIAL.travel


def stands_behind(photo_scene: PerceivedScene, name: str) -> bool:
    """Return whether an object stands behind the wider thing that seems to carry it.

    Seen at an angle, a bowl on a plate has the plate on both sides of its foot. Where
    the plate begins below the foot, the bowl stands on the table behind the plate, and
    the upper border of the plate is no ledge.
    """
    if not is_oblique(photo_scene):
        return False
    labels = photo_scene.percepts.labels
    object_mask = labels == photo_scene.document["objects"][name]["mask"]
    # Compare rows: in a view from above at an angle, things in front end lower in the
    # picture.
    rows = np.flatnonzero(object_mask.any(axis=1))
    if not len(rows):
        return False
    end = int(rows[-1]) + 1
    height = int(rows[-1] - rows[0]) + 1
    # The foot is the lowest part of the object, and its carrier is just below.
    foot_top = end - max(round(RELEASE.foot * height), 1)
    columns = np.flatnonzero(object_mask[foot_top:end].any(axis=0))
    gap = max(round(RELEASE.gap * height), 3)
    carriers = labels[end : end + gap, columns]
    sides = _columns_beside(labels, columns)
    for carrier in np.unique(carriers[carriers > 0]).tolist():
        share = (carriers == carrier).any(axis=0).mean()
        # A plate before the bowl continues on both sides and ends below the foot.
        is_wider = bool((sides == carrier).any())
        is_in_sight = bool((sides[:foot_top] == carrier).any())
        if share >= RELEASE.carrier_share and is_wider and not is_in_sight:
            return True
    return False


def _columns_beside(labels: Labels, columns: NDArray[np.int64]) -> Labels:
    """Return the columns (H, n) of `labels` on both sides of a foot's `columns`."""
    width = max(round(RELEASE.side_width * len(columns)), 1)
    first = int(columns[0])
    last = int(columns[-1])
    left = labels[:, max(first - width, 0) : first]
    right = labels[:, last + 1 : last + 1 + width]
    return np.concatenate([left, right], axis=1)


def is_better(push: Push, other: Push | None) -> bool:
    """Return whether a push has a better grade than another one, if there is one.

    Of two with one grade, the one that moves something farther is better, up to a limit.
    """
    if other is None:
        return True
    ranks = []
    for one in (push, other):
        ranks.append((one.outcome.grade, min(one.outcome.travel, TRIAL.travel)))
    return ranks[0] > ranks[1]


def _low(photo_scene: PerceivedScene, name: str) -> float:
    """Return the lowest row of an object's mask, px."""
    number = photo_scene.document["objects"][name]["mask"]
    rows = (photo_scene.percepts.labels == number).any(axis=1)
    return float(np.flatnonzero(rows).max(initial=0))


def _rank_releasable_objects(
    photo_scene: PerceivedScene, refused_names: Collection[str]
) -> list[str]:
    """Sort the names of releasable objects, the surest large object first."""
    labels = photo_scene.percepts.labels
    areas = np.bincount(labels.ravel())
    weights = {}
    torn_names = part_owners(photo_scene)
    for name, item in photo_scene.document["objects"].items():
        confidence = mask_confidence(item)
        is_cut = "cut off" in photo_scene.comments.get(f"objects.{name}.motion", "")
        is_unsure = confidence < RELEASE.confidence
        if name in refused_names or is_cut or is_unsure or is_living(item["label"]):
            continue
        # The square root of the area is a length: size counts, but less than by area.
        weights[name] = confidence * sqrt(float(areas[item["mask"]]))
        weights[name] *= RELEASE.torn_weight if name in torn_names else 1.0
    return sorted(weights, key=lambda name: weights[name], reverse=True)


def _with_parts(photo_scene: PerceivedScene, name: str) -> PerceivedScene:
    """Merge small unsure objects into the object that they touch.

    A wheel detected as an object of its own would block its car.
    """
    objects = dict(photo_scene.document["objects"])
    parts = _parts(photo_scene, name)
    if not parts:
        return photo_scene
    number = objects[name]["mask"]
    ids = [objects.pop(part)["mask"] for part in parts]
    percepts = photo_scene.percepts
    labels = np.where(np.isin(percepts.labels, ids), number, percepts.labels)
    labels = labels.astype(np.uint16)
    # The shadows of the parts become shadows of the object, too.
    owners = percepts.shadows
    if owners is not None:
        owners = np.where(np.isin(owners, ids), number, owners).astype(np.uint16)
    outline = fit_outlines(labels, [number])[number]
    objects[name] = objects[name] | {"shape": shape_entry(outline)}
    objects[name].pop("solid", None)
    comments = {}
    for key, text in photo_scene.comments.items():
        if not key.startswith("objects.") or key.split(".")[1] in objects:
            comments[key] = text
    return replace(
        photo_scene,
        percepts=replace(percepts, labels=labels, shadows=owners),
        document=photo_scene.document | {"objects": objects},
        comments=comments,
    )


def _parts(photo_scene: PerceivedScene, name: str) -> list[str]:
    """Return the names of small unsure objects beside an object."""
    labels = photo_scene.percepts.labels
    objects = photo_scene.document["objects"]
    object_mask = labels == objects[name]["mask"]
    dilated_mask = (
        cv2.dilate(object_mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    )
    parts = []
    for other, item in objects.items():
        if other == name or mask_confidence(item) >= RELEASE.part_confidence:
            continue
        part_mask = labels == item["mask"]
        # A part of an object touches it along much of its border.
        inner_pixels = (
            cv2.erode(part_mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        )
        border_pixels = part_mask & ~inner_pixels
        is_small = part_mask.sum() < RELEASE.part * object_mask.sum()
        share = float((border_pixels & dilated_mask).sum()) / max(
            float(border_pixels.sum()), 1.0
        )
        if is_small and share >= RELEASE.touch:
            parts.append(other)
    return parts


def _release_object(
    photo_scene: PerceivedScene, name: str, rag: float
) -> PerceivedScene:
    """Return the scene with one object free on a floor through its lowest point.

    `rag`: height of the levelled lower border, by the object's height.
    Raises InputError if its level outline is not a valid shape.
    """
    scene = open_trial(photo_scene).scene()
    names = [item.name for item in scene.objects]
    outlines = compile_shapes(scene, shapes_of(scene, None)).outlines
    # A vehicle whose wheels show a road at an angle stands on that road; all other
    # objects stand on level ground.
    road = _find_road(photo_scene.document["objects"][name])
    outline, ground = _level_outline(
        outlines[names.index(name)], photo_scene, name, road, rag
    )
    photo_scene = _with_others_held(photo_scene, name, outline)
    released_scene = _with_guessed_floor(photo_scene, name, ground)
    if road is not None:
        return _with_road(released_scene, name, road)
    # Seen from high above, the picture shows the depth of the ground: objects pass
    # before and behind each other.
    if is_oblique(photo_scene):
        named_outlines = dict(zip(names, outlines, strict=True))
        return _passing(released_scene, name, named_outlines)
    return released_scene


def _find_road(entry: Mapping[str, Any]) -> Line | None:
    """Return the line below the wheels of a vehicle; None if it is level or steep.

    A road that runs into the picture is a line at an angle, on which the wheels stand.
    """
    points = []
    for wheel in entry.get("wheels", ()):
        x, y = wheel["center"]
        points.append((x, y + wheel["radius"]))
    if len(points) < FEWEST_WHEELS:
        return None
    # The road leads through the lowest points of the outermost wheels; wheels in
    # between may hang.
    (x0, y0), (x1, y1) = min(points), max(points)
    slope = (y1 - y0) / max(x1 - x0, 1.0)
    low, high = RELEASE.road_slopes
    if not low <= abs(slope) <= high:
        return None
    return Line(slope, y0 - slope * x0)


def _with_road(photo_scene: PerceivedScene, name: str, road: Line) -> PerceivedScene:
    """Return the scene with a vehicle on a road at an angle in the picture.

    The road is level in truth: gravity is across it, so that the vehicle stays. Wheels
    seen at an angle are no circles, and are not drawn turning.
    """
    down = np.array([-road.slope, 1.0]) / hypot(1.0, road.slope)
    gravity = [f"{EARTH * part:.3f} m/s²" for part in down.tolist()]
    vehicle = dict(photo_scene.document["objects"][name])
    vehicle["wheels"] = [wheel | {"turns": False} for wheel in vehicle["wheels"]]
    document = dict(photo_scene.document)
    document["world"] = document["world"] | {"gravity": gravity}
    document["objects"] = document["objects"] | {name: vehicle}
    comment = f"across the road on which {name} stands, which runs into the picture"
    comments = {**photo_scene.comments, "world.gravity": comment}
    return replace(photo_scene, document=document, comments=comments)


def _with_guessed_floor(
    photo_scene: PerceivedScene, name: str, ground: Line
) -> PerceivedScene:
    """Return the scene with a floor along a line in place of its walls."""
    floor = _guessed_floor(photo_scene.percepts.labels.shape[1], ground)
    walls = photo_scene.document["boundaries"]
    # Other walls of the scene could block the guessed floor.
    other_walls = {}
    for key, wall in walls.items():
        if key == "bottom":
            other_walls[key] = wall
    document = photo_scene.document | {"boundaries": other_walls | {FLOOR: floor}}
    comment = f"a guess: through the lowest point of {name}"
    comments = {**photo_scene.comments, f"boundaries.{FLOOR}": comment}
    return replace(photo_scene, document=document, comments=comments)


def _passing(
    photo_scene: PerceivedScene, name: str, outlines: Mapping[str, Outline]
) -> PerceivedScene:
    """Return the scene in which one object passes before and behind all others.

    Only objects at about the same distance from the camera are in its way.
    """
    tilt = radians(float(photo_scene.document["world"]["tilt"]))
    places = {}
    for key, outline in outlines.items():
        places[key] = _GroundPlace.from_outline(outline)
    own_place = places.pop(name)
    # Objects at the same distance collide; all others let the object pass.
    near = []
    for key, place in places.items():
        if own_place.meets(place, tilt):
            near.append(key)
    objects = _in_depth_order(photo_scene.document["objects"], name, own_place, places)
    for other in near:
        objects[other] = objects[other] | {"collision_group": NEAR}
    if near:
        groups = [MOVING, NEAR]
    else:
        groups = [MOVING]
    objects[name] |= {"collision_group": MOVING, "collides_with": groups}
    walls = dict(photo_scene.document["boundaries"])
    walls[FLOOR] = walls[FLOOR] | {"collision_group": MOVING}
    comments = dict(photo_scene.comments)
    comment = "it passes all objects that are nearer or farther"
    comments[f"objects.{name}.collision_group"] = comment
    document = photo_scene.document | {"objects": objects, "boundaries": walls}
    return replace(photo_scene, document=document, comments=comments)


def _in_depth_order(
    entries: Mapping[str, Any],
    name: str,
    own_place: _GroundPlace,
    places: Mapping[str, _GroundPlace],
) -> dict[str, Any]:
    """Return the entries of objects, with farther ones in lower layers than `name`."""
    objects = dict(entries)
    farther = []
    for key, place in places.items():
        if place.low <= own_place.low:
            farther.append(key)
    # The released object is drawn over all farther ones, and all nearer ones over it:
    # layers in between keep their order.
    layer = max([0, *(objects[key].get("layer", 0) + 1 for key in farther)])
    objects[name] = objects[name] | {"layer": layer}
    for other in places.keys() - set(farther):
        nearer_layer = max(objects[other].get("layer", 0), layer + 1)
        objects[other] = objects[other] | {"layer": nearer_layer}
    return objects


@dataclass(frozen=True)
class _GroundPlace:
    """Where an object stands on ground that the camera sees at an angle, px."""

    low: float
    """Its lowest row."""
    size: float
    """The smaller side of its box."""

    @staticmethod
    def from_outline(outline: Outline) -> _GroundPlace:
        x0, y0, x1, y1 = bounds(outline)
        return _GroundPlace(y1, min(x1 - x0, y1 - y0))

    def meets(self, other: _GroundPlace, tilt: float) -> bool:
        """Return whether two objects on a line across the photo may touch."""
        reach = RELEASE.depth * (self.size + other.size) * sin(tilt)
        return abs(self.low - other.low) < reach


def _guessed_floor(width: int, ground: Line) -> dict[str, Any]:
    """Return the entry of a floor across a photo, and beyond both sides."""
    ends = np.array([[x, ground.y_at(x)] for x in (-width, 2.0 * width)])
    return {
        "segment": corners(ends),
        "friction": RELEASE.friction,
        "from": f"lowest point {RELEASE.floor_confidence:g}",
    }


def _with_others_held(
    photo_scene: PerceivedScene, name: str, outline: Outline
) -> PerceivedScene:
    """Release one object with this outline, and hold all others."""
    objects = {}
    comments = dict(photo_scene.comments)
    for other, item in photo_scene.document["objects"].items():
        item = {key: value for key, value in item.items() if key != "motion"}
        # Releasing one object among loose ones would topple the scene: hold the others.
        if other == name:
            item["velocity"] = [0, 0]
            item.pop("spin", None)
            item["shape"] = shape_entry(outline)
            # A held object has no rolling resistance: what rolls would never stop.
            if "wheels" in item:
                item.setdefault("rolling", kind("wheel").material.rolling)
            elif isinstance(outline, Disc):
                item.setdefault("rolling", kind(item["label"]).material.rolling)
            comments.pop(f"objects.{other}.motion", None)
        else:
            item.pop("velocity", None)
            item.pop("spin", None)
            item["motion"] = "static"
            comment = f"held, so that {name} can move; dynamic lets it go"
            comments.setdefault(f"objects.{other}.motion", comment)
        objects[other] = item
    document = photo_scene.document | {"objects": objects}
    return replace(photo_scene, document=document, comments=comments)


def _level_outline(
    outline: Outline,
    photo_scene: PerceivedScene,
    name: str,
    road: Line | None,
    rag: float,
) -> tuple[Outline, Line]:
    """Return an outline with a straight base on its ground, and the line of the ground.

    The ground is a `road`, or level below the object.
    """
    _, top, _, bottom = bounds(outline)
    # Scene files have two decimals: the ground must not be below the written outline.
    ground = road or Line(0.0, float(np.floor(bottom * 100) / 100))
    if isinstance(outline, Disc):
        return outline, ground
    level_foot = straighten_foot(outline, ground, rag * (bottom - top))
    number = photo_scene.document["objects"][name]["mask"]
    foot = find_foot(PhotoObject(number, level_foot))
    outline_with_base = None
    if needs_base(foot):
        outline_with_base = add_base(foot, ground)
    return outline_with_base or level_foot, ground
