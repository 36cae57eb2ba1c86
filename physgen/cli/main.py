"""The command line: all commands, their dispatch and their exit codes."""

from __future__ import annotations

import argparse
import io
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from errno import ENAMETOOLONG

from physgen import __version__
from physgen.cli import (
    backends,
    clean,
    clip,
    dataset,
    edit,
    evaluate,
    export,
    fit,
    gallery,
    perceive,
    render,
    simulate,
    sweep,
    verify,
)
from physgen.cli.arguments import WRONG_INPUT, Command, Parser
from physgen.cli.output import (
    FAILED,
    INTERRUPTED,
    OK,
    named_by_flag,
    print_error,
    print_json,
    print_problems,
)
from physgen.files import final_name, resource
from physgen.operating_system import handle_termination
from physgen.problems import InputError
from physgen.signals import install_handler

BATCHES = ("render", "clip", "sweep", "export", "verify")
"""Commands with many results, which a program may read."""
URL = re.compile(r"(s3|gs|gcs|az|abfs|https?|ftp|sftp|hdfs|file|memory)://")
"""Addresses of stores. Scenes and results are files, and such a name would become a
folder called `s3:`.
"""
UNREAD = 141
"""Exit code after the end of the output's reader (128 + SIGPIPE): the results are
incomplete.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `physgen`. Return the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # File names may contain bytes without a character.
            stream.reconfigure(errors="backslashreplace")
    parser = build_parser()
    address = _first_address(words)
    if address is not None:
        parser.error(
            f"{address}: URLs are not read or written; mount the store, or copy the files"
        )
    options = parser.parse_args(words)
    options.command_line = ["physgen", *words]
    # Only the main thread can set signal handlers.
    with suppress(ValueError):
        handle_termination(_interrupt)
    install_handler()
    try:
        return COMMANDS[options.command].run(options)
    except InputError as error:
        _print_input_error(error, options)
        return WRONG_INPUT
    except KeyboardInterrupt:
        print_error("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        # Otherwise Python prints a message about the closed pipe when it ends.
        sys.stderr.close()
        if options.command in BATCHES:
            return UNREAD
        return OK
    except OSError as error:
        return _print_system_error(error)


def _first_address(words: Sequence[str]) -> str | None:
    """Return the first URL among files and outputs, or None."""
    # Pairs of a word and the one before it: values of other flags may be addresses.
    for flag, text in zip(["", *words], words, strict=False):
        is_path = flag in ("-o", "--output") or not flag.startswith("-")
        if is_path and URL.match(text):
            return text
    return None


def _print_input_error(error: InputError, options: argparse.Namespace) -> None:
    """Print all problems of an input, also as JSON if asked for."""
    print_problems(error.problems)
    if getattr(options, "json", False) and options.command in BATCHES:
        problems = [named_by_flag(problem).as_dict() for problem in error.problems]
        print_json({"passed": False, "problems": problems})


def _print_system_error(error: OSError) -> int:
    """Print an error of the system. Return the exit code."""
    # Partial files have temporary names; the user knows only the final one.
    file_name = ""
    if error.filename:
        file_name = f"{final_name(str(error.filename))}: "
    if error.errno == ENAMETOOLONG:
        print_error(
            f"{file_name}is too long a name; write the path of a file that is there"
        )
        return WRONG_INPUT
    print_error(f"{file_name}{error.strerror or error}")
    return FAILED


def _interrupt(number: int, frame: object) -> None:
    """Stop the command on SIGTERM as on Ctrl-C, without incomplete files."""
    raise KeyboardInterrupt


def build_parser() -> Parser:
    """Return the parser with every command, its flags and an example."""
    parser = Parser(
        prog="physgen",
        description="One photo becomes an editable scene file; the scene file becomes a physically simulated video.",
        epilog="example: physgen perceive photo.png > scene.yaml && physgen render scene.yaml",
    )
    parser.add_argument("--version", action="version", version=f"physgen {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    # A command is one row of the registry: its module adds its own flags.
    for command in COMMANDS.values():
        sub = commands.add_parser(
            command.name,
            help=command.summary,
            description=command.summary,
            epilog=f"example: {command.example}",
        )
        sub.set_defaults(command=command.name)
        command.add(sub)
        sub.is_order_free = command.is_order_free
        parser.commands[command.name] = sub
    return parser


def schema(options: argparse.Namespace) -> int:
    sys.stdout.write(
        resource("schemas", "scene-1.schema.json").read_text(encoding="utf-8")
    )
    return OK


SCHEMA = Command(
    "schema",
    "Prints the JSON Schema of scene files.",
    "physgen schema > scene.schema.json",
    lambda parser: None,
    schema,
)
COMMANDS = {
    command.name: command
    for command in (
        perceive.PERCEIVE,
        perceive.IMPORT,
        edit.EDIT,
        *edit.FILE_EDITS,
        simulate.SHOW,
        simulate.CHECK,
        simulate.SIMULATE,
        render.RENDER,
        clip.CLIP,
        sweep.SWEEP,
        export.EXPORT,
        dataset.DATASET,
        gallery.GALLERY,
        clean.CLEAN,
        evaluate.EVALUATE,
        fit.FIT,
        verify.VERIFY,
        backends.BACKENDS,
        SCHEMA,
    )
}
