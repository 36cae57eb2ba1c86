"""Release of a held object on a floor of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from physgen.maps import Percepts
from physgen.perceive.roles import PerceivedScene, Suitability
from physgen.pipeline.releases import releases, stands_behind
from physgen.pipeline.stages import compile
from physgen.pipeline.trial_scenes import open_trial
from physgen.simulate.engine import simulate

HELD = {"motion": "static"}
SURE = "masks 0.9"
UNSURE = "masks 0.5"
WHOLE = (60, 60, 140, 120)
"""Left, top, right and bottom, px."""


def scene_of(
    boxes: Mapping[str, tuple[int, ...]],
    confidence: Mapping[str, str] | None = None,
    view: str = "side",
) -> PerceivedScene:
    """Held boxes in a photo of 200 x 150 px that shows no floor."""
    labels = np.zeros((150, 200), np.uint16)
    objects: dict[str, Any] = {}
    for number, (name, (left, top, right, bottom)) in enumerate(boxes.items(), 1):
        labels[top:bottom, left:right] = number
        corners = [[left, top], [right, top], [right, bottom], [left, bottom]]
        origin = (confidence or {}).get(name, SURE)
        objects[name] = {
            **{"label": "box", "mask": number, "shape": {"polygon": corners}},
            **HELD,
            "from": {"mask": origin},
        }
    rgb = np.full((150, 200, 3), 128, np.uint8)
    none = np.zeros(labels.shape, np.float32)
    percepts = Percepts(
        rgb=rgb, labels=labels, coverage=none, background=rgb, clean=None
    )
    document: dict[str, Any] = {
        "physgen": 1,
        "world": {"view": view, "pixels_per_meter": 400},
        "objects": objects,
        "boundaries": {},
    }
    return PerceivedScene(percepts, document, {}, suitability=Suitability())


def test_a_held_object_is_released_on_its_foot() -> None:
    scene = scene_of({"box-1": WHOLE, "box-2": (10, 30, 40, 60)})
    name, released = next(iter(releases(scene, ())))
    assert name == "box-1"
    objects = released.document["objects"]
    assert "motion" not in objects["box-1"]
    assert objects["box-2"]["motion"] == "static"
    (_, left), (_, right) = released.document["boundaries"]["floor"]["segment"]
    assert left == right == pytest.approx(120, abs=1)


@pytest.mark.parametrize("reason", ["refused", "alive", "cut"])
def test_what_may_not_move_is_not_released(reason: str) -> None:
    scene = scene_of({"box-1": WHOLE})
    if reason == "alive":
        scene.document["objects"]["box-1"]["label"] = "dog"
    if reason == "cut":
        comment = {"objects.box-1.motion": "it is cut off by the photo's border"}
        scene = replace(scene, comments=comment)
    refused = ["box-1"] if reason == "refused" else []
    assert list(releases(scene, refused)) == []


def test_nothing_is_released_seen_from_above() -> None:
    assert list(releases(scene_of({"box-1": WHOLE}, view="top"), ())) == []


def test_an_unsure_part_moves_with_its_object() -> None:
    boxes = {"box-1": WHOLE, "box-2": (140, 90, 160, 120)}
    scene = scene_of(boxes, {"box-2": UNSURE})
    _, released = next(iter(releases(scene, ())))
    assert list(released.document["objects"]) == ["box-1"]
    assert set(np.unique(released.percepts.labels)) == {0, 1}


def test_a_sure_neighbour_is_no_part() -> None:
    scene = scene_of({"box-1": WHOLE, "box-2": (140, 90, 160, 120)})
    _, released = next(iter(releases(scene, ())))
    assert list(released.document["objects"]) == ["box-1", "box-2"]


PLATE, BOWL = (20, 80, 180, 140), (80, 40, 120, 79)


def tilted_scene(boxes: Mapping[str, tuple[int, ...]], tilt: float) -> PerceivedScene:
    scene = scene_of(boxes)
    world = scene.document["world"] | {"tilt": tilt}
    return replace(scene, document=scene.document | {"world": world})


def test_a_bowl_stands_behind_a_nearer_plate() -> None:
    boxes = {"plate-1": PLATE, "bowl-1": BOWL}
    assert stands_behind(tilted_scene(boxes, 45.0), "bowl-1")
    assert not stands_behind(tilted_scene(boxes, 45.0), "plate-1")
    # From the side, the bowl stands on the plate.
    assert not stands_behind(tilted_scene(boxes, 10.0), "bowl-1")


def test_a_bowl_with_a_plate_on_both_sides_stands_on_it() -> None:
    boxes = {"plate-1": PLATE, "bowl-1": (80, 60, 120, 99)}
    assert not stands_behind(tilted_scene(boxes, 45.0), "bowl-1")


def test_the_upper_of_two_equal_boxes_stands_on_the_lower_one() -> None:
    boxes = {"box-1": (80, 80, 120, 140), "box-2": BOWL}
    assert not stands_behind(tilted_scene(boxes, 45.0), "box-2")


def test_a_bowl_behind_a_plate_passes_it_on_its_own_ground() -> None:
    scene = tilted_scene({"plate-1": PLATE, "bowl-1": BOWL}, 45.0)
    released = dict(releases(scene, ["plate-1"]))["bowl-1"].document
    assert released["objects"]["bowl-1"]["collides_with"] == ["moving"]
    assert released["objects"]["plate-1"]["layer"] > 0
    assert released["boundaries"]["floor"]["collision_group"] == "moving"


def test_a_vehicle_stays_and_rolls_to_a_stop_on_a_road_at_an_angle() -> None:
    """Its wheels stand on a line that rises: the road runs into the picture."""
    scene = scene_of({"bus-1": WHOLE})
    slope = -0.1
    wheels = [{"center": [x, 115 + slope * (x - 75)], "radius": 10} for x in (75, 125)]
    scene.document["objects"]["bus-1"] |= {"label": "bus", "wheels": wheels}
    _, released = next(iter(releases(scene, ())))
    vehicle = released.document["objects"]["bus-1"]
    assert [wheel["turns"] for wheel in vehicle["wheels"]] == [False, False]
    assert rolled_distance(released, 0) < 1
    # Rolling resistance stops it after v² / (2 c g); 0.1 m/s are 40 px/s here.
    resistance = 9.8 * vehicle["rolling"]
    expected_distance = 400 * 0.1**2 / (2 * resistance)
    assert rolled_distance(released, 40) == pytest.approx(expected_distance, rel=0.2)


def rolled_distance(scene: PerceivedScene, speed: float) -> float:
    """Return the distance, px, at which `bus-1` has stopped from a speed, px/s."""
    edit = f"objects.bus-1.velocity=[{speed}, 0]"
    compiled = compile(open_trial(scene).scene([edit]), None)
    poses = simulate(compiled.world, np.linspace(0, 4, 5)).poses
    assert np.hypot(*(poses[-1, 0] - poses[-2, 0])[:2]) < 0.5
    return float(np.hypot(*(poses[-1, 0] - poses[0, 0])[:2]))


def test_a_sloping_base_is_level_at_the_second_try() -> None:
    """A laptop seen from the side has a base that rises: on it, the laptop would fall."""
    scene = scene_of({"box-1": WHOLE})
    corners = [[60, 60], [140, 60], [140, 114], [60, 120]]
    scene.document["objects"]["box-1"]["shape"] = {"polygon": corners}
    widths = []
    for _, released in releases(scene, ()):
        (body,) = compile(open_trial(released).scene(), None).world.bodies
        points = np.concatenate(body.rings) + body.center
        foot = points[points[:, 1] > 119.5, 0]
        widths.append(float(np.ptp(foot)))
    assert widths[0] < 40
    assert widths[1] > 75


def test_a_released_ball_rolls_to_a_stop() -> None:
    """A held ball has no rolling resistance; a released one has that of its label."""
    scene = scene_of({"ball-1": WHOLE})
    entry = scene.document["objects"]["ball-1"]
    entry["shape"] = {"circle": {"center": [100, 90], "radius": 30}}
    entry["label"] = "ball"
    _, released = next(iter(releases(scene, ())))
    assert released.document["objects"]["ball-1"]["rolling"] > 0
