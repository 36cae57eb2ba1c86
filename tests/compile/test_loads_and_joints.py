"""Joints and fields of a scene -> indices, points in the bodies' frames, rad."""

from __future__ import annotations

from math import hypot, inf, radians
from pathlib import Path

import numpy as np
import pytest
import written
from pytest import approx

from physgen.problems import InputError, Limit
from physgen.scene.scene import FieldKind, JointKind

BODY = """\
objects:
  wheel: {shape: {circle: {center: [90, 100], radius: 20}}}
  car: {shape: {box: {center: [100, 80], size: [80, 30], angle: 20}}}
  post: {shape: {box: {center: [180, 80], size: [10, 80]}}, motion: static}
  arm: {shape: {box: {center: [20, 80], size: [10, 80]}}, motion: {path: [[0, 20, 80], [2, 30, 80]]}}
"""
ARM, CAR, POST, WHEEL = range(4)
"""By name."""


def world(tmp_path: Path, rest: str):
    return written.world(tmp_path, f"physgen: 1\nsize: [200, 150]\n{BODY}{rest}")


def test_joints_ride_on_their_bodies(tmp_path: Path) -> None:
    w = world(
        tmp_path,
        """\
joints:
  hinge: {objects: [car], pivot: [60, 40]}
  drive: {objects: [wheel, car], motor: [90, 101], speed: 360, limit: 2.0e9}
  tow: {objects: [wheel, post], spring: [[95, 100], [180, 60]], stiffness: 4.0e4, damping: 200}
  line: {objects: [wheel], spring: [[95, 100], [95, 0]], stiffness: 3, length: 80}
  glue: {objects: [arm, car], weld: [22, 80], collide: true}
  free: {objects: [car, wheel], motor: [90, 101], speed: -90}
""",
    )
    joints = {joint.name: joint for joint in w.joints}
    assert list(joints) == ["drive", "free", "glue", "hinge", "line", "tow"]
    hinge = joints["hinge"]
    assert (hinge.kind, hinge.first, hinge.second) == (JointKind.PIVOT, CAR, None)
    assert w.bodies[CAR].center + hinge.first_at == approx([60, 40])
    assert hinge.second_at.tolist() == [60, 40]
    drive, free = joints["drive"], joints["free"]
    assert (drive.first, drive.second, drive.speed, drive.limit) == (
        WHEEL,
        CAR,
        approx(2 * np.pi),
        2e9,
    )
    assert drive.first_at == approx([0, 1])
    assert w.bodies[CAR].center + drive.second_at == approx([90, 101])
    assert (free.first, free.second, free.speed, free.limit) == (
        CAR,
        WHEEL,
        approx(radians(-90)),
        inf,
    )
    tow, line, glue = joints["tow"], joints["line"], joints["glue"]
    assert (tow.first_at.tolist(), tow.second_at.tolist()) == ([5, 0], [0, -20])
    assert tow.length == approx(hypot(85, 40))  # as at t = 0
    assert (tow.stiffness, tow.damping, tow.collide) == (4e4, 200, False)
    assert (line.second, line.second_at.tolist(), line.length) == (None, [95, 0], 80)
    assert (glue.first, glue.second, glue.collide) == (ARM, CAR, True)
    assert all(
        array.dtype == np.float64
        for joint in w.joints
        for array in (joint.first_at, joint.second_at)
    )


def test_a_joint_of_what_cannot_move_is_left_out(tmp_path: Path) -> None:
    """No engine can solve it, and a lint tells of it."""
    w = world(
        tmp_path,
        "joints: {a: {objects: [post], pivot: [180, 80]}, b: {objects: [arm, post], weld: [100, 80]}, "
        "c: {objects: [arm, car], weld: [60, 80]}}",
    )
    assert [joint.name for joint in w.joints] == ["c"]


def test_fields_act_on_what_can_move(tmp_path: Path) -> None:
    w = world(
        tmp_path,
        """\
fields:
  wind-2: {wind: [300, -4], drag: 2.0e-3}
  wind-10: {wind: [1, 0], drag: 5, objects: [wheel, arm, car, wheel]}
  magnet: {attractor: [40, 50], strength: -4.0e7, soften: 5, objects: [wheel]}
""",
    )
    magnet, every, some = w.fields
    assert (magnet.name, magnet.kind, magnet.bodies) == (
        "magnet",
        FieldKind.ATTRACTOR,
        (WHEEL,),
    )
    assert (magnet.vector.tolist(), magnet.strength, magnet.soften) == (
        [40, 50],
        -4e7,
        5,
    )
    assert (every.kind, every.bodies, every.drag) == (
        FieldKind.WIND,
        (CAR, WHEEL),
        2e-3,
    )
    assert every.vector.tolist() == [300, -4]
    assert (some.name, some.bodies) == ("wind-10", (CAR, WHEEL))


def test_endless_pulls_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Limit.PULLS, "most", 5)
    fields = "".join(f"  f{k}: {{wind: [1, 0], drag: 1}}\n" for k in range(3))
    with pytest.raises(
        InputError,
        match="fields: 6 pulls of fields on objects are too many; name the objects",
    ):
        world(tmp_path, "fields:\n" + fields)
