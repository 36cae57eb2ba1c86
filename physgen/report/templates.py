"""A template's name -> the template, out of `templates/`; whatever is put into it is escaped."""

from __future__ import annotations

from typing import Any

from physgen.resources import resource


def template(name: str) -> Any:
    """A Jinja template that finds its parts beside it, and fails where something is missing."""
    import jinja2

    loader = jinja2.FileSystemLoader(resource("templates", name).parent)
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    return environment.get_template(name)
