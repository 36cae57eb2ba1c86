"""A render beside the editor is the one of the command line; stopped, it leaves nothing half-made."""

from __future__ import annotations

import re
import shlex
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from physgen.edit.render_job import RenderJob
from physgen.problems import EditError

Copy = Callable[[str], Path]


def ended(job: RenderJob) -> dict[str, Any]:
    """The status once the run has ended."""
    while job.status()["running"]:
        time.sleep(0.05)
    return job.status()


def short(path: Path) -> Path:
    """Few frames: what is tested is not the drawing."""
    path.write_text(path.read_text() + "\n", encoding="utf-8")
    text = path.read_text()
    fewer, count = re.subn(
        r"^  duration: [\d.]+", "  duration: 0.2", text, flags=re.MULTILINE
    )
    assert count == 1
    path.write_text(fewer)
    return path


@pytest.mark.slow
def test_it_tells_how_far_it_is_and_what_it_made(copied: Copy, tmp_path: Path) -> None:
    path = short(copied("wall-ball"))
    job = RenderJob(path, tmp_path / "out put")
    name = job.start(["beach-ball"])
    with pytest.raises(EditError, match="under way"):
        job.start()
    seen = []
    while (status := job.status())["running"]:
        seen.append((status["done"], status["total"], status["stage"]))
        time.sleep(0.02)
    assert (status["job"], status["state"], status["error"]) == (name, "done", None)
    assert [row["variant"] for row in status["result"]] == ["beach-ball"]
    for row in status["result"]:
        assert job.file(f"{row['folder']}/{row['video']}").read_bytes()[4:8] == b"ftyp"  # type: ignore[union-attr]
        assert job.file(f"{row['folder']}/report.html") is not None
    assert all(done <= total for done, total, _ in seen)
    assert {"simulating", "drawing frames"} & {stage for *_, stage in seen}
    assert job.command("beach-ball") in status["command"]


@pytest.mark.slow
def test_stopped_it_leaves_nothing_half_made(copied: Copy, tmp_path: Path) -> None:
    """In the middle of drawing: the folder holds no partial file, and the next run begins from there."""
    path = copied("kitchen")
    job = RenderJob(path, tmp_path / "out")
    job.start()
    deadline = time.monotonic() + 60
    while job.status()["stage"] != "drawing frames":
        assert time.monotonic() < deadline
        assert job.status()["running"]
        time.sleep(0.02)
    job.stop()
    status = job.status()
    assert (status["state"], status["running"], status["result"]) == (
        "stopped",
        False,
        None,
    )
    assert [file for file in (tmp_path / "out").rglob("*") if file.is_file()] == []
    job.stop()
    assert job.status()["state"] == "stopped"


def test_what_goes_wrong_is_told(copied: Copy, tmp_path: Path) -> None:
    path = copied("wall-ball")
    path.write_text(path.read_text().replace("physgen: 1", "physgen: 7"))
    job = RenderJob(path, tmp_path / "out")
    job.start()
    status = ended(job)
    assert status["state"] == "failed"
    assert "is not a version" in status["error"]["message"]
    assert status["error"]["fix"]
    with pytest.raises(EditError, match="format"):
        job.start(format="avi")
    with pytest.raises(EditError, match="no variant"):
        job.start([])


def test_the_command_is_quoted_for_a_shell(tmp_path: Path) -> None:
    job = RenderJob(tmp_path / "my scene.yaml", tmp_path / "o'ut", allow_outside=True)
    line = job.command("b; rm -rf ~", "mp4,gif")
    assert shlex.split(line) == [
        "physgen", "render", str(tmp_path / "my scene.yaml"), "-o", str(tmp_path / "o'ut"),
        "--variant", "b; rm -rf ~", "--format", "mp4,gif", "--allow-outside",
    ]  # fmt: skip
