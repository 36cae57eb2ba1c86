"""The leaderboard in a real browser: methods in step, sorted, left out; on a desk and on a phone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from browser import PHONE, grave, opened, overflowing
from contest import FPS, FRAMES, contest, write_clip
from exhibits import failure

from physgen.cli.main import main

pytestmark = pytest.mark.slow

RUDE = "<script>window.broken = 1</script>"
FIRST = (
    "() => [...document.querySelectorAll('.cells')].map(c => [...c.querySelectorAll('.clip[data-method] h4')]"
    ".map(e => e.firstChild.textContent.trim()))"
)
TIMES = "() => [...document.querySelectorAll('.cells video')].map(v => v.currentTime)"


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three methods; one clip failed, one is missing, one is longer than the others."""
    home = tmp_path_factory.mktemp("board")
    methods = contest(home / "methods", ("pool", "shelf", "ramp"))
    (methods / "melt" / "shelf.mp4").unlink()
    (methods / "drift" / "ramp.mp4").unlink()
    failure(methods / "drift", "ramp", f"ramp.yaml:3:1: {RUDE}")
    write_clip(methods / "ours" / "ramp" / "video.mp4", "ours", 2, frames=2 * FRAMES)
    rows = [{"method": "ours", "image_fid": 105.7}, {"method": "drift", "image_fid": 99.64}]
    (methods / "fid").mkdir()
    (methods / "fid" / "result.json").write_text(json.dumps({"measure": "fid", "rows": rows}))
    asked = ["evaluate", "leaderboard", str(methods), "-o", str(home / "board")]
    assert main(asked) == 0
    return home / "board" / "index.html"


def ready(browser: Any, page: Path, **how: Any) -> Any:
    """High enough for all rows: only films in view move."""
    return opened(browser, page, ready=False, **{"viewport": {"width": 1280, "height": 2400}, **how})


def seek(seen: Any, time: float) -> None:
    seen.page.evaluate(
        "t => { const s = document.querySelector('[data-part=seek]'); s.value = t;"
        " s.dispatchEvent(new Event('input', {bubbles: true})); }",
        time,
    )


def settled(seen: Any, count: int) -> list[float]:
    seen.page.wait_for_function(
        "n => { const all = [...document.querySelectorAll('.cells video')];"
        " return all.length === n && all.every(v => v.readyState > 1 && !v.seeking); }",
        arg=count,
    )
    return list(seen.page.evaluate(TIMES))


def test_it_asks_for_its_own_files_alone_and_runs_nothing_of_others(browser: Any, board: Path) -> None:
    with ready(browser, board) as seen:
        seek(seen, 0.2)
        settled(seen, 7)
        assert seen.errors == []
        assert seen.page.evaluate("() => window.broken") is None
        assert RUDE in seen.page.inner_text(".clip.failed")
        home = board.parent.parent.as_uri() + "/"
        asked = [url for url in seen.asked if not url.startswith(("data:", "blob:"))]
        assert all(url.startswith(home) for url in asked)


@pytest.mark.parametrize("time", [0.0, 0.3, 0.7])
def test_the_slider_moves_all_clips_to_the_same_frame(browser: Any, board: Path, time: float) -> None:
    with ready(browser, board) as seen:
        seek(seen, time)
        assert [int(at * FPS) for at in settled(seen, 7)] == [round(time * FPS)] * 7


def test_keys_play_and_step(browser: Any, board: Path) -> None:
    with ready(browser, board) as seen:
        value = "() => +document.querySelector('[data-part=seek]').value"
        seen.page.keyboard.press("Home")
        seen.page.keyboard.press("ArrowRight")
        seen.page.keyboard.press("ArrowRight")
        assert seen.page.evaluate(value) == pytest.approx(2 / FPS)
        seen.page.keyboard.press("ArrowLeft")
        assert [int(at * FPS) for at in settled(seen, 7)] == [1] * 7
        seen.page.select_option("[data-part=rate]", "0.25")
        seen.page.evaluate("() => document.activeElement.blur()")
        seen.page.keyboard.press(" ")
        assert seen.page.get_attribute("[data-part=play]", "aria-label") == "Pause all"
        seen.page.wait_for_function(f"() => ({value})() > 0.3")
        seen.page.keyboard.press(" ")
        assert len({int(at * FPS) for at in settled(seen, 7)}) == 1
        seen.page.keyboard.press("End")
        assert seen.page.evaluate(value) == pytest.approx((2 * FRAMES - 1) / FPS)


def test_sorting_the_table_sorts_the_rows(browser: Any, board: Path) -> None:
    """Less is better of a distance; who has none comes last, either way."""
    names = "() => [...document.querySelectorAll('.standing tbody th')].map(e => e.textContent)"
    with ready(browser, board) as seen:
        head = seen.page.locator(".standing thead th", has_text="fid")
        for order, told in (
            (["drift", "ours", "melt"], "ascending"),
            (["ours", "drift", "melt"], "descending"),
        ):
            head.locator("button").click()
            assert seen.page.evaluate(names) == order
            assert seen.page.evaluate(FIRST) == [order] * 3
            assert head.get_attribute("aria-sort") == told
        assert seen.page.locator(".standing .best").all_inner_texts() == ["99.64"]
        assert seen.page.locator(".cells .clip.photo").first.evaluate(
            "e => e.previousElementSibling === null"
        )


def test_without_scripts_all_stands_there(browser: Any, board: Path) -> None:
    with ready(browser, board, java_script_enabled=False) as seen:
        assert seen.page.locator(".cells .clip:visible").count() == 12
        assert not seen.page.is_visible("[data-part=clock]")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious_and_nothing_flows_over(browser: Any, board: Path, scheme: str) -> None:
    with ready(browser, board, color_scheme=scheme, viewport=PHONE) as seen:
        assert grave(seen.page) == []
        assert overflowing(seen.page) == []
