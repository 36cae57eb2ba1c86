"""Pages of docs/: figures come from committed JSON, links lead somewhere, examples hold, and there is not too much."""

from __future__ import annotations

import doctest
import importlib
import re
import shutil
from pathlib import Path

import pytest

from physgen.scene.load import scene_name

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))
MOST_PAGES, MOST_WORDS = 18, 13_000
MEASURED = ("accuracy", "benchmarks", "gallery", "scene")
"""Pages of tables and of the scene's keys, which grow with what is measured."""


@pytest.mark.parametrize(
    ("name", "module"), [("benchmarks", "tables"), ("accuracy", "accuracy")]
)
def test_a_page_is_what_its_json_says(name: str, module: str) -> None:
    """`python benchmarks/tables.py` writes both."""
    assert (ROOT / "docs" / f"{name}.md").read_text(
        encoding="utf-8"
    ) == importlib.import_module(module).page()


def test_docs_name_the_folder_of_a_clip() -> None:
    """A file called `scene.yaml` is rendered into the folder of its folder's name."""
    for page in ("README.md", "docs/index.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        (folder,) = re.findall(r"in a folder called (\w+)", text)
        (output,) = set(re.findall(r"out/(\w+)", text))
        assert output == scene_name(Path(folder, "scene.yaml"))


def test_docs_stay_short() -> None:
    assert len(PAGES) <= MOST_PAGES
    written = [page for page in PAGES if page.stem not in MEASURED]
    written.append(ROOT / "README.md")
    assert sum(_count_words(page.read_text()) for page in written) <= MOST_WORDS


def _count_words(text: str) -> int:
    """Return the number of words of a page, without its blocks of code."""
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    lines = [line for line in prose.splitlines() if not line.startswith("    ")]
    return len(" ".join(lines).split())


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", ROOT / "studio" / "README.md", *PAGES],
    ids=lambda p: p.name,
)
def test_links_lead_somewhere(page: Path) -> None:
    """To a file that is there, and to a heading of it."""
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if not link.startswith("http"):
            name, _, heading = link.partition("#")
            target = page.parent / name if name else page
            assert target.exists(), f"{page.name} -> {link}"
            assert not heading or heading in headings(target.read_text()), (
                f"{page.name} -> {link}"
            )


def test_pages_that_code_and_templates_name_are_there() -> None:
    files = [
        p
        for f in ("physgen", "templates", "schemas", "studio", "benchmarks")
        for p in (ROOT / f).rglob("*.*")
    ]
    named = {
        (name, str(path.relative_to(ROOT)))
        for path in files
        if path.suffix in (".py", ".json", ".html", ".js", ".md", ".toml")
        and path.stat().st_size < 10**6
        for name in re.findall(r"docs/([\w-]+\.md)", path.read_text(encoding="utf-8"))
    }
    assert len(named) > 10
    assert [one for one in named if not (ROOT / "docs" / one[0]).exists()] == []


def modules_with_examples() -> list[str]:
    paths = [
        path.relative_to(ROOT)
        for path in (ROOT / "physgen").rglob("*.py")
        if re.search(r"^\s*>>> ", path.read_text(), re.MULTILINE)
    ]
    own = [
        path.relative_to(ROOT / "benchmarks")
        for path in (ROOT / "benchmarks").rglob("*.py")
        if re.search(r"^\s*>>> ", path.read_text(), re.MULTILINE)
    ]
    return sorted(
        str(path.with_suffix("")).replace("/", ".").removesuffix(".__init__")
        for path in (*paths, *own)
    )


@pytest.mark.parametrize("module", ["test_docs", *modules_with_examples()])
def test_examples_in_docstrings_hold(module: str) -> None:
    found = doctest.testmod(importlib.import_module(module))
    assert found.attempted
    assert not found.failed


@pytest.mark.slow
def test_examples_of_the_python_page_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    shutil.copy(ROOT / "scenes/billiards/photo.png", tmp_path)
    blocks = re.findall(
        r"```python\n(.*?)```", (ROOT / "docs/python.md").read_text(), re.DOTALL
    )
    exec(compile("\n".join(blocks), "docs/python.md", "exec"), {})
    assert (tmp_path / "out/dominoes/video.mp4").exists()
    assert (tmp_path / "scene.yaml").exists()


def headings(text: str) -> set[str]:
    """Anchors as Markdown readers make them.

    >>> sorted(headings("# A page\\n## `joints.NAME`\\n## What, and why"))
    ['a-page', 'jointsname', 'what-and-why']
    """
    titles = re.findall(r"^#+ +(.+)$", text, re.MULTILINE)
    return {
        re.sub(r"\s+", "-", re.sub(r"[^\w\s-]", "", title.lower()).strip())
        for title in titles
    }
