"""Compile a scene and a label map into a World: shapes, masses, joints and loads in px,
s, g, rad.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, pi, radians, sqrt

import numpy as np
from numpy.typing import NDArray

from physgen.compile.shapes import (
    U16,
    Shapes,
    circle_corners,
    shapes_of,
    snapped_to_boundaries,
    walls_of,
)
from physgen.compile.starts import swing_about_pins
from physgen.compile.vehicles import with_wheels
from physgen.compile.world import (
    Body,
    Field,
    Joint,
    Push,
    World,
    passages,
    placed_outline,
    rest_pose,
    surface,
    surface_of,
)
from physgen.geometry.convex import convex_pieces
from physgen.geometry.polygon import (
    Array,
    Disc,
    Outline,
    mass_properties,
    mean_distance,
)
from physgen.messages import Message
from physgen.problems import InputError, Limit, Problem
from physgen.scene import scene as model
from physgen.scene.construction import EARTH
from physgen.scene.scene import (
    Auto,
    JointKind,
    Load,
    Motion,
    Object,
    Scene,
    Solid,
    View,
)


def pushes_of(scene: Scene, bodies: Sequence[Body]) -> tuple[Push, ...]:
    """Return the forces, torques and impulses in the file's order."""
    index = _index(bodies)

    def push(force: model.Force) -> Push:
        body = index[force.object]
        # Without a point, the force acts at the centre of mass and turns nothing.
        if force.at is None:
            point = np.zeros(2)
        else:
            point = np.array(force.at) - bodies[body].center
        end = force.start
        # An impulse acts at one time; a force without a duration never ends.
        if force.load is not Load.IMPULSE:
            end += inf if force.duration is None else force.duration
        return Push(
            body,
            force.load,
            np.array(force.vector),
            force.torque,
            point,
            force.start,
            end,
            force.profile,
        )

    return tuple(map(push, scene.forces))


def joints_of(scene: Scene, bodies: Sequence[Body]) -> tuple[Joint, ...]:
    """Return the joints by name, without joints between bodies that cannot move. No
    engine could solve those; a warning reports them.
    """
    index = _index(bodies)
    return tuple(
        _joint(item, [index[name] for name in item.objects], bodies)
        for item in scene.joints
        if any(bodies[index[name]].motion is Motion.DYNAMIC for name in item.objects)
    )


def _joint(item: model.Joint, ends: Sequence[int], bodies: Sequence[Body]) -> Joint:
    if len(ends) == 2:
        first = ends[0]
        second = ends[1]
    else:
        first, second = (ends[0], None)
    # The engine needs points relative to the centres of mass; a joint to the world
    # keeps its second point in the photo's frame.
    first_point, second_point, guide = _places(item, bodies[first])
    points = np.array(item.points, np.float64).reshape(-1, 2)
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    return Joint(
        name=item.name,
        kind=item.kind,
        first=first,
        second=second,
        first_at=first_point - bodies[first].center,
        second_at=second_point
        if second is None
        else second_point - bodies[second].center,
        length=length if item.length is None else item.length,
        stiffness=item.stiffness,
        damping=item.damping,
        speed=radians(item.speed),
        limit=_or_infinite(item.limit),
        collide=item.collide,
        guide=guide,
        ratio=item.gear,
        limits=_in_radians(item.limits),
        friction=item.friction,
        drive=item.drive,
        force=_or_infinite(item.force),
        breaks=_or_infinite(item.breaks),
        knots=np.array(item.knots, np.float64) if item.knots else None,
    )


def _places(item: model.Joint, body: Body) -> tuple[Array, Array, tuple[Array, ...]]:
    """Return the points of a joint on its first object and on the second side, px, and
    `Joint.guide`.
    """
    # A gear joins angles and has no points.
    if item.kind is JointKind.GEAR:
        return body.center, np.zeros(2), ()
    points = np.array(item.points, np.float64)
    first_point, second_point = points[0], points[-1]
    # The rope of a pulley runs from the first object over two wheels to the second.
    if item.kind is JointKind.PULLEY:
        return first_point, second_point, tuple(points[1:3])
    if item.kind is not JointKind.SLIDER:
        return first_point, second_point, ()
    # A slider holds the projection of the body's centre onto the rail.
    direction = second_point - first_point
    part = (body.center - first_point) @ direction / (direction @ direction)
    return first_point + part * direction, first_point, (direction,)


def rail_problems(scene: Scene, bodies: Sequence[Body]) -> Iterator[Problem]:
    """Yield problems of objects that start beyond an end of their rail."""
    centers = {body.name: body.center for body in bodies}
    for item in scene.joints:
        if item.kind is not JointKind.SLIDER:
            continue
        first_end, second_end = np.array(item.points, np.float64)
        rail = second_end - first_end
        center = centers[item.objects[0]]
        # The place along the rail as a share of its length: below 0 and above 1 are
        # beyond an end.
        part = float((center - first_end) @ rail / (rail @ rail))
        distance = max(-part, part - 1) * float(np.hypot(*rail))
        if distance > RAIL_END:
            end = first_end + part * rail
            path = f"joints.{item.name}.slider"
            yield Message.OFF_RAIL.problem(
                scene.place(path),
                path,
                "the rail",
                object=item.objects[0],
                away=distance,
                x=float(end[0]),
                y=float(end[1]),
            )


RAIL_END = 1e-3
"""Tolerance of a start beyond the end of a rail, px."""


def _or_infinite(limit: float | None) -> float:
    if limit is None:
        return inf
    return limit


def _in_radians(limits: model.Point | None) -> tuple[float, float] | None:
    if limits is None:
        return None
    return (radians(limits[0]), radians(limits[1]))


def fields_of(scene: Scene, bodies: Sequence[Body]) -> tuple[Field, ...]:
    """Return the fields by name. Raise InputError for more pulls than a step can
    compute.
    """
    index = _index(bodies)
    dynamic_bodies = tuple(
        k for k, body in enumerate(bodies) if body.motion is Motion.DYNAMIC
    )
    fields = []
    for item in scene.fields:
        named_bodies = sorted({index[name] for name in item.objects})
        # Without names, a field acts on all dynamic objects.
        if named_bodies:
            targets = tuple(
                k for k in named_bodies if bodies[k].motion is Motion.DYNAMIC
            )
        else:
            targets = dynamic_bodies
        vector = np.array(item.vector, np.float64)
        fields.append(
            Field(
                item.name,
                item.kind,
                targets,
                vector,
                item.drag,
                item.strength,
                item.soften,
                item.linear,
                item.density,
                item.pull,
                item.extent,
                np.array(item.velocity, np.float64),
                radians(item.spin),
            )
        )
    # The work of a step grows with the number of pulls.
    pulls = sum(len(field.bodies) for field in fields)
    if pulls > Limit.PULLS.most:
        raise Limit.PULLS.error(scene.place("fields"), "fields", f"{pulls:,} pulls")
    return tuple(fields)


def _index(bodies: Sequence[Body]) -> dict[str, int]:
    return {body.name: k for k, body in enumerate(bodies)}


FARTHEST = 1e9
"""Maximum mass ratio. A contact between the two bodies loses half of a
float's digits.
"""
LEAST = 1e-150
"""Minimum mass and moment of a body, g and g·px². The engine multiplies two of them,
and 1e-308 is the smallest float with all digits.
"""


def mass_problems(scene: Scene, bodies: Sequence[Body]) -> Iterator[Problem]:
    """Yield problems of moments that are 0 or infinite as floats, and of masses too far
    apart. Only dynamic bodies count.
    """
    dynamic = []
    for body in bodies:
        if body.motion is Motion.DYNAMIC:
            dynamic.append(body)
    sound = True
    # The moment grows with mass times length²: it leaves the range of floats before the
    # mass does.
    for body in dynamic:
        if not (_usable(body.mass) and _usable(body.moment)):
            sound = False
            path = mass_path(scene, body.name)
            message = Message.MASS_TOO_LARGE
            if body.moment < 1:
                message = Message.MASS_TOO_SMALL
            value_text = f"{body.mass:.4g} g"
            yield message.problem(
                scene.place(path), path, value_text, moment=body.moment
            )
    if not sound or not dynamic:
        return
    # Contacts of very different masses need too many iterations.
    light = min(dynamic, key=lambda body: body.mass)
    heaviest = max(dynamic, key=lambda body: body.mass)
    if heaviest.mass >= FARTHEST * light.mass:
        path = mass_path(scene, light.name)
        value_text = (
            f"{light.mass:.4g} g, and {heaviest.mass:.4g} g of {heaviest.name}:"
        )
        yield Message.MASSES_FAR_APART.problem(scene.place(path), path, value_text)


def mass_path(scene: Scene, name: str) -> str:
    """Return the path of the mass of an object."""
    item = next(item for item in scene.objects if item.name == name)
    return f"objects.{name}.{'mass' if item.mass is not None else 'density'}"


def _usable(value: float) -> bool:
    """Return whether products and quotients of two such numbers are floats."""
    return LEAST < value < 1 / LEAST


INERTIA = {Solid.SPHERE: 2 / 5, Solid.DISC: 1 / 2, Solid.HOOP: 1.0}
"""Factor k of the moment k m r² about an axis through the centre; any
mechanics text.
"""


@dataclass(frozen=True)
class CompiledScene:
    """The input of the later stages: world, outlines and shapes of a scene."""

    world: World
    outlines: tuple[Outline, ...]
    """Outlines of the objects at t = 0, photo frame: those of `shapes` on their
    boundaries, at their `place`.
    """
    shapes: Shapes

    @property
    def labels(self) -> U16:
        """Return the label map (H, W): id k + 1 is object k; 0 = background."""
        return self.shapes.labels

    @property
    def scenery(self) -> NDArray[np.bool_]:
        """Return the boundary pixels (H, W), which stay in the picture."""
        return self.shapes.fits.scenery


def compile_scene(scene: Scene, labels: U16 | None) -> CompiledScene:
    """Return the compiled scene. `labels` is the photo's label map, None without one.
    Raise InputError.
    """
    check_steps(scene)
    return compile_shapes(scene, shapes_of(scene, labels))


def check_steps(scene: Scene) -> None:
    """Raise InputError if a simulation would take days."""
    steps = scene.world.duration * scene.world.steps_per_second
    if steps > Limit.STEPS.most:
        raise Limit.STEPS.error(
            scene.place("world.duration"), "world", f"{steps:,.0f} steps"
        )


def compile_shapes(scene: Scene, shapes: Shapes) -> CompiledScene:
    """Return the world of a scene with these `shapes`. Raise InputError."""
    shown = snapped_to_boundaries(
        scene, shapes.outlines, [it is None for it in shapes.written_outlines]
    )
    # The outlines of the photo come first, and then the place of each object in the
    # scene.
    outlines = tuple(map(placed_outline, shown, scene.objects))
    bodies = _compile_bodies(scene, shown, outlines)
    joints = joints_of(scene, bodies)
    world = World(
        size=scene.size,
        view=scene.world.view,
        gravity=np.array(scene.world.gravity, np.float64),
        pixels_per_meter=scene.world.pixels_per_meter,
        press=EARTH * scene.world.pixels_per_meter
        if scene.world.view is View.TOP
        else 0.0,
        table=surface(scene.world.table_friction, 0.0, scene.world.combine),
        combine=scene.world.combine,
        duration=scene.world.duration,
        steps_per_second=scene.world.steps_per_second,
        times=frame_times(scene, scene.world.duration),
        bodies=swing_about_pins(bodies, joints),
        walls=walls_of(scene, shapes.fits.walls),
        pushes=pushes_of(scene, bodies),
        joints=joints,
        fields=fields_of(scene, bodies),
    )
    return CompiledScene(world, outlines, shapes)


def _compile_bodies(
    scene: Scene, photo_outlines: Sequence[Outline], outlines: Sequence[Outline]
) -> list[Body]:
    """Return the bodies of the objects. Raise InputError with all problems.

    `photo_outlines` are the outlines in the photo, `outlines` those at the start.
    """
    problems: list[Problem] = []
    bodies, passage_of = [], passages(scene)
    rows = zip(scene.objects, outlines, photo_outlines, strict=True)
    for item, outline, photo_outline in rows:
        try:
            rest = rest_pose(photo_outline, item, scene)
            body = replace(_body(item, outline, scene), rest=rest)
            passage = passage_of.get(f"objects.{item.name}")
            if passage is not None:
                body = replace(body, passage=passage)
            bodies.append(with_wheels(body, item, outline, photo_outline, scene))
        except InputError as error:
            problems += error.problems
        except ValueError as error:
            path = f"objects.{item.name}.shape"
            problems.append(
                Message.OUTLINE_UNUSABLE.problem(
                    scene.place(path), path, "the outline", reason=str(error)
                )
            )
    # Masses and rails need all bodies: check them only if every body is usable.
    problems = problems or [
        *mass_problems(scene, bodies),
        *rail_problems(scene, bodies),
    ]
    if problems:
        raise InputError(problems)
    return bodies


def frame_times(scene: Scene, duration: float) -> Array:
    """Return the frame times (T,) s: k duration / frames with `render.frames`,
    otherwise k / rate for rate x duration frames.

    The rate is fps times slow: slow motion has more frames of the same motion.
    """
    render = scene.render
    rate = render.fps * render.slow
    if render.frames is None and rate * duration > Limit.FRAMES.most:
        value_text = f"{rate * duration:,.0f} frames"
        slow = ""
        if render.slow != 1:
            slow = " times slow"
        smaller = "duration or fps"
        if slow:
            smaller = "duration, fps or slow"
        place = scene.place("render.slow" if slow else "render.fps")
        values = {"slow": slow, "most": Limit.FRAMES.fix, "keys": smaller}
        raise Message.TOO_MANY_SAMPLES.error_at(place, "render", value_text, **values)
    # A given number of frames divides the duration evenly, whatever the rate of the
    # video.
    if render.frames is not None:
        return np.arange(render.frames, dtype=np.float64) * (duration / render.frames)
    return np.arange(max(1, round(rate * duration)), dtype=np.float64) / rate


@dataclass(frozen=True)
class Form:
    """The shape of a body in its frame, with the fields of `Body`."""

    radius: float | None
    pieces: tuple[Array, ...]
    rings: tuple[Array, ...]
    disc: tuple[Array, float] | None
    moment: float
    """g·px² about the centre of its area."""


def _form(item: Object, outline: Outline, center: Array, mass: float) -> Form:
    """Return the form of an object with its centre of mass (2,) px and mass, g. Raise
    ValueError if it is too thin.
    """
    if not isinstance(outline, Disc):
        properties = mass_properties(outline)
        pieces = tuple(piece - center for piece in convex_pieces(outline))
        if not pieces:
            raise ValueError("is too thin to simulate")
        rings = tuple(ring - center for ring, _ in outline.borders)
        moment = mass * properties.second / properties.area
        return Form(None, pieces, rings, None, moment)
    radius = outline.radius
    moment = mass * INERTIA.get(item.solid or Solid.DISC, 1 / 2) * radius**2
    circle = circle_corners(radius)
    if item.center_of_mass is None:
        return Form(radius, (), (circle,), None, moment)
    # A circle with its mass elsewhere rolls about another point: the engine needs
    # corners.
    offset = mass_properties(outline).center - center
    moved_circle = circle + offset
    return Form(None, (moved_circle,), (moved_circle,), (offset, radius), moment)


def _center_of_mass(item: Object, center_of_area: Array) -> Array:
    """Return the centre of mass that the file gives, or that of the area, (2,) px."""
    given_center = item.center_of_mass
    if given_center is None:
        return center_of_area
    if item.place is not None:
        return np.array(item.place[:2], np.float64)
    return np.array(given_center, np.float64)


def _body(item: Object, outline: Outline, scene: Scene) -> Body:
    """Return the body of an object. Raise ValueError if it has no area."""
    properties = mass_properties(outline)
    if properties.area <= 1e-6:
        raise ValueError("has no area")
    center = _center_of_mass(item, properties.center)
    mass = item.mass
    if mass is None:
        mass = (item.density or 1.0) * properties.area
    form = _form(item, outline, center, mass)
    # The parallel axis theorem moves the moment from the centre of the area to the
    # centre of mass.
    moment = form.moment + mass * float(np.sum((properties.center - center) ** 2))
    if item.moment is not None:
        moment = item.moment
    radius = form.radius
    moving = item.motion is Motion.DYNAMIC
    # The solid of a stored shape belongs to a circle. A repainted mask may not be
    # round.
    has_stored_shape = isinstance(item.shape, Auto) and item.shape.stored is not None
    if has_stored_shape and radius is None:
        solid = None
    else:
        solid = item.solid
    return Body(
        name=item.name,
        motion=item.motion,
        center=center,
        mass=float(mass),
        moment=float(moment),
        radius=radius,
        pieces=form.pieces,
        rings=form.rings,
        surface=surface_of(item, scene.world.combine),
        solid=solid or (Solid.DISC if radius is not None else Solid.PLATE),
        rolling=item.rolling,
        patch=1.5 * mean_distance(outline, center),
        roll=_roll(item, radius, scene.world.view),
        velocity=np.array(item.velocity if moving else (0.0, 0.0), np.float64),
        spin=radians(item.spin) if moving else 0.0,
        path=_path(item, center, scene),
        disc=form.disc,
        damping=item.damping or 0.0,
        ramp=scene.world.ramp,
        gravity_scale=1.0 if item.gravity_scale is None else item.gravity_scale,
        rocking=0.0 if radius is not None else _rocking_lever(item, properties.area),
    )


def _rocking_lever(item: Object, area: float) -> float:
    """Return the lever of the moment against turning on corners, px: a share of the
    radius of a circle with the same area.
    """
    return (item.rocking or 0.0) * sqrt(area / pi)


def set_velocity(body: Body, item: Object, view: View) -> Body:
    """Return a dynamic body with the velocity, spin and roll of its object."""
    velocity = np.array(item.velocity, np.float64)
    roll = _roll(item, body.radius, view)
    return replace(body, velocity=velocity, spin=radians(item.spin), roll=roll)


def _roll(item: Object, radius: float | None, view: View) -> Array:
    """Return the rolling rates about +x and +y, rad/s, by the right-hand rule: a sphere
    with a velocity towards +y turns positively about +x.
    """
    if (
        view is not View.TOP
        or item.solid is not Solid.SPHERE
        or radius is None
        or item.roll == "none"
    ):
        return np.zeros(2)
    if item.roll == "natural":
        vx, vy = item.velocity
        return np.array([vy, -vx]) / radius
    return np.radians(np.array(item.roll, np.float64))


def _path(item: Object, center: Array, scene: Scene) -> Array:
    """Return the path (K, 4): s, x px, y px, rad. Raise InputError unless it starts at
    the shape.
    """
    path = np.array(
        [(w.time, *w.position, radians(w.angle)) for w in item.path], np.float64
    ).reshape(-1, 4)
    if len(path):
        offset = path[0, 1:3] - center
        if np.hypot(*offset) > 0.5 or path[0, 3] != 0:
            (x, y), key = center, f"objects.{item.name}.motion.path"
            raise Message.KNOT_ELSEWHERE.error_at(
                scene.place(key), key, "the first knot", x=x, y=y, time=path[0, 0]
            )
        # The first knot is rounded in the file: shift the whole path so that it begins
        # exactly at the shape.
        path[:, 1:3] -= offset
    if item.loop:
        return _repeat_path(path, scene)
    return path


def _repeat_path(path: Array, scene: Scene) -> Array:
    """Return a path (K, 4) that repeats until the end of the clip. Raise InputError for
    too many knots.
    """
    period = path[-1, 0]
    turn = path[-1, 3] - path[0, 3]
    rounds = int(np.ceil(scene.world.duration / period)) + 1
    if rounds * len(path) > Limit.STEPS.most / 1000:
        raise Limit.STEPS.error(scene.place("objects"), "objects", f"{rounds:,} rounds")
    shift = np.array([period, 0.0, 0.0, turn])
    return np.concatenate([path, *(path[1:] + k * shift for k in range(1, rounds))])
