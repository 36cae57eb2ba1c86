"""The wheel as a user gets it: installed over a copy of this environment, run in another folder."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def run(*command: object, cwd: Path) -> str:
    environment = {
        k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")
    }
    done = subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_wheel_renders(tmp_path: Path) -> None:
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    run(
        *pip,
        "wheel",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "-w",
        tmp_path / "dist",
        ROOT,
        cwd=tmp_path,
    )
    [wheel] = (tmp_path / "dist").glob("physgen-*.whl")
    home = tmp_path / "env"
    venv.create(home, with_pip=False)
    site = Path(
        sysconfig.get_path("purelib", vars={"base": str(home), "platbase": str(home)})
    )
    # the libraries of this environment, without its editable physgen: paths inside a .pth do not run its .pth files
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib") + "\n")
    run(
        *pip,
        "--python",
        home / "bin" / "python",
        "install",
        "--quiet",
        "--no-deps",
        "--no-index",
        wheel,
        cwd=tmp_path,
    )
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    where = run(
        home / "bin" / "python",
        "-c",
        "import physgen; print(physgen.__file__)",
        cwd=elsewhere,
    )
    assert Path(where.strip()).is_relative_to(home)
    code = "from physgen.files import install; print(install('edit'))"
    assert (
        run(home / "bin" / "python", "-c", code, cwd=elsewhere)
        == 'pip install "physgen[edit]"\n'
    )
    (elsewhere / "ball.yaml").write_text(
        "physgen: 1\nsize: [64, 48]\nworld: {duration: 0.1}\n"
        "objects: {a: {shape: {circle: {center: [30, 20], radius: 8}}}}\n"
    )
    physgen = home / "bin" / "physgen"
    assert '"$schema"' in run(physgen, "schema", cwd=elsewhere)
    assert run(physgen, "render", "ball.yaml", cwd=elsewhere) == "out/ball\n"
    assert {p.name for p in (elsewhere / "out" / "ball").iterdir()} == {
        "video.mp4", "report.html", "manifest.json", "timing.json", "trajectory.npz",
    }  # fmt: skip
    check_measures(physgen, elsewhere)


MEASURES = {
    "runtime": ["out"],
    "controllability": ["ball.yaml", "--angles", "2", "--sizes", "20,40"],
    "properties": [],
    "physics": ["--rows", "1", "--draws", "1", "--no-convergence", "--jobs", "1"],
    "plausibility": ["tracks.csv", "--fps", "30"],
}
"""Measures that need no truth of a user, and their arguments."""


def check_measures(physgen: Path, folder: Path) -> None:
    """Every measure of the paper is there, and those that need no other files run."""
    offered = run(physgen, "evaluate", "--help", cwd=folder)
    for name in (*MEASURES, "segmentation", "fid", "fidelity", "study"):
        assert name in offered
    rows = [f"{k},ball,{10 + k},{20 + 0.5 * k * k}" for k in range(12)]
    (folder / "tracks.csv").write_text("\n".join(["frame,name,x,y", *rows]) + "\n")
    for name, arguments in MEASURES.items():
        result = run(physgen, "evaluate", name, *arguments, "--json", cwd=folder)
        assert json.loads(result)["measure"] == name
