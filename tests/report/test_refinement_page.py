"""What report, manifest and gallery tell of a refinement, and of one that failed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from written import loaded

from physgen import pipeline
from physgen.pipeline.refining import LargestChange
from physgen.report.films import Film
from physgen.report.page import PageParts, report_page
from physgen.report.perception import Comparison, compare_frames
from physgen.report.record import RunRecord

SCENE = """\
physgen: 1
size: [200, 150]
objects: {bob: {shape: {circle: {center: [50, 60], radius: 10}}}}
"""
NOTE = {
    "backend": "animatediff",
    "strength": 0.5,
    "steps": 50,
    "steps_run": 25,
    "steps_fused": 20,
    "seed": 7,
    "prompt": "<script>alert(1)</script>",
    "negative": "",
    "size": [512, 288],
    "windows": [[0, 16], [8, 24]],
    "device": "cuda",
    "weights": "a/b",
    "offload": False,
    "torch": "2.9.0",
    "diffusers": "0.36.0",
}


def page_of(
    tmp_path: Path,
    refine: dict | None,
    video: str = "video.mp4",
    shown: Comparison | None = None,
) -> str:
    scene = loaded(tmp_path, SCENE)
    record = RunRecord("scene", ["physgen"], refine=refine, unrefined_frames=["0"] * 12)
    world, film = pipeline.compile(scene, None).world, Film(video, True, video)
    first = np.zeros((150, 200, 3), np.uint8)
    return report_page(
        scene, world, record, first, film, SCENE, PageParts(refinement=shown)
    )


def test_the_page_shows_what_refinement_did(tmp_path: Path) -> None:
    changed = LargestChange()
    for k, by in enumerate((2, -9, 5)):
        before, after = (
            np.full((20, 40, 3), code, np.uint8) for code in (100 + k, 100 + k + by)
        )
        changed.add(before, after)
    assert (changed.index, int(changed.refined[0, 0, 0])) == (1, 92)
    pair = compare_frames(
        "refined", "Refined", "", ("before", before), ("after", after)
    )
    page = page_of(tmp_path, NOTE, shown=pair)
    start = page.index('<section id="refinement"')
    section = page[start : page.index("</section>", start)]
    assert page.index("</figure>") < start
    assert f'src="{pair.after.uri}"' in section
    assert "<script>alert" not in page
    for words in (
        "&lt;script&gt;alert(1)&lt;/script&gt;",
        '<td>steps run</td><td class="value">25</td>',
        '<td>size</td><td class="value">512, 288</td>',
        '<td>offload</td><td class="value">no</td>',
    ):
        assert words in section
    assert "negative" not in section, "nothing is told of it"
    assert "The rendered video, refined." in page
    assert "<dt>torch</dt><dd>2.9.0</dd>" in page
    assert "<dt>diffusers</dt><dd>0.36.0</dd>" in page


def test_the_page_says_why_a_refinement_failed(tmp_path: Path) -> None:
    page = page_of(
        tmp_path,
        {"backend": "animatediff", "failed": "refine: <b> do not fit; write less"},
        "unrefined.mp4",
    )
    assert "The rendered video, not refined." in page
    assert 'src="unrefined.mp4"' in page
    assert ">refine: &lt;b&gt; do not fit; write less<" in page
    assert "12 frames" in page
    assert "Mean change" not in page
    assert "Joints and fields" not in page, "there are none"
