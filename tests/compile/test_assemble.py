"""Scene -> World against closed forms."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import written
from pytest import approx

from physgen.compile.world import pair_table
from physgen.problems import InputError
from physgen.scene.scene import Motion


def compiled(tmp_path: Path, body: str, head: str = "size: [200, 150]"):
    return written.compiled(tmp_path, f"physgen: 1\n{head}\n{body}")


@pytest.mark.parametrize(
    ("solid", "k"), [("sphere", 0.4), ("disc", 0.5), ("hoop", 1.0), ("plate", 0.5)]
)
def test_moment_of_a_circle(tmp_path: Path, solid: str, k: float) -> None:
    [body] = compiled(
        tmp_path,
        f"objects: {{a: {{shape: {{circle: {{center: [50, 60], radius: 10}}}}, solid: {solid}, mass: 7}}}}",
    ).world.bodies
    assert (body.mass, body.radius, body.moment) == (7, 10, approx(k * 7 * 100))
    assert body.center.tolist() == [50, 60]


def test_mass_or_density_for_every_shape(tmp_path: Path) -> None:
    w = compiled(
        tmp_path,
        """\
objects:
  circle: {shape: {circle: {center: [50, 60], radius: 10}}, density: 2}
  box: {shape: {box: {center: [100, 60], size: [30, 20], angle: 30}}, mass: 5}
  frame:
    density: 3
    shape:
      polygons:
        - outline: [[120, 20], [160, 20], [160, 60], [120, 60]]
          holes: [[[130, 30], [150, 30], [150, 50], [130, 50]]]
  two:
    shape:
      polygons:
        - {outline: [[0, 0], [10, 0], [10, 10], [0, 10]]}
        - {outline: [[20, 0], [30, 0], [30, 10], [20, 10]]}
""",
    ).world
    box, circle, frame, two = w.bodies  # by name
    assert circle.mass == approx(2 * np.pi * 100)
    assert (box.mass, box.moment) == (5, approx(5 * (30**2 + 20**2) / 12))
    assert frame.mass == approx(3 * (1600 - 400))
    assert frame.moment == approx(3 * (1600 * 3200 - 400 * 800) / 12)
    assert frame.center == approx([140, 40])
    area = sum(cv2.contourArea(piece.astype(np.float32)) for piece in frame.pieces)
    assert area == approx(1200, rel=1e-6)
    assert two.mass == approx(200)  # density 1 unless said
    assert two.moment == approx(2 * (100 * 200 / 12 + 100 * 100))
    assert two.center == approx([15, 5])


def test_fitted_shape_and_pixels_share_one_centre(tmp_path: Path) -> None:
    labels = np.zeros((150, 200), np.uint16)
    labels[
        np.hypot(*(np.mgrid[:150, :200] - np.array([60, 50])[:, None, None])) <= 20
    ] = 1
    labels[80:120, 100:130] = 2
    labels[100:120, 130:170] = 2  # an L
    photo = np.full((150, 200, 3), 100, np.uint8)
    cv2.imwrite(str(tmp_path / "photo.png"), photo)
    (tmp_path / "photo.assets").mkdir()
    cv2.imwrite(str(tmp_path / "photo.assets" / "masks.png"), labels)
    c = compiled(
        tmp_path,
        "objects: {ball: {mask: 1}, l: {mask: 2}}",
        "image: photo.png\nassets: photo.assets",
    )
    for k, body in enumerate(c.world.bodies, 1):
        rows, columns = np.nonzero(labels == k)
        assert body.center == approx([columns.mean(), rows.mean()], abs=0.1)
    assert c.world.bodies[0].radius == approx(20, abs=0.5)
    assert len(c.world.bodies[1].pieces) == 2
    assert np.array_equal(c.labels, labels)


def test_masks_written_in_the_scene(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((4, 6, 3), 100, np.uint8))
    c = compiled(
        tmp_path,
        "objects: {a: {mask: {polygon: [[0.7, 0.7], [3.3, 0.7], [3.3, 2.3], [0.7, 2.3]]}}}",
        "image: photo.png",
    )
    expected = np.zeros((4, 6), int)
    expected[1:3, 1:4] = 1  # pixels whose centres lie inside
    assert c.labels.tolist() == expected.tolist()
    assert c.world.bodies[0].center == approx([2, 1.5])


@pytest.mark.parametrize(
    ("combine", "friction", "elasticity"),
    [("geometric", 0.2, 0.6), ("multiply", 0.04, 0.36)],
)
def test_pair_coefficients(
    tmp_path: Path, combine: str, friction: float, elasticity: float
) -> None:
    w = compiled(
        tmp_path,
        f"""\
world: {{combine: {combine}}}
objects:
  a: {{shape: {{circle: {{center: [50, 60], radius: 10}}}}, friction: 0.4, elasticity: 0.9}}
boundaries: {{floor: {{segment: [[0, 100], [200, 100]], friction: 0.1, elasticity: 0.4}}}}
""",
    ).world
    [pair] = pair_table(w)
    assert (pair.first, pair.second) == ("a", "floor")
    assert (pair.friction, pair.elasticity) == (approx(friction), approx(elasticity))


@pytest.mark.parametrize(
    ("view", "friction", "told"),
    [("top", 0.2, True), ("top", 0, False), ("side", 0.2, False)],
)
def test_the_table_is_among_the_pairs_seen_from_above(
    tmp_path: Path, view: str, friction: float, told: bool
) -> None:
    w = compiled(
        tmp_path,
        f"""\
world: {{view: {view}, table: {{friction: {friction}}}}}
objects:
  a: {{shape: {{circle: {{center: [50, 60], radius: 10}}}}, friction: 0.8}}
  b: {{shape: {{circle: {{center: [90, 60], radius: 10}}}}, friction: 0.8}}
  c: {{shape: {{circle: {{center: [130, 60], radius: 10}}}}, friction: 0.05}}
boundaries: {{table: {{segment: [[0, 100], [200, 100]]}}}}
""",
    ).world
    rows = {(p.first, p.second): p.friction for p in pair_table(w)}
    assert ("a, b", "table") in rows  # the wall of that name
    table = (
        {("a, b", "the table"): approx(0.4), ("c", "the table"): approx(0.1)}
        if told
        else {}
    )
    assert {key: value for key, value in rows.items() if key[1] == "the table"} == table


def test_units_and_loads(tmp_path: Path) -> None:
    w = compiled(
        tmp_path,
        """\
world: {view: top, duration: 0.5}
objects:
  a: {shape: {circle: {center: [50, 60], radius: 10}}, spin: 180, velocity: [3, 4]}
  p: {shape: {circle: {center: [90, 60], radius: 10}}, motion: {path: [[0, 90, 60], [1, 90, 80, 90]]}}
forces:
  - {object: a, force: [1, 2], at: [55, 60], start: 0.1, duration: 0.2}
  - {object: a, torque: 5}
render: {frames: 10}
""",
    ).world
    assert w.gravity.tolist() == [0, 0]
    assert w.bodies[0].spin == approx(np.pi)
    assert w.bodies[1].motion is Motion.SCRIPTED
    assert w.bodies[1].path[-1] == approx([1, 90, 80, np.pi / 2])
    force, torque = w.pushes
    assert force.point.tolist() == [5, 0]
    assert (force.start, force.end, torque.end) == (0.1, approx(0.3), np.inf)
    assert w.times == approx(np.arange(10) * 0.05)


@pytest.mark.parametrize(
    ("masses", "message"),
    [
        (
            ("1.0e-300", "1"),
            "objects.dust.mass: 1e-300 g and a moment of inertia of 3.2e-299 g·px² cannot be",
        ),
        (
            ("1.0e-320", "1"),
            "objects.dust.mass: 1e-320 g and a moment of inertia of 3.2e-319 g·px² cannot be",
        ),
        (
            ("1.0e-3", "1.0e6"),
            "objects.dust.mass: 0.001 g, and 1e+06 g of rock: masses 10^9 apart or more cannot",
        ),
    ],
)
def test_masses_that_no_engine_takes(
    tmp_path: Path, masses: tuple[str, str], message: str
) -> None:
    body = """\
objects:
  dust: {{shape: {{circle: {{center: [50, 60], radius: 8}}}}, mass: {}}}
  rock: {{shape: {{circle: {{center: [90, 60], radius: 8}}}}, mass: {}}}
"""
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        compiled(tmp_path, body.format(*masses))
    assert caught.value.problems[0].place.line == 4
    held = body.replace("radius: 8}}}}, mass", "radius: 8}}}}, motion: static, mass", 1)
    assert compiled(tmp_path, held.format(*masses)).world.bodies[1].mass == float(
        masses[1]
    )


def test_a_mask_that_is_hidden_or_needs_a_photo(tmp_path: Path) -> None:
    hidden = """\
objects:
  a: {mask: {polygon: [[5, 5], [10, 5], [10, 10]]}}
  b: {mask: {polygon: [[4, 4], [12, 4], [12, 12], [4, 12]]}, layer: 2}"""
    with pytest.raises(
        InputError,
        match=r"objects.a.mask: a is hidden behind the masks of others; write its shape",
    ):
        compiled(tmp_path, hidden)
    (tmp_path / "photo.assets").mkdir()
    cv2.imwrite(
        str(tmp_path / "photo.assets" / "masks.png"), np.ones((150, 200), np.uint16)
    )
    for thing in ("objects: {a: {mask: 1}}", "boundaries: {a: {mask: 1}}"):
        with pytest.raises(
            InputError,
            match=r"1 is an id, but the scene has no photo and so no masks\.png",
        ):
            compiled(tmp_path, thing, "size: [200, 150]\nassets: photo.assets")


def test_a_path_begins_where_its_object_is(tmp_path: Path) -> None:
    box = "shape: {box: {center: [20, 50], size: [10, 10]}}"
    body = f"objects: {{a: {{{box}, motion: {{path: [[0, 60, 50], [1, 100, 50]]}}}}}}"
    with pytest.raises(
        InputError,
        match=r"3:\d+: objects.a.motion.path: the first knot is not at the object; begin with",
    ):
        compiled(tmp_path, body)
