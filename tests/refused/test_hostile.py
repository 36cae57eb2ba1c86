"""Files made to hurt -> one message, within 2 s and 500 MB, never a traceback or a crash.

Each is read by a process of its own under the kernel's limits, so that a crash of the parser in C is seen as one.
"""

from __future__ import annotations

import json
import os
import resource
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen.batch.clips import find_clips
from physgen.cli.main import main
from physgen.compile.warning_limits import LIMITS
from physgen.problems import InputError
from physgen.scene.load import load

SECONDS = 10
"""Of processor time: 2 s on a machine of its own, more where its cores are shared with other work."""
BYTES = 500 * 10**6
HANG = 60  # s on the wall

READ = """
import sys
from physgen.problems import InputError
from physgen.scene.load import OpenedScene
try:
    opened = OpenedScene(sys.argv[1])
    for problem in opened.variant_problems:
        print(problem)
    opened.scene(sys.argv[2:])
except InputError as error:
    print(error)
"""


def _limits() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def said(
    folder: Path, name: str = "scene.yaml", flags: tuple[str, ...] = ()
) -> list[str]:
    """The messages about a file, read in its folder."""
    done = subprocess.run(
        [sys.executable, "-c", READ, name, *flags],
        cwd=folder,
        capture_output=True,
        timeout=HANG,
        preexec_fn=_limits,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(sys.path),
            "OPENBLAS_NUM_THREADS": "1",
        },
    )
    assert done.returncode == 0, (done.returncode, done.stderr.decode()[-2000:])
    assert done.stderr == b""
    lines = done.stdout.decode().splitlines()
    assert all(len(line) < 700 for line in lines)
    return lines


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """The messages about a file in the test's folder, or below, read in this process: no parser sees it."""

    def read(
        folder: Path = tmp_path, name: str = "scene.yaml", flags: tuple[str, ...] = ()
    ) -> list[str]:
        monkeypatch.chdir(folder)
        with pytest.raises(InputError) as error:
            load(name, flags)
        return str(error.value).splitlines()

    return read


HEAD = "physgen: 1\nsize: [64, 48]\n"
BALL = HEAD + "objects:\n  ball:\n    shape: {circle: {center: [20, 20], radius: 8}}\n"


def _bomb() -> str:
    """The billion laughs: nine levels of ten aliases."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 9)]
    return "\n".join(lines)


def _comb(corners: int) -> str:
    """One outline of many corners whose long lines fill its box and never cross: a comb, slanted."""
    points = []
    for k in range(corners // 4):
        points += [f"[{20 * k}, {7 * k}]", f"[{20 * k + 5e5:.0f}, {7 * k + 5e5:.0f}]"]
        points += [
            f"[{20 * k + 5e5 + 10:.0f}, {7 * k + 5e5:.0f}]",
            f"[{20 * k + 10}, {7 * k}]",
        ]
    return ", ".join(points)


TEXTS: dict[str, tuple[Callable[[], str], str]] = {
    "alias bomb": (
        _bomb,
        "scene.yaml:1:5: an anchor, a0; write the value itself, or use extends or variants",
    ),
    "million objects": (
        lambda: HEAD + "objects:\n" + "".join(f" {n:x}:\n" for n in range(10**6)),
        "scene.yaml:10004:2: objects: more than 10,000 objects; split the scene",
    ),
    "million nodes": (
        lambda: HEAD + "boundaries: [" + "0," * 10**6 + "]\n",
        "scene.yaml:3:999996: more than 500,000 values; keep pixels in image files",
    ),
    "brackets": (
        lambda: "[" * 900,
        "scene.yaml:1:51: nested deeper than 50 levels; nest less",
    ),
    "tag": (
        lambda: "physgen: !!python/object/apply:os.system [touch hurt]\n",
        "scene.yaml:1:10: a tag, tag:yaml.org,2002:python/object/apply...; write plain values",
    ),
    "long line": (
        lambda: "physgen: 1\nimage: " + "x" * 10**6,
        'scene.yaml:2:8: image: "'
        + "x" * 37
        + '..." is 1000000 characters long; write at most 1024',
    ),
    "long key": (
        lambda: HEAD + "x" * 10**6 + ": 1",
        "scene.yaml:3:1000001: not YAML: could not find expected ':'",
    ),
    "long number": (
        lambda: BALL + "    mass: " + "9" * 10**6,
        "scene.yaml:6:11: objects.ball.mass: 99999999999",
    ),
    "nine MiB": (
        lambda: "#" * (9 * 2**20),
        "scene.yaml: larger than 8 MiB; keep pixels in image files",
    ),
    "tangled outline": (
        lambda: HEAD + "objects: {a: {shape: {polygon: [" + _comb(20_000) + "]}}}\n",
        "scene.yaml:3:32: objects.a.shape.polygon: crosses itself: the lines from corners 2 and 19999",
    ),
    "too many variants": (
        lambda: (
            HEAD
            + "objects:\n"
            + "".join(
                f"  o{n}: {{shape: {{circle: {{center: [1, 1], radius: 1}}}}}}\n"
                for n in range(5000)
            )
            + "variants:\n"
            + "".join(f"  v{n}: {{objects.*.mass: 1}}\n" for n in range(9000))
        ),
        "scene.yaml:5004:1: variants: are over 3,000,000 edits times values; use sweep",
    ),
    "questions": (
        lambda: "? " * 1000,
        "scene.yaml:1:3: a key that is not text; write a name before the colon",
    ),
    "pattern": (
        lambda: HEAD + "refine: {backend: " + "a" * 10**6 + "!}",
        'scene.yaml:3:19: refine.backend: "aaaa',
    ),
    "terminal codes": (
        lambda: BALL + '    "\\e[31m\\u202e": 1\n',
        'scene.yaml:6:5: objects.ball."\\u001b[31m\\u202e": unk',
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", TEXTS)
def test_text(name: str, tmp_path: Path) -> None:
    make, message = TEXTS[name]
    (tmp_path / "scene.yaml").write_text(make(), encoding="utf-8")
    (line,) = said(tmp_path)
    assert line.startswith(message)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scene.yaml"]


def test_brackets_beyond_the_parsers_own_limit(tmp_path: Path) -> None:
    """libyaml 0.2.6 stops at 1,000 by itself, 0.2.5 goes on: the message is the same, the column is not."""
    (tmp_path / "scene.yaml").write_text("[" * 100_000)
    (line,) = said(tmp_path)
    assert line.endswith("nested deeper than 50 levels; nest less")


def test_many_problems_end(tmp_path: Path) -> None:
    """Every value wrong: told as far as anybody reads, then stopped."""
    text = BALL.replace("ball", "o0") + "".join(
        f"  o{n}: {{mass: no, frictoin: 1}}\n" for n in range(1, 9999)
    )
    (tmp_path / "scene.yaml").write_text(text)
    lines = said(tmp_path)
    assert len(lines) == 201
    assert "more problems follow; fix these first" in "\n".join(lines)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            b"physgen: 1\nimage: \xff\xfe.png\n",
            "scene.yaml:2:8: not UTF-8 text; save the file as UTF-8",
        ),
        (
            "physgen: 1\n".encode("utf-16"),
            "scene.yaml:1:1: not UTF-8 text; save the file as UTF-8",
        ),
        (
            bytes(range(256)) * 4000,
            "scene.yaml:2:118: not UTF-8 text; save the file as UTF-8",
        ),
    ],
)
def test_bytes(data: bytes, message: str, tmp_path: Path, here) -> None:
    (tmp_path / "scene.yaml").write_bytes(data)
    assert here() == [message]


def _png(width: int, height: int) -> bytes:
    """A PNG that says it has so many pixels and holds none."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data))
            + kind
            + data
            + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", b"")
        + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize(
    "side", [(10_000, 10_001), (40_000, 25_000), (2**31 - 1, 2**31 - 1)]
)
def test_image_of_many_pixels(side: tuple[int, int], tmp_path: Path, here) -> None:
    (tmp_path / "photo.png").write_bytes(_png(*side))
    (tmp_path / "scene.yaml").write_text("physgen: 1\nimage: photo.png\n")
    assert here() == [
        'scene.yaml:2:8: image: "photo.png" is over 100 megapixels; make it smaller'
    ]


def _secret(tmp_path: Path) -> Path:
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "photo.png").write_bytes(_png(64, 48))
    (tmp_path / "secret" / "masks.png").write_bytes(_png(64, 48))
    (tmp_path / "secret" / "scene.yaml").write_text(
        "physgen: 1\nsize: [1, 1]\npassword: x\n"
    )
    home = tmp_path / "work" / "scene"
    home.mkdir(parents=True)
    return home


@pytest.mark.parametrize(
    ("line", "link"),
    [
        ("image: ../photo.png", None),
        ("image: photo.png", "photo.png"),
        ("image: way/photo.png", "way"),
        ("assets: way", "way"),
        ("extends: way/scene.yaml", "way"),
        ("extends: scene2.yaml", "scene2.yaml"),
    ],
)
def test_paths_that_leave_the_folder(
    line: str, link: str | None, tmp_path: Path, here
) -> None:
    home = _secret(tmp_path)
    if link:
        target = {
            "photo.png": "secret/photo.png",
            "way": "secret",
            "scene2.yaml": "secret/scene.yaml",
        }[link]
        (home / link).symlink_to(tmp_path / target)
    size = "" if line.startswith("image") else "size: [64, 48]\n"
    (home / "scene.yaml").write_text(f"physgen: 1\n{size}{line}\n")
    (message,) = here(home)
    assert "leads out of the" in message
    assert str(tmp_path) not in message


def test_map_that_is_a_link_out(tmp_path: Path, here) -> None:
    home = _secret(tmp_path)
    (home / "maps").mkdir()
    (home / "maps" / "masks.png").symlink_to(tmp_path / "secret" / "masks.png")
    (home / "scene.yaml").write_text(HEAD + "assets: maps\n")
    (message,) = here(home)
    assert '"maps/masks.png" leads out of the scene\'s folder' in message


def test_extends_without_end(tmp_path: Path, here) -> None:
    for n in range(20):
        (tmp_path / f"s{n}.yaml").write_text(f"physgen: 1\nextends: s{n + 1}.yaml\n")
    (tmp_path / "s20.yaml").write_text(HEAD)
    (message,) = here(name="s0.yaml")
    assert message.startswith(
        's10.yaml:2:10: extends: "s11.yaml" is one of more than 10 files'
    )


def test_a_scene_is_a_pipe_that_nobody_writes_into(tmp_path: Path) -> None:
    for name in ("pipe.yaml", "pipe.physgen"):
        os.mkfifo(tmp_path / name)
        (message,) = said(tmp_path, name)
        assert (
            message
            == f"{name}: is a pipe; name a file; what a program writes is read as /dev/stdin"
        )


def test_a_scene_may_come_from_another_program(tmp_path: Path) -> None:
    code = "import sys; from physgen.cli.main import main; sys.exit(main(['check', '/dev/stdin']))"
    run = subprocess.run(
        [sys.executable, "-c", code],
        input=HEAD,
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert (run.returncode, run.stdout, run.stderr) == (
        0,
        "/dev/stdin: no problems\n",
        "",
    )


@pytest.mark.parametrize(
    "value", ["[" * 1000, "&a [*a]", "!!python/name:os.system", ".nan", "9" * 5000]
)
def test_flags(value: str, tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(BALL)
    (message,) = said(tmp_path, flags=(f"objects.ball.mass={value}",))
    assert message.startswith("--set objects.ball.mass=")


@pytest.mark.slow
def test_many_corners_are_checked(tmp_path: Path) -> None:
    """A contour of 20,000 corners is no attack; it is read within the same limits."""
    import math

    corners = ", ".join(
        f"[{4000 + (3000 + n % 2) * math.cos(n / 20_000 * math.tau):.3f}, "
        f"{4000 + (3000 + n % 2) * math.sin(n / 20_000 * math.tau):.3f}]"
        for n in range(20_000)
    )
    (tmp_path / "scene.yaml").write_text(
        f"physgen: 1\nsize: [9000, 9000]\nobjects: {{a: {{shape: {{polygon: [{corners}]}}}}}}\n"
    )
    assert said(tmp_path) == []


def _balls(count: int) -> str:
    ball = "{shape: {circle: {center: [1, 1], radius: 1}}}"
    return HEAD + "objects:\n" + "".join(f"  ball-{n}: {ball}\n" for n in range(count))


@pytest.mark.slow
def test_many_joints_and_fields(tmp_path: Path) -> None:
    """Each name is looked up at once, however many there are."""
    joints = "".join(
        f"  j{n}: {{objects: [ball-{n % 5000}], pivot: [1, 1]}}\n" for n in range(9999)
    )
    names = ", ".join(f"ball-{n}" for n in range(5000))
    fields = "".join(
        f"  f{n}: {{wind: [1, 0], drag: 1, objects: [{names}]}}\n" for n in range(40)
    )
    (tmp_path / "scene.yaml").write_text(
        _balls(5000) + "joints:\n" + joints + "fields:\n" + fields
    )
    assert said(tmp_path) == []


def test_more_collision_groups_than_the_engine_has(tmp_path: Path, here) -> None:
    """Groups are bits of one 32-bit word of the engine."""
    lines = ["objects:"]
    for number in range(32):
        shape = f"{{circle: {{center: [20, {20 + number}], radius: 8}}}}"
        lines.append(f"  b{number}: {{shape: {shape}, collision_group: g{number}}}")
    (tmp_path / "scene.yaml").write_text(HEAD + "\n".join(lines))
    (message,) = here()
    assert "33 collision groups are more than 32; join some of them" in message


@pytest.mark.slow
def test_overlapping_pairs_are_counted_not_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """1,000 circles in one place are 499,500 pairs: the first ones are named, and the others are a number."""
    (tmp_path / "scene.yaml").write_text(_balls(1000))
    assert main(["check", str(tmp_path / "scene.yaml")]) == 0
    said = capsys.readouterr().err.splitlines()
    named = [line for line in said if "overlaps ball-" in line]
    (more,) = [line for line in said if "more pairs" in line]
    assert LIMITS.pairs <= len(named) < LIMITS.pairs + 1000
    assert f"{1000 * 999 // 2 - len(named):,} more pairs" in more


@pytest.mark.parametrize(
    "line", ["image: NAME.png", "assets: NAME", "extends: NAME.yaml"]
)
def test_names_longer_than_a_file_system_takes(line: str, tmp_path: Path, here) -> None:
    size = "" if line.startswith("image") else "size: [64, 48]\n"
    (tmp_path / "scene.yaml").write_text(
        f"physgen: 1\n{size}{line.replace('NAME', 'a' * 300)}\n"
    )
    (message,) = here()
    assert message.startswith(f"scene.yaml:{2 + bool(size)}:")
    assert message.endswith("has too long a name; write a name of at most 255 bytes")


@pytest.mark.parametrize("name", ["", " ", "a" * 300, "a\0b"])
def test_names_of_results_that_cannot_be(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.yaml").write_text(BALL)
    with pytest.raises(SystemExit) as end:
        main(["render", str(tmp_path / "scene.yaml"), "-o", name])
    assert end.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("physgen render: argument -o/--output: ")


def test_an_output_folder_whose_name_is_no_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text(BALL)
    assert (
        main(["render", "scene.yaml", "-o", "a\udcff", "--set", "world.duration=0.1"])
        == 0
    )
    (folder,) = (tmp_path / "a\udcff").iterdir()
    assert json.loads((folder / "manifest.json").read_text())["command"][4] == "a\udcff"


def test_a_picture_that_ends_early_is_named_by_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    data = cv2.imencode(".png", pixels)[1].tobytes()
    (tmp_path / "scene.yaml").write_text("physgen: 1\nimage: photo.png\n")
    for length in (0, 8, 20, 30, len(data) // 2):
        (tmp_path / "photo.png").write_bytes(data[:length])
        assert main(["check", str(tmp_path / "scene.yaml")]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        wrong = 'scene.yaml:2:8: image: "photo.png" is not a picture that can be read'
        assert line.startswith(f"{tmp_path}/{wrong}")


def test_a_flag_of_two_lines_is_answered_in_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        main(["render", "scene.yaml", "--jobs", "x\ny"])
    (line,) = capsys.readouterr().err.splitlines()
    assert "x\\ny is not a whole number" in line


def test_links_that_lead_nowhere_end_no_search(tmp_path: Path) -> None:
    (tmp_path / "gone").symlink_to("nowhere")
    (tmp_path / "self").symlink_to("self")
    assert list(find_clips([tmp_path])) == []


@pytest.mark.parametrize(
    "record", [b"", b"[" * 10**5, b'{"values": [1]}', b'{"values": {"ball": 3}}', None]
)
def test_a_record_of_perceiving_that_cannot_be_read_is_none(
    record: bytes | None, tmp_path: Path
) -> None:
    (tmp_path / "maps").mkdir()
    path = tmp_path / "maps" / "perceived.json"
    os.mkfifo(path) if record is None else path.write_bytes(record)
    (tmp_path / "scene.yaml").write_text(BALL + "assets: maps\n")
    assert said(tmp_path) == []


def test_a_disk_without_room_for_a_header(tmp_path: Path) -> None:
    """PyAV would crash: the run ends with a message, and leaves nothing."""
    code = (
        "import resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10));"
        "from physgen.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    (tmp_path / "scene.yaml").write_text(BALL)
    flags = [
        "render",
        "scene.yaml",
        "-o",
        "out",
        "--set",
        "world.duration=0.1",
        "--report",
        "none",
    ]
    done = subprocess.run(
        [sys.executable, "-c", code, *flags],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert "no room left" in done.stderr
    assert not list(tmp_path.rglob("*.part"))


def test_equal_runs_differ_in_one_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []
    for name in ("one", "two"):
        home = tmp_path / name
        home.mkdir()
        monkeypatch.chdir(home)
        Path("ball.yaml").write_text(BALL)
        assert (
            main(["render", "ball.yaml", "-o", "out", "--set", "world.duration=0.1"])
            == 0
        )
        made.append(
            {
                str(p.relative_to(home)): p.read_bytes()
                for p in home.rglob("*")
                if p.is_file()
            }
        )
    assert len(made[0]) > 5
    assert made[0].keys() == made[1].keys()
    assert [name for name in made[0] if made[0][name] != made[1][name]] == [
        "out/ball/timing.json"
    ]


def test_a_label_map_of_noise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    noise = np.random.default_rng(0).integers(0, 65535, (120, 160), np.uint16)
    (tmp_path / "maps").mkdir()
    cv2.imwrite(str(tmp_path / "maps" / "masks.png"), noise)
    cv2.imwrite(str(tmp_path / "photo.png"), np.zeros((120, 160, 3), np.uint8))
    (tmp_path / "scene.yaml").write_text("physgen: 1\nimage: photo.png\nassets: maps\n")
    assert main(["check", str(tmp_path / "scene.yaml")]) == 2
    assert "ids are too many for a label map" in capsys.readouterr().err


@pytest.mark.slow
def test_masses_too_far_apart_end_with_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A saucer of 1.4 t among cups: its impacts would take hours."""
    cups = Path(__file__).parents[2] / "scenes" / "cups" / "scene.yaml"
    flags = [
        "--set",
        "objects.saucer.mass=1450000",
        "--set",
        "world.duration=0.05",
        "--report",
        "none",
    ]
    assert main(["render", str(cups), "-o", str(tmp_path), *flags]) == 0
    (line,) = [
        line for line in capsys.readouterr().err.splitlines() if "more work" in line
    ]
    assert "impacts of " in line
    assert line.endswith("bring their masses closer")


@pytest.mark.slow
def test_a_corner_that_reaches_far_out_ends_with_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A cup with one corner 5,600 px away needs 2,800 parts of every step: an hour for a second."""
    cups = Path(__file__).parents[2] / "scenes" / "cups" / "scene.yaml"
    flags = [
        "--variant",
        "push",
        "--set",
        "objects.cup-2.shape.polygon[14][1]=5647.6",
        "--set",
        "world.duration=0.05",
    ]
    assert (
        main(["render", str(cups), "-o", str(tmp_path), *flags, "--report", "none"])
        == 0
    )
    (line,) = [
        line for line in capsys.readouterr().err.splitlines() if "more work" in line
    ]
    assert "steps of cup-2" in line
