"""Tasks of a new user on report and gallery: find the scale, select an object, go back, compare, save a frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from browser import PHONE, grave, opened, report
from pytest import approx

from physgen.report.gallery import write_gallery

pytestmark = pytest.mark.slow

BLOCK = (240, 350)
"""px of the photo: the middle of the block of `FALL`."""
SIZE = (320, 400)


@pytest.fixture(scope="module")
def gallery(pages: Path) -> Path:
    """A gallery of the pages, beside their folders."""
    write_gallery([pages], pages / "index.html")
    return pages / "index.html"


def click_photo(seen: Any, selector: str, place: tuple[float, float]) -> None:
    """Click a place of the photo on a picture of all of it."""
    box = seen.page.locator(selector).bounding_box()
    x, y = (
        (at + 0.5) / size * box[side]
        for at, size, side in zip(place, SIZE, ("width", "height"), strict=True)
    )
    seen.page.locator(selector).click(position={"x": x, "y": y})


def picked(seen: Any) -> str:
    return str(seen.page.inner_text("[data-part=picked]"))


def marked(seen: Any) -> list[str]:
    """Names of the rows of the table that are marked."""
    return seen.page.evaluate(
        "() => [...document.querySelectorAll('tr.selected')].flatMap(r => JSON.parse(r.dataset.names))"
    )


def strong(seen: Any) -> list[str]:
    """Objects whose curves are thick."""
    return seen.page.evaluate(
        "() => [...document.querySelectorAll('.readout b')].map(e => e.textContent)"
    )


def test_the_scale_is_on_top(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        assert "Scale from the scene file: 1.6 m wide." in seen.page.inner_text(".top")
    with opened(browser, report(pages, "long-heavy")) as seen:
        assert "No scale in the scene file" in seen.page.inner_text(".top")


@pytest.mark.parametrize("view", ["canvas", "[data-part=film]"])
def test_an_object_is_selected_everywhere(browser: Any, pages: Path, view: str) -> None:
    """The one with a velocity is selected first, then the one that is clicked; a click beside plays."""
    with opened(browser, report(pages, "fall"), preview=view == "canvas") as seen:
        assert picked(seen).startswith("Selected: ball")
        assert marked(seen) == ["ball"]
        assert strong(seen) == ["ball", "ball"]
        click_photo(seen, view, BLOCK)
        assert picked(seen).startswith("Selected: block") or "script" in picked(seen)
        assert marked(seen) == ["block"]
        assert strong(seen) == ["block", "block"]
        frame = seen.page.locator(".frame", has=seen.page.locator(view))
        outline = frame.locator(".marked path").bounding_box()
        box = seen.page.locator(view).bounding_box()
        middle = (outline["x"] + outline["width"] / 2 - box["x"]) / box["width"]
        assert middle == approx((BLOCK[0] + 0.5) / SIZE[0], abs=0.01)
        seen.page.get_by_role("button", name="ball", exact=True).last.click()
        assert marked(seen) == ["ball"]
        assert not seen.playing
        click_photo(seen, view, (160, 200))
        assert seen.playing
        assert seen.errors == []


def test_the_report_leads_back_and_to_its_neighbours(
    browser: Any, gallery: Path
) -> None:
    with opened(browser, gallery, ready=False) as seen:
        page = seen.page
        page.wait_for_selector("html[data-ready]")
        page.locator(".clip[data-name=fall] .open").click()
        page.wait_for_selector("#player[data-ready]")
        page.get_by_role("link", name="long-heavy →").click()
        page.wait_for_selector("#player[data-ready]")
        assert "/long-heavy/report.html" in page.url
        page.get_by_role("link", name="← fall").click()
        page.get_by_role("link", name="long-heavy →").wait_for()
        page.get_by_role("link", name="All clips").click()
        page.wait_for_selector("html[data-ready]")
        assert page.url.startswith(gallery.as_uri())
        assert seen.errors == []


@pytest.mark.parametrize(
    "page", ["javascript:alert(1).html", "//host/x.html", "/x.html"]
)
def test_a_way_back_is_a_page_beside_the_clip(
    browser: Any, pages: Path, page: str
) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        seen.page.goto(f"{report(pages, 'fall').as_uri()}?gallery={page}")
        seen.page.wait_for_selector("#player[data-ready]")
        # No page elsewhere: the folder above it is the way back.
        assert seen.page.get_attribute("[data-part=home]", "href") == "../"
        assert seen.page.is_visible("[data-part=home]")
        assert not any("host" in url.split("?")[0] for url in seen.asked)


def test_two_clips_run_in_step(browser: Any, gallery: Path) -> None:
    """The second clip stands at the same time as the first, to half a frame."""
    with opened(browser, gallery, ready=False) as seen:
        page = seen.page
        page.goto(f"{report(gallery.parent, 'fall').as_uri()}?gallery=../index.html")
        page.wait_for_selector("#player[data-ready]")
        page.get_by_label("Compare with a clip").select_option("back")
        page.wait_for_function(
            "() => document.querySelector('[data-part=other]').readyState > 1"
        )
        for time in (0.31, 1.0):
            seen.seek(time)
            page.wait_for_timeout(150)
            first, second = page.evaluate(
                "() => [...document.querySelectorAll('video')].map(v => v.currentTime)"
            )
            assert second == approx(first, abs=0.5 / 30)
        assert grave(page) == []
        page.set_input_files("[data-part=file]", gallery.parent / "one" / "video.mp4")
        assert "video.mp4" in page.inner_text("[data-part=other-name]")
        assert seen.errors == []


def test_charts_stand_at_the_frame_that_the_video_shows(
    browser: Any, pages: Path
) -> None:
    """While it plays, the cursor of the charts is within a frame of the video."""
    with opened(
        browser, report(pages, "fall"), preview=False, reduced_motion="no-preference"
    ) as seen:
        seen.page.wait_for_function(
            "() => document.querySelector('video').currentTime > 0.2"
        )
        off = seen.page.evaluate(
            """async () => {
              const video = document.querySelector('video'), lines = document.querySelectorAll('.cursor');
              const plot = document.querySelectorAll('.plot')[1], found = [];
              const span = plot.clientWidth - 56 - 10, end = +document.querySelector('[data-part=seek]').max;
              for (let k = 0; k < 10; k += 1) {
                const shown = await new Promise(done =>
                  video.requestVideoFrameCallback((_, { mediaTime }) => done(mediaTime)));
                await new Promise(requestAnimationFrame); await new Promise(requestAnimationFrame);
                const x = new DOMMatrix(getComputedStyle(lines[1]).transform).e;
                found.push((x - 56) / span * end - shown);
              }
              return found;
            }"""
        )
        assert sorted(map(abs, off))[len(off) // 2] <= 1 / 30 + 0.004


def test_a_frame_is_saved_and_the_photo_lies_over_the_video(
    browser: Any, pages: Path
) -> None:
    with opened(browser, report(pages, "fall"), preview=False) as seen:
        seen.seek(0.5)
        with seen.page.expect_download() as saving:
            seen.page.get_by_role("button", name="Save frame").click()
        assert saving.value.suggested_filename == "fall-0016.png"
        assert Path(saving.value.path()).read_bytes().startswith(b"\x89PNG")
        seen.page.get_by_role("button", name="Photo | frame").click()
        slider = seen.page.get_by_role("slider", name="Share of the photo")
        slider.focus()
        seen.page.keyboard.press("ArrowRight")
        assert slider.get_attribute("aria-valuetext") == "51 % photo"
        assert grave(seen.page) == []
        assert seen.errors == []


def test_a_phone_shows_a_short_page(browser: Any, pages: Path) -> None:
    with opened(
        browser, report(pages, "fall"), viewport=PHONE, is_mobile=True, has_touch=True
    ) as seen:
        assert seen.page.evaluate("() => document.body.scrollHeight") <= 3000
        assert not seen.page.is_visible("table.parameters")
        seen.page.click("nav [href='#parameters']")
        assert seen.page.is_visible("table.parameters")
