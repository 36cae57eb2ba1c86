"""Hostile input: mutated scenes, assets, pictures, arguments, disks, interrupted and concurrent runs, requests.

Beside random mutations: `mistakes` are scenes with the mistakes of people (hand_mistakes.py), `odd-photos` are photos
of odd kinds (odd_photos.py).

    python benchmarks/attack.py                            # one minute, seed 0
    python benchmarks/attack.py --minutes 20 --seed 3      # longer
    python benchmarks/attack.py --only scenes --count 5000 # one kind of attack, so many times
    python benchmarks/attack.py --first 600 --count 600 --keep   # a piece of a campaign: counts are added to results/

Each input goes to a command in a process of its own under limits of the kernel. A failure is a traceback, a library's
warning, an exit code other than 0 or 2, over 20 s of processor time, over 1.5 GB (1 GB where the input is refused), a
message without place or remedy, a file that a refused command wrote, or one left over. Of mistakes and odd photos
also: a message printed twice or at a place that its file does not have, a scene that `check` accepts and `render`
refuses, motion that is not finite, silence though all objects leave the picture (attack_faults.py). Failures are made
small and kept under out/attack. Exit code 1 on any. The same seed makes the same inputs.
"""

from __future__ import annotations

import argparse
import atexit
import copy
import importlib
import itertools
import json
import os
import platform
import random
import re
import resource
import shutil
import signal
import string
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from threading import Event
from urllib.parse import quote

import cv2
import httpx
import numpy as np
import yaml
from attack_faults import invalid_json, motion_faults, repeated_messages, wrong_places
from hand_mistakes import SETTINGS, write_mistaken_scene
from odd_photos import write_odd_photo

from physgen import pipeline
from physgen.cli.main import main as physgen
from physgen.files import file_stamp

ROOT = Path(__file__).resolve().parent.parent
SECONDS = 20
"""Processor time that a command may take, s."""
MEMORY, REFUSED_MEMORY = 1.5e9, 1.0e9
"""Bytes that a command may hold; less where it refuses its input."""
ADDRESSES = 6 * 10**9
"""Bytes of address space: far more than may be held, so that the machine is safe."""
CRASHED = 70
"""Exit code of a command that raised."""
HANG = 1800
"""Wall time after which a command is killed, s: it waits for something. Work ends sooner, by SECONDS; on a machine with
much else to do it takes many times as long."""
LONGEST = 2_000
"""Characters of one message."""
MESSAGE = re.compile(r"^(?P<place>[^\n]*?): (?P<what>.+); (?P<fix>.+)$")
NOT_MESSAGES = re.compile(r"^the previous .+ is kept as|^interrupted$|^\d+ clips?: ")
NOISE = re.compile(
    r"Traceback|Warning:|Segmentation|^\s+File \"|fault of physgen's", re.MULTILINE
)
FRAMES = (
    "--set",
    "world.duration=0.1",
    "--set",
    "render.fps=10",
    "--report",
    "none",
    "--jobs",
    "1",
)
"""What makes a render of any scene short."""
SHORT = ("--set", "world.duration=0.5", "--set", "render.frames=4", "--jobs", "1")
"""The same for scenes whose motion is looked at: they last half a second."""


AHEAD = (
    "physgen.pipeline.clip",
    "physgen.pipeline.perceiving",
    "physgen.pipeline.refreshing",
    "physgen.compile.warnings",
    "physgen.simulate.engine",
    "physgen.render.frames",
    "physgen.report.page",
    "physgen.report.player",
    "physgen.report.perception",
    "physgen.videos",
    "physgen.perceive.perceive",
    "physgen.cli.render",
    "physgen.cli.simulate",
    "physgen.cli.perceive",
    "jsonschema",
    "PIL.Image",
    "PIL.ImageCms",
)
"""Modules that are imported before the first input, so that a child starts at once."""


@dataclass
class Result:
    """What a command did with an input."""

    code: int
    seconds: float
    """Of processor time."""
    memory: int
    """Bytes at most."""
    out: str
    err: str


def run(
    folder: Path, *arguments: str, prepare: Callable[[], None] | None = None
) -> Result:
    """A command in a child of this process, in `folder`."""
    streams = [tempfile.TemporaryFile() for _ in range(2)]  # noqa: SIM115
    pid = os.fork()
    if pid == 0:
        code = CRASHED
        try:
            os.chdir(folder)
            for number, stream in enumerate(streams, 1):
                os.dup2(stream.fileno(), number)
            resource.setrlimit(resource.RLIMIT_CPU, (SECONDS + 5, SECONDS + 6))
            resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            if prepare:
                prepare()
            code = physgen(arguments)
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except Exception:
            traceback.print_exc()  # a fault, which the parent counts
        finally:  # the child never goes on as the campaign
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    end = time.monotonic() + HANG
    while True:
        found, status, usage = os.wait4(pid, os.WNOHANG)
        if found:
            break
        if time.monotonic() > end:
            os.kill(pid, signal.SIGKILL)
        time.sleep(0.002)
    texts = []
    for stream in streams:
        stream.seek(0)
        texts.append(stream.read(10**6).decode("utf-8", "backslashreplace"))
        stream.close()
    code = os.waitstatus_to_exitcode(status)
    return Result(code, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024, *texts)


def judge(result: Result, base: int, codes: tuple[int, ...] = (0, 2)) -> list[str]:
    """What is wrong with a result; `base` are the bytes that this process itself holds."""
    faults = []
    if result.code not in codes:
        faults.append(f"exit code {result.code}")
    if NOISE.search(result.err):
        faults.append("traceback or a library's warning")
    if result.seconds > SECONDS:
        faults.append("too slow")
    limit = REFUSED_MEMORY if result.code == 2 else MEMORY
    if max(result.memory, base) > limit:
        faults.append("too much memory")
    lines = result.err.splitlines()
    is_told = any(MESSAGE.match(line) for line in lines)
    if result.code == 2 and not is_told and not result.out.startswith("{"):
        faults.append("refused without place and remedy")
    for line in lines:
        if len(line) > LONGEST:
            faults.append("too long a message")
        elif (
            result.code == 2
            and not MESSAGE.match(line)
            and not NOT_MESSAGES.search(line)
        ):
            faults.append("a message without place and remedy")
        elif str(ROOT) in line or tempfile.gettempdir() in line:
            faults.append("a path that the user did not write")
    return list(dict.fromkeys(faults))


# Scenes

NUMBERS = (0, -1, 1, 0.5, 1e9, -1e9, 1e-12, 1e300, 3.14, 2**31, 2**63, 10**30, 170, 90)
TEXTS = ("", "x", "auto", "none", "true", "../..", "/etc/passwd", "a/b", "é", "𝛑", "\ud800", "%s", "{}", "a" * 3000,
         "\0", "\u202e")  # fmt: skip
ARGUMENTS = (
    *TEXTS[:10],
    "a" * 300,
    "é\udcff",
    "-x",
    "x\ny",
    "scene.yaml",
    "0",
    "-1",
    "1e9",
    "nan",
    "9" * 21,
)
"""Names and numbers of the command line, which holds no zero byte."""
KEYS = ("objects", "ball", "block", "forces", "world", "gravity", "velocity", "variants", "shape", "*", "a.b", "mass",
        "0")  # fmt: skip
UNITS = ("g", "kg", "mm", "m", "px", "m/s", "px/s", "m/s²", "m/s^2", "N", "N s", "deg", "rad", "rpm", "kg/m²", "Hz",
         "turn", "furlong", "m//s", "/", "1/", "kg^99", "m^-9", "s^--1", "m m m", "°", "µm", "g²²", " ")  # fmt: skip
WAYS = ("right", "up-left", "30@2 m/s", "down@300", "@", "right@", "left@5 kg", "right@1e9 m/s", "left@-1 m/s", "1e400",
        "nan", "90@nan", "right=left", "left@0", "٣@2 m/s", "", "up@1 m/s@2")  # fmt: skip
"""Of --push."""
POINTS = (
    "80,60",
    "80,60@2 m/s",
    "0,0",
    "1e9,1",
    "nan,1",
    "5",
    "x,y",
    "80,60@",
    "80,60@x",
    "80,60@0",
    "",
    ",",
    "-5,1e400",
)
"""Of --kick and --point."""
STOP = Event()
"""Whether a campaign is asked to end early; what it has counted until then is printed."""
NOTED = 20
"""Inputs between two lines about progress."""
REQUESTS = 30
"""Of one editor."""
RAW = ("&a", "*a", "!!python/name:os.system", "? ", "- ", "{", "}", "[", "]", ": ", "#", "|", ">", "'", '"', "\t",
       "%YAML 2.0", "---\n", "...\n", "<<: ", "~", ".nan", ".inf", "\r", "\ufeff", "\u2028", "@")  # fmt: skip


def seed_of(chance: random.Random) -> Path:
    """A scene that is right, bundled or of the physics scorecard, or one of the wrong ones of the tests."""
    right = chance.choice(("scenes/*/scene.yaml", "scenes/physics/*.yaml"))
    return chance.choice(
        sorted(
            ROOT.glob("tests/refused/cases/*.yaml" if chance.random() < 0.2 else right)
        )
    )


def value(chance: random.Random, depth: int = 0) -> object:
    kind = chance.randrange(9 if depth < 3 else 5)
    if kind < 2:
        return chance.choice(NUMBERS) * chance.choice((1, 1, chance.random()))
    if kind < 4:
        return chance.choice((*TEXTS[:10], None, True, False))
    if kind == 4:
        return [chance.choice(NUMBERS) for _ in range(chance.randrange(4))]
    if kind == 5:
        return quantity(chance)
    if kind == 6:
        return [value(chance, depth + 1) for _ in range(chance.randrange(5))]
    return {
        chance.choice((*TEXTS[:8], "center", "radius", "mask", "mass")): value(
            chance, depth + 1
        )
        for _ in range(3)
    }


def quantity(chance: random.Random) -> str:
    """A number with a unit, which may not fit, or not exist."""
    return f"{chance.choice(NUMBERS)}{chance.choice((' ', '', '  '))}{chance.choice(UNITS)}"


def places(node: object, path: tuple = ()) -> Iterator[tuple]:
    """Paths of all values below a node."""
    below = (
        node.items()
        if isinstance(node, dict)
        else enumerate(node)
        if isinstance(node, list)
        else ()
    )
    for key, child in below:
        yield (*path, key)
        yield from places(child, (*path, key))


def mutate_tree(data: dict, chance: random.Random) -> str:
    """Values replaced, removed, doubled, moved and multiplied; of some scenes numbers alone, so that they simulate."""
    gentle = chance.random() < 0.4
    for _ in range(chance.choice((1, 1, 2, 4))):
        paths = list(places(data))
        path = chance.choice(paths)
        holder = data
        for key in path[:-1]:
            holder = holder[key]
        what, old = chance.randrange(10), holder[path[-1]]
        if gentle:
            if isinstance(old, int | float) and not isinstance(old, bool):
                changed = old * chance.choice((-1, 0, 0.1, 0.7, 0.95, 1.05, 2, 20))
                holder[path[-1]] = round(changed) if isinstance(old, int) else changed
            continue
        if what == 0:
            del holder[path[-1]]
        elif what == 1 and isinstance(old, int | float) and not isinstance(old, bool):
            holder[path[-1]] = old * chance.choice((-1, 0, 1e-6, 1e3, 1e6, 1e12))
        elif what == 2 and isinstance(old, list) and old:
            holder[path[-1]] = old * chance.choice((0, 2, 50, 2000))
        elif what == 3 and isinstance(old, dict):
            old.update(
                {f"n{k}": value(chance) for k in range(chance.choice((1, 3, 300)))}
            )
        elif what == 4:
            other = data
            for key in chance.choice(paths):
                other = other[key] if isinstance(other, list | dict) else other
            holder[path[-1]] = copy.deepcopy(other)
        elif what == 5 and isinstance(holder, dict):
            holder[chance.choice(TEXTS[:10]) or str(path[-1]).upper()] = old
        elif what == 6 and isinstance(old, str):
            holder[path[-1]] = chance.choice(
                (old[::-1], old + "x", old * 400, old[:1], chance.choice(TEXTS))
            )
        elif what == 7 and isinstance(old, int | float):
            holder[path[-1]] = (
                f"{old} {chance.choice(UNITS)}"
                if chance.random() < 0.7
                else quantity(chance)
            )
        else:
            holder[path[-1]] = value(chance)
        if not data:
            break
    return yaml.dump(
        json.loads(json.dumps(data, default=str)), allow_unicode=True, sort_keys=False
    )


def mutate_text(text: str, chance: random.Random) -> bytes:
    """Lines moved, characters changed, encodings mixed."""
    lines = text.splitlines(keepends=True) or ["physgen: 1\n"]
    for _ in range(chance.choice((1, 1, 2, 5))):
        at, what = chance.randrange(len(lines)), chance.randrange(7)
        if what == 0:
            lines.insert(chance.randrange(len(lines)), lines[at])
        elif what == 1:
            lines[at] = lines[at].replace(
                "  ", chance.choice((" ", "   ", "\t", "")), 1
            )
        elif what == 2 and len(lines) > 2:
            del lines[at]
        else:
            cut = chance.randrange(len(lines[at]) + 1)
            insert = chance.choice(
                (
                    *RAW,
                    *TEXTS,
                    str(chance.choice(NUMBERS)),
                    chance.choice(string.printable),
                )
            )
            lines[at] = (
                lines[at][:cut] + insert + lines[at][cut + chance.randrange(2) :]
            )
    whole = "".join(lines)
    if chance.random() < 0.03:
        return whole.encode(
            chance.choice(("utf-16", "latin-1", "utf-32", "cp1252")), "replace"
        )
    data = whole.encode("utf-8", "surrogatepass")
    if chance.random() < 0.05:
        data = data[: chance.randrange(len(data))]
    return data


def scenes(folder: Path, chance: random.Random) -> Iterator[tuple[str, ...]]:
    """One mutated scene, checked, simulated for a tenth of a second and now and then rendered."""
    seed = seed_of(chance)
    if seed.name == "scene.yaml":
        shutil.copytree(
            seed.parent,
            folder,
            dirs_exist_ok=True,
            ignore=shutil.ignore_patterns("*.md"),
        )
    text = seed.read_text(encoding="utf-8")
    data = None
    if chance.random() < 0.6:
        try:
            data = yaml.safe_load(text)
        except yaml.YAMLError:
            data = None
    if isinstance(data, dict) and data:
        mutated = mutate_tree(data, chance).encode("utf-8", "surrogatepass")
    else:
        mutated = mutate_text(text, chance)
    (folder / "scene.yaml").write_bytes(mutated)
    yield ("check", "scene.yaml")
    if chance.random() < 0.1:
        yield (
            edit(chance, list(data.get("objects") or ()))
            if isinstance(data, dict)
            else ("show", "scene.yaml")
        )
    yield ("simulate", "scene.yaml", "--set", "world.duration=0.1", "-o", "out.csv")
    if chance.random() < 0.1:
        yield ("render", "scene.yaml", "-o", "clips", *FRAMES)


def edit(chance: random.Random, names: list[str]) -> tuple[str, ...]:
    """A command that edits a scene, moves its objects or lists them."""
    known = [str(name) for name in names] or ["ball"]
    name, other = (chance.choice((*known, *known, *ARGUMENTS)) for _ in range(2))
    flag, argument = chance.choice((
        ("--push", f"{name}={chance.choice(WAYS)}"), ("--drop", name), ("--kick", chance.choice(POINTS)),
        ("--push", name), ("--set", f"objects.{name}.mass={quantity(chance)}"),
    ))  # fmt: skip
    return chance.choice((
        ("show", "scene.yaml", *chance.choice(((), ("--json",)))),
        ("rename", "scene.yaml", name, other),
        ("merge", "scene.yaml", name, other),
        ("remove", "scene.yaml", *{name, other}),
        ("layer", "scene.yaml", name, chance.choice(("1", "-3", *ARGUMENTS))),
        ("render", "scene.yaml", flag, argument, "-o", "clips", *FRAMES),
        ("render", "scene.yaml", flag, argument, "-o", "clips", *FRAMES),
    ))  # fmt: skip


def mistakes(folder: Path, chance: random.Random) -> Iterator[tuple[str, ...]]:
    """A scene with mistakes made by hand: checked, rendered, and listed or checked with an edit now and then."""
    write_mistaken_scene(folder, chance)
    report = ("--report", "none") if chance.random() < 0.9 else ()
    yield ("check", "scene.yaml")
    yield ("render", "scene.yaml", "-o", "clips", *SHORT, *report)
    setting = chance.choice(SETTINGS)
    extras = (
        ("check", "scene.yaml", "--json"),
        ("check", "scene.yaml", "--strict"),
        ("check", "scene.yaml", "--variant", "all"),
        ("check", "scene.yaml", "--set", setting),
        ("check", "scene.yaml", "--set", setting),
        ("check", "scene.yaml", "--set", setting),
        ("show", "scene.yaml"),
        ("render", "scene.yaml", "--variant", "all", "-o", "all", *SHORT, *report),
        ("render", "scene.yaml", "--set", setting, "-o", "set", *SHORT, *report),
    )
    if chance.random() < 0.6:
        yield chance.choice(extras)


# Pictures and maps


@cache
def perceived() -> Path:
    """The folder of a small scene as perceive writes it, with outlines and a record of its numbers."""
    home = tempfile.TemporaryDirectory(prefix="attack-")
    atexit.register(home.cleanup)
    for name in ("photo.png", "photo.assets/masks.png"):
        picture = cv2.imread(
            str(ROOT / "scenes" / "kitchen" / name), cv2.IMREAD_UNCHANGED
        )
        small = cv2.resize(picture, (160, 160), interpolation=cv2.INTER_NEAREST)
        cv2.imwrite(str(Path(home.name) / Path(name).name), small)
    made = run(
        Path(home.name),
        "perceive",
        "photo.png",
        "--masks",
        "masks.png",
        "-o",
        "scene.yaml",
    )
    assert made.code == 0, made.err
    return Path(home.name)


def assets(folder: Path, chance: random.Random) -> Iterator[tuple[str, ...]]:
    """A perceived scene whose outlines, record or label map are odd or damaged: edited, pushed, perceived again."""
    shutil.copytree(perceived(), folder, dirs_exist_ok=True)
    target = (
        folder
        / "scene.assets"
        / chance.choice(("perceived.json", "outlines.json", "masks.png"))
    )
    data, what = target.read_bytes(), chance.randrange(8)
    if what == 0:
        target.unlink()
        chance.choice(
            (target.mkdir, lambda: os.mkfifo(target), lambda: target.symlink_to(target))
        )()
    elif what < 3:
        target.write_bytes(damaged(data, chance))
    elif target.suffix == ".json" and what < 5:
        target.write_bytes(mutate_text(data.decode().replace(", ", ",\n"), chance))
    elif target.suffix == ".json":
        tree = json.loads(data)
        target.write_text(
            json.dumps(yaml.safe_load(mutate_tree(tree, chance))),
            "utf-8",
            "surrogatepass",
        )
    elif what < 5:
        target.write_bytes(odd_picture(chance))
    else:
        labels = cv2.imread(str(target), cv2.IMREAD_UNCHANGED)
        old, new = chance.randrange(8), chance.choice((0, 1, 2, 300, 65535))
        labels[labels == old] = new
        labels[chance.randrange(160) :, chance.randrange(160) :] = chance.choice(
            (0, 1, 9, 65535)
        )
        cv2.imwrite(str(target), labels.astype(np.uint16))
    names = list(yaml.safe_load((folder / "scene.yaml").read_text())["objects"])
    yield chance.choice((
        ("check", "scene.yaml"),
        edit(chance, names),
        edit(chance, names),
        ("perceive", "--refresh", "scene.yaml", "-o", "again.yaml"),
    ))  # fmt: skip


def damaged(data: bytes, chance: random.Random) -> bytes:
    """Bytes cut, flipped, doubled or replaced."""
    what = chance.randrange(6)
    if what == 0:
        return data[: chance.randrange(len(data) + 1)]
    if what == 1:
        return chance.randbytes(chance.choice((0, 1, 100, 10_000)))
    changed = bytearray(data)
    for _ in range(chance.choice((1, 10, 300))):
        changed[chance.randrange(chance.choice((40, len(changed))))] = chance.randrange(
            256
        )
    return bytes(changed) if what < 5 else bytes(changed) + data


def odd_picture(chance: random.Random) -> bytes:
    """A readable picture of an odd size, depth or number of channels."""
    height, width = (chance.choice((1, 2, 7, 64, 480, 900)) for _ in range(2))
    channels = chance.choice((1, 3, 4))
    kind = chance.choice((np.uint8, np.uint16))
    pixels = np.random.default_rng(chance.randrange(2**32)).integers(
        0, np.iinfo(kind).max, (height, width, channels)
    )
    return cv2.imencode(".png", pixels.astype(kind))[1].tobytes()


def pictures(folder: Path, chance: random.Random) -> Iterator[tuple[str, ...]]:
    """One picture of a scene damaged, or exchanged for another."""
    seed = chance.choice(sorted(ROOT.glob("scenes/*/scene.yaml"))).parent
    shutil.copytree(seed, folder, dirs_exist_ok=True)
    files = sorted(
        path for path in folder.rglob("*") if path.suffix in (".png", ".jpg", ".webp")
    )
    if not files:
        return
    target = chance.choice(files)
    what = chance.randrange(4)
    if what < 2:
        target.write_bytes(damaged(target.read_bytes(), chance))
    elif what == 2:
        target.write_bytes(odd_picture(chance))
    else:
        target.write_bytes(chance.choice(files).read_bytes())
    yield ("check", "scene.yaml")
    yield ("render", "scene.yaml", "-o", "clips", *FRAMES)


def photos(folder: Path, chance: random.Random) -> Iterator[tuple[str, ...]]:
    """One odd or damaged picture, perceived."""
    seed = chance.choice(sorted(ROOT.glob("scenes/*/photo.png")))
    small = cv2.imencode(".png", cv2.resize(cv2.imread(str(seed)), (160, 120)))[
        1
    ].tobytes()
    data = odd_picture(chance) if chance.random() < 0.4 else damaged(small, chance)
    (folder / "photo.png").write_bytes(data)
    yield ("perceive", "photo.png", "-o", "made.yaml")


def odd_photos(folder: Path, chance: random.Random) -> Iterator[tuple[str, ...]]:
    """A photo of an odd kind: perceived; its scene is checked and, now and then, rendered."""
    name = write_odd_photo(folder, chance)
    photo = ("--", name) if name.startswith("-") else (name,)
    # a name in the current folder that begins with a dash needs "--", as everywhere
    yield ("perceive", "-o", "made.yaml", *photo)
    if (folder / "made.yaml").exists():
        yield ("check", "made.yaml")
        if chance.random() < 0.4:
            yield ("render", "made.yaml", "-o", "clips", *SHORT)


# Disks, arguments, runs


def arguments(folder: Path, chance: random.Random) -> Iterator[tuple[str, ...]]:
    """Odd names of files and values of flags."""
    seed = chance.choice(sorted(ROOT.glob("scenes/*/scene.yaml"))).parent
    shutil.copytree(seed, folder, dirs_exist_ok=True)
    odd = (
        *ARGUMENTS,
        " ",
        ".",
        "..",
        "/dev/null",
        "/proc/self/mem",
        "nowhere/at/all",
        "photo.png",
    )
    name = chance.choice(odd)
    number = chance.choice(
        ("0", "-1", "1e9", "nan", "inf", "", "x", "999999999999999999999")
    )
    with (seed / "scene.yaml").open() as stream:
        objects = list(yaml.safe_load(stream)["objects"])
    flags = (("--box", f"{name},1,9,9"), ("--point", chance.choice(POINTS)), ("--side", number), ("--label", name),
             ("--label", f"ball={name}"), ("--masks", name), ("--find", name))  # fmt: skip
    lines = (
        ("render", "scene.yaml", "-o", name, *FRAMES),
        ("simulate", "scene.yaml", "-o", name, "--set", "world.duration=0.1"),
        ("check", name),
        ("perceive", name),
        ("gallery", name),
        ("verify", name),
        ("check", "scene.yaml", "--set", f"world.duration={number}"),
        ("check", "scene.yaml", "--set", name),
        ("check", "scene.yaml", "--variant", name),
        ("render", "scene.yaml", "-o", "clips", "--jobs", number),
        ("simulate", "scene.yaml", "--rate", number),
        ("sweep", "scene.yaml", name, "-o", "clips"),
        ("export", "scene.yaml", "-o", name, "--format", "coco"),
        ("perceive", "--refresh", name, "-o", "again.yaml", "--still"),
        *[edit(chance, objects) for _ in range(6)],
    )
    if chance.random() < 0.1:
        small = cv2.resize(cv2.imread(str(seed / "photo.png")), (160, 120))
        cv2.imwrite(str(folder / "photo.png"), small)
        yield (
            "perceive",
            "photo.png",
            *chance.choice(flags),
            "--still",
            "-o",
            "made.yaml",
        )
    else:
        yield chance.choice(lines)


def disks(folder: Path, chance: random.Random) -> Iterator[tuple[str, ...]]:
    """A render onto a disk that is full after some bytes, or into a folder that cannot be written."""
    seed = ROOT / "scenes/wall-ball"
    shutil.copytree(seed, folder / "scene", dirs_exist_ok=True)
    (folder / "clips").mkdir()
    yield ("render", "scene/scene.yaml", "-o", "clips", *FRAMES)


def full_disk(chance: random.Random) -> Callable[[], None]:
    room = chance.choice((3000, 20_000, 100_000))  # the message goes to a file, too

    def prepare() -> None:
        signal.signal(
            signal.SIGXFSZ, signal.SIG_IGN
        )  # a write beyond the room fails, as on a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    return prepare


def leftovers(folder: Path) -> list[str]:
    """Files and folders under names that only last while something is written."""
    found = (
        path
        for path in folder.rglob("*")
        if path.name.endswith((".part", ".old", ".tmp")) or ".part" in path.suffixes
    )
    return [str(path.relative_to(folder)) for path in found]


def render_command(out: Path) -> list[str]:
    """A short render in a process of its own."""
    scene = str(ROOT / "scenes/wall-ball/scene.yaml")
    return [sys.executable, "-m", "physgen", "render", scene, "-o", str(out), *FRAMES]


def interrupted(folder: Path, chance: random.Random) -> list[str]:
    """A render stopped at a random moment, then run again: whole clips under their names, and nothing left over."""
    command, temporary = render_command(folder / "clips"), folder / "tmp"
    temporary.mkdir()
    sent = chance.choice((signal.SIGINT, signal.SIGTERM, signal.SIGKILL))
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "TMPDIR": str(temporary)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    time.sleep(chance.uniform(0, 2.5))
    process.send_signal(sent)
    _, err = process.communicate(timeout=HANG)
    faults = (
        ["traceback or a library's warning"]
        if NOISE.search(err) and process.returncode != 1
        else []
    )
    if sent != signal.SIGKILL:
        faults += [f"left over after {sent.name}: {name}" for name in leftovers(folder)]
    faults += [f"left over after {sent.name}: {path}" for path in temporary.iterdir()]
    again = subprocess.run(command, capture_output=True, text=True, timeout=HANG)
    faults += (
        []
        if again.returncode == 0
        else [f"exit code {again.returncode} after {sent.name}: {again.stderr[-300:]}"]
    )
    faults += [
        f"left over after the run that followed {sent.name}: {name}"
        for name in leftovers(folder)
    ]
    return faults


def concurrent(folder: Path, chance: random.Random) -> list[str]:
    """Two runs of the same scene into the same folder."""
    command = render_command(folder / "clips")
    both = [
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    said = [process.communicate(timeout=HANG) for process in both]
    faults = [
        f"exit code {p.returncode} beside another run: {err[-300:]}"
        for p, (_, err) in zip(both, said, strict=True)
        if p.returncode
    ]
    if not (folder / "clips" / "wall-ball" / "video.mp4").is_file():
        faults.append("no clip of two runs")
    return faults + [f"left over: {name}" for name in leftovers(folder)]


def editor(folder: Path, chance: random.Random) -> list[str]:
    """Requests made from the editor's own OpenAPI: each is answered in time, and none with an error of the server."""
    seed = chance.choice(sorted(ROOT.glob("scenes/*/scene.yaml")))
    shutil.copytree(seed.parent, folder, dirs_exist_ok=True)
    command = [
        sys.executable,
        "-m",
        "physgen",
        "edit",
        str(folder / "scene.yaml"),
        "--no-browser",
        "--json",
    ]
    server = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    faults = []
    try:
        address = json.loads(server.stdout.readline())["address"]
        client = httpx.Client(
            base_url=address.split("?")[0].split("#")[0], timeout=SECONDS
        )
        token = re.search(r"token=([\w-]+)", address)
        client.headers["X-Physgen-Token"] = token[1] if token else ""
        interface = client.get("/api/openapi.json").json()
        paths, parts = (
            interface["paths"],
            interface.get("components", {}).get("schemas", {}),
        )
        for _ in range(REQUESTS):
            path = chance.choice(sorted(paths))
            method = chance.choice(sorted(paths[path]))
            wanted = paths[path][method]
            names = {
                item["name"]: str(filled(item["schema"], parts, chance)).encode(
                    "utf-8", "replace"
                )
                for item in wanted.get("parameters", ())
                if item["in"] == "query"
            }
            address = re.sub(
                r"{\w+}",
                lambda _: quote(
                    chance.choice(("0", "x", "..", "é", "a" * 300)), safe=""
                ),
                path,
            )
            body = (
                wanted.get("requestBody", {})
                .get("content", {})
                .get("application/json", {})
                .get("schema")
            )
            sent = json.dumps(
                filled(body, parts, chance) if body else value(chance)
            ).encode("utf-8", "surrogatepass")
            try:
                answer = client.request(
                    method,
                    address,
                    params=names,
                    content=sent,
                    headers={"Content-Type": "application/json"},
                )
            except httpx.HTTPError as error:
                faults.append(f"{type(error).__name__} for {method} {path}")
                continue
            if answer.status_code >= 500:
                faults.append(
                    f"{answer.status_code} for {method} {path}: {sent[:300]!r}"
                )
    finally:
        server.send_signal(signal.SIGINT)
        try:
            _, err = server.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            server.kill()
            _, err = server.communicate()
            faults.append("does not end on SIGINT")
    if NOISE.search(err):
        faults.append(f"traceback or a library's warning: {err[-400:]}")
    return faults


def filled(schema: dict, parts: dict, chance: random.Random, depth: int = 0) -> object:
    """A value that mostly fits a part of the OpenAPI."""
    if chance.random() < 0.08 or depth > 6:
        return value(chance)
    if "$ref" in schema:
        return filled(parts[schema["$ref"].rsplit("/", 1)[1]], parts, chance, depth + 1)
    if "const" in schema or "enum" in schema:
        return schema.get("const", chance.choice(schema.get("enum", [None])))
    for several in ("anyOf", "oneOf"):
        if several in schema:
            return filled(chance.choice(schema[several]), parts, chance, depth + 1)
    kind = schema.get("type")
    if kind == "object":
        keys = schema.get("properties", {})
        return {
            key: filled(part, parts, chance, depth + 1)
            for key, part in keys.items()
            if chance.random() < 0.9
        }
    if kind == "array":
        return [
            filled(schema.get("items", {}), parts, chance, depth + 1)
            for _ in range(chance.randrange(4))
        ]
    if kind == "integer":
        return chance.choice((0, 0, 1, 2, -1, 2**40))
    if kind == "number":
        return chance.choice(NUMBERS)
    if kind == "boolean":
        return chance.random() < 0.5
    if kind == "null":
        return None
    return (
        chance.choice((*TEXTS, *KEYS))
        if kind == "string"
        else chance.choice((*KEYS, value(chance)))
    )


# The campaign

COMMANDS: dict[str, Callable[[Path, random.Random], Iterator[tuple[str, ...]]]] = {
    "scenes": scenes,
    "assets": assets,
    "pictures": pictures,
    "photos": photos,
    "mistakes": mistakes,
    "odd-photos": odd_photos,
    "arguments": arguments,
    "disks": disks,
}
RUNS = {"interrupted": interrupted, "concurrent": concurrent, "editor": editor}
SHARE = dict(zip((*COMMANDS, *RUNS), (50, 8, 5, 4, 14, 4, 8, 3, 1, 1, 2), strict=True))
"""Of 100 inputs, about; `scenes` are the quickest."""
THOROUGH = ("mistakes", "odd-photos")
"""Kinds whose messages and motion are looked at closely; a refusal does not end their commands."""
SEEDS = (1, 2, 3)
COUNTS = (
    (("scenes",), 1670),
    (("mistakes",), 400),
    (("odd-photos",), 120),
    (("interrupted",), 17),
    (tuple(SHARE)[1:], 180),
)
"""Kinds, and inputs of them for a seed, of the benchmark."""


def attack(
    kind: str, folder: Path, chance: random.Random, base: int
) -> tuple[list[str], list[tuple[str, ...]], list[Result]]:
    """The faults that one input of a kind showed, the commands that showed them, and what all commands did."""
    if kind in RUNS:
        return RUNS[kind](folder, chance), [], []
    faults, shown, results, commands = [], [], [], []
    for command in COMMANDS[kind](folder, chance):
        commands.append(command)
        before = stamps(folder)
        prepare = full_disk(chance) if kind == "disks" else None
        results.append(result := run(folder, *command, prepare=prepare))
        found = judge(result, base, (0, 1, 2) if kind == "disks" else (0, 2))
        found += [
            f"left over: {re.sub(r'[0-9a-f]{6,}|[0-9]+', 'N', name)}"
            for name in leftovers(folder)
        ]
        is_batch = "all" in command  # what failed is recorded, so that it can go on
        if result.code == 2 and before != stamps(folder) and not is_batch:
            found.append("refused, and wrote a file")
        if kind in THOROUGH:
            found += more_faults(folder, command, result)
            found += disagreement(commands, results)
        if found:
            faults += found
            shown.append(command)
            (folder / "stderr.txt").write_text(
                result.err, encoding="utf-8", errors="backslashreplace"
            )
        if result.code != 0 and kind not in THOROUGH:
            break
    return list(dict.fromkeys(faults)), shown, results


def stamps(folder: Path) -> dict[Path, tuple[int, ...]]:
    """Return what changes when a file below a folder is written, for each."""
    return {path: file_stamp(path) for path in folder.rglob("*") if path.is_file()}


def more_faults(folder: Path, command: tuple[str, ...], result: Result) -> list[str]:
    """Return faults of messages and of motion, see attack_faults.py."""
    lines = result.err.splitlines()
    faults = repeated_messages(lines) + wrong_places(lines, folder)
    faults += invalid_json(command, result.out)
    if command[0] == "render" and result.code == 0:
        clips = folder / command[command.index("-o") + 1]
        edits = [command[k + 1] for k, part in enumerate(command) if part == "--set"]
        size = pipeline.load(folder / command[1], edits).size
        faults += motion_faults(clips, size, lines)
    return faults


def disagreement(commands: list[tuple[str, ...]], results: list[Result]) -> list[str]:
    """Return a fault if `render` refuses a scene that `check` has just accepted."""
    codes = [result.code for result in results[-2:]]
    names = [command[0] for command in commands[-2:]]
    # check does not know the format of the video, which has limits of its own
    is_about_scene = "clips" in commands[-1] and "--format" not in results[-1].err
    if names == ["check", "render"] and codes == [0, 2] and is_about_scene:
        return ["check accepts what render refuses"]
    return []


def minimal(
    folder: Path,
    command: tuple[str, ...],
    faults: list[str],
    base: int,
    tries: int = 60,
) -> None:
    """Takes lines out of a scene while the same command shows the same fault, for a minute at most."""
    scene, end = folder / "scene.yaml", time.monotonic() + 60
    if not scene.is_file():
        return
    lines = scene.read_bytes().splitlines(keepends=True)
    step = max(1, len(lines) // 2)
    while step and tries:
        for at in range(0, len(lines), step):
            tries -= 1
            fewer = lines[:at] + lines[at + step :]
            scene.write_bytes(b"".join(fewer))
            if time.monotonic() > end:
                tries = 0
            if tries > 0 and set(judge(run(folder, *command), base)) & set(faults):
                lines = fewer
                break
        else:
            step //= 2
        if tries <= 0:
            break
    scene.write_bytes(b"".join(lines))


def campaign(
    minutes: float, seed: int, kinds: list[str], numbers: range | None, out: Path
) -> list[dict]:
    """Attacks until the time is over, or those of `numbers`; a row of what was found for each kind."""
    end = time.monotonic() + 60 * minutes
    base = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    rows: dict[str, dict] = {}
    faults: Counter[str] = Counter()
    shutil.rmtree(out, ignore_errors=True)
    for number in numbers or itertools.count():
        if STOP.is_set() or (numbers is None and time.monotonic() > end):
            break
        chance = random.Random(f"{seed} {number}")
        if rows and number % NOTED == 0:
            print(f"before input {number}", file=sys.stderr, flush=True)
        (kind,) = chance.choices(kinds, [SHARE[kind] for kind in kinds])
        with tempfile.TemporaryDirectory(prefix="attack-") as name:
            folder = (
                Path(name) / "a" / "b" / "home"
            )  # so deep that ../.. does not lead out
            folder.mkdir(parents=True)
            begun = time.monotonic()
            found, shown, results = attack(kind, folder, chance, base)
            wall = time.monotonic() - begun
            added = {
                "inputs": 1,
                "refused": sum(r.code == 2 for r in results),
                "faulty": bool(found),
                "wall": wall,
            }
            most = {
                "slowest": max((r.seconds for r in results), default=0),
                "peak_mib": max((r.memory for r in results), default=0) >> 20,
                "refused_mib": max(
                    (r.memory for r in results if r.code == 2), default=0
                )
                >> 20,
            }
            row = {"seed": seed, "kind": kind, **dict.fromkeys((*added, *most), 0)}
            rows[kind] = joined(rows.get(kind, row), {**added, **most})
            for fault in found:
                faults[f"{kind}: {fault}"] += 1
            if found and max(faults[f"{kind}: {fault}"] for fault in found) <= 3:
                if shown:
                    minimal(folder, shown[-1], found, base)
                kept = out / f"{kind}-{number}"
                shutil.copytree(
                    folder, kept, dirs_exist_ok=True, symlinks=True, ignore=_no_pipes
                )
                (kept / "attack.json").write_text(
                    json.dumps(
                        {
                            "seed": seed,
                            "number": number,
                            "faults": found,
                            "commands": shown,
                        },
                        indent=1,
                    )
                )
                print(
                    f"{kind} {number}: {', '.join(found)}", file=sys.stderr, flush=True
                )
    return list(rows.values())


def _no_pipes(folder: str, names: list[str]) -> list[str]:
    return [name for name in names if (Path(folder) / name).is_fifo()]


def joined(old: dict, new: dict) -> dict:
    """Two rows of a kind as one: counts and wall seconds added, the slowest and the largest kept."""
    added = {
        key: round(old[key] + new[key], 1)
        for key in ("inputs", "refused", "faulty", "wall")
    }
    most = {
        key: round(max(old[key], new[key]), 1)
        for key in ("slowest", "peak_mib", "refused_mib")
    }
    return {**old, **added, **most}


def attacks(folder: Path) -> list[dict]:
    """The rows of docs/benchmarks.md; what failed is kept under `folder`."""
    return [
        row
        for seed in SEEDS
        for kinds, count in COUNTS
        for row in campaign(0, seed, list(kinds), range(count), folder)
    ]


def keep(rows: list[dict]) -> None:
    """Adds rows to those of benchmarks/results/attack.json."""
    file = ROOT / "benchmarks" / "results" / "attack.json"
    known = (
        {
            (row["seed"], row["kind"]): row
            for row in json.loads(file.read_text())["rows"]
        }
        if file.exists()
        else {}
    )
    for row in rows:
        key = row["seed"], row["kind"]
        known[key] = joined(known[key], row) if key in known else row
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    file.write_text(
        json.dumps({"machine": machine, "rows": list(known.values())}, indent=1) + "\n"
    )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", choices=list(SHARE), default=list(SHARE))
    parser.add_argument("--count", type=int, help="inputs, instead of minutes")
    parser.add_argument(
        "--first", type=int, default=0, help="number of the first input, with --count"
    )
    parser.add_argument(
        "--keep",
        action="store_true",
        help="add the counts to benchmarks/results/attack.json",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=ROOT / "out/attack",
        help="folder of what failed",
    )
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: STOP.set())  # after the input under way
    cv2.setNumThreads(1)
    for name in AHEAD:
        importlib.import_module(name)
    numbers = (
        range(options.first, options.first + options.count) if options.count else None
    )
    rows = campaign(
        options.minutes, options.seed, options.only, numbers, options.output
    )
    if options.keep:
        keep(rows)
    print(json.dumps(rows, indent=1))
    return 1 if any(row["faulty"] for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
