"""Bytes of a scene file and new values for some of its keys -> its bytes with these values, and all else as it was."""

from __future__ import annotations

import codecs
import json
from collections.abc import Iterable
from typing import Any

import yaml
from yaml.events import ScalarEvent

from physgen.scene.node import Node


def rewritten(data: bytes, values: Iterable[tuple[Node, str]]) -> bytes:
    """`values`: scalars of the file, and the text that stands in their place.

    >>> from physgen.scene.document import read
    >>> from physgen.scene.node import Source, children
    >>> from pathlib import Path
    >>> text = "image: ../a.png  # the photo\\nphysgen: 1\\n"
    >>> node = children(read(text, Source("scene.yaml", Path())))["image"]
    >>> rewritten(text.encode(), [(node, "b.png")]).decode()
    'image: "b.png"  # the photo\\nphysgen: 1\\n'
    """
    anew = {(node.line, node.column): text for node, text in values}
    if not anew:
        return data
    mark = codecs.BOM_UTF8 if data.startswith(codecs.BOM_UTF8) else b""
    text = data[len(mark) :].decode("utf-8")
    loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    spans = []
    for event in yaml.parse(text, Loader=loader):
        start, end = event.start_mark, event.end_mark
        if isinstance(event, ScalarEvent) and start is not None and end is not None:
            place = start.line + 1, start.column + 1
            if place in anew:
                spans.append((start.index, end.index, anew[place]))
    for begin, stop, value in reversed(spans):
        if text[begin] in "|>":  # a block ends with the line
            stop = begin + len(text[begin:stop].rstrip())
        text = text[:begin] + json.dumps(value, ensure_ascii=False) + text[stop:]
    return mark + text.encode("utf-8")
