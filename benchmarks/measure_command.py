"""The command line that measures of physgen share: the flags of `physgen evaluate`, its output and its exit codes."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Callable

from physgen.cli.arguments import WRONG_INPUT, Parser
from physgen.cli.evaluate import add_output, hand_over
from physgen.cli.output import Bar, print_problems
from physgen.evaluate.measure import Findings, Progress, check_folder
from physgen.problems import InputError


def run(
    parser: Parser,
    find: Callable[[Namespace, Progress], Findings],
    arguments: list[str] | None,
) -> int:
    """Print what is found, and write its page where `-o` is given; 1 where a bar is missed, 2 for wrong input."""
    parser.flag("--json", "print as JSON")
    add_output(parser)
    options = parser.parse_args(arguments)
    options.command_line = ["python", *sys.argv]
    bar = Bar()
    try:
        check_folder(options.output)
        found = find(options, bar.show)
    except InputError as error:
        print_problems(error.problems)
        return WRONG_INPUT
    finally:
        bar.clear()
    return hand_over(found, options)
