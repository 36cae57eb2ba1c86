"""Explain faults of YAML that PyYAML reports at a later place, or without the fix.

Each rule looks at the text around PyYAML's mark. It returns the fault with place,
reason and fix of the wrong line, or None.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import yaml

from physgen.text import add_space, counted


class SyntaxFault(NamedTuple):
    """A fault with its line and column, counted from 1."""

    line: int
    column: int
    expectation: str
    fix: str


_BREAK = re.compile(r"\r\n|\r|\n")
_BARE_KEY = re.compile(r"\s*(?:- +)*[\w-]+").fullmatch
_HAS_KEY = re.compile(r":(?:\s|$)").search


def explain_syntax(error: yaml.MarkedYAMLError, text: str) -> SyntaxFault | None:
    """Return the fault behind an error of PyYAML, or None if PyYAML's own message is
    right.
    """
    # Some errors of PyYAML have no place.
    mark = error.problem_mark
    if mark is None:
        return None
    lines = _BREAK.split(text)
    rules = (_tab, _missing_colon, _wrong_indent, _quote_in_quotes, _open_bracket)
    for rule in rules:
        fault = rule(error, mark, lines)
        if fault is not None:
            return fault
    return None


def _tab(
    error: yaml.MarkedYAMLError, mark: yaml.Mark, lines: list[str]
) -> SyntaxFault | None:
    """Find a line with a tab in its indentation, which YAML forbids."""
    # PyYAML marks the tab itself, or the key after it.
    for number in (mark.line, mark.line - 1):
        line = _line(lines, number)
        indent = line[: _indent(line)]
        if "\t" in indent:
            column = indent.index("\t") + 1
            fix = "indent the lines with spaces"
            return SyntaxFault(number + 1, column, "a tab indents this line", fix)
    return None


def _missing_colon(
    error: yaml.MarkedYAMLError, mark: yaml.Mark, lines: list[str]
) -> SyntaxFault | None:
    """Find a key without a colon, or without a space after its colon."""
    problem = error.problem or ""
    if "could not find expected ':'" in problem and error.context_mark:
        number = error.context_mark.line
    elif "mapping values are not allowed" in problem:
        if not _BARE_KEY(_line(lines, mark.line)[: mark.column]):
            return None
        number = _line_before(lines, mark.line)
    else:
        return None
    line = _line(lines, number)
    column = _key_column(line)
    fix = add_space(line)
    if fix is not None:
        return SyntaxFault(number + 1, column, "a colon without a space after it", fix)
    if _HAS_KEY(line) or not line.strip():
        return None
    # Comments of other languages.
    if line.lstrip().startswith("//"):
        return SyntaxFault(number + 1, column, "not a comment", "begin it with #")
    fix = "put a colon and a space behind the key, as in key: value"
    return SyntaxFault(number + 1, column, "a line without a key", fix)


def _wrong_indent(
    error: yaml.MarkedYAMLError, mark: yaml.Mark, lines: list[str]
) -> SyntaxFault | None:
    """Find a line with another indentation than all lines above."""
    if "did not find expected key" not in (error.problem or ""):
        return None
    line = _line(lines, mark.line)
    spaces = _indent(line)
    # A wrong indentation makes the parser stop at the first word of a line.
    if line[: mark.column].strip() not in ("", "-") or not line.strip():
        return None
    # The indentation above is right, since the reader accepted it.
    before = _line_before(lines, mark.line)
    expected_indent = _indent(_line(lines, before))
    if line.lstrip().startswith("- "):
        fix = f"take out the -, and indent it by {counted(expected_indent, 'space')}"
        return SyntaxFault(
            mark.line + 1, mark.column + 1, "a list item among keys", fix
        )
    if spaces == expected_indent:
        return None
    reason = f"indented by {counted(spaces, 'space')}, unlike the lines above"
    fix = f"indent it by {counted(expected_indent, 'space')}, as line {before + 1} is"
    return SyntaxFault(mark.line + 1, mark.column + 1, reason, fix)


def _quote_in_quotes(
    error: yaml.MarkedYAMLError, mark: yaml.Mark, lines: list[str]
) -> SyntaxFault | None:
    """Find a quoted text that ends within its line, at an inner quote."""
    if "did not find expected" not in (error.problem or ""):
        return None
    before = _line(lines, mark.line)[: mark.column].rstrip()
    # The parser ends the text at an inner quote, and stops at the next word.
    quote = before[-1:]
    if quote not in ("'", '"'):
        return None
    inside = '\\"'
    if quote == "'":
        inside = "''"
    fix = f"write {inside} for a quote within {quote}...{quote}"
    return SyntaxFault(mark.line + 1, len(before), "a quote within a quoted text", fix)


def _open_bracket(
    error: yaml.MarkedYAMLError, mark: yaml.Mark, lines: list[str]
) -> SyntaxFault | None:
    """Find an unclosed bracket, or a missing comma inside."""
    problem, context = error.problem or "", error.context_mark
    if "did not find expected ','" not in problem or context is None:
        return None
    bracket = "{"
    if "']'" in problem:
        bracket = "["
    # A line without a comma is probably outside the brackets: the closing one is
    # missing.
    if mark.line > context.line and ("," not in _line(lines, mark.line)):
        return SyntaxFault(
            context.line + 1,
            context.column + 1,
            f"a {bracket} that is not closed",
            f"close the {bracket}",
        )
    fix = f"put a comma before it, or close the {bracket}"
    return SyntaxFault(mark.line + 1, mark.column + 1, "a missing comma", fix)


def _line(lines: list[str], number: int) -> str:
    if 0 <= number < len(lines):
        return lines[number]
    return ""


def _line_before(lines: list[str], number: int) -> int:
    """Return the number of the last line with content before a line. Comments do not
    count.
    """
    number -= 1
    while number > 0 and not lines[number].split("#")[0].strip():
        number -= 1
    return max(number, 0)


def _indent(line: str) -> int:
    """Return the number of characters before the key of a line."""
    return len(line) - len(line.lstrip(" \t"))


def _key_column(line: str) -> int:
    """Return the column of a line's key, after the - of a list item."""
    return len(line) - len(line.lstrip(" \t-")) + 1
