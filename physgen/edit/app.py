"""The editor's server: the application, its page, the check of requests, and the
socket.

A page of another site can make a browser send requests to this server, and can point
its own host name at this machine. The server therefore compares host and origin with
its own, and requires the token for every request that reads or changes the scene.
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

import jinja2
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
from physgen.problems import EditError, EditRefusal, InputError

PLAYER = ("motion", "clock", "scene", "balls", "touch", "units", "quantities", "layers")
"""Scripts of the report's player, without its charts and page, joined in this order."""
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
    """Create the application: the page and the interface of a session."""
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


def page(services: Served, once: str | None = None) -> Response:
    """Return the page, without data of the scene.

    A one-time key is exchanged for the token by a redirection.
    """
    # A one-time key opens the page once: exchange it for the token, so that the key in
    # the history of the browser is worthless.
    if once is not None and once in services.page_keys:
        services.page_keys.discard(once)
        return RedirectResponse(f"/?token={services.token}", 303)

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
    """Return a script or a style: a name on the list, or a plain name in the folder
    `edit`.
    """
    data = None
    with suppress(FileNotFoundError):
        if name == "player.js":
            # The player of reports and the editor share these scripts.
            scripts = []
            for script in PLAYER:
                scripts.append(
                    resource("templates", "player", f"{script}.js").read_bytes()
                )
            data = b'"use strict";\n' + b"\n".join(scripts)
        elif name == SCHEMA:
            data = resource("schemas", name).read_bytes()
        elif name in STYLES or _PART(name):
            data = resource("templates", *name.split("/")).read_bytes()
    if data is None:
        raise EditError(
            EditRefusal.ABSENT,
            f"there is no {name[:80]}",
            "open the address as it was printed",
        )
    return Response(data, media_type=guess_type(name)[0])


async def _answer(request: Request, error: Exception) -> Response:
    """Convert an exception to an answer with a message, a fix and its problems."""
    problems: list[dict[str, Any]] = []
    headers: Mapping[str, str] | None = None
    match error:
        case EditError():
            return JSONResponse(error.body(), error.why.value)
        # A problem of the scene that no edit expected: the page lists all problems, and
        # shows the first as the message.
        case InputError():
            first = error.problems[0]
            problems = []
            for problem in error.problems:
                problems.append(problem.as_dict() | {"object": None})
            status = EditRefusal.IMPOSSIBLE.value
            fix = first.fix
            message = " ".join(part for part in (first.found, first.expected) if part)
        case RequestValidationError():
            first_error = error.errors()[0]
            location = ".".join(map(str, first_error["loc"][1:]))
            status = EditRefusal.MALFORMED.value
            fix = "see /api/openapi.json"
            message = f"{location}: {first_error['msg']}"[:300]
        case HTTPException():
            status = error.status_code
            message = str(error.detail).lower()
            fix = "see /api/openapi.json"
            headers = error.headers
        case OSError():  # the disk is full, or may not be written
            location = ""
            if isinstance(error.filename, str):
                location = f"{Path(error.filename).name}: "
            message = f"{location}{(error.strerror or 'it could not be read or written').lower()}"
            status = 507
            fix = "make room, or correct the permissions, and try again"
        case _:
            status = 500
            message = f"the editor failed: {type(error).__name__}"
            fix = "undo, and please report it"
    return JSONResponse(
        {"error": {"message": message, "fix": fix}, "problems": problems},
        status,
        headers,
    )


# Checks of requests

BODY = 8 * 2**20 + 2**16
"""Maximum size of a body, bytes: a scene file is at most 8 MiB."""
ESCAPED_SURROGATE = re.compile(rb"\\u[dD][89a-fA-F]")
RESULT = "/result/"
"""Folder of rendered files: their address contains a key, as a link carries no header.
"""
OPEN = ("/static/", RESULT)
"""Addresses that need no token: public files, and files with a key in the address."""
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
    """Return the headers of rendered files.

    Their scripts run in an origin of their own, which cannot reach the editor.
    """
    source_list = f"data: blob: 'self' http://{host}"
    policy = (
        "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
        f"font-src data:; img-src {source_list}; media-src {source_list}; base-uri 'none'; form-action 'none'"
    )
    return HEADERS | {
        "Content-Security-Policy": policy,
        "Cross-Origin-Resource-Policy": "cross-origin",
    }


class Guard:
    """ASGI middleware that answers the requests it refuses, and adds headers to all
    answers.
    """

    def __init__(self, app: ASGIApp, token: str, host: str, port: int) -> None:
        self.app = app
        self.token = token
        self.host = host
        self.port = port

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            return

        async def send_with_headers(message: ServerMessage) -> None:
            if message["type"] == "http.response.start":
                is_result = scope["path"].startswith(RESULT)
                if is_result:
                    headers = result_headers(f"{self.host}:{self.port}")
                else:
                    headers = HEADERS
                added_headers = []
                for key, value in headers.items():
                    added_headers.append((key.lower().encode(), value.encode()))
                # A header of the handler with the same name is replaced, so that it
                # cannot weaken ours.
                names = {key for key, _ in added_headers}
                message["headers"] = [
                    (k, v) for k, v in message["headers"] if k not in names
                ] + added_headers
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
        headers = Headers(scope=scope)
        path = scope["path"]
        fix = "open the address as it was printed"
        host_count = [key for key, _ in scope["headers"]].count(b"host")
        if host_count != 1 or not self.is_ours(headers["host"]):
            raise EditError(
                EditRefusal.FOREIGN, "the Host header names another server", fix
            )
        if _is_foreign(headers, path):
            raise EditError(EditRefusal.FOREIGN, "another site's page asks", fix)
        if path == "/" or path.startswith(OPEN):
            return
        sent_token = headers.get(TOKEN, "")
        if not secrets.compare_digest(sent_token.encode(), self.token.encode()):
            raise EditError(EditRefusal.UNTRUSTED, "the token is missing or wrong", fix)
        length = headers.get("content-length", "0")
        if not (length.isascii() and length.isdecimal()):
            return
        if len(length) > 12 or int(length) > BODY:
            raise too_large()

    def is_ours(self, host: str) -> bool:
        """Check whether a Host header names this server."""
        name, mark, port = host.rpartition(":")
        if not mark or host.endswith("]"):
            name = host
            port = "80"
        if port != str(self.port):
            return False
        name = name.strip("[]").lower()
        own_names = {"localhost", "127.0.0.1", "::1", self.host.lower()}
        if name in own_names:
            return True
        if self.host not in ("0.0.0.0", "::"):
            return False
        if name == socket.gethostname().lower():
            return True
        # On all interfaces, every numerical address is accepted: a stranger can point
        # a name at this machine, but not an address.
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True


async def _body(scope: Scope, receive: Receive) -> Receive:
    """Read the whole body and return a `receive` to replay it.

    Raises EditError if the body is too large or is not JSON.
    """
    if scope["method"] not in ("POST", "PUT"):
        return receive
    data = bytearray()
    has_more = True
    while has_more:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise EditError(
                EditRefusal.MALFORMED, "the body ended early", "send it again"
            )
        data += message.get("body", b"")
        has_more = message.get("more_body", False)
        # Clients can send more than the Content-Length header announces, or omit the
        # header.
        if len(data) > BODY:
            raise too_large()
    kind = (
        Headers(scope=scope).get("content-type", "").partition(";")[0].strip().lower()
    )
    if data and kind != "application/json":
        raise EditError(
            EditRefusal.KIND,
            "the body is not declared as JSON",
            "send Content-Type: application/json",
        )
    if ESCAPED_SURROGATE.search(data):
        # Text that is not JSON passes here, since its reader refuses it. An escaped
        # surrogate alone is valid JSON but cannot be stored as UTF-8.
        with suppress(ValueError):
            try:
                json.dumps(json.loads(data), ensure_ascii=False).encode()
            except UnicodeEncodeError:
                raise EditError(
                    EditRefusal.MALFORMED,
                    "half a character is no text",
                    "send whole characters",
                ) from None
    parts = iter([{"type": "http.request", "body": bytes(data), "more_body": False}])

    async def receive_again() -> ServerMessage:
        return next(parts, None) or await receive()

    return receive_again


def _is_foreign(headers: Headers, path: str) -> bool:
    """Check whether the page of another site sends a request.

    Browsers send the origin with every request that changes something, and the site
    with every request: either one tells. Links from other sites may only open the page
    itself and rendered files.
    """
    own_origin = f"http://{headers['host']}"
    if headers.get("origin", own_origin) != own_origin:
        return True
    if path == "/" or path.startswith(RESULT):
        return False
    return headers.get("sec-fetch-site") in ("cross-site", "same-site")


def too_large() -> EditError:
    """Return the error for a body beyond the limit."""
    return EditError(
        EditRefusal.TOO_LARGE,
        f"the body is larger than {BODY // 2**20} MiB",
        "send less",
    )


# The server


class Editor:
    """The server of one scene, which listens from its construction on and answers in
    `run`.

    `port` None stands for any free port. Raises InputError if the scene cannot be
    opened or the address is in use, BusyError if another editor has the scene.
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
            if host in ("0.0.0.0", "::"):
                url_host = "127.0.0.1"
            else:
                url_host = host
            if ":" in url_host:
                url_host = f"[{url_host}]"
            self.address = f"http://{url_host}:{self.port}/?token={self.token}"
            self.session.draft.listens(self.address)
        # The session has locked the draft folder: release it if the server cannot
        # listen.
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

    def new_page_key(self) -> str:
        """Create an address to open the page one time.

        The list of processes shows the browser's address to all users of the machine,
        hence the address of `new_page_key` must not contain the token.
        """
        key = secrets.token_urlsafe(24)
        self.services.page_keys.add(key)
        return f"{self.address.partition('?')[0]}?once={key}"

    def run(self) -> None:
        """Serve until `stop`, or Ctrl-C."""
        self.server.run(sockets=[self._socket])

    def stop(self) -> None:
        """Stop the server; may be called from any thread."""
        self.server.should_exit = True

    def close(self) -> Path | None:
        """Close the session and return the folder of its draft if it has unsaved
        changes.
        """
        self.rendering.stop()
        self._socket.close()
        return self.session.close()


def _listening(host: str, port: int | None) -> socket.socket:
    """Open a listening TCP socket. Raises InputError, which names the option to
    change.
    """
    if ":" in host:
        family = socket.AF_INET6
    else:
        family = socket.AF_INET
    # If the protocol is named, asyncio sets TCP_NODELAY; otherwise small answers wait
    # for 40 ms.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        # On Windows, this option would let two servers share a port.
        if IS_POSIX:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port or 0))
        listener.listen(128)
    except OSError as error:
        listener.close()
        if port:
            option = f"--port {port}"
        else:
            option = f"--host {host}"
        reason = (error.strerror or str(error)).lower()
        raise Message.PORT_UNUSABLE.error(option, reason=reason) from None
    return listener
