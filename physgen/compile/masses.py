"""Scene + bodies -> Problems with masses and moments that no engine can work with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from physgen.compile.world import Body
from physgen.problems import Problem
from physgen.scene.model import Motion, Scene

FARTHEST = 1e9
"""Heaviest by lightest: a contact between the two would be solved with no more than half of a float's digits."""
LEAST = 1e-150
"""g and g·px² of a body: an engine multiplies two such numbers, and 1e-308 is the least that a float holds in full."""


def mass_problems(scene: Scene, bodies: Sequence[Body]) -> Iterator[Problem]:
    """Moments that are 0 or not finite as floats, and masses too far apart; those of dynamic bodies alone count."""
    dynamic = [body for body in bodies if body.motion is Motion.DYNAMIC]
    sound = True
    for body in dynamic:
        if not (_usable(body.mass) and _usable(body.moment)):
            sound = False
            path = mass_path(scene, body.name)
            expected = f"and a moment of inertia of {body.moment:.2g} g·px² cannot be simulated"
            fix = "make it heavier or larger" if body.moment < 1 else "make it lighter or smaller"
            yield Problem(scene.place(path), path, grams(body.mass), expected, fix)
    if not sound or not dynamic:
        return
    light = min(dynamic, key=lambda body: body.mass)
    heavy = max(dynamic, key=lambda body: body.mass)
    if heavy.mass >= FARTHEST * light.mass:
        path = mass_path(scene, light.name)
        found = f"{grams(light.mass)}, and {grams(heavy.mass)} of {heavy.name}:"
        expected = "masses 10^9 apart or more cannot be simulated together"
        yield Problem(scene.place(path), path, found, expected, "bring them nearer")


def mass_path(scene: Scene, name: str) -> str:
    """Where the mass of an object is written."""
    item = next(item for item in scene.objects if item.name == name)
    return f"objects.{name}.{'mass' if item.mass is not None else 'density'}"


def grams(mass: float) -> str:
    """A mass as messages show it."""
    return f"{mass:.4g} g"


def _usable(value: float) -> bool:
    """Whether products of two such numbers, and of what one divided by them is, are floats."""
    return LEAST < value < 1 / LEAST
