"""What is allowed and probably not meant is told, once, and nothing else is."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from written import loaded

from physgen import pipeline


def told(tmp_path: Path, body: str, head: str = "size: [200, 150]") -> list[str]:
    """The warnings of a scene, from their dotted paths on."""
    scene = loaded(tmp_path, f"physgen: 1\n{head}\n{body}")
    maps = pipeline.percepts(scene)
    lints = pipeline.lint(scene, pipeline.compile(scene, maps), maps)
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
    "joints.g: g turns b without a pin: only the turning is coupled; hold each of the two by a pivot": f"""\
{TOP}objects: {{a: {{shape: {BALL}}}, b: {{shape: {BOX}}}}}
joints: {{p: {{objects: [a], pivot: [50, 60]}}, g: {{objects: [a, b], gear: -2}}}}""",
    "objects.a.rocking: 0.1 has no effect: only dynamic objects with corners": f"""\
objects: {{a: {{shape: {BALL}, rocking: 0.1}}}}
boundaries: {{floor: {{segment: [[0, 70], [200, 70]]}}}}""",
    "fields.f: f carries nothing: it needs a view from above": f"""\
objects: {{a: {{shape: {BALL}}}}}
boundaries: {{floor: {{segment: [[0, 70], [200, 70]]}}}}
fields: {{f: {{belt: [0, 0, 90, 90], velocity: [10, 0]}}}}""",
    "world.steps_per_second: 960 steps a second are too few": f"""\
world: {{pixels_per_meter: 1.0e5}}
objects: {{a: {{shape: {BALL}}}}}
boundaries: {{floor: {{segment: [[0, 70], [200, 70]]}}}}""",
    "objects.b.shape: b overlaps a by 5.0 px at t = 0; ": f"""\
{TOP}objects:
  a: {{shape: {BALL}}}
  b: {{shape: {{circle: {{center: [65, 60], radius: 10}}}}}}""",
    "objects.a.shape: a reaches 4.0 px across boundary floor at t = 0; ": """\
objects: {a: {shape: {box: {center: [50, 60], size: [20, 20]}}}}
boundaries: {floor: {segment: [[0, 66], [200, 66]]}}""",
    "objects.a.rolling: 0.1 has no effect: only circles roll; remove it": f"""\
objects: {{a: {{shape: {BOX}, rolling: 0.1}}}}""",
    "objects.a.rolling: 0.1 has no effect: only spheres roll; remove it": f"""\
{CLOTH}objects: {{a: {{shape: {BALL}, rolling: 0.1}}}}""",
    "objects.a.rolling: 0.1 has no effect on an object whose motion is static; ": f"""\
objects: {{a: {{shape: {BALL}, rolling: 0.1, motion: static}}}}""",
    "objects.a.roll: roll has no effect: only dynamic spheres on a tabletop with friction roll; remove it": f"""\
{TOP}objects: {{a: {{shape: {BALL}, solid: sphere, roll: none}}}}""",
    "world.table.friction: 0.2 has no effect seen from the side; remove it, or write view: top": (
        "world: {table: {friction: 0.2}}\nobjects: {}"
    ),
    "world.duration: 120 s makes 3,600 frames, 2 min of video, in about 1.8 min; write auto": (
        "world: {duration: 2 min}\nobjects: {}"
    ),
    "objects.a.velocity: velocity has no effect on an object whose motion is static; ": f"""\
objects: {{a: {{shape: {BALL}, motion: static, velocity: [1, 0]}}}}""",
    "forces[0]: impulse has no effect: the motion of a is static; ": f"""\
objects: {{a: {{shape: {BALL}, motion: static}}}}
forces: [{{object: a, impulse: [1, 0]}}]""",
    "forces[0].start: 3 begins after the end of the clip at 2 s; ": f"""\
{TOP}objects: {{a: {{shape: {BALL}}}}}
forces: [{{object: a, impulse: [1, 0], start: 3}}]""",
    "joints.glue: glue has no effect: none of its objects is dynamic; remove it, or write motion: dynamic": f"""\
objects: {{a: {{shape: {BALL}, motion: static}}, b: {{shape: {BOX}, motion: static}}}}
joints: {{glue: {{objects: [a, b], weld: [90, 60]}}}}""",
    "fields.breeze: breeze has no effect: none of its objects is dynamic; ": f"""\
objects: {{b: {{shape: {BOX}, motion: static}}}}
fields: {{breeze: {{wind: [5, 0], drag: 1}}}}""",
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


# Falling


def test_an_object_of_a_photo_that_hangs_in_the_air(tmp_path: Path) -> None:
    body = f"objects: {{a: {{shape: {BALL}}}}}"
    [said] = told(tmp_path, body, photo(tmp_path))
    assert "a is supported by nothing and falls at once" in said
    assert told(tmp_path, body) == []  # a lesson
    lifted = body.replace("a: {", "a: {place: [50, 30], ")
    assert told(tmp_path, lifted, photo(tmp_path)) == []  # put there to fall


HELD = {
    "by a pin": "hinge: {objects: [a], pivot: [50, 20]}",
    "by a spring": "band: {objects: [a], spring: [[50, 60], [50, 0]], stiffness: 5}",
    "by a static thing": "hinge: {objects: [shelf, a], pivot: [50, 60]}",
    "by what hangs": "rod: {objects: [a, b], pivot: [80, 60]}\n  hinge: {objects: [b], pivot: [120, 20]}",
}


@pytest.mark.parametrize("how", HELD)
def test_what_is_held_does_not_fall(tmp_path: Path, how: str) -> None:
    body = f"""\
objects:
  a: {{shape: {BALL}}}
  b: {{shape: {BOX}, motion: {"dynamic" if "b]" in HELD[how] else "static"}}}
  shelf: {{shape: {{box: {{center: [180, 20], size: [20, 20]}}}}, motion: static}}
joints:
  {HELD[how]}"""
    assert told(tmp_path, body, photo(tmp_path)) == []


def test_what_is_joined_falls_together(tmp_path: Path) -> None:
    """b stands on the floor and holds a; without the floor both fall."""
    body = f"""\
objects: {{a: {{shape: {BALL}}}, b: {{shape: {BOX}}}}}
joints: {{glue: {{objects: [a, b], weld: [80, 60]}}}}
boundaries: {{floor: {{segment: [[100, 70], [140, 70]]}}}}"""
    assert told(tmp_path, body, photo(tmp_path)) == []
    said = told(tmp_path, body.replace("70", "50"), photo(tmp_path))
    assert ["falls at once" in line for line in said if "shape" not in line] == [
        True,
        True,
    ]


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
        pytest.param(
            "{box: {center: [70, 75], size: [60, 50]}}",
            id="a box whose top the lens sees",
        ),
        pytest.param(
            "{polygon: [[40, 46], [44, 46], [44, 96], [96, 96], [96, 46], [100, 46], [100, 100], [40, 100]]}",
            id="the section of a bowl",
        ),
    ],
)
def test_a_section_of_what_is_seen_is_no_mistake(tmp_path: Path, shape: str) -> None:
    assert not [
        line for line in masked(tmp_path, shape, (40, 46, 101, 101)) if "mask" in line
    ]


def test_a_shape_beyond_its_mask_is_told_and_the_hole_of_a_handle_is_not(
    tmp_path: Path,
) -> None:
    """A box of 60 x 50 px, 10 px of whose width show the background; and one with a hole in its mask."""
    shape = "{box: {center: [70, 75], size: [60, 50]}}"
    (line,) = [
        line for line in masked(tmp_path, shape, (40, 50, 91, 100)) if "beyond" in line
    ]
    assert abs(int(line.split("reaches ")[1].split("%")[0]) - 20) < 3
    around = [
        (40, 50, 101, 60),
        (40, 90, 101, 100),
        (40, 50, 50, 100),
        (90, 50, 101, 100),
    ]
    assert not [line for line in masked(tmp_path, shape, *around) if "mask" in line]


@pytest.mark.parametrize(
    ("shape", "share"),
    [
        pytest.param("{box: {center: [70, 85], size: [60, 30]}}", 30, id="half of it"),
        pytest.param(
            "{circle: {center: [80, 63], radius: 30}}", 25, id="another place"
        ),
    ],
)
def test_a_shape_that_misses_its_mask_is_told(
    tmp_path: Path, shape: str, share: float
) -> None:
    (line,) = [
        line for line in masked(tmp_path, shape, (40, 46, 101, 101)) if "misses" in line
    ]
    assert abs(int(line.split("misses ")[1].split(" %")[0]) - share) < 15


def test_spike_without_area_does_not_stop_warnings(tmp_path: Path) -> None:
    """A corner with a digit too many, so that the outline goes there and back."""
    corners = "[[40, 50], [901, 50], [90, 50], [95, 50], [95, 100], [40, 100]]"
    lines = masked(tmp_path, f"{{polygon: {corners}}}", (40, 46, 101, 101))
    assert not [line for line in lines if "mask" in line]


def test_a_shape_beyond_the_picture_misses_all_of_its_mask(tmp_path: Path) -> None:
    shape = "{circle: {center: [90, 4788.4], radius: 20}}"
    (line,) = [
        line for line in masked(tmp_path, shape, (40, 50, 91, 100)) if "mask" in line
    ]
    assert "misses 100 % of" in line


@pytest.mark.parametrize(
    ("gravity", "is_warned"),
    [
        ("[0, 9.81]", True),
        ("9.81", True),
        ("[0, -9.81]", True),
        ("[0, 9.81 m/s²]", False),
        ("[0, 0.5 m/s²]", False),
        ("[0, 162]", False),
        ("[0, 0]", False),
    ],
)
def test_gravity_in_meters_without_unit_warns(
    gravity: str, is_warned: bool, tmp_path: Path
) -> None:
    body = f"world: {{gravity: {gravity}}}\nobjects: {{a: {{shape: {BALL}}}}}"
    warnings = [text for text in told(tmp_path, body) if "world.gravity" in text]
    assert len(warnings) == is_warned
    assert all("0.098 m/s²" in text for text in warnings)


@pytest.mark.parametrize("side", [0.1, 0.3])
def test_object_below_a_pixel_warns(side: float, tmp_path: Path) -> None:
    body = f"objects: {{a: {{shape: {{box: {{center: [50, 50], size: [{side}, {side}]}}}}}}}}"
    assert [text.split(":")[0] for text in told(tmp_path, body)] == ["objects.a.shape"]
