"""The energy balance of one body without joints that is pushed against the nest it stands in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.pipeline.clip_warnings import balance_advice
from physgen.simulate.engine import simulate
from physgen.simulate.recorder import Recorder

Points = list[list[float]]
CASES: dict[str, tuple[Points, int, Points]] = {
    "step divided after an abrupt contact": (
        [
            [462.3, 385.7],
            [341.8, 273.6],
            [324.3, 263.3],
            [340.4, 258.6],
            [319.8, 236.7],
            [447.5, 297.7],
        ],
        -3159,
        [[432.3, 385.7], [462.3, 385.7], [447.5, 297.7], [319.8, 236.7]],
    ),
    "step lengthened after an abrupt contact": (
        [
            [486.6, 324.8],
            [461.7, 358.7],
            [429.4, 391.7],
            [365.7, 349.5],
            [339.5, 347.0],
            [361.7, 262.4],
            [375.9, 238.3],
            [401.0, 255.7],
            [440.9, 253.5],
            [459.8, 238.0],
            [456.8, 274.8],
        ],
        -4832,
        [[399.4, 391.7], [429.4, 391.7], [461.7, 358.7], [486.6, 324.8]],
    ),
    "contacts that contradict each other": (
        [
            [495.1, 363.6],
            [416.6, 341.6],
            [411.0, 390.8],
            [398.9, 387.9],
            [358.3, 336.6],
            [338.8, 320.8],
            [314.7, 225.7],
            [382.7, 243.6],
            [423.1, 250.5],
            [444.4, 224.1],
            [430.4, 266.3],
            [482.7, 290.8],
        ],
        -5673,
        [[381.0, 390.8], [411.0, 390.8], [416.6, 341.6], [495.1, 363.6]],
    ),
    "corner that comes down beside another": (
        [
            [454.9, 389.8],
            [428.4, 368.6],
            [432.8, 387.2],
            [390.7, 345.0],
            [338.2, 380.2],
            [356.0, 340.3],
            [328.9, 351.4],
            [380.8, 255.0],
            [396.1, 231.1],
            [484.2, 246.2],
        ],
        -5577,
        [[424.9, 389.8], [454.9, 389.8], [484.2, 246.2], [396.1, 231.1]],
    ),
}
"""Outline px, velocity px/s along x, and the boundary that follows a part of the outline."""


def scene(outline: Points, velocity: int, nest: Points) -> str:
    """Return a scene of 4,000 px/m, as a large photo of a small thing has."""
    low = max(y for _, y in outline)
    return (
        "physgen: 1\nsize: [800, 600]\n"
        "world: {pixels_per_meter: 4000, duration: 0.3}\n"
        "objects:\n  dog:\n"
        f"    shape: {{polygon: {outline}}}\n    mass: 96\n"
        f"    velocity: [{velocity}, 0]\n"
        "boundaries:\n"
        f"  floor: {{segment: [[-800, {low}], [1600, {low}]]}}\n"
        f"  nest: {{polyline: {nest}}}\n"
    )


@pytest.mark.parametrize("name", CASES)
def test_one_body_in_a_nest_balances(name: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(scene(*CASES[name]))
    world = pipeline.compile(pipeline.load(path), None).world
    trajectory = pipeline.simulate(world)
    assert trajectory.imbalance() < 0.01
    energy = trajectory.energy
    mechanical = energy.kinetic + energy.potential
    made = np.diff(mechanical - energy.work).max()
    assert made < 0.01 * energy.kinetic[0], "contacts make no energy"


def test_wrong_moment_of_a_tumbling_box_warns(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [800, 600]\nworld: {duration: 1.0}\n"
        "objects:\n  box:\n"
        "    shape: {box: {center: [200, 200], size: [80, 60], angle: 20}}\n"
        "    velocity: [300, 0]\n    spin: 400\n"
        "boundaries: {floor: {segment: [[-800, 400], [3000, 400]]}}\n"
    )
    world = pipeline.compile(pipeline.load(path), None).world
    assert pipeline.simulate(world).imbalance() < 0.01
    original = Recorder.__init__

    def read_a_wrong_moment(self, *arguments, **settings) -> None:
        original(self, *arguments, **settings)
        self._moment = 2 * self._moment

    monkeypatch.setattr(Recorder, "__init__", read_a_wrong_moment)
    assert pipeline.simulate(world).imbalance() > 0.05


def test_balance_advice_names_what_there_is(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    text = scene(*next(iter(CASES.values())))
    path.write_text(text)
    alone = pipeline.compile(pipeline.load(path), None).world
    path.write_text(text + "joints: {pin: {objects: [dog], pivot: [400, 300]}}\n")
    pinned = pipeline.compile(pipeline.load(path), None).world
    assert "joint" not in balance_advice(alone)
    assert "mass" not in balance_advice(alone)
    assert "joint" in balance_advice(pinned)


def test_free_fall_is_exact_from_a_divided_first_step(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [4000, 2000]\n"
        "world: {duration: 0.5, gravity: [0, 40000]}\n"
        "objects:\n"
        "  ball:\n"
        "    shape: {circle: {center: [2000, 100], radius: 5}}\n"
        "    velocity: [-5000, 0]\n"
        "boundaries: {slope: {segment: [[2500, 9000], [-9000, 50]]}}\n"
    )
    world = pipeline.compile(pipeline.load(path), None).world
    times = np.arange(0, 0.5, 0.125)
    trajectory = simulate(world, times)
    assert trajectory.effort.divided > 0
    fall = 100 + 40000 * times**2 / 2
    assert trajectory.poses[:, 0, 1] == pytest.approx(fall, abs=1e-6)
