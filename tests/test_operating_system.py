"""The way that physgen takes on systems without POSIX, and the one module that knows of both."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from without_posix import HIDDEN_MODULES, HIDDEN_NAMES

import physgen
from physgen import operating_system, tables
from physgen.tables import Table

TESTS = Path(__file__).parent
PACKAGE = Path(physgen.__file__).parent
IMPORT_ALL = """
import diffusers, distributed, fastapi, filelock, torch, transformers, uvicorn
import importlib
import pkgutil
import without_posix
without_posix.hide_posix()
import physgen

for module in pkgutil.walk_packages(physgen.__path__, "physgen."):
    if module.name != "physgen.__main__":
        importlib.import_module(module.name)
assert not importlib.import_module("physgen.operating_system").IS_POSIX
"""
LOST_INTERRUPT = """
import without_posix
without_posix.hide_posix()
import sys
import time
import pymunk
from physgen import operating_system, signals

assert not operating_system.IS_POSIX
signals.install_handler()
space = pymunk.Space()
for x in (0, 1):
    body = pymunk.Body(1, 1)
    body.position = x, 0
    space.add(body, pymunk.Circle(body, 3))

def stop(*arguments):
    raise KeyboardInterrupt

space.on_collision(begin=stop)
try:
    space.step(0.01)
    end = time.monotonic() + 30
    while time.monotonic() < end:
        pass
except KeyboardInterrupt:
    sys.exit(7)
"""
RUNNING = """
import without_posix
without_posix.hide_posix()
import sys
from physgen import operating_system

assert not operating_system.IS_POSIX
print(*(operating_system.is_running(int(number)) for number in sys.argv[1:]))
print(operating_system.peak_memory() > 10e6, operating_system.installed_memory() > 1e8)
"""


def run_python(
    arguments: Sequence[str | Path], **options: object
) -> subprocess.CompletedProcess[str]:
    paths = os.pathsep.join([str(TESTS), str(TESTS.parent)])
    environment = {**os.environ, "PYTHONPATH": paths}
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        env=environment,
        **options,  # type: ignore[call-overload]
    )


@pytest.mark.slow
def test_every_module_imports_without_posix() -> None:
    result = run_python(["-c", IMPORT_ALL])
    assert result.returncode == 0, result.stderr


@pytest.mark.slow
def test_perceive_and_render_work_without_posix(bundled: Path, tmp_path: Path) -> None:
    """The scene and the motion are the same, byte for byte, with work in two processes, too."""
    photo = tmp_path / "photo.png"
    photo.write_bytes((bundled / "billiards" / "photo.png").read_bytes())
    script = TESTS / "without_posix.py"
    results = {}
    for name, program in (("posix", ["-m", "physgen"]), ("other", [script])):
        scene = tmp_path / name / "scene.yaml"
        scene.parent.mkdir()
        variants = [scene, bundled / "physics" / "01-free-fall.yaml"]
        out = scene.parent / "out"
        for command in (
            ["perceive", photo, "-o", scene],
            ["render", *variants, "-o", out, "--jobs", "2", "--set", "render.frames=4"],
        ):
            result = run_python([*program, *command])
            assert result.returncode == 0, result.stderr
        assert not list(out.glob(".*"))
        trajectories = sorted(out.glob("*/trajectory.npz"))
        assert len(trajectories) == 2
        results[name] = [scene.read_text(), *(t.read_bytes() for t in trajectories)]
    assert results["other"] == results["posix"]


def test_a_lost_interrupt_arrives_without_posix() -> None:
    result = run_python(["-c", LOST_INTERRUPT], timeout=120)
    assert (result.returncode, result.stderr) == (7, "")


def test_running_processes_are_known_without_posix() -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    result = run_python(["-c", RUNNING, str(os.getpid()), str(ended.pid)])
    assert result.stdout.split() == ["True", "False", "True", "True"], result.stderr
    assert operating_system.is_running(os.getpid())
    assert not operating_system.is_running(ended.pid)


def test_two_tables_of_one_name_do_not_mix(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    with Table(path, ["x"]) as first, Table(path, ["x"]) as second:
        first.add({"x": 1})
        second.add({"x": 2})
        second.publish()
        first.publish()
    assert path.read_text() == "x\n1\n"
    assert list(tmp_path.iterdir()) == [path]


def test_a_table_without_locks_is_this_process_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tables, "IS_POSIX", False)
    path = tmp_path / "table.csv"
    with tables.Table(path, ["x"]) as table:
        assert str(os.getpid()) in table.part.name
        table.add({"x": 1})
        table.publish()
    assert path.read_text() == "x\n1\n"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
@pytest.mark.parametrize("streams", [(0,), (1,), (2,), (0, 1, 2)])
def test_closed_streams_lose_no_result(
    bundled: Path, tmp_path: Path, streams: tuple[int, ...]
) -> None:
    """A file that gets the number of a closed stream would receive what is printed."""

    def close_streams() -> None:
        for number in streams:
            os.close(number)

    names = ("01-free-fall", "05-slide")
    scenes = [bundled / "physics" / f"{name}.yaml" for name in names]
    options = ["-o", tmp_path, "--jobs", "2", "--set", "render.frames=4"]
    command = ["-m", "physgen", "render", *scenes, *options]
    result = run_python(command, preexec_fn=close_streams)
    assert result.returncode == 0
    assert all((tmp_path / name / "video.mp4").stat().st_size for name in names)


@pytest.mark.slow
def test_one_module_alone_calls_posix() -> None:
    names = {f"{module}.{name}" for module in HIDDEN_NAMES for name in HIDDEN_NAMES[module]}  # fmt: skip
    names |= {"os.getppid", "os.kill", "signal.SIGTERM"}
    uses = []
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            imported = []
            if isinstance(node, ast.Import):
                imported = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                imported = [f"{node.module}.{alias.name}" for alias in node.names]
                imported.append(str(node.module))
            elif isinstance(node, ast.Attribute):
                imported = [ast.unparse(node)]
            if names.union(HIDDEN_MODULES).intersection(imported):
                uses.append(path.relative_to(PACKAGE).as_posix())
    assert set(uses) <= {"operating_system.py", "batch/workers.py"}
