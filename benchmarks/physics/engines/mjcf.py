"""World -> MJCF, the XML that MuJoCo reads; in `Units`, axes those of the photo, +z away from the viewer.

Seen from the side, a body slides along x and y and turns about z; circles are balls, which in the plane is the same,
since their contacts are exact where cylinders' are found by iteration. On a table (z = 0, bodies at z < 0) balls are
free, and touch each other as balls do: friction between them acts up and down, too.

Every pair that may meet is listed with its own friction and elasticity; nothing else collides.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from math import isfinite, pi
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, Joint, World
from physgen.scene.scene import JointKind, Motion

from .stepping import Units, is_ball, lies_on_table

Array = NDArray[np.float64]

THIN = 1e-4
"""Units: half the thickness of a wall. Contact points lie in the middle of an overlap, and
a wall's pairs count from its middle line on: the thicker it is, the shorter the lever of what rolls along it."""
DEPTH = 0.5
"""Units: half the depth of a prism seen from the side."""
HEAVY = 1e4
"""Times the heaviest body: a scripted one, which its contacts should not move."""
RIGID = "0.9999 0.9999 0.001 0.5 2"
"""solimp: constraints as hard as MuJoCo allows, whatever their depth."""
OVERDAMPED = 5
"""Times critical damping, where nothing is thrown back: at 1, the overlap of the first step of contact would come back
as a quarter of the closing speed."""
SLIP = 0.004
"""s in which friction ends a slip that it can end, MuJoCo's default being 0.02. Its cones are convex: what slips is
also lifted, the more the faster this is, and a sliding thing hops."""
CONTACT = 0.01
"""s: half a swing of the spring that throws things back."""
GAIN = 0.5
"""Of a motor: the part of its error that it makes good in a step."""


def mjcf(world: World, units: Units, step: float) -> str:
    """The model with time step `step` s: bodies b0, b1 ..., their joints x0, y0 and a0 (balls on a table: x0, free)."""
    return _Model(world, units, step).text()


def bounces(world: World) -> bool:
    """Whether any two things that may meet throw each other back."""
    movable = [
        k for k, body in enumerate(world.bodies) if body.motion is Motion.DYNAMIC
    ]
    springy = [
        k for k, (_, surface) in enumerate(world.surfaces) if surface.elasticity > 0
    ]
    return any(i != j for i in set(movable) & set(springy) for j in springy)


class _Model:
    def __init__(self, world: World, units: Units, step: float) -> None:
        self._world, self._units, self._step = world, units, step
        self._table = lies_on_table(world)
        self._root = Element("mujoco")
        flags = {
            "cone": "elliptic",
            "solver": "Newton",
            "tolerance": "1e-12",
            "iterations": "200",
        }
        press = world.press / units.length if self._table else 0.0
        gravity = _text(*(world.gravity / units.length), press)
        option = _add(
            self._root, "option", timestep=repr(step), gravity=gravity, **flags
        )
        _add(option, "flag", autoreset="disable", multiccd="enable")
        _add(self._root, "size", memory="256M")
        self._assets = _add(self._root, "asset")
        self._space = _add(self._root, "worldbody")
        self._pairs = _add(self._root, "contact")
        self._equal, self._tendons, self._actuators = (
            _add(self._root, name) for name in ("equality", "tendon", "actuator")
        )
        self._geoms: list[list[str]] = []
        """Names, a list a surface: bodies, then walls."""

    def text(self) -> str:
        """All of it."""
        parents = [
            self._body(index, body) for index, body in enumerate(self._world.bodies)
        ]
        for index, wall in enumerate(self._world.walls):
            self._geoms.append([])
            for a, b in (
                ends
                for chain in wall.chains
                for ends in pairwise(chain / self._units.length)
            ):
                name = f"w{index}.{len(self._geoms[-1])}"
                self._slab(name, a, b)
                self._geoms[-1].append(name)
        if self._table:
            _add(
                self._space,
                "geom",
                name="table",
                type="plane",
                size="1 1 1",
                zaxis="0 0 -1",
                **_GHOST,
            )
        self._contacts()
        for index, joint in enumerate(self._world.joints):
            self._joint(f"j{index}", joint, parents)
        return tostring(self._root, encoding="unicode")

    def _body(self, index: int, model: Body) -> Element:
        u = self._units
        ball = self._rolls(model)
        height = -(model.radius or 0.0) / u.length if ball else 0.0
        place = _text(*(model.center / u.length), height)
        body = _add(self._space, "body", name=f"b{index}", pos=place)
        mass, moment = model.mass / u.mass, model.moment / u.moment
        if model.motion is Motion.SCRIPTED:
            mass = HEAVY * max(b.mass for b in self._world.bodies) / u.mass
            moment = HEAVY * max(b.moment for b in self._world.bodies) / u.moment
            body.set("gravcomp", "1")
        if ball:
            _add(body, "freejoint", name=f"x{index}")
        elif model.motion is not Motion.STATIC:
            _add(body, "joint", name=f"x{index}", type="slide", axis="1 0 0")
            _add(body, "joint", name=f"y{index}", type="slide", axis="0 1 0")
            _add(body, "joint", name=f"a{index}", type="hinge", axis="0 0 1")
        _add(
            body,
            "inertial",
            pos="0 0 0",
            mass=repr(mass),
            diaginertia=_text(moment, moment, moment),
        )
        self._geoms.append(self._shape(body, index, model))
        return body

    def _shape(self, body: Element, index: int, model: Body) -> list[str]:
        name, u = f"g{index}", self._units
        middle, half = self._depths()
        if model.radius is not None:
            radius = model.radius / u.length
            if self._rolls(model) or not self._table:
                _add(
                    body, "geom", name=name, type="sphere", size=_text(radius), **_GHOST
                )
            else:
                size = {
                    "type": "capsule",
                    "size": _text(radius, half),
                    "pos": _text(0, 0, middle),
                }
                _add(body, "geom", name=name, **size, **_GHOST)
            return [name]
        names = [f"{name}.{k}" for k in range(len(model.pieces))]
        for part, piece in zip(names, model.pieces, strict=True):
            corners = piece / u.length
            if box := _as_box(corners):
                center, sides, angle = box
                pose = {
                    "pos": _text(*center, middle),
                    "euler": _text(0, 0, np.degrees(angle)),
                }
                _add(
                    body,
                    "geom",
                    name=part,
                    type="box",
                    size=_text(*sides, half),
                    **pose,
                    **_GHOST,
                )
            else:
                near, far = (
                    [(x, y, z) for x, y in corners]
                    for z in (middle - half, middle + half)
                )
                vertices = _text(*np.ravel([*near, *far]))
                _add(self._assets, "mesh", name=part, vertex=vertices, inertia="convex")
                _add(body, "geom", name=part, type="mesh", mesh=part, **_GHOST)
        return names

    def _slab(self, name: str, a: Array, b: Array) -> None:
        middle, half = self._depths()
        length, angle = (
            float(np.hypot(*(b - a))),
            float(np.degrees(np.arctan2(*(b - a)[::-1]))),
        )
        pose = {"pos": _text(*((a + b) / 2), middle), "euler": _text(0, 0, angle)}
        size = _text(max(length / 2, 1e-6), THIN, 2 * half)
        _add(self._space, "geom", name=name, type="box", size=size, **pose, **_GHOST)

    def _depths(self) -> tuple[float, float]:
        """Middle and half depth of the prisms; on a table they reach above every ball's middle."""
        if not self._table:
            return 0.0, DEPTH
        top = max(body.reach for body in self._world.bodies) / self._units.length
        return -top, top

    def _contacts(self) -> None:
        surfaces = [surface for _, surface in self._world.surfaces]
        apart = {
            frozenset((j.first, j.second))
            for j in self._world.joints
            if j.second is not None and not j.collide
        }
        for i, body in enumerate(self._world.bodies):
            for j in range(i + 1, len(surfaces)):
                other = self._world.bodies[j] if j < len(self._world.bodies) else None
                moves = Motion.DYNAMIC in (body.motion, other.motion if other else None)
                if not moves or frozenset((i, j)) in apart:
                    continue
                friction = surfaces[i].friction * surfaces[j].friction
                elasticity = surfaces[i].elasticity * surfaces[j].elasticity
                rolling = max(_rolling(body), _rolling(other)) / self._units.length
                for first in self._geoms[i]:
                    for second in self._geoms[j]:
                        self._pair(
                            first,
                            second,
                            friction,
                            elasticity,
                            rolling,
                            margin=0.0 if other else -THIN,
                        )
            if self._rolls(body):
                friction = body.surface.friction * self._world.table.friction
                rolling = _rolling(body) / self._units.length
                self._pair(
                    self._geoms[i][0], "table", friction, 0.0, rolling, margin=0.0
                )

    def _rolls(self, body: Body) -> bool:
        """Whether the body is free to roll over the table."""
        return self._table and is_ball(body) and body.motion is Motion.DYNAMIC

    def _pair(
        self,
        first: str,
        second: str,
        friction: float,
        elasticity: float,
        rolling: float,
        margin: float,
    ) -> None:
        dead = f"{2 * self._step!r} {OVERDAMPED}"
        pair = _add(
            self._pairs,
            "pair",
            geom1=first,
            geom2=second,
            solimp=RIGID,
            margin=repr(margin),
        )
        pair.set("condim", "6" if rolling else "3" if friction else "1")
        pair.set("friction", _text(friction, friction, 0, rolling, rolling))
        pair.set("solreffriction", f"{SLIP!r} 1")
        pair.set(
            "solref",
            dead if elasticity == 0 else _text(*spring(elasticity, self._step)),
        )

    def _joint(self, name: str, joint: Joint, parents: list[Element]) -> None:
        u, world = self._units, self._world
        first = f"b{joint.first}"
        second = {} if joint.second is None else {"body2": f"b{joint.second}"}
        hard = {"solref": f"{2 * self._step!r} 1", "solimp": RIGID}
        anchor = _text(*(joint.first_at / u.length), 0)
        if joint.kind is JointKind.WELD:
            _add(self._equal, "weld", body1=first, anchor=anchor, **second, **hard)
        elif joint.kind is JointKind.SPRING:
            other = self._space if joint.second is None else parents[joint.second]
            for end, body, at in (
                ("a", parents[joint.first], joint.first_at),
                ("b", other, joint.second_at),
            ):
                _add(body, "site", name=f"{name}{end}", pos=_text(*(at / u.length), 0))
            law = {"stiffness": joint.stiffness, "damping": joint.damping}
            texts = {key: repr(value / u.mass) for key, value in law.items()}
            tendon = _add(
                self._tendons,
                "spatial",
                springlength=repr(joint.length / u.length),
                **texts,
            )
            for end in "ab":
                _add(tendon, "site", site=f"{name}{end}")
        else:
            _add(self._equal, "connect", body1=first, anchor=anchor, **second, **hard)
        if joint.kind is JointKind.MOTOR:
            turning = [
                (k, sign)
                for k, sign in ((joint.first, 1), (joint.second, -1))
                if k is not None
            ]
            turning = [
                (k, sign)
                for k, sign in turning
                if world.bodies[k].motion is Motion.DYNAMIC
            ]
            tendon = _add(self._tendons, "fixed", name=name)
            for k, sign in turning:
                _add(tendon, "joint", joint=f"a{k}", coef=str(sign))
            slowness = sum(u.moment / world.bodies[k].moment for k, _ in turning)
            motor = _add(
                self._actuators,
                "velocity",
                name=name,
                tendon=name,
                kv=repr(GAIN / slowness / self._step),
            )
            if isfinite(joint.limit):
                motor.set(
                    "forcerange", _text(-joint.limit / u.moment, joint.limit / u.moment)
                )


@cache
def spring(elasticity: float, step: float) -> tuple[float, float]:
    """MuJoCo's direct solref (-stiffness, -damping) of a contact that gives back this part of the closing speed.

    The contact is a damped spring that only pushes: x'' = -k x - b x' while that is away from the wall (Schwager and
    Pöschel, Granular Matter 9, 465, 2007). The damping is found on the very recursion that MuJoCo steps, averaged
    over where in a step the contact begins.
    """
    w = pi / CONTACT
    low, high = 0.0, 30.0
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (
            (middle, high)
            if _given_back(middle, w * step) > elasticity
            else (low, middle)
        )
    return -w * w, -2 * low * w


def _given_back(ratio: float, angle: float) -> float:
    """Mean speed after a hit at speed 1: `ratio` of critical damping, `angle` of the swing a step."""
    x = (np.arange(64) + 0.5) / 64 * angle
    v, open_ = np.ones(64), np.ones(64, bool)
    for _ in range(int(100 * (1 + ratio) / angle)):
        push = -(x + 2 * ratio * v)
        open_ &= (push < 0) & (x > 0)
        if not open_.any():
            break
        v = np.where(open_, v + angle * push, v)
        x = np.where(open_, x + angle * v, x)
    return float(np.maximum(-v, 0).mean())


_GHOST = {"contype": "0", "conaffinity": "0"}


def _rolling(body: Body | None) -> float:
    """px: how far ahead of its middle the ground pushes a rolling body."""
    return (
        body.rolling * body.reach
        if body is not None and body.motion is Motion.DYNAMIC
        else 0.0
    )


def _as_box(corners: Array) -> tuple[Array, Array, float] | None:
    """Centre, half sizes and angle of a rectangle; None for any other piece."""
    if len(corners) != 4:
        return None
    sides = np.roll(corners, -1, axis=0) - corners
    scale = np.abs(corners).max()
    if (
        np.abs(sides[0] + sides[2]).max() > 1e-9 * scale
        or abs(sides[0] @ sides[1]) > 1e-9 * scale**2
    ):
        return None
    size = np.array([np.hypot(*sides[0]), np.hypot(*sides[1])]) / 2
    return corners.mean(axis=0), size, float(np.arctan2(sides[0][1], sides[0][0]))


def _add(parent: Element, tag: str, **attributes: str) -> Element:
    return SubElement(parent, tag, attributes)


def _text(*numbers: float) -> str:
    return " ".join(repr(float(number)) for number in numbers)
