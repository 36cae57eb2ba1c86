"""Make clips on a Dask cluster: open the cluster, hand out jobs, collect results in order."""

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
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol
from uuid import uuid4

from physgen.batch.cluster_worker import Answer, Errand, here, other, run_errands, same, with_names
from physgen.batch.remote import is_private, is_url, open_folder
from physgen.batch.remote_scene import fetched_pack, naming, packed_for
from physgen.batch.resume import finished
from physgen.batch.resume import warnings as warned
from physgen.batch.run import (
    Done,
    Job,
    State,
    as_known,
    failed,
    finished_there,
    hash_of,
    is_refined,
    local_copy,
    own_folder,
    send,
    unchanged_there,
    with_outcomes,
)
from physgen.batch.workers import AHEAD, LostError
from physgen.files import file_stamp, partial
from physgen.pipeline.packs import pack_key, scene_file
from physgen.problems import InputError
from physgen.report.folders import atomic_folder, output_folder

if TYPE_CHECKING:
    from distributed import Client, Future

    from physgen.scene.load import Opened


# ----------------------------------------------------------------------
# `--cluster` -> a client of a Dask cluster: one of this process's own, that of a scheduler, or Slurm's
# machines.

TIMEOUT = 10.0
"""s in which a scheduler must answer."""
PATIENCE, HURRY = 10.0, 1.0
"""s in which a client or a cluster of our own must close, and the same where somebody waits to be let go."""
INSTALL = "pip install 'physgen[cluster]'"
QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.limit": "1h",
    "distributed.comm.timeouts.connect": f"{TIMEOUT:g}s",
}
"""Of Dask's settings, while we use it: what it would look at, or tell of, is of no use here."""
OWN = {"distributed.scheduler.allowed-failures": 1}
"""Of a scheduler of our own: the third worker that a job may take along is one that has nothing else to do."""


class Closes(Protocol):
    """What has to be closed."""

    def close(self, timeout: float) -> object:
        """Within so many seconds, or raise."""


@contextmanager
def hired(where: str, workers: int) -> Iterator[Client]:
    """A client, closed when the block ends, with what we started; `where` is as `flags.clusters.cluster` allows it.

    Raises InputError where Dask is not installed, no scheduler answers, or Slurm cannot be asked.
    """
    try:
        import dask
        import distributed  # noqa: F401
    except ImportError:
        raise InputError.of(
            "--cluster", f'"{where}"', "needs Dask, which is not installed", INSTALL
        ) from None
    kind, _, address = where.partition("=")
    address = os.path.expanduser(address)
    with _quiet(), dask.config.set(QUIET):
        if address:
            with _client(address) as client:
                yield client
            return

        ours = slurm(workers) if "slurm" in kind else _local(workers)
        with dask.config.set(OWN), ours as cluster, _client(cluster) as client:
            yield client


@contextmanager
def closed(what: Closes) -> Iterator[Any]:
    """A client or a cluster, until the block ends."""
    patience = PATIENCE
    try:
        yield what
    except BaseException:
        patience = HURRY
        raise
    finally:
        with suppress(Exception):
            what.close(timeout=patience)


@contextmanager
def _quiet() -> Iterator[None]:
    """Dask logs what we tell in our own words, and much that nobody asked for; some of asyncio's comes at the end."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado", "asyncio", "dask_jobqueue")]
    loggers += [
        logging.getLogger(name)
        for name in list(logging.root.manager.loggerDict)
        if name.startswith(("distributed.", "tornado.", "dask_jobqueue."))
    ]
    before = [(logger, logger.level) for logger in loggers if logger.name != "asyncio"]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            for logger, level in before:
                logger.setLevel(level)


@contextmanager
def _client(cluster: Any) -> Iterator[Client]:
    """Of a cluster of ours, or of a scheduler's address or file, which is left alone when the block ends."""
    from distributed import Client

    try:
        if isinstance(cluster, str) and cluster.endswith(".json"):
            if not os.path.exists(cluster):
                fix = "start it: dask scheduler --scheduler-file FILE.json"
                raise InputError.of("--cluster", f'"{cluster}"', "is no scheduler file", fix)
            client = Client(scheduler_file=cluster, timeout=TIMEOUT, set_as_default=False)
        else:
            client = Client(cluster, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:  # a time-out is an OSError
        fix = "see that it runs, and that this machine may reach it; dask scheduler starts one"
        found = str(error).split("\n")[0]
        expected = f"is no scheduler that answers within {TIMEOUT:g} s"
        raise InputError.of("--cluster", f'"{cluster}"', f"{expected} ({found})", fix) from None
    with closed(client):
        yield client


@contextmanager
def _local(workers: int) -> Iterator[Any]:
    """As many workers in this process, each of which has its clips made by a process of its own."""
    from distributed import LocalCluster

    from physgen.batch.cluster_worker import end_all

    ours = LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=False,
        dashboard_address=None,
        memory_limit=0,
        silence_logs=logging.CRITICAL + 1,
    )
    try:
        with closed(ours) as cluster:
            yield cluster
    finally:
        end_all()


# ----------------------------------------------------------------------
# What the user's machine does for clips that workers make: which folders they share, what is sent, what comes
# back.


class Home:
    """What is sent, and what is not: folders are used as if they were shared until a worker says that it misses one."""

    def __init__(self, ship: bool) -> None:
        self._ship = ship
        self._scenes = self._clips = ship
        self._tokens: dict[str, Path] = {}

    def missed(self, scene: bool, folder: bool) -> None:
        """A worker does not see what others may see: from now on it is sent."""
        self._scenes |= scene
        self._clips |= folder

    def sends(self, job: Job) -> bool:
        """Whether its scene is sent to the worker."""
        if is_url(job.path):
            return self._ship or is_private(job.path)
        return self._scenes

    def _returns(self, job: Job) -> bool:
        """Whether the clip is sent back."""
        if is_url(job.out):
            return self._ship or is_private(job.out)
        return self._clips

    def errand(self, job: Job) -> Errand:
        """What a worker is told. Raises InputError or OSError where the folder of results cannot be used."""
        sends, back = self.sends(job), self._returns(job)
        known = with_names(job) if sends or back else replace(job, refiner=job.refiner.settled())
        scene = None if sends or is_url(job.path) else file_stamp(Path(job.path))
        token = None if back or is_url(job.out) else self._token(job.out)
        return Errand(known, os.getcwd(), scene, token, back)

    def _token(self, out: str) -> str:
        """The name of a file in the folder, by which a worker knows that it sees the same."""
        if out not in self._tokens:
            folder = Path(out)
            folder.mkdir(parents=True, exist_ok=True)
            self._tokens[out] = partial(folder / secrets.token_hex(8))
        self._tokens[out].touch()  # an old one is taken for a leftover, and a run may take days
        return self._tokens[out].name

    def close(self) -> None:
        """Nobody asks any more."""
        for token in self._tokens.values():
            with suppress(OSError):
                token.unlink()

    def early(self, job: Job) -> Done | None:
        """How a job ends without any worker: the clip is there, or its folder is somebody else's."""
        if not self._returns(job):
            return None
        try:
            if not is_url(job.out):
                output_folder(Path(job.out), job.called)
            if not job.cached:
                return None
            scene = local_copy(job.path, job.overrides, job.variant)
            if is_url(job.out):
                there = open_folder(job.out).below(job.called)
                told = finished_there(there, job.mark, scene)
                return None if told is None else unchanged_there(job, there, told)
            told = finished(job.folder, job.mark, scene_file(scene), hash_of)
            if told is None:
                return None
            done = Done(job, job.folder, tuple(warned(told)), State.UNCHANGED)
            return with_outcomes(done, job.folder / "trajectory.npz")
        except (InputError, OSError) as error:
            return failed(job, error)


def pack_for(job: Job) -> bytes:
    """Its scene. Raises InputError with what is wrong with it, or OSError."""
    if is_url(job.path):
        return fetched_pack(job.path, job.overrides, job.variant)
    return packed_for(job.scene, job.overrides, job.variant, job.allow_outside)


def brought(job: Job, done: Done, files: Mapping[str, bytes] | None) -> Done:
    """What became of a job, told of the user's own, with the clip where it belongs, whole or not at all."""
    told = as_known(done, job)
    if files is None:
        return told
    try:
        if is_url(job.out):
            there = open_folder(job.out).below(job.called)
            if told.folder is not None or not is_refined(there):
                with own_folder() as folder:
                    _write(files, folder)
                    send(folder, there)
        elif told.folder is not None or not _is_refined(job.folder):
            with atomic_folder(job.folder) as folder:
                _write(files, folder)
    except (InputError, OSError) as error:
        return failed(job, error, seconds=done.seconds)
    return told


def _write(files: Mapping[str, bytes], folder: Path) -> None:
    for name, data in files.items():
        path = Path(os.path.normpath(folder / name))
        if not path.is_relative_to(folder):
            raise InputError.of(name, "", "leads out of the clip's folder", "see what the workers run")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def _is_refined(folder: Path) -> bool:
    """As `far.is_refined`, of a folder of this machine."""
    try:
        told = json.loads((folder / "manifest.json").read_bytes())
        return bool(told["refine"] and told["frames"])
    except (OSError, ValueError, KeyError, TypeError):
        return False


@contextmanager
def at_home(ship: bool) -> Iterator[Home]:
    """For the jobs of one command."""
    home = Home(ship)
    try:
        yield home
    finally:
        home.close()


# ----------------------------------------------------------------------
# Jobs and a cluster -> how each ended, in the order of the jobs; as `pool.run_all`, with workers elsewhere.
#
# A few jobs more are handed out than workers can begin, and no job much further ahead than the oldest
# unfinished one: the
# memory that this takes does not grow with their number.

Tell = Callable[[str], None]

TRIES = 3
"""Times that the cluster may lose a job, as a scheduler does that somebody restarts."""
SPARE = 8
"""Jobs handed out beyond two a thread: a cluster may grow, and does where something waits for it."""
FEW = 64
"""Threads that get their jobs one by one."""
LOOK = 2.0
"""s between looks at who works."""
NO_WORKER_NOTICE = 10.0
"""s without any worker after which it is told."""
NAP = 0.005
"""s between looks for answers."""
MOST_PACKS = 8
"""Scenes that are kept at hand on the cluster."""


def run_on_cluster(
    where: str,
    workers: int,
    jobs: Iterable[Job],
    count: int = 1,
    ship: bool = False,
    tell: Tell = lambda text: None,
) -> Generator[Done, None, None]:
    """Results in the order of the `count` jobs, of the cluster that `where` names.

    `tell` is told what there is to wait for. Raises InputError where there is no such cluster or a worker would make
    other clips, OSError where the scheduler is lost. Whoever stops early must close the generator.
    """
    with hired(where, workers) as client, at_home(ship) as home:
        yield from _Farm(client, home, where, count, tell).results(iter(jobs))


@dataclass(eq=False)
class _Task:
    """A job that is under way."""

    number: int
    job: Job
    lost: int = 0
    """How often the cluster forgot it, or lost it in company."""
    alone: bool = False
    """Whether workers died on it, or on one beside it: which of the two is found out without company."""


_Needs = tuple[object, bool]
"""Of jobs that may be handed out together: the scene that is sent, if any, and a GPU."""


@dataclass(eq=False)
class _Farm:
    client: Client
    home: Home
    where: str
    total: int
    tell: Tell
    threads: int = 0
    gpus: bool = False
    """Whether any worker says that it has one."""
    _count: int = 0
    """Jobs begun."""
    _under_way: dict[Future, list[_Task]] = field(default_factory=dict)
    _done: dict[int, Done] = field(default_factory=dict)
    _suspects: list[_Task] = field(default_factory=list)
    _packs: OrderedDict[object, tuple[str, Future]] = field(default_factory=OrderedDict)
    _looked: float = 0.0
    _waiting: float | None = field(default_factory=time.monotonic)
    """Since when there has been no worker; None once that was told."""
    _run: str = field(default_factory=lambda: uuid4().hex)
    _submitted: int = 0

    def results(self, jobs: Iterator[Job]) -> Iterator[Done]:
        from distributed import as_completed

        answers = as_completed(loop=self.client.loop, with_results=True, raise_errors=False)
        due = 0
        more = True
        try:
            while True:
                self._look()
                if self._suspects and not self._under_way:
                    self._begin([self._suspects.pop(0)], answers)
                while more and self._has_room and self._count < due + AHEAD * max(self.threads, 1):
                    taken = list(islice(jobs, self._together))
                    more = bool(taken)
                    self._begin([_Task(self._count + k, job) for k, job in enumerate(taken)], answers)
                    self._count += len(taken)
                if due in self._done:
                    yield self._done.pop(due)
                    due += 1
                    continue
                if not more and due == self._count:
                    return
                for future, result in answers.next_batch(block=False) or self._nap():
                    self._take(self._under_way.pop(future), future, result, answers)
        finally:
            if self.client.status == "running":  # else nobody is there to be told, nor to be waited for
                with suppress(OSError):
                    self.client.cancel(list(self._under_way), force=True)

    @property
    def _has_room(self) -> bool:
        """Whether the cluster is to get more to do."""
        if self._suspects or any(task.alone for tasks in self._under_way.values() for task in tasks):
            return False
        return len(self._under_way) < 2 * self.threads + SPARE

    @property
    def _together(self) -> int:
        """Jobs handed out in one piece: more where many workers would ask more often than can be answered."""
        threads = max(self.threads, 1)
        return max(1, min(threads // FEW, (self.total - self._count) // (4 * threads)))

    def _nap(self) -> tuple[()]:
        time.sleep(NAP)
        return ()

    def _look(self) -> None:
        """How many work now; and whether there still is a scheduler."""
        now = time.monotonic()
        if now < self._looked + LOOK:
            return
        self._looked = now
        if self.client.status != "running":
            raise ConnectionError(
                f"{self.where}: the scheduler is gone; once it is back, run the same command again"
            )
        try:
            told = self.client.scheduler_info(n_workers=-1)
        except TypeError:  # before 2025
            told = self.client.scheduler_info()
        workers = told["workers"].values()
        self.threads = sum(worker["nthreads"] for worker in workers)
        self.gpus = any(worker.get("resources", {}).get("GPU") for worker in workers)
        if self.threads:
            self._waiting = None
        elif self._waiting is not None and now > self._waiting + NO_WORKER_NOTICE:
            self.tell(f"{self.where}: has no workers yet; waiting for them")
            self._waiting = None

    def _begin(self, tasks: Sequence[_Task], answers: Any) -> None:
        """Hand them to the cluster, but for those that end here."""
        groups: dict[_Needs, list[tuple[_Task, bytes]]] = {}
        for task in tasks:
            job = task.job
            early = self.home.early(job)
            if early is None:
                try:
                    scene = self._sent(job) if self.home.sends(job) else None
                    errand = pickle.dumps(self.home.errand(job))
                    needs = scene, self.gpus and wants_gpu(job)
                    groups.setdefault(needs, []).append((task, errand))
                except (InputError, OSError) as error:
                    early = failed(job, error)
            if early is not None:
                self._done[task.number] = early
        for (scene, gpu), group in groups.items():
            key, pack = self._packs[scene] if scene is not None else ("", None)
            self._submitted += 1
            future = self.client.submit(
                run_errands,
                here(),
                [errand for _, errand in group],
                pack,
                key,
                "gpu" if gpu else "",
                key=(f"physgen-clips-{self._run}", self._submitted),
                pure=False,
                resources={"GPU": 1} if gpu else None,
            )
            self._under_way[future] = [task for task, _ in group]
            answers.add(future)

    def _sent(self, job: Job) -> object:
        """The scene's, among those on the cluster, where it is now. Raises InputError or OSError."""
        scene = job.path, naming(job.overrides), job.allow_outside
        if scene not in self._packs:
            data = pack_for(job)
            key = pack_key(data)
            pack = self.client.submit(same, data, key=(f"physgen-scenes-{self._run}", key), pure=False)
            self._packs[scene] = key, pack
            while len(self._packs) > MOST_PACKS:
                self._packs.popitem(last=False)
        self._packs.move_to_end(scene)
        return scene

    def _take(self, tasks: list[_Task], future: Future, result: Any, answers: Any) -> None:
        """What came of jobs: an answer each, or none."""
        from distributed import KilledWorker

        if future.status == "finished" and isinstance(result, list) and len(result) == len(tasks):
            for task, answer in zip(tasks, result, strict=True):
                self._answered(task, answer, future, answers)
            return
        error = result[1] if isinstance(result, tuple) else result
        if isinstance(error, (ModuleNotFoundError, AttributeError)) and "physgen" in str(error):
            expected = f"has no physgen, or another one ({error})"
            raise InputError.of("--cluster", self.where, expected, "install the same on workers as here")
        if not isinstance(error, KilledWorker) and future.status == "error":
            raise error
        for task in tasks:
            task.lost += 1
            if task.alone or task.lost > TRIES:
                self._done[task.number] = failed(task.job, LostError("its workers died each time"))
            elif isinstance(error, KilledWorker) and len(tasks) == 1:
                task.alone = True
                self._suspects.append(task)
            else:
                self._begin([task], answers)

    def _answered(self, task: _Task, said: bytes | LostError, future: Future, answers: Any) -> None:
        """What a worker says of a job."""
        if isinstance(said, LostError):
            self._done[task.number] = failed(task.job, said)
            return
        answer: Answer = pickle.loads(said)
        if answer.versions is not None:
            raise other(self._worker(future), answer.versions)
        if answer.done is None:
            self.home.missed(answer.scene_unseen, answer.folder_unseen)
            self._begin([task], answers)
        else:
            self._done[task.number] = brought(task.job, answer.done, answer.files)

    def _worker(self, future: Future) -> str:
        """Its address."""
        found = self.client.who_has([future]).values()
        return next((str(address) for addresses in found for address in addresses), "of the cluster")


def wants_gpu(job: Job) -> bool:
    """Whether a clip is drawn on a GPU, or refined."""
    if job.device != "cpu":
        return True
    said = [text for text in job.overrides if text.startswith("refine.backend=")]
    if said:
        return said[-1] != "refine.backend=none"
    return not is_url(job.path) and _refines(job)


def _refines(job: Job) -> bool:
    """Whether its scene says so; one that cannot be read is told of where it is rendered."""
    try:
        opened = _opened(str(job.scene), job.allow_outside)
        if opened.stale():
            _opened.cache_clear()
            opened = _opened(str(job.scene), job.allow_outside)
        scene = opened.scene(job.overrides, job.variant)
        return scene.refine.backend != "none"
    except InputError:
        return False


@lru_cache(maxsize=1)
def _opened(path: str, allow_outside: bool) -> Opened:
    """A file of which many clips are made is read once."""
    from physgen.scene.load import Opened

    return Opened(path, allow_outside)


# ----------------------------------------------------------------------
# Workers as jobs of Slurm, by dask-jobqueue -> a cluster that a client may be made of.


@contextmanager
def slurm(workers: int) -> Iterator[Any]:
    """As many workers in jobs of Slurm; what kind of jobs is for Dask's own settings to say."""
    from distributed.core import Status

    if shutil.which("sbatch") is None:
        fix = "run this on a machine of the cluster, or name a scheduler: --cluster dask=tcp://HOST:8786"
        raise InputError.of("--cluster", '"slurm"', "needs Slurm, and there is no sbatch on the PATH", fix)
    try:
        cluster = slurm_cluster()
    except ImportError:
        expected = "needs dask-jobqueue, which is not installed"
        raise InputError.of("--cluster", '"slurm"', expected, INSTALL) from None
    except (OSError, RuntimeError, TypeError, ValueError) as error:
        raise _refused(error) from None

    async def ask() -> None:
        cluster.scale(workers)
        await cluster._correct_state()  # by itself it would tell nobody that Slurm said no

    with closed(cluster):
        try:
            cluster.sync(ask)
        except (OSError, RuntimeError, ValueError) as error:
            for job in cluster.workers.values():  # closing the cluster waits for those that seem to begin
                job.status = Status.failed if job.status is Status.created else job.status
            raise _refused(error) from None
        yield cluster


@contextmanager
def _signals_kept() -> Iterator[None]:
    """dask-jobqueue, once imported, would have Ctrl-C end the program without a word, as if all were well."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    with suppress(ValueError):  # not the main thread: then it could not set any, either
        for number, handler in before.items():
            signal.signal(number, handler)


def _refused(error: Exception) -> InputError:
    said = " ".join(str(error).rpartition("stderr:")[2].split())
    fix = "see jobqueue.slurm in Dask's settings, e.g. ~/.config/dask/jobqueue.yaml"
    return InputError.of("--cluster", '"slurm"', f"gives no workers ({said})", fix)


def slurm_cluster() -> Any:
    """As `jobqueue.slurm` of Dask's settings says; jobs of one worker, of one core and 4 GB, where it does not."""
    import dask

    with _signals_kept():
        from dask_jobqueue import SLURMCluster

    otherwise = {"cores": 1, "processes": 1, "memory": "4GB"}
    settings = {k: v for k, v in otherwise.items() if dask.config.get(f"jobqueue.slurm.{k}", None) is None}
    return SLURMCluster(scheduler_options={"dashboard": False}, silence_logs=logging.CRITICAL + 1, **settings)
