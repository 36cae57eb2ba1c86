"""The slider of relighting: a ball that has turned is bright towards the light, and as a cut-out it is not."""

from __future__ import annotations

import base64
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from physgen import pipeline
from physgen.photometry import DistantLight, encode_u8, sphere_normals
from physgen.report.perception import Comparison, Picture, relighting_comparison

SIZE, RADIUS = (160, 120), 22
WHERE = np.array([70, 55])
LIGHT = (-0.8, -0.2, 0.566)
SCENE = f"""\
physgen: 1
image: photo.png
assets: maps
world: {{gravity: [0, 0], duration: 0.5}}
objects:
  ball: {{mask: 1, solid: sphere, shape: {{circle: {{center: {WHERE.tolist()}, radius: {RADIUS}}}}}, spin: 360}}
light: {{direction: {list(LIGHT)}, intensity: 0.9, ambient: 0.1}}
"""


def pair(tmp_path: Path, *overrides: str) -> Comparison | None:
    """Of a white ball before grey that turns by half a turn."""
    width, height = SIZE
    normals, inside = sphere_normals(height, width, tuple(WHERE.tolist()), RADIUS)
    shade = 0.8 * DistantLight(LIGHT, 0.9, 0.1).shade(normals)
    rgb = encode_u8(np.repeat(np.where(inside, shade, 0.2)[..., None], 3, axis=2).astype(np.float32))
    Image.fromarray(rgb).save(tmp_path / "photo.png")
    (tmp_path / "maps").mkdir(exist_ok=True)
    Image.fromarray(inside.astype(np.uint16)).save(tmp_path / "maps" / "masks.png")
    (tmp_path / "scene.yaml").write_text(SCENE)
    scene = pipeline.load(tmp_path / "scene.yaml", overrides)
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    return relighting_comparison(pipeline.stage(scene, compiled, maps), pipeline.simulate(compiled.world))


def towards(picture: Picture) -> np.ndarray:
    """(2,) px from the middle of the ball to the middle of its light."""
    data = base64.b64decode(picture.uri.split(",")[1])
    grey = np.asarray(Image.open(io.BytesIO(data)).convert("L"), np.float64)
    y, x = np.indices(grey.shape)
    ball = np.abs(grey - np.median(grey)) > 25
    box = [(axis[ball].min() + axis[ball].max()) / 2 for axis in (x, y)]
    away = np.stack([x - box[0], y - box[1]])
    own = np.hypot(*away) < 0.8 * RADIUS
    return (away[:, own] * grey[own]).sum(axis=1) / grey[own].sum()


def test_relit_the_bright_side_faces_the_light(tmp_path: Path) -> None:
    found = pair(tmp_path)
    assert found is not None
    way = np.array(LIGHT[:2]) / np.hypot(*LIGHT[:2])
    after, before = towards(found.after), towards(found.before)
    assert after @ way > 0.95 * np.hypot(*after) > 2
    assert before @ way < -0.9 * np.hypot(*before), "half a turn took its light along"


@pytest.mark.parametrize(
    "override", ["objects.ball.spin=0", "render.relight=false", "objects.ball.solid=disc", "render.frames=1"]
)
def test_where_nothing_is_relit_there_is_none(tmp_path: Path, override: str) -> None:
    assert pair(tmp_path, override) is None


def test_the_report_has_it_and_the_plain_one_has_not(tmp_path: Path) -> None:
    pair(tmp_path)
    for page in (pipeline.Page.FULL, pipeline.Page.PLAIN):
        folder = pipeline.render_scene(tmp_path / "scene.yaml", tmp_path / page.value, page=page)
        text = (folder / "report.html").read_text()
        assert ('<b dir="auto">Relighting.</b>' in text) is (page is pipeline.Page.FULL)
