"""Report, gallery and failed page as they were when last looked at and found right.

`pytest --force-regen` takes what is now. Looked at full size, on a desk and on a phone, in light and dark. That a
change of the page is seen is tested, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from browser import PHONE, opened
from exhibits import document, exhibit, failure, sweep
from shots import differences, golden, save, shot

from physgen import pipeline
from physgen.report.gallery import write_gallery

pytestmark = pytest.mark.slow

HAND = {"viewport": PHONE, "is_mobile": True, "has_touch": True}
DARK = {"color_scheme": "dark"}
REPORT = (
    "h1", "header .facts", "nav", ".screen", ".controls", ".chart", "main > section", "main > details",
    ".perceived figure", ".compare", ".parameters", ".copied", ".repeat", "footer",
)  # fmt: skip
GALLERY = ("h1", ".tools", ".facets", ".status", ".clip", ".sheet table", ".sheet .cell", "footer")
FAILED = ("h1", "section", ".faults li", ".copied", ".listing", "footer")
SHOTS = {
    "report-desk": ("report", {}),
    "report-phone": ("report", HAND),
    "report-dark": ("report", DARK),
    "gallery-desk": ("gallery", {}),
    "gallery-phone-dark": ("gallery", HAND | DARK),
    "sweep-desk": ("sweep", {}),
    "sweep-phone": ("sweep", HAND),
    "failed-phone": ("failed", HAND),
}
PARTS = {"report": REPORT, "gallery": GALLERY, "sweep": GALLERY, "failed": FAILED}


@pytest.fixture(scope="module")
def home(bundled: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`report.html` of marbles that run down a trough, `gallery.html` and `sweep.html` of grey clips, `failed.html`."""
    home = tmp_path_factory.mktemp("shots")
    overrides = ["world.duration=0.8", "objects.red.mass=9"]
    command = ["physgen", "render", "scene.yaml", *(f"--set={text}" for text in overrides)]
    folder = pipeline.render_scene(
        bundled / "marbles" / "scene.yaml",
        home / "out",
        overrides=overrides,
        command=command,
        single_file=True,
    )
    (folder / "report.html").rename(home / "report.html")
    clips = home / "clips"
    for k, (name, label) in enumerate(
        {"marbles": "glass marble", "tower": "wooden block", "stones": "curling stone"}.items()
    ):
        exhibit(
            clips / name,
            document(objects={"one": {"label": label, "mass": 10.0 + k}}, world__duration=1 + k),
            seed=k,
        )
    exhibit(clips / "warned", warnings=[{"text": "an object that nothing supports"}])
    told = 'pair.yaml:3:1: objects.ball.mass: "heavy" is not a number; write grams, e.g. 170'
    failure(clips, "pair", told)
    write_gallery([clips], home / "gallery.html", title="Five clips")
    sweep(home / "runs", [50, 100, 200], [0.1, 0.9], broken=4)
    write_gallery([home / "runs"], home / "sweep.html", title="A sweep")
    (home / "failed.html").write_text(_failed(home), encoding="utf-8")
    return home


def _failed(home: Path) -> str:
    from physgen.problems import InputError
    from physgen.report.page import failed_page

    text = "physgen: 1\nsize: [200, 100]\nobjects:\n  ball: {shape: auto, mass: heavy}\n  crate: {mess: 3}\n"
    (home / "wrong.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        pipeline.load(home / "wrong.yaml")
    return failed_page("wrong", caught.value.problems, ["physgen", "render", "wrong.yaml"], text)


@contextmanager
def ready(browser: Any, home: Path, page: str, **how: Any) -> Iterator[Any]:
    """The page at the moment of which pictures are kept."""
    with opened(browser, home / f"{page}.html", ready=page == "report", **how) as seen:
        if page == "report":
            seen.page.wait_for_function("() => document.querySelector('video').readyState >= 2")
            for layer in ("outlines", "velocities", "trails"):
                seen.page.click(f"[data-layer={layer}]")
            seen.seek(0.3)
            seen.page.wait_for_function("() => !document.querySelector('video').seeking")
        elif page != "failed":
            seen.page.wait_for_selector("html[data-ready]")
            for image in seen.page.locator("img.poster:visible").all():
                image.scroll_into_view_if_needed()
            seen.page.evaluate("scrollTo(0, 0)")
        yield seen


@pytest.mark.parametrize("name", SHOTS)
def test_the_page_looks_as_it_did(
    browser: Any, home: Path, name: str, request: pytest.FixtureRequest
) -> None:
    page, how = SHOTS[name]
    with ready(browser, home, page, **how) as seen:
        now = shot(seen.page, PARTS[page])
    if request.config.getoption("force_regen"):
        save(name, now)
    assert differences(now, golden(name)) == []


CHANGES = {
    "a section is gone": "#parameters { display: none; }",
    "two sections are the other way round": "#parameters { translate: 0 320px; } #pairs { translate: 0 -720px; }",
    "a section has moved": "#physics { padding-top: 40px; }",
    "a picture is gone": ".perceived figure:first-child img { visibility: hidden; }",
    "the canvas is empty": "canvas { visibility: hidden; }",
    "a chart has lost its areas": ".chart .area { display: none; }",
    "a chart has lost its lines": ".chart .line { display: none; }",
    "a table has lost its words": ".parameters { color: transparent; }",
    "a heading has lost its words": "#pairs h2 { visibility: hidden; }",
    "buttons are gone": ".buttons button { display: none; }",
    "a colour is another": ":root { --accent: #c0392b; }",
    "the paper is grey": "body { background: #e4e4e4; }",
}
OTHERWISE = "* { text-rendering: geometricPrecision; -webkit-text-stroke: .15px currentColor; }"
"""Letters as another build of the browser might draw them."""


@pytest.fixture(scope="module")
def page(browser: Any, home: Path) -> Iterator[Any]:
    with ready(browser, home, "report") as seen:
        yield seen.page


def styled(page: Any, css: str) -> list[str]:
    """How the page differs with a rule more."""
    style = page.add_style_tag(content=css)
    try:
        return differences(shot(page, REPORT), golden("report-desk"))
    finally:
        style.evaluate("element => element.remove()")


@pytest.mark.parametrize("what", CHANGES)
def test_a_change_of_the_page_is_seen(page: Any, what: str) -> None:
    assert styled(page, CHANGES[what])
