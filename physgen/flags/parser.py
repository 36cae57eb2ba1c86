"""Arguments of a command line -> options, by argparse; what is wrong with them in one line, with the way out."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any, NoReturn

WRONG_INPUT = 2


class Parser(argparse.ArgumentParser):
    """Wrong flags: one line that says what to do, exit code 2."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.commands: dict[str, Parser] = {}
        self.mixed = False
        """Whether flags may stand between arguments."""

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """As argparse does, which by itself takes all arguments of one kind in one go."""
        if not self.mixed:
            return super().parse_known_args(args, namespace)
        self.mixed = False
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self.mixed = True

    def parse_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> argparse.Namespace:
        """As argparse does; what a command does not know is told of that command, with the nearest flag that it has."""
        options, unknown = self.parse_known_args(args, namespace)
        if not unknown:
            return options
        command = self.commands.get(getattr(options, "command", ""), self)
        command.error("; ".join(command.unknown(text) for text in unknown))

    def unknown(self, text: str) -> str:
        """Why an argument that was left over is none."""
        if not text.startswith("-"):
            return f"{text} is one argument too many"
        flag = text.partition("=")[0]
        close = get_close_matches(flag, re.findall(r"--[\w-]+", self.format_help()), 1, 0.7)
        return f"there is no flag {flag}" + (f", did you mean {close[0]}?" if close else "")

    def error(self, message: str) -> NoReturn:
        """Print the message and a hint; of a word that is none of several, the nearest of them."""
        wrong = re.fullmatch(r"argument ([^:]+): invalid choice: '([^']+)' \(choose from (.+)\)", message)
        if wrong is not None:
            close = get_close_matches(wrong[2], [word.strip(" '") for word in wrong[3].split(",")], 1, 0.6)
            if close:
                message = f"argument {wrong[1]}: invalid choice: '{wrong[2]}', did you mean {close[0]}?"
        self.exit(WRONG_INPUT, f"{self.prog}: {message}; see {self.prog} --help\n")


def joined(arguments: list[str]) -> list[str]:
    """`--point -1,3` as `--point=-1,3`: argparse takes a value that begins with - for a flag.

    >>> joined(["perceive", "a.png", "--point", "-1,3"])
    ['perceive', 'a.png', '--point=-1,3']
    """
    result: list[str] = []
    for argument in arguments:
        if (
            result
            and result[-1] in ("--box", "--point")
            and argument[:1] == "-"
            and argument[1:2].isdecimal()
        ):
            result[-1] += f"={argument}"
        else:
            result.append(argument)
    return result
