"""Problems, values and the motion of a scene's text, computed in parts while the user edits."""

from __future__ import annotations

import os
import re
import time
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path, PurePath
from threading import Lock, RLock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.compile import Compiled
from physgen.compile.world import World, appearance, photo_poses
from physgen.maps import Percepts
from physgen.messages import Message
from physgen.pipeline.cache_keys import key, motion_key
from physgen.pipeline.stages import Keep, Recent, Stages, lint, stage
from physgen.problems import InputError, Problem, as_warnings
from physgen.render.camera import exposure_times
from physgen.render.frames import render_frames
from physgen.render.stage import Stage
from physgen.report.perception import (
    doubt_text,
    doubtful_regions,
    written_suitability,
)
from physgen.report.player import figure, fixed_data, plate, shadows, sprites, touches
from physgen.scene.files import RECORD, read_record
from physgen.scene.load import Opened
from physgen.scene.provenance import Provenance, source
from physgen.scene.scene import Scene, Solid
from physgen.simulate.engine import Running
from physgen.simulate.trajectory import Trajectory

Data = dict[str, Any]

_OBJECT = re.compile(r"(?:^|\.)objects\.([\w-]+)")
SECTIONS = (
    "title",
    "world",
    "objects",
    "boundaries",
    "forces",
    "joints",
    "fields",
    "light",
    "render",
    "refine",
)


def problem_data(problem: Problem, file: str) -> Data:
    """A problem for the page: `line` is that of the text in the editor, null where it stands elsewhere.

    `object` is the one in whose entry it stands, if any.
    """
    inside = _OBJECT.search(problem.path)
    here = problem.place.file == file and problem.place.line > 0
    named = f"variant {problem.variant}: {problem.path}" if problem.variant else ""
    parts = (named, problem.found, problem.expected)
    return problem.as_dict() | {
        "file": None if here else problem.place.file,
        "line": problem.place.line if here else None,
        "column": problem.place.column if here else None,
        "message": " ".join(part for part in parts if part),
        "object": inside[1] if inside else None,
    }


def scene_data(scene: Scene) -> Data:
    """What the file means, with defaults, as a file would have it: px, s, g, degrees."""
    found: Data = {name: scene.document.get(name) for name in SECTIONS}
    found["size"] = list(scene.size)
    found["image"] = None if scene.image is None else PurePath(scene.image).name
    found["written"] = sorted(scene.places)
    return found


RING_TOLERANCE = 0.75
"""px by which the outline of a doubtful region may be off, so that the page gets few points."""


def doubtful_data(scene: Scene, percepts: Percepts | None) -> list[Data]:
    """Return the doubtful regions with their outlines, px of the photo."""
    if percepts is None:
        return []
    rows: list[Data] = []
    for region in doubtful_regions(percepts.labels, scene.document):
        rings = []
        for ring in region.rings:
            points = ring.astype(np.float32)[:, None]
            simple = cv2.approxPolyDP(points, RING_TOLERANCE, True)
            rings.append(simple[:, 0].tolist())
        text = doubt_text(region.name, region.confidence)
        rows.append({"name": region.name, "text": text, "rings": rings})
    return rows


def perceived_data(scene: Scene) -> Data | None:
    """Return the verdict on the photo and the summary of perception, if it wrote them."""
    record = read_record(scene.assets / RECORD) if scene.assets is not None else {}
    verdict = written_suitability(scene.assets)
    summary = record.get("summary")
    if not verdict:
        return None
    lines = [str(line) for line in summary] if isinstance(summary, list) else []
    return {"verdict": verdict, "summary": lines}


def derived_data(scene: Scene, compiled: Compiled) -> Data:
    """What follows from it: centres, masses and moments, as the engine has them."""
    world = compiled.world
    objects: dict[str, Data] = {}
    for item, body in zip(scene.objects, world.bodies, strict=True):
        objects[item.name] = {
            "centre": body.center.tolist(),
            "mass": body.mass,
            "moment": body.moment,
            "radius": body.radius,
            "reach": body.reach,
            "ball": body.solid is Solid.SPHERE and body.radius is not None,
            "masked": item.mask is not None,
        }
    return {
        "objects": objects,
        "pixels_per_meter": world.pixels_per_meter,
        "scaled": "world.pixels_per_meter" in scene.places,
    }


SURE = 0.6
"""Confidence from which the user is not asked."""
MAX_ROWS = 300


def todo(scene: Scene | None, problems: Sequence[Data]) -> list[Data]:
    """Rows as the page shows them: `kind`, `object`, `path`, `line`, `text`, `fix`, `ops`; None: the user decides."""
    rows = [
        _row("error", p, p["message"], p["fix"])
        for p in problems
        if p["severity"] == "error"
    ]
    if scene is not None:
        rows += [row for _, row in sorted(_unsure(scene), key=lambda doubt: doubt[0])]
    odd = (p for p in problems if p["severity"] != "error")
    rows += [_row("lint", p, p["message"], p["fix"]) for p in odd]
    return rows[:MAX_ROWS]


def doubtful_rows(scene: Scene, doubtful: Sequence[Data]) -> list[Data]:
    """Return a row for each region that may be an object, as `todo` does."""
    rows = []
    for region in doubtful:
        path = f"doubtful.{region['name']}"
        at = {"object": None, "path": path, "line": _line(scene, path)}
        text = f"{region['text']} may be an object, too"
        rows.append(_row("doubt", at, text, "to have it, click on it with Mask, Point"))
    return rows


def _row(
    kind: str,
    at: Mapping[str, Any],
    text: str,
    fix: str,
    ops: Sequence[Data] | None = None,
) -> Data:
    place = {key: at.get(key) for key in ("object", "path", "line")}
    return {"kind": kind, **place, "text": text, "fix": fix, "ops": ops}


def _unsure(scene: Scene) -> Iterator[tuple[float, Data]]:
    """Guesses about objects and boundaries that no user has confirmed, with their confidence."""
    provenance = Provenance(scene, None)
    for item in scene.objects:
        yield from _of_one(
            scene, provenance, ("objects", item.name), item.provenance, item.name
        )
    document = scene.document.get("boundaries") or {}
    for wall in scene.boundaries:
        guess = document.get(wall.name, {}).get("from")
        if isinstance(guess, str):
            yield from _of_one(
                scene, provenance, ("boundaries", wall.name), {"": guess}, None
            )
    if scene.light is not None and scene.light.provenance:
        yield from _of_one(
            scene, provenance, ("light",), {"": scene.light.provenance}, None
        )


def _of_one(
    scene: Scene,
    provenance: Provenance,
    path: Sequence[str],
    sources: Mapping[str, str],
    name: str | None,
) -> Iterator[tuple[float, Data]]:
    where = ".".join(path)
    found: list[tuple[float, str, str]] = []
    for part, guess in sources.items():
        sure = source(guess).sure
        value = f"{where}.{part}" if part else where
        if sure is None or sure >= SURE:
            continue
        if provenance.of(value, guess, written_at=f"{where}.from").kind == "guess":
            found.append(
                (
                    sure,
                    part,
                    f"{part or path[-1]} ({guess.rpartition(' ')[0]}, {sure:.0%})",
                )
            )
    found.sort()
    if found:
        least, first, _ = found[0]
        value = f"{where}.{first}" if first else where
        at = {
            "object": name,
            "path": value,
            "line": _line(scene, value) or _line(scene, where),
        }
        left = {
            key: one
            for key, one in sources.items()
            if key not in {key for _, key, _ in found}
        }
        recorded = name is not None and f"{where}.from" not in scene.places
        ops: list[Data] = [{"unset": [*path, "from"]}]
        if left or recorded:  # in the file it counts before the record
            ops = [{"set": [*path, "from"], "value": left}]
        yield (
            least,
            _row(
                "doubt",
                at,
                "; ".join(what for *_, what in found),
                "correct as it is",
                ops,
            ),
        )


def _line(scene: Scene, path: str) -> int | None:
    place = scene.places.get(path)
    return (
        place.line
        if place is not None and place.line and place.file == scene.place("").file
        else None
    )


Array = NDArray[np.float64]

SUBSAMPLES = 4
"""Samples of a frame, so that a bounce within one shows."""
MAX_SUBSAMPLED = 100_000
"""Samples times objects up to which frames have so many samples."""
MAX_PART = 200_000
"""Samples times objects of one part of a motion: about 15 MB of JSON."""
FIRST, MORE = 0.045, 0.08
"""s that a look, and a part of a motion after its first, simulate."""
SLICE = 0.03
"""s for which a motion that is simulated to its end keeps others waiting."""
MAX_MOTIONS = 6
"""Motions that are kept: of the tabs, and of before and after an undo."""
ENERGY = ("kinetic", "potential", "dissipated", "work")
COLUMNS = ("x", "y", "a", "vx", "vy", "w")


class MotionStream:
    """The motion of one world, simulated in parts as the page asks for them.

    Numbers are little-endian float64 in base64: at the frames those of `physgen simulate`. No step is simulated twice.
    """

    def __init__(self, key: str, scene: Scene, world: World) -> None:
        self.key = key
        self.scene, self.world = scene, world
        N, frames = max(len(world.bodies), 1), world.times
        finer = SUBSAMPLES if len(frames) * SUBSAMPLES * N <= MAX_SUBSAMPLED else 1
        times = frames
        if finer > 1 and len(frames) > 1:
            between = frames[:-1, None] + np.diff(frames)[:, None] * (
                np.arange(finer) / finer
            )
            times = np.unique(np.concatenate([between.ravel(), frames]))
        self._frames = np.searchsorted(times, frames)
        self._running = Running(world, times, most=0)
        self.problems: list[Problem] = []
        """Why the motion ends early."""

    @property
    def total(self) -> int:
        return len(self._running.times)

    @property
    def done(self) -> bool:
        return bool(self.problems) or self._running.done >= self.total

    def trajectory(self) -> Trajectory:
        """The motion; samples that are not simulated yet are zeros."""
        return self._running.trajectory()

    def part(self, start: int, deadline: float) -> Data:
        """Samples from `start` on, at least one; simulated until `deadline`, a time of `time.perf_counter`."""
        start = max(0, min(start, self.total))
        self.simulate(start + 1, deadline)
        run, N = self._running, max(len(self.world.bodies), 1)
        upto = max(start, min(run.done, start + max(1, MAX_PART // N)))
        known = run.trajectory()
        found: Data = {
            "key": self.key,
            "id": self.key,
            "from": start,
            "upto": upto,
            "total": self.total,
            "done": self.done and upto == run.done,
            "problems": [],
        }
        turning = known.turns.shape[1] > 0
        found["bodies"] = [
            {
                "name": body.name,
                **{
                    name: packed(known.poses[start:upto, k, c])
                    for c, name in enumerate(COLUMNS[:3])
                },
                **{
                    name: packed(known.velocities[start:upto, k, c])
                    for c, name in enumerate(COLUMNS[3:])
                },
                "q": [packed(part) for part in known.turns[start:upto, k].T]
                if turning
                else None,
            }
            for k, body in enumerate(self.world.bodies)
        ]
        found["contacts"] = found["energy"] = None
        if found["done"] and not self.problems:
            energy = known.energy
            found["energy"] = {name: packed(getattr(energy, name)) for name in ENERGY}
            found["contacts"] = {
                "surfaces": list(known.contacts.surfaces),
                "touches": touches(known),
            }
        if start == 0:
            self._begin(found)
        return found

    def simulate(self, least: int, deadline: float) -> None:
        """Simulate until the deadline, and until at least so many samples are taken."""
        run = self._running
        if self.done:
            return
        try:
            while not self.done:
                run.on(run.end, enough=partial(_late, deadline))
                if run.done >= min(least, self.total) and _late(deadline):
                    break
                deadline = max(deadline, time.perf_counter() + 0.01)
        except InputError as error:
            self.problems = error.problems

    def _begin(self, found: Data) -> None:
        """Add what only the first part has: all that does not change with time."""
        scene, world = self.scene, self.world
        for k, body in enumerate(world.bodies):
            found["bodies"][k] |= figure(scene, k, body)
        found |= fixed_data(scene, world) | {
            "times": packed(self._running.times),
            "frames": self._frames.tolist(),
            "camera": None,
        }


def _late(deadline: float) -> bool:
    return time.perf_counter() > deadline


def packed(values: Array) -> str:
    """Little-endian float64, base64.

    >>> packed(np.array([1.0]))
    'AAAAAAAA8D8='
    """
    return b64encode(np.ascontiguousarray(values, "<f8").tobytes()).decode("ascii")


@dataclass(frozen=True)
class Look:
    """A state of the text for the page. Where the text is wrong, only `problems` and `todo` are set."""

    problems: tuple[Data, ...] = ()  # errors, then lints
    scene: Data | None = None
    derived: Data | None = None
    motion: Data | None = None  # the first part of its motion; see `MotionStream`
    picture: str | None = None  # key of the picture
    todo: tuple[Data, ...] = ()
    doubtful: tuple[Data, ...] = ()  # regions that may be objects
    perceived: Data | None = None  # what perception wrote about the photo


@dataclass(frozen=True)
class CompiledScene:
    """A scene that is compiled; without its maps, as many texts of one large photo may be kept."""

    scene: Scene
    compiled: Compiled
    key: str  # of its photo and maps
    picture: str  # key of its picture
    read: Callable[[Scene], Percepts | None]
    lints: list[tuple[Problem, ...]] = field(
        default_factory=list
    )  # empty until they are computed

    @property
    def percepts(self) -> Percepts | None:
        """The photo and its maps, None for a scene without a photo."""
        return self.read(self.scene)


class Live:
    """One scene file while it is edited: problems, values and motion of its text.

    What an edit leaves as it was is kept: the photo and its maps, outlines, and motions. The methods may be called from
    any thread; they wait for each other.
    """

    def __init__(self, path: Path, allow_outside: bool = False) -> None:
        self.path, self.allow_outside = path, allow_outside
        self._lock = RLock()
        self._warm = Stages(Keep.EDITING)
        self._opened: Recent[Opened] = Recent(6)
        self._known: Recent[CompiledScene] = Recent(8)
        self._motions: Recent[MotionStream] = Recent(MAX_MOTIONS)
        self._sights: Recent[CompiledScene] = Recent(4)

    def look(
        self, text: str, variant: str | None = None, *, motion_only: bool = False
    ) -> Look:
        """All that the page shows of a text, or its motion and problems alone, while the user drags something."""
        with self._lock:
            begun = time.perf_counter()
            try:
                opened = self._open(text)
                known = self._mean(opened, variant)
            except InputError as error:
                rows = tuple(self._row(problem) for problem in error.problems)
                return Look(rows, todo=tuple(todo(None, rows)))
            stream, motion = self._motion(known, begun)
            if motion_only:
                return Look(
                    tuple(self._row(p, known.scene) for p in stream.problems),
                    motion=motion,
                )
            if not known.lints:
                known.lints.append(
                    tuple(lint(known.scene, known.compiled, known.percepts))
                )
            failing = as_warnings(opened.variant_problems)
            found = (*stream.problems, *failing, *known.lints[0])
            rows = tuple(self._row(problem, known.scene) for problem in found)
            doubtful = doubtful_data(known.scene, known.percepts)
            return Look(
                rows,
                scene_data(known.scene),
                derived_data(known.scene, known.compiled),
                motion,
                known.picture,
                (*todo(known.scene, rows), *doubtful_rows(known.scene, doubtful)),
                tuple(doubtful),
                perceived_data(known.scene),
            )

    def more(self, key: str, start: int) -> Data | None:
        """The next part of a motion, from a sample on; None where it is not kept any more."""
        with self._lock:
            stream = self._motions.get(key)
            if stream is None:
                return None
            part = stream.part(start, time.perf_counter() + MORE)
            part["problems"] = [self._row(problem) for problem in stream.problems]
            return part

    def whole(self, key: str) -> tuple[Trajectory, World] | None:
        """A motion simulated to its end, and its world; None where it is not kept, or cannot be simulated."""
        while True:
            with self._lock:
                stream = self._motions.get(key)
                if stream is None or stream.problems:
                    return None
                if stream.done:
                    return stream.trajectory(), stream.world
                stream.simulate(0, time.perf_counter() + SLICE)
            time.sleep(0)  # lets waiting looks go first

    def sight(self, key: str) -> CompiledScene | None:
        """The scene of a picture's key."""
        with self._lock:
            return self._sights.get(key)

    def state(self, text: str, variant: str | None = None) -> CompiledScene:
        """The scene of a text with its maps, compiled. Raises InputError."""
        with self._lock:
            return self._mean(self._open(text), variant)

    def document(self, text: str) -> Data:
        """The text as plain data, with what it extends and without any default. Raises InputError."""
        with self._lock:
            return self._open(text).document()

    def _open(self, text: str) -> Opened:
        def read() -> Opened:
            return Opened(self.path, self.allow_outside, text=text)

        opened = self._opened.of(text, read)
        if opened.stale():  # a file that it extends was written
            self._opened.forget(text)
            opened = self._opened.of(text, read)
        return opened

    def _mean(self, opened: Opened, variant: str | None) -> CompiledScene:
        """The scene of a text, compiled. Raises InputError."""
        scene = opened.scene((), variant)
        seen = self._warm.maps(scene)
        read = (opened, variant, seen.key)

        def make() -> CompiledScene:
            compiled = self._warm.compile(scene, seen)
            masks = (
                [item.mask for item in scene.objects],
                [item.mask for item in scene.boundaries],
            )
            # of these and the maps follows whose pixels are whose: hashing those of a large photo takes long
            drawn = compiled.outlines if seen.percepts is None else ()
            picture = key(
                "picture", seen.key, *appearance(scene, compiled.world), drawn, masks
            )
            made = CompiledScene(scene, compiled, seen.key, picture, self._percepts)
            self._sights.of(picture, lambda: made)
            return made

        return self._known.of(read, make)

    def _percepts(self, scene: Scene) -> Percepts | None:
        with self._lock:
            return self._warm.maps(scene).percepts

    def _motion(self, known: CompiledScene, begun: float) -> tuple[MotionStream, Data]:
        world = known.compiled.world
        name = motion_key(world)
        stream = self._motions.of(name, lambda: MotionStream(name, known.scene, world))
        stream.scene = known.scene  # which may differ in labels or the frame rate
        part = stream.part(0, max(begun + FIRST, time.perf_counter() + FIRST / 3))
        part["problems"] = [
            self._row(problem, known.scene) for problem in stream.problems
        ]
        return stream, part

    def _row(self, problem: Problem, scene: Scene | None = None) -> Data:
        if (
            scene is not None and not problem.place.line and problem.path
        ):  # found while simulating
            problem = replace(problem, place=scene.place(problem.path))
        return problem_data(problem, os.fspath(self.path))


# Images


class Pictures:
    """Of one scene file while it is edited; its methods may be called from any thread and hold up no look."""

    def __init__(self, live: Live) -> None:
        self._live, self._lock = live, Lock()
        self._stages: Recent[Stage] = Recent(2)

    def look(self, key: str) -> Data | None:
        """`names` of the bodies, `background` and `sprites` as `report.cutouts` has them; None: the key is gone."""
        sight = self._live.sight(key)
        if sight is None:
            return None
        with self._lock:
            drawn = self._stage(key, sight)
            background = plate(drawn, range(len(drawn.sprites)))
            names = [item.name for item in sight.scene.objects]
            return {
                "key": key,
                "names": names,
                "background": background,
                "sprites": sprites(drawn),
                "shadows": [],
            }

    def shadows(self, key: str, motion: str) -> Data | None:
        """Shadows of every object for a motion, which is simulated to its end; None: one of the two is gone."""
        sight = self._live.sight(key)
        seen = None if sight is None else self._live.whole(motion)
        if sight is None or seen is None:
            return None
        trajectory, world = seen
        with self._lock:
            drawn = replace(self._stage(key, sight), starts=photo_poses(world))
            same = len(trajectory.names) == len(sight.scene.objects)
            rows = shadows(drawn, trajectory, range(len(drawn.sprites))) if same else []
            return {"key": key, "motion": motion, "shadows": rows}

    def frame(self, key: str, motion: str, number: int) -> bytes | None:
        """PNG of all of the photo at a frame of a motion, as the video shows it; None: one of the two is gone.

        A number beyond the last frame means the last.
        """
        sight = self._live.sight(key)
        seen = None if sight is None else self._live.whole(motion)
        if sight is None or seen is None:
            return None
        trajectory, world = seen
        with self._lock:
            drawn = replace(self._stage(key, sight), starts=photo_poses(world))
        blur = sight.scene.render.motion_blur
        at_frames = trajectory.sampled(world.times)
        moments, parts = exposure_times(at_frames, world, blur)
        fine = at_frames if parts == 1 else trajectory.sampled(moments)
        first = min(number, len(world.times) - 1) * parts
        order = range(first, first + parts)
        frame = next(render_frames(drawn, fine, order, parts))
        return _png(cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR))

    def _stage(self, key: str, sight: CompiledScene) -> Stage:
        """With the poses in which objects were cut out of the photo."""
        return self._stages.of(
            key, lambda: stage(sight.scene, sight.compiled, sight.percepts)
        )


def photo_png(sight: CompiledScene) -> bytes:
    """PNG of the photo; a scene without one has a plain background."""
    from physgen.render.staging import flat_background

    maps = sight.percepts
    rgb = flat_background(sight.compiled.world, 1.0) if maps is None else maps.rgb
    return _png(cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2BGR))


def mask_png(sight: CompiledScene, name: str) -> bytes:
    """An object's pixels as a grey PNG of the photo's size, 0 or 255. Raises EditError, InputError."""
    names = [item.name for item in sight.scene.objects]
    if name not in names:
        raise Message.NAME_UNKNOWN.impossible(name=name)
    return _png(
        np.where(
            sight.compiled.labels == names.index(name) + 1, np.uint8(255), np.uint8(0)
        )
    )


def _png(picture: NDArray[Any]) -> bytes:
    done, data = cv2.imencode(".png", picture)
    assert done
    return data.tobytes()
