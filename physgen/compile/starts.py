"""Velocities at t = 0 of bodies with joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from physgen.compile.world import Body, Joint, World
from physgen.geometry.polygon import Array
from physgen.scene.scene import SPRINGS, JointKind, Motion

PINS = (JointKind.PIVOT, JointKind.MOTOR)
LOOSE = (*SPRINGS, JointKind.ROPE, JointKind.PULLEY, JointKind.GEAR)
"""Joints that do not hold a point of a body in place."""

ROWS_OF = {JointKind.WELD: 3, JointKind.GEAR: 1}
"""Number of speeds that a joint keeps at zero; the default is two."""


def swing_about_pins(
    bodies: Sequence[Body], joints: Sequence[Joint]
) -> tuple[Body, ...]:
    """Return the bodies. A body that can only turn about one fixed pin gets the
    velocity of its spin.

    The spin of a rod with a pin at its end means a turn about that end.
    """
    return tuple(_swinging(k, body, bodies, joints) for k, body in enumerate(bodies))


def _swinging(
    index: int, body: Body, bodies: Sequence[Body], joints: Sequence[Joint]
) -> Body:
    is_turning = body.spin != 0 and not body.velocity.any()
    if body.motion is not Motion.DYNAMIC or not is_turning:
        return body
    # A body on one fixed pin can only turn about this pin: a written spin implies the
    # velocity of the centre of mass.
    pin = _only_pin(index, joints)
    if pin is None:
        return body
    partner: int | None = pin.first
    x, y = pin.second_at
    if pin.first == index:
        partner = pin.second
        x, y = pin.first_at
    if partner is not None and bodies[partner].motion is Motion.DYNAMIC:
        return body
    # Velocity of the centre: the spin times the vector from pin to centre, turned by 90
    # degrees. The vector from centre to pin is (x, y), which gives (y, -x).
    return replace(body, velocity=body.spin * np.array([y, -x]))


def _only_pin(index: int, joints: Sequence[Joint]) -> Joint | None:
    """Return the pin of a body; None if other joints hold it too."""
    own_joints = []
    for joint in joints:
        if index in (joint.first, joint.second) and joint.kind not in LOOSE:
            own_joints.append(joint)
    if len(own_joints) != 1 or own_joints[0].kind not in PINS:
        return None
    return own_joints[0]


def _constraint_rows(joint: Joint, count: int) -> Array:
    """Return the rows (R, 3 `count`) whose products with the velocities of all bodies
    a joint keeps at zero.
    """
    block = np.zeros((3, count, 3))
    for body, point, sign in (
        (joint.first, joint.first_at, 1.0),
        (joint.second, joint.second_at, -1.0),
    ):
        if body is not None:
            x, y = point
            # The velocity of a point of a body is v + omega x r; the third row is
            # the spin.
            block[:, body] = sign * np.array([[1, 0, -y], [0, 1, x], [0, 0, 1]])
    if joint.kind is JointKind.SLIDER:
        (rail,) = joint.guide
        # A slider keeps the speed across its rail and the spin at zero.
        normal = np.array([-rail[1], rail[0], 0.0]) / np.hypot(*rail)
        block[0] = np.tensordot(normal, block, 1)
        block[1] = block[2]
    elif joint.kind is JointKind.GEAR:
        block[0] = block[2]
        if joint.second is not None:
            block[0, joint.second] *= joint.ratio
    rows = block[: ROWS_OF.get(joint.kind, 2)]
    return rows.reshape(-1, 3 * count)


def velocities_that_joints_allow(world: World) -> Array:
    """Return the velocities (N, 3) at t = 0 after the impulses of pins and welds: px/s,
    px/s, rad/s.
    """
    bodies = world.bodies
    velocity = np.array([[*body.velocity, body.spin] for body in bodies])
    rows: list[Array] = []
    for joint in world.joints:
        if joint.kind in (*SPRINGS, JointKind.ROPE, JointKind.PULLEY):
            continue
        rows += list(_constraint_rows(joint, len(bodies)))
    if not rows:
        return velocity.reshape(-1, 3)
    jacobian = np.array(rows)
    is_dynamic = [body.motion is Motion.DYNAMIC for body in bodies]
    weights = np.array([[body.mass, body.mass, body.moment] for body in bodies])
    inverse = np.where(np.array(is_dynamic)[:, None], 1 / weights, 0.0).ravel()
    # Impulses J along the rows satisfy (J M^-1 J^T) p = J v: afterwards no row has a
    # speed.
    give = (jacobian * inverse) @ jacobian.T
    excess = jacobian @ velocity.ravel()
    # Redundant joints make the matrix singular: least squares share the impulse.
    impulse: Array = np.linalg.lstsq(give, excess, rcond=1e-10)[0]
    change = inverse * (jacobian.T @ impulse)
    return np.asarray((velocity.ravel() - change).reshape(-1, 3))
