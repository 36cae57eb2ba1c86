from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.perceive.import_physgen import import_physgen
from physgen.perceive.import_shot import as_shot
from physgen.perceive.scene_files import write_scene
from physgen.problems import InputError, Severity
from physgen.scene.load import load
from physgen.scene.scene import Circle, Combine, Load, Polygon, Solid, Striker, View
from tests.perceive.lambertian import beyond_halos

SIM = """\
cat: two
animation_frames: 16
size: [96, 96]
num_steps: 120
gravity: 980
init_velocity:
  1: [-100, 5]
init_acc:
  2: [-50, 0]
edge_list: [[[0, 80], [96, 80]], [[1, 1], [1, 95]]]
obj_info:
  1: {label: ball, mass: 170, density: , friction: 0.3, elasticity: 0.7, primitive: circle}
  2: {label: toy, mass: , density: 2.5, friction: 0.5, elasticity: 0.01, primitive: polygon}
denoise_strength: 0.4
"""


def folder(path: Path, sim: str = SIM) -> Path:
    """A ball (1), a round polygon (2) and something that is in the mask alone (3)."""
    path.mkdir(exist_ok=True)
    y, x = np.mgrid[:96, :96]
    mask = np.zeros((96, 96), np.uint8)
    mask[np.hypot(x - 30, y - 60) <= 16] = 1
    mask[np.hypot(x - 70, y - 60) <= 14] = 2
    mask[5:15, 40:60] = 3
    rgb = np.full((96, 96, 3), 90, np.uint8) + (x // 4)[:, :, None].astype(np.uint8)
    normals = np.zeros((96, 96, 3), np.float32)
    normals[..., 2] = 1
    for i, (cx, cy, r) in {1: (30, 60, 16.6), 2: (70, 60, 14.6)}.items():
        on = mask == i
        rgb[on] = (60, 60, 200)
        nx, ny = ((x - cx) / r)[on], ((y - cy) / r)[on]
        normals[on] = np.stack(
            [-nx, -ny, np.sqrt(np.maximum(0, 1 - nx**2 - ny**2))], -1
        )  # x left, y up, as theirs
    flat = np.full((96, 96, 3), 70, np.uint8)
    true = normals * (-1, -1, 1)
    shading = 0.3 + 0.6 * np.maximum(0, true @ (np.array([-3, -4, 5]) / np.sqrt(50)))
    cv2.imwrite(str(path / "original.png"), rgb)
    cv2.imwrite(str(path / "mask.png"), mask)
    cv2.imwrite(str(path / "inpaint.png"), flat)
    np.save(path / "normal.npy", normals)
    np.save(path / "shading.npy", shading.astype(np.float32))
    np.save(path / "depth.npy", (1 - mask / 9).astype(np.float32))
    (path / "sim.yaml").write_text(sim)
    return path


@pytest.fixture
def scene(tmp_path: Path):
    found = import_physgen(folder(tmp_path / "two", SIM + "my_own_note: 3\n"))
    (warning,) = found.warnings
    assert warning.severity is Severity.WARNING
    assert "my_own_note" in str(warning)
    write_scene(
        found, tmp_path / "two" / "original.png", "original", tmp_path / "scene.yaml"
    )
    return load(tmp_path / "scene.yaml")


def test_it_means_what_its_author_meant(scene):
    assert scene.world.combine is Combine.MULTIPLY
    assert scene.world.view is View.SIDE
    assert scene.world.gravity == (0, 980)
    assert scene.world.duration == pytest.approx(2.0)
    assert (scene.render.frames, scene.render.fps) == (16, 8)
    assert scene.refine.strength == 0.4
    ball, toy = scene.objects
    assert isinstance(ball.shape.stored, Circle)
    assert ball.solid is Solid.DISC
    assert (ball.mass, ball.friction, ball.elasticity, ball.velocity) == (
        170,
        0.3,
        0.7,
        (-100, 5),
    )
    assert isinstance(toy.shape.stored, Polygon)  # as it says, though it is round
    assert (toy.density, toy.friction, toy.elasticity) == (2.5, 0.5, 0.01)
    assert [w.points for w in scene.boundaries] == [
        ((0, 80), (96, 80)),
        ((1, 1), (1, 95)),
    ]
    assert {(w.friction, w.elasticity) for w in scene.boundaries} == {(1, 0)}


def test_a_change_of_velocity_becomes_an_impulse(scene):
    (force,) = scene.forces
    assert (force.object, force.load) == ("toy-1", Load.IMPULSE)
    mass = 2.5 * np.pi * 14.0**2
    assert force.vector == (pytest.approx(-50 * mass, rel=0.03), 0)
    # There, a polygon's body has its place in the picture's corner.
    assert force.at == (0, 0)


def test_maps_are_in_our_axes(tmp_path: Path):
    percepts = import_physgen(folder(tmp_path / "two")).percepts
    assert set(np.unique(percepts.labels)) == {0, 1, 2}  # 3 is no object
    assert percepts.normals is not None
    assert percepts.normals[60, 42, 0] > 0.5  # the ball's right side looks right
    assert percepts.normals[72, 30, 1] > 0.5  # its lower side looks down
    assert percepts.depth is not None
    assert percepts.depth[60, 30] < percepts.depth[30, 5]
    assert percepts.albedo is not None
    assert percepts.albedo.max() <= 1
    assert percepts.background is not None
    kept = beyond_halos(percepts.coverage)
    assert np.array_equal(percepts.background[kept], percepts.rgb[kept])
    inside = percepts.background[percepts.labels == 1].astype(int)
    expected = 90 + np.mgrid[:96, :96][1][percepts.labels == 1] // 4
    assert (
        np.abs(inside - expected[:, None]).max() <= 2
    )  # the flat filling took the photo's gradient


def test_the_light_comes_from_its_maps(scene):
    assert scene.light is not None
    assert scene.light.direction == pytest.approx(
        np.array([-3, -4, 5]) / np.sqrt(50), abs=0.02
    )
    assert (scene.light.intensity, scene.light.ambient) == pytest.approx(
        (0.6, 0.3), abs=0.02
    )


def test_no_gravity_is_a_table_from_above(tmp_path: Path):
    found = import_physgen(
        folder(tmp_path / "two", SIM.replace("gravity: 980", "gravity: 0"))
    )
    assert found.document["world"]["view"] == "top"
    assert found.document["world"]["table"] == {"friction": 0}
    assert "elasticity 0: nothing bounces" in found.comments["boundaries"]


@pytest.mark.slow
def test_only_three_files_are_needed(tmp_path: Path):
    path = folder(tmp_path / "two")
    for name in ("inpaint.png", "normal.npy", "shading.npy", "depth.npy"):
        (path / name).unlink()
    found = import_physgen(path)
    assert found.percepts.normals is None
    assert found.percepts.background is not None
    assert "filled here" in found.comments["assets"]
    for name in ("mask.png", "sim.yaml"):
        (path / name).unlink()
    with pytest.raises(InputError) as error:
        import_physgen(path)
    assert len(error.value.problems) == 2


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (
            "num_steps: 120",
            "num_step: 120",
            '"num_step" is not a key of sim.yaml; did you mean "num_steps"?',
        ),
        ("mass: 170, ", "", "obj_info.1: a mapping is missing; write its mass, in g"),
        (
            "  2: [-50, 0]",
            "  4: [-50, 0]",
            "init_acc.4: 4 is not in obj_info; obj_info has 1, 2",
        ),
        (
            "[1, 95]]",
            "[1]]",
            "edge_list[1][1]: a list has the wrong form; write [x, y]",
        ),
    ],
)
def test_wrong_lines_are_named(tmp_path: Path, before: str, after: str, message: str):
    assert before in SIM
    with pytest.raises(InputError) as error:
        import_physgen(folder(tmp_path / "two", SIM.replace(before, after)))
    assert message in str(error.value)
    assert "sim.yaml:" in str(error.value)


def test_spoilt_files_are_refused(tmp_path: Path):
    path = folder(tmp_path / "two")
    np.save(path / "shading.npy", np.full((96, 96), np.nan, np.float32))
    with pytest.raises(InputError, match="NaN"):
        import_physgen(path)
    cv2.imwrite(str(path / "mask.png"), np.ones((9, 9), np.uint8))
    with pytest.raises(InputError, match="differs from original"):
        import_physgen(path)


@pytest.mark.slow
@pytest.mark.peer_scenes
@pytest.mark.parametrize(
    ("name", "objects", "view"),
    [("pool", 16, "top"), ("domino", 6, "side"), ("pig_ball", 2, "side")],
)
def test_the_paper_s_scenes(
    peer_scenes: Path, tmp_path: Path, name: str, objects: int, view: str
):
    found = import_physgen(peer_scenes / name)
    write_scene(
        found, peer_scenes / name / "original.png", "original", tmp_path / "scene.yaml"
    )
    scene = load(tmp_path / "scene.yaml")
    assert len(scene.objects) == objects
    assert scene.world.view.value == view
    percepts = found.percepts
    assert percepts.background is not None
    far = beyond_halos(percepts.coverage)
    assert np.array_equal(percepts.background[far], percepts.rgb[far])
    if name == "pool":
        (force,) = scene.forces
        assert force.vector == (pytest.approx(-1.0e6, rel=1e-5), 0)


def test_import_writes_a_scene_that_loads(tmp_path: Path) -> None:
    source, scene = folder(tmp_path / "two"), tmp_path / "scene.yaml"
    pipeline.import_physgen(source, scene)
    assert {item.label for item in load(scene).objects} >= {"ball", "toy"}


@pytest.mark.parametrize("faithful", [True, False])
def test_import_is_a_shot_unless_faithful(tmp_path: Path, faithful: bool) -> None:
    source, path = folder(tmp_path / "two"), tmp_path / "scene.yaml"
    pipeline.import_physgen(source, path, faithful=faithful)
    scene = load(path)
    balls = [item.solid for item in scene.objects if item.label == "ball"]
    assert balls
    if faithful:
        assert scene.render.frames is not None
        assert {ball.value for ball in balls if ball} == {"disc"}
        assert scene.render.hold == 0
        assert scene.render.enter is Striker.NONE
        return
    # What moves first has a visible cause.
    assert scene.render.enter is Striker.FINGER
    assert (scene.render.fps, scene.render.frames) == (30, None)
    assert {ball.value for ball in balls if ball} == {"sphere"}
    assert scene.world.until_rest
    assert not scene.forces
    toy = next(item for item in scene.objects if item.label == "toy")
    # The push at the picture's corner would fling it; its direction stays.
    assert toy.spin == 0
    assert toy.velocity[0] < 0
    assert toy.velocity[1] == 0
    assert scene.world.ramp > 0


def test_push_that_cancels_a_velocity_keeps_its_spin(tmp_path: Path) -> None:
    """It has no direction in which the object could be pushed."""
    sim = SIM.replace("  1: [-100, 5]\n", "  1: [-100, 5]\n  2: [50, 0]\n")
    source, path = folder(tmp_path / "two", sim), tmp_path / "scene.yaml"
    pipeline.import_physgen(source, path)
    toy = next(item for item in load(path).objects if item.label == "toy")
    assert toy.velocity == pytest.approx((0, 0), abs=0.1)
    assert toy.spin != 0


def test_lever_of_the_papers_push_is_a_spin(tmp_path: Path) -> None:
    shot = as_shot(import_physgen(folder(tmp_path / "two")))
    (toy,) = (
        entry for entry in shot.document["objects"].values() if entry["label"] == "toy"
    )
    # A disc of radius r pushed at the picture's corner: v y / (r² / 2).
    spin = np.degrees(-50 * 60 / (14**2 / 2))
    assert toy["spin"] == pytest.approx(spin, rel=0.05)


def test_shot_of_a_table_has_slow_balls_and_unseen_walls(tmp_path: Path) -> None:
    shot = as_shot(import_physgen(folder(tmp_path / "table", TABLE)))
    (ball,) = (
        entry for entry in shot.document["objects"].values() if entry.get("velocity")
    )
    assert np.hypot(*ball["velocity"]) == pytest.approx(3 * 96)
    assert shot.document["render"]["enter"] == "cue"
    assert ball["velocity"][0] == pytest.approx(-4 / 3 * ball["velocity"][1])
    walls = [wall["segment"] for wall in shot.document["boundaries"].values()]
    assert walls == [[[-47, -47], [-47, 143]], [[20, 1], [20, 95]]]


def test_shot_has_boxes_and_long_floors(tmp_path: Path) -> None:
    path = folder(tmp_path / "tower", TOWER)
    mask = np.zeros((96, 96), np.uint8)
    corners = np.array([[40, 30], [52, 31], [51, 80], [39, 79]])
    cv2.fillPoly(mask, [corners], 1)
    cv2.imwrite(str(path / "mask.png"), mask)
    shot = as_shot(import_physgen(path))
    (entry,) = shot.document["objects"].values()
    box = entry["shape"]["box"]
    # It stands on its floor, and not on a corner.
    assert "angle" not in box
    assert box["center"][1] + box["size"][1] / 2 == pytest.approx(82)
    assert box["size"] == pytest.approx([12, 49], abs=2)
    assert entry["velocity"] == pytest.approx([30, 0], rel=0.001)
    (wall,) = shot.document["boundaries"].values()
    assert wall["segment"] == [[-96, 82], [191, 82]]


TABLE = """\
cat: table
num_steps: 60
animation_frames: 16
gravity: 0
init_acc: {1: [-4000, 3000]}
edge_list: [[[1, 1], [1, 95]], [[20, 1], [20, 95]]]
obj_info:
  1: {label: ball, mass: 170, primitive: circle}
"""


TOWER = """\
cat: tower
num_steps: 60
animation_frames: 16
gravity: 980
init_acc: {1: [30, 0]}
edge_list: [[[0, 82], [95, 82]]]
obj_info:
  1: {label: block, density: 1.0, friction: 0.5, elasticity: 0.3, primitive: polygon}
"""


def test_pushed_ring_has_its_whole_velocity(tmp_path: Path) -> None:
    path = folder(tmp_path / "tower", TOWER)
    mask = np.zeros((96, 96), np.uint8)
    cv2.circle(mask, (46, 60), 20, 1, -1)
    cv2.circle(mask, (46, 60), 14, 0, -1)
    cv2.imwrite(str(path / "mask.png"), mask)
    (entry,) = as_shot(import_physgen(path)).document["objects"].values()
    assert any("holes" in piece for piece in entry["shape"]["polygons"])
    assert entry["velocity"] == pytest.approx([30, 0], rel=0.001)
