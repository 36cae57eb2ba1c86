"""Output files and folders that the command line names: accepted, or refused early."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import yaml
from PIL import Image

from physgen.cli.main import main
from physgen.files import check_writable
from physgen.problems import OutputError

MASKED = ("--masks", "masks.png", "--still", "--backend", "label=shape")
"""Options of `perceive` that leave out steps whose results these tests do not read."""
NOBODY = 65534
"""User id without rights, in place of root, who may write anywhere."""


def run_physgen(folder: Path, *arguments: str, stdout: object) -> str:
    """Run a command as a shell does; return its stderr."""
    command = [sys.executable, "-m", "physgen", *arguments]
    done = subprocess.run(
        command, cwd=folder, stdout=stdout, stderr=subprocess.PIPE, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stderr


# ---- a scene on stdout


@pytest.mark.slow
@pytest.mark.parametrize("source", ["photo.png", "elsewhere/photo.png"])
def test_redirected_scene_has_its_assets_beside(blocks: Path, source: str) -> None:
    home = blocks.parent
    (home / "sub").mkdir()
    (home / "elsewhere").mkdir()
    shutil.copy(blocks, home / "elsewhere")
    scene = home / "sub" / "scene.yaml"
    before = {path.name for path in home.iterdir()}
    for _ in range(2):  # the shell empties the file before the second run
        with scene.open("w") as stdout:
            stderr = run_physgen(home, "perceive", source, *MASKED, stdout=stdout)
        assert "scene.assets:" not in stderr
        assert {path.name for path in home.iterdir()} == before
        assert {path.name for path in scene.parent.iterdir()} == {
            "scene.yaml",
            "scene.assets",
        }
        assert yaml.safe_load(scene.read_text())["assets"] == "scene.assets"
        assert main(["check", str(scene)]) == 0


@pytest.mark.slow
def test_redirected_scene_spares_assets_of_another(blocks: Path) -> None:
    home = blocks.parent
    (home / "sub").mkdir()
    assert (
        main(
            ["perceive", str(blocks), "--still", "-o", str(home / "sub" / "scene.yaml")]
        )
        == 0
    )
    masks = (home / "sub" / "scene.assets" / "masks.png").read_bytes()
    with (home / "sub" / "scene.yml").open("w") as stdout:
        arguments = ["perceive", "photo.png", *MASKED]
        run_physgen(home, *arguments, stdout=stdout)
    assert (home / "sub" / "scene.assets" / "masks.png").read_bytes() == masks
    assert main(["check", str(home / "sub" / "scene.yml")]) == 0


def test_scene_in_a_pipe_names_its_assets(blocks: Path) -> None:
    arguments = ["perceive", "photo.png", *MASKED]
    stderr = run_physgen(blocks.parent, *arguments, stdout=subprocess.PIPE)
    last = stderr.splitlines()[-1]
    assert last.startswith("photo.assets: ")
    assert str(blocks.parent) in last
    assert (blocks.parent / "photo.assets" / "masks.png").is_file()


def test_photo_emptied_by_the_shell_is_named(blocks: Path) -> None:
    command = [sys.executable, "-m", "physgen", "perceive", "photo.png"]
    with blocks.open("w") as stdout:
        done = subprocess.run(
            command, cwd=blocks.parent, stdout=stdout, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 2
    assert done.stderr.startswith("photo.png: ")
    assert len(done.stderr.splitlines()) == 1
    assert not (blocks.parent / "photo.assets").exists()


# ---- a video that -o names


def width_of(video: Path) -> int:
    """Width in px, as other programs read it."""
    if video.suffix.lower() == ".mp4":
        with av.open(str(video)) as container:
            return container.streams.video[0].width
    with Image.open(video) as image:
        return image.width


@pytest.mark.parametrize("suffix", [".mp4", ".gif", ".webp", ".MP4"])
def test_output_video_lies_beside_its_folder(
    lesson: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    video = lesson.parent / "new" / f"clip{suffix}"
    assert main(["render", str(lesson), "-o", str(video)]) == 0
    assert capsys.readouterr().out == f"{video}\n"
    assert video.is_file()
    assert width_of(video) == 96
    folder = video.parent / "clip"
    names = {path.name for path in folder.iterdir()}
    assert {"report.html", "manifest.json", "trajectory.npz"} <= names
    assert {path.name for path in video.parent.iterdir()} == {video.name, "clip"}
    assert main(["verify", str(folder)]) == 0
    capsys.readouterr()
    assert main(["render", str(lesson), "-o", str(video), "--json"]) == 0
    line = json.loads(capsys.readouterr().out.splitlines()[0])
    assert line["video"] == str(video)
    assert line["folder"] == str(folder)
    assert line["state"] == "unchanged"


def test_output_video_keeps_a_file_of_others(
    lesson: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video, text = lesson.with_name("clip.mp4"), lesson.read_text()
    video.write_bytes(b"a film of mine")
    assert main(["render", str(lesson), "-o", str(video)]) == 0
    backup = lesson.with_name("clip.mp4~")
    assert backup.read_bytes() == b"a film of mine"
    assert backup.name in capsys.readouterr().err
    lesson.write_text(text.replace("mass: 200", "mass: 20"))
    first = video.read_bytes()
    assert main(["render", str(lesson), "-o", str(video)]) == 0
    assert video.read_bytes() != first
    assert not lesson.with_name("clip.mp4~2").exists()


@pytest.mark.parametrize(
    ("name", "flags"),
    [
        ("clip.gif", ["--format", "mp4"]),
        ("clip.mp4", ["--format", "png,webp"]),
        ("clip.mp4", ["--variant", "all"]),
        ("clip.mp4", ["{lesson}"]),
        ("clip.mov", []),
        ("clip.png", []),
        ("clip.json", []),
    ],
)
def test_output_video_that_cannot_be_is_refused(
    lesson: Path, name: str, flags: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    other = lesson.with_name("other.yaml")
    shutil.copy(lesson, other)
    before = sorted(lesson.parent.iterdir())
    flags = [flag.format(lesson=other) for flag in flags]
    output = ["-o", str(lesson.with_name(name))]
    assert main(["render", str(lesson), *flags, *output]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("-o: ")
    assert name in line
    assert sorted(lesson.parent.iterdir()) == before


@pytest.mark.parametrize("kind", ["folder.mp4", "new.mp4/"])
def test_folder_named_as_a_video_stays_one(lesson: Path, kind: str) -> None:
    lesson.with_name("folder.mp4").mkdir()
    output = os.path.join(lesson.parent, kind)
    assert main(["render", str(lesson), "-o", output, "--preview"]) == 0
    assert Path(output, "lesson", "video.mp4").is_file()


def test_all_formats_of_an_output_video_are_written(lesson: Path) -> None:
    flags = ["-o", str(lesson.with_name("clip.gif")), "--format", "mp4,gif"]
    assert main(["render", str(lesson), *flags]) == 0
    assert lesson.with_name("clip.gif").is_file()
    assert (lesson.parent / "clip" / "video.mp4").is_file()


@pytest.mark.parametrize(
    "command",
    [
        ["sweep", "{lesson}", "objects.ball.mass=1,2", "-o", "{home}/new.csv"],
        ["export", "{lesson}", "--format", "flo", "-o", "{home}/new.npz"],
        ["dataset", "{home}/sub", "-o", "{home}/new.zip"],
        ["edit", "{lesson}", "-o", "{home}/new.mp4"],
        ["gallery", "{home}/sub", "-o", "{home}/new"],
        ["gallery", "{home}/sub", "-o", "{home}/new.mp4"],
        ["simulate", "{lesson}", "-o", "{home}/new.mp4"],
        ["perceive", "{home}/sub/photo.png", "-o", "{home}/new.png"],
        [
            *("perceive", "{home}/sub/photo.png", "{home}/sub/photo.labels.png"),
            *("-o", "{home}/new.png"),
        ],
        ["evaluate", "segmentation", "{home}/sub", "-o", "{home}/new.html"],
    ],
)
def test_output_of_another_kind_is_refused(
    lesson: Path, command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    home = lesson.parent
    (home / "sub").mkdir()
    shutil.copy(lesson, home / "b.yaml")
    command = [part.format(lesson=lesson, home=home) for part in command]
    for name in ("photo.png", "photo.labels.png"):
        cv2.imwrite(str(home / "sub" / name), np.zeros((90, 120), np.uint8))
    before = sorted(home.rglob("*"))
    assert main(command) == 2
    assert "-o: " in capsys.readouterr().err
    assert sorted(home.rglob("*")) == before


# ---- a folder that cannot be written

COMMANDS = [
    ["perceive", "{photo}", "-o", "{out}/new/scene.yaml"],
    ["perceive", "{photo}", "{home}/masks.png", "-o", "{out}/new"],
    ["perceive", "--refresh", "{scene}", "-o", "{out}/new.yaml"],
    ["render", "{lesson}", "-o", "{out}"],
    ["render", "{lesson}", "--variant", "all", "-o", "{out}/new", "--jobs", "2"],
    ["render", "{lesson}", "-o", "{out}/clip.mp4"],
    ["sweep", "{lesson}", "objects.ball.mass=1,2", "-o", "{out}/new"],
    ["export", "{lesson}", "--format", "flo", "-o", "{out}/new"],
    ["dataset", "{home}/clips", "-o", "{out}/new"],
    ["gallery", "{home}/clips", "-o", "{out}/new.html"],
    ["simulate", "{lesson}", "-o", "{out}/new.csv"],
    ["simulate", "{lesson}", "-o", "{out}/new.npz"],
    ["edit", "{lesson}", "-o", "{out}/new", "--no-browser"],
]


@pytest.fixture
def everything(blocks: Path, lesson: Path) -> dict[str, str]:
    """Inputs of all commands."""
    home, scene = blocks.parent, blocks.with_name("scene.yaml")
    perceived = ["perceive", str(blocks), "--masks", str(home / "masks.png")]
    assert main([*perceived, "-o", str(scene)]) == 0
    assert main(["render", str(lesson), "-o", str(home / "clips"), "--preview"]) == 0
    paths = {"photo": blocks, "lesson": lesson, "home": home, "scene": scene}
    return {name: str(path) for name, path in paths.items()}


@pytest.mark.slow
@pytest.mark.parametrize("out", ["{home}/lesson.yaml", "/proc/new"])
def test_unwritable_output_is_refused_before_the_work(
    everything: dict[str, str],
    out: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A file in place of a folder, and a folder of the kernel, which refuses root, too."""
    monkeypatch.setenv("PHYSGEN_PROGRESS", "json")  # any stage prints a line
    out = out.format(**everything)
    for command in COMMANDS:
        capsys.readouterr()
        arguments = [part.format(out=out, **everything) for part in command]
        assert main(arguments) == 2, arguments
        lines = capsys.readouterr().err.splitlines()
        # packages are loaded in the stage `begin`, before any work
        (line,) = [one for one in lines if '"begin"' not in one]
        assert line.startswith((f"{out}: ", f"{out}/", "/proc: ")), line


@pytest.fixture
def closed(tmp_path: Path) -> Iterator[Path]:
    """A folder that its owner made read-only, where any user can look."""
    folder = Path(tempfile.mkdtemp(prefix="physgen-"))
    (folder / "closed").mkdir()
    (folder / "closed").chmod(0o555)
    folder.chmod(0o755)
    yield folder / "closed"
    shutil.rmtree(folder)


@pytest.mark.parametrize("below", ["", "new/deep"])
def test_read_only_folder_is_refused(closed: Path, below: str) -> None:
    child = os.fork()
    if child == 0:
        if os.getuid() == 0:
            os.setuid(NOBODY)
        try:
            check_writable(closed / below)
        except OutputError as error:
            os._exit(0 if str(closed / below) in str(error) else 1)
        os._exit(1)
    assert os.waitpid(child, 0)[1] == 0


def test_full_disk_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, data: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(Path, "write_bytes", refuse)
    with pytest.raises(OutputError) as caught:
        check_writable(tmp_path / "out")
    assert caught.value.problems[0].place.file == str(tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_writable_folder_is_left_as_it_was(tmp_path: Path) -> None:
    check_writable(tmp_path / "new" / "deep")
    check_writable(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_unchanged_clip_needs_no_writable_folder(
    lesson: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mount that turned read-only still shows which clips are complete."""
    command = ["render", str(lesson), "-o", str(tmp_path / "out"), "--preview"]
    assert main(command) == 0

    def refuse(folder: Path) -> None:
        raise OutputError.of(str(folder), "", "cannot be written", "")

    monkeypatch.setattr("physgen.report.folders.check_writable", refuse)
    assert main(command) == 0
    assert main([*command, "--no-cache"]) == 2


def test_simulate_creates_the_folder_of_its_table(lesson: Path) -> None:
    for name in ("new/a.csv", "new/b.json", "new/c.npz"):
        output = lesson.parent / name
        assert main(["simulate", str(lesson), "-o", str(output)]) == 0
        assert output.is_file()
