"""Progress of long commands: on a terminal's stderr, and nowhere else."""

from __future__ import annotations

import io
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen.cli import output
from physgen.cli.main import main

SCENE = (
    "physgen: 1\nsize: [64, 48]\nworld: {duration: 0.2}\nrender: {frames: 3}\n"
    "objects: {ball: {shape: {circle: {center: [20, 20], radius: 6}}, velocity: [20, 0]}}\n"
)
COMMANDS = {
    "render": "render a.yaml b.yaml -o out",
    "sweep": "sweep a.yaml objects.ball.mass=1,2 -o out",
    "export": "export a.yaml --format frames -o out",
    "perceive": "perceive photo.png --masks masks.png -o scene.yaml",
    "evaluate": "evaluate segmentation photos",
}
STAGES = {
    "render": "clip 2 of 2: render 3/3",
    "sweep": "clip 1 of 2: simulate",
    "export": "render 3/3",
    "perceive": "inpaint 11/12",
    "evaluate": "/2",
}


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_progress_is_for_terminals(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a.yaml", "b.yaml"):
        Path(name).write_text(SCENE)
    photo, masks = np.full((96, 128, 3), 190, np.uint8), np.zeros((96, 128), np.uint8)
    photo[50:80, 40:80], masks[50:80, 40:80] = (40, 60, 170), 1
    Path("photos").mkdir()
    for name in ("photos/a", "photos/b", ""):
        photo_file, labels = (
            (f"{name}.png", f"{name}.labels.png")
            if name
            else ("photo.png", "masks.png")
        )
        cv2.imwrite(photo_file, photo)
        cv2.imwrite(labels, masks)
    terminal = Terminal()
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stderr", terminal)
        assert main(COMMANDS[command].split()) in (0, 1)
    shown = terminal.getvalue().split("\r")
    assert any(
        text.startswith(STAGES[command]) or STAGES[command] in text for text in shown
    ), shown
    capsys.readouterr()
    again = COMMANDS[command].replace("out", "pipe").replace("scene.yaml", "other.yaml")
    assert main(again.split()) in (0, 1)
    assert "\r" not in (said := capsys.readouterr().err)
    assert STAGES[command] not in said


def test_bar_shows_the_time_of_slow_stages(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr(output, "TICK", 0.01)
    monkeypatch.setattr(output, "SHOWN_FROM", 0.0)
    bar = output.Bar()
    with bar.ticking():
        bar.show("segment", 1, 12)
        while "segment 1/12, " not in terminal.getvalue():
            time.sleep(0.01)
        bar.aside(output.print_error)("a message")
    lines = terminal.getvalue().split("\r")
    assert lines[-1] == "a message\n"  # on a line of its own


def test_bar_is_cleared_before_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert main(["perceive", "nowhere.png"]) == 2
    shown, _, message = terminal.getvalue().rpartition("\r")
    assert shown.strip()  # before anything is read
    assert message.startswith("nowhere.png")
