"""`pack` and `unpack`: a scene with all its files as one file."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.output import OK, print_backup, print_problem
from physgen.files import back_up, write_atomic
from physgen.problems import InputError

# ----------------------------------------------------------------------
# `pack` and `unpack`: a scene with all that it reads, as one file.


def pack(options: argparse.Namespace) -> int:
    from physgen.pipeline import output_name
    from physgen.scene.pack import pack_scene
    from physgen.scene.pack_format import SUFFIX, is_ours

    output = options.output
    if output is not None and (output.suffix != SUFFIX or output.is_dir()):
        raise InputError.of("-o", f'"{output}"', "is no name for a pack", f"end it in {SUFFIX}")
    data = pack_scene(options.scene, (), options.allow_outside, print_problem)
    if output is None:
        output = Path(f"{output_name(options.scene, None)}{SUFFIX}")
    output.parent.mkdir(parents=True, exist_ok=True)
    if not is_ours(output):
        back_up(output, print_backup)
    write_atomic(output, data)
    print(output)
    return OK


def unpack(options: argparse.Namespace) -> int:
    from physgen.scene.pack_format import SUFFIX
    from physgen.scene.unpack import read_pack, unpack_to, with_schema

    path = options.pack
    folder = options.output
    if folder is None and path.suffix != SUFFIX:
        raise InputError.of(str(path), "", f"does not end in {SUFFIX}", "name a folder for its files with -o")
    folder = Path(path.stem) if folder is None else folder
    scene = unpack_to(read_pack(path), folder, str(path))
    with_schema(folder)
    print(scene)
    return OK


# ----------------------------------------------------------------------
# Flags of `pack` and `unpack`.


def add_pack(sub: argparse.ArgumentParser) -> None:
    """A scene, and the file that it goes to."""
    sub.add_argument("scene", metavar="SCENE")
    sub.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        type=Path,
        help="write the pack here, ending in .physgen; default: NAME.physgen in this folder",
    )
    sub.add_argument(
        "--allow-outside",
        action="store_true",
        help="let the scene read files outside its folder; they come along, and the pack does not need this",
    )


def add_unpack(sub: argparse.ArgumentParser) -> None:
    """A pack, and the folder that its files go to."""
    sub.add_argument("pack", metavar="FILE", type=Path, help="what physgen pack wrote")
    sub.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="write the files here, a new or empty folder; default: the pack's name without .physgen",
    )
