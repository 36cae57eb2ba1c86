"""Scenes to label, their labels, and the same clip's frames drawn again by themselves."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import trackeval
from pycocotools.coco import COCO

from physgen import pipeline
from physgen.pipeline.film import Film
from physgen.pipeline.stages import Keep, Stages
from physgen.report.record import RunRecord

QUIET = {
    "PRINT_RESULTS": False,
    "PRINT_CONFIG": False,
    "TIME_PROGRESS": False,
    "DISPLAY_LESS_PROGRESS": True,
}
QUIET |= {
    "OUTPUT_SUMMARY": False,
    "OUTPUT_DETAILED": False,
    "PLOT_CURVES": False,
    "PRINT_ONLY_COMBINED": True,
}
ROOT = Path(__file__).resolve().parents[2]
HALL = """\
physgen: 1
size: [96, 72]
world: {view: top, duration: 0.8}
render: {frames: 8, fps: 10}
objects:
  post: {label: post, layer: 1, motion: static, shape: {box: {center: [20, 40], size: [9, 14]}}}
  tile: {label: tile, layer: 1, motion: static, shape: {box: {center: [60.3, 30.6], size: [24, 18]}}}
  door:
    {label: tile, layer: 2, shape: {box: {center: [14, 36], size: [22, 40]}},
     motion: {path: [[0, 14, 36], [0.8, 96, 31, 40]]}}
  ball:
    {label: ball, layer: 3, shape: {circle: {center: [70, 50], radius: 9}},
     motion: {path: [[0, 70, 50], [0.8, 105, 55, 200]]}}
"""
"""A door passes over a tile and hides a post; a ball leaves the picture."""


@dataclass(frozen=True)
class Labelled:
    """A clip's labels, and what made it."""

    scene: Path
    edits: Sequence[str]
    folder: Path

    @cached_property
    def filming(self) -> Film:
        record, warm = RunRecord(scene="again", command=[]), Stages(Keep.NOTHING)
        scene = warm.load(self.scene, self.edits, None, True)
        maps = warm.maps(scene)
        return Film(scene, warm.compile(scene, maps), maps, record, warm)

    @cached_property
    def trajectory(self):
        return pipeline.simulate(self.filming.compiled.world)

    @cached_property
    def frames(self):
        return list(self.filming.frames(self.trajectory))

    @cached_property
    def ids(self) -> list[np.ndarray]:
        return [frame.ids for frame in self.frames]

    @cached_property
    def names(self) -> list[str]:
        return [body.name for body in self.filming.compiled.world.bodies]

    def mask(self, frame: int, name: str) -> np.ndarray:
        """What is seen of a thing."""
        return self.ids[frame] == self.names.index(name) + 1

    @cached_property
    def coco(self) -> COCO:
        with contextlib.redirect_stdout(io.StringIO()):
            return COCO(str(self.folder / "coco" / "annotations.json"))

    @cached_property
    def whole(self) -> dict[tuple[int, str], np.ndarray]:
        """Frame and name -> the mask of all of a thing that the file has, hidden or not."""
        told = (
            self.coco.dataset["annotations"] + self.coco.dataset["hidden_annotations"]
        )
        return {
            (row["image_id"] - 1, self.names[row["track_id"] - 1]): self.coco.annToMask(
                {
                    "image_id": row["image_id"],
                    "segmentation": row["amodal_segmentation"],
                }
            )
            > 0
            for row in told
        }


def labelled(scene: Path, out: Path, formats: str, *edits: str) -> Labelled:
    """Exports a scene with `edits`, in the formats, `coco,mot`."""
    made = pipeline.render_scene(
        scene,
        out,
        overrides=edits,
        formats=(),
        page=pipeline.Page.NONE,
        export=formats.split(","),
    )
    return Labelled(scene, edits, made)


def hall(folder: Path) -> Path:
    """The file of HALL."""
    path = folder / "hall.yaml"
    path.write_text(HALL, encoding="utf-8")
    return path


def scores(data, *metrics):
    """By TrackEval."""
    with contextlib.redirect_stdout(io.StringIO()):
        found, _ = trackeval.Evaluator(QUIET).evaluate([data], list(metrics))
    return next(iter(found.values()))
