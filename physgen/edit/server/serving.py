"""A scene's path -> the editor, served until it is stopped."""

from __future__ import annotations

import json
import secrets
import socket
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.request import Request, urlopen

import uvicorn

from physgen.edit.journal import running_at
from physgen.edit.rendering import Rendering
from physgen.edit.server.api import addressed
from physgen.edit.server.app import application
from physgen.edit.server.events import Windows
from physgen.edit.server.guard import TOKEN
from physgen.edit.server.keys import Keys
from physgen.edit.session import Session
from physgen.problems import InputError

__all__ = ["Editor", "Place", "invited", "running_at"]


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
    asked = Request(f"{base}/api/once", b"{}", headers, method="POST")
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
