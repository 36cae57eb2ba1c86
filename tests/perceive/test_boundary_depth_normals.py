"""Drawn scenes of known geometry -> edges within 2 px of where it says; the peers' maps -> theirs within 5."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml

from physgen import registry
from physgen.maps import read_labels
from physgen.perceive.photo_objects import fit_objects
from physgen.perceive.roles import BoundaryGuess, Scenery
from physgen.perceive.segment.prompts import from_masks
from physgen.perceive.support.supports import depth_inside
from physgen.photos import read_image
from physgen.problems import InputError
from physgen.scene.scene import View

WIDTH, HEIGHT, FOCAL = 512, 384, 600.0
CX, CY = 255.5, 120.0
"""The horizon lies high: the camera looks down on a table without being tilted, as with a shifted lens."""
DISTANCE = 1.0
"""m from the camera to the plane in which things move."""


@dataclass
class Drawn:
    """Rays against planes, the nearest wins."""

    rgb: np.ndarray = field(
        default_factory=lambda: np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    )
    depth: np.ndarray = field(default_factory=lambda: np.full((HEIGHT, WIDTH), np.inf))
    normals: np.ndarray = field(
        default_factory=lambda: np.tile(np.float32([0, 0, 1]), (HEIGHT, WIDTH, 1))
    )
    labels: np.ndarray = field(
        default_factory=lambda: np.zeros((HEIGHT, WIDTH), np.uint16)
    )
    scenery: np.ndarray = field(
        default_factory=lambda: np.zeros((HEIGHT, WIDTH), np.uint16)
    )

    def __post_init__(self):
        self.y, self.x = np.mgrid[:HEIGHT, :WIDTH]
        self.u, self.v = (self.x - CX) / FOCAL, (self.y - CY) / FOCAL

    def put(self, where, depth, normal, colour, label=0, scenery=0):
        seen = where & (depth < self.depth) & (depth > 0)
        self.depth[seen] = np.broadcast_to(depth, seen.shape)[seen]
        self.normals[seen] = normal
        self.rgb[seen] = colour
        self.labels[seen] = label
        self.scenery[seen] = scenery

    def wall(self, z=3.0):
        self.put(
            self.u > -9, np.full_like(self.u, z), (0, 0, 1), (120, 130, 150), scenery=9
        )

    def level(
        self, y, x0=-9.0, x1=9.0, z0=0.0, z1=9.0, colour=(150, 100, 60), scenery=1
    ):
        with np.errstate(divide="ignore"):
            z = np.where(self.v > 0, y / np.maximum(self.v, 1e-9), 99.0)
        x = self.u * z
        self.put(
            (x >= x0) & (x <= x1) & (z >= z0) & (z <= z1),
            z,
            (0, -1, 0),
            colour,
            scenery=scenery,
        )

    def side(self, x, z0=0.0, z1=9.0, y1=9.0, scenery=2):
        with np.errstate(divide="ignore"):
            z = np.where(self.u > 0, x / np.maximum(self.u, 1e-9), 99.0)
        self.put(
            (z >= z0) & (z <= z1) & (self.v * z <= y1),
            z,
            (-1, 0, 0),
            (160, 80, 60),
            scenery=scenery,
        )

    def front(
        self, x0, x1, y0, y1, z=DISTANCE, colour=(210, 190, 60), label=0, scenery=0
    ):
        x, y = self.u * z, self.v * z
        inside = (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
        self.put(inside, np.full_like(self.u, z), (0, 0, 1), colour, label, scenery)

    def run(
        self, view=None, scenery=False, noise=0.0, scale=1.0, shift=0.0
    ) -> BoundaryGuess:
        random = np.random.default_rng(3)
        depth = np.where(
            np.isfinite(self.depth),
            self.depth,
            self.depth[np.isfinite(self.depth)].max(),
        )
        depth = depth + noise * np.ptp(depth) * random.normal(0, 1, depth.shape)
        normals = self.normals + noise * 6 * random.normal(0, 1, self.normals.shape)
        normals = (normals / np.linalg.norm(normals, axis=2, keepdims=True)).astype(
            np.float32
        )
        things, _ = fit_objects(self.rgb, from_masks(self.labels))
        run = registry.make("boundary", "depth-normals")
        kept = (
            Scenery(self.scenery, {1: "table", 2: "brick wall", 9: "wall"})
            if scenery
            else None
        )
        setting = run(
            self.rgb, self.labels, things, view,
            depth=(scale * depth + shift).astype(np.float32), normals=normals, scenery=kept,
        )  # fmt: skip
        outlines = [setting.outlines.get(t.id, t.outline) for t in things]
        for wall in setting.walls:
            for a, b in pairwise(np.array(wall.points)):
                points = a + np.linspace(0, 1, 50)[:, None] * (b - a)
                assert all(
                    depth_inside(outline, points).max() < 0.1 for outline in outlines
                ), wall
        return setting


def px(x: float, y: float, z: float = DISTANCE) -> tuple[float, float]:
    return CX + FOCAL * x / z, CY + FOCAL * y / z


def off(setting: BoundaryGuess, start, end, bottom=False) -> float:
    """px from an edge to the nearest wall, at most but for 5 % at its ends: mean over it."""
    start, end = np.array(start, float), np.array(end, float)
    points = start + np.linspace(0.03, 0.97, 200)[:, None] * (end - start)
    inside = (points > -0.5).all(1) & (points <= 512).all(1)
    points = points[inside]
    best = np.full(len(points), np.inf)
    for wall in setting.walls:
        if wall.name == "bottom" and not bottom:
            continue
        for a, b in pairwise(np.array(wall.points)):
            t = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-9), 0, 1)
            best = np.minimum(best, np.hypot(*(points - a - t[:, None] * (b - a)).T))
    return float(best.mean())


def table() -> Drawn:
    """A table whose right end is seen, before a wall; two blocks on it."""
    drawn = Drawn()
    drawn.wall()
    drawn.level(0.9, colour=(60, 60, 60), scenery=0)
    drawn.level(0.3, x1=0.25, z1=1.6)
    drawn.front(-0.3, -0.2, 0.15, 0.3, label=1)
    drawn.front(0.0, 0.12, 0.2, 0.3, label=2)
    return drawn


def ramp() -> Drawn:
    """A wedge of 20 degrees on a table, and a block beside it."""
    drawn = Drawn()
    drawn.wall()
    drawn.level(0.3)
    z = DISTANCE - 0.05
    x, y = drawn.u * z, drawn.v * z
    top = 0.3 - (x + 0.05) * np.tan(np.radians(20))
    wedge = (x >= -0.05) & (x <= 0.25) & (y >= top) & (y <= 0.3)
    drawn.put(wedge, np.full_like(x, z), (0, 0, 1), (180, 60, 60), scenery=1)
    drawn.front(-0.3, -0.2, 0.2, 0.3, label=1)
    return drawn


def pool() -> Drawn:
    """Seen from above: a table within cushions, and balls on it."""
    drawn = Drawn()
    drawn.put(drawn.u > -9, np.full_like(drawn.u, 2.0), (0, 0, 1), (30, 120, 60))
    x, y = drawn.x, drawn.y
    rim = (x < 40) | (x > 470) | (y < 30) | (y > 350)
    drawn.put(rim, np.full_like(drawn.u, 1.93), (0, 0, 1), (90, 50, 30))
    for k, (cx, cy) in enumerate(
        [(120, 100), (220, 250), (330, 120), (400, 300), (90, 280)], 1
    ):
        h = 1 - ((x - cx) ** 2 + (y - cy) ** 2) / 18**2
        ball = h > 0
        z = 2.0 - 0.05 - 0.05 * np.sqrt(np.maximum(h, 0))
        n = np.stack([(x - cx) / 18, (y - cy) / 18, np.sqrt(np.maximum(h, 0))], -1)
        drawn.put(ball, z, n[ball & (z < drawn.depth)], (40 * k, 200 - 30 * k, 90), k)
    return drawn


NOISE = [0.0, 0.01]


@pytest.mark.parametrize("noise", NOISE)
def test_a_table_ends_where_it_is_seen_to_end(noise):
    setting = table().run(noise=noise)
    assert setting.view is View.SIDE
    assert off(setting, px(-0.42, 0.3), px(0.25, 0.3)) < 2
    floor = next(w for w in setting.walls if w.name == "floor")
    assert floor.points[-1][0] == pytest.approx(px(0.25, 0.3)[0], abs=8)
    assert floor.source == "depth and lowest points"
    assert not [
        w for w in setting.walls if w.name.startswith(("side", "slope"))
    ]  # its rim is none


@pytest.mark.parametrize("noise", NOISE)
def test_a_wall_beside_the_things_stops_them(noise):
    drawn = table()
    drawn.level(0.3)
    drawn.side(0.2, y1=0.3)
    setting = drawn.run(noise=noise)
    assert off(setting, px(0.2, -0.15), px(0.2, 0.28)) < 3
    assert any(w.name.startswith("side") for w in setting.walls)


@pytest.mark.parametrize("noise", NOISE)
def test_a_ramp_is_as_steep_as_it_is(noise):
    setting = ramp().run(noise=noise)
    z = DISTANCE - 0.05
    rise = 0.3 * np.tan(np.radians(20))
    assert off(setting, px(-0.05, 0.3, z), px(0.25, 0.3 - rise, z)) < 2
    slope = next(w for w in setting.walls if w.name.startswith("slope"))
    (x0, y0), (x1, y1) = slope.points[0], slope.points[-1]
    assert np.degrees(np.arctan2(y0 - y1, x1 - x0)) == pytest.approx(20, abs=1)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_cushions_of_a_table_seen_from_above(noise):
    setting = pool().run(noise=noise)
    assert setting.view is View.TOP
    corners = [(39.5, 29.5), (470.5, 29.5), (470.5, 350.5), (39.5, 350.5)]
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        assert off(setting, start, end) < 2
    assert [w.name for w in setting.walls] == [
        "cushion-1",
        "cushion-2",
        "cushion-3",
        "cushion-4",
    ]


@pytest.mark.parametrize("make", [table, ramp, pool])
def test_any_scale_and_shift_of_depth_gives_the_same_edges(make):
    first = make().run()
    for scale, shift in ((0.001, 5.0), (1000.0, -70.0)):
        other = make().run(scale=scale, shift=shift)
        assert other.view is first.view
        assert [w.name for w in other.walls] == [w.name for w in first.walls]
        for a, b in zip(first.walls, other.walls, strict=True):
            assert np.array(a.points) == pytest.approx(np.array(b.points), abs=0.5)


def test_scenery_far_behind_or_far_in_front_is_left_out():
    drawn = table()
    drawn.front(-0.1, -0.08, -0.05, 0.0, z=0.3, scenery=3)  # a post close to the camera
    drawn.level(0.3)
    drawn.side(0.2, y1=0.3)
    setting = drawn.run(View.SIDE, scenery=True)
    post = px(-0.08, -0.05, 0.3), px(-0.08, 0.0, 0.3)
    assert off(setting, *post) > 5
    assert any(w.name.startswith("side") for w in setting.walls)
    assert off(setting, px(0.2, -0.15), px(0.2, 0.28)) < 3


def test_what_is_no_plane_is_no_edge():
    drawn = table()
    drawn.front(0.3, 0.4, -0.1, 0.5)
    with_it = drawn.run(View.SIDE)
    assert off(with_it, px(0.3, -0.08), px(0.3, 0.2)) < 2
    random = np.random.default_rng(1)
    rough = (drawn.depth == DISTANCE) & (drawn.labels == 0)
    drawn.normals[rough] = random.normal(0, 1, (int(rough.sum()), 3))
    drawn.normals /= np.linalg.norm(drawn.normals, axis=2, keepdims=True)
    assert off(drawn.run(View.SIDE), px(0.3, -0.08), px(0.3, 0.2)) > 5


@pytest.mark.parametrize("depth", [None, np.zeros((HEIGHT, WIDTH), np.float32)])
def test_no_depth_is_said_and_how_to_get_it(depth):
    drawn = table()
    things, _ = fit_objects(drawn.rgb, from_masks(drawn.labels))
    with pytest.raises(InputError) as error:
        registry.make("boundary", "depth-normals")(
            drawn.rgb, drawn.labels, things, None, depth=depth, normals=drawn.normals
        )
    assert "depth=marigold" in str(error.value)


def peer(name: str):
    folder = Path(os.environ["PHYSGEN_PEER_SCENES"], name)
    sim = yaml.safe_load((folder / "sim.yaml").read_text())
    labels = read_labels(folder / "mask.png")
    labels = np.where(np.isin(labels, list(sim["obj_info"])), labels, 0).astype(
        np.uint16
    )
    normals = (np.load(folder / "normal.npy") * (-1, -1, 1)).astype(
        np.float32
    )  # x there points left, y up
    return (
        read_image(folder / "original.png"),
        labels,
        np.load(folder / "depth.npy"),
        normals,
        sim,
    )


@pytest.mark.slow
@pytest.mark.peer_scenes
@pytest.mark.parametrize(
    ("name", "view"),
    [("pool", View.TOP), ("domino", View.SIDE), ("pig_ball", View.SIDE)],
)
def test_peers_edges_are_found(name, view):
    rgb, labels, depth, normals, sim = peer(name)
    things, _ = fit_objects(rgb, from_masks(labels))
    things = [replace(t, label=sim["obj_info"][t.id]["label"]) for t in things]
    run = registry.make("boundary", "depth-normals")
    setting = run(rgb, labels, things, None, depth=depth, normals=normals)
    assert setting.view is view
    for start, end in sim["edge_list"]:
        assert off(setting, start, end, bottom=True) < 5
