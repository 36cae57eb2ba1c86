"""The editor's server: the application, its page, the checks of all requests, and the socket it listens at.

A page of another site can make a browser send requests here, and can point its own host name at this machine. Host
and origin are therefore compared with those that are served, and everything that reads or changes the scene needs
the token.
"""

from __future__ import annotations

import ipaddress
import json
import re
import secrets
import socket
from collections.abc import Mapping
from contextlib import suppress
from mimetypes import guess_type
from pathlib import Path
from typing import Any

import uvicorn
from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as ServerMessage

from physgen import __version__
from physgen.edit.api import TOKEN, Events, Served, Services, api
from physgen.edit.render_job import RenderJob
from physgen.edit.session import Session
from physgen.files import resource
from physgen.messages import Message
from physgen.operating_system import IS_POSIX
from physgen.problems import EditError, InputError, Why

PLAYER = ("motion", "clock", "scene", "balls", "touch", "units", "quantities", "layers")
"""Scripts of the report's player without its charts and page, joined in this order."""
STYLES = ("page.css", "player.css", "edit.css")
SCHEMA = "scene-1.schema.json"
_PART = re.compile(r"edit/[a-z][a-z0-9_-]{0,40}\.(js|css)").fullmatch


HANDLED = (
    EditError,
    InputError,
    RequestValidationError,
    HTTPException,
    OSError,
    Exception,
)


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
        exception_handlers=dict.fromkeys(HANDLED, _answer),
    )
    app.include_router(api)
    app.add_api_route("/", page, include_in_schema=False)
    app.add_api_route("/static/{name:path}", static, include_in_schema=False)
    app.state.services = services
    return app


def page(served: Served, once: str | None = None) -> Response:
    """The page, which holds nothing of the scene. A one-time key is exchanged for the token."""
    if once is not None and once in served.once:
        served.once.discard(once)
        return RedirectResponse(f"/?token={served.token}", 303)
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(resource("templates")),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return Response(
        environment.get_template("edit.html.j2").render(),
        media_type="text/html; charset=utf-8",
    )


def static(name: str) -> Response:
    """A script or a style: one that is listed, or a file of the folder `edit` with a plain name."""
    data = None
    with suppress(FileNotFoundError):
        if name == "player.js":
            scripts = [
                resource("templates", "player", f"{script}.js").read_bytes()
                for script in PLAYER
            ]
            data = b'"use strict";\n' + b"\n".join(scripts)
        elif name == SCHEMA:
            data = resource("schemas", name).read_bytes()
        elif name in STYLES or _PART(name):
            data = resource("templates", *name.split("/")).read_bytes()
    if data is None:
        raise EditError(
            Why.ABSENT, f"there is no {name[:80]}", "open the address as it was printed"
        )
    return Response(data, media_type=guess_type(name)[0])


async def _answer(request: Request, error: Exception) -> Response:
    """An exception as an answer."""
    problems: list[dict[str, Any]] = []
    headers: Mapping[str, str] | None = None
    match error:
        case EditError():
            return JSONResponse(error.body(), error.why.value)
        case InputError():  # a problem of the scene that no edit expected
            first = error.problems[0]
            problems = [
                problem.as_dict() | {"object": None} for problem in error.problems
            ]
            status, fix = Why.IMPOSSIBLE.value, first.fix
            message = " ".join(part for part in (first.found, first.expected) if part)
        case RequestValidationError():
            wrong = error.errors()[0]
            where = ".".join(str(part) for part in wrong["loc"][1:])
            status, fix = Why.MALFORMED.value, "see /api/openapi.json"
            message = f"{where}: {wrong['msg']}"[:300]
        case HTTPException():
            status, message, fix = (
                error.status_code,
                str(error.detail).lower(),
                "see /api/openapi.json",
            )
            headers = error.headers
        case OSError():  # the disk is full, or may not be written
            where = (
                f"{Path(error.filename).name}: "
                if isinstance(error.filename, str)
                else ""
            )
            message = f"{where}{(error.strerror or 'it could not be read or written').lower()}"
            status, fix = 507, "make room, or correct the permissions, and try again"
        case _:
            status, message = 500, f"the editor failed: {type(error).__name__}"
            fix = "undo, and please report it"
    return JSONResponse(
        {"error": {"message": message, "fix": fix}, "problems": problems},
        status,
        headers,
    )


# Checks of requests

BODY = 8 * 2**20 + 2**16
"""Bytes of a body: a scene file is at most 8 MiB."""
ESCAPED_SURROGATE = re.compile(rb"\\u[dD][89a-fA-F]")
RESULT = "/result/"
"""Rendered files: their address holds a key of its own, as a link carries no header."""
OPEN = ("/static/", RESULT)
"""Addresses that need no token: they hold nothing of the scene, or have a key of their own."""
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' blob: data:; media-src 'self' blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "X-Frame-Options": "DENY",
}


def result_headers(host: str) -> dict[str, str]:
    """Headers of rendered files: their scripts run in an origin of their own, which cannot reach the editor."""
    own = f"data: blob: 'self' http://{host}"
    policy = (
        "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
        f"font-src data:; img-src {own}; media-src {own}; base-uri 'none'; form-action 'none'"
    )
    return HEADERS | {
        "Content-Security-Policy": policy,
        "Cross-Origin-Resource-Policy": "cross-origin",
    }


class Guard:
    """ASGI middleware that answers the requests which it refuses, and adds headers to all answers."""

    def __init__(self, app: ASGIApp, token: str, host: str, port: int) -> None:
        self.app, self.token, self.host, self.port = app, token, host, port

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        if scope["type"] != "http":
            return

        async def send_with_headers(message: ServerMessage) -> None:
            if message["type"] == "http.response.start":
                is_result = scope["path"].startswith(RESULT)
                chosen = (
                    result_headers(f"{self.host}:{self.port}") if is_result else HEADERS
                )
                own = [
                    (key.lower().encode(), value.encode())
                    for key, value in chosen.items()
                ]
                names = {key for key, _ in own}
                message["headers"] = [
                    (k, v) for k, v in message["headers"] if k not in names
                ] + own
            await send(message)

        try:
            self._check(scope)
            body = await _body(scope, receive)
        except EditError as error:
            answer = JSONResponse(error.body(), error.why.value)
            await answer(scope, receive, send_with_headers)
            return
        await self.app(scope, body, send_with_headers)

    def _check(self, scope: Scope) -> None:
        headers, path = Headers(scope=scope), scope["path"]
        fix = "open the address as it was printed"
        if [key for key, _ in scope["headers"]].count(b"host") != 1 or not self.is_ours(
            headers["host"]
        ):
            raise EditError(Why.FOREIGN, "the Host header names another server", fix)
        is_foreign = headers.get("origin", own := f"http://{headers['host']}") != own
        site = headers.get("sec-fetch-site")
        if (
            site in ("cross-site", "same-site")
            and path != "/"
            and not path.startswith(RESULT)
        ):
            is_foreign = True
        if is_foreign:
            raise EditError(Why.FOREIGN, "another site's page asks", fix)
        if path == "/" or path.startswith(OPEN):
            return
        given = headers.get(TOKEN, "")
        if not secrets.compare_digest(given.encode(), self.token.encode()):
            raise EditError(Why.UNTRUSTED, "the token is missing or wrong", fix)
        length = headers.get("content-length", "0")
        if (
            length.isascii()
            and length.isdecimal()
            and (len(length) > 12 or int(length) > BODY)
        ):
            raise too_large()

    def is_ours(self, host: str) -> bool:
        """Whether a Host header names this server."""
        name, mark, port = host.rpartition(":")
        if not mark or host.endswith("]"):
            name, port = host, "80"
        if port != str(self.port):
            return False
        name = name.strip("[]").lower()
        known = {"localhost", "127.0.0.1", "::1", self.host.lower()}
        if name in known:
            return True
        if self.host not in ("0.0.0.0", "::"):
            return False
        if name == socket.gethostname().lower():
            return True
        try:  # anyone can point a name at this machine, but not an address
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True


async def _body(scope: Scope, receive: Receive) -> Receive:
    """A `receive` that has read the whole body. Raises EditError for a body that is too large or not JSON."""
    if scope["method"] not in ("POST", "PUT"):
        return receive
    data, more = bytearray(), True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise EditError(Why.MALFORMED, "the body ended early", "send it again")
        data += message.get("body", b"")
        more = message.get("more_body", False)
        if len(data) > BODY:
            raise too_large()
    kind = (
        Headers(scope=scope).get("content-type", "").partition(";")[0].strip().lower()
    )
    if data and kind != "application/json":
        raise EditError(
            Why.KIND,
            "the body is not declared as JSON",
            "send Content-Type: application/json",
        )
    if ESCAPED_SURROGATE.search(data):
        with suppress(ValueError):  # what is no JSON is refused by its reader
            try:
                json.dumps(json.loads(data), ensure_ascii=False).encode()
            except UnicodeEncodeError:
                raise EditError(
                    Why.MALFORMED,
                    "half a character is no text",
                    "send whole characters",
                ) from None
    parts = iter([{"type": "http.request", "body": bytes(data), "more_body": False}])

    async def receive_again() -> ServerMessage:
        return next(parts, None) or await receive()

    return receive_again


def too_large() -> EditError:
    """A body beyond its limit."""
    return EditError(
        Why.TOO_LARGE, f"the body is larger than {BODY // 2**20} MiB", "send less"
    )


# The server


class Editor:
    """The server of one scene. It listens once it is constructed and answers once it runs; `close` ends it.

    `port` None: any free one.

    Raises InputError where the scene cannot be opened or the address is taken, BusyError where another editor has the
    scene.
    """

    def __init__(
        self,
        path: Path,
        host: str = "127.0.0.1",
        port: int | None = None,
        allow_outside: bool = False,
        output: Path = Path("out"),
    ) -> None:
        self.token = secrets.token_urlsafe(24)
        events = Events()
        self.session = Session(path, allow_outside, events.send)
        self.rendering = RenderJob(path, output, allow_outside)
        try:
            self._socket = _listening(host, port)
            self.port: int = self._socket.getsockname()[1]
            shown = "127.0.0.1" if host in ("0.0.0.0", "::") else host
            shown = f"[{shown}]" if ":" in shown else shown
            self.address = f"http://{shown}:{self.port}/?token={self.token}"
            self.session.draft.listens(self.address)
        except BaseException:
            self.session.close()
            raise
        self.services = Services(
            self.session, events, self.rendering, self.token, set()
        )
        config = uvicorn.Config(
            Guard(application(self.services), self.token, host, self.port),
            access_log=False,
            log_level="critical",
            lifespan="off",
            server_header=False,
            timeout_graceful_shutdown=2,
            h11_max_incomplete_event_size=64 * 1024,
        )
        self.server = uvicorn.Server(config)

    def once(self) -> str:
        """An address that opens the page one time: the list of processes shows it to all users of the machine."""
        key = secrets.token_urlsafe(24)
        self.services.once.add(key)
        return f"{self.address.partition('?')[0]}?once={key}"

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


def _listening(host: str, port: int | None) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # with the protocol named, asyncio sends small answers at once instead of after 40 ms
    made = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        if IS_POSIX:  # elsewhere, this option lets two servers share a port
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind((host, port or 0))
        made.listen(128)
    except OSError as error:
        made.close()
        where = f"--port {port}" if port else f"--host {host}"
        reason = (error.strerror or str(error)).lower()
        raise Message.PORT_UNUSABLE.error(where, reason=reason) from None
    return made
