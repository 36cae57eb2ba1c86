"""Checks of requests before they are handled: host, origin, token, and the size and type of the body.

A page of another site can make a browser send requests here, and can point its own host name at this machine. Host
and origin are therefore compared with those that are served, and everything that reads or changes the scene needs
the token.
"""

from __future__ import annotations

import ipaddress
import secrets
import socket
import threading

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from physgen.edit.errors import EditError, Why

TOKEN = "x-physgen-token"
BODY = 8 * 2**20 + 2**16
"""Bytes of a body: a scene file is at most 8 MiB."""
MAX_KEYS = 100
"""One-time keys that wait to be used; the oldest expire."""
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
    return HEADERS | {"Content-Security-Policy": policy, "Cross-Origin-Resource-Policy": "cross-origin"}


class Guard:
    """ASGI middleware that answers the requests which it refuses, and adds headers to all answers."""

    def __init__(self, app: ASGIApp, token: str, host: str, port: int) -> None:
        self.app, self.token, self.host, self.port = app, token, host, port

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        if scope["type"] != "http":
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                is_result = scope["path"].startswith(RESULT)
                chosen = result_headers(f"{self.host}:{self.port}") if is_result else HEADERS
                own = [(key.lower().encode(), value.encode()) for key, value in chosen.items()]
                names = {key for key, _ in own}
                message["headers"] = [(k, v) for k, v in message["headers"] if k not in names] + own
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
        if [key for key, _ in scope["headers"]].count(b"host") != 1 or not self.is_ours(headers["host"]):
            raise EditError(
                Why.FOREIGN, "the Host header names another server", "open the address as it was printed"
            )
        origin = headers.get("origin")
        if origin is not None and origin != f"http://{headers['host']}":
            raise EditError(Why.FOREIGN, "another site's page asks", "open the address as it was printed")
        site = headers.get("sec-fetch-site")
        path = scope["path"]
        if site in ("cross-site", "same-site") and path != "/" and not path.startswith(RESULT):
            raise EditError(Why.FOREIGN, "another site's page asks", "open the address as it was printed")
        if path == "/" or path.startswith(OPEN):
            return
        given = headers.get(TOKEN, "")
        if not secrets.compare_digest(given.encode(), self.token.encode()):
            raise EditError(
                Why.UNTRUSTED, "the token is missing or wrong", "open the address as it was printed"
            )
        length = headers.get("content-length", "0")
        if length.isascii() and length.isdecimal() and (len(length) > 12 or int(length) > BODY):
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
    kind = Headers(scope=scope).get("content-type", "").partition(";")[0].strip().lower()
    if data and kind != "application/json":
        raise EditError(Why.KIND, "the body is not declared as JSON", "send Content-Type: application/json")
    parts = iter([{"type": "http.request", "body": bytes(data), "more_body": False}])

    async def receive_again() -> Message:
        return next(parts, None) or await receive()

    return receive_again


def too_large() -> EditError:
    """A body beyond its limit."""
    return EditError(Why.TOO_LARGE, f"the body is larger than {BODY // 2**20} MiB", "send less")


class Keys:
    """Keys that open the page one time: the address that a browser is started with is visible to all processes."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[str] = []

    def new(self) -> str:
        """A new key."""
        key = secrets.token_urlsafe(24)
        with self._lock:
            self._waiting = [*self._waiting[-MAX_KEYS + 1 :], key]
        return key

    def use(self, key: str) -> bool:
        """Whether the key was valid; it is not any more."""
        with self._lock:
            found = [one for one in self._waiting if secrets.compare_digest(one.encode(), key.encode())]
            self._waiting = [one for one in self._waiting if one not in found]
        return bool(found)
