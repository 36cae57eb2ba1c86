"""Slurm by dask-jobqueue: a stand-in for `sbatch` starts the job as a process, so that all the way is gone."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import dask
import pytest
from dask_cluster import alarmed, waited

from physgen.cli.main import main

pytestmark = pytest.mark.slow

SBATCH = """\
#!{python}
import pathlib, shutil, subprocess, sys
home = pathlib.Path({home!r})
script = home / "job.sh"
shutil.copy(sys.argv[-1], script)  # its own goes away at once
with open(home / "log", "wb") as log:
    job = subprocess.Popen(["bash", script], stdout=log, stderr=log, start_new_session=True, cwd=home)
print("Submitted batch job", job.pid)
"""
SCANCEL = """\
#!{python}
import os, pathlib, signal, sys
(pathlib.Path({home!r}) / "cancelled").write_text(sys.argv[-1])
os.killpg(int(sys.argv[-1]), signal.SIGTERM)
"""
SETTINGS = """\
jobqueue:
  slurm: {walltime: "00:07:00", account: physics, memory: 3GB, interface: lo}
"""
REFUSING = """\
#!{python}
import sys
sys.exit("sbatch: error: invalid partition specified: fast")
"""


@pytest.fixture(autouse=True)
def _alarm() -> Iterator[None]:
    with alarmed():
        yield


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder in which Slurm's commands leave what they were told."""
    home = tmp_path / "slurm"
    home.mkdir()
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL), ("refusing", REFUSING)):
        (home / name).write_text(text.format(python=sys.executable, home=str(home)))
        (home / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(home), prepend=os.pathsep)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    (home / "jobqueue.yaml").write_text(SETTINGS)
    dask.config.refresh(paths=[str(home)])
    yield home
    dask.config.refresh()


def test_jobs_of_slurm_make_the_clips_and_are_cancelled(slurm: Path, lesson: Path, capfd) -> None:
    out = lesson.parent / "out"
    before = signal.getsignal(signal.SIGINT)
    assert main(["render", str(lesson), "-o", str(out), "--report", "none", "--cluster", "slurm"]) == 0
    assert capfd.readouterr() == (f"{out / 'lesson'}\n", "")
    assert main(["render", str(lesson), "-o", str(lesson.parent / "local"), "--report", "none"]) == 0
    for file in ("video.mp4", "trajectory.npz"):
        assert (out / "lesson" / file).read_bytes() == (
            lesson.parent / "local" / "lesson" / file
        ).read_bytes()
    script = (slurm / "job.sh").read_text()
    for line in ("#SBATCH -A physics", "#SBATCH -t 00:07:00", "#SBATCH --mem=3G", "--nthreads 1"):
        assert line in script
    job = int((slurm / "cancelled").read_text())
    waited(lambda: not _lives(job))
    assert signal.getsignal(signal.SIGINT) is before  # Ctrl-C is still ours


def _lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_what_slurm_refuses_is_told_in_its_words(slurm: Path, lesson: Path, capfd) -> None:
    (slurm / "refusing").replace(slurm / "sbatch")
    assert main(["render", str(lesson), "-o", str(lesson.parent / "out"), "--cluster", "slurm"]) == 2
    assert capfd.readouterr().err == (
        '--cluster: "slurm" gives no workers (sbatch: error: invalid partition specified: fast); '
        "see jobqueue.slurm in Dask's settings, e.g. ~/.config/dask/jobqueue.yaml\n"
    )
