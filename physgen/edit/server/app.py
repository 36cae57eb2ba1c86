"""A Session -> the ASGI application: the page, what it is made of, and the interface."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from physgen import __version__
from physgen.edit.refusing import EditError, Why
from physgen.edit.rendering import Rendering
from physgen.edit.server.api import Answer, Api
from physgen.edit.server.events import Windows
from physgen.edit.server.guard import Guard
from physgen.edit.server.keys import Keys
from physgen.edit.session import Session
from physgen.problems import InputError
from physgen.resources import resource

PLAYER = ("motion", "clock", "scene", "balls", "touch", "units", "quantities", "layers")
"""The report's player, less its charts and its page: plain scripts, joined in this order."""
STYLES = ("page.css", "player.css", "edit.css")
SCHEMA = "scene-1.schema.json"
_PART = re.compile(r"edit/[a-z][a-z0-9_-]{0,40}\.(js|css)").fullmatch
_KINDS = {
    "json": "application/json",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
}


def application(
    session: Session, windows: Windows, rendering: Rendering, keys: Keys, token: str, host: str, port: int
) -> Guard:
    """What a server runs."""
    api = Api(session, windows, rendering, keys)
    app = Starlette(
        routes=[
            Route("/", page, methods=["GET"]),
            Route("/static/{name:path}", static, methods=["GET"]),
            *api.routes(),
        ],
        exception_handlers={
            EditError: _refused,
            InputError: _wrong,
            HTTPException: _http,
            OSError: _failed,
            Exception: _broken,
        },
    )
    app.router.redirect_slashes = False
    app.state.token, app.state.keys = token, keys
    return Guard(app, token, host, port)


async def page(request: Request) -> Response:
    """The editor's page; it holds nothing of the scene. A key that opens it one time is traded for the token."""
    key = request.query_params.get("once")
    if key is not None and request.app.state.keys.used(key):
        return RedirectResponse(f"/?token={request.app.state.token}", 303)
    return Response(await run_in_threadpool(_page), media_type="text/html; charset=utf-8")


async def static(request: Request) -> Response:
    """A script or a style of the package."""
    name = request.path_params["name"]
    found = await run_in_threadpool(part, name)
    if found is None:
        raise EditError(Why.ABSENT, f"there is no {name[:80]}", "open the address as it was printed")
    return Response(found, media_type=_KINDS[name.rpartition(".")[2]])


def part(name: str) -> bytes | None:
    """What the page is made of, by name: those that are listed, and files of the folder `edit` by a plain name."""
    try:
        if name == "player.js":
            scripts = [_read("templates", "player", f"{script}.js") for script in PLAYER]
            return b'"use strict";\n' + b"\n".join(scripts)
        if name == SCHEMA:
            return _read("schemas", name)
        if name in STYLES:
            return _read("templates", name)
        if _PART(name):
            return _read("templates", *name.split("/"))
    except FileNotFoundError:
        return None
    return None


def _read(*parts: str) -> bytes:
    path: Path = resource(*parts)
    return path.read_bytes()


@cache
def _environment() -> Any:
    import jinja2

    loader = jinja2.FileSystemLoader(resource("templates"))
    return jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)


def _page() -> str:
    text: str = _environment().get_template("edit.html.j2").render(version=__version__)
    return text


async def _refused(request: Request, error: Exception) -> Response:
    assert isinstance(error, EditError)
    headers = {"Allow": error.more["allow"]} if error.why is Why.METHOD else None
    return Answer(error.body(), error.why.value, headers)


async def _wrong(request: Request, error: Exception) -> Response:
    """Something about the scene that was not foreseen to be wrong."""
    assert isinstance(error, InputError)
    problems = [problem.as_dict() | {"object": None} for problem in error.problems]
    first = error.problems[0]
    message = " ".join(part for part in (first.found, first.expected) if part)
    told = {"error": {"message": message, "fix": first.fix}, "problems": problems}
    return Answer(told, Why.IMPOSSIBLE.value)


async def _http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    fix = "see /api/openapi.json"
    told = {"error": {"message": error.detail.lower(), "fix": fix}, "problems": []}
    return Answer(told, error.status_code, dict(error.headers or {}))


async def _failed(request: Request, error: Exception) -> Response:
    """The disk: full, or not to be written."""
    assert isinstance(error, OSError)
    where = f"{Path(error.filename).name}: " if isinstance(error.filename, str) else ""
    message = f"{where}{(error.strerror or 'it could not be read or written').lower()}"
    told = {
        "error": {"message": message, "fix": "make room, or mend the rights, and try again"},
        "problems": [],
    }
    return Answer(told, 507)


async def _broken(request: Request, error: Exception) -> Response:
    """A mistake of ours."""
    message = f"the editor failed: {type(error).__name__}"
    told = {"error": {"message": message, "fix": "undo, and please report it"}, "problems": []}
    return Answer(told, 500)
