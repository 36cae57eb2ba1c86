"""A scene behind a running server, and who asks it."""

from __future__ import annotations

import signal
import subprocess
import threading
from base64 import b64decode
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from physgen.cli.main import main
from physgen.edit.app import Editor, application
from physgen.simulate.trajectory import Trajectory, read_trajectory


def unpacked(text: str) -> np.ndarray:
    """Numbers of a motion: little-endian float64, base64."""
    return np.frombuffer(b64decode(text), "<f8")


def simulated(scene: Path, *flags: str) -> Trajectory:
    """What `physgen simulate` says of the file as it is saved."""
    out = scene.with_suffix(".npz")
    assert main(["simulate", str(scene), "-o", str(out), *flags]) == 0
    return read_trajectory(out)


@cache
def document() -> dict[str, Any]:
    """The interface as /api/openapi.json describes it."""
    return application(None).openapi()  # type: ignore[arg-type]


@dataclass
class Served:
    """A scene behind a running server, and a client that has its token."""

    scene: Path
    address: str
    client: httpx.Client
    editor: Editor | None = None
    state: dict[str, Any] = field(default_factory=dict)

    @property
    def token(self) -> str:
        return self.client.headers["X-Physgen-Token"]

    def get(self, path: str, **query: Any) -> Any:
        answer = self.client.get(path, params=query)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def look(self, variant: str | None = None) -> dict[str, Any]:
        self.state = self.get(
            "/api/state", **({} if variant is None else {"variant": variant})
        )
        return self.state

    def send(self, path: str, method: str = "POST", **body: Any) -> httpx.Response:
        """A request of the version that was seen last; its answer is the state that is seen."""
        version = self.state.get("version") or self.look()["version"]
        answer = self.client.request(
            method, path, json={"version": version, "variant": None, **body}
        )
        if answer.status_code == 200 and "version" in answer.json():
            self.state = answer.json()
        return answer

    def edit(self, *ops: dict[str, Any], **body: Any) -> dict[str, Any]:
        answer = self.send("/api/edit", ops=list(ops), **body)
        assert answer.status_code == 200, answer.text
        return self.state


def client(address: str) -> httpx.Client:
    base, _, token = address.partition("/?token=")
    return httpx.Client(base_url=base, headers={"X-Physgen-Token": token}, timeout=60)


@contextmanager
def behind_a_server(path: Path, **told: Any) -> Iterator[Served]:
    """A scene behind a server in a thread."""
    editor = Editor(path, **told)
    thread = threading.Thread(target=editor.run, daemon=True)
    thread.start()
    with client(editor.address) as asks:
        yield Served(path, editor.address, asks, editor)
    editor.stop()
    thread.join(30)
    editor.close()
    assert not thread.is_alive()


class Killable(Served):
    """Behind a server in a process of its own."""

    process: subprocess.Popen[str]

    def kill(self) -> None:
        """As when the power goes: nothing is tidied up."""
        self.client.close()
        self.process.send_signal(signal.SIGKILL)
        self.process.wait(30)
