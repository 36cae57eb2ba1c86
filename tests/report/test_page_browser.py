"""The page in a real browser: what charts tell, whoever reads it, whatever is in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import written
from browser import G, V, fallen, grave, opened, overflowing, report, unfolded
from pytest import approx

from physgen.files import resource
from physgen.render.contacts import contact_points_between
from physgen.report.page import SCRIPTS

# ---- charts ----------------------------------------------------------------------------------------------------------


def readout(seen: Any, chart: int) -> dict[str, str]:
    rows = seen.page.evaluate(
        "n => [...document.querySelectorAll('.chart')[n].querySelectorAll('.readout > div')]"
        ".map(d => [d.querySelector('dt').textContent, `${d.querySelector('dd').dataset.value} "
        "${d.querySelector('dd').childNodes[0].textContent.split(' ').slice(1).join(' ')}`])",
        chart,
    )
    return dict(rows)


def number(text: str) -> float:
    return float(text.split(" ")[0].replace("−", "-"))


@pytest.mark.slow
def test_charts_tell_what_nature_does(browser: Any, pages: Path) -> None:
    """Of a ball that falls: v² = vx² + (g t)²; energy goes from potential to kinetic; momentum is m v."""
    t = 0.8
    with opened(browser, report(pages, "fall")) as seen:
        seen.seek(t)
        seen.page.wait_for_timeout(120)
        speed, height = readout(seen, 3), readout(seen, 4)
        assert number(speed["ball"]) == approx(np.hypot(V, G * t) / 200, rel=6e-3)
        assert speed["ball"].endswith(" m/s")
        assert number(height["ball"]) == approx((399.5 - fallen(t)[1]) / 200, rel=6e-3)
        energy = readout(seen, 1)
        joule = 1000 * 200**2
        kinetic = 0.5 * 50 * (V**2 + (G * t) ** 2) / joule
        assert {v.split(" ")[1] for v in energy.values()} == {"mJ"}
        assert number(energy["kinetic"]) / 1000 == approx(kinetic, rel=6e-3)
        assert number(energy["kinetic"]) + number(energy["potential"]) == approx(
            1000 * (0.5 * 50 * V**2 + 50 * G * (380 - 18 - 50)) / joule, rel=0.02
        )
        assert number(readout(seen, 2)["to the right"]) == approx(
            50 * V / (1000 * 200) * 1000, rel=6e-3
        )


# ---- whoever reads it, whatever is in it -----------------------------------------------------------------------------


def test_without_scripts_the_picture_the_video_and_the_tables_stay(
    browser: Any, pages: Path
) -> None:
    with opened(
        browser, report(pages, "fall"), ready=False, java_script_enabled=False
    ) as seen:
        for what in ("svg.photo", "video[controls]", "table.parameters", "noscript p"):
            assert seen.page.is_visible(what), what
        for what in ("canvas", "[data-part=play]", "#physics"):
            assert not seen.page.is_visible(what), what


@pytest.mark.parametrize(("width", "scheme"), [(360, "dark"), (1280, "light")])
def test_axe_finds_nothing_serious_and_nothing_flows_over(
    browser: Any, pages: Path, width: int, scheme: str
) -> None:
    how = {
        "viewport": {"width": width, "height": 800},
        "is_mobile": width < 500,
        "has_touch": width < 500,
    }
    with opened(
        browser, report(pages, "long-heavy"), color_scheme=scheme, **how
    ) as seen:
        unfolded(seen.page)
        assert overflowing(seen.page) == []
        seen.page.wait_for_timeout(100)
        assert grave(seen.page) == []


def test_contacts_are_where_the_renderer_finds_them(
    browser: Any, tmp_path: Path
) -> None:
    """The script's geometry beside the renderer's, over many poses of many shapes."""
    text = """\
physgen: 1
size: [200, 200]
objects:
  a: {shape: {circle: {center: [50, 50], radius: 12}}}
  b: {shape: {circle: {center: [90, 60], radius: 20}}}
  c: {shape: {box: {center: [150, 60], size: [40, 20], angle: 20}}}
  d: {shape: {polygon: [[60, 120], [100, 110], [120, 150], [80, 170]]}}
boundaries:
  w: {polyline: [[10, 190], [100, 180], [190, 195]]}
"""
    world = written.world(tmp_path, text)
    data = {
        "walls": [
            {"chains": [chain.tolist() for chain in wall.chains]}
            for wall in world.walls
        ]
    }
    bodies = [
        {"rings": [ring.tolist() for ring in body.rings]}
        | ({} if body.radius is None else {"radius": body.radius})
        for body in world.bodies
    ]
    random = np.random.default_rng(3)
    cases, expected = [], []
    for _ in range(60):
        poses = np.column_stack(
            [random.uniform(20, 180, (4, 2)), random.uniform(-4, 4, 4)]
        )
        first, second = sorted(random.choice(5, 2, replace=False).tolist())
        points, gap = contact_points_between(world, poses, first, second)
        cases.append(
            [[{"x": x, "y": y, "a": a} for x, y, a in poses.tolist()], first, second]
        )
        expected.append((gap, points.mean(axis=0)))
    parts = [
        resource("templates", "player", f"{part}.js").read_text()
        for part in SCRIPTS
        if part in ("motion", "touch")
    ]
    script = "([data, bodies, cases]) => {" + "\n".join(parts)
    script += "return cases.map(([poses, one, two]) => touching(data, bodies, poses, one, two)); }"
    page = browser.new_page()
    found = page.evaluate(script, [data, bodies, cases])
    page.close()
    for got, (gap, point) in zip(found, expected, strict=True):
        assert got["gap"] == approx(gap, abs=1e-9)
        assert np.mean(got["points"], axis=0) == approx(point, abs=1e-6)
