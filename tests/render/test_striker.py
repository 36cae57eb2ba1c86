"""What comes into the picture and pushes."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from physgen.arrays import F64
from physgen.compile.warnings import lint
from physgen.photometry import luminance
from physgen.pipeline.film import Film
from physgen.pipeline.stages import Stages
from physgen.render import striker
from physgen.render.sprites import Sprite
from physgen.render.striker import find_strikes
from physgen.render.striker_sprite import FINGER, Placement, draw_striker
from physgen.report.record import RunRecord

SCENE = """physgen: 1
image: photo.png
objects:
  block: {mask: {polygon: [[80, 60], [129, 60], [129, 109], [80, 109]]}, velocity: [120, 0]}
world: {view: top, pixels_per_meter: 500, ramp: 0.1 s, duration: 0.8}
render: {hold: 8}
"""
HOLD = 8
RAMP = 3
"""Frames."""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    photo = np.full((170, 240, 3), (90, 120, 150), np.uint8)
    photo[60:110, 80:130] = (200, 60, 50)
    Image.fromarray(photo).save(tmp_path / "photo.png")
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    return path


def _film(path: Path, *overrides: str) -> Film:
    stages = Stages()
    scene = stages.load(path, list(overrides), None, False)
    maps = stages.maps(scene)
    record = RunRecord(scene="", command=[])
    return Film(scene, stages.compile(scene, maps), maps, record, stages)


def _frames(film: Film) -> np.ndarray:
    motion = film.simulate_motion(lambda *_: None)
    frames = film.deliver_frames(film.frames(motion), motion)
    return np.stack([frame.rgb.astype(int) for frame in frames])


def _both(path: Path, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Return frames with and without a striker."""
    plain, struck = _film(path), _film(path, f"render.enter={kind}")
    plain.deliver()
    assert struck.deliver() == {"hold": HOLD, "enter": kind}
    return _frames(struck), _frames(plain)


@pytest.mark.parametrize("kind", ["finger", "cue", "stick"])
def test_striker_touches_at_the_push(scene_file: Path, kind: str) -> None:
    struck, plain = _both(scene_file, kind)
    assert struck.shape == plain.shape
    is_new = np.abs(struck - plain).max(axis=3) > 30
    assert not is_new[0].any()
    reaches = []
    for new in is_new[: HOLD + RAMP]:
        columns = np.flatnonzero(new[75:95].any(axis=0))
        reaches.append(int(columns.max(initial=0)))
    # It comes from the left, and is at the block when the motion begins.
    assert reaches == sorted(reaches)
    assert abs(reaches[HOLD] - 79) <= 2
    assert reaches[HOLD - 2] < 78
    # It goes on with the block, and then leaves.
    assert reaches[-1] > reaches[HOLD]
    assert not is_new[-1].any()


def test_striker_changes_no_motion(scene_file: Path) -> None:
    plain, struck = _film(scene_file), _film(scene_file, "render.enter=cue")
    motions = [film.simulate_motion(lambda *_: None) for film in (plain, struck)]
    assert (motions[0].poses == motions[1].poses).all()


def test_undelivered_frames_have_no_striker(scene_file: Path) -> None:
    plain, struck = _film(scene_file), _film(scene_file, "render.enter=cue")
    assert (_frames(plain) == _frames(struck)).all()


def test_striker_takes_a_hold(scene_file: Path) -> None:
    film = _film(scene_file, "render.enter=stick", "render.hold=0")
    assert film.deliver()["hold"] == HOLD
    motion = film.simulate_motion(lambda *_: None)
    assert film.count(motion) == len(motion.times) + HOLD


@pytest.mark.parametrize(
    "override", ["objects.block.velocity=[0, 0]", "render.play=backward"]
)
def test_idle_striker_is_a_warning(scene_file: Path, override: str) -> None:
    film = _film(scene_file, "render.enter=cue", override)
    texts = [str(problem) for problem in lint(film.scene, film.compiled)]
    assert sum("render.enter" in text and "no effect" in text for text in texts) == 1


def test_single_frame_has_no_striker(scene_file: Path) -> None:
    film = _film(scene_file, "render.enter=finger", "render.frames=1")
    film.deliver()
    struck = _frames(film)
    plain = _film(scene_file, "render.frames=1")
    plain.deliver()
    assert (struck == _frames(plain)).all()


def test_hold_shows_the_photo_though_the_first_frame_is_blurred(
    scene_file: Path,
) -> None:
    overrides = ("world.ramp=0", "render.first_blur=true", "render.motion_blur=0.5")
    film = _film(scene_file, "render.enter=finger", *overrides)
    film.deliver()
    with Image.open(scene_file.with_name("photo.png")) as photo:
        rgb = np.asarray(photo).astype(int)
    frames = _frames(film)
    assert np.abs(frames[0] - rgb).max() <= 2
    # The block's right side, which the finger does not reach.
    assert np.abs(frames[HOLD] - rgb)[60:110, 125:].max() > 30


IMPULSE = "forces=[{object: block, impulse: [3.0e5, 0], at: [80, 70]}]"
AT_REST = "objects.block.velocity=[0, 0]"


def test_striker_touches_the_point_of_an_impulse(scene_file: Path) -> None:
    film = _film(scene_file, "render.enter=stick", AT_REST, IMPULSE)
    film.deliver()
    motion = film.simulate_motion(lambda *_: None)
    frames = film.deliver_frames(film.frames(motion), motion)
    touch = list(frames)[HOLD].rgb.astype(int)
    with Image.open(scene_file.with_name("photo.png")) as photo:
        rgb = np.asarray(photo).astype(int)
    left = np.abs(touch - rgb).max(axis=2)[:, 72:80].max(axis=1) > 30
    rows = np.flatnonzero(left)
    assert abs(rows.mean() - 70) <= 2
    assert not [
        problem
        for problem in lint(film.scene, film.compiled)
        if "enter" in str(problem)
    ]


JOINED = """  wheel: {mask: {polygon: [[85, 110], [105, 110], [105, 129], [85, 129]]}, velocity: [120, 0]}
joints:
  axle: {objects: [wheel, block], pivot: [95, 112]}
"""


def test_one_striker_pushes_joined_objects(scene_file: Path) -> None:
    text = scene_file.read_text()
    scene_file.write_text(text.replace("world:", JOINED + "world:"))
    film = _film(scene_file, "render.enter=stick")
    strikes = find_strikes(film.compiled.world)
    assert [film.compiled.world.bodies[strike.body].name for strike in strikes] == [
        "block"
    ]


def test_striker_leaves_the_picture_after_a_long_push(scene_file: Path) -> None:
    film = _film(
        scene_file, "render.enter=finger", "world.view=side", "world.gravity=[0, 0]"
    )
    plain = _film(scene_file, "world.view=side", "world.gravity=[0, 0]")
    film.deliver()
    plain.deliver()
    assert np.abs(_frames(film)[-1] - _frames(plain)[-1]).max() <= 8


def _finger(is_from_side: bool, length: float = 400, scale: float = 4) -> Sprite:
    """Return a finger to the left of its tip, `scale` px a mm, in even light."""
    light = SimpleNamespace(direction=(0.0, -0.6, 0.8), ambient=0.5, intensity=0.5)
    background = SimpleNamespace(setting=SimpleNamespace(light=light))
    stage = SimpleNamespace(
        lit_background=background,
        background=np.full((8, 8, 3), 200, np.uint8),
        sprites=[],
    )
    axis = np.array([-1.0, 0.0])
    placement = Placement(np.zeros(2), axis, length, scale, is_from_side)
    return draw_striker(stage, FINGER, placement, 0)


def _at(sprite: Sprite, along: float, above: float) -> F64:
    """Return (3,) light of 2 mm around a place, mm from the tip and above the axis."""
    column = round(4 * (FINGER.tip - along)) - sprite.corner[0]
    row = round(-4 * above) - sprite.corner[1]
    part = np.s_[row - 4 : row + 5, column - 4 : column + 5]
    assert (sprite.coverage[part] == 1).all()
    return np.asarray(sprite.light[part].mean(axis=(0, 1)), np.float64)


@pytest.mark.parametrize(("is_from_side", "above"), [(True, 4.4), (False, 0)])
def test_nail_is_brighter_than_the_skin_around_it(
    is_from_side: bool, above: float
) -> None:
    sprite = _finger(is_from_side)
    nail = luminance(_at(sprite, 8, above))
    for along, aside in ((18, above), (8, above - 5 if is_from_side else 5)):
        assert nail > 1.1 * luminance(_at(sprite, along, aside))


def test_finger_is_thicker_and_redder_at_its_joints() -> None:
    sprite = _finger(is_from_side=True)
    columns = [round(4 * (FINGER.tip - at)) - sprite.corner[0] for at in (37, 50)]
    thickness = sprite.coverage[:, columns].sum(axis=0) / 4
    assert thickness[1] > 1.05 * thickness[0]
    assert 15 < thickness[0] < 19
    joint, between = _at(sprite, 54.5, 0), _at(sprite, 65, 0)
    assert joint[1] / joint[0] < 0.97 * between[1] / between[0]


def test_forearm_of_a_small_hand_goes_on_to_its_end() -> None:
    length = 1500
    sprite = _finger(is_from_side=True, length=length, scale=0.5)
    column = -length - sprite.corner[0]
    assert (sprite.coverage[:, column] == 1).any()


@pytest.mark.parametrize("kind", ["finger", "cue", "stick"])
@pytest.mark.parametrize("velocity", ["[300, 0]", "[300, 120]", "[150, -300]"])
def test_far_end_of_a_striker_stays_outside(
    scene_file: Path, kind: str, velocity: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each frame shows it as one that is 1000 px longer."""
    overrides = (
        f"render.enter={kind}",
        f"objects.block.velocity={velocity}",
        "world.view=side",
        "world.gravity=[0, 0]",
    )
    film = _film(scene_file, *overrides)
    film.deliver()
    frames = _frames(film)
    length = striker._Way.length
    monkeypatch.setattr(
        striker._Way, "length", lambda way, track: length(way, track) + 1000
    )
    longer = _film(scene_file, *overrides)
    longer.deliver()
    assert np.abs(frames - _frames(longer)).max() <= 1
