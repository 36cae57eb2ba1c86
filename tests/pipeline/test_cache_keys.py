"""The key of unrefined frames: all that they follow from, and nothing else."""

from __future__ import annotations

import ast
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from test_layers import PACKAGE, imports

from physgen import pipeline
from physgen.pipeline.cache_keys import ROOMS, guidance_key
from physgen.report.record import inputs

SCENE = """\
physgen: 1
image: photo.png
assets: scene.assets
world: {duration: 0.25, pixels_per_meter: 500}
objects:
  ball: {mask: 1, mass: 100, label: ball, velocity: [100, 0], from: {mass: table 0.4}}
  block: {mask: 2, density: 2}
boundaries:
  floor: {segment: [[-100, 50], [300, 50]]}
forces:
  - {object: block, impulse: [500, 0]}
  - {object: ball, force: [0, -900], start: 0.1}
light: {direction: [-0.3, -0.8, 0.6]}
render: {fps: 24, size: [96, 64]}
refine: {strength: 0.5, seed: 3}
variants:
  heavy: {objects.ball.mass: 900}
"""
SAME_MEANING = """\
# written by somebody else
refine: {seed: 4, strength: 0.25}
render:
  size: [96.0, 64]   # px
  fps: 24.0
light: {direction: [-0.3, -0.8, 0.6]}
forces:
  - {impulse: [5.0e+2, 0.0], object: "block"}
  - {start: 0.1, object: ball, force: [0, -900]}
boundaries:
  floor:
    segment: [[-100, 50], [300, 50]]
objects:
  block: {density: 2.0, mask: 2}
  ball: {mass: 1.0e+2, mask: 1, velocity: [100, 0], label: a ball}
world: {pixels_per_meter: 500, duration: 0.25, gravity: [0, 4900]}
assets: scene.assets
image: photo.png
physgen: 1
"""
Overrides = list[str]
KEPT: list[Overrides] = [
    ["refine.backend=none"],
    ["refine.strength=0.3"],
    ["refine.stop=3"],
    ["refine.steps=20"],
    ["refine.seed=9"],
    ["refine.prompt=a marble"],
    ["refine.negative=blur"],
    ["refine.guidance=3"],
    ["refine.lock=1"],
    ["refine.detail=0.5"],
    ["render.play=backward"],
    ["render.play=there-and-back"],
    ["render.overlay=[names, velocity]"],
    ["objects.ball.label=marble"],
]
CHANGED: list[Overrides] = [
    ["forces[0].impulse=[501, 0]"],
    ["forces[1].start=0.11"],
    ["objects.ball.mass=101"],
    ["objects.ball.friction=0.4"],
    ["objects.block.layer=1"],
    ["world.duration=0.5"],
    ["world.gravity=[0, 0]"],
    ["world.steps_per_second=480"],
    ["boundaries.floor.segment=[[-100, 51], [300, 51]]"],
    ["light.direction=[0.3, -0.8, 0.6]"],
    ["light.softness=7"],
    ["render.size=[48, 32]"],
    ["render.supersample=2"],
    ["render.shadows=false"],
    ["render.relight=false"],
    ["render.motion_blur=0.5"],
    ["render.fps=25"],
    ["render.slow=2"],
    ["render.camera={zoom: 2}"],
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A drawn photo of a ball and a block, its masks, and the scene."""
    rng = np.random.default_rng(1)
    photo, masks = np.full((64, 96, 3), 120.0), np.zeros((64, 96), np.uint16)
    y, x = np.mgrid[:64, :96]
    masks[np.hypot(y - 38, x - 25) <= 11] = 1
    masks[30:50, 60:72] = 2
    photo[masks == 1], photo[masks == 2] = (200, 90, 40), (40, 160, 90)
    photo = np.clip(photo + rng.normal(0, 3, photo.shape), 0, 255).astype(np.uint8)
    home = tmp_path / "home"
    (home / "scene.assets").mkdir(parents=True)
    cv2.imwrite(str(home / "photo.png"), photo)
    cv2.imwrite(str(home / "scene.assets" / "masks.png"), masks)
    (home / "scene.yaml").write_text(SCENE)
    return home


def of(path: Path, overrides: Overrides | tuple[()] = (), variant: str | None = None) -> str:
    scene = pipeline.load(path, overrides, variant)
    return guidance_key(scene, inputs(scene, path))


@pytest.mark.parametrize("overrides", KEPT, ids=lambda o: o[0])
def test_what_comes_afterwards_keeps_the_key(overrides: Overrides, folder: Path) -> None:
    assert of(folder / "scene.yaml", overrides) == of(folder / "scene.yaml")


@pytest.mark.parametrize("overrides", CHANGED, ids=lambda o: o[0])
def test_what_frames_follow_from_changes_it(overrides: Overrides, folder: Path) -> None:
    assert of(folder / "scene.yaml", overrides) != of(folder / "scene.yaml")


def test_the_file_counts_by_what_it_means(folder: Path) -> None:
    before = of(folder / "scene.yaml")
    (folder / "other.yaml").write_text(SAME_MEANING)
    assert of(folder / "other.yaml") == before
    (folder / "child.yaml").write_text("physgen: 1\nextends: scene.yaml\n")
    assert of(folder / "child.yaml") == before


def test_a_copy_elsewhere_has_the_same_key(folder: Path, tmp_path: Path) -> None:
    before = of(folder / "scene.yaml")
    shutil.copytree(folder, tmp_path / "away")
    assert of(tmp_path / "away" / "scene.yaml") == before
    (tmp_path / "away" / "photo.png").rename(tmp_path / "away" / "renamed.png")
    scene = tmp_path / "away" / "scene.yaml"
    scene.write_text(SCENE.replace("photo.png", "renamed.png"))
    assert of(scene) == before


def _edited(path: Path) -> None:
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    picture[0, 0] = 1
    cv2.imwrite(str(path), picture)


@pytest.mark.parametrize("file", ["photo.png", "scene.assets/masks.png"])
def test_a_pixel_changes_it(file: str, folder: Path) -> None:
    before = of(folder / "scene.yaml")
    _edited(folder / file)
    assert of(folder / "scene.yaml") != before


@pytest.mark.parametrize(
    "name", ["coverage", "background", "clean", "shadows", "depth", "normals", "albedo", "shading"]
)
def test_a_map_more_changes_it_and_other_files_do_not(name: str, folder: Path) -> None:
    before = of(folder / "scene.yaml")
    cv2.imwrite(str(folder / "scene.assets" / "notes.png"), np.zeros((64, 96), np.uint8))
    assert of(folder / "scene.yaml") == before
    cv2.imwrite(str(folder / "scene.assets" / f"{name}.png"), np.zeros((64, 96), np.uint8))
    assert of(folder / "scene.yaml") != before


def _path(name: str) -> Path | None:
    bare = PACKAGE.parent / name.replace(".", "/")
    return next((p for p in (bare.with_suffix(".py"), bare / "__init__.py") if p.exists()), None)


def test_all_code_that_makes_frames_is_counted() -> None:
    """Whatever the pipeline's steps import, and what that imports: none lies outside the rooms."""
    steps = {"load", "percepts", "compile", "simulate", "stage", "filled", "shot", "render"}
    tree = ast.parse((PACKAGE / "pipeline" / "stages.py").read_text(encoding="utf-8"))
    todo = list[str]()
    for step in tree.body:
        if isinstance(step, ast.FunctionDef) and step.name in steps:
            steps.remove(step.name)
            found = [n for n in ast.walk(step) if isinstance(n, ast.ImportFrom)]
            todo += [f"{n.module}" for n in found]
            todo += [f"{n.module}.{a.name}" for n in found for a in n.names if _path(f"{n.module}.{a.name}")]
    assert not steps
    seen: set[Path] = set()
    while todo:
        name = todo.pop()
        path = _path(name)
        if path is None or path in seen:
            continue
        seen.add(path)
        todo += [other for _, other in imports(name) if other.startswith("physgen")]
    assert len(seen) > 40
    outside = {p.relative_to(PACKAGE).parts[0] for p in seen if p.parent != PACKAGE} - set(ROOMS)
    assert not outside
    assert "pipeline" in ROOMS  # what calls them


def test_no_code_that_makes_frames_reads_what_the_key_leaves_out() -> None:
    left_out = {"label", "provenance", "prompt", "refine", "document", "variants", "overlay"}
    beside = ("compile/warnings.py", "simulate/uncertain")  # warnings are told on every run
    for room in ("compile", "simulate", "render", "geometry"):
        for path in sorted((PACKAGE / room).rglob("*.py")):
            name = path.relative_to(PACKAGE).as_posix()
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Attribute) and node.attr in left_out and not name.startswith(beside):
                    raise AssertionError(f"{name}:{node.lineno} reads {node.attr}")
