"""A scene file's text -> the same as HTML with comments, keys, numbers, strings and words marked.

What is what, PyYAML's scanner says, which also reads scenes; so a `#` in a quoted string is no comment here either.
Take the tags away and unescape, and the text is there again, letter for letter.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import yaml
from markupsafe import Markup, escape

from physgen.scene.scalars import RefusedNumberError, resolve

Piece = tuple[int, int, str]
"""From and to, characters, and what it is: `key`, `number`, `string`, `word` (true, false, null), `comment`."""

_COMMENT = re.compile(r"#[^\r\n]*")
MOST = 2_000_000
"""Characters; a longer text is shown plainly."""


def highlighted(text: str) -> Markup:
    """`<span class="y-key">mass</span>: <span class="y-number">170</span>`, and so on; plain where it is no YAML."""
    html, at = Markup(""), 0
    parts = []
    for begin, end, kind in pieces(text):
        parts.append(escape(text[at:begin]))
        parts.append(Markup('<span class="y-{}">{}</span>').format(kind, text[begin:end]))
        at = end
    parts.append(escape(text[at:]))
    return html.join(parts)


def lines(text: str) -> list[Markup]:
    """The same, a line each, without line breaks."""
    found: list[list[Markup]] = [[]]
    at = 0
    for begin, end, kind in [*pieces(text), (len(text), len(text), "")]:
        for part, said in ((text[at:begin], ""), (text[begin:end], kind)):
            for k, line in enumerate(part.split("\n")):
                if k:
                    found.append([])
                if line:
                    mark = Markup('<span class="y-{}">{}</span>').format(said, line) if said else escape(line)
                    found[-1].append(mark)
        at = end
    if text.endswith("\n"):
        found.pop()
    return [Markup("").join(parts) for parts in found]


def pieces(text: str) -> list[Piece]:
    """In order and apart from each other; empty for what is no YAML."""
    if len(text) > MOST or text.startswith("\ufeff"):
        return []
    try:
        said = list(_scalars(text))
    except yaml.YAMLError:
        return []
    found: list[Piece] = []
    at = 0
    for begin, end, kind in [*said, (len(text), len(text), "")]:
        found += [(m.start(), m.end(), "comment") for m in _COMMENT.finditer(text, at, begin)]
        if kind:
            found.append((begin, end, kind))
        at = end
    return found


def _scalars(text: str) -> Iterator[Piece]:
    key = False
    for token in yaml.scan(text):
        if isinstance(token, yaml.KeyToken):
            key = True
        elif isinstance(token, yaml.ScalarToken):
            end = token.end_mark.index
            if token.style in ("|", ">"):  # with the line breaks and comments behind it
                end = token.start_mark.index + len(text[token.start_mark.index : end].rstrip())
            yield token.start_mark.index, end, "key" if key else _kind(token)
            key = False
        elif not isinstance(token, (yaml.AnchorToken, yaml.TagToken)):
            key = False


def _kind(token: yaml.ScalarToken) -> str:
    if not token.plain:
        return "string"
    try:
        value = resolve(token.value)
    except RefusedNumberError:
        return "number"
    if value is None or isinstance(value, bool):
        return "word"
    return "string" if isinstance(value, str) else "number"
