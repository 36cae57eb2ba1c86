"""The row of the energy balance: kinetic, potential and lost energy against work, in scenes of every kind."""

from __future__ import annotations

from math import cos, sin

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


def balance(run: Run) -> Errors:
    """Largest change of kinetic + potential + dissipated - work, over the most that any of the four changes."""
    energy = run.trajectory.energy
    parts = (energy.kinetic, energy.potential, energy.dissipated, energy.work)
    flow = max(float(np.ptp(part)) for part in parts)
    total = energy.kinetic + energy.potential + energy.dissipated - energy.work
    return {"balance": worst([np.abs(total - total[0]).max() / flow])}


def _surface(draw: Draw) -> Document:
    return {"friction": draw.number(0.2, 0.7), "elasticity": draw.number(0.2, 0.8)}


def _bouncing(draw: Draw) -> Case:
    """Balls and a box that bounce on a floor between two walls, and off each other."""
    objects = {
        f"ball-{k}": circle(
            (80 + 90 * k, draw.number(60, 140)), draw.number(12, 24), mass=draw.mass(),
            velocity=[draw.number(-150, 150, 0), draw.number(-100, 100, 0)], spin=draw.number(-400, 400, 0),
            **_surface(draw),
        )
        for k in range(4)
    }  # fmt: skip
    objects["box"] = box(
        (260, 280), (60, 30), 20, mass=draw.mass(), spin=200.0, **_surface(draw)
    )
    surface = _surface(draw)
    walls = {
        "floor": segment((20, 380), (500, 380), **surface),
        "left": segment((20, 20), (20, 380), **surface),
        "right": segment((500, 20), (500, 380), **surface),
    }
    return Case(scene((520, 400), 1.5, objects, walls), balance, "bouncing")


def _tumbling(draw: Draw) -> Case:
    """A box that tumbles down a slope beside one that slides, and a ball that rolls with resistance."""
    slope = Slope((40, 60), 0.5, 1, 330)
    surface = {"friction": 0.6, "elasticity": draw.number(0.1, 0.5)}
    end = slope.point(slope.length)
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
            slope.turned,
            mass=draw.mass(),
            friction=0.2,
            elasticity=0.1,
        ),
        "rolls": circle(
            slope.point(280, 16), 16, mass=draw.mass(), rolling=0.05, **surface
        ),
    }
    walls = {
        "slope": slope.wall(**surface),
        "floor": segment(end, (end[0] + 500, end[1]), **surface),
    }
    return Case(scene((700, 260), 1.5, objects, walls), balance, "tumbling")


def _stack_hit(draw: Draw) -> Case:
    """A stack of five boxes and the ball that knocks it over."""
    surface = _surface(draw)
    height = draw.number(24, 34, 0)
    objects = {
        f"box-{k}": box(
            (260, 280 - (k - 0.5) * height),
            (50, height),
            mass=draw.mass(),
            **_surface(draw),
        )
        for k in range(1, 6)
    }
    speed = draw.number(350, 500, 0)
    objects["ball"] = circle(
        (80, draw.number(170, 220)),
        20,
        mass=draw.number(200, 500, 0),
        velocity=[speed, -100.0],
        **surface,
    )
    return Case(
        scene(
            (520, 300),
            1.5,
            objects,
            {"floor": segment((-300, 280), (900, 280), **surface)},
        ),
        balance,
        "stack",
    )


def _dominoes(draw: Draw) -> Case:
    """Seven dominoes, the first of them pushed."""
    surface = {"friction": draw.number(0.3, 0.6), "elasticity": draw.number(0, 0.3)}
    height, mass = draw.number(60, 80, 0), draw.mass()
    apart = height * draw.number(0.4, 0.6)
    objects = {
        f"domino-{k}": box(
            (40 + k * apart, 180 - height / 2), (9, height), mass=mass, **surface
        )
        for k in range(1, 8)
    }
    push = {
        "object": "domino-1",
        "force": [mass * 600.0, 0.0],
        "at": [35.5 + apart, 185.0 - height],
        "duration": 0.15,
    }
    floor = {"floor": segment((0, 180), (600, 180), **surface)}
    return Case(
        scene((500, 210), 1.5, objects, floor, forces=[push]), balance, "dominoes"
    )


def _table(draw: Draw) -> Case:
    """From above: a struck ball, others it meets, pucks that slide and spin, and cushions."""
    corners = [[20.0, 20.0], [500.0, 20.0], [500.0, 340.0], [20.0, 340.0], [20.0, 20.0]]
    ball = {
        "solid": "sphere",
        "mass": draw.mass(),
        "friction": 0.2,
        "elasticity": 0.9,
        "rolling": 0.01,
    }
    angle, speed = np.radians(draw.number(-10, 10)), draw.number(350, 500, 0)
    objects = {
        "cue": circle((90, 180), 16, velocity=[speed * cos(angle), speed * sin(angle)], roll="none", **ball),
        "ball-1": circle((300, 180), 16, **ball),
        "ball-2": circle((340, 190), 16, **ball),
        "puck": circle(
            (150, 280), 22, mass=draw.mass(), friction=0.2, elasticity=0.7, velocity=[150.0, -30.0],
            spin=draw.number(-600, 600, 0),
        ),
        "plate": box((420, 80), (60, 30), 30, mass=draw.mass(), friction=0.2, elasticity=0.5, velocity=[-120.0, 40.0]),
    }  # fmt: skip
    walls = {"cushions": {"polyline": corners, "friction": 0.2, "elasticity": 0.8}}
    world = {"view": "top", "table": {"friction": 0.3}}
    return Case(scene((520, 360), 1.5, objects, walls, world=world), balance, "table")


def _machine(draw: Draw) -> Case:
    """A double pendulum, a damped spring, a motor's wheel under a ball, and two boxes welded, which fall."""
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
    moment = objects["wheel"]["mass"] * 40**2 / 2
    joints = {
        "shoulder": {"objects": ["upper"], "pivot": [220.0, 60.0]},
        "elbow": {"objects": ["upper", "lower"], "pivot": [315.0, 60.0]},
        "spring": {
            "objects": ["hung"], "spring": [[480.0, 140.0], [480.0, 40.0]], "length": 70.0,
            "stiffness": objects["hung"]["mass"] * 150, "damping": objects["hung"]["mass"] * draw.number(0.5, 2),
        },
        "motor": {"objects": ["wheel"], "motor": [600.0, 240.0], "speed": 500.0, "limit": round(moment * 20, 1)},
        "glue": {"objects": ["left", "right"], "weld": [465.0, 220.0]},
    }  # fmt: skip
    floor = {"floor": segment((-200, 320), (800, 320), **surface)}
    return Case(
        scene((700, 350), 1.5, objects, floor, joints=joints), balance, "machine"
    )


def _driven(draw: Draw) -> Case:
    """Pushes, a torque, a wind, an attractor, and a scripted paddle that strikes."""
    surface = _surface(draw)
    objects = {
        "pushed": box((80, 275), (50, 30), mass=200.0, **surface),
        "turned": circle((220, 270), 20, mass=150.0, **surface),
        "blown": circle((330, 80), 16, mass=draw.number(20, 60, 0), **surface),
        "drawn": circle((400, 140), 12, mass=draw.mass(), velocity=[60.0, 0.0], **surface),
        "struck": circle((420, 270), 20, mass=draw.mass(), **surface),
        "paddle": box(
            (500, 250), (16, 70), **surface,
            motion={"path": [[0, 500, 250], [0.4, 500, 250], [0.8, 430, 250, -20], [1.5, 480, 250, 0]]},
        ),
    }  # fmt: skip
    forces = [
        {
            "object": "pushed",
            "force": [200.0 * GRAVITY * 0.9, 0.0],
            "start": 0.1,
            "duration": 0.3,
        },
        {
            "object": "pushed",
            "impulse": [-200.0 * draw.number(50, 120, 0), 0.0],
            "at": [80.0, 265.0],
            "start": 0.8,
        },
        {
            "object": "turned",
            "torque": 150.0 * 20**2 / 2 * draw.number(10, 30),
            "duration": 0.5,
        },
    ]
    fields = {
        "breeze": {
            "wind": [draw.number(100, 300, 0), 0],
            "drag": 0.01,
            "objects": ["blown", "turned"],
        },
        "magnet": {
            "attractor": [400.0, 60.0],
            "strength": 8.0e6,
            "soften": 30.0,
            "objects": ["drawn"],
        },
    }
    floor = {"floor": segment((-300, 290), (900, 290), **surface)}
    return Case(
        scene((560, 320), 1.5, objects, floor, forces=forces, fields=fields),
        balance,
        "driven",
    )


KINDS = (_bouncing, _tumbling, _stack_hit, _dominoes, _table, _machine, _driven)


def _energies(draw: Draw) -> list[Case]:
    """Two or one of the seven kinds a draw, so that five draws have them all."""
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
