"""Lines of joints and fields lie where the joints and fields are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import written

from physgen.render.machines import field_lines, joint_lines
from physgen.simulate.engine import simulate

SCENE = """\
physgen: 1
size: [600, 400]
world: {view: side, duration: 1}
objects:
  bob: {shape: {circle: {center: [100, 160], radius: 10}}, velocity: [60, 0]}
  car: {shape: {box: {center: [300, 100], size: [30, 20]}}}
  light: {shape: {circle: {center: [420, 200], radius: 8}}, mass: 50}
  heavy: {shape: {circle: {center: [500, 150], radius: 10}}, mass: 90}
joints:
  rope: {objects: [bob], rope: [[100, 160], [100, 60]]}
  rail: {objects: [car], slider: [[250, 80], [400, 155]]}
  over: {objects: [light, heavy], pulley: [[420, 200], [420, 60], [500, 60], [500, 150]]}
fields:
  pool: {water: [0, 300, 600, 100], density: 1}
boundaries:
  belt: {segment: [[20, 280], [200, 280]], conveyor: -40}
"""


def test_lines_follow_the_motion(tmp_path: Path) -> None:
    world = written.world(tmp_path, SCENE)
    motion = simulate(world, np.array([0.0, 0.5]))
    for time, poses in zip(motion.times.tolist(), motion.poses, strict=True):
        over, rail, *others = _chains(joint_lines(world, poses, time))
        places = dict(zip(motion.names, poses[:, :2], strict=True))
        assert np.allclose(over[[0, -1]], [places["light"], places["heavy"]], atol=0.1)
        assert np.hypot(*np.diff(over, axis=0).T).sum() < 311
        assert np.allclose(rail, [[250, 80], [400, 155]])
        rope = others[-1]
        assert np.allclose(rope, [places["bob"], [100, 60]], atol=0.1)


def test_a_broken_joint_is_not_drawn(tmp_path: Path) -> None:
    world = written.world(tmp_path, SCENE)
    poses = simulate(world, np.array([0.0])).poses[0].copy()
    whole = len(list(joint_lines(world, poses, 0.0)))
    poses[:, 0] += 80 * np.arange(len(poses))
    assert len(list(joint_lines(world, poses, 0.0))) < whole


def test_fields_show_water_and_the_way_of_a_belt(tmp_path: Path) -> None:
    world = written.world(tmp_path, SCENE)
    poses = simulate(world, np.array([0.0])).poses[0]
    water, shaft, tip = field_lines(world, poses, 0.0)
    assert water.min(axis=0).tolist() == [0, 300]
    assert shaft[0, 0] > shaft[1, 0]
    assert tip[1].tolist() == shaft[1].tolist()


def _chains(lines) -> list[np.ndarray]:
    """Return the chains of joints that are no circles of pins, and no stops of rails."""
    long = [line for line in lines if np.ptp(line, axis=0).max() > 30]
    return sorted(long, key=lambda line: -line[:, 0].max())
