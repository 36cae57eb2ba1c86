"""`~each`: which keys of a scene have draws of their own."""

from __future__ import annotations

from typing import Any

import pytest

from physgen.batch.axes import per_object, read_axes
from physgen.batch.sweep import planned
from physgen.problems import InputError

SCENE = {
    "objects": {"ball": {"mass": 1, "velocity": [0, 0]}, "crate": {"mass": 2, "velocity": [0, 0]}},
    "boundaries": {"floor": {"friction": 0.5}},
    "forces": [{"object": "ball", "impulse": [1, 0]}, {"object": "crate", "impulse": [2, 0]}],
}


def keys(*arguments: str, scenes: tuple[Any, ...] = (SCENE,)) -> list[str]:
    return [axis.argument for axis in per_object(read_axes(arguments), scenes)]


def said(*arguments: str, **more: Any) -> str:
    with pytest.raises(InputError) as caught:
        keys(*arguments, **more)
    [problem] = caught.value.problems
    return str(problem)


def test_stars_are_what_the_scene_has() -> None:
    assert keys("objects.*.mass=~each normal(5, 1, 0, inf)", "a.b=1,2") == [
        "objects.ball.mass=~normal(5, 1, 0, inf)",
        "objects.crate.mass=~normal(5, 1, 0, inf)",
        "a.b=1,2",
    ]
    assert keys("objects.*.velocity.0= ~ each uniform(1, 2)") == [
        "objects.ball.velocity.0=~uniform(1, 2)",
        "objects.crate.velocity.0=~uniform(1, 2)",
    ]
    assert keys("forces[*].impulse[*]=~each uniform(1, 2)") == [
        f"forces[{force}].impulse[{axis}]=~uniform(1, 2)" for force in (0, 1) for axis in (0, 1)
    ]
    assert keys("objects.*.rolling=~each uniform(0, 1)")  # a key that is not written yet


def test_what_is_set_later_has_no_draws() -> None:
    assert keys("objects.*.mass=~each uniform(1, 2)", "objects.ball.mass=7,8") == [
        "objects.crate.mass=~uniform(1, 2)",
        "objects.ball.mass=7,8",
    ]


def test_variants_count_by_what_all_of_them_have() -> None:
    other = {"objects": {"crate": {}, "cup": {}}}
    assert keys("objects.*.mass=~each uniform(1, 2)", scenes=(SCENE, other)) == [
        "objects.crate.mass=~uniform(1, 2)"
    ]


def test_what_means_nothing_is_told() -> None:
    assert "means nothing that the scene has" in said("joints.*.motor=~each uniform(1, 2)")
    assert said("objects.ball.mass=~each uniform(1, 2)").endswith(
        "is one key, and has one draw as it is; write objects.ball.mass=~uniform(1, 2)"
    )
    with pytest.raises(InputError, match="stands for several keys, and nobody has said which"):
        planned(read_axes(["objects.*.mass=~each uniform(1, 2)"]), samples=3)
