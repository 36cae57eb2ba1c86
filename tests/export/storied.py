"""Small scenes and the clips of them, simulated and not drawn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from physgen import pipeline
from physgen.export.events import Event, EventKind, events
from physgen.export.labels import Clip

G = 500.0
HEAD = f"""\
physgen: 1
size: [400, 200]
render: {{fps: 60}}
world: {{gravity: [0, {G}], duration: 1.2}}
boundaries: {{floor: {{segment: [[-900, 180], [900, 180]], friction: 0.4, elasticity: 1}}}}
"""
BALL = "  ball: {shape: {circle: {center: [100, 70], radius: 10}}, mass: 5, elasticity: 0.64}\n"


def clip(
    tmp_path: Path,
    objects: str,
    *edits: str,
    head: str = HEAD,
    variant: str | None = None,
) -> Clip:
    path = tmp_path / "scene.yaml"
    path.write_text(head + f"objects:\n{objects}", encoding="utf-8")
    return clip_of(path, edits, variant)


def clip_of(path: Path, edits: Sequence[str] = (), variant: str | None = None) -> Clip:
    scene = pipeline.load(path, edits, variant)
    compiled = pipeline.compile(scene, pipeline.percepts(scene))
    trajectory = pipeline.simulate(compiled.world)
    shot = pipeline.shot(scene, trajectory)
    size, fps = scene.video_size, scene.render.fps
    return Clip(
        scene.name,
        scene,
        compiled.world,
        trajectory,
        None,
        size,
        fps,
        len(shot.order),
        shot=shot,
    )


def happened(told: Clip, kind: EventKind, who: str | None = None) -> list[Event]:
    names = [name for name, _ in told.world.surfaces]
    return [
        event
        for event in events(told)
        if event.kind is kind
        and (who is None or who in [names[k] for k in event.surfaces])
    ]
