"""Clips from a cluster are those of this machine, whatever becomes of workers; what is no cluster is told."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import dask_cluster
import pytest
from dask_cluster import Cluster
from distributed import LocalCluster

from physgen.batch import cluster
from physgen.batch.cluster import run_on_cluster
from physgen.batch.run import Done, Job, State, run
from physgen.cli.main import main
from physgen.files import install
from physgen.pipeline import Page, RenderOptions
from physgen.problems import InputError

pytestmark = pytest.mark.slow

MADE_BY_MACHINES = ("command",)
"""What manifests of one clip need not agree on."""


@pytest.fixture(scope="module")
def workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with dask_cluster.cluster(tmp_path_factory.mktemp("workers")) as made:
        yield made


@pytest.fixture(autouse=True)
def _alarm() -> Iterator[None]:
    with dask_cluster.alarmed():
        yield


@pytest.fixture
def two(workers: Cluster) -> Cluster:
    workers.staff(2)
    return workers


@pytest.fixture
def odd(lesson: Path) -> Path:
    """With a warning, and a base of which messages tell."""
    text = lesson.read_text().replace("[16, 30]", "[16, 20]").replace("[44, 32]", "[20, 32]")
    lesson.write_text(text)
    path = lesson.parent / "odd" / "scene.yaml"
    path.parent.mkdir()
    path.write_text("extends: ../lesson.yaml\nobjects: {crate: {mass: 250}}\n")
    return path


def rendered(capfd: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> tuple[list[str], str]:
    """Lines on stdout, and all that anybody wrote to stderr."""
    capfd.readouterr()
    assert main(["render", *arguments]) == code
    out, err = capfd.readouterr()
    return out.splitlines(), err


def manifests(out: Path) -> dict[str, dict[str, object]]:
    found = {}
    for path in sorted(out.glob("*/manifest.json")):
        told = json.loads(path.read_text())
        for name in MADE_BY_MACHINES:
            del told[name]
        for name in ("files", "sizes"):  # the report shows the command
            told[name].pop("report.html", None)
        found[path.parent.name] = told
    return found


def same_clips(one: Path, other: Path) -> None:
    """Of folders side by side: files that hold no times are equal, and so is what manifests tell."""
    assert manifests(one) == manifests(other)
    files = [p.relative_to(one) for p in one.rglob("*") if p.suffix in (".mp4", ".npz", ".png")]
    assert len(files) > 2
    for file in files:
        assert (one / file).read_bytes() == (other / file).read_bytes(), file


def jobs_of(scene: Path, out: Path, count: int = 8, *overrides: str) -> list[Job]:
    return [
        Job(
            str(scene),
            RenderOptions(
                overrides=(f"objects.ball.mass={50 + k}", *overrides), page=Page.NONE, name=f"clip-{k}"
            ),
            str(out),
        )
        for k in range(count)
    ]


def test_a_cluster_makes_the_clips_of_this_machine_and_is_quiet(
    two: Cluster, pictured: Path, odd: Path, capfd, monkeypatch
) -> None:
    monkeypatch.chdir(pictured.parent.parent)
    flags = ["pictured/scene.yaml", "odd/scene.yaml", "--format", "mp4,png"]
    _, told = rendered(capfd, *flags, "-o", "local")
    assert "lesson.yaml:6:18: " in told
    lines, said = rendered(capfd, *flags, "-o", "farmed", "--cluster", two.flag)
    assert lines == ["farmed/pictured", "farmed/odd", "farmed/index.html"]
    assert said == told
    same_clips(Path("local"), Path("farmed"))
    assert not [name for name in os.listdir("farmed") if name.startswith(".")]
    lines, _ = rendered(capfd, *flags, "-o", "farmed", "--cluster", two.flag, "--json")
    assert [json.loads(line).get("state") for line in lines] == ["unchanged", "unchanged", None]


def test_a_clip_that_always_kills_its_worker_fails_alone(lesson: Path) -> None:
    jobs = jobs_of(lesson, lesson.parent / "out", 4)
    jobs[2] = replace(jobs[2], options=replace(jobs[2].options, command=(Fatal(),)))
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        ended = list(run_on_cluster(f"dask={local.scheduler_address}", jobs))
    assert [k for k, done in enumerate(ended) if done.state is State.FAILED] == [2]
    assert "its workers died each time" in str(ended[2].problems[0])


def test_clips_that_this_machine_does_not_see_have_failed(two: Cluster, lesson: Path, monkeypatch) -> None:
    monkeypatch.setattr(cluster, "MANIFEST", "no-such-file")
    (done,) = run_on_cluster(two.flag, jobs_of(lesson, lesson.parent / "out", 1))
    assert "was made, and cannot be seen from here" in str(done.problems[0])


def test_a_worker_killed_midway_takes_no_clip_along(two: Cluster, lesson: Path) -> None:
    out = lesson.parent / "out"
    ended: list[Done] = []
    with closing(run_on_cluster(two.flag, jobs_of(lesson, out, 12))) as results:
        for done in results:
            ended.append(done)
            if len(ended) == 3:
                two.workers[0].send_signal(signal.SIGKILL)
    assert [done.folder for done in ended] == [out / f"clip-{k}" for k in range(12)]
    assert len(list(map(run, jobs_of(lesson, lesson.parent / "local", 12)))) == 12
    same_clips(lesson.parent / "local", out)


class Fatal(str):
    """Ends the process that unpickles it."""

    def __reduce__(self):
        return eval, ("__import__('os')._exit(7)",)


def test_workers_with_another_physgen_are_refused(two: Cluster, lesson: Path, monkeypatch) -> None:
    ours = cluster.own_versions()
    monkeypatch.setattr(cluster, "own_versions", lambda: {**ours, "numpy": "1.0", "sources": "0" * 64})
    with pytest.raises(InputError) as error:
        list(run_on_cluster(two.flag, jobs_of(lesson, lesson.parent / "out", 2)))
    (problem,) = error.value.problems
    assert problem.found.startswith("a worker on ")
    assert problem.expected == (
        f"has numpy {ours['numpy']}, and here is numpy 1.0: its clips would not be the same"
    )
    monkeypatch.setattr(cluster, "own_versions", lambda: {**ours, "sources": "0" * 64})
    with pytest.raises(
        InputError, match=f"has sources {ours['sources'][:12]}, and here is sources 000000000000"
    ):
        list(run_on_cluster(two.flag, jobs_of(lesson, lesson.parent / "out", 2)))


def test_results_are_pulled_in_order_and_jobs_as_they_are_needed(two: Cluster, lesson: Path) -> None:
    pulled = []

    def jobs() -> Iterator[Job]:
        for job in jobs_of(lesson, lesson.parent / "out", 400):
            pulled.append(job)
            yield job

    with closing(run_on_cluster(two.flag, jobs())) as results:
        for k in range(4):
            assert next(results).job.name == f"clip-{k}"
            assert len(pulled) <= k + 1 + 2 * cluster.AHEAD
    assert len(pulled) < 60


def test_what_is_no_cluster_is_told(lesson: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(cluster, "TIMEOUT", 0.3)

    def said(*flags: str) -> str:
        assert main(["render", str(lesson), "-o", str(lesson.parent / "out"), *flags]) == 2
        return capsys.readouterr().err

    told = said("--cluster", "dask=tcp://127.0.0.1:9")
    assert told.startswith('--cluster: "tcp://127.0.0.1:9" is no scheduler that answers within 0.3 s (')
    assert said("--cluster", "dask=nowhere.json").startswith(
        '--cluster: "nowhere.json" is no scheduler file; '
    )
    with pytest.raises(SystemExit):
        main(["render", str(lesson), "--cluster", "daks"])
    assert "daks is not dask=tcp://HOST:PORT or dask=FILE.json" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert said("--cluster", "dask=a.json") == (
        f'--cluster: "dask=a.json" needs Dask, which is not installed; {install("cluster")}\n'
    )
    assert not (lesson.parent / "out").exists()


def test_a_scheduler_that_is_lost_ends_the_run(lesson: Path, tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    with dask_cluster.cluster(tmp_path / "own") as own:
        own.hire()
        jobs = jobs_of(lesson, lesson.parent / "out", 400)
        with closing(run_on_cluster(own.flag, jobs)) as results:
            next(results)
            own.lose()
            with pytest.raises(
                ConnectionError, match=r"dask=tcp.*: the scheduler is gone; once it is back, run"
            ):
                list(results)
