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
