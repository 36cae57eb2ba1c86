"""The editor's server: its page, its static files and the address it listens at."""

from __future__ import annotations

import json
import re
import secrets
import socket
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any
from urllib.request import Request as Request_request
from urllib.request import urlopen

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from physgen import __version__
from physgen.edit.api import Answer, Api, addressed
from physgen.edit.errors import EditError, Why
from physgen.edit.guard import TOKEN, Guard, Keys, Windows
from physgen.edit.render_job import Rendering
from physgen.edit.session import Session
from physgen.files import resource
from physgen.problems import InputError

# ----------------------------------------------------------------------
# A Session -> the ASGI application: the page, what it is made of, and the interface.

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


# ----------------------------------------------------------------------
# A scene's path -> the editor, served until it is stopped.


@dataclass(frozen=True)
class Place:
    """Where the editor listens; port None: that of the editor whose draft is gone on with, or any that is free."""

    host: str = "127.0.0.1"
    port: int | None = None


class Editor:
    """The server of one scene: it listens once it is made, and answers once it runs; `close` ends it.

    Raises InputError where the scene cannot be opened or the place not be listened at, BusyError where another editor
    has the scene.
    """

    def __init__(
        self,
        path: Path,
        place: Place | None = None,
        allow_outside: bool = False,
        output: Path = Path("out"),
    ) -> None:
        place = place or Place()
        self.windows = Windows()
        self.keys = Keys()
        self.session = Session(path, allow_outside, self.windows.tell)
        self.rendering = Rendering(
            path, output, allow_outside, lambda status: self.windows.tell(addressed(status))
        )
        try:
            self.windows.counted(self.session.count_windows)
            draft = self.session.document.draft
            before = draft.place()  # an open page finds its server again
            token = before.get("token")
            self.token = token if isinstance(token, str) and token else secrets.token_urlsafe(24)
            self._socket = _found_again(place, before.get("port"))
            self.port: int = self._socket.getsockname()[1]
            self.address = self._address(place)
            draft.listens(self.port, self.token, self.address)
        except BaseException:
            self.session.close()
            raise
        self.server = self._made(place)

    def _address(self, place: Place) -> str:
        shown = "127.0.0.1" if place.host in ("0.0.0.0", "::") else place.host
        shown = f"[{shown}]" if ":" in shown else shown
        return f"http://{shown}:{self.port}/?token={self.token}"

    def _made(self, place: Place) -> uvicorn.Server:
        app = application(
            self.session, self.windows, self.rendering, self.keys, self.token, place.host, self.port
        )
        config = uvicorn.Config(
            app,
            access_log=False,
            log_level="critical",
            lifespan="off",
            server_header=False,
            timeout_graceful_shutdown=2,
            h11_max_incomplete_event_size=64 * 1024,
        )
        return uvicorn.Server(config)

    def once(self) -> str:
        """An address that leads to the page one time: it stands in the list of processes for all to read."""
        return f"{self.address.partition('?')[0]}?once={self.keys.made()}"

    def run(self) -> None:
        """Serve until `stop`, or Ctrl-C."""
        self.server.run(sockets=[self._socket])

    def stop(self) -> None:
        """From any thread."""
        self.server.should_exit = True

    def close(self) -> Path | None:
        """Let go of the scene; the folder of its draft where something in it is not saved."""
        self.rendering.stop()
        self._socket.close()
        return self.session.close()


def invited(address: str) -> str:
    """An address of a running editor that leads to its page one time; its own where it does not answer."""
    base, _, token = address.partition("/?token=")
    headers = {TOKEN: token, "Content-Type": "application/json"}
    asked = Request_request(f"{base}/api/once", b"{}", headers, method="POST")
    try:
        with urlopen(asked, timeout=5) as answer:
            return f"{base}/?once={json.load(answer)['key']}"
    except (OSError, ValueError, KeyError):
        return address


def _found_again(place: Place, before: object) -> socket.socket:
    """Where the editor before listened, if that is free and no other port is asked for."""
    if place.port is None and isinstance(before, int):
        with suppress(InputError, OverflowError):
            return _listening(replace(place, port=before))
    return _listening(place)


def _listening(place: Place) -> socket.socket:
    family = socket.AF_INET6 if ":" in place.host else socket.AF_INET
    # named, so that asyncio sends small answers at once: without it each waits 40 ms for the reader's word
    made = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind((place.host, place.port or 0))
        made.listen(128)
    except OSError as error:
        made.close()
        where = f"--port {place.port}" if place.port else f"--host {place.host}"
        reason = (error.strerror or str(error)).lower()
        fix = "leave it out, and a free port of this machine is taken"
        raise InputError.of(where, "", f"cannot be listened on: {reason}", fix) from None
    return made
