"""A template's name -> the template, out of `templates/`; whatever is put into it, or into a script, is escaped."""

from __future__ import annotations

import json
from typing import Any

from physgen.resources import resource


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
