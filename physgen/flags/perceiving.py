"""Flags of `perceive`, and of who perceives."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.flags.values import nouns, side


def add_perceive(sub: argparse.ArgumentParser) -> None:
    """Those of the command."""
    sub.add_argument(
        "image", metavar="IMAGE", type=Path, nargs="*", help="the photo; several go into the folder -o"
    )
    sub.add_argument(
        "--refresh",
        metavar="SCENE",
        type=Path,
        help="perceive a scene's photo again: what the scene says stays, boxes and points that it holds are asked "
        "again, new --box and --point correct or add objects",
    )
    sub.add_argument(
        "--allow-outside",
        action="store_true",
        help="with --refresh: the scene may read files outside its folder",
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="SCENE",
        type=Path,
        help="write the scene here (assets beside it); default: stdout",
    )
    sub.add_argument(
        "--masks",
        metavar="FILE",
        type=Path,
        help="label map of the photo's size: an id or colour an object, 0 or black for none",
    )
    sub.add_argument("--coco", metavar="FILE", type=Path, help="COCO annotations that hold the photo's masks")
    sub.add_argument(
        "--box",
        metavar="X,Y,W,H",
        action="append",
        default=[],
        help="an object lies in this box; may be repeated",
    )
    sub.add_argument(
        "--point",
        metavar="X,Y",
        action="append",
        default=[],
        help="an object lies at this point; may be repeated",
    )
    sub.add_argument(
        "--label", metavar="NAME=TEXT", action="append", default=[], help="what an object is; may be repeated"
    )
    sub.add_argument(
        "--side",
        metavar="PX",
        type=side,
        help="longest side of the scene's photo, px; default: at most 1600",
    )
    sub.add_argument("--assets", metavar="DIR", type=Path, help="folder for the maps")
    sub.add_argument(
        "--sheet",
        metavar="FILE.png",
        type=Path,
        help="draw all that was perceived on one picture, to look at",
    )
    sub.add_argument(
        "--find",
        metavar="NOUN,...",
        type=nouns,
        default=[],
        help='what to look for, for backends that find what they are told to: "ball, wooden block"',
    )
    add_backends(sub)
    sub.add_argument(
        "--keep-models",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="keep models in memory after their step; without it, only where there are several photos",
    )


def add_backends(sub: argparse.ArgumentParser) -> None:
    """Flags that say who perceives, and where."""
    sub.add_argument(
        "--backend",
        metavar="ROLE=NAME[:WEIGHTS]",
        action="append",
        default=[],
        help="who does a step, and the hub id or path of what it loads; see physgen backends",
    )
    sub.add_argument(
        "--profile", metavar="NAME", help="a set of backends: offline, models, best, or one of physgen.toml"
    )
    sub.add_argument("--config", metavar="FILE", type=Path, help="read this in place of physgen.toml")
    sub.add_argument("--device", metavar="DEVICE", help="where models run: auto, cpu, cuda, cuda:1 or mps")
    sub.add_argument("--dtype", metavar="TYPE", help="their numbers: auto, float32, float16 or bfloat16")
    sub.add_argument(
        "--fallback",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="where a backend fails, let the offline one take over, and say so",
    )
