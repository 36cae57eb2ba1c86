"""Argument parser, and readers of flag values."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn

from physgen.problems import InputError

# ----------------------------------------------------------------------
# Arguments of a command line -> options, by argparse; what is wrong with them in one line, with the way out.

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


# ----------------------------------------------------------------------
# Texts of flags -> values, or what is wrong with them.

DEVICES = ("cpu", "cuda")
"""What draws frames."""
FORMATS = ("mp4", "gif", "webp", "png")
CURVES = ("x", "y", "speed", "angle")


def place(text: str) -> str:
    """A path or a URL; of a file of this machine, its path."""
    from physgen.batch.remote import plain

    try:
        return plain(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def positive(text: str) -> float:
    """A number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value <= 1e6:
        raise argparse.ArgumentTypeError(f"{text} is not a number above 0 and up to 1000000")
    return value


def part(text: str) -> float:
    """A number in 0..1."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"{text} is not a number from 0 to 1")
    return value


def side(text: str) -> int:
    """px of a photo's side."""
    if not text.isdecimal() or not 16 <= int(text) <= 100_000:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 16 to 100000")
    return int(text)


def two_sides(text: str) -> tuple[int, int]:
    """`832x480` -> px."""
    sides = text.lower().split("x")
    if len(sides) != 2 or not all(
        part.isdecimal() and len(part) < 6 and 2 <= int(part) <= 16384 for part in sides
    ):
        raise argparse.ArgumentTypeError(f"{text} is not a size from 2x2 to 16384x16384, e.g. 832x480")
    return int(sides[0]), int(sides[1])


def count(text: str) -> int:
    """A number of things."""
    if not text.isdecimal() or not 1 <= int(text) <= 1024:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 1 to 1024")
    return int(text)


def number_of_clips(text: str) -> int:
    """A number of draws."""
    if not text.isdecimal() or not 1 <= int(text[:12]) <= 10_000_000 or len(text) > 8:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 1 to 10,000,000")
    return int(text)


def draws(text: str) -> int:
    """Draws of a fan."""
    if not text.isdecimal() or not 2 <= int(text) <= 1000:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 2 to 1000")
    return int(text)


def seed(text: str) -> int:
    """Of random draws."""
    if not text.isdecimal() or len(text) > 18:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number of at least 0")
    return int(text)


def of(key: Mapping[str, Any]) -> Callable[[str], float | int | str]:
    """A reader of what the schema of a scene's key allows: a number, a whole one, or text."""
    kind, low, high = key["type"], key.get("minimum", -math.inf), key.get("maximum", math.inf)
    whole = kind == "integer"

    def value(text: str) -> float | int | str:
        if kind == "string":
            if len(text) > key["maxLength"]:
                raise argparse.ArgumentTypeError(f"{len(text)} characters are over {key['maxLength']}")
            return text
        try:
            number = int(text) if whole else float(text)
        except ValueError:
            number = math.nan
        if not low <= number <= high:
            what = f"a {'whole ' * whole}number from {low:g} to {high:.10g}"
            raise argparse.ArgumentTypeError(f"{text} is not {what}")
        return number

    return value


def speeds(text: str) -> list[float]:
    """`50,100,200` -> px/s above 0, each once, in order."""
    found = sorted({positive(part.strip()) for part in text.split(",")})
    if not 2 <= len(found) <= 100:
        raise argparse.ArgumentTypeError(f"{text} is not 2 to 100 sizes that differ, e.g. 50,100,200")
    return found


def turns(text: str) -> int:
    """A number of directions."""
    if not text.isdecimal() or not 1 <= int(text) <= 360:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 1 to 360")
    return int(text)


def rows(text: str) -> list[int]:
    """`1,5,12` -> numbers of rows."""
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() and len(part) < 6 for part in parts):
        raise argparse.ArgumentTypeError(f"{text} is not a list of numbers, e.g. 1,5,12")
    return [int(part) for part in parts]


def nouns(text: str) -> list[str]:
    """`a red ball, cup` -> its nouns."""
    return [noun for part in text.split(",") if (noun := part.strip())]


def names(text: str) -> list[str]:
    """`a,b` -> names."""
    return list(dict.fromkeys(name for part in text.split(",") if (name := part.strip())))


def labels(text: str) -> tuple[str, ...]:
    """`flo,coco` -> names of formats, which are checked later."""
    return tuple(names(text))


def curves(text: str) -> list[str]:
    """`x,y,speed,angle` -> what is drawn over time."""
    wrong = [name for name in names(text) if name not in CURVES]
    if wrong:
        raise argparse.ArgumentTypeError(f"{', '.join(wrong)} is not among {', '.join(CURVES)}")
    return names(text)


def moments(text: str) -> int | list[int]:
    """`6` -> so many frames; `0,3,6` -> these."""
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if not parts or not all(part.isdecimal() and len(part) < 7 for part in parts):
        raise argparse.ArgumentTypeError(
            f"{text} is neither a number of frames nor a list of them, e.g. 0,3,6"
        )
    if "," in text:
        return [int(part) for part in parts]
    if not 1 <= int(parts[0]) <= 64:
        raise argparse.ArgumentTypeError(
            f"{text} is not a number of frames from 1 to 64; frame {text} alone is {text},"
        )
    return int(parts[0])


def width(text: str) -> tuple[float, None] | tuple[None, int]:
    """`84`, `84mm`, `8.4cm`, `3.3in` -> mm; `1600px` -> px."""
    number = text.strip().rstrip("abcdefghijklmnopqrstuvwxyz ")
    unit = text.strip()[len(number) :].strip() or "mm"
    per = {"mm": 1.0, "cm": 10.0, "in": 25.4}
    try:
        value = float(number)
    except ValueError:
        value = 0.0
    if unit == "px" and value.is_integer() and 100 <= value <= 30_000:
        return None, int(value)
    if unit in per and 20 <= value * per[unit] <= 2000:
        return value * per[unit], None
    raise argparse.ArgumentTypeError(
        f"{text} is not a width from 20 mm to 2 m, or from 100px to 30000px, e.g. 84mm"
    )


def formats(text: str) -> list[str]:
    """`mp4,gif` -> kinds of video."""
    names = [name.strip() for name in text.split(",")]
    wrong = [name for name in names if name not in FORMATS]
    if wrong:
        raise argparse.ArgumentTypeError(f"{', '.join(wrong)} is not among {', '.join(FORMATS)}")
    return list(dict.fromkeys(names))


def _numbers(flag: str, text: str, count: int) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(abs(v) < 1e6 for v in values):
        form = ",".join(("120", "80", "60", "60")[:count])
        raise InputError.of(flag, f'"{text}"', f"is not {count} numbers", f"write e.g. {form}")
    return values


def four(flag: str, text: str) -> tuple[float, float, float, float]:
    """`x,y,w,h` px; raises InputError."""
    a, b, c, d = _numbers(flag, text, 4)
    return a, b, c, d


def two(flag: str, text: str) -> tuple[float, float]:
    """`x,y` px; raises InputError."""
    a, b = _numbers(flag, text, 2)
    return a, b


def scene_name(output: Path | None) -> None:
    """Refuses what would overwrite a photo, or leave a scene that no command reads."""
    if output is not None and (output.suffix not in (".yaml", ".yml") or output.is_dir()):
        raise InputError.of(
            "-o",
            f'"{output}"',
            "is no name for a scene file",
            "end it in .yaml; without -o it goes to stdout",
        )
