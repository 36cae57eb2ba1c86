"""What a model is asked, what is made of its answers, and what is asked only once."""

from __future__ import annotations

import json
import time
from base64 import b64decode
from pathlib import Path

import cv2
import numpy as np
import pytest
import vlm_stub as stubs
from misbehaviours import photo
from vlm_stub import BALL, Stub, asked, pictures, said

from physgen import registry
from physgen.cli.main import main
from physgen.geometry.polygon import Disc
from physgen.perceive.roles import Category, PhotoObject
from physgen.problems import InputError
from physgen.registry import Setup
from physgen.scene.scene import Solid


def balls(
    *centers: tuple[float, float, float], label: str = "rubber ball"
) -> list[PhotoObject]:
    return [
        PhotoObject(k, Disc(np.array([x, y]), r), label)
        for k, (x, y, r) in enumerate(centers, 1)
    ]


def drawn(
    things: list[PhotoObject], size: tuple[int, int] = (200, 120)
) -> tuple[np.ndarray, np.ndarray]:
    rgb = np.full((size[1], size[0], 3), (90, 120, 90), np.uint8)
    labels = np.zeros(rgb.shape[:2], np.uint16)
    for thing in things:
        x, y = np.rint(thing.outline.center).astype(int)
        cv2.circle(
            rgb, (int(x), int(y)), round(thing.outline.radius), (200, 40, 30), -1
        )
        cv2.circle(labels, (int(x), int(y)), round(thing.outline.radius), thing.id, -1)
    return rgb, labels


def seen(url: str) -> np.ndarray:
    head, _, data = url.partition(",")
    assert head == "data:image/png;base64"
    return cv2.imdecode(np.frombuffer(b64decode(data), np.uint8), cv2.IMREAD_COLOR)[
        ..., ::-1
    ]


@pytest.mark.slow
def test_a_second_run_asks_nothing_and_writes_the_same_bytes(
    vlm_stub: Stub, tmp_path: Path
):
    image, masks = photo(tmp_path)
    scenes = []
    for name in ("a", "b"):
        scene = tmp_path / name / "scene.yaml"
        scene.parent.mkdir()
        words = ["--backend", "label=vlm", "--backend", "physics=vlm", "-o", str(scene)]
        assert main(["perceive", str(image), "--masks", str(masks), *words]) == 0
        scenes.append(scene.read_bytes())
        steps = json.loads(
            (scene.parent / "scene.assets" / "perceived.json").read_text()
        )["steps"]
        note = next(step["note"] for step in steps if step["role"] == "physics")
        assert (note["requests"], note["cached"]) == ((1, 0) if name == "a" else (0, 1))
        assert (note["tokens_in"], note["tokens_out"]) == (
            (1000, 100) if name == "a" else (0, 0)
        )
        assert note["model"] == "stub"
    assert len(vlm_stub.requests) == 2
    assert scenes[0] == scenes[1]
    assert b"label: rubber ball" in scenes[0]


def test_the_request(vlm_stub: Stub):
    things = balls((50, 60, 20))
    rgb, _ = drawn(things)
    matter = registry.make("physics", "vlm")(rgb, things, 400.0)[1]
    (request,) = vlm_stub.requests
    path, headers, _ = vlm_stub.heads[0]
    assert path == "/v1/chat/completions"
    assert headers["authorization"] == f"Bearer {stubs.KEY}"
    assert (request["model"], request["temperature"], request["seed"]) == (
        "stub",
        0.0,
        0,
    )
    assert "by the photo's scale it is about 0.1" in said(request)  # 40 px at 400 px/m
    assert '"rubber ball"' in said(request)
    whole, close = (seen(url) for url in pictures(request))
    assert whole.shape == rgb.shape
    assert (whole[60, 50] == rgb[60, 50]).all()  # of the object nothing is hidden
    assert (whole[60, 29] == (255, 0, 255)).all()  # and it is outlined
    assert (whole[5, 190] == rgb[5, 190]).all()
    assert max(close.shape) == 256
    middle = close[close.shape[0] // 2, close.shape[1] // 2].astype(int)
    assert np.abs(middle - rgb[60, 50]).max() < 6
    assert close[3, 3].max() < 0.5 * rgb[5, 190].max()  # what is around it is dark
    assert (matter.mass, matter.friction, matter.elasticity, matter.rolling) == (
        72,
        0.8,
        0.75,
        0.02,
    )
    assert (matter.solid, matter.size, matter.material) == (
        Solid.SPHERE,
        0.05,
        "rubber",
    )


def test_things_that_are_alike_are_asked_about_once(vlm_stub: Stub):
    things = balls((30, 60, 20), (80, 60, 20), (130, 60, 22), (175, 60, 10))
    rgb, _ = drawn(things)
    found = registry.make("physics", "vlm")(rgb, things, None)
    assert len(vlm_stub.requests) == 2  # three of about one size, and a small one
    assert found[1].mass == found[2].mass == 72
    assert found[3].mass == pytest.approx(72 * 1.1**3, rel=5e-3)
    assert found[3].size == pytest.approx(0.055)
    assert "asked once for 3 alike" in found[1].reason
    assert "asked once" not in found[4].reason


def test_names(vlm_stub: Stub):
    things = balls((40, 60, 20), (90, 60, 20), (150, 60, 10), label="")
    rgb, labels = drawn(things)
    good = (
        lambda http, body, name=name: http.say(json.dumps({"name": name}))
        for name in ("A Can.", "cup\n# red")
    )
    vlm_stub.act = stubs.first(lambda http, body: http.say('{"name": "."}'), *good)
    names = registry.make("label", "vlm")(rgb, labels, things)
    assert sorted(name.label for name in names.values()) in (
        ["can", "can", "cup # red"],
        ["can", "cup # red", "cup # red"],
    )
    assert names[1] == names[2]


def test_categories(vlm_stub: Stub):
    rgb = np.zeros((60, 80, 3), np.uint8)
    assert registry.make("categories", "vlm")(rgb) == [
        Category("ball", True), Category("block", True), Category("wall", False),
    ]  # fmt: skip
    kinds = [
        {"noun": "Ball", "movable": True},
        {"noun": "cup", "movable": True},
        {"noun": "ball", "movable": False},
    ]
    vlm_stub.act = stubs.saying(json.dumps({"categories": kinds}))
    assert registry.make("categories", "vlm")(rgb + 1) == [
        Category("ball", False),
        Category("cup", True),
    ]


def test_no_password_is_read_from_a_file_or_shown(
    monkeypatch: pytest.MonkeyPatch, vlm_stub: Stub
):
    hidden = vlm_stub.url.replace("//", "//me:secret@")
    with pytest.raises(InputError, match=r"vlm\.url"):
        registry.make("physics", "vlm", Setup(options={"url": hidden}))
    monkeypatch.setenv("PHYSGEN_VLM_URL", hidden)
    things = balls((50, 60, 20))
    run = registry.make("physics", "vlm")
    run(drawn(things)[0], things, None)
    assert run.note()["server"] == vlm_stub.url


def test_a_broken_cache_is_no_cache(vlm_stub: Stub, tmp_path: Path):
    things = balls((50, 60, 20))
    rgb, _ = drawn(things)
    run = registry.make("physics", "vlm")
    first = run(rgb, things, None)
    (file,) = (tmp_path / "cache").rglob("*.json")
    assert stubs.KEY not in file.read_text()
    for count, broken in enumerate(
        (b"", b"\xff{", b"[" * 9999, b'{"mass": -1}', b"null"), 2
    ):
        file.write_bytes(broken)
        assert run(rgb, things, None) == first
        assert len(vlm_stub.requests) == count
    run(rgb + 1, things, None)  # another photo
    assert len(vlm_stub.requests) == 7
    file.parent.parent.chmod(0o500)
    registry.make("physics", "vlm", Setup("another"))(rgb, things, None)
    assert vlm_stub.requests[-1]["model"] == "another"
    file.parent.parent.chmod(0o700)


def test_what_is_not_configured_is_told(
    monkeypatch: pytest.MonkeyPatch, vlm_stub: Stub
):
    def told(setup: Setup = Setup()) -> str:  # noqa: B008
        with pytest.raises(InputError) as error:
            registry.make("physics", "vlm", setup)
        return str(error.value)

    lines = told(Setup(options={"timeout": 0, "timout": 3, "model": 1})).splitlines()
    assert len(lines) == 3
    assert any(
        '"timout" is not a key of this table; did you mean timeout?' in line
        for line in lines
    )
    monkeypatch.setenv("PHYSGEN_VLM_URL", "localhost:8000")
    assert "not an address; write e.g. http://localhost:8000/v1" in told()
    monkeypatch.delenv("PHYSGEN_VLM_URL")
    assert "set PHYSGEN_VLM_URL and PHYSGEN_VLM_MODEL" in told()


def test_questions_are_put_at_the_same_time_and_answers_keep_their_order(
    vlm_stub: Stub,
):
    def weighed(http, body):
        assert asked(body) == "physics"
        number = int(said(body).partition('"ball number ')[2].partition('"')[0])
        http.say(json.dumps(BALL | {"mass": 10.0 * number}))

    vlm_stub.act = weighed
    things = [
        PhotoObject(k, Disc(np.array([20.0 * k, 60.0]), 8.0), f"ball number {k}")
        for k in range(1, 9)
    ]
    found = registry.make("physics", "vlm")(drawn(things)[0], things, None)
    assert [found[k].mass for k in range(1, 9)] == [10.0 * k for k in range(1, 9)]


def test_a_failure_breaks_off_what_is_under_way(vlm_stub: Stub):
    def act(http, body):
        refuse = '"ball 1"' in said(body)
        (stubs.status(401, "no") if refuse else stubs.hang)(http, body)

    vlm_stub.act = act
    things = [
        PhotoObject(k, Disc(np.array([20.0 * k, 60.0]), 8.0), f"ball {k}")
        for k in range(1, 9)
    ]
    run = registry.make("physics", "vlm", Setup(options={"timeout": 30}))
    started = time.monotonic()
    with pytest.raises(InputError, match="fails"):
        run(drawn(things)[0], things, None)
    assert time.monotonic() - started < 10
    assert len(vlm_stub.requests) <= 5
