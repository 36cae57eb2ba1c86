"""The same command again: what is there stays, what is missing or was made of something else is made."""

from __future__ import annotations

import hashlib
import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

import physgen
from physgen.batch import resume
from physgen.cli.main import main
from physgen.scene.scene import Scene

Render = Callable[..., dict[str, str]]


@pytest.fixture
def render(capsys: pytest.CaptureFixture[str]) -> Render:
    """Renders a scene, and tells how each clip ended."""

    def run(scene: Path, *flags: str, code: int = 0) -> dict[str, str]:
        capsys.readouterr()
        page = () if "--report" in flags else ("--report", "none")
        assert (
            main(
                [
                    "render",
                    str(scene),
                    "-o",
                    str(scene.parent / "out"),
                    "--json",
                    *page,
                    *flags,
                ]
            )
            == code
        )
        *lines, last = map(json.loads, capsys.readouterr().out.splitlines())
        assert (
            last["clips"]
            == len(lines)
            == sum(last[state] for state in ("made", "unchanged", "failed"))
        )
        return {line["clip"]: line["state"] for line in lines}

    return run


def test_what_is_there_is_not_made_again(lesson: Path, render: Render) -> None:
    assert render(lesson) == {"lesson": "made"}
    video = lesson.parent / "out" / "lesson" / "video.mp4"
    number = video.stat().st_ino
    assert render(lesson) == {"lesson": "unchanged"}
    os.utime(lesson)  # as a checkout does
    assert render(lesson, "--jobs", "2") == {"lesson": "unchanged"}
    assert video.stat().st_ino == number
    assert render(lesson, "--no-cache") == {"lesson": "made"}
    assert video.stat().st_ino != number
    assert set(render(lesson, "--variant", "all").items()) == {
        ("lesson", "unchanged"),
        *((f"lesson-{name}", "made") for name in ("light", "heavy", "slow")),
    }


@pytest.mark.parametrize(
    "flags",
    [
        ("--set", "objects.ball.mass=101"),
        ("--format", "mp4,gif"),
        ("--report", "full"),
    ],
)
def test_another_question_is_answered_anew(
    lesson: Path, render: Render, flags: tuple[str, ...]
) -> None:
    render(lesson)
    assert render(lesson) == {"lesson": "unchanged"}
    assert render(lesson, *flags) == {"lesson": "made"}
    assert render(lesson, *flags) == {"lesson": "unchanged"}


@pytest.mark.slow
def test_what_the_clip_was_made_of_counts_by_its_bytes(
    pictured: Path, render: Render
) -> None:
    def again() -> str:
        return render(pictured)["pictured"]

    assert [again(), again()] == ["made", "unchanged"]
    pictured.write_text(pictured.read_text() + "# a note\n")
    assert [again(), again()] == ["made", "unchanged"]
    photo = pictured.with_name("photo.png")
    picture = cv2.imread(str(photo))
    picture[0, 0] ^= 1
    cv2.imwrite(str(photo), picture)
    assert [again(), again()] == ["made", "unchanged"]
    cv2.imwrite(
        str(pictured.parent / "photo.assets" / "depth.png"),
        np.zeros((56, 80), np.uint16),
    )
    assert [again(), again()] == ["made", "unchanged"]
    (pictured.parent / "photo.assets" / "depth.png").unlink()
    assert [again(), again()] == ["made", "unchanged"]


def test_a_clip_that_was_damaged_is_made_again(lesson: Path, render: Render) -> None:
    render(lesson)
    folder = lesson.parent / "out" / "lesson"
    whole = {path.name: path.read_bytes() for path in folder.iterdir()}
    damages: list[Callable[[], object]] = [
        lambda: (folder / "video.mp4").write_bytes(whole["video.mp4"][:-1] + b"x"),
        lambda: (folder / "video.mp4").unlink(),
        lambda: (folder / "trajectory.npz").write_bytes(b""),
        lambda: (folder / "manifest.json").write_text(
            whole["manifest.json"].decode()[:100] + "}"
        ),
    ]
    damages.append(
        lambda: (folder / "manifest.json").write_bytes(b"")
    )  # a machine that lost its power
    for damage in damages:
        damage()
        assert render(lesson) == {"lesson": "made"}
        assert (folder / "video.mp4").read_bytes() == whole["video.mp4"]
    (folder / "manifest.json").write_bytes(b"")
    (folder / "notes.txt").write_text("mine")
    assert main(["render", str(lesson), "-o", str(folder.parent)]) == 2
    assert (folder / "notes.txt").exists()


def test_other_code_makes_every_clip_again(
    lesson: Path, render: Render, monkeypatch
) -> None:
    render(lesson)
    monkeypatch.setattr(resume, "CODE", resume.CODE[:-1])
    assert render(lesson) == {"lesson": "made"}


def test_a_failure_is_a_line_and_a_trace_and_stops_nobody(
    lesson: Path, render: Render, capsys
) -> None:
    broken = lesson.with_name("a-broken.yaml")
    broken.write_text(lesson.read_text().replace("mass: 200", "mass: heavy"))
    out = lesson.parent / "out"
    assert main(["render", str(broken), str(lesson), "-o", str(out), "--json"]) == 2
    lines = list(map(json.loads, capsys.readouterr().out.splitlines()))
    assert [(line["clip"], line["state"]) for line in lines[:-1]] == [
        ("a-broken", "failed"),
        ("lesson", "made"),
    ]
    assert "heavy" in lines[0]["problems"][0]["found"]
    assert lines[-1] | {"index": ""} == {
        "clips": 2, "made": 1, "unchanged": 0, "failed": 1, "index": "", "passed": False,
    }  # fmt: skip


def test_links_and_chains_that_lead_elsewhere_are_other_scenes(
    lesson: Path, render: Render
) -> None:
    other = lesson.with_name("other.yaml")
    other.write_text(lesson.read_text().replace("mass: 100", "mass: 150"))
    link = lesson.with_name("link.yaml")
    link.symlink_to("lesson.yaml")
    assert [render(link)["link"], render(link)["link"]] == ["made", "unchanged"]
    link.unlink()
    link.symlink_to("other.yaml")
    assert [render(link)["link"], render(link)["link"]] == ["made", "unchanged"]
    middle, top = lesson.with_name("middle.yaml"), lesson.with_name("top.yaml")
    middle.write_text("extends: lesson.yaml\n")  # says nothing itself
    top.write_text("extends: middle.yaml\n")
    assert [render(top)["top"], render(top)["top"]] == ["made", "unchanged"]
    middle.write_text("extends: other.yaml\n")
    assert [render(top)["top"], render(top)["top"]] == ["made", "unchanged"]


def test_a_scene_that_was_moved_is_made_again_and_can_be_verified(
    lesson: Path, render: Render
) -> None:
    render(lesson)
    (lesson.parent / "elsewhere").mkdir()
    moved = lesson.rename(lesson.parent / "elsewhere" / "lesson.yaml")
    out = str(lesson.parent / "out")
    assert main(["render", str(moved), "-o", out]) == 0
    assert main(["verify", out]) == 0


def test_a_save_while_the_clip_is_made_has_it_made_again(
    lesson: Path, render: Render, monkeypatch: pytest.MonkeyPatch
) -> None:
    # as it is hashed after it was read, what was read and what the manifest tells may differ
    monkeypatch.setattr("physgen.pipeline.clip.inputs", _late())
    assert render(lesson) == {"lesson": "made"}
    monkeypatch.undo()
    assert [render(lesson)["lesson"], render(lesson)["lesson"]] == ["made", "unchanged"]


def _late() -> Callable[..., object]:
    from physgen.report.record import inputs

    def found(scene: Scene, *more: object) -> object:
        path = next(iter(scene.files))
        path.write_text(path.read_text().replace("mass: 100", "mass: 150"))
        return inputs(scene, *more)  # type: ignore[arg-type]

    return found


def test_whatever_goes_wrong_in_one_clip_the_others_are_made(
    lesson: Path, render: Render, monkeypatch: pytest.MonkeyPatch
) -> None:
    from physgen.pipeline import clip

    lint = clip.lint

    def broken(scene, compiled, maps):
        if scene.name.endswith("light"):
            raise IndexError("no such thing")
        return lint(scene, compiled, maps)

    monkeypatch.setattr(clip, "lint", broken)
    ended = render(lesson, "--variant", "all", code=2)
    assert list(ended.values()).count("made") == 3
    assert ended["lesson-light"] == "failed"


def test_a_gallery_that_was_missed_is_made(lesson: Path, render: Render) -> None:
    render(lesson, "--variant", "all")
    index = lesson.parent / "out" / "index.html"
    os.utime(index, (1, 1))
    before = index.stat().st_mtime
    render(lesson, "--variant", "all")
    assert index.stat().st_mtime > before


# Killed runs

CLIPS = 30
SCENE = """\
physgen: 1
size: [48, 36]
world: {duration: 0.2}
objects:
  ball: {shape: {circle: {center: [12, 20], radius: 5}}, velocity: [100, 0]}
boundaries:
  floor: {segment: [[-100, 30], [300, 30]]}
render: {fps: 20}
variants:
"""


@pytest.fixture
def many(tmp_path: Path) -> Path:
    rows = "".join(
        f"  v{k}: {{objects.ball.mass: {10 + k}, objects.ball.velocity: [{60 + k}, 0]}}\n"
        for k in range(CLIPS)
    )
    (tmp_path / "many.yaml").write_text(SCENE + rows)
    return tmp_path / "many.yaml"


def started(
    scene: Path, out: Path, *flags: str, **more: object
) -> subprocess.Popen[bytes]:
    command = [
        sys.executable,
        "-m",
        "physgen",
        "render",
        str(scene),
        "-o",
        str(out),
        "--variant",
        "all",
    ]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(sys.path),
        "XDG_CACHE_HOME": str(scene.parent / "cache"),
    }
    return subprocess.Popen(
        [*command, "--report", "none", *flags],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        **more,  # type: ignore[call-overload]
    )


def bytes_of(out: Path) -> dict[str, str]:
    """Every file but those that tell times: the manifests."""
    return {
        path.relative_to(out).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(out.rglob("*"))
        if path.is_file()
        and path.name != "manifest.json"
        and path.suffix in (".mp4", ".npz")
    }


def told_of(out: Path) -> dict[str, object]:
    """What manifests say, without times."""
    return {
        path.parent.name: {
            k: v
            for k, v in json.loads(path.read_text()).items()
            if k in ("frames", "samples", "files", "inputs", "mark", "document")
        }
        for path in out.glob("*/manifest.json")
    }


def folders(out: Path) -> list[str]:
    return sorted(path.name for path in out.iterdir()) if out.is_dir() else []


@pytest.mark.slow
def test_killed_at_any_moment_it_goes_on_and_ends_as_if_it_never_was(
    many: Path,
) -> None:
    never = many.parent / "never"
    assert started(many, never).wait() == 0
    out = many.parent / "killed"
    chance = random.Random(11)
    moments = []
    for number in range(8):
        run = started(many, out, "--jobs", "2")
        before = len(folders(out))
        until = time.monotonic() + 60
        while (
            len(folders(out)) <= before + number % 2
            and run.poll() is None
            and time.monotonic() < until
        ):
            time.sleep(0.002)
        time.sleep(chance.uniform(0, 0.06))
        if number % 4 == 3:
            os.killpg(
                run.pid, signal.SIGKILL
            )  # all at once, as the kernel short of memory, or a plug, does
        else:
            run.kill()
        moments.append(run.wait())
        for name in folders(out):  # nothing half-written under a final name
            if (
                not name.startswith(".")
                and (out / name).is_dir()
                and name != "index.files"
            ):
                told = json.loads((out / name / "manifest.json").read_text())
                for file, sha in told["files"].items():
                    assert (
                        hashlib.sha256((out / name / file).read_bytes()).hexdigest()
                        == sha
                    )
    assert moments.count(-signal.SIGKILL) >= 5
    time.sleep(0.6)  # what has no lock counts as left when it is not fresh
    assert started(many, out, "--jobs", "2").wait() == 0
    assert bytes_of(out) == bytes_of(never)
    assert told_of(out) == told_of(never)
    assert folders(out) == folders(never)  # no orphans
    assert not list((many.parent / "cache").rglob("*.part"))


@pytest.mark.slow
def test_a_full_disk_is_told_once_and_loses_nothing(many: Path) -> None:
    """A bound on the size of files stands for it: the kernel refuses to write beyond."""
    out = many.parent / "out"
    assert started(many, out, "--set", "render.fps=10").wait() == 0
    whole = bytes_of(out)

    def bound() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))

    run = started(many, out, preexec_fn=bound)
    _, said = run.communicate(timeout=120)
    assert run.returncode == 1
    lines = said.decode().splitlines()
    assert len(lines) == 1, lines
    assert lines[0].endswith(
        f"no room left: {CLIPS + 1} of {CLIPS + 1} clips are missing; make room and run the same command again"
    )
    assert bytes_of(out) == whole
    assert not [name for name in folders(out) if name.startswith(".")]


def test_all_code_that_makes_clips_is_counted() -> None:
    """Each package is one that makes clips, or one that only calls those."""
    home = Path(physgen.__file__).parent
    packages = {path.name for path in home.iterdir() if (path / "__init__.py").exists()}
    assert packages - set(resume.CODE) == {"batch", "cli", "edit", "evaluate", "fit"}
