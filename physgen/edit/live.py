"""Problems, values and the motion of a scene's text, computed in parts while the user edits."""

from __future__ import annotations

import os
import time
from base64 import b64decode, b64encode
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.appearance import appearance
from physgen.compile.compile import Compiled
from physgen.compile.warnings import photo_differs
from physgen.compile.world import World
from physgen.edit.ground import Layer
from physgen.edit.mask_tools import Finder
from physgen.edit.panels import derived_data, problem_data, scene_data
from physgen.maps import Percepts
from physgen.pipeline.cache_keys import key, motion_key
from physgen.pipeline.stages import Keep, Recent, Stages, lint
from physgen.problems import InputError, Problem, by_place
from physgen.report.player import fields, figure, joints, pushes, touches, walls
from physgen.scene.load import Opened
from physgen.scene.scene import Scene, View
from physgen.simulate.engine import Running
from physgen.simulate.trajectory import Trajectory

# ----------------------------------------------------------------------
# A world -> its motion as the page reads it, in parts: what is simulated by now, and more whenever the page
# asks.
#
# Numbers are float64 as the engine has them, little-endian, base64: at the frames, those of `physgen
# simulate`. No step
# is taken twice, and none that nobody asks for.

Array = NDArray[np.float64]
Data = dict[str, Any]

FINER = 4
"""Samples a frame: what bounces within one is seen to."""
FEW = 100_000
"""Samples times objects up to which there are so many."""
MOST = 200_000
"""Samples times objects of one part: about 15 MB of JSON."""
COLUMNS = ("x", "y", "a", "vx", "vy", "w")


class Film:
    """The motion of one world, as far as it is known."""

    def __init__(self, key: str, scene: Scene, world: World) -> None:
        self.key = key
        self._scene, self.world = scene, world
        N, frames = max(len(world.bodies), 1), world.times
        finer = FINER if len(frames) * FINER * N <= FEW else 1
        times = frames
        if finer > 1 and len(frames) > 1:
            between = frames[:-1, None] + np.diff(frames)[:, None] * (np.arange(finer) / finer)
            times = np.unique(np.concatenate([between.ravel(), frames]))
        self._frames = np.searchsorted(times, frames)
        self._running = Running(world, times)
        self._problems: list[Problem] = []

    def show(self, scene: Scene) -> None:
        """The same motion, of a scene that differs in what does not move: labels, the clip's rate, order."""
        self._scene = scene

    @property
    def total(self) -> int:
        """Samples in all."""
        return len(self._running.times)

    @property
    def done(self) -> bool:
        """Whether nothing is left to be simulated."""
        return bool(self._problems) or self._running.done >= self.total

    def trajectory(self) -> Trajectory:
        """What is known; samples from `upto` on are zeros until they are simulated."""
        return self._running.told()

    @property
    def upto(self) -> int:
        """Samples that are simulated."""
        return self._running.done

    def part(self, start: int, deadline: float) -> Data:
        """Samples from `start` on; what is missing is simulated until `deadline`, of `time.perf_counter`.

        There is one sample more than before at least, unless the motion has ended.
        """
        begun = time.perf_counter()
        start = max(0, min(start, self.total))
        self._simulate(start + 1, deadline)
        run, N = self._running, max(len(self.world.bodies), 1)
        upto = max(start, min(run.done, start + max(1, MOST // N)))
        told = run.told()
        found: Data = {
            "key": self.key,
            "id": self.key,
            "from": start,
            "upto": upto,
            "total": self.total,
            "done": self.done and upto == run.done,
            "problems": [],
        }
        turning = told.turns.shape[1] > 0
        found["bodies"] = [
            {
                "name": body.name,
                **{name: packed(told.poses[start:upto, k, c]) for c, name in enumerate(COLUMNS[:3])},
                **{name: packed(told.velocities[start:upto, k, c]) for c, name in enumerate(COLUMNS[3:])},
                "q": [packed(part) for part in told.turns[start:upto, k].T] if turning else None,
            }
            for k, body in enumerate(self.world.bodies)
        ]
        found["contacts"] = found["energy"] = None
        if found["done"] and not self._problems:
            e = told.energy
            rows = {
                "kinetic": e.kinetic,
                "potential": e.potential,
                "dissipated": e.dissipated,
                "work": e.work,
            }
            found["energy"] = {name: packed(values) for name, values in rows.items()}
            found["contacts"] = {"surfaces": list(told.contacts.surfaces), "touches": touches(told)}
        if start == 0:
            self._begin(found)
        found["took_ms"] = round(1000 * (time.perf_counter() - begun), 1)
        return found

    def problems(self) -> list[Problem]:
        """Why the motion ends early."""
        return self._problems

    def on(self, deadline: float) -> None:
        """Simulate what is left until the deadline."""
        self._simulate(0, deadline)

    def _simulate(self, least: int, deadline: float) -> None:
        """Until the deadline, and until at least so many samples are taken."""
        run = self._running
        if self.done:
            return
        try:
            while not self.done:
                run.on(run.end, enough=partial(_late, deadline))
                run.read()
                if run.done >= min(least, self.total) and _late(deadline):
                    break
                deadline = max(deadline, time.perf_counter() + 0.01)
        except InputError as error:
            self._problems = error.problems

    def _begin(self, found: Data) -> None:
        """What only the first part tells: all that does not change with time."""
        scene, world = self._scene, self.world
        for k, body in enumerate(world.bodies):
            found["bodies"][k] |= figure(scene, k, body)
        found |= {
            "times": packed(self._running.times),
            "frames": self._frames.tolist(),
            "name": scene.name,
            "size": list(world.size),
            "scale": world.pixels_per_meter if "world.pixels_per_meter" in scene.places else None,
            "gravity": world.gravity.tolist(),
            "top": world.view is View.TOP,
            "clip": {"fps": scene.render.fps, "order": scene.render.play.value},
            "camera": None,
            "walls": walls(world),
            "pushes": pushes(world),
            "joints": joints(world),
            "fields": fields(world),
        }


def _late(deadline: float) -> bool:
    return time.perf_counter() > deadline


def packed(values: Array) -> str:
    """Little-endian float64, base64.

    >>> packed(np.array([1.0]))
    'AAAAAAAA8D8='
    """
    return b64encode(np.ascontiguousarray(values, "<f8").tobytes()).decode("ascii")


def unpacked(text: str) -> Array:
    """The numbers again.

    >>> unpacked('AAAAAAAA8D8=').tolist()
    [1.0]
    """
    return np.frombuffer(b64decode(text), "<f8").astype(np.float64)


# ----------------------------------------------------------------------
# A scene's text -> what is wrong with it, what it means, and its motion, soon enough to be watched while it
# changes.
#
# What an edit leaves as it was stays at hand: the photo and its maps, the outlines, motions that were begun.

FIRST, MORE = 0.045, 0.08
"""s that a look, and a part of a motion after its first, simulate."""
SLICE = 0.03
"""s for which a motion that is simulated to its end holds up others."""
FILMS = 6
"""Motions that are kept: of the tabs, and of before and after an undo."""


@dataclass(frozen=True)
class Look:
    """One state of the text, seen. Where the text is wrong, `problems` say so and the rest is None."""

    problems: tuple[Data, ...] = ()
    """Errors, then lints."""
    scene: Data | None = None
    derived: Data | None = None
    motion: Data | None = None
    """Its first part; see `motion.Film`."""
    picture: str | None = None
    """Key of what is drawn of the photo."""
    todo: tuple[Data, ...] = ()
    variants: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sight:
    """What a picture is made of."""

    scene: Scene
    compiled: Compiled
    key: str
    """Of its photo and maps."""
    read: Callable[[Scene], Percepts | None]

    @property
    def percepts(self) -> Percepts | None:
        """The photo and its maps, which are at hand as long as they are the newest."""
        return self.read(self.scene)


@dataclass(frozen=True)
class _Known:
    """A text that means something; it holds no maps, as many texts may be known of one large photo."""

    scene: Scene
    compiled: Compiled
    key: str
    picture: str
    lints: list[tuple[Problem, ...]] = field(default_factory=list)
    """None or one: they are looked for when somebody wants them."""


class Live:
    """One scene file while it is edited. Its methods may be called from any thread; they wait for each other."""

    def __init__(self, path: Path, allow_outside: bool = False) -> None:
        self.path, self.allow_outside = path, allow_outside
        self.finder = Finder()
        self.layer = Layer()
        self._lock = RLock()
        self._warm = Stages(Keep.EDITING)
        self._opened: Recent[Opened] = Recent(6)
        self._known: Recent[_Known] = Recent(8)
        self._films: Recent[Film] = Recent(FILMS)
        self._sights: Recent[Sight] = Recent(4)
        self._unlike: Recent[tuple[Problem, ...]] = Recent(4)

    def look(
        self, text: str, maps: Path | None = None, variant: str | None = None, overrides: Sequence[str] = ()
    ) -> Look:
        """Problems, lints and doubts, the scene and the first part of its motion. `maps` stand in for its assets."""
        from physgen.edit.panels import todo

        with self._lock:
            begun = time.perf_counter()
            opened, problems = self._open(text, maps)
            known = None
            if opened is not None:
                try:
                    known = self._mean(opened, variant, overrides)
                except InputError as error:
                    problems = error.problems
            variants = opened.variants if opened is not None else ()
            if known is None:
                told = self._wrong(problems, opened)
                return Look(told, todo=tuple(todo(text, None, None, told)), variants=variants)
            film, motion = self._motion(known, begun)
            if not known.lints:
                known.lints.append(tuple(self._lints(known)))
            told = tuple(self._told(p, known.scene) for p in (*film.problems(), *known.lints[0]))
            return Look(
                told,
                scene_data(known.scene),
                derived_data(known.scene, known.compiled),
                motion,
                known.picture,
                tuple(todo(text, known.scene, known.compiled, told)),
                variants,
            )

    def preview(
        self, text: str, maps: Path | None = None, variant: str | None = None, overrides: Sequence[str] = ()
    ) -> Look:
        """The motion and errors alone, while something is being dragged."""
        with self._lock:
            begun = time.perf_counter()
            opened, problems = self._open(text, maps)
            if opened is None:
                return Look(self._wrong(problems, None))
            try:
                known = self._mean(opened, variant, overrides)
            except InputError as error:
                return Look(self._wrong(error.problems, opened))
            film, motion = self._motion(known, begun)
            return Look(tuple(self._told(p, known.scene) for p in film.problems()), motion=motion)

    def more(self, key: str, start: int) -> Data | None:
        """The next part of a motion, from a sample on; None where others have taken its place."""
        with self._lock:
            film = self._films.at_hand(key)
            if film is None:
                return None
            part = film.part(start, time.perf_counter() + MORE)
            part["problems"] = [self._told(problem) for problem in film.problems()]
            return part

    def whole(self, key: str) -> tuple[Trajectory, World] | None:
        """A motion that was begun, to its end, and what moves; None where it is gone, or cannot go on."""
        while True:
            with self._lock:
                film = self._films.at_hand(key)
                if film is None or film.problems():
                    return None
                if film.done:
                    return film.trajectory(), film.world
                film.on(time.perf_counter() + SLICE)
            time.sleep(0)  # who waits for a look goes first

    def sight(self, key: str) -> Sight | None:
        """What the picture of this key is made of."""
        with self._lock:
            return self._sights.at_hand(key)

    def state(
        self, text: str, maps: Path | None = None, variant: str | None = None, overrides: Sequence[str] = ()
    ) -> Sight:
        """The scene of a text with its maps, compiled. Raises InputError."""
        with self._lock:
            opened, problems = self._open(text, maps)
            if opened is None:
                raise InputError(problems)
            known = self._mean(opened, variant, overrides)
            return Sight(known.scene, known.compiled, known.key, self._percepts)

    def document(self, text: str, maps: Path | None = None) -> Data:
        """The text as plain data, with what it extends and without any default. Raises InputError."""
        with self._lock:
            opened, problems = self._open(text, maps)
            if opened is None:
                raise InputError(problems)
            return opened.document()

    def _open(self, text: str, maps: Path | None) -> tuple[Opened | None, Sequence[Problem]]:
        read = (text, maps)
        try:
            opened = self._opened.of(read, lambda: self._read(text, maps))
            if opened.stale():  # what it extends was written
                self._opened.forget(read)
                opened = self._opened.of(read, lambda: self._read(text, maps))
        except InputError as error:
            return None, error.problems
        return opened, ()

    def _read(self, text: str, maps: Path | None) -> Opened:
        return Opened(self.path, self.allow_outside, text=text, assets=maps)

    def _mean(self, opened: Opened, variant: str | None, overrides: Sequence[str]) -> _Known:
        """What a text means. Raises InputError."""
        scene = opened.scene(overrides, variant)
        seen = self._warm.maps(scene)
        read = (opened, variant, tuple(overrides), seen.key)

        def make() -> _Known:
            compiled = self._warm.compile(scene, seen)
            masks = ([item.mask for item in scene.objects], [item.mask for item in scene.boundaries])
            # of these and the maps follows whose pixels are whose: hashing those of a large photo takes long
            drawn = compiled.outlines if seen.percepts is None else ()
            picture = key("picture", seen.key, *appearance(scene, compiled.world), drawn, masks)
            self._sights.of(picture, lambda: Sight(scene, compiled, seen.key, self._percepts))
            return _Known(scene, compiled, seen.key, picture)

        return self._known.of(read, make)

    def _percepts(self, scene: Scene) -> Percepts | None:
        with self._lock:
            return self._warm.maps(scene).percepts

    def hand_over(self, scene: Scene, percepts: Percepts) -> None:
        """Maps that were just written for a scene, so that they need not be read."""
        with self._lock:
            self._warm.hand_over(scene, percepts)

    def _lints(self, known: _Known) -> list[Problem]:
        """Those of the photo are looked for once for all texts that have the same masks."""
        scene, compiled = known.scene, known.compiled
        read = (known.key, compiled.shapes)

        def photos() -> tuple[Problem, ...]:
            return tuple(photo_differs(scene, compiled, self._percepts(scene)))

        place = scene.place("image")
        of_photo = [replace(problem, place=place) for problem in self._unlike.of(read, photos)]
        return by_place([*lint(scene, compiled), *of_photo])

    def _motion(self, known: _Known, begun: float) -> tuple[Film, Data]:
        world = known.compiled.world
        name = motion_key(world)
        film = self._films.of(name, lambda: Film(name, known.scene, world))
        film.show(known.scene)
        part = film.part(0, max(begun + FIRST, time.perf_counter() + FIRST / 3))
        part["problems"] = [self._told(problem, known.scene) for problem in film.problems()]
        return film, part

    def _wrong(self, problems: Sequence[Problem], opened: Opened | None) -> tuple[Data, ...]:
        """Problems of a text that means nothing."""
        document = {} if opened is None else opened.document()
        names = list(document["objects"]) if isinstance(document.get("objects"), dict) else []
        name = os.fspath(self.path)
        return tuple(problem_data(problem, name, names, document) for problem in problems)

    def _told(self, problem: Problem, scene: Scene | None = None) -> Data:
        name = os.fspath(self.path)
        if scene is None:
            return problem_data(problem, name)
        if not problem.place.line and problem.path:  # it only showed in the running
            problem = replace(problem, place=scene.place(problem.path))
        return problem_data(problem, name, [item.name for item in scene.objects], scene.document)
