"""`pack` and `unpack`: a scene with all its files as one file."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.arguments import Command, Parser
from physgen.cli.output import OK, print_backup
from physgen.files import back_up, write_atomic
from physgen.problems import InputError


def pack(options: argparse.Namespace) -> int:
    from physgen.pipeline import output_name
    from physgen.scene.pack import pack_scene
    from physgen.scene.unpack import SUFFIX, is_ours

    output = options.output
    if output is not None and (output.suffix != SUFFIX or output.is_dir()):
        raise InputError.of("-o", f'"{output}"', "is no name for a pack", f"end it in {SUFFIX}")
    data = pack_scene(options.scene)
    if output is None:
        output = Path(f"{output_name(options.scene, None)}{SUFFIX}")
    output.parent.mkdir(parents=True, exist_ok=True)
    if output.is_file() and not is_ours(output):
        back_up(output, print_backup)
    write_atomic(output, data)
    print(output)
    return OK


def unpack(options: argparse.Namespace) -> int:
    from physgen.scene.unpack import SUFFIX, read_pack, unpack_to

    path = options.pack
    folder = options.output
    if folder is None and path.suffix != SUFFIX:
        raise InputError.of(str(path), "", f"does not end in {SUFFIX}", "name a folder for its files with -o")
    folder = Path(path.stem) if folder is None else folder
    scene = unpack_to(read_pack(path), folder, str(path))
    print(scene)
    return OK


def add_pack(parser: Parser) -> None:
    parser.add_argument("scene", metavar="SCENE")
    about = "write the pack here, ending in .physgen; default: NAME.physgen in this folder"
    parser.option("-o --output", "FILE", Path, about)


def add_unpack(parser: Parser) -> None:
    parser.add_argument("pack", metavar="FILE", type=Path, help="a file that physgen pack wrote")
    about = "write the files to this new or empty folder; default: the pack's name without .physgen"
    parser.option("-o --output", "DIR", Path, about)


PACK = Command(
    "pack",
    "Packs a scene with all its files into one file.",
    "physgen pack scene.yaml -o scene.physgen",
    add_pack,
    pack,
)
UNPACK = Command(
    "unpack", "Unpacks a pack into a folder.", "physgen unpack scene.physgen -o scene", add_unpack, unpack
)
