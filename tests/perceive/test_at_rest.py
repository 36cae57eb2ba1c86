"""Drawn photos with true masks: what perception makes of them stands still when nothing pushes."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.compile.compile import compile_scene
from physgen.geometry.polygon import Disc, Region, Ring
from physgen.perceive.backends.boundary_support import support
from physgen.perceive.perceive import perceive
from physgen.perceive.photo_objects import fit_objects
from physgen.perceive.scene_files import write_scene
from physgen.perceive.segment.prompts import from_masks
from physgen.perceive.support.box_outlines import fit_rectangle
from physgen.perceive.support.supports import depth_inside, free_parts
from physgen.scene.scene import View
from physgen.simulate.engine import simulate
from tests.perceive.lambertian import block

W, H = 256, 192


class Photo:
    """A wall over a floor, and things drawn on it."""

    def __init__(self, horizon: int = 130, top: bool = False) -> None:
        self.rgb = np.full((H, W, 3), (90, 120, 160), np.uint8)
        self.rgb[horizon:] = (150, 100, 60)
        if top:
            self.rgb[:] = (40, 120, 70)
        self.labels = np.zeros((H, W), np.uint16)

    def _draw(self, inside: np.ndarray) -> None:
        number = int(self.labels.max()) + 1
        self.labels[inside & (self.labels == 0)] = number
        self.rgb[self.labels == number] = [
            (200, 60, 50),
            (60, 70, 200),
            (220, 200, 60),
        ][number % 3]

    def polygon(self, points: np.ndarray) -> None:
        mask = np.zeros((H, W), np.uint8)
        cv2.fillPoly(
            mask, [np.round(np.asarray(points) * 16).astype(np.int32)], 1, shift=4
        )
        self._draw(mask > 0)

    def box(self, x: float, y: float, w: float, h: float, degrees: float = 0.0) -> None:
        """Its lower left corner at x, y; turned about it."""
        a = np.radians(degrees)
        along, up = np.array([np.cos(a), np.sin(a)]), np.array([np.sin(a), -np.cos(a)])
        start = np.array([x, y])
        self.polygon(
            np.array(
                [start, start + w * along, start + w * along + h * up, start + h * up]
            )
        )

    def ball(self, x: float, y: float, r: float) -> None:
        """Resting at height y."""
        rows, columns = np.mgrid[:H, :W]
        self._draw(np.hypot(columns - x, rows - y + r) <= r)


def slope() -> Photo:
    photo = Photo()
    a = np.tan(np.radians(20))
    photo.rgb[(np.mgrid[:H, :W][0] - 70) > a * np.mgrid[:H, :W][1]] = (120, 120, 120)
    for x in (40, 110):
        photo.box(x, 70 + a * x, 40, 26, 20)
    return photo


def corner() -> Photo:
    photo = Photo()
    photo.box(180, 165, 30, 90)
    photo.ball(159, 165, 20)
    return photo


def stack() -> Photo:
    photo = Photo()
    for k, (x, w) in enumerate(((80, 70), (88, 52), (95, 40))):
        photo.box(x, 165 - 31 * k, w, 30)
    return photo


def levels() -> Photo:
    photo = Photo()
    photo.rgb[80:86, 120:] = (240, 240, 230)
    for x in (20, 60, 96):
        photo.box(x, 165, 18, 40)
    photo.box(140, 79, 24, 30)
    photo.ball(210, 79, 14)
    return photo


def plank() -> Photo:
    photo = Photo()
    photo.rgb[:, 190:] = (60, 50, 50)
    photo.polygon(np.array([[150, 165], [156, 165], [189, 70], [184, 68]]))
    photo.box(30, 165, 40, 40)
    return photo


def from_above() -> Photo:
    photo = Photo(top=True)
    for x, y in ((40, 60), (90, 150), (150, 70), (200, 170), (220, 60), (120, 110)):
        photo.ball(x, y, 14)
    return photo


DRAWN: list[Callable[[], Photo]] = [slope, corner, stack, levels, plank, from_above]


@pytest.mark.slow
@pytest.mark.parametrize("draw", DRAWN, ids=lambda draw: draw.__name__)
def test_what_nobody_pushes_stays(draw, tmp_path):
    photo = draw()
    perceived = perceive(photo.rgb, from_masks(photo.labels))
    assert perceived.document["world"]["view"] == (
        "top" if draw is from_above else "side"
    )
    assert not any(
        one.get("motion") == "static" for one in perceived.document["objects"].values()
    )
    path = tmp_path / "scene.yaml"
    write_scene(perceived, None, "photo", path)
    scene = pipeline.load(path, ["forces=[]", "world.duration=2"])
    poses = pipeline.simulate(
        compile_scene(scene, perceived.percepts.labels).world
    ).poses
    assert np.hypot(*np.moveaxis(poses[..., :2] - poses[:1, :, :2], -1, 0)).max() <= 1.0


@pytest.mark.slow
def test_what_goes_without_a_push_is_held(tmp_path):
    """A ball before a large disc, of which a crescent is seen: it pushes itself away from the ball."""
    rows, columns = np.mgrid[:300, :400]
    rgb, labels = (
        np.full((300, 400, 3), (90, 120, 160), np.uint8),
        np.zeros((300, 400), np.uint8),
    )
    rgb[220:] = (150, 100, 60)
    for k, (x, y, r) in enumerate(((150, 180, 80), (230, 200, 60)), 1):
        inside = np.hypot(columns - x, rows - y) <= r
        labels[inside], rgb[inside] = k, ((60, 70, 200), (220, 200, 60))[k - 1]
    cv2.imwrite(str(tmp_path / "photo.png"), rgb[..., ::-1])
    cv2.imwrite(str(tmp_path / "masks.png"), labels)
    path = tmp_path / "scene.yaml"
    text = pipeline.perceive(
        tmp_path / "photo.png", path, masks=tmp_path / "masks.png", still=True
    )
    assert "motion: static  # it would not stay there, so it is held" in text
    world = pipeline.compile(
        pipeline.load(path), pipeline.percepts(pipeline.load(path))
    ).world
    poses = simulate(world, np.linspace(0, 2, 21)).poses
    assert np.hypot(*np.moveaxis(poses[..., :2] - poses[:1, :, :2], -1, 0)).max() <= 1.0


def perceived_walls(photo: Photo, labels: np.ndarray, rgb: np.ndarray):
    things, _ = fit_objects(rgb, from_masks(labels))
    return things, support()(
        np.ascontiguousarray(rgb), np.ascontiguousarray(labels), things, None
    )


@pytest.mark.parametrize("draw", DRAWN, ids=lambda draw: draw.__name__)
def test_supports_enter_no_shape(draw):
    photo = draw()
    things, setting = perceived_walls(photo, photo.labels, photo.rgb)
    for wall in setting.walls[1:]:
        for a, b in zip(wall.points, wall.points[1:], strict=False):
            along = np.linspace(a, b, 400)
            for thing in things:
                assert (
                    depth_inside(
                        setting.outlines.get(thing.id, thing.outline), along
                    ).max()
                    <= 0.12
                ), wall


@pytest.mark.parametrize("draw", [slope, levels, stack], ids=lambda draw: draw.__name__)
def test_a_mirrored_photo_has_mirrored_supports(draw):
    photo = draw()
    _, one = perceived_walls(photo, photo.labels, photo.rgb)
    _, other = perceived_walls(photo, photo.labels[:, ::-1], photo.rgb[:, ::-1])
    assert one.view is other.view
    assert one.confidence == pytest.approx(other.confidence, abs=0.1)
    assert len(one.walls) == len(other.walls)
    for wall in one.walls[1:]:
        points = np.array(wall.points)
        middle = points[len(points) // 2]
        mirrored = [
            (W - 1 - np.array(w.points)[::-1, 0], np.array(w.points)[::-1, 1])
            for w in other.walls[1:]
        ]
        gaps = [
            abs(np.interp(middle[0], x, y) - middle[1])
            for x, y in mirrored
            if x[0] - 1 <= middle[0] <= x[-1] + 1
        ]
        assert min(gaps, default=99.0) <= 1.0, wall.name


def test_a_slope_is_as_steep_as_it_is_and_holds_by_friction():
    photo = slope()
    things, setting = perceived_walls(photo, photo.labels, photo.rgb)
    (wall,) = [w for w in setting.walls if w.name.startswith("slope")]
    (x0, y0), (x1, y1) = wall.points[0], wall.points[-1]
    assert np.degrees(np.arctan2(y1 - y0, x1 - x0)) == pytest.approx(20, abs=1)
    least = np.tan(np.radians(20))
    assert wall.friction > least
    assert all(setting.grip[t.id] > least for t in things)


def test_a_chain_is_cut_where_it_would_enter_something():
    parts = free_parts(
        [(0.0, 10.0), (100.0, 10.0)],
        [block(40, 20, 20, 20), Disc(np.array([90.0, 10.0]), 5.0)],
    )
    assert [p[0][0] for p in parts] == pytest.approx([0, 60, 95], abs=0.6)
    assert [p[-1][0] for p in parts] == pytest.approx([40, 85, 100], abs=0.6)


def test_a_ragged_rectangle_is_a_box_and_a_trapezium_is_none():
    rng = np.random.default_rng(1)
    along = np.linspace(0, 1, 12)[:-1, None]
    true = np.array([[20.0, 20], [44, 20], [44, 90], [20, 90]])
    border = np.concatenate(
        [
            a + along * (b - a)
            for a, b in zip(true, np.roll(true, -1, axis=0), strict=True)
        ]
    )
    box = fit_rectangle(Region((Ring(border + rng.uniform(-0.4, 0.4, border.shape)),)))
    assert box is not None
    assert (
        np.abs(np.sort(box.rings[0].outer, axis=0) - np.sort(true, axis=0)).max() < 0.6
    )
    slanted = np.array([[24.0, 20], [40, 20], [44, 90], [20, 90]])
    assert fit_rectangle(Region((Ring(slanted),))) is None


@pytest.mark.parametrize("between", [True, False])
def test_a_ledge_between_others_ends_within_what_lies_on_it(between: bool) -> None:
    """Where the wall meets the floor, and so as far as the photo shows it, unless others stand in the way."""
    photo = Photo(horizon=150)
    photo.box(104, 150, 32, 40)
    for x in (60, 140) if between else (10, 30):
        photo.box(x, 170, 39 if between else 15, 40)
    found = fit_objects(photo.rgb, from_masks(photo.labels))[0]
    walls = {
        wall.name: wall
        for wall in support()(photo.rgb, photo.labels, found, View.SIDE).walls
    }
    first, last = walls["ledge-1"].points[0][0], walls["ledge-1"].points[-1][0]
    assert (first >= 103 and last <= 137) is between
    assert min(last - 104, 136 - first) > 20
