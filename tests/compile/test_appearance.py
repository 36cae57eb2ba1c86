"""An object that a scene puts elsewhere: it begins there, falls from there, and looks as the photo shows it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from written import loaded, world

from physgen import pipeline
from physgen.compile.world import appearance, body_in_photo
from physgen.export.correspondence import photo_view
from physgen.render.stage import Frame

ROOT = Path(__file__).resolve().parents[2]
SCENE = """\
physgen: 1
size: [400, 300]
world: {duration: 0.4, gravity: [0, 500]}
objects:
  crate: {shape: {polygon: [[100, 100], [140, 100], [140, 120], [110, 130]]}%s}
  ball: {shape: {circle: {center: [250, 80], radius: 12}}, velocity: [30, 0]}
boundaries: {floor: {segment: [[-900, 260], [900, 260]]}}
"""


def test_it_begins_at_its_place_and_falls_from_there(tmp_path: Path) -> None:
    """Galileo's law from the place; everything else as if it had never been moved."""
    put = pipeline.simulate(world(tmp_path, SCENE % ", place: [60, 40, 90]"))
    left = pipeline.simulate(world(tmp_path, SCENE % ""))
    assert put.names == ("ball", "crate")
    np.testing.assert_allclose(put.poses[0, 1], [60, 40, 0], atol=1e-9)
    t = put.times
    np.testing.assert_allclose(put.poses[:, 1, 1], 40 + 500 * t**2 / 2, atol=1e-6)
    assert np.array_equal(put.poses[:, 0], left.poses[:, 0])


def test_to_put_it_is_to_write_its_corners_there(tmp_path: Path) -> None:
    """A quarter of a turn takes +x to +y: corners turned by hand about the centre of mass move the same way."""
    before = world(tmp_path, SCENE % "").bodies[1]
    corners = (
        np.array([[100, 100], [140, 100], [140, 120], [110, 130]], np.float64)
        - before.center
    )
    there = [[60 - y, 40 + x] for x, y in corners.tolist()]
    text = SCENE.replace("[[100, 100], [140, 100], [140, 120], [110, 130]]", str(there))
    one, other = (
        pipeline.simulate(
            world(tmp_path, SCENE % ", place: [60, 40, 90]", "world.duration=1")
        ),
        pipeline.simulate(world(tmp_path, text % "", "world.duration=1")),
    )
    assert np.abs(one.poses[-1, 1] - one.poses[0, 1]).max() > 20
    np.testing.assert_allclose(one.poses, other.poses, atol=1e-5)


def test_a_label_changes_what_an_object_looks_like(tmp_path: Path) -> None:
    """Labels of one kind have one picture: a metal ball mirrors, a wooden one does not."""
    scenes = [
        loaded(tmp_path, SCENE % "", f"objects.ball.label={label}")
        for label in ("wooden ball", "brass ball", "oak ball", "mug", "book")
    ]
    first, metal, other, mug, book = (
        appearance(one, pipeline.compile(one, None).world) for one in scenes
    )
    assert str(first) == str(other)
    assert len({str(one) for one in (first, metal, mug, book)}) == 4


@pytest.fixture(scope="module")
def shown() -> tuple[Frame, Frame, np.ndarray]:
    """The first frames of the dominoes as they are, and with one put upside down elsewhere; its place before."""
    frames = []
    for edits in ((), ("objects.domino-9.place=[880, 200, 180]",)):
        scene = pipeline.load(
            ROOT / "scenes" / "dominoes" / "scene.yaml",
            (*edits, "render.frames=1", "render.overlay=[]"),
        )
        maps = pipeline.percepts(scene)
        compiled = pipeline.compile(scene, maps)
        run = pipeline.simulate(compiled.world)
        frames.append(
            next(iter(pipeline.render(pipeline.stage(scene, compiled, maps), run)))
        )
    still = photo_view(run, compiled.world)
    return frames[0], frames[1], still.poses[8]


def test_the_picture_goes_along_and_nothing_is_left_behind(
    shown: tuple[Frame, Frame, np.ndarray],
) -> None:
    """Half a turn is a flip of both axes: pixels of the one frame against those of the other."""
    before, after, rest = shown
    was, now = before.ids == 9, after.ids == 9
    x, y = rest[:2]
    assert rest[2] == pytest.approx(-np.pi)
    matrix = np.array([[-1.0, 0, x + 880], [0, -1, y + 200]])
    turned = cv2.warpAffine(
        before.rgb, matrix, before.rgb.shape[1::-1], flags=cv2.INTER_CUBIC
    )
    mask = (
        cv2.warpAffine(
            was.astype(np.uint8), matrix, was.shape[::-1], flags=cv2.INTER_NEAREST
        )
        > 0
    )
    # light on its rounded edges stays where it comes from
    inner = cv2.erode((mask & now).astype(np.uint8), np.ones((13, 13))) > 0
    assert np.count_nonzero(mask ^ now) < 0.03 * now.sum()
    off = np.abs(turned.astype(int) - after.rgb)[inner]
    assert off.mean() < 4
    assert not (now & was).any()
    assert np.abs(before.rgb.astype(int) - after.rgb)[was].mean() > 20


def test_where_nothing_was_put_elsewhere_nothing_changes(
    shown: tuple[Frame, Frame, np.ndarray],
) -> None:
    """Far from both places the two frames are one."""
    before, after, _ = shown
    assert np.array_equal(before.rgb[:, :500], after.rgb[:, :500])


def test_what_is_drawn_over_the_photo_is_where_the_photo_shows_it(
    shown: tuple[Frame, Frame, np.ndarray],
) -> None:
    """The body as the photo shows it has the corners that it has where nothing was moved."""
    text = ROOT / "scenes" / "dominoes" / "scene.yaml"
    bodies = []
    for edits in ((), ("objects.domino-9.place=[880, 200, 140]",)):
        scene = pipeline.load(text, edits)
        world = pipeline.compile(scene, pipeline.percepts(scene)).world
        bodies.append(body_in_photo(world.bodies[8]))
    np.testing.assert_allclose(
        bodies[1].rings[0] + bodies[1].center,
        bodies[0].rings[0] + bodies[0].center,
        atol=1e-9,
    )
    np.testing.assert_allclose(bodies[1].pieces[0], bodies[0].pieces[0], atol=1e-9)
