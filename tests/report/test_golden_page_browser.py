"""The page of a golden clip that differs, in a real browser: whoever reads it, whatever is in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from browser import FALL, PHONE, opened

from physgen.batch.golden import checked
from physgen.batch.tolerances import GoldenOptions
from physgen.pipeline import Stages

LABEL = "<script>window.broken = 1</script>"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a ball that falls, and later somewhat slower."""
    folder = tmp_path_factory.mktemp("golden")
    (folder / "fall.yaml").write_text(FALL, encoding="utf-8")
    said = ""
    for overrides in ([], ["world.gravity=[0, 560]", f'objects.ball.label="{LABEL}"']):
        check = checked(
            folder / "fall.yaml", "fall.yaml", f"test_{LABEL}.py::test", GoldenOptions(overrides), Stages()
        )
        if not overrides:
            check.write(folder / "fall.npz")
        said, _ = check.differs(folder / "fall.npz", folder / "fall.webp", folder)
    assert "from sample 3 (0.100 s): ball by 0.2 px" in said  # 40 t² / 2
    return folder / "fall.html"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious(browser: Any, page: Path, scheme: str) -> None:
    from axe_playwright_python.sync_playwright import Axe

    with opened(browser, page, ready=False, color_scheme=scheme) as seen:
        found = Axe().run(seen.page).response["violations"]
        assert [v["id"] for v in found if v["impact"] in ("serious", "critical")] == []


def test_the_page_asks_for_nothing_and_runs_nothing_of_others(browser: Any, page: Path) -> None:
    with opened(browser, page, ready=False, viewport=PHONE) as seen:
        assert seen.errors == []
        assert [url for url in seen.asked if not url.startswith("data:")] == [page.as_uri()]
        assert seen.page.evaluate("() => window.broken") is None
        assert LABEL in seen.page.inner_text("h1")
        assert LABEL in seen.page.inner_text(".results")
        assert seen.page.locator(".take").count() == 6
        assert seen.page.locator(".take .three img").count() == 18
        assert seen.page.evaluate("() => document.documentElement.scrollWidth") == PHONE["width"]
