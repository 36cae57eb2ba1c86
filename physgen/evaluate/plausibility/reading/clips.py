"""A clip of ours, or a scene that is run -> tracks: places and outlines, and what the scene says acts from
outside.

Of contacts, energies and velocities, which `trajectory.npz` has too, nothing is read.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physgen.evaluate.plausibility.tracks import Array, Form, Given, Tracks
from physgen.problems import InputError
from physgen.scene.scene import Motion, Solid, View

if TYPE_CHECKING:
    from physgen.compile.world import Body, World


EXACT = 0.02
"""px: what the engine's steps may shake."""


def from_scene(path: Path, overrides: tuple[str, ...] = (), variant: str | None = None) -> Tracks:
    """A scene file, simulated at its video's frames."""
    from physgen import pipeline

    scene = pipeline.load(path, overrides, variant)
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    trajectory = pipeline.simulate(world)
    name = path.parent.name if path.name == "scene.yaml" else path.stem
    return from_world(f"{name}-{variant}" if variant else name, world, trajectory.times, trajectory.poses)


def from_clip(folder: Path) -> Tracks:
    """A folder that `render` made: its `trajectory.npz`, with outlines and pushes from its scene, where that is still.

    Raises InputError where the motion cannot be read.
    """
    from physgen import pipeline
    from physgen.batch.clips import read_manifest
    from physgen.evaluate.plausibility.reading.archives import from_archive
    from physgen.evaluate.plausibility.reading.asked import Asked

    told = read_manifest(folder)
    view = View(str(told.document.get("world", {}).get("view", "side")))
    bare = from_archive(folder / "trajectory.npz", Asked(view=view))
    name = folder.resolve().name
    try:
        path = Path(folder.resolve(), told.source or "")
        if not told.source or not path.is_file():
            raise InputError.of(str(path), "", "is not there", "")
        scene = pipeline.load(path, told.overrides, told.variant, allow_outside=True)
        world = pipeline.compile(scene, pipeline.percepts(scene)).world
    except InputError:
        return replace(bare, name=name)
    if tuple(body.name for body in world.bodies) != bare.names:
        return replace(bare, name=name)
    return from_world(name, world, bare.times, np.concatenate([bare.places, bare.angles[..., None]], axis=2))


def from_world(name: str, world: World, times: Array, poses: Array) -> Tracks:
    """`poses` (T, N, 3) as a trajectory has them."""
    return Tracks(
        name,
        times,
        tuple(body.name for body in world.bodies),
        poses[..., :2].copy(),
        poses[..., 2].copy(),
        tuple(map(form_of, world.bodies)),
        np.array([body.mass for body in world.bodies]),
        True,
        world.view,
        EXACT,
        "poses of a clip of physgen",
        given_by(world),
        world.view is View.SIDE and not np.any(world.gravity),
    )


def form_of(body: Body) -> Form:
    """Of a body of a world."""
    if body.radius is not None:
        return Form(body.radius, body.radius, float(np.sqrt(body.moment / body.mass)))
    core = min((_inscribed(piece) for piece in body.pieces if _holds_origin(piece)), default=0.0)
    return Form(core, body.reach, float(np.sqrt(body.moment / body.mass)), _width(body.pieces), body.pieces)


def given_by(world: World) -> Given:
    """What acts from outside, as the scene says."""
    held, joined = set(), set()
    for joint in world.joints:
        held |= {joint.first} | ({joint.second} if joint.second is not None else set())
        if joint.second is not None:
            joined.add((min(joint.first, joint.second), max(joint.first, joint.second)))
    scripted = {k for k, body in enumerate(world.bodies) if body.motion is not Motion.DYNAMIC}
    pushed = [(p.body, p.start, p.end if np.isfinite(p.end) else world.duration) for p in world.pushes]
    spun = {k for k, body in enumerate(world.bodies) if world.view is View.TOP and np.any(_overspin(body))}
    return Given(
        frozenset(held | scripted),
        frozenset(k for field in world.fields for k in field.bodies),
        tuple(pushed),
        frozenset(joined),
        tuple(chain for wall in world.walls for chain in wall.chains),
        frozenset(spun),
    )


def _overspin(body: Body) -> Array:
    """px/s by which its start differs from rolling: (wx, wy) rolls at (R wy, -R wx), signs as in `Body.roll`."""
    if body.solid is not Solid.SPHERE or body.radius is None or not np.any(body.roll):
        return np.zeros(2)
    rolling = body.radius * np.array([-body.roll[1], body.roll[0]])
    return np.asarray(
        np.where(np.abs(rolling - body.velocity) > 1e-6 * np.abs(body.velocity).max(initial=1.0), 1.0, 0.0)
    )


def _width(pieces: tuple[Array, ...]) -> float:
    """px: the least of all shadows that the whole casts; hollows count as filled."""
    angles = np.linspace(0.0, np.pi, 36, endpoint=False)
    shadows = np.concatenate(pieces) @ np.stack([np.cos(angles), np.sin(angles)])
    return float(np.ptp(shadows, axis=0).min())


def _holds_origin(piece: Array) -> bool:
    following = np.roll(piece, -1, axis=0)
    turns = piece[:, 0] * following[:, 1] - piece[:, 1] * following[:, 0]
    return bool((turns >= 0).all() or (turns <= 0).all())


def _inscribed(piece: Array) -> float:
    along = np.roll(piece, -1, axis=0) - piece
    length = np.hypot(*along.T)
    keep = length > 1e-9
    return float((np.abs(piece[:, 0] * along[:, 1] - piece[:, 1] * along[:, 0])[keep] / length[keep]).min())
