"""`pack` and `unpack`, and the commands that take a pack for a scene."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest

from physgen.cli.main import main

SCENE = """\
physgen: 1  # a lesson
size: [96, 64]
world: {duration: 0.2}
objects:
  ball: {shape: {circle: {center: [30, 20], radius: 9}}, mass: 100}
render: {fps: 20}
variants:
  heavy: {objects.ball.mass: 900}
"""
Capture = pytest.CaptureFixture[str]


@pytest.fixture
def lesson(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "lesson" / "scene.yaml"
    path.parent.mkdir()
    path.write_text(SCENE)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return path


def test_there_and_back(lesson: Path, capsys: Capture) -> None:
    assert main(["pack", str(lesson)]) == 0
    assert capsys.readouterr() == ("lesson.physgen\n", "")
    assert main(["pack", str(lesson), "-o", "deep/other.physgen"]) == 0
    assert Path("deep/other.physgen").read_bytes() == Path("lesson.physgen").read_bytes()
    assert main(["unpack", "lesson.physgen"]) == 0
    assert main(["unpack", "lesson.physgen", "-o", "apart"]) == 0
    assert (
        capsys.readouterr().out == "deep/other.physgen\nlesson/lesson/scene.yaml\napart/lesson/scene.yaml\n"
    )
    assert Path("apart/lesson/scene.yaml").read_text() == SCENE


def test_a_file_that_is_no_pack_is_kept(lesson: Path, capsys: Capture) -> None:
    mine = Path("lesson.physgen")
    mine.write_text("mine")
    assert main(["pack", str(lesson)]) == 0
    assert (
        capsys.readouterr().err == "lesson.physgen: was there already and differed; kept as lesson.physgen~\n"
    )
    assert Path("lesson.physgen~").read_text() == "mine"
    lesson.write_text(SCENE.replace("mass: 100", "mass: 101"))
    assert main(["pack", str(lesson)]) == 0  # an earlier pack makes way
    assert capsys.readouterr().err == ""
    assert len(list(Path.cwd().iterdir())) == 2


def test_commands_take_a_pack_for_its_scene(lesson: Path, capsys: Capture) -> None:
    main(["pack", str(lesson)])
    capsys.readouterr()
    said = []
    for path in (str(lesson), "lesson.physgen"):
        assert main(["simulate", path, "--set", "objects.ball.spin=90", "--variant", "heavy"]) == 0
        assert main(["check", path, "--resolved"]) == 0
        said.append(capsys.readouterr().out)
    assert said[0] == said[1]
    assert main(["check", "lesson.physgen", "--set", "objects.ball.mass=heavy"]) == 2
    assert 'objects.ball.mass: "heavy" is not a number' in capsys.readouterr().err
    assert main(["render", "lesson.physgen", "--variant", "all", "--report", "none", "--jobs", "2"]) == 0
    capsys.readouterr()
    assert main(["render", "lesson.physgen", "--variant", "all", "--report", "none", "--json"]) == 0
    assert capsys.readouterr().out.count('"state": "unchanged"') == 2
    assert main(["render", str(lesson), "-o", "other", "--report", "none"]) == 0
    assert sorted(p.name for p in Path("out").iterdir() if p.is_dir()) == [
        "index.files",
        "lesson",
        "lesson-heavy",
    ]
    for file in ("video.mp4", "trajectory.npz"):
        assert (Path("out/lesson") / file).read_bytes() == (Path("other/lesson") / file).read_bytes()
    told = json.loads(Path("out/lesson/manifest.json").read_text())
    assert told["source"] == "../../lesson.physgen"
    assert list(told["inputs"]) == ["scene.yaml"]
    capsys.readouterr()
    assert main(["verify", "out", "other"]) == 0
    assert capsys.readouterr().err == "3 clips: 3 equal\n"
    assert (
        main(["sweep", "lesson.physgen", "objects.ball.mass=50,60", "-o", "swept", "--report", "none"]) == 0
    )
    capsys.readouterr()
    assert main(["verify", "swept"]) == 0
    assert capsys.readouterr().err == "2 clips: 2 equal\n"


def test_refusals_write_nothing(lesson: Path, capsys: Capture) -> None:
    here = Path.cwd()
    wrong = lesson.with_name("wrong.yaml")
    wrong.write_text(SCENE.replace("mass: 100", "mass: heavy"))
    with zipfile.ZipFile(lesson.with_name("docs.zip"), "w") as archive:
        archive.writestr("a.txt", "a")
    no_pack = (
        f"{lesson.with_name('docs.zip')}: is a zip, but no pack: it has no pack.json; "
        "name a file that physgen pack wrote"
    )
    cut = lesson.with_name("cut.physgen")
    cut.write_text("physgen: 1")
    cases = [
        (
            ["pack", str(lesson), "-o", "scene.yaml"],
            '-o: "scene.yaml" is no name for a pack; end it in .physgen',
        ),
        (
            ["pack", str(wrong)],
            f'{wrong}:5:64: objects.ball.mass: "heavy" is not a number; '
            "write grams, or a number with mg, g or kg behind it, e.g. 170",
        ),
        (["unpack", "none.physgen"], "none.physgen: no such file; name a file that physgen pack wrote"),
        (
            ["unpack", str(lesson.parent)],
            f"{lesson.parent}: does not end in .physgen; name a folder for its files with -o",
        ),
        (
            ["unpack", str(lesson.parent), "-o", "x"],
            f"{lesson.parent}: is no pack; name a file that physgen pack wrote",
        ),
        (["unpack", str(lesson.with_name("docs.zip")), "-o", "x"], no_pack),
        (["check", str(lesson.with_name("docs.zip"))], no_pack),
        (["render", str(cut)], f"{cut}: is no pack; name a file that physgen pack wrote"),
    ]
    for arguments, said in cases:
        assert main(arguments) == 2
        assert capsys.readouterr().err == f"{said}\n"
    assert list(here.iterdir()) == []


def test_faults_and_oddities_are_told_by_the_name_of_the_pack(lesson: Path, capsys: Capture) -> None:
    base = lesson.parent.parent / "base" / "base.yaml"
    base.parent.mkdir()
    base.write_text(SCENE.replace("mass: 100", "masss: 100"))
    lesson.write_text("physgen: 1\nextends: ../base/base.yaml\nrender: {fps: slow}\n")
    with zipfile.ZipFile("bad.physgen", "w") as archive:
        archive.writestr("pack.json", '{"pack": 1, "scene": "lesson/scene.yaml"}')
        archive.write(lesson, "lesson/scene.yaml")
        archive.write(base, "base/base.yaml")
    Path("folder").mkdir()
    copy = Path("folder", "same.physgen")
    copy.write_bytes(Path("bad.physgen").read_bytes())
    for name in ("bad.physgen", str(copy)):
        for command in (
            ["check", name],
            *(
                [["render", name], ["render", name, "nothing.yaml", "--jobs", "2"]]
                if name == "bad.physgen"
                else []
            ),
            ["sweep", name, "objects.ball.friction=0.1,0.2"],
            ["sweep", name, "objects.ball.friction=0.1,0.2", "--dry-run"],
            ["simulate", name],
            ["check", name, "--json"],
        ):
            assert main(command) == 2, command
            told = capsys.readouterr()
            if "--json" in command:
                places = [problem["file"] for problem in json.loads(told.out)["problems"]]
            else:
                places = [
                    line.partition(".yaml")[0] + ".yaml"
                    for line in told.err.splitlines()
                    if "physgen: " in line
                ]
            assert set(places) == {f"{name}: base/base.yaml", f"{name}: lesson/scene.yaml"}, command
    lesson.write_text(SCENE.replace("mass: 100}", "mass: 100, motion: static, velocity: [9, 0]}"))
    assert main(["pack", str(lesson)]) == 0
    capsys.readouterr()
    assert main(["check", "lesson.physgen"]) == 0
    odd = capsys.readouterr().err.splitlines()
    assert odd
    assert all(line.startswith("lesson.physgen: lesson/scene.yaml:") for line in odd)
