"""The argument parser, and readers of flag values."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn

from physgen.messages import Message
from physgen.problems import InputError, Place, RefusedError
from physgen.text import quoted

WRONG_INPUT = 2
"""Exit code of wrong flags and wrong files."""
FORMATS = ("mp4", "gif", "webp", "png")
VIDEO_SUFFIXES = (".mp4", ".gif", ".webp")
"""Suffixes of the videos of `render`."""
FILE_SUFFIXES = (
    *VIDEO_SUFFIXES,
    *(".mov", ".m4v", ".avi", ".mkv", ".webm"),
    *(".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".heic", ".avif"),
    *(".yaml", ".yml", ".json", ".jsonl", ".csv", ".npz", ".npy", ".parquet"),
    *(".html", ".htm", ".pdf", ".txt", ".md", ".zip", ".tar", ".gz", ".tgz", ".h5"),
)
"""Suffixes of files. A new folder never has such a name on purpose."""
LONGEST_NAME = 200
"""Maximum length of an output's name, bytes. File systems allow 255, and partial and
backup files have longer names.
"""
LONGEST_MESSAGE = 500
"""Maximum length of a message about wrong flags, which repeats the user's text,
characters.
"""

NO_FLAG = "\0"
"""Mark before an argument with a leading dash that is not a flag. Arguments cannot
contain this character.
"""


class Parser(argparse.ArgumentParser):
    """A parser that reports all wrong flags, one line each with a fix, and exits with
    code 2.
    """

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        # Coordinates such as -40,95 are values too, not flags.
        self._negative_number_matcher = re.compile(r"-\.?\d")
        self.commands: dict[str, Parser] = {}
        self.is_order_free = False
        """True if flags may come between arguments."""
        self.wrong: list[str] = []
        """Messages about wrong values, printed together at the end."""

    def option(
        self,
        names: str,
        metavar: str,
        kind: Callable[[str], Any],
        help: str,
        default: Any = None,
        **more: Any,
    ) -> None:
        """Add a flag with a value. `names` are separated by a space."""
        if names.startswith("-o "):
            kind = _output(kind)
        self.add_argument(
            *names.split(),
            metavar=metavar,
            type=kind,
            default=default,
            help=help,
            **more,
        )

    def flag(self, name: str, help: str) -> None:
        """Add a flag without a value. `--no-NAME` sets NAME to false; the default is
        true.
        """
        if name.startswith("--no-"):
            self.add_argument(
                name, dest=name[5:].replace("-", "_"), action="store_false", help=help
            )
        else:
            self.add_argument(name, action="store_true", help=help)

    def parse_known_args(  # type: ignore[override]
        self,
        args: Sequence[str] | None = None,
        namespace: argparse.Namespace | None = None,
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse arguments in any order. argparse alone requires all arguments of one
        kind together.
        """
        if not self.is_order_free:
            return super().parse_known_args(args, namespace)
        # The parser calls this method again for the parts of the command line.
        self.is_order_free = False
        try:
            return self.parse_known_intermixed_args(_hide_dashes(args), namespace)
        finally:
            self.is_order_free = True

    def parse_args(  # type: ignore[override]
        self,
        args: Sequence[str] | None = None,
        namespace: argparse.Namespace | None = None,
    ) -> argparse.Namespace:
        """Parse all arguments. Report an unknown flag with the most similar flag of the
        command.
        """
        options, unknown = self.parse_known_args(args, namespace)
        command = self.commands.get(getattr(options, "command", ""), self)
        # A measure of `evaluate` is a command with its own flags and example.
        command = command.commands.get(getattr(options, "what", ""), command)
        if not unknown and not command.wrong:
            return options
        # A word after an unknown flag is its value, and needs no message of its own.
        flags = []
        for text in unknown:
            if text.startswith("-"):
                flags.append(text)
        command.wrong += list(map(command.unknown, flags or unknown))
        command.error(command.wrong.pop())

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        try:
            return super()._get_value(action, arg_string.removeprefix(NO_FLAG))
        except argparse.ArgumentError as error:
            # `parse_args` reports all wrong values together.
            self.wrong.append(str(error))

    def unknown(self, text: str) -> str:
        """Return the message about an unexpected argument."""
        flags = re.findall(r"--[\w-]+", self.format_help())
        if not text.startswith("-"):
            # `KEY=VALUE` without `--set` is a common slip.
            fix = "leave it out"
            if "--set" in flags and IS_SETTING(text):
                fix = f"to set the key, write --set {text}"
            refusal = Message.ARGUMENT_TOO_MANY.refusal(fix=fix)
            return f"{text} {refusal.expected}; {refusal.fix}"
        flag = text.partition("=")[0]
        similar = get_close_matches(flag, flags, 1, 0.7)
        fix = "leave it out"
        if similar:
            fix = f"did you mean {similar[0]}?"
        refusal = Message.UNKNOWN_FLAG.refusal(fix=fix)
        return f"{flag} {refusal.expected}; {refusal.fix}"

    def error(self, message: str) -> NoReturn:
        """Print all faults, one line each, with a hint. For an unknown choice, name the
        nearest one.
        """
        # argparse has no error type for a wrong choice: its message is the only source.
        wrong = re.fullmatch(
            r"argument ([^:]+): invalid choice: '([^']+)' \(choose from (.+)\)", message
        )
        if wrong is not None:
            close = get_close_matches(
                wrong[2], [word.strip(" '") for word in wrong[3].split(",")], 1, 0.6
            )
            if close:
                message = f"argument {wrong[1]}: invalid choice: '{wrong[2]}', did you mean {close[0]}?"
        messages = dict.fromkeys([*self.wrong, message])
        lines = []
        for text in messages:
            lines.append(quoted(self._with_example(text), "", LONGEST_MESSAGE))
        self.exit(
            WRONG_INPUT,
            "".join(f"{self.prog}: {line}; see {self.prog} --help\n" for line in lines),
        )

    def _with_example(self, message: str) -> str:
        """Add the form of the value, or an example of the command, to a message of
        argparse.
        """
        flag = re.fullmatch(r"argument ([^:]+): expected one argument", message)
        if flag is not None:
            name = flag[1].rpartition("/")[2]
            action = self._option_string_actions.get(name)
            if action is None:
                return message
            return f"{message}: {name} {action.metavar}"
        is_count = "are required" in message or "one argument too many" in message
        if is_count and self.epilog:
            return f"{message}; {self.epilog}"
        return message


def _hide_dashes(arguments: Sequence[str] | None) -> Sequence[str] | None:
    """Mark the arguments behind `--` with a leading dash, and remove `--`.

    The intermixed parsing of argparse does not know `--`.
    """
    if arguments is None or "--" not in arguments:
        return arguments
    end = arguments.index("--")
    values = list(arguments[:end])
    for text in arguments[end + 1 :]:
        values.append(NO_FLAG + text if text.startswith("-") else text)
    return values


def wrong_value(text: str, refusal: RefusedError) -> argparse.ArgumentTypeError:
    """Return the error of a flag's value. argparse prints it with the flag."""
    return argparse.ArgumentTypeError(f"{text} {refusal.expected}; {refusal.fix}")


def _output(kind: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return a reader of an output's name, with a check that file systems accept the
    name.
    """

    def read(text: str) -> Any:
        if not text.strip() or "\0" in text:
            raise wrong_value("the output", Message.OUTPUT_NAME_EMPTY.refusal())
        length = max(len(os.fsencode(part)) for part in text.split("/"))
        if length > LONGEST_NAME:
            refusal = Message.OUTPUT_NAME_LONG.refusal(length=length, most=LONGEST_NAME)
            raise wrong_value("the output", refusal)
        return kind(text)

    return read


@dataclass(frozen=True)
class Command:
    """A command: its options and its handler."""

    name: str
    summary: str
    example: str
    # Adds the arguments.
    add: Callable[[Parser], None]
    # Returns the exit code.
    run: Callable[[argparse.Namespace], int]
    # True if flags may come between several arguments.
    is_order_free: bool = False


def integer_reader(low: int, high: int) -> Callable[[str], int]:
    """Return a reader of whole numbers from `low` to `high`."""

    def read(text: str) -> int:
        digits = text.removeprefix("-")
        # `int` also reads digits of other scripts and, slowly, thousands of digits.
        if digits.isascii() and digits.isdecimal() and len(digits) < 20:
            value = int(text)
        else:
            value = low - 1
        if not low <= value <= high:
            refusal = Message.NOT_WHOLE_NUMBER.refusal(low=low, high=high)
            raise wrong_value(text, refusal)
        return value

    return read


count = integer_reader(1, 1024)
draws = integer_reader(2, 1000)
number_of_clips = integer_reader(1, 10_000_000)
seed = integer_reader(0, 10**18)


def positive(text: str) -> float:
    """Return a number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    most = 1e6
    if not 0 < value <= most:
        raise wrong_value(text, Message.NOT_ABOVE_ZERO.refusal(most=most))
    return value


def names(text: str) -> list[str]:
    """Return the names in `a,b`, without repetitions."""
    return list(
        dict.fromkeys(name for part in text.split(",") if (name := part.strip()))
    )


def choice_reader(choices: Sequence[str]) -> Callable[[str], list[str]]:
    """Return a reader of `a,b` for names among `choices`."""

    def read(text: str) -> list[str]:
        wrong = []
        for name in names(text):
            if name not in choices:
                wrong.append(name)
        if wrong or not names(text):
            refusal = Message.NOT_AMONG.refusal(names=", ".join(choices))
            raise wrong_value(", ".join(wrong) or text, refusal)
        return names(text)

    return read


PROMPT_FLAGS = {4: "--box", 2: "--point"}
"""Number of coordinates -> flag with this number."""
BETWEEN_NUMBERS = re.compile(r"\s*[,;]\s*|\s+")
IS_VALUE_PIECE = re.compile(
    r"[-+=@,]|[-+=@]?[\d.]+(px|cm|mm|m|%)?,?|(px|cm|mm|m)/s"
).fullmatch


IS_SETTING = re.compile(r"[A-Za-z_]\w*(?:[.\[][^=\s]+)=.*", re.DOTALL).fullmatch
"""Match an argument with the form of `--set`: a dotted key, = and a value."""


def refuse_settings(files: Sequence[str]) -> None:
    """Raise InputError if arguments are KEY=VALUE and not files."""
    problems = []
    for text in files:
        if IS_SETTING(text) and not Path(text).exists():
            problem = Message.KEY_WITHOUT_SET.problem(
                Place("SCENE"), "", quoted(text), setting=text
            )
            problems.append(problem)
    if problems:
        raise InputError(problems)


def refuse_split_values(arguments: Sequence[str], files: Sequence[str]) -> None:
    """Raise InputError if spaces split the value of a flag.

    `arguments` is the command line; `files` are the arguments taken for files.
    """
    # Arguments with the look of a piece of a value, and without a file.
    strays = {
        text for text in files if not Path(text).exists() and IS_VALUE_PIECE(text)
    }
    for index, flag in enumerate(arguments):
        # The flag's own value, and the stray pieces right behind it.
        pieces = [*arguments[index + 1 : index + 2]]
        for text in arguments[index + 2 :]:
            if text not in strays:
                break
            pieces.append(text)
        # A file that exists is a file, even if its name looks like a number.
        if flag.startswith("--") and len(pieces) > 1:
            is_key = flag == "--set" and "=" not in "".join(pieces)
            if is_key:
                value = "=".join(pieces)
            else:
                value = _join_pieces(pieces)
            raise Message.VALUE_SPLIT.error(
                flag, quoted(" ".join(pieces)), flag=flag, value=quoted(value, "")
            )


def _join_pieces(pieces: Sequence[str]) -> str:
    """Return the intended value of its pieces: numbers with commas between them."""
    if not all(
        re.fullmatch(r"[-+]?[\d.]+(px|cm|mm|m|%)?,?", piece) for piece in pieces
    ):
        return " ".join(pieces)
    return ",".join(piece.strip(",") for piece in pieces)


def coordinates(flag: str, text: str, count: int) -> tuple[float, ...]:
    """Read `x,y` or `x,y,w,h` px, the value of a flag. Raise InputError.

    Spaces, brackets and `px` are allowed: `(120 px, 80 px)`.
    """
    form = ",".join(("120", "80", "60", "60")[:count])
    # Accept the notations that users copy from other programs, and nothing else: a
    # typing error must not become another place.
    pieces = BETWEEN_NUMBERS.split(re.sub(r"\s*px\b|[()\[\]]", "", text).strip())
    pieces = [piece for piece in pieces if piece]
    fix = f"write px of the photo, e.g. {form}"
    if any(piece.endswith("%") for piece in pieces):
        raise Message.IN_PERCENT.error(flag, quoted(text), fix=fix)
    try:
        values = tuple(map(float, pieces))
    except ValueError:
        values = ()
    # Two numbers for a box, or four for a point, belong to the other flag.
    other = PROMPT_FLAGS.get(len(values))
    if len(values) != count and other is not None:
        fix = f"write {other}, or {fix.removeprefix('write ')}"
    if len(values) != count or not all(abs(v) < 1e6 for v in values):
        wrong = Message.NOT_COORDINATES
        raise wrong.error(flag, quoted(text), count=count, fix=fix)
    return values


def is_folder_name(output: str) -> bool:
    """Return whether an output's name is an existing folder, or ends as a folder's."""
    return output.endswith(("/", os.sep)) or Path(output).is_dir()


def check_folder_name(output: str | Path | None) -> None:
    """Raise InputError for a file's name if the results need a folder."""
    if output is None or is_folder_name(os.fspath(output)):
        return
    path = Path(output)
    if path.suffix.lower() in FILE_SUFFIXES and not path.exists():
        raise Message.NOT_A_FOLDER_NAME.error(
            "-o", f'"{path}"', example=path.with_suffix("")
        )


def check_scene_name(output: Path | None) -> None:
    """Raise InputError if the output is not a scene's name. A photo's name would
    overwrite the photo.
    """
    if output is not None and (
        output.suffix not in (".yaml", ".yml") or output.is_dir()
    ):
        raise Message.NOT_A_SCENE_NAME.error("-o", f'"{output}"')
