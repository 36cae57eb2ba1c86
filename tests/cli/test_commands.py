"""The commands as a person runs them."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from physgen.cli.main import main
from physgen.simulate.trajectory import read_trajectory


@pytest.fixture
def photo(tmp_path: Path) -> tuple[Path, Path]:
    """A drawn photo of two blocks and a ball on a floor, and its label map."""
    rng = np.random.default_rng(3)
    picture = np.full((120, 160, 3), 90, np.uint8)
    picture[95:] = (60, 80, 100)
    labels = np.zeros((120, 160), np.uint16)
    for k, (x, colour) in enumerate(((20, (40, 60, 200)), (100, (200, 120, 40))), 1):
        picture[65:95, x : x + 24] = colour
        labels[65:95, x : x + 24] = k
    cv2.circle(picture, (72, 81), 14, (40, 200, 210), -1, cv2.LINE_AA)
    labels[
        np.hypot(*(np.mgrid[:120, :160] - np.array([81, 72])[:, None, None])) <= 14
    ] = 3
    noisy = np.clip(picture + rng.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "photo.png"), noisy)
    cv2.imwrite(str(tmp_path / "truth.png"), labels)
    return tmp_path / "photo.png", tmp_path / "truth.png"


def test_render_writes_everything_it_promises(
    lesson: Path, tmp_path: Path, capsys
) -> None:
    out = tmp_path / "out"
    assert (
        main(["render", str(lesson), "-o", str(out), "--format", "mp4,png,gif,webp"])
        == 0
    )
    assert capsys.readouterr().out == f"{out / 'lesson'}\n"
    folder = out / "lesson"
    manifest = json.loads((folder / "manifest.json").read_text())
    assert len(manifest["frames"]) == len(manifest["samples"]) == 6
    for name, digest in manifest["files"].items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest
    assert {
        "video.mp4",
        "video.gif",
        "video.webp",
        "report.html",
        "trajectory.npz",
    } <= set(manifest["files"])
    assert manifest["inputs"] == {
        "lesson.yaml": hashlib.sha256(lesson.read_bytes()).hexdigest()
    }
    first = cv2.imread(str(folder / "frames" / "00000.png"))[:, :, ::-1]
    text = f"{first.shape}".encode() + np.ascontiguousarray(first).tobytes()
    assert hashlib.sha256(text).hexdigest() == manifest["frames"][0]
    assert (
        read_trajectory(folder / "trajectory.npz").sample_hashes()
        == manifest["samples"]
    )


def test_rate_beyond_gif_is_reported_once(lesson: Path, tmp_path: Path, capsys) -> None:
    lesson.write_text(lesson.read_text().replace("fps: 24", "fps: 120"))
    command = ["render", str(lesson), "-o", str(tmp_path), "--format", "mp4,gif"]
    assert main(command) == 0
    [line] = capsys.readouterr().err.splitlines()
    row = lesson.read_text().partition("120}")[0]
    column = len(row.rpartition("\n")[2]) + 1
    assert line.startswith(f"{lesson}:{row.count(chr(10)) + 1}:{column}: render.fps: ")
    assert "120" in line
    assert "50" in line
    with av.open(str(tmp_path / "lesson" / "video.gif")) as container:
        frames = list(container.decode(video=0))
    assert len(frames) * 0.02 == pytest.approx(0.25, abs=0.02)


@pytest.mark.slow
def test_formats_that_fail_keep_the_others(
    lesson: Path, tmp_path: Path, capsys
) -> None:
    wide = lesson.read_text().replace("fps: 24", "fps: 24, size: [17000, 16]")
    lesson.write_text(wide)
    command = ["render", str(lesson), "-o", str(tmp_path), "--format", "mp4,webp,gif"]
    for _ in range(2):  # an incomplete clip is made again
        assert main(command) == 2
        told = capsys.readouterr().err
        for name in ("mp4", "webp"):
            assert told.count(f"--format {name}: 17000 x 16 px") == 1
        assert "--format gif" not in told
    folder = tmp_path / "lesson"
    files = json.loads((folder / "manifest.json").read_text())["files"]
    assert {Path(name).name for name in files if name.startswith("video")} == {
        "video.gif"
    }
    assert 'src="video.gif"' in (folder / "report.html").read_text()
    assert main([*command[:-1], "mp4,webp", "--no-cache"]) == 2
    assert (folder / "video.gif").exists()


@pytest.mark.slow
def test_video_is_written_if_another_format_fails(lesson: Path, tmp_path: Path) -> None:
    wide = lesson.read_text().replace("fps: 24", "fps: 24, size: [17000, 16]")
    lesson.write_text(wide)
    output = tmp_path / "clip.gif"
    command = ["render", str(lesson), "-o", str(output), "--format", "gif,webp"]
    assert main(command) == 2
    assert output.read_bytes() == (tmp_path / "clip" / "video.gif").read_bytes()


def test_what_an_earlier_run_wrote_goes_with_a_warning(
    lesson: Path, tmp_path: Path, capsys
) -> None:
    command = ["render", str(lesson), "-o", str(tmp_path), "--preview"]
    assert main(command) == 0
    assert "earlier" not in capsys.readouterr().err
    assert main([*command, "--format", "gif"]) == 0
    folder = tmp_path / "lesson"
    assert not (folder / "video.mp4").exists()
    warning = f"{folder}: warning: video.mp4 of an earlier run is removed; name all formats at once"
    assert warning in capsys.readouterr().err
    assert main([*command, "--format", "gif,mp4"]) == 0
    assert main([*command, "--format", "gif,mp4", "--no-cache"]) == 0
    assert capsys.readouterr().err == ""


def test_a_preview_leaves_the_finished_clip(
    lesson: Path, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["render", str(lesson)]) == 0
    before = (tmp_path / "out/lesson/video.mp4").read_bytes()
    assert main(["render", str(lesson), "--preview"]) == 0
    assert (tmp_path / "out/lesson/video.mp4").read_bytes() == before
    assert (tmp_path / "out/preview/lesson/video.mp4").exists()


def test_runs_and_jobs_give_the_same_bytes(lesson: Path, tmp_path: Path) -> None:
    other = lesson.with_name("other.yaml")
    other.write_text(lesson.read_text().replace("mass: 100", "mass: 150"))
    assert main(["render", str(lesson), str(other), "-o", str(tmp_path / "a")]) == 0
    assert (
        main(
            [
                "render",
                str(other),
                str(lesson),
                "-o",
                str(tmp_path / "b"),
                "--jobs",
                "2",
            ]
        )
        == 0
    )
    for name in ("lesson", "other"):
        for file in ("video.mp4", "trajectory.npz"):
            assert (tmp_path / "a" / name / file).read_bytes() == (
                tmp_path / "b" / name / file
            ).read_bytes()
    assert (tmp_path / "a" / "index.html").read_text().count('class="open" href') == 2


def test_two_scenes_of_one_name_are_refused(
    lesson: Path, tmp_path: Path, capsys
) -> None:
    twin = tmp_path / "twin" / "lesson.yaml"
    twin.parent.mkdir()
    twin.write_text(lesson.read_text())
    assert main(["render", str(lesson), str(twin), "-o", str(tmp_path / "out")]) == 2
    assert "both are called lesson" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    told = []
    for scene in (lesson, lesson, twin):  # one after the other
        assert (
            main(
                [
                    "render",
                    str(scene),
                    "-o",
                    str(tmp_path / "out"),
                    "--preview",
                    "--no-cache",
                ]
            )
            == 0
        )
        told.append(capsys.readouterr().err)
    assert [f"the earlier clip of {lesson} is replaced" in text for text in told] == [
        False,
        False,
        True,
    ]


@pytest.mark.parametrize("damage", [{"source": None}, {"source": 5}, {"files": 5}])
def test_a_strange_manifest_of_an_earlier_run_loses_no_clip(
    damage: dict, lesson: Path, tmp_path: Path, capsys
) -> None:
    command = ["render", str(lesson), "-o", str(tmp_path), "--preview", "--no-cache"]
    assert main(command) == 0
    path = tmp_path / "lesson" / "manifest.json"
    earlier = json.loads(path.read_text())
    path.write_text(json.dumps(earlier | damage))
    assert main(command) == 0
    assert json.loads(path.read_text())["source"] == earlier["source"]
    assert capsys.readouterr().err == ""


def test_an_emptied_scene_says_what_empties_it(lesson: Path, capsys) -> None:
    lesson.write_text("")  # as the shell's > does before a refresh begins
    assert main(["perceive", "--refresh", str(lesson)]) == 2
    assert "lesson.yaml: the file is empty" in (told := capsys.readouterr().err)
    assert "if `> FILE` emptied it: --refresh writes into the scene without >" in told


def test_check_tells_all(lesson: Path, capsys) -> None:
    assert main(["check", str(lesson), str(lesson)]) == 0
    assert capsys.readouterr() == (f"{lesson}: no problems\n" * 2, "")
    assert (
        main(
            [
                "check",
                str(lesson),
                "--set",
                "objects.*.rolling=0.1",
                "--set",
                "objects.ball.spin=nan",
            ]
        )
        == 2
    )
    told = capsys.readouterr()
    assert told.out == f"{lesson}: 1 error\n"
    assert "is not a number" in told.err
    assert main(["check", str(lesson), "--set", "objects.crate.rolling=0.1"]) == 0
    assert capsys.readouterr().out == f"{lesson}: 1 warning\n"
    assert (
        main(
            [
                "check",
                str(lesson),
                "--set",
                "objects.*.masss=5",
                "--set",
                "objects.*.mass=heavy",
            ]
        )
        == 2
    )
    told = capsys.readouterr()
    assert told.out == f"{lesson}: 2 errors\n"
    assert (
        told.err.count("\n") == 2
    )  # a mistake in a key with a star is one, however many objects there are
    assert (
        main(["check", str(lesson), "--set", "objects.crate.rolling=0.1", "--json"])
        == 0
    )
    told = json.loads(capsys.readouterr().out)
    assert [p["path"] for p in told["problems"]] == ["objects.crate.rolling"]
    assert told["problems"][0]["file"] == "--set objects.crate.rolling=0.1"
    assert (
        main(["check", str(lesson), "--set", "objects.crate.rolling=0.1", "--strict"])
        == 2
    )


def test_simulate_prints_csv_json_or_an_archive(
    lesson: Path, tmp_path: Path, capsys
) -> None:
    assert main(["simulate", str(lesson), "--rate", "100"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "time_s,name,x_px,y_px,angle_rad,vx_px_s,vy_px_s,spin_rad_s"
    assert len(lines) == 1 + 26 * 2
    assert main(["simulate", str(lesson), "--rate", "100", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["names"] == ["ball", "crate"]
    assert (
        main(["simulate", str(lesson), "--rate", "100", "-o", str(tmp_path / "t.json")])
        == 0
    )
    assert json.loads((tmp_path / "t.json").read_text()) == data
    assert (
        main(["simulate", str(lesson), "--rate", "100", "-o", str(tmp_path / "t.csv")])
        == 0
    )
    assert (tmp_path / "t.csv").read_text().splitlines() == lines
    assert (
        main(["simulate", str(lesson), "--rate", "100", "-o", str(tmp_path / "t.npz")])
        == 0
    )
    assert np.array_equal(np.load(tmp_path / "t.npz")["poses"], np.array(data["poses"]))


def test_perceive_writes_a_valid_scene_that_renders_and_keeps_an_edited_one(
    photo: tuple[Path, Path], tmp_path: Path, capsys
) -> None:
    image, truth = photo
    scene = tmp_path / "made" / "scene.yaml"
    assert main(["perceive", str(image), "--masks", str(truth), "-o", str(scene)]) == 0
    assert main(["check", str(scene)]) == 0
    told = capsys.readouterr()
    assert told.out.splitlines()[0] == str(scene)
    text = scene.read_text()
    assert text.startswith(
        "# yaml-language-server: $schema=scene.assets/scene-1.schema.json\n"
    )
    assert json.loads((tmp_path / "made/scene.assets/scene-1.schema.json").read_text())[
        "properties"
    ]["objects"]
    assert "from:" in text
    assert {p.name for p in (tmp_path / "made" / "scene.assets").iterdir()} >= {
        "masks.png",
        "coverage.png",
        "background.png",
        "photo.png",
    }
    short = ["--format", "png", "--set", "world.duration=0.2"]
    assert main(["render", str(scene), "-o", str(tmp_path / "out"), *short]) == 0
    [folder] = (p for p in (tmp_path / "out").iterdir() if p.is_dir())
    assert np.array_equal(
        cv2.imread(str(folder / "frames" / "00000.png")), cv2.imread(str(image))
    )
    scene.write_text(text + "# mine\n")
    capsys.readouterr()
    assert main(["perceive", str(image), "--masks", str(truth), "-o", str(scene)]) == 0
    assert "# mine" in scene.with_name("scene.yaml~").read_text()
    assert f"the previous {scene} is kept as scene.yaml~\n" in capsys.readouterr().err


@pytest.mark.slow
def test_a_large_photo_is_made_smaller_with_its_masks(
    photo: tuple[Path, Path], tmp_path: Path, capsys
) -> None:
    image, truth = photo
    for name, kind in ((image, cv2.INTER_CUBIC), (truth, cv2.INTER_NEAREST)):
        picture = cv2.imread(str(name), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(
            str(tmp_path / f"big-{name.name}"),
            cv2.resize(picture, (400, 300), interpolation=kind),
        )
    scene, masks = tmp_path / "scene.yaml", ["--masks", str(tmp_path / "big-truth.png")]
    assert (
        main(
            [
                "perceive",
                str(tmp_path / "big-photo.png"),
                *masks,
                "--side",
                "200",
                "-o",
                str(scene),
            ]
        )
        == 0
    )
    assert (
        "the photo of 400 x 300 px was made 200 x 150 px; --side 400 keeps its size"
        in capsys.readouterr().err
    )
    labels = cv2.imread(
        str(tmp_path / "scene.assets" / "masks.png"), cv2.IMREAD_UNCHANGED
    )
    assert labels.shape == (150, 200)
    assert set(np.unique(labels)) == {0, 1, 2, 3}
    assert main(["check", str(scene)]) == 0
    again = [
        "--masks",
        str(tmp_path / "scene.assets" / "masks.png"),
        "--side",
        "200",
        "-o",
        str(scene),
    ]
    assert main(["perceive", str(tmp_path / "big-photo.png"), *again]) == 0


@pytest.mark.slow
def test_perceive_on_stdout_puts_assets_beside(
    photo: tuple[Path, Path], monkeypatch, capsys
) -> None:
    image, _ = photo
    monkeypatch.chdir(image.parent)
    assert main(["perceive", "photo.png", "--masks", "truth.png"]) == 0
    Path("scene.yaml").write_text(capsys.readouterr().out)
    assert Path("photo.assets/masks.png").is_file()
    assert main(["check", "scene.yaml"]) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["perceive", "no.png"], "no.png: no such file; check the path"),
        (
            ["perceive", "{photo}", "--box", "1,2"],
            '--box: "1,2" is not 4 numbers; write --point, or px of the photo, e.g. 120,80,60,60',
        ),
        (
            ["perceive", "{photo}", "--masks", "{photo}", "--box", "1,2,3,4"],
            "has the objects in more than one way",
        ),
        (["perceive", "{photo}", "--backend", "segment=sam9"], "sam9"),
        (["render", "{lesson}", "--set", "objects.ball.mass"], "--set"),
        (["render", "{lesson}", "--variant", "hevy"], "heavy"),
        (["simulate", "{lesson}", "--variant", "all"], "names more than one"),
        (["import", "physgen", "no-such-folder"], "no-such-folder: is not a folder"),
        (
            ["simulate", "{lesson}", "-o", "{lesson}"],
            "is not a name for a trajectory; end it in .npz, .csv or .json",
        ),
        (["perceive", "{photo}", "--point=-1,3"], "is outside the 160 x 120 photo"),
        (
            ["perceive", "{photo}", "--box=200,3,50,50"],
            "is outside the 160 x 120 photo",
        ),
        (
            ["perceive", "{photo}", "--box=10,10,0,5"],
            "--box 10,10,0,5: is under 4 px wide or high",
        ),
        (["simulate", "{lesson}", "-o", "."], "is not a name for a trajectory"),
        (
            ["perceive", "{photo}", "-o", "{photo}"],
            "is not a name for a scene file; end it in .yaml",
        ),
        (["perceive", "{photo}", "-o", "-"], "is not a name for a scene file"),
        (["render", "{lesson}", "-o", "{lesson}"], "is a file"),
    ],
)
def test_wrong_input_gets_one_message(
    arguments, message, lesson: Path, photo, capsys
) -> None:
    names = {"lesson": str(lesson), "photo": str(photo[0]), "truth": str(photo[1])}
    before = sorted(lesson.parent.iterdir())
    assert main([a.format(**names) for a in arguments]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert message in told.err
    assert (
        len(
            [
                line
                for line in told.err.splitlines()
                if "suitability" not in line and line[0] != " "
            ]
        )
        == 1
    )
    assert sorted(lesson.parent.iterdir()) == before


def test_wrong_flags_get_one_line_and_exit_2(capsys) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["render", "x.yaml", "--format", "avi"])
    assert stop.value.code == 2
    assert (
        capsys.readouterr().err
        == "physgen render: argument --format: avi is not among the choices; "
        "write some of mp4, gif, webp, png; see physgen render --help\n"
    )


def test_every_command_shows_an_example(capsys) -> None:
    for command in (
        "perceive", "import", "check", "simulate", "render", "sweep", "backends", "schema",
    ):  # fmt: skip
        with pytest.raises(SystemExit) as stop:
            main([command, "--help"])
        assert stop.value.code == 0
        assert f"example: physgen {command}" in capsys.readouterr().out


def test_backends_and_schema_print(capsys) -> None:
    assert main(["backends", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["backends"]
    assert {"segment", "inpaint"} <= {row["role"] for row in rows}
    assert main(["backends"]) == 0
    assert main(["schema"]) == 0
    assert '"$schema"' in capsys.readouterr().out


@pytest.mark.slow
def test_a_command_imports_only_what_it_uses() -> None:
    def modules(code: str) -> set[str]:
        code = f"import sys\n{code}\nprint('\\n'.join(sys.modules), file=sys.stderr)"
        run = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        return {name.split(".")[0] for name in run.stderr.split()}

    def command(*arguments: str) -> str:
        return f"from physgen.cli.main import main\nmain({list(arguments)!r})"

    motion = {"pymunk", "av", "jinja2", "jsonschema", "scipy", "torch"}
    heavy = motion | {"numpy", "cv2", "yaml", "PIL", "imageio", "shapely", "csv"}
    scenes = Path(__file__).parents[2] / "scenes"
    assert not modules("import physgen") & (heavy | {"lazy_loader"})
    assert not modules("import physgen.pipeline") & heavy
    assert not modules("from physgen.cli.main import build_parser\nbuild_parser()") & (
        heavy
    )
    assert not modules(command("backends")) & heavy
    assert not modules(command("schema")) & heavy
    assert not modules(command("clean", str(scenes / "billiards"))) & (
        heavy - {"numpy", "yaml"}
    )
    assert not modules(command("check", str(scenes / "billiards/scene.yaml"))) & motion
    batch = modules("from physgen.batch import run, workers")
    assert not batch & motion, "the process that distributes clips"
    # A server that nobody asks needs no library: it belongs to the extra `models`.
    perceiving = modules("from physgen.pipeline import perceiving, story_server")
    assert not perceiving & {"openai", "torch"}
    load = f"from physgen.scene.load import load\nload({str(scenes / 'physics/05-slide.yaml')!r})"
    assert not modules(load) & {"PIL", "jsonschema", "cv2"}, "without a photo"


@pytest.mark.slow
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_batch_ends_and_leaves_nothing(
    sign: signal.Signals, lesson: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(lesson.read_text())
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "physgen",
        "render",
        str(lesson),
        str(other),
        "-o",
        str(out),
        "--jobs",
        "2",
    ]
    batch = subprocess.Popen(
        [*command, "--set", "render.frames=8000"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    deadline = time.monotonic() + 120
    while (
        not (out.exists() and len(list(out.glob(".*.part"))) == 2)
        and time.monotonic() < deadline
    ):
        time.sleep(0.05)
    if sign is signal.SIGINT:
        os.killpg(batch.pid, sign)  # as a terminal does
    else:
        batch.send_signal(sign)
    _, told = batch.communicate(timeout=60)
    assert batch.returncode == 130
    assert b"Traceback" not in told
    assert list(out.iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(("render", "SCENE", "-o", "s3://bucket/out"), id="output"),
        pytest.param(("render", "s3://bucket/scene.yaml"), id="scene"),
    ],
)
def test_urls_are_refused_and_nothing_is_written(
    lesson: Path, tmp_path: Path, monkeypatch, capsys, arguments: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(SystemExit) as ended:
        main([str(lesson) if text == "SCENE" else text for text in arguments])
    assert ended.value.code == 2
    assert "mount the store, or copy the files" in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("velocity", "is_warned"), [(4000, True), (-4000, True), (300, False), (0, False)]
)
def test_departure_of_all_moving_objects_warns(
    velocity: int, is_warned: bool, lesson: Path, tmp_path: Path, capsys
) -> None:
    """A clip whose picture is still from its first fifth on; the crate rests."""
    text = lesson.read_text().replace("[300, 0]", f"[{velocity}, -200]")
    lesson.write_text(text)
    lift = "objects.ball.shape.circle.center=[25, 20]"
    command = ["render", str(lesson), "-o", str(tmp_path / "out"), "--set", lift]
    assert main(command) == 0
    line = f"{lesson}:5:3: warning: "
    warnings = [text for text in capsys.readouterr().err.splitlines() if "left" in text]
    assert [text.startswith(line) for text in warnings] == [True] * is_warned
    (manifest,) = (tmp_path / "out").glob("*/manifest.json")
    assert len(json.loads(manifest.read_text())["warnings"]) == is_warned


@pytest.mark.parametrize("command", ["check", "simulate", "render"])
@pytest.mark.parametrize("duration", ["0.1", "auto"])
def test_problem_of_simulation_names_its_line(
    command: str, duration: str, lesson: Path, tmp_path: Path, capsys
) -> None:
    """A spring that is too stiff to simulate; `check` refuses what `render` refuses."""
    spring = "joints:\n  s: {objects: [ball], spring: [[25, 45], [5, 5]], stiffness: 1.0e+14}\n"
    lesson.write_text(lesson.read_text().replace("0.25", duration) + spring)
    outputs = {"simulate": "out.csv", "render": "out"}
    output = ["-o", str(tmp_path / outputs[command])] if command in outputs else []
    assert main([command, str(lesson), *output]) == 2
    place = f"{lesson}:13:63: joints.s.stiffness: "
    assert [
        line.startswith(place) for line in capsys.readouterr().err.splitlines()
    ] == [True]


@pytest.mark.parametrize("names", [("\udcff.png", "a.yaml"), ("a.png", "\udcff.yaml")])
def test_perceive_refuses_names_that_are_not_utf8(
    names: tuple[str, str], photo: tuple[Path, Path], tmp_path: Path, capsysbinary
) -> None:
    """A scene file could not name the photo, or its own assets."""
    source, output = (tmp_path / name for name in names)
    photo[0].rename(source)
    before = {path.name for path in tmp_path.iterdir()}
    assert main(["perceive", str(source), "-o", str(output)]) == 2
    (line,) = capsysbinary.readouterr().err.splitlines()
    assert b"\\udcff." in line
    assert {path.name for path in tmp_path.iterdir()} == before
