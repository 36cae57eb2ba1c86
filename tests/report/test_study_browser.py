"""The rating page in a real browser: from the first word to the file that physgen reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from browser import PHONE, grave, opened, overflowing
from contest import SHADES, contest

from physgen.cli.main import main
from physgen.evaluate.ratings import read_answers
from physgen.evaluate.study import Key, read_key

pytestmark = pytest.mark.slow

CLIPS = 6


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("study")
    contest(home / "methods")
    assert (
        main(
            ["evaluate", "study", str(home / "methods"), "-o", str(home / "study.html")]
        )
        == 0
    )
    return home / "study.html"


@pytest.fixture(scope="module")
def key(page: Path) -> Key:
    return read_key(page.with_name("study.key.json"))


def begin(seen: Any, rater: str) -> None:
    seen.page.fill("#rater", rater)
    seen.page.click("text=Begin")


def number(seen: Any) -> str:
    return str(seen.page.inner_text("[data-part=number]"))


def grey(seen: Any) -> float:
    """Of the ground that the film shows, once it is drawn, which is not black: it says whose clip it is."""
    drawn = seen.page.wait_for_function(
        "() => { const v = document.querySelector('video'), c = document.createElement('canvas');"
        " if (v.readyState < 2 || v.seeking) return 0;"
        " [c.width, c.height] = [v.videoWidth, v.videoHeight]; const g = c.getContext('2d');"
        " g.drawImage(v, 0, 0); return g.getImageData(2, c.height - 2, 1, 1).data[0]; }"
    )
    return float(drawn.json_value())


def method(seen: Any) -> str:
    level = grey(seen)
    return min(SHADES, key=lambda name: abs(SHADES[name] - level))


def save(seen: Any, folder: Path) -> Path:
    with seen.page.expect_download() as waiting:
        seen.page.click("[data-part=save]")
    path = folder / waiting.value.suggested_filename
    waiting.value.save_as(path)
    return path


SCORES = {"ours": (5, 4), "drift": (2, 3), "melt": (1, 1)}


def test_from_the_page_to_the_result(
    browser: Any, page: Path, key: Key, tmp_path: Path
) -> None:
    """By keys alone, each clip scored by what it shows, with a reload midway: every score finds its method."""
    with opened(browser, page, ready=False) as seen:
        begin(seen, "Ada Łoś")
        for k in range(CLIPS):
            assert number(seen) == f"Video {k + 1} of {CLIPS}"
            physical, photo = SCORES[method(seen)]
            seen.page.keyboard.press(str(physical))
            if k == 3:  # half an answer is kept, too
                seen.page.wait_for_timeout(350)
                seen.page.keyboard.press("ArrowUp")
                seen.page.keyboard.press(str(physical))
                seen.page.reload()
                assert number(seen) == f"Video {k + 1} of {CLIPS}"
                assert seen.page.is_checked(f"[name=physical][value='{physical}']")
                assert not seen.page.is_checked(f"[name=photo][value='{photo}']")
            seen.page.keyboard.press(str(photo))
            seen.page.keyboard.press("Enter")
        assert seen.page.inner_text("[data-part=done-title]") == "Thank you"
        path = save(seen, tmp_path)
        assert path.name == "answers-Ada-Łoś.json"
        assert seen.errors == []
        assert {
            url.partition(":")[0] for url in seen.asked if url != page.as_uri()
        } <= {"blob", "data"}
    record = json.loads(path.read_text(encoding="utf-8"))
    assert sorted(record["order"]) == sorted(key.clips)
    assert record["answers"][record["order"][3]]["seconds"] >= 0.3, (
        "what was before the reload counts, too"
    )
    found = read_answers([path], key)
    for m, name in enumerate(key.methods):
        assert (found.scores["physical"][0, m] == SCORES[name][0]).all()
        assert (found.scores["photo"][0, m] == SCORES[name][1]).all()


def test_half_an_answer_goes_not_on_and_a_skipped_clip_is_missing(
    browser: Any, page: Path, key: Key, tmp_path: Path
) -> None:
    with opened(browser, page, ready=False) as seen:
        begin(seen, "Cy")
        seen.page.keyboard.press("4")
        seen.page.click("[data-part=next]", force=True)
        assert number(seen) == f"Video 1 of {CLIPS}"
        assert "Answer both" in seen.page.inner_text("[data-part=missing]")
        seen.page.click("[data-part=skip]")
        seen.page.click("label:has([name=physical][value='2'])")
        seen.page.click("label:has([name=photo][value='3'])")
        seen.page.click("[data-part=next]")
        seen.page.click("[data-part=back]")
        assert seen.page.is_checked("[name=photo][value='3']")
        seen.page.click("label:has([name=photo][value='5'])")
        seen.page.click("[data-part=stop]")
        assert "You have rated 1 of 6" in seen.page.inner_text("[data-part=sum]")
        path = save(seen, tmp_path)
        assert (
            json.loads(seen.page.input_value("[data-part=text]"))["answers"]
            == json.loads(path.read_text())["answers"]
        )
        seen.page.click("[data-part=more]")
        assert number(seen) == f"Video 3 of {CLIPS}"
    record = json.loads(path.read_text())
    assert record["left_out"] == [record["order"][0]]
    scores = read_answers([path], key).scores
    assert sorted(scores["physical"][scores["physical"] > 0].tolist()) == [2]
    assert sorted(scores["photo"][scores["photo"] > 0].tolist()) == [5]


@pytest.mark.parametrize(
    ("screen", "scheme"), [("start", "light"), ("rate", "dark"), ("done", "light")]
)
def test_axe_finds_nothing_serious_and_nothing_flows_over(
    browser: Any, page: Path, scheme: str, screen: str
) -> None:
    with opened(
        browser, page, ready=False, color_scheme=scheme, viewport=PHONE
    ) as seen:
        if screen != "start":
            begin(
                seen,
                "Donaudampfschifffahrtsgesellschaftskapitänsmützenabzeichenverleihungsurkunde",
            )
            seen.page.keyboard.press("3")
        if screen == "done":
            seen.page.click("[data-part=stop]")
            seen.page.click("summary")
        assert grave(seen.page) == []
        assert overflowing(seen.page) == []
