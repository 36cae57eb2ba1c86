"""extends, variants and --set: what merges, what replaces, what goes, and who is named when it is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from physgen.problems import InputError
from physgen.scene import scene as model
from physgen.scene.load import OpenedScene, load
from physgen.scene.overlay import parse_key

BASE: dict[str, Any] = {
    "physgen": 1,
    "size": [64, 48],
    "world": {"view": "top", "duration": 3},
    "objects": {
        "ball": {
            "shape": {"circle": {"center": [20, 20], "radius": 8}},
            "mass": 170,
            "friction": 0.3,
        },
        "crate": {"shape": {"box": {"center": [40, 20], "size": [8, 6]}}, "density": 2},
    },
    "boundaries": {"wall": {"segment": [[0, 0], [0, 40]], "friction": 0.1}},
    "forces": [{"object": "ball", "impulse": [1, 2]}, {"object": "crate", "torque": 3}],
    "light": {"direction": [0, 0, 1], "intensity": 2},
    "variants": {"fast": {"objects.ball.velocity": [100, 0]}},
}


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "base.yaml"
    path.write_text(yaml.safe_dump(BASE, sort_keys=False))
    return path


def over(base: Path, text: str) -> Path:
    path = base.with_name("over.yaml")
    path.write_text(f"physgen: 1\nextends: base.yaml\n{text}")
    return path


def named(scene: model.Scene) -> dict[str, model.Object]:
    return {item.name: item for item in scene.objects}


def said(*args: Any, **kwargs: Any) -> list[str]:
    with pytest.raises(InputError) as caught:
        load(*args, **kwargs)
    return [str(problem) for problem in caught.value.problems]


# extends


def test_mappings_merge(scene: Path) -> None:
    found = load(
        over(scene, "world: {duration: 5}\nobjects: {ball: {friction: 0.9}}\n")
    )
    assert (found.world.view, found.world.duration) == (model.View.TOP, 5)
    ball = named(found)["ball"]
    assert (ball.friction, ball.mass, ball.shape) == (
        0.9,
        170,
        model.Circle((20, 20), 8),
    )
    assert list(named(found)) == ["ball", "crate"]


@pytest.mark.parametrize(("key", "other"), [("mass", "density"), ("density", "mass")])
def test_mass_and_density_drop_each_other(key: str, other: str, scene: Path) -> None:
    name = "crate" if key == "mass" else "ball"
    for found in (
        load(over(scene, f"objects: {{{name}: {{{key}: 7}}}}\n")),
        load(scene, [f"objects.{name}.{key}=7"]),
        load(scene, [f"objects.*.{key}=7"]),
    ):
        item = named(found)[name]
        assert getattr(item, key) == 7
        assert getattr(item, other) is None


TRIANGLE = ((0, 0), (9, 0), (0, 9))


def test_lists_and_other_kinds_replace_and_parts_of_a_shape_merge(scene: Path) -> None:
    text = "forces: []\nobjects: {ball: {shape: {circle: {radius: 9}}}, crate: {shape: {box: {center: [1, 2]}}}}\n"
    found = load(over(scene, text))
    assert found.forces == ()
    assert named(found)["ball"].shape == model.Circle((20, 20), 9)
    assert named(found)["crate"].shape == model.Box((1, 2), (8, 6))
    text = "objects: {ball: {shape: {polygon: [[0, 0], [9, 0], [0, 9]]}}}\n"
    text += "boundaries: {wall: {polyline: [[0, 0], [5, 5]]}}\n"
    found = load(
        over(scene, text), ["forces[0].force=[0, 5]", "forces[1].impulse=[1, 1]"]
    )
    assert named(found)["ball"].shape == model.Polygon((model.Ring(TRIANGLE),))
    assert (found.boundaries[0].points, found.boundaries[0].friction) == (
        ((0, 0), (5, 5)),
        0.1,
    )
    assert [force.load for force in found.forces] == [
        model.Load.FORCE,
        model.Load.IMPULSE,
    ]


def test_another_kind_of_mask_and_motion_replace(scene: Path) -> None:
    path = over(
        scene,
        "objects: {ball: {mask: {polygon: [[0, 0], [9, 0], [0, 9]]}, motion: static}}\n",
    )
    assert named(load(path))["ball"].motion is model.Motion.STATIC
    found = load(
        path,
        [
            "objects.ball.motion={path: [[0, 1, 2], [1, 2, 3]]}",
            "objects.ball.shape=auto",
        ],
    )
    assert named(found)["ball"].path[1] == model.Waypoint(1, (2, 3), 0)


def test_null_takes_away(scene: Path) -> None:
    path = over(
        scene, "forces: null\nlight: ~\nobjects:\n  crate:\n  ball: {mass: null}\n"
    )
    found = load(path)
    assert list(named(found)) == ["ball"]
    assert (found.light, found.forces, named(found)["ball"].density) == (None, (), 1)


def test_a_chain_of_files_each_with_its_own_photo_folder(tmp_path: Path) -> None:
    from PIL import Image

    for name in ("pool", "table", "mine"):
        (tmp_path / name).mkdir()
    Image.new("RGB", (30, 20)).save(tmp_path / "pool" / "photo.png")
    (tmp_path / "pool" / "scene.yaml").write_text(
        "physgen: 1\nimage: photo.png\nworld: {view: top, duration: 3}\n"
    )
    (tmp_path / "table" / "scene.yaml").write_text(
        "physgen: 1\nextends: ../pool/scene.yaml\nworld: {duration: 4}\n"
    )
    (tmp_path / "mine" / "scene.yaml").write_text(
        "physgen: 1\nextends: ../table/scene.yaml\nrender: {fps: 24}\n"
    )
    found = load(tmp_path / "mine" / "scene.yaml")
    assert found.name == "mine"
    assert found.image == (tmp_path / "pool" / "photo.png").resolve()
    assert (found.world.view, found.world.duration, found.render.fps) == (
        model.View.TOP,
        4,
        24,
    )
    assert found.document["image"] == "../pool/photo.png"
    assert "extends" not in found.document
    assert found.place("world.duration").file.endswith("table/scene.yaml")
    assert found.place("world.view").line == 3


def test_files_further_away_need_the_flag(tmp_path: Path) -> None:
    (tmp_path / "far.yaml").write_text("physgen: 1\nsize: [3, 4]\n")
    home = tmp_path / "a" / "b"
    home.mkdir(parents=True)
    (home / "scene.yaml").write_text("physgen: 1\nextends: ../../far.yaml\n")
    assert "leads out of the folder above" in said(home / "scene.yaml")[0]
    assert load(home / "scene.yaml", allow_outside=True).size == (3, 4)
    (home / "scene.yaml").write_text(f"physgen: 1\nextends: {tmp_path / 'far.yaml'}\n")
    assert "is an absolute path" in said(home / "scene.yaml")[0]
    assert load(home / "scene.yaml", allow_outside=True).size == (3, 4)


# joints, fields and masks of boundaries


HELD = """\
joints:
  hinge: {objects: [ball], pivot: [20, 5]}
  band: {objects: [ball, crate], spring: [[20, 20], [40, 20]], stiffness: 3}
fields:
  breeze: {wind: [5, 0], drag: 1}
boundaries:
  wall: {mask: {polygon: [[0, 0], [9, 0], [0, 9]]}}
"""


def test_joints_and_fields_merge_and_go(scene: Path) -> None:
    held = over(scene, HELD)
    top = held.with_name("top.yaml")
    top.write_text(
        "physgen: 1\nextends: over.yaml\njoints: {band: {damping: 7}, hinge: null}\n"
        "fields: {breeze: {attractor: [1, 2], strength: 9, drag: null}}\nvariants: {still: {fields.breeze: null}}\n"
    )
    found = load(top)
    (band,) = found.joints
    assert (band.name, band.stiffness, band.damping) == ("band", 3, 7)
    (field,) = found.fields  # another kind replaces
    assert (field.kind, field.vector, field.strength) == (
        model.FieldKind.ATTRACTOR,
        (1, 2),
        9,
    )
    assert load(top, variant="still").fields == ()
    assert load(top, ["joints={}"]).joints == ()


def test_parts_of_joints_are_set(scene: Path) -> None:
    held = over(scene, HELD)
    flags = [
        "joints.hinge.pivot.0=100",
        "joints.band.spring[1][0]=30",
        "joints.*.collide=true",
    ]
    band, hinge = load(held, [*flags, "fields.breeze.wind.1=-2"]).joints
    assert (hinge.points, hinge.collide) == (((100, 5),), True)
    assert (band.points, band.collide) == (((20, 20), (30, 20)), True)
    (weld,) = load(held, ["joints.hinge.weld=[20, 20]", "joints.band=null"]).joints
    assert (weld.kind, weld.points) == (model.JointKind.WELD, ((20, 20),))


def test_a_mask_takes_the_place_of_a_wall(scene: Path) -> None:
    (wall,) = load(over(scene, HELD)).boundaries
    assert (wall.points, wall.mask, wall.friction) == (
        (),
        model.MaskPolygon(((0, 0), (9, 0), (0, 9))),
        0.1,
    )
    (wall,) = load(
        over(scene, HELD), ["boundaries.wall.segment=[[0, 1], [2, 3]]"]
    ).boundaries
    assert (wall.points, wall.mask) == (((0, 1), (2, 3)), None)


# --set


def test_star_is_every_object(scene: Path) -> None:
    found = load(
        scene,
        ["objects.*.friction=0.8", "forces[*].start=0.5", "boundaries.*.friction=0.7"],
    )
    assert {item.friction for item in found.objects} == {0.8}
    assert {force.start for force in found.forces} == {0.5}
    assert found.boundaries[0].friction == 0.7


def test_star_of_nothing_and_the_last_set(scene: Path) -> None:
    assert load(scene, ["objects={}", "forces=[]", "objects.*.mass=3"]).objects == ()
    assert [
        item.friction for item in load(scene, ["objects.*.friction=null"]).objects
    ] == [0.5, 0.5]
    assert (
        named(load(scene, ["objects.ball.mass=1", "objects.ball.mass=2"]))["ball"].mass
        == 2
    )
    assert (
        named(load(scene, ["objects.ball.mass=1", "objects.ball.density=2"]))[
            "ball"
        ].mass
        is None
    )


def test_set_mends_what_the_file_has_wrong(scene: Path) -> None:
    scene.write_text(scene.read_text().replace("mass: 170", "mass: heavy"))
    assert len(said(scene)) == 1
    assert named(load(scene, ["objects.ball.mass=3"]))["ball"].mass == 3


def test_places_of_what_was_set(scene: Path) -> None:
    found = load(scene, ["objects.ball.mass=3"], "fast")
    assert str(found.place("objects.ball.mass")) == "--set objects.ball.mass=3"
    assert found.place("objects.ball.velocity").line > 30
    assert found.place("objects.ball.elasticity") == found.place("objects.ball")


# variants


def test_order_of_overlays(scene: Path) -> None:
    path = over(
        scene,
        "objects: {ball: {friction: 0.4, spin: 4, layer: 4}}\n"
        "variants: {v: {objects.ball.spin: 5, objects.ball.layer: 5}}\n",
    )
    ball = named(load(path, ["objects.ball.layer=6"], "v"))["ball"]
    assert (ball.mass, ball.friction, ball.spin, ball.layer) == (170, 0.4, 5, 6)
    assert load(path).variants == ("fast", "v")
    assert named(load(path, variant="fast"))["ball"].velocity == (100, 0)


def test_every_variant_is_checked(scene: Path) -> None:
    text = (
        "variants: {a: {objects.ball.mass: -1}, b: {forces: [{object: none, torque: 1}]},"
        " c: {light.direction: [0, 0, 0]}}\n"
    )
    opened = OpenedScene(over(scene, text))
    opened.scene(["objects.ball.mass=3"])
    problems = opened.variant_problems
    assert [(problem.variant, problem.path) for problem in problems] == [
        ("a", "objects.ball.mass"),
        ("b", "forces[0].object"),
        ("c", "light.direction"),
    ]
    assert all("over.yaml:3:" in str(problem) for problem in problems)


def test_variants_are_whole_after_each_other(scene: Path) -> None:
    """A variant starts from the file, never from the variant before it."""
    text = (
        "variants: {a: {objects.ball: null, forces: []}, b: {objects.ball.mass: 3}}\n"
    )
    found = load(over(scene, text), variant="b")
    assert found.variants == ("fast", "a", "b")
    assert named(found)["ball"].mass == 3


@pytest.mark.parametrize(
    "key",
    [
        "",
        ".",
        "a.",
        ".a",
        "a..b",
        "a[",
        "a[x]",
        "a[1",
        "a]b",
        "[0]",
        "a[-1]",
        "a[1]b",
        "a" + ".a" * 99,
    ],
)
def test_no_dotted_keys(key: str) -> None:
    assert parse_key(key) is None


def test_a_part_of_a_vector_that_the_file_leaves_out_is_set_beside_its_default(
    scene: Path,
) -> None:
    found = named(load(scene, ["objects.*.velocity.0=-30"], variant="fast"))
    assert (found["ball"].velocity, found["crate"].velocity) == ((-30, 0), (-30, 0))
    assert said(scene, ["world.gravity.1=100"]) == [
        "--set world.gravity.1=100: world.gravity is not a list; write world.gravity=[...] to set all of it"
    ]
