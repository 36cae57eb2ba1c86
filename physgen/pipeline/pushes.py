"""Pushes: the one that perception writes, and the shorthands --push, --drop and
--kick.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import cos, hypot, radians, sin, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from physgen.geometry.convex import outline_shape
from physgen.geometry.polygon import bounds
from physgen.geometry.scale import push_speed
from physgen.messages import Message, one_of
from physgen.pipeline.push_outcomes import NO_MOTION, Outcome
from physgen.pipeline.push_trials import choose_push, choose_speed, compile_trials
from physgen.problems import collect
from physgen.scene.files import equal
from physgen.scene.provenance import meters
from physgen.scene.scene import ADD_OBJECT, Motion, Object, Scene, View
from physgen.text import nearest, quantity, quoted

if TYPE_CHECKING:
    from physgen.compile.compile import CompiledScene
    from physgen.compile.shapes import Shapes
    from physgen.compile.world import Body


WRITTEN = 0.01
"""Relative tolerance of a speed with three digits."""
WORDS = {"right": (1, 0), "left": (-1, 0), "up": (0, -1), "down": (0, 1)}
"""Directions in image axes; two of them are joined by a hyphen: up-right."""
_WORD = "(right|left|up|down)(?:wards?)?"
_SPELLING = re.compile(f"(?:to the )?{_WORD}(?:[-_+ ]?(?:and )?(?:to the )?{_WORD})?")
"""Spellings of a direction in lower case: down-right, downright, up_left."""
NEAR = 0.05
"""Share of the picture's longer side by which a kick may miss an object, and by which
parts of one object may lie apart.
"""
LARGEST = 1e9
"""Largest number in a shorthand."""


@dataclass(frozen=True)
class Push:
    """A velocity at the start of a scene's motion."""

    name: str
    velocity: tuple[float, float]  # px/s
    way: str  # the direction in words, as in a shorthand: up-right
    outcome: Outcome = NO_MOTION
    ramp: float | None = None
    """Time, s, within which the object reached its velocity; 0: at once, since no
    longer time was as good; None: to be tried.
    """
    spin: float = 0.0
    """Angular velocity of an object that is tipped, degrees/s."""

    @property
    def phrase(self) -> str:
        """Return the direction as a phrase: to the right, up and left."""
        vertical, _, horizontal = self.way.rpartition("-")
        if vertical:
            return f"{vertical} and {horizontal}"
        if self.way in ("right", "left"):
            return f"to the {self.way}"
        return self.way


def default_push(
    scene: Scene,
    shapes: Shapes,
    confidence: Mapping[str, float],
    unseen: Collection[str] = (),
    facing: Mapping[str, str] | None = None,
    barred_sides: Mapping[str, str] | None = None,
    ramp: float | None = None,
    round_ends: Collection[tuple[str, str]] = (),
) -> Push | None:
    """Return the push of a short story inside the picture.

    None if no push moves an object. In the side view a push goes left or right, in the
    top view towards other objects. `confidence` are confidences of objects by name.
    `unseen` are walls outside the photo: a rebound from them would look like a rebound
    from empty space. `facing` are the sides to which vehicles drive, and `barred_sides` the
    sides to which objects are not pushed. `ramp`: given time of the push, s.
    `round_ends` are objects with a round foot, and the side over which they never tip.
    """
    trials = compile_trials(scene, shapes, unseen, barred_sides or {}, ramp, round_ends)
    best_trial = choose_push(trials, confidence, facing or {})
    if best_trial is None:
        return None
    x, y = best_trial.direction
    # A push at the top of an object lifts its centre, but goes to a side.
    way = direction_words((x, 0.0) if best_trial.spin else (x, y))
    return Push(
        best_trial.item.name,
        best_trial.velocity,
        way,
        best_trial.outcome,
        best_trial.ramp,
        best_trial.spin,
    )


def direction_words(velocity: tuple[float, float]) -> str:
    """Return the direction of a velocity in words, as in a shorthand: right,
    up-left.
    """
    length = hypot(*velocity) or 1.0
    # Eight sectors of 45 degrees: a word counts if its axis is less than 67.5 degrees
    # away.
    smallest_cosine = sin(radians(22.5))
    words = []
    for word, (x, y) in WORDS.items():
        if (velocity[0] * x + velocity[1] * y) / length > smallest_cosine:
            words.append(word)
    return "-".join(reversed(words))


# Shorthands of the command line


def motion_edits(
    scene: Scene,
    compiled_scene: CompiledScene,
    pushes: Sequence[str],
    drops: Sequence[str],
    kicks: Sequence[str],
) -> dict[str, Any]:
    """Return the dotted keys and values of shorthands for a motion.

    `pushes` are `NAME=DIRECTION[@SPEED]`, `drops` names, `kicks` `X,Y[@SPEED]`. They
    replace the push of perception. Raises InputError with all problems.
    """
    motions = collect(
        [
            *(partial(_push, scene, compiled_scene.shapes, text) for text in pushes),
            *(partial(_drop, scene, compiled_scene, name) for name in drops),
            *(partial(_kick, scene, compiled_scene, text) for text in kicks),
        ]
    )
    edits: dict[str, Any] = {}
    forces = [*scene.document["forces"]]
    for item, values in motions:
        # Forces are one list of the scene: several shorthands add to it, while other
        # keys belong to one object each.
        forces += values.pop("forces", [])
        if item.motion is not Motion.DYNAMIC:
            edits[f"objects.{item.name}.motion"] = "dynamic"
        edits |= values
        # A dropped object falls straight down, unless another shorthand pushes it.
        if f"objects.{item.name}.place" in values and any(item.velocity):
            edits.setdefault(f"objects.{item.name}.velocity", [0, 0])
    if kicks:
        edits["forces"] = forces
    if edits:
        _stop_perceived_pushes(scene, edits)
    return edits


def _stop_perceived_pushes(scene: Scene, edits: dict[str, Any]) -> None:
    """Add edits that stop the objects with a push of perception, unless they have
    edits.
    """
    for name in perceived_pushes(scene):
        edits.setdefault(f"objects.{name}.velocity", [0, 0])
        if "spin" in scene.document["objects"][name]:
            edits.setdefault(f"objects.{name}.spin", 0)


def perceived_pushes(scene: Scene) -> Iterator[str]:
    """Yield the names of objects that still have perception's velocity.

    The scale may have changed since. A velocity counts if it is as recorded, or as
    rewritten with the scale: by Froude's law, a speed in m/s grows with the square root
    of the lengths in metres.
    """
    scale = scene.world.pixels_per_meter
    speed_factor = sqrt((scene.record.scale or scale) / scale)
    for item in scene.objects:
        recorded_velocity = scene.record.entry(
            item.name, scene.document["objects"][item.name]
        ).get("velocity")
        if isinstance(recorded_velocity, list):
            speed = []
            for part in recorded_velocity:
                speed.append(quantity(str(part), "px/s", scale) or 0.0)
        else:
            speed = []
        # The file may hold the recorded velocity or the one for the new scale.
        possible_velocities = []
        for factor in (1, speed_factor):
            possible_velocities.append([factor * part for part in speed])
        if any(speed) and any(
            equal(item.velocity, possible_velocity, WRITTEN * hypot(*possible_velocity))
            for possible_velocity in possible_velocities
        ):
            yield item.name


def named_pushes(
    scene: Scene, shapes: Shapes, pushes: Sequence[str]
) -> list[tuple[Object, tuple[float, float]]]:
    """Return the objects of pushes `NAME=DIRECTION[@SPEED]` and their velocities, px/s.

    Raises InputError with all problems.
    """
    return collect(
        [partial(_object_and_velocity, scene, shapes, text) for text in pushes]
    )


def _push(scene: Scene, shapes: Shapes, text: str) -> tuple[Object, dict[str, Any]]:
    """Return the object of NAME=DIRECTION[@SPEED], and its velocity by dotted key."""
    item, velocity = _object_and_velocity(scene, shapes, text)
    per_meter = scene.world.pixels_per_meter
    is_metric = _metric(text.partition("=")[2])
    written_velocity = []
    for part in velocity:
        written_velocity.append(
            meters(part / per_meter) if is_metric else round(part, 1) + 0.0
        )
    return item, {f"objects.{item.name}.velocity": written_velocity}


def _object_and_velocity(
    scene: Scene, shapes: Shapes, text: str
) -> tuple[Object, tuple[float, float]]:
    """Return the object of NAME=DIRECTION[@SPEED] and its velocity, px/s."""
    name, _, rest = text.partition("=")
    # Users confuse the order of direction and name: tell them.
    if _is_way(name) and any(item.name == rest.strip() for item in scene.objects):
        raise Message.DIRECTION_FIRST.error(
            "--push", quoted(text), name=rest.strip(), direction=name.strip()
        )
    if not rest:
        _refuse_other_signs(scene, text)
    item = find_object(scene, "--push", name.strip())
    way, speed = _direction_and_speed(scene, "--push", rest)
    if not way:
        raise Message.NO_DIRECTION.error("--push", f'"{text}"', name=item.name)
    x, y = _direction("--push", way)
    if "@" not in rest:
        speed = _gentle_speed(scene, shapes, item, (x, y)) or speed
    return item, (speed * x, speed * y)


def _gentle_speed(
    scene: Scene, shapes: Shapes, item: Object, direction: tuple[float, float]
) -> float | None:
    """Return the speed, px/s, that perception would choose for this push.

    None if no push in this direction moves an object.
    """
    # Choose the speed for this push alone, in a scene at rest.
    others = [replace(other, velocity=(0.0, 0.0)) for other in scene.objects]
    released_objects = []
    for other in others:
        released_objects.append(
            replace(other, motion=Motion.DYNAMIC) if other.name == item.name else other
        )
    at_rest = replace(scene, objects=tuple(released_objects))
    trials = compile_trials(at_rest, shapes)
    facing = {}
    for other in at_rest.objects:
        if other.facing:
            facing[other.name] = other.facing.value
    return choose_speed(trials, item, direction, facing)


def _refuse_other_signs(scene: Scene, text: str) -> None:
    """Raise InputError if another sign than = is between an object and a direction."""
    for item in scene.objects:
        rest = text.removeprefix(item.name).lstrip(" :,")
        if text.startswith(item.name) and _is_way(rest.partition("@")[0]):
            raise Message.PUSH_WITHOUT_SIGN.error(
                "--push", quoted(text), name=item.name, rest=rest
            )


def _drop(
    scene: Scene, compiled_scene: CompiledScene, name: str
) -> tuple[Object, dict[str, Any]]:
    """Return the object of that name, and its place above its support by dotted key."""
    item = find_object(scene, "--drop", name.strip())
    if scene.world.view is View.TOP:
        raise Message.CANNOT_FALL.error("--drop", f'"{name}"', name=item.name)
    return item, {f"objects.{item.name}.place": _lift(scene, compiled_scene, item)}


def find_object(scene: Scene, flag: str, name: str) -> Object:
    """Return the object of that name. Raises InputError."""
    for item in scene.objects:
        if item.name == name:
            return item
    names = [item.name for item in scene.objects]
    if names:
        fix = one_of(name, names)
    else:
        fix = ADD_OBJECT
    raise Message.PUSHED_NAME_UNKNOWN.error(flag, f'"{name}"', fix=fix)


def _direction_and_speed(scene: Scene, flag: str, text: str) -> tuple[str, float]:
    """Split a text at @ into a direction and a speed, px/s.

    Without a speed, it is that of an ordinary push. Raises InputError.
    """
    way, sign, rest = (part.strip() for part in text.partition("@"))
    if not sign:
        return way, push_speed(max(scene.size), scene.world.pixels_per_meter)
    speed_in_pixels = quantity(rest, "px/s", scene.world.pixels_per_meter)
    try:
        return way, finite(rest if speed_in_pixels is None else repr(speed_in_pixels))
    except ValueError:
        raise Message.NOT_A_SPEED.error(flag, f'"{rest}"') from None


def _metric(text: str) -> bool:
    """Check whether a push is written in metres per second.

    True for a speed after @ in units like cm/s, and for a push without a speed, since
    perception writes m/s.
    """
    _, sign, speed = text.partition("@")
    return not sign or ("px" not in speed and quantity(speed, "m/s", 1.0) is not None)


def finite(text: str) -> float:
    """Convert a text to a number of a moderate size. Raises ValueError."""
    number = float(text)
    if not abs(number) <= LARGEST:
        raise ValueError
    return number


def _direction(flag: str, text: str) -> tuple[float, float]:
    """Return the unit vector of a word or an angle in degrees. Raises InputError."""
    spelling = _spelling(text)
    if spelling is not None:
        words = []
        for word in spelling.groups():
            if word:
                words.append(word)
        # Two words add to a diagonal; contrary words cancel each other.
        x = sum(WORDS[word][0] for word in words)
        y = sum(WORDS[word][1] for word in words)
        if x or y:
            return x / hypot(x, y), y / hypot(x, y)
    try:
        angle = radians(finite(re.sub(r"\s*(deg|degrees|°)$", "", text)))
    except ValueError:
        fix = _direction_advice(text, is_contrary=spelling is not None)
        raise Message.NOT_A_DIRECTION.error(flag, quoted(text), fix=fix) from None
    return cos(angle), sin(angle)


def _direction_advice(text: str, *, is_contrary: bool) -> str:
    """Return the fix of a wrong direction; contrary words are right and left."""
    # Choose the most specific advice: a typing error, a speed without direction, a
    # missing @.
    way, _, speed = text.replace(",", " ").partition(" ")
    if _is_way(way) and quantity(speed, "px/s", 1.0) is not None:
        return f"write {way}@{speed.strip()}"
    if quantity(text, "px/s", 1.0) is not None:
        return f"write the direction first, e.g. right@{text}"
    suggestion = None
    if not is_contrary:
        suggestion = nearest(text.lower(), _way_names())
    if suggestion is not None:
        return f"did you mean {suggestion}?"
    return "write right, left, up, down, up-right ... or degrees, 0 to the right and 90 down"


def _spelling(text: str) -> re.Match[str] | None:
    """Return the match of one or two direction words; None if there are others."""
    return _SPELLING.fullmatch(" ".join(text.lower().split()))


def _is_way(text: str) -> bool:
    """Return whether a text is a direction in words."""
    return _spelling(text) is not None


def _way_names() -> list[str]:
    """Return all words for directions."""
    diagonals = []
    for y in ("up", "down"):
        for x in ("right", "left"):
            diagonals.append(f"{y}-{x}")
    return [*WORDS, *diagonals]


def _lift(scene: Scene, compiled_scene: CompiledScene, item: Object) -> list[float]:
    """Return `place` of an object, lifted by its own height, or up to the object above
    it.
    """
    boxes = list(map(bounds, compiled_scene.outlines))
    k = scene.objects.index(item)
    # Objects that share columns with this one are in its way up.
    left, top, right, bottom = boxes[k]
    lower_edges = []
    for n, box in enumerate(boxes):
        if n != k and box[0] < right and box[2] > left:
            lower_edges.append(box[3])
    # An object above limits the height, if it spans the same columns.
    free_height = top - max([0.0, *(y for y in lower_edges if y <= top + 1)])
    x, y = compiled_scene.world.bodies[k].center
    if item.place:
        angle = item.place[2]
    else:
        angle = 0.0
    lift = max(0.0, min(bottom - top, free_height))
    return [round(float(x), 2), round(float(y - lift), 2), *([angle] if angle else [])]


def _kick(
    scene: Scene, compiled_scene: CompiledScene, text: str
) -> tuple[Object, dict[str, Any]]:
    """Return the object at or near a point, and an impulse there by dotted key.

    The impulse leads away from the point; in the side view it is level.
    """
    point_text, speed = _direction_and_speed(scene, "--kick", text)
    point, written_point = _read_point(scene, point_text)
    if not scene.objects:
        raise Message.KICK_WITHOUT_OBJECTS.error("--kick", f'"{point_text}"')
    k = _find_kicked_object(scene, compiled_scene, point, point_text)
    body = compiled_scene.world.bodies[k]
    direction = _kick_direction(scene, body, point)
    impulse: list[Any] = []
    for part in direction:
        impulse.append(float(f"{body.mass * speed * part:.4g}") + 0.0)
    # A value in metres stays in metres, since the scale may change.
    if _metric(text):
        per_meter = scene.world.pixels_per_meter
        impulse = [f"{part / per_meter:.4g} g m/s" if part else 0 for part in impulse]
    force = {"object": body.name, "impulse": impulse, "at": written_point}
    return scene.objects[k], {"forces": [force]}


def _read_point(
    scene: Scene, text: str
) -> tuple[NDArray[np.float64], list[float | str]]:
    """Return a point X,Y in px, and its coordinates for the scene file.

    Lengths with a unit stay as written. Raises InputError.
    """
    parts = text.split(",")
    coordinates: list[float] = []
    written_point: list[float | str] = []
    try:
        for part in parts:
            # A number without a unit is already in px, and is no quantity.
            px = quantity(part, "px", scene.world.pixels_per_meter)
            number = finite(part if px is None else repr(px))
            coordinates.append(number)
            if px is not None:
                # A length with a unit follows a corrected scale, one in px does not.
                written_point.append(part.strip())
            else:
                written_point.append(int(number) if number.is_integer() else number)
        x, y = coordinates
    except ValueError:
        raise Message.NOT_TWO_LENGTHS.error("--kick", f'"{text}"') from None
    return np.array([x, y]), written_point


def _find_kicked_object(
    scene: Scene,
    compiled_scene: CompiledScene,
    point: NDArray[np.float64],
    point_text: str,
) -> int:
    """Return the index of the object at or near a point. Raises InputError.

    The label map decides inside a mask; beside all masks, the nearest outline counts.
    """
    x, y = point.tolist()
    width, height = scene.size
    # A point beside the picture belongs to the nearest pixel.
    row = int(np.clip(y, 0, height - 1))
    column = int(np.clip(x, 0, width - 1))
    label = int(compiled_scene.labels[row, column])
    if label:
        return label - 1
    shortest_lines = []
    for outline in compiled_scene.outlines:
        shape = outline_shape(outline)
        shortest_lines.append(shapely.shortest_line(shape, shapely.Point(x, y)))
    k = int(np.nanargmin(shapely.length(shortest_lines)))
    if shortest_lines[k].length > NEAR * max(scene.size):
        nearest_point = ",".join(
            str(round(part)) for part in shortest_lines[k].coords[0]
        )
        raise Message.KICK_MISSES.error(
            "--kick", f'"{point_text}"', name=scene.objects[k].name, point=nearest_point
        )
    return k


def _kick_direction(
    scene: Scene, body: Body, point: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the unit vector (2,) of a kick at a point of a body."""
    direction = body.center - point
    # A kick at the centre has no direction of its own: it goes to the right.
    if scene.world.view is View.SIDE or hypot(*direction) < 1:
        direction = np.array([1.0 if direction[0] >= 0 else -1.0, 0.0])
    return np.asarray(direction / hypot(*direction), np.float64)
