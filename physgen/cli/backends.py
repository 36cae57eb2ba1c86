"""Run `backends`: list the backends and their missing parts, and check the
usable ones.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from physgen import evaluate, registry
from physgen.cli.arguments import Command, Parser
from physgen.cli.output import FAILED, OK, print_error, print_json, print_line
from physgen.cli.perceive import add_backends, plan_of

if TYPE_CHECKING:
    from physgen.evaluate.backend_check import BackendCheck

NAME_WIDTH = 24
"""Width of the column of names, characters."""
SETTING_WIDTH = 28
"""Width of the column `ROLE=NAME`, characters."""
MEBIBYTE = 2**20


def listing_lines(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the lines of the list: a role, its backends, and below each its missing
    parts.
    """
    role = None
    for row in rows:
        if row["role"] != role:
            role = row["role"]
            yield role
        chosen_mark = " "
        if row["chosen"]:
            chosen_mark = "*"
        yield f"  {chosen_mark} {row['name']:<{NAME_WIDTH}} {row['about']}{terms(row)}"
        yield from (f"{'':{NAME_WIDTH + 5}}[{line}]" for line in row["missing"])


def terms(row: Mapping[str, Any]) -> str:
    """Return size and licence of each of a row's weights, e.g. ` (0.2 GB,
    Apache-2.0)`.
    """
    parts = [f"{weights['size']}, {weights['licence']}" for weights in row["weights"]]
    if parts:
        return f" ({'; '.join(parts)})"
    return ""


def list_backends(options: argparse.Namespace) -> int:
    if options.check is not None:
        return check_backends(options)
    rows = registry.listing(plan_of(options))
    if options.json:
        print_json({"backends": rows})
        return OK
    for line in listing_lines(rows):
        print(line)
    print(
        "\n* is used unless --backend, --profile or --config chooses another",
        file=sys.stderr,
    )
    return OK


def check_backends(options: argparse.Namespace) -> int:
    """Run the usable backends, or the named ones, on a small picture."""
    # Wrong choices are reported before slow models are loaded.
    pairs = evaluate.backend_check.read_choices(options.check)
    checks: list[BackendCheck] = []
    for check in evaluate.backend_check.check_backends(plan_of(options), pairs):
        checks.append(check)
        if not options.json:
            print_line(check_line(check))
    if options.json:
        print_line(json.dumps({"checks": [check.as_json() for check in checks]}))
    failures = [check for check in checks if check.fault]
    for check in failures:
        print_error(f"{check.setting} failed: {check.fault}")
    if failures:
        return FAILED
    return OK


def check_line(check: BackendCheck) -> str:
    """Return the row of a backend: its state, seconds and memory, or its
    missing parts.
    """
    start = f"{check.setting:<{SETTING_WIDTH}} {check.state:<8}"
    if check.missing:
        return f"{start} {'; '.join(check.missing)}"
    if check.load_seconds is None or check.memory_bytes is None:
        return start.rstrip()
    memory = check.memory_bytes / MEBIBYTE
    line = f"{start} load {check.load_seconds:7.2f} s   run {check.run_seconds:7.2f} s   {memory:7.0f} MiB"
    if check.gpu_bytes is not None:
        line += f"   GPU {check.gpu_bytes / MEBIBYTE:7.0f} MiB"
    return line


def add_list(parser: Parser) -> None:
    add_backends(parser)
    help_text = (
        "run each backend that is ready, or those named, on a small picture: seconds and memory; exit code 1 if one "
        "fails"
    )
    parser.add_argument("--check", metavar="ROLE=NAME", nargs="*", help=help_text)
    parser.flag("--json", "print as JSON")


BACKENDS = Command(
    "backends",
    "Lists the backends of each step, and what is missing to use them.",
    "physgen backends --json",
    add_list,
    list_backends,
)
