"""Warnings about the motion of a clip: accuracy, objects that leave, and reduced rates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from physgen.export.video_formats import MAX_RATES, Format
from physgen.messages import Message
from physgen.problems import (
    Problem,
)
from physgen.scene.scene import Load, Motion
from physgen.text import listed, percent

if TYPE_CHECKING:
    from physgen.compile.world import World
    from physgen.scene.scene import Scene
    from physgen.simulate.trajectory import Trajectory


def balance_advice(world: World) -> str:
    """Return advice against an error of the energy balance, by the content of the
    world.
    """
    suggestions = ["raise world.steps_per_second"]
    if sum(body.motion is Motion.DYNAMIC for body in world.bodies) > 1:
        suggestions.append("look for masses far apart")
    if world.joints:
        suggestions.append("look for joints that contradict each other")
    if any(push.load is not Load.IMPULSE for push in world.pushes) or world.fields:
        suggestions.append("look for forces that are too strong")
    if len(suggestions) == 1:
        suggestions.append("look for a shape that overlaps a boundary at t = 0")
    return listed(suggestions)


UNMOVED = 1.0
"""Largest invisible displacement of a point of an object, px."""

HARDLY = 0.005
"""The same for a pushed object, as a share of the photo's longer side."""

LITTLE = 0.05
"""Share of the longer side by which a push should move something."""

DEPARTED = 0.2
"""Share of the clip's duration: a picture without motion from then on is seldom
intended.
"""

UNBALANCED = 0.03
"""Share of the energy flow that may be unaccounted for before the user is warned."""


def imbalance(world: World, trajectory: Trajectory) -> float:
    """Return the error of the energy balance as a share of the energy that flows.

    At rest no energy flows; a body's fall by a pixel is the smallest flow that counts.
    """
    mass = sum(body.mass for body in world.bodies)
    return trajectory.imbalance(mass * float(np.hypot(*world.gravity)))


def motion_warnings(
    scene: Scene, world: World, trajectory: Trajectory
) -> list[Problem]:
    """Return every warning about the motion of a clip."""
    error = imbalance(world, trajectory)
    return [
        *departure_warnings(scene, world, trajectory),
        *accuracy_warnings(scene, world, trajectory, error),
    ]


def accuracy_warnings(
    scene: Scene, world: World, trajectory: Trajectory, error: float
) -> list[Problem]:
    """Return warnings about a large error of the energy balance, and about reduced
    accuracy.
    """
    problems = []
    if error > UNBALANCED:
        place = scene.place("world")
        subject = "the energy balance"
        problems.append(
            Message.ENERGY_ERROR.warning(
                place, "world", subject, error=percent(error), fix=balance_advice(world)
            )
        )
    effort = trajectory.effort
    if effort.overworked >= 0:
        names = [name for name, _ in world.surfaces]
        # Two bodies share an impact budget; one body alone has too many parts of a
        # step.
        if effort.overworked_by >= 0:
            second_name = names[effort.overworked_by]
            subject = f"impacts of {names[effort.overworked]} and {second_name}"
            message = Message.IMPACTS_INEXACT
        else:
            subject = f"steps of {names[effort.overworked]}"
            message = Message.STEPS_INEXACT
        problems.append(message.warning(scene.place("objects"), "", subject))
    return problems


def departure_warnings(
    scene: Scene, world: World, trajectory: Trajectory
) -> list[Problem]:
    """Return a warning if all moving objects have left the picture early in the
    clip.
    """
    reaches = np.array([body.reach for body in world.bodies])
    time = trajectory.time_of_departure(reaches, world.size, UNMOVED)
    if time is None or time >= DEPARTED * world.duration:
        return []
    return [
        Message.ALL_LEFT.warning(
            scene.place("objects"), time=time, duration=world.duration
        )
    ]


def reduced_rates(scene: Scene, formats: Sequence[Format]) -> list[Problem]:
    """Return warnings about formats with a lower frame rate in browsers than the
    scene's.
    """
    fps = scene.render.fps
    problems = []
    for kind in formats:
        # Browsers play GIF in steps of 1/100 s, and no faster than 50 frames/s.
        maximum_rate = MAX_RATES.get(kind, fps)
        if fps <= maximum_rate:
            continue
        rate_text = f"{fps:g} frames/s"
        place = scene.place("render.fps")
        problems.append(
            Message.RATE_REDUCED.warning(
                place, "render.fps", rate_text, fastest=maximum_rate, format=kind.value
            )
        )
    return problems
