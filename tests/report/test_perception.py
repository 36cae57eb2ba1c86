"""Pictures of what was perceived, decoded by another library."""

from __future__ import annotations

import base64
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from physgen import pipeline
from physgen.maps import Percepts
from physgen.report.html import template
from physgen.report.perception import (
    Picture,
    compare_frames,
    light_picture,
    perception,
)
from physgen.scene.scene import Light

LESSON = """\
physgen: 1
image: photo.png
assets: maps
objects:
  ball: {shape: {circle: {center: [60, 40], radius: 20}}, mask: 1}
  crate: {shape: {box: {center: [150, 70], size: [40, 40]}}, mask: 2}
boundaries:
  floor: {segment: [[-100, 90], [300, 90]]}
light: {direction: [-0.6, -0.64, 0.48], intensity: 1.0, ambient: 0.25}
"""


def scene(tmp_path: Path, size: tuple[int, int] = (200, 100)):
    """A scene, compiled, with every map there is; they are noise where nothing else is said."""
    rng = np.random.default_rng(1)
    width, height = size
    rgb = rng.integers(0, 255, (height, width, 3), np.uint8)
    Image.fromarray(rgb).save(tmp_path / "photo.png")
    y, x = np.mgrid[:height, :width]
    labels = np.where(np.hypot(x - 60, y - 40) < 20, 1, 0).astype(np.uint16)
    labels[50:90, 130:170] = 2
    (tmp_path / "maps").mkdir()
    Image.fromarray(labels).save(tmp_path / "maps/masks.png")
    path = tmp_path / "lesson.yaml"
    path.write_text(LESSON)
    made = pipeline.load(path)
    noise = rng.normal(size=(height, width, 3))
    maps = Percepts(
        rgb=rgb,
        labels=labels,
        background=rgb,
        clean=rgb[::-1].copy(),
        shadows=labels,
        depth=x.astype(np.float32),
        normals=(noise / np.linalg.norm(noise, axis=2, keepdims=True)).astype(
            np.float32
        ),
        albedo=(rgb / 255).astype(np.float32),
        shading=rng.random((height, width)).astype(np.float32),
    )
    return made, pipeline.compile(made, maps), maps


def pixels(picture: Picture) -> np.ndarray:
    data = base64.b64decode(picture.uri.removeprefix("data:image/webp;base64,"))
    with Image.open(io.BytesIO(data)) as image:
        assert image.format == "WEBP"
        return np.asarray(image.convert("RGB")).astype(int)


def test_every_map_has_its_picture_and_those_that_are_not_there_have_none(
    tmp_path: Path,
) -> None:
    made, compiled, maps = scene(tmp_path)
    strip = perception(made, compiled, maps)
    names = [picture.name for picture in strip.pictures]
    assert names == [
        "photo",
        "masks",
        "shapes",
        "depth",
        "normals",
        "albedo",
        "shading",
        "light",
        "shadows",
    ]
    assert all(
        picture.alt and picture.title and picture.caption for picture in strip.pictures
    )
    assert [comparison.before.width for comparison in strip.comparisons] == [200]
    bare = perception(
        replace(made, light=None),
        compiled,
        Percepts(maps.rgb, maps.labels, background=maps.rgb),
    )
    assert [picture.name for picture in bare.pictures] == [
        "photo",
        "masks",
        "shapes",
        "background",
    ]
    assert bare.comparisons == ()
    assert perception(made, compiled, None) is None


def test_pictures_show_what_the_maps_say(tmp_path: Path) -> None:
    made, compiled, maps = scene(tmp_path)
    seen = {
        picture.name: pixels(picture)
        for picture in perception(made, compiled, maps).pictures
    }
    assert seen["photo"].shape == (100, 200, 3)
    ball, crate, beside = (
        seen["masks"][y, x] for y, x in ((40, 60), (70, 150), (20, 110))
    )
    assert np.ptp(ball) > 60
    assert np.ptp(crate) > 60
    assert np.abs(ball - crate).max() > 80
    assert np.ptp(beside) < 40  # in grey
    assert (
        seen["depth"][:, :20].mean() > seen["depth"][:, -20:].mean() + 80
    )  # near is bright
    floor = seen["shapes"][88:93, 185].max(axis=0)
    assert floor[0] > 150 > floor[2]  # yellow


@pytest.mark.parametrize(
    "direction", [(-0.6, -0.64, 0.48), (0.8, 0.0, 0.6), (0.0, 0.6, 0.8)]
)
def test_the_ball_is_brightest_where_the_light_comes_from(
    direction: tuple[float, float, float],
) -> None:
    card = light_picture(Light(direction, 1.0, 0.2, 2.0), (300, 200)).astype(int)
    y, x = np.mgrid[:200, :300]
    grey = np.ptp(card, axis=2) < 8
    ball = (np.hypot(x - 149.5, y - 99.5) < 48) & grey
    weight = card[..., 1] * ball
    way = np.array([(weight * (x - 149.5)).sum(), (weight * (y - 99.5)).sum()]) - [
        weight.sum() / ball.sum() * ((x - 149.5) * ball).sum(),
        weight.sum() / ball.sum() * ((y - 99.5) * ball).sum(),
    ]
    expected = np.array(direction[:2]) / np.hypot(*direction[:2])
    assert way @ expected / np.hypot(*way) > 0.97


def test_a_slider_is_named_and_all_words_are_escaped() -> None:
    one, other = np.zeros((20, 30, 3), np.uint8), np.full((20, 30, 3), 255, np.uint8)
    pair = compare_frames(
        "relit", "<script>", "a < b", ("not <b>", one), ("relit", other)
    )
    assert pixels(pair.before).max() < 10
    assert pixels(pair.after).min() > 245
    page = template("compare.html.j2").module.compare(pair)
    assert "<script>" not in page
    assert "<b>" not in page.replace('<b dir="auto">', "")
    assert 'aria-label="&lt;script&gt;: how much is shown not &lt;b&gt;"' in page
    with pytest.raises(ValueError):
        compare_frames("relit", "", "", ("", one), ("", other[:5]))


def test_report_draws_doubtful_regions_dashed(tmp_path: Path) -> None:
    made, _, maps = scene(tmp_path)
    labels = maps.labels.copy()
    labels[10:40, 150:190] = 3
    maps = replace(maps, labels=labels)
    path = tmp_path / "lesson.yaml"
    pictures = {}
    for text in (LESSON, LESSON + "doubtful: {maybe-1: {mask: 3, confidence: 0.3}}\n"):
        path.write_text(text)
        made = pipeline.load(path)
        strip = perception(made, pipeline.compile(made, maps), maps)
        assert strip is not None
        pictures[len(pictures)] = strip.pictures[2]
    assert "maybe-1" in pictures[1].caption
    assert "maybe-1" not in pictures[0].caption
    changed = np.abs(pictures[0].rgb.astype(int) - pictures[1].rgb).max(axis=2) > 30
    rows, columns = np.nonzero(changed)
    assert (rows.min(), rows.max()) == pytest.approx((10, 39), abs=2)
    assert (columns.min(), columns.max()) == pytest.approx((150, 189), abs=2)
    border = 2 * (30 + 40)
    assert 0.3 * border < np.count_nonzero(changed) < 3 * border
