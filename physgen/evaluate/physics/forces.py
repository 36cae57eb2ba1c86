"""Rows of what pushes and pulls: impulses, forces and torques of a scene, and a centre that attracts."""

from __future__ import annotations

from math import cos, pi, radians, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.scorecard import (
    Case,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    worst,
)
from physgen.evaluate.physics.staging import box, circle, scene

Array = NDArray[np.float64]

FLOATING = {"gravity": [0, 0]}


def _pushes(draw: Draw) -> list[Case]:
    """Deviation of each gained velocity and spin over itself, at the end.

    The arm of a force that rides on a body turns with it while the force's direction stays, so its spin follows from
    the work done: I w²/2 = F x (displacement of the point against the middle).
    """
    objects: dict[str, Any] = {}
    forces: list[dict[str, Any]] = []
    gained: dict[str, tuple[Array, float]] = {}
    duration = 0.6
    for k, name in enumerate(("struck", "pushed", "turned", "ridden")):
        at = np.array([160 + 240 * (k % 2), 130 + 240 * (k // 2)])
        mass, size, turn = (
            draw.mass(),
            (draw.number(40, 70), draw.number(20, 40)),
            draw.number(0, 180, 0),
        )
        moment = mass * (size[0] ** 2 + size[1] ** 2) / 12
        start, lasts = (
            draw.number(0.05, 0.2, 3),
            draw.number(0.2, 0.35, 3),
        )  # off the engine's steps
        objects[name] = box(at, size, turn, mass=mass)
        arm = (
            draw.number(0.3, 0.5)
            * size[0]
            * np.array([cos(radians(turn)), sin(radians(turn))])
        )
        angle = radians(turn + draw.sign() * draw.number(50, 90, 0))
        toward = np.array([cos(angle), sin(angle)])
        if name == "struck":
            impulse = mass * draw.number(50, 120) * toward
            push = {
                "impulse": impulse.tolist(),
                "at": (arm + at).tolist(),
                "start": start,
            }
            gained[name] = (
                impulse / mass,
                float(arm[0] * impulse[1] - arm[1] * impulse[0]) / moment,
            )
        elif name == "turned":
            turning = draw.sign() * draw.number(10, 30)
            push = {"torque": moment * turning, "start": start, "duration": lasts}
            gained[name] = (np.zeros(2), turning * lasts)
        elif name == "pushed":
            pushing = draw.number(200, 400) * toward
            push = {
                "force": (mass * pushing).tolist(),
                "start": start,
                "duration": lasts,
            }
            gained[name] = (pushing * lasts, 0.0)
        else:
            riding = mass * draw.number(60, 120) * toward
            push = {"force": riding.tolist(), "at": (arm + at).tolist()}
            gained[name] = (riding / mass * duration, 0.0)
        forces.append({"object": name, **push})

    def measure(run: Run) -> Errors:
        errors = []
        for name, (velocity, spin) in gained.items():
            track = run.track(name)
            if name == "ridden":
                c, s = cos(track.angle[-1]), sin(track.angle[-1])
                work = float(riding @ (np.array([[c, -s], [s, c]]) @ arm - arm))
                spin = float(np.sign(track.spin[-1])) * sqrt(
                    max(2 * work / moment, 0.0)
                )
            if velocity.any():
                errors.append(
                    np.hypot(*(track.velocity[-1] - velocity)) / np.hypot(*velocity)
                )
            errors.append(
                abs(track.spin[-1] / spin - 1) if spin else abs(track.spin[-1])
            )
        return {"velocity": worst(errors)}

    return [
        Case(
            scene((560, 500), duration, objects, world=FLOATING, forces=forces), measure
        )
    ]


def kepler(axis: float, eccentricity: float, strength: float, times: Array) -> Array:
    """(T, 2) px from the centre, along the first place's direction and the first velocity's; it begins at the farthest.

    `axis` is the half long axis, px; `strength` px³/s². Newton's method on Kepler's equation M = E - e sin E.
    """
    mean = pi + times * sqrt(strength / axis**3)
    anomaly = mean.copy()
    for _ in range(60):
        slope = 1 - eccentricity * np.cos(anomaly)
        anomaly -= (anomaly - eccentricity * np.sin(anomaly) - mean) / slope
    short = axis * sqrt(1 - eccentricity**2)
    return -np.stack(
        [axis * (np.cos(anomaly) - eccentricity), short * np.sin(anomaly)], axis=1
    )


def _orbits(draw: Draw) -> list[Case]:
    """Distance from Kepler's place at any time over the orbit's half axis; largest change of energy over the first."""
    middle = np.array([260.0, 260.0])
    strength = round(4 * pi**2 * 150**3 / draw.number(1.6, 2.4) ** 2, -4)
    orbits = {
        "circling": (draw.number(195, 215, 1), 0.0),
        "falling": (draw.number(90, 110, 1), draw.number(0.3, 0.5, 3)),
    }
    objects, starts = {}, {}
    for name, (axis, eccentricity) in orbits.items():
        turned, side = draw.angle(), draw.sign()
        far = axis * (1 + eccentricity)
        speed = side * sqrt(strength * (2 / far - 1 / axis))
        out, along = (
            np.array([cos(turned), sin(turned)]),
            np.array([-sin(turned), cos(turned)]),
        )
        objects[name] = circle(
            middle + far * out,
            draw.number(6, 12),
            mass=draw.mass(),
            velocity=(speed * along).tolist(),
        )
        starts[name] = (out, side * along)

    def measure(run: Run) -> Errors:
        off, changes = [], []
        for name, (axis, eccentricity) in orbits.items():
            track = run.track(name)
            exact = middle + kepler(
                axis, eccentricity, strength, track.times
            ) @ np.array(starts[name])
            off.append(np.hypot(*(track.at - exact).T).max() / axis)
            energy = track.speed**2 / 2 - strength / np.hypot(*(track.at - middle).T)
            changes.append(np.abs(energy / energy[0] - 1).max())
        return {"place": worst(off), "energy": worst(changes)}

    duration = 1.1 * 2 * pi * sqrt(orbits["circling"][0] ** 3 / strength)
    fields = {"sun": {"attractor": middle.tolist(), "strength": strength}}
    return [
        Case(
            scene((520, 520), duration, objects, world=FLOATING, fields=fields), measure
        )
    ]


ROWS = (
    Row(
        22, "pushes", "impulse J, force F for t, torque for t, off-centre force that rides on the body",
        "dv = J/m, F t/m; dw = torque t/I, (r x J)/I",
        "boxes of 40 to 70 x 20 to 40 px turned anyhow, 20 to 500 g; starts and ends off the engine's steps",
        "Velocity and spin at the end over their closed forms. The riding force's spin is that of its work.",
        (Measure("velocity", 1e-3),), _pushes,
    ),
    Row(
        36, "orbits", "orbits about an attractor", "T² = 4 pi² a³/strength; energy is constant; Kepler's equation",
        "a circle of 195 to 215 px and an ellipse of 90 to 110 px with eccentricity 0.3 to 0.5, either way round",
        "Distance from where Kepler's equation puts the body, over the half axis, during 1.1 turns of the circle and "
        "over two of the ellipse; change of energy over its first value. Smooth motion, so 0.3 %.",
        (Measure("place", 3e-3), Measure("energy", 3e-3)), _orbits,
    ),
)  # fmt: skip
