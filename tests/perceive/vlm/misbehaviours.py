"""How servers misbehave: the cases of the test."""

from __future__ import annotations

import contextlib
import io
import os
import re
import socket
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
import vlm_stub as stub

from physgen.cli.main import main
from physgen.perceive.backends import vlm

PATIENCE = "[vlm]\ntimeout = 0.4\n"
TRIES = replace(vlm.VLM, attempts=2, retries=1)
HEAVY = stub.changed(mass=2e6)
BUSY = stub.status(429, "Rate limit reached", Retry_After="1")
DOWN = stub.status(503, "The model is loading")
REFUSED = stub.status(401, f"Incorrect API key provided: {stub.KEY}")
UNKNOWN = stub.status(404, f"The model `stub` does not exist for {stub.KEY}")
TYPES = stub.changed(mass="heavy", elasticity=None)


@dataclass(frozen=True)
class Case:
    """One way to misbehave."""

    name: str
    act: Callable[[Any, dict[str, Any]], None] | None
    """None: nobody listens."""
    code: int
    requests: int
    """That the server gets."""


CASES = (
    Case("answers well", stub.well, 0, 1),
    Case("prose and a code fence around the JSON", stub.prose, 0, 1),
    Case("wrong types, once", stub.first(TYPES, stub.well), 0, 2),
    Case("out of range, once", stub.first(stub.changed(friction=7), stub.well), 0, 2),
    Case("impossible: 2 tonnes in 5 cm", HEAVY, 2, 2),
    Case("no JSON", stub.saying("I'm sorry, I can't tell."), 2, 2),
    Case("429, once, with Retry-After", stub.first(BUSY, stub.well), 0, 2),
    Case("503, always", DOWN, 2, 2),
    Case("hangs", stub.hang, 2, 2),
    Case("closes midway, once", stub.first(stub.closes, stub.well), 0, 2),
    Case("closes midway, always", stub.closes, 2, 2),
    Case("wants no temperature", stub.demanding, 0, 2),
    Case("refuses the key, and says it aloud", REFUSED, 2, 1),
    Case("does not know the model", UNKNOWN, 2, 1),
    Case("gives a web page", stub.page, 2, 1),
    Case("is not there", None, 2, 0),
)


@dataclass(frozen=True)
class Seen:
    """What came of a case."""

    code: int
    stderr: str
    scene: str
    requests: int


def photo(folder: Path) -> tuple[Path, Path]:
    """A drawn photo of a ball on a floor, and its label map."""
    picture = np.full((48, 64, 3), 90, np.uint8)
    picture[38:] = (60, 80, 100)
    cv2.circle(picture, (30, 30), 8, (40, 60, 200), -1, cv2.LINE_AA)
    labels = (
        np.hypot(*(np.mgrid[:48, :64] - np.array([30, 30])[:, None, None])) <= 8
    ).astype(np.uint16)
    for name, pixels in (("photo.png", picture), ("masks.png", labels)):
        cv2.imwrite(str(folder / name), pixels)
    return folder / "photo.png", folder / "masks.png"


def play(case: Case, folder: Path) -> Seen:
    """`physgen perceive --backend physics=vlm` against a server that behaves so."""
    image, masks = photo(folder)
    config = folder / "physgen.toml"
    config.write_text(PATIENCE)
    scene = folder / "scene.yaml"
    words = [
        "perceive",
        str(image),
        "--masks",
        str(masks),
        "--label",
        "ball-1=ball",
        "--config",
        str(config),
    ]
    words += ["--backend", "physics=vlm", "-o", str(scene)]
    told = io.StringIO()
    with stub.Stub(case.act or stub.well) as server:
        url = server.url if case.act else f"http://127.0.0.1:{_closed()}/v1"
        told_to = {
            "PHYSGEN_VLM_URL": url,
            "PHYSGEN_VLM_MODEL": "stub",
            "PHYSGEN_VLM_KEY": stub.KEY,
        }
        with (
            mock.patch.object(vlm, "VLM", TRIES),
            mock.patch.dict(
                os.environ, told_to | {"XDG_CACHE_HOME": str(folder / "cache")}
            ),
            contextlib.redirect_stderr(told),
        ):
            code = main(words)
        count = len(server.requests)
    text = scene.read_text() if scene.exists() else ""
    port = re.compile(r"127\.0\.0\.1:\d+")
    return Seen(code, port.sub("127.0.0.1:8000", told.getvalue()), text, count)


def _closed() -> int:
    """A port where nobody listens."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])
