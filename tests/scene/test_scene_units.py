"""Numbers with units: what they mean, in every key that has a unit, and what is said of those that do not fit."""

from __future__ import annotations

import re
from math import pi
from pathlib import Path

import jsonschema
import pytest

from physgen import pipeline
from physgen.problems import InputError
from physgen.scene.schema import load_published_schema
from physgen.text import ALLOWED, quantity

SCENE = """\
physgen: 1
size: [400, 300]
world: {pixels_per_meter: 5 px/cm, gravity: 9.81 m/s²}
objects:
  ball:
    shape: {circle: {center: [100, 10 cm], radius: 28.5 mm}}
    mass: 0.17 kg
    velocity: [1.2 m/s, 0]
    spin: 90 deg/s
  box: {shape: {box: {center: [300, 100], size: [2 cm, 30], angle: 0.5 rad}}, density: 3 kg/m²}
forces:
  - {object: ball, force: 5 N}
  - {object: ball, torque: 1 N m, start: 20 ms, duration: 0.5 s}
  - {object: ball, impulse: [0, 2 kg·m/s]}
variants: {fast: {objects.ball.velocity: [-3 m/s, 20 cm/s]}}
"""


def test_units_mean_the_same_as_numbers(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    scene = pipeline.load(path)
    ball, box = scene.objects
    assert scene.world.pixels_per_meter == 500
    assert scene.world.gravity == pytest.approx((0, 4905))
    assert (ball.mass, ball.velocity, ball.spin) == (pytest.approx(170), (600, 0), 90)
    assert (ball.shape.center, ball.shape.radius) == ((100, 50), pytest.approx(14.25))
    assert (box.shape.size, box.shape.angle) == ((10, 30), pytest.approx(90 / pi))
    assert box.density == pytest.approx(3e3 / 500**2)
    force, torque, impulse = scene.forces
    assert force.vector == pytest.approx((5 * 1000 * 500, 0))
    assert (torque.torque, torque.start, torque.duration) == (
        pytest.approx(1000 * 500**2),
        0.02,
        0.5,
    )
    assert impulse.vector == pytest.approx((0, 2 * 1000 * 500))
    assert pipeline.load(path, ["objects.ball.mass=1 kg"], "fast").objects[
        0
    ].velocity == (-1500, 100)
    jsonschema.validate(
        __import__("yaml").safe_load(SCENE), load_published_schema()
    )  # as editors check it


@pytest.mark.parametrize("unit", ALLOWED)
def test_every_unit_that_a_message_names_is_one(unit: str) -> None:
    for name in re.split(r", | or ", ALLOWED[unit]):
        value = quantity(f"3 {name}", unit, 200)
        assert value
        assert quantity(
            f"{3 / value!r} {unit.replace('1/s', 'Hz')}", unit, 200
        ) == pytest.approx(3 / value)
        assert quantity(f"{6 / 2} {name}", unit, 200) == pytest.approx(value)


GRAMS = 'objects.a.mass: "170 px" is not a number; write grams, or a number with mg, g or kg behind it'


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("mass: 170 px", GRAMS),
        ("velocity: [1 kg, 0]", "px/s, cm/s or m/s"),
        ("friction: 3 g", "write a number from 0 to 10"),
    ],
)
def test_units_that_do_not_fit(tmp_path: Path, wrong: str, message: str) -> None:
    path = tmp_path / "scene.yaml"
    start = "  a: {shape: {circle: {center: [4, 4], radius: 2}}, "
    path.write_text(f"physgen: 1\nsize: [9, 9]\nobjects:\n{start}{wrong}}}\n")
    with pytest.raises(InputError, match=re.escape(message)) as raised:
        pipeline.load(path)
    (problem,) = raised.value.problems
    value = re.search(r"\d", wrong)
    assert value is not None
    assert (problem.place.line, problem.place.column) == (
        4,
        len(start) + value.start() + 1,
    )


def test_texts_that_are_no_quantity() -> None:
    """A long text ends at once; what is too large, or upside down, has no value."""
    assert quantity("1" * 20_000, "px", 1) is None
    assert quantity("0.3 mm/px", "px/m", 1) is None
    assert quantity("1 m³/s²", "px³/s²", 1e150) is None
