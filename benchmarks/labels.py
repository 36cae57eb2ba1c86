"""What ground truth costs: every format of one clip in one pass, beside what the encoders of its files take in it.

The clip is drawn by formula, as in frames.py: 16 balls roll over a table seen from above, 60 frames of 512 x 512 px,
with depth and normals of the photo. Encoders are timed from inside, on the very arrays that they are handed,
with the writing of their files.
"""

from __future__ import annotations

import json
import time
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np
from frames import grid, table
from PIL import Image
from pycocotools import mask as coco

from physgen import pipeline
from physgen.export import formats
from physgen.export.labels import Moment
from physgen.maps import write_assets
from physgen.photometry import sphere_normals

BAR = 1.3
"""Times what the encoders take."""
SIZE, COUNT, RADIUS, FRAMES = 512, 16, 24.0, 60
ENCODERS: list[tuple[object, str]] = [
    (cv2, "imencode"),
    (cv2, "writeOpticalFlow"),
    (Path, "write_bytes"),
    (Path, "write_text"),
    (json, "dumps"),
    (zipfile._ZipWriteFile, "write"),
    (Image.Image, "save"),
    (coco, "frPyObjects"),
]
REPEAT = 3
SHARED = "what they share"


class Clock:
    """CPU seconds by format, and of them in encoders."""

    def __init__(self) -> None:
        self.whole: Counter[str] = Counter()
        self.encoding: Counter[str] = Counter()
        self._format, self._depth = "", 0
        self.again = 0.0
        """s that files took which hold what was encoded for another: alone, each takes its own."""
        self._files: dict[int, tuple[object, float]] = {}
        self._written: set[int] = set()

    @contextmanager
    def of(self, name: str) -> Iterator[None]:
        """What is done in the block is that format's."""
        self._format, begun = name, time.thread_time()
        yield
        self.whole[name] += time.thread_time() - begun
        self._format = ""

    def timed(self, encode: Callable) -> Callable:
        """An encoder; one within another counts once."""

        def run(*args: object, **named: object) -> object:
            self._depth += 1
            begun = time.thread_time()
            try:
                made = encode(*args, **named)
            finally:
                self._depth -= 1
                took = time.thread_time() - begun
                if not self._depth and self._format:
                    self.encoding[self._format] += took
            if isinstance(
                made, tuple
            ):  # `imencode`: the array is kept, so that no other has its id
                self._files[id(made[1])] = made[1], took
            elif (
                len(args) == 2
                and isinstance(args[1], memoryview)
                and id(args[1].obj) in self._files
            ):
                here = id(args[1].obj)
                self.again += self._files[here][1] if here in self._written else 0.0
                self._written.add(here)
            return made

        return run


class Timed:
    """A writer, on the clock."""

    def __init__(self, name: str, writer: formats.Writer, clock: Clock) -> None:
        self._name, self._writer, self._clock = name, writer, clock

    def add(self, moment: Moment) -> None:
        with self._clock.of(self._name):
            self._writer.add(moment)

    def close(self) -> None:
        with self._clock.of(self._name):
            self._writer.close()


class Shared:
    """What several formats read is worked out before any of them."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def add(self, moment: Moment) -> None:
        with self._clock.of(SHARED):
            _ = moment.view.boxes, moment.view.jpeg, moment.forward, moment.backward

    def close(self) -> None:
        """Nothing is written."""


def labels(folder: Path) -> list[dict]:
    """CPU ms a frame of each format, of its encoders, and how many times as long; the best of some runs."""
    scene = mapped(folder / "scene")
    runs = [run(scene, folder / str(k)) for k in range(REPEAT)]
    return min(runs, key=lambda rows: rows[-1]["times"])


def mapped(folder: Path) -> Path:
    """A table with balls, and maps of it."""
    spots = grid((SIZE, SIZE), COUNT, RADIUS)
    path = table(folder, (SIZE, SIZE), spots)
    maps = pipeline.percepts(pipeline.load(path))
    assert maps is not None
    normals = np.zeros((SIZE, SIZE, 3), np.float32)
    normals[..., 2] = 1
    depth = np.full((SIZE, SIZE), 10.0, np.float32)
    for x, y, r in spots:
        own, inside = sphere_normals(SIZE, SIZE, (x, y), r)
        normals[inside] = own[inside]
        depth[inside] -= r * own[inside][:, 2] / 100
    ranges = write_assets(
        replace(maps, depth=depth, normals=normals), folder / "photo.assets"
    )
    text = path.read_text()
    path.write_text(
        text.replace(
            "objects:", f"maps: {{depth: {list(ranges['depth'])}}}\nobjects:", 1
        )
    )
    return path


def run(scene: Path, out: Path) -> list[dict]:
    """All formats in one pass."""
    clock = Clock()
    names = [kind.name for kind in formats.FORMATS]
    written = formats.open_writers

    @contextmanager
    def on_the_clock(*args: object) -> Iterator[list[formats.Writer]]:
        with written(*args) as writers:
            timed = [Timed(*pair, clock) for pair in zip(names, writers, strict=True)]
            yield [Shared(clock), *timed]
            writers[:] = timed  # they are closed after the block

    with ExitStack() as held:
        held.enter_context(patch.object(formats, "open_writers", on_the_clock))
        for home, name in ENCODERS:
            held.enter_context(
                patch.object(home, name, clock.timed(getattr(home, name)))
            )
        done = pipeline.render_scene(
            scene,
            out,
            overrides=[f"render.frames={FRAMES}"],
            formats=(),
            page=pipeline.Page.NONE,
            export=names,
            cached=False,
        )
    rows = []
    for name in names:
        files = [path for path in (done / name).rglob("*") if path.is_file()]
        rows.append(_row(name, clock.whole[name], clock.encoding[name]))
        rows[-1] |= {
            "files": len(files),
            "mb": round(sum(path.stat().st_size for path in files) / 1e6, 1),
        }
    whole = json.loads((done / "timing.json").read_text())["stages"]["export"]["cpu"]
    made, encoding = (
        sum(times[name] for name in names) for times in (clock.whole, clock.encoding)
    )
    encoding += clock.encoding[SHARED]
    rows.append(_row(SHARED, whole - made, clock.encoding[SHARED]))
    total = {
        "files": sum(row.get("files", 0) for row in rows),
        "mb": round(sum(r.get("mb", 0) for r in rows), 1),
    }
    alone = encoding + clock.again
    total |= {
        "alone": round(1000 * alone / FRAMES, 2),
        "times_alone": round(whole / alone, 2),
        "bar": BAR,
    }
    return [*rows, _row("all", whole, encoding) | total]


def _row(name: str, whole: float, encoding: float) -> dict:
    return {
        "format": name,
        "ms": round(1000 * whole / FRAMES, 2),
        "encoding": round(1000 * encoding / FRAMES, 2),
        "times": round(whole / encoding, 2),
    }
