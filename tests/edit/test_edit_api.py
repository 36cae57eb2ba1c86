"""The interface keeps to its own OpenAPI, whatever is sent, and the doors of a session do what they say."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from served import Served, unpacked

from physgen.materials import materials

STEADY = settings(
    max_examples=20,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
    deadline=None,
    derandomize=True,
    database=None,
)
Serve = Callable[..., Served]


KEYS = st.sampled_from(
    [
        "objects",
        "block",
        "forces",
        "world",
        "gravity",
        0,
        1,
        "velocity",
        "variants",
        "x",
        "shape",
        "*",
        "a.b",
        "",
    ]
)
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=5,
)
OPS = st.one_of(
    st.fixed_dictionaries(
        {"set": st.lists(KEYS, min_size=1, max_size=4), "value": VALUES}
    ),
    st.fixed_dictionaries(
        {"add": st.lists(KEYS, min_size=1, max_size=4), "value": VALUES}
    ),
    st.fixed_dictionaries({"unset": st.lists(KEYS, min_size=1, max_size=4)}),
    st.fixed_dictionaries({"remove": st.lists(KEYS, min_size=1, max_size=3)}),
    st.fixed_dictionaries(
        {"rename": st.lists(KEYS, min_size=1, max_size=3), "to": st.text(max_size=5)}
    ),
)


def test_any_operation_on_a_scene_is_made_or_refused_and_can_be_undone(
    serving: Serve,
) -> None:
    served = serving("physics/05-slide")
    first = served.look()["text"]

    @settings(STEADY)
    @given(st.lists(OPS, min_size=1, max_size=3))
    def asked(ops: list[dict[str, Any]]) -> None:
        answer = served.send("/api/edit", ops=ops)
        if answer.status_code == 200 and served.state["text"] != first:
            assert served.send("/api/undo").status_code == 200
            assert served.state["text"] == first
        assert answer.status_code in (200, 422), answer.text
        if answer.status_code == 422:
            assert answer.json()["error"]["fix"]

    asked()


# What the doors do


def body(state: dict[str, Any], name: str) -> dict[str, Any]:
    (found,) = [body for body in state["motion"]["bodies"] if body["name"] == name]
    return found


def test_an_edit_is_seen_undone_and_done_again(serving: Serve) -> None:
    served = serving("billiards")
    first = served.look()
    edited = served.edit(
        {"set": ["objects", "cue-ball", "velocity"], "value": [100, 0]},
        what="push cue-ball",
    )
    assert edited["scene"]["objects"]["cue-ball"]["velocity"] == [100, 0]
    assert (edited["undo"], edited["redo"], edited["file"]["saved"]) == (
        "push cue-ball",
        None,
        False,
    )
    assert edited["version"] > first["version"]
    moved = body(edited, "cue-ball")
    assert (unpacked(moved["x"])[0], unpacked(moved["vx"])[0]) == (227.5, 100)
    assert served.send("/api/undo").status_code == 200
    assert served.state["text"] == first["text"]
    assert served.state["redo"] == "push cue-ball"
    assert served.state["file"]["saved"]
    assert served.send("/api/redo").status_code == 200
    assert served.state["text"] == edited["text"]


def test_of_an_old_version_nothing_is_edited(serving: Serve) -> None:
    served = serving("physics/05-slide")
    old = served.look()["version"]
    new = served.edit({"set": ["world", "duration"], "value": 0.5})
    answer = served.send(
        "/api/edit", version=old, ops=[{"unset": ["world", "duration"]}]
    )
    assert answer.status_code == 409
    assert answer.json()["version"] == new["version"]
    assert served.look()["text"] == new["text"]


def test_a_text_with_errors_is_kept_and_they_are_told_at_their_lines(
    serving: Serve,
) -> None:
    served = serving("billiards")
    text = served.look()["text"]
    wrong = text.replace("mass: 170", "mass: heavy", 1)
    line = wrong[: wrong.index("mass: heavy")].count("\n") + 1
    served.send("/api/text", "PUT", text=wrong)
    assert served.state["text"] == wrong
    assert served.state["motion"] is None
    (problem,) = [
        problem
        for problem in served.state["problems"]
        if problem["severity"] == "error"
    ]
    assert (problem["line"], problem["object"]) == (line, "cue-ball")
    served.send("/api/text", "PUT", text="a: 1\nb: 2: 3\n")
    assert served.state["problems"][0]["line"] == 2
    assert served.send("/api/edit", ops=[{"set": ["a"], "value": 1}]).status_code == 422
    served.send("/api/undo")
    served.send("/api/undo")
    assert served.state["text"] == text
    assert served.state["motion"] is not None


def test_line_ends_and_the_first_mark_of_a_file_stay(serving: Serve, copied) -> None:
    path = copied("physics/05-slide")
    data = b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n")
    path.write_bytes(data)
    served = serving(path)
    text = served.look()["text"]
    served.send(
        "/api/text",
        "PUT",
        text=text.replace("\r\n", "\n").replace("physgen: 1", "physgen: 1  # one"),
    )
    served.send("/api/save")
    assert path.read_bytes() == data.replace(b"physgen: 1", b"physgen: 1  # one")


def test_a_preview_changes_nothing(serving: Serve) -> None:
    served = serving("billiards")
    before = served.look()
    answer = served.send(
        "/api/preview",
        ops=[{"set": ["objects", "cue-ball", "velocity"], "value": [0, 0]}],
    )
    rest, moved = (
        unpacked(body(told, "cue-ball")["vx"])[0] for told in (answer.json(), before)
    )
    assert (rest, moved) == (0, 4200)
    assert served.look()["text"] == before["text"]
    assert served.state["version"] == before["version"]
    old = {
        "version": before["version"],
        "ops": [{"unset": ["objects", "cue-ball", "velocity"]}],
    }
    served.edit({"set": ["objects", "cue-ball", "velocity"], "value": [1, 1]})
    page = served.client.post("/api/preview", json=old)
    assert (page.status_code, page.json()["overtaken"], page.json()["motion"]) == (
        200,
        True,
        None,
    )


def test_pictures_of_the_photo(serving: Serve) -> None:
    served = serving("billiards")
    state = served.look()
    photo = served.client.get("/api/photo")
    assert photo.content.startswith(b"\x89PNG")
    mask = served.client.get("/api/mask", params={"object": "cue-ball"})
    assert mask.content.startswith(b"\x89PNG")
    assert (
        served.client.get("/api/mask", params={"object": "nobody"}).status_code == 422
    )
    assert served.get(f"/api/picture/{state['picture']}")["names"]
    assert served.client.get("/api/picture/none").status_code == 409
    assert {row["name"] for row in served.get("/api/materials")} == {
        row.name for row in materials()
    }


def test_every_page_hears_of_edits(serving: Serve) -> None:
    served = serving("physics/05-slide")
    first = served.get("/api/events")
    served.look()
    served.edit({"set": ["world", "duration"], "value": 0.5})
    for _ in range(2):
        news = served.get("/api/events", run=first["run"], since=first["next"])
        assert news["events"] == [
            {"type": "version", "version": served.state["version"], "saved": False}
        ]
    assert served.get("/api/events", run="another", since=0)["events"] == []
    assert served.editor is not None
    events = served.editor.services.events
    for k in range(3000):
        events.send({"type": "version", "version": k})
    assert events.since(events.run, 1)["events"][-1]["version"] == 2999


@pytest.mark.slow
def test_a_render_saves_and_its_result_is_had_by_its_address(
    serving: Serve, copied, tmp_path: Path
) -> None:
    path = copied("physics/05-slide")
    served = serving(path, output=tmp_path / "out")
    edits = [("render", "frames", 4), ("render", "size", [64, 48])]
    served.look()
    served.edit(*({"set": [*keys], "value": value} for *keys, value in edits))
    half, kind = (
        json.dumps({"version": 1, "text": "\ud800"}),
        {"Content-Type": "application/json"},
    )
    refused = served.client.put("/api/text", content=half, headers=kind)
    assert (refused.status_code, refused.json()["error"]["fix"]) == (
        400,
        "send whole characters",
    )
    refused = served.client.post("/api/render", json={"variants": ["--jobs"]})
    assert (refused.status_code, refused.json()["error"]["fix"]) == (
        422,
        "choose one of its variants",
    )
    assert served.client.post("/api/render", json={"format": "gif"}).status_code == 200
    assert "frames: 4" in path.read_text()
    while (status := served.get("/api/render"))["running"]:
        time.sleep(0.1)
    assert status["state"] == "done"
    (row,) = status["result"]
    folder = f"/result/{status['job']}/{row['folder']}/"
    with_token = served.client.get(folder + row["video"])
    assert with_token.content.startswith(b"GIF8")
    without = served.client.get(folder + row["video"], headers={"X-Physgen-Token": ""})
    assert (
        without.content == with_token.content
    )  # a link carries no header: its address is the key
    assert "sandbox" in without.headers["content-security-policy"]
    key = status["job"]
    for wrong in (key[::-1], "x", key + "x"):
        assert (
            served.client.get(folder.replace(key, wrong) + row["video"]).status_code
            == 404
        )
    for out in (
        "../../scene.yaml",
        "..%2f..%2fscene.yaml",
        "%2e%2e/%2e%2e/scene.yaml",
        "//etc/passwd",
    ):
        assert served.client.get(folder + out).status_code == 404
    assert served.get("/api/command")["command"].startswith("physgen render ")
