"""What a gallery finds in folders, how it tells the clips apart, and what `render` leaves for it."""

from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import cv2
import numpy as np
import pytest
from exhibits import document, exhibit, failure, film, level, sweep
from pytest import approx

from physgen.cli.main import main
from physgen.export.video import Format
from physgen.report.clips import clips_in
from physgen.report.films import poster
from physgen.report.gallery import write_gallery
from physgen.report.sweep_keys import swept_keys

SCENE = """\
physgen: 1
size: [64, 48]
world: {duration: 0.1}
objects:
  ball: {shape: {circle: {center: [30, 20], radius: 5}}, mass: 100}
"""


class Page(HTMLParser):
    """An independent reader: elements with their attributes, and the script's data."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self._inside = False
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(
        self, tag: str, attributes: list[tuple[str, str | None]]
    ) -> None:
        self.found.append((tag, dict(attributes)))
        self._inside = tag == "script"
        if self._inside:
            self.scripts.append("")

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.scripts[-1] += data

    def handle_endtag(self, tag: str) -> None:
        self._inside = self._inside and tag != "script"

    @property
    def data(self) -> dict:
        return json.loads(next(text for text in self.scripts if text.startswith("{")))

    def paths(self) -> list[str]:
        links = [
            value
            for _, a in self.found
            for key in ("href", "src")
            if (value := a.get(key))
        ]
        data = [clip[key] for clip in self.data["clips"] for key in ("href", "film")]
        return [
            link
            for link in (*links, *data)
            if link and not link.startswith(("#", "data:"))
        ]


# ---- what is found ---------------------------------------------------------------------------------------------------


def test_clips_are_found_at_any_depth_once_in_natural_order(tmp_path: Path) -> None:
    for name in ("b/run-10/scene", "b/run-9/scene", "a", "b/.hidden/scene"):
        exhibit(tmp_path / name)
    exhibit(tmp_path / "a" / "inner")  # what is in a clip's folder is its own
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "manifest.json").write_text("[]")
    failure(tmp_path / "b", "wrong", "wrong.yaml:1:1: is wrong")
    (tmp_path / "b" / "mine.failed.json").write_text('{"failed": 2}')
    found = clips_in([tmp_path, tmp_path / "b"])
    names = [clip.home.relative_to(tmp_path).as_posix() for clip in found]
    assert names == ["a", "b/run-9/scene", "b/run-10/scene", "b/wrong.failed.json"]
    assert found[-1].problems == ("wrong.yaml:1:1: is wrong",)
    assert (found[0].objects, found[0].duration) == (2, approx(1.1))
    assert dict(found[0].labels) == {"billiard ball": 1, "wooden crate": 1}


def test_where_refining_failed_there_is_one_card_with_the_unrefined_film(
    tmp_path: Path,
) -> None:
    folder = exhibit(tmp_path / "a", frames=[], refine={"failed": "no weights"})
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["files"] = {"unrefined.mp4": manifest["files"]["video.mp4"]}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    (folder / "video.mp4").rename(folder / "unrefined.mp4")
    assert [clip.problems for clip in clips_in([tmp_path])] == [("no weights",)]
    failure(tmp_path, "a", "--refine: has no weights; name some")
    (clip,) = clips_in([tmp_path])
    assert clip.problems == ("--refine: has no weights; name some",)
    assert clip.film == folder / "unrefined.mp4"


# ---- in what they differ ---------------------------------------------------------------------------------------------


def test_the_keys_of_a_sweep_and_their_values(tmp_path: Path) -> None:
    keys = swept_keys(clips_in([sweep(tmp_path, [50, 100, 200], [0.1, 0.9])]))
    assert [(key.path, key.name, key.unit) for key in keys] == [
        ("objects.*.mass", "mass", "g"),
        ("objects.ball.friction", "friction", ""),
    ]
    assert keys[0].values == (50, 50, 100, 100, 200, 200)
    assert keys[1].values == (0.1, 0.9) * 3
    assert all(key.numeric and not key.follows for key in keys)


def test_names_of_keys_are_as_short_as_leaves_no_doubt(tmp_path: Path) -> None:
    for k in range(4):
        told = {
            "objects.ball.mass": 10 * k,
            "objects.crate.mass": 5 * (k % 3),
            "objects.ball.velocity": [k // 2, 7],
            "forces[0].impulse": [4, k % 2],
            "world.view": ("side", "top")[k // 3],
        }
        exhibit(
            tmp_path / f"{k}",
            overrides=[f"{key}={value}" for key, value in told.items()],
        )
    exhibit(
        tmp_path / "4", document(objects__ball__mass=25, objects__ball__velocity=[0, 7])
    )  # as its scene has it
    keys = {key.path: key for key in swept_keys(clips_in([tmp_path]))}
    assert {path: key.name for path, key in keys.items()} == {
        "objects.ball.mass": "ball mass",
        "objects.crate.mass": "crate mass",
        "objects.ball.velocity[0]": "velocity x",
        "forces[0].impulse[1]": "impulse y",
        "world.view": "view",
    }
    assert {
        keys["objects.ball.velocity[0]"].unit,
        keys["forces[0].impulse[1]"].unit,
    } == {"px/s", "g·px/s"}
    assert not keys["world.view"].numeric
    assert keys["objects.ball.mass"].values == (0, 10, 20, 30, 25)


def test_a_mixed_gallery_has_no_keys_of_a_sweep(tmp_path: Path) -> None:
    """Clips of two photos, each with a mass of its own, as files with other edits have."""
    for k, photo in enumerate(("a" * 64, "b" * 64)):
        told = {
            "overrides": [f"objects.ball.mass={10 + k}"],
            "inputs": {"photo.png": photo},
        }
        exhibit(tmp_path / f"{k}", document(image="photo.png"), **told)
    assert swept_keys(clips_in([tmp_path])) == []
    exhibit(
        tmp_path / "2",
        document(image="photo.png"),
        **told | {"overrides": ["objects.ball.mass=900"]},
    )
    assert [key.values for key in swept_keys(clips_in([tmp_path]))] == [(10, 11, 900)]


# ---- pictures --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", list(Format))
def test_a_poster_is_the_first_frame_of_its_film(kind: Format, tmp_path: Path) -> None:
    """Read back by another library: the grey is that of the frame."""
    path = film(tmp_path, 0, kind)
    data = poster(path / "00000.png" if kind is Format.PNG else path)
    first = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert first.mean() == approx(level(0), abs=4)


def test_pictures_are_made_once_and_go_with_their_films(tmp_path: Path) -> None:
    exhibit(tmp_path / "a", seed=1)
    exhibit(tmp_path / "b", seed=2)
    write_gallery([tmp_path], tmp_path / "index.html")
    files = tmp_path / "index.files"
    (files / "mine.webp").write_bytes(b"mine")
    before = {path.name: path.stat().st_mtime_ns for path in files.iterdir()}
    assert len(before) == 2 * 2 + 2, "photos, results, the list of clips and mine"
    shutil.rmtree(tmp_path / "a")
    write_gallery([tmp_path], tmp_path / "index.html")
    after = {path.name: path.stat().st_mtime_ns for path in files.iterdir()}
    assert len(after) == 2 + 2
    after.pop("clips.js")
    assert after.items() <= before.items()


@pytest.mark.parametrize(("play", "expected"), [("forward", 10), ("there-and-back", 5)])
def test_the_result_is_where_the_clip_ends(
    tmp_path: Path, play: str, expected: int
) -> None:
    """A clip that comes back to its photo is shown by its middle."""
    exhibit(tmp_path / "a", document(render__play=play))
    write_gallery([tmp_path], tmp_path / "index.html")
    (file,) = (tmp_path / "index.files").glob("*.result.webp")
    still = cv2.imread(str(file), cv2.IMREAD_COLOR)
    assert still.mean() == approx(level(expected), abs=4)


# ---- words of the scene file -----------------------------------------------------------------------------------------


def test_a_card_has_the_words_of_its_scene_file(tmp_path: Path) -> None:
    text = "# yaml-language-server: $schema=x\n# Two cups, one\n# on top. Ours.\n"
    (tmp_path / "tall-cups.yaml").write_text(text + SCENE)
    exhibit(
        tmp_path / "out" / "tall-cups",
        document(render__slow=2.5, objects__ball__mask=1),
        source="../../tall-cups.yaml",
    )
    exhibit(
        tmp_path / "out" / "seen",
        document(objects__ball__mask=1),
        inputs={"seen.assets/perceived.json": "0"},
        source="../../none.yaml",
    )
    exhibit(tmp_path / "out" / "drawn", document(title="Drawn by hand"))
    found = {clip.name: clip for clip in clips_in([tmp_path / "out"])}
    cups = found["tall-cups"]
    assert (cups.title, cups.sentence) == ("Tall cups", "Two cups, one on top.")
    assert (cups.masks, cups.slow) == ("hand-made masks", 2.5)
    assert (found["seen"].masks, found["seen"].sentence) == ("perceived", "")
    assert (found["drawn"].masks, found["drawn"].title) == ("", "Drawn by hand")
    write_gallery([tmp_path / "out"], tmp_path / "out" / "index.html")
    html = (tmp_path / "out" / "index.html").read_text()
    assert "slow motion 2.5 ×" in html
    assert 'href="../tall-cups.yaml">scene file' in html


# ---- the page --------------------------------------------------------------------------------------------------------


def test_paths_are_relative_to_the_page_and_lead_somewhere(tmp_path: Path) -> None:
    exhibit(tmp_path / "one" / "50% a#b?c")
    exhibit(tmp_path / "two" / "deep" / "er" / "ä ö")
    assert (
        main(
            [
                "gallery",
                str(tmp_path / "one"),
                str(tmp_path / "two"),
                "-o",
                str(tmp_path / "x/y/all.html"),
            ]
        )
        == 0
    )
    paths = Page(tmp_path / "x" / "y" / "all.html").paths()
    own = [path for path in paths if "docs/" not in path and "README" not in path]
    own.remove("https://stevenlsw.github.io/physgen/")
    assert len(own) == 2 * 5 + 3, "with the one on top"
    for path in own:
        assert path.startswith(("./", "../"))
        assert (tmp_path / "x" / "y" / unquote(path)).is_file(), path


def test_what_comes_from_outside_is_text(tmp_path: Path) -> None:
    bad = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"
    scene = document(objects__ball__label=bad)
    exhibit(
        tmp_path / "a",
        scene,
        scene=bad,
        variant=bad,
        overrides=[f"objects.ball.label={bad}"],
    )
    exhibit(tmp_path / "b", warnings=[{"text": bad}])
    failure(tmp_path, "c", bad)
    write_gallery([tmp_path], tmp_path / "index.html", title=bad)
    page = Page(tmp_path / "index.html")
    assert sum(tag == "script" for tag, _ in page.found) == 3
    assert not any("onerror" in attributes for _, attributes in page.found)
    assert page.data["clips"][0]["name"] == bad


def test_a_page_that_is_somebody_else_s_is_kept(tmp_path: Path, capsys) -> None:
    exhibit(tmp_path / "a")
    (tmp_path / "index.html").write_text("mine")
    assert main(["gallery", str(tmp_path)]) == 0
    assert (tmp_path / "index.html~").read_text() == "mine"
    assert "kept as index.html~" in capsys.readouterr().err
    assert main(["gallery", str(tmp_path)]) == 0
    assert capsys.readouterr().err == ""


def test_an_empty_gallery_says_so(tmp_path: Path, capsys) -> None:
    assert main(["gallery", str(tmp_path), "--title", "Nothing"]) == 2
    assert (
        "has no clips of physgen; make some: physgen render" in capsys.readouterr().err
    )
    assert not (tmp_path / "index.html").exists()


def test_wrong_folders_are_refused_before_anything_is_written(
    tmp_path: Path, capsys
) -> None:
    assert (
        main(["gallery", str(tmp_path / "none"), "-o", str(tmp_path / "x/index.html")])
        == 2
    )
    assert (
        "is not a folder; name folders that physgen rendered into"
        in capsys.readouterr().err
    )
    assert main(["gallery", str(tmp_path), "-o", str(tmp_path)]) == 2
    assert "is a folder; name a file" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


# ---- what render leaves ----------------------------------------------------------------------------------------------


def test_of_several_each_that_fails_leaves_a_card_until_it_succeeds(
    tmp_path: Path, capsys
) -> None:
    for name, text in (
        ("good", SCENE),
        ("bad", SCENE.replace("mass: 100", "mass: <b>")),
    ):
        (tmp_path / f"{name}.yaml").write_text(text)
    out = tmp_path / "out"
    both = [str(tmp_path / "good.yaml"), str(tmp_path / "bad.yaml")]
    assert main(["render", *both, "-o", str(out), "--set", "world.duration=0.1"]) == 2
    trace = json.loads((out / "bad.failed.json").read_text())
    assert trace["overrides"] == ["world.duration=0.1"]
    assert re.search(r"bad\.yaml:5:\d+: objects\.ball\.mass", trace["problems"][0])
    data = Page(out / "index.html").data["clips"]
    assert [(clip["name"], clip["failed"]) for clip in data] == [
        ("bad", True),
        ("good", False),
    ]
    assert (
        "1 of 2 clips, simulated; 1 failed, as its card says."
        in (out / "index.html").read_text()
    )
    (tmp_path / "bad.yaml").write_text(SCENE)
    assert main(["render", both[1], "-o", str(out)]) == 0
    assert not (out / "bad.failed.json").exists()
    data = Page(out / "index.html").data["clips"]
    assert [(clip["name"], clip["failed"]) for clip in data] == [
        ("bad", False),
        ("good", False),
    ]
