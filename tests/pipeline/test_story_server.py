"""Stories that a vision-language server tells, with a server that answers as a test wants."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from vlm_stub import Stub, first, hang, pictures, saying, status

from physgen.cli.main import main
from physgen.messages import Message
from physgen.pipeline import story_server

SCENE = """\
physgen: 1
size: [240, 160]
world: {duration: 1.5}
objects:
  ball: {shape: {circle: {center: [50, 130], radius: 10}}, mass: 300}
  bottle: {shape: {box: {center: [150, 110], size: [16, 60]}}, mass: 60}
boundaries:
  floor: {segment: [[-2000, 140.5], [2000, 140.5]]}
"""
SENTENCE = "the ball knocks over the bottle"
UNCLEAR = "everything ends up beside a new apple"
SPARING = ("--set", "render.frames=2", "--report", "none")


def proposal(*edits: dict[str, Any], **more: Any) -> str:
    return json.dumps({"reason": "it is hit high", "edits": list(edits), **more})


PUSH = {"action": "push", "object": "ball"}
RIGHT = proposal(PUSH | {"velocity": [6, -1.5]})
WRONG = proposal(PUSH | {"velocity": [0.01, 0]})
NEARER = proposal(PUSH | {"velocity": [0.9, 0]})
APPLE = {"action": "add", "object": "apple", "shape": "circle", "center": [60, 60]}
APPLE |= {"size": [40, 40], "mass": 150}


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Iterator[Stub]:
    with Stub() as server:
        monkeypatch.setenv("PHYSGEN_VLM_URL", server.url)
        monkeypatch.setenv("PHYSGEN_VLM_MODEL", "stub")
        yield server


def render(folder: Path, sentence: str = SENTENCE) -> dict[str, Any]:
    """Render a story; return the manifest."""
    scene = folder / "room.yaml"
    folder.mkdir(exist_ok=True)
    scene.write_text(SCENE)
    flags = ["--story", sentence, "-o", str(folder), *SPARING]
    assert main(["render", str(scene), *flags]) == 0
    text = (folder / "room" / "manifest.json").read_text()
    manifest: dict[str, Any] = json.loads(text)
    return manifest


def text_of(body: dict[str, Any], turn: int) -> str:
    content = body["messages"][turn]["content"]
    return content if isinstance(content, str) else str(content[0]["text"])


def test_first_proposal_is_right(
    stub: Stub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stub.act = saying(RIGHT)
    manifest = render(tmp_path)
    errors = capsys.readouterr().err
    assert "the story happens: " in errors
    assert "(1 tried)" in errors
    assert "velocity: [600.0, -150.0]" in errors
    assert "objects.ball.velocity=[600.0, -150.0]" in manifest["overrides"]
    assert len(stub.requests) == 1
    request = stub.requests[0]
    assert len(pictures(request)) == 1
    assert "bottle | " in text_of(request, 0)
    assert '"oneOf"' in text_of(request, 0)


def test_second_proposal_is_right(
    stub: Stub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stub.act = first(saying(WRONG), saying(RIGHT))
    render(tmp_path)
    assert "(2 tried)" in capsys.readouterr().err
    later = stub.requests[1]["messages"]
    assert [message["role"] for message in later] == ["user", "assistant", "user"]
    parts = later[2]["content"]
    assert "That is" in parts[0]["text"]
    assert len(parts) == 1 + 4


def test_three_wrong_proposals_give_the_nearest_outcome(
    stub: Stub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stub.act = first(saying(WRONG), saying(NEARER), saying(WRONG))
    manifest = render(tmp_path)
    errors = capsys.readouterr().err
    assert "the nearest outcome: ball " in errors
    assert len(stub.requests) == 3
    assert "objects.ball.velocity=[90.0, 0.0]" in manifest["overrides"]


@pytest.mark.parametrize(
    ("answer", "fault"),
    [
        ("no idea", "had no JSON"),
        (
            proposal(PUSH | {"velocity": [1, 0], "object": "zebra"}),
            "'zebra' is not one of",
        ),
        (proposal({"action": "fly", "object": "ball"}), "'fly' is not one of"),
        (proposal({"action": "push", "object": "ball"}), "'velocity' is a required"),
        (proposal(APPLE | {"object": "bottle"}), "is an object already"),
    ],
)
def test_bad_answer_counts_as_a_try(
    answer: str, fault: str, stub: Stub, tmp_path: Path
) -> None:
    stub.act = first(saying(answer), saying(RIGHT))
    render(tmp_path)
    assert fault in text_of(stub.requests[1], 2)


def test_useless_answers_fall_back_to_the_search(
    stub: Stub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stub.act = saying("no idea")
    render(tmp_path)
    errors = capsys.readouterr().err
    assert len(stub.requests) == 3
    assert errors.count("without any edit that can be used") == 1
    assert "the story happens" in errors


@pytest.mark.parametrize(
    "act",
    [status(401, "no such key"), pytest.param(hang, marks=pytest.mark.slow)],
    ids=["refuses", "hangs"],
)
def test_failing_server_falls_back_with_one_message(
    act: Any,
    stub: Stub,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settings = tmp_path / "physgen" / "physgen.toml"
    settings.parent.mkdir()
    settings.write_text("[vlm]\ntimeout = 0.05\n")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    stub.act = act
    render(tmp_path / "out")
    errors = capsys.readouterr().err
    assert errors.count("pushes are tried instead") == 1
    assert "--story: warning: " in errors
    assert "the story happens" in errors


def test_model_judges_a_sentence_that_is_not_understood(
    stub: Stub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add = proposal(APPLE, {"action": "remove", "object": "bottle"})
    verdict = proposal(nearness=1)
    stub.act = first(saying(add), saying(verdict))
    manifest = render(tmp_path, UNCLEAR)
    errors = capsys.readouterr().err
    assert "the story happens: apple ends " in errors
    assert "and remove objects.bottle" in errors
    assert "objects.bottle=" in manifest["overrides"]
    assert "nearness" in text_of(stub.requests[1], 2)


def test_best_of_judged_outcomes_is_reported(
    stub: Stub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    near = json.loads(NEARER)["edits"]
    slow = json.loads(WRONG)["edits"]
    replies = [proposal(*slow), proposal(*near, nearness=0.1)]
    replies += [proposal(*slow, nearness=0.6), proposal(nearness=0.2)]
    stub.act = first(*map(saying, replies))
    manifest = render(tmp_path, UNCLEAR)
    assert len(stub.requests) == 4
    assert "the nearest outcome" in capsys.readouterr().err
    assert "objects.ball.velocity=[90.0, 0.0]" in manifest["overrides"]


def test_sliding_object_does_not_rest(
    stub: Stub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stub.act = first(saying(RIGHT), saying(proposal()))
    manifest = render(tmp_path, "the ball stops")
    errors = capsys.readouterr().err
    assert "the story happens" in errors
    assert "(2 tried)" in errors
    assert not any("velocity=[600" in text for text in manifest["overrides"])


def test_late_failure_keeps_the_best_proposal(
    stub: Stub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stub.act = first(saying(NEARER), status(401, "no such key"))
    manifest = render(tmp_path)
    errors = capsys.readouterr().err
    assert errors.count("the nearest of its proposals is kept") == 1
    assert "pushes are tried" not in errors
    assert "objects.ball.velocity=[90.0, 0.0]" in manifest["overrides"]


def test_proposal_that_cannot_be_drawn_is_no_failure_of_the_server(
    stub: Stub,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    draw = story_server._frames
    trials: list[Any] = []

    def draw_first(*trial: Any) -> tuple[bytes, ...]:
        trials.append(trial)
        if len(trials) == 2:
            raise Message.NO_SUCH_PATH.error("photo.png")
        return draw(*trial)

    monkeypatch.setattr(story_server, "_frames", draw_first)
    stub.act = first(saying(WRONG), saying(RIGHT))
    render(tmp_path)
    errors = capsys.readouterr().err
    assert "instead" not in errors
    assert "(1 tried)" in errors
    assert "no such file" in text_of(stub.requests[1], 2)


def test_name_ends_before_a_line_break(stub: Stub, tmp_path: Path) -> None:
    names = ["apple\n", "a" * 65, "apple"]
    replies = [proposal(APPLE | {"object": name}) for name in names]
    stub.act = first(*map(saying, replies))
    render(tmp_path)
    assert "does not match" in text_of(stub.requests[1], 2)
    assert "is too long" in text_of(stub.requests[2], 4)
