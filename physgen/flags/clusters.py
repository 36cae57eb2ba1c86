"""Flags that say on which machines clips are made."""

from __future__ import annotations

import argparse

CLUSTERS = ("dask", "slurm", "dask-slurm")


def add_cluster(sub: argparse.ArgumentParser) -> None:
    """Those of every command that makes clips."""
    sub.add_argument(
        "--cluster",
        metavar="WHERE",
        type=cluster,
        help="make clips on a Dask cluster: dask, one on this machine with --jobs workers; dask=tcp://HOST:8786, that "
        "of a scheduler (or dask=FILE.json, a scheduler file); slurm, --jobs workers as jobs of Slurm; see "
        "docs/clusters.md",
    )
    sub.add_argument(
        "--ship",
        action="store_true",
        help="with --cluster: send scenes to workers and fetch clips from them without looking for shared folders",
    )


def cluster(text: str) -> str:
    """Any of CLUSTERS, or `dask=` and where its scheduler is."""
    kind, equals, where = text.partition("=")
    if text in CLUSTERS:
        return text
    if kind == "dask" and equals and (where.endswith(".json") or "://" in where.strip("/:")):
        return text
    expected = "is not dask, dask=tcp://HOST:PORT, dask=FILE.json or slurm"
    raise argparse.ArgumentTypeError(f"{text} {expected}")
