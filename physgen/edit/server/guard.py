"""Requests -> those that our own page sent: the right Host and Origin, the token, a body that is not too large.

A page of another site can make a browser send requests here, and can point its own name at this machine: names and
origins are therefore held against those that we serve, and all that tells or changes something needs the token.
"""

from __future__ import annotations

import ipaddress
import json
import secrets
import socket
from collections.abc import Iterable
from typing import Any

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from physgen.edit.refusing import EditError, Why
from physgen.edit.server.limits import BODY

TOKEN = "x-physgen-token"
RESULT = "/result/"
"""What was rendered: its address holds a key that is as good as the token, as a link carries no header."""
OPEN = ("/static/", RESULT)
"""Addresses that need no token: they hold nothing of anybody, or have a key of their own."""
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
    """Of what was rendered: its own scripts run, in an origin of their own that reaches nothing of ours."""
    own = f"data: blob: 'self' http://{host}"
    policy = (
        "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
        f"font-src data:; img-src {own}; media-src {own}; base-uri 'none'; form-action 'none'"
    )
    return HEADERS | {"Content-Security-Policy": policy, "Cross-Origin-Resource-Policy": "cross-origin"}


class Guard:
    """ASGI middleware that answers what it refuses."""

    def __init__(self, app: ASGIApp, token: str, host: str, port: int) -> None:
        self.app, self.token, self.host, self.port = app, token, host, port

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return

        async def headed(message: Message) -> None:
            if message["type"] == "http.response.start":
                is_result = scope["path"].startswith(RESULT)
                said = result_headers(f"{self.host}:{self.port}") if is_result else HEADERS
                own = [(key.lower().encode(), value.encode()) for key, value in said.items()]
                names = {key for key, _ in own}
                message["headers"] = [(k, v) for k, v in message["headers"] if k not in names] + own
            await send(message)

        try:
            self._admit(scope)
        except EditError as error:
            await refuse(error, headed)
            return
        await self.app(scope, receive, headed)

    def _admit(self, scope: Scope) -> None:
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
        most = BODY
        if length.isascii() and length.isdecimal() and (len(length) > 12 or int(length) > most):
            raise too_large(most)

    def is_ours(self, host: str) -> bool:
        """Whether a Host header is one that we serve."""
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
        try:  # a name can be pointed at us by anybody, an address cannot
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True


def too_large(most: int) -> EditError:
    """A body beyond its limit."""
    return EditError(Why.TOO_LARGE, f"the body is larger than {most // 2**20} MiB", "send less")


async def refuse(error: EditError, send: Send) -> None:
    """The answer to a refused request."""
    body = json.dumps(error.body()).encode()
    headers: Iterable[tuple[bytes, bytes]] = [
        (b"content-type", b"application/json"),
        (b"content-length", str(len(body)).encode()),
    ]
    start: dict[str, Any] = {
        "type": "http.response.start",
        "status": error.why.value,
        "headers": list(headers),
    }
    await send(start)
    await send({"type": "http.response.body", "body": body})
