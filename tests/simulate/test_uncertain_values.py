"""Which numbers are drawn, and that draws keep to themselves whatever else is in the scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from written import loaded

from physgen import pipeline
from physgen.compile.compile import compile_shapes
from physgen.simulate.uncertain_values import draw_values, uncertain_values, with_draw

BASE = """\
physgen: 1
size: [200, 120]
objects:
  ball: {shape: {circle: {center: [30, 60], radius: 8}}, mass: 5, friction: 0.4,
    from: {mass: table 0.4, friction: table 0.7}}
  block: {label: block, shape: {box: {center: [90, 60], size: [20, 12]}}, density: 0.2, elasticity: 0.3,
    from: {density: by eye 0.3, elasticity: table 0.5, mask: given 0.2}}
  other: {label: Block, shape: {box: {center: [150, 60], size: [20, 12]}}, mass: 40, from: {mass: by eye 0.6}}
  wall: {shape: {box: {center: [180, 60], size: [6, 60]}}, motion: static, mass: 3, friction: 0.2,
    from: {mass: table 0.1, friction: table 1}}
boundaries:
  floor: {segment: [[0, 100], [199, 100]], friction: 0.3, from: lowest points 0.6}
  frame: {segment: [[0, 0], [0, 119]], from: photo 1}
light: {direction: [0.3, -0.6, 0.74], from: shadows 0.8}
variants: {heavy: {objects.ball.mass: 50}}
"""


def paths(scene, variant: str | None = None) -> set[str]:
    return {
        doubt.path.removeprefix("objects.")
        for doubt in uncertain_values(scene, variant)
    }


ALL = {
    "ball.mass", "ball.friction", "block.density", "block.elasticity", "other.mass",
    "boundaries.floor.friction", "boundaries.floor.elasticity",
}  # fmt: skip


def test_only_what_somebody_guessed_is_drawn(tmp_path: Path) -> None:
    """No mass of what does not move, nothing that is sure, no mask."""
    scene = loaded(tmp_path, BASE)
    assert paths(scene) == ALL
    assert paths(
        loaded(tmp_path, BASE.replace(" 0.4, friction: table 0.7", ", friction: table"))
    ) == ALL - {
        "ball.mass",
        "ball.friction",
    }, "who does not say how sure he is, is not drawn"


@pytest.mark.parametrize(
    ("overrides", "variant", "gone"),
    [
        (["objects.ball.mass=7"], None, {"ball.mass"}),
        (["objects.*.friction=0.5"], None, {"ball.friction"}),
        ([], "heavy", {"ball.mass"}),
        (["boundaries.floor.friction=0.2"], None, {"boundaries.floor.friction"}),
        (["objects.ball.mass=7", "objects.ball.from.mass=scales 0.9"], None, set()),
        (["objects.ball.from={}"], None, {"ball.mass", "ball.friction"}),
    ],
)
def test_what_a_person_set_is_certain(
    tmp_path: Path, overrides: list[str], variant: str | None, gone: set[str]
) -> None:
    assert (
        paths(loaded(tmp_path, BASE, *overrides, variant=variant), variant)
        == ALL - gone
    )


def test_draws_are_their_own(tmp_path: Path) -> None:
    """The k-th draw is the same however many there are, whoever else is there, in whatever order."""
    scene = loaded(tmp_path, BASE)
    found = {
        d.path: col
        for d, col in zip(
            uncertain_values(scene),
            draw_values(uncertain_values(scene), 7, 40).T,
            strict=True,
        )
    }
    again = draw_values(uncertain_values(scene), 7, 9)
    assert np.array_equal(again, np.array(list(found.values())).T[:9])
    fewer = uncertain_values(
        loaded(tmp_path, BASE, "objects.block=null", "boundaries.floor=null")
    )
    assert {d.path for d in fewer} == {
        "objects.ball.mass",
        "objects.ball.friction",
        "objects.other.mass",
    }
    for doubt, column in zip(fewer, draw_values(fewer, 7, 40).T, strict=True):
        assert np.array_equal(column, found[doubt.path]), doubt.path
    other = draw_values(uncertain_values(scene), 8, 40)
    assert not (other == np.array(list(found.values())).T).any()


def test_what_is_called_alike_is_alike(tmp_path: Path) -> None:
    """Of one matter, whatever that is; each as far off as its own confidence says."""
    names = {d.path: k for k, d in enumerate(uncertain_values(loaded(tmp_path, BASE)))}
    values = draw_values(uncertain_values(loaded(tmp_path, BASE)), 0, 50)
    heavy = np.log(values[:, names["objects.block.density"]] / 0.2) / np.log(1 / 0.3)
    # a density and a mass are two parameters: only equal ones go together
    other = np.log(values[:, names["objects.other.mass"]] / 40) / np.log(1 / 0.6)
    assert abs(np.corrcoef(heavy, other)[0, 1]) < 0.5
    text = BASE.replace("density: 0.2", "mass: 20").replace(
        "density: by eye", "mass: by eye"
    )
    found = uncertain_values(loaded(tmp_path, text))
    columns = dict(
        zip((d.path for d in found), draw_values(found, 0, 50).T, strict=True)
    )
    heavy = np.log(columns["objects.block.mass"] / 20) / np.log(1 / 0.3)
    assert np.allclose(
        heavy, np.log(columns["objects.other.mass"] / 40) / np.log(1 / 0.6)
    )
    guessed = text.replace("mask: given 0.2", "label: shape 0.0")
    found = uncertain_values(loaded(tmp_path, guessed))
    columns = dict(
        zip((d.path for d in found), draw_values(found, 0, 50).T, strict=True)
    )
    own = np.log(columns["objects.block.mass"] / 20) / np.log(1 / 0.3)
    assert abs(np.corrcoef(own, heavy)[0, 1]) < 0.5, (
        "a name that is a mere guess makes nothing alike"
    )


def test_a_draw_is_the_scene_with_other_numbers(tmp_path: Path) -> None:
    """Beside the way of files and flags: masses, moments and pairs follow."""
    scene = loaded(tmp_path, BASE)
    found, compiled = uncertain_values(scene), pipeline.compile(scene, None)
    values = draw_values(found, 3, 4)
    for row in values:
        world = compile_shapes(with_draw(scene, found, row), compiled.shapes).world
        flags = [
            f"{doubt.path}={value!r}"
            for doubt, value in zip(found, row.tolist(), strict=True)
        ]
        written = pipeline.compile(loaded(tmp_path, BASE, *flags), None).world
        for body, other in zip(world.bodies, written.bodies, strict=True):
            assert (body.mass, body.moment, body.surface) == (
                other.mass,
                other.moment,
                other.surface,
            )
        assert [wall.surface for wall in world.walls] == [
            wall.surface for wall in written.walls
        ]
        first = compiled.world.bodies[0]
        assert world.bodies[0].moment / first.moment == pytest.approx(
            world.bodies[0].mass / first.mass
        )
