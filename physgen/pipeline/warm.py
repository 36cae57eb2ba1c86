"""Stages whose results stay in this process from one clip to the next, for as long as what they read is the same.

Scenes that differ in a force, a mass or a light share all that these leave as it is: the file is parsed once, the photo
and its maps are read once, things are cut out once. Motions also outlast the process, in
the store of `physgen.pipeline`.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from physgen.files import Stamp, file_stamp
from physgen.pipeline import stages
from physgen.pipeline.packs import scene_file
from physgen.pipeline.watch import Progress, silent
from physgen.problems import Warn, ignore_warning

if TYPE_CHECKING:
    from physgen.compile.compile import Compiled
    from physgen.compile.shapes import Shapes
    from physgen.compile.world import World
    from physgen.maps import Percepts
    from physgen.render.stage import Stage
    from physgen.scene.load import Opened
    from physgen.scene.scene import Scene
    from physgen.simulate.recorder import StepLog
    from physgen.simulate.trajectory import Trajectory


T = TypeVar("T")

WORTH = 0.03
"""s that a simulation takes from which on it is kept on disk: reading one back takes a tenth of that."""
MOST_HASHES = 20_000
"""Files whose hashes are remembered."""
MOST_PIXELS = 2_000_000
"""Of a photo that stays in memory with its maps: a larger one goes when things are cut out of it."""


class Keep(Enum):
    """What stays."""

    RESULTS = "results"
    """The last few of each stage."""
    EDITING = "editing"
    """The same, and the maps of one photo however large, as they are and as they were."""
    NOTHING = "nothing"
    """For a clip that is the only one: memory is free for drawing."""


class Recent(Generic[T]):
    """The last few results, by key; the eldest goes before a new one is made, so that both need never fit."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: dict[object, T] = {}

    def forget(self, key: object) -> None:
        """It is made anew when asked for."""
        self._kept.pop(key, None)

    def at_hand(self, key: object) -> T | None:
        """Made before, or None."""
        if key in self._kept:
            self._kept[key] = self._kept.pop(key)
        return self._kept.get(key)

    def of(self, key: object, make: Callable[[], T]) -> T:
        """Made now, or before."""
        if key in self._kept:
            found = self._kept[key] = self._kept.pop(key)
            return found
        while len(self._kept) >= max(self._most, 1):
            del self._kept[next(iter(self._kept))]
        made = make()
        if self._most:
            self._kept[key] = made
        return made


@dataclass(frozen=True)
class Maps:
    """A photo with its maps, None for a scene without one; and what it was read from, as a key and as files."""

    percepts: Percepts | None
    key: str
    stamps: tuple[tuple[Path, Stamp], ...] = ()
    """Of its files, from before they were read."""


class Warm:
    """The stages of `pipeline.stages`, of which each is run only where its result is not at hand."""

    def __init__(self, keep: Keep = Keep.RESULTS) -> None:
        few = 0 if keep is Keep.NOTHING else 4
        self._editing = keep is Keep.EDITING
        self._opened: Recent[Opened] = Recent(few)
        self._maps: Recent[Maps] = Recent(2 if self._editing else min(few, 1))
        self._shapes: Recent[Shapes] = Recent(few)
        self._stages: Recent[Stage] = Recent(min(few, 1))
        self._motions: Recent[Trajectory] = Recent(few)
        self._hashes: dict[Path, tuple[Stamp, str]] = {}

    def load(
        self,
        path: str | Path,
        overrides: Sequence[str],
        variant: str | None,
        allow_outside: bool,
        shown: str | None = None,
    ) -> Scene:
        """As `stages.load`; `shown` is what messages call the file, or the pack, where that is not its path."""
        from physgen.scene.load import Opened
        from physgen.scene.pack_format import SUFFIX

        packed = shown is not None and shown.endswith(SUFFIX)
        name = str(scene_file(path, shown if packed else None))
        shown = None if packed else shown
        read = (os.getcwd(), name, allow_outside, shown)
        opened = self._opened.of(read, lambda: Opened(name, allow_outside, shown))
        if opened.stale():
            self._opened.forget(read)
            opened = self._opened.of(read, lambda: Opened(name, allow_outside, shown))
        return opened.scene(overrides, variant)

    def maps(self, scene: Scene) -> Maps:
        """As `stages.percepts`."""
        read, stamps = self._read(scene)
        width, height = scene.size
        if width * height > MOST_PIXELS and not self._editing:
            return Maps(stages.percepts(scene), read, stamps)
        return self._maps.of(read, lambda: Maps(stages.percepts(scene), read, stamps))

    def hand_over(self, scene: Scene, percepts: Percepts) -> None:
        """What was just written need not be read: `percepts` are what the scene's files hold."""
        read, stamps = self._read(scene)
        self._maps.of(read, lambda: Maps(percepts, read, stamps))

    def _read(self, scene: Scene) -> tuple[str, tuple[tuple[Path, Stamp], ...]]:
        """The key of a scene's maps, and their files."""
        from physgen.pipeline.cache_keys import key

        files = [] if scene.image is None else [scene.image]
        if scene.image is not None and scene.assets is not None:
            files += sorted(scene.assets.glob("*.png"))
        stamps = tuple((file, file_stamp(file)) for file in files)
        return key("percepts", [(str(file), *stamp) for file, stamp in stamps], dict(scene.maps)), stamps

    def compile(self, scene: Scene, maps: Maps) -> Compiled:
        """As `stages.compile`."""
        from physgen.compile.compile import check_steps, compile_shapes
        from physgen.compile.shapes import shapes_of
        from physgen.pipeline.cache_keys import key

        check_steps(scene)
        labels = None if maps.percepts is None else maps.percepts.labels
        things = [(item.mask, item.shape, item.layer) for item in scene.objects]
        masks = [item.mask for item in scene.boundaries]
        read = key("shapes", maps.key, scene.size, things, masks)
        return compile_shapes(scene, self._shapes.of(read, lambda: shapes_of(scene, labels)))

    def stage(self, scene: Scene, compiled: Compiled, maps: Maps) -> Stage:
        """As `stages.stage`."""
        from physgen.compile.appearance import appearance, photo_poses
        from physgen.pipeline.cache_keys import key

        seen = appearance(scene, compiled.world)
        drawn = compiled.outlines if maps.percepts is None else ()
        shapes = (compiled.labels, compiled.scenery, drawn)
        made = self._stages.of(
            key("stage", maps.key, *seen, *shapes), lambda: stages.stage(scene, compiled, maps.percepts)
        )
        return replace(made, starts=photo_poses(compiled.world))  # they may be put elsewhere since

    def simulate(
        self,
        world: World,
        progress: Progress = silent,
        cached: bool = True,
        warn: Warn = ignore_warning,
        tape: StepLog | None = None,
    ) -> Trajectory:
        """As `stages.simulate`; from the store of results where it is kept there, if it is to be `cached`.

        A motion that is at hand leaves the `tape` empty.
        """
        from physgen.pipeline.cache import open_store
        from physgen.pipeline.cache_keys import motion_key
        from physgen.pipeline.footage import load_motion, save_motion

        read = motion_key(world)

        def run() -> Trajectory:
            store = open_store(warn=warn) if cached else None
            if (found := load_motion(store, read)) is not None:
                return found
            begun = time.perf_counter()
            made = stages.simulate(world, progress=progress, tape=tape)
            if time.perf_counter() - begun > WORTH:
                save_motion(store, read, made)
            return made

        return self._motions.of(read, run)

    def hash(self, file: Path) -> str:
        """SHA-256 of a file, worked out once for as long as it is not written. Raises OSError."""
        from physgen.report.record import file_hash

        stamp = file_stamp(file)
        known = self._hashes.get(file)
        if known is None or known[0] != stamp:
            if len(self._hashes) >= MOST_HASHES:
                self._hashes.clear()
            known = self._hashes[file] = stamp, file_hash(file)
        return known[1]
