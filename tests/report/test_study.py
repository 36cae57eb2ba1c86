"""A folder of methods made into a blind study: what is shown, and what is told by nothing."""

from __future__ import annotations

import base64
import re
import shutil
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from contest import FPS, FRAMES, SHADES, SIZE, contest, write_clip
from pytest import approx

from physgen.cli.main import main
from physgen.evaluate.study import make, methods_in, read_key
from physgen.problems import InputError


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return contest(tmp_path_factory.mktemp("contest") / "methods")


@pytest.fixture(scope="module")
def page(home: Path) -> Path:
    assert (
        main(["evaluate", "study", str(home), "-o", str(home.parent / "study.html")])
        == 0
    )
    return home.parent / "study.html"


def films(page: Path) -> dict[str, bytes]:
    found = re.findall(r'id="film-(\w+)">([^<]+)<', page.read_text())
    return {name: base64.b64decode(data) for name, data in found}


def decoded(data: bytes, where: Path) -> tuple[Any, list[Any]]:
    """Container's and streams' metadata, and frames, by the decoder itself."""
    path = where / "film.mp4"
    path.write_bytes(data)
    with av.open(str(path)) as container:
        told = (
            dict(container.metadata),
            [(s.type, dict(s.metadata)) for s in container.streams],
        )
        return told, [
            picture.to_ndarray(format="rgb24") for picture in container.decode(video=0)
        ]


def test_every_clip_is_there_under_the_keys_name(page: Path, tmp_path: Path) -> None:
    """The ground's grey says whose it is."""
    key, shown = read_key(page.with_name("study.key.json")), films(page)
    assert set(shown) == set(key.clips)
    assert set(key.clips.values()) == {
        (method, scene) for method in SHADES for scene in ("pool", "shelf")
    }
    for name, (method, _) in key.clips.items():
        _, frames = decoded(shown[name], tmp_path)
        assert len(frames) == FRAMES
        assert frames[0].shape == (SIZE[1], SIZE[0], 3)
        assert float(frames[3][-3:].mean()) == approx(SHADES[method], abs=4)


def test_nothing_tells_whose_it_is(home: Path, page: Path, tmp_path: Path) -> None:
    """Neither the page nor any film's bytes know a method, a scene or a file, and all films are of one make."""
    marked = tmp_path / "methods"
    shutil.copytree(home, marked)
    source = marked / "drift" / "pool.mp4"
    with (
        av.open(str(home / "drift" / "pool.mp4")) as old,
        av.open(str(source), "w") as new,
    ):
        new.metadata.update(title="drift on pool", comment="by drift")
        stream = new.add_stream("mpeg4", rate=FPS)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        sound = new.add_stream("aac", rate=44100, layout="mono")
        for picture in old.decode(video=0):
            new.mux(stream.encode(picture.reformat(format="yuv420p")))
        new.mux(stream.encode(None))
        quiet = av.AudioFrame.from_ndarray(
            np.zeros((1, 1024), np.float32), format="fltp", layout="mono"
        )
        quiet.sample_rate, quiet.pts = 44100, 0
        new.mux(sound.encode(quiet))
        new.mux(sound.encode(None))
    assert b"by drift" in source.read_bytes()
    assert (
        main(["evaluate", "study", str(marked), "-o", str(tmp_path / "study.html")])
        == 0
    )
    for made in (page, tmp_path / "study.html"):
        text = made.read_text()
        shown = films(made)
        rest = re.sub(r'(id="film-\w+">)[^<]+', r"\1", text).replace("data:", "")
        for word in (*SHADES, "pool", "shelf"):
            assert not re.search(rf"\b{word}\b", rest), word
            assert not any(word.encode() in data for data in shown.values())
        made_by = [decoded(data, tmp_path)[0] for data in shown.values()]
        assert all(told == made_by[0] for told in made_by)
        assert [kind for kind, _ in made_by[0][1]] == ["video"]
        encoders = {
            tuple(re.findall(rb"(?:x264|Lav[fc])[ -~]*", data))
            for data in shown.values()
        }
        assert len(encoders) == 1, "what the encoder says of itself is the same in all"


def test_the_same_folder_makes_the_same_study_and_another_seed_another(
    home: Path, page: Path
) -> None:
    again, other = make(methods_in(home), 15), make(methods_in(home), 15, seed=1)
    key = read_key(page.with_name("study.key.json"))
    assert again.key == key
    assert other.key.study != key.study
    assert list(other.key.clips.values()) != list(key.clips.values())


def test_clips_of_many_kinds_are_read(home: Path, tmp_path: Path) -> None:
    for ending in ("gif", "webp"):
        write_clip(tmp_path / ending / f"pool.{ending}", "ours")
    write_clip(tmp_path / "large" / "pool" / "result.mp4", "ours", size=(1600, 160))
    made = make(methods_in(tmp_path), 15)
    sizes = {clip.method: clip.size for clip in made.clips}
    assert sizes == {"gif": SIZE, "webp": SIZE, "large": (1024, 102)}
    for clip in made.clips:
        _, frames = decoded(clip.video, tmp_path)
        assert len(frames) == FRAMES


def test_clips_that_cannot_be_shown_are_told_all_at_once(
    home: Path, tmp_path: Path
) -> None:
    shutil.copytree(home, tmp_path / "m")
    write_clip(tmp_path / "m" / "drift" / "pool.mp4", "drift", frames=1)
    (tmp_path / "m" / "melt" / "shelf.mp4").write_bytes(b"none")
    (tmp_path / "m" / "photos" / "shelf.png").write_bytes(b"none")
    with pytest.raises(InputError) as error:
        make(methods_in(tmp_path / "m"), 15)
    text = str(error.value)
    assert len(error.value.problems) == 3
    for said in ("pool.mp4: has one frame", "shelf.mp4: is not a video", "shelf.png"):
        assert said in text
    assert (
        main(["evaluate", "study", str(tmp_path / "m"), "-o", str(tmp_path / "s.html")])
        == 2
    )
    assert not (tmp_path / "s.html").exists()
    assert not (tmp_path / "s.key.json").exists()
