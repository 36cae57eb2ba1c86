"""What sets a scene in motion, on scenes whose answer is plain."""

from __future__ import annotations

import json
import re
from math import cos, radians, sin
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from physgen import pipeline
from physgen.cli.main import main
from physgen.compile.shapes import shapes_of
from physgen.compile.world import World
from physgen.geometry.scale import push_speed
from physgen.pipeline.push_outcomes import TRIAL, Grade
from physgen.pipeline.push_trials import compile_trials, simulate_push
from physgen.pipeline.pushes import (
    Push,
    default_push,
    motion_edits,
)
from physgen.problems import InputError
from physgen.simulate.engine import Running, simulate
from physgen.text import quantity

ROW = (
    "physgen: 1\nsize: [400, 200]\nworld: {pixels_per_meter: 800, duration: 1}\n"
    "objects:\n"
    + "".join(
        f"  domino-{k}: {{shape: {{box: {{center: [{100 + 22 * k}, 120], size: [8, 60]}}}}}}\n"
        for k in range(6)
    )
    + "boundaries: {floor: {segment: [[0, 150], [400, 150]]}}\n"
)


@pytest.fixture
def row(tmp_path: Path) -> Path:
    path = tmp_path / "scene.yaml"
    path.write_text(ROW)
    return path


def test_a_row_of_dominoes_is_pushed_at_its_end_and_falls(row: Path) -> None:
    scene = pipeline.load(row)
    push = default_push(scene, shapes_of(scene, None), {})
    assert push is not None
    assert push.name == "domino-0"
    assert push.velocity[0] > 0 == push.velocity[1]
    pushed = pipeline.load(
        row, [f"objects.{push.name}.velocity=[{push.velocity[0]}, 0]"]
    )
    angles = pipeline.simulate(pipeline.compile(pushed, None).world).poses[-1, :, 2]
    assert (np.degrees(angles) > 40).all()


@pytest.mark.parametrize(("first", "way"), [(32, 1), (258, -1)])
def test_the_last_of_a_row_falls_inside_the_picture(
    first: int, way: int, tmp_path: Path
) -> None:
    """The row stands at a border of the photo: pushed the other way it falls out of it."""
    path = tmp_path / "scene.yaml"
    path.write_text(
        re.sub(r"\[(\d+), 120\]", lambda m: f"[{int(m[1]) - 100 + first}, 120]", ROW)
    )
    scene = pipeline.load(path)
    push = default_push(scene, shapes_of(scene, None), {})
    assert push is not None
    assert push.name == ("domino-0" if way > 0 else "domino-5")
    assert push.velocity[0] * way > 0


def test_a_ball_rolls_gently_into_the_others(tmp_path: Path) -> None:
    """All balls stay in the picture and come to rest; a hard break throws them out."""
    balls = [
        (60, 100),
        *(
            (300 + 18 * i, 100 + 20.5 * (j - i / 2))
            for i in range(3)
            for j in range(i + 1)
        ),
    ]
    objects = "".join(
        f"  b{k}: {{shape: {{circle: {{center: [{x}, {y}], radius: 10}}}}, "
        "solid: sphere, rolling: 0.03}\n"
        for k, (x, y) in enumerate(balls)
    )
    path = tmp_path / "scene.yaml"
    path.write_text(
        f"physgen: 1\nsize: [400, 200]\nworld: {{view: top, pixels_per_meter: 800, table: {{friction: 0.3}}}}\n"
        f"objects:\n{objects}"
    )
    scene = pipeline.load(path)
    push = default_push(scene, shapes_of(scene, None), {})
    assert push is not None
    assert push.outcome.grade is Grade.STORY
    assert len(push.outcome.mover_names) > 1
    assert np.hypot(*push.velocity) < 1.4 * push_speed(400, 800)
    pushed = pipeline.load(
        path, [f"objects.{push.name}.velocity=[{push.velocity[0]}, {push.velocity[1]}]"]
    )
    world = pipeline.compile(pushed, None).world
    centers = simulate(world, np.linspace(0, 8, 81)).poses[..., :2]
    assert (centers > 5).all()
    assert (centers < np.array([395, 195])).all()
    assert np.hypot(*(centers[-1] - centers[-2]).T).max() < 1


def test_nothing_is_pushed_against_a_wall_that_the_photo_does_not_show(
    tmp_path: Path,
) -> None:
    """Friction of the same wall under the ball takes its momentum, too, and throws nothing back."""
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [400, 200]\nworld: {pixels_per_meter: 800}\nobjects:\n"
        "  ball: {shape: {circle: {center: [130, 135], radius: 15}}, elasticity: 0, rolling: 0.05}\n"
        "  block: {shape: {box: {center: [350, 130], size: [30, 40]}}}\n"
        "boundaries:\n  floor: {segment: [[-200, 150], [800, 150]]}\n"
        "  stop-1: {segment: [[150, 110], [150, 150]], elasticity: 0}\n"
    )
    scene = pipeline.load(path)
    shapes = shapes_of(scene, None)
    for unseen in (["stop-1"], ["stop-1", "floor"]):
        push = default_push(scene, shapes, {"block": 0.0}, unseen)
        assert push is not None
        assert push.name == "ball"
        assert push.velocity[0] < 0
        assert push.outcome.grade is Grade.STORY


@pytest.mark.parametrize("way", [-1, 1])
def test_nothing_is_pushed_so_that_it_comes_back(way: int, tmp_path: Path) -> None:
    """A ball beside an elastic wall that is seen: it would go back farther than it went."""
    path = tmp_path / "scene.yaml"
    wall = 200 + 35 * way
    path.write_text(
        "physgen: 1\nsize: [400, 200]\nworld: {pixels_per_meter: 800}\nobjects:\n"
        "  ball: {shape: {circle: {center: [200, 135], radius: 15}}, elasticity: 1, rolling: 0.05}\n"
        f"  block: {{shape: {{box: {{center: [{wall + 40 * way}, 130], size: [30, 40]}}}}}}\n"
        "boundaries:\n  floor: {segment: [[-200, 150], [800, 150]]}\n"
        f"  post: {{segment: [[{wall}, 50], [{wall}, 150]], elasticity: 1}}\n"
    )
    scene = pipeline.load(path)
    push = default_push(scene, shapes_of(scene, None), {"block": 0.0})
    assert push is not None
    assert push.velocity[0] * way < 0


def test_an_unseen_floor_that_something_slides_on_throws_nothing_back(
    tmp_path: Path,
) -> None:
    """Its friction takes all momentum of the block; a wall that is not seen ends the way to the other side."""
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [400, 200]\nworld: {pixels_per_meter: 800}\nobjects:\n"
        "  block: {shape: {box: {center: [250, 135], size: [40, 30]}}, friction: 0.5}\n"
        "boundaries:\n  ledge-1: {segment: [[-200, 150], [800, 150]], friction: 0.5}\n"
    )
    scene = pipeline.load(path)
    shapes = shapes_of(scene, None)
    outcomes = [
        simulate_push(compile_trials(scene, shapes, unseen), {"block": (-900, 0)})
        for unseen in (["ledge-1"], [])
    ]
    assert outcomes[0] == outcomes[1]


def test_of_a_pile_in_a_box_the_top_is_pushed(tmp_path: Path) -> None:
    """Two rows of blocks fill the box, each with others ahead; the one that lies on them is free."""
    path = tmp_path / "scene.yaml"
    blocks = [(100 + 40 * k, y) for k in range(6) for y in (130, 170)] + [(200, 90)]
    path.write_text(
        "physgen: 1\nsize: [400, 200]\nworld: {pixels_per_meter: 800}\nobjects:\n"
        + "".join(
            f"  b{k}: {{shape: {{box: {{center: [{x}, {y}], size: [40, 40]}}}}}}\n"
            for k, (x, y) in enumerate(blocks)
        )
        + "boundaries: {box: {polyline: [[80, 112], [80, 190], [320, 190], [320, 112]]}}\n"
    )
    scene = pipeline.load(path)
    push = default_push(scene, shapes_of(scene, None), {})
    assert push is not None
    assert push.name == f"b{len(blocks) - 1}"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("domino-0", "has no direction"),
        ("domino-0=sideways", "is not a direction; write right, left"),
    ],
)
def test_a_push_without_a_direction(text: str, found: str, row: Path) -> None:
    scene = pipeline.load(row)
    with pytest.raises(InputError, match=found):
        motion_edits(scene, pipeline.compile(scene, None), [text], [], [])


@pytest.mark.parametrize(
    ("text", "way"),
    [
        ("right", (1, 0)),
        ("RIGHT", (1, 0)),
        ("Left", (-1, 0)),
        ("to the right", (1, 0)),
        ("upwards", (0, -1)),
        ("down-right", (1, 1)),
        ("downright", (1, 1)),
        ("Right-Down", (1, 1)),
        ("up_left", (-1, -1)),
        ("up and left", (-1, -1)),
        ("DOWN LEFT", (-1, 1)),
        ("90 deg", (0, 1)),
        ("180°", (-1, 0)),
    ],
)
def test_push_directions_have_many_spellings(
    text: str, way: tuple[int, int], row: Path
) -> None:
    scene = pipeline.load(row)
    compiled = pipeline.compile(scene, None)
    edits = motion_edits(scene, compiled, [f"domino-0={text}@100 px/s"], [], [])
    expected = 100 * np.array(way) / np.hypot(*way)
    assert edits["objects.domino-0.velocity"] == pytest.approx(expected, abs=0.1)


def test_a_push_without_a_speed_is_gentle(tmp_path: Path) -> None:
    """It takes the speed of the push that perception would choose."""
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [400, 300]\nworld: {pixels_per_meter: 800}\n"
        "boundaries: {floor: {segment: [[-400, 250], [800, 250]], friction: 0.6}}\n"
        "objects:\n  ball: {shape: {circle: {center: [60, 220], radius: 30}}}\n"
    )
    scene = pipeline.load(path)
    compiled = pipeline.compile(scene, None)
    edits = motion_edits(scene, compiled, ["ball=right"], [], [])
    speed = quantity(edits["objects.ball.velocity"][0], "px/s", 800)
    best = default_push(scene, compiled.shapes, {})
    assert best is not None
    assert speed == pytest.approx(best.velocity[0], rel=0.05)
    assert speed is not None
    assert speed < 0.7 * push_speed(400, 800)


@pytest.mark.parametrize(
    ("text", "fix"),
    [
        ("domino-0=rigth", "right"),
        ("domino-0=dwon-left", "down-left"),
        ("domino-0=2 m/s", "right@2 m/s"),
        ("right=domino-0", "--push domino-0=right"),
        ("domino-0=up-down", "up-right"),
        ("domono-0=up", "domino-0"),
    ],
)
def test_wrong_push_names_the_fix(text: str, fix: str, row: Path) -> None:
    scene = pipeline.load(row)
    with pytest.raises(InputError) as error:
        motion_edits(scene, pipeline.compile(scene, None), [text], [], [])
    (problem,) = error.value.problems
    assert problem.place.file == "--push"
    assert fix in problem.fix


@pytest.mark.parametrize(
    ("way", "phrase"),
    [
        ("right", "to the right"),
        ("left", "to the left"),
        ("up", "up"),
        ("down", "down"),
        ("up-left", "up and left"),
        ("down-right", "down and right"),
    ],
)
def test_push_phrase_is_a_sentence(way: str, phrase: str) -> None:
    assert Push("ball", (0, 0), way).phrase == phrase


def test_what_hardly_moves_is_pushed_harder(tmp_path: Path) -> None:
    """By closed form v^2 / (2 mu g) the ordinary push moves this block by less than a tenth of the photo."""
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [400, 200]\nworld: {pixels_per_meter: 800}\nobjects:\n"
        "  block: {shape: {polygon: [[100, 130], [180, 130], [180, 150], [100, 150]]}, friction: 1.9}\n"
        "boundaries: {floor: {segment: [[-200, 150], [800, 150]], friction: 1.9}}\n"
    )
    scene = pipeline.load(path)
    ordinary, push = (
        push_speed(400, 800),
        default_push(scene, shapes_of(scene, None), {}),
    )
    slowed = 2 * 1.9 * 9.81 * 800
    assert ordinary**2 / slowed < 40
    assert push is not None
    assert ordinary < abs(push.velocity[0]) < 1.6 * ordinary, (
        "the hardest one throws things"
    )


@pytest.mark.parametrize("height", [60, 90, 150])
def test_what_is_thin_is_tipped_about_its_foot(tmp_path: Path, height: float) -> None:
    """By conservation of angular momentum about its foot, and of energy from there on, it just falls; none slides."""
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [400, 300]\nworld: {pixels_per_meter: 1000, duration: 1.0}\nobjects:\n"
        f"  domino: {{shape: {{box: {{center: [150, {250 - height / 2}], size: [12, {height}]}}}}, friction: 0.45}}\n"
        "boundaries: {floor: {segment: [[-400, 250], [800, 250]], friction: 0.6}}\n"
    )
    scene = pipeline.load(path)
    push = default_push(scene, shapes_of(scene, None), {})
    assert push is not None
    arm = np.hypot(6, height / 2)
    inertia = (12**2 + height**2) / 12 + arm**2  # over its mass, about the corner
    least = (
        np.sqrt(2 * 9.8 * 1000 * (arm - height / 2) / inertia) * inertia / (height / 2)
    )
    assert least < abs(push.velocity[0]) < 1.5 * least
    edits = [f"objects.domino.velocity=[{push.velocity[0]}, 0]"]
    poses = pipeline.simulate(
        pipeline.compile(pipeline.load(path, edits), None).world
    ).poses[:, 0]
    side = np.sign(push.velocity[0])
    assert poses[-1, 2] * side > np.radians(80)
    falling = poses[np.abs(poses[:, 2]) < np.radians(15)]
    x, _, turn = falling.T
    foot = x + 6 * side * np.cos(turn) - height / 2 * np.sin(turn)
    assert np.ptp(foot) < 0.03 * height


def test_shorthands_are_edits(row: Path) -> None:
    scene = pipeline.load(row)
    compiled = pipeline.compile(scene, None)
    edits = motion_edits(
        scene, compiled, ["domino-1=30@1600"], ["domino-2"], ["104,95@50 px/s"]
    )
    speed = 2 * 800
    assert edits["objects.domino-1.velocity"] == pytest.approx(
        [speed * cos(radians(30)), speed * sin(radians(30))], abs=0.1
    )
    assert edits["objects.domino-2.place"] == [144, 60]  # by its own height
    (kick,) = edits["forces"]
    assert kick == {
        "object": "domino-0",
        "impulse": [-50.0 * 8 * 60, 0.0],
        "at": [104, 95],
    }
    moving = pipeline.load(row, ["objects.domino-2.velocity=[90, 0]"])
    for pushes, velocity in (([], [0, 0]), (["domino-2=left@70"], [-70, 0])):
        edits = motion_edits(moving, compiled, pushes, ["domino-2"], [])
        assert edits["objects.domino-2.velocity"] == velocity
    edits = motion_edits(
        scene, compiled, ["domino-1=right@2 m/s"], [], ["13 cm,95@6.25 cm/s"]
    )
    assert edits["objects.domino-1.velocity"] == ["2 m/s", 0], "in the user's units"
    (metric,) = edits["forces"]
    assert metric["at"] == ["13 cm", 95]
    assert [quantity(metric["impulse"][0], "g·px/s", 800), 0] == pytest.approx(
        kick["impulse"]
    )
    with pytest.raises(InputError, match="6 cm,4 cm"):
        motion_edits(scene, compiled, [], [], ["13 kg,95"])
    assert motion_edits(scene, compiled, [], [], ["13 cm,95"])["forces"][0]["impulse"][
        0
    ].endswith(" g m/s")
    for far in ("2350,10", "300,190"):
        with pytest.raises(
            InputError, match=r"hits no object.*the nearest: \d+,\d+ of domino-\d"
        ):
            motion_edits(scene, compiled, [], [], [far])
    for pushes, word in (
        (["domino-1=sideways"], "direction"),
        (["dominoe-1=left"], 'did you mean "domino-1"'),
    ):
        with pytest.raises(InputError, match=word):
            motion_edits(scene, compiled, pushes, [], [])


def test_a_still_scene_says_so_and_a_push_prints_what_to_keep(
    row: Path, tmp_path: Path, capsys
) -> None:
    command = ["render", str(row), "-o", str(tmp_path / "out"), "--preview"]
    assert main(command) == 0
    assert (
        "nothing moves in this clip; try --push domino-0=right"
        in capsys.readouterr().err
    )
    assert main([*command, "--push", "domino-0=right"]) == 0
    said = capsys.readouterr().err
    assert "nothing moves" not in said
    kept = "".join(line[2:] + "\n" for line in said.splitlines()[1:])
    assert "velocity: [" in kept
    row.write_text(ROW.replace("objects:\n", "variants: {a: {objects.domino-0.velocity: [1, 0]}}\n" + kept, 1)
                   .replace("  domino-0: {shape", "    shape", 1).replace("[8, 60]}}}", "[8, 60]}}", 1))  # fmt: skip
    assert pipeline.load(row).objects[0].velocity[0] > 0


@pytest.mark.slow
def test_a_tip_names_a_push_that_moves_something(
    row: Path, tmp_path: Path, capsys
) -> None:
    """The first two stand between walls, and the third one against the second."""
    walls = "".join(
        f"  wall-{k}: {{segment: [[{x}, 80], [{x}, 150]]}}\n"
        for k, x in enumerate((95.9, 126.1))
    )
    text = ROW.replace("boundaries: {floor: {segment: [[0, 150], [400, 150]]}}", "")
    row.write_text(
        text + f"boundaries:\n  floor: {{segment: [[0, 150], [400, 150]]}}\n{walls}"
    )
    assert main(["render", str(row), "-o", str(tmp_path / "out"), "--preview"]) == 0
    tip = re.search(r"try (--push) (domino-\d=\w+)", capsys.readouterr().err)
    assert tip is not None
    assert not tip[2].startswith(("domino-0", "domino-1"))
    assert (
        main(
            [
                "render",
                str(row),
                "-o",
                str(tmp_path / "out"),
                "--preview",
                tip[1],
                tip[2],
            ]
        )
        == 0
    )
    assert "nothing moves" not in capsys.readouterr().err


def test_a_still_scene_has_no_energy_to_balance(
    row: Path, tmp_path: Path, capsys
) -> None:
    """Blocks that lie .6 px in the floor are lifted by the engine, which is nobody's work."""
    row.write_text(ROW.replace("[0, 150], [400, 150]", "[0, 149.4], [400, 149.4]"))
    assert main(["render", str(row), "-o", str(tmp_path / "out"), "--preview"]) == 0
    told = capsys.readouterr().err
    assert "nothing moves in this clip" in told
    assert "energy" not in told
    (manifest,) = (tmp_path / "out").glob("*/manifest.json")
    assert json.loads(manifest.read_text())["energy_imbalance"] == 0


@pytest.mark.slow
def test_a_shorthand_takes_the_place_of_perception_s_push_and_of_no_other(
    tmp_path: Path, capsys
) -> None:
    """As recorded, and as it follows a changed scale; seen in the motion of the object that is not named."""
    rgb = np.full((140, 300, 3), (190, 186, 176), np.uint8)
    labels = np.zeros((140, 300), np.uint8)
    for k, x in enumerate((60, 150, 240), 1):
        cv2.circle(rgb, (x, 70), 25, (40, 60, 170), -1)
        cv2.circle(labels, (x, 70), 25, k, -1)
    for name, picture in (("photo.png", rgb), ("masks.png", labels)):
        cv2.imwrite(str(tmp_path / name), picture)
    path, photo = tmp_path / "scene.yaml", str(tmp_path / "photo.png")
    assert (
        main(
            ["perceive", photo, "--masks", str(tmp_path / "masks.png"), "-o", str(path)]
        )
        == 0
    )
    capsys.readouterr()

    def moving(
        pushes: list[str], drops: list[str], kicks: list[str], *edits: str
    ) -> list[str]:
        scene = pipeline.load(path, edits)
        compiled = pipeline.compile(scene, pipeline.percepts(scene))
        made = motion_edits(scene, compiled, pushes, drops, kicks)
        edited = pipeline.load(
            path,
            [*edits, *(f"{key}={json.dumps(value)}" for key, value in made.items())],
        )
        return [item.name for item in edited.objects if any(item.velocity)]

    (pushed,) = moving([], [], [])
    names = [item.name for item in pipeline.load(path).objects]
    other = next(name for name in names if name != pushed)
    for edits in ([], ["world.pixels_per_meter=250"]):
        assert moving([f"{other}=right"], [], [], *edits) == [other]
        assert moving([], [], ["60,70"], *edits) == []
        assert moving([f"{pushed}=right@1 m/s"], [], [], *edits) == [pushed]
    mine = f"objects.{pushed}.velocity=[3 m/s, 0]"
    assert set(moving([f"{other}=right"], [], [], mine)) == {other, pushed}


@pytest.mark.parametrize("point", ["-4,120", "-4 px,120"])
def test_a_point_left_of_the_photo_needs_no_equals_sign(
    point: str, tmp_path: Path, capsys
) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(ROW.replace(f"[{100}, 120]", "[8, 120]"))
    assert (
        main(
            [
                "render",
                str(path),
                "-o",
                str(tmp_path),
                "--preview",
                "--report",
                "none",
                "--kick",
                point,
            ]
        )
        == 0
    )
    said = capsys.readouterr().err
    assert "object: domino-0" in said
    assert f"at: [{point.split(',')[0]}, 120]" in said


def test_a_scene_without_objects_is_told_how_to_add_one(tmp_path: Path, capsys) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text("physgen: 1\nsize: [64, 48]\nobjects: {}\n")
    command = [
        "render",
        str(path),
        "-o",
        str(tmp_path),
        "--preview",
        "--report",
        "none",
    ]
    assert main(command) == 0
    for more in (["--push", "ball=right"], ["--kick", "5,5"]):
        assert main([*command, *more]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    for line in lines:
        assert "NAME" not in line
        assert "--box X,Y,W,H or --point X,Y" in line


@pytest.mark.parametrize(
    ("room", "speed", "told"),
    [
        (
            1.5,
            200,
            "nothing moves in this clip; block has a velocity and is stuck: see what holds it",
        ),  # 0.5 % of 400 px is 2 px
        (2.5, 200, "the push moves nothing by 5 % of the picture"),
        (50, 2, "nothing moves in this clip; block has 2 px/s, too little to see"),
        (50, 20, "the push moves nothing by 5 % of the picture"),
        (50, 150, ""),
    ],
)
def test_a_push_that_hardly_moves_anything_is_told(
    room: float, speed: float, told: str, tmp_path: Path, capsys
) -> None:
    """A block with `room` (px) on its right side, on a table without friction."""
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [400, 100]\nworld: {view: top, pixels_per_meter: 800, duration: 0.2, table: {friction: 0}}\n"
        f"objects:\n  block: {{shape: {{box: {{center: [100, 50], size: [20, 20]}}}}, velocity: [{speed}, 0]}}\n"
        f"boundaries:\n  left: {{segment: [[90, 20], [90, 80]]}}\n"
        f"  right: {{segment: [[{110 + room}, 20], [{110 + room}, 80]]}}\n"
    )
    assert (
        main(
            [
                "render",
                str(path),
                "-o",
                str(tmp_path / "out"),
                "--preview",
                "--report",
                "none",
            ]
        )
        == 0
    )
    error = capsys.readouterr().err
    assert told in error if told else error == ""


def test_what_is_pushed_and_stuck_is_said_to_be_held(tmp_path: Path, capsys) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [200, 200]\nworld: {pixels_per_meter: 800, duration: 0.2}\nobjects:\n"
        "  block: {shape: {box: {center: [100, 140], size: [20, 20]}}, velocity: [200, 0]}\nboundaries:\n"
        "  floor: {segment: [[-100, 150], [300, 150]]}\n"
        "  left: {segment: [[90, 100], [90, 150]]}\n  right: {segment: [[110, 100], [110, 150]]}\n"
    )
    assert main(["render", str(path), "-o", str(tmp_path / "out")]) == 0
    assert (
        "nothing moves in this clip; block has a velocity and is stuck"
        in capsys.readouterr().err
    )
    path.write_text(path.read_text().replace(", velocity: [200, 0]", ""))
    assert main(["render", str(path), "-o", str(tmp_path / "out")]) == 0
    assert (
        "nothing moves in this clip; no push moves anything: see what holds it"
        in capsys.readouterr().err
    )
    path.write_text(
        path.read_text().replace("shape: {box", "motion: static, shape: {box")
    )
    assert main(["render", str(path), "-o", str(tmp_path / "out")]) == 0
    assert (
        "no push moves anything: write motion: dynamic, or see"
        in capsys.readouterr().err
    )


def test_a_push_that_sets_much_in_motion_is_preferred(tmp_path: Path) -> None:
    """A ball has a free way to three heavy blocks; a push of these moves all three."""
    objects = "".join(
        f"  block-{k}: {{mass: 3000, shape: {{box: {{center: [{x}, 130], size: [20, 40]}}}}}}\n"
        for k, x in enumerate((20, 300, 325, 350))
    )
    objects += "  ball: {mass: 50, rolling: 0.02, shape: {circle: {center: [60, 138], radius: 12}}}\n"
    path = tmp_path / "scene.yaml"
    path.write_text(
        ROW.partition("  domino-0")[0] + objects + ROW[ROW.index("boundaries") :]
    )
    scene = pipeline.load(path)
    push = default_push(scene, shapes_of(scene, None), {})
    assert push is not None
    edits = [
        f"objects.{push.name}.velocity=[{push.velocity[0]}, 0]",
        "world.duration=auto",
    ]
    poses = pipeline.simulate(
        pipeline.compile(pipeline.load(path, edits), None).world
    ).poses
    assert (np.ptp(poses[..., 0], axis=0) > 16).sum() >= 3


@pytest.mark.slow
def test_a_scene_is_written_though_nobody_reads_its_summary(
    tmp_path: Path, bundled: Path
) -> None:
    """`perceive ... | head -2` closes the pipe: the scene was lost, without a word."""

    def closed(text: str) -> None:
        raise BrokenPipeError

    scene = tmp_path / "scene.yaml"
    with pytest.raises(BrokenPipeError):
        pipeline.perceive(
            bundled / "pendulum" / "photo.png", scene, inform=closed, still=True
        )
    assert "objects:" in scene.read_text()


def test_trials_of_pushes_have_a_longest_time(
    row: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scale that is wrong by powers of ten: a push would cross the photo in days."""
    ends: list[float] = []

    class Recorded(Running):
        def __init__(self, world: World, times: NDArray[np.float64]) -> None:
            ends.append(float(times[-1]))
            super().__init__(world, times)

    monkeypatch.setattr("physgen.simulate.engine.Running", Recorded)
    row.write_text(ROW.replace("pixels_per_meter: 800", "pixels_per_meter: 1.0e-6"))
    scene = pipeline.load(row)
    default_push(scene, shapes_of(scene, None), {})
    assert ends
    assert max(ends) <= TRIAL.longest


@pytest.mark.slow
def test_comment_states_the_slow_motion_of_the_scene(tmp_path: Path) -> None:
    rgb = np.full((140, 300, 3), (190, 186, 176), np.uint8)
    labels = np.zeros((140, 300), np.uint8)
    labels[70:110, 60:84] = 1
    rgb[labels == 1] = (170, 40, 40)
    rgb[110:] = (90, 60, 40)
    cv2.imwrite(str(tmp_path / "photo.png"), rgb)
    cv2.imwrite(str(tmp_path / "masks.png"), labels)
    path = tmp_path / "scene.yaml"
    masks = ["--masks", str(tmp_path / "masks.png")]
    assert main(["perceive", str(tmp_path / "photo.png"), *masks, "-o", str(path)]) == 0
    slow = pipeline.load(path).render.slow
    assert slow > 1
    assert f"# slowed down {slow:g}x" in path.read_text()
