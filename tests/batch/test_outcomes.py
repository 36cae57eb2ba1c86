"""What a table says became of a clip, against closed forms."""

from __future__ import annotations

from math import sqrt
from pathlib import Path

import pytest
from written import world

from physgen import pipeline
from physgen.batch.outcomes import columns, outcomes
from physgen.scene.schema import find_schema_part
from physgen.simulate.trajectory import Trajectory
from physgen.tables import Cell

G, FRAME = 500.0, 1 / 120
HEAD = f"""\
physgen: 1
size: [400, 200]
render: {{fps: 120}}
boundaries: {{floor: {{segment: [[-900, 180], [900, 180]], friction: 0.4}}}}
world: {{gravity: [0, {G}], duration: 1.2}}
"""


def motion(tmp_path: Path, objects: str, *edits: str) -> Trajectory:
    return pipeline.simulate(world(tmp_path, HEAD + f"objects:\n{objects}", *edits))


def became(tmp_path: Path, objects: str, *edits: str) -> dict[str, Cell]:
    trajectory = motion(tmp_path, objects, *edits)
    return outcomes(trajectory, trajectory.names)


BLOCK = "  block: {shape: {box: {center: [50, 170], size: [40, 20]}}, mass: 50, friction: 0.4, velocity: [%s, 0]}\n"


@pytest.mark.parametrize("speed", [60, 150])
def test_a_block_that_slides_comes_to_rest_after_v_over_mu_g(
    tmp_path: Path, speed: float
) -> None:
    found = became(tmp_path, BLOCK % speed)
    stop = speed / (0.4 * G)
    assert stop - 1e-3 <= found["objects.block.rest_time"] <= stop + FRAME + 1e-3
    assert found["rest_time"] == found["objects.block.rest_time"]
    assert found["objects.block.x"] == pytest.approx(
        50 + speed**2 / (2 * 0.4 * G), rel=3e-3
    )
    assert found["objects.block.angle_degrees"] == pytest.approx(0, abs=0.1)
    assert found["peak_speed"] == found["objects.block.peak_speed"] == speed
    assert "objects.block.first_touch" not in found  # it stood on the floor already
    assert found["objects.block.touches"] == found["touches"] == 1


def test_a_ball_meets_the_floor_after_its_fall(tmp_path: Path) -> None:
    ball = "  ball: {shape: {circle: {center: [100, 70], radius: 10}}, elasticity: 0, mass: 5}\n"
    found = became(tmp_path, ball)
    fall = sqrt(2 * 100 / G)
    assert found["objects.ball.first_touch"] == pytest.approx(fall, abs=1e-4)
    assert sqrt(2 * G * 100) - G * FRAME <= found["peak_speed"] <= sqrt(2 * G * 100)
    assert fall <= found["rest_time"] <= fall + 2 * FRAME
    assert found["objects.ball.y"] == pytest.approx(170, abs=0.05)


def test_the_top_of_a_throw_is_no_rest(tmp_path: Path) -> None:
    last = round(1.2 / FRAME) - 1
    ball = f"  ball: {{shape: {{circle: {{center: [100, 100], radius: 10}}}}, velocity: [0, {-G * last * FRAME}]}}\n"
    trajectory = motion(tmp_path, ball, "boundaries={}")
    assert (
        abs(trajectory.velocities[-1, 0, 1]) < 1e-6
    )  # it hangs in the air in the last frame
    assert "rest_time" not in outcomes(trajectory, ["ball"])


def test_what_turns_in_its_place_does_not_rest(tmp_path: Path) -> None:
    wheel = "  wheel: {shape: {circle: {center: [100, 70], radius: 10}}, spin: %s}\n"
    assert "rest_time" not in became(tmp_path, wheel % 90, "world.gravity=[0, 0]")
    found = became(tmp_path, wheel % 0, "world.gravity=[0, 0]")
    assert (
        found["rest_time"] == found["objects.wheel.rest_time"] == found["touches"] == 0
    )
    turned = became(tmp_path, wheel % 720, "world.gravity=[0, 0]", "boundaries={}")
    assert turned["objects.wheel.angle_degrees"] == pytest.approx(
        720 * (1.2 - FRAME), rel=1e-9
    )  # and not modulo 360


def test_all_rest_when_the_last_one_does(tmp_path: Path) -> None:
    other = BLOCK.replace("block", "other").replace("50, 170", "300, 170") % 20
    both = became(tmp_path, BLOCK % 120 + other)
    assert (
        both["rest_time"]
        == both["objects.block.rest_time"]
        > both["objects.other.rest_time"]
    )
    assert both["touches"] == 2
    assert both["peak_speed"] == 120


def test_a_sphere_that_rolls_on_a_table_stops_by_its_resistance(tmp_path: Path) -> None:
    ball = "  ball: {shape: {circle: {center: [50, 100], radius: 10}}, solid: sphere, rolling: 0.1}\n"
    found = became(
        tmp_path,
        ball,
        "objects.ball.velocity=[50, 0]",
        "world={view: top, pixels_per_meter: 50, duration: 2.5, table: {friction: 0.5}}",
        "boundaries={}",
    )
    stop = 50 * (1 + 2 / 5) / (0.1 * 9.8 * 50)  # a = c g / (1 + k)
    assert (
        stop * 0.99 - 0.04 <= found["rest_time"] <= stop * 1.01 + FRAME
    )  # slower than 1 px/s is at rest


def test_no_outcome_is_called_like_a_key_of_a_scene() -> None:
    names = set(columns(["ball"]))
    keys = {
        f"objects.ball.{key}" for key in find_schema_part("objects.*")["properties"]
    }
    assert not names & keys
