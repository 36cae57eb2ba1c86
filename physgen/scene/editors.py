"""Scene files whose first line names the schema that editors go by -> that schema beside them, where the line leads.

A pack holds what a scene means, and no schema; its scene files say where one was on the machine that packed it.
"""

from __future__ import annotations

import re
from pathlib import Path

from physgen.resources import resource
from physgen.scene.pack_format import SCENES
from physgen.whole import write_whole

SCHEMA = "scene-1.schema.json"
_LINE = re.compile(rb"\A(\xef\xbb\xbf)?(# yaml-language-server: \$schema=)([^\s:]+)([ \t]*\r?\n)")


def with_schema(folder: Path) -> None:
    """For every scene file below it whose line leads to no file: the schema where it says, or else beside the scene.

    Lines that name a URL are left alone, and so is what lies outside the folder. Raises OSError.
    """
    home = folder.resolve()
    for path in sorted(p for p in folder.rglob("*") if p.suffix in SCENES and p.is_file()):
        data = path.read_bytes()
        line = _LINE.match(data)
        if line is None:
            continue
        named = line[3].decode("utf-8", "replace")
        schema = (path.parent / named).resolve()
        if schema.is_relative_to(home) and schema.is_file():
            continue
        if not (schema.is_relative_to(home) and schema.name == SCHEMA):
            schema = path.parent / SCHEMA
            write_whole(path, data[: line.start(3)] + SCHEMA.encode() + data[line.end(3) :])
        schema.parent.mkdir(parents=True, exist_ok=True)
        if not schema.exists():
            write_whole(schema, resource("schemas", SCHEMA).read_bytes())
