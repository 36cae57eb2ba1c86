"""World -> how fast its springs make bodies swing: what a step of the engine must resolve."""

from __future__ import annotations

from physgen.compile.world import Joint, World
from physgen.scene.model import JointKind, Motion


def springs(world: World) -> list[Joint]:
    """Those of a world's joints that are springs."""
    return [joint for joint in world.joints if joint.kind is JointKind.SPRING]


def give(world: World, spring: Joint) -> float:
    """1/g: how easily a spring's ends move."""
    total = 0.0
    for index, at in ((spring.first, spring.first_at), (spring.second, spring.second_at)):
        if index is not None and world.bodies[index].motion is Motion.DYNAMIC:
            body = world.bodies[index]
            total += 1 / body.mass + float(at @ at) / body.moment
    return total


def stiffest(world: World) -> tuple[float, str]:
    """rad/s of the body that its springs, all together, swing fastest, and the name of the one that pulls hardest."""
    pulls: dict[int, float] = {}
    hardest, name = 0.0, ""
    for spring in springs(world):
        pull = spring.stiffness * give(world, spring)
        if pull > hardest:
            hardest, name = pull, spring.name
        for index in (spring.first, spring.second):
            if index is not None and world.bodies[index].motion is Motion.DYNAMIC:
                pulls[index] = pulls.get(index, 0.0) + pull
    return max(pulls.values(), default=0.0) ** 0.5, name
