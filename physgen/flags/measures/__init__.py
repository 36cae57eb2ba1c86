"""Flags of `physgen evaluate`."""

from __future__ import annotations

import argparse


def measures(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add one parser a measure."""
    from physgen.cli.evaluate import measures as add_measures

    add_measures(subparsers)
