"""Clips from a cluster are those of this machine, whatever becomes of workers; what is no cluster is told."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import dask_cluster
import pytest
from dask_cluster import Cluster, hands_of, waited

from physgen.batch import cluster, cluster_worker
from physgen.batch.cluster import run_on_cluster
from physgen.batch.run import Done, Job, State
from physgen.batch.workers import LostError
from physgen.cli.main import main
from physgen.pipeline import Page, RenderOptions
from physgen.problems import InputError

pytestmark = pytest.mark.slow

MADE_BY_MACHINES = ("stages", "peak_memory_mib", "command")
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
        for name in ("files", "sizes"):  # the report tells how long it took
            del told[name]["report.html"]
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


def changed(job: Job, **options: object) -> Job:
    return replace(job, options=replace(job.options, **options))


def test_a_local_cluster_makes_the_clips_of_this_machine_and_is_quiet(
    pictured: Path, odd: Path, capfd, monkeypatch
) -> None:
    monkeypatch.chdir(pictured.parent.parent)
    flags = ["pictured/scene.yaml", "odd/scene.yaml", "--format", "mp4,png"]
    _, told = rendered(capfd, *flags, "-o", "local")
    assert "lesson.yaml:6:18: " in told
    lines, said = rendered(capfd, *flags, "-o", "farmed", "--cluster", "dask", "--jobs", "2")
    assert lines == ["farmed/pictured", "farmed/odd", "farmed/index.html"]
    assert said == told
    same_clips(Path("local"), Path("farmed"))
    assert not [name for name in os.listdir("farmed") if name.startswith(".")]
    assert not hands_of(os.getpid())
    lines, _ = rendered(capfd, *flags, "-o", "farmed", "--cluster", "dask", "--json")
    assert [json.loads(line).get("state") for line in lines] == ["unchanged", "unchanged", None]


@pytest.mark.parametrize("way", ["shared", "shipped", "unseen", "stored"])
def test_workers_of_a_scheduler_make_the_same_whether_they_see_the_folders_or_not(
    two: Cluster, pictured: Path, odd: Path, way: str, capfd, monkeypatch
) -> None:
    """Two scenes, by relative paths, which mean nothing where workers stand."""
    monkeypatch.chdir(pictured.parent.parent)
    flags = ["pictured/scene.yaml", "odd/scene.yaml", "--format", "mp4,png"]
    _, told = rendered(capfd, *flags, "-o", "local")
    out = "farmed"
    if way == "shipped":
        flags += ["--ship"]
    if way == "unseen":  # another disk has another file under the same name
        monkeypatch.setattr(cluster, "file_stamp", lambda path: (1, 2, 3))
        monkeypatch.setattr(cluster._Transfer, "_token", lambda self, out: "no-such-file")
    if way == "stored":  # only this process sees it
        out = "memory://farmed"
    _, said = rendered(capfd, *flags, "-o", out, "--cluster", two.flag)
    assert said == told
    if way == "stored":
        import fsspec

        store = fsspec.filesystem("memory")
        store.get("/farmed/", "farmed/", recursive=True)
        store.store.clear()
        for path in Path("farmed").glob("*/manifest.json"):  # tells where the scene is from nowhere near it
            manifest = json.loads(path.read_text())
            assert Path(manifest["source"]).is_absolute()
            manifest["source"] = os.path.relpath(manifest["source"], path.parent)
            path.write_text(json.dumps(manifest))
    same_clips(Path("local"), Path("farmed"))
    pages = [p.read_text() for p in Path("farmed").glob("*/report.html")]
    copies = (os.environ["XDG_CACHE_HOME"], f"physgen-{os.getuid()}/", "worker-")
    assert not [word for page in pages for word in copies if word in page]
    assert len(two.scheduler.workers) == 2  # it is not ours to end


def test_a_scene_that_is_wrong_fails_alone_in_the_same_words(two: Cluster, lesson: Path, capfd) -> None:
    broken = lesson.with_name("a-broken.yaml")
    broken.write_text(lesson.read_text().replace("mass: 200", "mass: heavy"))
    local = rendered(capfd, str(broken), str(lesson), "-o", str(lesson.parent / "out"), code=2)
    for number, more in enumerate(([], ["--ship"])):
        out = str(lesson.parent / f"out{number}")
        lines, said = rendered(
            capfd, str(broken), str(lesson), "-o", out, "--cluster", two.flag, *more, code=2
        )
        assert said == local[1]
        assert lines == [f"{out}/lesson", f"{out}/index.html"]


def test_a_worker_killed_midway_takes_no_clip_along(two: Cluster, lesson: Path) -> None:
    out = lesson.parent / "out"
    ended: list[Done] = []
    with closing(run_on_cluster(two.flag, 1, jobs_of(lesson, out, 12))) as results:
        for done in results:
            ended.append(done)
            if len(ended) == 3:
                two.workers[0].send_signal(signal.SIGKILL)
    assert [done.folder for done in ended] == [out / f"clip-{k}" for k in range(12)]
    for _ in run_on_this_machine(jobs_of(lesson, lesson.parent / "local", 12)):
        pass
    same_files(lesson.parent / "local", out)


def run_on_this_machine(jobs: Sequence[Job]) -> Iterator[Done]:
    from physgen.batch.run import run

    return map(run, jobs)


def same_files(one: Path, other: Path) -> None:
    files = sorted(p.relative_to(one) for p in one.rglob("*") if p.suffix in (".mp4", ".npz"))
    assert len(files) >= 8
    for file in files:
        assert (one / file).read_bytes() == (other / file).read_bytes()


class Fatal(str):
    """What ends the process that unpickles it."""

    def __reduce__(self):
        return eval, (f"__import__('os').{self!s}",)


def test_a_clip_that_always_kills_its_process_fails_alone(lesson: Path) -> None:
    jobs = jobs_of(lesson, lesson.parent / "out", 5)
    jobs[2] = changed(jobs[2], command=(Fatal("_exit(7)"),))
    ended = list(run_on_cluster("dask", 2, jobs))
    assert [done.state for done in ended] == [State.FAILED if k == 2 else State.MADE for k in range(5)]
    assert "its process ended with exit code 7" in str(ended[2].problems[0])


def test_who_stops_leaves_nothing_running_and_the_scheduler_alone(two: Cluster, lesson: Path) -> None:
    jobs = jobs_of(lesson, lesson.parent / "out", 8, "render.frames=20000")
    busy: list[int] = []

    def interrupt() -> None:
        until = time.monotonic() + dask_cluster.PATIENCE
        while len(busy) < 2 and time.monotonic() < until:
            busy[:] = [hand for worker in two.workers for hand in hands_of(worker.pid)]
            time.sleep(0.05)
        time.sleep(0.3)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    with pytest.raises(KeyboardInterrupt), closing(run_on_cluster(two.flag, 1, jobs)) as results:
        next(results)
    assert len(busy) == 2
    waited(lambda: not any(Path(f"/proc/{hand}").exists() for hand in busy))
    assert not list((lesson.parent / "out").iterdir())
    assert len(two.scheduler.workers) == 2


def test_workers_with_another_physgen_are_refused(two: Cluster, lesson: Path, monkeypatch) -> None:
    ours = cluster.own_versions()
    monkeypatch.setattr(cluster, "own_versions", lambda: {**ours, "numpy": "1.0", "sources": "0" * 64})
    with pytest.raises(InputError) as error:
        list(run_on_cluster(two.flag, 1, jobs_of(lesson, lesson.parent / "out", 2)))
    (problem,) = error.value.problems
    assert problem.found.startswith("worker tcp://127.0.0.1:")
    assert problem.expected == (
        f"has numpy {ours['numpy']}, and here is numpy 1.0: its clips would not be the same"
    )
    monkeypatch.setattr(cluster, "own_versions", lambda: {**ours, "sources": "0" * 64})
    with pytest.raises(
        InputError, match=f"has sources {ours['sources'][:12]}, and here is sources 000000000000"
    ):
        list(run_on_cluster(two.flag, 1, jobs_of(lesson, lesson.parent / "out", 2)))


def test_refined_clips_ask_for_a_gpu_where_the_cluster_has_any(
    two: Cluster, lesson: Path, monkeypatch
) -> None:
    from distributed.diagnostics.plugin import SchedulerPlugin

    made: list[str] = []

    class Watch(SchedulerPlugin):
        def transition(self, key, start, finish, *args, worker=None, **more) -> None:
            if (start, finish) == ("processing", "memory"):
                made.append(worker)

    plain, *others = jobs_of(lesson, lesson.parent / "out", 7)
    asks = [
        changed(job, overrides=(*job.options.overrides, "refine.backend=none", "refine.backend=wan"))
        for job in others
    ]
    assert cluster.wants_gpu(changed(plain, device="cuda"))
    assert not cluster.wants_gpu(changed(plain, overrides=("refine.backend=wan", "refine.backend=none")))
    assert not cluster.wants_gpu(plain)
    lesson.write_text(lesson.read_text() + "refine: {backend: wan}\n")
    assert cluster.wants_gpu(plain)
    lesson.write_text(lesson.read_text().removesuffix("refine: {backend: wan}\n"))
    assert all(map(cluster.wants_gpu, asks))
    monkeypatch.setattr(cluster, "wants_gpu", lambda job: job.name != "clip-0")
    assert all(
        done.folder for done in run_on_cluster(two.flag, 1, [plain, *others])
    )  # nobody has any: nobody waits
    gpu = two.hire("--resources", "GPU=1")
    watch = Watch()
    two.scheduler.add_plugin(watch, name="watch")
    again = [replace(job, out=str(lesson.parent / "again")) for job in others]
    assert all(done.folder for done in run_on_cluster(two.flag, 1, again))
    (address,) = {w.address for w in two.scheduler.workers.values() if w.resources.get("GPU")}
    assert set(made) == {address}
    two.scheduler.remove_plugin("watch")
    two.dismiss(gpu)


def test_results_are_pulled_in_order_and_jobs_as_they_are_needed(two: Cluster, lesson: Path) -> None:
    pulled = []

    def jobs() -> Iterator[Job]:
        for job in jobs_of(lesson, lesson.parent / "out", 400):
            pulled.append(job)
            yield job

    with closing(run_on_cluster(two.flag, 1, jobs())) as results:
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
    assert "--ship: is for clusters" in said("--ship")
    monkeypatch.setenv("PATH", str(lesson.parent))
    assert "needs Slurm, and there is no sbatch on the PATH" in said("--cluster", "slurm")
    with pytest.raises(SystemExit):
        main(["render", str(lesson), "--cluster", "daks"])
    assert "daks is not dask, dask=tcp://HOST:PORT, dask=FILE.json or slurm" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert said("--cluster", "dask") == (
        "--cluster: \"dask\" needs Dask, which is not installed; pip install 'physgen[cluster]'\n"
    )
    assert not (lesson.parent / "out").exists()


def test_cancelled_work_ends_at_once_and_idle_processes_later(monkeypatch) -> None:
    monkeypatch.setattr(cluster_worker, "IDLE", 0.2)
    children = cluster_worker.Children()
    with pytest.raises(LostError, match="not wanted any more"):
        children.ask(({}, b"", None), lambda: False)
    answer = children.ask(({}, b"", None), lambda: True)  # it reports that versions differ
    assert isinstance(answer, bytes)
    waited(lambda: not hands_of(os.getpid()))


def test_a_scheduler_that_is_lost_ends_the_run(lesson: Path, tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    with dask_cluster.cluster(tmp_path / "own") as own:
        own.hire()
        jobs = jobs_of(lesson, lesson.parent / "out", 400)
        with closing(run_on_cluster(own.flag, 1, jobs)) as results:
            next(results)
            own.lose()
            with pytest.raises(
                ConnectionError, match=r"dask=tcp.*: the scheduler is gone; once it is back, run"
            ):
                list(results)
