"""Scenes and folders behind URLs: what a local run makes of them, and what a killed one leaves."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import fsspec
import pytest

from physgen.batch import remote, remote_scene
from physgen.batch.remote_scene import fetch_scene
from physgen.cli.main import main
from physgen.problems import InputError
from physgen.scene.load import Opened

SAME = ("samples", "frames", "inputs", "mark", "document", "video", "warnings", "scene", "effort")
"""What manifests of one clip agree on wherever it was made."""


@pytest.fixture
def store() -> Iterator[fsspec.AbstractFileSystem]:
    """An object store that is empty, and that all tests of a process share."""
    remote_scene._FETCHED.clear()
    memory = fsspec.filesystem("memory")
    memory.store.clear()
    memory.pseudo_dirs[:] = [""]
    yield memory
    memory.store.clear()


def put(store: fsspec.AbstractFileSystem, folder: Path, name: str) -> None:
    for path in folder.rglob("*"):
        if path.is_file():
            store.pipe_file(f"/{name}/{path.relative_to(folder).as_posix()}", path.read_bytes())


def rendered(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> dict[str, str]:
    """State by clip."""
    capsys.readouterr()
    assert main(["render", "--report", "none", "--json", *arguments]) == code
    *lines, last = map(json.loads, capsys.readouterr().out.splitlines())
    assert last["clips"] == len(lines)
    return {line["folder"] or line["clip"]: line["state"] for line in lines}


def test_a_scene_and_its_clips_behind_urls_are_those_of_files(store, pictured: Path, capsys) -> None:
    put(store, pictured.parent, "scenes/pictured")
    assert main(["render", str(pictured), "-o", str(pictured.parent / "out"), "--report", "none"]) == 0
    flags = ["memory://scenes/pictured/scene.yaml", "-o", "memory://clips"]
    assert rendered(capsys, *flags) == {"memory://clips/pictured": "made"}
    local = pictured.parent / "out" / "pictured"
    for name in ("video.mp4", "trajectory.npz"):
        assert store.cat_file(f"/clips/pictured/{name}") == (local / name).read_bytes()
    here, there = (
        json.loads((local / "manifest.json").read_bytes()),
        json.loads(store.cat_file("/clips/pictured/manifest.json")),
    )
    assert {key: there[key] for key in SAME} == {key: here[key] for key in SAME}
    assert there["source"] == flags[0]
    assert rendered(capsys, *flags) == {"memory://clips/pictured": "unchanged"}
    assert rendered(capsys, str(pictured), "-o", "memory://clips") == {"memory://clips/pictured": "unchanged"}


@pytest.mark.parametrize("harm", ["cut", "gone", "unsent", "another"])
def test_what_is_not_whole_there_is_made_again(store, lesson: Path, capsys, harm: str) -> None:
    flags = [str(lesson), "-o", "memory://clips"]
    assert rendered(capsys, *flags) == {"memory://clips/lesson": "made"}
    whole = store.cat_file("/clips/lesson/video.mp4")
    if harm == "cut":
        store.pipe_file("/clips/lesson/video.mp4", whole[:-1])
    elif harm == "gone":
        store.rm_file("/clips/lesson/trajectory.npz")
    elif harm == "unsent":  # killed while files changed
        store.rm_file("/clips/lesson/manifest.json")
        store.pipe_file("/clips/lesson/video.mp4", b"half")
        store.pipe_file(
            "/clips/lesson/.sending.json", b'{"sending": ["video.mp4", "trajectory.npz", "video.gif"]}'
        )
        store.pipe_file("/clips/lesson/video.gif", b"of an earlier format")
    else:
        lesson.write_text(lesson.read_text() + "# another\n")
    assert rendered(capsys, *flags) == {"memory://clips/lesson": "made"}
    assert store.cat_file("/clips/lesson/video.mp4") == whole
    names = [name.rpartition("/")[2] for name in store.find("/clips/lesson")]
    assert sorted(names) == ["manifest.json", "trajectory.npz", "video.mp4"]


def test_files_of_others_are_never_replaced(store, lesson: Path, capsys) -> None:
    store.pipe_file("/clips/lesson/video.mp4", b"theirs")
    assert main(["render", "--report", "none", str(lesson), "-o", "memory://clips"]) == 2
    assert "holds video.mp4, which physgen did not make" in capsys.readouterr().err
    assert store.cat_file("/clips/lesson/video.mp4") == b"theirs"


def test_a_clip_is_not_there_before_all_of_it_is(store, lesson: Path, monkeypatch) -> None:
    """Whatever moment the run is killed at, a manifest stands beside the files that it names."""
    seen = []

    def watched(name: str):
        plain = getattr(remote.RemoteFolder, name)

        def method(self, *arguments):
            result = plain(self, *arguments)
            if store.exists("/clips/lesson/manifest.json"):
                told = json.loads(store.cat_file("/clips/lesson/manifest.json"))
                seen.append(
                    all(store.size(f"/clips/lesson/{n}") == size for n, size in told["sizes"].items())
                )
            else:
                seen.append(None)
            return result

        monkeypatch.setattr(remote.RemoteFolder, name, method)

    for name in ("write", "send", "remove"):
        watched(name)
    for edit in ("objects.ball.mass=100", "objects.ball.velocity=[90, 0]"):
        assert main(["render", str(lesson), "-o", "memory://clips", "--report", "none", "--set", edit]) == 0
    assert set(seen) == {True, None}
    assert seen[-1]


def test_somebody_elses_files_stay(store, lesson: Path, capsys) -> None:
    store.pipe_file("/clips/lesson/thesis.tex", b"years of work")
    assert rendered(capsys, str(lesson), "-o", "memory://clips", code=2) == {"lesson": "failed"}
    assert store.find("/clips/lesson") == ["/clips/lesson/thesis.tex"]


def test_a_failed_clip_is_named_by_its_url(store, lesson: Path, pictured: Path, capsys) -> None:
    put(store, pictured.parent, "scenes/pictured")
    store.pipe_file("/scenes/lesson.yaml", lesson.read_text().replace("mass: 200", "mass: heavy").encode())
    scenes = ["memory://scenes/lesson.yaml", "memory://scenes/pictured/scene.yaml"]
    assert main(["render", *scenes, "-o", "memory://clips"]) == 2
    said = capsys.readouterr()
    assert 'memory://scenes/lesson.yaml:6:67: objects.crate.mass: "heavy"' in said.err
    assert said.out.splitlines() == ["memory://clips/pictured"]


def test_a_sweep_behind_urls_has_the_table_of_a_local_one(store, lesson: Path, capsys) -> None:
    put(store, lesson.parent, "scenes")
    axes = ["objects.ball.mass=50,100", "--report", "none"]
    out = lesson.parent / "swept"
    assert main(["sweep", str(lesson), *axes, "-o", str(out)]) == 0
    local = (out / "sweep.csv").read_bytes()
    for state in ("made", "unchanged"):
        capsys.readouterr()
        assert main(["sweep", "memory://scenes/lesson.yaml", *axes, "-o", "memory://swept", "--json"]) == 0
        *lines, last = map(json.loads, capsys.readouterr().out.splitlines())
        assert [line["state"] for line in lines] == [state, state]
        assert last["sweep.csv"] == "memory://swept/sweep.csv"
        assert store.cat_file("/swept/sweep.csv") == local
    told, here = (
        json.loads(store.cat_file("/swept/sweep.json")),
        json.loads((out / "sweep.json").read_bytes()),
    )
    assert told["scene"] == "memory://scenes/lesson.yaml"
    assert told["sha256"] == here["sha256"]
    assert not [name for name in store.find("/swept") if ".part" in name]
    store.pipe_file("/other/sweep.csv", b"mine")
    assert main(["sweep", str(lesson), *axes, "-o", "memory://other"]) == 2
    assert "memory://other/sweep.csv: is there already" in capsys.readouterr().err
    assert store.find("/other") == ["/other/sweep.csv"]


def test_what_a_scene_extends_is_fetched_and_told_by_its_url(store, lesson: Path) -> None:
    store.pipe_file("/all/base/scene.yaml", lesson.read_bytes())
    store.pipe_file("/all/mine/scene.yaml", b"extends: ../base/scene.yaml\nobjects: {ball: {mass: 10}}\n")
    scene = fetch_scene("memory://all/mine/scene.yaml")
    assert scene.parent.name == "mine"
    assert (scene.parent.parent / "base" / "scene.yaml").read_bytes() == lesson.read_bytes()
    store.pipe_file("/all/base/scene.yaml", lesson.read_bytes().replace(b"mass: 200", b"mass: heavy"))
    store.pipe_file("/all/mine2/scene.yaml", b"extends: ../base/scene.yaml\n")
    mine2 = fetch_scene("memory://all/mine2/scene.yaml")
    with pytest.raises(InputError) as error:
        Opened(mine2, shown="memory://all/mine2/scene.yaml").scene()
    assert [str(p.place) for p in error.value.problems] == ["memory://all/base/scene.yaml:6:67"]


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        ("extends: ../../secret/scene.yaml\n", "leads out of the folder above the scene's"),
        ("extends: /etc/passwd.yaml\n", "is an absolute path"),
        ("physgen: 1\nimage: ../secret/photo.png\nobjects: {}\n", "leads out of the scene's folder"),
        ("physgen: 1\nimage: photo.png\nobjects: {}\n", "does not exist"),
        (
            "physgen: 1\nsize: [9, 9]\nobjects: {}\nvariants: {v: {image: /etc/passwd}}\n",
            "is an absolute path",
        ),
    ],
)
def test_a_scene_from_elsewhere_may_read_what_a_local_one_may(
    store, scene: str, said: str, monkeypatch
) -> None:
    asked: list[str] = []
    plain = remote.RemoteFolder.fetch
    monkeypatch.setattr(
        remote.RemoteFolder,
        "fetch",
        lambda self, name, *more: (asked.append(name), plain(self, name, *more))[1],
    )
    for name in ("/secret/scene.yaml", "/a/secret/photo.png", "/a/secret/scene.yaml"):
        store.pipe_file(name, b"physgen: 1\nsize: [9, 9]\nobjects: {}\n")
    store.pipe_file("/a/b/scene.yaml", scene.encode())
    with pytest.raises(InputError, match=said):
        Opened(fetch_scene("memory://a/b/scene.yaml")).scene()
    assert not [name for name in asked if "secret" in name or "etc" in name]


def test_a_store_may_have_files_of_any_name(store) -> None:
    store.store["/clips/../../evil"] = store.store["/clips/a/..\\x"] = (
        fsspec.implementations.memory.MemoryFile(store, "/x", b"1")
    )
    store.pipe_file("/clips/good/manifest.json", b"{}")
    assert list(remote.open_folder("memory://clips").files()) == ["good/manifest.json"]


def test_libraries_that_are_missing_are_named(lesson: Path, capsys, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "s3fs", None)
    assert main(["render", str(lesson), "-o", "s3://bucket/clips"]) == 2
    assert capsys.readouterr().err == (
        "s3://bucket/clips: needs a library for s3:// that is not installed; pip install s3fs\n"
    )
    assert main(["render", str(lesson), "-o", "nowhere://clips"]) == 2
    assert "cannot be opened (Protocol not known: nowhere)" in capsys.readouterr().err
    remote.open_folder.cache_clear()
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    assert main(["render", "s3://bucket/scene.yaml", "-o", str(lesson.parent / "out")]) == 2
    assert "pip install 'physgen[remote]' s3fs" in capsys.readouterr().err


def test_flags_that_would_lose_clips_are_refused(lesson: Path, capsys) -> None:
    for flags in (["--jobs", "2"], ["--cluster", "dask"]):
        assert main(["render", str(lesson), "-o", "memory://clips", *flags]) == 2
        assert "memory:// is visible to one process only" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["render", "file://elsewhere/scene.yaml"])
    assert "names a file of another machine" in capsys.readouterr().err


def test_a_place_that_cannot_be_written_is_one_failed_clip(store, lesson: Path, monkeypatch, capsys) -> None:
    def broken(*arguments: object, **more: object) -> None:
        raise LookupError("no credentials")

    monkeypatch.setattr(type(store), "pipe_file", broken)
    assert main(["render", str(lesson), "-o", "memory://clips", "--report", "none"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == (
        f"{lesson}: failed: memory://clips/lesson/.sending.json: LookupError: no credentials\n"
    )


def test_only_urls_import_fsspec(lesson: Path) -> None:
    code = (
        "import sys; from physgen.cli.main import main; main(sys.argv[1:]); "
        "assert not {'fsspec', 'dask', 'distributed'} & set(sys.modules)"
    )
    command = [
        "render",
        str(lesson),
        "-o",
        str(lesson.parent / "out"),
        "--variant",
        "all",
        "--report",
        "none",
    ]
    subprocess.run([sys.executable, "-c", code, *command], check=True, stdout=subprocess.DEVNULL)


def test_temporary_folders_of_killed_processes_are_removed_by_the_next(tmp_path: Path) -> None:
    code = (
        "import os\nfrom physgen.report.folders import temporary_folder\n"
        "with temporary_folder() as folder:\n (folder / 'film.mp4').touch()\n {end}"
    )
    seen = []
    for end in ("os._exit(9)", "pass"):
        environment = {**os.environ, "TMPDIR": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
        subprocess.run([sys.executable, "-c", code.format(end=end)], env=environment, check=False)
        seen.append(len(list(tmp_path.iterdir())))
    assert seen == [1, 0]
