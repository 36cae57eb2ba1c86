"""`physgen_golden` as its users have it: what it says of clips that differ."""

from __future__ import annotations

from collections.abc import Sequence
from html.parser import HTMLParser
from math import ceil
from pathlib import Path

import pytest
from users import FPS, LABEL, MEET, Said, another_library, edit, told

pytest_plugins = ["pytester"]


def test_the_first_run_writes_and_the_second_passes(home: Path, said: Said) -> None:
    code, text = said()
    assert code == 1
    assert "created" in text
    kept = sorted(path.name for path in (home / "test_scenes").iterdir())
    assert kept == ["test_clip.npz", "test_clip.webp"]
    assert said()[0] == 0


def test_a_changed_mass_names_the_sample_the_object_and_the_edit(home: Path, said: Said) -> None:
    """Nothing knows of the mass before the two meet; who stands aside never does."""
    said()
    before = sorted(home.rglob("*"))
    edit(
        home / "scene.yaml", ("mass: 170, elasticity: 0.9, velocity", "mass: 300, elasticity: 0.9, velocity")
    )
    code, text = said()
    assert code == 1
    first = f"from sample {ceil(MEET * FPS)} ({ceil(MEET * FPS) / FPS:.3f} s)"
    assert first in told(text, "motion")
    assert "2 of 3 objects, at most" in told(text, "motion")
    assert "bystander" not in told(text, "motion")
    assert "is bad" in told(text, "pixels")
    assert "objects.cue.mass is 300, was 170" in told(text, "since")
    page = Path(told(text, "page").split()[-1])
    assert page.is_file()
    assert [path for path in sorted(home.rglob("*")) if "pycache" not in path.parts[-2]] == [
        path for path in before if "pycache" not in path.parts[-2]
    ], "the page is not among the user's files"


def test_a_changed_light_is_a_matter_of_pixels(pytester: pytest.Pytester, said: Said, bundled: Path) -> None:
    test = f"""
        import os
        def test_clip(physgen_golden):
            light = ["light.intensity=0.6"] if os.environ.get("DIM") else []
            physgen_golden({str(bundled / "wall-ball" / "scene.yaml")!r}, overrides=["world.duration=0.4", *light])
    """
    pytester.makepyfile(test_scenes=test)
    said()
    assert said()[0] == 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DIM", "1")
        code, text = said()
    assert code == 1
    assert "the motion is as it was" in told(text, "pixels")
    assert "light.intensity is 0.6, was" in told(text, "since")


def test_comments_and_the_order_of_keys_do_not_count(home: Path, said: Said) -> None:
    said()
    scene = home / "scene.yaml"
    edit(scene, ("physgen: 1\nsize: [128, 96]\n", "size: [128, 96]  # a table\nphysgen: 1\n"))
    assert said()[0] == 0
    with pytest.MonkeyPatch.context() as patch:
        another_library(patch, 0.5)
        text = said()[1]
    assert "the scene is the same, and so are physgen, the libraries" in told(text, "since")
    assert "until=" in told(text, "chaos?")


class Tags(HTMLParser):
    """The elements of a page."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.text, self.links = "", list[str]()
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        self.text += data


def test_a_label_stays_text_and_the_page_stands_alone(home: Path, said: Said) -> None:
    said()
    edit(home / "scene.yaml", ("[72, 44]", "[72, 46]"), ("mass: 100}", f"mass: 100, label: {LABEL!r}}}"))
    _, text = said("--physgen-golden-report", "pages")
    page = home / "pages" / "test_scenes" / "test_clip.html"
    assert str(page) in text
    seen = Tags(page)
    assert LABEL in seen.text
    assert "script" not in seen.tags
    assert all(link.startswith(("data:", "#")) for link in seen.links)
    assert {path.name for path in page.parent.iterdir()} == {
        "test_clip.html", "test_clip.obtained.npz", "test_clip.obtained.webp",
    }  # fmt: skip
