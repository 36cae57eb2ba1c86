"""`cache`: shows and clears the results that are kept between runs."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from physgen.cli.arguments import Command, Parser
from physgen.cli.output import OK, print_json

if TYPE_CHECKING:
    from physgen.pipeline.cache import Store


UNITS = ("bytes", "kB", "MB", "GB", "TB")


def cache(options: argparse.Namespace) -> int:
    from physgen.pipeline.cache import open_store

    return {"show": _show, "clear": _clear}[options.what](open_store(), options.json)


def _show(store: Store, as_json: bool) -> int:
    entries = store.sizes()
    total = sum(entry.bytes for entry in entries)
    if as_json:
        named = [
            {"key": entry.key, "stage": entry.stage, "bytes": entry.bytes, "used": _moment(entry.used)}
            for entry in entries
        ]
        head = {
            "path": str(store.root),
            "count": len(entries),
            "bytes": total,
            "most_bytes": store.most_bytes,
        }
        print_json({**head, "entries": named})
        return OK
    print(store.root)
    for stage in sorted({entry.stage for entry in entries}):
        of = [entry.bytes for entry in entries if entry.stage == stage]
        print(f"{stage:<10}{_counted(len(of))}, {_size(sum(of))}")
    print(f"{'all':<10}{_counted(len(entries))}, {_size(total)} of {_size(store.most_bytes)}")
    return OK


def _clear(store: Store, as_json: bool) -> int:
    freed = store.clear()
    if as_json:
        print_json(
            {"path": str(store.root), "removed": freed.entries, "freed_bytes": freed.bytes, "in_use": 0}
        )
        return OK
    print(f"{store.root}: {_counted(freed.entries)} removed, {_size(freed.bytes)} freed")
    return OK


def _counted(count: int) -> str:
    return f"{count} {'entry' if count == 1 else 'entries'}"


def _size(count: float) -> str:
    """To three digits."""
    power = 0
    while count >= 999.5 and power < len(UNITS) - 1:
        count, power = count / 1000, power + 1
    return f"{count:.3g} {UNITS[power]}"


def _moment(seconds: float) -> str:
    """Local time."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))


def add(parser: Parser) -> None:
    about = "show: folder, size and limit; clear: remove all results"
    parser.add_argument("what", choices=("show", "clear"), metavar="{show,clear}", help=about)
    parser.flag("--json", "print as JSON")


CACHE = Command("cache", "Shows or clears the cache.", "physgen cache show", add, cache)
