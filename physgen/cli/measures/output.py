"""Result of a measure -> terminal, JSON or Markdown, and a page with its plots in a folder."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.cli.output import FAILED, OK, print_backup, print_error

if TYPE_CHECKING:
    from physgen.evaluate.measure import Findings


def add_output(parser: argparse.ArgumentParser, what: str = "write a page with plots in this folder") -> None:
    """The flag `-o`."""
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, help=what)


def show(findings: Findings, options: argparse.Namespace) -> int:
    """Print the result; 1 where a bar is missed."""
    from physgen.evaluate.measure import as_json, markdown, text

    write = as_json if options.json else markdown if options.markdown else text
    sys.stdout.write(write(findings))
    return OK if findings.passed else FAILED


def hand_over(findings: Findings, options: argparse.Namespace) -> int:
    """Print the result, and write its page where `-o` is given; 1 where a bar is missed."""
    code = show(findings, options)
    if options.output:
        from physgen.evaluate.measure import write_page

        page = write_page(findings, options.output, options.command_line, print_backup)
        print_error(f"the page: {page}")
    return code
