"""Flags of `evaluate properties`."""

from __future__ import annotations

import argparse
from pathlib import Path

ABOUT = "Masses, and orders of friction and elasticity, against what others measured."
EXAMPLE = "properties -o out/properties"


def add(parser: argparse.ArgumentParser) -> None:
    """Which objects, and who answers."""
    parser.add_argument(
        "table",
        metavar="TABLE",
        nargs="?",
        type=Path,
        help="objects with what is true of them, YAML or CSV; default: 42 of the YCB set, and published comparisons",
    )
    parser.add_argument(
        "--backend", metavar="ROLE=NAME", action="append", default=[], help="who answers: physics=NAME"
    )
    parser.add_argument("--config", metavar="FILE", type=Path, help="instead of every physgen.toml")
    parser.add_argument(
        "--answers",
        metavar="FILE",
        type=Path,
        help="score these answers, JSON or CSV of name, mass, friction, elasticity; nobody is asked",
    )
    parser.add_argument(
        "--save-answers", metavar="FILE", type=Path, help="write what is answered, as --answers takes it"
    )
    parser.add_argument(
        "--hide-size", action="store_true", help="tell the name of each object alone, not its size"
    )
    parser.add_argument(
        "--truth",
        metavar="DIR",
        type=Path,
        help="photos with true physics; default: studio/truth where it is there and no TABLE is given",
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, help="write a page with plots in this folder"
    )
