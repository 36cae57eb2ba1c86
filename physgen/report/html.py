"""Jinja templates, pictures as data URIs, and YAML text highlighted as HTML."""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import yaml
from markupsafe import Markup, escape
from numpy.typing import NDArray
from PIL import Image

from physgen.files import resource
from physgen.scene.document import RefusedNumberError, resolve

U8 = NDArray[np.uint8]

METHOD = 2
"""Effort of WebP, 0 to 6: a third of the time of libwebp's default 4, and 3 % more bytes."""
KINDS = {
    ".mp4": "video/mp4",
    ".webp": "image/webp",
    ".gif": "image/gif",
    ".png": "image/png",
    ".jpg": "image/jpeg",
}
LONGEST_TEXT = 2_000_000
"""Characters; a longer text is not highlighted."""
COMMENT = re.compile(r"#[^\r\n]*")


def template(name: str) -> Any:
    """A Jinja template of `templates/`; values are escaped, and missing ones are an error."""
    import jinja2

    loader = jinja2.FileSystemLoader(resource("templates", name).parent)
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    return environment.get_template(name)


def script_json(data: object) -> str:
    """JSON that cannot end its `<script>`."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for sign in "<>&\u2028\u2029":  # the last two end lines in older scripts
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def webp(pixels: U8, quality: int) -> str:
    """(H, W, 3) sRGB, or (H, W, 4) with alpha, which stays exact, as a data URI."""
    return data_uri(encoded(pixels, "WEBP", quality=quality), ".webp")


def smallest_picture(pixels: U8, quality: int) -> str:
    """As WebP or PNG, whichever is smaller."""
    return min(webp(pixels, quality), data_uri(encoded(pixels, "PNG"), ".png"), key=len)


def jpeg(pixels: U8, quality: int) -> str:
    """(H, W, 3) sRGB as a data URI."""
    return data_uri(encoded(pixels, "JPEG", quality=quality), ".jpg")


def data_uri(data: bytes, ending: str) -> str:
    """Of a file with an ending of KINDS."""
    return f"data:{KINDS[ending]};base64,{base64.b64encode(data).decode('ascii')}"


def encoded(pixels: U8, kind: str, **options: int) -> bytes:
    """A file of Pillow's format `kind`."""
    if kind == "WEBP":
        options = {"method": METHOD, **options}
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, kind, **options)
    return buffer.getvalue()


def fitted(rgb: U8, side: int) -> U8:
    """(h, w, 3) whose longer side is at most `side` px."""
    height, width = rgb.shape[:2]
    scale = side / max(height, width)
    if scale >= 1:
        return rgb
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def highlight_yaml(text: str) -> Markup:
    """`<span class="y-key">mass</span>: <span class="y-number">170</span>`, and so on; plain where it is no YAML."""
    end = "\n" if text.endswith("\n") else ""
    return Markup("\n").join(highlight_lines(text)) + end


def highlight_lines(text: str) -> list[Markup]:
    """The same by lines, without line breaks; without its tags it is the text."""
    found: list[list[Markup]] = [[]]
    at = 0
    for begin, end, kind in [*_yaml_pieces(text), (len(text), len(text), "")]:
        for part, name in ((text[at:begin], ""), (text[begin:end], kind)):
            for k, line in enumerate(part.split("\n")):
                if k:
                    found.append([])
                if line:
                    mark = Markup('<span class="y-{}">{}</span>').format(name, line) if name else escape(line)
                    found[-1].append(mark)
        at = end
    if text.endswith("\n"):
        found.pop()
    return [Markup("").join(parts) for parts in found]


def _yaml_pieces(text: str) -> list[tuple[int, int, str]]:
    """From, to, and kind (key, number, string, word, comment) of parts, in order; empty for what is no YAML.

    PyYAML's scanner decides, which also reads scenes: a `#` in a quoted string is no comment.
    """
    if len(text) > LONGEST_TEXT or text.startswith("\ufeff"):
        return []
    try:
        scalars = list(_scalars(text))
    except yaml.YAMLError:
        return []
    found: list[tuple[int, int, str]] = []
    at = 0
    for begin, end, kind in [*scalars, (len(text), len(text), "")]:
        found += [(m.start(), m.end(), "comment") for m in COMMENT.finditer(text, at, begin)]
        if kind:
            found.append((begin, end, kind))
        at = end
    return found


def _scalars(text: str) -> Iterator[tuple[int, int, str]]:
    key = False
    for token in yaml.scan(text):
        if isinstance(token, yaml.KeyToken):
            key = True
        elif isinstance(token, yaml.ScalarToken):
            end = token.end_mark.index
            if token.style in ("|", ">"):  # the token includes line breaks and comments after it
                end = token.start_mark.index + len(text[token.start_mark.index : end].rstrip())
            yield token.start_mark.index, end, "key" if key else _scalar_kind(token)
            key = False
        elif not isinstance(token, (yaml.AnchorToken, yaml.TagToken)):
            key = False


def _scalar_kind(token: yaml.ScalarToken) -> str:
    if not token.plain:
        return "string"
    try:
        value = resolve(token.value)
    except RefusedNumberError:
        return "number"
    if value is None or isinstance(value, bool):
        return "word"
    return "string" if isinstance(value, str) else "number"
