"""Flags of `sweep`."""

from __future__ import annotations

import argparse

from physgen.flags.values import names, number_of_clips, place, seed


def add_sweep(sub: argparse.ArgumentParser) -> None:
    """What varies, and how draws are made."""
    sub.add_argument("scene", metavar="SCENE", type=place, help="a file, a pack, or a URL")
    sub.add_argument(
        "axes",
        metavar="KEY=VALUES",
        nargs="*",
        help="start:end:count (count:log for even factors), values in YAML between commas, or a distribution: "
        "~uniform(a, b), ~loguniform(a, b), ~normal(mean, sd) or ~normal(mean, sd, low, high), ~integers(a, b), "
        "~choice(a, b, ...), in quotes; ~each uniform(a, b) draws for each thing that * means. Values of several keys "
        "make a grid",
    )
    sub.add_argument(
        "--samples",
        metavar="N",
        type=number_of_clips,
        help="draws of the distributions, at each point of the grid",
    )
    sub.add_argument("--seed", metavar="S", type=seed, help="of the draws; default: 0")
    sub.add_argument(
        "--latin",
        action="store_true",
        help="a Latin hypercube: the N draws of each key fall into N strata as likely as each other, one each",
    )
    sub.add_argument(
        "--dry-run",
        action="store_true",
        help="print what would be made, as CSV or with --json as lines, and make nothing",
    )
    sub.add_argument(
        "--track",
        metavar="NAMES",
        type=names,
        help="objects with outcomes of their own in the table; default: all, where there are 32 at most",
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=place,
        help="folder of the sweep, or its URL; default: out/<scene>-sweep",
    )
