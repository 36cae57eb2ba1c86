"""An OpenAI-compatible server on loopback that answers well or badly, as a test wants, and keeps what it was asked."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Event, Thread
from typing import Any

KEY = "sk-a-secret-that-nobody-may-see"
BALL = {
    "reason": "A rubber ball of about 5 cm, solid, near 1.1 g/cm³",
    "material": "rubber",
    "size": 0.05,
    "solid": "sphere",
    "mass": 72.0,
    "friction": 0.8,
    "elasticity": 0.75,
    "rolling": 0.02,
}
"""What a good model says of any object."""
KINDS = [
    {"noun": "ball", "movable": True},
    {"noun": "block", "movable": True},
    {"noun": "wall", "movable": False},
]


def asked(body: dict[str, Any]) -> str:
    """`categories`, `label` or `physics`: what a request is about."""
    text = said(body)
    return (
        "physics"
        if "- mass:" in text
        else "label"
        if '{"name":' in text
        else "categories"
    )


def said(body: dict[str, Any]) -> str:
    return "".join(
        part["text"]
        for part in body["messages"][0]["content"]
        if part["type"] == "text"
    )


def pictures(body: dict[str, Any]) -> list[str]:
    return [
        p["image_url"]["url"]
        for p in body["messages"][0]["content"]
        if p["type"] == "image_url"
    ]


def good(body: dict[str, Any]) -> dict[str, Any]:
    """The answer of a good model."""
    what = asked(body)
    if what == "physics":
        return dict(BALL)
    if what == "categories":
        return {"categories": KINDS}
    return {"name": "rubber ball"}


def well(http: Any, body: dict[str, Any]) -> None:
    http.say(json.dumps(good(body)))


def saying(text: str) -> Callable[[Any, dict[str, Any]], None]:
    """Always the same text."""
    return lambda http, body: http.say(text)


def changed(**keys: Any) -> Callable[[Any, dict[str, Any]], None]:
    """A good answer but for some keys."""
    return lambda http, body: http.say(json.dumps(good(body) | keys))


def prose(http: Any, body: dict[str, Any]) -> None:
    answer = json.dumps(good(body), indent=1)
    http.say(
        f"Sure! Here [1] is {{my}} analysis:\n```json\n{answer}\n```\nLet me know if you need more {{detail}}."
    )


def status(
    code: int, message: str, **headers: str
) -> Callable[[Any, dict[str, Any]], None]:
    """An error, as such servers word it."""
    body = json.dumps(
        {"error": {"message": message, "type": "error", "code": None}}
    ).encode()

    def act(http: Any, asked: dict[str, Any]) -> None:
        http.give(code, body, headers)

    return act


def hang(http: Any, body: dict[str, Any]) -> None:
    http.server.over.wait(20)


def closes(http: Any, body: dict[str, Any]) -> None:
    """Half an answer, and the line is dead."""
    http.send_response(200)
    http.send_header("Content-Type", "application/json")
    http.send_header("Content-Length", "1000")
    http.end_headers()
    http.wfile.write(b'{"id": "x", "choices": [{"mess')
    http.close_connection = True


def page(http: Any, body: dict[str, Any]) -> None:
    http.give(200, b"<html>Welcome to our <b>gateway</b></html>", {}, "text/html")


def demanding(http: Any, body: dict[str, Any]) -> None:
    """A server that wants neither temperature nor seed."""
    for name in ("temperature", "seed"):
        if name in body:
            return status(400, f"Unsupported parameter: '{name}'.")(http, body)
    return well(http, body)


def first(
    *acts: Callable[[Any, dict[str, Any]], None],
) -> Callable[[Any, dict[str, Any]], None]:
    """One after the other; the last for ever."""
    left = list(acts)

    def act(http: Any, body: dict[str, Any]) -> None:
        (left.pop(0) if len(left) > 1 else left[0])(http, body)

    return act


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.server.requests.append(body)
        self.server.heads.append(
            (
                self.path,
                {name.lower(): value for name, value in self.headers.items()},
                time.monotonic(),
            )
        )
        self.server.act(self, body)

    def say(self, text: str, finish: str = "stop") -> None:
        choice = {
            "index": 0,
            "finish_reason": finish,
            "message": {"role": "assistant", "content": text},
        }
        usage = {"prompt_tokens": 1000, "completion_tokens": 100, "total_tokens": 1100}
        whole = {
            "id": "x",
            "object": "chat.completion",
            "created": 0,
            "model": "stub",
            "choices": [choice],
        }
        self.give(200, json.dumps(whole | {"usage": usage}).encode(), {})

    def give(
        self,
        code: int,
        data: bytes,
        headers: dict[str, str],
        kind: str = "application/json",
    ) -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: Any) -> None:
        pass


class Stub:
    """The server, while a `with` lasts; `act` is what it does with a request, `requests` what it got."""

    def __init__(self, act: Callable[[Any, dict[str, Any]], None] = well) -> None:
        self._server: Any = ThreadingHTTPServer(("127.0.0.1", 0), _Handler)
        self._server.daemon_threads = True
        self._server.requests, self._server.heads, self._server.over = [], [], Event()
        self.act = act
        self.url = f"http://127.0.0.1:{self._server.server_port}/v1"

    @property
    def act(self) -> Callable[[Any, dict[str, Any]], None]:
        return self._server.act

    @act.setter
    def act(self, act: Callable[[Any, dict[str, Any]], None]) -> None:
        self._server.act = act

    @property
    def requests(self) -> list[dict[str, Any]]:
        return self._server.requests

    @property
    def heads(self) -> list[tuple[str, dict[str, str], float]]:
        return self._server.heads

    def __enter__(self) -> Stub:
        Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.over.set()
        self._server.shutdown()
        self._server.server_close()
