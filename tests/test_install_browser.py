"""The browser of the tests: looked for, installed, and reported if it is missing."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import install_browser
import pytest

TESTS = Path(__file__).parent
SCRIPT = TESTS / "install_browser.py"
BROWSER_TESTS = """
def test_with_a_browser(browser):
    pass


def test_without_a_browser():
    pass


def test_with_another_browser(browser):
    pass
"""
INTERRUPT_TEST = """
import signal
import subprocess
import sys


def test_a_child_process_can_be_interrupted():
    code = "import time; print('ready', flush=True); time.sleep(30)"
    child = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    child.stdout.readline()
    child.send_signal(signal.SIGINT)
    assert child.wait(timeout=20) == -signal.SIGINT
"""
Install = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder that is all of PATH, with `env`."""
    folder = tmp_path / "bin"
    folder.mkdir()
    program = shutil.which("env")
    assert program is not None
    (folder / "env").symlink_to(program)
    return folder


@pytest.fixture
def install(programs: Path) -> Install:
    """Run the script with the programs of that folder only."""

    def run(**variables: str) -> subprocess.CompletedProcess[str]:
        environment = {**clean_environment(), "PATH": str(programs), **variables}
        return subprocess.run(
            [sys.executable, SCRIPT], capture_output=True, text=True, env=environment
        )

    return run


def clean_environment() -> dict[str, str]:
    """Variables without those that decide about browsers or belong to the outer pytest."""
    environment = dict(os.environ)
    for key in os.environ:
        if key in ("CI", install_browser.VARIABLE) or key.startswith("PYTEST_"):
            del environment[key]
    return environment


def write_program(path: Path, text: str) -> Path:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


def write_apt(programs: Path, text: str) -> None:
    write_program(programs / "apt-get", text)
    write_program(programs / "sudo", 'shift; exec "$@"')
    write_program(programs / "true", "exit 0")


def run_pytest(
    folder: Path, source: str, *options: str, preexec: Callable[[], object] | None
) -> subprocess.CompletedProcess[str]:
    """Run tests in a folder without any program on the path, under our conftest."""
    (folder / "test_sample.py").write_text(source)
    (folder / "pytest.ini").write_text("[pytest]\nmarkers = peer_scenes: none\n")
    paths = [str(TESTS), str(TESTS.parent)]
    environment = {
        **clean_environment(),
        "PATH": str(folder / "no-programs"),
        "PYTHONPATH": os.pathsep.join(paths),
    }
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "conftest", *options, "."],
        capture_output=True,
        text=True,
        cwd=folder,
        env=environment,
        preexec_fn=preexec,
    )


def test_a_browser_is_not_installed_twice(install: Install, programs: Path) -> None:
    write_apt(programs, "exit 100")
    browser = write_program(programs / "google-chrome", "exit 0")
    result = install()
    assert result.returncode == 0
    assert str(browser) in result.stdout
    assert result.stderr == ""


def test_a_missing_browser_is_installed(install: Install, programs: Path) -> None:
    calls = programs / "calls"
    write_apt(
        programs,
        f'echo "$DEBIAN_FRONTEND $@" >> {calls}\n'
        f"[ $1 = update ] || /bin/cp {programs}/true {programs}/chromium",
    )
    result = install(CI="true")
    assert result.returncode == 0
    update, packages = calls.read_text().splitlines()
    assert update.split()[:2] == ["noninteractive", "update"]
    assert packages.split()[0] == "noninteractive"
    assert packages.split()[-2:] == ["chromium", "fonts-dejavu-core"]
    assert str(programs / "chromium") in result.stdout


@pytest.mark.parametrize(("ci", "code"), [("", 0), ("false", 0), ("true", 1)])
@pytest.mark.parametrize("apt", [None, "echo 'E: no network' >&2; exit 100"])
def test_a_browser_missing_fails_in_ci(
    install: Install, programs: Path, apt: str | None, ci: str, code: int
) -> None:
    if apt is not None:
        write_apt(programs, apt)
    result = install(CI=ci)
    assert result.returncode == code
    assert "apt-get install chromium fonts-dejavu-core" in result.stderr
    assert ("E: no network" in result.stderr) == (apt is not None)
    assert "Traceback" not in result.stderr


def test_a_wrong_browser_path_installs_nothing(
    install: Install, programs: Path
) -> None:
    calls = programs / "calls"
    write_apt(programs, f"echo called > {calls}")
    result = install(PHYSGEN_CHROMIUM="/no/such/browser", CI="true")
    assert result.returncode == 1
    assert "'/no/such/browser'" in result.stderr
    assert not calls.exists()


@pytest.mark.parametrize("sudo", [None, "exit 1"])
def test_installing_needs_root_or_sudo(
    monkeypatch: pytest.MonkeyPatch, programs: Path, sudo: str | None
) -> None:
    write_apt(programs, "exit 0")
    (programs / "sudo").unlink()
    if sudo is not None:
        write_program(programs / "sudo", sudo)
    monkeypatch.setenv("PATH", str(programs))
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    with pytest.raises(install_browser.InstallError, match="root"):
        install_browser.install_browser()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("processes", "words", "count"), [("0", "another", 1), ("2", "test", 2)]
)
def test_the_last_line_counts_missed_tests(
    tmp_path: Path, processes: str, words: str, count: int
) -> None:
    options = ("-n", processes, "-k", words)
    result = run_pytest(tmp_path, BROWSER_TESTS, *options, preexec=None)
    last_line = result.stdout.splitlines()[-1]
    assert last_line.startswith(f"{count} ")
    assert install_browser.VARIABLE in last_line
    assert "failed" not in result.stdout


@pytest.mark.slow
def test_no_browser_test_missed_prints_nothing(tmp_path: Path) -> None:
    result = run_pytest(tmp_path, BROWSER_TESTS, "-k", "without", preexec=None)
    assert result.returncode == 0
    assert result.stdout.splitlines()[-1].startswith("1 passed")


@pytest.mark.slow
def test_a_background_job_interrupts_its_children(tmp_path: Path) -> None:
    def ignore_interrupts() -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    options = ("-n", "1")
    result = run_pytest(tmp_path, INTERRUPT_TEST, *options, preexec=ignore_interrupts)
    assert result.returncode == 0, result.stdout


def test_the_ci_script_installs_nothing() -> None:
    script = (TESTS.parent / ".ci" / "run").read_text()
    commands = [line for line in script.splitlines() if not line.startswith("#")]
    words = " ".join(commands).split()
    assert not {"apt-get", "pip", "sudo", "install"}.intersection(words)
    assert [line for line in commands if line.startswith("make ")] == [
        "make test",
        "make test-slow",
    ]
