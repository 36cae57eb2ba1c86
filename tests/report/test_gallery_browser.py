"""The gallery in a real browser, opened from disk: searched, sorted, filtered, laid out, run through time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from browser import grave, opened, overflowing, unfolded
from exhibits import document, exhibit, failure, sweep

from physgen.report import gallery
from physgen.report.gallery import write_gallery

pytestmark = pytest.mark.slow

LONG = (
    "Donaudampfschifffahrtsgesellschaftskapitänsmützenabzeichenverleihungsurkunde",
    "صندوق خشبي قديم جدا من خشب الأبنوس المطعم بالعاج والصدف الطبيعي",
    "非常长的标签用来检查中文换行和溢出的情况是否正常工作没有空格没有标点",
    "🎱🧱👩‍👩‍👧‍👦🏳️‍🌈🎱🧱👩‍👩‍👧‍👦🏳️‍🌈🎱🧱👩‍👩‍👧‍👦🏳️‍🌈🎱🧱👩‍👩‍👧‍👦🏳️‍🌈",
    "<script>window.broken = 1</script><img src=x onerror='window.broken = 2'>",
)
SHOWN = "() => [...document.querySelectorAll('[data-part=cards] > .clip:not([hidden])')].map(e => e.dataset.name)"


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four different clips, one with a variant, one with warnings, and one that failed."""
    home = tmp_path_factory.mktemp("mixed")
    exhibit(home / "pool", document(world__duration=3), seed=1)
    exhibit(
        home / "café", document(objects={"cup": {"label": "cup", "mass": 3}}), seed=2
    )
    exhibit(
        home / "pool-heavy", document(objects__ball__mass=900), seed=3, variant="heavy"
    )
    exhibit(
        home / "shelf",
        document(world__duration=5),
        seed=4,
        warnings=[{"text": "the books rest on nothing"}],
    )
    failure(home, "broken", 'broken.yaml:3:1: "<b>heavy</b>" is not a number')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gallery, "LIMITS", replace(gallery.LIMITS, min_searchable=1))
        write_gallery([home], home / "index.html")
    return home / "index.html"


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three masses by four frictions, of which one clip failed."""
    home = tmp_path_factory.mktemp("swept")
    sweep(home, [50, 100, 200], [0.1, 0.2, 0.3, 0.9], broken=5)
    write_gallery([home], home / "index.html")
    return home / "index.html"


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Names, labels, variants and messages that try the layout."""
    home = tmp_path_factory.mktemp("long")
    for k, text in enumerate(LONG):
        scene = document(
            objects__ball__label=text,
            objects__crate__label=text[::-1],
            objects__ball__mass=k,
        )
        told = [f"objects.ball.label={text}"]
        exhibit(
            home / f"{k}",
            scene,
            seed=k,
            scene=text,
            variant=text,
            overrides=told,
            warnings=[{"text": text}],
        )
        failure(home, f"failed-{k}", text, scene=text)
    write_gallery([home], home / "index.html", title=LONG[0])
    return home / "index.html"


def go(seen: Any, hash: str) -> None:
    """Another state, as by a link."""
    seen.page.evaluate("hash => { location.hash = hash; }", hash)
    seen.drawn()


def shown(seen: Any) -> list[str]:
    return list(seen.page.evaluate(SHOWN))


def at(seen: Any) -> str:
    return unquote(seen.page.evaluate("() => location.hash"))


def ready(browser: Any, page: Path, **how: Any) -> Any:
    return opened(browser, page, ready=False, **how)


# ---- it opens --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", ["", "#view=grid"])
def test_it_opens_from_disk_and_asks_for_its_pictures_alone(
    browser: Any, mixed: Path, view: str
) -> None:
    with ready(browser, mixed) as seen:
        seen.page.goto(mixed.as_uri() + view)
        seen.page.wait_for_selector("html[data-ready]")
        seen.page.wait_for_function("() => [...document.images].every(i => i.complete)")
        own = mixed.parent.as_uri() + "/"
        asked = [
            url.removeprefix(own) for url in seen.asked if not url.startswith("data:")
        ]
        assert all(url.startswith(("index.html", "index.files/")) for url in asked), (
            asked
        )
        assert seen.errors == []


# ---- what is asked for -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "names"),
    [
        ("pool", ["pool", "pool-heavy"]),
        ("cafe CUP", ["café"]),
        ("books rest", ["shelf"]),
        ("not a number", ["broken"]),
        ("heavy crate", ["pool-heavy"]),
        ("nothing has this", []),
    ],
)
def test_search(browser: Any, mixed: Path, words: str, names: list[str]) -> None:
    with ready(browser, mixed) as seen:
        seen.page.type("[data-part=search]", words)
        assert shown(seen) == names
        assert f"{len(names)} of 5 clips" in seen.page.inner_text("[data-part=status]")
        assert seen.page.is_visible("[data-part=nothing]") == (not names)
        seen.page.evaluate("() => document.querySelector('[data-part=reset]').click()")
        assert len(shown(seen)) == 5


def test_sorting_there_and_back(browser: Any, mixed: Path) -> None:
    with ready(browser, mixed) as seen:
        seen.page.select_option("[data-part=sort]", "=name")
        assert shown(seen) == ["broken", "café", "pool", "pool-heavy", "shelf"]
        seen.page.click("[data-part=desc]")
        assert shown(seen) == ["shelf", "pool-heavy", "pool", "café", "broken"]
        seen.page.click("[data-part=desc]")
        seen.page.select_option("[data-part=sort]", "=objects")
        assert shown(seen)[0] == "café"
        assert shown(seen)[-1] == "broken", "what has no value comes last"


def test_filters_join_within_and_narrow_across(browser: Any, mixed: Path) -> None:
    with ready(browser, mixed) as seen:
        seen.page.check("[data-label=cup]", force=True)
        assert shown(seen) == ["café"]
        seen.page.check("[data-label='wooden crate']", force=True)
        assert shown(seen) == ["café", "pool", "pool-heavy", "shelf"]
        seen.page.click("[data-part=reset]")
        seen.page.check("[data-is=failed]", force=True)
        assert shown(seen) == ["broken"]


def test_a_range_of_values(browser: Any, tmp_path: Path) -> None:
    for k in range(12):
        exhibit(tmp_path / f"{k}", overrides=[f"objects.ball.mass={10 * k}"])
    write_gallery([tmp_path], tmp_path / "index.html")
    with ready(browser, tmp_path / "index.html") as seen:
        low = seen.page.locator("[data-key='objects.ball.mass'] input[data-end=low]")
        low.focus()
        for _ in range(9):
            low.press("ArrowRight")
        assert shown(seen) == ["9", "10", "11"]
        assert low.get_attribute("aria-valuetext") == "90"
        assert "v.objects.ball.mass=90..110" in at(seen)
        low.press("Home")
        assert len(shown(seen)) == 12
        assert at(seen) in ("", "#")


def test_a_view_can_be_shared(browser: Any, mixed: Path) -> None:
    with ready(browser, mixed) as seen:
        seen.page.fill("[data-part=search]", "o")
        seen.page.check("[data-label='wooden crate']", force=True)
        seen.page.select_option("[data-part=sort]", "=name")
        seen.page.click("[data-part=desc]")
        names, address = shown(seen), seen.page.url
    assert names == ["shelf", "pool-heavy", "pool"]
    with ready(browser, mixed) as seen:
        seen.page.goto("about:blank")
        seen.page.goto(address)
        assert shown(seen) == names
        assert seen.page.is_checked("[data-label='wooden crate']")
        assert seen.page.input_value("[data-part=search]") == "o"
        assert seen.errors == []


# ---- a sweep ---------------------------------------------------------------------------------------------------------


def cells(seen: Any) -> list[list[str]]:
    return seen.page.evaluate(
        "() => [...document.querySelectorAll('.sheet tbody tr')].map(r => [...r.querySelectorAll('td')]"
        ".map(d => d.firstElementChild?.getAttribute('aria-label') ?? ''))"
    )


def test_a_sweep_opens_as_a_grid_by_its_axes(browser: Any, swept: Path) -> None:
    with ready(browser, swept) as seen:
        page = seen.page
        assert page.locator(".sheet thead [scope=col]").all_inner_texts() == [
            "50",
            "100",
            "200",
        ]
        assert page.locator(".sheet tbody [scope=row]").all_inner_texts() == [
            "0.1",
            "0.2",
            "0.3",
            "0.9",
        ]
        for row, friction in zip(cells(seen), (0.1, 0.2, 0.3, 0.9), strict=True):
            for told, mass in zip(row, (50, 100, 200), strict=True):
                assert f"mass {mass}, ball friction {friction}".replace(
                    "ball ", ""
                ) in told.replace("ball ", "")
                assert told.endswith(": failed") == ((mass, friction) == (100, 0.2))
        page.select_option("[data-part=x]", "objects.ball.friction")
        assert page.locator(".sheet thead [scope=col]").all_inner_texts() == [
            "0.1",
            "0.2",
            "0.3",
            "0.9",
        ]
        assert page.locator(".sheet tbody [scope=row]").all_inner_texts() == [
            "50",
            "100",
            "200",
        ]
        page.select_option("[data-part=y]", "-")
        assert len(cells(seen)) == 1
        assert "+2" in page.text_content(".sheet tbody")
        page.locator(".sheet .cell").first.click()
        assert page.locator("dialog .clip").count() == 3
        page.keyboard.press("Escape")
        assert not page.is_visible("dialog")
        assert seen.errors == []


# ---- hands -----------------------------------------------------------------------------------------------------------


def test_a_card_plays_under_the_pointer_and_stops(browser: Any, mixed: Path) -> None:
    with ready(browser, mixed, reduced_motion="no-preference") as seen:
        card = seen.page.locator(".clip", has_text="shelf")
        card.hover()
        seen.page.wait_for_function(
            "() => { const v = document.querySelector('.clip video'); return v && v.currentTime > 0.1 && !v.paused; }"
        )
        assert seen.page.locator(".clip video").count() == 1
        seen.page.mouse.move(2, 2)
        seen.page.wait_for_selector(".clip video", state="detached")


# ---- a new user ------------------------------------------------------------------------------------------------------


def test_the_seam_moves_by_keys_and_by_the_pointer(browser: Any, mixed: Path) -> None:
    """The seam of a card between photo and result: it neither opens the report nor moves other seams."""
    with ready(browser, mixed) as seen:
        card = seen.page.locator(".clip", has_text="Shelf")
        slider = card.get_by_role("slider", name="Shelf: share of the photo")
        slider.focus()
        for _ in range(20):
            seen.page.keyboard.press("ArrowLeft")
        assert slider.get_attribute("aria-valuetext") == "30 % photo, 70 % result"
        box = card.locator(".shot").bounding_box()
        x, y = box["x"] + 0.3 * box["width"], box["y"] + box["height"] / 2
        seen.page.mouse.move(x, y)
        seen.page.mouse.down()
        seen.page.mouse.move(box["x"] + 0.8 * box["width"], y, steps=4)
        seen.page.mouse.up()
        assert float(slider.input_value()) > 70
        seam = card.locator(".seam").bounding_box()
        middle = seam["x"] + seam["width"] / 2 - box["x"]
        share = float(slider.input_value()) / 100
        assert abs(middle / box["width"] - share) < 0.02
        assert seen.page.url.startswith(mixed.as_uri())
        assert seen.page.locator(".hero .slide").input_value() == "50"


def test_the_player_covers_no_card_and_has_a_name(browser: Any, mixed: Path) -> None:
    for viewport in ({"width": 1280, "height": 800}, {"width": 390, "height": 844}):
        with ready(browser, mixed, viewport=viewport) as seen:
            bar = seen.page.get_by_role("group", name="All clips together")
            page = seen.page.locator(".page").bounding_box()
            assert page["y"] + page["height"] <= bar.bounding_box()["y"] + 0.5
            last = seen.page.locator(".clip .open").last
            last.focus()
            assert last.bounding_box()["y"] < bar.bounding_box()["y"]


def test_two_rows_of_cards_are_visible_at_once(browser: Any, tmp_path: Path) -> None:
    for k in range(14):
        exhibit(tmp_path / f"clip-{k}", seed=k)
    write_gallery([tmp_path], tmp_path / "index.html")
    with ready(
        browser, tmp_path / "index.html", viewport={"width": 1280, "height": 800}
    ) as seen:
        assert seen.page.is_visible("[data-part=search]"), "14 clips are searched"
        rows = seen.page.evaluate(
            "() => [...new Set([...document.querySelectorAll('.clip')].filter(c => c.getBoundingClientRect().bottom"
            " <= document.querySelector('.clock').getBoundingClientRect().top)"
            ".map(c => c.offsetTop))].length"
        )
        assert rows >= 2


def test_few_clips_have_no_search(browser: Any, tmp_path: Path) -> None:
    for k in range(11):
        exhibit(tmp_path / f"clip-{k}", seed=k)
    write_gallery([tmp_path], tmp_path / "index.html")
    with ready(browser, tmp_path / "index.html") as seen:
        for part in ("search", "sort", "facets"):
            assert not seen.page.is_visible(f"[data-part={part}]"), part
        assert seen.errors == []


# ---- whoever reads it, whatever is in it -----------------------------------------------------------------------------


def test_a_mixed_gallery_begins_with_a_clip_that_moves_and_has_no_grid(
    browser: Any, mixed: Path
) -> None:
    with ready(browser, mixed, reduced_motion="no-preference") as seen:
        assert seen.page.is_visible(".hero .poster")
        seen.page.wait_for_function(
            "() => document.querySelector('.hero video')?.currentTime > 0"
        )
        assert not seen.page.is_visible(".switch")


@pytest.mark.parametrize(("width", "scheme"), [(360, "dark"), (1280, "light")])
@pytest.mark.parametrize("view", ["cards", "grid"])
def test_axe_finds_nothing_serious_and_nothing_flows_over(
    browser: Any, long: Path, width: int, view: str, scheme: str
) -> None:
    how = {
        "viewport": {"width": width, "height": 800},
        "is_mobile": width < 500,
        "has_touch": width < 500,
    }
    with ready(browser, long, color_scheme=scheme, **how) as seen:
        go(seen, f"view={view}")
        unfolded(seen.page)
        assert overflowing(seen.page) == []
        assert grave(seen.page) == []


def test_axe_finds_nothing_serious_in_a_sweep(browser: Any, swept: Path) -> None:
    with ready(browser, swept, color_scheme="dark") as seen:
        seen.page.wait_for_selector("html[data-ready]")
        unfolded(seen.page)
        assert grave(seen.page) == []
