"""The row of the energy balance: kinetic, potential and lost energy against
work, in scenes of every kind.
"""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np

from physgen.evaluate.physics.scorecard import (
    Case,
    Document,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    worst,
)
from physgen.evaluate.physics.staging import GRAVITY, Slope, box, circle, scene, segment

DURATION = 1.5
"""Duration of every scene, s."""


def measure_balance(run: Run) -> Errors:
    """Return the largest change of kinetic + potential + dissipated - work, over the
    largest change of one term.
    """
    energy = run.trajectory.energy
    parts = (energy.kinetic, energy.potential, energy.dissipated, energy.work)
    # The balance is relative to the energy that moves, not to an arbitrary zero.
    flow = max(float(np.ptp(part)) for part in parts)
    total = energy.kinetic + energy.potential + energy.dissipated - energy.work
    largest_change = np.abs(total - total[0]).max()
    return {"balance": worst([largest_change / flow])}


def _case(
    label: str, size: tuple[int, int], objects: dict[str, Document], **sections: Any
) -> Case:
    """Return a case with a balance of energy."""
    document = scene(size, DURATION, objects, **sections)
    return Case(document, measure_balance, label)


def _surface(draw: Draw) -> Document:
    return {"friction": draw.number(0.2, 0.7), "elasticity": draw.number(0.2, 0.8)}


def _bouncing(draw: Draw) -> Case:
    """Return the case of bouncing balls and a box between a floor and two walls."""
    objects = {}
    for k in range(4):
        objects[f"ball-{k}"] = circle(
            (80 + 90 * k, draw.number(60, 140)),
            draw.number(12, 24),
            mass=draw.mass(),
            velocity=[draw.number(-150, 150, 0), draw.number(-100, 100, 0)],
            spin=draw.number(-400, 400, 0),
            **_surface(draw),
        )
    objects["box"] = box(
        (260, 280), (60, 30), 20, mass=draw.mass(), spin=200.0, **_surface(draw)
    )
    # With losses at every contact, the energy must never rise.
    surface = _surface(draw)
    walls = {
        "floor": segment((20, 380), (500, 380), **surface),
        "left": segment((20, 20), (20, 380), **surface),
        "right": segment((500, 20), (500, 380), **surface),
    }
    return _case("bouncing", (520, 400), objects, boundaries=walls)


def _tumbling(draw: Draw) -> Case:
    """Return the case of a tumbling box, a sliding box, and a ball with rolling
    resistance on a slope.
    """
    slope = Slope((40, 60), 0.5, 1, 330)
    surface = {"friction": 0.6, "elasticity": draw.number(0.1, 0.5)}
    objects = {
        "tumbles": box(
            slope.point(90, 50),
            (34, 50),
            draw.number(0, 90, 0),
            mass=draw.mass(),
            spin=300.0,
            **surface,
        ),
        "slides": box(
            slope.point(190, 10),
            (40, 20),
            slope.box_angle,
            mass=draw.mass(),
            friction=0.2,
            elasticity=0.1,
        ),
        "rolls": circle(
            slope.point(280, 16), 16, mass=draw.mass(), rolling=0.05, **surface
        ),
    }
    x, y = slope.point(slope.length)
    walls = {
        "slope": slope.wall(**surface),
        "floor": segment((x, y), (x + 500, y), **surface),
    }
    return _case("tumbling", (700, 260), objects, boundaries=walls)


def _stack_hit(draw: Draw) -> Case:
    """Return the case of a stack of five boxes and a ball against it."""
    surface = _surface(draw)
    height = draw.number(24, 34, 0)
    objects = {}
    for k in range(1, 6):
        center = (260, 280 - (k - 0.5) * height)
        mass = draw.mass()
        body = box(center, (50, height), mass=mass, **_surface(draw))
        objects[f"box-{k}"] = body
    speed = draw.number(350, 500, 0)
    objects["ball"] = circle(
        (80, draw.number(170, 220)),
        20,
        mass=draw.number(200, 500, 0),
        velocity=[speed, -100.0],
        **surface,
    )
    floor = {"floor": segment((-300, 280), (900, 280), **surface)}
    return _case("stack", (520, 300), objects, boundaries=floor)


def _dominoes(draw: Draw) -> Case:
    """Return the case of seven dominoes with a push on the first."""
    surface = {"friction": draw.number(0.3, 0.6), "elasticity": draw.number(0, 0.3)}
    height = draw.number(60, 80, 0)
    mass = draw.mass()
    distance = height * draw.number(0.4, 0.6)
    objects = {}
    for k in range(1, 8):
        center = (40 + k * distance, 180 - height / 2)
        objects[f"domino-{k}"] = box(center, (9, height), mass=mass, **surface)
    # The force acts on the left face, 5 px below the top, so that the domino tips.
    push = {
        "object": "domino-1",
        "force": [mass * 600.0, 0.0],
        "at": [35.5 + distance, 185.0 - height],
        "duration": 0.15,
    }
    floor = {"floor": segment((0, 180), (600, 180), **surface)}
    return _case("dominoes", (500, 210), objects, boundaries=floor, forces=[push])


def _table(draw: Draw) -> Case:
    """Return the case, from above, of a struck ball, other balls, sliding and spinning
    pucks, and cushions.
    """
    corners = [[20.0, 20.0], [500.0, 20.0], [500.0, 340.0], [20.0, 340.0], [20.0, 20.0]]
    ball = {
        "solid": "sphere",
        "mass": draw.mass(),
        "friction": 0.2,
        "elasticity": 0.9,
        "rolling": 0.01,
    }
    angle = np.radians(draw.number(-10, 10))
    speed = draw.number(350, 500, 0)
    velocity = [speed * cos(angle), speed * sin(angle)]
    objects = {
        "cue": circle((90, 180), 16, velocity=velocity, roll="none", **ball),
        "ball-1": circle((300, 180), 16, **ball),
        "ball-2": circle((340, 190), 16, **ball),
        "puck": circle(
            (150, 280),
            22,
            mass=draw.mass(),
            friction=0.2,
            elasticity=0.7,
            velocity=[150.0, -30.0],
            spin=draw.number(-600, 600, 0),
        ),
        "plate": box(
            (420, 80),
            (60, 30),
            30,
            mass=draw.mass(),
            friction=0.2,
            elasticity=0.5,
            velocity=[-120.0, 40.0],
        ),
    }
    walls = {"cushions": {"polyline": corners, "friction": 0.2, "elasticity": 0.8}}
    world = {"view": "top", "table": {"friction": 0.3}}
    return _case("table", (520, 360), objects, boundaries=walls, world=world)


def _machine(draw: Draw) -> Case:
    """Return the case of a double pendulum, a damped spring, a motor's wheel
    under a ball, and two welded boxes.
    """
    surface = _surface(draw)
    mass = draw.mass()
    objects = {
        "upper": box((270, 60), (100, 12), mass=mass),
        "lower": box((360, 60), (100, 12), mass=mass),
        "hung": circle((480, 140), 18, mass=draw.mass()),
        "wheel": circle((600, 240), 40, mass=draw.mass(), **surface),
        "rider": circle((590, 150), 14, mass=draw.mass(), **surface),
        "left": box((450, 220), (30, 30), mass=draw.mass(), **surface),
        "right": box((480, 220), (30, 50), mass=draw.mass(), **surface),
    }
    joints = _machine_joints(draw, objects)
    floor = {"floor": segment((-200, 320), (800, 320), **surface)}
    return _case("machine", (700, 350), objects, boundaries=floor, joints=joints)


def _machine_joints(draw: Draw, objects: dict[str, Document]) -> Document:
    """Return the joints of the machine's objects."""
    spring_mass = objects["hung"]["mass"]
    wheel_moment = objects["wheel"]["mass"] * 40**2 / 2
    return {
        "shoulder": {"objects": ["upper"], "pivot": [220.0, 60.0]},
        "elbow": {"objects": ["upper", "lower"], "pivot": [315.0, 60.0]},
        "spring": {
            "objects": ["hung"],
            "spring": [[480.0, 140.0], [480.0, 40.0]],
            "length": 70.0,
            "stiffness": spring_mass * 150,
            "damping": spring_mass * draw.number(0.5, 2),
        },
        "motor": {
            "objects": ["wheel"],
            "motor": [600.0, 240.0],
            "speed": 500.0,
            "limit": round(wheel_moment * 20, 1),
        },
        "glue": {"objects": ["left", "right"], "weld": [465.0, 220.0]},
    }


PADDLE_PATH = [[0, 500, 250], [0.4, 500, 250], [0.8, 430, 250, -20], [1.5, 480, 250, 0]]
"""s, px, px, degrees."""


def _driven_bodies(draw: Draw) -> Case:
    """Return the case of pushes, a torque, a wind, an attractor, and a
    scripted paddle.
    """
    surface = _surface(draw)
    floor = {"floor": segment((-300, 290), (900, 290), **surface)}
    return _case(
        "driven",
        (560, 320),
        _driven_objects(draw, surface),
        boundaries=floor,
        forces=_driving_forces(draw),
        fields=_driving_fields(draw),
    )


def _driven_objects(draw: Draw, surface: Document) -> dict[str, Document]:
    motion = {"path": PADDLE_PATH}
    return {
        "pushed": box((80, 275), (50, 30), mass=200.0, **surface),
        "turned": circle((220, 270), 20, mass=150.0, **surface),
        "blown": circle((330, 80), 16, mass=draw.number(20, 60, 0), **surface),
        "drawn": circle(
            (400, 140), 12, mass=draw.mass(), velocity=[60.0, 0.0], **surface
        ),
        "struck": circle((420, 270), 20, mass=draw.mass(), **surface),
        "paddle": box((500, 250), (16, 70), **surface, motion=motion),
    }


def _driving_forces(draw: Draw) -> list[Document]:
    push = {
        "object": "pushed",
        "force": [200.0 * GRAVITY * 0.9, 0.0],
        "start": 0.1,
        "duration": 0.3,
    }
    strike = {
        "object": "pushed",
        "impulse": [-200.0 * draw.number(50, 120, 0), 0.0],
        "at": [80.0, 265.0],
        "start": 0.8,
    }
    disc_moment = 150.0 * 20**2 / 2
    twist = {
        "object": "turned",
        "torque": disc_moment * draw.number(10, 30),
        "duration": 0.5,
    }
    return [push, strike, twist]


def _driving_fields(draw: Draw) -> dict[str, Document]:
    breeze = {
        "wind": [draw.number(100, 300, 0), 0],
        "drag": 0.01,
        "objects": ["blown", "turned"],
    }
    magnet = {
        "attractor": [400.0, 60.0],
        "strength": 8.0e6,
        "soften": 30.0,
        "objects": ["drawn"],
    }
    return {"breeze": breeze, "magnet": magnet}


KINDS = (_bouncing, _tumbling, _stack_hit, _dominoes, _table, _machine, _driven_bodies)


def _energies(draw: Draw) -> list[Case]:
    """Return one or two of the seven kinds, so that five draws contain all."""
    return [kind(draw) for kind in KINDS[draw.index :: 5]]


ROWS = (
    Row(
        27, "energy", "energy", "kinetic + potential + dissipated = start + work",
        "bouncing balls and a box; a tumbling box, a slide and a roll; a stack hit by a ball; dominoes; a table; "
        "a machine of pins, a spring, a motor and a weld; pushes, wind, an attractor and a scripted paddle",
        "Largest change of the sum over the most that any of the four changes. What is dissipated is summed from "
        "impulses and sliding, closing and turning speeds, never taken as what is left over.",
        (Measure("balance", 1e-2),), _energies,
    ),
)  # fmt: skip
