"""`pack` and `unpack`: a scene with all that it reads, as one file."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.printing import OK, tell_kept, tell_one
from physgen.problems import InputError
from physgen.whole import set_aside, write_whole


def pack(options: argparse.Namespace) -> int:
    from physgen.pipeline import output_name
    from physgen.scene.pack_format import SUFFIX, is_ours
    from physgen.scene.packed import packed

    output = options.output
    if output is not None and (output.suffix != SUFFIX or output.is_dir()):
        raise InputError.of("-o", f'"{output}"', "is no name for a pack", f"end it in {SUFFIX}")
    data = packed(options.scene, (), options.allow_outside, tell_one)
    if output is None:
        output = Path(f"{output_name(options.scene, None)}{SUFFIX}")
    output.parent.mkdir(parents=True, exist_ok=True)
    if not is_ours(output):
        set_aside(output, tell_kept)
    write_whole(output, data)
    print(output)
    return OK


def unpack(options: argparse.Namespace) -> int:
    from physgen.scene.editors import with_schema
    from physgen.scene.pack_format import SUFFIX
    from physgen.scene.unpacked import read_pack, unpacked

    path = options.pack
    folder = options.output
    if folder is None and path.suffix != SUFFIX:
        raise InputError.of(str(path), "", f"does not end in {SUFFIX}", "name a folder for its files with -o")
    folder = Path(path.stem) if folder is None else folder
    scene = unpacked(read_pack(path), folder, str(path))
    with_schema(folder)
    print(scene)
    return OK
