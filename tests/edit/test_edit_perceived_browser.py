"""What perception found, on the editor's page: verdict, summary and doubtful regions, in a real browser."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from desk import seated
from served import Served

pytestmark = pytest.mark.slow

SCENE = """\
physgen: 1
image: photo.png
assets: maps
objects:
  crate: {mask: 1, mass: 30}
doubtful: {maybe-1: {mask: 2, confidence: 0.3}}
boundaries:
  floor: {segment: [[0, 90], [200, 90]]}
"""
RECORD = {
    "suitability": {"verdict": "doubtful", "reasons": ["few sure objects"]},
    "summary": ["1 object; suitability: doubtful", "  view      side: level"],
}


@pytest.fixture
def photographed(
    tmp_path: Path, serving: Callable[..., Served]
) -> Callable[[bool], Served]:
    """A perceived photo behind a server, perceived for this session or before."""

    def serve(is_new: bool) -> Served:
        labels = np.zeros((120, 200), np.uint8)
        labels[60:90, 30:60], labels[50:90, 120:160] = 1, 2
        (tmp_path / "maps").mkdir()
        cv2.imwrite(str(tmp_path / "photo.png"), cv2.merge([labels * 70 + 60] * 3))
        cv2.imwrite(str(tmp_path / "maps/background.png"), cv2.merge([labels + 60] * 3))
        cv2.imwrite(str(tmp_path / "maps/masks.png"), labels)
        (tmp_path / "maps/perceived.json").write_text(json.dumps(RECORD))
        scene = tmp_path / "scene.yaml"
        scene.write_text(SCENE)
        served = serving(scene)
        assert served.editor is not None
        served.editor.session.is_new = is_new
        return served

    return serve


def bright_pixels(page: Any, box: tuple[int, int, int, int]) -> int:
    """White pixels of the drawing over the photo, in a box of the photo."""
    script = """([x0, y0, x1, y1]) => {
      const over = document.querySelector('[data-part=over]');
      const dense = over.width / over.clientWidth;
      const [left, top] = window.editor.stage.screen([x0, y0]);
      const [right, bottom] = window.editor.stage.screen([x1, y1]);
      const { data } = over.getContext('2d').getImageData(
        left * dense, top * dense, (right - left) * dense, (bottom - top) * dense);
      let count = 0;
      for (let k = 0; k < data.length; k += 4)
        if (data[k] > 230 && data[k + 1] > 230 && data[k + 2] > 230) count += 1;
      return count;
    }"""
    return int(page.evaluate(script, list(box)))


def test_page_begins_with_verdict_and_summary(browser, photographed) -> None:
    with seated(browser, photographed(True).address) as desk:
        card = desk.page.locator("[data-part=perceived]")
        assert "few sure objects" in card.inner_text()
        assert "side: level" in card.inner_text()
        assert desk.grave("[data-part=perceived]") == []
        card.get_by_role("button").click()
        assert card.count() == 0
        desk.panel("todo")
        assert "doubtful" in desk.page.locator(".perceived-found").inner_text()
        assert desk.errors == []


def test_doubtful_regions_are_drawn_dashed(browser, photographed) -> None:
    with seated(browser, photographed(False).address) as desk:
        assert desk.page.locator("[data-part=perceived]").count() == 0
        left_edge = (117, 55, 123, 88)
        dashed = bright_pixels(desk.page, left_edge)
        assert dashed > 0
        assert bright_pixels(desk.page, (80, 55, 110, 88)) == 0
        desk.panel("todo")
        rows = desk.page.locator(".todo-item").all_inner_texts()
        assert any("maybe-1" in row for row in rows)
        assert desk.errors == []
