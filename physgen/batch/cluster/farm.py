"""Jobs and a cluster -> how each ended, in the order of the jobs; as `pool.run_all`, with workers elsewhere.

A few jobs more are handed out than workers can begin, and no job much further ahead than the oldest unfinished one: the
memory that this takes does not grow with their number.
"""

from __future__ import annotations

import pickle
import time
from collections import OrderedDict
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from physgen.batch.cluster.errands import Answer
from physgen.batch.cluster.hands import run_errands, same
from physgen.batch.cluster.hired import hired
from physgen.batch.cluster.home import Home, at_home, brought, pack_for
from physgen.batch.cluster.versions import here, other
from physgen.batch.fetched import naming
from physgen.batch.pool import Done, Job, failed
from physgen.batch.workers import AHEAD, LostError
from physgen.pipeline.packs import pack_key
from physgen.problems import InputError
from physgen.urls import is_url

if TYPE_CHECKING:
    from distributed import Client, Future

    from physgen.scene.build import Opened

Tell = Callable[[str], None]

TRIES = 3
"""Times that the cluster may lose a job, as a scheduler does that somebody restarts."""
SPARE = 8
"""Jobs handed out beyond two a thread: a cluster may grow, and does where something waits for it."""
FEW = 64
"""Threads that get their jobs one by one."""
LOOK = 2.0
"""s between looks at who works."""
PATIENCE = 10.0
"""s without any worker after which it is told."""
NAP = 0.005
"""s between looks for answers."""
MOST_PACKS = 8
"""Scenes that are kept at hand on the cluster."""


def run_on(
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
        elif self._waiting is not None and now > self._waiting + PATIENCE:
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
    from physgen.scene.build import Opened

    return Opened(path, allow_outside)
