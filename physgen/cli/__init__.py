"""Command line -> exit code. The only room that prints: results to stdout, everything else to stderr."""

from __future__ import annotations

import argparse
import io
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress

from physgen.cli.caching import cache
from physgen.cli.editing import edit
from physgen.cli.evaluate import evaluate
from physgen.cli.exhibiting import gallery
from physgen.cli.exporting import export
from physgen.cli.gathering import dataset
from physgen.cli.moving import check, simulate
from physgen.cli.packing import pack, unpack
from physgen.cli.perceiving import import_, list_backends, perceive
from physgen.cli.plotting import plot
from physgen.cli.printing import FAILED, INTERRUPTED, OK, print_json, tell, tell_problems
from physgen.cli.refining import refine
from physgen.cli.rendering import render
from physgen.cli.sweeping import sweep
from physgen.cli.verifying import verify
from physgen.flags import build_parser
from physgen.flags.parser import WRONG_INPUT, joined
from physgen.problems import InputError
from physgen.stopping import heeded
from physgen.whole import meant

BATCHES = ("render", "sweep", "export", "verify")
"""Commands that make many things, and that a program reads."""
UNREAD = 141
"""As of a program that nobody reads any more (128 + SIGPIPE): not all was made."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `physgen`."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a file's name need not be text
            stream.reconfigure(errors="backslashreplace")
    options = build_parser().parse_args(joined(given))
    options.command_line = ["physgen", *given]
    with suppress(ValueError):  # not the main thread: then nobody stops us that way
        signal.signal(signal.SIGTERM, _stop)
    heeded()
    try:
        return COMMANDS[options.command](options)
    except InputError as error:
        tell_problems(error.problems)
        if getattr(options, "json", False) and options.command in BATCHES:
            print_json({"passed": False, "problems": [problem.as_dict() for problem in error.problems]})
        return WRONG_INPUT
    except KeyboardInterrupt:
        tell("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()
        return UNREAD if options.command in BATCHES else OK
    except OSError as error:
        where = f"{meant(str(error.filename))}: " if error.filename else ""
        tell(f"{where}{error.strerror or error}")
        return FAILED


def _stop(number: int, frame: object) -> None:
    """Ended from outside: leave as by Ctrl-C, with nothing half-written."""
    raise KeyboardInterrupt


def schema(options: argparse.Namespace) -> int:
    if options.markdown:
        from physgen.scene.reference import markdown

        sys.stdout.write(markdown())
    else:
        from physgen.resources import resource

        sys.stdout.write(resource("schemas", "scene-1.schema.json").read_text(encoding="utf-8"))
    return OK


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "perceive": perceive,
    "import": import_,
    "edit": edit,
    "check": check,
    "simulate": simulate,
    "render": render,
    "sweep": sweep,
    "export": export,
    "dataset": dataset,
    "refine": refine,
    "gallery": gallery,
    "evaluate": evaluate,
    "plot": plot,
    "verify": verify,
    "pack": pack,
    "unpack": unpack,
    "cache": cache,
    "backends": list_backends,
    "schema": schema,
}
