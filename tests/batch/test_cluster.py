"""Clips of a cluster are those of one machine, also if workers die; an unusable cluster is one message."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from pathlib import Path

import dask_processes
import pytest
from dask_processes import Cluster, wait_until
from distributed import Client

from physgen import batch
from physgen.batch import cluster
from physgen.batch.cluster import BatchSize, run_batch, run_on_cluster
from physgen.batch.run import Job, JobResult, report_failure, run
from physgen.cli.main import main
from physgen.files import install
from physgen.pipeline import Page, RenderOptions
from physgen.problems import InputError
from physgen.report.folders import remove_leftovers


@pytest.fixture(scope="module")
def workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with dask_processes.cluster(tmp_path_factory.mktemp("workers")) as started:
        yield started


@pytest.fixture
def two(workers: Cluster) -> Iterator[Cluster]:
    with dask_processes.alarm():
        workers.have_workers(2)
        yield workers


def contents(out: Path) -> dict[str, bytes]:
    """Files that hold no times, and manifests without the command."""
    files = {}
    for path in out.rglob("*"):
        name = str(path.relative_to(out))
        if path.suffix in (".mp4", ".npz", ".png", ".csv"):
            files[name] = path.read_bytes()
        if path.name == "manifest.json":
            data = json.loads(path.read_bytes())
            del data["command"]
            files[name] = json.dumps(data).encode()
    return files


def every_file(root: Path) -> dict[Path, bytes]:
    paths = [path for path in root.rglob("*") if path.is_file()]
    return {path.relative_to(root): path.read_bytes() for path in paths}


def jobs_of(scene: Path, out: Path, count: int, **options: object) -> list[Job]:
    return [
        Job(
            str(scene),
            RenderOptions(
                overrides=(f"objects.ball.mass={50 + k}",),
                page=Page.NONE,
                name=f"clip-{k}",
                **options,
            ),
            str(out),
        )
        for k in range(count)
    ]


def run_or_die(text: str) -> str:
    if text == "fatal":
        os._exit(7)
    return text.upper()


@pytest.mark.slow
def test_a_cluster_sweeps_as_one_machine_does(
    two: Cluster, lesson: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    sweep = ["sweep", "lesson.yaml", "objects.ball.mass=10:500:6", "--report", "none"]
    assert main([*sweep, "-o", "alone"]) == 0
    alone = capsys.readouterr().out
    assert main([*sweep, "-o", "shared", "--cluster", str(two.file)]) == 0
    assert capsys.readouterr().out == alone.replace("alone", "shared")
    assert contents(tmp_path / "alone") == contents(tmp_path / "shared")
    assert len(contents(tmp_path / "alone")) == 6 * 3 + 1
    assert [
        path for path in (tmp_path / "shared").iterdir() if path.name[0] == "."
    ] == []
    assert main([*sweep, "-o", "shared", "--cluster", two.address, "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["unchanged"] == 6
    assert main(["verify", "shared", "--cluster", two.address, "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["equal"] == 6
    gather = ["dataset", "shared", "--split", "train=1", "-o"]
    assert main([*gather, "one"]) == 0
    assert main([*gather, "other", "--cluster", two.address]) == 0
    assert every_file(tmp_path / "one") == every_file(tmp_path / "other")
    assert len(every_file(tmp_path / "one")) > 6 * 3


@pytest.mark.slow
def test_a_store_takes_the_place_of_a_shared_folder(
    two: Cluster, pictured: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = str(pictured.relative_to(tmp_path))
    sweep = ["sweep", scene, "objects.ball.mass=50,90", "--report", "none"]
    assert main([*sweep, "-o", "alone"]) == 0
    url = f"file://{tmp_path}/store"
    shipped = ["--cluster", two.address, "--ship", url]
    capsys.readouterr()
    assert main([*sweep, "-o", "out", *shipped]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"{url}/out/00,mass=50", f"{url}/out/01,mass=90", "out/sweep.csv"]
    clips = contents(tmp_path / "store" / "out") | contents(tmp_path / "out")
    assert clips == contents(tmp_path / "alone")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["sweep.csv"]
    assert main([*sweep, "-o", "out", *shipped, "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["unchanged"] == 2
    assert main(["verify", "out", *shipped, "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["equal"] == 2
    assert main(["verify", "nowhere", *shipped]) == 2
    assert f"nowhere: has no clip in {url}" in capsys.readouterr().err
    monkeypatch.chdir(tmp_path / "out")
    assert main(["render", f"../{scene}", *shipped]) == 2
    assert "is outside the working folder" in capsys.readouterr().err


@pytest.mark.slow
def test_a_data_set_of_clips_in_a_store_is_there(
    two: Cluster, lesson: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    url = f"file://{tmp_path}/store"
    shipped = ["--cluster", two.address, "--ship", url]
    sweep = ["sweep", "lesson.yaml", "objects.ball.mass=50,90", "--preview"]
    assert main([*sweep, "-o", "out", *shipped]) == 0
    shutil.copytree(tmp_path / "store" / "out", tmp_path / "here" / "out")
    for layout in ("folder", "webdataset"):
        command = ["dataset", "--layout", layout, "-o"]
        assert main([*command, f"{layout}-here", "here/out"]) == 0
        capsys.readouterr()
        assert main([*command, f"{layout}-there", "out", *shipped]) == 0
        for line in capsys.readouterr().out.splitlines():
            assert Path(line.removeprefix("file://")).is_file()
        here, there = tmp_path / f"{layout}-here", tmp_path / "store"
        assert every_file(there / f"{layout}-there") == every_file(here)
    assert not (tmp_path / "folder-there").exists()
    assert main(["dataset", "out", "-o", "folder-there", *shipped]) == 2
    assert f"folder-there: is already in {url}" in capsys.readouterr().err
    assert main(["dataset", "nowhere", "-o", "third", *shipped]) == 2
    assert f"nowhere: has no clip in {url}" in capsys.readouterr().err
    assert not (tmp_path / "store" / "third").exists()


@pytest.mark.slow
def test_the_clip_of_a_photo_is_made_on_a_cluster(
    two: Cluster, pictured: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    photo, masks = "pictured/photo.png", "pictured/photo.assets/masks.png"
    few = ["--set", "render.frames=4", "--report", "none"]
    clip = ["clip", photo, "--masks", masks, *few]
    assert main([*clip, "-o", "alone"]) == 0
    alone = capsys.readouterr().out
    assert main([*clip, "-o", "shared", "--cluster", two.address]) == 0
    assert capsys.readouterr().out == alone.replace("alone", "shared")
    assert contents(tmp_path / "alone") == contents(tmp_path / "shared")
    assert (tmp_path / "shared" / "photo" / "video.mp4").is_file()


@pytest.mark.slow
def test_the_script_of_the_docs_starts_a_cluster(
    lesson: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    """With Dask's local cluster in place of Slurm's, and less work."""
    page = (Path(__file__).parents[2] / "docs" / "batches.md").read_text()
    (script,) = re.findall(r"```python\n(.*?SLURMCluster.*?)```", page, re.DOTALL)
    slurm = "from dask_jobqueue import SLURMCluster", "SLURMCluster(**size)"
    local = "from distributed import LocalCluster", "LocalCluster(n_workers=1)"
    changes = {**dict(zip(slurm, local, strict=True)), "scale(64)": "scale(1)"}
    changes |= {"500:1000": "500:2", '"--cluster"': '"--preview", "--cluster"'}
    for old, new in changes.items():
        assert script.count(old) == 1
        script = script.replace(old, new)
    monkeypatch.chdir(tmp_path)
    lesson.rename("scene.yaml")
    with dask_processes.alarm():
        exec(script, {})
    lines = capsys.readouterr().out.splitlines()
    assert [Path(line).name for line in lines[:2]] == ["00,mass=10", "01,mass=500"]
    assert Path(lines[-1]).name == "sweep.csv"


@pytest.mark.slow
def test_a_killed_worker_loses_no_clip(
    two: Cluster, lesson: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    jobs = jobs_of(lesson, out, 30)
    done: list[JobResult] = []
    with closing(run_on_cluster(two.address, run, jobs, report_failure)) as results:
        for result in results:
            done.append(result)
            if len(done) == 3:
                two.workers[0].send_signal(signal.SIGKILL)
    two.workers[0].wait()
    # What the killed worker had begun stays until the next command on this folder.
    remove_leftovers(out)
    assert [result.folder for result in done] == [out / f"clip-{k}" for k in range(30)]
    for job in jobs_of(lesson, tmp_path / "alone", 30):
        assert run(job).folder is not None
    assert contents(tmp_path / "alone") == contents(out)


@pytest.mark.slow
def test_an_item_that_kills_its_workers_fails_alone() -> None:
    items = [*"abc", "fatal", *"def"]
    lost = "{}: {}".format
    with dask_processes.alarm():
        results = list(run_on_cluster("local:2", run_or_die, items, lost))
    expected = [*"ABC", "fatal: its workers died each time", *"DEF"]
    assert results == expected


@pytest.mark.slow
def test_ctrl_c_cancels_a_run(two: Cluster, lesson: Path, tmp_path: Path) -> None:
    sweep = ["objects.ball.mass=10:500:400", "--report", "none", "-o", "out"]
    command = [sys.executable, "-m", "physgen", "sweep", "lesson.yaml", *sweep]
    run = subprocess.Popen(
        [*command, "--cluster", two.address],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert run.stdout is not None
    assert run.stdout.readline() == "out/00,mass=10\n"
    run.send_signal(signal.SIGINT)
    _, errors = run.communicate()
    assert (run.returncode, errors) == (130, "interrupted\n")
    with Client(two.address, set_as_default=False) as client:
        wait_until(lambda: not any(client.processing().values()))
    assert 0 < len(list((tmp_path / "out").glob("*/manifest.json"))) < 400
    assert not (tmp_path / "out" / "sweep.csv").exists()


@pytest.mark.slow
def test_a_lost_scheduler_ends_the_run(lesson: Path, tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    with dask_processes.alarm(), dask_processes.cluster(tmp_path / "own") as own:
        own.add_worker()
        jobs = jobs_of(lesson, tmp_path / "out", 400)
        with closing(run_on_cluster(own.address, run, jobs, report_failure)) as results:
            next(results)
            own.scheduler.kill()
            with pytest.raises(ConnectionError, match="the scheduler is gone; once"):
                list(results)


@pytest.mark.slow
def test_items_are_taken_as_they_are_needed(two: Cluster) -> None:
    taken = []

    def items() -> Iterator[str]:
        for k in range(100_000):
            taken.append(k)
            yield str(k)

    with closing(
        run_on_cluster(two.address, run_or_die, items(), report_failure)
    ) as results:
        for k in range(300):
            assert next(results) == str(k)
            # each waiting batch may be a full one, and follows a first one of one item
            most = cluster.BATCHES_AHEAD * 2 * (cluster.LARGEST_BATCH + 1)
            assert len(taken) <= k + 1 + most


def test_another_version_is_refused(tmp_path: Path) -> None:
    ours = cluster.own_versions()
    assert {"physgen", "python", "numpy", "av", "sources"} <= set(ours)
    start = partial(run_batch, folder=str(tmp_path), content=b"")
    with pytest.raises(InputError) as error:
        start({**ours, "numpy": "1.0", "sources": "0" * 64})
    (problem,) = error.value.problems
    assert problem.found.startswith("a worker on ")
    expected = f"has numpy {ours['numpy']}, but this machine has numpy 1.0: its results would differ"
    assert problem.expected == expected
    sources = (
        f"has sources {ours['sources'][:12]}, but this machine has sources 000000000000"
    )
    with pytest.raises(InputError, match=sources):
        start({**ours, "sources": "0" * 64})


def test_a_worker_that_sees_no_folder_says_so(tmp_path: Path) -> None:
    folder = str(tmp_path / "missing")
    with pytest.raises(InputError, match="add --ship URL"):
        run_batch(cluster.own_versions(), folder, b"")


def test_tasks_take_about_a_second() -> None:
    size = BatchSize()
    assert size.items == 1
    size.add(seconds=0.4, items=4)
    assert size.items == 10
    for _ in range(20):
        size.add(seconds=1e-6, items=10)
    assert size.items == cluster.LARGEST_BATCH
    for _ in range(20):
        size.add(seconds=500, items=10)
    assert size.items == 1


@pytest.mark.parametrize("name", ["daks", "local:0", "local:x"])
def test_a_word_that_is_no_cluster_is_refused(name: str, lesson: Path, capsys) -> None:
    with pytest.raises(SystemExit) as error:
        main(["render", str(lesson), "--cluster", name])
    assert error.value.code == 2
    assert f"{name} is not a cluster; write tcp://HOST:8786" in capsys.readouterr().err


def test_an_unusable_cluster_is_one_message(lesson: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(cluster, "TIMEOUT", 0.3)
    monkeypatch.chdir(lesson.parent)

    def message(*flags: str) -> str:
        out = str(lesson.parent / "out")
        assert main(["render", str(lesson), "-o", out, *flags]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        return line

    refused = message("--cluster", "tcp://127.0.0.1:9")
    assert refused.startswith('--cluster: "tcp://127.0.0.1:9" is not a scheduler that')
    refused = message("--cluster", "nowhere.json")
    assert refused.startswith('--cluster: "nowhere.json" is not a scheduler file; ')
    Path("empty.json").write_text("{}")
    refused = message("--cluster", "empty.json")
    assert refused.startswith('--cluster: "empty.json" has no scheduler; ')
    refused = message("--ship", "")
    assert refused.startswith('--ship: "" is not a store; ')
    refused = message("--ship", "s3://a/b")
    assert refused == '--ship: "s3://a/b" is only for clusters; add --cluster ADDRESS'
    refused = message("--cluster", "local", "--jobs", "2")
    assert refused.startswith("--jobs: 2 is only for one machine; leave it out")
    refused = message("--cluster", "local", "--ship", "unknown://a/b")
    assert refused.startswith('--ship: "unknown://a/b" is not a store (')
    refused = message("--cluster", "local:1", "--ship", "/proc/nowhere")
    assert refused.startswith('--ship: "/proc/nowhere" cannot be written (')
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(sys.modules, cluster.__name__)
    monkeypatch.delattr(batch, "cluster")
    refused = message("--cluster", "a.json")
    needs = '--cluster: "a.json" needs Dask, which is not installed; '
    assert refused == needs + install("cluster")
