"""`physgen refine` as a person runs it, with a model that is known exactly in place of those that have weights."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import cv2
import gaussian
import numpy as np
import pytest
from PIL import Image
from pytest import approx

from physgen import registry
from physgen.cli.main import main
from physgen.export.video import Format, open_video
from physgen.problems import InputError
from physgen.refine.denoiser import PromptSettings
from physgen.refine.fusion import Refinement, RefineSettings
from physgen.registry import Backend
from physgen.scene.schema import at

SIZE, COUNT, FPS = (45, 34), 6, 12.0
ROWS = (
    Backend("refine", "none", "gaussian:made", "Leaves all as it is.", takes_setup=True),
    Backend("refine", "animatediff", "gaussian:made", "Stands for the default.", takes_setup=True),
    Backend("refine", "exact", "gaussian:made", "Exact.", takes_setup=True),
    Backend("refine", "failing", "test_refine_command:failing", "Fails.", takes_setup=True),
    Backend("refine", "gone", "test_refine_command:gone", "Lacks its weights.", takes_setup=True),
    Backend("refine", "stopped", "test_refine_command:stopped", "Is interrupted.", takes_setup=True),
)


class Failing(gaussian.Gaussian):
    wrong: type[BaseException] = RuntimeError

    def predict(self, latents, k, first):
        if k == 3:
            raise self.wrong("of no kind that anybody foresaw\nin two lines")
        return super().predict(latents, k, first)


class Stopped(Failing):
    wrong = KeyboardInterrupt


def gone(setup):
    raise InputError.of("--refine", "", "no weights", "get them")


def failing(setup):
    return Failing()


def stopped(setup):
    return Stopped()


@pytest.fixture(autouse=True)
def _rows(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    others = tuple(row for row in registry.BACKENDS if row.role != "refine")
    monkeypatch.setattr(registry, "BACKENDS", (*others, *ROWS))
    monkeypatch.setitem(sys.modules, "test_refine_command", sys.modules[__name__])
    monkeypatch.chdir(tmp_path)


def drawn() -> tuple[np.ndarray, np.ndarray]:
    """A disc that moves over a grained ramp: (F, H, W, 3) frames, and its coverage (F, H, W) in 255ths."""
    rng = np.random.default_rng(1)
    yy, xx = np.mgrid[: SIZE[1], : SIZE[0]]
    ground = np.stack([60 + 3 * xx, 40 + 4 * yy, 0 * xx + 120], axis=-1) + rng.integers(
        -9, 10, (*yy.shape, 3)
    )
    cover = np.stack([np.clip(8.5 - np.hypot(xx - 10 - 3 * k, yy - 17), 0, 1) for k in range(COUNT)])
    cover = np.rint(cover * 255).astype(np.uint8)
    share = cover[..., None] / 255
    return np.rint(ground + share * ((220, 200, 60) - ground)).astype(np.uint8), cover


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    (tmp_path / "frames").mkdir()
    for k, rgb in enumerate(drawn()[0]):
        Image.fromarray(rgb).save(tmp_path / "frames" / f"{k}.png")
    return tmp_path / "frames"


@pytest.fixture
def masks(tmp_path: Path) -> Path:
    (tmp_path / "masks").mkdir()
    for k, cover in enumerate(drawn()[1]):
        Image.fromarray(cover).save(tmp_path / "masks" / f"{k}.png")
    return tmp_path / "masks"


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    (tmp_path / "made").mkdir()
    with open_video(tmp_path / "made", Format.MP4, SIZE, FPS) as put:
        for rgb in drawn()[0]:
            put(rgb)
    return (tmp_path / "made" / "video.mp4").rename(tmp_path / "clip.mp4")


def pictures(folder: Path) -> np.ndarray:
    return np.stack([np.asarray(Image.open(path)) for path in sorted(folder.iterdir())])


def played(path: Path) -> tuple[np.ndarray, float]:
    """Frames as OpenCV sees them, and frames a second."""
    video = cv2.VideoCapture(str(path))
    found = []
    while (read := video.read())[0]:
        found.append(read[1][..., ::-1])
    return np.stack(found), video.get(cv2.CAP_PROP_FPS)


def sha(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_frames_are_those_of_algorithm_1_to_the_byte(
    frames: Path, masks: Path, tmp_path: Path, capsys
) -> None:
    how = (
        "--strength 0.4 --stop 3 --steps 20 --seed 7 --lock 0.25 --detail 0.5 --negative blur --guidance 3.5"
    )
    asked = ["refine", "frames", "--masks", "masks", "-o", "new", "--prompt", "a disc", *how.split()]
    assert main(asked) == 0
    assert capsys.readouterr() == ("new\n", "")
    rgb, cover = drawn()
    said = PromptSettings("a disc", "blur", 3.5)
    direct = Refinement(gaussian.Gaussian(), RefineSettings(0.4, 3, 20, 7, said, 0.25, 0.5, 0), SIZE, COUNT)
    wanted = list(direct.frames(list(rgb), list(cover / np.float32(255))))
    assert np.array_equal(pictures(tmp_path / "new"), wanted)
    assert np.abs(np.stack(wanted).astype(int) - rgb).mean() > 3


def test_locked_objects_and_a_kept_first_frame_are_the_guidance_to_the_byte(frames, masks, tmp_path) -> None:
    assert main(["refine", "frames", "--masks", "masks", "-o", "new", "--lock", "1", "--keep-first"]) == 0
    rgb, cover = drawn()
    new = pictures(tmp_path / "new")
    assert np.array_equal(new[0], rgb[0])
    assert np.array_equal(new[cover == 255], rgb[cover == 255])
    change = np.abs(new.astype(int) - rgb).mean(axis=(1, 2, 3))
    assert change[1] < 0.2 * change[-1]


@pytest.mark.parametrize("ending", [".mp4", ".gif", ".webp", ""])
def test_what_is_written_can_be_played_and_keeps_its_rate(
    ending: str, clip: Path, masks: Path, tmp_path
) -> None:
    assert (
        main(["refine", "clip.mp4", "--masks", "masks", "-o", f"sub/dir/new{ending}", "--detail", "1"]) == 0
    )
    output = tmp_path / "sub" / "dir" / f"new{ending}"
    record = json.loads(output.with_suffix(".json").read_text())
    assert record["video"]["fps"] == FPS
    even = (SIZE[0] + 1, SIZE[1])  # what H.264 had made of it
    if ending == ".mp4":
        shown, fps = played(output)
        assert fps == approx(FPS)
    elif ending:
        shown = np.stack([frame[..., 2::-1] for frame in cv2.imreadanimation(str(output))[1].frames])
    else:
        shown = pictures(output)
    assert shown.shape == (COUNT, *even[::-1], 3)
    exact = pictures(tmp_path / "sub/dir/new") if not ending else None
    if exact is not None:
        hashes = [hashlib.sha256(f"{f.shape}".encode() + f.tobytes()).hexdigest() for f in exact]
        assert hashes == record["frames"]
    assert {p.name for p in output.parent.iterdir()} == {output.name, "new.json"}


def test_the_record_tells_what_ran_on_what(clip: Path, masks: Path, tmp_path: Path, capsys) -> None:
    assert main(["refine", "clip.mp4", "--masks", "masks", "--json", "--prompt", "a disc"]) == 0
    told = capsys.readouterr()
    printed = json.loads(told.out)
    record = json.loads((tmp_path / "clip.refined.json").read_text())
    assert printed == {"output": "clip.refined.mp4", "record_path": "clip.refined.json", "record": record}
    assert record["output"] == {"path": "clip.refined.mp4", "sha256": sha(tmp_path / "clip.refined.mp4")}
    assert record["video"]["sha256"] == sha(clip)
    assert (record["video"]["path"], record["video"]["size"]) == ("clip.mp4", [46, 34])
    lines = "".join(f"{sha(path)}  {path.name}\n" for path in sorted(masks.iterdir()))
    digest = hashlib.sha256(lines.encode()).hexdigest()
    assert record["masks"] == {"path": "masks", "sha256": digest}
    assert record["backend"] == {"name": "animatediff", "weights": ""}
    assert len(record["frames"]) == COUNT
    ran = record["refine"]
    for key in ("strength", "steps", "seed", "lock", "detail", "negative"):
        assert ran[key] == at(f"refine.{key}")["default"]
    assert (ran["steps_run"], ran["steps_fused"], ran["prompt"]) == (25, 20, "a disc")
    assert (ran["revision"], ran["weights"]) == ("exact", "N(mean, spread^2)")
    assert str(tmp_path) not in json.dumps({key: record[key] for key in record if key != "command"})


def test_a_seed_gives_the_same_bytes_and_what_differs_is_kept(
    clip: Path, masks: Path, tmp_path, capsys
) -> None:
    run = ["refine", "clip.mp4", "--masks", "masks", "--prompt", "a disc"]
    assert main(run) == 0
    first, record = sha(tmp_path / "clip.refined.mp4"), sha(tmp_path / "clip.refined.json")
    assert main(run) == 0
    assert (sha(tmp_path / "clip.refined.mp4"), sha(tmp_path / "clip.refined.json")) == (first, record)
    assert not list(tmp_path.glob("*~"))
    capsys.readouterr()
    assert main([*run, "--seed", "1"]) == 0
    assert sha(tmp_path / "clip.refined.mp4") != first
    assert sha(tmp_path / "clip.refined.mp4~") == first
    assert sha(tmp_path / "clip.refined.json~") == record
    assert capsys.readouterr().err.splitlines() == [
        f"clip.refined.{kind}: was there already and differed; kept as clip.refined.{kind}~"
        for kind in ("mp4", "json")
    ]


def test_without_masks_everything_may_change_and_that_is_said(frames: Path, tmp_path: Path, capsys) -> None:
    assert main(["refine", "frames", "-o", "new"]) == 0
    assert capsys.readouterr().err.splitlines() == [
        "frames: warning: has no masks, so objects may change as all else; hold them: --masks DIR",
        "frames: warning: is refined by a model without a prompt; say it, e.g. "
        '--prompt "billiard balls on green cloth"',
    ]
    rgb, cover = drawn()
    how = RefineSettings(0.5, 5, 50, 0, PromptSettings("", "", None), 0.0, 1.0, 0)
    direct = Refinement(gaussian.Gaussian(), how, SIZE, COUNT).frames(
        list(rgb), [0 * cover[0] / np.float32(1)] * COUNT
    )
    assert np.array_equal(pictures(tmp_path / "new"), list(direct))
    assert json.loads((tmp_path / "new.json").read_text())["masks"] is None


def test_a_configuration_may_say_who_refines(frames: Path, tmp_path: Path, capsys) -> None:
    (tmp_path / "physgen.toml").write_text(
        '[backend]\nrefine = "exact"\nsegment = "sam3"\n[exact]\nmean = 0.5\n'
    )
    config = ["--config", "physgen.toml"]
    assert main(["refine", "frames", "-o", "a", *config]) == 0
    assert "physgen.toml: chooses the backend that refines, unless a flag does\n" in capsys.readouterr().err
    assert main(["refine", "frames", "-o", "b", "--backend", "animatediff", *config]) == 0
    a, b = (json.loads((tmp_path / f"{name}.json").read_text()) for name in "ab")
    assert [record["backend"]["name"] for record in (a, b)] == ["exact", "animatediff"]
    assert a["frames"] != b["frames"]


MESSAGES = {
    "no film": (["notes.txt"], "notes.txt: is not a video that can be read"),
    "masks of another size": (
        ["clip.mp4", "--masks", "small"],
        "small/0.png: 20 x 10 px differs from the video's 46 x 34 px; make masks the video's size",
    ),
    "strength 0": (
        ["clip.mp4", "--strength", "0"],
        "--strength: 0 leaves none of 50 steps to run; write at least 0.01\n",
    ),
    "a strength too little": (
        ["clip.mp4", "--steps", "4", "--strength", "0.1"],
        "--strength: 0.1 leaves none of 4 steps to run; write at least 0.13\n",
    ),
    "another ending": (
        ["clip.mp4", "-o", "new.avi"],
        '-o: "new.avi" is no name for a video; end it in .mp4, .gif, .webp, or name a folder for PNG frames',
    ),
    "over itself": (
        ["clip.mp4", "-o", "clip.mp4"],
        '-o: "clip.mp4" is where the video is read from; choose another',
    ),
    "over its masks": (
        ["clip.mp4", "--masks", "masks", "-o", "masks"],
        '-o: "masks" is where the masks is read from; choose another name',
    ),
    "over a folder of others": (
        ["clip.mp4", "-o", "small"],
        '-o: "small" is there already and holds notes.txt; choose a new folder, or a video in it: small/clip.mp4',
    ),
    "over a folder": (
        ["clip.mp4", "-o", "folder.mp4"],
        '-o: "folder.mp4" is a folder; write e.g. folder.mp4/clip.mp4',
    ),
    "over a file": (["clip.mp4", "-o", "plain"], '-o: "plain" is a file; choose a new folder'),
    "nobody": (
        ["clip.mp4", "--backend", "none"],
        '--backend: "none" leaves the video as it is; name a backend, e.g. --backend animatediff',
    ),
    "an unknown model": (
        ["clip.mp4", "--backend", "exat"],
        '--backend: refine="exat" is not a backend; did you mean',
    ),
    "a lock on nothing": (
        ["clip.mp4", "--lock", "1"],
        "--lock: 1 has no objects to put back; name masks: --masks DIR, or leave --lock out",
    ),
    "an unknown device": (["clip.mp4", "--device", "tpu"], '--device: "tpu" is no device'),
}


@pytest.mark.parametrize(("arguments", "message"), MESSAGES.values(), ids=MESSAGES)
def test_wrong_input_is_one_message_and_nothing_is_written(
    arguments: list[str], message: str, clip: Path, masks: Path, tmp_path: Path, capsys
) -> None:
    (tmp_path / "notes.txt").write_text("no film")
    (tmp_path / "plain").write_text("a file")
    for name in ("small", "folder.mp4"):
        (tmp_path / name).mkdir()
    for k in range(COUNT):
        Image.new("L", (20, 10), 255).save(tmp_path / "small" / f"{k}.png")
    (tmp_path / "small" / "notes.txt").write_text("mine")
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    assert main(["refine", *arguments]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith(message)
    assert len(told.err.splitlines()) == 1
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


@pytest.mark.parametrize("key", ["strength", "stop", "steps", "seed", "guidance", "lock", "detail"])
def test_ranges_are_those_of_a_scene(key: str, capsys) -> None:
    part = at(f"refine.{key}")
    whole = "whole " if part["type"] == "integer" else ""
    for wrong in (
        f"{part['maximum'] + 1}",
        f"-{part['maximum']}",
        "nan",
        "lots",
        *(["1.5"] if whole else []),
    ):
        with pytest.raises(SystemExit) as stop:
            main(["refine", "clip.mp4", f"--{key}={wrong}"])
        assert stop.value.code == 2
        ends = f"from {part['minimum']} to {part['maximum']}"
        message = f"{wrong} is not a {whole}number {ends}; see physgen refine --help\n"
        assert capsys.readouterr().err == f"physgen refine: argument --{key}: {message}"


def test_too_little_memory_is_reported(clip: Path, tmp_path: Path, capsys) -> None:
    (tmp_path / "small.toml").write_text("[exact]\nmost = 400\n")
    before = sorted(tmp_path.rglob("*"))
    run = "refine clip.mp4 --prompt x --backend exact --config small.toml -o out/new.mp4"
    assert main(run.split()) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.splitlines()[1:] == [
        "refine: 6 latent frames of 48 x 40 px do not fit into the memory of the device; "
        "write a smaller resolution in the backend's table of physgen.toml, or refine fewer frames"
    ]
    assert sorted(tmp_path.rglob("*")) == before


def test_a_model_that_fails_is_one_line_and_leaves_nothing(clip: Path, tmp_path: Path, capsys) -> None:
    before = sorted(tmp_path.rglob("*"))
    assert main(["refine", "clip.mp4", "--prompt", "x", "--backend", "failing", "-o", "out/new.mp4"]) == 2
    [_, line] = capsys.readouterr().err.splitlines()
    assert line == (
        '--backend: "failing" failed (RuntimeError: of no kind that anybody foresaw); '
        "see what failed, or choose another backend"
    )
    assert sorted(tmp_path.rglob("*")) == before


def test_an_interrupted_run_leaves_nothing(clip: Path, tmp_path: Path, capsys) -> None:
    before = sorted(tmp_path.rglob("*"))
    assert main(["refine", "clip.mp4", "--prompt", "x", "--backend", "stopped"]) == 130
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("output", ["new.mp4", "new"])
def test_a_full_disk_is_one_message_and_the_old_video_is_still_there(
    output: str, frames: Path, masks: Path, tmp_path: Path
) -> None:
    """As full as a process can be made to see it: no file may grow beyond 2 KB."""
    (tmp_path / "new.mp4").write_bytes(b"old")
    code = (
        "import resource, sys\n"
        "from physgen import registry\nfrom physgen.cli.main import main\n"
        "row = registry.Backend('refine', 'exact', 'gaussian:made', '', takes_setup=True)\n"
        "registry.BACKENDS = (*(r for r in registry.BACKENDS if r.role != 'refine'), row)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))\n"
        "run = ['refine', 'frames', '--masks', 'masks', '--prompt', 'x', '--backend', 'exact']\n"
        f"sys.exit(main([*run, '-o', {output!r}]))"
    )
    before = sorted(tmp_path.rglob("*"))
    paths = [str(Path(gaussian.__file__).parent), str(Path(registry.__file__).parent.parent)]
    run = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:0] = {paths!r}\n{code}"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert run.stderr.endswith("File too large\n")
    assert run.stderr.count("\n") == 1
    assert run.returncode == 1
    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "new.mp4").read_bytes() == b"old"


def test_a_picture_too_large_for_the_format_is_refused_before_the_model_runs(tmp_path: Path, capsys) -> None:
    Image.new("RGB", (17000, 2)).save(tmp_path / "wide.png")
    assert main(["refine", "wide.png", "-o", "new.mp4", "--backend", "failing"]) == 2
    message = (
        "new.mp4: 17000 x 2 px is over the 16384 px that mp4 allows a side; name a folder for PNG frames\n"
    )
    assert capsys.readouterr().err == message
