"""Flags of clusters, and the choice between a cluster and this machine."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from physgen import batch
from physgen.cli.arguments import Parser, wrong_value
from physgen.cli.output import print_error
from physgen.files import install
from physgen.messages import Message

if TYPE_CHECKING:
    from physgen.batch.dataset import DatasetSummary, Gathering

Item = TypeVar("Item")
Result = TypeVar("Result")

ADDRESS = re.compile(
    r"local(:[1-9]\d{0,3})?|\w+://.+|(?!local:)[\w.\-\[\]:]+:\d+|.+\.json"
)


def address(text: str) -> str:
    """Read the address of a scheduler, its file, or `local`."""
    if ADDRESS.fullmatch(text):
        return text
    raise wrong_value(text, Message.NOT_A_CLUSTER.refusal())


def add_cluster(parser: Parser) -> None:
    """Add the flag of a cluster."""
    help_text = "run on a Dask cluster: tcp://HOST:8786, a scheduler's FILE.json, or local[:N] for N processes here"
    parser.option("--cluster", "ADDRESS", address, help_text)


def add_ship(parser: Parser) -> None:
    """Add the flag of a store."""
    help_text = "with --cluster: scenes and results are in this store in place of a shared folder: s3://BUCKET/NAME"
    parser.option("--ship", "URL", str, help_text)


def check_cluster(options: argparse.Namespace) -> None:
    """Raise InputError if flags contradict each other."""
    ship = getattr(options, "ship", None)
    jobs = getattr(options, "jobs", 1)
    if ship == "":
        raise Message.STORE_EMPTY.error("--ship", '""')
    if options.cluster is None and ship is not None:
        raise Message.STORE_WITHOUT_CLUSTER.error("--ship", f'"{ship}"')
    if options.cluster is not None and jobs > 1:
        raise Message.JOBS_WITH_CLUSTER.error("--jobs", str(jobs))


def is_parallel(options: argparse.Namespace, count: int) -> bool:
    """Return whether other processes work on the `count` items of a command."""
    return getattr(options, "cluster", None) is not None or min(options.jobs, count) > 1


def run_all(
    options: argparse.Namespace,
    work: Callable[[Item], Result],
    items: Iterable[Item],
    count: int,
    lost_result: Callable[[Item, Exception], Result],
) -> Generator[Result, None, None]:
    """Yield `work(item)` for each of `count` items in order, by the cluster or by
    processes of this machine.
    """
    if getattr(options, "cluster", None) is None:
        jobs = min(getattr(options, "jobs", 1), count)
        return batch.workers.run_parallel(work, items, jobs, lost_result)
    with _dask_needed(options):
        cluster = batch.cluster
    ship = getattr(options, "ship", None)
    return cluster.run_on_cluster(
        options.cluster, work, items, lost_result, ship=ship, report=print_error
    )


def stored_clips(options: argparse.Namespace) -> list[Path]:
    """Return the folders of all clips below the command's folders in its store. Raise
    InputError.
    """
    shipping = _shipping(options)
    folders: list[Path] = shipping.stored_clips(
        shipping.Store(options.ship), options.folders
    )
    return folders


def gather_stored(options: argparse.Namespace, gathering: Gathering) -> DatasetSummary:
    """Make a data set of the clips of a store, inside the store. Raise InputError."""
    shipping = _shipping(options)
    store = shipping.Store(options.ship)
    summary: DatasetSummary = shipping.gather_stored(
        store, options.folders, options.output, gathering
    )
    return summary


def _shipping(options: argparse.Namespace) -> Any:
    """Return the module for stores. Raise InputError."""
    with _dask_needed(options):
        return batch.shipping


@contextmanager
def _dask_needed(options: argparse.Namespace) -> Iterator[None]:
    """Raise InputError if the import of Dask in the block fails."""
    try:
        yield
    except ImportError:
        place = f'"{options.cluster}"'
        raise Message.DASK_MISSING.error(
            "--cluster", place, install=install("cluster")
        ) from None
