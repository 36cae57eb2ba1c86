"""What sets a scene in motion: the push that perception writes, and the shorthands --push, --drop and --kick."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import cos, hypot, radians, sin, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from physgen.geometry.scale import push_speed
from physgen.messages import Message, one_of
from physgen.pipeline.push_trials import (
    NO_MOTION,
    Outcome,
    choose_push,
    choose_speed,
    compile_trials,
)
from physgen.problems import collect
from physgen.scene.files import equal
from physgen.scene.provenance import meters
from physgen.scene.scene import ADD_OBJECT, Motion, Object, Scene, View
from physgen.text import nearest, quantity, quoted

if TYPE_CHECKING:
    from physgen.compile.compile import CompiledScene
    from physgen.compile.shapes import Shapes


WRITTEN = 0.01
"""Of a speed, by which one that is written with three digits may differ."""
WORDS = {"right": (1, 0), "left": (-1, 0), "up": (0, -1), "down": (0, 1)}
"""Directions in image axes; two of them are joined by a hyphen: up-right."""
_WORD = "(right|left|up|down)(?:wards?)?"
_SPELLING = re.compile(f"(?:to the )?{_WORD}(?:[-_+ ]?(?:and )?(?:to the )?{_WORD})?")
"""Spellings of a direction in lower case: down-right, downright, up_left."""
NEAR = 0.05
"""Of the picture's longer side, by which a kick may miss an object, and objects that are one be apart."""
LARGEST = 1e9
"""Of the numbers of a shorthand."""


@dataclass(frozen=True)
class Push:
    """A velocity that sets a scene in motion."""

    name: str
    velocity: tuple[float, float]  # px/s
    way: str  # as a push is written: up-right
    outcome: Outcome = NO_MOTION

    @property
    def phrase(self) -> str:
        """Return the direction as a sentence has it: to the right, up and left."""
        vertical, _, horizontal = self.way.rpartition("-")
        if vertical:
            return f"{vertical} and {horizontal}"
        return f"to the {self.way}" if self.way in ("right", "left") else self.way


def default_push(
    scene: Scene,
    shapes: Shapes,
    confidence: Mapping[str, float],
    unseen: Collection[str] = (),
    facing: Mapping[str, str] | None = None,
    barred: Mapping[str, str] | None = None,
) -> Push | None:
    """Return the push that tells a short story and stays in the picture.

    None if no push moves anything. Seen from the side it goes left or right, from above
    towards other objects. `confidence` are confidences of objects by name; `unseen`
    are walls that the photo does not show: an object that one of them throws back
    would bounce off nothing. `facing` are the sides to which vehicles drive, and
    `barred` those to which objects are not pushed.
    """
    trials = compile_trials(scene, shapes, unseen, barred or {})
    chosen = choose_push(trials, confidence, facing or {})
    if chosen is None:
        return None
    way = direction_words(chosen.direction)
    return Push(chosen.item.name, chosen.velocity, way, chosen.outcome)


def direction_words(velocity: tuple[float, float]) -> str:
    """Return the direction of a velocity as a push is written: right, up-left."""
    length = hypot(*velocity) or 1.0
    least = sin(radians(22.5))
    words = [
        word
        for word, (x, y) in WORDS.items()
        if (velocity[0] * x + velocity[1] * y) / length > least
    ]
    return "-".join(reversed(words))


# Shorthands of the command line


def motion_edits(
    scene: Scene,
    compiled: CompiledScene,
    pushes: Sequence[str],
    drops: Sequence[str],
    kicks: Sequence[str],
) -> dict[str, Any]:
    """Dotted keys and values that set a scene in motion.

    `pushes` are `NAME=DIRECTION[@SPEED]`, `drops` names, `kicks` `X,Y[@SPEED]`. They take the place of the push that
    perception wrote. Raises InputError.
    """
    made = collect(
        [
            *(partial(_push, scene, compiled.shapes, text) for text in pushes),
            *(partial(_drop, scene, compiled, name) for name in drops),
            *(partial(_kick, scene, compiled, text) for text in kicks),
        ]
    )
    edits: dict[str, Any] = {}
    forces = [*scene.document["forces"]]
    for item, moved in made:
        forces += moved.pop("forces", [])
        edits |= (
            {}
            if item.motion is Motion.DYNAMIC
            else {f"objects.{item.name}.motion": "dynamic"}
        )
        edits |= moved
        if f"objects.{item.name}.place" in moved and any(item.velocity):
            edits.setdefault(
                f"objects.{item.name}.velocity", [0, 0]
            )  # it falls straight, unless pushed
    if kicks:
        edits["forces"] = forces
    for name in perceived_pushes(scene) if edits else ():
        edits.setdefault(f"objects.{name}.velocity", [0, 0])
    return edits


def perceived_pushes(scene: Scene) -> Iterator[str]:
    """Objects that have the velocity which perception wrote, at the scale of then or as it followed the scale."""
    now = scene.world.pixels_per_meter
    followed = sqrt((scene.record.scale or now) / now)
    for item in scene.objects:
        wrote = scene.record.entry(item.name, scene.document["objects"][item.name]).get(
            "velocity"
        )
        speed = (
            [quantity(str(part), "px/s", now) or 0.0 for part in wrote]
            if isinstance(wrote, list)
            else []
        )
        ways = [[factor * part for part in speed] for factor in (1, followed)]
        if any(speed) and any(
            equal(item.velocity, way, WRITTEN * hypot(*way)) for way in ways
        ):
            yield item.name


def named_pushes(
    scene: Scene, shapes: Shapes, pushes: Sequence[str]
) -> list[tuple[Object, tuple[float, float]]]:
    """Return the objects of pushes `NAME=DIRECTION[@SPEED]` and their velocities, px/s.

    Raises InputError with all that is wrong.
    """
    return collect(
        [partial(_object_and_velocity, scene, shapes, text) for text in pushes]
    )


def _push(scene: Scene, shapes: Shapes, text: str) -> tuple[Object, dict[str, Any]]:
    """The object of NAME=DIRECTION[@SPEED], and its velocity, by dotted key."""
    item, velocity = _object_and_velocity(scene, shapes, text)
    per_meter = scene.world.pixels_per_meter
    is_metric = _metric(text.partition("=")[2])
    kept = [
        meters(part / per_meter) if is_metric else round(part, 1) + 0.0
        for part in velocity
    ]
    return item, {f"objects.{item.name}.velocity": kept}


def _object_and_velocity(
    scene: Scene, shapes: Shapes, text: str
) -> tuple[Object, tuple[float, float]]:
    """Return the object of NAME=DIRECTION[@SPEED] and its velocity, px/s."""
    name, _, rest = text.partition("=")
    if _is_way(name) and any(item.name == rest.strip() for item in scene.objects):
        raise Message.DIRECTION_FIRST.error(
            "--push", quoted(text), name=rest.strip(), direction=name.strip()
        )
    if not rest:
        _refuse_other_signs(scene, text)
    item = named(scene, "--push", name.strip())
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

    None if no push in this direction moves anything.
    """
    others = [replace(one, velocity=(0.0, 0.0)) for one in scene.objects]
    freed = [
        replace(one, motion=Motion.DYNAMIC) if one.name == item.name else one
        for one in others
    ]
    at_rest = replace(scene, objects=tuple(freed))
    trials = compile_trials(at_rest, shapes)
    facing = {one.name: one.facing.value for one in at_rest.objects if one.facing}
    return choose_speed(trials, item, direction, facing)


def _refuse_other_signs(scene: Scene, text: str) -> None:
    """Raise InputError if another sign stands between an object and a direction."""
    for item in scene.objects:
        rest = text.removeprefix(item.name).lstrip(" :,")
        if text.startswith(item.name) and _is_way(rest.partition("@")[0]):
            raise Message.PUSH_WITHOUT_SIGN.error(
                "--push", quoted(text), name=item.name, rest=rest
            )


def _drop(
    scene: Scene, compiled: CompiledScene, name: str
) -> tuple[Object, dict[str, Any]]:
    """The object of that name, and the place from which it falls, by dotted key."""
    item = named(scene, "--drop", name.strip())
    if scene.world.view is View.TOP:
        raise Message.CANNOT_FALL.error("--drop", f'"{name}"', name=item.name)
    return item, {f"objects.{item.name}.place": _lifted(scene, compiled, item)}


def named(scene: Scene, flag: str, name: str) -> Object:
    """The object of that name. Raises InputError."""
    for item in scene.objects:
        if item.name == name:
            return item
    names = [item.name for item in scene.objects]
    fix = one_of(name, names) if names else ADD_OBJECT
    raise Message.PUSHED_NAME_UNKNOWN.error(flag, f'"{name}"', fix=fix)


def _direction_and_speed(scene: Scene, flag: str, text: str) -> tuple[str, float]:
    """A text before @, and the speed after it, px/s; the ordinary speed of a push without one."""
    way, sign, rest = (part.strip() for part in text.partition("@"))
    if not sign:
        return way, push_speed(max(scene.size), scene.world.pixels_per_meter)
    in_units = quantity(rest, "px/s", scene.world.pixels_per_meter)
    try:
        return way, finite(rest if in_units is None else repr(in_units))
    except ValueError:
        raise Message.NOT_A_SPEED.error(flag, f'"{rest}"') from None


def _metric(text: str) -> bool:
    """Whether the speed after @ is in cm/s, m/s or the like, or is left to us: perception writes m/s."""
    _, sign, speed = text.partition("@")
    return not sign or ("px" not in speed and quantity(speed, "m/s", 1.0) is not None)


def finite(text: str) -> float:
    """A number of a moderate size. Raises ValueError."""
    number = float(text)
    if not abs(number) <= LARGEST:
        raise ValueError
    return number


def _direction(flag: str, text: str) -> tuple[float, float]:
    """The unit vector of a word or an angle in degrees. Raises InputError."""
    spelling = _spelling(text)
    if spelling is not None:
        words = [word for word in spelling.groups() if word]
        x = sum(WORDS[word][0] for word in words)
        y = sum(WORDS[word][1] for word in words)
        if x or y:
            return x / hypot(x, y), y / hypot(x, y)
    try:
        angle = radians(finite(re.sub(r"\s*(deg|degrees|°)$", "", text)))
    except ValueError:
        is_contrary = spelling is not None
        close = None if is_contrary else nearest(text.lower(), _way_names())
        fix = "write right, left, up, down, up-right ... or degrees, 0 to the right and 90 down"
        if close is not None:
            fix = f"did you mean {close}?"
        if quantity(text, "px/s", 1.0) is not None:
            fix = f"write the direction first, e.g. right@{text}"
        way, _, speed = text.replace(",", " ").partition(" ")
        if _is_way(way) and quantity(speed, "px/s", 1.0) is not None:
            fix = f"write {way}@{speed.strip()}"
        raise Message.NOT_A_DIRECTION.error(flag, quoted(text), fix=fix) from None
    return cos(angle), sin(angle)


def _spelling(text: str) -> re.Match[str] | None:
    """Return the match of one or two direction words; None if there are others."""
    return _SPELLING.fullmatch(" ".join(text.lower().split()))


def _is_way(text: str) -> bool:
    """Return whether a text is a direction in words."""
    return _spelling(text) is not None


def _way_names() -> list[str]:
    """Return all directions that are words."""
    diagonals = [f"{y}-{x}" for y in ("up", "down") for x in ("right", "left")]
    return [*WORDS, *diagonals]


def _lifted(scene: Scene, compiled: CompiledScene, item: Object) -> list[float]:
    """`place` of an object at its own height above where it is, or as far as there is room below what is over it."""
    from physgen.geometry.polygon import bounds

    boxes = [bounds(outline) for outline in compiled.outlines]
    k = scene.objects.index(item)
    left, top, right, bottom = boxes[k]
    above = [
        box[3]
        for n, box in enumerate(boxes)
        if n != k and box[0] < right and box[2] > left
    ]
    room = top - max([0.0, *(y for y in above if y <= top + 1)])
    x, y = compiled.world.bodies[k].center
    angle = item.place[2] if item.place else 0.0
    lift = max(0.0, min(bottom - top, room))
    return [round(float(x), 2), round(float(y - lift), 2), *([angle] if angle else [])]


def _kick(
    scene: Scene, compiled: CompiledScene, text: str
) -> tuple[Object, dict[str, Any]]:
    """The object at a point, or close by, and an impulse there: away from the point, level seen from the side."""
    import shapely

    from physgen.geometry.convex import outline_shape

    where, speed = _direction_and_speed(scene, "--kick", text)
    per_meter, ends = scene.world.pixels_per_meter, where.split(",")
    in_units = [quantity(part, "px", per_meter) for part in ends]
    try:
        x, y = (
            finite(part if px is None else repr(px))
            for part, px in zip(ends, in_units, strict=True)
        )
    except ValueError:
        raise Message.NOT_TWO_LENGTHS.error("--kick", f'"{where}"') from None
    if not scene.objects:
        raise Message.KICK_WITHOUT_OBJECTS.error("--kick", f'"{where}"')
    at = np.array([x, y])
    ways = [
        shapely.shortest_line(outline_shape(one), shapely.Point(x, y))
        for one in compiled.outlines
    ]
    k = int(np.nanargmin(shapely.length(ways)))
    row, column = (
        int(np.clip(part, 0, side - 1))
        for part, side in zip((y, x), scene.size[::-1], strict=True)
    )
    if compiled.labels[row, column]:
        k = int(compiled.labels[row, column]) - 1
    elif ways[k].length > NEAR * max(scene.size):
        near = ",".join(str(round(part)) for part in ways[k].coords[0])
        raise Message.KICK_MISSES.error(
            "--kick", f'"{where}"', name=scene.objects[k].name, point=near
        )
    body = compiled.world.bodies[k]
    way = body.center - at
    if scene.world.view is View.SIDE or hypot(*way) < 1:
        way = np.array([1.0 if way[0] >= 0 else -1.0, 0.0])
    way = way / hypot(*way)
    impulse: list[Any] = [
        float(f"{body.mass * speed * part:.4g}") + 0.0 for part in way
    ]
    if _metric(text):
        impulse = [f"{part / per_meter:.4g} g m/s" if part else 0 for part in impulse]
    numbers = (int(end) if end.is_integer() else end for end in (x, y))
    kept = [
        end if px is None else part.strip()
        for end, px, part in zip(numbers, in_units, ends, strict=True)
    ]
    return scene.objects[k], {
        "forces": [{"object": body.name, "impulse": impulse, "at": kept}]
    }
