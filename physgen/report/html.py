"""Jinja templates, pictures as data URIs, and YAML text highlighted as HTML."""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import yaml
from markupsafe import Markup, escape
from numpy.typing import NDArray
from PIL import Image

from physgen.files import resource
from physgen.scene.document import RefusedNumberError, resolve

# ----------------------------------------------------------------------
# Pixels or a file's bytes -> what a page can carry: small pictures as WebP, PNG or JPEG, and data URIs.

U8 = NDArray[np.uint8]

METHOD = 2
"""Of WebP, 0 to 6: a third of the time of libwebp's usual 4, and 3 % more bytes."""
KINDS = {
    ".mp4": "video/mp4",
    ".webp": "image/webp",
    ".gif": "image/gif",
    ".png": "image/png",
    ".jpg": "image/jpeg",
}


def webp(pixels: U8, quality: int) -> str:
    """(H, W, 3) sRGB, or (H, W, 4) with how much they cover, as a data URI; coverage is kept exactly."""
    return data_uri(_bytes(pixels, "WEBP", quality=quality, method=METHOD), ".webp")


def smallest_picture(pixels: U8, quality: int) -> str:
    """The same as WebP or PNG, whichever is smaller: few colours stay as they are."""
    exact = data_uri(_bytes(pixels, "PNG"), ".png")
    return min(webp(pixels, quality), exact, key=len)


def jpeg(pixels: U8, quality: int) -> str:
    """(H, W, 3) sRGB as a data URI."""
    return data_uri(_bytes(pixels, "JPEG", quality=quality), ".jpg")


def data_uri(data: bytes, ending: str) -> str:
    """A file by its ending, one of KINDS."""
    return f"data:{KINDS[ending]};base64,{base64.b64encode(data).decode('ascii')}"


def _bytes(pixels: U8, kind: str, **how: int) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, kind, **how)
    return buffer.getvalue()


# ----------------------------------------------------------------------
# A scene file's text -> the same as HTML with comments, keys, numbers, strings and words marked.
#
# What is what, PyYAML's scanner says, which also reads scenes; so a `#` in a quoted string is no comment here
# either.
# Take the tags away and unescape, and the text is there again, letter for letter.

Piece = tuple[int, int, str]
"""From and to, characters, and what it is: `key`, `number`, `string`, `word` (true, false, null), `comment`."""

_COMMENT = re.compile(r"#[^\r\n]*")
MOST = 2_000_000
"""Characters; a longer text is shown plainly."""


def highlight_yaml(text: str) -> Markup:
    """`<span class="y-key">mass</span>: <span class="y-number">170</span>`, and so on; plain where it is no YAML."""
    html, at = Markup(""), 0
    parts = []
    for begin, end, kind in yaml_pieces(text):
        parts.append(escape(text[at:begin]))
        parts.append(Markup('<span class="y-{}">{}</span>').format(kind, text[begin:end]))
        at = end
    parts.append(escape(text[at:]))
    return html.join(parts)


def highlight_lines(text: str) -> list[Markup]:
    """The same, a line each, without line breaks."""
    found: list[list[Markup]] = [[]]
    at = 0
    for begin, end, kind in [*yaml_pieces(text), (len(text), len(text), "")]:
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


def yaml_pieces(text: str) -> list[Piece]:
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


# ----------------------------------------------------------------------
# A template's name -> the template, out of `templates/`; whatever is put into it, or into a script, is
# escaped.


def template(name: str) -> Any:
    """A Jinja template that finds its parts beside it, and fails where something is missing."""
    import jinja2

    loader = jinja2.FileSystemLoader(resource("templates", name).parent)
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    return environment.get_template(name)


def script_json(data: object) -> str:
    """JSON that stays inside `<script>` whatever a label says."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for sign in "<>&\u2028\u2029":  # the last two end lines in older scripts
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text
