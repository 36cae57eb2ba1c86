"""What others try: pages of other sites, other names for this machine, wrong tokens, paths that lead out."""

from __future__ import annotations

import http.client
import json
import re
import shutil
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from served import Served, behind_a_server, document

from physgen.cli.main import main
from physgen.edit.app import BODY, Editor
from physgen.files import resource

Serve = Callable[..., Served]
GUARDED = [
    (path, method) for path, ways in document()["paths"].items() for method in ways
]


@pytest.fixture(scope="module")
def slide(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A scene behind one server for all tests that change nothing."""
    folder = tmp_path_factory.mktemp("slide")
    shutil.copy(
        resource("schemas").parent / "scenes/physics/05-slide.yaml",
        folder / "scene.yaml",
    )
    with behind_a_server(folder / "scene.yaml") as served:
        yield served


def port(served: Served) -> int:
    assert served.editor is not None
    return served.editor.port


def raw(served: Served, request: bytes) -> bytes:
    """Bytes as they are; the answer."""
    with socket.create_connection(("127.0.0.1", port(served)), timeout=30) as wire:
        wire.sendall(request)
        answer = b""
        while b"\r\n\r\n" not in answer and (chunk := wire.recv(65536)):
            answer += chunk
    return answer


def asked(served: Served, method: str, path: str, **headers: str) -> tuple[int, bytes]:
    """By http.client, which sends a path as it is."""
    wire = http.client.HTTPConnection("127.0.0.1", port(served), timeout=30)
    wire.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    told = {"Host": f"127.0.0.1:{port(served)}", "X-Physgen-Token": served.token}
    told |= {key.replace("_", "-"): value for key, value in headers.items()}
    for key, value in told.items():
        wire.putheader(key, value)
    wire.endheaders()
    answer = wire.getresponse()
    return answer.status, answer.read()


@pytest.mark.parametrize(("path", "method"), GUARDED, ids=map(" ".join, GUARDED))
def test_nothing_is_told_or_done_without_the_token(path, method, slide: Served) -> None:
    for token in (
        "",
        "x",
        slide.token[:-1],
        slide.token + "x",
        slide.token.swapcase(),
        "ü",
    ):
        headers = {
            "X-Physgen-Token": token.encode(),
            "Content-Type": "application/json",
        }
        answer = slide.client.request(
            method, path.replace("{key}", "x"), headers=headers, content=b"{}"
        )
        assert answer.status_code == 401
        assert answer.json()["error"]["fix"]
    query = slide.client.request(
        method,
        path.replace("{key}", "x"),
        params={"token": slide.token},
        headers={"X-Physgen-Token": ""},
    )
    assert (
        query.status_code == 401
    )  # an address may be seen by others; only the page's own takes it


def test_a_server_for_other_machines_says_what_it_exposes_and_wants_the_token(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = str(
        shutil.copy(
            resource("schemas").parent / "scenes/physics/05-slide.yaml", tmp_path
        )
    )
    with behind_a_server(Path(scene), host="0.0.0.0") as served:
        for token, status in (("", 401), (served.token, 200)):
            assert (
                asked(
                    served,
                    "GET",
                    "/api/state",
                    Host=f"10.1.2.3:{port(served)}",
                    X_Physgen_Token=token,
                )[0]
                == status
            )
    monkeypatch.setattr(Editor, "run", lambda editor: None)
    assert main(["edit", scene, "--host", "0.0.0.0", "--no-browser"]) == 0
    out, err = capsys.readouterr()
    assert "?token=" in out
    assert "--host 0.0.0.0: exposes the scene, its photo and renders" in err
    assert (
        main(["edit", scene, "--host", "", "--no-browser"]) == 0
    )  # not all addresses of this machine
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:{port}", "127.0.0.1:1", "127.0.0.1", "localhost.evil.example:{port}", "", "[::1",
     "127.0.0.1:{port}@evil.example", "127.0.0.2:{port}", "0.0.0.0:{port}", "localhost:{port}x"],
)  # fmt: skip
def test_another_name_for_this_machine_is_refused(host, slide: Served) -> None:
    for path in ("/", "/api/state", "/static/page.css"):
        status, _ = asked(slide, "GET", path, Host=host.format(port=port(slide)))
        assert status in (400, 403)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("Origin", "http://evil.example"),
        ("Origin", "null"),
        ("Origin", "https://127.0.0.1:{port}"),
        ("Origin", "http://127.0.0.1"),
        ("Origin", "http://localhost:{port}"),  # ours by another name is another origin
        ("Sec-Fetch-Site", "cross-site"),
        ("Sec-Fetch-Site", "same-site"),
    ],
)
def test_a_page_of_another_site_is_refused(key, value, slide: Served) -> None:
    headers = {key.replace("-", "_"): value.format(port=port(slide))}
    for path in ("/api/state", "/static/page.css"):
        status, body = asked(slide, "GET", path, **headers)
        assert status == 403
        assert json.loads(body)["error"]["fix"]
    assert asked(slide, "POST", "/api/save", **headers)[0] == 403


def test_no_site_is_told_that_it_may_read(slide: Served) -> None:
    answer = slide.client.options(
        "/api/state", headers={"Origin": "http://evil.example"}
    )
    assert answer.status_code == 403
    for path in ("/", "/api/state", "/static/page.css", "/nowhere"):
        headers = slide.client.get(path).headers
        assert not [key for key in headers if key.startswith("access-control")]
        assert "default-src 'none'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["cache-control"] == "no-store"
        assert headers["x-frame-options"] == "DENY"


def test_the_page_holds_nothing_of_the_scene_and_nothing_from_elsewhere(
    serving: Serve,
) -> None:
    served = serving("billiards")
    page = served.client.get("/", headers={"X-Physgen-Token": ""})
    assert page.status_code == 200
    assert served.token not in page.text
    assert "billiard" not in page.text
    assert str(served.scene.parent) not in page.text
    addresses = re.findall(r'(?:src|href)="([^"]+)"', page.text)
    assert addresses
    assert all(address.startswith(("/static/", "#", "data:,")) for address in addresses)
    for address in addresses:
        if address.startswith("/static/"):
            found = served.client.get(address, headers={"X-Physgen-Token": ""})
            assert found.status_code == 200
            assert found.headers["content-type"].partition(";")[0] in (
                "text/css",
                "text/javascript",
            )


def test_a_browser_is_started_with_an_address_that_is_good_once(serving: Serve) -> None:
    served = serving("physics/05-slide")
    assert served.editor is not None
    once = served.editor.new_page_key()
    assert served.token not in once  # the list of processes shows it to everybody
    query = once.partition("?")[2]
    first = served.client.get(f"/?{query}", headers={"X-Physgen-Token": ""})
    assert (first.status_code, first.headers["location"]) == (
        303,
        f"/?token={served.token}",
    )
    again = served.client.get(f"/?{query}", headers={"X-Physgen-Token": ""})
    assert again.status_code == 200
    assert served.token not in again.text
    assert served.client.get("/?once=").status_code == 200


OUT = [
    "../edit.html.j2", "../../pyproject.toml", "edit/../edit.html.j2", "edit/../../pyproject.toml", "/etc/passwd",
    "//etc/passwd", "edit//etc/passwd", "edit/%2e%2e/edit.html.j2", "%2e%2e/%2e%2e/pyproject.toml",
    "..%2f..%2fpyproject.toml", "edit/..%5c..%5cpyproject.toml", "edit/app.js%00.css", "edit/.js", "edit/APP.JS",
    "edit/app.js/", "report.html.j2", "player/motion.js", "edit/app", "%252e%252e/pyproject.toml", "", "edit/", ".",
    "C:/windows", "edit/" + "a" * 5000 + ".js",
]  # fmt: skip


@pytest.mark.parametrize("name", OUT, ids=lambda name: name[:40])
def test_only_the_parts_of_the_page_are_served(name, slide: Served) -> None:
    status, body = asked(slide, "GET", f"/static/{name}")
    assert status == 404
    assert json.loads(body)["error"]["fix"]


def test_a_scene_reads_nothing_outside_its_folder(
    serving: Serve, tmp_path: Path
) -> None:
    secret = tmp_path / "secret.png"
    secret.write_bytes(
        (resource("schemas").parent / "scenes/billiards/photo.png").read_bytes()
    )
    served = serving("billiards")
    folder = served.scene.parent
    (folder / "link.png").symlink_to(secret)
    text = served.look()["text"]
    for image in (
        "../secret.png",
        str(secret),
        "link.png",
        "photo.assets/../../secret.png",
        "a\0.png",
    ):
        answer = served.send("/api/edit", ops=[{"set": ["image"], "value": image}])
        if answer.status_code == 200:
            assert [p for p in served.state["problems"] if p["severity"] == "error"], (
                image
            )
            assert (
                served.state["scene"],
                served.state["motion"],
                served.state["picture"],
            ) == (None,) * 3
            assert served.client.get("/api/photo").status_code == 422
            served.send("/api/undo")
        assert served.state["text"] == text
    for base in ("../../secret.yaml", "/etc/passwd", str(tmp_path.parent / "x.yaml")):
        answer = served.send("/api/edit", ops=[{"set": ["extends"], "value": base}])
        assert answer.status_code == 200
        assert served.state["scene"] is None
        served.send("/api/undo")


@pytest.mark.parametrize("path", ["/api/edit", "/api/text"])
def test_giant_bodies_are_refused(path, slide: Served) -> None:
    version = slide.look()["version"]
    method = "PUT" if path == "/api/text" else "POST"
    most = BODY
    for length, said in (
        (most + 1, b"413"),
        (10**18, b"413"),
        (10**30, b"400"),
    ):  # told, never sent
        head = (
            f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{port(slide)}\r\nX-Physgen-Token: {slide.token}\r\n"
            f"Content-Type: application/json\r\nContent-Length: {length}\r\n\r\n"
        )
        assert raw(slide, head.encode())[9:12] == said

    def chunks():
        for _ in range(most // 2**20 + 2):
            yield b" " * 2**20

    answer = slide.client.request(
        method, path, content=chunks(), headers={"Content-Type": "application/json"}
    )
    assert answer.status_code == 413
    assert slide.look()["version"] == version


BODIES = {
    "nothing": b"",
    "no JSON": b"{",
    "endless": b'{"version": 1e999}',
    "deep": b'{"ops":' + b"[" * 100_000 + b"]" * 100_000 + b"}",
    "half a pair": b'{"version": 1, "ops": [], "what": "\\ud800"}',
    "not UTF-8": b'{"version": 1, "what": "\xff"}',
    "more": b'{"version": 1, "ops": [], "admin": true}',
    "true for one": b'{"version": true, "ops": []}',
    "too many words": b'{"version": 1, "ops": [], "what": "' + b"x" * 300 + b'"}',
    "too many ops": b'{"version": 1, "ops": ['
    + b'{"unset": ["a"]},' * 1000
    + b'{"unset": ["a"]}]}',
}


@pytest.mark.parametrize("name", BODIES)
def test_malformed_bodies_are_told_of(name, slide: Served) -> None:
    version = slide.look()["version"]
    headers = {"Content-Type": "application/json"}
    answer = slide.client.post("/api/edit", content=BODIES[name], headers=headers)
    assert answer.status_code == 400
    assert answer.json()["error"]["fix"]
    assert slide.look()["version"] == version


@pytest.mark.parametrize(
    "kind",
    [
        "",
        "text/plain",
        "application/x-www-form-urlencoded",
        "multipart/form-data",
        "application/jsonx",
    ],
)
def test_bodies_that_a_form_could_send_are_refused(kind, slide: Served) -> None:
    body = b'{"version": 1, "ops": []}'
    answer = slide.client.post(
        "/api/edit", content=body, headers={"Content-Type": kind} if kind else {}
    )
    assert answer.status_code == 415


def test_a_broken_look_is_told_and_hides_its_insides(
    serving: Serve, monkeypatch
) -> None:
    served = serving("physics/05-slide")
    assert served.editor is not None

    def broken(*arguments: object) -> None:
        raise RuntimeError("/secret/path")

    monkeypatch.setattr(served.editor.session.live, "look", broken)
    answer = served.client.get("/api/state")
    assert answer.status_code == 500
    assert "/secret" not in answer.text
    assert "Traceback" not in answer.text
    assert answer.headers["x-content-type-options"] == "nosniff"
