"""A real server of a scene that may be edited: in a thread, or in a process that may be killed."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from desk import Desk, seated
from served import Killable, Served, behind_a_server, client

SCENES = Path(__file__).parents[2] / "scenes"


@pytest.fixture
def copied(tmp_path: Path) -> Callable[[str], Path]:
    """A bundled scene in a folder of its own: `billiards`, or `physics/05-slide`."""

    def copy(name: str) -> Path:
        folder = tmp_path / name.rpartition("/")[2]
        file = SCENES / f"{name}.yaml"
        if file.is_file():
            folder.mkdir()
            return Path(shutil.copy(file, folder / "scene.yaml"))
        shutil.copytree(SCENES / name, folder)
        return folder / "scene.yaml"

    return copy


@pytest.fixture
def serving(copied: Callable[[str], Path]) -> Iterator[Callable[..., Served]]:
    """A scene, by name or path, behind a server in a thread; any number of them."""
    with ExitStack() as running:

        def serve(scene: str | Path, **told: Any) -> Served:
            path = copied(scene) if isinstance(scene, str) else scene
            return running.enter_context(behind_a_server(path, **told))

        yield serve


@pytest.fixture
def scene(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """The test module's SCENE in a file of its own."""
    path = tmp_path / "scene.yaml"
    path.write_text(request.module.SCENE, encoding="utf-8")
    return path


@pytest.fixture
def served(serving: Callable[..., Served], scene: Path) -> Served:
    """That scene behind a server."""
    return serving(scene)


@pytest.fixture
def desk(browser: Any, served: Served) -> Iterator[Desk]:
    """The editor's page with that scene."""
    with seated(browser, served.address) as page:
        yield page


@pytest.fixture
def killable(copied: Callable[[str], Path]) -> Iterator[Callable[..., Killable]]:
    """A scene, by name or path, behind `physgen edit` in a process of its own; any number of them."""
    running: list[Killable] = []

    def serve(scene: str | Path, *flags: str) -> Killable:
        path = copied(scene) if isinstance(scene, str) else scene
        command = [
            sys.executable,
            "-m",
            "physgen",
            "edit",
            str(path),
            "--no-browser",
            "--json",
            *flags,
        ]
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, env=dict(os.environ)
        )
        assert process.stdout is not None
        address = json.loads(process.stdout.readline())["address"]
        served = Killable(path, address, client(address))
        served.process = process
        running.append(served)
        return served

    yield serve
    for served in running:
        served.client.close()
        if served.process.poll() is None:
            served.process.send_signal(signal.SIGINT)
        served.process.communicate(timeout=60)
