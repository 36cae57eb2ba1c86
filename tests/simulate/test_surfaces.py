"""Belts, groups, one-way shelves and static friction in whole scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import written

from physgen.problems import InputError
from physgen.simulate.engine import simulate

SCENE = """\
physgen: 1
size: [800, 600]
world: {view: side, duration: 1, gravity: [0, 980]}
objects:
  parcel: {shape: {box: {center: [100, 90], size: [80, 20]}}, mass: 100, elasticity: 0}
  ghost: {shape: {circle: {center: [300, 50], radius: 10}}, collision_group: back, collides_with: [back]}
  ball: {shape: {circle: {center: [500, 190], radius: 10}}, mass: 20, velocity: [100, -500]}
  held: {shape: {box: {center: [120, 390], size: [20, 20]}}, mass: 100, static_friction: 0.7}
boundaries:
  belt: {segment: [[0, 100], [400, 100]], conveyor: -150, static_friction: 0.9}
  floor: {segment: [[0, 400], [800, 400]], friction: 0.5, static_friction: 0.7}
  shelf: {polyline: [[420, 100], [520, 100], [700, 100]], one_way: [0, -1], elasticity: 0}
forces:
  - {object: held, force: [6.5e4, 0]}
"""


def test_surfaces_do_what_they_say_and_balance_energy(tmp_path: Path) -> None:
    run = simulate(written.world(tmp_path, SCENE), np.linspace(0, 1, 50))
    energy = run.energy
    total = energy.kinetic + energy.potential + energy.dissipated - energy.work
    assert np.ptp(total) < 1e-2 * energy.kinetic.max()
    ends = dict(zip(run.names, run.poses[-1].tolist(), strict=True))
    assert ends["parcel"][0] < 0  # the belt carried it to the left
    assert ends["ghost"][1] > 400
    assert ends["ball"][1] == pytest.approx(90, abs=0.1)
    assert ends["held"][0] == pytest.approx(120, abs=0.05)  # 0.5 < 0.66 < 0.7


def test_mirrored_belts_carry_as_far(tmp_path: Path) -> None:
    right = SCENE.replace(
        "[[0, 100], [400, 100]], conveyor: -150",
        "[[0, 100], [400, 100]], conveyor: 150",
    )
    ends = [
        simulate(written.world(tmp_path, text), np.array([0, 0.2])).poses[-1, 3, 0]
        for text in (SCENE, right)
    ]
    assert ends[0] - 100 == pytest.approx(100 - ends[1], abs=1e-9)
    assert abs(ends[0] - 100) > 1


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        ("objects.ghost.collides_with=[bakc]", 'did you mean "back"'),
        (
            "objects.held.static_friction=0.2",
            "is less than the friction while it slides, 0.5",
        ),
        ("boundaries.shelf.one_way=[0, 0]", "has no direction"),
    ],
)
def test_mistakes_in_contacts_are_named(tmp_path: Path, edit: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        written.world(tmp_path, SCENE, edit)


ENDS = """\
physgen: 1
size: [400, 300]
world: {duration: 1, gravity: [0, 0]}
objects:
  ball: {shape: {circle: {center: [100, 200], radius: 12}}, velocity: [300, 0]}
boundaries:
  wall: {segment: [[250, 200], [400, 200]]}
"""
BESIDE = "  beside: {segment: [[0, 200], [250, 200]], collision_group: other, collides_with: [other]}\n"


def test_wall_that_is_passed_hides_no_end_of_another(tmp_path: Path) -> None:
    alone, both = (
        simulate(written.world(tmp_path, text), np.array([0.0, 1.0])).poses
        for text in (ENDS, ENDS + BESIDE)
    )
    assert alone[-1, 0, 0] < 238
    np.testing.assert_array_equal(both, alone)
