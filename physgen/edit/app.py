"""The editor's server: the application, its page and static files, and the socket it listens at."""

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
from urllib.request import Request as UrlRequest
from urllib.request import urlopen

import uvicorn
from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from physgen import __version__
from physgen.edit.api import ERRORS, JsonAnswer, Served, Services, api, with_addresses
from physgen.edit.draft import running_at
from physgen.edit.errors import EditError, Why
from physgen.edit.events import Windows
from physgen.edit.guard import TOKEN, Guard, Keys
from physgen.edit.render_job import RenderJob
from physgen.edit.session import Session
from physgen.files import resource
from physgen.problems import InputError

__all__ = ["Editor", "Place", "invited", "running_at"]

PLAYER = ("motion", "clock", "scene", "balls", "touch", "units", "quantities", "layers")
"""Scripts of the report's player without its charts and page, joined in this order."""
STYLES = ("page.css", "player.css", "edit.css")
SCHEMA = "scene-1.schema.json"
MEDIA_TYPES = {
    "json": "application/json",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
}
_PART = re.compile(r"edit/[a-z][a-z0-9_-]{0,40}\.(js|css)").fullmatch


# The application


def application(services: Services) -> FastAPI:
    """The page and the interface of a session."""
    app = FastAPI(
        title="physgen edit",
        version=__version__,
        openapi_url="/api/openapi.json",
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
        responses=ERRORS,
        exception_handlers={
            EditError: _edit_error,
            InputError: _input_error,
            RequestValidationError: _invalid_request,
            HTTPException: _http_error,
            OSError: _disk_error,
            Exception: _internal_error,
        },
    )
    app.include_router(api)
    app.add_api_route("/", page, include_in_schema=False)
    app.add_api_route("/static/{name:path}", static, include_in_schema=False)
    app.state.services = services
    return app


def page(served: Served, once: str | None = None) -> Response:
    """The page, which holds nothing of the scene. A one-time key is exchanged for the token."""
    if once is not None and served.keys.use(once):
        return RedirectResponse(f"/?token={served.token}", 303)
    return Response(_page(), media_type="text/html; charset=utf-8")


def static(name: str) -> Response:
    """A script or a style of the package."""
    found = part(name)
    if found is None:
        raise EditError(Why.ABSENT, f"there is no {name[:80]}", "open the address as it was printed")
    return Response(found, media_type=MEDIA_TYPES[name.rpartition(".")[2]])


def part(name: str) -> bytes | None:
    """A file of the page: one that is listed, or a file of the folder `edit` with a plain name."""
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


# Errors as answers


def _refusal(status: int, message: str, fix: str, problems: list[dict[str, Any]] | None = None) -> Response:
    return JsonAnswer({"error": {"message": message, "fix": fix}, "problems": problems or []}, status)


async def _edit_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, EditError)
    return JsonAnswer(error.body(), error.why.value)


async def _input_error(request: Request, error: Exception) -> Response:
    """A problem of the scene that no edit expected."""
    assert isinstance(error, InputError)
    problems = [problem.as_dict() | {"object": None} for problem in error.problems]
    first = error.problems[0]
    message = " ".join(part for part in (first.found, first.expected) if part)
    return _refusal(Why.IMPOSSIBLE.value, message, first.fix, problems)


async def _invalid_request(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"][1:])
    message = f"{where}: {first['msg']}" if where else str(first["msg"])
    return _refusal(Why.MALFORMED.value, message[:300], "see /api/openapi.json")


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    answer = _refusal(error.status_code, str(error.detail).lower(), "see /api/openapi.json")
    answer.headers.update(error.headers or {})
    return answer


async def _disk_error(request: Request, error: Exception) -> Response:
    """The disk is full, or may not be written."""
    assert isinstance(error, OSError)
    where = f"{Path(error.filename).name}: " if isinstance(error.filename, str) else ""
    message = f"{where}{(error.strerror or 'it could not be read or written').lower()}"
    return _refusal(507, message, "make room, or correct the permissions, and try again")


async def _internal_error(request: Request, error: Exception) -> Response:
    return _refusal(500, f"the editor failed: {type(error).__name__}", "undo, and please report it")


# The server


@dataclass(frozen=True)
class Place:
    """Where the editor listens. Port None: that of the editor whose draft is continued, or any free one."""

    host: str = "127.0.0.1"
    port: int | None = None


class Editor:
    """The server of one scene. It listens once it is constructed and answers once it runs; `close` ends it.

    Raises InputError where the scene cannot be opened or the address is taken, BusyError where another editor has the
    scene.
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
        self.session = Session(path, allow_outside, self.windows.send)
        self.rendering = RenderJob(
            path, output, allow_outside, lambda status: self.windows.send(with_addresses(status))
        )
        try:
            self.windows.counted(self.session.count_windows)
            draft = self.session.document.draft
            before = draft.last_address()  # an open page finds its server again
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
        services = Services(self.session, self.windows, self.rendering, self.keys, self.token)
        app = Guard(application(services), self.token, place.host, self.port)
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
        """An address that opens the page one time: the list of processes shows it to all users of the machine."""
        return f"{self.address.partition('?')[0]}?once={self.keys.new()}"

    def run(self) -> None:
        """Serve until `stop`, or Ctrl-C."""
        self.server.run(sockets=[self._socket])

    def stop(self) -> None:
        """From any thread."""
        self.server.should_exit = True

    def close(self) -> Path | None:
        """Release the scene. Returns the folder of its draft where something is not saved."""
        self.rendering.stop()
        self._socket.close()
        return self.session.close()


def invited(address: str) -> str:
    """A one-time address of a running editor's page; the address itself where the editor does not answer."""
    base, _, token = address.partition("/?token=")
    headers = {TOKEN: token, "Content-Type": "application/json"}
    asked = UrlRequest(f"{base}/api/once", b"{}", headers, method="POST")
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
    # with the protocol named, asyncio sends small answers at once instead of after 40 ms
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
