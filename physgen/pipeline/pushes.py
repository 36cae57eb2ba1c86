"""What sets a scene in motion: the push that perception writes, and the shorthands --push, --drop and --kick."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import cos, hypot, radians, sin, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import cross
from physgen.geometry.scale import push_speed
from physgen.problems import InputError, collect
from physgen.scene.files import equal
from physgen.scene.provenance import meters
from physgen.scene.scene import ADD_OBJECT, Motion, Object, Scene, View
from physgen.text import listed, nearest, quantity, quoted

if TYPE_CHECKING:
    from physgen.compile.compile import Compiled
    from physgen.compile.shapes import Shapes
    from physgen.compile.world import Body
    from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Trial:
    """How candidates for a push are ranked and tried; lengths are parts of the photo's longer side."""

    room: float = 0.3  # free way ahead that counts in full
    beyond: float = (
        0.1  # weight of the room behind the last object ahead, where that one may fall
    )
    ahead: float = (
        1.5  # weight of objects ahead, against that of a free way: something is struck
    )
    unsure: float = 0.33  # confidence below which an object is not pushed, as one that is asked to be checked
    tried: int = 3  # candidates that show something, after which no more are simulated
    most: int = 8  # candidates that are simulated, at up to a second each
    loaded: float = (
        0.5  # of the rank of what carries something, seen from the side: it is jammed
    )
    enough: float = (
        0.85  # of the most that a candidate shows, that the first one needs to be taken
    )
    samples: int = 16  # times at which positions are compared
    longest: float = 6.0
    """s of a trial at most, in which a push crosses a photo that shows 100 m; a scale
    that is wrong by powers of ten would take minutes of work."""
    far: float = 0.25  # a displacement that counts in full
    least: float = 0.07  # a displacement that is seen: 36 px of a photo of 512
    written: float = (
        0.01  # of a speed, by which one that is written with three digits may differ
    )
    wild: float = 2.5  # times the speeds of the push and of a fall over the photo: faster is an explosion
    slender: float = (
        1.5  # times width over height: of the speed, for what topples before it slides
    )
    gentlest: float = 0.3  # of the speed, at least, unless it tips at less
    thin: float = 0.5  # of the speed: what topples at less is tipped as by a finger, without a slide,
    tips: float = 1.25  # at so many times the speed that tips it
    back: float = 0.25  # of what is shown, where the object goes back instead: something stands in its way
    thrown: float = 0.25  # of its momentum, that a wall which the photo does not show takes from an object
    harder: tuple[float, ...] = (1.0, 1.5, 2.5)
    """Times the ordinary speed, tried in turn until something moves as far as counts in full, or many do, and,
    seen from above, until no tenth more is shown: a rack wants a break."""
    worth: float = 1.1
    many: float = 3.0
    """What is shown by a far motion of one object, and all still in the picture; many short ones are as much."""


TRIAL = _Trial()
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
    sure: Mapping[str, float],
    unseen: Collection[str] = (),
) -> Push | None:
    """The push that shows most; None where none moves anything.

    Seen from the side it goes left or right, from above towards the nearest object or the middle of all. Candidates are
    ranked by what lies ahead, and the best are simulated. `sure` are confidences of objects by name; `unseen` are walls
    that the photo does not show: an object that one of them throws back would bounce off nothing.
    """
    from physgen.compile.compile import compile_shapes

    side = max(scene.size)
    ordinary = push_speed(side, scene.world.pixels_per_meter)
    bodies = compile_shapes(scene, shapes).world.bodies
    ranked = _ranked(scene, bodies, sure)
    named, gravity = {body.name: body for body in bodies}, hypot(*scene.world.gravity)
    best, most, farthest = None, 0.0, 0.0
    above = scene.world.view is View.TOP
    for factor in TRIAL.harder[: 3 if above else 2]:
        speed = float(f"{ordinary * factor:.2g}")
        tried: list[tuple[float, float, Push]] = []
        for item, way in ranked[: TRIAL.most]:
            part = _gentle(named[item.name], gravity, speed)
            velocity = (round(part * way[0]), round(part * way[1]))
            shown, far = shown_by(scene, shapes, item, velocity, unseen)
            tried += (
                [(shown, far, Push(item.name, velocity, _words(way)))] if shown else []
            )
            if len(tried) == TRIAL.tried:
                break
        now = max((shown for shown, *_ in tried), default=0.0)
        more = now > TRIAL.worth * most
        if more:
            _, farthest, best = next(
                one for one in tried if one[0] >= TRIAL.enough * now
            )
            most = now
        if (farthest >= TRIAL.far or most >= TRIAL.many) and not (more and above):
            break
    return best


def _gentle(body: Body, gravity: float, speed: float) -> float:
    """px/s, at most `speed`: what tips its centre of mass over its lower corner once its foot has stopped it."""
    if body.radius is not None or not gravity:
        return speed
    (x0, y0), (x1, y) = (
        of(np.concatenate(body.rings), axis=0).tolist() for of in (np.min, np.max)
    )
    rise, topples = hypot((x1 - x0) / 2, y) - y, TRIAL.slender * (x1 - x0) / (y - y0)
    tips = sqrt(2 * gravity * rise * (body.moment / body.mass + (rise + y) ** 2)) / y
    eased: float = speed * min(max(topples, TRIAL.gentlest), 1.0)
    return min(eased, TRIAL.tips * tips) if topples < TRIAL.thin else eased


def _ranked(
    scene: Scene, bodies: Sequence[Body], sure: Mapping[str, float]
) -> list[tuple[Object, tuple[float, float]]]:
    """Objects and unit directions in which to push them, the most promising first."""
    found: list[tuple[float, int, Object, tuple[float, float]]] = []
    side = max(scene.size)
    corners = [np.concatenate(body.rings) + body.center for body in bodies]
    ends = [(*points.min(axis=0), *points.max(axis=0)) for points in corners]
    left, top, right, foot = np.array(ends).reshape(-1, 4).T
    for k, item in enumerate(scene.objects):
        if item.motion is not Motion.DYNAMIC or sure.get(item.name, 1.0) < TRIAL.unsure:
            continue
        on = (
            (np.abs(foot - top[k]) < 2 + 0.1 * (foot - top)[k])
            & (left < right[k])
            & (right > left[k])
        )
        load = TRIAL.loaded if scene.world.view is View.SIDE and on.any() else 1.0
        for way in _ways(scene, [body.center for body in bodies], k):
            frame = np.array([way, (-way[1], way[0])])
            low, high = (
                np.array([of(points @ frame.T, axis=0) for points in corners])
                for of in (np.min, np.max)
            )
            beside = (np.minimum(high, high[k]) - np.maximum(low, low[k]))[
                :, 1
            ] > 0.1 * (high - low)[:, 1]
            ahead = [
                n
                for n in np.flatnonzero(beside & (low[:, 0] > high[k, 0] - 2)).tolist()
                if n != k
            ]
            end = max(np.array([[0, 0], scene.size]) @ frame[0])
            gaps = (
                end - bodies[k].center @ frame[0],
                *(low[n, 0] - high[k, 0] for n in ahead),
            )
            free, beyond = np.clip(
                np.array([min(gaps), end - max(high[n, 0] for n in (k, *ahead))])
                / (TRIAL.room * side),
                0,
                1,
            )
            score = free + TRIAL.beyond * beyond + TRIAL.ahead * (1 - 0.5 ** len(ahead))
            found.append(
                (score * load * sure.get(item.name, 1.0), -len(found), item, way)
            )
    return [
        (item, way)
        for _, _, item, way in sorted(found, key=lambda one: one[:2], reverse=True)
    ]


def _ways(scene: Scene, centers: Sequence[Array], k: int) -> list[tuple[float, float]]:
    """Unit directions in which an object may be pushed."""
    if scene.world.view is View.SIDE:
        return [(1.0, 0.0), (-1.0, 0.0)]
    others = [center for n, center in enumerate(centers) if n != k] or [
        (np.array(scene.size) - 1) / 2
    ]
    nearest_one = min(
        others, key=lambda center: float(np.hypot(*(center - centers[k])))
    )
    ways = []
    for goal in (nearest_one, np.mean(others, axis=0)):
        x, y = (float(part) for part in goal - centers[k])
        ways.append(
            (x / hypot(x, y), y / hypot(x, y)) if hypot(x, y) > 1 else (1.0, 0.0)
        )
    return ways


def shown_by(
    scene: Scene,
    shapes: Shapes,
    item: Object,
    velocity: tuple[float, float],
    unseen: Collection[str] = (),
) -> tuple[float, float]:
    """How much a push shows, counted in objects that move far, and the longest displacement, as a part of the photo's
    longer side; zeros where it moves nothing enough, or all explodes."""
    from physgen.compile.compile import compile_shapes
    from physgen.simulate.engine import simulate

    pushed = tuple(
        replace(one, velocity=velocity) if one is item else one for one in scene.objects
    )
    compiled = compile_shapes(replace(scene, objects=pushed), shapes)
    side, k = max(scene.size), scene.objects.index(item)
    ordinary = push_speed(side, scene.world.pixels_per_meter)
    slow = np.clip(TRIAL.gentlest * ordinary / max(hypot(*velocity), 1.0), 1, 2)
    end = min(slow * side / ordinary, TRIAL.longest)
    times = np.linspace(0, end, TRIAL.samples)
    motion = simulate(compiled.world, times)
    poses = motion.poses[..., :2]
    inside: NDArray[np.bool_] = np.all((poses >= 0) & (poses < scene.size), axis=-1)
    away = (
        np.where(inside, np.hypot(*np.moveaxis(poses - poses[:1], -1, 0)), 0).max(
            axis=0
        )
        / side
    )
    fastest = (
        float(np.hypot(*np.moveaxis(np.diff(poses, axis=0), -1, 0)).max(initial=0.0))
        / times[1]
    )
    fall = (2 * hypot(*scene.world.gravity) * side) ** 0.5
    gone = (poses - poses[:1])[:, k] @ np.array(velocity)
    if away.max(initial=0.0) < TRIAL.least or fastest > TRIAL.wild * (
        hypot(*velocity) + fall
    ):
        return 0.0, 0.0
    shown = float(np.minimum(away / TRIAL.far, 1.0).sum() + inside.mean())
    taken = (
        _taken(motion, k, np.array(velocity), unseen) / compiled.world.bodies[k].mass
    )
    back = -gone.min() > gone.max() or taken > TRIAL.thrown
    return shown * (TRIAL.back if back else 1.0), float(away.max())


def _taken(
    motion: Trajectory, k: int, velocity: Array, unseen: Collection[str]
) -> float:
    """The mass, g, whose momentum at this velocity the walls `unseen` take from an object; friction counts for none."""
    _, first, second = motion.contacts.impulse_rows.T
    walls = np.isin(motion.contacts.surfaces, list(unseen))
    walls[: len(motion.names)] = False  # objects
    hit = motion.contacts.impulses[(first == k) & walls[second]]
    back, aside = -hit @ velocity, np.abs(cross(velocity, hit))
    return float((back * (back > aside)).sum() / (velocity @ velocity))


def _words(way: tuple[float, float]) -> str:
    words = [
        word
        for word, (x, y) in WORDS.items()
        if way[0] * x + way[1] * y > sin(radians(22.5))
    ]
    return "-".join(reversed(words))


# Shorthands of the command line


def motion_edits(
    scene: Scene,
    compiled: Compiled,
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
            *(partial(_push, scene, text) for text in pushes),
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
            equal(item.velocity, way, TRIAL.written * hypot(*way)) for way in ways
        ):
            yield item.name


def _push(scene: Scene, text: str) -> tuple[Object, dict[str, Any]]:
    """The object of NAME=DIRECTION[@SPEED], and its velocity, by dotted key."""
    name, _, rest = text.partition("=")
    if _is_way(name) and any(item.name == rest.strip() for item in scene.objects):
        fix = f"write --push {rest.strip()}={name.strip()}"
        raise InputError.of("--push", quoted(text), "has the direction first", fix)
    if not rest:
        _refuse_other_signs(scene, text)
    item = named(scene, "--push", name.strip())
    way, speed = _direction_and_speed(scene, "--push", rest)
    if not way:
        fix = f"write --push {item.name}=right"
        raise InputError.of("--push", f'"{text}"', "lacks a direction", fix)
    per_meter = scene.world.pixels_per_meter
    parts = [speed * part for part in _direction("--push", way)]
    kept = [
        meters(part / per_meter) if _metric(rest) else round(part, 1) + 0.0
        for part in parts
    ]
    return item, {f"objects.{item.name}.velocity": kept}


def _refuse_other_signs(scene: Scene, text: str) -> None:
    """Raise InputError if another sign stands between an object and a direction."""
    for item in scene.objects:
        rest = text.removeprefix(item.name).lstrip(" :,")
        if text.startswith(item.name) and _is_way(rest.partition("@")[0]):
            fix = f"write --push {item.name}={rest}"
            raise InputError.of("--push", quoted(text), "lacks a =", fix)


def _drop(scene: Scene, compiled: Compiled, name: str) -> tuple[Object, dict[str, Any]]:
    """The object of that name, and the place from which it falls, by dotted key."""
    item = named(scene, "--drop", name.strip())
    if scene.world.view is View.TOP:
        fix = f"write --push {item.name}=right"
        raise InputError.of(
            "--drop", f'"{name}"', "cannot fall: the photo is seen from above", fix
        )
    return item, {f"objects.{item.name}.place": _lifted(scene, compiled, item)}


def named(scene: Scene, flag: str, name: str) -> Object:
    """The object of that name. Raises InputError."""
    for item in scene.objects:
        if item.name == name:
            return item
    names = [item.name for item in scene.objects]
    close = nearest(name, names)
    fix = (
        f"did you mean {close}?"
        if close
        else f"write one of {listed(names[:20])}"
        if names
        else ADD_OBJECT
    )
    raise InputError.of(flag, f'"{name}"', "names no object", fix)


def _direction_and_speed(scene: Scene, flag: str, text: str) -> tuple[str, float]:
    """A text before @, and the speed after it, px/s; the ordinary speed of a push without one."""
    way, sign, rest = (part.strip() for part in text.partition("@"))
    if not sign:
        return way, push_speed(max(scene.size), scene.world.pixels_per_meter)
    in_units = quantity(rest, "px/s", scene.world.pixels_per_meter)
    try:
        return way, finite(rest if in_units is None else repr(in_units))
    except ValueError:
        raise InputError.of(
            flag, f'"{rest}"', "is no speed", "write e.g. @2 m/s or @300 px/s"
        ) from None


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
        raise InputError.of(flag, quoted(text), "is no direction", fix) from None
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


def _lifted(scene: Scene, compiled: Compiled, item: Object) -> list[float]:
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


def _kick(scene: Scene, compiled: Compiled, text: str) -> tuple[Object, dict[str, Any]]:
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
        fix = "write e.g. 120,80 or 6 cm,4 cm"
        raise InputError.of("--kick", f'"{where}"', "is not two lengths", fix) from None
    if not scene.objects:
        raise InputError.of(
            "--kick", f'"{where}"', "meets no object: the scene has none", ADD_OBJECT
        )
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
        fix = (
            f"name a point of an object; the nearest: {near} of {scene.objects[k].name}"
        )
        raise InputError.of("--kick", f'"{where}"', "meets no object", fix)
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
