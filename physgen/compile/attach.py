"""Scene + its bodies -> pushes, joints and fields with their points in the bodies' frames, in px, s, g, rad."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, radians

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, Field, Joint, Push
from physgen.problems import InputError, Problem
from physgen.scene import model
from physgen.scene.model import Load, Motion, Scene

Array = NDArray[np.float64]

MOST_PULLS = 1_000_000
"""Fields times the objects that each acts on: every step looks at all of them."""


def pushes_of(scene: Scene, bodies: Sequence[Body]) -> tuple[Push, ...]:
    """Forces, torques and impulses in the file's order."""
    index = _index(bodies)

    def push(force: model.Force) -> Push:
        body = index[force.object]
        at = np.zeros(2) if force.at is None else np.array(force.at) - bodies[body].center
        end = force.start
        if force.load is not Load.IMPULSE:
            end += inf if force.duration is None else force.duration
        return Push(body, force.load, np.array(force.vector), force.torque, at, force.start, end)

    return tuple(push(force) for force in scene.forces)


def joints_of(scene: Scene, bodies: Sequence[Body]) -> tuple[Joint, ...]:
    """Joints by name; one that holds nothing that can move is left out (lints tell of it): no engine could solve it."""
    index = _index(bodies)
    return tuple(
        _joint(item, [index[name] for name in item.objects], bodies)
        for item in scene.joints
        if any(bodies[index[name]].motion is Motion.DYNAMIC for name in item.objects)
    )


def _joint(item: model.Joint, ends: Sequence[int], bodies: Sequence[Body]) -> Joint:
    first, second = (ends[0], ends[1]) if len(ends) == 2 else (ends[0], None)
    here, there = (np.array(point, np.float64) for point in (item.points[0], item.points[-1]))
    return Joint(
        name=item.name,
        kind=item.kind,
        first=first,
        second=second,
        first_at=here - bodies[first].center,
        second_at=there if second is None else there - bodies[second].center,
        length=float(np.hypot(*(there - here))) if item.length is None else item.length,
        stiffness=item.stiffness,
        damping=item.damping,
        speed=radians(item.speed),
        limit=inf if item.limit is None else item.limit,
        collide=item.collide,
    )


def fields_of(scene: Scene, bodies: Sequence[Body]) -> tuple[Field, ...]:
    """Fields by name. Raises InputError where they would act on more than a step can look at."""
    index = _index(bodies)
    every = tuple(k for k, body in enumerate(bodies) if body.motion is Motion.DYNAMIC)
    fields = []
    for item in scene.fields:
        named = sorted({index[name] for name in item.objects})
        acted_on = tuple(k for k in named if bodies[k].motion is Motion.DYNAMIC) if named else every
        vector = np.array(item.vector, np.float64)
        fields.append(Field(item.name, item.kind, acted_on, vector, item.drag, item.strength, item.soften))
    pulls = sum(len(field.bodies) for field in fields)
    if pulls > MOST_PULLS:
        found, expected = f"{pulls:,} pulls", "of fields on objects are too many"
        fix = f"name the objects of each field, at most {MOST_PULLS:,} in all"
        raise InputError([Problem(scene.place("fields"), "fields", found, expected, fix)])
    return tuple(fields)


def _index(bodies: Sequence[Body]) -> dict[str, int]:
    return {body.name: k for k, body in enumerate(bodies)}
