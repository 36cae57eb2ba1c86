"""Overlays lie where closed forms say, at the time they say, and nowhere else."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pytest

from physgen import pipeline
from physgen.render.contacts import contact_points_between
from physgen.render.overlay import annotate_frames, describe_clip
from physgen.render.scales import COLOURS
from physgen.scene.scene import Overlay

THROWN = """\
physgen: 1
size: [480, 300]
world: {duration: 0.6, gravity: [0, 900]}
objects:
  ball: {shape: {circle: {center: [240, 220], radius: 30}}, mass: 500, velocity: [220, -420], spin: 300}
"""
DROPPED = """\
physgen: 1
size: [480, 300]
world: {duration: 1.0, gravity: [0, 900]}
objects:
  light: {shape: {circle: {center: [260, 140], radius: 20}}, mass: 100, elasticity: 1, friction: 0}
  heavy: {shape: {circle: {center: [400, 140], radius: 20}}, mass: 400, elasticity: 1, friction: 0}
boundaries: {floor: {segment: [[0, 260], [480, 260]], elasticity: 1, friction: 0}}
render: {fps: 50}
"""
PUSHED = """\
physgen: 1
size: [400, 300]
world: {gravity: [0, 0], duration: 1.0}
objects:
  one: {shape: {box: {center: [250, 80], size: [30, 30]}}, mass: 1.0e6}
  two: {shape: {box: {center: [250, 180], size: [30, 30]}}, mass: 1.0e6}
  turned: {shape: {circle: {center: [340, 240], radius: 20}}, mass: 1.0e6}
forces:
  - {object: one, force: [4000, 0], start: 0.2, duration: 0.4}
  - {object: two, force: [8000, 0]}
  - {object: turned, torque: -1000, start: 0.5}
render: {fps: 20}
"""


TAU = 0.2
"""s: how far ahead velocity arrows of the thrown ball point."""


class Clip:
    """A small scene's frames, and the same with overlays."""

    def __init__(self, folder, text: str) -> None:
        path = folder / "scene.yaml"
        path.write_text(text)
        scene = pipeline.load(path)
        compiled = pipeline.compile(scene, None)
        self.world = compiled.world
        self.trajectory = pipeline.simulate(self.world)
        self.plain = list(
            pipeline.render(pipeline.stage(scene, compiled, None), self.trajectory)
        )

    def drawn(self, *kinds: str, frames=None, **more):
        chosen = tuple(map(Overlay, kinds))
        frames = self.plain if frames is None else frames
        return list(
            annotate_frames(iter(frames), self.world, self.trajectory, chosen, **more)
        )

    def key(self, *kinds: str) -> dict[str, float]:
        """Words of the key and how large, px or rad, their samples are."""
        found = describe_clip(self.world, self.trajectory, tuple(map(Overlay, kinds)))
        return {entry.text: entry.size for entry in found.key}

    def changed(self, *kinds: str) -> list[np.ndarray]:
        """(H, W) bool of each frame: where overlays changed it."""
        pairs = zip(self.plain, self.drawn(*kinds), strict=True)
        return [(a.rgb != b.rgb).any(-1) for a, b in pairs]


@pytest.fixture(scope="module")
def thrown(tmp_path_factory) -> Clip:
    return Clip(tmp_path_factory.mktemp("thrown"), THROWN)


@pytest.fixture(scope="module")
def dropped(tmp_path_factory) -> Clip:
    return Clip(tmp_path_factory.mktemp("dropped"), DROPPED)


@pytest.fixture(scope="module")
def pushed(tmp_path_factory) -> Clip:
    return Clip(tmp_path_factory.mktemp("pushed"), PUSHED)


def flight(t):
    """Centre of the thrown ball."""
    return np.stack(
        [
            240 + 220 * np.asarray(t),
            220 - 420 * np.asarray(t) + 450 * np.asarray(t) ** 2,
        ],
        axis=-1,
    )


def places(mask) -> np.ndarray:
    """(K, 2) x, y of what is marked."""
    return np.argwhere(mask)[:, ::-1].astype(float)


def inked(rgb, kind: Overlay) -> np.ndarray:
    """(H, W) bool: pixels of a kind's own colour."""
    return np.abs(rgb.astype(int) - COLOURS[kind]).max(-1) < 12


def to_segment(points, a, b):
    way = np.subtract(b, a)
    along = np.clip((points - a) @ way / (way @ way), 0, 1)
    return np.hypot(*(points - a - along[:, None] * way).T)


def test_outlines_follow_the_shape(thrown) -> None:
    changed = thrown.changed("outlines")
    for frame, marks in zip(thrown.plain, changed, strict=True):
        center, angle = flight(frame.time), np.radians(300) * frame.time
        spots = places(marks)
        rim = np.abs(np.hypot(*(spots - center).T) - 30)
        spoke = np.array([cos(angle), sin(angle)]) * 30
        tick = to_segment(spots, center + 0.72 * spoke, center + spoke)
        assert np.minimum(rim, tick).max() < 3.0
        around = center + 30 * np.array(
            [(cos(a), sin(a)) for a in np.arange(0, 2 * pi, 0.05)]
        )
        x, y = np.rint(around).astype(int).T
        seen = (x >= 0) & (x < 480) & (y >= 0) & (y < 300)
        assert marks[y[seen], x[seen]].all()


def test_velocity_arrows_have_the_length_that_the_key_says(thrown) -> None:
    assert thrown.key("velocity") == {"velocity 2 m/s": pytest.approx(TAU * 200)}
    for plain, drawn in list(zip(thrown.plain, thrown.drawn("velocity"), strict=True))[
        ::3
    ]:
        ink = places(inked(drawn.rgb, Overlay.VELOCITY))
        velocity = np.array([220, -420 + 900 * plain.time])
        speed = np.hypot(*velocity)
        arrow, sample = ink[ink[:, 0] > 200], ink[ink[:, 0] <= 200]
        assert sample[:, 1].max() < 60  # the key, where nothing flies
        along = (arrow - flight(plain.time)) @ velocity / speed
        across = (
            (arrow - flight(plain.time)) @ np.array([-velocity[1], velocity[0]]) / speed
        )
        assert np.abs(across).max() < 6
        assert along.max() == pytest.approx(
            TAU * speed - 1.5, abs=1.6
        )  # the very point is no full pixel
        assert np.ptp(sample[:, 0]) == pytest.approx(TAU * 200, abs=3.5)


def test_trails_are_the_parabola_up_to_now(thrown) -> None:
    for frame, marks in list(zip(thrown.plain, thrown.changed("trails"), strict=True))[
        ::4
    ]:
        path = flight(np.linspace(0, frame.time, 400))
        spots = places(marks)
        if not frame.time:
            assert not len(spots)
            continue
        away = np.hypot(*(spots[:, None] - path).transpose(2, 0, 1)).min(axis=1)
        assert away.max() < 3.0
        x, y = np.rint(path).astype(int).T
        assert marks[y, x].all()


def test_blows_flash_where_and_when_things_meet(dropped) -> None:
    meets = (2 * 100 / 900) ** 0.5  # both fall 100 px
    frames, changed = dropped.plain, dropped.changed("contacts")
    key = changed[0].copy()  # what is there before anything meets
    assert not key[:, 200:].any()
    rings = {}
    for frame, marks in zip(frames, changed, strict=True):
        lit = marks & ~key
        if frame.time < meets:
            assert not lit.any()
        elif frame.time < meets + 0.1:
            for name, x in (("light", 260), ("heavy", 400)):
                spots = places(lit)
                spots = spots[np.abs(spots[:, 0] - x) < 60]
                middle = (spots.min(axis=0) + spots.max(axis=0)) / 2
                assert middle == pytest.approx([x, 260], abs=0.6)
                rings.setdefault(name, np.ptp(spots[:, 0]) / 2)
        elif frame.time > meets + 0.25 and frame.time < 3 * meets:
            assert not lit.any()
    assert frames[-1].time > 3 * meets - 0.5
    # areas tell impulses, four to one; 1.7 px are the line's own half and its casing
    assert rings["heavy"] - 1.7 == pytest.approx(2 * (rings["light"] - 1.7), abs=1.0)


ROW = """\
physgen: 1
size: [400, 200]
world: {duration: 0.5}
objects:
  a: {shape: {circle: {center: [60, 140], radius: 20}}, mass: 300, velocity: [400, 0]}
  b: {shape: {circle: {center: [160, 140], radius: 20}}, mass: 300}
  c: {shape: {circle: {center: [200, 140], radius: 20}}, mass: 300}
  d: {shape: {circle: {center: [240, 140], radius: 20}}, mass: 300}
boundaries: {floor: {segment: [[0, 160], [400, 160]]}}
"""


def test_a_blow_passes_through_what_touches(tmp_path) -> None:
    """Each of a row of equal balls hands on all of the first's momentum; weights are no blows."""
    smooth = ROW.replace("mass: 300", "mass: 300, elasticity: 1, friction: 0").replace(
        "160]]", "160]], friction: 0"
    )
    clip = Clip(tmp_path, smooth)
    blows = describe_clip(clip.world, clip.trajectory, [Overlay.CONTACTS]).impacts
    assert sorted(blow.pair for blow in blows) == [(0, 1), (1, 2), (2, 3)]
    for blow in blows:
        assert blow.time == pytest.approx(60 / 400, abs=0.003)
        assert blow.place == pytest.approx([140 + 40 * blow.pair[0], 140], abs=0.6)
        assert blow.impulse == pytest.approx(300 * 400, rel=0.01)


def test_what_rests_is_dotted_and_strikes_nothing(tmp_path) -> None:
    clip = Clip(
        tmp_path,
        """\
physgen: 1
size: [200, 160]
world: {duration: 0.4}
objects:
  left: {shape: {box: {center: [60, 120], size: [50, 40]}}, mass: 10}
  right: {shape: {box: {center: [140, 120], size: [50, 40]}}, mass: 300}
  top: {shape: {box: {center: [100, 80], size: [120, 40]}}, mass: 900}
boundaries: {floor: {segment: [[0, 140], [200, 140]]}}
render: {fps: 10}
""",
    )
    assert describe_clip(clip.world, clip.trajectory, [Overlay.CONTACTS]).impacts == []
    for marks in clip.changed("contacts"):
        spots = [
            places(marks[line - 5 : line + 6]).mean(axis=0)[0] for line in (140, 100)
        ]
        assert spots == pytest.approx([100, 100], abs=0.1)
        dots = [np.flatnonzero(marks[line]) for line in (140, 100)]
        for row, ends in zip(
            dots, ((35, 85, 115, 165), (40, 85, 115, 160)), strict=True
        ):
            assert np.abs(row[:, None] - ends).min(axis=1).max() <= 4
            assert np.abs(row[:, None] - ends).min(axis=0).max() == 0


def test_frames_may_come_in_any_order(dropped) -> None:
    kinds, some = [kind.value for kind in Overlay], dropped.plain[::7]
    forward = dropped.drawn(*kinds, frames=some)
    backward = dropped.drawn(*kinds, frames=some[::-1])[::-1]
    assert all(
        np.array_equal(a.rgb, b.rgb) for a, b in zip(forward, backward, strict=True)
    )


def test_forces_are_drawn_while_they_act(pushed) -> None:
    frames = pushed.drawn("forces")
    for frame in frames:
        ink = places(inked(frame.rgb, Overlay.FORCES))
        one, two = (
            ink[(np.abs(ink[:, 1] - y) < 12) & (ink[:, 0] > 200)] for y in (80, 180)
        )
        assert bool(len(one)) == (0.2 - 1e-9 <= frame.time < 0.6 - 1e-9)
        x = pushed.trajectory.poses[frame.index, :, 0]
        reach = two[:, 0].max() - x[2]
        if len(one):
            assert one[:, 0].max() - x[0] == pytest.approx(reach / 2, abs=1.5)


def test_torques_turn_the_right_way(pushed) -> None:
    """Negative turns +x away from +y: anticlockwise as seen, so that the head of an arc over the top is on the left."""
    for frame in pushed.drawn("forces"):
        ink = places(inked(frame.rgb, Overlay.FORCES)) - (340, 240)
        ink = ink[np.abs(np.hypot(*ink.T) - 25) < 8]
        assert bool(len(ink)) == (frame.time >= 0.5 - 1e-9)
        if len(ink):
            low = ink[ink[:, 1] > 0]
            broad = [np.ptp(np.hypot(*low[sign * low[:, 0] > 0].T)) for sign in (-1, 1)]
            assert broad[0] > 1.5 * broad[1]


@pytest.mark.parametrize("far", [700, 1e5, 4e5])
def test_nothing_leaves_the_canvas(tmp_path, far: float) -> None:
    """Objects far outside, one of them vast: only what lies in the picture is drawn."""
    clip = Clip(
        tmp_path,
        f"""\
physgen: 1
size: [200, 150]
world: {{duration: 0.2}}
objects:
  away: {{shape: {{circle: {{center: [{far}, -{far}], radius: 20}}}}, velocity: [{far}, 0]}}
  vast: {{shape: {{box: {{center: [100, {far + 140}], size: [{2 * far}, {2 * far}]}}}}, motion: static}}
boundaries: {{slope: {{segment: [[-{far}, -{far}], [{far}, {far}]]}}}}
forces: [{{object: away, force: [0, 1.0e7]}}, {{object: away, torque: 1.0e6}}]
render: {{fps: 10}}
""",
    )
    for frame, plain in zip(
        clip.drawn(*(kind.value for kind in Overlay)), clip.plain, strict=True
    ):
        assert frame.rgb.shape == plain.rgb.shape
        assert np.array_equal(frame.ids, plain.ids)
    x, y = np.arange(200), np.full(200, 140)
    assert clip.changed("outlines")[0][y, x].all()
    x = np.arange(5, 145)
    slope = clip.changed("boundaries")[0]
    assert slope[x, x].all()
    assert np.abs(np.subtract(*places(slope).T)).max() < 6


def test_names_stay_at_their_centres(thrown) -> None:
    for frame, marks in list(zip(thrown.plain, thrown.changed("names"), strict=True))[
        ::4
    ]:
        spots = places(marks)
        middle = (spots.min(axis=0) + spots.max(axis=0)) / 2
        assert middle == pytest.approx(flight(frame.time), abs=4)
        assert np.ptp(spots[:, 0]) < 60


def test_where_shapes_touch(tmp_path) -> None:
    clip = Clip(
        tmp_path,
        """\
physgen: 1
size: [300, 200]
objects:
  a: {shape: {circle: {center: [50, 50], radius: 20}}}
  b: {shape: {circle: {center: [90, 80], radius: 30}}}
  c: {shape: {box: {center: [200, 130], size: [40, 60]}}}
  d: {shape: {box: {center: [260, 125], size: [40, 40], angle: 45}}}
boundaries: {floor: {segment: [[0, 160], [300, 160]]}}
""",
    )
    poses = clip.trajectory.poses[0]
    points, gap = contact_points_between(clip.world, poses, 0, 1)
    assert gap == pytest.approx(0, abs=1e-9)
    assert points == pytest.approx(np.array([[66, 62]]))
    points, gap = contact_points_between(clip.world, poses, 2, 4)
    assert gap == pytest.approx(0, abs=1e-9)
    assert points[np.argsort(points[:, 0])] == pytest.approx(
        np.array([[180, 160], [220, 160]])
    )
    points, gap = contact_points_between(clip.world, poses, 2, 3)
    assert gap == pytest.approx(40 - 20 * 2**0.5)
    assert points[0][1] == pytest.approx(125)
    points, gap = contact_points_between(clip.world, poses, 1, 4)
    assert gap == pytest.approx(50)
    assert points == pytest.approx(np.array([[90, 160]]))
