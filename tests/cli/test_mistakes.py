"""Ordinary mistakes on the command line: each is answered by one message with the fix."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen.cli.main import main

SCENE = """\
physgen: 1
size: [200, 100]
world: {pixels_per_meter: 400, duration: 0.1}
objects:
  ball-1: {shape: {circle: {center: [50, 50], radius: 10}}}
  block-1: {shape: {box: {center: [120, 50], size: [20, 20]}}}
boundaries:
  floor: {segment: [[0, 90], [200, 90]]}
"""
MISTAKES = {
    # a box or a point in another form, in other units, or cut apart by the shell
    "perceive p.png --box 90,40,120,90": "90,40,30,50",
    "perceive p.png --box -50,20,100,60": "0,20,50,60",
    "perceive p.png --box 90,60,-30,-20": "60,40,30,20",
    "perceive p.png --box '90px 40px 120px 90px'": "90,40,30,50",
    "perceive p.png --box '(90, 40, 120, 90)'": "90,40,30,50",
    "perceive p.png --box 10%,10%,50%,50%": "px",
    "perceive p.png --box 0.25,0.5,0.25,0.5": "32,48,32,48",
    "perceive p.png --box 90, 40, 30, 50": '--box "90,40,30,50"',
    "perceive p.png --box 90 40 30 50": '--box "90,40,30,50"',
    "perceive p.png --box 90,40": "--point",
    "perceive p.png --box 10x20x30x40": "120,80,60,60",
    "perceive p.png --box nan,1,30,40": "120,80,60,60",
    "perceive p.png --point 90,40,30,50": "--box",
    "perceive p.png --point 80,110": "110,80",
    "perceive p.png --point 5cm,3cm": "px",
    "perceive p.png --box": "X,Y,W,H",
    "perceive p.png --bx 1,2,30,40": "--box",
    "perceive p.png new.yaml": "-o new.yaml",
    "perceive scene.yaml": "--refresh scene.yaml",
    "perceive pp.png": "p.png",
    "perceive --refresh p.png -o a.yaml": "physgen perceive",
    "render scene.yml": "scene.yaml",
    "render p.png": "physgen perceive",
    "render scene.yaml --push ball-1": "ball-1=right",
    "render scene.yaml --push ball1=right": "ball-1",
    "render scene.yaml --push ball-1:right": "ball-1=right",
    "render scene.yaml --push 'ball-1 up left@2 m/s'": "ball-1=up left@2 m/s",
    "render scene.yaml --push right=ball-1": "ball-1=right",
    "render scene.yaml --push ball-1=right,2m/s": "right@2m/s",
    "render scene.yaml --push ball-1=right @ 2 m/s": '"ball-1=right @ 2 m/s"',
    "render scene.yaml --push ball-1=rihgt": "right",
    "render scene.yaml --kick 50 50": '--kick "50,50"',
    "render scene.yaml --kick 190,50": "130,50",
    "render scene.yaml --set objects.ball-1.mass 3": "objects.ball-1.mass=3",
    "render scene.yaml objects.ball-1.mass=3": "--set objects.ball-1.mass=3",
    "export scene.yaml --format flo render.fps=9": "--set render.fps=9",
    "simulate scene.yaml render.fps=9": "--set render.fps=9",
    "rename scene.yaml ball-1": "rename scene.yaml ball-1 cue-ball",
    "rename scene.yaml ball-1=cue": "rename scene.yaml ball-1 cue-ball",
    "rename scene.yaml ball1 cue": "ball-1",
    "rename scene.yaml ball-1 'cue ball'": "letters, digits",
    "rename scene.yaml floor ground": "boundary",
    "rename ball-1 cue scene.yaml": "physgen rename scene.yaml ball-1 cue",
    "merge scene.yaml ball-1,block-1": "ball-1 block-1",
    "merge scene.yaml ball-1": "physgen merge scene.yaml ball-1",
    "merge ball-1 block-1 scene.yaml": "physgen merge scene.yaml ball-1 block-1",
    "remove scene.yaml ball-1,block-1": "ball-1 block-1",
    "remove ball-1 scene.yaml": "physgen remove scene.yaml ball-1",
    "remove scene.yaml objects.ball-1": "ball-1",
    "remove scene.yaml floor": "boundary",
    "edit scene.yml --no-browser": "scene.yaml",
    "edit scene.yaml --port 99999": "65535",
    "edit scene.yaml --browser": "--no-browser",
}
"""Command -> what its message holds: the fix."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "scene.yaml").write_text(SCENE)
    photo = np.full((96, 128, 3), 120, np.uint8)
    cv2.imwrite(str(tmp_path / "p.png"), photo)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("command", MISTAKES)
def test_mistake_is_answered_with_fix(
    command: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = shlex.split(command)
    if arguments[0] == "perceive" and "-o" not in arguments:
        arguments[1:1] = ["-o", "a.yaml"]
    try:
        code = main(arguments)
    except SystemExit as ended:
        code = ended.code
    assert code == 2
    (said,) = capsys.readouterr().err.strip().splitlines()
    assert MISTAKES[command] in said
    assert sorted(os.listdir(folder)) == ["p.png", "scene.yaml"]
    assert (folder / "scene.yaml").read_text() == SCENE
