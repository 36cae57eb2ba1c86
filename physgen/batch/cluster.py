"""Make clips on a Dask cluster: open the cluster, hand out jobs, collect results in order.

Folders are used as if the workers shared them until a worker reports that it does not see one; from then on scenes are
sent to workers, and clips are sent back.
"""

from __future__ import annotations

import json
import logging
import os
import pickle
import secrets
import shutil
import signal
import time
import warnings
from collections import OrderedDict
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physgen.batch.cluster_worker import CHILDREN, Answer, Task, Versions, own_versions, run_task
from physgen.batch.remote import is_private, is_url, open_folder
from physgen.batch.remote_scene import fetched_pack, file_overrides, packed_for
from physgen.batch.resume import recorded_warnings, unchanged_clip
from physgen.batch.run import (
    MANIFEST,
    Done,
    Job,
    State,
    failed,
    hash_of,
    is_refined,
    local_copy,
    own_folder,
    resolve_refiner,
    send_clip,
    unchanged_remote,
    with_outcomes,
    with_user_names,
)
from physgen.batch.workers import AHEAD, LostError
from physgen.files import Stamp, file_stamp, partial
from physgen.pipeline.packs import pack_key, scene_file
from physgen.problems import InputError
from physgen.report.folders import atomic_folder, output_folder

if TYPE_CHECKING:
    from distributed import Client, Future

    from physgen.scene.load import Opened

Report = Callable[[str], None]

TIMEOUT = 10.0
"""s in which a scheduler must answer."""
CLOSE_TIMEOUT, HURRIED_TIMEOUT = 10.0, 1.0
"""s in which a client or cluster must close, and the same after an interruption."""
INSTALL = "pip install 'physgen[cluster]'"
DASK_SETTINGS = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.limit": "1h",
    "distributed.comm.timeouts.connect": f"{TIMEOUT:g}s",
}
TRIES = 3
"""How often the cluster may lose a job, as a restarted scheduler does."""
SPARE = 8
"""Jobs handed out beyond two per thread: a cluster may grow, and does where tasks wait for it."""
STATUS_INTERVAL = 2.0
"""s between looks at the workers."""
NO_WORKER_NOTICE = 10.0
"""s without any worker after which that is reported."""
POLL = 0.005
"""s between looks for answers."""
MAX_PACKS = 8
"""Scenes that are kept on the cluster."""


def run_on_cluster(
    where: str,
    workers: int,
    jobs: Iterable[Job],
    ship: bool = False,
    report: Report = lambda text: None,
) -> Generator[Done, None, None]:
    """Results in the order of the jobs, from the cluster that `--cluster` names; with `ship` no folder is shared.

    `report` gets what there is to wait for. Raises InputError where there is no such cluster or the clips of a worker
    would differ, OSError where the scheduler is lost. A caller that stops early must close the generator.
    """
    transfer = _Transfer(ship)
    try:
        with _connected(where, workers) as client:
            yield from _Farm(client, transfer, where, report).results(iter(jobs))
    finally:
        transfer.close()


@contextmanager
def _connected(where: str, workers: int) -> Iterator[Client]:
    """A client of a local cluster, a scheduler, or Slurm; what was started here is closed at the end."""
    try:
        import dask
        from distributed import Client
    except ImportError:
        found = "needs Dask, which is not installed"
        raise InputError.of("--cluster", f'"{where}"', found, INSTALL) from None
    kind, _, address = where.partition("=")
    address = os.path.expanduser(address)
    with _quiet(), dask.config.set(DASK_SETTINGS):
        if not address:
            with (
                _slurm(workers) if "slurm" in kind else _local(workers) as cluster,
                _closing(Client(cluster, timeout=TIMEOUT, set_as_default=False)) as client,
            ):
                yield client
            return
        is_file = address.endswith(".json")
        if is_file and not os.path.exists(address):
            fix = "start it: dask scheduler --scheduler-file FILE.json"
            raise InputError.of("--cluster", f'"{address}"', "is no scheduler file", fix)
        named = {"scheduler_file": address} if is_file else {"address": address}
        try:
            client = Client(**named, timeout=TIMEOUT, set_as_default=False)
        except (OSError, ValueError, TypeError, ImportError) as error:  # a time-out is an OSError
            fix = "see that it runs, and that this machine may reach it; dask scheduler starts one"
            reason = str(error).split("\n")[0]
            found = f"is no scheduler that answers within {TIMEOUT:g} s ({reason})"
            raise InputError.of("--cluster", f'"{address}"', found, fix) from None
        with _closing(client):
            yield client


@contextmanager
def _closing(opened: Any) -> Iterator[Any]:
    """Closes a client or a cluster at the end of the block, without delay after an interruption."""
    timeout = CLOSE_TIMEOUT
    try:
        yield opened
    except BaseException:
        timeout = HURRIED_TIMEOUT
        raise
    finally:
        with suppress(Exception):
            opened.close(timeout=timeout)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silences the logs of Dask, whose errors are reported in our own words."""
    names = [
        name
        for name in ("distributed", "tornado", "dask_jobqueue", *logging.root.manager.loggerDict)
        if name.partition(".")[0] in ("distributed", "tornado", "dask_jobqueue")
    ]
    before = {name: logging.getLogger(name).level for name in names}
    logging.getLogger("asyncio").setLevel(logging.CRITICAL + 1)  # for good: it still logs after the block
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            for name, level in before.items():
                logging.getLogger(name).setLevel(level)


@contextmanager
def _local(workers: int) -> Iterator[Any]:
    """Workers in threads of this process, whose clips are made by child processes."""
    from distributed import LocalCluster

    cluster = LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=False,
        dashboard_address=None,
        memory_limit=0,
        silence_logs=logging.CRITICAL + 1,
    )
    try:
        with _closing(cluster):
            yield cluster
    finally:
        CHILDREN.end()


@contextmanager
def _slurm(workers: int) -> Iterator[Any]:
    """Workers in jobs of Slurm, as `jobqueue.slurm` of Dask's settings says; else of one core and 4 GB each."""
    import dask
    from distributed.core import Status

    if shutil.which("sbatch") is None:
        fix = "run this on a machine of the cluster, or name a scheduler: --cluster dask=tcp://HOST:8786"
        raise InputError.of("--cluster", '"slurm"', "needs Slurm, and there is no sbatch on the PATH", fix)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        from dask_jobqueue import SLURMCluster

        with suppress(ValueError):  # not the main thread; its import replaces the handler of Ctrl-C
            for number, handler in handlers.items():
                signal.signal(number, handler)
        defaults = {"cores": 1, "processes": 1, "memory": "4GB"}
        more = {k: v for k, v in defaults.items() if dask.config.get(f"jobqueue.slurm.{k}", None) is None}
        quiet = logging.CRITICAL + 1
        cluster = SLURMCluster(scheduler_options={"dashboard": False}, silence_logs=quiet, **more)
    except ImportError:
        found = "needs dask-jobqueue, which is not installed"
        raise InputError.of("--cluster", '"slurm"', found, INSTALL) from None
    except (OSError, RuntimeError, TypeError, ValueError) as error:
        raise _slurm_error(error) from None

    async def request() -> None:
        cluster.scale(workers)
        await cluster._correct_state()  # by itself it does not raise what Slurm refuses

    with _closing(cluster):
        try:
            cluster.sync(request)
        except (OSError, RuntimeError, ValueError) as error:
            for job in cluster.workers.values():  # closing the cluster waits for those that seem to start
                job.status = Status.failed if job.status is Status.created else job.status
            raise _slurm_error(error) from None
        yield cluster


def _slurm_error(error: Exception) -> InputError:
    reason = " ".join(str(error).rpartition("stderr:")[2].split())
    fix = "see jobqueue.slurm in Dask's settings, e.g. ~/.config/dask/jobqueue.yaml"
    return InputError.of("--cluster", '"slurm"', f"gives no workers ({reason})", fix)


class _Transfer:
    """Decides what is sent to workers and what comes back."""

    def __init__(self, ship: bool) -> None:
        self._ship = self._send_scenes = self._send_clips = ship
        self._tokens: dict[str, Path] = {}

    def missing(self, answer: Answer) -> None:
        """A worker does not see what others may see: from now on it is sent."""
        self._send_scenes |= answer.scene_missing
        self._send_clips |= answer.folder_missing

    def sends_scene(self, job: Job) -> bool:
        """Whether the scene is sent to the worker."""
        if is_url(job.scene):
            return self._ship or is_private(job.scene)
        return self._send_scenes

    def _returns_clip(self, job: Job) -> bool:
        if is_url(job.out):
            return self._ship or is_private(job.out)
        return self._send_clips

    def task(self, job: Job) -> Task:
        """Raises InputError or OSError where the folder of results cannot be used."""
        sends, returns = self.sends_scene(job), self._returns_clip(job)
        known = replace(job, refiner=resolve_refiner(job.refiner))
        if sends or returns:  # the worker cannot compute the mark and origin of the user's files
            known = known.with_local(job.scene, job.out)
        stamp = None if sends or is_url(job.scene) else file_stamp(Path(job.scene))
        token = None if returns or is_url(job.out) else self._token(job.out)
        return Task(known, os.getcwd(), stamp, token, returns)

    def _token(self, out: str) -> str:
        """The name of a file in the folder by which a worker recognises it."""
        if out not in self._tokens:
            folder = Path(out)
            folder.mkdir(parents=True, exist_ok=True)
            self._tokens[out] = partial(folder / secrets.token_hex(8))
        self._tokens[out].touch()  # an old one is removed as a leftover, and a run may take days
        return self._tokens[out].name

    def close(self) -> None:
        """Removes the tokens."""
        for token in self._tokens.values():
            with suppress(OSError):
                token.unlink()

    def early(self, job: Job) -> Done | None:
        """The result of a job that needs no worker: the clip is there, or its folder cannot be used."""
        if not self._returns_clip(job):
            return None
        try:
            if not is_url(job.out):
                output_folder(Path(job.out), job.name)
            if not job.options.cached:
                return None
            scene = local_copy(job.scene, job.options.overrides, job.options.variant)
            if is_url(job.out):
                return unchanged_remote(job, open_folder(job.out).below(job.name), scene)
            manifest = unchanged_clip(job.folder, job.mark, scene_file(scene), hash_of)
            if manifest is None:
                return None
            done = Done(job, job.folder, tuple(recorded_warnings(manifest)), State.UNCHANGED)
            return with_outcomes(done, job.folder / "trajectory.npz")
        except (InputError, OSError) as error:
            return failed(job, error)


def _receive(job: Job, done: Done, files: Mapping[str, bytes] | None) -> Done:
    """The result in terms of the user's job, with the clip that was sent back written where it belongs."""
    made_in = done.job.out
    done_here = with_user_names(done, job, made_in if made_in != job.out else "")
    if not files:
        return done_here
    try:
        if is_url(job.out):
            with own_folder() as folder:
                _write_files(files, folder)
                send_clip(folder, open_folder(job.out).below(job.name), done_here)
        elif done_here.folder is not None or not _is_refined(job.folder):
            with atomic_folder(job.folder) as folder:
                _write_files(files, folder)
    except (InputError, OSError) as error:
        return failed(job, error, seconds=done.seconds)
    return done_here


def _write_files(files: Mapping[str, bytes], folder: Path) -> None:
    for name, data in files.items():
        path = Path(os.path.normpath(folder / name))
        if not path.is_relative_to(folder):
            raise InputError.of(name, "", "leads out of the clip's folder", "see what the workers run")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def _is_refined(folder: Path) -> bool:
    try:
        return is_refined(json.loads((folder / MANIFEST).read_bytes()))
    except (OSError, ValueError, AttributeError):
        return False


@dataclass(eq=False)
class _UnderWay:
    number: int
    job: Job
    lost: int = 0
    """How often the cluster lost it."""


class _Farm:
    """Hands jobs out to workers as they get free."""

    def __init__(self, client: Client, transfer: _Transfer, where: str, report: Report) -> None:
        self._client, self._transfer, self._where, self._report = client, transfer, where, report
        self._threads = 0
        self._has_gpus = False
        self._under_way: dict[Future, _UnderWay] = {}
        self._done: dict[int, Done] = {}
        self._packs: OrderedDict[object, tuple[str, Future]] = OrderedDict()
        self._looked = 0.0
        self._no_workers_since: float | None = time.monotonic()
        """None once that was reported, or there were some."""

    def results(self, jobs: Iterator[Job]) -> Iterator[Done]:
        from distributed import as_completed

        answers = as_completed(loop=self._client.loop, with_results=True, raise_errors=False)
        due = count = 0
        more = True
        try:
            while more or due < count:
                self._look()
                limit = due + AHEAD * max(self._threads, 1)
                while more and count < limit and len(self._under_way) < 2 * self._threads + SPARE:
                    job = next(jobs, None)
                    more = job is not None
                    if job is not None:
                        self._begin(_UnderWay(count, job), answers)
                        count += 1
                if due in self._done:
                    yield self._done.pop(due)
                    due += 1
                    continue
                batch = answers.next_batch(block=False)
                if not batch:
                    time.sleep(POLL)
                for future, result in batch:
                    self._take(self._under_way.pop(future), future, result, answers)
        finally:
            if self._client.status == "running":
                with suppress(OSError):
                    self._client.cancel(list(self._under_way), force=True)

    def _look(self) -> None:
        """Counts the workers. Raises ConnectionError where the scheduler is lost."""
        now = time.monotonic()
        if now < self._looked + STATUS_INTERVAL:
            return
        self._looked = now
        if self._client.status != "running":
            fix = "once it is back, run the same command again"
            raise ConnectionError(f"{self._where}: the scheduler is gone; {fix}")
        try:
            info = self._client.scheduler_info(n_workers=-1)
        except TypeError:  # before Dask 2025
            info = self._client.scheduler_info()
        workers = info["workers"].values()
        self._threads = sum(worker["nthreads"] for worker in workers)
        self._has_gpus = any(worker.get("resources", {}).get("GPU") for worker in workers)
        if self._threads:
            self._no_workers_since = None
        elif self._no_workers_since is not None and now > self._no_workers_since + NO_WORKER_NOTICE:
            self._report(f"{self._where}: has no workers yet; waiting for them")
            self._no_workers_since = None

    def _begin(self, item: _UnderWay, answers: Any) -> None:
        """Hands a job to the cluster, unless it ends without it."""
        job = item.job
        early = self._transfer.early(job)
        if early is None:
            try:
                key, pack = self._sent_scene(job) if self._transfer.sends_scene(job) else ("", None)
                task = pickle.dumps(self._transfer.task(job))
                resources = {"GPU": 1} if self._has_gpus and wants_gpu(job) else None
                future = self._client.submit(
                    run_task, own_versions(), task, pack, key, pure=False, resources=resources
                )
                self._under_way[future] = item
                answers.add(future)
                return
            except (InputError, OSError) as error:
                early = failed(job, error)
        self._done[item.number] = early

    def _sent_scene(self, job: Job) -> tuple[str, Future]:
        """Key and future of the scene's pack on the cluster. Raises InputError or OSError."""
        overrides = job.options.overrides
        scene = job.scene, file_overrides(overrides), job.options.allow_outside
        if scene not in self._packs:
            if is_url(job.scene):
                data = fetched_pack(job.scene, overrides, job.options.variant)
            else:
                file = scene_file(job.scene)
                data = packed_for(file, overrides, job.options.variant, job.options.allow_outside)
            # submitted, not scattered: it is computed again where its worker is lost
            self._packs[scene] = pack_key(data), self._client.submit(bytes, data, pure=False)
            while len(self._packs) > MAX_PACKS:
                self._packs.popitem(last=False)
        self._packs.move_to_end(scene)
        return self._packs[scene]

    def _take(self, item: _UnderWay, future: Future, result: Any, answers: Any) -> None:
        """Stores the result of a job, or hands it out again."""
        from distributed import KilledWorker

        if isinstance(result, LostError):
            self._done[item.number] = failed(item.job, result)
        elif future.status == "finished" and isinstance(result, bytes):
            answer: Answer = pickle.loads(result)
            if answer.versions is not None:
                raise _version_error(self._worker_of(future), answer.versions)
            if answer.done is not None:
                self._done[item.number] = _receive(item.job, answer.done, answer.files)
                return
            self._transfer.missing(answer)
            self._begin(item, answers)
        else:
            error = result[1] if isinstance(result, tuple) else result
            if isinstance(error, ModuleNotFoundError | AttributeError) and "physgen" in str(error):
                found = f"has no physgen, or another one ({error})"
                raise InputError.of("--cluster", self._where, found, "install the same on workers as here")
            if future.status == "error" and not isinstance(error, KilledWorker):
                raise error
            item.lost += 1
            if item.lost > TRIES:
                self._done[item.number] = failed(item.job, LostError("its workers died each time"))
            else:
                self._begin(item, answers)

    def _worker_of(self, future: Future) -> str:
        """Its address."""
        found = self._client.who_has([future]).values()
        return next((str(address) for addresses in found for address in addresses), "of the cluster")


def _version_error(worker: str, theirs: Versions) -> InputError:
    """The clips of a worker would differ."""
    ours = own_versions()
    names = [name for name in dict.fromkeys((*ours, *theirs)) if ours.get(name) != theirs.get(name)]
    if len(names) > 1 and "sources" in names:
        names.remove("sources")  # a hash, which explains less than the other versions

    def text(found: Versions) -> str:
        return ", ".join(f"{name} {found.get(name, 'none')[:12]}" for name in names)

    expected = f"has {text(theirs)}, and here is {text(ours)}: its clips would not be the same"
    return InputError.of("--cluster", f"worker {worker}", expected, "install the same on both")


def wants_gpu(job: Job) -> bool:
    """Whether a clip is drawn on a GPU, or refined."""
    if job.options.device != "cpu":
        return True
    chosen = [text for text in job.options.overrides if text.startswith("refine.backend=")]
    if chosen:
        return chosen[-1] != "refine.backend=none"
    if is_url(job.scene):
        return False
    try:
        file = scene_file(job.scene)
        opened = _opened(file, file_stamp(file), job.options.allow_outside)
        return opened.scene(job.options.overrides, job.options.variant).refine.backend != "none"
    except InputError:  # reported where it is rendered
        return False


@lru_cache(maxsize=1)
def _opened(path: Path, stamp: Stamp, allow_outside: bool) -> Opened:
    """A scene file of many clips is read once, and again when its `stamp` changes."""
    from physgen.scene.load import Opened

    return Opened(path, allow_outside)
