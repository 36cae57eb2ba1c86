"""Coverage of frames against what it means: how much of the background shows, and how much area things take."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from pytest import approx

from physgen import pipeline
from physgen.photometry import decode
from physgen.render.camera import exposure_times
from physgen.render.mattes import matte_coverage, matte_stage
from physgen.simulate.engine import simulate

ROOT = Path(__file__).resolve().parents[2]
CODE = 0.0046
"""Half of the widest step between two sRGB codes, in linear light."""
torch.set_num_threads(1)
BALL = """\
physgen: 1
size: [200, 120]
world: {gravity: [0, 500], duration: 0.5}
objects:
  ball: {shape: {circle: {center: [40.3, 30.6], radius: 14}}, velocity: [450, 0], spin: 200, elasticity: 0.8}
  crate: {shape: {box: {center: [150, 90], size: [20, 20]}}}
boundaries: {floor: {segment: [[0, 100], [200, 100]]}}
"""


class Clip:
    """A scene, ready to be drawn as it is or changed."""

    def __init__(self, path: Path, *edits: str, blur: float = 0.0) -> None:
        self.scene = pipeline.load(path, edits)
        self.maps = pipeline.percepts(self.scene)
        compiled = pipeline.compile(self.scene, self.maps)
        self.stage = pipeline.stage(self.scene, compiled, self.maps)
        self.plain = simulate(compiled.world)
        times, self.parts = exposure_times(self.plain, compiled.world, blur)
        self.fine = self.plain if self.parts == 1 else simulate(compiled.world, times)
        self.take = pipeline.shot(self.scene, self.plain)

    def frames(self, stage=None):
        return pipeline.render(stage or self.stage, self.fine, self.parts, self.take)

    def coverage(self) -> list[np.ndarray]:
        return [matte_coverage(frame) for frame in self.frames(matte_stage(self.stage))]


def inside(found: np.ndarray) -> np.ndarray:
    """(H, W): things without their soft borders, of which the last code may lack a little."""
    return cv2.erode((found == 1).astype(np.uint8), np.ones((7, 7))) > 0


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", ["billiards", "dominoes"])
def test_at_first_it_is_the_coverage_of_the_assets_put_together(name: str) -> None:
    clip = Clip(ROOT / "scenes" / name / "scene.yaml", "render.frames=1")
    through = np.ones(clip.stage.background.shape[:2])
    count = np.zeros(through.shape, int)
    for sprite in clip.stage.sprites:
        for (y, x), c in np.ndenumerate(sprite.coverage):
            if c:
                through[sprite.corner[1] + y, sprite.corner[0] + x] *= 1 - c
                count[sprite.corner[1] + y, sprite.corner[0] + x] += 1
    [found] = clip.coverage()
    assert found.dtype == np.float32
    assert np.abs(found - (1 - through)).max() < CODE
    # what the matte role wrote, but where two share a pixel: there each is told for itself, and one hides the other
    asset = clip.maps.coverage
    assert np.abs(found - asset)[count == 1].max() < 2 * CODE
    assert (found <= asset + CODE).all()
    assert not found[asset == 0].any()


@pytest.mark.parametrize(
    ("edits", "blur"),
    [
        ([], 0.0),
        (["render.supersample=3"], 0.0),
        ([], 0.7),
        (["render.size=[128, 96]"], 0.0),
        (
            [
                "render.camera=[{time: 0, zoom: 1.3}, {time: 0.4, zoom: 2.2, follow: ball}]"
            ],
            0.0,
        ),
        (
            [
                "render.camera=[{time: 0, zoom: 1.5, follow: ball}]",
                "render.supersample=2",
                "render.scale=0.7",
            ],
            0.7,
        ),
    ],
    ids=["plain", "supersample", "exposed", "smaller", "camera", "all"],
)
def test_a_frame_shows_as_much_of_the_background_as_coverage_leaves(
    tmp_path: Path, edits, blur
) -> None:
    """The identity that defines it: frame a - frame b = (1 - coverage) (background a - background b)."""
    clip = Clip(written(tmp_path, BALL), *edits, blur=blur)
    one, other = (
        np.full_like(clip.stage.background, code)
        for code in ((30, 60, 200), (140, 90, 120))
    )
    apart = decode(one[0, 0]) - decode(other[0, 0])
    pairs = zip(
        clip.frames(replace(clip.stage, background=one)),
        clip.frames(replace(clip.stage, background=other)),
        clip.coverage(),
        strict=True,
    )
    for a, b, found in pairs:
        difference = decode(a.rgb) - decode(b.rgb)
        assert found.shape == a.rgb.shape[:2]
        off = np.abs(difference - (1 - found[..., None]) * apart)
        assert np.quantile(off, 0.99) < 2 * CODE
        # resampling holds overshoots back, in each channel by what is near: a dark rim bears more than white does
        assert off.max() < (2 * CODE if clip.take.opens_on_photo else 0.06)
        assert 0 < found.mean() < 0.6
        assert not difference[inside(found)].any()


def test_what_the_scene_leaves_out_and_what_bounds_it_is_background(
    tmp_path: Path,
) -> None:
    labels = np.zeros((120, 160), np.uint8)
    cv2.circle(labels, (40, 50), 15, 1, -1)  # the object
    labels[30:70, 70:90] = 2  # of the photo, and not of the scene
    labels[95:] = 3  # a floor
    rgb = np.full((120, 160, 3), 200, np.uint8)
    rgb[labels == 1], rgb[labels == 2], rgb[labels == 3] = (
        (200, 40, 30),
        (20, 40, 160),
        (90, 80, 70),
    )
    (tmp_path / "photo.assets").mkdir()
    cv2.imwrite(str(tmp_path / "photo.png"), rgb[..., ::-1])
    cv2.imwrite(str(tmp_path / "photo.assets/masks.png"), labels)
    text = """\
physgen: 1
image: photo.png
assets: photo.assets
world: {duration: 0.4}
objects: {ball: {mask: 1, velocity: [30, 0]}}
boundaries: {floor: {mask: 3}}
"""
    clip = Clip(written(tmp_path, text))
    near = cv2.dilate((labels == 1).astype(np.uint8), np.ones((13, 13))) > 0
    first = clip.coverage()[0]
    assert first.sum() == approx((labels == 1).sum(), rel=0.05)
    assert not first[~near].any()
    for found in clip.coverage():
        assert not found[110:].any(), "the floor"
        assert not found[:, 80:].any(), "what is left out"


@pytest.mark.slow
def test_sides_of_blocks_that_turned_are_covered() -> None:
    clip = Clip(
        ROOT / "scenes/dominoes/scene.yaml",
        "world.duration=1.5",
        "render.supersample=1",
    )
    *_, frame = clip.frames()
    covered = clip.coverage()[-1]
    assert any(sprite.sides for sprite in clip.stage.sprites)
    for cover in frame.covers:
        assert covered[cover.box][cover.mask].min() > 0.5 - 2 * CODE
