"""What a measure found -> the terminal, JSON, Markdown, and a page with its plots in a folder."""

from __future__ import annotations

import argparse
import sys

from physgen.cli.printing import FAILED, OK, print_json, tell, tell_kept
from physgen.evaluate.findings import Findings, markdown, text
from physgen.evaluate.page import write_page


def hand_over(findings: Findings, options: argparse.Namespace) -> int:
    """Print as asked, write the page where `-o` is given; 1 where a bar is missed."""
    if options.json:
        print_json(findings.as_dict())
    else:
        sys.stdout.write(markdown(findings) if options.markdown else text(findings))
    if options.output:
        page = write_page(findings, options.output, options.command_line, tell_kept)
        tell(f"the page: {page}")
    return OK if findings.passed else FAILED
