"""Report and gallery look as they did when someone last looked at them: whole pages, on a desk, a phone, in the dark.

`pytest --force-regen` writes the pictures again, an eighth of the size; look at them before they are committed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from browser import LOOKS, looks_like, opened
from exhibits import document, exhibit, failure

from physgen.report.gallery import write_gallery

pytestmark = pytest.mark.slow

GOLDEN = Path(__file__).parent.parent / "golden_pages"
MACHINE = """#provenance :is(dl, .facts, .copied, .hashes), .intro small, .shot *, footer { display: none; }
body.gallery { display: block; height: auto; overflow: visible; } .page { overflow: visible; }"""
"""What versions, paths, dates, the loading of pictures and the height of the window decide."""
OTHER_LETTERS = "* { -webkit-text-stroke: .12px; }"
"""About what another font smoothing does."""


@pytest.fixture(scope="module")
def gallery(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three clips, one with a warning, and one that failed."""
    home = tmp_path_factory.mktemp("gallery")
    exhibit(home / "pool", document(world__duration=3), seed=1)
    exhibit(
        home / "cup", document(objects={"cup": {"label": "cup", "mass": 3}}), seed=2
    )
    exhibit(
        home / "shelf",
        document(),
        seed=4,
        warnings=[{"text": "the books rest on nothing"}],
    )
    failure(home, "broken", 'broken.yaml:3:1: "heavy" is not a number')
    write_gallery([home], home / "index.html", title="Gallery")
    return home / "index.html"


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("name", ["report", "gallery"])
def test_a_page_looks_as_it_did(
    browser: Any,
    pages: Path,
    gallery: Path,
    name: str,
    look: str,
    pytestconfig: pytest.Config,
) -> None:
    file = gallery if name == "gallery" else pages / "fall" / "report.html"
    golden = GOLDEN / f"{name}-{look}.webp"
    with opened(
        browser, file, ready=name == "report", preview=False, **LOOKS[look]
    ) as seen:
        seen.page.add_style_tag(content=MACHINE)
        seen.page.wait_for_load_state("networkidle")
        assert (
            looks_like(seen.page, golden, renew=pytestconfig.getoption("force_regen"))
            == ""
        )
        seen.page.add_style_tag(content=OTHER_LETTERS)
        assert looks_like(seen.page, golden) == "", "letters alone do not count"
        moved = "main > :first-child, .columns { position: relative; left: 24px; }"
        seen.page.add_style_tag(content=moved)
        assert looks_like(seen.page, golden), "a part that has moved does"
