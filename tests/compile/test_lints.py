"""What is allowed and probably not meant is told, once, and nothing else is."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline


def scene(tmp_path: Path, body: str, head: str = "size: [200, 150]"):
    path = tmp_path / "scene.yaml"
    path.write_text(f"physgen: 1\n{head}\n{body}")
    return pipeline.load(path)


def told(tmp_path: Path, body: str, head: str = "size: [200, 150]") -> list[str]:
    """The warnings of a scene, from their dotted paths on."""
    loaded = scene(tmp_path, body, head)
    maps = pipeline.percepts(loaded)
    lints = pipeline.lint(loaded, pipeline.compile(loaded, maps), maps)
    assert all(": warning: " in str(lint) for lint in lints)
    return [f"{lint.path}: {lint.found} {lint.expected}; {lint.fix}" for lint in lints]


def photo(tmp_path: Path) -> str:
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((150, 200, 3), 100, np.uint8))
    return "image: photo.png"


BALL = "{circle: {center: [50, 60], radius: 10}}"
BOX = "{box: {center: [120, 60], size: [20, 20]}}"
TOP = "world: {view: top}\n"
CLOTH = "world: {view: top, table: {friction: 0.2}}\n"

LINTS = {
    "objects.b.shape: b overlaps a by 5.0 px at t = 0; ": f"""\
{TOP}objects:
  a: {{shape: {BALL}}}
  b: {{shape: {{circle: {{center: [65, 60], radius: 10}}}}}}""",
    "objects.a.shape: a reaches 4.0 px across boundary floor at t = 0; ": """\
objects: {a: {shape: {box: {center: [50, 60], size: [20, 20]}}}}
boundaries: {floor: {segment: [[0, 66], [200, 66]]}}""",
    "objects.a.rolling: 0.1 has no effect: only circles roll; take it out, or write shape: {circle: ...}": f"""\
objects: {{a: {{shape: {BOX}, rolling: 0.1}}}}""",
    "objects.a.rolling: 0.1 has no effect seen from above: a disc lies flat and does not roll; ": f"""\
{CLOTH}objects: {{a: {{shape: {BALL}, rolling: 0.1}}}}""",
    "objects.a.rolling: 0.1 has no effect on an object whose motion is static; ": f"""\
objects: {{a: {{shape: {BALL}, rolling: 0.1, motion: static}}}}""",
    "objects.a.roll: none has no effect seen from the side; take it out, or write view: top": f"""\
objects: {{a: {{shape: {BALL}, solid: sphere, roll: none}}}}""",
    "objects.a.roll: [90, 0] has no effect: a disc does not roll on a table; ": f"""\
{CLOTH}objects: {{a: {{shape: {BALL}, roll: [90, 0]}}}}""",
    "objects.a.roll: none has no effect: the table has no friction; ": f"""\
{TOP}objects: {{a: {{shape: {BALL}, solid: sphere, roll: none}}}}""",
    "render.overlay: forces has no effect: the scene has no forces; take it out": (
        "objects: {}\nrender: {overlay: [forces]}"
    ),
    "render.overlay: weight has no effect: the scene has no gravity in the picture's plane; take it out": (
        f"{TOP}objects: {{}}\nrender: {{overlay: [weight]}}"
    ),
    "world.backdrop: backdrop has no effect seen from above: shadows fall on the table; take it out, or write view": (
        "world: {view: top, backdrop: 100}\nobjects: {}"
    ),
    "world.table.friction: 0.2 has no effect seen from the side; take it out, or write view: top": (
        "world: {table: {friction: 0.2}}\nobjects: {}"
    ),
    "objects.a.velocity: velocity has no effect on an object whose motion is static; ": f"""\
objects: {{a: {{shape: {BALL}, motion: static, velocity: [1, 0]}}}}""",
    "forces[0]: impulse has no effect: the motion of a is static; ": f"""\
objects: {{a: {{shape: {BALL}, motion: static}}}}
forces: [{{object: a, impulse: [1, 0]}}]""",
    "forces[0].start: 3 begins after the end of the clip at 2 s; ": f"""\
{TOP}objects: {{a: {{shape: {BALL}}}}}
forces: [{{object: a, impulse: [1, 0], start: 3}}]""",
    "objects.a.velocity: a moves 104 px a step, over its size of 20 px: steps are divided where it could pass "
    "through something, which takes time; lower the velocity, or write world.steps_per_second: 5000 for steps": f"""\
{TOP}objects: {{a: {{shape: {BALL}, velocity: [1.0e5, 0]}}}}""",
    "objects.a.motion.path: a ends at 0.5 s, the clip at 2 s: it stays where it is from then on; add": f"""\
objects: {{a: {{shape: {BALL}, motion: {{path: [[0, 50, 60], [0.5, 90, 60]]}}}}}}""",
    "objects.a.mass: a of 0.001 g touches b, which is 5.0e+06 times as heavy: the motion is not exact; bring": f"""\
{TOP}objects:
  a: {{shape: {BALL}, mass: 0.001}}
  b: {{shape: {{box: {{center: [80, 60], size: [40, 40]}}}}, mass: 5000}}""",
    "objects.a.density: a of 0.3142 g is joined to b, which is 1.6e+07 times as heavy: the motion": f"""\
{TOP}objects:
  a: {{shape: {BALL}, density: 0.001}}
  b: {{shape: {BOX}, mass: 5.0e6}}
joints: {{band: {{objects: [b, a], spring: [[120, 60], [50, 60]], stiffness: 5}}}}""",
    "joints.glue: glue has no effect: a is static and b is static; take it out, or write motion: dynamic": f"""\
objects: {{a: {{shape: {BALL}, motion: static}}, b: {{shape: {BOX}, motion: static}}}}
joints: {{glue: {{objects: [a, b], weld: [90, 60]}}}}""",
    "joints.hinge: hinge has no effect: a is scripted; take it out, or write motion: dynamic": f"""\
objects: {{a: {{shape: {BALL}, motion: {{path: [[0, 50, 60], [2, 90, 60]]}}}}}}
joints: {{hinge: {{objects: [a], pivot: [50, 20]}}}}""",
    "joints.hinge.collide: true has no effect: a is joined to the world, which it bumps into anyway; take it out": f"""\
objects: {{a: {{shape: {BALL}}}}}
joints: {{hinge: {{objects: [a], pivot: [50, 20], collide: true}}}}""",
    "joints.band.spring: band begins 30 px outside a; move that end onto it": f"""\
{TOP}objects: {{a: {{shape: {BALL}}}, b: {{shape: {BOX}}}}}
joints: {{band: {{objects: [a, b], spring: [[50, 20], [120, 60]], stiffness: 5}}}}""",
    "joints.hinge.pivot: hinge lies 80 px outside a and 80 px outside b; move it onto one of them": f"""\
{TOP}objects: {{a: {{shape: {BALL}}}, b: {{shape: {{circle: {{center: [110, 60], radius: 10}}}}}}}}
joints: {{hinge: {{objects: [a, b], pivot: [80, 144.853]}}}}""",
    "fields.breeze.objects: breeze has no effect on b, whose motion is static; ": f"""\
objects: {{a: {{shape: {BALL}}}, b: {{shape: {BOX}, motion: static}}}}
boundaries: {{floor: {{segment: [[0, 140], [200, 140]]}}}}
fields: {{breeze: {{wind: [5, 0], drag: 1, objects: [a, b]}}}}""",
    "fields.breeze: breeze has no effect: no object is dynamic; ": f"""\
objects: {{b: {{shape: {BOX}, motion: static}}}}
fields: {{breeze: {{wind: [5, 0], drag: 1}}}}""",
    "fields.magnet.strength: 0 has no effect; write another number": f"""\
objects: {{a: {{shape: {BALL}}}}}
fields: {{magnet: {{attractor: [5, 0], strength: 0}}}}""",
}


@pytest.mark.parametrize("message", LINTS)
def test_lints(tmp_path: Path, message: str) -> None:
    [said] = told(tmp_path, LINTS[message])
    assert said.startswith(message)


SILENT = {
    "a circle rolls, seen from the side": f"objects: {{a: {{shape: {BALL}, rolling: 0.1}}}}",
    "a sphere rolls on a table": f"{CLOTH}objects: {{a: {{shape: {BALL}, solid: sphere, rolling: 0.1, roll: none}}}}",
    "a path that ends with the clip": f"""\
objects: {{a: {{shape: {BALL}, motion: {{path: [[0, 50, 60], [2, 90, 60]]}}}}}}""",
    "a pendulum on a rod": f"objects: {{a: {{shape: {BALL}}}}}\njoints: {{hinge: {{objects: [a], pivot: [190, 20]}}}}",
    "a wheel before its car": f"""\
{TOP}objects: {{a: {{shape: {BALL}}}, b: {{shape: {{box: {{center: [60, 60], size: [60, 30]}}}}}}}}
joints: {{axle: {{objects: [a, b], motor: [50, 60], speed: 90}}}}""",
    "heavy and light, apart": f"""\
{TOP}objects: {{a: {{shape: {BALL}, mass: 0.001}}, b: {{shape: {BOX}, mass: 5000}}}}""",
    "static things have no mass": f"""\
{TOP}objects: {{a: {{shape: {BALL}, mass: 1.0e-300}}, b: {{shape: {BALL}, motion: static, mass: 5000}}}}
""".replace("a: {shape: " + BALL + ", mass: 1.0e-300}", "a: {shape: " + BOX + ", mass: 1}"),
    "a standing stack": """\
objects:
  low: {shape: {box: {center: [50, 130], size: [40, 40]}}}
  high: {shape: {box: {center: [55, 90], size: [40, 40]}}}
  ball: {shape: {circle: {center: [120, 135], radius: 15}}}
boundaries: {floor: {segment: [[0, 150], [200, 150]]}}""",
}


@pytest.mark.parametrize("why", SILENT)
def test_nothing_is_told(tmp_path: Path, why: str) -> None:
    assert told(tmp_path, SILENT[why]) == []


def test_a_spring_written_the_other_way_round(tmp_path: Path) -> None:
    said = told(
        tmp_path,
        f"""\
{TOP}objects: {{a: {{shape: {BALL}}}, b: {{shape: {BOX}}}}}
joints: {{band: {{objects: [a, b], spring: [[120, 60], [50, 60]], stiffness: 5}}}}""",
    )
    assert said == [
        "joints.band.spring: band begins 60 px outside a; write the two points the other way round",
        "joints.band.spring: band ends 60 px outside b; write the two points the other way round",
    ]


# Falling


def test_an_object_of_a_photo_that_hangs_in_the_air(tmp_path: Path) -> None:
    body = f"objects: {{a: {{shape: {BALL}}}}}"
    [said] = told(tmp_path, body, photo(tmp_path))
    assert "a is supported by nothing and falls at once" in said
    assert told(tmp_path, body) == []  # a lesson
    static = "\n  b: {shape: {box: {center: [150, 120], size: [20, 20]}}, motion: static}"
    [said] = told(tmp_path, f"objects:\n  a: {{shape: {BALL}}}{static}", photo(tmp_path))
    assert "a is supported by nothing and falls at once" in said  # and not a second time for missing b


HELD = {
    "by a pin": "hinge: {objects: [a], pivot: [50, 20]}",
    "by a spring": "band: {objects: [a], spring: [[50, 60], [50, 0]], stiffness: 5}",
    "by a static thing": "hinge: {objects: [shelf, a], pivot: [50, 60]}",
    "by what hangs": "rod: {objects: [a, b], pivot: [80, 60]}\n  hinge: {objects: [b], pivot: [120, 20]}",
}


@pytest.mark.parametrize("how", HELD)
@pytest.mark.parametrize("of_a_photo", [True, False])
def test_what_is_held_does_not_fall(tmp_path: Path, how: str, of_a_photo: bool) -> None:
    body = f"""\
objects:
  a: {{shape: {BALL}}}
  b: {{shape: {BOX}, motion: {"dynamic" if "b]" in HELD[how] else "static"}}}
  shelf: {{shape: {{box: {{center: [180, 20], size: [20, 20]}}}}, motion: static}}
joints:
  {HELD[how]}"""
    assert told(tmp_path, body, photo(tmp_path) if of_a_photo else "size: [200, 150]") == []


def test_what_is_joined_falls_together(tmp_path: Path) -> None:
    """b stands on the floor and holds a; without the floor both fall."""
    body = f"""\
objects: {{a: {{shape: {BALL}}}, b: {{shape: {BOX}}}}}
joints: {{glue: {{objects: [a, b], weld: [80, 60]}}}}
boundaries: {{floor: {{segment: [[100, 70], [140, 70]]}}}}"""
    assert told(tmp_path, body, photo(tmp_path)) == []
    said = told(tmp_path, body.replace("70", "50"), photo(tmp_path))
    assert ["falls at once" in line for line in said if "shape" not in line] == [True, True]


def falling(tmp_path: Path, ball: str, rest: str, world: str = "{}") -> bool:
    body = f"world: {world}\nobjects:\n  a: {{shape: {BALL}{ball}}}\n{rest}"
    said = [line for line in told(tmp_path, body) if not line.startswith("joints")]
    assert all("objects.a: a falls for ever: nothing lies below its path" in line for line in said)
    assert len(said) <= 1
    return bool(said)


FLOOR = "boundaries: {{floor: {{segment: [[{}, 140], [{}, 140]]}}}}"


def test_a_floor_under_the_path_or_not(tmp_path: Path) -> None:
    assert not falling(tmp_path, "", FLOOR.format(0, 200))
    assert falling(tmp_path, "", FLOOR.format(61, 200))
    assert not falling(tmp_path, "", FLOOR.format(59, 200))  # its rim still meets it
    assert falling(tmp_path, "", FLOOR.format(0, 200).replace("140", "20"))  # above it
    assert not falling(tmp_path, "", FLOOR.format(0, 200).replace("140", "20"), "{gravity: [0, -980]}")
    assert falling(tmp_path, "", FLOOR.format(0, 200), "{gravity: [980, 0]}")
    assert not falling(tmp_path, "", FLOOR.format(0, 200), "{gravity: [0, 0]}")
    assert not falling(tmp_path, "", FLOOR.format(61, 200), "{view: top}")


def test_a_projectile_and_the_end_of_the_floor(tmp_path: Path) -> None:
    """It falls 70 px to the floor at 140 in sqrt(140 / 980) = 0.378 s, by when it is 0.378 v further."""
    assert not falling(tmp_path, ", velocity: [390, 0]", FLOOR.format(0, 200))  # x = 197
    assert not falling(
        tmp_path, ", velocity: [420, 0]", FLOOR.format(0, 200)
    )  # x = 209, its rim meets the end
    assert falling(tmp_path, ", velocity: [450, 0]", FLOOR.format(0, 200))
    assert falling(tmp_path, ", velocity: [-450, 0]", FLOOR.format(0, 200))
    assert not falling(
        tmp_path, ", velocity: [450, 0]", FLOOR.format(0, 200), "{duration: 0.3}"
    )  # still above it
    assert not falling(tmp_path, ", velocity: [450, 0]", FLOOR.format(150, 400))  # reaches it from outside
    assert falling(tmp_path, ", velocity: [450, 0]", FLOOR.format(300, 400))
    assert not falling(tmp_path, ", velocity: [100, -500]", FLOOR.format(0, 200), "{duration: 1}")
    push = "forces: [{object: a, impulse: [45000, 0]}]\n"
    assert falling(tmp_path, ", mass: 100", push + FLOOR.format(0, 200))
    assert not falling(tmp_path, ", mass: 1000", push + FLOOR.format(0, 200))


def test_what_else_catches_it(tmp_path: Path) -> None:
    far = FLOOR.format(150, 400)
    static = "  b: {shape: {box: {center: [50, 120], size: [20, 20]}}, motion: static}\n"
    assert not falling(tmp_path, "", static + far)
    cart = "  b: {shape: {box: {center: [150, 120], size: [20, 20]}}, motion: {path: [[0, 150, 120], [2, 60, 120]]}}\n"
    assert not falling(tmp_path, "", cart + far)  # drives under it
    assert falling(tmp_path, "", cart.replace("[2, 60", "[2, 120") + far)
    wall = "boundaries: {frame: {polyline: [[0, 0], [0, 140], [40, 140]]}, side: {segment: [[90, 0], [90, 140]]}}"
    assert not falling(tmp_path, ", velocity: [200, 0]", wall)  # bounces off it, and who knows
    steered = "forces: [{object: a, force: [0, -9.0e5]}]\n"
    assert not falling(tmp_path, "", steered + far)
    assert not falling(tmp_path, "", "fields: {magnet: {attractor: [5, 0], strength: 4.0e7}}\n" + far)


def test_of_two_that_fall_side_by_side_none_holds_the_other(tmp_path: Path) -> None:
    body = f"""\
objects:
  a: {{shape: {BALL}}}
  b: {{shape: {{circle: {{center: [65, 47], radius: 6}}}}}}
{FLOOR.format(150, 400)}"""
    assert [line.partition(":")[0] for line in told(tmp_path, body)] == ["objects.a"]  # b would land on a


# ---- masks and shapes --------------------------------------------------------------------------------------------


def masked(tmp_path: Path, shape: str, *parts: tuple[int, int, int, int]) -> list[str]:
    """Warnings of a scene of one object whose mask is made of boxes x0, y0, x1, y1."""
    mask = np.zeros((150, 200), np.uint8)
    for x0, y0, x1, y1 in parts:
        mask[y0:y1, x0:x1] = 1
    cv2.imwrite(str(tmp_path / "masks.png"), mask)
    return told(
        tmp_path,
        f"""\
assets: .
world: {{view: top}}
objects: {{a: {{mask: 1, shape: {shape}}}}}""",
        photo(tmp_path),
    )


@pytest.mark.parametrize(
    "shape",
    [
        pytest.param("{box: {center: [70, 75], size: [60, 50]}}", id="a box whose top the lens sees"),
        pytest.param(
            "{polygon: [[40, 46], [44, 46], [44, 96], [96, 96], [96, 46], [100, 46], [100, 100], [40, 100]]}",
            id="the section of a bowl",
        ),
    ],
)
def test_a_section_of_what_is_seen_is_no_mistake(tmp_path: Path, shape: str) -> None:
    assert not [line for line in masked(tmp_path, shape, (40, 46, 101, 101)) if "mask" in line]


@pytest.mark.parametrize(
    ("shape", "share"),
    [
        pytest.param("{box: {center: [70, 85], size: [60, 30]}}", 30, id="half of it"),
        pytest.param("{circle: {center: [80, 63], radius: 30}}", 25, id="another place"),
    ],
)
def test_a_shape_that_misses_its_mask_is_told(tmp_path: Path, shape: str, share: float) -> None:
    (line,) = [line for line in masked(tmp_path, shape, (40, 46, 101, 101)) if "mask" in line]
    assert abs(int(line.split("misses ")[1].split("%")[0]) - share) < 15
