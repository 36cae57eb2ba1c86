"""Checks of requests (host, origin, token, size), one-time keys, and events for open windows."""

from __future__ import annotations

import ipaddress
import json
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from physgen.edit.errors import EditError, Why

# ----------------------------------------------------------------------
# What happens -> every window that asks what is new; a window is there as long as it asks.
#
# Asked again and again, not told by a stream that stays open: a browser opens six connections to a server,
# and with as
# many streams a seventh window would wait for ever.

KEPT = 1000
"""Events that wait for the windows."""
PATIENCE = {False: 5.0, True: 130.0}
"""s without a question after which a window is gone: one that is seen, and a hidden one, which browsers slow down."""
MOST = 200
"""Windows that are counted."""


class Windows:
    """The windows that ask; told from any thread."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.run = secrets.token_urlsafe(6)
        """Another for each server: numbers of events begin anew."""
        self._clock = clock
        self._lock = threading.Lock()
        self._events: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._next = 0
        self._gone: dict[str, float] = {}
        """When a window that asks no more is gone."""
        self._left: dict[str, float] = {}
        """Until when a question of a window that was closed is its last one, which was under way."""
        self._told = 0
        self._counted: Callable[[int], None] = lambda count: None

    def counted(self, heard: Callable[[int], None]) -> None:
        """`heard` is told how many there are whenever that changes."""
        self._counted = heard

    def count(self) -> int:
        """How many there are."""
        with self._lock:
            return len(self._gone)

    def tell(self, event: dict[str, Any]) -> None:
        """Each of them; from any thread."""
        with self._lock:
            self._add(event)

    def ask(self, window: str, run: str, since: int, hidden: bool = False) -> dict[str, Any]:
        """What is new since event `since` of a server's `run`; from another run, only how many windows there are."""
        with self._lock:
            now = self._clock()
            self._left = {name: until for name, until in self._left.items() if until > now}
            if window not in self._left and (window in self._gone or len(self._gone) < MOST):
                self._gone[window] = now + PATIENCE[hidden]
            self._recount(now)
            if run != self.run:
                events = [{"type": "windows", "windows": self._told}]
            else:
                old = max(since - (self._next - len(self._events)), 0)
                events = list(self._events)[old:]
            return {"run": self.run, "next": self._next, "events": events}

    def leave(self, window: str) -> None:
        """A window that was closed."""
        with self._lock:
            now = self._clock()
            self._gone.pop(window, None)
            self._left[window] = now + PATIENCE[False]
            self._recount(now)

    def _recount(self, now: float) -> None:
        self._gone = {name: until for name, until in self._gone.items() if until > now}
        if len(self._gone) != self._told:
            self._told = len(self._gone)
            self._counted(self._told)
            self._add({"type": "windows", "windows": self._told})

    def _add(self, event: dict[str, Any]) -> None:
        self._events.append(event)
        self._next += 1


# ----------------------------------------------------------------------
# How much a request may hold.


BODY = 8 * 2**20 + 2**16
"""Bytes of a body: a scene file is at most 8 MiB."""
MAX_VALUES = 500_000
"""Texts, lists, objects and commas of a body: no fewer than values."""
MAX_OPS = 1000
MAX_WORDS = 200
"""Characters of `what`, `tag` and names."""
MAX_DEPTH = 40
RESOLVED = ("mine", "theirs", "merge")


# ----------------------------------------------------------------------
# Requests -> those that our own page sent: the right Host and Origin, the token, a body that is not too
# large.
#
# A page of another site can make a browser send requests here, and can point its own name at this machine:
# names and
# origins are therefore held against those that we serve, and all that tells or changes something needs the
# token.

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


# ----------------------------------------------------------------------
# Keys that open the page one time: an address that a browser is started with is read by all of the machine.

KEYS_MOST = 100
"""Keys that wait; the eldest are void."""


class Keys:
    """Those that were made and not used."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[str] = []

    def made(self) -> str:
        """A new one."""
        key = secrets.token_urlsafe(24)
        with self._lock:
            self._waiting = [*self._waiting[-KEYS_MOST + 1 :], key]
        return key

    def used(self, key: str) -> bool:
        """Whether it was good; it is no more."""
        with self._lock:
            found = [one for one in self._waiting if secrets.compare_digest(one.encode(), key.encode())]
            self._waiting = [one for one in self._waiting if one not in found]
        return bool(found)


# ----------------------------------------------------------------------
# Of what one window asks again and again only the newest is worked out.

T = TypeVar("T")


class Turns:
    """Which preview of a window is its newest: one that was overtaken is not worked out."""

    def __init__(self) -> None:
        self._newest: dict[str, int] = {}
        self._lock = threading.Lock()
        self._working = threading.Lock()

    def take(self, window: str) -> int:
        """A turn."""
        with self._lock:
            while window not in self._newest and len(self._newest) > 100:
                del self._newest[next(iter(self._newest))]
            self._newest[window] = turn = self._newest.get(window, 0) + 1
            return turn

    def when_newest(self, window: str, turn: int, work: Callable[[], T]) -> T:
        """The work done, or EditError where a newer turn was taken meanwhile."""
        with self._working:
            if self._newest.get(window) != turn:
                raise overtaken()
            return work()


def overtaken() -> EditError:
    """A newer request of the same window took its place."""
    return EditError(Why.STALE, "a newer request overtook this one", "wait for that one", {"overtaken": True})
