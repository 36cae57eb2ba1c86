"""`render --watch`: every save is a new clip, a mistake is told and waited out."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from physgen.cli.main import main


@pytest.fixture
def watching(pictured: Path) -> Iterator[subprocess.Popen[str]]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONUNBUFFERED": "1"}
    command = [
        sys.executable,
        "-m",
        "physgen",
        "render",
        str(pictured),
        "-o",
        str(pictured.parent / "out"),
    ]
    with (pictured.parent / "err").open("w") as said:
        process = subprocess.Popen(
            [*command, "--watch", "--preview"],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=said,
            text=True,
        )
        try:
            yield process
        finally:
            process.kill()
            process.wait()


def until(done: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + 60
    while not done():
        assert process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.slow
def test_a_save_makes_the_clip_again(pictured: Path, watching: subprocess.Popen[str]) -> None:
    manifest = pictured.parent / "out" / "pictured" / "manifest.json"
    told = pictured.parent / "err"

    def rounds() -> int:
        return told.read_text().count("watching")

    def samples() -> list[str]:
        found: list[str] = json.loads(manifest.read_text())["samples"]
        return found

    until(lambda: rounds() == 1, watching)
    first = samples()
    right = pictured.read_text()
    pictured.write_text(right.replace("velocity: [120, 0]", "velocity: [120, -300]"))
    until(lambda: rounds() == 2, watching)
    thrown = samples()
    assert thrown != first
    pictured.write_text(right.replace("velocity: [120, 0]", "velocity: fast"))
    until(lambda: rounds() == 3, watching)
    assert '"fast" is not a list of 2 numbers' in told.read_text()
    assert samples() == thrown  # the last clip that was right
    beside = pictured.with_name("new")
    beside.write_text(right)
    beside.replace(pictured)  # as editors save
    until(lambda: rounds() == 4, watching)
    assert samples() == first
    photo = pictured.with_name("photo.png")
    photo.write_bytes(photo.read_bytes())
    until(lambda: rounds() == 5, watching)
    pictured.unlink()
    until(lambda: f"{pictured}: gone; rendered again when it is back" in told.read_text(), watching)
    pictured.write_text(right)
    until(lambda: rounds() == 7, watching)
    watching.send_signal(signal.SIGINT)
    out, _ = watching.communicate(timeout=60)
    assert watching.returncode == 0
    assert out.splitlines() == [str(manifest.parent)] * 5


def test_a_preview_is_short_and_as_large_as_the_photo(lesson: Path, tmp_path: Path) -> None:
    lesson.write_text(
        lesson.read_text().replace(
            "render: {fps: 20}", "render: {fps: 240, slow: 2, scale: 3, motion_blur: 0.5}"
        )
    )
    assert main(["render", str(lesson), "-o", str(tmp_path / "out"), "--preview"]) == 0
    told = json.loads((tmp_path / "out" / "lesson" / "manifest.json").read_text())
    assert len(told["frames"]) == 24
    assert told["video"]["size"] == [64, 48]
    assert len(told["frames"]) / told["video"]["fps"] == pytest.approx(0.3 * 2)  # as long as the clip
    assert "report.html" not in told["files"]
    assert main(["render", str(lesson), "-o", str(tmp_path / "out"), "--preview", "--report", "plain"]) == 0
    assert (tmp_path / "out" / "lesson" / "report.html").exists()
