"""Result of a measure -> terminal, JSON or Markdown, and a page with its plots in a folder."""

from __future__ import annotations

import argparse
import sys

from physgen.cli.output import FAILED, OK, print_backup, print_error, print_json
from physgen.evaluate.measure import Findings, markdown, text, write_page


def show(findings: Findings, options: argparse.Namespace) -> int:
    """Print the result; 1 where a bar is missed."""
    if options.json:
        print_json(findings.as_dict())
    else:
        sys.stdout.write(markdown(findings) if options.markdown else text(findings))
    return OK if findings.passed else FAILED


def hand_over(findings: Findings, options: argparse.Namespace) -> int:
    """Print the result, and write its page where `-o` is given; 1 where a bar is missed."""
    code = show(findings, options)
    if options.output:
        page = write_page(findings, options.output, options.command_line, print_backup)
        print_error(f"the page: {page}")
    return code
