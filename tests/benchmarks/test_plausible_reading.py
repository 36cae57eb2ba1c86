"""Tracks in every format say the same of one motion, and what cannot be read is refused with its place."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physgen.cli.main import main
from physgen.evaluate.plausibility.judge import judge
from physgen.evaluate.plausibility.tracks import read
from physgen.problems import InputError
from physgen.scene.scene import View


def judge_motion(arguments: list[str]) -> int:
    return main(["evaluate", "plausibility", *arguments])


FPS, FRAMES, RADIUS, G = 25, 24, 9.0, 400.0
T = np.arange(FRAMES) / FPS
PATHS = [
    np.stack([20 + 30 * T, 90 - 165 * T + G * T * T / 2], axis=1),
    np.stack([110 - 9 * T, 96 - 190 * T + G * T * T / 2], axis=1),
]


def table(home: Path) -> Path:
    lines = ["frame,name,x,y,radius"]
    lines += [
        f"{frame},ball-{k + 1},{x:.3f},{y:.3f},{RADIUS}"
        for k, path in enumerate(PATHS)
        for frame, (x, y) in enumerate(path)
    ]
    (home / "tracks.csv").write_text("\n".join(lines) + "\n")
    return home / "tracks.csv"


def test_a_table_tells_the_motion(tmp_path: Path) -> None:
    (tracks,) = read(table(tmp_path), FPS)
    assert tracks.step == pytest.approx(1 / FPS, rel=1e-3)
    np.testing.assert_allclose(tracks.places, np.stack(PATHS, axis=1), atol=1e-3)
    verdict = judge(tracks)
    assert verdict.is_wrong is False
    assert verdict.motion.gravity is not None
    assert verdict.motion.gravity[1] == pytest.approx(G, rel=0.03)


BAD = {
    "columns.csv": ("name,x,y\na,1,2\n", "do not include frame"),
    "number.csv": (
        "frame,name,x,y\n0,a,1,2\n1,a,wide,2\n",
        'number.csv:3:1: x: "wide" is not a number',
    ),
    "far.csv": (
        "frame,name,x,y\n0,a,1e300,2\n",
        'far.csv:2:1: x: "1e300" is not a number from -1e+06 to 1e+06',
    ),
    "twice.csv": ("frame,name,x,y\n0,a,1,2\n0,a,2,2\n1,a,2,2\n", "is twice in frame 0"),
    "film.avi": ("", "is not a kind of tracks"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_read_is_refused(name: str, tmp_path: Path) -> None:
    text, message = BAD[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as error:
        list(read(tmp_path / name))
    assert message in str(error.value)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = table(tmp_path)
    assert judge_motion([str(path), "-o", str(tmp_path / "page")]) == 0
    assert "clips called wrong: 0 of 1" in capsys.readouterr().out
    assert "nothing beyond noise" in (tmp_path / "page" / "index.html").read_text()
    lines = path.read_text().splitlines()
    moved = [
        f"{line.rsplit(',', 3)[0]},{float(line.split(',')[2]) + 30:.3f},{line.split(',', 3)[3]}"
        for line in lines[13:25]
    ]
    path.write_text("\n".join([*lines[:13], *moved, *lines[25:]]) + "\n")
    assert judge_motion([str(path), "--json", "--skip", "overlap"]) == 1
    (row,) = json.loads(capsys.readouterr().out)["rows"]
    worst = row["questions"]["jumps"]["evidence"][0]
    assert (row["verdict"], worst["objects"], worst["frame"]) == (
        "wrong",
        ["ball-1"],
        12,
    )
    assert judge_motion([str(path), "--held", "cue"]) == 2
    assert '"cue" is not among the bodies' in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        judge_motion([])
    assert "CLIP" in capsys.readouterr().err


def test_a_scene_and_its_clip_are_judged_by_their_places(tmp_path: Path) -> None:
    scene = tmp_path / "drop.yaml"
    scene.write_text(
        "physgen: 1\nsize: [96, 96]\nworld: {duration: 1.2}\n"
        "objects: {a: {shape: {circle: {center: [40, 20], radius: 8}}, elasticity: 0.8}}\n"
        "boundaries: {floor: {segment: [[0, 90], [96, 90]], elasticity: 0.8}}\nrender: {size: [32, 32]}\n"
    )
    assert (
        main(
            [
                "render",
                str(scene),
                "-o",
                str(tmp_path / "out"),
                "--format",
                "png",
                "--no-cache",
            ]
        )
        == 0
    )
    (by_scene,) = read(scene)
    (by_clip,) = read(tmp_path / "out", view=View.TOP)
    np.testing.assert_array_equal(by_scene.places, by_clip.places)
    assert by_clip.view is View.SIDE
    assert by_clip.forms[0].reach == 8
    scene.unlink()
    (alone,) = read(tmp_path / "out")
    assert alone.forms[0].reach == 0
    for tracks in (by_scene, by_clip, alone):
        assert judge(tracks).is_wrong is False


SPECIAL = """\
physgen: 1
size: [640, 480]
world: {view: side, duration: 1.5}
objects:
  jumper: {shape: {circle: {center: [100, 200], radius: 15}}, mass: 100, elasticity: 1.3}
  left:
    shape: {circle: {center: [300, 200], radius: 15}}
    velocity: [120, -300]
    collision_group: back
    collides_with: [main]
  right:
    shape: {circle: {center: [460, 200], radius: 15}}
    velocity: [-120, -300]
    collision_group: back
    collides_with: [main]
boundaries:
  trampoline: {segment: [[40, 300], [160, 300]], elasticity: 1.3}
  floor: {segment: [[200, 460], [640, 460]]}
"""


def test_bumpers_and_groups_of_a_scene_are_known(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(SPECIAL)
    (tracks,) = read(tmp_path / "scene.yaml")
    assert tracks.passing_pairs == {(1, 2)}
    assert tracks.bumped_bodies == {0}
    assert judge(tracks).is_wrong is not True
    unknown = replace(tracks, passing_pairs=frozenset(), bumped_bodies=frozenset())
    assert judge(unknown).is_wrong is True
